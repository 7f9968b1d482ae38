//! Runout of a turntable: the error motion of its plate beside a turn about a fixed axis, as harmonics of the angle (ISO 230-7:2015,
//! 3.2: radial, axial and tilt error motion). The plate is where table_from_plate(φ) = E(φ) · Rz(φ) puts it, with
//!
//! E(φ) = exp Σ_k [c_k (cos kφ − 1) + s_k sin kφ],  twists about x, y and along x, y, z of the table frame.
//!
//! At angle zero plate and table coincide, as without runout; without harmonics E is the identity.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::calibration::se3::{exp, twist};
use super::field_error::Findings;
use super::field_ranges;

/// Harmonics that a specification may have.
const MAX_HARMONICS: usize = 8;
/// Highest order.
const MAX_ORDER: f64 = 36.0;
/// Largest amplitudes: a table beyond them wants repair, not a correction.
const MAX_MM: f64 = 2.0;
const MAX_DEG: f64 = 0.5;
/// Lever at which a tilt counts as a displacement: the height of a part above the plate, mm.
const LEVER_MM: f64 = 1000.0;

/// One harmonic of a table's runout, in the table frame. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct RunoutSpec {
    /// Periods a turn, 1 to 36.
    pub order: u8,
    /// Shift along x, y and z with cos(order · angle), mm, -2 to 2 each.
    #[schema(min_items = 3, max_items = 3)]
    pub shift_cos_mm: [f64; 3],
    /// Shift along x, y and z with sin(order · angle), mm, -2 to 2 each.
    #[schema(min_items = 3, max_items = 3)]
    pub shift_sin_mm: [f64; 3],
    /// Tilt about x and y with cos(order · angle), degrees, -0.5 to 0.5 each. Default 0.
    #[serde(default)]
    #[schema(min_items = 2, max_items = 2)]
    pub tilt_cos_deg: [f64; 2],
    /// Tilt about x and y with sin(order · angle), degrees, -0.5 to 0.5 each. Default 0.
    #[serde(default)]
    #[schema(min_items = 2, max_items = 2)]
    pub tilt_sin_deg: [f64; 2],
}

/// Error motion with one phase of a harmonic: tilts about x and y, rad, and shifts along x, y and z, mm.
pub type ErrorMotion = [f64; 5];

/// One harmonic of a table's runout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunoutHarmonic {
    /// Periods a turn.
    pub order: u8,
    /// Error motion with the cosine.
    pub cos: ErrorMotion,
    /// Error motion with the sine.
    pub sin: ErrorMotion,
}

field_ranges! {
    RunoutSpec {
        ORDER = "order", [1.0, MAX_ORDER] "";
        SHIFT_COS_MM = "shift_cos_mm", [-MAX_MM, MAX_MM] "mm";
        SHIFT_SIN_MM = "shift_sin_mm", [-MAX_MM, MAX_MM] "mm";
        TILT_COS_DEG = "tilt_cos_deg", [-MAX_DEG, MAX_DEG] "°";
        TILT_SIN_DEG = "tilt_sin_deg", [-MAX_DEG, MAX_DEG] "°";
    }
}

impl RunoutSpec {
    /// Records what is out of range, below `pointer`.
    pub(super) fn check_all(specs: &[Self], pointer: &str, findings: &mut Findings) {
        findings.require(specs.len() <= MAX_HARMONICS, pointer, || {
            format!("has {} harmonics; allowed are {MAX_HARMONICS}", specs.len())
        });
        for (index, spec) in specs.iter().enumerate() {
            let at = format!("{pointer}/{index}");
            Self::ORDER.check(&at, &spec.order, findings);
            let is_first = specs[..index].iter().all(|before| before.order != spec.order);
            findings.require(is_first, format!("{at}/order"), || format!("is {} a second time", spec.order));
            Self::SHIFT_COS_MM.check(&at, &spec.shift_cos_mm, findings);
            Self::SHIFT_SIN_MM.check(&at, &spec.shift_sin_mm, findings);
            Self::TILT_COS_DEG.check(&at, &spec.tilt_cos_deg, findings);
            Self::TILT_SIN_DEG.check(&at, &spec.tilt_sin_deg, findings);
        }
    }

    pub(super) fn build(&self) -> RunoutHarmonic {
        let motion = |[about_x, about_y]: [f64; 2], [x, y, z]: [f64; 3]| [about_x.to_radians(), about_y.to_radians(), x, y, z];
        RunoutHarmonic {
            order: self.order,
            cos: motion(self.tilt_cos_deg, self.shift_cos_mm),
            sin: motion(self.tilt_sin_deg, self.shift_sin_mm),
        }
    }
}

impl From<&RunoutHarmonic> for RunoutSpec {
    fn from(harmonic: &RunoutHarmonic) -> Self {
        let shift = |[_, _, x, y, z]: ErrorMotion| [x, y, z];
        let tilt = |[about_x, about_y, ..]: ErrorMotion| [about_x.to_degrees(), about_y.to_degrees()];
        Self {
            order: harmonic.order,
            shift_cos_mm: shift(harmonic.cos),
            shift_sin_mm: shift(harmonic.sin),
            tilt_cos_deg: tilt(harmonic.cos),
            tilt_sin_deg: tilt(harmonic.sin),
        }
    }
}

