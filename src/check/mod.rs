//! Checks of specifications, parameters, plans and programs, whoever wrote them. The kind of a document is recognised by its
//! content. The command line reads documents from files, the service from requests.

mod coverage;
mod plan;
mod plan_in_cell;

use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::ToSchema;

use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{
    Cell, CellSpec, CollisionScene, FieldError, PoseSpec, RobotSpec, ScannerSpec, SpecLibrary, TurntableSpec, UseConditions,
};
use crate::geometry::{Mesh, Part, Pose, Table};
use crate::planning::context::Context;
use crate::planning::params::{PlanParams, TableMotion};
use crate::planning::plan::ViewId;
use crate::program::{self, Expected, Fault, Finding, Program};
use crate::wire::calibration::use_conditions;
use crate::wire::plan::{PLAN_SCHEMA, PlanDocument, ViewpointDocument};
use crate::wire::preset::check_beside_preset;
use crate::wire::program::{PROGRAM_SCHEMA, ProgramDocument};
use crate::wire::warnings::FieldWarning;
use crate::wire::words::{counted, percent_below};
use crate::wire::{DocumentKind, UtcTime, from_value, warnings};

/// Tolerance of the plan's clearance, mm: angles that went through a file differ from the planner's in the last digit.
const ROUNDING_MM: f64 = 0.01;

/// Plan and meshes that plans and programs are checked against, besides the cell.
#[derive(Default)]
pub struct Reference {
    /// Plan that a program has to carry out, with the SHA-256 of its file, lower-case hexadecimal.
    pub plan: Option<(PlanDocument, String)>,
    /// The part, for collisions and the area that scans and views measure: the plan says where it lies.
    pub part: Option<Mesh>,
    /// The fixture that holds it, in part coordinates.
    pub fixture: Option<Mesh>,
    /// Present time and temperature of the cell.
    pub present: Present,
}

/// Time and temperature, °C, as far as they are known: against them the cell's calibration may be stale.
#[derive(Clone, Debug, Default)]
pub struct Present {
    /// Time.
    pub now: Option<UtcTime>,
    /// Temperature in the cell, °C.
    pub temperature_c: Option<f64>,
}

impl Present {
    /// Conditions of the calibration of `cell`.
    #[must_use]
    pub fn conditions(&self, cell: &Cell) -> UseConditions {
        use_conditions(cell, self.now.as_ref(), self.temperature_c)
    }
}

/// A document without findings.
#[derive(Clone, Debug, PartialEq)]
pub struct Sound {
    /// Its kind.
    pub kind: DocumentKind,
    /// Description in words.
    pub description: String,
    /// Share of the asked area that the views of a plan or the scans of a program measure, derived anew, if cell and part are
    /// given, and for a program its plan.
    pub measured_of_asked: Option<f64>,
    /// Warnings on parameters that cannot be reached, and on cells and parts that are hardly what was meant.
    pub warnings: Vec<FieldWarning>,
}

