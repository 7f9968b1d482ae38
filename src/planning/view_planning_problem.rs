//! A part with everything that is known before views are chosen, and the way from chosen views to an [`Outcome`]:
//! verdict of every sample, coverage with its denominators, causes of what is missed.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::candidates::{Candidate, CandidateSet, Rejection};
use super::context::{Cancelled, Context};
use super::error::PlanError;
use super::input::PlanInput;
use super::missed;
use super::params::{PlanParams, SelectionParams, TargetOf};
use super::plan::{
    CandidateCounts, Cause, Coverage, Grade, Outcome, PartFacts, Plan, PlannedView, RegionCoverage, SetupPlan, Stance,
    StopReason, Verdict, ViewId,
};
use super::requirements;
use super::selection::{self, CoverProblem, Goal, Selection, coverable, coverable_mm2};
use super::sequence::{Ordered, straight_secs};
use super::stations::{Station, StationFailure};
use super::surface::Surface;
use super::visibility::{self, Row, SampleSet, VisibilityMatrix};
use crate::geometry::{Part, Pose, Table};

/// Stations of every kept candidate, or why it has none.
pub(super) type Reach = Vec<Result<Vec<Station>, StationFailure>>;

/// The view planning problem: part, setups, candidates, visibility matrix and reach.
pub(super) struct ViewPlanningProblem<'a> {
    pub(super) input: &'a PlanInput<'a>,
    pub(super) params: &'a PlanParams,
    pub(super) surface: Surface,
    /// Pose of the part in each setup.
    pub(super) setups: Vec<Pose<Table, Part>>,
    pub(super) candidates: CandidateSet,
    /// Row of each kept candidate.
    pub(super) matrix: VisibilityMatrix,
    /// Rows by which views are chosen, where that is not the matrix: the samples measured under every stated error.
    pub(super) robust_rows: Option<Vec<Row>>,
    /// Stations of each kept candidate; `None` without a cell.
    pub(super) reach: Option<Reach>,
    /// Asked area of each sample, see [`asked_area_mm2()`].
    pub(super) asked_area_mm2: Vec<f64>,
}

/// A selection over the kept candidates.
pub(super) struct ChosenViews {
    /// Index of each chosen candidate among the kept ones, in the order chosen.
    pub(super) kept: Vec<usize>,
    selection: Selection,
}

/// Area of each sample, 0 where it is not asked for.
///
/// # Errors
/// Nothing is asked for.
pub(super) fn asked_area_mm2(surface: &Surface) -> Result<Vec<f64>, PlanError> {
    let area = |sample: usize| if surface.asked[sample] { surface.sample_area_mm2(sample) } else { 0.0 };
    let asked_area_mm2: Vec<f64> = (0..surface.sample_mm.len()).map(area).collect();
    if asked_area_mm2.iter().any(|area_mm2| *area_mm2 > 0.0) {
        return Ok(asked_area_mm2);
    }
    Err(PlanError::param("/regions/exclude", "leaves nothing of the part to measure; exclude less".into()))
}

/// A selection that met its target among the views that have a path has not met it when what the given-up views would
/// have measured counts too, as it does in the coverable area.
fn stopped_because(ended_by: StopReason, coverage: &Coverage, params: &SelectionParams) -> StopReason {
    /// Sums of areas in another order.
    const SUM_SLACK: f64 = 4e-9;
    let reached = match params.target_of {
        TargetOf::Coverable => coverage.of_coverable(),
        TargetOf::Asked => coverage.of_asked(),
        TargetOf::Total => coverage.of_total(),
    };
    let short = reached < params.target - SUM_SLACK;
    if ended_by == StopReason::Target && short { StopReason::NoPath } else { ended_by }
}

