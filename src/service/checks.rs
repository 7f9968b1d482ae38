//! Checks of documents on request: what `vantage check` does, with the stored specifications and meshes.

use std::time::{Duration, SystemTime};

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::app::App;
use super::error::Error;
use super::library::Library;
use super::submit::Lookup;
use crate::cell::{Presets, SpecKind, SpecLibrary};
use crate::check::{self, Present, Reference};
use crate::planning::context::{Context, Silent};
use crate::wire::hex;
use crate::wire::{CheckReport, CheckRequest, DocumentKind, MeshId, ProblemField, UtcTime};

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
    let CheckRequest { document, cell, plan, mesh_id, fixture_mesh_id, temperature_c } = request;
    let mut errors = Vec::new();
    let mut lookup = Lookup::new(library, &mut errors);
    let cell = cell.and_then(|cell| {
        let spec = lookup.find("/cell", &cell, SpecKind::Cell, |name| library.cell(name))?;
        lookup.built("/cell", spec.build(library))
    });
    let mut read = |pointer: &str, id: MeshId| {
        let file = lookup.mesh(pointer, &id.to_string())?;
        let mesh = library.read(id).map_err(|error| lookup.refuse(pointer, error.to_string())).ok()?;
        Some((mesh, file.sha256))
    };
    let part = mesh_id.and_then(|id| read("/mesh_id", id));
    let fixture = fixture_mesh_id.and_then(|id| read("/fixture_mesh_id", id));
    let plan = plan.and_then(|plan| lookup.built("/plan", check::read_plan(Value::Object(plan))));
    let document = Value::Object(document);
    if let Some((part, sha256)) = &part {
        let of_plan = plan.as_ref().map_or(Ok(()), |plan| check::check_part(plan, part, sha256));
        if let Err(other) = of_plan.and_then(|()| check::check_part_of(&document, part, sha256)) {
            lookup.refuse("/mesh_id", other.to_string());
        }
    }
    if let Some(celsius) = temperature_c.filter(|celsius| !(-50.0..=100.0).contains(celsius)) {
        lookup.refuse("/temperature_c", format!("is {celsius} °C; allowed is -50 to 100 °C"));
    }
    if !errors.is_empty() {
        return Err(Error::Invalid(errors));
    }
    let plan = plan.map(|plan| {
        let sha256 = hex(&Sha256::digest(plan.to_bytes()));
        (plan, sha256)
    });
    let present = Present { now: Some(UtcTime::of(SystemTime::now())), temperature_c };
    let [part, fixture] = [part, fixture].map(|read| read.map(|(mesh, _)| mesh));
    let reference = Reference { plan, part, fixture, present };
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
    let (description, warnings) = found.map_or_else(Default::default, |found| (Some(found.description), found.warnings));
    Ok(CheckReport { kind, sound, description, measured_of_asked, findings, warnings })
}
