use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::locate::{LocateOptions, NotLocated, PartPlace, locate, place};
use super::*;
use crate::geometry::demo_parts::{base, figurine};
use crate::geometry::{Mesh, ScannerFrame};
use crate::inspection::shots::{Shots, motion, motion_of};
use crate::testing::{box_mesh, cylinder_mesh};

/// Largest distance by which two poses part the corners of the mesh's box.
fn corner_mm(mesh: &Mesh, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let around = mesh.aabb();
    let ends = [around.min, around.max];
    let corner = |index: usize| Point3::new(ends[index & 1].x, ends[index >> 1 & 1].y, ends[index >> 2].z);
    (0..8).map(|index| (a * corner(index) - b * corner(index)).norm()).fold(0.0, f64::max)
}

/// States all poses as if the part were moved.
fn moved(scans: &[ViewScan], stated_from_mesh: &Isometry3<f64>) -> Vec<ViewScan> {
    let moved = |scan: &ViewScan| {
        let part_from_scanner: Pose<Part, ScannerFrame> = Pose::claim(stated_from_mesh * scan.part_from_scanner.isometry());
        ViewScan { part_from_scanner, ..scan.clone() }
    };
    scans.iter().map(moved).collect()
}

fn parts() -> [(&'static str, Mesh); 2] {
    [("base", base(20_000).expect("a base")), ("figurine", figurine(20_000).expect("a figurine"))]
}

/// Row I1.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_part_that_lies_off_by_a_degree_and_a_millimetre_is_found_to_micrometres() {
    for (name, mesh) in parts() {
        let shots = Shots::of(&mesh, 16);
        let scans = shots.scans(&shots.poses(8), 0.0, |_| Isometry3::identity());
        let nearest = NearestFace::new(&mesh);
        for seed in 0..3 {
            let off = motion_of(seed, 1.0, 1.0);
            let found = register(&moved(&scans, &off), &nearest, &[], &RegistrationOptions::default());
            let error = corner_mm(&mesh, found.mesh_from_stated.isometry(), &off.inverse());
            println!("{name}, draw {seed}: worst corner {error:.5} mm, inliers {:.3}", found.inlier_share);
            assert!(error <= 0.005, "{name} {seed}: {error}");
            assert!(found.views.iter().all(|view| view.is_in_prior));
        }
    }
}

/// Row I4, first half: with errors of the poses alone.
#[test]
fn a_view_is_never_worse_than_its_stated_pose_and_its_covariance_is_true() {
    let (mut before, mut after, mut squares, mut count) = (0.0_f64, 0.0_f64, 0.0, 0.0);
    for (name, mesh) in parts() {
        let shots = Shots::of(&mesh, 16);
        let poses = shots.poses(9);
        let scans = shots.scans(&poses, 0.012, |view| motion(view + 40, 0.05, 0.2));
        let nearest = NearestFace::new(&mesh);
        let options = RegistrationOptions { moves_part: false, ..RegistrationOptions::default() };
        let found = register(&scans, &nearest, &[], &options);
        for ((scan, view), truth) in scans.iter().zip(&found.views).zip(&poses) {
            let error = |pose: &Pose<Part, ScannerFrame>| log(&(truth.isometry().inverse() * pose.isometry()));
            let (stated, registered) = (error(&scan.part_from_scanner), error(&view.part_from_scanner));
            let [stated_mm, registered_mm] = [&scan.part_from_scanner, &view.part_from_scanner]
                .map(|pose| corner_mm(&mesh, &(truth.isometry() * pose.isometry().inverse()), &Isometry3::identity()));
            (before, after) = (before.max(stated_mm), after.max(registered_mm));
            let prior = prior_weight(None, &options);
            let whitened = |twist: &Twist| (twist.transpose() * prior * twist)[0].sqrt();
            assert!(whitened(&registered) <= whitened(&stated).max(1.0), "{name} {}", scan.viewpoint);
            let inverse = view.covariance.try_inverse().expect("a covariance");
            (squares, count) = (squares + (registered.transpose() * inverse * registered)[0], count + 1.0);
        }
    }
    println!(
        "worst corner of {count} views: stated {before:.3}, registered {after:.4} mm; mean NEES {:.2} of 6",
        squares / count
    );
    assert!(after < 0.15 * before, "{before} {after}");
    // Cells of 5 mm count as one observation, so that the covariance is on the safe side where points are independent.
    assert!(squares / count < 8.0, "{}", squares / count);
}

