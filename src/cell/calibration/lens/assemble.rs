//! A rig from one or several files: which lens is whose, and the pose between the devices, given or from boards that two of them
//! see together.

use nalgebra::Isometry3;

use super::adjust::Adjusted;
use super::fault::{LensError, LensFault};
use super::import::{ImportedFile, ImportedLens};
use super::model::{LENS, LensParameters};
use super::start::mean_pose;
use crate::cell::{DeviceName, PerDevice};

/// Shortest and longest plausible baseline, mm.
const BASELINE_MM: [f64; 2] = [5.0, 5000.0];

/// Distortion of more coefficients, described by five.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoefficientFit {
    /// Coefficients that the file has.
    pub given: usize,
    /// Largest difference in the image, px.
    pub worst_px: f64,
}

/// Lens of a device with all that is known about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigDevice {
    /// The lens.
    pub lens: LensParameters,
    /// Standard deviations, in the order of [`super::PARAMETER_NAMES`]; `None` where unknown, inner `None` where held.
    pub sigma: Option<[Option<f64>; LENS]>,
    /// Reprojection error, root mean square, px, where known.
    pub rms_px: Option<f64>,
    /// Fit of a distortion with more coefficients.
    pub fit: Option<CoefficientFit>,
}

/// Scatter of the pose between two devices over boards that both see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardScatter {
    /// Boards that both see.
    pub boards: usize,
    /// Smallest and largest baseline of one board, mm.
    pub baseline_mm: [f64; 2],
    /// Largest turn of one board's pose against the mean, degrees; `None` for one board.
    pub max_turn_deg: Option<f64>,
}

/// Standard deviations of the pose between the cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigSigma {
    /// Baseline, mm.
    pub baseline_mm: f64,
    /// Angle between the optical axes, degrees.
    pub axes_angle_deg: f64,
}

/// Two cameras, a projector if it is known, and the poses between them, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Lenses; `None` for a projector that is not known.
    pub devices: PerDevice<Option<RigDevice>>,
    /// Pose of the right camera: x_right = R · x_left + T.
    pub right_from_left: Isometry3<f64>,
    /// Pose of the projector.
    pub projector_from_left: Option<Isometry3<f64>>,
    /// Scatter of the cameras' pose, where it is the mean over boards.
    pub scatter: Option<BoardScatter>,
    /// Standard deviations of the cameras' pose, where they are known.
    pub sigma: Option<RigSigma>,
}

impl From<&Adjusted> for Rig {
    fn from(adjusted: &Adjusted) -> Self {
        let device = |name: DeviceName| {
            let rms_px = adjusted.devices[name].map(|residuals| residuals.rms_px);
            adjusted.lens[name].map(|lens| RigDevice { lens, sigma: Some(adjusted.lens_sigma(name)), rms_px, fit: None })
        };
        let [baseline_mm, axes_angle_rad] = adjusted.rig_sigma();
        Self {
            devices: PerDevice {
                left: device(DeviceName::Left),
                right: device(DeviceName::Right),
                projector: device(DeviceName::Projector),
            },
            right_from_left: adjusted.device_from_left.right,
            projector_from_left: adjusted.lens.projector.map(|_| adjusted.device_from_left.projector),
            scatter: None,
            sigma: Some(RigSigma { baseline_mm, axes_angle_deg: axes_angle_rad.to_degrees() }),
        }
    }
}

/// A lens with the place of its file and its place in it.
type Place = (usize, usize);

/// Puts files together.
///
/// # Errors
/// [`LensError`]: a device that is missing or given twice, no pose between the cameras, a baseline in another unit.
pub fn assemble(files: &[ImportedFile]) -> Result<Rig, LensError> {
    let places = assign(files)?;
    let place = |device: DeviceName| places[device].ok_or_else(|| missing(device));
    let (left, right) = (place(DeviceName::Left)?, place(DeviceName::Right)?);
    let mut scatter = None;
    let right_from_left = match files.iter().find_map(|file| file.right_from_left) {
        Some(pose) => pose,
        None => {
            let (pose, found) = from_boards(files, left, right).ok_or_else(|| {
                let detail =
                    "no file has the pose between the cameras: R and T, om and T, T_cn_cnm1, or poses of boards that both see";
                LensError::new(LensFault::MissingDevice, "/right", detail)
            })?;
            scatter = Some(found);
            pose
        }
    };
    check_baseline(right_from_left.translation.vector.norm(), files)?;
    let projector_from_left = places.projector.and_then(|place| {
        let given = files.iter().find_map(|file| file.projector_from_left);
        given.or_else(|| from_boards(files, left, place).map(|(pose, _)| pose))
    });
    if places.projector.is_some() && projector_from_left.is_none() {
        let detail = "has a lens and no pose: give R3 and T3, or poses of boards that the left camera sees too";
        return Err(LensError::new(LensFault::MissingDevice, "/projector", detail));
    }
    let device = |name: DeviceName| places[name].map(|(file, lens)| rig_device(&files[file].lenses[lens], name)).transpose();
    let devices = PerDevice {
        left: device(DeviceName::Left)?,
        right: device(DeviceName::Right)?,
        projector: device(DeviceName::Projector)?,
    };
    Ok(Rig { devices, right_from_left, projector_from_left, scatter, sigma: None })
}

