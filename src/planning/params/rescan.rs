//! Rules for further views of a part after a scan.

use super::knob::params;
use crate::cell::{FieldError, Findings};

params! {
    /// Stopping rules of a rescan. The defaults come from closed-loop trials on two parts: without a limit of views, a rescan to
    /// the target of the plan takes twice the views for less than one percentage point.
    RescanParams {
        /// Maximum number of views per round.
        max_views: u32 = 4, [1.0, 1000.0] "views";
        /// Minimum share of the asked area that each further view must be expected to add.
        min_gain: f64 = 0.002, [0.0, 1.0] "";
        /// Maximum number of rounds.
        max_rounds: u32 = 2, [1.0, 100.0] "rounds";
        /// Minimum share of the asked area that all further views together must be expected to add; below it, none is planned.
        min_left: f64 = 0.005, [0.0, 1.0] "";
    }
}

impl RescanParams {
    /// Checks every range.
    ///
    /// # Errors
    /// Every value that is out of its range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check_ranges("", &mut findings);
        findings.into_result()
    }
}
