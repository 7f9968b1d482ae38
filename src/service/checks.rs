//! Checks of documents on request: what `vantage check` does, with the stored specifications and meshes.

use std::time::{Duration, SystemTime};

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::app::App;
use super::error::Error;
use super::library::Library;
use super::submit::Lookup;
use crate::cell::{Cell, FieldError, Named, Presets, Scanner, ScannerSpec, SpecKind, SpecLibrary};
use crate::check::{
    self, Beside, CheckPlace, FixtureFile, FixtureIdentity, GivenBeside, GivenCell, NO_CELL, OtherFixture, OtherPart, Present,
    Reference, Sound,
};
use crate::geometry::Mesh;
use crate::planning::context::{Context, Silent};
use crate::wire::hex;
use crate::wire::part_size::SizeLimits;
use crate::wire::plan::PlanDocument;
use crate::wire::{CheckReport, CheckRequest, DocumentKind, MeshId, ProblemField, UtcTime};

impl App {
    /// Checks a document, within `limit`; work on it stops when the caller goes away.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the request names what does not exist or does not belong to the document; [`Error::TooSlow`],
    /// [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn check(&self, request: CheckRequest, limit: Option<Duration>) -> Result<CheckReport, Error> {
        self.check_open()?;
        let app = self.clone();
        self.with_library(limit, move |library| report(request, library, &app)).await
    }
}

/// Surroundings that a request names, built.
enum Surroundings {
    Cell(Box<Cell>),
    NoCell(Option<Box<Scanner>>),
}

impl Surroundings {
    fn place(&self) -> CheckPlace<'_> {
        match self {
            Self::Cell(cell) => CheckPlace::Cell(cell),
            Self::NoCell(scanner) => CheckPlace::NoCell(scanner.as_deref()),
        }
    }

    /// Sizes of parts that suit it; `None` without a scanner.
    fn limits(&self) -> Option<SizeLimits> {
        match self {
            Self::Cell(cell) => Some(SizeLimits::new(&cell.scanner, Some(cell))),
            Self::NoCell(scanner) => scanner.as_deref().map(|scanner| SizeLimits::new(scanner, None)),
        }
    }
}

/// A request with everything that it names.
struct ResolvedCheck {
    document: Value,
    surroundings: Option<Surroundings>,
    reference: Reference,
    /// True if the part was held against that of a plan.
    is_part_known: bool,
    fixture: Option<FixtureIdentity>,
}

fn report(request: CheckRequest, library: &Library, app: &App) -> Result<CheckReport, Error> {
    let mut errors = Vec::new();
    let resolved = resolve(request, library, &mut errors);
    if !errors.is_empty() {
        return Err(Error::Invalid(errors));
    }
    let ResolvedCheck { document, surroundings, reference, is_part_known, fixture } = resolved;
    let kind = check::kind_of(&document);
    let place = surroundings.as_ref().map(Surroundings::place);
    let ctx = Context::new(library.abandoned(), &Silent).with_allowance(app.0.runner.allowance());
    // Plans and programs need no library, and may take seconds of every core.
    let checked = match kind {
        Some(DocumentKind::Plan | DocumentKind::Program) => {
            app.0.runner.install(|| check::check(document, &Presets, place, &reference, &ctx))
        }
        _ => check::check(document, library, place, &reference, &ctx),
    };
    let checked = checked.map(|mut sound| {
        if is_part_known {
            sound.tell_part();
        }
        fixture.into_iter().for_each(|fixture| sound.tell_fixture(fixture));
        sound
    });
    let limits = surroundings.as_ref().and_then(Surroundings::limits);
    Ok(CheckReport { part_edge_mm: limits.map(|limits| limits.edge_mm()), ..told(kind, checked) })
}

