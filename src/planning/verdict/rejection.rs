//! Rejections of candidates before views are chosen: the closed list of reasons, and their numbers.

use std::collections::BTreeMap;

use crate::cell::closed_list;

closed_list! {
    /// Reason for which a candidate was dropped before selection.
    pub enum Rejection {
        /// A device or the viewpoint lies below the plate's plane.
        BelowTable = "below_table",
        /// Inside the part.
        InsidePart = "inside_part",
        /// Inside an obstacle, at every table angle.
        InsideObstacle = "inside_obstacle",
        /// Out of the robot's reach at every table angle.
        Unreachable = "unreachable",
        /// Reached, but something collides at every station.
        Collision = "collision",
        /// Duplicate of a candidate with a lower number.
        Duplicate = "duplicate",
        /// Measures nothing that is asked for.
        MeasuresNothing = "measures_nothing",
        /// Aimed at what was uncovered, and not among the fewest that cover most of it.
        NotNeeded = "not_needed",
    }
}

/// Numbers of candidates.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CandidateCounts {
    /// Generated.
    pub generated: usize,
    /// Kept for selection: those that no filter dropped and the cell can use.
    pub kept: usize,
    /// Dropped, by reason.
    pub rejected: BTreeMap<Rejection, usize>,
}
