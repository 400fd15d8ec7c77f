//! The scene as the kernels read it: normalised, in leaf order, with only what it requires.

use glam::{DVec3, Vec2, Vec3};
use thiserror::Error;

use super::plan::Plan;
use super::settings::{Settings, ShadowRays, Sort};
use crate::alias::alias_table;
use crate::bvh::{self, Bvh, BvhKind};
use crate::constants::*;
use crate::layout::{self, AliasCell, EnvironmentTexel, Frame, Light, Material, Normals, Triangle};
use crate::scene::{self, Environment, EnvironmentMap, Integrator, Scene, Surface};

/// A scene that the kernels cannot hold.
#[derive(Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum PrepareError {
    #[error("the scene has {0} triangles and a BVH can address {max}; use a smaller scene", max = bvh::MAX_TRIANGLES)]
    TooManyTriangles(usize),
    #[error("the BVH has {nodes} nodes and one of this shape can address {max}; use --bvh bvh2")]
    TooManyNodes { nodes: usize, max: usize },
    #[error("the scene has {0} emitting triangles and light sampling can tell {max} apart; use fewer", max = MAX_CELLS)]
    TooManyLights(usize),
    #[error("the environment has {0} texels and light sampling can tell {max} apart; scale the image down", max = MAX_CELLS)]
    TooManyTexels(usize),
}

/// Most cells of an alias table: random numbers have 24 bits.
const MAX_CELLS: usize = 1 << 24;

/// Scene data in the layouts of the GPU.
#[derive(Debug)]
pub struct PreparedScene {
    /// The hierarchy over `triangles`.
    pub bvh: Bvh,
    /// Triangles in leaf order.
    pub triangles: Vec<Triangle>,
    /// Materials in the scene's order.
    pub materials: Vec<Material>,
    /// Emitting triangles.
    pub lights: Vec<Light>,
    /// Shading normals in the scene's order, if there are any.
    pub normals: Vec<Normals>,
    /// Three texture coordinates a triangle in the scene's order, if there are textures.
    pub texture_coordinates: Vec<Vec2>,
    /// Per image its width and height, then its texels as halves.
    pub textures: Vec<[u32; 2]>,
    /// Texels of a lat-long environment.
    pub environment: Vec<EnvironmentTexel>,
    /// Alias table of the texels.
    pub environment_aliases: Vec<AliasCell>,
    /// Area of all lights, normalised units squared.
    pub light_area: f64,
    /// What the scene needs of the kernels.
    pub features: Features,
    /// How its positions came from the world's.
    pub normalisation: Normalisation,
    frame: Frame,
}

/// What a scene needs: all else is left out of its kernels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Features {
    /// One of `ENVIRONMENT_*`.
    pub environment: u32,
    /// Some triangle emits.
    pub lights: bool,
    /// Some material has a Phong lobe.
    pub phong: bool,
    /// Some material is a mirror.
    pub mirror: bool,
    /// Some material refracts without Fresnel split.
    pub refractive: bool,
    /// Some material is a Fresnel dielectric.
    pub dielectric: bool,
    /// Some material has a texture.
    pub textures: bool,
    /// Some triangle has shading normals.
    pub normals: bool,
    /// The camera has a lens.
    pub lens: bool,
}

/// From world to normalised space: bounds to [-1, 1]³, by a power of two so that it is exact.
#[derive(Debug, Clone, Copy)]
pub struct Normalisation {
    /// Middle of the scene's bounds, world units.
    pub centre: DVec3,
    /// Normalised lengths of a world unit, a power of two: normalised = (world - centre) · scale.
    pub scale: f64,
}

impl Normalisation {
    fn of(scene: &Scene) -> Self {
        let (low, high) = scene.bounds();
        let extent = (0.5 * (high - low)).max_element();
        let scale = if extent > 0.0 { (-extent.log2().ceil()).exp2() } else { 1.0 };
        Self { centre: low.midpoint(high), scale }
    }

    fn point(&self, p: DVec3) -> DVec3 {
        (p - self.centre) * self.scale
    }

    fn length(&self, length: f64) -> f32 {
        (length * self.scale) as f32
    }
}

impl PreparedScene {
    /// [`PreparedScene::with_bvh`] of the kind that is fastest on most scenes on devices of eight lanes or more.
    ///
    /// # Errors
    /// When the scene is larger than an index can tell.
    pub fn new(scene: &Scene) -> Result<Self, PrepareError> {
        Self::with_bvh(scene, BvhKind::Cwbvh)
    }

