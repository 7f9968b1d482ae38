//! `vantage sim scanner`: scans of a plan's views, as a real scanner would export them.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use super::out::{FileOrigin, OutputFolder, OutputWriter};
use super::plan::{load_mesh, pool};
use super::ranges::whole;
use super::scanned_part::{RecordArgs, ScannedPartArgs, with_sets};
use super::{CliError, output, params};
use crate::cell::FieldError;
use crate::geometry::LengthUnit;
use crate::inspection::simulated_scanner::SimulationParams;
use crate::planning::context::{Context, Silent};
use crate::service::inspect_job::PlannedViews;
use crate::service::simulate_scans::{SimulatedScans, TRUTH_FILE, scan_file};
use crate::wire::parameters;
use crate::wire::words::counted;

const EXAMPLES: &str = "Examples:
  vantage sim scanner plan --mesh part.stl --unit mm --out scans
  vantage sim scanner plan --mesh part.stl --unit mm --set step_px=8 \\
      --set grazing_deg=[65,80] --set view_error_mm=0.2 --out scans
  vantage compare plan scans --mesh part.stl --unit mm --out inspection

Writes an organised cloud for each view (PLY, mm, scanner frame), and truth.json with the true poses and the fate of every \
pixel. `vantage sim scanner --help` lists the parameters for --set. A simulation does not prove that a real scanner behaves the \
same.";

/// Scan the views of a plan with a simulated scanner.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}{}", params::for_help(&parameters::of_simulated_scans())))]
pub(super) struct SimScannerArgs {
    #[command(flatten)]
    part: ScannedPartArgs,
    #[command(flatten)]
    run: RecordArgs,
    /// Part as it was built, if it differs from the planned one: an STL, OBJ or PLY file in the same coordinates.
    #[arg(long, value_name = "MESH")]
    part_as_built: Option<PathBuf>,
    /// Unit of the part as it was built: mm, cm, m or inch [default: that of the mesh].
    #[arg(long, value_name = "UNIT")]
    as_built_unit: Option<LengthUnit>,
    /// Set one parameter, such as `lobe_deg=4`. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Folder for the scans; created if it does not exist.
    #[arg(long)]
    out: PathBuf,
    /// Number of threads, 0 to 1024; 0 for all cores. The scans do not depend on it.
    #[arg(long, default_value_t = 0, value_parser = whole::<u16>(0..=1024))]
    threads: u16,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub(super) fn run(args: &SimScannerArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let sim = with_sets(&args.sets, check)?;
    let pool = pool(args.threads)?;
    let scanned = pool.install(|| args.part.load(cancel))?;
    let unit = args.as_built_unit.unwrap_or_else(|| args.part.unit());
    let as_built = args.part_as_built.as_deref().map(|path| load_mesh(path, Some(unit), cancel)).transpose()?;
    let as_built = as_built.map(|(read, _)| read.mesh);
    let record = args.run.load()?;
    args.run.check_plan(record.as_ref(), &scanned.plan_sha256)?;
    args.run.warn_of_missing(record.as_ref(), &scanned.plan);
    let planned = PlannedViews::new(&scanned.plan, record.as_ref(), scanned.cell.as_ref());
    let names: Vec<String> = planned.views.iter().map(|view| scan_file(view.viewpoint)).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).chain([TRUTH_FILE]).collect();
    let folder = OutputFolder::prepare(&args.out, OutputWriter::Scans, &names)?;
    let scans = SimulatedScans {
        part: scanned.part(),
        as_built: as_built.as_ref().unwrap_or(&scanned.mesh),
        planned: &planned,
        plan_params: &scanned.plan.params,
        plan_sha256: &scanned.plan_sha256,
        sim: &sim,
    };
    let progress = |done: usize, all: usize| output::note(format_args!("view {done} of {all}"));
    let taken = pool.install(|| scans.files(&progress, &Context::new(cancel, &Silent)));
    let taken = taken.map_err(|_| CliError::Cancelled("interrupted; nothing was written".into()))?;
    folder.replace(&taken, &FileOrigin { plan_sha256: Some(scanned.plan_sha256.clone()), made_from: None })?;
    let written: Vec<&str> = taken.iter().map(|file| file.name.as_ref()).collect();
    let words = format!("{} in {}\n", counted(written.len() - 1, "scan"), folder.path().display());
    output::result(&document(folder.path(), &written), words)
}

/// Checks every range. Pointers of a simulation's check begin with `/sim`, which no option names.
fn check(sim: &SimulationParams) -> Result<(), Vec<FieldError>> {
    let of_option = |error: FieldError| FieldError {
        pointer: error.pointer.strip_prefix("/sim").unwrap_or(&error.pointer).to_owned(),
        detail: error.detail,
    };
    sim.check().map_err(|errors| errors.into_iter().map(of_option).collect())
}

/// The folder and its files, as `--json` prints them. A path that is not UTF-8 is no value of JSON, but its text for people is.
fn document(out: &Path, files: &[&str]) -> serde_json::Value {
    serde_json::json!({ "out": out.display().to_string(), "files": files })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The message named `/sim/step_px`, which nobody had typed.
    #[test]
    fn a_value_out_of_range_is_told_at_the_option_that_gave_it() {
        let sets = ["step_px=0".to_owned()];
        let told = with_sets(&sets, check).map(drop).expect_err("out of range").to_string();
        assert!(told.contains("--set step_px=0") && !told.contains("/sim"), "{told}");
    }

    /// The command ended with a panic once the scans were written, without --json too.
    #[cfg(unix)]
    #[test]
    fn a_folder_whose_name_is_not_utf_8_is_told() {
        use std::os::unix::ffi::OsStrExt as _;
        let out = Path::new(std::ffi::OsStr::from_bytes(b"scans-\xff"));
        assert_eq!(document(out, &["view_000.ply"]), serde_json::json!({ "out": "scans-\u{fffd}", "files": ["view_000.ply"] }));
    }
}
