//! Remedies as the plan prints them, applied: the spot is then measured, and by as much as was said.

use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, Vector3};
use vantage::cell::{PoseSpec, Presets, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams, Region, SelectionGoal};
use vantage::planning::plan::{Cause, MissedSpot, Outcome, Remedy, RemedyKind, StopReason, Verdict};
use vantage::planning::{PlanInput, plan};
use vantage::wire::words::{ChoiceRules, PlanRules, fix_sentence, treated_spots};

use super::bodies::blind_hole;
use super::{everything, given, looking};
use crate::support::shapes::prism;
use crate::support::{box_mesh, limited_to, nominal_scanner, plan_viewpoints};

/// Said and found areas differ by no more than this share: huge spots alone are looked at in part.
const SAID: f64 = 1e-6;

/// Until nothing adds anything, on samples few enough to plan it often.
fn quick(mesh: &Mesh, limits: super::Limits) -> PlanParams {
    let mut params = everything(limits);
    params.part.samples_per_mm2 = Some(10_000.0 / mesh.area_mm2());
    params
}

fn treated(outcome: &Outcome) -> Vec<(Cause, &MissedSpot, &Remedy)> {
    treated_spots(&outcome.plan.missed)
}

/// A remedy in a sentence, of a plan that ended at its target.
fn sentence(remedy: &Remedy) -> String {
    let rules = PlanRules {
        goal: SelectionGoal::FewestViews,
        ended_by: StopReason::Target,
        views_left: None,
        min_gain_mm2: 0.0,
        is_priced: false,
        must_overlap: false,
    };
    fix_sentence(remedy, ChoiceRules::Plan(rules))
}

/// The parameters with a remedy applied.
fn applied(params: &PlanParams, remedy: &Remedy) -> PlanParams {
    let mut params = params.clone();
    params.candidates.poses.extend(remedy.views.iter().map(|view| PoseSpec::from(&view.part_from_scanner)));
    params.limits.camera_deg = remedy.camera_deg.or(params.limits.camera_deg);
    params.limits.projector_deg = remedy.projector_deg.or(params.limits.projector_deg);
    params.selection.max_views = None;
    params
}

/// Area that was missed for `cause` on the spot's faces and is measured now.
fn cured_mm2(mesh: &Mesh, before: &Outcome, after: &Outcome, cause: Cause, spot: &MissedSpot) -> f64 {
    before.surface.area_where(|s| {
        before.verdicts[s.index()] == Verdict::Missed(cause)
            && matches!(after.verdicts[s.index()], Verdict::Measured(_))
            && spot.source_faces.binary_search(&mesh.source_face[before.surface.patch_of(s).face as usize]).is_ok()
    })
}

/// Plans, applies every remedy by itself and looks at the spot; returns the kinds that were met.
fn every_remedy_works(mesh: &Mesh, params: &PlanParams, most: usize) -> Vec<RemedyKind> {
    let scanner = nominal_scanner();
    let before = plan_viewpoints(mesh, &scanner, params);
    let treated = treated(&before);
    for (cause, spot, remedy) in treated.iter().filter(|(.., remedy)| remedy.kind != RemedyKind::None).take(most) {
        let mut params = applied(params, remedy);
        params.missed.remedies = 0;
        let after = plan_viewpoints(mesh, &scanner, &params);
        let cured_mm2 = cured_mm2(mesh, &before, &after, *cause, spot);
        println!("{} {:.1} mm²: {} → {cured_mm2:.1}", cause.as_str(), spot.area_mm2, sentence(remedy));
        assert!(remedy.area_mm2 >= 0.5 * spot.area_mm2 && (1..=8).contains(&remedy.views.len()));
        assert_eq!(sentence(remedy).starts_with("only "), remedy.area_mm2 < 0.9 * spot.area_mm2, "{remedy:?}");
        assert!(cured_mm2 >= remedy.area_mm2 * (1.0 - SAID), "{cured_mm2} of {} with {}", remedy.area_mm2, sentence(remedy));
    }
    treated.iter().map(|(.., remedy)| remedy.kind).collect()
}

