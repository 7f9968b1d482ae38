//! A trial of one more setup: views chosen there on some of the samples, joined to the other setups by surface that they share, and
//! ordered.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::turn_over::UnmetRegion;
use super::{Basis, Wanted, choose, within};
use crate::cell::Configuration;
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SampleId, SetupId, ViewId};
use crate::planning::params::PlanParams;
use crate::planning::plan::{Outcome, SetupPlan};
use crate::planning::problem::{EvaluatedCandidates, TriedSetup};
use crate::planning::registration::{SharedSurface, shared, union_of};
use crate::planning::scene::PlanningScene;
use crate::planning::stations::Station;
use crate::planning::surface::Surface;
use crate::planning::verdict::MIN_RESISTANCE;
use crate::planning::visibility::{Occluders, Row, SampleSet, UnitedViews};

/// Views that are added at most for what is missed.
const MAX_ADDED: usize = 60;
/// Views that are added at most to register the setup to the others.
const MAX_JOINING: usize = 12;

/// Views in a further setup.
pub(super) struct Trial<'a> {
    /// The plan on the samples of the setup's surface.
    basis: &'a Basis,
    setup: &'a TriedSetup<'a>,
    poses: Vec<Pose<Part, ScannerFrame>>,
    rows: Vec<&'a Row>,
    stations: Vec<&'a [Station]>,
    /// Places of the views that were chosen.
    chosen: Vec<usize>,
    /// Table angle at which each of them is taken once they are ordered; none without a cell.
    table_rad: BTreeMap<usize, f64>,
}

impl<'a> Trial<'a> {
    /// No view is chosen yet of `candidates`, which the cell can all take.
    pub(super) fn new(basis: &'a Basis, setup: &'a TriedSetup<'a>, candidates: &'a EvaluatedCandidates) -> Self {
        let stations = |candidate: CandidateIndex| match &candidates.reach {
            Some(reach) => reach[candidate.index()].as_deref().unwrap_or_default(),
            None => &[],
        };
        Self {
            basis,
            setup,
            poses: candidates.candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect(),
            rows: candidates.matrix.rows.iter().collect(),
            stations: candidates.candidates.indices().map(stations).collect(),
            chosen: Vec::new(),
            table_rad: BTreeMap::new(),
        }
    }

