//! Checks of specifications, parameters, plans and programs, whoever wrote them. The kind of a document is recognised by its
//! content. The command line reads documents from files, the service from requests.

mod beside;
mod coverage;
mod members;
mod part;
mod place;
mod plan;
mod plan_in_place;
mod program_in_cell;

use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::ToSchema;

pub use beside::{Beside, GivenBeside, GivenCell, misplaced};
pub use members::added_to_plan;
pub use part::{
    FixtureFile, FixtureIdentity, OtherFixture, OtherPart, check_fixture, check_part, check_part_of, check_told_fixture,
    planned_fixture, told_fixture,
};
pub use place::{CheckPlace, NO_CELL, implied_scanner, is_plan_without_cell};

use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{
    Cell, CellSpec, CollisionScene, FieldError, PoseSpec, RobotSpec, Scanner, ScannerSpec, SpecLibrary, TurntableSpec,
    UseConditions,
};
use crate::geometry::{Mesh, Part, Pose, Table};
use crate::planning::context::Context;
use crate::planning::params::{PlanParams, TableMotion};
use crate::planning::plan::ViewId;
use crate::program::{Expected, Fault, Finding, Program};
use crate::wire::calibration::use_conditions;
use crate::wire::plan::{PLAN_SCHEMA, PlanDocument, ViewpointDocument};
use crate::wire::preset::check_beside_preset;
use crate::wire::program::PROGRAM_SCHEMA;
use crate::wire::warnings::FieldWarning;
use crate::wire::words::percent_below;
use crate::wire::{DocumentKind, UnverifiedStatement, UtcTime, from_value, warnings};

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
    /// Kind of the document.
    pub kind: DocumentKind,
    /// Description in words.
    pub description: String,
    /// Share of the asked area that the views of a plan or the scans of a program measure, derived anew, if cell and part are
    /// given, and for a program its plan.
    pub measured_of_asked: Option<f64>,
    /// Warnings on parameters that cannot be reached, and on cells and parts that are hardly what was meant.
    pub warnings: Vec<FieldWarning>,
    /// Statements that were verified.
    pub verified: Vec<String>,
    /// Statements that were not verified, or that nothing can verify.
    pub unverified: Vec<UnverifiedStatement>,
}

impl Sound {
    /// A document of which every value was found in its range.
    fn new(kind: DocumentKind) -> Self {
        let verified = vec!["fields: each known, of its type and in its range".to_owned()];
        let (description, measured_of_asked, warnings, unverified) = Default::default();
        Self { kind, description, measured_of_asked, warnings, verified, unverified }
    }

    /// The document in these words.
    fn described(self, description: String) -> Self {
        Self { description, ..self }
    }

    /// Adds a statement that was verified.
    fn verify(&mut self, statement: impl Into<String>) {
        self.verified.push(statement.into());
    }

    /// Adds a statement that was not verified, with the reason or with what to give.
    fn leave(&mut self, statement: impl Into<String>, reason: impl Into<String>) {
        self.unverified.push(UnverifiedStatement { statement: statement.into(), reason: reason.into() });
    }
}

/// Checks a document. `place` is what plans and programs are checked in; without one, only structure and ranges are. The limits
/// of parameters are held against its scanner.
///
/// # Errors
/// Every finding; at the empty pointer, what concerns the whole.
pub fn check(
    value: Value,
    library: &impl SpecLibrary,
    place: Option<CheckPlace<'_>>,
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
    let sound = Sound::new(kind);
    match kind {
        DocumentKind::Scanner => Ok(sound.described(format!("scanner {}", read::<ScannerSpec>(value)?.build()?.name))),
        DocumentKind::Robot => Ok(sound.described(format!("robot {}", read::<RobotSpec>(value)?.build()?.name))),
        DocumentKind::Turntable => Ok(sound.described(format!("turntable {}", read::<TurntableSpec>(value)?.build()?.name))),
        DocumentKind::Cell => {
            let built = read::<CellSpec>(value)?.build(library)?;
            Ok(Sound { warnings: warnings::of_cell(&built, ""), ..sound.described(format!("cell {}", built.name)) })
        }
        DocumentKind::Params => check_params(&value, place.and_then(CheckPlace::scanner), sound),
        DocumentKind::Plan => plan_in_place::check(&value, place, reference, sound, ctx),
        DocumentKind::Program => program_in_cell::check(&value, place, reference, sound, ctx),
    }
}

