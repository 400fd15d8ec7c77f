//! What a scene has and what a render needs: all else is left out of the kernels.

use super::super::plan::Plan;
use super::super::settings::{Offsets, PathState, RouletteMode, Settings, ShadowRays, Sort};
use crate::bvh::BvhKind;
use crate::constants::*;
use crate::scene::{self, Environment, Integrator, Sampler, Scene, Surface};

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
            glossy: is(Surface::Glossy),
            phong: any(&|m| !m.is_emitter() && m.surface == Surface::Glossy && m.ks.max_element() > 0.0),
            mirror: is(Surface::Mirror),
            refractive: is(Surface::Refractive),
            dielectric: is(Surface::Dielectric),
            // A lamp shows no texture.
            textures: any(&|m| !m.is_emitter() && m.map_kd.is_some()),
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
pub(super) fn used_materials(scene: &Scene) -> Vec<bool> {
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
