//! Tables and clouds of an inspection: planned and measured area and deviation of every face of the uploaded file, and the measured
//! surface in the colours of its deviation.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::deviation::SIGN_SENTENCE;
use crate::geometry::Mesh;
use crate::inspection::Inspection;
use crate::planning::ids::SampleId;
use crate::wire::csv::Csv;
use crate::wire::words::fixed;

/// Areas of a face, mm².
#[derive(Clone, Copy, Default)]
struct FaceAreas {
    asked: f64,
    planned: f64,
    measured: f64,
    /// Largest lost area of a cause, and its place among the causes.
    lost: f64,
}

/// Samples of each face of the uploaded file, ascending by face.
fn samples_of_faces(inspection: &Inspection, mesh: &Mesh) -> BTreeMap<u32, Vec<SampleId>> {
    let mut faces: BTreeMap<u32, Vec<SampleId>> = BTreeMap::new();
    for sample in inspection.surface.samples() {
        let face = mesh.source_face[inspection.surface.patch_of(sample).face as usize];
        faces.entry(face).or_default().push(sample);
    }
    faces
}

/// `coverage.csv` of an inspection: a row for each face that has samples.
#[must_use]
pub fn coverage_csv(inspection: &Inspection, mesh: &Mesh) -> String {
    let mut csv = Csv::new(&["face", "asked_area_mm2", "planned_area_mm2", "measured_area_mm2", "lost_area_mm2", "cause"]);
    let coverage = &inspection.coverage;
    for (face, samples) in samples_of_faces(inspection, mesh) {
        let (mut areas, mut causes) = (FaceAreas::default(), BTreeMap::new());
        for sample in samples.iter().filter(|sample| inspection.surface.asked[sample.index()]) {
            let area_mm2 = inspection.surface.sample_area_mm2(*sample);
            areas.asked += area_mm2;
            areas.planned += if coverage.planned.holds(*sample) { area_mm2 } else { 0.0 };
            areas.measured += if coverage.measured.holds(*sample) { area_mm2 } else { 0.0 };
            if let Some(cause) = inspection.losses.cause_of(*sample) {
                areas.lost += area_mm2;
                *causes.entry(cause).or_insert(0.0) += area_mm2;
            }
        }
        let largest = causes.iter().fold(None, |largest: Option<(_, f64)>, (cause, area)| {
            largest.filter(|(_, most)| most >= area).or(Some((*cause, *area)))
        });
        csv.number(face);
        [areas.asked, areas.planned, areas.measured, areas.lost].iter().for_each(|area| csv.number(area));
        csv.text(largest.map_or("", |(cause, _)| cause.as_str()));
        csv.end_row();
    }
    csv.finish()
}

/// `deviation.csv`: a row for each face that was measured. Its mean is above 0 where there is more material than nominal.
#[must_use]
pub fn deviation_csv(inspection: &Inspection, mesh: &Mesh) -> String {
    let mut csv = Csv::new(&["face", "measured_area_mm2", "points", "mean_mm", "sigma_mm", "expanded_uncertainty_mm"]);
    let deviations = &inspection.deviations().samples;
    for (face, samples) in samples_of_faces(inspection, mesh) {
        let measured = samples.iter().filter(|sample| deviations[sample.index()].points > 0);
        let (mut area, mut points, mut sums) = (0.0, 0_u64, [0.0; 3]);
        for sample in measured {
            let (found, own) = (deviations[sample.index()], inspection.surface.sample_area_mm2(*sample));
            area += own;
            points += u64::from(found.points);
            let values = [found.distance_mm, found.sigma_mm, found.expanded_mm];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += own * f64::from(value));
        }
        if area > 0.0 {
            csv.number(face);
            csv.number(area);
            csv.number(points);
            sums.iter().for_each(|sum| csv.number(fixed(sum / area, 6)));
            csv.end_row();
        }
    }
    csv.finish()
}

/// Step of a deviation between −`limit` and `limit`, from 0 for missing material to 6 for extra; 3 is none.
#[must_use]
pub fn deviation_step(deviation_mm: f64, limit_mm: f64) -> u8 {
    let place = (deviation_mm / limit_mm.max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0);
    // −1 to 1 in seven steps of equal width.
    (((place + 1.0) * 3.5) as u8).min(6)
}

/// Colour of a deviation between −`limit` and `limit`: blue for missing material, white for none, red for extra (the ends and the
/// middle of ColorBrewer's RdBu).
#[must_use]
pub fn deviation_colour(deviation_mm: f64, limit_mm: f64) -> [u8; 3] {
    const ENDS: [[f64; 3]; 3] = [[33.0, 102.0, 172.0], [247.0, 247.0, 247.0], [178.0, 24.0, 43.0]];
    let place = (deviation_mm / limit_mm.max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0) + 1.0;
    let before = (place.floor() as usize).min(1);
    let share = place - before as f64;
    [0, 1, 2].map(|channel| (ENDS[before][channel] * (1.0 - share) + ENDS[before + 1][channel] * share).round() as u8)
}

/// Largest deviation that colours tell apart: the farther of the 1st and the 99th percentile, mm.
#[must_use]
pub fn colour_limit_mm(inspection: &Inspection) -> f64 {
    let whole = inspection.figures.whole;
    whole.map_or(1.0, |whole| whole.percentiles_mm[0].abs().max(whole.percentiles_mm[4].abs()).max(1e-3))
}

/// Header of `deviation.ply`, for so many samples.
fn ply_header(samples: usize) -> String {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\ncomment millimetres, part frame\n");
    // Writing to a String cannot fail.
    let _ = writeln!(header, "comment {SIGN_SENTENCE}\nelement vertex {samples}");
    for name in ["x", "y", "z", "nx", "ny", "nz", "deviation", "expanded_uncertainty"] {
        let _ = writeln!(header, "property float {name}");
    }
    header + "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
}

/// `deviation.ply`: the measured samples of the model, each with its normal, deviation, expanded uncertainty and colour, part frame, mm.
#[must_use]
pub fn deviation_ply(inspection: &Inspection) -> Vec<u8> {
    let (deviations, surface) = (&inspection.deviations().samples, &inspection.surface);
    let measured: Vec<SampleId> = surface.samples().filter(|sample| deviations[sample.index()].points > 0).collect();
    let limit_mm = colour_limit_mm(inspection);
    let mut bytes = ply_header(measured.len()).into_bytes();
    bytes.reserve(35 * measured.len());
    for sample in measured {
        let (found, at) = (deviations[sample.index()], surface.sample_mm[sample.index()]);
        let normal = surface.patch_of(sample).normal;
        let floats = at.iter().chain(normal.iter()).map(|value| *value as f32).chain([found.distance_mm, found.expanded_mm]);
        bytes.extend(floats.flat_map(f32::to_le_bytes));
        bytes.extend(deviation_colour(f64::from(found.distance_mm), limit_mm));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::ply_header;

    /// Users had to guess whether a deviation above 0 is a bump or a dent.
    #[test]
    fn the_cloud_of_deviations_says_what_their_sign_means() {
        let header = ply_header(12);
        let begin = "ply\nformat binary_little_endian 1.0\ncomment millimetres, part frame\ncomment Deviations are along the \
                     outward normal: above 0 is more material than nominal.\nelement vertex 12\nproperty float x\n";
        assert!(header.starts_with(begin) && header.ends_with("property uchar blue\nend_header\n"), "{header}");
    }
}
