//! Rules for further views of a part after a scan.

use super::knob::params;
use crate::cell::{FieldError, Findings};

params! {
    /// Stop rules of a rescan. The defaults are from closed loops on two parts: without a limit of views a rescan to the target of the
    /// plan takes twice the views for less than a point.
    RescanParams {
        /// Largest number of views a round.
        max_views: u32 = 4, [1.0, 1000.0] "views";
        /// Least share of the asked area that a view has to be expected to add.
        min_gain: f64 = 0.002, [0.0, 1.0] "";
        /// Largest number of rounds.
        max_rounds: u32 = 2, [1.0, 100.0] "rounds";
        /// Least share of the asked area that all further views together have to be expected to add.
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
