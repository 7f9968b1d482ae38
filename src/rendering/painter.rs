//! Colours of the samples of a picture: ink and light of the triangle at each, and lines where the surface jumps or folds.

use nalgebra::{Matrix3, Vector3};

use super::depth_buffer::STEPS;
use super::palette::Ink;
use super::shading::{Lamp, Shading};
use super::{Seen, scaled};

/// Width and height, in steps, below which a triangle is lit as a whole.
const FLAT_STEPS: i32 = 8 * STEPS as i32;
/// Marks of a triangle's colour: it has one alone, or one at each place; and that it folds nowhere.
const FLAT: u32 = 1 << 24;
const VARIES: u32 = 1 << 25;
pub(super) const SMOOTH: u32 = 1 << 26;

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
pub(super) struct Painter<'a> {
    pub(super) seen: &'a Seen<'a>,
    pub(super) shading: &'a Shading,
    lamp: Lamp,
    codes: &'a [u8],
    colours: Vec<[u8; 3]>,
    /// Colour and marks of each triangle, 0 as long as nobody asked.
    paint: Vec<u32>,
    lit: Option<Lit>,
    hidden: Option<(usize, Plane)>,
}

impl<'a> Painter<'a> {
    pub(super) fn new(seen: &'a Seen<'a>, shading: &'a Shading, codes: &'a [u8]) -> Self {
        let lamp = Lamp::beside(&seen.fine.camera_from_part.inverse());
        let colours = Ink::ALL.into_iter().map(Ink::rgb).collect();
        let paint = vec![0; seen.model.faces.len()];
        Self { seen, shading, lamp, codes, colours, paint, lit: None, hidden: None }
    }

    /// Colour and marks of a triangle.
    #[inline(always)]
    pub(super) fn paint(&mut self, face: usize) -> u32 {
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
    pub(super) fn colour(&mut self, face: usize, paint: u32, [x, y]: [f64; 2]) -> [u8; 3] {
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
    pub(super) fn hidden_ink(&mut self, face: usize, [x, y]: [f64; 2]) -> Ink {
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
    pub(super) fn edge(&self, own: &Sample, other: &Sample, step: [f64; 2]) -> f32 {
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

/// Index that stands for no triangle.
pub(super) const NOTHING: usize = usize::MAX;

/// A sample of the picture.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub(super) face: usize,
    pub(super) paint: u32,
    pub(super) depth_mm: f32,
    /// Length of the direction to it, of which the depth is 1.
    pub(super) slant: f32,
    pub(super) at: [f64; 2],
}
