//! A small renderer. Triangles go through a depth buffer with 2 × 2 samples per pixel. Each sample then takes the ink of its cell of
//! the triangle, is lit by a lamp beside the camera and by a soft sky, and is darkened along outlines and creases. What is seen from
//! a camera ([`Seen`]) serves every picture from there. Equal inputs give equal pictures, at every level of vector instructions.
//!
//! Cost: O(vertices + triangles + pixels). Triangles of less than about four pixels are lit as a whole; pixels in which one
//! triangle is alone are lit once. Memory of a picture of 640 × 480 pixels: 10 MB for the samples, 2.5 MB for the pixels, and 16 bytes
//! a vertex and 4 a triangle of the model, which is at most 5 MB.

use nalgebra::{Matrix3, Point3, Vector3};

use super::camera::Camera;
use super::depth_buffer::{DepthBuffer, Projected, STEPS, face_of, inverse_depth_of};
use super::image::Image;
use super::model::DrawnModel;
use super::palette::Ink;
use super::shading::{Lamp, Shading};
use crate::geometry::{Kernel, SimdLevel, simd_from_fn, simd_max, simd_min};

/// Samples per pixel along each axis.
const SAMPLES: usize = 2;
/// Opacity of missed surface that is hidden.
pub(super) const GLOW: f64 = 0.8;
/// Relative difference of depth within which a point is the one seen at its pixel.
const SAME_DEPTH: f64 = 0.002;
/// Width and height, in steps, below which a triangle is lit as a whole.
const FLAT_STEPS: i32 = 8 * STEPS as i32;
/// Marks of a triangle's colour: it has one alone, or one at each place; and that it folds nowhere.
const FLAT: u32 = 1 << 24;
const VARIES: u32 = 1 << 25;
const SMOOTH: u32 = 1 << 26;

/// The part from a camera.
pub(super) struct Seen<'m> {
    model: &'m DrawnModel,
    /// The camera with one pixel per sample.
    fine: Camera,
    /// Place of the camera, part frame, mm.
    at_mm: Point3<f64>,
    projected: Vec<Projected>,
    nearest: DepthBuffer,
    level: SimdLevel,
}

impl<'m> Seen<'m> {
    /// Draws the depths of a model.
    pub(super) fn new(model: &'m DrawnModel, camera: &Camera, level: SimdLevel) -> Self {
        let fine = finer(camera);
        let at_mm = camera.camera_from_part.inverse().origin_mm();
        let projected = level.run(Project { model, fine: &fine });
        let mut nearest = DepthBuffer::new(fine.size_px);
        level.run(Rasterise { model, fine: &fine, projected: &projected, keep: |_: usize| true, buffer: &mut nearest });
        Self { model, fine, at_mm, projected, nearest, level }
    }

    /// Returns true if a point of the surface with this normal, part frame, is seen in the picture.
    pub(super) fn shows(&self, p_mm: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let seen = self.fine.camera_from_part.point(p_mm);
        let Some([x, y]) = self.fine.pixel(&seen).filter(|[x, y]| *x >= 0.0 && *y >= 0.0) else { return false };
        let Some(sample) = self.nearest.at(x as usize, y as usize) else { return false };
        let depth_mm = 1.0 / f64::from(inverse_depth_of(sample));
        normal.dot(&(self.at_mm - p_mm)) > 0.0 && seen.z <= depth_mm * (1.0 + SAME_DEPTH)
    }

    /// Cosine of the angle at which a surface with this normal, part frame, faces the camera at a point.
    pub(super) fn facing(&self, p_mm: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let towards = self.at_mm - p_mm;
        normal.dot(&towards) / towards.norm()
    }

    /// Width and height of its pictures, pixels.
    pub(super) fn size_px(&self) -> [usize; 2] {
        self.fine.size_px.map(|n| n / SAMPLES)
    }

