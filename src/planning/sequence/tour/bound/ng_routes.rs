//! Shortest ng-routes from home with one stop for each group and back, by dynamic programming over the number of stops;
//! [`super`] has the recursion and its sources.
//!
//! Times are the same both ways, so forward and backward labels are equal: half routes are grown once, and two are joined at a
//! node. A label is pruned where its completion bound, computed with the initial ng-sets, exceeds the limit; an arc is
//! eliminated where every route through it does.
//!
//! Cost: see [`super::lanes`], for each number of stops up to half of all for each group.

use std::ops::Range;

use rayon::prelude::*;

use super::super::Costs;
use super::lanes::{Arcs, Extension, INFINITE, LANES, LaneCosts, NgLabels, SubsetMinimum, at};
use super::ng_sets::NgSets;
use crate::geometry::{SimdLevel, parallel, simd_min, sort_ascending};

/// Terms of the routes that are looked for.
#[derive(Clone, Copy)]
pub(super) struct Terms<'a> {
    /// The ng-sets.
    pub(super) ng_sets: &'a NgSets,
    /// The ng-sets before they grew by cycles: a prefix of each list.
    pub(super) initial_sets: &'a NgSets,
    /// Multipliers of the groups, seconds: added at each stop, and taken off the sum once.
    pub(super) multipliers: &'a [f64],
    /// Longer routes do not matter.
    pub(super) limit_secs: f64,
    /// Prunes labels by completion bounds; worth it where the limit is near.
    pub(super) uses_completion_bounds: bool,
}

/// A shortest ng-route.
pub(super) struct NgRoute {
    /// Time with all multipliers, rounded down; infinite where every route is longer than the limit.
    pub(super) secs: f64,
    /// Groups of its stops, in order.
    pub(super) groups: Vec<usize>,
    /// Nodes of its stops, in order.
    pub(super) nodes: Vec<usize>,
    /// Labels of all half routes.
    pub(super) labels: usize,
    /// Additions that it took, in rows of lanes.
    pub(super) work: usize,
}

/// The instance: arcs between groups that are not eliminated.
#[derive(Clone)]
pub(super) struct Relaxation<'a> {
    pub(super) groups: &'a [Range<usize>],
    level: SimdLevel,
    chunks: usize,
    arcs: Arcs,
    /// Times from home to the nodes of each group.
    home: Vec<LaneCosts>,
}

/// Completion bounds of one layer: for each group and each set, the least time home of a route whose memory lies within it.
type CompletionBounds = Vec<Vec<LaneCosts>>;

/// Labels of all half routes.
struct HalfRoutes {
    multipliers: Vec<f32>,
    /// Limit of the times with multipliers.
    limit: f32,
    /// Time to be taken off those: the sum of the multipliers, and the rounding of single precision.
    off_secs: f64,
    /// Completion bounds for each number of stops; none where labels are not pruned.
    completion: Vec<CompletionBounds>,
    /// Labels in each group for each number of stops.
    layers: Vec<Vec<NgLabels>>,
    work: usize,
}

impl<'a> Relaxation<'a> {
    pub(super) fn new(groups: &'a [Range<usize>], costs: &Costs, chunks: usize, level: SimdLevel) -> Self {
        let lanes = |row: &[f64], group: &Range<usize>, chunk: usize| {
            let row = &row[group.clone()];
            LaneCosts(std::array::from_fn(|lane| row.get(chunk * LANES + lane).map_or(f32::INFINITY, |secs| *secs as f32)))
        };
        let mut arcs = Arcs { groups: groups.len(), chunks, first: vec![0], from: Vec::new(), secs: Vec::new() };
        for (to, into) in groups.iter().enumerate() {
            for (from, nodes) in groups.iter().enumerate() {
                for chunk in 0..chunks {
                    for (number, node) in nodes.clone().enumerate().filter(|_| from != to) {
                        arcs.from.push(number as u16);
                        arcs.secs.push(lanes(costs.row(node), into, chunk));
                    }
                    arcs.first.push(arcs.from.len() as u32);
                }
            }
        }
        let home = costs.row(costs.nodes);
        let home = groups.iter().flat_map(|group| (0..chunks).map(move |chunk| lanes(home, group, chunk))).collect();
        Self { groups, level, chunks, arcs, home }
    }

