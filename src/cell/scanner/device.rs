//! One optical device as a pinhole with skew and five-parameter distortion, after Bouguet, *Camera Calibration Toolbox
//! for Matlab* (2015), "Description of the calibration parameters"; the distortion is Brown's (1966).
//!
//! Device frame: origin = optical centre, +z = optical axis, +x right and +y down in the image. With x = X/Z, y = Y/Z
//! and r² = x² + y²: x_d = x(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²), y_d alike, u = fx(x_d + α y_d) + cx,
//! v = fy y_d + cy. Inside the image: 0 ≤ u < width, 0 ≤ v < height; the centre of the first pixel is at (½, ½).

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use crate::cell::closed_list;
use crate::geometry::{Device, Pose, ScannerFrame};

// In the order of `PerDevice`.
closed_list! {
    /// Name of one of the three devices.
    pub enum DeviceName {
        /// Left camera, at −x of the scanner.
        Left = "left",
        /// Right camera, at +x.
        Right = "right",
        /// Projector.
        Projector = "projector",
    }
}

/// Intrinsic parameters, checked: the distortion model is one-to-one wherever the image looks. Made by
/// [`super::ScannerSpec::build`].
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
    /// Square of a radius in undistorted normalised coordinates that holds all the image sees and within which the
    /// distortion is one-to-one; what lies outside it is outside the image, wherever the polynomial throws it.
    pub(super) field_radius_squared: f64,
}

/// One optical device of a scanner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpticalDevice {
    /// Name of the device.
    pub name: DeviceName,
    /// Pose of the device in the scanner frame.
    pub scanner_from_device: Pose<ScannerFrame, Device>,
    /// Intrinsics.
    pub lens: Lens,
    /// Largest incidence at which it works, radians.
    pub incidence_max_rad: f64,
    /// Distance between pixels on the sensor, where known.
    pub pixel_pitch_mm: Option<f64>,
    /// Nearest and farthest distance in focus along the optical axis, from the optical centre; both infinite where the
    /// specification gives none.
    pub in_focus_mm: [f64; 2],
}

/// Newton steps allowed when distortion is inverted; six reach 1e-15 for lenses of this kind.
const UNDISTORT_STEPS: usize = 50;
/// Points looked at on each edge of the image.
const EDGE_SAMPLES: u32 = 64;
/// Radius, in normalised coordinates, at which the search for a fold ends: 78° off the axis.
const FOLD_SEARCH_END: f64 = 5.0;
/// Step of the search for a fold, in normalised coordinates.
const FOLD_SEARCH_STEP: f64 = 0.002;
/// Factor by which the field's radius exceeds the largest one seen on the image's edge, whose samples may miss the maximum.
const FIELD_MARGIN: f64 = 1.01;

impl Lens {
    /// A lens without its field, which images directions that its image does not hold too.
    pub(in crate::cell) fn without_field(size_px: [f64; 2], focal_and_centre: [f64; 4], skew: f64, distortion: [f64; 5]) -> Self {
        let ([width_px, height_px], [fx, fy, cx, cy]) = (size_px, focal_and_centre);
        Self { width_px, height_px, fx, fy, cx, cy, skew, distortion, field_radius_squared: f64::INFINITY }
    }

    /// Returns true if the distortion is one-to-one on the image.
    pub(in crate::cell) fn is_foldless(&self) -> bool {
        self.with_field().is_some()
    }

    /// Undistorted normalised coordinates of a pixel; `None` beyond a fold.
    pub(in crate::cell) fn undistorted(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        self.undistort(self.normalised(pixel))
    }

    /// Derives the field; `None` when the distortion folds over inside it.
    pub(super) fn with_field(mut self) -> Option<Self> {
        let mut radius_squared = 0.0_f64;
        for pixel in self.edges().into_iter().flatten() {
            radius_squared = radius_squared.max(self.undistort(self.normalised(&pixel))?.norm_squared());
        }
        self.field_radius_squared = radius_squared * FIELD_MARGIN * FIELD_MARGIN;
        self.is_one_to_one().then_some(self)
    }

