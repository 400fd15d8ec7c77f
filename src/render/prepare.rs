//! The scene as the kernels read it: normalised, in leaf order, with only what it requires.

use std::collections::HashSet;
use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3};
use thiserror::Error;

use super::defaults::Defaults;
use super::plan::{Plan, SceneLevels};
use super::settings::{Offsets, PathState, RouletteMode, Settings, ShadowRays, Sort};
use crate::alias::{AliasCell, alias_table};
use crate::bvh::{self, Bvh, BvhKind};
use crate::constants::*;
use crate::layout::{EnvironmentSplit, EnvironmentTexel, Frame, Light, Material, Normals, Triangle};
use crate::scene::{self, Environment, EnvironmentMap, Integrator, Sampler, Scene, Surface};
use crate::trace::Stages;

/// A scene that the kernels cannot hold.
#[derive(Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum PrepareError {
    #[error("the scene has {0} triangles and a BVH can address {max}; use a smaller scene", max = bvh::MAX_TRIANGLES)]
    TooManyTriangles(usize),
    #[error("the scene has {0} triangles and a list holds at most {max}; use another --bvh", max = bvh::MAX_LISTED)]
    TooManyListed(usize),
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
    /// How light sampling finds a texel, from the whole image down.
    pub environment_splits: Vec<EnvironmentSplit>,
    /// What the scene needs of the kernels.
    pub features: Features,
    /// How its positions came from the world's.
    pub normalisation: Normalisation,
    /// What the kernels' radiance is of the scene's, a power of two.
    pub radiance_scale: f64,
    frame: Frame,
}

/// What a scene needs: all else is left out of its kernels. Materials count where a triangle has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Features {
    /// One of `ENVIRONMENT_*`.
    pub environment: u32,
    /// Some triangle emits.
    pub lights: bool,
    /// Some material has a diffuse or Phong part.
    pub glossy: bool,
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
    /// The camera is so far away that its rays start nearer to the scene.
    pub distance: bool,
}

impl Features {
    /// Every one.
    pub const ALL: Self = Self {
        environment: ENVIRONMENT_ANY,
        lights: true,
        glossy: true,
        phong: true,
        mirror: true,
        refractive: true,
        dielectric: true,
        textures: true,
        normals: true,
        lens: true,
        distance: true,
    };

    fn of(scene: &Scene, distance: bool) -> Self {
        let used = used_materials(scene);
        let any = |test: &dyn Fn(&scene::Material) -> bool| {
            scene.materials.iter().zip(&used).any(|(material, used)| *used && test(material))
        };
        let is = |surface| any(&|m| !m.is_emitter() && m.surface == surface);
        Self {
            environment: match scene.environment {
                Environment::Black => ENVIRONMENT_BLACK,
                Environment::Constant(_) => ENVIRONMENT_CONSTANT,
                Environment::LatLong(_) => ENVIRONMENT_LAT_LONG,
            },
            lights: any(&|m| m.is_emitter()),
            glossy: is(Surface::Glossy),
            phong: any(&|m| !m.is_emitter() && m.surface == Surface::Glossy && m.specular.max_element() > 0.0),
            mirror: is(Surface::Mirror),
            refractive: is(Surface::Refractive),
            dielectric: is(Surface::Dielectric),
            // A lamp shows no texture.
            textures: any(&|m| !m.is_emitter() && m.diffuse_map.is_some()),
            normals: scene.mesh.triangles.iter().any(|t| t.normals[0] != scene::NONE),
            lens: scene.camera.aperture > 0.0,
            distance,
        }
    }

    fn scatters(&self) -> bool {
        self.glossy || self.mirror || self.refractive || self.dielectric
    }
}

/// Whether some triangle has a material, for each.
fn used_materials(scene: &Scene) -> Vec<bool> {
    let mut used = vec![false; scene.materials.len()];
    for triangle in &scene.mesh.triangles {
        used[triangle.material as usize] = true;
    }
    used
}