#[test]
fn a_view_far_off_or_of_few_points_keeps_its_pose_and_says_so() {
    let mesh = base(20_000).expect("a base");
    let shots = Shots::of(&mesh, 16);
    let poses = shots.poses(5);
    let mut scans = shots.scans(&poses, 0.0, |view| if view == 2 { motion_of(9, 0.4, 1.5) } else { Isometry3::identity() });
    let few = scans[4].scanner_cloud.points_mm.iter_mut().filter(|point| !point[0].is_nan());
    few.skip(300).for_each(|point| *point = [f32::NAN; 3]);
    let options = RegistrationOptions { moves_part: false, ..RegistrationOptions::default() };
    let found = register(&scans, &NearestFace::new(&mesh), &[], &options);
    let kept: Vec<Option<KeptPose>> = found.found.iter().map(|view| view.kept_pose).collect();
    assert_eq!(kept, [None, None, Some(KeptPose::PoseOutOfPrior), None, Some(KeptPose::FewPoints)], "{:?}", found.found);
    assert!(!found.views[2].is_in_prior && found.views[2].part_from_scanner == scans[2].part_from_scanner);
    // What it was found to be off is part of its uncertainty.
    let (off, along) = (&found.found[2].correction, found.found[2].correction.normalize());
    assert!((along.transpose() * found.views[2].covariance * along)[0] >= off.norm_squared(), "{off}");
    // The correction that was not taken is the right one all the same, but for what the prior holds back.
    let fitted = scans[2].part_from_scanner.isometry() * exp(&found.found[2].correction);
    assert!(corner_mm(&mesh, &(fitted * poses[2].isometry().inverse()), &Isometry3::identity()) < 0.1);
}

/// A base with a wall and bosses, whose wall is thicker by so much on one side.
fn with_wall(thicker_mm: f64) -> Mesh {
    Mesh::joined(&[
        box_mesh([-50.0, -35.0, 0.0], [50.0, 35.0, 10.0]),
        box_mesh([30.0, -30.0, 9.9], [33.0 + thicker_mm, 30.0, 45.0]),
        box_mesh([-30.0, -20.0, 9.9], [-18.0, -8.0, 25.0]),
        box_mesh([-10.0, 12.0, 9.9], [4.0, 24.0, 22.0]),
    ])
}

/// Cells that are off by many standard deviations of the others once outvoted the prior, and pulled views whose poses are exact by as much.
#[test]
fn a_wall_that_is_too_thick_pulls_no_view_with_it() {
    let (mesh, built) = (with_wall(0.0), with_wall(1.0));
    let (nearest, shots) = (NearestFace::new(&mesh), Shots::of(&built, 8));
    let scans = shots.scans(&shots.poses(6), 0.01, |_| Isometry3::identity());
    let found = register(&scans, &nearest, &[], &RegistrationOptions::default());
    for (scan, view) in scans.iter().zip(&found.views) {
        let moved = view.part_from_scanner.isometry() * scan.part_from_scanner.isometry().inverse();
        let off_mm = corner_mm(&mesh, &moved, &Isometry3::identity());
        println!("view {}: {off_mm:.3} mm", scan.viewpoint);
        assert!(off_mm < 0.2, "view {}: {off_mm}", scan.viewpoint);
    }
}

