//! Comparison of poses of a part by all points. Squared distances are capped at κσ, so that a point counts as on the surface or off it,
//! and averaged over cells of the part, which count as one observation each since deviations of neighbours are alike. With mᵢ the
//! difference of two poses in cell i, they are told apart where Σmᵢ / √Σmᵢ² exceeds a quantile of the normal distribution (Q. H. Vuong,
//! "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica 57(2), 1989, section 5), and Σmᵢ some cells.
//! Poses in which the part looks the same are told by its mesh alone ([`looks_same`]).

use std::borrow::Borrow;
use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::locate::samples;
use super::points::ViewPoints;
use super::robust_sd_mm;
use crate::geometry::{Mesh, NearestFace, NearestPoint, parallel};
use crate::inspection::ViewScan;

/// Points off the surface, and as many on it, with which turns that pass are scored.
const SWEPT_POINTS: usize = 200;
/// Points with which refined poses are compared.
const COMPARED_POINTS: usize = 9000;
/// Size of a cell that counts as one observation, mm and diameters, the smaller of both. Not from a source: features are not much smaller.
pub(super) const CELL_MM: f64 = 2.5;
const CELL_DIAMETERS: f64 = 0.04;
/// Distance from which on a point counts as off the surface, in standard deviations: κ.
pub(super) const OFF_SDS: f64 = 4.0;
/// Minimum standard deviation of points that is believed, mm: facets and poses of views that are off add to their noise.
const MIN_SD_MM: f64 = 0.03;
/// Farthest distance that enters it, mm.
const SD_REACH_MM: f64 = 2.0;
/// Minimum distance of vertices from the turned mesh by which they are held for different, mm: facets of round surfaces differ by
/// as much.
pub(super) const SAME_MM: f64 = 0.2;
/// Vertices and faces by which a mesh is held against itself, so many of each at most, and samples beside them.
const MAX_VERTICES: usize = 20_000;
const OUTLINE_SAMPLES: usize = 4000;

/// Evidence that tells two poses apart: cells, and standard deviations of the normal distribution.
#[derive(Clone, Copy)]
pub(super) struct Level {
    cells: f64,
    deviations: f64,
}

/// Level of a pose that is taken: three cells, more than a speck covers (not from a source), and a probability of 1 % one-sided.
pub(super) const SURE: Level = Level { cells: 3.0, deviations: 2.326 };
/// Level from which on the stated pose is doubted: two cells, and 10 % one-sided for the best of at most eight rivals: an eighth of it for
/// each (Bonferroni's inequality).
pub(super) const DOUBT: Level = Level { cells: 2.0, deviations: 2.241 };

/// Difference of a cell's costs up to which a turn back to the stated one is not held against it: facets of round surfaces differ by less,
/// in all cells alike. Not from a source.
const SLIGHT: f64 = 0.1;

/// Costs of a pose where they differ from those of another one by more than a little, elsewhere those.
pub(super) fn felt(costs: Vec<f64>, own: &[f64]) -> Vec<f64> {
    costs.into_iter().zip(own).map(|(cost, own)| if (cost - own).abs() < SLIGHT { *own } else { cost }).collect()
}

/// Costs of a rival where it counts against the stated pose, elsewhere the stated pose's own if they are higher. It counts in cells that
/// most further turns explain no better than the stated pose: points on the rival's feature. What they explain as the rival does is
/// surface without a feature, which tells no more than that the stated one is missing. Without further turns it counts nowhere.
pub(super) fn on_feature(stated: &[f64], rival: &[f64], further: &[Vec<f64>]) -> Vec<f64> {
    let cost = |cell: usize| {
        let between = 0.5 * (stated[cell] + rival[cell]);
        let without = further.iter().filter(|costs| costs[cell] > between).count();
        if 2 * without > further.len() { rival[cell] } else { rival[cell].max(stated[cell]) }
    };
    (0..stated.len()).map(cost).collect()
}

/// Returns true if costs of cells tell that a pose is worse than another one.
pub(super) fn is_told_apart(worse: &[f64], better: &[f64], level: Level) -> bool {
    let differences = || worse.iter().zip(better).map(|(worse, better)| worse - better);
    let (sum, squares) = (differences().sum::<f64>(), differences().map(|one| one * one).sum::<f64>());
    sum >= level.cells && sum >= level.deviations * squares.sqrt()
}

