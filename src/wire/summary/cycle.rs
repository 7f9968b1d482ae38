//! Cycle time: of the motion as planned, with its parts, and of the program that the robot runs.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use crate::cell::Dialect;
use crate::planning::params::Corners;
use crate::planning::plan::Plan;
use crate::wire::plan::{MotionDocument, options};
use crate::wire::words::{fixed, order_claim};

/// Difference from which on two cycles are told apart, s: half of the last decimal that is shown.
const ALIKE_SECS: f64 = 0.05;

/// Parts of a cycle time, summed over all setups. Moving, settling and scanning add up to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct CycleParts {
    /// Time of all moves, s.
    pub moving_secs: f64,
    /// Part of `moving_secs` in which the table turns, s.
    pub turning_secs: f64,
    /// Time spent waiting for everything to stand still, s.
    pub settling_secs: f64,
    /// Time of all captures, s.
    pub scanning_secs: f64,
}

/// Cycle of a program in the dialect of the robot, summed over all setups.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ProgramCycle {
    /// Dialect of the robot's controller.
    pub dialect: Dialect,
    /// Predicted cycle time of the program in that dialect, s, as stated in its header.
    pub cycle_secs: f64,
    /// Parameters with which the plan's own motion matches that of the program; empty if it already does.
    pub set: BTreeMap<String, Value>,
    /// Command-line options that set these parameters; `null` if there are none, and for further views, whose rescan takes none.
    pub command: Option<String>,
    /// Work that the integrator must do before the first run of the program, in a clause; `null` if its file runs as it is.
    #[serde(default)]
    pub before_first_run: Option<String>,
}

impl ProgramCycle {
    /// The cycle of a program in a dialect, with the work before its first run. `moves_in_turn` says that it moves table and arm in
    /// turn where the plan moves both at once.
    #[must_use]
    pub fn new(dialect: Dialect, cycle_secs: f64, moves_in_turn: bool, before_first_run: Option<String>) -> Self {
        let set = if moves_in_turn { BTreeMap::from([("motion.table".to_owned(), json!("alone"))]) } else { BTreeMap::new() };
        let command = (!set.is_empty()).then(|| options(&set));
        Self { dialect, cycle_secs, set, command, before_first_run }
    }

    /// The cycle beside a plan whose corners are so: those that are rounded move table and arm together, which a table that moves
    /// alone excludes.
    #[must_use]
    pub fn beside_corners(mut self, corners: Corners) -> Self {
        if self.differs() && corners == Corners::Round {
            self.set.insert("motion.corners".to_owned(), json!("stop"));
            self.command = Some(options(&self.set));
        }
        self
    }

    /// The cycle without options, for a plan of further views: a rescan takes no parameters of the motion.
    #[must_use]
    pub fn without_options(self) -> Self {
        Self { command: None, ..self }
    }

    /// Returns true if the program moves table and arm in turn where the plan moves both at once.
    #[must_use]
    pub fn differs(&self) -> bool {
        !self.set.is_empty()
    }

    /// Work that the integrator has to do before the first run, in a sentence.
    #[must_use]
    pub fn before_first_run_text(&self) -> Option<String> {
        let dialect = self.dialect.as_str();
        self.before_first_run.as_ref().map(|work| format!("Before the first run of the program ({dialect}): {work}"))
    }

    /// The cycle in a clause, where it is not that of the motion as planned.
    pub(super) fn text(&self, planned_secs: Option<f64>) -> Option<String> {
        let program = format!("; {} s as the robot's own program ({})", fixed(self.cycle_secs, 1), self.dialect.as_str());
        if self.differs() {
            let to_plan = self.command.as_ref().map_or_else(String::new, |command| format!("; to plan for that: {command}"));
            return Some(format!("{program}, which moves table and arm in turn{to_plan}"));
        }
        let is_other = planned_secs.is_some_and(|planned_secs| (self.cycle_secs - planned_secs).abs() >= ALIKE_SECS);
        is_other.then(|| format!("{program}, whose speeds are set in whole percent"))
    }
}

impl From<&MotionDocument> for CycleParts {
    fn from(motion: &MotionDocument) -> Self {
        let MotionDocument { moving_secs, turning_secs, settling_secs, scanning_secs, .. } = *motion;
        Self { moving_secs, turning_secs, settling_secs, scanning_secs }
    }
}

/// Cycle time with its parts: "Cycle 31.2 s = 23.4 s moving + 6 × 1.3 s scanning"; no time and no order of a tour without views.
pub(super) fn text(plan: &Plan, motion: &MotionDocument) -> String {
    let scan = &plan.params.scan;
    let [cycle, moving] = [motion.cycle_secs, motion.moving_secs].map(|secs| fixed(secs, 1));
    let visits = plan.visits().count();
    if visits == 0 {
        return "No cycle: no view is executed".to_owned();
    }
    let [each, settling] = [scan.settle_secs + scan.capture_secs, scan.settle_secs].map(|secs| (secs * 100.0).round() / 100.0);
    let again = match plan.captures() - visits {
        0 => String::new(),
        again => format!(" + {again} × {} s for second captures", (scan.capture_secs * 100.0).round() / 100.0),
    };
    let settling = if scan.settle_secs > 0.0 { format!(" ({settling} s of each is settling)") } else { String::new() };
    let order = order_claim(motion.moving_secs, motion.moving_secs_lower).map_or_else(String::new, |claim| format!("; {claim}"));
    let turning_over = if plan.setups.len() > 1 { "; turning the part over is not counted" } else { "" };
    format!(
        "Cycle {cycle} s = {moving} s moving ({}) + {visits} × {each} s scanning{settling}{again}{order}{turning_over}",
        turning(motion)
    )
}

/// Part of the moves in which the table turns, in a clause.
fn turning(motion: &MotionDocument) -> String {
    match motion.turning_secs {
        turning_secs if turning_secs < ALIKE_SECS => "table at rest".to_owned(),
        turning_secs if motion.moving_secs - turning_secs < ALIKE_SECS => "table turning throughout".to_owned(),
        turning_secs => format!("table turning for {} s of it", fixed(turning_secs, 1)),
    }
}
