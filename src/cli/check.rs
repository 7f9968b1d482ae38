//! `vantage check`: checks specifications, parameters, plans and programs, and names each finding with its place. The kind
//! of a file is recognised by its content.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::doubts;
use super::files::{self, FileLibrary, ForeignText};
use super::plan::{load_mesh, load_scanner};
use super::ranges::number;
use super::{CliError, FileFinding, output, presets};
use crate::cell::{Cell, ControllersSpec, Presets, Scanner, SpecKind, SpecLibrary};
use crate::check::{
    Beside, CheckPlace, FixtureFile, FixtureIdentity, GivenBeside, GivenCell, NO_CELL, OtherFixture, OtherPart, Present,
    Reference, Sound, check, check_fixture, check_part, check_part_of, check_plan, check_told_fixture, implied_scanner,
    is_plan_without_cell, kind_of, misplaced, planned_fixture, told_fixture,
};
use crate::geometry::{LengthUnit, Mesh, Poll};
use crate::planning::context::{Context, Silent};
use crate::service::plan_job::{PLAN_FILE, plan_sha256};
use crate::wire::part_size::{PartSize, SizeLimits};
use crate::wire::plan::{FixtureDocument, PlanDocument};
use crate::wire::warnings::FieldWarning;
use crate::wire::{DocumentKind, UnverifiedStatement, UtcTime, hex};

/// Program of a plan, beside the files in the languages of controllers.
const PROGRAM_FILE: &str = "program.json";
/// Beginning of the names of the programs of all setups but the first, as a plan gives them.
const LATER_PROGRAM: &str = "program-";
/// Temperatures that a cell may have, °C.
const TEMPERATURES_C: std::ops::RangeInclusive<f64> = -50.0..=100.0;

/// Check cells, devices, parameters, plans and programs, and list every error.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage check cell.toml robot.json params.toml
  vantage check plan/plan.json plan/program.json
  vantage check plan/plan.json --cell e05-transcan --mesh part.stl --unit mm
  vantage check plan/plan.json --cell none --mesh part.stl --unit mm
  vantage check plan/plan.json plan/program.json --cell e05-transcan \\
      --mesh part.stl --unit mm
  vantage check plan/program.json --cell e05-transcan --plan plan/plan.json \\
      --mesh part.stl --unit mm

Without --cell, plans and programs are checked only for structure and ranges. A program must also be made from the plan.json \
beside it, if there is one. If its plan is among the files, the program is checked against it, even without --plan.

With --cell, a plan must have been made in that cell, and its stations are recomputed: limits, poses and collisions. With \
--mesh, collisions with the part are checked too, and the coverage that a plan states is recomputed from its views, with the \
planner's engine and with a ray for every sample; a program then needs its plan, which says where the part lies. Check a plan \
made without a cell with --cell none. A fixture must be the one that the plan was made with; a program of such a plan needs the \
fixture as well as the part.

The line for a plan or program says what was checked and what was not; --json lists every statement that was verified, and every \
one that was not, with the reason. An option that applies to none of the files is refused. Missing and unknown fields and \
values of the wrong type are listed first, all of them; ranges are checked once there are none. Warnings, such as a tolerance \
too fine for the scanner's noise or a home position that looks like radians, are errors only with --strict.

Exit codes: 0 no errors; 2 errors.")]
pub struct CheckArgs {
    /// Files to check, TOML or JSON: cells, devices, parameters, plans or programs, recognised by their content; or names of
    /// presets.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Cell in which to recompute limits, times, collisions, poses and coverage: a preset name, a TOML or JSON file, or `none`
    /// for a plan that was made without a cell.
    #[arg(long)]
    cell: Option<String>,
    /// Scanner, only with `--cell none`: a preset name, or a TOML or JSON file [default: the preset that the plan names; for
    /// parameters, transcan-c].
    #[arg(long, requires = "cell")]
    scanner: Option<String>,
    /// Treat warnings as errors.
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    reference: ReferenceArgs,
}

