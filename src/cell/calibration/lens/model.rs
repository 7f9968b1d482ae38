//! The lens as ten numbers, with derivatives. The model is that of [`Lens`]: Brown's distortion after Bouguet.

use nalgebra::{Matrix2x3, Point3, SMatrix, Vector2, Vector3};

use super::fault::{LensError, LensFault};
use crate::cell::field_ranges;
use crate::cell::scanner::Lens;

/// Number of parameters of a lens.
pub(super) const LENS: usize = 10;
/// Names of the parameters of a lens, in their order.
pub const PARAMETER_NAMES: [&str; LENS] = ["fx", "fy", "cx", "cy", "skew", "k1", "k2", "p1", "p2", "k3"];
/// Widest image, pixels.
const MAX_PX: f64 = 1e5;
/// Narrowest image, pixels.
const MIN_PX: f64 = 16.0;
/// Range of the principal point, in widths or heights of the image.
const CENTRE: [f64; 2] = [-2.0, 3.0];

/// Intrinsic parameters that are not checked yet; pixels count from the outer corner of the first pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensParameters {
    /// Width and height of the image, px.
    pub size_px: [u32; 2],
    /// Focal length along u, px.
    pub fx: f64,
    /// Focal length along v, px.
    pub fy: f64,
    /// Principal point, u, px.
    pub cx: f64,
    /// Principal point, v, px.
    pub cy: f64,
    /// Bouguet's α.
    pub skew: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

/// Derivatives of a pixel by the lens's parameters and by the point, device frame.
pub(super) struct Derivatives {
    pub(super) by_lens: SMatrix<f64, 2, LENS>,
    pub(super) by_point: Matrix2x3<f64>,
}

field_ranges! {
    LensParameters {
        WIDTH_PX = "width_px", [MIN_PX, MAX_PX] "px";
        HEIGHT_PX = "height_px", [MIN_PX, MAX_PX] "px";
        FX = "fx", [1.0, 1e6] "px";
        FY = "fy", [1.0, 1e6] "px";
        // The ranges of the largest image; the check is against the device's own.
        CX = "cx", [CENTRE[0] * MAX_PX, CENTRE[1] * MAX_PX] "px";
        CY = "cy", [CENTRE[0] * MAX_PX, CENTRE[1] * MAX_PX] "px";
        SKEW = "skew", [-0.1, 0.1] "";
        DISTORTION = "distortion", [-10.0, 10.0] "";
    }
}

