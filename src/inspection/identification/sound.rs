//! Inspections from beginning to end of a scanner without weakness: whatever the spacing of the points and whatever was taken out of the
//! scans, they teach no limit; and those of a weak one still do.

use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::*;
use crate::cell::Scanner;
use crate::geometry::{LengthUnit, Mesh, Part, PointCloud, Pose, ScannerFrame};
use crate::inspection::ingest::{FrameAttempt, PlateZone, Removed, ScanFrame, TakenScan};
use crate::inspection::rehearsal::{in_context, inspect_alone};
use crate::inspection::shots::Shots;
use crate::inspection::simulated_scanner::{ScannedScene, SimulatedScanner, SimulationParams};
use crate::inspection::{Inspection, ViewScan};
use crate::planning::params::PlanParams;
use crate::testing::{box_mesh, cylinder_mesh, nominal_scanner};

/// A column 100 mm high, of which a view sees every incidence, or another part.
struct Column {
    mesh: Mesh,
    scanner: Scanner,
    params: PlanParams,
    views: Vec<(u32, Pose<Part, ScannerFrame>)>,
}

impl Column {
    fn new(radius_mm: f64) -> Self {
        Self::of(cylinder_mesh(radius_mm, 100.0, 96))
    }

    fn of(mesh: Mesh) -> Self {
        let mut params = PlanParams::default();
        params.part.samples_per_mm2 = Some(0.8);
        let views = (1..).zip(Shots::of(&mesh, 8).poses(4)).collect();
        Self { mesh, scanner: nominal_scanner(), params, views }
    }

    /// Scans as a file of each view gives them.
    fn taken(&self, sim: &SimulationParams) -> Vec<TakenScan> {
        self.taken_of(&self.mesh, sim)
    }

    /// Scans of a part that was built otherwise.
    fn taken_of(&self, as_built: &Mesh, sim: &SimulationParams) -> Vec<TakenScan> {
        let scene = ScannedScene { as_built, fixture: None, plate: None, unknown: None, face_albedo: None };
        let views = in_context(|ctx| SimulatedScanner::new(&self.scanner, &self.params, sim, scene, ctx)?.scan(&self.views, ctx));
        let (unit, frame) = (LengthUnit::Millimetre, ScanFrame::Scanner);
        let taken = |scan: ViewScan| TakenScan {
            points: scan.scanner_cloud.finite().count(),
            scan,
            file: String::new(),
            unit,
            frame,
            fit: FrameAttempt { unit, frame, in_frusta: 1.0, on_part: 1.0 },
            removed: Removed::default(),
            is_approximate: false,
        };
        views.expect("nobody cancels").into_iter().map(|view| taken(view.scan)).collect()
    }

    fn inspected(&self, scans: Vec<TakenScan>) -> Inspection {
        inspect_alone(&self.mesh, &self.scanner, &self.params, &self.views, scans)
    }
}

/// Takes points out of scans, two in seven, and marks what was removed of each.
fn thin_out(scans: &mut [TakenScan], mark: fn(&mut Removed)) {
    for taken in scans {
        mark(&mut taken.removed);
        let points_mm = &mut taken.scan.scanner_cloud.points_mm;
        points_mm.iter_mut().enumerate().filter(|(cell, _)| cell % 7 < 2).for_each(|(_, point)| *point = [f32::NAN; 3]);
    }
}

fn every(step_px: u32) -> SimulationParams {
    SimulationParams { step_px, ..SimulationParams::default() }
}

/// Limits and rates that were learned.
fn returns_of(found: &Inspection) -> Option<&LearnedReturns> {
    found.learned.as_ref().and_then(|learned| learned.returns.as_ref())
}

/// Holds that no limit was learned and none is offered; the noise may be.
fn check_teaches_no_limit(found: &Inspection, what: &str) {
    if let Some(returns) = returns_of(found) {
        let limits = returns.by_device.iter().map(|(_, limit)| limit);
        let limits = limits.chain([&returns.incidence, &returns.lobe]).chain(&returns.depth);
        let limits: Vec<_> = limits.flatten().collect();
        assert!(limits.is_empty(), "{what}: {limits:?} of {:?}", returns.model.incidence);
    }
    let is_noise = |change: &&OfferedChange| [OfferedField::NoiseBest, OfferedField::NoiseDepthGain].contains(&change.field);
    assert_eq!(found.offer.changes.iter().filter(is_noise).count(), found.offer.changes.len(), "{what}: {:?}", found.offer);
}

