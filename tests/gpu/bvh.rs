//! The hierarchy itself, over whatever triangles: no GPU is asked.

use crate::meshes::{ball, cuboid, soup};
use crate::probe::Uniform;
use glam::{DMat3, DVec3, EulerRot, Vec3};
use proptest::prelude::*;
use raywave::bvh::{Bvh, BvhKind, Primitive, Ray, trace_any, trace_closest};
use raywave::constants::{
    LEAF_BIT, LEAF_COUNT_SHIFT, LEAF_MAX_TRIANGLES, NO_TRIANGLE, WIDE_INNER_BIT, WIDE_LEAF_TRIANGLES,
};
use raywave::layout::Triangle;

type Corners = [Vec3; 3];

fn triangles_of(bvh: &Bvh, corners: &[Corners]) -> Vec<Triangle> {
    let triangle = |&original: &u32| {
        let [v0, v1, v2] = corners[original as usize].map(|v| v.to_array());
        Triangle { v0, original, v1, material: 0, v2, light_area: 0.0 }
    };
    bvh.order.iter().map(triangle).collect()
}

/// Checks everything that the kernels rely on.
fn validate(corners: &[Corners]) -> Bvh {
    let bvh = Bvh::build(BvhKind::Bvh2, corners);
    let mut order = bvh.order.clone();
    order.sort_unstable();
    assert!(order.iter().copied().eq(0..corners.len() as u32), "every triangle is in the order once");

    let nodes = bvh.binary_nodes();
    let mut visited = vec![false; nodes.len()];
    let mut held = vec![0; corners.len()];
    let (mut depth, mut leaves) = (0, 0);
    // (node, inner nodes down to it, the box that its parent gives it)
    let mut open = vec![(0_u32, 1, [Vec3::NEG_INFINITY, Vec3::INFINITY])];
    while let Some((index, level, [low, high])) = open.pop() {
        assert!(!std::mem::replace(&mut visited[index as usize], true), "a node has one parent");
        depth = depth.max(level);
        let node = &nodes[index as usize];
        for (child_low, child_high, child) in
            [(node.left_low, node.left_high, node.left), (node.right_low, node.right_high, node.right)]
        {
            let bounds = [child_low, child_high].map(Vec3::from);
            if child & LEAF_BIT == 0 {
                assert!(bounds[0].cmpge(low).all() && bounds[1].cmple(high).all(), "a box lies in its parent's");
                open.push((child, level + 1, bounds));
                continue;
            }
            let first = child & ((1 << LEAF_COUNT_SHIFT) - 1);
            let count = (child & !LEAF_BIT) >> LEAF_COUNT_SHIFT;
            assert!(count <= LEAF_MAX_TRIANGLES);
            leaves += u32::from(count > 0);
            for place in first..first + count {
                held[place as usize] += 1;
                for v in corners[bvh.order[place as usize] as usize] {
                    assert!(v.cmpge(bounds[0]).all() && v.cmple(bounds[1]).all(), "a box holds its triangles");
                }
            }
        }
    }
    assert!(visited.iter().all(|&visited| visited), "every node is reached");
    assert!(held.iter().all(|&count| count == 1), "every triangle is in one leaf");
    assert_eq!((bvh.depth, bvh.leaf_count), (depth, leaves));
    assert!(bvh.sah_cost.is_finite());
    bvh
}

/// Checks a wide tree: that boxes, put back from their eight bits in exact arithmetic, hold what is
/// under them, and that each node and triangle is reached once.
fn validate_wide(kind: BvhKind, corners: &[Corners]) -> Bvh {
    let bvh = Bvh::build(kind, corners);
    let mut visited = vec![false; bvh.node_places()];
    let mut held = vec![0; corners.len()];
    let (mut depth, mut leaves) = (0, 0);
    // A node, its level, and the boxes of all nodes above it.
    let mut open = vec![(0_u32, 1, Vec::<[DVec3; 2]>::new())];
    while let Some((index, level, above)) = open.pop() {
        assert!(!std::mem::replace(&mut visited[index as usize], true), "a node has one parent");
        depth = depth.max(level);
        let texels = kind.node_texels();
        let words = bvh.texels[index as usize * texels..][..texels].as_flattened();
        let float = |word: u32| f64::from(f32::from_bits(word));
        let origin = DVec3::from_array(std::array::from_fn(|axis| float(words[axis])));
        let step = DVec3::from_array(std::array::from_fn(|axis| float((words[3] >> (8 * axis) & 0xff) << 23)));
        for child in 0..kind.width() as usize {
            let byte = |word: usize| words[word].to_le_bytes()[child % 4];
            let meta = u32::from(byte(6 + child / 4));
            if meta == 0 {
                continue;
            }
            let plane = |high: usize| {
                let steps = |axis| f64::from(byte(8 + 6 * (child / 4) + 2 * axis + high));
                origin + step * DVec3::from_array(std::array::from_fn(steps))
            };
            let mut boxes = above.clone();
            boxes.push([plane(0), plane(1)]);
            let place = meta & 0x1f;
            if place >= WIDE_INNER_BIT {
                assert_eq!(meta >> 5, 1, "an inner child is one bit");
                open.push(((words[4] >> 8) + place - WIDE_INNER_BIT, level + 1, boxes));
                continue;
            }
            leaves += 1;
            let count = (meta >> 5).trailing_ones();
            assert!((1..=WIDE_LEAF_TRIANGLES).contains(&count) && meta >> 5 == (1 << count) - 1);
            for position in words[5] + place..words[5] + place + count {
                held[position as usize] += 1;
                for v in corners[bvh.order[position as usize] as usize].map(|v| v.as_dvec3()) {
                    let holds = |[low, high]: &[DVec3; 2]| v.cmpge(*low).all() && v.cmple(*high).all();
                    assert!(boxes.iter().all(holds), "a box holds its triangles");
                }
            }
        }
        assert_eq!(words[4] & 0xff, 0, "these bits are for the children that a ray meets");
    }
    assert_eq!(visited.iter().filter(|visited| **visited).count(), bvh.node_count, "every node is reached");
    // Beside some at the end of each part that a thread collapses.
    assert!(bvh.node_places() <= bvh.node_count * 65 / 64 + 1024, "few places are empty");
    assert!(held.iter().all(|&count| count == 1), "every triangle is in one leaf");
    assert_eq!((bvh.depth, bvh.leaf_count), (depth, leaves));
    assert!(bvh.sah_cost.is_finite());
    bvh
}

