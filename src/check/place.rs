//! Surroundings that documents are checked in: a cell, or none, as of jobs and plans of viewpoints alone.

use serde_json::Value;

use super::{kind_of, read_plan};
use crate::cell::{Cell, Scanner};
use crate::wire::DocumentKind;

/// Name that stands for no cell, as it does in a job.
pub const NO_CELL: &str = "none";
/// Scanner of a job without a cell that names none.
const SCANNER_OF_JOBS: &str = "transcan-c";

/// Surroundings that plans and programs are checked in, and whose scanner the limits of parameters are held against.
#[derive(Clone, Copy)]
pub enum CheckPlace<'a> {
    /// A cell.
    Cell(&'a Cell),
    /// Surroundings without a cell, as a plan of viewpoints alone has; with the scanner, where it is known.
    NoCell(Option<&'a Scanner>),
}

impl<'a> CheckPlace<'a> {
    /// The cell, if it is one.
    pub(super) fn cell(self) -> Option<&'a Cell> {
        match self {
            Self::Cell(cell) => Some(cell),
            Self::NoCell(_) => None,
        }
    }

    /// The scanner: the cell's own, if it is one.
    pub(super) fn scanner(self) -> Option<&'a Scanner> {
        match self {
            Self::Cell(cell) => Some(&cell.scanner),
            Self::NoCell(scanner) => scanner,
        }
    }
}

/// Returns true for a plan that was made without a cell.
#[must_use]
pub fn is_plan_without_cell(document: &Value) -> bool {
    kind_of(document) == Some(DocumentKind::Plan) && document["cell"].is_null()
}

/// Scanner that a document without a cell is meant for where none is given: of a plan the one that it names, if `find` knows it
/// and it has not changed since; of parameters that of jobs.
#[must_use]
pub fn implied_scanner(document: &Value, find: impl FnOnce(&str) -> Option<Scanner>) -> Option<Scanner> {
    match kind_of(document)? {
        DocumentKind::Params => find(SCANNER_OF_JOBS),
        DocumentKind::Plan => {
            let plan = read_plan(document.clone()).ok()?;
            find(&plan.scanner.name).filter(|scanner| plan.scanner_differences(scanner).is_empty())
        }
        DocumentKind::Scanner | DocumentKind::Robot | DocumentKind::Turntable | DocumentKind::Cell | DocumentKind::Program => {
            None
        }
    }
}
