//! `vantage inspect FILE`: describes a mesh, with its defects and their remedies; or describes a scanner.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::plan::load_scanner;
use super::{CliError, check, files, inspect_scanner, output};
use crate::cell::{Presets, SpecKind, SpecLibrary as _, did_you_mean, preset_text};
use crate::check::kind_of;
use crate::geometry::mesh_io::{self, Limits, MeshError, ReadMesh, detect_format};
use crate::geometry::{LengthUnit, Poll};
use crate::wire::part_size::{PartSize, SizeLimits, UnitReading, size_text, unit_text};
use crate::wire::warnings::FieldWarning;
use crate::wire::words::{area_mm2, by_thousands, fixed, fixed_nonzero};
use crate::wire::{DocumentKind, MeshHealthReport, MeshNoteCode};

/// Show the size and defects of a mesh, or the field of view and measurement volume of a scanner.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage inspect part.stl
  vantage inspect part.stl --unit mm --cell e05-transcan
  vantage inspect transcan-c
  vantage inspect my-scanner.toml --json")]
pub struct InspectArgs {
    /// Mesh or scanner file to inspect, recognised by its content, or the name of a scanner preset.
    pub file: PathBuf,
    /// Unit of the coordinates in the mesh: mm, cm, m or inch [default: none; the size is printed for all four].
    #[arg(long)]
    pub unit: Option<LengthUnit>,
    /// Cell whose scanner and plate the part must fit: a preset name, or a TOML or JSON file.
    #[arg(long)]
    pub cell: Option<String>,
    /// Scanner that the part must fit, if there is no cell: a preset name, or a TOML or JSON file.
    #[arg(long, conflicts_with = "cell")]
    pub scanner: Option<String>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Report as JSON, with the unit in which the file was read, and its size in each unit.
#[derive(serde::Serialize)]
struct Inspected<'a> {
    unit: Option<&'a str>,
    readings: [UnitReading; 4],
    #[serde(flatten)]
    health: &'a MeshHealthReport,
}

/// Fields of the report that are not known without the unit.
const OF_UNIT: [&str; 3] = ["bbox_mm", "area_mm2", "volume_mm3"];

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
    if args.file.is_dir() {
        return Err(files::unreadable(&args.file, &io::Error::from(io::ErrorKind::IsADirectory)));
    }
    let mut file = match File::open(&args.file) {
        Ok(file) => file,
        Err(error) => return preset_report(args).unwrap_or_else(|| Err(unopened(&args.file, &error))),
    };
    let length_bytes = file.metadata().map_err(|error| bad_input(&error))?.len();
    let unit = args.unit.unwrap_or(LengthUnit::Millimetre);
    let mesh = match mesh_io::read_from(&mut file, length_bytes, Some(unit), &Limits::default(), &Poll::never()) {
        Ok(mesh) => mesh,
        Err(error) => return scanner_report(args).unwrap_or_else(|| Err(files::unusable_mesh(&args.file, &error))),
    };
    let mut report = MeshHealthReport::new(&mesh);
    if args.unit.is_none() {
        report.warnings.retain(|note| note.code != MeshNoteCode::UnitSuspect.as_str());
    }
    let (size, limits) = (PartSize::new(&mesh.health.aabb, unit), args.limits()?);
    let warnings =
        limits.filter(|_| args.unit.is_some()).map(|limits| size.warnings(None, &limits, "--unit")).unwrap_or_default();
    let readings = size.readings(limits.as_ref());
    if args.json {
        return json(args, readings, &report, &warnings).map_err(|error| bad_input(&error));
    }
    Ok(table(args, &mesh, &readings, &report, &warnings))
}

impl InspectArgs {
    /// Limits of the cell or scanner that is named.
    fn limits(&self) -> Result<Option<SizeLimits>, CliError> {
        match (&self.cell, &self.scanner) {
            (Some(name), _) => check::cell(name).map(|cell| Some(SizeLimits::new(&cell.scanner, Some(&cell)))),
            (None, Some(name)) => load_scanner(None, Some(name)).map(|scanner| Some(SizeLimits::new(&scanner, None))),
            (None, None) => Ok(None),
        }
    }
}

/// Report as JSON; without a unit, lengths, areas and volumes are left out.
fn json(
    args: &InspectArgs,
    readings: [UnitReading; 4],
    health: &MeshHealthReport,
    warnings: &[FieldWarning],
) -> Result<String, serde_json::Error> {
    let mut document = serde_json::to_value(Inspected { unit: args.unit.map(LengthUnit::as_str), readings, health })?;
    if let Some(fields) = document.as_object_mut().filter(|_| args.unit.is_none()) {
        fields.retain(|name, _| !OF_UNIT.contains(&name.as_str()));
    }
    if let Some(notes) = document["warnings"].as_array_mut() {
        let note = |warning: &FieldWarning| serde_json::json!({"code": warning.code, "detail": warning.detail, "remedy": warning.remedy});
        notes.extend(warnings.iter().map(note));
    }
    Ok(serde_json::to_string_pretty(&document)? + "\n")
}

