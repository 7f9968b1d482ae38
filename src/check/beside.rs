//! Cell, plan, meshes and temperature that are given beside a document to check it with, and which of them apply to its kind: the
//! others are refused by name, since who gives them expects that they are looked at.

use serde_json::Value;

use super::kind_of;
use super::place::is_plan_without_cell;
use crate::wire::DocumentKind;
use crate::wire::plan::PlanDocument;

/// Something that is given beside a document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beside {
    /// Cell, or `"none"`.
    Cell,
    /// Scanner.
    Scanner,
    /// Plan of a program.
    Plan,
    /// Part.
    Part,
    /// Fixture.
    Fixture,
    /// Temperature in the cell.
    Temperature,
}

/// Cell that is given beside a document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GivenCell {
    /// A cell.
    Cell,
    /// `"none"`.
    NoCell,
}

/// Everything that is given beside a document.
#[derive(Clone, Copy, Default)]
pub struct GivenBeside<'a> {
    /// Cell, if one is given.
    pub cell: Option<GivenCell>,
    /// Plan of a program, if one is given.
    pub plan: Option<&'a PlanDocument>,
    /// True if a scanner is given.
    pub has_scanner: bool,
    /// True if a part is given.
    pub has_part: bool,
    /// True if a fixture is given.
    pub has_fixture: bool,
    /// True if a temperature is given.
    pub has_temperature: bool,
}

impl GivenBeside<'_> {
    fn all(&self) -> impl Iterator<Item = Beside> {
        let all = [
            (Beside::Cell, self.cell.is_some()),
            (Beside::Scanner, self.has_scanner),
            (Beside::Plan, self.plan.is_some()),
            (Beside::Part, self.has_part),
            (Beside::Fixture, self.has_fixture),
            (Beside::Temperature, self.has_temperature),
        ];
        all.into_iter().filter(|(_, is_given)| *is_given).map(|(beside, _)| beside)
    }
}

/// Returns what is given beside a document that it is not checked with, each with the reason and with what to do. Nothing for a
/// document of no known kind, which [`super::check()`] tells.
#[must_use]
pub fn misplaced(document: &Value, given: &GivenBeside<'_>) -> Vec<(Beside, String)> {
    let Some(kind) = kind_of(document) else { return Vec::new() };
    let reason = |beside: Beside| match kind {
        DocumentKind::Scanner | DocumentKind::Robot | DocumentKind::Turntable | DocumentKind::Cell => {
            Some(format!("does not apply to a {}, which is checked by itself; leave it out", kind.as_str()))
        }
        DocumentKind::Params => beside_params(beside, given).map(str::to_owned),
        DocumentKind::Plan => beside_plan(document, beside, given),
        DocumentKind::Program => beside_program(beside, given).map(str::to_owned),
    };
    given.all().filter_map(|beside| reason(beside).map(|reason| (beside, reason))).collect()
}

const SCANNER_OF_CELL: &str =
    "is used beside the cell \"none\" alone, as a cell has its own scanner; leave it out, or give \"none\"";
const WITHOUT_PART: &str = "is given without the part that it holds; give the part too";
const WITHOUT_FIXTURE: &str =
    "does not apply: the plan was made without a fixture (its params.part.fixture_mesh is null); leave it out, or plan with it";

