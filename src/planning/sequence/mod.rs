//! Stations to an order and joint paths, from and back to home.
//!
//! The order of the views and the choice of their stations are one problem (a generalised travelling salesman): the cost
//! of a step is the time of its move, table included, and whether a move is free costs far more to find out than how long
//! it takes. So the tour is found on the times of straight moves first; the moves it uses are then checked, those that
//! collide get the time of their detour instead, and the tour is found again, until it uses only checked moves
//! (`lazy_edge_costs.rs`). A straight move's time is a lower bound of its detour, so with the exact solver the result is the
//! shortest tour over all paths this stage knows (C. Dellin and S. Srinivasa, "A unifying formalism for shortest path problems
//! with expensive edge evaluations via lazy best-first search", ICAPS 2016).
//!
//! Detours: by raised or retreated points beside either end, by turning the table with the arm at home, or by home
//! itself. A station that cannot be joined to home this way is joined through one that is, or dropped. Where that leaves a view
//! without any, the cell's roadmap is asked for paths, from then on between stations too (`roadmap.rs`, `network.rs`); then two
//! trees are grown towards each other, and only where they do not meet the view has no path. The stations of
//! the tour are then moved along the table's angle, and rolled where that is permitted (`refine.rs`).

mod connect;
mod lazy_edge_costs;
mod moves;
mod network;
mod refine;
mod roadmap;
mod rounded;
mod routes;
mod station_graph;
mod tour;

use self::lazy_edge_costs::LazyEdgeCosts;
use self::moves::min_secs;
pub use self::moves::straight_secs;
use self::refine::Tour;
pub use self::refine::{InSight, StopPermits};
pub use self::roadmap::Roadmaps;
use self::rounded::Rounded;
use self::routes::{Route, Routes};
use self::station_graph::StationGraph;
use super::context::{Cancelled, Context};
use super::ids::ViewId;
use super::params::{MotionParams, PlanParams, TableMotion};
use super::stations::{Station, max_stations};
pub use crate::cell::Configuration;
use crate::cell::{Cell, CollisionScene};

/// Difference of a time from its lower bound that is rounding, s: bounds of long tours are sums in single precision.
const ROUNDING_SECS: f64 = 0.005;
/// Difference from the lower bound that is rounding, as a share of it.
const ROUNDING: f64 = 1e-4;
/// Bytes of a station with its way from home, and of the checked moves between it and others.
const BYTES_OF_STATION: f64 = 1.7e3;

/// One move. All points are joined by straight joint-space segments, table included, and were checked as such.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Points between start and target, which are not among them.
    pub via_rad: Vec<Configuration>,
    /// The station at its end.
    pub target: Station,
    /// Predicted time.
    pub duration_secs: f64,
    /// Tolerance by which any axis may pass a point without stopping, radians; `None`: every point is a stop.
    pub passed_within_rad: Option<f64>,
    /// Part of `duration_secs` in which the table turns; of a move with rounded corners an estimate: the share that it has with stops.
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
    /// Lower bound of `ordered_secs` over all tours of the stations and moves that were considered. Zero until [`bounded`].
    pub lower_bound_secs: f64,
    /// Lower bound of the time of all moves through these stations in any order: of straight moves, or, where corners are passed
    /// without stopping, of moves that each take as long as their slowest axis alone. Zero until [`bounded_as_moved`].
    pub moving_lower_secs: f64,
}

impl Sequence {
    /// Time of all moves.
    #[must_use]
    pub fn motion_secs(&self) -> f64 {
        self.visits.iter().map(|(_, leg)| leg.duration_secs).sum::<f64>() + self.return_home.duration_secs
    }
}

/// A sequence, and the views that it leaves out.
#[derive(Clone, Debug, PartialEq)]
pub struct Ordered {
    /// The tour.
    pub sequence: Sequence,
    /// Views to none of whose stations a free path was found, in the order given.
    pub no_path: Vec<ViewId>,
    /// The tour that the sequence was made of.
    tour: Tour,
    /// Stations that it was chosen from.
    graph: StationGraph,
    /// The order that was found, as nodes of the graph.
    nodes: Vec<usize>,
    edge_costs: LazyEdgeCosts,
}

