//! From a job's input to its result files: the one place that knows both what a job is and what planning is. It runs
//! on a thread of the planning pool.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use super::error::is_transient_io;
use super::hashed::Hashed;
pub use super::plan_job::Artifact;
use super::plan_job::PlanJob;
use crate::cell::{CellSpec, FieldError, NotFound, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::mesh_io::{self, Limits, MeshError, ReadError};
use crate::geometry::{LengthUnit, Mesh, Poll};
use crate::planning::PlanError;
use crate::planning::context::Context;
use crate::planning::params::PlanParams;
use crate::wire::echo::Echo;

/// Plans: [`run`], or what a test puts in its place.
pub type Planner = Arc<dyn Fn(&RunInput, &Context<'_>) -> Result<Vec<Artifact>, RunError> + Send + Sync>;

/// A mesh in the store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshSource {
    /// Its file.
    pub path: PathBuf,
    /// SHA-256 of the file, lower-case hexadecimal.
    pub sha256: String,
    /// Unit of its coordinates.
    pub unit: LengthUnit,
}

/// Everything that decides what comes out of a job.
#[derive(Clone, Debug, PartialEq)]
pub struct RunInput {
    /// The part.
    pub mesh: MeshSource,
    /// Name of the part in reports.
    pub part_name: String,
    /// What holds it.
    pub fixture: Option<MeshSource>,
    /// The cell, with its scanner, robot and turntable written out; `None` for viewpoints alone.
    pub cell: Option<CellSpec>,
    /// The scanner: the cell's own, where there is a cell.
    pub scanner: ScannerSpec,
    /// Meshes that bodies of cell and scanner name.
    pub body_meshes: BTreeMap<String, MeshSource>,
    /// Most triangles of a mesh.
    pub max_triangles: usize,
    /// Parameters.
    pub params: PlanParams,
    /// What is echoed in the files.
    pub echo: Echo,
}

/// Why nothing came out.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RunError {
    /// The job was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// Fields of the request that do not fit each other or the part.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    BadInput(Vec<FieldError>),
    /// Nothing can be planned, with the reasons.
    #[error("{0}")]
    NoPlan(String),
    /// A file of the store is missing, or is not what it was.
    #[error("{0}")]
    Damaged(String),
    /// The machine is short of something for a moment; the same may succeed later.
    #[error("{0}")]
    Unavailable(String),
}

impl From<PlanError> for RunError {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Cancelled => Self::Cancelled,
            PlanError::BadParams(errors) => below("/params", errors),
            PlanError::NoPlan(reasons) => Self::NoPlan(reasons),
        }
    }
}

/// Findings of a part of the request.
fn below(pointer: &str, errors: Vec<FieldError>) -> RunError {
    let moved = errors.into_iter().map(|e| FieldError { pointer: format!("{pointer}{}", e.pointer), detail: e.detail });
    RunError::BadInput(moved.collect())
}

/// How long to wait before a file is tried again that the machine could not give for the moment.
const READ_AGAIN: Duration = Duration::from_millis(500);

impl MeshSource {
    /// Reads the mesh, and checks that the file is the one that was uploaded, until `stop` says to give up.
    ///
    /// # Errors
    /// [`RunError::Damaged`], [`RunError::Unavailable`], [`RunError::Cancelled`], and [`RunError::BadInput`] at `pointer`.
    pub fn read(&self, pointer: &str, max_triangles: usize, stop: &dyn Fn() -> bool) -> Result<Mesh, RunError> {
        let (poll, limits) = (Poll::new(stop), Limits { max_triangles });
        let unread = |error: io::Error| self.unread(&error);
        let file = File::open(&self.path).map_err(unread)?;
        let length_bytes = file.metadata().map_err(unread)?.len();
        let mut file = Hashed::new(file);
        let read = mesh_io::read_from(&mut file, length_bytes, Some(self.unit), &limits, &poll);
        let sha256 = file.finish(&poll).map_err(unread)?.ok_or(RunError::Cancelled)?;
        if sha256 != self.sha256 {
            let reason = "is not what was uploaded; upload the same file again and start another job";
            return Err(RunError::Damaged(format!("the stored file of mesh {} {reason}", self.sha256)));
        }
        match read {
            Ok(read) => Ok(read.mesh),
            Err(ReadError::Io(error)) => Err(unread(error)),
            Err(ReadError::Mesh(MeshError::Interrupted)) => Err(RunError::Cancelled),
            Err(ReadError::Mesh(error)) => {
                Err(RunError::BadInput(vec![FieldError { pointer: pointer.to_owned(), detail: error.to_string() }]))
            }
        }
    }

    fn unread(&self, error: &io::Error) -> RunError {
        let reason = format!("mesh {}: {error}", self.sha256);
        if is_transient_io(error) { RunError::Unavailable(reason) } else { RunError::Damaged(reason) }
    }

    /// Reads the mesh within a run: while the process is out of file descriptors, or the disk fails for the moment, it
    /// tries again until the job is cancelled.
    fn read_in(&self, pointer: &str, max_triangles: usize, stop: &dyn Fn() -> bool) -> Result<Mesh, RunError> {
        loop {
            match self.read(pointer, max_triangles, stop) {
                Err(RunError::Unavailable(reason)) => {
                    if stop() {
                        return Err(RunError::Cancelled);
                    }
                    tracing::warn!(reason, "a mesh cannot be read at the moment; it is tried again");
                    std::thread::sleep(READ_AGAIN);
                }
                read => return read,
            }
        }
    }
}

/// Plans a job.
///
/// # Errors
/// [`RunError`].
pub fn run(input: &RunInput, ctx: &Context<'_>) -> Result<Vec<Artifact>, RunError> {
    let stop = || ctx.check().is_err();
    let read = |source: &MeshSource, pointer: &str| source.read_in(pointer, input.max_triangles, &stop);
    let mesh = read(&input.mesh, "/mesh_id")?;
    let fixture = input.fixture.as_ref().map(|fixture| read(fixture, "/params/part/fixture_mesh")).transpose()?;
    let cell = input.cell.as_ref().map(|cell| cell.build(&RunLibrary { input, stop: &stop })).transpose();
    // A body's mesh that was given up is no fault of the cell's.
    ctx.check().map_err(PlanError::from)?;
    let cell = cell.map_err(|errors| below("/cell", errors))?;
    let scanner = match &cell {
        Some(cell) => cell.scanner.clone(),
        None => input.scanner.build().map_err(|errors| below("/scanner", errors))?,
    };
    let job = PlanJob {
        mesh: &mesh,
        fixture: fixture.as_ref(),
        part_name: input.part_name.clone(),
        part_sha256: &input.mesh.sha256,
        scanner: &scanner,
        cell: cell.as_ref(),
        params: &input.params,
        echo: input.echo.clone(),
    };
    job.run(ctx).map_err(RunError::from)
}

/// The meshes that a run brings with it. Its specifications are written out, so that a preset that changes between two
/// versions changes no accepted job.
struct RunLibrary<'a> {
    input: &'a RunInput,
    /// Returns true to give up reading.
    stop: &'a dyn Fn() -> bool,
}

impl SpecLibrary for RunLibrary<'_> {
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
        let read = source.read_in("/cell", self.input.max_triangles, self.stop);
        read.map(Arc::new).map_err(|error| NotFound::Unusable(error.to_string()))
    }

    fn names(&self, _: SpecKind) -> Vec<String> {
        Vec::new()
    }
}
