//! The bounding volume hierarchy: built by obvhs, kept as the nodes that the kernels read.
//!
//! It also has the CPU traversal of the same nodes, which is the oracle of the kernels' traversal. This room knows
//! triangles and rays; it knows nothing of scene files, materials or the GPU.

mod fans;
mod instances;
mod sliver;
mod traverse;
mod wide;

use std::time::{Duration, Instant};

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::leaf_collapser;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantArray};

pub use traverse::{Hit, Primitive, Ray, Work, count_any, count_closest, trace_any, trace_closest};

use self::sliver::is_thin;
use crate::constants::{LEAF_BIT, LEAF_COUNT_SHIFT, LEAF_MAX_TRIANGLES, LISTED_TRIANGLES, WIDE_MAX_NODES};
use crate::layout::{Instance, Node};

/// Most triangles that a leaf reference can address.
pub const MAX_TRIANGLES: usize = 1 << LEAF_COUNT_SHIFT;

/// Most triangles that a list can hold.
pub const MAX_LISTED: usize = LISTED_TRIANGLES as usize;

/// Levels after which the rest of a tree is balanced. Trees of real scenes are shallower; but obvhs turns N coincident
/// boxes into a chain of N levels, and the kernels' stack has an entry for each level.
const FREE_LEVELS: u32 = 60;

/// Kinds of BVH.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
    VariantArray,
    EnumMessage,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum BvhKind {
    /// No tree, but up to 63 triangles that are compiled into the kernels; a ray is tested against all of them.
    List,
    /// Two children a node, boxes in f32.
    Bvh2,
    /// Four children a node, boxes in 8 bits.
    Bvh4,
    /// Eight children a node, boxes in 8 bits.
    Cwbvh,
}

impl BvhKind {
    /// The kinds that can hold that many triangles.
    pub fn all_of(triangles: usize) -> impl Iterator<Item = Self> {
        let list = (triangles <= MAX_LISTED).then_some(Self::List);
        list.into_iter().chain([Self::Bvh2, Self::Bvh4, Self::Cwbvh])
    }

    /// Children of a node; 1 for a list, which has no nodes.
    pub fn width(self) -> u32 {
        match self {
            Self::List => 1,
            Self::Bvh2 => 2,
            Self::Bvh4 => 4,
            Self::Cwbvh => 8,
        }
    }

    /// Most node slots that references can address.
    pub fn max_nodes(self) -> usize {
        match self {
            Self::List => 0,
            Self::Bvh2 => LEAF_BIT as usize,
            Self::Bvh4 | Self::Cwbvh => WIDE_MAX_NODES as usize,
        }
    }

    /// 16-byte texels of a node.
    pub fn node_texels(self) -> usize {
        match self {
            Self::List | Self::Bvh2 | Self::Bvh4 => 4,
            Self::Cwbvh => 5,
        }
    }
}

/// A BVH over triangles.
#[derive(Debug)]
pub struct Bvh {
    /// Its shape.
    pub kind: BvhKind,
    /// Inner nodes as the kernels read them, the root first. A tree of one leaf has a root with one child; a list has
    /// no nodes; a wide tree has a few empty slots between its nodes.
    pub texels: Vec<[u32; 4]>,
    /// Inner nodes.
    pub node_count: usize,
    /// For each place in leaf order, the index of the triangle in the input.
    pub order: Vec<u32>,
    /// Meshes in their places, of a tree of two levels: its leaves are instances of these, under each of which is a tree of
    /// triangles. Empty otherwise.
    pub instances: Vec<Instance>,
    /// Inner nodes on the longest path from the root to a leaf, at most 60 more than in a balanced tree of all leaves.
    /// A traversal never has more entries than that on its stack.
    pub depth: u32,
    /// Leaves that hold triangles.
    pub leaf_count: u32,
    /// Expected cost of a random ray that hits the root box, in triangle tests; a node visit costs as much as one.
    /// (Surface area heuristic, MacDonald and Booth 1990)
    pub sah_cost: f64,
    /// Whether some triangle is thin: its longest edge times its aspect, that edge over the height on it, is more than 32.
    pub has_thin_triangles: bool,
    /// Time that it took to build.
    pub build_time: Duration,
}

