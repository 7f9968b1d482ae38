//! The tree over the triangles of a [`super::RayScene`]: nodes of up to [`WIDTH`] children, leaves of up to [`BLOCK`]
//! triangles. A binary tree by obvhs, its nodes merged from the root down, widest box first.

use nalgebra::Point3;
use obvhs::aabb::Aabb as ObvhsAabb;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a leaf at most.
pub(super) const BLOCK: usize = 16;

/// Boxes of the children, side by side so that all are tested at once.
#[repr(C, align(32))]
pub(super) struct Node {
    /// Lower x, y, z and upper x, y, z, a row each; infinite where there is no child.
    pub(super) planes: [[f32; WIDTH]; 6],
    pub(super) children: [Child; WIDTH],
}

/// A node, or a block of triangles.
#[derive(Clone, Copy)]
pub(super) struct Child(pub(super) u32);

pub(super) enum Target {
    Node(usize),
    Block(usize),
}

impl Child {
    const LEAF: u32 = 1 << 31;

    fn node(index: usize) -> Self {
        Self(index as u32)
    }

    fn block(index: usize) -> Self {
        Self(index as u32 | Self::LEAF)
    }

    #[inline(always)]
    pub(super) fn target(self) -> Target {
        let index = (self.0 & !Self::LEAF) as usize;
        if self.0 & Self::LEAF == 0 { Target::Node(index) } else { Target::Block(index) }
    }
}

/// The triangles of a leaf, side by side; what lies beyond `count` is all zeros, which nothing meets.
#[repr(C, align(16))]
pub(super) struct Block {
    /// `corners[corner][axis][triangle]`.
    pub(super) corners: [[[f32; BLOCK]; 3]; 3],
    /// Place of the first triangle in [`Tree::order`].
    pub(super) first: u32,
    pub(super) count: u32,
}

pub(super) struct Tree {
    /// The root first; none without triangles.
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    /// The triangles in the order of the leaves.
    pub(super) order: Vec<u32>,
    /// Largest coordinates of the scene.
    pub(super) half_extent: [f32; 3],
}

impl Tree {
    pub(super) fn build(triangles: usize, corners: impl Fn(u32) -> [Point3<f64>; 3]) -> Self {
        let boxes: Vec<_> = (0..triangles as u32).map(|triangle| outward_box(&corners(triangle))).collect();
        let mut tree = Self { nodes: Vec::new(), blocks: Vec::new(), order: Vec::with_capacity(triangles), half_extent: [0.0; 3] };
        if triangles > 0 {
            let binary = binary_tree(&boxes);
            let root = binary.nodes[0].aabb();
            tree.half_extent = std::array::from_fn(|axis| root.max[axis].max(-root.min[axis]));
            tree.widen(&binary.nodes, &binary.primitive_indices, &corners);
        }
        tree
    }

    /// Appends wide nodes depth first, so that neighbours in space are neighbours in memory.
    fn widen(&mut self, binary: &[Bvh2Node], triangles: &[u32], corners: &impl Fn(u32) -> [Point3<f64>; 3]) {
        self.nodes.push(Node::EMPTY);
        // Which binary nodes still wait for a place in which slot.
        let root = if binary[0].is_leaf() { vec![0] } else { merged(binary, 0) };
        let mut waiting = Vec::new();
        let place = |tree: &mut Self, parent: usize, members: &[usize], waiting: &mut Vec<(usize, usize, usize)>| {
            for (slot, &member) in members.iter().enumerate() {
                tree.nodes[parent].set_box(slot, &binary[member]);
            }
            waiting.extend(members.iter().enumerate().rev().map(|(slot, &member)| (parent, slot, member)));
        };
        place(self, 0, &root, &mut waiting);
        while let Some((parent, slot, member)) = waiting.pop() {
            let node = &binary[member];
            let child = if node.is_leaf() {
                let range = node.first_index as usize..(node.first_index + node.prim_count) as usize;
                self.push_block(&triangles[range], corners)
            } else {
                let index = self.nodes.len();
                self.nodes.push(Node::EMPTY);
                place(self, index, &merged(binary, member), &mut waiting);
                Child::node(index)
            };
            self.nodes[parent].children[slot] = child;
        }
    }

    fn push_block(&mut self, triangles: &[u32], corners: &impl Fn(u32) -> [Point3<f64>; 3]) -> Child {
        let mut block =
            Block { corners: [[[0.0; BLOCK]; 3]; 3], first: self.order.len() as u32, count: triangles.len() as u32 };
        for (lane, &triangle) in triangles.iter().enumerate() {
            for (corner, p) in corners(triangle).iter().enumerate() {
                for axis in 0..3 {
                    block.corners[corner][axis][lane] = p[axis] as f32;
                }
            }
        }
        self.order.extend(triangles);
        self.blocks.push(block);
        Child::block(self.blocks.len() - 1)
    }
}

impl Node {
    /// Boxes at infinity, which no ray reaches.
    const EMPTY: Self = Self { planes: [[f32::INFINITY; WIDTH]; 6], children: [Child(0); WIDTH] };

    fn set_box(&mut self, slot: usize, node: &Bvh2Node) {
        let (min, max) = (node.aabb().min, node.aabb().max);
        for axis in 0..3 {
            self.planes[axis][slot] = min[axis];
            self.planes[axis + 3][slot] = max[axis];
        }
    }
}

fn binary_tree(boxes: &[ObvhsAabb]) -> obvhs::bvh2::Bvh2 {
    let every = (0..boxes.len() as u32).collect();
    let mut binary =
        PlocBuilder::with_capacity(boxes.len()).build(PlocSearchDistance::Medium, boxes, every, SortPrecision::U64, 3);
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut binary, 0.05, None);
    collapse(&mut binary, BLOCK as u32, 12.0);
    optimizer.run(&mut binary, 0.1, None);
    binary
}

/// Descendants of an inner node that together make one wide node: whoever has the widest box gives way to its children.
fn merged(binary: &[Bvh2Node], node: usize) -> Vec<usize> {
    let children = |node: usize| [binary[node].first_index as usize, binary[node].first_index as usize + 1];
    let mut members = children(node).to_vec();
    while members.len() < WIDTH {
        let inner = members.iter().enumerate().filter(|(_, member)| !binary[**member].is_leaf());
        let area = |member: usize| binary[member].aabb().half_area();
        let Some((slot, &widest)) = inner.max_by(|a, b| area(*a.1).total_cmp(&area(*b.1))) else { break };
        let [left, right] = children(widest);
        members[slot] = left;
        members.insert(slot + 1, right);
    }
    members
}

/// The f32 box around a triangle, each face moved to the next f32 outwards.
fn outward_box(corners: &[Point3<f64>; 3]) -> ObvhsAabb {
    let aabb = super::Aabb::around(corners);
    let down = |x: f64| (x as f32).next_down();
    let up = |x: f64| (x as f32).next_up();
    let (min, max) = (aabb.min.map(down), aabb.max.map(up));
    ObvhsAabb::new([min.x, min.y, min.z].into(), [max.x, max.y, max.z].into())
}
