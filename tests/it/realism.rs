//! Measured area that a real scan may lack: the zone of a slot by hand, in plans that count it and in plans that do not, and what
//! the outputs say of it.

use nalgebra::Point3;
use vantage::geometry::Mesh;
use vantage::planning::ids::SampleId;
use vantage::planning::params::{CandidateParams, PlanParams};
use vantage::planning::plan::{Cause, Outcome, RiskReason, Verdict};
use vantage::report::text::text;
use vantage::wire::echo::Echo;
use vantage::wire::plan::PlanDocument;
use vantage::wire::words::at_risk_sentence;

use crate::support::{box_mesh, nominal_scanner, plan_viewpoints};

/// Half the length of the slotted block, mm.
const HALF_MM: f64 = 20.0;
/// Width of the zone, mm.
const ZONE_MM: f64 = 2.0;

/// A block of 30 × 40 × 20 mm with a slot along y in its top, 10 mm wide and 10 mm deep, floor at z = 0.
fn slotted() -> Mesh {
    let profile =
        [[-15.0, -10.0], [15.0, -10.0], [15.0, 10.0], [5.0, 10.0], [5.0, 0.0], [-5.0, 0.0], [-5.0, 10.0], [-15.0, 10.0]];
    let end = |y: f64| profile.iter().map(move |[x, z]| Point3::new(*x, y, *z));
    let sides = (0..8_u32).flat_map(|i| {
        let j = (i + 1) % 8;
        [[i, i + 8, j], [j, i + 8, j + 8]]
    });
    let lid = [[0, 5, 6], [0, 6, 7], [0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]];
    let lids = lid.into_iter().flat_map(|[a, b, c]| [[a, b, c], [8 + a, 8 + c, 8 + b]]);
    let faces: Vec<[u32; 3]> = sides.chain(lids).collect();
    Mesh {
        vertices_mm: end(-HALF_MM).chain(end(HALF_MM)).collect(),
        source_face: (0..faces.len() as u32).collect(),
        faces,
        groups: Vec::new(),
    }
}

/// Few viewpoints, and of the risks the concave zone alone.
fn zone_alone(mesh: &Mesh) -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    // Patches of several samples, so that there are no more than are all judged.
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(30_000.0 / mesh.area_mm2()), Some(2.0));
    params.missed.remedies = 0;
    (params.selection.target, params.selection.min_growth) = (1.0, 0.0);
    (params.robust.draws, params.robust.part_draws, params.robust.hand_eye_draws) = (1, 1, 1);
    params.realism.concave_zone_mm = ZONE_MM;
    (params.realism.frame_margin_px, params.realism.silhouette_margin_px) = (0.0, 0.0);
    params
}