    /// Builds a BVH of that kind and lays the scene out.
    ///
    /// # Errors
    /// When the scene is larger than an index can tell.
    pub fn with_bvh(scene: &Scene, kind: BvhKind) -> Result<Self, PrepareError> {
        let mesh = &scene.mesh;
        if mesh.triangles.len() > bvh::MAX_TRIANGLES {
            return Err(PrepareError::TooManyTriangles(mesh.triangles.len()));
        }
        let normalisation = Normalisation::of(scene);
        let points: Vec<Vec3> = mesh.positions.iter().map(|p| normalisation.point(*p).as_vec3()).collect();
        let corners: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|t| t.positions.map(|i| points[i as usize])).collect();
        let bvh = Bvh::build(kind, &corners);
        let (nodes, max) = (bvh.node_count(), kind.max_nodes());
        if nodes > max {
            return Err(PrepareError::TooManyNodes { nodes, max });
        }
        let triangles: Vec<Triangle> = bvh
            .order
            .iter()
            .map(|&original| {
                let [v0, v1, v2] = corners[original as usize].map(|v| v.to_array());
                let material = mesh.triangles[original as usize].material;
                Triangle { v0, original, v1, material, v2, unused: 0 }
            })
            .collect();
        let (lights, light_area) = lights_of(scene, &bvh, &corners)?;

        let has_textures = scene.materials.iter().any(|material| material.map_kd.is_some());
        let (textures, headers) = if has_textures { pack_textures(&scene.textures) } else { Default::default() };
        let (environment, environment_aliases) = match &scene.environment {
            Environment::LatLong(map) => pack_environment(map)?,
            Environment::Black | Environment::Constant(_) => Default::default(),
        };
        let is = |surface| scene.materials.iter().any(|m| !m.is_emitter() && m.surface == surface);
        let features = Features {
            environment: match scene.environment {
                Environment::Black => ENVIRONMENT_BLACK,
                Environment::Constant(_) => ENVIRONMENT_CONSTANT,
                Environment::LatLong(_) => ENVIRONMENT_LAT_LONG,
            },
            lights: !lights.is_empty(),
            phong: scene
                .materials
                .iter()
                .any(|m| !m.is_emitter() && m.surface == Surface::Glossy && m.ks.max_element() > 0.0),
            mirror: is(Surface::Mirror),
            refractive: is(Surface::Refractive),
            dielectric: is(Surface::Dielectric),
            textures: has_textures,
            normals: mesh.triangles.iter().any(|t| t.normals[0] != scene::NONE),
            lens: scene.camera.aperture > 0.0,
        };
        let mut frame = camera_frame(&scene.camera, &normalisation);
        frame.light_count = lights.len() as u32;
        frame.light_area = light_area as f32;
        match &scene.environment {
            Environment::Constant(radiance) => frame.environment_radiance = radiance.to_array(),
            Environment::LatLong(map) => {
                (frame.environment_width, frame.environment_height) = (map.width, map.height);
            }
            Environment::Black => {}
        }
        Ok(Self {
            bvh,
            triangles,
            materials: scene.materials.iter().map(|m| pack_material(m, &headers)).collect(),
            lights,
            normals: if features.normals { pack_normals(mesh) } else { Vec::new() },
            texture_coordinates: if has_textures { pack_coordinates(mesh) } else { Vec::new() },
            textures,
            environment,
            environment_aliases,
            light_area,
            features,
            normalisation,
            frame,
        })
    }

    /// The uniform block of a render with `path_capacity` slots.
    pub fn frame(&self, settings: &Settings, path_capacity: u32) -> Frame {
        let aspect = settings.width as f32 / settings.height as f32;
        Frame {
            // Until here, right is as long as up.
            camera_right: self.frame.camera_right.map(|c| c * aspect),
            roulette: settings.roulette as f32,
            max_bounces: settings.max_bounces.unwrap_or(UNBOUNDED),
            seed: settings.seed,
            width: settings.width,
            height: settings.height,
            path_capacity,
            ..self.frame
        }
    }

    /// Entries of the traversal stack: each inner node on the way down leaves one at most. Of a wide
    /// tree it is the siblings of the node that comes next, and the last level has none.
    pub fn stack_size(&self) -> u32 {
        match self.bvh.kind {
            BvhKind::Bvh2 => self.bvh.depth,
            BvhKind::Bvh4 | BvhKind::Cwbvh => self.bvh.depth - 1,
        }
    }

    /// Bytes of the traversal stacks of `paths` at once, beyond what stays in registers.
    pub fn stack_bytes(&self, paths: u32) -> u64 {
        let blocks = self.stack_size().saturating_sub(STACK_REGISTERS).div_ceil(STACK_BLOCK);
        u64::from(blocks) * u64::from(paths) * u64::from(4 * STACK_BLOCK)
    }

    /// Specialization constants by id.
    pub fn specialization(&self, settings: &Settings, plan: &Plan) -> Vec<u32> {
        let Features { environment, lights, phong, mirror, refractive, dielectric, textures, normals, lens } =
            self.features;
        let mut constants = vec![0; SPEC_DEFERS_SHADOW_RAYS as usize + 1];
        for (id, value) in [
            (SPEC_WORKGROUP_SIZE, plan.workgroup_size),
            (SPEC_STACK_SIZE, self.stack_size()),
            (
                SPEC_INTEGRATOR,
                match settings.integrator {
                    Integrator::Implicit => INTEGRATOR_IMPLICIT,
                    Integrator::Explicit => INTEGRATOR_EXPLICIT,
                },
            ),
            (SPEC_ENVIRONMENT, environment),
            (SPEC_HAS_LIGHTS, lights.into()),
            (SPEC_HAS_PHONG, phong.into()),
            (SPEC_HAS_MIRROR, mirror.into()),
            (SPEC_HAS_REFRACTIVE, refractive.into()),
            (SPEC_HAS_DIELECTRIC, dielectric.into()),
            (SPEC_HAS_TEXTURES, textures.into()),
            (SPEC_HAS_NORMALS, normals.into()),
            (SPEC_HAS_LENS, lens.into()),
            (SPEC_HAS_ROULETTE, (settings.roulette > 0.0).into()),
            (SPEC_SHADING_COST, settings.shading_cost),
            (SPEC_MATERIAL_BRANCHES, settings.material_branches),
            (SPEC_SORTED, (settings.sort == Sort::Material).into()),
            (SPEC_DEFERS_SHADOW_RAYS, (settings.shadow_rays == ShadowRays::Deferred).into()),
            (SPEC_BVH_WIDTH, self.bvh.kind.width()),
            (SPEC_REGENERATES, (plan.paths_per_invocation > 1).into()),
        ] {
            constants[id as usize] = value;
        }
        constants
    }
}

