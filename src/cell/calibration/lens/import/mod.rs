//! Files of other programs, read as lenses, poses between cameras, and poses of boards. Everything that a program means otherwise
//! is turned here into what is meant here: pixels count from the outer corner of the first pixel, lengths are millimetres, x in
//! the right camera is R · x in the left + T.

mod bouguet;
mod kalibr;
mod matlab;
mod node;
mod opencv;
mod own;

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::fault::{LensError, LensFault};
use super::model::{LENS, LensParameters};
use super::rich_lens;
use crate::cell::closed_list::closed_list;
use crate::cell::{DeviceName, ScannerSpec};
use crate::geometry::{LengthUnit, counted};

/// Largest file that is read, bytes.
pub const MAX_FILE_BYTES: usize = 64 << 20;
/// Largest deviation of a matrix's rows from orthonormal, as for printed rotations in [`crate::cell::BoardPoseSpec`].
const ROTATION_TOLERANCE: f64 = 1e-3;
/// Pixels from the centre of the first pixel, where OpenCV, Bouguet and Kalibr count from, to its outer corner.
const FROM_CENTRE_PX: f64 = 0.5;

/// Tree of a YAML file, OpenCV's `FileStorage` among them. Aliases are refused; depth is bounded.
///
/// # Errors
/// [`LensError`].
pub fn yaml(text: &str) -> Result<serde_json::Value, LensError> {
    node::yaml(text)
}

closed_list! {
    /// Format of a calibration file.
    pub enum CalibrationFormat {
        /// OpenCV's `FileStorage` (YAML, XML or JSON), or a camera file of ROS.
        Opencv = "opencv",
        /// Bouguet's toolbox: `Calib_Results.m`, and the tables that it prints.
        Bouguet = "bouguet",
        /// MATLAB: `stereoParams` or `cameraParams` as JSON.
        Matlab = "matlab",
        /// Kalibr: camera chain.
        Kalibr = "kalibr",
        /// Scanner specification of Vantage.
        Toml = "toml",
        /// Points of a board as the devices image them.
        Observations = "observations",
    }
}

/// Answers to what a file may leave open.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// Width and height of the cameras' images, px.
    pub image_size_px: Option<[u32; 2]>,
    /// Width and height of the projector's image, px; default that of the cameras.
    pub projector_size_px: Option<[u32; 2]>,
    /// Unit of lengths in the files. Default: that which the file names (MATLAB), metres for Kalibr, millimetres for the others.
    pub unit: Option<LengthUnit>,
}

/// Lens of one device as a file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedLens {
    /// The device, where the file says so.
    pub device: Option<DeviceName>,
    /// Parameters; a size of 0 × 0 where the file gives none.
    pub lens: LensParameters,
    /// Distortion of more than five coefficients, in OpenCV's order.
    pub rich: Option<Vec<f64>>,
    /// Standard deviations, in the order of [`super::PARAMETER_NAMES`]; `None` where the file gives none.
    pub sigma: Option<[f64; LENS]>,
    /// Reprojection error that the file states, root mean square, px.
    pub rms_px: Option<f64>,
}

/// Content of one file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportedFile {
    /// Lenses in the file.
    pub lenses: Vec<ImportedLens>,
    /// Pose of the right camera: x_right = R · x_left + T; mm.
    pub right_from_left: Option<Isometry3<f64>>,
    /// Pose of the projector; mm.
    pub projector_from_left: Option<Isometry3<f64>>,
    /// Poses of boards by the number of the view, of the device with this place in `lenses`: camera_from_board; mm.
    pub boards: Vec<(usize, BTreeMap<u32, Isometry3<f64>>)>,
    /// Unit of lengths that the file names.
    pub named_unit: Option<LengthUnit>,
    /// Length of the file's unit, mm.
    pub unit_mm: f64,
    /// The specification, if the file is one.
    pub specification: Option<Box<ScannerSpec>>,
    /// Time of the calibration, as the file writes it.
    pub at: Option<String>,
}

/// Guesses the format of a text from its beginning and its names; `None` if nothing fits.
#[must_use]
pub fn detect(text: &str) -> Option<CalibrationFormat> {
    let start = text.trim_start_matches('\u{feff}').trim_start();
    let has = |name: &str| text.contains(name);
    if has("vantage.scanner_observations/") || ["view,device,", "view\tdevice\t"].iter().any(|head| start.starts_with(*head)) {
        return Some(CalibrationFormat::Observations);
    }
    if has("CameraParameters1") || has("IntrinsicMatrix") || has("RadialDistortion") {
        return Some(CalibrationFormat::Matlab);
    }
    if start.starts_with("%YAML:") || has("opencv_storage") || has("opencv-matrix") || start.starts_with('{') {
        return Some(CalibrationFormat::Opencv);
    }
    if has("camera_model:") && has("intrinsics:") {
        return Some(CalibrationFormat::Kalibr);
    }
    if has("[left]") && has("depth_mm") {
        return Some(CalibrationFormat::Toml);
    }
    if has("fc") && has("cc") && has("kc") && has("=") {
        return Some(CalibrationFormat::Bouguet);
    }
    (has("camera_matrix") || has("M1") || has("projection_matrix")).then_some(CalibrationFormat::Opencv)
}