/// What a render needs of its kernels: features of the scene, and of the settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// What the scene has.
    pub features: Features,
    /// Paths go on from surfaces.
    pub scatters: bool,
    /// Paths end at a bounce.
    pub bounded: bool,
    /// Paths may end at any vertex.
    pub roulette: bool,
    /// Vertices send shadow rays.
    pub shadows: bool,
    /// Entries of the traversal stack.
    pub stack_size: u32,
}

/// Entries of the traversal stack of kernels that know nothing of the BVH's depth: it is rarely above.
const ANY_STACK_SIZE: u32 = 64;

/// The power of two that puts the middle of the brightest and the dimmest light at 1, so that the sums and squares of
/// samples stay clear of both ends of `f32`. It rounds nothing.
fn radiance_scale(scene: &Scene) -> f64 {
    let lamps = scene.materials.iter().zip(used_materials(scene)).filter(|(_, used)| *used).map(|(m, _)| m.emission);
    let sky = match &scene.environment {
        Environment::Black => Vec3::ZERO,
        Environment::Constant(radiance) => *radiance,
        Environment::LatLong(map) => map.radiance.iter().fold(Vec3::ZERO, |peak, texel| peak.max(*texel)),
    };
    let peaks = lamps.chain([sky]).map(|light| f64::from(light.max_element())).filter(|peak| *peak > 0.0);
    let (low, high) = peaks.fold((f64::INFINITY, 0.0_f64), |(low, high), peak| (low.min(peak), high.max(peak)));
    if high > 0.0 { (-0.5 * (low.log2() + high.log2())).round().exp2() } else { 1.0 }
}

