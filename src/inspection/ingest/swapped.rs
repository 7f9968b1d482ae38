//! Scans that were filed under the number of another view, and copies of one scan under two numbers.
//!
//! A cloud in the scanner's frame says by its shape which view it is of: at the pose of its own view it lies on the part after a
//! small correction, at that of another one only where the part looks the same from there. A cloud in a frame of the part lies on
//! it under every number. Then sight tells: all devices of the view that took it see its points, and most of the surface that
//! they see well has points. Both shares are asked for: a view that sees all of what another one measured lacks points on the
//! rest, as of a partial scan, and is doubted only where the other view explains points and gaps alike.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::OnceLock;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::frames::{self, NEAR_PART_MM, sampled};
use super::{FrameAttempt, IngestWorld, MIN_SHARE, PlannedCapture, ScanFrame, TakenScan};
use crate::geometry::cloud_io::StoredCloud;
use crate::geometry::{Hit, Part, Pose, RayScene, SimdLevel};
use crate::inspection::PixelGrid;
use crate::inspection::registration::locate::{RefinedAlone, refined_alone};

/// Points below which a cloud tells nothing of its view.
const MIN_POINTS: usize = 100;
/// Points of a cloud that are held against what views see.
const SEEN_POINTS: usize = 4000;
/// Points of a cloud that enter its fingerprint.
const PRINTED_POINTS: usize = 100_000;
/// Rays of the left camera in a row of its image that find what a view sees.
const RAYS_OF_ROW: f64 = 96.0;
/// Size of a cell of the surface in diameters of the part: finer than views differ, coarser than the points are apart.
const CELL_DIAMETERS: f64 = 0.03;
/// Least cosine of the incidence at which a point may have been measured at all, and one at which every scanner measures (50°).
const ANY_COS: f64 = 0.02;
const SURE_COS: f64 = 0.643;
/// Distance from the surface, along its normal, at which sight of a point is asked for, mm: its own face must not hide it.
const LIFT_MM: f64 = 0.5;
/// Least shares of points and of surface at which a view is not doubted, and at which another one is taken for the one that took
/// the scan. Not from a source: scans of four parts had 0.99 of both, and those of other views up to 0.9; halves of scans had up
/// to 0.96 of another view's.
const OWN_SHARE: f64 = 0.9;
const OTHER_SHARE: f64 = 0.97;

/// Frames in which the points lie on the part whatever view they are said to be of.
const FRAMES_OF_PART: [ScanFrame; 4] = [ScanFrame::Base, ScanFrame::Table, ScanFrame::Plate, ScanFrame::Part];

/// Fingerprint of the points of a cloud; none of a few points. Noise makes those of two captures differ.
pub(super) fn fingerprint(cloud: &StoredCloud) -> Option<u64> {
    let there = || cloud.points.iter().filter(|point| !point[0].is_nan());
    let count = there().count();
    let mut hasher = DefaultHasher::new();
    count.hash(&mut hasher);
    for point in there().step_by(count.div_ceil(PRINTED_POINTS).max(1)) {
        point.map(f32::to_bits).hash(&mut hasher);
    }
    (count >= MIN_POINTS).then(|| hasher.finish())
}

/// Fit of a scan in the scanner's frame to its own view, by itself; none where the scan does not tell its view so.
pub(super) fn alone(taken: &TakenScan, mesh_from_stated: &Pose<Part, Part>, world: &IngestWorld<'_>) -> Option<RefinedAlone> {
    let tells = !taken.is_approximate && !FRAMES_OF_PART.contains(&taken.frame);
    let is_enough = || taken.scan.scanner_cloud.finite().count() >= MIN_POINTS;
    (tells && is_enough()).then(|| refined_alone(&taken.scan, world.nearest, mesh_from_stated))
}

/// The other view at whose pose a scan in the scanner's frame lies on the part.
pub(super) fn other_view(taken: &TakenScan, mesh_from_stated: &Pose<Part, Part>, world: &IngestWorld<'_>) -> Option<u32> {
    let scan = &taken.scan;
    let fit = |other: &PlannedCapture| {
        let mesh_from_scanner = *mesh_from_stated * other.part_from_scanner;
        if frames::share_on_part(&scan.scanner_cloud, &mesh_from_scanner, world) < MIN_SHARE {
            return None;
        }
        let found = refined_alone(scan, world.nearest, &(mesh_from_scanner * scan.part_from_scanner.inverse()));
        found.is_sure().then_some((found.inlier_share, other.viewpoint))
    };
    let others: Vec<&PlannedCapture> = world.captures.iter().filter(|other| other.viewpoint != scan.viewpoint).collect();
    let found: Vec<Option<(f64, u32)>> = others.par_iter().map(|other| fit(other)).collect();
    best(found.into_iter().flatten())
}

