//! A distance field to triangles with its sharp edges kept: dual contouring (Ju, Losasso, Schaefer & Warren, "Dual
//! contouring of Hermite data", SIGGRAPH 2002, §2), with one vertex for each sheet of surface in a cell (after Schaefer,
//! Ju & Warren, "Manifold dual contouring", TVCG 2007, §3), which keeps nearly every edge between two triangles; a
//! resolution that still pinches is passed over for the next one.
//! Each lattice edge with a change of sign gives one quadrilateral, so the triangle count is known from the signs alone.

use std::collections::HashMap;

use nalgebra::{Point3, SymmetricEigen, Vector3};

use super::field::DistanceField;
use crate::geometry::{Aabb, Mesh, assess, sort_descending};

/// Eigenvalues below this share of the largest say nothing about where the vertex is: the surface is flat or an edge.
const MIN_EIGENVALUE_SHARE: f64 = 0.05;
/// Vertices keep this share of a cell's width from its walls, so that no two of them coincide.
const MARGIN: f64 = 1e-3;

/// The surface of `field` inside `bounds` with `target` ± 10 % triangles, closed and of one body; `None` when no
/// resolution nearby gives that.
pub(super) fn with_triangles(field: &impl DistanceField, bounds: &Aabb, target: usize) -> Option<Mesh> {
    let cell_mm = cell_for(field, bounds, target);
    let wobble = (0..40).map(|k| if k % 2 == 0 { f64::from(k) } else { -f64::from(k) } * 1e-3);
    let meshes = wobble.map(|w| Lattice::new(field, bounds, cell_mm * (1.0 + w)).triangles(field));
    meshes.into_iter().find(|mesh| mesh.faces.len().abs_diff(target) * 10 <= target && is_sound(mesh))
}

/// Width of cells that gives about `target` triangles: their number goes with the inverse square.
fn cell_for(field: &impl DistanceField, bounds: &Aabb, target: usize) -> f64 {
    let mut cell_mm = bounds.extent_mm().max() / 40.0;
    for _ in 0..8 {
        let triangles = 2 * Lattice::new(field, bounds, cell_mm).crossings().count();
        let ratio = triangles as f64 / target as f64;
        if (ratio - 1.0).abs() < 0.02 {
            break;
        }
        cell_mm *= ratio.sqrt();
    }
    cell_mm
}

fn is_sound(mesh: &Mesh) -> bool {
    let health = assess(mesh);
    health.watertight && health.bodies == 1 && health.volume_mm3.is_some() && health.warnings().is_empty()
}

/// Corners of cells and whether each is inside.
struct Lattice {
    origin: Point3<f64>,
    cell_mm: f64,
    /// Corners along each axis.
    corners: [usize; 3],
    /// x fastest, then y, then z.
    inside: Vec<bool>,
}

/// Position of a corner, or of the cell above it.
type Index = [usize; 3];

/// An edge from a corner to the next one along an axis.
#[derive(Clone, Copy)]
struct Crossing {
    from: Index,
    axis: usize,
    /// Is true if the surface faces along the axis.
    outwards: bool,
}

/// A point where the surface crosses an edge, and its normal there.
#[derive(Clone, Copy)]
struct Hermite {
    point: Point3<f64>,
    normal: Vector3<f64>,
}

/// Corner `c` of a cell lies one step along axis `a` where bit `a` of `c` is set. Edge of a cell along `axis` from its
/// corner `c`, numbered 0 … 11.
fn edge_number(axis: usize, c: usize) -> usize {
    let (b, d) = ((axis + 1) % 3, (axis + 2) % 3);
    4 * axis + (c >> b & 1) + 2 * (c >> d & 1)
}

/// The edges of a cell: number, axis, and both corners.
fn cell_edges() -> impl Iterator<Item = (usize, usize, [usize; 2])> {
    (0..3).flat_map(|axis| {
        let from = (0..8).filter(move |c| c >> axis & 1 == 0);
        from.map(move |c| (edge_number(axis, c), axis, [c, c | 1 << axis]))
    })
}

