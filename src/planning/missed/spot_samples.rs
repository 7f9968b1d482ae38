//! A spot as views are tried on it: few of its samples, one bit each, so that what a view measures of it is one word.

use crate::planning::ids::SampleId;
use crate::planning::surface::{AskedPoint, Surface};
use crate::planning::verdict::Cause;
use crate::planning::visibility::{Probe, ones};

/// Samples of a spot that views are tried on: a share of a half is then known to about 6 points.
const MAX_TRIED: usize = 64;
/// Samples of a spot on which what works is confirmed.
const MAX_CONFIRMED: usize = 8192;
/// Number for a sample that the view measures; for one that fails it is the number of the cause.
const MEASURED: u8 = u8::MAX;

/// Points of a spot.
pub(super) struct SpotSamples {
    points: Vec<AskedPoint>,
    pub(super) ids: Vec<SampleId>,
    /// Area that each stands for.
    area_mm2: Vec<f64>,
    /// Area of the whole spot.
    pub(super) total_mm2: f64,
}

/// First failing cause of a view at each sample.
#[derive(Clone)]
pub(super) struct FirstFailures(Vec<u8>);

impl FirstFailures {
    /// Bits of the samples that it measures.
    pub(super) fn measured(&self) -> u64 {
        self.bits(|step, _| step == MEASURED)
    }

    /// Bits of the samples at which nothing gets further than `furthest`, and this does.
    pub(super) fn as_far_as(&self, furthest: &Self) -> u64 {
        self.bits(|step, sample| step == furthest.0[sample])
    }

    fn bits(&self, has: impl Fn(u8, usize) -> bool) -> u64 {
        self.0.iter().enumerate().filter(|(sample, step)| has(**step, *sample)).fold(0, |bits, (sample, _)| bits | 1 << sample)
    }

    /// The sum over the samples: the same scale for every view of one spot.
    pub(super) fn sum(&self) -> u32 {
        // A sample that is measured counts as much more than any that fails as a failing one can.
        self.0.iter().map(|step| u32::from(if *step == MEASURED { 32 } else { *step })).sum()
    }

    /// Takes the further of the two at each sample.
    pub(super) fn or_further(mut self, other: &Self) -> Self {
        self.0.iter_mut().zip(&other.0).for_each(|(step, other)| *step = (*step).max(*other));
        self
    }
}

impl SpotSamples {
    /// Selects a few of the samples.
    pub(super) fn few(surface: &Surface, samples: &[SampleId]) -> Self {
        Self::new(surface, samples, MAX_TRIED)
    }

    /// Selects enough of them to state an area: all in all but huge spots.
    pub(super) fn many(surface: &Surface, samples: &[SampleId]) -> Self {
        Self::new(surface, samples, MAX_CONFIRMED)
    }

    fn new(surface: &Surface, samples: &[SampleId], max: usize) -> Self {
        let area = |sample: &SampleId| surface.sample_area_mm2(*sample);
        let total_mm2: f64 = samples.iter().map(area).sum();
        let count = samples.len().min(max);
        let samples: Vec<SampleId> = (0..count).map(|i| samples[i * samples.len() / count]).collect();
        let looked_at_mm2: f64 = samples.iter().map(area).sum();
        let area_mm2 = samples.iter().map(|sample| area(sample) * total_mm2 / looked_at_mm2).collect();
        let point = |sample: &SampleId| surface.asked_point(*sample);
        Self { points: samples.iter().map(point).collect(), ids: samples, area_mm2, total_mm2 }
    }

    /// Points of the samples.
    pub(super) fn points(&self) -> &[AskedPoint] {
        &self.points
    }

    /// Progress of a view, shadows included.
    pub(super) fn progress(&self, probe: &Probe<'_>) -> FirstFailures {
        FirstFailures(probe.measure(&self.points).into_iter().map(step).collect())
    }

    /// Progress of a view before any shadow, as [`FirstFailures::sum`] counts.
    pub(super) fn progress_before_shadow(&self, probe: &Probe<'_>) -> u32 {
        FirstFailures(self.points.iter().map(|point| step(probe.before_shadow(point))).collect()).sum()
    }

    /// Area of the samples whose bits are set.
    pub(super) fn area_mm2(&self, bits: u64) -> f64 {
        ones(bits).map(|sample| self.area_mm2[sample as usize]).sum()
    }

    /// Area that each view adds to those before it.
    pub(super) fn added_mm2(&self, probes: &[Probe<'_>]) -> Vec<f64> {
        let mut open: Vec<usize> = (0..self.points.len()).collect();
        let mut added_mm2 = Vec::with_capacity(probes.len());
        for probe in probes {
            let points: Vec<AskedPoint> = open.iter().map(|place| self.points[*place]).collect();
            let measured = probe.measure(&points);
            let added = open.iter().zip(&measured).filter(|(_, result)| result.is_ok());
            added_mm2.push(added.map(|(place, _)| self.area_mm2[*place]).sum());
            let mut left = measured.iter();
            open.retain(|_| left.next().is_some_and(Result::is_err));
        }
        added_mm2
    }
}

/// Number of how far a view gets at a sample.
fn step(result: Result<f32, Cause>) -> u8 {
    result.map_or_else(|cause| cause as u8, |_| MEASURED)
}