    pub(super) fn occluders(&self) -> &'a Occluders {
        self.setup.occluders
    }

    pub(super) fn is_empty(&self) -> bool {
        self.chosen.is_empty()
    }

    /// Number of views that were chosen.
    pub(super) fn chosen_views(&self) -> usize {
        self.chosen.len()
    }

    fn rows_of(&self, places: &[usize]) -> SampleSet {
        union_of(places.iter().map(|place| self.rows[*place]), self.basis.asked_area_mm2.len())
    }

    /// Samples that the plan's views and those chosen here measure.
    fn measured(&self) -> SampleSet {
        let mut measured = self.basis.measured.clone();
        measured.insert_all(&self.rows_of(&self.chosen));
        measured
    }

    /// Chooses views until the target is met, then for each region that misses its own.
    pub(super) fn choose(&mut self, params: &PlanParams, regions: &[UnmetRegion], ctx: &Context<'_>) -> Result<(), Cancelled> {
        let basis = self.basis;
        let mut coverable = basis.coverable.clone();
        self.rows.iter().for_each(|row| coverable.insert_all(row.measured()));
        let enough_mm2 = params.selection.target * basis.whole_mm2(&coverable, params.selection.target_of);
        let open_mm2 = basis.open_area_mm2();
        let wanted = Wanted {
            open_mm2: &open_mm2,
            needed_mm2: enough_mm2 - basis.measured_mm2(),
            min_gain_mm2: params.selection.min_growth * basis.asked_mm2(),
            max_views: MAX_ADDED,
        };
        self.chosen = choose(&self.rows, &wanted, &params.score, ctx)?;
        for region in regions {
            let measured = self.measured();
            let mut open_mm2 = region.area_mm2.clone();
            measured.iter().for_each(|sample| open_mm2[sample.index()] = 0.0);
            let needed_mm2 = region.needed_mm2 - region.measured_mm2(&measured);
            let max_views = MAX_ADDED.saturating_sub(self.chosen.len());
            let wanted = Wanted { open_mm2: &open_mm2, needed_mm2, min_gain_mm2: 0.0, max_views };
            let more = choose(&self.rows, &wanted, &params.score, ctx)?;
            self.chosen.extend(more);
        }
        Ok(())
    }

    /// Adds views until the setup shares surface with another that fixes all freedoms, as [`crate::planning::adjust`] does between
    /// the setups of a plan. Returns false where none would; true where nothing has to be joined.
    pub(super) fn join(&mut self, links: Option<&SetupsLink<'_>>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
        let Some(links) = links else { return Ok(true) };
        for _ in 0..MAX_JOINING {
            let own = self.rows_of(&self.chosen);
            let now = links.resistance(&own);
            if now >= MIN_RESISTANCE {
                return Ok(true);
            }
            let free: Vec<usize> = (0..self.rows.len()).filter(|place| !self.chosen.contains(place)).collect();
            let with = |place: &usize| {
                ctx.check()?;
                let mut with = own.clone();
                with.insert_all(self.rows[*place].measured());
                Ok((*place, links.resistance(&with), links.shared_area_mm2(&with)))
            };
            let tried = free.par_iter().map(with).collect::<Result<Vec<_>, Cancelled>>()?;
            let stiffest = tried.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a }).filter(|best| best.1 > now + 1e-6);
            let widest = tried.iter().copied().reduce(|a, b| if b.2 > a.2 { b } else { a });
            let Some((place, ..)) = stiffest.or(widest) else { return Ok(false) };
            self.chosen.push(place);
        }
        Ok(self.is_joined(links))
    }

    /// Returns true if the setup shares surface with another that fixes all freedoms.
    pub(super) fn is_joined(&self, links: &SetupsLink<'_>) -> bool {
        links.resistance(&self.rows_of(&self.chosen)) >= MIN_RESISTANCE
    }

    /// Orders the views that were chosen, and drops those without a path. Returns the time of their moves, 0 without a cell.
    pub(super) fn order(&mut self, ctx: &Context<'_>) -> Result<f64, Cancelled> {
        let Some(scene) = self.setup.scene else { return Ok(0.0) };
        let views: Vec<(ViewId, &[Station])> = ViewId::number(self.chosen.iter().map(|place| self.stations[*place])).collect();
        let in_sight = |view: ViewId, station: &Configuration| {
            let place = self.chosen[view.index()];
            scene.is_in_sight(self.setup.surface, &self.poses[place], self.rows[place], station.table_rad, ctx)
        };
        let ordered = scene.order(&views, false, &in_sight, ctx)?;
        let visits = ordered.sequence.visits.iter();
        self.table_rad = visits.map(|(view, leg)| (self.chosen[view.index()], leg.target.table_angle_rad)).collect();
        let chosen = ViewId::number(std::mem::take(&mut self.chosen));
        self.chosen = chosen.filter(|(view, _)| !ordered.no_path.contains(view)).map(|(_, place)| place).collect();
        Ok(ordered.sequence.motion_secs())
    }

    /// Samples of a surface that the chosen views measure, past the obstacles of the cell.
    pub(super) fn measured_by_chosen(
        &self,
        together: &UnitedViews<'_>,
        surface: &Surface,
        ctx: &Context<'_>,
    ) -> Result<SampleSet, Cancelled> {
        let mut measured = together.nothing();
        for place in &self.chosen {
            ctx.check()?;
            let (pose, table_rad) = (&self.poses[*place], self.table_rad.get(place));
            let row = together.shared_row(pose, &measured)?;
            let sight = self.setup.scene.map(PlanningScene::sight).zip(table_rad);
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
        if self.setup.scene.is_some_and(|scene| !scene.sight().has_no_obstacles()) {
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

/// Link of a further setup to those of a plan.
pub(super) struct SetupsLink<'a> {
    surface: &'a Surface,
    part: SharedSurface<'a>,
    /// Samples that the views of each setup measure.
    measured: Vec<SampleSet>,
}

impl<'a> SetupsLink<'a> {
    /// Links to the setups of a plan, by `surface`, which has some of its samples.
    pub(super) fn to_setups(outcome: &Outcome, surface: &'a Surface, some: &[(SampleId, f64)]) -> Self {
        let samples = outcome.surface.sample_mm.len();
        let measured = |(id, _): (SetupId, &SetupPlan)| {
            let views = outcome.plan.views.iter().zip(&outcome.measured_by_view);
            within(&union_of(views.filter(|(view, _)| view.setup == id).map(|(_, row)| row), samples), some)
        };
        let measured = SetupId::number(&outcome.plan.setups).map(measured).collect();
        Self { surface, part: SharedSurface::new(surface), measured }
    }

    /// Resistance of the strongest link of a setup whose views measure these samples.
    fn resistance(&self, own: &SampleSet) -> f64 {
        let links = self.measured.iter().map(|other| self.part.stability(&shared(own, other)));
        links.map(|stability| stability.resistance).fold(0.0, f64::max)
    }

    /// Area that it shares with any of the others.
    fn shared_area_mm2(&self, own: &SampleSet) -> f64 {
        let is_shared = |sample: &SampleId| self.measured.iter().any(|other| other.holds(*sample));
        own.iter().filter(is_shared).map(|sample| self.surface.sample_area_mm2(sample)).sum()
    }
}
