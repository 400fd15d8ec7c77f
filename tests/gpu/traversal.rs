//! Traversal on the device: against the CPU's walk of the same nodes, against brute force in f64,
//! and where floating point likes to leak.

use crate::common::{device, gallery, own_scene, samples_on};
use crate::meshes::{Mesh, ball, cuboid, placed, soup};
use crate::probe::{Bench, Uniform, lanes, scene_of};
use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3, Vec3};
use raywave::bvh::{self, Bvh, BvhKind, Ray};
use raywave::constants::{LEAF_BIT, LEAF_COUNT_SHIFT, NO_TRIANGLE};
use raywave::gpu::Device;
use raywave::layout::Node;
use raywave::scene::Scene;

/// Input of the probe `traversal`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Query {
    origin: [f32; 3],
    leaves: u32,
    direction: [f32; 3],
    target: u32,
    limit: f32,
    unused: [u32; 3],
}

impl Query {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        let (origin, direction) = (origin.to_array(), direction.to_array());
        Self { origin, leaves: NO_TRIANGLE, direction, target: NO_TRIANGLE, limit: f32::MAX, unused: [0; 3] }
    }

    fn ray(&self) -> Ray {
        Ray { origin: self.origin.into(), direction: self.direction.into(), leaves: self.leaves.into() }
    }
}

/// Output of the probe `traversal`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Answer {
    triangle: u32,
    barycentrics: [f32; 2],
    distance: f32,
    blocked: u32,
    deepest_stack: u32,
    unused: [u32; 2],
}

/// Corners of a triangle in leaf order, exactly as the device has them.
fn corners(bench: &Bench, place: usize) -> [DVec3; 3] {
    let triangle = &bench.scene.triangles[place];
    [triangle.v0, triangle.v1, triangle.v2].map(|v| Vec3::from(v).as_dvec3())
}

/// Rays of every kind through a scene.
fn rays_through(bench: &Bench, count: usize, random: &mut Uniform) -> Vec<Query> {
    let places = bench.scene.triangles.len();
    let point = |random: &mut Uniform| 3.0 * Vec3::from(random.next::<3>()) - 1.5;
    (0..count)
        .map(|i| {
            let [pick, leaves, target, limit] = random.next();
            let place = |x: f32| (f64::from(x) * places as f64) as usize;
            let [a, b, c] = corners(bench, place(pick)).map(|v| v.as_vec3());
            let origin = point(random);
            let free = random.direction().as_vec3();
            let axis = Vec3::from(std::array::from_fn(|axis| if axis == i / 8 % 3 { free.x.signum() } else { -0.0 }));
            let (origin, direction) = match i % 8 {
                // Anywhere, and of any length.
                0 => (origin, free),
                1 => (origin, free * (16.0 * limit - 8.0).exp2()),
                // Along an axis, and through a vertex along an axis, where slabs have zero width.
                2 => (origin, axis),
                3 => (a - 2.0 * axis, axis),
                // At a vertex, at an edge, at a face.
                4 => (origin, a - origin),
                5 => (origin, a.lerp(b, limit) - origin),
                6 => (origin, (a + b + c) / 3.0 - origin),
                // In the plane of a triangle.
                _ => (a + 2.0 * (a - b), b - a),
            };
            let leaves = if leaves < 0.5 { NO_TRIANGLE } else { place(2.0 * leaves - 1.0) as u32 };
            let target = if target < 0.5 { NO_TRIANGLE } else { place(2.0 * target - 1.0) as u32 };
            Query { leaves, target, limit: 4.0 * limit, ..Query::new(origin, direction) }
        })
        .filter(|query| Vec3::from(query.direction) != Vec3::ZERO)
        .collect()
}

/// The probes that walk a tree of that kind: by single rays and, if it is wide and the device can have them, by packets.
fn probes(device: &Device, kind: BvhKind) -> &'static [&'static str] {
    match kind {
        BvhKind::Bvh4 | BvhKind::Cwbvh if device.description().packets() => &["traversal", "traversal_packets"],
        _ => &["traversal"],
    }
}

