//! What a scene has and what a render needs of its kernels, and so the values of the specialization constants.

use super::super::plan::Plan;
use crate::bvh::{Bvh, BvhKind};
use crate::constants::*;
use crate::scene::{self, Environment, Scene, Surface};
use crate::settings::{Integrator, Offsets, PathState, RouletteMode, Sampler, Settings, ShadowRays, Sort};

/// What a scene has: kernels leave out all else. A material counts only if some triangle has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Features {
    /// One of `ENVIRONMENT_*`.
    pub environment: u32,
    /// Some triangle emits.
    pub lights: bool,
    /// Some material is a Phong BRDF: Lambert plus lobe.
    pub phong: bool,
    /// The lobe of some Phong BRDF is above zero.
    pub phong_lobes: bool,
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
        phong: true,
        phong_lobes: true,
        mirror: true,
        refractive: true,
        dielectric: true,
        textures: true,
        normals: true,
        lens: true,
        distance: true,
    };

    pub(super) fn of(scene: &Scene, distance: bool) -> Self {
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
            phong: is(Surface::Glossy),
            phong_lobes: any(&|m| !m.is_emitter() && m.surface == Surface::Glossy && m.specular.max_element() > 0.0),
            mirror: is(Surface::Mirror),
            refractive: is(Surface::Refractive),
            dielectric: is(Surface::Dielectric),
            // An area light shows no texture.
            textures: any(&|m| !m.is_emitter() && m.diffuse_map.is_some()),
            normals: scene.mesh.triangles.iter().any(|t| t.normals[0] != scene::NONE),
            lens: scene.camera.aperture > 0.0,
            distance,
        }
    }

    fn scatters(&self) -> bool {
        self.phong || self.mirror || self.refractive || self.dielectric
    }
}

/// Whether some triangle has a material, for each.
pub(super) fn used_materials(scene: &Scene) -> Vec<bool> {
    let mut used = vec![false; scene.materials.len()];
    for triangle in &scene.mesh.triangles {
        used[triangle.material as usize] = true;
    }
    used
}

/// What a render needs of its kernels, by its scene and its settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// What the scene has.
    pub features: Features,
    /// Paths scatter at surfaces.
    pub scatters: bool,
    /// Paths end at `max_bounces`.
    pub bounded: bool,
    /// Russian roulette may end paths.
    pub roulette: bool,
    /// Vertices may send shadow rays.
    pub shadows: bool,
    /// Entries of the traversal stack.
    pub stack_size: u32,
}

/// Entries of the traversal stack of kernels for any scene: few BVHs are deeper.
const ANY_STACK_SIZE: u32 = 64;

impl Needs {
    /// Everything, with a stack for most BVHs.
    pub const ALL: Self = Self {
        features: Features::ALL,
        scatters: true,
        bounded: true,
        roulette: true,
        shadows: true,
        stack_size: ANY_STACK_SIZE,
    };

    /// What a render needs, by the features of its scene and the stack of its BVH.
    pub fn of(features: Features, settings: &Settings, stack_size: u32) -> Self {
        let scatters = features.scatters() && settings.max_bounces != Some(0);
        let lit = features.lights || features.environment != ENVIRONMENT_BLACK;
        Self {
            features,
            scatters,
            bounded: settings.max_bounces.is_some(),
            roulette: settings.roulette > 0.0 || settings.roulette_mode == RouletteMode::Throughput,
            shadows: scatters && features.phong && lit && settings.integrator != Integrator::Implicit,
            stack_size,
        }
    }

    /// What kernels are built for, with the settings and the BVH of a render.
    pub fn specialization(&self, settings: &Settings, plan: &Plan, bvh: &Bvh) -> Specialization {
        let Self { features, scatters, bounded, roulette, shadows, stack_size } = *self;
        let Features {
            environment,
            lights,
            phong,
            phong_lobes,
            mirror,
            refractive,
            dielectric,
            textures,
            normals,
            lens,
            distance,
        } = features;
        Specialization {
            workgroup_size: plan.workgroup_size,
            stack_size,
            bvh_width: bvh.kind.width(),
            listed_count: if bvh.kind == BvhKind::List { bvh.order.len() as u32 } else { 0 },
            integrator: match settings.integrator {
                Integrator::Implicit => INTEGRATOR_IMPLICIT,
                Integrator::Explicit => INTEGRATOR_EXPLICIT,
                Integrator::Mis => INTEGRATOR_MIS,
            },
            sobol: settings.sampler == Sampler::Sobol,
            environment,
            has_lights: lights,
            has_phong: phong,
            has_phong_lobes: phong_lobes,
            has_mirror: mirror,
            has_refractive: refractive,
            has_dielectric: dielectric,
            has_textures: textures,
            has_normals: normals,
            has_lens: lens,
            has_distance: distance,
            scatters,
            bounded,
            casts_shadows: shadows,
            has_roulette: roulette,
            roulette_by_throughput: settings.roulette_mode == RouletteMode::Throughput,
            clamps: settings.clamp.is_some(),
            half_state: settings.path_state == PathState::F16,
            fixed_offsets: settings.offsets == Offsets::Fixed,
            shading_cost: settings.shading_cost,
            material_branches: settings.material_branches,
            sorted: settings.sort == Sort::Material,
            defers_shadow_rays: settings.shadow_rays == ShadowRays::Deferred,
            regenerates: plan.paths_per_invocation > 1,
        }
    }

    /// Bytes of that number of traversal stacks, beyond what stays in registers.
    pub fn stack_bytes(&self, stacks: u64) -> u64 {
        // Full registers spill a block before the next push.
        let blocks = match self.stack_size.checked_sub(STACK_REGISTERS) {
            None | Some(0) => 0,
            Some(rest) => 1 + rest / STACK_BLOCK,
        };
        u64::from(blocks) * stacks * u64::from(4 * STACK_BLOCK)
    }
}
