//! The charging base as a distance field. All dimensions in millimetres; x along the product, the user sits at +x.

use nalgebra::{Point3, Vector3};

use super::field::{ball, blend, cuboid, cut, round_common, round_rectangle, sharp_common, slab, soft_cut, upright_cylinder};

/// The part fills these bounds exactly.
pub(super) const BOUNDS_MM: [[f64; 3]; 2] = [[-60.5, -36.5, 0.0], [60.5, 36.5, 37.0]];

/// Height of the plinth's deck.
const DECK: f64 = 15.0;
/// Positions of the cradle's side walls.
const CRADLE_HALF_Y: f64 = 23.0;

/// Signed distance to the base.
pub(super) fn distance_mm(p: &Point3<f64>) -> f64 {
    let body = blend(plinth(p), cradle(p), 4.0);
    let body = blend(body, button(p), 2.0);
    let body = body.min(ribs(p)).min(screw_bosses(p)).max(-p.z);
    let body = soft_cut(body, trough(p), 2.0);
    cut(cut(cut(cut(cut(body, socket(p)), tray(p)), screw_holes(p)), slots(p)), thumb_scoop(p).min(cable_hole(p)))
}

/// Rounded slab with a rounded upper edge and a sharp lower one.
fn plinth(p: &Point3<f64>) -> f64 {
    round_common(round_rectangle(p.xy().coords, [60.5, 36.5], 14.0), p.z - DECK, 3.0)
}

/// Raised block: level on top at the back, sloping down to the front.
fn cradle(p: &Point3<f64>) -> f64 {
    let footprint = round_rectangle(p.xy().coords - nalgebra::Vector2::new(-5.0, 0.0), [39.0, CRADLE_HALF_Y], 7.0);
    let slope = Vector3::new(0.28, 0.0, 0.96).dot(&(p - Point3::new(-8.0, 0.0, 37.0)));
    round_common(footprint, (p.z - 37.0).max(slope), 2.5)
}

/// Lies in the cradle where the product rests: narrower at its mouth than below, closed at the back, open at the front.
fn trough(p: &Point3<f64>) -> f64 {
    let from_back_end = Vector3::new((p.x + 24.0).min(0.0), p.y, p.z - 31.5);
    from_back_end.norm() - 13.5
}

/// Round well in the floor of the trough, with a contact pin in its middle.
fn socket(p: &Point3<f64>) -> f64 {
    let well = upright_cylinder(p, [-17.0, 0.0], 8.5, [6.0, 30.0]);
    let pin = upright_cylinder(p, [-17.0, 0.0], 3.0, [0.0, 12.0]);
    cut(well, pin)
}

/// Rectangular pocket at the front with a rectangular post on its floor.
fn tray(p: &Point3<f64>) -> f64 {
    let pocket = cuboid(p, [38.0, -22.0, 8.0], [51.5, 22.0, 20.0]);
    let post = cuboid(p, [42.0, -14.0, 0.0], [47.0, 2.0, 13.0]);
    cut(pocket, post)
}

/// Gussets between the cradle's walls and the deck, five a side.
fn ribs(p: &Point3<f64>) -> f64 {
    const SPACING: f64 = 13.0;
    let nearest = ((p.x + 5.0) / SPACING).round().clamp(-2.0, 2.0);
    let thickness = (p.x + 5.0 - SPACING * nearest).abs() - 1.9;
    let out = p.y.abs();
    let slope = 0.6 * (out - 33.5) + 0.8 * (p.z - DECK);
    let profile = slab(out, [CRADLE_HALF_Y - 4.0, 33.5]).max(slab(p.z, [DECK - 5.0, 24.0])).max(slope);
    sharp_common(thickness, profile)
}

/// Low round button behind the cradle.
fn button(p: &Point3<f64>) -> f64 {
    ball(p, [-51.0, 0.0, 12.5], 7.0)
}

/// Two pillars behind the cradle.
fn screw_bosses(p: &Point3<f64>) -> f64 {
    let folded = Point3::new(p.x, p.y.abs(), p.z);
    upright_cylinder(&folded, [-51.5, 20.0], 5.5, [DECK - 5.0, 23.0])
}

fn screw_holes(p: &Point3<f64>) -> f64 {
    let folded = Point3::new(p.x, p.y.abs(), p.z);
    upright_cylinder(&folded, [-51.5, 20.0], 2.6, [12.0, 30.0])
}

/// Two ventilation slots in the back wall of the cradle.
fn slots(p: &Point3<f64>) -> f64 {
    let slot = |z: [f64; 2]| cuboid(p, [-50.0, -14.0, z[0]], [-40.5, 14.0, z[1]]);
    slot([20.5, 24.0]).min(slot([28.0, 31.5]))
}

/// Large concave round in the front face.
fn thumb_scoop(p: &Point3<f64>) -> f64 {
    upright_cylinder(p, [82.0, 0.0], 26.0, [5.0, 40.0])
}

/// Blind hole for the cable in the back face.
fn cable_hole(p: &Point3<f64>) -> f64 {
    let radial = (p.y - 9.0).hypot(p.z - 7.0) - 3.6;
    sharp_common(radial, p.x + 46.0)
}
