//! Mesh to patches and samples ([`crate::planning::method::sampling`]). A patch is a facet after refinement: facets are
//! bisected across their longest edge until no edge exceeds `patch_edge_mm`. A sample is one of k area-stratified points of a
//! patch, fixed by patch and seed and the same for every view; each stands for the k-th part of its patch. Patches that a small
//! region of interest or feature touches have more of them (`small_regions.rs`), and so have those that hold what is
//! asked where that is little (`little_asked.rs`).
//!
//! Part frame, millimetres. Cost: O(patches + samples); 120 bytes a patch and 31 a sample, for which the estimate of a
//! plan takes 38.

use std::ops::Range;

use nalgebra::{Point3, Vector3};

use super::context::{Context, PlanError, Refusal};
use super::ids::{PatchId, SampleId};
use super::params::{PartParams, Region, RegionParams};
use super::random::split_mix;
use crate::cell::FieldError;
use crate::geometry::{Mesh, parallel};

mod little_asked;
mod region_finder;
pub mod requirements;
mod small_regions;
mod subset;
#[cfg(test)]
mod tests;
pub(super) mod thinned;

use region_finder::{RegionFinder, border_mm, excluded};
use requirements::Requirements;
pub(super) use subset::{sample_some, systematic};

/// Default patch edge as a share of the bounding box's diagonal.
const PATCH_EDGE_OF_DIAGONAL: f64 = 1.0 / 60.0;
/// Default number of samples that a part gets at least: a share of the area is then known to about 0.1 points.
const SAMPLES_BY_DEFAULT: f64 = 50_000.0;
/// Largest number of patches or samples of one part: together they take about 24 GiB.
const MAX_SAMPLES: f64 = 40e6;

/// Patches, or samples, between two looks at whether to go on.
const PATCHES_PER_LOOK: usize = 4096;
/// Triangles that a thread cuts at once.
const FACES_A_BLOCK: usize = 4096;

/// A facet after refinement; of a surface that views are chosen on, one of which a sample stands for its stratum.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// Corners, part frame, mm.
    pub corners_mm: [Point3<f64>; 3],
    /// Triangle of the mesh it was cut from.
    pub face: u32,
    /// Unit outward normal, each component a whole f32.
    pub normal: Vector3<f64>,
    /// Area that its samples stand for: its own, but on a surface that views are chosen on ([`Surface::of_samples`]).
    pub area_mm2: f64,
    /// First sample of the patch, whose samples are `first_sample .. first_sample + samples`.
    pub first_sample: SampleId,
    /// Number of samples, at least 1.
    pub samples: u32,
}

impl Patch {
    /// Area that each of its samples stands for.
    #[must_use]
    pub fn sample_area_mm2(&self) -> f64 {
        self.area_mm2 / f64::from(self.samples)
    }
}

/// Patches and samples of a part. Samples are ordered by patch.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Patches: of a part, ordered by face, but where some of its triangles stand for others.
    pub patches: Vec<Patch>,
    /// Centre of the part's bounding box.
    pub centre_mm: Point3<f64>,
    /// Position of each sample, part frame, mm. The offset from the centre is a whole f32, so that an engine which keeps
    /// it as one sees the same point: within 4e-6 mm of the facet on a part of 120 mm.
    pub sample_mm: Vec<Point3<f64>>,
    /// Patch of each sample.
    pub sample_patch: Vec<PatchId>,
    /// True for samples that are asked for.
    pub asked: Vec<bool>,
    /// Requirements of the asked samples.
    pub requirements: Requirements,
}

/// A point with its unit normal and the kind of requirement on it.
#[derive(Clone, Copy, Debug)]
pub(in crate::planning) struct AskedPoint {
    pub(in crate::planning) mm: Point3<f64>,
    pub(in crate::planning) normal: Vector3<f64>,
    pub(in crate::planning) kind: u16,
}

impl Surface {
    /// Every sample, ascending.
    pub fn samples(&self) -> impl DoubleEndedIterator<Item = SampleId> + ExactSizeIterator + Clone + use<> {
        SampleId::first(self.sample_mm.len())
    }

    /// A sample with what is asked of it.
    pub(in crate::planning) fn asked_point(&self, sample: SampleId) -> AskedPoint {
        let (mm, normal) = (self.sample_mm[sample.index()], self.patch_of(sample).normal);
        AskedPoint { mm, normal, kind: self.requirements.kind(sample) }
    }

    /// The patch that a sample lies in.
    #[must_use]
    pub fn patch_of(&self, sample: SampleId) -> &Patch {
        &self.patches[self.sample_patch[sample.index()].index()]
    }

