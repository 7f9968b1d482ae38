//! A time that no tour can be shorter than, for tours too long to be proved shortest.
//!
//! Walks from home with one stop for each group are cheaper than tours: they may stop at a group twice and pass over another.
//! The shortest is found by dynamic programming over the number of stops (N. Christofides, A. Mingozzi and P. Toth,
//! "State-space relaxation procedures for the computation of bounds to routing problems", Networks 11, 1981), each group
//! remembering some of those that the walk came by, to which it may not go on (R. Baldacci, A. Mingozzi and R. Roberti, "New
//! route relaxation and pricing strategies for the vehicle routing problem", Operations Research 59(5), 2011). Some groups far
//! from each other, [`landmarks`], are remembered everywhere, and walks stop at each: without them a walk stays among a few
//! groups near each other, and many such walks together look like a tour. A toll on groups that it stops at too often, and a
//! reward for those that it passes over, raise it towards the tour (M. Held and R. Karp's multipliers, by subgradient); where
//! tolls raise it no more, what groups remember grows by what the walk came back to (R. Roberti and A. Mingozzi, "Dynamic
//! ng-path relaxation for the delivery man problem", Transportation Science 48(3), 2014).
//!
//! Walks are looked for below a target between the bound and the known tour. Steps that no walk below it takes are left out
//! for good, nine of ten soon, which makes room for more memory. Where no walk is left, no tour is shorter than the target, and
//! the target rises. Any tolls, memories and targets give a valid bound. A walk without a group twice is the shortest tour.

mod landmarks;
mod lanes;
mod memories;
mod walks;

use std::ops::Range;

use rayon::prelude::*;

use self::lanes::LANES;
use self::memories::Memories;
use self::walks::{Relaxation, Terms, Walk};
use super::Costs;
use crate::planning::context::{Cancelled, Context};

/// Groups that each remembers at first, the nearest, …
const REMEMBERED: usize = 3;
/// … and at most, landmarks among them.
const MOST_REMEMBERED: usize = 12;
/// Ends of half walks beyond which memories grow no more: a hundred megabytes' worth.
const MOST_LABELS: usize = 1 << 20;
/// Groups that all remember before there is a target, …
const LANDMARKS: usize = 4;
/// … found so many at a time, …
const LANDMARKS_AT_ONCE: usize = 2;
/// … at most, one at a time, …
const MOST_LANDMARKS: usize = 6;
/// … of so many one, …
const GROUPS_PER_LANDMARK: usize = 3;
/// … from so many of the last walks.
const WALKS_KEPT: usize = 12;
/// Additions of [`LANES`] times each in all rounds together: so many a group, …
const WORK_A_GROUP: usize = 17_000_000;
/// … and at most, about a second's worth on two cores with 512-bit vectors. A count, not a time, for the bound has to be the
/// same on every machine.
const MOST_WORK: usize = 1_000_000_000;
/// Rounds without gain after which steps become shorter before all landmarks are found, …
const PATIENCE_AT_FIRST: u32 = 3;
/// … and then, …
const PATIENCE: u32 = 2;
/// … and by how much.
const SHORTER: f64 = 0.7;
/// Share of the full step below which memories grow before all landmarks are found, …
const GROW_AT_FIRST: f64 = 0.6;
/// … and then, …
const GROW: f64 = 0.3;
/// … and with which it goes on.
const AGAIN: f64 = 0.4;
/// Steps this short change nothing.
const STILL: f64 = 1e-3;
/// Share of the last direction that a step keeps.
const KEPT: f64 = 0.3;
/// How far above the bound a step aims.
const AIM: f64 = 1.05;
/// How much nearer the bound has to come to the target until it is looked for steps to leave out again.
const NEARER: f64 = 0.8;
/// Where between the bound and the tour the target is.
const TARGET: f64 = 0.55;
/// A gap smaller than this share of the tour is worth no target of its own, …
const NEAR: f64 = 0.003;
/// … and one smaller than this is closed.
const CLOSED: f64 = 1e-6;

/// A lower bound of the shortest tour; `tour_secs` is the time of one that is known.
pub(super) fn at_least(groups: &[Range<usize>], costs: &Costs, tour_secs: f64, ctx: &Context<'_>) -> Result<f64, Cancelled> {
    let entered_secs = entered_secs(groups, costs).min(tour_secs);
    let chunks = chunks(groups);
    let most_work = MOST_WORK.min(WORK_A_GROUP * groups.len());
    if chunks > lanes::MOST_CHUNKS || groups.len().pow(3).saturating_mul(4 * LANES * chunks) > most_work {
        return Ok(entered_secs);
    }
    let mut whole = Relaxation::new(groups, costs, chunks, ctx.simd_level());
    let mut relaxation = whole.clone();
    let mut ascent = Ascent::new(&relaxation, tour_secs);
    let mut work = 0;
    loop {
        ctx.check()?;
        let walk = relaxation.shortest_walk(&ascent.terms(&ascent.tolls));
        work += walk.work;
        let next = ascent.next(&walk);
        if next == Next::Done || work + walk.work > most_work {
            return Ok(ascent.best_secs.clamp(entered_secs, tour_secs));
        }
        let is_whole = matches!(next, Next::Landmarks | Next::Aim);
        if is_whole {
            work += whole.thin_out(&Terms { limit_secs: tour_secs, ..ascent.terms(&ascent.highest.1) });
        }
        if is_whole || next == Next::Raise {
            relaxation.clone_from(&whole);
        }
        if ascent.is_worth_thinning(next) {
            work += relaxation.thin_out(&ascent.terms(&ascent.highest.1));
        }
        if !matches!(next, Next::Step | Next::Raise) {
            ascent.grow(groups, costs, &walk.groups);
        }
    }
}

