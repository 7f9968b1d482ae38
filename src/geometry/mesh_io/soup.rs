//! Collects the triangles of a file: coordinates to millimetres, equal vertices to one, polygons to fans, within limits.

use std::collections::HashMap;

use nalgebra::Point3;

use super::error::{MeshError, Position};
use super::{LengthUnit, Limits};
use crate::geometry::{FaceGroup, Mesh};

/// No part is larger than this (1000 km), and no sum or product below it overflows.
const MAX_COORDINATE_MM: f64 = 1e9;

/// What a reader fills. Vertices are welded when they are added: exactly equal coordinates share one number, in the
/// order of first appearance.
pub(super) struct Soup<'a> {
    limits: &'a Limits,
    unit_mm: f64,
    ids: HashMap<[u64; 3], u32>,
    mesh: Mesh,
    faces_in_file: u32,
}

impl<'a> Soup<'a> {
    pub(super) fn new(unit: LengthUnit, limits: &'a Limits) -> Self {
        let mesh = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
        Self { limits, unit_mm: unit.mm(), ids: HashMap::new(), mesh, faces_in_file: 0 }
    }

    /// Number of the vertex at `xyz`, in units of the file.
    pub(super) fn vertex(&mut self, xyz: [f64; 3], at: Position) -> Result<u32, MeshError> {
        // Adding zero makes -0 and 0 one vertex.
        let xyz_mm = xyz.map(|value| value * self.unit_mm + 0.0);
        for value_mm in xyz_mm {
            if !value_mm.is_finite() {
                return Err(MeshError::NotFinite { at, found: value_mm.to_string() });
            }
            if value_mm.abs() > MAX_COORDINATE_MM {
                return Err(MeshError::OutOfRange { at, value_mm, limit_mm: MAX_COORDINATE_MM });
            }
        }
        let limit = self.limits.max_triangles.saturating_mul(3).min(u32::MAX as usize);
        let next = self.mesh.vertices_mm.len();
        let id = *self.ids.entry(xyz_mm.map(f64::to_bits)).or_insert(next as u32);
        if id as usize == next {
            if next >= limit {
                return Err(MeshError::TooLarge { at, what: "vertices", limit });
            }
            self.mesh.vertices_mm.push(Point3::from(xyz_mm));
        }
        Ok(id)
    }

    /// The next face of the file, as a fan of triangles around its first corner.
    pub(super) fn face(&mut self, corners: &[u32], at: Position) -> Result<(), MeshError> {
        for pair in corners.windows(2).skip(1) {
            if self.mesh.faces.len() >= self.limits.max_triangles {
                return Err(MeshError::TooLarge { at, what: "triangles", limit: self.limits.max_triangles });
            }
            self.mesh.faces.push([corners[0], pair[0], pair[1]]);
            self.mesh.source_face.push(self.faces_in_file);
        }
        self.faces_in_file += 1;
        Ok(())
    }

    /// Number that the next face gets.
    pub(super) fn next_face(&self) -> u32 {
        self.faces_in_file
    }

    /// Welds vertices that differ by less than a 32-bit float can say at the size of the part. For STL, which has no
    /// vertex numbers: CAD systems write one point as 0 here and 1e-17 there, and the part would fall into pieces.
    /// No vertex moves but onto the first one of its grid cell.
    pub(super) fn weld_float_noise(&mut self) {
        let vertices_mm = &self.mesh.vertices_mm;
        let largest_mm = vertices_mm.iter().flat_map(|v| v.iter()).fold(0.0_f64, |largest, value| largest.max(value.abs()));
        let cell_mm = largest_mm * f64::from(f32::EPSILON) / 2.0;
        if cell_mm == 0.0 {
            return;
        }
        let mut cells = HashMap::with_capacity(vertices_mm.len());
        let first_of_cell: Vec<u32> = vertices_mm
            .iter()
            .zip(0..)
            .map(|(v, id)| *cells.entry([v.x, v.y, v.z].map(|value| (value / cell_mm).round() as i64)).or_insert(id))
            .collect();
        self.mesh.faces.iter_mut().flatten().for_each(|v| *v = first_of_cell[*v as usize]);
    }

    /// What was collected; degenerate triangles and unused vertices are still in it.
    pub(super) fn into_mesh(self, groups: Vec<FaceGroup>) -> Mesh {
        Mesh { groups, ..self.mesh }
    }
}
