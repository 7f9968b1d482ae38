//! What is known of the moves between stations, and the order found with no more of them looked at than it needs.

use std::collections::{BTreeSet, HashMap};

use rayon::prelude::*;

use super::joined::Joined;
use super::moves::straight_secs;
use super::routes::{Route, Routes};
use super::tour::{self, Costs, EXACT_GROUPS, Effort};
use crate::cell::Axes;
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::MotionParams;

/// Moves between two nodes that were looked at, and by how much moves between two views took longer than straight ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Known {
    /// From the lower number to the higher.
    checked: HashMap<(usize, usize), Route>,
    /// Sum and count over those between two views.
    longer: HashMap<(usize, usize), (f64, f64)>,
}

impl Known {
    /// Nodes in the order visited; every move between them is known then.
    ///
    /// Which tour is searched for: where it is proved shortest, the shortest with moves that were not looked at taken as
    /// straight. Else those are taken to be longer than straight by what the ones between the same two views were found to be,
    /// as if one more had been found straight: else each move that is blocked is exchanged for its neighbour that is not known
    /// to be, one by one.
    pub(super) fn shortest_tour(
        &mut self,
        joined: &Joined,
        routes: &Routes<'_>,
        ctx: &Context<'_>,
    ) -> Result<Vec<usize>, Cancelled> {
        let nodes = &joined.nodes;
        let mut expected = self.least(joined, &routes.moves.axes, &routes.moves.motion);
        let (mut tour, mut effort) = (Vec::new(), Effort::Thorough);
        loop {
            let tours = tour::shortest(&joined.groups, &expected, &tour, effort, ctx)?;
            let steps = tours.iter().flat_map(|tour| tour.windows(2)).map(|step| key(step[0], step[1]));
            let unchecked: BTreeSet<_> = steps.filter(|step| !self.checked.contains_key(step)).collect();
            tour = tours.into_iter().next().unwrap_or_default();
            effort = match effort {
                _ if !unchecked.is_empty() => Effort::Brief,
                Effort::Brief => Effort::Again,
                Effort::Thorough | Effort::Again => return Ok(tour),
            };
            let check = |(a, b): (usize, usize)| Ok(((a, b), routes.between(&nodes[a], &nodes[b], ctx)?));
            let found: Vec<_> = unchecked.into_par_iter().map(check).collect::<Result<_, Cancelled>>()?;
            self.learn(found, joined, routes, &mut expected);
        }
    }

    /// The way from one node to another of a tour.
    pub(super) fn route(&self, from: usize, to: usize) -> Route {
        let route = &self.checked[&key(from, to)];
        if from < to { route.clone() } else { route.reversed() }
    }

    /// Times of which none is longer than that of a free move: straight where nothing is known.
    pub(super) fn least(&self, joined: &Joined, axes: &Axes, motion: &MotionParams) -> Costs {
        let nodes = &joined.nodes;
        let mut costs = Costs::new(nodes.len(), |a, b| match nodes.get(b) {
            Some(other) => straight_secs(axes, &nodes[a].configuration, &other.configuration, motion),
            None => nodes[a].from_home.secs,
        });
        self.checked.iter().for_each(|((a, b), route)| costs.set(*a, *b, route.secs));
        costs
    }

    fn learn(&mut self, found: Vec<((usize, usize), Route)>, joined: &Joined, routes: &Routes<'_>, expected: &mut Costs) {
        let nodes = &joined.nodes;
        let straight_secs = |a: usize, b: usize| routes.moves.straight_secs(&nodes[a].configuration, &nodes[b].configuration);
        let mut views = BTreeSet::new();
        for ((a, b), route) in found {
            let between = (nodes[a].view, nodes[b].view);
            let longer = self.longer.entry(between).or_default();
            *longer = (longer.0 + route.secs - straight_secs(a, b), longer.1 + 1.0);
            views.insert(between);
            expected.set(a, b, route.secs);
            self.checked.insert((a, b), route);
        }
        if joined.groups.len() <= EXACT_GROUPS {
            return;
        }
        for between in views {
            let (sum_secs, count) = self.longer[&between];
            let pairs = joined.groups[between.0].clone().flat_map(|a| joined.groups[between.1].clone().map(move |b| (a, b)));
            for (a, b) in pairs.filter(|pair| !self.checked.contains_key(pair)) {
                let by_home_secs = nodes[a].from_home.secs + nodes[b].from_home.secs;
                expected.set(a, b, (straight_secs(a, b) + sum_secs / (count + 1.0)).min(by_home_secs));
            }
        }
    }
}

/// Moves can be run either way, so a pair is looked at once, from the lower number to the higher.
fn key(a: usize, b: usize) -> (usize, usize) {
    (a.min(b), a.max(b))
}