/// Files that plans and programs are checked against, besides the cell.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct ReferenceArgs {
    /// Plan that the program was made from: its plan.json.
    #[arg(long, requires = "cell")]
    pub(super) plan: Option<PathBuf>,
    /// Part (STL, OBJ or PLY), to check collisions with it and the area measured. The plan says where it lies.
    #[arg(long, requires = "cell")]
    pub(super) mesh: Option<PathBuf>,
    /// Fixture in the part's coordinates and unit, to check collisions with it and what it hides of the part.
    #[arg(long, requires = "mesh")]
    fixture: Option<PathBuf>,
    /// Unit of the part and the fixture, required with --mesh: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Current temperature in the cell, °C, -50 to 100; a calibration that is not valid at it is refused.
    #[arg(long, value_name = "C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

fn temperature(text: &str) -> Result<f64, String> {
    let celsius = number(text)?;
    if TEMPERATURES_C.contains(&celsius) { Ok(celsius) } else { Err(format!("is {celsius}; allowed is -50 to 100 °C")) }
}

/// Checks every file; prints one line for each without findings.
///
/// # Errors
/// [`CliError::BadInput`] with every finding of every file, one per line.
pub fn run(args: &CheckArgs) -> Result<(), CliError> {
    let mut input = CheckInput::load(args)?;
    let values: Vec<Result<Value, CliError>> = args.files.iter().map(|path| value_of(path)).collect();
    input.refuse_misplaced(&values)?;
    let plans = plans_among(&args.files, &values);
    let mut checked = Vec::new();
    for (path, value) in args.files.iter().zip(values) {
        if args.reference.plan.is_none() {
            input.reference.plan = value.as_ref().ok().and_then(|value| plan_of(value, &plans)).cloned();
        }
        let sound = value.and_then(|value| input.check(path, value));
        checked.push(CheckedFile::new(&path.display().to_string(), sound, args.strict)?);
    }
    checked.extend(input.doubted_part());
    let lines: String = checked.iter().filter_map(CheckedFile::line).collect();
    let wrong: Vec<FileFinding> = checked.iter().flat_map(|file| &file.errors).cloned().collect();
    output::result(&CheckedFiles { ok: wrong.is_empty(), files: &checked }, lines)?;
    if !args.strict && !output::is_json() {
        checked.iter().for_each(|file| warn(&file.file, &file.warnings));
    }
    if wrong.is_empty() { Ok(()) } else { Err(CliError::Findings(wrong)) }
}

/// Reads a file that is to be checked, or else the preset of the name. For an HTML page, a table and the like, the error names what to
/// check instead.
fn value_of(path: &Path) -> Result<Value, CliError> {
    let name = path.to_str().filter(|_| path.symlink_metadata().is_err());
    if let Some(preset) = name.and_then(presets::value_of) {
        return Ok(preset);
    }
    files::spec_value(path).map_err(|error| {
        // A pipe cannot be read again.
        let text = if path.is_file() { std::fs::read_to_string(path).ok() } else { None };
        match (error, text.and_then(|text| files::foreign_text(path, &text))) {
            (CliError::BadInput(told), Some(found)) => CliError::BadInput(format!("{told}\n  → {}", instead_of(path, found))),
            (CliError::BadInput(told), None) => match name.and_then(presets::none_of) {
                Some(none) if !told.ends_with('?') => CliError::BadInput(format!("{told}; {none}")),
                Some(_) | None => CliError::BadInput(told),
            },
            (error, _) => error,
        }
    })
}

/// Advice on what to check in place of a text that cannot be checked: the document beside it, if there is one.
fn instead_of(path: &Path, found: ForeignText) -> String {
    let program = program_document_of(path);
    let beside = match found {
        ForeignText::ControllerProgram => Some(program.as_str()),
        ForeignText::HtmlPage | ForeignText::PlainText => Some(PLAN_FILE),
        ForeignText::Xml | ForeignText::Table => None,
    };
    let beside = beside.map(|name| path.with_file_name(name)).filter(|beside| beside.is_file());
    match (beside, found) {
        (Some(beside), _) => format!("check {}, which lies beside it", beside.display()),
        (None, ForeignText::ControllerProgram) => {
            format!("check the {program} that it was written from; `vantage plan` writes it beside its {PLAN_FILE}")
        }
        (None, ForeignText::HtmlPage | ForeignText::PlainText | ForeignText::Xml | ForeignText::Table) => {
            "give a cell, a device, parameters, a plan (plan.json) or a program (program.json)".to_owned()
        }
    }
}

/// Name of the document that a program in the language of a controller is written from: a plan names both of a setup alike.
fn program_document_of(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    if stem.starts_with(LATER_PROGRAM) { format!("{stem}.json") } else { PROGRAM_FILE.to_owned() }
}

