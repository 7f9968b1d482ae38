//! A lower bound of the shortest tour, for tours too long to be proved shortest: the ng-route relaxation.
//!
//! A route from home with one stop for each group is cheaper than a tour: it may stop at a group twice and pass over another.
//! The shortest route is found by dynamic programming over the number of stops (state-space relaxation: N. Christofides,
//! A. Mingozzi and P. Toth, Networks 11, 1981). Each group has an ng-set, the groups that it remembers; a route may not return
//! to a group that is still remembered (R. Baldacci, A. Mingozzi and R. Roberti, "New route relaxation and pricing strategies
//! for the vehicle routing problem", Operations Research 59(5), 2011):
//!
//! ```text
//! label (k, v, Π)   least time of a route from home with k stops that ends at node v with memory Π
//! extension         v in group i → u in group j, allowed where j ∉ Π:  Π' = (Π ∪ {i}) ∩ N_j
//! bound             LB(λ) = min over routes of n stops of (Σ times + Σ λ at each stop) − Σ λ_i
//! ```
//!
//! N_j: ng-set of group j; λ_i: multiplier of group i, s, any real number; n: number of groups. Multipliers are improved by
//! subgradient steps with Polyak's length (M. Held and R. Karp, Mathematical Programming 1, 1971). Where they raise the bound
//! no more, ng-sets grow by the cycles of the best routes (dynamic ng-route: R. Roberti and A. Mingozzi, Transportation
//! Science 48(3), 2014). Some groups far from each other are critical (G. Righini and M. Salani, Networks 51(3), 2008):
//! all groups remember them, and every route stops at each; without them a route stays among a few groups near each other.
//!
//! Routes are looked for below a target between the bound and the known tour. Arcs that no route below it uses are eliminated,
//! nine of ten soon, which makes room for larger ng-sets. Where no route is left, no tour is shorter than the target, and the
//! target rises. Any multipliers, ng-sets and targets give a valid bound. A route without a cycle is the shortest tour.

mod critical;
mod lanes;
mod ng_routes;
mod ng_sets;

use std::ops::Range;

use rayon::prelude::*;

use self::lanes::LANES;
use self::ng_routes::{NgRoute, Relaxation, Terms};
use self::ng_sets::NgSets;
use super::{Costs, Effort};
use crate::planning::context::{Cancelled, Context};

/// Size of each ng-set at first: the nearest groups.
const INITIAL_NG_SIZE: usize = 3;
/// Largest size of an ng-set, critical groups among them.
const MAX_NG_SIZE: usize = 12;
/// Labels of half routes beyond which ng-sets grow no more: a hundred megabytes' worth.
const MAX_LABELS: usize = 1 << 20;
/// Critical groups before there is a target.
const INITIAL_CRITICAL: usize = 4;
/// Critical groups found at a time before there is a target; one at a time then.
const CRITICAL_PER_ROUND: usize = 2;
/// Largest number of critical groups.
const MAX_CRITICAL: usize = 6;
/// Groups for each that may be critical.
const GROUPS_PER_CRITICAL: usize = 3;
/// Recent routes from which critical groups are found.
const RECENT_ROUTES: usize = 12;
/// Additions of [`LANES`] times each in all rounds together, for each group.
const WORK_PER_GROUP: usize = 17_000_000;
/// Largest number of additions: about a second's worth on two cores with 512-bit vectors. A count, not a time, for the bound
/// has to be the same on every machine.
const MAX_WORK: usize = 1_000_000_000;
/// Share of the work that is spent on a bound that is told beside a better known one: one part in this many.
const BRIEF: usize = 4;
/// Rounds without gain after which steps become shorter, before all critical groups are found.
const EARLY_PATIENCE: u32 = 3;
/// Rounds without gain after which steps become shorter.
const PATIENCE: u32 = 2;
/// Factor by which steps become shorter.
const STEP_DECAY: f64 = 0.7;
/// Share of the full step below which ng-sets grow, before all critical groups are found.
const EARLY_GROWTH_THRESHOLD: f64 = 0.6;
/// Share of the full step below which ng-sets grow.
const GROWTH_THRESHOLD: f64 = 0.3;
/// Share of the full step after ng-sets have grown.
const RESTART_STEP: f64 = 0.4;
/// Share of the full step below which steps change nothing.
const MIN_STEP: f64 = 1e-3;
/// Share of the last direction that a step keeps.
const MOMENTUM: f64 = 0.3;
/// Value that Polyak's step aims at, as a multiple of the bound.
const POLYAK_AIM: f64 = 1.05;
/// Share to which the gap to the target has to shrink until arcs are eliminated again.
const RETRY_GAP: f64 = 0.8;
/// Place of the target between the bound and the tour.
const TARGET_SHARE: f64 = 0.55;
/// Smallest gap, as a share of the tour, that is worth a target of its own.
const MIN_TARGET_GAP: f64 = 0.003;
/// Separation, as a share of the tour, that counts as closed.
const CLOSED_GAP: f64 = 1e-6;