/// The pose of such a part was stated to be known exactly.
#[test]
fn a_part_that_no_view_holds_is_stated_to_be_open_in_every_freedom() {
    let mesh = base(20_000).expect("a base");
    let shots = Shots::of(&mesh, 16);
    let mut scans = shots.scans(&shots.poses(2), 0.0, |_| Isometry3::identity());
    for scan in &mut scans {
        let there = scan.scanner_cloud.points_mm.iter_mut().filter(|point| !point[0].is_nan());
        there.skip(300).for_each(|point| *point = [f32::NAN; 3]);
    }
    let of = |moves_part: bool| {
        let options = RegistrationOptions { moves_part, ..RegistrationOptions::default() };
        register(&scans, &NearestFace::new(&mesh), &[], &options)
    };
    let (found, fixed) = (of(true), of(false));
    assert_eq!(found.not_found(), Some(PartNotFound::FewPoints), "{:?}", found.found);
    let (turns_deg, shifts_mm) = (found.sd.fixed_rows::<3>(0).map(f64::to_degrees), found.sd.fixed_rows::<3>(3));
    assert!(turns_deg.min() > 1.0 && shifts_mm.min() >= 5.0, "{}", found.sd);
    assert!(fixed.sd.amax() < 1e-9, "it was not to be moved: {}", fixed.sd);
}

/// Views of swapped files were taken for a part that lies elsewhere, where one of them fitted by chance.
#[test]
fn a_part_on_which_less_than_half_of_the_points_lie_is_not_found() {
    let one_holds = [None, Some(KeptPose::FewInliers), Some(KeptPose::FewInliers)];
    assert_eq!(why_not_found(0.373, one_holds), Some(PartNotFound::FewInliers));
    assert_eq!(why_not_found(0.5, one_holds), None, "half of them do");
    assert_eq!(why_not_found(0.9, [Some(KeptPose::PoseOutOfPrior)]), None, "its points hold the part");
    assert_eq!(why_not_found(1.0, [Some(KeptPose::FewPoints); 2]), Some(PartNotFound::FewPoints));
    assert_eq!(why_not_found(0.55, [Some(KeptPose::FewInliers); 2]), Some(PartNotFound::FewInliers));
    assert_eq!(why_not_found(0.0, []), Some(PartNotFound::FewInliers));
}

/// Scans of which no point was left were told as those of another part.
#[test]
fn scans_without_a_point_are_too_few_points_and_not_of_another_part() {
    let mesh = base(20_000).expect("a base");
    let shots = Shots::of(&mesh, 16);
    let mut scans = shots.scans(&shots.poses(2), 0.0, |_| Isometry3::identity());
    scans.iter_mut().flat_map(|scan| &mut scan.scanner_cloud.points_mm).for_each(|point| *point = [f32::NAN; 3]);
    let found = register(&scans, &NearestFace::new(&mesh), &[], &RegistrationOptions::default());
    assert_eq!(found.not_found(), Some(PartNotFound::FewPoints), "{:?}", found.found);
    assert!(!found.fits(), "nothing is learned");
}

/// Views turned each about its own axis gave a search a place with 52 % of the points on the part, and the part was judged there.
#[test]
fn a_place_that_was_searched_for_needs_six_tenths_of_the_points_and_a_view_that_agrees() {
    let one_agrees = [None, Some(KeptPose::FewInliers), Some(KeptPose::FewInliers)];
    let none_does = [Some(KeptPose::PoseOutOfPrior), Some(KeptPose::FewInliers)];
    assert_eq!(why_searched_not_found(0.519, one_agrees), Some(PartNotFound::FewInliers));
    assert_eq!(why_searched_not_found(0.65, one_agrees), None);
    assert_eq!(why_searched_not_found(0.65, none_does), Some(PartNotFound::FewInliers));
    assert_eq!(why_searched_not_found(0.95, none_does), None, "the poses are off, and hardly any point lies elsewhere");
    let stale = [Some(KeptPose::PoseOutOfPrior); 5];
    assert_eq!(why_searched_not_found(0.8, stale), None, "a stale calibration, and a fifth of the points on clamps");
    assert_eq!(why_searched_not_found(0.7, stale), Some(PartNotFound::FewInliers));
    for share in [0.519, 0.45] {
        assert_eq!(why_searched_not_found(share, stale), Some(PartNotFound::FewInliers), "turned views");
    }
    assert_eq!(why_searched_not_found(1.0, [Some(KeptPose::FewPoints); 2]), Some(PartNotFound::FewPoints));
}

