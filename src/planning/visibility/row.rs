//! One row of the visibility matrix: one bit a sample, and where it is wanted the quality of each measured sample in 16 bits.
//!
//! A quality is kept as a multiple of the greatest one's 32 767th part. With the weights c + d = 1 it is off by at most
//! 1.53·10⁻⁵, in general by (c + d) times that. Cost: 1 bit a sample and 2 bytes a measured one; 500 views that measure
//! all of 10⁶ samples take 0.99 GiB, without quality 62.5 MB.

#[cfg(test)]
mod tests;

use super::sample_set::SampleSet;
use crate::geometry::{floor_to_i32, simd_max, simd_min};
use crate::planning::ids::SampleId;
use crate::planning::params::ScoreParams;
use crate::planning::surface::Surface;

/// Steps from 0 to the greatest quality.
const STEPS: f32 = i16::MAX as f32;

/// Scale of quality in whole steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityScale {
    max: f32,
}

impl Default for QualityScale {
    /// A scale from −1 to 1.
    fn default() -> Self {
        Self { max: 1.0 }
    }
}

impl QualityScale {
    /// The scale for c·Q_δ + d·Q_dis, which lies between −(c + d) and c + d.
    #[must_use]
    pub fn of(score: &ScoreParams) -> Self {
        let max = (score.c + score.d) as f32;
        if max > 0.0 { Self { max } } else { Self::default() }
    }

    /// Quality that [`i16::MAX`] steps stand for.
    #[must_use]
    pub fn max(self) -> f32 {
        self.max
    }

    /// The nearest step.
    #[inline(always)]
    #[must_use]
    pub fn quantise(self, quality: f32) -> i16 {
        let steps = quality / self.max * STEPS;
        // The nearest whole number, halves away from zero; unlike `f32::round` and `as` this is plain arithmetic, which vectorises.
        let size = floor_to_i32(simd_min(simd_max(steps.abs(), 0.0), STEPS) + 0.5) as i16;
        if steps < 0.0 { -size } else { size }
    }

    /// Quality of a step.
    #[must_use]
    pub fn quality(self, step: i16) -> f32 {
        f32::from(step) / STEPS * self.max
    }
}

/// One row of the visibility matrix: the samples that one view measures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    measured: SampleSet,
    quality: Option<Quality>,
}

#[derive(Clone, Debug, PartialEq)]
struct Quality {
    scale: QualityScale,
    /// Step of each measured sample, ascending by sample.
    steps: Vec<i16>,
}

impl Row {
    /// A view that measures the samples whose bits are set, as [`SampleSet::words`] has them, of unknown quality.
    #[must_use]
    pub fn new(words: Vec<u64>) -> Self {
        Self { measured: SampleSet::from_words(words), quality: None }
    }

    /// The row with c·Q_δ + d·Q_dis ([`crate::planning::method::quality`]) at each measured sample, ascending by sample, in
    /// steps of `scale`.
    ///
    /// # Panics
    /// Unless there is one step for each measured sample.
    #[must_use]
    pub fn with_quality(self, steps: Vec<i16>, scale: QualityScale) -> Self {
        assert_eq!(steps.len(), self.count(), "one step a measured sample");
        Self { quality: Some(Quality { scale, steps }), ..self }
    }

    /// A row over a surface of `samples` samples from those that are measured, ascending, with their quality from −1
    /// to 1.
    #[must_use]
    pub fn from_samples(samples: usize, graded: impl IntoIterator<Item = (SampleId, f32)>) -> Self {
        let (mut measured, scale) = (SampleSet::none_of(samples), QualityScale::default());
        let steps = graded.into_iter().map(|(sample, quality)| {
            measured.insert(sample);
            scale.quantise(quality)
        });
        let steps = steps.collect();
        Self { measured, quality: None }.with_quality(steps, scale)
    }

    /// The row within `samples`, a set of the same surface, with its quality there.
    #[must_use]
    pub fn within(&self, samples: &SampleSet) -> Self {
        let mut measured = self.measured.clone();
        measured.retain_all(samples);
        let quality = self.quality.as_ref().map(|quality| {
            let steps = self.samples().zip(&quality.steps).filter(|(sample, _)| samples.holds(*sample)).map(|(_, step)| *step);
            Quality { scale: quality.scale, steps: steps.collect() }
        });
        Self { measured, quality }
    }

