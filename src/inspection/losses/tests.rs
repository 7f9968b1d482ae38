use std::sync::OnceLock;

use nalgebra::{Point3, Vector3};

use super::{LossCause, LossRemedy};
use crate::cell::PerDevice;
use crate::geometry::Mesh;
use crate::geometry::demo_parts::DemoPart;
use crate::inspection::ViewScan;
use crate::inspection::coverage::IdentifiedLimits;
use crate::inspection::ingest::Removed;
use crate::inspection::rehearsal::{Judged, Knowledge, Rehearsal, quick_params, shared_part};
use crate::inspection::shots::merged;
use crate::inspection::simulated_scanner::{CellFate, ScannedScene, SimulatedView, SimulationParams, crop};
use crate::planning::ids::SampleId;
use crate::testing::box_mesh;

/// The demo base, planned once for all tests.
fn base() -> &'static Rehearsal {
    static BASE: OnceLock<Rehearsal> = OnceLock::new();
    BASE.get_or_init(|| Rehearsal::new(DemoPart::Base.mesh(8000).expect("a part"), &quick_params()))
}

fn sim() -> SimulationParams {
    SimulationParams { step_px: 4, ..SimulationParams::default() }
}

/// Limits as a ramp of the rate of return from 65° to 80° shows them: its rate is 0.75 at 68.75°.
fn knee() -> IdentifiedLimits {
    IdentifiedLimits { incidence_deg: PerDevice::of_cameras(Some(68.75), Some(68.75)), ..IdentifiedLimits::default() }
}

fn asked_share(judged: &Judged, area_mm2: f64) -> f64 {
    area_mm2 / judged.coverage.asked_mm2
}

/// Row I6: the identity holds, little is unexplained, and what was injected is named.
fn check_named(rehearsal: &Rehearsal, judged: &Judged, views: &[SimulatedView], (fate, cause): (CellFate, LossCause)) {
    let unexplained = asked_share(judged, judged.losses.area_mm2(LossCause::Unexplained));
    let [named, lost] = rehearsal.named(judged, views, fate, cause);
    for loss in &judged.losses.by_cause {
        println!("    {} {:.3} % in {} spots", loss.cause.as_str(), 100.0 * asked_share(judged, loss.area_mm2), loss.spots.len());
    }
    println!(
        "{}: {:.2} points lost, {:.1} % named; unexplained {:.3}",
        cause.as_str(),
        100.0 * lost,
        100.0 * named,
        100.0 * unexplained
    );
    assert!(judged.losses.residual_mm2(&judged.coverage).abs() < 1e-9);
    assert!(unexplained <= 0.005, "{}: {unexplained} unexplained", cause.as_str());
    assert!(lost > 0.002, "{}: only {lost} is lost", cause.as_str());
    assert!(named >= 0.9, "{}: {named} of {lost} named", cause.as_str());
}