/// A lower bound of the shortest tour; `tour_secs` is the time of one that is known.
pub(super) fn lower_bound_secs(
    groups: &[Range<usize>],
    costs: &Costs,
    tour_secs: f64,
    effort: Effort,
    ctx: &Context<'_>,
) -> Result<f64, Cancelled> {
    let entered_secs = entered_secs(groups, costs).min(tour_secs);
    let chunks = chunks(groups);
    let max_work = MAX_WORK.min(WORK_PER_GROUP * groups.len()) / if effort == Effort::Brief { BRIEF } else { 1 };
    if is_too_long(groups.len(), chunks, max_work) {
        return Ok(entered_secs);
    }
    let mut below_tour = Relaxation::new(groups, costs, chunks, ctx.simd_level());
    let mut below_target = below_tour.clone();
    let mut ascent = Ascent::new(&below_target, tour_secs);
    let mut work = 0;
    loop {
        ctx.check()?;
        let route = below_target.shortest_route(&ascent.terms(&ascent.multipliers));
        work += route.work;
        let next = ascent.next(&route);
        if next == Next::Done || work + route.work > max_work {
            return Ok(ascent.bound_secs.clamp(entered_secs, tour_secs));
        }
        let starts_over = matches!(next, Next::FindCritical | Next::SetTarget);
        if starts_over {
            work += below_tour.eliminate_arcs(&Terms { limit_secs: tour_secs, ..ascent.terms(&ascent.best.multipliers) });
        }
        if starts_over || next == Next::RaiseTarget {
            below_target.clone_from(&below_tour);
        }
        if ascent.is_worth_eliminating(next) {
            work += below_target.eliminate_arcs(&ascent.terms(&ascent.best.multipliers));
        }
        if !matches!(next, Next::Step | Next::RaiseTarget) {
            ascent.grow_ng_sets(groups, costs, &route.groups);
        }
    }
}

/// Bytes that the bound of a tour through up to so many groups of so many nodes each holds at most.
pub(super) fn expected_bytes(max_groups: usize, nodes_of_group: usize) -> f64 {
    let chunks = nodes_of_group.div_ceil(LANES).next_power_of_two();
    let longest = (0..=max_groups).rev().find(|groups| !is_too_long(*groups, chunks, MAX_WORK));
    let Some(groups) = longest else { return 0.0 };
    // Times to the nodes of a group, with the number of the node before or the memory of the groups before.
    let row = LANES * size_of::<f32>() + size_of::<u16>();
    // Arcs stand twice: those below the tour and those below the target.
    let (arcs, labels) = (2 * groups * groups * nodes_of_group, MAX_LABELS);
    ((arcs + labels) * chunks * row) as f64
}

/// Returns true for a tour of which no more than the simple bound is computed.
fn is_too_long(groups: usize, chunks: usize, max_work: usize) -> bool {
    chunks > lanes::MAX_CHUNKS || groups.pow(3).saturating_mul(4 * LANES * chunks) > max_work
}

/// Nodes of the largest group in [`LANES`].
fn chunks(groups: &[Range<usize>]) -> usize {
    groups.iter().map(Range::len).max().unwrap_or(0).div_ceil(LANES).next_power_of_two()
}

/// A simple lower bound: the least arc into each group and home. For tours too long for anything better.
pub(super) fn entered_secs(groups: &[Range<usize>], costs: &Costs) -> f64 {
    let home = costs.nodes..costs.nodes + 1;
    let min_into = |group: &Range<usize>| {
        let into = group.clone().flat_map(|node| {
            let row = costs.row(node).iter().enumerate();
            row.filter(|(from, _)| !group.contains(from)).map(|(_, secs)| *secs)
        });
        into.fold(f64::INFINITY, f64::min)
    };
    groups.par_iter().chain([&home]).map(min_into).collect::<Vec<_>>().into_iter().sum()
}

/// The next action of the ascent after a route.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Next {
    /// Evaluate the new multipliers.
    Step,
    /// Find critical groups, before there is a target.
    FindCritical,
    /// Eliminate arcs for the first target, and grow ng-sets.
    SetTarget,
    /// Grow ng-sets.
    Grow,
    /// Restore the arcs that were eliminated for the last target, which was too low.
    RaiseTarget,
    /// End.
    Done,
}