fn missing(device: DeviceName) -> LensError {
    let detail = "no file has its lens; give a file of both cameras, or one file for each: left, right, projector";
    LensError::new(LensFault::MissingDevice, format!("/{}", device.as_str()), detail)
}

/// Device of each lens: as its file says, else in the order of the files.
fn assign(files: &[ImportedFile]) -> Result<PerDevice<Option<Place>>, LensError> {
    let mut places: PerDevice<Option<Place>> = PerDevice::default();
    let all: Vec<(Place, &ImportedLens)> = files
        .iter()
        .enumerate()
        .flat_map(|(file, read)| read.lenses.iter().enumerate().map(move |(lens, read)| ((file, lens), read)))
        .collect();
    let named = all.iter().filter_map(|(place, lens)| Some((*place, lens.device?)));
    for (place, device) in named {
        let slot = slot(&mut places, device);
        if slot.replace(place).is_some() {
            let detail = "has lenses in two files; give one";
            return Err(LensError::new(LensFault::Inconsistent, format!("/{}", device.as_str()), detail));
        }
    }
    for (place, _) in all.iter().filter(|(_, lens)| lens.device.is_none()) {
        let free = DeviceName::ALL.into_iter().find(|device| places[*device].is_none());
        let Some(device) = free else {
            let detail = "are more than three; give left camera, right camera and projector";
            return Err(LensError::new(LensFault::Inconsistent, "lenses", detail));
        };
        *slot(&mut places, device) = Some(*place);
    }
    Ok(places)
}

fn slot(places: &mut PerDevice<Option<Place>>, device: DeviceName) -> &mut Option<Place> {
    match device {
        DeviceName::Left => &mut places.left,
        DeviceName::Right => &mut places.right,
        DeviceName::Projector => &mut places.projector,
    }
}

/// Mean pose of a device from the left camera over boards that both see, with its scatter.
fn from_boards(files: &[ImportedFile], left: Place, other: Place) -> Option<(Isometry3<f64>, BoardScatter)> {
    let boards = |(file, lens): Place| files[file].boards.iter().find(|(place, _)| *place == lens).map(|(_, boards)| boards);
    let (left, other) = (boards(left)?, boards(other)?);
    let poses: Vec<Isometry3<f64>> =
        left.iter().filter_map(|(number, board)| Some(*other.get(number)? * board.inverse())).collect();
    let mean = mean_pose(&poses)?;
    let baselines = poses.iter().map(|pose| pose.translation.vector.norm());
    let baseline_mm =
        baselines.fold([f64::INFINITY, 0.0], |[low, high], baseline| [f64::min(low, baseline), f64::max(high, baseline)]);
    let turn = poses.iter().map(|pose| pose.rotation.angle_to(&mean.rotation).to_degrees()).fold(0.0, f64::max);
    let max_turn_deg = (poses.len() > 1).then_some(turn);
    Some((mean, BoardScatter { boards: poses.len(), baseline_mm, max_turn_deg }))
}

fn check_baseline(baseline_mm: f64, files: &[ImportedFile]) -> Result<(), LensError> {
    let [low, high] = BASELINE_MM;
    if (low..=high).contains(&baseline_mm) {
        return Ok(());
    }
    let unit_mm = files.iter().find(|file| file.right_from_left.is_some()).map_or(1.0, |file| file.unit_mm);
    let given = baseline_mm / unit_mm;
    let fits = |unit: f64| (low..=high).contains(&(given * unit));
    let guess = [("m", 1000.0), ("cm", 10.0), ("mm", 1.0)].into_iter().find(|(_, unit)| fits(*unit));
    let advice =
        guess.map_or_else(String::new, |(name, unit)| format!(": in {name} it is {:.2} mm; give --unit {name}", given * unit));
    let detail = format!("the cameras are {baseline_mm} mm apart; allowed is {low} to {high} mm{advice}");
    Err(LensError::new(LensFault::UnitMismatch, "/right", detail))
}

fn rig_device(lens: &ImportedLens, name: DeviceName) -> Result<RigDevice, LensError> {
    let pointer = format!("/{}", name.as_str());
    let (reduced, fit) =
        lens.reduced().map_err(|error| LensError { pointer: format!("{pointer}/{}", error.pointer), ..error })?;
    reduced.check(&pointer)?;
    check_centre(&reduced, name, &pointer)?;
    Ok(RigDevice {
        lens: reduced,
        // Those of more coefficients are not those of the five.
        sigma: lens.sigma.filter(|_| fit.is_none()).map(|sigma| sigma.map(Some)),
        rms_px: lens.rms_px,
        fit: fit.map(|(given, worst_px)| CoefficientFit { given, worst_px }),
    })
}

/// Requires a camera's principal point inside its image; a projector's lens may be shifted along v.
fn check_centre(lens: &LensParameters, name: DeviceName, pointer: &str) -> Result<(), LensError> {
    let [width, height] = lens.size_px.map(f64::from);
    let rows = if name == DeviceName::Projector { [-2.0 * height, 3.0 * height] } else { [0.0, height] };
    for (axis, value, [low, high]) in [("cx", lens.cx, [0.0, width]), ("cy", lens.cy, rows)] {
        if !(low..=high).contains(&value) {
            let detail = format!("is {value} px; allowed is {low} to {high} px for an image of {width} × {height}");
            return Err(LensError::new(LensFault::OutOfRange, format!("{pointer}/{axis}"), detail));
        }
    }
    Ok(())
}
