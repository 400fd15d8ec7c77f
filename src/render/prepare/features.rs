//! What a scene has and what a render needs of its kernels, and so the values of the specialization constants.

use super::super::plan::Plan;
use glam::DMat3;

use crate::bvh::{Bvh, BvhKind};
use crate::constants::*;
use crate::scene::{self, Environment, Lookup, Parameter, Scene, Surface};
use crate::settings::{Filter, Integrator, Offsets, PathState, RouletteMode, Sampler, Settings, ShadowRays, Sort};

/// Declares what a scene may have or not: its name in the code, its name for people, and how it is found.
macro_rules! features {
    ($($(#[$doc:meta])* $name:ident, $title:literal: $is_in:expr;)*) => {
        /// What a scene has: kernels leave out all else. A material counts only if some triangle has it.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct Features {
            /// One of `ENVIRONMENT_*`.
            pub environment: u32,
            /// Some triangle is so thin that rounding may move it past a ray's origin: of account where rays check it.
            pub thin_triangles: bool,
            $($(#[$doc])* pub $name: bool,)*
        }

        impl Features {
            /// Every one.
            pub const ALL: Self = Self { environment: ENVIRONMENT_ANY, thin_triangles: true, $($name: true),* };

            /// Those that a scene has or not.
            pub const FLAGS: &[FeatureFlag] = &[$(FeatureFlag {
                title: $title,
                get: |features| features.$name,
                set: |features, on| features.$name = on,
            }),*];

            fn of_subject(subject: &Subject<'_>) -> Self {
                Self {
                    environment: match subject.scene.environment {
                        Environment::Black => ENVIRONMENT_BLACK,
                        Environment::Constant(_) => ENVIRONMENT_CONSTANT,
                        Environment::LatLong(_) => ENVIRONMENT_LAT_LONG,
                    },
                    thin_triangles: false,
                    $($name: is_in(subject, $is_in)),*
                }
            }
        }
    };
}

features! {
    /// Some triangle emits.
    lights, "area lights": |s| s.any_used(|m| m.is_emitter());
    /// Some material is a Phong BRDF: Lambert plus lobe.
    phong, "diffuse surfaces": |s| s.any_of(SURFACE_PHONG);
    /// The lobe of some Phong BRDF is above zero.
    phong_lobes, "Phong lobes": |s| s.any_scattering(|m| m.surface == Surface::Glossy && m.specular.max_element() > 0.0);
    /// Some material is a mirror.
    mirror, "mirrors": |s| s.any_of(SURFACE_MIRROR);
    /// Some material refracts without Fresnel split.
    refractive, "refraction": |s| s.any_of(SURFACE_REFRACTIVE);
    /// Some material is a Fresnel dielectric.
    dielectric, "Fresnel glass": |s| s.any_of(SURFACE_DIELECTRIC);
    /// Some material is a metal without microfacets.
    smooth_conductor, "smooth metals": |s| s.any_of(SURFACE_SMOOTH_CONDUCTOR);
    /// Some material is a metal with microfacets.
    conductor, "rough metals": |s| s.any_of(SURFACE_CONDUCTOR);
    /// Some material is a dielectric with microfacets.
    rough_dielectric, "rough glass": |s| s.any_of(SURFACE_ROUGH_DIELECTRIC);
    /// Some material is a thin plate of a dielectric.
    thin_dielectric, "thin glass": |s| s.any_of(SURFACE_THIN_DIELECTRIC);
    /// Some material is a diffuse base under a smooth coat.
    plastic, "plastics": |s| s.any_of(SURFACE_PLASTIC);
    /// Some material is a diffuse base under a coat with microfacets.
    rough_plastic, "rough plastics": |s| s.any_of(SURFACE_ROUGH_PLASTIC);
    /// Some material is glTF's mixture of metal and diffuse.
    metal_rough, "metal-rough": |s| s.any_of(SURFACE_METAL_ROUGH);
    /// Some of those has a clear coat.
    coat, "clear coats": |s| s.any_scattering(|m| m.surface == Surface::MetalRough && m.coat > 0.0);
    /// Some material is Disney's BSDF of a body.
    principled, "principled bodies": |s| s.any_of(SURFACE_PRINCIPLED);
    /// Some material is Disney's BSDF of a thin sheet.
    principled_thin, "principled sheets": |s| s.any_of(SURFACE_PRINCIPLED_THIN);
    /// Some material is no surface.
    nothing, "transparency": |s| s.any_of(SURFACE_NOTHING);
    /// Some material is a blend, or has one for each side.
    blends, "blends": |s| s.any_scattering(|m| m.surface.parts().next().is_some());
    /// Some material is turned by the direction of its texture coordinates.
    anisotropy, "anisotropy": |s| s.any_scattering(|m| m.is_anisotropic());
    /// The microfacets of some material are of Beckmann's distribution.
    beckmann, "Beckmann facets": |s| s.any_scattering(|m| m.is_rough() && m.is_beckmann);
    /// Some material makes up for light that its microfacets scatter more than once.
    compensation, "multiple scattering": |s| s.any_scattering(|m| m.is_rough() && m.compensates);
    /// Vertices of some triangle have colours.
    vertex_colours, "colours of vertices": |s| s.scene.meshes().any(|mesh| !mesh.colours.is_empty());
    /// Some material that scatters has a texture of diffuse reflectance.
    textures, "textures": |s| s.any_scattering(|m| m.texture(Parameter::Diffuse).is_some());
    /// Some material has a texture of another parameter.
    detail_textures, "detail textures": |s| s.any_used(scene::Material::has_detail_textures);
    /// Some texture turns shading normals.
    normal_textures, "normal maps": |s| s.any_scattering(scene::Material::turns_normals);
    /// Some texture is not bilinear and repeated as it is.
    lookups, "placed textures": |s| s.any_texture(|t| t.lookup != Lookup::default());
    /// Some surface both emits and scatters.
    scattering_lights, "lights that scatter": |s| s.any_used(|m| m.is_emitter() && !m.is_pure_emitter);
    /// Some light is no surface.
    punctual_lights, "punctual lights": |s| !s.scene.lights.is_empty();
    /// The lat-long environment is turned.
    turned_environment, "turned environment": |s| s.has_turned_environment();
    /// The camera is orthographic.
    orthographic, "orthographic camera": |s| s.scene.camera.orthographic.is_some();
    /// Some triangle has shading normals.
    normals, "shading normals": |s| s.has_normals();
    /// The camera has a lens.
    lens, "lens": |s| s.scene.camera.aperture > 0.0;
    /// The camera is so far away that its rays start nearer to the scene.
    distance, "distant camera": |_| false;
}

/// The BSDF of a material, as kernels call it: one of `SURFACE_*`.
pub(super) fn bsdf_of(material: &scene::Material) -> u32 {
    let is_rough = material.is_rough();
    match material.surface {
        _ if material.only_emits() => SURFACE_EMITTER,
        Surface::Glossy => SURFACE_PHONG,
        Surface::Mirror => SURFACE_MIRROR,
        Surface::Refractive => SURFACE_REFRACTIVE,
        Surface::Dielectric if is_rough => SURFACE_ROUGH_DIELECTRIC,
        Surface::Dielectric => SURFACE_DIELECTRIC,
        Surface::ThinDielectric => SURFACE_THIN_DIELECTRIC,
        Surface::Conductor if is_rough => SURFACE_CONDUCTOR,
        Surface::Conductor => SURFACE_SMOOTH_CONDUCTOR,
        Surface::Plastic { .. } if is_rough => SURFACE_ROUGH_PLASTIC,
        Surface::Plastic { .. } => SURFACE_PLASTIC,
        Surface::MetalRough => SURFACE_METAL_ROUGH,
        Surface::Principled => SURFACE_PRINCIPLED,
        Surface::PrincipledThin => SURFACE_PRINCIPLED_THIN,
        Surface::Nothing => SURFACE_NOTHING,
        Surface::Blend(..) => SURFACE_BLEND,
        Surface::Sides { .. } => SURFACE_SIDES,
    }
}

/// A feature that a scene has or not.
#[derive(Debug)]
pub struct FeatureFlag {
    /// Its name for people.
    pub title: &'static str,
    /// Whether it is there.
    pub get: fn(&Features) -> bool,
    /// Gives it or takes it.
    pub set: fn(&mut Features, bool),
}

/// Where features are looked for.
struct Subject<'a> {
    scene: &'a Scene,
    /// Materials that some triangle has.
    used: Vec<&'a scene::Material>,
}

impl Subject<'_> {
    fn any_used(&self, test: impl Fn(&scene::Material) -> bool) -> bool {
        self.used.iter().any(|material| test(material))
    }

    /// Of the materials that scatter.
    fn any_scattering(&self, test: impl Fn(&scene::Material) -> bool) -> bool {
        self.any_used(|material| !material.only_emits() && test(material))
    }

    /// Whether some material has that BSDF.
    fn any_of(&self, bsdf: u32) -> bool {
        self.any_used(|material| bsdf_of(material) == bsdf)
    }

    fn any_texture(&self, test: impl Fn(&scene::Texture) -> bool) -> bool {
        let shown = |material: &scene::Material| {
            let textures = material.textures.iter().flatten();
            textures.map(|texture| &self.scene.textures[*texture as usize]).any(&test)
        };
        self.any_used(shown)
    }

    fn has_normals(&self) -> bool {
        self.scene.meshes().flat_map(|mesh| &mesh.triangles).any(|triangle| triangle.normals[0] != scene::NONE)
    }

    fn has_turned_environment(&self) -> bool {
        matches!(&self.scene.environment, Environment::LatLong(map) if map.rotation != DMat3::IDENTITY)
    }
}

fn is_in(subject: &Subject<'_>, is_in: impl Fn(&Subject<'_>) -> bool) -> bool {
    is_in(subject)
}