    /// Smallest distance from the principal point, in the image, at which the distortion stops to grow with the radius, and the
    /// distance of the image's farthest corner, px; `None` where it grows up to there. Symbols as for
    /// [`Lens::is_one_to_one`]: h = d(r g)/dr vanishes; decentring, which shifts the radius by less than its own size, aside.
    #[must_use]
    pub fn fold_radius_px(&self) -> Option<[f64; 2]> {
        let [k1, k2, _, _, k3] = self.distortion;
        let focal = (self.fx * self.fy).abs().sqrt();
        let (w, h) = (self.width_px, self.height_px);
        let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|[u, v]| (u - self.cx).hypot(v - self.cy));
        let corner = corners.into_iter().fold(0.0, f64::max);
        let slope = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
        let imaged = |r: f64| focal * r * (1.0 + r * r * (k1 + r * r * (k2 + r * r * k3)));
        let mut r = 0.0;
        while r < FOLD_SEARCH_END && imaged(r) <= corner {
            let next = r + FOLD_SEARCH_STEP;
            if slope(next * next) <= 0.0 {
                // Halved until only rounding is left.
                let (mut low, mut high) = (r, next);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if slope(middle * middle) <= 0.0 { high = middle } else { low = middle }
                }
                return (imaged(low) < corner).then_some([imaged(low), corner]);
            }
            r = next;
        }
        None
    }

    /// Returns true if the distortion is one-to-one on the disk of the field: its Jacobian is symmetric, hence the map is the
    /// gradient of a potential, which is strictly convex where the Jacobian is positive definite. The Jacobian is
    /// g(r²) across and h(r²) along the radius, g = 1 + k1 s + k2 s² + k3 s³, h = 1 + 3 k1 s + 5 k2 s² + 7 k3 s³, plus
    /// the decentring part, of norm ≤ 6 r |(p1, p2)|. Sufficient, not necessary.
    fn is_one_to_one(&self) -> bool {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let decentring = 6.0 * self.field_radius_squared.sqrt() * p1.hypot(p2);
        let lowest = |c: [f64; 3]| lowest_of_cubic(c, self.field_radius_squared);
        lowest([k1, k2, k3]).min(lowest([3.0 * k1, 5.0 * k2, 7.0 * k3])) > decentring
    }

    /// Distorted normalised coordinates.
    fn distort(&self, n: Vector2<f64>) -> Vector2<f64> {
        self.distort_xy(n.x, n.y).into()
    }

    #[inline(always)]
    fn distort_xy(&self, x: f64, y: f64) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y]
    }

    /// Derivative of [`Lens::distort`].
    fn distort_jacobian(&self, n: Vector2<f64>) -> Matrix2<f64> {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        )
    }

    /// Inverse of [`Lens::distort`] on the branch of the principal point: Newton from there, a step halved until it
    /// helps. `None` where it does not converge, which does not happen inside the image of a lens with a field.
    fn undistort(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut n = Vector2::zeros();
        let mut residual = distorted - self.distort(n);
        for _ in 0..UNDISTORT_STEPS {
            let step = self.distort_jacobian(n).try_inverse()? * residual;
            let better = (0..8).find_map(|halvings| {
                let trial = n + step * 0.5_f64.powi(halvings);
                let left = distorted - self.distort(trial);
                (left.norm_squared() < residual.norm_squared()).then_some((trial, left))
            });
            let Some(next) = better else { break };
            (n, residual) = next;
        }
        (residual.norm() <= 1e-13 * (1.0 + distorted.norm())).then_some(n)
    }

    /// Distorted normalised coordinates of a pixel.
    fn normalised(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        let y = (pixel.y - self.cy) / self.fy;
        Vector2::new((pixel.x - self.cx) / self.fx - self.skew * y, y)
    }

    /// Pixels along the image's four edges, corner to corner, in turn: top, right, bottom, left.
    fn edges(&self) -> [Vec<Vector2<f64>>; 4] {
        let (w, h) = (self.width_px, self.height_px);
        let corners = [Vector2::zeros(), Vector2::new(w, 0.0), Vector2::new(w, h), Vector2::new(0.0, h)];
        std::array::from_fn(|edge| {
            let (from, to) = (corners[edge], corners[(edge + 1) % 4]);
            (0..=EDGE_SAMPLES).map(|i| from.lerp(&to, f64::from(i) / f64::from(EDGE_SAMPLES))).collect()
        })
    }

    /// The rays (z = 1) of the image's four edges, device frame, in turn: top, right, bottom, left.
    pub(super) fn edge_rays(&self) -> [Vec<Vector3<f64>>; 4] {
        self.edges().map(|edge| edge.iter().map(|pixel| self.unproject(pixel)).collect())
    }

    /// Pixel of a point in the device frame; `None` behind the device or outside the image. A point so far outside
    /// the field that the distortion polynomial folds it back into the image is outside.
    #[must_use]
    pub fn project(&self, p: &Point3<f64>) -> Option<Vector2<f64>> {
        let (u, v, inside) = self.image(p.x, p.y, p.z);
        inside.then(|| Vector2::new(u, v))
    }

    /// Pixel of a point in the device frame, and whether it is one: [`Lens::project`] without a branch, for kernels.
    #[inline(always)]
    #[must_use]
    pub fn image(&self, x: f64, y: f64, z: f64) -> (f64, f64, bool) {
        let (nx, ny) = (x / z, y / z);
        let [dx, dy] = self.distort_xy(nx, ny);
        let (u, v) = (self.fx * (dx + self.skew * dy) + self.cx, self.fy * dy + self.cy);
        let inside = (0.0 <= u) & (u < self.width_px) & (0.0 <= v) & (v < self.height_px);
        (u, v, inside & (z > 0.0) & (nx * nx + ny * ny <= self.field_radius_squared))
    }

    /// Direction (z = 1) in the device frame that is imaged at `pixel`; inverse of [`Lens::project`] over the image.
    #[must_use]
    pub fn unproject(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let distorted = self.normalised(pixel);
        let n = self.undistort(distorted).unwrap_or(distorted);
        Vector3::new(n.x, n.y, 1.0)
    }

    /// Returns true if the image shows what the undistorted image has at a pixel.
    #[inline(always)]
    #[must_use]
    pub fn shows_undistorted(&self, u: f64, v: f64) -> bool {
        let y = (v - self.cy) / self.fy;
        self.image((u - self.cx) / self.fx - self.skew * y, y, 1.0).2
    }

    /// Left, right, top and bottom of the smallest rectangle in the undistorted image, pixels, that holds everything
    /// the distorted image shows.
    #[must_use]
    pub fn undistorted_bounds_px(&self) -> [f64; 4] {
        let [mut left, mut right, mut top, mut bottom] = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for ray in self.edge_rays().iter().flatten() {
            let (u, v) = (self.fx * (ray.x + self.skew * ray.y) + self.cx, self.fy * ray.y + self.cy);
            (left, right, top, bottom) = (left.min(u), right.max(u), top.min(v), bottom.max(v));
        }
        [left, right, top, bottom]
    }

    /// The smaller of the focal lengths along u and v, pixels.
    #[must_use]
    pub fn focal_px(&self) -> f64 {
        self.fx.abs().min(self.fy.abs())
    }

    /// Full angles of view, along u and v, radians: 2·atan(size / 2f), distortion and principal point aside.
    #[must_use]
    pub fn field_of_view_rad(&self) -> [f64; 2] {
        [2.0 * (self.width_px / (2.0 * self.fx)).atan(), 2.0 * (self.height_px / (2.0 * self.fy)).atan()]
    }
}

/// Lowest value of 1 + c₀ s + c₁ s² + c₂ s³ for 0 ≤ s ≤ `end`.
fn lowest_of_cubic([a, b, c]: [f64; 3], end: f64) -> f64 {
    let value = |s: f64| 1.0 + s * (a + s * (b + s * c));
    let root = (b * b - 3.0 * a * c).max(0.0).sqrt();
    // Both forms of the quadratic's roots: one of them survives when c or b vanishes.
    let stationary = [(-b + root) / (3.0 * c), (-b - root) / (3.0 * c), a / (-b + root), a / (-b - root)];
    let inside = stationary.into_iter().filter(|s| 0.0 < *s && *s < end);
    inside.map(value).fold(value(0.0).min(value(end)), f64::min)
}