/// Checks that a ray to the middle of a triangle that has an area meets it or something nearer.
fn triangles_are_found(bvh: &Bvh, corners: &[Corners]) {
    let triangles = triangles_of(bvh, corners);
    let eye = Vec3::new(3.1, -2.7, 4.3);
    for [a, b, c] in corners.iter().step_by(1 + corners.len() / 200) {
        let target = (*a + *b + *c) / 3.0;
        let normal = (*b - *a).cross(*c - *a);
        let longest = (*b - *a).length().max((*c - *a).length()).max((*c - *b).length());
        if normal.normalize_or_zero().dot((target - eye).normalize()).abs() < 1e-2
            || normal.length() < 1e-2 * longest * longest
        {
            continue;
        }
        let ray = Ray { origin: eye, direction: target - eye, leaves: Primitive::NONE };
        let hit = trace_closest(bvh, &triangles, &ray).expect("something is met");
        assert!(hit.distance < 1.0 + 1e-4);
        assert!(trace_any(bvh, &triangles, &ray, NO_TRIANGLE, 1.0 + 1e-4));
    }
}

fn check(mesh: &[[DVec3; 3]]) -> Bvh {
    let corners: Vec<Corners> = mesh.iter().map(|t| t.map(|v| v.as_vec3())).collect();
    let bvh = validate(&corners);
    triangles_are_found(&bvh, &corners);
    for kind in [BvhKind::Bvh4, BvhKind::Cwbvh] {
        triangles_are_found(&validate_wide(kind, &corners), &corners);
    }
    bvh
}

#[test]
fn bodies_and_soups_make_valid_trees() {
    let mut random = Uniform::new(1);
    check(&cuboid(DVec3::NEG_ONE, DVec3::ONE));
    check(&ball(40, 20));
    check(&soup(3000, 0.2, 1.0, &mut random));
    check(&soup(3000, 2.0, 1e-4, &mut random));
    check(&soup(50_000, 0.02, 1.0, &mut random));
}

#[test]
fn a_single_triangle_is_a_tree() {
    let bvh = check(&[[DVec3::ZERO, DVec3::X, DVec3::Y]]);
    assert_eq!((bvh.node_count, bvh.depth, bvh.leaf_count), (1, 1, 1));
}

#[test]
fn triangles_without_extent_or_without_difference_make_shallow_trees() {
    let point = [DVec3::new(0.25, 0.5, -0.75); 3];
    let line = [DVec3::ZERO, DVec3::X, 0.5 * DVec3::X];
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for one in [point, line, triangle] {
        for count in [2, 9, 3000] {
            let bvh = check(&vec![one; count]);
            // The stack of the kernels has an entry for each level.
            let allowed = 60 + bvh.leaf_count.next_power_of_two().ilog2();
            assert!(bvh.depth <= allowed, "{count} times the same make a tree of depth {}", bvh.depth);
        }
    }
}

#[test]
fn sizes_of_every_magnitude_make_valid_trees() {
    let nested: Vec<_> =
        (0..100).map(|i| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|v| v * f64::from(-i).exp2())).collect();
    check(&nested);
    let apart: Vec<_> =
        (0..100).map(|i| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|v| (v + DVec3::Z) * f64::from(-i).exp2())).collect();
    check(&apart);
}

