//! Vertex clustering: every vertex moves to the representative of its grid cell, triangles that span fewer than three
//! cells vanish, equal triangles merge.

use std::collections::HashMap;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::{Drawn, FaceLists, NOT_DRAWN};
use crate::geometry::{Aabb, Mesh};

/// Cells along the longest edge are searched below this; three such indices fit a 64-bit key.
const MAX_CELLS: u64 = 1 << 20;
/// A quadric's direction counts when its eigenvalue is above this share of the largest: flatter ones carry no shape.
const EIGEN_FLOOR: f64 = 1e-3;

/// Thins `mesh` to at most `max_triangles` by the finest grid that allows it.
pub(super) fn decimate(mesh: &Mesh, max_triangles: usize) -> Drawn {
    let grid = finest_grid(mesh, max_triangles);
    let clusters = Clusters::gather(mesh, &grid);
    let (faces, mut face_of_triangle) = surviving_faces(mesh, &clusters);
    adopt_vanished(mesh, &clusters, &faces, &mut face_of_triangle);
    compact(&clusters.positions(mesh, &grid), faces, face_of_triangle)
}

struct Grid {
    origin_mm: Point3<f64>,
    cell_mm: f64,
}

impl Grid {
    fn over(aabb: &Aabb, cells: u64) -> Self {
        let longest_mm = aabb.extent_mm().max();
        // A hair wider, so that the far side of the box falls into the last cell and not beyond it.
        Self { origin_mm: aabb.min, cell_mm: longest_mm / cells as f64 * (1.0 + 1e-9) }
    }

    fn index(&self, p: &Point3<f64>) -> [u64; 3] {
        ((p - self.origin_mm) / self.cell_mm).map(|c| c.max(0.0) as u64).into()
    }

    fn key(&self, p: &Point3<f64>) -> u64 {
        let [x, y, z] = self.index(p);
        (x << 42) | (y << 21) | z
    }

    /// Lowest corner of the cell that holds `p`.
    fn corner_mm(&self, p: &Point3<f64>) -> Point3<f64> {
        self.origin_mm + Vector3::from(self.index(p).map(|c| c as f64)) * self.cell_mm
    }
}

