//! Settings that buy speed with exactness: each gives one image, to the last bit, whatever the scheduler,
//! and departs from the exact one by no more than it says.

use std::ops::ControlFlow;

use crate::common::{assert_silent, device, own_scene, prepare, render_on, samples_on, scene_from, tries};
use glam::DVec3;
use rayon::prelude::*;
use raywave::gpu::Device;
use raywave::render::{Defaults, Footprint, Outcome, PreparedScene, Session};
use raywave::scene::Scene;
use raywave::settings::{Integrator, Offsets, PathState, Scheduler, Settings, ShadowRays};
use raywave_studies::stats::Moments;

/// Path state and offsets that are not the default.
const INEXACT: [(PathState, Offsets); 2] = [(PathState::F16, Offsets::Robust), (PathState::F16, Offsets::Fixed)];

/// Schedulers, when they trace the rays to lights, and paths of an invocation.
const SCHEDULERS: [(Scheduler, ShadowRays, u32); 5] = [
    (Scheduler::Wavefront, ShadowRays::Deferred, 1),
    (Scheduler::Bounce, ShadowRays::Deferred, 1),
    (Scheduler::Bounce, ShadowRays::AtOnce, 1),
    (Scheduler::Megakernel, ShadowRays::AtOnce, 1),
    (Scheduler::Megakernel, ShadowRays::AtOnce, 4),
];

fn inexact(settings: Settings, (path_state, offsets): (PathState, Offsets)) -> Settings {
    Settings { path_state, offsets, ..settings }
}

#[test]
fn schedulers_agree_to_the_last_bit() {
    let device = device();
    let scenes = ["cornell-box", "cornell-glass", "textured-sky"].map(own_scene);
    let integrators = [Integrator::Explicit, Integrator::Mis];
    let cases: Vec<_> = scenes
        .iter()
        .flat_map(|scene| integrators.map(|integrator| (scene, integrator)))
        .flat_map(|(scene, integrator)| INEXACT.map(|inexact| (scene, integrator, inexact)))
        .collect();
    cases.into_par_iter().enumerate().filter(|(case, _)| tries(&device, *case, 7)).for_each(|(_, case)| {
        let (scene, integrator, way) = case;
        let settings = Settings { width: 20, height: 20, samples: 3, integrator, ..scene.settings };
        let settings = inexact(settings, way);
        let render = |(scheduler, shadow_rays, paths): (Scheduler, ShadowRays, u32)| {
            let settings = Settings {
                scheduler: Some(scheduler),
                shadow_rays,
                paths_per_invocation: Some(paths),
                in_flight: Some(333),
                ..settings
            };
            let Outcome { film, statistics } = render_on(&device, scene, &settings);
            (film.sum, film.sum_of_squares, statistics.bounce_rays, statistics.shadow_rays)
        };
        let first = render(SCHEDULERS[0]);
        assert!(first.0.iter().any(|sum| *sum != DVec3::ZERO), "{} is black", scene.name);
        for scheduler in &SCHEDULERS[1..] {
            assert!(render(*scheduler) == first, "{}, {integrator:?}, {way:?}: {scheduler:?} differs", scene.name);
        }
        let exact = render_on(&device, scene, &inexact(settings, (PathState::F32, Offsets::Robust)));
        assert!(exact.film.sum != first.0, "{}, {way:?}: nothing was rounded", scene.name);
    });
}

/// The relative difference of two images' means by the same random numbers, and its standard error by
/// seeds.
fn shift(device: &Device, scene: &Scene, exact: Settings, other: Settings, seeds: u32) -> Moments {
    let means = |settings: Settings| {
        let prepared = prepare(device, scene, &settings);
        let mut session = Session::new(device, &prepared, &settings).expect("the session starts");
        let mean = |seed| {
            session.reseed(&prepared, seed, settings.samples).expect("the device goes on");
            let film = session.render(|_| ControlFlow::Continue(())).expect("the render ends").film;
            film.sum.iter().map(|sum| sum.element_sum()).sum::<f64>()
        };
        (0..seeds).map(mean).collect::<Vec<_>>()
    };
    let (exact, other) = (means(exact), means(other));
    assert_silent(device);
    other.iter().zip(exact).map(|(other, exact)| other / exact - 1.0).collect()
}

/// Samples of each pixel in the renders whose means are compared, on lavapipe.
const SHIFT_SAMPLES: u32 = 16;

