//! Wide nodes with quantised boxes: a binary tree collapsed to four or eight children a node.
//!
//! (Ylitie, Karras and Laine 2017, Efficient Incoherent Ray Traversal on GPUs Through Compressed
//! Wide BVHs, section 3; their node, with four children too.)

use std::collections::{HashMap, HashSet};
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use rayon::prelude::*;

use super::Bvh;
use crate::constants::{WIDE_INNER_BIT, WIDE_LEAF_TRIANGLES};
use crate::parallel;

/// Most children of a node.
const WIDEST: usize = 8;

/// Least number of subtrees that are collapsed in parallel, if a tree has that many.
const PARTS: usize = 128;

/// Nodes, triangles and costs of a part of the tree. Indices count within the part.
#[derive(Default)]
struct Part {
    /// Texels of the nodes, the part's root first.
    texels: Vec<[u32; 4]>,
    free: FreePlaces,
    order: Vec<u32>,
    depth: u32,
    node_count: u32,
    leaf_count: u32,
    sah_cost: f64,
}

impl Part {
    /// With a slot for its root.
    fn new(node_texels: usize) -> Self {
        Self { texels: vec![[0; 4]; node_texels], free: FreePlaces { start: 0, taken: 1 }, ..Self::default() }
    }
}

/// Node slots; those below `start` are taken or given up.
///
/// A child's index is the base index of its siblings plus its octant, so that no kernel has to read the parent for it.
/// Children of other nodes fill the gaps. (Tarjan and Yao 1979, Storing a Sparse Table: rows that are displaced until
/// their entries fall into gaps)
#[derive(Default)]
struct FreePlaces {
    start: usize,
    /// A bit for each slot from `start` on, set if it is taken.
    taken: u128,
}

impl FreePlaces {
    /// Takes slots for children in the octants whose bit is set, and returns the slot of octant 0.
    fn take(&mut self, octants: u8) -> usize {
        let wanted = (0..8).filter(|octant| octants & 1 << octant != 0);
        // A bit for each slot where octant 0 may be: there the slots of all children are free.
        let fits = wanted.fold(!0, |fits: u128, octant| fits & !self.taken >> octant);
        let first = fits.trailing_zeros();
        self.taken |= u128::from(octants) << first;
        let place = self.start + first as usize;
        // A single child in octant 7 leaves a gap of 7 slots. Earlier slots are all taken, or are given up so that
        // there is room ahead and children stay near each other.
        let used = u128::BITS - self.taken.leading_zeros();
        let passed = self.taken.trailing_ones().saturating_sub(7).max(used.saturating_sub(u128::BITS - 16));
        self.start += passed as usize;
        self.taken >>= passed;
        place
    }
}

/// A node of the binary tree that is to become a node of the wide one.
#[derive(Clone, Copy)]
struct Open {
    source: u32,
    /// Index in the part.
    index: usize,
    level: u32,
}

/// What the collapse knows about the whole tree.
struct Collapse<'a> {
    tree: &'a Bvh2,
    /// For each node of the tree.
    choices: Vec<AtomicU32>,
    width: usize,
    node_texels: usize,
    root_area: f64,
}

