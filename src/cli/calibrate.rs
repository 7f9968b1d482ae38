//! `vantage calibrate`: from raw observations to a cell that can be trusted, with residuals, uncertainty and a check before use.

mod brightness;
mod cell;
mod check;
mod part;
mod pose_files;
mod poses;
pub mod scanner;

use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::{CliError, FileFinding, files, output, spec_paths};
use crate::cell::calibration::data::HandEyeSetup;
use crate::cell::calibration::findings::CalibrationFinding;
use crate::cell::{CellSpec, FieldError};
use crate::wire::calibration::{
    CalibrationData, CsvOptions, RobotPoseKind, from_csv, from_easy_handeye, from_pose_samples, from_zivid, rows_without_board,
    sentence,
};
use crate::wire::words::fixed;
use crate::wire::{Distinct, hex, json_error, json_file_bytes};

/// Files of observations that are read.
const READ: &str = "observations are JSON or TOML of schema vantage.calibration_data/1, CSV or TSV, MoveIt's pairs of poses, \
                    samples of easy_handeye2 (.yaml, .samples), or a folder of posNN.yaml with boardNN.yaml as Zivid writes them";
/// Largest file of observations, bytes.
const MAX_BYTES: u64 = 256 << 20;

/// Calibrate a scanner or a cell, check a calibration before use, or locate the part on the table.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage calibrate scanner stereo.yml --out my-scanner.toml
  vantage calibrate poses --cell my-cell.toml --count 15 --board 11x8x15 \\
      --out poses.json
  vantage calibrate cell data.json --cell my-cell.toml --hold-out 2 \\
      --out calibration.json --write-cell calibrated.toml
  vantage calibrate check check.json --cell calibrated.toml \\
      --calibration calibration.json
  vantage calibrate part points.json --cell calibrated.toml
  vantage calibrate brightness sweep.json --out exposure.toml