/// Checks a document. `cell` is what plans and programs are checked in; without one, only structure and ranges are. The limits
/// of parameters are held against its scanner.
///
/// # Errors
/// Every finding; at the empty pointer, what concerns the whole.
pub fn check(
    value: Value,
    library: &impl SpecLibrary,
    cell: Option<&Cell>,
    reference: &Reference,
    ctx: &Context<'_>,
) -> Result<Sound, Vec<FieldError>> {
    let Some(kind) = kind_of(&value) else {
        return Err(whole(format!(
            "{} is neither a scanner, robot, turntable or cell, nor parameters, a plan ({PLAN_SCHEMA}) or a program \
             ({PROGRAM_SCHEMA})",
            described(&value)
        )));
    };
    let (mut measured_of_asked, mut warnings) = (None, Vec::new());
    let description = match kind {
        DocumentKind::Scanner => format!("scanner {}", read::<ScannerSpec>(value)?.build()?.name),
        DocumentKind::Robot => format!("robot {}", read::<RobotSpec>(value)?.build()?.name),
        DocumentKind::Turntable => format!("turntable {}", read::<TurntableSpec>(value)?.build()?.name),
        DocumentKind::Cell => {
            let built = read::<CellSpec>(value)?.build(library)?;
            warnings = warnings::of_cell(&built, "");
            format!("cell {}", built.name)
        }
        DocumentKind::Params => {
            let params: PlanParams = from_value(&value)?;
            params.check()?;
            check_beside_preset(&value, &params)?;
            cell.map_or(Ok(()), |cell| params.check_limits(&cell.scanner))?;
            warnings = warnings::of_params(&params, "");
            "parameters".to_owned()
        }
        DocumentKind::Plan => {
            let document: PlanDocument = read(value)?;
            plan::check(&document, cell)?;
            let in_cell = cell.map(|cell| plan_in_cell::check(&document, cell, reference, ctx)).transpose()?;
            measured_of_asked = in_cell.as_ref().and_then(|in_cell| in_cell.measured_of_asked);
            warnings = warnings::of_params(&document.params, "/params");
            // The size of the part is in the plan, the unit of its file is not: what was said of it stands.
            warnings.extend(document.warnings.iter().filter(|warning| warning.pointer == "/part/bbox_mm").cloned());
            let extent = in_cell.map_or_else(|| plan_in_cell::WITHOUT_CELL.to_owned(), |in_cell| in_cell.extent);
            format!("plan with {}{extent}", counted(document.viewpoints.len(), "viewpoint"))
        }
        DocumentKind::Program => {
            let document: ProgramDocument = read(value)?;
            measured_of_asked = check_program(&document, cell, reference, ctx)?;
            let measured = measured_of_asked.map_or_else(String::new, |of_asked| measured_as_planned("scans", of_asked));
            let steps = counted(document.steps.len(), "step");
            format!("program with {steps}, {:.1} s{}{measured}", document.cycle_secs, extent(cell))
        }
    };
    Ok(Sound { kind, description, measured_of_asked, warnings })
}

/// Reads the document of a plan.
///
/// # Errors
/// The field of another shape than expected.
pub fn read_plan(value: Value) -> Result<PlanDocument, Vec<FieldError>> {
    read(value)
}

/// Checks the document of a plan; with a cell, also that the plan was made in it and its stations are at their views. Collisions
/// and coverage are left to [`check()`].
///
/// # Errors
/// Every finding.
pub fn check_plan(document: &PlanDocument, cell: Option<&Cell>) -> Result<(), Vec<FieldError>> {
    plan::check(document, cell)
}

/// Part that is not the one of the plan.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OtherPart {
    /// Another file.
    #[error("is not the part of the plan: its SHA-256 is {found}, that of the planned part {planned}")]
    File {
        /// SHA-256 of the file.
        found: String,
        /// SHA-256 in the plan.
        planned: String,
    },
    /// The file, read in another unit; what differs in words.
    #[error("{0}")]
    Size(String),
}

/// Holds a part against that of the plan. `sha256` is that of the part's file, lower-case hexadecimal.
///
/// # Errors
/// Another file, or another unit.
pub fn check_part(plan: &PlanDocument, part: &Mesh, sha256: &str) -> Result<(), OtherPart> {
    if plan.part.sha256 != sha256 {
        return Err(OtherPart::File { found: sha256.to_owned(), planned: plan.part.sha256.clone() });
    }
    plan.part.other_size(part).map_or(Ok(()), |size| Err(OtherPart::Size(size)))
}

/// Holds a part against the document that is checked, if that is a plan; as [`check_part`] otherwise.
///
/// # Errors
/// Those of [`check_part`]; never one for a document that cannot be read, which [`check()`] tells.
pub fn check_part_of(document: &Value, part: &Mesh, sha256: &str) -> Result<(), OtherPart> {
    if kind_of(document) != Some(DocumentKind::Plan) {
        return Ok(());
    }
    read_plan(document.clone()).map_or(Ok(()), |plan| check_part(&plan, part, sha256))
}

