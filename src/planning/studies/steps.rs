//! Coverage and grades after each view. Cost: samples × views.

use super::StudyStep;
use crate::planning::plan::{Grade, share};
use crate::planning::visibility::Row;

/// One step a row, each with all rows before it. Sums run over samples in order, so that a step does not depend on those
/// before it.
pub(super) fn steps(graded: &[Row], asked_area_mm2: &[f64], coverable_mm2: f64, total_mm2: f64) -> Vec<StudyStep> {
    let asked_mm2: f64 = asked_area_mm2.iter().sum();
    let mut best_quality = vec![f32::NEG_INFINITY; asked_area_mm2.len()];
    let step = |row: &Row| {
        for (sample, quality) in row.graded() {
            let best = &mut best_quality[sample.index()];
            *best = best.max(quality);
        }
        let mut grade_mm2 = [0.0; 4];
        for (quality, area_mm2) in best_quality.iter().zip(asked_area_mm2).filter(|(quality, _)| quality.is_finite()) {
            grade_mm2[Grade::of(f64::from(*quality)) as usize] += area_mm2;
        }
        let measured_mm2: f64 = grade_mm2.iter().sum();
        StudyStep {
            of_asked: share(measured_mm2, asked_mm2),
            of_coverable: share(measured_mm2, coverable_mm2),
            of_total: share(measured_mm2, total_mm2),
            grades: grade_mm2.map(|area_mm2| share(area_mm2, asked_mm2)),
        }
    };
    graded.iter().map(step).collect()
}
