//! Coverage of a region of interest or a feature, held against its own target, and the causes of what it misses.

use super::share;
use crate::planning::surface::requirements::RegionKind;
use crate::planning::verdict::Cause;

/// Rounding of a share: sums of areas in another order.
pub(in crate::planning) const SHARE_SLACK: f64 = 4e-9;

/// Coverage of a region, counting only what is measured as well as is asked there.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionCoverage {
    /// Name of the region.
    pub name: String,
    /// Kind of the region.
    pub kind: RegionKind,
    /// Number of asked samples in it.
    pub samples: usize,
    /// Asked area of the region.
    pub asked_area_mm2: f64,
    /// Part of the asked area that some kept candidate measures.
    pub coverable_area_mm2: f64,
    /// Part of the asked area that the chosen views measure.
    pub measured_area_mm2: f64,
    /// Share of the asked area that was to be measured.
    pub target: Option<f64>,
    /// Width of the tolerance zone of a feature: 0.3 for ±0.15 mm.
    pub tolerance_mm: Option<f64>,
    /// Width of the finest tolerance zone that the noise of the job can serve.
    pub min_tolerance_mm: f64,
    /// Missed part of the asked area by cause, the largest first.
    pub missed_mm2: Vec<(Cause, f64)>,
    /// Area that is missed as [`Cause::BelowGrade`] where a finer tolerance is asked for than the noise can serve.
    pub beyond_noise_area_mm2: f64,
    /// Coverage on a second set of samples, on which the views were not chosen; `None` where that has none in the region.
    pub independent: Option<IndependentRegion>,
}

/// Coverage of a region on a second set of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct IndependentRegion {
    /// Number of asked samples in it.
    pub samples: usize,
    /// Asked area that they stand for.
    pub asked_area_mm2: f64,
    /// Part of the asked area that the chosen views measure.
    pub measured_area_mm2: f64,
    /// Sum of the squares of the areas that the samples stand for, mm⁴.
    pub squares_mm4: f64,
}

impl IndependentRegion {
    /// Counts an asked sample.
    pub(in crate::planning) fn add(&mut self, area_mm2: f64, is_measured: bool) {
        self.samples += 1;
        self.asked_area_mm2 += area_mm2;
        self.measured_area_mm2 += if is_measured { area_mm2 } else { 0.0 };
        self.squares_mm4 += area_mm2 * area_mm2;
    }

    /// Measured share of the asked area.
    #[must_use]
    pub fn of_asked(&self) -> f64 {
        share(self.measured_area_mm2, self.asked_area_mm2)
    }

    /// Standard error of the share, √(p̃ (1 − p̃) / ñ) with ñ = n + 1 and p̃ = (n p + ½) / ñ, which a few samples that are all measured
    /// do not make 0 (A. Agresti and B. A. Coull 1998, *Approximate is better than "exact" for interval estimation of binomial
    /// proportions*, The American Statistician 52(2), with z = 1): about an upper bound for samples that are spread over the region
    /// (W. G. Cochran 1977, *Sampling Techniques*, chapters 3 and 8). n = (Σ a)² / Σ a² is the number of equal samples that tell as much
    /// as these of areas a (L. Kish 1965, *Survey Sampling*, 11.7). 0 without samples.
    #[must_use]
    pub fn standard_error(&self) -> f64 {
        if self.squares_mm4 <= 0.0 {
            return 0.0;
        }
        let n = self.asked_area_mm2 * self.asked_area_mm2 / self.squares_mm4;
        let adjusted = n + 1.0;
        let p = ((n * self.of_asked() + 0.5) / adjusted).clamp(0.0, 1.0);
        (p * (1.0 - p) / adjusted).sqrt()
    }
}

impl RegionCoverage {
    /// Measured share of the asked area; 0 where nothing of the region is asked for.
    #[must_use]
    pub fn of_asked(&self) -> f64 {
        share(self.measured_area_mm2, self.asked_area_mm2)
    }

    /// Measured share of the coverable area.
    #[must_use]
    pub fn of_coverable(&self) -> f64 {
        share(self.measured_area_mm2, self.coverable_area_mm2)
    }

    /// True if the measured share of the asked area reaches the target; `None` without a target.
    #[must_use]
    pub fn is_met(&self) -> Option<bool> {
        self.target.map(|target| self.of_asked() >= target - SHARE_SLACK)
    }

    /// Returns true if there is a target and it is not reached.
    #[must_use]
    pub fn is_unmet(&self) -> bool {
        self.is_met() == Some(false)
    }

    /// True if the measured share on the second set of samples reaches the target, or misses it by no more than its standard error; `None`
    /// without a target or samples.
    #[must_use]
    pub fn is_met_independently(&self) -> Option<bool> {
        let (target, independent) = self.target.zip(self.independent)?;
        Some(independent.of_asked() + independent.standard_error() >= target - SHARE_SLACK)
    }