/// A warped part that was put down 4 mm off, with 55 % of the points on it, was refused as one that had been searched for.
#[test]
fn a_place_that_was_refined_from_the_stated_one_needs_half_of_the_points() {
    let mesh = base(20_000).expect("a base");
    let shots = Shots::of(&mesh, 16);
    let off = Isometry3::translation(3.2, -2.4, 0.0);
    let scans = moved(&shots.scans(&shots.poses(4), 0.0, |_| Isometry3::identity()), &off);
    let nearest = NearestFace::new(&mesh);
    let found = place(&scans, &nearest, &LocateOptions::default());
    let PartPlace::Elsewhere(found) = found else { panic!("{found:?}") };
    assert!(!found.is_searched, "{found:?}");
    assert!(locate(&scans, &nearest, &LocateOptions::default()).best.is_searched);
    let of = |is_searched: bool| {
        let options = RegistrationOptions { start: found.mesh_from_stated, is_searched, ..RegistrationOptions::default() };
        let registered = register(&scans, &nearest, &[], &options);
        [0.45, 0.55, 0.65].map(|inlier_share| ScanRegistration { inlier_share, ..registered.clone() }.not_found())
    };
    let few = Some(PartNotFound::FewInliers);
    assert_eq!((of(false), of(true)), ([few, None, None], [few, few, None]));
    // A refinement that ran 16° away was taken for the stated place.
    let far = moved(&shots.scans(&shots.poses(4), 0.0, |_| Isometry3::identity()), &Isometry3::translation(8.0, 0.0, 0.0));
    let far = place(&far, &nearest, &LocateOptions::default());
    assert!(matches!(&far, PartPlace::Elsewhere(far) if far.is_searched), "{far:?}");
}

#[test]
fn scans_that_were_left_out_count_against_a_place_that_was_searched_for() {
    let mesh = base(20_000).expect("a base");
    let shots = Shots::of(&mesh, 16);
    let off = motion_of(2, 1.0, 1.0);
    let scans = moved(&shots.scans(&shots.poses(3), 0.0, |_| Isometry3::identity()), &off);
    let points: usize = scans.iter().map(|scan| scan.scanner_cloud.finite().count()).sum();
    let nearest = NearestFace::new(&mesh);
    let of = |start: Pose<Part, Part>, stray_points: usize| {
        let options = RegistrationOptions { start, stray_points, ..RegistrationOptions::default() };
        register(&scans, &nearest, &[], &options).not_found()
    };
    let searched: Pose<Part, Part> = Pose::claim(off.inverse());
    assert_eq!(of(searched, 0), None);
    assert_eq!(of(searched, 2 * points), Some(PartNotFound::FewInliers), "two thirds of all points lie elsewhere");
    assert_eq!(of(Pose::identity(), 2 * points), None, "it lies where it was stated");
}

#[test]
fn scans_of_another_part_do_not_fit_and_their_own_do() {
    let (own, other) = (base(20_000).expect("a base"), box_mesh([0.0; 3], [30.0, 20.0, 10.0]));
    let shots = Shots::of(&own, 16);
    let scans = shots.scans(&shots.poses(3), 0.0, |_| Isometry3::identity());
    let of = |mesh: &Mesh| register(&scans, &NearestFace::new(mesh), &[], &RegistrationOptions::default());
    let (found, lost) = (of(&own), of(&other));
    assert!(found.fits() && found.not_found().is_none(), "{:?}", found.found);
    assert!(!lost.fits(), "{} of the points, {:?}", lost.inlier_share, lost.found);
}

/// Row I12.
#[test]
fn one_thread_and_many_find_the_same_bits() {
    let mesh = figurine(20_000).expect("a figurine");
    let shots = Shots::of(&mesh, 24);
    let scans = moved(&shots.scans(&shots.poses(4), 0.01, |view| motion(view, 0.05, 0.2)), &motion_of(1, 1.0, 1.0));
    let found = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| format!("{:?}", register(&scans, &NearestFace::new(&mesh), &[], &RegistrationOptions::default())))
    };
    assert_eq!(found(1), found(3));
}

