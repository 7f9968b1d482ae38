//! The point that rays start from, as f32 sees it: what is seen from it keeps its order along each axis, so that a box
//! holds its triangles whatever the roundings.

use nalgebra::Point3;

use super::lanes::{simd_from_fn, simd_max};

/// Boxes grow by this share of the largest coordinate: 16 roundings, more than the tests of a triangle and of a box err
/// by together (3 each along an axis, √3 times that in space).
const PADDING: f32 = 16.0 * f32::EPSILON / 2.0;
/// Directions count as this long at least along every axis, so that they have a finite inverse; over 10⁵ mm that moves a
/// ray by 10⁻¹³ mm.
const MIN_COMPONENT: f32 = 1e-18;

pub(super) struct Origin {
    /// Origin in two parts, axis by axis: x relative to the origin is `x - first - second`.
    pub(super) parts: [[f32; 2]; 3],
    /// The second part for lower planes and for upper ones, with the padding in it.
    pub(super) padded: [[f32; 2]; 3],
}

impl Origin {
    /// Splits an origin for a tree without coordinates beyond `reach`.
    #[inline(always)]
    pub(super) fn new(origin: &Point3<f64>, reach: f32) -> Self {
        let parts: [[f32; 2]; 3] = simd_from_fn(|axis| {
            let first = origin[axis] as f32;
            [first, (origin[axis] - f64::from(first)) as f32]
        });
        let padding = PADDING * (0..3).fold(0.0, |max, axis| simd_max(max, reach + parts[axis][0].abs()));
        Self { parts, padded: simd_from_fn(|axis| [parts[axis][1] + padding, parts[axis][1] - padding]) }
    }
}

/// The inverse of one component of a direction, which is negative if it `descends`.
#[inline(always)]
pub(super) fn inverse(component: f32, descends: bool) -> f32 {
    let length = component.abs();
    let length = if length > MIN_COMPONENT { length } else { MIN_COMPONENT };
    if descends { -1.0 / length } else { 1.0 / length }
}
