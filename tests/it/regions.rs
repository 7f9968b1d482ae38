//! A feature of which nothing can be measured, beside a region that is: what a plan and all of its files say of the two.

use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};
use vantage::check::check_plan;
use vantage::geometry::LengthUnit;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, FeatureParams, InterestParams, PlanParams, Region};
use vantage::planning::plan::{Cause, StopReason};
use vantage::service::plan_job::PlanJob;
use vantage::wire::echo::Echo;
use vantage::wire::plan::PlanDocument;

use crate::report::markup::well_formed;
use crate::support::{box_mesh, nominal_scanner, plan_viewpoints};

/// Area of the top of the block, faces 2 and 3.
const TOP_MM2: f64 = 60.0 * 40.0;

/// Few samples and candidates, and a side of the block that is to be measured to nine tenths.
fn quick() -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm, params.missed.remedies) = (Some(0.3), Some(10.0), 0);
    params.regions.interest = vec![InterestParams {
        name: Some("side".into()),
        region: Region::Faces { faces: vec![4, 5] },
        weight: 1.0,
        target: Some(0.9),
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    }];
    params
}

/// Parameters with a top whose tolerance the scanner's noise cannot serve.
fn with_fine_top() -> PlanParams {
    let mut params = quick();
    params.regions.features = vec![FeatureParams {
        name: Some("fine <top>".into()),
        region: Region::Faces { faces: vec![2, 3] },
        tolerance_mm: 0.05,
        point_spacing_mm: None,
        target: Some(0.95),
    }];
    params
}

/// Text files of a plan of the block, by name.
fn files(params: &PlanParams) -> impl Fn(&str) -> Option<String> + use<> {
    let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner());
    let job = PlanJob {
        mesh: &mesh,
        fixture: None,
        fixture_sha256: None,
        part_name: "block".into(),
        part_sha256: &"0a".repeat(32),
        unit: LengthUnit::Millimetre,
        scanner: &scanner,
        cell: None,
        roadmaps: None,
        rescan: None,
        params,
        echo: Echo::default(),
        date: None,
    };
    let files = job.execute(&Context::new(&AtomicBool::new(false), &Silent)).expect("a plan");
    move |name| files.iter().find(|file| file.name == name).map(|file| String::from_utf8_lossy(&file.bytes).into_owned())
}

#[test]
fn a_feature_of_which_nothing_is_measured_is_not_called_met() {
    let plan = plan_viewpoints(&box_mesh([0.0; 3], [60.0, 40.0, 30.0]), &nominal_scanner(), &with_fine_top()).plan;
    assert!(plan.coverage.of_coverable() >= 0.985, "the plan's own target is met: {:?}", plan.coverage);
    assert_eq!(plan.stopped_because, StopReason::RegionsUnmet);
    let [side, top] = &plan.coverage.regions[..] else { panic!("two regions: {:?}", plan.coverage.regions) };
    assert_eq!((side.is_met(), top.is_met()), (Some(true), Some(false)));
    assert!((top.asked_area_mm2 / TOP_MM2 - 1.0).abs() < 1e-9 && top.samples > 100, "{top:?}");
    assert_eq!((top.coverable_area_mm2, top.measured_area_mm2), (0.0, 0.0));
    let [(cause, missed_mm2)] = top.missed_mm2[..] else { panic!("one cause: {top:?}") };
    assert_eq!(cause, Cause::BelowGrade);
    assert!((missed_mm2 / TOP_MM2 - 1.0).abs() < 1e-9 && (top.beyond_noise_area_mm2 / TOP_MM2 - 1.0).abs() < 1e-9, "{top:?}");
    assert!(side.missed_mm2.windows(2).all(|pair| pair[0].1 >= pair[1].1), "the largest first: {side:?}");
}

#[test]
fn a_plan_that_meets_its_regions_ends_with_its_target() {
    let plan = plan_viewpoints(&box_mesh([0.0; 3], [60.0, 40.0, 30.0]), &nominal_scanner(), &quick()).plan;
    assert_eq!(plan.stopped_because, StopReason::Target);
    assert_eq!(plan.coverage.regions[0].is_met(), Some(true));
}