/// Checks that the device finds, bit by bit, what the CPU finds in the same arithmetic.
fn agrees_with_the_cpu(bench: &Bench, queries: &[Query], answers: &[Answer]) {
    let (hierarchy, triangles) = (&bench.scene.bvh, &bench.scene.triangles);
    for (query, answer) in queries.iter().zip(answers) {
        let expected = bvh::trace_closest(hierarchy, triangles, &query.ray());
        let found = (answer.triangle != NO_TRIANGLE).then_some(bvh::Hit {
            triangle: answer.triangle,
            instance: 0,
            barycentrics: answer.barycentrics,
            distance: answer.distance,
        });
        assert_eq!(found, expected, "{query:?}");
        let blocked = bvh::trace_any(hierarchy, triangles, &query.ray(), query.target, query.limit);
        assert_eq!(answer.blocked != 0, blocked, "{query:?}");
        assert!(answer.deepest_stack <= bench.scene.needs(&bench.settings).stack_size, "{query:?}");
    }
}

/// Where a ray meets a triangle's plane, and how far f32 can be off.
struct Meeting {
    distance: f64,
    distance_error: f64,
    /// The least of the barycentrics: the hit is inside when it is above 0.
    least: f64,
    least_error: f64,
}

fn meet(query: &Query, [a, b, c]: [DVec3; 3]) -> Option<Meeting> {
    let (origin, direction) = (Vec3::from(query.origin).as_dvec3(), Vec3::from(query.direction).as_dvec3());
    // (Moeller and Trumbore 1997)
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    let q = (origin - a).cross(ab);
    let (u, v, t) = ((origin - a).dot(p), direction.dot(q), ac.dot(q));
    let [u, v, distance] = [u, v, t].map(|x| x / determinant);
    // The device computes edges from vertices that it moved to the ray, each with a rounding.
    let length = direction.length();
    let reach = [a, b, c].iter().map(|v| (*v - origin).length()).fold(0.0, f64::max);
    let extent = ab.length().max(ac.length()).max((b - c).length());
    let rounding = 1e-6 * reach;
    let least_error = rounding * length * (extent + rounding) / determinant.abs();
    let distance_error = (rounding + extent * least_error) / length;
    // A triangle that is seen on edge may be met or not.
    (least_error < 0.1).then_some(Meeting { distance, distance_error, least: u.min(v).min(1.0 - u - v), least_error })
}

/// Checks that every hit is one in exact arithmetic, and that nothing nearer was missed.
fn agrees_with_brute_force(bench: &Bench, queries: &[Query], answers: &[Answer]) {
    let all: Vec<_> = (0..bench.scene.triangles.len()).map(|place| corners(bench, place)).collect();
    for (query, answer) in queries.iter().zip(answers) {
        if let Some(hit) = all.get(answer.triangle as usize).and_then(|corners| meet(query, *corners)) {
            assert!(hit.least > -hit.least_error, "{query:?}: {answer:?} lies outside by {}", hit.least);
            let off = (f64::from(answer.distance) - hit.distance).abs();
            assert!(off < hit.distance_error, "{query:?}: {answer:?} is off by {off}");
        }
        for (place, corners) in all.iter().enumerate().filter(|(place, _)| *place as u32 != query.leaves) {
            let Some(meeting) = meet(query, *corners) else { continue };
            let met = meeting.least > meeting.least_error && meeting.distance > meeting.distance_error;
            let nearer = meeting.distance + 2.0 * meeting.distance_error < f64::from(answer.distance);
            assert!(!(met && nearer), "{query:?}: {answer:?} misses {place} at {}", meeting.distance);
            let blocks = meeting.distance + meeting.distance_error < query.limit.into() && place as u32 != query.target;
            assert!(!(met && blocks) || answer.blocked != 0, "{query:?}: {place} does not block");
        }
    }
}

fn check(device: &Device, scene: &Scene, count: usize) {
    for kind in BvhKind::all_of(scene.mesh.triangles.len()) {
        check_kind(device, scene, count, kind);
    }
}

fn check_kind(device: &Device, scene: &Scene, count: usize, kind: BvhKind) {
    let count = samples_on(device, count as u32) as usize;
    let bench = Bench::with_bvh(device, scene, kind);
    let queries = rays_through(&bench, count, &mut Uniform::new(count as u64));
    for probe in probes(device, kind) {
        let answers: Vec<Answer> = bench.run(probe, &queries);
        agrees_with_the_cpu(&bench, &queries, &answers);
        let few = (4_000_000 / bench.scene.triangles.len()).min(queries.len());
        agrees_with_brute_force(&bench, &queries[..few], &answers[..few]);
        let hits = answers.iter().filter(|answer| answer.triangle != NO_TRIANGLE).count();
        assert!(hits > count / 10, "{hits} of {count} rays hit something");
    }
}

#[test]
fn own_scenes_are_traced_as_on_the_cpu_and_as_in_f64() {
    let device = device();
    check(&device, &own_scene("cornell-box"), 100_000);
    check(&device, &own_scene("furnace"), 20_000);
    check(&device, &gallery(20_000), 40_000);
}

