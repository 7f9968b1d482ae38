//! RRT-Connect: a free path from one configuration to any of several goals where no simple one is free, by growing two trees
//! towards each other, the second from all goals (J. Kuffner and S. LaValle, "RRT-Connect: An Efficient Approach to
//! Single-Query Path Planning", ICRA 2000), then shortcut. Every edge is proved free as a segment. Samples come from a stream
//! that the ends name, so that the same ends give the same path.

use super::moves::{Moves, SegmentCache};
use crate::cell::{Axes, Configuration};
use crate::planning::context::{Cancelled, Context};
use crate::planning::random::Stream;

/// Largest edge of a tree, radians of any axis (25°).
const MAX_EDGE_RAD: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// Samples after which the search gives up.
const MAX_SAMPLES: usize = 10_000;
/// Samples after which it gives up where the start or all goals cannot be left. Even, so that each tree was extended as often.
const MAX_STUCK_SAMPLES: usize = 300;
/// Share of the samples that are spread over all that the axes allow; the others lie around the two ends.
const FAR_SHARE: f64 = 0.3;
/// Margin around the box of the two ends in which those samples lie, radians (70°).
const AROUND_RAD: f64 = 70.0 * std::f64::consts::PI / 180.0;
/// Attempts to cut a corner of the path found.
const SHORTCUTS: usize = 24;
/// Names the streams of this search.
const STREAM: u64 = 0x7272_7463;

/// Shortcuts a free path and returns its inner points.
pub(super) fn shortened(
    mut path: Vec<Configuration>,
    moves: &Moves<'_>,
    ctx: &Context<'_>,
) -> Result<Vec<Configuration>, Cancelled> {
    if let ([from, .., to], true) = (path.as_slice(), path.len() > 2) {
        RrtConnect::new(*from, vec![*to], moves).shorten(&mut path, ctx)?;
    }
    path.pop();
    path.drain(..path.len().min(1));
    Ok(path)
}

/// Finds a free path from `from` to one of `goals`: the number of the goal, and the points in between; `None` where there is none
/// within [`MAX_SAMPLES`]. Takes up to some seconds.
pub(super) fn connect(
    from: &Configuration,
    goals: &[Configuration],
    moves: &Moves<'_>,
    ctx: &Context<'_>,
) -> Result<Option<(usize, Vec<Configuration>)>, Cancelled> {
    let Some(path) = RrtConnect::new(*from, goals.to_vec(), moves).rrt_connect(ctx)? else { return Ok(None) };
    let goal = goals.iter().position(|goal| path.last() == Some(goal)).unwrap_or(0);
    Ok(Some((goal, shortened(path, moves, ctx)?)))
}

struct RrtConnect<'a> {
    moves: &'a Moves<'a>,
    segments: SegmentCache<'a>,
    stream: Stream,
    from: Configuration,
    goals: Vec<Configuration>,
}

/// Free configurations, each with a free segment to the one it grew from; roots grew from themselves and come first.
struct Tree(Vec<(Configuration, usize)>);

impl Tree {
    fn nearest(&self, axes: &Axes, goal: &Configuration) -> usize {
        let secs = |node: &usize| axes.move_secs(&self.0[*node].0, goal, 1.0);
        (0..self.0.len()).min_by(|a, b| secs(a).total_cmp(&secs(b))).unwrap_or(0)
    }

    fn rooted(roots: &[Configuration]) -> Self {
        Self(roots.iter().copied().zip(0..).collect())
    }

    /// The path from the root to a node.
    fn branch(&self, mut node: usize) -> Vec<Configuration> {
        let mut branch = vec![self.0[node].0];
        while node != self.0[node].1 {
            node = self.0[node].1;
            branch.push(self.0[node].0);
        }
        branch.reverse();
        branch
    }
}

impl<'a> RrtConnect<'a> {
    fn new(from: Configuration, goals: Vec<Configuration>, moves: &'a Moves<'a>) -> Self {
        let ends = std::iter::once(&from).chain(&goals).flat_map(Configuration::axes_rad);
        let names: Vec<u64> = std::iter::once(STREAM).chain(ends.map(|angle| angle.to_bits())).collect();
        Self { moves, segments: SegmentCache::new(moves), stream: Stream::new(0, &names), from, goals }
    }