/// Plans among the files, each with the SHA-256 of its file. One that cannot be read is told as a finding of its own.
fn plans_among(paths: &[PathBuf], values: &[Result<Value, CliError>]) -> Vec<(PlanDocument, String)> {
    let read = |(path, value): (&PathBuf, &Result<Value, CliError>)| {
        let value = value.as_ref().ok().filter(|value| kind_of(value) == Some(DocumentKind::Plan))?;
        let plan = crate::check::read_plan(value.clone()).ok()?;
        Some((plan, plan_sha256(&std::fs::read(path).ok()?)))
    };
    paths.iter().zip(values).filter_map(read).collect()
}

/// The one of `plans` that a program names; `None` for a document of another kind.
fn plan_of<'a>(value: &Value, plans: &'a [(PlanDocument, String)]) -> Option<&'a (PlanDocument, String)> {
    let is_program = kind_of(value) == Some(DocumentKind::Program);
    let named = value["plan_sha256"].as_str().filter(|_| is_program)?;
    plans.iter().find(|(_, sha256)| sha256 == named)
}

/// Everything that files are checked with.
struct CheckInput<'a> {
    args: &'a CheckArgs,
    /// The cell, if one is named; none for `none`.
    cell: Option<Cell>,
    controllers: Option<ControllersSpec>,
    /// Scanner beside `--cell none`.
    scanner: Option<Scanner>,
    reference: Reference,
    part: Option<MeshFile>,
    fixture: Option<MeshFile>,
    /// Warnings on the size of the part.
    of_size: Vec<FieldWarning>,
}

impl<'a> CheckInput<'a> {
    fn load(args: &'a CheckArgs) -> Result<Self, CliError> {
        let named = args.cell.as_deref().filter(|name| *name != NO_CELL);
        if args.scanner.is_some() && named.is_some() {
            return Err(CliError::BadInput("--scanner can only be used with --cell none; a cell has its own scanner".into()));
        }
        if let (Some(unit), None) = (args.reference.unit, &args.reference.mesh) {
            let reason = "is the unit of meshes, and none is given; give --mesh, or leave --unit out";
            return Err(CliError::BadInput(format!("--unit {unit}: {reason}")));
        }
        let (cell, controllers) = match named.map(with_its_controllers).transpose()? {
            Some((cell, controllers)) => (Some(cell), controllers),
            None => (None, None),
        };
        let scanner = args.scanner.as_deref().map(|name| load_scanner(None, Some(name))).transpose()?;
        let (reference, part, fixture) = args.reference.read()?;
        let of_size = args.reference.warnings_of_size(cell.as_ref(), &reference);
        if let Some(part) = part.as_ref().filter(|_| !args.strict) {
            warn(&part.path.display().to_string(), &of_size);
        }
        Ok(Self { args, cell, controllers, scanner, reference, part, fixture, of_size })
    }

    /// The file of a part whose size is doubted, with `--strict`, where that is an error.
    fn doubted_part(&self) -> Option<CheckedFile> {
        let part = self.part.as_ref().filter(|_| self.args.strict && !self.of_size.is_empty())?;
        let file = part.path.display().to_string();
        let errors = self.of_size.iter().map(|warning| error_of(&file, warning)).collect();
        Some(CheckedFile::wrong(&file, errors))
    }

