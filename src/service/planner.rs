//! Planning of a job, from its input to its result files: the only place that knows both jobs and planning. Runs on a
//! thread of the planning pool.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::cells::{BuiltCell, KeptCells};
use super::error::{is_read_failure, is_transient_io};
use super::hashing_reader::HashingReader;
pub use super::plan_job::Artifact;
use super::plan_job::{PlanJob, Reports};
use super::rescan_job::RescanJob;
use super::retry::Attempts;
use crate::cell::{Cell, CellSpec, FieldError, NotFound, RobotSpec, Scanner, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::mesh_io::{self, Limits, MeshError, ReadError};
use crate::geometry::{LengthUnit, Mesh, Poll};
use crate::planning::PlanError;
use crate::planning::context::{Cancelled, Context, Stage};
use crate::planning::params::PlanParams;
use crate::report::html::NoPlanReason;
use crate::wire::echo::Echo;
use crate::wire::words::no_plan_sentence;

/// The function that plans a job: [`plan_files`], or a test's replacement.
pub type Planner = Arc<dyn Fn(&JobInput, &Context<'_>) -> Result<Vec<Artifact>, JobError> + Send + Sync>;

/// A mesh in the store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshSource {
    /// Path of its file.
    pub path: PathBuf,
    /// SHA-256 of the file, lower-case hexadecimal.
    pub sha256: String,
    /// Unit of its coordinates.
    pub unit: LengthUnit,
}

/// Input of a job, with every name resolved.
#[derive(Clone, Debug, PartialEq)]
pub struct JobInput {
    /// The part.
    pub mesh: MeshSource,
    /// Name of the part in reports.
    pub part_name: String,
    /// Fixture that holds the part.
    pub fixture: Option<MeshSource>,
    /// The cell, with its scanner, robot and turntable inlined; `None` for viewpoints only.
    pub cell: Option<CellSpec>,
    /// The scanner; the cell's own if there is a cell.
    pub scanner: ScannerSpec,
    /// Meshes of the cell's and the scanner's bodies, by name.
    pub body_meshes: BTreeMap<String, MeshSource>,
    /// Max number of triangles of a mesh.
    pub max_triangles: usize,
    /// Parameters.
    pub params: PlanParams,
    /// Fields of the request that the files echo.
    pub echo: Echo,
    /// State after scans, where views are planned for what they lack.
    pub rescan: Option<RescanJob>,
    /// Time at which the job was accepted, RFC 3339, which its report shows: every attempt gives the same files.
    pub accepted_at: Option<String>,
}

/// Reasons why a job has no results.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// The job was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// Fields of the request that contradict each other or do not suit the part.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    BadInput(Vec<FieldError>),
    /// The part does not suit plate or scanner.
    #[error("{}", .errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    PartRefused {
        /// The reasons, at the mesh.
        errors: Vec<FieldError>,
        /// Report on them.
        report: Vec<Artifact>,
    },
    /// No plan is possible.
    #[error("{reasons}")]
    NoPlan {
        /// The reasons.
        reasons: String,
        /// Report on them; may be empty.
        report: Vec<Artifact>,
    },
    /// A file of the store is missing or damaged.
    #[error("{0}")]
    Damaged(String),
    /// The disk did not give back a file of the store; another attempt may succeed, and the file is damaged if none of several does.
    #[error("{0}")]
    Unread(String),
    /// The machine is temporarily short of a resource; another attempt may succeed.
    #[error("{0}")]
    Unavailable(String),
}

impl From<Cancelled> for JobError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<PlanError> for JobError {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Cancelled => Self::Cancelled,
            PlanError::BadParams(errors) => below("/params", errors),
            PlanError::NoPlan(finding) => Self::NoPlan { reasons: no_plan_sentence(&finding), report: Vec::new() },
        }
    }
}

/// Moves findings below `pointer`, a part of the request.
fn below(pointer: &str, errors: Vec<FieldError>) -> JobError {
    JobError::BadInput(errors.into_iter().map(|error| error.below(pointer)).collect())
}

/// Pause before a file that could not be read is read again.
const READ_RETRY: Duration = Duration::from_millis(500);
/// Number of times that a disk may fail to give back a file, which is damaged then: ten seconds of pauses.
const MAX_READ_FAILURES: u32 = 20;

