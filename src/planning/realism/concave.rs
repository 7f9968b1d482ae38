//! The zone along concave edges: where two faces meet at less than an angle in the air, what lies near the edge on either.
//!
//! Part frame, millimetres. Cost: O(n) in the triangles, at most some 2000 points of an edge, and a look into a grid for each sample; 36
//! bytes a triangle while edges are paired.

use std::collections::HashMap;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

use nalgebra::{Point3, Vector3};

use crate::geometry::{Aabb, Interrupted, Mesh, Poll, each_inner_edge, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;

/// Depth by which a sample may lie behind the plane of a face of the edge, as a share of the zone: faces beside it are curved.
const SLACK: f64 = 0.2;
/// Smallest cosine between the normals of a sample and of a face of the edge: within 45°, else it lies on another face.
const MIN_COS: f64 = FRAC_1_SQRT_2;
/// Cells of the grid along the part at most.
const MAX_CELLS: f64 = 400.0;
/// Samples between two looks at whether to go on.
const BLOCK: usize = 4096;

/// An edge at which two faces meet and leave less than an angle of air.
pub(super) struct ConcaveEdge {
    ends_mm: [Point3<f64>; 2],
    /// Unit normals of the two faces.
    normals: [Vector3<f64>; 2],
}

/// A sample in the zone.
pub(super) struct ZoneSample {
    pub(super) sample: SampleId,
    /// Unit normals of the faces across its edges.
    pub(super) opposite: Vec<Vector3<f64>>,
}

/// The concave edges of a mesh: those of exactly two triangles, wound alike, with less than `dihedral_max_rad` between them in
/// the air.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn concave_edges(mesh: &Mesh, dihedral_max_rad: f64, ctx: &Context<'_>) -> Result<Vec<ConcaveEdge>, Cancelled> {
    let mut edges = Vec::new();
    let stop = || ctx.check().is_err();
    let found = |ends, faces| edges.extend(concave_edge(mesh, ends, faces, dihedral_max_rad));
    each_inner_edge(mesh, &Poll::new(&stop), found).map_err(|Interrupted| Cancelled)?;
    Ok(edges)
}

/// The edge between two triangles, if it is concave.
fn concave_edge(mesh: &Mesh, ends: [u32; 2], faces: [usize; 2], dihedral_max_rad: f64) -> Option<ConcaveEdge> {
    let normals = faces.map(|face| mesh.scaled_normal(face).normalize());
    let apex = mesh.faces[faces[1]].into_iter().find(|corner| !ends.contains(corner))?;
    let ends_mm = ends.map(|corner| mesh.vertices_mm[corner as usize]);
    let rises = normals[0].dot(&(mesh.vertices_mm[apex as usize] - ends_mm[0])) > 0.0;
    let dihedral_rad = PI - normals[0].angle(&normals[1]);
    (rises && dihedral_rad < dihedral_max_rad).then_some(ConcaveEdge { ends_mm, normals })
}

impl ConcaveEdge {
    /// Returns true if a surface point with this unit normal lies in the zone of the edge, on either of its faces.
    fn zone_holds(&self, point_mm: &Point3<f64>, normal: &Vector3<f64>, zone_mm: f64) -> bool {
        let from_end = point_mm - self.ends_mm[0];
        let in_air = |face: &Vector3<f64>| face.dot(&from_end) >= -SLACK * zone_mm;
        let is_face = |face: &Vector3<f64>| face.dot(normal) >= MIN_COS;
        self.distance_mm(point_mm) <= zone_mm && self.normals.iter().all(in_air) && self.normals.iter().any(is_face)
    }

    fn distance_mm(&self, point_mm: &Point3<f64>) -> f64 {
        let along = self.ends_mm[1] - self.ends_mm[0];
        let from_end = point_mm - self.ends_mm[0];
        let share = (from_end.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (from_end - along * share).norm()
    }

    /// Normal of the face across from one with this unit normal.
    fn opposite(&self, normal: &Vector3<f64>) -> Vector3<f64> {
        let [a, b] = self.normals;
        if a.dot(normal) >= b.dot(normal) { b } else { a }
    }
}

/// Edges by cells of a grid, each in all cells that its zone can reach.
struct EdgeGrid {
    cell_mm: f64,
    edges_of: HashMap<[i64; 3], Vec<u32>>,
}

impl EdgeGrid {
    /// Points along each edge are a third of a cell apart and every cell beside one names the edge: so does the cell of whatever is
    /// nearer to the edge than two thirds of a cell. The cells are in proportion to the part; points that lie further from `around` than
    /// the zone and a cell are passed over, since no zone of theirs reaches it.
    fn new(edges: &[ConcaveEdge], zone_mm: f64, (extent_mm, around): (f64, &Aabb), ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let cell_mm = (1.5 * zone_mm).max(extent_mm / MAX_CELLS);
        let reach_mm = zone_mm + cell_mm;
        let is_near = |point_mm: &Point3<f64>| {
            (0..3).all(|axis| around.min[axis] - reach_mm <= point_mm[axis] && point_mm[axis] <= around.max[axis] + reach_mm)
        };
        let mut grid = Self { cell_mm, edges_of: HashMap::new() };
        for (number, edge) in (0_u32..).zip(edges) {
            ctx.check()?;
            let [from_mm, to_mm] = edge.ends_mm;
            let steps = (3.0 * (to_mm - from_mm).norm() / cell_mm).ceil().max(1.0);
            for step in 0..=steps as u32 {
                let point_mm = from_mm + (to_mm - from_mm) * (f64::from(step) / steps);
                if is_near(&point_mm) {
                    grid.name_around(grid.cell(&point_mm), number);
                }
            }
        }
        Ok(grid)
    }

