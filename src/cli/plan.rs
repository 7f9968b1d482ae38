//! `vantage plan`: the pipeline of the server without a server.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::Value;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};

use super::files::{self, FileLibrary};
use super::limits::LimitArgs;
use super::progress::Progress;
use super::{CliError, features, out};
use crate::cell::{Cell, CellSpec, Presets, Scanner, ScannerSpec, SpecKind, SpecLibrary};
use crate::geometry::mesh_io::ReadMesh;
use crate::geometry::{LengthUnit, Poll};
use crate::planning::PlanError;
use crate::planning::context::Context;
use crate::planning::params::PlanParams;
use crate::planning::sequence::Roadmaps;
use crate::service::plan_job::{Artifact, PlanJob};
use crate::wire::echo::Echo;
use crate::wire::json_file_bytes;
use crate::wire::ovp::OvpDocument;
use crate::wire::plan::PlanDocument;

/// Plan viewpoints, motion and robot program for a part.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage plan part.stl --unit mm --out plan
  vantage plan part.stl --unit mm --cell none --scanner transcan-c-nominal --out plan
  vantage plan part.obj --unit inch --set limits.camera_deg=60 --set selection.max_views=8 --out plan --json

Files written to --out: plan.json, program.json, timings.json, report.html, report.txt, coverage.csv, listings, and
ovp.json, a log that the public benchmark of viewpoint planning reads.
Exit codes: 0 done, 1 the machine is at fault, 2 bad input, 3 no plan possible, 4 interrupted.")]
pub struct PlanArgs {
    /// The part: STL, OBJ or PLY.
    mesh: PathBuf,
    /// Unit of the file's coordinates: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Cell: a preset's name, a TOML or JSON file, or `none` to plan viewpoints alone.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Scanner for `--cell none`: a preset's name or a file.
    #[arg(long)]
    scanner: Option<String>,
    /// Parameters: a TOML or JSON file.
    #[arg(long)]
    params: Option<PathBuf>,
    /// One parameter, over the file's: `selection.target=0.99`. The value is JSON, else a string.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Toleranced features, beside those of `regions.features`: a JSON or CSV file, for example with the lines
    /// `name,region,tolerance_mm,point_spacing_mm` and `bore,sphere 10 20 30 5,0.05,0.2`.
    #[arg(long)]
    features: Option<PathBuf>,
    /// Folder for the results; made if it is not there.
    #[arg(long)]
    out: PathBuf,
    /// Print plan.json to standard output.
    #[arg(long)]
    json: bool,
    /// Threads to plan with, 0 to 1024; the plan does not depend on it. 0: all cores.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: u16,
    #[command(flatten)]
    limits: LimitArgs,
    /// A label that plan and program carry.
    #[arg(long = "label", value_name = "KEY=VALUE")]
    labels: Vec<String>,
    /// Part number that plan and program carry.
    #[arg(long)]
    part_number: Option<String>,
    /// Serial number that plan and program carry.
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
    let cell = load_cell(&args.cell, args.scanner.as_deref())?;
    let scanner = load_scanner(cell.as_ref(), args.scanner.as_deref())?;
    out::prepare(&args.out)?;
    let (part, part_sha256) = load_mesh(&args.mesh, args.unit, cancel)?;
    let fixture = params.part.fixture_mesh.as_ref().map(|path| load_mesh(Path::new(path), args.unit, cancel)).transpose()?;
    let job = PlanJob {
        mesh: &part.mesh,
        fixture: fixture.as_ref().map(|(fixture, _)| &fixture.mesh),
        part_name: args.mesh.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        part_sha256: &part_sha256,
        scanner: &scanner,
        cell: cell.as_ref(),
        params: &params,
        echo: Echo { labels: labels(&args.labels)?, part_number: args.part_number.clone(), serial: args.serial.clone() },
    };
    let pool = pool(args.threads)?;
    let progress = Progress::start();
    let planned = || {
        // One plan orders views, and tries remedies, many times in its cell.
        let roadmaps = Roadmaps::default();
        let allowance = args.limits.allowance(rayon::current_num_threads());
        let ctx = Context::new(cancel, &progress).with_roadmaps(&roadmaps).with_allowance(allowance);
        let outcome = job.plan(&ctx)?;
        let artifacts = job.render(&outcome, &ctx)?;
        Ok::<_, PlanError>((outcome, artifacts))
    };
    let result = args.limits.within(cancel, || pool.install(planned).map_err(explain));
    let seconds = progress.finish();
    let (outcome, mut artifacts) = result?;
    let log = OvpDocument::new(&outcome, &part.mesh, &scanner, &job.part_name, &seconds, now());
    artifacts.push(Artifact { name: "timings.json", bytes: json_file_bytes(&seconds) });
    artifacts.push(Artifact { name: "ovp.json", bytes: json_file_bytes(&log) });
    out::write(&args.out, &artifacts)?;
    report(args, &artifacts)
}

