//! Mesh to patches and samples.

use nalgebra::{Point3, Vector3};

/// Dense number of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PatchId(pub u32);

/// A facet after refinement.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// Corners, part frame, mm.
    pub corners_mm: [Point3<f64>; 3],
    /// Triangle of the mesh it was cut from.
    pub face: u32,
    /// Unit outward normal.
    pub normal: Vector3<f64>,
    /// Area.
    pub area_mm2: f64,
    /// Its samples are `first_sample .. first_sample + samples`.
    pub first_sample: u32,
    /// Number of samples, at least 1.
    pub samples: u32,
}

/// Patches and samples of a part. Samples are ordered by patch.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Patches, ordered by face.
    pub patches: Vec<Patch>,
    /// Position of each sample, part frame, mm.
    pub sample_mm: Vec<Point3<f64>>,
    /// Patch of each sample.
    pub sample_patch: Vec<PatchId>,
    /// Whether each sample is asked for.
    pub asked: Vec<bool>,
}
