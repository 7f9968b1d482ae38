//! The gap between simulated and scanned coverage: which measured area counts as at risk ([`crate::planning::method::realism`]).

use super::knob::params;
use crate::cell::Findings;

params! {
    /// Measured area that a real scan may lack ([`crate::planning::method::realism`]).
    RealismParams {
        /// Width of the zone along concave edges, mm; 0 leaves it out. The zone has a source (the thesis, §4.2.2: 98.91 % simulated,
        /// 97 % scanned, the difference mainly in right-angle concave sections), its width has none.
        concave_zone_mm: f64 = 2.0, [0.0, 100.0] "mm";
        /// Angle between the faces of an edge, measured in the air, below which the edge is concave, degrees: a right angle and 30°
        /// more. It has no published source.
        concave_dihedral_deg: f64 = 120.0, [1.0, 175.0] "°";
        /// Distance from the border of an image within which a sample is at risk, pixels; 0 leaves it out. It has no published
        /// source.
        frame_margin_px: f64 = 10.0, [0.0, 10_000.0] "px";
        /// Distance from a jump of depth in an image within which a sample is at risk, pixels; 0 leaves it out. It has no
        /// published source.
        silhouette_margin_px: f64 = 2.0, [0.0, 1000.0] "px";
        /// Counts area at risk as measured, and tells it apart; `false` takes it out of everything that is said to be measured.
        /// Views are chosen as if it counted.
        count_at_risk: bool = true;
    }
}

impl RealismParams {
    /// Checks every range.
    pub(super) fn check(&self, findings: &mut Findings) {
        self.check_ranges("/realism", findings);
    }
}
