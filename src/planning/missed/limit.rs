//! Raised limits of incidence for a spot: the smallest whole number of degrees, at most 89, with
//! which a remedy's views measure their share. Cameras and projector are raised only as far as each has to be.

use super::search::MissAnalysis;
use super::spot_samples::SpotSamples;
use crate::cell::{DeviceName, PerDevice};
use crate::planning::params::PlanParams;
use crate::planning::visibility::{Optics, Probe};

/// Largest limit that is tried, degrees: beyond it a surface is seen edge on.
const MAX_DEG: f64 = 89.0;

/// Limits of a job, degrees.
pub(super) fn limits_deg(analysis: &MissAnalysis<'_>) -> PerDevice<f64> {
    analysis.scanner.devices.map(|device| {
        let given = match device.name {
            DeviceName::Projector => analysis.params.limits.projector_deg,
            DeviceName::Left | DeviceName::Right => analysis.params.limits.camera_deg,
        };
        given.unwrap_or_else(|| device.incidence_max_rad.to_degrees())
    })
}

/// The job's parameters with these limits.
pub(super) fn raised(analysis: &MissAnalysis<'_>, camera_deg: f64, projector_deg: f64) -> PlanParams {
    let mut params = analysis.params.clone();
    params.limits.camera_deg = Some(camera_deg);
    params.limits.projector_deg = Some(projector_deg);
    params
}

/// Optics that accept whatever the largest limit would.
pub(super) fn widest(analysis: &MissAnalysis<'_>) -> Optics {
    let PerDevice { left, projector, .. } = limits_deg(analysis);
    Optics::new(analysis.scanner, &raised(analysis, left.max(MAX_DEG), projector.max(MAX_DEG)), &analysis.surface.requirements)
}

/// Limits that a view would need at each sample of a spot: `None` where no limit helps.
pub(super) struct Needs {
    by_sample: Vec<Option<PerDevice<f64>>>,
}

impl Needs {
    /// `probe` is one of [`widest`] optics.
    pub(super) fn of(samples: &SpotSamples, probe: &Probe<'_>) -> Self {
        let by_sample = samples.points().iter().map(|(p, normal, kind)| {
            probe.measure(p, normal, *kind).ok().map(|_| probe.incidence_rad(p, normal).map(f64::to_degrees))
        });
        Self { by_sample: by_sample.collect() }
    }

    /// Bits of the samples that limits reach.
    pub(super) fn measured(&self, limits_deg: &PerDevice<f64>) -> u64 {
        let reaches = |needs: &PerDevice<f64>| needs.iter().zip(limits_deg).all(|(need, limit)| need <= limit);
        let reached = self.by_sample.iter().enumerate().filter(|(_, needs)| needs.as_ref().is_some_and(reaches));
        reached.fold(0, |bits, (sample, _)| bits | 1 << sample)
    }
}

/// Every whole number of degrees that raises some limit.
pub(super) fn steps_deg(limits_deg: &PerDevice<f64>) -> impl Iterator<Item = f64> {
    let lowest = limits_deg.iter().copied().fold(MAX_DEG, f64::min).floor() as u32;
    (lowest + 1..=MAX_DEG as u32).map(f64::from)
}

/// Limits raised to `deg`: of the projector alone, of the cameras alone, of both.
pub(super) fn options(limits_deg: &PerDevice<f64>, deg: f64) -> [PerDevice<f64>; 3] {
    let both = limits_deg.map(|limit_deg| limit_deg.max(deg));
    let projector = PerDevice { projector: both.projector, ..*limits_deg };
    let cameras = PerDevice { projector: limits_deg.projector, ..both };
    [projector, cameras, both]
}