Exit codes: 0 success; 1 system error; 2 bad input; 3 the calibration no longer holds (`check`), or too few poses are \
reachable (`poses`).")]
pub struct CalibrateArgs {
    #[command(subcommand)]
    command: CalibrateCommand,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum CalibrateCommand {
    Brightness(brightness::CalibrateBrightnessArgs),
    Cell(cell::CalibrateCellArgs),
    Check(check::CalibrateCheckArgs),
    Poses(poses::PosesArgs),
    Part(part::CalibratePartArgs),
    Scanner(Box<scanner::CalibrateScannerArgs>),
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &CalibrateArgs) -> Result<(), CliError> {
    match &args.command {
        CalibrateCommand::Brightness(args) => brightness::run(args),
        CalibrateCommand::Cell(args) => cell::run(args),
        CalibrateCommand::Check(args) => check::run(args),
        CalibrateCommand::Poses(args) => poses::run(args),
        CalibrateCommand::Part(args) => part::run(args),
        CalibrateCommand::Scanner(args) => scanner::run(args),
    }
}

/// Conventions of files that other programs wrote.
#[derive(Clone, Copy, Debug, clap::Args)]
struct ReadArgs {
    /// Mounting of the scanner, for files that do not state it: eye_in_hand (on the flange) or eye_to_hand (fixed in the cell).
    #[arg(long, default_value = "eye_in_hand", value_parser = setup)]
    setup: HandEyeSetup,
    /// Convention for the rotation of the flange in CSV files: urscript, kuka_abc, abb_quat, fanuc_wpr, staubli, hans_rpy or
    /// quaternion.
    #[arg(long, value_name = "KIND", default_value = "quaternion", value_parser = robot_pose)]
    robot_pose: RobotPoseKind,
    /// Unit of lengths in CSV files: mm, cm, m or inch.
    #[arg(long, default_value = "mm")]
    unit: crate::geometry::LengthUnit,
}

fn setup(text: &str) -> Result<HandEyeSetup, String> {
    one_of(text, &HandEyeSetup::ALL, HandEyeSetup::as_str)
}

fn robot_pose(text: &str) -> Result<RobotPoseKind, String> {
    one_of(text, &RobotPoseKind::ALL, RobotPoseKind::as_str)
}

/// Value of a closed list by its name.
fn one_of<T: Copy>(text: &str, all: &[T], name: impl Fn(T) -> &'static str) -> Result<T, String> {
    let found = all.iter().copied().find(|value| name(*value) == text);
    found.ok_or_else(|| format!("use one of {}", all.iter().map(|value| name(*value)).collect::<Vec<_>>().join(", ")))
}

/// Observations of a folder of pairs of matrices, with the SHA-256 of all their bytes in order.
fn folder_of_poses(folder: &Path, read: &ReadArgs) -> Result<(CalibrationData, String), CliError> {
    let shown = folder.display().to_string();
    let refuse = |error: String| CliError::BadInput(format!("{shown}: {error}"));
    let entries = std::fs::read_dir(folder).map_err(|error| refuse(error.to_string()))?;
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut numbers: Vec<String> =
        names.filter_map(|name| Some(name.strip_prefix("pos")?.strip_suffix(".yaml")?.to_owned())).collect();
    numbers.sort();
    let (mut files, mut hasher) = (Vec::new(), Sha256::new());
    for number in numbers {
        let mut text = |side: &str| {
            let path = folder.join(format!("{side}{number}.yaml"));
            let length = std::fs::metadata(&path).map_err(|error| refuse(format!("{}: {error}", path.display())))?.len();
            if length > MAX_BYTES {
                return Err(refuse(format!("{} has {length} bytes; allowed are {MAX_BYTES}", path.display())));
            }
            let text = std::fs::read_to_string(&path).map_err(|error| refuse(format!("{}: {error}", path.display())))?;
            hasher.update(&text);
            Ok(text)
        };
        let texts = [text("pos")?, text("board")?];
        files.push((number, texts));
    }
    let data = from_zivid(&files, read.setup).map_err(|errors| files::findings(&shown, &errors))?;
    Ok((data, hex(&hasher.finalize())))
}

/// Observations of a file, with the SHA-256 of its bytes: tables by its name, pairs of poses by a list, else our own shape.
fn observations(path: &Path, read: &ReadArgs) -> Result<(CalibrationData, String), CliError> {
    if path.is_dir() {
        return folder_of_poses(path, read);
    }
    let shown = path.display().to_string();
    let refuse = |error: String| CliError::BadInput(format!("{shown}: {error}"));
    let length = std::fs::metadata(path).map_err(|error| files::unreadable(path, &error))?.len();
    if length > MAX_BYTES {
        return Err(refuse(format!("has {length} bytes; allowed are {MAX_BYTES}")));
    }
    let bytes = std::fs::read(path).map_err(|error| files::unreadable(path, &error))?;
    let digest = hex(&Sha256::digest(&bytes));
    let below = |errors: Vec<FieldError>| files::findings(&shown, &errors);
    if path.extension().is_some_and(|extension| ["csv", "tsv"].iter().any(|known| extension.eq_ignore_ascii_case(known))) {
        let text = String::from_utf8(bytes).map_err(|error| refuse(files::other_encoding(error.as_bytes())))?;
        let unit_mm = read.unit.mm();
        let options = CsvOptions { robot_pose: read.robot_pose, unit_mm, setup: read.setup };
        let data = from_csv(&text, &options).map_err(below)?;
        let left_out = rows_without_board(&text, &data);
        if left_out > 0 {
            let detail = format!("rows without a board, left out: {left_out}; rows read: {}", data.observations.len());
            output::warning(&shown, "", &detail, "give board_x, board_y and board_z, or delete these rows");
        }
        return Ok((data, digest));
    }
    if path.extension().is_some_and(|extension| ["yaml", "yml", "samples"].iter().any(|known| extension == *known)) {
        let text = String::from_utf8(bytes).map_err(|error| refuse(files::other_encoding(error.as_bytes())))?;
        return Ok((from_easy_handeye(&text, read.setup).map_err(below)?, digest));
    }
    let value: Value = if bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'[') {
        serde_json::from_slice(&bytes).map(|Distinct(value)| value).map_err(|error| refuse(json_error(&bytes, &error)))?
    } else {
        files::value(path).map_err(|error| CliError::BadInput(format!("{error}; {READ}")))?
    };
    let data = if value.is_array() {
        from_pose_samples(&value, read.setup).map_err(below)?
    } else {
        files::of_kind(value, ("observations of a board", None), &shown)?
    };
    Ok((data, digest))
}

/// Writes a cell to a file, below `head`.
fn write_cell(path: &Path, spec: &CellSpec, head: &str) -> Result<(), CliError> {
    let toml = output::toml(&spec_paths::named_for(spec, path)?)?;
    files::write(path, format!("{head}{toml}").as_bytes())
}