/// Subnormal numbers as zeros: devices differ in what they make of them.
fn normal_or_zero(v: Vec3) -> Vec3 {
    Vec3::from_array(v.to_array().map(|x| if x.is_subnormal() { 0.0 } else { x }))
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
    /// [`PreparedScene::with_bvh`] of eight children a node.
    ///
    /// # Errors
    /// When the scene is larger than an index can tell.
    pub fn new(scene: &Scene) -> Result<Self, PrepareError> {
        Self::with_bvh(scene, BvhKind::Cwbvh)
    }

    /// [`PreparedScene::with_bvh`] of the kind that the settings ask for or else suits the device.
    ///
    /// # Errors
    /// When the scene is larger than an index can tell.
    pub fn for_device(scene: &Scene, settings: &Settings, defaults: &Defaults) -> Result<Self, PrepareError> {
        Self::in_stages(scene, settings, defaults, &Stages::default())
    }

    /// As [`PreparedScene::for_device`]; notes its stages.
    ///
    /// # Errors
    /// As [`PreparedScene::for_device`].
    pub fn in_stages(
        scene: &Scene,
        settings: &Settings,
        defaults: &Defaults,
        stages: &Stages,
    ) -> Result<Self, PrepareError> {
        Self::lay_out(scene, defaults.bvh(settings, scene.mesh.triangles.len()), stages)
    }

    /// Builds a BVH of that kind and lays the scene out.
    ///
    /// # Errors
    /// When the scene is larger than an index can tell.
    pub fn with_bvh(scene: &Scene, kind: BvhKind) -> Result<Self, PrepareError> {
        Self::lay_out(scene, kind, &Stages::default())
    }

    fn lay_out(scene: &Scene, kind: BvhKind, stages: &Stages) -> Result<Self, PrepareError> {
        let laying_out = stages.begin("lay out scene");
        let mesh = &scene.mesh;
        if mesh.triangles.len() > bvh::MAX_TRIANGLES {
            return Err(PrepareError::TooManyTriangles(mesh.triangles.len()));
        }
        let normalisation = Normalisation::of(scene);
        let points: Vec<Vec3> =
            mesh.positions.iter().map(|p| normal_or_zero(normalisation.point(*p).as_vec3())).collect();
        let corners: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|t| t.positions.map(|i| points[i as usize])).collect();
        if kind == BvhKind::List && corners.len() > bvh::MAX_LISTED {
            return Err(PrepareError::TooManyListed(corners.len()));
        }
        drop(laying_out);
        let building = stages.begin("build BVH");
        let bvh = Bvh::build(kind, &corners);
        drop(building);
        let _laying_out = stages.begin("lay out scene");
        let (nodes, max) = (bvh.node_places(), kind.max_nodes());
        if nodes > max {
            return Err(PrepareError::TooManyNodes { nodes, max });
        }
        let mut triangles: Vec<Triangle> = bvh
            .order
            .iter()
            .map(|&original| {
                let [v0, v1, v2] = corners[original as usize].map(|v| v.to_array());
                let material = mesh.triangles[original as usize].material;
                Triangle { v0, original, v1, material, v2, light_area: 0.0 }
            })
            .collect();
        let radiance_scale = radiance_scale(scene);
        let lamps = Lamps::of(scene, &bvh, &corners)?;
        for (light, area) in lamps.cells.iter().zip(&lamps.areas) {
            triangles[light.triangle as usize].light_area = *area as f32;
        }

        let mut frame = camera_frame(&scene.camera, &normalisation, &corners);
        let features = Features::of(scene, frame.camera_distance > 0.0);
        let (textures, headers) = if features.textures { pack_textures(scene) } else { Default::default() };
        let sky = match &scene.environment {
            Environment::LatLong(map) => Sky::of(map, radiance_scale)?,
            Environment::Constant(radiance) => Sky { power: 4.0 * PI * brightness(*radiance), ..Sky::default() },
            Environment::Black => Sky::default(),
        };
        frame.light_count = lamps.cells.len() as u32;
        let (low, high) = scene.bounds();
        frame.sky_probability =
            sky_probability(features, &lamps, &sky, normalisation.point(high) - normalisation.point(low));
        frame.environment = features.environment;
        match &scene.environment {
            Environment::Constant(radiance) => {
                frame.environment_radiance = scaled(*radiance, radiance_scale);
            }
            Environment::LatLong(map) => {
                (frame.environment_width, frame.environment_height) = (map.width, map.height);
            }
            Environment::Black => {}
        }
        Ok(Self {
            bvh,
            triangles,
            materials: scene.materials.iter().map(|m| pack_material(m, &headers, radiance_scale)).collect(),
            lights: lamps.cells,
            normals: if features.normals { pack_normals(mesh) } else { Vec::new() },
            texture_coordinates: if features.textures { pack_coordinates(mesh) } else { Vec::new() },
            textures,
            environment: sky.texels,
            environment_splits: sky.splits,
            features,
            normalisation,
            radiance_scale,
            frame,
        })
    }

    /// Corners of the triangles in the scene's order, in normalised space.
    pub fn corners(&self) -> Vec<[[f32; 3]; 3]> {
        let mut corners = vec![[[0.0; 3]; 3]; self.triangles.len()];
        for Triangle { v0, v1, v2, original, .. } in &self.triangles {
            corners[*original as usize] = [*v0, *v1, *v2];
        }
        corners
    }

    /// The uniform block of a render with `path_capacity` slots.
    pub fn frame(&self, settings: &Settings, path_capacity: u32) -> Frame {
        let aspect = settings.width as f32 / settings.height as f32;
        // The BRDF's own samples find a constant sky as well as light samples do, which are for the lamps then.
        let found_anyway = settings.integrator == Integrator::Mis && self.features.environment == ENVIRONMENT_CONSTANT;
        let sky_probability = match self.frame.sky_probability {
            both if found_anyway && both < 1.0 => both.min(0.125),
            shared => shared,
        };
        Frame {
            sky_probability,
            // Until here, right is as long as up.
            camera_right: self.frame.camera_right.map(|c| c * aspect),
            roulette: settings.roulette as f32,
            max_bounces: settings.max_bounces.unwrap_or(UNBOUNDED),
            radiance_clamp: (settings.clamp.unwrap_or_default() * self.radiance_scale) as f32,
            roulette_from: settings.roulette_from,
            seed: settings.seed,
            width: settings.width,
            height: settings.height,
            path_capacity,
            ..self.frame
        }
    }

    /// Levels that kernels go down.
    pub fn levels(&self) -> SceneLevels {
        let sky = self.frame.environment_width.max(self.frame.environment_height).max(1);
        let listed = self.bvh.kind == BvhKind::List;
        let bvh_tests = if listed { 0 } else { self.bvh.sah_cost.ceil() as u32 };
        SceneLevels { bvh: self.bvh.depth, bvh_tests, sky: sky.next_power_of_two().ilog2() }
    }

    /// Entries of the traversal stack: each inner node on the way down leaves one at most. Of a wide
    /// tree it is the siblings of the node that comes next, and the last level has none.
    fn stack_size(&self) -> u32 {
        match self.bvh.kind {
            BvhKind::List => 0,
            BvhKind::Bvh2 => self.bvh.depth,
            BvhKind::Bvh4 | BvhKind::Cwbvh => self.bvh.depth - 1,
        }
    }

    /// What the kernels of a render are built for: what it needs or, without specialization, all there is.
    pub fn needs(&self, settings: &Settings) -> Needs {
        if settings.specialize {
            Needs::of(self.features, settings, self.stack_size())
        } else {
            Needs { stack_size: self.stack_size().max(ANY_STACK_SIZE), ..Needs::ALL }
        }
    }

    /// Specialization constants by id.
    pub fn specialization(&self, settings: &Settings, plan: &Plan) -> Vec<u32> {
        let mut constants = self.needs(settings).specialization(settings, plan, self.bvh.kind);
        if self.bvh.kind == BvhKind::List {
            constants[SPEC_LISTED_COUNT as usize] = self.triangles.len() as u32;
            constants.resize(SPEC_LISTED_TRIANGLES as usize, 0);
            let vertices = self.triangles.iter().flat_map(|t| [t.v0, t.v1, t.v2]);
            constants.extend(vertices.flatten().map(f32::to_bits));
        }
        constants
    }
}

