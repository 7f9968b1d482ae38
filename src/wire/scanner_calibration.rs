//! Result of a calibration of lenses and poses, schema `vantage.scanner_calibration/1`: figures with their uncertainty, residuals,
//! coverage, and what was assumed. What is not known is `null`, never 0.

use serde::Serialize;
use utoipa::ToSchema;

use crate::cell::calibration::lens::{
    Adjusted, Assumption, CalibrationFormat, DepthDatum, DepthOrigin, PARAMETER_NAMES, Quality, Rig, RigDevice, ScannerDraft,
};
use crate::cell::{DeviceName, Field};

/// Schema name of the document.
pub const SCANNER_CALIBRATION_SCHEMA: &str = "vantage.scanner_calibration/1";
/// Share of the image's radius below which coverage is worth a warning.
const MIN_RADIUS: f64 = 0.8;
/// Share of cells below which coverage is worth a warning.
const MIN_CELLS: f64 = 0.6;
/// Difference of the common field from the stated one that is worth a warning.
const FIELD_TOLERANCE: f64 = 0.1;
/// Error of the board's pitch, as a share of the distance at which a scanner of this class measures 0.05 mm, worth a warning, mm.
const PITCH_MAX_MM: f64 = 0.1;

/// Result of a calibration of a scanner's lenses and poses.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ScannerCalibration {
    /// Schema name, `vantage.scanner_calibration/1`.
    pub schema: &'static str,
    /// Name of the scanner.
    pub scanner: String,
    /// Formats of the files, in their order.
    pub from: Vec<CalibrationFormat>,
    /// Names of the files.
    pub files: Vec<String>,
    /// SHA-256 of the files' bytes, one after the other.
    pub data_sha256: String,
    /// Time of the measurements; `null` if no file gives it.
    pub taken_at: Option<String>,
    /// True if the adjustment of the observations converged; `null` without observations.
    pub converged: Option<bool>,
    /// Iterations of the adjustment; `null` without observations.
    pub iterations: Option<usize>,
    /// Rig.
    pub rig: RigFigures,
    /// Left camera, right camera and, if it was calibrated, projector.
    pub devices: Vec<DeviceFigures>,
    /// Root mean square distance from epipolar lines, px; `null` without observations.
    pub epipolar_rms_px: Option<f64>,
    /// Triangulated distances between neighbours of the board; `null` without observations.
    pub board_pitch: Option<PitchFigures>,
    /// Views, in their order; empty without observations.
    pub views: Vec<ViewFigures>,
    /// Range of depths of the board's points, scanner frame; `null` without observations.
    pub board_depth_mm: Option<[f64; 2]>,
    /// Field at best focus.
    pub field: FieldCheck,
    /// Commissioning of working distances; `null` if it was not done.
    pub depth_origin: Option<DepthOriginFigures>,
    /// Values that were assumed.
    pub assumed: Vec<Assumption>,
    /// Findings in words.
    pub warnings: Vec<String>,
}

/// Pose between the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct RigFigures {
    /// Distance between the optical centres.
    pub baseline_mm: f64,
    /// Standard deviation of the distance; `null` if it is not known.
    pub baseline_sigma_mm: Option<f64>,
    /// Angle between the optical axes.
    pub axes_angle_deg: f64,
    /// Standard deviation of the angle; `null` if it is not known.
    pub axes_angle_sigma_deg: Option<f64>,
    /// Boards that the pose is the mean of; `null` if it was given or estimated.
    pub boards: Option<usize>,
    /// Smallest and largest baseline of one of those boards.
    pub board_baseline_mm: Option<[f64; 2]>,
    /// Largest turn of one of those boards against the mean; `null` for one board, whose error cannot be seen.
    pub board_turn_deg: Option<f64>,
}

