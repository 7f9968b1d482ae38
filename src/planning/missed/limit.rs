//! Raised limits of incidence for a spot: the smallest whole number of degrees with which a remedy's views measure their share,
//! at most the devices' own limits, since no job goes beyond those. Cameras and projector are raised only as far as each has
//! to be.

use super::search::MissAnalysis;
use super::spot_samples::SpotSamples;
use crate::cell::{PerDevice, Scanner};
use crate::planning::params::{LimitParams, PlanParams};
use crate::planning::surface::AskedPoint;
use crate::planning::verdict::Cause;
use crate::planning::visibility::{Optics, Probe};

/// Limits of incidence that a job has tightened, and how far it may raise them again, degrees.
pub(super) struct LimitRange {
    /// Limits in force.
    pub(super) in_force_deg: PerDevice<f64>,
    /// Largest limits that the job may give. It gives one for both cameras: the tighter of their own.
    max_deg: PerDevice<f64>,
}

impl LimitRange {
    pub(super) fn of(scanner: &Scanner, limits: &LimitParams) -> Self {
        let devices = &scanner.devices;
        let own_deg = devices.as_ref().map(|device| device.incidence_max_rad.to_degrees());
        let tightened_deg = devices.as_ref().map(|device| limits.tightened_deg(device));
        Self {
            in_force_deg: tightened_deg.zip(own_deg).map(|(tightened_deg, own_deg)| tightened_deg.unwrap_or(own_deg)),
            max_deg: PerDevice::of_cameras(own_deg.left.min(own_deg.right), own_deg.projector),
        }
    }

    /// The largest limits.
    pub(super) fn widest_deg(&self) -> PerDevice<f64> {
        self.raised_to(f64::INFINITY)
    }

    fn raised_to(&self, deg: f64) -> PerDevice<f64> {
        self.in_force_deg.zip(self.max_deg).map(|(in_force_deg, max_deg)| in_force_deg.max(deg.min(max_deg)))
    }

    /// Returns true if the job has tightened a limit that it may raise.
    pub(super) fn can_raise(&self) -> bool {
        self.raises(&self.widest_deg())
    }

    fn raises(&self, limits_deg: &PerDevice<f64>) -> bool {
        self.in_force_deg.iter().zip(limits_deg).any(|(in_force_deg, limit_deg)| limit_deg > in_force_deg)
    }

    /// Limit that cameras and projector have to be raised to for `limits_deg`; none where it stays.
    pub(super) fn changed(&self, limits_deg: &PerDevice<f64>) -> (Option<f64>, Option<f64>) {
        let changed = |in_force_deg: f64, limit_deg: f64| (limit_deg > in_force_deg).then_some(limit_deg);
        (changed(self.in_force_deg.left, limits_deg.left), changed(self.in_force_deg.projector, limits_deg.projector))
    }

    /// Raised limits, the smallest first: for every whole number of degrees of the projector alone, of the cameras alone, of
    /// both.
    pub(super) fn steps_deg(&self) -> impl Iterator<Item = PerDevice<f64>> {
        let lowest = self.in_force_deg.iter().copied().fold(f64::INFINITY, f64::min).floor() as u32;
        let highest = self.max_deg.iter().copied().fold(0.0, f64::max).ceil() as u32;
        let options = move |deg: u32| {
            let both = self.raised_to(f64::from(deg));
            let projector = PerDevice { projector: both.projector, ..self.in_force_deg };
            let cameras = PerDevice { projector: self.in_force_deg.projector, ..both };
            [projector, cameras, both]
        };
        (lowest + 1..=highest).flat_map(options).filter(move |limits_deg| self.raises(limits_deg))
    }

    /// Optics of the job with these limits.
    pub(super) fn optics(&self, analysis: &MissAnalysis<'_>, limits_deg: &PerDevice<f64>) -> Optics {
        Optics::new(analysis.scanner, &self.params(analysis, limits_deg), &analysis.surface.requirements)
    }