    /// Pixel of a point, part frame.
    pub(super) fn pixel(&self, p_mm: &Point3<f64>) -> Option<[f64; 2]> {
        let fine = self.fine.pixel(&self.fine.camera_from_part.point(p_mm))?;
        Some(fine.map(|c| c / SAMPLES as f64))
    }

    /// A picture of the part, each cell in the ink of its code, on a transparent background; if `through`, the inks that glow shine
    /// through whatever hides them ([`Ink::glows`]).
    pub(super) fn picture(&self, shading: &Shading, codes: &[u8], through: bool) -> Image {
        let glowing = through.then(|| self.glowing(codes));
        let painter = Painter::new(self, shading, codes);
        self.level.run(Resolve { painter, glowing: glowing.as_ref() })
    }

    /// Depths of the triangles alone of which something glows.
    fn glowing(&self, codes: &[u8]) -> DepthBuffer {
        let glows: Vec<bool> = Ink::ALL.into_iter().map(Ink::glows).collect();
        let cells = |face: usize| &codes[self.model.first_cell[face] as usize..self.model.first_cell[face + 1] as usize];
        let keep = |face: usize| cells(face).iter().any(|code| glows[usize::from(*code)]);
        let mut buffer = DepthBuffer::new(self.fine.size_px);
        let (model, fine, projected) = (self.model, &self.fine, self.projected.as_slice());
        self.level.run(Rasterise { model, fine, projected, keep, buffer: &mut buffer });
        buffer
    }
}

/// Projects the vertices.
struct Project<'a> {
    model: &'a DrawnModel,
    fine: &'a Camera,
}

impl Kernel for Project<'_> {
    type Output = Vec<Projected>;

    #[inline(always)]
    fn run(self) -> Vec<Projected> {
        let camera_from_part = self.fine.camera_from_part.isometry();
        let rotation = camera_from_part.rotation.to_rotation_matrix();
        let (m, t) = (rotation.matrix(), camera_from_part.translation.vector);
        let mut projected = Vec::with_capacity(self.model.vertices_mm.len());
        for [x, y, z] in &self.model.vertices_mm {
            let [x, y, z] = [f64::from(*x), f64::from(*y), f64::from(*z)];
            let along = |row: usize| m[(row, 0)] * x + m[(row, 1)] * y + m[(row, 2)] * z + t[row];
            projected.push(Projected::of(self.fine, &Point3::new(along(0), along(1), along(2))));
        }
        projected
    }
}

/// Draws the depths of triangles.
struct Rasterise<'a, K> {
    model: &'a DrawnModel,
    fine: &'a Camera,
    projected: &'a [Projected],
    keep: K,
    buffer: &'a mut DepthBuffer,
}

impl<K: Fn(usize) -> bool> Kernel for Rasterise<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (face, vertices) in self.model.faces.iter().enumerate() {
            let [a, b, c] = simd_from_fn(|corner| self.projected[vertices[corner] as usize]);
            if !(self.keep)(face) {
                continue;
            }
            if a.inverse_depth > 0.0 && b.inverse_depth > 0.0 && c.inverse_depth > 0.0 {
                self.buffer.draw([a, b, c], face as u32);
            } else {
                draw_clipped(self.buffer, self.fine, self.model, face);
            }
        }
    }
}

/// Draws what lies behind the near plane of a triangle that reaches before it.
#[cold]
fn draw_clipped(buffer: &mut DepthBuffer, fine: &Camera, model: &DrawnModel, face: usize) {
    let (fan, count) = Camera::clip_near(model.corners(face).map(|p| fine.camera_from_part.point(&p)));
    for last in 2..count {
        buffer.draw([fan[0], fan[last - 1], fan[last]].map(|p| Projected::of(fine, &p)), face as u32);
    }
}

/// A triangle's coordinates across the picture: those of the point that is seen at a sample. They are exact in perspective, also where
/// the triangle reaches before the near plane.
#[derive(Clone, Copy)]
struct Plane {
    /// Weights of the corners, not normalised, times a direction with z = 1.
    weights: Matrix3<f64>,
}

