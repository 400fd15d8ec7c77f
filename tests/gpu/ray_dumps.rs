//! Queues frozen and replayed: dumps hold the rays that the renderer counts, in the scene's terms, the same bits every
//! time; and a replay finds of them what the CPU finds.

use std::ops::ControlFlow;

use crate::common::{assert_silent, device, gallery, own_scene};
use glam::{DVec3, Vec3};
use raywave::bvh::{BvhKind, Ray, count_any, count_closest, trace_any, trace_closest};
use raywave::constants::NO_TRIANGLE;
use raywave::gpu::Device;
use raywave::rays::{RayClass, RayOrder, RayRecord};
use raywave::render::{PreparedScene, QueuedRays, RenderError, Replay, Session, distances};
use raywave::scene::Scene;
use raywave::settings::{Integrator, Scheduler, Settings, ShadowRays};

const SIZE: u32 = 20;
const SAMPLES: u32 = 3;
const PATHS: u32 = SIZE * SIZE * SAMPLES;

fn settings(scene: &Scene) -> Settings {
    Settings { width: SIZE, height: SIZE, samples: SAMPLES, ..scene.settings }
}

fn class(bounce: u32) -> RayClass {
    if bounce == 0 { RayClass::Camera } else { RayClass::Bounce }
}

fn prepared(scene: &Scene) -> PreparedScene {
    PreparedScene::new(scene).expect("the scene fits")
}

/// Dumps rays in a session of its own.
fn dump(device: &Device, scene: &PreparedScene, settings: &Settings, class: RayClass, bounce: u32) -> QueuedRays {
    let mut session = Session::new(device, scene, settings).expect("the session starts");
    let queued = dump_all(&mut session, scene, class, bounce);
    drop(session);
    assert_silent(device);
    queued
}

fn dump_all(session: &mut Session, scene: &PreparedScene, class: RayClass, bounce: u32) -> QueuedRays {
    let queued = session.dump_rays(scene, class, bounce, RayOrder::Slot).expect("there are rays");
    assert_eq!(queued.left_out, 0);
    queued
}

/// Dumps rays of several queues, in a session of their own.
fn dumps(
    device: &Device,
    scene: &PreparedScene,
    settings: &Settings,
    queues: &[(RayClass, u32)],
) -> Vec<Vec<RayRecord>> {
    let mut session = Session::new(device, scene, settings).expect("the session starts");
    let rays = queues.iter().map(|(class, bounce)| dump_all(&mut session, scene, *class, *bounce).rays).collect();
    drop(session);
    assert_silent(device);
    rays
}

fn bits(rays: &[RayRecord]) -> &[u32] {
    bytemuck::cast_slice(rays)
}

#[test]
fn every_bounce_holds_the_rays_that_a_render_counts() {
    let device = device();
    for name in ["cornell-box", "cornell-glass"] {
        let scene = own_scene(name);
        for integrator in [Integrator::Implicit, Integrator::Explicit] {
            let settings = Settings { integrator, ..settings(&scene) };
            let prepared = prepared(&scene);
            let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
            let counts = session.render(|_| ControlFlow::Continue(())).expect("the render ends").statistics.ray_counts;
            assert_eq!(counts[0].rays(), u64::from(PATHS));
            let mut check = |class, bounce, expected: u64, last: Option<usize>| match session.dump_rays(
                &prepared,
                class,
                bounce,
                RayOrder::Slot,
            ) {
                Ok(queued) => {
                    assert_eq!(queued.rays.len() as u64, expected, "{name} {class:?} {bounce}");
                    let batch = (queued.batch.pixel_count, queued.batch.sample_count);
                    assert_eq!(batch, (SIZE * SIZE, SAMPLES));
                }
                Err(RenderError::NoRays { last: told, .. }) => {
                    assert_eq!(expected, 0, "{name} {class:?} {bounce}");
                    assert_eq!(told, last.map(|last| last as u32), "{name} {class:?} {bounce}");
                }
                Err(error) => panic!("{error}"),
            };
            for bounce in 0..11 {
                let earlier = &counts[..bounce as usize];
                let last = earlier.iter().rposition(|count| count.rays() > 0);
                check(class(bounce), bounce, counts[bounce as usize].rays(), last);
                let last = earlier.iter().rposition(|count| count.shadow_rays() > 0);
                check(RayClass::Shadow, bounce, counts[bounce as usize].shadow_rays(), last);
            }
        }
    }
    assert_silent(&device);
}