/// Ends of a long rod of many narrow faces, and rays that leave one of them near the edge to its neighbour.
fn rays_off_slivers(bench: &Bench, count: usize, random: &mut Uniform) -> Vec<Query> {
    let places = bench.scene.triangles.len();
    let ray = |random: &mut Uniform| {
        let [pick, along, across, tilt] = random.next::<4>().map(f64::from);
        let place = (pick * places as f64) as usize;
        let [a, b, c] = corners(bench, place);
        // Within a ten-thousandth of a width of an edge, all of which stand out.
        let near = 1e-4 * across;
        let point = a.lerp(b, along).lerp(c, near * (1.0 - along)).as_vec3();
        let normal = (b - a).cross(c - a).normalize();
        let direction = random.direction();
        let direction = (if direction.dot(normal) < 0.0 { -direction } else { direction }) + 0.1 * tilt * normal;
        // As a path's rays do, from a rounding above the face.
        let origin = point + (1.25 * 21.0 * 5.96e-8 * point.abs().element_sum()) * normal.as_vec3();
        let mut query = Query::new(origin, direction.as_vec3());
        query.leaves = place as u32;
        query
    };
    (0..count).map(|_| ray(random)).collect()
}

/// A rod along x of `sides` faces.
fn rod(sides: u32, radius: f64) -> Mesh {
    let point = |side: u32, x: f64| {
        let angle = std::f64::consts::TAU * f64::from(side % sides) / f64::from(sides);
        DVec3::new(x, radius * angle.cos(), radius * angle.sin())
    };
    let face = |side| {
        let [a, b] = [point(side, -1.0), point(side + 1, -1.0)];
        let [c, d] = [point(side + 1, 1.0), point(side, 1.0)];
        let (low, high) = (DVec3::NEG_X, DVec3::X);
        [[a, b, c], [a, c, d], [a, low, b], [d, c, high]]
    };
    (0..sides).flat_map(face).collect()
}

#[test]
fn rays_that_leave_a_convex_body_of_slivers_miss_it() {
    let device = device();
    let count = samples_on(&device, 400_000) as usize;
    for (sides, radius) in [(16, 0.05), (12, 0.01)] {
        let scene = scene_of(&placed(&rod(sides, radius), DMat3::from_rotation_y(0.3), 1.0, DVec3::ZERO));
        for kind in BvhKind::all_of(scene.mesh.triangles.len()) {
            let bench = Bench::with_bvh(&device, &scene, kind);
            assert!(bench.scene.bvh.has_thin_triangles);
            let queries = rays_off_slivers(&bench, count, &mut Uniform::new(u64::from(sides)));
            for probe in probes(&device, kind) {
                let answers: Vec<Answer> = bench.run(probe, &queries);
                agrees_with_the_cpu(&bench, &queries, &answers);
                let wrong = answers.iter().filter(|a| a.triangle != NO_TRIANGLE || a.blocked != 0).count();
                assert_eq!(wrong, 0, "{kind:?}, {sides} sides: of {count} rays some hit what they leave");
            }
        }
    }
}

#[test]
fn soups_and_degenerate_triangles_are_traced_as_on_the_cpu_and_as_in_f64() {
    let device = device();
    let mut random = Uniform::new(1);
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let coplanar = |random: &mut Uniform| -> Mesh {
        soup(100, 1.0, 1.0, random).iter().map(|t| t.map(|v| v.with_z(0.0))).collect()
    };
    let mut nothing_and_something = vec![[DVec3::ONE; 3], [DVec3::ZERO, DVec3::X, 0.5 * DVec3::X]];
    nothing_and_something.extend(cuboid(DVec3::NEG_ONE, DVec3::ONE));
    for mesh in [
        soup(1000, 0.3, 1.0, &mut random),
        soup(1000, 2.0, 1.0, &mut random),
        soup(500, 1.0, 1e-3, &mut random),
        soup(500, 1.0, 1e-6, &mut random),
        vec![triangle],
        vec![triangle; 300],
        coplanar(&mut random),
        [coplanar(&mut random), soup(100, 1.0, 1e-3, &mut random)].concat(),
        nothing_and_something,
    ] {
        check(&device, &scene_of(&mesh), 20_000);
    }
}

#[test]
fn of_equally_near_triangles_the_first_of_the_scene_is_hit() {
    let device = device();
    for count in [60, 300] {
        let scene = scene_of(&vec![[DVec3::ZERO, DVec3::X, DVec3::Y]; count]);
        for kind in BvhKind::all_of(count) {
            for probe in probes(&device, kind) {
                the_first_is_hit(&Bench::with_bvh(&device, &scene, kind), probe);
            }
        }
    }
}

