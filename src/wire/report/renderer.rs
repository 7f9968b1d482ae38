//! A small depth-buffer renderer. Patches are rasterised with 2 × 2 samples a pixel; each sample then takes the ink of
//! the nearest surface sample of its patch, is lit by one lamp beside the camera and a soft sky, and is darkened along
//! outlines and creases. Fixed-point edge functions (Pineda, *A Parallel Algorithm for Polygon Rasterization*, 1988)
//! leave no cracks between neighbours, and make the picture the same on every run.
//!
//! Cost: O(patches + pixels); 200 000 triangles at 640 × 480 take about 0.1 s.

use std::ops::Range;

use nalgebra::{Point3, Rotation3};

use super::camera::Camera;
use super::image::Image;
use super::palette::Ink;
use super::shading::{Lamp, Shading};
use crate::geometry::{Mesh, assess};
use crate::planning::surface::{Patch, Surface};

/// Samples a pixel along each axis.
const SAMPLES: usize = 2;
/// Steps of the fixed-point grid a sample.
const STEPS: i64 = 16;
/// Inner sides lie this much farther, so that of two coincident sheets the one that faces the camera is seen.
const BACK_BIAS: f64 = 1e-5;
/// Coordinates beyond this many steps are pulled in, far outside any picture: products then fit 64 bits.
const FAR_STEPS: f64 = 1e9;
/// Opacity of missed surface that something hides.
const GLOW: f64 = 0.65;
const NOTHING: u32 = u32::MAX;

/// What all pictures of a part share.
pub(super) struct Scene<'a> {
    surface: &'a Surface,
    shading: Shading<'a>,
    /// Whether inner sides can come into sight: the mesh is open, or wound both ways.
    pub(super) open: bool,
}

impl<'a> Scene<'a> {
    /// The scene of a part; `surface` must be that of `mesh`.
    pub(super) fn new(mesh: &'a Mesh, surface: &'a Surface) -> Self {
        let health = assess(mesh);
        let open = !health.watertight || health.inconsistent_edges > 0;
        Self { surface, shading: Shading::new(mesh), open }
    }

    /// The picture that `camera` takes, each surface sample in its ink. The background is transparent.
    pub(super) fn render(&self, camera: &Camera, inks: &[Ink]) -> Image {
        let eye = Eye::new(camera);
        let all = self.rasterise(&eye.fine, |_| true);
        develop(&eye.fine, |x, y| self.colour(&all, &eye, inks, x, y))
    }

    /// The same, with missed surface glowing through whatever hides it.
    pub(super) fn render_through(&self, camera: &Camera, inks: &[Ink]) -> Image {
        let eye = Eye::new(camera);
        let all = self.rasterise(&eye.fine, |_| true);
        let is_missed = |sample: usize| matches!(inks[sample], Ink::Missed(_));
        let missed = self.rasterise(&eye.fine, |patch| samples_of(patch).any(is_missed));
        develop(&eye.fine, |x, y| {
            let front = self.colour(&all, &eye, inks, x, y)?;
            let hidden = missed.patch_at(x, y).filter(|patch| all.patch_at(x, y) != Some(*patch));
            let ink = hidden.map(|patch| inks[self.nearest_sample(self.patch(patch), &missed.point(&eye, x, y))]);
            Some(match ink {
                Some(ink @ Ink::Missed(_)) => mixed(front, ink.rgb(), GLOW),
                _ => front,
            })
        })
    }

    fn rasterise(&self, fine: &Camera, keep: impl Fn(&Patch) -> bool) -> DepthBuffer {
        let mut buffer = DepthBuffer::new(fine.size_px);
        for (patch, number) in self.surface.patches.iter().zip(0..).filter(|(patch, _)| keep(patch)) {
            let corners = patch.corners_mm.map(|p| fine.camera_from_part.point(&p));
            let (fan, count) = Camera::beyond_near(corners);
            for last in 2..count {
                buffer.draw(fine, [fan[0], fan[last - 1], fan[last]], number);
            }
        }
        buffer
    }

    /// Colour of one sample of the buffer; `None` where there is nothing.
    fn colour(&self, buffer: &DepthBuffer, eye: &Eye, inks: &[Ink], x: usize, y: usize) -> Option<[u8; 3]> {
        let patch = self.patch(buffer.patch_at(x, y)?);
        let p = buffer.point(eye, x, y);
        let outline = self.outline(buffer, eye, patch, &p, x, y);
        if patch.normal.dot(&(eye.at_mm - p)) <= 0.0 {
            return Some(scaled(Ink::Back.rgb(), outline));
        }
        let light = eye.lamp.light(&self.shading.normal(patch.face, &p));
        Some(scaled(inks[self.nearest_sample(patch, &p)].rgb(), light * outline))
    }

