//! Scenes that are built in memory.

use glam::{DVec3, Vec2, Vec3};

use super::{Camera, Environment, Light, Material, Mesh, NONE, Parameter, Principled, Scene, Surface, Triangle};
use crate::settings::Settings;

/// A scene in the making. Fronts are where corners run counter-clockwise.
///
/// ```
/// use glam::{DVec3, Vec3, dvec3};
/// use raywave::scene::{Camera, Environment, Material, SceneBuilder, shapes};
///
/// let scene = SceneBuilder::new(Camera::pinhole(dvec3(2.0, 2.0, 4.0), DVec3::ZERO, 40.0))
///     .resolution(320, 240)
///     .environment(Environment::Constant(Vec3::ONE))
///     .material(Material::diffuse(Vec3::new(0.8, 0.4, 0.1)))
///     .polygons(shapes::cuboid(DVec3::splat(-0.5), DVec3::splat(0.5)))
///     .material(Material::emitter(Vec3::splat(10.0)))
///     .polygon(&[dvec3(-1.0, 2.0, -1.0), dvec3(1.0, 2.0, -1.0), dvec3(1.0, 2.0, 1.0), dvec3(-1.0, 2.0, 1.0)])
///     .build();
/// assert_eq!(scene.mesh.triangles.len(), 14);
/// assert_eq!(scene.light_triangles().count(), 2);
/// ```
#[derive(Debug, Clone)]
pub struct SceneBuilder {
    camera: Camera,
    settings: Settings,
    environment: Environment,
    materials: Vec<Material>,
    mesh: Mesh,
    lights: Vec<Light>,
}

impl SceneBuilder {
    /// Nothing yet, seen by a camera in an image of the default size.
    pub fn new(camera: Camera) -> Self {
        let (materials, mesh, lights) = Default::default();
        Self { camera, settings: Settings::default(), environment: Environment::Black, materials, mesh, lights }
    }

    /// The size of the image in pixels.
    pub fn resolution(mut self, width: u32, height: u32) -> Self {
        (self.settings.width, self.settings.height) = (width, height);
        self
    }

    /// Light from infinity.
    pub fn environment(mut self, environment: Environment) -> Self {
        self.environment = environment;
        self
    }

    /// A light that is no surface.
    pub fn light(mut self, light: Light) -> Self {
        self.lights.push(light);
        self
    }

    /// The material of what follows. One that is made of others names them by their places among all materials.
    pub fn material(mut self, material: Material) -> Self {
        self.materials.push(material);
        self
    }

    /// A flat convex polygon.
    ///
    /// # Panics
    /// Where no material goes before it, as the others that add faces.
    pub fn polygon(self, corners: &[DVec3]) -> Self {
        self.face(corners, None)
    }

    /// A convex polygon with a unit shading normal at each corner.
    ///
    /// # Panics
    /// Where there are not as many normals as corners.
    pub fn shaded_polygon(self, corners: &[DVec3], normals: &[Vec3]) -> Self {
        assert_eq!(corners.len(), normals.len(), "each corner needs a normal");
        self.face(corners, Some(normals))
    }

    /// Flat convex polygons.
    pub fn polygons(self, polygons: impl IntoIterator<Item: AsRef<[DVec3]>>) -> Self {
        polygons.into_iter().fold(self, |builder, polygon| builder.polygon(polygon.as_ref()))
    }

    /// A square of half side `half` about `centre`, its front towards the unit vector `normal`.
    pub fn square(self, centre: DVec3, normal: DVec3, half: f64) -> Self {
        let a = half * normal.any_orthonormal_vector();
        let b = normal.cross(a);
        self.polygon(&[centre - a - b, centre + a - b, centre + a + b, centre - a + b])
    }

    /// The scene. Positions and materials are taken as they are: they should be as [`Scene`] and its
    /// parts document them.
    pub fn build(self) -> Scene {
        Scene {
            name: "in memory".to_owned(),
            hash: self.hash(),
            camera: self.camera,
            settings: self.settings,
            mesh: self.mesh,
            placed: Vec::new(),
            materials: self.materials,
            textures: Vec::new(),
            environment: self.environment,
            lights: self.lights,
            warnings: Vec::new(),
        }
    }

    fn face(mut self, corners: &[DVec3], normals: Option<&[Vec3]>) -> Self {
        let material = self.materials.len().checked_sub(1).expect("a material goes before the faces it is of") as u32;
        let (first, first_normal) = (self.mesh.positions.len() as u32, self.mesh.normals.len() as u32);
        self.mesh.positions.extend(corners);
        self.mesh.normals.extend(normals.unwrap_or_default());
        for i in 2..corners.len() as u32 {
            let fan = [0, i - 1, i];
            self.mesh.triangles.push(Triangle {
                positions: fan.map(|corner| first + corner),
                normals: if normals.is_some() { fan.map(|corner| first_normal + corner) } else { [NONE; 3] },
                uvs: [NONE; 3],
                material,
            });
        }
        self
    }

