//! `vantage calibrate scanner`: lenses and poses of a scanner from the files of other programs, or from points of a board.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sha2::{Digest, Sha256};

use super::with_sd;
use crate::cell::calibration::lens::{
    self, AdjustOptions, Adjusted, BoardObservations, CalibrationFormat, DepthOrigin, DraftFigures, ImportOptions, LensError,
    LitRectangleSpec, MAX_FILE_BYTES, PARAMETER_NAMES, Quality, Rig, ScannerDraft, ScannerObservationsSpec, StatedPlane,
};
use crate::cell::{
    CalibratedScannerSpec, DeviceName, PerDevice, Presets, ScannerResidualsSpec, ScannerSpec, SpecKind, SpecLibrary,
};
use crate::cli::scanner::{Dimensions, Span, write_or_print};
use crate::cli::{CliError, FileFinding, files, output, spec_paths};
use crate::geometry::LengthUnit;
use crate::report::scanner_calibration::{CalibrationPictures, html};
use crate::wire::scanner_calibration::{CalibrationSource, ScannerCalibration};
use crate::wire::words::{counted, fixed};
use crate::wire::{Distinct, hex};

/// Names of the parameters that can be held at 0.
const HOLDABLE: std::ops::Range<usize> = 4..10;

/// Write a scanner specification from calibration files, or from observed points of a board.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage calibrate scanner intrinsics.yml extrinsics.yml \\
      --image-size 4000x3036 --field 300x190@480 --out my-scanner.toml
  vantage calibrate scanner Calib_left.m Calib_right.m --field 300x190@480 \\
      --depth 410..565 --out my-scanner.toml
  vantage calibrate scanner observations.json --like my-scanner.toml \\
      --out calibrated.toml --report calibration.html

Calibration results can come from OpenCV (YAML, XML or JSON), Bouguet's toolbox (.m), MATLAB (stereoParams as JSON), Kalibr \
(camera chain), or a scanner file of Vantage. Observations are JSON of schema vantage.scanner_observations/1, or CSV or TSV \
with the columns view,device,x_mm,y_mm,z_mm,u_px,v_px. Vantage does not detect corners in images. Values that the files do not \
give stay unknown; no uncertainty is made up.")]
pub struct CalibrateScannerArgs {
    /// Calibration results (one file for both cameras, or left, right and projector in this order), or one file of observations.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Format of the files: opencv, bouguet, matlab, kalibr, toml or observations [default: recognised by content].
    #[arg(long, value_name = "FORMAT", value_parser = format_name)]
    from: Option<CalibrationFormat>,
    /// Image size of the cameras, WIDTHxHEIGHT in pixels, 16 to 100000 each, if the files do not give it.
    #[arg(long, value_name = "WxH")]
    image_size: Option<Dimensions<u32>>,
    /// Image size of the projector, WIDTHxHEIGHT in pixels, 16 to 100000 each.
    #[arg(long, value_name = "WxH")]
    projector_size: Option<Dimensions<u32>>,
    /// Unit of lengths in the files: mm, cm, m or inch [default: m for Kalibr, mm for the others].
    #[arg(long, value_name = "UNIT")]
    unit: Option<LengthUnit>,
    /// Field at the working distance of best focus, WIDTHxHEIGHT@DISTANCE in mm, as in 300x190@480.
    #[arg(long, value_name = "WxH@MM")]
    field: Option<FieldAt>,
    /// Working depth, NEAR..FAR in mm.
    #[arg(long, value_name = "NEAR..FAR")]
    depth: Option<Span>,
    /// Scanner (preset name or file) to take the other values from: working depth, incidence, mass, housing, and all that is
    /// not calibrated.
    #[arg(long, value_name = "SCANNER")]
    like: Option<String>,
    /// Name of the scanner.
    #[arg(long)]
    name: Option<String>,
    /// JSON or TOML file with the rectangle that the projector lights at two or three depths, if the projector is not calibrated.
    #[arg(long, value_name = "FILE")]
    lit: Option<PathBuf>,
    /// Plane at a known working distance and its measured depth in the scanner frame, STATED=MEASURED in mm. Repeat for three
    /// or more planes, to find the origin of working distances.
    #[arg(long, value_name = "MM=MM")]
    plane: Vec<PlaneAt>,
    /// Lens parameters to hold at 0 in the estimation, comma-separated: skew, k1, k2, p1, p2, k3.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    hold: Vec<String>,
    /// TOML file to write [default: standard output].
    #[arg(long)]
    out: Option<PathBuf>,
    /// HTML report to write: figures, reprojection errors, coverage, residuals by view.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

fn format_name(text: &str) -> Result<CalibrationFormat, String> {
    let names = CalibrationFormat::ALL.map(CalibrationFormat::as_str);
    let found = CalibrationFormat::ALL.into_iter().find(|format| format.as_str() == text);
    found.ok_or_else(|| format!("allowed are {}", names.join(", ")))
}

/// Field with its distance, as in `300x190@480`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FieldAt([f64; 3]);

impl FromStr for FieldAt {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "give WIDTHxHEIGHT@DISTANCE, as in 300x190@480".to_owned();
        let (size, distance) = text.split_once('@').ok_or_else(wrong)?;
        let size: Dimensions<f64> = size.parse().map_err(|_| wrong())?;
        let ([width, height], distance) = (size.0, distance.trim().parse::<f64>().map_err(|_| wrong())?);
        let is_length = |value: f64| (1.0..=1e4).contains(&value);
        if [width, height, distance].into_iter().all(is_length) { Ok(Self([width, height, distance])) } else { Err(wrong()) }
    }
}

