//! Light and lines: normals smoothed over gentle edges, a lamp and a sky, outlines where the surface jumps or folds.

use nalgebra::Vector3;

use super::model::DrawnModel;
use crate::geometry::{Device, FaceLists, Part, Pose, parallel};

/// Cosine of 40°: facets that meet at a smaller angle are shaded as one smooth surface and get no line.
const CREASE_COS: f32 = 0.766;
/// Min jump in depth that is drawn as a line, as a share of the part's diagonal.
const JUMP_OF_DIAGONAL: f64 = 0.008;
/// Max facets at a vertex for smoothing; vertices with more are tips and hubs, and their facets keep their own normals.
const MAX_FAN: usize = 64;

/// Unit vector towards the lamp, to four digits, camera frame: above and to the left of the viewer.
const TOWARDS_LAMP: Vector3<f64> = Vector3::new(-0.3499, -0.5998, -0.7197);

/// A lamp beside a camera and a sky above it, part frame.
pub(super) struct Lamp {
    towards_lamp: Vector3<f32>,
    up: Vector3<f32>,
}

impl Lamp {
    /// Darkest shade of a surface: so dark only that colours of one picture remain apart (`palette.rs`).
    pub(super) const MIN_LIGHT: f64 = 0.76;

    /// The lamp of a camera.
    pub(super) fn beside(part_from_camera: &Pose<Part, Device>) -> Self {
        let direction = |in_camera: &Vector3<f64>| part_from_camera.direction(in_camera).map(|c| c as f32);
        Self { towards_lamp: direction(&TOWARDS_LAMP), up: direction(&-Vector3::y()) }
    }

    /// Brightness of a surface with this unit normal, [`Lamp::MIN_LIGHT`] to 1.
    pub(super) fn light(&self, normal: &Vector3<f32>) -> f32 {
        let sky = 0.5 + 0.5 * normal.dot(&self.up);
        (Self::MIN_LIGHT as f32 + 0.20 * normal.dot(&self.towards_lamp).max(0.0) + 0.04 * sky).min(1.0)
    }
}

/// Normals of a part. 48 bytes a triangle.
pub struct Shading {
    /// Unit normal of each triangle.
    normals: Vec<Vector3<f32>>,
    /// Smoothed normals at its corners.
    corner_normals: Vec<[Vector3<f32>; 3]>,
    /// True for triangles that fold at none of their corners.
    is_smooth: Vec<bool>,
    /// Min jump that is drawn as a line, mm.
    pub jump_mm: f64,
}

impl Shading {
    /// Brightness of an outline.
    pub const OUTLINE: f32 = 0.38;
    /// Brightness of a crease.
    pub const CREASE: f32 = 0.62;

    /// Prepares the shading of a model.
    pub fn new(model: &DrawnModel) -> Self {
        let around = FaceLists::around(&model.faces, model.vertices_mm.len());
        let scaled: Vec<Vector3<f32>> = parallel::map_range(model.faces.len(), |face| scaled_normal(model, face));
        let unit = |n: &Vector3<f32>| n.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let normals: Vec<Vector3<f32>> = scaled.iter().map(unit).collect();
        let smoothed = |face: usize, vertex: u32| {
            let fan = around.of(vertex as usize);
            let own = normals[face];
            if fan.len() > MAX_FAN {
                return (own, false);
            }
            let (mut sum, mut is_smooth) = (Vector3::zeros(), true);
            for other in fan {
                let is_gentle = normals[*other as usize].dot(&own) > CREASE_COS;
                is_smooth &= is_gentle;
                sum += if is_gentle { scaled[*other as usize] } else { Vector3::zeros() };
            }
            (sum.try_normalize(0.0).unwrap_or(own), is_smooth)
        };
        let at_corners = |face: usize| {
            let [a, b, c] = model.faces[face].map(|vertex| smoothed(face, vertex));
            ([a.0, b.0, c.0], a.1 && b.1 && c.1)
        };
        let (corner_normals, is_smooth) = parallel::map_range(model.faces.len(), at_corners).into_iter().unzip();
        let jump_mm = model.aabb().extent_mm().norm() * JUMP_OF_DIAGONAL;
        Self { normals, corner_normals, is_smooth, jump_mm }
    }

    /// Unit normal of a triangle.
    pub fn normal(&self, face: usize) -> &Vector3<f32> {
        &self.normals[face]
    }

    /// Smoothed unit normals at the corners of a triangle.
    pub fn corner_normals(&self, face: usize) -> &[Vector3<f32>; 3] {
        &self.corner_normals[face]
    }

    /// True for a triangle that folds at none of its corners.
    pub fn is_smooth(&self, face: usize) -> bool {
        self.is_smooth[face]
    }

    /// True if two triangles side by side in a picture fold towards each other.
    pub fn is_crease(&self, face: usize, other: usize) -> bool {
        self.normals[face].dot(&self.normals[other]) < CREASE_COS
    }
}

fn scaled_normal(model: &DrawnModel, face: usize) -> Vector3<f32> {
    let [a, b, c] = model.corners(face);
    // Of triangles so small that their squares vanish in f32 only the direction matters.
    let scaled = (b - a).cross(&(c - a));
    scaled.map(|component| component as f32)
}
