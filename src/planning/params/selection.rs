//! Formulation of the selection, overlap for registration, and the range checks of
//! these knobs.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::SelectionParams;
use crate::cell::Findings;

/// Formulation that is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SelectionGoal {
    /// The fewest views that reach the target (set cover with a partial target).
    #[default]
    FewestViews,
    /// The shortest cycle that reaches the target: of the fewest views those that take the least time to go through. Needs a
    /// cell; without one it is `fewest_views`.
    MinTime,
    /// The largest asked area with `selection.max_views` views (maximum coverage); targets do not count.
    BestCoverage,
}

/// Chosen views form a connected graph whose edges join views that measure at least so much asked area together. At most
/// one of the two is given; with neither, nothing is asked for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct OverlapParams {
    /// Shared asked area, mm², above 0 to 1 000 000 000.
    pub min_area_mm2: Option<f64>,
    /// Shared asked area as a share of what the view that measures less of the two measures, above 0 to 1.
    pub min_share: Option<f64>,
}

pub(super) fn check(params: &SelectionParams, findings: &mut Findings) {
    let overlap = &params.overlap;
    if let Some(area_mm2) = overlap.min_area_mm2 {
        findings.range("/selection/overlap/min_area_mm2", area_mm2, 1e-6, 1e9, "mm²");
    }
    if let Some(share) = overlap.min_share {
        findings.range("/selection/overlap/min_share", share, 1e-6, 1.0, "");
    }
    findings.require(overlap.min_area_mm2.is_none() || overlap.min_share.is_none(), "/selection/overlap/min_share", || {
        "is given beside min_area_mm2; give one of the two".into()
    });
    findings.range("/selection/view_cost_mm2_per_s", params.view_cost_mm2_per_s, 0.0, 1e6, "mm²/s");
    findings.range("/selection/work_limit", f64::from(params.work_limit), 1.0, 1e7, "million pairs");
    findings.require(params.goal != SelectionGoal::BestCoverage || params.max_views.is_some(), "/selection/max_views", || {
        "is not given; best_coverage needs the number of views".into()
    });
}