/// Lens and residuals of one device.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct DeviceFigures {
    /// `left`, `right` or `projector`.
    pub name: &'static str,
    /// Width and height of the image.
    pub size_px: [u32; 2],
    /// Parameters of the lens.
    pub parameters: Vec<ParameterFigures>,
    /// Standard deviations of the pose from the left camera: turn about x, y and z; `null` if they are not known.
    pub rotation_sigma_deg: Option<[f64; 3]>,
    /// Standard deviations of the pose from the left camera: shift; `null` if they are not known.
    pub translation_sigma_mm: Option<[f64; 3]>,
    /// Root mean square length of the reprojection errors; `null` if it is not known.
    pub rms_px: Option<f64>,
    /// Standard deviation of a coordinate of a pixel, as estimated; `null` without observations.
    pub sigma_px: Option<f64>,
    /// Sightings used; `null` without observations.
    pub used: Option<usize>,
    /// Sightings left out as outliers; `null` without observations.
    pub left_out: Option<usize>,
    /// Share of 8 × 6 cells of the image with sightings; `null` without observations.
    pub covered_cells: Option<f64>,
    /// Largest distance of a sighting from the image's middle, as a share of that of a corner; `null` without observations.
    pub covered_radius: Option<f64>,
    /// Coefficients of the file, where five stand for more; else `null`.
    pub fitted_coefficients: Option<usize>,
    /// Largest difference of those five in the image, px; else `null`.
    pub fitted_worst_px: Option<f64>,
}

/// Parameter of a lens; focal lengths and principal point in px from the outer corner of the first pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct ParameterFigures {
    /// Name.
    pub name: &'static str,
    /// Value.
    pub value: f64,
    /// Standard deviation; `null` if it is not known, or the parameter was held.
    pub sigma: Option<f64>,
}

/// Triangulated distances between neighbouring points of the board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct PitchFigures {
    /// Root mean square error, mm.
    pub rms_mm: f64,
    /// Mean error, mm: a scale that is wrong.
    pub mean_mm: f64,
    /// Distances.
    pub count: usize,
}

/// One view.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ViewFigures {
    /// Name of the view.
    pub id: String,
    /// Residual of the left camera, root mean square; `null` where it does not see the board.
    pub left_rms_px: Option<f64>,
    /// Residual of the right camera.
    pub right_rms_px: Option<f64>,
    /// Residual of the projector.
    pub projector_rms_px: Option<f64>,
    /// Sightings left out.
    pub left_out: usize,
    /// Depth of the board's middle, scanner frame; `null` for a view that was not used.
    pub depth_mm: Option<f64>,
    /// Angle between the board's normal and the scanner's z.
    pub tilt_deg: Option<f64>,
    /// True if the calibration is better made again without this view.
    pub leave_out: bool,
}

/// Field at best focus: seen beside stated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct FieldCheck {
    /// Depth of best focus, scanner frame.
    pub depth_mm: f64,
    /// Width and height that both cameras see.
    pub cameras_mm: [f64; 2],
    /// Width and height that all three devices see.
    pub common_mm: [f64; 2],
    /// Width and height as stated; `null` if they were not.
    pub stated_mm: Option<[f64; 2]>,
}

/// Plane from which working distances count.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct DepthOriginFigures {
    /// Depth of that plane along z of the scanner.
    pub origin_mm: f64,
    /// Standard deviation of the depth.
    pub sigma_mm: f64,
    /// Measured length of a stated millimetre.
    pub scale: f64,
    /// Plane that it is.
    pub datum: DepthDatum,
    /// Residuals of the planes.
    pub residuals_mm: Vec<f64>,
}

/// Source of a calibration: formats, names and digest of its files, and the time of the measurements.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibrationSource {
    /// Formats of the files.
    pub from: Vec<CalibrationFormat>,
    /// Names of the files.
    pub files: Vec<String>,
    /// SHA-256 of the files' bytes, one after the other.
    pub data_sha256: String,
    /// Time of the measurements.
    pub taken_at: Option<String>,
}

impl ScannerCalibration {
    /// Collects the figures of a calibration.
    #[must_use]
    pub fn new(
        source: &CalibrationSource,
        rig: &Rig,
        draft: &ScannerDraft,
        observed: Option<(&Adjusted, &Quality)>,
        depth_origin: Option<&DepthOrigin>,
    ) -> Self {
        let quality = observed.map(|(_, quality)| quality);
        let devices = rig.devices.as_ref().map(Option::as_ref);
        let projector = devices.projector.or(draft.lit.as_ref());
        let listed = [(DeviceName::Left, devices.left), (DeviceName::Right, devices.right), (DeviceName::Projector, projector)];
        let mut document = Self {
            schema: SCANNER_CALIBRATION_SCHEMA,
            scanner: draft.spec.name.clone(),
            from: source.from.clone(),
            files: source.files.clone(),
            data_sha256: source.data_sha256.clone(),
            taken_at: source.taken_at.clone(),
            converged: observed.map(|(adjusted, _)| adjusted.is_converged),
            iterations: observed.map(|(adjusted, _)| adjusted.iterations),
            rig: rig_figures(rig, draft),
            devices: listed.into_iter().filter_map(|(name, device)| Some(device_figures(name, device?, observed))).collect(),
            epipolar_rms_px: quality.and_then(|quality| quality.epipolar_rms_px),
            board_pitch: quality.and_then(|quality| quality.pitch).map(|(rms_mm, mean_mm, count)| PitchFigures {
                rms_mm,
                mean_mm,
                count,
            }),
            views: quality.map_or_else(Vec::new, view_figures),
            board_depth_mm: quality.and_then(|quality| quality.depth_mm),
            field: field_check(draft),
            depth_origin: depth_origin.map(|origin| DepthOriginFigures {
                origin_mm: origin.origin_mm,
                sigma_mm: origin.sigma_mm,
                scale: origin.scale,
                datum: origin.datum,
                residuals_mm: origin.residuals_mm.clone(),
            }),
            assumed: draft.assumptions.clone(),
            warnings: Vec::new(),
        };
        document.warnings = quality.and_then(refused_images).into_iter().chain(warnings(&document)).collect();
        document
    }
}

