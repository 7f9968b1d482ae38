//! Choice of further views by what they are expected to add, where a scanner does not return all that it sees. With p_ij the rate at
//! which view i returns sample j and S_j its area, a set V is expected to measure Σ S_j (1 − Π_{i ∈ V} (1 − p_ij)). That grows by less and
//! less, so that greedy reaches 1 − 1/e of the best of as many views (Nemhauser, Wolsey and Fisher 1978), and a gain that was computed
//! earlier bounds a later one from above (Minoux 1978). Each view is then held against all others once more.
//!
//! Cost: each pair of candidate and open sample once, and a few candidates again for each view.

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};
use std::sync::Arc;

use super::{ChosenViews, ViewPlanningProblem};
use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, RowIndex};
use crate::planning::plan::{Bound, StopReason};
use crate::planning::scene::demand::{Demand, DemandStop};
use crate::planning::selection::{Choice, OpenBound, OpenSelection};
use crate::planning::visibility::Optics;

/// Rounds in which views are held against all others.
const EXCHANGES: usize = 2;
/// Share of its gain by which another view has to be better, so that sums in another order exchange nothing.
const MIN_IMPROVEMENT: f64 = 1e-9;

/// Views chosen by expectation.
pub(in crate::planning) struct ExpectedViews {
    pub(in crate::planning) chosen: ChosenViews,
    /// Area that each is expected to add, mm².
    pub(in crate::planning) expected_mm2: Vec<f64>,
    /// Area that all candidates together are expected to add, mm².
    pub(in crate::planning) left_mm2: f64,
    pub(in crate::planning) stopped_because: DemandStop,
}

/// A candidate with an upper bound of what it adds.
struct Bounded {
    gain_mm2: f64,
    candidate: CandidateIndex,
}

impl PartialEq for Bounded {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Bounded {}

impl PartialOrd for Bounded {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Bounded {
    /// The largest gain is the greatest, of equal ones the lowest candidate.
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain_mm2.total_cmp(&other.gain_mm2).then_with(|| other.candidate.index().cmp(&self.candidate.index()))
    }
}

/// Rates of candidates at open samples.
struct Rates<'a> {
    problem: &'a ViewPlanningProblem<'a>,
    demand: &'a Demand<'a>,
    optics: Optics,
}

impl Rates<'_> {
    /// Open samples that a candidate measures, by place, each with its rate.
    fn of(&self, candidate: CandidateIndex) -> impl Iterator<Item = (usize, f64)> {
        let (surface, asked_mm2) = (&self.problem.surface, &self.problem.asked_area_mm2);
        let view = self.optics.at(&self.problem.candidates[candidate].part_from_scanner);
        let open = self.problem.row(candidate).samples().filter(|sample| asked_mm2[sample.index()] > 0.0);
        open.map(move |sample| {
            let line = view.sight_line(&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
            (sample.index(), (self.demand.rate)(&line).clamp(0.0, 1.0))
        })
    }

    /// Area that a candidate is expected to add where samples are open with a chance each.
    fn gain_mm2(&self, candidate: CandidateIndex, open: &[f64]) -> f64 {
        self.of(candidate).map(|(place, rate)| self.problem.asked_area_mm2[place] * open[place] * rate).sum()
    }

    /// Chances that samples stay open after some views.
    fn open_after<'c>(&self, views: impl IntoIterator<Item = &'c CandidateIndex>) -> Vec<f64> {
        let mut open = vec![1.0; self.problem.asked_area_mm2.len()];
        for view in views {
            self.of(*view).for_each(|(place, rate)| open[place] *= 1.0 - rate);
        }
        open
    }

    /// The candidate that adds most, where those in `skip` are left out; `bounds` become those that were computed.
    fn best(&self, bounds: &mut BinaryHeap<Bounded>, open: &[f64], skip: &[CandidateIndex]) -> Option<Bounded> {
        let mut left_out = Vec::new();
        let mut best: Option<Bounded> = None;
        while let Some(top) = bounds.pop() {
            if best.as_ref().is_some_and(|best| top < *best) {
                left_out.push(top);
                break;
            }
            if skip.contains(&top.candidate) {
                left_out.push(top);
                continue;
            }
            let now = Bounded { gain_mm2: self.gain_mm2(top.candidate, open).min(top.gain_mm2), candidate: top.candidate };
            match &mut best {
                Some(best) if now <= *best => left_out.push(now),
                best => left_out.extend(best.replace(now)),
            }
        }
        bounds.extend(left_out);
        best
    }
}

