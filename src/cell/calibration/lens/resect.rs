//! A device from points whose places are known: by the direct linear transformation (Hartley and Zisserman, *Multiple View
//! Geometry*, 2nd edition, section 7.1), then by Levenberg–Marquardt over lens and pose.

use nalgebra::{
    Isometry3, Matrix3, Matrix6, Point3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
};

use super::board_pose::BoardInCamera;
use super::equations::moved;
use super::model::{LENS, LensParameters};
use super::start::smallest_vector;

/// Unknowns: lens and pose.
const UNKNOWNS: usize = LENS + 6;
/// Fewest points of the direct linear transformation.
const MIN_POINTS: usize = 6;
/// Steps of the refinement.
const STEPS: usize = 100;

/// A device and how well the points fix it.
pub(super) struct Resected {
    pub(super) lens: LensParameters,
    pub(super) device_from_points: Isometry3<f64>,
    /// Root mean square length of the residuals, px.
    pub(super) rms_px: f64,
    /// Covariance of lens, turn and shift for residuals of the size found; `None` without redundancy.
    pub(super) covariance: Option<SMatrix<f64, UNKNOWNS, UNKNOWNS>>,
}

/// Lens without distortion and pose in closed form; `None` for points on a plane.
pub(super) fn direct(points: &[(Point3<f64>, Vector2<f64>)], size_px: [u32; 2]) -> Option<(LensParameters, Isometry3<f64>)> {
    if points.len() < MIN_POINTS {
        return None;
    }
    let count = points.len() as f64;
    let mean = points.iter().map(|(point, _)| point.coords).sum::<Vector3<f64>>() / count;
    let spread = points.iter().map(|(point, _)| (point.coords - mean).norm()).sum::<f64>() / count / 3.0_f64.sqrt();
    let middle = points.iter().map(|(_, pixel)| *pixel).sum::<Vector2<f64>>() / count;
    let width = points.iter().map(|(_, pixel)| (pixel - middle).norm()).sum::<f64>() / count / 2.0_f64.sqrt();
    let mut sum = SMatrix::<f64, 12, 12>::zeros();
    for (point, pixel) in points {
        let (p, q) = (((point.coords - mean) / spread).push(1.0), (pixel - middle) / width);
        let row = |signs: [f64; 3]| SVector::<f64, 12>::from_fn(|index, _| p[index % 4] * signs[index / 4]);
        let (first, second) = (row([1.0, 0.0, -q.x]), row([0.0, 1.0, -q.y]));
        sum += first * first.transpose() + second * second.transpose();
    }
    let (found, next) = smallest_vector(&sum)?;
    if next < 1e-9 * sum.trace() {
        return None;
    }
    let normalised = SMatrix::<f64, 3, 4>::from_fn(|row, column| found[4 * row + column]);
    let pixels = Matrix3::new(width, 0.0, middle.x, 0.0, width, middle.y, 0.0, 0.0, 1.0);
    let matrix = pixels * normalised;
    let left = matrix.fixed_view::<3, 3>(0, 0) / spread;
    let last = matrix.column(3) - left * mean;
    // The sign for which points are in front: their depth is the third row times the point.
    let depth = (left * mean + last).z;
    let (left, last) = if depth < 0.0 { (-left, -last) } else { (left, last) };
    let (camera, turn) = rq(&left)?;
    let camera = camera / camera[(2, 2)];
    let scale = left.row(2).norm();
    let translation = camera.try_inverse()? * last / scale;
    let pose = Isometry3::from_parts(
        Translation3::from(translation),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn)),
    );
    let lens = LensParameters {
        size_px,
        fx: camera[(0, 0)],
        fy: camera[(1, 1)],
        cx: camera[(0, 2)],
        cy: camera[(1, 2)],
        skew: 0.0,
        distortion: [0.0; 5],
    };
    lens.values().iter().chain(pose.translation.vector.iter()).all(|value| value.is_finite()).then_some((lens, pose))
}

/// Upper triangle with a positive diagonal, times a rotation.
fn rq(matrix: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    let flip = Matrix3::new(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0);
    let qr = (flip * matrix).transpose().qr();
    let (upper, turn) = (flip * qr.r().transpose() * flip, flip * qr.q().transpose());
    let signs = Matrix3::from_diagonal(&Vector3::from_fn(|axis, _| if upper[(axis, axis)] < 0.0 { -1.0 } else { 1.0 }));
    let (upper, turn) = (upper * signs, signs * turn);
    (turn.determinant() > 0.0 && upper[(2, 2)] > 0.0).then_some((upper, turn))
}

/// Normal equations and half the sum of squares.
type Sums = (SMatrix<f64, UNKNOWNS, UNKNOWNS>, SVector<f64, UNKNOWNS>, f64);

