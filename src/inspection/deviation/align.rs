//! Alignments of the measured surface to the model: a motion of the part that makes the squares of the samples' distances, weighted by
//! area, least. Small motions change a distance by j·δ, j = (p × n, n); the comparison is made again at the new pose, thrice.
//!
//! After its first round a fit to the whole surface leaves out samples beyond three times the root mean square of the distances from the fit
//! to those that it keeps (sigma clipping with a new fit after each cut: at most a ninth of the area at a time, by Chebyshev's inequality; of
//! normal noise, 0.3 %).
//! A lump of 100 mm² and 3 mm turned a box of 80 × 60 mm by a tenth of a degree otherwise, and material was missing beside it. The first
//! round takes all: a part that is off along its largest faces would lose the few samples that tell it.
//!
//! The motion is as uncertain as the samples that it is from, at u = U/2 each and independent of each other: with N = Σ a j jᵀ its
//! covariance is C = N⁺ (Σ (a u)² j jᵀ) N⁺, and the U² of each sample grows by 4 jᵀ C j. Far from a small region that counts. What samples
//! have in common, by poses that are open, is added apart (`aligned_poses.rs`).

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Point3, Vector6};

use super::aligned_poses::AlignedPoses;
use super::statistics::{MIN_TO_FAIL, by_noise, judge};
use super::{
    Alignment, Conformity, Deviation, DeviationOptions, Nominal, PlacedScan, RegionDeviation, RegionToJudge, SampleDeviation,
    UndecidedBecause, compare, lever, variance,
};
use crate::cell::calibration::se3::exp;
use crate::geometry::{Part, Pose, parallel, sort_ascending, sort_descending};
use crate::inspection::OpenPoses;
use crate::inspection::registration::locate::STATED_REACH_MM;
use crate::planning::ids::SampleId;

/// Rounds of fit and comparison.
const ROUNDS: usize = 3;
/// Distance from the model beyond which a sample does not count in a fit to the whole surface, in root mean squares.
const MAX_OF_RMS: f64 = 3.0;
/// Rounds in which samples that do not count are looked for. Not from a source: fits settle in 3 to 10.
const MAX_CLIPS: usize = 30;
/// Share of the largest eigenvalue below which a freedom is taken for one that the samples do not fix: distances then change by less than
/// a hundredth of the motion.
const MIN_CONDITION: f64 = 1e-4;

/// Distance along a surface's normal to which the registration has to hold the part so that a region there may fail, mm, or its tolerance
/// where that is larger.
pub const HELD_TO_MM: f64 = STATED_REACH_MM;

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
    /// Poses that were aligned; none where they are taken as they are placed.
    poses: Option<AlignedPoses>,
}

impl Aligned {
    /// Judges a region: as its samples are, and as those of the same views are against each other, whatever is open of their poses.
    #[must_use]
    pub fn judge(&self, nominal: &Nominal<'_>, region: &RegionToJudge, options: &DeviationOptions) -> RegionDeviation {
        let mut judged = judge(&self.deviation.samples, nominal.surface, region, options);
        let is_open = judged.verdict == Some(Conformity::Undecided);
        if is_open && region.tolerance_mm.is_some_and(|tolerance_mm| self.is_uneven(nominal, region, tolerance_mm)) {
            (judged.verdict, judged.is_open_by_poses, judged.undecided_because) = (Some(Conformity::Fail), false, None);
        }
        judged
    }

