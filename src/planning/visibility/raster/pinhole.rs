//! The undistorted image of one device: the pinhole model without the lens's distortion, with which straight edges stay
//! straight. Coordinates are pixels, shifted so that pixel centres are integers: x = u − ½, y = v − ½. Inverse depth is the
//! reciprocal of the depth along the device's axis, 1/mm, which is linear over the image of a plane.

use nalgebra::{Isometry3, Matrix3x4, Point3, Vector3};

use crate::cell::Lens;

/// Vertices and samples are projected in lanes of this many.
pub(super) const LANES: usize = 16;
/// One value a lane.
pub(super) type PixelLanes = [f32; LANES];

/// Maps points of the part frame, relative to the scene's centre, to the undistorted image.
#[derive(Clone, Copy)]
pub(super) struct Pinhole {
    /// Rows: x · depth, y · depth, depth.
    exact: Matrix3x4<f64>,
    rounded: [[f32; 4]; 3],
    /// Optical centre, relative to the scene's centre, mm.
    pub(super) centre_mm: Vector3<f64>,
    /// Pixels a radian at the optical axis; the larger of both directions.
    pub(super) focal_px: f32,
    /// Factors of a unit normal n of the part frame that give the change of inverse depth along x and y over
    /// the image of a plane, times the distance of the optical centre from the plane: with w = 1/z and the pinhole's
    /// x_n = (u − cx)/fx − α y_n, y_n = (v − cy)/fy, w = n·(x_n, y_n, 1) / (n·q) for any point q of the plane.
    slopes: [[f32; 3]; 2],
}

impl Pinhole {
    pub(super) fn new(lens: &Lens, device_from_part: &Isometry3<f64>, scene_centre_mm: &Point3<f64>) -> Self {
        let rotation = device_from_part.rotation.to_rotation_matrix();
        let offset = (device_from_part * scene_centre_mm).coords;
        let row = |axis: usize| {
            let r = rotation.matrix().row(axis);
            [r[0], r[1], r[2], offset[axis]]
        };
        let [right, down, depth] = [row(0), row(1), row(2)];
        let mut exact = Matrix3x4::zeros();
        for column in 0..4 {
            let (x, y, z) = (right[column], down[column], depth[column]);
            exact[(0, column)] = lens.fx * (x + lens.skew * y) + (lens.cx - 0.5) * z;
            exact[(1, column)] = lens.fy * y + (lens.cy - 0.5) * z;
            exact[(2, column)] = z;
        }
        let rounded = std::array::from_fn(|r| std::array::from_fn(|c| exact[(r, c)] as f32));
        let centre_mm = device_from_part.inverse().translation.vector - scene_centre_mm.coords;
        let along_x = |column: usize| (right[column] / lens.fx) as f32;
        let along_y = |column: usize| ((down[column] - lens.skew * right[column]) / lens.fy) as f32;
        let slopes = [std::array::from_fn(along_x), std::array::from_fn(along_y)];
        Self { exact, rounded, centre_mm, focal_px: lens.fx.max(lens.fy) as f32, slopes }
    }

    /// Slopes of inverse depth a pixel along x and along y over the image of a plane with unit normal `n`, which
    /// the optical centre is `above_mm` in front of.
    #[inline(always)]
    pub(super) fn slope(&self, n: [f32; 3], above_mm: f32) -> [f32; 2] {
        let [x, y] = &self.slopes;
        let scale = -1.0 / above_mm;
        [(x[0] * n[0] + x[1] * n[1] + x[2] * n[2]) * scale, (y[0] * n[0] + y[1] * n[1] + y[2] * n[2]) * scale]
    }

    /// Homogeneous image coordinates (x · depth, y · depth, depth) of one point.
    #[inline(always)]
    pub(super) fn homogeneous(&self, x: f32, y: f32, z: f32) -> [f32; 3] {
        let [a, b, c] = &self.rounded;
        [a[0] * x + a[1] * y + a[2] * z + a[3], b[0] * x + b[1] * y + b[2] * z + b[3], c[0] * x + c[1] * y + c[2] * z + c[3]]
    }

    /// [`Pinhole::homogeneous`] in full precision.
    pub(super) fn homogeneous_exact(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.exact * p.push(1.0)
    }

    /// Image coordinates and inverse depth of a lane of points in front of the device.
    #[inline(always)]
    pub(super) fn project(&self, points: [&PixelLanes; 3]) -> [PixelLanes; 3] {
        let mut image = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            let [x, y, depth] = self.homogeneous(points[0][lane], points[1][lane], points[2][lane]);
            let inverse_depth = 1.0 / depth;
            image[0][lane] = x * inverse_depth;
            image[1][lane] = y * inverse_depth;
            image[2][lane] = inverse_depth;
        }
        image
    }
}
