//! Turntable beyond its axis: how far the plate runs out with the angle, and where its face lies. Runout is the displacement of the
//! board from a turn about a fixed axis, as harmonics of the angle (ISO 230-7:2015, 3.2: radial and axial error motion); its first
//! harmonic is wobble.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, Vector3};

use super::data::{ChainEstimate, Sighting};

/// Harmonics that are told.
const ORDERS: usize = 2;
/// Fewest observations: three for each number that is fitted.
const MIN_OBSERVATIONS: usize = 3 * (1 + 2 * ORDERS);

/// Amplitude of one harmonic of the runout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Harmonic {
    /// Periods a turn.
    pub order: usize,
    /// Amplitude across the axis: root of the sum of x and y, mm.
    pub radial_mm: f64,
    /// Amplitude along the axis, mm.
    pub axial_mm: f64,
    /// Standard deviation of an amplitude by what the harmonics leave over, mm.
    pub sd_mm: f64,
}

/// Harmonics of what is left of the board's place over the angle. Empty for fewer than fifteen observations.
#[must_use]
pub fn runout(at: &ChainEstimate, sightings: &[Sighting]) -> Vec<Harmonic> {
    if sightings.len() < MIN_OBSERVATIONS {
        return Vec::new();
    }
    let columns = 1 + 2 * ORDERS;
    let angle = |row: usize| at.scale * sightings[row].table_rad;
    let design = DMatrix::from_fn(sightings.len(), columns, |row, column| match column {
        0 => 1.0,
        odd if odd % 2 == 1 => (odd.div_ceil(2) as f64 * angle(row)).cos(),
        even => ((even / 2) as f64 * angle(row)).sin(),
    });
    let off: Vec<Vector3<f64>> = sightings.iter().map(|each| displacement(at, each)).collect();
    let Some(cholesky) = (design.transpose() * &design).cholesky() else { return Vec::new() };
    let fits = [0, 1, 2].map(|axis| {
        let values = DVector::from_iterator(off.len(), off.iter().map(|each| each[axis]));
        let fit = cholesky.solve(&(design.transpose() * &values));
        let left = (&values - &design * &fit).norm_squared();
        (fit, left)
    });
    let freedom = 3 * (sightings.len() - columns);
    let variance = fits.iter().map(|(_, left)| left).sum::<f64>() / freedom as f64;
    let inverse = cholesky.inverse();
    let amplitude = |axis: usize, order: usize| fits[axis].0[2 * order - 1].hypot(fits[axis].0[2 * order]);
    (1..=ORDERS)
        .map(|order| Harmonic {
            order,
            radial_mm: amplitude(0, order).hypot(amplitude(1, order)),
            axial_mm: amplitude(2, order),
            sd_mm: (variance * inverse[(2 * order, 2 * order)].max(inverse[(2 * order - 1, 2 * order - 1)])).sqrt(),
        })
        .collect()
}

/// Displacement of the board that was seen from the one predicted, in the table.
fn displacement(at: &ChainEstimate, sighting: &Sighting) -> Vector3<f64> {
    let seen = at.table.inverse() * sighting.robot * at.hand_eye * sighting.seen;
    let predicted = at.table.inverse() * at.base_from_plate(sighting.table_rad) * at.board;
    seen.translation.vector - predicted.translation.vector
}

/// Upper face of the plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateFace {
    /// Height of the face at the axis above the table's origin, mm.
    pub height_mm: f64,
    /// Angle between the face's normal and the axis: face runout, rad.
    pub tilt_rad: f64,
    /// Root mean square of the points' distances from the face, mm.
    pub rms_mm: f64,
}

/// Plane through scanned points of the face, given in the table. None for fewer than three, or points on a line.
#[must_use]
pub fn plate_face(points_mm: &[Point3<f64>]) -> Option<PlateFace> {
    if points_mm.len() < 3 {
        return None;
    }
    let centre = points_mm.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points_mm.len() as f64;
    let scatter: Matrix3<f64> = points_mm.iter().map(|point| (point.coords - centre) * (point.coords - centre).transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let normal = eigen.eigenvectors.column(order[0]).into_owned();
    let normal = if normal.z < 0.0 { -normal } else { normal };
    // Flat across both directions, and not upright: a plate can be told.
    let is_plane = eigen.eigenvalues[order[1]] > 1e-6 * eigen.eigenvalues[order[2]].max(1e-12) && normal.z > 0.5;
    is_plane.then(|| PlateFace {
        height_mm: normal.dot(&centre) / normal.z,
        tilt_rad: normal.xy().norm().atan2(normal.z),
        rms_mm: (eigen.eigenvalues[order[0]].max(0.0) / points_mm.len() as f64).sqrt(),
    })
}

/// Table whose origin lies on its axis in the plate's face.
#[must_use]
pub fn lifted(base_from_table: &Isometry3<f64>, face: &PlateFace) -> Isometry3<f64> {
    base_from_table * nalgebra::Translation3::new(0.0, 0.0, face.height_mm)
}