    /// Everything that is given beside the files.
    fn given(&self) -> GivenBeside<'_> {
        let given_cell = |name: &str| if name == NO_CELL { GivenCell::NoCell } else { GivenCell::Cell };
        GivenBeside {
            cell: self.args.cell.as_deref().map(given_cell),
            plan: self.reference.plan.as_ref().map(|(plan, _)| plan),
            has_scanner: self.args.scanner.is_some(),
            has_part: self.part.is_some(),
            has_fixture: self.fixture.is_some(),
            has_temperature: self.args.reference.temperature.is_some(),
        }
    }

    /// Refuses an option that none of the files is checked with; each of several files may be checked with some of them.
    fn refuse_misplaced(&self, values: &[Result<Value, CliError>]) -> Result<(), CliError> {
        let given = self.given();
        // A file that cannot be read, or is of no known kind, is told as such.
        let of_file =
            |value: &Result<Value, CliError>| value.as_ref().map_or_else(|_| Vec::new(), |value| misplaced(value, &given));
        let mut of_files: Vec<Vec<(Beside, String)>> = values.iter().map(of_file).collect();
        let of_last = of_files.pop().unwrap_or_default();
        let is_for_none = |beside: Beside| of_files.iter().all(|of_file| of_file.iter().any(|(other, _)| *other == beside));
        match of_last.into_iter().find(|(beside, _)| is_for_none(*beside)) {
            None => self.refuse_temperature(),
            Some((beside, reason)) => Err(CliError::BadInput(format!("{}: {reason}", option_of(beside)))),
        }
    }

    /// Refuses a temperature beside a cell that has no calibration to hold against it.
    fn refuse_temperature(&self) -> Result<(), CliError> {
        let is_given = self.args.reference.temperature.is_some();
        match self.cell.as_ref().filter(|cell| is_given && cell.calibrated.is_none()) {
            None => Ok(()),
            Some(cell) => Err(CliError::BadInput(format!(
                "--temperature: does not apply: cell {} is not calibrated; leave it out, or give the calibrated cell",
                cell.name
            ))),
        }
    }

    /// Checks the document of a file.
    fn check(&self, path: &Path, mut value: Value) -> Result<Sound, CliError> {
        let shown = path.display().to_string();
        if kind_of(&value).is_none() && files::is_server_configuration(&value) {
            return Err(CliError::BadInput(format!("{shown}: {}", files::SERVER_CONFIGURATION)));
        }
        let controllers =
            if kind_of(&value) == Some(DocumentKind::Cell) { files::take_controllers(&mut value, &shown) } else { Ok(None) };
        if self.reference.plan.is_none() {
            refuse_stale(path, &value)?;
        }
        if let (Some(mesh), Some(file)) = (&self.reference.part, &self.part) {
            let of_plan = self.reference.plan.as_ref().map_or(Ok(()), |(plan, _)| check_part(plan, mesh, &file.sha256));
            of_plan.and_then(|()| check_part_of(&value, mesh, &file.sha256)).map_err(|other| file.refused(&other))?;
        }
        self.refuse_fixture(&shown, &value)?;
        let fixture = self.identity_of_fixture(&value)?;
        let doubts = self.doubts(&value, controllers.as_ref().ok().and_then(Option::as_ref));
        let is_of_plan = kind_of(&value) == Some(DocumentKind::Plan) || self.reference.plan.is_some();
        let is_part_known = self.part.is_some() && is_of_plan;
        let implied = || implied_scanner(&value, |name| Presets.scanner(name).ok()?.build().ok());
        let scanner = if self.cell.is_some() { None } else { self.scanner.clone().or_else(implied) };
        let is_without_cell = self.args.cell.is_some() || is_plan_without_cell(&value);
        let place = match &self.cell {
            Some(cell) => Some(CheckPlace::Cell(cell)),
            None => is_without_cell.then_some(CheckPlace::NoCell(scanner.as_ref())),
        };
        let never = AtomicBool::new(false);
        let ctx = Context::new(&never, &Silent);
        let checked = check(value, &FileLibrary, place, &self.reference, &ctx).map_err(|errors| files::findings(&shown, &errors));
        let mut sound = with_controllers(checked, controllers)?;
        sound.warnings.extend(doubts);
        if is_part_known {
            sound.tell_part();
        }
        fixture.into_iter().for_each(|fixture| sound.tell_fixture(fixture));
        Ok(sound)
    }

    /// Doubts about a document, and about the controllers of the cell with it; of a cell with its own `controllers`.
    fn doubts(&self, value: &Value, controllers: Option<&ControllersSpec>) -> Vec<FieldWarning> {
        let mut doubts = doubts::of_document(value);
        doubts.extend(self.controllers.iter().find_map(|its| doubts::of_captures(its, value)));
        if let Some(controllers) = controllers {
            doubts.extend(doubts::of_controllers(controllers, &value[SpecKind::Robot.as_str()]));
        }
        doubts
    }

    /// Refuses a fixture for a plan or a program without one, beside other files that have one: it would be taken for theirs.
    fn refuse_fixture(&self, shown: &str, value: &Value) -> Result<(), CliError> {
        let takes_part = matches!(kind_of(value), Some(DocumentKind::Plan | DocumentKind::Program));
        let misplaced = misplaced(value, &self.given()).into_iter().find(|(beside, _)| *beside == Beside::Fixture);
        match misplaced.filter(|_| takes_part) {
            None => Ok(()),
            Some((beside, reason)) => Err(CliError::BadInput(format!("{shown}: {} {reason}", option_of(beside)))),
        }
    }

    /// Holds the fixture against the file that the plan names; `None` if there is no fixture or no plan that names one.
    fn identity_of_fixture(&self, value: &Value) -> Result<Option<FixtureIdentity>, CliError> {
        let plan = self.reference.plan.as_ref().map(|(plan, _)| plan);
        let (Some(file), Some(fixture)) = (&self.fixture, &self.reference.fixture) else { return Ok(None) };
        let Some(name) = planned_fixture(value, plan) else { return Ok(None) };
        file.identity_of_fixture(fixture, &name, told_fixture(value, plan).as_ref()).map(Some)
    }
}

