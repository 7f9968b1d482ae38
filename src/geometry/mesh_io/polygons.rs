//! Polygons that a fan around their first corner does not fill. The triangles of a fan lie beside each other where all of them turn as the
//! polygon as a whole does, which those of a convex polygon always do; of a concave one some may lie upon others and outside of it. Such a
//! polygon is cut anew by clipping ears in the plane across its vector area (G. H. Meisters, "Polygons have ears", American Mathematical
//! Monthly 82, 1975): again into two triangles fewer than it has corners, in the place of its fan.
//!
//! Cost: O(corners) for all polygons that a fan fills, O(corners²) for each other one, up to a budget.

use nalgebra::{Point3, Vector3};

use crate::geometry::poll::{Interrupted, Poll};

/// Corners looked at while ears are sought; about a second. Beyond it polygons are left as they are.
const EAR_BUDGET: usize = 300_000_000;
/// Share of a polygon's area up to which triangles of its fan may be turned: corners on a straight edge, rounded in the file. Our choice.
const ROUNDING_SHARE: f64 = 1e-6;
/// Area of a triangle without any, as a share of the square of the polygon's size.
const THIN_SHARE: f64 = 1e-12;

/// Cuts anew, in place, the polygons that their fans do not fill; returns the number of those that cannot be cut, since they cross or fold
/// over themselves or are beyond the budget. The triangles of a polygon follow each other, and have its number in `source_face`.
pub(super) fn cut_concave(
    vertices_mm: &[Point3<f64>],
    faces: &mut [[u32; 3]],
    source_face: &[u32],
    poll: &Poll<'_>,
) -> Result<usize, Interrupted> {
    let (mut begin, mut uncut, mut budget) = (0, 0, EAR_BUDGET);
    for sources in source_face.chunk_by(|a, b| a == b) {
        poll.spend(2)?;
        let fan = &mut faces[begin..begin + sources.len()];
        begin += sources.len();
        if fan.len() < 2 {
            continue;
        }
        let Some(across) = across_unfilled(vertices_mm, fan, poll)? else { continue };
        match cut(vertices_mm, fan, &across, &mut budget, poll)? {
            Cut::Done(triangles) => fan.copy_from_slice(&triangles),
            Cut::Thin => {}
            Cut::Impossible => uncut += 1,
        }
    }
    Ok(uncut)
}

/// Twice the vector area of a polygon that its fan does not fill; `None` for one that it fills.
fn across_unfilled(vertices_mm: &[Point3<f64>], fan: &[[u32; 3]], poll: &Poll<'_>) -> Result<Option<Vector3<f64>>, Interrupted> {
    let normal = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|vertex| vertices_mm[vertex as usize]);
        (b - a).cross(&(c - a))
    };
    let mut across = Vector3::zeros();
    for face in fan {
        poll.spend(10)?;
        across += normal(face);
    }
    let mut turned = 0.0;
    for face in fan {
        poll.spend(10)?;
        turned -= normal(face).dot(&across).min(0.0);
    }
    Ok((turned > ROUNDING_SHARE * across.norm_squared()).then_some(across))
}

/// Result of cutting a polygon.
enum Cut {
    /// Triangles of the polygon.
    Done(Vec<[u32; 3]>),
    /// The polygon has no area.
    Thin,
    /// The polygon crosses or folds over itself, or is beyond the budget.
    Impossible,
}

fn cut(
    vertices_mm: &[Point3<f64>],
    fan: &[[u32; 3]],
    across: &Vector3<f64>,
    budget: &mut usize,
    poll: &Poll<'_>,
) -> Result<Cut, Interrupted> {
    let count = fan.len() + 2;
    // Every cut looks at all corners that are left.
    if count.saturating_mul(count) / 2 > *budget {
        return Ok(Cut::Impossible);
    }
    let corners: Vec<u32> = fan[0].into_iter().chain(fan[1..].iter().map(|face| face[2])).collect();
    let origin = vertices_mm[corners[0] as usize];
    let offset = |corner: &u32| vertices_mm[*corner as usize] - origin;
    let size_mm = corners.iter().map(|corner| offset(corner).amax()).fold(0.0, f64::max);
    let thin_mm2 = THIN_SHARE * size_mm * size_mm;
    // Of a polygon that is as good as a line the corners tell no plane.
    if fan.iter().all(|face| doubled_area(face.map(|corner| offset(&corner))) <= thin_mm2) {
        return Ok(Cut::Thin);
    }
    let Some(normal) = across.try_normalize(thin_mm2) else { return Ok(Cut::Impossible) };
    let right = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let up = normal.cross(&right);
    let flat = corners.iter().map(offset).map(|offset| [offset.dot(&right), offset.dot(&up)]).collect();
    let triangles = Ring::new(flat, thin_mm2).ears(budget, poll)?;
    let of_file = |triangle: [usize; 3]| triangle.map(|place| corners[place]);
    Ok(triangles.map_or(Cut::Impossible, |triangles| Cut::Done(triangles.into_iter().map(of_file).collect())))
}

