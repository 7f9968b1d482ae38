//! `vantage study`: varies one parameter with the others fixed and writes a table, plots and a page; and compares the reach of
//! layouts of a cell.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::given_params::load_params;
use super::out::{FileOrigin, OutputFolder, OutputWriter};
use super::plan::{check_up, load_cell, load_mesh, load_scanner, placed, pool, to_cli_error};
use super::progress::{Course, Progress};
use super::ranges::whole;
use super::{CliError, output, reach};
use crate::geometry::LengthUnit;
use crate::planning::context::Context;
use crate::planning::studies::{self, Series, Study, StudyResult};
use crate::planning::{PlanInput, UpAxis};
use crate::report::study::{StudyInput, coverage_svg, csv, grades_svg, html, text};
use crate::service::plan_job::Artifact;
use crate::wire::words::counted;

/// Number of views at which grades are compared where none is given.
const DEFAULT_AT: u32 = 8;

/// Vary one parameter and compare coverage and grades, or vary the layout of a cell and compare its reach.
#[derive(Debug, clap::Args)]
#[command(
    override_usage = "vantage study <weights|limits|candidates> <MESH> [OPTIONS]\n       vantage study reach [OPTIONS]",
    after_help = "Each study has its own options: see `vantage study weights --help`.

Examples:
  vantage study weights part.stl --unit mm
  vantage study limits part.stl --unit mm --scanner transcan-c-nominal \\
      --out limits
  vantage study candidates part.stl --unit mm --set selection.objective=coverage
  vantage study reach --cell e05-transcan --mountings

Exit codes: 0 success, 1 system error, 2 bad input, 3 no plan possible, 4 interrupted."
)]
pub struct StudyArgs {
    #[command(subcommand)]
    study: StudyCommand,
}

// Its doc comment would stand in the help in place of the one of the command.
#[derive(Debug, clap::Subcommand)]
enum StudyCommand {
    /// Vary the weights of coverage (a) and quality (b): a = 1, 0.75, 0.5, 0.25, 0 with b = 1 - a.
    #[command(
        after_help = "Files written to --out: weights.csv, weights-coverage.svg, weights-grades.svg, and weights.html with all of them.

Example:
  vantage study weights part.stl --unit mm --at 10 --out study \\
      --set candidates.even_directions=100"
    )]
    Weights(SeriesArgs),
    /// Vary the incidence limits: cameras from 85° to 45°, projector 7.5° less.
    #[command(
        after_help = "Files written to --out: limits.csv, limits-coverage.svg, limits-grades.svg, and limits.html with all of them.

Example:
  vantage study limits part.stl --unit mm --scanner transcan-c-nominal \\
      --out limits"
    )]
    Limits(SeriesArgs),
    /// Compare the strategies that generate candidate viewpoints: each alone, then the configured mix.
    #[command(after_help = "Files written to --out: candidates.csv, candidates-coverage.svg, candidates-grades.svg, and \
candidates.html with all of them.

Example:
  vantage study candidates part.stl --unit mm --out candidates \\
      --set selection.objective=coverage")]
    Candidates(SeriesArgs),
    /// Compare layouts of robot, table and scanner by the share of the viewing hemisphere that each reaches.
    Reach(reach::ReachArgs),
}

/// Inputs of a study of views.
#[derive(Debug, clap::Args)]
struct SeriesArgs {
    /// Part to study: an STL, OBJ or PLY file.
    mesh: PathBuf,
    /// Unit of the coordinates in the file, required: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Axis of the part that points up on the plate: x, -x, y, -y, z or -z [default: z].
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<UpAxis>,
    /// Cell: a preset name, a TOML or JSON file, or `none` to study viewpoints only.
    #[arg(long, default_value = "none", help_heading = "Cell and scanner")]
    cell: String,
    /// Scanner, only with `--cell none`: a preset name, or a TOML or JSON file [default: transcan-c].
    #[arg(long, help_heading = "Cell and scanner")]
    scanner: Option<String>,
    /// Values of the parameters that are not varied: a TOML or JSON file.
    #[arg(long, help_heading = "Fixed parameters")]
    params: Option<PathBuf>,
    /// Set one parameter, overriding --params: `selection.objective=coverage`. A value that is not valid JSON is taken as a
    /// string. `KEY=@FILE` reads the value from a JSON, TOML or text file. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE", help_heading = "Fixed parameters")]
    sets: Vec<String>,
    /// Maximum number of views in each series, 1 to 1000.
    #[arg(long, default_value_t = 30, value_parser = whole::<u32>(1..=1000))]
    views: u32,
    /// Number of views at which grades are compared, at most --views [default: 8, or --views if that is fewer].
    #[arg(long, value_parser = whole::<u32>(1..=1000))]
    at: Option<u32>,
    /// Folder for the results; created if it does not exist.
    #[arg(long, default_value = "study")]
    out: PathBuf,
    /// Number of threads, 0 to 1024; 0 for all cores. The results do not depend on it.
    #[arg(long, default_value_t = 0, value_parser = whole::<u16>(0..=1024))]
    threads: u16,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &StudyArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    match &args.study {
        StudyCommand::Weights(series) => run_series(Study::Weights, series, cancel),
        StudyCommand::Limits(series) => run_series(Study::Limits, series, cancel),
        StudyCommand::Candidates(series) => run_series(Study::Candidates, series, cancel),
        StudyCommand::Reach(layouts) => reach::run(layouts, cancel),
    }
}

