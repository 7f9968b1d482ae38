//! Shape of a part as pictures show it: its triangles, or those of a simplified mesh where there are more than pictures can show,
//! each cut into cells that have an ink of their own. It holds all that pictures need of a part, and is bounded whatever the part
//! is: [`MAX_TRIANGLES`] triangles, and cells no smaller than about a pixel.
//!
//! Cells of a triangle (a, b, c) are a grid over (u, v), with the point a + u (b − a) + v (c − a): n rows, of n to 1 cells.
//! Part frame, mm. Cost: O(triangles + samples). Memory: 12 bytes a vertex, 22 a triangle, 4 a cell while inks are gathered.

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};

use super::palette::Ink;
use crate::geometry::{self, Aabb, FaceLists, Mesh, Poll, Preview, is_closed};
use crate::planning::context::{Cancelled, Context};
use crate::planning::surface::Surface;

/// Max triangles of a model. Half of them face a camera, so each takes a pixel or less.
pub const MAX_TRIANGLES: usize = 300_000;
/// Width of a picture, in the cells that a part of its size is cut into at least: finer cells would not be seen.
const CELLS_ACROSS: f64 = 450.0;
/// Max rows of cells of a triangle.
const MAX_ROWS: f64 = 1024.0;
const NO_SAMPLE: u32 = u32::MAX;

/// Shape of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnModel {
    /// Vertices, mm.
    pub vertices_mm: Vec<[f32; 3]>,
    /// Corners of each triangle, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Rows of cells of each triangle, at least 1.
    pub rows: Vec<u16>,
    /// First cell of each triangle, and at last the number of cells.
    pub first_cell: Vec<u32>,
    /// True if back faces can be visible: the mesh is open, or wound inconsistently.
    pub is_open: bool,
    /// The triangles in an order in which those near each other come one soon after the other: drawn so, they find in the CPU's cache the
    /// samples that they lie on.
    pub by_place: Vec<u32>,
}

/// A model and the surface sample that gives each of its cells an ink.
pub struct SampledModel {
    /// The model that is drawn.
    pub model: DrawnModel,
    sample_of_cell: Vec<u32>,
}

impl DrawnModel {
    /// A model; `None` if `rows` or `faces` do not belong to it.
    pub fn new(vertices_mm: Vec<[f32; 3]>, faces: Vec<[u32; 3]>, rows: Vec<u16>, is_open: bool) -> Option<Self> {
        let vertices = vertices_mm.len();
        let are_known = faces.iter().flatten().all(|vertex| (*vertex as usize) < vertices);
        if !are_known {
            return None;
        }
        let by_place = by_place(&vertices_mm, &faces);
        Self { vertices_mm, faces, is_open, by_place, ..Self::default() }.with_rows(rows)
    }

    /// The model with so many rows of cells of each triangle; `None` if they do not belong to it.
    fn with_rows(self, rows: Vec<u16>) -> Option<Self> {
        if rows.len() != self.faces.len() || rows.contains(&0) {
            return None;
        }
        let mut cells = 0u32;
        let mut first_cell = Vec::with_capacity(rows.len() + 1);
        for rows in &rows {
            first_cell.push(cells);
            cells = cells.checked_add(cells_of(u32::from(*rows)))?;
        }
        first_cell.push(cells);
        Some(Self { rows, first_cell, ..self })
    }

    /// A mesh with one cell a triangle, for pictures that need no samples.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn of_mesh(mesh: &Mesh, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let stop = || ctx.check().is_err();
        let is_open = !is_closed(mesh, &Poll::new(&stop))?;
        let rows = vec![1; mesh.faces.len()];
        Ok(Self::new(positions(mesh), mesh.faces.clone(), rows, is_open).unwrap_or_default())
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.first_cell.last().map_or(0, |cells| *cells as usize)
    }

    /// Corners of a triangle.
    pub fn corners(&self, face: usize) -> [Point3<f64>; 3] {
        self.faces[face].map(|vertex| Point3::from(self.vertices_mm[vertex as usize].map(f64::from)))
    }

    /// Cell of a triangle at a point of it.
    #[inline(always)]
    pub fn cell(&self, face: usize, [u, v]: [f64; 2]) -> usize {
        self.first_cell[face] as usize + cell_at(u32::from(self.rows[face]), [u, v]) as usize
    }

    /// Box around the vertices.
    pub fn aabb(&self) -> Aabb {
        self.vertices_mm.iter().fold(Aabb::empty(), |aabb, p| aabb.with(&Point3::from(p.map(f64::from))))
    }
}

impl Default for DrawnModel {
    fn default() -> Self {
        Self {
            vertices_mm: Vec::new(),
            faces: Vec::new(),
            rows: Vec::new(),
            first_cell: vec![0],
            is_open: false,
            by_place: Vec::new(),
        }
    }
}