    /// As the hash of a scene from files stands for their contents, that of all that was put in.
    fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        let Mesh { positions, normals, triangles, .. } = &self.mesh;
        hasher.update(bytemuck::cast_slice(positions)).update(bytemuck::cast_slice(normals));
        for triangle in triangles {
            hasher.update(bytemuck::bytes_of(&triangle.positions)).update(bytemuck::bytes_of(&triangle.normals));
            hasher.update(&triangle.material.to_le_bytes());
        }
        hasher.update(format!("{:?}{:?}{:?}", self.camera, self.materials, self.lights).as_bytes());
        match &self.environment {
            Environment::Black => {}
            Environment::Constant(radiance) => {
                hasher.update(bytemuck::bytes_of(radiance));
            }
            Environment::LatLong(map) => {
                hasher.update(&map.width.to_le_bytes()).update(bytemuck::cast_slice(&map.radiance));
            }
        }
        hasher.finalize().to_hex().to_string()
    }
}

impl Camera {
    /// A pinhole at `eye` with a vertical field of view in degrees. Its up direction is y, or z where
    /// it looks along y.
    pub fn pinhole(eye: DVec3, target: DVec3, vfov: f64) -> Self {
        let along = (target - eye).normalize();
        let up = if along.y.abs() > 0.999 { DVec3::Z } else { DVec3::Y };
        Self { eye, target, up, vfov, orthographic: None, aperture: 0.0, focus: 1.0 }
    }
}

impl Material {
    /// A black surface; the other constructors override its fields.
    fn black() -> Self {
        Self {
            name: String::new(),
            surface: Surface::Glossy,
            diffuse: Vec3::ZERO,
            specular: Vec3::ZERO,
            exponent: 1.0,
            ior: 1.0,
            transmission: Vec3::ONE,
            emission: Vec3::ZERO,
            is_pure_emitter: true,
            roughness: Vec2::ZERO,
            eta: Vec3::ZERO,
            absorption: Vec3::ZERO,
            metalness: 0.0,
            coat: 0.0,
            coat_roughness: 0.0,
            principled: Principled::default(),
            weight: 1.0,
            is_beckmann: false,
            compensates: true,
            textures: [None; Parameter::COUNT],
        }
    }

    /// A diffuse surface (Lambert).
    pub fn diffuse(reflectance: Vec3) -> Self {
        Self { diffuse: reflectance, ..Self::black() }
    }

    /// A diffuse surface with a Phong lobe. The reflectances add up to 1 at most.
    pub fn phong(diffuse: Vec3, specular: Vec3, exponent: f32) -> Self {
        Self { diffuse, specular, exponent, ..Self::black() }
    }

    /// A perfect mirror.
    pub fn mirror(reflectance: Vec3) -> Self {
        Self { surface: Surface::Mirror, specular: reflectance, ..Self::black() }
    }

    /// A smooth body of an index of refraction, in air: Fresnel-weighted reflection and transmission.
    pub fn dielectric(ior: f32) -> Self {
        Self { surface: Surface::Dielectric, ior, ..Self::black() }
    }

    /// A metal of a complex index of refraction, with microfacets of that width (GGX's alpha).
    pub fn conductor(eta: Vec3, absorption: Vec3, alpha: f32) -> Self {
        let roughness = Vec2::splat(alpha);
        Self { surface: Surface::Conductor, specular: Vec3::ONE, eta, absorption, roughness, ..Self::black() }
    }

    /// A diffuse base under a coat of an index of refraction, with microfacets of that width (GGX's alpha).
    pub fn plastic(diffuse: Vec3, ior: f32, alpha: f32) -> Self {
        let (surface, roughness) = (Surface::Plastic { nonlinear: false }, Vec2::splat(alpha));
        Self { surface, diffuse, specular: Vec3::ONE, ior, roughness, ..Self::black() }
    }

    /// glTF's material: a share of metal, and the rest diffuse under a dielectric interface of index 1.5. `alpha` is the
    /// square of glTF's roughness.
    pub fn metal_rough(colour: Vec3, metalness: f32, alpha: f32) -> Self {
        let (surface, roughness) = (Surface::MetalRough, Vec2::splat(alpha));
        Self { surface, diffuse: colour, specular: Vec3::ONE, ior: 1.5, metalness, roughness, ..Self::black() }
    }

    /// Disney's material of a body of an index of refraction. `alpha` is the square of its roughness.
    pub fn principled(colour: Vec3, ior: f32, alpha: f32, principled: Principled) -> Self {
        let (surface, roughness) = (Surface::Principled, Vec2::splat(alpha));
        Self { surface, diffuse: colour, ior, roughness, principled, compensates: false, ..Self::black() }
    }

    /// Disney's material of a thin sheet. `alpha` is the square of its roughness.
    pub fn principled_thin(colour: Vec3, ior: f32, alpha: f32, principled: Principled) -> Self {
        Self { surface: Surface::PrincipledThin, ..Self::principled(colour, ior, alpha, principled) }
    }

    /// The same surface with microfacets of those widths along the tangent and across it (GGX's alpha).
    pub fn rough(self, along: f32, across: f32) -> Self {
        Self { roughness: Vec2::new(along, across), ..self }
    }

    /// A pure emitter of a radiance.
    pub fn emitter(radiance: Vec3) -> Self {
        Self { emission: radiance, ..Self::black() }
    }
}
