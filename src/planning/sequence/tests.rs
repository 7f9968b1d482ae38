use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::moves::{min_secs, straight_secs};
use super::station_graph::connect_through_others;
use super::{Configuration, Leg, OrderOptions, Ordered, bounded, bounded_as_moved, order, order_in_sight};
use crate::cell::time_parameterisation::SmoothPath;
use crate::cell::{Axes, Axis, BodySpec, Cell, CollisionScene, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use crate::geometry::{Mesh, Part, Pose, ScannerFrame, Table};
use crate::planning::context::{Cancelled, Context, Silent};
use crate::planning::params::{Corners, PlanParams, TableMotion};
use crate::planning::plan::ViewId;
use crate::planning::stations::{Station, solve};
use crate::testing::box_mesh;

const EDGE_MM: f64 = 120.0;

fn cube() -> Mesh {
    box_mesh([0.0; 3], [EDGE_MM; 3])
}

fn placed() -> Pose<Table, Part> {
    Pose::claim(Isometry3::translation(-0.5 * EDGE_MM, -0.5 * EDGE_MM, 0.0))
}

fn views(count: u32) -> Vec<Pose<Part, ScannerFrame>> {
    (0..count)
        .map(|i| {
            let (polar, azimuth) = (0.3 + 1.1 * (f64::from(i) * 0.618_034).fract(), 2.4 * f64::from(i));
            let out = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
            let x = Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0);
            let axes = nalgebra::Rotation3::from_basis_unchecked(&[x, (-out).cross(&x), -out]);
            Pose::from_parts(Vector3::repeat(0.5 * EDGE_MM) + out * 540.0, UnitQuaternion::from_rotation_matrix(&axes))
        })
        .collect()
}

pub(super) struct Room {
    pub(super) cell: Cell,
    pub(super) scene: CollisionScene,
    pub(super) stations: Vec<Vec<Station>>,
}

pub(super) fn room(count: u32, obstacles: Vec<BodySpec>) -> Room {
    let mut spec = Presets.cell("e05-transcan").expect("preset");
    spec.obstacles.extend(obstacles);
    let cell = spec.build(&Presets).unwrap_or_else(|errors| panic!("{errors:#?}"));
    let scene = CollisionScene::new(&cell, &cube(), None, &placed(), 5.0);
    let flag = AtomicBool::new(false);
    let solved = solve(&views(count), &cell, &scene, &placed(), &Context::new(&flag, &Silent)).expect("not cancelled");
    let stations = solved.into_iter().map(|found| found.unwrap_or_default()).collect();
    Room { cell, scene, stations }
}

pub(super) fn post([x, y]: [f64; 2]) -> BodySpec {
    BodySpec {
        name: "post".into(),
        owner_from_body: PoseSpec { translation_mm: [x, y, 210.0], ..Default::default() },
        shape: ShapeSpec::Cylinder { radius_mm: 30.0, height_mm: 900.0 },
    }
}

impl Room {
    fn order(&self) -> Result<Ordered, Cancelled> {
        self.order_on(1, false)
    }

    fn order_on(&self, threads: usize, cancelled: bool) -> Result<Ordered, Cancelled> {
        self.order_with(&PlanParams::default(), threads, cancelled)
    }

    /// Views with their stations.
    pub(super) fn listed(&self) -> Vec<(ViewId, &[Station])> {
        self.stations.iter().enumerate().map(|(i, stations)| (ViewId::at(i), stations.as_slice())).collect()
    }

    pub(super) fn order_with(&self, params: &PlanParams, threads: usize, cancelled: bool) -> Result<Ordered, Cancelled> {
        let listed = self.listed();
        let flag = AtomicBool::new(cancelled);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        let ctx = Context::new(&flag, &Silent);
        pool.install(|| bounded(order(&listed, &self.cell, &self.scene, params, None, false, &ctx)?, &self.cell, params, &ctx))
    }

