//! `program.json`, schema `vantage.program/1`. Angles are in degrees here, in radians elsewhere.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::angle;
use super::echo::Echo;
use super::json_file_bytes;
use super::schema_name::schema_name;
use crate::cell::{Configuration, FieldError, Findings};
use crate::planning::plan::ViewId;
use crate::program::{Move, Program, ProgramCalibration, Step};

/// Schema name in the document.
pub const PROGRAM_SCHEMA: &str = "vantage.program/1";

schema_name!(ProgramSchema, PROGRAM_SCHEMA);

/// Max angle that a program may contain, degrees.
const MAX_ANGLE_DEG: f64 = 3600.0;
/// Max duration, seconds.
const MAX_SECS: f64 = 86_400.0;

/// A robot program (`program.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ProgramDocument {
    /// Schema name, `vantage.program/1`.
    #[schema(value_type = ProgramSchema)]
    pub schema: String,
    /// Labels, part number and serial number, as given with the job.
    #[serde(flatten)]
    pub echo: Echo,
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: String,
    /// Number of the plan's setup that the program belongs to, from 0; left out for the first.
    #[serde(default, skip_serializing_if = "is_first")]
    pub setup: usize,
    /// Calibration of the cell that it was made for; left out where the cell's poses were typed in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<ProgramCalibrationDocument>,
    /// Name of the robot specification.
    pub robot: String,
    /// Name of the turntable specification.
    pub turntable: String,
    /// Joints 1 to 6 and the table angle before the first step and after the last.
    pub home_deg: [f64; 7],
    /// Steps, in order.
    pub steps: Vec<StepDocument>,
    /// Predicted duration of all steps.
    pub cycle_secs: f64,
}

/// Calibration that a program was made with. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ProgramCalibrationDocument {
    /// Identifier of the calibration: the SHA-256 of its document.
    pub calibration_id: String,
    /// Identifier of the compensation in force: the SHA-256 of the check that gave it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compensation_sha256: Option<String>,
}

/// A step of a program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum StepDocument {
    /// Moves arm and table along straight, synchronised segments in joint space, with a stop at every point unless
    /// `passed_within_deg` is given.
    MoveJoints {
        /// Joints 1 to 6 at the end of the move.
        joints_deg: [f64; 6],
        /// Table angle at the end of the move.
        table_angle_deg: f64,
        /// Share of the axes' rated speed and acceleration.
        speed_fraction: f64,
        /// Joints 1 to 6 and the table angle at each via point.
        via: Vec<[f64; 7]>,
        /// Predicted duration.
        duration_secs: f64,
        /// Blend tolerance at the via points, in each axis: they are passed without a stop on parabolic blends within this
        /// tolerance, as fast as the axes allow. Left out if every point is a stop.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        passed_within_deg: Option<f64>,
    },
    /// Waits for everything to stand still.
    Settle {
        /// Duration.
        secs: f64,
    },
    /// Captures a scan.
    Scan {
        /// Id of the viewpoint in the plan.
        viewpoint: u32,
        /// Brightness level of the projector.
        brightness: u8,
        /// Duration of the capture.
        capture_secs: f64,
    },
}

/// Returns true for the first setup, which the document leaves out: most plans have only one.
fn is_first(setup: &usize) -> bool {
    *setup == 0
}

impl ProgramDocument {
    /// Builds the document of a program.
    #[must_use]
    pub fn new(program: &Program, echo: Echo) -> Self {
        Self {
            schema: PROGRAM_SCHEMA.to_owned(),
            echo,
            plan_sha256: program.plan_sha256.clone(),
            setup: program.setup,
            calibrated: program.calibration.clone().map(|ProgramCalibration { calibration_id, compensation_sha256 }| {
                ProgramCalibrationDocument { calibration_id, compensation_sha256 }
            }),
            robot: program.robot.clone(),
            turntable: program.turntable.clone(),
            home_deg: degrees(&program.home_rad),
            steps: program.steps.iter().map(StepDocument::from).collect(),
            cycle_secs: program.cycle_secs,
        }
    }

