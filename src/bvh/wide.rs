//! Wide nodes with quantised boxes: a binary tree collapsed to four or eight children a node.
//!
//! (Ylitie, Karras and Laine 2017, Efficient Incoherent Ray Traversal on GPUs Through Compressed
//! Wide BVHs, section 3; their node, with four children too.)

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;

use super::Bvh;
use crate::constants::{WIDE_INNER_BIT, WIDE_LEAF_TRIANGLES};

/// What a child's slot says of it: a code in `meta` and a place in the ray's order.
#[derive(Clone, Copy)]
struct Child {
    /// In the binary tree.
    source: u32,
    /// The octant of the node that it lies in, as far as others leave it free. A ray takes children
    /// in the order of their octants exclusive-or its own.
    octant: u32,
}

/// Collapses `tree`, whose leaves hold one triangle each, to nodes as wide as the kind of `bvh` has them.
pub(super) fn collapse(tree: &Bvh2, bvh: &mut Bvh) {
    let width = bvh.kind.width() as usize;
    let counts = triangle_counts(tree);
    let root_area = f64::from(tree.nodes[0].aabb.half_area()).max(f64::MIN_POSITIVE);
    let node_texels = bvh.kind.node_texels();
    bvh.order.reserve(tree.primitive_indices.len());
    bvh.texels.resize(node_texels, [0; 4]);
    // (node of the binary tree, node of the wide one, level)
    let mut open = vec![(0, 0, 1)];
    while let Some((source, index, depth)) = open.pop() {
        bvh.depth = bvh.depth.max(depth);
        bvh.sah_cost += f64::from(tree.nodes[source as usize].aabb.half_area()) / root_area;
        let mut children = place_children(tree, source, &widest_children(tree, source, width));
        let is_leaf = |child: &Child| counts[child.source as usize] <= WIDE_LEAF_TRIANGLES;

        let mut node = NodeWriter::new(&tree.nodes[source as usize].aabb, bvh.order.len() as u32);
        node.first_child = bvh.node_count() as u32;
        // Inner children lie in the order of their octants, for a count of bits to find them.
        children.sort_by_key(|child| child.octant);
        for child in &children {
            let Child { source, octant } = *child;
            let aabb = &tree.nodes[source as usize].aabb;
            if is_leaf(child) {
                let (first, count) = (bvh.order.len() as u32, counts[source as usize]);
                push_triangles(tree, source, &mut bvh.order);
                node.push_leaf(aabb, first, count);
                bvh.leaf_count += 1;
                bvh.sah_cost += f64::from(aabb.half_area()) / root_area * f64::from(count);
            } else {
                node.push_inner(aabb, octant);
                open.push((source, bvh.node_count() as u32, depth + 1));
                bvh.texels.resize(bvh.texels.len() + node_texels, [0; 4]);
            }
        }
        let start = index as usize * node_texels;
        bvh.texels[start..start + node_texels].copy_from_slice(&node.texels()[..node_texels]);
    }
}

/// Triangles under each node of the tree.
fn triangle_counts(tree: &Bvh2) -> Vec<u32> {
    let mut counts = vec![0; tree.nodes.len()];
    let mut open = vec![0_usize];
    let mut inner = Vec::new();
    while let Some(index) = open.pop() {
        let node = &tree.nodes[index];
        if node.is_leaf() {
            counts[index] = node.prim_count;
        } else {
            inner.push(index);
            open.extend([node.first_index as usize, node.first_index as usize + 1]);
        }
    }
    // Children come after their parents in `inner`.
    for index in inner.into_iter().rev() {
        let first = tree.nodes[index].first_index as usize;
        counts[index] = counts[first] + counts[first + 1];
    }
    counts
}

