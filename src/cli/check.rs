//! `vantage check`: checks specifications, parameters, plans and programs, and names each finding with its place. The kind
//! of a file is recognised by its content.

mod plan;

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::CliError;
use super::files::{self, FileLibrary};
use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{
    Cell, CellSpec, CollisionScene, FieldError, Presets, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec,
};
use crate::geometry::{LengthUnit, Mesh, Poll};
use crate::planning::certificate::recheck;
use crate::planning::params::{PlanParams, TableMotion};
use crate::planning::plan::ViewId;
use crate::planning::{PlanInput, resting};
use crate::program::{self, Expected, Finding, Program};
use crate::wire::plan::{PLAN_SCHEMA, PlanDocument};
use crate::wire::program::{PROGRAM_SCHEMA, ProgramDocument};

/// Tolerance of the plan's clearance, mm: angles that went through a file differ from the planner's in the last digit.
const ROUNDING_MM: f64 = 0.01;

/// Check specifications, parameters, plans and programs.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage check cell.toml robot.json params.toml
  vantage check plan/plan.json plan/program.json
  vantage check plan/program.json --cell e05-transcan --plan plan/plan.json --mesh part.stl --unit mm

Without --cell only structure and ranges of a program are checked. Exit codes: 0 no findings, 2 findings.")]
pub struct CheckArgs {
    /// Files to check, TOML or JSON; the kind of each is recognised by its content.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Cell to recompute limits, times, collisions and poses with: name of a preset, or a TOML or JSON file.
    #[arg(long)]
    cell: Option<String>,
    #[command(flatten)]
    reference: ReferenceArgs,
}

/// Files that a program is checked against, besides the cell.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct ReferenceArgs {
    /// Plan that the program has to carry out.
    #[arg(long, requires = "cell")]
    pub(super) plan: Option<PathBuf>,
    /// Part, STL, OBJ or PLY: for collisions, and with --plan for the area that the scans measure.
    #[arg(long, requires = "cell")]
    pub(super) mesh: Option<PathBuf>,
    /// Fixture, in the part's coordinates and unit: for collisions.
    #[arg(long, requires = "mesh")]
    fixture: Option<PathBuf>,
    /// Unit of the meshes: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
}

/// Contents of the files of [`ReferenceArgs`].
pub(super) struct Reference {
    /// The plan.
    pub(super) plan: Option<PlanDocument>,
    /// Requirements of the plan on the program.
    pub(super) expected: Option<Expected>,
    /// The part.
    part: Option<Mesh>,
    /// The fixture that holds it.
    fixture: Option<Mesh>,
    /// The cell, with the part if there is one.
    pub(super) scene: CollisionScene,
}

/// Checks every file; prints one line for each without findings.
///
/// # Errors
/// [`CliError::BadInput`] with every finding of every file, one per line.
pub fn run(args: &CheckArgs) -> Result<(), CliError> {
    let cell = args.cell.as_deref().map(cell).transpose()?;
    let mut wrong = Vec::new();
    for path in &args.files {
        match check(path, args, cell.as_ref()) {
            Ok(what) => println!("{}: {what}", path.display()),
            Err(CliError::BadInput(findings)) => wrong.push(findings),
            Err(other) => return Err(other),
        }
    }
    if wrong.is_empty() { Ok(()) } else { Err(CliError::BadInput(wrong.join("\n"))) }
}

/// Loads a cell: a preset or a file.
pub(super) fn cell(name: &str) -> Result<Cell, CliError> {
    let spec: CellSpec = files::spec(SpecKind::Cell, name, Presets.cell(name))?;
    spec.build(&FileLibrary).map_err(|errors| files::findings(name, &errors))
}