    /// Bytes of `program.json`.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        json_file_bytes(self)
    }

    /// Converts the document to a program.
    ///
    /// # Errors
    /// A wrong schema, an invalid digest, numbers out of range: each with its JSON pointer.
    pub fn program(&self) -> Result<Program, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        Ok(Program {
            plan_sha256: self.plan_sha256.clone(),
            setup: self.setup,
            calibration: self.calibrated.clone().map(|ProgramCalibrationDocument { calibration_id, compensation_sha256 }| {
                ProgramCalibration { calibration_id, compensation_sha256 }
            }),
            robot: self.robot.clone(),
            turntable: self.turntable.clone(),
            home_rad: radians(&self.home_deg),
            steps: self.steps.iter().map(Step::from).collect(),
            cycle_secs: self.cycle_secs,
        })
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(self.schema == PROGRAM_SCHEMA, "/schema", || {
            format!("is {:?}; this version reads {PROGRAM_SCHEMA:?}", self.schema)
        });
        let is_sha256 = self.plan_sha256.len() == 64 && self.plan_sha256.bytes().all(|b| b.is_ascii_hexdigit());
        findings.require(is_sha256, "/plan_sha256", || "is not a SHA-256 digest of 64 hexadecimal digits".into());
        for (field, digest) in self.calibrated.iter().flat_map(ProgramCalibrationDocument::digests) {
            let is_sha256 = digest.len() == 64 && digest.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
            findings.require(is_sha256, format!("/calibrated/{field}"), || {
                "is not a SHA-256 digest of 64 hexadecimal digits in lower case".into()
            });
        }
        angles("/home_deg", &self.home_deg, findings);
        for (index, step) in self.steps.iter().enumerate() {
            step.check(&format!("/steps/{index}"), findings);
        }
        findings.range("/cycle_secs", self.cycle_secs, 0.0, f64::MAX, "s");
    }
}

impl ProgramCalibrationDocument {
    fn digests(&self) -> impl Iterator<Item = (&'static str, &String)> {
        let compensation = self.compensation_sha256.iter().map(|digest| ("compensation_sha256", digest));
        std::iter::once(("calibration_id", &self.calibration_id)).chain(compensation)
    }
}

fn angles(pointer: &str, angles_deg: &[f64], findings: &mut Findings) {
    for (index, angle) in angles_deg.iter().enumerate() {
        findings.range(format!("{pointer}/{index}"), *angle, -MAX_ANGLE_DEG, MAX_ANGLE_DEG, "°");
    }
}

impl StepDocument {
    fn check(&self, pointer: &str, findings: &mut Findings) {
        match self {
            Self::MoveJoints { joints_deg, table_angle_deg, speed_fraction, via, duration_secs, passed_within_deg } => {
                angles(&format!("{pointer}/joints_deg"), joints_deg, findings);
                findings.range(format!("{pointer}/table_angle_deg"), *table_angle_deg, -MAX_ANGLE_DEG, MAX_ANGLE_DEG, "°");
                findings.range(format!("{pointer}/speed_fraction"), *speed_fraction, 0.001, 1.0, "");
                for (index, point) in via.iter().enumerate() {
                    angles(&format!("{pointer}/via/{index}"), point, findings);
                }
                findings.range(format!("{pointer}/duration_secs"), *duration_secs, 0.0, MAX_SECS, "s");
                if let Some(within_deg) = passed_within_deg {
                    findings.range(format!("{pointer}/passed_within_deg"), *within_deg, 0.001, 2.0, "°");
                }
            }
            Self::Settle { secs } => findings.range(format!("{pointer}/secs"), *secs, 0.0, MAX_SECS, "s"),
            Self::Scan { brightness, capture_secs, .. } => {
                findings.range(format!("{pointer}/brightness"), f64::from(*brightness), 0.0, 9.0, "");
                findings.range(format!("{pointer}/capture_secs"), *capture_secs, 0.0, MAX_SECS, "s");
            }
        }
    }
}

impl From<&Step> for StepDocument {
    fn from(step: &Step) -> Self {
        match step {
            Step::Move(step) => {
                let Configuration { joints_rad, table_rad } = step.target_rad;
                Self::MoveJoints {
                    joints_deg: joints_rad.map(angle::degrees),
                    table_angle_deg: angle::degrees(table_rad),
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
            StepDocument::MoveJoints { joints_deg, table_angle_deg, speed_fraction, via, duration_secs, passed_within_deg } => {
                Self::Move(Move {
                    via_rad: via.iter().map(radians).collect(),
                    target_rad: Configuration {
                        joints_rad: joints_deg.map(f64::to_radians),
                        table_rad: table_angle_deg.to_radians(),
                    },
                    speed_fraction: *speed_fraction,
                    duration_secs: *duration_secs,
                    passed_within_rad: passed_within_deg.map(f64::to_radians),
                })
            }
            StepDocument::Settle { secs } => Self::Settle { secs: *secs },
            StepDocument::Scan { viewpoint, brightness, capture_secs } => {
                Self::Scan { view: ViewId(*viewpoint), brightness: *brightness, capture_secs: *capture_secs }
            }
        }
    }
}

fn degrees(configuration: &Configuration) -> [f64; 7] {
    configuration.axes_rad().map(angle::degrees)
}

fn radians(axes_deg: &[f64; 7]) -> Configuration {
    Configuration::from_axes_rad(axes_deg.map(f64::to_radians))
}

#[cfg(test)]
mod tests;
