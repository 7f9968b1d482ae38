//! Triangle soup of a file: coordinates converted to millimetres, equal vertices welded, polygons cut into fans, all within
//! limits.

use std::hash::Hash;

use nalgebra::Point3;

use super::error::{MeshError, Position};
use super::{LengthUnit, Limits};
use crate::geometry::id_table::IdTable;
use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::{FaceGroup, Mesh};

/// Largest coordinate, 1000 km: no part is larger, and no sum or product of such coordinates overflows.
const MAX_COORDINATE_MM: f64 = 1e9;

/// Triangle soup that a reader fills. A vertex added by [`Soup::welded_vertex`] shares its index with the first one of exactly
/// equal coordinates; this is for formats that write out every corner. Other vertices stay as the file has them until
/// [`Soup::weld_equal`], so that the file's text and a table of its vertices are not held in memory together.
pub(super) struct Soup<'a> {
    limits: &'a Limits,
    pub(super) poll: &'a Poll<'a>,
    unit_mm: f64,
    ids: IdTable,
    mesh: Mesh,
    faces_in_file: u32,
}

impl<'a> Soup<'a> {
    pub(super) fn new(unit: LengthUnit, limits: &'a Limits, poll: &'a Poll<'a>) -> Self {
        let mesh = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
        Self { limits, poll, unit_mm: unit.mm(), ids: IdTable::new(), mesh, faces_in_file: 0 }
    }

    /// Adds a vertex at `xyz`, in units of the file; returns its index.
    pub(super) fn vertex(&mut self, xyz: [f64; 3], at: Position) -> Result<u32, MeshError> {
        let vertex_mm = self.millimetres(xyz, at)?;
        self.push(vertex_mm, at)
    }

    /// Adds a vertex like [`Soup::vertex`], unless an exactly equal one was welded before; returns the index of either.
    pub(super) fn welded_vertex(&mut self, xyz: [f64; 3], at: Position) -> Result<u32, MeshError> {
        let vertex_mm = self.millimetres(xyz, at)?;
        self.poll.spend(80)?;
        let (next, vertices_mm) = (self.mesh.vertices_mm.len() as u32, &self.mesh.vertices_mm);
        let known = |id: u32| if id == next { bits(&vertex_mm) } else { bits(&vertices_mm[id as usize]) };
        let id = self.ids.id(&bits(&vertex_mm), next, known, self.poll)?;
        if id == next { self.push(vertex_mm, at) } else { Ok(id) }
    }

    fn millimetres(&self, xyz: [f64; 3], at: Position) -> Result<Point3<f64>, MeshError> {
        // Adding zero turns -0 into 0, so that both are one vertex.
        let xyz_mm = xyz.map(|value| value * self.unit_mm + 0.0);
        for value_mm in xyz_mm {
            if !value_mm.is_finite() {
                return Err(MeshError::NotFinite { at, found: value_mm.to_string() });
            }
            if value_mm.abs() > MAX_COORDINATE_MM {
                return Err(MeshError::OutOfRange { at, value_mm, limit_mm: MAX_COORDINATE_MM });
            }
        }
        Ok(Point3::from(xyz_mm))
    }

    fn push(&mut self, vertex_mm: Point3<f64>, at: Position) -> Result<u32, MeshError> {
        let limit = self.limits.max_triangles.saturating_mul(3).min(u32::MAX as usize);
        let next = self.mesh.vertices_mm.len();
        if next >= limit {
            return Err(MeshError::TooLarge { at, what: "vertices", limit });
        }
        self.poll.spend(10)?;
        self.mesh.vertices_mm.push(vertex_mm);
        Ok(next as u32)
    }

    /// Adds the next face of the file, as a fan of triangles around its first corner.
    pub(super) fn face(&mut self, corners: &[u32], at: Position) -> Result<(), MeshError> {
        for pair in corners.windows(2).skip(1) {
            if self.mesh.faces.len() >= self.limits.max_triangles {
                return Err(MeshError::TooLarge { at, what: "triangles", limit: self.limits.max_triangles });
            }
            self.poll.spend(10)?;
            self.mesh.faces.push([corners[0], pair[0], pair[1]]);
            self.mesh.source_face.push(self.faces_in_file);
        }
        self.faces_in_file += 1;
        Ok(())
    }

    /// Index that the next face of the file gets.
    pub(super) fn next_face(&self) -> u32 {
        self.faces_in_file
    }

    /// Number of vertices.
    pub(super) fn vertices(&self) -> usize {
        self.mesh.vertices_mm.len()
    }

    /// Welds vertices of exactly equal coordinates, each to the first of them.
    pub(super) fn weld_equal(&mut self) -> Result<(), Interrupted> {
        self.weld(bits)
    }

    /// Welds vertices that differ by less than the resolution of a 32-bit float at the size of the part. This is for STL, which
    /// has no vertex indices: CAD systems write the same point as 0 in one facet and as 1e-17 in the next, and the part would
    /// fall to pieces. A vertex moves only onto the first one in its grid cell.
    pub(super) fn weld_float_noise(&mut self) -> Result<(), Interrupted> {
        let mut largest_mm = 0.0_f64;
        for vertex in &self.mesh.vertices_mm {
            self.poll.spend(2)?;
            largest_mm = largest_mm.max(vertex.coords.amax());
        }
        let cell_mm = largest_mm * f64::from(f32::EPSILON) / 2.0;
        if cell_mm == 0.0 {
            return Ok(());
        }
        self.weld(|v| [v.x, v.y, v.z].map(|value| (value / cell_mm).round() as i64))
    }

    /// Replaces each vertex by the first one with the same key.
    fn weld<K: Hash + Eq>(&mut self, key: impl Fn(&Point3<f64>) -> K) -> Result<(), Interrupted> {
        let vertices_mm = &self.mesh.vertices_mm;
        // The table of equal vertices is no longer needed; freeing it first leaves room for the new one.
        self.ids = IdTable::new();
        let mut cells = IdTable::for_items(vertices_mm.len());
        let mut first_of_cell = Vec::with_capacity(vertices_mm.len());
        for (vertex, id) in vertices_mm.iter().zip(0..) {
            self.poll.spend(80)?;
            first_of_cell.push(cells.id(&key(vertex), id, |id| key(&vertices_mm[id as usize]), self.poll)?);
        }
        drop(cells);
        for vertex in self.mesh.faces.iter_mut().flatten() {
            self.poll.spend(2)?;
            *vertex = first_of_cell[*vertex as usize];
        }
        Ok(())
    }

    /// The collected mesh, still with degenerate triangles and unused vertices.
    pub(super) fn into_mesh(self, groups: Vec<FaceGroup>) -> Mesh {
        Mesh { groups, ..self.mesh }
    }
}

/// Bits of the coordinates: the same for equal coordinates, since none is -0.
fn bits(vertex_mm: &Point3<f64>) -> [u64; 3] {
    [vertex_mm.x, vertex_mm.y, vertex_mm.z].map(f64::to_bits)
}
