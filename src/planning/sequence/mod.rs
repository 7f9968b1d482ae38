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
//! itself. A station that cannot be joined to home this way is joined through one that is, or dropped; where that leaves a view
//! without any, two trees are grown towards each other, and only where they do not meet the view has no path. The stations of
//! the tour are then moved along the table's angle, and rolled where that is permitted (`refine.rs`).

mod connect;
mod moves;
mod refine;
mod rounded;
mod routes;
mod tour;

use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

pub use self::moves::straight_secs;
pub use self::refine::Permits;
use self::refine::Tour;
use self::rounded::Rounded;
use self::routes::{Node, Route, Routes};
use self::tour::Costs;
use super::context::{Cancelled, Context};
use super::params::PlanParams;
use super::selection::ViewId;
use super::stations::Station;
pub use crate::cell::Configuration;
use crate::cell::{Cell, CollisionScene};

/// Stations of a view to which a way is searched where no simple one is free.
const SEARCHED: usize = 12;
/// Stations that another is tried from which no simple way from home leads to.
const NEIGHBOURS: usize = 8;
/// A sequence is as short as can be if it is this close to what none can be shorter than, seconds: bounds of long tours are
/// sums in single precision.
const PROVED_SECS: f64 = 1e-3;

/// One move. All points are joined by straight joint-space segments, table included, and were checked as such.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Points between start and target, both left out.
    pub via_rad: Vec<Configuration>,
    /// Where it ends.
    pub target: Station,
    /// Predicted time.
    pub duration_secs: f64,
    /// How far any axis may be from a point that is passed without stopping, radians; `None`: every point is a stop.
    pub passed_within_rad: Option<f64>,
    /// Of that the time in which the table turns.
    pub turning_secs: f64,
}

/// A tour from home through every view with a station, and back.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Views in the order visited, each with the move that leads to it.
    pub visits: Vec<(ViewId, Leg)>,
    /// The move home.
    pub return_home: Leg,
    /// Time of the moves as the tour was found, before its stations were moved along the table's angle and rolled, and with a
    /// stop at every point.
    pub ordered_secs: f64,
    /// No such tour over the stations and moves that were considered takes less.
    pub at_least_secs: f64,
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
    /// What the sequence was made of.
    tour: Tour,
}

impl Sequence {
    /// Of that the time in which the table turns.
    #[must_use]
    pub fn turning_secs(&self) -> f64 {
        self.visits.iter().map(|(_, leg)| leg.turning_secs).sum::<f64>() + self.return_home.turning_secs
    }

    /// Whether its order is proved the shortest over the stations and moves that were considered.
    #[must_use]
    pub fn is_shortest(&self) -> bool {
        self.ordered_secs - self.at_least_secs <= PROVED_SECS
    }
}

/// Orders the views and chooses a station for each. Every move of the result was checked along its whole length. With up
/// to twelve views the tour is the shortest over the moves this stage knows, beyond that it comes with a bound. Runs on the
/// caller's rayon pool; the result does not depend on the number of threads.
///
/// Who would rather choose other views than leave some out may `insist` on all: a view without a path then ends it at once,
/// with an empty sequence.
///
/// # Errors
/// [`Cancelled`].
pub fn order(
    stations: &[(ViewId, &[Station])],
    cell: &Cell,
    scene: &CollisionScene,
    params: &PlanParams,
    insist: bool,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let routes = Routes::new(cell, scene, &params.motion);
    let joined = join_to_home(stations, &routes, ctx)?;
    if insist && !joined.no_path.is_empty() {
        let nowhere = Tour { stops: Vec::new(), ways: vec![Route::default()] };
        return Ok(Ordered { sequence: sequence(&nowhere, &routes, [0.0, 0.0]), no_path: joined.no_path, tour: nowhere });
    }
    let (steps, at_least_secs) = shortest_tour(&joined, &routes, ctx)?;
    let home = steps.last().map(|(node, _)| joined.nodes[*node].from_home.reversed()).unwrap_or_default();
    let mut tour = Tour { stops: Vec::new(), ways: Vec::new() };
    for (node, route) in steps {
        tour.stops.push((joined.views[joined.nodes[node].view], joined.nodes[node].configuration));
        tour.ways.push(route);
    }
    tour.ways.push(home);
    let ordered_secs = tour.secs();
    tour.refine(&routes, ctx)?;
    Ok(Ordered { sequence: sequence(&tour, &routes, [ordered_secs, at_least_secs]), no_path: joined.no_path, tour })
}

/// The same sequence with the scanner rolled about its optical axis wherever that makes the moves shorter and `permits` lets a
/// view be taken from such a pose on the plate. It is asked a few times a view, for each roll that is quicker.
///
/// # Errors
/// [`Cancelled`].
pub fn roll(
    ordered: Ordered,
    cell: &Cell,
    scene: &CollisionScene,
    params: &PlanParams,
    permits: &mut Permits<'_>,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let routes = Routes::new(cell, scene, &params.motion);
    let Ordered { sequence: before, no_path, mut tour } = ordered;
    tour.roll(&routes, permits, ctx)?;
    Ok(Ordered { sequence: sequence(&tour, &routes, [before.ordered_secs, before.at_least_secs]), no_path, tour })
}

fn sequence(tour: &Tour, routes: &Routes<'_>, [ordered_secs, at_least_secs]: [f64; 2]) -> Sequence {
    let home = *routes.home();
    let leg_to = |stop: usize, target: Configuration| leg(&tour.before(stop, &home), tour.ways[stop].clone(), target, routes);
    let visits = tour.stops.iter().enumerate().map(|(stop, (view, target))| (*view, leg_to(stop, *target))).collect();
    Sequence { visits, return_home: leg_to(tour.stops.len(), home), ordered_secs, at_least_secs }
}

