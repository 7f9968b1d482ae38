use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::*;
use crate::cell::{CloudFrame, CloudFrameSpec};
use crate::geometry::cloud_io::{CloudLimits, read, write_pcd};
use crate::geometry::demo_parts::{base, figurine};
use crate::geometry::{CloudGrid, Mesh, Part, Plate, Pose};
use crate::inspection::rehearsal::in_context;
use crate::inspection::shots::Shots;
use crate::planning::context::Silent;
use crate::testing::{box_mesh, cylinder_mesh};

/// The demo base on its plate, scanned from four sides.
struct Cell {
    mesh: Mesh,
    scanner: Scanner,
    captures: Vec<PlannedCapture>,
    clouds: Vec<PointCloud>,
}

impl Cell {
    fn new() -> Self {
        Self::holding(base(8_000).expect("a base"), &Isometry3::identity())
    }

    /// A part that lies elsewhere than planned: `mesh_from_stated` takes what the planned poses say to where it is.
    fn holding(mesh: Mesh, mesh_from_stated: &Isometry3<f64>) -> Self {
        let shots = Shots::of(&mesh, 16);
        let poses: Vec<_> = shots.poses(8).into_iter().take(4).collect();
        let truly = |pose: &Pose<Part, crate::geometry::ScannerFrame>| Pose::claim(mesh_from_stated * pose.isometry());
        let clouds = poses.iter().map(|pose| shots.cloud(&truly(pose), 0.0, 1)).collect();
        let cloud_frame = CloudFrameSpec::Named(CloudFrame::Left).scanner_from_cloud(&shots.scanner.devices);
        let part_from_plate: Pose<Part, Plate> =
            Pose::from_parts(Vector3::new(5.0, -8.0, -0.01), UnitQuaternion::from_euler_angles(0.0, 0.0, 0.4));
        let base_from_table = Isometry3::from_parts(Translation3::new(700.0, 50.0, 200.0), UnitQuaternion::identity());
        let capture = |(view, pose): (usize, &Pose<Part, crate::geometry::ScannerFrame>)| {
            let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.7 * view as f64);
            let table_from_plate = Isometry3::from_parts(Translation3::identity(), turn);
            let part_from_table = part_from_plate.isometry() * table_from_plate.inverse();
            PlannedCapture {
                viewpoint: view as u32 + 1,
                part_from_scanner: *pose,
                scanner_from_cloud: Some(cloud_frame),
                part_from_plate: Some(part_from_plate),
                part_from_table: Some(Pose::claim(part_from_table)),
                part_from_base: Some(Pose::claim(part_from_table * base_from_table.inverse())),
            }
        };
        let captures = poses.iter().enumerate().map(capture).collect();
        let scanner = shots.scanner.clone();
        Self { mesh, scanner, captures, clouds }
    }

    /// The cloud of a view in a unit and a frame, named for a view.
    fn file(&self, view: usize, unit: LengthUnit, frame: ScanFrame, file: &str) -> ScanFile {
        let frame_from_scanner = self.captures[view].scanner_from(frame).expect("a frame").inverse();
        let mut points = self.clouds[view].points_mm.clone();
        frames::transform(&mut points, &frame_from_scanner);
        points.iter_mut().for_each(|point| *point = point.map(|value| (f64::from(value) / unit.mm()) as f32));
        let cloud = StoredCloud { points, grid: self.clouds[view].grid, ..StoredCloud::default() };
        ScanFile { file: file.into(), cloud, unit: None, frame: None, viewpoint: None }
    }

    /// The points of all views in the part's frame, mm.
    fn merged(&self, file: &str) -> ScanFile {
        let mut all = self.file(0, LengthUnit::Millimetre, ScanFrame::Part, file);
        for view in 1..4 {
            all.cloud.points.extend(self.file(view, LengthUnit::Millimetre, ScanFrame::Part, "").cloud.points);
        }
        all.cloud.points.retain(|point| !point[0].is_nan());
        all.cloud.grid = None;
        all
    }

    fn ingest(&self, files: Vec<ScanFile>) -> Ingested {
        let nearest = NearestFace::new(&self.mesh);
        let world = IngestWorld { scanner: &self.scanner, nearest: &nearest, captures: &self.captures, fixtures: &[] };
        in_context(|ctx| ingest(files, &world, &IngestOptions::default(), ctx)).expect("nobody cancels")
    }
}