impl Bvh {
    /// Builds the hierarchy of at least 1 and at most [`MAX_TRIANGLES`] triangles. Kernels can use it if it has no more
    /// than [`BvhKind::max_nodes`].
    ///
    /// Every kind is made from the same binary tree: PLOC with reinsertion, no spatial splits.
    pub fn build(kind: BvhKind, triangles: &[[Vec3; 3]]) -> Self {
        let start = Instant::now();
        let mut bvh = match kind {
            BvhKind::List => Self::list(triangles.len()),
            kind => Self::tree(kind, triangles),
        };
        bvh.has_thin_triangles = triangles.par_iter().any(is_thin);
        bvh.build_time = start.elapsed();
        bvh
    }

    /// Whether its leaves are meshes in their places.
    pub fn has_two_levels(&self) -> bool {
        !self.instances.is_empty()
    }

    fn tree(kind: BvhKind, triangles: &[[Vec3; 3]]) -> Self {
        let most = if kind == BvhKind::Bvh2 { LEAF_MAX_TRIANGLES } else { 1 };
        Self::of_any_depth(kind, binary_tree(&boxes_of(triangles), &fans::find(triangles), most))
    }

    /// Lays a binary tree out, of no more levels than the kernels' stack has entries.
    fn of_any_depth(kind: BvhKind, mut tree: Bvh2) -> Self {
        let mut bvh = Self::of_tree(kind, &tree);
        if bvh.depth > FREE_LEVELS {
            limit_depth(&mut tree);
            bvh = Self::of_tree(kind, &tree);
        }
        bvh
    }

    /// Lays a binary tree out in nodes of that kind.
    fn of_tree(kind: BvhKind, tree: &Bvh2) -> Self {
        let mut bvh = Self {
            kind,
            texels: Vec::new(),
            node_count: 0,
            order: Vec::new(),
            instances: Vec::new(),
            depth: 0,
            leaf_count: 0,
            sah_cost: 0.0,
            has_thin_triangles: false,
            build_time: Duration::ZERO,
        };
        if kind == BvhKind::Bvh2 {
            bvh.flatten(tree);
        } else {
            wide::collapse(tree, &mut bvh);
        }
        bvh
    }

    /// No tree: one leaf of all triangles, in their input order.
    fn list(triangles: usize) -> Self {
        Self {
            kind: BvhKind::List,
            texels: Vec::new(),
            node_count: 0,
            order: (0..triangles as u32).collect(),
            instances: Vec::new(),
            depth: 0,
            leaf_count: 1,
            sah_cost: triangles as f64,
            has_thin_triangles: false,
            build_time: Duration::ZERO,
        }
    }

    /// Node slots, used or empty.
    pub fn node_places(&self) -> usize {
        self.texels.len() / self.kind.node_texels()
    }

    /// The texels of a node.
    fn wide_node(&self, index: u32) -> &[[u32; 4]] {
        let texels = self.kind.node_texels();
        &self.texels[index as usize * texels..][..texels]
    }

    /// The nodes of a two-wide tree.
    ///
    /// # Panics
    /// When the tree is of another kind.
    pub fn binary_nodes(&self) -> &[Node] {
        assert_eq!(self.kind, BvhKind::Bvh2, "another tree has other nodes");
        bytemuck::cast_slice(&self.texels)
    }

