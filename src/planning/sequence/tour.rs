//! The shortest closed tour from home through one node of each group, on a symmetric matrix of times.
//!
//! Up to [`EXACT_GROUPS`] groups by dynamic programming over subsets (M. Held and R. Karp, 1962, with the node of each
//! group as part of the state), 2ⁿ·N² steps for N nodes. Beyond, nearest neighbour improved by 2-opt and Or-opt until
//! neither helps; the choice of nodes for each order tried is exact, by dynamic programming along it, of which only the
//! changed piece is computed anew. The best is then kicked (O. Martin, S. Otto and E. Felten's double bridge, Complex
//! Systems 5, 1991: three pieces change places) and improved again, a number of times that depends on the number of groups
//! alone. How far it is from the shortest is bounded in [`bound`].

mod bound;

use std::ops::Range;

use crate::planning::context::{Cancelled, Context};
use crate::planning::random::Stream;

/// Groups up to which the tour is proved shortest.
pub(super) const EXACT_GROUPS: usize = 12;
/// Kicks a group.
const KICKS: usize = 2;
/// Longest piece of a kick.
const KICKED_GROUPS: f64 = 4.0;
/// Positions beside a kick that are looked at afterwards.
const AROUND: usize = 5;
/// Names the stream of kicks.
const STREAM: u64 = 0x7475_7273;
/// Longest piece that Or-opt moves.
const MOVED_GROUPS: usize = 3;
/// An improvement smaller than this is rounding, seconds.
const LEAST_GAIN_SECS: f64 = 1e-9;

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

    fn home(&self, node: usize) -> f64 {
        self.get(node, self.nodes)
    }
}

/// One node of each group in the order visited. `known` is a tour to start from (empty: none) and `round` the number of the
/// round of kicks, 0 for none, which matter to the local search only. Ties go to the lower number.
pub(super) fn shortest(
    groups: &[Range<usize>],
    costs: &Costs,
    known: &[usize],
    round: u32,
    ctx: &Context<'_>,
) -> Result<Vec<usize>, Cancelled> {
    match groups.len() {
        0 => Ok(Vec::new()),
        1..=EXACT_GROUPS => exact(groups, costs, ctx),
        _ => Search::new(groups, costs, known).run(round, ctx),
    }
}