/// Reads the fixture that holds the part of a plan, with the SHA-256 of its file: the file that is given, else the one that the
/// plan names, where it can be found. `None` for a plan without a fixture.
///
/// # Errors
/// Another fixture than the plan's; one that is given for a plan without; none where the plan has one that is not found.
pub(super) fn fixture_of(
    plan: &PlanDocument,
    given: Option<&Path>,
    unit: Option<LengthUnit>,
    cancel: &AtomicBool,
) -> Result<Option<(Mesh, String)>, CliError> {
    let name = plan.params.part.fixture_mesh.as_deref();
    // What is no file may have no end.
    let planned = name.map(Path::new).filter(|path| path.is_file());
    let Some(path) = given.or(planned) else {
        return match name.or(plan.fixture.as_ref().map(|told| told.sha256.as_str())) {
            None => Ok(None),
            Some(name) => Err(CliError::BadInput(format!(
                "--fixture: is not given; the part was planned with the fixture {name:?} (params.part.fixture_mesh of the \
                 plan), which is not found here\n  → name the file of that fixture with --fixture"
            ))),
        };
    };
    if !plan.has_fixture() {
        return Err(CliError::BadInput(format!(
            "--fixture {}: the plan was made without a fixture (its params.part.fixture_mesh is null)\n  → leave --fixture \
             out, or plan with it",
            path.display()
        )));
    }
    let (read, sha256) = load_mesh(path, unit, cancel)?;
    let file = MeshFile { path: path.to_owned(), unit: read.unit, sha256 };
    file.identity_of_fixture(&read.mesh, name.unwrap_or_default(), plan.fixture.as_ref())?;
    Ok(Some((read.mesh, file.sha256)))
}

/// Option that gives something beside the files.
fn option_of(beside: Beside) -> &'static str {
    match beside {
        Beside::Cell => "--cell",
        Beside::Scanner => "--scanner",
        Beside::Plan => "--plan",
        Beside::Part => "--mesh",
        Beside::Fixture => "--fixture",
        Beside::Temperature => "--temperature",
    }
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
    verified: Vec<String>,
    unverified: Vec<UnverifiedStatement>,
    errors: Vec<FileFinding>,
}

impl CheckedFile {
    /// Sorts what was found; with `strict` warnings are errors too.
    ///
    /// # Errors
    /// Errors that concern no file.
    fn new(file: &str, sound: Result<Sound, CliError>, strict: bool) -> Result<Self, CliError> {
        match sound {
            Ok(Sound { description, measured_of_asked, warnings, verified, unverified, .. }) => {
                let errors: Vec<_> = warnings.iter().filter(|_| strict).map(|warning| error_of(file, warning)).collect();
                let (file, description, ok) = (file.to_owned(), Some(description), errors.is_empty());
                Ok(Self { file, ok, description, measured_of_asked, warnings, verified, unverified, errors })
            }
            Err(CliError::Findings(errors)) => Ok(Self::wrong(file, errors)),
            // The text names the file.
            Err(CliError::BadInput(text)) => {
                let detail = text.strip_prefix(&format!("{file}: ")).unwrap_or(&text).to_owned();
                Ok(Self::wrong(file, vec![FileFinding { file: file.to_owned(), pointer: String::new(), detail }]))
            }
            Err(other) => Err(other),
        }
    }

