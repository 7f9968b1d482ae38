//! Measured area that a real scan may lack, apart from the rest ([`crate::planning::method::realism`]).

use std::borrow::Cow;

use super::Solution;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SampleId};
use crate::planning::plan::{AtRisk, RiskReason};
use crate::planning::realism::{self, RiskInput, RiskView, Risks};
use crate::planning::setups::Setup;
use crate::planning::setups::registration::union_of;
use crate::planning::surface::{Surface, systematic};
use crate::planning::visibility::{Row, SampleSet};

/// Measured samples that are judged at most where only their area is told: a share of 1 % is then known to 0.06 points.
const MAX_JUDGED: usize = 30_000;

/// Risks of measured samples: of all, or of some that stand for them.
pub(super) struct JudgedSamples {
    risks: Risks,
    /// The samples that were judged, each with the area that it stands for; `None` where all were.
    some: Option<Vec<(SampleId, f64)>>,
}

/// Judges what the views of a solution measure, each among all that it may see in its setup: some of it where it counts anyway.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn risks(solution: &Solution<'_>, setups: &[Setup<'_>], ctx: &Context<'_>) -> Result<JudgedSamples, Cancelled> {
    let Solution { problem, measuring, .. } = solution;
    let some = problem.params.realism.count_at_risk.then(|| {
        let mut measured_mm2 = problem.asked_area_mm2.clone();
        let measured = union_of(measuring, measured_mm2.len());
        let not_measured = SampleId::number(&mut measured_mm2).filter(|(sample, _)| !measured.holds(*sample));
        not_measured.for_each(|(_, area_mm2)| *area_mm2 = 0.0);
        systematic(&measured_mm2, MAX_JUDGED)
    });
    let (surface, rows): (Cow<'_, Surface>, Cow<'_, [Row]>) = match &some {
        Some(some) => {
            let row = |row: &Row| {
                let mut within = SampleSet::none_of(some.len());
                SampleId::number(some).filter(|(_, (of, _))| row.holds(*of)).for_each(|(place, _)| within.insert(place));
                Row::new(within.into_words())
            };
            (Cow::Owned(problem.surface.of_samples(some)), Cow::Owned(measuring.iter().map(row).collect::<Vec<_>>()))
        }
        None => (Cow::Borrowed(&*problem.surface), Cow::Borrowed(&measuring[..])),
    };
    Ok(JudgedSamples { risks: judge(solution, setups, (&surface, &rows), ctx)?, some })
}

fn judge(
    solution: &Solution<'_>,
    setups: &[Setup<'_>],
    (surface, rows): (&Surface, &[Row]),
    ctx: &Context<'_>,
) -> Result<Risks, Cancelled> {
    let Solution { problem, chosen, .. } = solution;
    let input = RiskInput { mesh: problem.input.mesh, surface, scanner: problem.input.scanner, params: problem.params };
    let view = |(candidate, row): (&CandidateIndex, _)| {
        let candidate = &problem.candidates[*candidate];
        let surfaces = setups[candidate.setup.index()].occluders.rays();
        RiskView { part_from_scanner: candidate.part_from_scanner, row, surfaces }
    };
    let views: Vec<RiskView<'_>> = chosen.candidates.iter().zip(rows).map(view).collect();
    realism::risks(&input, &views, ctx)
}

/// Samples that are not counted as measured.
pub(super) fn left_out(solution: &Solution<'_>, judged: &JudgedSamples) -> SampleSet {
    match solution.problem.params.realism.count_at_risk {
        true => SampleSet::none_of(solution.problem.surface.sample_mm.len()),
        false => judged.risks.samples(),
    }
}

/// Asked area at risk, in all and by reason.
pub(super) fn area(solution: &Solution<'_>, judged: &JudgedSamples) -> AtRisk {
    let problem = solution.problem;
    let mut at_risk = AtRisk { is_counted: problem.params.realism.count_at_risk, ..AtRisk::default() };
    for sample in judged.risks.samples().iter() {
        let area_mm2 = match &judged.some {
            Some(some) => some[sample.index()].1,
            None => problem.asked_area_mm2[sample.index()],
        };
        at_risk.area_mm2 += area_mm2;
        for (of_reason_mm2, reason) in at_risk.by_reason_mm2.iter_mut().zip(RiskReason::ALL) {
            *of_reason_mm2 += if judged.risks.has(sample, reason) { area_mm2 } else { 0.0 };
        }
    }
    at_risk
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::geometry::demo_parts;
    use crate::planning::context::Silent;
    use crate::planning::params::{CandidateParams, PlanParams};
    use crate::planning::plan::Plan;
    use crate::planning::{PlanInput, plan};
    use crate::testing::nominal_scanner;

    #[test]
    #[ignore = "long: tests/all runs it"]
    fn some_samples_tell_the_area_at_risk_that_all_do() {
        let mesh = demo_parts::base(8_000).unwrap_or_else(|error| panic!("{error}"));
        let (scanner, cancel) = (nominal_scanner(), AtomicBool::new(false));
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let planned = |count_at_risk: bool| -> Plan {
            let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
            (params.candidates.step_small_deg, params.candidates.step_large_deg) = (60.0, 60.0);
            params.part.samples_per_mm2 = Some(200_000.0 / mesh.area_mm2());
            (params.selection.max_views, params.realism.count_at_risk) = (Some(4), count_at_risk);
            (params.missed.remedies, params.missed.advice, params.robust.pose_error) = (0, false, None);
            plan(&input, &params, &Context::new(&cancel, &Silent)).unwrap_or_else(|error| panic!("{error}")).plan
        };
        let [some, all] = [true, false].map(planned);
        let pose = |plan: &Plan| plan.views.iter().map(|view| view.part_from_scanner).collect::<Vec<_>>();
        assert_eq!(pose(&some), pose(&all), "what counts does not change the choice");
        let measured_mm2 = some.coverage.measured.area_mm2;
        assert!(measured_mm2 > 0.6 * mesh.area_mm2(), "more samples than are judged");
        let figures = |at_risk: &AtRisk| [&[at_risk.area_mm2][..], &at_risk.by_reason_mm2].concat();
        let (some, all) = (figures(&some.coverage.at_risk), figures(&all.coverage.at_risk));
        assert!(all[0] > 0.01 * measured_mm2, "{all:?}");
        // Three standard errors of the largest, evenly spread as they are.
        for (of_some, of_all) in some.iter().zip(&all) {
            let share = of_all / measured_mm2;
            let error = (of_some - of_all).abs() / measured_mm2;
            assert!(error <= 3.0 * (share.max(1e-4) / MAX_JUDGED as f64).sqrt(), "{some:?}\n{all:?}");
        }
    }
}
