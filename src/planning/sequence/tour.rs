//! The shortest closed tour from home through one node of each group, on a symmetric matrix of times.
//!
//! Up to [`EXACT_GROUPS`] groups by dynamic programming over subsets (M. Held and R. Karp, 1962, with the node of each
//! group as part of the state), 2ⁿ·N² steps for N nodes. Beyond, by a large neighbourhood search (S. Smith and F. Imeson,
//! "GLNS: an effective large neighborhood search heuristic for the generalized traveling salesman problem", Computers &
//! Operations Research 87, 2017): some groups are taken out of the tour and put in again where they cost least, the nodes for
//! the new order are chosen anew by dynamic programming along it, and the result is kept if it is shorter, or, less and less
//! often, if it is not (annealing). Runs with numbers of their own go side by side. How far the result is from the shortest is
//! bounded in [`bound`].

mod bound;

use std::ops::Range;

use rayon::prelude::*;

use crate::planning::context::{Cancelled, Context};
use crate::planning::random::Stream;

/// Groups up to which the tour is proved shortest.
pub(super) const EXACT_GROUPS: usize = 12;
/// Runs side by side, …
const RUNS: u64 = 4;
/// … each of so many trials a group when thorough, …
const TRIALS: usize = 100;
/// … so many when a tour is known, …
const TRIALS_AGAIN: usize = 25;
/// … and so many where its moves are yet to be looked at.
const TRIALS_BRIEF: usize = 6;
/// Nodes looked at in all trials of a thorough run, at most: a run's worth on long tours of many nodes.
const LOOKS: usize = 12_000_000;
/// Groups taken out at most.
const TAKEN_OUT: f64 = 20.0;
/// How much longer a tour may get in a trial at first, about, in mean steps.
const WARMTH: f64 = 0.3;
/// Names the streams of trials.
const STREAM: u64 = 0x7475_7273;
/// Trials between two looks at the cancel flag.
const TRIALS_PER_LOOK: usize = 32;
/// An improvement smaller than this is rounding, seconds.
const MIN_GAIN_SECS: f64 = 1e-9;

/// Times between nodes, and from each to home; the same both ways.
pub(super) struct Costs {
    nodes: usize,
    /// Row-major, (nodes + 1)²; the last row and column are home.
    secs: Vec<f64>,
}

impl Costs {
    /// `secs(a, b)` is asked for a < b; b = `nodes` is home.
    pub(super) fn new(nodes: usize, secs: impl Fn(usize, usize) -> f64) -> Self {
        let mut costs = Self { nodes, secs: vec![0.0; (nodes + 1) * (nodes + 1)] };
        for a in 0..nodes {
            for b in a + 1..=nodes {
                costs.set(a, b, secs(a, b));
            }
        }
        costs
    }

    pub(super) fn set(&mut self, a: usize, b: usize, secs: f64) {
        self.secs[a * (self.nodes + 1) + b] = secs;
        self.secs[b * (self.nodes + 1) + a] = secs;
    }

    pub(super) fn get(&self, a: usize, b: usize) -> f64 {
        self.secs[a * (self.nodes + 1) + b]
    }

    /// Times from a node, or from home, to every node and home.
    fn row(&self, from: usize) -> &[f64] {
        &self.secs[from * (self.nodes + 1)..][..=self.nodes]
    }

    fn home(&self, node: usize) -> f64 {
        self.get(node, self.nodes)
    }
}

/// How long is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// From nothing.
    Thorough,
    /// From a tour that may be the result.
    Again,
    /// From one that hardly is.
    Brief,
}

/// Tours of one node of each group in the order visited, the shortest first; its ties go to the lower number. `known` is a
/// tour to start from (empty: none), which matters to the search only.
pub(super) fn shortest(
    groups: &[Range<usize>],
    costs: &Costs,
    known: &[usize],
    effort: Effort,
    ctx: &Context<'_>,
) -> Result<Vec<Vec<usize>>, Cancelled> {
    match groups.len() {
        0 => Ok(vec![Vec::new()]),
        1..=EXACT_GROUPS => Ok(vec![exact(groups, costs, ctx)?]),
        _ => searched(groups, costs, known, effort, ctx),
    }
}

/// What no tour takes less than; `known` is one.
pub(super) fn lower_bound_secs(
    groups: &[Range<usize>],
    costs: &Costs,
    known: &[usize],
    ctx: &Context<'_>,
) -> Result<f64, Cancelled> {
    let Some((first, last)) = known.first().zip(known.last()) else { return Ok(0.0) };
    let between: f64 = known.windows(2).map(|step| costs.get(step[0], step[1])).sum();
    let secs = costs.home(*first) + between + costs.home(*last);
    if groups.len() <= EXACT_GROUPS { Ok(secs) } else { bound::lower_bound_secs(groups, costs, secs, ctx) }
}