/// Up to `width` descendants that hold all of a node's triangles: its children, of which the one
/// with the largest surface is opened again and again. (Wald, Benthin and Boulos 2008, Getting Rid
/// of Packets)
fn widest_children(tree: &Bvh2, source: u32, width: usize) -> Vec<u32> {
    let mut children = vec![source];
    let area = |node: u32| tree.nodes[node as usize].aabb.half_area();
    while children.len() < width {
        let inner = (0..children.len()).filter(|&i| !tree.nodes[children[i] as usize].is_leaf());
        let Some(largest) = inner.max_by(|&a, &b| area(children[a]).total_cmp(&area(children[b]))) else { break };
        let first = tree.nodes[children[largest] as usize].first_index;
        children[largest] = first;
        children.push(first + 1);
    }
    children
}

/// Gives each child an octant of its own, the best match first.
fn place_children(tree: &Bvh2, source: u32, children: &[u32]) -> Vec<Child> {
    let centre = |node: u32| Vec3::from(tree.nodes[node as usize].aabb.center());
    let middle = centre(source);
    // How far a child lies into an octant.
    let mut matches: Vec<(f32, usize, u32)> = Vec::with_capacity(8 * children.len());
    for (i, &child) in children.iter().enumerate() {
        let offset = centre(child) - middle;
        for octant in 0..8 {
            let towards = Vec3::from_array([4, 2, 1].map(|bit| if octant & bit != 0 { 1.0 } else { -1.0 }));
            matches.push((offset.dot(towards), i, octant));
        }
    }
    matches.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut placed, mut taken) = (vec![None; children.len()], 0_u32);
    for (_, child, octant) in matches {
        if placed[child].is_none() && taken & 1 << octant == 0 {
            placed[child] = Some(octant);
            taken |= 1 << octant;
        }
    }
    let octants = placed.into_iter().map(|octant| octant.expect("there are eight octants"));
    children.iter().zip(octants).map(|(&source, octant)| Child { source, octant }).collect()
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

/// More than f64 rounds a place on a grid of 255 steps by, in steps: even a plane of 10⁻³⁰ in a node
/// that reaches to 1 must not be lost.
const ROUNDING: f64 = 1e-9;

/// A node on its way to memory, children in the order in which they were pushed.
struct NodeWriter {
    origin: Vec3,
    /// Exponents of the grid's steps, with the bias of an f32.
    exponents: [u32; 3],
    first_child: u32,
    inner_octants: u32,
    first_triangle: u32,
    children: usize,
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
            first_child: 0,
            inner_octants: 0,
            first_triangle,
            children: 0,
            meta: [0; 8],
            planes: [[[0; 8]; 2]; 3],
        }
    }

    fn push_inner(&mut self, aabb: &Aabb, octant: u32) {
        self.inner_octants |= 1 << octant;
        self.push(aabb, (1 << 5 | (WIDE_INNER_BIT + octant)) as u8);
    }

    fn push_leaf(&mut self, aabb: &Aabb, first: u32, count: u32) {
        let unary = (1 << count) - 1;
        self.push(aabb, (unary << 5 | (first - self.first_triangle)) as u8);
    }

    fn push(&mut self, aabb: &Aabb, meta: u8) {
        self.meta[self.children] = meta;
        for axis in 0..3 {
            let step = step(self.exponents[axis]);
            let origin = f64::from(self.origin[axis]);
            let (low, high) = (f64::from(aabb.min[axis]), f64::from(aabb.max[axis]));
            let (low, high) = ((low - origin) / step - ROUNDING, (high - origin) / step + ROUNDING);
            self.planes[axis][0][self.children] = low.floor().clamp(0.0, 255.0) as u8;
            self.planes[axis][1][self.children] = high.ceil().clamp(0.0, 255.0) as u8;
        }
        self.children += 1;
    }

    /// The layout of `wide.glsl`: five texels, of which four children need four.
    fn texels(&self) -> [[u32; 4]; 5] {
        let [x, y, z] = self.exponents;
        let mut words = [0; 20];
        words[..3].copy_from_slice(&self.origin.to_array().map(f32::to_bits));
        words[3] = x | y << 8 | z << 16;
        words[4] = self.first_child << 8 | self.inner_octants;
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

/// Least exponent whose 255 steps reach from `low` to `high`.
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
