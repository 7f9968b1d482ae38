//! Calibration poses as a program: poses that tell most and that the arm gets to, in the order of the shortest tour, each taken from the
//! configuration that was chosen for it, since the table's angles are part of what they tell.

use crate::cell::CollisionScene;
use crate::cell::calibration::poses::{PlannedPose, PosePlan, PosePlanner};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::PlanParams;
use crate::planning::plan::ViewId;
use crate::planning::sequence::{OrderOptions, Roadmaps, Sequence, order_in_sight};
use crate::planning::stations::Station;
use crate::program::Expected;

/// Times that poses without a path are left out and others chosen: our choice, a minute at most in the cells tried.
const MAX_ROUNDS: usize = 40;

/// Calibration poses with the tour through them.
#[derive(Debug)]
pub struct RoutedPoses {
    /// The poses; a view of the tour is a place among them.
    pub plan: PosePlan,
    /// The tour.
    pub sequence: Sequence,
}

/// Reason for which there are no routed poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooFewPoses {
    /// Poses that the arm takes with the board in view.
    pub reached: usize,
    /// Poses of those that were chosen and to which no path was found.
    pub without_path: usize,
}

/// Chooses poses that the arm gets to without a collision and orders them.
///
/// # Errors
/// [`Cancelled`]; inside, [`TooFewPoses`].
pub fn route(
    planner: &PosePlanner<'_>,
    scene: &CollisionScene,
    (count, hold_out): (usize, usize),
    params: &PlanParams,
    ctx: &Context<'_>,
) -> Result<Result<RoutedPoses, TooFewPoses>, Cancelled> {
    let mut candidates = planner.candidates();
    let (reached, roadmaps) = (candidates.len(), Roadmaps::default());
    // Those without a path are left out and others chosen.
    for _ in 0..MAX_ROUNDS {
        let Some(plan) = planner.choose(&candidates, count, hold_out) else { break };
        let stations: Vec<[Station; 1]> = plan.poses.iter().map(|pose| [Station::from(pose.configuration)]).collect();
        let views: Vec<(ViewId, &[Station])> =
            stations.iter().enumerate().map(|(index, station)| (ViewId::at(index), station.as_slice())).collect();
        // No pose is taken from elsewhere: that would be another observation.
        let options = OrderOptions { roadmaps: Some(&roadmaps), require_all: true, in_sight: &|_, _| false };
        let ordered = order_in_sight(&views, planner.cell, scene, params, &options, ctx)?;
        if ordered.no_path.is_empty() {
            return Ok(Ok(RoutedPoses { plan, sequence: ordered.sequence }));
        }
        let is_shut = |candidate: &PlannedPose| {
            ordered.no_path.iter().any(|view| plan.poses[view.index()].sighting.id == candidate.sighting.id)
        };
        candidates.retain(|candidate| !is_shut(candidate));
    }
    Ok(Err(TooFewPoses { reached, without_path: reached - candidates.len() }))
}

/// Requirements of the poses on their program: what a plan's are for the linter. The plate stands for the part.
#[must_use]
pub fn expected(planner: &PosePlanner<'_>, plan: &PosePlan, plan_sha256: &str) -> Expected {
    let view = |(index, pose): (usize, &PlannedPose)| {
        let at = &pose.configuration;
        let plate_from_scanner =
            planner.cell.base_from_plate(at.table_rad).inverse() * planner.cell.base_from_scanner(&at.joints_rad);
        (ViewId::at(index), Pose::<Part, ScannerFrame>::claim(*plate_from_scanner.isometry()))
    };
    Expected {
        plan_sha256: plan_sha256.to_owned(),
        table_from_part: Pose::identity(),
        table_alone: false,
        views: plan.poses.iter().enumerate().map(view).collect(),
    }
}