/// Report on what was found, without the sizes of parts.
fn told(kind: Option<DocumentKind>, checked: Result<Sound, Vec<FieldError>>) -> CheckReport {
    let unsound = CheckReport {
        kind,
        sound: false,
        description: None,
        measured_of_asked: None,
        part_edge_mm: None,
        findings: Vec::new(),
        warnings: Vec::new(),
        verified: Vec::new(),
        unverified: Vec::new(),
    };
    match checked {
        Err(errors) => CheckReport { findings: errors.into_iter().map(ProblemField::from).collect(), ..unsound },
        Ok(Sound { description, measured_of_asked, warnings, verified, unverified, .. }) => {
            let description = Some(description);
            CheckReport { sound: true, description, measured_of_asked, warnings, verified, unverified, ..unsound }
        }
    }
}

/// Finds everything that a request names, and holds it against each other and against the document.
fn resolve(request: CheckRequest, library: &Library, errors: &mut Vec<FieldError>) -> ResolvedCheck {
    let CheckRequest { document, cell, scanner, plan, mesh_id, fixture_mesh_id, temperature_c } = request;
    let document = Value::Object(document);
    let mut lookup = Lookup::new(library, errors);
    let is_without_cell = match &cell {
        Some(cell) => matches!(cell, Named::Name(name) if name == NO_CELL),
        None => check::is_plan_without_cell(&document),
    };
    let surroundings = match cell.as_ref().filter(|_| !is_without_cell) {
        Some(cell) => {
            let spec = lookup.find("/cell", cell, SpecKind::Cell, |name| library.cell(name));
            let built = spec.and_then(|spec| lookup.built("/cell", spec.build(library)));
            built.map(|cell| Surroundings::Cell(Box::new(cell)))
        }
        None => is_without_cell
            .then(|| Surroundings::NoCell(scanner_of(&document, scanner.as_ref(), &mut lookup, library).map(Box::new))),
    };
    let mut read = |pointer: &str, id: MeshId| {
        let file = lookup.mesh(pointer, &id.to_string())?;
        let mesh = library.read(id).map_err(|error| lookup.refuse(pointer, error.to_string())).ok()?;
        Some((mesh, file.sha256))
    };
    let part = mesh_id.and_then(|id| read("/mesh_id", id));
    let fixture = fixture_mesh_id.and_then(|id| read("/fixture_mesh_id", id));
    let plan = plan.map(Value::Object).and_then(|raw| {
        let plan = lookup.built("/plan", check::read_plan(raw.clone()))?;
        let sha256 = hex(&Sha256::digest(plan.to_bytes()));
        refuse_lacking(&document, (&plan, &raw, sha256.as_str()), &mut lookup);
        Some((plan, sha256))
    });
    let of_plan = plan.as_ref().map(|(plan, _)| plan);
    let given = GivenBeside {
        cell: cell.as_ref().map(|_| if is_without_cell { GivenCell::NoCell } else { GivenCell::Cell }),
        plan: of_plan,
        has_scanner: scanner.is_some(),
        has_part: mesh_id.is_some(),
        has_fixture: fixture_mesh_id.is_some(),
        has_temperature: temperature_c.is_some(),
    };
    for (beside, reason) in check::misplaced(&document, &given) {
        lookup.refuse(pointer_of(beside), reason);
    }
    let is_part_known = part.as_ref().is_some_and(|(part, sha256)| hold_part(&document, of_plan, part, sha256, &mut lookup));
    let given_fixture = fixture_mesh_id.zip(fixture.as_ref());
    let identity = given_fixture.and_then(|fixture| identity_of(fixture, &document, of_plan, &mut lookup, library));
    let [min, max] = CheckRequest::TEMPERATURE_C.range;
    if let Some(celsius) = temperature_c.filter(|celsius| !(min..=max).contains(celsius)) {
        lookup.refuse("/temperature_c", format!("is {celsius} °C; allowed is {min} to {max} °C"));
    }
    let present = Present { now: Some(UtcTime::of(SystemTime::now())), temperature_c };
    let reference = Reference { plan, part: part.map(|(mesh, _)| mesh), fixture: fixture.map(|(mesh, _)| mesh), present };
    ResolvedCheck { document, surroundings, reference, is_part_known, fixture: identity }
}

