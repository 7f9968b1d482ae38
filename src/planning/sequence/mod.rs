//! Stations to an order and joint paths, from and back to home.
//!
//! Which view after which, and from which of its stations, is one question (a generalised travelling salesman): the cost
//! of a step is the time of its move, table included, and whether a move is free costs far more to find out than how long
//! it takes. So the tour is found on the times of straight moves first; the moves it uses are then checked, those that
//! collide get the time of the way around instead, and the tour is found again, until it uses only checked moves. A
//! straight move's time is a lower bound of the way around, so with the exact solver the result is the shortest tour over
//! all ways this stage knows (C. Dellin and S. Srinivasa, "A unifying formalism for shortest path problems with expensive
//! edge evaluations via lazy best-first search", ICAPS 2016).
//!
//! Ways around: by raised or retreated points beside either end, by turning the table with the arm at home, or by home
//! itself. A station that cannot be joined to home this way is dropped; a view without stations left has no path.

mod routes;
mod tour;

use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use self::routes::{Node, Route, Routes};
use self::tour::Costs;
use super::context::{Cancelled, Context};
use super::params::PlanParams;
use super::selection::ViewId;
use super::stations::Station;
pub use crate::cell::Configuration;
use crate::cell::{Cell, CollisionScene};

/// One move. All points are joined by straight joint-space segments, table included, and were checked as such.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Points between start and target, both left out.
    pub via_rad: Vec<Configuration>,
    /// Where it ends.
    pub target: Station,
    /// Predicted time; every point is a stop.
    pub duration_secs: f64,
}

/// A tour from home through every view with a station, and back.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Views in the order visited, each with the move that leads to it.
    pub visits: Vec<(ViewId, Leg)>,
    /// The move home.
    pub return_home: Leg,
}

impl Sequence {
    /// Time of all moves.
    #[must_use]
    pub fn motion_secs(&self) -> f64 {
        self.visits.iter().map(|(_, leg)| leg.duration_secs).sum::<f64>() + self.return_home.duration_secs
    }
}

/// A sequence, and what it leaves out.
#[derive(Clone, Debug, PartialEq)]
pub struct Ordered {
    /// The tour.
    pub sequence: Sequence,
    /// Views to none of whose stations a free path was found, in the order given.
    pub no_path: Vec<ViewId>,
}

/// Orders the views and chooses a station for each. Every move of the result was checked along its whole length. With up
/// to nine views the tour is the shortest over the moves this stage knows, beyond that a local optimum. Runs on the
/// caller's rayon pool; the result does not depend on the number of threads.
///
/// # Errors
/// [`Cancelled`].
pub fn order(
    stations: &[(ViewId, &[Station])],
    cell: &Cell,
    scene: &CollisionScene,
    params: &PlanParams,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let routes = Routes::new(cell, scene, params.motion.speed_fraction);
    let joined = join_to_home(stations, &routes, ctx)?;
    let mut visits = Vec::new();
    let mut last = None;
    for (node, route) in shortest_tour(&joined, &routes, ctx)? {
        visits.push((joined.views[joined.nodes[node].view], leg(route, joined.nodes[node].configuration)));
        last = Some(node);
    }
    let home = last.map(|node| joined.nodes[node].from_home.reversed()).unwrap_or_default();
    Ok(Ordered { sequence: Sequence { visits, return_home: leg(home, cell.home_rad) }, no_path: joined.no_path })
}

fn leg(route: Route, target: Configuration) -> Leg {
    Leg { via_rad: route.via_rad, target: Station::from(target), duration_secs: route.secs }
}

/// Stations that can be reached from home, grouped by view.
struct Joined {
    nodes: Vec<Node>,
    /// Nodes of each view in `views`.
    groups: Vec<Range<usize>>,
    views: Vec<ViewId>,
    no_path: Vec<ViewId>,
}

fn join_to_home(stations: &[(ViewId, &[Station])], routes: &Routes<'_>, ctx: &Context<'_>) -> Result<Joined, Cancelled> {
    let total = stations.iter().map(|(_, of_view)| of_view.len()).sum();
    let done = AtomicUsize::new(0);
    let found: Vec<Vec<(Configuration, Route)>> = stations
        .par_iter()
        .map(|(_, of_view)| {
            let joined = of_view.par_iter().map(|station| {
                ctx.check()?;
                let configuration = station.configuration();
                let route = routes.home_route(&configuration);
                ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
                Ok(route.map(|route| (configuration, route)))
            });
            joined.filter_map(Result::transpose).collect()
        })
        .collect::<Result<_, _>>()?;
    let mut joined = Joined { nodes: Vec::new(), groups: Vec::new(), views: Vec::new(), no_path: Vec::new() };
    for ((view, _), reached) in stations.iter().zip(found) {
        if reached.is_empty() {
            joined.no_path.push(*view);
            continue;
        }
        let (first, index) = (joined.nodes.len(), joined.views.len());
        joined.nodes.extend(reached.into_iter().map(|(configuration, from_home)| Node::new(index, configuration, from_home)));
        joined.groups.push(first..joined.nodes.len());
        joined.views.push(*view);
    }
    Ok(joined)
}

/// Nodes in the order visited, each with the checked route that leads to it.
fn shortest_tour(joined: &Joined, routes: &Routes<'_>, ctx: &Context<'_>) -> Result<Vec<(usize, Route)>, Cancelled> {
    let nodes = &joined.nodes;
    let mut costs = Costs::new(nodes.len(), |a, b| {
        if b == nodes.len() {
            nodes[a].from_home.secs
        } else {
            routes.straight_secs(&nodes[a].configuration, &nodes[b].configuration)
        }
    });
    let mut checked: HashMap<(usize, usize), Route> = HashMap::new();
    let mut tour = Vec::new();
    loop {
        tour = tour::shortest(&joined.groups, &costs, &tour, ctx)?;
        let unchecked: Vec<_> = tour.windows(2).map(|step| key(step[0], step[1])).filter(|k| !checked.contains_key(k)).collect();
        if unchecked.is_empty() {
            break;
        }
        let found: Vec<Route> = unchecked
            .par_iter()
            .map(|(a, b)| ctx.check().map(|()| routes.between(&nodes[*a], &nodes[*b])))
            .collect::<Result<_, _>>()?;
        for ((a, b), route) in unchecked.into_iter().zip(found) {
            costs.set(a, b, route.secs);
            checked.insert((a, b), route);
        }
    }
    let first = tour.first().map(|node| (*node, nodes[*node].from_home.clone()));
    let others = tour.windows(2).map(|step| {
        let route = &checked[&key(step[0], step[1])];
        (step[1], if step[0] < step[1] { route.clone() } else { route.reversed() })
    });
    Ok(first.into_iter().chain(others).collect())
}

/// Moves can be run either way, so a pair is looked at once, from the lower number to the higher.
fn key(a: usize, b: usize) -> (usize, usize) {
    (a.min(b), a.max(b))
}

#[cfg(test)]
mod tests;
