//! The stations that can be reached from home, and the routes to them.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::routes::{Route, Routes, StationNode};
use crate::cell::Configuration;
use crate::geometry::{parallel, sort_ascending};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::ViewId;
use crate::planning::stations::Station;

/// Stations through which one is tried at most that no simple route from home reaches.
const NEIGHBOURS: usize = 8;

/// Stations that can be reached from home, grouped by view.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct StationGraph {
    pub(super) nodes: Vec<StationNode>,
    /// Nodes of each view in `views`.
    pub(super) groups: Vec<Range<usize>>,
    pub(super) views: Vec<ViewId>,
    pub(super) no_path: Vec<ViewId>,
}

impl StationGraph {
    pub(super) fn connected_to_home(
        stations: &[(ViewId, &[Station])],
        routes: &Routes<'_>,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let total = stations.iter().map(|(_, of_view)| of_view.len()).sum();
        let done = AtomicUsize::new(0);
        let join = |station: &Station| {
            ctx.check()?;
            let route = routes.home_route(&station.configuration(), ctx)?;
            ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok(route)
        };
        let mut found: Vec<Vec<Option<Route>>> =
            parallel::try_map(stations, |(_, of_view)| parallel::try_map::<_, _, Cancelled>(of_view, join))?;
        connect_through_others(stations, &mut found, routes, ctx)?;
        if found.iter().any(|of_view| is_lost(of_view)) {
            routes.build_roadmap(ctx)?;
            connect_by_roadmap(stations, &mut found, routes, ctx)?;
        }
        let reached: Vec<Vec<(Configuration, Route)>> = stations
            .par_iter()
            .zip(found)
            .map(|((_, of_view), found)| {
                let joined = of_view.iter().zip(found).filter_map(|(station, route)| Some((station.configuration(), route?)));
                let joined: Vec<_> = joined.collect();
                if joined.is_empty() { searched(of_view, routes, ctx) } else { Ok(joined) }
            })
            .collect::<Result<_, _>>()?;
        let mut graph = Self::default();
        for ((view, _), reached) in stations.iter().zip(reached) {
            if reached.is_empty() {
                graph.no_path.push(*view);
                continue;
            }
            let (first, group) = (graph.nodes.len(), graph.views.len());
            graph
                .nodes
                .extend(reached.into_iter().map(|(configuration, from_home)| StationNode::new(group, configuration, from_home)));
            graph.groups.push(first..graph.nodes.len());
            graph.views.push(*view);
        }
        Ok(graph)
    }
}

/// Returns true if none of a view's stations is joined.
fn is_lost(found: &[Option<Route>]) -> bool {
    !found.is_empty() && found.iter().all(Option::is_none)
}

/// Joins stations of views that have none yet to home along the cell's roadmap.
fn connect_by_roadmap(
    stations: &[(ViewId, &[Station])],
    found: &mut [Vec<Option<Route>>],
    routes: &Routes<'_>,
    ctx: &Context<'_>,
) -> Result<(), Cancelled> {
    let lost = stations.iter().zip(found).filter(|(_, found)| is_lost(found));
    let open: Vec<_> = lost.flat_map(|((_, of_view), found)| of_view.iter().zip(found)).collect();
    open.into_par_iter().try_for_each(|(station, route)| {
        ctx.check()?;
        *route = routes.home_route_by_roadmap(&station.configuration(), ctx)?;
        Ok(())
    })
}

/// Joins stations to home through others that are joined: in a narrow place many stations can be reached from a neighbour but
/// not from home.
pub(super) fn connect_through_others(
    stations: &[(ViewId, &[Station])],
    found: &mut [Vec<Option<Route>>],
    routes: &Routes<'_>,
    ctx: &Context<'_>,
) -> Result<(), Cancelled> {
    let stations_of: Vec<(usize, usize)> =
        found.iter().enumerate().flat_map(|(view, of_view)| (0..of_view.len()).map(move |index| (view, index))).collect();
    let at = |(view, index): (usize, usize)| stations[view].1[index].configuration();
    let mut connected: Vec<(Configuration, Route)> =
        stations_of.iter().filter_map(|place| Some((at(*place), found[place.0][place.1].clone()?))).collect();
    while !connected.is_empty() {
        let open: Vec<_> = stations_of.iter().copied().filter(|(view, index)| found[*view][*index].is_none()).collect();
        let routes_found = parallel::try_map(&open, |place| route_through_another(&at(*place), &connected, routes, ctx))?;
        connected.clear();
        for ((view, index), route) in open.into_iter().zip(routes_found) {
            connected.extend(route.clone().map(|route| (at((view, index)), route)));
            found[view][index] = route;
        }
    }
    Ok(())
}

/// The route from home through the nearest of these stations from which the straight move is free.
fn route_through_another(
    station: &Configuration,
    others: &[(Configuration, Route)],
    routes: &Routes<'_>,
    ctx: &Context<'_>,
) -> Result<Option<Route>, Cancelled> {
    ctx.check()?;
    let move_from = |(other, _): &(Configuration, Route)| routes.moves.straight_secs(other, station);
    let mut near: Vec<_> = others.iter().map(|other| (move_from(other), other)).collect();
    sort_ascending(&mut near, |node| node.0);
    let free = near.into_iter().take(NEIGHBOURS).find(|(_, (other, _))| routes.moves.is_free(other, station));
    Ok(free.map(|(secs, (other, from_home))| Route {
        via_rad: from_home.via_rad.iter().copied().chain([*other]).collect(),
        secs: from_home.secs + secs,
    }))
}

/// The station of a view to which a search finds a path, where no simple route leads to any.
fn searched(of_view: &[Station], routes: &Routes<'_>, ctx: &Context<'_>) -> Result<Vec<(Configuration, Route)>, Cancelled> {
    let configurations: Vec<_> = of_view.iter().map(Station::configuration).collect();
    Ok(routes.searched_home_route(&configurations, ctx)?.into_iter().collect())
}
