//! From a job's input to its result files: the one place that knows both what a job is and what planning is. It runs
//! on a thread of the planning pool.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use sha2::{Digest, Sha256};

pub use super::plan_job::Artifact;
use super::plan_job::PlanJob;
use super::store::hex;
use crate::cell::{CellSpec, FieldError, NotFound, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::mesh_io::{self, Limits};
use crate::geometry::{LengthUnit, Mesh};
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
    /// A file of the store cannot be read, or is not what it was.
    #[error("{0}")]
    Damaged(String),
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

impl MeshSource {
    /// Reads the mesh, after a check that the file is the one that was uploaded.
    ///
    /// # Errors
    /// [`RunError::Damaged`], and [`RunError::BadInput`] at `pointer`.
    pub fn read(&self, pointer: &str, max_triangles: usize) -> Result<Mesh, RunError> {
        let bytes = std::fs::read(&self.path).map_err(|error| RunError::Damaged(format!("mesh {}: {error}", self.sha256)))?;
        if hex(&Sha256::digest(&bytes)) != self.sha256 {
            return Err(RunError::Damaged(format!("mesh {} is not what was uploaded", self.sha256)));
        }
        let read = mesh_io::read(&bytes, Some(self.unit), &Limits { max_triangles });
        read.map(|read| read.mesh)
            .map_err(|error| RunError::BadInput(vec![FieldError { pointer: pointer.to_owned(), detail: error.to_string() }]))
    }
}

/// Plans a job.
///
/// # Errors
/// [`RunError`].
pub fn run(input: &RunInput, ctx: &Context<'_>) -> Result<Vec<Artifact>, RunError> {
    let mesh = input.mesh.read("/mesh_id", input.max_triangles)?;
    let fixture = input.fixture.as_ref().map(|f| f.read("/params/part/fixture_mesh", input.max_triangles)).transpose()?;
    let cell = input.cell.as_ref().map(|cell| cell.build(&RunLibrary(input)));
    let cell = cell.transpose().map_err(|errors| below("/cell", errors))?;
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
pub struct RunLibrary<'a>(pub &'a RunInput);

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

    fn mesh(&self, name: &str) -> Result<Mesh, NotFound> {
        let source = self.0.body_meshes.get(name).ok_or(NotFound::Unknown)?;
        source.read("/cell", self.0.max_triangles).map_err(|error| NotFound::Unusable(error.to_string()))
    }

    fn names(&self, _: SpecKind) -> Vec<String> {
        Vec::new()
    }
}
