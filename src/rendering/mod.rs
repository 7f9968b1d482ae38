//! Pictures of meshes and bodies, by a small software renderer.
//!
//! Triangles go through a depth buffer with 2 × 2 samples per pixel. Each sample then takes the ink of its cell of the triangle, is lit
//! by a lamp beside the camera and by a soft sky, and is darkened along outlines and creases. What is seen from a camera ([`Seen`])
//! serves every picture from there. Equal inputs give equal pictures, at every level of vector instructions.
//!
//! Cost: O(vertices + triangles + pixels). Triangles of less than about four pixels are lit as a whole; pixels in which one
//! triangle is alone are lit once. Memory of a picture of 640 × 480 pixels: 10 MB for the samples, 2.5 MB for the pixels, and 16 bytes
//! a vertex and 4 a triangle of the model, which is at most 6 MB.

mod camera;
mod depth_buffer;
mod image;
mod model;
mod painter;
mod palette;
mod quantise;
mod shading;

#[cfg(test)]
mod tests;

use nalgebra::{Point3, Vector3};

pub use self::camera::Camera;
use self::depth_buffer::{DepthBuffer, Projected, face_of, inverse_depth_of};
pub use self::image::Image;
pub use self::model::{DrawnModel, MAX_TRIANGLES, SampledModel};
use self::painter::{NOTHING, Painter, SMOOTH, Sample};
pub use self::palette::{BodyRole, Ink, MissGroup};
pub use self::shading::Shading;
use crate::geometry::{Kernel, SimdLevel, simd_from_fn, simd_max, simd_min};

/// Samples per pixel along each axis.
const SAMPLES: usize = 2;
/// Opacity of missed surface that is hidden.
const GLOW: f64 = 0.8;
/// Relative difference of depth within which a point is the one seen at its pixel.
const SAME_DEPTH: f64 = 0.002;

/// The part from a camera.
pub struct Seen<'m> {
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
    pub fn new(model: &'m DrawnModel, camera: &Camera, level: SimdLevel) -> Self {
        let fine = finer(camera);
        let at_mm = camera.camera_from_part.inverse().origin_mm();
        let projected = level.run(Project { model, fine: &fine });
        let mut nearest = DepthBuffer::new(fine.size_px);
        level.run(Rasterise { model, fine: &fine, projected: &projected, keep: |_: usize| true, buffer: &mut nearest });
        Self { model, fine, at_mm, projected, nearest, level }
    }

    /// Returns true if a point of the surface with this normal, part frame, is seen in the picture.
    pub fn shows(&self, p_mm: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let seen = self.fine.camera_from_part.point(p_mm);
        let Some([x, y]) = self.fine.pixel(&seen).filter(|[x, y]| *x >= 0.0 && *y >= 0.0) else { return false };
        let Some(sample) = self.nearest.at(x as usize, y as usize) else { return false };
        let depth_mm = 1.0 / f64::from(inverse_depth_of(sample));
        normal.dot(&(self.at_mm - p_mm)) > 0.0 && seen.z <= depth_mm * (1.0 + SAME_DEPTH)
    }

    /// Cosine of the angle at which a surface with this normal, part frame, faces the camera at a point.
    pub fn facing(&self, p_mm: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let towards = self.at_mm - p_mm;
        normal.dot(&towards) / towards.norm()
    }

    /// Width and height of its pictures, pixels.
    pub fn size_px(&self) -> [usize; 2] {
        self.fine.size_px.map(|n| n / SAMPLES)
    }

    /// Pixel of a point, part frame.
    pub fn pixel(&self, p_mm: &Point3<f64>) -> Option<[f64; 2]> {
        let fine = self.fine.pixel(&self.fine.camera_from_part.point(p_mm))?;
        Some(fine.map(|c| c / SAMPLES as f64))
    }

    /// A picture of the part, each cell in the ink of its code, on a transparent background; if `through`, the inks that glow shine
    /// through whatever hides them ([`Ink::glows`]).
    pub fn picture(&self, shading: &Shading, codes: &[u8], through: bool) -> Image {
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
        for face in self.model.by_place.iter().map(|face| *face as usize) {
            let vertices = &self.model.faces[face];
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
        self.faces.extend(row.iter().map(|sample| if *sample > 0.0 { face_of(*sample) } else { NOTHING }));
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
            first[left] + first[left + 1] + second[left] + second[left + 1] > 0.0
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

fn mixed(below: [u8; 3], above: [u8; 3], opacity: f64) -> [u8; 3] {
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
fn scaled(rgb: [u8; 3], light: f32) -> [u8; 3] {
    // Truncation of a sum with a half rounds.
    let channel = |channel: u8| (f32::from(channel) * light + 0.5) as u8;
    [channel(rgb[0]), channel(rgb[1]), channel(rgb[2])]
}
