//! Lookup of specifications and meshes by name, among the presets and in the store. Each is read on first use, and once.

use std::cell::RefCell;
use std::collections::HashMap;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::de::DeserializeOwned;
use tokio::runtime::Handle;

use super::app::App;
use super::cells::{BuiltCell, mesh_names};
use super::error::{Error, InternalError};
use super::meshes::unit_of;
use super::planner::{JobError, MeshSource};
use super::presets::PRESETS;
use super::store::{StoredSpec, read_leniently};
use crate::cell::{CellSpec, FieldError, NotFound, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::Mesh;
use crate::geometry::mesh_io::MeshFormat;
use crate::wire::part_size::PartSize;
use crate::wire::{MeshHealthReport, MeshId, SpecCollection};

/// Max number of stored names in an error message.
const MAX_NAMES: u32 = 50;

/// A stored mesh's file, its name, if any, and size and faces, if they are known.
type StoredMesh = (MeshSource, Option<String>, Option<(PartSize, FacesInFile)>);

/// Faces of a mesh's file, as far as its stored report tells them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FacesInFile {
    /// Number of triangles: no fewer than there are faces.
    pub(super) triangles: usize,
    /// True if a face may be a polygon of several triangles.
    pub(super) may_be_polygons: bool,
    /// True if there may be named groups.
    pub(super) may_be_grouped: bool,
    /// Names of all groups, where they are known.
    pub(super) group_names: Option<Vec<String>>,
}

impl FacesInFile {
    fn new(health: &MeshHealthReport) -> Self {
        let is = |format: MeshFormat| health.format == format.as_str();
        let is_stl = is(MeshFormat::StlBinary) || is(MeshFormat::StlAscii);
        let may_be_grouped = !is_stl && !is(MeshFormat::Ply);
        let (triangles, group_names) = (health.triangles_in_file, health.group_names.clone());
        Self { triangles, may_be_polygons: !is_stl, may_be_grouped, group_names }
    }
}

/// The stored specifications and meshes, for one request. Lookups wait for the database, on threads that may block.
pub(super) struct Library {
    app: App,
    runtime: Handle,
    /// Raised when the caller no longer waits; then nothing more is read.
    abandoned: Arc<AtomicBool>,
    specs: RefCell<HashMap<(&'static str, String), Option<String>>>,
    meshes: RefCell<HashMap<MeshId, Option<StoredMesh>>>,
    error: RefCell<Option<Error>>,
}

impl Library {
    /// The library of `app`, on a thread of its runtime.
    pub(super) fn new(app: App, abandoned: Arc<AtomicBool>) -> Self {
        let (specs, meshes, error) = (RefCell::default(), RefCell::default(), RefCell::default());
        Self { app, runtime: Handle::current(), abandoned, specs, meshes, error }
    }

    /// The last error of the store, if any: a name that was not found, or a mesh that was not read, may then be good all the same.
    pub(super) fn take_error(&self) -> Option<Error> {
        self.error.take()
    }

    /// Result of a query to the store; on an error `None`, and the error is kept for [`Library::take_error`].
    fn query<T>(&self, query: impl Future<Output = Result<T, Error>>) -> Option<T> {
        self.runtime.block_on(query).map_err(|error| self.error.replace(Some(error))).ok()
    }

    fn get<T: DeserializeOwned>(&self, collection: SpecCollection, name: &str) -> Result<T, NotFound> {
        let key = (collection.as_str(), name.to_owned());
        let known = self.specs.borrow().get(&key).cloned();
        let body = known.unwrap_or_else(|| {
            let stored = self.query(self.app.0.store.spec(collection, name)).flatten();
            let body = stored.map(|StoredSpec { body, .. }| body);
            self.specs.borrow_mut().insert(key, body.clone());
            body
        });
        let read = read_leniently(0, &body.ok_or(NotFound::Unknown)?).map_err(NotFound::Unusable)?;
        Ok(read.0)
    }

    /// The cell of a specification with its devices inlined.
    pub(super) fn built(&self, spec: &CellSpec) -> Result<Arc<BuiltCell>, Vec<FieldError>> {
        let source = |name: &String| Some((name.clone(), self.source(name.parse().ok()?)?));
        self.app.0.cells.built(spec, &mesh_names(spec).filter_map(source).collect(), self)
    }

    /// File of a mesh.
    pub(super) fn source(&self, id: MeshId) -> Option<MeshSource> {
        self.find(id).map(|(source, ..)| source)
    }

    /// Flag that is raised when the caller no longer waits.
    pub(super) fn abandoned(&self) -> &AtomicBool {
        &self.abandoned
    }