    fn patch(&self, number: u32) -> &Patch {
        &self.surface.patches[number as usize]
    }

    fn nearest_sample(&self, patch: &Patch, p: &Point3<f64>) -> usize {
        let distance = |sample: &usize| (self.surface.sample_mm[*sample] - p).norm_squared();
        let nearest = samples_of(patch).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.unwrap_or(patch.first_sample as usize)
    }

    /// Darkens a sample at `p` whose neighbour to the right or below lies on another sheet, or across a crease.
    fn outline(&self, buffer: &DepthBuffer, eye: &Eye, patch: &Patch, p: &Point3<f64>, x: usize, y: usize) -> f64 {
        let own = buffer.patch_at(x, y);
        let darkening = |(x, y): (usize, usize)| match buffer.patch_at(x, y) {
            None => Shading::OUTLINE,
            next if next == own => 1.0,
            Some(next) => self.shading.edge(&patch.normal, &self.patch(next).normal, &(buffer.point(eye, x, y) - p)),
        };
        darkening((x + 1, y)).min(darkening((x, y + 1)))
    }
}

/// A camera with one pixel a sample, and what lighting needs of it, in the part's frame.
struct Eye {
    fine: Camera,
    at_mm: Point3<f64>,
    part_from_camera: Rotation3<f64>,
    lamp: Lamp,
}

impl Eye {
    fn new(camera: &Camera) -> Self {
        let part_from_camera = camera.camera_from_part.inverse();
        Self {
            fine: finer(camera),
            at_mm: part_from_camera.origin_mm(),
            part_from_camera: part_from_camera.isometry().rotation.to_rotation_matrix(),
            lamp: Lamp::beside(&part_from_camera),
        }
    }
}

/// Sums up the samples of every pixel.
fn develop(fine: &Camera, colour: impl Fn(usize, usize) -> Option<[u8; 3]>) -> Image {
    let [width, height] = fine.size_px.map(|n| n / SAMPLES);
    let mut sums = vec![[0u16; 4]; width * height];
    for y in 0..height * SAMPLES {
        for x in 0..width * SAMPLES {
            if let Some(rgb) = colour(x, y) {
                let sum = &mut sums[(y / SAMPLES) * width + x / SAMPLES];
                (0..3).for_each(|channel| sum[channel] += u16::from(rgb[channel]));
                sum[3] += 1;
            }
        }
    }
    Image::from_sums([width, height], &sums, (SAMPLES * SAMPLES) as u16)
}

fn samples_of(patch: &Patch) -> Range<usize> {
    let first = patch.first_sample as usize;
    first..first + patch.samples as usize
}

fn mixed(below: [u8; 3], above: [u8; 3], opacity: f64) -> [u8; 3] {
    let mix = |channel: usize| f64::from(below[channel]) * (1.0 - opacity) + f64::from(above[channel]) * opacity;
    [0, 1, 2].map(|channel| mix(channel).round() as u8)
}

/// The camera with one pixel a sample.
fn finer(camera: &Camera) -> Camera {
    let factor = SAMPLES as f64;
    Camera {
        camera_from_part: camera.camera_from_part,
        size_px: camera.size_px.map(|n| n * SAMPLES),
        focal_px: camera.focal_px * factor,
        centre_px: camera.centre_px.map(|c| c * factor),
    }
}

fn scaled(rgb: [u8; 3], light: f64) -> [u8; 3] {
    rgb.map(|channel| (f64::from(channel) * light).round().clamp(0.0, 255.0) as u8)
}

/// Nearest patch at each sample, row-major.
struct DepthBuffer {
    width: usize,
    height: usize,
    /// 1/z: linear across a picture of a plane. 0 where there is nothing.
    inverse_depth: Vec<f32>,
    patch: Vec<u32>,
}

/// A corner on the fixed-point grid.
#[derive(Clone, Copy)]
struct Corner {
    x: i64,
    y: i64,
    inverse_depth: f64,
}

/// An edge function over the fixed-point grid: at least 0 on the inner side.
struct Edge {
    dx: i64,
    dy: i64,
    at_origin: i64,
}

