use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use super::{
    Objection, RunJob, Safeguards, WORKSPACE_MARGIN_MM, Workspace, furthest_axis, outside_workspace, to_run, to_start, to_target,
    unfit, watched_mm, workspace_pieces,
};
use crate::cell::{
    CalibrationObjection, CalibrationProvenance, Cell, CollisionScene, CompensationProvenance, Configuration, PoseSpec,
    UseConditions,
};
use crate::execution::device::{ArmState, Condition, FaultCode, TableState};
use crate::execution::profile::segment;
use crate::execution::session::{DeviceRole, MachineState, RunState, StopCause};
use crate::execution::tests::rehearsal::{hashes, job, planned};
use crate::program::Fault;
use crate::testing::box_mesh;

const MAX_AGE: Duration = Duration::from_millis(100);

fn state(arm: Condition, table: Condition) -> MachineState {
    let at = Instant::now();
    MachineState {
        arm: ArmState { at, positions_rad: [0.0; 6], condition: arm },
        table: TableState { at, positions_rad: [0.0], condition: table },
    }
}

#[tokio::test(start_paused = true)]
async fn each_condition_of_each_device_forbids_motion() {
    type Change = fn(&mut Condition);
    type Cause = fn(DeviceRole) -> StopCause;
    let cases: [(Change, Cause); 7] = [
        (|c| c.emergency_stop = true, StopCause::EmergencyStop),
        (|c| c.guard_open = true, StopCause::GuardOpen),
        (|c| c.hand_guided = true, StopCause::HandGuided),
        (|c| c.paused = true, StopCause::HeldAtDevice),
        (|c| c.powered = false, StopCause::PowerLost),
        (|c| c.brakes_open = false, StopCause::PowerLost),
        (|c| c.fault = Some(FaultCode(9)), |device| StopCause::Fault { device, code: 9, text: None }),
    ];
    for (change, cause) in cases {
        let mut changed = Condition::READY;
        change(&mut changed);
        for (device, state) in
            [(DeviceRole::Arm, state(changed, Condition::READY)), (DeviceRole::Table, state(Condition::READY, changed))]
        {
            assert_eq!(unfit(&state, RunState::Running, Instant::now(), MAX_AGE), Some(cause(device)));
        }
    }
    let ready = state(Condition::READY, Condition::READY);
    assert_eq!(unfit(&ready, RunState::Running, Instant::now(), MAX_AGE), None);
    assert_eq!(unfit(&ready, RunState::Running, ready.arm.at + MAX_AGE, MAX_AGE), None);
    let late = ready.table.at + MAX_AGE + Duration::from_millis(1);
    assert!(matches!(unfit(&ready, RunState::Running, late, MAX_AGE), Some(StopCause::Stale { device: DeviceRole::Arm, .. })));
    // Drives are switched on by arming, and a pause may be held at the device.
    let off = state(Condition { powered: false, ..Condition::READY }, Condition::READY);
    assert_eq!(unfit(&off, RunState::Ready, Instant::now(), MAX_AGE), None);
    let held = state(Condition { paused: true, ..Condition::READY }, Condition::READY);
    assert_eq!(unfit(&held, RunState::Paused, Instant::now(), MAX_AGE), None);
}

#[test]
fn a_run_is_refused_where_the_part_stands_in_the_housing_of_the_table() {
    let (cell, expected) = (&planned().cell, &planned().expected);
    let sunk = box_mesh([-50.0, -50.0, -60.0], [50.0, 50.0, 100.0]);
    let scene = CollisionScene::new(cell, &sunk, None, &expected.table_from_part, 5.0);
    let job = RunJob::new(planned().program.clone(), cell.clone(), &scene, Some(expected), [hashes(), hashes()]);
    let Err(findings) = job else { panic!("taken for sound") };
    assert!(matches!(findings[..], [ref one] if matches!(one.fault, Fault::Placement { .. })), "{findings:?}");
}