/// Camera vectors for a square image: the session scales `camera_right` by the aspect.
fn camera_frame(camera: &scene::Camera, normalisation: &Normalisation) -> Frame {
    let forward = (camera.target - camera.eye).normalize();
    let mut right = forward.cross(camera.up).normalize_or_zero();
    if right == DVec3::ZERO {
        // Looking straight up or down: any axis that is not the view's will do for up.
        right = forward.cross(forward.any_orthonormal_vector()).normalize();
    }
    let up = right.cross(forward);
    let half_height = (0.5 * camera.vfov.to_radians()).tan();
    let mut frame: Frame = bytemuck::Zeroable::zeroed();
    frame.camera_eye = normalisation.point(camera.eye).as_vec3().to_array();
    frame.camera_forward = forward.as_vec3().to_array();
    frame.camera_right = (right * half_height).as_vec3().to_array();
    frame.camera_up = (up * half_height).as_vec3().to_array();
    frame.lens_radius = normalisation.length(camera.aperture);
    frame.focus_distance = normalisation.length(camera.focus);
    frame
}

/// Emitting triangles with their alias table over area, and their total area.
fn lights_of(scene: &Scene, bvh: &Bvh, corners: &[[Vec3; 3]]) -> Result<(Vec<Light>, f64), PrepareError> {
    let emits = |original: u32| scene.materials[scene.mesh.triangles[original as usize].material as usize].is_emitter();
    let mut lights: Vec<(u32, u32)> = bvh
        .order
        .iter()
        .enumerate()
        .filter(|(_, original)| emits(**original))
        .map(|(place, original)| (*original, place as u32))
        .collect();
    // The scene's order, so that random numbers pick the same light whatever the BVH is.
    lights.sort_unstable();
    let areas: Vec<f64> = lights
        .iter()
        .map(|(original, _)| {
            let [a, b, c] = corners[*original as usize].map(|v| v.as_dvec3());
            0.5 * (b - a).cross(c - a).length()
        })
        .collect();
    let area = areas.iter().sum();
    if lights.len() > MAX_CELLS {
        return Err(PrepareError::TooManyLights(lights.len()));
    }
    if area == 0.0 {
        return Ok((Vec::new(), 0.0));
    }
    let cells = alias_table(&areas);
    let lights = lights
        .iter()
        .zip(cells)
        .map(|((_, triangle), cell)| Light {
            triangle: *triangle,
            threshold: cell.threshold,
            alias: cell.alias,
            unused: 0,
        })
        .collect();
    Ok((lights, area))
}

fn pack_material(material: &scene::Material, headers: &[u32]) -> Material {
    Material {
        kd: material.kd.to_array(),
        surface: if material.is_emitter() {
            SURFACE_EMITTER
        } else {
            match material.surface {
                Surface::Glossy => SURFACE_GLOSSY,
                Surface::Mirror => SURFACE_MIRROR,
                Surface::Refractive => SURFACE_REFRACTIVE,
                Surface::Dielectric => SURFACE_DIELECTRIC,
            }
        },
        ks: material.ks.to_array(),
        ns: material.ns,
        ke: material.ke.to_array(),
        ni: material.ni,
        tf: material.tf.to_array(),
        map_kd: material.map_kd.map_or(0, |texture| headers[texture as usize] + 1),
    }
}

