//! Order of a run: its request, held against the job, the settings and the cells of the operator; and then, on a thread that may
//! block, the program checked in the cell with the part.

use std::sync::Arc;
use std::time::SystemTime;

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::session::program_for;
use crate::cell::{Cell, CellSpec, ControllersSpec};
use crate::check::{Present, Reference, field_errors, read_plan};
use crate::execution::located::{LocateBounds, Locating, Relocate};
use crate::execution::record::RunRecord;
use crate::execution::session::{Hashes, RunJob};
use crate::planning::PlanInput;
use crate::planning::context::Context;
use crate::program::{Program, check_calibration};
use crate::service::app::App;
use crate::service::cells::KeptCells;
use crate::service::error::Error;
use crate::service::plan_job::{PLAN_FILE, program_stem};
use crate::service::planner::{JobInput, JobMeshes, opened};
use crate::service::submit::job_input;
use crate::wire::run::{RunCoverage, RunMode, RunRequest};
use crate::wire::{JobId, JobState, UtcTime, hex, parse, program::ProgramDocument};

/// A run with everything that its request names.
pub(super) struct RunOrder {
    pub(super) request: RunRequest,
    pub(super) input: JobInput,
    pub(super) cell: CellSpec,
    /// SHA-256 of the cell, all devices inlined.
    pub(super) cell_sha256: String,
    /// Controllers of the operator's cell, unless the run is simulated.
    pub(super) controllers: Option<ControllersSpec>,
    pub(super) program: Program,
    pub(super) program_sha256: String,
    plan: Vec<u8>,
}

/// A program that was found sound, with what it was checked in.
pub(super) struct CheckedOrder {
    pub(super) job: RunJob,
    pub(super) cell: Arc<Cell>,
    reference: Reference,
}

impl App {
    /// Looks up everything that a request for a run names.
    pub(super) async fn run_order(&self, request: RunRequest, token: Option<u64>) -> Result<RunOrder, Error> {
        request.check().map_err(Error::Invalid)?;
        if request.mode == RunMode::Live && !self.0.options.execution.live {
            return Err(Error::LiveDisabled);
        }
        let (job, setup) = (request.job_id, request.setup);
        let state = self.job_state(job).await?;
        if state != JobState::Succeeded {
            return Err(self.0.store.no_results(job, state).await);
        }
        let attempt = self.0.store.body(job).await?.ok_or(Error::JobNotFound(job))?;
        let input = job_input(&attempt, self.0.store.files(), self.0.options.max_triangles)?;
        let cell = input.cell.clone().ok_or(Error::NoProgram { job, setup, programs: 0 })?;
        let content_of = |mesh: &str| input.body_meshes.get(mesh).map(|source| format!("{} {}", source.sha256, source.unit));
        let cell_sha256 = cell_sha256(&cell, &content_of)?;
        let controllers = self.controllers(&cell, &cell_sha256, request.mode)?;
        if request.mode == RunMode::Live {
            self.check_token(&cell.name, token)?;
        }
        let file = format!("{}.json", program_stem(setup));
        let program = match self.result(job, &file).await {
            Ok(file) => file.read().await?,
            Err(Error::NoSuchResult { .. }) => {
                return Err(Error::NoProgram { job, setup, programs: self.programs(job).await? });
            }
            Err(error) => return Err(error),
        };
        let plan = self.result(job, PLAN_FILE).await?.read().await?;
        let program_sha256 = hex(&Sha256::digest(&program));
        let document: ProgramDocument = parse(&program)?;
        let program = document.program().map_err(Error::Invalid)?;
        check_step(request.from_step, program.steps.len())?;
        Ok(RunOrder { request, input, cell, cell_sha256, controllers, program, program_sha256, plan })
    }

    /// Number of a job's programs: one for each of its setups.
    async fn programs(&self, job: JobId) -> Result<usize, Error> {
        let files = self.0.store.job(job).await?.results;
        let is_there = |setup: &usize| {
            let name = format!("{}.json", program_stem(*setup));
            files.iter().any(|file| file.name == name)
        };
        Ok((0..).take_while(is_there).count())
    }

    /// Controllers of a job's cell: those of the operator's file whose cell is the same.
    fn controllers(&self, cell: &CellSpec, cell_sha256: &str, mode: RunMode) -> Result<Option<ControllersSpec>, Error> {
        if mode == RunMode::Simulate {
            return Ok(None);
        }
        let name = || cell.name.clone();
        let known = self.0.options.execution.cells.iter().find(|known| known.name == cell.name);
        let known = known.ok_or_else(|| Error::NoControllers { cell: name() })?;
        let is_same = known.cell_sha256 == cell_sha256;
        if is_same { Ok(Some(known.controllers.clone())) } else { Err(Error::OtherCell { cell: name() }) }
    }
}

/// SHA-256 of a cell with its devices inlined. Meshes count by what `content_of` says of them, since their names differ between a store and
/// a folder.
///
/// # Errors
/// A cell that cannot be written as JSON.
pub fn cell_sha256(cell: &CellSpec, content_of: &dyn Fn(&str) -> Option<String>) -> Result<String, serde_json::Error> {
    let mut value = serde_json::to_value(cell)?;
    name_by_content(&mut value, content_of);
    Ok(hex(&Sha256::digest(value.to_string())))
}