/// The best bound with the ng-sets as they are.
struct BestDual {
    secs: f64,
    multipliers: Vec<f64>,
    /// Groups of its route in order; empty before the first.
    route: Vec<usize>,
}

/// Subgradient ascent over multipliers, with ng-sets and target.
struct Ascent {
    tour_secs: f64,
    target_secs: f64,
    /// The best bound of all.
    bound_secs: f64,
    multipliers: Vec<f64>,
    direction: Vec<f64>,
    /// Best multipliers before arc elimination for a target.
    multipliers_before_elimination: Vec<f64>,
    /// ng-sets before they grew by cycles: completion bounds are computed with them.
    initial_sets: NgSets,
    ng_sets: NgSets,
    ng_size: usize,
    best: BestDual,
    /// Share of the full step.
    step_share: f64,
    rounds_without_gain: u32,
    /// Is true once a target below the tour was set.
    has_target: bool,
    /// Separation between bound and target when arcs were eliminated last.
    gap_at_elimination_secs: f64,
    /// Nodes of the recent routes, the last first.
    recent_routes: Vec<Vec<usize>>,
}

impl Ascent {
    fn new(relaxation: &Relaxation<'_>, tour_secs: f64) -> Self {
        let multipliers = vec![0.0; relaxation.groups.len()];
        let initial_sets = NgSets::new(Vec::new(), relaxation.nearest(INITIAL_NG_SIZE));
        Self {
            tour_secs,
            target_secs: tour_secs,
            bound_secs: 0.0,
            direction: multipliers.clone(),
            multipliers_before_elimination: multipliers.clone(),
            ng_sets: initial_sets.clone(),
            initial_sets,
            ng_size: INITIAL_NG_SIZE,
            best: BestDual { secs: 0.0, multipliers: multipliers.clone(), route: Vec::new() },
            multipliers,
            step_share: 1.0,
            rounds_without_gain: 0,
            has_target: false,
            gap_at_elimination_secs: f64::INFINITY,
            recent_routes: Vec::new(),
        }
    }

    fn terms<'a>(&'a self, multipliers: &'a [f64]) -> Terms<'a> {
        Terms {
            initial_sets: &self.initial_sets,
            ng_sets: &self.ng_sets,
            multipliers,
            limit_secs: self.target_secs,
            uses_completion_bounds: self.has_target,
        }
    }

    /// Is true while critical groups are yet to be found, before there is a target or now.
    fn lacks_critical(&self) -> bool {
        let max = if self.has_target { MAX_CRITICAL } else { INITIAL_CRITICAL };
        self.initial_sets.critical.len() < max.min(self.multipliers.len() / GROUPS_PER_CRITICAL)
    }

    /// Takes a route into account.
    fn next(&mut self, route: &NgRoute) -> Next {
        self.bound_secs = self.bound_secs.max(route.secs.min(self.target_secs));
        if self.bound_secs >= (1.0 - CLOSED_GAP) * self.tour_secs {
            return Next::Done;
        }
        if route.secs >= self.target_secs {
            self.raise_target();
            return Next::RaiseTarget;
        }
        let mut subgradient = vec![-1.0; self.multipliers.len()];
        route.groups.iter().for_each(|group| subgradient[*group] += 1.0);
        if subgradient.iter().all(|stops| *stops == 0.0) {
            return Next::Done;
        }
        self.recent_routes.truncate(RECENT_ROUTES - 1);
        self.recent_routes.insert(0, route.nodes.clone());
        if route.secs > self.best.secs || self.best.route.is_empty() {
            self.best = BestDual { secs: route.secs, multipliers: self.multipliers.clone(), route: route.groups.clone() };
            self.rounds_without_gain = 0;
        } else {
            self.rounds_without_gain += 1;
        }
        let is_early = !self.has_target && self.lacks_critical();
        let (patience, threshold) =
            if is_early { (EARLY_PATIENCE, EARLY_GROWTH_THRESHOLD) } else { (PATIENCE, GROWTH_THRESHOLD) };
        if self.rounds_without_gain == patience {
            (self.step_share, self.rounds_without_gain) = (STEP_DECAY * self.step_share, 0);
            self.multipliers.clone_from(&self.best.multipliers);
            self.direction.fill(0.0);
            let can_grow = || self.lacks_critical() || self.grown_ng_sets(&route.groups).is_some();
            if self.step_share < threshold && route.labels < MAX_LABELS && can_grow() {
                return self.after_ascent(is_early);
            }
            if self.step_share < MIN_STEP {
                return Next::Done;
            }
        }
        self.step(&subgradient, route.secs);
        Next::Step
    }