impl Needs {
    /// Everything, but for the depth of a BVH.
    pub const ALL: Self = Self {
        features: Features::ALL,
        scatters: true,
        bounded: true,
        roulette: true,
        shadows: true,
        stack_size: ANY_STACK_SIZE,
    };

    /// What a render needs of a scene of such features, whose BVH asks for such a stack.
    pub fn of(features: Features, settings: &Settings, stack_size: u32) -> Self {
        let scatters = features.scatters() && settings.max_bounces != Some(0);
        let lit = features.lights || features.environment != ENVIRONMENT_BLACK;
        Self {
            features,
            scatters,
            bounded: settings.max_bounces.is_some(),
            roulette: settings.roulette > 0.0 || settings.roulette_mode == RouletteMode::Throughput,
            shadows: scatters && features.glossy && lit && settings.integrator != Integrator::Implicit,
            stack_size,
        }
    }

    /// Specialization constants by id.
    pub fn specialization(&self, settings: &Settings, plan: &Plan, bvh: BvhKind) -> Vec<u32> {
        let Self { features, scatters, bounded, roulette, shadows, stack_size } = *self;
        let Features {
            environment,
            lights,
            glossy,
            phong,
            mirror,
            refractive,
            dielectric,
            textures,
            normals,
            lens,
            distance,
        } = features;
        let mut constants = vec![0; SPEC_COUNT as usize];
        for (id, value) in [
            (SPEC_WORKGROUP_SIZE, plan.workgroup_size),
            (SPEC_STACK_SIZE, stack_size),
            (
                SPEC_INTEGRATOR,
                match settings.integrator {
                    Integrator::Implicit => INTEGRATOR_IMPLICIT,
                    Integrator::Explicit => INTEGRATOR_EXPLICIT,
                    Integrator::Mis => INTEGRATOR_MIS,
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
            (SPEC_HAS_DISTANCE, distance.into()),
            (SPEC_HAS_ROULETTE, roulette.into()),
            (SPEC_HAS_GLOSSY, glossy.into()),
            (SPEC_SCATTERS, scatters.into()),
            (SPEC_BOUNDED, bounded.into()),
            (SPEC_CASTS_SHADOWS, shadows.into()),
            (SPEC_SHADING_COST, settings.shading_cost),
            (SPEC_MATERIAL_BRANCHES, settings.material_branches),
            (SPEC_SORTED, (settings.sort == Sort::Material).into()),
            (SPEC_DEFERS_SHADOW_RAYS, (settings.shadow_rays == ShadowRays::Deferred).into()),
            (SPEC_HALF_STATE, (settings.path_state == PathState::F16).into()),
            (SPEC_FIXED_OFFSETS, (settings.offsets == Offsets::Fixed).into()),
            (SPEC_BVH_WIDTH, bvh.width()),
            (SPEC_SOBOL, (settings.sampler == Sampler::Sobol).into()),
            (SPEC_ROULETTE_BY_THROUGHPUT, (settings.roulette_mode == RouletteMode::Throughput).into()),
            (SPEC_CLAMPS, settings.clamp.is_some().into()),
            (SPEC_REGENERATES, (plan.paths_per_invocation > 1).into()),
        ] {
            constants[id as usize] = value;
        }
        constants
    }

    /// Bytes of so many traversal stacks, beyond what stays in registers.
    pub fn stack_bytes(&self, stacks: u64) -> u64 {
        // Full registers give a block away before they are asked for room.
        let blocks = match self.stack_size.checked_sub(STACK_REGISTERS) {
            None | Some(0) => 0,
            Some(rest) => 1 + rest / STACK_BLOCK,
        };
        u64::from(blocks) * stacks * u64::from(4 * STACK_BLOCK)
    }
}

/// The eye, or where it lies in a surface but for rounding, a point further along its view: from within, some rays would
/// find that surface in front of them and some would not.
fn clear_of_surfaces(eye: DVec3, forward: DVec3, corners: &[[Vec3; 3]]) -> DVec3 {
    // Some roundings of the coordinates at hand.
    const TOUCH: f64 = 4.8e-7;
    let touch = |corners: &[Vec3; 3]| {
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let touch = TOUCH * low.abs().max(high.abs()).max(eye.abs()).max_element();
        let near = eye.cmpge(low - touch).all() && eye.cmple(high + touch).all();
        let off = || (b - a).cross(c - a).normalize_or_zero().dot(eye - a).abs();
        (near && off() <= touch).then_some(touch)
    };
    corners.iter().find_map(touch).map_or(eye, |touch| eye + 8.0 * touch * forward)
}

/// Radius of the ball about the origin that holds any normalised scene.
const SCENE_RADIUS: f64 = 1.75;
/// Distance of an eye from the middle of a scene beyond which rays start nearer to the scene, normalised units: until
/// there an eye has about as many digits behind the point as the scene.
const NEAR_EYE: f64 = 16.0;

/// How far before the eye, along the view axis, the plane lies that the camera's rays start from. No surface is nearer.
fn ray_start(eye: DVec3, forward: DVec3) -> f64 {
    if eye.length() <= NEAR_EYE {
        return 0.0;
    }
    (-eye.dot(forward) - SCENE_RADIUS).max(0.0)
}

/// Camera vectors for a square image: the session scales `camera_right` by the aspect.
fn camera_frame(camera: &scene::Camera, normalisation: &Normalisation, corners: &[[Vec3; 3]]) -> Frame {
    let forward = (camera.target - camera.eye).normalize();
    let mut right = forward.cross(camera.up).normalize_or_zero();
    if right == DVec3::ZERO {
        // Looking straight up or down: any axis that is not the view's will do for up.
        right = forward.cross(forward.any_orthonormal_vector()).normalize();
    }
    let up = right.cross(forward);
    let half_height = libm::tan(0.5 * camera.vfov.to_radians());
    let mut frame: Frame = bytemuck::Zeroable::zeroed();
    let eye = clear_of_surfaces(normalisation.point(camera.eye), forward, corners);
    let distance = ray_start(eye, forward);
    frame.camera_eye = (eye + distance * forward).as_vec3().to_array();
    frame.camera_distance = distance as f32;
    frame.camera_forward = forward.as_vec3().to_array();
    frame.camera_right = (right * half_height).as_vec3().to_array();
    frame.camera_up = (up * half_height).as_vec3().to_array();
    frame.lens_radius = normalisation.length(camera.aperture);
    frame.focus_distance = normalisation.length(camera.focus);
    frame
}

/// How bright a radiance is: its luminance by Rec. 709. A part of the sum keeps it above zero for colours
/// that have none.
fn brightness(radiance: Vec3) -> f64 {
    let c = radiance.as_dvec3();
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722)) + 1e-3 * c.element_sum()
}