    /// Lays the tree out depth first, and its triangles in the order of its leaves.
    fn flatten(&mut self, tree: &Bvh2) {
        let mut nodes = Vec::with_capacity(tree.nodes.len() / 2 + 1);
        self.order.reserve(tree.primitive_indices.len());
        let root_area = f64::from(tree.nodes[0].aabb.half_area()).max(f64::MIN_POSITIVE);
        if tree.nodes[0].is_leaf() {
            let left = self.push_leaf(&tree.primitive_indices, &tree.nodes[0]);
            let mut root = Node { left, ..EMPTY };
            set_box(&mut root, Side::Left, &tree.nodes[0].aabb);
            self.texels = bytemuck::cast::<Node, [[u32; 4]; 4]>(root).to_vec();
            self.node_count = 1;
            self.depth = 1;
            self.sah_cost = f64::from(tree.nodes[0].prim_count);
            return;
        }
        let mut open = vec![Subtree { source: 0, referrer: None, depth: 1 }];
        while let Some(Subtree { source, referrer, depth }) = open.pop() {
            let node = &tree.nodes[source as usize];
            let area_share = f64::from(node.aabb.half_area()) / root_area;
            let reference = if node.is_leaf() {
                self.sah_cost += area_share * f64::from(node.prim_count);
                self.push_leaf(&tree.primitive_indices, node)
            } else {
                self.sah_cost += area_share;
                self.depth = self.depth.max(depth);
                let index = nodes.len();
                nodes.push(EMPTY);
                for (child, side) in [(1, Side::Right), (0, Side::Left)] {
                    let referrer = Some((index, side));
                    open.push(Subtree { source: node.first_index + child, referrer, depth: depth + 1 });
                }
                index as u32
            };
            if let Some((parent, side)) = referrer {
                match side {
                    Side::Left => nodes[parent].left = reference,
                    Side::Right => nodes[parent].right = reference,
                }
                set_box(&mut nodes[parent], side, &node.aabb);
            }
        }
        self.node_count = nodes.len();
        self.texels = bytemuck::cast_vec::<Node, [u32; 4]>(nodes);
    }

    fn push_leaf(&mut self, primitive_indices: &[u32], node: &Bvh2Node) -> u32 {
        let first = self.order.len() as u32;
        let range = node.first_index as usize..(node.first_index + node.prim_count) as usize;
        self.order.extend(&primitive_indices[range]);
        self.leaf_count += 1;
        leaf_reference(first, node.prim_count)
    }
}

/// obvhs's binary tree of PLOC with reinsertion, near its slower presets in traversal cost at a
/// fraction of their time, and without spatial splits, so that every triangle lies in one leaf and
/// every box holds its triangles whole.
///
/// As its preset `medium_build`, but with shorter series of reinsertions: 4 iterations instead of 16, after leaves are
/// merged as before. A wide tree, whose leaves stay single, gets no second series: it would save 0 to 2 % of the nodes
/// that a ray visits for an eighth of the build time.
fn binary_tree(boxes: &[Aabb], fans: &[Vec<u32>], max_leaf_triangles: u32) -> Bvh2 {
    /// Share of the nodes that one iteration of reinsertion moves at most.
    const REINSERTED: f32 = 0.05;
    /// Iterations, as shares of that share: the largest nodes are tried every time.
    const TURNS: [f32; 4] = [1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0];
    /// Levels from the leaves on that are joined only with direct neighbours.
    const NEAR_LEVELS: usize = 3;
    /// Cost of a node visit in triangle tests, when leaves are merged.
    const NODE_COST: f32 = 3.0;

    let ploc = |boxes: &[Aabb]| {
        let indices = (0..boxes.len() as u32).collect();
        PlocBuilder::new().build(PlocSearchDistance::Medium, boxes, indices, SortPrecision::U64, NEAR_LEVELS)
    };
    let mut tree = if fans.is_empty() { ploc(boxes) } else { fans::build(boxes, fans, ploc) };
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut tree, REINSERTED, Some(TURNS.to_vec()));
    if max_leaf_triangles > 1 {
        leaf_collapser::collapse(&mut tree, max_leaf_triangles, NODE_COST);
        optimizer.run(&mut tree, REINSERTED, Some(TURNS.to_vec()));
    }
    tree
}

