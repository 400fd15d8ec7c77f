//! The size of a render's kernels and buffers, and what each feature adds to them: read from the kernels themselves,
//! without a device.

use std::collections::HashSet;

use super::buffers::path_records;
use super::defaults::Defaults;
use super::plan::Plan;
use super::prepare::{Features, Needs, PreparedScene};
use super::schedule::Schedule;
use crate::constants::*;
use crate::settings::{Integrator, Offsets, RouletteMode, Sampler, Scheduler, Settings};
use crate::shaders::{Access, Arithmetic, Build, Edition, Promises, portable_library};

/// Kernels and buffers of a render.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Footprint {
    /// How the work is cut.
    pub scheduler: Scheduler,
    /// Instructions of SPIR-V that can run, by kernel.
    pub instructions: Vec<(&'static str, usize)>,
    /// Bytes of the scene's buffers that some kernel binds.
    pub scene_bytes: Vec<(&'static str, u64)>,
    /// Bytes for a path in flight, by buffer that some kernel binds.
    pub path_bytes: Vec<(&'static str, u64)>,
}

/// A feature and what it amounts to in a render of a scene that is as it is otherwise.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FeatureCost {
    /// Its name.
    pub feature: &'static str,
    /// Whether the render has it: then its kernels and buffers have what follows, else they go without.
    pub found: bool,
    /// Instructions that it adds, by kernel.
    pub instructions: Vec<(&'static str, usize)>,
    /// Bytes of the scene's buffers that it adds; those of a feature that is not found as if every
    /// triangle had it.
    pub scene_bytes: Vec<(&'static str, u64)>,
    /// Bytes that it adds for a path in flight, by buffer.
    pub path_bytes: Vec<(&'static str, u64)>,
}

impl Footprint {
    /// Of a render as its settings have it, specialized or for any scene, on a device of such defaults.
    pub fn of(scene: &PreparedScene, settings: &Settings, defaults: &Defaults) -> Self {
        Self::with(scene, settings, &scene.needs(settings), defaults)
    }

    fn with(scene: &PreparedScene, settings: &Settings, needs: &Needs, defaults: &Defaults) -> Self {
        // Of the kernels that read texels and have ballots.
        let access = Access { texel_fetch: true, subgroup_ballot: true };
        let paths_per_invocation = settings.paths_per_invocation.unwrap_or(1);
        let workgroup_size = Defaults::WORKGROUP;
        let plan = Plan { width: 1, height: 1, tile_rows: 1, path_capacity: 1, workgroup_size, paths_per_invocation };
        let constants = needs.specialization(settings, &plan, &scene.bvh).words();
        let build = Build {
            constants: &constants,
            access,
            edition: Edition::Plain,
            arithmetic: Arithmetic::Native,
            driver: None,
            promises: Promises::default(),
        };
        let mut bound = HashSet::new();
        let mut instructions = Vec::new();
        let scheduler = defaults.scheduler(settings, scene.levels());
        for kernel in Schedule::new(scheduler, settings, needs, &plan).kernels() {
            let specialized = kernel.specialize(&build, portable_library());
            bound.extend(specialized.bindings.iter().map(|binding| binding.name));
            instructions.push((kernel.name, specialized.instructions));
        }
        // What a scene has no data for is as long as if every triangle had some.
        let scene_bytes = scene.buffers(false).into_iter().map(|buffer| (buffer.name, buffer.size));
        let path_bytes = path_records(settings.sort, needs).into_iter().filter(|(_, bytes)| *bytes > 0);
        Self {
            scheduler,
            instructions,
            scene_bytes: scene_bytes.filter(|(name, _)| bound.contains(name)).collect(),
            path_bytes: path_bytes.filter(|(name, _)| bound.contains(name)).collect(),
        }
    }
}

/// What is changed to give a render a feature, or to take it.
struct Subject {
    settings: Settings,
    needs: Needs,
}

/// A feature that is no flag of the scene: its name, whether a render has it, and how to give or take it.
type Feature = (&'static str, fn(&Subject) -> bool, fn(&mut Subject, bool));

/// Gives a kind of environment beside what there is, or takes it.
fn set_environment(subject: &mut Subject, kind: u32, on: bool) {
    let there = &mut subject.needs.features.environment;
    *there = match (on, *there) {
        (true, ENVIRONMENT_BLACK) => kind,
        (true, other) if other != kind => ENVIRONMENT_ANY,
        (false, same) if same == kind => ENVIRONMENT_BLACK,
        (_, other) => other,
    };
}

const FEATURES: &[Feature] = &[
    (
        "constant environment",
        |s| s.needs.features.environment == ENVIRONMENT_CONSTANT,
        |s, on| set_environment(s, ENVIRONMENT_CONSTANT, on),
    ),
    (
        "environment image",
        |s| s.needs.features.environment == ENVIRONMENT_LAT_LONG,
        |s, on| set_environment(s, ENVIRONMENT_LAT_LONG, on),
    ),
    (
        "scattering",
        |s| s.settings.max_bounces != Some(0),
        |s, on| s.settings.max_bounces = if on { s.settings.max_bounces.filter(|n| *n > 0) } else { Some(0) },
    ),
    (
        "bound on bounces",
        |s| s.settings.max_bounces.is_some(),
        |s, on| s.settings.max_bounces = on.then(|| s.settings.max_bounces.unwrap_or(8)),
    ),
    (
        "roulette",
        |s| s.settings.roulette > 0.0 || s.settings.roulette_mode == RouletteMode::Throughput,
        |s, on| {
            s.settings.roulette = if on { 0.5 } else { 0.0 };
            s.settings.roulette_mode = RouletteMode::Constant;
        },
    ),
    (
        "light samples",
        |s| s.settings.integrator != Integrator::Implicit,
        |s, on| s.settings.integrator = if on { Integrator::Explicit } else { Integrator::Implicit },
    ),
    (
        "weights of both samples (MIS)",
        |s| s.settings.integrator == Integrator::Mis,
        |s, on| s.settings.integrator = if on { Integrator::Mis } else { Integrator::Explicit },
    ),
    (
        "Sobol sequences",
        |s| s.settings.sampler == Sampler::Sobol,
        |s, on| s.settings.sampler = if on { Sampler::Sobol } else { Sampler::Independent },
    ),
    (
        "checks of thin triangles",
        |s| s.settings.offsets == Offsets::Robust && s.needs.features.thin_triangles,
        |s, on| {
            s.settings.offsets = if on { Offsets::Robust } else { Offsets::Unchecked };
            s.needs.features.thin_triangles |= on;
        },
    ),
    ("clamp", |s| s.settings.clamp.is_some(), |s, on| s.settings.clamp = on.then_some(1.0)),
    (
        "stack in memory",
        |s| s.needs.stack_size > STACK_REGISTERS,
        |s, on| s.needs.stack_size = if on { Needs::ALL.stack_size } else { STACK_REGISTERS },
    ),
];

/// Every feature, whether a render of the scene has it, and what it amounts to.
pub fn feature_costs(scene: &PreparedScene, settings: &Settings, defaults: &Defaults) -> Vec<FeatureCost> {
    let settings = Settings { specialize: true, ..*settings };
    let needs = scene.needs(&settings);
    let footprint = |subject: &Subject| {
        let needs =
            Needs::of(subject.needs.features, &subject.settings, subject.needs.stack_size, subject.needs.two_levels);
        Footprint::with(scene, &subject.settings, &needs, defaults)
    };
    let own = footprint(&Subject { settings, needs });
    let cost = |feature, found: bool, set: &dyn Fn(&mut Subject, bool)| {
        let mut subject = Subject { settings, needs };
        set(&mut subject, !found);
        let other = footprint(&subject);
        let (with, without) = if found { (&own, &other) } else { (&other, &own) };
        FeatureCost {
            feature,
            found,
            instructions: added(&with.instructions, &without.instructions, usize::saturating_sub),
            scene_bytes: added(&with.scene_bytes, &without.scene_bytes, u64::saturating_sub),
            path_bytes: added(&with.path_bytes, &without.path_bytes, u64::saturating_sub),
        }
    };
    let flags = Features::FLAGS
        .iter()
        .map(|flag| cost(flag.title, (flag.get)(&needs.features), &|s, on| (flag.set)(&mut s.needs.features, on)));
    let others = FEATURES.iter().map(|(name, has, set)| cost(name, has(&Subject { settings, needs }), set));
    flags.chain(others).collect()
}

/// By how much the numbers of `with` are above those of `without`, where they are.
fn added<N: Copy + Default + PartialEq>(
    with: &[(&'static str, N)],
    without: &[(&'static str, N)],
    subtract: fn(N, N) -> N,
) -> Vec<(&'static str, N)> {
    let before = |name| without.iter().find(|(other, _)| *other == name).map_or(N::default(), |(_, number)| *number);
    let more = with.iter().map(|(name, number)| (*name, subtract(*number, before(*name))));
    more.filter(|(_, number)| *number != N::default()).collect()
}
