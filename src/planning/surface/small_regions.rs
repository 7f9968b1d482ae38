//! More samples for regions of interest and features that have few. A region of 20 mm² on a part of 40 000 mm² has some 25 of the
//! part's 50 000 samples, by which a share of 95 % of it is known to 4 points: the standard error of a share p that n samples tell is
//! √(p (1 − p) / n), less for samples that are spread over the region (W. G. Cochran 1977, *Sampling Techniques*, chapters 3 and 8).
//!
//! Patches that such a region touches are sampled more densely, all of them alike. A sample of a patch still stands for the k-th
//! part of it, so that the samples of every patch add up to its area, however many there are. How dense they are is decided by points
//! of a sequence of their own, not by the samples: what these say of an area stays without bias. Only that a region has too few is told
//! by its samples: one with about as many as it is to hold keeps them rather where they are many, which raises its area by less than half
//! its standard error.
//!
//! Samples of unequal areas a tell as much as n = (Σ a)² / Σ a² equal ones (L. Kish 1965, *Survey Sampling*, 11.7): by that number a region
//! has enough, not by its samples, which a smaller region in it may have drawn to one place. Each patch has the greatest density of those
//! that the regions which touch it want.
//!
//! Part frame, mm. Cost: regions with few samples × patches, and a second look at every sample where there are such regions.

#[cfg(test)]
mod tests;

use super::region_finder::{RegionFinder, border_mm, excluded};
use super::requirements::Requirements;
use super::{Patch, Surface, asked, sample_point};
use crate::cell::FieldError;
use crate::geometry::Mesh;
use crate::planning::context::{Cancelled, Context, PlanError};
use crate::planning::params::PlanParams;
use crate::planning::random::split_mix;

/// Samples, of equal area, that each region of interest and feature has at least, where its views are chosen: a share of 95 % of it is then known to
/// 2.2 points.
pub(in crate::planning) const SAMPLES_OF_A_REGION: usize = 100;

/// Deciding points that a region is to hold for each of its samples: samples that hold as many by chance as 100 are 25 fewer at 2.5
/// standard deviations. Our choice.
pub(super) const MARGIN: f64 = 1.25;
/// Samples that the patches which a region touches have together, for each that it is to hold: one that is a smaller part of them has fewer
/// samples. Our choice.
const MAX_FOR_EACH: usize = 50;
/// Samples that the patches of all such regions have together at most, or as many as the surface has without them.
pub(super) const MAX_OF_ALL: usize = 100_000;
/// Smallest and largest step by which the density is raised at a time.
const STEP: [f64; 2] = [1.1, 8.0];
/// Relative rounding of a number of samples: sums of areas that are equal.
const ROUNDING: f64 = 1e-9;
/// Name of the deciding points among what is hashed with the seed.
const DECIDING: u64 = 0x6465_6369_6469_6e67;

/// Sums over samples, by which they count as so many of equal area.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Effective {
    /// Sum of their areas, mm².
    area_mm2: f64,
    /// Sum of the squares of their areas, mm⁴.
    squares_mm4: f64,
}

impl Effective {
    /// Adds a number of samples of the same area.
    pub(super) fn add(&mut self, samples: usize, area_mm2: f64) {
        self.area_mm2 += samples as f64 * area_mm2;
        self.squares_mm4 += samples as f64 * area_mm2 * area_mm2;
    }

    /// Number of samples of equal area that tell as much: (Σ a)² / Σ a² (Kish 1965, 11.7); 0 where there is no area.
    pub(super) fn number(self) -> f64 {
        if self.squares_mm4 > 0.0 { self.area_mm2 * self.area_mm2 / self.squares_mm4 } else { 0.0 }
    }
}

/// Regions of interest and features that hold few asked samples.
pub(super) struct SmallRegions<'a> {
    mesh: &'a Mesh,
    /// One at least.
    regions: Vec<RegionFinder<'a>>,
    excluded: Vec<RegionFinder<'a>>,
    /// Samples that each is to hold.
    least: usize,
}

impl<'a> SmallRegions<'a> {
    /// Regions whose asked samples tell less than `least` of equal area; `None` where there are none.
    ///
    /// # Errors
    /// Regions that the mesh does not have.
    pub(super) fn of(
        mesh: &'a Mesh,
        surface: &Surface,
        params: &'a PlanParams,
        least: usize,
    ) -> Result<Option<Self>, Vec<FieldError>> {
        let (interest, features) = (&params.regions.interest, &params.regions.features);
        let mut held = vec![Effective::default(); interest.len() + features.len()];
        if held.is_empty() {
            return Ok(None);
        }
        for sample in surface.samples().filter(|sample| surface.asked[sample.index()]) {
            let area_mm2 = surface.sample_area_mm2(sample);
            surface.requirements.of(sample).regions.iter().for_each(|region| held[*region].add(1, area_mm2));
        }
        let all = interest.iter().map(|interest| &interest.region).chain(features.iter().map(|feature| &feature.region));
        let small = all.zip(held).filter(|(_, held)| held.number() < least as f64 * (1.0 - ROUNDING));
        let border_mm = border_mm(mesh);
        let regions = small.map(|(region, _)| RegionFinder::new(mesh, region, ("", border_mm)));
        let regions = regions.collect::<Result<Vec<_>, _>>()?;
        if regions.is_empty() {
            return Ok(None);
        }
        Ok(Some(Self { mesh, regions, excluded: excluded(mesh, &params.regions)?, least }))
    }

