//! Rolls of chosen views: a view may be taken turned about its optical axis where the moves are shorter then and, measured
//! anew, the views together lose nothing ([`super::guard`]). At most three poses are evaluated for each view. Plans that ask for
//! overlap, for setups that share surface, or for views that tolerate stated errors, keep their rolls.

use super::guard::{Guard, graded};
use super::joins;
use crate::geometry::{Part, Pose, ScannerFrame, plate_from_placed};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::Roll;
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::scene::PlanningScene;
use crate::planning::sequence::Ordered;
use crate::planning::setups::Setup;
use crate::planning::visibility::{self, Row};

/// The order with views rolled, and the problem with their poses and what they measure then.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn roll_views(
    problem: &mut ViewPlanningProblem<'_>,
    setups: &[Setup<'_>],
    chosen: &ChosenViews,
    ordered: Vec<Ordered>,
    ctx: &Context<'_>,
) -> Result<Vec<Ordered>, Cancelled> {
    if problem.params.motion.roll == Roll::Fixed || super::keeps_views(problem) || joins::must_join(problem) {
        return Ok(ordered);
    }
    let no_path: Vec<_> = ordered.iter().flat_map(|ordered| &ordered.no_path).copied().collect();
    let mut guard = Guard::new(problem, chosen.views().filter(|(view, _)| !no_path.contains(view)));
    let scenes = setups.iter().filter_map(|setup| Some((setup, setup.scene.as_ref()?)));
    ordered
        .into_iter()
        .zip(scenes)
        .map(|(ordered, (setup, scene))| rolled(problem, &mut guard, (setup, scene), chosen, ordered, ctx))
        .collect()
}

fn rolled(
    problem: &mut ViewPlanningProblem<'_>,
    guard: &mut Guard,
    (setup, scene): (&Setup<'_>, &PlanningScene<'_>),
    chosen: &ChosenViews,
    ordered: Ordered,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let part_from_plate = plate_from_placed(&setup.table_from_part).inverse();
    let ctx = ctx.silent();
    scene.roll(ordered, &ctx, &mut |view, plate_from_scanner| {
        let (candidate, pose) = (chosen.candidate(view), part_from_plate * *plate_from_scanner);
        let Some(row) = measured(problem, &pose, &setup.occluders, &ctx)? else { return Ok(false) };
        let before = graded(problem, candidate);
        let permitted = guard.change(problem, view, &before, &row).loses_nothing();
        if permitted {
            guard.exchange(view, &before, &row);
            problem.candidates[candidate].part_from_scanner = pose;
            problem.matrix.rows[candidate.index()] = row;
        }
        Ok(permitted)
    })
}

fn measured(
    problem: &ViewPlanningProblem<'_>,
    pose: &Pose<Part, ScannerFrame>,
    occluders: &visibility::Occluders,
    ctx: &Context<'_>,
) -> Result<Option<Row>, Cancelled> {
    let matrix = visibility::cast(&problem.surface, &[*pose], &[true], problem.input.scanner, occluders, problem.params, ctx)?;
    let mut rows =
        matrix.rows.iter().map(|row| visibility::grade(&problem.surface, pose, problem.input.scanner, problem.params, row));
    Ok(rows.next())
}
