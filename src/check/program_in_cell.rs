//! A program, by itself alone; and with the cell its motion, with the plan the scans that it has to take, and with the part
//! collisions with it and the area that the scans measure.

use serde_json::Value;

use super::coverage::{ProgramCoverage, beside_share};
use super::place::CheckPlace;
use super::{Reference, Sound, field_errors, measured_as_planned, read_known, whole};
use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{Cell, FieldError};
use crate::planning::context::Context;
use crate::program::{self, Finding, Program};
use crate::wire::UnverifiedStatement;
use crate::wire::plan::PlanDocument;
use crate::wire::program::{ProgramDocument, StepDocument};
use crate::wire::warnings;
use crate::wire::words::counted;

/// Difference of two times that is rounding, s: sums of many moves.
const SAME_SECS: f64 = 0.005;

/// Checks the document of a program.
///
/// # Errors
/// Every finding in the document; where there is none, every one in its cell, a fixture that is missing first; without one, the
/// coverage that is not as planned.
pub(super) fn check(
    value: &Value,
    place: Option<CheckPlace<'_>>,
    reference: &Reference,
    mut sound: Sound,
    ctx: &Context<'_>,
) -> Result<Sound, Vec<FieldError>> {
    let document: ProgramDocument = read_known(value)?;
    let program = document.program()?;
    reference.owns(&program).map_err(|finding| field_errors(&[finding]))?;
    reference.check_plan()?;
    if reference.plan.is_some() {
        sound.verify("plan_sha256 and setup: by the plan");
    }
    let extent = match place {
        Some(CheckPlace::NoCell(_)) => {
            return Err(whole("is to be checked without a cell, and moves one; give its cell".to_owned()));
        }
        Some(CheckPlace::Cell(cell)) => check_in((&program, &document), cell, reference, &mut sound, ctx)?,
        None => {
            let off_orders = reference.off_orders(&program);
            if !off_orders.is_empty() {
                return Err(field_errors(&off_orders));
            }
            sound.leave("motion, collisions and scans", "give the cell");
            " (structure and ranges checked; given a cell, motion too)".to_owned()
        }
    };
    let steps = counted(document.steps.len(), "step");
    Ok(sound.described(format!("program with {steps}, {:.1} s{extent}", document.cycle_secs)))
}

/// Checks a program in its cell; returns the extent of the checks in words.
fn check_in(
    (program, document): (&Program, &ProgramDocument),
    cell: &Cell,
    reference: &Reference,
    sound: &mut Sound,
    ctx: &Context<'_>,
) -> Result<String, Vec<FieldError>> {
    reference.check_placed().map_err(|reason| whole(reason.to_owned()))?;
    reference.check_scanner(cell)?;
    let expected = reference.expected(program.setup);
    let scene = reference.scene(cell, expected.as_ref());
    let mut found = program::check(program, cell, &scene, expected.as_ref());
    let stale = program::check_calibration(cell, &reference.present.conditions(cell));
    found.extend(stale.into_iter().filter(|finding| !found.contains(finding)).collect::<Vec<_>>());
    found.extend(reference.off_orders(program));
    // First: without its fixture a part collides with less, and less of it is hidden.
    let errors: Vec<FieldError> = reference.lacking_fixture().into_iter().chain(field_errors(&found)).collect();
    if !errors.is_empty() {
        return Err(errors);
    }
    let with_part = reference.with_part(false);
    sound.warnings.extend(warnings::of_sight(cell, "/cell"));
    sound.verify("home, robot, turntable and calibration: by the given cell");
    sound.verify("steps: limits of the axes, speed, durations and cycle_secs");
    let (clearance_mm, of_what) = match &reference.plan {
        Some((plan, _)) => (plan.params.motion.clearance_mm, "motion.clearance_mm of the plan"),
        None => (MIN_CLEARANCE_MM, "the smallest that a plan may ask for, as the plan is not given"),
    };
    sound.verify(format!("moves: no collision on any segment, {with_part}, with a clearance of {clearance_mm} mm ({of_what})"));
    let before = sound.unverified.len();
    tell_scans(document, reference, sound);
    if reference.part.is_none() {
        sound.leave("collisions with the part", "give the plan and the part");
    }
    let mut differing = None;
    let measured = match reference.program_coverage(program, cell, expected.as_ref(), ctx)? {
        ProgramCoverage::Compared { measured, planned, other_engine } => {
            if let Some(fault) = program::off_coverage(measured, planned) {
                return Err(field_errors(&[Finding { step: None, fault }]));
            }
            sound.measured_of_asked = Some(measured);
            sound.verify("coverage: what the scans measure is what the plan states, within 0.0005");
            differing = other_engine;
            measured_as_planned("scans", measured) + &beside_share(differing.as_ref())
        }
        ProgramCoverage::Unchecked(reason) => {
            sound.leave("coverage", reason);
            String::new()
        }
    };
    let left: Vec<String> = sound.unverified[before..]
        .iter()
        .map(|UnverifiedStatement { statement, reason }| format!("{statement} ({reason})"))
        .collect();
    sound.unverified.extend(differing);
    let unchecked = if left.is_empty() { String::new() } else { format!("; not checked: {}", left.join(", ")) };
    Ok(format!(", sound in cell {}{measured}{unchecked}", cell.name))
}

/// Tells what was verified of the scans of a program that is sound: by its plan, where that is given.
fn tell_scans(document: &ProgramDocument, reference: &Reference, sound: &mut Sound) {
    match &reference.plan {
        Some((plan, _)) => {
            sound.verify("scans: pose, settling, capture and brightness as the plan has them for each viewpoint");
            tell_tour(document, plan, sound);
        }
        None => {
            sound.leave("scans at the viewpoints of the plan", "give the plan");
            let reason = format!("{MIN_CLEARANCE_MM} mm was kept, the smallest that a plan may ask for: give the plan");
            sound.leave("clearance of the plan", reason);
        }
    }
}

/// Tells whether a program has the order and the time that its plan states. A plan of several setups states the time of all of them.
fn tell_tour(document: &ProgramDocument, plan: &PlanDocument, sound: &mut Sound) {
    let is_scanned_here = |id: &&u32| plan.setups.get(document.setup).is_none_or(|setup| setup.viewpoints.contains(id));
    let planned: Vec<u32> = plan.sequence.iter().filter(is_scanned_here).copied().collect();
    let scan = |step: &StepDocument| if let StepDocument::Scan { viewpoint, .. } = step { Some(*viewpoint) } else { None };
    let mut scanned: Vec<u32> = document.steps.iter().filter_map(scan).collect();
    // A view may be captured twice.
    scanned.dedup();
    match scanned == planned {
        true => sound.verify("sequence: as the plan states it"),
        false => sound.leave("sequence of the plan", "the program scans in another order"),
    }
    let stated_secs = plan.motion.as_ref().map(|motion| motion.cycle_secs).filter(|secs| *secs > 0.0 && plan.setups.is_empty());
    match stated_secs {
        None => sound.leave("cycle time of the plan", "it states none for this program alone"),
        Some(secs) if (document.cycle_secs - secs).abs() <= SAME_SECS => sound.verify("cycle time: as the plan states it"),
        Some(secs) => {
            let reason = format!("the program takes {:.1} s where the plan says {secs:.1} s", document.cycle_secs);
            sound.leave("cycle time of the plan", reason);
        }
    }
}
