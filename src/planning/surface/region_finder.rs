//! Tells which samples a region holds.

use std::collections::HashSet;

use nalgebra::{Point3, Vector3};

use crate::cell::FieldError;
use crate::geometry::{Aabb, Mesh, nearest_of_triangle};
use crate::planning::context::Refusal;
use crate::planning::params::{Region, RegionParams};

/// Distance from which on a region certainly holds nothing of a triangle, mm, of a part that lies within some metres: more than its border
/// is wide and samples are rounded by.
const SLACK_MM: f64 = 1e-3;
/// Width of a region's border as a share of the largest coordinate of the part, about 2⁻²²: twice what a vertex and a sample, each kept as
/// an f32, may be off together.
const BORDER_OF_COORDINATE: f64 = 2.4e-7;

/// A region, looked up in a mesh.
pub(in super::super) struct RegionFinder<'a> {
    /// Faces of the file, where the region is made of faces.
    source_faces: HashSet<u32>,
    region: &'a Region,
    border_mm: f64,
}

/// Width of the border of regions of a mesh, mm: what lies beyond a region by no more belongs to it, so that rounding takes no face out of
/// a region in whose border it lies.
pub(super) fn border_mm(mesh: &Mesh) -> f64 {
    let aabb = mesh.aabb();
    BORDER_OF_COORDINATE * aabb.min.coords.amax().max(aabb.max.coords.amax())
}

impl<'a> RegionFinder<'a> {
    /// A region of a mesh with a border of this width ([`border_mm`]).
    ///
    /// # Errors
    /// Faces or a group that the file does not have; `at` is where the region stands in the parameters.
    pub(in super::super) fn new(mesh: &Mesh, region: &'a Region, (at, border_mm): (&str, f64)) -> Result<Self, Vec<FieldError>> {
        let source_faces = match region {
            Region::Faces { faces } => named_faces(mesh, faces, at)?.collect(),
            Region::Name { name } => named_group(mesh, name, at)?.iter().copied().collect(),
            Region::Box { .. } | Region::Sphere { .. } | Region::HalfSpace { .. } | Region::Plane { .. } => HashSet::new(),
        };
        Ok(Self { source_faces, region, border_mm })
    }

    /// Returns true if it or its border holds a point on a face.
    pub(in super::super) fn holds(&self, source_face: u32, p: &Point3<f64>) -> bool {
        let border_mm = self.border_mm;
        let height_mm =
            |point_mm: &[f64; 3], normal: &[f64; 3]| (p - Point3::from(*point_mm)).dot(&Vector3::from(*normal).normalize());
        match self.region {
            Region::Box { min_mm, max_mm } => {
                (0..3).all(|axis| min_mm[axis] - border_mm <= p[axis] && p[axis] <= max_mm[axis] + border_mm)
            }
            Region::Sphere { centre_mm, radius_mm } => (p - Point3::from(*centre_mm)).norm() <= *radius_mm + border_mm,
            Region::HalfSpace { point_mm, normal } => height_mm(point_mm, normal) <= border_mm,
            Region::Plane { point_mm, normal, within_mm } => height_mm(point_mm, normal).abs() <= *within_mm + border_mm,
            Region::Faces { .. } | Region::Name { .. } => self.source_faces.contains(&source_face),
        }
    }

    /// Returns true if it or its border holds all of a triangle on a face: each kind is convex, or made of whole faces.
    pub(super) fn holds_all_of(&self, source_face: u32, corners: &[Point3<f64>; 3]) -> bool {
        corners.iter().all(|corner| self.holds(source_face, corner))
    }

    /// Returns false where it certainly holds no point of a triangle of a face.
    pub(super) fn may_hold_some_of(&self, source_face: u32, corners: &[Point3<f64>; 3]) -> bool {
        let slack_mm = SLACK_MM.max(2.0 * self.border_mm);
        let heights_mm = |point_mm: &[f64; 3], normal: &[f64; 3]| {
            let (point, normal) = (Point3::from(*point_mm), Vector3::from(*normal).normalize());
            corners.map(|corner| (corner - point).dot(&normal))
        };
        match self.region {
            Region::Box { min_mm, max_mm } => {
                let around = Aabb::around(corners);
                let overlaps =
                    |axis: usize| min_mm[axis] - slack_mm <= around.max[axis] && around.min[axis] <= max_mm[axis] + slack_mm;
                (0..3).all(overlaps)
            }
            Region::Sphere { centre_mm, radius_mm } => {
                let centre = Point3::from(*centre_mm);
                (nearest_of_triangle(corners, &centre).0 - centre).norm() <= *radius_mm + slack_mm
            }
            Region::HalfSpace { point_mm, normal } => heights_mm(point_mm, normal).iter().any(|height_mm| *height_mm <= slack_mm),
            Region::Plane { point_mm, normal, within_mm } => {
                let (heights_mm, reach_mm) = (heights_mm(point_mm, normal), within_mm + slack_mm);
                heights_mm.iter().any(|height_mm| *height_mm <= reach_mm)
                    && heights_mm.iter().any(|height_mm| *height_mm >= -reach_mm)
            }
            Region::Faces { .. } | Region::Name { .. } => self.source_faces.contains(&source_face),
        }
    }
}

/// The excluded regions, looked up in a mesh.
///
/// # Errors
/// Faces or a group that the file does not have.
pub(super) fn excluded<'a>(mesh: &Mesh, regions: &'a RegionParams) -> Result<Vec<RegionFinder<'a>>, Vec<FieldError>> {
    let border_mm = border_mm(mesh);
    let finder = |(index, region): (usize, &'a Region)| {
        let at = format!("/regions/exclude/{index}");
        RegionFinder::new(mesh, region, (at.as_str(), border_mm))
    };
    regions.exclude.iter().enumerate().map(finder).collect()
}

fn named_faces<'f>(mesh: &Mesh, faces: &'f [u32], at: &str) -> Result<impl Iterator<Item = u32> + 'f, Vec<FieldError>> {
    // Degenerate faces are dropped when a file is read: how many it had after this one is not known.
    let last_face = mesh.source_face.last().copied().unwrap_or_default();
    match faces.iter().find(|face| **face > last_face) {
        Some(beyond) => {
            let no_face = Refusal::NoSuchFace { face: *beyond, last_face };
            Err(vec![FieldError { pointer: format!("{at}/faces"), detail: no_face.to_string() }])
        }
        None => Ok(faces.iter().copied()),
    }
}

fn named_group<'m>(mesh: &'m Mesh, name: &str, at: &str) -> Result<&'m [u32], Vec<FieldError>> {
    mesh.groups.iter().find(|group| group.name == name).map(|group| group.source_faces.as_slice()).ok_or_else(|| {
        let (name, known) = (name.to_owned(), mesh.groups.iter().map(|group| group.name.clone()).take(20).collect::<Vec<_>>());
        let no_group = if known.is_empty() { Refusal::NoGroups { name } } else { Refusal::NoSuchGroup { name, known } };
        vec![FieldError { pointer: format!("{at}/name"), detail: no_group.to_string() }]
    })
}
