use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::{MAX_STATIONS_ALONE, MIN_SPREAD_RAD, Station, StationFailure, inside_obstacle, is_shared, solve, solve_as_moved};
use crate::cell::{Cell, CollisionScene, Presets, SpecLibrary};
use crate::geometry::demo_parts::DemoPart;
use crate::geometry::{Mesh, Part, Pose, ScannerFrame, Table};
use crate::planning::context::{Cancelled, Context, Silent};
use crate::planning::params::TableMotion;
use crate::testing::box_mesh;

fn cell() -> Cell {
    Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds")
}

fn cube(edge_mm: f64) -> Mesh {
    box_mesh([0.0; 3], [edge_mm; 3])
}

fn centred(edge_mm: f64) -> Pose<Table, Part> {
    Pose::claim(Isometry3::translation(-0.5 * edge_mm, -0.5 * edge_mm, 0.0))
}

/// Looks at the middle of the cube from `polar` and `azimuth`, baseline level.
fn view(edge_mm: f64, polar_deg: f64, azimuth_deg: f64, distance_mm: f64) -> Pose<Part, ScannerFrame> {
    let (polar, azimuth) = (polar_deg.to_radians(), azimuth_deg.to_radians());
    let out = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let x = (-out).cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let axes = nalgebra::Rotation3::from_basis_unchecked(&[x, (-out).cross(&x), -out]);
    let centre = Vector3::repeat(0.5 * edge_mm);
    Pose::from_parts(centre + out * distance_mm, UnitQuaternion::from_rotation_matrix(&axes))
}

fn solve_one(
    cell: &Cell,
    scene: &CollisionScene,
    placed: &Pose<Table, Part>,
    view: Pose<Part, ScannerFrame>,
) -> Result<Vec<Station>, StationFailure> {
    let flag = AtomicBool::new(false);
    let mut all = solve(&[view], cell, scene, placed, &Context::new(&flag, &Silent)).expect("not cancelled");
    all.remove(0)
}

#[test]
fn stations_put_the_scanner_on_the_view_within_limits_and_clear() {
    let (cell, placed, part) = (cell(), centred(120.0), cube(120.0));
    let scene = CollisionScene::new(&cell, &part, None, &placed, 5.0);
    let axes = cell.axes();
    for (polar, azimuth) in [(30.0, 0.0), (60.0, 100.0), (80.0, 250.0)] {
        let wanted = view(120.0, polar, azimuth, 540.0);
        let stations = solve_one(&cell, &scene, &placed, wanted).expect("reachable");
        assert!(stations.len() > 1, "a turning table leaves a choice");
        for (index, station) in stations.iter().enumerate() {
            let configuration = station.configuration();
            assert!(axes.allow(&configuration) && scene.check(&configuration).is_none());
            let plate_from_scanner =
                cell.base_from_plate(station.table_angle_rad).inverse() * cell.base_from_scanner(&station.joints_rad);
            let found = placed.isometry().inverse() * plate_from_scanner.isometry();
            let expected = wanted.isometry();
            assert!((found.translation.vector - expected.translation.vector).norm() < 1e-6);
            assert!(found.rotation.angle_to(&expected.rotation) < 1e-7);
            let secs = |s: &Station| axes.move_secs(&cell.home_rad, &s.configuration(), 1.0);
            for other in &stations[..index] {
                assert!(secs(other) <= secs(station), "cheapest first");
                let apart = configuration.max_turn_rad(&other.configuration());
                assert!(apart >= MIN_SPREAD_RAD, "stations must differ");
            }
        }
    }
}

#[test]
fn out_of_reach_and_in_the_way_are_told_apart() {
    let (cell, placed, part) = (cell(), centred(120.0), cube(120.0));
    let scene = CollisionScene::new(&cell, &part, None, &placed, 5.0);
    assert_eq!(solve_one(&cell, &scene, &placed, view(120.0, 60.0, 0.0, 5000.0)), Err(StationFailure::Unreachable));
    // So close beside the part that the scanner's housing would be in the plate.
    assert_eq!(solve_one(&cell, &scene, &placed, view(120.0, 90.0, 0.0, 200.0)), Err(StationFailure::Collision));
    // From below the part the viewpoint would be inside the table.
    assert!(inside_obstacle(&view(120.0, 179.0, 0.0, 200.0), &cell, &scene, &placed));
    assert!(!inside_obstacle(&view(120.0, 30.0, 0.0, 540.0), &cell, &scene, &placed));
}

