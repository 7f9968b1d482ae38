//! Turntable beyond its axis: how far the plate runs out with the angle, and where its face lies. Runout is the displacement of the
//! board from a turn about a fixed axis, as harmonics of the angle (ISO 230-7:2015, 3.2: radial and axial error motion); its first
//! harmonic is wobble. A part of the first harmonic that turns with the plate is a shift or tilt of whatever lies on it, and no runout.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, SMatrix, Vector3};

use super::chi_squared::quantile_of;
use super::data::{ChainEstimate, Sighting};
use super::refine::{BOARD_COLUMN, COLUMNS, Increment, Refined, TABLE_COLUMN, moved};
use super::se3::adjoint;
use crate::cell::runout::{RunoutHarmonic, RunoutSpec, error_motion};
use crate::geometry::sort_ascending;

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

/// Unknowns of the runout: a first harmonic that turns against the plate (tilt, shift across) with its axial part, and a second
/// harmonic in all five freedoms.
const FIRST: usize = 6;
const SECOND: usize = 10;
const RUNOUT: usize = FIRST + SECOND;
/// Unknowns of the chain beside the ratio, which is held, and those of the runout.
const CHAIN: usize = COLUMNS - 1;
/// Probability of a harmonic as large by chance, from which on it is one.
const SIGNIFICANT_P: f64 = 1e-3;
/// Freedoms of an error motion in a twist.
const FREEDOMS: [usize; 5] = [0, 1, 3, 4, 5];

/// Derivative of the error motion's twist, table frame, by the unknowns of the runout, at an angle.
fn motion_rows(angle_rad: f64) -> SMatrix<f64, 6, RUNOUT> {
    let mut rows = SMatrix::<f64, 6, RUNOUT>::zeros();
    let (sin, cos) = angle_rad.sin_cos();
    for (column, first) in [(0, 0), (2, 3)] {
        // (u cos φ + v sin φ, v cos φ − u sin φ): turns by −φ.
        (rows[(first, column)], rows[(first, column + 1)]) = (cos - 1.0, sin);
        (rows[(first + 1, column)], rows[(first + 1, column + 1)]) = (-sin, cos - 1.0);
    }
    (rows[(5, 4)], rows[(5, 5)]) = (cos - 1.0, sin);
    let (sin, cos) = (2.0 * angle_rad).sin_cos();
    for (freedom, row) in FREEDOMS.into_iter().enumerate() {
        (rows[(row, FIRST + 2 * freedom)], rows[(row, FIRST + 2 * freedom + 1)]) = (cos - 1.0, sin);
    }
    rows
}

/// Harmonics of these unknowns; of those that are not significant nothing is left.
fn harmonics(unknowns: &[f64], is_kept: [bool; 2]) -> Vec<RunoutHarmonic> {
    let at = |index: usize| unknowns[index];
    let first = RunoutHarmonic { order: 1, cos: [at(0), at(1), at(2), at(3), at(4)], sin: [at(1), -at(0), at(3), -at(2), at(5)] };
    let of = |phase: usize| std::array::from_fn(|freedom| at(FIRST + 2 * freedom + phase));
    let second = RunoutHarmonic { order: 2, cos: of(0), sin: of(1) };
    [first, second].into_iter().zip(is_kept).filter(|(_, kept)| *kept).map(|(harmonic, _)| harmonic).collect()
}

/// Runout beyond what noise explains, from observations that were refined without it: unknowns of chain and runout are fitted
/// together, with the weights of the refinement, and each order is tested by χ², or by F where the deviations were estimated, with
/// `sigma_freedom` degrees. Empty for fewer than fifteen observations, and where the table's angles leave it open.
#[must_use]
pub fn identify_runout(refined: &Refined, sightings: &[Sighting], sigma_freedom: Option<f64>) -> Vec<RunoutHarmonic> {
    if sightings.len() < MIN_OBSERVATIONS {
        return Vec::new();
    }
    let (mut normal, mut right) = (DMatrix::<f64>::zeros(CHAIN + RUNOUT, CHAIN + RUNOUT), DVector::<f64>::zeros(CHAIN + RUNOUT));
    for sighting in sightings {
        let Some(linear) = refined.linear(sighting) else { return Vec::new() };
        let at = &refined.estimate;
        let angle = at.scale * sighting.table_rad;
        let plate_from_board = Isometry3::rotation(Vector3::z() * angle) * at.plate_from_board;
        let of_motion: SMatrix<f64, 6, RUNOUT> = adjoint(&plate_from_board.inverse()) * motion_rows(angle);
        let mut rows = DMatrix::<f64>::zeros(6, CHAIN + RUNOUT);
        rows.columns_mut(0, CHAIN).copy_from(&linear.rows.columns(0, CHAIN));
        rows.columns_mut(CHAIN, RUNOUT).copy_from(&of_motion);
        let weighted = linear.weight * &rows;
        normal += rows.transpose() * &weighted;
        right -= weighted.transpose() * linear.residual;
    }
    for column in (0..CHAIN).filter(|column| refined.covariance[(*column, *column)] <= 0.0) {
        normal.row_mut(column).fill(0.0);
        normal.column_mut(column).fill(0.0);
        (normal[(column, column)], right[column]) = (1.0, 0.0);
    }
    let scale = DVector::from_fn(CHAIN + RUNOUT, |row, _| normal[(row, row)].max(f64::MIN_POSITIVE).sqrt().recip());
    let unit = DMatrix::from_fn(CHAIN + RUNOUT, CHAIN + RUNOUT, |row, column| normal[(row, column)] * scale[row] * scale[column]);
    let Some(cholesky) = unit.cholesky() else { return Vec::new() };
    let inverse = cholesky.inverse();
    let found = (&inverse * right.component_mul(&scale)).component_mul(&scale);
    let is_significant = |first: usize, count: usize| {
        let at = CHAIN + first;
        let covariance =
            DMatrix::from_fn(count, count, |row, column| inverse[(at + row, at + column)] * scale[at + row] * scale[at + column]);
        let own = found.rows(at, count).into_owned();
        let square = covariance.cholesky().map_or(0.0, |cholesky| own.dot(&cholesky.solve(&own)));
        square / refined.variance_factor().max(1.0) > quantile_of(SIGNIFICANT_P, count, sigma_freedom)
    };
    let is_kept = [is_significant(0, FIRST), is_significant(FIRST, SECOND)];
    harmonics(found.rows(CHAIN, RUNOUT).as_slice(), is_kept)
}

