use nalgebra::Vector3;

use super::super::compared::CELL_MM;
use super::super::locate::{LocateOptions, PartPlace, PartPose, place};
use super::super::{RegistrationOptions, register};
use super::*;
use crate::cell::calibration::se3::log;
use crate::geometry::{Mesh, Pose};
use crate::inspection::shots::{Shots, motion_of};

/// A round shaft with a boss on its side that is so high: one surface, so that none lies beneath the boss.
fn shaft(boss_mm: f64) -> Mesh {
    let (sides, levels) = (96_u32, 21_u32);
    let mut vertices_mm = Vec::new();
    for level in 0..levels {
        for side in 0..sides {
            let angle_rad = std::f64::consts::TAU * f64::from(side) / f64::from(sides);
            let is_boss = (8..=12).contains(&level) && (side <= 3 || side >= sides - 3);
            let radius_mm = if is_boss { 30.0 + boss_mm } else { 30.0 };
            vertices_mm.push(Point3::new(radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin(), 3.0 * f64::from(level)));
        }
    }
    vertices_mm.extend([Point3::origin(), Point3::new(0.0, 0.0, 60.0)]);
    let (top, below, above) = ((levels - 1) * sides, levels * sides, levels * sides + 1);
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for side in 0..sides {
        let next = (side + 1) % sides;
        for from in (0..levels - 1).map(|level| level * sides) {
            let (low, high) = ([from + side, from + next], [from + sides + side, from + sides + next]);
            faces.extend([[low[0], low[1], high[1]], [low[0], high[1], high[0]]]);
        }
        faces.extend([[below, next, side], [above, top + side, top + next]]);
    }
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

/// Scans of a shaft, all around or of its half towards x.
fn scans_of(scanned: &Mesh, is_half: bool) -> Vec<ViewScan> {
    let shots = Shots::of(scanned, 32);
    let mut scans = shots.scans(&shots.poses(6), 0.01, |_| Isometry3::identity());
    for scan in scans.iter_mut().filter(|_| is_half) {
        let part_from_scanner = scan.part_from_scanner;
        let is_hidden = |point: &[f32; 3]| part_from_scanner.point(&Point3::from(point.map(f64::from))).x < 0.0;
        let hidden = scan.scanner_cloud.points_mm.iter_mut().filter(|point| is_hidden(point));
        hidden.for_each(|point| *point = [f32::NAN; 3]);
    }
    scans
}

/// Verdict on a shaft with a boss at turns about its axis, of which the first is the stated one.
fn verdict_on(scans: &[ViewScan], turns_deg: &[f64]) -> TurnVerdict {
    let (mesh, options) = (shaft(6.0), LocateOptions::default());
    let nearest = NearestFace::new(&mesh);
    let search = Search::new(scans, &nearest, &options);
    let axis = TurnAxis { through_mm: Point3::origin(), along: Vector3::z() };
    let pose = |turn_deg: &f64| Scored { pose: axis.turn(turn_deg.to_radians()), share: 1.0 };
    let poses: Vec<Scored> = turns_deg.iter().map(pose).collect();
    let step_rad = std::f64::consts::TAU / f64::from(TURNS);
    let near: Vec<Turn> = (1..TURNS).map(|step| Turn { axis, angle_rad: f64::from(step) * step_rad }).collect();
    judged(&poses, &near, &ComparedPoints::new(scans, CELL_MM), &search, &outline_mm(&mesh), true)
}

/// The part was turned, or all scans were dropped: the defect that an inspection should show.
#[test]
fn a_part_whose_boss_is_missing_lies_as_stated_though_the_boss_might_be_where_nobody_looked() {
    let found = verdict_on(&scans_of(&shaft(0.0), true), &[0.0, 120.0, 180.0, 240.0]);
    assert!(matches!(found, TurnVerdict::Kept));
}

#[test]
fn a_part_whose_boss_is_seen_elsewhere_is_turned_scanned_as_a_whole_or_in_half() {
    for is_half in [false, true] {
        let found = verdict_on(&scans_of(&shaft(6.0), is_half), &[120.0, 0.0, 210.0]);
        let is_true = |found: &Scored| found.pose.rotation.angle() < 1e-6;
        assert!(matches!(&found, TurnVerdict::Better(found) if is_true(found)), "half: {is_half}");
    }
}

/// A refinement slid by as much, and the part was said to lie elsewhere.
#[test]
fn a_turn_about_a_round_part_is_taken_back_unless_points_on_its_boss_tell_it() {
    let (mesh, options) = (shaft(6.0), LocateOptions::default());
    let nearest = NearestFace::new(&mesh);
    // A facet, so that all points but those on the boss lie on the part before and after.
    let turn = TurnAxis { through_mm: Point3::origin(), along: Vector3::z() }.turn(3.75_f64.to_radians());
    // Points around the boss to one side of its middle are hidden: +1 or -1 along y, 0 for none.
    let taken_back = |boss_mm: f64, hidden_side: f64| {
        let mut scans = scans_of(&shaft(boss_mm), false);
        for scan in &mut scans {
            let part_from_scanner = scan.part_from_scanner;
            let is_hidden = |point: &[f32; 3]| {
                let at = part_from_scanner.point(&Point3::from(point.map(f64::from)));
                at.x > 20.0 && at.y * hidden_side > 0.0
            };
            let hidden = scan.scanner_cloud.points_mm.iter_mut().filter(|point| is_hidden(point));
            hidden.for_each(|point| *point = [f32::NAN; 3]);
            scan.part_from_scanner = Pose::claim(turn.inverse() * part_from_scanner.isometry());
        }
        turned_back(&scans, &Search::new(&scans, &nearest, &options), &turn, 5.0)
    };
    // Where one side is hidden, the turn takes the boss there, and uncovers bare wall on the other: it was taken for told.
    for hidden_side in [0.0, 1.0, -1.0] {
        let found = taken_back(0.0, hidden_side).expect("nothing tells the turn");
        assert!(found.rotation.angle() < 0.01 && found.translation.vector.norm() < 0.1, "{found}");
    }
    assert_eq!(taken_back(6.0, 0.0), None, "the boss does");
}

/// Facets of a round wall were taken to hold it.
#[test]
fn a_turn_about_a_round_part_is_open_unless_points_on_its_boss_tell_it() {
    let mesh = shaft(6.0);
    let nearest = NearestFace::new(&mesh);
    let open_deg = |boss_mm: f64| {
        let scans = scans_of(&shaft(boss_mm), false);
        let poses: Vec<Isometry3<f64>> = scans.iter().map(|scan| *scan.part_from_scanner.isometry()).collect();
        open_turns(&scans, &poses, &nearest, 5.0).fixed_rows::<3>(0).map(|variance| variance.sqrt().to_degrees())
    };
    let (without, with) = (open_deg(0.0), open_deg(6.0));
    assert!(without.z > 2.0 && without.x < 0.5 && without.y < 0.5, "{without}");
    assert!(with.max() < 0.5, "the boss tells: {with}");
}

/// Points on the bare wall pulled at the walls of the boss, and were taken to hold the part by them.
#[test]
fn a_part_whose_boss_is_missing_is_placed_by_its_other_surface_and_its_turn_is_stated_as_open() {
    let mesh = shaft(6.0);
    let (nearest, options) = (NearestFace::new(&mesh), RegistrationOptions::default());
    let scans = scans_of(&shaft(0.0), false);
    for seed in 0..2 {
        let off = motion_of(seed, 0.3, 1.0);
        let state = |scan: &ViewScan| {
            let part_from_scanner = Pose::claim(off * scan.part_from_scanner.isometry());
            ViewScan { part_from_scanner, ..scan.clone() }
        };
        let scans: Vec<ViewScan> = scans.iter().map(state).collect();
        let found = register(&scans, &nearest, &[], &options);
        let error = log(&(found.mesh_from_stated.isometry() * off));
        assert!(error.iter().zip(&found.sd).all(|(error, sd)| error.abs() <= 3.0 * sd), "{error} ± {}", found.sd);
        assert!(error.fixed_rows::<3>(3).norm() < 0.15, "{error}");
        assert!(found.sd[2].to_degrees() > 2.0 && found.sd[0].to_degrees() < 0.5, "{}", found.sd);
    }
}

/// Four scans of a shaft without its boss, with a point every so many pixels.
fn bare_scans(step_px: u32) -> Vec<ViewScan> {
    let bare = shaft(0.0);
    let shots = Shots::of(&bare, step_px);
    shots.scans(&shots.poses(4), 0.01, |_| Isometry3::identity())
}

/// Points on the bare wall pulled at the walls of the boss, and turned the part by 11° to 15°.
#[test]
fn a_search_does_not_turn_a_part_by_the_boss_that_it_lacks() {
    let (mesh, options) = (shaft(6.0), LocateOptions::default());
    let nearest = NearestFace::new(&mesh);
    for step_px in [16, 24, 32] {
        let found = Search::new(&bare_scans(step_px), &nearest, &options).refined(&Isometry3::identity()).pose;
        assert!(found.rotation.angle().to_degrees() < 0.5 && found.translation.vector.norm() < 0.1, "{step_px} px: {found}");
    }
}

/// The part was searched for, and compared in a wrong turn without a warning.
#[test]
fn a_round_part_that_lies_as_stated_without_its_boss_is_said_to_do_so() {
    let (mesh, options) = (shaft(6.0), LocateOptions::default());
    assert_eq!(place(&bare_scans(32), &NearestFace::new(&mesh), &options), PartPlace::AsStated);
}

/// The turn of the part was found in doubt, and all scans were dropped.
#[test]
fn a_round_part_without_its_boss_beside_its_place_is_moved_and_not_turned() {
    let (mesh, options, off) = (shaft(6.0), LocateOptions::default(), motion_of(1, 1.0, 3.0));
    let mut scans = bare_scans(24);
    for scan in &mut scans {
        scan.part_from_scanner = Pose::claim(off * scan.part_from_scanner.isometry());
    }
    let found = place(&scans, &NearestFace::new(&mesh), &options);
    let PartPlace::Elsewhere(PartPose { mesh_from_stated, .. }) = found else { panic!("{found:?}") };
    let left = mesh_from_stated.isometry() * off;
    assert!(left.rotation.angle().to_degrees() < 0.5 && left.translation.vector.norm() < 0.1, "{left}");
}
