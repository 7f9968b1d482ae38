//! Shortest walks from home with one stop for each group and back, by dynamic programming over the number of stops; what they
//! may not come back to is what each group remembers. See [`super`] for where the method is from.
//!
//! Times are the same both ways, so a walk is two halves that meet, and only halves are grown. A half is dropped where no
//! second half, with the memories that were first, makes a walk within the limit; and a step where no walk by way of it is.
//!
//! Cost: see [`super::lanes`], for each number of stops up to half of all for each group.

use std::ops::Range;

use rayon::prelude::*;

use super::super::Costs;
use super::lanes::{Ends, LANES, Lanes, NEVER, Open, Step, Steps, at};
use super::memories::Memories;
use crate::geometry::{SimdLevel, least};

/// Which walks are looked for.
#[derive(Clone, Copy)]
pub(super) struct Terms<'a> {
    /// What each group remembers, …
    pub(super) memories: &'a Memories,
    /// … and what it did first: the first of its list.
    pub(super) first: &'a Memories,
    /// What is added for each stop at a group, seconds, and taken off the sum once.
    pub(super) tolls: &'a [f64],
    /// Walks that take longer matter not.
    pub(super) limit_secs: f64,
    /// Whether halves that no second half completes within the limit are dropped; worth it where the limit is near.
    pub(super) looks_on: bool,
}

/// A shortest walk.
pub(super) struct Walk {
    /// Its time with all tolls, rounded down; infinite where every walk is longer than the limit.
    pub(super) secs: f64,
    /// The groups it stops at, in order, …
    pub(super) groups: Vec<usize>,
    /// … and the nodes.
    pub(super) nodes: Vec<usize>,
    /// Ends of all halves.
    pub(super) labels: usize,
    /// Additions that it took, in rows of lanes.
    pub(super) work: usize,
}

/// The times as the walks need them.
#[derive(Clone)]
pub(super) struct Relaxation<'a> {
    pub(super) groups: &'a [Range<usize>],
    level: SimdLevel,
    chunks: usize,
    steps: Steps,
    /// For each group the times from home to its nodes.
    home: Vec<Lanes>,
}

/// For each group, for each set: what a walk takes on home of which nothing is remembered that is not in the set.
type Onward = Vec<Vec<Lanes>>;

/// Halves of walks.
struct Halves {
    tolls: Vec<f32>,
    /// In times with tolls.
    limit: f32,
    /// To be taken off them.
    off_secs: f64,
    /// For each number of stops, what it takes on home from there; none where nothing was left out.
    onward: Vec<Onward>,
    /// For each number of stops the ends in each group.
    layers: Vec<Vec<Ends>>,
    work: usize,
}

impl<'a> Relaxation<'a> {
    pub(super) fn new(groups: &'a [Range<usize>], costs: &Costs, chunks: usize, level: SimdLevel) -> Self {
        let lanes = |row: &[f64], group: &Range<usize>, chunk: usize| {
            let row = &row[group.clone()];
            Lanes(std::array::from_fn(|lane| row.get(chunk * LANES + lane).map_or(f32::INFINITY, |secs| *secs as f32)))
        };
        let mut steps = Steps { groups: groups.len(), chunks, first: vec![0], from: Vec::new(), secs: Vec::new() };
        for (to, into) in groups.iter().enumerate() {
            for (from, nodes) in groups.iter().enumerate() {
                for chunk in 0..chunks {
                    for (number, node) in nodes.clone().enumerate().filter(|_| from != to) {
                        steps.from.push(number as u16);
                        steps.secs.push(lanes(costs.row(node), into, chunk));
                    }
                    steps.first.push(steps.from.len() as u32);
                }
            }
        }
        let home = costs.row(costs.nodes);
        let home = groups.iter().flat_map(|group| (0..chunks).map(move |chunk| lanes(home, group, chunk))).collect();
        Self { groups, level, chunks, steps, home }
    }