/// What no tour takes less than; `known` is one.
pub(super) fn at_least(groups: &[Range<usize>], costs: &Costs, known: &[usize], ctx: &Context<'_>) -> Result<f64, Cancelled> {
    let Some((first, last)) = known.first().zip(known.last()) else { return Ok(0.0) };
    let between: f64 = known.windows(2).map(|step| costs.get(step[0], step[1])).sum();
    let secs = costs.home(*first) + between + costs.home(*last);
    if groups.len() <= EXACT_GROUPS { Ok(secs) } else { bound::at_least(groups, costs, secs, ctx) }
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

/// Local search over orders of groups.
struct Search<'a> {
    groups: &'a [Range<usize>],
    costs: &'a Costs,
    order: Vec<usize>,
    /// For each position, for each node of the group there: shortest way from home to it along the order, and on to home.
    to_here: Vec<Vec<f64>>,
    to_home: Vec<Vec<f64>>,
    secs: f64,
    /// Shortest step between any nodes of two groups, row-major, (groups + 1)²; the last row and column are home.
    least_steps: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(groups: &'a [Range<usize>], costs: &'a Costs, known: &[usize]) -> Self {
        let order = if known.is_empty() {
            nearest_neighbours(groups, costs)
        } else {
            known.iter().filter_map(|node| groups.iter().position(|group| group.contains(node))).collect()
        };
        let least_steps = least_steps(groups, costs);
        let mut search = Self { groups, costs, order, to_here: Vec::new(), to_home: Vec::new(), secs: 0.0, least_steps };
        search.refresh();
        search
    }

    fn run(mut self, round: u32, ctx: &Context<'_>) -> Result<Vec<usize>, Cancelled> {
        while self.improve(0..self.order.len(), ctx)? {}
        if round == 0 {
            return Ok(self.nodes());
        }
        let mut stream = Stream::new(0, &[STREAM, u64::from(round)]);
        let mut best = (self.secs, self.order.clone());
        for _ in 0..KICKS * self.groups.len() {
            let around = self.kick(&mut stream);
            while self.improve(around.clone(), ctx)? {}
            if self.secs < best.0 - LEAST_GAIN_SECS {
                best = (self.secs, self.order.clone());
            } else {
                self.order.clone_from(&best.1);
            }
        }
        self.refresh();
        Ok(self.nodes())
    }

    /// Two neighbouring pieces of the order change places; the positions around them.
    fn kick(&mut self, stream: &mut Stream) -> Range<usize> {
        let groups = self.order.len();
        let longest = KICKED_GROUPS.min((groups / 2) as f64);
        let mut length = || (1.0 + stream.unit() * longest).min(longest) as usize;
        let (front, back) = (length(), length());
        let first = (stream.unit() * (groups - front - back + 1) as f64) as usize;
        let end = first + front + back;
        self.order[first..end].rotate_left(front);
        self.refresh();
        first.saturating_sub(AROUND)..(end + AROUND).min(groups)
    }

    /// One round over all pieces of the order within these positions: each is reversed, or has a few groups moved from one end to the other,
    /// wherever that makes the tour shorter. Whether anything did.
    fn improve(&mut self, within: Range<usize>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
        let before = self.secs;
        for first in within.start..within.end - 1 {
            ctx.check()?;
            for last in first + 1..within.end {
                let limit = self.secs - LEAST_GAIN_SECS;
                let better = rearranged(&self.order[first..=last])
                    .find(|piece| self.at_least(first, piece) < limit && self.with_piece(first, piece) < limit);
                if let Some(better) = better {
                    self.order[first..=last].copy_from_slice(&better);
                    self.refresh();
                }
            }
        }
        Ok(self.secs < before)
    }

    /// A quick lower bound of [`Self::with_piece`]: every step between the nearest nodes of its groups.
    fn at_least(&self, first: usize, piece: &[usize]) -> f64 {
        let least = |secs: &[f64]| secs.iter().copied().fold(f64::INFINITY, f64::min);
        let (home, after) = (self.groups.len(), first + piece.len());
        let before = first.checked_sub(1).map_or((home, 0.0), |i| (self.order[i], least(&self.to_here[i])));
        let onward = self.order.get(after).map_or((home, 0.0), |group| (*group, least(&self.to_home[after])));
        let mut from = before.0;
        let mut secs = before.1 + onward.1;
        for to in piece.iter().chain([&onward.0]) {
            secs += self.least_steps[from * (home + 1) + to];
            from = *to;
        }
        secs
    }

    /// Time of the tour with `piece` in place of as many groups from position `first` on.
    fn with_piece(&self, first: usize, piece: &[usize]) -> f64 {
        let mut before = first.checked_sub(1).map(|i| (self.order[i], self.to_here[i].clone()));
        for group in piece {
            before = Some((*group, self.step(before.as_ref(), *group)));
        }
        let Some((group, secs)) = before else { return self.secs };
        let nodes = self.groups[group].clone().zip(secs);
        match self.order.get(first + piece.len()) {
            None => nodes.map(|(node, so_far)| so_far + self.costs.home(node)).fold(f64::INFINITY, f64::min),
            Some(next) => {
                let onward = &self.to_home[first + piece.len()];
                nodes
                    .flat_map(|(node, so_far)| {
                        let steps = self.groups[*next].clone().zip(onward);
                        steps.map(move |(to, on)| so_far + self.costs.get(node, to) + on)
                    })
                    .fold(f64::INFINITY, f64::min)
            }
        }
    }

    /// Shortest ways to each node of `group` from the group before it, or from home.
    fn step(&self, before: Option<&(usize, Vec<f64>)>, group: usize) -> Vec<f64> {
        let shortest_to = |to: usize| match before {
            None => self.costs.home(to),
            Some((group, secs)) => {
                let ways = self.groups[*group].clone().zip(secs).map(|(from, so_far)| so_far + self.costs.get(from, to));
                ways.fold(f64::INFINITY, f64::min)
            }
        };
        self.groups[group].clone().map(shortest_to).collect()
    }

    fn sweep(&self, order: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
        let mut before: Option<(usize, Vec<f64>)> = None;
        order
            .map(|group| {
                let secs = self.step(before.as_ref(), group);
                before = Some((group, secs.clone()));
                secs
            })
            .collect()
    }

    fn refresh(&mut self) {
        self.to_here = self.sweep(self.order.iter().copied());
        self.to_home = self.sweep(self.order.iter().rev().copied());
        self.to_home.reverse();
        let first = self.order.first().map_or(0..0, |group| self.groups[*group].clone());
        let closed = first.zip(self.to_home.first().into_iter().flatten()).map(|(node, on)| self.costs.home(node) + on);
        self.secs = closed.fold(f64::INFINITY, f64::min);
    }

    /// The nodes of the best tour along the order.
    fn nodes(&self) -> Vec<usize> {
        let mut tour: Vec<usize> = Vec::with_capacity(self.order.len());
        for (position, group) in self.order.iter().enumerate() {
            let from = tour.last().copied();
            let total = |node: usize, on: f64| from.map_or_else(|| self.costs.home(node), |from| self.costs.get(from, node)) + on;
            let options = self.groups[*group].clone().zip(&self.to_home[position]);
            let best = options.min_by(|a, b| total(a.0, *a.1).total_cmp(&total(b.0, *b.1)));
            tour.extend(best.map(|(node, _)| node));
        }
        tour
    }
}