fn located(mesh: &Mesh, seeds: std::ops::Range<u64>, deg: f64, mm: f64) -> [usize; 3] {
    let shots = Shots::of(mesh, 32);
    let scans = shots.scans(&shots.poses(6), 0.0, |_| Isometry3::identity());
    let nearest = NearestFace::new(mesh);
    let mut counts = [0; 3];
    for seed in seeds {
        let off = motion_of(seed + 100, deg, mm);
        let found = locate(&moved(&scans, &off), &nearest, &LocateOptions::default());
        let error = corner_mm(mesh, found.best.mesh_from_stated.isometry(), &off.inverse());
        let kind = if found.refused.is_some() {
            1
        } else if error < 0.5 {
            0
        } else {
            2
        };
        counts[kind] += 1;
        if kind > 0 {
            println!("draw {seed}: {error:.2} mm, {found:?}");
        }
    }
    counts
}

/// Row I2, a few draws; `basin_measured_by_hand` has them all.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_part_five_degrees_and_ten_millimetres_off_is_found_or_said_to_be_ambiguous() {
    for (name, mesh) in parts() {
        let [right, refused, wrong] = located(&mesh, 0..2, 5.0, 10.0);
        println!("{name}: {right} right, {refused} ambiguous, {wrong} wrong");
        assert_eq!(wrong, 0, "{name}");
        assert!(right >= 1, "{name}");
    }
    let [right, _, wrong] = located(&figurine(20_000).expect("a figurine"), 5..6, 170.0, 200.0);
    assert_eq!((right, wrong), (1, 0));
}

/// Row I2 in full, over data meshes where they are: run with `--ignored --nocapture` and optimisation.
#[test]
#[ignore = "a measurement, run by hand"]
fn basin_measured_by_hand() {
    for (name, mesh) in parts().into_iter().chain(data_parts()) {
        for (deg, mm) in [(5.0, 10.0), (180.0, 50.0)] {
            let [right, refused, wrong] = located(&mesh, 0..20, deg, mm);
            println!("{name}, {deg}° {mm} mm: {right} right, {refused} ambiguous, {wrong} wrong");
        }
    }
}

/// Meshes of the test data, whose folder the environment names.
fn data_parts() -> Vec<(&'static str, Mesh)> {
    let Some(folder) = std::env::var_os("VANTAGE_SHARED_DATA") else { return Vec::new() };
    let names = [
        "armadillo_52k_binary.stl",
        "gearbox_output_housing_16k.stl",
        "piboy_rear_case_15k_binary.stl",
        "ribbed_shaft_7k_ascii.stl",
    ];
    let read = |name: &&'static str| {
        let bytes = std::fs::read(std::path::Path::new(&folder).join("meshes").join(name)).ok()?;
        let unit = Some(crate::geometry::LengthUnit::Millimetre);
        Some((*name, crate::geometry::mesh_io::read(&bytes, unit, &Default::default()).ok()?.mesh))
    };
    names.iter().filter_map(read).collect()
}

#[test]
fn symmetric_parts_and_absent_ones_are_said_to_be_so() {
    let block = box_mesh([-30.0, -20.0, -10.0], [30.0, 20.0, 10.0]);
    let found = locate_in(&block, &block);
    assert_eq!((found.refused, found.is_symmetric), (Some(NotLocated::AmbiguousPose), true), "{found:?}");
    let cylinder = cylinder_mesh(20.0, 60.0, 48);
    let found = locate_in(&cylinder, &cylinder);
    assert_eq!((found.refused, found.is_symmetric), (Some(NotLocated::AmbiguousPose), true), "{found:?}");
    let found = locate_in(&figurine(8_000).expect("a figurine"), &cylinder_mesh(9.0, 300.0, 24));
    assert_eq!(found.refused, Some(NotLocated::NoPart), "{found:?}");
}