/// A cloud of 3 mm of such a column once taught a limit of 73 degrees, and clouds of 1 mm of other parts one of 80 to 84.
#[test]
fn a_sound_scanner_teaches_no_limit_at_any_spacing() {
    // A pixel spans 0.072 mm at best focus.
    for (step_px, spacing_mm, radius_mm, is_coarse) in [(4, 0.3, 20.0, false), (14, 1.0, 10.0, false), (42, 3.0, 10.0, true)] {
        let column = Column::new(radius_mm);
        let found = column.inspected(column.taken(&every(step_px)));
        check_teaches_no_limit(&found, &format!("{spacing_mm} mm"));
        assert!(returns_of(&found).is_some() || spacing_mm > 0.5, "{spacing_mm} mm: {:?}", found.offer);
        assert!(!is_coarse || found.offer.withheld.contains(&Withheld::CoarseCloud), "{:?}", found.offer);
        assert!(spacing_mm > 0.5 || found.offer.withheld.is_empty(), "{:?}", found.offer);
    }
}

#[test]
fn a_scanner_that_returns_less_from_50_degrees_on_still_teaches_that() {
    let column = Column::new(20.0);
    let found = column.inspected(column.taken(&SimulationParams { grazing_deg: vec![50.0, 60.0], ..every(4) }));
    let limit = returns_of(&found).expect("enough pairs").incidence.expect("a limit");
    assert!((limit.limit.value - 52.5).abs() < 3.0, "0.75 of a fall from 50 to 60: {limit:?}");
    assert!(found.offer.changes.iter().any(|change| change.field == OfferedField::CameraLimit), "{:?}", found.offer);
}

#[test]
fn a_merged_cloud_teaches_nothing_and_says_so() {
    let column = Column::new(20.0);
    let mut scans = column.taken(&every(14));
    scans.iter_mut().for_each(|taken| taken.is_approximate = true);
    let found = column.inspected(scans);
    assert!(found.learned.is_none(), "{:?}", found.learned);
    assert_eq!(found.offer, Offer { withheld: vec![Withheld::MergedCloud], ..Offer::default() });
}

#[test]
fn cells_between_the_points_of_a_cloud_without_a_grid_tell_nothing() {
    let column = Column::new(20.0);
    let mut scans = column.taken(&every(8));
    thin_out(&mut scans, |removed| removed.is_projected = true);
    let found = column.inspected(scans);
    check_teaches_no_limit(&found, "thinned");
    assert!(returns_of(&found).is_none() && found.offer.withheld == [Withheld::CoarseCloud], "{:?}", found.offer);
}

/// A cloud in the camera's grid that was thinned taught how many easy pairs the scanner loses.
#[test]
fn cells_between_the_points_of_a_sparse_cloud_in_the_camera_s_grid_tell_nothing() {
    let column = Column::new(20.0);
    let mut scans = column.taken(&every(8));
    thin_out(&mut scans, |removed| removed.is_sparse = true);
    let found = column.inspected(scans);
    assert!(returns_of(&found).is_none() && found.offer.withheld == [Withheld::CoarseCloud], "{:?}", found.offer);
}

/// Neighbours in a row tell the noise, whatever lies between the rows: it was lost with the rates.
#[test]
fn a_cloud_without_a_grid_that_teaches_no_limit_still_tells_its_noise() {
    let block = Column::of(box_mesh([-25.0, -25.0, 0.0], [25.0, 25.0, 20.0]));
    let mut scans = block.taken(&every(8));
    thin_out(&mut scans, |removed| removed.is_projected = true);
    let found = block.inspected(scans);
    assert!(returns_of(&found).is_none() && found.offer.withheld == [Withheld::CoarseCloud], "{:?}", found.offer);
    let noise = found.learned.as_ref().and_then(|learned| learned.noise.as_ref());
    assert!(noise.is_some_and(|noise| noise.triples >= MIN_TRIPLES), "{noise:?}");
}

