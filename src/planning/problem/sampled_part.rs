//! A part in samples, and the way from there to the view planning problem.

use std::sync::{Arc, OnceLock};

use super::evaluated::EvaluatedCandidates;
use super::robust_rows::{self, VisibilityInput};
use super::rounds::{Rounds, views_for_area};
use crate::geometry::{LazyStablePoses, Part, Poll, Pose, RayScene, Table};
use crate::planning::candidates::{self, Candidate, Scope};
use crate::planning::context::{Cancelled, Context, PlanError};
use crate::planning::ids::SetupIndex;
use crate::planning::params::PlanParams;
use crate::planning::scene::demand::Demand;
use crate::planning::scene::{self, PlanInput, PlanningScene};
use crate::planning::setups::{self, Setup};
use crate::planning::surface::thinned::{self, Strata};
use crate::planning::surface::{Surface, check_asked, requirements};
use crate::planning::visibility::{Occluders, Optics, Row};

/// A part in samples, before it is known how it lies.
pub(in crate::planning) struct SampledPart {
    /// Defaults resolved.
    pub(in crate::planning) params: PlanParams,
    pub(in crate::planning) surface: Arc<Surface>,
    /// Area of each sample, 0 where it is not asked for.
    pub(in crate::planning) asked_area_mm2: Vec<f64>,
    /// Samples that views are chosen on, unless the part takes too many views for them.
    chosen_on: SamplesToChooseOn,
    /// True if views may be chosen on more of the samples where they turn out to be many.
    may_take_more: bool,
    /// The part without a plate; with several setups, since none of their plates stands in all.
    alone: Option<Occluders>,
    /// Ways in which the part can stand, once somebody asked.
    pub(in crate::planning) stable_poses: LazyStablePoses,
    /// Poses to choose setups from, once somebody asked.
    resting_poses: OnceLock<Vec<Pose<Table, Part>>>,
}

/// Samples of a part that views are chosen on.
#[derive(Clone)]
pub(in crate::planning) struct SamplesToChooseOn {
    pub(in crate::planning) surface: Arc<Surface>,
    /// Area of each sample, 0 where it is not asked for.
    pub(in crate::planning) asked_area_mm2: Vec<f64>,
    /// Strata of the samples; `None` where these are all that there are.
    pub(in crate::planning) strata: Option<Strata>,
}

impl SamplesToChooseOn {
    /// `some` of the samples of `whole`, or all of them.
    fn new(whole: &Arc<Surface>, some: Option<(Surface, Strata)>) -> Self {
        let (surface, strata) = match some {
            Some((surface, strata)) => (Arc::new(surface), Some(strata)),
            None => (Arc::clone(whole), None),
        };
        Self { asked_area_mm2: surface.asked_area_mm2(), surface, strata }
    }
}

/// One way in which the part lies, with the samples that candidates are evaluated on.
#[derive(Clone, Copy)]
pub(in crate::planning) struct TriedSetup<'a> {
    pub(in crate::planning) table_from_part: Pose<Table, Part>,
    pub(in crate::planning) surface: &'a Surface,
    pub(in crate::planning) occluders: &'a Occluders,
    /// Present with a cell.
    pub(in crate::planning) scene: Option<&'a PlanningScene<'a>>,
}

/// The candidates of all setups.
pub(in crate::planning) struct EvaluatedSetups {
    /// Samples that they were evaluated on.
    pub(in crate::planning) on: SamplesToChooseOn,
    pub(in crate::planning) evaluated: EvaluatedCandidates,
    /// Rows that views are chosen by where they shall tolerate errors, see [`robust_rows::rows`].
    pub(in crate::planning) robust_rows: Option<Vec<Row>>,
}