    fn wrong(file: &str, errors: Vec<FileFinding>) -> Self {
        Self {
            file: file.to_owned(),
            ok: false,
            description: None,
            measured_of_asked: None,
            warnings: Vec::new(),
            verified: Vec::new(),
            unverified: Vec::new(),
            errors,
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
    /// Warnings on a part whose size tells of a wrong unit.
    fn warnings_of_size(&self, cell: Option<&Cell>, reference: &Reference) -> Vec<FieldWarning> {
        let (Some(cell), Some(part), Some(unit)) = (cell, &reference.part, self.unit) else { return Vec::new() };
        PartSize::new(&part.aabb(), unit).warnings(None, &SizeLimits::new(&cell.scanner, Some(cell)), "--unit")
    }

    /// Reads the files, and holds them against each other. Beside the part of a plan with a fixture there is that fixture, the
    /// one that is given or the file that the plan names: without it the arm would be checked against less.
    pub(super) fn load(&self) -> Result<Reference, CliError> {
        let (mut reference, ..) = Self { fixture: None, ..self.clone() }.read()?;
        if let (Some((plan, _)), Some(_)) = (&reference.plan, &reference.part) {
            let fixture = fixture_of(plan, self.fixture.as_deref(), self.unit, &AtomicBool::new(false))?;
            reference.fixture = fixture.map(|(mesh, _)| mesh);
        }
        Ok(reference)
    }

    /// Reads the files that are given, with what is known of the files of part and fixture.
    fn read(&self) -> Result<(Reference, Option<MeshFile>, Option<MeshFile>), CliError> {
        let read = |path: &PathBuf| {
            let (read, sha256) = files::mesh(path, self.unit, &Poll::never())?;
            Ok::<_, CliError>((read.mesh, MeshFile { path: path.clone(), unit: read.unit, sha256 }))
        };
        let plan = self.plan.as_deref().map(read_plan).transpose()?;
        let (part, part_file) = self.mesh.as_ref().map(read).transpose()?.unzip();
        if let (Some((plan, _)), Some(part), Some(file)) = (&plan, &part, &part_file) {
            check_part(plan, part, &file.sha256).map_err(|other| file.refused(&other))?;
        }
        let (fixture, fixture_file) = self.fixture.as_ref().map(read).transpose()?.unzip();
        if let (Some((plan, _)), Some(fixture), Some(file)) = (&plan, &fixture, &fixture_file)
            && let Some(told) = &plan.fixture
        {
            let name = plan.params.part.fixture_mesh.as_deref().unwrap_or_default();
            check_told_fixture(name, told, fixture, &file.sha256).map_err(|other| file.refused_fixture(&other))?;
        }
        let present = Present { now: Some(UtcTime::of(SystemTime::now())), temperature_c: self.temperature };
        Ok((Reference { plan, part, fixture, present }, part_file, fixture_file))
    }
}

/// File that a mesh was read from.
struct MeshFile {
    path: PathBuf,
    unit: LengthUnit,
    sha256: String,
}

impl MeshFile {
    /// Holds a fixture, read from this file, against what a plan tells of its own; of a plan that tells no more than its name,
    /// against the file of that name.
    fn identity_of_fixture(
        &self,
        fixture: &Mesh,
        name: &str,
        told: Option<&FixtureDocument>,
    ) -> Result<FixtureIdentity, CliError> {
        if let Some(told) = told {
            check_told_fixture(name, told, fixture, &self.sha256).map_err(|other| self.refused_fixture(&other))?;
            return Ok(FixtureIdentity::Told);
        }
        // A plan may name anything: what is no file may have no end.
        let bytes = Path::new(name).is_file().then(|| std::fs::read(name).ok()).flatten();
        let Some(bytes) = bytes else {
            let reason = format!("the plan names the file {name:?}, which cannot be read here, and not its SHA-256");
            return Ok(FixtureIdentity::Unknown(reason));
        };
        let (found, planned) = (&self.sha256, hex(&Sha256::digest(bytes)));
        let [found, planned] = [found, &planned].map(|sha256| FixtureFile { sha256, unit: self.unit });
        check_fixture(name, found, planned).map_err(|other| self.refused_fixture(&other))?;
        Ok(FixtureIdentity::Planned(name.to_owned()))
    }

    /// Error for a fixture that is not the plan's.
    fn refused_fixture(&self, other: &OtherFixture) -> CliError {
        let shown = self.path.display();
        CliError::BadInput(format!("{shown}: {other}\n  → name the fixture that the plan was made with, or plan with this one"))
    }

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
    let bytes = std::fs::read(path).map_err(|error| files::unreadable(path, &error))?;
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
