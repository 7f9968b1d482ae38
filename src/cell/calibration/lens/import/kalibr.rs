//! Kalibr's camera chain: `cam0`, `cam1` and, for a projector taken as an inverse camera, `cam2`; `T_cn_cnm1` takes points of the
//! camera before into this one, in metres.

use nalgebra::Isometry3;
use serde_json::Value;

use super::super::fault::{LensError, LensFault};
use super::node;
use super::{ImportedFile, ImportedLens, image_size, opencv_lens, pose, rotation};
use crate::cell::DeviceName;
use crate::geometry::counted;

pub(super) fn read(text: &str) -> Result<ImportedFile, LensError> {
    let root = node::yaml(text)?;
    let mut file = ImportedFile::default();
    let mut before: Option<Isometry3<f64>> = None;
    for (index, device) in DeviceName::ALL.into_iter().enumerate() {
        let name = format!("cam{index}");
        let Some(camera) = root.get(&name) else { break };
        file.lenses.push(ImportedLens { device: Some(device), ..lens(camera, &name)? });
        if index == 0 {
            continue;
        }
        let step = chained(camera, &name)?;
        let from_left = before.map_or(step, |before| step * before);
        before = Some(from_left);
        if device == DeviceName::Right {
            file.right_from_left = Some(from_left);
        } else {
            file.projector_from_left = Some(from_left);
        }
    }
    if file.lenses.is_empty() {
        return Err(LensError::new(LensFault::MissingField, "cam0", "is missing"));
    }
    Ok(file)
}

fn field<'a>(camera: &'a Value, at: &str, name: &str) -> Result<&'a Value, LensError> {
    camera.get(name).ok_or_else(|| LensError::new(LensFault::MissingField, format!("{at}/{name}"), "is missing"))
}

fn lens(camera: &Value, at: &str) -> Result<ImportedLens, LensError> {
    let text = |name: &str| camera.get(name).and_then(Value::as_str).unwrap_or_default().to_lowercase();
    let (camera_model, distortion_model) = (text("camera_model"), text("distortion_model"));
    if !matches!(camera_model.as_str(), "pinhole" | "") {
        return Err(super::fisheye(&camera_model));
    }
    let coefficients = match distortion_model.as_str() {
        "radtan" | "plumb_bob" => node::numbers(field(camera, at, "distortion_coeffs")?, &format!("{at}/distortion_coeffs"))?,
        "none" | "" => vec![0.0; 4],
        other => return Err(super::fisheye(other)),
    };
    let pointer = format!("{at}/intrinsics");
    let intrinsics = node::numbers(field(camera, at, "intrinsics")?, &pointer)?;
    let [fu, fv, pu, pv] = intrinsics.as_slice() else {
        let detail = format!("has {}; a pinhole has fu fv pu pv", counted(intrinsics.len(), "number"));
        return Err(LensError::new(LensFault::WrongShape, pointer, detail));
    };
    let pointer = format!("{at}/resolution");
    let size_px = match camera.get("resolution").map(|value| node::numbers(value, &pointer)).transpose()?.as_deref() {
        Some([width, height]) => Some(image_size(*width, *height, &pointer)?),
        _ => None,
    };
    let matrix = nalgebra::Matrix3::new(*fu, 0.0, *pu, 0.0, *fv, *pv, 0.0, 0.0, 1.0);
    opencv_lens(&matrix, &coefficients, size_px, at)
}

fn chained(camera: &Value, at: &str) -> Result<Isometry3<f64>, LensError> {
    let pointer = format!("{at}/T_cn_cnm1");
    let matrix = node::matrix(field(camera, at, "T_cn_cnm1")?, &pointer)?;
    let [a, b, c] = [0, 1, 2].map(|row| matrix.values.get(4 * row..4 * row + 4).unwrap_or_default());
    let is_pose = (matrix.rows, matrix.columns) == (4, 4) && matrix.values.get(12..16) == Some(&[0.0, 0.0, 0.0, 1.0]);
    if !is_pose {
        let transposed = matrix.values.len() == 16 && matrix.values[12] != 0.0;
        let hint = if transposed { "; its last row holds numbers: transposed?" } else { "" };
        return Err(LensError::new(LensFault::WrongShape, pointer, format!("is not a 4 × 4 pose with last row 0 0 0 1{hint}")));
    }
    let turn = nalgebra::Matrix3::new(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]);
    pose(rotation(&turn, &pointer)?, &[a[3], b[3], c[3]], &pointer)
}