/// Nearly all of such a shaft is symmetric, and it was said to be so.
#[test]
fn a_shaft_with_a_small_key_is_ambiguous_and_not_symmetric() {
    let shaft = with_boss([28.0, -3.0, 25.0], [33.0, 3.0, 33.0]);
    let found = locate_in(&shaft, &shaft);
    assert_eq!((found.refused, found.is_symmetric), (Some(NotLocated::AmbiguousPose), false), "{found:?}");
}

fn locate_in(scanned: &Mesh, wanted: &Mesh) -> super::locate::Location {
    let shots = Shots::of(scanned, 32);
    let scans = shots.scans(&shots.poses(6), 0.0, |_| Isometry3::identity());
    locate(&moved(&scans, &motion_of(3, 2.0, 3.0)), &NearestFace::new(wanted), &LocateOptions::default())
}

/// A cylinder with a boss that reaches into it.
fn with_boss(min_mm: [f64; 3], max_mm: [f64; 3]) -> Mesh {
    Mesh::joined(&[cylinder_mesh(30.0, 60.0, 96), box_mesh(min_mm, max_mm)])
}

fn with_side_boss() -> Mesh {
    with_boss([24.0, -5.0, 25.0], [36.0, 5.0, 37.0])
}

/// A turn about the axis of a part that stands on its origin, then a tilt and a shift.
fn turned_about_z(turn_deg: f64, tilt_deg: f64, shift_mm: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * turn_deg.to_radians());
    let tilt = UnitQuaternion::from_scaled_axis(Vector3::y() * tilt_deg.to_radians());
    Isometry3::from_parts(Vector3::new(shift_mm, -0.5 * shift_mm, 0.0).into(), tilt * turn)
}

/// Place of a part in scans that state it to lie elsewhere.
fn place_of(mesh: &Mesh, scans: &[ViewScan], stated_from_mesh: &Isometry3<f64>) -> PartPlace {
    place(&moved(scans, stated_from_mesh), &NearestFace::new(mesh), &LocateOptions::default())
}

fn scans_around(mesh: &Mesh, step_px: u32) -> Vec<ViewScan> {
    let shots = Shots::of(mesh, step_px);
    shots.scans(&shots.poses(6), 0.01, |_| Isometry3::identity())
}

/// Nearly all points lie on such a part in every turn about its axis: it was stated in a wrong one, with a small uncertainty.
#[test]
fn a_nearly_round_part_is_found_in_its_turn_or_said_to_be_ambiguous() {
    for (mesh, turns_deg, is_told) in
        [(with_side_boss(), [23.0, 137.0], true), (with_boss([14.0, -5.0, 56.0], [24.0, 5.0, 68.0]), [60.0, 137.0], false)]
    {
        let scans = scans_around(&mesh, 32);
        for (turn_deg, tilt_deg, shift_mm, is_told) in [(turns_deg[0], 0.0, 0.0, is_told), (turns_deg[1], 4.0, 6.0, false)] {
            let off = turned_about_z(turn_deg, tilt_deg, shift_mm);
            let found = match place_of(&mesh, &scans, &off) {
                PartPlace::Elsewhere(found) => found,
                PartPlace::AsStated => panic!("{turn_deg}°: as stated"),
                PartPlace::Unknown(found) => {
                    assert_eq!(found.refused, Some(NotLocated::AmbiguousPose), "{turn_deg}°: {found:?}");
                    assert!(!is_told, "{turn_deg}°: the boss tells: {found:?}");
                    continue;
                }
            };
            let options = RegistrationOptions { start: found.mesh_from_stated, ..RegistrationOptions::default() };
            let registered = register(&moved(&scans, &off), &NearestFace::new(&mesh), &[], &options);
            let error_deg = (registered.mesh_from_stated.isometry() * off).rotation.angle().to_degrees();
            let sd_deg = registered.sd.fixed_rows::<3>(0).norm().to_degrees();
            assert!(error_deg <= 4.0 * sd_deg + 0.05, "{turn_deg}°: off by {error_deg}°, ± {sd_deg}°");
        }
    }
}

