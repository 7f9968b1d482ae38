//! Patches to viewpoints.

use crate::geometry::{Part, Pose, Scanner as ScannerFrame};

/// Dense number of a candidate, as generated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CandidateId(pub u32);

/// Which side of the part a viewpoint looks at (method §3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Label {
    /// Polar angle up to 60°.
    Top,
    /// Polar angle from 150°.
    Bottom,
    /// Azimuth sector around +x.
    Right,
    /// Azimuth sector around +y.
    Back,
    /// Azimuth sector around −x.
    Left,
    /// Azimuth sector around −y.
    Front,
}

impl Label {
    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Top => "top",
            Self::Bottom => "bottom",
            Self::Right => "right",
            Self::Back => "back",
            Self::Left => "left",
            Self::Front => "front",
        }
    }
}

/// Why a candidate was dropped before selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rejection {
    /// A device or the viewpoint lies below the plate's plane.
    BelowTable,
    /// Inside the part.
    InsidePart,
    /// Inside an obstacle, at every table angle.
    InsideObstacle,
    /// Out of the robot's reach at every table angle.
    Unreachable,
    /// Reached, but something collides at every station.
    Collision,
}

impl Rejection {
    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::BelowTable => "below_table",
            Self::InsidePart => "inside_part",
            Self::InsideObstacle => "inside_obstacle",
            Self::Unreachable => "unreachable",
            Self::Collision => "collision",
        }
    }
}

/// A viewpoint under consideration.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Number as generated; ties break by it.
    pub id: CandidateId,
    /// Its pose.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Which side it looks at.
    pub label: Label,
}
