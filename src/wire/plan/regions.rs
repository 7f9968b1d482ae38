//! Regions of interest and features in `plan.json`: what was asked of each, what was reached, and why not more.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::planning::plan::{Cause, RegionCoverage};
use crate::wire::words::shortfall;

/// Coverage of a region; only what meets the requirements of the region counts as measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RegionCoverageDocument {
    /// Name of the region.
    pub name: String,
    /// Kind of the region; empty in plans from before it was introduced.
    #[serde(default)]
    #[schema(value_type = crate::planning::plan::RegionKind)]
    pub kind: String,
    /// Number of asked samples in the region.
    #[serde(default)]
    pub samples: usize,
    /// Asked area of the region.
    pub asked_area_mm2: f64,
    /// Asked area of the region that at least one kept candidate measures.
    pub coverable_area_mm2: f64,
    /// Asked area of the region that at least one chosen view measures.
    #[serde(default)]
    pub measured_area_mm2: f64,
    /// Measured share of the asked area.
    pub of_asked: f64,
    /// Measured share of the coverable area.
    pub of_coverable: f64,
    /// Target for the measured share of the asked area.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<f64>,
    /// True if `of_asked` reaches the target; absent without a target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub met: Option<bool>,
    /// Tolerance of a feature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_mm: Option<f64>,
    /// Finest tolerance that `params.regions.noise` can serve anywhere; present for features.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_tolerance_mm: Option<f64>,
    /// Missed part of the asked area by cause, largest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missed: Vec<RegionMissDocument>,
    /// Area missed as `below_grade` because a tolerance there is finer than the scanner's noise can serve anywhere.
    #[serde(default)]
    pub beyond_noise_area_mm2: f64,
    /// Reasons for which the target is not reached, in words, those of most area first; absent if it is reached or there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why_unmet: Option<String>,
}

/// Area of a region that is missed for one cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RegionMissDocument {
    /// Cause for which the area is missed.
    #[schema(value_type = crate::planning::verdict::Cause)]
    pub reason: String,
    /// Missed area.
    pub area_mm2: f64,
}

impl From<&RegionCoverage> for RegionCoverageDocument {
    fn from(region: &RegionCoverage) -> Self {
        let miss =
            |(cause, area_mm2): &(Cause, f64)| RegionMissDocument { reason: cause.as_str().to_owned(), area_mm2: *area_mm2 };
        Self {
            name: region.name.clone(),
            kind: region.kind.as_str().to_owned(),
            samples: region.samples,
            asked_area_mm2: region.asked_area_mm2,
            coverable_area_mm2: region.coverable_area_mm2,
            measured_area_mm2: region.measured_area_mm2,
            of_asked: region.of_asked(),
            of_coverable: region.of_coverable(),
            target: region.target,
            met: region.is_met(),
            tolerance_mm: region.tolerance_mm,
            min_tolerance_mm: region.tolerance_mm.map(|_| region.min_tolerance_mm),
            missed: region.missed_mm2.iter().map(miss).collect(),
            beyond_noise_area_mm2: region.beyond_noise_area_mm2,
            why_unmet: shortfall(region),
        }
    }
}
