//! Finds unit and frame of a cloud: those in which most of its points lie in all three frusta of its view and near the part.

use std::str::FromStr;

use nalgebra::{Isometry3, Point3};

use super::{IngestWorld, MIN_SHARE};
use crate::cell::closed_list;
use crate::geometry::cloud_io::StoredCloud;
use crate::geometry::{Aabb, Base, Cloud, LengthUnit, NearestFace, Part, Plate, PointCloud, Pose, ScannerFrame, Table};

/// Points that are tried.
const TRIED_POINTS: usize = 1500;
/// Distance within which a point lies near the part, mm.
const NEAR_PART_MM: f64 = 5.0;
/// Depth beyond the working depth that points may have, mm.
pub(super) const DEPTH_MARGIN_MM: f64 = 20.0;
/// Distance from the plate within which a point is the plate's rather than nobody's, mm.
const NEAR_PLATE_MM: f64 = 2.0;
/// Share of a size at which a cloud fits below which it is a speck.
const SPECK: f64 = 0.2;
/// Factor by which points may lie denser than the pixels of the views that they are from.
const MAX_DENSITY: f64 = 2.0;
/// Units that are tried, likely ones first; another one only where it is declared.
const UNITS: [LengthUnit; 3] = [LengthUnit::Millimetre, LengthUnit::Metre, LengthUnit::Inch];

closed_list! {
    /// Frame that the coordinates of a cloud may be in.
    pub enum ScanFrame {
        /// The vendor's, as the scanner's specification names it.
        Cloud = "cloud",
        /// The scanner's: middle of the baseline.
        Scanner = "scanner",
        /// The robot's base.
        Base = "base",
        /// The turntable, which does not turn.
        Table = "table",
        /// The plate that turns with the table.
        Plate = "plate",
        /// The part, as planned.
        Part = "part",
    }
}

impl FromStr for ScanFrame {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|frame| frame.as_str() == text);
        found.ok_or_else(|| format!("unknown frame {text:?}; use one of {}", Self::ALL.map(Self::as_str).join(", ")))
    }
}

/// A capture of the plan, or of a run, with the poses that tie frames to it. Poses that are not known leave their frame out.
#[derive(Clone, Copy, Debug)]
pub struct PlannedCapture {
    /// Number of its viewpoint.
    pub viewpoint: u32,
    /// Pose of the scanner.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Frame of the vendor's clouds.
    pub scanner_from_cloud: Option<Pose<ScannerFrame, Cloud>>,
    /// Pose of the plate.
    pub part_from_plate: Option<Pose<Part, Plate>>,
    /// Pose of the table, at the angle of this capture.
    pub part_from_table: Option<Pose<Part, Table>>,
    /// Pose of the robot's base, at the angle of this capture.
    pub part_from_base: Option<Pose<Part, Base>>,
}

impl PlannedCapture {
    /// A capture of which the scanner's pose alone is known.
    #[must_use]
    pub fn at(viewpoint: u32, part_from_scanner: Pose<Part, ScannerFrame>) -> Self {
        Self {
            viewpoint,
            part_from_scanner,
            scanner_from_cloud: None,
            part_from_plate: None,
            part_from_table: None,
            part_from_base: None,
        }
    }

    /// Takes coordinates in a frame to the scanner's.
    #[must_use]
    pub fn scanner_from(&self, frame: ScanFrame) -> Option<Isometry3<f64>> {
        let scanner_from_part = self.part_from_scanner.inverse();
        match frame {
            ScanFrame::Cloud => self.scanner_from_cloud.map(|pose| *pose.isometry()),
            ScanFrame::Scanner => Some(Isometry3::identity()),
            ScanFrame::Base => self.part_from_base.map(|pose| *(scanner_from_part * pose).isometry()),
            ScanFrame::Table => self.part_from_table.map(|pose| *(scanner_from_part * pose).isometry()),
            ScanFrame::Plate => self.part_from_plate.map(|pose| *(scanner_from_part * pose).isometry()),
            ScanFrame::Part => Some(*scanner_from_part.isometry()),
        }
    }
}

/// A unit and a frame that were tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameAttempt {
    /// The unit.
    pub unit: LengthUnit,
    /// The frame.
    pub frame: ScanFrame,
    /// Share of the points that lie in all three frusta and near the working depth; of a merged cloud all do.
    pub in_frusta: f64,
    /// Share of the points that lie there and within 5 mm of the part; points on the plate aside, unless there are few others. It is 0 in a
    /// unit in which the points lie denser than pixels.
    pub on_part: f64,
}

/// The attempt with the largest share on the part; of equal ones the first.
pub(super) fn best_of<'a>(tried: impl Iterator<Item = &'a FrameAttempt>) -> Option<FrameAttempt> {
    tried.fold(None, |best: Option<FrameAttempt>, attempt| best.filter(|best| best.on_part >= attempt.on_part).or(Some(*attempt)))
}

/// Tries every unit, a declared one too, and every frame of a view.
pub(super) fn try_all(
    cloud: &StoredCloud,
    declared: Option<LengthUnit>,
    capture: &PlannedCapture,
    world: &IngestWorld<'_>,
) -> Vec<FrameAttempt> {
    tried(cloud, declared, capture, world, &ScanFrame::ALL, false)
}

/// Tries every unit, a declared one too, and the frames that several views may share.
pub(super) fn try_merged(
    cloud: &StoredCloud,
    declared: Option<LengthUnit>,
    first: &PlannedCapture,
    world: &IngestWorld<'_>,
) -> Vec<FrameAttempt> {
    tried(cloud, declared, first, world, &[ScanFrame::Part, ScanFrame::Plate, ScanFrame::Table, ScanFrame::Base], true)
}

