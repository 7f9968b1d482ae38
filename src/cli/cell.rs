//! `vantage cell`: makes a cell's specification from robot, scanner, turntable and distances.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::atomic::AtomicBool;

use super::check::warn;
use super::doubts::{self, doubt};
use super::files::{self, FileLibrary};
use super::plan::pool;
use super::ranges::number;
use super::scanner::{Triple, write_or_print};
use super::{CliError, output, spec_paths};
use crate::cell::{Cell, CellDistances, CellSpec, CollisionScene, HousingFace, SpecKind};
use crate::planning::context::{Context, Silent};
use crate::planning::params::MotionParams;
use crate::planning::studies::reach::{ELEVATIONS, Layouts, Reached, mountings, own_layout, reach};
use crate::report::sketch::cell_svg;
use crate::wire::warnings::{self, FieldWarning};
use crate::wire::words::counted;

/// Write a cell specification from robot, scanner and table position; Vantage finds home and mounting.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage cell --robot ur10e --scanner my-scanner.toml \\
      --turntable minas-a6-500 --table-at 900,0,100 --out my-cell.toml
  vantage cell --robot ur10e --scanner my-scanner.toml \\
      --turntable minas-a6-500 --table-at 900,0,100 --floor -600 --pedestal \\
      --mount back --adapter 40 --out my-cell.toml --sketch my-cell.svg
  vantage plan part.stl --unit mm --cell my-cell.toml --out plan

The origin is the robot's foot: x to its front, y to its left, z up. Without --mount, Vantage tries every face of the scanner's \
housing on the flange and takes the one with which the arm reaches the most views. Lengths are in millimetres, angles in \
degrees.

Exit codes: 0 success, 1 system error, 2 bad input, or devices that do not fit together.")]
pub struct CellArgs {
    /// Robot: a preset name, or a TOML or JSON file.
    #[arg(long)]
    robot: String,
    /// Scanner: a preset name, or a TOML or JSON file.
    #[arg(long)]
    scanner: String,
    /// Turntable: a preset name, or a TOML or JSON file.
    #[arg(long, default_value = "minas-a6-500")]
    turntable: String,
    /// Centre of the plate's upper face, measured from the robot's foot, X,Y,Z in mm, -10000 to 10000 each.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    table_at: Triple,
    /// Rotation of the plate's zero position about the table axis, degrees, -360 to 360.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, value_parser = number)]
    table_yaw: f64,
    /// Face of the scanner's housing on the flange: back, top, bottom, left or right [default: the one that reaches the most
    /// views].
    #[arg(long)]
    mount: Option<Mount>,
    /// Distance between flange and housing, mm, 0 to 1000.
    #[arg(long, value_name = "MM", default_value_t = 30.0, value_parser = number)]
    adapter: f64,
    /// Mass of the adapter, kg, 0 to 1000.
    #[arg(long, value_name = "KG", default_value_t = 0.0, value_parser = number)]
    adapter_mass: f64,
    /// Height of the floor relative to the robot's foot, mm, -10000 to 0, such as -600 [default: no floor].
    #[arg(long, value_name = "MM", allow_negative_numbers = true, value_parser = number)]
    floor: Option<f64>,
    /// Stand the robot on a pedestal of 200 mm diameter that reaches down to --floor.
    #[arg(long, requires = "floor")]
    pedestal: bool,
    /// Home position, where programs begin and end: joints 1 to 6 and table, degrees, comma-separated [default: found by
    /// Vantage].
    #[arg(long, value_name = "DEG,...", value_delimiter = ',', allow_hyphen_values = true, value_parser = number)]
    home: Vec<f64>,
    /// Name of the cell.
    #[arg(long, default_value = "my-cell")]
    name: String,
    /// Edge length of a cube on the plate, whose views are tried to compare reach, mm, 1 to 5000.
    #[arg(long, value_name = "MM", default_value_t = 120.0, value_parser = number)]
    cube: f64,
    /// TOML file to write [default: standard output].
    #[arg(long)]
    out: Option<PathBuf>,
    /// SVG sketch to write: the cell from above and from the side, with reach, table and heights.
    #[arg(long, value_name = "FILE.svg")]
    sketch: Option<PathBuf>,
}

