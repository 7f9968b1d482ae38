//! OpenCV's `FileStorage` in YAML, XML and JSON, and the camera files of ROS, which have the same fields. Names are those of
//! `samples/cpp/calibration.cpp`, `stereo_calib.cpp` and their kin; a file may hold lenses, the pose between cameras, or both.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Map, Value};

use super::super::fault::{LensError, LensFault};
use super::node::{self, Matrix};
use super::{ImportedFile, ImportedLens, any_rotation, image_size, opencv_lens, pose};
use crate::cell::DeviceName;
use crate::geometry::counted;

/// Names of matrix and coefficients of a file with several devices.
const NUMBERED: [(DeviceName, [&str; 4], [&str; 4]); 3] = [
    (DeviceName::Left, ["M1", "K1", "cameraMatrix1", "camera_matrix_1"], ["D1", "distCoeffs1", "dist_coeffs_1", "D_1"]),
    (DeviceName::Right, ["M2", "K2", "cameraMatrix2", "camera_matrix_2"], ["D2", "distCoeffs2", "dist_coeffs_2", "D_2"]),
    (DeviceName::Projector, ["M3", "K3", "cameraMatrix3", "camera_matrix_3"], ["D3", "distCoeffs3", "dist_coeffs_3", "D_3"]),
];
/// Names of the matrix of a file with one device.
const MATRIX: [&str; 4] = ["camera_matrix", "cameraMatrix", "Camera_Matrix", "K"];
/// Names of its coefficients.
const COEFFICIENTS: [&str; 5] = ["distortion_coefficients", "distCoeffs", "dist_coeffs", "Distortion_Coefficients", "D"];
/// Names under which files say their lens model.
const MODELS: [&str; 3] = ["distortion_model", "camera_model", "model"];

pub(super) fn read(text: &str) -> Result<ImportedFile, LensError> {
    let start = text.trim_start();
    let root = match start.chars().next() {
        Some('<') => node::xml(text)?,
        Some('{') => node::json(text)?,
        _ => node::yaml(text)?,
    };
    let Value::Object(root) = root else {
        return Err(LensError::new(LensFault::Unreadable, "", "has no named fields"));
    };
    refuse_fisheye(&root)?;
    let size_px = size(&root)?;
    let mut file = ImportedFile { at: text_of(&root, &["calibration_time", "calibration_Time"]), ..ImportedFile::default() };
    for (device, matrix, coefficients) in NUMBERED {
        if let Some(lens) = lens(&root, &matrix, &coefficients, size_px)? {
            file.lenses.push(ImportedLens { device: Some(device), ..lens });
        }
    }
    if file.lenses.is_empty()
        && let Some(mut lens) = lens(&root, &MATRIX, &COEFFICIENTS, size_px)?
    {
        let rms = ["avg_reprojection_error", "rms", "reprojection_error"];
        lens.rms_px = rms.iter().find_map(|name| root.get(*name)?.as_f64()).filter(|rms| (0.0..1000.0).contains(rms));
        file.lenses.push(lens);
        let boards = boards(&root)?;
        if !boards.is_empty() {
            file.boards.push((0, boards));
        }
    }
    file.right_from_left = relative(&root, &["R"], &["T"])?;
    file.projector_from_left = relative(&root, &["R3", "R13"], &["T3", "T13"])?;
    if file.lenses.is_empty() && file.right_from_left.is_none() {
        let detail = "has neither camera_matrix, nor M1 and M2, nor R and T";
        return Err(LensError::new(LensFault::MissingField, "", detail));
    }
    Ok(file)
}

fn first<'a>(root: &'a Map<String, Value>, names: &[&'static str]) -> Option<(&'static str, &'a Value)> {
    names.iter().find_map(|name| root.get(*name).map(|value| (*name, value)))
}

