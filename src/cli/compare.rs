//! `vantage compare`: scans held against the plan of a part.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use super::given_params::named_by_sets;
use super::out::{FileOrigin, OutputFolder, OutputWriter};
use super::plan::{now, pool};
use super::ranges::whole;
use super::scanned_part::{RecordArgs, ScannedPartArgs, read_state, with_sets};
use super::{CliError, FileFinding, files, output, params};
use crate::cell::FieldError;
use crate::geometry::LengthUnit;
use crate::inspection::InspectionParams;
use crate::inspection::ingest::ScanFrame;
use crate::planning::context::{Context, Silent};
use crate::report::inspection_text;
use crate::service::inspect_job::{INSPECTION_FILES, InspectError, InspectJob, ScanSource};
use crate::service::plan_job::plan_sha256 as sha256_of;
use crate::wire::output_record::{OutputRecord, RECORD_FILE};
use crate::wire::parameters;

/// Endings of the names of files that a folder of scans is searched for.
const ENDINGS: [&str; 9] = ["ply", "pcd", "e57", "xyz", "asc", "pts", "csv", "stl", "obj"];

const EXAMPLES: &str = "Examples:
  vantage compare plan scans --mesh part.stl --unit mm --out inspection
  vantage compare plan/plan.json scans/view_*.ply --mesh part.stl --unit mm \\
      --frame scanner --scan-unit mm --set align.method=as_placed \\
      --out inspection

Scans are PLY, PCD, E57, XYZ or STL files: one file per view, with the view's number as the last number in its name, or one file \
for all views. Unit and frame are worked out unless they are given. `vantage compare --help` lists the parameters for --set.

Files written to --out: inspection.html (open this first), inspection.txt, inspection.json, losses.json, learned.json, coverage.csv, \
deviation.csv, deviation.ply, and rescan.json, from which `vantage rescan` plans further views.

Exit codes: 0 success, 1 system error, 2 bad input, 4 interrupted.";

/// Compare scans of a part with its plan: coverage, the cause of every loss, and deviation.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}{}", params::for_help(&parameters::of_inspections())))]
pub struct CompareArgs {
    #[command(flatten)]
    part: ScannedPartArgs,
    #[command(flatten)]
    run: RecordArgs,
    /// Scans to compare: files, or folders of files.
    #[arg(required = true, value_name = "SCANS")]
    scans: Vec<PathBuf>,
    /// Unit of the scans: mm, cm, m or inch [default: worked out from the scans].
    #[arg(long, value_name = "UNIT")]
    scan_unit: Option<LengthUnit>,
    /// Frame of the scans: cloud, scanner, base, table, plate or part [default: worked out from the scans].
    #[arg(long)]
    frame: Option<ScanFrame>,
    /// Set one parameter, such as `compare.tolerance_mm=0.3`. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Inspection of the previous round, to add up both rounds: the folder that `vantage compare` wrote.
    #[arg(long, value_name = "INSPECTION")]
    after: Option<PathBuf>,
    /// Folder for the results; created if it does not exist.
    #[arg(long)]
    out: PathBuf,
    /// Number of threads, 0 to 1024; 0 for all cores. The result does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = whole::<u16>(0..=1024))]
    threads: u16,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &CompareArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let params = with_sets(&args.sets, InspectionParams::check)?;
    let scans = sources(args)?;
    let record = args.run.load()?;
    let before = args.after.as_deref().map(read_state).transpose()?;
    let folder = OutputFolder::prepare(&args.out, OutputWriter::Inspection, &INSPECTION_FILES)?;
    let pool = pool(args.threads)?;
    let scanned = pool.install(|| args.part.load(cancel))?;
    args.run.check_plan(record.as_ref(), &scanned.plan_sha256)?;
    args.run.warn_of_missing(record.as_ref(), &scanned.plan);
    check_plan_of_scans(&scans, &scanned.plan_sha256)?;
    let job = InspectJob { plan: scanned.plan_bytes.clone(), scans, params, record, before, date: Some(now()) };
    let progress = |share: f64| output::note(format_args!("{:3.0} %", 100.0 * share));
    let inspected = pool.install(|| job.inspect(&scanned.part(), &progress, &Context::new(cancel, &Silent)));
    let inspected = inspected.map_err(|error| to_cli_error(error, &args.sets))?;
    folder.replace(&inspected.files, &FileOrigin { plan_sha256: Some(scanned.plan_sha256.clone()), made_from: None })?;
    output::result(&inspected.document, inspection_text(&inspected.document, &scanned.name))
}

/// Error of the command for an error of an inspection: at the option that gave a parameter that does not suit the plan.
fn to_cli_error(error: InspectError, sets: &[String]) -> CliError {
    let finding = |error: &FieldError| {
        let (file, pointer) = match error.pointer.strip_prefix("/params/") {
            Some(key) => ("parameters", format!("/{key}")),
            None => ("the inspection", error.pointer.clone()),
        };
        FileFinding { file: file.to_owned(), pointer, detail: error.detail.clone() }
    };
    match error {
        InspectError::Cancelled => CliError::Cancelled("interrupted; nothing was written".into()),
        InspectError::Refused(errors) => named_by_sets(CliError::Findings(errors.iter().map(finding).collect()), sets),
        InspectError::Damaged(reason) => CliError::BadInput(reason),
    }
}