/// The view of the largest share; of equal ones the first.
fn best(found: impl Iterator<Item = (f64, u32)>) -> Option<u32> {
    let better = |best: Option<(f64, u32)>, next: (f64, u32)| best.filter(|best| best.0 >= next.0).or(Some(next));
    found.fold(None, better).map(|(_, viewpoint)| viewpoint)
}

/// A place on the part, with the normal of its face.
type OnFace = (Point3<f64>, Vector3<f64>);

/// Cell of the surface: its place in cells, and the side that the surface looks to.
type SightCell = ([i64; 3], usize);

/// Points and surface that a cloud and a view have in common.
#[derive(Clone, Copy)]
struct SeenShares {
    /// Share of the points on the part that all devices of the view see.
    of_points: f64,
    /// Share of the surface that they see well that has points.
    of_surface: f64,
}

impl SeenShares {
    fn least(&self) -> f64 {
        self.of_points.min(self.of_surface)
    }
}

/// Sight of the part from views, at its planned place.
pub(super) struct ViewSight<'a> {
    /// World that the clouds are held against.
    pub(super) world: &'a IngestWorld<'a>,
    /// Triangles of the part: only clouds in its frames need them.
    scene: OnceLock<RayScene>,
    /// Places that each view sees well.
    expected: BTreeMap<u32, OnceLock<Vec<OnFace>>>,
    cell_mm: f64,
}

impl<'a> ViewSight<'a> {
    pub(super) fn new(world: &'a IngestWorld<'a>) -> Self {
        let diameter_mm = world.nearest.mesh().aabb().extent_mm().norm();
        let expected = world.captures.iter().map(|capture| (capture.viewpoint, OnceLock::new())).collect();
        Self { world, scene: OnceLock::new(), expected, cell_mm: (CELL_DIAMETERS * diameter_mm).max(f64::MIN_POSITIVE) }
    }

    fn scene(&self) -> &RayScene {
        self.scene.get_or_init(|| RayScene::new([self.world.nearest.mesh()]))
    }

    /// The other view that a cloud in a frame of the part was taken from, where its own one cannot have taken it.
    pub(super) fn other_view(&self, cloud: &StoredCloud, fit: &FrameAttempt, capture: &PlannedCapture) -> Option<u32> {
        if !FRAMES_OF_PART.contains(&fit.frame) {
            return None;
        }
        let mut points = sampled(cloud, SEEN_POINTS);
        points.iter_mut().for_each(|point| *point = Point3::from(point.coords * fit.unit.mm()));
        let shares = |capture: &PlannedCapture, least: f64| self.shares(&points, fit.frame, capture, least);
        if shares(capture, 0.0)?.least() >= OWN_SHARE {
            return None;
        }
        let of_other = |other: &PlannedCapture| {
            let least = shares(other, OTHER_SHARE)?.least();
            (least >= OTHER_SHARE).then_some((least, other.viewpoint))
        };
        best(self.world.captures.iter().filter(|other| other.viewpoint != capture.viewpoint).filter_map(of_other))
    }

    /// Shares of points in a frame, in millimetres, and of a view; none where few of them lie near the part, or the view sees a
    /// smaller share of them than `least`.
    fn shares(&self, points: &[Point3<f64>], frame: ScanFrame, capture: &PlannedCapture, least: f64) -> Option<SeenShares> {
        let part_from_frame = capture.part_from_scanner.isometry() * capture.scanner_from(frame)?;
        let (nearest, mesh) = (self.world.nearest, self.world.nearest.mesh());
        let is_near = |point: &Point3<f64>| nearest.nearest(point, NEAR_PART_MM).is_some();
        let near: Vec<Point3<f64>> = points.iter().map(|point| part_from_frame * point).filter(is_near).collect();
        // The nearest face of a thin part that is a little off may be that of its other side: the one that the ray meets counts.
        let eye = (capture.part_from_scanner * self.world.scanner.devices.left.scanner_from_device).origin_mm();
        let rays: Vec<Vector3<f64>> = near.iter().map(|point| point - eye).collect();
        let mut hits: Vec<Option<Hit>> = Vec::new();
        self.scene().first_hits_from(SimdLevel::widest(), &eye, &rays, &mut hits);
        let on_face = |(hit, ray): (&Option<Hit>, &Vector3<f64>)| -> Option<OnFace> {
            let hit = hit.as_ref().filter(|hit| (hit.share - 1.0).abs() * ray.norm() <= NEAR_PART_MM)?;
            Some((eye + ray * hit.share, mesh.scaled_normal(hit.triangle as usize).try_normalize(0.0)?))
        };
        let on_part: Vec<OnFace> = hits.iter().zip(&rays).filter_map(on_face).collect();
        let share = |part: usize, all: usize| part as f64 / all.max(1) as f64;
        let seen = self.is_seen(&on_part, capture, ANY_COS).into_iter().filter(|is_seen| *is_seen).count();
        let of_points = share(seen, near.len());
        if near.len() < MIN_POINTS || of_points < least {
            return None;
        }
        let expected = self.expected(capture);
        let cells: BTreeSet<SightCell> = on_part.iter().map(|place| self.cell(place)).collect();
        let covered = expected.iter().filter(|place| self.is_near_one_of(&cells, place)).count();
        Some(SeenShares { of_points, of_surface: share(covered, expected.len()) })
    }