fn rig_figures(rig: &Rig, draft: &ScannerDraft) -> RigFigures {
    RigFigures {
        baseline_mm: draft.checks.baseline_mm,
        baseline_sigma_mm: rig.sigma.map(|sigma| sigma.baseline_mm),
        axes_angle_deg: draft.checks.axes_angle_deg,
        axes_angle_sigma_deg: rig.sigma.map(|sigma| sigma.axes_angle_deg),
        boards: rig.scatter.map(|scatter| scatter.boards),
        board_baseline_mm: rig.scatter.map(|scatter| scatter.baseline_mm),
        board_turn_deg: rig.scatter.and_then(|scatter| scatter.max_turn_deg),
    }
}

fn device_figures(name: DeviceName, device: &RigDevice, observed: Option<(&Adjusted, &Quality)>) -> DeviceFigures {
    let residuals = observed.and_then(|(adjusted, _)| adjusted.devices[name]);
    let coverage = observed.and_then(|(_, quality)| quality.coverage[name]);
    let pose = observed.filter(|_| residuals.is_some()).and_then(|(adjusted, _)| adjusted.pose_sigma(name));
    let sigma = |index: usize| device.sigma.and_then(|sigma| sigma[index]);
    let values = PARAMETER_NAMES.into_iter().zip(device.lens.values()).enumerate();
    DeviceFigures {
        name: name.as_str(),
        size_px: device.lens.size_px,
        parameters: values.map(|(index, (name, value))| ParameterFigures { name, value, sigma: sigma(index) }).collect(),
        rotation_sigma_deg: pose.map(|[a, b, c, ..]| [a, b, c].map(f64::to_degrees)),
        translation_sigma_mm: pose.map(|[.., x, y, z]| [x, y, z]),
        rms_px: device.rms_px,
        sigma_px: residuals.map(|residuals| residuals.sigma_px),
        used: residuals.map(|residuals| residuals.used),
        left_out: residuals.map(|residuals| residuals.left_out),
        covered_cells: coverage.map(|coverage| coverage.cells),
        covered_radius: coverage.map(|coverage| coverage.radius),
        fitted_coefficients: device.fit.map(|fit| fit.given),
        fitted_worst_px: device.fit.map(|fit| fit.worst_px),
    }
}

fn view_figures(quality: &Quality) -> Vec<ViewFigures> {
    let figures = quality.views.iter().map(|view| ViewFigures {
        id: view.id.clone(),
        left_rms_px: view.rms_px.left,
        right_rms_px: view.rms_px.right,
        projector_rms_px: view.rms_px.projector,
        left_out: view.left_out,
        depth_mm: view.depth_mm,
        tilt_deg: view.tilt_deg,
        leave_out: view.leave_out.is_some(),
    });
    figures.collect()
}

fn field_check(draft: &ScannerDraft) -> FieldCheck {
    FieldCheck {
        depth_mm: draft.checks.best_mm,
        cameras_mm: Field::size_mm(&draft.checks.cameras_field),
        common_mm: Field::size_mm(&draft.checks.common_field),
        stated_mm: draft.checks.stated_field_mm,
    }
}

