//! Knobs of the comparison of scans with their plan.

use crate::cell::{FieldError, Findings};
use crate::planning::params::knob::params;

params! {
    /// The comparison of scans with their plan: when a sample counts as measured, and how losses are told apart.
    CompareParams {
        /// Distance from the model's surface within which a point measures it; at least four sigma of the expected noise.
        tolerance_mm: f64 = 0.15, [1e-3, 100.0] "mm";
        /// Angle between the normals of the points and of the model within which they are one surface.
        normal_deg: f64 = 30.0, [1.0, 90.0] "°";
        /// Distance from the model's surface within which a point is taken for a deviating surface; one that lies farther in front
        /// is another body.
        search_mm: f64 = 5.0, [0.1, 1000.0] "mm";
        /// Distance from a limit of incidence within which a sample may fall on either side.
        band_deg: f64 = 2.0, [0.0, 45.0] "°";
        /// Distance from a step of depth within which scanners may lack points, pixels. It has no published source.
        edge_px: f64 = 10.0, [0.0, 1000.0] "px";
        /// Smallest depth discontinuity that counts as an edge, mm.
        edge_step_mm: f64 = 5.0, [0.01, 1000.0] "mm";
    }
}

impl CompareParams {
    /// Checks every range; pointers begin with `/compare`.
    ///
    /// # Errors
    /// Every value that is out of its range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check_ranges("/compare", &mut findings);
        findings.into_result()
    }
}