fn leg(from: &Configuration, route: Route, target: Configuration, routes: &Routes<'_>) -> Leg {
    let way: Vec<_> = std::iter::once(*from).chain(route.via_rad).chain([target]).collect();
    let points = routes.moves.spelled_out(&way);
    let inner = |points: &[Configuration]| points[1..points.len() - 1].to_vec();
    let turning_secs = routes.moves.turning_secs(&points);
    let target = Station::from(target);
    match routes.moves.without_stops(&points) {
        Some((Rounded { points: round, secs }, within_rad)) => Leg {
            via_rad: inner(&round),
            target,
            duration_secs: secs,
            passed_within_rad: Some(within_rad),
            // In the same proportion: where on a way the table turns is not kept track of.
            turning_secs: turning_secs * secs / route.secs,
        },
        None => Leg { via_rad: inner(&points), target, duration_secs: route.secs, passed_within_rad: None, turning_secs },
    }
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
    let join = |station: &Station| {
        ctx.check()?;
        let route = routes.home_route(&station.configuration(), ctx)?;
        ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
        Ok(route)
    };
    let mut found: Vec<Vec<Option<Route>>> =
        stations.par_iter().map(|(_, of_view)| of_view.par_iter().map(join).collect()).collect::<Result<_, Cancelled>>()?;
    join_by_others(stations, &mut found, routes, ctx)?;
    let reached: Vec<Vec<(Configuration, Route)>> = stations
        .par_iter()
        .zip(found)
        .map(|((_, of_view), found)| {
            let joined = of_view.iter().zip(found).filter_map(|(station, route)| Some((station.configuration(), route?)));
            let joined: Vec<_> = joined.collect();
            if joined.is_empty() { searched(of_view, routes, ctx) } else { Ok(joined) }
        })
        .collect::<Result<_, _>>()?;
    let mut joined = Joined { nodes: Vec::new(), groups: Vec::new(), views: Vec::new(), no_path: Vec::new() };
    for ((view, _), reached) in stations.iter().zip(reached) {
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

/// Joins stations to home by way of others that are: in a narrow place many a station is reached from its neighbour that is
/// not from home.
fn join_by_others(
    stations: &[(ViewId, &[Station])],
    found: &mut [Vec<Option<Route>>],
    routes: &Routes<'_>,
    ctx: &Context<'_>,
) -> Result<(), Cancelled> {
    let places: Vec<(usize, usize)> =
        found.iter().enumerate().flat_map(|(view, of_view)| (0..of_view.len()).map(move |index| (view, index))).collect();
    let at = |(view, index): (usize, usize)| stations[view].1[index].configuration();
    let mut fresh: Vec<(Configuration, Route)> =
        places.iter().filter_map(|place| Some((at(*place), found[place.0][place.1].clone()?))).collect();
    while !fresh.is_empty() {
        let open: Vec<_> = places.iter().copied().filter(|(view, index)| found[*view][*index].is_none()).collect();
        let ways: Vec<_> =
            open.par_iter().map(|place| by_another(&at(*place), &fresh, routes, ctx)).collect::<Result<_, Cancelled>>()?;
        fresh.clear();
        for ((view, index), way) in open.into_iter().zip(ways) {
            fresh.extend(way.clone().map(|route| (at((view, index)), route)));
            found[view][index] = way;
        }
    }
    Ok(())
}

/// From home by way of the nearest of these stations from which the straight move is free.
fn by_another(
    station: &Configuration,
    others: &[(Configuration, Route)],
    routes: &Routes<'_>,
    ctx: &Context<'_>,
) -> Result<Option<Route>, Cancelled> {
    ctx.check()?;
    let move_from = |(other, _): &(Configuration, Route)| routes.moves.straight_secs(other, station);
    let mut near: Vec<_> = others.iter().map(|other| (move_from(other), other)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let free = near.into_iter().take(NEIGHBOURS).find(|(_, (other, _))| routes.moves.is_free(other, station));
    Ok(free.map(|(secs, (other, from_home))| Route {
        via_rad: from_home.via_rad.iter().copied().chain([*other]).collect(),
        secs: from_home.secs + secs,
    }))
}

/// The first of a view's stations to which a search finds a way, where no simple way leads to any.
fn searched(of_view: &[Station], routes: &Routes<'_>, ctx: &Context<'_>) -> Result<Vec<(Configuration, Route)>, Cancelled> {
    for station in of_view.iter().take(SEARCHED) {
        let configuration = station.configuration();
        if let Some(route) = routes.searched_home_route(&configuration, ctx)? {
            return Ok(vec![(configuration, route)]);
        }
    }
    Ok(Vec::new())
}

/// Nodes in the order visited, each with the checked route that leads to it; and the time that no tour is shorter than.
fn shortest_tour(joined: &Joined, routes: &Routes<'_>, ctx: &Context<'_>) -> Result<(Vec<(usize, Route)>, f64), Cancelled> {
    let nodes = &joined.nodes;
    let mut costs = Costs::new(nodes.len(), |a, b| {
        if b == nodes.len() {
            nodes[a].from_home.secs
        } else {
            routes.moves.straight_secs(&nodes[a].configuration, &nodes[b].configuration)
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
        let found: Vec<Route> =
            unchecked.par_iter().map(|(a, b)| routes.between(&nodes[*a], &nodes[*b], ctx)).collect::<Result<_, _>>()?;
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
    Ok((first.into_iter().chain(others).collect(), tour::at_least(&joined.groups, &costs, &tour, ctx)?))
}

/// Moves can be run either way, so a pair is looked at once, from the lower number to the higher.
fn key(a: usize, b: usize) -> (usize, usize) {
    (a.min(b), a.max(b))
}

#[cfg(test)]
mod tests;