/// Face of the housing on the flange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Mount(HousingFace);

impl FromStr for Mount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let named = HousingFace::ALL.into_iter().find(|face| face.as_str() == text.to_lowercase());
        named
            .map(Self)
            .ok_or_else(|| format!("unknown face {text:?}; use one of {}", HousingFace::ALL.map(HousingFace::as_str).join(", ")))
    }
}

/// A cell with one of the faces on the flange.
struct Mounted {
    spec: CellSpec,
    /// The cell, with the views that it reaches, or what does not fit.
    cell: Result<(Cell, Option<Reached>), CliError>,
    face: HousingFace,
}

impl CellArgs {
    fn distances(&self, mount: HousingFace) -> Result<CellDistances, CliError> {
        let home_deg = match &self.home[..] {
            [] => None,
            given => Some(given.try_into().map_err(|_| {
                CliError::BadInput(format!("--home: has {}; give 7: joints 1 to 6 and the table", counted(given.len(), "angle")))
            })?),
        };
        Ok(CellDistances {
            name: self.name.clone(),
            scanner: self.scanner.clone(),
            robot: self.robot.clone(),
            turntable: self.turntable.clone(),
            table_at_mm: self.table_at.0,
            table_yaw_deg: self.table_yaw,
            mount,
            adapter_mm: self.adapter,
            adapter_kg: self.adapter_mass,
            floor_mm: self.floor,
            pedestal: self.pedestal,
            home_deg,
        })
    }

    /// Doubts about figures that are in range.
    fn doubts(&self) -> Vec<FieldWarning> {
        let metres = [("--adapter", Some(self.adapter), 1.0), ("--floor", self.floor, 3.0)];
        let in_metres = metres.into_iter().filter_map(|(option, length, below)| {
            let length = length.filter(|length| *length != 0.0 && length.abs() < below)?;
            let in_mm = (length * 1e6).round() / 1e3;
            Some(doubt(option, format!("is {length} mm: metres?"), format!("if it is in metres, give {in_mm} (mm)")))
        });
        in_metres.chain(doubts::radians("--table-yaw", self.table_yaw)).collect()
    }

    /// The cell with a face on the flange.
    fn mounted(&self, face: HousingFace) -> Result<Mounted, CliError> {
        let distances = self.distances(face)?;
        let blamed = |errors| files::findings("cell", &distances.blamed(errors, &FileLibrary));
        let spec = distances.spec(&FileLibrary).map_err(blamed)?;
        let cell = spec.build(&FileLibrary).map_err(blamed).map(|cell| {
            let reached = self.reached(&cell);
            (cell, reached)
        });
        Ok(Mounted { spec, cell, face })
    }

    /// Views of a cube on the plate that the cell reaches.
    fn reached(&self, cell: &Cell) -> Option<Reached> {
        let [foot_mm, table_mm] = own_layout(cell);
        let mut as_it_is = mountings(cell, self.adapter);
        as_it_is.truncate(1);
        let layouts = Layouts {
            part_mm: self.cube,
            foot_mm: vec![foot_mm],
            table_mm: vec![table_mm],
            mountings: as_it_is,
            clearance_mm: MotionParams::default().clearance_mm,
        };
        let never = AtomicBool::new(false);
        let found = reach(cell, &layouts, &Context::new(&never, &Silent)).ok()?;
        found.first().and_then(|layout| layout.reached)
    }

    /// The cell with the face that is asked for, else with that which reaches most; the first that fits, of equals.
    fn best(&self) -> Result<Mounted, CliError> {
        let faces = self.mount.map_or_else(|| HousingFace::ALL.to_vec(), |Mount(face)| vec![face]);
        let all = faces.into_iter().map(|face| self.mounted(face)).collect::<Result<Vec<_>, _>>()?;
        // A face with which the home is free with the clearance of plans comes first, then the one that reaches most.
        let clearance_mm = MotionParams::default().clearance_mm;
        let is_clear = |cell: &Cell| CollisionScene::without_part(cell, clearance_mm).check(&cell.home_rad).is_none();
        let views = |mounted: &Mounted| mounted.cell.as_ref().ok().map(|(cell, reached)| (is_clear(cell), *reached));
        let best = all.into_iter().reduce(|best, other| if views(&other) > views(&best) { other } else { best });
        best.ok_or_else(|| CliError::Failed("no face was tried".into()))
    }
}

