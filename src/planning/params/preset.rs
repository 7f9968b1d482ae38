//! Named sets of parameter values.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{CandidateParams, PlanParams, Solver, Standoff, Strategy};
use crate::cell::Findings;

/// Named set of parameter values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// The defaults: the fewest views that reach the target and keep the grades, then the best choice of that many.
    #[default]
    Vantage,
    /// The thesis's method: greedy selection with a = b = 0.5 among the 54 candidates per block of Algorithm 1, whose distance is
    /// not adjusted afterwards.
    Thesis,
}

impl Preset {
    /// Parameters with the values of the preset.
    #[must_use]
    pub fn apply(self, params: &PlanParams) -> PlanParams {
        let mut applied = params.clone();
        if self == Self::Thesis {
            (applied.score.a, applied.score.b) = (0.5, 0.5);
            applied.candidates = CandidateParams {
                strategies: vec![Strategy::Ellipsoid],
                step_small_deg: 30.0,
                step_large_deg: 45.0,
                rolls_deg: vec![0.0],
                standoff: Standoff::FirstSurface,
                ..applied.candidates
            };
            applied.selection.solver = Solver::Greedy;
        }
        applied
    }

    /// Refuses parameters whose values differ from those of the preset.
    pub(super) fn check(self, params: &PlanParams, findings: &mut Findings) {
        let (default, applied) = (PlanParams::default(), self.apply(params));
        let mut require = |same: bool, at: &str| {
            findings.require(same, at, || "is set by preset = thesis; leave it out, or leave out the preset".into());
        };
        let (own, preset, none) = (&params.candidates, &applied.candidates, &default.candidates);
        require(own.strategies == preset.strategies || own.strategies == none.strategies, "/candidates/strategies");
        require(own.rolls_deg == preset.rolls_deg || own.rolls_deg == none.rolls_deg, "/candidates/rolls_deg");
        require(own.standoff == preset.standoff || own.standoff == none.standoff, "/candidates/standoff");
        require(own.step_small_deg.to_bits() == preset.step_small_deg.to_bits(), "/candidates/step_small_deg");
        require(own.step_large_deg.to_bits() == preset.step_large_deg.to_bits(), "/candidates/step_large_deg");
        require(params.score.a.to_bits() == applied.score.a.to_bits(), "/score/a");
        require(params.score.b.to_bits() == applied.score.b.to_bits(), "/score/b");
        let (own, preset, none) = (params.selection.solver, applied.selection.solver, default.selection.solver);
        require(own == preset || own == none, "/selection/solver");
    }
}
