//! `vantage calibrate cell`: scanner on the flange and axis of the table from observations.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::{ReadArgs, coordinates, observations, one_of, refused, with_sd};
use crate::cell::calibration::data::{SigmaSource, Solve};
use crate::cell::calibration::findings::{FindingCode, Severity};
use crate::cell::calibration::observability::Freedom;
use crate::cell::calibration::refine::MAX_ITERATIONS;
use crate::cell::{Cell, CellSpec};
use crate::cli::check::warn;
use crate::cli::files::{self, FileLibrary};
use crate::cli::plan::now;
use crate::cli::ranges::whole;
use crate::cli::{CliError, output};
use crate::report::calibration::calibration_html;
use crate::wire::calibration::{
    BoardScaleDocument, CalibrationDocument, CalibrationError, FindingDocument, PlateFaceDocument, WeakestDocument,
};
use crate::wire::json_file_bytes;
use crate::wire::words::fixed;

/// Solve for the scanner's pose on the flange and the turntable axis, with the uncertainty of the result.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  vantage calibrate cell data.json --cell my-cell.toml --hold-out 2 \\
      --out calibration.json --write-cell calibrated.toml

A CSV or TSV file has one row per pose, with these columns: id; j1_deg to j6_deg; table_angle_deg; flange_x, flange_y, flange_z \
with flange_r1 to flange_r3 or flange_r4 in the controller's convention (--robot-pose); board_x, board_y, board_z with board_qx, \
board_qy, board_qz, board_qw. Either the joints or the flange may be left out.")]
pub(super) struct CalibrateCellArgs {
    /// Observations of the board: JSON or TOML of schema vantage.calibration_data/1, CSV or TSV, or files of MoveIt,
    /// easy_handeye2 or Zivid.
    data: PathBuf,
    /// Cell in which the board was observed: a preset name, or a TOML or JSON file.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Unknowns to solve for: hand_eye (the board stands still), table (the scanner is known) or joint (the board turns with
    /// the plate).
    #[arg(long, default_value = "joint", value_parser = solve)]
    solve: Solve,
    /// Number of observations, from the end of the data, to hold out and predict as a test, 0 to 1000.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole::<u16>(0..=1000))]
    hold_out: u16,
    /// JSON file to write the calibration to [default: standard output with --json].
    #[arg(long)]
    out: Option<PathBuf>,
    /// TOML file to write the cell to, with the calibrated poses and their source.
    #[arg(long, value_name = "FILE.toml")]
    write_cell: Option<PathBuf>,
    /// HTML report to write.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    read: ReadArgs,
}

fn solve(text: &str) -> Result<Solve, String> {
    one_of(text, &Solve::ALL, Solve::as_str)
}

/// Calibrates.
pub(super) fn run(args: &CalibrateCellArgs) -> Result<(), CliError> {
    let (spec, _) = files::cell(&args.cell)?;
    let cell = spec.build(&FileLibrary).map_err(|errors| files::findings(&args.cell, &errors))?;
    let (data, digest) = observations(&args.data, &args.read)?;
    let shown = args.data.display().to_string();
    let how = (args.solve, usize::from(args.hold_out));
    let solved = CalibrationDocument::solved(&data, &cell, how, [&digest, &now()]);
    let document = solved.map_err(|error| match error {
        CalibrationError::Fields(errors) => files::findings(&shown, &errors),
        CalibrationError::Findings(findings) => refused(&args.data, &findings),
        CalibrationError::Cancelled => CliError::Failed("cancelled".to_owned()),
    })?;
    if let Some(path) = &args.out {
        files::write(path, &json_file_bytes(&document))?;
    }
    if let Some(path) = &args.report {
        files::write(path, calibration_html(&document).as_bytes())?;
    }
    let far = document.far_from(&spec);
    if let Some(path) = &args.write_cell {
        write_cell(path, spec, &document)?;
    }
    for finding in &document.findings {
        output::warning(&shown, "", &format!("{}: {}", finding.code.as_str(), finding.detail), remedy(finding));
    }
    warn(&args.cell, &far);
    output::result(&document, text(&document, &cell))
}