/// Nodes of the largest group in [`LANES`].
fn chunks(groups: &[Range<usize>]) -> usize {
    groups.iter().map(Range::len).max().unwrap_or(0).div_ceil(LANES).next_power_of_two()
}

/// What every tour takes: the least step into each group and home. For tours too long for anything better.
pub(super) fn entered_secs(groups: &[Range<usize>], costs: &Costs) -> f64 {
    let home = costs.nodes..costs.nodes + 1;
    let least_into = |group: &Range<usize>| {
        let into = group.clone().flat_map(|node| {
            let row = costs.row(node).iter().enumerate();
            row.filter(|(from, _)| !group.contains(from)).map(|(_, secs)| *secs)
        });
        into.fold(f64::INFINITY, f64::min)
    };
    groups.par_iter().chain([&home]).map(least_into).collect::<Vec<_>>().into_iter().sum()
}

/// What a walk calls for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Next {
    /// Other tolls, which are there.
    Step,
    /// Landmarks before there is a target, …
    Landmarks,
    /// … memory now that there is one, …
    Aim,
    /// … and more.
    Grow,
    /// Steps that were left out, for the target is further up.
    Raise,
    Done,
}

/// Tolls, memories and target on their way to the best bound.
struct Ascent {
    tour_secs: f64,
    target_secs: f64,
    best_secs: f64,
    tolls: Vec<f64>,
    direction: Vec<f64>,
    /// Those that were best while no steps were left out for a target.
    anchor: Vec<f64>,
    /// Memories before they grew by what walks came back to, and as they are.
    first: Memories,
    memories: Memories,
    most: usize,
    /// Of the memories as they are: the highest bound, and the tolls and the stops of its walk.
    highest: (f64, Vec<f64>, Vec<usize>),
    share: f64,
    waited: u32,
    /// Whether there is a target below the tour, or was.
    has_aimed: bool,
    /// How far below the target the bound was when steps were left out.
    thinned_secs: f64,
    /// The nodes of the last walks, the last first.
    walks: Vec<Vec<usize>>,
}

impl Ascent {
    fn new(relaxation: &Relaxation<'_>, tour_secs: f64) -> Self {
        let tolls = vec![0.0; relaxation.groups.len()];
        let first = Memories::new(Vec::new(), relaxation.nearest(REMEMBERED));
        Self {
            tour_secs,
            target_secs: tour_secs,
            best_secs: 0.0,
            direction: tolls.clone(),
            anchor: tolls.clone(),
            memories: first.clone(),
            first,
            most: REMEMBERED,
            highest: (0.0, tolls.clone(), Vec::new()),
            tolls,
            share: 1.0,
            waited: 0,
            has_aimed: false,
            thinned_secs: f64::INFINITY,
            walks: Vec::new(),
        }
    }

    fn terms<'a>(&'a self, tolls: &'a [f64]) -> Terms<'a> {
        Terms { first: &self.first, memories: &self.memories, tolls, limit_secs: self.target_secs, looks_on: self.has_aimed }
    }

    /// Whether landmarks are yet to be found, before there is a target or now.
    fn lacks_landmarks(&self) -> bool {
        let most = if self.has_aimed { MOST_LANDMARKS } else { LANDMARKS };
        self.first.landmarks.len() < most.min(self.tolls.len() / GROUPS_PER_LANDMARK)
    }

