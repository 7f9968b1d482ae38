//! Every candidate of a plan with its fate and its row: the matrices H and G of the thesis (§3.2.2), a row a candidate.

use super::ViewId;
use crate::geometry::{Part, Pose, Table};
use crate::planning::candidates::Candidate;
use crate::planning::verdict::{Fate, Rejection};
use crate::planning::visibility::Row;

/// Largest size of a file that lists the table, bytes: it is held in memory while it is made.
pub const MAX_LISTING_BYTES: usize = 512 << 20;

/// Every candidate as generated.
#[derive(Clone, Debug)]
pub struct CandidateTable {
    /// Poses of the part that were planned in, whether views are taken in them or not: a
    /// [`crate::planning::ids::SetupIndex`] is a place here.
    pub setups: Vec<Pose<Table, Part>>,
    /// The candidates, ascending by number.
    pub entries: Vec<TableEntry>,
}

/// A candidate with what became of it.
#[derive(Clone, Debug)]
pub struct TableEntry {
    /// The candidate.
    pub candidate: Candidate,
    /// Fate of the candidate.
    pub fate: CandidateFate,
    /// Samples that it measures, with its quality at each; `None` where it was dropped before it was evaluated.
    pub row: Option<Row>,
}

/// Fate of a candidate, with the view that it is or the reason for which it was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CandidateFate {
    /// The fate.
    pub fate: Fate,
    /// View of the plan that it is.
    pub view: Option<ViewId>,
    /// Reason for which it was dropped.
    pub rejection: Option<Rejection>,
}