fn codes(ingested: &Ingested) -> Vec<IngestCode> {
    ingested.findings.iter().map(|finding| finding.code).filter(|code| *code != IngestCode::ViewMissing).collect()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn unit_and_frame_of_each_file_are_found() {
    let cell = Cell::new();
    for unit in [LengthUnit::Millimetre, LengthUnit::Metre, LengthUnit::Inch] {
        for frame in ScanFrame::ALL {
            let taken = cell.ingest(vec![cell.file(2, unit, frame, "scan_003.ply")]);
            let [scan] = &taken.scans[..] else { panic!("{unit} {frame:?}: {:?}", taken.findings) };
            assert_eq!((scan.unit, scan.frame, scan.scan.viewpoint, scan.is_approximate), (unit, frame, 3, false));
            assert!(scan.fit.on_part > 0.99, "{:?}", scan.fit);
            let kept = |cell_number: usize| scan.scan.scanner_cloud.points_mm[cell_number];
            for (number, point) in cell.clouds[2].finite() {
                let found = kept(number);
                assert!(found[0].is_nan() || (Point3::from(found.map(f64::from)) - point).norm() < 1e-3, "{unit} {frame:?}");
            }
            assert_eq!(taken.findings.iter().filter(|finding| finding.code == IngestCode::ViewMissing).count(), 3);
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_with_what_was_tried() {
    let cell = Cell::new();
    let plain = |view| cell.file(view, LengthUnit::Millimetre, ScanFrame::Scanner, "view_3.ply");
    let code = |file: ScanFile| {
        let taken = cell.ingest(vec![file]);
        assert!(taken.scans.is_empty());
        let finding = taken.findings.into_iter().find(|finding| finding.code.is_refusal()).expect("a refusal");
        assert!(finding.tried.len() == 18 && finding.file.as_deref() == Some("view_3.ply") && finding.viewpoint == Some(3));
        (finding.code, finding.fits_viewpoint)
    };
    let metres = cell.file(2, LengthUnit::Metre, ScanFrame::Scanner, "view_3.ply");
    assert_eq!(code(ScanFile { unit: Some(LengthUnit::Millimetre), ..metres }), (IngestCode::UnitMismatch, None));
    let in_part = cell.file(2, LengthUnit::Millimetre, ScanFrame::Part, "view_3.ply");
    assert_eq!(code(ScanFile { frame: Some(ScanFrame::Scanner), ..in_part }), (IngestCode::FrameMismatch, None));
    let other = Cell::holding(figurine(8_000).expect("a figurine"), &Isometry3::translation(0.0, 0.0, -60.0));
    let another_part = other.file(2, LengthUnit::Millimetre, ScanFrame::Scanner, "view_3.ply");
    assert_eq!(code(another_part), (IngestCode::NoPart, None));
    let mut far = plain(2);
    far.cloud.points.iter_mut().for_each(|point| *point = point.map(|value| value * 1e30));
    assert_eq!(code(far).0, IngestCode::FrameMismatch);
}

#[test]
fn a_part_that_lies_elsewhere_is_found() {
    let motion = |deg: f64, mm: f64| Isometry3::new(Vector3::new(0.8 * mm, -0.6 * mm, 0.0), Vector3::z() * deg.to_radians());
    // Six millimetres are within what the ingest takes for near, and beyond what registration finds by itself.
    // Turned by a right angle, views of the base see much of what others were to see.
    for (deg, mm, is_elsewhere) in [(90.0, 0.0, true), (25.0, 30.0, true), (4.0, 6.0, true), (0.3, 0.8, false)] {
        let wanted = motion(deg, mm);
        let cell = Cell::holding(base(8_000).expect("a base"), &wanted);
        // Points that miss the part tell the vendor's frame and the scanner's hardly apart: the frame is declared.
        let file = |view: usize| {
            let plain = cell.file(view, LengthUnit::Millimetre, ScanFrame::Scanner, &format!("view_{}.ply", view + 1));
            ScanFile { frame: Some(ScanFrame::Scanner), ..plain }
        };
        let taken = cell.ingest((0..4).map(file).collect());
        assert_eq!(taken.scans.len(), 4, "{:?}", taken.findings);
        let found = taken.mesh_from_stated.isometry();
        if is_elsewhere {
            assert_eq!(codes(&taken), [IngestCode::PartElsewhere], "{:?}", taken.findings);
            let centre = cell.mesh.aabb().centre();
            let apart_mm = (found * centre - wanted * centre).norm();
            assert!(apart_mm < 0.1 && found.rotation.angle_to(&wanted.rotation) < 2e-3, "{deg}°, {mm} mm: {apart_mm} {found}");
        } else {
            assert_eq!((codes(&taken), *found), (vec![], Isometry3::identity()));
        }
    }
}

/// A scan of another part was once taken with those of a part that was found elsewhere, where it would have been refused with those of one
/// that lies as planned.
#[test]
fn a_scan_that_misses_a_part_that_lies_elsewhere_is_refused_all_the_same() {
    let moved = Isometry3::new(Vector3::new(4.8, -3.6, 0.0), Vector3::z() * 4.0_f64.to_radians());
    let cell = Cell::holding(base(8_000).expect("a base"), &moved);
    let other = Cell::holding(figurine(8_000).expect("a figurine"), &Isometry3::translation(0.0, 0.0, -60.0));
    let file = |view: usize| {
        let cell = if view == 2 { &other } else { &cell };
        let plain = cell.file(view, LengthUnit::Millimetre, ScanFrame::Scanner, &format!("view_{}.ply", view + 1));
        ScanFile { frame: Some(ScanFrame::Scanner), ..plain }
    };
    let taken = cell.ingest((0..4).map(file).collect());
    assert_eq!(codes(&taken), [IngestCode::NoPart, IngestCode::PartElsewhere], "{:?}", taken.findings);
    assert!(taken.stray_points > 0, "its points lie nowhere");
    let views: Vec<u32> = taken.scans.iter().map(|taken| taken.scan.viewpoint).collect();
    assert_eq!(views, [1, 2, 4]);
}

#[test]
fn a_grid_from_the_bottom_up_or_a_few_cells_off_is_put_into_the_image_s() {
    let cell = Cell::new();
    for is_from_the_bottom_up in [true, false] {
        let mut file = cell.file(0, LengthUnit::Millimetre, ScanFrame::Scanner, "1.ply");
        let columns = file.cloud.grid.expect("a grid").columns;
        if is_from_the_bottom_up {
            file.cloud.points = file.cloud.points.chunks(columns).rev().flatten().copied().collect();
        } else {
            file.cloud.points.rotate_right(3);
        }
        let taken = cell.ingest(vec![file]);
        let cloud = &taken.scans[0].scan.scanner_cloud;
        let grid = PixelGrid::of_size(&cell.scanner, cloud.grid.expect("a grid")).expect("of the image");
        for (number, point) in cloud.finite() {
            assert_eq!(grid.cell_of(&point).map(|place| grid.number(place)), Some(number), "{point}");
        }
        let (found, wanted) = (cloud.finite().count(), cell.clouds[0].finite().count());
        assert!(found as f64 > 0.9 * wanted as f64, "{found} of {wanted}");
    }
}

#[test]
fn a_symmetric_part_that_lies_elsewhere_is_refused() {
    let block = box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 15.0]);
    let cell = Cell::holding(block, &Isometry3::new(Vector3::new(20.0, 10.0, 0.0), Vector3::z() * 0.6));
    let files = (0..4).map(|view| cell.file(view, LengthUnit::Millimetre, ScanFrame::Scanner, &format!("view_{}.ply", view + 1)));
    let taken = cell.ingest(files.collect());
    assert!(taken.scans.is_empty() && taken.mesh_from_stated == Pose::identity());
    assert_eq!(codes(&taken), [IngestCode::SymmetricPart; 4], "{:?}", taken.findings);
}

#[test]
fn swapped_double_and_unknown_views_are_named() {
    let cell = Cell::new();
    let plain = |view, file: &str| cell.file(view, LengthUnit::Millimetre, ScanFrame::Part, file);
    // In the part's frame the points of another view lie on the part, but hardly where this view looks.
    let taken = cell.ingest(vec![plain(0, "a/view_01.ply"), plain(1, "b/view_01.ply"), plain(1, "view_77.ply")]);
    assert_eq!(codes(&taken), [IngestCode::ViewDouble, IngestCode::ViewUnknown]);
    // "The first one is used" did not say which.
    let double = taken.findings.iter().find(|finding| finding.code == IngestCode::ViewDouble).expect("a double");
    assert_eq!((double.file.as_deref(), double.taken_file.as_deref()), (Some("b/view_01.ply"), Some("a/view_01.ply")));
    let world_number =
        taken.findings.iter().find(|finding| finding.code == IngestCode::ViewUnknown).and_then(|finding| finding.viewpoint);
    assert_eq!((taken.scans.len(), world_number), (1, Some(77)));
    let swapped = cell.ingest(vec![cell.file(3, LengthUnit::Millimetre, ScanFrame::Scanner, "view_01.ply")]);
    let finding = &swapped.findings[0];
    assert_eq!((finding.code, finding.fits_viewpoint), (IngestCode::WrongView, Some(4)), "{finding:?}");
    for (name, number) in
        [("view_03.ply", Some(3)), ("7", Some(7)), ("scan.12.pcd", Some(12)), ("x/9/part.xyz", None), ("2024-01 shot 5", Some(5))]
    {
        assert_eq!(number_of(name), number, "{name}");
    }
}

/// A scan in the scanner's frame from one of eight poses around the part, of which the first four are the plan's views 1 to 4.
fn from_pose(cell: &Cell, pose: usize, file: &str) -> ScanFile {
    let shots = Shots::of(&cell.mesh, 16);
    let taken = shots.cloud(&shots.poses(8)[pose], 0.0, 9);
    let cloud = StoredCloud { points: taken.points_mm, grid: taken.grid, ..StoredCloud::default() };
    ScanFile { file: file.into(), cloud, unit: None, frame: Some(ScanFrame::Scanner), viewpoint: None }
}

/// Code of a refusal, its view, and the view that the scan fits.
type Refusal = (IngestCode, Option<u32>, Option<u32>);

/// Views whose scans were taken, and the refusals.
fn told(taken: &Ingested) -> (Vec<u32>, Vec<Refusal>) {
    let refusals = taken.findings.iter().filter(|finding| finding.code.is_refusal());
    let views = taken.scans.iter().map(|taken| taken.scan.viewpoint).collect();
    (views, refusals.map(|finding| (finding.code, finding.viewpoint, finding.fits_viewpoint)).collect())
}

/// Most points of a round part's other view lie within millimetres of it: such scans were merged, or told as a part elsewhere.
#[test]
fn a_scan_of_another_view_or_of_none_is_named_where_most_of_its_points_are_near_the_part() {
    let cell = Cell::holding(cylinder_mesh(30.0, 60.0, 48), &Isometry3::identity());
    let first = |pose: usize| {
        let files = [(pose, 1), (1, 2), (2, 3), (3, 4)];
        cell.ingest(files.map(|(pose, view)| from_pose(&cell, pose, &format!("view_{view}.ply"))).into())
    };
    let right = first(0);
    assert_eq!(told(&right), (vec![1, 2, 3, 4], vec![]), "{:?}", right.findings);
    let copied = first(3);
    assert_eq!(told(&copied), (vec![2, 3, 4], vec![(IngestCode::WrongView, Some(1), Some(4))]), "{:?}", copied.findings);
    assert_eq!(copied.mesh_from_stated, Pose::identity());
    // Of a surface with waves 9 mm high a tenth can be brought onto the part, and a fifth is far from it.
    let mut waves = from_pose(&cell, 1, "view_2.ply");
    let columns = waves.cloud.grid.expect("a grid").columns;
    for (number, point) in waves.cloud.points.iter_mut().enumerate() {
        let height_mm = 9.0 * (0.25 * (number % columns) as f32).sin();
        *point = point.map(|value| value * (1.0 + height_mm / 480.0));
    }
    let others = [(0, 1), (2, 3), (3, 4)].map(|(pose, view)| from_pose(&cell, pose, &format!("view_{view}.ply")));
    let of_none = cell.ingest(others.into_iter().chain([waves]).collect());
    assert_eq!(told(&of_none), (vec![1, 3, 4], vec![(IngestCode::WrongView, Some(2), None)]), "{:?}", of_none.findings);
}

/// Nothing tells a swap of two views that see the same, but one scan is not the scan of both.
#[test]
fn one_scan_under_two_views_counts_once() {
    let mut cell = Cell::new();
    cell.captures[1].part_from_scanner = cell.captures[0].part_from_scanner;
    let copied = cell.ingest([(0, 1), (0, 2), (2, 3)].map(|(pose, view)| from_pose(&cell, pose, &format!("{view}.ply"))).into());
    assert_eq!(told(&copied), (vec![1, 3], vec![(IngestCode::SameScan, Some(2), Some(1))]), "{:?}", copied.findings);
    // Another capture of the same is a scan of its own.
    let mut again = from_pose(&cell, 0, "2.ply");
    again.cloud.points.iter_mut().for_each(|point| point[2] += 1e-3);
    let both = cell.ingest(vec![from_pose(&cell, 0, "1.ply"), again]);
    assert_eq!(told(&both), (vec![1, 2], vec![]), "{:?}", both.findings);
}

/// A place that three of five turned scans told by chance was taken for the part's, whatever the other two said.
#[test]
fn scans_that_lie_nowhere_tell_against_a_place_that_was_searched_for() {
    let cell = Cell::new();
    let nearest = NearestFace::new(&cell.mesh);
    let world = IngestWorld { scanner: &cell.scanner, nearest: &nearest, captures: &cell.captures, fixtures: &[] };
    let mut taken = cell.ingest(vec![cell.file(0, LengthUnit::Millimetre, ScanFrame::Scanner, "1.ply")]);
    let own = taken.scans[0].clone();
    let largest = own.scan.scanner_cloud.finite().count();
    taken.scans = vec![own.clone(); 2];
    let found = PartPose { mesh_from_stated: Pose::identity(), inlier_share: 0.8, is_searched: true };
    let mut elsewhere = own.clone();
    let far: Pose<Part, Part> = Pose::claim(Isometry3::translation(300.0, 0.0, 0.0));
    elsewhere.scan.part_from_scanner = far * own.scan.part_from_scanner;
    let is_outvoted = |astray: &[TakenScan]| taken.is_outvoted(astray, &found, &world);
    assert!(!is_outvoted(&[elsewhere.clone()]), "0.8 of two of three");
    assert!(is_outvoted(&[elsewhere.clone(), elsewhere]), "0.8 of two of four");
    assert!(!is_outvoted(&[own.clone(), own]), "they lie on the part there as well");
    let finding = |code: IngestCode, file: &str| IngestFinding::of(code, Some(file.to_owned()), Some(2));
    taken.findings = vec![
        finding(IngestCode::NoPart, "far.ply"),
        // An upload of the same name, for another view.
        IngestFinding { viewpoint: Some(3), ..finding(IngestCode::NoPart, "far.ply") },
        finding(IngestCode::FrameMismatch, "small.ply"),
        IngestFinding { fits_viewpoint: Some(3), ..finding(IngestCode::WrongView, "swapped.ply") },
        finding(IngestCode::SameScan, "copy.ply"),
    ];
    let points =
        [("far.ply", 2, usize::MAX), ("far.ply", 3, 5), ("small.ply", 2, 7), ("swapped.ply", 2, 900), ("copy.ply", 2, 900)];
    taken.count_strays(&points.map(|(file, view, points)| ((file.to_owned(), Some(view)), points)).into());
    assert_eq!(taken.stray_points, largest + 5 + 7);
}

/// Such scans stayed, and were judged at the planned place, where those that lie nowhere do not count.
#[test]
fn scans_that_tell_a_place_which_the_others_outvote_are_left_out() {
    let moved = Isometry3::new(Vector3::new(4.8, -3.6, 0.0), Vector3::z() * 4.0_f64.to_radians());
    let cell = Cell::holding(base(8_000).expect("a base"), &moved);
    let file = |view: usize| {
        let plain = cell.file(view, LengthUnit::Millimetre, ScanFrame::Scanner, &format!("view_{}.ply", view + 1));
        ScanFile { frame: Some(ScanFrame::Scanner), ..plain }
    };
    let scans = cell.ingest([0, 1, 3].map(file).into()).scans;
    assert_eq!(scans.len(), 3);
    // Six scans, each of which lies elsewhere.
    let astray = [0, 1, 2, 3, 4, 5].map(|place: usize| {
        let mut taken = scans[0].clone();
        let far_mm = Vector3::ith(place % 3, if place < 3 { 300.0 } else { -300.0 });
        let far: Pose<Part, Part> = Pose::claim(Isometry3::from_parts(far_mm.into(), UnitQuaternion::identity()));
        taken.scan.part_from_scanner = far * taken.scan.part_from_scanner;
        taken
    });
    let nearest = NearestFace::new(&cell.mesh);
    let world = IngestWorld { scanner: &cell.scanner, nearest: &nearest, captures: &cell.captures, fixtures: &[] };
    let mut taken = Ingested { scans, ..Ingested::default() };
    taken.place_part(astray.into(), Vec::new(), &world);
    assert_eq!(codes(&taken), [IngestCode::OtherPlan; 3], "{:?}", taken.findings);
    assert!(taken.scans.is_empty() && taken.mesh_from_stated == Pose::identity());
    let views: Vec<&[u32]> = taken.findings.iter().map(|finding| &finding.viewpoints[..]).collect();
    assert_eq!(views, [[1]; 3], "all that lie elsewhere are copies of viewpoint 1");
}

/// The one scan of another plan that fitted by chance was told as what was measured of the part.
#[test]
fn scans_of_which_most_fit_no_view_are_refused_and_each_is_named() {
    let cell = Cell::new();
    let of = |poses: &[usize]| {
        let file = |(pose, view): (&usize, u32)| from_pose(&cell, *pose, &format!("view_{view}.ply"));
        cell.ingest(poses.iter().zip(1..).map(file).collect())
    };
    let other_plan = of(&[0, 4, 5, 6]);
    let (views, refusals) = told(&other_plan);
    let mut refused: Vec<Option<u32>> = refusals.iter().map(|(_, view, _)| *view).collect();
    refused.sort_unstable();
    assert_eq!((views, refused), (vec![], (1..=4).map(Some).collect()), "{:?}", other_plan.findings);
    assert!(refusals.contains(&(IngestCode::OtherPlan, Some(1), None)), "{refusals:?}");
    let other_plan = other_plan.findings.iter().find(|finding| finding.code == IngestCode::OtherPlan).expect("a finding");
    assert_eq!(other_plan.viewpoints, [2, 3, 4], "the views whose files do not fit");
    // Where at least half of the files fit, those are compared.
    let one_of_two = of(&[0, 4]);
    let (views, refusals) = told(&one_of_two);
    assert_eq!((views, refusals.len(), refusals[0].1), (vec![1], 1, Some(2)), "{:?}", one_of_two.findings);
}

/// Scans of a part that was found, or of a setup in which the part was put down as planned, were refused with those that misfit.
#[test]
fn scans_that_fit_are_refused_only_with_misfits_of_their_setup_and_of_another_part() {
    let cell = Cell::new();
    let kept = |cell: &Cell, views: &[usize], moved_mm: f64, is_in_another_frame: bool| {
        let file = |view: &usize| cell.file(*view, LengthUnit::Millimetre, ScanFrame::Scanner, &format!("{}.ply", view + 1));
        let mut taken = cell.ingest(views.iter().map(file).collect());
        taken.mesh_from_stated = Pose::claim(Isometry3::translation(moved_mm, 0.0, 0.0));
        let tried = if is_in_another_frame { vec![taken.scans[0].fit] } else { Vec::new() };
        for number in 0..3 {
            let finding = IngestFinding::of(IngestCode::NoPart, Some(format!("{number}.ply")), Some(3));
            taken.findings.push(IngestFinding { tried: tried.clone(), ..finding });
        }
        let nearest = NearestFace::new(&cell.mesh);
        let world = IngestWorld { scanner: &cell.scanner, nearest: &nearest, captures: &cell.captures, fixtures: &[] };
        taken.refuse_other_plan(&world);
        taken.scans.len()
    };
    assert_eq!(kept(&cell, &[0, 1], 0.0, false), 0, "three of five misfit");
    assert_eq!(kept(&cell, &[0, 1], 5.0, false), 2, "the part was found by those that fit");
    assert_eq!(kept(&cell, &[0], 5.0, false), 0, "one of four finds something in any part");
    assert_eq!(kept(&cell, &[0, 1], 0.0, true), 2, "the others lie on the part in another frame");
    let mut of_two_setups = Cell::new();
    of_two_setups.captures[2].part_from_plate = Some(Pose::identity());
    assert_eq!(kept(&of_two_setups, &[0, 1], 0.0, false), 2, "the others are of another setup");
}

/// A lone file of a view that does not exist was once refused as a cloud that misses the part, or taken for one of all views without a
/// word on its number.
#[test]
fn a_number_that_is_no_view_of_the_plan_is_told_with_those_that_are() {
    let cell = Cell::new();
    let lone = |frame: ScanFrame| cell.ingest(vec![cell.file(1, LengthUnit::Millimetre, frame, "view_99.ply")]);
    let told = |taken: &Ingested, code: IngestCode, number: Option<u32>, viewpoints: &[u32]| {
        let finding = &taken.findings[0];
        assert_eq!((finding.code, finding.viewpoint, &finding.viewpoints[..]), (code, number, viewpoints), "{finding:?}");
    };
    // In the scanner's frame it is of one view, and fits none.
    let (of_view, of_all) = (lone(ScanFrame::Scanner), lone(ScanFrame::Part));
    told(&of_view, IngestCode::ViewUnknown, Some(99), &[1, 2, 3, 4]);
    assert!(of_view.scans.is_empty() && of_view.findings[0].file.as_deref() == Some("view_99.ply"));
    told(&of_all, IngestCode::Merged, Some(99), &[1, 2, 3, 4]);
    assert_eq!(of_all.scans.len(), 4);
    // A finding that does not tell the number names no view by it.
    let file = cell.file(1, LengthUnit::Millimetre, ScanFrame::Part, "view_99.ply");
    told(&cell.ingest(vec![ScanFile { unit: Some(LengthUnit::Inch), ..file }]), IngestCode::UnitMismatch, None, &[]);
    // The only view takes the only file, unless another view is declared.
    let mut one = Cell::new();
    one.captures.truncate(1);
    let file = || one.file(0, LengthUnit::Millimetre, ScanFrame::Scanner, "part_4711.ply");
    assert_eq!(one.ingest(vec![file()]).scans.len(), 1);
    let declared = one.ingest(vec![ScanFile { viewpoint: Some(7), ..file() }]);
    told(&declared, IngestCode::ViewUnknown, Some(7), &[1]);
    assert!(declared.scans.is_empty());
}

/// Centimetres are not guessed, and were once not tried where they were declared either.
#[test]
fn a_declared_unit_is_tried_though_it_is_not_guessed() {
    let cell = Cell::new();
    let file = cell.file(2, LengthUnit::Centimetre, ScanFrame::Scanner, "view_3.ply");
    let taken = cell.ingest(vec![ScanFile { unit: Some(LengthUnit::Centimetre), ..file }]);
    let [scan] = &taken.scans[..] else { panic!("{:?}", taken.findings) };
    assert_eq!((scan.unit, scan.frame, scan.scan.viewpoint), (LengthUnit::Centimetre, ScanFrame::Scanner, 3));
}

/// Reading scans, and the search for the view that one fits, could once not be cancelled.
#[test]
fn scans_are_not_taken_in_once_that_is_cancelled() {
    let cell = Cell::new();
    let nearest = NearestFace::new(&cell.mesh);
    let world = IngestWorld { scanner: &cell.scanner, nearest: &nearest, captures: &cell.captures, fixtures: &[] };
    let cancel = AtomicBool::new(true);
    let ctx = Context::new(&cancel, &Silent);
    for name in ["view_3.ply", "all.ply"] {
        let file = cell.file(2, LengthUnit::Millimetre, ScanFrame::Part, name);
        assert!(ingest(vec![file], &world, &IngestOptions::default(), &ctx).is_err(), "{name}");
    }
}

#[test]
fn a_merged_cloud_is_put_into_each_view_and_said_to_be_approximate() {
    let cell = Cell::new();
    let all = cell.merged("all.ply");
    let taken = cell.ingest(vec![all]);
    assert_eq!(codes(&taken), [IngestCode::Merged]);
    assert_eq!(taken.scans.len(), 4);
    for (scan, own) in taken.scans.iter().zip(&cell.clouds) {
        assert!(scan.is_approximate && scan.frame == ScanFrame::Part);
        let (found, wanted) = (scan.scan.scanner_cloud.finite().count(), own.finite().count());
        assert!(found as f64 > 0.9 * wanted as f64, "{found} of {wanted}: {:?} {:?}", scan.scan.scanner_cloud.grid, scan.removed);
    }
}

/// Such a cloud was taken for the scan of that view, and the other views were told to lack theirs.
#[test]
fn a_merged_cloud_whose_name_has_the_number_of_a_view_is_taken_as_merged_and_a_scan_of_that_view_is_not() {
    let cell = Cell::new();
    let all = cell.merged("part_4.ply");
    let taken = cell.ingest(vec![all.clone()]);
    assert_eq!(codes(&taken), [IngestCode::Merged], "{:?}", taken.findings);
    assert_eq!((taken.scans.len(), taken.findings[0].viewpoint), (4, Some(4)));
    assert!(taken.scans.iter().all(|scan| scan.is_approximate));
    // Its user may say that it is the view's.
    let declared = cell.ingest(vec![ScanFile { viewpoint: Some(4), ..all }]);
    assert!(!codes(&declared).contains(&IngestCode::Merged), "{:?}", declared.findings);
    // The scan of that view alone, the half of it, and every seventh point of it, in the frame that a merged cloud has too.
    for (keep, every) in [(1.0, 1), (0.5, 1), (1.0, 7)] {
        let mut own = cell.file(3, LengthUnit::Millimetre, ScanFrame::Part, "part_4.ply");
        own.cloud.points.retain(|point| !point[0].is_nan());
        own.cloud.grid = None;
        let count = own.cloud.points.len();
        own.cloud.points.truncate((keep * count as f64) as usize);
        own.cloud.points = own.cloud.points.into_iter().step_by(every).collect();
        let taken = cell.ingest(vec![own]);
        let [scan] = &taken.scans[..] else { panic!("{keep}, {every}: {:?}", taken.findings) };
        assert_eq!((scan.scan.viewpoint, scan.is_approximate), (4, false), "{keep}, {every}: {:?}", taken.findings);
    }
}

/// At rims and bores, points of a thinned scan share cells of the image with nearer ones: these were taken for those of other views.
#[test]
fn a_scan_of_a_view_that_a_filter_thinned_to_a_point_each_so_many_mm_is_not_taken_as_merged() {
    let cell = Cell::new();
    let fine = Shots::of(&cell.mesh, 4);
    for (view, capture) in cell.captures.iter().enumerate() {
        let cloud = fine.cloud(&capture.part_from_scanner, 0.0, 1);
        for voxel_mm in [1.0, 1.5, 2.0] {
            let mut taken_voxels = std::collections::BTreeSet::new();
            let in_part = cloud.finite().map(|(_, point)| capture.part_from_scanner.point(&point));
            let thinned =
                in_part.filter(|point| taken_voxels.insert(point.coords.map(|mm| (mm / voxel_mm).floor() as i64).data.0));
            let points = thinned.map(|point| point.coords.map(|mm| mm as f32).into()).collect();
            let cloud = StoredCloud { points, ..StoredCloud::default() };
            let file = format!("part_{}.ply", capture.viewpoint);
            let taken = cell.ingest(vec![ScanFile { file, cloud, unit: None, frame: None, viewpoint: None }]);
            let [scan] = &taken.scans[..] else { panic!("{view}, {voxel_mm}: {:?}", taken.findings) };
            let told = (scan.scan.viewpoint, scan.is_approximate);
            assert_eq!(told, (capture.viewpoint, false), "{voxel_mm}: {:?}", taken.findings);
        }
    }
}

#[test]
fn a_merged_cloud_that_is_a_speck_beside_the_part_is_refused() {
    let cell = Cell::new();
    let mut speck = cell.file(0, LengthUnit::Millimetre, ScanFrame::Part, "all.ply");
    speck.cloud.points.retain(|point| !point[0].is_nan());
    speck.cloud.grid = None;
    speck.cloud.points.truncate(4_000);
    let around = cell.mesh.aabb();
    let top = Point3::new(around.centre().x, around.centre().y, around.max.z);
    // The shape of another part, a millimetre in size.
    for point in &mut speck.cloud.points {
        *point = [0, 1, 2].map(|axis| (top[axis] + 0.005 * f64::from(point[axis])) as f32);
    }
    let taken = cell.ingest(vec![speck]);
    assert_eq!(codes(&taken), [IngestCode::NoPart]);
    assert!(taken.scans.is_empty());
}

#[test]
fn order_of_files_and_grids_of_other_programs_do_not_matter() {
    let cell = Cell::new();
    let file = |view: usize| cell.file(view, LengthUnit::Metre, ScanFrame::Cloud, &format!("view_{}.pcd", view + 1));
    let there = cell.ingest((0..4).map(file).collect());
    let back = cell.ingest((0..4).rev().map(file).collect());
    assert_eq!(format!("{:?}", there.findings), format!("{:?}", back.findings));
    for (a, b) in there.scans.iter().zip(&back.scans) {
        assert_eq!(format!("{:?}", a.scan), format!("{:?}", b.scan));
    }
    // Without its grid, and read from a file.
    let mut bytes = Vec::new();
    let plain = PointCloud {
        points_mm: cell.clouds[0].finite().map(|(number, _)| cell.clouds[0].points_mm[number]).collect(),
        grid: None,
    };
    write_pcd(&plain, &mut bytes).expect("memory");
    let cloud = read(&bytes, &CloudLimits::default()).expect("a cloud").clouds.remove(0);
    let scattered = ScanFile { file: "1.pcd".into(), cloud, unit: None, frame: None, viewpoint: None };
    let taken = cell.ingest(vec![scattered]);
    assert_eq!(taken.scans[0].scan.scanner_cloud.grid, cell.clouds[0].grid);
    let (found, wanted) = (taken.scans[0].scan.scanner_cloud.finite().count(), plain.points_mm.len());
    assert!(found as f64 > 0.97 * wanted as f64, "{found} of {wanted}, {:?}", taken.scans[0].removed);
}

/// Cleans a cloud of the first view.
fn cleaned(cell: &Cell, cloud: PointCloud) -> (PointCloud, Removed) {
    let nearest = NearestFace::new(&cell.mesh);
    let world = IngestWorld { scanner: &cell.scanner, nearest: &nearest, captures: &cell.captures, fixtures: &[] };
    let mut removed = Removed::default();
    let kept = clean::clean(cloud, &cell.captures[0], &world, &CleanOptions::default(), &mut removed);
    (kept, removed)
}

#[test]
fn a_thin_sheet_and_a_thin_flange_on_the_plate_are_not_taken_for_the_plate() {
    let sheet = box_mesh([-50.0, -30.0, 0.0], [50.0, 30.0, 0.3]);
    let flange = Mesh::joined(&[sheet.clone(), box_mesh([-8.0, -8.0, 0.3], [8.0, 8.0, 12.0])]);
    for mesh in [sheet, flange] {
        let cell = Cell::holding(mesh, &Isometry3::identity());
        let before = cell.clouds[0].finite().count();
        let (kept, removed) = cleaned(&cell, cell.clouds[0].clone());
        let after = kept.finite().count();
        assert!(before > 1000 && after as f64 > 0.95 * before as f64, "{after} of {before}: {removed:?}");
    }
}

#[test]
fn points_of_the_bare_plate_in_place_of_a_sheet_are_removed_and_their_cells_named() {
    let cell = Cell::holding(box_mesh([-50.0, -30.0, 0.0], [50.0, 30.0, 0.3]), &Isometry3::identity());
    let scanner_from_plate = cell.captures[0].scanner_from(ScanFrame::Plate).expect("a plate");
    let mut cloud = cell.clouds[0].clone();
    for point in cloud.points_mm.iter_mut().filter(|point| !point[0].is_nan()) {
        let mut on_plate = scanner_from_plate.inverse() * Point3::from(point.map(f64::from));
        on_plate.z = 0.0;
        let moved = scanner_from_plate * on_plate;
        *point = [moved.x as f32, moved.y as f32, moved.z as f32];
    }
    let before = cloud.finite().count();
    let (kept, removed) = cleaned(&cell, cloud);
    assert_eq!((kept.finite().count(), removed.by_reason.get(&RemovedBecause::Plate)), (0, Some(&before)));
    assert_eq!(removed.cells.len(), before, "the cells tell losses that were filtered");
}

#[test]
fn the_zone_of_the_plate_cut_and_the_lack_of_a_grid_are_carried_with_a_scan() {
    let cell = Cell::new();
    let scanner_from_plate = cell.captures[1].scanner_from(ScanFrame::Plate).expect("a plate");
    let file = |file: &str| cell.file(1, LengthUnit::Millimetre, ScanFrame::Scanner, file);
    let taken = cell.ingest(vec![file("2.ply")]);
    let removed = &taken.scans[0].removed;
    let zone = removed.plate.expect("a plate");
    for (height_mm, margin_mm, is_held) in [(0.3, 0.0, true), (0.7, 0.0, false), (0.7, 0.5, true), (1.2, 0.5, false)] {
        let point_mm = scanner_from_plate * Point3::new(30.0, -20.0, height_mm);
        assert_eq!(zone.holds(&point_mm, margin_mm), is_held, "{height_mm} mm above the plate");
    }
    assert!(!removed.is_projected, "the file has the camera's grid");
    let mut bare = file("2.ply");
    bare.cloud.grid = None;
    assert!(cell.ingest(vec![bare]).scans[0].removed.is_projected);
}

/// A shiny part whose specks outnumber the points of its surface was taken for a sparse one, and kept all specks.
#[test]
fn specks_around_a_surface_are_removed_though_they_are_most_of_the_points() {
    let cell = Cell::new();
    let mut cloud = cell.clouds[0].clone();
    let columns = cloud.grid.expect("a grid").columns;
    let on_surface: Vec<usize> = cloud.finite().map(|(number, _)| number).collect();
    let is_lone = |number: &usize| (number % columns).is_multiple_of(2) && (number / columns).is_multiple_of(2);
    let is_empty = |number: &usize| cloud.points_mm[*number][0].is_nan();
    let lone: Vec<usize> = (0..cloud.points_mm.len()).filter(is_lone).filter(is_empty).collect();
    // Three specks for two points of the surface, all of them nearer than it.
    let specks = lone.len().min(on_surface.len() * 3 / 2);
    let surface = specks * 2 / 3;
    on_surface[surface..].iter().for_each(|number| cloud.points_mm[*number] = [f32::NAN; 3]);
    let nearest = cloud.finite().map(|(_, point)| point).min_by(|a, b| a.z.total_cmp(&b.z)).expect("a point");
    let speck: [f32; 3] = (nearest.coords * 0.98).map(|value| value as f32).into();
    lone[..specks].iter().for_each(|number| cloud.points_mm[*number] = speck);
    let (kept, removed) = cleaned(&cell, cloud);
    let isolated = removed.by_reason.get(&RemovedBecause::Isolated).copied().unwrap_or_default();
    assert!(surface > 200 && !removed.is_sparse, "{surface}: {:?}", removed.by_reason);
    assert!(isolated as f64 > 0.8 * specks as f64, "{isolated} of {specks}");
    let after = kept.finite().count();
    assert!(after as f64 > 0.8 * surface as f64 && (after as f64) < 1.3 * surface as f64, "{after} of {surface}");
}

/// Registration asks the neighbours in the grid of each point which way the surface around it looks.
#[test]
fn points_of_a_cloud_without_a_grid_get_neighbours_in_one() {
    let cell = Cell::new();
    let mut bare = cell.file(1, LengthUnit::Millimetre, ScanFrame::Scanner, "2.ply");
    bare.cloud.grid = None;
    let taken = cell.ingest(vec![bare]);
    let cloud = &taken.scans[0].scan.scanner_cloud;
    let grid = cloud.grid.expect("a grid");
    let is_there = |number: usize| cloud.points_mm.get(number).is_some_and(|point| !point[0].is_nan());
    let has_element = |number: usize| is_there(number + 1) && is_there(number + grid.columns);
    let found = cloud.finite().filter(|(number, _)| has_element(*number)).count();
    assert!(found as f64 > 0.5 * cloud.finite().count() as f64, "{found} of {}", cloud.finite().count());
}

/// Each point of a cloud with one in so many millimetres was an island, and no point of a good part was left.
#[test]
fn a_sparse_view_keeps_its_points_and_a_few_specks_are_removed() {
    let cell = Cell::new();
    let left = |is_kept: &dyn Fn(usize, usize) -> bool| {
        let mut cloud = cell.clouds[0].clone();
        let columns = cloud.grid.expect("a grid").columns;
        let points = cloud.points_mm.iter_mut().enumerate();
        points.filter(|(number, _)| !is_kept(number % columns, number / columns)).for_each(|(_, point)| *point = [f32::NAN; 3]);
        let before = cloud.finite().count();
        let (kept, removed) = cleaned(&cell, cloud);
        (before, kept.finite().count(), removed.by_reason.get(&RemovedBecause::Isolated).copied())
    };
    let (before, after, isolated) = left(&|column, row| column.is_multiple_of(2) && row.is_multiple_of(2));
    assert!(before > 200 && after as f64 > 0.8 * before as f64 && isolated.is_none(), "{after} of {before}: {isolated:?}");
    let (before, after, isolated) = left(&|column, row| column.is_multiple_of(20) && row.is_multiple_of(20));
    assert!((1..100).contains(&before) && after == 0 && isolated.is_some(), "{after} of {before}: {isolated:?}");
    let mut file = cell.file(0, LengthUnit::Millimetre, ScanFrame::Scanner, "1.ply");
    let columns = file.cloud.grid.expect("a grid").columns;
    for (number, point) in file.cloud.points.iter_mut().enumerate() {
        if !((number % columns).is_multiple_of(2) && (number / columns).is_multiple_of(2)) {
            *point = [f32::NAN; 3];
        }
    }
    let taken = cell.ingest(vec![file]);
    assert_eq!((codes(&taken), taken.scans.len()), (vec![IngestCode::SparseCloud], 1), "{:?}", taken.findings);
    assert!(taken.findings[0].longest_mm.is_some_and(|mm| (0.5..2.0).contains(&mm)), "{:?}", taken.findings);
}

/// Walls and edges of a cloud with a point in two millimetres were lost, and nothing told of its spacing.
#[test]
fn a_cloud_is_told_as_thinned_from_a_millimetre_between_its_points_on() {
    let code = |is_projected: bool, is_sparse: bool, cell_mm: f64| {
        super::thinned_code(&Removed { is_projected, is_sparse, ..Removed::default() }, Some(cell_mm))
    };
    let thinned = Some(IngestCode::ThinnedCloud);
    assert_eq!([0.6, 1.0, 1.7].map(|mm| code(true, false, mm)), [None, thinned, thinned]);
    assert_eq!(code(false, false, 1.7), None, "the camera's grid tells which of its pixels have a point");
    assert_eq!(code(true, true, 1.7), Some(IngestCode::SparseCloud));
    assert_eq!(super::thinned_code(&Removed { is_projected: true, ..Removed::default() }, None), None);
}

#[test]
fn plate_depth_islands_and_filled_holes_are_cut_and_counted() {
    let cell = Cell::new();
    let mut file = cell.file(0, LengthUnit::Millimetre, ScanFrame::Scanner, "1.ply");
    let grid = file.cloud.grid.expect("a grid");
    let empty: Vec<usize> = (0..file.cloud.points.len()).filter(|cell| file.cloud.points[*cell][0].is_nan()).collect();
    // A speck, a far point, and an island of the plate.
    let free = |number: usize| empty[number * empty.len() / 10];
    file.cloud.points[free(1)] = [0.0, 0.0, 480.0];
    file.cloud.points[free(2)] = [0.0, 0.0, 4800.0];
    let scanner_from_plate = cell.captures[0].scanner_from(ScanFrame::Plate).expect("a plate");
    for step in 0..40 {
        let point = scanner_from_plate * Point3::new(100.0 + f64::from(step), 0.0, 0.0);
        file.cloud.points[free(3) + step as usize % grid.columns] = [point.x as f32, point.y as f32, point.z as f32];
    }
    let before = file.cloud.points.iter().filter(|point| !point[0].is_nan()).count();
    let taken = cell.ingest(vec![file]);
    let removed = &taken.scans[0].removed.by_reason;
    assert_eq!(removed.get(&RemovedBecause::Depth), Some(&1), "{removed:?}");
    assert!(removed.get(&RemovedBecause::Plate).is_some_and(|count| *count >= 40), "{removed:?}");
    assert!(removed.contains_key(&RemovedBecause::Isolated), "{removed:?}");
    let after = taken.scans[0].scan.scanner_cloud.finite().count();
    assert_eq!(after + taken.scans[0].removed.total(), before);
    assert!(after as f64 > 0.95 * before as f64, "{after} of {before}: {removed:?}");

    let squares = (0..9).flat_map(|row| (0..9).map(move |column| row * 10 + column));
    let mut mesh = StoredCloud {
        points: (0..100).map(|place| [(place % 10) as f32, (place / 10) as f32, 0.0]).collect(),
        faces: squares.flat_map(|a: u32| [[a, a + 1, a + 10], [a + 1, a + 11, a + 10]]).collect(),
        ..StoredCloud::default()
    };
    mesh.points.push([60.0, 0.0, 0.0]);
    mesh.faces.push([9, 100, 99]);
    let mut removed = Removed::default();
    let longest = holes::drop_filled(&mut mesh, &mut removed).expect("a long triangle");
    assert!(longest > 50.0 && removed.by_reason.get(&RemovedBecause::FilledHole) == Some(&1) && mesh.points[100][0].is_nan());
    assert_eq!(mesh.points.iter().filter(|point| point[0].is_nan()).count(), 1);
}

/// An organised cloud of 40 × 40 points, 1 mm apart at 500 mm, whose depths are those of rays through columns and rows.
fn coarse_cloud(depth_mm: impl Fn(usize, usize, &Vector3<f64>) -> f64) -> (PointCloud, CloudGrid) {
    let grid = CloudGrid { columns: 40, rows: 40 };
    let point = |cell: usize| {
        let (column, row) = (cell % grid.columns, cell / grid.columns);
        let ray = Vector3::new(0.002 * (column as f64 - 19.5), 0.002 * (row as f64 - 19.5), 1.0);
        let point = ray * depth_mm(column, row, &ray);
        [point.x as f32, point.y as f32, point.z as f32]
    };
    (PointCloud { points_mm: (0..grid.columns * grid.rows).map(point).collect(), grid: Some(grid) }, grid)
}

fn flagged(flags: &[bool]) -> Vec<usize> {
    (0..flags.len()).filter(|cell| flags[*cell]).collect()
}

/// Depths between those of both neighbours were taken for mixed ones, and each such point for an island.
#[test]
fn a_steep_wall_that_is_sampled_coarsely_keeps_all_its_points() {
    let options = CleanOptions::default();
    for (incidence_deg, turn_deg) in [(80.0_f64, 0.0_f64), (82.0, 20.0), (82.0, 90.0), (83.5, 0.0), (83.5, 180.0)] {
        let ((sin, cos), (down, right)) = (incidence_deg.to_radians().sin_cos(), turn_deg.to_radians().sin_cos());
        let normal = Vector3::new(sin * right, sin * down, -cos);
        // Between a near surface and a far one, both across the line of sight.
        let (cloud, grid) = coarse_cloud(|_, _, ray| {
            let depth_mm = -500.0 * cos / normal.dot(ray);
            if depth_mm < 0.0 { 550.0 } else { depth_mm.clamp(450.0, 550.0) }
        });
        assert_eq!(flagged(&clean::mixed_pixels(&cloud, grid, &options)), [0_usize; 0], "{incidence_deg}°, {turn_deg}°");
    }
    // Without other surface, and with no two neighbours within a step.
    let (cloud, grid) = coarse_cloud(|_, _, ray| 500.0 / (1.0 - 8.0 * ray.x - 8.0 * ray.y));
    assert_eq!(flagged(&clean::islands(&cloud, grid, &options)), [0_usize; 0]);
}

#[test]
fn points_between_the_surfaces_of_a_step_are_mixed_be_they_one_or_two_wide_or_along_a_slanted_edge() {
    let (near_mm, far_mm, options) = (480.0_f64, 504.0_f64, CleanOptions::default());
    // Columns of the edge at a row, and pixels over which depths are mixed.
    for (slant, width) in [(0.0_f64, 1.0_f64), (0.0, 2.0), (0.2, 1.0), (1.0, 1.0)] {
        let share = |column: usize, row: usize| {
            let edge = if slant > 0.0 { 3.45 + slant * row as f64 } else { 15.0 };
            let (place, first) = (column as f64, edge.floor());
            if slant > 0.0 {
                // The part of the pixel that is beyond the edge.
                return (place + 1.0 - edge).clamp(0.0, 1.0);
            }
            ((place - first + 1.0) / (width + 1.0)).clamp(0.0, 1.0)
        };
        let (cloud, grid) = coarse_cloud(|column, row, _| near_mm + (far_mm - near_mm) * share(column, row));
        let found = clean::mixed_pixels(&cloud, grid, &options);
        let inner = |cell: &usize| (1..39).contains(&(cell % 40)) && (1..39).contains(&(cell / 40));
        let is_between = |cell: &usize| {
            let depth_mm = f64::from(cloud.points_mm[*cell][2]);
            depth_mm - near_mm > options.step_mm && far_mm - depth_mm > options.step_mm
        };
        let wanted: Vec<usize> = (0..cloud.points_mm.len()).filter(|cell| inner(cell) && is_between(cell)).collect();
        assert!(wanted.len() >= 20, "{slant}, {width}: {}", wanted.len());
        assert!(wanted.iter().all(|cell| found[*cell]), "{slant}, {width}: {:?}", flagged(&found));
        let pure = (0..cloud.points_mm.len()).filter(inner).filter(|cell| [0.0, 1.0].contains(&share(cell % 40, cell / 40)));
        assert_eq!(pure.filter(|cell| found[*cell]).count(), 0, "{slant}, {width}");
    }
}
