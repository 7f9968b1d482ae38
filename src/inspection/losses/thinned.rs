//! Scans of the demo base from beginning to end, as files without the camera's grid: of thinned ones what lies between their points is told
//! as that, and of dense ones what is cut off and what was taken out.

use nalgebra::Point3;

use super::{LossCause, Losses};
use crate::geometry::cloud_io::StoredCloud;
use crate::geometry::demo_parts::base;
use crate::geometry::{LengthUnit, Mesh, NearestFace, Part, PointCloud, Pose, ScannerFrame};
use crate::inspection::coverage::MeasuredCoverage;
use crate::inspection::ingest::{IngestOptions, IngestWorld, PlannedCapture, ScanFile, ScanFrame, TakenScan, ingest};
use crate::inspection::rehearsal::{in_context, inspect_alone};
use crate::inspection::shots::{Shots, unit};
use crate::planning::params::PlanParams;
use crate::testing::nominal_scanner;

/// The demo base, and clouds of it from four sides.
struct Scanned {
    mesh: Mesh,
    poses: Vec<Pose<Part, ScannerFrame>>,
    clouds: Vec<PointCloud>,
}

impl Scanned {
    fn new() -> Self {
        let mesh = base(8_000).expect("a base");
        let shots = Shots::of(&mesh, 8);
        let poses = shots.poses(4);
        let clouds = (1..).zip(&poses).map(|(seed, pose)| shots.cloud(pose, 0.01, seed)).collect();
        Self { poses, clouds, mesh }
    }

    /// Scans of files that hold those points of each view of which a rule holds, by view and number.
    fn taken(&self, keeps: impl Fn(usize, usize, &[f32; 3]) -> bool) -> Vec<TakenScan> {
        let (scanner, nearest) = (nominal_scanner(), NearestFace::new(&self.mesh));
        let capture = |(viewpoint, pose): (u32, &Pose<Part, ScannerFrame>)| PlannedCapture {
            viewpoint,
            part_from_scanner: *pose,
            scanner_from_cloud: None,
            part_from_plate: None,
            part_from_table: None,
            part_from_base: None,
        };
        let captures: Vec<PlannedCapture> = (1..).zip(&self.poses).map(capture).collect();
        let file = |(view, cloud): (usize, &PointCloud)| {
            let is_kept = |(number, point): &(usize, &[f32; 3])| !point[0].is_nan() && keeps(view, *number, point);
            let points = cloud.points_mm.iter().enumerate().filter(is_kept).map(|(_, point)| *point).collect();
            ScanFile {
                file: format!("view_{}.xyz", view + 1),
                cloud: StoredCloud { points, ..StoredCloud::default() },
                unit: Some(LengthUnit::Millimetre),
                frame: Some(ScanFrame::Scanner),
                viewpoint: Some(view as u32 + 1),
            }
        };
        let files = self.clouds.iter().enumerate().map(file).collect();
        let world = IngestWorld { scanner: &scanner, nearest: &nearest, captures: &captures, fixtures: &[] };
        in_context(|ctx| ingest(files, &world, &IngestOptions::default(), ctx)).expect("nobody cancels").scans
    }

    fn losses(&self, scans: Vec<TakenScan>) -> (Losses, MeasuredCoverage) {
        let mut plan_params = PlanParams::default();
        plan_params.part.samples_per_mm2 = Some(0.4);
        let views: Vec<_> = (1..).zip(self.poses.iter().copied()).collect();
        let found = inspect_alone(&self.mesh, &nominal_scanner(), &plan_params, &views, scans);
        (found.losses, found.coverage)
    }
}

/// Areas lost for some causes, as shares of what is asked for.
fn shares<const COUNT: usize>((losses, coverage): &(Losses, MeasuredCoverage), causes: [LossCause; COUNT]) -> [f64; COUNT] {
    causes.map(|cause| losses.area_mm2(cause) / coverage.asked_mm2)
}

/// A tenth of the surface was told as removed in cleaning or as cut off in sound scans of a quarter to a twentieth of their points, and some
/// as near an edge, where cells of a quarter of the points reach across it.
#[test]
fn what_a_thinned_scan_lacks_is_told_as_too_few_points() {
    let scanned = Scanned::new();
    for share in [0.25, 0.1, 0.05] {
        let seed = |view: usize| 20_000_000 * (view as u64 + 1);
        let scans = scanned.taken(|view, number, _| unit(seed(view) + number as u64) < share);
        assert_eq!(scans.len(), 4, "{share} of the points");
        let found = scanned.losses(scans);
        let [sparse, cut, filtered] = shares(&found, [LossCause::Sparse, LossCause::OutsideFile, LossCause::Filtered]);
        let told = format!("{share} of the points: {sparse} sparse, {cut} cut off, {filtered} removed");
        assert!(sparse > 0.01 && cut + filtered < 0.001, "{told}");
        let [edge] = shares(&found, [LossCause::Edge]);
        assert!(edge < 1e-9, "{told}, {edge} near an edge");
    }
}

/// Words for thinned scans are not said of dense ones.
#[test]
fn a_dense_scan_still_tells_what_is_cut_off_and_what_was_taken_out() {
    let scanned = Scanned::new();
    let whole = scanned.taken(|_, _, _| true);
    let [sparse_of_whole] = shares(&scanned.losses(whole.clone()), [LossCause::Sparse]);
    let cut = scanned.losses(scanned.taken(|_, _, point| point[0] < 0.0));
    let [outside, sparse] = shares(&cut, [LossCause::OutsideFile, LossCause::Sparse]);
    assert!(outside > 0.05 && sparse < sparse_of_whole + 0.2 * outside, "{outside} cut off, {sparse} sparse");
    // A slab across the part.
    let middle_mm = scanned.mesh.aabb().centre().x;
    let mut scans = whole;
    for taken in &mut scans {
        let pose = taken.scan.part_from_scanner;
        let is_in_slab = |point: &[f32; 3]| (pose.point(&Point3::from(point.map(f64::from))).x - middle_mm).abs() < 10.0;
        let cells = taken.scan.scanner_cloud.points_mm.iter_mut().enumerate();
        for (cell, point) in cells.filter(|(_, point)| !point[0].is_nan() && is_in_slab(point)) {
            *point = [f32::NAN; 3];
            taken.removed.cells.push(cell as u32);
        }
        taken.removed.cells.sort_unstable();
    }
    let [filtered, sparse] = shares(&scanned.losses(scans), [LossCause::Filtered, LossCause::Sparse]);
    assert!(filtered > 0.05 && sparse < sparse_of_whole + 0.2 * filtered, "{filtered} removed, {sparse} sparse");
}