fn remedy(finding: &FindingDocument) -> &'static str {
    match finding.severity {
        Severity::Error => "the calibration cannot be used",
        Severity::Warning if finding.code == FindingCode::BoardScale => "measure the board",
        Severity::Warning if finding.code == FindingCode::BoardScaleNotConverged => {
            "measure the board, and take more observations"
        }
        Severity::Warning if finding.observations.is_empty() => "take more observations",
        Severity::Warning => "check the observations named, and repeat them",
        Severity::Note => "for your information",
    }
}

/// Writes the cell with the calibrated poses.
fn write_cell(path: &Path, mut spec: CellSpec, document: &CalibrationDocument) -> Result<(), CliError> {
    if !document.turntable_runout.is_empty() {
        // The runout goes into the turntable's specification, which has to stand in the cell for that.
        spec.inline_devices(&FileLibrary);
    }
    let not_on_flange = "--write-cell: needs the scanner on the flange; in these data it is fixed in the cell";
    let spec = document.calibrated(spec).ok_or_else(|| CliError::BadInput(not_on_flange.into()))?;
    spec.build(&FileLibrary).map_err(|errors| files::findings("--write-cell", &errors))?;
    let head = "# By `vantage calibrate cell`: flange_from_scanner and base_from_table as calibrated, the rest as it was.\n\
                # A section [controllers] is not copied.\n\n";
    super::write_cell(path, &spec, head)
}

/// Summary for people.
fn text(document: &CalibrationDocument, cell: &Cell) -> String {
    let spread = &document.summary.spread;
    let [given, used, held_out, dropped] = document.observation_counts();
    let mut text = format!("cell {}: {given} observations, {used} used, {held_out} held out, {dropped} dropped\n", cell.name);
    let mut line = |label: &str, value: String| {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  {label:<22} {value}");
    };
    if let Some(is_converged) = document.converged {
        line("adjustment", convergence_text(is_converged));
    }
    line("flange from scanner", format!("{} mm", coordinates(document.flange_from_scanner.translation_mm, 3)));
    if let Some(table) = &document.base_from_table {
        line("base from table", format!("{} mm", coordinates(table.translation_mm, 3)));
    }
    if let Some(face) = &document.plate_face {
        line("face of the plate", face_text(face));
    }
    line(
        "residuals",
        format!(
            "rms {:.3} mm, {:.4}°; worst {:.3} mm, {:.4}°",
            spread.rms_translation_mm, spread.rms_rotation_deg, spread.max_translation_mm, spread.max_rotation_deg
        ),
    );
    let left_out = &document.leave_one_out.spread;
    let is_predicted = document.residuals.iter().any(|each| each.predicted_translation_mm.is_some());
    let predicted = format!("rms {:.3} mm, {:.4}°", left_out.rms_translation_mm, left_out.rms_rotation_deg);
    line("predicted by the rest", if is_predicted { predicted } else { "too few observations".to_owned() });
    if let Some(held_out) = &document.held_out {
        line("held out", format!("rms {:.3} mm, {:.4}°", held_out.rms_translation_mm, held_out.rms_rotation_deg));
    }
    line("a scanned point", format!("standard deviation {:.3} mm at best focus", document.point_at_best_focus_sd_mm));
    if let Some(weakest) = &document.observability.weakest {
        line("least certain", weakest_text(weakest));
    }
    if let Some(scale) = &document.board_scale {
        line("lengths to the board", board_scale_text(scale));
    }
    let sigma = &document.sigma;
    let (arm, board) = (source_words(document.arm_sigma_source), source_words(document.board_sigma_source));
    line("arm", format!("{:.4}°, {:.3} mm for each axis, {arm}", sigma.robot_deg, sigma.robot_mm));
    line("board", format!("{:.4}°, {:.3} mm for each axis, {board}", sigma.board_deg, sigma.board_mm));
    text
}

