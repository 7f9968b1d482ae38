//! Rows of the visibility matrix that hold under stated errors of pose, for views that are chosen to tolerate them.
//!
//! The set: with φ the angle and t the distance of `robust.pose_error`,
//!
//! - in the scanner's frame, where a wrong hand-eye calibration is off, the six errors of a turn by ±φ about x, y or z together with a
//!   shift by t to the side to which the turn takes the field, where the two add up: ∓y for ±x, ±x for ±y, ±z for ±z;
//! - of the part and its support, the six of a turn by ±φ about the x, y or z through the centre of its box together with a shift
//!   by t across the axis. With e₁, e₂, e₃ the axes from that of the turn on, cyclic: +e₁ with +e₃, −e₁ with −e₂. A turn about
//!   +e₁ takes a viewpoint on the side of +e₂ towards +e₃, and one about −e₁ a viewpoint on the side of −e₃ towards −e₂: on each
//!   of the six sides there is one error in which turn and shift add up. Signs and directions have no source.
//!
//! Errors of the part move viewpoints sideways by the lever to its centre, and so change incidence and shadows; those of the scanner
//! move the field. Cost: twelve times the time for visibility.

#[cfg(test)]
mod tests;

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::evaluated::EvaluatedCandidates;
use crate::cell::Scanner;
use crate::geometry::{Part, Pose, ScannerFrame};
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
    let views: Vec<_> = candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect();
    for stated in stated_errors(&error, &scene.surface.centre_mm) {
        let poses: Vec<_> = views.iter().map(|view| stated.moved(*view)).collect();
        let off = visibility::cast(scene.surface, &poses, &usable, scene.scanner, scene.occluders, scene.params, ctx)?;
        rows.iter_mut().zip(&off.rows).for_each(|(row, off)| *row = row.within(off.measured()));
    }
    Ok(Some(rows))
}

/// A stated error.
enum StatedError {
    /// The scanner is off in its own frame.
    Scanner(Pose<ScannerFrame, ScannerFrame>),
    /// The part and its support are off as one.
    Part(Pose<Part, Part>),
}

impl StatedError {
    /// A view under the error.
    fn moved(&self, part_from_scanner: Pose<Part, ScannerFrame>) -> Pose<Part, ScannerFrame> {
        match self {
            Self::Scanner(off) => part_from_scanner * *off,
            Self::Part(off) => *off * part_from_scanner,
        }
    }
}

/// The twelve stated errors; `centre_mm` is the centre of the part's box.
fn stated_errors(error: &PoseErrorParams, centre_mm: &Point3<f64>) -> impl Iterator<Item = StatedError> {
    let of_scanner = scanner_errors(error).into_iter().map(StatedError::Scanner);
    of_scanner.chain(part_errors(error, centre_mm).into_iter().map(StatedError::Part))
}

/// The six stated errors of the scanner, scanner frame.
fn scanner_errors(error: &PoseErrorParams) -> [Pose<ScannerFrame, ScannerFrame>; 6] {
    let (angle_rad, shift_mm) = (error.angle_deg.to_radians(), error.translation_mm);
    let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
    // Axis of the turn, and the way that a positive one takes the field; roll takes it nowhere, and depth adds to it.
    let ways = [(x, -y.into_inner()), (y, x.into_inner()), (z, z.into_inner())];
    std::array::from_fn(|number| {
        let ((axis, way), sign) = (ways[number / 2], if number % 2 == 0 { 1.0 } else { -1.0 });
        Pose::from_parts(way * (sign * shift_mm), UnitQuaternion::from_axis_angle(&axis, sign * angle_rad))
    })
}

/// The six stated errors of the part, part frame.
fn part_errors(error: &PoseErrorParams, centre_mm: &Point3<f64>) -> [Pose<Part, Part>; 6] {
    let (angle_rad, shift_mm) = (error.angle_deg.to_radians(), error.translation_mm);
    let axis = |number: usize| Vector3::<f64>::ith(number % 3, 1.0);
    std::array::from_fn(|number| {
        let first = number / 2;
        let (turn_axis, way) = if number % 2 == 0 { (axis(first), axis(first + 2)) } else { (-axis(first), -axis(first + 1)) };
        let turn = UnitQuaternion::from_scaled_axis(turn_axis * angle_rad);
        Pose::from_parts(centre_mm.coords + way * shift_mm - turn * centre_mm.coords, turn)
    })
}
