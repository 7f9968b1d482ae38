//! Random re-sampling around the best views so far (Mohammadikaji et al.: thesis §2.2), nearer with every round: direction and
//! place of a view are drawn around those of one of the best, its roll over the whole turn. While there are none, directions are
//! drawn over the sphere around each block.

use std::f64::consts::{FRAC_PI_6, PI};

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use super::aim::SlidesBy;
use super::{Aim, Label, Scope, blocks};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::params::{CandidateParams, Standoff, Strategy};
use crate::planning::random::Stream;

/// Name of this strategy's streams.
const STREAM: u64 = 0x6974_6572;
/// Largest turn in the first round: 30°.
const TURN_RAD: f64 = FRAC_PI_6;
/// Largest move of the aim point in the first round, as a share of a block's edge.
const SHIFT: f64 = 0.25;
/// Factor by which turn and move shrink from round to round.
const SHRINK: f64 = 0.6;

/// Aims of all rounds.
pub(super) fn count(params: &CandidateParams) -> usize {
    let each = if params.uses(Strategy::Iterative) { params.iterative_views as usize } else { 0 };
    each * params.iterative_rounds as usize
}

pub(super) fn aims(scope: &Scope<'_>, params: &CandidateParams, best: &[Pose<Part, ScannerFrame>], round: u32) -> Vec<Aim> {
    let blocks = blocks::split(scope.surface, &scope.table_from_part, scope.scanner);
    let streams = (0..params.iterative_views).map(|n| Stream::new(scope.seed, &[STREAM, u64::from(round), u64::from(n)]));
    let drawn = streams.enumerate().map(|(number, mut stream)| match best.get(number % best.len().max(1)) {
        Some(best) => near(scope, best, SHRINK.powi(round as i32), &mut stream),
        None => Aim::at_block(&blocks[number % blocks.len()], &stream.direction(), scope, params.standoff),
    });
    let keeps = params.standoff == Standoff::Centre;
    drawn.map(|aim| if keeps { Aim { slides_by: SlidesBy::None, ..aim } } else { aim }).collect()
}

fn near(scope: &Scope<'_>, best: &Pose<Part, ScannerFrame>, scale: f64, stream: &mut Stream) -> Aim {
    let table_from_scanner = scope.table_from_part * *best;
    let (best_mm, shift_mm) = (scope.scanner.best_mm, SHIFT * scale * scope.scanner.block_cube_mm);
    let aimed_at = table_from_scanner.point(&Point3::new(stream.within(shift_mm), stream.within(shift_mm), best_mm));
    let (side_rad, roll_rad) = (stream.within(PI), stream.within(PI));
    let side = Unit::new_normalize(table_from_scanner.direction(&Vector3::new(side_rad.cos(), side_rad.sin(), 0.0)));
    let turn = UnitQuaternion::from_axis_angle(&side, TURN_RAD * scale * stream.unit().sqrt());
    let axis = turn * table_from_scanner.direction(&Vector3::z());
    let baseline = turn * table_from_scanner.direction(&Vector3::new(roll_rad.cos(), roll_rad.sin(), 0.0));
    let position_mm = aimed_at - axis * best_mm;
    Aim { position_mm, axis, label: Label::of_direction(&-axis), slides_by: SlidesBy::Part, baseline: Some(baseline) }
}
