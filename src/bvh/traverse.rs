//! CPU traversal of the kernels' nodes, in their arithmetic: the oracle of `bvh.glsl`.

use std::ops::ControlFlow;

use glam::{Vec3, Vec3Swizzles};

use super::sliver::{is_thin, signed_volume};
use super::{Bvh, BvhKind};
use crate::constants::{
    ANY_GROUPS, CLOSEST_GROUPS, INSTANCE_DONE, LEAF_BIT, LEAF_COUNT_SHIFT, LEAF_INSTANCE, NO_TRIANGLE, WIDE_INNER_BIT,
    WORLD_INSTANCE,
};
use crate::layout::{Instance, Node, Triangle};

/// What a ray can hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Primitive {
    /// Position of the triangle in leaf order, or `NO_TRIANGLE`.
    pub triangle: u32,
    /// Index of the mesh in its place that it is of, where there are such; else `WORLD_INSTANCE`.
    pub instance: u32,
}

impl Primitive {
    /// None.
    pub const NONE: Self = Self { triangle: NO_TRIANGLE, instance: NO_TRIANGLE };
}

impl From<u32> for Primitive {
    /// A triangle of the world itself.
    fn from(triangle: u32) -> Self {
        Self { triangle, instance: WORLD_INSTANCE }
    }
}

/// A ray of normalised space. The direction need not be unit.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Direction; distances are in its lengths.
    pub direction: Vec3,
    /// What the origin lies on, which the ray cannot hit; or none.
    pub leaves: Primitive,
}

/// Nearest hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Position of the triangle in leaf order.
    pub triangle: u32,
    /// Index of the mesh in its place that it is of, where there are such; else `WORLD_INSTANCE`.
    pub instance: u32,
    /// Weights of the second and third vertex.
    pub barycentrics: [f32; 2],
    /// Distance in lengths of the direction.
    pub distance: f32,
}

/// The work of a traversal.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Work {
    /// Inner nodes visited.
    pub nodes: u64,
    /// Triangles tested.
    pub triangles: u64,
}

/// The ray's own space: its axes permuted so that the direction is longest along z, then sheared
/// so that it becomes (0, 0, 1). (Woop, Benthin and Wald 2013)
struct RaySpace {
    origin: Vec3,
    shear: Vec3,
    permute: fn(Vec3) -> Vec3,
}

impl RaySpace {
    fn of(ray: &Ray) -> Self {
        let a = ray.direction.abs();
        let permute: fn(Vec3) -> Vec3 = if a.x >= a.y && a.x >= a.z {
            |v| v.yzx()
        } else if a.y >= a.z {
            |v| v.zxy()
        } else {
            |v| v
        };
        let p = permute(ray.direction);
        let inverse = 1.0 / p.z;
        Self { origin: ray.origin, shear: Vec3::new(p.x * inverse, p.y * inverse, inverse), permute }
    }

    /// A vertex in this space, except for the scale of z.
    fn of_vertex(&self, vertex: [f32; 3]) -> Vec3 {
        let p = (self.permute)(Vec3::from(vertex) - self.origin);
        Vec3::new(p.x - self.shear.x * p.z, p.y - self.shear.y * p.z, p.z)
    }
}

/// Edges of a triangle against a ray: the barycentrics of where they meet, times their sum.
struct Edges {
    vertices: [Vec3; 3],
    u: f32,
    v: f32,
    w: f32,
}

impl Edges {
    fn of(space: &RaySpace, triangle: &Triangle) -> Self {
        let vertices = [triangle.v0, triangle.v1, triangle.v2].map(|v| space.of_vertex(v));
        let [a, b, c] = vertices;
        Self { vertices, u: c.x * b.y - c.y * b.x, v: a.x * c.y - a.y * c.x, w: b.x * a.y - b.y * a.x }
    }

    fn determinant(&self) -> f32 {
        self.u + self.v + self.w
    }
}

