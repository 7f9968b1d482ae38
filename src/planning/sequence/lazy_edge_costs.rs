//! Edge costs between stations, evaluated lazily: the order is found with no more moves checked than it needs.

use std::collections::{BTreeSet, HashMap};

use super::moves::straight_secs;
use super::routes::{Route, Routes};
use super::station_graph::StationGraph;
use super::tour::{self, Costs, EXACT_GROUPS, Effort};
use crate::cell::Axes;
use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::MotionParams;

/// Checked moves between two nodes, and how much longer than straight ones those between two views were.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LazyEdgeCosts {
    /// Checked routes, from the lower number to the higher.
    checked: HashMap<(usize, usize), Route>,
    /// Sum and count of the seconds by which checked moves between two views took longer than straight ones.
    detours: HashMap<(usize, usize), (f64, f64)>,
}

impl LazyEdgeCosts {
    /// Nodes in the order visited; every move between them is checked then.
    ///
    /// The search takes moves that were not checked as straight where its tour is proved shortest. Else it takes them to be
    /// longer than straight by the mean of the checked ones between the same two views, one more of them taken as straight:
    /// otherwise each blocked move would be exchanged for a neighbour that is not yet known to be blocked, one by one.
    pub(super) fn shortest_tour(
        &mut self,
        graph: &StationGraph,
        routes: &Routes<'_>,
        ctx: &Context<'_>,
    ) -> Result<Vec<usize>, Cancelled> {
        let nodes = &graph.nodes;
        let mut expected = self.lower_bounds(graph, &routes.moves.axes, &routes.moves.motion);
        let (mut tour, mut effort) = (Vec::new(), Effort::Thorough);
        loop {
            let tours = tour::shortest(&graph.groups, &expected, &tour, effort, ctx)?;
            let steps = tours.iter().flat_map(|tour| tour.windows(2)).map(|step| key(step[0], step[1]));
            let unchecked: BTreeSet<_> = steps.filter(|step| !self.checked.contains_key(step)).collect();
            tour = tours.into_iter().next().unwrap_or_default();
            effort = match effort {
                _ if !unchecked.is_empty() => Effort::Brief,
                Effort::Brief => Effort::Again,
                Effort::Thorough | Effort::Again => return Ok(tour),
            };
            let unchecked: Vec<_> = unchecked.into_iter().collect();
            let check = |&(a, b): &(usize, usize)| Ok::<_, Cancelled>(((a, b), routes.between(&nodes[a], &nodes[b], ctx)?));
            let found = parallel::try_map(&unchecked, check)?;
            self.record(found, graph, routes, &mut expected);
        }
    }

    /// The route from one node of a tour to another.
    pub(super) fn route(&self, from: usize, to: usize) -> Route {
        let route = &self.checked[&key(from, to)];
        if from < to { route.clone() } else { route.reversed() }
    }

    /// Lower bounds of the times of free moves: straight where a move was not checked.
    pub(super) fn lower_bounds(&self, graph: &StationGraph, axes: &Axes, motion: &MotionParams) -> Costs {
        let nodes = &graph.nodes;
        let mut costs = Costs::new(nodes.len(), |a, b| match nodes.get(b) {
            Some(other) => straight_secs(axes, &nodes[a].configuration, &other.configuration, motion),
            None => nodes[a].from_home.secs,
        });
        self.checked.iter().for_each(|((a, b), route)| costs.set(*a, *b, route.secs));
        costs
    }

    fn record(&mut self, found: Vec<((usize, usize), Route)>, graph: &StationGraph, routes: &Routes<'_>, expected: &mut Costs) {
        let nodes = &graph.nodes;
        let straight_secs = |a: usize, b: usize| routes.moves.straight_secs(&nodes[a].configuration, &nodes[b].configuration);
        let mut views = BTreeSet::new();
        for ((a, b), route) in found {
            let between = (nodes[a].group, nodes[b].group);
            let detours = self.detours.entry(between).or_default();
            *detours = (detours.0 + route.secs - straight_secs(a, b), detours.1 + 1.0);
            views.insert(between);
            expected.set(a, b, route.secs);
            self.checked.insert((a, b), route);
        }
        if graph.groups.len() <= EXACT_GROUPS {
            return;
        }
        for between in views {
            let (sum_secs, count) = self.detours[&between];
            let pairs = graph.groups[between.0].clone().flat_map(|a| graph.groups[between.1].clone().map(move |b| (a, b)));
            for (a, b) in pairs.filter(|pair| !self.checked.contains_key(pair)) {
                let by_home_secs = nodes[a].from_home.secs + nodes[b].from_home.secs;
                expected.set(a, b, (straight_secs(a, b) + sum_secs / (count + 1.0)).min(by_home_secs));
            }
        }
    }
}

/// Moves can be run either way, so a pair is checked once, from the lower number to the higher.
fn key(a: usize, b: usize) -> (usize, usize) {
    (a.min(b), a.max(b))
}
