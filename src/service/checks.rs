//! Checks of documents on request: what `vantage check` does, with the stored specifications and meshes.

use std::time::Duration;

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::app::App;
use super::error::Error;
use super::library::Library;
use super::store::hex;
use crate::cell::{Cell, CellSpec, FieldError, Named, NotFound, Presets, SpecLibrary};
use crate::check::{self, Reference};
use crate::geometry::Mesh;
use crate::planning::context::{Context, Silent};
use crate::wire::{CheckReport, CheckRequest, DocumentKind, MeshId, ProblemField};

impl App {
    /// Checks a document, within `limit`; work on it stops when the caller goes away.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the request names what does not exist; [`Error::TooSlow`], [`Error::StorageBusy`],
    /// [`Error::Internal`].
    pub async fn check(&self, request: CheckRequest, limit: Option<Duration>) -> Result<CheckReport, Error> {
        self.check_open()?;
        let app = self.clone();
        self.with_library(limit, move |library| report(request, library, &app)).await
    }
}

fn report(request: CheckRequest, library: &Library, app: &App) -> Result<CheckReport, Error> {
    let CheckRequest { document, cell, plan, mesh_id, fixture_mesh_id } = request;
    let cell = cell.map(|cell| build(&cell, library)).transpose().map_err(Error::Invalid)?;
    let read = |pointer: &str, id: Option<MeshId>| id.map(|id| read(pointer, id, library)).transpose().map_err(Error::Invalid);
    let (part, fixture) = (read("/mesh_id", mesh_id)?, read("/fixture_mesh_id", fixture_mesh_id)?);
    let plan = plan.map(|plan| check::read_plan(Value::Object(plan)).map_err(|errors| Error::Invalid(below("/plan", errors))));
    let plan = plan.transpose()?.map(|plan| {
        let sha256 = hex(&Sha256::digest(plan.to_bytes()));
        (plan, sha256)
    });
    let reference = Reference { plan, part, fixture };
    let document = Value::Object(document);
    let kind = check::kind_of(&document);
    let ctx = Context::new(library.abandoned(), &Silent).with_allowance(app.0.runner.allowance());
    // Plans and programs need no library, and may take seconds of every core.
    let checked = match kind {
        Some(DocumentKind::Plan | DocumentKind::Program) => {
            app.0.runner.install(|| check::check(document, &Presets, cell.as_ref(), &reference, &ctx))
        }
        _ => check::check(document, library, cell.as_ref(), &reference, &ctx),
    };
    let sound = checked.is_ok();
    let (found, findings) = match checked {
        Ok(found) => (Some(found), Vec::new()),
        Err(errors) => (None, errors.into_iter().map(ProblemField::from).collect()),
    };
    let measured_of_asked = found.as_ref().and_then(|found| found.measured_of_asked);
    Ok(CheckReport { kind, sound, description: found.map(|found| found.description), measured_of_asked, findings })
}

/// Builds the cell of a request.
fn build(cell: &Named<CellSpec>, library: &Library) -> Result<Cell, Vec<FieldError>> {
    let refuse = |detail: String| vec![FieldError { pointer: "/cell".to_owned(), detail }];
    let spec = match cell {
        Named::Inline(spec) => (**spec).clone(),
        Named::Name(name) => library.cell(name).map_err(|_| refuse(format!("no cell is named {name:?}")))?,
    };
    spec.build(library).map_err(|errors| below("/cell", errors))
}

/// Errors in a part of the request, with pointers from its root.
fn below(part: &str, errors: Vec<FieldError>) -> Vec<FieldError> {
    errors.into_iter().map(|error| FieldError { pointer: format!("{part}{}", error.pointer), ..error }).collect()
}

/// Reads a stored mesh.
fn read(pointer: &str, id: MeshId, library: &Library) -> Result<Mesh, Vec<FieldError>> {
    let refuse = |detail: String| vec![FieldError { pointer: pointer.to_owned(), detail }];
    library.read(id).map_err(|error| {
        refuse(match error {
            NotFound::Unknown => "no mesh has this id; upload it with POST /api/v1/meshes".to_owned(),
            NotFound::Unusable(reason) => reason,
        })
    })
}