/// Collapses `tree`, whose leaves hold one triangle each, to nodes of the width of `bvh`'s kind.
///
/// The top of the tree comes first, level by level, until it has enough subtrees; each of them follows as a whole, so
/// that neighbours in space are neighbours in memory, however many threads there are.
pub(super) fn collapse(tree: &Bvh2, bvh: &mut Bvh) {
    let root_area = f64::from(tree.nodes[0].aabb.half_area()).max(f64::MIN_POSITIVE);
    let node_texels = bvh.kind.node_texels();
    let width = bvh.kind.width() as usize;
    let collapse = Collapse { tree, choices: choices(tree, width), width, node_texels, root_area };
    let mut top = Part::new(node_texels);
    let mut level = vec![Open { source: 0, index: 0, level: 1 }];
    while !level.is_empty() && level.len() < PARTS {
        level = level.into_iter().flat_map(|open| collapse.node(&mut top, open)).flatten().collect();
    }
    let mut parts = parallel::map(level.len(), &|open| collapse.subtree(level[open].source, level[open].level));

    // A part's root has its slot in the top, with its siblings; the rest of the part comes after the earlier parts.
    let (mut node_count, mut triangle_count) = (top.texels.len() / node_texels, top.order.len());
    let mut moves = Vec::with_capacity(parts.len());
    for part in &parts {
        moves.push((node_count - 1, triangle_count));
        node_count += part.texels.len() / node_texels - 1;
        triangle_count += part.order.len();
        top.depth = top.depth.max(part.depth);
        top.node_count += part.node_count;
        top.leaf_count += part.leaf_count;
        top.sah_cost += part.sah_cost;
    }
    parts.par_iter_mut().zip(moves).for_each(|(part, (nodes, triangles))| {
        for node in part.texels.chunks_exact_mut(node_texels) {
            node[1][0] += (nodes as u32) << 8;
            node[1][1] += triangles as u32;
        }
    });
    top.texels.reserve_exact(node_count * node_texels - top.texels.len());
    top.order.reserve_exact(triangle_count - top.order.len());
    for (part, root) in parts.iter().zip(level) {
        let (first, rest) = part.texels.split_at(node_texels);
        top.texels[root.index * node_texels..][..node_texels].copy_from_slice(first);
        top.texels.extend_from_slice(rest);
        top.order.extend_from_slice(&part.order);
    }
    (bvh.texels, bvh.order) = (top.texels, top.order);
    (bvh.node_count, bvh.depth) = (top.node_count as usize, top.depth);
    (bvh.leaf_count, bvh.sah_cost) = (top.leaf_count, top.sah_cost);
}

impl Collapse<'_> {
    fn choice(&self, node: u32) -> Choice {
        Choice(self.choices[node as usize].load(Relaxed))
    }

    /// Whether a node of the tree becomes a leaf when it is a child.
    fn is_leaf(&self, node: u32) -> bool {
        self.choice(node).share(1) == 0
    }

    /// The children of the wide node that a node of the tree becomes, and their number.
    fn children(&self, source: u32) -> ([u32; WIDEST], usize) {
        let (mut children, mut count) = ([source; WIDEST], 0);
        // Nodes, and how many children each of them is cut into.
        let mut open = [(source, self.width); WIDEST];
        let mut opened = 1;
        while opened > 0 {
            opened -= 1;
            let (node, mut most) = open[opened];
            let choice = self.choice(node);
            while most > 1 && choice.share(most) == 0 {
                most -= 1;
            }
            if most == 1 {
                children[count] = node;
                count += 1;
            } else {
                let (first, share) = (self.tree.nodes[node as usize].first_index, choice.share(most));
                open[opened] = (first, share);
                open[opened + 1] = (first + 1, most - share);
                opened += 2;
            }
        }
        (children, count)
    }

    /// All nodes below one of the binary tree, depth first.
    fn subtree(&self, source: u32, level: u32) -> Part {
        let mut part = Part::new(self.node_texels);
        let mut open = vec![Open { source, index: 0, level }];
        while let Some(next) = open.pop() {
            open.extend(self.node(&mut part, next).into_iter().flatten());
        }
        part
    }

    /// Writes a node to its slot, and takes slots for its inner children.
    fn node(&self, part: &mut Part, Open { source, index, level }: Open) -> [Option<Open>; WIDEST] {
        let tree = self.tree;
        let area_share = |aabb: &Aabb| f64::from(aabb.half_area()) / self.root_area;
        let node_box = &tree.nodes[source as usize].aabb;
        part.depth = part.depth.max(level);
        part.node_count += 1;
        part.sah_cost += area_share(node_box);
        let mut node = NodeWriter::new(node_box, part.order.len() as u32);
        let (children, count) = self.children(source);
        let (mut inner, mut inner_count) = ([0; WIDEST], 0);
        for &child in &children[..count] {
            let aabb = &tree.nodes[child as usize].aabb;
            if self.is_leaf(child) {
                let first = part.order.len() as u32;
                push_triangles(tree, child, &mut part.order);
                let count = part.order.len() as u32 - first;
                node.push_leaf(aabb, first, count);
                part.leaf_count += 1;
                part.sah_cost += area_share(aabb) * f64::from(count);
            } else {
                inner[inner_count] = child;
                inner_count += 1;
            }
        }
        let octants = place_children(tree, source, &inner[..inner_count]);
        let taken = (0..).zip(octants).map(|(octant, child)| u8::from(child.is_some()) << octant);
        let children = if inner_count > 0 { part.free.take(taken.sum()) } else { 0 };
        node.children = children as u32;
        let mut opened = [None; WIDEST];
        for (octant, child) in octants.into_iter().enumerate() {
            if let Some(child) = child {
                node.push_inner(&tree.nodes[child as usize].aabb, octant as u32);
                let index = children + octant;
                opened[octant] = Some(Open { source: child, index, level: level + 1 });
                let end = (index + 1) * self.node_texels;
                part.texels.resize(part.texels.len().max(end), [0; 4]);
            }
        }
        part.texels[index * self.node_texels..][..self.node_texels].copy_from_slice(&node.texels()[..self.node_texels]);
        opened
    }
}

