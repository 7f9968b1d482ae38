//! A sequence, with what each view asks of the scanner, as a program.

use super::{Move, Program, Step};
use crate::cell::Cell;
use crate::planning::params::PlanParams;
use crate::planning::sequence::{Leg, Sequence};

/// The program of a setup's sequence: for each view move, settle and scan; then home. `params` must be those that the sequence
/// was ordered with, `plan_sha256` the hash of the plan's file.
#[must_use]
pub fn compile(sequence: &Sequence, setup: usize, cell: &Cell, plan_sha256: &str, params: &PlanParams) -> Program {
    let speed_fraction = params.motion.speed_fraction;
    let mut steps = Vec::with_capacity(3 * sequence.visits.len() + 1);
    for (view, leg) in &sequence.visits {
        steps.push(step(leg, speed_fraction));
        steps.push(Step::Settle { secs: params.scan.settle_secs });
        steps.push(Step::Scan { view: *view, brightness: params.scan.brightness, capture_secs: params.scan.capture_secs });
    }
    steps.push(step(&sequence.return_home, speed_fraction));
    Program {
        plan_sha256: plan_sha256.to_owned(),
        setup,
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