fn pack_normals(mesh: &scene::Mesh) -> Vec<Normals> {
    mesh.triangles
        .iter()
        .map(|triangle| {
            if triangle.normals[0] == scene::NONE {
                return Normals { corners: [0; 3], present: 0 };
            }
            Normals { corners: triangle.normals.map(|i| encode_normal(mesh.normals[i as usize])), present: 1 }
        })
        .collect()
}

/// Octahedral encoding, 16 bits a coordinate. (Cigolle et al. 2014)
fn encode_normal(n: Vec3) -> u32 {
    let n = n / (n.x.abs() + n.y.abs() + n.z.abs());
    let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if n.z >= 0.0 { (n.x, n.y) } else { ((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y)) };
    let snorm = |x: f32| u32::from((x.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    snorm(x) | snorm(y) << 16
}

fn pack_coordinates(mesh: &scene::Mesh) -> Vec<Vec2> {
    let corner = |&i: &u32| if i == scene::NONE { Vec2::ZERO } else { mesh.uvs[i as usize] };
    mesh.triangles.iter().flat_map(|triangle| triangle.uvs.iter().map(corner).collect::<Vec<_>>()).collect()
}

/// All images in one buffer, and where each begins.
fn pack_textures(textures: &[scene::Texture]) -> (Vec<[u32; 2]>, Vec<u32>) {
    let mut words = Vec::new();
    let mut headers = Vec::new();
    for texture in textures {
        headers.push(words.len() as u32);
        words.push([texture.width, texture.height]);
        words.extend(bytemuck::cast_slice::<_, [u32; 2]>(&texture.texels));
    }
    (words, headers)
}

/// Texels with the probability that light sampling picks each: in proportion to the luminance
/// of the bilinear image over the texel, times its solid angle.
fn pack_environment(map: &EnvironmentMap) -> Result<(Vec<EnvironmentTexel>, Vec<AliasCell>), PrepareError> {
    let (width, height) = (map.width as usize, map.height as usize);
    if map.radiance.len() > MAX_CELLS {
        return Err(PrepareError::TooManyTexels(map.radiance.len()));
    }
    // Rec. 709 luminance; the mean keeps a weight above zero for colours that have none.
    let brightness = |x: usize, y: usize| {
        let c = map.radiance[y * width + x].as_dvec3();
        c.dot(DVec3::new(0.2126, 0.7152, 0.0722)) + 1e-3 * c.element_sum()
    };
    // A bilinear image integrated over a texel: weights 1/8, 3/4, 1/8 in each direction.
    let across = |x: usize, y: usize| {
        0.125 * (brightness((x + width - 1) % width, y) + brightness((x + 1) % width, y)) + 0.75 * brightness(x, y)
    };
    let weights: Vec<f64> = (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let mean =
                0.125 * (across(x, y.saturating_sub(1)) + across(x, (y + 1).min(height - 1))) + 0.75 * across(x, y);
            let angle = |row: usize| std::f64::consts::PI * row as f64 / height as f64;
            mean * (angle(y).cos() - angle(y + 1).cos())
        })
        .collect();
    let total: f64 = weights.iter().sum();
    let texels = map
        .radiance
        .iter()
        .zip(&weights)
        .map(|(radiance, weight)| EnvironmentTexel {
            radiance: radiance.to_array(),
            probability: (weight / total) as f32,
        })
        .collect();
    Ok((texels, alias_table(&weights)))
}

impl PreparedScene {
    /// Bytes of the scene's buffers on the device, by role; empty ones are left out.
    pub fn buffer_bytes(&self) -> Vec<(&'static str, u64)> {
        let all: [(&'static str, usize); 9] = [
            ("nodes", size_of_val(&self.bvh.texels[..])),
            ("triangles", size_of_val(&self.triangles[..])),
            ("materials", size_of_val(&self.materials[..])),
            ("lights", size_of_val(&self.lights[..])),
            ("normals", size_of_val(&self.normals[..])),
            ("texture_coordinates", size_of_val(&self.texture_coordinates[..])),
            ("textures", size_of_val(&self.textures[..])),
            ("environment", size_of_val(&self.environment[..])),
            ("environment_aliases", size_of_val::<[layout::AliasCell]>(&self.environment_aliases)),
        ];
        all.into_iter().filter(|(_, bytes)| *bytes > 0).map(|(name, bytes)| (name, bytes as u64)).collect()
    }
}
