//! The outcome: from chosen views to the verdict of every sample, coverage with its denominators, and the causes of what is
//! missed.

mod at_risk;
mod coverage;
mod exposure;
mod table;
mod verdicts;

use std::collections::{BTreeMap, BTreeSet};

use super::candidates::Rejection;
use super::context::{Cancelled, Context, NoPlan};
use super::ids::{CandidateIndex, SetupId, SetupIndex, ViewId};
use super::missed::{self, CanExecute, HasPath, MissAnalysis};
use super::params::SelectionParams;
use super::plan::{
    CandidateCounts, CandidateFate, Cause, Coverage, Fate, MissedCause, Obstruction, Outcome, PartFacts, Plan, PlannedView,
    RegionCoverage, SetupLink, SetupPlan, Stance, StopReason, Verdict, share,
};
use super::problem::{ChosenViews, SampledPart, ViewPlanningProblem};
use super::realism;
use super::selection::{Bound, coverable_mm2};
use super::sequence::Ordered;
use super::setups::Setup;
use super::setups::registration::{MeasuredSurface, SharedSurface, Stability};
use super::stations::{Station, StationFailure};
use super::visibility::{self, Occluders, Optics, Row, SampleSet};
use crate::cell::Configuration;
use crate::geometry::{Part, Pose, RayScene, ScannerFrame, parallel, sort_descending};

/// A solved problem: chosen views, with what became of each.
struct Solution<'a> {
    problem: &'a ViewPlanningProblem<'a>,
    chosen: &'a ChosenViews,
    /// Setups of the plan: those in which views are taken, ascending; the first where there are none.
    used: Vec<SetupIndex>,
    /// Chosen candidates to which no path was found.
    no_path: BTreeSet<CandidateIndex>,
    /// Candidates without a path: those that were given up for want of one, chosen or not, and all of a setup with a blocked home.
    all_excluded: BTreeSet<CandidateIndex>,
    /// Samples that each chosen view measures, with its quality; none where it has no path.
    measuring: Vec<Row>,
}

/// Surroundings in which causes and remedies are looked for.
pub(super) struct Surroundings<'a> {
    pub(super) sampled: &'a SampledPart,
    pub(super) setups: &'a [Setup<'a>],
    pub(super) occluders: &'a Occluders,
    /// The part alone.
    pub(super) part: &'a RayScene,
    pub(super) can_execute: Option<&'a CanExecute<'a>>,
    /// True where asked is only what earlier scans left open.
    pub(super) is_of_open: bool,
}