impl Sequence {
    /// Part of that time in which the table turns.
    #[must_use]
    pub fn turning_secs(&self) -> f64 {
        self.visits.iter().map(|(_, leg)| leg.turning_secs).sum::<f64>() + self.return_home.turning_secs
    }

    /// Returns true if it is proved that no order of its stations, as they were moved, has shorter moves.
    #[must_use]
    pub fn is_shortest(&self) -> bool {
        bound_gap(self.motion_secs(), self.moving_lower_secs).is_some_and(|gap| gap <= 0.0)
    }
}

/// Time of moves above its lower bound, as a share of the bound: zero where both are equal within rounding, 0.005 s or 0.01 %;
/// `None` without a bound.
#[must_use]
pub fn bound_gap(moving_secs: f64, lower_secs: f64) -> Option<f64> {
    let above_secs = moving_secs - lower_secs;
    let is_rounding = above_secs <= ROUNDING_SECS.max(ROUNDING * lower_secs);
    (lower_secs > 0.0).then(|| if is_rounding { 0.0 } else { above_secs / lower_secs })
}

/// Orders the views and chooses a station for each. Every move of the result was checked along its whole length. With up
/// to twelve views the tour is the shortest over the moves this stage knows, beyond that it comes with a bound. Runs on the
/// caller's rayon pool; the result does not depend on the number of threads.
///
/// `roadmaps` are of cells that were planned for before. With `require_all`, a view without a path ends the search at once with
/// an empty sequence: for callers who rather choose other views than leave some out.
///
/// # Errors
/// [`Cancelled`].
pub fn order(
    stations: &[(ViewId, &[Station])],
    cell: &Cell,
    scene: &CollisionScene,
    params: &PlanParams,
    roadmaps: Option<&Roadmaps>,
    require_all: bool,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let options = OrderOptions { roadmaps, require_all, in_sight: &|_, _| true };
    order_in_sight(stations, cell, scene, params, &options, ctx)
}

/// Finds a free path between the first and the last of `points`, and returns the points between them: these where the way along
/// them is free; `None` where none is found. Takes up to some seconds, on one thread.
///
/// # Errors
/// [`Cancelled`].
pub fn join(
    cell: &Cell,
    scene: &CollisionScene,
    motion: &MotionParams,
    points: &[Configuration],
    ctx: &Context<'_>,
) -> Result<Option<Vec<Configuration>>, Cancelled> {
    Routes::new(cell, scene, motion).join(points, ctx)
}

/// Options of [`order_in_sight`].
pub struct OrderOptions<'a> {
    /// Roadmaps of cells that were planned for before.
    pub roadmaps: Option<&'a Roadmaps>,
    /// Gives up at once where a view has no path; see [`order`].
    pub require_all: bool,
    /// Decides whether a view may be taken from a station that it was not given; those given are in sight.
    pub in_sight: &'a InSight<'a>,
}

/// Orders the views as [`order`] does, and moves none of them to where it is out of sight.
///
/// # Errors
/// [`Cancelled`].
pub fn order_in_sight(
    stations: &[(ViewId, &[Station])],
    cell: &Cell,
    scene: &CollisionScene,
    params: &PlanParams,
    options: &OrderOptions<'_>,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let routes = Routes::new(cell, scene, &params.motion).with_roadmaps(options.roadmaps);
    let mut graph = StationGraph::connected_to_home(stations, &routes, ctx)?;
    let no_path = std::mem::take(&mut graph.no_path);
    if options.require_all && !no_path.is_empty() {
        graph = StationGraph::default();
    }
    let mut edge_costs = LazyEdgeCosts::default();
    let nodes = edge_costs.shortest_tour(&graph, &routes, ctx)?;
    let mut tour = Tour { stops: Vec::new(), paths: Vec::new() };
    for (at, node) in nodes.iter().enumerate() {
        let before = at.checked_sub(1).map(|at| nodes[at]);
        tour.stops.push((graph.views[graph.nodes[*node].group], graph.nodes[*node].configuration));
        tour.paths.push(before.map_or_else(|| graph.nodes[*node].from_home.clone(), |before| edge_costs.route(before, *node)));
    }
    tour.paths.push(nodes.last().map(|node| graph.nodes[*node].from_home.reversed()).unwrap_or_default());
    let ordered_secs = tour.secs();
    tour.refine(&routes, options.in_sight, ctx)?;
    Ok(Ordered { sequence: sequence(&tour, &routes, [ordered_secs, 0.0]), no_path, tour, graph, nodes, edge_costs })
}