fn least_steps(groups: &[Range<usize>], costs: &Costs) -> Vec<f64> {
    let home = costs.nodes..costs.nodes + 1;
    let all: Vec<_> = groups.iter().chain([&home]).collect();
    let least = |a: &Range<usize>, b: &Range<usize>| {
        a.clone().flat_map(|from| b.clone().map(move |to| costs.get(from, to))).fold(f64::INFINITY, f64::min)
    };
    all.iter().flat_map(|a| all.iter().map(move |b| least(a, b))).collect()
}

/// `piece` reversed, and with up to three groups moved from its front to its back or the other way, as they are or turned.
fn rearranged(piece: &[usize]) -> impl Iterator<Item = Vec<usize>> + '_ {
    let reversed = std::iter::once_with(|| piece.iter().rev().copied().collect());
    let moved = (1..=MOVED_GROUPS.min(piece.len() - 1)).flat_map(move |count| {
        let (front, rest) = piece.split_at(count);
        let (lead, back) = piece.split_at(piece.len() - count);
        let turned = |part: &[usize]| part.iter().rev().copied().collect::<Vec<_>>();
        [[rest, front].concat(), [rest, &turned(front)].concat(), [back, lead].concat(), [&turned(back), lead].concat()]
    });
    reversed.chain(moved)
}

/// From home always to the nearest group not yet visited.
fn nearest_neighbours(groups: &[Range<usize>], costs: &Costs) -> Vec<usize> {
    let mut left: Vec<usize> = (0..groups.len()).collect();
    let (mut order, mut here) = (Vec::new(), costs.nodes);
    while !left.is_empty() {
        let nearest = |group: &usize| {
            let to = groups[*group].clone().min_by(|a, b| costs.get(here, *a).total_cmp(&costs.get(here, *b)));
            to.map_or((f64::INFINITY, here), |node| (costs.get(here, node), node))
        };
        let Some(at) = (0..left.len()).min_by(|a, b| nearest(&left[*a]).0.total_cmp(&nearest(&left[*b]).0)) else { break };
        here = nearest(&left[at]).1;
        order.push(left.remove(at));
    }
    order
}

#[cfg(test)]
mod tests;
