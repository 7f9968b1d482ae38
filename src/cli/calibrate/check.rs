//! `vantage calibrate check`: a few observations of the board where it stood tell whether the calibration still holds.

use std::path::PathBuf;

use serde_json::Value;

use super::{ReadArgs, digest_of, observations, refused};
use crate::cell::calibration::check::{Check, CheckLimits, CheckVerdict};
use crate::cell::calibration::data::{HandEyeSetup, Sighting};
use crate::cell::calibration::findings::{FindingCode, Severity};
use crate::cell::calibration::table::{harmonics_of, without_runout};
use crate::cell::{Cell, CellSpec, CloudFrameSpec, Findings, PoseSpec};
use crate::check::kind_of;
use crate::cli::files::{self, FileLibrary};
use crate::cli::plan::now;
use crate::cli::ranges::number;
use crate::cli::{CliError, output};
use crate::wire::calibration::{CALIBRATION_SCHEMA, CalibrationCheckDocument, CalibrationData, CalibrationDocument};
use crate::wire::json_file_bytes;
use crate::wire::words::counted;

/// Distance and angle up to which two poses are the same: beyond rounding, and far below what a check finds.
const SAME_MM: f64 = 1e-3;
const SAME_RAD: f64 = 1e-5;

/// Check before use that a calibration still holds; the verdict is ok, compensate or recalibrate.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  vantage calibrate check check.json --cell calibrated.toml \\
      --calibration calibration.json

Exit codes: 0 the calibration holds, 1 system error, 2 bad input, 3 it does not.")]
pub(super) struct CalibrateCheckArgs {
    /// Observations of the board where it stood in the calibration: four or more, one of them from straight above.
    data: PathBuf,
    /// Calibration to check: the JSON file that `vantage calibrate cell` wrote.
    #[arg(long, value_name = "FILE.json")]
    calibration: PathBuf,
    /// Cell in which the board was observed, with the calibration: the file that `vantage calibrate cell --write-cell` wrote.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Accepted rate of false alarms, 0.0001 to 0.2.
    #[arg(long, value_name = "RATE", default_value_t = 0.01, value_parser = number)]
    false_alarm: f64,
    /// Time for which a compensation is valid, hours, 0.01 to 1000000.
    #[arg(long, value_name = "HOURS", default_value_t = 24.0, value_parser = number)]
    max_age: f64,
    /// Largest change of temperature for which a compensation is valid, K, 0.1 to 100.
    #[arg(long, value_name = "K", default_value_t = 5.0, value_parser = number)]
    max_temperature_change: f64,
    /// JSON file to write the check to, with the compensation if there is one.
    #[arg(long)]
    out: Option<PathBuf>,
    /// TOML file to write the compensated cell to; only if the verdict is compensate.
    #[arg(long, value_name = "FILE.toml")]
    write_cell: Option<PathBuf>,
    #[command(flatten)]
    read: ReadArgs,
}

impl CalibrateCheckArgs {
    fn check(&self) -> Result<(), CliError> {
        let numbers = [
            ("--false-alarm", self.false_alarm, 1e-4..=0.2),
            ("--max-age", self.max_age, 0.01..=1e6),
            ("--max-temperature-change", self.max_temperature_change, 0.1..=100.0),
        ];
        numbers.into_iter().try_for_each(|(flag, value, range)| {
            let (low, high) = (range.start(), range.end());
            let refused = || CliError::BadInput(format!("{flag}: is {value}; allowed is {low} to {high}"));
            if range.contains(&value) { Ok(()) } else { Err(refused()) }
        })
    }
}

