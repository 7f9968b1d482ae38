//! Closed forms that a refinement starts from. Hand-eye: Park & Martin, *Robot Sensor Calibration: Solving AX = XB on the
//! Euclidean Group*, IEEE Trans. Robotics and Automation 10(5), 1994, section III, with the rotation taken by the singular values and its
//! determinant held at +1: the printed (MᵀM)^−½Mᵀ returns reflections on contaminated sets. As a second opinion Daniilidis,
//! *Hand-Eye Calibration Using Dual Quaternions*, Int. J. Robotics Research 18(3), 1999, section 5. Axis of the table: mean of the screw
//! axes of the board's relative motions. All pairs of observations are used: O(n²).

use nalgebra::{DMatrix, Isometry3, Matrix3, Rotation3, SMatrix, Translation3, Unit, UnitQuaternion, Vector3};

use super::data::{ChainEstimate, Sighting};
use super::se3::mean_pose;
use crate::geometry::descending;

/// Smallest turn between two observations that tells a screw axis, rad.
const MIN_SCREW_RAD: f64 = 1e-3;

/// Pairs of relative motions (A of the flange, B of the board in the cloud) with A X = X B. `frames` are the poses of the flange
/// seen from where the board stands still: from the base, or from the plate.
fn motions<'a>(
    frames: &'a [Isometry3<f64>],
    seen: &'a [Isometry3<f64>],
) -> impl Iterator<Item = (Isometry3<f64>, Isometry3<f64>)> + 'a {
    let pairs = (0..frames.len()).flat_map(move |i| (i + 1..frames.len()).map(move |j| (i, j)));
    pairs.map(move |(i, j)| (frames[j].inverse() * frames[i], seen[j] * seen[i].inverse()))
}

/// Rotation nearest to a matrix: its polar factor with determinant +1.
#[must_use]
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let is_rotation = rotation.iter().all(|value| value.is_finite());
    is_rotation.then(|| UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)))
}

/// Hand-eye by Park & Martin: `frames[k]` · X · `seen[k]` is the same for all k. None where the motions leave it open.
#[must_use]
pub fn park_martin(frames: &[Isometry3<f64>], seen: &[Isometry3<f64>]) -> Option<Isometry3<f64>> {
    let mut moments = Matrix3::zeros();
    for (flange, board) in motions(frames, seen) {
        moments += flange.rotation.scaled_axis() * board.rotation.scaled_axis().transpose();
    }
    let rotation = nearest_rotation(&moments)?;
    let translation = translation_of_hand_eye(frames, seen, &rotation)?;
    Some(Isometry3::from_parts(Translation3::from(translation), rotation))
}

/// Translation by least squares of (R_A − I) t = R_X t_B − t_A over all pairs.
fn translation_of_hand_eye(
    frames: &[Isometry3<f64>],
    seen: &[Isometry3<f64>],
    rotation: &UnitQuaternion<f64>,
) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (flange, board) in motions(frames, seen) {
        let rows = flange.rotation.to_rotation_matrix().into_inner() - Matrix3::identity();
        normal += rows.transpose() * rows;
        right += rows.transpose() * (rotation * board.translation.vector - flange.translation.vector);
    }
    let solution = normal.lu().solve(&right)?;
    solution.iter().all(|value| value.is_finite()).then_some(solution)
}

/// Hand-eye by Daniilidis: both parts at once, by the null space of dual quaternions.
#[must_use]
pub fn daniilidis(frames: &[Isometry3<f64>], seen: &[Isometry3<f64>]) -> Option<Isometry3<f64>> {
    let rows: Vec<SMatrix<f64, 6, 8>> = motions(frames, seen).map(|(flange, board)| dual_rows(&flange, &board)).collect();
    let stacked = DMatrix::from_fn(6 * rows.len(), 8, |row, column| rows[row / 6][(row % 6, column)]);
    if stacked.nrows() < 12 {
        return None;
    }
    let svd = stacked.svd(false, true);
    let v_t = svd.v_t?;
    let order = descending(svd.singular_values.as_slice());
    let row = |place: usize| -> [f64; 8] { std::array::from_fn(|column| v_t[(order[place], column)]) };
    dual_solution(&row(6), &row(7))
}

/// Six equations of one pair on the eight components of the dual quaternion (Daniilidis, equation 31).
fn dual_rows(flange: &Isometry3<f64>, board: &Isometry3<f64>) -> SMatrix<f64, 6, 8> {
    let ([a, a_dual], [b, b_dual]) = ([flange, board].map(dual_vector)).into();
    let mut rows = SMatrix::<f64, 6, 8>::zeros();
    let (difference, difference_dual) = (a - b, a_dual - b_dual);
    let (sum, sum_dual) = ((a + b).cross_matrix(), (a_dual + b_dual).cross_matrix());
    rows.fixed_view_mut::<3, 1>(0, 0).copy_from(&difference);
    rows.fixed_view_mut::<3, 3>(0, 1).copy_from(&sum);
    rows.fixed_view_mut::<3, 1>(3, 0).copy_from(&difference_dual);
    rows.fixed_view_mut::<3, 3>(3, 1).copy_from(&sum_dual);
    rows.fixed_view_mut::<3, 1>(3, 4).copy_from(&difference);
    rows.fixed_view_mut::<3, 3>(3, 5).copy_from(&sum);
    rows
}