    /// The `count` nearest other groups of each group.
    pub(super) fn nearest(&self, count: usize) -> Vec<Vec<usize>> {
        let groups = self.groups.len();
        let apart = |from: usize, to: usize| {
            let arcs = &self.arcs.secs[self.arcs.between(from, to)];
            arcs.iter().flat_map(|secs| secs.0).fold(f32::INFINITY, simd_min)
        };
        let nearest = |from: usize| {
            let mut others: Vec<_> = (0..groups).filter(|to| *to != from).map(|to| (apart(from, to), to)).collect();
            sort_ascending(&mut others, |(secs, _)| f64::from(*secs));
            others.into_iter().take(count).map(|(_, to)| to).collect()
        };
        (0..groups).map(nearest).collect()
    }

    pub(super) fn shortest_route(&self, terms: &Terms<'_>) -> NgRoute {
        let halves = self.halves(terms, terms.uses_completion_bounds);
        let labels = halves.layers.iter().flatten().map(|labels| labels.sets.len()).sum();
        let (secs, stops) = self.join_halves(&halves, terms.ng_sets);
        NgRoute {
            secs: f64::from(secs) - halves.off_secs,
            groups: stops.iter().map(|label| label.group).collect(),
            nodes: stops.iter().map(|label| self.groups[label.group].start + label.node).collect(),
            labels,
            work: halves.work,
        }
    }

    /// Eliminates arcs that no route within the limit uses in either direction; returns the work.
    pub(super) fn eliminate_arcs(&mut self, terms: &Terms<'_>) -> usize {
        let halves = self.halves(terms, true);
        let merged: Vec<_> =
            halves.layers[..self.groups.len() / 2].iter().map(|layer| self.merged(layer, terms.ng_sets)).collect();
        let through_arcs = |to: usize| {
            let mut known = vec![INFINITE; self.arcs.to(to).len()];
            for (merged, completion) in merged.iter().zip(&halves.completion[1..]) {
                known = self.extension(to, merged, &halves, terms, Some(completion)).through_arcs(known, self.level);
            }
            known
        };
        let through_arcs: Vec<LaneCosts> = (0..self.groups.len()).into_par_iter().flat_map_iter(through_arcs).collect();
        self.keep(&through_arcs, halves.limit);
        2 * halves.work
    }

