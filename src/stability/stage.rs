//! Small scenes, built in memory.

use glam::{DVec3, Vec3, dvec3};

use crate::scene::{Camera, Environment, Material, Mesh, NONE, RenderDefaults, Scene, Surface, Triangle, shapes};

/// A scene in the making: fronts are where corners run counter-clockwise.
#[derive(Clone)]
pub struct Stage {
    camera: Camera,
    environment: Environment,
    materials: Vec<Material>,
    mesh: Mesh,
}

/// A black surface, which the others are told by their difference to.
fn black() -> Material {
    Material {
        name: String::new(),
        surface: Surface::Glossy,
        kd: Vec3::ZERO,
        ks: Vec3::ZERO,
        ns: 1.0,
        ni: 1.0,
        tf: Vec3::ONE,
        ke: Vec3::ZERO,
        map_kd: None,
    }
}

/// A diffuse surface.
pub fn grey(kd: f32) -> Material {
    Material { kd: Vec3::splat(kd), ..black() }
}

/// A lamp.
pub fn lamp(ke: f32) -> Material {
    Material { ke: Vec3::splat(ke), ..black() }
}

/// A Phong lobe that loses nothing.
pub fn gloss(ns: f32) -> Material {
    Material { ks: Vec3::ONE, ns, ..black() }
}

/// What light can enter.
pub fn glass(surface: Surface, ni: f32) -> Material {
    Material { surface, ni, ..black() }
}

impl Stage {
    /// Nothing yet, seen from `eye`.
    pub fn new(eye: DVec3, target: DVec3, vfov: f64) -> Self {
        let along = (target - eye).normalize();
        let up = if along.y.abs() > 0.999 { DVec3::Z } else { DVec3::Y };
        let camera = Camera { eye, target, up, vfov, aperture: 0.0, focus: 1.0 };
        Self { camera, environment: Environment::Black, materials: Vec::new(), mesh: Mesh::default() }
    }

    /// Another up direction.
    pub fn up(mut self, up: DVec3) -> Self {
        self.camera.up = up;
        self
    }

    /// Light from infinity.
    pub fn sky(mut self, environment: Environment) -> Self {
        self.environment = environment;
        self
    }

    /// A sky of radiance 1.
    pub fn white_sky(self) -> Self {
        self.sky(Environment::Constant(Vec3::ONE))
    }

    /// What the following is made of.
    pub fn of(mut self, material: Material) -> Self {
        self.materials.push(material);
        self
    }

    /// A convex polygon.
    pub fn polygon(mut self, corners: &[DVec3]) -> Self {
        let first = self.mesh.positions.len() as u32;
        let material = self.materials.len() as u32 - 1;
        self.mesh.positions.extend(corners);
        for i in 2..corners.len() as u32 {
            let positions = [first, first + i - 1, first + i];
            self.mesh.triangles.push(Triangle { positions, normals: [NONE; 3], uvs: [NONE; 3], material });
        }
        self
    }

    /// Convex polygons.
    pub fn polygons(self, polygons: &[Vec<DVec3>]) -> Self {
        polygons.iter().fold(self, |stage, polygon| stage.polygon(polygon))
    }

    /// A square of half side `half` about `centre`, its front towards `normal`.
    pub fn square(self, centre: DVec3, normal: DVec3, half: f64) -> Self {
        let a = half * normal.any_orthonormal_vector();
        let b = normal.cross(a);
        self.polygon(&[centre - a - b, centre + a - b, centre + a + b, centre - a + b])
    }

    /// The scene.
    pub fn scene(self) -> Scene {
        Scene {
            name: "stability".to_owned(),
            camera: self.camera,
            width: 1,
            height: 1,
            defaults: RenderDefaults::default(),
            mesh: self.mesh,
            materials: self.materials,
            textures: Vec::new(),
            environment: self.environment,
            hash: String::new(),
            warnings: Vec::new(),
        }
    }
}

