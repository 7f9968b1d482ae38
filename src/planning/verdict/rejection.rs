//! Rejections of candidates before views are chosen: the closed list of reasons, and their numbers.

use std::collections::BTreeMap;

use crate::cell::closed_list;

closed_list! {
    /// Reason for which a candidate was dropped before selection.
    pub enum Rejection {
        /// A device or the viewpoint lies below the plate's plane.
        BelowTable = "below_table",
        /// The viewpoint lies lower over the plate, seen from its centre, than `candidates.min_elevation_deg`.
        LowElevation = "low_elevation",
        /// Inside the part.
        InsidePart = "inside_part",
        /// Inside an obstacle, at every table angle.
        InsideObstacle = "inside_obstacle",
        /// The scanner's body, or what holds it on the flange, is closer to the plate than the clearance.
        BodyMeetsPlate = "body_meets_plate",
        /// The scanner's body, or what holds it on the flange, is closer to the part or its fixture than the clearance.
        BodyMeetsPart = "body_meets_part",
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

closed_list! {
    /// Fate of a candidate.
    pub enum Fate {
        /// A view of the plan.
        Chosen = "chosen",
        /// Usable, and not chosen.
        NotChosen = "not_chosen",
        /// Given up, since no path to it was found.
        NoPath = "no_path",
        /// Dropped before selection.
        Dropped = "dropped",
    }
}

impl Rejection {
    /// Returns true if what the flange carries meets what the plate carries, wherever arm and table are: a collision that the
    /// pose alone shows.
    #[must_use]
    pub fn is_collision_of_body(self) -> bool {
        matches!(self, Self::BodyMeetsPlate | Self::BodyMeetsPart)
    }

    /// Returns true if candidates are dropped for this reason only once it is known what they measure.
    #[must_use]
    pub fn is_of_evaluated(self) -> bool {
        matches!(self, Self::MeasuresNothing | Self::NotNeeded)
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
