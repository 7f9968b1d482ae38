//! `vantage plan`: plans a part with the server's pipeline, without a server.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::Value;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};

use super::check::warn;
use super::files::{self, FileLibrary};
use super::limits::LimitArgs;
use super::progress::Progress;
use super::{CliError, features, out};
use crate::cell::{Cell, CellSpec, FieldError, Presets, Scanner, ScannerSpec, SpecKind, SpecLibrary};
use crate::geometry::mesh_io::ReadMesh;
use crate::geometry::{LengthUnit, Poll};
use crate::planning::PlanError;
use crate::planning::context::Context;
use crate::planning::params::PlanParams;
use crate::planning::plan::{RegionCoverage, Robust};
use crate::planning::sequence::Roadmaps;
use crate::service::plan_job::{Artifact, PlanJob};
use crate::wire::echo::Echo;
use crate::wire::ovp::OvpDocument;
use crate::wire::plan::{DrawnDocument, PlanDocument, RegionCoverageDocument, RemedyDocument, RobustDocument, SetupDocument};
use crate::wire::words::{area_mm2, at_risk_sentence, headline, no_plan_sentence, stability_sentence};
use crate::wire::{json_file_bytes, parameters, warnings};

const EXAMPLES: &str = "Examples:
  vantage plan part.stl --unit mm --out plan
  vantage plan part.stl --unit mm --cell none --scanner transcan-c-nominal --out plan
  vantage plan part.obj --unit inch --set limits.camera_deg=60 --set selection.max_views=8 --out plan --json

Files written to --out: plan.json, program.json, report.html, report.txt, coverage.csv, tables of views and missed
spots, timings.json, and ovp.json, a log in the format of the public benchmark of viewpoint planning; regions.csv if there are
regions of interest or features; candidates.json, every candidate with what it measures and how well, with
--set output.candidates=true.
Exit codes: 0 success, 1 system error, 2 bad input, 3 no plan possible, or with --strict a region or feature below its target,
4 interrupted.";

/// Plan viewpoints, motion and a robot program for a part.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}\n\nParameters for --set:\n{}", parameters::help()))]
pub struct PlanArgs {
    /// Part: an STL, OBJ or PLY file.
    mesh: PathBuf,
    /// Unit of the coordinates in the file: mm, cm, m or inch (in, inches, MM and the like are understood).
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Cell: name of a preset, a TOML or JSON file, or `none` to plan viewpoints only.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Scanner, with `--cell none` only: name of a preset, or a file [default: transcan-c].
    #[arg(long)]
    scanner: Option<String>,
    /// Planning parameters: a TOML or JSON file.
    #[arg(long)]
    params: Option<PathBuf>,
    /// Set one parameter, overriding the file: `selection.target=0.99`. A value that is not JSON is a string. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Toleranced features, in addition to `regions.features`: a JSON or CSV file. Example of CSV: a header
    /// `name,region,tolerance_mm,point_spacing_mm` and a line `bore,sphere 10 20 30 5,0.05,0.2`.
    #[arg(long)]
    features: Option<PathBuf>,
    /// Folder for the results; created if it does not exist.
    #[arg(long)]
    out: PathBuf,
    /// Print plan.json to standard output instead of a summary.
    #[arg(long)]
    json: bool,
    /// Exit with code 3 if a region of interest or a feature does not reach its target; the results are written all the same.
    #[arg(long)]
    strict: bool,
    /// Number of threads, 0 to 1024; 0 for all cores. The plan does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: u16,
    #[command(flatten)]
    limits: LimitArgs,
    /// Label to record in the plan, the program and the report. Repeatable.
    #[arg(long = "label", value_name = "KEY=VALUE")]
    labels: Vec<String>,
    /// Part number to record in the plan, the program and the report.
    #[arg(long)]
    part_number: Option<String>,
    /// Serial number to record in the plan, the program and the report.
    #[arg(long)]
    serial: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &PlanArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let mut params = load_params(args.params.as_deref(), &args.sets)?;
    params.regions.features.extend(args.features.as_deref().map(features::read).transpose()?.into_iter().flatten());
    warn("parameters", &warnings::of_params(&params, ""));
    let cell = load_cell(&args.cell, args.scanner.as_deref())?;
    let scanner = load_scanner(cell.as_ref(), args.scanner.as_deref())?;
    params.check_limits(&scanner).map_err(|errors| files::findings("parameters", &errors))?;
    out::prepare(&args.out)?;
    let (part, part_sha256) = load_mesh(&args.mesh, args.unit, cancel)?;
    let fixture = params.part.fixture_mesh.as_ref().map(|path| load_mesh(Path::new(path), args.unit, cancel)).transpose()?;
    // Views are ordered, and remedies tried, many times in the same cell.
    let roadmaps = Roadmaps::default();
    let job = PlanJob {
        mesh: &part.mesh,
        fixture: fixture.as_ref().map(|(fixture, _)| &fixture.mesh),
        part_name: args.mesh.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        part_sha256: &part_sha256,
        unit: part.unit,
        scanner: &scanner,
        cell: cell.as_ref(),
        roadmaps: Some(&roadmaps),
        params: &params,
        echo: Echo { labels: labels(&args.labels)?, part_number: args.part_number.clone(), serial: args.serial.clone() },
    };
    warn(&args.mesh.display().to_string(), &job.size_warnings("--unit"));
    cell.iter().for_each(|cell| warn(&args.cell, &warnings::of_cell(cell, "")));
    let pool = pool(args.threads)?;
    let progress = Progress::start();
    let planned = || {
        let allowance = args.limits.allowance(rayon::current_num_threads());
        let ctx = Context::new(cancel, &progress).with_allowance(allowance);
        let outcome = job.plan(&ctx)?;
        let artifacts = job.render(&outcome, &ctx)?;
        Ok::<_, PlanError>((outcome, artifacts))
    };
    let result = args.limits.within(cancel, || pool.install(planned).map_err(|error| blamed(&job, &args.mesh, error)));
    let seconds = progress.finish();
    let (outcome, mut artifacts) = result?;
    let log = OvpDocument::new(&outcome, &part.mesh, &scanner, &job.part_name, &seconds, now());
    artifacts.push(Artifact { name: "timings.json".into(), bytes: json_file_bytes(&seconds) });
    artifacts.push(Artifact { name: "ovp.json".into(), bytes: json_file_bytes(&log) });
    out::write(&args.out, &artifacts)?;
    print_summary(args, &artifacts)?;
    warn_of_errors(&params, outcome.plan.coverage.robust.as_ref());
    judge_regions(args.strict, &params, &outcome.plan.coverage.regions)
}