impl Lattice {
    fn new(field: &impl DistanceField, bounds: &Aabb, cell_mm: f64) -> Self {
        // Two cells of air all round, off by a fraction that no plane of a part is likely to share.
        let air_mm = 1.618 * cell_mm;
        let origin = bounds.min - Vector3::repeat(air_mm);
        let span = bounds.extent_mm().add_scalar(2.0 * air_mm) / cell_mm;
        let corners = [span.x, span.y, span.z].map(|cells| cells.ceil() as usize + 1);
        let inside = vec![false; corners.iter().product()];
        let mut lattice = Self { origin, cell_mm, corners, inside };
        lattice.fill(field, [0; 3], corners);
        lattice
    }

    /// Fills the block of corners `[from, to)`, by halves until the distance at its middle decides it as a whole.
    fn fill(&mut self, field: &impl DistanceField, from: Index, to: Index) {
        let (low, high) = (self.position(from), self.position(to.map(|end| end - 1)));
        let distance_mm = field.at(&nalgebra::center(&low, &high));
        let is_one = (0..3).all(|axis| to[axis] - from[axis] == 1);
        if is_one || distance_mm.abs() > (high - low).norm() / 2.0 {
            return self.set(from, to, distance_mm < 0.0);
        }
        let longest = (0..3).max_by_key(|&axis| to[axis] - from[axis]).unwrap_or(0);
        let (mut end_of_first, mut begin_of_second) = (to, from);
        end_of_first[longest] = usize::midpoint(from[longest], to[longest]);
        begin_of_second[longest] = end_of_first[longest];
        self.fill(field, from, end_of_first);
        self.fill(field, begin_of_second, to);
    }

    fn set(&mut self, from: Index, to: Index, inside: bool) {
        if inside {
            for z in from[2]..to[2] {
                for y in from[1]..to[1] {
                    let row = self.number([from[0], y, z]);
                    self.inside[row..row + to[0] - from[0]].fill(true);
                }
            }
        }
    }

    fn number(&self, [x, y, z]: Index) -> usize {
        x + self.corners[0] * (y + self.corners[1] * z)
    }

    fn position(&self, [x, y, z]: Index) -> Point3<f64> {
        self.origin + self.cell_mm * Vector3::new(x as f64, y as f64, z as f64)
    }

    fn corner(&self, cell: Index, c: usize) -> Index {
        [cell[0] + (c & 1), cell[1] + (c >> 1 & 1), cell[2] + (c >> 2)]
    }