/// Assembles the outcome of a selection, ordered, setup by setup, when there is a cell. `excluded` are candidates that were
/// given up for want of a path.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn assemble(
    mut problem: ViewPlanningProblem<'_>,
    chosen: &ChosenViews,
    ordered: Vec<Ordered>,
    excluded: &BTreeSet<CandidateIndex>,
    surroundings: &Surroundings<'_>,
    ctx: &Context<'_>,
) -> Result<Outcome, Cancelled> {
    let mut solution = Solution::new(&problem, chosen, &ordered, excluded, surroundings.setups);
    let risks = at_risk::risks(&solution, surroundings.setups, ctx)?;
    let left_out = at_risk::left_out(&solution, &risks);
    if !problem.params.realism.count_at_risk {
        solution.measuring = realism::without(solution.measuring, &left_out);
    }
    let counted = verdicts::Counted { measuring: &solution.measuring, left_out: &left_out };
    let scenes = (surroundings.occluders, surroundings.part);
    let (verdicts, measured) = rayon::join(
        || verdicts::of(&problem, &counted, &solution.all_excluded, scenes, ctx),
        || coverage::measured(&problem, chosen, &solution.measuring),
    );
    let mut verdicts = verdicts?;
    let mut coverage = coverage::of(&problem, measured, &solution.measuring, &verdicts);
    if surroundings.is_of_open {
        coverage::ask_for_open_alone(&mut coverage);
    }
    if solution.stopped_because(&coverage) == StopReason::NoPath {
        let given_up = excluded.union(&solution.no_path);
        verdicts::blame_paths(&mut verdicts, given_up.map(|candidate| problem.row(*candidate)));
        coverage::recount_causes(&mut coverage, &problem, &verdicts);
    }
    coverage.at_risk = at_risk::area(&solution, &risks);
    let exposures = exposure::of(&solution, surroundings.setups, &ordered, ctx)?;
    coverage.exposure = exposures.as_ref().map(|exposures| exposures.loss);
    let has_path = |candidate: CandidateIndex| solution.has_path(candidate, surroundings.setups, ctx);
    let missed = missed::explain(&solution.miss_analysis(surroundings, &has_path), &verdicts, ctx)?;
    let weakest_links = solution.weakest_links(ctx)?;
    let mut plan = solution.plan(ordered, coverage, missed, &weakest_links);
    let brightness = exposures.into_iter().flat_map(|exposures| exposures.views);
    plan.views.iter_mut().zip(brightness).for_each(|(view, exposure)| view.exposure = exposure);
    let fates = problem.params.output.candidates.then(|| solution.fates());
    let measured_by_view = solution.measuring;
    let candidates = fates.map(|fates| table::of(&mut problem, fates, surroundings, ctx)).transpose()?;
    let surface = problem.surface;
    let stable_poses = surroundings.sampled.stable_poses.clone();
    Ok(Outcome { plan, surface, verdicts, measured_by_view, pixel_views: None, candidates, scenes: Vec::new(), stable_poses })
}

/// The weakest link of the views of each setup.
type WeakestLinks = BTreeMap<SetupIndex, ([ViewId; 2], Stability)>;

