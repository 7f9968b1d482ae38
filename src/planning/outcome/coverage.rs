//! Coverage with its denominators ([`crate::planning::method::coverage`]), of the part and of each region.

use crate::planning::ids::SampleId;
use crate::planning::plan::{Cause, Coverage, RegionCoverage, Verdict};
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::selection::{coverable, coverable_mm2};
use crate::planning::surface::requirements;
use crate::planning::tally::measured_area;
use crate::planning::visibility::Row;

/// Coverage, given what each chosen view measures.
pub(super) fn of(problem: &ViewPlanningProblem<'_>, chosen: &ChosenViews, measuring: &[Row], verdicts: &[Verdict]) -> Coverage {
    let ViewPlanningProblem { surface, asked_area_mm2, .. } = problem;
    let all: Vec<_> = problem.candidates.indices().collect();
    let mut coverage = Coverage {
        total_area_mm2: surface.area_where(|_| true),
        asked_area_mm2: surface.area_where(|sample| surface.asked[sample.index()]),
        coverable_area_mm2: coverable_mm2(&problem.rows(&problem.usable()), asked_area_mm2),
        optically_coverable_area_mm2: coverable_mm2(&problem.rows(&all), asked_area_mm2),
        ..Coverage::default()
    };
    let viewpoints = chosen.candidates.iter().map(|candidate| problem.candidates[*candidate].part_from_scanner.origin_mm());
    coverage.measured = measured_area(surface, asked_area_mm2, viewpoints.zip(measuring));
    let is_visible = |verdict: &Verdict| !matches!(verdict, Verdict::Missed(Cause::ExcludedResting | Cause::Enclosed));
    let visible = verdicts.iter().zip(asked_area_mm2).filter(|(verdict, _)| is_visible(verdict));
    coverage.visible_area_mm2 = visible.map(|(_, area_mm2)| area_mm2).sum();
    coverage.regions = of_regions(problem, verdicts);
    let mut open_mm2 = asked_area_mm2.clone();
    let mut covered_mm2 = 0.0;
    for row in measuring {
        covered_mm2 += row.samples().map(|sample| std::mem::take(&mut open_mm2[sample.index()])).sum::<f64>();
        coverage.curve_area_mm2.push(covered_mm2);
    }
    coverage
}

fn of_regions(problem: &ViewPlanningProblem<'_>, verdicts: &[Verdict]) -> Vec<RegionCoverage> {
    let named = requirements::regions(problem.params).into_iter();
    let mut regions: Vec<_> =
        named.map(|region| RegionCoverage { name: region.name, target: region.target, ..RegionCoverage::default() }).collect();
    if regions.is_empty() {
        return regions;
    }
    let coverable = coverable(&problem.rows(&problem.usable()), problem.asked_area_mm2.len());
    for (sample, verdict) in SampleId::number(verdicts) {
        for &region in &problem.surface.requirements.of(sample).regions {
            let (region, area_mm2) = (&mut regions[region], problem.asked_area_mm2[sample.index()]);
            region.asked_area_mm2 += area_mm2;
            region.coverable_area_mm2 += if coverable.holds(sample) { area_mm2 } else { 0.0 };
            region.measured_area_mm2 += if matches!(verdict, Verdict::Measured(_)) { area_mm2 } else { 0.0 };
        }
    }
    regions
}
