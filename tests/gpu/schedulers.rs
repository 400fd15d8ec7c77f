//! One image, to the last bit, whatever the scheduler, the number of paths in flight, the
//! workgroup size and the order of the queues; and as many rays. Of how many there should be,
//! `ray_counts.rs` knows.

use std::fs;
use std::ops::ControlFlow;

use crate::common::{device, gallery, own_scene, project_file, render_on, tries};
use glam::DVec3;
use rayon::prelude::*;
use raywave::facts;
use raywave::gpu::Device;
use raywave::render::{Outcome, PreparedScene, RenderError, Session};
use raywave::scene::Scene;
use raywave::settings::{Integrator, Packets, RouletteMode, Sampler, Scheduler, Settings, ShadowRays};

const SIZE: u32 = 20;
const SAMPLES: u32 = 3;

/// Every scene of `scenes/` and a small gallery, by name.
fn all_scenes() -> Vec<(String, Scene)> {
    let entries = fs::read_dir(project_file("scenes")).expect("the folder of scenes is readable");
    let paths = entries.map(|entry| entry.expect("its entries are readable").path());
    let own = paths.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
    let scenes = own.map(|path| Scene::load(&path).expect("own scenes load")).chain([gallery(5000)]);
    scenes.map(|scene| (scene.name.clone(), scene)).collect()
}

/// A render of three samples, small enough for every scene: what must not depend on the scheduler.
#[derive(PartialEq)]
struct Render {
    sums: Vec<DVec3>,
    sums_of_squares: Vec<DVec3>,
    camera_rays: u64,
    bounce_rays: u64,
    shadow_rays: u64,
}

impl Render {
    fn new(device: &Device, scene: &Scene, settings: Settings) -> Self {
        let settings = Settings { width: SIZE, height: SIZE, samples: SAMPLES, ..settings };
        let Outcome { film, statistics } = render_on(device, scene, &settings);
        Self {
            sums: film.sum,
            sums_of_squares: film.sum_of_squares,
            camera_rays: statistics.camera_rays,
            bounce_rays: statistics.bounce_rays,
            shadow_rays: statistics.shadow_rays,
        }
    }
}

/// Schedulers, and when they trace the rays to lights.
const SCHEDULERS: [(Scheduler, ShadowRays); 4] = [
    (Scheduler::Wavefront, ShadowRays::Deferred),
    (Scheduler::Bounce, ShadowRays::Deferred),
    (Scheduler::Bounce, ShadowRays::AtOnce),
    (Scheduler::Megakernel, ShadowRays::AtOnce),
];

/// Paths in flight and workgroup size of the renders that are compared with one of all samples at
/// once in workgroups of the device's choice. Every render builds its kernels anew, which takes most
/// of its time, so not every pair is tried: what depends on either number differs in some pair.
const CUTS: [(u32, u32); 5] = [
    // A part of the image, an odd part,
    (100, 32),
    (333, 64),
    // the image, it and a part,
    (SIZE * SIZE, 128),
    (SIZE * SIZE + 77, 64),
    // all samples but one.
    (SIZE * SIZE * SAMPLES - 1, 32),
];

/// Ways to estimate the image: every integrator, sampler, roulette and clamp is in some of them.
const ESTIMATORS: [(Integrator, Sampler, RouletteMode, Option<f64>); 3] = [
    (Integrator::Implicit, Sampler::Independent, RouletteMode::Throughput, None),
    (Integrator::Explicit, Sampler::Independent, RouletteMode::Constant, Some(0.1)),
    (Integrator::Mis, Sampler::Sobol, RouletteMode::Throughput, None),
];

