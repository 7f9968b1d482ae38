//! Openings of a spot: directions in which nothing stands between its samples and the distance of best focus.

use nalgebra::{Unit, Vector3};

use super::proposals::directions;
use super::spot_samples::SpotSamples;
use crate::geometry::{RayScene, SimdLevel, sort_descending};
use crate::planning::surface::AskedPoint;

/// Directions that are looked into: about 9° apart.
const DIRECTIONS: usize = 500;
/// Samples that are looked from.
const SAMPLES: usize = 12;
/// Distance off the surface at which a ray begins, mm: the end that the visibility of a sample leaves out.
const OFF_SURFACE_MM: f64 = 3e-3;
/// Directions within this angle support each other, so that the middle of an opening beats its border: cos 20°.
const SUPPORT_COS: f64 = 0.939_692_620_785_908_4;
/// Directions that are returned at most.
const RETURNED: usize = 6;

/// Directions towards the outside: square to the spot, then the middles of openings, the widest first; none supports
/// another.
pub(super) fn directions_of(samples: &SpotSamples, rays: &RayScene, reach_mm: f64, level: SimdLevel) -> Vec<Unit<Vector3<f64>>> {
    let stride = samples.points().len().div_ceil(SAMPLES).max(1);
    let from: Vec<AskedPoint> = samples.points().iter().step_by(stride).copied().collect();
    let openness = |towards: &[Unit<Vector3<f64>>]| openness(&from, towards, rays, reach_mm, level);
    let lattice: Vec<_> = directions(DIRECTIONS).collect();
    let worth = openness(&lattice);
    let worth: Vec<(Unit<Vector3<f64>>, f64)> = lattice.into_iter().zip(worth).filter(|(_, worth)| *worth > 0.0).collect();
    let supported = |(towards, own): &(Unit<Vector3<f64>>, f64)| {
        let around = worth.iter().filter(|(other, _)| other.dot(towards) >= SUPPORT_COS).map(|(_, worth)| worth).sum::<f64>();
        (*towards, own + around)
    };
    let mut ranked: Vec<_> = worth.iter().map(supported).collect();
    sort_descending(&mut ranked, |ranked| ranked.1);
    // Square to the spot comes first where that is open: the lattice only comes near it.
    let mean = Unit::try_new(from.iter().map(|point| point.normal).sum::<Vector3<f64>>(), f64::EPSILON);
    let mut chosen: Vec<Unit<Vector3<f64>>> = mean.into_iter().filter(|towards| openness(&[*towards])[0] > 0.0).collect();
    for (towards, _) in ranked {
        if chosen.len() < RETURNED && chosen.iter().all(|other| other.dot(&towards) < SUPPORT_COS) {
            chosen.push(towards);
        }
    }
    chosen
}

/// Projected share of the points from which each direction is open, in points: an oblique view is worth less, as it is in projected area.
fn openness(from: &[AskedPoint], towards: &[Unit<Vector3<f64>>], rays: &RayScene, reach_mm: f64, level: SimdLevel) -> Vec<f64> {
    let mut openness = vec![0.0; towards.len()];
    let (mut ends, mut hidden) = (Vec::new(), Vec::new());
    for AskedPoint { mm, normal, .. } in from {
        let start = mm + normal * OFF_SURFACE_MM;
        let outside: Vec<usize> = (0..towards.len()).filter(|i| normal.dot(&towards[*i]) > 0.0).collect();
        ends.clear();
        ends.extend(outside.iter().map(|i| start + towards[*i].into_inner() * reach_mm));
        rays.blocked_from(level, &start, &ends, 1.0, &mut hidden);
        for (i, _) in outside.iter().zip(&hidden).filter(|(_, hidden)| !**hidden) {
            openness[*i] += normal.dot(&towards[*i]);
        }
    }
    openness
}
