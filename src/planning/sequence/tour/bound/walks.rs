//! Shortest walks from home with one stop for each group and back, by dynamic programming over the number of stops; what they
//! may not come back to is what each group remembers. See [`super`] for where the method is from.
//!
//! Times are the same both ways, so a walk is two halves that meet, and only halves are grown. A half is dropped where no
//! second half, with the smallest memories, makes a walk shorter than the known tour.
//!
//! Cost: labels · nodes · (nodes of a group) additions a round, in single precision.

use std::ops::Range;

use rayon::prelude::*;

use super::super::Costs;
use super::width;
use crate::geometry::{Kernel, SimdLevel, least};

/// Nodes side by side.
pub(super) const LANES: usize = 16;

/// Which groups each group remembers, and what becomes of what is remembered on the way from one to another.
#[derive(Clone)]
pub(super) struct Memories {
    pub(super) lists: Vec<Vec<usize>>,
    /// For each two groups, for each set of what the first remembers as bits: what the second remembers then.
    passed_on: Vec<Vec<u16>>,
}

/// The second group is remembered by the first: no walk goes there.
const FORBIDDEN: u16 = u16::MAX;

impl Memories {
    pub(super) fn new(lists: Vec<Vec<usize>>) -> Self {
        let count = lists.len();
        let passed_on = |pair: usize| {
            let (from, to) = (pair / count, pair % count);
            let place = |group: &usize| lists[to].iter().position(|other| other == group);
            let itself = place(&from).map_or(0, |bit| 1 << bit);
            let places: Vec<_> = lists[from].iter().map(place).collect();
            let barred = lists[from].iter().position(|group| *group == to).map_or(0, |bit| 1 << bit);
            let passed = |set: u16| {
                let kept = places.iter().enumerate().filter(|(bit, _)| set >> bit & 1 == 1).filter_map(|(_, place)| *place);
                if set & barred == 0 { kept.fold(itself, |all, bit| all | 1 << bit) } else { FORBIDDEN }
            };
            (0..1 << lists[from].len()).map(passed).collect()
        };
        let passed_on = (0..count * count).into_par_iter().map(passed_on).collect();
        Self { lists, passed_on }
    }

    fn passed_on(&self, from: usize, to: usize) -> &[u16] {
        &self.passed_on[from * self.lists.len() + to]
    }
}

/// Walks that end in a group: what the group remembers of each, ascending, and for each the time to each of its nodes.
#[derive(Clone, Default)]
struct Ends {
    sets: Vec<u16>,
    /// A row of [`Relaxation::width`] for each set; infinite where there is no such node or walk.
    secs: Vec<f32>,
}

/// A shortest walk.
pub(super) struct Walk {
    /// Its time less all tolls, rounded down; infinite where every walk is longer than the known tour.
    pub(super) secs: f64,
    /// The groups it stops at, in order.
    pub(super) groups: Vec<usize>,
    /// Additions that it took.
    pub(super) additions: usize,
}

/// The times as the walks need them.
pub(super) struct Relaxation<'a> {
    pub(super) groups: &'a [Range<usize>],
    level: SimdLevel,
    /// See [`width`].
    width: usize,
    /// For each two groups, for each [`LANES`] nodes of the second, for each node of the first the times to them, infinite where
    /// there is none.
    steps: Vec<[f32; LANES]>,
    /// For each group the times from home to its nodes.
    home: Vec<f32>,
}

impl<'a> Relaxation<'a> {
    pub(super) fn new(groups: &'a [Range<usize>], costs: &Costs, level: SimdLevel) -> Self {
        let width = width(groups);
        let padded = |row: &[f64], group: &Range<usize>| -> Vec<f32> {
            let secs = row[group.clone()].iter().map(|secs| *secs as f32);
            secs.chain(std::iter::repeat(f32::INFINITY)).take(width).collect()
        };
        let block = |from: &Range<usize>, to: &Range<usize>| -> Vec<[f32; LANES]> {
            let rows: Vec<_> = from.clone().map(|node| padded(costs.row(node), to)).collect();
            let lanes = |chunk: usize, node: usize| rows.get(node).and_then(|row| row.as_chunks().0.get(chunk).copied());
            let each = (0..width / LANES).flat_map(|chunk| (0..width).map(move |node| (chunk, node)));
            each.map(|(chunk, node)| lanes(chunk, node).unwrap_or([f32::INFINITY; LANES])).collect()
        };
        let steps = groups.iter().flat_map(|from| groups.iter().flat_map(move |to| block(from, to))).collect();
        let home = groups.iter().flat_map(|group| padded(costs.row(costs.nodes), group)).collect();
        Self { groups, level, width, steps, home }
    }

    /// A row of lanes for each node of `from`: the times to those of a chunk of `to`'s.
    #[inline(always)]
    fn steps(&self, from: usize, to: usize, chunk: usize) -> &[[f32; LANES]] {
        let chunks = self.width / LANES;
        &self.steps[((from * self.groups.len() + to) * chunks + chunk) * self.width..][..self.width]
    }