impl ViewPlanningProblem<'_> {
    /// Failure for which the cell cannot use a kept candidate, if so.
    fn blocked(&self, kept: usize) -> Option<StationFailure> {
        self.reach.as_ref().and_then(|reach| reach[kept].as_ref().err().copied())
    }

    pub(super) fn cover_problem(&self, kept: &[usize]) -> CoverProblem<'_> {
        let scan = &self.params.scan;
        let total_mm2 = self.surface.area_where(|_| true);
        let mut cover = CoverProblem::new(self.rows_to_choose_by(kept), &self.asked_area_mm2, total_mm2, &self.params.selection);
        cover.view_secs = scan.settle_secs + scan.capture_secs;
        let requirements = &self.surface.requirements;
        if requirements.kinds.len() > 1 {
            let weighted = |(sample, area_mm2): (usize, &f64)| area_mm2 * requirements.of(sample).weight;
            cover.weighted_area_mm2 = Cow::Owned(self.asked_area_mm2.iter().enumerate().map(weighted).collect());
            cover.goals.extend(self.goals_of_regions(kept));
        }
        cover
    }

    /// Targets of the regions that have their own: a share of their area, counted as the plan's own target counts.
    fn goals_of_regions(&self, kept: &[usize]) -> Vec<Goal<'static>> {
        let requirements = &self.surface.requirements;
        let coverable = coverable(&self.rows_to_choose_by(kept), self.asked_area_mm2.len());
        let of_coverable = self.params.selection.target_of == TargetOf::Coverable;
        let counts = |sample: usize| !of_coverable || coverable.holds(sample as u32);
        let goal = |(number, region): (usize, requirements::NamedRegion)| {
            let holds = |sample: usize| requirements.of(sample).regions.contains(&number);
            let area = |sample: usize| if holds(sample) { self.asked_area_mm2[sample] } else { 0.0 };
            let area_mm2: Vec<f64> = (0..self.asked_area_mm2.len()).map(area).collect();
            let whole_mm2: f64 = (0..area_mm2.len()).filter(|sample| counts(*sample)).map(|sample| area_mm2[sample]).sum();
            Some(Goal { needed_mm2: region.target? * whole_mm2, area_mm2: Cow::Owned(area_mm2) })
        };
        requirements::regions(self.params).into_iter().enumerate().filter_map(goal).filter(|goal| goal.needed_mm2 > 0.0).collect()
    }

    /// Rows by which views are chosen: as planned, or also with poses that are off.
    fn rows_to_choose_by(&self, kept: &[usize]) -> Vec<&Row> {
        let rows = self.robust_rows.as_ref().unwrap_or(&self.matrix.rows);
        kept.iter().map(|kept| &rows[*kept]).collect()
    }

    fn rows(&self, kept: &[usize]) -> Vec<&Row> {
        kept.iter().map(|kept| &self.matrix.rows[*kept]).collect()
    }

    /// Kept candidates that the cell can use.
    fn usable(&self) -> Vec<usize> {
        (0..self.candidates.kept.len()).filter(|kept| self.blocked(*kept).is_none()).collect()
    }

    /// Kept candidates that the cell can use and that are not `excluded`, ascending.
    pub(super) fn choosable(&self, excluded: &BTreeSet<usize>) -> Vec<usize> {
        self.usable().into_iter().filter(|kept| !excluded.contains(kept)).collect()
    }

    /// The selection of `rows` of a cover problem over `usable`, as many as `chosen` has.
    pub(super) fn chosen_of(
        &self,
        cover: &CoverProblem<'_>,
        usable: &[usize],
        rows: &[usize],
        chosen: &ChosenViews,
        ctx: &Context<'_>,
    ) -> Result<ChosenViews, PlanError> {
        let selection = selection::of_rows(cover, &self.params.selection, &self.params.score, rows, &chosen.selection, ctx)?;
        Ok(ChosenViews { kept: selection.choices.iter().map(|choice| usable[choice.row]).collect(), selection })
    }

    /// Chooses among the usable candidates that are not `excluded`. A target of the coverable area is here a share of what
    /// those measure; see [`stopped_because`] for what is then said of it.
    pub(super) fn select(&self, excluded: &BTreeSet<usize>, ctx: &Context<'_>) -> Result<ChosenViews, PlanError> {
        let usable = self.choosable(excluded);
        let travel_secs = |from: usize, to: usize| self.travel_secs(usable[from], usable[to]);
        let mut cover = self.cover_problem(&usable);
        cover.travel_secs = self.reach.is_some().then_some(&travel_secs);
        let selection = selection::select(&cover, &self.params.selection, &self.params.score, ctx)?;
        if selection.choices.is_empty() && excluded.is_empty() {
            return Err(PlanError::NoPlan(self.no_plan_detail()));
        }
        Ok(ChosenViews { kept: selection.choices.iter().map(|choice| usable[choice.row]).collect(), selection })
    }

    /// Time of the quickest straight move between stations of two kept candidates: what travel costs at least.
    fn travel_secs(&self, from: usize, to: usize) -> f64 {
        let (Some(cell), Some(reach)) = (self.input.cell, &self.reach) else { return 0.0 };
        let stations = |kept: usize| reach[kept].as_deref().unwrap_or_default();
        let axes = cell.axes();
        let pairs = stations(from).iter().flat_map(|a| stations(to).iter().map(move |b| (a.configuration(), b.configuration())));
        pairs.map(|(a, b)| straight_secs(&axes, &a, &b, &self.params.motion)).fold(f64::INFINITY, f64::min)
    }

    /// Chosen views of a setup with their stations, for ordering.
    pub(super) fn stations_of(&self, chosen: &ChosenViews, setup: usize) -> Vec<(ViewId, &[Station])> {
        let stations = |kept: usize| match &self.reach {
            Some(reach) => reach[kept].as_deref().unwrap_or_default(),
            None => &[],
        };
        let of_setup = |(_, kept): &(usize, &usize)| self.candidates.kept[**kept].setup == setup;
        chosen.kept.iter().enumerate().filter(of_setup).map(|(view, kept)| (ViewId(view as u32), stations(*kept))).collect()
    }

    /// The kept candidates behind `views`.
    pub(super) fn candidates_behind(&self, chosen: &ChosenViews, views: &[ViewId]) -> Vec<usize> {
        views.iter().map(|view| chosen.kept[view.0 as usize]).collect()
    }

    /// Kept candidates that are reached but for collisions, with no stations, and those of `all_excluded`, with theirs.
    pub(super) fn obstructed(&self, all_excluded: &BTreeSet<usize>) -> Vec<(&Candidate, &[Station])> {
        let stations = |kept: usize| match &self.reach.as_ref()?[kept] {
            Ok(stations) => all_excluded.contains(&kept).then_some(stations.as_slice()),
            Err(blocked) => (*blocked == StationFailure::Collision).then_some(&[][..]),
        };
        (0..self.candidates.kept.len()).filter_map(|kept| Some((&self.candidates.kept[kept], stations(kept)?))).collect()
    }

    /// The outcome of a selection, ordered, setup by setup, when there is a cell. `excluded` are candidates that were given up
    /// for want of a path; `occluders` and `can_execute` are for the remedies of what is missed.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn assemble_outcome(
        self,
        chosen: &ChosenViews,
        ordered: Vec<Ordered>,
        excluded: &BTreeSet<usize>,
        occluders: &visibility::Occluders,
        can_execute: Option<&missed::CanExecute<'_>>,
        ctx: &Context<'_>,
    ) -> Result<Outcome, Cancelled> {
        let no_path: BTreeSet<usize> = ordered.iter().flat_map(|o| self.candidates_behind(chosen, &o.no_path)).collect();
        let measuring: Vec<Row> =
            chosen.kept.par_iter().map(|kept| if no_path.contains(kept) { Row::default() } else { self.graded(*kept) }).collect();
        let all_excluded: BTreeSet<usize> = excluded.union(&no_path).copied().collect();
        let verdicts = self.verdicts(&measuring, &all_excluded);
        let coverage = self.coverage(&measuring, &verdicts);
        let missed = missed::explain(&self.miss_analysis(&all_excluded, occluders, can_execute), &verdicts, ctx)?;
        let used = self.used_setups(chosen);
        let plan = Plan {
            part: PartFacts {
                sha256: self.input.part_sha256.to_owned(),
                triangles: self.input.mesh.faces.len(),
                area_mm2: self.input.mesh.area_mm2(),
                aabb: self.input.mesh.aabb(),
            },
            table_from_part: self.reach.is_some().then_some(self.setups[used[0]]),
            candidates: self.counts(),
            views: self.views(chosen, &ordered, &used, &no_path, &coverage),
            missed,
            stopped_because: match chosen.selection.stopped_because {
                ended_by if all_excluded.is_empty() => ended_by,
                ended_by => stopped_because(ended_by, &coverage, &self.params.selection),
            },
            bound: chosen.selection.bound,
            setups: self.setup_plans(chosen, &used, ordered, &measuring),
            obstructions: Vec::new(),
            coverage,
            params: self.params.clone(),
        };
        Ok(Outcome { plan, surface: self.surface, verdicts, measured_by_view: measuring, pixel_views: None })
    }

    /// The setups in which views are taken; the first where there are none.
    fn used_setups(&self, chosen: &ChosenViews) -> Vec<usize> {
        let used: BTreeSet<usize> = chosen.kept.iter().map(|kept| self.candidates.kept[*kept].setup).collect();
        if used.is_empty() { vec![0] } else { used.into_iter().collect() }
    }

    fn setup_plans(&self, chosen: &ChosenViews, used: &[usize], ordered: Vec<Ordered>, measuring: &[Row]) -> Vec<SetupPlan> {
        let mut sequences: Vec<_> = ordered.into_iter().map(|ordered| Some(ordered.sequence)).collect();
        let asked_mm2 = |rows: &[&Row]| coverable_mm2(rows, &self.asked_area_mm2);
        let plan = |setup: &usize| {
            let is_here = |kept: usize| self.candidates.kept[kept].setup == *setup;
            let views: Vec<_> = (0..chosen.kept.len()).filter(|view| is_here(chosen.kept[*view])).collect();
            let usable: Vec<_> = self.usable().into_iter().filter(|kept| is_here(*kept)).collect();
            SetupPlan {
                table_from_part: self.setups[*setup],
                coverable_area_mm2: asked_mm2(&self.rows(&usable)),
                measured_area_mm2: asked_mm2(&views.iter().map(|view| &measuring[*view]).collect::<Vec<_>>()),
                views: views.into_iter().map(|view| ViewId(view as u32)).collect(),
                sequence: sequences.get_mut(*setup).and_then(Option::take),
            }
        };
        used.iter().map(plan).collect()
    }

    fn miss_analysis<'c>(
        &'c self,
        all_excluded: &BTreeSet<usize>,
        occluders: &'c visibility::Occluders,
        can_execute: Option<&'c missed::CanExecute<'c>>,
    ) -> missed::MissAnalysis<'c> {
        let kept = &self.candidates.kept;
        missed::MissAnalysis {
            mesh: self.input.mesh,
            surface: &self.surface,
            scanner: self.input.scanner,
            params: self.params,
            setups: &self.setups,
            occluders,
            candidates: kept,
            rows: &self.matrix.rows,
            choosable: (0..kept.len()).map(|kept| self.blocked(kept).is_none() && !all_excluded.contains(&kept)).collect(),
            can_execute,
        }
    }

    /// Samples that a kept candidate measures, with its quality.
    fn graded(&self, kept: usize) -> Row {
        let pose = &self.candidates.kept[kept].part_from_scanner;
        visibility::grade(&self.surface, pose, self.input.scanner, self.params, &self.matrix.rows[kept])
    }

    fn verdicts(&self, measuring: &[Row], all_excluded: &BTreeSet<usize>) -> Vec<Verdict> {
        let samples = self.surface.sample_mm.len();
        let mut best_quality = vec![f32::NEG_INFINITY; samples];
        for row in measuring {
            for (sample, quality) in row.graded() {
                let best = &mut best_quality[sample as usize];
                *best = best.max(quality);
            }
        }
        let motion_cause = self.motion_causes(all_excluded);
        let missed = |sample: usize| {
            let stands_on = self.reach.is_some() && self.setups.iter().all(|pose| missed::stands_on(&self.surface, sample, pose));
            if stands_on {
                return Cause::ExcludedResting;
            }
            motion_cause[sample].unwrap_or(self.matrix.furthest_cause[sample])
        };
        (0..samples)
            .map(|sample| match best_quality[sample] {
                _ if !self.surface.asked[sample] => Verdict::NotAsked,
                quality if quality > f32::NEG_INFINITY => Verdict::Measured(Grade::of(f64::from(quality))),
                _ => Verdict::Missed(missed(sample)),
            })
            .collect()
    }

    /// Cause by motion of each sample that some kept candidate measures: how far the best such candidate got with the cell.
    fn motion_causes(&self, all_excluded: &BTreeSet<usize>) -> Vec<Option<Cause>> {
        let samples = self.surface.sample_mm.len();
        let mut samples_of: BTreeMap<Cause, SampleSet> = BTreeMap::new();
        for (kept, row) in self.matrix.rows.iter().enumerate() {
            let cause = match self.blocked(kept) {
                Some(StationFailure::Unreachable) => Cause::Unreachable,
                Some(StationFailure::Collision) => Cause::Collision,
                None if all_excluded.contains(&kept) => Cause::NoPath,
                None => Cause::NotChosen,
            };
            samples_of.entry(cause).or_insert_with(|| SampleSet::none_of(samples)).insert_all(row.measured());
        }
        let mut causes = vec![None; samples];
        for (cause, samples) in samples_of {
            samples.iter().for_each(|sample| causes[sample as usize] = Some(cause));
        }
        causes
    }

    fn coverage(&self, measuring: &[Row], verdicts: &[Verdict]) -> Coverage {
        let all: Vec<_> = (0..self.candidates.kept.len()).collect();
        let mut coverage = Coverage {
            total_area_mm2: self.surface.area_where(|_| true),
            asked_area_mm2: self.surface.area_where(|sample| self.surface.asked[sample]),
            coverable_area_mm2: coverable_mm2(&self.rows(&self.usable()), &self.asked_area_mm2),
            optically_coverable_area_mm2: coverable_mm2(&self.rows(&all), &self.asked_area_mm2),
            ..Coverage::default()
        };
        for (sample, verdict) in verdicts.iter().enumerate() {
            if let Verdict::Measured(grade) = verdict {
                coverage.grade_area_mm2[*grade as usize] += self.asked_area_mm2[sample];
            }
        }
        coverage.measured_area_mm2 = coverage.grade_area_mm2.iter().sum();
        coverage.regions = self.regions(verdicts);
        let mut open_mm2 = self.asked_area_mm2.clone();
        let mut covered_mm2 = 0.0;
        for row in measuring {
            covered_mm2 += row.samples().map(|sample| std::mem::take(&mut open_mm2[sample as usize])).sum::<f64>();
            coverage.curve_area_mm2.push(covered_mm2);
        }
        coverage
    }

    fn regions(&self, verdicts: &[Verdict]) -> Vec<RegionCoverage> {
        let named = requirements::regions(self.params).into_iter();
        let mut regions: Vec<_> = named
            .map(|region| RegionCoverage { name: region.name, target: region.target, ..RegionCoverage::default() })
            .collect();
        if regions.is_empty() {
            return regions;
        }
        let coverable = coverable(&self.rows(&self.usable()), self.asked_area_mm2.len());
        for (sample, verdict) in verdicts.iter().enumerate() {
            for &region in &self.surface.requirements.of(sample).regions {
                let (region, area_mm2) = (&mut regions[region], self.asked_area_mm2[sample]);
                region.asked_area_mm2 += area_mm2;
                region.coverable_area_mm2 += if coverable.holds(sample as u32) { area_mm2 } else { 0.0 };
                region.measured_area_mm2 += if matches!(verdict, Verdict::Measured(_)) { area_mm2 } else { 0.0 };
            }
        }
        regions
    }

    fn counts(&self) -> CandidateCounts {
        let mut rejected: BTreeMap<Rejection, usize> = BTreeMap::new();
        let by_cell = (0..self.candidates.kept.len()).filter_map(|kept| self.blocked(kept)).map(|blocked| match blocked {
            StationFailure::Unreachable => Rejection::Unreachable,
            StationFailure::Collision => Rejection::Collision,
        });
        for reason in self.candidates.rejected.iter().map(|(_, reason)| *reason).chain(by_cell) {
            *rejected.entry(reason).or_default() += 1;
        }
        CandidateCounts { generated: self.candidates.generated, kept: self.usable().len(), rejected }
    }

    fn views(
        &self,
        chosen: &ChosenViews,
        ordered: &[Ordered],
        used: &[usize],
        no_path: &BTreeSet<usize>,
        coverage: &Coverage,
    ) -> Vec<PlannedView> {
        let setup = |candidate: &Candidate| used.iter().position(|setup| *setup == candidate.setup).unwrap_or_default();
        let station = |view: ViewId| {
            let mut visits = ordered.iter().flat_map(|ordered| &ordered.sequence.visits);
            visits.find(|(visited, _)| *visited == view).map(|(_, leg)| leg.target)
        };
        let curve = &coverage.curve_area_mm2;
        let gain_mm2 = |number: usize| if number == 0 { curve[0] } else { curve[number] - curve[number - 1] };
        let choices = chosen.kept.iter().zip(&chosen.selection.choices).enumerate();
        choices
            .map(|(number, (kept, choice))| {
                let (id, candidate) = (ViewId(number as u32), &self.candidates.kept[*kept]);
                let station = station(id);
                PlannedView {
                    id,
                    candidate: candidate.id,
                    setup: setup(candidate),
                    label: candidate.label,
                    part_from_scanner: candidate.part_from_scanner,
                    gain_of_asked: super::plan::share(gain_mm2(number), coverage.asked_area_mm2),
                    score: choice.score,
                    station,
                    stance: station.zip(self.input.cell).map(|(station, cell)| Stance::of(&cell.robot, &station, None)),
                    rejected: no_path.contains(kept).then_some(Cause::NoPath),
                }
            })
            .collect()
    }

    /// Explains in words which causes keep every candidate from measuring anything.
    fn no_plan_detail(&self) -> String {
        let counts = self.counts();
        let dropped: Vec<_> = counts.rejected.iter().map(|(reason, count)| format!("{} {count}", reason.as_str())).collect();
        let verdicts = self.verdicts(&[], &BTreeSet::new());
        let area_of = |cause: Cause| -> f64 {
            (0..verdicts.len()).filter(|s| verdicts[*s] == Verdict::Missed(cause)).map(|s| self.asked_area_mm2[s]).sum()
        };
        let mut causes: Vec<_> = Cause::ALL.map(|cause| (cause, area_of(cause))).into();
        causes.retain(|(_, area_mm2)| *area_mm2 > 0.0);
        causes.sort_by(|a, b| b.1.total_cmp(&a.1));
        let asked_mm2: f64 = self.asked_area_mm2.iter().sum();
        let named: Vec<_> = causes
            .iter()
            .take(3)
            .map(|(cause, area)| format!("{} {:.0} % of the area", cause.as_str(), 100.0 * area / asked_mm2))
            .collect();
        let dropped = if dropped.is_empty() { "none".to_owned() } else { dropped.join(", ") };
        format!(
            "of {} candidates {} were usable (dropped: {dropped}), and none measures anything worth a view; causes: {}",
            counts.generated,
            counts.kept,
            named.join(", ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_met_without_the_given_up_views_is_not_called_met() {
        let params = SelectionParams::default();
        let covered = |measured_area_mm2| Coverage { measured_area_mm2, coverable_area_mm2: 100.0, ..Coverage::default() };
        assert_eq!(stopped_because(StopReason::Target, &covered(98.5), &params), StopReason::Target);
        assert_eq!(stopped_because(StopReason::Target, &covered(95.0), &params), StopReason::NoPath);
        assert_eq!(stopped_because(StopReason::Growth, &covered(95.0), &params), StopReason::Growth);
    }
}