/// Watertight triangle test: distance and barycentrics of the hit in front of the origin.
fn intersect_triangle(space: &RaySpace, triangle: &Triangle) -> Option<(f32, [f32; 2])> {
    let edges = Edges::of(space, triangle);
    let Edges { vertices: [a, b, c], u, v, w } = edges;
    let determinant = edges.determinant();
    let inverse = 1.0 / determinant;
    let distance = (u * a.z + v * b.z + w * c.z) * (inverse * space.shear.z);
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    (inside && determinant != 0.0 && distance > 0.0).then_some((distance, [v * inverse, w * inverse]))
}

/// Whether a hit at that distance touches the origin of the ray. As in `intersect.glsl`.
fn touches_origin(space: &RaySpace, distance: f32) -> bool {
    distance < space.shear.z.abs() / 1024.0
}

/// Whether a triangle that was found in front of the ray's origin is thin and lies behind it or at it. `intersect.glsl`
/// says why.
fn lies_behind(space: &RaySpace, triangle: &Triangle) -> bool {
    let corners = [triangle.v0, triangle.v1, triangle.v2].map(Vec3::from);
    let volume = signed_volume(corners.map(|corner| corner - space.origin));
    let signs = [volume, Edges::of(space, triangle).determinant(), space.shear.z].map(f32::is_sign_negative);
    let ahead = volume != 0.0 && signs.into_iter().fold(false, |a, b| a ^ b);
    is_thin(&corners) && !ahead
}

fn safe_inverse(d: Vec3) -> Vec3 {
    Vec3::from_array(
        d.to_array().map(|d| 1.0 / if d.abs() < 1e-20 { if d >= 0.0 { 1e-20 } else { -1e-20 } } else { d }),
    )
}

/// As in `binary.glsl`.
const SLAB_SLACK: f32 = 1.000_000_8;
/// As in `slab.glsl`.
const LIMIT_SLACK: f32 = 1.0 + 1.0 / 65_536.0;
/// As in `slab.glsl`.
const LIMIT_MARGIN: f32 = 1.0 / 16_384.0;

/// As in `slab.glsl`.
fn box_t_max(limit: f32, inverse: Vec3) -> f32 {
    limit * LIMIT_SLACK + LIMIT_MARGIN * inverse.abs().min_element()
}

/// A ray as boxes see it. As in `binary.glsl`.
#[derive(Clone, Copy)]
struct BoxRay {
    /// The origin, farther by what roundings may move it: from lower and from upper planes.
    from_low: Vec3,
    from_high: Vec3,
    inverse: Vec3,
}

impl BoxRay {
    fn of(ray: &Ray) -> Self {
        Self { from_low: ray.origin, from_high: ray.origin, inverse: safe_inverse(ray.direction) }
    }

    /// In the coordinates of a mesh in its place. `instances.rs` has the bounds.
    fn in_mesh(ray: &Ray, instance: &Instance) -> Self {
        let [x, y, z] = instance.inverse.map(|[x, y, z, _]| Vec3::new(x, y, z));
        let slack = Vec3::from_array(instance.inverse.map(|[.., slack]| slack));
        let way = ray.origin - Vec3::from(instance.translation);
        let to_mesh = |v: Vec3| x * v.x + y * v.y + z * v.z;
        let origin = to_mesh(way);
        let reach = x.abs() * way.x.abs() + y.abs() * way.y.abs() + z.abs() * way.z.abs();
        let margin = slack + reach * INSTANCE_SLACK;
        Self { from_low: origin + margin, from_high: origin - margin, inverse: safe_inverse(to_mesh(ray.direction)) }
    }
}

/// As in `binary.glsl`.
const INSTANCE_SLACK: f32 = 32.0 * 5.960_464_5e-8;

