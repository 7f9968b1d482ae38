//! `vantage.calibration/1`: a calibration as a document.

use nalgebra::{Isometry3, Matrix6};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::data::{CalibrationData, SigmaDocument};
use super::words::sentence;
use crate::cell::calibration::board_scale::BoardScale;
use crate::cell::calibration::data::{ChainEstimate, HandEyeSetup, Sigma, SigmaSource, Solve, Weighting};
use crate::cell::calibration::findings::{CalibrationFinding, FindingCode, Severity};
use crate::cell::calibration::leave_one_out::Spread;
use crate::cell::calibration::observability::Freedom;
use crate::cell::calibration::refine::{Free, Square};
use crate::cell::calibration::se3::{Twist, rotation_of, translation_of};
use crate::cell::calibration::solve::{Calibration, Role};
use crate::cell::calibration::table::{Harmonic, LocatedFace};
use crate::cell::{Cell, CloudFrameSpec, FieldError, Findings, PoseSpec, RunoutSpec};
use crate::geometry::{Cloud, Pose, ScannerFrame};
use crate::wire::UtcTime;
use crate::wire::schema_name::schema_name;

/// Name and version of the shape.
pub const CALIBRATION_SCHEMA: &str = "vantage.calibration/1";
/// Order of covariances.
const ORDER: &str = "rx ry rz tx ty tz, body, rad mm; joint: hand_eye 6, table rx ry tx ty, board 6";
/// Unknowns of the joint covariance.
const JOINT: usize = 16;

schema_name!(CalibrationSchema, CALIBRATION_SCHEMA);

/// A calibration. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CalibrationDocument {
    /// `vantage.calibration/1`.
    #[schema(value_type = CalibrationSchema)]
    pub schema: String,
    /// SHA-256 of this document with an empty id.
    pub id: String,
    /// Unknowns that were solved for: `hand_eye`, `table` or `joint`.
    pub kind: Solve,
    /// Name of the cell.
    pub cell: String,
    /// Mounting of the scanner.
    pub setup: HandEyeSetup,
    /// SHA-256 of the observations.
    pub data_sha256: String,
    /// Time of the observations; that of the calibration if it is not known.
    pub taken_at: UtcTime,
    /// Temperature, °C; `null` if not known.
    pub temperature_c: Option<f64>,
    /// Pose of the scanner on the flange; with the setup `eye_to_hand`, pose of the scanner in the base.
    pub flange_from_scanner: PoseSpec,
    /// Frame of the clouds: its pose in the scanner frame, or its name.
    pub scanner_from_cloud: CloudFrameSpec,
    /// Pose of the clouds' frame on the flange: the unknown X that was solved for.
    pub flange_from_cloud: PoseSpec,
    /// Pose of the table in the base; `null` if the board stood still.
    pub base_from_table: Option<PoseSpec>,
    /// Pose of the board on the plate; for the kind `hand_eye` in the base, and with the setup `eye_to_hand` on the flange.
    pub plate_from_board: PoseSpec,
    /// Sense of rotation of the table: 1, or -1 if it turns against its reported angle.
    pub table_sense: f64,
    /// Covariances.
    pub covariance: CovarianceDocument,
    /// Standard deviations of arm and board.
    pub sigma: SigmaDocument,
    /// True if the deviations of the arm were estimated from the residuals; `arm_sigma_source` tells more.
    pub sigma_estimated: bool,
    /// Source of the standard deviations of the arm; absent in documents of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arm_sigma_source: Option<SigmaSource>,
    /// Source of the standard deviations of the board; absent in documents of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_sigma_source: Option<SigmaSource>,
    /// True if the adjustment converged, false if it ended at its limit of iterations before; absent in documents of earlier
    /// versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub converged: Option<bool>,
    /// Scale of the distances to the board relative to the arm's motions; absent if the scanner was not solved for, and for fewer
    /// than 6 observations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_scale: Option<BoardScaleDocument>,
    /// Factor that was applied to the covariances given by board points: above 1 if the residuals are larger than these predict.
    /// Default 1.
    #[serde(default = "one")]
    pub points_factor: f64,
    /// Residual of every observation.
    pub residuals: Vec<ResidualDocument>,
    /// Residuals of the observations used.
    pub summary: ResidualSummary,
    /// Prediction of each used observation from the others.
    pub leave_one_out: LeaveOneOutDocument,
    /// Errors of the held-out observations; `null` if none were held out.
    pub held_out: Option<ResidualSpread>,
    /// Observability: how well the motions determine the result.
    pub observability: ObservabilityDocument,
    /// Displacement of the board beyond pure rotation about the axis, as harmonics of the table's angle; empty for fewer than 15
    /// observations.
    pub table_runout: Vec<HarmonicDocument>,
    /// Runout of the table above noise, in the form that a turntable's specification takes; residuals are those that remain
    /// without it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub turntable_runout: Vec<RunoutSpec>,
    /// Face of the plate, on which the table's origin was placed; absent if it was not scanned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate_face: Option<PlateFaceDocument>,
    /// Standard deviation of a scanned point at the depth of best focus, root of the sum over three axes, mm.
    pub point_at_best_focus_sd_mm: f64,
    /// Findings, each with a sentence for people.
    pub findings: Vec<FindingDocument>,
}