#[test]
fn surface_within_the_zone_of_the_plate_cut_and_beside_filtered_points_counts_in_no_rate() {
    let column = Column::new(20.0);
    let sound = column.taken(&every(4));
    // All below 8 mm is taken out, as by a cut, and a band higher up as if it were specks.
    let is_in = |from_mm: f64, to_mm: f64, scan: &ViewScan, point: &[f32; 3]| {
        let z_mm = scan.part_from_scanner.point(&nalgebra::Point3::from(point.map(f64::from))).z;
        (from_mm..to_mm).contains(&z_mm)
    };
    let without = |taken: &TakenScan, is_told: bool| {
        let (scan, mut taken) = (&taken.scan, taken.clone());
        let PointCloud { points_mm, .. } = &mut taken.scan.scanner_cloud;
        for (cell, point) in points_mm.iter_mut().enumerate() {
            let is_speck = is_in(50.0, 58.0, scan, point);
            if is_speck || is_in(-1.0, 8.0, scan, point) {
                *point = [f32::NAN; 3];
                taken.removed.cells.extend((is_speck && is_told).then_some(cell as u32));
            }
        }
        let scanner_from_part = scan.part_from_scanner.inverse();
        let normal = scanner_from_part.direction(&Vector3::z());
        let height_mm = normal.dot(&scanner_from_part.origin_mm().coords) + 7.5;
        taken.removed.plate = is_told.then_some(PlateZone { normal, height_mm });
        taken
    };
    let easy_rate = |is_told: bool| {
        let found = column.inspected(sound.iter().map(|taken| without(taken, is_told)).collect());
        returns_of(&found).map_or(0.0, |returns| returns.easy_rate)
    };
    let [told, untold] = [true, false].map(easy_rate);
    assert!(told > 0.99 && untold < 0.95, "{told} of easy pairs return where it is told, {untold} where it is not");
}

/// A view that lay elsewhere lost most of its samples, and the losses were put down to the scanner.
#[test]
fn a_view_that_kept_its_stated_pose_teaches_nothing() {
    // Of its sides three neighbours fit on one.
    let column = Column::of(cylinder_mesh(20.0, 100.0, 36));
    let sound = column.taken(&every(8));
    let mut scans = sound.clone();
    // Both push what the view looks at the same way, across the column.
    let turn = UnitQuaternion::from_scaled_axis(Vector3::y() * 0.4_f64.to_radians());
    let off = nalgebra::Isometry3::from_parts(Translation3::new(1.2, 0.0, 0.0), turn);
    let stated = *scans[2].scan.part_from_scanner.isometry() * off;
    scans[2].scan.part_from_scanner = Pose::claim(stated);
    let found = column.inspected(scans);
    let kept: Vec<bool> = found.registration.found.iter().map(|view| view.kept_pose.is_some()).collect();
    assert_eq!(kept, [false, false, true, false], "{:?}", found.registration.found);
    check_teaches_no_limit(&found, "a view elsewhere");
    let returns = returns_of(&found).expect("three views tell enough");
    let all = column.inspected(sound);
    let of_all = returns_of(&all).expect("enough pairs");
    assert!(returns.easy_rate > 0.99 && returns.pairs < of_all.pairs, "{} of easy pairs return", returns.easy_rate);
    assert_eq!((found.offer.kept_views, all.offer.kept_views), ([1, 4], [0, 4]));
    let triples = |found: &Inspection| found.learned.as_ref().and_then(|learned| learned.noise).map(|noise| noise.triples);
    assert!(triples(&found) < triples(&all), "{:?} {:?}", triples(&found), triples(&all));
}

#[test]
fn scans_most_of_which_kept_their_stated_poses_teach_little_and_say_so() {
    let column = Column::new(20.0);
    let mut scans = column.taken(&every(8));
    for taken in scans.iter_mut().skip(1) {
        let there = taken.scan.scanner_cloud.points_mm.iter_mut().filter(|point| !point[0].is_nan());
        there.skip(400).for_each(|point| *point = [f32::NAN; 3]);
    }
    let found = column.inspected(scans);
    check_teaches_no_limit(&found, "three views of few points");
    assert!(found.offer.withheld.contains(&Withheld::MisplacedViews), "{:?}", found.offer);
    assert_eq!(found.offer.kept_views, [3, 4]);
}

/// Points behind a collar that is missing were losses of the collar's samples.
#[test]
fn surface_that_the_part_lacks_counts_in_no_rate() {
    let (bare, mut collared, collar) =
        (cylinder_mesh(20.0, 100.0, 96), cylinder_mesh(20.0, 100.0, 96), cylinder_mesh(23.0, 30.0, 96));
    let first = collared.vertices_mm.len() as u32;
    collared.vertices_mm.extend(collar.vertices_mm.iter().map(|vertex_mm| vertex_mm + Vector3::z() * 35.0));
    collared.faces.extend(collar.faces.iter().map(|face| face.map(|vertex| vertex + first)));
    collared.source_face.extend(collar.source_face);
    let column = Column::of(collared);
    let found = column.inspected(column.taken_of(&bare, &every(8)));
    let returns = returns_of(&found).expect("enough pairs");
    assert!(returns.easy_rate > 0.95, "{} of easy pairs return", returns.easy_rate);
}
