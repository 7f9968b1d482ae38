//! The figurine as a distance field: bodies of revolution and limbs that run into each other. Millimetres; it looks
//! along −y and stands on z = 0.

use nalgebra::Point3;

use super::field::{ball, blend, ellipsoid, limb, round_common};

/// Bounds that hold the part.
pub(super) const BOUNDS_MM: [[f64; 3]; 2] = [[-70.0, -45.0, 0.0], [72.0, 66.0, 152.0]];

/// Signed distance to the figurine.
pub(super) fn distance_mm(p: &Point3<f64>) -> f64 {
    let mirrored = Point3::new(p.x.abs(), p.y, p.z);
    let trunk = blend(trunk(p), legs(&mirrored), 9.0);
    let with_head = blend(trunk, head(p, &mirrored), 8.0);
    let with_arms = blend(with_head, raised_arm(p).min(arm_on_hip(p)), 6.0);
    let whole = blend(with_arms, tail(p), 6.0);
    round_common(whole, -p.z, 1.5)
}

fn trunk(p: &Point3<f64>) -> f64 {
    let chest = ellipsoid(p, [0.0, 0.0, 74.0], [29.0, 24.0, 30.0]);
    let belly = ellipsoid(p, [0.0, -6.0, 56.0], [33.0, 29.0, 28.0]);
    blend(chest, belly, 10.0)
}

fn legs(mirrored: &Point3<f64>) -> f64 {
    let leg = limb(mirrored, [20.0, 0.0, 42.0], [23.0, 0.0, 12.0], [15.0, 12.0]);
    let foot = ellipsoid(mirrored, [24.0, -11.0, 8.0], [14.0, 23.0, 12.0]);
    blend(leg, foot, 6.0)
}

fn head(p: &Point3<f64>, mirrored: &Point3<f64>) -> f64 {
    let skull = ellipsoid(p, [0.0, -3.0, 117.0], [28.0, 25.0, 24.0]);
    let muzzle = ellipsoid(p, [0.0, -26.0, 109.5], [14.0, 13.0, 10.0]);
    let nose = ball(p, [0.0, -38.0, 113.0], 4.2);
    let eye = ball(mirrored, [10.0, -24.5, 122.5], 3.4);
    let ear = ellipsoid(mirrored, [23.0, 2.0, 136.5], [13.5, 6.0, 13.5]);
    let face = blend(blend(skull, muzzle, 5.0), nose.min(eye), 1.0);
    blend(face, ear, 4.0)
}

/// The left arm, which waves.
fn raised_arm(p: &Point3<f64>) -> f64 {
    let upper = limb(p, [24.0, 0.0, 88.0], [47.0, -5.0, 84.0], [9.5, 8.5]);
    let fore = limb(p, [47.0, -5.0, 84.0], [58.0, -12.0, 112.0], [8.5, 8.0]);
    let hand = ball(p, [59.0, -13.0, 116.0], 10.0);
    blend(blend(upper, fore, 4.0), hand, 4.0)
}

/// The right arm, which leaves a hole between itself and the body.
fn arm_on_hip(p: &Point3<f64>) -> f64 {
    let upper = limb(p, [-24.0, 0.0, 90.0], [-55.0, 2.0, 74.0], [9.5, 8.5]);
    let fore = limb(p, [-55.0, 2.0, 74.0], [-35.0, -10.0, 50.0], [8.5, 8.0]);
    blend(upper, fore, 4.0)
}

fn tail(p: &Point3<f64>) -> f64 {
    let root = limb(p, [0.0, 20.0, 40.0], [1.0, 38.0, 36.0], [9.0, 8.0]);
    let bend = limb(p, [1.0, 38.0, 36.0], [5.0, 51.0, 44.0], [8.0, 7.0]);
    let tip = limb(p, [5.0, 51.0, 44.0], [11.0, 54.0, 64.0], [7.0, 5.5]);
    blend(blend(root, bend, 3.0), tip, 3.0)
}
