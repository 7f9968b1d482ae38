//! The shortest closed tour from home through one node of each group, on a symmetric matrix of times.
//!
//! Up to [`EXACT_GROUPS`] groups by dynamic programming over subsets (M. Held and R. Karp, 1962, with the node of each
//! group as part of the state), 2ⁿ·N² steps for N nodes. Beyond, by a large neighbourhood search (S. Smith and F. Imeson,
//! "GLNS: an effective large neighborhood search heuristic for the generalized traveling salesman problem", Computers &
//! Operations Research 87, 2017): some groups are removed from the tour and inserted again where they cost least, the nodes for
//! the new order are chosen anew by dynamic programming along it, and the result is kept if it is shorter, or, less and less
//! often, if it is not (annealing). Runs with numbers of their own go side by side. How far the result is from the shortest is
//! bounded in [`bound`].

mod bound;

use std::ops::Range;

use crate::geometry::{parallel, sort_ascending};
use crate::planning::context::{Cancelled, Context};
use crate::planning::random::Stream;

/// Groups up to which the tour is proved shortest.
pub(super) const EXACT_GROUPS: usize = 12;
/// Independent runs side by side.
const RUNS: usize = 4;
/// Trials a group of a thorough run.
const TRIALS: usize = 100;
/// Trials a group where a tour is known.
const TRIALS_AGAIN: usize = 25;
/// Trials a group where moves of the tour are yet to be checked.
const TRIALS_BRIEF: usize = 6;
/// Nodes evaluated in all trials of a thorough run at most, which bounds runs on long tours of many nodes.
const MAX_EVALUATIONS: usize = 12_000_000;
/// Groups removed in a trial at most.
const MAX_REMOVED: f64 = 20.0;
/// Temperature of the annealing at the start, in mean steps of the tour.
const INITIAL_TEMPERATURE: f64 = 0.3;
/// Names the streams of trials.
const STREAM: u64 = 0x7475_7273;
/// Trials between two checks of the cancel flag.
const TRIALS_PER_CHECK: usize = 32;
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

/// Bytes that the search for a tour through up to so many groups of so many nodes each, and its bound, hold at most.
pub(super) fn expected_bytes(max_groups: usize, nodes_of_group: usize) -> f64 {
    let nodes = max_groups * nodes_of_group;
    let costs = ((nodes + 1) * (nodes + 1) * size_of::<f64>()) as f64;
    if max_groups > EXACT_GROUPS {
        return costs + bound::expected_bytes(max_groups, nodes_of_group);
    }
    costs + ((nodes << max_groups) * (size_of::<f64>() + size_of::<u32>())) as f64
}

/// Length of the search for a tour, or for a bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// Starts from nothing.
    Thorough,
    /// Starts from a tour that may be the result.
    Again,
    /// Starts from a tour that hardly is the result.
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
        _ => search(groups, costs, known, effort, ctx),
    }
}

/// Lower bound of the time of every tour; `known` is one of them.
pub(super) fn lower_bound_secs(
    groups: &[Range<usize>],
    costs: &Costs,
    known: &[usize],
    effort: Effort,
    ctx: &Context<'_>,
) -> Result<f64, Cancelled> {
    let Some((first, last)) = known.first().zip(known.last()) else { return Ok(0.0) };
    let between: f64 = known.windows(2).map(|step| costs.get(step[0], step[1])).sum();
    let secs = costs.home(*first) + between + costs.home(*last);
    if groups.len() <= EXACT_GROUPS { Ok(secs) } else { bound::lower_bound_secs(groups, costs, secs, effort, ctx) }
}

/// Held–Karp: `best[set · nodes + node]` is the shortest path from home through one node of each group in `set` to `node`.
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
    Ok(backtrack(groups, costs, &best, &before))
}

fn backtrack(groups: &[Range<usize>], costs: &Costs, best: &[f64], before: &[u32]) -> Vec<usize> {
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
fn search(
    groups: &[Range<usize>],
    costs: &Costs,
    known: &[usize],
    effort: Effort,
    ctx: &Context<'_>,
) -> Result<Vec<Vec<usize>>, Cancelled> {
    let run = |run: usize| NeighbourhoodSearch::new(groups, costs, Stream::new(0, &[STREAM, run as u64])).run(known, effort, ctx);
    let mut found: Vec<(f64, Vec<usize>)> = parallel::try_map_range(RUNS, run)?;
    sort_ascending(&mut found, |found| found.0);
    Ok(found.into_iter().map(|(_, tour)| tour).collect())
}

/// Large neighbourhood search.
struct NeighbourhoodSearch<'a> {
    groups: &'a [Range<usize>],
    costs: &'a Costs,
    /// Group of each node.
    group_of: Vec<usize>,
    stream: Stream,
    /// Shortest time from home to each node of the group at each position of an order. Kept for its allocation.
    secs_to: Vec<Vec<f64>>,
}