#[test]
fn a_target_is_refused_for_each_thing_that_is_wrong_with_it() {
    let (job, safeguards) = (job(), Safeguards::default());
    let (axes, home) = (planned().cell.axes(), planned().program.home_rad);
    let to = |change: &dyn Fn(&mut Configuration)| {
        let mut to = home;
        change(&mut to);
        segment(&axes, &home, &to, 1.0, 1).expect("moves")
    };
    let good = to(&|to| to.joints_rad[5] += 0.1);
    assert_eq!(to_target(&job, &home, &good, &safeguards), None);
    let objection = |change: &dyn Fn(&mut Configuration)| to_target(&job, &home, &to(change), &safeguards);
    assert!(matches!(objection(&|to| to.joints_rad[3] = 10.0), Some(Objection::OutsideLimits { axis: 4, .. })));
    assert!(matches!(objection(&|to| to.table_rad = 10.0), Some(Objection::OutsideLimits { axis: 7, .. })));
    let into_table = [0.0, -110.0, 60.0, 0.0, 0.0, 0.0].map(f64::to_radians);
    assert!(matches!(objection(&|to| to.joints_rad = into_table), Some(Objection::Collision(_))));
    let mut fast = good.clone();
    fast.max_speed_rad_s[5] = axes.0[5].max_speed_rad_per_s * 1.001;
    assert_eq!(to_target(&job, &home, &fast, &safeguards), Some(Objection::TooFast { axis: 6 }));
    let mut harsh = good.clone();
    harsh.max_acceleration_rad_s2[5] = axes.0[5].max_acceleration_rad_per_s2 * 1.001;
    assert_eq!(to_target(&job, &home, &harsh, &safeguards), Some(Objection::TooFast { axis: 6 }));
    let mut nowhere = good.clone();
    nowhere.positions_rad[2] = f64::NAN;
    assert_eq!(to_target(&job, &home, &nowhere, &safeguards), Some(Objection::TargetNotFinite));
    let lost = Configuration { table_rad: f64::NAN, ..home };
    assert_eq!(to_target(&job, &lost, &good, &safeguards), Some(Objection::MeasuredNotFinite));
    let workspace = Some(Workspace { min_mm: [-2000.0; 3], max_mm: [2000.0, 2000.0, 200.0] });
    let low = Safeguards { workspace, ..safeguards };
    assert!(matches!(to_target(&job, &home, &good, &low), Some(Objection::OutsideWorkspace { .. })));
}

/// The tightest box around flange and scanner at the ends of `pieces` equal pieces of a segment.
fn box_around(cell: &Cell, from: &Configuration, to: &Configuration, pieces: u32) -> Workspace {
    let empty = Workspace { min_mm: [f64::INFINITY; 3], max_mm: [f64::NEG_INFINITY; 3] };
    let shares = (0..=pieces).map(|piece| f64::from(piece) / f64::from(pieces));
    shares.flat_map(|share| watched_mm(cell, &from.toward(to, share))).fold(empty, |all, at| Workspace {
        min_mm: std::array::from_fn(|k| all.min_mm[k].min(at[k])),
        max_mm: std::array::from_fn(|k| all.max_mm[k].max(at[k])),
    })
}

/// Farthest distance of a box beyond another one.
fn beyond_mm(all: &Workspace, within: &Workspace) -> f64 {
    (0..3).map(|k| (within.min_mm[k] - all.min_mm[k]).max(all.max_mm[k] - within.max_mm[k])).fold(0.0, f64::max)
}

/// At 21 points of a turn by 340° millimetres beyond the box went unseen.
#[test]
fn a_way_that_leaves_the_workspace_between_few_samples_is_refused() {
    let (job, home) = (job(), planned().program.home_rad);
    let [from, to] = [-170.0_f64, 170.0].map(|turned_deg| Configuration {
        joints_rad: [turned_deg, -30.0, 80.0, 0.0, 60.0, 0.0].map(f64::to_radians),
        table_rad: turned_deg.to_radians(),
    });
    let objection = |workspace: Workspace| {
        outside_workspace(&job, &from, &to, &Safeguards { workspace: Some(workspace), ..Safeguards::default() })
    };
    let (coarse, fine) = (box_around(&job.cell, &from, &to, 20), box_around(&job.cell, &from, &to, 20_000));
    assert!(beyond_mm(&fine, &coarse) > 5.0 * WORKSPACE_MARGIN_MM, "{}", beyond_mm(&fine, &coarse));
    assert!(matches!(objection(coarse), Some(Objection::OutsideWorkspace { .. })));
    let loose = Workspace { min_mm: fine.min_mm.map(|low| low - 0.01), max_mm: fine.max_mm.map(|high| high + 0.01) };
    assert_eq!(objection(loose), None);
    // A table that turns alone moves neither.
    assert_eq!(workspace_pieces(&job.cell, &home, &Configuration { table_rad: home.table_rad + 3.0, ..home }), 1);
}

#[test]
fn between_the_points_at_which_the_workspace_is_asked_less_than_the_margin_goes_unseen() {
    let (cell, home) = (&planned().cell, planned().program.home_rad);
    for (seed, deg) in [(1_u32, 3.0), (2, 40.0), (3, 90.0), (4, 200.0), (5, 340.0)] {
        // Each axis another share of the angle, either way.
        let share = |axis: u32| f64::from((7 * seed + 5 * axis) % 11) / 5.0 - 1.0;
        let to = home.along(&[0, 1, 2, 3, 4, 5, 6].map(|axis| share(axis) * f64::to_radians(deg)), 1.0);
        let pieces = workspace_pieces(cell, &home, &to);
        assert!((2..3000).contains(&pieces), "{pieces} pieces at {deg}°");
        let (asked, fine) = (box_around(cell, &home, &to, pieces), box_around(cell, &home, &to, 8 * pieces));
        assert!(beyond_mm(&fine, &asked) < WORKSPACE_MARGIN_MM, "{} mm at {deg}°", beyond_mm(&fine, &asked));
    }
}