/// The largest number of cells along the longest edge, to within a fiftieth, at which at most `max_triangles` survive.
fn finest_grid(mesh: &Mesh, max_triangles: usize) -> Grid {
    let aabb = mesh.aabb();
    let fits = |cells| survivors(mesh, &Grid::over(&aabb, cells)) <= max_triangles;
    let (mut low, mut high) = (1, 2);
    while high < MAX_CELLS && fits(high) {
        (low, high) = (high, high * 2);
    }
    while high - low > 1.max(low / 50) {
        let middle = low.midpoint(high);
        if fits(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Grid::over(&aabb, low)
}

/// Triangles that span three cells, equal ones counted each: never fewer than what remains.
fn survivors(mesh: &Mesh, grid: &Grid) -> usize {
    let keys: Vec<u64> = mesh.vertices_mm.iter().map(|p| grid.key(p)).collect();
    mesh.faces.iter().filter(|face| distinct(face.map(|v| keys[v as usize]))).count()
}

fn distinct<T: PartialEq>([a, b, c]: [T; 3]) -> bool {
    a != b && b != c && a != c
}

struct Clusters {
    /// Cluster of each vertex.
    of_vertex: Vec<u32>,
    /// First vertex of each cluster.
    first_vertex: Vec<u32>,
    count: usize,
}

impl Clusters {
    fn gather(mesh: &Mesh, grid: &Grid) -> Self {
        let mut by_key = HashMap::new();
        let mut first_vertex = Vec::new();
        let of_vertex = mesh
            .vertices_mm
            .iter()
            .zip(0u32..)
            .map(|(p, vertex)| {
                *by_key.entry(grid.key(p)).or_insert_with(|| {
                    first_vertex.push(vertex);
                    first_vertex.len() as u32 - 1
                })
            })
            .collect();
        Self { of_vertex, count: first_vertex.len(), first_vertex }
    }

    fn of_face(&self, face: &[u32; 3]) -> [u32; 3] {
        face.map(|v| self.of_vertex[v as usize])
    }

    /// Vertex of each cluster: the point nearest to the planes of its triangles, within its cell.
    fn positions(&self, mesh: &Mesh, grid: &Grid) -> Vec<[f32; 3]> {
        let mut quadrics = vec![Quadric::default(); self.count];
        let origins: Vec<Point3<f64>> = self.first_vertex.iter().map(|v| mesh.vertices_mm[*v as usize]).collect();
        for (vertex, cluster) in self.of_vertex.iter().enumerate() {
            let cluster = *cluster as usize;
            quadrics[cluster].add_vertex(mesh.vertices_mm[vertex] - origins[cluster]);
        }
        for face in 0..mesh.faces.len() {
            let normal = mesh.scaled_normal(face);
            for vertex in mesh.faces[face] {
                let cluster = self.of_vertex[vertex as usize] as usize;
                quadrics[cluster].add_plane(normal, mesh.vertices_mm[vertex as usize] - origins[cluster]);
            }
        }
        let place = |(quadric, origin): (&Quadric, &Point3<f64>)| {
            let corner = grid.corner_mm(origin);
            let fitted = origin + quadric.minimum();
            let inside = fitted.coords.zip_zip_map(&corner.coords, &corner.coords, |c, low, _| c.clamp(low, low + grid.cell_mm));
            inside.map(|c| c as f32).into()
        };
        quadrics.iter().zip(&origins).map(place).collect()
    }
}

/// Σ (n·(x − p))², n weighted by area, about the mean of the vertices.
#[derive(Clone, Default)]
struct Quadric {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    vertex_sum: Vector3<f64>,
    vertices: f64,
}

impl Quadric {
    fn add_vertex(&mut self, p: Vector3<f64>) {
        self.vertex_sum += p;
        self.vertices += 1.0;
    }

    fn add_plane(&mut self, normal: Vector3<f64>, p: Vector3<f64>) {
        self.a += normal * normal.transpose();
        self.b += normal * normal.dot(&p);
    }

    /// The least-squares point nearest to the mean vertex: directions that no plane fixes keep the mean's coordinate.
    fn minimum(&self) -> Vector3<f64> {
        let mean = self.vertex_sum / self.vertices;
        let residual = self.b - self.a * mean;
        let eigen = SymmetricEigen::new(self.a);
        let floor = eigen.eigenvalues.max() * EIGEN_FLOOR;
        eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
            .filter(|(value, _)| **value > floor)
            .fold(mean, |at, (value, axis)| at + axis * (axis.dot(&residual) / value))
    }
}

/// Faces as cluster triples, equal ones (same winding) merged, and which of them each triangle became.
fn surviving_faces(mesh: &Mesh, clusters: &Clusters) -> (Vec<[u32; 3]>, Vec<u32>) {
    let mut faces = Vec::new();
    let mut by_corners = HashMap::new();
    let mut face_of_triangle = vec![NOT_DRAWN; mesh.faces.len()];
    for (triangle, corners) in mesh.faces.iter().enumerate() {
        let corners = lowest_first(clusters.of_face(corners));
        if distinct(corners) {
            face_of_triangle[triangle] = *by_corners.entry(corners).or_insert_with(|| {
                faces.push(corners);
                faces.len() as u32 - 1
            });
        }
    }
    (faces, face_of_triangle)
}

/// The triangle beginning at its lowest index, winding kept.
fn lowest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    match a.min(b).min(c) {
        low if low == a => [a, b, c],
        low if low == b => [b, c, a],
        _ => [c, a, b],
    }
}

/// Gives each vanished triangle to the surviving one at the same cluster that faces most nearly its way.
fn adopt_vanished(mesh: &Mesh, clusters: &Clusters, faces: &[[u32; 3]], face_of_triangle: &mut [u32]) {
    let mut normals = vec![Vector3::<f64>::zeros(); faces.len()];
    for (triangle, face) in face_of_triangle.iter().enumerate().filter(|(_, face)| **face != NOT_DRAWN) {
        normals[*face as usize] += mesh.scaled_normal(triangle);
    }
    let at_cluster = FaceLists::around(faces, clusters.count);
    for (triangle, adopted) in face_of_triangle.iter_mut().enumerate().filter(|(_, face)| **face == NOT_DRAWN) {
        let normal = mesh.scaled_normal(triangle);
        let agreement = |face: u32| normals[face as usize].try_normalize(0.0).map_or(-1.0, |n| n.dot(&normal));
        *adopted = clusters
            .of_face(&mesh.faces[triangle])
            .iter()
            .flat_map(|cluster| at_cluster.of(*cluster as usize))
            .copied()
            .max_by(|x, y| agreement(*x).total_cmp(&agreement(*y)).then(y.cmp(x)))
            .unwrap_or(NOT_DRAWN);
    }
}

/// Leaves out the clusters that no face uses.
fn compact(all_positions_mm: &[[f32; 3]], mut faces: Vec<[u32; 3]>, face_of_triangle: Vec<u32>) -> Drawn {
    let mut renamed = vec![u32::MAX; all_positions_mm.len()];
    let mut positions_mm = Vec::new();
    for corner in faces.iter_mut().flatten() {
        let name = &mut renamed[*corner as usize];
        if *name == u32::MAX {
            *name = positions_mm.len() as u32;
            positions_mm.push(all_positions_mm[*corner as usize]);
        }
        *corner = *name;
    }
    Drawn { positions_mm, faces, face_of_triangle }
}
