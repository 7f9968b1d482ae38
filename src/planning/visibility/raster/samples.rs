//! The samples in clusters of 64 neighbours, in the order of the rays' tree and among near ones by side, with what culls a
//! cluster whole. Offsets from the part's centre and normals are whole f32 already, so nothing is lost here. Memory: 31 bytes a
//! sample.

use std::ops::Range;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::clusters::Cone;
use super::pinhole::LANES;
use crate::geometry::{Aabb, parallel};
use crate::planning::ids::SampleId;
use crate::planning::surface::{Patch, Surface};
use crate::planning::visibility::SampleSet;

/// Neighbours in the tree that are sorted by the side that they face.
const NEIGHBOURS: usize = 1024;
/// Samples a cluster.
pub(super) const SAMPLES: usize = 64;
/// Lanes a cluster.
pub(super) const BATCHES: usize = SAMPLES / LANES;
/// Stands for no sample, at the end of the last cluster.
pub(super) const NO_SAMPLE: u32 = u32::MAX;

/// All samples of a surface.
pub(super) struct Samples {
    pub(super) clusters: Vec<SampleCluster>,
}

/// 64 samples.
pub(super) struct SampleCluster {
    /// Offset from the part's centre by axis, mm.
    pub(super) offset_mm: [[f32; SAMPLES]; 3],
    /// Unit normal by axis; zero where there is no sample, which faces nothing.
    pub(super) normal: [[f32; SAMPLES]; 3],
    /// Number of each sample in the surface, or [`NO_SAMPLE`].
    pub(super) number: [u32; SAMPLES],
    /// Kind of requirement of each sample.
    pub(super) kind: [u16; SAMPLES],
    /// Ball around the samples.
    centre_mm: Vector3<f64>,
    radius_mm: f64,
    cone: Cone,
}

impl Samples {
    /// Samples of `surface`, those of the first face in `order` first; numbers in it beyond the part's faces are passed over.
    pub(super) fn new(surface: &Surface, order: impl Iterator<Item = u32>) -> Self {
        // What is needed of the patches by itself: gathered in the order of the tree, they would be read from memory one by one.
        let face_of: Vec<u32> = parallel::map(&surface.patches, |patch| patch.face);
        let samples_of: Vec<Range<u32>> = parallel::map(&surface.patches, samples_of);
        let faces = face_of.iter().max().map_or(0, |last| *last as usize + 1);
        let mut first_patch = vec![0; faces + 1];
        face_of.iter().for_each(|face| first_patch[*face as usize + 1] += 1);
        (0..faces).for_each(|face| first_patch[face + 1] += first_patch[face]);
        let mut by_face: Vec<u32> = (0..face_of.len() as u32).collect();
        by_face.sort_by_key(|patch| face_of[*patch as usize]);
        let of_face = |face: &u32| {
            let patches = by_face[first_patch[*face as usize]..first_patch[*face as usize + 1]].iter();
            patches.flat_map(|patch| samples_of[*patch as usize].clone())
        };
        let mut in_order = Vec::with_capacity(faces);
        in_order.extend(order.filter(|face| (*face as usize) < faces));
        let mut numbers: Vec<u32> = Vec::with_capacity(surface.sample_mm.len());
        numbers.par_extend(in_order.par_iter().flat_map_iter(of_face));
        numbers.par_chunks_mut(NEIGHBOURS).for_each(|numbers| numbers.sort_by_cached_key(|number| side(surface, *number)));
        let chunks: Vec<&[u32]> = numbers.chunks(SAMPLES).collect();
        Self { clusters: parallel::map(&chunks, |numbers| SampleCluster::new(surface, numbers)) }
    }
}

fn samples_of(patch: &Patch) -> Range<u32> {
    patch.first_sample.0..patch.first_sample.0 + patch.samples
}

/// The side of a box that a sample's facet faces most, so that samples which face away together stand together.
fn side(surface: &Surface, number: u32) -> usize {
    let normal = surface.patch_of(SampleId(number)).normal;
    let axis = normal.iamax();
    2 * axis + usize::from(normal[axis] < 0.0)
}

impl Samples {
    /// Samples of each cluster that are not in `set`, one bit each.
    pub(super) fn outside(&self, set: &SampleSet) -> Vec<u64> {
        let bits = |cluster: &SampleCluster| {
            let outside = |number: u32| number != NO_SAMPLE && !set.holds(SampleId(number));
            cluster.number.iter().enumerate().fold(0, |bits, (place, number)| bits | u64::from(outside(*number)) << place)
        };
        self.clusters.iter().map(bits).collect()
    }
}

impl SampleCluster {
    fn new(surface: &Surface, numbers: &[u32]) -> Self {
        let offset = |number: &u32| surface.sample_mm[*number as usize] - surface.centre_mm;
        let aabb = numbers.iter().fold(Aabb::empty(), |aabb, number| aabb.with(&Point3::from(offset(number))));
        let centre_mm = aabb.centre().coords;
        let normals: Vec<_> = numbers.iter().map(|number| surface.patch_of(SampleId(*number)).normal).collect();
        let mut cluster = Self {
            offset_mm: [[0.0; SAMPLES]; 3],
            normal: [[0.0; SAMPLES]; 3],
            number: [NO_SAMPLE; SAMPLES],
            kind: [0; SAMPLES],
            centre_mm,
            radius_mm: numbers.iter().map(|number| (offset(number) - centre_mm).norm()).fold(0.0, f64::max) + 1e-6,
            cone: Cone::around(normals.iter()),
        };
        for (place, (number, normal)) in numbers.iter().zip(&normals).enumerate() {
            cluster.number[place] = *number;
            cluster.kind[place] = surface.requirements.kind(SampleId(*number));
            for axis in 0..3 {
                cluster.offset_mm[axis][place] = offset(number)[axis] as f32;
                cluster.normal[axis][place] = normal[axis] as f32;
            }
        }
        cluster
    }

    /// Returns true if every sample faces away from a point, relative to the part's centre.
    pub(super) fn faces_away(&self, centre_mm: &Vector3<f64>) -> bool {
        self.cone.faces_away(&(centre_mm - self.centre_mm), self.radius_mm)
    }

    /// One batch of offsets.
    #[inline(always)]
    pub(super) fn batch(&self, batch: usize) -> [&[f32; LANES]; 3] {
        lanes_of(&self.offset_mm, batch)
    }

    /// One batch of normals.
    #[inline(always)]
    pub(super) fn batch_of_normals(&self, batch: usize) -> [&[f32; LANES]; 3] {
        lanes_of(&self.normal, batch)
    }
}

#[inline(always)]
fn lanes_of([x, y, z]: &[[f32; SAMPLES]; 3], batch: usize) -> [&[f32; LANES]; 3] {
    [&x.as_chunks().0[batch], &y.as_chunks().0[batch], &z.as_chunks().0[batch]]
}
