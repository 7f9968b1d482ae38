//! Choosing apart from certifying: views are chosen on some of the samples ([`crate::planning::surface::thinned`]) and then evaluated
//! on every one. Of the samples that they miss it is found out what the other candidates measure, so that coverable area, causes
//! and remedies are those of every sample too. Where the views meet their goals on some samples and not on all, samples are
//! added where the two disagree, and the choice is taken up again.
//!
//! Cost: each chosen view evaluated on every sample, and each candidate on those that the views miss, once while it stays where it is.

use std::collections::BTreeSet;
use std::mem;
use std::sync::Arc;

use rayon::prelude::*;

use super::{ChosenViews, PartlyKnown, SampledPart, ViewPlanningProblem};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::candidates::Candidate;
use crate::planning::context::{Cancelled, Context, PlanError};
use crate::planning::ids::{CandidateIndex, RowIndex, SampleId, SetupIndex, ViewId};
use crate::planning::selection::{CoverProblem, Goal, Overlap, StopReason};
use crate::planning::sequence::Ordered;
use crate::planning::setups::Setup;
use crate::planning::setups::registration::union_of;
use crate::planning::surface::Surface;
use crate::planning::verdict::Cause;
use crate::planning::visibility::{self, Row, SampleSet, VisibilityMatrix};

/// Share by which a goal may be missed: areas are sums in another order.
const SUM_SLACK: f64 = 1e-9;

/// A chosen view that is evaluated on every sample.
pub(in crate::planning) struct EvaluatedView {
    candidate: CandidateIndex,
    /// Table angles at which it may be taken; none without a cell.
    table_rad: Vec<f64>,
    /// False where no path leads to it.
    is_executed: bool,
}

/// Samples of a part, as far as candidates measure them.
struct FoundOnEvery {
    /// Row of each candidate; empty while nothing is known of it.
    rows: Vec<Row>,
    hidden_by_cell: SampleSet,
    furthest_cause: Vec<Cause>,
}

impl FoundOnEvery {
    /// Takes over what is known of candidates that have stayed, on the samples that were open and still are.
    fn take_over(&mut self, mut earlier: ViewPlanningProblem<'_>, known: &[CandidateIndex], open: &SampleSet) {
        let mut still_open = mem::take(&mut earlier.partly_known.open);
        still_open.retain_all(open);
        for candidate in known {
            let row = mem::take(&mut earlier.matrix.rows[candidate.index()]);
            let mut measured = row.measured().clone();
            measured.retain_all(&still_open);
            self.rows[candidate.index()] = Row::new(measured.into_words());
        }
        earlier.hidden_by_cell.retain_all(&still_open);
        self.hidden_by_cell.insert_all(&earlier.hidden_by_cell);
        for sample in still_open.iter() {
            let furthest = &mut self.furthest_cause[sample.index()];
            *furthest = (*furthest).max(earlier.matrix.furthest_cause[sample.index()]);
        }
    }

    /// Adds what `candidates`, the first rows of a matrix of the samples looked at, measure.
    fn add(
        &mut self,
        candidates: &[CandidateIndex],
        looked_at: &[(SampleId, f64)],
        (cast, hidden): (&VisibilityMatrix, &SampleSet),
    ) {
        let samples = self.furthest_cause.len();
        for (candidate, row) in candidates.iter().zip(&cast.rows) {
            let known = &mut self.rows[candidate.index()];
            let mut measured = if known.words().is_empty() { SampleSet::none_of(samples) } else { known.measured().clone() };
            row.samples().for_each(|place| measured.insert(looked_at[place.index()].0));
            *known = Row::new(measured.into_words());
        }
        hidden.iter().for_each(|place| self.hidden_by_cell.insert(looked_at[place.index()].0));
        for ((sample, _), cause) in looked_at.iter().zip(&cast.furthest_cause) {
            let furthest = &mut self.furthest_cause[sample.index()];
            *furthest = (*furthest).max(*cause);
        }
    }
}

/// A pose to be evaluated.
struct Viewpoint<'a> {
    pose: &'a Pose<Part, ScannerFrame>,
    setup: SetupIndex,
    usable: bool,
    table_rad: Vec<f64>,
}

impl<'a> ViewPlanningProblem<'a> {
    /// Chosen views, each from any of its stations.
    pub(in crate::planning) fn at_any_station(&self, chosen: &ChosenViews) -> Vec<EvaluatedView> {
        let view = |candidate: &CandidateIndex| EvaluatedView {
            candidate: *candidate,
            table_rad: self.table_angles_rad(*candidate),
            is_executed: true,
        };
        chosen.candidates.iter().map(view).collect()
    }