/// Plane at a known distance, as in `480=478.2`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PlaneAt(StatedPlane);

impl FromStr for PlaneAt {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers = text.split_once('=').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
        let plane = numbers.map(|(stated_mm, measured_mm)| Self(StatedPlane { stated_mm, measured_mm }));
        plane.ok_or_else(|| "give STATED=MEASURED, as in 480=478.2".to_owned())
    }
}

/// Data of the files.
enum Data {
    /// Results of other programs.
    Results { rig: Box<Rig>, specification: Option<Box<ScannerSpec>> },
    /// Observations, and the rectangle that the projector lights.
    Observed(Box<BoardObservations>, Option<LitRectangleSpec>),
}

/// Writes the specification, and the report if one is asked for.
///
/// # Errors
/// [`CliError::Findings`] with the file and the code of a fault; [`CliError::Failed`] if a file cannot be written.
pub fn run(args: &CalibrateScannerArgs) -> Result<(), CliError> {
    let like = args.like.as_ref().map(|name| files::spec(SpecKind::Scanner, name, Presets.scanner(name))).transpose()?;
    let lit = args.lit.as_ref().map(|path| files::from_value(files::value(path)?, &path.display().to_string())).transpose()?;
    let options = args.adjust_options()?;
    let (data, source) = args.read()?;
    let all = args.files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    let refuse = |error: LensError| fault(&all, &error);
    let mut figures = DraftFigures {
        name: args.name.clone(),
        field_mm: args.field.map(|FieldAt(field)| field),
        depth_mm: args.depth.map(|span| span.0),
        depth_origin_mm: None,
        lit_rectangle: lit,
        like,
    };
    let (rig, observed) = match data {
        Data::Results { rig, specification } => {
            figures.like = figures.like.or(specification.map(|spec| *spec));
            (*rig, None)
        }
        Data::Observed(observations, lit) => {
            figures.lit_rectangle = figures.lit_rectangle.or(lit);
            let adjusted = lens::adjust(&observations, &options).map_err(refuse)?;
            let quality = lens::quality(&observations, &adjusted);
            (Rig::from(&adjusted), Some((observations, adjusted, quality)))
        }
    };
    let observed = observed.as_ref().map(|(observations, adjusted, quality)| (&**observations, adjusted, quality));
    let origin = args.depth_origin(&figures, observed).map_err(refuse)?;
    figures.depth_origin_mm = origin.as_ref().map(|origin| origin.origin_mm);
    let calibrated = provenance(&source, &rig, observed);
    let draft = ScannerDraft::new(&rig, &figures, calibrated).map_err(refuse)?;
    let judged = observed.map(|(_, adjusted, quality)| (adjusted, quality));
    let document = ScannerCalibration::new(&source, &rig, &draft, judged, origin.as_ref());
    args.write(&draft, &document, observed)
}