#[test]
fn a_nearly_round_part_that_lies_as_stated_is_said_to_do_so() {
    let mesh = with_side_boss();
    let found = place_of(&mesh, &scans_around(&mesh, 32), &Isometry3::identity());
    assert_eq!(found, PartPlace::AsStated);
}

/// Half of it was scanned, and the boss may be anywhere on the other one.
#[test]
fn a_nearly_round_part_elsewhere_of_which_no_scan_shows_the_turn_is_said_to_be_ambiguous() {
    let mesh = with_side_boss();
    let mut scans = scans_around(&mesh, 32);
    for scan in &mut scans {
        let part_from_scanner = scan.part_from_scanner;
        let is_hidden = |point: &[f32; 3]| part_from_scanner.point(&Point3::from(point.map(f64::from))).x > 0.0;
        let hidden = scan.scanner_cloud.points_mm.iter_mut().filter(|point| is_hidden(point));
        hidden.for_each(|point| *point = [f32::NAN; 3]);
    }
    let found = place_of(&mesh, &scans, &turned_about_z(20.0, 3.0, 6.0));
    assert!(matches!(&found, PartPlace::Unknown(found) if found.refused == Some(NotLocated::AmbiguousPose)), "{found:?}");
}

/// A refinement slides about the axis where no point tells the turn: all scans of a part beside its place were dropped.
#[test]
fn a_nearly_round_part_beside_its_place_is_found_though_its_boss_is_missing_or_in_no_view() {
    let mesh = with_side_boss();
    // Rounder than the mesh, so that no facets hold it. Its second view looks from where the boss would be hidden.
    let scans = scans_around(&cylinder_mesh(30.0, 60.0, 720), 32);
    for (name, scans, shift_mm) in
        [("missing", &scans[..], 1.34), ("missing", &scans[..], 3.0), ("not in view", &scans[1..2], 3.0)]
    {
        let off = turned_about_z(0.4, 0.0, shift_mm);
        let mesh_from_stated = match place_of(&mesh, scans, &off) {
            PartPlace::AsStated => Isometry3::identity(),
            PartPlace::Elsewhere(found) => *found.mesh_from_stated.isometry(),
            PartPlace::Unknown(found) => panic!("{name}, {shift_mm} mm: {found:?}"),
        };
        let error_mm = corner_mm(&mesh, &(mesh_from_stated * off), &Isometry3::identity());
        assert!(error_mm < 2.5, "{name}, {shift_mm} mm: off by {error_mm} mm");
    }
}

#[test]
fn a_round_part_and_a_box_are_placed_by_what_they_look_like() {
    for mesh in [cylinder_mesh(30.0, 60.0, 96), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 15.0])] {
        let scans = scans_around(&mesh, 32);
        assert_eq!(place_of(&mesh, &scans, &Isometry3::identity()), PartPlace::AsStated);
        let found = place_of(&mesh, &scans, &turned_about_z(0.0, 2.0, 4.0));
        assert!(matches!(found, PartPlace::Elsewhere(_)), "{found:?}");
    }
    // No scan tells by how much a round part is turned.
    let mesh = cylinder_mesh(30.0, 60.0, 96);
    assert_eq!(place_of(&mesh, &scans_around(&mesh, 32), &turned_about_z(23.0, 0.0, 0.0)), PartPlace::AsStated);
}

/// A freedom that nothing fixes counted as known, and one that walls without a point seemed to fix as half a millimetre.
#[test]
fn shifts_and_turns_that_a_view_from_above_leaves_open_are_stated_as_such() {
    let mesh = cylinder_mesh(30.0, 60.0, 96);
    let shots = Shots::of(&mesh, 16);
    let down = UnitQuaternion::face_towards(&-Vector3::z(), &Vector3::x());
    let above = Pose::from_parts(mesh.aabb().centre().coords + Vector3::z() * shots.scanner.best_mm, down);
    let scans = shots.scans(&[above], 0.01, |_| Isometry3::identity());
    let found = register(&scans, &NearestFace::new(&mesh), &[], &RegistrationOptions::default());
    assert_eq!(found.not_found(), None, "{:?}", found.found);
    let (turns_deg, shifts_mm) = (found.sd.fixed_rows::<3>(0).map(f64::to_degrees), found.sd.fixed_rows::<3>(3));
    assert!(turns_deg.z > 2.0 && turns_deg.x < 0.5 && turns_deg.y < 0.5, "{turns_deg}");
    assert!(shifts_mm.x > 2.0 && shifts_mm.y > 2.0 && shifts_mm.z < 0.5, "{shifts_mm}");
}

