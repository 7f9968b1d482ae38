//! MATLAB's `stereoParameters` and `cameraParameters` as `jsonencode(toStruct(…))` writes them. Its older fields are for row
//! vectors: `IntrinsicMatrix` and `RotationOfCamera2` are the transposes of what is meant here; `K` and `PoseCamera2` of newer
//! releases are not. Pixels count from 1 at the centre of the first one.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use serde_json::Value;

use super::super::fault::{LensError, LensFault};
use super::node;
use super::{ImportedFile, ImportedLens, any_rotation, image_size, of_matrix, pose, rotation};
use crate::cell::DeviceName;
use crate::geometry::{LengthUnit, UnknownUnit, counted};

/// Pixel at which MATLAB's count begins.
const FIRST_PIXEL: f64 = 1.0;

pub(super) fn read(text: &str) -> Result<ImportedFile, LensError> {
    let root = node::json(text)?;
    let root = root.get("stereoParams").or_else(|| root.get("cameraParams")).unwrap_or(&root);
    let mut file = ImportedFile { named_unit: world_units(root)?, ..ImportedFile::default() };
    let Some(left) = root.get("CameraParameters1") else {
        add(&mut file, root, None, "")?;
        return Ok(file);
    };
    let right = root.get("CameraParameters2").ok_or_else(|| missing("CameraParameters2"))?;
    add(&mut file, left, Some(DeviceName::Left), "/CameraParameters1")?;
    add(&mut file, right, Some(DeviceName::Right), "/CameraParameters2")?;
    file.right_from_left = relative(root)?;
    Ok(file)
}

/// Unit of lengths, where the file names one; MATLAB leaves that to the user.
fn world_units(root: &Value) -> Result<Option<LengthUnit>, LensError> {
    let Some(name) = root.get("WorldUnits").and_then(Value::as_str).filter(|name| !name.trim().is_empty()) else {
        return Ok(None);
    };
    let unknown = |error: UnknownUnit| LensError::new(LensFault::OutOfRange, "WorldUnits", error.to_string());
    name.parse().map(Some).map_err(unknown)
}

fn missing(name: &str) -> LensError {
    LensError::new(LensFault::MissingField, name, "is missing")
}

fn add(file: &mut ImportedFile, camera: &Value, device: Option<DeviceName>, at: &str) -> Result<(), LensError> {
    let lens = ImportedLens { device, ..lens(camera, at)? };
    let boards = boards(camera, at)?;
    if !boards.is_empty() {
        file.boards.push((file.lenses.len(), boards));
    }
    file.lenses.push(lens);
    Ok(())
}

fn lens(camera: &Value, at: &str) -> Result<ImportedLens, LensError> {
    if camera.get("MappingCoefficients").is_some() {
        return Err(super::fisheye("Scaramuzza"));
    }
    let (name, transposed) = if camera.get("K").is_some() { ("K", false) } else { ("IntrinsicMatrix", true) };
    let pointer = format!("{at}/{name}");
    let given = camera.get(name).ok_or_else(|| missing(&format!("{at}/IntrinsicMatrix")))?;
    let matrix = node::matrix(given, &pointer)?.square(&pointer)?;
    let mut matrix = if transposed && (matrix[(2, 0)] != 0.0 || matrix[(2, 1)] != 0.0) { matrix.transpose() } else { matrix };
    matrix[(0, 2)] -= FIRST_PIXEL;
    matrix[(1, 2)] -= FIRST_PIXEL;
    let list = |name: &str, counts: &[usize]| -> Result<Vec<f64>, LensError> {
        let pointer = format!("{at}/{name}");
        let list = camera.get(name).map_or_else(|| Ok(Vec::new()), |value| node::numbers(value, &pointer))?;
        if counts.contains(&list.len()) {
            return Ok(list);
        }
        Err(LensError::new(
            LensFault::WrongShape,
            pointer,
            format!("has {}; allowed are {counts:?}", counted(list.len(), "number")),
        ))
    };
    let (radial, tangential) = (list("RadialDistortion", &[0, 2, 3])?, list("TangentialDistortion", &[0, 2])?);
    let get = |list: &[f64], index: usize| list.get(index).copied().unwrap_or(0.0);
    let k = [get(&radial, 0), get(&radial, 1), get(&tangential, 0), get(&tangential, 1), get(&radial, 2)];
    // Rows and columns: height first.
    let size_px = match list("ImageSize", &[0, 2])?.as_slice() {
        [height, width] => Some(image_size(*width, *height, &format!("{at}/ImageSize"))?),
        _ => None,
    };
    let mut lens = ImportedLens::new(of_matrix(&matrix, &k, size_px, at)?);
    lens.rms_px = None;
    Ok(lens)
}

/// Pose of the second camera: x₂ = R · x₁ + t for columns.
fn relative(root: &Value) -> Result<Option<Isometry3<f64>>, LensError> {
    if let Some(new) = root.get("PoseCamera2") {
        let (Some(r), Some(t)) = (new.get("R"), new.get("Translation")) else { return Err(missing("PoseCamera2/R")) };
        let matrix = node::matrix(r, "PoseCamera2/R")?.square("PoseCamera2/R")?;
        return pose(rotation(&matrix, "PoseCamera2/R")?, &node::numbers(t, "PoseCamera2/Translation")?, "PoseCamera2").map(Some);
    }
    let r = root.get("RotationOfCamera2").ok_or_else(|| missing("RotationOfCamera2"))?;
    let t = root.get("TranslationOfCamera2").ok_or_else(|| missing("TranslationOfCamera2"))?;
    let matrix = node::matrix(r, "RotationOfCamera2")?.square("RotationOfCamera2")?.transpose();
    let t = node::matrix(t, "TranslationOfCamera2")?.values;
    pose(rotation(&matrix, "RotationOfCamera2")?, &t, "TranslationOfCamera2").map(Some)
}

/// Poses of boards: rotation vectors, whose sense is that of column vectors, and translations, a row a view.
fn boards(camera: &Value, at: &str) -> Result<BTreeMap<u32, Isometry3<f64>>, LensError> {
    let (Some(turns), Some(shifts)) = (camera.get("RotationVectors"), camera.get("TranslationVectors")) else {
        return Ok(BTreeMap::new());
    };
    if turns.as_array().is_none_or(Vec::is_empty) {
        return Ok(BTreeMap::new());
    }
    let rows = |value: &Value, name: &str| -> Result<Vec<f64>, LensError> {
        let matrix = node::matrix(value, &format!("{at}/{name}"))?;
        let detail = format!("has {}; allowed are 3", counted(matrix.columns, "column"));
        let is_rows = matrix.columns == 3 || matrix.values.len() == 3;
        if is_rows { Ok(matrix.values) } else { Err(LensError::new(LensFault::WrongShape, format!("{at}/{name}"), detail)) }
    };
    let (turns, shifts) = (rows(turns, "RotationVectors")?, rows(shifts, "TranslationVectors")?);
    let pairs = turns.as_chunks::<3>().0.iter().zip(shifts.as_chunks::<3>().0).zip(1..);
    pairs.map(|((turn, shift), number)| Ok((number, pose(any_rotation(turn, at)?, shift, at)?))).collect()
}
