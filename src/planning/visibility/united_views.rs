//! Samples that views measure together: one that a view measures is not looked at again for the next, so that many views cost
//! little more than the samples once.

#[cfg(test)]
mod tests;

use super::raster::OneByOne;
use super::view::Optics;
use super::{Occluders, Row, SampleSet, quality_scale, rays};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::params::{Engine, PlanParams};
use crate::planning::surface::Surface;

/// A surface ready for many sets of views.
pub(in crate::planning) struct UnitedViews<'a> {
    surface: &'a Surface,
    optics: &'a Optics,
    params: &'a PlanParams,
    occluders: &'a Occluders,
    ctx: &'a Context<'a>,
    /// `None` with the reference engine.
    raster: Option<OneByOne<'a>>,
}

impl<'a> UnitedViews<'a> {
    /// `optics` are those of the job's scanner, with what is asked of the samples of `surface`.
    pub(in crate::planning) fn new(
        surface: &'a Surface,
        optics: &'a Optics,
        occluders: &'a Occluders,
        params: &'a PlanParams,
        ctx: &'a Context<'a>,
    ) -> Self {
        let scale = quality_scale(params, surface);
        let raster = match params.visibility.engine {
            Engine::Raster => Some(OneByOne::new(surface, optics, scale, occluders, ctx)),
            Engine::Rays => None,
        };
        Self { surface, optics, params, occluders, ctx, raster }
    }

    /// The empty set of samples.
    pub(in crate::planning) fn nothing(&self) -> SampleSet {
        SampleSet::none_of(self.surface.sample_mm.len())
    }

    /// Samples outside `known` that a view measures, on the caller's thread: for views that are evaluated side by side.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn row(&self, pose: &Pose<Part, ScannerFrame>, known: &SampleSet) -> Result<Row, Cancelled> {
        self.evaluated(pose, known, false)
    }

    /// Samples outside `known` that a view measures; the threads share its samples.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn shared_row(&self, pose: &Pose<Part, ScannerFrame>, known: &SampleSet) -> Result<Row, Cancelled> {
        self.evaluated(pose, known, true)
    }

    /// Samples that at least one of some views measures; the threads share the samples of each view.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn measured<'p>(
        &self,
        poses: impl IntoIterator<Item = &'p Pose<Part, ScannerFrame>>,
    ) -> Result<SampleSet, Cancelled> {
        let mut measured = self.nothing();
        for pose in poses {
            self.ctx.check()?;
            measured.insert_all(self.evaluated(pose, &measured, true)?.measured());
        }
        Ok(measured)
    }

    fn evaluated(&self, pose: &Pose<Part, ScannerFrame>, known: &SampleSet, is_shared: bool) -> Result<Row, Cancelled> {
        let row = match &self.raster {
            Some(raster) => raster.row(pose, known, is_shared)?,
            None => {
                let (scale, rays) = (quality_scale(self.params, self.surface), self.occluders.rays());
                let cast = rays::cast(self.surface, &[*pose], self.optics, scale, rays, &self.ctx.silent())?;
                cast.rows.into_iter().next().unwrap_or_default().without(known)
            }
        };
        let requirements = &self.surface.requirements;
        if !requirements.any_requires_quality() {
            return Ok(row);
        }
        let view = self.optics.at(pose);
        Ok(row.regraded(|sample: SampleId, quality| {
            let normal = &self.surface.patch_of(sample).normal;
            view.counted_quality(&self.surface.sample_mm[sample.index()], normal, quality, requirements.kind(sample)).ok()
        }))
    }
}
