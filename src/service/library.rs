//! Specifications and meshes by name, as they are at one moment: what is stored, and below it the presets.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;

use super::app::App;
use super::error::Error;
use super::meshes::unit_of;
use super::run::MeshSource;
use crate::cell::{CellSpec, NotFound, Presets, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::Mesh;
use crate::wire::SpecCollection;

/// A snapshot of the store's specifications.
pub(super) struct Library {
    stored: BTreeMap<(&'static str, String), String>,
    meshes: BTreeMap<String, (MeshSource, Option<String>)>,
    max_triangles: usize,
}

impl App {
    /// The library as it is now.
    pub(super) async fn library(&self) -> Result<Library, Error> {
        let mut stored = BTreeMap::new();
        for collection in SpecCollection::ALL {
            let specs = self.0.store.specs(collection).await?;
            stored.extend(specs.into_iter().map(|spec| ((collection.as_str(), spec.name), spec.body)));
        }
        let mut meshes = BTreeMap::new();
        for mesh in self.0.store.all_meshes().await? {
            let path = self.0.store.files().path(&mesh.sha256);
            let unit = unit_of(&mesh)?;
            meshes.insert(mesh.id.to_string(), (MeshSource { path, sha256: mesh.sha256, unit }, mesh.name));
        }
        Ok(Library { stored, meshes, max_triangles: self.0.options.max_triangles })
    }
}

impl Library {
    fn get<T: DeserializeOwned>(&self, kind: SpecKind, name: &str) -> Result<T, NotFound> {
        let body = self.stored.get(&(kind.as_str(), name.to_owned())).ok_or(NotFound::Unknown)?;
        serde_json::from_str(body).map_err(|error| NotFound::Unusable(error.to_string()))
    }

    /// The file of a mesh.
    pub(super) fn source(&self, id: &str) -> Option<&MeshSource> {
        self.meshes.get(id).map(|(source, _)| source)
    }

    /// The name that a mesh was given, else its id.
    pub(super) fn part_name(&self, id: &str) -> String {
        self.meshes.get(id).and_then(|(_, name)| name.clone()).unwrap_or_else(|| id.to_owned())
    }
}

// A preset's name cannot be stored under, so the order of the two does not matter.
impl SpecLibrary for Library {
    fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound> {
        Presets.scanner(name).or_else(|_| self.get(SpecKind::Scanner, name))
    }

    fn robot(&self, name: &str) -> Result<RobotSpec, NotFound> {
        Presets.robot(name).or_else(|_| self.get(SpecKind::Robot, name))
    }

    fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound> {
        Presets.turntable(name).or_else(|_| self.get(SpecKind::Turntable, name))
    }

    fn cell(&self, name: &str) -> Result<CellSpec, NotFound> {
        Presets.cell(name).or_else(|_| self.get(SpecKind::Cell, name))
    }

    fn mesh(&self, name: &str) -> Result<Mesh, NotFound> {
        let source = self.source(name).ok_or(NotFound::Unknown)?;
        source.read("", self.max_triangles).map_err(|error| NotFound::Unusable(error.to_string()))
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        let stored = self.stored.keys().filter(|(of, _)| *of == kind.as_str()).map(|(_, name)| name.clone());
        let mut names: Vec<String> = stored.chain(Presets.names(kind)).collect();
        names.sort();
        names
    }
}
