//! Distortion of OpenCV with up to fourteen coefficients, and its nearest lens of five.
//!
//! Model (OpenCV, module `calib3d`, "Detailed Description"): x'' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) +
//! 2 p1 x y + p2 (r² + 2x²) + s1 r² + s2 r⁴, y'' alike with s3, s4; then the tilt of the sensor by τx, τy. Coefficients in the
//! order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 τx τy. The fit is Gauss–Newton over focal lengths, principal point, skew and the five
//! coefficients, on a grid of directions that the image holds.

use nalgebra::{DMatrix, DVector, Matrix3, Point3, Vector2, Vector3};

use super::fault::{LensError, LensFault};
use super::model::{LENS, LensParameters};

/// Largest difference at which five coefficients stand for more, px.
const MAX_ERROR_PX: f64 = 0.1;
/// Directions along each axis of the grid.
const GRID: u32 = 41;
/// Steps of the fit.
const STEPS: usize = 20;

/// The lens of five coefficients nearest to `rich`, and the largest difference of both in the image, px.
pub(super) fn fit(lens: &LensParameters, rich: &[f64]) -> Result<(LensParameters, f64), LensError> {
    let pixel = |n: Vector2<f64>| {
        let d = distort(rich, n);
        Vector2::new(lens.fx * (d.x + lens.skew * d.y) + lens.cx, lens.fy * d.y + lens.cy)
    };
    let directions: Vec<Vector2<f64>> = grid(lens).into_iter().filter_map(|target| undistort(lens, rich, target)).collect();
    let fault = |detail: String| LensError::new(LensFault::TooManyCoefficients, "distortion", detail);
    if directions.len() < (GRID * GRID) as usize {
        return Err(fault(format!("of {} coefficients cannot be inverted over the image", rich.len())));
    }
    let mut found = *lens;
    for _ in 0..STEPS {
        let mut jacobian = DMatrix::zeros(2 * directions.len(), LENS);
        let mut residual = DVector::zeros(2 * directions.len());
        for (index, n) in directions.iter().enumerate() {
            let (at, by) = found.differentiate(&Point3::new(n.x, n.y, 1.0));
            let off = pixel(*n) - at;
            residual.fixed_rows_mut::<2>(2 * index).copy_from(&off);
            jacobian.fixed_view_mut::<2, LENS>(2 * index, 0).copy_from(&by.by_lens);
        }
        let scale: Vec<f64> = (0..LENS).map(|column| jacobian.column(column).norm().max(1e-300)).collect();
        let scaled = DMatrix::from_fn(jacobian.nrows(), LENS, |row, column| jacobian[(row, column)] / scale[column]);
        let Some(step) = scaled.clone().qr().r().try_inverse().map(|r| &r * (r.transpose() * (scaled.transpose() * &residual)))
        else {
            break;
        };
        let mut values = found.values();
        for (index, value) in values.iter_mut().enumerate() {
            *value += step[index] / scale[index];
        }
        found = found.with_values(values);
    }
    let worst_px = directions.iter().map(|n| (pixel(*n) - found.project(&Point3::new(n.x, n.y, 1.0))).norm()).fold(0.0, f64::max);
    if worst_px.is_finite() && worst_px <= MAX_ERROR_PX {
        return Ok((found, worst_px));
    }
    Err(fault(format!(
        "of {} coefficients is met by five to {worst_px:.3} px in the image; allowed is {MAX_ERROR_PX} px: calibrate with five",
        rich.len()
    )))
}

/// Pixels over the image, its edges among them.
fn grid(lens: &LensParameters) -> Vec<Vector2<f64>> {
    let [width, height] = lens.size_px.map(f64::from);
    let at = |index: u32, size: f64| f64::from(index) / f64::from(GRID - 1) * size;
    (0..GRID * GRID).map(|index| Vector2::new(at(index % GRID, width), at(index / GRID, height))).collect()
}

fn distort(rich: &[f64], n: Vector2<f64>) -> Vector2<f64> {
    let k = |index: usize| rich.get(index).copied().unwrap_or(0.0);
    let (x, y) = (n.x, n.y);
    let r2 = n.norm_squared();
    let radial = (1.0 + r2 * (k(0) + r2 * (k(1) + r2 * k(4)))) / (1.0 + r2 * (k(5) + r2 * (k(6) + r2 * k(7))));
    let (p1, p2) = (k(2), k(3));
    let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (k(8) + r2 * k(9));
    let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (k(10) + r2 * k(11));
    let (tau_x, tau_y) = (k(12), k(13));
    if tau_x == 0.0 && tau_y == 0.0 {
        return Vector2::new(xd, yd);
    }
    let ((sx, cx), (sy, cy)) = (tau_x.sin_cos(), tau_y.sin_cos());
    // R(τx, τy) = Ry · Rx as OpenCV writes it.
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, sx, 0.0, -sx, cx);
    let about_y = Matrix3::new(cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy);
    let turn = about_y * about_x;
    let plane = Matrix3::new(turn[(2, 2)], 0.0, -turn[(0, 2)], 0.0, turn[(2, 2)], -turn[(1, 2)], 0.0, 0.0, 1.0);
    let tilted = plane * turn * Vector3::new(xd, yd, 1.0);
    Vector2::new(tilted.x / tilted.z, tilted.y / tilted.z)
}

/// The direction that is imaged at a pixel, by Newton's method with a numerical derivative.
fn undistort(lens: &LensParameters, rich: &[f64], pixel: Vector2<f64>) -> Option<Vector2<f64>> {
    const STEP: f64 = 1e-6;
    let y = (pixel.y - lens.cy) / lens.fy;
    let target = Vector2::new((pixel.x - lens.cx) / lens.fx - lens.skew * y, y);
    let mut n = Vector2::zeros();
    for _ in 0..50 {
        let at = distort(rich, n);
        let by_x = (distort(rich, n + Vector2::new(STEP, 0.0)) - at) / STEP;
        let by_y = (distort(rich, n + Vector2::new(0.0, STEP)) - at) / STEP;
        let step = nalgebra::Matrix2::from_columns(&[by_x, by_y]).try_inverse()? * (target - at);
        n += step * (0.5 / step.norm().max(1e-300)).min(1.0);
        if step.norm() < 1e-13 {
            break;
        }
    }
    ((distort(rich, n) - target).norm() < 1e-9).then_some(n)
}
