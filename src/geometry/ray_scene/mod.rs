//! Decides whether a segment meets a surface: the query behind every visibility test. Triangles are two-sided.
//!
//! One tree serves two kinds of query. Single segments meet triangles in f64, watertight, so that a tree answers
//! exactly as the plain loop over all triangles does: they are the oracle. Many rays from one point are traced sixteen at
//! a time in f32 relative to that point ([`RayScene::blocked_from`], [`RayScene::first_hits_from`]), with the widest
//! vector instructions at hand; the answer is the same at every level and does not depend on which rays are asked
//! together. It differs from the exact one only for rays that pass an edge, or a triangle that they graze, within some
//! 10⁻⁷ of the distance (≤ 1 of 10⁵ random rays; edges between two triangles are no such edge).
//!
//! The binary tree comes from parry (`Binned`). Measured against obvhs 0.4 (PLOC, reinsertion, leaves collapsed by surface
//! area) with the same blocks, one thread: growing 1.1 M triangles takes 0.43 s and 0.46 s; first hits run 5 to 11 %
//! faster through parry's tree on six of seven meshes, and 9 % slower on a flat shell of few large triangles. Parry is
//! needed for collision anyway. Parts of many triangles are split first (`split.rs`): two cores grow 1.1 M triangles in two
//! thirds of the time, rays run through as fast, and who gives up need not wait.
//!
//! Size at 11 triangles a block, the usual filling: 7 bytes a triangle for nodes (224 each), 53 for blocks (592 each), 4
//! for the order, 12 for faces, 12 for vertices shared by six triangles: 88 in all; growing takes some 90 more for a while.
//! Cost: O(log n) a segment, some 5·10⁻⁷ s alone and 2·10⁻⁷ to 2·10⁻⁸ s in a packet.

use std::convert::Infallible;

use nalgebra::{Point3, Vector3};

use super::mesh::{Aabb, Mesh};
use super::simd::SimdLevel;
use cast::{Cast, Query};
use exact::Segment;
use lanes::each;
use tree::{ChildTarget, Tree};

mod cast;
mod exact;
mod gather;
mod lanes;
mod origin;
mod packet;
mod split;
#[cfg(test)]
mod tests;
mod tree;

/// Nodes and blocks that wait for their visit by a single segment at once, in most scenes.
const WAITING: usize = 48;

/// Meshes as one set of triangles that segments may meet.
pub struct RayScene {
    /// Everything below is relative to this, so that f32 is finest where the surface is.
    centre_mm: Point3<f64>,
    tree: Tree,
    vertices_mm: Vec<Point3<f64>>,
    /// Faces in the order of the leaves.
    faces: Vec<[u32; 3]>,
}

/// First intersection of a ray with the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Triangle, counted over all meshes of the scene.
    pub triangle: u32,
    /// The hit is `origin + share·direction`.
    pub share: f64,
}