    fn expected(&self, capture: &PlannedCapture) -> &[OnFace] {
        let places = self.expected.get(&capture.viewpoint);
        places.map(|places| places.get_or_init(|| self.seen_well(capture)).as_slice()).unwrap_or_default()
    }

    /// Places that a view sees well, by rays of its left camera.
    fn seen_well(&self, capture: &PlannedCapture) -> Vec<OnFace> {
        let (scanner, mesh) = (self.world.scanner, self.world.nearest.mesh());
        let grid = PixelGrid::new(scanner, (scanner.devices.left.lens.width_px / RAYS_OF_ROW) as u32);
        let eye = capture.part_from_scanner.point(&grid.centre_mm());
        let directions: Vec<Vector3<f64>> =
            (0..grid.cells()).map(|cell| capture.part_from_scanner.direction(&grid.ray(cell))).collect();
        let mut hits = Vec::new();
        self.scene().first_hits_from(SimdLevel::widest(), &eye, &directions, &mut hits);
        let scanner_from_part = capture.part_from_scanner.inverse();
        let mut places: Vec<OnFace> = Vec::new();
        for (hit, direction) in hits.iter().zip(&directions) {
            let Some(hit) = hit else { continue };
            let Some(normal) = mesh.scaled_normal(hit.triangle as usize).try_normalize(0.0) else { continue };
            let point = eye + direction * hit.share;
            if (scanner.near_mm..=scanner.far_mm).contains(&scanner_from_part.point(&point).z) {
                places.push((point, normal));
            }
        }
        let seen = self.is_seen(&places, capture, SURE_COS);
        places.into_iter().zip(seen).filter(|(_, is_seen)| *is_seen).map(|(place, _)| place).collect()
    }

    /// Tells of each place if all devices of a view see it, at no larger an incidence than this cosine's.
    fn is_seen(&self, places: &[OnFace], capture: &PlannedCapture, min_cos: f64) -> Vec<bool> {
        let scanner_from_part = capture.part_from_scanner.inverse();
        let lifted: Vec<Point3<f64>> = places.iter().map(|(point, normal)| point + normal * LIFT_MM).collect();
        let (mut seen, mut blocked) = (vec![true; places.len()], Vec::new());
        let devices = &self.world.scanner.devices;
        for device in [&devices.left, &devices.right, &devices.projector] {
            let eye = (capture.part_from_scanner * device.scanner_from_device).origin_mm();
            let device_from_scanner = device.scanner_from_device.inverse();
            self.scene().blocked_from(SimdLevel::widest(), &eye, &lifted, 1.0, &mut blocked);
            for (number, (point, normal)) in places.iter().enumerate() {
                let in_device = device_from_scanner.point(&scanner_from_part.point(point));
                let cos = normal.dot(&(eye - point).normalize());
                seen[number] &= cos >= min_cos && !blocked[number] && device.lens.project(&in_device).is_some();
            }
        }
        seen
    }

    fn cell(&self, (point, normal): &OnFace) -> SightCell {
        let axis = normal.iamax();
        let place = point.coords.map(|value| (value / self.cell_mm).floor() as i64).into();
        (place, if normal[axis] < 0.0 { axis + 3 } else { axis })
    }

    /// Returns true if the cell of a place or one around it is one of these.
    fn is_near_one_of(&self, cells: &BTreeSet<SightCell>, place: &OnFace) -> bool {
        let ([x, y, z], side) = self.cell(place);
        let is_one = |number: i64| {
            let at = [x + number % 3 - 1, y + number / 3 % 3 - 1, z + number / 9 - 1];
            cells.contains(&(at, side))
        };
        (0..27).any(is_one)
    }
}