    fn cell(&self, point_mm: &Point3<f64>) -> [i64; 3] {
        [point_mm.x, point_mm.y, point_mm.z].map(|mm| (mm / self.cell_mm).floor() as i64)
    }

    fn name_around(&mut self, [x, y, z]: [i64; 3], edge: u32) {
        for beside in 0..27_i64 {
            let cell = [x + beside % 3 - 1, y + beside / 3 % 3 - 1, z + beside / 9 - 1];
            let edges = self.edges_of.entry(cell).or_default();
            if edges.last() != Some(&edge) {
                edges.push(edge);
            }
        }
    }

    fn near(&self, point_mm: &Point3<f64>) -> &[u32] {
        self.edges_of.get(&self.cell(point_mm)).map_or(&[], Vec::as_slice)
    }
}

/// The zone along the concave edges of a mesh, ready for many points.
pub struct ConcaveZone {
    edges: Vec<ConcaveEdge>,
    grid: EdgeGrid,
    zone_mm: f64,
}

impl ConcaveZone {
    /// The zone of this width along the edges of `mesh` with less than `dihedral_max_rad` between their faces in the air.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn new(mesh: &Mesh, dihedral_max_rad: f64, zone_mm: f64, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let edges = concave_edges(mesh, dihedral_max_rad, ctx)?;
        let aabb = mesh.aabb();
        let grid = EdgeGrid::new(&edges, zone_mm, (aabb.extent_mm().amax(), &aabb), ctx)?;
        Ok(Self { edges, grid, zone_mm })
    }

    /// Returns true if a surface point with this unit normal lies in the zone.
    #[must_use]
    pub fn holds(&self, point_mm: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let mut near = self.grid.near(point_mm).iter().map(|edge| &self.edges[*edge as usize]);
        near.any(|edge| edge.zone_holds(point_mm, normal, self.zone_mm))
    }
}

/// The samples that lie in the zone of an edge of `mesh`, of those that `is_asked_for` accepts, ascending.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn zone(
    surface: &Surface,
    (mesh, edges): (&Mesh, &[ConcaveEdge]),
    zone_mm: f64,
    is_asked_for: impl Fn(SampleId) -> bool + Sync,
    ctx: &Context<'_>,
) -> Result<Vec<ZoneSample>, Cancelled> {
    if edges.is_empty() {
        return Ok(Vec::new());
    }
    let asked = surface.samples().filter(|sample| is_asked_for(*sample));
    let around = asked.fold(Aabb::empty(), |aabb, sample| aabb.with(&surface.sample_mm[sample.index()]));
    let grid = EdgeGrid::new(edges, zone_mm, (mesh.aabb().extent_mm().amax(), &around), ctx)?;
    let in_zone = |sample: SampleId| {
        let (point_mm, normal) = (&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
        let near = grid.near(point_mm).iter().map(|edge| &edges[*edge as usize]);
        ctx.check()?;
        let mut opposite: Vec<Vector3<f64>> = Vec::new();
        for edge in near.filter(|edge| edge.zone_holds(point_mm, normal, zone_mm)) {
            let face = edge.opposite(normal);
            // Pieces of one edge between two planes have one face across.
            if !opposite.contains(&face) {
                opposite.push(face);
            }
        }
        Ok((!opposite.is_empty()).then_some(ZoneSample { sample, opposite }))
    };
    let samples = surface.sample_mm.len();
    let block = |first: usize| {
        let block = (first * BLOCK..samples.min((first + 1) * BLOCK)).map(SampleId::at);
        let found = block.filter(|sample| is_asked_for(*sample)).map(in_zone);
        Ok(found.collect::<Result<Vec<_>, Cancelled>>()?.into_iter().flatten().collect())
    };
    let blocks: Vec<Vec<ZoneSample>> = parallel::try_map_range::<_, Cancelled>(samples.div_ceil(BLOCK), block)?;
    Ok(blocks.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;

    /// 1000 grooves of 1 m and a window of 6 mm took cells of a millimetre along all of them: 1.2 GB.
    #[test]
    fn edges_are_named_in_cells_of_the_part_beside_what_is_judged() {
        let edge = |number: u32| ConcaveEdge {
            ends_mm: [0.0, 1_000.0].map(|y| Point3::new(f64::from(number), y, 0.0)),
            normals: [-FRAC_1_SQRT_2, FRAC_1_SQRT_2].map(|x| Vector3::new(x, 0.0, FRAC_1_SQRT_2)),
        };
        let edges: Vec<ConcaveEdge> = (0..1_000).map(edge).collect();
        let window = Aabb { min: Point3::new(500.2, 500.2, 0.0), max: Point3::new(506.2, 506.2, 0.0) };
        let flag = AtomicBool::new(false);
        let grid = EdgeGrid::new(&edges, 0.5, (1_000.0, &window), &Context::new(&flag, &Silent)).expect("not cancelled");
        let names: usize = grid.edges_of.values().map(Vec::len).sum();
        assert!(grid.edges_of.len() < 1_000 && names < 10_000, "{} cells, {names} names", grid.edges_of.len());
        for number in 500..=506 {
            let beside = Point3::new(f64::from(number) + 0.4, 503.0, 0.3);
            assert!(grid.near(&beside).contains(&number), "edge {number}");
            assert!(!grid.near(&Point3::new(f64::from(number), 100.0, 0.0)).contains(&number));
        }
    }
}
