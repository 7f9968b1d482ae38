//! `vantage check`: checks specifications, parameters, plans and programs, and names each finding with its place. The kind
//! of a file is recognised by its content.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use serde::Serialize;
use serde_json::Value;

use super::doubts;
use super::files::{self, FileLibrary};
use super::{CliError, FileFinding, output};
use crate::cell::{Cell, ControllersSpec, SpecKind};
use crate::check::{OtherPart, Present, Reference, Sound, check, check_part, check_part_of, check_plan, kind_of};
use crate::geometry::{LengthUnit, Poll};
use crate::planning::context::{Context, Silent};
use crate::service::plan_job::{PLAN_FILE, plan_sha256};
use crate::wire::part_size::{PartSize, SizeLimits};
use crate::wire::plan::PlanDocument;
use crate::wire::warnings::FieldWarning;
use crate::wire::{DocumentKind, UtcTime};

/// Temperatures that a cell may have, °C.
const TEMPERATURES_C: std::ops::RangeInclusive<f64> = -50.0..=100.0;

/// Check specifications, parameters, plans and programs.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage check cell.toml robot.json params.toml
  vantage check plan/plan.json plan/program.json
  vantage check plan/plan.json --cell e05-transcan --mesh part.stl --unit mm
  vantage check plan/program.json --cell e05-transcan --plan plan/plan.json \\
      --mesh part.stl --unit mm

Without --cell plans and programs are checked for structure and ranges only, and a program that it belongs to the plan.json \
beside it, if there is one. With --cell a plan must have been made in that cell, and its stations are recomputed: limits, poses \
and collisions. With --mesh the part is among what may collide, and the coverage that a plan states is derived anew from its \
views; a program then needs --plan, which says where the part lies. The line of a plan says what was checked and what was not. \
For an incomplete file every missing field is listed at once. Warnings, such as a tolerance finer than the scanner's noise \
allows or a home that looks like radians, are not findings unless --strict is given.

Exit codes: 0 no findings, 2 findings.")]
pub struct CheckArgs {
    /// Files to check, TOML or JSON; the kind of each is recognised by its content.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Cell to recompute limits, times, collisions, poses and coverage with: name of a preset, or a TOML or JSON file.
    #[arg(long)]
    cell: Option<String>,
    /// Treat warnings as errors.
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    reference: ReferenceArgs,
}

/// Files that plans and programs are checked against, besides the cell.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct ReferenceArgs {
    /// Plan that a program has to carry out.
    #[arg(long, requires = "cell")]
    pub(super) plan: Option<PathBuf>,
    /// Part, STL, OBJ or PLY: for collisions and for the area that scans and views measure. The plan says where it lies.
    #[arg(long, requires = "cell")]
    pub(super) mesh: Option<PathBuf>,
    /// Fixture, in the part's coordinates and unit: for collisions and for what it hides of the part.
    #[arg(long, requires = "mesh")]
    fixture: Option<PathBuf>,
    /// Unit of the meshes: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Temperature in the cell now, °C: a calibration that holds at another one alone is refused.
    #[arg(long, value_name = "C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

fn temperature(text: &str) -> Result<f64, String> {
    let celsius: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    if TEMPERATURES_C.contains(&celsius) { Ok(celsius) } else { Err("allowed is -50 to 100 °C".to_owned()) }
}