impl RunoutHarmonic {
    /// Error motion of this harmonic at an angle.
    fn at(&self, angle_rad: f64) -> ErrorMotion {
        let (sin, cos) = (f64::from(self.order) * angle_rad).sin_cos();
        std::array::from_fn(|axis| self.cos[axis] * (cos - 1.0) + self.sin[axis] * sin)
    }

    /// Amplitudes: across the axis and along it, mm, and of the tilt, rad.
    #[must_use]
    pub fn amplitudes(&self) -> (f64, f64, f64) {
        let of = |axes: &[usize]| axes.iter().map(|axis| self.cos[*axis].powi(2) + self.sin[*axis].powi(2)).sum::<f64>().sqrt();
        (of(&[2, 3]), of(&[4]), of(&[0, 1]))
    }
}

/// Error motion E of the plate at an angle.
#[must_use]
pub fn error_motion(harmonics: &[RunoutHarmonic], angle_rad: f64) -> Isometry3<f64> {
    let mut sum = [0.0; 5];
    for harmonic in harmonics {
        harmonic.at(angle_rad).iter().zip(&mut sum).for_each(|(part, sum)| *sum += part);
    }
    let [about_x, about_y, x, y, z] = sum;
    exp(&twist(&Vector3::new(about_x, about_y, 0.0), &Vector3::new(x, y, z)))
}

/// Largest displacement of a point of plate or part from where a turn about the fixed axis puts it, mm: what the clearance of
/// collisions grows by. 0 without harmonics.
#[must_use]
pub fn max_displacement_mm(harmonics: &[RunoutHarmonic], plate_radius_mm: f64) -> f64 {
    let norm = |motion: &ErrorMotion, axes: std::ops::Range<usize>| motion[axes].iter().map(|v| v * v).sum::<f64>().sqrt();
    let of = |motion: &ErrorMotion| norm(motion, 2..5) + norm(motion, 0..2) * plate_radius_mm.hypot(LEVER_MM);
    harmonics.iter().map(|harmonic| 2.0 * of(&harmonic.cos) + of(&harmonic.sin)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Cell, CollisionScene, Named, Presets, SpecLibrary};

    const WOBBLE: RunoutSpec = RunoutSpec {
        order: 1,
        shift_cos_mm: [0.04, -0.02, 0.03],
        shift_sin_mm: [0.01, 0.02, -0.05],
        tilt_cos_deg: [0.01, -0.004],
        tilt_sin_deg: [0.002, 0.006],
    };

    fn cell(runout: Vec<RunoutSpec>) -> Cell {
        let mut spec = Presets.cell("e05-transcan").expect("a preset");
        let mut table = Presets.turntable("minas-a6-500").expect("a preset");
        table.runout = runout;
        spec.turntable = Named::Inline(Box::new(table));
        spec.build(&Presets).expect("valid")
    }

    #[test]
    fn the_plate_runs_out_with_the_angle_and_stands_at_zero() {
        let (with, without) = (cell(vec![WOBBLE]), cell(Vec::new()));
        assert_eq!(with.base_from_plate(0.0), without.base_from_plate(0.0));
        assert_eq!(without.base_from_plate(1.0), without.base_from_table * crate::geometry::table_from_plate(1.0));
        let off = |angle: f64| (with.base_from_plate(angle).inverse() * without.base_from_plate(angle)).origin_mm().coords.norm();
        // Half a turn: −2 times the cosine's shift, to the second order of the tilt.
        let expected = 2.0 * Vector3::from(WOBBLE.shift_cos_mm).norm();
        assert!((off(std::f64::consts::PI) - expected).abs() < 1e-4, "{}", off(std::f64::consts::PI));
        assert!(off(std::f64::consts::TAU) < 1e-9);
        let harmonic = WOBBLE.build();
        assert_eq!(RunoutSpec::from(&harmonic).shift_cos_mm, WOBBLE.shift_cos_mm);
        let bound = max_displacement_mm(&[harmonic], with.turntable.plate_radius_mm);
        let worst = (0..72).map(|step| off(f64::from(step) * 5.0_f64.to_radians())).fold(0.0, f64::max);
        assert!(worst > 0.1 && worst < bound, "{worst} {bound}");
        let clearance = |cell: &Cell| CollisionScene::without_part(cell, 5.0).clearance_mm();
        assert_eq!(clearance(&without), 5.0);
        assert!((clearance(&with) - 5.0 - bound).abs() < 1e-12);
    }

    #[test]
    fn runout_out_of_range_is_refused_by_place() {
        let refused = |change: fn(&mut Vec<RunoutSpec>)| {
            let mut table = Presets.turntable("minas-a6-500").expect("a preset");
            table.runout = vec![WOBBLE];
            change(&mut table.runout);
            table.build().expect_err("refused").iter().map(|error| error.pointer.clone()).collect::<Vec<_>>()
        };
        assert_eq!(refused(|runout| runout[0].order = 0), ["/runout/0/order"]);
        assert_eq!(refused(|runout| runout.push(WOBBLE)), ["/runout/1/order"]);
        assert_eq!(refused(|runout| runout[0].shift_sin_mm[2] = 2.1), ["/runout/0/shift_sin_mm/2"]);
        assert_eq!(refused(|runout| runout[0].tilt_cos_deg[1] = f64::NAN), ["/runout/0/tilt_cos_deg/1"]);
    }
}