fn the_first_is_hit(bench: &Bench, probe: &str) {
    let mut random = Uniform::new(2);
    let [a, b, c] = corners(bench, 0).map(|v| v.as_vec3());
    let queries: Vec<_> = (0..1000)
        .map(|_| {
            let target = a + 0.3 * (b - a) + 0.3 * (c - a);
            let origin = Vec3::from(random.next::<3>()) + Vec3::Z;
            Query::new(origin, target - origin)
        })
        .collect();
    let answers: Vec<Answer> = bench.run(probe, &queries);
    for answer in answers {
        assert_eq!(bench.scene.triangles[answer.triangle as usize].original, 0);
    }
}

#[test]
fn no_ray_leaks_out_of_a_closed_body() {
    let device = device();
    let (rays, least) =
        if device.description().driver.contains("Mesa") { (870_000, 10_000_000) } else { (100_000, 1_000_000) };
    let mut random = Uniform::new(3);
    let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.3, 0.5, 0.7);
    let bodies = [
        ball(24, 16),
        placed(&ball(100, 50), turn, 0.01, DVec3::new(1000.0, -300.0, 70.0)),
        cuboid(DVec3::new(-1.0, -0.7, -0.3), DVec3::new(1.0, 0.7, 0.3)),
        placed(&cuboid(DVec3::NEG_ONE, DVec3::ONE), turn, 3.0, DVec3::ONE),
    ];
    let mut traced = 0;
    for (body, kind) in bodies.iter().flat_map(|body| BvhKind::all_of(body.len()).map(move |kind| (body, kind))) {
        let bench = Bench::with_bvh(&device, &scene_of(body), kind);
        let all: Vec<_> = (0..body.len()).map(|place| corners(&bench, place).map(|v| v.as_vec3())).collect();
        let middle = all.as_flattened().iter().sum::<Vec3>() / (3 * all.len()) as f32;
        let queries: Vec<_> = (0..rays)
            .map(|i| {
                let [pick, at, x, y, z] = random.next();
                let [a, b, c] = all[(f64::from(pick) * all.len() as f64) as usize];
                // Well inside: the bodies are convex, and hold the half of themselves.
                let origin = middle + 0.5 * (all[i % all.len()][0] - middle) * x + 0.05 * (Vec3::new(x, y, z) - 0.5);
                let target = match i % 4 {
                    0 => a,
                    1 => a.lerp(b, at),
                    2 => b.lerp(c, (at * 8.0).floor() / 8.0),
                    _ => c.lerp(a, 0.5),
                };
                let direction = target - origin;
                Query::new(origin, if i % 8 < 4 { direction } else { direction.normalize() })
            })
            .collect();
        for probe in probes(&device, kind) {
            let answers: Vec<Answer> = bench.run(probe, &queries);
            let leaks = answers.iter().filter(|answer| answer.triangle == NO_TRIANGLE || answer.blocked == 0).count();
            assert_eq!(leaks, 0, "leaks out of a body of {} triangles, {kind:?}, {probe}", body.len());
        }
        traced += queries.len();
    }
    assert!(traced >= least, "{traced} rays say less than they should");
}

/// Input of the probe `leave`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct LeaveQuery {
    triangle: u32,
    barycentrics: [f32; 2],
    unused: u32,
    direction: [f32; 4],
}

/// Output of the probe `leave`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct LeaveAnswer {
    origin: [f32; 3],
    distance: f32,
    triangle: u32,
    unused: [u32; 3],
}

