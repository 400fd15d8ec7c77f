//! Settings that change the work and not the image: branches, sorting, regeneration; and the
//! kernels that count the work.

use std::ops::ControlFlow;

use crate::common::{assert_silent, device, not_tested::not_tested, own_scene, prepare, render_on, tries};
use glam::{DVec3, Vec3};
use raywave::bvh::{self, BvhKind, Primitive, Ray, Work};
use raywave::constants::{STAGE_CONNECT, STAGE_EXTEND, STAGE_SHADE, STAGES};
use raywave::film::FilmMoments;
use raywave::gpu::Device;
use raywave::layout::WorkCount;
use raywave::render::{Outcome, Session, SessionOptions};
use raywave::scene::Scene;
use raywave::settings::{Scheduler, Settings, ShadowRays, Sort};

/// Schedulers, and when they trace the rays to lights.
const SCHEDULERS: [(Scheduler, ShadowRays); 4] = [
    (Scheduler::Wavefront, ShadowRays::Deferred),
    (Scheduler::Bounce, ShadowRays::Deferred),
    (Scheduler::Bounce, ShadowRays::AtOnce),
    (Scheduler::Megakernel, ShadowRays::AtOnce),
];

fn small(scene: &Scene) -> Settings {
    Settings { width: 24, height: 20, samples: 3, ..scene.settings }
}

fn sums(outcome: Outcome) -> Vec<DVec3> {
    let FilmMoments { sum, sum_of_squares, .. } = outcome.film;
    sum.into_iter().chain(sum_of_squares).collect()
}

fn count(device: &Device, scene: &Scene, settings: &Settings) -> Outcome {
    let prepared = prepare(device, scene, settings);
    let options = SessionOptions { counting: true, ..SessionOptions::default() };
    let mut session = Session::with_options(device, &prepared, settings, options).expect("the session starts");
    let outcome = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
    drop(session);
    assert_silent(device);
    outcome
}

/// Counts of a stage by bounce.
fn stage(outcome: &Outcome, stage: u32) -> Vec<WorkCount> {
    outcome.statistics.work_counts.chunks_exact(STAGES as usize).map(|bounce| bounce[stage as usize]).collect()
}

#[test]
fn work_that_is_added_or_moved_leaves_no_trace() {
    let device = device();
    let mut cases = 0..;
    for name in ["cornell-glass", "cornell-phong", "cornell-box"] {
        let scene = own_scene(name);
        let reference = sums(render_on(&device, &scene, &small(&scene)));
        assert!(reference.iter().any(|sum| *sum != DVec3::ZERO));
        for (scheduler, shadow_rays) in SCHEDULERS {
            let plain = Settings { scheduler: Some(scheduler), shadow_rays, ..small(&scene) };
            let bvhs = BvhKind::all_of(scene.mesh.triangles.len()).map(|kind| Settings { bvh: Some(kind), ..plain });
            for settings in bvhs.chain([
                Settings { shading_cost: 100, ..plain },
                Settings { material_branches: 5, ..plain },
                Settings { material_branches: 127, shading_cost: 3, ..plain },
                Settings { sort: Sort::Material, ..plain },
                Settings { sort: Sort::Material, material_branches: 5, ..plain },
                // Paths are short of a whole number of paths for each invocation.
                Settings { paths_per_invocation: Some(1), ..plain },
                Settings { paths_per_invocation: Some(7), workgroup_size: Some(32), ..plain },
            ]) {
                if cases.next().is_some_and(|case| tries(&device, case, 7)) {
                    let found = sums(render_on(&device, &scene, &settings));
                    assert!(reference == found, "{name} differs with {settings:?}");
                }
            }
        }
    }
}

#[test]
fn fast_arithmetic_moves_the_image_by_rounding_alone() {
    let device = device();
    let scene = own_scene("cornell-phong");
    let exact = render_on(&device, &scene, &small(&scene)).film.mean();
    let fast = render_on(&device, &scene, &Settings { fast_math: true, ..small(&scene) }).film.mean();
    let close = |(a, b): &(&Vec3, &Vec3)| (**a - **b).abs().cmple(1e-4 * a.abs()).all();
    let pixels = exact.pixels.len();
    let alike = exact.pixels.iter().zip(&fast.pixels).filter(close).count();
    // A decision may fall otherwise once in a while.
    assert!(100 * alike >= 98 * pixels, "{alike} of {pixels} pixels are alike");
}