    /// Edges with a change of sign, in the order of the lattice. The outermost corners are outside, so every crossing
    /// has four cells around it.
    fn crossings(&self) -> impl Iterator<Item = Crossing> {
        let [nx, ny, nz] = self.corners;
        let corners = (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        corners.flat_map(move |from| {
            let inside = self.inside[self.number(from)];
            (0..3).filter_map(move |axis| {
                let mut to = from;
                to[axis] += 1;
                let crosses = to[axis] < self.corners[axis] && self.inside[self.number(to)] != inside;
                crosses.then_some(Crossing { from, axis, outwards: inside })
            })
        })
    }

    fn triangles(&self, field: &impl DistanceField) -> Mesh {
        let hermite: HashMap<(usize, usize), Hermite> =
            self.crossings().map(|c| ((self.number(c.from), c.axis), self.hermite(field, c))).collect();
        let mut vertices_mm = Vec::new();
        let mut cells: HashMap<usize, [u32; 12]> = HashMap::new();
        let mut faces = Vec::with_capacity(2 * hermite.len());
        for crossing in self.crossings() {
            let quad = around(crossing).map(|(cell, edge)| {
                let fresh = || self.vertices_of(field, cell, &hermite, &mut vertices_mm);
                cells.entry(self.number(cell)).or_insert_with(fresh)[edge]
            });
            faces.extend(split(field, quad, &vertices_mm));
        }
        let source_face = (0..faces.len() as u32).collect();
        Mesh { vertices_mm, faces, source_face, groups: Vec::new() }
    }

    /// Point of the edge where the field is zero (false position, Illinois variant), with its normal.
    fn hermite(&self, field: &impl DistanceField, crossing: Crossing) -> Hermite {
        let mut ends = [self.position(crossing.from); 2];
        ends[1][crossing.axis] += self.cell_mm;
        let mut values = ends.map(|p| field.at(&p));
        let mut point = ends[0];
        for _ in 0..40 {
            point = ends[0] + (ends[1] - ends[0]) * (values[0] / (values[0] - values[1]));
            let value = field.at(&point);
            if value.abs() < 1e-9 {
                break;
            }
            let same = usize::from((value < 0.0) == (values[1] < 0.0));
            ends[same] = point;
            values[same] = value;
            values[1 - same] /= 2.0;
        }
        Hermite { point, normal: field.gradient(&point).normalize() }
    }

    /// Adds the vertices of a cell, one a sheet, and gives the number of the vertex for each edge that crosses.
    fn vertices_of(
        &self,
        field: &impl DistanceField,
        cell: Index,
        hermite: &HashMap<(usize, usize), Hermite>,
        vertices_mm: &mut Vec<Point3<f64>>,
    ) -> [u32; 12] {
        let inside: [bool; 8] = std::array::from_fn(|c| self.inside[self.number(self.corner(cell, c))]);
        let sheet_of_edge = sheets(inside);
        let mut data: [Vec<Hermite>; 12] = Default::default();
        for (edge, axis, [a, _]) in crossing_edges(inside) {
            data[sheet_of_edge[edge]].push(hermite[&(self.number(self.corner(cell, a)), axis)]);
        }
        let mut number = [u32::MAX; 12];
        for (number, data) in number.iter_mut().zip(data).filter(|(_, data)| !data.is_empty()) {
            *number = vertices_mm.len() as u32;
            vertices_mm.push(self.vertex(field, cell, &data));
        }
        sheet_of_edge.map(|sheet| number[sheet])
    }

    /// The point that lies on the tangent planes of `data` as well as one in the cell can, then moved onto the surface.
    fn vertex(&self, field: &impl DistanceField, cell: Index, data: &[Hermite]) -> Point3<f64> {
        let low = self.position(cell).coords.add_scalar(MARGIN * self.cell_mm);
        let high = low.add_scalar((1.0 - 2.0 * MARGIN) * self.cell_mm);
        let clamp = |p: Point3<f64>| Point3::from(p.coords.sup(&low).inf(&high));
        let is_in_cell = |p: &Point3<f64>| clamp(*p) == *p;
        let mut point = clamp(best_points(data).into_iter().find(is_in_cell).unwrap_or_else(|| middle(data)));
        for _ in 0..4 {
            let gradient = field.gradient(&point);
            point = clamp(point - gradient * (field.at(&point) / gradient.norm_squared().max(0.1)));
        }
        // A nanometre off a round number is noise of the arithmetic; adding zero makes -0 plain.
        point.map(|value| f64::from(((value * 1e6).round() / 1e6) as f32) + 0.0)
    }
}

fn middle(data: &[Hermite]) -> Point3<f64> {
    Point3::from(data.iter().map(|h| h.point.coords).sum::<Vector3<f64>>() / data.len() as f64)
}

/// The points with the least squared distance to all tangent planes: the corner of three of them, the nearest point of
/// an edge of two, of a plane; nearest to the middle of the crossings. Only what the planes do tell is solved for.
fn best_points(data: &[Hermite]) -> [Point3<f64>; 3] {
    let middle = middle(data);
    let matrix = data.iter().map(|h| h.normal * h.normal.transpose()).sum::<nalgebra::Matrix3<f64>>();
    let right = data.iter().map(|h| h.normal * h.normal.dot(&(h.point - middle))).sum::<Vector3<f64>>();
    let eigen = SymmetricEigen::new(matrix);
    let mut strongest = [0, 1, 2];
    sort_descending(&mut strongest, |axis| eigen.eigenvalues[*axis]);
    let step = |k: usize| {
        let (direction, value) = (eigen.eigenvectors.column(k), eigen.eigenvalues[k]);
        let tells = value > MIN_EIGENVALUE_SHARE * eigen.eigenvalues[strongest[0]];
        if tells { direction * (direction.dot(&right) / value) } else { Vector3::zeros() }
    };
    [3, 2, 1].map(|rank| middle + strongest[..rank].iter().map(|&k| step(k)).sum::<Vector3<f64>>())
}

/// The edges of a cell between inside and outside.
fn crossing_edges(inside: [bool; 8]) -> impl Iterator<Item = (usize, usize, [usize; 2])> {
    cell_edges().filter(move |&(_, _, [a, b])| inside[a] != inside[b])
}

/// Finds the lowest edge of the same sheet for each crossing edge of a cell. On each wall of the cell the surface runs from
/// crossing to crossing; where a wall has four, around its inside corners, so that both cells at the wall agree.
fn sheets(inside: [bool; 8]) -> [usize; 12] {
    let mut sheet: [usize; 12] = std::array::from_fn(|edge| edge);
    let mut join = |a: usize, b: usize| {
        let (low, high) = (sheet[a].min(sheet[b]), sheet[a].max(sheet[b]));
        sheet.iter_mut().filter(|sheet| **sheet == high).for_each(|sheet| *sheet = low);
    };
    for (normal, side) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)] {
        let on_wall = |corner: usize| corner >> normal & 1 == side;
        let wall: Vec<_> = crossing_edges(inside).filter(|&(_, _, [a, b])| on_wall(a) && on_wall(b)).collect();
        for (i, &(first, _, ends)) in wall.iter().enumerate() {
            for &(second, _, others) in &wall[i + 1..] {
                let share_inside = ends.iter().any(|end| inside[*end] && others.contains(end));
                if wall.len() == 2 || share_inside {
                    join(first, second);
                }
            }
        }
    }
    sheet
}