/// Optimal cuts of a subtree into 1 to 8 wide children, four bits a count: how many of them are in the left subtree, or
/// 0 if fewer children cost no more. For one child it is 0 for a leaf and 1 for a node. For the full width of a node it
/// is never 0.
#[derive(Clone, Copy, Default)]
struct Choice(u32);

impl Choice {
    fn share(self, count: usize) -> usize {
        (self.0 >> (4 * (count - 1)) & 0xf) as usize
    }

    fn set(&mut self, count: usize, share: usize) {
        let place = 4 * (count - 1);
        self.0 = self.0 & !(0xf << place) | (share as u32) << place;
    }
}

/// Cost of the best cuts of a subtree.
#[derive(Clone, Copy)]
struct Weights {
    /// Cost of the subtree cut into at most N children; entry 0 is not used. A node costs the area of its box, a
    /// triangle of a leaf a share of the area of the leaf's box.
    costs: [f32; WIDEST + 1],
    /// Triangles in the subtree, or more than a leaf can hold.
    triangles: u32,
}

/// Cost of a triangle test in node visits, as measured on lavapipe for bounce rays.
const TRIANGLE_COST: f32 = 0.4;

impl Weights {
    fn of_triangle(aabb: &Aabb) -> Self {
        Self { costs: [TRIANGLE_COST * aabb.half_area(); WIDEST + 1], triangles: 1 }
    }

    /// Costs of a node with these children, and the cuts that give them.
    fn of_node(aabb: &Aabb, left: &Self, right: &Self, width: usize) -> (Self, Choice) {
        let area = aabb.half_area();
        let triangles = left.triangles + right.triangles;
        let (mut costs, mut choice) = ([f32::INFINITY; WIDEST + 1], Choice::default());
        for (count, least) in costs.iter_mut().enumerate().take(width + 1).skip(2) {
            // Starting at the middle, so that equal costs make a balanced tree.
            let mut best = count / 2;
            let cost = |share: usize| left.costs[share] + right.costs[count - share];
            for share in 1..count {
                if cost(share) < cost(best) {
                    best = share;
                }
            }
            choice.set(count, best);
            *least = cost(best);
        }
        let leaf =
            if triangles <= WIDE_LEAF_TRIANGLES { TRIANGLE_COST * area * triangles as f32 } else { f32::INFINITY };
        let node = area + costs[width];
        choice.set(1, usize::from(leaf > node || triangles > WIDE_LEAF_TRIANGLES));
        costs[1] = leaf.min(node);
        for count in 2..width {
            if costs[count - 1] <= costs[count] {
                choice.set(count, 0);
                costs[count] = costs[count - 1];
            }
        }
        (Self { costs, triangles: triangles.min(WIDE_LEAF_TRIANGLES + 1) }, choice)
    }
}

