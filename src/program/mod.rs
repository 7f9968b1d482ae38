//! The robot program: everything an executor needs and nothing left to decide, whatever the robot's make.
//! Radians and millimetres; degrees are the business of the shapes that leave the house.

mod check;
mod compile;
pub mod dialects;
mod interlock;

pub use check::{Expected, Fault, Finding, check, check_calibration, off_coverage, off_pose, scan_configurations, scan_poses};
pub use compile::{compile, compile_views};
pub use interlock::{Together, interlock};

use std::collections::BTreeSet;

use crate::cell::time_parameterisation::SmoothPath;
use crate::cell::{Axes, Cell, Configuration};
use crate::planning::plan::ViewId;

/// A program. Begins and ends at home; an immutable value.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    /// SHA-256 of the bytes of `plan.json`, lower-case hexadecimal.
    pub plan_sha256: String,
    /// Setup of the plan in which the part lies, from 0.
    pub setup: usize,
    /// Calibration of the cell that it was made for; `None` where the cell's poses were typed in.
    pub calibration: Option<ProgramCalibration>,
    /// Name of the robot's specification.
    pub robot: String,
    /// Name of the turntable's specification.
    pub turntable: String,
    /// Configuration before the first step and after the last.
    pub home_rad: Configuration,
    /// Steps, one after another.
    pub steps: Vec<Step>,
    /// Predicted time of all steps.
    pub cycle_secs: f64,
}

/// Calibration that a program was made with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProgramCalibration {
    /// Identifier of the calibration.
    pub calibration_id: String,
    /// Identifier of the compensation in force.
    pub compensation_sha256: Option<String>,
}

impl ProgramCalibration {
    /// Calibration of a cell.
    #[must_use]
    pub fn of(cell: &Cell) -> Option<Self> {
        let known = cell.calibrated.as_ref()?;
        let (calibration_id, compensation_sha256) = (known.calibration_id.clone(), known.compensation_sha256.clone());
        Some(Self { calibration_id, compensation_sha256 })
    }
}

impl std::fmt::Display for ProgramCalibration {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.calibration_id)?;
        self.compensation_sha256.as_ref().map_or(Ok(()), |sha256| write!(f, " with compensation {sha256}"))
    }
}

/// One step.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Arm and table move.
    Move(Move),
    /// Everything stands still.
    Settle {
        /// Duration.
        secs: f64,
    },
    /// The scanner captures.
    Scan {
        /// The view.
        view: ViewId,
        /// Projector brightness level.
        brightness: u8,
        /// Duration of the capture.
        capture_secs: f64,
    },
}

impl Step {
    /// Predicted time.
    #[must_use]
    pub fn secs(&self) -> f64 {
        match self {
            Self::Move(step) => step.duration_secs,
            Self::Settle { secs } => *secs,
            Self::Scan { capture_secs, .. } => *capture_secs,
        }
    }
}

/// A polyline in joint space: straight, synchronised segments, at rest at every point or passing by them.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Points between start and target, both left out.
    pub via_rad: Vec<Configuration>,
    /// Configuration where it ends.
    pub target_rad: Configuration,
    /// Share of the axes' rated speed and acceleration.
    pub speed_fraction: f64,
    /// Predicted time.
    pub duration_secs: f64,
    /// Largest distance of any axis from a point between start and end, which is then passed without stopping, radians; `None`:
    /// every point is a stop.
    pub passed_within_rad: Option<f64>,
}

impl Move {
    /// Time from `from` to the target, derived anew.
    #[must_use]
    pub fn derived_secs(&self, from: &Configuration, axes: &Axes) -> f64 {
        let points: Vec<_> = std::iter::once(*from).chain(self.via_rad.iter().copied()).chain([self.target_rad]).collect();
        match self.passed_within_rad {
            None => axes.path_secs(&points, self.speed_fraction),
            Some(within_rad) => SmoothPath::through(&points, within_rad).secs(axes, self.speed_fraction),
        }
    }
}

impl Program {
    /// Returns true if any move passes points without stopping.
    #[must_use]
    pub fn passes_points(&self) -> bool {
        self.steps.iter().any(|step| matches!(step, Step::Move(step) if step.passed_within_rad.is_some()))
    }

    /// The program with a stop at every point, times derived anew, as executors carry it out that send a point at a time.
    #[must_use]
    pub fn with_stops(mut self, axes: &Axes) -> Self {
        if !self.passes_points() {
            return self;
        }
        let mut here = self.home_rad;
        for step in &mut self.steps {
            if let Step::Move(step) = step {
                if step.passed_within_rad.take().is_some() {
                    step.duration_secs = step.derived_secs(&here, axes);
                }
                here = step.target_rad;
            }
        }
        self.cycle_secs = self.steps.iter().map(Step::secs).sum();
        self
    }

    /// Brightness levels of its scans. Of several, something has to tell the scanner the level of each.
    #[must_use]
    pub fn brightness_levels(&self) -> BTreeSet<u8> {
        let level = |step: &Step| if let Step::Scan { brightness, .. } = step { Some(*brightness) } else { None };
        self.steps.iter().filter_map(level).collect()
    }
}

#[cfg(test)]
mod tests;