impl MeshSource {
    /// Reads the mesh and checks the file's hash, until `stop` returns true.
    ///
    /// # Errors
    /// [`JobError::Damaged`], [`JobError::Unread`], [`JobError::Unavailable`], [`JobError::Cancelled`], and [`JobError::BadInput`] at
    /// `pointer`.
    pub fn read(&self, pointer: &str, max_triangles: usize, stop: &dyn Fn() -> bool) -> Result<Mesh, JobError> {
        let (poll, limits) = (Poll::new(stop), Limits { max_triangles });
        let unread = |error: io::Error| read_error(&format!("mesh {}", self.sha256), &error);
        let file = File::open(&self.path).map_err(unread)?;
        let length_bytes = file.metadata().map_err(unread)?.len();
        let mut file = HashingReader::new(file);
        let read = mesh_io::read_from(&mut file, length_bytes, Some(self.unit), &limits, &poll);
        let sha256 = file.finish(&poll).map_err(unread)?.ok_or(JobError::Cancelled)?;
        if sha256 != self.sha256 {
            let reason = "is damaged; upload the same file again and start another job";
            return Err(JobError::Damaged(format!("the stored file of mesh {} {reason}", self.sha256)));
        }
        match read {
            Ok(read) => Ok(read.mesh),
            Err(ReadError::Io(error)) => Err(unread(error)),
            Err(ReadError::Mesh(MeshError::Interrupted)) => Err(JobError::Cancelled),
            Err(ReadError::Mesh(error)) => {
                Err(JobError::BadInput(vec![FieldError { pointer: pointer.to_owned(), detail: error.to_string() }]))
            }
        }
    }
}

/// Error of a stored file, which `what` names, that could not be read.
pub(super) fn read_error(what: &str, error: &io::Error) -> JobError {
    let reason = format!("{what}: {error}");
    if is_read_failure(error) {
        JobError::Unread(reason)
    } else if is_transient_io(error) {
        JobError::Unavailable(reason)
    } else {
        JobError::Damaged(reason)
    }
}

/// Reads a file of a running job, and again while it cannot be read: until the job is cancelled where the process is out of file
/// descriptors, since nobody's job fails of that; [`MAX_READ_FAILURES`] times at most where the disk fails, since others wait.
pub(super) fn read_with_retry<T>(read: impl Fn() -> Result<T, JobError>, stop: &dyn Fn() -> bool) -> Result<T, JobError> {
    read_again(read, stop, &|| std::thread::sleep(READ_RETRY))
}

fn read_again<T>(read: impl Fn() -> Result<T, JobError>, stop: &dyn Fn() -> bool, pause: &dyn Fn()) -> Result<T, JobError> {
    let (mut failures, mut attempts) = (0, Attempts::new());
    loop {
        let reason = match read() {
            Err(JobError::Unread(reason)) => {
                failures += 1;
                if failures == MAX_READ_FAILURES {
                    let advice = "upload the same file again and start over";
                    return Err(JobError::Damaged(format!("{reason}, in each of {failures} attempts; {advice}")));
                }
                reason
            }
            Err(JobError::Unavailable(reason)) => reason,
            read => return read,
        };
        if stop() {
            return Err(JobError::Cancelled);
        }
        if let Some(failed) = attempts.count_failed(Instant::now()) {
            tracing::warn!(failed, reason, "a file cannot be read at the moment; retrying");
        }
        pause();
    }
}

/// The function that reads a mesh of a job; an error of the request is at the pointer.
type MeshReader<'a> = dyn Fn(&MeshSource, &str) -> Result<Mesh, JobError> + 'a;

/// Meshes of a job.
pub(super) struct JobMeshes {
    pub(super) mesh: Mesh,
    pub(super) fixture: Option<Mesh>,
}

/// Hardware of a job.
pub(super) enum JobHardware {
    Cell(Arc<BuiltCell>),
    Scanner(Box<Scanner>),
}

impl JobHardware {
    pub(super) fn cell(&self) -> Option<&Cell> {
        if let Self::Cell(built) = self { Some(&built.cell) } else { None }
    }

    pub(super) fn scanner(&self) -> &Scanner {
        match self {
            Self::Cell(built) => &built.cell.scanner,
            Self::Scanner(scanner) => scanner,
        }
    }
}

/// Reads the meshes of a running job and builds its cell, or takes it from `cells`, until `stop` returns true.
pub(super) fn opened(input: &JobInput, cells: &KeptCells, stop: &dyn Fn() -> bool) -> Result<(JobMeshes, JobHardware), JobError> {
    let read = |source: &MeshSource, pointer: &str| read_with_retry(|| source.read(pointer, input.max_triangles, stop), stop);
    opened_with(&read, input, cells)
}

