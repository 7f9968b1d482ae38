//! A time that no tour can be shorter than, for tours too long to be proved shortest.
//!
//! Walks from home with one stop for each group are cheaper than tours: they may stop at a group twice and pass over another.
//! The shortest is found by dynamic programming over the number of stops (N. Christofides, A. Mingozzi and P. Toth,
//! "State-space relaxation procedures for the computation of bounds to routing problems", Networks 11, 1981), each group
//! remembering some of those that the walk came by, to which it may not go on (R. Baldacci, A. Mingozzi and R. Roberti, "New
//! route relaxation and pricing strategies for the vehicle routing problem", Operations Research 59(5), 2011). A toll on groups
//! that it stops at too often, and a reward for those that it passes over, raise it towards the tour (M. Held and R. Karp's
//! multipliers, by subgradient); where tolls raise it no more, what groups remember grows by what the walk came back to
//! (R. Roberti and A. Mingozzi, "Dynamic ng-path relaxation for the delivery man problem", Transportation Science 48(3),
//! 2014). Any tolls and memories give a valid bound. A walk without a group twice is the shortest tour.

mod walks;

use std::ops::Range;

use rayon::prelude::*;

use self::walks::{LANES, Memories, Relaxation, Walk};
use super::Costs;
use crate::planning::context::{Cancelled, Context};

/// Groups that each remembers at first, the nearest, …
const REMEMBERED: usize = 3;
/// … and at most.
const MOST_REMEMBERED: usize = 13;
/// Additions in all rounds together, about a second's worth on two cores.
const ADDITIONS: usize = 32_000_000_000;
/// Rounds without gain after which steps become shorter, …
const PATIENCE: u32 = 3;
/// … and by how much.
const SHORTER: f64 = 0.7;
/// Share of the full step below which memories grow, …
const GROW: f64 = 0.3;
/// … and with which it goes on then.
const AGAIN: f64 = 0.4;
/// Steps this short change nothing.
const STILL: f64 = 1e-3;
/// A gap smaller than this share of the tour is closed.
const CLOSED: f64 = 1e-6;

/// A lower bound of the shortest tour; `tour_secs` is the time of one that is known.
pub(super) fn at_least(groups: &[Range<usize>], costs: &Costs, tour_secs: f64, ctx: &Context<'_>) -> Result<f64, Cancelled> {
    let width = width(groups);
    if (groups.len() * width).pow(2).saturating_mul(groups.len() << REMEMBERED) > ADDITIONS {
        return Ok(entered_secs(groups, costs).min(tour_secs));
    }
    let relaxation = Relaxation::new(groups, costs, ctx.simd_level());
    let mut ascent = Ascent::new(&relaxation, tour_secs);
    let mut additions = 0;
    loop {
        ctx.check()?;
        let walk = relaxation.shortest_walk(&ascent.first, &ascent.memories, &ascent.tolls, tour_secs);
        additions += walk.additions;
        if ascent.is_done(&walk) || additions + walk.additions > ADDITIONS {
            return Ok(ascent.best_secs.clamp(0.0, tour_secs));
        }
    }
}

/// Nodes of the largest group, rounded up to whole [`LANES`].
fn width(groups: &[Range<usize>]) -> usize {
    groups.iter().map(Range::len).max().unwrap_or(0).next_multiple_of(LANES)
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

/// Tolls and memories on their way to the best bound.
struct Ascent {
    tour_secs: f64,
    tolls: Vec<f64>,
    first: Memories,
    memories: Memories,
    most: usize,
    best_secs: f64,
    /// Of the memories as they are: the highest bound, and the tolls and the stops of its walk.
    highest: (f64, Vec<f64>, Vec<usize>),
    share: f64,
    waited: u32,
}

impl Ascent {
    fn new(relaxation: &Relaxation<'_>, tour_secs: f64) -> Self {
        let count = relaxation.groups.len();
        let first = Memories::new(relaxation.nearest(REMEMBERED));
        let (memories, tolls) = (first.clone(), vec![0.0; count]);
        let highest = (0.0, tolls.clone(), Vec::new());
        let (share, waited) = (1.0, 0);
        Self { tour_secs, tolls, first, memories, most: REMEMBERED, best_secs: 0.0, highest, share, waited }
    }

    /// Takes a walk into account; whether nothing more is to be had.
    fn is_done(&mut self, walk: &Walk) -> bool {
        self.best_secs = self.best_secs.max(walk.secs);
        if walk.secs > self.highest.0 || self.highest.2.is_empty() {
            (self.highest, self.waited) = ((walk.secs, self.tolls.clone(), walk.groups.clone()), 0);
        } else {
            self.waited += 1;
        }
        let mut too_often = vec![-1.0; self.tolls.len()];
        walk.groups.iter().for_each(|group| too_often[*group] += 1.0);
        let off: f64 = too_often.iter().map(|stops: &f64| stops * stops).sum();
        if off == 0.0 || walk.groups.is_empty() || self.tour_secs - self.best_secs <= CLOSED * self.tour_secs {
            return true;
        }
        if self.waited == PATIENCE {
            (self.share, self.waited) = (SHORTER * self.share, 0);
            self.tolls.clone_from(&self.highest.1);
            let grows = self.share < GROW && self.grow(&walk.groups);
            if !grows && self.share < STILL {
                return true;
            }
        }
        let step = self.share * (self.tour_secs - walk.secs) / off;
        self.tolls.iter_mut().zip(&too_often).for_each(|(toll, stops)| *toll += step * stops);
        false
    }

    /// Has groups remember what the best walk and the last came back to by way of them; whether any does now.
    fn grow(&mut self, last: &[usize]) -> bool {
        self.most = (self.most + 1).min(MOST_REMEMBERED);
        let mut lists = self.memories.lists.clone();
        let mut grew = false;
        for walk in [&self.highest.2[..], last] {
            for (at, group) in walk.iter().enumerate() {
                let Some(back) = walk[at + 1..].iter().position(|other| other == group) else { continue };
                for between in &walk[at + 1..at + 1 + back] {
                    if lists[*between].len() < self.most && !lists[*between].contains(group) {
                        lists[*between].push(*group);
                        grew = true;
                    }
                }
            }
        }
        if grew {
            self.memories = Memories::new(lists);
            (self.share, self.highest.0) = (AGAIN, 0.0);
        }
        grew
    }
}
