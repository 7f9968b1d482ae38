//! The tree over the triangles of a [`super::RayScene`]: nodes of up to [`WIDTH`] children, blocks of up to [`BLOCK`]
//! triangles. Grown by parry as a binary tree; small subtrees become blocks, and nodes are merged from the root down,
//! largest surface first. Parry cannot be interrupted, so many triangles are split into compact parts (`split.rs`), of which
//! each becomes a tree of its own, side by side, and the parts' boxes become the tree above them.

use nalgebra::Point3;
use parry3d::bounding_volume::{Aabb as ParryAabb, BoundingVolume};
use parry3d::math::Vector as ParryVector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode, BvhNodeIndex, TraversalAction};
use rayon::prelude::*;

use super::split::{self, PART};
use crate::geometry::mesh::Aabb;
use crate::geometry::parallel;
use crate::geometry::simd::prefetch;

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

pub(super) enum ChildTarget {
    Node(usize),
    Block(usize),
}

impl Child {
    const BLOCK: u32 = 1 << 31;
    /// A block without triangles, at index 0.
    const NONE: Self = Self(Self::BLOCK);

    #[inline(always)]
    pub(super) fn target(self) -> ChildTarget {
        let index = (self.0 & !Self::BLOCK) as usize;
        if self.0 & Self::BLOCK == 0 { ChildTarget::Node(index) } else { ChildTarget::Block(index) }
    }
}

/// Triangles side by side; what lies beyond `count` is all zeros, which nothing meets.
#[derive(Default)]
#[repr(C, align(16))]
pub(super) struct Block {
    /// `corners[corner][axis][slot]`.
    pub(super) corners: [[[f32; BLOCK]; 3]; 3],
    /// Place of the first triangle in [`Tree::order`].
    pub(super) first: u32,
    pub(super) count: u32,
}

/// The bounding volume hierarchy over the triangles of a scene.
#[derive(Default)]
pub(super) struct Tree {
    /// The root first; none without triangles.
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    /// The triangles in the order of the blocks.
    pub(super) order: Vec<u32>,
    /// Largest absolute coordinate of any triangle.
    pub(super) reach: f32,
}

/// A node of the binary tree on its way into ours.
struct Subtree {
    index: BvhNodeIndex,
    node: BvhNode,
    /// Leaves below the node, if they are few enough to be none of our nodes.
    leaves: Option<Vec<u32>>,
}

impl Tree {
    /// Asks for a child before its visit: most that are met are visited, since most rays are not blocked.
    #[inline(always)]
    pub(super) fn prefetch(&self, child: Child) {
        match child.target() {
            ChildTarget::Node(index) => prefetch(&self.nodes[index]),
            ChildTarget::Block(index) => prefetch(&self.blocks[index]),
        }
    }