impl Features {
    /// All but what a tree tells, `thin_triangles`, and where the camera is, `distance`.
    pub(super) fn of(scene: &Scene) -> Self {
        let used =
            scene.materials.iter().zip(scene.shown_materials()).filter_map(|(material, used)| used.then_some(material));
        Self::of_subject(&Subject { scene, used: used.collect() })
    }

    /// Whether some BSDF is not all specular, so that light samples count.
    fn has_non_specular(&self) -> bool {
        let Self { phong, conductor, rough_dielectric, plastic, rough_plastic, metal_rough, .. } = *self;
        phong || conductor || rough_dielectric || plastic || rough_plastic || metal_rough || self.any_principled()
    }

    fn any_principled(&self) -> bool {
        self.principled || self.principled_thin
    }

    fn scatters(&self) -> bool {
        let Self { mirror, refractive, dielectric, smooth_conductor, thin_dielectric, nothing, .. } = *self;
        self.has_non_specular() || mirror || refractive || dielectric || smooth_conductor || thin_dielectric || nothing
    }

    /// Whether materials have more than the words of each.
    pub(super) fn has_details(&self) -> bool {
        let Self { smooth_conductor, conductor, rough_dielectric, thin_dielectric, plastic, rough_plastic, .. } = *self;
        let Self { metal_rough, blends, detail_textures, normal_textures, .. } = *self;
        let coats = plastic || rough_plastic || metal_rough;
        let other = smooth_conductor || conductor || rough_dielectric || thin_dielectric;
        coats || other || self.any_principled() || blends || detail_textures || normal_textures
    }