/// Reads the meshes of a job with `read` and builds its cell, or takes it from `cells`.
pub(super) fn opened_with(
    read: &MeshReader<'_>,
    input: &JobInput,
    cells: &KeptCells,
) -> Result<(JobMeshes, JobHardware), JobError> {
    let mesh = read(&input.mesh, "/mesh_id")?;
    let fixture = input.fixture.as_ref().map(|fixture| read(fixture, "/params/part/fixture_mesh")).transpose()?;
    let library = JobLibrary { input, read, unread: RefCell::default() };
    let hardware = match &input.cell {
        Some(cell) => {
            let built = cells.built(cell, &input.body_meshes, &library);
            // A file that could not be read, or not before the job was cancelled, is no error of the cell.
            if let Some(error) = library.unread.take() {
                return Err(error);
            }
            JobHardware::Cell(built.map_err(|errors| below("/cell", errors))?)
        }
        None => JobHardware::Scanner(Box::new(input.scanner.build().map_err(|errors| below("/scanner", errors))?)),
    };
    Ok((JobMeshes { mesh, fixture }, hardware))
}

/// Executes a job: reads its meshes, builds the cell, plans and renders the files. `cells` are those of earlier jobs.
///
/// # Errors
/// [`JobError`].
pub fn plan_files(input: &JobInput, cells: &KeptCells, ctx: &Context<'_>) -> Result<Vec<Artifact>, JobError> {
    let (meshes, hardware) = ctx.stage(Stage::Reading, || opened(input, cells, &|| ctx.check().is_err()))?;
    let job = PlanJob {
        mesh: &meshes.mesh,
        fixture: meshes.fixture.as_ref(),
        fixture_sha256: input.fixture.as_ref().map(|fixture| fixture.sha256.as_str()),
        part_name: input.part_name.clone(),
        part_sha256: &input.mesh.sha256,
        unit: input.mesh.unit,
        scanner: hardware.scanner(),
        cell: hardware.cell(),
        roadmaps: Some(&cells.roadmaps),
        rescan: input.rescan.as_ref(),
        params: &input.params,
        echo: input.echo.clone(),
        date: input.accepted_at.clone(),
    };
    job.execute_with_draft(ctx).map_err(|error| match error {
        PlanError::NoPlan(finding) => match job.render_no_plan(NoPlanReason::NoPlan(&finding), Reports::Html, ctx) {
            Ok(report) => JobError::NoPlan { reasons: no_plan_sentence(&finding), report },
            Err(cancelled) => PlanError::from(cancelled).into(),
        },
        PlanError::BadParams(errors) => blamed(&job, errors, ctx),
        PlanError::Cancelled => JobError::Cancelled,
    })
}

/// Error of a job for errors of its plan: at what the request gave, with a report where that is the part alone.
fn blamed(job: &PlanJob<'_>, errors: Vec<FieldError>, ctx: &Context<'_>) -> JobError {
    let is_pose_given = job.params.part.table_from_part.is_some();
    let of_part: Vec<Option<String>> = errors.iter().map(|error| job.error_of_part(error, is_pose_given)).collect();
    let faults: Vec<String> = of_part.iter().flatten().cloned().collect();
    let is_part = faults.len() == errors.len();
    let blame = |(error, of_part): (FieldError, Option<String>)| match of_part {
        Some(detail) => FieldError { pointer: "/mesh_id".to_owned(), detail },
        None => error.below("/params"),
    };
    let errors = errors.into_iter().zip(of_part).map(blame).collect();
    if !is_part {
        return JobError::BadInput(errors);
    }
    match job.render_no_plan(NoPlanReason::PartRefused(&faults), Reports::Html, ctx) {
        Ok(report) => JobError::PartRefused { errors, report },
        Err(cancelled) => PlanError::from(cancelled).into(),
    }
}

/// Library of the meshes that a job brings along. Its specifications are inlined, so that a preset that changes in a later
/// version does not change accepted jobs.
struct JobLibrary<'a> {
    input: &'a JobInput,
    read: &'a MeshReader<'a>,
    /// Error of the last mesh whose file could not be read, if any.
    unread: RefCell<Option<JobError>>,
}

impl SpecLibrary for JobLibrary<'_> {
    fn scanner(&self, _: &str) -> Result<ScannerSpec, NotFound> {
        Err(NotFound::Unknown)
    }

    fn robot(&self, _: &str) -> Result<RobotSpec, NotFound> {
        Err(NotFound::Unknown)
    }

    fn turntable(&self, _: &str) -> Result<TurntableSpec, NotFound> {
        Err(NotFound::Unknown)
    }

    fn cell(&self, _: &str) -> Result<CellSpec, NotFound> {
        Err(NotFound::Unknown)
    }

    fn mesh(&self, name: &str) -> Result<Arc<Mesh>, NotFound> {
        let source = self.input.body_meshes.get(name).ok_or(NotFound::Unknown)?;
        (self.read)(source, "/cell").map(Arc::new).map_err(|error| {
            let said = error.to_string();
            if !matches!(error, JobError::BadInput(_)) {
                self.unread.replace(Some(error));
            }
            NotFound::Unusable(said)
        })
    }

    fn names(&self, _: SpecKind) -> Vec<String> {
        Vec::new()
    }
}

#[cfg(test)]
mod tests;
