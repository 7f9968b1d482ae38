//! From a job's input to its result files: the one place that knows both what a job is and what planning is. It runs
//! on a thread of the planning pool.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::store::hex;
use crate::cell::{CellSpec, FieldError, Presets, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::mesh_io::{self, Limits};
use crate::geometry::{LengthUnit, Mesh};
use crate::planning::context::Context;
use crate::planning::params::PlanParams;
use crate::planning::pipeline::{self, PlanError, PlanInput};
use crate::wire::echo::Echo;
use crate::wire::plan::PlanDocument;

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

/// A file that came out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// Its name.
    pub name: &'static str,
    /// Its bytes.
    pub bytes: Vec<u8>,
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
            PlanError::BadParams(errors) => Self::BadInput(errors.into_iter().map(below_params).collect()),
            PlanError::NoPlan(reasons) => Self::NoPlan(reasons),
        }
    }
}

fn below_params(error: FieldError) -> FieldError {
    FieldError { pointer: format!("/params{}", error.pointer), detail: error.detail }
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
        read.map(|read| read.mesh).map_err(|error| {
            RunError::BadInput(vec![FieldError { pointer: pointer.to_owned(), detail: error.to_string() }])
        })
    }
}

/// Plans a job.
///
/// # Errors
/// [`RunError`].
pub fn run(input: &RunInput, ctx: &Context<'_>) -> Result<Vec<Artifact>, RunError> {
    let mesh = input.mesh.read("/mesh_id", input.max_triangles)?;
    let fixture = input.fixture.as_ref().map(|f| f.read("/params/part/fixture_mesh", input.max_triangles)).transpose()?;
    let scanner = input.scanner.build().map_err(RunError::BadInput)?;
    let plan_input = PlanInput { mesh: &mesh, fixture: fixture.as_ref(), part_sha256: &input.mesh.sha256, scanner: &scanner };
    let outcome = pipeline::plan(&plan_input, &input.params, ctx)?;
    let plan = PlanDocument::new(&outcome, &scanner, &input.echo);
    Ok(vec![Artifact { name: "plan.json", bytes: plan.to_bytes() }])
}

/// The meshes that a run brings with it, and the presets.
pub struct RunLibrary<'a>(pub &'a RunInput);

impl SpecLibrary for RunLibrary<'_> {
    fn scanner(&self, name: &str) -> Option<ScannerSpec> {
        Presets.scanner(name)
    }

    fn robot(&self, name: &str) -> Option<RobotSpec> {
        Presets.robot(name)
    }

    fn turntable(&self, name: &str) -> Option<TurntableSpec> {
        Presets.turntable(name)
    }

    fn cell(&self, name: &str) -> Option<CellSpec> {
        Presets.cell(name)
    }

    fn mesh(&self, name: &str) -> Option<Mesh> {
        self.0.body_meshes.get(name).and_then(|source| source.read("/cell", self.0.max_triangles).ok())
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        Presets.names(kind)
    }
}