#[test]
fn a_slot_across_the_baseline_is_cured_by_another_roll() {
    // 12 mm wide, 60 mm deep, along y; the only view has its baseline across it.
    let profile =
        [[-6.0, -60.0], [-6.0, 0.0], [-30.0, 0.0], [-30.0, -80.0], [30.0, -80.0], [30.0, 0.0], [6.0, 0.0], [6.0, -60.0]];
    let slot = slotted(&profile);
    let mut params = quick(&slot, (85.0, 77.5));
    params.candidates.strategies = Vec::new();
    params.candidates.poses = vec![PoseSpec::from(&looking(Point3::new(0.0, 0.0, -30.0), 0.0, 0.0, 0.0))];
    params.regions.exclude = vec![Region::HalfSpace { point_mm: [0.0, 0.0, -62.0], normal: [0.0, 0.0, 1.0] }];
    params.missed.remedies = 20;
    let before = plan_viewpoints(&slot, &nominal_scanner(), &params);
    let floor = treated(&before).into_iter().find(|(_, spot, _)| (spot.centre_mm.z + 60.0).abs() < 1e-6);
    let (cause, spot, remedy) = floor.expect("the floor is a spot");
    assert_eq!((cause, remedy.kind), (Cause::ShadowLeft, RemedyKind::Roll), "{}", sentence(remedy));
    assert!((spot.extent_mm - Vector3::new(12.0, 80.0, 0.0)).norm() < 1e-6, "{:?}", spot.extent_mm);
    assert!((remedy.views[0].roll_rad.to_degrees() - 90.0).abs() < 1e-9);
    every_remedy_works(&slot, &params, 4);
}

/// A prism whose section has a slot: the fan of [`prism`] cannot close it, so its ends stay open.
fn slotted(profile: &[[f64; 2]]) -> Mesh {
    let mut mesh = prism(profile, 40.0);
    mesh.faces.truncate(2 * profile.len());
    mesh.source_face.truncate(2 * profile.len());
    mesh
}