    /// Re-checks every segment at half a degree, its times and its limits, from the sequence alone.
    fn assert_sound(&self, ordered: &Ordered) {
        let axes = self.cell.axes();
        // Clearance may dip between the planner's samples, but never to nothing.
        let loose = CollisionScene::new(&self.cell, &cube(), None, &placed(), 0.5);
        let mut here = self.cell.home_rad;
        let legs = ordered.sequence.visits.iter().map(|(_, leg)| leg).chain([&ordered.sequence.return_home]);
        for Leg { via_rad, target, duration_secs, passed_within_rad, turning_secs } in legs {
            let points: Vec<Configuration> =
                std::iter::once(here).chain(via_rad.iter().copied()).chain([target.configuration()]).collect();
            let secs = match passed_within_rad {
                None => axes.path_secs(&points, 0.25),
                Some(within_rad) => SmoothPath::through(&points, *within_rad).secs(&axes, 0.25),
            };
            assert!((secs - duration_secs).abs() < 1e-9);
            assert!((0.0..=*duration_secs + 1e-9).contains(turning_secs));
            for ends in points.windows(2) {
                assert!(axes.allow(&ends[1]));
                let turn_rad = (ends[1].table_rad - ends[0].table_rad).abs();
                assert!(turn_rad == 0.0 || turn_rad > 1e-12, "the table turns by {turn_rad} rad, or stands still to the bit");
                let steps = (ends[0].max_turn_rad(&ends[1]).to_degrees() / 0.5).ceil() as u32;
                for step in 0..=steps {
                    let t = f64::from(step) / f64::from(steps.max(1));
                    assert_eq!(loose.check(&ends[0].toward(&ends[1], t)), None);
                }
            }
            here = target.configuration();
        }
        assert_eq!(here, self.cell.home_rad);
    }
}

fn visited(ordered: &Ordered) -> Vec<u32> {
    let mut ids: Vec<_> = ordered.sequence.visits.iter().map(|(view, _)| view.0).collect();
    ids.sort_unstable();
    ids
}

#[test]
fn stops_are_moved_along_the_table_s_angle_only_to_where_views_are_in_sight() {
    let (room, flag) = (room(7, Vec::new()), AtomicBool::new(false));
    let ctx = Context::new(&flag, &Silent);
    let moved = |in_sight: &super::InSight<'_>| {
        let options = OrderOptions { roadmaps: None, require_all: false, in_sight };
        let params = PlanParams::default();
        let ordered = order_in_sight(&room.listed(), &room.cell, &room.scene, &params, &options, &ctx).expect("not cancelled");
        room.assert_sound(&ordered);
        let is_moved = |(view, leg): &&(ViewId, Leg)| !room.stations[view.index()].contains(&leg.target);
        ordered.sequence.visits.iter().filter(is_moved).map(|(view, _)| *view).collect::<Vec<_>>()
    };
    let freely = moved(&|_, _| true);
    assert!(freely.len() > 1, "stops are moved where they may be: {freely:?}");
    assert_eq!(moved(&|_, _| false), []);
    let kept = freely[0];
    assert!(!moved(&|view, _| view != kept).contains(&kept), "one view alone has to stay");
}

#[test]
fn every_view_is_visited_once_on_checked_paths_from_home_to_home() {
    for count in [7, 14] {
        let room = room(count, Vec::new());
        let ordered = room.order().expect("not cancelled");
        assert_eq!(ordered.no_path, []);
        assert_eq!(visited(&ordered), (0..count).collect::<Vec<_>>());
        for (view, leg) in &ordered.sequence.visits {
            let plate_from_scanner = |station: &Station| {
                room.cell.base_from_plate(station.table_angle_rad).inverse() * room.cell.base_from_scanner(&station.joints_rad)
            };
            let [found, asked] =
                [&leg.target, &room.stations[view.index()][0]].map(|station| *plate_from_scanner(station).isometry());
            assert!((found.translation.vector - asked.translation.vector).norm() < 1e-6, "the view is taken from its pose");
            assert!(found.rotation.angle_to(&asked.rotation) < 1e-7);
        }
        assert!(ordered.sequence.motion_secs() < ordered.sequence.ordered_secs - 0.1, "stations between the steps are quicker");
        assert!(ordered.sequence.ordered_secs >= ordered.sequence.lower_bound_secs - 1e-9);
        room.assert_sound(&ordered);
    }
}

#[test]
fn a_table_that_turns_alone_never_turns_while_the_arm_moves() {
    let room = room(9, Vec::new());
    let mut params = PlanParams::default();
    params.motion.table = TableMotion::Alone;
    let [alone, together] =
        [params, PlanParams::default()].map(|params| room.order_with(&params, 2, false).expect("not cancelled"));
    assert_eq!(visited(&alone), visited(&together));
    room.assert_sound(&alone);
    let mut here = room.cell.home_rad;
    for leg in alone.sequence.visits.iter().map(|(_, leg)| leg).chain([&alone.sequence.return_home]) {
        for next in leg.via_rad.iter().copied().chain([leg.target.configuration()]) {
            assert!(!(here.turns_table(&next) && here.moves_arm(&next)), "one at a time");
            here = next;
        }
    }
    assert!(alone.sequence.motion_secs() > together.sequence.motion_secs());
    assert!(alone.sequence.turning_secs() > 0.0);
    // It need not turn between stops at one angle.
    let angles = |ordered: &Ordered| -> BTreeSet<u64> {
        ordered.sequence.visits.iter().map(|(_, leg)| leg.target.table_angle_rad.to_bits()).collect()
    };
    assert!(
        angles(&alone).len() < angles(&together).len(),
        "{} angles, {} together",
        angles(&alone).len(),
        angles(&together).len()
    );
}

