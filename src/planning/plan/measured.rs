//! Area that views measure together, and its shares of what can be seen.

use super::share;

/// Incidences up to which area is counted apart, degrees, ascending. 35 is the limit for accurate data of Prieto, Redarce,
/// Boulanger and Lepage (1999), which the thesis cites (§3.2.1.3); 60 is our choice.
pub const WITHIN_DEG: [f64; 2] = [35.0, 60.0];

/// Asked area that at least one of some views measures, mm².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasuredArea {
    /// All of it.
    pub area_mm2: f64,
    /// Area by best grade A, B, C, D.
    pub grade_area_mm2: [f64; 4],
    /// Area up to each incidence of [`WITHIN_DEG`], against the direction to the viewpoint that sees it most squarely.
    pub within_area_mm2: [f64; 2],
}

/// Shares of the visible area: what a plan is judged by first ([`crate::planning::method::coverage`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibleShares {
    /// Measured.
    pub measured: f64,
    /// Measured at grade A or B.
    pub grades_a_b: f64,
    /// Measured up to each incidence of [`WITHIN_DEG`].
    pub within: [f64; 2],
}

impl MeasuredArea {
    /// Shares of a visible area.
    #[must_use]
    pub fn of_visible(&self, visible_area_mm2: f64) -> VisibleShares {
        let of_visible = |area_mm2: f64| share(area_mm2, visible_area_mm2);
        let [a, b, ..] = self.grade_area_mm2;
        VisibleShares {
            measured: of_visible(self.area_mm2),
            grades_a_b: of_visible(a + b),
            within: self.within_area_mm2.map(of_visible),
        }
    }
}
