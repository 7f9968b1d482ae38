//! Place of the part on the table: from three or more points (S. Umeyama, *Least-squares estimation of transformation parameters between
//! two point patterns*, IEEE TPAMI 13(4), 1991, without the scale), from the pose of a cloud that was registered to the part, or from the
//! named seats of a fixture.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, SMatrix, Translation3, Vector3};

use super::se3::adjoint;
use super::start::nearest_rotation;
use crate::geometry::descending;

/// Distance from the line through the farthest points below which points lie on a line, as a share of their extent.
const COLLINEAR: f64 = 1e-3;
/// Factor by which a mirrored fit has to be better for the points to be left-handed.
const CLEARLY: f64 = 5.0;
/// Largest root mean square of the residuals where no standard deviation is given, mm: points that are touched or picked in a cloud lie
/// within some tenths. The limit is our choice.
const RMS_MAX_MM: f64 = 1.0;
/// Factor by which residuals may exceed what a given standard deviation leads to, and a point what the others do. Our choice.
const TIMES: f64 = 3.0;
/// Distance from where the others put it up to which a point is not named, mm, or in given standard deviations of a coordinate: left out
/// of five, an honest point lies some 2.4 of them off. Our choice.
const NEAR_MM: f64 = 0.3;
const NEAR_SIGMAS: f64 = 5.0;
/// Points with the largest residuals that are left out, one at a time.
const LEFT_OUT: usize = 10;

/// Pose fitted to points.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// target_from_source.
    pub pose: Isometry3<f64>,
    /// Distance of each point from where the pose puts it, mm.
    pub residuals_mm: Vec<f64>,
    /// Root mean square of them.
    pub rms_mm: f64,
    /// Standard deviation of a coordinate: as given, else by the residuals; none from three points without one given.
    pub sigma_mm: Option<f64>,
    /// Covariance as a body increment of the source; none without a standard deviation.
    pub covariance: Option<Matrix6<f64>>,
}

/// Reason for which points tell no pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlacementError {
    /// Fewer than three pairs.
    #[error("{0} points; at least 3 that do not lie on a line")]
    TooFew(usize),
    /// Points on one line: the turn about it stays open.
    #[error("all points lie on a line: the turn about it is open; add a point at least {needed_mm:.1} mm beside it")]
    Collinear {
        /// Distance from the line that would do.
        needed_mm: f64,
    },
    /// One of the two sets is mirrored.
    #[error("the points fit mirrored ({mirrored_mm:.3} mm) and not as given ({as_given_mm:.3} mm): an axis is left-handed")]
    Mirrored {
        /// Root mean square as given.
        as_given_mm: f64,
        /// Root mean square mirrored.
        mirrored_mm: f64,
    },
    /// Distances between the points differ by a factor.
    #[error("distances between the points are {ratio:.4} times those on the part: another unit?")]
    Scale {
        /// Ratio.
        ratio: f64,
    },
    /// The seat does not exist.
    #[error("no such seat")]
    UnknownSeat,
}

/// Pose that takes the first of each pair to the second, by least squares.
///
/// # Errors
/// [`PlacementError`].
pub fn from_points(pairs_mm: &[[Point3<f64>; 2]], sigma_mm: Option<f64>) -> Result<Placement, PlacementError> {
    if pairs_mm.len() < 3 {
        return Err(PlacementError::TooFew(pairs_mm.len()));
    }
    let count = pairs_mm.len() as f64;
    let centre = |side: usize| pairs_mm.iter().map(|pair| pair[side].coords).sum::<Vector3<f64>>() / count;
    let centres = [centre(0), centre(1)];
    let off = |pair: &[Point3<f64>; 2], side: usize| pair[side].coords - centres[side];
    let scatter = |side: usize| -> f64 { pairs_mm.iter().map(|pair| off(pair, side).norm_squared()).sum() };
    check_shape(pairs_mm, &centres)?;
    let ratio = (scatter(1) / scatter(0)).sqrt();
    if !(0.5..=2.0).contains(&ratio) {
        return Err(PlacementError::Scale { ratio });
    }
    let moments: Matrix3<f64> = pairs_mm.iter().map(|pair| off(pair, 1) * off(pair, 0).transpose()).sum();
    let rotation = nearest_rotation(&moments).ok_or(PlacementError::TooFew(pairs_mm.len()))?;
    let pose = Isometry3::from_parts(Translation3::from(centres[1] - rotation * centres[0]), rotation);
    let residuals_mm: Vec<f64> = pairs_mm.iter().map(|[from, to]| (pose * from - to).norm()).collect();
    let squares: f64 = residuals_mm.iter().map(|each| each * each).sum();
    let rms_mm = (squares / count).sqrt();
    check_handedness(pairs_mm, &centres, rms_mm, scatter(0))?;
    let freedom = 3 * pairs_mm.len() - 6;
    let estimated = (freedom > 3).then(|| (squares / freedom as f64).sqrt());
    let sigma_mm = sigma_mm.or(estimated);
    let covariance = sigma_mm.and_then(|sigma_mm| covariance(pairs_mm, sigma_mm));
    Ok(Placement { pose, residuals_mm, rms_mm, sigma_mm, covariance })
}