/// `best[set · nodes + node]`: shortest way from home through one node of each group in `set`, ending at `node`.
fn exact(groups: &[Range<usize>], costs: &Costs, ctx: &Context<'_>) -> Result<Vec<usize>, Cancelled> {
    let (nodes, sets) = (costs.nodes, 1_usize << groups.len());
    let mut best = vec![f64::INFINITY; sets * nodes];
    let mut before = vec![u32::MAX; sets * nodes];
    for (index, group) in groups.iter().enumerate() {
        for node in group.clone() {
            best[(1 << index) * nodes + node] = costs.home(node);
        }
    }
    for set in 1..sets {
        ctx.check()?;
        for (_, from_group) in groups.iter().enumerate().filter(|(index, _)| set >> index & 1 == 1) {
            for (next, to_group) in groups.iter().enumerate().filter(|(index, _)| set >> index & 1 == 0) {
                let row = (set | 1 << next) * nodes;
                for from in from_group.clone() {
                    let so_far = best[set * nodes + from];
                    for to in to_group.clone() {
                        let secs = so_far + costs.get(from, to);
                        if secs < best[row + to] {
                            best[row + to] = secs;
                            before[row + to] = from as u32;
                        }
                    }
                }
            }
        }
    }
    Ok(trace_back(groups, costs, &best, &before))
}

fn trace_back(groups: &[Range<usize>], costs: &Costs, best: &[f64], before: &[u32]) -> Vec<usize> {
    let nodes = costs.nodes;
    let mut set = (1 << groups.len()) - 1;
    let closed = |node: &usize| best[set * nodes + node] + costs.home(*node);
    let mut last = (0..nodes).min_by(|a, b| closed(a).total_cmp(&closed(b)));
    let mut tour = Vec::with_capacity(groups.len());
    while let Some(node) = last {
        tour.push(node);
        let previous = before[set * nodes + node];
        set &= !groups.iter().position(|group| group.contains(&node)).map_or(0, |group| 1 << group);
        last = (previous != u32::MAX).then_some(previous as usize);
    }
    tour.reverse();
    tour
}

/// The tours of all runs, the shortest first.
fn searched(
    groups: &[Range<usize>],
    costs: &Costs,
    known: &[usize],
    effort: Effort,
    ctx: &Context<'_>,
) -> Result<Vec<Vec<usize>>, Cancelled> {
    let run = |run: u64| Search::new(groups, costs, Stream::new(0, &[STREAM, run])).run(known, effort, ctx);
    let mut found: Vec<(f64, Vec<usize>)> = (0..RUNS).into_par_iter().map(run).collect::<Result<_, _>>()?;
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(found.into_iter().map(|(_, tour)| tour).collect())
}

/// Large neighbourhood search.
struct Search<'a> {
    groups: &'a [Range<usize>],
    costs: &'a Costs,
    /// Group of each node.
    group_of: Vec<usize>,
    stream: Stream,
    /// For each position of an order, for each node of the group there: shortest way from home to it. Kept for its memory.
    to_here: Vec<Vec<f64>>,
}

impl<'a> Search<'a> {
    fn new(groups: &'a [Range<usize>], costs: &'a Costs, stream: Stream) -> Self {
        let group_of = groups.iter().enumerate().flat_map(|(group, nodes)| vec![group; nodes.len()]).collect();
        Self { groups, costs, group_of, stream, to_here: vec![Vec::new(); groups.len()] }
    }

    /// The shortest tour met, and its time.
    fn run(mut self, known: &[usize], effort: Effort, ctx: &Context<'_>) -> Result<(f64, Vec<usize>), Cancelled> {
        let mut here = match known {
            [] => self.put_in(Vec::new(), (0..self.groups.len()).collect()),
            known => known.to_vec(),
        };
        let trials = match effort {
            Effort::Thorough => TRIALS,
            Effort::Again => TRIALS_AGAIN,
            Effort::Brief => TRIALS_BRIEF,
        };
        let trials = trials * self.groups.len().min(LOOKS / (TRIALS * self.costs.nodes));
        let mut secs = self.choose_nodes(&mut here);
        let mut best = (secs, here.clone());
        let hottest_secs = WARMTH * secs / (self.groups.len() + 1) as f64;
        for trial in 0..trials {
            if trial % TRIALS_PER_LOOK == 0 {
                ctx.check()?;
            }
            let (left, out) = self.take_out(&here);
            let mut other = self.put_in(left, out);
            let other_secs = self.choose_nodes(&mut other);
            let heat_secs = hottest_secs * (1.0 - trial as f64 / trials as f64);
            if other_secs < secs || self.stream.unit() < ((secs - other_secs) / heat_secs).exp() {
                (here, secs) = (other, other_secs);
            }
            if secs < best.0 - MIN_GAIN_SECS {
                best = (secs, here.clone());
            }
        }
        Ok(best)
    }