impl LensParameters {
    /// The parameters, in the order of [`PARAMETER_NAMES`].
    #[must_use]
    pub fn values(&self) -> [f64; LENS] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        [self.fx, self.fy, self.cx, self.cy, self.skew, k1, k2, p1, p2, k3]
    }

    /// The lens with other parameters, in the order of [`PARAMETER_NAMES`].
    #[must_use]
    pub fn with_values(&self, [fx, fy, cx, cy, skew, k1, k2, p1, p2, k3]: [f64; LENS]) -> Self {
        Self { size_px: self.size_px, fx, fy, cx, cy, skew, distortion: [k1, k2, p1, p2, k3] }
    }

    /// The lens, of which it is not known yet whether it is one-to-one.
    pub(super) fn unchecked(&self) -> Lens {
        let [width_px, height_px] = self.size_px.map(f64::from);
        let Self { fx, fy, cx, cy, skew, distortion, .. } = *self;
        Lens::without_field([width_px, height_px], [fx, fy, cx, cy], skew, distortion)
    }

    /// Pixel of a point in front of the device, inside the image or not.
    #[must_use]
    pub fn project(&self, point: &Point3<f64>) -> Vector2<f64> {
        let (u, v, _) = self.unchecked().image(point.x, point.y, point.z);
        Vector2::new(u, v)
    }

    /// Direction (z = 1) that is imaged at a pixel; `None` beyond a fold.
    #[must_use]
    pub fn ray(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        self.unchecked().undistorted(pixel).map(|n| Vector3::new(n.x, n.y, 1.0))
    }

    /// Pixel of a point and its derivatives, by differentiation of the formulas in [`Lens`]'s module.
    pub(super) fn differentiate(&self, point: &Point3<f64>) -> (Vector2<f64>, Derivatives) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let inverse = 1.0 / point.z;
        let (x, y) = (point.x * inverse, point.y * inverse);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let xx = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x;
        // Rows u and v from rows x_d and y_d.
        let (fx, fy, skew) = (self.fx, self.fy, self.skew);
        let u = |dx: f64, dy: f64| fx * (dx + skew * dy);
        let by_k = [r2, r2 * r2, r2 * r2 * r2];
        let [c1, c2, c3] = by_k.map(|factor| [x * factor, y * factor]);
        let c4 = [2.0 * x * y, r2 + 2.0 * y * y];
        let c5 = [r2 + 2.0 * x * x, 2.0 * x * y];
        let mut by_lens = SMatrix::<f64, 2, LENS>::zeros();
        by_lens[(0, 0)] = xd + skew * yd;
        by_lens[(1, 1)] = yd;
        by_lens[(0, 2)] = 1.0;
        by_lens[(1, 3)] = 1.0;
        by_lens[(0, 4)] = fx * yd;
        for (column, [dx, dy]) in [c1, c2, c4, c5, c3].into_iter().enumerate() {
            by_lens[(0, 5 + column)] = u(dx, dy);
            by_lens[(1, 5 + column)] = fy * dy;
        }
        let across = |along: f64, [dx, dy]: [f64; 2]| [along * u(dx, dy), along * fy * dy];
        let (by_x, by_y) = (across(inverse, [xx, cross]), across(inverse, [cross, yy]));
        let by_z = [0, 1].map(|row| -(x * by_x[row] + y * by_y[row]));
        let by_point = Matrix2x3::new(by_x[0], by_y[0], by_z[0], by_x[1], by_y[1], by_z[1]);
        (Vector2::new(fx * (xd + skew * yd) + self.cx, fy * yd + self.cy), Derivatives { by_lens, by_point })
    }

    /// Requires numbers that can be those of a lens, and a distortion that does not fold inside the image.
    ///
    /// # Errors
    /// [`LensFault::OutOfRange`], [`LensFault::Folds`].
    pub fn check(&self, pointer: &str) -> Result<(), LensError> {
        let out = |name: &str, value: f64, low: f64, high: f64| {
            let detail = format!("is {value}; allowed is {low} to {high}");
            LensError::new(LensFault::OutOfRange, format!("{pointer}/{name}"), detail)
        };
        let [width, height] = self.size_px.map(f64::from);
        let ranges = [
            ("width_px", width, Self::WIDTH_PX.range),
            ("height_px", height, Self::HEIGHT_PX.range),
            ("fx", self.fx, Self::FX.range),
            ("fy", self.fy, Self::FY.range),
            ("cx", self.cx, CENTRE.map(|share| share * width)),
            ("cy", self.cy, CENTRE.map(|share| share * height)),
            ("skew", self.skew, Self::SKEW.range),
        ];
        for (name, value, [low, high]) in ranges {
            if !(low..=high).contains(&value) {
                return Err(out(name, value, low, high));
            }
        }
        let [low, high] = Self::DISTORTION.range;
        for (index, k) in self.distortion.iter().enumerate() {
            if !(low..=high).contains(k) {
                return Err(out(&format!("distortion/{index}"), *k, low, high));
            }
        }
        let lens = self.unchecked();
        if lens.is_foldless() {
            return Ok(());
        }
        let radius = lens.fold_radius_px().map_or_else(
            || "inside its own image".to_owned(),
            |[fold, corner]| {
                format!("inside its own image, at {fold:.0} px from the principal point; the corner is at {corner:.0} px")
            },
        );
        let detail = format!(
            "the distortion {:?} folds {radius}: points beyond would be imaged twice. Calibrate with boards that reach the corners, \
             or with fewer coefficients",
            self.distortion
        );
        Err(LensError::new(LensFault::Folds, format!("{pointer}/distortion"), detail))
    }
}
