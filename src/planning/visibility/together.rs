//! Samples that views measure together: one that a view measures is not looked at again for the next, so that many views cost
//! little more than the samples once.

use super::raster::OneByOne;
use super::view::Optics;
use super::{Occluders, Row, SampleSet, quality_scale, rays};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::params::{Engine, PlanParams};
use crate::planning::surface::Surface;

/// A surface ready for many sets of views.
pub(in crate::planning) struct Together<'a> {
    surface: &'a Surface,
    optics: &'a Optics,
    params: &'a PlanParams,
    occluders: &'a Occluders,
    ctx: &'a Context<'a>,
    /// `None` with the reference engine.
    raster: Option<OneByOne<'a>>,
}

impl<'a> Together<'a> {
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

    /// No sample.
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
        Ok(row.retained(|sample: SampleId, quality| {
            let normal = &self.surface.patch_of(sample).normal;
            view.meets_requirement(&self.surface.sample_mm[sample.index()], normal, quality, requirements.kind(sample))
        }))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::geometry::Mesh;
    use crate::planning::candidates::{looking_along, spiral};
    use crate::planning::context::Silent;
    use crate::planning::params::{InterestParams, Region};
    use crate::planning::registration::union_of;
    use crate::planning::surface::requirements;
    use crate::planning::verdict::Grade;
    use crate::planning::visibility::cast;
    use crate::testing::{nominal_scanner, trough};

    /// Views of the trough from all around, at best focus of its middle.
    fn views(count: usize, best_mm: f64) -> Vec<Pose<Part, ScannerFrame>> {
        spiral(count, -1.0).map(|out| Pose::from_parts(out * best_mm, looking_along(&-out, 0.0))).collect()
    }

    fn params(engine: Engine, mesh: &Mesh) -> PlanParams {
        let mut params = PlanParams::default();
        (params.visibility.engine, params.part.patch_edge_mm) = (engine, Some(12.0));
        params.part.samples_per_mm2 = Some(3_000.0 / mesh.area_mm2());
        params
    }

    #[test]
    fn views_measure_together_what_they_measure_one_by_one() {
        let (mesh, scanner, cancel) = (trough(), nominal_scanner(), AtomicBool::new(false));
        let (ctx, occluders) = (Context::new(&cancel, &Silent), Occluders::new([&mesh]));
        let poses = views(14, scanner.best_mm);
        let region = Region::HalfSpace { point_mm: [0.0; 3], normal: [1.0, 0.0, 0.0] };
        let (name, target, camera_deg, projector_deg, min_grade) = (None, None, None, None, Some(Grade::B));
        let well = InterestParams { name, region, weight: 1.0, target, camera_deg, projector_deg, min_grade };
        for (engine, interest) in [(Engine::Raster, vec![]), (Engine::Raster, vec![well]), (Engine::Rays, vec![])] {
            let mut params = params(engine, &mesh);
            params.regions.interest = interest;
            let surface = requirements::sampled(&mesh, &params, 1, &ctx).unwrap_or_else(|error| panic!("{error}"));
            let optics = Optics::new(&scanner, &params, &surface.requirements);
            let together = Together::new(&surface, &optics, &occluders, &params, &ctx);
            let usable = vec![true; poses.len()];
            let rows = cast(&surface, &poses, &usable, &scanner, &occluders, &params, &ctx).expect("not cancelled").rows;
            let expected = union_of(&rows, surface.sample_mm.len());
            assert!(expected.count() > 1_000 && expected.count() < surface.sample_mm.len(), "{}", expected.count());
            assert_eq!(together.measured(&poses).expect("not cancelled"), expected, "{engine:?}");
            // What is known is left out, and the rest of the row is as it was.
            let row = together.row(&poses[3], rows[2].measured()).expect("not cancelled");
            assert_eq!(*row.measured(), *rows[3].without(rows[2].measured()).measured());
            assert_eq!(*together.row(&poses[3], &together.nothing()).expect("not cancelled").measured(), *rows[3].measured());
        }
    }
}
