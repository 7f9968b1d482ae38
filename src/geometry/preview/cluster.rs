//! Vertex clustering: every vertex moves to the representative of its grid cell, triangles that span fewer than three
//! cells collapse, equal triangles merge.

use std::collections::HashMap;
use std::ops::Range;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::{FaceLists, NOT_DRAWN, Simplified};
use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::side_by_side::{self, PIECE};
use crate::geometry::{Aabb, Mesh, RandomHash};

/// Upper limit of the search for the number of cells along the longest edge; three such indices fit a 64-bit key.
const MAX_CELLS: u64 = 1 << 20;
/// A quadric's direction counts when its eigenvalue is above this share of the largest; along flatter ones there is no shape.
const EIGEN_FLOOR: f64 = 1e-3;

/// Max faces of a cluster that are tested for a triangle that collapsed there. Clusters have about six faces; one has more
/// where many faces share a corner.
const MAX_TESTED_FACES: usize = 64;
/// Number that stands for no cluster.
const NONE: u32 = u32::MAX;

/// Simplifies `mesh` to at most `max_triangles` faces with the finest grid that allows it.
pub(super) fn decimate(mesh: &Mesh, max_triangles: usize, poll: &Poll<'_>) -> Result<Simplified, Interrupted> {
    let grid = finest_grid(mesh, max_triangles, poll)?;
    let clusters = Clusters::gather(mesh, &keys(mesh, &grid, poll)?, poll)?;
    let (faces, mut face_of_triangle) = surviving_faces(mesh, &clusters, poll)?;
    assign_collapsed(mesh, &clusters, &faces, &mut face_of_triangle, poll)?;
    Ok(compact(&clusters.positions(mesh, &grid, poll)?, faces, face_of_triangle))
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

/// Grid with the max number of cells along the longest edge, to within 2 %, at which at most `max_triangles` survive.
fn finest_grid(mesh: &Mesh, max_triangles: usize, poll: &Poll<'_>) -> Result<Grid, Interrupted> {
    poll.check()?;
    let aabb = mesh.aabb();
    let fits = |cells| Ok(survivors(mesh, &Grid::over(&aabb, cells), poll)? <= max_triangles);
    let (mut low, mut high) = (1, 2);
    while high < MAX_CELLS && fits(high)? {
        (low, high) = (high, high * 2);
    }
    while high - low > 1.max(low / 50) {
        let middle = low.midpoint(high);
        if fits(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(Grid::over(&aabb, low))
}

/// Number of triangles that span three cells, duplicates included: an upper bound on what remains.
fn survivors(mesh: &Mesh, grid: &Grid, poll: &Poll<'_>) -> Result<usize, Interrupted> {
    let keys = keys(mesh, grid, poll)?;
    let spans = |face: &&[u32; 3]| distinct(face.map(|vertex| keys[vertex as usize]));
    let of_piece = |faces: &Range<usize>| mesh.faces[faces.clone()].iter().filter(spans).count();
    Ok(side_by_side::map(&side_by_side::ranges(mesh.faces.len()), of_piece, poll)?.into_iter().sum())
}

/// Key of each vertex's cell.
fn keys(mesh: &Mesh, grid: &Grid, poll: &Poll<'_>) -> Result<Vec<u64>, Interrupted> {
    let mut keys = vec![0; mesh.vertices_mm.len()];
    let pieces = keys.chunks_mut(PIECE).zip(mesh.vertices_mm.chunks(PIECE)).collect();
    let of_piece = |(keys, vertices_mm): &mut (&mut [u64], &[Point3<f64>])| {
        keys.iter_mut().zip(vertices_mm.iter()).for_each(|(key, vertex)| *key = grid.key(vertex));
    };
    side_by_side::for_each(pieces, of_piece, poll)?;
    Ok(keys)
}

fn distinct<T: PartialEq>([a, b, c]: [T; 3]) -> bool {
    a != b && b != c && a != c
}

/// Cells in which surviving faces have a corner.
struct Clusters {
    /// Cluster of each vertex, [`NONE`] where no surviving face has a corner.
    of_vertex: Vec<u32>,
    /// First vertex of each cluster, ascending.
    first_vertex: Vec<u32>,
}

impl Clusters {
    /// `key_of` holds the key of each vertex's cell.
    fn gather(mesh: &Mesh, key_of: &[u64], poll: &Poll<'_>) -> Result<Self, Interrupted> {
        let mut by_key = HashMap::with_hasher(RandomHash::new());
        for face in &mesh.faces {
            poll.spend(5)?;
            let keys = face.map(|vertex| key_of[vertex as usize]);
            if distinct(keys) {
                by_key.extend(keys.map(|key| (key, NONE)));
            }
        }
        let (mut of_vertex, mut first_vertex) = (Vec::with_capacity(mesh.vertices_mm.len()), Vec::new());
        for (key, number) in key_of.iter().zip(0..) {
            poll.spend(10)?;
            let cluster = by_key.get_mut(key).map(|cluster| {
                if *cluster == NONE {
                    *cluster = first_vertex.len() as u32;
                    first_vertex.push(number);
                }
                *cluster
            });
            of_vertex.push(cluster.unwrap_or(NONE));
        }
        Ok(Self { of_vertex, first_vertex })
    }

    fn of_face(&self, face: &[u32; 3]) -> [u32; 3] {
        face.map(|v| self.of_vertex[v as usize])
    }

    /// Vertex of each cluster: the point nearest to the planes of its triangles, within its cell.
    fn positions(&self, mesh: &Mesh, grid: &Grid, poll: &Poll<'_>) -> Result<Vec<[f32; 3]>, Interrupted> {
        let mut quadrics = vec![Quadric::default(); self.first_vertex.len()];
        let origins: Vec<Point3<f64>> = self.first_vertex.iter().map(|v| mesh.vertices_mm[*v as usize]).collect();
        for (vertex, cluster) in self.of_vertex.iter().enumerate().filter(|(_, cluster)| **cluster != NONE) {
            poll.spend(10)?;
            let cluster = *cluster as usize;
            quadrics[cluster].add_vertex(mesh.vertices_mm[vertex] - origins[cluster]);
        }
        for face in 0..mesh.faces.len() {
            poll.spend(50)?;
            let normal = mesh.scaled_normal(face);
            for vertex in mesh.faces[face].into_iter().filter(|vertex| self.of_vertex[*vertex as usize] != NONE) {
                let cluster = self.of_vertex[vertex as usize] as usize;
                quadrics[cluster].add_plane(normal, mesh.vertices_mm[vertex as usize] - origins[cluster]);
            }
        }
        let place = |(quadric, origin): (&Quadric, &Point3<f64>)| {
            poll.spend(1000)?;
            let corner = grid.corner_mm(origin);
            let fitted = origin + quadric.minimum();
            let inside = fitted.coords.zip_zip_map(&corner.coords, &corner.coords, |c, low, _| c.clamp(low, low + grid.cell_mm));
            Ok(inside.map(|c| c as f32).into())
        };
        quadrics.iter().zip(&origins).map(place).collect()
    }
}

/// Quadric error Σ (n·(x − p))², n weighted by area, with the mean of the vertices.
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

    /// Least-squares point nearest to the mean vertex: directions that no plane constrains keep the mean's coordinate.
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

/// Faces as triples of clusters, equal ones (same winding) merged, and for each triangle the face that it became.
fn surviving_faces(mesh: &Mesh, clusters: &Clusters, poll: &Poll<'_>) -> Result<(Vec<[u32; 3]>, Vec<u32>), Interrupted> {
    let mut faces = Vec::new();
    let mut by_corners = HashMap::with_hasher(RandomHash::new());
    let mut face_of_triangle = vec![NOT_DRAWN; mesh.faces.len()];
    for (triangle, corners) in mesh.faces.iter().enumerate() {
        poll.spend(30)?;
        // A triangle with a corner outside every cluster does not span three cells; else its cells would be clusters.
        let corners = clusters.of_face(corners);
        if distinct(corners) {
            let corners = lowest_first(corners);
            face_of_triangle[triangle] = *by_corners.entry(corners).or_insert_with(|| {
                faces.push(corners);
                faces.len() as u32 - 1
            });
        }
    }
    Ok((faces, face_of_triangle))
}

/// The triangle rotated to begin at its lowest index; its winding is kept.
fn lowest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    match a.min(b).min(c) {
        low if low == a => [a, b, c],
        low if low == b => [b, c, a],
        _ => [c, a, b],
    }
}

/// Assigns each collapsed triangle to the surviving face at one of its clusters whose normal is closest to its own. Of very
/// many faces, an evenly spread subset is tested.
fn assign_collapsed(
    mesh: &Mesh,
    clusters: &Clusters,
    faces: &[[u32; 3]],
    face_of_triangle: &mut [u32],
    poll: &Poll<'_>,
) -> Result<(), Interrupted> {
    let mut normals = vec![Vector3::<f64>::zeros(); faces.len()];
    for (triangle, face) in face_of_triangle.iter().enumerate().filter(|(_, face)| **face != NOT_DRAWN) {
        poll.spend(15)?;
        normals[*face as usize] += mesh.scaled_normal(triangle);
    }
    let normals: Vec<Option<Vector3<f64>>> = normals.iter().map(|normal| normal.try_normalize(0.0)).collect();
    let at_cluster = FaceLists::around(faces, clusters.first_vertex.len());
    let around = |cluster: u32| {
        let all = if cluster == NONE { &[] } else { at_cluster.of(cluster as usize) };
        all.iter().copied().step_by(all.len().div_ceil(MAX_TESTED_FACES).max(1))
    };
    let nearest = |triangle: usize| {
        let normal = mesh.scaled_normal(triangle);
        let agreement = |face: u32| normals[face as usize].map_or(-1.0, |n| n.dot(&normal));
        let found = clusters.of_face(&mesh.faces[triangle]).into_iter().flat_map(around).map(|face| (agreement(face), face));
        // On ties the lower index, so that the result does not depend on the order.
        let best = found.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        best.map_or(NOT_DRAWN, |(_, face)| face)
    };
    let of_piece = |(first, faces): &mut (usize, &mut [u32])| {
        let collapsed = (*first..).zip(faces.iter_mut()).filter(|(_, face)| **face == NOT_DRAWN);
        collapsed.for_each(|(triangle, face)| *face = nearest(triangle));
    };
    let pieces = (0..).step_by(PIECE).zip(face_of_triangle.chunks_mut(PIECE)).collect();
    side_by_side::for_each(pieces, of_piece, poll)
}

/// Drops the clusters that no face uses.
fn compact(all_positions_mm: &[[f32; 3]], mut faces: Vec<[u32; 3]>, face_of_triangle: Vec<u32>) -> Simplified {
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
    Simplified { positions_mm, faces, face_of_triangle }
}