/// Point that does not fit the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrayPoint {
    /// Place in the list.
    pub index: usize,
    /// Distance from where the fit to the others puts it, mm.
    pub off_mm: f64,
}

/// Largest root mean square of residuals of a placement that is to be trusted: 1 mm, or three times what a given standard deviation of a
/// coordinate leads to, σ √((3 n − 6) / n).
#[must_use]
pub fn rms_max_mm(points: usize, sigma_mm: Option<f64>) -> f64 {
    let freedom = (3 * points).saturating_sub(6) as f64;
    sigma_mm.map_or(RMS_MAX_MM, |sigma_mm| TIMES * sigma_mm * (freedom / points.max(1) as f64).sqrt())
}

/// The point that lies farthest, and more than three times their own root mean square, from where the others put it; they have to fit
/// among themselves. Of four points only the one with the largest residual can be told, where that is three times those of the others;
/// of three none.
#[must_use]
pub fn stray_point(pairs_mm: &[[Point3<f64>; 2]], placed: &Placement, sigma_mm: Option<f64>) -> Option<StrayPoint> {
    let residuals_mm = &placed.residuals_mm;
    if pairs_mm.len() < 4 || residuals_mm.len() != pairs_mm.len() {
        return None;
    }
    let mut worst = descending(residuals_mm);
    worst.truncate(if pairs_mm.len() == 4 { 1 } else { LEFT_OUT });
    let near_mm = sigma_mm.map_or(NEAR_MM, |sigma_mm| NEAR_SIGMAS * sigma_mm);
    let mut found: Option<(f64, StrayPoint)> = None;
    for index in worst {
        let others: Vec<[Point3<f64>; 2]> =
            pairs_mm.iter().enumerate().filter(|(other, _)| *other != index).map(|(_, pair)| *pair).collect();
        let Ok(fit) = from_points(&others, None) else { continue };
        let [from, to] = &pairs_mm[index];
        let off_mm = (fit.pose * from - to).norm();
        // Three points leave too little over: four are judged by the residuals of all.
        let (own_mm, of_others_mm) = if pairs_mm.len() == 4 {
            let squares: f64 = residuals_mm.iter().map(|each| each * each).sum::<f64>() - residuals_mm[index].powi(2);
            (residuals_mm[index], (squares.max(0.0) / 3.0).sqrt())
        } else {
            (off_mm, fit.rms_mm)
        };
        let stands_out = own_mm > TIMES * of_others_mm && off_mm > near_mm && fit.rms_mm <= rms_max_mm(others.len(), sigma_mm);
        let ratio = own_mm / of_others_mm.max(1e-9);
        if stands_out && found.is_none_or(|(largest, _)| ratio > largest) {
            found = Some((ratio, StrayPoint { index, off_mm }));
        }
    }
    found.map(|(_, stray)| stray)
}

