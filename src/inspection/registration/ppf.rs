//! Poses of a part of unknown pose by votes of point pairs (B. Drost, M. Ulrich, N. Navab, S. Ilic, "Model globally, match locally:
//! efficient and robust 3D object recognition", CVPR 2010, sections 3.1 to 3.4): distance and angles of two oriented points are looked
//! up among those of the model, and each match votes for the model's point and the turn about the normal that would explain it.
//!
//! Tables are sorted lists, not hashes, so that the votes come in one order. Cost: model points² + scene points² / 5 look-ups.

use crate::geometry::parallel;
use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

/// Distances that the model's diameter is cut into; the paper samples at 0.05 of it.
const DISTANCE_STEPS: f64 = 20.0;
/// Steps of an angle of π, 12° each as in the paper.
const ANGLE_STEPS: f64 = 15.0;
/// Steps of the turn about the normal, over 2π.
const TURN_STEPS: usize = 30;
/// Every so many points of the scene is a reference point; 5 in the paper.
const REFERENCE_EVERY: usize = 5;
/// Poses nearer than this to a better one are the same: share of the diameter, and radians (the paper's 0.1 and a step and a half).
const SAME_POSE: (f64, f64) = (0.1, 0.3);

/// A point with the normal of its surface, outward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Oriented {
    pub(super) point_mm: Point3<f64>,
    pub(super) normal: Vector3<f64>,
}

/// Points of an even density: the mean of those in each cell of this size, with the normal that `normal` finds.
pub(super) fn thinned(points: &[Oriented], size_mm: f64) -> Vec<Oriented> {
    let mut cells: BTreeMap<[i64; 3], (Vector3<f64>, Vector3<f64>, f64)> = BTreeMap::new();
    for point in points {
        let cell = point.point_mm.coords.map(|value| (value / size_mm).floor() as i64);
        let sum = cells.entry(cell.into()).or_insert((Vector3::zeros(), Vector3::zeros(), 0.0));
        *sum = (sum.0 + point.point_mm.coords, sum.1 + point.normal, sum.2 + 1.0);
    }
    let mean = |(place, normal, count): &(Vector3<f64>, Vector3<f64>, f64)| {
        // Where normals cancel out there is an edge, which has none.
        (normal.norm() > 0.5 * count).then(|| Oriented { point_mm: Point3::from(place / *count), normal: normal.normalize() })
    };
    cells.values().filter_map(mean).collect()
}

/// Orients points by the plane through their neighbours within a radius, towards the place that they were seen from.
pub(super) fn oriented(points: &[(Point3<f64>, Point3<f64>)], radius_mm: f64) -> Vec<Oriented> {
    let cell_of = |point: &Point3<f64>| -> [i64; 3] { point.coords.map(|value| (value / radius_mm).floor() as i64).into() };
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    for (number, (point, _)) in points.iter().enumerate() {
        cells.entry(cell_of(point)).or_default().push(number as u32);
    }
    let orient = |(point, seen_from): &(Point3<f64>, Point3<f64>)| {
        let [x, y, z] = cell_of(point);
        let (mut sum, mut square, mut count) = (Vector3::zeros(), Matrix3::zeros(), 0.0);
        for place in 0..27 {
            let cell = [x + place % 3 - 1, y + place / 3 % 3 - 1, z + place / 9 - 1];
            for number in cells.get(&cell).into_iter().flatten() {
                let offset = points[*number as usize].0 - point;
                if offset.norm() <= radius_mm {
                    (sum, square, count) = (sum + offset, square + offset * offset.transpose(), count + 1.0);
                }
            }
        }
        if count < 6.0 {
            return None;
        }
        let eigen = (square / count - (sum / count) * (sum / count).transpose()).symmetric_eigen();
        let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let towards = if normal.dot(&(seen_from - point)) < 0.0 { -normal } else { normal };
        Some(Oriented { point_mm: *point, normal: towards })
    };
    parallel::map(points, orient).into_iter().flatten().collect()
}

/// A pair of the model: its first point, and the turn that brings the second into the half plane y = 0, z ≥ 0.
struct ModelPair {
    key: u32,
    point: u32,
    turn_rad: f64,
}

/// Best poses of the model in the scene, the one with most votes first.
pub(super) fn poses(model: &[Oriented], scene: &[Oriented], count: usize) -> Vec<Isometry3<f64>> {
    let Some(diameter) = diameter_of(model) else { return Vec::new() };
    let frames: Vec<Isometry3<f64>> = model.iter().map(to_axis).collect();
    let pairs_of = |first: usize| {
        let pair = |second: &Oriented| {
            let key = key_of(&model[first], second, diameter)?;
            Some(ModelPair { key, point: first as u32, turn_rad: turn_of(&frames[first], second) })
        };
        model.iter().filter_map(pair).collect::<Vec<_>>()
    };
    let mut table: Vec<ModelPair> = parallel::map_range(model.len(), pairs_of).into_iter().flatten().collect();
    table.sort_by_key(|pair| (pair.key, pair.point));
    let references: Vec<usize> = (0..scene.len()).step_by(REFERENCE_EVERY).collect();
    let vote = |reference: &usize| best_of(scene, *reference, &table, &frames, diameter);
    let mut found: Vec<(u32, Isometry3<f64>)> = parallel::map(&references, vote).into_iter().flatten().collect();
    found.sort_by_key(|found| std::cmp::Reverse(found.0));
    merged(&found, diameter, &model[0].point_mm, count)
}

