//! Pairs of points and faces.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::points::ViewPoints;
use super::{FREEDOMS, KeptPose, RegistrationOptions};
use crate::geometry::NearestFace;

/// A point and the plane of its nearest face.
#[derive(Clone, Copy, Debug)]
pub(super) struct MatchedPoint {
    /// Point, scanner frame, mm.
    pub(super) point_mm: Point3<f64>,
    /// Normal of the face, scanner frame.
    pub(super) normal: Vector3<f64>,
    /// Signed distance to the plane, mm.
    pub(super) distance_mm: f64,
}

/// Pairs of a view.
pub(super) struct Matched {
    pub(super) points: usize,
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
    let pair = |point_mm: &Point3<f64>| {
        let in_part = part_from_scanner * point_mm;
        let found = nearest.nearest(&in_part, radius_mm)?;
        let normal = nearest.mesh().scaled_normal(found.face as usize).try_normalize(0.0)?;
        let in_scanner = scanner_from_part.rotation * normal;
        if in_scanner.dot(&point_mm.coords) >= 0.0 {
            return None;
        }
        Some(MatchedPoint { point_mm: *point_mm, normal: in_scanner, distance_mm: normal.dot(&(in_part - found.point_mm)) })
    };
    let pairs = view.points_mm.par_iter().with_min_len(256).map(pair).collect::<Vec<_>>().into_iter().flatten().collect();
    Matched { points: view.points_mm.len(), radius_mm, pairs }
}

impl Matched {
    /// Cells of this size that hold a pair.
    pub(super) fn cells(&self, size_mm: f64) -> usize {
        let cell = |pair: &MatchedPoint| pair.point_mm.coords.map(|value| (value / size_mm).floor() as i64);
        let cells: BTreeSet<[i64; 3]> = self.pairs.iter().map(|pair| cell(pair).into()).collect();
        cells.len()
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
        if self.pairs.len() < options.min_points.max(FREEDOMS) {
            Some(KeptPose::FewPoints)
        } else if self.inlier_share() < options.min_inlier_share && self.radius_mm >= options.inlier_mm {
            Some(KeptPose::FewInliers)
        } else {
            None
        }
    }
}