impl RayScene {
    /// A scene of all triangles of `meshes`, which share one frame.
    #[must_use]
    pub fn new<'a>(meshes: impl IntoIterator<Item = &'a Mesh>) -> Self {
        let Ok(scene) = Self::interruptible(meshes, || Ok::<(), Infallible>(()));
        scene
    }

    /// [`RayScene::new`], given up when `check` fails; it is asked at least every 10 ms.
    ///
    /// # Errors
    /// The error of `check`.
    pub fn interruptible<'a, E: Send>(
        meshes: impl IntoIterator<Item = &'a Mesh>,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Self, E> {
        let (mut vertices_mm, mut faces) = (Vec::new(), Vec::new());
        for mesh in meshes {
            let first = vertices_mm.len() as u32;
            vertices_mm.extend_from_slice(&mesh.vertices_mm);
            faces.extend(mesh.faces.iter().map(|face| face.map(|vertex| first + vertex)));
        }
        let centre_mm = if faces.is_empty() { Point3::origin() } else { Aabb::around(&vertices_mm).centre() };
        vertices_mm.iter_mut().for_each(|vertex| *vertex -= centre_mm.coords);
        let corners = |face: u32| faces[face as usize].map(|vertex| vertices_mm[vertex as usize]);
        let tree = Tree::build(faces.len(), corners, check)?;
        let faces = tree.order.iter().map(|&face| faces[face as usize]).collect();
        Ok(Self { centre_mm, tree, vertices_mm, faces })
    }

    /// Returns true if a surface lies strictly between `from` and the point at `share` of the way to `to`.
    #[must_use]
    pub fn blocked(&self, from: &Point3<f64>, to: &Point3<f64>, share: f64) -> bool {
        let segment = Segment::new(from - self.centre_mm.coords, to - from, share, self.tree.reach);
        self.near(&segment).any(|face| segment.meets_triangle(&self.corners(face)))
    }

    /// [`RayScene::blocked`] without the tree: the oracle of tests.
    #[must_use]
    pub fn blocked_brute_force(&self, from: &Point3<f64>, to: &Point3<f64>, share: f64) -> bool {
        let segment = Segment::new(from - self.centre_mm.coords, to - from, share, self.tree.reach);
        (0..self.faces.len()).any(|face| segment.meets_triangle(&self.corners(face)))
    }

    /// Returns true if `point` lies inside the surface: most of three rays in unrelated directions cross it an odd number of
    /// times. Exact for closed surfaces; where a surface is open the majority decides.
    #[must_use]
    pub fn encloses(&self, point: &Point3<f64>) -> bool {
        const DIRECTIONS: [[f64; 3]; 3] = [[0.36, 0.48, 0.8], [-0.61, 0.27, 0.74], [0.19, -0.83, -0.52]];
        let odd = |direction: &[f64; 3]| {
            let segment = Segment::new(point - self.centre_mm.coords, Vector3::from(*direction), f64::INFINITY, self.tree.reach);
            self.near(&segment).filter(|&face| segment.meets_triangle(&self.corners(face))).count() % 2 == 1
        };
        DIRECTIONS.iter().filter(|direction| odd(direction)).count() >= 2
    }

    /// [`RayScene::blocked`] from one point to each of `targets`, sixteen at a time in f32. `blocked` is overwritten.
    pub fn blocked_from(
        &self,
        level: SimdLevel,
        origin: &Point3<f64>,
        targets: &[Point3<f64>],
        share: f64,
        blocked: &mut Vec<bool>,
    ) {
        blocked.clear();
        blocked.resize(targets.len(), false);
        level.run(Cast {
            tree: &self.tree,
            origin: origin - self.centre_mm.coords,
            rays: targets,
            direction: |target: &Point3<f64>| target - origin,
            end: (share as f32).min(f32::MAX),
            query: Blocked(blocked),
        });
    }

    /// First hits of the rays in each of `directions` from one point, sixteen at a time in f32. `hits` is overwritten.
    pub fn first_hits_from(
        &self,
        level: SimdLevel,
        origin: &Point3<f64>,
        directions: &[Vector3<f64>],
        hits: &mut Vec<Option<Hit>>,
    ) {
        hits.clear();
        hits.resize(directions.len(), None);
        level.run(Cast {
            tree: &self.tree,
            origin: origin - self.centre_mm.coords,
            rays: directions,
            direction: |direction: &Vector3<f64>| *direction,
            end: f32::MAX,
            query: FirstHits { hits, order: &self.tree.order },
        });
    }

    /// Memory that the scene holds.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        self.tree.size_bytes() + size_of_val(&*self.vertices_mm) + size_of_val(&*self.faces)
    }

    /// Triangles, in leaf order, whose boxes `segment` meets.
    fn near(&self, segment: &Segment) -> impl Iterator<Item = usize> {
        let mut waiting = Vec::with_capacity(WAITING);
        waiting.extend((!self.faces.is_empty()).then_some(ChildTarget::Node(0)));
        let mut block = (0_usize, 0_u32);
        std::iter::from_fn(move || {
            loop {
                let (first, slots) = &mut block;
                if *slots != 0 {
                    let slot = slots.trailing_zeros() as usize;
                    *slots &= *slots - 1;
                    return Some(*first + slot);
                }
                match waiting.pop()? {
                    ChildTarget::Block(index) => {
                        let leaf = &self.tree.blocks[index];
                        block = (leaf.first as usize, segment.meets_slots(leaf));
                    }
                    ChildTarget::Node(index) => {
                        let node = &self.tree.nodes[index];
                        waiting.extend(each(segment.meets_children(node)).map(|child| node.children[child].target()));
                    }
                }
            }
        })
    }

    fn corners(&self, face: usize) -> [Point3<f64>; 3] {
        self.faces[face].map(|vertex| self.vertices_mm[vertex as usize])
    }
}

struct Blocked<'a>(&'a mut [bool]);

impl Query for Blocked<'_> {
    const ANY_HIT: bool = true;

    #[inline(always)]
    fn hit(&mut self, ray: usize, _triangle: u32, _share: f32) {
        self.0[ray] = true;
    }
}

struct FirstHits<'a> {
    hits: &'a mut [Option<Hit>],
    order: &'a [u32],
}

impl Query for FirstHits<'_> {
    const ANY_HIT: bool = false;

    #[inline(always)]
    fn hit(&mut self, ray: usize, triangle: u32, share: f32) {
        self.hits[ray] = Some(Hit { triangle: self.order[triangle as usize], share: f64::from(share) });
    }
}
