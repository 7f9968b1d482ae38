//! Observations in YAML: samples of easy_handeye2 (`SampleList` as ROS 2 prints it), and the matrices of Zivid's hand-eye data sets,
//! `posNN.yaml` for the arm and `boardNN.yaml` for the board, as OpenCV or Zivid's own `Matrix4x4` write them.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde_json::Value;

use super::data::{CalibrationData, ObservationDocument};
use super::foreign::{METRE_MM, flat, of_observations};
use super::pose::{ObservedPose, of_matrix};
use crate::cell::calibration::data::HandEyeSetup;
use crate::cell::calibration::lens::yaml;
use crate::cell::{FieldError, Findings};

/// Largest difference of a quaternion's norm from 1.
const NORM_TOLERANCE: f64 = 2e-3;
/// Largest distance of a pose, mm.
const REACH_MM: f64 = 1e5;
/// Depth at which a matrix is looked for.
const MAX_DEPTH: usize = 4;

fn tree(text: &str, pointer: &str, findings: &mut Findings) -> Option<Value> {
    yaml(text).map_err(|error| findings.push(pointer, error.to_string())).ok()
}

/// Samples of easy_handeye2, in metres. Where the file says how the camera is mounted, that counts; for `eye_on_base` it stores the
/// arm's poses inverted.
///
/// # Errors
/// Every sample that is not one.
pub fn from_easy_handeye(text: &str, setup: HandEyeSetup) -> Result<CalibrationData, Vec<FieldError>> {
    let mut findings = Findings::default();
    let value = tree(text, "", &mut findings).unwrap_or_default();
    let setup = match value.pointer("/parameters/calibration_type").and_then(Value::as_str) {
        None => setup,
        Some("eye_in_hand") => HandEyeSetup::EyeInHand,
        Some("eye_on_base") => HandEyeSetup::EyeToHand,
        Some(other) => {
            let detail = format!("is {other:?}; allowed are eye_in_hand and eye_on_base");
            findings.push("/parameters/calibration_type", detail);
            setup
        }
    };
    let samples = value.get("samples").unwrap_or(&value).as_array().map_or(&[][..], Vec::as_slice);
    findings.require(!samples.is_empty(), "/samples", || "has no samples, each with robot and tracking".into());
    let mut observations = Vec::new();
    for (index, sample) in samples.iter().enumerate() {
        let at = format!("/samples/{index}");
        // Earlier versions wrote `optical`.
        let tracking = if sample.get("tracking").is_some() { "tracking" } else { "optical" };
        let robot = transform(&sample["robot"], &format!("{at}/robot"), &mut findings);
        let board = transform(&sample[tracking], &format!("{at}/{tracking}"), &mut findings);
        if let (Some(robot), Some(board)) = (robot, board) {
            let flange = if setup == HandEyeSetup::EyeToHand { robot.inverse() } else { robot };
            observations.push(observation(format!("p{:02}", index + 1), &flange, &board));
        }
    }
    findings.into_result()?;
    Ok(of_observations(observations, setup))
}

/// Poses of arm and board of a data set of Zivid's, mm: each with its name and the texts of its two files.
///
/// # Errors
/// Every file without a pose, under its name.
pub fn from_zivid(files: &[(String, [String; 2])], setup: HandEyeSetup) -> Result<CalibrationData, Vec<FieldError>> {
    let mut findings = Findings::default();
    findings.require(!files.is_empty(), "", || "has no files posNN.yaml with a boardNN.yaml beside each".into());
    let mut observations = Vec::new();
    for (name, [arm, board]) in files {
        let mut pose = |side: &str, text: &str| {
            let at = format!("/{side}{name}");
            let value = tree(text, &at, &mut findings)?;
            let Some(numbers) = matrix(&value, 0) else {
                findings.push(&at, "contains no 4 × 4 matrix: rows, cols and data of OpenCV, or Data of Zivid's Matrix4x4");
                return None;
            };
            of_matrix(&numbers, 1.0, &at, &mut findings)
        };
        if let (Some(flange), Some(board)) = (pose("pos", arm), pose("board", board)) {
            observations.push(observation(format!("pos{name}"), &flange, &board));
        }
    }
    findings.into_result()?;
    Ok(of_observations(observations, setup))
}

fn observation(id: String, flange: &Isometry3<f64>, board: &Isometry3<f64>) -> ObservationDocument {
    ObservationDocument {
        id,
        base_from_flange: Some(ObservedPose::of(flange)),
        cloud_from_board: Some(ObservedPose::of(board)),
        ..ObservationDocument::default()
    }
}

/// Transform of ROS, metres and a quaternion.
fn transform(value: &Value, pointer: &str, findings: &mut Findings) -> Option<Isometry3<f64>> {
    let numbers = |field: &str, names: &[&str]| -> Option<Vec<f64>> {
        names.iter().map(|name| value[field][name].as_f64().filter(|number| number.is_finite())).collect()
    };
    let (Some(place), Some(turn)) = (numbers("translation", &["x", "y", "z"]), numbers("rotation", &["x", "y", "z", "w"])) else {
        findings.push(pointer, "has no translation x, y, z and rotation x, y, z, w");
        return None;
    };
    let norm = turn.iter().map(|part| part * part).sum::<f64>().sqrt();
    findings.require((norm - 1.0).abs() <= NORM_TOLERANCE, format!("{pointer}/rotation"), || {
        format!("has norm {norm}; a rotation needs a unit quaternion (norm 1 ± {NORM_TOLERANCE})")
    });
    let place_mm = [place[0], place[1], place[2]].map(|length| length * METRE_MM);
    findings.require(place_mm.iter().all(|length| length.abs() <= REACH_MM), format!("{pointer}/translation"), || {
        "lies more than 100 m away: the unit is the metre".into()
    });
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(turn[3], turn[0], turn[1], turn[2]));
    Some(Isometry3::from_parts(Translation3::from(place_mm), rotation))
}

/// Numbers of the only matrix of a file: `data` of OpenCV, `Data` of Zivid, or a list, whatever it is called.
fn matrix(value: &Value, depth: usize) -> Option<Vec<f64>> {
    match value {
        Value::Array(_) => Some(flat(value)),
        Value::Object(table) => {
            let own = table.get("data").or_else(|| table.get("Data")).filter(|data| data.is_array());
            let inner = || table.values().filter(|_| depth < MAX_DEPTH).find_map(|inner| matrix(inner, depth + 1));
            own.map(flat).or_else(inner)
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => None,
    }
}
