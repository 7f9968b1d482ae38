//! A trial of further views, in setups that a plan does not have and in those of its own that may take more: chosen on some of
//! the samples, joined to each other and to the setups that stay by surface that they share, and ordered.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::turn_over::WantedRegion;
use super::{Basis, Wanted, choose, lengthening_secs, quickest_secs, starting_params, within};
use crate::cell::Configuration;
use crate::geometry::{Part, Pose, ScannerFrame, Table, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, RowIndex, SampleId, SetupIndex, ViewId};
use crate::planning::params::PlanParams;
use crate::planning::plan::{Outcome, Plan, SetupId, SetupPlan};
use crate::planning::problem::{EvaluatedCandidates, TriedSetup};
use crate::planning::scene::PlanningScene;
use crate::planning::selection::{self, CoverProblem};
use crate::planning::sequence::straight_secs;
use crate::planning::setups::registration::{SharedSurface, shared, union_of};
use crate::planning::stations::Station;
use crate::planning::surface::Surface;
use crate::planning::verdict::MIN_RESISTANCE;
use crate::planning::visibility::{Row, SampleSet, UnitedViews};

/// Views that are added at most for what is missed.
const MAX_ADDED: usize = 60;
/// Share of an area that may be lacking of it: sums over samples are not exact to the last bit.
const SUM_SLACK: f64 = 1e-9;
/// Views that are added at most to register a setup to the others.
pub(super) const MAX_JOINING: usize = 12;

/// Views in further setups.
pub(super) struct Trial<'a> {
    /// The plan on the samples of the setups' surface.
    basis: &'a Basis,
    setups: &'a [TriedSetup<'a>],
    /// Setup of each candidate; those of the setups stand one after another.
    setup_of: Vec<SetupIndex>,
    poses: Vec<Pose<Part, ScannerFrame>>,
    rows: Vec<&'a Row>,
    stations: Vec<&'a [Station]>,
    /// Candidates that were chosen.
    chosen: Vec<CandidateIndex>,
    /// Table angle at which each of them is taken once they are ordered; none without a cell.
    table_rad: BTreeMap<CandidateIndex, f64>,
}

/// View of a plan that may stay, on the samples of a trial.
pub(super) struct OwnView<'a> {
    id: ViewId,
    row: Row,
    /// The station that it is taken from; none without a cell.
    stations: &'a [Station],
}

impl<'a> OwnView<'a> {
    /// The view of a plan on some of its samples, which ascend.
    pub(super) fn on(some: &[(SampleId, f64)], outcome: &'a Outcome, id: ViewId) -> Self {
        let mut samples = SampleSet::none_of(outcome.verdicts.len());
        some.iter().for_each(|(sample, _)| samples.insert(*sample));
        let of_plan = outcome.measured_by_view[id.index()].within(&samples);
        let measured = Row::new(within(of_plan.measured(), some).into_words());
        let row = match of_plan.quality() {
            Some((scale, steps)) => measured.with_quality(steps.to_vec(), scale),
            None => measured,
        };
        let station = outcome.plan.views[id.index()].station.as_ref();
        Self { id, row, stations: station.map_or(&[][..], std::slice::from_ref) }
    }
}

