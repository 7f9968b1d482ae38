//! A free way from one configuration to any of some others where no simple one is, by growing two trees towards each other, the
//! second from all of them (J. Kuffner and S. LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", ICRA
//! 2000), then made short. Every edge is proved free as a segment. Samples come from a stream that the ends name, so the same
//! question has the same answer.

use super::moves::{Looks, Moves};
use crate::cell::{Axes, Configuration};
use crate::planning::context::{Cancelled, Context};
use crate::planning::random::Stream;

/// Longest edge of a tree, radians of any axis (25°).
const EDGE_RAD: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// Samples after which the search gives up.
const SAMPLES: usize = 10_000;
/// Samples after which it gives up where the one end or all others cannot be left. Even: each tree has its first place then.
const STUCK_SAMPLES: usize = 300;
/// Share of the samples that are spread over all that the axes allow; the others lie around the two ends.
const FAR_SHARE: f64 = 0.3;
/// How far around the one and one of the others, radians (70°).
const AROUND_RAD: f64 = 70.0 * std::f64::consts::PI / 180.0;
/// Tries to cut a corner of the way found.
const SHORTCUTS: usize = 24;
/// Names the streams of this search.
const STREAM: u64 = 0x7272_7463;

/// A free way with points left out and corners cut, its ends left out too.
pub(super) fn shortened(
    mut way: Vec<Configuration>,
    moves: &Moves<'_>,
    ctx: &Context<'_>,
) -> Result<Vec<Configuration>, Cancelled> {
    if let ([from, .., to], true) = (way.as_slice(), way.len() > 2) {
        Search::new(*from, vec![*to], moves).shorten(&mut way, ctx)?;
    }
    way.pop();
    way.drain(..way.len().min(1));
    Ok(way)
}

/// The points between `from` and one of `goals`, both left out, and which goal that is; `None` where none were found. Not
/// cheap: up to some seconds.
pub(super) fn connect(
    from: &Configuration,
    goals: &[Configuration],
    moves: &Moves<'_>,
    ctx: &Context<'_>,
) -> Result<Option<(usize, Vec<Configuration>)>, Cancelled> {
    let Some(way) = Search::new(*from, goals.to_vec(), moves).trees(ctx)? else { return Ok(None) };
    let goal = goals.iter().position(|goal| way.last() == Some(goal)).unwrap_or(0);
    Ok(Some((goal, shortened(way, moves, ctx)?)))
}

struct Search<'a> {
    moves: &'a Moves<'a>,
    looks: Looks<'a>,
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

    /// From its root to a node.
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

impl<'a> Search<'a> {
    fn new(from: Configuration, goals: Vec<Configuration>, moves: &'a Moves<'a>) -> Self {
        let ends = from.iter().chain(goals.iter().flatten());
        let names: Vec<u64> = std::iter::once(STREAM).chain(ends.map(|angle| angle.to_bits())).collect();
        Self { moves, looks: Looks::new(moves), stream: Stream::new(0, &names), from, goals }
    }

    fn trees(&mut self, ctx: &Context<'_>) -> Result<Option<Vec<Configuration>>, Cancelled> {
        let mut trees = [Tree::rooted(&[self.from]), Tree::rooted(&self.goals)];
        let roots = [1, self.goals.len()];
        for round in 0..SAMPLES {
            ctx.check()?;
            if round == STUCK_SAMPLES && trees.iter().zip(roots).any(|(tree, roots)| tree.0.len() == roots) {
                break;
            }
            let sample = self.sample();
            let [growing, other] = &mut trees;
            if let Some(reached) = self.grow(growing, &sample, 1, ctx)? {
                let goal = growing.0[reached].0;
                let met = self.grow(other, &goal, usize::MAX, ctx)?.filter(|node| other.0[*node].0 == goal);
                if let Some(met) = met {
                    let (mut way, mut rest) = (growing.branch(reached), other.branch(met));
                    rest.pop();
                    way.extend(rest.into_iter().rev());
                    if round % 2 == 1 {
                        way.reverse();
                    }
                    return Ok(Some(way));
                }
            }
            trees.reverse();
        }
        Ok(None)
    }

    /// Grows from the nearest node towards `goal`, at most `edges` edges; the last node added.
    fn grow(&self, tree: &mut Tree, goal: &Configuration, edges: usize, ctx: &Context<'_>) -> Result<Option<usize>, Cancelled> {
        let mut at = tree.nearest(&self.moves.axes, goal);
        let mut added = None;
        for _ in 0..edges {
            ctx.check()?;
            let here = tree.0[at].0;
            let widest = here.iter().zip(goal).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
            let share = (EDGE_RAD / widest).min(1.0);
            let next =
                if share < 1.0 { std::array::from_fn(|axis| here[axis] + share * (goal[axis] - here[axis])) } else { *goal };
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
        let goal = self.goals[(self.stream.unit() * self.goals.len() as f64) as usize];
        std::array::from_fn(|axis| {
            let (limits, a, b) = (&self.moves.axes.0[axis], self.from[axis], goal[axis]);
            let (low, high) = if far {
                (limits.min_rad, limits.max_rad)
            } else {
                ((a.min(b) - AROUND_RAD).max(limits.min_rad), (a.max(b) + AROUND_RAD).min(limits.max_rad))
            };
            low + (high - low) * self.stream.unit()
        })
    }

    /// Leaves out points that are not needed, then cuts corners, where that is free and quicker.
    fn shorten(&mut self, way: &mut Vec<Configuration>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        self.leave_out(way, ctx)?;
        for _ in 0..SHORTCUTS {
            ctx.check()?;
            let (first, last) = (self.place(way), self.place(way));
            let ((first, from), (last, to)) = if first.0 <= last.0 { (first, last) } else { (last, first) };
            let cut = [&way[..=first], &[from, to], &way[last + 1..]].concat();
            let is_quicker = self.moves.secs(&cut) < self.moves.secs(way);
            // Pieces of a proved segment too: between its samples it may come a little nearer than the clearance.
            let [before, from, to, after] = [0, 1, 2, 3].map(|at| cut[first + at]);
            let pieces = [(from, to), (before, from), (to, after)];
            if first < last && is_quicker && pieces.iter().all(|(from, to)| self.looks.is_free(from, to)) {
                *way = cut;
                self.leave_out(way, ctx)?;
            }
        }
        Ok(())
    }

    fn leave_out(&mut self, way: &mut Vec<Configuration>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        let mut at = 0;
        while at + 2 < way.len() {
            ctx.check()?;
            // The farthest point that can be gone to straight.
            let onward = (at + 2..way.len()).rev().find(|next| self.looks.is_free(&way[at], &way[*next]));
            if let Some(next) = onward {
                way.drain(at + 1..next);
            }
            at += 1;
        }
        Ok(())
    }

    /// A point on the way, and the segment that it is on.
    fn place(&mut self, way: &[Configuration]) -> (usize, Configuration) {
        let at = self.stream.unit() * (way.len() - 1) as f64;
        let segment = at as usize;
        let ([from, to], share) = ([way[segment], way[segment + 1]], at - segment as f64);
        (segment, std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis])))
    }
}