/// Emitting triangles, as light samples pick them.
#[derive(Debug, Default)]
struct Lamps {
    /// Cells of the alias table, in the scene's order.
    cells: Vec<Light>,
    /// Area of each over the probability of its pick, normalised units squared.
    areas: Vec<f64>,
    /// Brightness times area of all, times pi.
    power: f64,
}

impl Lamps {
    /// Share of the picks that go by power. The others go by area, so that a lamp of little power still
    /// has samples where it is near, or nothing else shines.
    const BY_POWER: f64 = 0.9;

    fn of(scene: &Scene, bvh: &Bvh, corners: &[[Vec3; 3]]) -> Result<Self, PrepareError> {
        let material = |original: u32| &scene.materials[scene.mesh.triangles[original as usize].material as usize];
        let emits = |original: u32| material(original).is_emitter();
        let mut lights: Vec<(u32, u32)> = bvh
            .order
            .iter()
            .enumerate()
            .filter(|(_, original)| emits(**original))
            .map(|(place, original)| (*original, place as u32))
            .collect();
        // The scene's order, so that random numbers pick the same light whatever the BVH is.
        lights.sort_unstable();
        let originals = || lights.iter().map(|(original, _)| *original);
        let areas: Vec<f64> = originals()
            .map(|original| {
                let [a, b, c] = corners[original as usize].map(|v| v.as_dvec3());
                0.5 * (b - a).cross(c - a).length()
            })
            .collect();
        let brightnesses: Vec<f64> = originals().map(|original| brightness(material(original).emission)).collect();
        let area: f64 = areas.iter().sum();
        let power: f64 = areas.iter().zip(&brightnesses).map(|(area, brightness)| area * brightness).sum();
        if lights.len() > MAX_CELLS {
            return Err(PrepareError::TooManyLights(lights.len()));
        }
        if power == 0.0 {
            return Ok(Self::default());
        }
        // Probability of a lamp's pick over its area.
        let density = |brightness: &f64| Self::BY_POWER * brightness / power + (1.0 - Self::BY_POWER) / area;
        let densities: Vec<f64> = brightnesses.iter().map(density).collect();
        let weights: Vec<f64> = areas.iter().zip(&densities).map(|(area, density)| area * density).collect();
        let cell = |((_, triangle), cell): (&(u32, u32), AliasCell)| Light {
            triangle: *triangle,
            threshold: cell.threshold,
            alias: cell.alias,
            unused: 0,
        };
        Ok(Self {
            cells: lights.iter().zip(alias_table(&weights)).map(cell).collect(),
            areas: densities.iter().map(|density| 1.0 / density).collect(),
            power: PI * power,
        })
    }
}