impl Plane {
    fn of(seen: &Seen<'_>, face: usize) -> Self {
        let [a, b, c] = seen.model.corners(face).map(|p| seen.fine.camera_from_part.point(&p).coords);
        // The direction d to a + u (b − a) + v (c − a) has weights d · (b × c), d · (c × a), d · (a × b) of the corners.
        Self { weights: Matrix3::from_rows(&[b.cross(&c).transpose(), c.cross(&a).transpose(), a.cross(&b).transpose()]) }
    }

    /// Coordinates (u, v) at a direction, within the triangle.
    #[inline(always)]
    fn within(&self, direction: &Vector3<f64>) -> [f64; 2] {
        let weights = self.weights * direction;
        let sum = weights.x + weights.y + weights.z;
        let share = |weight: f64| if sum == 0.0 { 0.0 } else { (weight / sum).clamp(0.0, 1.0) };
        let (u, v) = (share(weights.y), share(weights.z));
        let over = (u + v).max(1.0);
        [u / over, v / over]
    }
}

/// Triangle that was looked at last: its neighbours in the picture are mostly of the same.
struct Lit {
    face: usize,
    plane: Plane,
    lights: [f32; 3],
}

/// Colours of the samples of a picture.
struct Painter<'a> {
    seen: &'a Seen<'a>,
    shading: &'a Shading,
    lamp: Lamp,
    codes: &'a [u8],
    colours: Vec<[u8; 3]>,
    /// Colour and marks of each triangle, 0 as long as nobody asked.
    paint: Vec<u32>,
    lit: Option<Lit>,
    hidden: Option<(usize, Plane)>,
}

impl<'a> Painter<'a> {
    fn new(seen: &'a Seen<'a>, shading: &'a Shading, codes: &'a [u8]) -> Self {
        let lamp = Lamp::beside(&seen.fine.camera_from_part.inverse());
        let colours = Ink::ALL.into_iter().map(Ink::rgb).collect();
        let paint = vec![0; seen.model.faces.len()];
        Self { seen, shading, lamp, codes, colours, paint, lit: None, hidden: None }
    }

    /// Colour and marks of a triangle.
    #[inline(always)]
    fn paint(&mut self, face: usize) -> u32 {
        match self.paint[face] {
            0 => self.mix_paint(face),
            paint => paint,
        }
    }