/// Points by which a mesh is held against itself: vertices, of which each feature has some; middles of faces, since all vertices of a hole
/// lie on the faces that it goes through; and samples, since in a sheet those middles do so too.
pub(super) fn outline_mm(mesh: &Mesh) -> Vec<Point3<f64>> {
    let [every_vertex, every_face] = [mesh.vertices_mm.len(), mesh.faces.len()].map(|count| count.div_ceil(MAX_VERTICES).max(1));
    let middle = |face: usize| {
        let [a, b, c] = mesh.corners(face);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    };
    let mut outline_mm: Vec<Point3<f64>> = mesh.vertices_mm.iter().step_by(every_vertex).copied().collect();
    outline_mm.extend((0..mesh.faces.len()).step_by(every_face).map(middle));
    outline_mm.extend(samples(mesh, OUTLINE_SAMPLES).iter().map(|sample| sample.point_mm));
    outline_mm
}

/// Returns true if a motion takes the outline of the part onto its surface.
pub(super) fn looks_same(motion: &Isometry3<f64>, nearest: &NearestFace<'_>, outline_mm: &[Point3<f64>], within_mm: f64) -> bool {
    outline_mm.par_iter().all(|point| nearest.nearest(&(motion * point), within_mm).is_some())
}

/// Distances of points from the surface that looks to their scanner, in the order of views and points, each at most `max_mm`.
pub(super) fn distances_mm(views: &[ViewPoints], pose: &Isometry3<f64>, nearest: &NearestFace<'_>, max_mm: f64) -> Vec<f64> {
    let of_view = |view: &ViewPoints| {
        let mesh_from_scanner = pose * view.part_from_scanner;
        let eye = Point3::from(mesh_from_scanner.translation.vector);
        let distance_mm = |point: &Point3<f64>| {
            let at = mesh_from_scanner * point;
            let looks_back = |found: &NearestPoint| nearest.mesh().scaled_normal(found.face as usize).dot(&(eye - at)) > 0.0;
            nearest.nearest(&at, max_mm).filter(looks_back).map_or(max_mm, |found| (at - found.point_mm).norm())
        };
        parallel::map(&view.points_mm, distance_mm)
    };
    views.iter().flat_map(of_view).collect()
}

/// Points of scans that are compared.
pub(super) fn compared_views<S: Borrow<ViewScan>>(scans: &[S]) -> Vec<ViewPoints> {
    let of_view = (COMPARED_POINTS / scans.len().max(1)).max(50);
    scans.iter().map(|scan| ViewPoints::of(scan.borrow(), of_view)).collect()
}

/// Size of a cell of a part of this diameter.
pub(super) fn cell_mm(diameter_mm: f64) -> f64 {
    CELL_MM.min(CELL_DIAMETERS * diameter_mm).max(f64::MIN_POSITIVE)
}

/// Points that tell poses apart, with the cells of the part that they lie in.
pub(super) struct ComparedPoints {
    views: Vec<ViewPoints>,
    /// Cell of each point, in the order of views and points.
    cells: Vec<usize>,
    /// Points in each cell.
    counts: Vec<f64>,
}

impl ComparedPoints {
    /// Points in cells of the size that suits a part of this diameter.
    pub(super) fn of_part<S: Borrow<ViewScan>>(scans: &[S], diameter_mm: f64) -> Self {
        Self::new(scans, cell_mm(diameter_mm))
    }

    pub(super) fn new<S: Borrow<ViewScan>>(scans: &[S], size_mm: f64) -> Self {
        Self::of_views(compared_views(scans), size_mm)
    }

    pub(super) fn of_views(views: Vec<ViewPoints>, size_mm: f64) -> Self {
        let mut numbers: BTreeMap<[i64; 3], usize> = BTreeMap::new();
        let (mut cells, mut counts) = (Vec::new(), Vec::<f64>::new());
        for view in &views {
            for point in &view.points_mm {
                let at = view.part_from_scanner * point;
                let place: [i64; 3] = at.coords.map(|value| (value / size_mm).floor() as i64).into();
                let cell = *numbers.entry(place).or_insert(counts.len());
                if cell == counts.len() {
                    counts.push(0.0);
                }
                counts[cell] += 1.0;
                cells.push(cell);
            }
        }
        Self { views, cells, counts }
    }

    /// Robust standard deviation of the points' distances from the part.
    pub(super) fn sd_mm(&self, pose: &Isometry3<f64>, nearest: &NearestFace<'_>) -> f64 {
        robust_sd_mm(distances_mm(&self.views, pose, nearest, SD_REACH_MM)).max(MIN_SD_MM)
    }

    /// Mean square of the distances in each cell, each capped at `limit_mm` and in shares of it: 0 to 1.
    pub(super) fn costs(&self, pose: &Isometry3<f64>, nearest: &NearestFace<'_>, limit_mm: f64) -> Vec<f64> {
        let mut costs = vec![0.0; self.counts.len()];
        for (cell, distance_mm) in self.cells.iter().zip(distances_mm(&self.views, pose, nearest, limit_mm)) {
            costs[*cell] += (distance_mm / limit_mm).powi(2) / self.counts[*cell];
        }
        costs
    }