#[test]
fn dumps_are_the_same_to_the_last_bit() {
    let device = device();
    let scene = own_scene("cornell-glass");
    let prepared = prepared(&scene);
    let classes = [(RayClass::Camera, 0), (RayClass::Bounce, 2), (RayClass::Shadow, 1)];
    let rays_by = |scheduler, in_flight, workgroup_size| {
        dumps(&device, &prepared, &Settings { scheduler, in_flight, workgroup_size, ..settings(&scene) }, &classes)
    };
    let reference = rays_by(None, None, None);
    assert!(reference.iter().all(|rays| rays.len() > 100));
    for (scheduler, in_flight, workgroup_size) in [
        (None, None, None),
        (None, Some(PATHS), Some(64)),
        (None, Some(PATHS + 77), Some(32)),
        (Some(Scheduler::Wavefront), None, None),
        (Some(Scheduler::Bounce), None, None),
    ] {
        let rays = rays_by(scheduler, in_flight, workgroup_size);
        for ((class, rays), reference) in classes.iter().zip(rays).zip(&reference) {
            let way = format!("{class:?} {scheduler:?} {in_flight:?} {workgroup_size:?}");
            assert!(bits(&rays) == bits(reference), "{way}");
        }
    }
    // Fewer in flight are the first pixels.
    for (fewer, reference) in rays_by(None, Some(SIZE * SIZE + 1), None).iter().zip(&reference) {
        assert!(fewer.len() < reference.len() && bits(reference).starts_with(bits(fewer)));
    }
    // Enough workgroups that the order of the queue is left to chance where it can be.
    let many = Settings { width: 256, height: 256, samples: 1, workgroup_size: Some(32), ..settings(&scene) };
    let many = || dumps(&device, &prepared, &many, &[(RayClass::Bounce, 1), (RayClass::Shadow, 1)]);
    for (once, again) in many().iter().zip(many()) {
        assert!(bits(once) == bits(&again));
    }
    let few = Settings { in_flight: Some(50), ..settings(&scene) };
    let batch = dump(&device, &prepared, &few, RayClass::Camera, 0).batch;
    assert_eq!(
        (batch.first_pixel, batch.pixel_count, batch.first_sample, batch.sample_count),
        (0, 50 / SAMPLES, 0, SAMPLES)
    );
}

#[test]
fn the_order_of_the_queue_holds_the_same_rays() {
    let device = device();
    let scene = own_scene("cornell-box");
    let prepared = prepared(&scene);
    let mut session = Session::new(&device, &prepared, &settings(&scene)).expect("the session starts");
    for class in [RayClass::Bounce, RayClass::Shadow] {
        let [slot, queue] = [RayOrder::Slot, RayOrder::Queue].map(|order| {
            let queued = session.dump_rays(&prepared, class, 1, order).expect("there are rays");
            let mut rays: Vec<[u32; 10]> = queued.rays.into_iter().map(bytemuck::cast).collect();
            rays.sort_unstable();
            rays
        });
        assert!(slot == queue, "{class:?}");
    }
}

/// Signed distance of a point to the plane of a triangle of the scene, in world units, and whether it is above the
/// triangle but for rounding.
fn over(scene: &Scene, triangle: u32, point: DVec3) -> (f64, bool) {
    let [a, b, c] = scene.mesh.triangles[triangle as usize].positions.map(|i| scene.mesh.positions[i as usize]);
    let normal = (b - a).cross(c - a);
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|(from, to)| (to - from).cross(point - from).dot(normal) > -1e-5 * normal.length_squared());
    (normal.normalize().dot(point - a), inside)
}

#[test]
fn dumps_lie_in_the_scene_and_not_in_the_bvh() {
    const NEAR: f64 = 1e-5;
    let device = device();
    let scene = own_scene("cornell-box");
    let prepared = prepared(&scene);
    assert!(prepared.triangles.iter().zip(0..).any(|(t, place)| t.original != place), "the orders differ");
    let world = |point: Vec3| point.as_dvec3() / prepared.normalisation.scale + prepared.normalisation.centre;
    let lights: Vec<u32> = scene.light_triangles().collect();
    let queues = [(RayClass::Camera, 0), (RayClass::Bounce, 1), (RayClass::Shadow, 0), (RayClass::Shadow, 2)];
    for ((class, _), rays) in queues.into_iter().zip(dumps(&device, &prepared, &settings(&scene), &queues)) {
        for ray in rays {
            let (origin, direction) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
            if class == RayClass::Camera {
                assert!((world(origin) - scene.camera.eye).length() < NEAR, "{ray:?} starts at the eye");
                assert_eq!((ray.leaves, ray.target), (NO_TRIANGLE, NO_TRIANGLE));
                continue;
            }
            let (height, inside) = over(&scene, ray.leaves, world(origin));
            assert!(height.abs() < NEAR && inside, "{ray:?} starts {height} off its triangle");
            if class == RayClass::Shadow {
                assert!(lights.contains(&ray.target), "{ray:?} aims at a lamp");
                let (height, inside) = over(&scene, ray.target, world(origin + direction));
                assert!(height.abs() < NEAR && inside, "{ray:?} ends {height} off its lamp");
            } else {
                assert_eq!(ray.target, NO_TRIANGLE);
            }
        }
    }
}

