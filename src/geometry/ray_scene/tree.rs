//! The tree over the triangles of a [`super::RayScene`]: nodes of up to [`WIDTH`] children, blocks of up to [`BLOCK`]
//! triangles. Grown by parry as a binary tree; small subtrees become blocks, and nodes are merged from the root down,
//! largest surface first.

use nalgebra::Point3;
use parry3d::bounding_volume::Aabb as ParryAabb;
use parry3d::math::Vector as ParryVector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode, BvhNodeIndex, TraversalAction};

use crate::geometry::mesh::Aabb;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a block at most.
pub(super) const BLOCK: usize = 16;

/// Boxes of the children, side by side so that all are tested at once.
#[repr(C, align(32))]
pub(super) struct Node {
    /// Lower x, y, z and upper x, y, z, a row each; infinite where there is no child, which then is an empty block.
    pub(super) planes: [[f32; WIDTH]; 6],
    pub(super) children: [Child; WIDTH],
}

/// A node or a block, by its index.
#[derive(Clone, Copy)]
pub(super) struct Child(u32);

pub(super) enum Target {
    Node(usize),
    Block(usize),
}

impl Child {
    const BLOCK: u32 = 1 << 31;
    /// A block without triangles, at index 0.
    const NONE: Self = Self(Self::BLOCK);

    #[inline(always)]
    pub(super) fn target(self) -> Target {
        let index = (self.0 & !Self::BLOCK) as usize;
        if self.0 & Self::BLOCK == 0 { Target::Node(index) } else { Target::Block(index) }
    }
}

/// Triangles side by side; what lies beyond `count` is all zeros, which nothing meets.
#[repr(C, align(16))]
pub(super) struct Block {
    /// `corners[corner][axis][slot]`.
    pub(super) corners: [[[f32; BLOCK]; 3]; 3],
    /// Place of the first triangle in [`Tree::order`].
    pub(super) first: u32,
    pub(super) count: u32,
}

/// See the module.
pub(super) struct Tree {
    /// The root first; none without triangles.
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    /// The triangles in the order of the blocks.
    pub(super) order: Vec<u32>,
    /// No coordinate is larger.
    pub(super) reach: f32,
}

/// A node of the binary tree on its way into ours.
struct Subtree {
    index: BvhNodeIndex,
    node: BvhNode,
    /// Its triangles, if they fit a block.
    block: Option<Vec<u32>>,
}

impl Tree {
    pub(super) fn build(triangles: usize, corners: impl Fn(u32) -> [Point3<f64>; 3]) -> Self {
        let boxes: Vec<_> = (0..triangles as u32).map(|triangle| outward_box(&corners(triangle))).collect();
        let binary = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let reach = boxes.iter().map(|aabb| aabb.mins.abs().max(aabb.maxs.abs()).max_element()).fold(0.0, f32::max);
        drop(boxes);
        let mut tree = Self { nodes: Vec::new(), blocks: Vec::new(), order: Vec::with_capacity(triangles), reach };
        if triangles > 0 {
            tree.push_block(&[], &corners);
            tree.grow(&binary, &corners);
        }
        tree
    }

    pub(super) fn size_bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.blocks) + size_of_val(&*self.order)
    }

    /// Appends nodes and blocks depth first, so that neighbours in space are neighbours in memory.
    fn grow(&mut self, binary: &Bvh, corners: &impl Fn(u32) -> [Point3<f64>; 3]) {
        let mut waiting = Vec::new();
        self.push_node(members(binary, None), &mut waiting);
        while let Some((parent, slot, subtree)) = waiting.pop() {
            self.nodes[parent].children[slot] = match subtree.block {
                Some(triangles) => self.push_block(&triangles, corners),
                None => self.push_node(members(binary, Some(subtree.index)), &mut waiting),
            };
        }
    }

    fn push_node(&mut self, members: Vec<Subtree>, waiting: &mut Vec<(usize, usize, Subtree)>) -> Child {
        let index = self.nodes.len();
        let mut node = Node { planes: [[f32::INFINITY; WIDTH]; 6], children: [Child::NONE; WIDTH] };
        for (slot, member) in members.iter().enumerate() {
            let (mins, maxs) = (member.node.mins(), member.node.maxs());
            for axis in 0..3 {
                node.planes[axis][slot] = mins[axis];
                node.planes[axis + 3][slot] = maxs[axis];
            }
        }
        self.nodes.push(node);
        waiting.extend(members.into_iter().enumerate().rev().map(|(slot, member)| (index, slot, member)));
        Child(index as u32)
    }

    fn push_block(&mut self, triangles: &[u32], corners: &impl Fn(u32) -> [Point3<f64>; 3]) -> Child {
        let index = self.blocks.len() as u32;
        let (first, count) = (self.order.len() as u32, triangles.len() as u32);
        let mut block = Block { corners: [[[0.0; BLOCK]; 3]; 3], first, count };
        for (slot, &triangle) in triangles.iter().enumerate() {
            for (corner, p) in corners(triangle).iter().enumerate() {
                for axis in 0..3 {
                    block.corners[corner][axis][slot] = p[axis] as f32;
                }
            }
        }
        self.order.extend(triangles);
        self.blocks.push(block);
        Child(index | Child::BLOCK)
    }
}

/// Descendants of `parent`, or of all, that make one node: the one with the largest surface gives way to its children
/// while there is room.
fn members(binary: &Bvh, parent: Option<BvhNodeIndex>) -> Vec<Subtree> {
    let mut members = children(binary, parent);
    while members.len() < WIDTH {
        let large = members.iter().enumerate().filter(|(_, member)| member.block.is_none());
        let Some((slot, widest)) = large.max_by(|a, b| surface(&a.1.node).total_cmp(&surface(&b.1.node))) else { break };
        let halves = children(binary, Some(widest.index));
        members.splice(slot..=slot, halves);
    }
    members
}

fn children(binary: &Bvh, parent: Option<BvhNodeIndex>) -> Vec<Subtree> {
    let mut found = Vec::with_capacity(WIDTH);
    binary.traverse_indexed(parent, |node, index| {
        if parent == Some(index) {
            return TraversalAction::Continue;
        }
        found.push(Subtree { index, node: *node, block: block(binary, index) });
        TraversalAction::Prune
    });
    found
}

fn block(binary: &Bvh, root: BvhNodeIndex) -> Option<Vec<u32>> {
    let mut triangles = Vec::with_capacity(BLOCK + 1);
    binary.traverse_indexed(Some(root), |node, _| {
        triangles.extend(node.leaf_data());
        if triangles.len() > BLOCK { TraversalAction::EarlyExit } else { TraversalAction::Continue }
    });
    (triangles.len() <= BLOCK).then_some(triangles)
}

/// Half the surface of the box.
fn surface(node: &BvhNode) -> f32 {
    let extent = node.maxs() - node.mins();
    extent.x * extent.y + extent.y * extent.z + extent.z * extent.x
}

/// The f32 box around a triangle, each face moved to the next f32 outwards.
fn outward_box(corners: &[Point3<f64>; 3]) -> ParryAabb {
    let Aabb { min, max } = Aabb::around(corners);
    let down = |x: f64| (x as f32).next_down();
    let up = |x: f64| (x as f32).next_up();
    ParryAabb::new(ParryVector::new(down(min.x), down(min.y), down(min.z)), ParryVector::new(up(max.x), up(max.y), up(max.z)))
}
