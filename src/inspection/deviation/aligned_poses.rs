//! Uncertainty of distances by what poses leave open, against an alignment.
//!
//! With errors e of the poses of all views, six rows a view, a sample's distance is off by cᵀe before the alignment: c has the row
//! (n_v/n) j_v of each view that measured it. The alignment answers by the motion F e, F = −N⁺ Σ a r cᵀ over the samples that it fits,
//! r a sample's row by the motion and N = Σ a r rᵀ. What is left at a sample is tᵀe, t = c + Fᵀr: nothing of errors that all of these
//! views have alike, and all of what no other wall shares. With C and p of [`OpenPoses`] its variance is tᵀ C t + (tᵀp)²: that which is
//! open of the poses, and the pull of the mesh, which may have been wrong. Freedoms that the alignment does not fix are those of the
//! registration: they have the covariance of the part's place. The motion is as uncertain as the samples that it is from, too.

use std::sync::Arc;

use nalgebra::{DMatrix, Matrix6, Vector6};

use super::align::{FitFrame, FitInverse};
use super::{Deviation, Nominal, PlacedScan, lever, variance};
use crate::cell::calibration::se3::Twist;
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::inspection::OpenPoses;
use crate::planning::ids::SampleId;

/// Freedoms of a pose.
const FREEDOMS: usize = 6;

/// Poses of an alignment.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AlignedPoses {
    open: Arc<OpenPoses>,
    scanners_from_part: Vec<Pose<ScannerFrame, Part>>,
    frame: FitFrame,
    /// C Fᵀ.
    with_fit: DMatrix<f64>,
    /// F C Fᵀ, with the covariance of the freedoms that are not fitted.
    of_fit: Matrix6<f64>,
    /// F p.
    pulled_fit: Vector6<f64>,
}

/// Change of a distance, or of a difference of such, by errors of the poses: c by its rows, each with its view, and r.
struct PoseLever {
    views: Vec<(usize, Twist)>,
    part: Vector6<f64>,
}

impl AlignedPoses {
    /// Poses of scans as they are aligned, by a fit of these samples with their areas.
    pub(super) fn of(
        open: &Arc<OpenPoses>,
        aligned: &[PlacedScan<'_>],
        (deviation, nominal, fitted): (&Deviation, &Nominal<'_>, &[SampleId]),
        (frame, inverse): (FitFrame, &FitInverse),
    ) -> Option<Self> {
        // Poses of other scans say nothing of these.
        if open.pulled.len() != FREEDOMS * aligned.len() {
            return None;
        }
        let none = (DMatrix::zeros(open.pulled.len(), FREEDOMS), Matrix6::zeros(), Vector6::zeros());
        let scanners_from_part = aligned.iter().map(|placed| placed.part_from_scanner.inverse()).collect();
        let (with_fit, of_fit, pulled_fit) = none;
        let mut poses = Self { open: Arc::clone(open), scanners_from_part, frame, with_fit, of_fit, pulled_fit };
        // Fᵀ, six rows a view.
        let mut follows = DMatrix::zeros(open.pulled.len(), FREEDOMS);
        for sample in fitted.iter().filter(|sample| deviation.samples[sample.index()].points > 0) {
            let own = poses.lever(deviation, nominal, *sample);
            let answer = inverse.matrix * own.part * -nominal.surface.sample_area_mm2(*sample);
            for (view, row) in &own.views {
                let mut place = follows.fixed_view_mut::<FREEDOMS, FREEDOMS>(FREEDOMS * view, 0);
                place += row * answer.transpose();
            }
        }
        poses.with_fit = &open.covariance * &follows;
        let of_fit = follows.tr_mul(&poses.with_fit);
        let pulled_fit = follows.tr_mul(&open.pulled);
        let of_part = inverse.free * frame.covariance_of(&open.part) * inverse.free;
        poses.of_fit = Matrix6::from_fn(|row, column| of_fit[(row, column)]) + of_part;
        poses.pulled_fit = Vector6::from_fn(|row, _| pulled_fit[row]);
        Some(poses)
    }

    /// Variance of a sample's distance.
    pub(super) fn variance_mm2(&self, deviation: &Deviation, nominal: &Nominal<'_>, sample: SampleId) -> f64 {
        self.variance_of(&self.lever(deviation, nominal, sample))
    }

    /// Variance of the difference of two samples' distances.
    pub(super) fn difference_mm2(&self, deviation: &Deviation, nominal: &Nominal<'_>, [one, other]: [SampleId; 2]) -> f64 {
        let (mut lever, less) = (self.lever(deviation, nominal, one), self.lever(deviation, nominal, other));
        lever.views.extend(less.views.into_iter().map(|(view, row)| (view, -row)));
        lever.part -= less.part;
        self.variance_of(&lever)
    }

    fn lever(&self, deviation: &Deviation, nominal: &Nominal<'_>, sample: SampleId) -> PoseLever {
        let (at, normal) = (nominal.surface.sample_mm[sample.index()], nominal.surface.patch_of(sample).normal);
        let points = deviation.points_of(sample);
        let all: f64 = points.iter().copied().map(f64::from).sum();
        let row = |(view, points): (&u16, &u32)| {
            let (view, share) = (usize::from(*view), f64::from(*points) / all.max(1.0));
            let scanner_from_part = &self.scanners_from_part[view];
            (view, lever(&scanner_from_part.point(&at), &scanner_from_part.direction(&normal)) * share)
        };
        let views = deviation.views_of(sample).iter().zip(points).map(row).collect();
        PoseLever { views, part: self.frame.row(nominal, sample) }
    }

    fn variance_of(&self, lever: &PoseLever) -> f64 {
        let PoseLever { views, part } = lever;
        let mut sum = (part.transpose() * self.of_fit * part)[0];
        let mut pulled_mm = part.dot(&self.pulled_fit);
        for (place, (view, row)) in views.iter().enumerate() {
            let at = FREEDOMS * view;
            let block = |column: usize| self.open.covariance.fixed_view::<FREEDOMS, FREEDOMS>(at, column);
            pulled_mm += row.dot(&self.open.pulled.fixed_rows::<FREEDOMS>(at));
            let with_fit = self.with_fit.fixed_view::<FREEDOMS, FREEDOMS>(at, 0) * part;
            let with_others = views[..place].iter().map(|(other, other_row)| block(FREEDOMS * other) * other_row);
            let with_others: Twist = with_others.fold(with_fit, |sum, one| sum + one);
            sum += row.dot(&(with_others * 2.0 + block(at) * row));
        }
        variance(sum) + pulled_mm * pulled_mm
    }
}
