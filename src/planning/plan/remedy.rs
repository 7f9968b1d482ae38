//! Remedies of a missed spot.

use super::Turn;
use crate::cell::closed_list;
use crate::geometry::{Part, Pose, ScannerFrame, Table};
use crate::planning::ids::CandidateId;

closed_list! {
    /// A kind of remedy, in the order in which they are tried.
    pub enum RemedyKind {
        /// Choose candidates that measure it and were left out.
        View = "view",
        /// A candidate turned about its viewing axis.
        Roll = "roll",
        /// A candidate with its axis turned, aimed at the spot.
        Tilt = "tilt",
        /// A candidate at another distance.
        Standoff = "standoff",
        /// The part turned onto another side.
        Setup = "setup",
        /// A larger limit of incidence, where the job had tightened that of a device: at most the device's own.
        Limit = "limit",
        /// No views that were tried measure half of the spot.
        None = "none",
    }
}

/// The cheapest remedy that was tried and [works](Self::works) for a spot; else the cheapest whose views together measure at
/// least half of the spot's area; else the finding that none does. Measured is meant by the plan's own definition of visibility;
/// with a cell also from a station free of collision to which a path leads, except in another setup.
#[derive(Clone, Debug, PartialEq)]
pub struct Remedy {
    /// Kind of remedy.
    pub kind: RemedyKind,
    /// The views, best first, at most 8. None where the kind is [`RemedyKind::None`].
    pub views: Vec<RemedyView>,
    /// Pose of the part for [`RemedyKind::Setup`], to give as `part.table_from_part`.
    pub table_from_part: Option<Pose<Table, Part>>,
    /// Turn into that pose from the first setup.
    pub turn: Option<Turn>,
    /// Limit of the cameras that is needed, where it has to be raised, degrees; at most the own limit of each.
    pub camera_deg: Option<f64>,
    /// Limit of the projector that is needed, where it has to be raised, degrees; at most its own.
    pub projector_deg: Option<f64>,
    /// Area of the spot that the views together measure.
    pub area_mm2: f64,
    /// Share of the spot that the views together measure.
    pub of_spot: f64,
    /// Views that were tried for this spot.
    pub tried: usize,
}

/// A view of a remedy.
#[derive(Clone, Debug, PartialEq)]
pub struct RemedyView {
    /// The candidate that it was made from: itself for [`RemedyKind::View`].
    pub candidate: CandidateId,
    /// Turned about the viewing axis against that candidate.
    pub roll_rad: f64,
    /// Angle between the viewing axes of the two.
    pub tilt_rad: f64,
    /// Depth of the spot's centre below the viewpoint, along the viewing axis.
    pub standoff_mm: f64,
    /// The view.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Area of the spot that it adds to those before it.
    pub area_mm2: f64,
}

impl Remedy {
    /// Smallest share of a spot that a remedy measures which works.
    pub const WORKS_FROM: f64 = 0.9;

    /// Returns true if the views together measure so much of the spot that it counts as mended.
    #[must_use]
    pub fn works(&self) -> bool {
        self.of_spot >= Self::WORKS_FROM
    }

    /// The finding that no views that were tried measure half of the spot.
    pub(in crate::planning) fn none(tried: usize) -> Self {
        Self {
            kind: RemedyKind::None,
            views: Vec::new(),
            table_from_part: None,
            turn: None,
            camera_deg: None,
            projector_deg: None,
            area_mm2: 0.0,
            of_spot: 0.0,
            tried,
        }
    }
}
