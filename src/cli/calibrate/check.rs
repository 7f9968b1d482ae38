//! `vantage calibrate check`: a few observations of the board where it stood tell whether the calibration still holds.

use std::path::PathBuf;

use serde_json::Value;

use super::{ReadArgs, digest_of, observations, refused};
use crate::cell::calibration::check::{Check, CheckLimits, CheckVerdict};
use crate::cell::calibration::findings::Severity;
use crate::cell::{CalibrationProvenance, CellSpec};
use crate::cli::files::{self, FileLibrary};
use crate::cli::plan::now;
use crate::cli::{CliError, output};
use crate::wire::calibration::{CalibrationCheckDocument, CalibrationDocument};
use crate::wire::json_file_bytes;

/// Check before use that a calibration still holds: ok, compensate or recalibrate.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct CalibrateCheckArgs {
    /// Observations of the board where the calibration saw it, four or more, one of them from the zenith.
    data: PathBuf,
    /// Calibration to check.
    #[arg(long, value_name = "FILE.json")]
    calibration: PathBuf,
    /// Cell that was observed: name of a preset, or a TOML or JSON file.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Rate of false alarms, 0.0001 to 0.2.
    #[arg(long, value_name = "RATE", default_value_t = 0.01)]
    false_alarm: f64,
    /// JSON file to write the check to, with the compensation if there is one.
    #[arg(long)]
    out: Option<PathBuf>,
    /// TOML file to write the compensated cell to; only with the verdict compensate.
    #[arg(long, value_name = "FILE.toml")]
    write_cell: Option<PathBuf>,
    #[command(flatten)]
    read: ReadArgs,
}

/// Checks.
pub(super) fn run(args: &CalibrateCheckArgs) -> Result<(), CliError> {
    if !(1e-4..=0.2).contains(&args.false_alarm) {
        return Err(CliError::BadInput(format!("--false-alarm: is {}; allowed is 0.0001 to 0.2", args.false_alarm)));
    }
    let (spec, _) = files::cell(&args.cell)?;
    let cell = spec.build(&FileLibrary).map_err(|errors| files::findings(&args.cell, &errors))?;
    let calibration = calibration(&args.calibration)?;
    let (data, digest) = observations(&args.data, &args.read)?;
    let shown = args.data.display().to_string();
    let read = data.read(&cell, calibration.kind).map_err(|errors| files::findings(&shown, &errors))?;
    if read.findings.iter().any(|finding| finding.severity == Severity::Error) {
        return Err(refused(&args.data, &read.findings));
    }
    if read.sightings.len() < 2 {
        return Err(CliError::BadInput(format!("{shown}: {} observations; a check needs 4, at least 2", read.sightings.len())));
    }
    let (calibrated, covariance, weighting) = calibration.estimate();
    let limits = CheckLimits { false_alarm: args.false_alarm, ..CheckLimits::default() };
    let check = Check { sightings: &read.sightings, calibrated, covariance: &covariance, weighting, limits };
    let unfit = || CliError::BadInput(format!("{}: knows no covariance to check by", args.calibration.display()));
    let checked = check.check().ok_or_else(unfit)?;
    let scanner_from_cloud = calibration.scanner_from_cloud.scanner_from_cloud(&cell.scanner.devices);
    let taken_at = data.taken_at.as_ref().map_or_else(now, ToString::to_string);
    let mut document = CalibrationCheckDocument::new(
        &checked,
        &limits,
        &calibration,
        &scanner_from_cloud,
        [&digest, &taken_at],
        data.temperature_c,
    );
    document.id = digest_of(&document);
    if let Some(path) = &args.out {
        files::write(path, &json_file_bytes(&document))?;
    }
    if let Some(path) = &args.write_cell {
        write_compensated(path, spec, &document)?;
    }
    for finding in &document.findings {
        output::warning(&shown, "", &finding.detail, "calibrate again at this temperature");
    }
    output::result(&document, text(&document))?;
    match document.verdict {
        CheckVerdict::Ok => Ok(()),
        CheckVerdict::Compensate | CheckVerdict::Recalibrate => Err(CliError::NotCalibrated(format!(
            "{}: {}: the scanner is {:.3} mm and {:.4}° off the calibration",
            shown,
            document.verdict.as_str(),
            document.drift_translation_mm,
            document.drift_rotation_deg
        ))),
    }
}

fn calibration(path: &std::path::Path) -> Result<CalibrationDocument, CliError> {
    let shown = path.display().to_string();
    let value: Value = files::value(path)?;
    let document: CalibrationDocument = files::from_value(value, &shown)?;
    document.check().map_err(|errors| files::findings(&shown, &errors))?;
    let expected = digest_of(&CalibrationDocument { id: String::new(), ..document.clone() });
    if expected != document.id {
        return Err(CliError::BadInput(format!("{shown}: /id: the document was changed after it was written")));
    }
    Ok(document)
}

/// Writes the cell with the compensated pose; one of another calibration is refused.
fn write_compensated(path: &std::path::Path, mut spec: CellSpec, document: &CalibrationCheckDocument) -> Result<(), CliError> {
    let Some(compensation) = &document.compensation else {
        return Err(CliError::BadInput(format!("--write-cell: the verdict is {}; nothing to write", document.verdict.as_str())));
    };
    let provenance = spec.calibrated.take().filter(|known| known.calibration_id == document.calibration_id);
    let provenance = provenance
        .ok_or_else(|| CliError::BadInput("--write-cell: the cell does not have its poses from this calibration".to_owned()))?;
    spec.flange_from_scanner = compensation.flange_from_scanner;
    spec.calibrated = Some(CalibrationProvenance { compensation_sha256: Some(document.id.clone()), ..provenance });
    spec.build(&FileLibrary).map_err(|errors| files::findings("--write-cell", &errors))?;
    let toml = toml::to_string_pretty(&spec).map_err(|error| CliError::Failed(error.to_string()))?;
    files::write(path, format!("# By `vantage calibrate check`: flange_from_scanner as compensated.\n\n{toml}").as_bytes())
}

fn text(document: &CalibrationCheckDocument) -> String {
    format!(
        "{}: statistic {:.1}, threshold {:.1} at {} false alarms; off by {:.3} mm and {:.4}°\n",
        document.verdict.as_str(),
        document.statistic,
        document.threshold,
        document.false_alarm,
        document.drift_translation_mm,
        document.drift_rotation_deg
    )
}
