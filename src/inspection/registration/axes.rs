//! Axes about which a part may look the same: those about which its surface slides best along itself (N. Gelfand, L. J. Guibas, "Shape
//! segmentation using local slippage analysis", SGP 2004, section 3), the principal ones of its area, and those of its box.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use super::locate::samples;
use super::ppf::Oriented;
use crate::cell::calibration::se3::{Twist, twist};
use crate::geometry::Mesh;

/// Samples of the mesh that axes are found from.
const AXIS_SAMPLES: usize = 2000;
/// Rounds of the search for the axis about which the surface slides best, and c of its weights: the share of a motion that a sample moves
/// along its normal. Not from a source: a key's walls move by nearly all of it, a wall that is round but for its facets by less.
const SLIP_ROUNDS: usize = 10;
const SLIP: f64 = 0.1;

/// Line about which a part is turned, frame of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct TurnAxis {
    pub(super) through_mm: Point3<f64>,
    pub(super) along: Vector3<f64>,
}

impl TurnAxis {
    pub(super) fn turn(&self, angle_rad: f64) -> Isometry3<f64> {
        let centre = Translation3::from(self.through_mm.coords);
        let rotation = UnitQuaternion::from_scaled_axis(self.along * angle_rad);
        centre * Isometry3::from_parts(Translation3::identity(), rotation) * centre.inverse()
    }

    /// Motion of a turn, to first order: the rotation, and by how much it shifts a point.
    pub(super) fn twist(&self, angle_rad: f64, point_mm: &Point3<f64>) -> Twist {
        twist(&self.along, &self.along.cross(&(point_mm - self.through_mm))) * angle_rad
    }

    /// Distance of a point from the line, mm.
    pub(super) fn distance_mm(&self, point_mm: &Point3<f64>) -> f64 {
        (point_mm - self.through_mm).cross(&self.along).norm()
    }

    /// Angle of a rotation's turn about the line, −π to π: what is left without it turns about lines across.
    pub(super) fn turn_of(&self, rotation: &UnitQuaternion<f64>) -> f64 {
        let (along, scalar) = (rotation.imag().dot(&self.along), rotation.scalar());
        2.0 * if scalar < 0.0 { (-along).atan2(-scalar) } else { along.atan2(scalar) }
    }

    /// Returns true if another line is the same within a degree and a two hundredth of the diameter.
    fn is_near(&self, other: &Self, diameter_mm: f64) -> bool {
        let between = self.through_mm - other.through_mm;
        let off_mm = (between - self.along * between.dot(&self.along)).norm();
        self.along.dot(&other.along).abs() > 0.9998 && off_mm < 0.005 * diameter_mm
    }
}

/// Axes about which the part may look the same.
pub(super) fn axes(mesh: &Mesh, diameter_mm: f64) -> Vec<TurnAxis> {
    let samples = samples(mesh, AXIS_SAMPLES);
    let count = samples.len().max(1) as f64;
    let centre = Point3::from(samples.iter().map(|sample| sample.point_mm.coords).sum::<Vector3<f64>>() / count);
    let mut spread = Matrix3::<f64>::zeros();
    for sample in &samples {
        let at = sample.point_mm - centre;
        spread += at * at.transpose() / count;
    }
    let principal = spread.symmetric_eigen().eigenvectors;
    // Those of the box are exact where others, which are found from samples, are not.
    let through_mm = mesh.aabb().centre();
    let mut found: Vec<TurnAxis> = (0..3).map(|axis| TurnAxis { through_mm, along: Vector3::ith(axis, 1.0) }).collect();
    found.extend(slippage(&samples, &centre, spread.trace().sqrt()));
    found.extend((0..3).map(|axis| TurnAxis { through_mm: centre, along: principal.column(axis).into_owned() }));
    let mut axes: Vec<TurnAxis> = Vec::with_capacity(found.len());
    for axis in found {
        if axes.iter().all(|other| !other.is_near(&axis, diameter_mm)) {
            axes.push(axis);
        }
    }
    axes
}

/// TurnAxis of the motion that moves samples least along their normals; `None` where that is a shift. What breaks a symmetry would draw the
/// axis to itself: samples that move are weighted down after Geman and McClure ("Statistical methods for tomographic image reconstruction",
/// Bulletin of the International Statistical Institute 52(4), 1987), w = 1/(1 + (r/c)²)².
fn slippage(samples: &[Oriented], centre: &Point3<f64>, arm_mm: f64) -> Option<TurnAxis> {
    let arm_mm = arm_mm.max(f64::MIN_POSITIVE);
    let row = |sample: &Oriented| {
        let turn = (sample.point_mm - centre).cross(&sample.normal) / arm_mm;
        Vector6::new(turn.x, turn.y, turn.z, sample.normal.x, sample.normal.y, sample.normal.z)
    };
    let rows: Vec<Vector6<f64>> = samples.iter().map(row).collect();
    let mut motion = Vector6::<f64>::zeros();
    for round in 0..SLIP_ROUNDS {
        let mut sum = Matrix6::<f64>::zeros();
        for row in &rows {
            let moved = if round == 0 { 0.0 } else { row.dot(&motion) / SLIP };
            sum += row * row.transpose() * (1.0 + moved * moved).powi(-2);
        }
        let eigen = sum.symmetric_eigen();
        motion = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    }
    let turn: Vector3<f64> = motion.fixed_rows::<3>(0) / arm_mm;
    let shift: Vector3<f64> = motion.fixed_rows::<3>(3).into_owned();
    let offset_mm: Vector3<f64> = turn.cross(&shift) / turn.norm_squared().max(f64::MIN_POSITIVE);
    // A turn about a line far off the part is a shift.
    let is_turn = offset_mm.norm() <= arm_mm;
    let along = turn.try_normalize(0.0).filter(|_| is_turn)?;
    Some(TurnAxis { through_mm: centre + offset_mm, along })
}