    fn rrt_connect(&mut self, ctx: &Context<'_>) -> Result<Option<Vec<Configuration>>, Cancelled> {
        let mut trees = [Tree::rooted(&[self.from]), Tree::rooted(&self.goals)];
        let roots = [1, self.goals.len()];
        for round in 0..MAX_SAMPLES {
            ctx.check()?;
            if round == MAX_STUCK_SAMPLES && trees.iter().zip(roots).any(|(tree, roots)| tree.0.len() == roots) {
                break;
            }
            let sample = self.sample();
            let [growing, other] = &mut trees;
            if let Some(reached) = self.extend(growing, &sample, 1, ctx)? {
                let goal = growing.0[reached].0;
                let met = self.extend(other, &goal, usize::MAX, ctx)?.filter(|node| other.0[*node].0 == goal);
                if let Some(met) = met {
                    let (mut path, mut rest) = (growing.branch(reached), other.branch(met));
                    rest.pop();
                    path.extend(rest.into_iter().rev());
                    if round % 2 == 1 {
                        path.reverse();
                    }
                    return Ok(Some(path));
                }
            }
            trees.reverse();
        }
        Ok(None)
    }

    /// Extends the tree from its nearest node towards `goal` by at most `edges` edges; returns the last node added.
    fn extend(&self, tree: &mut Tree, goal: &Configuration, edges: usize, ctx: &Context<'_>) -> Result<Option<usize>, Cancelled> {
        let mut at = tree.nearest(&self.moves.axes, goal);
        let mut added = None;
        for _ in 0..edges {
            ctx.check()?;
            let here = tree.0[at].0;
            let share = (MAX_EDGE_RAD / here.max_turn_rad(goal)).min(1.0);
            let next = if share < 1.0 { here.toward(goal, share) } else { *goal };
            if here == next || !self.moves.is_free(&here, &next) {
                break;
            }
            tree.0.push((next, at));
            at = tree.0.len() - 1;
            added = Some(at);
            if next == *goal {
                break;
            }
        }
        Ok(added)
    }

    fn sample(&mut self) -> Configuration {
        let far = self.stream.unit() < FAR_SHARE;
        let goal = self.goals[(self.stream.unit() * self.goals.len() as f64) as usize].axes_rad();
        let from = self.from.axes_rad();
        Configuration::from_axes_rad(std::array::from_fn(|axis| {
            let (limits, a, b) = (&self.moves.axes.0[axis], from[axis], goal[axis]);
            let (low, high) = if far {
                (limits.min_rad, limits.max_rad)
            } else {
                ((a.min(b) - AROUND_RAD).max(limits.min_rad), (a.max(b) + AROUND_RAD).min(limits.max_rad))
            };
            low + (high - low) * self.stream.unit()
        }))
    }

    /// Drops points that are not needed, then cuts corners, where that is free and quicker.
    fn shorten(&mut self, path: &mut Vec<Configuration>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        self.drop_needless(path, ctx)?;
        for _ in 0..SHORTCUTS {
            ctx.check()?;
            let (first, last) = (self.random_point(path), self.random_point(path));
            let ((first, from), (last, to)) = if first.0 <= last.0 { (first, last) } else { (last, first) };
            let cut = [&path[..=first], &[from, to], &path[last + 1..]].concat();
            let is_quicker = self.moves.secs(&cut) < self.moves.secs(path);
            // Pieces of a proved segment too: between its samples it may come a little nearer than the clearance.
            let [before, from, to, after] = [0, 1, 2, 3].map(|at| cut[first + at]);
            let pieces = [(from, to), (before, from), (to, after)];
            if first < last && is_quicker && pieces.iter().all(|(from, to)| self.segments.is_free(from, to)) {
                *path = cut;
                self.drop_needless(path, ctx)?;
            }
        }
        Ok(())
    }

    fn drop_needless(&mut self, path: &mut Vec<Configuration>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        let mut at = 0;
        while at + 2 < path.len() {
            ctx.check()?;
            // The farthest point that a straight move reaches.
            let onward = (at + 2..path.len()).rev().find(|next| self.segments.is_free(&path[at], &path[*next]));
            if let Some(next) = onward {
                path.drain(at + 1..next);
            }
            at += 1;
        }
        Ok(())
    }

    /// A point on the path, and the segment that it is on.
    fn random_point(&mut self, path: &[Configuration]) -> (usize, Configuration) {
        let at = self.stream.unit() * (path.len() - 1) as f64;
        let segment = at as usize;
        (segment, path[segment].toward(&path[segment + 1], at - segment as f64))
    }
}