    #[inline(never)]
    fn mix_paint(&mut self, face: usize) -> u32 {
        let (model, corner_normals) = (self.seen.model, self.shading.corner_normals(face));
        let [a, _, _] = model.corners(face);
        let towards = (self.seen.at_mm - a).map(|c| c as f32);
        let flat = |[r, g, b]: [u8; 3]| FLAT | u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b);
        let colour = if self.shading.normal(face).dot(&towards) <= 0.0 {
            flat(Ink::Back.rgb())
        } else if model.rows[face] == 1 && self.is_small(face) {
            let sum = corner_normals[0] + corner_normals[1] + corner_normals[2];
            let light = self.lamp.light(&sum.try_normalize(0.0).unwrap_or(*self.shading.normal(face)));
            flat(scaled(self.colours[usize::from(self.codes[model.first_cell[face] as usize])], light))
        } else {
            VARIES
        };
        let smooth = if self.shading.is_smooth(face) { SMOOTH } else { 0 };
        self.paint[face] = colour | smooth;
        colour | smooth
    }

    fn is_small(&self, face: usize) -> bool {
        let [a, b, c] = self.seen.model.faces[face].map(|vertex| self.seen.projected[vertex as usize]);
        let extent = |ends: [i32; 3]| ends[0].max(ends[1]).max(ends[2]) - ends[0].min(ends[1]).min(ends[2]);
        let are_before = [a, b, c].iter().all(|corner| corner.inverse_depth > 0.0);
        are_before && extent([a.x, b.x, c.x]).max(extent([a.y, b.y, c.y])) <= FLAT_STEPS
    }

    /// Colour of a triangle at a place in the picture, in samples.
    #[inline(always)]
    fn colour(&mut self, face: usize, paint: u32, [x, y]: [f64; 2]) -> [u8; 3] {
        if paint & FLAT != 0 {
            return [(paint >> 16) as u8, (paint >> 8) as u8, paint as u8];
        }
        let seen = self.seen;
        let lit = match &self.lit {
            Some(lit) if lit.face == face => lit,
            _ => {
                let lights = [0, 1, 2].map(|corner| self.lamp.light(&self.shading.corner_normals(face)[corner]));
                &*self.lit.insert(Lit { face, plane: Plane::of(seen, face), lights })
            }
        };
        let [u, v] = lit.plane.within(&seen.fine.direction([x, y]));
        let [a, b, c] = lit.lights;
        let light = a + (b - a) * u as f32 + (c - a) * v as f32;
        scaled(self.colours[usize::from(self.codes[seen.model.cell(face, [u, v])])], light)
    }

    /// Ink of a hidden triangle at a place in the picture.
    fn hidden_ink(&mut self, face: usize, [x, y]: [f64; 2]) -> Ink {
        let seen = self.seen;
        let plane = match &self.hidden {
            Some((of, plane)) if *of == face => *plane,
            _ => self.hidden.insert((face, Plane::of(seen, face))).1,
        };
        let cell = seen.model.cell(face, plane.within(&seen.fine.direction([x, y])));
        Ink::ALL[usize::from(self.codes[cell])]
    }

    /// Brightness of a sample beside another one: less where that lies on another sheet or across a crease.
    #[inline(always)]
    fn edge(&self, own: &Sample, other: &Sample, step: [f64; 2]) -> f32 {
        if own.face == other.face {
            return 1.0;
        }
        if other.face == NOTHING || self.is_jump(own, other, step) {
            return Shading::OUTLINE;
        }
        let may_fold = own.paint & other.paint & SMOOTH == 0;
        if may_fold && self.shading.is_crease(own.face, other.face) { Shading::CREASE } else { 1.0 }
    }

    /// Returns true if each of two samples lies far from the plane of the other.
    #[inline(always)]
    fn is_jump(&self, own: &Sample, other: &Sample, step: [f64; 2]) -> bool {
        let jump_mm = self.shading.jump_mm;
        let [depth_mm, other_mm] = [own.depth_mm, other.depth_mm].map(f64::from);
        // Between neighbours, the way across the picture is short: mostly the difference of depths says it all.
        let across_mm = other_mm / self.seen.fine.focal_px;
        let along_mm = (other_mm - depth_mm).abs();
        if along_mm * f64::from(own.slant) + across_mm <= jump_mm {
            return false;
        }
        let [from, to] = [own.at, [own.at[0] + step[0], own.at[1] + step[1]]].map(|at| self.seen.fine.direction(at));
        let way_mm = self.seen.fine.camera_from_part.inverse().direction(&(to * other_mm - from * depth_mm));
        let beyond = |face: usize| way_mm.dot(&self.shading.normal(face).cast()).abs() > jump_mm;
        beyond(own.face) && beyond(other.face)
    }
}

/// No triangle.
const NOTHING: usize = usize::MAX;

/// A sample of the picture.
#[derive(Clone, Copy)]
struct Sample {
    face: usize,
    paint: u32,
    depth_mm: f32,
    /// Length of the direction to it, of which the depth is 1.
    slant: f32,
    at: [f64; 2],
}

/// Samples of a row: triangle and paint, and depths.
#[derive(Default)]
struct SampleRow {
    faces: Vec<usize>,
    paints: Vec<u32>,
    depths_mm: Vec<f32>,
}

impl SampleRow {
    /// Reads a row of the buffer; all is empty below it.
    #[inline(always)]
    fn read(&mut self, painter: &mut Painter<'_>, y: usize) {
        let seen = painter.seen;
        let row = seen.nearest.row(y);
        self.depths_mm.clear();
        self.depths_mm.extend(row.iter().map(|sample| 1.0 / inverse_depth_of(*sample)));
        self.faces.clear();
        self.faces.extend(row.iter().map(|sample| if *sample == 0 { NOTHING } else { face_of(*sample) }));
        self.paints.clear();
        for face in &self.faces {
            self.paints.push(if *face == NOTHING { 0 } else { painter.paint(*face) });
        }
    }