fn enter_box(low: [f32; 3], high: [f32; 3], ray: &BoxRay, reach: f32) -> Option<f32> {
    let t0 = (Vec3::from(low) - ray.from_low) * ray.inverse;
    let t1 = (Vec3::from(high) - ray.from_high) * ray.inverse;
    let near = t0.min(t1);
    let far = t0.max(t1);
    let enter = near.x.max(near.y).max(near.z.max(0.0));
    let leave = far.x.min(far.y).min(far.z.min(reach));
    (enter <= leave * SLAB_SLACK).then_some(enter)
}

/// What a traversal does with triangles of an instance: the limit from there on, or the end.
trait Visit: FnMut(u32, &[u32]) -> ControlFlow<(), f32> {}

impl<F: FnMut(u32, &[u32]) -> ControlFlow<(), f32>> Visit for F {}

/// Visits the triangles, by position in leaf order, of leaves that the ray enters nearer than `limit`: nearer children
/// first and, in a wide tree, the triangles of `groups` nodes at once, as the kernels do.
fn walk(bvh: &Bvh, ray: &Ray, limit: f32, groups: u32, visit: impl Visit) -> Work {
    match bvh.kind {
        BvhKind::List => walk_list(&bvh.order, visit),
        BvhKind::Bvh2 => walk_binary(bvh, ray, limit, visit),
        BvhKind::Bvh4 | BvhKind::Cwbvh => walk_wide(bvh, ray, limit, groups, visit),
    }
}

/// Visits all triangles, whether the ray is occluded or not, as the kernels do.
fn walk_list(order: &[u32], mut visit: impl Visit) -> Work {
    let _ = visit(WORLD_INSTANCE, order);
    Work { nodes: 0, triangles: order.len() as u64 }
}

fn walk_binary(bvh: &Bvh, ray: &Ray, mut limit: f32, mut visit: impl Visit) -> Work {
    let nodes = bvh.binary_nodes();
    let in_world = BoxRay::of(ray);
    let (mut instance, mut box_ray) = (WORLD_INSTANCE, in_world);
    let mut stack = vec![0_u32];
    let mut work = Work::default();
    while let Some(reference) = stack.pop() {
        if reference == INSTANCE_DONE {
            (instance, box_ray) = (WORLD_INSTANCE, in_world);
            continue;
        }
        if reference & LEAF_BIT != 0 {
            let first = reference & ((1 << LEAF_COUNT_SHIFT) - 1);
            let count = (reference & !LEAF_BIT) >> LEAF_COUNT_SHIFT;
            if count == LEAF_INSTANCE {
                instance = first;
                let entered = &bvh.instances[instance as usize];
                box_ray = BoxRay::in_mesh(ray, entered);
                stack.extend([INSTANCE_DONE, entered.root]);
                continue;
            }
            work.triangles += u64::from(count);
            match visit(instance, &Vec::from_iter(first..first + count)) {
                ControlFlow::Continue(nearer) => limit = nearer,
                ControlFlow::Break(()) => break,
            }
            continue;
        }
        work.nodes += 1;
        let Node { left_low, left, left_high, right_low, right, right_high, .. } = nodes[reference as usize];
        let reach = box_t_max(limit, in_world.inverse);
        let enter_left = enter_box(left_low, left_high, &box_ray, reach);
        let enter_right = enter_box(right_low, right_high, &box_ray, reach);
        match (enter_left, enter_right) {
            (Some(l), Some(r)) if l <= r => stack.extend([right, left]),
            (Some(_), Some(_)) => stack.extend([left, right]),
            (Some(_), None) => stack.push(left),
            (None, Some(_)) => stack.push(right),
            (None, None) => {}
        }
    }
    work
}

/// As in `wide.glsl`.
const PLANE_ERROR: f32 = 8.0 * 5.960_464_5e-8;