    /// Triangles of the mesh with an area that one of the regions may hold some of, ascending.
    pub(super) fn faces(&self) -> Vec<u32> {
        let touched = |face: &u32| {
            let face = *face as usize;
            let (source_face, corners) = (self.mesh.source_face[face], self.mesh.corners(face));
            self.mesh.face_area_mm2(face) > 0.0
                && self.regions.iter().any(|region| region.may_hold_some_of(source_face, &corners))
        };
        (0..self.mesh.faces.len() as u32).filter(touched).collect()
    }

    /// Number of samples of each patch with which the regions have enough, as far as that takes no more than they may have.
    fn samples_of_patches(&self, surface: &Surface, seed: u64, ctx: &Context<'_>) -> Result<Vec<u32>, Cancelled> {
        let mut samples: Vec<u32> = surface.patches.iter().map(|patch| patch.samples).collect();
        let of_all = surface.sample_mm.len().max(MAX_OF_ALL);
        let most = (MAX_FOR_EACH * self.least).min(of_all / self.regions.len());
        let seed = split_mix(seed ^ DECIDING);
        for region in &self.regions {
            ctx.check()?;
            let is_touched = |place: &usize| {
                let patch = &surface.patches[*place];
                region.may_hold_some_of(self.mesh.source_face[patch.face as usize], &patch.corners_mm)
            };
            let touched: Vec<usize> = (0..surface.patches.len()).filter(is_touched).collect();
            let area_mm2: f64 = touched.iter().map(|place| surface.patches[*place].area_mm2).sum();
            // Without the samples that other regions draw to some of the patches.
            let held = |per_mm2: f64| -> f64 {
                let mut held = Effective::default();
                for place in &touched {
                    let patch = &surface.patches[*place];
                    let count = patch.samples.max(samples_at(patch, per_mm2));
                    held.add(self.held(region, surface, (*place, count), seed), patch.area_mm2 / f64::from(count));
                }
                held.number()
            };
            let Some(per_mm2) = density(area_mm2, MARGIN * self.least as f64, most as f64, held) else { continue };
            for place in touched {
                samples[place] = samples[place].max(samples_at(&surface.patches[place], per_mm2));
            }
        }
        Ok(samples)
    }

    /// Asked points, of so many in a patch, that a region holds.
    fn held(&self, region: &RegionFinder<'_>, surface: &Surface, (place, samples): (usize, u32), seed: u64) -> usize {
        let patch = &surface.patches[place];
        let source_face = self.mesh.source_face[patch.face as usize];
        let is_held = |index: &u32| {
            let p = sample_point(&patch.corners_mm, (place as u32, *index), seed, &surface.centre_mm);
            region.holds(source_face, &p) && !self.excluded.iter().any(|excluded| excluded.holds(source_face, &p))
        };
        (0..samples).filter(is_held).count()
    }
}

/// The surface with more samples in the patches that a region touches whose samples tell less than `least` of equal area, sampled with
/// the same seed: those that it has, and others. The same surface where there is no such region.
///
/// # Errors
/// Regions that the mesh does not have; [`PlanError::Cancelled`].
pub(super) fn denser(
    mesh: &Mesh,
    surface: Surface,
    params: &PlanParams,
    (least, seed): (usize, u64),
    ctx: &Context<'_>,
) -> Result<Surface, PlanError> {
    let Some(mut small) = SmallRegions::of(mesh, &surface, params, least)? else { return Ok(surface) };
    while !small.regions.is_empty() {
        let samples = small.samples_of_patches(&surface, seed, ctx)?;
        if surface.patches.iter().zip(&samples).all(|(patch, samples)| patch.samples == *samples) {
            return Ok(surface);
        }
        let mut denser = surface.with_samples(&samples, seed);
        denser.asked = asked(mesh, &denser, &small.excluded, || ctx.check())?;
        if let Ok(requirements) = Requirements::new(mesh, &denser, params) {
            return Ok(Surface { requirements, ..denser });
        }
        // More samples find more overlaps of regions than can be told apart: only the first of the regions get more then.
        small.regions.truncate(small.regions.len() / 2);
    }
    Ok(surface)
}

/// Number of samples of a patch at a density.
pub(super) fn samples_at(patch: &Patch, per_mm2: f64) -> u32 {
    (patch.area_mm2 * per_mm2).round().max(1.0) as u32
}

/// Density at which a region holds so many of the points in patches of an area; less where these would be more than `most`. `None` where
/// it holds none even so. `held` tells how many it holds at a density.
pub(super) fn density(area_mm2: f64, wanted: f64, most: f64, held: impl Fn(f64) -> f64) -> Option<f64> {
    let densest = most / area_mm2;
    let mut per_mm2 = wanted / area_mm2;
    loop {
        per_mm2 = per_mm2.min(densest);
        let held = held(per_mm2);
        if held >= wanted || per_mm2 >= densest {
            return (held > 0.0).then_some(per_mm2);
        }
        per_mm2 *= (STEP[0] * wanted / held.max(1.0)).clamp(STEP[0], STEP[1]);
    }
}
