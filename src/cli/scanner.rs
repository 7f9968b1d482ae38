//! `vantage scanner`: makes a scanner's specification from the figures of its data sheet.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::Serialize;

use super::check::warn;
use super::doubts::{self, doubt};
use super::ranges::number;
use super::{CliError, files, output};
use crate::cell::{DataSheet, Scanner, ScannerSpec};
use crate::report::sketch::scanner_svg;
use crate::wire::warnings::FieldWarning;

/// Write a scanner specification from a data sheet: field of view, working distance and depth, baseline.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage scanner --field 300x200 --at 500 --depth 440..560 --baseline 200 \\
      --out my-scanner.toml
  vantage scanner --field 300x200 --at 500 --depth 440..560 --baseline 200 \\
      --name lab --resolution 4096x3000 --camera-incidence 75 \\
      --projector-incidence 70 --mass 2.4 --out lab.toml --sketch lab.svg
  vantage plan part.stl --unit mm --cell none --scanner lab.toml --out plan

The model has pinhole lenses without distortion. Both cameras aim at the centre of the field, and both cameras and the projector \
cover all of it. Once the scanner is calibrated, replace the nominal lenses and poses (`vantage calibrate scanner --like`). \
Lengths are in millimetres, angles in degrees.")]
pub struct ScannerArgs {
    /// Field of view at the working distance, WIDTHxHEIGHT in mm, each from 1 mm to three times --at; the width is along the
    /// baseline.
    #[arg(long, value_name = "WxH")]
    field: Dimensions<f64>,
    /// Working distance, mm, 1 to 10000: from the midpoint between the cameras to best focus.
    #[arg(long, value_name = "MM", value_parser = number)]
    at: f64,
    /// Working depth: nearest and farthest distance, NEAR..FAR in mm, 1 to 10000, with --at in between.
    #[arg(long, value_name = "NEAR..FAR")]
    depth: Span,
    /// Distance between the cameras, from 1 mm to three times --at.
    #[arg(long, value_name = "MM", value_parser = number)]
    baseline: f64,
    /// Name of the scanner.
    #[arg(long, default_value = "my-scanner")]
    name: String,
    /// Resolution of the cameras, WIDTHxHEIGHT in pixels, 16 to 100000 each.
    #[arg(long, value_name = "WxH", default_value = "2448x2048")]
    resolution: Dimensions<u32>,
    /// Resolution of the projector, WIDTHxHEIGHT in pixels, 16 to 100000 each.
    #[arg(long, value_name = "WxH", default_value = "1920x1200")]
    projector_resolution: Dimensions<u32>,
    /// Optical centre of the projector, relative to the midpoint between the cameras, X,Y,Z in mm: x to the right camera, y down,
    /// z towards the part.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", allow_hyphen_values = true)]
    projector: Triple,
    /// Largest angle between surface normal and camera ray, degrees, 1 to 89.9. The default is cautious: data sheets do not
    /// state it.
    #[arg(long, value_name = "DEG", default_value_t = 60.0, value_parser = number)]
    camera_incidence: f64,
    /// Largest angle between surface normal and projector ray, degrees, 1 to 89.9.
    #[arg(long, value_name = "DEG", default_value_t = 55.0, value_parser = number)]
    projector_incidence: f64,
    /// Mass of the scanner, kg, 0.01 to 100.
    #[arg(long, value_name = "KG", default_value_t = 3.0, value_parser = number)]
    mass: f64,
    /// Size of the housing, WIDTHxHEIGHTxDEPTH in mm, with its front at the cameras [default: 100 mm wider than the baseline,
    /// 130 high, 110 deep].
    #[arg(long, value_name = "WxHxD")]
    housing: Option<Triple>,
    /// Pixel pitch of the cameras, µm, 0.1 to 100; used only for depth of field.
    #[arg(long, value_name = "UM", value_parser = number)]
    pixel_pitch: Option<f64>,
    /// TOML file to write [default: standard output].
    #[arg(long)]
    out: Option<PathBuf>,
    /// SVG sketch to write: the scanner from the side, with devices, field and working depth.
    #[arg(long, value_name = "FILE.svg")]
    sketch: Option<PathBuf>,
}

/// Tilt of a surface to either side that both cameras measure, degrees, below which the baseline is doubted.
const MIN_TILT_DEG: f64 = 15.0;

/// Two values, as in `300x200`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Dimensions<T>(pub(super) [T; 2]);

/// Three numbers, as in `900,0,300` or `300x130x110`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triple(pub(super) [f64; 3]);

/// Range of numbers, as in `440..560`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Span(pub(super) [f64; 2]);

impl<T: FromStr + Copy> FromStr for Dimensions<T> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        numbers(text, &['x', 'X', '×']).map(Self).ok_or_else(|| "give WIDTHxHEIGHT, as in 300x200".to_owned())
    }
}

impl FromStr for Triple {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let read = numbers(text, &[',', 'x', 'X', '×']);
        read.map(Self).ok_or_else(|| "give three numbers, as in 900,0,300".to_owned())
    }
}

