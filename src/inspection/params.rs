//! Knobs of an inspection.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::coverage::CompareParams;
use super::deviation::Alignment;
use crate::cell::{FieldError, Findings};
use crate::planning::params::knob::params;

params! {
    /// The registration of the scans with the part.
    AlignParams {
        /// Way in which scans and part are brought together.
        method: Alignment = Alignment::BestFit;
        /// Region of interest or feature of the plan that `best_fit_on` aligns by.
        region: Option<String> = None;
        /// Expected error of a view's rotation before the alignment, in degrees: its standard deviation about each axis. Default:
        /// that of the cell's calibration; without a calibration 0.05°. The smaller it is, the less the alignment turns a view
        /// against the others, and the surer are distances between surfaces that no view shows together. For one merged cloud,
        /// it states how exactly the views were merged; without it, no such error is assumed.
        prior_deg: Option<f64> = None, [1e-4, 10.0] "°";
        /// Expected error of a view's position before the alignment, in mm: its standard deviation along each axis. Default: that
        /// of the cell's calibration; without a calibration 0.2 mm. The smaller it is, the less the alignment shifts a view
        /// against the others, and the surer are distances between surfaces that no view shows together. For one merged cloud,
        /// it states how exactly the views were merged; without it, no such error is assumed.
        prior_mm: Option<f64> = None, [1e-3, 100.0] "mm";
    }
}

/// Parameters of an inspection.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct InspectionParams {
    /// Registration of the scans.
    pub align: AlignParams,
    /// Measured coverage and losses.
    pub compare: CompareParams,
}

impl InspectionParams {
    /// Checks every range.
    ///
    /// # Errors
    /// Every value that is out of its range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        self.align.check_ranges("/align", &mut findings);
        let needs_region = self.align.method == Alignment::BestFitOn;
        findings.require(self.align.region.is_some() == needs_region, "/align/region", || {
            "is for align.method=best_fit_on, which needs it: a region of interest or a feature of the plan".to_owned()
        });
        if let Err(errors) = self.compare.check() {
            errors.into_iter().for_each(|error| findings.push(error.pointer, error.detail));
        }
        findings.into_result()
    }
}
