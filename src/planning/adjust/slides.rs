//! Slides of chosen views: each moves along its axis to where what it contributes scores highest, as its candidate did for its
//! whole block. What it contributes are the samples that no other chosen view measures as well. A view is slid only where all
//! views together lose nothing by it ([`super::guard`]) and the cell can take it there. The slid view joins the candidates.
//!
//! Where setups would no longer share the surface that registers them, no view is slid. Plans that ask for overlap, or for views
//! that tolerate stated errors, keep their views; poses that the job gives are kept.
//!
//! Cost: at most two views evaluated anew, since half the move is tried where the whole one fails, and 1 + [`STEPS`] + 2 ·
//! [`HALVINGS`] projections of at most [`MAX_SAMPLES`] samples, for each chosen view.

use std::collections::BTreeSet;

use super::guard::{Guard, graded};
use super::joins;
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::candidates::Candidate;
use crate::planning::candidates::slide::{better, moved, refined};
use crate::planning::context::{Cancelled, Context, PlanError};
use crate::planning::ids::{CandidateId, CandidateIndex, RowIndex, SampleId, ViewId};
use crate::planning::params::{CandidateParams, Hemisphere, Standoff};
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::setups::{self, Setup};
use crate::planning::stations::Station;
use crate::planning::surface::AskedPoint;
use crate::planning::visibility::{self, Optics, Row, UnitedViews};

/// Samples that stand for what a view contributes.
const MAX_SAMPLES: usize = 400;
/// Largest move that is compared first, mm. Steps halved around it add up to 4.4 mm.
const MAX_MOVE_MM: f64 = 60.0;
/// Distances that are compared first, evenly to both sides.
const STEPS: i32 = 24;
/// Times that the step is halved around the best.
const HALVINGS: i32 = 3;
/// Smallest move that is tried, mm.
const MIN_MOVE_MM: f64 = 1.0;

/// The chosen views, slid, and the problem with the slid views among its candidates.
///
/// # Errors
/// [`PlanError::Cancelled`].
pub(in crate::planning) fn slide_views(
    problem: &mut ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    chosen: ChosenViews,
    excluded: &BTreeSet<CandidateIndex>,
    ctx: &Context<'_>,
) -> Result<ChosenViews, PlanError> {
    let slid_views = slid(problem, setups, &chosen.candidates, ctx)?;
    if slid_views == chosen.candidates {
        return Ok(chosen);
    }
    let usable = problem.choosable(excluded);
    let place = |candidate| usable.binary_search(candidate).ok().map(RowIndex::at);
    let rows: Vec<RowIndex> = slid_views.iter().filter_map(place).collect();
    problem.chosen_of(&problem.cover_problem(&usable), &usable, &rows, &chosen, &ctx.silent())
}

/// Slides views one after another; those that slid are new candidates.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn slid(
    problem: &mut ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    views: &[CandidateIndex],
    ctx: &Context<'_>,
) -> Result<Vec<CandidateIndex>, Cancelled> {
    let mut slid_views = views.to_vec();
    if problem.params.candidates.standoff != Standoff::Surface || super::keeps_views(problem) {
        return Ok(slid_views);
    }
    let (ctx, known) = (ctx.silent(), problem.known());
    for (view, slid) in slides(problem, setups, views, &ctx)? {
        slid_views[view.index()] = slid.join(problem);
    }
    if joins::must_join(problem) && !joins::are_joined(problem, &slid_views) {
        problem.forget_from(known);
        return Ok(views.to_vec());
    }
    Ok(slid_views)
}

/// Views that slide, each where those before it have slid.
fn slides(
    problem: &ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    views: &[CandidateIndex],
    ctx: &Context<'_>,
) -> Result<Vec<(ViewId, Slid)>, Cancelled> {
    let optics = Optics::new(problem.input.scanner, problem.params, &problem.surface.requirements);
    let occluders = setups.iter().map(|setup| &setup.occluders);
    let evaluators: Vec<UnitedViews<'_>> =
        occluders.map(|occluders| UnitedViews::new(&problem.surface, &optics, occluders, problem.params, ctx)).collect();
    let mut guard = Guard::new(problem, ViewId::number(views.iter().copied()));
    let mut slides = Vec::new();
    for (view, candidate) in ViewId::number(views.iter().copied()) {
        ctx.check()?;
        let setup = problem.candidates[candidate].setup.index();
        let (setup, evaluator) = (&setups[setup], &evaluators[setup]);
        let slide = SlidingView { problem, setup, optics: &optics, evaluator, guard: &guard, view, candidate };
        let before = graded(problem, candidate);
        if let Some(slid) = slide.better(&before, ctx)? {
            guard.exchange(view, &before, &slid.row);
            slides.push((view, slid));
        }
    }
    Ok(slides)
}

/// A chosen view that may slide.
struct SlidingView<'a, 'b> {
    problem: &'a ViewPlanningProblem<'b>,
    setup: &'a Setup<'b>,
    optics: &'a Optics,
    evaluator: &'a UnitedViews<'a>,
    guard: &'a Guard,
    view: ViewId,
    candidate: CandidateIndex,
}