/// Scale of the distances to the board. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct BoardScaleDocument {
    /// Ratio of the distances to the board, as given, to those that the arm's motions imply: above 1 if the board is smaller than
    /// stated.
    pub ratio: f64,
    /// Standard deviation of the ratio.
    pub sd: f64,
    /// Error that this ratio causes in the scanner's position along its viewing direction, mm.
    pub shift_mm: f64,
    /// Standard deviation of the scanner's position along its viewing direction if the size of the board is unknown, mm.
    pub shift_sd_mm: f64,
    /// True if the ratio converged; if false, it says nothing about the size of the board. Absent in documents of earlier
    /// versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub converged: Option<bool>,
    /// Number of rounds that it took; absent in documents of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounds: Option<usize>,
}

impl From<&BoardScale> for BoardScaleDocument {
    fn from(scale: &BoardScale) -> Self {
        Self {
            ratio: scale.ratio,
            sd: scale.sd,
            shift_mm: scale.shift_mm(),
            shift_sd_mm: scale.shift_sd_mm(),
            converged: Some(scale.is_converged),
            rounds: Some(scale.rounds),
        }
    }
}

/// Covariances of body increments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CovarianceDocument {
    /// Order of the rows, and units.
    pub order: String,
    /// Covariance of X.
    pub hand_eye: Vec<Vec<f64>>,
    /// Covariance of the table: rotations about x and y, translations along x and y.
    pub table: Vec<Vec<f64>>,
    /// Joint covariance of all unknowns; zero for those that were held fixed.
    pub joint: Vec<Vec<f64>>,
}

/// Residual of one observation: from the board that was seen to the one predicted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ResidualDocument {
    /// Name of the observation.
    pub id: String,
    /// Rotation, degrees.
    pub rotation_deg: f64,
    /// Translation, mm.
    pub translation_mm: f64,
    /// Translation along the axes of the board, mm.
    pub shift_mm: [f64; 3],
    /// Squared residual, whitened by its covariance; 6 is its expected value.
    pub whitened: f64,
    /// Angle of the table, degrees.
    pub table_angle_deg: f64,
    /// True if the observation was used.
    pub used: bool,
    /// True if the observation was held out.
    pub held_out: bool,
    /// Reason for which it was dropped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dropped_because: Option<FindingCode>,
    /// Error of the translation that the other observations predict for it, mm; absent if it was not used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_translation_mm: Option<f64>,
}

/// Root mean square, largest and median residual.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ResidualSpread {
    /// Root mean square of the rotations, degrees.
    pub rms_rotation_deg: f64,
    /// Root mean square of the translations, mm.
    pub rms_translation_mm: f64,
    /// Largest rotation, degrees.
    pub max_rotation_deg: f64,
    /// Largest translation, mm.
    pub max_translation_mm: f64,
    /// Median of the rotations, degrees.
    pub median_rotation_deg: f64,
    /// Median of the translations, mm.
    pub median_translation_mm: f64,
}

impl From<Spread> for ResidualSpread {
    fn from(spread: Spread) -> Self {
        Self {
            rms_rotation_deg: spread.rms_rad.to_degrees(),
            rms_translation_mm: spread.rms_mm,
            max_rotation_deg: spread.max_rad.to_degrees(),
            max_translation_mm: spread.max_mm,
            median_rotation_deg: spread.median_rad.to_degrees(),
            median_translation_mm: spread.median_mm,
        }
    }
}