    /// Chosen views, each from the station of its order.
    pub(in crate::planning) fn as_ordered(&self, chosen: &ChosenViews, ordered: &[Ordered]) -> Vec<EvaluatedView> {
        let view = |(id, candidate): (ViewId, CandidateIndex)| {
            let mut visits = ordered.iter().flat_map(|ordered| &ordered.sequence.visits);
            let station = visits.find(|(visited, _)| *visited == id).map(|(_, leg)| leg.target);
            EvaluatedView {
                candidate,
                table_rad: station.map_or_else(|| self.table_angles_rad(candidate), |station| vec![station.table_angle_rad]),
                is_executed: !ordered.iter().any(|ordered| ordered.no_path.contains(&id)),
            }
        };
        chosen.views().map(view).collect()
    }

    fn table_angles_rad(&self, candidate: CandidateIndex) -> Vec<f64> {
        let mut angles: Vec<f64> = self.stations(candidate).iter().map(|station| station.table_angle_rad).collect();
        angles.dedup();
        angles
    }

    /// The problem on every sample, with the whole rows of `views`; of the other candidates with what they measure of the samples
    /// that those miss which are executed. What an `earlier` such problem knows of candidates that have not moved since is not
    /// found out again.
    pub(in crate::planning) fn on_every_sample(
        &self,
        sampled: &'a SampledPart,
        setups: &[Setup<'_>],
        views: &[EvaluatedView],
        earlier: Option<Self>,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let ctx = &ctx.silent();
        let (whole, asked_area_mm2) = (&sampled.surface, &sampled.asked_area_mm2);
        let samples = asked_area_mm2.len();
        let chosen: Vec<_> = views.iter().map(|view| self.viewpoint(view.candidate, view.table_rad.clone())).collect();
        let (of_chosen, hidden_by_cell) = self.cast_on(whole, setups, &chosen, ctx)?;
        let rows = vec![Row::default(); self.candidates.remaining.len()];
        let mut found = FoundOnEvery { rows, hidden_by_cell, furthest_cause: of_chosen.furthest_cause };
        let mut open = SampleSet::none_of(samples);
        whole.samples().filter(|sample| asked_area_mm2[sample.index()] > 0.0).for_each(|sample| open.insert(sample));
        for (view, row) in views.iter().zip(&of_chosen.rows) {
            if view.is_executed {
                open.remove_all(row.measured());
            }
            let pose = &self.candidates[view.candidate].part_from_scanner;
            found.rows[view.candidate.index()] = visibility::grade(whole, pose, self.input.scanner, self.params, row);
        }
        let is_chosen: BTreeSet<CandidateIndex> = views.iter().map(|view| view.candidate).collect();
        let others = self.candidates.indices().filter(|candidate| !is_chosen.contains(candidate));
        let has_stayed = |candidate: &CandidateIndex| earlier.as_ref().is_some_and(|earlier| earlier.has_at(self, *candidate));
        let (known, new): (Vec<_>, Vec<_>) = others.partition(has_stayed);
        let mut newly_open = open.clone();
        if let Some(earlier) = earlier {
            newly_open.remove_all(&earlier.partly_known.open);
            found.take_over(earlier, &known, &open);
        }
        let dropped = self.candidates.rejected.iter().filter(|(_, reason)| reason.is_of_evaluated());
        let mut dropped: Vec<_> = dropped.map(|(candidate, _)| viewpoint(candidate, false, Vec::new())).collect();
        for (candidates, looked_at) in [(known, newly_open), (new, open.clone())] {
            let looked_at: Vec<(SampleId, f64)> =
                looked_at.iter().map(|sample| (sample, asked_area_mm2[sample.index()])).collect();
            let viewpoint = |candidate: &CandidateIndex| self.viewpoint(*candidate, self.table_angles_rad(*candidate));
            let viewpoints: Vec<_> = candidates.iter().map(viewpoint).chain(dropped.drain(..)).collect();
            let (cast, hidden) = self.cast_on(&whole.of_samples(&looked_at), setups, &viewpoints, ctx)?;
            found.add(&candidates, &looked_at, (&cast, &hidden));
        }
        let FoundOnEvery { rows, hidden_by_cell, furthest_cause } = found;
        Ok(Self {
            input: self.input,
            params: self.params,
            surface: Arc::clone(whole),
            setups: self.setups.clone(),
            candidates: self.candidates.clone(),
            matrix: VisibilityMatrix { rows, furthest_cause },
            robust_rows: None,
            reach: self.reach.clone(),
            hidden_by_cell,
            asked_area_mm2: asked_area_mm2.clone(),
            partly_known: PartlyKnown { whole: is_chosen, open },
            strata: None,
            coverable_of_setup_mm2: self.coverable_of_setups_mm2(),
            chosen_on: self.chosen_on,
        })
    }

    /// Returns true if this is the problem `other` on every sample, with the whole rows of these views, and nothing moves any more.
    pub(in crate::planning) fn is_of(&self, chosen: &ChosenViews, other: &Self) -> bool {
        let has_all = self.candidates.remaining.len() == other.candidates.remaining.len();
        has_all && self.reach.is_none() && chosen.candidates.iter().copied().collect::<BTreeSet<_>>() == self.partly_known.whole
    }

    /// Returns true if a candidate of `other` is the same here and has not moved.
    fn has_at(&self, other: &Self, candidate: CandidateIndex) -> bool {
        let here = self.candidates.remaining.get(candidate.index());
        here.is_some_and(|here| here.part_from_scanner == other.candidates[candidate].part_from_scanner)
    }

    /// Poses of chosen views.
    pub(in crate::planning) fn poses_of(&self, chosen: &ChosenViews) -> Vec<Pose<Part, ScannerFrame>> {
        chosen.candidates.iter().map(|candidate| self.candidates[*candidate].part_from_scanner).collect()
    }

    /// Puts chosen views back to poses, of which nothing is needed any more but what they measure of every sample.
    pub(in crate::planning) fn put_back(&mut self, chosen: &ChosenViews, poses: &[Pose<Part, ScannerFrame>]) {
        for (candidate, pose) in chosen.candidates.iter().zip(poses) {
            self.candidates[*candidate].part_from_scanner = *pose;
        }
    }

    /// Returns true if views meet every goal of choosing among the candidates that are not `excluded`.
    pub(in crate::planning) fn meets_goals(&self, views: &[CandidateIndex], excluded: &BTreeSet<CandidateIndex>) -> bool {
        let measured = union_of(self.rows(views), self.asked_area_mm2.len());
        unmet(&self.cover_problem(&self.choosable(excluded)), &measured).is_none()
    }

    /// Adds samples where these disagree with `every`, the problem on every sample, about the views; returns false where they do
    /// not disagree.
    pub(in crate::planning) fn refine(
        &mut self,
        every: &ViewPlanningProblem<'_>,
        setups: &[Setup<'_>],
        chosen: &ChosenViews,
        ctx: &Context<'_>,
    ) -> Result<bool, Cancelled> {
        let Some(mut strata) = self.strata.take() else { return Ok(false) };
        let measured = union_of(self.rows(&chosen.candidates), self.asked_area_mm2.len());
        let mut missed = union_of(every.rows(&every.usable()), every.asked_area_mm2.len());
        missed.remove_all(&union_of(every.rows(&chosen.candidates), every.asked_area_mm2.len()));
        let missed: Vec<SampleId> = missed.iter().filter(|sample| every.asked_area_mm2[sample.index()] > 0.0).collect();
        let own = self.surface.sample_mm.len();
        let added = strata.refine(Arc::make_mut(&mut self.surface), &every.surface, |sample| measured.holds(sample), &missed);
        self.strata = Some(strata);
        if added.is_empty() {
            return Ok(false);
        }
        let part = every.surface.of_samples(&added.iter().map(|sample| (*sample, 0.0)).collect::<Vec<_>>());
        let all = self.candidates.indices().map(|candidate| self.viewpoint(candidate, self.table_angles_rad(candidate)));
        let (cast, hidden) = self.cast_on(&part, setups, &all.collect::<Vec<_>>(), &ctx.silent())?;
        let samples = own + added.len();
        let rows = self.matrix.rows.par_iter().zip(&cast.rows).map(|(row, added)| row.followed_by(added, own, samples));
        self.matrix.rows = rows.collect();
        self.matrix.furthest_cause.extend(cast.furthest_cause);
        let known = Row::new(std::mem::take(&mut self.hidden_by_cell).into_words());
        self.hidden_by_cell = known.followed_by(&Row::new(hidden.into_words()), own, samples).measured().clone();
        self.asked_area_mm2 = self.surface.asked_area_mm2();
        self.chosen_on.samples = samples;
        self.chosen_on.refinements += 1;
        Ok(true)
    }

    /// The chosen views with as many more as meet the goals on every sample, each the one that adds most to the first goal that is
    /// not met, of those that overlap the views before as is asked for; where the goals stay unmet, with the rule that ended it.
    pub(in crate::planning) fn topped_up(
        &self,
        every: &ViewPlanningProblem<'_>,
        mut chosen: ChosenViews,
        excluded: &BTreeSet<CandidateIndex>,
        ctx: &Context<'_>,
    ) -> Result<ChosenViews, PlanError> {
        let choosable = self.choosable(excluded);
        let (cover, own) = (every.cover_problem(&choosable), self.cover_problem(&choosable));
        // On every sample, other candidates have rows of what the views miss alone.
        let overlap = Overlap::new(&own, &self.params.selection.overlap);
        let place = |candidate: &CandidateIndex| choosable.binary_search(candidate).ok().map(RowIndex::at);
        let mut rows: Vec<RowIndex> = chosen.candidates.iter().filter_map(place).collect();
        let max_views = self.params.selection.max_views.map_or(usize::MAX, |views| views as usize);
        let (mut views, mut measured) =
            (chosen.candidates.clone(), union_of(every.rows(&chosen.candidates), every.asked_area_mm2.len()));
        while views.len() < max_views {
            let Some(goal) = unmet(&cover, &measured) else { break };
            let gain = |(row, candidate): (RowIndex, &CandidateIndex)| {
                let new = every.row(*candidate).samples().filter(|sample| !measured.holds(*sample));
                (new.map(|sample| goal.area_mm2[sample.index()]).sum::<f64>(), row, *candidate)
            };
            let joining = RowIndex::number(&choosable).filter(|(row, _)| overlap.joins(*row, &rows));
            let best = joining.map(gain).reduce(|best, next| if next.0 > best.0 { next } else { best });
            let Some((_, row, candidate)) = best.filter(|best| best.0 > 0.0) else { break };
            measured.insert_all(every.row(candidate).measured());
            views.push(candidate);
            rows.push(row);
        }
        if unmet(&cover, &measured).is_some() {
            let ended_by = if views.len() < max_views { StopReason::NoGain } else { StopReason::MaxViews };
            chosen.selection.stopped_because = ended_by;
        }
        if views.len() == chosen.candidates.len() {
            return Ok(chosen);
        }
        self.chosen_of(&own, &choosable, &rows, &chosen, ctx)
    }

    /// Asked area that some candidate of each setup measures that the cell can use.
    fn coverable_of_setups_mm2(&self) -> Option<Vec<f64>> {
        let usable = self.usable();
        let of_setup = |(setup, _): (SetupIndex, _)| {
            let here = usable.iter().filter(|candidate| self.candidates[**candidate].setup == setup);
            let coverable = union_of(here.map(|candidate| self.row(*candidate)), self.asked_area_mm2.len());
            coverable.iter().map(|sample| self.asked_area_mm2[sample.index()]).sum()
        };
        (self.setups.len() > 1).then(|| SetupIndex::number(&self.setups).map(of_setup).collect())
    }

    fn viewpoint(&self, candidate: CandidateIndex, table_rad: Vec<f64>) -> Viewpoint<'_> {
        viewpoint(&self.candidates[candidate], self.blocked(candidate).is_none(), table_rad)
    }

    /// Matrix of views on another surface of the part, less the samples that obstacles of the cell hide at any of their angles;
    /// and those samples.
    fn cast_on(
        &self,
        surface: &Surface,
        setups: &[Setup<'_>],
        views: &[Viewpoint<'_>],
        ctx: &Context<'_>,
    ) -> Result<(VisibilityMatrix, SampleSet), Cancelled> {
        let samples = surface.sample_mm.len();
        let mut all = VisibilityMatrix { rows: vec![Row::default(); views.len()], furthest_cause: vec![Cause::Facing; samples] };
        let mut hidden_by_cell = SampleSet::none_of(samples);
        for (index, setup) in SetupIndex::number(setups) {
            let here: Vec<usize> = (0..views.len()).filter(|place| views[*place].setup == index).collect();
            let poses: Vec<_> = here.iter().map(|place| *views[*place].pose).collect();
            let usable: Vec<bool> = here.iter().map(|place| views[*place].usable).collect();
            let mut cast = visibility::cast(surface, &poses, &usable, self.input.scanner, &setup.occluders, self.params, ctx)?;
            if let Some(sight) = setup.scene.as_ref().map(|scene| scene.sight()).filter(|sight| !sight.has_no_obstacles()) {
                let hidden = |(row, place): (&Row, &usize)| {
                    let (view, mut hidden) = (&views[*place], SampleSet::none_of(samples));
                    for table_rad in &view.table_rad {
                        let at_angle = sight.hidden(surface, view.pose, row.measured(), *table_rad, ctx)?;
                        at_angle.iter().for_each(|at_angle| hidden.insert_all(at_angle));
                    }
                    Ok(hidden)
                };
                let hidden = cast.rows.par_iter().zip(&here).map(hidden).collect::<Result<Vec<_>, Cancelled>>()?;
                for (row, hidden) in cast.rows.iter_mut().zip(&hidden) {
                    *row = row.without(hidden);
                    hidden_by_cell.insert_all(hidden);
                }
            }
            here.iter().zip(cast.rows).for_each(|(place, row)| all.rows[*place] = row);
            let furthest = all.furthest_cause.iter_mut().zip(cast.furthest_cause);
            furthest.for_each(|(furthest, cause)| *furthest = (*furthest).max(cause));
        }
        Ok((all, hidden_by_cell))
    }
}

fn viewpoint(candidate: &Candidate, usable: bool, table_rad: Vec<f64>) -> Viewpoint<'_> {
    Viewpoint { pose: &candidate.part_from_scanner, setup: candidate.setup, usable, table_rad }
}

/// The first goal that views do not meet which measure these samples.
fn unmet<'c>(cover: &'c CoverProblem<'_>, measured: &SampleSet) -> Option<&'c Goal<'c>> {
    let measured_mm2 = |goal: &Goal<'_>| measured.iter().map(|sample| goal.area_mm2[sample.index()]).sum::<f64>();
    cover.goals.iter().find(|goal| measured_mm2(goal) < goal.needed_mm2 * (1.0 - SUM_SLACK))
}

#[cfg(test)]
mod tests {
    use std::ops::Range;
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::candidates::{CandidateSet, Label};
    use crate::planning::context::Silent;
    use crate::planning::ids::CandidateId;
    use crate::planning::params::{OverlapParams, PlanParams};
    use crate::planning::plan::{Bound, ChosenOn};
    use crate::planning::scene::PlanInput;
    use crate::planning::selection::{Choice, OpenBound, OpenSelection};
    use crate::planning::surface;
    use crate::testing::{box_mesh, nominal_scanner};