impl CalibrateScannerArgs {
    fn adjust_options(&self) -> Result<AdjustOptions, CliError> {
        let mut options = AdjustOptions::default();
        for name in &self.hold {
            let place = HOLDABLE.into_iter().find(|index| PARAMETER_NAMES[*index] == name);
            let place = place.ok_or_else(|| {
                let allowed = PARAMETER_NAMES[HOLDABLE].join(", ");
                CliError::BadInput(format!("--hold {name}: allowed are {allowed}"))
            })?;
            options.is_held[place] = true;
        }
        Ok(options)
    }

    /// Reads the files; their digest is over all bytes in their order.
    fn read(&self) -> Result<(Data, CalibrationSource), CliError> {
        let mut source = CalibrationSource::default();
        let (mut hash, mut results) = (Sha256::new(), Vec::new());
        let mut observed = None;
        for path in &self.files {
            let name = path.display().to_string();
            let text = text_of(path)?;
            hash.update(text.as_bytes());
            let format = self.from.or_else(|| lens::detect(&text)).ok_or_else(|| {
                CliError::BadInput(format!("{name}: the format is not recognised (unknown_format); give it with --from"))
            })?;
            source.files.push(path.file_name().map_or_else(|| name.clone(), |file| file.to_string_lossy().into_owned()));
            source.from.push(format);
            if format == CalibrationFormat::Observations {
                observed = Some(self.observations(&name, &text)?);
            } else {
                let mut file = lens::read(&text, format, &self.import_options()).map_err(|error| fault(&name, &error))?;
                if let Some(spec) = &mut file.specification {
                    **spec = spec_paths::placed(&**spec, path)?;
                }
                source.taken_at = source.taken_at.or_else(|| file.at.clone());
                results.push(file);
            }
        }
        source.data_sha256 = hex(&hash.finalize());
        if let Some((observations, lit)) = observed {
            if self.files.len() > 1 {
                return Err(CliError::BadInput("give one file of observations, or files of results".to_owned()));
            }
            source.taken_at.clone_from(&observations.taken_at);
            return Ok((Data::Observed(Box::new(observations), lit), source));
        }
        let rig = lens::assemble(&results).map_err(|error| fault(&source.files.join(", "), &error))?;
        let specification = results.into_iter().find_map(|file| file.specification);
        Ok((Data::Results { rig: Box::new(rig), specification }, source))
    }

    fn import_options(&self) -> ImportOptions {
        ImportOptions {
            image_size_px: self.image_size.map(|size| size.0),
            projector_size_px: self.projector_size.map(|size| size.0),
            unit: self.unit,
        }
    }

    fn observations(&self, name: &str, text: &str) -> Result<(BoardObservations, Option<LitRectangleSpec>), CliError> {
        if !text.trim_start_matches('\u{feff}').trim_start().starts_with('{') {
            let camera = self.image_size.map(|size| size.0);
            let size_px = PerDevice { left: camera, right: camera, projector: self.projector_size.map(|size| size.0) };
            return lens::read_csv(text, size_px).map(|observations| (observations, None)).map_err(|error| fault(name, &error));
        }
        let Distinct(value) = serde_json::from_str(text)
            .map_err(|error| CliError::BadInput(format!("{name}: not JSON: {}", files::json_fault(text, &error))))?;
        let spec: ScannerObservationsSpec = files::from_value(value, name)?;
        let observations = spec.build().map_err(|error| fault(name, &error))?;
        Ok((observations, spec.lit_rectangle))
    }

