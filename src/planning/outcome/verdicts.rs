//! Verdict of every sample: its best grade, or the first failing cause of the candidate that gets furthest
//! ([`crate::planning::method::causes`]).

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use crate::geometry::RayScene;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateIndex, SampleId};
use crate::planning::params::Hemisphere;
use crate::planning::plan::{Cause, Grade, Verdict};
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::registration::union_of;
use crate::planning::sky::{Sky, SkyProbe, stands_on};
use crate::planning::stations::StationFailure;
use crate::planning::visibility::{self, Occluders, Row, SampleSet};

/// Measured samples that count.
pub(super) struct Counted<'a> {
    /// Samples that each chosen view measures and that count, with its quality.
    pub(super) measuring: &'a [Row],
    /// Samples that some view measures and that do not count, since they are at risk.
    pub(super) left_out: &'a SampleSet,
}

/// Verdicts, given what each chosen view measures and the candidates that were given up for want of a path. `part` is
/// the part alone.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn of(
    problem: &ViewPlanningProblem<'_>,
    counted: &Counted<'_>,
    all_excluded: &BTreeSet<CandidateIndex>,
    (occluders, part): (&Occluders, &RayScene),
    ctx: &Context<'_>,
) -> Result<Vec<Verdict>, Cancelled> {
    let samples = problem.surface.sample_mm.len();
    let mut best_quality = vec![f32::NEG_INFINITY; samples];
    for row in counted.measuring {
        for (sample, quality) in row.graded() {
            let best = &mut best_quality[sample.index()];
            *best = best.max(quality);
        }
    }
    let motion_cause = motion_causes(problem, all_excluded);
    let rests_on =
        |sample: SampleId| problem.reach.is_some() && problem.setups.iter().all(|pose| stands_on(&problem.surface, sample, pose));
    let sky = sky_probe(problem, part, ctx);
    let only_bodies_hinder = measured_by_dropped(problem, occluders, ctx)?;
    let cause = |sample: SampleId| match motion_cause[sample.index()] {
        _ if counted.left_out.holds(sample) => Cause::AtRisk,
        _ if rests_on(sample) => Cause::ExcludedResting,
        Some(cause) => cause,
        None if only_bodies_hinder.holds(sample) => Cause::Collision,
        None => {
            let (surface, place) = (&problem.surface, sample.index());
            match sky.sky(&surface.sample_mm[place], &surface.patch_of(sample).normal) {
                Sky::Closed => Cause::Enclosed,
                Sky::BelowPlate => Cause::FacesTable,
                Sky::Open => problem.matrix.furthest_cause[place],
            }
        }
    };
    let verdict = |place: usize| {
        let sample = SampleId::at(place);
        Ok(match best_quality[place] {
            _ if !problem.surface.asked[place] => Verdict::NotAsked,
            quality if quality > f32::NEG_INFINITY => Verdict::Measured(Grade::of(f64::from(quality))),
            _ => {
                ctx.check()?;
                Verdict::Missed(cause(sample))
            }
        })
    };
    (0..samples).into_par_iter().map(verdict).collect()
}

/// Samples that views would measure that were dropped since the scanner's body meets something: collision alone is what keeps
/// them from that.
fn measured_by_dropped(
    problem: &ViewPlanningProblem<'_>,
    occluders: &Occluders,
    ctx: &Context<'_>,
) -> Result<SampleSet, Cancelled> {
    let poses: Vec<_> = problem.dropped_for_body().map(|candidate| candidate.part_from_scanner).collect();
    let (usable, input) = (vec![true; poses.len()], problem.input);
    let cast = visibility::cast(&problem.surface, &poses, &usable, input.scanner, occluders, problem.params, &ctx.silent())?;
    Ok(union_of(&cast.rows, problem.surface.sample_mm.len()))
}

/// The sky over the part: with viewpoints above the plate alone, in the setups that are planned in.
fn sky_probe<'a>(problem: &'a ViewPlanningProblem<'_>, part: &'a RayScene, ctx: &Context<'_>) -> SkyProbe<'a> {
    let (input, params) = (problem.input, problem.params);
    let above_only = params.candidates.hemisphere == Some(Hemisphere::AboveTable);
    let setups = if above_only { &problem.setups[..] } else { &[] };
    let limit_rad = |device| params.limits.incidence_max_rad(device);
    let incidence_max_rad = input.scanner.devices.iter().map(limit_rad).fold(f64::INFINITY, f64::min);
    let plates = (setups, params.candidates.min_elevation_deg);
    SkyProbe::new(input.mesh, part, plates, input.scanner.best_mm, incidence_max_rad, ctx.simd_level())
}

/// Cause by motion of each sample that some candidate measures: how far the best such candidate got with the cell.
fn motion_causes(problem: &ViewPlanningProblem<'_>, all_excluded: &BTreeSet<CandidateIndex>) -> Vec<Option<Cause>> {
    let samples = problem.surface.sample_mm.len();
    let mut samples_of = BTreeMap::from([(Cause::HiddenByCell, problem.hidden_by_cell.clone())]);
    for candidate in problem.candidates.indices() {
        let cause = match problem.blocked(candidate) {
            Some(StationFailure::Unreachable) => Cause::Unreachable,
            Some(StationFailure::Collision) => Cause::Collision,
            None if all_excluded.contains(&candidate) => Cause::NoPath,
            None => Cause::NotChosen,
        };
        samples_of.entry(cause).or_insert_with(|| SampleSet::none_of(samples)).insert_all(problem.row(candidate).measured());
    }
    let mut causes = vec![None; samples];
    for (cause, samples) in samples_of {
        samples.iter().for_each(|sample| causes[sample.index()] = Some(cause));
    }
    causes
}