/// Bytes that ordering up to so many views of one setup holds at most, each with as many stations as a view may have.
pub(super) fn expected_bytes(max_views: f64, table: TableMotion) -> f64 {
    let stations = max_stations(table);
    BYTES_OF_STATION * stations as f64 * max_views + tour::expected_bytes(max_views.ceil() as usize, stations)
}

/// Adds the lower bound to a sequence, which takes about as long as finding the sequence.
///
/// # Errors
/// [`Cancelled`].
pub fn bounded(mut ordered: Ordered, cell: &Cell, params: &PlanParams, ctx: &Context<'_>) -> Result<Ordered, Cancelled> {
    let costs = ordered.edge_costs.lower_bounds(&ordered.graph, &cell.axes(), &params.motion);
    ordered.sequence.lower_bound_secs =
        tour::lower_bound_secs(&ordered.graph.groups, &costs, &ordered.nodes, tour::Effort::Thorough, ctx)?;
    Ok(ordered)
}

/// Adds the lower bound of the moves through the stations as they are now, moved along the table's angle and rolled.
///
/// # Errors
/// [`Cancelled`].
pub fn bounded_as_moved(mut ordered: Ordered, cell: &Cell, params: &PlanParams, ctx: &Context<'_>) -> Result<Ordered, Cancelled> {
    let (axes, stops) = (cell.axes(), &ordered.tour.stops);
    let at = |node: usize| stops.get(node).map_or(cell.home_rad, |(_, configuration)| *configuration);
    let costs = tour::Costs::new(stops.len(), |a, b| min_secs(&axes, &at(a), &at(b), &params.motion));
    let groups: Vec<_> = (0..stops.len()).map(|node| node..node + 1).collect();
    // Where tours are exact, the bound is the time of the shortest.
    let known: Vec<usize> = if groups.len() <= tour::EXACT_GROUPS {
        tour::shortest(&groups, &costs, &[], tour::Effort::Thorough, ctx)?.into_iter().next().unwrap_or_default()
    } else {
        (0..stops.len()).collect()
    };
    ordered.sequence.moving_lower_secs = tour::lower_bound_secs(&groups, &costs, &known, tour::Effort::Brief, ctx)?;
    Ok(ordered)
}

/// Rolls the scanner about its optical axis wherever that makes the moves shorter and `permits` lets a view be taken from such a
/// pose on the plate. [`StopPermits::may_roll`] is called a few times a view, for each roll that is quicker.
///
/// # Errors
/// [`Cancelled`].
pub fn roll(
    mut ordered: Ordered,
    cell: &Cell,
    scene: &CollisionScene,
    params: &PlanParams,
    permits: &mut dyn StopPermits,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let routes = Routes::new(cell, scene, &params.motion);
    let before = &ordered.sequence;
    let (ordered_secs, lower_bound_secs) = (before.ordered_secs, before.lower_bound_secs);
    ordered.tour.roll(&routes, permits, ctx)?;
    ordered.sequence = sequence(&ordered.tour, &routes, [ordered_secs, lower_bound_secs]);
    Ok(ordered)
}

fn sequence(tour: &Tour, routes: &Routes<'_>, [ordered_secs, lower_bound_secs]: [f64; 2]) -> Sequence {
    let home = *routes.home();
    let leg_to = |stop: usize, target: Configuration| leg(&tour.before(stop, &home), tour.paths[stop].clone(), target, routes);
    let visits = tour.stops.iter().enumerate().map(|(stop, (view, target))| (*view, leg_to(stop, *target))).collect();
    let return_home = leg_to(tour.stops.len(), home);
    Sequence { visits, return_home, ordered_secs, lower_bound_secs, moving_lower_secs: 0.0 }
}

fn leg(from: &Configuration, route: Route, target: Configuration, routes: &Routes<'_>) -> Leg {
    let path: Vec<_> = std::iter::once(*from).chain(route.via_rad).chain([target]).collect();
    let points = routes.moves.with_all_stops(&path);
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

#[cfg(test)]
mod tests;
