//! A sequence, with what each view asks of the scanner, as a program.

use super::{Move, Program, ProgramCalibration, Step};
use crate::cell::Cell;
use crate::planning::params::PlanParams;
use crate::planning::plan::PlannedView;
use crate::planning::sequence::{Leg, Sequence};

/// The program of a setup's sequence: for each view move, settle and scan; then home. `params` must be those that the sequence
/// was ordered with, `plan_sha256` the hash of the plan's file.
#[must_use]
pub fn compile(sequence: &Sequence, setup: usize, cell: &Cell, plan_sha256: &str, params: &PlanParams) -> Program {
    compile_views(sequence, setup, cell, plan_sha256, params, &[])
}

/// [`compile()`], each view with the brightness that its plan gives it, in two captures where it has two levels. `views` are those of
/// the plan, by number; one that is not among them is captured once, at the brightness of `params`.
#[must_use]
pub fn compile_views(
    sequence: &Sequence,
    setup: usize,
    cell: &Cell,
    plan_sha256: &str,
    params: &PlanParams,
    views: &[PlannedView],
) -> Program {
    let scan = &params.scan;
    let speed_fraction = params.motion.speed_fraction;
    let mut steps = Vec::with_capacity(3 * sequence.visits.len() + 1);
    for (view, leg) in &sequence.visits {
        steps.push(step(leg, speed_fraction));
        steps.push(Step::Settle { secs: scan.settle_secs });
        let levels = views.get(view.index()).map_or_else(|| vec![scan.brightness.usual_level()], |view| view.levels(scan));
        let captures = levels.into_iter();
        steps.extend(captures.map(|brightness| Step::Scan { view: *view, brightness, capture_secs: scan.capture_secs }));
    }
    steps.push(step(&sequence.return_home, speed_fraction));
    Program {
        plan_sha256: plan_sha256.to_owned(),
        setup,
        calibration: ProgramCalibration::of(cell),
        robot: cell.robot.name.clone(),
        turntable: cell.turntable.name.clone(),
        home_rad: cell.home_rad,
        cycle_secs: steps.iter().map(Step::secs).sum(),
        steps,
    }
}

fn step(leg: &Leg, speed_fraction: f64) -> Step {
    Step::Move(Move {
        via_rad: leg.via_rad.clone(),
        target_rad: leg.target.configuration(),
        speed_fraction,
        duration_secs: leg.duration_secs,
        passed_within_rad: leg.passed_within_rad,
    })
}