/// Checks parameters; their limits against the scanner, if it is given.
fn check_params(value: &Value, scanner: Option<&Scanner>, sound: Sound) -> Result<Sound, Vec<FieldError>> {
    let params: PlanParams = from_value(value)?;
    params.check()?;
    check_beside_preset(value, &params)?;
    scanner.map_or(Ok(()), |scanner| params.check_limits(scanner))?;
    let mut sound = sound.described("parameters".to_owned());
    match scanner {
        Some(scanner) => sound.verify(format!("limits: within the own limits of scanner {}", scanner.name)),
        None => sound.leave("limits", "give the cell or the scanner that they are for"),
    }
    sound.warnings = warnings::of_params(&params, "");
    Ok(sound)
}

/// Reads a document; members that its type passes over are findings too.
fn read_known<T: DeserializeOwned + ToSchema + 'static>(value: &Value) -> Result<T, Vec<FieldError>> {
    let mut unknown = members::unknown::<T>(value);
    match from_value::<T>(value) {
        Ok(document) if unknown.is_empty() => Ok(document),
        Ok(_) => Err(unknown),
        Err(mut errors) => {
            unknown.retain(|member| errors.iter().all(|error| error.pointer != member.pointer));
            errors.extend(unknown);
            Err(errors)
        }
    }
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
    plan::check(document, cell.map(CheckPlace::Cell))
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

/// Share of the asked area that scans or views measure, in words.
fn measured_as_planned(what: &str, of_asked: f64) -> String {
    format!("; its {what} measure {} % of the asked area, as planned", percent_below(of_asked, 1.0, 2))
}

/// Findings in a program, with the pointer to the step or field of each.
#[must_use]
pub fn field_errors(found: &[Finding]) -> Vec<FieldError> {
    found.iter().map(|finding| FieldError { pointer: finding.pointer(), detail: finding.fault.to_string() }).collect()
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

    /// Finding on a program that is given the part without the fixture that its plan holds it with; `None` if nothing is lacking.
    fn lacking_fixture(&self) -> Option<FieldError> {
        let plan = self.plan.as_ref().map(|(plan, _)| plan).filter(|plan| plan.has_fixture())?;
        let name = plan.params.part.fixture_mesh.as_deref().unwrap_or_default();
        let detail = format!(
            "is to be checked with the part, but without the fixture that holds it, {name:?} (params.part.fixture_mesh of the \
             plan): what collides with it and what it hides is not known; give the fixture too"
        );
        (self.part.is_some() && self.fixture.is_none()).then(|| FieldError { pointer: String::new(), detail })
    }

    /// Part and fixture among what may collide, in words; `lacks_fixture` if the plan has one that is not given.
    fn with_part(&self, lacks_fixture: bool) -> &'static str {
        match (&self.part, &self.fixture) {
            (Some(_), Some(_)) => "with the part and its fixture",
            (Some(_), None) if lacks_fixture => "with the part, without its fixture",
            (Some(_), None) => "with the part",
            (None, _) => "without the part",
        }
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
    /// The name of another scanner, else the fields in which the two differ; never one without a plan.
    pub fn check_scanner(&self, cell: &Cell) -> Result<(), Vec<FieldError>> {
        let Some((plan, _)) = &self.plan else { return Ok(()) };
        let (planned, present) = (&plan.scanner.name, &cell.scanner.name);
        // A scanner of another name differs in everything.
        if planned != present {
            let detail = format!(
                "is {present:?} in the given cell; the plan was made with {planned:?}: give the cell that it was made in, or \
                 plan again"
            );
            return Err(vec![FieldError { pointer: "/scanner/name".to_owned(), detail }]);
        }
        let differences = plan.scanner_differences(&cell.scanner);
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
