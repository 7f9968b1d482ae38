//! Search of a home for a cell whose user gives none: the arm holds the scanner over the plate and looks at its middle, clear of
//! everything.

use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::axis::Configuration;
use super::collision::{CollisionScene, MIN_CLEARANCE_MM};
use super::layout::Cell;
use crate::geometry::{Pose, ScannerFrame, Table, sort_ascending};

/// Clearances that are tried for, mm, the widest first.
const CLEARANCES_MM: [f64; 4] = [50.0, 20.0, PLANNED_MM, MIN_CLEARANCE_MM];
/// Clearance that plans keep by default, mm.
const PLANNED_MM: f64 = 5.0;
/// Height of the point looked at above the plate, mm.
const HEIGHTS_MM: [f64; 3] = [100.0, 250.0, 0.0];
/// Angles of the view from straight above, degrees.
const POLAR_DEG: [f64; 5] = [0.0, 20.0, 40.0, 55.0, 70.0];
/// Azimuths of the view, and rolls of the scanner.
const AZIMUTHS: u32 = 12;
const ROLLS: u32 = 8;

impl Cell {
    /// A home clear of everything by 50 mm, else by 20, 5 or 1, the table at zero; `None` where none is found. Of the views of one
    /// height and angle the one nearest to the middle of the joints' ranges, so that few joints stand at their limits.
    #[must_use]
    pub fn free_home(&self) -> Option<Configuration> {
        // A scene asks only for 1 mm between bodies of the arm that are never as far apart as its clearance. The wider the clearance,
        // the more of them: a home that is free with 50 mm may be closer than plans allow.
        let planned = CollisionScene::without_part(self, PLANNED_MM);
        CLEARANCES_MM.into_iter().find_map(|clearance_mm| {
            let scene = CollisionScene::without_part(self, clearance_mm);
            let scenes = if clearance_mm > PLANNED_MM { vec![&scene, &planned] } else { vec![&scene] };
            let mut views = POLAR_DEG.into_iter().flat_map(|polar| HEIGHTS_MM.into_iter().map(move |height| (polar, height)));
            views.find_map(|(polar_deg, height_mm)| self.free_view(&scenes, polar_deg.to_radians(), height_mm))
        })
    }

    /// The most central configuration, free in all scenes, that looks at the plate's axis at this height, under this angle.
    fn free_view(&self, scenes: &[&CollisionScene], polar: f64, height_mm: f64) -> Option<Configuration> {
        let azimuths = if polar > 0.0 { AZIMUTHS } else { 1 };
        let turns = (0..azimuths).flat_map(|azimuth| (0..ROLLS).map(move |roll| (azimuth, roll)));
        let found = turns.flat_map(|(azimuth, roll)| {
            let [azimuth, roll] =
                [(azimuth, AZIMUTHS), (roll, ROLLS)].map(|(step, steps)| TAU * f64::from(step) / f64::from(steps));
            let base_from_scanner = self.base_from_table * view(polar, azimuth, roll, height_mm, self.scanner.best_mm);
            let solutions = self.robot.kinematics.ik_solutions(&(base_from_scanner * self.flange_from_scanner.inverse()));
            let table_rad = self.zero_table_rad();
            solutions.into_iter().map(move |joints_rad| Configuration { joints_rad, table_rad })
        });
        let axes = self.axes();
        let mut allowed: Vec<Configuration> = found.filter(|configuration| axes.allow(configuration)).collect();
        sort_ascending(&mut allowed, |home| self.off_centre(home));
        allowed.into_iter().find(|configuration| scenes.iter().all(|scene| scene.check(configuration).is_none()))
    }

    /// Angle of the table nearest to zero.
    fn zero_table_rad(&self) -> f64 {
        0.0_f64.clamp(self.turntable.axis.min_rad, self.turntable.axis.max_rad)
    }

    /// Sum over the joints of the squared distances from the middle of the range, each as a share of it.
    fn off_centre(&self, configuration: &Configuration) -> f64 {
        let shares = self.robot.joints.iter().zip(configuration.joints_rad).map(|(axis, angle)| {
            let (middle, half) = (0.5 * (axis.min_rad + axis.max_rad), 0.5 * (axis.max_rad - axis.min_rad));
            ((angle - middle) / half.max(PI * 1e-3)).powi(2)
        });
        shares.sum()
    }
}

/// The scanner `distance_mm` from a point on the table's axis, looking at it.
fn view(polar: f64, azimuth: f64, roll: f64, height_mm: f64, distance_mm: f64) -> Pose<Table, ScannerFrame> {
    let out = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let level = Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0);
    let x = Rotation3::new(out * roll) * level;
    let axes = Rotation3::from_basis_unchecked(&[x, (-out).cross(&x), -out]);
    Pose::from_parts(Vector3::new(0.0, 0.0, height_mm) + out * distance_mm, UnitQuaternion::from_rotation_matrix(&axes))
}