/// Warns of a plan that loses much under pose errors.
fn warn_of_errors(params: &PlanParams, robust: Option<&Robust>) {
    let fragile = robust.and_then(|robust| warnings::of_robust(params, &RobustDocument::from(robust), ""));
    warn("parameters", fragile.as_slice());
}

/// Warns of regions that do not reach their target; with `strict` they are an error.
fn judge_regions(strict: bool, params: &PlanParams, regions: &[RegionCoverage]) -> Result<(), CliError> {
    let regions: Vec<_> = regions.iter().map(RegionCoverageDocument::from).collect();
    let unmet = warnings::of_regions(params, &regions, "");
    warn("parameters", &unmet);
    if !strict || unmet.is_empty() {
        return Ok(());
    }
    let with_target = regions.iter().filter(|region| region.target.is_some()).count();
    Err(CliError::RegionsUnmet(format!(
        "{} of {with_target} regions and features with a target do not reach it (--strict); the results are written",
        unmet.len()
    )))
}

/// Loads a mesh and prints its warnings: a wrong unit is better noticed before an hour of planning than after.
pub(super) fn load_mesh(path: &Path, unit: Option<LengthUnit>, cancel: &AtomicBool) -> Result<(ReadMesh, String), CliError> {
    let (read, sha256) = files::mesh(path, unit, &Poll::new(&|| cancel.load(Ordering::Relaxed)))?;
    for warning in read.health.warnings() {
        eprintln!("{}: {warning}\n  → {}", path.display(), warning.remedy());
    }
    Ok((read, sha256))
}

/// Loads the cell that `--cell` names; `None` for `none`.
pub(super) fn load_cell(name: &str, scanner: Option<&str>) -> Result<Option<Cell>, CliError> {
    if name == "none" {
        return Ok(None);
    }
    if scanner.is_some() {
        return Err(CliError::BadInput("--scanner can only be used with --cell none; a cell has its own scanner".into()));
    }
    let spec: CellSpec = files::spec(SpecKind::Cell, name, Presets.cell(name))?;
    spec.build(&FileLibrary).map(Some).map_err(|errors| files::findings(name, &errors))
}

/// Loads the scanner: the cell's, else the one that `--scanner` names.
pub(super) fn load_scanner(cell: Option<&Cell>, name: Option<&str>) -> Result<Scanner, CliError> {
    if let Some(cell) = cell {
        return Ok(cell.scanner.clone());
    }
    let name = name.unwrap_or("transcan-c");
    let spec: ScannerSpec = files::spec(SpecKind::Scanner, name, Presets.scanner(name))?;
    spec.build().map_err(|errors| files::findings(name, &errors))
}