#[test]
fn sides_that_no_view_faces_are_cured_by_tilts() {
    let block = box_mesh([-30.0; 3], [30.0; 3]);
    let mut params = quick(&block, (60.0, 55.0));
    params.candidates.strategies = Vec::new();
    params.candidates.poses = vec![PoseSpec::from(&looking(Point3::new(0.0, 0.0, 30.0), 0.0, 0.0, 0.0))];
    let kinds = every_remedy_works(&block, &params, 4);
    assert_eq!(kinds, [RemedyKind::Tilt], "five faces that hang together are one spot");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_floor_beyond_the_working_depth_is_cured_by_a_stand_off() {
    // At the bottom of a narrow hole nothing but straight down helps; the one view stands just right for the face around
    // it, too far for the floor.
    let body = blind_hole(10.0, 16.0);
    let view = looking(Point3::new(0.0, 0.0, 80.0), 0.0, 0.0, 0.0);
    let mut params = given(&body, &[view], (40.0, 40.0));
    params.regions.exclude.clear();
    params.part.samples_per_mm2 = Some(4.0);
    params.missed.remedies = 20;
    let before = plan_viewpoints(&body.mesh, &nominal_scanner(), &params);
    let floor = treated(&before).into_iter().find(|(cause, ..)| *cause == Cause::Depth);
    let (_, spot, remedy) = floor.expect("a spot out of depth");
    assert!((spot.centre_mm.z + 16.0).abs() < 1.0, "{:?}", spot.centre_mm);
    assert_eq!(remedy.kind, RemedyKind::Standoff, "{}", sentence(remedy));
    every_remedy_works(&body.mesh, &params, 2);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_lower_wall_of_a_hole_needs_a_larger_limit() {
    // Past the rim of a hole 60 mm wide and deep its lower wall is seen at an incidence above atan(1): 45°.
    let body = blind_hole(30.0, 60.0);
    let mut params = quick(&body.mesh, (40.0, 35.0));
    params.regions.exclude = vec![Region::Faces { faces: body.outside() }];
    params.missed.remedies = 1;
    assert_eq!(every_remedy_works(&body.mesh, &params, 1), [RemedyKind::Limit]);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn no_remedy_raises_a_limit_beyond_the_hardware() {
    // The hole of the test above, seen by hardware that sees no more obliquely than the job asks.
    let body = blind_hole(30.0, 60.0);
    let mut params = quick(&body.mesh, (40.0, 35.0));
    params.regions.exclude = vec![Region::Faces { faces: body.outside() }];
    let outcome = plan_viewpoints(&body.mesh, &limited_to(nominal_scanner(), [40.0, 40.0, 35.0]), &params);
    let found = treated(&outcome);
    assert!(!found.is_empty());
    for (.., remedy) in found {
        assert_ne!(remedy.kind, RemedyKind::Limit, "{}", sentence(remedy));
        assert_eq!((remedy.camera_deg, remedy.projector_deg), (None, None), "{remedy:?}");
    }
    // Where the job had tightened the limits they are raised, one for both cameras up to the tighter of theirs.
    params.missed.remedies = 1;
    let outcome = plan_viewpoints(&body.mesh, &limited_to(nominal_scanner(), [75.0, 70.0, 72.0]), &params);
    let [(_, _, remedy)] = treated(&outcome)[..] else { panic!("one spot") };
    assert_eq!(remedy.kind, RemedyKind::Limit, "{}", sentence(remedy));
    assert!(remedy.camera_deg.is_none_or(|deg| deg <= 70.0 + 1e-9), "{remedy:?}");
    assert!(remedy.projector_deg.is_none_or(|deg| deg <= 72.0 + 1e-9), "{remedy:?}");
}

#[test]
fn a_closed_cavity_has_no_remedy_and_says_so() {
    let (mut block, void) = (box_mesh([-30.0; 3], [30.0; 3]), box_mesh([-10.0; 3], [10.0; 3]));
    let first = block.vertices_mm.len() as u32;
    block.vertices_mm.extend(&void.vertices_mm);
    block.faces.extend(void.faces.iter().map(|[a, b, c]| [first + a, first + c, first + b]));
    block.source_face = (0..block.faces.len() as u32).collect();
    let outcome = plan_viewpoints(&block, &nominal_scanner(), &quick(&block, (85.0, 77.5)));
    let treated = treated(&outcome);
    let [(cause, spot, remedy)] = treated[..] else { panic!("one spot: {treated:?}") };
    assert_eq!((cause, remedy.kind, remedy.views.len()), (Cause::Enclosed, RemedyKind::None, 0));
    assert!((spot.area_mm2 - 2400.0).abs() < 1e-6 && (spot.extent_mm - Vector3::repeat(20.0)).norm() < 1e-9, "{spot:?}");
    assert!(spot.centre_mm.coords.norm() < 0.5 && remedy.tried > 100, "{spot:?} {remedy:?}");
    let coverage = &outcome.plan.coverage;
    for visible_mm2 in [coverage.visible_area_mm2, coverage.independent.visible_area_mm2] {
        assert!((visible_mm2 - 21_600.0).abs() < 1e-6, "the outside alone is visible: {visible_mm2}");
    }
}

#[test]
fn what_was_measurable_and_left_out_is_cured_by_choosing_it() {
    let block = box_mesh([-30.0; 3], [30.0; 3]);
    let mut params = quick(&block, (60.0, 55.0));
    params.selection.max_views = Some(1);
    let kinds = every_remedy_works(&block, &params, 4);
    assert!(!kinds.is_empty() && kinds.iter().all(|kind| *kind == RemedyKind::View), "{kinds:?}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_face_that_a_part_stands_on_is_cured_by_another_setup() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let mesh = box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]);
    let planned = |params: &PlanParams| {
        let cancel = AtomicBool::new(false);
        let input =
            PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
        plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan")
    };
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.part.samples_per_mm2 = Some(0.3);
    let before = planned(&params);
    let (cause, spot, remedy) = treated(&before)[0];
    assert_eq!((cause, remedy.kind), (Cause::ExcludedResting, RemedyKind::Setup), "{}", sentence(remedy));
    assert!((spot.area_mm2 - 2400.0).abs() < 1e-6 && remedy.area_mm2 >= 1200.0);
    // Applied as it is printed: the pose that the box is laid in, on another of its faces.
    let turned = remedy.table_from_part.expect("a pose");
    assert!(turned.direction(&Vector3::z()).z < 0.1, "{turned:?}");
    params.part.table_from_part = Some(PoseSpec::from(&turned));
    params.missed.remedies = 0;
    let after = planned(&params);
    assert!(cured_mm2(&mesh, &before, &after, cause, spot) >= remedy.area_mm2 * (1.0 - SAID));
}