/// How many of the rays meet something on the CPU.
fn hits_on_cpu(scene: &PreparedScene, class: RayClass, rays: &[RayRecord]) -> u64 {
    let place = |original: u32| match original {
        NO_TRIANGLE => NO_TRIANGLE,
        original => scene.bvh.order.iter().position(|t| *t == original).expect("every triangle has a place") as u32,
    };
    let is_hit = |ray: &&RayRecord| {
        let RayRecord { origin, leaves, direction, target, .. } = **ray;
        let traced = Ray { origin: origin.into(), direction: direction.into(), leaves: place(leaves).into() };
        if class == RayClass::Shadow {
            let limit = if target == NO_TRIANGLE { f32::MAX } else { 1.0 };
            trace_any(&scene.bvh, &scene.triangles, &traced, place(target), limit)
        } else {
            trace_closest(&scene.bvh, &scene.triangles, &traced).is_some()
        }
    };
    rays.iter().filter(is_hit).count() as u64
}

#[test]
fn replays_find_what_the_cpu_finds() {
    let device = device();
    // The gallery's stacks outgrow the registers; the sky is a light without a triangle.
    for scene in [own_scene("cornell-box"), own_scene("textured-sky"), gallery(5_000)] {
        let prepared = prepared(&scene);
        let queues = [(RayClass::Camera, 0), (RayClass::Bounce, 1), (RayClass::Shadow, 0)];
        for ((class, _), rays) in queues.into_iter().zip(dumps(&device, &prepared, &settings(&scene), &queues)) {
            let total = rays.len() as u64;
            let hits = hits_on_cpu(&prepared, class, &rays);
            assert!(hits > 0, "{} {class:?}: nothing is hit", scene.name);
            for (in_flight, workgroup_size, repeat, rounds) in [
                (None, None, 1, 2),
                (Some(100), Some(64), 1, 1),
                (Some(total as u32 / 2 + 1), None, 3, 3),
                (Some(7), None, 1, 0),
            ] {
                let settings = Settings { in_flight, workgroup_size, ..settings(&scene) };
                let mut replay = Replay::new(&device, &prepared, &settings, class, &rays, repeat).expect("it starts");
                let outcome = replay.run(rounds).expect("the answers are right");
                drop(replay);
                assert_silent(&device);
                let all = total * u64::from(repeat);
                assert_eq!((outcome.rays, outcome.checked), (all, total));
                assert_eq!(outcome.hits, hits * u64::from(repeat), "{} {class:?} {in_flight:?}", scene.name);
                assert_eq!(outcome.launches, in_flight.map_or(1, |n| all.div_ceil(n.into())));
                assert_eq!(outcome.seconds.len(), rounds);
                assert!(outcome.seconds.iter().all(|seconds| *seconds > 0.0));
                assert_eq!(outcome.kernel, if class == RayClass::Shadow { "connect" } else { "extend" });
            }
        }
    }
}

/// What a search of all triangles finds of a ray, in f64 and without a BVH: as `distances`.
fn search(corners: &[[[f32; 3]; 3]], class: RayClass, ray: &RayRecord) -> f64 {
    let [origin, direction] = [ray.origin, ray.direction].map(|v| Vec3::from(v).as_dvec3());
    let distance = |corners: &[[f32; 3]; 3]| {
        let [a, b, c] = corners.map(|v| Vec3::from(v).as_dvec3() - origin);
        let (n, edges) = ((b - a).cross(c - a), [(b, c), (c, a), (a, b)]);
        let sides = edges.map(|(from, to)| direction.dot(from.cross(to)));
        let inside = sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0);
        Some(a.dot(n) / direction.dot(n)).filter(|distance| inside && *distance > 0.0)
    };
    let others = (0..).zip(corners).filter(|(number, _)| *number != ray.leaves && *number != ray.target);
    let nearest = others.filter_map(|(_, corners)| distance(corners)).fold(f64::INFINITY, f64::min);
    match class {
        RayClass::Shadow if ray.target != NO_TRIANGLE && nearest >= 1.0 => f64::INFINITY,
        RayClass::Shadow if nearest.is_finite() => 0.0,
        _ => nearest,
    }
}