    /// A number below `count`, uniform.
    fn any(&mut self, count: usize) -> usize {
        (self.stream.unit() * count as f64) as usize
    }

    /// A tour without some of its nodes, and the groups of those: neighbours in the tour, any, or those nearest to one of them.
    fn take_out(&mut self, tour: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let most = TAKEN_OUT.min((tour.len() - 1) as f64);
        let count = 2 + (self.stream.unit() * self.stream.unit() * (most - 1.0)) as usize;
        let mut out = tour.to_vec();
        match self.any(3) {
            0 => out.rotate_left(self.any(tour.len())),
            1 => (0..count).for_each(|at| out.swap(at, at + self.any(tour.len() - at))),
            _ => {
                let centre = tour[self.any(tour.len())];
                out.sort_by(|a, b| self.costs.get(centre, *a).total_cmp(&self.costs.get(centre, *b)));
            }
        }
        out.truncate(count);
        let left = tour.iter().copied().filter(|node| !out.contains(node)).collect();
        (left, out.into_iter().map(|node| self.group_of[node]).collect())
    }

    /// The tour with `groups` put in where they cost least: in any order, or always the one that costs least of all.
    fn put_in(&mut self, mut tour: Vec<usize>, mut groups: Vec<usize>) -> Vec<usize> {
        let least_first = self.any(2) == 0;
        while !groups.is_empty() {
            let place = if least_first {
                let places = (0..groups.len()).map(|index| (index, self.place(&tour, groups[index])));
                places.reduce(|best, next| if next.1.secs < best.1.secs { next } else { best })
            } else {
                let index = self.any(groups.len());
                Some((index, self.place(&tour, groups[index])))
            };
            let Some((index, place)) = place else { break };
            tour.insert(place.at, place.node);
            groups.swap_remove(index);
        }
        tour
    }

    /// Where a group costs least in a tour.
    fn place(&self, tour: &[usize], group: usize) -> Place {
        let home = self.costs.nodes;
        let nodes = &self.groups[group];
        let mut best = Place { secs: f64::INFINITY, at: 0, node: nodes.start };
        for at in 0..=tour.len() {
            let before = at.checked_sub(1).map_or(home, |at| tour[at]);
            let after = tour.get(at).copied().unwrap_or(home);
            let straight = self.costs.get(before, after);
            let ways = self.costs.row(before)[nodes.clone()].iter().zip(&self.costs.row(after)[nodes.clone()]);
            for (node, (there, on)) in nodes.clone().zip(ways) {
                let secs = there + on - straight;
                if secs < best.secs {
                    best = Place { secs, at, node };
                }
            }
        }
        best
    }

    /// The best nodes for the order of a tour, and its time.
    fn choose_nodes(&mut self, tour: &mut [usize]) -> f64 {
        let home = self.costs.nodes;
        let mut before: Option<usize> = None;
        for (position, group) in tour.iter().map(|node| self.group_of[*node]).enumerate() {
            let (done, rest) = self.to_here.split_at_mut(position);
            let to_here = &mut rest[0];
            to_here.clear();
            to_here.extend(self.groups[group].clone().map(|to| match before {
                None => self.costs.home(to),
                Some(before) => {
                    let row = &self.costs.row(to)[self.groups[before].clone()];
                    let ways = done[position - 1].iter().zip(row).map(|(so_far, step)| so_far + step);
                    ways.fold(f64::INFINITY, |least, secs| if secs < least { secs } else { least })
                }
            }));
            before = Some(group);
        }
        let (mut next, mut total) = (home, 0.0);
        for (position, node) in tour.iter_mut().enumerate().rev() {
            let options = self.groups[self.group_of[*node]].clone().zip(&self.to_here[position]);
            let ways = options.map(|(node, so_far)| (so_far + self.costs.get(node, next), node));
            let best = ways.fold((f64::INFINITY, *node), |best, way| if way.0 < best.0 { way } else { best });
            if next == home {
                total = best.0;
            }
            (*node, next) = (best.1, best.1);
        }
        total
    }
}

/// A place in a tour for a node, and what it adds.
struct Place {
    secs: f64,
    at: usize,
    node: usize,
}

#[cfg(test)]
mod tests;
