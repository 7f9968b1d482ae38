//! Measured area that a real scan may lack, in `plan.json` and `coverage.json`.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::planning::plan::{Coverage, RiskReason, share};

/// Asked area that at least one chosen view measures in the simulation but that may be missing from a real scan. Figures are
/// those of the samples that the views were chosen on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct AtRiskDocument {
    /// Area at risk.
    pub area_mm2: f64,
    /// Area at risk as a share of the asked area.
    pub of_asked: f64,
    /// Area at risk as a share of the visible area.
    pub of_visible: f64,
    /// True if the area at risk counts as measured (`params.realism.count_at_risk`); else it is missed as `at_risk`.
    pub counted: bool,
    /// Area at risk by reason. A part of the surface that is at risk for several reasons counts in each.
    pub reasons: Vec<RiskReasonDocument>,
}

/// Area at risk for one reason.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RiskReasonDocument {
    /// Reason for which the area is at risk.
    #[schema(value_type = crate::planning::plan::RiskReason)]
    pub reason: String,
    /// Area at risk for this reason.
    pub area_mm2: f64,
    /// Area at risk for this reason as a share of the visible area.
    pub of_visible: f64,
}

impl From<&Coverage> for AtRiskDocument {
    fn from(coverage: &Coverage) -> Self {
        let at_risk = &coverage.at_risk;
        let of_visible = |area_mm2: f64| share(area_mm2, coverage.visible_area_mm2);
        let reason = |(reason, area_mm2): (RiskReason, f64)| RiskReasonDocument {
            reason: reason.as_str().to_owned(),
            area_mm2,
            of_visible: of_visible(area_mm2),
        };
        Self {
            area_mm2: at_risk.area_mm2,
            of_asked: share(at_risk.area_mm2, coverage.asked_area_mm2),
            of_visible: of_visible(at_risk.area_mm2),
            counted: at_risk.is_counted,
            reasons: RiskReason::ALL.into_iter().zip(at_risk.by_reason_mm2).map(reason).collect(),
        }
    }
}