/// All residuals together, with a χ² test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ResidualSummary {
    /// Observations that were used.
    pub used: usize,
    /// Observations that were dropped.
    pub dropped: usize,
    /// Spread of the residuals.
    pub spread: ResidualSpread,
    /// Mean whitened square per degree of freedom: 1 if the standard deviations are right.
    pub variance_factor: f64,
    /// Probability of residuals as large or larger.
    pub chi2_p: f64,
}

/// Prediction of each used observation from the others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LeaveOneOutDocument {
    /// Spread of the prediction errors.
    pub spread: ResidualSpread,
    /// Largest rotation of X when one observation is left out, degrees.
    pub max_hand_eye_rotation_deg: f64,
    /// Largest translation of X when one observation is left out, mm.
    pub max_hand_eye_translation_mm: f64,
}

/// Observability: how well the motions determine the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ObservabilityDocument {
    /// Spread of the relative rotations about three axes, degrees, ascending; the middle value is the decisive one.
    pub spread_deg: [f64; 3],
    /// Direction that is determined worst.
    pub weakest: Option<WeakestDocument>,
    /// Largest standard deviation of a rotation, degrees.
    pub rotation_sd_deg: f64,
    /// Largest standard deviation of a translation, mm.
    pub translation_sd_mm: f64,
}

/// Direction that is determined worst.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct WeakestDocument {
    /// Rotation about the axis (`turn`) or translation along it (`shift`).
    pub freedom: Freedom,
    /// Axis: a unit vector in the frame of the clouds.
    pub axis: [f64; 3],
    /// Standard deviation of a rotation, degrees; else `null`.
    pub sd_deg: Option<f64>,
    /// Standard deviation of a translation, mm; else `null`.
    pub sd_mm: Option<f64>,
}

/// One harmonic of the table's runout.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct HarmonicDocument {
    /// Periods per revolution; 1 is wobble.
    pub order: usize,
    /// Amplitude across the axis, mm.
    pub radial_mm: f64,
    /// Amplitude along the axis, mm.
    pub axial_mm: f64,
    /// Standard deviation of an amplitude, mm.
    pub sd_mm: f64,
}

/// Face of the plate as scanned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct PlateFaceDocument {
    /// Height of the face at the axis above the origin of the nominal table, mm.
    pub height_mm: f64,
    /// Standard deviation of the height, mm.
    pub height_sd_mm: f64,
    /// Angle between the face's normal and the axis, degrees.
    pub tilt_deg: f64,
    /// Root mean square distance of the points from the face, mm.
    pub rms_mm: f64,
}