    fn depth_origin(
        &self,
        figures: &DraftFigures,
        observed: Option<(&BoardObservations, &Adjusted, &Quality)>,
    ) -> Result<Option<DepthOrigin>, LensError> {
        let mut planes: Vec<StatedPlane> = self.plane.iter().map(|PlaneAt(plane)| *plane).collect();
        planes.extend(observed.iter().flat_map(|(observations, adjusted, _)| lens::stated_planes(observations, adjusted)));
        if planes.is_empty() {
            return Ok(None);
        }
        let front_mm = figures.like.as_ref().and_then(lens::housing_front_mm);
        lens::depth_origin(&planes, front_mm).map(Some)
    }

    fn write(
        &self,
        draft: &ScannerDraft,
        document: &ScannerCalibration,
        observed: Option<(&BoardObservations, &Adjusted, &Quality)>,
    ) -> Result<(), CliError> {
        if let Some(path) = &self.report {
            let pictures = observed.map(|(observations, adjusted, _)| CalibrationPictures::new(observations, adjusted));
            files::write(path, html(document, pictures.as_ref()).as_bytes())?;
        }
        for warning in &document.warnings {
            output::note(format_args!("warning: {warning}"));
        }
        let toml = match &self.out {
            Some(path) => output::toml(&spec_paths::named_for(&draft.spec, path)?)?,
            None => output::toml(&draft.spec)?,
        };
        let toml = format!(
            "# Calibrated, by `vantage calibrate scanner` from {}. Lengths in mm, angles in degrees, focal lengths in pixels;\n\
             # pixels count from the outer corner of the first one.\n\n{toml}",
            document.files.join(", ").replace(['\n', '\r'], " ")
        );
        match &self.out {
            Some(path) => {
                files::write(path, toml.as_bytes())?;
                output::result(document, summary(document))
            }
            None if output::is_json() => output::json(document),
            None => {
                output::note(summary(document).trim_end());
                write_or_print(None, &draft.spec, &toml)
            }
        }
    }
}

/// The text of a file that is not too large.
fn text_of(path: &Path) -> Result<String, CliError> {
    let name = path.display();
    let size = std::fs::metadata(path).map_err(|error| files::unreadable(path, &error))?.len();
    if size > MAX_FILE_BYTES as u64 {
        return Err(CliError::BadInput(format!("{name}: has {size} bytes; allowed are {MAX_FILE_BYTES} (too_large)")));
    }
    let bytes = std::fs::read(path).map_err(|error| files::unreadable(path, &error))?;
    files::refuse_mesh(path, "a calibration or a table of points")?;
    let text = String::from_utf8(bytes).ok().filter(|text| !text.contains('\0'));
    let unreadable = |reason: &str| CliError::BadInput(format!("{name}: {reason}"));
    let text = text.ok_or_else(|| unreadable("not a text file (unreadable); export .mat files as text or JSON"))?;
    if text.trim().is_empty() { Err(unreadable("is empty (unreadable); export the calibration again")) } else { Ok(text) }
}

fn fault(file: &str, error: &LensError) -> CliError {
    let detail = format!("{} ({})", error.detail, error.code.as_str());
    CliError::Findings(vec![FileFinding { file: file.to_owned(), pointer: error.pointer.clone(), detail }])
}

