//! More samples where little of the part is asked for. Of 0.02 mm² on a part of 7000 mm² one set of samples has an asked one and the next has
//! none, so that the seed would decide if there is anything to measure, and a second set could tell nothing of the views.
//!
//! Patches that are not excluded as a whole are sampled more densely, all of them alike, as those of small regions are
//! (`small_regions.rs`). How dense they are, and if what is asked is too little for samples, is decided by points that no seed changes:
//! every seed is accepted, or none.
//!
//! Part frame, mm. Cost: nothing where enough samples are asked; else a look at every patch, and at most some 100 000 points a few times.

use super::region_finder::{RegionFinder, excluded};
use super::small_regions::{Effective, MARGIN, MAX_OF_ALL, SAMPLES_OF_A_REGION, density, samples_at};
use super::{PATCHES_PER_LOOK, Patch, Surface, asked, sample_point};
use crate::cell::FieldError;
use crate::geometry::Mesh;
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::RegionParams;

/// Deciding points that what is asked holds at least: of fewer, samples may have none. Our choice.
const MIN_HELD: f64 = 10.0;
/// Seed of the deciding points.
const SEED: u64 = 0x6c69_7474_6c65;

/// The part without the regions that leave little of it.
pub(super) struct LittleAsked<'a> {
    mesh: &'a Mesh,
    excluded: Vec<RegionFinder<'a>>,
}

impl<'a> LittleAsked<'a> {
    /// Regions that leave fewer samples asked than each region of interest has; `None` where enough are.
    ///
    /// # Errors
    /// Regions that the mesh does not have.
    pub(super) fn of(mesh: &'a Mesh, surface: &Surface, regions: &'a RegionParams) -> Result<Option<Self>, Vec<FieldError>> {
        let count = surface.asked.iter().filter(|asked| **asked).take(SAMPLES_OF_A_REGION).count();
        if regions.exclude.is_empty() || count == SAMPLES_OF_A_REGION {
            return Ok(None);
        }
        Ok(Some(Self { mesh, excluded: excluded(mesh, regions)? }))
    }

    /// Triangles of the mesh with an area of which some may be asked, ascending.
    pub(super) fn faces(&self) -> Vec<u32> {
        let may_be_asked = |face: &u32| {
            let face = *face as usize;
            self.mesh.face_area_mm2(face) > 0.0
                && !self.excluded.iter().any(|region| region.holds_all_of(self.mesh.source_face[face], &self.mesh.corners(face)))
        };
        (0..self.mesh.faces.len() as u32).filter(may_be_asked).collect()
    }

    /// The surface, sampled with this seed, with more samples where some are asked: about `least` that are, as far as that takes no more
    /// than they may be. `None` where what is asked is too little for samples.
    pub(super) fn denser(
        &self,
        surface: &Surface,
        (least, seed): (usize, u64),
        ctx: &Context<'_>,
    ) -> Result<Option<Surface>, Cancelled> {
        let excludes = |patch: &Patch, region: &RegionFinder<'_>| {
            region.holds_all_of(self.mesh.source_face[patch.face as usize], &patch.corners_mm)
        };
        let mut partly = Vec::new();
        for (place, patch) in surface.patches.iter().enumerate() {
            if place.is_multiple_of(PATCHES_PER_LOOK) {
                ctx.check()?;
            }
            if !self.excluded.iter().any(|region| excludes(patch, region)) {
                partly.push(place);
            }
        }
        let area_mm2: f64 = partly.iter().map(|place| surface.patches[*place].area_mm2).sum();
        let held = |per_mm2: f64| -> f64 {
            let mut held = Effective::default();
            for place in &partly {
                let patch = &surface.patches[*place];
                let count = patch.samples.max(samples_at(patch, per_mm2));
                held.add(self.held(surface, *place, count), patch.area_mm2 / f64::from(count));
            }
            held.number()
        };
        let found = density(area_mm2, MARGIN * least as f64, MAX_OF_ALL as f64, held);
        let Some(per_mm2) = found.filter(|per_mm2| held(*per_mm2) >= MIN_HELD) else { return Ok(None) };
        let mut samples: Vec<u32> = surface.patches.iter().map(|patch| patch.samples).collect();
        for place in partly {
            samples[place] = samples[place].max(samples_at(&surface.patches[place], per_mm2));
        }
        let mut denser = surface.with_samples(&samples, seed);
        denser.asked = asked(self.mesh, &denser, &self.excluded, || ctx.check())?;
        Ok(Some(denser))
    }

    /// Deciding points, of so many in a patch, that are asked.
    fn held(&self, surface: &Surface, place: usize, points: u32) -> usize {
        let patch = &surface.patches[place];
        let source_face = self.mesh.source_face[patch.face as usize];
        let is_asked = |index: &u32| {
            let p = sample_point(&patch.corners_mm, (place as u32, *index), SEED, &surface.centre_mm);
            !self.excluded.iter().any(|region| region.holds(source_face, &p))
        };
        (0..points).filter(is_asked).count()
    }
}
