//! Specifications and meshes by name: what is stored, and below it the presets. Only what somebody asks for is read, once.

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::de::DeserializeOwned;
use tokio::runtime::Handle;

use super::app::App;
use super::error::Error;
use super::meshes::unit_of;
use super::run::MeshSource;
use super::store::{StoredSpec, read_leniently};
use crate::cell::{CellSpec, NotFound, Presets, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::Mesh;
use crate::wire::{MeshId, SpecCollection};

/// Stored names that a refusal lists.
const MAX_NAMES: u32 = 50;

/// A stored mesh's file, and the name that it was given.
type Named = (MeshSource, Option<String>);

/// What is stored, for one request. It waits for the database, so it is used on threads that may block.
pub(super) struct Library {
    app: App,
    runtime: Handle,
    /// Raised when nobody waits for the answer any more; then nothing more is read.
    given_up: Arc<AtomicBool>,
    specs: RefCell<HashMap<(&'static str, String), Option<String>>>,
    meshes: RefCell<HashMap<MeshId, Option<Named>>>,
    fault: RefCell<Option<Error>>,
}

impl Library {
    /// The library of `app`, on a thread of its runtime.
    pub(super) fn new(app: App, given_up: Arc<AtomicBool>) -> Self {
        let (specs, meshes, fault) = (RefCell::default(), RefCell::default(), RefCell::default());
        Self { app, runtime: Handle::current(), given_up, specs, meshes, fault }
    }

    /// Why the store could not be read, if that happened: then what was not found may well be there.
    pub(super) fn fault(&self) -> Option<Error> {
        self.fault.take()
    }

    /// What the store answers; nothing, and a fault to be told of, when it cannot.
    fn ask<T>(&self, answer: impl Future<Output = Result<T, Error>>) -> Option<T> {
        self.runtime.block_on(answer).map_err(|error| self.fault.replace(Some(error))).ok()
    }

    fn get<T: DeserializeOwned>(&self, collection: SpecCollection, name: &str) -> Result<T, NotFound> {
        let key = (collection.as_str(), name.to_owned());
        let known = self.specs.borrow().get(&key).cloned();
        let body = known.unwrap_or_else(|| {
            let stored = self.ask(self.app.0.store.spec(collection, name)).flatten();
            let body = stored.map(|StoredSpec { body, .. }| body);
            self.specs.borrow_mut().insert(key, body.clone());
            body
        });
        let read = read_leniently(0, &body.ok_or(NotFound::Unknown)?).map_err(NotFound::Unusable)?;
        Ok(read.0)
    }

    /// The file of a mesh.
    pub(super) fn source(&self, id: MeshId) -> Option<MeshSource> {
        self.find(id).map(|(source, _)| source)
    }

    /// The name that a mesh was given, else its id.
    pub(super) fn part_name(&self, id: MeshId) -> String {
        self.find(id).and_then(|(_, name)| name).unwrap_or_else(|| id.to_string())
    }

    fn find(&self, id: MeshId) -> Option<Named> {
        let known = self.meshes.borrow().get(&id).cloned();
        known.unwrap_or_else(|| {
            let found = self.look_up(id);
            self.meshes.borrow_mut().insert(id, found.clone());
            found
        })
    }

    fn look_up(&self, id: MeshId) -> Option<Named> {
        let look = async {
            match self.app.0.store.mesh(id).await {
                Ok(mesh) => Ok(Some(mesh)),
                Err(Error::MeshNotFound(_)) => Ok(None),
                Err(error) => Err(error),
            }
        };
        let mesh = self.ask(look).flatten()?;
        let unit = unit_of(&mesh).map_err(|error| self.fault.replace(Some(error))).ok()?;
        let path = self.app.0.store.files().path(&mesh.sha256);
        Some((MeshSource { path, sha256: mesh.sha256, unit }, mesh.name))
    }
}

// A preset's name cannot be stored under, so the order of the two does not matter.
impl SpecLibrary for Library {
    fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound> {
        Presets.scanner(name).or_else(|_| self.get(SpecCollection::Scanner, name))
    }

    fn robot(&self, name: &str) -> Result<RobotSpec, NotFound> {
        Presets.robot(name).or_else(|_| self.get(SpecCollection::Robot, name))
    }

    fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound> {
        Presets.turntable(name).or_else(|_| self.get(SpecCollection::Turntable, name))
    }

    fn cell(&self, name: &str) -> Result<CellSpec, NotFound> {
        Presets.cell(name).or_else(|_| self.get(SpecCollection::Cell, name))
    }

    fn mesh(&self, name: &str) -> Result<Arc<Mesh>, NotFound> {
        let source = name.parse().ok().and_then(|id| self.source(id)).ok_or(NotFound::Unknown)?;
        let stop = || self.given_up.load(Ordering::Relaxed);
        let read = source.read("", self.app.0.options.max_triangles, &stop);
        read.map(Arc::new).map_err(|error| NotFound::Unusable(error.to_string()))
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        let collection = SpecCollection::ALL.into_iter().find(|collection| collection.kind() == kind);
        let stored = collection.and_then(|collection| self.ask(self.app.0.store.spec_names(collection, MAX_NAMES)));
        let mut names: Vec<String> = stored.unwrap_or_default().into_iter().chain(Presets.names(kind)).collect();
        names.sort();
        names
    }
}