#[test]
fn every_file_tells_regions_with_what_is_asked_reached_and_missed() {
    let file = files(&with_fine_top());
    let text = |name: &str| file(name).unwrap_or_else(|| panic!("there is no {name}"));
    let plan: Value = serde_json::from_str(&text("plan.json")).expect("JSON");
    let coverage: Value = serde_json::from_str(&text("coverage.json")).expect("JSON");
    assert_eq!(plan["stopped_because"], "regions_unmet");
    let regions = &plan["coverage"]["regions"];
    assert_eq!(&coverage["coverage"]["regions"], regions);
    assert_eq!((&regions[0]["kind"], &regions[0]["met"]), (&json!("interest"), &json!(true)), "{regions}");
    let top = &regions[1];
    assert_eq!((&top["kind"], &top["met"], &top["of_asked"]), (&json!("feature"), &json!(false), &json!(0.0)), "{top}");
    assert_eq!((&top["tolerance_mm"], &top["missed"][0]["reason"]), (&json!(0.05), &json!("below_grade")), "{top}");
    assert_eq!((&top["independent_of_asked"], &top["independently_met"]), (&json!(0.0), &json!(false)), "{top}");
    let min_mm = top["min_tolerance_mm"].as_f64().expect("the finest tolerance");
    assert!((0.155..0.156).contains(&min_mm), "{min_mm}");
    let noise = "tolerance too fine for the scanner's noise; the finest that this noise allows is ±0.078 mm";
    let begins = "not measured well enough (2 400.0 mm²; ";
    assert!(top["why_unmet"].as_str().is_some_and(|why| why.starts_with(begins) && why.contains(noise)), "{top}");
    let document: PlanDocument = serde_json::from_value(plan).expect("a plan");
    assert_eq!(check_plan(&document, None), Ok(()));

    let report = text("report.txt");
    for said in [
        "stopped because: regions_unmet",
        "\"fine <top>\": feature, tolerance ±0.025 mm",
        "0.0 of 2 400.0 mm² measured, 0.00 %",
        noise,
    ] {
        assert!(report.contains(said), "{said:?} is not in\n{report}");
    }
    assert!(report.contains("target 95.00 %: NOT MET") && report.contains("target 90.00 %: met"), "{report}");
    assert!(report.contains("NOT MET (independent 0.00 %, standard error 0."), "{report}");
    assert!(!report.contains("standard error 0.00 points"), "samples tell no share without error: {report}");

    let page = text("report.html");
    well_formed(&page).expect("well-formed");
    for said in [
        "Regions and features",
        "1 of 2 does not reach the target.",
        "fine &lt;top&gt;",
        "Not measured well enough",
        "<b>Not met</b>",
    ] {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
    assert!(page.contains(&noise.replace('\'', "&#39;")), "the page lacks the reason");

    let table = text("regions.csv");
    let rows: Vec<&str> = table.split("\r\n").filter(|row| !row.is_empty()).collect();
    assert_eq!(rows.len(), 3, "{table}");
    let added = ",plan_sha256,independent_samples,independent_of_asked,independent_standard_error,independently_met";
    assert!(rows[0].ends_with(added) && rows[2].ends_with(",false"), "{table}");
    let told: Vec<&str> = rows[2].rsplit(',').take(3).collect();
    let error = told[1].parse::<f64>().unwrap_or_default();
    assert!(told[2] == "0" && error > 0.0 && error < 0.002, "{table}");
    assert!(rows[1].starts_with("side,interest,,") && rows[1].contains(",0.9,true,"), "{table}");
    assert!(rows[2].starts_with("fine <top>,feature,0.05,0.155") && rows[2].contains(",0.95,false,"), "{table}");
}

/// The check asked for a curve without the views that have no path, which no plan has.
#[test]
fn a_plan_whose_views_have_no_path_passes_its_check() {
    let text = files(&quick())("plan.json").expect("a plan");
    let mut document: PlanDocument = serde_json::from_str(&text).expect("a plan");
    document.viewpoints.iter_mut().for_each(|view| view.rejected = Some(Cause::NoPath.as_str().to_owned()));
    assert_eq!(check_plan(&document, None), Ok(()));
    document.coverage.curve.clear();
    assert!(check_plan(&document, None).is_err(), "each chosen view has its entry");
}

#[test]
fn a_plan_without_regions_has_no_place_for_them() {
    let mut params = quick();
    params.regions.interest.clear();
    let file = files(&params);
    assert_eq!(file("regions.csv"), None);
    assert!(!file("report.txt").expect("a report").contains("regions of interest"));
    assert!(!file("report.html").expect("a report").contains("Regions and features"));
}