/// The mean is moved by no more than that and five standard errors, and the test would see such a move. `bound` is that
/// of [`SHIFT_SAMPLES`]: fewer samples show only larger moves.
fn assert_shift_below(shift: Moments, bound: f64, samples: u32, what: &str) {
    let bound = bound * f64::from(SHIFT_SAMPLES / samples).sqrt();
    let (mean, error) = (shift.mean(), shift.standard_error());
    assert!(error < 0.2 * bound, "{what}: a standard error of {error:e} says nothing about {bound:e}");
    assert!(mean.abs() < bound + 5.0 * error, "{what}: the mean is off by {mean:e}, standard error {error:e}");
}

#[test]
fn halves_lose_no_light() {
    let device = device();
    let scene = own_scene("cornell-phong");
    let exact = Settings {
        width: 64,
        height: 64,
        samples: samples_on(&device, SHIFT_SAMPLES),
        max_bounces: Some(16),
        // Densities are rounded too.
        integrator: Integrator::Mis,
        ..scene.settings
    };
    let halves = inexact(exact, (PathState::F16, Offsets::Robust));
    // Rounding down would lose 2.4e-4 at each vertex.
    assert_shift_below(shift(&device, &scene, exact, halves, 6), 2e-5, exact.samples, "cornell-phong");
}

#[test]
fn halves_take_less_memory() {
    let scene = own_scene("cornell-box");
    let prepared = PreparedScene::new(&scene).expect("the scene fits");
    let path_bytes = |path_state| {
        let scheduler = Some(Scheduler::Bounce);
        let settings = Settings { path_state, scheduler, ..scene.settings };
        Footprint::of(&prepared, &settings, &Defaults::GPU).path_bytes
    };
    let (floats, halves) = (path_bytes(PathState::F32), path_bytes(PathState::F16));
    let without: Vec<_> = floats.iter().copied().filter(|(name, _)| *name != "throughputs").collect();
    assert!(halves == without && halves.len() + 1 == floats.len(), "{halves:?}");
}

/// A sheet of glass of that thickness, refracting without a Fresnel split, under a sky of 1 from everywhere.
fn sheet(thickness: f64) -> Scene {
    let toml = "[camera]\neye = [0.1, 0.9, 0.1]\ntarget = [0, 0, 0]\nvfov = 20\n[[mesh]]\nfile = \"scene.obj\"\n\
                [environment]\nradiance = [1, 1, 1]\n";
    let corners = |y: f64| format!("v -1 {y} -1\nv 1 {y} -1\nv 1 {y} 1\nv -1 {y} 1\n");
    let obj = format!("mtllib scene.mtl\n{}{}usemtl glass\nf 4 3 2 1\nf 5 6 7 8\n", corners(0.0), corners(-thickness));
    scene_from(toml, &obj, "newmtl glass\nillum 6\nNi 1.5\nTf 1 1 1\n")
}

#[test]
fn fixed_offsets_see_through_what_is_thinner_than_they_are() {
    let device = device();
    for (thickness, offsets, seen) in [
        (1e-3, Offsets::Robust, 1.0),
        (1e-3, Offsets::Fixed, 1.0),
        (2e-5, Offsets::Robust, 1.0),
        // The ray begins beyond the sheet's other side and never leaves the glass: radiance scales with
        // the square of the index.
        (2e-5, Offsets::Fixed, 1.0 / 2.25),
    ] {
        let scene = sheet(thickness);
        let settings = Settings {
            width: 8,
            height: 8,
            samples: 1,
            max_bounces: Some(4),
            integrator: Integrator::Implicit,
            offsets,
            ..scene.settings
        };
        for sum in render_on(&device, &scene, &settings).film.sum {
            let off = (sum - DVec3::splat(seen)).abs().max_element();
            assert!(off < 1e-5, "{thickness}, {offsets:?}: {sum} is not {seen}");
        }
    }
}

#[test]
fn fixed_offsets_hardly_change_scenes_without_small_gaps() {
    let device = device();
    let scene = own_scene("cornell-box");
    let samples = samples_on(&device, SHIFT_SAMPLES);
    let exact = Settings { width: 64, height: 64, samples, ..scene.settings };
    let fixed = inexact(exact, (PathState::F32, Offsets::Fixed));
    assert_shift_below(shift(&device, &scene, exact, fixed, 6), 1e-3, samples, "cornell-box");
}