    /// Judges a region, and takes back a `fail` where the registration holds the part by this covariance alone, and a motion within it moves
    /// the region by more than its tolerance and than registration bridges: what lies there may be another surface. A `fail` is taken back
    /// too where the samples do not fail by the scans alone that could be registered, `None` if all could: the poses of the others may be
    /// off by far more than their priors say. Poses that are taken as they are stated do not depend on either.
    ///
    /// The covariance is from points within the last gate of the registration alone. A feature that is off all round by more has none there,
    /// and holds nothing: where no other surface faces its way, it is undecided, however far off it is.
    #[must_use]
    pub fn judge_held(
        &self,
        nominal: &Nominal<'_>,
        region: &RegionToJudge,
        options: &DeviationOptions,
        (part_covariance, registered): (&Matrix6<f64>, Option<&[SampleDeviation]>),
    ) -> RegionDeviation {
        let judged = self.judge(nominal, region, options);
        let is_held = |tolerance_mm: f64| {
            let open_sd_mm = self.moved_sd_mm(nominal, &region.samples, part_covariance);
            open_sd_mm.is_none_or(|sd_mm| sd_mm <= tolerance_mm.max(HELD_TO_MM))
        };
        if judged.verdict != Some(Conformity::Fail) || self.alignment == Alignment::AsPlaced {
            return judged;
        }
        let because = if !region.tolerance_mm.is_none_or(is_held) {
            UndecidedBecause::NotHeld
        } else if registered
            .is_some_and(|samples| judge(samples, nominal.surface, region, options).verdict != Some(Conformity::Fail))
        {
            UndecidedBecause::NotRegistered
        } else {
            return judged;
        };
        RegionDeviation { verdict: Some(Conformity::Undecided), undecided_because: Some(because), ..judged }
    }

    /// Median standard deviation by which motions of the part of this covariance move the measured ones of some samples along their
    /// normals, mm.
    fn moved_sd_mm(&self, nominal: &Nominal<'_>, samples: &[SampleId], part_covariance: &Matrix6<f64>) -> Option<f64> {
        let measured = samples.iter().filter(|sample| self.deviation.samples[sample.index()].points > 0);
        let sd_mm = |sample: &SampleId| {
            let row = lever(&nominal.surface.sample_mm[sample.index()], &nominal.surface.patch_of(*sample).normal);
            variance((row.transpose() * part_covariance * row)[0]).sqrt()
        };
        let mut moved_mm: Vec<f64> = measured.map(sd_mm).collect();
        moved_mm.sort_by(f64::total_cmp);
        moved_mm.get(moved_mm.len() / 2).copied()
    }

    /// Returns true if some samples of the same views lie above others of them by more than the tolerance and what their points and the
    /// poses leave open of the difference: more on either side than noise lets seem so. A few samples show it no more than they fail.
    fn is_uneven(&self, nominal: &Nominal<'_>, region: &RegionToJudge, tolerance_mm: f64) -> bool {
        let (deviation, Some(poses)) = (&self.deviation, &self.poses) else { return false };
        let mut of_views: BTreeMap<&[u16], Vec<SampleId>> = BTreeMap::new();
        for sample in region.samples.iter().filter(|sample| deviation.samples[sample.index()].points > 0) {
            of_views.entry(deviation.views_of(*sample)).or_default().push(*sample);
        }
        let measured: usize = of_views.values().map(Vec::len).sum();
        if measured < MIN_TO_FAIL {
            return false;
        }
        let by_noise = by_noise(measured);
        // A distance less or more by what its points leave open.
        let bound = |sample: SampleId, sign: f64| {
            let own = &deviation.samples[sample.index()];
            f64::from(own.distance_mm) + sign * f64::from(own.of_points_mm)
        };
        of_views.into_values().filter(|samples| samples.len() > 2 * by_noise + 1).any(|mut samples| {
            sort_ascending(&mut samples, |sample| bound(*sample, 1.0));
            let low = samples[by_noise];
            sort_descending(&mut samples, |sample| bound(*sample, -1.0));
            let high = samples[by_noise];
            let beyond_mm = bound(high, -1.0) - bound(low, 1.0) - tolerance_mm;
            beyond_mm > 0.0 && beyond_mm > 2.0 * poses.difference_mm2(deviation, nominal, [high, low]).sqrt()
        })
    }
}