    fn params(&self, analysis: &MissAnalysis<'_>, limits_deg: &PerDevice<f64>) -> PlanParams {
        let (mut params, (camera_deg, projector_deg)) = (analysis.params.clone(), self.changed(limits_deg));
        params.limits.camera_deg = camera_deg.or(params.limits.camera_deg);
        params.limits.projector_deg = projector_deg.or(params.limits.projector_deg);
        params
    }
}

/// Limits that a view would need at each sample of a spot: `None` where no limit helps.
pub(super) struct Needs {
    by_sample: Vec<Option<PerDevice<f64>>>,
}

impl Needs {
    /// `probe` is one of optics with the largest limits.
    pub(super) fn of(samples: &SpotSamples, probe: &Probe<'_>) -> Self {
        let need = |(point, result): (&AskedPoint, Result<f32, Cause>)| {
            result.ok().map(|_| probe.incidence_rad(point).map(f64::to_degrees))
        };
        Self { by_sample: samples.points().iter().zip(probe.measure(samples.points())).map(need).collect() }
    }

    /// Bits of the samples that limits reach.
    pub(super) fn measured(&self, limits_deg: &PerDevice<f64>) -> u64 {
        let reaches = |needs: &PerDevice<f64>| needs.iter().zip(limits_deg).all(|(need, limit)| need <= limit);
        let reached = self.by_sample.iter().enumerate().filter(|(_, needs)| needs.as_ref().is_some_and(reaches));
        reached.fold(0, |bits, (sample, _)| bits | 1 << sample)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::nominal_scanner;

    /// The nominal rig, with these own limits of left camera, right camera and projector, degrees.
    fn rig(left: f64, right: f64, projector: f64) -> Scanner {
        let mut scanner = nominal_scanner();
        scanner.devices.left.incidence_max_rad = left.to_radians();
        scanner.devices.right.incidence_max_rad = right.to_radians();
        scanner.devices.projector.incidence_max_rad = projector.to_radians();
        scanner
    }

    fn close(limits_deg: &PerDevice<f64>, expected: [f64; 3]) -> bool {
        limits_deg.iter().zip(expected).all(|(limit_deg, expected)| (limit_deg - expected).abs() < 1e-9)
    }

    #[test]
    fn limits_are_raised_to_the_hardware_s_and_no_further() {
        let limits = LimitParams { camera_deg: Some(40.5), projector_deg: Some(60.0) };
        let range = LimitRange::of(&rig(85.0, 85.0, 77.5), &limits);
        assert!(close(&range.in_force_deg, [40.5, 40.5, 60.0]) && close(&range.widest_deg(), [85.0, 85.0, 77.5]));
        let steps: Vec<_> = range.steps_deg().collect();
        assert!(close(&steps[0], [41.0, 41.0, 60.0]) && close(steps.last().expect("steps"), [85.0, 85.0, 77.5]));
        assert!(steps.iter().flatten().all(|limit_deg| *limit_deg <= 85.0 + 1e-9));
        assert!(steps.iter().all(|limits_deg| limits_deg.projector <= 77.5 + 1e-9));
        assert!(steps.iter().any(|limits_deg| close(limits_deg, [40.5, 40.5, 77.5])), "the projector's own, no whole number");
        assert_eq!(range.changed(&steps[0]), (Some(41.0), None));
    }

    #[test]
    fn one_limit_for_both_cameras_ends_at_the_tighter_of_theirs() {
        let limits = LimitParams { camera_deg: Some(30.0), projector_deg: None };
        let range = LimitRange::of(&rig(85.0, 45.0, 77.5), &limits);
        assert!(range.can_raise() && close(&range.widest_deg(), [45.0, 45.0, 77.5]), "{:?}", range.widest_deg());
    }

    #[test]
    fn limits_that_the_job_has_not_tightened_are_not_raised() {
        for limits in [LimitParams::default(), LimitParams { camera_deg: Some(45.0), projector_deg: Some(77.5) }] {
            let range = LimitRange::of(&rig(45.0, 45.0, 77.5), &limits);
            assert!(!range.can_raise() && range.steps_deg().next().is_none());
        }
        let range = LimitRange::of(&rig(85.0, 45.0, 77.5), &LimitParams::default());
        assert!(!range.can_raise() && close(&range.in_force_deg, [85.0, 45.0, 77.5]));
    }
}
