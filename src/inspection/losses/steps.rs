//! Steps of depth around a point of the model, in the left camera's image: rays on three rings around its pixel meet the model
//! off the plane of the point, or do not meet it. Cost: 32 rays a point.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::cell::Scanner;
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::inspection::coverage::{CompareParams, NominalModel};
use crate::planning::context::Context;

/// Rays of the outer ring, of which a straight step that passes within 98 % of its radius meets one, and of the two inner ones,
/// which meet steps that run back within the outer one.
const OUTER: usize = 16;
const INNER: usize = 8;
const RAYS: usize = OUTER + 2 * INNER;

/// Radius, as a share of the margin, and angle of a ray.
fn place(number: usize) -> (f64, f64) {
    match number.checked_sub(OUTER) {
        None => (1.0, TAU * number as f64 / OUTER as f64),
        Some(inner) => ((1 + inner / INNER) as f64 / 3.0, TAU * (inner % INNER) as f64 / INNER as f64),
    }
}

/// Finds which of some surface points, each with its unit normal, lie within the margin of a step.
pub(super) fn near_steps(
    model: &NominalModel<'_>,
    scanner: &Scanner,
    pose: &Pose<Part, ScannerFrame>,
    points: &[(Point3<f64>, Vector3<f64>)],
    (compare, step_px): (&CompareParams, f64),
    ctx: &Context<'_>,
) -> Vec<bool> {
    if compare.edge_px <= 0.0 {
        return vec![false; points.len()];
    }
    let left = &scanner.devices.left;
    let part_from_left: Isometry3<f64> = pose.isometry() * left.scanner_from_device.isometry();
    // A sample lies up to half a cell's diagonal from the ray of its cell, whose distance from the step counts.
    let margin_px = compare.edge_px + step_px * std::f64::consts::FRAC_1_SQRT_2;
    let ray = |point: &Point3<f64>, number: usize| {
        let in_left = part_from_left.inverse() * point;
        let (share, angle_rad) = place(number);
        let (radius_px, (sin, cos)) = (share * margin_px, angle_rad.sin_cos());
        let (du, dv) = (radius_px * cos / left.lens.fx, radius_px * sin / left.lens.fy);
        part_from_left * Vector3::new(in_left.x / in_left.z + du, in_left.y / in_left.z + dv, 1.0)
    };
    let rays: Vec<Vector3<f64>> = points.iter().flat_map(|(point, _)| (0..RAYS).map(move |number| ray(point, number))).collect();
    let (centre_mm, mut hits) = (Point3::from(part_from_left.translation.vector), Vec::new());
    model.surfaces().first_hits_from(ctx.simd_level(), &centre_mm, &rays, &mut hits);
    let is_step = |(point, normal): &(Point3<f64>, Vector3<f64>), ray: &Vector3<f64>, hit: Option<f64>| {
        let Some(depth_mm) = hit else { return true };
        let own_mm = (part_from_left.inverse() * point).z;
        let plane_mm = normal.dot(&(point - centre_mm)) / normal.dot(ray);
        let is_off_plane = (plane_mm - depth_mm).abs() >= compare.edge_step_mm || plane_mm.is_nan();
        is_off_plane && (own_mm - depth_mm).abs() >= compare.edge_step_mm
    };
    let mut beside = Vec::with_capacity(points.len());
    for ((point, rays), hits) in points.iter().zip(rays.chunks(RAYS)).zip(hits.chunks(RAYS)) {
        beside.push(rays.iter().zip(hits).any(|(ray, hit)| is_step(point, ray, hit.map(|hit| hit.share))));
    }
    beside
}
