//! Start values in closed form: homographies, the camera matrix from them, and poses of the board.
//!
//! Sources: Z. Zhang, *A Flexible New Technique for Camera Calibration*, IEEE TPAMI 22 (2000), section 3.1 and appendix A
//! (homography by the direct linear transformation on normalised points, R. Hartley, *In Defense of the Eight-Point Algorithm*,
//! 1997). Where views are too few or too parallel for five unknowns, the principal point is taken as the middle of the image and
//! only the focal lengths are solved for.

use nalgebra::{
    Isometry3, Matrix2, Matrix3, Point3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
};

use super::model::LensParameters;
use super::observations::DeviceSighting;
use crate::geometry::ascending;

/// Fewest points of a view from which a homography is taken.
pub(super) const MIN_POINTS: usize = 4;

/// Plane of the board: homographies need points on it.
fn is_plane(seen: &[DeviceSighting]) -> bool {
    seen.iter().all(|sighting| sighting.board_mm.z.abs() < 1e-9)
}

/// The homography that takes (X, Y, 1) of the board to pixels; `None` for too few points or points on a line.
pub(super) fn homography(seen: &[DeviceSighting]) -> Option<Matrix3<f64>> {
    if seen.len() < MIN_POINTS || !is_plane(seen) {
        return None;
    }
    let board: Vec<Vector2<f64>> = seen.iter().map(|sighting| sighting.board_mm.coords.xy()).collect();
    let pixels: Vec<Vector2<f64>> = seen.iter().map(|sighting| sighting.pixel).collect();
    let (from, to) = (normaliser(&board)?, normaliser(&pixels)?);
    let mut sum = SMatrix::<f64, 9, 9>::zeros();
    for (board, pixel) in board.iter().zip(&pixels) {
        let (a, b) = (from * board.push(1.0), to * pixel.push(1.0));
        let row = |signs: [f64; 3]| SVector::<f64, 9>::from_fn(|index, _| a[index % 3] * signs[index / 3]);
        let (first, second) = (row([1.0, 0.0, -b.x]), row([0.0, 1.0, -b.y]));
        sum += first * first.transpose() + second * second.transpose();
    }
    let (smallest, next) = smallest_vector(&sum)?;
    // A second solution: all points on a line.
    if next < 1e-9 * sum.trace() {
        return None;
    }
    let normalised = Matrix3::from_row_slice(smallest.as_slice());
    let found = to.try_inverse()? * normalised * from;
    let scale = found[(2, 2)];
    (scale.abs() > 1e-300 && found.iter().all(|value| value.is_finite())).then(|| found / scale)
}

/// Root mean square distance of pixels from where a homography takes their points, px.
pub(super) fn transfer_rms_px(seen: &[DeviceSighting], homography: &Matrix3<f64>) -> f64 {
    let square = |sighting: &DeviceSighting| {
        let image = homography * sighting.board_mm.coords.xy().push(1.0);
        (image.xy() / image.z - sighting.pixel).norm_squared()
    };
    (seen.iter().map(square).sum::<f64>() / seen.len().max(1) as f64).sqrt()
}

/// The similarity that moves points to their mean, at a mean distance of √2.
fn normaliser(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let count = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / count;
    let distance = points.iter().map(|point| (point - mean).norm()).sum::<f64>() / count;
    let scale = 2.0_f64.sqrt() / distance;
    let matrix = Matrix3::new(scale, 0.0, -scale * mean.x, 0.0, scale, -scale * mean.y, 0.0, 0.0, 1.0);
    scale.is_finite().then_some(matrix)
}

/// The eigenvector of the smallest eigenvalue, and the next eigenvalue.
pub(super) fn smallest_vector<const N: usize>(sum: &SMatrix<f64, N, N>) -> Option<(SVector<f64, N>, f64)> {
    if sum.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let dynamic = nalgebra::DMatrix::from_fn(N, N, |row, column| sum[(row, column)]);
    let eigen = dynamic.symmetric_eigen();
    let order = ascending(eigen.eigenvalues.as_slice());
    let vector = SVector::from_fn(|row, _| eigen.eigenvectors[(row, order[0])]);
    Some((vector, eigen.eigenvalues[order[1]]))
}

/// The lens, without distortion, that explains homographies of several views.
pub(super) fn camera_matrix(homographies: &[Matrix3<f64>], size_px: [u32; 2]) -> Option<LensParameters> {
    let [width, height] = size_px.map(f64::from);
    // Pixels about the middle of the image, in halves of its width: numbers near 1.
    let scale = 2.0 / width;
    let centred = Matrix3::new(scale, 0.0, -scale * 0.5 * width, 0.0, scale, -scale * 0.5 * height, 0.0, 0.0, 1.0);
    let centred: Vec<Matrix3<f64>> = homographies.iter().map(|h| centred * h).map(|h| h / h.norm()).collect();
    let [fx, fy, x, y] = closed_form(&centred)
        .filter(|[fx, fy, x, y]| is_plausible(*fx) && is_plausible(*fy) && x.abs() < 1.0 && y.abs() < height / width)
        .or_else(|| with_middle(&centred))?;
    Some(LensParameters {
        size_px,
        fx: fx / scale,
        fy: fy / scale,
        cx: x / scale + 0.5 * width,
        cy: y / scale + 0.5 * height,
        skew: 0.0,
        distortion: [0.0; 5],
    })
}

