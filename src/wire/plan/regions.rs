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
    /// Target for the measured share of the asked area; absent in a plan of what earlier scans left open, as a target is one for the whole
    /// region.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<f64>,
    /// True if `of_asked` reaches the target; absent without a target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub met: Option<bool>,
    /// Width of a feature's tolerance zone, from limit to limit: 0.3 for ±0.15 mm in a drawing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_mm: Option<f64>,
    /// Width of the finest tolerance zone that `params.regions.noise` can serve anywhere; present for features.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_tolerance_mm: Option<f64>,
    /// Missed part of the asked area by cause, largest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missed: Vec<RegionMissDocument>,
    /// Area missed as `below_grade` because a tolerance there is finer than the scanner's noise can serve anywhere.
    #[serde(default)]
    pub beyond_noise_area_mm2: f64,
    /// Number of asked samples in the region of a second set, on which the views were not chosen; absent if that has none there, and in
    /// plans from before it was introduced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub independent_samples: Option<usize>,
    /// Measured share of the asked area on these independent samples: the figure to trust.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub independent_of_asked: Option<f64>,
    /// Standard error of `independent_of_asked`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub independent_standard_error: Option<f64>,
    /// True if `independent_of_asked` reaches the target or misses it by no more than its standard error; absent without either.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub independently_met: Option<bool>,
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

impl RegionCoverageDocument {
    /// Returns true if the target is reached on the samples of the plan and missed on those that the views were not chosen on.
    #[must_use]
    pub fn is_refuted(&self) -> bool {
        self.met == Some(true) && self.independently_met == Some(false)
    }
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
            independent_samples: region.independent.map(|independent| independent.samples),
            independent_of_asked: region.independent.map(|independent| independent.of_asked()),
            independent_standard_error: region.independent.map(|independent| independent.standard_error()),
            independently_met: region.is_met_independently(),
            why_unmet: shortfall(region),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::plan::{IndependentRegion, RegionKind};

    /// A region of 20 mm² with a target of 0.95, which is met on the samples of the plan.
    fn region(independent: Option<IndependentRegion>) -> RegionCoverage {
        RegionCoverage {
            name: "seat".into(),
            kind: RegionKind::Interest,
            samples: 100,
            asked_area_mm2: 20.0,
            coverable_area_mm2: 20.0,
            measured_area_mm2: 19.2,
            target: Some(0.95),
            tolerance_mm: None,
            min_tolerance_mm: 0.156,
            missed_mm2: Vec::new(),
            beyond_noise_area_mm2: 0.0,
            independent,
        }
    }

    #[test]
    fn a_region_tells_its_share_on_other_samples_and_one_from_before_them_is_read() {
        let independent =
            IndependentRegion { samples: 400, asked_area_mm2: 20.0, measured_area_mm2: 18.0, squares_mm4: 400.0 * 0.05 * 0.05 };
        let document = RegionCoverageDocument::from(&region(Some(independent)));
        assert_eq!((document.met, document.independently_met), (Some(true), Some(false)));
        assert!(document.is_refuted() && !RegionCoverageDocument::from(&region(None)).is_refuted());
        assert_eq!((document.independent_samples, document.independent_of_asked), (Some(400), Some(0.9)));
        // Agresti and Coull's p̃ = 360.5 / 401.
        let expected = (360.5 * 40.5 / 401.0_f64.powi(3)).sqrt();
        assert!(document.independent_standard_error.is_some_and(|error| (error - expected).abs() < 1e-12), "{document:?}");
        let json = serde_json::to_value(RegionCoverageDocument::from(&region(None))).unwrap_or_default();
        let names = ["independent_samples", "independent_of_asked", "independent_standard_error", "independently_met"];
        assert!(names.iter().all(|name| json.get(name).is_none()), "{json}");
        let read: Option<RegionCoverageDocument> = serde_json::from_value(json).ok();
        assert_eq!(read.map(|region| (region.met, region.independently_met)), Some((Some(true), None)));
    }
}