impl<'a> Trial<'a> {
    /// A trial in which no view is chosen yet of the candidates of each setup, which the cell can all take.
    pub(super) fn new(basis: &'a Basis, setups: &'a [TriedSetup<'a>], of_setups: &'a [EvaluatedCandidates]) -> Self {
        let mut trial = Self {
            basis,
            setups,
            setup_of: Vec::new(),
            poses: Vec::new(),
            rows: Vec::new(),
            stations: Vec::new(),
            chosen: Vec::new(),
            table_rad: BTreeMap::new(),
        };
        for (setup, candidates) in SetupIndex::number(of_setups) {
            let stations = |candidate: CandidateIndex| match &candidates.reach {
                Some(reach) => reach[candidate.index()].as_deref().unwrap_or_default(),
                None => &[],
            };
            let remaining = &candidates.candidates.remaining;
            trial.setup_of.extend(std::iter::repeat_n(setup, remaining.len()));
            trial.poses.extend(remaining.iter().map(|candidate| candidate.part_from_scanner));
            trial.rows.extend(&candidates.matrix.rows);
            trial.stations.extend(candidates.candidates.indices().map(stations));
        }
        trial
    }

    /// Returns true if a view was chosen in a setup where the part lies in a pose that is meant.
    pub(super) fn has_views_where(&self, is_meant: impl Fn(&Pose<Table, Part>) -> bool) -> bool {
        let mut setups = self.chosen.iter().map(|candidate| &self.setups[self.setup_of[candidate.index()].index()]);
        setups.any(|setup| is_meant(&setup.table_from_part))
    }

    /// Number of views that were chosen.
    pub(super) fn chosen_views(&self) -> usize {
        self.chosen.len()
    }

    fn measured_by(&self, candidates: &[CandidateIndex]) -> SampleSet {
        union_of(candidates.iter().map(|candidate| self.rows[candidate.index()]), self.basis.asked_area_mm2.len())
    }

    /// Samples that the plan's views and those chosen here measure.
    fn measured(&self) -> SampleSet {
        let mut measured = self.basis.measured.clone();
        measured.insert_all(&self.measured_by(&self.chosen));
        measured
    }

    /// Chooses views beside those of the plan until the target is met, then for each region that misses its own.
    pub(super) fn choose(&mut self, params: &PlanParams, regions: &[WantedRegion], ctx: &Context<'_>) -> Result<(), Cancelled> {
        let basis = self.basis;
        let open_mm2 = basis.open_area_mm2();
        let wanted = Wanted {
            open_mm2: &open_mm2,
            needed_mm2: self.enough_mm2(params) - basis.measured_mm2(),
            min_gain_mm2: params.selection.min_growth * basis.asked_mm2(),
            max_views: MAX_ADDED,
        };
        (_, self.chosen) = views_and_candidates(&[], &choose(&self.rows, &wanted, &params.score, ctx)?);
        for region in regions {
            let measured = self.measured();
            let mut open_mm2 = region.area_mm2.clone();
            measured.iter().for_each(|sample| open_mm2[sample.index()] = 0.0);
            let needed_mm2 = region.needed_mm2 - region.measured_mm2(&measured);
            let max_views = MAX_ADDED.saturating_sub(self.chosen.len());
            let wanted = Wanted { open_mm2: &open_mm2, needed_mm2, min_gain_mm2: 0.0, max_views };
            let (_, more) = views_and_candidates(&[], &choose(&self.rows, &wanted, &params.score, ctx)?);
            self.chosen.extend(more);
        }
        Ok(())
    }

    /// Chooses views for the same area anew, among the plan's own views and the candidates: a plan chooses for all of its setups at
    /// once, and needs few of the views that it takes in one alone. Returns those of its own that stay; `None`, with the choice as it
    /// was, where as many views are needed.
    pub(super) fn choose_fewer(
        &mut self,
        own: &[OwnView<'_>],
        params: &PlanParams,
        ctx: &Context<'_>,
    ) -> Result<Option<Vec<ViewId>>, Cancelled> {
        let basis = self.basis;
        let rows: Vec<&Row> = own.iter().map(|view| &view.row).chain(self.rows.iter().copied()).collect();
        let wanted = Wanted {
            open_mm2: &basis.asked_area_mm2,
            needed_mm2: self.enough_mm2(params).min(basis.area_mm2(&self.measured())),
            min_gain_mm2: params.selection.min_growth * basis.asked_mm2(),
            max_views: (own.len() + self.chosen.len()).saturating_sub(1),
        };
        let places = choose(&rows, &wanted, &params.score, ctx)?;
        let measured = union_of(places.iter().map(|row| rows[row.index()]), basis.asked_area_mm2.len());
        if basis.area_mm2(&measured) < (1.0 - SUM_SLACK) * wanted.needed_mm2 {
            return Ok(None);
        }
        let (staying, chosen) = views_and_candidates(own, &places);
        self.chosen = chosen;
        Ok(Some(staying))
    }

    /// Area that meets the target of the plan in its setups and those that are tried.
    fn enough_mm2(&self, params: &PlanParams) -> f64 {
        let mut coverable = self.basis.coverable.clone();
        self.rows.iter().for_each(|row| coverable.insert_all(row.measured()));
        params.selection.target * self.basis.whole_mm2(&coverable, params.selection.target_of)
    }

    /// Chooses as many views as a plan may have for the best coverage of `surface`, that of the setups: anew, among the plan's
    /// own views and the candidates. Returns those of its own that stay.
    pub(super) fn choose_anew(
        &mut self,
        own: &[OwnView<'_>],
        surface: &Surface,
        params: &PlanParams,
        ctx: &Context<'_>,
    ) -> Result<Vec<ViewId>, Cancelled> {
        let (selection, asked_area_mm2) = (starting_params(&params.selection, &params.score), &self.basis.asked_area_mm2);
        let rows: Vec<&Row> = own.iter().map(|view| &view.row).chain(self.rows.iter().copied()).collect();
        let stations: Vec<&[Station]> = own.iter().map(|view| view.stations).chain(self.stations.iter().copied()).collect();
        let cell = self.setups.iter().find_map(|setup| setup.scene).map(PlanningScene::cell);
        let travel_secs = |from: RowIndex, to: RowIndex| {
            let ends = [stations[from.index()], stations[to.index()]];
            cell.map_or(0.0, |cell| quickest_secs(cell, &params.motion, ends))
        };
        let weighted = |(sample, area_mm2): (SampleId, &f64)| area_mm2 * surface.requirements.of(sample).weight;
        let mut cover = CoverProblem::new(rows, asked_area_mm2, self.basis.total_mm2, &selection);
        cover.weighted_area_mm2 = Cow::Owned(SampleId::number(asked_area_mm2).map(weighted).collect());
        cover.view_secs = params.scan.settle_secs + params.scan.capture_secs;
        cover.travel_secs = cell.is_some().then_some(&travel_secs);
        let choices = selection::greedily(&cover, &selection, &params.score, &ctx.silent())?;
        let places: Vec<RowIndex> = choices.iter().map(|choice| choice.row).collect();
        let (staying, chosen) = views_and_candidates(own, &places);
        self.chosen = chosen;
        Ok(staying)
    }

    /// Adds views to each setup until it shares surface with another one that fixes all freedoms, as [`crate::planning::adjust`] does
    /// between the setups of a plan. Returns false where none would; true where nothing has to be joined.
    pub(super) fn join(&mut self, links: Option<&SetupsLink<'_>>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
        let Some(links) = links else { return Ok(true) };
        for setup in SetupIndex::first(self.setups.len()) {
            self.join_setup(setup, links, ctx)?;
        }
        Ok(self.is_joined(links))
    }

    /// Joins a setup to one of those that stay or stand before it; one without views, or the first of all, to none.
    fn join_setup(&mut self, setup: SetupIndex, links: &SetupsLink<'_>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        let staying = links.measured.len();
        let at = staying + setup.index();
        for _ in 0..MAX_JOINING {
            let sets = self.measured_by_setup(links);
            let now = links.resistance(&sets, at);
            if now >= MIN_RESISTANCE || sets[at].count() == 0 || sets[..at].iter().all(|set| set.count() == 0) {
                break;
            }
            let is_free =
                |candidate: &CandidateIndex| self.setup_of[candidate.index()] <= setup && !self.chosen.contains(candidate);
            let free: Vec<CandidateIndex> = CandidateIndex::first(self.rows.len()).filter(is_free).collect();
            let with = |candidate: &CandidateIndex| {
                ctx.check()?;
                let mut with = sets.clone();
                let its_setup = self.setup_of[candidate.index()];
                with[staying + its_setup.index()].insert_all(self.rows[candidate.index()].measured());
                Ok((*candidate, links.resistance(&with, at), links.shared_area_mm2(&with, at)))
            };
            let tried = parallel::try_map::<_, _, Cancelled>(&free, with)?;
            let stiffest = tried.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a }).filter(|best| best.1 > now + 1e-6);
            let widest = tried.iter().copied().reduce(|a, b| if b.2 > a.2 { b } else { a });
            let Some((candidate, ..)) = stiffest.or(widest) else { break };
            self.chosen.push(candidate);
        }
        Ok(())
    }

    /// Samples that the views of each setup measure, those of the setups that stay as they are first.
    fn measured_by_setup(&self, links: &SetupsLink<'_>) -> Vec<SampleSet> {
        let own = |setup: SetupIndex| {
            let mut measured = self.measured_by(&self.chosen_in(setup));
            measured.insert_all(&links.measured_in_tried[setup.index()]);
            measured
        };
        links.measured.iter().cloned().chain(SetupIndex::first(self.setups.len()).map(own)).collect()
    }

    fn chosen_in(&self, setup: SetupIndex) -> Vec<CandidateIndex> {
        self.chosen.iter().copied().filter(|candidate| self.setup_of[candidate.index()] == setup).collect()
    }

    /// Returns true if all setups with views are joined, each by shared surface that fixes all freedoms.
    pub(super) fn is_joined(&self, links: &SetupsLink<'_>) -> bool {
        links.join(&self.measured_by_setup(links))
    }

    /// Orders the views that were chosen, and drops those without a path. Returns the time that their moves add to a plan:
    /// in a setup of its own that is among the tried ones all of its views stay. 0 without a cell.
    pub(super) fn order(&mut self, plan: &Plan, ctx: &Context<'_>) -> Result<f64, Cancelled> {
        let mut moving_secs = 0.0;
        for setup in SetupIndex::first(self.setups.len()) {
            moving_secs += self.order_setup(setup, plan, ctx)?;
        }
        Ok(moving_secs)
    }

    fn order_setup(&mut self, setup: SetupIndex, plan: &Plan, ctx: &Context<'_>) -> Result<f64, Cancelled> {
        let TriedSetup { table_from_part, surface, scene, .. } = self.setups[setup.index()];
        let own = self.chosen_in(setup);
        let Some(scene) = scene.filter(|_| !own.is_empty()) else { return Ok(0.0) };
        let stations = own.iter().map(|candidate| self.stations[candidate.index()]);
        let views: Vec<(ViewId, &[Station])> = ViewId::number(stations).collect();
        let in_sight = |view: ViewId, station: &Configuration| {
            let place = own[view.index()].index();
            scene.is_in_sight(surface, &self.poses[place], self.rows[place], station.table_rad, ctx)
        };
        let ordered = scene.order(&views, false, &in_sight, ctx)?;
        let visits = ordered.sequence.visits.iter();
        self.table_rad.extend(visits.map(|(view, leg)| (own[view.index()], leg.target.table_angle_rad)));
        let no_path: Vec<CandidateIndex> = ordered.no_path.iter().map(|view| own[view.index()]).collect();
        self.chosen.retain(|candidate| !no_path.contains(candidate));
        let own = plan.setups.iter().find(|own| own.table_from_part == table_from_part);
        let Some(own) = own.and_then(|own| own.sequence.as_ref()) else { return Ok(ordered.sequence.motion_secs()) };
        let axes = scene.cell().axes();
        let secs_between = |from: &Configuration, to: &Configuration| straight_secs(&axes, from, to, &plan.params.motion);
        Ok(lengthening_secs(own, &ordered.sequence, secs_between))
    }

    /// Samples of a surface that the chosen views measure, past the obstacles of the cell.
    pub(super) fn measured_by_chosen(
        &self,
        together: &UnitedViews<'_>,
        surface: &Surface,
        ctx: &Context<'_>,
    ) -> Result<SampleSet, Cancelled> {
        let mut measured = together.nothing();
        for candidate in &self.chosen {
            ctx.check()?;
            let (pose, table_rad) = (&self.poses[candidate.index()], self.table_rad.get(candidate));
            let row = together.shared_row(pose, &measured)?;
            let scene = self.setups[self.setup_of[candidate.index()].index()].scene;
            let sight = scene.map(PlanningScene::sight).zip(table_rad);
            let hidden =
                sight.map(|(sight, table_rad)| sight.hidden(surface, pose, row.measured(), *table_rad, ctx)).transpose()?;
            measured.insert_all(hidden.flatten().map_or_else(|| row.clone(), |hidden| row.without(&hidden)).measured());
        }
        Ok(measured)
    }

    /// Adds to `coverable` what the candidates that were not chosen measure. What obstacles hide of them depends on where they would
    /// be taken from: with obstacles they count for nothing.
    pub(super) fn add_what_others_measure(
        &self,
        together: &UnitedViews<'_>,
        coverable: &mut SampleSet,
        ctx: &Context<'_>,
    ) -> Result<(), Cancelled> {
        let has_obstacles = |setup: &TriedSetup<'_>| setup.scene.is_some_and(|scene| !scene.sight().has_no_obstacles());
        if self.setups.iter().any(has_obstacles) {
            return Ok(());
        }
        for pose in &self.poses {
            ctx.check()?;
            let row = together.shared_row(pose, coverable)?;
            coverable.insert_all(row.measured());
        }
        Ok(())
    }
}

/// The views of a plan and the candidates that rows are of, where the rows of `own` stand before those of the candidates.
fn views_and_candidates(own: &[OwnView<'_>], rows: &[RowIndex]) -> (Vec<ViewId>, Vec<CandidateIndex>) {
    let (views, candidates): (Vec<RowIndex>, Vec<RowIndex>) = rows.iter().copied().partition(|row| row.index() < own.len());
    let views = views.into_iter().map(|row| own[row.index()].id).collect();
    (views, candidates.into_iter().map(|row| CandidateIndex::at(row.index() - own.len())).collect())
}

/// Links of further setups to each other and to those of a plan that stay.
pub(super) struct SetupsLink<'a> {
    surface: &'a Surface,
    part: SharedSurface<'a>,
    /// Samples that the views of each setup that stays as it is measure.
    measured: Vec<SampleSet>,
    /// Number of these that are known to be joined: all, where all setups of the plan stay.
    joined: usize,
    /// Samples that the plan's own views measure in each setup that is tried.
    measured_in_tried: Vec<SampleSet>,
}

impl<'a> SetupsLink<'a> {
    /// Links to the setups of a plan that lie in some of `poses`, by `surface`, which has some of its samples, with some of the views
    /// taken in them. Those that are among the `tried` ones take further views.
    pub(super) fn to_setups(
        outcome: &Outcome,
        (poses, views): (&[Pose<Table, Part>], &[ViewId]),
        tried: &[TriedSetup<'_>],
        (surface, some): (&'a Surface, &[(SampleId, f64)]),
    ) -> Self {
        let samples = outcome.surface.sample_mm.len();
        let measured_in = |id: SetupId| {
            let taken = views.iter().filter(|view| outcome.plan.views[view.index()].setup == id);
            within(&union_of(taken.map(|view| &outcome.measured_by_view[view.index()]), samples), some)
        };
        let setups = &outcome.plan.setups;
        let is_tried = |pose: &Pose<Table, Part>| tried.iter().any(|setup| setup.table_from_part == *pose);
        let stays = |setup: &SetupPlan| poses.contains(&setup.table_from_part) && !is_tried(&setup.table_from_part);
        let staying = SetupId::number(setups).filter(|(_, setup)| stays(setup));
        let measured: Vec<SampleSet> = staying.map(|(id, _)| measured_in(id)).collect();
        let measured_in_tried = |tried: &TriedSetup<'_>| {
            let own = SetupId::number(setups).find(|(_, setup)| setup.table_from_part == tried.table_from_part);
            own.map_or_else(|| SampleSet::none_of(some.len()), |(id, _)| measured_in(id))
        };
        let measured_in_tried = tried.iter().map(measured_in_tried).collect();
        // Views that are given up may have joined them.
        let keeps_all = views.len() == outcome.plan.views.iter().filter(|view| view.rejected.is_none()).count();
        let joined = if measured.len() == setups.len() && keeps_all { measured.len() } else { 0 };
        Self { surface, part: SharedSurface::new(surface), measured, joined, measured_in_tried }
    }

    /// Resistance of the strongest link of a setup to one before it, each given by the samples that its views measure.
    fn resistance(&self, sets: &[SampleSet], at: usize) -> f64 {
        let links = sets[..at].iter().map(|other| self.between(&sets[at], other));
        links.fold(0.0, f64::max)
    }

    fn between(&self, a: &SampleSet, b: &SampleSet) -> f64 {
        self.part.stability(&shared(a, b)).resistance
    }

    /// Area that a setup shares with any before it.
    fn shared_area_mm2(&self, sets: &[SampleSet], at: usize) -> f64 {
        let is_shared = |sample: &SampleId| sets[..at].iter().any(|other| other.holds(*sample));
        sets[at].iter().filter(is_shared).map(|sample| self.surface.sample_area_mm2(sample)).sum()
    }

    /// Returns true if setups are joined, each directly or through others; one without views need not be.
    fn join(&self, sets: &[SampleSet]) -> bool {
        let (known, others) = sets.split_at(self.joined);
        let mut reached: Vec<&SampleSet> = known.iter().collect();
        let mut rest: Vec<&SampleSet> = others.iter().filter(|set| set.count() > 0).collect();
        if reached.is_empty() && !rest.is_empty() {
            reached.push(rest.swap_remove(0));
        }
        let is_reached =
            |set: &SampleSet, reached: &[&SampleSet]| reached.iter().any(|other| self.between(set, other) >= MIN_RESISTANCE);
        while let Some(next) = rest.iter().position(|set| is_reached(set, &reached)) {
            reached.push(rest.swap_remove(next));
        }
        rest.is_empty()
    }
}