/// Two hashes of 64 digits said neither what had happened nor how to go on.
#[test]
fn a_changed_cell_is_told_as_changed_with_what_to_do() {
    let objection = Objection::OtherHash { what: "cell", approved: "ab".repeat(32), present: "cd".repeat(32) };
    let wanted = "the cell was changed since the run was approved (SHA-256 now cdcdcdcdcdcd, then abababababab); put back the \
                  cell of then, or plan again and approve that";
    assert_eq!(objection.to_string(), wanted);
}

#[test]
fn a_start_is_refused_beyond_its_tolerance() {
    let (safeguards, home) = (Safeguards::default(), planned().program.home_rad);
    let off = |deg: f64| to_start(&Configuration { table_rad: home.table_rad + deg.to_radians(), ..home }, &home, &safeguards);
    assert_eq!(off(0.49), None);
    assert!(matches!(off(0.51), Some(Objection::OffStart { axis: 7, .. })));
}

/// An angle that was not a number stood exactly where it should: no distance is larger than one that is not a number either.
#[test]
fn an_angle_that_is_not_a_number_stands_nowhere() {
    let (safeguards, home) = (Safeguards::default(), planned().program.home_rad);
    for lost_rad in [f64::NAN, -f64::NAN, f64::INFINITY] {
        let mut lost = home;
        lost.joints_rad[2] = lost_rad;
        let (axis, off_rad) = furthest_axis(&home, &lost);
        assert!(axis == 3 && !off_rad.is_finite(), "axis {axis}: {off_rad}");
        assert_eq!(to_start(&lost, &home, &safeguards), Some(Objection::MeasuredNotFinite));
    }
    let told = Objection::MeasuredNotFinite.to_string();
    assert!(told.contains("check its link") && !told.contains("plan again"), "the program is not at fault: {told}");
}

#[test]
fn options_out_of_range_are_refused() {
    let job = job();
    let steps = planned().program.steps.len();
    assert_eq!(to_run(&job, steps - 1, 0.01), []);
    assert_eq!(to_run(&job, steps, 1.0), [Objection::NoSuchStep { step: steps, steps }]);
    assert_eq!(to_run(&job, 0, 0.0), [Objection::Override(0.0)]);
    assert!(matches!(to_run(&job, 0, f64::NAN)[..], [Objection::Override(_)]));
}

/// A compensation that is fresh when the job is made, and stale when it is begun half an hour later.
#[tokio::test(start_paused = true)]
async fn a_compensation_that_went_stale_is_refused_before_motion() {
    let mut job = job();
    let mut cell = Cell::clone(&planned().cell);
    cell.calibrated = Some(compensated(&cell));
    job.cell = Arc::new(cell);
    let fresh = UseConditions { compensation_age_hours: Some(23.8), ..UseConditions::default() };
    let job = job.under(fresh);
    assert_eq!(to_run(&job, 0, 1.0), []);
    tokio::time::advance(Duration::from_secs(1800)).await;
    let found = to_run(&job, 0, 1.0);
    assert!(matches!(&found[..], [Objection::Calibration(CalibrationObjection::TooOld { .. })]), "{found:?}");
    assert!(found[0].to_string().starts_with("the compensation is 24.3 h old"), "{}", found[0]);
    let hot = job.clone().under(UseConditions { temperature_c: Some(31.0), ..fresh });
    assert!(matches!(&to_run(&hot, 0, 1.0)[..], [Objection::Calibration(CalibrationObjection::Temperature { .. })]));
}

fn compensated(cell: &Cell) -> CalibrationProvenance {
    let id = "ab".repeat(32);
    let compensation = CompensationProvenance {
        cell: cell.name.clone(),
        calibration_id: id.clone(),
        at: "2026-11-23T06:00:00Z".into(),
        temperature_c: Some(22.0),
        flange_from_scanner: PoseSpec::from(&cell.flange_from_scanner),
        rotation_deg: 0.05,
        translation_mm: 0.4,
        max_rotation_deg: 1.0,
        max_translation_mm: 8.4,
        max_age_hours: 24.0,
        max_temperature_change_k: 5.0,
    };
    CalibrationProvenance {
        by: "vantage".into(),
        at: "2026-11-20T09:00:00Z".into(),
        calibration_id: id,
        data_sha256: "cd".repeat(32),
        rms_rotation_deg: 0.01,
        rms_translation_mm: 0.1,
        point_sd_mm: 0.05,
        rotation_sd_deg: 0.004,
        translation_sd_mm: 0.04,
        temperature_c: None,
        max_age_hours: None,
        max_temperature_change_k: None,
        compensation_sha256: Some("ef".repeat(32)),
        compensation: Some(compensation),
    }
}