impl SampledPart {
    /// Cuts the part into patches and samples; `params` are with defaults resolved. A demand leaves some of the samples asked;
    /// views are then chosen on these alone.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(in crate::planning) fn new(
        input: &PlanInput<'_>,
        mut params: PlanParams,
        demand: Option<&Demand<'_>>,
        ctx: &Context<'_>,
    ) -> Result<Self, PlanError> {
        let mut surface = requirements::sampled(input.mesh, &params, params.seed, ctx)?;
        demand.map_or(Ok(()), |demand| demand.mask(&mut surface))?;
        let asked_area_mm2 = surface.asked_area_mm2();
        check_asked(&asked_area_mm2)?;
        let table_from_part = params.part.table_from_part.unwrap_or_default().pose();
        let count = params.selection.samples.map_or_else(|| thinned::default_count(surface.area_where(|_| true)), f64::from);
        let some = match demand {
            Some(_) => thinned::asked_alone(&surface),
            None => thinned::thinned(&surface, count),
        };
        let surface = Arc::new(surface);
        let chosen_on = SamplesToChooseOn::new(&surface, some);
        let may_take_more = demand.is_none() && params.selection.samples.is_none() && chosen_on.strata.is_some();
        params.candidates = candidates::resolve(&chosen_on.surface, &table_from_part, input.scanner, &params.candidates);
        let alone = (params.setups > 1).then(|| Occluders::interruptible([input.mesh], ctx)).transpose()?;
        let (stable_poses, resting_poses) = (LazyStablePoses::default(), OnceLock::new());
        Ok(Self { params, surface, asked_area_mm2, chosen_on, may_take_more, alone, stable_poses, resting_poses })
    }

    /// The setups to plan in, with everything that hides a sample or hinders the robot in each.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(in crate::planning) fn setups<'a>(
        &'a self,
        input: &PlanInput<'a>,
        ctx: &Context<'_>,
    ) -> Result<Vec<Setup<'a>>, PlanError> {
        let mut setups: Vec<Setup<'a>> = Vec::new();
        for pose in setups::poses(input, &self.params, || self.resting_poses(input, ctx), ctx)? {
            let setup = self.setup(input, pose, setups.first().and_then(|setup| setup.scene.as_ref()), ctx)?;
            setups.push(setup);
        }
        Ok(setups)
    }

    /// Poses to choose setups from.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn resting_poses(
        &self,
        input: &PlanInput<'_>,
        ctx: &Context<'_>,
    ) -> Result<&[Pose<Table, Part>], Cancelled> {
        if let Some(known) = self.resting_poses.get() {
            return Ok(known);
        }
        let stop = || ctx.check().is_err();
        let stable = || self.stable_poses.of(input.mesh, &Poll::new(&stop)).map_err(Cancelled::from);
        let poses = setups::pool(input.mesh, &self.params, stable)?;
        Ok(self.resting_poses.get_or_init(|| poses))
    }

    /// Scene of the part alone: that of the occluders where nothing else is among them.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn part_alone(
        &self,
        input: &PlanInput<'_>,
        setups: &[Setup<'_>],
        ctx: &Context<'_>,
    ) -> Result<Arc<RayScene>, Cancelled> {
        let has_nothing_else = input.cell.is_none() && input.fixture.is_none();
        let alone = self.alone.as_ref().or_else(|| setups.first().map(|setup| &setup.occluders).filter(|_| has_nothing_else));
        match alone {
            Some(alone) => Ok(alone.shared_rays()),
            None => Ok(Arc::new(RayScene::interruptible([input.mesh], || ctx.check())?)),
        }
    }

    /// The part lying in one way, with everything that hides a sample or hinders the robot then. `other` is the cell with the part
    /// lying in another way.
    ///
    /// # Errors
    /// [`PlanError`].
    fn setup<'a>(
        &'a self,
        input: &PlanInput<'a>,
        table_from_part: Pose<Table, Part>,
        other: Option<&PlanningScene<'a>>,
        ctx: &Context<'_>,
    ) -> Result<Setup<'a>, PlanError> {
        let plate = input.cell.map(|cell| scene::plate(cell, &table_from_part));
        let meshes = [input.mesh].into_iter().chain(input.fixture).chain(&plate);
        // The box tree of the part for collisions is built by one thread.
        let (scene, occluders) = rayon::join(
            || self.scene(input, table_from_part, other, ctx),
            || Occluders::interruptible(meshes.collect::<Vec<_>>(), ctx),
        );
        Ok(Setup { table_from_part, occluders: occluders?, scene: scene? })
    }

    /// The cell with the part lying in one way; `None` without a cell. `other` is the cell with the part lying in another way.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(in crate::planning) fn scene<'a>(
        &'a self,
        input: &PlanInput<'a>,
        table_from_part: Pose<Table, Part>,
        other: Option<&PlanningScene<'a>>,
        ctx: &Context<'_>,
    ) -> Result<Option<PlanningScene<'a>>, PlanError> {
        input.cell.map_or(Ok(()), |cell| scene::check_placement(cell, input, &table_from_part))?;
        let scene = |cell| match other {
            Some(other) => other.lying(input, table_from_part, ctx),
            None => PlanningScene::new(cell, input, &self.params, table_from_part, ctx),
        };
        input.cell.map(scene).transpose()
    }

    /// Evaluates at most `max` candidates of a setup, evenly spaced among those of the strategies that know the part alone, and keeps
    /// those that the cell can take: some of those that a plan in this setup chooses from.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(in crate::planning) fn evaluate_some(
        &self,
        input: &PlanInput<'_>,
        setup: &TriedSetup<'_>,
        max: usize,
        ctx: &Context<'_>,
    ) -> Result<EvaluatedCandidates, PlanError> {
        let optics = Optics::new(input.scanner, &self.params, &setup.surface.requirements);
        let asked_area_mm2 = setup.surface.asked_area_mm2();
        let mut some = self.rounds(input, setup, &optics, &asked_area_mm2, ctx).run_some(max)?;
        some.drop_unusable();
        Ok(some)
    }

    /// Evaluates candidates beside `views` of a setup; `already` are generated. `asked_area_mm2` is that of the samples of the
    /// setup's surface.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn evaluate_beside(
        &self,
        input: &PlanInput<'_>,
        setup: &TriedSetup<'_>,
        asked_area_mm2: &[f64],
        (views, already): (&[&Candidate], usize),
        ctx: &Context<'_>,
    ) -> Result<EvaluatedCandidates, Cancelled> {
        let optics = Optics::new(input.scanner, &self.params, &setup.surface.requirements);
        self.rounds(input, setup, &optics, asked_area_mm2, ctx).run_beside(views, already)
    }

    fn rounds<'a>(
        &'a self,
        input: &'a PlanInput<'_>,
        setup: &TriedSetup<'a>,
        optics: &'a Optics,
        asked_area_mm2: &'a [f64],
        ctx: &'a Context<'_>,
    ) -> Rounds<'a> {
        let TriedSetup { table_from_part, surface, occluders, scene } = *setup;
        let scope = Scope {
            part: input.mesh,
            surface,
            scanner: input.scanner,
            cell: input.cell,
            table_from_part,
            occluders,
            optics,
            score: &self.params.score,
            seed: self.params.seed,
        };
        Rounds { scope, params: &self.params, occluders, scene, asked_area_mm2, ctx }
    }

    /// Every candidate with its stations and what it measures, the setups' candidates one after another. Where the part takes so many
    /// views that they are hardly told apart on the samples to choose on, candidates are looked for anew on more of the samples.
    ///
    /// # Errors
    /// [`PlanError`].
    pub(in crate::planning) fn evaluate(
        &self,
        input: &PlanInput<'_>,
        setups: &[Setup<'_>],
        ctx: &Context<'_>,
    ) -> Result<EvaluatedSetups, PlanError> {
        let all = self.evaluate_on(self.chosen_on.clone(), input, setups, ctx)?;
        if !self.may_take_more {
            return Ok(all);
        }
        let views = views_for_area(&all.evaluated, &all.on.asked_area_mm2, &self.params, ctx)?.len();
        if !thinned::are_too_few(all.on.surface.sample_mm.len(), views) {
            return Ok(all);
        }
        // Both at once would take the memory of both.
        drop(all);
        let more = SamplesToChooseOn::new(&self.surface, thinned::thinned(&self.surface, thinned::MAX_SAMPLES));
        self.evaluate_on(more, input, setups, ctx)
    }

    /// [`SampledPart::evaluate`] on some of the samples.
    fn evaluate_on(
        &self,
        on: SamplesToChooseOn,
        input: &PlanInput<'_>,
        setups: &[Setup<'_>],
        ctx: &Context<'_>,
    ) -> Result<EvaluatedSetups, PlanError> {
        let SamplesToChooseOn { surface, asked_area_mm2, .. } = &on;
        let (mut all, mut robust) = (EvaluatedCandidates::none_of(surface, input.cell.is_some()), None);
        let optics = Optics::new(input.scanner, &self.params, &self.surface.requirements);
        for (index, setup) in SetupIndex::number(setups) {
            let tried = TriedSetup {
                table_from_part: setup.table_from_part,
                surface,
                occluders: &setup.occluders,
                scene: setup.scene.as_ref(),
            };
            let evaluated = self.rounds(input, &tried, &optics, asked_area_mm2, ctx).run()?.in_setup(index);
            let (params, occluders) = (&self.params, &setup.occluders);
            let visibility = VisibilityInput { surface, scanner: input.scanner, occluders, params };
            if let Some(rows) = robust_rows::rows(&visibility, &evaluated, ctx)? {
                robust.get_or_insert_with(Vec::new).extend(rows);
            }
            all.append(evaluated);
        }
        Ok(EvaluatedSetups { on, evaluated: all, robust_rows: robust })
    }

    /// Occluders of views of any setup: with several, the part alone. A plate hides nothing from above it.
    pub(in crate::planning) fn occluders<'a>(&'a self, setups: &'a [Setup<'_>]) -> &'a Occluders {
        self.alone.as_ref().filter(|_| setups.len() > 1).unwrap_or(&setups[0].occluders)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::testing::{box_mesh, nominal_scanner};

    #[test]
    fn resting_poses_are_computed_once_and_given_up_when_cancelled() {
        let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner());
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let (goes_on, stops) = (AtomicBool::new(false), AtomicBool::new(true));
        let [going_on, cancelled] = [&goes_on, &stops].map(|cancel| Context::new(cancel, &Silent));
        let params = scene::resolve(&PlanParams::default(), &input);
        let sampled = SampledPart::new(&input, params, None, &going_on).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(sampled.resting_poses(&input, &cancelled), Err(Cancelled));
        assert!(!sampled.stable_poses.are_known());
        let poses = sampled.resting_poses(&input, &going_on).expect("not cancelled");
        assert!(poses.len() == 6 && sampled.stable_poses.are_known(), "{poses:?}");
        // Nothing is left to give up.
        assert_eq!(sampled.resting_poses(&input, &cancelled), Ok(poses));
    }
}
