//! One optical device as a pinhole with skew and five-parameter distortion, after Bouguet, *Camera Calibration Toolbox
//! for Matlab* (2015), "Description of the calibration parameters"; the distortion is Brown's (1966).
//!
//! Device frame: origin = optical centre, +z = optical axis, +x right and +y down in the image. With x = X/Z, y = Y/Z
//! and r² = x² + y²: x_d = x(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²), y_d alike, u = fx(x_d + α y_d) + cx,
//! v = fy y_d + cy. Inside the image: 0 ≤ u < width, 0 ≤ v < height.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use crate::geometry::{Device, Pose, Scanner};

/// Which of the three devices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceName {
    /// Left camera, at −x of the scanner.
    Left,
    /// Right camera, at +x.
    Right,
    /// Projector.
    Projector,
}

impl DeviceName {
    /// `left`, `right`, `projector`.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Projector => "projector",
        }
    }
}

/// Intrinsic parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Image width, pixels.
    pub width_px: f64,
    /// Image height, pixels.
    pub height_px: f64,
    /// Focal length along u, pixels.
    pub fx: f64,
    /// Focal length along v, pixels.
    pub fy: f64,
    /// Principal point, u, pixels.
    pub cx: f64,
    /// Principal point, v, pixels.
    pub cy: f64,
    /// Bouguet's α.
    pub skew: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

/// One optical device of a scanner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpticalDevice {
    /// Which one.
    pub name: DeviceName,
    /// Where it is.
    pub scanner_from_device: Pose<Scanner, Device>,
    /// Intrinsics.
    pub lens: Lens,
    /// Largest incidence at which it works, radians.
    pub incidence_max_rad: f64,
}

/// Newton steps allowed when distortion is inverted; six reach 1e-15 for lenses of this kind.
const UNDISTORT_STEPS: usize = 30;

impl Lens {
    /// Distorted normalised coordinates, and their derivative with respect to the undistorted ones.
    fn distort(&self, n: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let jacobian = Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (distorted, jacobian)
    }

    /// Pixel of a point in the device frame; `None` behind the device, outside the image, or where the distortion
    /// model folds over (its derivative is not positive definite there, so that a point far outside the field could
    /// land inside the image).
    #[must_use]
    pub fn project(&self, p: &Point3<f64>) -> Option<Vector2<f64>> {
        if p.z <= 0.0 {
            return None;
        }
        let (d, jacobian) = self.distort(Vector2::new(p.x / p.z, p.y / p.z));
        let pixel = Vector2::new(self.fx * (d.x + self.skew * d.y) + self.cx, self.fy * d.y + self.cy);
        let inside = 0.0 <= pixel.x && pixel.x < self.width_px && 0.0 <= pixel.y && pixel.y < self.height_px;
        (inside && jacobian.determinant() > 0.0 && jacobian.trace() > 0.0).then_some(pixel)
    }

    /// Direction (z = 1) in the device frame that is imaged at `pixel`; inverse of [`Lens::project`].
    #[must_use]
    pub fn unproject(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let y_distorted = (pixel.y - self.cy) / self.fy;
        let target = Vector2::new((pixel.x - self.cx) / self.fx - self.skew * y_distorted, y_distorted);
        let mut n = target;
        for _ in 0..UNDISTORT_STEPS {
            let (distorted, jacobian) = self.distort(n);
            let Some(inverse) = jacobian.try_inverse() else { break };
            let step = inverse * (target - distorted);
            n += step;
            if step.norm_squared() < 1e-32 {
                break;
            }
        }
        Vector3::new(n.x, n.y, 1.0)
    }
}