fn beside_params(beside: Beside, given: &GivenBeside<'_>) -> Option<&'static str> {
    match beside {
        Beside::Cell => None,
        Beside::Scanner => (given.cell != Some(GivenCell::NoCell)).then_some(SCANNER_OF_CELL),
        Beside::Plan | Beside::Part | Beside::Fixture | Beside::Temperature => {
            Some("does not apply to parameters, which are held against a cell or a scanner alone; leave it out")
        }
    }
}

fn beside_plan(plan: &Value, beside: Beside, given: &GivenBeside<'_>) -> Option<String> {
    let has_no_cell = is_plan_without_cell(plan);
    match (beside, given.cell) {
        (Beside::Cell, Some(GivenCell::Cell)) => {
            has_no_cell.then(|| "does not apply: the plan was made without a cell; leave it out, or give \"none\"".to_owned())
        }
        (Beside::Cell, Some(GivenCell::NoCell)) => (!has_no_cell).then(|| {
            let name = &plan["cell"]["name"];
            format!("is \"none\", but the plan was made in cell {name}; give that, or leave it out to check structure and ranges")
        }),
        (Beside::Scanner, Some(GivenCell::NoCell)) => None,
        (Beside::Scanner, None) if has_no_cell => None,
        (Beside::Scanner, _) => Some(SCANNER_OF_CELL.to_owned()),
        (Beside::Plan, _) => Some("does not apply to a plan, which is held against no other; leave it out".to_owned()),
        (Beside::Fixture, _) if plan["params"]["part"]["fixture_mesh"].is_null() && plan["fixture"].is_null() => {
            Some(WITHOUT_FIXTURE.to_owned())
        }
        (Beside::Fixture, _) => (!given.has_part).then(|| WITHOUT_PART.to_owned()),
        (Beside::Temperature, _) => {
            Some("does not apply to a plan, but to its program, which moves by the calibration; leave it out".to_owned())
        }
        (Beside::Cell, None) | (Beside::Part, _) => None,
    }
}

fn beside_program(beside: Beside, given: &GivenBeside<'_>) -> Option<&'static str> {
    let is_in_cell = given.cell == Some(GivenCell::Cell);
    match beside {
        Beside::Cell => (!is_in_cell)
            .then_some("is \"none\", but a program moves a cell; give that, or leave it out to check structure and ranges"),
        Beside::Scanner => Some("does not apply to a program, whose cell has its own scanner; leave it out"),
        Beside::Plan => None,
        Beside::Part => (!is_in_cell).then_some("is used in a cell alone, for collisions and coverage; give the cell too"),
        Beside::Fixture if given.plan.is_some_and(|plan| !plan.has_fixture()) => Some(WITHOUT_FIXTURE),
        Beside::Fixture => (!given.has_part).then_some(WITHOUT_PART),
        Beside::Temperature => {
            (!is_in_cell).then_some("is used in a cell alone, whose calibration it is held against; give the cell too")
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::wire::plan::PLAN_SCHEMA;
    use crate::wire::program::PROGRAM_SCHEMA;

    const EVERYTHING: GivenBeside<'static> = GivenBeside {
        cell: Some(GivenCell::Cell),
        plan: None,
        has_scanner: true,
        has_part: true,
        has_fixture: true,
        has_temperature: true,
    };

    fn refused(document: &Value, given: &GivenBeside<'_>) -> Vec<Beside> {
        let found = misplaced(document, given);
        assert!(found.iter().all(|(_, reason)| reason.contains(';')), "each says what to do: {found:?}");
        found.into_iter().map(|(beside, _)| beside).collect()
    }

    #[test]
    fn each_kind_of_document_takes_what_it_is_checked_with_and_nothing_else() {
        use Beside::{Cell, Fixture, Part, Scanner, Temperature};
        let plan = |cell: Value, fixture: Value| {
            let params = json!({"part": {"fixture_mesh": fixture}});
            json!({"schema": PLAN_SCHEMA, "cell": cell, "params": params})
        };
        let (in_cell, held) = (json!({"name": "e05-transcan"}), json!("clamp.stl"));
        let no_cell = GivenBeside { cell: Some(GivenCell::NoCell), ..EVERYTHING };
        let nothing_moved = GivenBeside { cell: None, ..EVERYTHING };
        let robot = json!({"kinematics": {"kind": "ur"}});
        let program = json!({"schema": PROGRAM_SCHEMA});
        for (document, given, expected) in [
            (robot, EVERYTHING, &[Cell, Scanner, Part, Fixture, Temperature][..]),
            (json!({"selection": {}}), EVERYTHING, &[Scanner, Part, Fixture, Temperature]),
            (json!({"selection": {}}), no_cell, &[Part, Fixture, Temperature]),
            (plan(in_cell.clone(), held.clone()), EVERYTHING, &[Scanner, Temperature]),
            (plan(in_cell.clone(), json!(null)), EVERYTHING, &[Scanner, Fixture, Temperature]),
            (plan(in_cell.clone(), held.clone()), no_cell, &[Cell, Temperature]),
            (plan(json!(null), held.clone()), EVERYTHING, &[Cell, Scanner, Temperature]),
            (plan(json!(null), held.clone()), no_cell, &[Temperature]),
            (plan(json!(null), held.clone()), nothing_moved, &[Temperature]),
            (plan(in_cell, held), GivenBeside { has_part: false, ..EVERYTHING }, &[Scanner, Fixture, Temperature]),
            (program.clone(), EVERYTHING, &[Scanner]),
            (program.clone(), no_cell, &[Cell, Scanner, Part, Temperature]),
            (program, GivenBeside { has_part: false, ..nothing_moved }, &[Scanner, Fixture, Temperature]),
            (json!({"colour": 1}), EVERYTHING, &[]),
        ] {
            assert_eq!(refused(&document, &given), expected, "{document}");
        }
    }
}