/// The four cells around a crossing, counter-clockwise seen from outside, each with its number of the edge.
fn around(crossing: Crossing) -> [(Index, usize); 4] {
    let (b, c) = ((crossing.axis + 1) % 3, (crossing.axis + 2) % 3);
    let mut cells = [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(back_b, back_c)| {
        let mut cell = crossing.from;
        cell[b] -= back_b;
        cell[c] -= back_c;
        (cell, edge_number(crossing.axis, back_b << b | back_c << c))
    });
    if !crossing.outwards {
        cells.reverse();
    }
    cells
}

/// Cuts along the diagonal that lies closer to the surface, which is along a sharp edge where there is one; on a flat
/// surface along the shorter one. Whatever they say, not so that a sliver comes out if the other way there is none.
fn split(field: &impl DistanceField, [a, b, c, d]: [u32; 4], vertices_mm: &[Point3<f64>]) -> [[u32; 3]; 2] {
    const SLIVER: f64 = 0.1;
    let at = |v: u32| vertices_mm[v as usize];
    let length_mm = |from: u32, to: u32| (at(to) - at(from)).norm();
    let off = |from: u32, to: u32| field.at(&nalgebra::center(&at(from), &at(to))).abs() / length_mm(from, to);
    let (by_ac, by_bd) = ([[a, b, c], [a, c, d]], [[a, b, d], [b, c, d]]);
    let thickness = |cut: [[u32; 3]; 2]| cut.map(|face| thickness(face.map(at))).into_iter().fold(1.0, f64::min);
    let (thickness_ac, thickness_bd) = (thickness(by_ac), thickness(by_bd));
    let (off_ac, off_bd) = (off(a, c), off(b, d));
    let take_ac = if thickness_ac.min(thickness_bd) < SLIVER {
        thickness_ac >= thickness_bd
    } else if (off_ac - off_bd).abs() > 1e-3 {
        off_ac < off_bd
    } else {
        length_mm(a, c) <= length_mm(b, d)
    };
    if take_ac { by_ac } else { by_bd }
}

/// Height of a triangle over its longest side, as a share of that side: 0 for a line, 0.87 for equal sides.
fn thickness([a, b, c]: [Point3<f64>; 3]) -> f64 {
    let longest_squared = [b - a, c - b, a - c].map(|side| side.norm_squared()).into_iter().fold(0.0, f64::max);
    (b - a).cross(&(c - a)).norm() / longest_squared
}