/// Checks every file; prints one line for each without findings.
///
/// # Errors
/// [`CliError::BadInput`] with every finding of every file, one per line.
pub fn run(args: &CheckArgs) -> Result<(), CliError> {
    let (cell, its_controllers) = args.cell.as_deref().map(with_its_controllers).transpose()?.unzip();
    let (reference, part) = args.reference.read()?;
    args.reference.warn_of_size(cell.as_ref(), &reference);
    let never = AtomicBool::new(false);
    let ctx = Context::new(&never, &Silent);
    let mut checked = Vec::new();
    for path in &args.files {
        let (shown, mut doubts) = (path.display().to_string(), Vec::new());
        let sound = files::spec_value(path).and_then(|mut value| {
            if kind_of(&value).is_none() && files::is_server_configuration(&value) {
                return Err(CliError::BadInput(format!("{shown}: {}", files::SERVER_CONFIGURATION)));
            }
            let controllers =
                if kind_of(&value) == Some(DocumentKind::Cell) { files::take_controllers(&mut value, &shown) } else { Ok(None) };
            if args.reference.plan.is_none() {
                refuse_stale(path, &value)?;
            }
            if let (Some(mesh), Some(file)) = (&reference.part, &part) {
                check_part_of(&value, mesh, &file.sha256).map_err(|other| file.refused(&other))?;
            }
            doubts = doubts::of_document(&value);
            doubts.extend(its_controllers.iter().flatten().find_map(|its| doubts::of_captures(its, &value)));
            if let Ok(Some(controllers)) = &controllers {
                doubts.extend(doubts::of_controllers(controllers, &value[SpecKind::Robot.as_str()]));
            }
            let checked =
                check(value, &FileLibrary, cell.as_ref(), &reference, &ctx).map_err(|errors| files::findings(&shown, &errors));
            with_controllers(checked, controllers)
        });
        let sound = sound.map(|sound| Sound { warnings: [sound.warnings, doubts].concat(), ..sound });
        checked.push(CheckedFile::new(&shown, sound, args.strict)?);
    }
    let lines: String = checked.iter().filter_map(CheckedFile::line).collect();
    let wrong: Vec<FileFinding> = checked.iter().flat_map(|file| &file.errors).cloned().collect();
    output::result(&CheckedFiles { ok: wrong.is_empty(), files: &checked }, lines)?;
    if !args.strict && !output::is_json() {
        checked.iter().for_each(|file| warn(&file.file, &file.warnings));
    }
    if wrong.is_empty() { Ok(()) } else { Err(CliError::Findings(wrong)) }
}

/// The outcome for a cell, with that for its controllers.
fn with_controllers(
    checked: Result<Sound, CliError>,
    controllers: Result<Option<ControllersSpec>, CliError>,
) -> Result<Sound, CliError> {
    match (checked, controllers) {
        (Err(CliError::Findings(mut errors)), Err(CliError::Findings(more))) => {
            errors.extend(more);
            Err(CliError::Findings(errors))
        }
        (Err(error), _) | (Ok(_), Err(error)) => Err(error),
        (Ok(mut sound), Ok(Some(spec))) => {
            let (arm, table, trigger) = (spec.arm.name(), spec.table.name(), spec.trigger.name());
            sound.description = format!("{}, controllers {arm}, {table}, trigger {trigger}", sound.description);
            Ok(sound)
        }
        (Ok(sound), Ok(None)) => Ok(sound),
    }
}

/// Outcome of every file, as `--json` prints it.
#[derive(Serialize)]
struct CheckedFiles<'a> {
    ok: bool,
    files: &'a [CheckedFile],
}

/// Outcome of a file.
#[derive(Serialize)]
struct CheckedFile {
    file: String,
    ok: bool,
    description: Option<String>,
    measured_of_asked: Option<f64>,
    warnings: Vec<FieldWarning>,
    errors: Vec<FileFinding>,
}

impl CheckedFile {
    /// Sorts what was found; with `strict` warnings are errors too.
    ///
    /// # Errors
    /// What concerns no file.
    fn new(file: &str, sound: Result<Sound, CliError>, strict: bool) -> Result<Self, CliError> {
        let wrong = |errors| Self {
            file: file.to_owned(),
            ok: false,
            description: None,
            measured_of_asked: None,
            warnings: Vec::new(),
            errors,
        };
        match sound {
            Ok(Sound { description, measured_of_asked, warnings, .. }) => {
                let errors: Vec<_> = warnings.iter().filter(|_| strict).map(|warning| error_of(file, warning)).collect();
                let (description, ok) = (Some(description), errors.is_empty());
                Ok(Self { file: file.to_owned(), ok, description, measured_of_asked, warnings, errors })
            }
            Err(CliError::Findings(errors)) => Ok(wrong(errors)),
            // The text names the file.
            Err(CliError::BadInput(text)) => {
                let detail = text.strip_prefix(&format!("{file}: ")).unwrap_or(&text).to_owned();
                Ok(wrong(vec![FileFinding { file: file.to_owned(), pointer: String::new(), detail }]))
            }
            Err(other) => Err(other),
        }
    }

    fn line(&self) -> Option<String> {
        let description = self.description.as_ref().filter(|_| self.ok)?;
        Some(format!("{}: {description}\n", self.file))
    }
}

/// A warning as an error.
fn error_of(file: &str, warning: &FieldWarning) -> FileFinding {
    let FieldWarning { pointer, detail, remedy, .. } = warning;
    FileFinding { file: file.to_owned(), pointer: pointer.clone(), detail: format!("{detail}; {remedy}") }
}