#[test]
fn the_tour_is_no_longer_than_any_fixed_order_of_first_stations() {
    let room = room(6, Vec::new());
    let ordered = room.order().expect("not cancelled");
    let axes = room.cell.axes();
    let first: Vec<_> = room.stations.iter().map(|stations| stations[0].configuration()).collect();
    // Straight moves are a lower bound of what such an order really takes.
    let tour: Vec<_> = std::iter::once(room.cell.home_rad).chain(first).chain([room.cell.home_rad]).collect();
    assert!(ordered.sequence.motion_secs() <= axes.path_secs(&tour, 0.25) + 1e-9);
}

#[test]
fn an_obstacle_in_the_straight_way_is_gone_around() {
    // Posts beside the table, where the arm swings from one side to the other.
    let mut room = room(14, vec![post([300.0, 420.0]), post([300.0, -420.0])]);
    let routes = super::routes::Routes::new(&room.cell, &room.scene, &PlanParams::default().motion);
    let flag = AtomicBool::new(false);
    let ctx = Context::new(&flag, &Silent);
    let all: Vec<Station> = room.stations.iter().flatten().copied().collect();
    let joined: Vec<_> = all
        .iter()
        .filter(|station| routes.home_route(&station.configuration(), &ctx).expect("not cancelled").is_some())
        .collect();
    let mut pairs = joined.iter().flat_map(|a| joined.iter().map(move |b| [**a, **b]));
    let blocked = pairs.find(|[a, b]| room.scene.check_segment(&a.configuration(), &b.configuration()).is_some());
    // Two views with one station each: the tour has to go from one to the other.
    room.stations = blocked.expect("the posts stand in somebody's way").map(|station| vec![station]).into();
    let ordered = room.order().expect("not cancelled");
    assert_eq!(visited(&ordered), [0, 1]);
    assert!(!ordered.sequence.visits[1].1.via_rad.is_empty());
    room.assert_sound(&ordered);
    let mut params = PlanParams::default();
    params.motion.corners = Corners::Round;
    let rounded = room.order_with(&params, 2, false).expect("not cancelled");
    assert!(rounded.sequence.visits[1].1.passed_within_rad.is_some(), "its corners are passed without stopping");
    assert!(rounded.sequence.motion_secs() < ordered.sequence.motion_secs());
    room.assert_sound(&rounded);
}

/// Axes of which the first limits the speed of a straight move and the second its acceleration.
fn unlike_axes() -> Axes {
    let axis = |max_speed_rad_per_s: f64, max_acceleration_rad_per_s2: f64| Axis {
        min_rad: -3.0,
        max_rad: 3.0,
        max_speed_rad_per_s,
        max_acceleration_rad_per_s2,
    };
    let mut axes = [axis(10.0, 10.0); 7];
    (axes[0], axes[1]) = (axis(1.0, 100.0), axis(100.0, 4.0));
    Axes(axes)
}