/// Sum of two runouts, order by order: their error motions are small.
#[must_use]
pub fn merged(one: &[RunoutHarmonic], other: &[RunoutHarmonic]) -> Vec<RunoutHarmonic> {
    let mut all = one.to_vec();
    for harmonic in other {
        match all.iter_mut().find(|known| known.order == harmonic.order) {
            None => all.push(*harmonic),
            Some(known) => {
                known.cos.iter_mut().zip(&harmonic.cos).for_each(|(sum, part)| *sum += part);
                known.sin.iter_mut().zip(&harmonic.sin).for_each(|(sum, part)| *sum += part);
            }
        }
    }
    all
}

/// Harmonics of a runout as specifications and calibrations write them.
#[must_use]
pub fn harmonics_of(specs: &[RunoutSpec]) -> Vec<RunoutHarmonic> {
    specs.iter().map(RunoutSpec::build).collect()
}

/// Observation as it would be without runout: B E Rz P = R X C is B Rz P = (B E⁻¹ B⁻¹ R) X C.
#[must_use]
pub fn without_runout(base_from_table: &Isometry3<f64>, runout: &[RunoutHarmonic], sense: f64, sighting: &Sighting) -> Sighting {
    let error = error_motion(runout, sense * sighting.table_rad);
    let base_from_flange = base_from_table * error.inverse() * base_from_table.inverse() * sighting.base_from_flange;
    Sighting { base_from_flange, ..sighting.clone() }
}

/// Displacement of the board that was seen from the one predicted, in the table.
fn displacement(at: &ChainEstimate, sighting: &Sighting) -> Vector3<f64> {
    let seen = at.base_from_table.inverse() * sighting.base_from_flange * at.flange_from_cloud * sighting.cloud_from_board;
    let predicted = at.base_from_table.inverse() * at.base_from_plate(sighting.table_rad) * at.plate_from_board;
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
    sort_ascending(&mut order, |axis| eigen.eigenvalues[*axis]);
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

/// Point of the plate's face as it was scanned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FacePoint {
    /// The flange when it was scanned.
    pub base_from_flange: Isometry3<f64>,
    /// Angle of the table.
    pub table_rad: f64,
    /// Point in the cloud, mm.
    pub cloud_mm: Point3<f64>,
}

/// Face of the plate with the standard deviation of its height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocatedFace {
    /// The face.
    pub face: PlateFace,
    /// Standard deviation of its height: by the unknowns of the chain and by the scatter of the points, mm.
    pub height_sd_mm: f64,
}

/// Face of the plate through scanned points, by the refined chain. None for points that tell no plane.
#[must_use]
pub fn locate_face(refined: &Refined, points: &[FacePoint]) -> Option<LocatedFace> {
    let at = &refined.estimate;
    let height = |at: &ChainEstimate| {
        let on_plate = |point: &FacePoint| {
            at.base_from_plate(point.table_rad).inverse() * point.base_from_flange * at.flange_from_cloud * point.cloud_mm
        };
        plate_face(&points.iter().map(on_plate).collect::<Vec<_>>())
    };
    let face = height(at)?;
    let mut slope = Increment::zeros();
    for column in 0..BOARD_COLUMN {
        let step = if [0, 1, 2, TABLE_COLUMN, TABLE_COLUMN + 1].contains(&column) { 1e-5 } else { 1e-2 };
        let mut by = Increment::zeros();
        by[column] = step;
        slope[column] = (height(&moved(at, &by))?.height_mm - height(&moved(at, &-by))?.height_mm) / (2.0 * step);
    }
    let of_chain = slope.dot(&(refined.covariance * slope)).max(0.0);
    let of_points = face.rms_mm.powi(2) / points.len() as f64;
    Some(LocatedFace { face, height_sd_mm: (of_chain + of_points).sqrt() })
}

/// Refined unknowns with the table's origin moved along its axis to the height of the face: nothing that was observed changes by it.
#[must_use]
pub fn lifted(refined: &Refined, height_mm: f64) -> Refined {
    let up = nalgebra::Translation3::new(0.0, 0.0, height_mm);
    let at = &refined.estimate;
    let estimate =
        ChainEstimate { base_from_table: at.base_from_table * up, plate_from_board: up.inverse() * at.plate_from_board, ..*at };
    // B exp(ξ) T = B T exp(Ad(T⁻¹) ξ): a tilt about the old origin shifts the new one.
    let mut change = super::refine::Square::identity();
    change[(TABLE_COLUMN + 2, TABLE_COLUMN + 1)] = height_mm;
    change[(TABLE_COLUMN + 3, TABLE_COLUMN)] = -height_mm;
    Refined { estimate, covariance: change * refined.covariance * change.transpose(), ..refined.clone() }
}

#[cfg(test)]
mod tests;