    /// Takes a walk into account.
    fn next(&mut self, walk: &Walk) -> Next {
        self.best_secs = self.best_secs.max(walk.secs.min(self.target_secs));
        if self.best_secs >= (1.0 - CLOSED) * self.tour_secs {
            return Next::Done;
        }
        if walk.secs >= self.target_secs {
            self.raise();
            return Next::Raise;
        }
        let mut too_often = vec![-1.0; self.tolls.len()];
        walk.groups.iter().for_each(|group| too_often[*group] += 1.0);
        if too_often.iter().all(|stops| *stops == 0.0) {
            return Next::Done;
        }
        self.walks.truncate(WALKS_KEPT - 1);
        self.walks.insert(0, walk.nodes.clone());
        if walk.secs > self.highest.0 || self.highest.2.is_empty() {
            (self.highest, self.waited) = ((walk.secs, self.tolls.clone(), walk.groups.clone()), 0);
        } else {
            self.waited += 1;
        }
        let is_early = !self.has_aimed && self.lacks_landmarks();
        let (patience, grow) = if is_early { (PATIENCE_AT_FIRST, GROW_AT_FIRST) } else { (PATIENCE, GROW) };
        if self.waited == patience {
            (self.share, self.waited) = (SHORTER * self.share, 0);
            self.tolls.clone_from(&self.highest.1);
            self.direction.fill(0.0);
            if self.share < grow && walk.labels < MOST_LABELS && (self.lacks_landmarks() || self.grown(&walk.groups).is_some()) {
                return self.more(is_early);
            }
            if self.share < STILL {
                return Next::Done;
            }
        }
        self.step(&too_often, walk.secs);
        Next::Step
    }

    /// What comes where tolls raise the bound no more.
    fn more(&mut self, is_early: bool) -> Next {
        match (is_early, self.has_aimed) {
            (true, _) => Next::Landmarks,
            (_, true) => Next::Grow,
            _ => {
                self.anchor.clone_from(&self.tolls);
                self.aim();
                Next::Aim
            }
        }
    }

    /// Raises tolls on groups that a walk stopped at too often.
    fn step(&mut self, too_often: &[f64], walk_secs: f64) {
        self.direction.iter_mut().zip(too_often).for_each(|(along, stops)| *along = KEPT * *along + (1.0 - KEPT) * stops);
        let length: f64 = self.direction.iter().map(|along| along * along).sum();
        let aim_secs = self.tour_secs.min(AIM * self.best_secs).max(walk_secs);
        if length > 0.0 {
            let step = self.share * (aim_secs - walk_secs) / length;
            self.tolls.iter_mut().zip(&self.direction).for_each(|(toll, along)| *toll += step * along);
        }
    }

    /// Whether steps may be left out for the target that are not for the tour, more than before.
    fn is_worth_thinning(&mut self, next: Next) -> bool {
        let below_secs = self.target_secs - self.highest.0;
        let is_worth = match next {
            Next::Step | Next::Landmarks | Next::Done => false,
            Next::Aim | Next::Raise => self.target_secs < self.tour_secs,
            Next::Grow => below_secs < NEARER * self.thinned_secs,
        };
        if is_worth {
            self.thinned_secs = below_secs;
        }
        is_worth
    }

    /// Sets the target anew.
    fn aim(&mut self) {
        self.has_aimed = true;
        let target_secs = self.best_secs + TARGET * (self.tour_secs - self.best_secs);
        self.target_secs = if target_secs < (1.0 - NEAR) * self.tour_secs { target_secs } else { self.tour_secs };
    }

    /// To a target further up, from the tolls before steps were left out for one: those since may suit those steps alone.
    fn raise(&mut self) {
        self.aim();
        self.tolls.clone_from(&self.anchor);
        self.highest.1.clone_from(&self.anchor);
        self.begin();
        self.highest.0 = self.best_secs;
    }

    /// Begins anew from the tolls that it has.
    fn begin(&mut self) {
        (self.share, self.waited, self.highest.0) = (AGAIN, 0, 0.0);
        self.highest.2.clear();
        self.direction.fill(0.0);
    }

    /// Has all groups remember some more landmarks, or some what the last walks came back to.
    fn grow(&mut self, groups: &[Range<usize>], costs: &Costs, last: &[usize]) {
        if self.lacks_landmarks() {
            let count = if self.has_aimed { 1 } else { LANDMARKS_AT_ONCE };
            let more = landmarks::far_from(std::mem::take(&mut self.walks), &self.first.landmarks, count, groups, costs);
            self.first = self.first.with_landmarks(&more);
            self.memories = self.memories.with_landmarks(&more);
            self.most += more.len();
        } else if let Some(lists) = self.grown(last) {
            self.most = (self.most + 1).min(MOST_REMEMBERED);
            self.memories = Memories::new(self.first.landmarks.clone(), lists);
        }
        self.begin();
    }

    /// What groups remember if they remember, too, what the best walk and the last came back to by way of them; none if they
    /// do.
    fn grown(&self, last: &[usize]) -> Option<Vec<Vec<usize>>> {
        let most = (self.most + 1).min(MOST_REMEMBERED);
        let mut lists = self.memories.lists.clone();
        let mut grew = false;
        for walk in [&self.highest.2[..], last] {
            for (at, group) in walk.iter().enumerate() {
                let Some(back) = walk[at + 1..].iter().position(|other| other == group) else { continue };
                for between in &walk[at + 1..at + 1 + back] {
                    if lists[*between].len() < most && !lists[*between].contains(group) {
                        lists[*between].push(*group);
                        grew = true;
                    }
                }
            }
        }
        grew.then_some(lists)
    }
}