impl ViewPlanningProblem<'_> {
    /// Chooses views by what they are expected to add.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn select_expected(
        &self,
        demand: &Demand<'_>,
        excluded: &BTreeSet<CandidateIndex>,
        ctx: &Context<'_>,
    ) -> Result<ExpectedViews, Cancelled> {
        let rates =
            Rates { problem: self, demand, optics: Optics::new(self.input.scanner, self.params, &self.surface.requirements) };
        let choosable = self.choosable(excluded);
        let nothing_known = vec![1.0; self.asked_area_mm2.len()];
        let first = |candidate: &CandidateIndex| {
            ctx.check()?;
            Ok(Bounded { gain_mm2: rates.gain_mm2(*candidate, &nothing_known), candidate: *candidate })
        };
        let first = parallel::try_map::<_, _, Cancelled>(&choosable, first)?;
        let initial: Vec<(CandidateIndex, f64)> = first.iter().map(|first| (first.candidate, first.gain_mm2)).collect();
        let all_open = rates.open_after(&choosable);
        let left_mm2: f64 = self.asked_area_mm2.iter().zip(&all_open).map(|(mm2, open)| mm2 * (1.0 - open)).sum();
        if left_mm2 < demand.min_left_mm2 {
            return Ok(self.expected(&rates, Vec::new(), left_mm2, DemandStop::LittleLeft));
        }
        let (mut views, mut open, mut bounds) = (Vec::new(), nothing_known, BinaryHeap::from(first));
        let mut sum_mm2 = 0.0;
        let stop = loop {
            ctx.check()?;
            if sum_mm2 >= demand.needed_mm2 {
                break DemandStop::Target;
            }
            if views.len() >= demand.max_views {
                break DemandStop::MaxViews;
            }
            let best =
                rates.best(&mut bounds, &open, &views).filter(|best| best.gain_mm2 >= demand.min_gain_mm2.max(f64::MIN_POSITIVE));
            let Some(best) = best else { break DemandStop::MinGain };
            sum_mm2 += best.gain_mm2;
            rates.of(best.candidate).for_each(|(place, rate)| open[place] *= 1.0 - rate);
            views.push(best.candidate);
        };
        exchange(&rates, &mut views, &initial, ctx)?;
        Ok(self.expected(&rates, views, left_mm2, stop))
    }

    fn expected(&self, rates: &Rates<'_>, views: Vec<CandidateIndex>, left_mm2: f64, stop: DemandStop) -> ExpectedViews {
        let mut open = vec![1.0; self.asked_area_mm2.len()];
        let mut expected_mm2 = Vec::with_capacity(views.len());
        for view in &views {
            expected_mm2.push(rates.gain_mm2(*view, &open));
            rates.of(*view).for_each(|(place, rate)| open[place] *= 1.0 - rate);
        }
        let choice = |(row, gain_mm2): (usize, &f64)| Choice { row: RowIndex::at(row), gain_mm2: *gain_mm2, score: *gain_mm2 };
        let choices = expected_mm2.iter().enumerate().map(choice).collect();
        let stopped_because = match stop {
            DemandStop::Target => StopReason::Target,
            DemandStop::MaxViews => StopReason::MaxViews,
            DemandStop::MinGain => StopReason::Growth,
            DemandStop::LittleLeft => StopReason::NoGain,
        };
        let bound = Arc::new(OpenBound::Known(Bound::default()));
        let selection = OpenSelection { choices, stopped_because, bound, before_raise: None };
        ExpectedViews { chosen: ChosenViews { candidates: views, selection }, expected_mm2, left_mm2, stopped_because: stop }
    }
}

/// Exchanges views for others that add more to the rest.
fn exchange(
    rates: &Rates<'_>,
    views: &mut [CandidateIndex],
    initial: &[(CandidateIndex, f64)],
    ctx: &Context<'_>,
) -> Result<(), Cancelled> {
    for _ in 0..EXCHANGES {
        let mut is_settled = true;
        for place in 0..views.len() {
            ctx.check()?;
            let others: Vec<CandidateIndex> =
                views.iter().enumerate().filter(|(at, _)| *at != place).map(|(_, view)| *view).collect();
            let open = rates.open_after(&others);
            let own_mm2 = rates.gain_mm2(views[place], &open);
            let bounded = |(candidate, gain_mm2): &(CandidateIndex, f64)| Bounded { gain_mm2: *gain_mm2, candidate: *candidate };
            let mut bounds: BinaryHeap<Bounded> = initial.iter().map(bounded).collect();
            let Some(best) = rates.best(&mut bounds, &open, &others) else { continue };
            if best.gain_mm2 > own_mm2 * (1.0 + MIN_IMPROVEMENT) {
                (views[place], is_settled) = (best.candidate, false);
            }
        }
        if is_settled {
            break;
        }
    }
    Ok(())
}