    /// A sample; nothing beyond the row.
    #[inline(always)]
    fn at(&self, x: usize, y: usize, slant: f32) -> Sample {
        let at = [x as f64 + 0.5, y as f64 + 0.5];
        match self.faces.get(x) {
            Some(face) => Sample { face: *face, paint: self.paints[x], depth_mm: self.depths_mm[x], slant, at },
            None => Sample { face: NOTHING, paint: 0, depth_mm: 0.0, slant, at },
        }
    }
}

/// Paints the samples and averages those of every pixel.
struct Resolve<'a> {
    painter: Painter<'a>,
    glowing: Option<&'a DepthBuffer>,
}

impl Kernel for Resolve<'_> {
    type Output = Image;

    #[inline(always)]
    fn run(mut self) -> Image {
        let [width, height] = self.painter.seen.size_px();
        let mut rgba = vec![[0; 4]; width * height];
        let mut rows: [SampleRow; 3] = Default::default();
        rows[2].read(&mut self.painter, 0);
        // The slope of the picture's corner bounds that of every direction.
        let [w, h] = self.painter.seen.fine.size_px.map(|n| n as f64);
        let corners = [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]];
        let slant = corners.map(|corner| self.painter.seen.fine.direction(corner).norm()).into_iter().fold(1.0, f64::max) as f32;
        for y in 0..height {
            rows.swap(0, 2);
            rows[1].read(&mut self.painter, SAMPLES * y + 1);
            rows[2].read(&mut self.painter, SAMPLES * y + 2);
            for x in 0..width {
                rgba[y * width + x] = self.pixel(&rows, [x, y], slant);
            }
        }
        Image { size_px: [width, height], rgba }
    }
}