/// Votes for one reference point: the best pose and the number of its votes.
fn best_of(
    scene: &[Oriented],
    reference: usize,
    table: &[ModelPair],
    frames: &[Isometry3<f64>],
    diameter: f64,
) -> Vec<(u32, Isometry3<f64>)> {
    let first = &scene[reference];
    let frame = to_axis(first);
    let mut votes = vec![0_u32; frames.len() * TURN_STEPS];
    for second in scene {
        let Some(key) = key_of(first, second, diameter) else { continue };
        let turn = turn_of(&frame, second);
        let begin = table.partition_point(|pair| pair.key < key);
        for pair in table[begin..].iter().take_while(|pair| pair.key == key) {
            let step = (pair.turn_rad - turn).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU * TURN_STEPS as f64;
            votes[pair.point as usize * TURN_STEPS + (step.round() as usize) % TURN_STEPS] += 1;
        }
    }
    let Some((place, most)) = votes.iter().enumerate().max_by_key(|(place, votes)| (**votes, usize::MAX - place)) else {
        return Vec::new();
    };
    let turn = (place % TURN_STEPS) as f64 / TURN_STEPS as f64 * std::f64::consts::TAU;
    // Both frames have the reference point at the origin; the model's is turned onto the scene's.
    let about_x = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), turn);
    let turned = Isometry3::from_parts(Translation3::identity(), about_x);
    if *most == 0 { Vec::new() } else { vec![(*most, frame.inverse() * turned * frames[place / TURN_STEPS])] }
}

/// Poses of which none is near a better one; the votes of near ones count together.
fn merged(found: &[(u32, Isometry3<f64>)], diameter: f64, anchor: &Point3<f64>, count: usize) -> Vec<Isometry3<f64>> {
    let mut clusters: Vec<(u64, Isometry3<f64>)> = Vec::new();
    for (votes, pose) in found {
        let is_same = |(_, other): &&mut (u64, Isometry3<f64>)| {
            (pose * anchor - other * anchor).norm() < SAME_POSE.0 * diameter
                && pose.rotation.angle_to(&other.rotation) < SAME_POSE.1
        };
        match clusters.iter_mut().find(is_same) {
            Some(cluster) => cluster.0 += u64::from(*votes),
            None => clusters.push((u64::from(*votes), *pose)),
        }
    }
    clusters.sort_by_key(|cluster| std::cmp::Reverse(cluster.0));
    clusters.into_iter().take(count).map(|(_, pose)| pose).collect()
}

fn diameter_of(points: &[Oriented]) -> Option<f64> {
    let around = crate::geometry::Aabb::around(points.iter().map(|point| &point.point_mm));
    (points.len() > 2).then(|| around.extent_mm().norm()).filter(|diameter| *diameter > 0.0)
}

/// Takes the point to the origin and its normal to +x.
fn to_axis(at: &Oriented) -> Isometry3<f64> {
    let turn = UnitQuaternion::rotation_between(&at.normal, &Vector3::x())
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI));
    Isometry3::from_parts(Translation3::from(-(turn * at.point_mm.coords)), turn)
}

/// Turn about +x that takes the second point into the half plane y = 0, z ≥ 0, negated: its angle about x from +z.
fn turn_of(frame: &Isometry3<f64>, second: &Oriented) -> f64 {
    let at = frame * second.point_mm;
    at.y.atan2(at.z)
}

/// Distance and angles of a pair in steps; `None` for a point with itself and beyond the model's diameter.
fn key_of(first: &Oriented, second: &Oriented, diameter: f64) -> Option<u32> {
    let between = second.point_mm - first.point_mm;
    let length = between.norm();
    let distance = length / diameter * DISTANCE_STEPS;
    if !(0.5..=DISTANCE_STEPS).contains(&distance) {
        return None;
    }
    let angle =
        |a: &Vector3<f64>, b: &Vector3<f64>| (a.dot(b).clamp(-1.0, 1.0).acos() / std::f64::consts::PI * ANGLE_STEPS) as u32;
    let along = between / length;
    let angles = [angle(&first.normal, &along), angle(&second.normal, &along), angle(&first.normal, &second.normal)];
    Some(angles.iter().fold(distance as u32, |key, angle| key * 16 + angle))
}