    /// Area that a sample stands for.
    #[must_use]
    pub fn sample_area_mm2(&self, sample: SampleId) -> f64 {
        self.patch_of(sample).sample_area_mm2()
    }

    /// Area of each sample, 0 where it is not asked for.
    #[must_use]
    pub fn asked_area_mm2(&self) -> Vec<f64> {
        self.areas_where(|sample| self.asked[sample.index()])
    }

    /// Sum of the areas of the samples that `keep` accepts, in sample order.
    #[must_use]
    pub fn area_where(&self, keep: impl Fn(SampleId) -> bool + Sync) -> f64 {
        self.areas_where(keep).iter().sum()
    }

    /// Area of each sample, 0 where `keep` refuses it.
    fn areas_where(&self, keep: impl Fn(SampleId) -> bool + Sync) -> Vec<f64> {
        parallel::map_range(self.sample_mm.len(), |index| {
            let sample = SampleId::at(index);
            if keep(sample) { self.sample_area_mm2(sample) } else { 0.0 }
        })
    }

    /// Resamples the patches, each of which stands for its area as before; nothing of the surface is asked yet.
    fn with_samples(&self, samples: &[u32], seed: u64) -> Self {
        let patch = |(patch, samples): (&Patch, &u32)| Patch { samples: *samples, ..*patch };
        Self::of_patches(vec![self.patches.iter().zip(samples).map(patch).collect()], self.centre_mm, seed)
    }

    /// Places the samples of patches, block after block, which have no first sample yet; nothing of the surface is asked yet.
    fn of_patches(blocks: Vec<Vec<Patch>>, centre_mm: Point3<f64>, seed: u64) -> Self {
        let (mut patches, mut first_patches) = (0, Vec::with_capacity(blocks.len()));
        for block in &blocks {
            first_patches.push(patches);
            patches += block.len();
        }
        let points = |block: usize| {
            let numbered = (first_patches[block] as u32..).zip(&blocks[block]);
            let points = numbered.flat_map(|(number, patch)| {
                let point = move |index| sample_point(&patch.corners_mm, (number, index), seed, &centre_mm);
                (0..patch.samples).map(move |index| (point(index), PatchId(number)))
            });
            points.unzip()
        };
        let placed: Vec<(Vec<Point3<f64>>, Vec<PatchId>)> = parallel::map_range(blocks.len(), points);
        let samples = placed.iter().map(|(points, _)| points.len()).sum();
        let mut surface = Self { centre_mm, ..Self::default() };
        surface.patches.reserve_exact(patches);
        surface.sample_mm.reserve_exact(samples);
        surface.sample_patch.reserve_exact(samples);
        let Self { patches: all_patches, sample_mm, sample_patch, .. } = &mut surface;
        let number_patches = || {
            let mut next = 0;
            all_patches.extend(blocks.into_iter().flatten().map(|patch| {
                let first_sample = SampleId::at(next);
                next += patch.samples as usize;
                Patch { first_sample, ..patch }
            }));
        };
        let join_samples = || {
            for (mut points, mut numbers) in placed {
                sample_mm.append(&mut points);
                sample_patch.append(&mut numbers);
            }
        };
        rayon::join(number_patches, join_samples);
        surface
    }
}

/// Refuses a surface of which nothing is asked for.
///
/// # Errors
/// [`PlanError::BadParams`] at `/regions/exclude`.
pub(super) fn check_asked(asked_area_mm2: &[f64]) -> Result<(), PlanError> {
    if asked_area_mm2.iter().any(|area_mm2| *area_mm2 > 0.0) {
        return Ok(());
    }
    Err(PlanError::param("/regions/exclude", &Refusal::NothingAsked))
}

/// Fills in what [`PartParams`] leaves to the size of the part, within the range of each parameter.
#[must_use]
pub fn resolve(params: &PartParams, mesh: &Mesh) -> PartParams {
    let in_range = |field: &str, value: f64| {
        let range = PartParams::KNOBS.knobs.iter().find(|knob| knob.field == field).and_then(|knob| knob.range);
        range.map_or(value, |[min, max]| value.clamp(min, max))
    };
    let mut resolved = params.clone();
    let patch_edge_mm = || in_range("patch_edge_mm", mesh.aabb().extent_mm().norm() * PATCH_EDGE_OF_DIAGONAL);
    resolved.patch_edge_mm.get_or_insert_with(patch_edge_mm);
    resolved.samples_per_mm2.get_or_insert_with(|| in_range("samples_per_mm2", SAMPLES_BY_DEFAULT / mesh.area_mm2()));
    resolved
}

/// Cuts `mesh` into patches and places the samples, after [`resolve`].
///
/// # Errors
/// A patch edge or a density that would give more than 40 million samples; an excluded group that the file lacks.
pub fn sample(mesh: &Mesh, params: &PartParams, regions: &RegionParams, seed: u64) -> Result<Surface, Vec<FieldError>> {
    cut(mesh, params, regions, seed, || Ok(()))
}

