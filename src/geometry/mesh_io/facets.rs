//! Triangles of a piece of an STL file. The format writes out every corner; exactly equal ones are made one while they are in
//! the cache, so that few are left for the whole file to weld.

use nalgebra::Point3;

use super::error::{MeshError, Position};
use super::soup::{Soup, bits, millimetres};
use crate::geometry::id_table::IdTable;
use crate::geometry::poll::Poll;

/// Triangles with their places in the file.
pub(super) struct Facets {
    unit_mm: f64,
    ids: IdTable,
    vertices_mm: Vec<Point3<f64>>,
    triangles: Vec<([u32; 3], Position)>,
}

impl Facets {
    /// Room for about so many triangles.
    pub(super) fn new(unit_mm: f64, triangles: usize) -> Self {
        Self {
            unit_mm,
            ids: IdTable::for_items(triangles),
            vertices_mm: Vec::with_capacity(triangles),
            triangles: Vec::with_capacity(triangles),
        }
    }

    /// Adds a corner at `xyz`, in units of the file, unless there is one; the number of either.
    pub(super) fn corner(&mut self, xyz: [f64; 3], at: Position, poll: &Poll<'_>) -> Result<u32, MeshError> {
        let vertex_mm = millimetres(xyz, self.unit_mm, at)?;
        poll.spend(50)?;
        let (next, vertices_mm) = (self.vertices_mm.len() as u32, &self.vertices_mm);
        let known = |id: u32| bits(vertices_mm.get(id as usize).unwrap_or(&vertex_mm));
        let id = self.ids.id(&bits(&vertex_mm), next, known, poll)?;
        if id == next {
            self.vertices_mm.push(vertex_mm);
        }
        Ok(id)
    }

    pub(super) fn triangle(&mut self, corners: [u32; 3], at: Position) {
        self.triangles.push((corners, at));
    }

    pub(super) fn count(&self) -> usize {
        self.triangles.len()
    }

    /// Hands everything over.
    pub(super) fn into_soup(self, soup: &mut Soup<'_>) -> Result<(), MeshError> {
        soup.take_triangles(self.vertices_mm, self.triangles)
    }
}