/// More than a hundred views were each thinned to fewer points than hold a view, and none was placed.
#[test]
fn views_that_are_thinned_are_held_by_the_points_that_theirs_stand_for() {
    let options = RegistrationOptions::default();
    assert_eq!([1, 16, 50, 200, 5000].map(|views| options.matched_of_view(views)), [3000, 3000, 1000, 500, 500]);
    let mesh = base(20_000).expect("a base");
    let shots = Shots::of(&mesh, 16);
    let scans = moved(&shots.scans(&shots.poses(4), 0.0, |_| Isometry3::identity()), &motion_of(2, 0.2, 0.5));
    let thin = RegistrationOptions { points_of_view: 250, ..RegistrationOptions::default() };
    let found = register(&scans, &NearestFace::new(&mesh), &[], &thin);
    assert!(found.found.iter().all(|view| view.points <= 250 && view.kept_pose.is_none()), "{:?}", found.found);
    assert_eq!(found.not_found(), None);
}

/// Block of 100 × 70 × 30 mm, bent up at both ends by so much.
fn bent_block(bend_mm: f64) -> Mesh {
    const COLUMNS: u32 = 40;
    let corner = |number: u32| {
        let x_mm = 100.0 * f64::from(number / 4) / f64::from(COLUMNS);
        let [y_mm, z_mm] = [[0.0, 0.0], [70.0, 0.0], [70.0, 30.0], [0.0, 30.0]][(number % 4) as usize];
        Point3::new(x_mm, y_mm, z_mm + bend_mm * (x_mm / 50.0 - 1.0).powi(2))
    };
    let side = |column: u32, side: u32| {
        let [a, b] = [4 * column + side, 4 * column + (side + 1) % 4];
        [[a, b, b + 4], [a, b + 4, a + 4]]
    };
    let last = 4 * COLUMNS;
    let mut faces = vec![[0, 2, 1], [0, 3, 2], [last, last + 1, last + 2], [last, last + 2, last + 3]];
    faces.extend((0..COLUMNS).flat_map(|column| (0..4).flat_map(move |number| side(column, number))));
    let vertices_mm = (0..last + 4).map(corner).collect();
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

/// The last radius leaves the ends of a bent part out, and what pulled its place to one side was not told.
#[test]
fn the_place_of_a_bent_part_is_told_with_what_the_last_radius_leaves_out() {
    let (mesh, built) = (bent_block(0.0), bent_block(0.6));
    let (nearest, shots) = (NearestFace::new(&mesh), Shots::of(&built, 16));
    let options = RegistrationOptions { prior_deg: 0.01, prior_mm: 0.02, ..RegistrationOptions::default() };
    for seed in 0..4 {
        let scans = moved(&shots.scans(&shots.poses(6), 0.01, |_| Isometry3::identity()), &motion_of(seed, 0.1, 0.3));
        let found = register(&scans, &nearest, &[], &options);
        assert_eq!(found.not_found(), None, "{:?}", found.found);
        let views: Vec<ViewPoints> = scans.iter().map(|scan| ViewPoints::with_elements(scan, 3000)).collect();
        let mut of_all = State { part: *found.mesh_from_stated.isometry(), corrections: vec![Twist::zeros(); views.len()] };
        for _ in 0..5 {
            of_all.move_part(&views, &nearest, 5.0);
        }
        let off = log(&(of_all.part * found.mesh_from_stated.isometry().inverse()));
        assert!(off[5].abs() > 0.05, "{seed}: both radii tell the same place: {off}");
        assert!(off.iter().zip(&found.sd).all(|(off, sd)| off.abs() <= 2.0 * sd), "{off} ± {}", found.sd);
    }
}