    /// Some of the points that lie off the part, and as many on it: what breaks a symmetry is in the former.
    pub(super) fn off_and_on(&self, pose: &Isometry3<f64>, nearest: &NearestFace<'_>, limit_mm: f64) -> Vec<ViewPoints> {
        let is_off: Vec<bool> =
            distances_mm(&self.views, pose, nearest, limit_mm).into_iter().map(|distance_mm| distance_mm >= limit_mm).collect();
        let off = is_off.iter().filter(|is_off| **is_off).count();
        let [every_off, every_on] = [off, is_off.len() - off].map(|count| count.div_ceil(SWEPT_POINTS).max(1));
        let (mut flags, mut seen) = (is_off.into_iter(), [0_usize; 2]);
        let some_of = |view: &ViewPoints| {
            let mut points_mm = Vec::new();
            for (point, is_off) in view.points_mm.iter().zip(flags.by_ref()) {
                let (number, every) = if is_off { (&mut seen[0], every_off) } else { (&mut seen[1], every_on) };
                if number.is_multiple_of(every) {
                    points_mm.push(*point);
                }
                *number += 1;
            }
            ViewPoints { part_from_scanner: view.part_from_scanner, points_mm, elements: Vec::new(), there: view.there }
        };
        self.views.iter().map(some_of).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn poses_are_told_apart_by_many_cells_and_not_by_a_speck_or_by_chance() {
        let told = |worse: &[f64], better: &[f64]| is_told_apart(worse, better, SURE);
        assert!(told(&[1.0; 9], &[0.1; 9]), "a feature");
        assert!(!told(&[1.0; 2], &[0.0; 2]), "a speck");
        assert!(!told(&[0.11; 20], &[0.1; 20]), "alike in all of them, and next to nothing");
        let (one, other) = ([[1.0, 0.0]; 30].concat(), [[0.0, 0.9]; 30].concat());
        assert!(!told(&one, &other), "some for the one, as many for the other");
        assert!(!told(&[], &[]));
    }

    #[test]
    fn a_rival_counts_where_most_further_turns_do_not_explain_the_points_either() {
        let (stated, rival) = ([1.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]);
        let further = [vec![1.0, 0.0, 0.0, 1.0], vec![1.0, 0.0, 0.0, 0.0], vec![0.0, 1.0, 0.0, 1.0]];
        let sums =
            |further: &[Vec<f64>]| on_feature(&stated, &rival, further).iter().map(|cost| *cost as i32).collect::<Vec<_>>();
        assert_eq!(sums(&further), [0, 1, 1, 0], "a feature, surface without one, a feature that the rival lacks, a feature");
        assert_eq!(sums(&[]), [1, 1, 1, 1], "nobody can be asked");
    }

    /// A square plate with a square hole, whose middle is moved along x.
    fn plate_with_hole(thickness_mm: f64, hole_x_mm: f64) -> Mesh {
        let ring = |x_mm: f64, half_mm: f64, z_mm: f64| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|[x, y]: [f64; 2]| Point3::new(x_mm + half_mm * x, half_mm * y, z_mm))
        };
        let (outer, hole) = ([0.0, 30.0], [hole_x_mm, 5.0]);
        let vertices_mm: Vec<Point3<f64>> = [outer, hole]
            .iter()
            .flat_map(|[x_mm, half_mm]| [0.0, thickness_mm].map(|z_mm| ring(*x_mm, *half_mm, z_mm)))
            .flatten()
            .collect();
        let side = |i: u32| {
            let n = (i + 1) % 4;
            let above = [[4 + i, 4 + n, 12 + n], [4 + i, 12 + n, 12 + i]];
            let below = [[n, i, 8 + i], [n, 8 + i, 8 + n]];
            let around = [[i, n, 4 + n], [i, 4 + n, 4 + i]];
            let within = [[8 + n, 8 + i, 12 + i], [8 + n, 12 + i, 12 + n]];
            [above, below, around, within].concat()
        };
        let faces: Vec<[u32; 3]> = (0..4).flat_map(side).collect();
        Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
    }

    /// After half a turn all vertices of such a plate lie on it, wherever the hole is.
    #[test]
    fn a_plate_looks_the_same_after_half_a_turn_only_with_the_hole_in_its_middle() {
        let half_turn = Isometry3::rotation(Vector3::z() * std::f64::consts::PI);
        for (thickness_mm, hole_x_mm, is_same) in [(10.0, 0.0, true), (10.0, 15.0, false), (0.3, 0.0, true), (0.3, 15.0, false)] {
            let mesh = plate_with_hole(thickness_mm, hole_x_mm);
            let nearest = NearestFace::new(&mesh);
            let found = looks_same(&half_turn, &nearest, &outline_mm(&mesh), SAME_MM);
            assert_eq!(found, is_same, "{thickness_mm} mm thick, hole at {hole_x_mm} mm");
        }
    }
}