#[test]
fn counted_items_are_the_rays() {
    let device = device();
    let scene = own_scene("cornell-glass");
    for (scheduler, shadow_rays) in SCHEDULERS {
        let settings = Settings { scheduler: Some(scheduler), shadow_rays, ..small(&scene) };
        let plain = render_on(&device, &scene, &settings);
        let counted = count(&device, &scene, &settings);
        assert!(plain.film.sum == counted.film.sum, "{scheduler:?}: counting shows in the image");
        let rays = stage(&counted, STAGE_EXTEND);
        let statistics = &counted.statistics;
        assert_eq!(rays[0].items(), statistics.camera_rays);
        assert_eq!(rays[1..].iter().map(WorkCount::items).sum::<u64>(), statistics.bounce_rays);
        let shadow_rays: u64 = stage(&counted, STAGE_CONNECT).iter().map(WorkCount::items).sum();
        assert_eq!(shadow_rays, statistics.shadow_rays);
        let vertices = stage(&counted, STAGE_SHADE);
        assert!(vertices.iter().zip(&rays).all(|(vertices, rays)| vertices.items() == rays.items()));
        assert!(shadow_rays > 0 && plain.statistics.work_counts.is_empty());
    }
}

#[test]
fn schedulers_do_the_same_work() {
    let device = device();
    let scene = own_scene("cornell-glass");
    let work = |(scheduler, shadow_rays)| {
        let counted = count(&device, &scene, &Settings { scheduler: Some(scheduler), shadow_rays, ..small(&scene) });
        let what = |count: &WorkCount| (count.items(), count.nodes(), count.triangles());
        counted.statistics.work_counts.iter().map(what).collect::<Vec<_>>()
    };
    let expected = work(SCHEDULERS[0]);
    for scheduler in &SCHEDULERS[1..] {
        assert_eq!(work(*scheduler), expected, "{scheduler:?}");
    }
}

#[test]
fn rays_that_are_alike_do_what_the_cpu_does_and_leave_no_lane_idle() {
    let device = device();
    let mut scene = own_scene("cornell-glass");
    // It sees one direction.
    scene.camera.vfov = 1e-6;
    let settings = Settings { width: 16, height: 16, samples: 2, max_bounces: Some(0), ..scene.settings };
    let counted = count(&device, &scene, &settings);
    let prepared = prepare(&device, &scene, &settings);
    let frame = prepared.frame(&settings, 1);
    let ray = Ray {
        origin: Vec3::from(frame.camera_eye),
        direction: Vec3::from(frame.camera_forward),
        leaves: Primitive::NONE,
    };
    let (hit, Work { nodes, triangles }) = bvh::count_closest(&prepared.bvh, &prepared.triangles, &ray);
    assert!(hit.is_some() && nodes > 1 && triangles > 0);

    let rays = stage(&counted, STAGE_EXTEND)[0];
    assert_eq!((rays.items(), rays.nodes(), rays.triangles()), (512, 512 * nodes, 512 * triangles));
    if device.description().subgroup_ballot {
        let lanes = u64::from(device.description().subgroup_size);
        assert_eq!(rays.steps() * lanes, rays.nodes() + rays.triangles());
    }
}

#[test]
fn subgroups_take_no_more_steps_than_lanes_and_no_fewer_than_they_must() {
    let device = device();
    if !device.description().subgroup_ballot {
        return not_tested("steps of subgroups, which a device without ballots does not count");
    }
    let lanes = u64::from(device.description().subgroup_size);
    let scene = own_scene("cornell-glass");
    for (scheduler, shadow_rays) in SCHEDULERS {
        let counted = count(&device, &scene, &Settings { scheduler: Some(scheduler), shadow_rays, ..small(&scene) });
        let mut diverged = false;
        for count in stage(&counted, STAGE_EXTEND).into_iter().chain(stage(&counted, STAGE_CONNECT)) {
            let active = count.nodes() + count.triangles();
            assert!(count.steps() <= active && count.steps() * lanes >= active, "{count:?}");
            diverged |= count.steps() * lanes > active;
        }
        assert!(diverged, "lanes of different rays part");
    }
}