impl Resolve<'_> {
    #[inline(always)]
    fn pixel(&mut self, rows: &[SampleRow; 3], [x, y]: [usize; 2], slant: f32) -> [u8; 4] {
        let (left, top) = (SAMPLES * x, SAMPLES * y);
        let [a, b, c, d] = [rows[0].faces[left], rows[0].faces[left + 1], rows[1].faces[left], rows[1].faces[left + 1]];
        if a == NOTHING && b == NOTHING && c == NOTHING && d == NOTHING {
            return [0; 4];
        }
        let is_alone = a == b && a == c && a == d && {
            let beside = |row: &SampleRow, x: usize| row.faces.get(x).is_some_and(|face| *face == a);
            beside(&rows[0], left + 2) && beside(&rows[1], left + 2) && beside(&rows[2], left) && beside(&rows[2], left + 1)
        };
        if is_alone && !self.glows(left, top) {
            let [r, g, b] = self.painter.colour(a, rows[0].paints[left], [left as f64 + 1.0, top as f64 + 1.0]);
            return [r, g, b, 255];
        }
        if self.is_quiet(rows, left, slant) && !self.glows(left, top) {
            return self.mean(rows, [left, top]);
        }
        let (mut sums, mut hits) = ([0u16; 3], 0);
        for (down, across) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            if let Some(rgb) = self.sample(rows, [left + across, top + down], down, slant) {
                (0..3).for_each(|channel| sums[channel] += u16::from(rgb[channel]));
                hits += 1;
            }
        }
        let [r, g, b] = sums.map(|sum| (sum / hits) as u8);
        [r, g, b, (hits * 255 / (SAMPLES * SAMPLES) as u16) as u8]
    }

    /// Returns true if no line is drawn in a pixel: triangles that fold nowhere are at all its samples and those beside them, all of
    /// about the same depth.
    #[inline(always)]
    fn is_quiet(&self, rows: &[SampleRow; 3], left: usize, slant: f32) -> bool {
        if left + 2 >= rows[0].faces.len() || rows[2].faces.is_empty() {
            return false;
        }
        let (mut marks, mut nearest_mm, mut furthest_mm) = (SMOOTH, f32::INFINITY, 0.0);
        for (row, across) in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1)] {
            marks &= rows[row].paints[left + across];
            nearest_mm = simd_min(nearest_mm, rows[row].depths_mm[left + across]);
            furthest_mm = simd_max(furthest_mm, rows[row].depths_mm[left + across]);
        }
        let across_mm = f64::from(furthest_mm) / self.painter.seen.fine.focal_px;
        marks != 0 && f64::from(furthest_mm - nearest_mm) * f64::from(slant) + across_mm <= self.painter.shading.jump_mm
    }

    /// Colour of a pixel in which no line is drawn and nothing glows.
    #[inline(always)]
    fn mean(&mut self, rows: &[SampleRow; 3], [left, top]: [usize; 2]) -> [u8; 4] {
        let mut sums = [0u32; 3];
        for (down, across) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let (face, paint) = (rows[down].faces[left + across], rows[down].paints[left + across]);
            let at = [(left + across) as f64 + 0.5, (top + down) as f64 + 0.5];
            let [r, g, b] = self.painter.colour(face, paint, at);
            sums = [sums[0] + u32::from(r), sums[1] + u32::from(g), sums[2] + u32::from(b)];
        }
        [(sums[0] / 4) as u8, (sums[1] / 4) as u8, (sums[2] / 4) as u8, 255]
    }

    /// Returns true if something may glow within a pixel.
    #[inline(always)]
    fn glows(&self, left: usize, top: usize) -> bool {
        let glows = |buffer: &DepthBuffer| {
            let [first, second] = [buffer.row(top), buffer.row(top + 1)];
            first[left] | first[left + 1] | second[left] | second[left + 1] != 0
        };
        self.glowing.is_some_and(glows)
    }

    #[inline(always)]
    fn sample(&mut self, rows: &[SampleRow; 3], [x, y]: [usize; 2], row: usize, slant: f32) -> Option<[u8; 3]> {
        let own = rows[row].at(x, y, slant);
        if own.face == NOTHING {
            return None;
        }
        let right = self.painter.edge(&own, &rows[row].at(x + 1, y, slant), [1.0, 0.0]);
        let below = self.painter.edge(&own, &rows[row + 1].at(x, y + 1, slant), [0.0, 1.0]);
        let outline = right.min(below);
        let rgb = self.painter.colour(own.face, own.paint, own.at);
        let front = if outline < 1.0 { scaled(rgb, outline) } else { rgb };
        let hidden = self.glowing.and_then(|buffer| buffer.at(x, y)).map(face_of).filter(|face| *face != own.face);
        match hidden.map(|face| self.painter.hidden_ink(face, own.at)) {
            Some(ink) if ink.glows() => Some(mixed(front, ink.rgb(), GLOW)),
            _ => Some(front),
        }
    }
}

pub(super) fn mixed(below: [u8; 3], above: [u8; 3], opacity: f64) -> [u8; 3] {
    let mix = |channel: usize| f64::from(below[channel]) * (1.0 - opacity) + f64::from(above[channel]) * opacity;
    [0, 1, 2].map(|channel| mix(channel).round() as u8)
}

/// The camera with one pixel per sample.
fn finer(camera: &Camera) -> Camera {
    let factor = SAMPLES as f64;
    Camera {
        camera_from_part: camera.camera_from_part,
        size_px: camera.size_px.map(|n| n * SAMPLES),
        focal_px: camera.focal_px * factor,
        centre_px: camera.centre_px.map(|c| c * factor),
    }
}

#[inline(always)]
pub(super) fn scaled(rgb: [u8; 3], light: f32) -> [u8; 3] {
    // Truncation of a sum with a half rounds.
    let channel = |channel: u8| (f32::from(channel) * light + 0.5) as u8;
    [channel(rgb[0]), channel(rgb[1]), channel(rgb[2])]
}