/// The cuts of every inner node that make the cheapest wide tree. (Ylitie, Karras and Laine 2017, section 3.1)
fn choices(tree: &Bvh2, width: usize) -> Vec<AtomicU32> {
    let choices: Vec<_> = (0..tree.nodes.len()).map(|_| AtomicU32::new(0)).collect();
    let inner = |node: u32| !tree.nodes[node as usize].is_leaf();
    let children = |node: u32| [0, 1].map(|side| tree.nodes[node as usize].first_index + side);
    let weigh = |node: u32, stack: &mut Vec<Weights>| {
        let aabb = &tree.nodes[node as usize].aabb;
        if !inner(node) {
            stack.push(Weights::of_triangle(aabb));
            return;
        }
        let (left, right) = (stack.pop().expect("the left child is weighed"), stack.pop().expect("and the right one"));
        let (weights, choice) = Weights::of_node(aabb, &left, &right, width);
        stack.push(weights);
        choices[node as usize].store(choice.0, Relaxed);
    };
    // A node, its left subtree, its right subtree.
    let in_order = |root: u32, ends: &dyn Fn(u32) -> bool| {
        let (mut order, mut open) = (Vec::new(), vec![root]);
        while let Some(node) = open.pop() {
            order.push(node);
            if !ends(node) {
                let [left, right] = children(node);
                open.extend([right, left]);
            }
        }
        order
    };

    let mut roots = vec![0];
    let mut top = HashSet::new();
    while roots.len() < PARTS && roots.iter().any(|root| inner(*root)) {
        top.extend(roots.iter().copied().filter(|root| inner(*root)));
        let open = |root: u32| if inner(root) { children(root).to_vec() } else { vec![root] };
        roots = roots.into_iter().flat_map(open).collect();
    }
    let weights = parallel::map(roots.len(), &|root| {
        let mut stack = Vec::new();
        for node in in_order(roots[root], &|node| !inner(node)).into_iter().rev() {
            weigh(node, &mut stack);
        }
        stack[0]
    });
    let parts: HashMap<u32, Weights> = roots.iter().copied().zip(weights).collect();
    let mut stack = Vec::new();
    for node in in_order(0, &|node| !top.contains(&node)).into_iter().rev() {
        match parts.get(&node) {
            Some(weights) => stack.push(*weights),
            None => weigh(node, &mut stack),
        }
    }
    choices
}

/// Gives each inner child the octant of the node that it lies in, unless another child has it, the best match first. A
/// ray visits children in the order of their octants exclusive-or its own.
fn place_children(tree: &Bvh2, source: u32, children: &[u32]) -> [Option<u32>; WIDEST] {
    let centre = |node: u32| Vec3::from(tree.nodes[node as usize].aabb.center());
    let middle = centre(source);
    // How far a child extends into each octant.
    let mut matches = [[0.0_f32; 8]; WIDEST];
    for (row, &child) in matches.iter_mut().zip(children) {
        let Vec3 { x, y, z } = centre(child) - middle;
        *row = [-x - y - z, -x - y + z, -x + y - z, -x + y + z, x - y - z, x - y + z, x + y - z, x + y + z];
    }
    let best_free = |row: &[f32; 8], free: u32| {
        let octants = (0..8).filter(|octant| free & 1 << octant != 0);
        octants.reduce(|best, octant| if row[octant] > row[best] { octant } else { best }).expect("there are eight")
    };
    let mut octants = [None; WIDEST];
    let (mut free, mut waiting) = (0xff_u32, (1_u32 << children.len()) - 1);
    let mut wanted = [0; WIDEST];
    for (octant, row) in wanted.iter_mut().zip(&matches) {
        *octant = best_free(row, free);
    }
    while waiting != 0 {
        let open = (0..children.len()).filter(|child| waiting & 1 << child != 0);
        let gain = |child: usize| matches[child][wanted[child]];
        let child = open.reduce(|best, child| if gain(child) > gain(best) { child } else { best });
        let child = child.expect("some child waits");
        let octant = wanted[child];
        octants[octant] = Some(children[child]);
        (free, waiting) = (free & !(1 << octant), waiting & !(1 << child));
        for other in (0..children.len()).filter(|other| waiting & 1 << other != 0) {
            if wanted[other] == octant {
                wanted[other] = best_free(&matches[other], free);
            }
        }
    }
    octants
}