/// Refuses a program that is not made from the plan beside it.
fn refuse_stale(path: &Path, value: &Value) -> Result<(), CliError> {
    let beside = path.with_file_name(PLAN_FILE);
    if kind_of(value) != Some(DocumentKind::Program) || !beside.is_file() {
        return Ok(());
    }
    let shown = beside.display();
    let bytes = std::fs::read(&beside).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?;
    let (plan, named) = (plan_sha256(&bytes), value["plan_sha256"].as_str().unwrap_or_default());
    if plan == named {
        return Ok(());
    }
    Err(CliError::BadInput(format!(
        "{}: /plan_sha256: is made from plan {named}, not from {shown}, which is {plan}\n  → plan again, or name its plan with \
         --plan",
        path.display()
    )))
}

/// Prints warnings on fields of `what`.
pub(super) fn warn(what: &str, warnings: &[FieldWarning]) {
    for FieldWarning { pointer, detail, remedy, .. } in warnings {
        output::warning(what, pointer, detail, remedy);
    }
}

/// Loads a cell: a preset or a file.
pub(super) fn cell(name: &str) -> Result<Cell, CliError> {
    with_its_controllers(name).map(|(cell, _)| cell)
}

/// Loads a cell with the controllers that its file names.
fn with_its_controllers(name: &str) -> Result<(Cell, Option<ControllersSpec>), CliError> {
    let (spec, controllers) = files::cell(name)?;
    let cell = spec.build(&FileLibrary).map_err(|errors| files::findings(name, &errors))?;
    Ok((cell, controllers))
}

impl ReferenceArgs {
    /// Warns of a part whose size tells of a wrong unit.
    fn warn_of_size(&self, cell: Option<&Cell>, reference: &Reference) {
        if let (Some(cell), Some(part), Some(unit), Some(mesh)) = (cell, &reference.part, self.unit, &self.mesh) {
            let limits = SizeLimits::new(&cell.scanner, Some(cell));
            warn(&mesh.display().to_string(), &PartSize::new(&part.aabb(), unit).warnings(None, &limits, "--unit"));
        }
    }

    /// Reads the files, and holds them against each other.
    pub(super) fn load(&self) -> Result<Reference, CliError> {
        self.read().map(|(reference, _)| reference)
    }

    /// Reads the files as [`ReferenceArgs::load`] does, with what is known of the part's file.
    fn read(&self) -> Result<(Reference, Option<PartFile>), CliError> {
        let read = |path: &PathBuf| files::mesh(path, self.unit, &Poll::never());
        let plan = self.plan.as_deref().map(read_plan).transpose()?;
        let part = self.mesh.as_ref().map(read).transpose()?;
        let (part, file) = part
            .zip(self.mesh.clone())
            .map(|((part, sha256), path)| (part.mesh, PartFile { path, unit: part.unit, sha256 }))
            .unzip();
        if let (Some((plan, _)), Some(part), Some(file)) = (&plan, &part, &file) {
            check_part(plan, part, &file.sha256).map_err(|other| file.refused(&other))?;
        }
        let reference = Reference {
            plan,
            part,
            fixture: self.fixture.as_ref().map(read).transpose()?.map(|(fixture, _)| fixture.mesh),
            present: Present { now: Some(UtcTime::of(SystemTime::now())), temperature_c: self.temperature },
        };
        Ok((reference, file))
    }
}

/// File that the part was read from.
struct PartFile {
    path: PathBuf,
    unit: LengthUnit,
    sha256: String,
}

impl PartFile {
    /// Error for a part that is not the plan's: another file, or the file in another unit.
    fn refused(&self, other: &OtherPart) -> CliError {
        let (shown, unit) = (self.path.display(), self.unit);
        CliError::BadInput(match other {
            OtherPart::File { .. } => format!("{shown}: {other}\n  → name the mesh that was planned, or plan this one"),
            OtherPart::Size(_) => format!("{shown} (--unit {unit}): {other}\n  → give the unit that it was planned in"),
        })
    }
}

/// Reads a plan, with the SHA-256 of its file; one that is not sound says nothing of a program.
fn read_plan(path: &Path) -> Result<(PlanDocument, String), CliError> {
    let shown = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?;
    let document: PlanDocument = files::of_kind(files::value(path)?, ("a plan", Some(DocumentKind::Plan)), &shown)?;
    check_plan(&document, None).map_err(|errors| files::findings(&shown, &errors))?;
    Ok((document, plan_sha256(&bytes)))
}

#[cfg(test)]
mod plan_in_cell_tests;
#[cfg(test)]
mod plan_tests;
#[cfg(test)]
mod tests;
