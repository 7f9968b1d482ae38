//! Measured area that a real scan may lack, apart from the rest ([`crate::planning::method::realism`]).

use super::Solution;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::CandidateIndex;
use crate::planning::plan::{AtRisk, RiskReason};
use crate::planning::realism::{self, RiskInput, RiskView, Risks};
use crate::planning::setups::Setup;
use crate::planning::visibility::SampleSet;

/// Judges what the views of a solution measure, each among all that it may see in its setup.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn risks(solution: &Solution<'_>, setups: &[Setup<'_>], ctx: &Context<'_>) -> Result<Risks, Cancelled> {
    let Solution { problem, chosen, measuring, .. } = solution;
    let input =
        RiskInput { mesh: problem.input.mesh, surface: &problem.surface, scanner: problem.input.scanner, params: problem.params };
    let view = |(candidate, row): (&CandidateIndex, _)| {
        let candidate = &problem.candidates[*candidate];
        let surfaces = setups[candidate.setup.index()].occluders.rays();
        RiskView { part_from_scanner: candidate.part_from_scanner, row, surfaces }
    };
    let views: Vec<RiskView<'_>> = chosen.candidates.iter().zip(measuring).map(view).collect();
    realism::risks(&input, &views, ctx)
}

/// Samples that are not counted as measured.
pub(super) fn left_out(solution: &Solution<'_>, risks: &Risks) -> SampleSet {
    match solution.problem.params.realism.count_at_risk {
        true => SampleSet::none_of(solution.problem.surface.sample_mm.len()),
        false => risks.samples(),
    }
}

/// Asked area at risk, in all and by reason.
pub(super) fn area(solution: &Solution<'_>, risks: &Risks) -> AtRisk {
    let problem = solution.problem;
    let mut at_risk = AtRisk { is_counted: problem.params.realism.count_at_risk, ..AtRisk::default() };
    for sample in risks.samples().iter() {
        let area_mm2 = problem.asked_area_mm2[sample.index()];
        at_risk.area_mm2 += area_mm2;
        for (of_reason_mm2, reason) in at_risk.by_reason_mm2.iter_mut().zip(RiskReason::ALL) {
            *of_reason_mm2 += if risks.has(sample, reason) { area_mm2 } else { 0.0 };
        }
    }
    at_risk
}
