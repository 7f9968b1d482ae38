//! Pairs of points and faces.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};

use super::points::{Elements, ViewPoints};
use super::{FREEDOMS, KeptPose, RegistrationOptions};
use crate::cell::calibration::se3::Twist;
use crate::geometry::{NearestFace, parallel};

/// Cosine of 45°, the angle up to which the normals of a pair may differ (K. Pulli, "Multiview registration for large data sets", 3DIM
/// 1999, section 3; S. Rusinkiewicz, M. Levoy, "Efficient variants of the ICP algorithm", 3DIM 2001, section 3.2). Where a key is missing,
/// points on the bare wall are nearest to the walls of the key, and would hold the part by them.
const ALIKE_COS: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// A point and the plane of its nearest face.
#[derive(Clone, Copy, Debug)]
pub(super) struct MatchedPoint {
    /// Point, scanner frame, mm.
    pub(super) point_mm: Point3<f64>,
    /// Normal of the face, scanner frame.
    pub(super) normal: Vector3<f64>,
    /// Signed distance to the plane, mm.
    pub(super) distance_mm: f64,
    /// Nearest point of the face, part frame, mm.
    nominal_mm: Point3<f64>,
    /// True if the surface around the point looks as the face does, or is not known.
    looks_alike: bool,
    /// Side that the face looks to: its axis, 0 to 2, or 3 more where it looks against that axis; part frame.
    side: u8,
}

impl MatchedPoint {
    /// ∂r/∂δ in the view's right perturbation: a step δ = (ω, v) moves a point s by ω × s + v, so that it is (s × n, n).
    pub(super) fn row(&self) -> Twist {
        let turn = self.point_mm.coords.cross(&self.normal);
        Twist::new(turn.x, turn.y, turn.z, self.normal.x, self.normal.y, self.normal.z)
    }

    /// Weight after Tukey within a radius; none where the surface around the point looks elsewhere than the face.
    pub(super) fn weight(&self, radius_mm: f64) -> f64 {
        if !self.looks_alike {
            return 0.0;
        }
        let share = self.distance_mm / radius_mm;
        (1.0 - share * share).max(0.0).powi(2)
    }
}

/// Cell of the surface, part frame: its place in cells, and the side that it looks to.
pub(super) type SurfaceCell = ([i64; 3], u8);

/// Weighted sums over the pairs of a view in a cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellSum {
    pub(super) weight: f64,
    pub(super) row: Twist,
    pub(super) distance_mm: f64,
}

/// Pairs of a view.
pub(super) struct Matched {
    pub(super) points: usize,
    /// Points that the view has, of which those are some.
    there: usize,
    pub(super) radius_mm: f64,
    pub(super) pairs: Vec<MatchedPoint>,
}

/// Pairs the points of a view at a pose with faces within a radius that face the scanner.
pub(super) fn match_view(
    view: &ViewPoints,
    part_from_scanner: &Isometry3<f64>,
    nearest: &NearestFace<'_>,
    radius_mm: f64,
) -> Matched {
    let scanner_from_part = part_from_scanner.inverse();
    let pair = |number: usize| {
        let point_mm = &view.points_mm[number];
        let in_part = part_from_scanner * point_mm;
        let found = nearest.nearest(&in_part, radius_mm)?;
        let normal = nearest.mesh().scaled_normal(found.face as usize).try_normalize(0.0)?;
        let in_scanner = scanner_from_part.rotation * normal;
        if in_scanner.dot(&point_mm.coords) >= 0.0 {
            return None;
        }
        let distance_mm = normal.dot(&(in_part - found.point_mm));
        let axis = normal.iamax();
        let side = axis as u8 + if normal[axis] < 0.0 { 3 } else { 0 };
        let looks_alike = view.elements.get(number).is_none_or(|elements| look_alike(elements, &in_scanner));
        Some(MatchedPoint { point_mm: *point_mm, normal: in_scanner, distance_mm, nominal_mm: found.point_mm, looks_alike, side })
    };
    let pairs = parallel::map_range(view.points_mm.len(), pair).into_iter().flatten().collect();
    Matched { points: view.points_mm.len(), there: view.there, radius_mm, pairs }
}

/// Returns true if one of the elements around a point looks along a normal, or none is known: beside an edge others look elsewhere.
fn look_alike(elements: &Elements, normal: &Vector3<f64>) -> bool {
    let mut known = elements.iter().flatten().peekable();
    known.peek().is_none() || known.any(|element| element.dot(normal).abs() >= ALIKE_COS)
}

impl Matched {
    /// Sums by cell of this size, ascending; pairs that weigh nothing are left out.
    pub(super) fn cells(&self, size_mm: f64) -> BTreeMap<SurfaceCell, CellSum> {
        let mut cells = BTreeMap::new();
        for pair in &self.pairs {
            let weight = pair.weight(self.radius_mm);
            if weight > 0.0 {
                let place: [i64; 3] = pair.nominal_mm.coords.map(|value| (value / size_mm).floor() as i64).into();
                let empty = CellSum { weight: 0.0, row: Twist::zeros(), distance_mm: 0.0 };
                let sum: &mut CellSum = cells.entry((place, pair.side)).or_insert(empty);
                sum.weight += weight;
                sum.row += pair.row() * weight;
                sum.distance_mm += weight * pair.distance_mm;
            }
        }
        cells
    }

    /// Share of the points that have a pair.
    pub(super) fn inlier_share(&self) -> f64 {
        self.pairs.len() as f64 / self.points.max(1) as f64
    }

    /// Root mean square of the distances, mm.
    pub(super) fn rms_mm(&self) -> f64 {
        let sum: f64 = self.pairs.iter().map(|pair| pair.distance_mm.powi(2)).sum();
        (sum / self.pairs.len().max(1) as f64).sqrt()
    }

    /// Reason for which the points do not say more than the pose.
    pub(super) fn kept_pose(&self, options: &RegistrationOptions) -> Option<KeptPose> {
        // Of a view that is thinned, pairs stand for points that were left out: of many views each is.
        let is_few = self.pairs.len() * self.there < options.min_points * self.points;
        if is_few || self.pairs.len() < FREEDOMS {
            Some(KeptPose::FewPoints)
        } else if self.inlier_share() < options.min_inlier_share && self.radius_mm >= options.inlier_mm {
            Some(KeptPose::FewInliers)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_looks_as_a_face_that_one_element_around_it_is_level_with_or_that_none_is_known_of() {
        let (up, side) = (Vector3::z(), Vector3::x());
        let tilted = Vector3::new(1.0, 0.0, 1.2).normalize();
        assert!(look_alike(&[Some(up), None, Some(-side), None], &side), "beside an edge");
        assert!(!look_alike(&[Some(up), Some(-up), None, Some(tilted)], &side), "on another wall");
        assert!(look_alike(&[Some(tilted), None, None, None], &up), "tilted by less than 45°");
        assert!(look_alike(&[None; 4], &side), "nothing is known");
    }
}
