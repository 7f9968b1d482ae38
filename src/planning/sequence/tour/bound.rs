//! A time that no tour can be shorter than, for tours too long to be proved shortest.
//!
//! Closed walks from home with one stop for each group are cheaper than tours: they may stop at a group twice and pass over
//! another. The shortest is found by dynamic programming over the number of stops, walks that go from a group to another
//! and straight back left out (N. Christofides, A. Mingozzi and P. Toth, "State-space relaxation procedures for the
//! computation of bounds to routing problems", Networks 11, 1981); a toll on groups that it stops at too often, and a reward
//! for those that it passes over, raise it towards the tour (M. Held and R. Karp's multipliers, by subgradient). Any tolls
//! give a valid bound. Cost: O(groups · nodes²) a round.

use std::ops::Range;

use rayon::prelude::*;

use super::Costs;
use crate::planning::context::{Cancelled, Context};

/// Rounds of multipliers at most, …
const ROUNDS: f64 = 200.0;
/// … and steps from node to node in all of them, a few seconds' worth.
const STEPS: f64 = 3e9;
/// Rounds without gain after which steps are halved.
const PATIENCE: u32 = 8;
/// A gap smaller than this share of the tour is closed.
const CLOSED: f64 = 1e-6;
/// No group.
const HOME: u32 = u32::MAX;

/// The shortest walk to a node, and the shortest whose last stop before was in another group.
#[derive(Clone, Copy)]
struct Labels {
    secs: [f64; 2],
    /// Group of the stop before.
    group: [u32; 2],
    /// Node of the stop before, and which of its labels.
    from: [(u32, u8); 2],
}

const NONE: Labels = Labels { secs: [f64::INFINITY; 2], group: [HOME; 2], from: [(u32::MAX, 0); 2] };

impl Labels {
    fn offer(&mut self, secs: f64, group: u32, from: (u32, u8)) {
        if secs < self.secs[0] {
            if group != self.group[0] {
                (self.secs[1], self.group[1], self.from[1]) = (self.secs[0], self.group[0], self.from[0]);
            }
            (self.secs[0], self.group[0], self.from[0]) = (secs, group, from);
        } else if secs < self.secs[1] && group != self.group[0] {
            (self.secs[1], self.group[1], self.from[1]) = (secs, group, from);
        }
    }

    /// The label that a walk may go on from to `group`.
    fn towards(&self, group: u32) -> usize {
        usize::from(self.group[0] == group)
    }
}

/// A lower bound of the shortest tour; `tour_secs` is the time of one that is known.
pub(super) fn at_least(groups: &[Range<usize>], costs: &Costs, tour_secs: f64, ctx: &Context<'_>) -> Result<f64, Cancelled> {
    let mut tolls = vec![0.0; groups.len()];
    let (mut best, mut share, mut waited) = (0.0_f64, 1.0, 0);
    let rounds = (STEPS / (groups.len() * costs.nodes * costs.nodes) as f64).clamp(4.0, ROUNDS) as u32;
    for _ in 0..rounds {
        ctx.check()?;
        let (secs, stops) = shortest_walk(groups, costs, &tolls);
        waited = if secs > best { 0 } else { waited + 1 };
        best = best.max(secs);
        let off: f64 = stops.iter().map(|stops| (f64::from(*stops) - 1.0).powi(2)).sum();
        if off == 0.0 || tour_secs - best <= CLOSED * tour_secs {
            break;
        }
        if waited == PATIENCE {
            (share, waited) = (0.5 * share, 0);
        }
        let step = share * (tour_secs - secs) / off;
        tolls.iter_mut().zip(&stops).for_each(|(toll, stops)| *toll += step * (f64::from(*stops) - 1.0));
    }
    Ok(best.min(tour_secs))
}

/// Time of the shortest closed walk under these tolls, less all tolls; and how often it stops at each group.
fn shortest_walk(groups: &[Range<usize>], costs: &Costs, tolls: &[f64]) -> (f64, Vec<u32>) {
    let group_of: Vec<u32> = groups.iter().zip(0_u32..).flat_map(|(group, number)| vec![number; group.len()]).collect();
    let mut layers = vec![vec![NONE; costs.nodes]];
    for node in 0..costs.nodes {
        layers[0][node].offer(costs.home(node) + tolls[group_of[node] as usize], HOME, (u32::MAX, 0));
    }
    for _ in 1..groups.len() {
        let before = &layers[layers.len() - 1];
        let next = groups.par_iter().zip(0_u32..groups.len() as u32).map(|(to, number)| {
            // Walks that may go on to this group, and where they are: the same for each of its nodes.
            let open: Vec<(f64, u8)> =
                before.iter().map(|labels| (labels.secs[labels.towards(number)], labels.towards(number) as u8)).collect();
            to.clone().map(|node| step(groups, costs, &open, node, number, tolls[number as usize])).collect::<Vec<_>>()
        });
        layers.push(next.collect::<Vec<_>>().concat());
    }
    close(&layers, costs, &group_of, tolls)
}

/// Labels of a node from those of the layer before.
fn step(groups: &[Range<usize>], costs: &Costs, open: &[(f64, u8)], node: usize, number: u32, toll: f64) -> Labels {
    let row = &costs.secs[node * (costs.nodes + 1)..][..costs.nodes];
    let mut labels = NONE;
    for (from, group) in groups.iter().zip(0_u32..).filter(|(_, group)| *group != number) {
        let ways = from.clone().map(|at| (open[at].0 + row[at], at));
        let least = ways.fold((f64::INFINITY, usize::MAX), |least, way| if way.0 < least.0 { way } else { least });
        if least.1 != usize::MAX {
            labels.offer(least.0 + toll, group, (least.1 as u32, open[least.1].1));
        }
    }
    labels
}

fn close(layers: &[Vec<Labels>], costs: &Costs, group_of: &[u32], tolls: &[f64]) -> (f64, Vec<u32>) {
    let last = &layers[layers.len() - 1];
    let closed = |node: &usize| last[*node].secs[0] + costs.home(*node);
    let end = (0..costs.nodes).min_by(|a, b| closed(a).total_cmp(&closed(b))).unwrap_or(0);
    let mut stops = vec![0; tolls.len()];
    let (mut node, mut label) = (end, 0);
    for layer in layers.iter().rev() {
        stops[group_of[node] as usize] += 1;
        let (from, of) = layer[node].from[label];
        (node, label) = (from as usize, usize::from(of));
        if from == u32::MAX {
            break;
        }
    }
    (closed(&end) - tolls.iter().sum::<f64>(), stops)
}