fn push_triangles(tree: &Bvh2, source: u32, order: &mut Vec<u32>) {
    let mut open = vec![source as usize];
    while let Some(index) = open.pop() {
        let node = &tree.nodes[index];
        if node.is_leaf() {
            let first = node.first_index as usize;
            order.extend(&tree.primitive_indices[first..first + node.prim_count as usize]);
        } else {
            open.extend([node.first_index as usize + 1, node.first_index as usize]);
        }
    }
}

/// More than the rounding error of f64 for a position on a grid of 255 steps, in steps: even a plane at 10⁻³⁰ in a node
/// that extends to 1 must not be lost.
const ROUNDING: f64 = 1e-9;

/// A node before it is packed, children in the order in which they were pushed.
struct NodeWriter {
    origin: Vec3,
    /// Exponents of the grid's steps, with the bias of an f32.
    exponents: [u32; 3],
    /// Slot of the child in octant 0, whether there is one or not.
    children: u32,
    first_triangle: u32,
    pushed: usize,
    meta: [u8; 8],
    /// By axis: low and high planes of each child.
    planes: [[[u8; 8]; 2]; 3],
}

impl NodeWriter {
    fn new(aabb: &Aabb, first_triangle: u32) -> Self {
        let (low, high) = (Vec3::from(aabb.min), Vec3::from(aabb.max));
        Self {
            origin: low,
            exponents: std::array::from_fn(|axis| exponent(low[axis], high[axis])),
            children: 0,
            first_triangle,
            pushed: 0,
            meta: [0; 8],
            planes: [[[0; 8]; 2]; 3],
        }
    }

    fn push_inner(&mut self, aabb: &Aabb, octant: u32) {
        self.push(aabb, (1 << 5 | (WIDE_INNER_BIT + octant)) as u8);
    }

    fn push_leaf(&mut self, aabb: &Aabb, first: u32, count: u32) {
        let unary = (1 << count) - 1;
        self.push(aabb, (unary << 5 | (first - self.first_triangle)) as u8);
    }

    fn push(&mut self, aabb: &Aabb, meta: u8) {
        self.meta[self.pushed] = meta;
        for axis in 0..3 {
            // A power of two, whose reciprocal is exact.
            let steps = 1.0 / step(self.exponents[axis]);
            let origin = f64::from(self.origin[axis]);
            let (low, high) = (f64::from(aabb.min[axis]), f64::from(aabb.max[axis]));
            let (low, high) = ((low - origin) * steps - ROUNDING, (high - origin) * steps + ROUNDING);
            // The cast cuts off the fraction and keeps within [0, 255].
            let below = high as u8;
            self.planes[axis][0][self.pushed] = low as u8;
            self.planes[axis][1][self.pushed] = below.saturating_add(u8::from(f64::from(below) < high));
        }
        self.pushed += 1;
    }

    /// The layout of `wide.glsl`: five texels, of which four children need four.
    fn texels(&self) -> [[u32; 4]; 5] {
        let [x, y, z] = self.exponents;
        let mut words = [0; 20];
        words[..3].copy_from_slice(&self.origin.to_array().map(f32::to_bits));
        words[3] = x | y << 8 | z << 16;
        words[4] = self.children << 8;
        words[5] = self.first_triangle;
        for four in 0..2 {
            let pack = |bytes: &[u8; 8]| u32::from_le_bytes(std::array::from_fn(|i| bytes[4 * four + i]));
            words[6 + four] = pack(&self.meta);
            for (i, planes) in self.planes.as_flattened().iter().enumerate() {
                words[8 + 6 * four + i] = pack(planes);
            }
        }
        std::array::from_fn(|texel| std::array::from_fn(|word| words[4 * texel + word]))
    }
}

/// Least exponent with which 255 steps reach from `low` to `high`.
fn exponent(low: f32, high: f32) -> u32 {
    let extent = f64::from(high) - f64::from(low);
    // Far from the exponents of subnormal numbers, which devices may flush.
    let mut exponent = (extent / 255.0).log2().floor().clamp(-100.0, 100.0) as i32 + 127;
    while 255.0 * step(exponent as u32) < extent * (1.0 + ROUNDING) {
        exponent += 1;
    }
    exponent as u32
}

/// 2^(exponent - 127).
fn step(exponent: u32) -> f64 {
    f64::from(f32::from_bits(exponent << 23))
}