/// Compares scans as they are placed.
#[must_use]
pub fn as_placed(scans: &[PlacedScan<'_>], nominal: &Nominal<'_>, options: &DeviationOptions) -> Aligned {
    let deviation = compare(scans, nominal, options);
    let (alignment, mesh_from_placed) = (Alignment::AsPlaced, Pose::identity());
    Aligned { alignment, mesh_from_placed, fixed_freedoms: 6, deviation, poses: None }
}

/// Fits the samples of a region, or all, to the model. `open` is what the registration leaves open of the poses of these scans.
#[must_use]
pub fn best_fit(
    scans: &[PlacedScan<'_>],
    nominal: &Nominal<'_>,
    region: Option<&[SampleId]>,
    open: Option<&Arc<OpenPoses>>,
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
    let (mut pose, mut moved) = (Isometry3::identity(), scans.to_vec());
    let mut deviation = compare(scans, nominal, options);
    let mut fixed_freedoms = 0;
    let kept = |deviation: &Deviation| match region {
        Some(region) => region.to_vec(),
        None => without_outliers(deviation, nominal, fitted),
    };
    for round in 0..ROUNDS {
        let taken = if round == 0 { fitted.to_vec() } else { kept(&deviation) };
        let (step, fixed) = Fit::of(&deviation, nominal, &taken).step();
        fixed_freedoms = fixed;
        pose = exp(&step) * pose;
        moved = scans.iter().map(|placed| placed.moved(&Pose::claim(pose))).collect();
        deviation = compare(&moved, nominal, options);
        if step.norm() < 1e-7 {
            break;
        }
    }
    let fitted = kept(&deviation);
    let fit = Fit::of(&deviation, nominal, &fitted);
    let compared = (&deviation, nominal, &fitted[..]);
    let poses = open.and_then(|open| AlignedPoses::of(open, &moved, compared, (fit.frame, &fit.inverse())));
    fit.widen(&mut deviation, nominal, poses.as_ref());
    Aligned { alignment, mesh_from_placed: Pose::claim(pose), fixed_freedoms, deviation, poses }
}

/// Samples whose distances from the fit to all of them are at most [`MAX_OF_RMS`] times the root mean square of theirs, weighted by area.
/// Each round fits those of the one before and judges every sample by that fit, until they stay the same: cut by the distances of one
/// fit alone, the faces that an outlier has shifted go before the outlier does. A round that would fix fewer freedoms is not taken.
fn without_outliers(deviation: &Deviation, nominal: &Nominal<'_>, samples: &[SampleId]) -> Vec<SampleId> {
    let is_measured = |sample: &SampleId| deviation.samples[sample.index()].points > 0;
    let measured: Vec<SampleId> = samples.iter().copied().filter(is_measured).collect();
    let mut fit = Fit::of(deviation, nominal, &measured);
    let fixed = fit.inverse().fixed;
    let mut kept = measured.clone();
    for _ in 0..MAX_CLIPS {
        let motion = fit.motion();
        let distance_mm = |sample: &SampleId| {
            f64::from(deviation.samples[sample.index()].distance_mm) + fit.frame.row(nominal, *sample).dot(&motion)
        };
        let (mut area_mm2, mut moment) = (0.0, 0.0);
        for sample in &kept {
            let own_mm2 = nominal.surface.sample_area_mm2(*sample);
            area_mm2 += own_mm2;
            moment += own_mm2 * distance_mm(sample).powi(2);
        }
        let max_mm = MAX_OF_RMS * (moment / area_mm2).sqrt();
        let within: Vec<SampleId> = measured.iter().copied().filter(|sample| distance_mm(sample).abs() <= max_mm).collect();
        let next = Fit::of(deviation, nominal, &within);
        if within == kept || next.inverse().fixed < fixed {
            break;
        }
        (kept, fit) = (within, next);
    }
    kept
}

/// Frame of a motion of the part: rotations are about the middle of the part, measured in steps that move points as far as shifts do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FitFrame {
    centre: Point3<f64>,
    arm: f64,
}

impl FitFrame {
    /// Derivative of a sample's distance by the motion.
    pub(super) fn row(&self, nominal: &Nominal<'_>, sample: SampleId) -> Vector6<f64> {
        let at = nominal.surface.sample_mm[sample.index()] - self.centre.coords;
        let mut row = lever(&at, &nominal.surface.patch_of(sample).normal);
        row.fixed_rows_mut::<3>(0).scale_mut(1.0 / self.arm);
        row
    }

    /// Covariance of a motion whose twist about the origin has this one.
    pub(super) fn covariance_of(&self, about_origin: &Matrix6<f64>) -> Matrix6<f64> {
        // A turn about the origin shifts the middle by ω × centre.
        let mut map = Matrix6::identity();
        map.fixed_view_mut::<3, 3>(0, 0).scale_mut(self.arm);
        map.fixed_view_mut::<3, 3>(3, 0).copy_from(&-self.centre.coords.cross_matrix());
        map * about_origin * map.transpose()
    }
}

/// Inverse of normal equations on the freedoms that the samples fix.
pub(super) struct FitInverse {
    pub(super) matrix: Matrix6<f64>,
    /// Projection on the other freedoms.
    pub(super) free: Matrix6<f64>,
    fixed: usize,
}

/// Normal equations of a motion of the part.
struct Fit {
    frame: FitFrame,
    matrix: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Covariance of the gradient.
    spread: Matrix6<f64>,
}

impl Fit {
    fn of(deviation: &Deviation, nominal: &Nominal<'_>, samples: &[SampleId]) -> Self {
        let around = nominal.mesh.aabb();
        let (centre, arm) = (around.centre(), 0.5 * around.extent_mm().norm().max(f64::MIN_POSITIVE));
        let (matrix, gradient, spread) = (Matrix6::zeros(), Vector6::zeros(), Matrix6::zeros());
        let mut fit = Self { frame: FitFrame { centre, arm }, matrix, gradient, spread };
        for sample in samples.iter().filter(|sample| deviation.samples[sample.index()].points > 0) {
            let (row, own) = (fit.frame.row(nominal, *sample), &deviation.samples[sample.index()]);
            let area = nominal.surface.sample_area_mm2(*sample);
            let square = row * row.transpose();
            fit.matrix += square * area;
            fit.gradient += row * (area * f64::from(own.distance_mm));
            fit.spread += square * (0.5 * area * f64::from(own.expanded_mm)).powi(2);
        }
        fit
    }

    fn inverse(&self) -> FitInverse {
        let eigen = self.matrix.symmetric_eigen();
        let limit = MIN_CONDITION * eigen.eigenvalues.max();
        let fixed = eigen.eigenvalues.iter().filter(|value| **value > limit).count();
        let of = |value: fn(f64) -> f64, other: f64| {
            let values = eigen.eigenvalues.map(|one| if one > limit { value(one) } else { other });
            eigen.eigenvectors * Matrix6::from_diagonal(&values) * eigen.eigenvectors.transpose()
        };
        FitInverse { matrix: of(f64::recip, 0.0), free: of(|_| 0.0, 1.0), fixed }
    }

    /// Least-squares motion, in the frame of the fit.
    fn motion(&self) -> Vector6<f64> {
        -(self.inverse().matrix * self.gradient)
    }

    /// Least-squares step, and the number of freedoms that it fixes.
    fn step(&self) -> (Vector6<f64>, usize) {
        let inverse = self.inverse();
        let mut step = self.motion();
        step.fixed_rows_mut::<3>(0).scale_mut(1.0 / self.frame.arm);
        // A turn about the middle, written as one about the origin.
        let turn = step.fixed_rows::<3>(0).into_owned();
        let shift = step.fixed_rows::<3>(3) - turn.cross(&self.frame.centre.coords);
        step.fixed_rows_mut::<3>(3).copy_from(&shift);
        (step, inverse.fixed)
    }

    /// Adds the uncertainty of the motion, and what is open of the poses, to that of every sample.
    fn widen(&self, deviation: &mut Deviation, nominal: &Nominal<'_>, poses: Option<&AlignedPoses>) {
        let inverse = self.inverse().matrix;
        let covariance = inverse * self.spread * inverse;
        let found: &Deviation = deviation;
        let widened = |sample: usize| {
            let (id, own) = (SampleId::at(sample), &found.samples[sample]);
            if own.points == 0 {
                return own.expanded_mm;
            }
            let row = self.frame.row(nominal, id);
            let of_motion_mm2 = variance((row.transpose() * covariance * row)[0]);
            let of_poses_mm2 = poses.map_or(0.0, |poses| poses.variance_mm2(found, nominal, id));
            (f64::from(own.expanded_mm).powi(2) + 4.0 * (of_motion_mm2 + of_poses_mm2)).sqrt() as f32
        };
        let widened: Vec<f32> = parallel::map_range(found.samples.len(), widened);
        for (own, expanded_mm) in deviation.samples.iter_mut().zip(widened) {
            own.expanded_mm = expanded_mm;
        }
    }
}
