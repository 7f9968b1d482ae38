//! Brightness of each chosen view, and the area that views see and that is expected to be too dark or saturated
//! ([`crate::cell::Exposure`]). What an obstacle of the cell hides where a view is taken is not seen.
//!
//! Every view is evaluated once more, as if any brightness did: about the time that casting the chosen views takes.

use super::{Solution, station_of};
use crate::cell::{ExposureFault, LevelRange, best_levels};
use crate::geometry::parallel;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SampleId, ViewId};
use crate::planning::params::Brightness;
use crate::planning::plan::{ExposureLoss, ViewExposure};
use crate::planning::sequence::Ordered;
use crate::planning::setups::Setup;
use crate::planning::visibility::{Optics, UnitedViews};

/// Share of the area that a view sees which a second capture has to add. It has no published source.
const MIN_GAIN_OF_SECOND_CAPTURE: f64 = 0.01;

/// A sample that a view sees.
struct LitSample {
    sample: SampleId,
    range: LevelRange,
    area_mm2: f64,
}

/// Brightness of the views of a solution.
pub(super) struct Exposures {
    /// Brightness of each view; `None` where it has no path.
    pub(super) views: Vec<Option<ViewExposure>>,
    pub(super) loss: ExposureLoss,
}

/// Chooses the brightness of each view, taken where `ordered` has it; `None` where nothing is known of the materials.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn of(
    solution: &Solution<'_>,
    setups: &[Setup<'_>],
    ordered: &[Ordered],
    ctx: &Context<'_>,
) -> Result<Option<Exposures>, Cancelled> {
    let Solution { problem, chosen, no_path, .. } = solution;
    if problem.params.material_of_part().is_none() {
        return Ok(None);
    }
    let seen = |&(view, candidate): &(ViewId, &CandidateIndex)| match no_path.contains(candidate) {
        true => Ok(None),
        false => {
            let table_rad = station_of(ordered, view).map(|station| station.table_angle_rad);
            lit(solution, setups, (view, *candidate), table_rad, ctx).map(Some)
        }
    };
    let views: Vec<_> = ViewId::number(&chosen.candidates).collect();
    let seen = parallel::try_map::<_, _, Cancelled>(&views, seen)?;
    let views: Vec<_> = seen.iter().map(|seen| seen.as_ref().map(|seen| exposure(solution, seen))).collect();
    let loss = loss(solution, &seen, &views);
    Ok(Some(Exposures { views, loss }))
}

/// Samples that a view sees while the table stands at an angle, each with the levels at which it can be measured.
fn lit(
    solution: &Solution<'_>,
    setups: &[Setup<'_>],
    (view, candidate): (ViewId, CandidateIndex),
    table_rad: Option<f64>,
    ctx: &Context<'_>,
) -> Result<Vec<LitSample>, Cancelled> {
    let Solution { problem, measuring, .. } = solution;
    let measured = measuring[view.index()].measured();
    let (surface, params) = (&*problem.surface, problem.params);
    let candidate = &problem.candidates[candidate];
    let optics = Optics::new(problem.input.scanner, params, &surface.requirements).at_any_brightness();
    let setup = &setups[candidate.setup.index()];
    let united = UnitedViews::new(surface, &optics, &setup.occluders, params, ctx);
    let mut row = united.row(&candidate.part_from_scanner, &united.nothing())?;
    if let (Some(scene), Some(table_rad)) = (&setup.scene, table_rad) {
        // A view measures nothing that is hidden where it is taken: only what else it sees has to be tested.
        let beside = row.without(measured);
        if let Some(hidden) = scene.sight().hidden(surface, &candidate.part_from_scanner, beside.measured(), table_rad, ctx)? {
            row = row.without(&hidden);
        }
    }
    let at = optics.at(&candidate.part_from_scanner);
    let allowed = params.scan.brightness.levels();
    let lit = |sample: SampleId| {
        let area_mm2 = problem.asked_area_mm2[sample.index()];
        let material = surface.requirements.of(sample).material.filter(|_| area_mm2 > 0.0)?;
        let range = at.levels_at(&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal, &material);
        // Something else than the light keeps the view from a sample that a level would do for.
        let is_seen = measured.holds(sample) || !range.is_lit_at_any(allowed.clone());
        is_seen.then_some(LitSample { sample, range, area_mm2 })
    };
    Ok(row.samples().filter_map(lit).collect())
}

fn exposure(solution: &Solution<'_>, seen: &[LitSample]) -> ViewExposure {
    let levels = match solution.problem.params.scan.brightness {
        Brightness::Level(level) => vec![level],
        Brightness::Auto => {
            let points: Vec<_> = seen.iter().map(|lit| (lit.range, lit.area_mm2)).collect();
            best_levels(&points, MIN_GAIN_OF_SECOND_CAPTURE)
        }
    };
    let mut exposure = ViewExposure { levels, ..ViewExposure::default() };
    for lit in seen {
        exposure.seen_area_mm2 += lit.area_mm2;
        match lit.range.fault_at_all(&exposure.levels) {
            Some(ExposureFault::Dark) => exposure.dark_area_mm2 += lit.area_mm2,
            Some(ExposureFault::Saturated) => exposure.saturated_area_mm2 += lit.area_mm2,
            None => {}
        }
    }
    exposure
}

/// Area that no view captures at its levels, sample by sample.
fn loss(solution: &Solution<'_>, seen: &[Option<Vec<LitSample>>], views: &[Option<ViewExposure>]) -> ExposureLoss {
    let problem = solution.problem;
    /// Fate of a sample: not seen, lost, captured.
    #[derive(Clone, Copy, PartialEq)]
    enum Fate {
        NotSeen,
        Lost(ExposureFault),
        Captured,
    }
    let mut fates = vec![Fate::NotSeen; problem.asked_area_mm2.len()];
    let both = seen.iter().zip(views).filter_map(|(seen, view)| seen.as_ref().zip(view.as_ref()));
    for (lit, view) in both.flat_map(|(seen, view)| seen.iter().map(move |lit| (lit, view))) {
        let fate = &mut fates[lit.sample.index()];
        *fate = match (*fate, lit.range.fault_at_all(&view.levels)) {
            (Fate::Captured, _) | (_, None) => Fate::Captured,
            (Fate::NotSeen, Some(fault)) => Fate::Lost(fault),
            (Fate::Lost(known), Some(fault)) => Fate::Lost(known.max(fault)),
        };
    }
    let lost_mm2 = |is_lost: &dyn Fn(SampleId, Fate) -> bool| -> f64 {
        let lost = SampleId::number(&fates).filter(|(sample, fate)| is_lost(*sample, **fate));
        lost.map(|(sample, _)| problem.asked_area_mm2[sample.index()]).sum()
    };
    let is_measured = |sample| solution.measuring.iter().any(|row| row.holds(sample));
    ExposureLoss {
        dark_area_mm2: lost_mm2(&|_, fate| fate == Fate::Lost(ExposureFault::Dark)),
        saturated_area_mm2: lost_mm2(&|_, fate| fate == Fate::Lost(ExposureFault::Saturated)),
        of_measured_area_mm2: lost_mm2(&|sample, fate| matches!(fate, Fate::Lost(_)) && is_measured(sample)),
        is_assumed: problem.input.scanner.exposure.is_assumed,
    }
}