#[test]
fn triangles_and_distances_are_those_that_a_search_finds() {
    let device = device();
    for scene in [own_scene("cornell-glass"), own_scene("textured-sky")] {
        let prepared = prepared(&scene);
        let corners = prepared.corners();
        assert_eq!(corners.len(), scene.mesh.triangles.len());
        let queues = [(RayClass::Camera, 0), (RayClass::Bounce, 1), (RayClass::Shadow, 0)];
        for ((class, _), rays) in queues.into_iter().zip(dumps(&device, &prepared, &settings(&scene), &queues)) {
            let found = distances(&prepared, class, &rays);
            let expected: Vec<_> = rays.iter().map(|ray| search(&corners, class, ray)).collect();
            let differ = |(found, expected): (&f32, &f64)| {
                let found = f64::from(*found);
                found.is_finite() != expected.is_finite()
                    || found.is_finite() && (found - expected).abs() > 1e-4 * expected.max(1e-3)
            };
            let wrong = found.iter().zip(&expected).filter(|pair| differ(*pair)).count();
            // f64 may pass an edge on the other side.
            assert!(wrong <= 1, "{} {class:?}: {wrong} of {} differ", scene.name, rays.len());
            let hits = found.iter().filter(|distance| distance.is_finite()).count();
            assert!(hits > 0, "{} {class:?}: nothing is hit", scene.name);
            for kind in [BvhKind::Bvh2, BvhKind::Bvh4] {
                let other = PreparedScene::with_bvh(&scene, kind).expect("the scene fits");
                assert!(other.corners() == corners && distances(&other, class, &rays) == found, "{kind:?}");
            }
        }
    }
}

#[test]
fn many_rays_are_checked_at_places_that_are_evenly_spread() {
    let device = device();
    let scene = own_scene("cornell-box");
    let prepared = prepared(&scene);
    let settings = Settings { width: 300, height: 300, samples: 1, ..settings(&scene) };
    let rays = dump(&device, &prepared, &settings, RayClass::Camera, 0).rays;
    assert_eq!(rays.len(), 90_000);
    let outcome = Replay::new(&device, &prepared, &settings, RayClass::Camera, &rays, 1)
        .expect("the replay starts")
        .run(1)
        .expect("the answers are right");
    assert_eq!((outcome.rays, outcome.checked), (90_000, 1 << 16));
    assert_eq!(outcome.hits, hits_on_cpu(&prepared, RayClass::Camera, &rays));
}

#[test]
fn rays_that_no_queue_holds_are_not_dumped() {
    let device = device();
    let scene = own_scene("cornell-box");
    let prepared = prepared(&scene);
    let result = |scheduler, class| {
        let settings = Settings { scheduler: Some(scheduler), shadow_rays: ShadowRays::AtOnce, ..settings(&scene) };
        let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
        session.dump_rays(&prepared, class, 0, RayOrder::Slot)
    };
    assert!(matches!(result(Scheduler::Megakernel, RayClass::Camera), Err(RenderError::NoQueues)));
    assert!(matches!(result(Scheduler::Bounce, RayClass::Shadow), Err(RenderError::NoShadowQueue)));
}

#[test]
fn the_device_counts_the_work_that_the_cpu_counts() {
    let device = device();
    for name in ["cornell-glass", "cornell-box"] {
        for kind in BvhKind::all_of(own_scene(name).mesh.triangles.len()) {
            counts_as_the_cpu(&device, &own_scene(name), kind);
        }
    }
    assert_silent(&device);
}

fn counts_as_the_cpu(device: &Device, scene: &Scene, kind: BvhKind) {
    // Of lists a device may prefer the megakernel, which has no queues to dump.
    let settings = Settings { scheduler: Some(Scheduler::Wavefront), ..settings(scene) };
    let prepared = PreparedScene::with_bvh(scene, kind).expect("the scene fits");
    let queues = [(RayClass::Camera, 0), (RayClass::Bounce, 3), (RayClass::Shadow, 1)];
    for ((class, _), rays) in queues.into_iter().zip(dumps(device, &prepared, &settings, &queues)) {
        let counted = Replay::count_work(device, &prepared, &settings, class, &rays).expect("the rays are counted");
        let mut places = vec![0; prepared.triangles.len()];
        for (place, original) in prepared.bvh.order.iter().enumerate() {
            places[*original as usize] = place as u32;
        }
        let place = |original: u32| if original == NO_TRIANGLE { NO_TRIANGLE } else { places[original as usize] };
        let work = rays.iter().map(|record| {
            let (origin, direction) = (Vec3::from(record.origin), Vec3::from(record.direction));
            let ray = Ray { origin, direction, leaves: place(record.leaves).into() };
            match class {
                // The scene has no environment: every shadow ray ends at a lamp.
                RayClass::Shadow => count_any(&prepared.bvh, &prepared.triangles, &ray, place(record.target), 1.0).1,
                _ => count_closest(&prepared.bvh, &prepared.triangles, &ray).1,
            }
        });
        let (nodes, triangles) = work.fold((0, 0), |(n, t), work| (n + work.nodes, t + work.triangles));
        assert!((nodes > 0 || kind == BvhKind::List) && triangles > 0);
        assert_eq!((counted.items(), counted.nodes(), counted.triangles()), (rays.len() as u64, nodes, triangles));
    }
}