/// Describes the file in words, if there are no findings.
fn check(path: &Path, args: &CheckArgs, cell: Option<&Cell>) -> Result<String, CliError> {
    let shown = path.display().to_string();
    let value = files::value(path)?;
    let refuse = |errors: Vec<FieldError>| files::findings(&shown, &errors);
    match kind(&value) {
        Some(Kind::Scanner) => read::<ScannerSpec>(value, &shown)?.build().map(|s| format!("scanner {}", s.name)).map_err(refuse),
        Some(Kind::Robot) => read::<RobotSpec>(value, &shown)?.build().map(|r| format!("robot {}", r.name)).map_err(refuse),
        Some(Kind::Turntable) => {
            read::<TurntableSpec>(value, &shown)?.build().map(|t| format!("turntable {}", t.name)).map_err(refuse)
        }
        Some(Kind::Cell) => {
            read::<CellSpec>(value, &shown)?.build(&FileLibrary).map(|c| format!("cell {}", c.name)).map_err(refuse)
        }
        Some(Kind::Params) => read::<PlanParams>(value, &shown)?.check().map(|()| "parameters".to_owned()).map_err(refuse),
        Some(Kind::Plan) => {
            let document: PlanDocument = read(value, &shown)?;
            plan::check(&document, cell).map_err(refuse)?;
            Ok(format!("plan with {} viewpoints{}", document.viewpoints.len(), depth(cell)))
        }
        Some(Kind::Program) => {
            let document: ProgramDocument = read(value, &shown)?;
            let measured = check_program(&document, &shown, args, cell)?;
            let measured = measured.map_or_else(String::new, |share| {
                format!("; its scans measure {:.2} % of the asked area, as planned", 100.0 * share)
            });
            Ok(format!("program with {} steps, {:.1} s{}{measured}", document.steps.len(), document.cycle_secs, depth(cell)))
        }
        None => Err(CliError::BadInput(format!(
            "{shown}: is neither a scanner, robot, turntable or cell, nor parameters, a plan ({PLAN_SCHEMA}) or a program ({PROGRAM_SCHEMA})"
        ))),
    }
}

fn read<T: DeserializeOwned>(value: Value, what: &str) -> Result<T, CliError> {
    files::from_value(value, what)
}

/// Extent of the checks, in words.
fn depth(cell: Option<&Cell>) -> String {
    cell.map_or_else(
        || " (structure and ranges checked; with --cell motion too)".to_owned(),
        |cell| format!(", sound in cell {}", cell.name),
    )
}

enum Kind {
    Scanner,
    Robot,
    Turntable,
    Cell,
    Params,
    Plan,
    Program,
}

/// Recognises the kind: by the schema's name, else by a field that only this kind has, else by sections of parameters.
fn kind(value: &Value) -> Option<Kind> {
    let table = value.as_object()?;
    let has = |key: &str| table.contains_key(key);
    match table.get("schema").and_then(Value::as_str) {
        Some(PLAN_SCHEMA) => return Some(Kind::Plan),
        Some(PROGRAM_SCHEMA) => return Some(Kind::Program),
        Some(_) => return None,
        None => {}
    }
    let known = serde_json::to_value(PlanParams::default()).unwrap_or_default();
    match () {
        () if has("base_from_table") || has("flange_from_scanner") => Some(Kind::Cell),
        () if has("kinematics") || has("joints") => Some(Kind::Robot),
        () if has("plate_diameter_mm") || has("rotation") => Some(Kind::Turntable),
        () if has("depth_mm") || has("projector") => Some(Kind::Scanner),
        () if !table.is_empty() && table.keys().any(|key| known.get(key).is_some()) => Some(Kind::Params),
        () => None,
    }
}

/// Requirements of a plan with a cell on the program of a setup.
fn expected(document: &PlanDocument, plan_sha256: String, setup: usize) -> Option<Expected> {
    let cell = document.cell.as_ref()?;
    let placed = document.setups.get(setup);
    let table_from_part = placed.map_or(&cell.table_from_part, |placed| &placed.table_from_part).pose();
    let is_here = |id: u32| placed.is_none_or(|placed| placed.viewpoints.contains(&id));
    let visited = document.viewpoints.iter().filter(|view| view.station.is_some() && is_here(view.id));
    let views = visited.map(|view| (ViewId(view.id), view.part_from_scanner.pose())).collect();
    let table_alone = document.params.motion.table == TableMotion::Alone;
    Some(Expected { plan_sha256, table_from_part, table_alone, views })
}