/// Max number of fields that a document of an unknown kind is described by.
const MAX_FIELDS_TOLD: usize = 6;

/// Describes a document of an unknown kind by its schema or its first fields.
fn described(value: &Value) -> String {
    let Some(fields) = value.as_object() else { return "a document that is not an object".to_owned() };
    if let Some(schema) = fields.get("schema") {
        return format!("a document of schema {schema}");
    }
    let names: Vec<&str> = fields.keys().take(MAX_FIELDS_TOLD).map(String::as_str).collect();
    match names.len() {
        0 => "an empty document".to_owned(),
        told if told < fields.len() => format!("a document with the fields {}, …", names.join(", ")),
        1 => format!("a document with the field {}", names[0]),
        _ => format!("a document with the fields {}", names.join(", ")),
    }
}

/// Recognises the kind of a document: by the schema's name, else by a field that only this kind has, else by sections of parameters.
#[must_use]
pub fn kind_of(value: &Value) -> Option<DocumentKind> {
    let table = value.as_object()?;
    let has = |key: &str| table.contains_key(key);
    match table.get("schema").and_then(Value::as_str) {
        Some(PLAN_SCHEMA) => return Some(DocumentKind::Plan),
        Some(PROGRAM_SCHEMA) => return Some(DocumentKind::Program),
        Some(_) => return None,
        None => {}
    }
    let known = serde_json::to_value(PlanParams::default()).unwrap_or_default();
    match () {
        () if has("base_from_table") || has("flange_from_scanner") => Some(DocumentKind::Cell),
        () if has("kinematics") || has("joints") => Some(DocumentKind::Robot),
        () if has("plate_diameter_mm") || has("rotation") => Some(DocumentKind::Turntable),
        () if has("depth_mm") || has("projector") => Some(DocumentKind::Scanner),
        () if !table.is_empty() && table.keys().any(|key| known.get(key).is_some()) => Some(DocumentKind::Params),
        () => None,
    }
}

fn read<T: DeserializeOwned + ToSchema + 'static>(value: Value) -> Result<T, Vec<FieldError>> {
    from_value(&value)
}

/// A finding about the whole document.
fn whole(detail: String) -> Vec<FieldError> {
    vec![FieldError { pointer: String::new(), detail }]
}

/// Extent of the checks of a program, in words.
fn extent(cell: Option<&Cell>) -> String {
    cell.map_or_else(
        || " (structure and ranges checked; given a cell, motion too)".to_owned(),
        |cell| format!(", sound in cell {}", cell.name),
    )
}

/// Share of the asked area that scans or views measure, in words.
fn measured_as_planned(what: &str, of_asked: f64) -> String {
    format!("; its {what} measure {} % of the asked area, as planned", percent_below(of_asked, 1.0, 2))
}

/// Checks a program; returns the share of the asked area that its scans measure, if plan and part are given.
fn check_program(
    document: &ProgramDocument,
    cell: Option<&Cell>,
    reference: &Reference,
    ctx: &Context<'_>,
) -> Result<Option<f64>, Vec<FieldError>> {
    let program = document.program()?;
    reference.owns(&program).map_err(|finding| field_errors(&[finding]))?;
    reference.check_plan()?;
    let off_orders = reference.off_orders(&program);
    let Some(cell) = cell else { return if off_orders.is_empty() { Ok(None) } else { Err(field_errors(&off_orders)) } };
    reference.check_placed().map_err(|reason| whole(reason.to_owned()))?;
    reference.check_scanner(cell)?;
    let expected = reference.expected(document.setup);
    let scene = reference.scene(cell, expected.as_ref());
    let mut found = program::check(&program, cell, &scene, expected.as_ref());
    let stale = program::check_calibration(cell, &reference.present.conditions(cell));
    found.extend(stale.into_iter().filter(|finding| !found.contains(finding)).collect::<Vec<_>>());
    found.extend(off_orders);
    if !found.is_empty() {
        return Err(field_errors(&found));
    }
    let Some((measured, planned)) = reference.shares(&program, cell, expected.as_ref(), ctx)? else { return Ok(None) };
    match program::off_coverage(measured, planned) {
        Some(fault) => Err(field_errors(&[Finding { step: None, fault }])),
        None => Ok(Some(measured)),
    }
}

