//! Open sky: the directions in which a line from a surface point leaves the part. A point without any is enclosed, whatever
//! scanner looks for it; one whose open directions all begin below the plate can be measured only when the part is turned over
//! ([`crate::planning::method::causes`]).
//!
//! Directions are spread evenly over the half-space in front of the point, few at first, and [`DIRECTIONS`] where those are
//! hidden: about 4° apart, so that an opening narrower than that may be overlooked. Cost: at most that many rays a point.

#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::candidates::{spiral, stands_above};
use super::ids::SampleId;
use super::surface::Surface;
use crate::geometry::{Mesh, Part, Pose, RayScene, SimdLevel, Table};

/// Directions that are looked into.
const DIRECTIONS: usize = 1024;
/// Stride of the directions that are looked into first.
const STRIDE: usize = 16;
/// Height above the surface at which lines begin, mm: clear of the point's own facet.
const ABOVE_MM: f64 = 0.02;

/// Largest distance from the plate of a sample that the part rests on, mm.
const RESTING_WITHIN_MM: f64 = 0.1;
/// Cosine below which such a sample faces down: within 8° of the vertical.
const RESTING_NORMAL_COS: f64 = -0.99;

/// Returns true if a sample belongs to the faces that the part stands on.
#[must_use]
pub(super) fn stands_on(surface: &Surface, sample: SampleId, table_from_part: &Pose<Table, Part>) -> bool {
    let height_mm = table_from_part.point(&surface.sample_mm[sample.index()]).z;
    let down = table_from_part.direction(&surface.patch_of(sample).normal).z;
    height_mm.abs() <= RESTING_WITHIN_MM && down <= RESTING_NORMAL_COS
}

/// Sky of a surface point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sky {
    /// A line leaves the part, and not only from below the plate.
    Open,
    /// Lines that a device could look along leave the part, but only from viewpoints below the plate.
    BelowPlate,
    /// No line leaves the part.
    Closed,
}

/// A part whose points are asked for their sky.
pub(super) struct SkyProbe<'a> {
    part: &'a RayScene,
    level: SimdLevel,
    /// Distance that is beyond the part from any of its points, mm.
    beyond_mm: f64,
    /// Directions in front of a surface that faces +z.
    directions: Vec<Vector3<f64>>,
    /// Poses of the part whose plates hide what is below them; empty without a plate.
    setups: &'a [Pose<Table, Part>],
    /// Smallest elevation of a viewpoint over such a plate.
    min_elevation_deg: f64,
    /// Distance at which a viewpoint stands, mm, and the cosine of the largest incidence.
    best_mm: f64,
    min_cos: f64,
}

impl<'a> SkyProbe<'a> {
    /// `part` is the scene of `mesh` alone. A viewpoint stands `best_mm` away, at an incidence of at most `incidence_max_rad`,
    /// and over each plate at an elevation of at least `min_elevation_deg`.
    pub(super) fn new(
        mesh: &Mesh,
        part: &'a RayScene,
        (setups, min_elevation_deg): (&'a [Pose<Table, Part>], f64),
        best_mm: f64,
        incidence_max_rad: f64,
        level: SimdLevel,
    ) -> Self {
        let beyond_mm = mesh.aabb().extent_mm().norm() + 1.0;
        let evenly: Vec<_> = spiral(DIRECTIONS, 0.0).collect();
        // Every `STRIDE`th first: each such part is spread over the half-space too.
        let directions = (0..STRIDE).flat_map(|first| evenly.iter().skip(first).step_by(STRIDE).copied()).collect();
        Self { part, level, beyond_mm, directions, setups, min_elevation_deg, best_mm, min_cos: incidence_max_rad.cos() }
    }

    /// The sky of a surface point with this unit normal; part frame, mm.
    pub(super) fn sky(&self, point_mm: &Point3<f64>, normal: &Vector3<f64>) -> Sky {
        let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let part_from_point = UnitQuaternion::rotation_between(&Vector3::z(), normal).unwrap_or_else(half_turn);
        let from_mm = point_mm + normal * ABOVE_MM;
        let mut sky = Sky::Closed;
        let mut hidden = Vec::new();
        for batch in self.directions.chunks(DIRECTIONS / STRIDE) {
            let directions: Vec<_> = batch.iter().map(|direction| part_from_point * direction).collect();
            let ends: Vec<_> = directions.iter().map(|direction| from_mm + direction * self.beyond_mm).collect();
            self.part.blocked_from(self.level, &from_mm, &ends, 1.0, &mut hidden);
            for (direction, _) in directions.iter().zip(&hidden).filter(|(_, hidden)| !**hidden) {
                let usable = normal.dot(direction) >= self.min_cos;
                if self.setups.is_empty() || usable && self.is_above(point_mm, direction) {
                    return Sky::Open;
                }
                if usable || sky == Sky::Closed {
                    sky = if usable { Sky::BelowPlate } else { Sky::Open };
                }
            }
        }
        sky
    }

    /// Returns true if the viewpoint in this direction stands above the plate in some setup.
    fn is_above(&self, point_mm: &Point3<f64>, direction: &Vector3<f64>) -> bool {
        let viewpoint_mm = point_mm + direction * self.best_mm;
        self.setups.iter().any(|table_from_part| stands_above(&table_from_part.point(&viewpoint_mm), self.min_elevation_deg))
    }
}