/// Files of the scans, those of folders sorted by name.
fn sources(args: &CompareArgs) -> Result<Vec<ScanSource>, CliError> {
    let mut paths = Vec::new();
    for path in &args.scans {
        files::require_existing(path)?;
        if path.is_dir() { paths.extend(of_folder(path)?) } else { paths.push(path.clone()) }
    }
    let source = |path: PathBuf| ScanSource {
        name: path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        is_named: true,
        sha256: String::new(),
        view: None,
        unit: args.scan_unit.map(|unit| unit.as_str().to_owned()),
        frame: args.frame,
        path,
    };
    Ok(paths.into_iter().map(source).collect())
}

/// Refuses scans that lie beside a record of Vantage by which they are of another plan. The record does not bind a file that was
/// changed since.
fn check_plan_of_scans(scans: &[ScanSource], plan_sha256: &str) -> Result<(), CliError> {
    for scan in scans {
        let record = std::fs::read(scan.path.with_file_name(RECORD_FILE)).ok();
        let Some(record) = record.and_then(|bytes| OutputRecord::parse(&bytes)) else { continue };
        let mut recorded = record.files.iter().filter(|file| file.name == scan.name);
        let Some((file, other)) = recorded.find_map(|file| Some((file, file.plan_sha256.as_deref()?))) else { continue };
        if other == plan_sha256 {
            continue;
        }
        let bytes = std::fs::read(&scan.path).map_err(|error| files::unreadable(&scan.path, &error))?;
        if sha256_of(&bytes) == file.sha256 {
            return Err(CliError::BadInput(format!(
                "{}: is a scan of another plan: {RECORD_FILE} beside it names the plan with SHA-256 {other}, and the plan given \
                 has {plan_sha256}\n  → give the plan that the scans were taken with, or scan this one with `vantage sim scanner`",
                scan.path.display()
            )));
        }
    }
    Ok(())
}

fn of_folder(folder: &Path) -> Result<Vec<PathBuf>, CliError> {
    let shown = folder.display();
    let entries = std::fs::read_dir(folder).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?;
    let is_scan = |path: &PathBuf| {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
    };
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).filter(is_scan).collect();
    paths.sort();
    if paths.is_empty() {
        return Err(CliError::BadInput(format!("{shown}: has no scans (files that end in {})", ENDINGS.join(", "))));
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: CompareArgs,
    }

    /// Scans of another plan gave a false pose of the part, and exit code 0.
    #[test]
    fn scans_of_another_plan_are_refused_with_both_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let scan = folder.path().join("view_000.ply");
        let write = |text: &str| std::fs::write(&scan, text).expect("a file");
        write("a scan");
        let source = ScanSource {
            name: "view_000.ply".to_owned(),
            is_named: true,
            sha256: String::new(),
            view: None,
            unit: None,
            frame: None,
            path: scan.clone(),
        };
        let check = |plan: &str| check_plan_of_scans(std::slice::from_ref(&source), plan).map_err(|error| error.to_string());
        assert_eq!(check("ef"), Ok(()), "no record tells of a plan");
        let file = serde_json::json!({
            "name": "view_000.ply", "sha256": sha256_of(b"a scan"), "written_by": "sim scanner", "plan_sha256": "ab",
        });
        let record = serde_json::json!({"schema": "vantage.output/1", "version": "0.1.0", "complete": true, "files": [file]});
        std::fs::write(folder.path().join(RECORD_FILE), record.to_string()).expect("a file");
        assert_eq!(check("ab"), Ok(()));
        let told = check("ef").expect_err("another plan");
        let wanted = ["view_000.ply: is a scan of another plan", "SHA-256 ab,", "has ef", "that the scans were taken with"];
        assert!(wanted.iter().all(|words| told.contains(*words)), "{told}");
        write("a scan of the real part");
        assert_eq!(check("ef"), Ok(()), "the record is not of this file");
    }

    /// A region that the plan does not have was told as `the inspection: /params/align/region`.
    #[test]
    fn a_parameter_that_does_not_suit_the_plan_is_told_at_its_option() {
        let refused = |pointer: &str| {
            let error = FieldError { pointer: pointer.to_owned(), detail: "is wrong".to_owned() };
            to_cli_error(InspectError::Refused(vec![error]), &["align.region=rim".to_owned()]).to_string()
        };
        assert_eq!(refused("/params/align/region"), "--set align.region=rim: is wrong");
        assert_eq!(refused("/params/align/method"), "parameters: /align/method: is wrong", "a default");
        assert_eq!(refused("/scans/0"), "the inspection: /scans/0: is wrong");
    }

    /// The results' folder was made and the part read before a scan was missed, in the words of the operating system.
    #[test]
    fn a_scan_that_is_not_there_is_told_with_the_one_that_was_meant() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("view_1.ply"), "").expect("a file");
        let (scan, out) = (folder.path().join("view1.ply").display().to_string(), folder.path().join("inspection"));
        let words = ["compare", "plan", scan.as_str(), "--mesh", "part.stl", "--out", out.to_str().expect("a path")];
        let line = Line::try_parse_from(words).unwrap_or_else(|error| panic!("{error}"));
        let told = run(&line.args, &AtomicBool::new(false)).expect_err("no such scan").to_string();
        assert!(told.ends_with("view1.ply: there is no such file; did you mean view_1.ply?") && !out.exists(), "{told}");
    }
}
