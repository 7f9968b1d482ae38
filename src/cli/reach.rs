//! `vantage study reach`: where robot, table and scanner stand best.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::plan::{load_cell, pool};
use super::progress::Progress;
use super::{CliError, out};
use crate::planning::PlanError;
use crate::planning::context::Context;
use crate::planning::studies::reach::{Layout, Layouts, mountings, own_layout, reach};
use crate::service::plan_job::Artifact;
use crate::wire::study::reach::{ReachInput, csv, svg, text};

/// Layouts on either side of the cell's own, where none are named, mm.
const AROUND_MM: [f64; 5] = [-100.0, -50.0, 0.0, 50.0, 100.0];
/// Longest distance and height, mm.
const FARTHEST_MM: f64 = 5000.0;

/// What `study reach` varies.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "For `reach`")]
pub struct ReachArgs {
    /// Edge of the cube on the plate that is looked at, mm.
    #[arg(long, default_value_t = 120.0)]
    cube: f64,
    /// Distances of the robot's foot from the table's axis, mm [default: the cell's own, and 50 and 100 either way].
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    foot: Vec<f64>,
    /// Heights of the plate above the foot, mm [default: the cell's own, and 50 and 100 either way].
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    table: Vec<f64>,
    /// Also bolt the flange to each other face of the scanner.
    #[arg(long)]
    mountings: bool,
    /// Distance of flange and scanner where it is bolted to another face, mm.
    #[arg(long, default_value_t = 30.0)]
    adapter: f64,
}

/// Runs the study.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &ReachArgs, cell_name: &str, folder: &Path, threads: u16, cancel: &AtomicBool) -> Result<(), CliError> {
    let Some(cell) = load_cell(cell_name, None)? else {
        return Err(CliError::BadInput("--cell: is none; `study reach` needs a cell, such as e05-transcan".into()));
    };
    check("--cube", &[args.cube], 1.0)?;
    check("--foot", &args.foot, 0.0)?;
    check("--table", &args.table, -FARTHEST_MM)?;
    check("--adapter", &[args.adapter], 0.0)?;
    let own = own_layout(&cell);
    let around = |given: &[f64], own: f64| if given.is_empty() { AROUND_MM.map(|by| own + by).to_vec() } else { given.to_vec() };
    let mut mountings = mountings(&cell, args.adapter);
    mountings.truncate(if args.mountings { mountings.len() } else { 1 });
    let mut foot_mm = around(&args.foot, own[0]);
    foot_mm.retain(|foot| *foot >= 0.0);
    let layouts = Layouts { part_mm: args.cube, foot_mm, table_mm: around(&args.table, own[1]), mountings, clearance_mm: 5.0 };
    out::prepare(folder)?;
    let progress = Progress::start();
    let found = pool(threads)?.install(|| reach(&cell, &layouts, &Context::new(cancel, &progress)));
    // The seconds of the stages are no finding.
    let _ = progress.finish();
    let found = found.map_err(|cancelled| super::plan::explain(PlanError::from(cancelled)))?;
    let told = ReachInput { layouts: &layouts, found: &found, cell_name: &cell.name };
    let is_own = |layout: &&Layout| layout.mounting == 0 && [layout.foot_mm, layout.table_mm] == own;
    let files = [("reach.csv", csv(&told)), ("reach.svg", svg(&told))];
    out::write(folder, &files.map(|(name, text)| Artifact { name, bytes: text.into_bytes() }))?;
    print!("{}", text(&told, found.iter().find(is_own)));
    println!("Look at {}", folder.join("reach.svg").display());
    Ok(())
}

fn check(option: &str, values: &[f64], least_mm: f64) -> Result<(), CliError> {
    match values.iter().find(|value| !(**value >= least_mm && **value <= FARTHEST_MM)) {
        None => Ok(()),
        Some(value) => Err(CliError::BadInput(format!("{option}: is {value} mm; allowed is {least_mm} to {FARTHEST_MM} mm"))),
    }
}