    /// The next action where multipliers raise the bound no more.
    fn after_ascent(&mut self, is_early: bool) -> Next {
        match (is_early, self.has_target) {
            (true, _) => Next::FindCritical,
            (_, true) => Next::Grow,
            _ => {
                self.multipliers_before_elimination.clone_from(&self.multipliers);
                self.set_target();
                Next::SetTarget
            }
        }
    }

    /// Moves multipliers along the subgradient: up on groups with more than one stop, down on those with none.
    fn step(&mut self, subgradient: &[f64], route_secs: f64) {
        let averaged = |(along, stops): (&mut f64, &f64)| *along = MOMENTUM * *along + (1.0 - MOMENTUM) * stops;
        self.direction.iter_mut().zip(subgradient).for_each(averaged);
        let length: f64 = self.direction.iter().map(|along| along * along).sum();
        let aim_secs = self.tour_secs.min(POLYAK_AIM * self.bound_secs).max(route_secs);
        if length > 0.0 {
            let step = self.step_share * (aim_secs - route_secs) / length;
            self.multipliers.iter_mut().zip(&self.direction).for_each(|(multiplier, along)| *multiplier += step * along);
        }
    }

    /// Decides on arc elimination for the target: worth it where more arcs may go than before.
    fn is_worth_eliminating(&mut self, next: Next) -> bool {
        let gap_secs = self.target_secs - self.best.secs;
        let is_worth = match next {
            Next::Step | Next::FindCritical | Next::Done => false,
            Next::SetTarget | Next::RaiseTarget => self.target_secs < self.tour_secs,
            Next::Grow => gap_secs < RETRY_GAP * self.gap_at_elimination_secs,
        };
        if is_worth {
            self.gap_at_elimination_secs = gap_secs;
        }
        is_worth
    }

    /// Sets the target anew.
    fn set_target(&mut self) {
        self.has_target = true;
        let target_secs = self.bound_secs + TARGET_SHARE * (self.tour_secs - self.bound_secs);
        self.target_secs = if target_secs < (1.0 - MIN_TARGET_GAP) * self.tour_secs { target_secs } else { self.tour_secs };
    }

    /// Sets a higher target, and the multipliers from before arcs were eliminated: those since may suit the remaining arcs
    /// alone.
    fn raise_target(&mut self) {
        self.set_target();
        self.multipliers.clone_from(&self.multipliers_before_elimination);
        self.best.multipliers.clone_from(&self.multipliers_before_elimination);
        self.restart();
        self.best.secs = self.bound_secs;
    }

    /// Restarts the ascent from the multipliers that it has.
    fn restart(&mut self) {
        (self.step_share, self.rounds_without_gain, self.best.secs) = (RESTART_STEP, 0, 0.0);
        self.best.route.clear();
        self.direction.fill(0.0);
    }

    /// Makes more groups critical, or grows ng-sets by the cycles of the best route and the last.
    fn grow_ng_sets(&mut self, groups: &[Range<usize>], costs: &Costs, last: &[usize]) {
        if self.lacks_critical() {
            let count = if self.has_target { 1 } else { CRITICAL_PER_ROUND };
            let routes = std::mem::take(&mut self.recent_routes);
            let more = critical::far_from(routes, &self.initial_sets.critical, count, groups, costs);
            self.initial_sets = self.initial_sets.with_critical(&more);
            self.ng_sets = self.ng_sets.with_critical(&more);
            self.ng_size += more.len();
        } else if let Some(lists) = self.grown_ng_sets(last) {
            self.ng_size = (self.ng_size + 1).min(MAX_NG_SIZE);
            self.ng_sets = NgSets::new(self.initial_sets.critical.clone(), lists);
        }
        self.restart();
    }

    /// The ng-sets with the cycles of the best route and the last forbidden; `None` where they forbid them already.
    fn grown_ng_sets(&self, last: &[usize]) -> Option<Vec<Vec<usize>>> {
        let max = (self.ng_size + 1).min(MAX_NG_SIZE);
        let mut lists = self.ng_sets.lists.clone();
        let mut grew = false;
        for route in [&self.best.route[..], last] {
            for (at, group) in route.iter().enumerate() {
                let Some(back) = route[at + 1..].iter().position(|other| other == group) else { continue };
                for between in &route[at + 1..at + 1 + back] {
                    if lists[*between].len() < max && !lists[*between].contains(group) {
                        lists[*between].push(*group);
                        grew = true;
                    }
                }
            }
        }
        grew.then_some(lists)
    }
}
