//! The slide rule ([`crate::planning::method::candidates`]): a viewpoint moves along its axis until the middle of the depth
//! range of the front-facing samples inside all three frusta is F. Moving changes what the frusta hold, so the step is
//! repeated.
//!
//! Cost: a few passes over at most [`SAMPLES`] samples a viewpoint.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::Scope;
use crate::cell::Scanner;

/// Samples looked at; more do not change a depth range noticeably.
const SAMPLES: usize = 8_000;
/// Passes at most. The set of samples in the frusta settles after two or three.
const PASSES: usize = 6;
/// A move this small ends the slide, mm.
const SETTLED_MM: f64 = 0.1;

pub(super) struct Slide<'a> {
    scanner: &'a Scanner,
    device_from_scanner: [Isometry3<f64>; 3],
    /// Position and normal, table frame.
    samples: Vec<(Point3<f64>, Vector3<f64>)>,
}

impl<'a> Slide<'a> {
    pub(super) fn new(scope: &Scope<'a>) -> Self {
        let surface = scope.surface;
        let stride = surface.sample_mm.len().div_ceil(SAMPLES).max(1);
        let samples = (0..surface.sample_mm.len())
            .step_by(stride)
            .map(|sample| {
                let normal = scope.table_from_part.direction(&surface.patch_of(sample).normal);
                (scope.table_from_part.point(&surface.sample_mm[sample]), normal)
            })
            .collect();
        let device_from_scanner = [0, 1, 2].map(|d| *scope.scanner.devices[d].scanner_from_device.inverse().isometry());
        Self { scanner: scope.scanner, device_from_scanner, samples }
    }

    /// Slides a viewpoint from `position` to where it comes to rest. It stays when it sees nothing.
    pub(super) fn along_axis(&self, mut position: Point3<f64>, orientation: &UnitQuaternion<f64>) -> Point3<f64> {
        for _ in 0..PASSES {
            let Some(mid_mm) = self.mid_depth_mm(&position, orientation) else { break };
            let forward_mm = mid_mm - self.scanner.best_mm;
            position += orientation * Vector3::z() * forward_mm;
            if forward_mm.abs() < SETTLED_MM {
                break;
            }
        }
        position
    }

    fn mid_depth_mm(&self, position: &Point3<f64>, orientation: &UnitQuaternion<f64>) -> Option<f64> {
        let scanner_from_table = Isometry3::from_parts(Translation3::from(position.coords), *orientation).inverse();
        let (mut near, mut far) = (f64::INFINITY, f64::NEG_INFINITY);
        for (p, normal) in &self.samples {
            if normal.dot(&(position - p)) <= 0.0 {
                continue;
            }
            let in_scanner = scanner_from_table * p;
            let inside = |d: usize| self.scanner.devices[d].lens.project(&(self.device_from_scanner[d] * in_scanner)).is_some();
            if in_scanner.z > 0.0 && (0..3).all(inside) {
                near = near.min(in_scanner.z);
                far = far.max(in_scanner.z);
            }
        }
        (near <= far).then_some(0.5 * (near + far))
    }
}
