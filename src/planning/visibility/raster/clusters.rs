//! The scene's triangles in clusters of 64 neighbours, each with its own few vertices, so that a cluster is projected
//! from about 600 bytes that lie together, and culled whole. Coordinates are f32, relative to the scene's centre, which keeps
//! them within 4e-6 mm on a part of 120 mm.
//!
//! A normal cone (Shirman and Abi-Ezzi 1993, *The Cone of Normals Technique for Fast Processing of Curved Patches*) tells
//! when a whole cluster faces away. Memory: about 18 bytes a triangle; at
//! worst, where no two triangles of a cluster share a vertex, 45.

use std::cell::Cell;

use nalgebra::{Point3, Vector3};

use super::pinhole::{LANES, PixelLanes};
use crate::geometry::{Aabb, Mesh, Poll, outward_faces, parallel};

/// Stands for no triangle.
pub(super) const NO_TRIANGLE: u32 = u32::MAX;
/// Triangles a cluster.
pub(super) const TRIANGLES: usize = 64;
/// Largest number of vertices of a cluster.
pub(super) const VERTICES: usize = 3 * TRIANGLES;

/// Triangles from which it pays to sort two halves in parallel.
const PARALLEL_HALVES: usize = 20_000;

/// All triangles of the scene.
pub(crate) struct Clusters {
    /// Origin of all coordinates here, part frame.
    pub(super) centre_mm: Point3<f64>,
    pub(super) clusters: Vec<Cluster>,
    /// Bounding box of the outward clusters, relative to the origin.
    pub(super) outward: Aabb,
    /// Number of triangles.
    pub(super) triangles: usize,
}

/// 64 triangles.
pub(super) struct Cluster {
    /// Coordinates in batches, by axis; the last batch is filled up with copies of the last vertex.
    pub(super) vertices: Box<[[PixelLanes; 3]]>,
    /// First, second and third corner of each triangle; beyond the last triangle all are 0.
    pub(super) corners: [[u8; TRIANGLES]; 3],
    /// Numbers of the triangles, counted over all meshes of the scene; `u32::MAX` beyond the last.
    pub(super) numbers: [u32; TRIANGLES],
    /// Is true if back faces may be left out when the device is outside.
    pub(super) outward: bool,
    /// Bounding box.
    pub(super) low_mm: [f32; 3],
    pub(super) high_mm: [f32; 3],
    pub(super) cone: Cone,
}

/// Holds the normals of a set of facets: all within an angle of an axis.
#[derive(Clone, Copy)]
pub(super) struct Cone {
    pub(super) axis: Vector3<f64>,
    /// Sine and cosine of the angle; a cosine of −1 where it is not below a right angle.
    pub(super) sin: f64,
    pub(super) cos: f64,
}

impl Cone {
    /// Around unit normals.
    pub(super) fn around<'a>(normals: impl Iterator<Item = &'a Vector3<f64>> + Clone) -> Self {
        let Some(axis) = normals.clone().sum::<Vector3<f64>>().try_normalize(1e-9) else { return Self::WHOLE };
        let cos = normals.map(|normal| normal.dot(&axis)).fold(1.0, f64::min) - 1e-6;
        if cos <= 0.0 { Self::WHOLE } else { Self { axis, sin: (1.0 - cos * cos).sqrt(), cos } }
    }

    const WHOLE: Self = Self { axis: Vector3::new(0.0, 0.0, 1.0), sin: 0.0, cos: -1.0 };

    /// Returns true if every facet with a normal of the cone and a point within `radius_mm` of the cone's place faces away from
    /// a point that lies at `to_mm` from that place: with β the angular radius of the ball, the angle between axis and
    /// direction is at least 90° + α + β.
    pub(super) fn faces_away(&self, to_mm: &Vector3<f64>, radius_mm: f64) -> bool {
        let tangent_squared = to_mm.norm_squared() - radius_mm * radius_mm;
        if self.cos < 0.0 || tangent_squared <= 0.0 {
            return false;
        }
        // α + β must stay below a right angle for the sine to tell.
        let tangent = tangent_squared.sqrt();
        self.cos * tangent > self.sin * radius_mm && self.axis.dot(to_mm) < -(self.sin * tangent + self.cos * radius_mm)
    }
}

impl Clusters {
    /// Numbers of all triangles, those of a cluster together.
    pub(super) fn order(&self) -> impl Iterator<Item = u32> {
        self.clusters.iter().flat_map(|cluster| cluster.numbers).filter(|number| *number != NO_TRIANGLE)
    }

    /// Clusters of all triangles of `meshes`, which share one frame.
    pub(crate) fn new<E: Send>(meshes: &[&Mesh], check: &(impl Fn() -> Result<(), E> + Sync)) -> Result<Self, E> {
        let order = &compact_order(meshes, check)?;
        let aabb = meshes.iter().fold(Aabb::empty(), |aabb, mesh| {
            let own = mesh.aabb();
            Aabb { min: aabb.min.inf(&own.min), max: aabb.max.sup(&own.max) }
        });
        let centre_mm = if order.is_empty() { Point3::origin() } else { aabb.centre() };
        let soup = Soup::new(meshes, centre_mm, check)?;
        let cluster = |triangles: &[u32]| {
            check()?;
            Ok(soup.cluster(triangles))
        };
        let clusters = parallel::try_map_chunks(order, TRIANGLES, cluster)?;
        let corner = |mm: &[f32; 3]| Point3::from(mm.map(f64::from));
        let outward = clusters.iter().filter(|cluster| cluster.outward);
        let outward =
            outward.fold(Aabb::empty(), |aabb, cluster| aabb.with(&corner(&cluster.low_mm)).with(&corner(&cluster.high_mm)));
        Ok(Self { centre_mm, clusters, outward, triangles: order.len() })
    }
}

