//! `vantage inspect FILE`: describes a mesh, with its defects and their remedies; or describes a scanner.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::path::PathBuf;

use super::{CliError, files, inspect_scanner, output};
use crate::geometry::mesh_io::{self, Limits, MeshError, ReadMesh, detect_format};
use crate::geometry::{LengthUnit, Poll};
use crate::wire::MeshHealthReport;

/// Describe a mesh and its defects, or a scanner and its field of view.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage inspect part.stl --unit mm
  vantage inspect config/scanners/transcan-c.toml --json")]
pub struct InspectArgs {
    /// File to inspect; its format is recognised by its content.
    pub file: PathBuf,
    /// Unit of the coordinates in the mesh: mm, cm, m or inch.
    #[arg(long)]
    pub unit: Option<LengthUnit>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Report as JSON, with the unit in which the file was read.
#[derive(serde::Serialize)]
struct Inspected<'a> {
    unit: &'a str,
    #[serde(flatten)]
    health: &'a MeshHealthReport,
}

/// Prints the report of the file.
///
/// # Errors
/// [`CliError::BadInput`] if the file cannot be read, with the position in it.
pub fn run(args: &InspectArgs) -> Result<(), CliError> {
    let report = report(args)?;
    if args.json { output::bytes(report.as_bytes()) } else { output::text(report) }
}

/// Text that `run` prints.
pub(super) fn report(args: &InspectArgs) -> Result<String, CliError> {
    let bad_input = |error: &dyn std::fmt::Display| CliError::BadInput(format!("{}: {error}", args.file.display()));
    let mut file = File::open(&args.file).map_err(|error| bad_input(&error))?;
    let length_bytes = file.metadata().map_err(|error| bad_input(&error))?.len();
    let mesh = match mesh_io::read_from(&mut file, length_bytes, args.unit, &Limits::default(), &Poll::never()) {
        Ok(mesh) => mesh,
        Err(error) => return scanner_report(args).unwrap_or_else(|| Err(files::unusable_mesh(&args.file, &error))),
    };
    let report = MeshHealthReport::new(&mesh);
    if args.json {
        let json = serde_json::to_string_pretty(&Inspected { unit: mesh.unit.as_str(), health: &report })
            .map_err(|error| bad_input(&error))?;
        return Ok(json + "\n");
    }
    Ok(table(&args.file.display().to_string(), &mesh, &report))
}

/// Report of a text that is not a mesh. It is read as a scanner's specification, whose reader says what is missing.
fn scanner_report(args: &InspectArgs) -> Option<Result<String, CliError>> {
    let text = fs::read_to_string(&args.file).ok()?;
    let is_text = detect_format(text.as_bytes()) == Err(MeshError::UnknownFormat);
    let render = || inspect_scanner::render(&text, args.json);
    is_text.then(|| render().map_err(|error| CliError::BadInput(format!("{}: {error}", args.file.display()))))
}

fn table(name: &str, mesh: &ReadMesh, report: &MeshHealthReport) -> String {
    let size = mesh.health.aabb.extent_mm();
    let (min, max) = (report.bbox_mm.min, report.bbox_mm.max);
    let span = |axis: usize| format!("{:.3} … {:.3}", min[axis], max[axis]);
    let volume = report.volume_mm3.map_or("unknown (not closed, or inconsistently wound)".into(), |v| format!("{v:.1} mm³"));
    let dropped = match report.triangles_in_file - report.triangles {
        0 => String::new(),
        _ => format!(" of {} in the file", report.triangles_in_file),
    };
    let rows = [
        ("format", report.format.clone()),
        ("unit", format!("{} (1 {} = {} mm)", mesh.unit, mesh.unit, mesh.unit.mm())),
        ("size", format!("{:.3} × {:.3} × {:.3} mm", size.x, size.y, size.z)),
        ("x, y, z", format!("{}, {}, {} mm", span(0), span(1), span(2))),
        ("area", format!("{:.1} mm²", report.area_mm2)),
        ("volume", volume),
        ("triangles", format!("{}{dropped}", report.triangles)),
        ("vertices", report.vertices.to_string()),
        ("groups", mesh.mesh.groups.len().to_string()),
        ("bodies", report.bodies.to_string()),
        ("watertight", if report.watertight { "yes" } else { "no" }.into()),
    ];
    let mut text = format!("{name}\n");
    for (key, value) in rows {
        let _ = writeln!(text, "  {key:<11} {value}");
    }
    for warning in &report.warnings {
        let _ = write!(text, "  ! {}\n    → {}\n", warning.detail, warning.remedy);
    }
    if report.warnings.is_empty() {
        text.push_str("  no problems found\n");
    }
    text
}