/// The mesh, after what is suspicious about it was told: a wrong unit is better seen before an hour than after.
pub(super) fn load_mesh(path: &Path, unit: Option<LengthUnit>, cancel: &AtomicBool) -> Result<(ReadMesh, String), CliError> {
    let (read, sha256) = files::mesh(path, unit, &Poll::new(&|| cancel.load(Ordering::Relaxed)))?;
    for warning in read.health.warnings() {
        eprintln!("{}: {warning}\n  → {}", path.display(), warning.remedy());
    }
    Ok((read, sha256))
}

/// The cell that `--cell` names; none for `none`.
pub(super) fn load_cell(name: &str, scanner: Option<&str>) -> Result<Option<Cell>, CliError> {
    if name == "none" {
        return Ok(None);
    }
    if scanner.is_some() {
        return Err(CliError::BadInput("--scanner goes with --cell none; a cell names its own scanner".into()));
    }
    let spec: CellSpec = files::spec(SpecKind::Cell, name, Presets.cell(name))?;
    spec.build(&FileLibrary).map(Some).map_err(|errors| files::findings(name, &errors))
}

/// The cell's scanner, else the one that `--scanner` names.
pub(super) fn load_scanner(cell: Option<&Cell>, name: Option<&str>) -> Result<Scanner, CliError> {
    if let Some(cell) = cell {
        return Ok(cell.scanner.clone());
    }
    let name = name.unwrap_or("transcan-c");
    let spec: ScannerSpec = files::spec(SpecKind::Scanner, name, Presets.scanner(name))?;
    spec.build().map_err(|errors| files::findings(name, &errors))
}

/// File first, then every `--set` over it.
pub(super) fn load_params(file: Option<&Path>, sets: &[String]) -> Result<PlanParams, CliError> {
    let value = match file {
        Some(path) => files::value(path)?,
        None => Value::Object(serde_json::Map::new()),
    };
    set_params(value, sets)
}

/// Every `--set` over `value`.
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

/// Threads to work with; all cores for 0.
pub(super) fn pool(threads: u16) -> Result<rayon::ThreadPool, CliError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads)).build();
    pool.map_err(|error| CliError::Failed(format!("--threads: {error}")))
}

/// The time, RFC 3339, UTC; empty where the machine has none.
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
        let map = table.as_object_mut().ok_or_else(|| format!("{name} lies below a value that has no parts"))?;
        table = map.entry(name).or_insert_with(|| Value::Object(serde_json::Map::new()));
    }
    let map = table.as_object_mut().ok_or_else(|| format!("{last} lies below a value that has no parts"))?;
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

/// What ends the command when planning does.
pub(super) fn explain(error: PlanError) -> CliError {
    match error {
        PlanError::Cancelled => CliError::Cancelled("interrupted; nothing was written".into()),
        PlanError::BadParams(errors) => files::findings("parameters", &errors),
        PlanError::NoPlan(_) => CliError::NoPlan(error.to_string()),
    }
}

/// What a person wants to know at once, or the plan itself for a program.
fn report(args: &PlanArgs, artifacts: &[Artifact]) -> Result<(), CliError> {
    let bytes = artifacts.iter().find(|artifact| artifact.name == "plan.json").map_or(&[][..], |artifact| &artifact.bytes);
    if args.json {
        print!("{}", String::from_utf8_lossy(bytes));
        return Ok(());
    }
    let plan: PlanDocument = serde_json::from_slice(bytes).map_err(|error| CliError::BadInput(error.to_string()))?;
    let coverage = &plan.coverage;
    println!(
        "{} views measure {:.2} % of the asked area, {:.2} % of what can be measured (stopped: {}).",
        plan.viewpoints.len(),
        100.0 * coverage.of_asked,
        100.0 * coverage.of_coverable,
        plan.stopped_because
    );
    if let Some(independent) = &coverage.independent {
        println!("  on samples that no view was chosen on: {:.2} % of the asked area", 100.0 * independent.of_asked);
    }
    if let Some(robust) = &coverage.robust {
        let worst = [robust.of_asked.worst, robust.part.of_asked.worst].map(|share| 100.0 * share);
        println!("  with poses off, at worst: {:.2} % (views), {:.2} % (the part)", worst[0], worst[1]);
    }
    for missed in &plan.missed {
        println!("  missed {:>6.2} %  {}", 100.0 * missed.area_mm2 / coverage.asked_area_mm2, missed.reason);
        if let Some(remedy) = &missed.remedy {
            println!("                   its largest spot: {}", remedy.text);
        }
    }
    println!("Look at {}", args.out.join("report.html").display());
    Ok(())
}