impl SampledModel {
    /// The model of a part. `preview` is that of the mesh to at least [`MAX_TRIANGLES`] triangles, if the caller has it.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn new(mesh: &Mesh, surface: &Surface, preview: Option<&Preview>, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let stop = || ctx.check().is_err();
        let poll = Poll::new(&stop);
        let is_open = !is_closed(mesh, &poll)?;
        if mesh.faces.len() <= MAX_TRIANGLES {
            return Ok(Self::with_cells(positions(mesh), mesh.faces.clone(), is_open, surface));
        }
        let own;
        let preview = match preview {
            Some(preview) => preview,
            None => {
                own = geometry::preview(mesh, MAX_TRIANGLES, &poll)?;
                &own
            }
        };
        ctx.check()?;
        let shown = |face: u32| preview.face_of_triangle.get(face as usize).copied().filter(|face| *face != geometry::NOT_DRAWN);
        let rows = vec![1; preview.faces.len()];
        let model = DrawnModel::new(preview.positions_mm.clone(), preview.faces.clone(), rows, is_open).unwrap_or_default();
        let sample_of_cell = sample_of_cell(&model, surface, shown);
        Ok(Self { model, sample_of_cell })
    }

    /// A mesh whose triangles are cut into about as many cells as they have samples.
    fn with_cells(vertices_mm: Vec<[f32; 3]>, faces: Vec<[u32; 3]>, is_open: bool, surface: &Surface) -> Self {
        let mut samples = vec![0u32; faces.len()];
        for patch in &surface.patches {
            samples[patch.face as usize] += patch.samples;
        }
        let rows = vec![1; faces.len()];
        let model = DrawnModel::new(vertices_mm, faces, rows, is_open).unwrap_or_default();
        let cell_mm = model.aabb().extent_mm().norm() / CELLS_ACROSS;
        let rows = (0..model.faces.len()).map(|face| rows_of(&model.corners(face), samples[face], cell_mm)).collect();
        let model = model.with_rows(rows).unwrap_or_default();
        let sample_of_cell = sample_of_cell(&model, surface, Some);
        Self { model, sample_of_cell }
    }

    /// Code of the ink of each cell, from that of each sample.
    pub fn inks(&self, of_samples: &[u8]) -> Vec<u8> {
        let code = |sample: &u32| of_samples.get(*sample as usize).copied().unwrap_or_else(|| Ink::ByOthers.code());
        self.sample_of_cell.iter().map(code).collect()
    }
}

/// Rows of cells of a triangle with so many samples.
fn rows_of([a, b, c]: &[Point3<f64>; 3], samples: u32, cell_mm: f64) -> u16 {
    if samples <= 1 {
        return 1;
    }
    let longest_mm = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    let seen = if cell_mm > 0.0 { (longest_mm / cell_mm).ceil() } else { 1.0 };
    (2.0 * f64::from(samples)).sqrt().ceil().min(seen).clamp(1.0, MAX_ROWS) as u16
}

/// Number of cells in so many rows.
fn cells_of(rows: u32) -> u32 {
    rows * (rows + 1) / 2
}

/// Cell of a triangle of so many rows at a point of it.
#[inline(always)]
fn cell_at(rows: u32, [u, v]: [f64; 2]) -> u32 {
    if rows == 1 {
        return 0;
    }
    let across = ((u.max(0.0) * f64::from(rows)) as u32).min(rows - 1);
    let up = ((v.max(0.0) * f64::from(rows)) as u32).min(rows - 1 - across);
    in_row(rows, across, up)
}

/// Cell number `across` in row `up`.
#[inline(always)]
fn in_row(rows: u32, across: u32, up: u32) -> u32 {
    up * (2 * rows + 1 - up) / 2 + across
}