/// Probability that a light sample goes to the sky: its share of the power that the scene receives, were
/// half of the sky hidden, though lamps and sky get a tenth at least. `size` is that of the scene's bounds.
fn sky_probability(features: Features, lamps: &Lamps, sky: &Sky, size: DVec3) -> f32 {
    let shines = features.environment != ENVIRONMENT_BLACK;
    if !shines || lamps.cells.is_empty() {
        return if shines { 1.0 } else { 0.0 };
    }
    // The sky sends its light through the disk of the sphere about the bounds.
    let received = 0.5 * sky.power * PI * 0.25 * size.length_squared();
    let share = (received / (received + lamps.power)).clamp(0.1, 0.9);
    // Exact in the 24 bits of a random number.
    ((share * 256.0).round() / 256.0) as f32
}

/// Radiance in the kernels' unit.
fn scaled(radiance: Vec3, radiance_scale: f64) -> [f32; 3] {
    (radiance.as_dvec3() * radiance_scale).as_vec3().to_array()
}

/// Largest Phong exponent of the kernels. Such a lobe is a millionth of a radian wide, about as wide as the rounding of a
/// direction: a larger exponent would show nothing but that.
const MAX_EXPONENT: f32 = 1e12;

fn pack_material(material: &scene::Material, headers: &[u32], radiance_scale: f64) -> Material {
    Material {
        kd: material.diffuse.to_array(),
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
        ks: material.specular.to_array(),
        ns: material.exponent.min(MAX_EXPONENT),
        ke: scaled(material.emission, radiance_scale),
        ni: material.ior,
        tf: material.transmission.to_array(),
        map_kd: material.diffuse_map.map_or(0, |texture| headers[texture as usize] + 1),
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

/// All images that some triangle shows in one buffer, and where each begins.
fn pack_textures(scene: &Scene) -> (Vec<[u32; 2]>, Vec<u32>) {
    let shown: HashSet<u32> = (scene.materials.iter().zip(used_materials(scene)))
        .filter_map(|(material, used)| material.diffuse_map.filter(|_| used))
        .collect();
    let mut words = Vec::new();
    let mut headers = Vec::new();
    for (texture, number) in scene.textures.iter().zip(0..) {
        headers.push(words.len() as u32);
        if shown.contains(&number) {
            words.push([texture.width, texture.height]);
            words.extend(bytemuck::cast_slice::<_, [u32; 2]>(&texture.texels));
        }
    }
    (words, headers)
}

/// The environment, as light samples pick directions of it.
#[derive(Debug, Default)]
struct Sky {
    /// Texels of a lat-long image with the probability of each: in proportion to the brightness of the
    /// bilinear image over the texel, times its solid angle.
    texels: Vec<EnvironmentTexel>,
    /// See [`splits`].
    splits: Vec<EnvironmentSplit>,
    /// Brightness over all directions.
    power: f64,
}

impl Sky {
    fn of(map: &EnvironmentMap, radiance_scale: f64) -> Result<Self, PrepareError> {
        let (width, height) = (map.width as usize, map.height as usize);
        if map.radiance.len() > MAX_CELLS {
            return Err(PrepareError::TooManyTexels(map.radiance.len()));
        }
        let brightness = |x: usize, y: usize| brightness(map.radiance[y * width + x]);
        // A bilinear image integrated over a texel: weights 1/8, 3/4, 1/8 in each direction.
        let across = |x: usize, y: usize| {
            0.125 * (brightness((x + width - 1) % width, y) + brightness((x + 1) % width, y)) + 0.75 * brightness(x, y)
        };
        let weights: Vec<f64> = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let mean =
                    0.125 * (across(x, y.saturating_sub(1)) + across(x, (y + 1).min(height - 1))) + 0.75 * across(x, y);
                let angle = |row: usize| PI * row as f64 / height as f64;
                mean * (libm::cos(angle(y)) - libm::cos(angle(y + 1)))
            })
            .collect();
        let total: f64 = weights.iter().sum();
        let texels = map
            .radiance
            .iter()
            .zip(&weights)
            .map(|(radiance, weight)| EnvironmentTexel {
                radiance: scaled(*radiance, radiance_scale),
                probability: (weight / total) as f32,
            })
            .collect();
        Ok(Self { texels, splits: splits(&weights, width), power: 2.0 * PI / width as f64 * total })
    }
}