/// Vector parts of the dual quaternion of a motion, real and dual, the real scalar not negative.
fn dual_vector(motion: &Isometry3<f64>) -> [Vector3<f64>; 2] {
    let mut real = motion.rotation.into_inner();
    if real.w < 0.0 {
        real = -real;
    }
    let translation = nalgebra::Quaternion::from_parts(0.0, motion.translation.vector);
    [real.vector().into_owned(), (translation * real * 0.5).vector().into_owned()]
}

/// Combination of the two null vectors that is a unit dual quaternion (Daniilidis, equations 34 and 35).
fn dual_solution(v7: &[f64; 8], v8: &[f64; 8]) -> Option<Isometry3<f64>> {
    let real = |v: &[f64; 8]| nalgebra::Vector4::new(v[0], v[1], v[2], v[3]);
    let dual = |v: &[f64; 8]| nalgebra::Vector4::new(v[4], v[5], v[6], v[7]);
    let (u1, v1, u2, v2) = (real(v7), dual(v7), real(v8), dual(v8));
    let (a, b, c) = (u1.dot(&v1), u1.dot(&v2) + u2.dot(&v1), u2.dot(&v2));
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    let norm = |s: f64| s * s * u1.dot(&u1) + 2.0 * s * u1.dot(&u2) + u2.dot(&u2);
    // The stable pair of roots: the smaller by the product of both.
    let q = -0.5 * (b + root.copysign(b));
    let (first, second) = if q.abs() < f64::MIN_POSITIVE { (0.0, 0.0) } else { (q / a, c / q) };
    let candidates = [first, second].into_iter().filter(|s| s.is_finite() && norm(*s) > 0.0);
    let s = candidates.max_by(|x, y| norm(*x).total_cmp(&norm(*y)))?;
    let l2 = norm(s).sqrt().recip();
    let (real, dual) = ((u1 * s + u2) * l2, (v1 * s + v2) * l2);
    let quaternion = |v: &nalgebra::Vector4<f64>| nalgebra::Quaternion::new(v[0], v[1], v[2], v[3]);
    let translation = (quaternion(&dual) * quaternion(&real).conjugate()).vector() * 2.0;
    let rotation = UnitQuaternion::from_quaternion(quaternion(&real));
    Some(Isometry3::from_parts(Translation3::from(translation.into_owned()), rotation))
}

/// Axis that the plate turns about, from poses of the board in the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScrewAxis {
    /// Direction about which a growing reported angle turns the plate to the left.
    pub direction: Unit<Vector3<f64>>,
    /// Point on the axis nearest to the nominal origin.
    pub point_mm: Vector3<f64>,
    /// Mean ratio of the turn measured about the axis to the one reported, by size.
    pub ratio: f64,
}

/// Mean of the screw axes, weighted by sin²(θ/2): the error of a screw's axis goes with the inverse of sin(θ/2).
#[must_use]
pub fn screw_axis(base_from_board: &[Isometry3<f64>], table_rad: &[f64], near_mm: &Vector3<f64>) -> Option<ScrewAxis> {
    let (mut sum, mut normal, mut right) = (Vector3::zeros(), Matrix3::zeros(), Vector3::zeros());
    let (mut measured, mut reported) = (0.0, 0.0);
    for i in 0..base_from_board.len() {
        for j in 0..i {
            let asked = (table_rad[i] - table_rad[j]).rem_euclid(std::f64::consts::TAU);
            let asked = if asked > std::f64::consts::PI { asked - std::f64::consts::TAU } else { asked };
            let motion = base_from_board[i] * base_from_board[j].inverse();
            let turn = motion.rotation.scaled_axis();
            if turn.norm() < MIN_SCREW_RAD || asked.abs() < MIN_SCREW_RAD {
                continue;
            }
            let weight = (0.5 * turn.norm()).sin().powi(2);
            // Near half a turn both senses are as likely: such a pair tells the line, not its sense.
            let sense = if turn.norm() < 3.0 { asked.signum() } else { 0.0 };
            sum += turn.normalize() * (weight * sense);
            (measured, reported) = (measured + weight * turn.norm(), reported + weight * asked.abs());
            let rows = Matrix3::identity() - motion.rotation.to_rotation_matrix().into_inner();
            normal += rows.transpose() * rows;
            right += rows.transpose() * (motion.translation.vector - rows * near_mm);
        }
    }
    let direction = Unit::try_new(sum, 1e-12)?;
    // Along the axis nothing is known: stay where the nominal origin is.
    let along = direction.into_inner() * direction.transpose();
    let point_mm = near_mm + (normal + along * normal.trace().max(1e-12)).lu().solve(&right)?;
    Some(ScrewAxis { direction, point_mm, ratio: measured / reported })
}