/// Puts the content of meshes in the place of their names.
fn name_by_content(value: &mut Value, content_of: &dyn Fn(&str) -> Option<String>) {
    match value {
        Value::Object(fields) => {
            let is_mesh = fields.get("kind").is_some_and(|kind| kind == "mesh");
            for (name, field) in fields {
                let content = field.as_str().filter(|_| is_mesh && name == "mesh").and_then(content_of);
                match content {
                    Some(content) => *field = content.into(),
                    None => name_by_content(field, content_of),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| name_by_content(item, content_of)),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}

fn check_step(from_step: usize, steps: usize) -> Result<(), Error> {
    if from_step < steps.max(1) {
        return Ok(());
    }
    let detail = format!("is {from_step}; the program has the steps 0 to {}", steps.saturating_sub(1));
    Err(Error::Invalid(vec![crate::cell::FieldError { pointer: "/from_step".to_owned(), detail }]))
}

impl RunOrder {
    /// Checks the program in its cell with its part; every finding, a sentence. Takes seconds.
    pub(super) fn check(&self, cells: &KeptCells, stop: &dyn Fn() -> bool) -> Result<CheckedOrder, String> {
        let (meshes, hardware) = opened(&self.input, cells, stop).map_err(|error| error.to_string())?;
        let cell = Arc::new(hardware.cell().ok_or("the job has no cell")?.clone());
        let JobMeshes { mesh, fixture } = meshes;
        let plan: Value = serde_json::from_slice(&self.plan).map_err(|error| format!("the stored plan: {error}"))?;
        let listed = |errors: Vec<crate::cell::FieldError>| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
        let plan = read_plan(plan).map_err(listed)?;
        let plan_sha256 = hex(&Sha256::digest(&self.plan));
        let planned_with = plan.cell.as_ref().and_then(|cell| cell.calibrated.as_ref()?.compensation_sha256.clone());
        let present = Present { now: Some(UtcTime::of(SystemTime::now())), temperature_c: self.request.temperature_c };
        let conditions = present.conditions(&cell);
        let reference = Reference { plan: Some((plan, plan_sha256.clone())), part: Some(mesh), fixture, present };
        reference.owns(&self.program).map_err(|finding| finding.to_string())?;
        let expected = reference.expected(self.program.setup);
        let scene = reference.scene(&cell, expected.as_ref());
        let approved =
            Hashes { plan: self.program.plan_sha256.clone(), cell: self.cell_sha256.clone(), compensation: planned_with };
        let compensation = cell.calibrated.as_ref().and_then(|calibrated| calibrated.compensation_sha256.clone());
        let present = Hashes { plan: plan_sha256, cell: self.cell_sha256.clone(), compensation };
        let program = program_for(self.program.clone(), (self.request.mode, self.controllers.as_ref()), (&cell, &scene))?;
        let job = RunJob::new(program, Arc::clone(&cell), &scene, expected.as_ref(), [approved, present])
            .map_err(|found| listed(field_errors(&found)))?
            .under(conditions);
        let stale = check_calibration(&cell, &conditions);
        if !stale.is_empty() {
            return Err(listed(field_errors(&stale)));
        }
        Ok(CheckedOrder { job, cell, reference })
    }
}

impl CheckedOrder {
    /// Check of the program with the part where a locating scan finds it.
    pub(super) fn locating(&self) -> Option<Arc<dyn Relocate>> {
        let Reference { plan: Some((plan, _)), part: Some(part), fixture, .. } = &self.reference else { return None };
        Some(Arc::new(Locating {
            cell: Arc::clone(&self.cell),
            part: Arc::new(part.clone()),
            fixture: fixture.clone().map(Arc::new),
            planned: self.reference.expected(self.job.program().setup)?,
            clearance_mm: plan.params.motion.clearance_mm,
            bounds: LocateBounds::default(),
            coverage: Some((plan.params.clone(), plan.part.sha256.clone())),
        }))
    }

    /// Coverage at the measured poses beside the plan's.
    pub(super) fn coverage(&self, record: &RunRecord, ctx: &Context<'_>) -> Result<Option<RunCoverage>, String> {
        coverage(&self.reference, &self.cell, self.job.program().setup, record, ctx)
    }
}

/// Coverage at the measured poses of a run beside that of the plan; `None` without plan or part, and for a run without scans.
///
/// # Errors
/// Sentence on why it cannot be evaluated.
pub fn coverage(
    reference: &Reference,
    cell: &Cell,
    setup: usize,
    record: &RunRecord,
    ctx: &Context<'_>,
) -> Result<Option<RunCoverage>, String> {
    let Reference { plan: Some((plan, _)), part: Some(part), fixture, .. } = reference else { return Ok(None) };
    let Some(expected) = reference.expected(setup).filter(|_| record.scans().next().is_some()) else { return Ok(None) };
    let input = PlanInput {
        mesh: part,
        fixture: fixture.as_ref(),
        part_sha256: &plan.part.sha256,
        scanner: &cell.scanner,
        cell: Some(cell),
        roadmaps: None,
    };
    let measured = record.measured(&input, &plan.params, cell, &expected.table_from_part, ctx);
    let measured = measured.map_err(|error| error.to_string())?;
    let planned_mm2 = plan.setups.get(setup).map_or(plan.coverage.measured_area_mm2, |setup| setup.measured_area_mm2);
    Ok(Some(RunCoverage {
        planned_of_asked: planned_mm2 / plan.coverage.asked_area_mm2,
        measured_of_asked: measured.measured_mm2 / measured.asked_mm2,
    }))
}