fn tried(
    cloud: &StoredCloud,
    declared: Option<LengthUnit>,
    capture: &PlannedCapture,
    world: &IngestWorld<'_>,
    frames: &[ScanFrame],
    is_merged: bool,
) -> Vec<FrameAttempt> {
    let there = cloud.points.iter().filter(|point| !point[0].is_nan()).count();
    let points = sampled(cloud, TRIED_POINTS);
    let mut attempts = Vec::new();
    let views = if is_merged { world.captures.len().max(1) } else { 1 };
    for unit in UNITS.into_iter().chain(declared.filter(|unit| !UNITS.contains(unit))) {
        let is_possible = !is_too_dense(there, &points, unit, views, world);
        for &frame in frames {
            let Some(scanner_from_frame) = capture.scanner_from(frame) else { continue };
            let in_scanner = points.iter().map(|point| scanner_from_frame * Point3::from(point.coords * unit.mm()));
            let (in_frusta, on_part) = shares(in_scanner, capture, world, is_merged);
            attempts.push(FrameAttempt { unit, frame, in_frusta, on_part: if is_possible { on_part } else { 0.0 } });
        }
    }
    without_specks(attempts)
}

/// Some of a cloud's points, spread evenly over it, no more than so many.
fn sampled(cloud: &StoredCloud, max_points: usize) -> Vec<Point3<f64>> {
    let there = || cloud.points.iter().filter(|point| !point[0].is_nan());
    let every = there().count().div_ceil(max_points).max(1);
    there().step_by(every).map(|point| Point3::from(point.map(f64::from))).collect()
}

/// Attempts without the shares of those in which the cloud shrinks to a speck: read in too small a unit, it lies on the part wherever
/// the frame's origin does, and that proves nothing beside a unit in which it fits at its full size.
fn without_specks(mut attempts: Vec<FrameAttempt>) -> Vec<FrameAttempt> {
    let fits = attempts.iter().filter(|attempt| attempt.on_part >= MIN_SHARE);
    let largest_mm = fits.map(|attempt| attempt.unit.mm()).fold(0.0, f64::max);
    for attempt in attempts.iter_mut().filter(|attempt| attempt.unit.mm() < SPECK * largest_mm) {
        (attempt.in_frusta, attempt.on_part) = (0.0, 0.0);
    }
    attempts
}

/// Returns true if there are more points than pixels at the nearest working depth on the area that the points span, by more than a
/// factor of two: a cloud that is read in too small a unit.
fn is_too_dense(count: usize, points: &[Point3<f64>], unit: LengthUnit, views: usize, world: &IngestWorld<'_>) -> bool {
    let pixel_mm = world.scanner.near_mm / world.scanner.devices.left.lens.focal_px();
    let mut extent_mm: [f64; 3] = (Aabb::around(points).extent_mm() * unit.mm()).into();
    extent_mm.sort_by(f64::total_cmp);
    count as f64 * pixel_mm * pixel_mm > MAX_DENSITY * views as f64 * extent_mm[1] * extent_mm[2]
}

fn shares(
    in_scanner: impl ExactSizeIterator<Item = Point3<f64>>,
    capture: &PlannedCapture,
    world: &IngestWorld<'_>,
    is_merged: bool,
) -> (f64, f64) {
    let all = in_scanner.len().max(1) as f64;
    let plate_from_part = capture.part_from_plate.map(|pose| pose.inverse());
    let (mut inside, mut on_part, mut on_plate) = (0.0, 0.0, 0.0);
    for point in in_scanner {
        if !is_merged && !is_in_frusta(&point, world) {
            continue;
        }
        inside += 1.0;
        let in_part = capture.part_from_scanner.point(&point);
        if is_near(world.nearest, &in_part) {
            on_part += 1.0;
        } else if plate_from_part.is_some_and(|pose| pose.point(&in_part).z.abs() < NEAR_PLATE_MM) {
            on_plate += 1.0;
        }
    }
    // A view may show much plate and little part; but points on the plate alone are no scan of the part.
    let others = if on_plate < 0.9 * all { all - on_plate } else { all };
    (inside / all, on_part / others)
}

/// Share of a scan's points within 5 mm of the part, from a pose of the scanner.
pub(super) fn share_on_part(cloud: &PointCloud, mesh_from_scanner: &Pose<Part, ScannerFrame>, world: &IngestWorld<'_>) -> f64 {
    let every = cloud.finite().count().div_ceil(TRIED_POINTS).max(1);
    let near: Vec<bool> =
        cloud.finite().step_by(every).map(|(_, point)| is_near(world.nearest, &mesh_from_scanner.point(&point))).collect();
    near.iter().filter(|near| **near).count() as f64 / near.len().max(1) as f64
}

pub(super) fn is_near(nearest: &NearestFace<'_>, point: &Point3<f64>) -> bool {
    nearest.nearest(point, NEAR_PART_MM).is_some()
}

fn is_in_frusta(point: &Point3<f64>, world: &IngestWorld<'_>) -> bool {
    let scanner = world.scanner;
    let depth = scanner.near_mm - DEPTH_MARGIN_MM..=scanner.far_mm + DEPTH_MARGIN_MM;
    let devices = [&scanner.devices.left, &scanner.devices.right, &scanner.devices.projector];
    depth.contains(&point.z)
        && devices.iter().all(|device| device.lens.project(&device.scanner_from_device.inverse().point(point)).is_some())
}

/// Moves points; those that are not there stay so.
pub(super) fn transform(points_mm: &mut [[f32; 3]], motion: &Isometry3<f64>) {
    if *motion == Isometry3::identity() {
        return;
    }
    for point in points_mm {
        let moved = motion * Point3::from(point.map(f64::from));
        *point = [moved.x as f32, moved.y as f32, moved.z as f32];
    }
}