impl<'a> NeighbourhoodSearch<'a> {
    fn new(groups: &'a [Range<usize>], costs: &'a Costs, stream: Stream) -> Self {
        let group_of = groups.iter().enumerate().flat_map(|(group, nodes)| vec![group; nodes.len()]).collect();
        Self { groups, costs, group_of, stream, secs_to: vec![Vec::new(); groups.len()] }
    }

    /// The shortest tour found, and its time.
    fn run(mut self, known: &[usize], effort: Effort, ctx: &Context<'_>) -> Result<(f64, Vec<usize>), Cancelled> {
        let mut here = match known {
            [] => self.insert_groups(Vec::new(), (0..self.groups.len()).collect()),
            known => known.to_vec(),
        };
        let trials = match effort {
            Effort::Thorough => TRIALS,
            Effort::Again => TRIALS_AGAIN,
            Effort::Brief => TRIALS_BRIEF,
        };
        let trials = trials * self.groups.len().min(MAX_EVALUATIONS / (TRIALS * self.costs.nodes));
        let mut secs = self.choose_nodes(&mut here);
        let mut best = (secs, here.clone());
        let initial_secs = INITIAL_TEMPERATURE * secs / (self.groups.len() + 1) as f64;
        for trial in 0..trials {
            if trial % TRIALS_PER_CHECK == 0 {
                ctx.check()?;
            }
            let (left, out) = self.remove_groups(&here);
            let mut other = self.insert_groups(left, out);
            let other_secs = self.choose_nodes(&mut other);
            let temperature_secs = initial_secs * (1.0 - trial as f64 / trials as f64);
            if other_secs < secs || self.stream.unit() < ((secs - other_secs) / temperature_secs).exp() {
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

    /// Removes some groups from a tour: neighbours in it, any, or those nearest to one of them; returns the rest and the groups.
    fn remove_groups(&mut self, tour: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let max = MAX_REMOVED.min((tour.len() - 1) as f64);
        let count = 2 + (self.stream.unit() * self.stream.unit() * (max - 1.0)) as usize;
        let mut out = tour.to_vec();
        match self.any(3) {
            0 => out.rotate_left(self.any(tour.len())),
            1 => (0..count).for_each(|at| out.swap(at, at + self.any(tour.len() - at))),
            _ => {
                let centre = tour[self.any(tour.len())];
                sort_ascending(&mut out, |found| self.costs.get(centre, *found));
            }
        }
        out.truncate(count);
        let left = tour.iter().copied().filter(|node| !out.contains(node)).collect();
        (left, out.into_iter().map(|node| self.group_of[node]).collect())
    }

    /// Inserts `groups` where they cost least: in any order, or always the cheapest one first.
    fn insert_groups(&mut self, mut tour: Vec<usize>, mut groups: Vec<usize>) -> Vec<usize> {
        let cheapest_first = self.any(2) == 0;
        while !groups.is_empty() {
            let insertion = if cheapest_first {
                let insertions = (0..groups.len()).map(|index| (index, self.cheapest_insertion(&tour, groups[index])));
                insertions.reduce(|best, next| if next.1.secs < best.1.secs { next } else { best })
            } else {
                let index = self.any(groups.len());
                Some((index, self.cheapest_insertion(&tour, groups[index])))
            };
            let Some((index, insertion)) = insertion else { break };
            tour.insert(insertion.at, insertion.node);
            groups.swap_remove(index);
        }
        tour
    }

    /// The insertion of a group that costs least.
    fn cheapest_insertion(&self, tour: &[usize], group: usize) -> Insertion {
        let home = self.costs.nodes;
        let nodes = &self.groups[group];
        let mut best = Insertion { secs: f64::INFINITY, at: 0, node: nodes.start };
        for at in 0..=tour.len() {
            let before = at.checked_sub(1).map_or(home, |at| tour[at]);
            let after = tour.get(at).copied().unwrap_or(home);
            let straight = self.costs.get(before, after);
            let ways = self.costs.row(before)[nodes.clone()].iter().zip(&self.costs.row(after)[nodes.clone()]);
            for (node, (there, on)) in nodes.clone().zip(ways) {
                let secs = there + on - straight;
                if secs < best.secs {
                    best = Insertion { secs, at, node };
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
            let (done, rest) = self.secs_to.split_at_mut(position);
            let secs_to = &mut rest[0];
            secs_to.clear();
            secs_to.extend(self.groups[group].clone().map(|to| match before {
                None => self.costs.home(to),
                Some(before) => {
                    let row = &self.costs.row(to)[self.groups[before].clone()];
                    let ways = done[position - 1].iter().zip(row).map(|(so_far, step)| so_far + step);
                    ways.fold(f64::INFINITY, |min, secs| if secs < min { secs } else { min })
                }
            }));
            before = Some(group);
        }
        let (mut next, mut total) = (home, 0.0);
        for (position, node) in tour.iter_mut().enumerate().rev() {
            let options = self.groups[self.group_of[*node]].clone().zip(&self.secs_to[position]);
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

/// Insertion of a node into a tour, and the time that it adds.
struct Insertion {
    secs: f64,
    at: usize,
    node: usize,
}

#[cfg(test)]
mod tests;
