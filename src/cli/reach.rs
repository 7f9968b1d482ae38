//! `vantage study reach`: compares layouts of robot, table and scanner by their reach.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::out::{FileOrigin, OutputFolder, OutputWriter};
use super::plan::{load_cell, pool};
use super::progress::{Course, Progress};
use super::ranges::{number, whole};
use super::{CliError, output};
use crate::planning::PlanError;
use crate::planning::context::Context;
use crate::planning::studies::reach::{AZIMUTHS, ELEVATIONS, Layout, Layouts, mountings, own_layout, reach};
use crate::report::study::reach::{ReachInput, csv, mounting_words, svg, text};
use crate::service::plan_job::Artifact;

/// Default distances from the cell's own layout, mm.
const OFFSETS_MM: [f64; 5] = [-100.0, -50.0, 0.0, 50.0, 100.0];
/// Maximum distance and height, mm.
const MAX_DISTANCE_MM: f64 = 5000.0;

/// Layouts that `study reach` compares.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage study reach --cell e05-transcan
  vantage study reach --cell e05-transcan --foot 350,400,450 \\
      --table=-250,-200,-150 --mountings

Files written to --out: reach.csv and reach.svg. In the table, directions counts those of a grid of equal angles; hemisphere_share, which \
                the map shows, weights each by its solid angle.")]
pub struct ReachArgs {
    /// Cell: a preset name, or a TOML or JSON file.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Edge length of a cube on the plate that represents the part, mm, 1 to 5000.
    #[arg(long, default_value_t = 120.0, value_parser = number)]
    cube: f64,
    /// Distances between the robot's foot and the table axis, mm, 0 to 5000, comma-separated [default: the cell's own, ±50 and
    /// ±100].
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true, value_parser = number)]
    foot: Vec<f64>,
    /// Heights of the plate above the foot, mm, -5000 to 5000, comma-separated [default: the cell's own, ±50 and ±100].
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true, value_parser = number)]
    table: Vec<f64>,
    /// Also compare mountings: the flange on each of the scanner's other faces.
    #[arg(long)]
    mountings: bool,
    /// Distance between flange and scanner for the other mountings, mm, 0 to 5000.
    #[arg(long, default_value_t = 30.0, value_parser = number)]
    adapter: f64,
    /// Folder for the results; created if it does not exist.
    #[arg(long, default_value = "study")]
    out: PathBuf,
    /// Number of threads, 0 to 1024; 0 for all cores. The results do not depend on it.
    #[arg(long, default_value_t = 0, value_parser = whole::<u16>(0..=1024))]
    threads: u16,
}

/// Runs the study.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &ReachArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let folder = args.out.as_path();
    let Some(cell) = load_cell(&args.cell, None)? else {
        return Err(CliError::BadInput("--cell none: `study reach` needs a cell, such as e05-transcan".into()));
    };
    check_range("--cube", &[args.cube], 1.0)?;
    check_range("--foot", &args.foot, 0.0)?;
    check_range("--table", &args.table, -MAX_DISTANCE_MM)?;
    check_range("--adapter", &[args.adapter], 0.0)?;
    let own = own_layout(&cell);
    let around = |given: &[f64], own: f64| if given.is_empty() { OFFSETS_MM.map(|by| own + by).to_vec() } else { given.to_vec() };
    let mut mountings = mountings(&cell, args.adapter);
    mountings.truncate(if args.mountings { mountings.len() } else { 1 });
    let mut foot_mm = around(&args.foot, own[0]);
    foot_mm.retain(|foot| *foot >= 0.0);
    let layouts = Layouts { part_mm: args.cube, foot_mm, table_mm: around(&args.table, own[1]), mountings, clearance_mm: 5.0 };
    let out = OutputFolder::prepare(folder, OutputWriter::Study("reach"), &["reach.csv", "reach.svg"])?;
    let progress = Progress::start(&Course::default());
    let found = pool(args.threads)?.install(|| reach(&cell, &layouts, &Context::new(cancel, &progress)));
    // The seconds of the stages are not a result.
    let _ = progress.finish();
    let found = found.map_err(|cancelled| super::plan::to_cli_error(PlanError::from(cancelled)))?;
    let results = ReachInput { layouts: &layouts, found: &found, cell_name: &cell.name };
    #[expect(clippy::float_cmp, reason = "the cell's own distances are among those compared, as they are")]
    let is_own = |layout: &&Layout| layout.mounting == 0 && [layout.foot_mm, layout.table_mm] == own;
    let files = [("reach.csv", csv(&results)), ("reach.svg", svg(&results))];
    let artifacts = files.map(|(name, text)| Artifact { name: name.into(), bytes: text.into_bytes() });
    out.replace(&artifacts, &FileOrigin::default())?;
    let words = format!("{}Map: {}\n", text(&results, found.iter().find(is_own)), folder.join("reach.svg").display());
    output::result(&document(&results, folder), words)
}

/// Table of the layouts, as `--json` prints it; `elevations`, `directions` and `hemisphere_share` are null where the cell does
/// not fit. `directions` counts those of a grid of equal angles; `hemisphere_share` is the share of solid angle that they stand
/// for.
fn document(results: &ReachInput<'_>, folder: &Path) -> Value {
    let layout = |layout: &Layout| {
        json!({
            "mounting": mounting_words(&results.layouts.mountings[layout.mounting]),
            "foot_mm": layout.foot_mm,
            "table_mm": layout.table_mm,
            "elevations": layout.reached.map(|reached| reached.elevations),
            "directions": layout.reached.map(|reached| reached.directions),
            "hemisphere_share": layout.reached.map(|reached| reached.hemisphere_share),
        })
    };
    let layouts: Vec<Value> = results.found.iter().map(layout).collect();
    let files = ["reach.csv", "reach.svg"].map(|name| folder.join(name).display().to_string());
    json!({
        "cell": results.cell_name, "elevations_of": ELEVATIONS, "directions_of": ELEVATIONS * AZIMUTHS, "layouts": layouts,
        "files": files,
    })
}

fn check_range(option: &str, values: &[f64], min_mm: f64) -> Result<(), CliError> {
    match values.iter().find(|value| !(**value >= min_mm && **value <= MAX_DISTANCE_MM)) {
        None => Ok(()),
        Some(value) => Err(CliError::BadInput(format!("{option}: is {value} mm; allowed is {min_mm} to {MAX_DISTANCE_MM} mm"))),
    }
}