fn walk_wide(bvh: &Bvh, ray: &Ray, mut limit: f32, groups: u32, mut visit: impl Visit) -> Work {
    let inverse = safe_inverse(ray.direction);
    let octant = (0..3).fold(0, |octant, axis| octant << 1 | u32::from(inverse[axis] >= 0.0));
    // Base index of a node's children, and a mask of those still to visit, the nearest one highest.
    let mut stack: Vec<(u32, u32)> = Vec::new();
    let mut next = Some(0);
    // Postponed triangles, and the number of nodes that they belong to.
    let (mut postponed, mut waiting) = (Vec::new(), 0);
    let mut work = Work::default();
    while let Some(node) = next {
        work.nodes += 1;
        let (inner, triangles) = enter_children(bvh, node, ray.origin, inverse, octant, box_t_max(limit, inverse));
        if inner != 0 {
            stack.push((bvh.wide_node(node)[1][0] >> 8, inner));
        }
        next = stack.pop().map(|(children, left)| {
            let nearest = left.ilog2();
            let rest = left & !(1 << nearest);
            if rest != 0 {
                stack.push((children, rest));
            }
            children + (nearest ^ octant)
        });
        waiting += u32::from(!triangles.is_empty());
        postponed.extend(triangles);
        if postponed.is_empty() || (waiting < groups && next.is_some()) {
            continue;
        }
        work.triangles += postponed.len() as u64;
        match visit(WORLD_INSTANCE, &postponed) {
            ControlFlow::Continue(nearer) => limit = nearer,
            ControlFlow::Break(()) => break,
        }
        postponed.clear();
        waiting = 0;
    }
    work
}

/// Inner children whose boxes the ray hits, and triangles of the leaves whose boxes it hits.
fn enter_children(bvh: &Bvh, node: u32, origin: Vec3, inverse: Vec3, octant: u32, reach: f32) -> (u32, Vec<u32>) {
    let words = bvh.wide_node(node).as_flattened();
    let bytes = |word: usize| words[word].to_le_bytes();
    let step = Vec3::from_array(std::array::from_fn(|axis| f32::from_bits(u32::from(bytes(3)[axis]) << 23)));
    let scale = step * inverse;
    let offset = (Vec3::from_array(std::array::from_fn(|axis| f32::from_bits(words[axis]))) - origin) * inverse;
    let error = (offset.abs() + 255.0 * scale.abs()) * PLANE_ERROR;
    let (near, far) = (offset - error, offset + error);
    let mut hits = 0_u32;
    for child in 0..bvh.kind.width() as usize {
        let meta = bytes(6 + child / 4)[child % 4];
        let plane =
            |axis: usize, high: bool| f32::from(bytes(8 + 6 * (child / 4) + 2 * axis + usize::from(high))[child % 4]);
        let backwards = |axis: usize| inverse[axis] < 0.0;
        let enters = Vec3::from_array(std::array::from_fn(|a| plane(a, backwards(a)) * scale[a] + near[a]));
        let leaves = Vec3::from_array(std::array::from_fn(|a| plane(a, !backwards(a)) * scale[a] + far[a]));
        let enter = enters.x.max(enters.y).max(enters.z.max(0.0));
        let leave = leaves.x.min(leaves.y).min(leaves.z.min(reach));
        if enter <= leave {
            let is_inner = u32::from(meta & 0x1f) >= WIDE_INNER_BIT;
            let place = u32::from(meta & 0x1f) ^ if is_inner { octant } else { 0 };
            hits |= u32::from(meta >> 5) << place;
        }
    }
    let triangles = (0..WIDE_INNER_BIT).filter(|bit| hits & 1 << bit != 0).map(|bit| words[5] + bit).collect();
    (hits >> WIDE_INNER_BIT, triangles)
}

/// The nearest hit; of equal distances, the triangle that the scene lists first.
pub fn trace_closest(bvh: &Bvh, triangles: &[Triangle], ray: &Ray) -> Option<Hit> {
    count_closest(bvh, triangles, ray).0
}

/// The nearest of some hits, and its triangle's index in the scene's order.
#[derive(Clone, Copy)]
struct Nearest {
    hit: Hit,
    original: u32,
}

