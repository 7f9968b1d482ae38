//! A projector that is known only by the rectangle that it lights: at two or three depths its corners are where the corners of its
//! image go. Eight points on two planes fix pose, focal lengths and principal point; distortion they do not, it stays 0.

use nalgebra::{Isometry3, Point3, Vector2};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::assemble::RigDevice;
use super::fault::{LensError, LensFault};
use super::model::LENS;
use super::resect;
use crate::geometry::counted;

/// Fewest depths.
const MIN_PLANES: usize = 2;
/// Most depths.
const MAX_PLANES: usize = 100;

/// Rectangle that a projector lights, at several depths.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LitRectangleSpec {
    /// Width of the projector's image, px, 16 to 100000. Without one, any number: only ratios count.
    pub width_px: u32,
    /// Height of the projector's image, px, 16 to 100000.
    pub height_px: u32,
    /// Depths, 2 to 100 of them.
    pub planes: Vec<LitPlaneSpec>,
}

/// The rectangle at one depth, scanner frame: its size and middle, or its corners.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LitPlaneSpec {
    /// Depth along z of the scanner, mm, 1 to 10000, of a rectangle given by its size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub z_mm: Option<f64>,
    /// Width and height along x and y of the scanner, mm, 1 to 10000 each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 2, max_items = 2)]
    pub size_mm: Option<[f64; 2]>,
    /// Middle of the rectangle, x and y of the scanner, mm, -10000 to 10000 each. Default: 0, 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 2, max_items = 2)]
    pub middle_mm: Option<[f64; 2]>,
    /// Corners instead: where the image's corners top left, top right, bottom right and bottom left are lit, scanner frame, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 4, max_items = 4)]
    pub corners_mm: Option<[[f64; 3]; 4]>,
}

impl LitPlaneSpec {
    fn corners(&self, pointer: &str) -> Result<[[f64; 3]; 4], LensError> {
        let range = |name: &str, value: f64, low: f64, high: f64| {
            let detail = format!("is {value} mm; allowed is {low} to {high} mm");
            let fault = || LensError::new(LensFault::OutOfRange, format!("{pointer}/{name}"), detail);
            if (low..=high).contains(&value) { Ok(()) } else { Err(fault()) }
        };
        match (self.z_mm, self.size_mm, self.corners_mm) {
            (Some(z), Some([width, height]), None) => {
                range("z_mm", z, 1.0, 1e4)?;
                range("size_mm/0", width, 1.0, 1e4)?;
                range("size_mm/1", height, 1.0, 1e4)?;
                let [x, y] = self.middle_mm.unwrap_or_default();
                range("middle_mm/0", x, -1e4, 1e4)?;
                range("middle_mm/1", y, -1e4, 1e4)?;
                let corner = |right: f64, down: f64| [x + right * 0.5 * width, y + down * 0.5 * height, z];
                Ok([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
            }
            (None, None, Some(corners)) if self.middle_mm.is_none() => {
                for value in corners.into_iter().flatten() {
                    range("corners_mm", value, -1e4, 1e4)?;
                }
                Ok(corners)
            }
            _ => Err(LensError::new(LensFault::MissingField, pointer, "give z_mm and size_mm, or corners_mm")),
        }
    }
}

/// Lens and pose (device_from_scanner) of the projector that lights the rectangle.
///
/// # Errors
/// [`LensError`]: sizes out of range, less than two depths, rectangles that no projector lights.
pub fn lit_rectangle(spec: &LitRectangleSpec) -> Result<(RigDevice, Isometry3<f64>), LensError> {
    let (width, height) = (f64::from(spec.width_px), f64::from(spec.height_px));
    for (name, size) in [("width_px", width), ("height_px", height)] {
        if !(16.0..=1e5).contains(&size) {
            let detail = format!("is {size}; allowed is 16 to 100000");
            return Err(LensError::new(LensFault::OutOfRange, format!("/lit_rectangle/{name}"), detail));
        }
    }
    if !(MIN_PLANES..=MAX_PLANES).contains(&spec.planes.len()) {
        let detail = format!("has {}; allowed are {MIN_PLANES} to {MAX_PLANES}, better 3", counted(spec.planes.len(), "depth"));
        return Err(LensError::new(LensFault::TooFew, "/lit_rectangle/planes", detail));
    }
    let pixels = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(Vector2::from);
    let mut points = Vec::new();
    for (index, plane) in spec.planes.iter().enumerate() {
        let corners = plane.corners(&format!("/lit_rectangle/planes/{index}"))?;
        points.extend(corners.map(Point3::from).into_iter().zip(pixels));
    }
    let degenerate = || {
        let detail = "no projector lights these rectangles: are they at different depths, and their corners in order?";
        LensError::new(LensFault::Degenerate, "/lit_rectangle", detail)
    };
    let start = resect::direct(&points, [spec.width_px, spec.height_px]).ok_or_else(degenerate)?;
    let is_held = std::array::from_fn(|index| index >= 4);
    let found = resect::refine(&points, start, &is_held).ok_or_else(degenerate)?;
    found.lens.check("/projector")?;
    let sigma = found
        .covariance
        .map(|covariance| std::array::from_fn(|index| (!is_held[index]).then(|| covariance[(index, index)].max(0.0).sqrt())));
    let sigma: Option<[Option<f64>; LENS]> = sigma.filter(|_| found.rms_px > 1e-6);
    let device = RigDevice { lens: found.lens, sigma, rms_px: Some(found.rms_px), fit: None };
    Ok((device, found.device_from_points))
}
