//! Checked moves between stations: straight where that is free, else through raised or retreated points, with the arm at
//! home while the table turns, or through home itself, and made shorter where corners can be cut; from home also by search. Every
//! segment of a route that is returned was checked.

use std::sync::OnceLock;

use nalgebra::{Isometry3, Vector3};

use super::connect::{connect, shortened};
use super::moves::{Moves, SegmentCache};
use super::network::{Network, RoadmapWay};
use super::roadmap::Roadmaps;
use crate::cell::{Cell, CollisionScene, Configuration};
use crate::geometry::{Base, Pose, ScannerFrame, sort_ascending};
use crate::planning::context::{Cancelled, Context, Stage};
use crate::planning::params::MotionParams;

/// Retreats of the scanner: along its own −z, and up, mm.
const RETREATS_MM: [[f64; 2]; 5] = [[100.0, 0.0], [250.0, 0.0], [0.0, 100.0], [0.0, 250.0], [150.0, 200.0]];
/// Largest turn of an axis on the way to a retreat, radians (80°): with another IK solution the arm would not retreat.
const RETREAT_TURN_RAD: f64 = 80.0 * std::f64::consts::PI / 180.0;

/// A path between two configurations, which are not part of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Route {
    pub(super) via_rad: Vec<Configuration>,
    pub(super) secs: f64,
}

impl Route {
    /// Returns the route run backwards, which is as free and takes as long.
    pub(super) fn reversed(&self) -> Self {
        Self { via_rad: self.via_rad.iter().rev().copied().collect(), secs: self.secs }
    }
}

/// A station that can be reached from home.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct StationNode {
    /// Place of its view in the graph: of the view's group, and of its id among the graph's views.
    pub(super) group: usize,
    pub(super) configuration: Configuration,
    pub(super) from_home: Route,
    /// Points beside it with a free straight move to it; found on first use.
    retreats: OnceLock<Vec<Configuration>>,
    /// Connections to the roadmap; found on first use.
    connections: OnceLock<Vec<RoadmapWay>>,
}

impl StationNode {
    pub(super) fn new(group: usize, configuration: Configuration, from_home: Route) -> Self {
        Self { group, configuration, from_home, retreats: OnceLock::new(), connections: OnceLock::new() }
    }
}

/// Finds routes in one scene.
pub(super) struct Routes<'a> {
    cell: &'a Cell,
    pub(super) moves: Moves<'a>,
    /// Made by [`Routes::build_roadmap`].
    network: OnceLock<Network>,
    /// Roadmaps of cells that were planned for before.
    roadmaps: Option<&'a Roadmaps>,
}

impl<'a> Routes<'a> {
    pub(super) fn new(cell: &'a Cell, scene: &'a CollisionScene, motion: &MotionParams) -> Self {
        Self { cell, moves: Moves::new(cell, scene, motion), network: OnceLock::new(), roadmaps: None }
    }

    pub(super) fn with_roadmaps(self, roadmaps: Option<&'a Roadmaps>) -> Self {
        Self { roadmaps, ..self }
    }

    pub(super) fn cell(&self) -> &Cell {
        self.cell
    }

    pub(super) fn home(&self) -> &Configuration {
        &self.cell.home_rad
    }

    /// The quickest free route from home of the simple ones; `None` where there is none.
    pub(super) fn home_route(&self, station: &Configuration, ctx: &Context<'_>) -> Result<Option<Route>, Cancelled> {
        let home = &self.cell.home_rad;
        if self.moves.is_free(home, station) {
            return Ok(Some(self.route(home, Vec::new(), station)));
        }
        let turned = self.arm_at_home(station.table_rad);
        let mut vias = vec![vec![turned]];
        for retreat in self.retreats(station) {
            vias.extend([vec![retreat], vec![turned, retreat]]);
        }
        let quickest = self.quickest_free(home, vias, station, f64::INFINITY);
        quickest.map(|route| self.shortcut(home, route, station, ctx)).transpose()
    }

    /// Builds the cell's roadmap, which is used from then on. Runs on the caller's rayon pool, so its threads must not call it.
    pub(super) fn build_roadmap(&self, ctx: &Context<'_>) -> Result<(), Cancelled> {
        if self.network.get().is_none() {
            let own = Roadmaps::default();
            let roadmap = ctx.within(Stage::Roadmap, || self.roadmaps.unwrap_or(&own).of(self.cell, ctx))?;
            self.network.get_or_init(|| Network::new(roadmap, self.moves.scene));
        }
        Ok(())
    }