/// Convergence of the adjustment, and what to do without it.
fn convergence_text(is_converged: bool) -> String {
    if is_converged {
        return "converged".to_owned();
    }
    format!(
        "not converged after {MAX_ITERATIONS} iterations: do not use the result; add observations with other rotations of the \
         arm, and check the nominal cell"
    )
}

/// Scale of the lengths to the board, and what it leaves open.
fn board_scale_text(scale: &BoardScaleDocument) -> String {
    let sd = format!("{:.5}, {:.3} mm along the view", scale.sd, scale.shift_sd_mm);
    let convergence = match (scale.converged, scale.rounds) {
        (Some(true), _) => "; converged".to_owned(),
        (Some(false), Some(rounds)) => {
            format!("; not converged after {rounds} rounds: it says nothing about the size of the board")
        }
        (Some(false), None) => "; not converged: it says nothing about the size of the board".to_owned(),
        (None, _) => String::new(),
    };
    with_sd(&format!("{:.5} of the lengths that the arm's motions imply", scale.ratio), &sd) + &convergence
}

/// Source of standard deviations, in words.
fn source_words(source: Option<SigmaSource>) -> &'static str {
    match source {
        Some(SigmaSource::Given) => "as given",
        Some(SigmaSource::Enlarged) => "as given, enlarged to match the residuals",
        Some(SigmaSource::Assumed) => "assumed: too few observations to estimate them",
        Some(SigmaSource::Estimated) => "estimated from the residuals",
        Some(SigmaSource::Unused) => "not used: points of the boards give their own",
        None => "source not stated",
    }
}

/// Height of the plate's face.
fn face_text(face: &PlateFaceDocument) -> String {
    with_sd(&format!("{} mm above the nominal table", fixed(face.height_mm, 3)), &format!("{:.3} mm", face.height_sd_mm))
}

/// Direction that is known least.
fn weakest_text(weakest: &WeakestDocument) -> String {
    let by_mm = || format!("{:.3} mm", weakest.sd_mm.unwrap_or(f64::NAN));
    let sd = weakest.sd_deg.map_or_else(by_mm, |sd_deg| format!("{sd_deg:.4}°"));
    let freedom = match weakest.freedom {
        Freedom::Turn => "turn about",
        Freedom::Shift => "shift along",
    };
    with_sd(&format!("{freedom} ({}) of the cloud", coordinates(weakest.axis, 2)), &sd)
}

#[cfg(test)]
pub(super) mod tests {
    use serde_json::json;

    use super::*;
    use crate::cell::{Presets, SpecLibrary};

    /// ± was told of one standard deviation.
    #[test]
    fn an_uncertainty_says_that_it_is_a_standard_deviation() {
        let face = PlateFaceDocument { height_mm: -0.000_2, height_sd_mm: 0.004, tilt_deg: 0.0, rms_mm: 0.01 };
        assert_eq!(face_text(&face), "0.000 mm above the nominal table (standard deviation 0.004 mm)");
        let shift = WeakestDocument { freedom: Freedom::Shift, axis: [-0.001, 0.6, 0.8], sd_deg: None, sd_mm: Some(0.012) };
        assert_eq!(weakest_text(&shift), "shift along (0.00 0.60 0.80) of the cloud (standard deviation 0.012 mm)");
        let turn = WeakestDocument { freedom: Freedom::Turn, sd_deg: Some(0.001_2), sd_mm: None, ..shift };
        assert_eq!(weakest_text(&turn), "turn about (0.00 0.60 0.80) of the cloud (standard deviation 0.0012°)");
        let scale =
            BoardScaleDocument { ratio: 1.002, sd: 0.000_8, shift_mm: 0.96, shift_sd_mm: 0.384, converged: None, rounds: None };
        let told = "1.00200 of the lengths that the arm's motions imply (standard deviation 0.00080, 0.384 mm along the view)";
        assert_eq!(board_scale_text(&scale), told);
        let of = |is_converged: bool| BoardScaleDocument { converged: Some(is_converged), rounds: Some(10), ..scale };
        assert_eq!(board_scale_text(&of(true)), format!("{told}; converged"));
        let open = "; not converged after 10 rounds: it says nothing about the size of the board";
        assert_eq!(board_scale_text(&of(false)), format!("{told}{open}"));
    }

