//! Coverage with its denominators ([`crate::planning::method::coverage`]), of the part and of each region.

use crate::planning::ids::SampleId;
use crate::planning::params::NoiseParams;
use crate::planning::plan::tally::measured_area;
use crate::planning::plan::{Cause, Coverage, MeasuredArea, RegionCoverage, Verdict};
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::selection::{coverable, coverable_mm2};
use crate::planning::surface::requirements::{self, NamedRegion};
use crate::planning::visibility::Row;

/// Area that the chosen views measure, given the samples of each.
pub(super) fn measured(problem: &ViewPlanningProblem<'_>, chosen: &ChosenViews, measuring: &[Row]) -> MeasuredArea {
    let viewpoints = chosen.candidates.iter().map(|candidate| problem.candidates[*candidate].part_from_scanner.origin_mm());
    measured_area(&problem.surface, &problem.asked_area_mm2, viewpoints.zip(measuring))
}

/// Coverage, given the area that the chosen views measure and the samples of each.
pub(super) fn of(problem: &ViewPlanningProblem<'_>, measured: MeasuredArea, measuring: &[Row], verdicts: &[Verdict]) -> Coverage {
    let ViewPlanningProblem { surface, asked_area_mm2, .. } = problem;
    let mut coverage = Coverage {
        measured,
        total_area_mm2: surface.area_where(|_| true),
        asked_area_mm2: asked_area_mm2.iter().sum(),
        coverable_area_mm2: coverable_mm2(&problem.rows(&problem.usable()), asked_area_mm2),
        optically_coverable_area_mm2: optically_coverable_mm2(problem),
        ..Coverage::default()
    };
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

/// Marks the coverage as that of what earlier scans left open. The target of a region is one for all of its surface, of which earlier
/// scans measured a part that is not known here: it tells nothing of the share of the open surface, so there is none.
pub(super) fn ask_for_open_alone(coverage: &mut Coverage) {
    coverage.is_of_open = true;
    coverage.regions.iter_mut().for_each(|region| region.target = None);
}

/// Counts the causes of what each region misses anew, of verdicts that tell other causes.
pub(super) fn recount_causes(coverage: &mut Coverage, problem: &ViewPlanningProblem<'_>, verdicts: &[Verdict]) {
    for (region, counted) in coverage.regions.iter_mut().zip(of_regions(problem, verdicts)) {
        region.missed_mm2 = counted.missed_mm2;
    }
}

/// Asked area that at least one candidate measures, whatever the cell can take and hides.
fn optically_coverable_mm2(problem: &ViewPlanningProblem<'_>) -> f64 {
    let all: Vec<_> = problem.candidates.indices().collect();
    let mut coverable = coverable(&problem.rows(&all), problem.asked_area_mm2.len());
    coverable.insert_all(&problem.hidden_by_cell);
    coverable.iter().map(|sample| problem.asked_area_mm2[sample.index()]).sum()
}

/// Coverage of each region of interest and feature.
fn of_regions(problem: &ViewPlanningProblem<'_>, verdicts: &[Verdict]) -> Vec<RegionCoverage> {
    let noise = &problem.params.regions.noise;
    let named = requirements::regions(problem.params).into_iter();
    let mut regions: Vec<_> = named.map(|region| nothing_of(region, noise)).collect();
    if regions.is_empty() {
        return regions;
    }
    let coverable = coverable(&problem.rows(&problem.usable()), problem.asked_area_mm2.len());
    for (sample, verdict) in SampleId::number(verdicts) {
        let requirement = problem.surface.requirements.of(sample);
        let judged = JudgedSample {
            area_mm2: problem.asked_area_mm2[sample.index()],
            verdict: *verdict,
            is_coverable: coverable.holds(sample),
            is_beyond_noise: requirement.noise_max_mm.is_some_and(|max_mm| noise.exceeds(max_mm)),
        };
        requirement.regions.iter().for_each(|region| add(&mut regions[*region], &judged));
    }
    for region in &mut regions {
        region.missed_mm2.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    }
    regions
}

/// A sample with its verdict, as it counts in a region.
struct JudgedSample {
    /// 0 where it is not asked for.
    area_mm2: f64,
    verdict: Verdict,
    is_coverable: bool,
    /// True where a finer tolerance is asked for than the noise can serve.
    is_beyond_noise: bool,
}

/// A region of which nothing is counted yet.
fn nothing_of(region: NamedRegion, noise: &NoiseParams) -> RegionCoverage {
    RegionCoverage {
        name: region.name,
        kind: region.kind,
        samples: 0,
        asked_area_mm2: 0.0,
        coverable_area_mm2: 0.0,
        measured_area_mm2: 0.0,
        target: region.target,
        tolerance_mm: region.tolerance_mm,
        min_tolerance_mm: noise.min_tolerance_mm(),
        missed_mm2: Vec::new(),
        beyond_noise_area_mm2: 0.0,
        independent: None,
    }
}

fn add(region: &mut RegionCoverage, sample: &JudgedSample) {
    let area_mm2 = sample.area_mm2;
    match sample.verdict {
        Verdict::NotAsked => return,
        Verdict::Measured(_) => region.measured_area_mm2 += area_mm2,
        Verdict::Missed(cause) => {
            match region.missed_mm2.iter_mut().find(|(known, _)| *known == cause) {
                Some((_, missed_mm2)) => *missed_mm2 += area_mm2,
                None => region.missed_mm2.push((cause, area_mm2)),
            }
            let is_noise = sample.is_beyond_noise && cause == Cause::BelowGrade;
            region.beyond_noise_area_mm2 += if is_noise { area_mm2 } else { 0.0 };
        }
    }
    region.samples += 1;
    region.asked_area_mm2 += area_mm2;
    region.coverable_area_mm2 += if sample.is_coverable { area_mm2 } else { 0.0 };
}