/// Boxes of triangles.
fn boxes_of(triangles: &[[Vec3; 3]]) -> Vec<Aabb> {
    /// How far a triangle's box extends beyond it, as a share of its longest side. The triangle test projects corners
    /// along the ray to the origin's plane and rounds them there, so it may find a hit on a triangle that the ray
    /// misses by a few roundings of the triangle's length.
    const MARGIN: f32 = 16.0 * 5.960_464_5e-8;
    // At least to the next number, however small a triangle is for its place: a ray along an axis may lie in the plane of a
    // side, and misses the box if that plane is the triangle's.
    let below = |v: Vec3| Vec3::from(v.to_array().map(f32::next_down));
    let above = |v: Vec3| Vec3::from(v.to_array().map(f32::next_up));

    let box_of = |[a, b, c]: &[Vec3; 3]| {
        let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
        let margin = Vec3::splat(MARGIN * (high - low).max_element());
        Aabb::new(below(low - margin).into(), above(high + margin).into())
    };
    triangles.par_iter().map(box_of).collect()
}

fn set_box(node: &mut Node, side: Side, aabb: &Aabb) {
    let (low, high) = match side {
        Side::Left => (&mut node.left_low, &mut node.left_high),
        Side::Right => (&mut node.right_low, &mut node.right_high),
    };
    *low = aabb.min.into();
    *high = aabb.max.into();
}

/// A part of obvhs's tree that is still to be laid out.
struct Subtree {
    source: u32,
    /// The node that will refer to it, and from which side; `None` for the root.
    referrer: Option<(usize, Side)>,
    depth: u32,
}

/// Balances what is below [`FREE_LEVELS`] levels, with leaves in the order of the tree.
fn limit_depth(tree: &mut Bvh2) {
    let mut open = vec![(0, 1)];
    while let Some((index, level)) = open.pop() {
        let node = &tree.nodes[index];
        if node.is_leaf() {
            continue;
        }
        if level > FREE_LEVELS {
            balance(tree, index);
        } else {
            let first = node.first_index as usize;
            open.extend([(first, level + 1), (first + 1, level + 1)]);
        }
    }
}

/// Rebuilds a subtree in its own nodes: halves of its leaves, down to single ones.
fn balance(tree: &mut Bvh2, root: usize) {
    // Siblings are adjacent: an inner node stores the index of two others.
    let (mut pairs, mut leaves) = (Vec::new(), Vec::new());
    let mut open = vec![root];
    while let Some(index) = open.pop() {
        let node = tree.nodes[index];
        if node.is_leaf() {
            leaves.push(node);
        } else {
            pairs.push(node.first_index as usize);
            open.extend([node.first_index as usize + 1, node.first_index as usize]);
        }
    }
    let mut open = vec![(root, &leaves[..])];
    while let Some((index, leaves)) = open.pop() {
        if let [leaf] = leaves {
            tree.nodes[index] = *leaf;
        } else {
            let first = pairs.pop().expect("a tree has an inner node fewer than leaves");
            let aabb = leaves.iter().fold(Aabb::empty(), |aabb, leaf| aabb.union(&leaf.aabb));
            tree.nodes[index] = Bvh2Node::new(aabb, 0, first as u32);
            let (left, right) = leaves.split_at(leaves.len() / 2);
            open.extend([(first, left), (first + 1, right)]);
        }
    }
}

#[derive(Clone, Copy)]
enum Side {
    Left,
    Right,
}

/// A node whose children are empty and lie where no ray of a normalised scene goes.
const EMPTY: Node = Node {
    left_low: [1e30; 3],
    left: LEAF_BIT,
    left_high: [1e30; 3],
    unused0: 0,
    right_low: [1e30; 3],
    right: LEAF_BIT,
    right_high: [1e30; 3],
    unused1: 0,
};

fn leaf_reference(first: u32, count: u32) -> u32 {
    LEAF_BIT | (count << LEAF_COUNT_SHIFT) | first
}