fn doubled_area([a, b, c]: [Vector3<f64>; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm()
}

/// Corners of a plane polygon that are left, counter-clockwise.
struct Ring {
    flat: Vec<[f64; 2]>,
    next: Vec<usize>,
    previous: Vec<usize>,
    /// True for corners that may be ears: a corner that is none becomes one only when a neighbour of it is cut off.
    is_open: Vec<bool>,
    left: usize,
    /// Twice the area up to which a triangle has none.
    thin_mm2: f64,
}

impl Ring {
    fn new(flat: Vec<[f64; 2]>, thin_mm2: f64) -> Self {
        let left = flat.len();
        let next = (0..left).map(|place| (place + 1) % left).collect();
        let previous = (0..left).map(|place| (place + left - 1) % left).collect();
        Self { flat, next, previous, is_open: vec![true; left], left, thin_mm2 }
    }

    /// Cuts off ears until one triangle is left; `None` where there is no ear, or no budget for it.
    fn ears(mut self, budget: &mut usize, poll: &Poll<'_>) -> Result<Option<Vec<[usize; 3]>>, Interrupted> {
        let mut triangles = Vec::with_capacity(self.left - 2);
        // Corners passed since the last cut. In a second round all of them are tried again, and those without an area are cut off too.
        let (mut place, mut passed) = (0, 0);
        while self.left > 3 {
            let is_second = passed >= self.left;
            let is_tried = is_second || self.is_open[place];
            let looks = if is_tried { self.left } else { 1 };
            let Some(affordable) = budget.checked_sub(looks) else { return Ok(None) };
            *budget = affordable;
            poll.spend(4 * looks)?;
            let ear = [self.previous[place], place, self.next[place]];
            if is_tried && self.is_ear(ear, is_second) {
                triangles.push(ear);
                let [a, _, c] = ear;
                (self.next[a], self.previous[c]) = (c, a);
                (self.is_open[a], self.is_open[c]) = (true, true);
                (self.left, passed) = (self.left - 1, 0);
                // The corner after the next: ears beside each other would be slivers.
                place = self.next[c];
            } else if passed < 2 * self.left {
                self.is_open[place] = false;
                passed += 1;
                place = self.next[place];
            } else {
                return Ok(None);
            }
        }
        let last = [self.previous[place], place, self.next[place]];
        triangles.push(last);
        Ok((self.turn(last) >= -self.thin_mm2).then_some(triangles))
    }

    /// Twice the signed area of a triangle.
    fn turn(&self, triangle: [usize; 3]) -> f64 {
        let [a, b, c] = triangle.map(|place| self.flat[place]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }

    /// Returns true if a corner between its neighbours may be cut off: it turns inwards nowhere, and no corner that does so lies within.
    /// Corners at one place, where a polygon runs to a hole and back, are no obstacle to each other.
    fn is_ear(&self, ear: [usize; 3], takes_thin: bool) -> bool {
        let turn = self.turn(ear);
        if turn.abs() <= self.thin_mm2 {
            return takes_thin;
        }
        if turn < 0.0 {
            return false;
        }
        let [a, b, c] = ear;
        let mut place = self.next[c];
        while place != a {
            let is_within = || [[a, b, place], [b, c, place], [c, a, place]].into_iter().all(|side| self.turn(side) >= 0.0);
            let is_apart = || ear.iter().all(|corner| self.is_elsewhere(*corner, place));
            let is_reflex = || self.turn([self.previous[place], place, self.next[place]]) <= self.thin_mm2;
            if is_within() && is_apart() && is_reflex() {
                return false;
            }
            place = self.next[place];
        }
        true
    }

    fn is_elsewhere(&self, one: usize, other: usize) -> bool {
        self.flat[one].map(f64::to_bits) != self.flat[other].map(f64::to_bits)
    }
}

#[cfg(test)]
mod tests;