/// Findings in a program, with the pointer to the step of each.
#[must_use]
pub fn field_errors(found: &[Finding]) -> Vec<FieldError> {
    let pointer = |step: Option<usize>| step.map_or_else(String::new, |step| format!("/steps/{step}"));
    found.iter().map(|Finding { step, fault }| FieldError { pointer: pointer(*step), detail: fault.to_string() }).collect()
}

/// Number of setups of a plan, which does not list a single one.
fn setup_count(document: &PlanDocument) -> usize {
    document.setups.len().max(1)
}

/// Pose of the part in a setup of a plan; `None` where the plan says nothing of it, as with neither a cell nor several setups.
fn table_from_part(document: &PlanDocument, setup: usize) -> Option<Pose<Table, Part>> {
    let placed = document.setups.get(setup).map(|placed| &placed.table_from_part);
    placed.or(document.cell.as_ref().map(|cell| &cell.table_from_part)).map(PoseSpec::pose)
}

/// Viewpoints of a setup, each with its place in the plan.
fn views_in(document: &PlanDocument, setup: usize) -> impl Iterator<Item = (usize, &ViewpointDocument)> {
    let placed = document.setups.get(setup);
    let is_here = move |id: u32| placed.is_none_or(|placed| placed.viewpoints.contains(&id));
    document.viewpoints.iter().enumerate().filter(move |(_, view)| is_here(view.id))
}

/// Requirements of a plan with a cell on the program of a setup.
fn expected(document: &PlanDocument, plan_sha256: String, setup: usize) -> Option<Expected> {
    document.cell.as_ref()?;
    let table_from_part = table_from_part(document, setup)?;
    let visited = views_in(document, setup).filter(|(_, view)| view.station.is_some());
    let views = visited.map(|(_, view)| (ViewId(view.id), view.part_from_scanner.pose())).collect();
    let table_alone = document.params.motion.table == TableMotion::Alone;
    Some(Expected { plan_sha256, table_from_part, table_alone, views })
}

impl Reference {
    /// Refuses a program that is not one of the plan's: made from another plan, or from none that this one could be.
    ///
    /// # Errors
    /// The finding; never one without a plan.
    pub fn owns(&self, program: &Program) -> Result<(), Finding> {
        let Some((plan, sha256)) = &self.plan else { return Ok(()) };
        let setups = setup_count(plan);
        let fault = match () {
            () if program.plan_sha256 != *sha256 => {
                Fault::OtherPlan { program: program.plan_sha256.clone(), plan: sha256.clone() }
            }
            () if plan.cell.is_none() => Fault::PlanWithoutCell,
            () if program.setup >= setups => Fault::NoSuchSetup { setup: program.setup + 1, setups },
            () => return Ok(()),
        };
        Err(Finding { step: None, fault })
    }

    /// Holds the plan against itself: with poses that are none, or a negative clearance, nothing would be found to collide. Findings
    /// name their place in the plan.
    fn check_plan(&self) -> Result<(), Vec<FieldError>> {
        let found = self.plan.as_ref().and_then(|(plan, _)| check_plan(plan, None).err()).unwrap_or_default();
        let told = |FieldError { pointer, detail }: FieldError| format!("the plan that it is held against: {pointer}: {detail}");
        let errors: Vec<_> = found.into_iter().flat_map(|error| whole(told(error))).collect();
        if errors.is_empty() { Ok(()) } else { Err(errors) }
    }