/// Field of a request that gives something beside the document.
fn pointer_of(beside: Beside) -> &'static str {
    match beside {
        Beside::Cell => "/cell",
        Beside::Scanner => "/scanner",
        Beside::Plan => "/plan",
        Beside::Part => "/mesh_id",
        Beside::Fixture => "/fixture_mesh_id",
        Beside::Temperature => "/temperature_c",
    }
}

/// The scanner of a request without a cell: the one that it names, else the one that the document implies, if it is stored.
fn scanner_of(
    document: &Value,
    named: Option<&Named<ScannerSpec>>,
    lookup: &mut Lookup<'_>,
    library: &Library,
) -> Option<Scanner> {
    match named {
        Some(named) => {
            let spec = lookup.find("/scanner", named, SpecKind::Scanner, |name| library.scanner(name))?;
            lookup.built("/scanner", spec.build())
        }
        None => check::implied_scanner(document, |name| library.scanner(name).ok()?.build().ok()),
    }
}

/// Refuses the plan of an earlier release where its SHA-256, by which a program names it, cannot be told: the bytes of its file
/// are not in the request, and this release would write more into it.
fn refuse_lacking(document: &Value, (plan, raw, sha256): (&PlanDocument, &Value, &str), lookup: &mut Lookup<'_>) {
    let is_named = document["plan_sha256"].as_str().is_none_or(|named| named == sha256);
    if let Some(pointer) = check::added_to_plan(plan, raw).filter(|_| !is_named) {
        let detail = format!(
            "has no {pointer}, as of an earlier release; the SHA-256 of its file, by which the program names it, cannot be told \
             from a request: check the two files with `vantage check`, or plan again"
        );
        lookup.refuse("/plan", detail);
    }
}

/// Holds a part against the plans that it is given for; returns true if there is one and it is its part.
fn hold_part(document: &Value, plan: Option<&PlanDocument>, part: &Mesh, sha256: &str, lookup: &mut Lookup<'_>) -> bool {
    let of_plan: Result<(), OtherPart> = plan.map_or(Ok(()), |plan| check::check_part(plan, part, sha256));
    match of_plan.and_then(|()| check::check_part_of(document, part, sha256)) {
        Ok(()) => plan.is_some() || check::kind_of(document) == Some(DocumentKind::Plan),
        Err(other) => {
            lookup.refuse("/mesh_id", other.to_string());
            false
        }
    }
}

/// Holds a fixture, a mesh with the SHA-256 of its file, against what the plan tells of its own, or else against the mesh that the
/// plan names; `None` if there is no such plan, or the fixture was refused.
fn identity_of(
    (id, (mesh, sha256)): (MeshId, &(Mesh, String)),
    document: &Value,
    plan: Option<&PlanDocument>,
    lookup: &mut Lookup<'_>,
    library: &Library,
) -> Option<FixtureIdentity> {
    let name = check::planned_fixture(document, plan)?;
    let mut held = |checked: Result<(), OtherFixture>, identity: FixtureIdentity| match checked {
        Ok(()) => Some(identity),
        Err(other) => {
            lookup.refuse("/fixture_mesh_id", other.to_string());
            None
        }
    };
    if let Some(told) = check::told_fixture(document, plan) {
        return held(check::check_told_fixture(&name, &told, mesh, sha256), FixtureIdentity::Told);
    }
    let found = library.source(id)?;
    let planned_id = name.parse::<MeshId>().ok();
    let Some(planned) = planned_id.and_then(|id| library.source(id)) else {
        let reason = match planned_id {
            Some(_) => format!("the plan names mesh {name}, which this server does not have"),
            None => format!("the plan names the file {name:?}, and not its SHA-256"),
        };
        return Some(FixtureIdentity::Unknown(reason));
    };
    let [found, planned] = [&found, &planned].map(|source| FixtureFile { sha256: &source.sha256, unit: source.unit });
    held(check::check_fixture(&name, found, planned), FixtureIdentity::Planned(format!("mesh {name}")))
}

#[cfg(test)]
mod tests;
