//! Spots of neighbouring samples that deviate alike: missing or extra material.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::{Deviation, DeviationOptions, MaterialKind, Nominal, SampleDeviation};
use crate::geometry::sort_descending;
use crate::planning::ids::SampleId;

/// Cells of neighbours, in distances between samples.
const CELL_SPACINGS: f64 = 2.0;

/// A spot of samples that deviate by more than the uncertainty of their points and the limit. What poses leave open moves a wall as a
/// whole, and makes no spot of it less of one.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviationSpot {
    /// Missing or extra.
    pub kind: MaterialKind,
    /// Middle of its samples, part frame, mm.
    pub centre_mm: Point3<f64>,
    /// Area of its samples, mm².
    pub area_mm2: f64,
    /// Mean deviation, mm.
    pub mean_mm: f64,
    /// Deviation that is farthest from zero, mm.
    pub worst_mm: f64,
    /// Number of its samples.
    pub samples: usize,
    /// Views that measured one of its samples, as places in the list of scans.
    pub views: Vec<u16>,
}

pub(super) fn worst(
    deviation: &Deviation,
    nominal: &Nominal<'_>,
    options: &DeviationOptions,
    count: usize,
) -> Vec<DeviationSpot> {
    let surface = nominal.surface;
    let area_mm2: f64 = surface.patches.iter().map(|patch| patch.area_mm2).sum();
    let size = CELL_SPACINGS * (area_mm2 / surface.sample_mm.len().max(1) as f64).sqrt();
    let measured = deviation.samples.iter().filter(|sample| sample.points > 0).count();
    let mut found = Vec::new();
    for kind in MaterialKind::ALL {
        let is_far = |sample: &SampleId| {
            let own = deviation.samples[sample.index()];
            let is_kind = (own.distance_mm < 0.0) == (kind == MaterialKind::Missing);
            own.points > 0 && is_kind && f64::from(own.distance_mm.abs() - own.of_points_mm) > options.spot_mm
        };
        let mut cells: BTreeMap<[i64; 3], Vec<SampleId>> = BTreeMap::new();
        for sample in surface.samples().filter(is_far) {
            let cell = surface.sample_mm[sample.index()].coords.map(|value| (value / size).floor() as i64);
            cells.entry(cell.into()).or_default().push(sample);
        }
        while let Some((first, _)) = cells.iter().next() {
            let spot = taken(*first, &mut cells);
            if !is_chance(&spot, &deviation.samples, measured) {
                found.push(described(kind, &spot, deviation, nominal));
            }
        }
    }
    sort_descending(&mut found, |spot| spot.worst_mm.abs());
    found.truncate(count);
    found
}

/// Returns true if noise explains a spot: a single point shows it, and of so many samples one is likely to be as far off by noise alone.
/// With the tail of the normal distribution at most e^(−z²/2), N samples exceed z = √(2 ln(N/p)) with a probability of at most p in all
/// (Bonferroni; the bound is Chernoff's).
fn is_chance(spot: &[SampleId], samples: &[SampleDeviation], measured: usize) -> bool {
    /// Probability of a spot on a part without any.
    const BY_CHANCE: f64 = 0.05;
    let own = |sample: &SampleId| samples[sample.index()];
    // Samples around one point have its value.
    let first = own(&spot[0]).distance_mm.to_bits();
    let is_one_point = spot.iter().map(own).all(|sample| sample.points == 1 && sample.distance_mm.to_bits() == first);
    let farthest = (2.0 * (measured as f64 / BY_CHANCE).ln()).sqrt();
    // Expanded uncertainties have k = 2; that of a single point is of the noise of all.
    is_one_point && f64::from(own(&spot[0]).distance_mm.abs()) <= 0.5 * farthest * f64::from(own(&spot[0]).of_points_mm)
}

fn taken(first: [i64; 3], cells: &mut BTreeMap<[i64; 3], Vec<SampleId>>) -> Vec<SampleId> {
    let (mut spot, mut waiting) = (Vec::new(), vec![first]);
    while let Some([x, y, z]) = waiting.pop() {
        let Some(samples) = cells.remove(&[x, y, z]) else { continue };
        spot.extend(samples);
        waiting.extend((0..27).map(|place| [x + place % 3 - 1, y + place / 3 % 3 - 1, z + place / 9 - 1]));
    }
    spot.sort_unstable();
    spot
}

fn described(kind: MaterialKind, spot: &[SampleId], deviation: &Deviation, nominal: &Nominal<'_>) -> DeviationSpot {
    let (mut area, mut place, mut sum, mut worst) = (0.0, Vector3::zeros(), 0.0, 0.0_f64);
    let mut views: Vec<u16> = Vec::new();
    for sample in spot {
        let own = nominal.surface.sample_area_mm2(*sample);
        let distance = f64::from(deviation.samples[sample.index()].distance_mm);
        area += own;
        place += nominal.surface.sample_mm[sample.index()].coords * own;
        sum += own * distance;
        worst = if distance.abs() > worst.abs() { distance } else { worst };
        views.extend_from_slice(deviation.views_of(*sample));
    }
    views.sort_unstable();
    views.dedup();
    let centre_mm = Point3::from(place / area);
    DeviationSpot { kind, centre_mm, area_mm2: area, mean_mm: sum / area, worst_mm: worst, samples: spot.len(), views }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A perfect part had missing material: one of its points was 0.214 mm off, seen at 75° of incidence.
    #[test]
    fn a_single_point_that_noise_explains_is_no_spot_and_more_points_or_a_farther_one_are() {
        let sample = |distance_mm: f32, points: u32| SampleDeviation {
            distance_mm,
            points,
            of_points_mm: 0.1,
            ..SampleDeviation::default()
        };
        let is_chance = |samples: &[SampleDeviation]| {
            let spot: Vec<SampleId> = SampleId::first(samples.len()).collect();
            super::is_chance(&spot, samples, 20_000)
        };
        assert!(is_chance(&[sample(-0.214, 1); 4]));
        // 20 000 samples of noise exceed 5.08 standard deviations of 0.05 mm once in twenty parts.
        assert!(is_chance(&[sample(-0.25, 1)]) && !is_chance(&[sample(-0.26, 1)]), "the bound");
        assert!(!is_chance(&[sample(-0.214, 2)]), "a flaw in part of a footprint widens its own scatter");
        assert!(!is_chance(&[sample(-0.214, 1), sample(-0.213, 1)]), "two points");
    }
}
