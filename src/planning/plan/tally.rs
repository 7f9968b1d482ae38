//! Sum of the area that views measure together, by grade and by incidence ([`crate::planning::method::coverage`]).

use nalgebra::Point3;

use crate::geometry::parallel;
use crate::planning::ids::SampleId;
use crate::planning::plan::{Grade, MeasuredArea, WITHIN_DEG};
use crate::planning::surface::Surface;
use crate::planning::visibility::Row;

/// The area that views measure, each given by its viewpoint, part frame, and by the samples that it measures, with quality.
pub(in crate::planning) fn measured_area<'a>(
    surface: &Surface,
    asked_area_mm2: &[f64],
    views: impl IntoIterator<Item = (Point3<f64>, &'a Row)>,
) -> MeasuredArea {
    let mut best = vec![None; asked_area_mm2.len()];
    for (viewpoint_mm, row) in views {
        let graded: Vec<(SampleId, f32)> = row.graded().collect();
        let cosines = parallel::map(&graded, |(sample, _)| cos_incidence(surface, *sample, &viewpoint_mm));
        for ((sample, quality), cos) in graded.into_iter().zip(cosines) {
            let (best_quality, best_cos) = best[sample.index()].get_or_insert((quality, cos));
            (*best_quality, *best_cos) = (best_quality.max(quality), best_cos.max(cos));
        }
    }
    let min_cos = WITHIN_DEG.map(|incidence_deg| incidence_deg.to_radians().cos());
    let mut measured = MeasuredArea::default();
    for (best, area_mm2) in best.iter().zip(asked_area_mm2) {
        let Some((quality, cos)) = best else { continue };
        measured.grade_area_mm2[Grade::of(f64::from(*quality)) as usize] += area_mm2;
        for (within_mm2, min_cos) in measured.within_area_mm2.iter_mut().zip(min_cos) {
            *within_mm2 += if *cos >= min_cos { *area_mm2 } else { 0.0 };
        }
    }
    measured.area_mm2 = measured.grade_area_mm2.iter().sum();
    measured
}

/// Cosine of the angle at a sample between its normal and the direction to a viewpoint.
fn cos_incidence(surface: &Surface, sample: SampleId, viewpoint_mm: &Point3<f64>) -> f64 {
    let towards = viewpoint_mm - surface.sample_mm[sample.index()];
    surface.patch_of(sample).normal.dot(&towards) / towards.norm()
}
