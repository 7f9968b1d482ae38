use std::sync::atomic::AtomicBool;

use super::PoseDeviation;
use crate::cell::Configuration;
use crate::execution::session::{RunOptions, RunState, simulate_with};
use crate::execution::tests::rehearsal::{job, planned, twins};
use crate::planning::PlanInput;
use crate::planning::context::{Context, Silent};
use crate::planning::params::PlanParams;

#[test]
fn a_deviation_of_the_table_turns_what_the_plate_sees() {
    let (cell, home) = (&planned().cell, planned().program.home_rad);
    let none = PoseDeviation::of(cell, &home, &home);
    assert!(none.optical_axis_deg < 1e-9 && none.position_mm < 1e-9);
    let turned = Configuration { table_rad: home.table_rad + 0.1_f64.to_radians(), ..home };
    let found = PoseDeviation::of(cell, &home, &turned);
    let plate_from_scanner = cell.base_from_plate(home.table_rad).inverse() * cell.base_from_scanner(&home.joints_rad);
    let (at, axis) = (plate_from_scanner.origin_mm(), plate_from_scanner.direction(&nalgebra::Vector3::z()));
    let chord = 2.0 * at.x.hypot(at.y) * (0.05_f64.to_radians()).sin();
    assert!((found.position_mm - chord).abs() < 1e-6, "{found:?}");
    assert!((found.optical_axis_deg - 0.1 * axis.x.hypot(axis.y)).abs() < 1e-4, "{found:?}");
    assert!((found.max_axis_deg - 0.1).abs() < 1e-9);
}

#[tokio::test(start_paused = true)]
async fn what_was_measured_is_evaluated_where_it_was_taken() {
    let (machine, trigger, access) = twins();
    access.arm.mismeasure([0.08_f64.to_radians(), 0.0, 0.0, 0.0, 0.0, 0.0]);
    let record = simulate_with(job(), machine, trigger, RunOptions::default()).ended().await;
    assert_eq!(record.status.state, RunState::Done, "{}", record.status.reason);
    let most = record.max_deviation();
    assert!((0.5..2.0).contains(&most.position_mm) && most.optical_axis_deg > 0.01 && most.optical_axis_deg < 0.09, "{most:?}");
    let planned = planned();
    let lies = &planned.expected.table_from_part;
    for (taken, (_, meant)) in record.taken_views(&planned.cell, lies).iter().zip(record.scans().map(|scan| {
        let view = scan.view.expect("a view");
        planned.expected.views.iter().find(|(known, _)| *known == view).expect("planned")
    })) {
        let off_mm = (taken.part_from_scanner.origin_mm() - meant.origin_mm()).norm();
        assert!((0.5..2.0).contains(&off_mm), "{off_mm}");
    }
    let input = PlanInput {
        mesh: &planned.part,
        fixture: None,
        part_sha256: "",
        scanner: &planned.cell.scanner,
        cell: Some(&planned.cell),
        roadmaps: None,
    };
    let flag = AtomicBool::new(false);
    let found = record.measured(&input, &PlanParams::default(), &planned.cell, lies, &Context::new(&flag, &Silent));
    let found = found.expect("evaluated");
    assert!(found.measured_mm2 > 0.2 * found.asked_mm2 && found.measured_mm2 < found.asked_mm2, "{found:?}");
}