/// Images that were refused, in words.
fn refused_images(quality: &Quality) -> Option<String> {
    let of_view = |(id, devices): &(String, Vec<DeviceName>)| {
        let names: Vec<&str> = devices.iter().map(|device| device.as_str()).collect();
        format!("{id} ({})", names.join(", "))
    };
    let images: Vec<String> = quality.refused.iter().map(of_view).collect();
    (!images.is_empty()).then(|| {
        format!(
            "images refused, and not used: {}. Most of their points do not fit the other views: corners of another board, mirrored or in \
             another order, or a board that moved; take them again, or leave them out",
            images.join(", ")
        )
    })
}

/// Warning of an adjustment that has not converged, with what to do.
fn without_convergence(converged: Option<bool>, iterations: Option<usize>) -> Option<String> {
    converged.filter(|is_converged| !is_converged).map(|_| {
        format!(
            "the adjustment did not converge after {} iterations, and neither its figures nor their uncertainties are to be used: \
             take more views, tilted by 20 to 40° about both axes, or hold lens parameters with --hold",
            iterations.unwrap_or_default()
        )
    })
}

/// Findings in words, the gravest first.
fn warnings(document: &ScannerCalibration) -> Vec<String> {
    let mut out: Vec<String> = without_convergence(document.converged, document.iterations).into_iter().collect();
    let leave_out: Vec<&str> = document.views.iter().filter(|view| view.leave_out).map(|view| view.id.as_str()).collect();
    if !leave_out.is_empty() {
        out.push(format!("leave out and calibrate again: views {}", leave_out.join(", ")));
    }
    if document.rig.boards == Some(1) {
        out.push(
            "the pose between the cameras comes from a single board, so its error cannot be estimated; give more views".into(),
        );
    }
    if document.devices.iter().all(|device| device.parameters.iter().all(|parameter| parameter.sigma.is_none())) {
        out.push("no uncertainty is given for any parameter".to_owned());
    }
    if let Some(stated) = document.field.stated_mm {
        let pairs = document.field.common_mm.into_iter().zip(stated);
        if pairs.clone().any(|(seen, stated)| (seen / stated - 1.0).abs() > FIELD_TOLERANCE) {
            let [width, height] = document.field.common_mm;
            let [stated_width, stated_height] = stated;
            out.push(format!(
                "all three devices see {width:.0} × {height:.0} mm at best focus; stated are {stated_width:.0} × {stated_height:.0} mm"
            ));
        }
    }
    if let Some(pitch) = document.board_pitch.filter(|pitch| pitch.rms_mm > PITCH_MAX_MM) {
        out.push(format!("distances on the board are measured to {:.3} mm rms: check its pitch and flatness", pitch.rms_mm));
    }
    for device in &document.devices {
        if let (Some(cells), Some(radius)) = (device.covered_cells, device.covered_radius)
            && (cells < MIN_CELLS || radius < MIN_RADIUS)
        {
            out.push(format!(
                "the board covers {:.0} % of the {}'s image and {:.0} % of the way to its corners: the lens model is \
                 extrapolated beyond that",
                100.0 * cells,
                device.name,
                100.0 * radius
            ));
        }
        if let (Some(count), Some(worst_px)) = (device.fitted_coefficients, device.fitted_worst_px) {
            out.push(format!(
                "{}: five coefficients approximate the {count} of the source, to within {worst_px:.4} px",
                device.name
            ));
        }
    }
    out.extend(document.assumed.iter().map(|assumption| format!("assumed: {}", assumption_words(*assumption))));
    out
}

/// An assumption in words.
fn assumption_words(assumption: Assumption) -> &'static str {
    match assumption {
        Assumption::BestFocus => "best focus where the cameras' axes come closest; give --field WxH@DISTANCE",
        Assumption::Depth => "a working depth of 15 % of best focus on both sides; give --depth NEAR..FAR",
        Assumption::Field => "the field is all that both cameras see at best focus; give --field WxH@DISTANCE",
        Assumption::Projector => {
            "a projector at the middle of the baseline that lights exactly the field; calibrate it, or give the rectangle that it lights"
        }
        Assumption::Housing => {
            "limits of incidence, mass and housing of an unknown scanner; give --like SCANNER, or edit the file"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An adjustment that ended at its limits was told like any other.
    #[test]
    fn an_adjustment_without_convergence_is_warned_of_with_what_to_do() {
        let told = without_convergence(Some(false), Some(300)).expect("a warning");
        assert!(told.contains("did not converge after 300 iterations") && told.ends_with("with --hold"), "{told}");
        assert_eq!(without_convergence(Some(true), Some(31)), None);
        assert_eq!(without_convergence(None, None), None, "nothing was adjusted");
    }
}