/// Nominal table turned and shifted the least so that its +z is the axis. Height along the axis and the zero of its angle stay.
#[must_use]
pub fn table_on_axis(nominal: &Isometry3<f64>, axis: &ScrewAxis) -> Isometry3<f64> {
    let up = nominal.rotation * Vector3::z();
    let turn = UnitQuaternion::rotation_between(&up, &axis.direction).unwrap_or_else(UnitQuaternion::identity);
    let direction = axis.direction.into_inner();
    let off = axis.point_mm - nominal.translation.vector;
    let origin = nominal.translation.vector + off - direction * direction.dot(&off);
    Isometry3::from_parts(Translation3::from(origin), turn * nominal.rotation)
}

/// Start of the scanner on the flange with a board that stands still.
#[must_use]
pub fn start_fixed(sightings: &[Sighting]) -> Option<ChainEstimate> {
    let (frames, seen): (Vec<_>, Vec<_>) = sightings.iter().map(|each| (each.base_from_flange, each.cloud_from_board)).unzip();
    let flange_from_cloud = park_martin(&frames, &seen)?;
    let boards: Vec<_> = frames.iter().zip(&seen).map(|(frame, seen)| frame * flange_from_cloud * seen).collect();
    let (base_from_table, plate_from_board) = (Isometry3::identity(), mean_pose(&boards));
    Some(ChainEstimate { flange_from_cloud, base_from_table, plate_from_board, scale: 1.0 })
}

/// Start of the table with the scanner known. The sign is that of the turns measured about the nominal +z.
#[must_use]
pub fn start_table(
    sightings: &[Sighting],
    flange_from_cloud: &Isometry3<f64>,
    nominal: &Isometry3<f64>,
) -> Option<ChainEstimate> {
    let boards: Vec<_> = sightings.iter().map(|each| each.base_from_flange * flange_from_cloud * each.cloud_from_board).collect();
    let angles: Vec<f64> = sightings.iter().map(|each| each.table_rad).collect();
    let mut axis = screw_axis(&boards, &angles, &nominal.translation.vector)?;
    let scale = if axis.direction.dot(&(nominal.rotation * Vector3::z())) < 0.0 { -1.0 } else { 1.0 };
    axis.direction = Unit::new_unchecked(axis.direction.into_inner() * scale);
    let mut estimate = ChainEstimate {
        flange_from_cloud: *flange_from_cloud,
        base_from_table: table_on_axis(nominal, &axis),
        plate_from_board: Isometry3::identity(),
        scale,
    };
    estimate.plate_from_board = mean_board(&estimate, sightings);
    Some(estimate)
}

/// Mean of the board on the plate that each observation tells.
fn mean_board(at: &ChainEstimate, sightings: &[Sighting]) -> Isometry3<f64> {
    let boards: Vec<_> = sightings
        .iter()
        .map(|each| {
            at.base_from_plate(each.table_rad).inverse() * each.base_from_flange * at.flange_from_cloud * each.cloud_from_board
        })
        .collect();
    mean_pose(&boards)
}

/// Start of both: hand-eye and axis in turn, from the nominal table, for either sign of the table; the one that fits better.
#[must_use]
pub fn start_joint(sightings: &[Sighting], nominal: &Isometry3<f64>) -> Option<ChainEstimate> {
    let seen: Vec<_> = sightings.iter().map(|each| each.cloud_from_board).collect();
    let starts = [1.0, -1.0].into_iter().filter_map(|scale| {
        let identity = Isometry3::identity();
        let mut at = ChainEstimate { flange_from_cloud: identity, base_from_table: *nominal, plate_from_board: identity, scale };
        for _ in 0..3 {
            let frames: Vec<_> =
                sightings.iter().map(|each| at.base_from_plate(each.table_rad).inverse() * each.base_from_flange).collect();
            at.flange_from_cloud = park_martin(&frames, &seen)?;
            // The axis is told by the turns of the table alone; without any the nominal one stays.
            if let Some(next) = start_table(sightings, &at.flange_from_cloud, nominal).filter(|next| next.scale * scale > 0.0) {
                at.base_from_table = next.base_from_table;
            }
        }
        at.plate_from_board = mean_board(&at, sightings);
        let cost: f64 = sightings.iter().map(|each| cost_of(&at, each)).sum();
        Some((cost, at))
    });
    starts.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
}

/// Size of a residual that is robust against single bad ones: turns count by the distance of the board.
fn cost_of(at: &ChainEstimate, sighting: &Sighting) -> f64 {
    let residual = at.residual(sighting);
    let lever_mm = sighting.cloud_from_board.translation.vector.norm().max(1.0);
    (super::se3::rotation_of(&residual) * lever_mm).norm() + super::se3::translation_of(&residual).norm()
}
