//! Stations to an order and joint paths, from and back to home.

use super::plan::ViewId;
use super::stations::Station;

pub use crate::cell::Configuration;

/// One move. All points are joined by straight joint-space segments, table included, and were checked as such.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Points between start and target, both left out.
    pub via_rad: Vec<Configuration>,
    /// Where it ends.
    pub target: Station,
    /// Predicted time.
    pub duration_secs: f64,
}

/// A tour from home through every view with a station, and back.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Views in the order visited, each with the move that leads to it.
    pub visits: Vec<(ViewId, Leg)>,
    /// The move home.
    pub return_home: Leg,
}

/// A sequence, and the views to which no path was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Ordered {
    /// The tour through all other views.
    pub sequence: Sequence,
    /// Views left out.
    pub no_path: Vec<ViewId>,
}