impl Nearest {
    const NONE: Self = Self {
        hit: Hit { triangle: NO_TRIANGLE, instance: NO_TRIANGLE, barycentrics: [0.0; 2], distance: f32::MAX },
        original: NO_TRIANGLE,
    };

    fn take(&mut self, hit: Hit, original: u32) {
        if (hit.distance, hit.instance, original) < (self.hit.distance, self.hit.instance, self.original) {
            *self = Self { hit, original };
        }
    }

    /// A hit's triangle and instance.
    fn primitive(&self) -> Primitive {
        Primitive { triangle: self.hit.triangle, instance: self.hit.instance }
    }
}

/// A triangle in normalised space.
fn placed(bvh: &Bvh, triangles: &[Triangle], Primitive { triangle, instance }: Primitive) -> Triangle {
    let own = triangles[triangle as usize];
    let Some(instance) = bvh.instances.get(instance as usize) else { return own };
    let [v0, v1, v2] = instance.place_corners([own.v0, own.v1, own.v2], |corner| instance.place(corner));
    Triangle { v0, v1, v2, ..own }
}

/// [`trace_closest`], and its work.
pub fn count_closest(bvh: &Bvh, triangles: &[Triangle], ray: &Ray) -> (Option<Hit>, Work) {
    let space = RaySpace::of(ray);
    let (mut nearest, mut touching) = (Nearest::NONE, Nearest::NONE);
    let work = walk(bvh, ray, f32::MAX, CLOSEST_GROUPS, |instance, leaf| {
        let primitives = leaf.iter().map(|&triangle| Primitive { triangle, instance });
        for primitive in primitives.filter(|primitive| *primitive != ray.leaves) {
            let triangle = placed(bvh, triangles, primitive);
            let Some((distance, barycentrics)) = intersect_triangle(&space, &triangle) else { continue };
            let touches = bvh.has_thin_triangles && touches_origin(&space, distance);
            let nearest = if touches { &mut touching } else { &mut nearest };
            nearest.take(Hit { triangle: primitive.triangle, instance, barycentrics, distance }, triangle.original);
        }
        ControlFlow::Continue(nearest.hit.distance)
    });
    let found = touching.primitive();
    if found.triangle != NO_TRIANGLE && !lies_behind(&space, &placed(bvh, triangles, found)) {
        nearest = touching;
    }
    ((nearest.hit.triangle != NO_TRIANGLE).then_some(nearest.hit), work)
}

/// Whether the ray is occluded: whether any triangle but `target` is nearer than `limit`.
pub fn trace_any(bvh: &Bvh, triangles: &[Triangle], ray: &Ray, target: impl Into<Primitive>, limit: f32) -> bool {
    count_any(bvh, triangles, ray, target, limit).0
}

/// [`trace_any`], and its work.
pub fn count_any(
    bvh: &Bvh,
    triangles: &[Triangle],
    ray: &Ray,
    target: impl Into<Primitive>,
    limit: f32,
) -> (bool, Work) {
    let ignored = [ray.leaves, target.into()];
    let space = RaySpace::of(ray);
    let (mut occluded, mut touching) = (false, None);
    let work = walk(bvh, ray, limit, ANY_GROUPS, |instance, leaf| {
        for primitive in leaf.iter().map(|&triangle| Primitive { triangle, instance }) {
            let hit = intersect_triangle(&space, &placed(bvh, triangles, primitive));
            let Some((distance, _)) = hit.filter(|hit| hit.0 < limit && !ignored.contains(&primitive)) else {
                continue;
            };
            // Of two that touch the origin one is believed.
            if bvh.has_thin_triangles && touches_origin(&space, distance) && touching.is_none() {
                touching = Some(primitive);
            } else {
                occluded = true;
            }
        }
        if occluded { ControlFlow::Break(()) } else { ControlFlow::Continue(limit) }
    });
    let touched = |primitive| !lies_behind(&space, &placed(bvh, triangles, primitive));
    (occluded || touching.is_some_and(touched), work)
}