    /// A tree over the triangles with these corners. `check` is asked every few milliseconds.
    ///
    /// # Errors
    /// The error of `check`.
    pub(super) fn build<E: Send>(
        triangles: usize,
        corners: impl Fn(u32) -> [Point3<f64>; 3] + Sync,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Self, E> {
        let mut boxes = vec![ParryAabb::new_invalid(); triangles];
        boxes.par_chunks_mut(PART).enumerate().try_for_each(|(part, boxes)| {
            check()?;
            boxes.iter_mut().zip((part * PART) as u32..).for_each(|(aabb, triangle)| *aabb = outward_box(&corners(triangle)));
            Ok(())
        })?;
        let reach = boxes.iter().map(|aabb| aabb.mins.abs().max(aabb.maxs.abs()).max_element()).fold(0.0, f32::max);
        let parts = split::into_parts((0..triangles as u32).collect(), &boxes, &check)?;
        let grown = |part: &Vec<u32>| {
            check()?;
            let own: Vec<_> = part.iter().map(|triangle| boxes[*triangle as usize]).collect();
            let corners = |leaf: u32| corners(part[leaf as usize]);
            let mut tree = Self::of(&own, reach, BLOCK, |tree, leaves| tree.push_block(leaves, &corners));
            tree.order.iter_mut().for_each(|leaf| *leaf = part[*leaf as usize]);
            Ok(tree)
        };
        let mut trees = parallel::try_map(&parts, grown)?;
        check()?;
        if trees.len() == 1 {
            return Ok(trees.remove(0));
        }
        let around = |part: &Vec<u32>| {
            let own = part.iter().map(|triangle| boxes[*triangle as usize]);
            own.reduce(|all, aabb| all.merged(&aabb)).unwrap_or_else(ParryAabb::new_invalid)
        };
        let around = parallel::map(&parts, around);
        // The whole takes as much again as its parts, less the little that is copied at a time.
        drop((parts, boxes));
        let mut whole = Self::with_room_for(&trees);
        whole.reach = reach;
        whole.put_in(&around, 1, |tree, parts| {
            parts.first().map_or(Child::NONE, |part| tree.append(std::mem::take(&mut trees[*part as usize])))
        });
        Ok(whole)
    }

    /// A tree without nodes that takes over others without growing, and a few nodes above them.
    fn with_room_for(trees: &[Self]) -> Self {
        let sum = |count: fn(&Self) -> usize| trees.iter().map(count).sum::<usize>();
        Self {
            nodes: Vec::with_capacity(sum(|tree| tree.nodes.len()) + trees.len()),
            blocks: Vec::with_capacity(sum(|tree| tree.blocks.len()) + 1),
            order: Vec::with_capacity(sum(|tree| tree.order.len())),
            reach: 0.0,
        }
    }

    /// A tree over boxes, up to `leaf` of which are put in by `push`.
    fn of(boxes: &[ParryAabb], reach: f32, leaf: usize, push: impl FnMut(&mut Self, &[u32]) -> Child) -> Self {
        let mut tree = Self { reach, ..Self::default() };
        tree.put_in(boxes, leaf, push);
        tree
    }

    /// Puts boxes into a tree that is empty yet.
    fn put_in(&mut self, boxes: &[ParryAabb], leaf: usize, mut push: impl FnMut(&mut Self, &[u32]) -> Child) {
        self.blocks.push(Block::default());
        if !boxes.is_empty() {
            let binary = Bvh::from_leaves(BvhBuildStrategy::Binned, boxes);
            self.grow(&binary, leaf, &mut push);
        }
    }

    /// Takes over all of another tree; its root.
    fn append(&mut self, other: Self) -> Child {
        let [nodes, blocks, triangles] = [self.nodes.len(), self.blocks.len() - 1, self.order.len()].map(|count| count as u32);
        self.nodes.extend(other.nodes.into_iter().map(|mut node| {
            for child in &mut node.children {
                *child = match child.target() {
                    ChildTarget::Node(index) => Child(nodes + index as u32),
                    ChildTarget::Block(0) => Child::NONE,
                    ChildTarget::Block(index) => Child(Child::BLOCK | (blocks + index as u32)),
                };
            }
            node
        }));
        // Each begins with the block without triangles.
        self.blocks.extend(other.blocks.into_iter().skip(1).map(|block| Block { first: triangles + block.first, ..block }));
        self.order.extend(other.order);
        Child(nodes)
    }

    pub(super) fn size_bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.blocks) + size_of_val(&*self.order)
    }

    /// Appends nodes and leaves depth first, so that neighbours in space are neighbours in memory.
    fn grow(&mut self, binary: &Bvh, leaf: usize, push: &mut impl FnMut(&mut Self, &[u32]) -> Child) {
        let mut waiting = Vec::new();
        self.push_node(members(binary, None, leaf), &mut waiting);
        while let Some((parent, slot, subtree)) = waiting.pop() {
            self.nodes[parent].children[slot] = match subtree.leaves {
                Some(leaves) => push(self, &leaves),
                None => self.push_node(members(binary, Some(subtree.index), leaf), &mut waiting),
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
fn members(binary: &Bvh, parent: Option<BvhNodeIndex>, leaf: usize) -> Vec<Subtree> {
    let mut members = children(binary, parent, leaf);
    while members.len() < WIDTH {
        let large = members.iter().enumerate().filter(|(_, member)| member.leaves.is_none());
        let Some((slot, widest)) = large.max_by(|a, b| surface(&a.1.node).total_cmp(&surface(&b.1.node))) else { break };
        let halves = children(binary, Some(widest.index), leaf);
        members.splice(slot..=slot, halves);
    }
    members
}

fn children(binary: &Bvh, parent: Option<BvhNodeIndex>, leaf: usize) -> Vec<Subtree> {
    let mut found = Vec::with_capacity(WIDTH);
    binary.traverse_indexed(parent, |node, index| {
        if parent == Some(index) {
            return TraversalAction::Continue;
        }
        found.push(Subtree { index, node: *node, leaves: leaves(binary, index, leaf) });
        TraversalAction::Prune
    });
    found
}

/// The leaves below a node, if they are not more than `most`.
fn leaves(binary: &Bvh, root: BvhNodeIndex, max: usize) -> Option<Vec<u32>> {
    let mut leaves = Vec::with_capacity(max + 1);
    binary.traverse_indexed(Some(root), |node, _| {
        leaves.extend(node.leaf_data());
        if leaves.len() > max { TraversalAction::EarlyExit } else { TraversalAction::Continue }
    });
    (leaves.len() <= max).then_some(leaves)
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