#[test]
#[ignore = "long: tests/all runs it"]
fn injected_weaknesses_are_named() {
    let base = base();
    let nothing = IdentifiedLimits::default();
    let lobe = IdentifiedLimits { lobe_deg: Some(18.0), ..nothing };
    let cases = [
        (SimulationParams { grazing_deg: vec![65.0, 80.0], ..sim() }, knee(), CellFate::Grazing, LossCause::Grazing),
        (SimulationParams { lobe_deg: 18.0, ..sim() }, lobe, CellFate::Specular, LossCause::Specular),
        (SimulationParams { edge_px: 10.0, ..sim() }, nothing, CellFate::Edge, LossCause::Edge),
        (SimulationParams { concave_mm: 2.0, ..sim() }, nothing, CellFate::Concave, LossCause::Concave),
    ];
    for (sim, limits, fate, cause) in cases {
        let views = base.scan(&sim, base.as_planned());
        let judged = base.judge(&views, &Knowledge { limits, ..Knowledge::default() });
        check_named(base, &judged, &views, (fate, cause));
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn missing_cropped_and_misplaced_views_are_named() {
    let base = base();
    let mut views = base.scan(&sim(), base.as_planned());
    let judged = base.judge(&views[1..], &Knowledge::default());
    let missing = asked_share(&judged, judged.losses.area_mm2(LossCause::ViewMissing));
    let gain = base.outcome.plan.views[0].gain_of_asked;
    assert!(missing > 0.01 && missing < gain, "{missing} of a view that alone added {gain} at first");
    assert_eq!(judged.coverage.by_view[0].scans, 0);
    crop(&mut views[0], 0.45);
    let judged = base.judge(&views, &Knowledge::default());
    check_named(base, &judged, &views, (CellFate::OutsideFile, LossCause::OutsideFile));
    // Taken from 60 mm beside its pose, and registered there.
    let scan = views[1].scan.clone();
    let mut poses: Vec<_> = views.iter().map(|view| (&view.scan, view.true_part_from_scanner)).collect();
    let shift = nalgebra::Translation3::new(60.0, 0.0, 0.0);
    let elsewhere = crate::geometry::Pose::claim(poses[1].1.isometry() * shift);
    let again = {
        let views = [(scan.viewpoint, elsewhere)];
        crate::inspection::rehearsal::in_context(|ctx| {
            let params = &base.outcome.plan.params;
            crate::inspection::simulated_scanner::SimulatedScanner::new(&base.scanner, params, &sim(), base.as_planned(), ctx)?
                .scan(&views, ctx)
        })
        .expect("nobody cancels")
    };
    poses[1] = (&again[0].scan, elsewhere);
    let judged = base.judge_at(&poses, &Knowledge::default());
    let pose = asked_share(&judged, judged.losses.area_mm2(LossCause::Pose));
    assert!(pose > 0.001, "{pose}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn an_unknown_body_is_named() {
    let base = base();
    let aabb = base.mesh.aabb();
    let top = Point3::new(aabb.centre().x, aabb.centre().y, aabb.max.z);
    let post = box_mesh([top.x - 6.0, top.y - 6.0, top.z + 8.0], [top.x + 6.0, top.y + 6.0, top.z + 40.0]);
    let views = base.scan(&sim(), ScannedScene { unknown: Some(&post), ..base.as_planned() });
    let judged = base.judge(&views, &Knowledge::default());
    let [named, lost] = base.named(&judged, &views, CellFate::UnmodelledOccluder, LossCause::UnmodelledOccluder);
    println!("occluder: {lost} lost, {named} named");
    for loss in &judged.losses.by_cause {
        println!("    {} {:.3} %", loss.cause.as_str(), 100.0 * asked_share(&judged, loss.area_mm2));
    }
    assert!(lost > 0.001 && named > 0.8, "{lost} {named}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_part_that_deviates_is_named_where_it_does() {
    let base = base();
    let aabb = base.mesh.aabb();
    // All that lies high is 0.6 mm higher.
    let limit_mm = aabb.min.z + 0.7 * aabb.extent_mm().z;
    let raised = |vertex: &Point3<f64>| if vertex.z > limit_mm { vertex + Vector3::z() * 0.6 } else { *vertex };
    let as_built = Mesh { vertices_mm: base.mesh.vertices_mm.iter().map(raised).collect(), ..base.mesh.clone() };
    let views = base.scan(&sim(), ScannedScene { as_built: &as_built, ..base.as_planned() });
    let judged = base.judge(&views, &Knowledge::default());
    let deviates = judged.losses.by_cause.iter().find(|loss| loss.cause == LossCause::PartDeviates).expect("a loss");
    let largest = &deviates.spots[0];
    println!("deviates: {}", asked_share(&judged, deviates.area_mm2));
    for loss in &judged.losses.by_cause {
        println!("    {} {:.3} %", loss.cause.as_str(), 100.0 * asked_share(&judged, loss.area_mm2));
    }
    assert!(largest.centre_mm.z > limit_mm - 1.0 && largest.remedy == LossRemedy::Nothing);
    assert!(asked_share(&judged, judged.losses.area_mm2(LossCause::Unexplained)) <= 0.005);
}

/// Material of 3 mm on a fin, met by an oblique ray more than 5 mm before the model, was "an object that is not in the model".
#[test]
#[ignore = "long: tests/all runs it"]
fn material_on_a_fin_is_of_the_part() {
    let boxes = [box_mesh([-40.0, -30.0, 0.0], [40.0, 30.0, 10.0]), box_mesh([-10.0, -0.5, 9.9], [20.0, 0.5, 30.0])];
    let part = Rehearsal::new(Mesh::joined(&boxes), &quick_params());
    let as_built = Mesh::joined(&[&boxes[..], &[box_mesh([0.0, 0.4, 12.0], [10.0, 3.5, 19.0])]].concat());
    let views = part.scan(&sim(), ScannedScene { as_built: &as_built, ..part.as_planned() });
    let judged = part.judge(&views, &Knowledge::default());
    let [foreign, of_part] = [LossCause::UnmodelledOccluder, LossCause::PartDeviates].map(|cause| judged.losses.area_mm2(cause));
    println!("{foreign} mm² behind an object, {of_part} mm² deviate");
    assert!(of_part > 50.0 && of_part > foreign, "{foreign} {of_part}");
}

/// Neighbours across an edge were once measured from the plane of one face, and what a coarse grid turns was taken for noise.
#[test]
#[ignore = "long: tests/all runs it"]
fn an_exact_scan_neither_deviates_nor_is_noisy() {
    let gearbox = shared_part("gearbox_output_housing_16k.stl", Some(120.0));
    let gearbox = gearbox.map(|mesh| Rehearsal::new(mesh, &quick_params()));
    let exact = SimulationParams { noise_best_mm: Some(0.0), step_px: 8, ..SimulationParams::default() };
    for rehearsal in [Some(base()), gearbox.as_ref()].into_iter().flatten() {
        let views = rehearsal.scan(&exact, rehearsal.as_planned());
        let single = rehearsal.judge(&views, &Knowledge::default());
        let scans: Vec<ViewScan> = views.iter().map(|view| view.scan.clone()).collect();
        let images = merged(&scans, &rehearsal.scanner, &rehearsal.mesh);
        let poses: Vec<_> = images.iter().map(|image| (image, image.part_from_scanner)).collect();
        let merged = rehearsal.judge_at(&poses, &Knowledge { is_merged: true, ..Knowledge::default() });
        for judged in [single, merged] {
            let [deviates, noisy] = [LossCause::PartDeviates, LossCause::Noisy].map(|cause| judged.losses.area_mm2(cause));
            assert!(judged.coverage.lost_mm2() > 0.0, "something is lost");
            assert!(deviates == 0.0 && noisy == 0.0, "{deviates} {noisy}");
        }
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn noise_beyond_the_expected_is_named_and_is_no_deviation() {
    let base = base();
    for noise_best_mm in [0.06, 0.24] {
        let views = base.scan(&SimulationParams { noise_best_mm: Some(noise_best_mm), ..sim() }, base.as_planned());
        let judged = base.judge(&views, &Knowledge::default());
        let [deviates, noisy] =
            [LossCause::PartDeviates, LossCause::Noisy].map(|cause| asked_share(&judged, judged.losses.area_mm2(cause)));
        println!("{noise_best_mm} mm: {noisy} noisy, {deviates} deviates");
        assert!(noisy > 0.002 && deviates < 0.1 * noisy, "{noisy} {deviates}");
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn light_blur_and_filters_are_named_where_something_is_known_of_them() {
    let base = base();
    let dark_sim = SimulationParams { signal: vec![0.4, 100.0], ..sim() };
    let views = base.scan(&dark_sim, base.as_planned());
    let light = |view: usize, sample: SampleId| match views[view].fate_at(&base.outcome.surface.sample_mm[sample.index()]) {
        Some(CellFate::Dark) => super::Light::Dark,
        _ => super::Light::Fair,
    };
    let judged = base.judge(&views, &Knowledge { light: Some(&light), ..Knowledge::default() });
    check_named(base, &judged, &views, (CellFate::Dark, LossCause::Dark));
    let unknown = base.judge(&views, &Knowledge::default());
    let [dark, unexplained] = [LossCause::Dark, LossCause::Unexplained].map(|cause| unknown.losses.area_mm2(cause));
    assert!(dark == 0.0 && unexplained > 0.0, "nothing is known of the light");
    // Cells that were taken out.
    let mut views = base.scan(&sim(), base.as_planned());
    let mut removed = vec![Removed::default(); views.len()];
    for (view, removed) in views.iter_mut().zip(&mut removed) {
        let cells = view.scan.scanner_cloud.points_mm.iter_mut().enumerate();
        for (cell, point) in cells.filter(|(cell, point)| cell % 5 < 3 && cell / 700 % 5 < 3 && point[0].is_finite()) {
            *point = [f32::NAN; 3];
            removed.cells.push(cell as u32);
        }
    }
    let judged = base.judge(&views, &Knowledge { removed, ..Knowledge::default() });
    let [filtered, unexplained] =
        [LossCause::Filtered, LossCause::Unexplained].map(|cause| asked_share(&judged, judged.losses.area_mm2(cause)));
    assert!(filtered > 0.02 && unexplained < 0.005, "{filtered} {unexplained}");
}

#[test]
fn remedies_follow_from_cause_views_and_level() {
    assert_eq!(LossCause::Dark.remedy(1.0, Some(5)), LossRemedy::Brighter);
    assert_eq!(LossCause::Dark.remedy(1.0, Some(9)), LossRemedy::Spray);
    assert_eq!(LossCause::Saturated.remedy(1.0, Some(0)), LossRemedy::Spray);
    assert_eq!(LossCause::Saturated.remedy(1.0, None), LossRemedy::Darker);
    assert_eq!(LossCause::Specular.remedy(1.0, None), LossRemedy::OtherView);
    assert_eq!(LossCause::Specular.remedy(2.5, None), LossRemedy::Spray);
    assert_eq!(LossCause::Concave.remedy(3.0, None), LossRemedy::Nothing);
}