/// Checks.
pub(super) fn run(args: &CalibrateCheckArgs) -> Result<(), CliError> {
    args.check()?;
    let (spec, _) = files::cell(&args.cell)?;
    let cell = spec.build(&FileLibrary).map_err(|errors| files::findings(&args.cell, &errors))?;
    let calibration = calibration(&args.calibration)?;
    if calibration.cell != cell.name {
        let (of, here) = (&calibration.cell, &cell.name);
        return Err(CliError::BadInput(format!("{}: /cell: is of cell {of:?}, not of {here:?}", args.calibration.display())));
    }
    carries(&spec, &calibration, &args.cell)?;
    let (data, digest) = observations(&args.data, &args.read)?;
    let shown = args.data.display().to_string();
    seen_alike(&data, &cell, calibration.setup, &calibration.scanner_from_cloud)
        .map_err(|detail| CliError::BadInput(format!("{shown}: {detail}")))?;
    let read = data.read(&cell, calibration.kind).map_err(|errors| files::findings(&shown, &errors))?;
    if read.findings.iter().any(|finding| finding.severity == Severity::Error) {
        return Err(refused(&args.data, &read.findings));
    }
    if read.sightings.len() < 2 {
        return Err(CliError::BadInput(format!(
            "{shown}: has {}; a check needs at least 2, and 4 or more to be reliable",
            counted(read.sightings.len(), "observation")
        )));
    }
    let (calibrated, covariance, weighting) = calibration.estimate();
    // The calibration's own: the cell may be the one from before it, or have another by now.
    let runout = harmonics_of(&calibration.turntable_runout);
    let beside = |each: &Sighting| without_runout(&calibrated.base_from_table, &runout, calibrated.scale, each);
    let sightings: Vec<Sighting> = read.sightings.iter().map(beside).collect();
    let limits = CheckLimits { false_alarm: args.false_alarm, ..CheckLimits::default() };
    let sigma_freedom = calibration.sigma_freedom();
    let check = Check { sightings: &sightings, calibrated, covariance: &covariance, weighting, sigma_freedom, limits };
    let unfit = || CliError::BadInput(format!("{}: has no covariance to check with", args.calibration.display()));
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
    if let Some(compensation) = &mut document.compensation {
        (compensation.max_age_hours, compensation.max_temperature_change_k) = (args.max_age, args.max_temperature_change);
    }
    document.id = digest_of(&document);
    if let Some(path) = &args.out {
        files::write(path, &json_file_bytes(&document))?;
    }
    if let Some(path) = &args.write_cell {
        write_compensated(path, spec, &document)?;
    }
    for finding in &document.findings {
        output::warning(&shown, "", &finding.detail, remedy_of(finding.code));
    }
    output::result(&document, text(&document))?;
    verdict(&document, &shown)
}

/// Advice on a finding.
fn remedy_of(code: FindingCode) -> &'static str {
    if code == FindingCode::NotConverged {
        "observe the board again, from more places; if that does not help, calibrate again"
    } else {
        "calibrate again at this temperature"
    }
}

/// Requires a cell that carries the calibration: of another one a verdict would say nothing, and be taken for its own.
fn carries(spec: &CellSpec, calibration: &CalibrationDocument, shown: &str) -> Result<(), CliError> {
    let mut findings = Findings::default();
    for (pointer, detail) in off_calibration(spec, calibration) {
        findings.push(pointer, detail);
    }
    findings.into_result().map_err(|errors| files::findings(shown, &errors))
}

/// Poses of a cell that are not those of the calibration, nor as a check has compensated them: by JSON pointer, with how far they are
/// off. The check is of the calibration, and says nothing of a cell that does not carry it.
fn off_calibration(spec: &CellSpec, calibration: &CalibrationDocument) -> Vec<(&'static str, String)> {
    if calibration.setup == HandEyeSetup::EyeToHand {
        // The scanner is not on the flange, where the cell has it.
        return Vec::new();
    }
    let in_force = spec.calibrated.as_ref().filter(|known| known.calibration_id == calibration.id);
    let compensation = in_force.and_then(|known| known.compensation.as_ref());
    let scanner = compensation.map_or(&calibration.flange_from_scanner, |known| &known.flange_from_scanner);
    let apart = |pointer: &'static str, calibrated: &PoseSpec, own: &PoseSpec| {
        let off = calibrated.pose::<(), ()>().inverse() * own.pose::<(), ()>();
        let (mm, rad) = (off.isometry().translation.vector.norm(), off.isometry().rotation.angle());
        let deg = rad.to_degrees();
        let detail = || {
            format!(
                "is {mm:.3} mm and {deg:.4}° off that of the calibration, of which alone the check tells: give the cell that `vantage \
                 calibrate cell --write-cell` wrote, or calibrate this one"
            )
        };
        (mm > SAME_MM || rad > SAME_RAD).then(|| (pointer, detail()))
    };
    let table = calibration.base_from_table.as_ref();
    let of_table = table.and_then(|table| apart("/base_from_table", table, &spec.base_from_table));
    apart("/flange_from_scanner", scanner, &spec.flange_from_scanner).into_iter().chain(of_table).collect()
}

