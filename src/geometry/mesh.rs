//! The triangle mesh every stage works on: welded, without degenerate triangles, in millimetres, part frame.

use super::parallel;
use nalgebra::{Point3, Vector3};

/// Axis-aligned bounding box in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lowest corner.
    pub min: Point3<f64>,
    /// Highest corner.
    pub max: Point3<f64>,
}

impl Aabb {
    /// The box of no points: joins as the neutral element.
    #[must_use]
    pub fn empty() -> Self {
        Self { min: Point3::from([f64::INFINITY; 3]), max: Point3::from([f64::NEG_INFINITY; 3]) }
    }

    /// Smallest box around `points`.
    #[must_use]
    pub fn around<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> Self {
        points.into_iter().fold(Self::empty(), |aabb, p| aabb.with(p))
    }

    /// This box grown to hold `point`.
    #[must_use]
    pub fn with(&self, point: &Point3<f64>) -> Self {
        Self { min: self.min.inf(point), max: self.max.sup(point) }
    }

    /// Returns true if `point` lies in the box, its faces included.
    #[must_use]
    pub fn holds(&self, point: &Point3<f64>) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
    }

    /// Edge lengths.
    #[must_use]
    pub fn extent_mm(&self) -> Vector3<f64> {
        self.max - self.min
    }

    /// Middle of the box.
    #[must_use]
    pub fn centre(&self) -> Point3<f64> {
        nalgebra::center(&self.min, &self.max)
    }
}

/// A triangle mesh. Invariants: every index is in range, every coordinate finite, no triangle degenerate.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Vertex positions, millimetres, part frame.
    pub vertices_mm: Vec<Point3<f64>>,
    /// Vertex indices a triangle, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Face of the uploaded file that each triangle came from (a fan-triangulated polygon gives several).
    pub source_face: Vec<u32>,
    /// Named groups of the file (`g` and `o` lines of OBJ), empty for formats without.
    pub groups: Vec<FaceGroup>,
}

/// A named set of faces of the uploaded file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaceGroup {
    /// The name in the file.
    pub name: String,
    /// Faces of the uploaded file, ascending.
    pub source_faces: Vec<u32>,
}

impl Mesh {
    /// Corners of triangle `face`.
    #[must_use]
    pub fn corners(&self, face: usize) -> [Point3<f64>; 3] {
        self.faces[face].map(|v| self.vertices_mm[v as usize])
    }

    /// Twice the area of triangle `face` times its unit normal.
    #[must_use]
    pub fn scaled_normal(&self, face: usize) -> Vector3<f64> {
        let [a, b, c] = self.corners(face);
        (b - a).cross(&(c - a))
    }

    /// Area of triangle `face`.
    #[must_use]
    pub fn face_area_mm2(&self, face: usize) -> f64 {
        0.5 * self.scaled_normal(face).norm()
    }

    /// Area of the whole surface.
    #[must_use]
    pub fn area_mm2(&self) -> f64 {
        self.face_areas_mm2().iter().sum()
    }

    /// Area of every triangle, in their order.
    #[must_use]
    pub(crate) fn face_areas_mm2(&self) -> Vec<f64> {
        parallel::map_range(self.faces.len(), |face| self.face_area_mm2(face))
    }

    /// Bounding box.
    #[must_use]
    pub fn aabb(&self) -> Aabb {
        Aabb::around(&self.vertices_mm)
    }
}

#[cfg(test)]
impl Mesh {
    /// Several meshes as one.
    pub(crate) fn joined(parts: &[Mesh]) -> Mesh {
        let mut all = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
        for part in parts {
            let first = all.vertices_mm.len() as u32;
            all.vertices_mm.extend(&part.vertices_mm);
            all.faces.extend(part.faces.iter().map(|face| face.map(|corner| corner + first)));
        }
        all.source_face = (0..all.faces.len() as u32).collect();
        all
    }
}
