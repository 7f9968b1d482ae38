//! Alignments of the measured surface to the model: a motion of the part that makes the squares of the samples' distances, weighted by
//! area, least. Small motions change a distance by (p × n, n)·δ; the comparison is made again at the new pose, thrice.

use nalgebra::{Isometry3, Matrix6, Vector6};

use super::{Alignment, Deviation, DeviationOptions, Nominal, PlacedScan, compare, lever};
use crate::cell::calibration::se3::exp;
use crate::geometry::{Part, Pose};
use crate::planning::ids::SampleId;

/// Rounds of fit and comparison.
const ROUNDS: usize = 3;
/// Share of the largest eigenvalue below which a freedom is taken for one that the samples do not fix: distances then change by less than
/// a hundredth of the motion.
const MIN_CONDITION: f64 = 1e-4;

/// Comparison at an alignment.
#[derive(Clone, Debug, PartialEq)]
pub struct Aligned {
    /// Alignment asked for.
    pub alignment: Alignment,
    /// Takes the part's coordinates by the poses that were given to those of the model.
    pub mesh_from_placed: Pose<Part, Part>,
    /// Freedoms that the samples fix: 6, or fewer on regions that slide along themselves. The others stay as they were.
    pub fixed_freedoms: usize,
    /// Comparison at this alignment.
    pub deviation: Deviation,
}

/// Compares scans as they are placed.
#[must_use]
pub fn as_placed(scans: &[PlacedScan<'_>], nominal: &Nominal<'_>, options: &DeviationOptions) -> Aligned {
    let deviation = compare(scans, nominal, options);
    Aligned { alignment: Alignment::AsPlaced, mesh_from_placed: Pose::identity(), fixed_freedoms: 6, deviation }
}

/// Fits the samples of a region, or all, to the model.
#[must_use]
pub fn best_fit(
    scans: &[PlacedScan<'_>],
    nominal: &Nominal<'_>,
    region: Option<&[SampleId]>,
    options: &DeviationOptions,
) -> Aligned {
    let alignment = if region.is_some() { Alignment::BestFitOn } else { Alignment::BestFit };
    let all: Vec<SampleId>;
    let fitted = match region {
        Some(region) => region,
        None => {
            all = nominal.surface.samples().collect();
            &all
        }
    };
    let mut pose = Isometry3::identity();
    let mut deviation = compare(scans, nominal, options);
    let mut fixed_freedoms = 0;
    for _ in 0..ROUNDS {
        let (step, fixed) = fit(&deviation, nominal, fitted);
        fixed_freedoms = fixed;
        pose = exp(&step) * pose;
        let moved: Vec<PlacedScan<'_>> = scans.iter().map(|placed| placed.moved(&Pose::claim(pose))).collect();
        deviation = compare(&moved, nominal, options);
        if step.norm() < 1e-7 {
            break;
        }
    }
    Aligned { alignment, mesh_from_placed: Pose::claim(pose), fixed_freedoms, deviation }
}

/// Least-squares step, and the number of freedoms that it fixes. Rotations are about the middle of the part, measured in steps that move
/// points as far as shifts do.
fn fit(deviation: &Deviation, nominal: &Nominal<'_>, samples: &[SampleId]) -> (Vector6<f64>, usize) {
    let around = nominal.mesh.aabb();
    let (centre, arm) = (around.centre(), 0.5 * around.extent_mm().norm().max(f64::MIN_POSITIVE));
    let (mut matrix, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    for sample in samples.iter().filter(|sample| deviation.samples[sample.index()].points > 0) {
        let at = nominal.surface.sample_mm[sample.index()] - centre.coords;
        let mut row = lever(&at, &nominal.surface.patch_of(*sample).normal);
        row.fixed_rows_mut::<3>(0).scale_mut(1.0 / arm);
        let area = nominal.surface.sample_area_mm2(*sample);
        matrix += row * row.transpose() * area;
        gradient += row * (area * f64::from(deviation.samples[sample.index()].distance_mm));
    }
    let eigen = matrix.symmetric_eigen();
    let limit = MIN_CONDITION * eigen.eigenvalues.max();
    let fixed = eigen.eigenvalues.iter().filter(|value| **value > limit).count();
    let inverse = eigen.eigenvalues.map(|value| if value > limit { 1.0 / value } else { 0.0 });
    let mut step = -(eigen.eigenvectors * Matrix6::from_diagonal(&inverse) * eigen.eigenvectors.transpose() * gradient);
    step.fixed_rows_mut::<3>(0).scale_mut(1.0 / arm);
    // A turn about the middle, written as one about the origin.
    let turn = step.fixed_rows::<3>(0).into_owned();
    let shift = step.fixed_rows::<3>(3) - turn.cross(&centre.coords);
    step.fixed_rows_mut::<3>(3).copy_from(&shift);
    (step, fixed)
}
