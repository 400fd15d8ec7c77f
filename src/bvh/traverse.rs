//! CPU traversal of the kernels' nodes, in their arithmetic: the oracle of `bvh.glsl`.

use glam::Vec3;

use super::Bvh;
use crate::constants::{LEAF_BIT, LEAF_COUNT_SHIFT, NO_TRIANGLE};
use crate::layout::{Node, Triangle};

/// A ray of normalised space. The direction need not be unit.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Direction; distances are in its lengths.
    pub direction: Vec3,
    /// Place of the triangle that the origin lies on, which the ray cannot hit; or `NO_TRIANGLE`.
    pub leaves: u32,
}

/// Nearest hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Place of the triangle in leaf order.
    pub triangle: u32,
    /// Weights of the second and third vertex.
    pub barycentrics: [f32; 2],
    /// Distance in lengths of the direction.
    pub distance: f32,
}

/// Rows of the shear that takes the ray's direction to (0, 0, 1).
/// (Woop, Benthin and Wald 2013)
fn ray_space(d: Vec3) -> [Vec3; 3] {
    let a = d.abs();
    if a.x >= a.y && a.x >= a.z {
        let s = 1.0 / d.x;
        [Vec3::new(-d.y * s, 1.0, 0.0), Vec3::new(-d.z * s, 0.0, 1.0), Vec3::new(s, 0.0, 0.0)]
    } else if a.y >= a.z {
        let s = 1.0 / d.y;
        [Vec3::new(0.0, -d.z * s, 1.0), Vec3::new(1.0, -d.x * s, 0.0), Vec3::new(0.0, s, 0.0)]
    } else {
        let s = 1.0 / d.z;
        [Vec3::new(1.0, 0.0, -d.x * s), Vec3::new(0.0, 1.0, -d.y * s), Vec3::new(0.0, 0.0, s)]
    }
}

fn ordered_dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// Watertight triangle test: distance and barycentrics of the hit in front of the origin.
pub fn intersect_triangle(ray: &Ray, triangle: &Triangle) -> Option<(f32, [f32; 2])> {
    let [x, y, z] = ray_space(ray.direction);
    let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2].map(|v| Vec3::from(v) - ray.origin);
    let [(ax, ay), (bx, by), (cx, cy)] = [a, b, c].map(|v| (ordered_dot(x, v), ordered_dot(y, v)));
    let u = cx * by - cy * bx;
    let v = ax * cy - ay * cx;
    let w = bx * ay - by * ax;
    let determinant = u + v + w;
    let inverse = 1.0 / determinant;
    let distance = (u * ordered_dot(z, a) + v * ordered_dot(z, b) + w * ordered_dot(z, c)) * inverse;
    let inside = u.min(v).min(w) >= 0.0 || u.max(v).max(w) <= 0.0;
    (inside && determinant != 0.0 && distance > 0.0).then_some((distance, [v * inverse, w * inverse]))
}

fn safe_inverse(d: Vec3) -> Vec3 {
    Vec3::from_array(d.to_array().map(|d| 1.0 / if d.abs() < 1e-20 { if d >= 0.0 { 1e-20 } else { -1e-20 } } else { d }))
}

/// As in `bvh.glsl`.
const SLAB_SLACK: f32 = 1.000_000_8;

fn enter_box(low: [f32; 3], high: [f32; 3], origin: Vec3, inverse: Vec3, limit: f32) -> Option<f32> {
    let t0 = (Vec3::from(low) - origin) * inverse;
    let t1 = (Vec3::from(high) - origin) * inverse;
    let near = t0.min(t1);
    let far = t0.max(t1);
    let enter = near.x.max(near.y).max(near.z.max(0.0));
    let leave = far.x.min(far.y).min(far.z.min(limit));
    (enter <= leave * SLAB_SLACK).then_some(enter)
}

/// Visits the leaves that the ray enters before `limit` gives, nearer children first.
fn walk(bvh: &Bvh, ray: &Ray, mut limit: impl FnMut(Option<std::ops::Range<u32>>) -> f32) {
    let inverse = safe_inverse(ray.direction);
    let mut stack = vec![0_u32];
    while let Some(reference) = stack.pop() {
        if reference & LEAF_BIT != 0 {
            let first = reference & ((1 << LEAF_COUNT_SHIFT) - 1);
            let count = (reference & !LEAF_BIT) >> LEAF_COUNT_SHIFT;
            limit(Some(first..first + count));
            continue;
        }
        let Node { left_low, left, left_high, right_low, right, right_high, .. } = bvh.nodes[reference as usize];
        let reach = limit(None);
        let enter_left = enter_box(left_low, left_high, ray.origin, inverse, reach);
        let enter_right = enter_box(right_low, right_high, ray.origin, inverse, reach);
        match (enter_left, enter_right) {
            (Some(l), Some(r)) if l <= r => stack.extend([right, left]),
            (Some(_), Some(_)) => stack.extend([left, right]),
            (Some(_), None) => stack.push(left),
            (None, Some(_)) => stack.push(right),
            (None, None) => {}
        }
    }
}

/// The nearest hit; among equal distances the triangle that the scene lists first.
pub fn trace_closest(bvh: &Bvh, triangles: &[Triangle], ray: &Ray) -> Option<Hit> {
    let mut nearest = Hit { triangle: NO_TRIANGLE, barycentrics: [0.0; 2], distance: f32::MAX };
    let mut nearest_original = NO_TRIANGLE;
    walk(bvh, ray, |leaf| {
        for place in leaf.into_iter().flatten() {
            let triangle = &triangles[place as usize];
            let Some((distance, barycentrics)) = intersect_triangle(ray, triangle) else { continue };
            let nearer = distance < nearest.distance
                || (distance == nearest.distance && triangle.original < nearest_original);
            if nearer && place != ray.leaves {
                nearest = Hit { triangle: place, barycentrics, distance };
                nearest_original = triangle.original;
            }
        }
        nearest.distance
    });
    (nearest.triangle != NO_TRIANGLE).then_some(nearest)
}

/// Whether anything but the triangle `target` lies on the ray nearer than `limit`.
pub fn trace_any(bvh: &Bvh, triangles: &[Triangle], ray: &Ray, target: u32, limit: f32) -> bool {
    let mut blocked = false;
    walk(bvh, ray, |leaf| {
        for place in leaf.into_iter().flatten() {
            let hit = intersect_triangle(ray, &triangles[place as usize]);
            blocked |= hit.is_some_and(|(distance, _)| distance < limit) && place != ray.leaves && place != target;
        }
        limit
    });
    blocked
}