/// A box with a grate of slivers in it, as neon tubes are, every other one of them askew.
fn grate() -> Vec<Corners> {
    let turned = DMat3::from_euler(EulerRot::XYZ, 0.01, 0.4, 0.3);
    let bars = (0..24).flat_map(|bar| {
        let (x, y) = (0.29 + 0.004 * f64::from(bar), 0.08 + 0.001 * f64::from(bar % 3));
        let width = if bar % 4 < 2 { 0.004 } else { 0.0004 };
        let [a, b, c, d] = [(0.0, -0.44), (0.0, 0.37), (width, 0.37), (width, -0.44)].map(|(dx, z)| {
            let corner = DVec3::new(x + dx, y, z);
            if bar % 2 == 0 { corner } else { turned * corner }
        });
        [[a, b, c], [a, c, d]]
    });
    cuboid(DVec3::NEG_ONE, DVec3::ONE).into_iter().chain(bars).map(|t| t.map(|v| v.as_vec3())).collect()
}

/// The distance that is computed of a large triangle nearby, or of a sliver, is off by far more than a few last places.
/// So a box whose triangle would be found just nearer than what is known already may lie beyond it.
#[test]
fn what_is_hit_does_not_depend_on_the_tree() {
    let corners = grate();
    let kinds = [BvhKind::List, BvhKind::Bvh2, BvhKind::Bvh4, BvhKind::Cwbvh];
    let trees = kinds.map(|kind| {
        let bvh = Bvh::build(kind, &corners);
        let triangles = triangles_of(&bvh, &corners);
        (bvh, triangles)
    });
    let mut random = Uniform::new(7);
    let (mut nearest, mut blocked) = ([0; 3], [0; 3]);
    for _ in 0..300_000 {
        let [which, along, across, far, beyond] = random.next();
        // Most ways end at an edge or close to one, a hair before the triangle or beyond it.
        let target = (which * corners.len() as f32) as u32;
        let [a, b, c] = corners[target as usize];
        let end = a.lerp(b, along).lerp(c, across.powi(8));
        let way = 10_f32.powf(-4.0 * far) * random.direction().as_vec3();
        let direction = -way * (1.0 + 2e-5 * (beyond - 0.5));
        let answers = trees.each_ref().map(|(bvh, triangles)| {
            let place = bvh.order.iter().position(|&original| original == target).expect("it is in the order") as u32;
            let ray = Ray { origin: end + way, direction, leaves: Primitive::NONE };
            let hit = trace_closest(bvh, triangles, &ray);
            let hit = hit.map(|hit| (triangles[hit.triangle as usize].original, hit.distance.to_bits()));
            (hit, trace_any(bvh, triangles, &ray, place, 1.0))
        });
        for (kind, answer) in answers[1..].iter().enumerate() {
            nearest[kind] += u32::from(answer.0 != answers[0].0);
            blocked[kind] += u32::from(answer.1 != answers[0].1);
        }
    }
    assert_eq!((nearest, blocked), ([0; 3], [0; 3]), "rays of the kinds {kinds:?} that differ from the list's");
}

/// A ray along an axis lies in the plane of a box's side where it meets a corner, and boxes of triangles that are small for
/// their place have no margin but what rounding outwards gives them.
#[test]
fn rays_along_axes_meet_the_corners_of_small_triangles() {
    const STEP: f32 = 1.0 / 65536.0;
    let corner = |i: u16, j: u16| {
        Vec3::new(
            0.75 + STEP * f32::from(i),
            0.625 + STEP * f32::from(j),
            -0.875 + STEP * f32::from((7 * i + 3 * j) % 5),
        )
    };
    let square = |(i, j): (u16, u16)| {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let corners: Vec<Corners> = (0..25).map(|n| (n % 5, n / 5)).flat_map(square).collect();
    let trees = [BvhKind::List, BvhKind::Bvh2, BvhKind::Bvh4, BvhKind::Cwbvh].map(|kind| {
        let bvh = Bvh::build(kind, &corners);
        let triangles = triangles_of(&bvh, &corners);
        (bvh, triangles)
    });
    let mut hits = 0;
    for (axis, along) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
        for zero in [0.0, -0.0] {
            let mut direction = Vec3::splat(zero);
            direction[axis] = along;
            for place in corners.iter().flatten() {
                let mut origin = *place;
                origin[axis] -= along;
                let answers = trees.each_ref().map(|(bvh, triangles)| {
                    let ray = Ray { origin, direction, leaves: Primitive::NONE };
                    let hit = trace_closest(bvh, triangles, &ray);
                    hit.map(|hit| (triangles[hit.triangle as usize].original, hit.distance.to_bits()))
                });
                assert_eq!(answers, [answers[0]; 4], "{origin:?} {direction:?}");
                hits += usize::from(answers[0].is_some());
            }
        }
    }
    assert!(hits > 600, "all corners are hit from above and from below: {hits}");
}

/// A coordinate: often on a coarse grid, so that triangles touch, coincide and lie in planes.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![-1.0..1.0_f64, (-4..=4_i32).prop_map(|i| f64::from(i) / 4.0), Just(0.0), Just(1e-30)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_triangles_make_a_valid_tree(
        corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(coordinate())), 1..150),
        copies in 1..4_usize,
    ) {
        let mesh: Vec<[DVec3; 3]> = corners.iter().map(|t| t.map(DVec3::from)).collect();
        check(&mesh.repeat(copies));
    }
}