/// How an image with such weights of its texels, in rows of `width`, is halved to find a texel by its weight: level by
/// level, the block that holds it all first, then blocks of half the side, in rows, those that hold texels. A block of
/// the last level is two by two texels.
fn splits(weights: &[f64], width: usize) -> Vec<EnvironmentSplit> {
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole) as f32 } else { 0.5 };
    let mut levels = Vec::new();
    let (mut sums, mut size) = (weights.to_vec(), [width, weights.len() / width]);
    while size != [1, 1] {
        let sum = |x: usize, y: usize| if x < size[0] && y < size[1] { sums[y * size[0] + x] } else { 0.0 };
        let blocks = size.map(|side| side.div_ceil(2));
        let corners = (0..blocks[1]).flat_map(|y| (0..blocks[0]).map(move |x| [2 * x, 2 * y]));
        let (level, halved): (Vec<_>, Vec<_>) = corners
            .map(|[x, y]| {
                let [upper, lower] = [y, y + 1].map(|y| [sum(x, y), sum(x + 1, y)]);
                let [up, down] = [upper, lower].map(|[left, right]| left + right);
                let left = [share(upper[0], up), share(lower[0], down)];
                (EnvironmentSplit { upper: share(up, up + down), left, unused: 0 }, up + down)
            })
            .unzip();
        levels.push(level);
        (sums, size) = (halved, blocks);
    }
    levels.into_iter().rev().flatten().collect()
}

