//! `vantage calibrate part`: where the part lies on the table.

use std::path::PathBuf;

use crate::cli::check::cell;
use crate::cli::files;
use crate::cli::{CliError, output};
use crate::wire::calibration::{PlacementData, PlacementDocument};
use crate::wire::json_file_bytes;
use crate::wire::words::fixed;

/// Locate the part on the table from points on it, a registered cloud, or a seat of its fixture.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  vantage calibrate part points.json --cell calibrated.toml

The method `points` takes three or more points: \
{\"method\": \"points\", \"points\": [{\"part_mm\": [0, 0, 0], \"table_mm\": [-60, -36, 0]}, …]}.")]
pub(super) struct CalibratePartArgs {
    /// Measurements, TOML or JSON: {"method": "points" | "cloud" | "fixture", …}.
    data: PathBuf,
    /// Cell: a preset name, or a TOML or JSON file.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// JSON file to write the pose to; standard output has it as a --set option for `vantage plan`.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Places the part.
pub(super) fn run(args: &CalibratePartArgs) -> Result<(), CliError> {
    let shown = args.data.display().to_string();
    let data: PlacementData = files::of_kind(files::value(&args.data)?, ("measurements of a part", None), &shown)?;
    let placed = data.place(&cell(&args.cell)?).map_err(|errors| files::findings(&shown, &errors))?;
    for warning in &placed.warnings {
        output::note(format_args!("warning: {warning}"));
    }
    if let Some(path) = &args.out {
        files::write(path, &json_file_bytes(&placed))?;
    }
    output::result(&placed, text(&placed))
}

fn text(placed: &PlacementDocument) -> String {
    let [x, y, z] = placed.table_from_part.translation_mm.map(|mm| fixed(mm, 4));
    // Adding 0 turns −0 into 0.
    let [qx, qy, qz, qw] = placed.table_from_part.quaternion_xyzw.map(|part| part + 0.0);
    let rms = placed.rms_mm.map_or_else(String::new, |rms| format!("rms of the points {rms:.3} mm\n"));
    format!("{rms}--set part.table_from_part='{{\"translation_mm\":[{x},{y},{z}],\"quaternion_xyzw\":[{qx},{qy},{qz},{qw}]}}'\n")
}
