//! `program.json`, schema `vantage.program/1`. Degrees here, radians inside.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::angle;
use super::echo::Echo;
use super::json_file_bytes;
use crate::cell::{Configuration, FieldError, Findings};
use crate::planning::plan::ViewId;
use crate::program::{Move, Program, Step};

/// Schema name that the document carries.
pub const PROGRAM_SCHEMA: &str = "vantage.program/1";

/// Largest angle that a program may contain, degrees.
const ANGLE_DEG: f64 = 3600.0;
/// Longest time, seconds.
const LONGEST_SECS: f64 = 86_400.0;

/// The whole document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ProgramDocument {
    /// `vantage.program/1`.
    pub schema: String,
    /// Labels, part number and serial as given with the job.
    #[serde(flatten)]
    pub echo: Echo,
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: String,
    /// Setup of the plan in which the part lies, from 0.
    #[serde(default, skip_serializing_if = "is_first")]
    pub setup: usize,
    /// Name of the robot's specification.
    pub robot: String,
    /// Name of the turntable's specification.
    pub turntable: String,
    /// Joints 1 to 6 and the table angle before the first step and after the last.
    pub home_deg: [f64; 7],
    /// Steps, one after another.
    pub steps: Vec<StepDocument>,
    /// Predicted time of all steps.
    pub cycle_secs: f64,
}

/// One step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum StepDocument {
    /// Arm and table move along straight, synchronised segments in joint space, at rest at every point unless it is said
    /// otherwise.
    MoveJoints {
        /// Joints 1 to 6 at the end.
        joints_deg: [f64; 6],
        /// Table angle at the end.
        table_angle_deg: f64,
        /// Share of the axes' rated speed and acceleration.
        speed_fraction: f64,
        /// Joints 1 to 6 and the table angle at points between start and end.
        via: Vec<[f64; 7]>,
        /// Predicted time.
        duration_secs: f64,
        /// Tolerance of any axis at the points between, which are then passed without stopping, each rounded by a
        /// parabola, as quickly as the axes allow; left out where every point is a stop.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        passed_within_deg: Option<f64>,
    },
    /// Everything stands still.
    Settle {
        /// Duration.
        secs: f64,
    },
    /// The scanner captures.
    Scan {
        /// Viewpoint of the plan.
        viewpoint: u32,
        /// Projector brightness level.
        brightness: u8,
        /// Duration of the capture.
        capture_secs: f64,
    },
}

/// Most plans have one setup, which needs no name.
fn is_first(setup: &usize) -> bool {
    *setup == 0
}

impl ProgramDocument {
    /// The document of a program.
    #[must_use]
    pub fn new(program: &Program, echo: Echo) -> Self {
        Self {
            schema: PROGRAM_SCHEMA.to_owned(),
            echo,
            plan_sha256: program.plan_sha256.clone(),
            setup: program.setup,
            robot: program.robot.clone(),
            turntable: program.turntable.clone(),
            home_deg: degrees(&program.home_rad),
            steps: program.steps.iter().map(StepDocument::from).collect(),
            cycle_secs: program.cycle_secs,
        }
    }

    /// The bytes of `program.json`.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        json_file_bytes(self)
    }

    /// The program that the document says.
    ///
    /// # Errors
    /// Another schema, a hash that is none, numbers out of range: each with its JSON pointer.
    pub fn program(&self) -> Result<Program, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        Ok(Program {
            plan_sha256: self.plan_sha256.clone(),
            setup: self.setup,
            robot: self.robot.clone(),
            turntable: self.turntable.clone(),
            home_rad: self.home_deg.map(f64::to_radians),
            steps: self.steps.iter().map(Step::from).collect(),
            cycle_secs: self.cycle_secs,
        })
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(self.schema == PROGRAM_SCHEMA, "/schema", || {
            format!("is {:?}; this version reads {PROGRAM_SCHEMA:?}", self.schema)
        });
        let is_sha256 = self.plan_sha256.len() == 64 && self.plan_sha256.bytes().all(|b| b.is_ascii_hexdigit());
        findings.require(is_sha256, "/plan_sha256", || "is no SHA-256: 64 hexadecimal digits".into());
        angles("/home_deg", &self.home_deg, findings);
        for (index, step) in self.steps.iter().enumerate() {
            step.check(&format!("/steps/{index}"), findings);
        }
        findings.range("/cycle_secs", self.cycle_secs, 0.0, f64::MAX, "s");
    }
}