/// Cuts patches and samples; given up when the job is cancelled.
///
/// # Errors
/// Errors of [`sample`]; [`PlanError::Cancelled`].
pub fn sample_for(
    mesh: &Mesh,
    params: &PartParams,
    regions: &RegionParams,
    seed: u64,
    ctx: &Context<'_>,
) -> Result<Surface, PlanError> {
    cut(mesh, params, regions, seed, || Ok(ctx.check()?))
}

fn cut<E: From<Vec<FieldError>> + Send>(
    mesh: &Mesh,
    params: &PartParams,
    regions: &RegionParams,
    seed: u64,
    check: impl Fn() -> Result<(), E> + Sync,
) -> Result<Surface, E> {
    let params = resolve(params, mesh);
    let (edge_mm, density) = (params.patch_edge_mm.unwrap_or(f64::INFINITY), params.samples_per_mm2.unwrap_or(0.0));
    refuse_too_many(mesh, &params)?;
    let excluded = excluded(mesh, regions)?;
    let faces = mesh.faces.len();
    let block = |number: usize| {
        let first = number * FACES_A_BLOCK;
        patches_of(mesh, first..faces.min(first + FACES_A_BLOCK), (edge_mm, density), &check)
    };
    let blocks = parallel::try_map_range(faces.div_ceil(FACES_A_BLOCK), block)?;
    let mut surface = Surface::of_patches(blocks, mesh.aabb().centre(), seed);
    surface.asked = asked(mesh, &surface, &excluded, check)?;
    Ok(surface)
}

/// Patches of some triangles, without their first samples.
fn patches_of<E>(
    mesh: &Mesh,
    faces: Range<usize>,
    (edge_mm, density): (f64, f64),
    check: impl Fn() -> Result<(), E>,
) -> Result<Vec<Patch>, E> {
    let mut patches = Vec::with_capacity(faces.len());
    let mut stack = Vec::new();
    for face in faces {
        let normal = patch_normal(mesh, face);
        stack.push(mesh.corners(face));
        while let Some(corners_mm) = stack.pop() {
            if patches.len().is_multiple_of(PATCHES_PER_LOOK) {
                check()?;
            }
            match halves(&corners_mm, edge_mm) {
                Some([first, second]) => stack.extend([second, first]),
                None => {
                    let area_mm2 = triangle_mm2(&corners_mm);
                    let samples = (area_mm2 * density).round().max(1.0) as u32;
                    patches.push(Patch { corners_mm, face: face as u32, normal, area_mm2, first_sample: SampleId(0), samples });
                }
            }
        }
    }
    Ok(patches)
}

/// Unit normal of a triangle, each component a whole f32.
fn patch_normal(mesh: &Mesh, face: usize) -> Vector3<f64> {
    mesh.scaled_normal(face).normalize().map(rounded)
}

/// True for each sample that no excluded region holds.
fn asked<E: Send>(
    mesh: &Mesh,
    surface: &Surface,
    excluded: &[RegionFinder<'_>],
    check: impl Fn() -> Result<(), E> + Sync,
) -> Result<Vec<bool>, E> {
    if excluded.is_empty() {
        return Ok(vec![true; surface.sample_mm.len()]);
    }
    parallel::try_map_range(surface.sample_mm.len(), |index| {
        if index.is_multiple_of(PATCHES_PER_LOOK) {
            check()?;
        }
        let source_face = mesh.source_face[surface.patch_of(SampleId::at(index)).face as usize];
        Ok(!excluded.iter().any(|region| region.holds(source_face, &surface.sample_mm[index])))
    })
}

/// Places, among some regions of the mesh, of those that hold none of the samples.
#[must_use]
pub fn empty_regions<'a>(mesh: &Mesh, surface: &Surface, regions: impl Iterator<Item = &'a Region>) -> Vec<usize> {
    let border_mm = border_mm(mesh);
    let is_empty = |region: &RegionFinder| {
        let holds = |sample: SampleId| {
            let source_face = mesh.source_face[surface.patch_of(sample).face as usize];
            region.holds(source_face, &surface.sample_mm[sample.index()])
        };
        !surface.samples().any(holds)
    };
    let finders = regions.enumerate().map(|(index, region)| (index, RegionFinder::new(mesh, region, ("", border_mm)).ok()));
    finders.filter(|(_, finder)| finder.as_ref().is_some_and(is_empty)).map(|(index, _)| index).collect()
}