#[test]
fn a_table_that_turns_less_than_a_step_is_used() {
    let (mut cell, placed, part) = (cell(), centred(120.0), cube(120.0));
    let axis = &mut cell.turntable.axis;
    (axis.min_rad, axis.max_rad) = (3.1_f64.to_radians(), 3.9_f64.to_radians());
    let scene = CollisionScene::new(&cell, &part, None, &placed, 5.0);
    let stations = solve_one(&cell, &scene, &placed, view(120.0, 30.0, 0.0, 540.0)).expect("reachable");
    assert!(stations.iter().all(|station| cell.turntable.axis.allows(station.table_angle_rad)), "{stations:?}");
}

#[test]
fn views_before_a_table_that_turns_alone_have_shared_angles_to_choose_from() {
    let (cell, placed, part) = (cell(), centred(120.0), cube(120.0));
    let scene = CollisionScene::new(&cell, &part, None, &placed, 5.0);
    let views = [0.0, 7.0, 22.0].map(|azimuth| view(120.0, 50.0, azimuth, 540.0));
    let flag = AtomicBool::new(false);
    let ctx = Context::new(&flag, &Silent);
    let solved = solve_as_moved(&views, &cell, &scene, &placed, TableMotion::Alone, &ctx).expect("not cancelled");
    let stations: Vec<Vec<Station>> = solved.into_iter().map(|found| found.expect("reachable")).collect();
    let secs = |station: &Station| cell.axes().move_secs(&cell.home_rad, &station.configuration(), 1.0);
    assert!(stations.iter().all(|own| own.len() <= MAX_STATIONS_ALONE && own.is_sorted_by(|a, b| secs(a) <= secs(b))));
    let shared = stations.iter().map(|own| -> BTreeSet<u64> {
        own.iter().map(|station| station.table_angle_rad).filter(|angle| is_shared(*angle)).map(f64::to_bits).collect()
    });
    let of_all = shared.reduce(|all, own| &all & &own).expect("views");
    assert!(of_all.len() >= 3, "{} angles of all three views", of_all.len());
}

#[test]
fn threads_do_not_change_the_stations_and_a_cancel_is_heard() {
    let (cell, placed, part) = (cell(), centred(120.0), cube(120.0));
    let scene = CollisionScene::new(&cell, &part, None, &placed, 5.0);
    let views: Vec<_> = (0..8).map(|i| view(120.0, 20.0 + 9.0 * f64::from(i), 47.0 * f64::from(i), 540.0)).collect();
    let run = |threads: usize, cancelled: bool| {
        let flag = AtomicBool::new(cancelled);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| solve(&views, &cell, &scene, &placed, &Context::new(&flag, &Silent)))
    };
    assert_eq!(run(1, false), run(2, false));
    assert_eq!(run(2, true), Err(Cancelled));
}

#[test]
fn a_larger_clearance_still_leaves_stations_on_the_demo_base() {
    let (cell, part) = (cell(), DemoPart::Base.mesh(20_000).expect("a part"));
    let (min, middle) = (part.aabb().min, part.aabb().centre());
    let placed = Pose::claim(Isometry3::translation(-middle.x, -middle.y, -min.z));
    let to_middle: Pose<Part, Part> = Pose::claim(Isometry3::from(middle.coords));
    let views = [0.0, 90.0, 180.0, 270.0].map(|azimuth| to_middle * view(0.0, 40.0, azimuth, 520.0));
    let flag = AtomicBool::new(false);
    for clearance_mm in [5.0, 20.0, 50.0] {
        let scene = CollisionScene::new(&cell, &part, None, &placed, clearance_mm);
        let solved = solve(&views, &cell, &scene, &placed, &Context::new(&flag, &Silent)).expect("not cancelled");
        assert!(solved.iter().all(Result::is_ok), "{clearance_mm} mm: {solved:?}");
    }
}