    /// Reads a mesh.
    pub(super) fn read(&self, id: MeshId) -> Result<Mesh, NotFound> {
        let source = self.source(id).ok_or(NotFound::Unknown)?;
        let stop = || self.abandoned.load(Ordering::Relaxed);
        source.read("", self.app.0.options.max_triangles, &stop).map_err(|error| self.unusable(&source, error))
    }

    /// Reason why a mesh cannot be used. What is no fault of the request, a damaged file or a machine that is short of something, is
    /// kept for [`Library::take_error`].
    fn unusable(&self, source: &MeshSource, error: JobError) -> NotFound {
        let said = error.to_string();
        let of_store = match error {
            JobError::Unavailable(reason) => Some(Error::StorageBusy(InternalError::File(Arc::new(io::Error::other(reason))))),
            JobError::Damaged(_) | JobError::Unread(_) => {
                Some(Error::FileDamaged { sha256: source.sha256.clone(), missing: !source.path.exists() })
            }
            JobError::Cancelled | JobError::BadInput(_) | JobError::PartRefused { .. } | JobError::NoPlan { .. } => None,
        };
        if of_store.is_some() {
            self.error.replace(of_store);
        }
        NotFound::Unusable(said)
    }

    /// Name of a mesh, or its id if it has none.
    pub(super) fn part_name(&self, id: MeshId) -> String {
        self.find(id).and_then(|(_, name, _)| name).unwrap_or_else(|| id.to_string())
    }

    /// Size of a mesh; `None` if its stored report has none.
    pub(super) fn part_size(&self, id: MeshId) -> Option<PartSize> {
        self.find(id).and_then(|(.., known)| known).map(|(size, _)| size)
    }

    /// Faces of a mesh's file; `None` if its stored report does not tell them.
    pub(super) fn faces_in_file(&self, id: MeshId) -> Option<FacesInFile> {
        self.find(id).and_then(|(.., known)| known).map(|(_, faces)| faces)
    }

    fn find(&self, id: MeshId) -> Option<StoredMesh> {
        let known = self.meshes.borrow().get(&id).cloned();
        known.unwrap_or_else(|| {
            let found = self.look_up(id);
            self.meshes.borrow_mut().insert(id, found.clone());
            found
        })
    }

    fn look_up(&self, id: MeshId) -> Option<StoredMesh> {
        let look = async {
            match self.app.0.store.mesh(id).await {
                Ok(mesh) => Ok(Some(mesh)),
                Err(Error::MeshNotFound(_)) => Ok(None),
                Err(error) => Err(error),
            }
        };
        let mesh = self.query(look).flatten()?;
        let unit = unit_of(&mesh).map_err(|error| self.error.replace(Some(error))).ok()?;
        let path = self.app.0.store.files().path(&mesh.sha256);
        let (bbox, is_known) = (mesh.health.bbox_mm, mesh.health.triangles > 0);
        let size_mm = std::array::from_fn(|axis| bbox.max[axis] - bbox.min[axis]);
        let known = is_known.then(|| (PartSize { size_mm, unit }, FacesInFile::new(&mesh.health)));
        Some((MeshSource { path, sha256: mesh.sha256, unit }, mesh.name, known))
    }
}

// A stored specification cannot have a preset's name, so the order does not matter.
impl SpecLibrary for Library {
    fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound> {
        PRESETS.scanner(name).or_else(|_| self.get(SpecCollection::Scanner, name))
    }

    fn robot(&self, name: &str) -> Result<RobotSpec, NotFound> {
        PRESETS.robot(name).or_else(|_| self.get(SpecCollection::Robot, name))
    }

    fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound> {
        PRESETS.turntable(name).or_else(|_| self.get(SpecCollection::Turntable, name))
    }

    fn cell(&self, name: &str) -> Result<CellSpec, NotFound> {
        PRESETS.cell(name).or_else(|_| self.get(SpecCollection::Cell, name))
    }

    fn mesh(&self, name: &str) -> Result<Arc<Mesh>, NotFound> {
        self.read(name.parse().map_err(|_| NotFound::Unknown)?).map(Arc::new)
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        let collection = SpecCollection::ALL.into_iter().find(|collection| collection.kind() == kind);
        let stored = collection.and_then(|collection| self.query(self.app.0.store.spec_names(collection, MAX_NAMES)));
        let mut names: Vec<String> = stored.unwrap_or_default().into_iter().chain(PRESETS.names(kind)).collect();
        names.sort();
        names
    }
}

#[cfg(test)]
mod tests;