    /// Returns true if the target is reached on the samples of the plan alone: what the views were chosen on flatters them.
    #[must_use]
    pub fn is_refuted(&self) -> bool {
        self.is_met() == Some(true) && self.is_met_independently() == Some(false)
    }

    /// Returns true if there is a target, and it is not reached, or reached on the samples of the plan alone.
    #[must_use]
    pub fn misses_target(&self) -> bool {
        self.is_unmet() || self.is_refuted()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A region with a target of 0.95 that is met on the samples of the plan, and so many of a second set, so many of them measured.
    fn region(samples: usize, measured: usize) -> RegionCoverage {
        let mut independent = IndependentRegion::default();
        (0..samples).for_each(|sample| independent.add(0.2, sample < measured));
        RegionCoverage {
            name: "seat".into(),
            kind: RegionKind::Interest,
            samples: 100,
            asked_area_mm2: 20.0,
            coverable_area_mm2: 20.0,
            measured_area_mm2: 19.2,
            target: Some(0.95),
            tolerance_mm: None,
            min_tolerance_mm: 0.156,
            missed_mm2: Vec::new(),
            beyond_noise_area_mm2: 0.0,
            independent: Some(independent),
        }
    }

    #[test]
    fn a_target_that_other_samples_miss_by_more_than_their_standard_error_is_refuted() {
        // 0.9 of 400: p̃ = 360.5 / 401, and the standard error is 1.50 points.
        let error = region(400, 360).independent.map(|independent| independent.standard_error());
        let expected = (360.5 * 40.5 / 401.0_f64.powi(3)).sqrt();
        assert!(error.is_some_and(|error| (error - expected).abs() < 1e-12), "{error:?}");
        // 375 of 400 are 0.9375, and the standard error is 1.22 points.
        assert!(region(400, 360).is_refuted() && region(400, 375).is_refuted());
        for measured in [376, 380, 400] {
            assert_eq!(region(400, measured).is_met_independently(), Some(true), "{measured}");
            assert!(!region(400, measured).is_refuted(), "{measured}");
        }
        let unmet = RegionCoverage { measured_area_mm2: 10.0, ..region(400, 100) };
        assert!(!unmet.is_refuted() && unmet.is_met_independently() == Some(false), "it is unmet anyway");
        assert!(region(400, 375).misses_target() && unmet.misses_target() && !region(400, 376).misses_target());
        let untold = RegionCoverage { independent: None, ..region(0, 0) };
        assert!(!untold.is_refuted() && untold.is_met_independently().is_none());
        let without_target = RegionCoverage { target: None, ..region(400, 0) };
        assert_eq!(without_target.is_met_independently(), None);
    }

    #[test]
    fn samples_of_unequal_area_tell_less_of_a_share() {
        let (mut equal, mut unequal) = (IndependentRegion::default(), IndependentRegion::default());
        (0..100).for_each(|sample| equal.add(1.0, sample % 2 == 0));
        (0..100).for_each(|sample| unequal.add(if sample < 2 { 49.0 } else { 1.0 }, sample % 2 == 0));
        // p̃ of a half is a half, and ñ one more than n.
        assert!((equal.standard_error() - 0.5 / 101.0_f64.sqrt()).abs() < 1e-12, "{}", equal.standard_error());
        // (Σ a)² / Σ a² = 196² / (2 · 49² + 98).
        let expected = 0.5 / (196.0_f64.powi(2) / (2.0 * 49.0_f64.powi(2) + 98.0) + 1.0).sqrt();
        assert!((unequal.standard_error() - expected).abs() < 1e-12, "{}", unequal.standard_error());
        assert_eq!(IndependentRegion::default().standard_error(), 0.0);
    }

    #[test]
    fn a_share_of_nothing_or_all_of_few_samples_is_not_told_as_exact() {
        let error = |samples: usize, measured: usize| {
            region(samples, measured).independent.map_or(0.0, |independent| independent.standard_error())
        };
        // One sample: ñ = 2, p̃ = ¼ or ¾.
        for measured in [0, 1] {
            assert!((error(1, measured) - (3.0_f64 / 32.0).sqrt()).abs() < 1e-12, "{}", error(1, measured));
        }
        // Three: ñ = 4, p̃ = ⅞.
        assert!((error(3, 3) - (7.0_f64 / 256.0).sqrt()).abs() < 1e-12, "{}", error(3, 3));
        assert!((0.001..0.002).contains(&error(475, 475)), "{}", error(475, 475));
        assert!(region(475, 0).is_refuted() && !region(475, 475).is_refuted());
    }
}
