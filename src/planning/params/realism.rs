//! The gap between simulated and scanned coverage: which measured area counts as at risk ([`crate::planning::method::realism`]).

use super::knob::params;
use crate::cell::Findings;

params! {
    /// Measured area that may be missing from a real scan ([`crate::planning::method::realism`]).
    RealismParams {
        /// Width of the zone along concave edges in which measured surface is at risk, mm; 0 disables it. The zone is from the
        /// thesis (§4.2.2: 98.91 % simulated, 97 % scanned, the difference mainly in right-angle concave sections); its width has
        /// no published source.
        concave_zone_mm: f64 = 2.0, [0.0, 100.0] "mm";
        /// Opening angle between two faces, measured through the air, below which their edge counts as concave, degrees. The
        /// default is a right angle plus 30°; it has no published source.
        concave_dihedral_deg: f64 = 120.0, [1.0, 175.0] "°";
        /// Distance from the border of an image within which measured surface is at risk, pixels; 0 disables it. It has no
        /// published source.
        frame_margin_px: f64 = 10.0, [0.0, 10_000.0] "px";
        /// Distance from a depth discontinuity in an image within which measured surface is at risk, pixels; 0 disables it. It
        /// has no published source.
        silhouette_margin_px: f64 = 2.0, [0.0, 1000.0] "px";
        /// Counts area at risk as measured, and reports it separately; `false` leaves it out of every figure of measured area.
        /// Either way, views are chosen as if it counted.
        count_at_risk: bool = true;
    }
}

impl RealismParams {
    /// Checks every range.
    pub(super) fn check(&self, findings: &mut Findings) {
        self.check_ranges("/realism", findings);
    }
}
