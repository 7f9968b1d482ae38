//! `vantage study`: one knob varied, the rest left alone, as table, plots and page; and the reach of a cell's layouts.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use super::plan::{explain, load_cell, load_mesh, load_params, load_scanner, pool};
use super::progress::Progress;
use super::{CliError, out, reach};
use crate::geometry::LengthUnit;
use crate::planning::PlanInput;
use crate::planning::context::Context;
use crate::planning::studies::{self, Study};
use crate::service::plan_job::Artifact;
use crate::wire::study::{StudyInput, coverage_svg, csv, grades_svg, html, text};

/// What is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Varied {
    /// Weights of coverage (a) and quality (b): a = 1, 0.75, 0.5, 0.25, 0 and b = 1 - a
    Weights,
    /// Limits of incidence: cameras 85 to 45 degrees, the projector 7.5 less
    Limits,
    /// Candidate strategies: each alone, then the configured mix
    Candidates,
    /// Where robot, table and scanner stand in a cell: how much of the viewing hemisphere each layout reaches
    Reach,
}

/// Vary the score's weights, the limits of incidence or the candidates, and see what coverage and grades come out; or the
/// layout of a cell, and see what it reaches.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage study weights part.stl --unit mm
  vantage study limits part.stl --unit mm --scanner transcan-c-nominal --out limits
  vantage study candidates part.stl --unit mm --set selection.objective=coverage --at 10
  vantage study reach --cell e05-transcan --foot 350,400,450 --table=-250,-200,-150 --mountings

Files written to --out, each named after the study: .csv, -coverage.svg, -grades.svg and .html with all of them;
for reach .csv and .svg.
Exit codes: 0 done, 1 the machine is at fault, 2 bad input, 3 no plan possible, 4 interrupted.")]
pub struct StudyArgs {
    /// What to vary.
    study: Varied,
    /// The part: STL, OBJ or PLY; `reach` needs none.
    mesh: Option<PathBuf>,
    /// Unit of the file's coordinates: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Cell: a preset's name, a TOML or JSON file, or `none` to study viewpoints alone.
    #[arg(long, default_value = "none")]
    cell: String,
    /// Scanner for `--cell none`: a preset's name or a file.
    #[arg(long)]
    scanner: Option<String>,
    /// Parameters that are left alone: a TOML or JSON file.
    #[arg(long)]
    params: Option<PathBuf>,
    /// One parameter, over the file's: `selection.objective=coverage`. The value is JSON, else a string.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Most views of a series.
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Number of views at which grades are told.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    at: u32,
    #[command(flatten)]
    reach: reach::ReachArgs,
    /// Folder for the results; made if it is not there.
    #[arg(long, default_value = "study")]
    out: PathBuf,
    /// Threads to use, 0 to 1024; the findings do not depend on it. 0: all cores.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: u16,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &StudyArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let (study, mesh) = match (args.study, &args.mesh) {
        (Varied::Reach, None) => return reach::run(&args.reach, &args.cell, &args.out, args.threads, cancel),
        (Varied::Reach, Some(mesh)) => {
            let detail = "is not used by `study reach`, which places a cube; give its edge with --cube";
            return Err(CliError::BadInput(format!("{}: {detail}", mesh.display())));
        }
        (Varied::Weights, Some(mesh)) => (Study::Weights, mesh),
        (Varied::Limits, Some(mesh)) => (Study::Limits, mesh),
        (Varied::Candidates, Some(mesh)) => (Study::Candidates, mesh),
        (_, None) => return Err(CliError::BadInput("names no mesh; give the part's file after the study".into())),
    };
    let params = load_params(args.params.as_deref(), &args.sets)?;
    let cell = load_cell(&args.cell, args.scanner.as_deref())?;
    let scanner = load_scanner(cell.as_ref(), args.scanner.as_deref())?;
    let (part, part_sha256) = load_mesh(mesh, args.unit, cancel)?;
    let fixture = params.part.fixture_mesh.as_ref().map(|path| load_mesh(path.as_ref(), args.unit, cancel)).transpose()?;
    let fixture = fixture.as_ref().map(|(fixture, _)| &fixture.mesh);
    let input = PlanInput { mesh: &part.mesh, fixture, part_sha256: &part_sha256, scanner: &scanner, cell: cell.as_ref() };
    out::prepare(&args.out)?;
    let progress = Progress::start();
    let most_views = args.views.max(args.at);
    let findings =
        pool(args.threads)?.install(|| studies::run(study, &input, &params, most_views, &Context::new(cancel, &progress)));
    // The seconds of the stages are no finding.
    let _ = progress.finish();
    let findings = findings.map_err(explain)?;
    let told = StudyInput {
        findings: &findings,
        params: &params,
        part_name: &mesh.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        scanner_name: &scanner.name,
        cell_name: cell.as_ref().map(|cell| cell.name.as_str()),
        at: args.at as usize,
    };
    let names = names(study);
    out::write(&args.out, &artifacts(&told, names))?;
    print!("{}", text(&told));
    println!("Look at {}", args.out.join(names[3]).display());
    Ok(())
}

/// Table, plots and page of a study.
fn names(study: Study) -> [&'static str; 4] {
    match study {
        Study::Weights => ["weights.csv", "weights-coverage.svg", "weights-grades.svg", "weights.html"],
        Study::Limits => ["limits.csv", "limits-coverage.svg", "limits-grades.svg", "limits.html"],
        Study::Candidates => ["candidates.csv", "candidates-coverage.svg", "candidates-grades.svg", "candidates.html"],
    }
}

fn artifacts(told: &StudyInput<'_>, names: [&'static str; 4]) -> Vec<Artifact> {
    let texts = [csv(told), coverage_svg(told), grades_svg(told), html(told)];
    names.into_iter().zip(texts).map(|(name, text)| Artifact { name, bytes: text.into_bytes() }).collect()
}
