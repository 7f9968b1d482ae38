//! The hemisphere tied to the robot's reach (Jing et al. 2017, *Sampling-based coverage motion planning for industrial
//! inspection application with redundant robotic system*; thesis §2.2): many directions above the part, of which those
//! remain that the arm can take at some angle of the table; of these the ones that are spread widest. Whether something
//! collides is left to the stations.
//!
//! Cost: a few inverse kinematics a direction, 72 × 8 where it is out of reach.

use super::aim::place;
use super::spread::widest;
use super::{Aim, Scope, blocks, even};
use crate::cell::{Axes, Cell};
use crate::geometry::{Pose, ScannerFrame, Table, parallel, plate_from_placed};
use crate::planning::context::{Context, PlanError, Refusal};
use crate::planning::params::{CandidateParams, Hemisphere};

/// Directions that are tried for one that is wanted.
const TRIED: u32 = 5;
/// Angles of the table that are tried, evenly over a turn.
const TABLE_ANGLES: u32 = 72;

pub(super) fn aims(scope: &Scope<'_>, params: &CandidateParams, ctx: &Context<'_>) -> Result<Vec<Aim>, PlanError> {
    let Some(cell) = scope.cell else {
        return Err(PlanError::param("/candidates/strategies", &Refusal::ReachWithoutCell));
    };
    let blocks = blocks::split(scope.surface, &scope.table_from_part, scope.scanner);
    let above = CandidateParams { hemisphere: Some(Hemisphere::AboveTable), ..params.clone() };
    let count = even::directions_a_block(params.reach_directions.saturating_mul(TRIED), blocks.len());
    let tried: Vec<Aim> = blocks
        .iter()
        .flat_map(|block| even::spiral(count, even::lowest(block, scope, &above)).map(move |u| (block, u)))
        .map(|(block, u)| Aim::at_block(block, &u, scope, params.standoff))
        .collect();
    // One pose of each stands for all that are made of it later.
    let one = CandidateParams { rolls_deg: vec![0.0], tilts_deg: Vec::new(), standoffs_mm: vec![0.0], ..above };
    let placed = place(scope, &tried, &one, ctx)?;
    let arm = Arm { cell, axes: cell.axes() };
    let within: Vec<bool> = parallel::try_map(&placed, |(pose, _)| ctx.check().map(|()| arm.reaches(pose)))?;
    let reached: Vec<_> = tried.into_iter().zip(within).filter(|(_, within)| *within).map(|(aim, _)| aim).collect();
    Ok(widest(reached, params.reach_directions as usize, |a, b| (a.position_mm - b.position_mm).norm()))
}

struct Arm<'a> {
    cell: &'a Cell,
    axes: Axes,
}

impl Arm<'_> {
    /// Returns true if some joint vector within the limits takes the view at some angle of the table.
    fn reaches(&self, table_from_scanner: &Pose<Table, ScannerFrame>) -> bool {
        let plate_from_flange = plate_from_placed(table_from_scanner) * self.cell.flange_from_scanner.inverse();
        (0..TABLE_ANGLES).map(|step| std::f64::consts::TAU * f64::from(step) / f64::from(TABLE_ANGLES)).any(|table_angle_rad| {
            let base_from_flange = self.cell.base_from_plate(table_angle_rad) * plate_from_flange;
            let turns = self.cell.turntable.axis.windings(table_angle_rad).next().is_some();
            let bends = |joints_rad: &[f64; 6]| {
                self.axes.0.iter().zip(joints_rad).all(|(axis, angle)| axis.windings(*angle).next().is_some())
            };
            turns && self.cell.robot.kinematics.ik_solutions(&base_from_flange).iter().any(bends)
        })
    }
}
