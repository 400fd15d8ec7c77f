//! Meshes in their places on the device: the image and every ray are the same to the last bit whether they are flattened or
//! not, by every scheduler, and what the device finds is what the CPU finds.

use std::ops::ControlFlow;

use crate::common::{assert_silent, device, tries};
use crate::instances::orchard;
use raywave::bvh::{BvhKind, Primitive, Ray, count_any, count_closest};
use raywave::constants::NO_TRIANGLE;
use raywave::gpu::Device;
use raywave::layout::WorkCount;
use raywave::rays::{RayClass, RayOrder, RayRecord};
use raywave::render::{PreparedScene, Replay, Session, TriangleName, distances};
use raywave::scene::Scene;
use raywave::settings::{Instances, Integrator, Offsets, PathState, Sampler, Scheduler, Settings, ShadowRays, Sort};

fn prepared(scene: &Scene, kind: BvhKind, instances: Instances) -> PreparedScene {
    PreparedScene::with_tree(scene, kind, instances).expect("the scene fits")
}

fn digest(device: &Device, scene: &PreparedScene, settings: &Settings) -> String {
    let mut session = Session::new(device, scene, settings).expect("the session starts");
    let outcome = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
    assert_eq!(outcome.statistics.nonfinite_samples, 0);
    drop(session);
    assert_silent(device);
    outcome.film.mean().digest()
}

#[test]
fn an_image_is_the_same_whether_meshes_are_flattened_or_not() {
    let device = device();
    let scene = orchard();
    let base = Settings { samples: 4, max_bounces: Some(4), ..scene.settings };
    let ways = [
        Settings { scheduler: Some(Scheduler::Wavefront), integrator: Integrator::Mis, ..base },
        Settings { scheduler: Some(Scheduler::Bounce), ..base },
        Settings { scheduler: Some(Scheduler::Megakernel), integrator: Integrator::Mis, ..base },
        Settings {
            scheduler: Some(Scheduler::Bounce),
            shadow_rays: ShadowRays::AtOnce,
            integrator: Integrator::Mis,
            ..base
        },
        Settings { scheduler: Some(Scheduler::Wavefront), sort: Sort::Material, sampler: Sampler::Independent, ..base },
        Settings {
            scheduler: Some(Scheduler::Wavefront),
            path_state: PathState::F16,
            integrator: Integrator::Mis,
            ..base
        },
        Settings {
            scheduler: Some(Scheduler::Bounce),
            offsets: Offsets::Fixed,
            integrator: Integrator::Implicit,
            ..base
        },
        Settings { scheduler: Some(Scheduler::Megakernel), specialize: false, ..base },
    ];
    let flat = [BvhKind::Bvh2, BvhKind::Cwbvh].map(|kind| prepared(&scene, kind, Instances::Flatten));
    let placed = prepared(&scene, BvhKind::Bvh2, Instances::TwoLevel);
    assert!(placed.lights.len() > 100 && placed.bvh.instances.len() == 8);
    for (index, settings) in ways.iter().enumerate().filter(|(index, _)| tries(&device, *index, 3)) {
        let expected = digest(&device, &flat[index % 2], settings);
        assert_eq!(digest(&device, &placed, settings), expected, "way {index}");
    }
}

fn dump(device: &Device, scene: &PreparedScene, settings: &Settings, class: RayClass, bounce: u32) -> Vec<RayRecord> {
    let mut session = Session::new(device, scene, settings).expect("the session starts");
    session.dump_rays(scene, class, bounce, RayOrder::Slot).expect("there are rays").rays
}

/// Nodes and triangles that the CPU's traversal of the rays visits.
fn work_on_cpu(scene: &PreparedScene, class: RayClass, rays: &[RayRecord]) -> (u64, u64) {
    let places = scene.places();
    let primitive = |triangle, instance| match triangle {
        NO_TRIANGLE => Primitive::NONE,
        triangle => {
            let (number, instance) = scene.number_of(TriangleName { instance, triangle });
            Primitive { triangle: places[number as usize], instance }
        }
    };
    let work = rays.iter().map(|record| {
        let leaves = primitive(record.leaves, record.leaves_instance);
        let ray = Ray { origin: record.origin.into(), direction: record.direction.into(), leaves };
        match class {
            RayClass::Shadow => {
                let target = primitive(record.target, record.target_instance);
                let limit = if record.target == NO_TRIANGLE { f32::MAX } else { 1.0 };
                count_any(&scene.bvh, &scene.triangles, &ray, target, limit).1
            }
            RayClass::Camera | RayClass::Bounce => count_closest(&scene.bvh, &scene.triangles, &ray).1,
        }
    });
    work.fold((0, 0), |(nodes, triangles), work| (nodes + work.nodes, triangles + work.triangles))
}

#[test]
fn rays_are_dumped_and_replayed_by_triangle_and_instance() {
    let device = device();
    let scene = orchard();
    let settings = Settings { samples: 4, scheduler: Some(Scheduler::Wavefront), ..scene.settings };
    let flat = prepared(&scene, BvhKind::Bvh2, Instances::Flatten);
    let placed = prepared(&scene, BvhKind::Bvh2, Instances::TwoLevel);
    for (class, bounce) in [(RayClass::Camera, 0), (RayClass::Bounce, 1), (RayClass::Shadow, 1)] {
        let rays = dump(&device, &placed, &settings, class, bounce);
        assert_eq!(dump(&device, &flat, &settings, class, bounce), rays, "a dump does not hang on the tree");
        assert_eq!(distances(&flat, class, &rays), distances(&placed, class, &rays));
        if class != RayClass::Camera {
            assert!((0..5).all(|instance| rays.iter().any(|ray| ray.leaves_instance == instance)), "some leave each");
        }
        for scene in [&flat, &placed] {
            // It holds them against the CPU.
            let mut replay = Replay::new(&device, scene, &settings, class, &rays, 1).expect("the replay starts");
            let outcome = replay.run(0).expect("the device finds what the CPU finds");
            assert!(outcome.checked == rays.len() as u64 && outcome.hits > 0);
        }
        let work: WorkCount =
            Replay::count_work(&device, &placed, &settings, class, &rays).expect("the rays are counted");
        assert_eq!((work.nodes(), work.triangles()), work_on_cpu(&placed, class, &rays));
    }
    assert_silent(&device);
}