/// Loads the parameter file and applies every `--set` to it.
pub(super) fn load_params(file: Option<&Path>, sets: &[String]) -> Result<PlanParams, CliError> {
    let value = match file {
        Some(path) => files::value(path)?,
        None => Value::Object(serde_json::Map::new()),
    };
    set_params(value, sets)
}

/// Applies every `--set` to `value`.
pub(super) fn set_params(mut value: Value, sets: &[String]) -> Result<PlanParams, CliError> {
    for set in sets {
        let (key, text) = set
            .split_once('=')
            .ok_or_else(|| CliError::BadInput(format!("--set {set}: is not KEY=VALUE, as in selection.target=0.99")))?;
        let new = serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.to_owned()));
        insert(&mut value, key, new).map_err(|reason| CliError::BadInput(format!("--set {set}: {reason}")))?;
    }
    let params: PlanParams = files::from_value(value, "parameters")?;
    params.check().map_err(|errors| files::findings("parameters", &errors))?;
    Ok(params)
}

/// Thread pool of `threads` threads; of all cores for 0.
pub(super) fn pool(threads: u16) -> Result<rayon::ThreadPool, CliError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build();
    pool.map_err(|error| CliError::Failed(format!("--threads: {error}")))
}

/// Current time in UTC, RFC 3339; empty if it cannot be formatted.
fn now() -> String {
    let mut text = String::new();
    match SystemTime.format_time(&mut Writer::new(&mut text)) {
        Ok(()) => text,
        Err(_) => String::new(),
    }
}

fn insert(value: &mut Value, key: &str, new: Value) -> Result<(), String> {
    let (path, last) = key.rsplit_once('.').map_or((None, key), |(path, last)| (Some(path), last));
    let mut table = value;
    for name in path.into_iter().flat_map(|path| path.split('.')) {
        let map = table.as_object_mut().ok_or_else(|| format!("{name} is inside a value that is not an object"))?;
        table = map.entry(name).or_insert_with(|| Value::Object(serde_json::Map::new()));
    }
    let map = table.as_object_mut().ok_or_else(|| format!("{last} is inside a value that is not an object"))?;
    map.insert(last.to_owned(), new);
    Ok(())
}

fn labels(pairs: &[String]) -> Result<std::collections::BTreeMap<String, String>, CliError> {
    pairs
        .iter()
        .map(|pair| {
            let (key, value) =
                pair.split_once('=').ok_or_else(|| CliError::BadInput(format!("--label {pair}: is not KEY=VALUE")))?;
            Ok((key.to_owned(), value.to_owned()))
        })
        .collect()
}

/// Error of the command for an error of planning.
pub(super) fn to_cli_error(error: PlanError) -> CliError {
    match error {
        PlanError::Cancelled => CliError::Cancelled("interrupted; nothing was written".into()),
        PlanError::BadParams(errors) => files::findings("parameters", &errors),
        PlanError::NoPlan(finding) => CliError::NoPlan(format!("no plan is possible: {}", no_plan_sentence(&finding))),
    }
}

/// Error of the command for an error of a plan: at what its user gave, the file and its unit where no parameter is to blame.
fn blamed(job: &PlanJob<'_>, mesh: &Path, error: PlanError) -> CliError {
    let PlanError::BadParams(errors) = error else { return to_cli_error(error) };
    let line = |error: &FieldError| match job.error_of_part(error) {
        Some(detail) => format!("{} (--unit {}): {detail}", mesh.display(), job.unit),
        None => format!("parameters: {error}"),
    };
    CliError::BadInput(errors.iter().map(line).collect::<Vec<_>>().join("\n"))
}