/// Numbers of all triangles such that each 64 in a row lie close together: halved across the longest extent of their
/// middles, at a multiple of 64, until no more than 64 are left.
fn compact_order<E: Send>(meshes: &[&Mesh], check: &(impl Fn() -> Result<(), E> + Sync)) -> Result<Vec<u32>, E> {
    let middle = |mesh: &Mesh, face: usize| mesh.corners(face).iter().map(|p| p.coords).sum::<Vector3<f64>>().cast::<f32>();
    let middles = meshes.iter().flat_map(|mesh| (0..mesh.faces.len()).map(|face| middle(mesh, face)));
    let mut numbered: Vec<_> = (0..).zip(middles).collect();
    halve(&mut numbered, check)?;
    Ok(numbered.into_iter().map(|(triangle, _)| triangle).collect())
}

fn halve<E: Send>(triangles: &mut [(u32, Vector3<f32>)], check: &(impl Fn() -> Result<(), E> + Sync)) -> Result<(), E> {
    if triangles.len() <= TRIANGLES {
        return Ok(());
    }
    check()?;
    let start = (triangles[0].1, triangles[0].1);
    let (low, high) = triangles.iter().fold(start, |(low, high), (_, middle)| (low.inf(middle), high.sup(middle)));
    let axis = (high - low).imax();
    let half = triangles.len().div_ceil(TRIANGLES).div_ceil(2) * TRIANGLES;
    // Equal middles are told apart by number, so that the order is one and the same on any number of threads.
    triangles.select_nth_unstable_by(half, |a, b| a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0)));
    let (first, second) = triangles.split_at_mut(half);
    if first.len() > PARALLEL_HALVES {
        let (first, second) = rayon::join(|| halve(first, check), || halve(second, check));
        first.and(second)
    } else {
        halve(first, check)?;
        halve(second, check)
    }
}

/// Triangles numbered over several meshes.
struct Soup<'a> {
    meshes: Vec<(u32, &'a Mesh, Vec<bool>)>,
    centre_mm: Point3<f64>,
}

impl<'a> Soup<'a> {
    fn new<E>(meshes: &[&'a Mesh], centre_mm: Point3<f64>, check: &impl Fn() -> Result<(), E>) -> Result<Self, E> {
        let mut first = 0;
        let meshes = meshes.iter().map(|mesh| {
            let entry = (first, *mesh, outward(mesh, check)?);
            first += mesh.faces.len() as u32;
            Ok(entry)
        });
        Ok(Self { meshes: meshes.collect::<Result<_, E>>()?, centre_mm })
    }

    fn cluster(&self, triangles: &[u32]) -> Cluster {
        let mut cluster = Cluster {
            vertices: Box::default(),
            corners: [[0; TRIANGLES]; 3],
            numbers: [NO_TRIANGLE; TRIANGLES],
            outward: true,
            low_mm: [f32::INFINITY; 3],
            high_mm: [f32::NEG_INFINITY; 3],
            cone: Cone::WHOLE,
        };
        let mut seen: Vec<(usize, u32)> = Vec::with_capacity(VERTICES);
        let mut vertices: Vec<[f32; 3]> = Vec::with_capacity(VERTICES);
        let mut normals = Vec::with_capacity(TRIANGLES);
        for (place, &triangle) in triangles.iter().enumerate() {
            let owner = self.meshes.partition_point(|(first, ..)| *first <= triangle) - 1;
            let (first, mesh, outward) = &self.meshes[owner];
            let face = (triangle - first) as usize;
            cluster.numbers[place] = triangle;
            cluster.outward &= outward[face];
            normals.extend(mesh.scaled_normal(face).try_normalize(0.0));
            for (corner, vertex) in mesh.faces[face].into_iter().enumerate() {
                let known = seen.iter().position(|entry| *entry == (owner, vertex));
                let index = known.unwrap_or_else(|| {
                    seen.push((owner, vertex));
                    vertices.push((mesh.vertices_mm[vertex as usize] - self.centre_mm).map(|mm| mm as f32).into());
                    seen.len() - 1
                });
                cluster.corners[corner][place] = index as u8;
            }
        }
        cluster.cone = Cone::around(normals.iter());
        for vertex in &vertices {
            for axis in 0..3 {
                cluster.low_mm[axis] = cluster.low_mm[axis].min(vertex[axis]);
                cluster.high_mm[axis] = cluster.high_mm[axis].max(vertex[axis]);
            }
        }
        cluster.vertices = vertices.chunks(LANES).map(batch).collect();
        cluster
    }
}

/// [`outward_faces`], given up when `check` fails.
fn outward<E>(mesh: &Mesh, check: &impl Fn() -> Result<(), E>) -> Result<Vec<bool>, E> {
    let failed = Cell::new(None);
    let stop = || check().map_err(|error| failed.set(Some(error))).is_err();
    let outward = outward_faces(mesh, &Poll::new(&stop));
    failed.into_inner().map_or_else(|| Ok(outward.unwrap_or_default()), Err)
}

/// Loads up to 16 vertices by axis.
fn batch(vertices: &[[f32; 3]]) -> [PixelLanes; 3] {
    std::array::from_fn(|axis| std::array::from_fn(|lane| vertices[lane.min(vertices.len() - 1)][axis]))
}