impl From<LocatedFace> for PlateFaceDocument {
    fn from(LocatedFace { face, height_sd_mm }: LocatedFace) -> Self {
        Self { height_mm: face.height_mm, height_sd_mm, tilt_deg: face.tilt_rad.to_degrees(), rms_mm: face.rms_mm }
    }
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct FindingDocument {
    /// Code, for programs.
    pub code: FindingCode,
    /// Severity.
    pub severity: Severity,
    /// Names of the observations concerned.
    pub observations: Vec<String>,
    /// Sentence for people.
    pub detail: String,
}

impl From<&CalibrationFinding> for FindingDocument {
    fn from(finding: &CalibrationFinding) -> Self {
        Self {
            code: finding.code,
            severity: finding.severity,
            observations: finding.observations.clone(),
            detail: sentence(finding),
        }
    }
}

fn rows<const N: usize>(at: impl Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
    (0..N).map(|row| (0..N).map(|column| at(row, column)).collect()).collect()
}

fn pose(isometry: &Isometry3<f64>) -> PoseSpec {
    PoseSpec::from(&Pose::<ScannerFrame, Cloud>::claim(*isometry))
}

fn one() -> f64 {
    1.0
}

impl CalibrationDocument {
    /// Document of a calibration; `data_sha256` is that of the observations' bytes. Its id is empty.
    #[must_use]
    pub fn new(found: &Calibration, solve: Solve, data: &CalibrationData, cell: &Cell, [data_sha256, now]: [&str; 2]) -> Self {
        let (estimate, covariance) = (&found.refined.estimate, &found.refined.covariance);
        let frame = data.cloud_frame(cell);
        let scanner_from_cloud = frame.scanner_from_cloud(&cell.scanner.devices);
        let of_role = |role: Role| found.roles.iter().filter(|each| **each == role).count();
        let chosen = |role: Role| found.residuals.iter().zip(&found.roles).filter(move |(_, r)| **r == role).map(|(e, _)| *e);
        let held_out = (of_role(Role::HeldOut) > 0).then(|| Spread::of(chosen(Role::HeldOut)).into());
        let taken_at = data.taken_at.clone().or_else(|| now.parse().ok());
        Self {
            schema: CALIBRATION_SCHEMA.to_owned(),
            id: String::new(),
            kind: solve,
            cell: cell.name.clone(),
            setup: data.setup,
            data_sha256: data_sha256.to_owned(),
            taken_at: taken_at.unwrap_or_else(epoch),
            temperature_c: data.temperature_c,
            flange_from_scanner: pose(&(estimate.flange_from_cloud * scanner_from_cloud.isometry().inverse())),
            scanner_from_cloud: frame,
            flange_from_cloud: pose(&estimate.flange_from_cloud),
            base_from_table: (solve != Solve::HandEye).then(|| pose(&estimate.base_from_table)),
            plate_from_board: pose(&estimate.plate_from_board),
            table_sense: estimate.scale.signum(),
            covariance: CovarianceDocument {
                order: ORDER.to_owned(),
                hand_eye: rows::<6>(|row, column| covariance[(row, column)]),
                table: rows::<4>(|row, column| covariance[(6 + row, 6 + column)]),
                joint: rows::<JOINT>(|row, column| covariance[(row, column)]),
            },
            sigma: found.refined.weighting.sigma.into(),
            sigma_estimated: found.sigma_sources[0] == SigmaSource::Estimated,
            arm_sigma_source: Some(found.sigma_sources[0]),
            board_sigma_source: Some(found.sigma_sources[1]),
            converged: Some(found.refined.is_converged),
            board_scale: found.board_scale.as_ref().map(BoardScaleDocument::from),
            points_factor: found.refined.weighting.points_factor,
            residuals: residuals(found),
            summary: ResidualSummary {
                used: of_role(Role::Used),
                dropped: of_role(Role::Dropped),
                spread: Spread::of(chosen(Role::Used)).into(),
                variance_factor: found.refined.variance_factor(),
                chi2_p: found.chi2_p,
            },
            leave_one_out: left_out(found),
            held_out,
            observability: observability(found),
            table_runout: found.harmonics.iter().map(HarmonicDocument::from).collect(),
            turntable_runout: found.runout.iter().map(RunoutSpec::from).collect(),
            plate_face: found.face.map(PlateFaceDocument::from),
            point_at_best_focus_sd_mm: found.point_sd_mm,
            findings: found.findings.iter().map(FindingDocument::from).collect(),
        }
    }

    /// Numbers of observations: given, used, held out, and dropped, as bad or as given twice.
    #[must_use]
    pub fn observation_counts(&self) -> [usize; 4] {
        // Of two that are the same, one has no residual.
        let twins = self.findings.iter().filter(|finding| finding.code == FindingCode::DuplicatePose).count();
        let held_out = self.residuals.iter().filter(|residual| residual.held_out).count();
        [self.residuals.len() + twins, self.summary.used, held_out, self.summary.dropped + twins]
    }

