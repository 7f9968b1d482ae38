//! Rolls of chosen views: a view may be taken turned about its optical axis where the moves are shorter then and, measured
//! anew, the views together measure no less, of the part and of each region. At most three poses are evaluated for each view.
//! Plans that ask for overlap, or for views that tolerate stated errors, keep their rolls.

use crate::geometry::{Part, Pose, ScannerFrame, plate_from_placed};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::Roll;
use crate::planning::problem::{ChosenViews, ViewPlanningProblem};
use crate::planning::scene::PlanningScene;
use crate::planning::sequence::Ordered;
use crate::planning::setups::Setup;
use crate::planning::visibility::{self, Row};

/// Areas are sums in another order.
const SUM_SLACK_MM2: f64 = 1e-6;

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
    let overlap = &problem.params.selection.overlap;
    let is_registered = overlap.min_area_mm2.is_some() || overlap.min_share.is_some();
    // What views share, and what they measure under stated errors, would have to be judged anew too.
    if problem.params.motion.roll == Roll::Fixed || is_registered || problem.robust_rows.is_some() {
        return Ok(ordered);
    }
    let no_path = ordered.iter().flat_map(|ordered| &ordered.no_path).copied();
    let no_path = problem.candidates_behind(chosen, &no_path.collect::<Vec<_>>());
    let mut view_counts = ViewCounts::of(problem, chosen.kept.iter().copied().filter(|kept| !no_path.contains(kept)));
    let scenes = setups.iter().filter_map(|setup| Some((setup, setup.scene.as_ref()?)));
    ordered
        .into_iter()
        .zip(scenes)
        .map(|(ordered, (setup, scene))| rolled(problem, &mut view_counts, (setup, scene), chosen, ordered, ctx))
        .collect()
}

fn rolled(
    problem: &mut ViewPlanningProblem<'_>,
    view_counts: &mut ViewCounts,
    (setup, scene): (&Setup<'_>, &PlanningScene<'_>),
    chosen: &ChosenViews,
    ordered: Ordered,
    ctx: &Context<'_>,
) -> Result<Ordered, Cancelled> {
    let part_from_plate = plate_from_placed(&setup.table_from_part).inverse();
    let ctx = ctx.silent();
    scene.roll(ordered, &ctx, &mut |view, plate_from_scanner| {
        let (kept, pose) = (chosen.kept[view.0 as usize], part_from_plate * *plate_from_scanner);
        let Some(row) = measured(problem, &pose, &setup.occluders, &ctx)? else { return Ok(false) };
        let permitted = view_counts.measure_no_less(problem, &problem.matrix.rows[kept], &row);
        if permitted {
            view_counts.exchange(&problem.matrix.rows[kept], &row);
            problem.candidates.kept[kept].part_from_scanner = pose;
            problem.matrix.rows[kept] = row;
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
    Ok(matrix.rows.into_iter().next())
}

/// Number of chosen views that measure each sample.
struct ViewCounts(Vec<u32>);

impl ViewCounts {
    fn of(problem: &ViewPlanningProblem<'_>, kept: impl Iterator<Item = usize>) -> Self {
        let mut views = vec![0; problem.surface.sample_mm.len()];
        kept.for_each(|kept| problem.matrix.rows[kept].samples().for_each(|sample| views[sample as usize] += 1));
        Self(views)
    }

    /// Returns true if one row in place of another loses no area, in all and in any region.
    fn measure_no_less(&self, problem: &ViewPlanningProblem<'_>, before: &Row, after: &Row) -> bool {
        let requirements = &problem.surface.requirements;
        let mut gained_mm2: Vec<f64> = Vec::new();
        let mut add = |sample: u32, area_mm2: f64| {
            let regions = requirements.of(sample as usize).regions.iter().map(|region| region + 1);
            for place in std::iter::once(0).chain(regions) {
                gained_mm2.resize(gained_mm2.len().max(place + 1), 0.0);
                gained_mm2[place] += area_mm2;
            }
        };
        let area_mm2 = |sample: u32| problem.asked_area_mm2[sample as usize];
        for sample in before.samples().filter(|sample| !after.holds(*sample) && self.0[*sample as usize] == 1) {
            add(sample, -area_mm2(sample));
        }
        for sample in after.samples().filter(|sample| !before.holds(*sample) && self.0[*sample as usize] == 0) {
            add(sample, area_mm2(sample));
        }
        gained_mm2.iter().all(|gained| *gained >= -SUM_SLACK_MM2)
    }

    fn exchange(&mut self, before: &Row, after: &Row) {
        before.samples().for_each(|sample| self.0[sample as usize] -= 1);
        after.samples().for_each(|sample| self.0[sample as usize] += 1);
    }
}
