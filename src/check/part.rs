//! Part and fixture held against those of a plan, before anything is computed with them. The plan has the SHA-256 and the size
//! of both. A plan of an earlier release has of its fixture the name alone, so that a fixture is compared with the file of that
//! name, by whoever can read it.

use serde_json::Value;

use super::{Sound, kind_of, read_plan};
use crate::geometry::{LengthUnit, Mesh};
use crate::wire::DocumentKind;
use crate::wire::part_size::unit_text;
use crate::wire::plan::{FixtureDocument, PlanDocument};

/// Part that is not the one of the plan.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OtherPart {
    /// Another file.
    #[error("is not the part of the plan: its SHA-256 is {found}, that of the planned part {planned}")]
    File {
        /// SHA-256 of the file.
        found: String,
        /// SHA-256 in the plan.
        planned: String,
    },
    /// The file, read in another unit; what differs in words.
    #[error("{0}")]
    Size(String),
}

/// Holds a part against that of the plan. `sha256` is that of the part's file, lower-case hexadecimal.
///
/// # Errors
/// Another file, or another unit.
pub fn check_part(plan: &PlanDocument, part: &Mesh, sha256: &str) -> Result<(), OtherPart> {
    if plan.part.sha256 != sha256 {
        return Err(OtherPart::File { found: sha256.to_owned(), planned: plan.part.sha256.clone() });
    }
    plan.part.other_size(part).map_or(Ok(()), |size| Err(OtherPart::Size(size)))
}

/// Holds a part against the document that is checked, if that is a plan; as [`check_part`] otherwise.
///
/// # Errors
/// Errors of [`check_part`]; never one for a document that cannot be read, which [`super::check()`] tells.
pub fn check_part_of(document: &Value, part: &Mesh, sha256: &str) -> Result<(), OtherPart> {
    if kind_of(document) != Some(DocumentKind::Plan) {
        return Ok(());
    }
    read_plan(document.clone()).map_or(Ok(()), |plan| check_part(&plan, part, sha256))
}

/// File of a fixture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixtureFile<'a> {
    /// SHA-256 of the file, lower-case hexadecimal.
    pub sha256: &'a str,
    /// Unit that it is read in.
    pub unit: LengthUnit,
}

/// Fixture that is not the one of the plan, which names `name`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OtherFixture {
    /// Another file.
    #[error("is not the fixture of the plan: its SHA-256 is {found}; the plan was made with {name}, whose SHA-256 is {planned}")]
    File {
        /// Name in the plan.
        name: String,
        /// SHA-256 of the file.
        found: String,
        /// SHA-256 of the file that the plan names.
        planned: String,
    },
    /// The file, read in another unit.
    #[error(
        "is the fixture of the plan, read in {}; the plan was made with {name}, the same file in {}",
        unit_text(*.found),
        unit_text(*.planned)
    )]
    Unit {
        /// Name in the plan.
        name: String,
        /// Unit that it is read in.
        found: LengthUnit,
        /// Unit of the fixture that the plan names.
        planned: LengthUnit,
    },
    /// The file, read in another unit than its size in the plan tells; what differs in words.
    #[error("{0}")]
    Size(String),
}

/// Holds a fixture against the one that a plan names.
///
/// # Errors
/// Another file, or another unit.
pub fn check_fixture(name: &str, found: FixtureFile<'_>, planned: FixtureFile<'_>) -> Result<(), OtherFixture> {
    let name = name.to_owned();
    if found.sha256 != planned.sha256 {
        return Err(OtherFixture::File { name, found: found.sha256.to_owned(), planned: planned.sha256.to_owned() });
    }
    if found.unit != planned.unit {
        return Err(OtherFixture::Unit { name, found: found.unit, planned: planned.unit });
    }
    Ok(())
}

/// Holds a fixture against what its plan tells of it, `planned`; `name` is its name there, and `sha256` that of the fixture's
/// file, lower-case hexadecimal. The name does not count: the file may lie elsewhere now.
///
/// # Errors
/// Another file, or another unit.
pub fn check_told_fixture(name: &str, planned: &FixtureDocument, fixture: &Mesh, sha256: &str) -> Result<(), OtherFixture> {
    if planned.sha256 != sha256 {
        let (name, found, planned) = (name.to_owned(), sha256.to_owned(), planned.sha256.clone());
        return Err(OtherFixture::File { name, found, planned });
    }
    planned.other_size(fixture).map_or(Ok(()), |size| Err(OtherFixture::Size(size)))
}

/// Returns what the plan tells of the fixture that a document is checked with: a plan itself, the plan of a program. `None` where
/// it tells no more than the name, as plans of earlier releases do, or cannot be read, which [`super::check()`] tells.
#[must_use]
pub fn told_fixture(document: &Value, plan: Option<&PlanDocument>) -> Option<FixtureDocument> {
    match kind_of(document)? {
        DocumentKind::Plan => serde_json::from_value(document["fixture"].clone()).ok(),
        DocumentKind::Program => plan?.fixture.clone(),
        DocumentKind::Scanner | DocumentKind::Robot | DocumentKind::Turntable | DocumentKind::Cell | DocumentKind::Params => None,
    }
}

/// Name of the fixture that a document is checked with, a mesh id or a path: of a plan its own, of a program that of its plan.
/// `None` where there is none.
#[must_use]
pub fn planned_fixture(document: &Value, plan: Option<&PlanDocument>) -> Option<String> {
    match kind_of(document)? {
        DocumentKind::Plan => document["params"]["part"]["fixture_mesh"].as_str().map(str::to_owned),
        DocumentKind::Program => plan?.params.part.fixture_mesh.clone(),
        DocumentKind::Scanner | DocumentKind::Robot | DocumentKind::Turntable | DocumentKind::Cell | DocumentKind::Params => None,
    }
}

/// Identity of a fixture that was not refused, as far as it is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FixtureIdentity {
    /// File and size are those that the plan tells.
    Told,
    /// File and unit are those of the mesh of this name, which the plan names.
    Planned(String),
    /// Identity that is not known, for this reason.
    Unknown(String),
}

impl Sound {
    /// Tells that the part is the planned one, by its file and its size.
    pub fn tell_part(&mut self) {
        self.verified.push("part: its SHA-256 and its size, by the file that was given".to_owned());
    }

    /// Tells the identity of the fixture; one that is not known stands in the description too.
    pub fn tell_fixture(&mut self, fixture: FixtureIdentity) {
        match fixture {
            FixtureIdentity::Told => {
                self.verified.push("fixture: its SHA-256 and its size, by the file that was given".to_owned());
            }
            FixtureIdentity::Planned(name) => {
                self.verified.push(format!("fixture: its SHA-256 and its unit, by {name}, which the plan names"));
            }
            FixtureIdentity::Unknown(reason) => {
                let statement = "identity of the fixture";
                self.description += &format!("; not checked: {statement} ({reason})");
                self.leave(statement, reason);
            }
        }
    }
}