    fn home(&self, group: usize) -> &[f32] {
        &self.home[group * self.width..][..self.width]
    }

    /// For each group the `count` nearest others.
    pub(super) fn nearest(&self, count: usize) -> Vec<Vec<usize>> {
        let groups = self.groups.len();
        let chunks = 0..self.width / LANES;
        let steps = |from: usize, to: usize| chunks.clone().flat_map(move |chunk| self.steps(from, to, chunk).as_flattened());
        let apart = |from: usize, to: usize| steps(from, to).copied().fold(f32::INFINITY, least);
        let nearest = |from: usize| {
            let mut others: Vec<_> = (0..groups).filter(|to| *to != from).map(|to| (apart(from, to), to)).collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0));
            others.into_iter().take(count).map(|(_, to)| to).collect()
        };
        (0..groups).map(nearest).collect()
    }

    pub(super) fn shortest_walk(&self, first: &Memories, memories: &Memories, tolls: &[f64], tour_secs: f64) -> Walk {
        let stops = self.groups.len();
        let all_tolls: f64 = tolls.iter().sum();
        let tolls: Vec<f32> = tolls.iter().map(|toll| *toll as f32).collect();
        // Sums of single precision: each addition is off by half a unit in the last place of the sum at most.
        let largest = tour_secs + tolls.iter().map(|toll| f64::from(toll.abs())).sum::<f64>();
        let slack_secs = 2.0 * stops as f64 * f64::from(f32::EPSILON) * largest;
        let (whole, mut additions) = self.layers(first, &tolls, stops, |_, _, _| true);
        let grown = memories.lists != first.lists;
        let layers = if grown {
            let on = self.onward(&whole, &tolls);
            let limit = (tour_secs + all_tolls + slack_secs) as f32;
            let is_open = |stop: usize, group: usize, secs: &[f32]| {
                let on = &on[stop][group * self.width..][..self.width];
                secs.iter().zip(on).any(|(so_far, on)| so_far + on <= limit)
            };
            let (halves, more) = self.layers(memories, &tolls, stops / 2 + 1, is_open);
            additions += more;
            halves
        } else {
            whole
        };
        let (secs, groups) = self.meet(&layers, memories, &tolls);
        Walk { secs: f64::from(secs) - all_tolls - slack_secs, groups, additions }
    }

    /// Walks from home of one stop, two stops and so on, those left out that are not open.
    fn layers(
        &self,
        memories: &Memories,
        tolls: &[f32],
        stops: usize,
        is_open: impl Fn(usize, usize, &[f32]) -> bool + Sync,
    ) -> (Vec<Vec<Ends>>, usize) {
        let begun =
            |group: usize| Ends { sets: vec![0], secs: self.home(group).iter().map(|secs| secs + tolls[group]).collect() };
        let mut layers: Vec<Vec<Ends>> = vec![(0..self.groups.len()).map(begun).collect()];
        let mut labels = 0;
        for stop in 1..stops {
            let before = &layers[stop - 1];
            let next: Vec<Ends> = (0..self.groups.len())
                .into_par_iter()
                .map(|to| {
                    let step = Step { relaxation: self, memories, before, to };
                    let mut ends = self.level.run(step);
                    ends.secs.iter_mut().for_each(|secs| *secs += tolls[to]);
                    ends.keep(self.width, |secs| is_open(stop, to, secs));
                    ends
                })
                .collect();
            labels += before.iter().map(|ends| ends.sets.len()).sum::<usize>();
            layers.push(next);
        }
        (layers, labels * self.groups.len() * self.width * self.width)
    }

    /// For each number of stops before, for each node: the least time that a walk takes from there on home.
    fn onward(&self, whole: &[Vec<Ends>], tolls: &[f32]) -> Vec<Vec<f32>> {
        let least_of = |ends: &Ends, toll: f32| {
            let mut on = vec![f32::INFINITY; self.width];
            for row in ends.secs.chunks_exact(self.width) {
                on.iter_mut().zip(row).for_each(|(on, secs)| *on = least(*secs - toll, *on));
            }
            on
        };
        whole.iter().rev().map(|layer| layer.iter().zip(tolls).flat_map(|(ends, toll)| least_of(ends, *toll)).collect()).collect()
    }

    /// The shortest walk of two halves that end at the same node and of which neither remembers what the other does.
    fn meet(&self, layers: &[Vec<Ends>], memories: &Memories, tolls: &[f32]) -> (f32, Vec<usize>) {
        let stops = self.groups.len();
        let there = (stops - 1) / 2;
        let back = stops - 1 - there;
        let met = (0..stops).into_par_iter().map(|group| self.meet_in(group, &layers[there], &layers[back], tolls[group]));
        let nearest = met.collect::<Vec<_>>().into_iter().reduce(|best, next| if next.secs < best.secs { next } else { best });
        let Some(meeting) = nearest.filter(|meeting| meeting.secs < f32::INFINITY) else { return (f32::INFINITY, Vec::new()) };
        let half = |stop: usize, set: u16| self.trace(layers, memories, stop, End { set, ..meeting.end });
        let mut groups = half(there, meeting.sets[0]);
        groups.reverse();
        groups.extend(half(back, meeting.sets[1]).into_iter().skip(1));
        (meeting.secs, groups)
    }

    fn meet_in(&self, group: usize, there: &[Ends], back: &[Ends], toll: f32) -> Meeting {
        let end = End { group, node: 0, set: 0 };
        let mut best = Meeting { secs: f32::INFINITY, end, sets: [0; 2] };
        let (first, second) = (there[group].by_least(self.width), back[group].by_least(self.width));
        for (least_there, set, secs) in &first {
            for (least_back, other, on) in &second {
                if least_there + least_back - toll >= best.secs {
                    break;
                }
                if set & other == 0 {
                    for (node, (so_far, on)) in secs.iter().zip(*on).enumerate() {
                        let secs = so_far + on - toll;
                        if secs < best.secs {
                            best = Meeting { secs, end: End { group, node, set: 0 }, sets: [*set, *other] };
                        }
                    }
                }
            }
        }
        best
    }

    /// The groups of a half, from its end back to its first stop.
    fn trace(&self, layers: &[Vec<Ends>], memories: &Memories, stop: usize, end: End) -> Vec<usize> {
        let mut here = end;
        let mut groups = vec![here.group];
        for layer in layers[..stop].iter().rev() {
            let mut best = (f32::INFINITY, here);
            for (group, ends) in layer.iter().enumerate().filter(|(group, _)| *group != here.group) {
                let passed_on = memories.passed_on(group, here.group);
                let steps = self.steps(group, here.group, here.node / LANES);
                let rows = ends.sets.iter().zip(ends.secs.chunks_exact(self.width));
                for (set, row) in rows.filter(|(set, _)| passed_on[usize::from(**set)] == here.set) {
                    for (node, so_far) in row.iter().enumerate() {
                        let secs = so_far + steps[node][here.node % LANES];
                        if secs < best.0 {
                            best = (secs, End { group, node, set: *set });
                        }
                    }
                }
            }
            here = best.1;
            groups.push(here.group);
        }
        groups
    }
}