    /// A free route from home along the roadmap, if that is built and leads there.
    pub(super) fn home_route_by_roadmap(&self, station: &Configuration, ctx: &Context<'_>) -> Result<Option<Route>, Cancelled> {
        let (Some(network), home) = (self.network.get(), self.home()) else { return Ok(None) };
        let connections = network.connections(station, &self.retreats(station), &self.moves);
        let path = network.path((home, &Network::home()), (station, &connections), &self.moves);
        let route = path.and_then(|path| self.quickest_free(home, vec![path], station, f64::INFINITY));
        route.map(|route| self.shortcut(home, route, station, ctx)).transpose()
    }

    /// A free route from home to one of these stations by search, through its first retreat where it has one.
    pub(super) fn searched_home_route(
        &self,
        stations: &[Configuration],
        ctx: &Context<'_>,
    ) -> Result<Option<(Configuration, Route)>, Cancelled> {
        let home = &self.cell.home_rad;
        // No motion of the arm helps where the part itself cannot be turned there.
        let turns_there =
            |station: &&Configuration| self.moves.scene.check_table_rotation(home.table_rad, station.table_rad).is_none();
        let stations: Vec<_> = stations.iter().filter(turns_there).collect();
        let lasts: Vec<_> = stations.iter().map(|station| self.retreats(station).first().copied()).collect();
        let goals: Vec<_> = stations.iter().zip(&lasts).map(|(station, last)| last.unwrap_or(**station)).collect();
        if goals.is_empty() {
            return Ok(None);
        }
        let Some((goal, found)) = connect(home, &goals, &self.moves, ctx)? else { return Ok(None) };
        let route = self.route(home, found.into_iter().chain(lasts[goal]).collect(), stations[goal]);
        Ok(Some((*stations[goal], self.shortcut(home, route, stations[goal], ctx)?)))
    }

    /// The quickest free route between two stations that is known; through home where there is no other.
    pub(super) fn between(&self, a: &StationNode, b: &StationNode, ctx: &Context<'_>) -> Result<Route, Cancelled> {
        let (from, to) = (&a.configuration, &b.configuration);
        if self.moves.is_free(from, to) {
            return Ok(self.route(from, Vec::new(), to));
        }
        let by_home = self.by_home(a, b);
        let mut detours = self.detours(a, b);
        detours.extend(self.by_roadmap(a, b));
        let quickest = self.quickest_free(from, detours, to, by_home.secs).unwrap_or(by_home);
        self.shortcut(from, quickest, to, ctx)
    }

    /// Inner points of a free route between the ends of `points`: these where they are free, else a simple one, else one that is
    /// searched for; `None` where none is found. Takes up to some seconds.
    pub(super) fn join(&self, points: &[Configuration], ctx: &Context<'_>) -> Result<Option<Vec<Configuration>>, Cancelled> {
        let [from, via_rad @ .., to] = points else { return Ok(Some(Vec::new())) };
        if points.windows(2).all(|ends| self.moves.is_free(&ends[0], &ends[1])) {
            return Ok(Some(via_rad.to_vec()));
        }
        if self.moves.is_free(from, to) {
            return Ok(Some(Vec::new()));
        }
        let [a, b] = [from, to].map(|end| StationNode::new(0, *end, Route::default()));
        match self.quickest_free(from, self.detours(&a, &b), to, f64::INFINITY) {
            Some(route) => Ok(Some(self.shortcut(from, route, to, ctx)?.via_rad)),
            None => Ok(connect(from, &[*to], &self.moves, ctx)?.map(|(_, via_rad)| via_rad)),
        }
    }

    /// Cuts the corners of a route.
    fn shortcut(&self, from: &Configuration, route: Route, to: &Configuration, ctx: &Context<'_>) -> Result<Route, Cancelled> {
        let path = std::iter::once(*from).chain(route.via_rad).chain([*to]).collect();
        Ok(self.route(from, shortened(path, &self.moves, ctx)?, to))
    }