#[test]
fn schedulers_batches_and_workgroups_leave_no_trace() {
    let device = device();
    let scenes = all_scenes();
    assert!(scenes.len() > 7, "scenes/ and the gallery");
    let cases: Vec<_> = scenes.iter().flat_map(|scene| ESTIMATORS.map(|estimator| (scene, estimator))).collect();
    let ways: Vec<_> = SCHEDULERS.iter().flat_map(|scheduler| CUTS.map(|cut| (*scheduler, cut))).collect();
    let cases = cases.into_par_iter().enumerate().filter(|(case, _)| tries(&device, *case, 8));
    cases.for_each(|(case, ((name, scene), (integrator, sampler, roulette_mode, clamp)))| {
        let settings = Settings { integrator, sampler, roulette_mode, roulette_from: 1, clamp, ..scene.settings };
        let reference = Render::new(&device, scene, settings);
        assert!(reference.sums.iter().any(|sum| *sum != DVec3::ZERO), "{name} {integrator:?} is black");
        // One of seven: seven scenes have among them each estimator by each scheduler by each cut.
        let ways = ways.iter().copied().enumerate().filter(|(way, _)| (case * ways.len() + way).is_multiple_of(7));
        for (way, ((scheduler, shadow_rays), (paths, workgroup))) in ways {
            let (in_flight, workgroup_size) = (Some(paths), Some(workgroup));
            // Every other one with packets, which subgroups that are not full have too, where the device can have them.
            let all = Packets { camera: true, bounce: true, shadow: true };
            let packets = (way.is_multiple_of(2) && device.description().packets()).then_some(all);
            let scheduler = Some(scheduler);
            let settings = Settings { scheduler, shadow_rays, packets, in_flight, workgroup_size, ..settings };
            assert!(
                Render::new(&device, scene, settings) == reference,
                "{name}, {integrator:?} differs: {scheduler:?}, shadow rays {shadow_rays:?}, {paths} paths in flight, \
                 workgroups of {workgroup}, {packets:?}"
            );
        }
    });
}

#[test]
fn loops_that_the_driver_cuts_are_told() {
    let device = device();
    // A driver without the limit runs what is over that of others.
    let limit = facts::of(&device).expect("the device can be measured").loop_turns;
    let turns = limit.unwrap_or(65_535);
    let scene = own_scene("cornell-box");
    let prepared = PreparedScene::new(&scene).expect("the scene fits");
    for (scheduler, shading_cost, is_over) in [
        // Eight bounces of half the turns.
        (Scheduler::Megakernel, turns / 2, true),
        (Scheduler::Wavefront, turns / 2, false),
        (Scheduler::Bounce, turns / 2, false),
        // One vertex alone is over it.
        (Scheduler::Wavefront, turns + turns / 16, true),
        (Scheduler::Bounce, turns + turns / 16, true),
    ] {
        let cuts = limit.is_some() && is_over;
        let settings =
            Settings { width: 16, height: 16, samples: 1, scheduler: Some(scheduler), shading_cost, ..scene.settings };
        let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
        let result = session.render(|_| ControlFlow::Continue(()));
        assert_eq!(matches!(result, Err(RenderError::CutLoops)), cuts, "{scheduler:?}, {shading_cost} steps");
    }
}

#[test]
fn kernels_add_up_to_the_time_of_their_command_buffers() {
    let device = device();
    let scene = own_scene("cornell-box");
    for (scheduler, shadow_rays) in SCHEDULERS {
        // A card takes as long for many samples as software for few.
        let samples = if device.description().is_software() { 8 } else { 1024 };
        let size = Settings { width: 128, height: 128, samples, ..scene.settings };
        let settings = Settings { scheduler: Some(scheduler), shadow_rays, ..size };
        // Below 1: the barriers at both ends take time too. Where another program gets the processor there it may be
        // any time, so one of some renders is to tell.
        let shares = std::iter::repeat_with(|| {
            let statistics = render_on(&device, &scene, &settings).statistics;
            let whole = statistics.gpu_seconds;
            let sum: f64 = statistics.kernels().values().map(|time| time.seconds).sum();
            assert!(whole > 0.0, "{scheduler:?}: the tests' drivers have clocks");
            assert!(
                whole <= statistics.wall_time.as_secs_f64(),
                "{scheduler:?}: command buffers run within the render"
            );
            assert!(sum < whole, "{scheduler:?}: kernels {sum} s, command buffers {whole} s");
            sum / whole
        });
        assert!(shares.take(8).any(|share| share >= 0.95), "{scheduler:?}: the kernels' times do not add up");
    }
}