/// Report of a text that is not a mesh. A file of another kind is refused with that kind and the command that takes it. Any
/// other is read as a scanner's specification, whose reader says what is missing; JSON, which may be a mesh in glTF, only if it
/// has a field that only scanners have.
fn scanner_report(args: &InspectArgs) -> Option<Result<String, CliError>> {
    let text = fs::read_to_string(&args.file).ok()?;
    if let Some(what) = files::instead_of_file(&args.file, ("a mesh or a scanner", Some(DocumentKind::Scanner))) {
        return Some(Err(CliError::BadInput(format!("{}: {what}", args.file.display()))));
    }
    let rendered = if detect_format(text.as_bytes()) == Err(MeshError::UnknownFormat) {
        inspect_scanner::render(&text, args.json)
    } else {
        let is_json = files::without_byte_order_mark(&text).trim_start().starts_with('{');
        let document = if is_json { files::value(&args.file).ok() } else { None };
        let scanner = document.filter(|document| kind_of(document) == Some(DocumentKind::Scanner))?;
        inspect_scanner::render_document(&scanner, args.json)
    };
    Some(rendered.map_err(|error| CliError::BadInput(format!("{}: {error}", args.file.display()))))
}

/// Report of a scanner preset; `None` if there is none of the name.
fn preset_report(args: &InspectArgs) -> Option<Result<String, CliError>> {
    let text = preset_text(SpecKind::Scanner, args.file.to_str()?)?;
    Some(inspect_scanner::render(text, args.json))
}

/// Error for a file that cannot be opened. What may be the name of a preset, since it names no folder and has no ending, is told the
/// presets too.
fn unopened(path: &Path, error: &io::Error) -> CliError {
    let name = path.to_str().filter(|name| Path::new(name).file_name().is_some_and(|file| file == *name));
    let name = name.filter(|_| error.kind() == io::ErrorKind::NotFound && path.extension().is_none());
    let told = files::unreadable(path, error);
    let (Some(name), CliError::BadInput(text)) = (name.filter(|name| *name != "-"), &told) else { return told };
    let others = [SpecKind::Robot, SpecKind::Turntable, SpecKind::Cell];
    if let Some(kind) = others.into_iter().find(|kind| preset_text(*kind, name).is_some()) {
        let kind = kind.as_str();
        let what = format!("it is the name of a {kind} preset, not of a scanner preset; `vantage presets {name}` prints it");
        return CliError::BadInput(format!("{text}; {what}"));
    }
    let known = Presets.names(SpecKind::Scanner);
    let question = did_you_mean(name, known.iter().map(String::as_str));
    CliError::BadInput(format!("{text}; there is no such scanner preset either; the presets are {}{question}", known.join(", ")))
}

/// Rows on the size: in the unit that is given, else in each.
fn size_rows(
    args: &InspectArgs,
    mesh: &ReadMesh,
    readings: &[UnitReading; 4],
    report: &MeshHealthReport,
) -> Vec<(String, String)> {
    if args.unit.is_none() {
        let fits = |reading: &UnitReading| match reading.fits {
            Some(true) => ", fits",
            Some(false) => ", does not fit",
            None => "",
        };
        let row =
            |reading: &UnitReading| (format!("in {}", unit_text(reading.unit)), size_text(&reading.size_mm) + fits(reading));
        let unit = ("unit".to_owned(), "not given; the size, if the file is".to_owned());
        return std::iter::once(unit).chain(readings.iter().map(row)).collect();
    }
    let size = mesh.health.aabb.extent_mm();
    let (min, max) = (report.bbox_mm.min, report.bbox_mm.max);
    let span = |axis: usize| format!("{} … {}", fixed(min[axis], 3), fixed(max[axis], 3));
    let [x, y, z] = [size.x, size.y, size.z].map(|edge_mm| fixed_nonzero(edge_mm, 3));
    let unknown = || "unknown (not closed, or inconsistently wound)".to_owned();
    let volume = report.volume_mm3.map_or_else(unknown, |mm3| format!("{} mm³", by_thousands(&fixed_nonzero(mm3, 1))));
    let rows = [
        ("unit", format!("{} (1 {} = {} mm)", mesh.unit, mesh.unit, mesh.unit.mm())),
        ("size", format!("{x} × {y} × {z} mm")),
        ("x, y, z", format!("{}, {}, {} mm", span(0), span(1), span(2))),
        ("area", format!("{} mm²", area_mm2(report.area_mm2))),
        ("volume", volume),
    ];
    rows.map(|(key, value)| (key.to_owned(), value)).into()
}

fn table(
    args: &InspectArgs,
    mesh: &ReadMesh,
    readings: &[UnitReading; 4],
    report: &MeshHealthReport,
    warnings: &[FieldWarning],
) -> String {
    let dropped = match report.triangles_in_file - report.triangles {
        0 => String::new(),
        _ => format!(" of {} in the file", report.triangles_in_file),
    };
    let counts = [
        ("triangles", format!("{}{dropped}", report.triangles)),
        ("vertices", report.vertices.to_string()),
        ("groups", mesh.mesh.groups.len().to_string()),
        ("bodies", report.bodies.to_string()),
        ("watertight", if report.watertight { "yes" } else { "no" }.into()),
    ];
    let format = [("format".to_owned(), report.format.clone())];
    let counts = counts.map(|(key, value)| (key.to_owned(), value));
    let mut text = format!("{}\n", args.file.display());
    for (key, value) in format.into_iter().chain(size_rows(args, mesh, readings, report)).chain(counts) {
        let _ = writeln!(text, "  {key:<11} {value}");
    }
    let size = warnings.iter().map(|warning| (format!("the part {}", warning.detail), &warning.remedy));
    let health = report.warnings.iter().map(|warning| (warning.detail.clone(), &warning.remedy));
    let notes: Vec<_> = size.chain(health).collect();
    for (detail, remedy) in &notes {
        let _ = write!(text, "  ! {detail}\n    → {remedy}\n");
    }
    if notes.is_empty() {
        text.push_str("  no problems found\n");
    }
    text
}