fn provenance(
    source: &CalibrationSource,
    rig: &Rig,
    observed: Option<(&BoardObservations, &Adjusted, &Quality)>,
) -> CalibratedScannerSpec {
    let rms = |name: DeviceName| rig.devices[name].as_ref().and_then(|device| device.rms_px);
    let residuals = ScannerResidualsSpec {
        left_rms_px: rms(DeviceName::Left),
        right_rms_px: rms(DeviceName::Right),
        projector_rms_px: rms(DeviceName::Projector),
        epipolar_rms_px: observed.and_then(|(_, _, quality)| quality.epipolar_rms_px),
        board_pitch_rms_mm: observed.and_then(|(_, _, quality)| quality.pitch).map(|(rms_mm, _, _)| rms_mm),
    };
    let by = match observed {
        Some((observations, _, _)) => format!("bundle adjustment of {} views", observations.views.len()),
        None => {
            let mut formats: Vec<&str> = source.from.iter().map(|format| format.as_str()).collect();
            formats.dedup();
            format!("import from {}", formats.join(" and "))
        }
    };
    let is_known = residuals.named().iter().any(|(_, value, _)| value.is_some());
    CalibratedScannerSpec {
        by,
        at: source.taken_at.clone(),
        data_sha256: source.data_sha256.clone(),
        residuals: is_known.then_some(residuals),
    }
}

/// The result for people.
fn summary(document: &ScannerCalibration) -> String {
    let known = |figure: String, sd: Option<String>| match sd {
        Some(sd) => with_sd(&figure, &sd),
        None => figure,
    };
    let rig = &document.rig;
    let mut out = format!(
        "scanner {}: baseline {}, optical axes {}\n",
        document.scanner,
        known(format!("{:.2} mm", rig.baseline_mm), rig.baseline_sigma_mm.map(|mm| format!("{mm:.3} mm"))),
        known(format!("{:.2}° apart", rig.axes_angle_deg), rig.axes_angle_sigma_deg.map(|deg| format!("{deg:.4}°")))
    );
    if let (Some(boards), Some([low, high])) = (rig.boards, rig.board_baseline_mm) {
        let _ = writeln!(
            out,
            "          from {boards} board{}, baseline {low:.2} to {high:.2} mm",
            if boards == 1 { "" } else { "s" }
        );
    }
    if let Some(is_converged) = document.converged {
        let (told, iterations) = (if is_converged { "converged in" } else { "not converged after" }, document.iterations);
        let _ = writeln!(out, "adjusted  {told} {}", counted(iterations.unwrap_or_default(), "iteration"));
    }
    let [width, height] = document.field.common_mm;
    let stated = document.field.stated_mm.map_or_else(String::new, |[w, h]| format!(", stated {w:.0} × {h:.0}"));
    let _ = writeln!(
        out,
        "field     {width:.0} × {height:.0} mm seen by all three devices at {:.0} mm{stated}",
        document.field.depth_mm
    );
    for device in &document.devices {
        let rms = device
            .rms_px
            .map_or_else(|| "reprojection error not given".to_owned(), |rms| format!("reprojection {rms:.3} px rms"));
        let counted = device
            .used
            .map_or_else(String::new, |used| format!(", {used} points, {} left out", device.left_out.unwrap_or_default()));
        let _ = writeln!(out, "{:<9} {rms}{counted}", device.name);
    }
    if let (Some(epipolar), Some(pitch)) = (document.epipolar_rms_px, document.board_pitch) {
        let _ = writeln!(
            out,
            "together  epipolar {epipolar:.3} px rms, board pitch {:.4} mm rms ({:+.4} mean)",
            pitch.rms_mm,
            // Adding 0 turns what is rounded to −0 into 0.
            (pitch.mean_mm * 1e4).round() / 1e4 + 0.0
        );
    }
    if let Some(origin) = &document.depth_origin {
        let datum = origin.datum.as_str().replace('_', " ");
        let _ = writeln!(
            out,
            "distance counts from z = {} ({datum}); 1 mm stated is {:.4} mm measured",
            with_sd(&format!("{} mm", fixed(origin.origin_mm, 2)), &format!("{:.2} mm", origin.sigma_mm)),
            origin.scale
        );
    }
    out
}

#[cfg(test)]
mod tests;