    fn by_home(&self, a: &StationNode, b: &StationNode) -> Route {
        let mut via_rad = a.from_home.reversed().via_rad;
        via_rad.push(self.cell.home_rad);
        via_rad.extend(&b.from_home.via_rad);
        self.route(&a.configuration, via_rad, &b.configuration)
    }

    fn by_roadmap(&self, a: &StationNode, b: &StationNode) -> Option<Vec<Configuration>> {
        let network = self.network.get()?;
        let [first, last] = [a, b].map(|node| {
            node.connections
                .get_or_init(|| network.connections(&node.configuration, self.retreats_of(node), &self.moves))
                .as_slice()
        });
        network.path((&a.configuration, first), (&b.configuration, last), &self.moves)
    }

    fn retreats_of<'n>(&self, node: &'n StationNode) -> &'n [Configuration] {
        node.retreats.get_or_init(|| self.retreats(&node.configuration))
    }

    fn detours(&self, a: &StationNode, b: &StationNode) -> Vec<Vec<Configuration>> {
        let ends = |node: &StationNode| -> Vec<Vec<Configuration>> {
            std::iter::once(Vec::new()).chain(self.retreats_of(node).iter().map(|point| vec![*point])).collect()
        };
        let over_home = vec![self.arm_at_home(a.configuration.table_rad), self.arm_at_home(b.configuration.table_rad)];
        let mut detours = Vec::new();
        for first in ends(a) {
            for last in ends(b) {
                detours.push([&first[..], &last].concat());
                detours.push([&first[..], &over_home, &last].concat());
            }
        }
        detours.retain(|vias| !vias.is_empty());
        detours
    }

    /// The quickest route through one of `vias` that is free and takes less than `limit_secs`.
    fn quickest_free(
        &self,
        from: &Configuration,
        vias: Vec<Vec<Configuration>>,
        to: &Configuration,
        limit_secs: f64,
    ) -> Option<Route> {
        let mut routes: Vec<_> = vias.into_iter().map(|via_rad| self.route(from, via_rad, to)).collect();
        routes.retain(|route| route.secs < limit_secs);
        sort_ascending(&mut routes, |route| route.secs);
        let mut segments = SegmentCache::new(&self.moves);
        routes.into_iter().find(|route| {
            let points: Vec<_> = std::iter::once(from).chain(&route.via_rad).chain(std::iter::once(to)).collect();
            points.windows(2).all(|ends| segments.is_free(ends[0], ends[1]))
        })
    }

    /// Points beside `station` at the same table angle and with the same IK solution, each with a free straight move to it.
    fn retreats(&self, station: &Configuration) -> Vec<Configuration> {
        let base_from_scanner = self.cell.base_from_scanner(&station.joints_rad);
        RETREATS_MM
            .iter()
            .filter_map(|[back_mm, up_mm]| {
                let shift = base_from_scanner.direction(&-Vector3::z()) * *back_mm + Vector3::z() * *up_mm;
                let moved = Pose::claim(Isometry3::translation(shift.x, shift.y, shift.z) * base_from_scanner.isometry());
                self.nearest(&moved, station)
            })
            .filter(|point| self.moves.is_free(station, point))
            .collect()
    }

    /// The joint vector for `base_from_scanner` that is nearest to `station`, if no axis turns far.
    pub(super) fn nearest(&self, base_from_scanner: &Pose<Base, ScannerFrame>, station: &Configuration) -> Option<Configuration> {
        let base_from_flange = *base_from_scanner * self.cell.flange_from_scanner.inverse();
        let branches = self.cell.robot.kinematics.ik_solutions(&base_from_flange);
        branches
            .into_iter()
            .flat_map(|joints_rad| self.moves.axes.windings(&Configuration { joints_rad, ..*station }))
            .filter(|point| station.max_turn_rad(point) <= RETREAT_TURN_RAD)
            .min_by(|a, b| station.max_turn_rad(a).total_cmp(&station.max_turn_rad(b)))
    }

    fn arm_at_home(&self, table_rad: f64) -> Configuration {
        Configuration { table_rad, ..self.cell.home_rad }
    }

    fn route(&self, from: &Configuration, via_rad: Vec<Configuration>, to: &Configuration) -> Route {
        let points: Vec<_> = std::iter::once(*from).chain(via_rad.iter().copied()).chain([*to]).collect();
        let secs = self.moves.secs(&points);
        Route { via_rad, secs }
    }
}