fn text_of(root: &Map<String, Value>, names: &[&'static str]) -> Option<String> {
    first(root, names)?.1.as_str().map(|text| text.chars().take(100).collect::<String>())
}

fn refuse_fisheye(root: &Map<String, Value>) -> Result<(), LensError> {
    // OpenCV's own sample writes `fisheye_model: 0` for a pinhole camera.
    let is_off = |value: &Value| value.as_f64() == Some(0.0) || value.as_bool() == Some(false);
    let has_fisheye_name = root.iter().any(|(name, value)| name.to_lowercase().contains("fisheye") && !is_off(value));
    let model = text_of(root, &MODELS).map(|model| model.to_lowercase());
    let is_fisheye =
        |model: &String| model == "ds" || ["fisheye", "equi", "omni", "kannala", "eucm"].iter().any(|word| model.contains(word));
    if has_fisheye_name || model.as_ref().is_some_and(is_fisheye) {
        return Err(super::fisheye(model.as_deref().unwrap_or("fisheye")));
    }
    Ok(())
}

/// The image size under any of its names; width and height, or a list of both.
fn size(root: &Map<String, Value>) -> Result<Option<[u32; 2]>, LensError> {
    let number = |names: &[&'static str]| first(root, names).and_then(|(_, value)| value.as_f64());
    if let (Some(width), Some(height)) =
        (number(&["image_width", "image_Width", "width"]), number(&["image_height", "image_Height", "height"]))
    {
        return image_size(width, height, "image_width").map(Some);
    }
    let Some((name, value)) = first(root, &["image_size", "imageSize", "img_size", "size"]) else { return Ok(None) };
    match node::numbers(value, name)?.as_slice() {
        [width, height] => image_size(*width, *height, name).map(Some),
        other => {
            let detail = format!("has {}; allowed are width and height", counted(other.len(), "number"));
            Err(LensError::new(LensFault::WrongShape, name, detail))
        }
    }
}

fn lens(
    root: &Map<String, Value>,
    matrices: &[&'static str],
    coefficients: &[&'static str],
    size_px: Option<[u32; 2]>,
) -> Result<Option<ImportedLens>, LensError> {
    let Some((name, value)) = first(root, matrices) else { return Ok(None) };
    let matrix = node::matrix(value, name)?.square(name)?;
    let Some((at, value)) = first(root, coefficients) else {
        let detail = "is missing; a lens without distortion has four zeros";
        return Err(LensError::new(LensFault::MissingField, coefficients.first().copied().unwrap_or_default(), detail));
    };
    opencv_lens(&matrix, &node::matrix(value, at)?.values, size_px, name).map(Some)
}

/// R and T with x_right = R · x_left + T.
fn relative(
    root: &Map<String, Value>,
    rotations: &[&'static str],
    translations: &[&'static str],
) -> Result<Option<nalgebra::Isometry3<f64>>, LensError> {
    let (Some((r, rotation)), Some((t, translation))) = (first(root, rotations), first(root, translations)) else {
        return Ok(None);
    };
    // ROS has a rectifying rotation R of one camera, and no T.
    let rotation = any_rotation(&node::matrix(rotation, r)?.values, r)?;
    pose(rotation, &node::matrix(translation, t)?.values, t).map(Some)
}

/// Rows of rotation vector and translation, a view each, in the unit of `square_size`.
fn boards(root: &Map<String, Value>) -> Result<BTreeMap<u32, nalgebra::Isometry3<f64>>, LensError> {
    let name = "extrinsic_parameters";
    let Some(value) = root.get(name).or_else(|| root.get("Extrinsic_Parameters")) else { return Ok(BTreeMap::new()) };
    let Matrix { columns, values, .. } = node::matrix(value, name)?;
    if columns != 6 {
        return Err(LensError::new(LensFault::WrongShape, name, format!("has {}; allowed are 6", counted(columns, "column"))));
    }
    let rows = values.as_chunks::<6>().0.iter().zip(1..);
    rows.map(|([a, b, c, x, y, z], number)| {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(*a, *b, *c));
        Ok((number, pose(rotation, &[*x, *y, *z], name)?))
    })
    .collect()
}
