//! The definition in `vantage::planning::method::visibility` written down once more, without a tree and by another triangle test,
//! against the planner's engine: every sample of every view must agree.

use nalgebra::{Point3, Vector3};
use vantage::cell::{PerDevice, Scanner};
use vantage::geometry::{Mesh, Part, Pose, ScannerFrame};
use vantage::planning::ids::SampleId;
use vantage::planning::params::PlanParams;

use super::{limits, looking_at_origin, rows, sampled};
use crate::support::shapes::{prism, sphere, step};
use crate::support::{nominal_scanner, preset_scanner};

/// Distance from the device at which the segment to `target` first meets the triangle, as a share of its length; after
/// Möller and Trumbore (1997). On arrays, since tests are not optimised.
fn meets(from: [f64; 3], target: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> Option<f64> {
    let minus = |u: [f64; 3], v: [f64; 3]| [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
    let cross = |u: [f64; 3], v: [f64; 3]| [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let (direction, e1, e2) = (minus(target, from), minus(b, a), minus(c, a));
    let p = cross(direction, e2);
    let determinant = dot(e1, p);
    let s = minus(from, a);
    let u = dot(s, p) / determinant;
    if determinant == 0.0 || !(0.0..=1.0).contains(&u) {
        return None;
    }
    let q = cross(s, e1);
    let (v, t) = (dot(direction, q) / determinant, dot(e2, q) / determinant);
    (v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

fn is_measured(
    corners_mm: &[[[f64; 3]; 3]],
    scanner: &Scanner,
    pose: &Pose<Part, ScannerFrame>,
    limits_rad: PerDevice<f64>,
    (p, normal): (&Point3<f64>, &Vector3<f64>),
) -> bool {
    let in_scanner = pose.inverse().point(p);
    let devices = scanner.devices.iter().zip(limits_rad);
    (scanner.near_mm..=scanner.far_mm).contains(&in_scanner.z)
        && devices.into_iter().all(|(device, limit_rad)| {
            let centre = pose.point(&device.scanner_from_device.origin_mm());
            let seen = device.lens.project(&device.scanner_from_device.inverse().point(&in_scanner)).is_some();
            // A surface 5 µm or less before the sample is the sample's own.
            let own = 1.0 - 5e-3 / (p - centre).norm();
            seen && normal.angle(&(centre - p)) <= limit_rad
                && corners_mm.iter().all(|triangle| meets(centre.into(), (*p).into(), *triangle).is_none_or(|t| t >= own))
        })
}

/// A trough: two ridges that shade each other and the floor between them.
fn trough() -> Mesh {
    prism(&[[0.0, -40.0], [40.0, -40.0], [40.0, 30.0], [15.0, 0.0], [-15.0, 0.0], [-40.0, 30.0], [-40.0, -40.0]], 30.0)
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_sample_of_every_view_agrees_with_the_plain_loop() {
    let params: PlanParams = limits(85.0, 77.5);
    let limits_rad = PerDevice::of_cameras(85.0_f64, 77.5).map(f64::to_radians);
    for (name, mesh) in [("sphere", sphere(30.0, 3)), ("step", step(60.0, 30.0, 25.0)), ("trough", trough())] {
        let corners_mm: Vec<_> = (0..mesh.faces.len()).map(|face| mesh.corners(face).map(<[f64; 3]>::from)).collect();
        for scanner in [nominal_scanner(), preset_scanner("transcan-c")] {
            let surface = sampled(&mesh, 1500.0);
            let poses: Vec<_> = (0..24)
                .map(|k| {
                    // A spiral of directions over the whole sphere.
                    let (z, turn) = (1.0 - (f64::from(k) + 0.5) / 12.0, f64::from(k) * 2.399_963);
                    let level = (1.0 - z * z).sqrt();
                    looking_at_origin(Vector3::new(level * turn.cos(), level * turn.sin(), z), 455.0 + 3.0 * f64::from(k), turn)
                })
                .collect();
            let cast = rows(&mesh, &surface, &poses, &scanner, &params);
            let (mut measured, mut hidden) = (0, 0);
            for (pose, row) in poses.iter().zip(&cast) {
                let plain: Vec<SampleId> = surface
                    .samples()
                    .filter(|s| {
                        let sample = (&surface.sample_mm[s.index()], &surface.patch_of(*s).normal);
                        is_measured(&corners_mm, &scanner, pose, limits_rad, sample)
                    })
                    .collect();
                assert_eq!(row.samples().collect::<Vec<_>>(), plain, "{name} with {}", scanner.name);
                measured += plain.len();
                hidden += surface.sample_mm.len() - plain.len();
            }
            assert!(measured > 1000 && hidden > 1000, "{name}: {measured} measured, {hidden} not");
        }
    }
}
