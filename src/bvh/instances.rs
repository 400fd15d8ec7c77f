//! Two levels: a tree over meshes in their places, whose leaves lead to the trees of the meshes.
//!
//! A ray goes through the upper tree as through any. At a leaf it is taken to the mesh's own coordinates, in which it goes
//! through the mesh's tree; triangles are taken to normalised space one by one and intersected there, so that a hit is
//! what it would be if all had been flattened. What follows bounds how far roundings may move the ray against the boxes.
//!
//! Let M and t be the axes and the translation of an [`Instance`], R the radii of its box (the sums of the sizes of M's
//! rows), A the inverse of M, u half a unit in the last place of 1, and o and d a ray. Along an axis of the mesh,
//!
//! - the ray's origin A (o - t) is off by 7 u |A| |o - t|, and its direction by 5 u |A| |d|: where it meets the box, which is
//!   no farther from o than |o - t| + R, by 5 u |A| (|o - t| + R);
//! - the triangle test allows for 13 u of the way from o along each axis of the world, as the slack of the slab test does,
//!   and for 16 u of the triangle's longest side, which is 2 max R at most: 13 u |A| (|o - t| + R) and 32 u |A| max R;
//! - vertices are off by 4 u |A| (R + |t|).
//!
//! So boxes are widened by 32 u |A| |o - t|, which kernels compute, and 64 u |A| max R + 8 u |A| |t|, which the instance
//! has, with room to spare.

use std::collections::HashMap;
use std::time::Instant;

use glam::{DMat3, DVec3, Vec3};
use obvhs::aabb::Aabb;

use super::{Bvh, BvhKind, LEAF_BIT, LEAF_COUNT_SHIFT, Node, binary_tree, leaf_reference};
use crate::constants::LEAF_INSTANCE;
use crate::layout::Instance;

/// Half a unit in the last place of 1.
const ROUNDING: f64 = 1.0 / (1 << 24) as f64;
/// Boxes of a mesh of which the box in its place is made: that of all alone is large where a mesh is turned.
const COVERING_BOXES: usize = 32;
/// Fewest instances with the same box that are kept from the builder, which is slow with many.
const FEWEST_ALIKE: usize = 64;

impl Bvh {
    /// A tree of two levels: over instances, each with the tree of its mesh, one of `trees`, all of which are two-wide. It
    /// completes the instances.
    ///
    /// There is an instance at least; those of `None` have no triangles.
    pub fn of_instances(trees: &[Self], instances: Vec<(Option<usize>, Instance)>) -> Self {
        let start = Instant::now();
        let covers: Vec<Vec<[Vec3; 2]>> = trees.iter().map(Self::cover).collect();
        let (shown, boxes): (Vec<u32>, Vec<Aabb>) = instances
            .iter()
            .zip(0..)
            .filter_map(|((tree, instance), index)| tree.map(|tree| (index, placed_box(instance, &covers[tree]))))
            .unzip();
        let mut bvh = Self::of_any_depth(BvhKind::Bvh2, binary_tree(&boxes, &alike(&boxes), 1));
        let root = boxes.iter().fold(Aabb::empty(), |all, one| all.union(one)).half_area();
        let share = |aabb: &Aabb| f64::from(aabb.half_area()) / f64::from(root).max(f64::MIN_POSITIVE);
        let tree_of = |place: usize| instances[shown[place] as usize].0.map(|tree| &trees[tree]);
        let below = |(place, aabb): (usize, &Aabb)| tree_of(place).map_or(0.0, |tree| share(aabb) * tree.sah_cost);
        bvh.sah_cost += boxes.iter().enumerate().map(below).sum::<f64>();
        // A leaf of the upper tree is one instance.
        let lead = |reference: &mut u32| {
            if *reference & LEAF_BIT != 0 && *reference != LEAF_BIT {
                let instance = shown[bvh.order[(*reference & ((1 << LEAF_COUNT_SHIFT) - 1)) as usize] as usize];
                *reference = leaf_reference(instance, LEAF_INSTANCE);
            }
        };
        let nodes: &mut [Node] = bytemuck::cast_slice_mut(&mut bvh.texels);
        nodes.iter_mut().flat_map(|node| [&mut node.left, &mut node.right]).for_each(lead);
        bvh.order.clear();
        bvh.leaf_count = 0;

        let mut roots = Vec::new();
        for tree in trees {
            let (first_node, first_place) = ((bvh.texels.len() / 4) as u32, bvh.order.len() as u32);
            let first_triangle = first_place;
            roots.push(first_node);
            bvh.texels.extend_from_slice(&tree.texels);
            let nodes: &mut [Node] = bytemuck::cast_slice_mut(&mut bvh.texels[first_node as usize * 4..]);
            for reference in nodes.iter_mut().flat_map(|node| [&mut node.left, &mut node.right]) {
                *reference += if *reference & LEAF_BIT == 0 { first_node } else { first_place };
            }
            bvh.order.extend(tree.order.iter().map(|triangle| first_triangle + triangle));
            bvh.node_count += tree.node_count;
            bvh.leaf_count += tree.leaf_count;
        }
        // On the way back to the upper tree waits an entry of the stack.
        bvh.depth += 1 + trees.iter().map(|tree| tree.depth).max().unwrap_or_default();
        // Which triangles are thin in their places is not looked for: there may be more than memory holds.
        bvh.has_thin_triangles = true;
        let complete = |(tree, instance): (Option<usize>, Instance)| Instance {
            root: tree.map_or(0, |tree| roots[tree]),
            inverse: inverse(&instance),
            ..instance
        };
        bvh.instances = instances.into_iter().map(complete).collect();
        bvh.build_time = start.elapsed() + trees.iter().map(|tree| tree.build_time).sum();
        bvh
    }