    /// A calibration of twelve observations whose adjustment did not converge.
    pub(in crate::cli::calibrate) fn calibration() -> CalibrationDocument {
        let pose = json!({"translation_mm": [0.0, 0.0, 100.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]});
        let spread = json!({"rms_rotation_deg": 0.0, "rms_translation_mm": 0.0, "max_rotation_deg": 0.0,
            "max_translation_mm": 0.0, "median_rotation_deg": 0.0, "median_translation_mm": 0.0});
        let residual = |index: usize| {
            json!({"id": format!("p{index:02}"), "rotation_deg": 0.0, "translation_mm": 0.0, "shift_mm": [0.0, 0.0, 0.0],
                "whitened": 6.0, "table_angle_deg": 0.0, "used": index < 10, "held_out": index > 10})
        };
        let residuals: Vec<_> = (0..12).map(residual).collect();
        let mut document = json!({"schema": "vantage.calibration/1", "id": "", "kind": "joint", "cell": "mine",
            "setup": "eye_in_hand", "data_sha256": "", "taken_at": "2026-11-20T09:00:00Z", "temperature_c": null,
            "scanner_from_cloud": "scanner", "table_sense": 1.0, "sigma_estimated": false, "converged": false,
            "residuals": residuals, "held_out": spread, "table_runout": [], "point_at_best_focus_sd_mm": 0.1, "findings": []});
        for name in ["flange_from_scanner", "flange_from_cloud", "base_from_table", "plate_from_board"] {
            document[name] = pose.clone();
        }
        document["covariance"] = json!({"order": "", "hand_eye": [], "table": [], "joint": []});
        document["sigma"] = json!({"robot_deg": 0.01, "robot_mm": 0.1, "board_deg": 0.01, "board_mm": 0.05});
        document["summary"] = json!({"used": 10, "dropped": 1, "spread": spread, "variance_factor": 1.0, "chi2_p": 0.5});
        document["leave_one_out"] =
            json!({"spread": spread, "max_hand_eye_rotation_deg": 0.0, "max_hand_eye_translation_mm": 0.0});
        document["observability"] =
            json!({"spread_deg": [0.0, 0.0, 0.0], "weakest": null, "rotation_sd_deg": 0.0, "translation_sd_mm": 0.0});
        serde_json::from_value(document).expect("a document")
    }

    /// Ten of twelve were told to be used, whatever had become of the other two, and nothing of an adjustment without an end.
    #[test]
    fn observations_are_counted_and_an_adjustment_without_an_end_is_told_with_what_to_do() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let document = calibration();
        let told = text(&document, &cell);
        assert!(told.starts_with("cell e05-transcan: 12 observations, 10 used, 1 held out, 1 dropped\n"), "{told}");
        assert!(told.contains("not converged after 60 iterations: do not use the result; add observations"), "{told}");
        let told = text(&CalibrationDocument { converged: Some(true), ..document }, &cell);
        assert!(told.contains("adjustment             converged\n"), "{told}");
    }

    /// Deviations of five observations were told to be estimated, and were those that an estimate begins with.
    #[test]
    fn only_deviations_that_were_estimated_are_told_so() {
        let told: Vec<&str> = SigmaSource::ALL.into_iter().map(|source| source_words(Some(source))).collect();
        assert_eq!(told.iter().filter(|words| words.starts_with("estimated")).count(), 1, "{told:?}");
        assert!(source_words(Some(SigmaSource::Assumed)).starts_with("assumed"));
    }
}