/// Runs a study of views.
fn run_series(study: Study, args: &SeriesArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let params = load_params(args.params.as_deref(), &args.sets)?;
    check_up(args.up, &params)?;
    let at = args.at.unwrap_or(DEFAULT_AT.min(args.views));
    if at > args.views {
        return Err(CliError::BadInput(format!(
            "--at {at}: is beyond the {} of a series (--views)",
            counted(args.views as usize, "view")
        )));
    }
    let cell = load_cell(&args.cell, args.scanner.as_deref())?;
    let scanner = load_scanner(cell.as_ref(), args.scanner.as_deref())?;
    let (part, part_sha256) = load_mesh(&args.mesh, args.unit, cancel)?;
    let params = placed(&params, args.up, &part.mesh);
    let fixture = params.part.fixture_mesh.as_ref().map(|path| load_mesh(path.as_ref(), args.unit, cancel)).transpose()?;
    let fixture = fixture.as_ref().map(|(fixture, _)| &fixture.mesh);
    let input = PlanInput {
        mesh: &part.mesh,
        fixture,
        part_sha256: &part_sha256,
        scanner: &scanner,
        cell: cell.as_ref(),
        roadmaps: None,
    };
    let (name, names) = names(study);
    let folder = OutputFolder::prepare(&args.out, OutputWriter::Study(name), &names)?;
    let progress = Progress::start(&Course::of_study(study, &params));
    let findings =
        pool(args.threads)?.install(|| studies::run(study, &input, &params, args.views, &Context::new(cancel, &progress)));
    // The seconds of the stages are not a result.
    let _ = progress.finish();
    let findings = findings.map_err(to_cli_error)?;
    let results = StudyInput {
        findings: &findings,
        params: &params,
        part_name: &args.mesh.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        scanner_name: &scanner.name,
        cell_name: cell.as_ref().map(|cell| cell.name.as_str()),
        at: at as usize,
    };
    folder.replace(&artifacts(&results, names), &FileOrigin::default())?;
    let words = format!("{}Report: {}\n", text(&results), args.out.join(names[3]).display());
    output::result(&document(&results, &names.map(|name| args.out.join(name).display().to_string())), words)
}

/// Series of a study, as `--json` prints them; shares are of the asked area.
fn document(results: &StudyInput<'_>, files: &[String]) -> Value {
    let series = |series: &Series| {
        let step = series.after(results.at);
        let settings: BTreeMap<&str, &str> = series.settings.iter().map(|(key, value)| (*key, value.as_str())).collect();
        json!({
            "label": series.label, "settings": settings, "candidates": series.candidates,
            "coverable_of_asked": series.coverable_of_asked, "views": series.steps.len(),
            "of_asked": series.steps.iter().map(|step| step.of_asked).collect::<Vec<_>>(),
            "grades": step.grades, "stopped_because": series.stopped_because.as_str(),
        })
    };
    let StudyResult { study, series: all, skipped } = results.findings;
    let all: Vec<Value> = all.iter().map(series).collect();
    let skipped: Vec<Value> = skipped.iter().map(|(label, reason)| json!({"label": label, "reason": reason})).collect();
    json!({"study": study.as_str(), "grades_after_views": results.at, "series": all, "skipped": skipped, "files": files})
}

/// Name of a study, and of its table, plots and page.
fn names(study: Study) -> (&'static str, [&'static str; 4]) {
    match study {
        Study::Weights => ("weights", ["weights.csv", "weights-coverage.svg", "weights-grades.svg", "weights.html"]),
        Study::Limits => ("limits", ["limits.csv", "limits-coverage.svg", "limits-grades.svg", "limits.html"]),
        Study::Candidates => {
            ("candidates", ["candidates.csv", "candidates-coverage.svg", "candidates-grades.svg", "candidates.html"])
        }
    }
}

fn artifacts(results: &StudyInput<'_>, names: [&'static str; 4]) -> Vec<Artifact> {
    let texts = [csv(results), coverage_svg(results), grades_svg(results), html(results)];
    names.into_iter().zip(texts).map(|(name, text)| Artifact { name: name.into(), bytes: text.into_bytes() }).collect()
}
