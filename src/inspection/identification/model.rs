//! Rate at which the scanner returns a point that all its devices see: the product of the rates by incidence, mirror angle and depth.

use super::RateCurve;
use crate::inspection::coverage::Return;

/// Identified rates of return.
#[derive(Clone, Debug, PartialEq)]
pub struct ReturnModel {
    /// Rate of easy pairs.
    pub easy_rate: f64,
    /// Rate by the worst incidence, degrees.
    pub incidence: RateCurve,
    /// Rate by the mirror angle, degrees.
    pub mirror: RateCurve,
    /// Rate by depth, mm.
    pub depth: RateCurve,
}

impl Default for ReturnModel {
    /// A scanner that returns all that it sees.
    fn default() -> Self {
        let nothing_known = RateCurve::default;
        Self { easy_rate: 1.0, incidence: nothing_known(), mirror: nothing_known(), depth: nothing_known() }
    }
}

impl ReturnModel {
    /// Rate at an incidence, a mirror angle, both in rad, and a depth.
    #[must_use]
    pub fn rate(&self, worst_incidence_rad: f64, mirror_rad: f64, depth_mm: f64) -> f64 {
        self.easy_rate
            * self.incidence.rate(worst_incidence_rad.to_degrees())
            * self.mirror.rate(mirror_rad.to_degrees())
            * self.depth.rate(depth_mm)
    }

    /// Rate of a pair of view and sample.
    #[must_use]
    pub fn rate_of(&self, pair: &Return) -> f64 {
        self.rate(pair.worst_incidence().1, pair.mirror_rad, pair.depth_mm)
    }
}