/// Upper bounds on the patches and samples of a part, after [`resolve`]; about twice as many as it is.
#[must_use]
pub(super) fn expected(mesh: &Mesh, params: &PartParams) -> [f64; 2] {
    let (edge_mm, density) = (params.patch_edge_mm.unwrap_or(f64::INFINITY), params.samples_per_mm2.unwrap_or(0.0));
    let of_face = |face: usize| {
        let (longest_mm, face_mm2) = (longest_edge_mm(&mesh.corners(face)), mesh.face_area_mm2(face));
        // Bisection leaves patches of at least about e²/8, except along slivers, where it halves the length.
        let cuts = if longest_mm > edge_mm { 2.0 * longest_mm / edge_mm } else { 0.0 };
        [1.0 + cuts + 8.0 * face_mm2 / (edge_mm * edge_mm), face_mm2]
    };
    let sum = |[patches, mm2]: [f64; 2], face: [f64; 2]| [patches + face[0], mm2 + face[1]];
    let faces = mesh.faces.len();
    let of_block = |block: usize| {
        let first = block * FACES_A_BLOCK;
        (first..faces.min(first + FACES_A_BLOCK)).map(of_face).fold([0.0, 0.0], sum)
    };
    let of_blocks = parallel::map_range(faces.div_ceil(FACES_A_BLOCK), of_block);
    let [patches, area_mm2] = of_blocks.into_iter().fold([0.0, 0.0], sum);
    [patches, patches + density * area_mm2]
}

fn refuse_too_many(mesh: &Mesh, params: &PartParams) -> Result<(), Vec<FieldError>> {
    let refuse = |name: &str, value: Option<f64>, samples: f64| {
        let value = value.unwrap_or(f64::INFINITY);
        let too_many = Refusal::TooManySamples { value, samples, max_samples: MAX_SAMPLES };
        Err(vec![FieldError { pointer: format!("/part/{name}"), detail: too_many.to_string() }])
    };
    let [patches, samples] = expected(mesh, params);
    if patches > MAX_SAMPLES {
        return refuse("patch_edge_mm", params.patch_edge_mm, patches);
    }
    if samples > MAX_SAMPLES { refuse("samples_per_mm2", params.samples_per_mm2, samples) } else { Ok(()) }
}

fn longest_edge_mm(corners: &[Point3<f64>; 3]) -> f64 {
    (0..3).map(|i| (corners[(i + 1) % 3] - corners[i]).norm()).fold(0.0, f64::max)
}

/// The two halves of a triangle across its longest edge, if that is longer than `edge_mm`.
fn halves(corners: &[Point3<f64>; 3], edge_mm: f64) -> Option<[[Point3<f64>; 3]; 2]> {
    let squared = |i: usize| (corners[(i + 1) % 3] - corners[i]).norm_squared();
    let longest = (1..3).fold(0, |best, i| if squared(i) > squared(best) { i } else { best });
    if squared(longest) <= edge_mm * edge_mm {
        return None;
    }
    let (a, b, c) = (corners[longest], corners[(longest + 1) % 3], corners[(longest + 2) % 3]);
    let middle = nalgebra::center(&a, &b);
    Some([[a, middle, c], [middle, b, c]])
}

/// Point `index` of a patch, its offset from the part's centre a whole f32.
fn sample_point(corners: &[Point3<f64>; 3], (patch, index): (u32, u32), seed: u64, centre_mm: &Point3<f64>) -> Point3<f64> {
    centre_mm + (stratified_point(corners, patch, index, seed) - centre_mm).map(rounded)
}

fn triangle_mm2(corners: &[Point3<f64>; 3]) -> f64 {
    0.5 * (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).norm()
}

/// The nearest f32.
fn rounded(value: f64) -> f64 {
    f64::from(value as f32)
}

/// Point `index` of a patch: the R2 sequence (Roberts 2018, *The Unreasonable Effectiveness of Quasirandom Sequences*),
/// shifted by a hash of patch and seed (Cranley and Patterson 1976), mapped to the triangle with uniform area
/// (Turk 1990, *Graphics Gems*, "Generating random points in triangles").
fn stratified_point(corners: &[Point3<f64>; 3], patch: u32, index: u32, seed: u64) -> Point3<f64> {
    const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let bits = split_mix(split_mix(seed) ^ u64::from(patch));
    let shift = [(bits >> 32) as f64, (bits & 0xffff_ffff) as f64].map(|half| (half + 0.5) / 4_294_967_296.0);
    let [s, t] = [0, 1].map(|axis| (shift[axis] + R2[axis] * f64::from(index)).fract());
    let root = s.sqrt();
    let [a, b, c] = corners.map(|corner| corner.coords);
    Point3::from(a * (1.0 - root) + b * (root * (1.0 - t)) + c * (root * t))
}