fn sums(
    points: &[(Point3<f64>, Vector2<f64>)],
    lens: &LensParameters,
    pose: &Isometry3<f64>,
    is_held: &[bool; LENS],
) -> Option<Sums> {
    let (mut square, mut side, mut cost) = (SMatrix::zeros(), SVector::zeros(), 0.0);
    for (point, pixel) in points {
        let turned = pose.rotation * point.coords;
        let at = Point3::from(turned + pose.translation.vector);
        if at.z <= 0.0 {
            return None;
        }
        let (computed, by) = lens.differentiate(&at);
        let off = pixel - computed;
        let mut jacobian = SMatrix::<f64, 2, UNKNOWNS>::zeros();
        jacobian.fixed_view_mut::<2, LENS>(0, 0).copy_from(&by.by_lens);
        jacobian.fixed_view_mut::<2, 3>(0, LENS).copy_from(&(-by.by_point * turned.cross_matrix()));
        jacobian.fixed_view_mut::<2, 3>(0, LENS + 3).copy_from(&by.by_point);
        square += jacobian.transpose() * jacobian;
        side += jacobian.transpose() * off;
        cost += 0.5 * off.norm_squared();
    }
    for index in (0..LENS).filter(|index| is_held[*index]) {
        square.row_mut(index).fill(0.0);
        square.column_mut(index).fill(0.0);
        square[(index, index)] = 1.0;
        side[index] = 0.0;
    }
    Some((square, side, cost))
}

/// Lens and pose of least squares from a start; held parameters of the lens keep their values.
pub(super) fn refine(
    points: &[(Point3<f64>, Vector2<f64>)],
    (mut lens, mut pose): (LensParameters, Isometry3<f64>),
    is_held: &[bool; LENS],
) -> Option<Resected> {
    let (mut square, mut side, mut cost) = sums(points, &lens, &pose, is_held)?;
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let mut damped = square;
        (0..UNKNOWNS).for_each(|index| damped[(index, index)] *= 1.0 + damping);
        let trial = damped.cholesky().map(|factor| factor.solve(&side)).map(|step| {
            let mut values = lens.values();
            values.iter_mut().zip(step.iter()).for_each(|(value, change)| *value += change);
            (lens.with_values(values), moved(&pose, &step.as_slice()[LENS..]))
        });
        let better = trial.and_then(|(lens, pose)| sums(points, &lens, &pose, is_held).map(|sums| (lens, pose, sums)));
        match better.filter(|(_, _, (_, _, trial_cost))| *trial_cost <= cost) {
            Some((next_lens, next_pose, next)) => {
                let is_done = cost - next.2 <= 1e-14 * cost;
                (lens, pose, square, side, cost) = (next_lens, next_pose, next.0, next.1, next.2);
                damping = (damping * 0.1_f64).max(1e-12);
                if is_done {
                    break;
                }
            }
            None => damping *= 10.0,
        }
        if damping > 1e12 {
            break;
        }
    }
    let free = UNKNOWNS - is_held.iter().filter(|held| **held).count();
    let redundancy = (2 * points.len()).saturating_sub(free);
    let covariance = (redundancy > 0)
        .then(|| square.cholesky().map(|factor| factor.inverse() * (2.0 * cost / redundancy as f64)))
        .flatten()
        .map(|mut covariance| {
            for index in (0..LENS).filter(|index| is_held[*index]) {
                covariance[(index, index)] = 0.0;
            }
            covariance
        });
    let rms_px = (2.0 * cost / points.len() as f64).sqrt();
    rms_px.is_finite().then_some(Resected { lens, device_from_points: pose, rms_px, covariance })
}

/// Pose of least squares from a start, with the lens held; `None` if a point is behind the camera, or if they leave a freedom open.
pub(super) fn pose(
    points: &[(Point3<f64>, Vector2<f64>)],
    lens: &LensParameters,
    start: &Isometry3<f64>,
) -> Option<BoardInCamera> {
    let held = [true; LENS];
    let Resected { device_from_points: pose, rms_px, .. } = refine(points, (*lens, *start), &held)?;
    let (square, _, _) = sums(points, lens, &pose, &held)?;
    let square = square.fixed_view::<6, 6>(LENS, LENS).into_owned();
    // From turns about the camera's axes and shifts along them to those of the board.
    let mut board_from_camera = Matrix6::zeros();
    let turn = pose.rotation.inverse().to_rotation_matrix();
    for first in [0, 3] {
        board_from_camera.fixed_view_mut::<3, 3>(first, first).copy_from(turn.matrix());
    }
    let covariance = square.cholesky()?.inverse();
    let unit_covariance = board_from_camera * covariance * board_from_camera.transpose();
    Some(BoardInCamera { camera_from_board: pose, unit_covariance, rms_px })
}