/// Focal length in halves of the image's width: views from 6° to 150°.
fn is_plausible(focal: f64) -> bool {
    (0.25..20.0).contains(&focal)
}

/// Zhang's v_ij.
fn constraint(h: &Matrix3<f64>, i: usize, j: usize) -> SVector<f64, 6> {
    let at = |row: usize, column: usize| h[(row, column)];
    SVector::<f64, 6>::from([
        at(0, i) * at(0, j),
        at(0, i) * at(1, j) + at(1, i) * at(0, j),
        at(1, i) * at(1, j),
        at(2, i) * at(0, j) + at(0, i) * at(2, j),
        at(2, i) * at(1, j) + at(1, i) * at(2, j),
        at(2, i) * at(2, j),
    ])
}

/// Zhang's closed form: focal lengths and principal point; `None` if the views leave it open.
fn closed_form(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    if homographies.len() < 3 {
        return None;
    }
    let mut sum = SMatrix::<f64, 6, 6>::zeros();
    for h in homographies {
        let (across, difference) = (constraint(h, 0, 1), constraint(h, 0, 0) - constraint(h, 1, 1));
        sum += across * across.transpose() + difference * difference.transpose();
    }
    let (b, _) = smallest_vector(&sum)?;
    let [b11, b12, b22, b13, b23, b33] = b.into();
    let minor = b11 * b22 - b12 * b12;
    let v0 = (b12 * b13 - b11 * b23) / minor;
    let lambda = b33 - (b13 * b13 + v0 * (b12 * b13 - b11 * b23)) / b11;
    let (fx, fy) = ((lambda / b11).sqrt(), (lambda * b11 / minor).sqrt());
    let skew = -b12 * fx * fx * fy / lambda;
    let u0 = skew * v0 / fy - b13 * fx * fx / lambda;
    [fx, fy, u0, v0].iter().all(|value| value.is_finite()).then_some([fx, fy, u0, v0])
}

/// Focal lengths with the principal point in the middle: h₁ᵀ ω h₂ = 0 and h₁ᵀ ω h₁ = h₂ᵀ ω h₂ with ω = diag(1/fx², 1/fy², 1).
fn with_middle(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    let (mut sum, mut side) = (Matrix2::zeros(), Vector2::zeros());
    for h in homographies {
        let across = constraint(h, 0, 1);
        let difference = constraint(h, 0, 0) - constraint(h, 1, 1);
        for row in [across, difference] {
            let unknown = Vector2::new(row[0], row[2]);
            sum += unknown * unknown.transpose();
            side -= unknown * row[5];
        }
    }
    let solved = sum.try_inverse().map(|inverse| inverse * side).map(|w| [w.x, w.y].map(|w| (1.0 / w).sqrt()));
    match solved {
        Some([fx, fy]) if is_plausible(fx) && is_plausible(fy) => Some([fx, fy, 0.0, 0.0]),
        // Boards square to the axis: any focal length will do as a start.
        _ => Some([3.0, 3.0, 0.0, 0.0]),
    }
}

/// Pose of the board of a homography under a lens without distortion.
pub(super) fn board_pose(lens: &LensParameters, homography: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let matrix = Matrix3::new(lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0);
    let columns = matrix.try_inverse()? * homography;
    let scale = 2.0 / (columns.column(0).norm() + columns.column(1).norm());
    // The board is in front of the camera.
    let scale = if columns[(2, 2)] < 0.0 { -scale } else { scale };
    let [x, y, translation] = [0, 1, 2].map(|column| -> Vector3<f64> { columns.column(column) * scale });
    let svd = Matrix3::from_columns(&[x, y, x.cross(&y)]).svd(true, true);
    let turn = svd.u? * svd.v_t?;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
    let pose = Isometry3::from_parts(Translation3::from(translation), rotation);
    let is_finite = pose.translation.vector.iter().all(|value| value.is_finite()) && turn.iter().all(|value| value.is_finite());
    (is_finite && turn.determinant() > 0.0).then_some(pose)
}

/// Mean of poses: rotation by the largest eigenvector of Σ q qᵀ (Markley et al., 2007), translation by the median of each
/// coordinate.
pub(super) fn mean_pose(poses: &[Isometry3<f64>]) -> Option<Isometry3<f64>> {
    let mut sum = SMatrix::<f64, 4, 4>::zeros();
    for pose in poses {
        let q = pose.rotation.coords;
        sum -= q * q.transpose();
    }
    let (q, _) = smallest_vector(&sum)?;
    let rotation = UnitQuaternion::from_quaternion(nalgebra::Quaternion::from(q));
    let median = |axis: usize| {
        let mut values: Vec<f64> = poses.iter().map(|pose| pose.translation.vector[axis]).collect();
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        if values.len() % 2 == 1 { values[middle] } else { 0.5 * (values[middle - 1] + values[middle]) }
    };
    (!poses.is_empty()).then(|| Isometry3::from_parts(Translation3::new(median(0), median(1), median(2)), rotation))
}

/// Points of a view in a frame.
pub(super) fn placed(seen: &[DeviceSighting], pose: &Isometry3<f64>) -> Vec<(Point3<f64>, Vector2<f64>)> {
    seen.iter().map(|sighting| (pose * sighting.board_mm, sighting.pixel)).collect()
}