#[test]
fn rays_that_leave_a_convex_body_never_hit_it_and_rays_into_it_always_do() {
    const RAYS: usize = 1 << 18;
    let device = device();
    let mut random = Uniform::new(4);
    let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.3, 0.5, 0.7);
    let far = [[DVec3::splat(5000.0), DVec3::new(5000.0, 5000.0, 5001.0), DVec3::new(5000.0, 5001.0, 5000.0)]];
    let bodies = [
        ball(40, 20),
        placed(&cuboid(DVec3::NEG_ONE, DVec3::ONE), turn, 1.0, DVec3::new(0.3, 0.2, 0.1)),
        cuboid(DVec3::new(-1.0, -0.01, -1.0), DVec3::new(1.0, 0.01, 1.0)),
        placed(&ball(40, 20), turn, 30.0, DVec3::splat(100.0)),
        placed(&cuboid(DVec3::NEG_ONE, DVec3::ONE), turn, 1.0, DVec3::ZERO),
    ];
    for (i, body) in bodies.iter().enumerate() {
        // The last bodies are small in their scene: lengths are few roundings of coordinates.
        let rest = if i < 3 { &[] } else { &far[..] };
        let bench = Bench::new(&device, &scene_of(&[body, rest].concat()));
        let is_own = |place: u32| (bench.scene.triangles[place as usize].original as usize) < body.len();
        let own: Vec<u32> = (0..bench.scene.triangles.len() as u32).filter(|place| is_own(*place)).collect();
        let queries: Vec<_> = (0..RAYS)
            .map(|i| {
                let [pick, u, v] = random.next();
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                // Rays out start at corners and edges too.
                let barycentrics = match i % 8 {
                    0 => [0.0, 0.0],
                    1 => [0.0, 1.0],
                    2 => [u, 0.0],
                    3 => [u, 1.0 - u],
                    _ => [0.02 + 0.94 * u, 0.02 + 0.94 * v],
                };
                let triangle = own[(f64::from(pick) * own.len() as f64) as usize];
                LeaveQuery { triangle, barycentrics, unused: 0, direction: lanes(random.direction()) }
            })
            .collect();
        let answers: Vec<LeaveAnswer> = bench.run("leave", &queries);
        let (mut out, mut into, mut grazes) = (0, 0, 0);
        for (i, (query, answer)) in queries.iter().zip(&answers).enumerate() {
            let [a, b, c] = corners(&bench, query.triangle as usize);
            let normal = (b - a).cross(c - a).normalize();
            let slope = normal.dot(Vec3::from_slice(&query.direction[..3]).as_dvec3());
            let on_body = answer.triangle != NO_TRIANGLE && is_own(answer.triangle);
            let on_edge = i % 8 < 4;
            if slope > 1e-6 {
                // Rounding can put the start of a ray from an edge behind the face beside it.
                grazes += u32::from(on_body && on_edge);
                assert!(!on_body || on_edge, "{query:?}, slope {slope:e}, hits its own body: {answer:?}");
                out += 1;
            } else if slope < -1e-6 && !on_edge {
                assert!(on_body, "{query:?}, slope {slope:e}, leaves through the body: {answer:?}");
                into += 1;
            }
        }
        assert!(out > RAYS / 3 && into > RAYS / 8);
        assert!(grazes < RAYS as u32 / 10_000, "{grazes} rays from an edge hit the face beside it");
    }
}

#[test]
fn the_stack_takes_as_much_as_the_depth_says_and_no_more() {
    const LEVELS: u32 = 80;
    // Every node has a leaf and the next node, both entered at once: the worst of that depth.
    let mesh: Mesh = (0..=LEVELS)
        .map(|i| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|v| v + DVec3::Z * f64::from(i) / f64::from(LEVELS)))
        .collect();
    let mut bench = Bench::new(&device(), &scene_of(&mesh));
    let (low, high) = ([-2.0; 3], [2.0; 3]);
    let leaf = |place: u32| LEAF_BIT | 1 << LEAF_COUNT_SHIFT | place;
    let node = |level: u32| Node {
        left_low: low,
        left: if level + 1 < LEVELS { level + 1 } else { leaf(LEVELS) },
        left_high: high,
        unused0: 0,
        right_low: low,
        right: leaf(level),
        right_high: high,
        unused1: 0,
    };
    let texels = (0..LEVELS).flat_map(|level| bytemuck::cast::<Node, [[u32; 4]; 4]>(node(level))).collect();
    bench.scene.bvh = Bvh { texels, depth: LEVELS, ..Bvh::build(BvhKind::Bvh2, &[[Vec3::ZERO; 3]]) };
    bench.scene.bvh.order = bench.scene.triangles.iter().map(|triangle| triangle.original).collect();
    let queries = rays_through(&bench, 10_000, &mut Uniform::new(5));
    let answers: Vec<Answer> = bench.run("traversal", &queries);
    agrees_with_the_cpu(&bench, &queries, &answers);
    agrees_with_brute_force(&bench, &queries, &answers);
    assert!(answers.iter().any(|answer| answer.deepest_stack == LEVELS));
    // A ray that enters nothing leaves it empty.
    let miss: Vec<Answer> = bench.run("traversal", &[Query::new(Vec3::splat(3.0), Vec3::ONE)]);
    assert_eq!((miss[0].triangle, miss[0].deepest_stack), (NO_TRIANGLE, 0));
}