/// SHA-256 of a document as a file has it.
fn digest_of(document: &impl Serialize) -> String {
    hex(&Sha256::digest(json_file_bytes(document)))
}

/// A figure with its standard deviation: ± would be read as an interval of k = 2.
fn with_sd(figure: &str, sd: &str) -> String {
    format!("{figure} (standard deviation {sd})")
}

/// Coordinates with so many decimals.
fn coordinates(values: [f64; 3], decimals: usize) -> String {
    values.map(|value| fixed(value, decimals)).join(" ")
}

/// Error that lists findings, each with its code.
fn refused(path: &Path, findings: &[CalibrationFinding]) -> CliError {
    let finding = |finding: &CalibrationFinding| FileFinding {
        file: path.display().to_string(),
        pointer: String::new(),
        detail: format!("{}: {}", finding.code.as_str(), sentence(finding)),
    };
    CliError::Findings(findings.iter().map(finding).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{BodySpec, Named, PoseSpec, ShapeSpec, SpecKind, SpecLibrary, preset_text};
    use crate::cli::files::FileLibrary;
    use crate::geometry::LengthUnit;

    /// Whole paths were written to it, so that the folder could be used in its own place alone.
    #[test]
    fn a_cell_that_is_written_beside_what_it_names_can_be_moved_with_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name).display().to_string();
        std::fs::create_dir(path("cells")).expect("a folder");
        std::fs::write(path("cells/arm.toml"), preset_text(SpecKind::Robot, "hans-e05").expect("a preset")).expect("a file");
        std::fs::write(path("cells/post.stl"), "").expect("a file");
        let text = preset_text(SpecKind::Cell, "e05-transcan").expect("a preset").replace("\"hans-e05\"", "\"arm.toml\"");
        std::fs::write(path("cells/mine.toml"), text).expect("a file");
        let (mut spec, _) = files::cell(&path("cells/mine.toml")).expect("a cell");
        let post = ShapeSpec::Mesh { mesh: path("cells/post.stl") };
        spec.obstacles.push(BodySpec { name: "post".to_owned(), owner_from_body: PoseSpec::default(), shape: post });
        spec.scanner.inline(|name| FileLibrary.scanner(name).ok());
        write_cell(Path::new(&path("cells/calibrated.toml")), &spec, "# Head.\n").expect("a file");
        std::fs::rename(path("cells"), path("moved")).expect("moved");
        let (moved, _) = files::cell(&path("moved/calibrated.toml")).expect("a cell");
        assert_eq!(moved.robot, Named::Name(path("moved/arm.toml")));
        assert_eq!(moved.turntable, Named::Name("minas-a6-500".to_owned()), "a preset");
        let shapes: Vec<&ShapeSpec> = moved.obstacles.iter().map(|body| &body.shape).collect();
        assert!(shapes.contains(&&ShapeSpec::Mesh { mesh: path("moved/post.stl") }), "{shapes:?}");
        assert!(moved.flange_from_scanner == spec.flange_from_scanner && moved.scanner == spec.scanner, "the rest is as it was");
    }

    /// A cell was told every field that observations have and it lacks, and every field of its own.
    #[test]
    fn a_cell_in_the_place_of_observations_is_told_to_be_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cell.toml");
        std::fs::write(&path, preset_text(SpecKind::Cell, "e05-transcan").expect("a preset")).expect("a file");
        let read =
            ReadArgs { setup: HandEyeSetup::EyeInHand, robot_pose: RobotPoseKind::Quaternion, unit: LengthUnit::Millimetre };
        let told = observations(&path, &read).map(drop).expect_err("no observations").to_string();
        assert!(told.ends_with("cell.toml: is a cell, not observations of a board; --cell takes it"), "{told}");
    }

    /// A table of tabs was read as TOML by its name, and refused.
    #[test]
    fn a_table_is_read_by_either_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let read =
            ReadArgs { setup: HandEyeSetup::EyeInHand, robot_pose: RobotPoseKind::Quaternion, unit: LengthUnit::Millimetre };
        for (name, separator) in [("poses.csv", ","), ("poses.tsv", "\t"), ("poses.TSV", "\t")] {
            let path = folder.path().join(name);
            std::fs::write(&path, "id,board_x,board_y,board_z\na,4,5,6\n".replace(',', separator)).expect("a file");
            let (data, _) = observations(&path, &read).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(data.observations[0].id, "a", "{name}");
        }
    }
}