impl Edge {
    fn between(a: Corner, b: Corner) -> Self {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        Self { dx, dy, at_origin: dy * a.x - dx * a.y }
    }

    fn at(&self, x: i64, y: i64) -> i64 {
        self.dx * y - self.dy * x + self.at_origin
    }

    /// The value one step outside the edge. What lies within is drawn too: where a long edge meets two short ones,
    /// rounding would leave pinholes otherwise.
    fn tolerance(&self) -> i64 {
        self.dx.abs().max(self.dy.abs())
    }
}

impl DepthBuffer {
    fn new(size_px: [usize; 2]) -> Self {
        let [width, height] = size_px;
        Self { width, height, inverse_depth: vec![0.0; width * height], patch: vec![NOTHING; width * height] }
    }

    /// The patch seen at a sample.
    fn patch_at(&self, x: usize, y: usize) -> Option<u32> {
        let inside = x < self.width && y < self.height;
        inside.then(|| self.patch[y * self.width + x]).filter(|patch| *patch != NOTHING)
    }

    /// Where it is seen, part frame; only where there is a patch.
    fn point(&self, eye: &Eye, x: usize, y: usize) -> Point3<f64> {
        let depth_mm = 1.0 / f64::from(self.inverse_depth[y * self.width + x]);
        let direction = eye.fine.direction([x as f64 + 0.5, y as f64 + 0.5]);
        eye.at_mm + eye.part_from_camera * (direction * depth_mm)
    }

    /// Draws a triangle given in the camera's frame, all of it beyond the near plane.
    fn draw(&mut self, fine: &Camera, corners_mm: [Point3<f64>; 3], patch: u32) {
        let [Some(a), Some(mut b), Some(mut c)] = corners_mm.map(|p| corner(fine, &p)) else { return };
        let mut twice_area = Edge::between(a, b).at(c.x, c.y);
        // With y down, a triangle that is counter-clockwise seen from outside comes out negative when it faces us.
        let mut bias = 1.0 - BACK_BIAS;
        if twice_area < 0 {
            (b, c, twice_area, bias) = (c, b, -twice_area, 1.0);
        }
        if twice_area == 0 {
            return;
        }
        let edges = [Edge::between(b, c), Edge::between(c, a), Edge::between(a, b)];
        let inverse_depths = [a, b, c].map(|corner| corner.inverse_depth * bias);
        let (Some(columns), Some(rows)) = (span([a.x, b.x, c.x], self.width), span([a.y, b.y, c.y], self.height)) else {
            return;
        };
        for y in rows {
            for x in columns.clone() {
                self.test(x, y, &edges, inverse_depths, twice_area, patch);
            }
        }
    }

    #[inline]
    fn test(&mut self, x: usize, y: usize, edges: &[Edge; 3], inverse_depths: [f64; 3], twice_area: i64, patch: u32) {
        let centre = |n: usize| n as i64 * STEPS + STEPS / 2;
        let values = [0, 1, 2].map(|i| edges[i].at(centre(x), centre(y)));
        if (0..3).any(|i| values[i] + edges[i].tolerance() < 0) {
            return;
        }
        let weighted: f64 = (0..3).map(|i| values[i] as f64 * inverse_depths[i]).sum();
        let nearest = inverse_depths.into_iter().fold(0.0, f64::max);
        let inverse_depth = (weighted / twice_area as f64).min(nearest) as f32;
        let at = y * self.width + x;
        if inverse_depth > self.inverse_depth[at] {
            self.inverse_depth[at] = inverse_depth;
            self.patch[at] = patch;
        }
    }
}

fn corner(fine: &Camera, p: &Point3<f64>) -> Option<Corner> {
    let [x, y] = fine.pixel(p)?.map(|c| (c * STEPS as f64).round().clamp(-FAR_STEPS, FAR_STEPS) as i64);
    Some(Corner { x, y, inverse_depth: 1.0 / p.z })
}

/// Samples whose centres can lie between the lowest and the highest of the corners, one step of tolerance included.
fn span(corners: [i64; 3], size: usize) -> Option<Range<usize>> {
    let low = corners.into_iter().min()?.saturating_sub(1 + STEPS / 2).div_euclid(STEPS).max(0);
    let high = (corners.into_iter().max()? + 1).div_euclid(STEPS).min(size as i64 - 1);
    (low <= high).then(|| low as usize..high as usize + 1)
}