/// A slid view, with everything that is known of it.
struct Slid {
    candidate: Candidate,
    stations: Option<Vec<Station>>,
    row: Row,
}

impl SlidingView<'_, '_> {
    fn of(&self) -> &Candidate {
        &self.problem.candidates[self.candidate]
    }

    /// The view slid to where it scores higher, or half as far, where nothing is lost by it and the cell can take it.
    fn better(&self, before: &Row, ctx: &Context<'_>) -> Result<Option<Slid>, Cancelled> {
        let contributed = self.contributed(before);
        let forward_mm = if self.of().is_given { 0.0 } else { self.best_move_mm(&contributed) };
        for forward_mm in [forward_mm, 0.5 * forward_mm] {
            if forward_mm.abs() < MIN_MOVE_MM {
                break;
            }
            let pose = moved(&self.of().part_from_scanner, forward_mm);
            if let Some(slid) = self.slid(pose, ctx)? {
                let change = self.guard.change(self.problem, self.view, before, &slid.row);
                if change.score_mm2 > 0.0 && change.loses_nothing() {
                    return Ok(Some(slid));
                }
            }
        }
        Ok(None)
    }

    /// Samples of the view that no other measures as well, with the value of each by the others.
    fn contributed(&self, row: &Row) -> Vec<(SampleId, f64)> {
        let value = |quality: f32| self.problem.params.score.value(f64::from(quality));
        let of_others = |sample: SampleId| self.guard.best_of_others(self.view, sample);
        let own = row.graded().filter(|(sample, quality)| of_others(*sample).is_none_or(|others| others < *quality));
        let own: Vec<_> = own.map(|(sample, _)| (sample, of_others(sample).map_or(0.0, value))).collect();
        let count = own.len().min(MAX_SAMPLES);
        (0..count).map(|i| own[i * own.len() / count]).collect()
    }

    /// The move forward by which the contributed samples score highest, mm. What hides them is taken not to change.
    fn best_move_mm(&self, contributed: &[(SampleId, f64)]) -> f64 {
        let surface = &self.problem.surface;
        let score = |forward_mm: f64| {
            let view = self.optics.at(&moved(&self.of().part_from_scanner, forward_mm));
            let value = |sample: SampleId| {
                let AskedPoint { mm, normal, kind } = surface.asked_point(sample);
                let quality = view.before_shadow(&mm, &normal, kind).ok()?;
                Some(self.problem.params.score.value(f64::from(quality)))
            };
            let of_sample = |(sample, by_others): &(SampleId, f64)| {
                let weight = surface.requirements.of(*sample).weight;
                weight
                    * self.problem.asked_area_mm2[sample.index()]
                    * value(*sample).map_or(*by_others, |own| own.max(*by_others))
            };
            (contributed.iter().map(of_sample).sum::<f64>(), forward_mm)
        };
        let step_mm = 2.0 * MAX_MOVE_MM / f64::from(STEPS);
        let sides = (1..=STEPS / 2).flat_map(|step| [step_mm, -step_mm].map(|mm| mm * f64::from(step)));
        refined(sides.map(score).fold(score(0.0), better), step_mm, HALVINGS, score).1
    }

    /// The view at `pose`; `None` where it may not stand there, or the cell cannot take it.
    fn slid(&self, pose: Pose<Part, ScannerFrame>, ctx: &Context<'_>) -> Result<Option<Slid>, Cancelled> {
        let (problem, setup, input) = (self.problem, self.setup, self.problem.input);
        let CandidateParams { hemisphere, min_elevation_deg, .. } = problem.params.candidates;
        let above_only = hemisphere == Some(Hemisphere::AboveTable);
        if above_only && !setups::is_above(&pose, &setup.table_from_part, input.scanner, min_elevation_deg) {
            return Ok(None);
        }
        let reach = setup.scene.as_ref().map(|scene| scene.reach(&[pose], ctx)).transpose()?;
        let mut stations = match reach.and_then(|mut reach| reach.pop()).transpose() {
            Ok(stations) => stations,
            Err(_) => return Ok(None),
        };
        let measured = self.evaluator.shared_row(&pose, &self.evaluator.nothing())?;
        let mut row = visibility::grade(&problem.surface, &pose, input.scanner, problem.params, &measured);
        if let (Some(scene), Some(stations)) = (&setup.scene, &mut stations) {
            scene.keep_in_sight(&problem.surface, &pose, stations, &mut row, ctx)?;
        }
        // Its number is given once it joins the candidates.
        let candidate = Candidate { part_from_scanner: pose, slid_from: Some(self.candidate), ..self.of().clone() };
        Ok(Some(Slid { candidate, stations, row }))
    }
}

impl Slid {
    /// Adds the view to the candidates; returns its place among them.
    fn join(self, problem: &mut ViewPlanningProblem<'_>) -> CandidateIndex {
        let id = CandidateId::at(problem.candidates.generated);
        problem.candidates.generated += 1;
        problem.candidates.remaining.push(Candidate { id, ..self.candidate });
        problem.matrix.rows.push(self.row);
        if let (Some(reach), Some(stations)) = (&mut problem.reach, self.stations) {
            reach.push(Ok(stations));
        }
        CandidateIndex::at(problem.candidates.remaining.len() - 1)
    }
}
