//! Rolls of chosen views: a view may be taken turned about its optical axis where the moves are shorter then and, measured
//! anew, the views together lose nothing ([`super::guard`]). At most three poses are evaluated for each view. Plans that ask for
//! overlap, for setups that share surface, or for views that tolerate stated errors, keep their rolls.

use super::guard::{Guard, graded};
use super::joins;
use crate::cell::Configuration;
use crate::geometry::{Part, Plate, Pose, ScannerFrame, plate_from_placed};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::ViewId;
use crate::planning::params::Roll;
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::scene::PlanningScene;
use crate::planning::sequence::{Ordered, StopPermits};
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
    let mut permits = RollPermits { problem, guard, setup, scene, chosen, part_from_plate, ctx: ctx.silent() };
    scene.roll(ordered, &ctx.silent(), &mut permits)
}

/// Permits for one setup: a view is rolled, in the problem too, where all views together lose nothing by it.
struct RollPermits<'p, 'a, 'b> {
    problem: &'p mut ViewPlanningProblem<'b>,
    guard: &'p mut Guard,
    setup: &'p Setup<'a>,
    scene: &'p PlanningScene<'a>,
    chosen: &'p ChosenViews,
    part_from_plate: Pose<Part, Plate>,
    ctx: Context<'p>,
}

impl StopPermits for RollPermits<'_, '_, '_> {
    fn may_roll(
        &mut self,
        view: ViewId,
        plate_from_scanner: &Pose<Plate, ScannerFrame>,
        table_rad: f64,
    ) -> Result<bool, Cancelled> {
        let (candidate, pose) = (self.chosen.candidate(view), self.part_from_plate * *plate_from_scanner);
        let Some(mut row) = measured(self.problem, &pose, &self.setup.occluders, &self.ctx)? else { return Ok(false) };
        let hidden = self.scene.sight().hidden(&self.problem.surface, &pose, row.measured(), table_rad, &self.ctx)?;
        if let Some(hidden) = hidden {
            row = row.without(&hidden);
        }
        let before = graded(self.problem, candidate);
        let permitted = self.guard.change(self.problem, view, &before, &row).loses_nothing();
        if permitted {
            self.guard.exchange(view, &before, &row);
            self.problem.candidates[candidate].part_from_scanner = pose;
            self.problem.matrix.rows[candidate.index()] = row;
        }
        Ok(permitted)
    }

    fn is_in_sight(&self, view: ViewId, station: &Configuration) -> bool {
        self.problem.is_in_sight(self.scene, self.chosen.candidate(view), station, &self.ctx)
    }
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