/// Requires observations that were made as those of the calibration: another mounting, or another frame of the clouds, would be
/// taken for a scanner that drifted.
fn seen_alike(data: &CalibrationData, cell: &Cell, setup: HandEyeSetup, frame: &CloudFrameSpec) -> Result<(), String> {
    if data.setup != setup {
        return Err(format!(
            "/setup: is {}; the calibration was made with {}: give the same, with --setup for files that do not state it",
            data.setup.as_str(),
            setup.as_str()
        ));
    }
    let devices = &cell.scanner.devices;
    let (here, then) = (data.cloud_frame(cell).scanner_from_cloud(devices), frame.scanner_from_cloud(devices));
    let apart = here.isometry().inv_mul(then.isometry());
    let (shift_mm, turn_rad) = (apart.translation.vector.norm(), apart.rotation.angle());
    if shift_mm > SAME_MM || turn_rad > SAME_RAD {
        return Err(format!(
            "/cloud_frame: is {shift_mm:.3} mm and {:.3}° from that of the calibration; give the same frame in the data or in the \
             scanner's specification",
            turn_rad.to_degrees()
        ));
    }
    Ok(())
}

/// Returns true if the search of the check converged; without that its drift is not to be relied on.
fn is_converged(document: &CalibrationCheckDocument) -> bool {
    document.findings.iter().all(|finding| finding.code != FindingCode::NotConverged)
}

/// Success of the command: any verdict but ok is an exit code of its own.
fn verdict(document: &CalibrationCheckDocument, shown: &str) -> Result<(), CliError> {
    match document.verdict {
        CheckVerdict::Ok => Ok(()),
        CheckVerdict::Compensate | CheckVerdict::Recalibrate if !is_converged(document) => Err(CliError::NotCalibrated(format!(
            "{shown}: {}: the search for the drift did not converge, so that the drift is not known",
            document.verdict.as_str()
        ))),
        CheckVerdict::Compensate | CheckVerdict::Recalibrate => Err(CliError::NotCalibrated(format!(
            "{shown}: {}: the scanner is {:.3} mm and {:.4}° off the calibration",
            document.verdict.as_str(),
            document.drift_translation_mm,
            document.drift_rotation_deg
        ))),
    }
}

fn calibration(path: &std::path::Path) -> Result<CalibrationDocument, CliError> {
    let shown = path.display().to_string();
    let value: Value = files::value(path)?;
    let schema = value.get("schema").and_then(Value::as_str).filter(|_| kind_of(&value).is_none());
    if let Some(schema) = schema.filter(|schema| *schema != CALIBRATION_SCHEMA) {
        return Err(CliError::BadInput(format!(
            "{shown}: /schema: is {schema:?}; give the calibration that `vantage calibrate cell --out` wrote, {CALIBRATION_SCHEMA:?}"
        )));
    }
    let document: CalibrationDocument = files::of_kind(value, ("a calibration", None), &shown)?;
    document.check().map_err(|errors| files::findings(&shown, &errors))?;
    let expected = digest_of(&CalibrationDocument { id: String::new(), ..document.clone() });
    if expected != document.id {
        return Err(CliError::BadInput(format!("{shown}: /id: the document was changed after it was written")));
    }
    Ok(document)
}