impl<'a> Solution<'a> {
    fn new(
        problem: &'a ViewPlanningProblem<'a>,
        chosen: &'a ChosenViews,
        ordered: &[Ordered],
        excluded: &BTreeSet<CandidateIndex>,
        setups: &[Setup<'_>],
    ) -> Self {
        let no_path: BTreeSet<_> = ordered.iter().flat_map(|ordered| chosen.candidates_of(&ordered.no_path)).collect();
        let measured = |candidate: &CandidateIndex| {
            if no_path.contains(candidate) { Row::default() } else { graded(problem, *candidate) }
        };
        let measuring = parallel::map(&chosen.candidates, measured);
        let is_homeless: Vec<bool> = setups.iter().map(is_home_blocked).collect();
        let homeless = problem.candidates.indices().filter(|candidate| is_homeless[problem.candidates[*candidate].setup.index()]);
        let all_excluded = excluded.union(&no_path).copied().chain(homeless).collect();
        let used: BTreeSet<_> = chosen.candidates.iter().map(|candidate| problem.candidates[*candidate].setup).collect();
        let used = if used.is_empty() { vec![SetupIndex(0)] } else { used.into_iter().collect() };
        Self { problem, chosen, used, no_path, all_excluded, measuring }
    }

    fn plan(&self, ordered: Vec<Ordered>, coverage: Coverage, missed: Vec<MissedCause>, weakest_links: &WeakestLinks) -> Plan {
        let Self { problem, .. } = self;
        Plan {
            part: PartFacts {
                sha256: problem.input.part_sha256.to_owned(),
                triangles: problem.input.mesh.faces.len(),
                area_mm2: problem.input.mesh.area_mm2(),
                aabb: problem.input.mesh.aabb(),
            },
            table_from_part: problem.reach.is_some().then_some(problem.setups[self.used[0].index()]),
            candidates: candidate_counts(problem),
            views: self.views(&ordered, &coverage),
            missed,
            stopped_because: self.stopped_because(&coverage),
            bound: Bound::default(),
            chosen_on: problem.chosen_on,
            setups: self.setups(ordered, weakest_links),
            setup_links: self.setup_links(),
            obstructions: Vec::new(),
            advice: Vec::new(),
            coverage,
            params: problem.params.clone(),
        }
    }

    /// The rule that ended the selection, held against what came of it.
    fn stopped_because(&self, coverage: &Coverage) -> StopReason {
        let params = &self.problem.params.selection;
        stopped_because(self.chosen.selection.stopped_because, self.given_up(), coverage, params)
    }

    fn given_up(&self) -> GivenUp {
        if !self.no_path.is_empty() {
            GivenUp::Views
        } else if self.all_excluded.is_empty() {
            GivenUp::Nothing
        } else {
            GivenUp::Candidates
        }
    }

    fn setups(&self, ordered: Vec<Ordered>, weakest_links: &WeakestLinks) -> Vec<SetupPlan> {
        let Self { problem, chosen, measuring, .. } = self;
        let mut sequences: Vec<_> = ordered.into_iter().map(|ordered| Some(ordered.sequence)).collect();
        let asked_mm2 = |rows: &[&Row]| coverable_mm2(rows, &problem.asked_area_mm2);
        let plan = |setup: &SetupIndex| {
            let is_here = |candidate: CandidateIndex| problem.candidates[candidate].setup == *setup;
            let views: Vec<ViewId> = chosen.views().filter(|(_, candidate)| is_here(*candidate)).map(|(view, _)| view).collect();
            let usable: Vec<_> = problem.usable().into_iter().filter(|candidate| is_here(*candidate)).collect();
            let measured_area_mm2 = asked_mm2(&views.iter().map(|view| &measuring[view.index()]).collect::<Vec<_>>());
            SetupPlan {
                weakest_link: weakest_links.get(setup).copied(),
                table_from_part: problem.setups[setup.index()],
                coverable_area_mm2: match &problem.coverable_of_setup_mm2 {
                    // Found on the samples that views were chosen on, which may be a little less than what they measure.
                    Some(coverable_mm2) => coverable_mm2[setup.index()].max(measured_area_mm2),
                    None => asked_mm2(&problem.rows(&usable)),
                },
                measured_area_mm2,
                views,
                sequence: sequences.get_mut(setup.index()).and_then(Option::take),
            }
        };
        self.used.iter().map(plan).collect()
    }

    /// The weakest link of the views of each setup that has more than one that measures something.
    fn weakest_links(&self, ctx: &Context<'_>) -> Result<WeakestLinks, Cancelled> {
        let Self { problem, chosen, measuring, used, no_path, .. } = self;
        let (part, optics) = (SharedSurface::new(&problem.surface), self.optics());
        let mut links = WeakestLinks::new();
        for setup in used {
            let is_here =
                |candidate: CandidateIndex| problem.candidates[candidate].setup == *setup && !no_path.contains(&candidate);
            let views: Vec<ViewId> = chosen.views().filter(|(_, candidate)| is_here(*candidate)).map(|(view, _)| view).collect();
            let measured: Vec<SampleSet> = views.iter().map(|view| measuring[view.index()].measured().clone()).collect();
            if let Some((pair, _)) = part.weakest_link(&measured, ctx)? {
                let pair = pair.map(|place| views[place]);
                let [a, b] = pair.map(|view| self.measured_by([view], part, &optics));
                links.insert(*setup, (pair, part.registration(&a, &b)));
            }
        }
        Ok(links)
    }

    fn optics(&self) -> Optics {
        Optics::new(self.problem.input.scanner, self.problem.params, &self.problem.surface.requirements)
    }

    /// Surface that some views measure.
    fn measured_by(&self, views: impl IntoIterator<Item = ViewId>, part: SharedSurface<'_>, optics: &Optics) -> MeasuredSurface {
        let Self { problem, chosen, measuring, .. } = self;
        part.measured(views.into_iter().map(|view| {
            let candidate = &problem.candidates[chosen.candidate(view)];
            (optics.at(&candidate.part_from_scanner), &measuring[view.index()])
        }))
    }

    /// Registration of every two setups by what both measure.
    fn setup_links(&self) -> Vec<SetupLink> {
        let Self { problem, chosen, used, .. } = self;
        let (part, optics) = (SharedSurface::new(&problem.surface), self.optics());
        let measured = |setup: &SetupIndex| {
            let is_here = |candidate: CandidateIndex| problem.candidates[candidate].setup == *setup;
            let here = chosen.views().filter(|(_, candidate)| is_here(*candidate)).map(|(view, _)| view);
            self.measured_by(here, part, &optics)
        };
        let measured: Vec<MeasuredSurface> = used.iter().map(measured).collect();
        let link = |a: usize, b: usize| SetupLink {
            setups: [a, b].map(SetupId::at),
            stability: part.registration(&measured[a], &measured[b]),
        };
        (0..measured.len()).flat_map(|b| (0..b).map(move |a| (a, b))).map(|(a, b)| link(a, b)).collect()
    }

    fn views(&self, ordered: &[Ordered], coverage: &Coverage) -> Vec<PlannedView> {
        let Self { problem, chosen, used, no_path, .. } = self;
        let curve = &coverage.curve_area_mm2;
        let gain_mm2 = |view: ViewId| match view.index() {
            0 => curve[0],
            number => curve[number] - curve[number - 1],
        };
        let number_of = |setup: SetupIndex| used.iter().position(|used| *used == setup).map_or(SetupId(0), SetupId::at);
        let choices = chosen.views().zip(&chosen.selection.choices);
        choices
            .map(|((id, index), choice)| {
                let (candidate, station) = (&problem.candidates[index], station_of(ordered, id));
                PlannedView {
                    id,
                    candidate: candidate.id,
                    setup: number_of(candidate.setup),
                    label: candidate.label,
                    part_from_scanner: candidate.part_from_scanner,
                    gain_of_asked: share(gain_mm2(id), coverage.asked_area_mm2),
                    score: choice.score,
                    station,
                    stance: station.zip(problem.input.cell).map(|(station, cell)| Stance::of(&cell.robot, &station, None)),
                    rejected: no_path.contains(&index).then_some(Cause::NoPath),
                    exposure: None,
                }
            })
            .collect()
    }

    /// Fate of each candidate that no filter dropped.
    fn fates(&self) -> Vec<CandidateFate> {
        let Self { problem, chosen, no_path, all_excluded, .. } = self;
        let views: BTreeMap<CandidateIndex, ViewId> = chosen.views().map(|(view, candidate)| (candidate, view)).collect();
        let fate = |candidate: CandidateIndex| {
            let view = views.get(&candidate).copied();
            let rejection = problem.blocked(candidate).map(by_cell);
            let fate = match view {
                _ if rejection.is_some() => Fate::Dropped,
                Some(_) if !no_path.contains(&candidate) => Fate::Chosen,
                _ if all_excluded.contains(&candidate) => Fate::NoPath,
                _ => Fate::NotChosen,
            };
            CandidateFate { fate, view, rejection }
        };
        problem.candidates.indices().map(fate).collect()
    }

    /// Returns true if a path leads from home to a candidate, from stations at which obstacles hide nothing that it measures.
    fn has_path(&self, candidate: CandidateIndex, setups: &[Setup<'_>], ctx: &Context<'_>) -> Result<bool, Cancelled> {
        let (problem, ctx) = (self.problem, &ctx.silent());
        let setup = &setups[problem.candidates[candidate].setup.index()];
        let Some(scene) = &setup.scene else { return Ok(true) };
        // Paths need not be searched where none leaves home.
        if is_home_blocked(setup) {
            return Ok(false);
        }
        let in_sight = |_: ViewId, station: &Configuration| problem.is_in_sight(scene, candidate, station, ctx);
        Ok(scene.order(&[(ViewId(0), problem.stations(candidate))], false, &in_sight, ctx)?.no_path.is_empty())
    }

    fn miss_analysis<'c>(&'c self, surroundings: &Surroundings<'c>, has_path: &'c HasPath<'c>) -> MissAnalysis<'c> {
        let Self { problem, all_excluded, .. } = self;
        let Surroundings { sampled, occluders, part: part_alone, setups, can_execute, .. } = *surroundings;
        let can_execute: Option<&'c CanExecute<'c>> = match can_execute {
            // Paths need not be searched where none leaves home.
            Some(_) if setups.iter().all(is_home_blocked) => Some(&without_path),
            searched => searched,
        };
        let is_choosable = |candidate: CandidateIndex| problem.blocked(candidate).is_none() && !all_excluded.contains(&candidate);
        MissAnalysis {
            input: problem.input,
            sampled,
            mesh: problem.input.mesh,
            surface: &problem.surface,
            scanner: problem.input.scanner,
            params: problem.params,
            setups: &problem.setups,
            first: problem.setups[self.used[0].index()],
            occluders,
            part_alone,
            candidates: &problem.candidates,
            rows: &problem.matrix.rows,
            choosable: problem.candidates.indices().map(is_choosable).collect(),
            can_execute,
            has_path,
        }
    }
}

/// The station at which a view is taken; `None` where it has no path, or without a cell.
fn station_of(ordered: &[Ordered], view: ViewId) -> Option<Station> {
    let mut visits = ordered.iter().flat_map(|ordered| &ordered.sequence.visits);
    visits.find(|(visited, _)| *visited == view).map(|(_, leg)| leg.target)
}

/// Returns true if two bodies of the cell meet at its home while the part lies like this: no path leads from there to any view.
fn is_home_blocked(setup: &Setup<'_>) -> bool {
    setup.scene.as_ref().is_some_and(|scene| scene.collision_scene().check(&scene.cell().home_rad).is_some())
}

/// Says of every view that the cell cannot execute it.
fn without_path(_: &Pose<Part, ScannerFrame>) -> Result<bool, Cancelled> {
    Ok(false)
}

/// Samples that a candidate measures, with its quality.
fn graded(problem: &ViewPlanningProblem<'_>, candidate: CandidateIndex) -> Row {
    let pose = &problem.candidates[candidate].part_from_scanner;
    visibility::grade(&problem.surface, pose, problem.input.scanner, problem.params, problem.row(candidate))
}

/// Views or candidates that were given up for want of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum GivenUp {
    /// Nothing.
    Nothing,
    /// Candidates; every view that was chosen in place of them has a path.
    Candidates,
    /// Views among those that were chosen last, which are not executed.
    Views,
}

/// The rule that ended the selection, held against what came of it ([`crate::planning::method::selection`]).
///
/// A selection that met its target among the views that have a path has not met it when what the given-up views would have
/// measured counts too, as it does in the coverable area. One that met its target, or could gain nothing more, still leaves
/// regions unmet whose measured share of the asked area is below their own target.
///
/// The target of further views is met together with earlier scans, whatever their share of the open area is: views in place of those
/// that were given up are expected to meet it. They are chosen at all only where something can be gained, so that nothing can be gained
/// any more once views are given up.
fn stopped_because(ended_by: StopReason, given_up: GivenUp, coverage: &Coverage, params: &SelectionParams) -> StopReason {
    let is_short = !coverage.reaches_target(params);
    let leaves_unmet = coverage.regions.iter().any(RegionCoverage::is_unmet);
    let lacks_views = given_up == GivenUp::Views || given_up == GivenUp::Candidates && !coverage.is_of_open;
    match ended_by {
        StopReason::Target if lacks_views && is_short => StopReason::NoPath,
        StopReason::NoGain if coverage.is_of_open && given_up != GivenUp::Nothing => StopReason::NoPath,
        StopReason::Target | StopReason::NoGain if leaves_unmet => StopReason::RegionsUnmet,
        StopReason::Growth if leaves_unmet && !is_short => StopReason::RegionsUnmet,
        StopReason::Target
        | StopReason::Growth
        | StopReason::MaxViews
        | StopReason::NoGain
        | StopReason::NoPath
        | StopReason::RegionsUnmet => ended_by,
    }
}

/// Reason for which the cell drops a candidate.
fn by_cell(failure: StationFailure) -> Rejection {
    match failure {
        StationFailure::Unreachable => Rejection::Unreachable,
        StationFailure::Collision => Rejection::Collision,
    }
}

fn candidate_counts(problem: &ViewPlanningProblem<'_>) -> CandidateCounts {
    let mut rejected: BTreeMap<Rejection, usize> = BTreeMap::new();
    let blocked = problem.candidates.indices().filter_map(|candidate| problem.blocked(candidate));
    for reason in problem.candidates.rejected.iter().map(|(_, reason)| *reason).chain(blocked.map(by_cell)) {
        *rejected.entry(reason).or_default() += 1;
    }
    CandidateCounts { generated: problem.candidates.generated, kept: problem.usable().len(), rejected }
}

/// The finding that no candidate of a problem measures anything, with the causes and bodies that keep them from it.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn nothing_measured(
    problem: &ViewPlanningProblem<'_>,
    occluders: &Occluders,
    obstructions: Vec<Obstruction>,
    ctx: &Context<'_>,
) -> Result<NoPlan, Cancelled> {
    let part = RayScene::interruptible([problem.input.mesh], || ctx.check())?;
    let nothing = SampleSet::none_of(problem.surface.sample_mm.len());
    let counted = verdicts::Counted { measuring: &[], left_out: &nothing };
    let verdicts = verdicts::of(problem, &counted, &BTreeSet::new(), (occluders, &part), ctx)?;
    let area_of = |cause: Cause| -> f64 {
        let missed = verdicts.iter().zip(&problem.asked_area_mm2).filter(|(verdict, _)| **verdict == Verdict::Missed(cause));
        missed.map(|(_, area_mm2)| area_mm2).sum()
    };
    let mut missed_mm2: Vec<_> = Cause::ALL.map(|cause| (cause, area_of(cause))).into();
    missed_mm2.retain(|(_, area_mm2)| *area_mm2 > 0.0);
    sort_descending(&mut missed_mm2, |missed| missed.1);
    let asked_mm2 = problem.asked_area_mm2.iter().sum();
    let (candidates, setups) = (candidate_counts(problem), problem.setups.clone());
    Ok(NoPlan::NothingMeasured { candidates, asked_mm2, missed_mm2, obstructions, setups })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::plan::{MeasuredArea, RegionKind};

    fn covered(area_mm2: f64) -> Coverage {
        let measured = MeasuredArea { area_mm2, ..MeasuredArea::default() };
        Coverage { measured, coverable_area_mm2: 100.0, ..Coverage::default() }
    }

    /// A region of 10 mm² of which so much is measured, with a target of 0.9 of it.
    fn region(measured_area_mm2: f64) -> RegionCoverage {
        RegionCoverage {
            name: "bore".into(),
            kind: RegionKind::Feature,
            samples: 10,
            asked_area_mm2: 10.0,
            coverable_area_mm2: measured_area_mm2,
            measured_area_mm2,
            target: Some(0.9),
            tolerance_mm: Some(0.05),
            min_tolerance_mm: 0.156,
            missed_mm2: vec![(Cause::BelowGrade, 10.0 - measured_area_mm2)],
            beyond_noise_area_mm2: 0.0,
            independent: None,
        }
    }

    #[test]
    fn a_target_met_without_the_given_up_views_is_not_called_met() {
        let ended = |ended_by, measured_mm2| {
            stopped_because(ended_by, GivenUp::Candidates, &covered(measured_mm2), &SelectionParams::default())
        };
        assert_eq!(ended(StopReason::Target, 98.5), StopReason::Target);
        assert_eq!(ended(StopReason::Target, 95.0), StopReason::NoPath);
        assert_eq!(ended(StopReason::Growth, 95.0), StopReason::Growth);
        let of_plan = |given_up| stopped_because(StopReason::Target, given_up, &covered(95.0), &SelectionParams::default());
        assert_eq!(of_plan(GivenUp::Nothing), StopReason::Target, "no view was given up");
        assert_eq!(of_plan(GivenUp::Views), StopReason::NoPath, "some are not executed");
    }

    #[test]
    fn a_target_met_with_a_region_below_its_own_is_not_called_met() {
        let ended = |ended_by, measured_mm2, of_region_mm2| {
            let coverage = Coverage { regions: vec![region(10.0), region(of_region_mm2)], ..covered(measured_mm2) };
            stopped_because(ended_by, GivenUp::Candidates, &coverage, &SelectionParams::default())
        };
        // Nothing of the region is coverable: it asks nothing of the selection, and all the more of the outcome.
        assert_eq!(ended(StopReason::Target, 99.0, 0.0), StopReason::RegionsUnmet);
        assert_eq!(ended(StopReason::NoGain, 80.0, 8.9), StopReason::RegionsUnmet);
        assert_eq!(ended(StopReason::Growth, 99.0, 8.9), StopReason::RegionsUnmet);
        for met_mm2 in [9.0, 9.0 - 1e-9, 10.0] {
            assert_eq!(ended(StopReason::Target, 99.0, met_mm2), StopReason::Target, "{met_mm2} of 9 mm²");
        }
        // Rules that a user can ease come first: the limit of views, growth short of the plan's own target, a missing path.
        assert_eq!(ended(StopReason::MaxViews, 99.0, 0.0), StopReason::MaxViews);
        assert_eq!(ended(StopReason::Growth, 80.0, 0.0), StopReason::Growth);
        assert_eq!(ended(StopReason::Target, 80.0, 0.0), StopReason::NoPath);
    }

    #[test]
    fn a_plan_of_what_scans_left_open_has_no_verdict_on_the_targets_of_whole_regions() {
        let nothing_open = RegionCoverage { samples: 0, asked_area_mm2: 0.0, ..region(0.0) };
        let mut coverage = Coverage { regions: vec![nothing_open, region(2.0)], ..covered(99.0) };
        coverage::ask_for_open_alone(&mut coverage);
        assert!(coverage.is_of_open);
        assert!(coverage.regions.iter().all(|region| region.is_met().is_none() && !region.is_unmet()), "{:?}", coverage.regions);
        let ended = stopped_because(StopReason::Target, GivenUp::Nothing, &coverage, &SelectionParams::default());
        assert_eq!(ended, StopReason::Target, "no region is unmet");
    }

    /// A rescan whose views all have a path was told to miss a target that they are expected to reach together with the earlier scans;
    /// one that was left without any view worth taking was told to raise `max_views` or lower `min_gain`.
    #[test]
    fn further_views_lack_a_path_only_where_none_came_in_place_of_those_that_were_given_up() {
        let coverage = Coverage { is_of_open: true, ..covered(50.0) };
        let ended = |ended_by, given_up| stopped_because(ended_by, given_up, &coverage, &SelectionParams::default());
        assert_eq!(ended(StopReason::Target, GivenUp::Candidates), StopReason::Target);
        assert_eq!(ended(StopReason::Target, GivenUp::Views), StopReason::NoPath);
        assert_eq!(ended(StopReason::NoGain, GivenUp::Candidates), StopReason::NoPath);
        assert_eq!(ended(StopReason::NoGain, GivenUp::Nothing), StopReason::NoGain);
        // Rules that a user can ease come first.
        for rule in [StopReason::MaxViews, StopReason::Growth] {
            assert_eq!(ended(rule, GivenUp::Views), rule);
        }
    }

    #[test]
    fn a_region_is_judged_by_its_asked_area_and_only_with_a_target() {
        assert_eq!((region(9.0).is_met(), region(8.9).is_met()), (Some(true), Some(false)));
        assert!(region(8.9).of_coverable() == 1.0, "all that can be measured of it, and yet too little");
        let without = RegionCoverage { target: None, ..region(0.0) };
        assert_eq!((without.is_met(), without.is_unmet()), (None, false));
        let empty = RegionCoverage { samples: 0, asked_area_mm2: 0.0, ..region(0.0) };
        assert_eq!(empty.is_met(), Some(false), "a region that holds no asked surface is not measured");
    }
}