impl FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let ends = text.split_once("..").or_else(|| text.split_once('-')).or_else(|| text.split_once('–'));
        let read = ends.and_then(|(from, to)| Some([from.trim().parse().ok()?, to.trim().parse().ok()?]));
        read.map(Self).ok_or_else(|| "give NEAR..FAR, as in 440..560".to_owned())
    }
}

/// Numbers between separators, as many as asked for.
fn numbers<T: FromStr + Copy, const COUNT: usize>(text: &str, separators: &[char]) -> Option<[T; COUNT]> {
    let read: Option<Vec<T>> = text.split(separators).map(|number| number.trim().parse().ok()).collect();
    read?.try_into().ok()
}

impl ScannerArgs {
    fn sheet(&self) -> DataSheet {
        DataSheet {
            name: self.name.clone(),
            field_mm: self.field.0,
            at_mm: self.at,
            depth_mm: self.depth.0,
            baseline_mm: self.baseline,
            camera_px: self.resolution.0,
            projector_px: self.projector_resolution.0,
            projector_mm: self.projector.0,
            camera_incidence_deg: self.camera_incidence,
            projector_incidence_deg: self.projector_incidence,
            mass_kg: self.mass,
            housing_mm: self.housing.map(|Triple(size_mm)| size_mm),
            pixel_pitch_um: self.pixel_pitch,
        }
    }
}

/// Writes the specification, and the sketch if one is asked for.
///
/// # Errors
/// [`CliError::BadInput`] with every figure that is out of range; [`CliError::Failed`] if a file cannot be written.
pub fn run(args: &ScannerArgs) -> Result<(), CliError> {
    let sheet = args.sheet();
    let spec = sheet.spec().map_err(|errors| files::findings("scanner", &errors))?;
    let scanner = spec.build().map_err(|errors| files::findings("scanner", &errors))?;
    let text = text(&sheet, &spec)?;
    warn("scanner", &doubts_about(&sheet, &spec, &scanner));
    write_or_print(args.out.as_deref(), &spec, &text)?;
    if let Some(path) = &args.sketch {
        files::write(path, scanner_svg(&scanner).as_bytes())?;
    }
    let shown = args.out.as_ref().map_or_else(|| "standard output".to_owned(), |path| path.display().to_string());
    output::note(format_args!("{shown}: {}", summary(&scanner)));
    Ok(())
}

/// Doubts about figures that are in range.
fn doubts_about(sheet: &DataSheet, spec: &ScannerSpec, scanner: &Scanner) -> Vec<FieldWarning> {
    let mut doubts = Vec::new();
    let (baseline, limit, apart_deg) = (sheet.baseline_mm, sheet.camera_incidence_deg, scanner.axes_angle_rad().to_degrees());
    let tilt_deg = limit - 0.5 * apart_deg;
    if tilt_deg < MIN_TILT_DEG {
        let left = if tilt_deg > 0.0 { format!("only about {tilt_deg:.0}° is left") } else { "nothing is left".to_owned() };
        doubts.push(doubt(
            "--baseline",
            format!(
                "is {baseline} mm, so that the cameras' axes are {apart_deg:.0}° apart: at the incidence limit of {limit}° {left} for \
                 the tilt of a surface that both cameras measure"
            ),
            "give a smaller --baseline, or the --camera-incidence that the cameras are known for",
        ));
    }
    doubts.extend(serde_json::to_value(spec).map(|document| doubts::of_document(&document)).unwrap_or_default());
    doubts
}

/// Writes a specification to a file, or prints it; with `--json` as JSON.
pub(super) fn write_or_print(path: Option<&Path>, spec: &impl Serialize, text: &str) -> Result<(), CliError> {
    match path {
        Some(path) => {
            files::write(path, text.as_bytes())?;
            output::result(&serde_json::json!({ "files": [path.display().to_string()] }), "")
        }
        None if output::is_json() => output::json(spec),
        None => output::bytes(text.as_bytes()),
    }
}

/// The specification in TOML, with its sources.
fn text(sheet: &DataSheet, spec: &ScannerSpec) -> Result<String, CliError> {
    let toml = output::toml(spec)?;
    let ([width, height], [near, far]) = (sheet.field_mm, sheet.depth_mm);
    Ok(format!(
        "# From a data sheet, by `vantage scanner`: field {width} x {height} mm at {} mm, working depth {near} to {far} mm, cameras {} mm\n\
         # apart. Pinholes without distortion whose images hold the whole field; both cameras look at its middle. The practical\n\
         # volume is the field at the near end of the working depth. Limits of incidence, mass and housing are as given, or\n\
         # assumed. Replace poses and lenses with your calibration. Lengths in mm, angles in degrees, focal lengths in pixels.\n\n{toml}",
        sheet.at_mm, sheet.baseline_mm
    ))
}

fn summary(scanner: &Scanner) -> String {
    let [width, height] = scanner.common_field_at(scanner.best_mm).size_mm();
    format!(
        "scanner {}: field {width:.0} × {height:.0} mm at {:.0} mm, axes {:.1}° apart, block cube {:.0} mm",
        scanner.name,
        scanner.best_mm,
        scanner.axes_angle_rad().to_degrees(),
        scanner.block_cube_mm
    )
}

#[cfg(test)]
mod tests;
