//! One image, to the last bit, whatever the scheduler, the number of paths in flight, the
//! workgroup size and the order of the queues.

mod common;

use std::ops::ControlFlow;

use common::{device, own_scene, render_on};
use glam::DVec3;
use raywave::film::FilmMoments;
use raywave::gpu::Device;
use raywave::render::{PreparedScene, RenderError, Scheduler, Session, Settings};
use raywave::scene::{Integrator, Scene};

const SCENES: [&str; 7] =
    ["cornell-box", "cornell-caustic", "cornell-glass", "cornell-phong", "furnace", "smooth", "textured-sky"];
const SIZE: u32 = 20;
const SAMPLES: u32 = 3;

/// The sums of a render of three samples, small enough for every scene.
fn sums(device: &Device, scene: &Scene, settings: Settings) -> Vec<DVec3> {
    let settings = Settings { width: SIZE, height: SIZE, samples: SAMPLES, ..settings };
    let FilmMoments { sum, sum_of_squares, .. } = render_on(device, scene, &settings).film;
    sum.into_iter().chain(sum_of_squares).collect()
}

#[test]
fn schedulers_render_the_same_bits() {
    let device = device();
    for name in SCENES {
        let scene = own_scene(name);
        for integrator in [Integrator::Implicit, Integrator::Explicit] {
            let settings = |scheduler| Settings { integrator, scheduler, ..Settings::of(&scene) };
            let wavefront = sums(&device, &scene, settings(Scheduler::Wavefront));
            let megakernel = sums(&device, &scene, settings(Scheduler::Megakernel));
            assert!(wavefront == megakernel, "{name} {integrator:?} depends on the scheduler");
            assert!(wavefront.iter().any(|sum| *sum != DVec3::ZERO), "{name} {integrator:?} is black");
        }
    }
}

#[test]
fn batches_and_workgroups_leave_no_trace() {
    let device = device();
    let scene = own_scene("cornell-glass");
    for scheduler in [Scheduler::Wavefront, Scheduler::Megakernel] {
        let render = |in_flight, workgroup_size| {
            let settings = Settings { scheduler, in_flight, workgroup_size, ..Settings::of(&scene) };
            sums(&device, &scene, settings)
        };
        let reference = render(None, None);
        // A part of the image, an odd part, the image, it and a part, all samples at once.
        for in_flight in [64, 333, SIZE * SIZE, SIZE * SIZE + 77, SIZE * SIZE * SAMPLES] {
            assert!(reference == render(Some(in_flight), None), "{scheduler:?} depends on {in_flight} paths in flight");
        }
        for workgroup in [32, 64, 128] {
            assert!(reference == render(None, Some(workgroup)), "{scheduler:?} depends on workgroups of {workgroup}");
        }
    }
}

#[test]
fn a_shading_cost_is_paid_in_time_alone() {
    let device = device();
    let scene = own_scene("cornell-phong");
    let render =
        |scheduler, shading_cost| sums(&device, &scene, Settings { scheduler, shading_cost, ..Settings::of(&scene) });
    let reference = render(Scheduler::Wavefront, 0);
    assert!(reference == render(Scheduler::Wavefront, 100));
    assert!(reference == render(Scheduler::Megakernel, 100));
}

#[test]
fn loops_that_the_driver_cuts_are_told() {
    let device = device();
    if !device.description().driver.contains("Mesa") {
        // A driver without the limit has nothing to tell.
        return;
    }
    let scene = own_scene("cornell-box");
    // Eight bounces of 32,768 steps are four times what lavapipe runs.
    let settings = Settings {
        width: 16,
        height: 16,
        samples: 1,
        scheduler: Scheduler::Megakernel,
        shading_cost: 32_768,
        ..Settings::of(&scene)
    };
    let prepared = PreparedScene::new(&scene).expect("the scene fits");
    let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
    let result = session.render(|_| ControlFlow::Continue(()));
    assert!(matches!(result, Err(RenderError::CutLoops)));
}

#[test]
fn kernels_add_up_to_the_time_of_their_command_buffers() {
    let device = device();
    let scene = own_scene("cornell-box");
    for scheduler in [Scheduler::Wavefront, Scheduler::Megakernel] {
        let settings = Settings { width: 128, height: 128, samples: 8, scheduler, ..Settings::of(&scene) };
        let statistics = render_on(&device, &scene, &settings).statistics;
        let whole = statistics.gpu_seconds;
        let sum: f64 = statistics.kernels().values().map(|time| time.seconds).sum();
        assert!(whole > 0.0, "{scheduler:?}: the tests' drivers have clocks");
        assert!(whole <= statistics.wall_time.as_secs_f64(), "{scheduler:?}: command buffers run within the render");
        // Below 1: the barriers at both ends take time too.
        assert!((0.95..1.0).contains(&(sum / whole)), "{scheduler:?}: kernels {sum} s, command buffers {whole} s");
    }
}

#[test]
fn schedulers_trace_the_same_rays() {
    let device = device();
    let scene = own_scene("cornell-box");
    let rays = |scheduler| {
        let settings = Settings { width: 32, height: 32, samples: 2, scheduler, ..Settings::of(&scene) };
        let statistics = render_on(&device, &scene, &settings).statistics;
        [statistics.camera_rays, statistics.bounce_rays, statistics.shadow_rays]
    };
    let wavefront = rays(Scheduler::Wavefront);
    assert_eq!(wavefront, rays(Scheduler::Megakernel));
    assert!(wavefront.iter().all(|&count| count > 0));
}