/// The straight move took 1.25 s and was the bound of a rounded one of 1.15 s.
#[test]
fn the_bound_of_rounded_moves_is_below_a_detour_that_is_quicker_than_the_straight_move() {
    let axes = unlike_axes();
    let mut motion = PlanParams::default().motion;
    (motion.corners, motion.speed_fraction) = (Corners::Round, 1.0);
    let at = |first: f64, second: f64| Configuration::from_axes_rad([first, second, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let way = [at(0.0, 0.0), at(0.25, 0.1), at(0.75, 0.9), at(1.0, 1.0)];
    let rounded_secs = SmoothPath::through(&way, 0.02).secs(&axes, 1.0);
    let (straight, least) = (straight_secs(&axes, &way[0], &way[3], &motion), min_secs(&axes, &way[0], &way[3], &motion));
    assert!((straight - 1.25).abs() < 1e-9 && rounded_secs < 1.2, "{rounded_secs} s of {straight} s");
    assert!((least - 1.01).abs() < 1e-9 && least <= rounded_secs, "at least {least} s");
    motion.corners = Corners::Stop;
    let stopping = min_secs(&axes, &way[0], &way[3], &motion);
    assert!((stopping - straight).abs() < 1e-12, "with stops the straight move is the quickest: {stopping} s");
}

#[test]
fn the_moves_of_a_rounded_tour_are_bounded_by_the_slowest_axis_of_each() {
    let room = room(1, Vec::new());
    let (flag, axes) = (AtomicBool::new(false), room.cell.axes());
    let ctx = Context::new(&flag, &Silent);
    let mut params = PlanParams::default();
    params.motion.corners = Corners::Round;
    let ordered = room.order_with(&params, 1, false).expect("not cancelled");
    let bounded = bounded_as_moved(ordered, &room.cell, &params, &ctx).expect("not cancelled").sequence;
    let stop = bounded.visits[0].1.target.configuration();
    let least = 2.0 * min_secs(&axes, &room.cell.home_rad, &stop, &params.motion);
    assert!((bounded.moving_lower_secs - least).abs() < 1e-9, "{} s, {least} s", bounded.moving_lower_secs);
    assert!(bounded.moving_lower_secs <= bounded.motion_secs() + 1e-9);
}

#[test]
fn a_view_whose_stations_cannot_be_left_has_no_path() {
    let mut room = room(4, Vec::new());
    // Inside the table: whatever leads there collides.
    let mut down = room.cell.home_rad;
    down.joints_rad[1] = (-110.0_f64).to_radians();
    assert!(room.scene.check(&down).is_some());
    room.stations[2] = vec![Station::from(down)];
    let ordered = room.order().expect("not cancelled");
    assert_eq!(ordered.no_path, [ViewId(2)]);
    assert_eq!(visited(&ordered), [0, 1, 3]);
    room.stations = vec![Vec::new()];
    let nothing = room.order().expect("not cancelled");
    assert_eq!((nothing.sequence.visits.len(), nothing.sequence.motion_secs()), (0, 0.0));
    assert_eq!(nothing.no_path, [ViewId(0)]);
}

#[test]
fn threads_do_not_change_the_sequence_and_a_cancel_is_heard() {
    let room = room(8, Vec::new());
    assert_eq!(room.order_on(1, false), room.order_on(2, false));
    assert_eq!(room.order_on(2, true), Err(Cancelled));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn long_tours_come_with_a_bound_near_them() {
    let long = std::env::var_os("VANTAGE_TESTS").map(|_| (60, 1.02));
    for (count, within) in [(20, 1.0001), (30, 1.0001)].into_iter().chain(long) {
        let sequence = room(count, Vec::new()).order_on(2, false).expect("not cancelled").sequence;
        let (secs, least_secs) = (sequence.ordered_secs, sequence.lower_bound_secs);
        println!("{count} views: {secs:.2} s, at least {least_secs:.2} s");
        assert!(least_secs <= secs && secs <= within * least_secs, "{count} views: {secs} s, at least {least_secs} s");
    }
}

#[test]
fn a_station_that_no_simple_way_from_home_leads_to_is_joined_by_another() {
    // Posts on all sides of the table: the arm gets in between them only at some table angles.
    let posts = (0..5).map(|number| {
        let azimuth = 0.6 + 1.256 * f64::from(number);
        post([400.0 + 520.0 * azimuth.cos(), 520.0 * azimuth.sin()])
    });
    let room = room(24, posts.collect());
    let flag = AtomicBool::new(false);
    let ctx = Context::new(&flag, &Silent);
    let params = PlanParams::default();
    let routes = super::Routes::new(&room.cell, &room.scene, &params.motion);
    let all: Vec<_> = room.stations.iter().flatten().map(Station::configuration).collect();
    let by_simple_ways = |station: &Configuration| routes.home_route(station, &ctx).expect("not cancelled");
    let mut found = vec![all.iter().map(by_simple_ways).collect::<Vec<_>>()];
    let simple = found[0].iter().flatten().count();
    let stations: Vec<Station> = room.stations.iter().flatten().copied().collect();
    connect_through_others(&[(ViewId(0), &stations)], &mut found, &routes, &ctx).expect("not cancelled");
    let joined = found[0].iter().flatten().count();
    println!("{} stations, {simple} joined by simple ways, {joined} in all", all.len());
    assert!(joined > simple);
    for (station, route) in all.iter().zip(&found[0]) {
        let Some(route) = route else { continue };
        let way: Vec<_> = std::iter::once(room.cell.home_rad).chain(route.via_rad.iter().copied()).chain([*station]).collect();
        assert!((room.cell.axes().path_secs(&way, params.motion.speed_fraction) - route.secs).abs() < 1e-9);
        assert!(way.windows(2).all(|ends| room.scene.check_segment(&ends[0], &ends[1]).is_none()));
    }
}