/// Samples within the zone of the slot by hand.
fn in_zone(outcome: &Outcome) -> Vec<bool> {
    let surface = &outcome.surface;
    let is_in_zone = |sample: SampleId| {
        let (p, n) = (&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
        let floor = n.z > 0.9 && p.z.abs() < 1e-3 && 5.0 - p.x.abs() < ZONE_MM;
        let wall = n.x.abs() > 0.9 && p.x.abs() < 6.0 && p.z < ZONE_MM;
        floor || wall
    };
    surface.samples().map(is_in_zone).collect()
}

fn missed_mm2(outcome: &Outcome, cause: Cause) -> f64 {
    outcome.plan.missed.iter().filter(|missed| missed.cause == cause).map(|missed| missed.area_mm2).sum()
}

#[test]
fn area_at_risk_in_a_slot_is_its_zone_as_far_as_it_is_measured() {
    let mesh = slotted();
    let outcome = plan_viewpoints(&mesh, &nominal_scanner(), &zone_alone(&mesh));
    let at_risk = &outcome.plan.coverage.at_risk;
    let in_zone = in_zone(&outcome);
    let is_measured = |sample: SampleId| matches!(outcome.verdicts[sample.index()], Verdict::Measured(_));
    let by_hand_mm2 = outcome.surface.area_where(|sample| in_zone[sample.index()] && is_measured(sample));
    assert!((at_risk.area_mm2 - by_hand_mm2).abs() < 1e-6, "{at_risk:?}, by hand {by_hand_mm2} mm²");
    // 2 mm on the floor and 2 mm on the wall, on both sides, 40 mm long: 320 mm², all but a little of it measured.
    let whole_mm2 = 4.0 * ZONE_MM * 2.0 * HALF_MM;
    assert!((0.85 * whole_mm2..1.03 * whole_mm2).contains(&at_risk.area_mm2), "{at_risk:?} of {whole_mm2} mm²");
    let [zone, reflection, frame, silhouette] = at_risk.by_reason_mm2;
    assert!((zone - at_risk.area_mm2).abs() < 1e-9 && reflection <= zone, "{at_risk:?}");
    assert_eq!((frame, silhouette, at_risk.is_counted), (0.0, 0.0, true));
    assert_eq!(missed_mm2(&outcome, Cause::AtRisk), 0.0, "it counts as measured");
}

#[test]
fn not_counted_it_is_missed_and_measured_area_is_less_by_just_that() {
    let mesh = slotted();
    let mut params = zone_alone(&mesh);
    params.realism.silhouette_margin_px = 2.0;
    let counting = plan_viewpoints(&mesh, &nominal_scanner(), &params);
    params.realism.count_at_risk = false;
    let without = plan_viewpoints(&mesh, &nominal_scanner(), &params);
    let (all, less) = (&counting.plan.coverage, &without.plan.coverage);
    assert!(all.at_risk.area_mm2 > 250.0, "{:?}", all.at_risk);
    assert_eq!(all.at_risk.by_reason_mm2, less.at_risk.by_reason_mm2, "the same views");
    assert!(all.at_risk.is_counted && !less.at_risk.is_counted);
    assert!((all.measured.area_mm2 - less.measured.area_mm2 - all.at_risk.area_mm2).abs() < 1e-6);
    assert!((missed_mm2(&without, Cause::AtRisk) - all.at_risk.area_mm2).abs() < 1e-6);
    assert!((less.measured.grade_area_mm2.iter().sum::<f64>() - less.measured.area_mm2).abs() < 1e-9);
    assert!((less.curve_area_mm2.last().expect("views") - less.measured.area_mm2).abs() < 1e-6);
    assert_eq!((all.asked_area_mm2, all.coverable_area_mm2), (less.asked_area_mm2, less.coverable_area_mm2));
    // On the second samples too, by about as much, and under errors.
    let lost = all.independent.of_asked() - less.independent.of_asked();
    let expected = all.at_risk.area_mm2 / all.asked_area_mm2;
    assert!((lost / expected - 1.0).abs() < 0.1, "{lost}, about {expected}");
    let worst = |coverage: &vantage::planning::plan::Coverage| coverage.robust.as_ref().expect("by default").views.worst();
    assert!(worst(less) < worst(all) - 0.5 * expected, "{} and {}", worst(less), worst(all));
}

#[test]
fn a_convex_part_has_no_concave_zone_and_an_image_without_a_middle_puts_all_of_it_at_risk() {
    let mesh = box_mesh([-20.0, -20.0, -20.0], [20.0, 20.0, 20.0]);
    let mut params = zone_alone(&mesh);
    let coverage = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan.coverage;
    assert_eq!(coverage.at_risk.area_mm2, 0.0);
    // Half of the cameras' 4000 pixels and all of the projector's.
    params.realism.frame_margin_px = 2000.0;
    let coverage = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan.coverage;
    assert!((coverage.at_risk.area_mm2 - coverage.measured.area_mm2).abs() < 1e-6, "{coverage:?}");
    let [zone, _, frame, silhouette] = coverage.at_risk.by_reason_mm2;
    assert_eq!((zone, silhouette), (0.0, 0.0));
    assert!((frame - coverage.measured.area_mm2).abs() < 1e-6);
}

#[test]
fn plan_and_texts_tell_it_apart_from_the_headline() {
    let mesh = slotted();
    let scanner = nominal_scanner();
    let outcome = plan_viewpoints(&mesh, &scanner, &zone_alone(&mesh));
    let document = PlanDocument::new(&outcome, &scanner, None, Echo::default());
    let json = serde_json::to_value(&document).expect("JSON");
    let at_risk = &json["coverage"]["at_risk"];
    assert_eq!((at_risk["counted"].as_bool(), at_risk["reasons"].as_array().map(Vec::len)), (Some(true), Some(4)));
    assert_eq!(at_risk["reasons"][0]["reason"], RiskReason::ConcaveZone.as_str());
    let of_visible = at_risk["of_visible"].as_f64().expect("a share");
    let coverage = &outcome.plan.coverage;
    assert!((of_visible - coverage.at_risk.area_mm2 / coverage.visible_area_mm2).abs() < 1e-12);
    let told = at_risk_sentence(document.coverage.at_risk.as_ref().expect("of a new plan"));
    let begins = format!("At risk in a real scan: {:.2} % of visible, counted as measured: concave zone ", 100.0 * of_visible);
    assert!(told.starts_with(&begins), "{told}");
    let text = text(&outcome.plan);
    assert!(text.contains(&format!("\n{told}\n")), "{text}");
    assert!(text.contains("within 2 mm of a concave edge with an opening angle below 120°"), "{text}");
}