/// Writes the cell with the compensated pose; one of another calibration is refused. With another verdict nothing is written, and
/// the verdict decides how the command ends.
fn write_compensated(path: &std::path::Path, mut spec: CellSpec, document: &CalibrationCheckDocument) -> Result<(), CliError> {
    let Some(compensation) = &document.compensation else {
        output::note(format_args!("{} is not written: the verdict is {}", path.display(), document.verdict.as_str()));
        return Ok(());
    };
    let provenance = spec.calibrated.take().filter(|known| known.calibration_id == document.calibration_id);
    let provenance = provenance
        .ok_or_else(|| CliError::BadInput("--write-cell: the cell's poses are not from this calibration".to_owned()))?;
    spec.flange_from_scanner = compensation.flange_from_scanner;
    spec.calibrated = document.in_force(provenance);
    spec.build(&FileLibrary).map_err(|errors| files::findings("--write-cell", &errors))?;
    super::write_cell(path, &spec, "# By `vantage calibrate check`: flange_from_scanner as compensated.\n\n")
}

fn text(document: &CalibrationCheckDocument) -> String {
    let unfinished = if is_converged(document) { "" } else { "; the search did not converge: do not rely on these figures" };
    format!(
        "{}: statistic {:.1}, threshold {:.1} at a false-alarm rate of {}; off by {:.3} mm and {:.4}°{unfinished}\n",
        document.verdict.as_str(),
        document.statistic,
        document.threshold,
        document.false_alarm,
        document.drift_translation_mm,
        document.drift_rotation_deg
    )
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::cell::calibration::findings::CalibrationFinding;
    use crate::cell::{CloudFrame, Presets, SpecLibrary};
    use crate::wire::calibration::FindingDocument;

    fn spec() -> CellSpec {
        Presets.cell("e05-transcan").expect("a preset")
    }

    /// The verdict of such a check was ok, with exit code 0, beside warnings that it said nothing of the cell.
    #[test]
    fn a_cell_that_does_not_carry_the_calibration_is_not_checked() {
        let calibration = crate::cli::calibrate::cell::tests::calibration();
        let calibrated = calibration.calibrated(spec()).expect("on the flange");
        assert!(carries(&calibrated, &calibration, "cell.toml").is_ok());
        let refused = carries(&spec(), &calibration, "cell.toml").expect_err("another cell");
        let told = refused.to_string();
        assert!(refused.exit_code() == 2 && told.contains("/flange_from_scanner") && told.contains("/base_from_table"), "{told}");
    }

    /// Observations in place of the calibration were told to lack 21 fields, and what they are came last.
    #[test]
    fn a_document_of_another_schema_is_told_by_its_schema_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("data.json");
        std::fs::write(&path, r#"{"schema": "vantage.calibration_data/1", "observations": []}"#).expect("a file");
        let told = calibration(&path).expect_err("observations").to_string();
        assert!(told.contains("/schema: is \"vantage.calibration_data/1\"; give the calibration that"), "{told}");
        assert!(!told.contains("missing"), "{told}");
    }

    /// A cell whose poses were 30 mm off those of the calibration was told to be ok.
    #[test]
    fn poses_of_a_cell_that_are_not_those_of_the_calibration_are_told() {
        let calibration = crate::cli::calibrate::cell::tests::calibration();
        let calibrated = calibration.calibrated(spec()).expect("on the flange");
        assert_eq!(off_calibration(&calibrated, &calibration), []);
        let mut moved = calibrated.clone();
        moved.flange_from_scanner.translation_mm[0] += 30.0;
        let told = off_calibration(&moved, &calibration);
        assert!(told.len() == 1 && told[0].0 == "/flange_from_scanner" && told[0].1.starts_with("is 30.000 mm"), "{told:?}");
        let pointers =
            |spec: &CellSpec| off_calibration(spec, &calibration).into_iter().map(|(pointer, _)| pointer).collect::<Vec<_>>();
        assert_eq!(pointers(&spec()), ["/flange_from_scanner", "/base_from_table"], "it is not calibrated");
    }

    /// Such observations were told to be of a scanner that had drifted by hundreds of millimetres.
    #[test]
    fn observations_of_another_mounting_or_frame_are_refused() {
        let cell = spec().build(&Presets).expect("valid");
        let data = |setup: &str, frame: &str| -> CalibrationData {
            serde_json::from_value(json!({
                "schema": "vantage.calibration_data/1", "setup": setup, "cloud_frame": frame, "observations": []
            }))
            .expect("the shape")
        };
        let found = |setup: &str, frame: &str| {
            let calibrated = CloudFrameSpec::Named(CloudFrame::Left);
            seen_alike(&data(setup, frame), &cell, HandEyeSetup::EyeInHand, &calibrated)
        };
        assert_eq!(found("eye_in_hand", "left"), Ok(()));
        let refused = found("eye_to_hand", "left").expect_err("another mounting");
        assert!(refused.starts_with("/setup: is eye_to_hand; the calibration was made with eye_in_hand"), "{refused}");
        let refused = found("eye_in_hand", "scanner").expect_err("another frame");
        assert!(refused.starts_with("/cloud_frame: is ") && refused.contains(" mm and "), "{refused}");
    }

    /// A check whose search did not converge told a drift as if it were known.
    #[test]
    fn a_search_that_did_not_converge_is_told_in_place_of_the_drift() {
        let mut document: CalibrationCheckDocument = serde_json::from_value(json!({
            "schema": "vantage.calibration_check/1", "id": "", "calibration_id": "cd", "cell": "e05-transcan",
            "data_sha256": "ef", "taken_at": "2026-11-20T09:00:00Z", "temperature_c": null, "verdict": "recalibrate",
            "statistic": 40.0, "threshold": 16.8, "false_alarm": 0.01, "p": 0.0, "residual_p": 0.0,
            "drift_rotation_deg": 3.0, "drift_translation_mm": 7.0, "compensation": null, "findings": []
        }))
        .expect("the shape");
        let told = |document: &CalibrationCheckDocument| verdict(document, "check.json").expect_err("recalibrate").to_string();
        assert_eq!(told(&document), "check.json: recalibrate: the scanner is 7.000 mm and 3.0000° off the calibration");
        let line = text(&document);
        assert!(line.ends_with("at a false-alarm rate of 0.01; off by 7.000 mm and 3.0000°\n"), "{line}");
        let finding = CalibrationFinding::new(FindingCode::NotConverged, Severity::Error);
        document.findings.push(FindingDocument::from(&finding));
        assert!(told(&document).contains("recalibrate: the search for the drift did not converge"), "{}", told(&document));
        let line = text(&document);
        assert!(line.ends_with("; the search did not converge: do not rely on these figures\n"), "{line}");
        assert!(remedy_of(FindingCode::NotConverged).starts_with("observe the board again"));
    }

    /// The command ended with exit code 2, bad input, whatever the verdict was, and told no result.
    #[test]
    fn a_cell_that_needs_no_compensation_is_not_written_and_that_is_no_error() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("today.toml");
        let of = |verdict: &str| -> CalibrationCheckDocument {
            serde_json::from_value(json!({
                "schema": "vantage.calibration_check/1", "id": "", "calibration_id": "cd", "cell": "e05-transcan",
                "data_sha256": "ef", "taken_at": "2026-11-20T09:00:00Z", "temperature_c": null, "verdict": verdict,
                "statistic": 4.0, "threshold": 16.8, "false_alarm": 0.01, "p": 0.7, "residual_p": 0.5,
                "drift_rotation_deg": 0.0, "drift_translation_mm": 0.0, "compensation": null, "findings": []
            }))
            .expect("the shape")
        };
        for (name, is_sound) in [("ok", true), ("recalibrate", false)] {
            let document = of(name);
            write_compensated(&path, spec(), &document).expect("nothing to write");
            let code = verdict(&document, "check.json").map_or_else(|error| error.exit_code(), |()| 0);
            assert_eq!(code, if is_sound { 0 } else { 3 }, "{name}");
        }
        assert!(!path.exists());
    }
}