/// Reads a file of results.
///
/// # Errors
/// [`LensError`] at the first fault.
pub fn read(text: &str, format: CalibrationFormat, options: &ImportOptions) -> Result<ImportedFile, LensError> {
    if text.len() > MAX_FILE_BYTES {
        let detail = format!("has {} bytes; allowed are {MAX_FILE_BYTES}", text.len());
        return Err(LensError::new(LensFault::TooLarge, "", detail));
    }
    let text = text.trim_start_matches('\u{feff}');
    let mut file = match format {
        CalibrationFormat::Opencv => opencv::read(text),
        CalibrationFormat::Bouguet => bouguet::read(text),
        CalibrationFormat::Matlab => matlab::read(text),
        CalibrationFormat::Kalibr => kalibr::read(text),
        CalibrationFormat::Toml => own::read(text),
        CalibrationFormat::Observations => {
            Err(LensError::new(LensFault::UnknownFormat, "", "holds observations, not a calibration"))
        }
    }?;
    let native = if format == CalibrationFormat::Kalibr { LengthUnit::Metre } else { LengthUnit::Millimetre };
    let asked = options.unit.filter(|_| format != CalibrationFormat::Toml);
    if let (Some(named), Some(asked)) = (file.named_unit, asked)
        && named != asked
    {
        let detail = format!("lengths are in {}, and {} was given", named.as_str(), asked.as_str());
        return Err(LensError::new(LensFault::OutOfRange, "WorldUnits", detail));
    }
    let unit = asked.or(file.named_unit).unwrap_or(native);
    file.unit_mm = unit.mm();
    file.scale_lengths();
    for (index, lens) in file.lenses.iter_mut().enumerate() {
        lens.complete(index, options)?;
    }
    Ok(file)
}

impl ImportedFile {
    fn scale_lengths(&mut self) {
        let unit_mm = self.unit_mm;
        let poses = self.right_from_left.iter_mut().chain(self.projector_from_left.iter_mut());
        let boards = self.boards.iter_mut().flat_map(|(_, boards)| boards.values_mut());
        poses.chain(boards).for_each(|pose| pose.translation.vector *= unit_mm);
    }
}

impl ImportedLens {
    fn new(lens: LensParameters) -> Self {
        Self { device: None, lens, rich: None, sigma: None, rms_px: None }
    }

    /// Fills in the image size that the file lacks.
    fn complete(&mut self, index: usize, options: &ImportOptions) -> Result<(), LensError> {
        let given = match self.device {
            Some(DeviceName::Projector) => options.projector_size_px,
            Some(DeviceName::Left | DeviceName::Right) | None => None,
        };
        let given = given.or(options.image_size_px);
        if self.lens.size_px == [0, 0] {
            self.lens.size_px = given.ok_or_else(|| {
                let name = self.device.map_or_else(|| format!("lens {}", index + 1), |device| device.as_str().to_owned());
                let detail = "the file does not give the size of the image; give it by --image-size WIDTHxHEIGHT";
                LensError::new(LensFault::MissingImageSize, name, detail)
            })?;
        }
        Ok(())
    }

    /// The lens with five coefficients, and, where the file had more of them, their number and the largest difference in the image.
    pub(super) fn reduced(&self) -> Result<(LensParameters, Option<(usize, f64)>), LensError> {
        match &self.rich {
            None => Ok((self.lens, None)),
            Some(rich) => rich_lens::fit(&self.lens, rich).map(|(lens, worst_px)| (lens, Some((rich.len(), worst_px)))),
        }
    }
}

/// The lens of OpenCV's matrix and coefficients, of which those after the fifth are kept aside if they are not 0.
fn opencv_lens(
    matrix: &Matrix3<f64>,
    distortion: &[f64],
    size_px: Option<[u32; 2]>,
    at: &str,
) -> Result<ImportedLens, LensError> {
    if !matches!(distortion.len(), 0 | 4 | 5 | 8 | 12 | 14) {
        let detail = format!("has {}; allowed are 4, 5, 8, 12 or 14", counted(distortion.len(), "coefficient"));
        return Err(LensError::new(LensFault::WrongShape, format!("{at}/distortion"), detail));
    }
    let mut lens = ImportedLens::new(of_matrix(matrix, distortion, size_px, at)?);
    if distortion.iter().skip(5).any(|k| *k != 0.0) {
        lens.rich = Some(distortion.to_vec());
    }
    Ok(lens)
}