/// The triangles along a curve that fills the box around the vertices (Morton 1966, *A Computer Oriented Geodetic Data Base*), by their
/// first corners.
fn by_place(vertices_mm: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<u32> {
    /// Cells of the box along each axis.
    const CELLS: f32 = 1024.0;
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in vertices_mm {
        (low, high) = ([0, 1, 2].map(|axis| low[axis].min(p[axis])), [0, 1, 2].map(|axis| high[axis].max(p[axis])));
    }
    let code = |p: &[f32; 3]| {
        let cell = |axis: usize| ((p[axis] - low[axis]) / (high[axis] - low[axis]) * (CELLS - 1.0)) as u32;
        spread(cell(0)) | spread(cell(1)) << 1 | spread(cell(2)) << 2
    };
    let codes: Vec<u32> = vertices_mm.iter().map(code).collect();
    let mut order: Vec<u32> = (0..faces.len() as u32).collect();
    order.sort_by_key(|face| codes[faces[*face as usize][0] as usize]);
    order
}

/// The lower ten bits, each followed by two zeros.
fn spread(cell: u32) -> u32 {
    let mut bits = cell & 0x3ff;
    for (shift, mask) in [(16, 0x0300_00ff), (8, 0x0300_f00f), (4, 0x030c_30c3), (2, 0x0924_9249)] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

fn positions(mesh: &Mesh) -> Vec<[f32; 3]> {
    mesh.vertices_mm.iter().map(|p| p.coords.map(|c| c as f32).into()).collect()
}

/// The sample of each cell: one that lies in it, that nearest to the middle of a triangle that is one cell, else that of a cell
/// beside it. `shown` is the triangle of the model for one of the mesh.
fn sample_of_cell(model: &DrawnModel, surface: &Surface, shown: impl Fn(u32) -> Option<u32>) -> Vec<u32> {
    let mut samples = vec![NO_SAMPLE; model.cells()];
    // Squared distances from the middle, of the samples in triangles of one cell.
    let mut off_mm2 = vec![f64::INFINITY; model.faces.len()];
    for patch in &surface.patches {
        let Some(face) = shown(patch.face).map(|face| face as usize).filter(|face| *face < model.faces.len()) else { continue };
        let first = patch.first_sample.index();
        let corners = model.corners(face);
        for sample in first..first + patch.samples as usize {
            let p_mm = &surface.sample_mm[sample];
            if model.rows[face] == 1 {
                let middle = Point3::from((corners[0].coords + corners[1].coords + corners[2].coords) / 3.0);
                let off = (p_mm - middle).norm_squared();
                if off < off_mm2[face] {
                    off_mm2[face] = off;
                    samples[model.first_cell[face] as usize] = sample as u32;
                }
            } else {
                let cell = &mut samples[model.cell(face, within(&corners, p_mm))];
                *cell = (*cell).min(sample as u32);
            }
        }
    }
    for face in (0..model.faces.len()).filter(|face| model.rows[*face] > 1) {
        let cells = model.first_cell[face] as usize..model.first_cell[face + 1] as usize;
        fill_gaps(&mut samples[cells], u32::from(model.rows[face]));
    }
    fill_faces(model, &mut samples);
    samples
}

/// Coordinates (u, v) of a point in the plane of a triangle.
fn within([a, b, c]: &[Point3<f64>; 3], p: &Point3<f64>) -> [f64; 2] {
    let (ab, ac, ap): (Vector3<f64>, Vector3<f64>, Vector3<f64>) = (b - a, c - a, p - a);
    let normal = ab.cross(&ac);
    let squared = normal.norm_squared().max(f64::MIN_POSITIVE);
    [ap.cross(&ac).dot(&normal) / squared, ab.cross(&ap).dot(&normal) / squared]
}

/// Gives cells without a sample that of the nearest cell of the triangle.
fn fill_gaps(samples: &mut [u32], rows: u32) {
    let places = (0..rows).flat_map(|up| (0..rows - up).map(move |across| (across, up)));
    let has_sample = |(across, up): &(u32, u32)| samples[in_row(rows, *across, *up) as usize] != NO_SAMPLE;
    let mut open: VecDeque<(u32, u32)> = places.filter(has_sample).collect();
    while let Some((across, up)) = open.pop_front() {
        let sample = samples[in_row(rows, across, up) as usize];
        let beside = [(across.wrapping_sub(1), up), (across + 1, up), (across, up.wrapping_sub(1)), (across, up + 1)];
        for (across, up) in beside {
            let is_inside = across < rows && up < rows && across + up < rows;
            if is_inside && samples[in_row(rows, across, up) as usize] == NO_SAMPLE {
                samples[in_row(rows, across, up) as usize] = sample;
                open.push_back((across, up));
            }
        }
    }
}

/// Gives triangles without any sample that of a triangle beside them.
fn fill_faces(model: &DrawnModel, samples: &mut [u32]) {
    let first = |face: usize| model.first_cell[face] as usize;
    if (0..model.faces.len()).all(|face| samples[first(face)] != NO_SAMPLE) {
        return;
    }
    let around = FaceLists::around(&model.faces, model.vertices_mm.len());
    let mut open: VecDeque<usize> = (0..model.faces.len()).filter(|face| samples[first(*face)] != NO_SAMPLE).collect();
    while let Some(face) = open.pop_front() {
        let sample = samples[first(face)];
        for beside in model.faces[face].iter().flat_map(|vertex| around.of(*vertex as usize)).map(|face| *face as usize) {
            if samples[first(beside)] == NO_SAMPLE {
                samples[first(beside)..first(beside + 1)].fill(sample);
                open.push_back(beside);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::planning::context::Silent;
    use crate::planning::ids::SampleId;
    use crate::planning::params::{PartParams, RegionParams};
    use crate::planning::surface;
    use crate::testing::box_mesh;

    fn surface_of(mesh: &Mesh, samples_per_mm2: f64) -> Surface {
        let params = PartParams { patch_edge_mm: Some(1000.0), samples_per_mm2: Some(samples_per_mm2), ..PartParams::default() };
        surface::sample(mesh, &params, &RegionParams::default(), 0).expect("a surface")
    }

    fn sampled(mesh: &Mesh, surface: &Surface) -> SampledModel {
        SampledModel::new(mesh, surface, None, &Context::new(&AtomicBool::new(false), &Silent)).expect("not cancelled")
    }

    #[test]
    fn triangles_come_by_place_each_once() {
        let mesh = box_mesh([0.0; 3], [60.0, 40.0, 20.0]);
        let order = by_place(&positions(&mesh), &mesh.faces);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..mesh.faces.len() as u32).collect::<Vec<_>>());
        let corner = |face: &u32| mesh.vertices_mm[mesh.faces[*face as usize][0] as usize].coords.map(|c| u32::from(c > 1.0));
        let octants: Vec<u32> = order.iter().map(corner).map(|c| c.x | c.y << 1 | c.z << 2).collect();
        assert!(octants.is_sorted() && octants.first() < octants.last(), "{octants:?}");
        assert!(by_place(&[], &[]).is_empty() && by_place(&[[0.0; 3]; 3], &[[0, 1, 2]]) == [0], "a box without extent");
    }

    #[test]
    fn bits_are_spread_by_three() {
        for cell in [0, 1, 2, 5, 512, 1023] {
            let expected = (0..10).fold(0, |all, bit| all | (cell >> bit & 1) << (3 * bit));
            assert_eq!(spread(cell), expected, "{cell}");
        }
    }

    #[test]
    fn every_cell_has_a_number_of_its_own_and_every_point_a_cell() {
        for rows in [1, 2, 3, 17] {
            let mut cells: Vec<u32> =
                (0..rows).flat_map(|up| (0..rows - up).map(move |across| in_row(rows, across, up))).collect();
            cells.sort_unstable();
            assert_eq!(cells, (0..cells_of(rows)).collect::<Vec<_>>());
            for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (1.2, 0.3), (-0.1, 0.4)] {
                assert!(cell_at(rows, [u, v]) < cells_of(rows), "{rows}: {u} {v}");
            }
        }
    }

    #[test]
    fn cells_take_the_samples_near_them() {
        let mesh = box_mesh([0.0; 3], [60.0, 40.0, 20.0]);
        let surface = surface_of(&mesh, 0.2);
        let model = sampled(&mesh, &surface);
        let mut worst_mm = 0.0f64;
        for face in 0..model.model.faces.len() {
            let (rows, corners) = (u32::from(model.model.rows[face]), model.model.corners(face));
            assert!(rows > 4, "{rows} rows");
            for (across, up) in (0..rows).flat_map(|up| (0..rows - up).map(move |across| (across, up))) {
                let [u, v] = [across, up].map(|n| (f64::from(n) + 1.0 / 3.0) / f64::from(rows));
                let at = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
                let sample = model.sample_of_cell[model.model.cell(face, [u, v])] as usize;
                assert_eq!(surface.patch_of(SampleId::at(sample)).face as usize, face);
                worst_mm = worst_mm.max((surface.sample_mm[sample] - at).norm());
            }
        }
        // A sample stands for 5 mm².
        assert!(worst_mm < 12.0, "{worst_mm} mm");
    }

    #[test]
    fn triangles_without_samples_take_those_beside_them() {
        let mesh = box_mesh([0.0; 3], [60.0, 40.0, 20.0]);
        let mut surface = surface_of(&mesh, 0.0001);
        surface.patches.truncate(1);
        let model = sampled(&mesh, &surface);
        assert!(model.sample_of_cell.iter().all(|sample| (*sample as usize) < surface.patches[0].samples as usize));
    }

    #[test]
    fn a_model_of_parts_that_do_not_fit_is_none() {
        let vertices = vec![[0.0; 3]; 3];
        assert!(DrawnModel::new(vertices.clone(), vec![[0, 1, 2]], vec![2], false).is_some_and(|model| model.cells() == 3));
        assert!(DrawnModel::new(vertices.clone(), vec![[0, 1, 3]], vec![1], false).is_none());
        assert!(DrawnModel::new(vertices.clone(), vec![[0, 1, 2]], vec![0], false).is_none());
        assert!(DrawnModel::new(vertices, vec![[0, 1, 2]], Vec::new(), false).is_none());
    }
}