    /// The row without `samples`, a set of the same surface.
    #[must_use]
    pub fn without(&self, samples: &SampleSet) -> Self {
        let mut kept = self.measured.clone();
        kept.remove_all(samples);
        self.within(&kept)
    }

    /// The row over a surface of `samples` samples, the first `own` of which are its own and the rest those of `added`. It has no
    /// quality where either has none.
    #[must_use]
    pub fn followed_by(&self, added: &Self, own: usize, samples: usize) -> Self {
        let mut words = self.words().to_vec();
        words.resize(samples.div_ceil(64), 0);
        let mut measured = SampleSet::from_words(words);
        added.samples().for_each(|sample| measured.insert(SampleId::at(own + sample.index())));
        let quality = self.quality.as_ref().zip(added.quality.as_ref()).map(|(own, added)| {
            let steps = own.steps.iter().chain(&added.steps).copied().collect();
            Quality { scale: own.scale, steps }
        });
        Self { measured, quality }
    }

    /// The samples that it measures.
    #[must_use]
    pub fn measured(&self) -> &SampleSet {
        &self.measured
    }

    /// The samples that it measures, as words of bits.
    #[must_use]
    pub fn words(&self) -> &[u64] {
        self.measured.words()
    }

    /// The samples that it measures, ascending.
    pub fn samples(&self) -> impl Iterator<Item = SampleId> {
        self.measured.iter()
    }

    /// Returns true if it measures `sample`.
    #[must_use]
    pub fn holds(&self, sample: SampleId) -> bool {
        self.measured.holds(sample)
    }

    /// Number of samples that it measures.
    #[must_use]
    pub fn count(&self) -> usize {
        self.measured.count()
    }

    /// Scale and steps of the quality, one a measured sample, where the row has it.
    #[must_use]
    pub fn quality(&self) -> Option<(QualityScale, &[i16])> {
        self.quality.as_ref().map(|quality| (quality.scale, quality.steps.as_slice()))
    }

    /// Measured samples with their quality, ascending. Empty for a row without quality: see [`super::grade`].
    pub fn graded(&self) -> impl Iterator<Item = (SampleId, f32)> {
        self.quality()
            .into_iter()
            .flat_map(|(scale, steps)| self.samples().zip(steps).map(move |(sample, step)| (sample, scale.quality(*step))))
    }

    /// The samples to which `quality_of` gives a quality, with that: from the one that each has. Nothing is left of a row without
    /// quality.
    #[must_use]
    pub fn regraded(&self, quality_of: impl Fn(SampleId, f32) -> Option<f32>) -> Self {
        let Some((scale, steps)) = self.quality() else { return Self::default() };
        let mut measured = SampleSet::from_words(vec![0; self.words().len()]);
        let mut retained = Vec::with_capacity(steps.len());
        for (sample, step) in self.samples().zip(steps) {
            let quality = scale.quality(*step);
            let Some(regraded) = quality_of(sample, quality) else { continue };
            measured.insert(sample);
            // A step that stays is not rounded again.
            retained.push(if regraded.to_bits() == quality.to_bits() { *step } else { scale.quantise(regraded) });
        }
        Self::new(measured.into_words()).with_quality(retained, scale)
    }

    /// Share of each patch's area that the view measures, 0 to 1.
    #[must_use]
    pub fn measured_fraction(&self, surface: &Surface) -> Vec<f32> {
        let mut measured = vec![0_u32; surface.patches.len()];
        self.samples().for_each(|sample| measured[surface.sample_patch[sample.index()].index()] += 1);
        surface
            .patches
            .iter()
            .zip(measured)
            .map(|(patch, measured)| (f64::from(measured) / f64::from(patch.samples)) as f32)
            .collect()
    }

    /// Best quality of each patch among its measured samples; `None` where none is measured. Like [`Row::graded`]
    /// it needs the quality.
    #[must_use]
    pub fn best_quality(&self, surface: &Surface) -> Vec<Option<f32>> {
        let mut best = vec![None; surface.patches.len()];
        for (sample, quality) in self.graded() {
            let best: &mut Option<f32> = &mut best[surface.sample_patch[sample.index()].index()];
            *best = Some(best.map_or(quality, |best| best.max(quality)));
        }
        best
    }

    /// Memory that it holds.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        size_of_val(self.words()) + self.quality.as_ref().map_or(0, |quality| size_of_val(quality.steps.as_slice()))
    }
}