/// Where a walk ends: at which node of a group, and what the group remembers of it.
#[derive(Clone, Copy)]
struct End {
    group: usize,
    node: usize,
    set: u16,
}

/// Where two halves meet, and what is remembered of each.
struct Meeting {
    secs: f32,
    end: End,
    sets: [u16; 2],
}

impl Ends {
    /// Leaves out walks that are not open.
    fn keep(&mut self, width: usize, is_open: impl Fn(&[f32]) -> bool) {
        let mut kept = Self::default();
        for (set, row) in self.sets.iter().zip(self.secs.chunks_exact(width)).filter(|(_, row)| is_open(row)) {
            kept.sets.push(*set);
            kept.secs.extend(row);
        }
        *self = kept;
    }

    /// Every set with its least time and its times, the least first.
    fn by_least(&self, width: usize) -> Vec<(f32, u16, &[f32])> {
        let rows = self.sets.iter().zip(self.secs.chunks_exact(width));
        let mut rows: Vec<_> = rows.map(|(set, row)| (row.iter().copied().fold(f32::INFINITY, least), *set, row)).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows
    }
}

/// From all groups to one.
struct Step<'a> {
    relaxation: &'a Relaxation<'a>,
    memories: &'a Memories,
    before: &'a [Ends],
    to: usize,
}

impl Kernel for Step<'_> {
    type Output = Ends;

    #[inline(always)]
    fn run(self) -> Ends {
        let Self { relaxation, memories, before, to } = self;
        let width = relaxation.width;
        let sets = 1 << memories.lists[to].len();
        let mut secs = vec![f32::INFINITY; sets * width];
        let mut met = vec![false; sets];
        for (from, ends) in before.iter().enumerate().filter(|(from, _)| *from != to) {
            let passed_on = memories.passed_on(from, to);
            for (set, row) in ends.sets.iter().zip(ends.secs.chunks_exact(width)) {
                let set = passed_on[usize::from(*set)];
                if set != FORBIDDEN {
                    met[usize::from(set)] = true;
                    let so_far = &row[..relaxation.groups[from].len()];
                    let (best, _) = secs[usize::from(set) * width..][..width].as_chunks_mut();
                    for (chunk, best) in best.iter_mut().enumerate() {
                        go_on(so_far, relaxation.steps(from, to, chunk), best);
                    }
                }
            }
        }
        let sets: Vec<u16> = (0..sets).filter(|set| met[*set]).map(|set| set as u16).collect();
        let secs = sets.iter().flat_map(|set| &secs[usize::from(*set) * width..][..width]).copied().collect();
        Ends { sets, secs }
    }
}

/// Improves the times to some nodes by steps from nodes at `so_far`.
#[inline(always)]
fn go_on(so_far: &[f32], steps: &[[f32; LANES]], best: &mut [f32; LANES]) {
    let mut now = *best;
    for (so_far, row) in so_far.iter().zip(steps) {
        for lane in 0..LANES {
            now[lane] = least(so_far + row[lane], now[lane]);
        }
    }
    *best = now;
}
