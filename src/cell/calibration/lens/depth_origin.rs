//! Commissioning of working distances: where the 480 of a data sheet is measured from. A plane is put at three or more known
//! working distances s, and its depth z on the scanner's axis is measured by the calibrated cameras: z = o + s · k. o is the depth of
//! the plane from which distances count, 0 for the cameras' optical centres; k is 1 unless a unit or a board is wrong.

use nalgebra::Vector3;

use super::adjust::Adjusted;
use super::fault::{LensError, LensFault};
use super::observations::BoardObservations;
use crate::cell::closed_list::closed_list;
use crate::cell::scanner::left_from_scanner;
use crate::geometry::counted;

/// Fewest planes.
pub const MIN_PLANES: usize = 3;
/// Largest difference of k from 1.
const MAX_SCALE_ERROR: f64 = 0.01;
/// Distance within which the origin is taken for that of the optical centres or the housing's front, mm, if its own uncertainty is
/// smaller.
const NEAR_MM: f64 = 2.0;

closed_list! {
    /// Plane from which working distances count.
    pub enum DepthDatum {
        /// Optical centres of the cameras.
        OpticalCentres = "optical_centres",
        /// Front of the housing.
        HousingFront = "housing_front",
        /// Neither of both.
        Other = "other",
    }
}

/// A plane at a known working distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StatedPlane {
    /// Working distance at which it was placed, mm.
    pub stated_mm: f64,
    /// Depth on the scanner's z axis as measured, mm.
    pub measured_mm: f64,
}

/// Place from which working distances count.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthOrigin {
    /// Depth of the plane from which they count, along z of the scanner, mm.
    pub origin_mm: f64,
    /// Standard deviation of the depth, mm, with k taken as 1.
    pub sigma_mm: f64,
    /// Slope k.
    pub scale: f64,
    /// Measured minus fitted depth of each plane, mm, k taken as 1.
    pub residuals_mm: Vec<f64>,
    /// Plane that it is.
    pub datum: DepthDatum,
}

/// Planes that observations have: boards at stated working distances, where they meet the scanner's z axis.
#[must_use]
pub fn stated_planes(observations: &BoardObservations, adjusted: &Adjusted) -> Vec<StatedPlane> {
    let scanner_from_left = left_from_scanner(&adjusted.device_from_left.right.inverse()).inverse();
    let views = observations.views.iter().zip(&adjusted.left_from_board);
    let planes = views.filter_map(|(view, board)| {
        let scanner_from_board = scanner_from_left * (*board)?;
        let normal = scanner_from_board.rotation * Vector3::z();
        let measured_mm = normal.dot(&scanner_from_board.translation.vector) / normal.z;
        Some(StatedPlane { stated_mm: view.stated_distance_mm?, measured_mm })
    });
    planes.collect()
}

/// Finds where working distances count from; `front_mm` is the depth of the housing's front, if it is known.
///
/// # Errors
/// [`LensError`]: less than three planes, planes at one distance, distances that are not to scale.
pub fn depth_origin(planes: &[StatedPlane], front_mm: Option<f64>) -> Result<DepthOrigin, LensError> {
    let fault = |code, detail: String| LensError::new(code, "planes", detail);
    if planes.len() < MIN_PLANES {
        let given = counted(planes.len(), "plane");
        return Err(fault(LensFault::TooFew, format!("{given}; at least {MIN_PLANES} at different distances")));
    }
    let is_distance = |value: f64| (1.0..=1e5).contains(&value);
    if let Some(plane) = planes.iter().find(|plane| !is_distance(plane.stated_mm) || !is_distance(plane.measured_mm)) {
        let detail = format!("{} = {} mm; allowed is 1 to 100000 mm", plane.stated_mm, plane.measured_mm);
        return Err(fault(LensFault::OutOfRange, detail));
    }
    let count = planes.len() as f64;
    let mean = |of: fn(&StatedPlane) -> f64| planes.iter().map(of).sum::<f64>() / count;
    let (stated, measured) = (mean(|plane| plane.stated_mm), mean(|plane| plane.measured_mm));
    let spread: f64 = planes.iter().map(|plane| (plane.stated_mm - stated).powi(2)).sum();
    if spread < 1.0 {
        return Err(fault(
            LensFault::Degenerate,
            "the planes are at one distance; spread them over the working depth".to_owned(),
        ));
    }
    let scale = planes.iter().map(|plane| (plane.stated_mm - stated) * (plane.measured_mm - measured)).sum::<f64>() / spread;
    if scale.is_nan() || (scale - 1.0).abs() > MAX_SCALE_ERROR {
        let detail = format!(
            "1 mm of stated distance is {scale:.4} mm measured; allowed is {} to {}: is the board's pitch right, and in mm?",
            1.0 - MAX_SCALE_ERROR,
            1.0 + MAX_SCALE_ERROR
        );
        return Err(fault(LensFault::UnitMismatch, detail));
    }
    let origin_mm = measured - stated;
    let residuals_mm: Vec<f64> = planes.iter().map(|plane| plane.measured_mm - plane.stated_mm - origin_mm).collect();
    let variance = residuals_mm.iter().map(|residual| residual * residual).sum::<f64>() / (count - 1.0);
    let sigma_mm = (variance / count).sqrt();
    let is_at = |depth_mm: f64| (origin_mm - depth_mm).abs() <= NEAR_MM.max(2.0 * sigma_mm);
    let distance = |depth_mm: Option<f64>| depth_mm.map_or(f64::INFINITY, |depth| (origin_mm - depth).abs());
    let datum = match front_mm {
        Some(front) if is_at(front) && distance(front_mm) < distance(Some(0.0)) => DepthDatum::HousingFront,
        _ if is_at(0.0) => DepthDatum::OpticalCentres,
        _ => DepthDatum::Other,
    };
    Ok(DepthOrigin { origin_mm, sigma_mm, scale, residuals_mm, datum })
}
