//! Fans: many triangles about one corner, as the lids of cylinders are and as whole discs.
//!
//! PLOC joins boxes that are each other's nearest. Those of a fan all overlap about its corner, and the nearest of each is
//! the next one's neighbour, so a round joins a handful and the time grows with the square of their number. So a fan gets a
//! tree of its own, and PLOC sees it as one box.

use std::collections::HashMap;

use glam::Vec3;
use obvhs::{
    aabb::Aabb,
    bvh2::{Bvh2, node::Bvh2Node},
};
use rayon::prelude::*;

/// Fewest triangles of a fan; fewer cost PLOC no more than some milliseconds.
const FEWEST: usize = 2048;
/// Triangles of a sample that tell a fan from chance.
const SAMPLED: usize = 32;

/// The triangles of each fan. It looks at a sample, so that the search is short: of N triangles, a fan of 2 √N is found,
/// which costs PLOC less than the other triangles do.
pub(super) fn find(triangles: &[[Vec3; 3]]) -> Vec<Vec<u32>> {
    if triangles.len() < FEWEST {
        return Vec::new();
    }
    let stride = (triangles.len().isqrt() / 16).max(1);
    let mut counts = HashMap::<[u32; 3], usize>::new();
    for corner in triangles.iter().step_by(stride).flatten() {
        *counts.entry(bits(corner)).or_default() += 1;
    }
    let is_hub = |count: usize| count >= SAMPLED && count * stride >= FEWEST;
    let mut hubs: Vec<_> = counts.into_iter().filter(|(_, count)| is_hub(*count)).map(|(hub, _)| hub).collect();
    if hubs.is_empty() {
        return Vec::new();
    }
    hubs.sort_unstable();
    let hub_of = |triangle: &[Vec3; 3]| triangle.iter().find_map(|corner| hubs.binary_search(&bits(corner)).ok());
    let found: Vec<Option<usize>> = triangles.par_iter().map(hub_of).collect();
    let mut fans = vec![Vec::new(); hubs.len()];
    for (triangle, hub) in found.into_iter().enumerate() {
        if let Some(hub) = hub {
            fans[hub].push(triangle as u32);
        }
    }
    // Triangles between two hubs are the first one's, so that the other may have hardly any left.
    fans.retain(|fan| fan.len() > 1);
    fans
}

fn bits(corner: &Vec3) -> [u32; 3] {
    // Both zeros are one place.
    (*corner + Vec3::ZERO).to_array().map(f32::to_bits)
}

/// A tree of all boxes: `ploc`'s of those that are in no fan and of the bounds of the fans, each of which is halved.
pub(super) fn build(boxes: &[Aabb], fans: &[Vec<u32>], ploc: impl FnOnce(&[Aabb]) -> Bvh2) -> Bvh2 {
    let mut is_alone = vec![true; boxes.len()];
    for &triangle in fans.iter().flatten() {
        is_alone[triangle as usize] = false;
    }
    let alone: Vec<u32> = (0..boxes.len() as u32).filter(|&triangle| is_alone[triangle as usize]).collect();
    let box_of = |triangle: &u32| boxes[*triangle as usize];
    let bounds = fans.iter().map(|fan| fan.iter().map(box_of).fold(Aabb::empty(), |all, one| all.union(&one)));
    let items: Vec<Aabb> = alone.iter().map(box_of).chain(bounds).collect();
    let mut tree = ploc(&items);
    for place in 0..tree.nodes.len() {
        let node = tree.nodes[place];
        if !node.is_leaf() {
            continue;
        }
        let item = tree.primitive_indices[node.first_index as usize] as usize;
        match item.checked_sub(alone.len()) {
            None => tree.nodes[place].first_index = alone[item],
            Some(fan) => {
                let leaf = |triangle: &u32| Bvh2Node::new(box_of(triangle), 1, *triangle);
                let mut leaves: Vec<_> = fans[fan].iter().map(leaf).collect();
                halve(&mut tree.nodes, place, &mut leaves);
            }
        }
    }
    tree.primitive_indices = (0..boxes.len() as u32).collect();
    let most = fans.iter().map(Vec::len).max().unwrap_or(1);
    tree.max_depth += most.ilog2() as usize + 1;
    tree
}

/// Lays leaves out below the node at `root`, which they replace: halves along the axis on which their centres are farthest
/// apart, down to single ones.
fn halve(nodes: &mut Vec<Bvh2Node>, root: usize, leaves: &mut [Bvh2Node]) {
    let mut open = vec![(root, leaves)];
    while let Some((place, leaves)) = open.pop() {
        if let [leaf] = leaves {
            nodes[place] = *leaf;
            continue;
        }
        let (mut bounds, mut centres) = (Aabb::empty(), Aabb::empty());
        for leaf in &*leaves {
            bounds.extend(leaf.aabb.min).extend(leaf.aabb.max);
            centres.extend(leaf.aabb.center());
        }
        let axis = centres.largest_axis();
        let half = leaves.len() / 2;
        let centre = |leaf: &Bvh2Node| leaf.aabb.center()[axis];
        leaves.select_nth_unstable_by(half, |a, b| {
            centre(a).total_cmp(&centre(b)).then(a.first_index.cmp(&b.first_index))
        });
        let first = nodes.len();
        nodes[place] = Bvh2Node::new(bounds, 0, first as u32);
        nodes.extend([leaves[0]; 2]);
        let (left, right) = leaves.split_at_mut(half);
        open.extend([(first + 1, right), (first, left)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::{Bvh, BvhKind};

    /// A disc about the origin, with `rim` triangles.
    fn disc(rim: u32) -> Vec<[Vec3; 3]> {
        let at = |corner: u32| {
            let (sin, cos) = libm::sincosf(std::f32::consts::TAU * corner as f32 / rim as f32);
            Vec3::new(cos, sin, 0.0)
        };
        (0..rim).map(|corner| [Vec3::ZERO, at(corner), at(corner + 1)]).collect()
    }

    #[test]
    fn only_large_fans_are_set_apart() {
        assert!(find(&disc(2000)).is_empty());
        let lone = [Vec3::X, Vec3::Y, Vec3::Z];
        let mut triangles = disc(4096);
        triangles.insert(7, lone);
        let [fan] = &find(&triangles)[..] else { panic!("there is one") };
        assert_eq!(fan.len(), 4096);
        assert!(!fan.contains(&7));
        // Of a grid, six triangles meet at a corner.
        let grid: Vec<_> = (0..10_000)
            .map(|i| lone.map(|corner| corner + Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0)))
            .collect();
        assert!(find(&grid).is_empty());
    }

    #[test]
    fn fans_and_coincident_triangles_get_shallow_trees() {
        let coincident = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; 5000];
        let mut two = disc(5000);
        two.extend(disc(5000).iter().map(|triangle| triangle.map(|corner| corner + 4.0 * Vec3::Z)));
        two.extend(disc(64).iter().map(|triangle| triangle.map(|corner| 9.0 * corner + Vec3::ONE)));
        for triangles in [coincident, two] {
            for kind in [BvhKind::Bvh2, BvhKind::Bvh4, BvhKind::Cwbvh] {
                let bvh = Bvh::build(kind, &triangles);
                // PLOC alone would have a level for every other triangle, of which 60 are left before all is balanced.
                assert!(bvh.depth < 30, "{kind:?} has {} levels", bvh.depth);
                let mut order = bvh.order.clone();
                order.sort_unstable();
                assert!(order.iter().copied().eq(0..triangles.len() as u32), "each triangle lies in one leaf");
            }
        }
    }
}