/// Data of a scene for a buffer of its name on the device.
#[derive(Debug, Clone, Copy)]
pub struct SceneBuffer<'a> {
    /// Name of the GLSL variable.
    pub name: &'static str,
    /// Bytes of the words that kernels read: 8 or 16.
    pub texel_bytes: u64,
    /// Its contents; without any it is zeros.
    pub contents: &'a [u8],
    /// Bytes, at least a word.
    pub size: u64,
}

impl PreparedScene {
    /// The scene's buffers. What the scene has no data for is one word or, without specialization, as
    /// long as if each triangle had some.
    pub fn buffers(&self, specialize: bool) -> [SceneBuffer<'_>; 9] {
        let triangles = if specialize { 1 } else { self.triangles.len() as u64 };
        fn buffer<'a>(name: &'static str, texel_bytes: u64, contents: &'a [u8], least: u64) -> SceneBuffer<'a> {
            SceneBuffer { name, texel_bytes, contents, size: (contents.len() as u64).max(least) }
        }
        [
            buffer("nodes", 16, bytemuck::cast_slice(&self.bvh.texels), 16),
            buffer("triangles", 16, bytemuck::cast_slice(&self.triangles), 16),
            buffer("materials", 16, bytemuck::cast_slice(&self.materials), 16),
            buffer("lights", 16, bytemuck::cast_slice(&self.lights), 16),
            buffer("normals", 16, bytemuck::cast_slice(&self.normals), 16 * triangles),
            buffer("texture_coordinates", 8, bytemuck::cast_slice(&self.texture_coordinates), 3 * 8 * triangles),
            buffer("textures", 8, bytemuck::cast_slice(&self.textures), 8),
            buffer("environment", 16, bytemuck::cast_slice(&self.environment), 16),
            buffer("environment_splits", 16, bytemuck::cast_slice(&self.environment_splits), 16),
        ]
    }
}
