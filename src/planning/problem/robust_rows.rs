//! Rows of the visibility matrix that hold under stated errors of pose, for views that are chosen to tolerate them.
//!
//! The set: with φ the angle and t the distance of `robust.pose_error`, in the scanner's frame, the six errors of a turn
//! by ±φ about x, y or z together with a shift by t to the side to which the turn takes the field, where the two add up:
//! ∓y for ±x, ±x for ±y, ±z for ±z. Cost: six times the time for visibility.

#[cfg(test)]
mod tests;

use nalgebra::{UnitQuaternion, Vector3};

use super::evaluated::EvaluatedCandidates;
use crate::cell::Scanner;
use crate::geometry::{Pose, ScannerFrame};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::{PlanParams, PoseErrorParams};
use crate::planning::surface::Surface;
use crate::planning::visibility::{self, Occluders, Row};

/// Inputs of the rows of a visibility matrix.
pub(super) struct VisibilityInput<'a> {
    pub(super) surface: &'a Surface,
    pub(super) scanner: &'a Scanner,
    pub(super) occluders: &'a Occluders,
    pub(super) params: &'a PlanParams,
}

/// Computes, for each candidate, the samples that it measures as planned, its row of the matrix, and under every error of the
/// set as well. `None` where views are chosen by the nominal rows.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn rows(
    scene: &VisibilityInput<'_>,
    evaluated: &EvaluatedCandidates,
    ctx: &Context<'_>,
) -> Result<Option<Vec<Row>>, Cancelled> {
    let Some(error) = scene.params.robust.pose_error.filter(|_| scene.params.robust.select) else { return Ok(None) };
    let (candidates, mut rows) = (&evaluated.candidates, evaluated.matrix.rows.clone());
    let usable: Vec<bool> = candidates.indices().map(|candidate| evaluated.is_usable(candidate)).collect();
    for scanner_from_off in stated_errors(&error) {
        let poses: Vec<_> = candidates.remaining.iter().map(|candidate| candidate.part_from_scanner * scanner_from_off).collect();
        let off = visibility::cast(scene.surface, &poses, &usable, scene.scanner, scene.occluders, scene.params, ctx)?;
        rows.iter_mut().zip(&off.rows).for_each(|(row, off)| *row = row.within(off.measured()));
    }
    Ok(Some(rows))
}

/// The six stated errors, scanner frame.
fn stated_errors(error: &PoseErrorParams) -> [Pose<ScannerFrame, ScannerFrame>; 6] {
    let (angle_rad, shift_mm) = (error.angle_deg.to_radians(), error.translation_mm);
    let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
    // Axis of the turn, and the way that a positive one takes the field; roll takes it nowhere, and depth adds to it.
    let ways = [(x, -y.into_inner()), (y, x.into_inner()), (z, z.into_inner())];
    std::array::from_fn(|number| {
        let ((axis, way), sign) = (ways[number / 2], if number % 2 == 0 { 1.0 } else { -1.0 });
        Pose::from_parts(way * (sign * shift_mm), UnitQuaternion::from_axis_angle(&axis, sign * angle_rad))
    })
}
