//! Compensated sums of areas (Neumaier 1974): what is added up in two ways differs by a rounding, not by one for each sample.

use crate::planning::ids::SampleId;

/// Area of some samples, mm².
pub(in crate::inspection) fn area_mm2(area_mm2: &[f64], samples: impl Iterator<Item = SampleId>) -> f64 {
    let (mut sum, mut correction) = (0.0_f64, 0.0_f64);
    for sample in samples {
        let term = area_mm2[sample.index()];
        let next = sum + term;
        correction += if sum.abs() >= term.abs() { (sum - next) + term } else { (term - next) + sum };
        sum = next;
    }
    sum + correction
}