/// Refuses points on a line.
fn check_shape(pairs_mm: &[[Point3<f64>; 2]], centres: &[Vector3<f64>; 2]) -> Result<(), PlacementError> {
    for side in [0, 1] {
        let scatter: Matrix3<f64> =
            pairs_mm.iter().map(|pair| pair[side].coords - centres[side]).map(|off| off * off.transpose()).sum();
        let mut extents: Vec<f64> = scatter.symmetric_eigenvalues().iter().map(|value| value.max(0.0).sqrt()).collect();
        extents.sort_by(f64::total_cmp);
        if extents[1] <= COLLINEAR * extents[2].max(1e-9) {
            return Err(PlacementError::Collinear { needed_mm: 10.0 * COLLINEAR * extents[2] });
        }
    }
    Ok(())
}

/// Refuses points of which one set is mirrored: told where they do not lie in a plane.
fn check_handedness(
    pairs_mm: &[[Point3<f64>; 2]],
    centres: &[Vector3<f64>; 2],
    rms_mm: f64,
    scatter: f64,
) -> Result<(), PlacementError> {
    let mirror = |pair: &[Point3<f64>; 2]| -(pair[0].coords - centres[0]);
    let moments: Matrix3<f64> = pairs_mm.iter().map(|pair| (pair[1].coords - centres[1]) * mirror(pair).transpose()).sum();
    let Some(rotation) = nearest_rotation(&moments) else { return Ok(()) };
    let squares = pairs_mm.iter().map(|pair| (rotation * mirror(pair) - (pair[1].coords - centres[1])).norm_squared());
    let mirrored_mm = (squares.sum::<f64>() / pairs_mm.len() as f64).sqrt();
    let is_mirrored = mirrored_mm * CLEARLY < rms_mm && rms_mm > 1e-3 * (scatter / pairs_mm.len() as f64).sqrt();
    if is_mirrored { Err(PlacementError::Mirrored { as_given_mm: rms_mm, mirrored_mm }) } else { Ok(()) }
}

/// Covariance of a pose fitted to points whose coordinates have this standard deviation, as a body increment.
#[must_use]
pub fn covariance(pairs_mm: &[[Point3<f64>; 2]], sigma_mm: f64) -> Option<Matrix6<f64>> {
    let mut normal = Matrix6::zeros();
    for [from, _] in pairs_mm {
        let mut rows = SMatrix::<f64, 3, 6>::zeros();
        rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&-from.coords.cross_matrix());
        rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        normal += rows.transpose() * rows;
    }
    Some(normal.cholesky()?.inverse() * sigma_mm.powi(2))
}

/// table_from_part from a cloud that was registered to the part: the chain, read to the part.
#[must_use]
pub fn from_cloud(
    base_from_plate: &Isometry3<f64>,
    base_from_cloud: &Isometry3<f64>,
    cloud_from_part: &Isometry3<f64>,
) -> Isometry3<f64> {
    base_from_plate.inverse() * base_from_cloud * cloud_from_part
}

/// Place of a fixture that parts are put on.
#[derive(Clone, Debug, PartialEq)]
pub struct Seat {
    /// Name.
    pub name: String,
    /// Pose on the table at angle zero.
    pub table_from_seat: Isometry3<f64>,
}

/// table_from_part of a part that lies in a seat by its own datum.
///
/// # Errors
/// [`PlacementError::UnknownSeat`].
pub fn from_seat(seats: &[Seat], name: &str, part_from_seat: &Isometry3<f64>) -> Result<Isometry3<f64>, PlacementError> {
    let seat = seats.iter().find(|seat| seat.name == name).ok_or(PlacementError::UnknownSeat)?;
    Ok(seat.table_from_seat * part_from_seat.inverse())
}

/// Covariance of table_from_part from that of the part in the cloud and that of the scanner's pose, all body increments: the part's own
/// stays, the scanner's is carried to the part.
#[must_use]
pub fn from_cloud_covariance(
    cloud_from_part: &Isometry3<f64>,
    of_part: &Matrix6<f64>,
    of_scanner: Option<&Matrix6<f64>>,
) -> Matrix6<f64> {
    let carried = adjoint(&cloud_from_part.inverse());
    of_part + of_scanner.map_or_else(Matrix6::zeros, |scanner| carried * scanner * carried.transpose())
}

#[cfg(test)]
mod tests;