/// Checks a program; returns the share of the asked area that its scans measure, if plan and part are given.
fn check_program(
    document: &ProgramDocument,
    shown: &str,
    args: &CheckArgs,
    cell: Option<&Cell>,
) -> Result<Option<f64>, CliError> {
    let program = document.program().map_err(|errors| files::findings(shown, &errors))?;
    let Some(cell) = cell else { return Ok(None) };
    let reference = args.reference.load(cell, document.setup)?;
    let found = program::check(&program, cell, &reference.scene, reference.expected.as_ref());
    if !found.is_empty() {
        return Err(faults(shown, &found));
    }
    let Some((measured, planned)) = reference.shares(&program, cell)? else { return Ok(None) };
    match program::off_coverage(measured, planned) {
        Some(fault) => Err(faults(shown, &[Finding { step: None, fault }])),
        None => Ok(Some(measured)),
    }
}

impl Reference {
    /// Shares of the asked area: measured by the program's scans, and stated by the plan for the setup.
    fn shares(&self, program: &Program, cell: &Cell) -> Result<Option<(f64, f64)>, CliError> {
        let (Some(plan), Some(expected), Some(part)) = (&self.plan, &self.expected, &self.part) else { return Ok(None) };
        let fixture = self.fixture.as_ref();
        let input = PlanInput {
            mesh: part,
            fixture,
            part_sha256: &plan.part.sha256,
            scanner: &cell.scanner,
            cell: Some(cell),
            roadmaps: None,
        };
        let views = program::scan_poses(program, cell, &expected.table_from_part);
        let measured = recheck::measured(&input, &plan.params, &expected.table_from_part, &views)
            .map_err(|error| CliError::BadInput(error.to_string()))?;
        let here = plan.setups.get(program.setup).map_or(plan.coverage.measured_area_mm2, |setup| setup.measured_area_mm2);
        Ok(Some((measured.measured_mm2 / measured.asked_mm2, here / plan.coverage.asked_area_mm2)))
    }
}

/// Error that lists every finding on a line of its own.
pub(super) fn faults(shown: &str, found: &[Finding]) -> CliError {
    let lines: Vec<_> = found.iter().map(|finding| format!("{shown}: {finding}")).collect();
    CliError::BadInput(lines.join("\n"))
}

impl ReferenceArgs {
    /// Reads the files, for the program of `setup`.
    pub(super) fn load(&self, cell: &Cell, setup: usize) -> Result<Reference, CliError> {
        let (plan, expected) = self.plan.as_deref().map(|path| read_plan(path, setup)).transpose()?.unzip();
        let expected = expected.flatten();
        let clearance_mm = plan.as_ref().map_or(MIN_CLEARANCE_MM, |plan| plan.params.motion.clearance_mm) - ROUNDING_MM;
        let table_from_part = expected.as_ref().map(|expected| expected.table_from_part);
        let read = |path: &PathBuf| files::mesh(path, self.unit, &Poll::never()).map(|(read, _)| read.mesh);
        let part = self.mesh.as_ref().map(read).transpose()?;
        let fixture = self.fixture.as_ref().map(read).transpose()?;
        let scene = match &part {
            None => CollisionScene::without_part(cell, clearance_mm),
            Some(part) => {
                let table_from_part = table_from_part.unwrap_or_else(|| resting(part));
                CollisionScene::new(cell, part, fixture.as_ref(), &table_from_part, clearance_mm)
            }
        };
        Ok(Reference { plan, expected, part, fixture, scene })
    }
}

fn read_plan(path: &Path, setup: usize) -> Result<(PlanDocument, Option<Expected>), CliError> {
    let shown = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?;
    let document: PlanDocument = read(files::value(path)?, &shown)?;
    let sha256 = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    let expected = expected(&document, sha256, setup);
    Ok((document, expected))
}

#[cfg(test)]
mod tests;
