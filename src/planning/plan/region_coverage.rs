//! Coverage of a region of interest or a feature, held against its own target, and the causes of what it misses.

use super::share;
use crate::planning::surface::requirements::RegionKind;
use crate::planning::verdict::Cause;

/// Rounding of a share: sums of areas in another order.
pub(in crate::planning) const SHARE_SLACK: f64 = 4e-9;

/// Coverage of a region, counting only what is measured as well as is asked there.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionCoverage {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: RegionKind,
    /// Number of asked samples in it.
    pub samples: usize,
    /// Its asked area.
    pub asked_area_mm2: f64,
    /// Part of the asked area that some kept candidate measures.
    pub coverable_area_mm2: f64,
    /// Part of the asked area that the chosen views measure.
    pub measured_area_mm2: f64,
    /// Share of the asked area that was to be measured.
    pub target: Option<f64>,
    /// Width of the tolerance zone of a feature.
    pub tolerance_mm: Option<f64>,
    /// Finest tolerance that the noise of the job can serve.
    pub min_tolerance_mm: f64,
    /// Missed part of the asked area by cause, the largest first.
    pub missed_mm2: Vec<(Cause, f64)>,
    /// Area that is missed as [`Cause::BelowGrade`] where a finer tolerance is asked for than the noise can serve.
    pub beyond_noise_area_mm2: f64,
}

impl RegionCoverage {
    /// Measured share of the asked area; 0 where nothing of the region is asked for.
    #[must_use]
    pub fn of_asked(&self) -> f64 {
        share(self.measured_area_mm2, self.asked_area_mm2)
    }

    /// Measured share of the coverable area.
    #[must_use]
    pub fn of_coverable(&self) -> f64 {
        share(self.measured_area_mm2, self.coverable_area_mm2)
    }

    /// True if the measured share of the asked area reaches the target; `None` without a target.
    #[must_use]
    pub fn is_met(&self) -> Option<bool> {
        self.target.map(|target| self.of_asked() >= target - SHARE_SLACK)
    }

    /// Returns true if there is a target and it is not reached.
    #[must_use]
    pub fn is_unmet(&self) -> bool {
        self.is_met() == Some(false)
    }
}