/// Prints a summary for people, or with `--json` the plan itself for programs.
fn print_summary(args: &PlanArgs, artifacts: &[Artifact]) -> Result<(), CliError> {
    let bytes = artifacts.iter().find(|artifact| artifact.name == "plan.json").map_or(&[][..], |artifact| &artifact.bytes);
    if args.json {
        print!("{}", String::from_utf8_lossy(bytes));
        return Ok(());
    }
    let plan: PlanDocument = serde_json::from_slice(bytes).map_err(|error| CliError::BadInput(error.to_string()))?;
    let coverage = &plan.coverage;
    println!("{} views (stopped: {}); simulated coverage:", plan.viewpoints.len(), plan.stopped_because);
    for figure in headline(coverage) {
        println!("  {:>6.2} %  {:<26} {}", 100.0 * figure.share, figure.name, figure.meaning);
    }
    if let Some(at_risk) = &coverage.at_risk {
        println!("  {}", at_risk_sentence(at_risk));
    }
    if let Some(robust) = &coverage.robust {
        println!("  {}", under_pose_errors(robust));
    }
    for setup in setup_lines(&plan) {
        println!("  {setup}");
    }
    for link in &plan.setup_links {
        println!("  setups {} and {} {}", link.setups[0] + 1, link.setups[1] + 1, stability_sentence(&link.stability));
    }
    coverage.regions.iter().for_each(|region| println!("{}", region_summary(region)));
    for advice in &plan.advice {
        println!("  advice: {}\n                   {}", advice.text, advice.options());
    }
    for missed in &plan.missed {
        println!("  missed {:>6.2} %  {}", 100.0 * missed.area_mm2 / coverage.asked_area_mm2, missed.reason);
        if let Some(remedy) = &missed.remedy {
            println!("                   largest spot: {}", advice(remedy, plan.params.setups));
        }
    }
    println!("Report: {}", args.out.join("report.html").display());
    Ok(())
}

/// Setups with how the part lies in each, one on a line.
fn setup_lines(plan: &PlanDocument) -> Vec<String> {
    let line = |(number, setup): (usize, &SetupDocument)| {
        let turn = setup.turn.as_ref().map_or_else(|| "as it is laid first".to_owned(), |turn| turn.text.clone());
        format!("setup {}: {turn}; {} views", number + 1, setup.viewpoints.len())
    };
    plan.setups.iter().enumerate().map(line).collect()
}

/// Coverage of a region: what is asked and what is reached on one line, and the reasons on another if that is too little.
pub(super) fn region_summary(region: &RegionCoverageDocument) -> String {
    let tolerance = region.tolerance_mm.map_or_else(String::new, |mm| format!(", tolerance {mm} mm"));
    let target = match (region.target, region.met) {
        (Some(target), Some(true)) => format!("target {:.2} %: met", 100.0 * target),
        (Some(target), _) => format!("target {:.2} %: NOT MET", 100.0 * target),
        (None, _) => "no target".to_owned(),
    };
    let why = region.why_unmet.as_ref().map_or_else(String::new, |why| format!("\n                   missed: {why}"));
    format!(
        "  region {:?} ({}{tolerance}; {} mm², {} samples): {:.2} %, {target}{why}",
        region.name,
        region.kind,
        area_mm2(region.asked_area_mm2),
        region.samples,
        100.0 * region.of_asked
    )
}

/// Lowest shares of the asked area under pose errors, on one line.
fn under_pose_errors(robust: &RobustDocument) -> String {
    let worst = |name: &str, drawn: &DrawnDocument| format!("{:.2} % {name}", 100.0 * drawn.worst);
    let mut cases = vec![worst("each view", &robust.of_asked), worst("the part", &robust.part.of_asked)];
    cases.extend(robust.hand_eye.as_ref().map(|hand_eye| worst("the hand-eye calibration", &hand_eye.of_asked)));
    let error = robust.pose_error;
    format!(
        "lowest of asked in {} draws each, off by {}° and {} mm: {}",
        robust.draws,
        error.angle_deg,
        error.translation_mm,
        cases.join(", ")
    )
}

/// Advice for a missed spot, on one line; `setups` is the number that the plan allowed. Where it does not do for the spot, the
/// share that it measures comes first.
pub(super) fn advice(remedy: &RemedyDocument, setups: u32) -> String {
    let recovers = |advice: &str| match remedy.partial_share() {
        Some(share) => format!("{share}: {advice}"),
        None => format!("{advice}: recovers {} mm² ({:.0} %)", area_mm2(remedy.area_mm2), 100.0 * remedy.of_spot),
    };
    match remedy.kind.as_str() {
        "none" if remedy.tried == 1 => "no fix found (the one view tried does not see half of it)".to_owned(),
        "none" => format!("no fix found (no 8 of the {} views tried see half of it)", remedy.tried),
        "setup" => {
            let turn = remedy.turn.as_ref().map_or("turn it onto another side", |turn| turn.text.as_str());
            let knob = if setups == 1 { "try --set setups=2" } else { "set part.resting_poses" };
            recovers(&format!("{turn} and scan again ({knob})"))
        }
        "view" => {
            let views =
                if remedy.views.len() == 1 { "1 more view".to_owned() } else { format!("{} more views", remedy.views.len()) };
            let would = if remedy.partial_share().is_some() { "" } else { " would measure it" };
            recovers(&format!("{views}{would} (raise selection.target or selection.max_views)"))
        }
        _ => remedy.text.clone(),
    }
}