/// Writes the specification, and the sketch if one is asked for. A cell that does not fit together is sketched and not written.
///
/// # Errors
/// [`CliError::BadInput`] with everything that is out of range or does not fit; [`CliError::Failed`] if a file cannot be written.
pub fn run(args: &CellArgs) -> Result<(), CliError> {
    if !(1.0..=5000.0).contains(&args.cube) {
        return Err(CliError::BadInput(format!("--cube: is {} mm; allowed is 1 to 5000 mm", args.cube)));
    }
    warn("cell", &args.doubts());
    doubts::warn_of_file(SpecKind::Robot, &args.robot);
    doubts::warn_of_file(SpecKind::Scanner, &args.scanner);
    let Mounted { spec, cell, face } = pool(0)?.install(|| args.best())?;
    if let Some(path) = &args.sketch {
        let meant = spec.assemble(&FileLibrary).map_err(|errors| files::findings("cell", &errors))?;
        files::write(path, cell_svg(&meant).as_bytes())?;
    }
    let (cell, reached) = cell?;
    let spec = if let Some(out) = &args.out { spec_paths::named_for(&spec, out)? } else { spec };
    write_or_print(args.out.as_deref(), &spec, &text(args, &spec, face)?)?;
    let shown = args.out.as_ref().map_or_else(|| "standard output".to_owned(), |path| path.display().to_string());
    output::note(format_args!(
        "{shown}: cell {}, flange on the {} of the scanner; {}",
        cell.name,
        face.as_str(),
        reached_text(reached, args.cube)
    ));
    warn(&shown, &warnings::of_cell(&cell, ""));
    Ok(())
}

fn reached_text(reached: Option<Reached>, cube_mm: f64) -> String {
    let elevations = reached.map_or(0, |reached| reached.elevations);
    let told = format!("reaches {elevations} of {ELEVATIONS} elevations around a cube of {cube_mm} mm on the plate");
    match elevations {
        0 => format!("warning: {told}; move the table nearer, or compare layouts with `vantage study reach`"),
        few if 2 * few < ELEVATIONS => format!("{told}; `vantage study reach` compares other layouts"),
        _ => told,
    }
}

/// Obstacle to be uncommented.
const OBSTACLE_EXAMPLE: &str = "
# What the robot must not touch, in its base frame: a box, cylinder or capsule, centred on its own origin, or a mesh.
# [[obstacles]]
# name = \"cabinet\"
# owner_from_body = { translation_mm = [-900, 0, 500], rpy_deg = [0, 0, 0] }
# shape = { kind = \"box\", size_mm = [300, 600, 1000] }
";

/// The specification in TOML, with its source.
fn text(args: &CellArgs, spec: &CellSpec, face: HousingFace) -> Result<String, CliError> {
    let toml = output::toml(spec)?;
    // An empty list could not be followed by the table of an obstacle.
    let toml = toml.replacen("obstacles = []\n", "", 1);
    let [x, y, z] = args.table_at.0;
    Ok(format!(
        "# By `vantage cell`: the plate's centre at x = {x}, y = {y}, z = {z} mm from the robot's foot; the flange on the {} of the\n\
         # scanner's housing, {} mm from it. Replace flange_from_scanner by the result of your hand-eye calibration, and add the\n\
         # obstacles around the robot as shown at the end of this file. Poses may also be given as translation_mm with rpy_deg = [roll, pitch, yaw].\n\n\
         {toml}{OBSTACLE_EXAMPLE}",
        face.as_str(),
        args.adapter
    ))
}

#[cfg(test)]
mod tests;