fn angles(pointer: &str, angles_deg: &[f64], findings: &mut Findings) {
    for (index, angle) in angles_deg.iter().enumerate() {
        findings.range(format!("{pointer}/{index}"), *angle, -ANGLE_DEG, ANGLE_DEG, "°");
    }
}

impl StepDocument {
    fn check(&self, pointer: &str, findings: &mut Findings) {
        match self {
            Self::MoveJoints { joints_deg, table_angle_deg, speed_fraction, via, duration_secs, passed_within_deg } => {
                angles(&format!("{pointer}/joints_deg"), joints_deg, findings);
                findings.range(format!("{pointer}/table_angle_deg"), *table_angle_deg, -ANGLE_DEG, ANGLE_DEG, "°");
                findings.range(format!("{pointer}/speed_fraction"), *speed_fraction, 0.001, 1.0, "");
                for (index, point) in via.iter().enumerate() {
                    angles(&format!("{pointer}/via/{index}"), point, findings);
                }
                findings.range(format!("{pointer}/duration_secs"), *duration_secs, 0.0, LONGEST_SECS, "s");
                if let Some(within_deg) = passed_within_deg {
                    findings.range(format!("{pointer}/passed_within_deg"), *within_deg, 0.001, 2.0, "°");
                }
            }
            Self::Settle { secs } => findings.range(format!("{pointer}/secs"), *secs, 0.0, LONGEST_SECS, "s"),
            Self::Scan { brightness, capture_secs, .. } => {
                findings.range(format!("{pointer}/brightness"), f64::from(*brightness), 0.0, 9.0, "");
                findings.range(format!("{pointer}/capture_secs"), *capture_secs, 0.0, LONGEST_SECS, "s");
            }
        }
    }
}

impl From<&Step> for StepDocument {
    fn from(step: &Step) -> Self {
        match step {
            Step::Move(step) => {
                let [j1, j2, j3, j4, j5, j6, table_angle_deg] = degrees(&step.target_rad);
                Self::MoveJoints {
                    joints_deg: [j1, j2, j3, j4, j5, j6],
                    table_angle_deg,
                    speed_fraction: step.speed_fraction,
                    via: step.via_rad.iter().map(degrees).collect(),
                    duration_secs: step.duration_secs,
                    passed_within_deg: step.passed_within_rad.map(angle::degrees),
                }
            }
            Step::Settle { secs } => Self::Settle { secs: *secs },
            Step::Scan { view, brightness, capture_secs } => {
                Self::Scan { viewpoint: view.0, brightness: *brightness, capture_secs: *capture_secs }
            }
        }
    }
}

impl From<&StepDocument> for Step {
    fn from(step: &StepDocument) -> Self {
        match step {
            StepDocument::MoveJoints {
                joints_deg: [j1, j2, j3, j4, j5, j6],
                table_angle_deg,
                speed_fraction,
                via,
                duration_secs,
                passed_within_deg,
            } => Self::Move(Move {
                via_rad: via.iter().map(|point| point.map(f64::to_radians)).collect(),
                target_rad: [*j1, *j2, *j3, *j4, *j5, *j6, *table_angle_deg].map(f64::to_radians),
                speed_fraction: *speed_fraction,
                duration_secs: *duration_secs,
                passed_within_rad: passed_within_deg.map(f64::to_radians),
            }),
            StepDocument::Settle { secs } => Self::Settle { secs: *secs },
            StepDocument::Scan { viewpoint, brightness, capture_secs } => {
                Self::Scan { view: ViewId(*viewpoint), brightness: *brightness, capture_secs: *capture_secs }
            }
        }
    }
}

fn degrees(configuration: &Configuration) -> [f64; 7] {
    configuration.map(angle::degrees)
}

#[cfg(test)]
mod tests;