/// A lens of a matrix whose pixels count from the centre of the first one, and of k1, k2, p1, p2, k3.
fn of_matrix(
    matrix: &Matrix3<f64>,
    distortion: &[f64],
    size_px: Option<[u32; 2]>,
    at: &str,
) -> Result<LensParameters, LensError> {
    let fault = |code, detail: String| LensError::new(code, format!("{at}/matrix"), detail);
    let (lower, last) = ([matrix[(1, 0)], matrix[(2, 0)], matrix[(2, 1)]], matrix[(2, 2)]);
    if lower[1] != 0.0 || lower[2] != 0.0 {
        let detail = "has numbers left of the diagonal in its last row: a transposed matrix, as MATLAB writes IntrinsicMatrix";
        return Err(fault(LensFault::WrongShape, detail.to_owned()));
    }
    if lower[0] != 0.0 || (last - 1.0).abs() > 1e-9 {
        return Err(fault(
            LensFault::WrongShape,
            format!("is not [fx s cx; 0 fy cy; 0 0 1]: {:?}", matrix.transpose().as_slice()),
        ));
    }
    let coefficient = |index: usize| distortion.get(index).copied().unwrap_or(0.0);
    Ok(LensParameters {
        size_px: size_px.unwrap_or([0, 0]),
        fx: matrix[(0, 0)],
        fy: matrix[(1, 1)],
        cx: matrix[(0, 2)] + FROM_CENTRE_PX,
        cy: matrix[(1, 2)] + FROM_CENTRE_PX,
        skew: matrix[(0, 1)] / matrix[(0, 0)],
        distortion: std::array::from_fn(coefficient),
    })
}

/// The rotation nearest to a matrix.
fn rotation(matrix: &Matrix3<f64>, at: &str) -> Result<UnitQuaternion<f64>, LensError> {
    let residual = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    // A residual that is not a number is refused too.
    if !residual.is_finite() || residual > ROTATION_TOLERANCE || matrix.determinant() <= 0.0 {
        let detail = format!(
            "is not a rotation: R·Rᵀ is off identity by {residual}, determinant {}; allowed is {ROTATION_TOLERANCE}",
            matrix.determinant()
        );
        return Err(LensError::new(LensFault::NotARotation, at, detail));
    }
    let svd = matrix.svd(true, true);
    let nearest = match (svd.u, svd.v_t) {
        (Some(u), Some(v_t)) => u * v_t,
        _ => *matrix,
    };
    Ok(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest)))
}

/// The rotation of a matrix of nine numbers by rows, or of a rotation vector of three.
fn any_rotation(values: &[f64], at: &str) -> Result<UnitQuaternion<f64>, LensError> {
    match values {
        [x, y, z] => Ok(UnitQuaternion::from_scaled_axis(Vector3::new(*x, *y, *z))),
        values if values.len() == 9 => rotation(&Matrix3::from_row_slice(values), at),
        other => {
            let detail = format!("has {}; a rotation has 9, a rotation vector 3", counted(other.len(), "number"));
            Err(LensError::new(LensFault::WrongShape, at, detail))
        }
    }
}

/// A pose of a rotation and of a translation of three numbers, in the file's unit.
fn pose(rotation: UnitQuaternion<f64>, translation: &[f64], at: &str) -> Result<Isometry3<f64>, LensError> {
    match translation {
        [x, y, z] if [x, y, z].iter().all(|value| value.is_finite() && value.abs() <= 1e6) => {
            Ok(Isometry3::from_parts(Translation3::new(*x, *y, *z), rotation))
        }
        [_, _, _] => Err(LensError::new(LensFault::OutOfRange, at, "has a number that is not finite or beyond a million")),
        other => {
            let detail = format!("has {}; a translation has 3", counted(other.len(), "number"));
            Err(LensError::new(LensFault::WrongShape, at, detail))
        }
    }
}

/// An image size of two numbers.
fn image_size(width: f64, height: f64, at: &str) -> Result<[u32; 2], LensError> {
    let is_size = |value: f64| (16.0..=1e5).contains(&value) && value.fract() == 0.0;
    if is_size(width) && is_size(height) {
        return Ok([width as u32, height as u32]);
    }
    Err(LensError::new(LensFault::OutOfRange, at, format!("is {width} × {height}; allowed are whole numbers, 16 to 100000")))
}

/// A lens model that is not the pinhole's.
fn fisheye(model: &str) -> LensError {
    let detail =
        format!("the lens model {model:?} is that of a fisheye; not supported: rectify the images, or fit k1 k2 p1 p2 k3");
    LensError::new(LensFault::Fisheye, "model", detail)
}
