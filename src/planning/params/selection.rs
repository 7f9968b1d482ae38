//! Formulation of the selection, overlap for registration, and the checks of these parameters.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::knob::params;
use super::{Objective, ScoreParams, SelectionParams, Solver};
use crate::cell::Findings;

/// Goal of the selection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SelectionGoal {
    /// The fewest views that reach the target (set cover with a partial target).
    #[default]
    FewestViews,
    /// The shortest cycle that reaches the target: among selections of the fewest views, one that takes the least time. Needs a
    /// cell; without one it is `fewest_views`.
    MinTime,
    /// The largest asked area with `selection.max_views` views (maximum coverage); targets are ignored.
    BestCoverage,
}

params! {
    /// Overlap required of the chosen views: they must form a connected graph in which neighbours measure at least so much asked
    /// area in common. At most one of the two fields may be given; without either, no overlap is required.
    OverlapParams {
        /// Minimum asked area that two neighbouring views measure in common, mm².
        min_area_mm2: Option<f64> = None, [1e-6, 1e9] "mm²";
        /// Minimum asked area in common, as a share of what the view that measures less of the two measures.
        min_share: Option<f64> = None, [1e-6, 1.0] "";
    }
}

impl SelectionParams {
    /// Returns true if the selection can keep floors under grades: it exchanges views, and quality counts.
    #[must_use]
    pub fn keeps_grades(&self, score: &ScoreParams) -> bool {
        let exchanges = matches!(self.solver, Solver::Local | Solver::Certified);
        exchanges && self.objective == Objective::Score && score.b > 0.0 && self.goal != SelectionGoal::BestCoverage
    }

    pub(super) fn check(&self, findings: &mut Findings) {
        self.check_ranges("/selection", findings);
        let overlap = &self.overlap;
        overlap.check_ranges("/selection/overlap", findings);
        findings.require(overlap.min_area_mm2.is_none() || overlap.min_share.is_none(), "/selection/overlap/min_share", || {
            "is given beside min_area_mm2; give one of the two".into()
        });
        findings.require(self.goal != SelectionGoal::BestCoverage || self.max_views.is_some(), "/selection/max_views", || {
            "is not given; best_coverage needs the number of views".into()
        });
    }
}
