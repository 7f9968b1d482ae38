//! A locating scan on a planned part: within its bounds, a part that lies elsewhere is scanned where it lies.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use vantage::cell::{Presets, SpecLibrary};
use vantage::execution::located::{LocateBounds, Locating, Misplaced, Relocate};
use vantage::geometry::Pose;
use vantage::geometry::demo_parts::DemoPart;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{PlanParams, TableMotion};
use vantage::planning::{PlanInput, plan};
use vantage::program::{Expected, compile, scan_configurations, scan_poses};

/// Millimetres along the plate's x and y, and degrees about its axis.
const OFF: [[f64; 3]; 13] = [
    [8.0, 0.0, 3.0],
    [-8.0, 0.0, 3.0],
    [0.0, 8.0, -3.0],
    [0.0, -8.0, -3.0],
    [10.0, 0.0, 0.0],
    [-10.0, 0.0, 0.0],
    [0.0, 10.0, 0.0],
    [0.0, -10.0, 0.0],
    [7.0, 7.0, 4.5],
    [-7.0, -7.0, 4.5],
    [-7.0, 7.0, -4.5],
    [14.0, 0.0, 0.0],
    [0.0, 0.0, 4.9],
];

#[test]
#[ignore = "long: tests/all runs it"]
fn wherever_the_base_lies_within_the_bounds_its_program_is_made_to_fit() {
    // With tilted views a station of the plan stands so near the forearm that others are taken at seven of the poses.
    [false, true].into_iter().for_each(fits_wherever_the_base_lies);
}

fn fits_wherever_the_base_lies(look_closer: bool) {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let mesh = DemoPart::Base.mesh(8_000).expect("a part");
    let input =
        PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
    let never = AtomicBool::new(false);
    let mut params = PlanParams::default();
    params.candidates.look_closer = look_closer;
    let plan = plan(&input, &params, &Context::new(&never, &Silent)).expect("a plan").plan;
    let lies = plan.table_from_part.expect("a cell");
    let plan_sha256 = "00".repeat(32);
    let program = compile(plan.sequences().next().expect("a sequence"), 0, &cell, &plan_sha256, &plan.params);
    let views = plan.views.iter().filter(|view| view.station.is_some()).map(|view| (view.id, view.part_from_scanner)).collect();
    let table_alone = params.motion.table == TableMotion::Alone;
    let locating = Locating {
        cell: Arc::new(cell.clone()),
        part: Arc::new(mesh),
        fixture: None,
        planned: Expected { plan_sha256, table_from_part: lies, table_alone, views },
        clearance_mm: params.motion.clearance_mm,
        bounds: LocateBounds::default(),
        coverage: Some((params, String::new())),
    };
    let mut refused = Vec::new();
    for [x_mm, y_mm, deg] in OFF {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), deg.to_radians());
        let off = Isometry3::from_parts(Translation3::new(x_mm, y_mm, 0.0), turn);
        let located = Pose::claim(off * lies.isometry());
        match locating.relocate(&program, &located, &never) {
            Ok(found) => {
                let [planned, measured] = found.coverage.expect("asked for");
                let secs = found.program.cycle_secs;
                println!("{x_mm} {y_mm} mm, {deg}°: {planned:.4} planned, {measured:.4} measured, {secs:.1} s");
                assert!((planned - measured).abs() <= 0.005, "{planned} {measured}");
                assert_eq!(scan_configurations(&found.program).len(), scan_configurations(&program).len());
                let meant = scan_poses(&program, &cell, &lies);
                for (pose, meant) in scan_poses(&found.program, &cell, &located).iter().zip(meant) {
                    assert!((pose.origin_mm() - meant.origin_mm()).norm() < 1e-6);
                }
            }
            Err(error) => {
                assert!(!matches!(error, Misplaced::TooFar { .. }), "{error}");
                println!("{x_mm} {y_mm} mm, {deg}°: {error}");
                refused.push([x_mm, y_mm, deg]);
            }
        }
    }
    assert!(refused.is_empty(), "{refused:?}");
}