    /// Views that met the target on some samples alone were joined by the one that adds most, whatever it shares with them.
    #[test]
    fn a_view_that_is_added_on_every_sample_overlaps_those_before_it_as_is_asked() {
        let (mesh, scanner, mut params) = (box_mesh([0.0; 3], [30.0; 3]), nominal_scanner(), PlanParams::default());
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.05), Some(100.0));
        params.selection.overlap = OverlapParams { min_area_mm2: Some(1.0), min_share: None };
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let surface = surface::sample(&mesh, &params.part, &params.regions, 0).unwrap_or_else(|errors| panic!("{errors:?}"));
        let (asked_area_mm2, samples) = (surface.asked_area_mm2(), surface.sample_mm.len());
        // The first is chosen; the second adds most and shares nothing with it; the third does.
        let measured: [Range<usize>; 3] = [0..100, 130..240, 90..120];
        let row = |range: Range<usize>| Row::from_samples(samples, range.map(|sample| (SampleId::at(sample), 0.5)));
        let candidate = |number: usize| Candidate {
            id: CandidateId::at(number),
            part_from_scanner: Pose::identity(),
            label: Label::Top,
            setup: SetupIndex(0),
            is_given: false,
            slid_from: None,
        };
        let problem = ViewPlanningProblem {
            input: &input,
            params: &params,
            surface: Arc::new(surface),
            setups: vec![Pose::identity()],
            candidates: CandidateSet { remaining: (0..3).map(candidate).collect(), generated: 3, rejected: Vec::new() },
            matrix: VisibilityMatrix { rows: measured.map(row).into(), furthest_cause: vec![Cause::Facing; samples] },
            robust_rows: None,
            reach: None,
            hidden_by_cell: SampleSet::none_of(samples),
            asked_area_mm2,
            partly_known: PartlyKnown::default(),
            strata: None,
            coverable_of_setup_mm2: None,
            chosen_on: ChosenOn::default(),
        };
        let choices = vec![Choice { row: RowIndex(0), gain_mm2: 0.0, score: 0.0 }];
        let bound = Arc::new(OpenBound::Known(Bound::default()));
        let selection = OpenSelection { choices, stopped_because: StopReason::Target, bound, before_raise: None };
        let chosen = ChosenViews { candidates: vec![CandidateIndex(0)], selection };
        let (cancel, nothing) = (AtomicBool::new(false), BTreeSet::new());
        let topped_up = problem.topped_up(&problem, chosen, &nothing, &Context::new(&cancel, &Silent));
        let topped_up = topped_up.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(BTreeSet::from_iter(topped_up.candidates), BTreeSet::from([CandidateIndex(0), CandidateIndex(2)]));
        assert_eq!(topped_up.selection.stopped_because, StopReason::NoGain, "the target is not met without the second");
    }
}
