//! Light and lines: normals smoothed over gentle edges, a lamp and a sky, outlines where the surface jumps or folds.

use nalgebra::{Point3, Vector3};

use crate::geometry::{Device, FaceLists, Mesh, Part, Pose};

/// Cosine of 40°: facets that meet at a smaller angle are shaded as one smooth surface and get no line.
const CREASE_COS: f64 = 0.766;
/// Min jump in depth that is drawn as a line, as a share of the part's diagonal.
const JUMP_OF_DIAGONAL: f64 = 0.008;
/// Max facets at a vertex for smoothing; vertices with more are tips and hubs, and their facets keep their own normals.
const MAX_FAN: usize = 64;
/// Darkening of a crease.
const CREASE: f64 = 0.62;

/// Unit vector towards the lamp, to four digits, camera frame: above and to the left of the viewer.
const TOWARDS_LAMP: Vector3<f64> = Vector3::new(-0.3499, -0.5998, -0.7197);

/// A lamp beside a camera and a sky above it, part frame.
pub(super) struct Lamp {
    towards_lamp: Vector3<f64>,
    up: Vector3<f64>,
}

impl Lamp {
    /// The lamp of a camera.
    pub(super) fn beside(part_from_camera: &Pose<Part, Device>) -> Self {
        Self { towards_lamp: part_from_camera.direction(&TOWARDS_LAMP), up: part_from_camera.direction(&-Vector3::y()) }
    }

    /// Darkest shade of a surface: so dark only that colours of one picture remain apart (`palette.rs`).
    pub(super) const MIN_LIGHT: f64 = 0.76;

    /// Brightness of a surface with this unit normal, [`Lamp::MIN_LIGHT`] to 1.
    pub(super) fn light(&self, normal: &Vector3<f64>) -> f64 {
        let sky = 0.5 + 0.5 * normal.dot(&self.up);
        (Self::MIN_LIGHT + 0.20 * normal.dot(&self.towards_lamp).max(0.0) + 0.04 * sky).min(1.0)
    }
}

/// Lighting of a part.
pub(super) struct Shading<'a> {
    mesh: &'a Mesh,
    /// Smoothed normals at the corners of each triangle of the mesh.
    corner_normals: Vec<[Vector3<f32>; 3]>,
    jump_mm: f64,
}

impl<'a> Shading<'a> {
    /// Darkening of an outline.
    pub(super) const OUTLINE: f64 = 0.38;

    /// Prepares the shading of a mesh.
    pub(super) fn new(mesh: &'a Mesh) -> Self {
        let jump_mm = mesh.aabb().extent_mm().norm() * JUMP_OF_DIAGONAL;
        Self { mesh, corner_normals: corner_normals(mesh), jump_mm }
    }

    /// Smoothed unit normal at a point of triangle `face`, part frame.
    pub(super) fn normal(&self, face: u32, p: &Point3<f64>) -> Vector3<f64> {
        let [a, b, c] = self.mesh.corners(face as usize);
        let scaled = (b - a).cross(&(c - a));
        let over = |u: Vector3<f64>, v: Vector3<f64>| (u.cross(&v).dot(&scaled) / scaled.norm_squared()).clamp(0.0, 1.0);
        let weights = [over(b - p, c - p), over(c - p, a - p), over(a - p, b - p)];
        let normals = &self.corner_normals[face as usize];
        let blended: Vector3<f64> = normals.iter().zip(weights).map(|(n, weight)| n.cast::<f64>() * weight).sum();
        blended.try_normalize(1e-6).unwrap_or_else(|| scaled.normalize())
    }

    /// Darkening between two neighbouring samples, from the normals of their facets and the vector from one to the other.
    pub(super) fn edge(&self, normal: &Vector3<f64>, other: &Vector3<f64>, way_mm: &Vector3<f64>) -> f64 {
        if way_mm.dot(normal).abs() > self.jump_mm && way_mm.dot(other).abs() > self.jump_mm {
            Self::OUTLINE
        } else if normal.dot(other) < CREASE_COS {
            CREASE
        } else {
            1.0
        }
    }
}

fn corner_normals(mesh: &Mesh) -> Vec<[Vector3<f32>; 3]> {
    let around = FaceLists::around(&mesh.faces, mesh.vertices_mm.len());
    let scaled: Vec<Vector3<f64>> = (0..mesh.faces.len()).map(|face| mesh.scaled_normal(face)).collect();
    let unit: Vec<Vector3<f64>> = scaled.iter().map(|n| n.normalize()).collect();
    let smoothed = |face: usize, vertex: u32| {
        let fan = around.of(vertex as usize);
        if fan.len() > MAX_FAN {
            return unit[face].cast();
        }
        let gentle = fan.iter().filter(|other| unit[**other as usize].dot(&unit[face]) > CREASE_COS);
        let sum: Vector3<f64> = gentle.map(|other| scaled[*other as usize]).sum();
        sum.try_normalize(0.0).unwrap_or(unit[face]).cast()
    };
    (0..mesh.faces.len()).map(|face| mesh.faces[face].map(|vertex| smoothed(face, vertex))).collect()
}
