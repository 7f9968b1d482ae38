//! The thesis's planar construction of the measurement volume (Wang, section 3.1.1.2–3), beside the polytope of
//! [`super::MeasurementVolume`], which planning goes by.
//!
//! In the plane y = 0 of the scanner frame, which holds both cameras' axes in a symmetric rig, six lines bound what the
//! cameras share: l₁ and l₂ the right and the left side of the left camera's field, l₃ and l₄ the left and the right side of
//! the right camera's, l₅ and l₆ the near ends of the left and the right camera's depth of field, across their axes. Four points
//! follow: A₁ = l₁ ∩ l₆, A₂ = l₁ ∩ l₄, A₃ = l₃ ∩ l₅, A₄ = l₃ ∩ l₂; with (xᵢ, yᵢ) the place and the depth of Aᵢ
//!
//! ```text
//! W_opt = ((y₂ − y₁) + (y₄ − y₃)) / 2      L_opt = ((x₁ − x₃) + (x₂ − x₄)) / 2      best plane at y₁ + W_opt / 2
//! ```
//!
//! H_opt is printed as y₁ + W_opt, which counts the half height twice. A rig that is not symmetric has the mean of y₁ and y₃
//! for y₁. The thesis does not say how it has the depth of field of a single camera; a specification has the working depth alone,
//! along z of the scanner. So l₅ and l₆ pass through the near end of that on the scanner's axis, (0, 0, z_near).

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::{OpticalDevice, Scanner};

/// The construction's points and what follows from them, scanner frame, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarConstruction {
    /// A₁ to A₄, each as x and depth z.
    pub corners_mm: [[f64; 2]; 4],
    /// Distance of the near ends of depth of field from the left and the right camera, along its axis.
    pub near_mm: [f64; 2],
    /// L_opt, along x.
    pub width_mm: f64,
    /// Height of the field that all three devices share at the best plane, along y; the thesis does not say how it has it.
    pub height_mm: f64,
    /// W_opt, along z.
    pub depth_mm: f64,
    /// Depth of the best plane.
    pub best_mm: f64,
    /// H_opt as printed.
    pub printed_best_mm: f64,
}

/// The line of points with `normal · point = offset`, as x and z.
#[derive(Clone, Copy)]
struct Line {
    normal: Vector2<f64>,
    offset_mm: f64,
}

impl Line {
    fn through(point: Vector2<f64>, normal: Vector2<f64>) -> Self {
        Self { normal, offset_mm: normal.dot(&point) }
    }

    /// The line through two points.
    fn between(from: Vector2<f64>, to: Vector2<f64>) -> Self {
        let along = to - from;
        Self::through(from, Vector2::new(along.y, -along.x))
    }

    fn intersection(&self, other: &Self) -> Option<Vector2<f64>> {
        let normals = Matrix2::from_rows(&[self.normal.transpose(), other.normal.transpose()]);
        Some(normals.try_inverse()? * Vector2::new(self.offset_mm, other.offset_mm))
    }
}

impl Scanner {
    /// The thesis's planar construction; `None` where its lines leave no depth.
    #[must_use]
    pub fn planar_construction(&self) -> Option<PlanarConstruction> {
        let [left, right] = self.devices.cameras();
        let ([l2, l1], [l3, l4]) = (self.sides_in_plane(left), self.sides_in_plane(right));
        let (l5, l6) = (self.near_in_plane(left), self.near_in_plane(right));
        let [a1, a2] = [l1.intersection(&l6)?, l1.intersection(&l4)?];
        let [a3, a4] = [l3.intersection(&l5)?, l3.intersection(&l2)?];
        let depth_mm = 0.5 * ((a2.y - a1.y) + (a4.y - a3.y));
        let first_mm = 0.5 * (a1.y + a3.y);
        let best_mm = first_mm + 0.5 * depth_mm;
        let near = Point3::new(0.0, 0.0, self.near_mm);
        let is_sound = depth_mm > 0.0 && first_mm > 0.0;
        is_sound.then(|| PlanarConstruction {
            corners_mm: [a1, a2, a3, a4].map(Into::into),
            near_mm: [left, right].map(|camera| camera.scanner_from_device.inverse().point(&near).z),
            width_mm: 0.5 * ((a1.x - a3.x) + (a2.x - a4.x)),
            height_mm: self.common_field_at(best_mm).size_mm()[1],
            depth_mm,
            best_mm,
            printed_best_mm: first_mm + depth_mm,
        })
    }

    /// Left and right side of a camera's field in the plane y = 0.
    fn sides_in_plane(&self, camera: &OpticalDevice) -> [Line; 2] {
        let ends = [self.near_mm, self.far_mm].map(|depth_mm| (camera.field_at(depth_mm).x_mm, depth_mm));
        [0, 1].map(|side| {
            let [from, to] = ends.map(|(x_mm, depth_mm)| Vector2::new(x_mm[side], depth_mm));
            Line::between(from, to)
        })
    }

    /// Near end of a camera's depth of field in the plane y = 0.
    fn near_in_plane(&self, camera: &OpticalDevice) -> Line {
        let axis = camera.scanner_from_device.direction(&Vector3::z());
        Line::through(Vector2::new(0.0, self.near_mm), Vector2::new(axis.x, axis.z))
    }
}