/// A box with its fronts outwards.
pub fn cuboid(low: DVec3, high: DVec3) -> Vec<Vec<DVec3>> {
    shapes::cuboid(low, high).map(Vec::from).to_vec()
}

/// A cube about the origin.
pub fn cube(half: f64) -> Vec<Vec<DVec3>> {
    cuboid(DVec3::splat(-half), DVec3::splat(half))
}

/// An ellipsoid about the origin of `rows` bands, twice as many around, its fronts outwards.
pub fn ball(radii: DVec3, rows: u32) -> Vec<Vec<DVec3>> {
    let point = |row: u32, column: u32| {
        let (sin_row, cos_row) = (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
        let (sin, cos) = (std::f64::consts::PI * f64::from(column % (2 * rows)) / f64::from(rows)).sin_cos();
        // The poles are one point whatever the meridian.
        let sin_row = if row.is_multiple_of(rows) { 0.0 } else { sin_row };
        radii * dvec3(sin_row * sin, cos_row, sin_row * cos)
    };
    let bands = (0..rows).flat_map(|row| (0..2 * rows).map(move |column| (row, column)));
    bands
        .map(|(row, column)| match row {
            0 => vec![point(0, 0), point(1, column), point(1, column + 1)],
            _ if row + 1 == rows => vec![point(row, column), point(rows, 0), point(row, column + 1)],
            _ => vec![point(row, column), point(row + 1, column), point(row + 1, column + 1), point(row, column + 1)],
        })
        .collect()
}

/// A rod along z of half length 0.5 whose cross-section is a square of half side 0.5, one edge of which is rounded by
/// `facets` faces of that width each: slivers. Its fronts are outwards.
pub fn bevelled_rod(facets: u32, width: f64) -> Vec<Vec<DVec3>> {
    // An arc of a quarter turn, tangent to both sides.
    let radius = width * f64::from(facets) / std::f64::consts::FRAC_PI_2;
    let arc = (0..=facets).map(|i| {
        let angle = std::f64::consts::FRAC_PI_2 * f64::from(i) / f64::from(facets);
        dvec3(0.5 - radius + radius * angle.cos(), 0.5 - radius + radius * angle.sin(), 0.0)
    });
    let rest = [dvec3(-0.5, 0.5, 0.0), dvec3(-0.5, -0.5, 0.0), dvec3(0.5, -0.5, 0.0)];
    let outline: Vec<DVec3> = arc.chain(rest).collect();
    let (back, front) = (-0.5 * DVec3::Z, 0.5 * DVec3::Z);
    let sides = (0..outline.len()).map(|i| {
        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
        vec![a + back, b + back, b + front, a + front]
    });
    let cap: Vec<DVec3> = outline.iter().map(|p| *p + front).collect();
    let base: Vec<DVec3> = outline.iter().rev().map(|p| *p + back).collect();
    sides.chain([cap, base]).collect()
}

/// The same faces seen from their backs.
pub fn inside_out(mut polygons: Vec<Vec<DVec3>>) -> Vec<Vec<DVec3>> {
    polygons.iter_mut().for_each(|corners| corners.reverse());
    polygons
}

/// The same faces, each point moved by `to`.
pub fn moved(mut polygons: Vec<Vec<DVec3>>, to: impl Fn(DVec3) -> DVec3) -> Vec<Vec<DVec3>> {
    polygons.iter_mut().flatten().for_each(|p| *p = to(*p));
    polygons
}

/// A scene with every position mapped by `to`, which keeps shapes similar.
pub fn mapped(scene: &Scene, to: impl Fn(DVec3) -> DVec3) -> Scene {
    let mut scene = scene.clone();
    scene.mesh.positions.iter_mut().for_each(|p| *p = to(*p));
    (scene.camera.eye, scene.camera.target) = (to(scene.camera.eye), to(scene.camera.target));
    scene
}