    /// Checks what structure alone does not tell.
    ///
    /// # Errors
    /// Every field that is out of range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        findings.require(self.schema == CALIBRATION_SCHEMA, "/schema", || {
            format!("is {:?}; this version reads {CALIBRATION_SCHEMA:?}", self.schema)
        });
        self.flange_from_cloud.check("/flange_from_cloud", &mut findings);
        self.plate_from_board.check("/plate_from_board", &mut findings);
        if let Some(table) = &self.base_from_table {
            table.check("/base_from_table", &mut findings);
        }
        let joint = &self.covariance.joint;
        let is_square = joint.len() == JOINT && joint.iter().all(|row| row.len() == JOINT && row.iter().all(|v| v.is_finite()));
        findings.require(is_square, "/covariance/joint", || format!("is not {JOINT} rows of {JOINT} finite numbers"));
        findings.into_result()
    }

    /// Unknowns and their covariance, as they were found.
    #[must_use]
    pub fn estimate(&self) -> (ChainEstimate, Square, Weighting) {
        let isometry = |spec: &PoseSpec| *spec.pose::<ScannerFrame, Cloud>().isometry();
        let estimate = ChainEstimate {
            flange_from_cloud: isometry(&self.flange_from_cloud),
            base_from_table: self.base_from_table.as_ref().map_or_else(Isometry3::identity, isometry),
            plate_from_board: isometry(&self.plate_from_board),
            scale: self.table_sense,
        };
        let of = |row: usize, column: usize| self.covariance.joint.get(row).and_then(|row| row.get(column)).copied();
        let covariance = Square::from_fn(|row, column| of(row, column).unwrap_or(0.0));
        let weighting = Weighting { points_factor: self.points_factor, ..Weighting::new(self.setup, Sigma::from(self.sigma)) };
        (estimate, covariance, weighting)
    }

    /// Degrees of freedom that the standard deviations were estimated with, as a check takes them; none if they were given.
    #[must_use]
    pub fn sigma_freedom(&self) -> Option<f64> {
        let free = match self.kind {
            Solve::HandEye => Free::HAND_EYE,
            Solve::Table => Free::TABLE,
            Solve::Joint => Free::JOINT,
        };
        let of_earlier = if self.sigma_estimated { SigmaSource::Estimated } else { SigmaSource::Given };
        let freedom = self.summary.used.saturating_mul(6).saturating_sub(free.count());
        self.arm_sigma_source.unwrap_or(of_earlier).freedom(freedom)
    }

    /// Covariance of X.
    #[must_use]
    pub fn hand_eye_covariance(&self) -> Matrix6<f64> {
        self.estimate().1.fixed_view::<6, 6>(0, 0).into_owned()
    }
}

/// Time of a document whose clock cannot be read.
fn epoch() -> UtcTime {
    "1970-01-01T00:00:00Z".parse().unwrap_or_else(|_| unreachable!("a time in RFC 3339"))
}

fn residuals(found: &Calibration) -> Vec<ResidualDocument> {
    let dropped = |id: &String| {
        let named = found.findings.iter().find(|finding| finding.observations.contains(id));
        named.map_or(FindingCode::BadPose, |finding| finding.code)
    };
    let each = |index: usize| {
        let (residual, sighting): (&Twist, _) = (&found.residuals[index], &found.sightings[index]);
        let role = found.roles[index];
        ResidualDocument {
            id: sighting.id.clone(),
            rotation_deg: rotation_of(residual).norm().to_degrees(),
            translation_mm: translation_of(residual).norm(),
            shift_mm: translation_of(residual).into(),
            whitened: found.whitened[index],
            table_angle_deg: sighting.table_rad.to_degrees(),
            used: role == Role::Used,
            held_out: role == Role::HeldOut,
            dropped_because: (role == Role::Dropped).then(|| dropped(&sighting.id)),
            predicted_translation_mm: found.left_out[index].map(|left| translation_of(&left.residual).norm()),
        }
    };
    (0..found.sightings.len()).map(each).collect()
}

fn left_out(found: &Calibration) -> LeaveOneOutDocument {
    let all = || found.left_out.iter().flatten();
    let moved = Spread::of(all().map(|left| left.hand_eye_shift));
    LeaveOneOutDocument {
        spread: Spread::of(all().map(|left| left.residual)).into(),
        max_hand_eye_rotation_deg: moved.max_rad.to_degrees(),
        max_hand_eye_translation_mm: moved.max_mm,
    }
}

fn observability(found: &Calibration) -> ObservabilityDocument {
    let judged = &found.observability;
    ObservabilityDocument {
        spread_deg: judged.spread_rad.map(f64::to_degrees),
        weakest: judged.weakest.map(|weakest| WeakestDocument {
            freedom: weakest.freedom,
            axis: weakest.axis.into(),
            sd_deg: (weakest.freedom == Freedom::Turn).then(|| weakest.sd.to_degrees()),
            sd_mm: (weakest.freedom == Freedom::Shift).then_some(weakest.sd),
        }),
        rotation_sd_deg: judged.turn_sd_rad.to_degrees(),
        translation_sd_mm: judged.shift_sd_mm,
    }
}

impl From<&Harmonic> for HarmonicDocument {
    fn from(each: &Harmonic) -> Self {
        Self { order: each.order, radial_mm: each.radial_mm, axial_mm: each.axial_mm, sd_mm: each.sd_mm }
    }
}