    /// Keeps the arcs that take at most the limit one way or the other.
    fn keep(&mut self, secs: &[LaneCosts], limit: f32) {
        let old = &self.arcs;
        let mut kept = Arcs { first: vec![0], from: Vec::new(), secs: Vec::new(), ..*old };
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
                    let is_open = |lane: usize| simd_min(secs[at].0[lane], back(from, node, to, chunk * LANES + lane)) <= limit;
                    let row =
                        LaneCosts(std::array::from_fn(|lane| if is_open(lane) { old.secs[at].0[lane] } else { f32::INFINITY }));
                    if row.0.iter().any(|secs| secs.is_finite()) {
                        kept.from.push(node as u16);
                        kept.secs.push(row);
                    }
                }
                kept.first.push(kept.from.len() as u32);
            }
        }
        self.arcs = kept;
    }

    /// Grows the half routes; `uses_completion_bounds` as in [`Terms`].
    fn halves(&self, terms: &Terms<'_>, uses_completion_bounds: bool) -> HalfRoutes {
        let stops = self.groups.len();
        let sum_of_multipliers: f64 = terms.multipliers.iter().sum();
        // Sums of single precision: each addition is off by half a unit in the last place of the sum at most.
        let largest = terms.limit_secs + terms.multipliers.iter().map(|multiplier| multiplier.abs()).sum::<f64>();
        let slack_secs = 2.0 * stops as f64 * f64::from(f32::EPSILON) * largest;
        let off_secs = sum_of_multipliers + slack_secs;
        let multipliers: Vec<_> = terms.multipliers.iter().map(|multiplier| *multiplier as f32).collect();
        let limit = (terms.limit_secs + off_secs) as f32;
        let mut halves = HalfRoutes { multipliers, limit, off_secs, completion: Vec::new(), layers: Vec::new(), work: 0 };
        if uses_completion_bounds {
            self.compute_completion_bounds(&mut halves, terms);
        }
        halves.layers.push(self.initial_labels(&halves.multipliers));
        for stop in 1..=stops / 2 {
            let next = self.extended(&halves.layers[stop - 1], &halves, terms, halves.completion.get(stop));
            halves.work += next.1;
            halves.layers.push(next.0);
        }
        halves
    }

    /// Labels of one stop.
    fn initial_labels(&self, multipliers: &[f32]) -> Vec<NgLabels> {
        let initial_labels = |(home, multiplier): (&[LaneCosts], &f32)| {
            let secs = home.iter().map(|secs| LaneCosts(secs.0.map(|secs| secs + multiplier))).collect();
            NgLabels { sets: vec![0], secs, work: 0 }
        };
        self.home.chunks_exact(self.chunks).zip(multipliers).map(initial_labels).collect()
    }

    /// Labels of each group, merged by each of its masks.
    fn merged(&self, layer: &[NgLabels], ng_sets: &NgSets) -> Vec<Vec<NgLabels>> {
        let merged = |(group, labels): (usize, &NgLabels)| {
            let masks = ng_sets.masks[group].iter();
            masks.map(|mask| labels.merged(*mask, ng_sets.bits(group), self.chunks, self.level)).collect()
        };
        layer.par_iter().enumerate().map(merged).collect()
    }

    fn extension<'b>(
        &'b self,
        to: usize,
        merged: &'b [Vec<NgLabels>],
        halves: &HalfRoutes,
        terms: &Terms<'b>,
        completion: Option<&'b CompletionBounds>,
    ) -> Extension<'b> {
        let completion = completion.map(|completion| (&completion[to][..], terms.initial_sets.all(to)));
        Extension {
            arcs: &self.arcs,
            ng_sets: terms.ng_sets,
            merged,
            to,
            multiplier: halves.multipliers[to],
            completion,
            limit: halves.limit,
        }
    }

    /// Labels of one stop more, and the work.
    fn extended(
        &self,
        layer: &[NgLabels],
        halves: &HalfRoutes,
        terms: &Terms<'_>,
        completion: Option<&CompletionBounds>,
    ) -> (Vec<NgLabels>, usize) {
        let merged = self.merged(layer, terms.ng_sets);
        let labels = |to: usize| self.extension(to, &merged, halves, terms, completion).labels(self.level);
        let next = parallel::map_range(self.groups.len(), labels);
        let work = merged.iter().flatten().chain(&next).map(|labels| labels.work).sum();
        (next, work)
    }

    /// Computes completion bounds with the initial ng-sets: routes of as many stops as are left, turned round.
    fn compute_completion_bounds(&self, halves: &mut HalfRoutes, terms: &Terms<'_>) {
        let stops = self.groups.len();
        let initial = Terms { ng_sets: terms.initial_sets, ..*terms };
        let mut layer = self.initial_labels(&halves.multipliers);
        for stop in 0..stops {
            if stop > 0 {
                // Beyond half of all stops, the bounds known by then prune the others.
                let next = self.extended(&layer, halves, &initial, halves.completion.get(stops - 1 - stop));
                layer = next.0;
                halves.work += next.1;
            }
            let completions = layer
                .par_iter()
                .enumerate()
                .map(|(group, labels)| self.completions(group, labels, initial.ng_sets, halves.multipliers[group]));
            let completions: CompletionBounds = completions.collect();
            halves.work += completions.iter().map(Vec::len).sum::<usize>();
            halves.completion.push(completions);
        }
        halves.completion.reverse();
    }

    fn completions(&self, group: usize, labels: &NgLabels, ng_sets: &NgSets, multiplier: f32) -> Vec<LaneCosts> {
        let (bits, critical_bits) = (ng_sets.bits(group), ng_sets.critical_bits(group));
        self.level.run(SubsetMinimum { labels, bits, critical_bits, chunks: self.chunks, multiplier })
    }

    /// Joins two half routes at a node: the shortest pair whose memories are disjoint and hold all critical groups together.
    fn join_halves(&self, halves: &HalfRoutes, ng_sets: &NgSets) -> (f32, Vec<NgLabel>) {
        let stops = self.groups.len();
        let there = (stops - 1) / 2;
        let back = stops - 1 - there;
        let join_at = |group: usize| {
            let labels = [there, back].map(|stop| &halves.layers[stop][group]);
            self.join_at(group, labels, ng_sets, halves.multipliers[group])
        };
        let junctions = parallel::map_range(stops, join_at);
        let shortest = junctions.into_iter().reduce(|best, next| if next.secs < best.secs { next } else { best });
        let Some(junction) = shortest.filter(|junction| junction.secs < f32::INFINITY) else {
            return (f32::INFINITY, Vec::new());
        };
        let half = |stop: usize, set: u16| self.backtrack(&halves.layers[..stop], ng_sets, NgLabel { set, ..junction.label });
        let mut route = half(there, junction.sets[0]);
        route.reverse();
        route.extend(half(back, junction.sets[1]).into_iter().skip(1));
        (junction.secs, route)
    }

    fn join_at(&self, group: usize, [there, back]: [&NgLabels; 2], ng_sets: &NgSets, multiplier: f32) -> Junction {
        let completions = self.completions(group, back, ng_sets, multiplier);
        let mut best = Junction { secs: f32::INFINITY, label: NgLabel { group, node: 0, set: 0 }, sets: [0; 2] };
        for (set, row) in there.rows(self.chunks) {
            let on = &completions[usize::from(ng_sets.all(group) & !set) * self.chunks..][..self.chunks];
            for node in 0..self.groups[group].len() {
                let secs = at(row, node) + at(on, node);
                if secs < best.secs {
                    best = Junction { secs, label: NgLabel { group, node, set: 0 }, sets: [set, 0] };
                }
            }
        }
        let critical = (1 << ng_sets.critical_bits(group)) - 1;
        let fits = |set: u16| set & best.sets[0] == 0 && (set | best.sets[0]) & critical == critical;
        let fitting = back.rows(self.chunks).filter(|(set, _)| fits(*set));
        let shortest = fitting.min_by(|a, b| at(a.1, best.label.node).total_cmp(&at(b.1, best.label.node)));
        best.sets[1] = shortest.map_or(0, |(set, _)| set);
        best
    }

    /// The stops of a half route, from its last label back to the first; `layers` are those before it.
    fn backtrack(&self, layers: &[Vec<NgLabels>], ng_sets: &NgSets, label: NgLabel) -> Vec<NgLabel> {
        let mut here = label;
        let mut stops = vec![here];
        for layer in layers.iter().rev() {
            let mut best = (f32::INFINITY, here);
            for (group, labels) in layer.iter().enumerate().filter(|(group, _)| *group != here.group) {
                let pair = ng_sets.pair(group, here.group);
                let arcs = self.arcs.to_chunk(group, here.group, here.node / LANES);
                for (set, row) in labels.rows(self.chunks).filter(|(set, _)| pair.extended(*set) == here.set) {
                    for (node, step) in self.arcs.from[arcs.clone()].iter().zip(&self.arcs.secs[arcs.clone()]) {
                        let node = usize::from(*node);
                        let secs = at(row, node) + step.0[here.node % LANES];
                        if secs < best.0 {
                            best = (secs, NgLabel { group, node, set });
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

/// One label: the node of a group where a route ends, and its memory.
#[derive(Clone, Copy)]
struct NgLabel {
    group: usize,
    node: usize,
    set: u16,
}

/// A node where two half routes are joined, and the memory of each.
struct Junction {
    secs: f32,
    label: NgLabel,
    sets: [u16; 2],
}