    /// For each group the `count` nearest others.
    pub(super) fn nearest(&self, count: usize) -> Vec<Vec<usize>> {
        let groups = self.groups.len();
        let apart = |from: usize, to: usize| {
            let steps = &self.steps.secs[self.steps.between(from, to)];
            steps.iter().flat_map(|secs| secs.0).fold(f32::INFINITY, least)
        };
        let nearest = |from: usize| {
            let mut others: Vec<_> = (0..groups).filter(|to| *to != from).map(|to| (apart(from, to), to)).collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0));
            others.into_iter().take(count).map(|(_, to)| to).collect()
        };
        (0..groups).map(nearest).collect()
    }

    pub(super) fn shortest_walk(&self, terms: &Terms<'_>) -> Walk {
        let halves = self.halves(terms, terms.looks_on);
        let labels = halves.layers.iter().flatten().map(|ends| ends.sets.len()).sum();
        let (secs, stops) = self.meet(&halves, terms.memories);
        Walk {
            secs: f64::from(secs) - halves.off_secs,
            groups: stops.iter().map(|end| end.group).collect(),
            nodes: stops.iter().map(|end| self.groups[end.group].start + end.node).collect(),
            labels,
            work: halves.work,
        }
    }

    /// Leaves out steps that no walk within the limit takes, neither way; what that cost.
    pub(super) fn thin_out(&mut self, terms: &Terms<'_>) -> usize {
        let halves = self.halves(terms, true);
        let joined: Vec<_> =
            halves.layers[..self.groups.len() / 2].iter().map(|layer| self.joined(layer, terms.memories)).collect();
        let by_way_of = |to: usize| {
            let mut known = vec![NEVER; self.steps.to(to).len()];
            for (joined, onward) in joined.iter().zip(&halves.onward[1..]) {
                known = self.step(to, joined, &halves, terms, Some(onward)).by_way_of(known, self.level);
            }
            known
        };
        let by_way_of: Vec<Lanes> = (0..self.groups.len()).into_par_iter().flat_map_iter(by_way_of).collect();
        self.keep(&by_way_of, halves.limit);
        2 * halves.work
    }

    /// Keeps the steps that take at most the limit one way or the other.
    fn keep(&mut self, secs: &[Lanes], limit: f32) {
        let old = &self.steps;
        let mut kept = Steps { first: vec![0], from: Vec::new(), secs: Vec::new(), ..*old };
        let back = |from: usize, node: usize, to: usize, into: usize| {
            let range = old.to_chunk(to, from, node / LANES);
            let found = old.from[range.clone()].binary_search(&(into as u16));
            found.map_or(f32::INFINITY, |at| secs[range.start + at].0[node % LANES])
        };
        for pair in 0..self.groups.len().pow(2) {
            let (from, to) = (pair % self.groups.len(), pair / self.groups.len());
            for chunk in 0..self.chunks {
                for at in old.to_chunk(from, to, chunk) {
                    let node = usize::from(old.from[at]);
                    let is_open = |lane: usize| least(secs[at].0[lane], back(from, node, to, chunk * LANES + lane)) <= limit;
                    let row = Lanes(std::array::from_fn(|lane| if is_open(lane) { old.secs[at].0[lane] } else { f32::INFINITY }));
                    if row.0.iter().any(|secs| secs.is_finite()) {
                        kept.from.push(node as u16);
                        kept.secs.push(row);
                    }
                }
                kept.first.push(kept.from.len() as u32);
            }
        }
        self.steps = kept;
    }

    /// Half walks; `looks_on` as in [`Terms`].
    fn halves(&self, terms: &Terms<'_>, looks_on: bool) -> Halves {
        let stops = self.groups.len();
        let all_tolls: f64 = terms.tolls.iter().sum();
        // Sums of single precision: each addition is off by half a unit in the last place of the sum at most.
        let largest = terms.limit_secs + terms.tolls.iter().map(|toll| toll.abs()).sum::<f64>();
        let slack_secs = 2.0 * stops as f64 * f64::from(f32::EPSILON) * largest;
        let off_secs = all_tolls + slack_secs;
        let tolls: Vec<_> = terms.tolls.iter().map(|toll| *toll as f32).collect();
        let limit = (terms.limit_secs + off_secs) as f32;
        let mut halves = Halves { tolls, limit, off_secs, onward: Vec::new(), layers: Vec::new(), work: 0 };
        if looks_on {
            self.look_on(&mut halves, terms);
        }
        halves.layers.push(self.begun(&halves.tolls));
        for stop in 1..=stops / 2 {
            let next = self.next(&halves.layers[stop - 1], &halves, terms, halves.onward.get(stop));
            halves.work += next.1;
            halves.layers.push(next.0);
        }
        halves
    }

    /// Walks of one stop.
    fn begun(&self, tolls: &[f32]) -> Vec<Ends> {
        let begun = |(home, toll): (&[Lanes], &f32)| {
            let secs = home.iter().map(|secs| Lanes(secs.0.map(|secs| secs + toll))).collect();
            Ends { sets: vec![0], secs, work: 0 }
        };
        self.home.chunks_exact(self.chunks).zip(tolls).map(begun).collect()
    }

    /// For each group its ends, joined by each of its masks.
    fn joined(&self, layer: &[Ends], memories: &Memories) -> Vec<Vec<Ends>> {
        let joined = |(group, ends): (usize, &Ends)| {
            let masks = memories.masks[group].iter();
            masks.map(|mask| ends.joined(*mask, memories.bits(group), self.chunks, self.level)).collect()
        };
        layer.par_iter().enumerate().map(joined).collect()
    }

    fn step<'b>(
        &'b self,
        to: usize,
        joined: &'b [Vec<Ends>],
        halves: &Halves,
        terms: &Terms<'b>,
        onward: Option<&'b Onward>,
    ) -> Step<'b> {
        let onward = onward.map(|onward| (&onward[to][..], terms.first.all(to)));
        Step { steps: &self.steps, memories: terms.memories, joined, to, toll: halves.tolls[to], onward, limit: halves.limit }
    }

    /// Walks one stop longer, and what they cost.
    fn next(&self, layer: &[Ends], halves: &Halves, terms: &Terms<'_>, onward: Option<&Onward>) -> (Vec<Ends>, usize) {
        let joined = self.joined(layer, terms.memories);
        let ends = |to: usize| self.step(to, &joined, halves, terms, onward).ends(self.level);
        let next: Vec<_> = (0..self.groups.len()).into_par_iter().map(ends).collect();
        let work = joined.iter().flatten().chain(&next).map(|ends| ends.work).sum();
        (next, work)
    }

    /// What walks take on home with the memories that were first: walks of as many stops as those have left, turned round.
    fn look_on(&self, halves: &mut Halves, terms: &Terms<'_>) {
        let stops = self.groups.len();
        let first = Terms { memories: terms.first, ..*terms };
        let mut layer = self.begun(&halves.tolls);
        for stop in 0..stops {
            if stop > 0 {
                // Beyond half of all stops, what is known of the others tells which are left out.
                let next = self.next(&layer, halves, &first, halves.onward.get(stops - 1 - stop));
                layer = next.0;
                halves.work += next.1;
            }
            let open =
                layer.par_iter().enumerate().map(|(group, ends)| self.open(group, ends, first.memories, halves.tolls[group]));
            let open: Onward = open.collect();
            halves.work += open.iter().map(Vec::len).sum::<usize>();
            halves.onward.push(open);
        }
        halves.onward.reverse();
    }

    fn open(&self, group: usize, ends: &Ends, memories: &Memories, toll: f32) -> Vec<Lanes> {
        let (bits, landmark_bits) = (memories.bits(group), memories.landmark_bits(group));
        self.level.run(Open { ends, bits, landmark_bits, chunks: self.chunks, toll })
    }

    /// The shortest walk of two halves that end at the same node, of which neither remembers what the other does, and both
    /// together all landmarks.
    fn meet(&self, halves: &Halves, memories: &Memories) -> (f32, Vec<End>) {
        let stops = self.groups.len();
        let there = (stops - 1) / 2;
        let back = stops - 1 - there;
        let meet_in = |group: usize| {
            let ends = [there, back].map(|stop| &halves.layers[stop][group]);
            self.meet_in(group, ends, memories, halves.tolls[group])
        };
        let met = (0..stops).into_par_iter().map(meet_in).collect::<Vec<_>>();
        let nearest = met.into_iter().reduce(|best, next| if next.secs < best.secs { next } else { best });
        let Some(meeting) = nearest.filter(|meeting| meeting.secs < f32::INFINITY) else { return (f32::INFINITY, Vec::new()) };
        let half = |stop: usize, set: u16| self.trace(&halves.layers[..stop], memories, End { set, ..meeting.end });
        let mut walk = half(there, meeting.sets[0]);
        walk.reverse();
        walk.extend(half(back, meeting.sets[1]).into_iter().skip(1));
        (meeting.secs, walk)
    }

    fn meet_in(&self, group: usize, [there, back]: [&Ends; 2], memories: &Memories, toll: f32) -> Meeting {
        let open = self.open(group, back, memories, toll);
        let mut best = Meeting { secs: f32::INFINITY, end: End { group, node: 0, set: 0 }, sets: [0; 2] };
        for (set, row) in there.rows(self.chunks) {
            let on = &open[usize::from(memories.all(group) & !set) * self.chunks..][..self.chunks];
            for node in 0..self.groups[group].len() {
                let secs = at(row, node) + at(on, node);
                if secs < best.secs {
                    best = Meeting { secs, end: End { group, node, set: 0 }, sets: [set, 0] };
                }
            }
        }
        let landmarks = (1 << memories.landmark_bits(group)) - 1;
        let fits = |set: u16| set & best.sets[0] == 0 && (set | best.sets[0]) & landmarks == landmarks;
        let fitting = back.rows(self.chunks).filter(|(set, _)| fits(*set));
        let nearest = fitting.min_by(|a, b| at(a.1, best.end.node).total_cmp(&at(b.1, best.end.node)));
        best.sets[1] = nearest.map_or(0, |(set, _)| set);
        best
    }

    /// The stops of a half, from its end back to the first; `layers` are those before its end.
    fn trace(&self, layers: &[Vec<Ends>], memories: &Memories, end: End) -> Vec<End> {
        let mut here = end;
        let mut stops = vec![here];
        for layer in layers.iter().rev() {
            let mut best = (f32::INFINITY, here);
            for (group, ends) in layer.iter().enumerate().filter(|(group, _)| *group != here.group) {
                let pair = memories.pair(group, here.group);
                let steps = self.steps.to_chunk(group, here.group, here.node / LANES);
                for (set, row) in ends.rows(self.chunks).filter(|(set, _)| pair.passed_on(*set) == here.set) {
                    for (node, step) in self.steps.from[steps.clone()].iter().zip(&self.steps.secs[steps.clone()]) {
                        let node = usize::from(*node);
                        let secs = at(row, node) + step.0[here.node % LANES];
                        if secs < best.0 {
                            best = (secs, End { group, node, set });
                        }
                    }
                }
            }
            here = best.1;
            stops.push(here);
        }
        stops
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