    /// Refuses a part without the plan, which alone says where it lies.
    ///
    /// # Errors
    /// The reason.
    pub fn check_placed(&self) -> Result<(), &'static str> {
        if self.part.is_none() || self.plan.is_some() {
            return Ok(());
        }
        Err("is to be checked with the part, but without its plan, which says where the part lies; give the plan too")
    }

    /// Findings on speed, settling and captures of a program that are not as the plan orders them; none without a plan.
    #[must_use]
    pub fn off_orders(&self, program: &Program) -> Vec<Finding> {
        let Some((plan, _)) = &self.plan else { return Vec::new() };
        let usual = plan.params.scan.brightness.usual_level();
        let levels =
            |view: &ViewpointDocument| view.exposure.as_ref().map_or_else(|| vec![usual], |exposure| exposure.levels.clone());
        let levels = plan.viewpoints.iter().map(|view| (ViewId(view.id), levels(view))).collect();
        program.check_orders(&plan.params, &levels)
    }

    /// Holds the scanner of the cell against that of the plan.
    ///
    /// # Errors
    /// Fields in which they differ; never one without a plan.
    pub fn check_scanner(&self, cell: &Cell) -> Result<(), Vec<FieldError>> {
        let differences = self.plan.as_ref().map(|(plan, _)| plan.scanner_differences(&cell.scanner)).unwrap_or_default();
        if differences.is_empty() { Ok(()) } else { Err(differences) }
    }

    /// Requirements of the plan on the program of a setup.
    #[must_use]
    pub fn expected(&self, setup: usize) -> Option<Expected> {
        self.plan.as_ref().and_then(|(plan, sha256)| expected(plan, sha256.clone(), setup))
    }

    /// The cell, with the part if there is one and the plan says where it lies.
    #[must_use]
    pub fn scene(&self, cell: &Cell, expected: Option<&Expected>) -> CollisionScene {
        let clearance_mm = self.plan.as_ref().map_or(MIN_CLEARANCE_MM, |(plan, _)| plan.params.motion.clearance_mm);
        self.scene_with(cell, clearance_mm, expected.map(|expected| &expected.table_from_part))
    }

    /// The cell, with the part if there is one and it is known where it lies. Bodies keep a clearance, less what a file loses.
    fn scene_with(&self, cell: &Cell, clearance_mm: f64, table_from_part: Option<&Pose<Table, Part>>) -> CollisionScene {
        let clearance_mm = clearance_mm - ROUNDING_MM;
        match self.part.as_ref().zip(table_from_part) {
            None => CollisionScene::without_part(cell, clearance_mm),
            Some((part, table_from_part)) => {
                CollisionScene::new(cell, part, self.fixture.as_ref(), table_from_part, clearance_mm)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use serde_json::json;

    use super::*;
    use crate::cell::Presets;
    use crate::planning::context::Silent;

    #[test]
    fn a_program_of_one_step_and_a_share_below_the_whole_are_told_as_such() {
        let program = json!({
            "schema": PROGRAM_SCHEMA, "plan_sha256": "00".repeat(32), "robot": "hans-e05", "turntable": "minas-a6-500",
            "home_deg": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "cycle_secs": 0.0,
            "steps": [{"op": "move_joints", "joints_deg": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "table_angle_deg": 0.0, "speed_fraction": 1.0, "via": [],
                       "duration_secs": 0.0}],
        });
        let never = AtomicBool::new(false);
        let sound = check(program, &Presets, None, &Reference::default(), &Context::new(&never, &Silent)).expect("sound");
        assert!(sound.description.starts_with("program with 1 step, 0.0 s"), "{}", sound.description);
        assert_eq!(measured_as_planned("scans", 0.999_99), "; its scans measure 99.99 % of the asked area, as planned");
    }
}
