//! `vantage study`: varies one parameter with the others fixed and writes a table, plots and a page; and compares the reach of
//! layouts of a cell.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use super::out::{FileOrigin, OutputFolder, OutputWriter};
use super::plan::{check_up, load_cell, load_mesh, load_params, load_scanner, placed, pool, to_cli_error};
use super::progress::Progress;
use super::{CliError, reach};
use crate::geometry::LengthUnit;
use crate::planning::context::Context;
use crate::planning::studies::{self, Study};
use crate::planning::{PlanInput, UpAxis};
use crate::report::study::{StudyInput, coverage_svg, csv, grades_svg, html, text};
use crate::service::plan_job::Artifact;

/// Parameter that a study varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Varied {
    /// Weights of coverage (a) and quality (b): a = 1, 0.75, 0.5, 0.25, 0 and b = 1 - a
    Weights,
    /// Incidence limits: cameras 85 to 45 degrees, projector 7.5 degrees less
    Limits,
    /// Candidate strategies: each alone, then the configured mix
    Candidates,
    /// Layouts of robot, table and scanner in a cell: the share of the viewing hemisphere that each reaches
    Reach,
}

/// Vary the weights of the score, the incidence limits or the candidates, and compare coverage and grades; or vary the
/// layout of a cell, and compare its reach.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage study weights part.stl --unit mm
  vantage study limits part.stl --unit mm --scanner transcan-c-nominal --out limits
  vantage study candidates part.stl --unit mm --set selection.objective=coverage --at 10
  vantage study reach --cell e05-transcan --foot 350,400,450 --table=-250,-200,-150 --mountings

Files written to --out, named after the study: STUDY.csv, STUDY-coverage.svg, STUDY-grades.svg, and STUDY.html with all
of them; for reach only reach.csv and reach.svg.
Exit codes: 0 success, 1 system error, 2 bad input, 3 no plan possible, 4 interrupted.")]
pub struct StudyArgs {
    /// Study to run.
    study: Varied,
    /// Part: an STL, OBJ or PLY file; not used by `reach`.
    mesh: Option<PathBuf>,
    /// Unit of the coordinates in the file: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Axis of the part that points up on the plate: x, -x, y, -y, z or -z [default: z].
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<UpAxis>,
    /// Cell: name of a preset, a TOML or JSON file, or `none` to study viewpoints only.
    #[arg(long, default_value = "none")]
    cell: String,
    /// Scanner, with `--cell none` only: name of a preset, or a file [default: transcan-c].
    #[arg(long)]
    scanner: Option<String>,
    /// Parameters that stay fixed: a TOML or JSON file.
    #[arg(long)]
    params: Option<PathBuf>,
    /// Set one parameter, overriding the file: `selection.objective=coverage`. A value that is not JSON is a string;
    /// `KEY=@FILE` reads it from a JSON, TOML or text file. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Maximum number of views in a series.
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Number of views at which grades are compared.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    at: u32,
    #[command(flatten)]
    reach: reach::ReachArgs,
    /// Folder for the results; created if it does not exist.
    #[arg(long, default_value = "study")]
    out: PathBuf,
    /// Number of threads, 0 to 1024; 0 for all cores. The results do not depend on it.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: u16,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &StudyArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let (study, mesh) = match (args.study, &args.mesh) {
        (Varied::Reach, None) if args.up.is_some() => {
            return Err(CliError::BadInput("--up: cannot be used with `study reach`, which places a cube".into()));
        }
        (Varied::Reach, None) => return reach::run(&args.reach, &args.cell, &args.out, args.threads, cancel),
        (Varied::Reach, Some(mesh)) => {
            let detail = "cannot be used with `study reach`, which places a cube; give the edge of the cube with --cube";
            return Err(CliError::BadInput(format!("{}: {detail}", mesh.display())));
        }
        (Varied::Weights, Some(mesh)) => (Study::Weights, mesh),
        (Varied::Limits, Some(mesh)) => (Study::Limits, mesh),
        (Varied::Candidates, Some(mesh)) => (Study::Candidates, mesh),
        (_, None) => return Err(CliError::BadInput("no mesh given; name the part's file after the study".into())),
    };
    let params = load_params(args.params.as_deref(), &args.sets)?;
    check_up(args.up, &params)?;
    let cell = load_cell(&args.cell, args.scanner.as_deref())?;
    let scanner = load_scanner(cell.as_ref(), args.scanner.as_deref())?;
    let (part, part_sha256) = load_mesh(mesh, args.unit, cancel)?;
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
    let progress = Progress::start();
    let max_views = args.views.max(args.at);
    let findings =
        pool(args.threads)?.install(|| studies::run(study, &input, &params, max_views, &Context::new(cancel, &progress)));
    // The seconds of the stages are not a result.
    let _ = progress.finish();
    let findings = findings.map_err(to_cli_error)?;
    let results = StudyInput {
        findings: &findings,
        params: &params,
        part_name: &mesh.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        scanner_name: &scanner.name,
        cell_name: cell.as_ref().map(|cell| cell.name.as_str()),
        at: args.at as usize,
    };
    folder.replace(&artifacts(&results, names), &FileOrigin::default())?;
    print!("{}", text(&results));
    println!("Report: {}", args.out.join(names[3]).display());
    Ok(())
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