    /// Whether triangles have texture coordinates.
    pub(super) fn has_coordinates(&self) -> bool {
        self.textures || self.detail_textures || self.normal_textures || self.anisotropy
    }
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
    /// Meshes lie in their places under a tree of their own.
    pub two_levels: bool,
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
        two_levels: false,
    };

    /// What a render needs, by the features of its scene, the stack of its BVH, and whether that has two levels.
    pub fn of(features: Features, settings: &Settings, stack_size: u32, two_levels: bool) -> Self {
        let scatters = features.scatters() && settings.max_bounces != Some(0);
        let lit = features.lights || features.punctual_lights || features.environment != ENVIRONMENT_BLACK;
        Self {
            features,
            scatters,
            bounded: settings.max_bounces.is_some(),
            roulette: settings.roulette > 0.0 || settings.roulette_mode == RouletteMode::Throughput,
            shadows: scatters && features.has_non_specular() && lit && settings.integrator != Integrator::Implicit,
            stack_size,
            two_levels,
        }
    }

    /// What kernels are built for, with the settings and the BVH of a render.
    pub fn specialization(&self, settings: &Settings, plan: &Plan, bvh: &Bvh) -> Specialization {
        let Self { features, scatters, bounded, roulette, shadows, stack_size, two_levels } = *self;
        let Features {
            environment,
            lights,
            phong,
            phong_lobes,
            mirror,
            refractive,
            dielectric,
            smooth_conductor,
            conductor,
            rough_dielectric,
            thin_dielectric,
            plastic,
            rough_plastic,
            metal_rough,
            coat,
            principled,
            principled_thin,
            nothing,
            blends,
            anisotropy,
            beckmann,
            compensation,
            vertex_colours,
            textures,
            detail_textures,
            normal_textures,
            lookups,
            scattering_lights,
            punctual_lights,
            turned_environment,
            orthographic,
            normals,
            thin_triangles,
            lens,
            distance,
        } = features;
        Specialization {
            workgroup_size: plan.workgroup_size,
            stack_size,
            bvh_width: bvh.kind.width(),
            listed_count: if bvh.kind == BvhKind::List { bvh.order.len() as u32 } else { 0 },
            two_level: two_levels,
            integrator: match settings.integrator {
                Integrator::Implicit => INTEGRATOR_IMPLICIT,
                Integrator::Explicit => INTEGRATOR_EXPLICIT,
                Integrator::Mis => INTEGRATOR_MIS,
            },
            sampler: match settings.sampler {
                Sampler::Independent => SAMPLER_INDEPENDENT,
                Sampler::Sobol => SAMPLER_SOBOL,
            },
            halves: settings.halves,
            environment,
            has_lights: lights,
            has_phong: phong,
            has_phong_lobes: phong_lobes,
            has_mirror: mirror,
            has_refractive: refractive,
            has_dielectric: dielectric,
            has_smooth_conductor: smooth_conductor,
            has_conductor: conductor,
            has_rough_dielectric: rough_dielectric,
            has_thin_dielectric: thin_dielectric,
            has_plastic: plastic,
            has_rough_plastic: rough_plastic,
            has_metal_rough: metal_rough,
            has_coat: coat,
            has_principled: principled,
            has_principled_thin: principled_thin,
            has_nothing: nothing,
            has_blends: blends,
            has_anisotropy: anisotropy,
            has_beckmann: beckmann,
            has_compensation: compensation,
            has_textures: textures,
            has_vertex_colours: vertex_colours,
            has_detail_textures: detail_textures,
            has_normal_textures: normal_textures,
            has_lookups: lookups,
            has_scattering_lights: scattering_lights,
            has_punctual_lights: punctual_lights,
            has_turned_environment: turned_environment,
            has_orthographic: orthographic,
            has_normals: normals,
            has_lens: lens,
            has_distance: distance,
            gaussian_filter: settings.filter == Filter::Gaussian,
            scatters,
            bounded,
            casts_shadows: shadows,
            has_roulette: roulette,
            roulette_by_throughput: settings.roulette_mode == RouletteMode::Throughput,
            clamps: settings.clamp.is_some(),
            half_state: settings.path_state == PathState::F16,
            fixed_offsets: settings.offsets == Offsets::Fixed,
            checks_sides: settings.offsets == Offsets::Robust && thin_triangles,
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
