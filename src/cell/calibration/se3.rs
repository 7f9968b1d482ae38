//! Small motions of rigid bodies: the exponential and logarithm of SE(3), its adjoint and its Jacobian (T. D. Barfoot, *State
//! Estimation for Robotics*, 2017, sections 7.1.3 to 7.1.5). Twists hold the rotation first, then the translation: rad, then mm.
//! An increment is a body's own: T ← T · exp(ξ).

use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// Rotation vector (rad) and translation (mm) of a small motion, in the frame that moves.
pub type Twist = Vector6<f64>;

/// Angle below which series replace quotients, rad: their next terms are below the last digit.
const SMALL_RAD: f64 = 1e-2;

/// Rotation part of a twist, rad.
#[must_use]
pub fn rotation_of(twist: &Twist) -> Vector3<f64> {
    twist.fixed_rows::<3>(0).into_owned()
}

/// Translation part of a twist, mm.
#[must_use]
pub fn translation_of(twist: &Twist) -> Vector3<f64> {
    twist.fixed_rows::<3>(3).into_owned()
}

/// Twist of a rotation vector and a translation.
#[must_use]
pub fn twist(rotation_rad: &Vector3<f64>, translation_mm: &Vector3<f64>) -> Twist {
    let (r, t) = (rotation_rad, translation_mm);
    Twist::new(r.x, r.y, r.z, t.x, t.y, t.z)
}

/// Motion that a twist leads to in one unit of time (Barfoot 7.85).
#[must_use]
pub fn exp(twist: &Twist) -> Isometry3<f64> {
    let (rotation, translation) = (rotation_of(twist), translation_of(twist));
    let (angle, hat) = (rotation.norm(), rotation.cross_matrix());
    let (first, second) = if angle < SMALL_RAD {
        (0.5 - angle.powi(2) / 24.0 + angle.powi(4) / 720.0, 1.0 / 6.0 - angle.powi(2) / 120.0 + angle.powi(4) / 5040.0)
    } else {
        ((1.0 - angle.cos()) / angle.powi(2), (angle - angle.sin()) / angle.powi(3))
    };
    let moved = (Matrix3::identity() + hat * first + hat * hat * second) * translation;
    Isometry3::from_parts(Translation3::from(moved), UnitQuaternion::from_scaled_axis(rotation))
}

/// Twist that leads to a motion: the inverse of [`exp`] for turns below π.
#[must_use]
pub fn log(motion: &Isometry3<f64>) -> Twist {
    let rotation = motion.rotation.scaled_axis();
    let (angle, hat) = (rotation.norm(), rotation.cross_matrix());
    let second = if angle < SMALL_RAD {
        1.0 / 12.0 + angle.powi(2) / 720.0 + angle.powi(4) / 30_240.0
    } else {
        (1.0 - 0.5 * angle / (0.5 * angle).tan()) / angle.powi(2)
    };
    let translation = (Matrix3::identity() - hat * 0.5 + hat * hat * second) * motion.translation.vector;
    twist(&rotation, &translation)
}

/// Adjoint: takes a twist of the frame that `motion` maps from to the frame that it maps to (Barfoot 7.54, rotation first).
#[must_use]
pub fn adjoint(motion: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation = motion.rotation.to_rotation_matrix().into_inner();
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&(motion.translation.vector.cross_matrix() * rotation));
    matrix
}

/// Inverse of the right Jacobian at `twist`, which takes a body increment behind exp(`twist`) to a change of the twist; its
/// series to the fourth order (Barfoot 7.91 with the Bernoulli numbers 1/12 and −1/720), good for residuals.
#[must_use]
pub fn right_jacobian_inverse(twist: &Twist) -> Matrix6<f64> {
    let mut small = Matrix6::zeros();
    let (turn, shift) = (rotation_of(twist).cross_matrix(), translation_of(twist).cross_matrix());
    small.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    small.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    small.fixed_view_mut::<3, 3>(3, 0).copy_from(&shift);
    let square = small * small;
    Matrix6::identity() + small * 0.5 + square / 12.0 - square * square / 720.0
}

/// Mean of poses: the one from which their twists add up to nothing, by repeated averaging (M. Moakher, *Means and averaging in
/// the group of rotations*, SIAM J. Matrix Anal. Appl. 24(1), 2002, section 3).
#[must_use]
pub fn mean_pose(poses: &[Isometry3<f64>]) -> Isometry3<f64> {
    let Some(mut mean) = poses.first().copied() else { return Isometry3::identity() };
    for _ in 0..20 {
        let step = poses.iter().map(|pose| log(&(mean.inverse() * pose))).sum::<Twist>() / poses.len() as f64;
        mean *= exp(&step);
        if step.norm() < 1e-14 {
            break;
        }
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm_inverts_the_exponential_and_the_jacobian_is_its_derivative() {
        for scale in [1e-9_f64, 1e-5, 1e-3, 0.3] {
            let at = twist(&(Vector3::new(0.3, -0.5, 0.7) * scale), &Vector3::new(4.0, 5.0, -6.0));
            assert!((log(&exp(&at)) - at).norm() < 1e-12, "{scale}");
            let jacobian = right_jacobian_inverse(&at);
            for axis in 0..6 {
                let mut step = Twist::zeros();
                step[axis] = 1e-6;
                let slope = (log(&(exp(&at) * exp(&step))) - log(&(exp(&at) * exp(&-step)))) / 2e-6;
                assert!((slope - jacobian.column(axis)).norm() < 2e-4 * scale.max(1e-4), "{scale} {axis}");
            }
        }
    }

    #[test]
    fn adjoint_moves_a_twist_through_a_pose() {
        let pose = exp(&twist(&Vector3::new(0.4, 0.2, -1.1), &Vector3::new(100.0, -50.0, 30.0)));
        let small = twist(&Vector3::new(0.01, 0.02, -0.03), &Vector3::new(1.0, 2.0, 3.0));
        let moved = exp(&(adjoint(&pose) * small)) * pose;
        assert!((log(&(moved.inverse() * pose * exp(&small)))).norm() < 1e-12);
    }
}