    /// Boxes of nodes that hold all triangles of a two-wide tree: the largest are opened first.
    fn cover(&self) -> Vec<[Vec3; 2]> {
        let nodes = self.binary_nodes();
        let children = |index: u32| {
            let Node { left_low, left, left_high, right_low, right, right_high, .. } = nodes[index as usize];
            let sides = [(left_low, left_high, left), (right_low, right_high, right)];
            sides.into_iter().filter(|(.., reference)| *reference != LEAF_BIT)
        };
        let mut open: Vec<_> = children(0).collect();
        let area = |(low, high, _): &([f32; 3], [f32; 3], u32)| Aabb::new((*low).into(), (*high).into()).half_area();
        while open.len() < COVERING_BOXES {
            let inner = open.iter().enumerate().filter(|(_, (.., reference))| reference & LEAF_BIT == 0);
            let largest = inner.max_by(|(_, a), (_, b)| area(a).total_cmp(&area(b))).map(|(place, _)| place);
            let Some(largest) = largest else { break };
            let (.., reference) = open.swap_remove(largest);
            open.extend(children(reference));
        }
        open.into_iter().map(|(low, high, _)| [low.into(), high.into()]).collect()
    }
}

/// The axes of an instance, and where its origin goes.
fn axes(instance: &Instance) -> (DMat3, DVec3) {
    let column = |axis: [f32; 3]| Vec3::from(axis).as_dvec3();
    let map = DMat3::from_cols(column(instance.x_axis), column(instance.y_axis), column(instance.z_axis));
    (map, column(instance.translation))
}

fn absolute(map: DMat3) -> DMat3 {
    DMat3::from_cols(map.x_axis.abs(), map.y_axis.abs(), map.z_axis.abs())
}

/// A box about a mesh in its place, wide enough for all roundings, from boxes that hold it.
fn placed_box(instance: &Instance, cover: &[[Vec3; 2]]) -> Aabb {
    let (map, translation) = axes(instance);
    let reach = absolute(map);
    let radii = reach * DVec3::ONE;
    let margin = DVec3::splat(64.0 * ROUNDING * radii.max_element()) + 8.0 * ROUNDING * translation.abs();
    let (low, high) = cover.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), [from, to]| {
        let (from, to) = (from.as_dvec3(), to.as_dvec3());
        let (centre, half) = (map * (0.5 * (from + to)) + translation, reach * (0.5 * (to - from)));
        (low.min(centre - half), high.max(centre + half))
    });
    // The margin is more than what rounding to f32 takes.
    Aabb::new((low - margin).as_vec3().into(), (high + margin).as_vec3().into())
}

/// The inverse of an instance's axes, and how far boxes are widened. Of a mesh so small that it has no inverse in numbers of
/// 32 bits every box is entered.
fn inverse(instance: &Instance) -> [[f32; 4]; 3] {
    const LARGEST: f64 = 1e15;
    let (map, translation) = axes(instance);
    let inverse = map.inverse();
    // Written so that NaN is too large.
    if !(inverse.to_cols_array().iter().all(|entry| entry.abs() <= LARGEST)) {
        return [[0.0, 0.0, 0.0, 1e30]; 3];
    }
    let radius = (absolute(map) * DVec3::ONE).max_element();
    let slack = absolute(inverse)
        * (DVec3::splat(64.0 * ROUNDING * radius) + 8.0 * ROUNDING * translation.abs()).as_vec3().as_dvec3();
    let column = |axis: DVec3, slack: f64| axis.as_vec3().extend(slack as f32).to_array();
    [column(inverse.x_axis, slack.x), column(inverse.y_axis, slack.y), column(inverse.z_axis, slack.z)]
}

/// Instances whose boxes are the same, of which there may be many where a file places a mesh at one place again and again.
fn alike(boxes: &[Aabb]) -> Vec<Vec<u32>> {
    let bits = |aabb: &Aabb| [aabb.min.to_array().map(f32::to_bits), aabb.max.to_array().map(f32::to_bits)];
    let mut groups: HashMap<[[u32; 3]; 2], Vec<u32>> = HashMap::new();
    for (aabb, index) in boxes.iter().zip(0..) {
        groups.entry(bits(aabb)).or_default().push(index);
    }
    let mut groups: Vec<_> = groups.into_values().filter(|group| group.len() >= FEWEST_ALIKE).collect();
    groups.sort_unstable();
    groups
}
