//! Checks on request: what `vantage check` finds, found by the server too.

use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};
use vantage::cell::{Presets, SpecKind, SpecLibrary};
use vantage::geometry::LengthUnit;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::service::plan_job::{Artifact, PlanJob, plan_sha256};
use vantage::wire::echo::Echo;
use vantage::wire::part_size::SizeLimits;
use vantage::wire::plan::PlanDocument;

use super::api::Api;
use crate::support::box_mesh;

#[tokio::test]
async fn presets_and_parameters_are_recognised_and_sound() {
    let api = Api::start().await;
    let check = async |document: Value| api.post_json("/api/v1/check", &json!({ "document": document })).await.ok(200);
    for (kind, document) in [
        ("scanner", serde_json::to_value(Presets.scanner("transcan-c").expect("a preset"))),
        ("robot", serde_json::to_value(Presets.robot("hans-e05").expect("a preset"))),
        ("turntable", serde_json::to_value(Presets.turntable(&Presets.names(SpecKind::Turntable)[0]).expect("a preset"))),
        ("cell", serde_json::to_value(Presets.cell("e05-transcan").expect("a preset"))),
        ("params", serde_json::to_value(PlanParams::default())),
    ] {
        let report = check(document.expect("JSON")).await;
        assert_eq!(
            (&report["kind"], &report["sound"], &report["findings"]),
            (&json!(kind), &json!(true), &json!([])),
            "{report}"
        );
    }
}

#[tokio::test]
async fn findings_name_field_value_and_range() {
    let api = Api::start().await;
    let check = async |document: Value| api.post_json("/api/v1/check", &json!({ "document": document })).await.ok(200);
    let report = check(json!({"scan": {"brightness": 12}, "selection": {"target": 2.0}})).await;
    assert_eq!((&report["kind"], &report["sound"], &report["description"]), (&json!("params"), &json!(false), &json!(null)));
    let found = [
        json!({"pointer": "/scan/brightness", "detail": "is 12; allowed is 0 to 9"}),
        json!({"pointer": "/selection/target", "detail": "is 2; allowed is 0 to 1"}),
    ];
    assert_eq!(report["findings"], json!(found));
    let shape = check(json!({"scan": {"brightness": "bright"}})).await;
    assert_eq!(shape["findings"][0]["pointer"], "/scan/brightness", "{shape}");
    let unknown = check(json!({"hello": 1})).await;
    assert_eq!((&unknown["kind"], &unknown["findings"][0]["pointer"]), (&json!(null), &json!("")), "{unknown}");
}

/// The document and the check had the range each for itself.
#[tokio::test]
async fn the_range_of_the_temperature_is_that_of_the_document() {
    let api = Api::start().await;
    let document = serde_json::to_value(vantage::http::openapi()).expect("JSON");
    let schema = &document["components"]["schemas"]["CheckRequest"]["properties"]["temperature_c"];
    let [min, max] = ["minimum", "maximum"].map(|end| schema[end].as_f64().expect("a number"));
    for (celsius, is_in_range) in [(min.next_down(), false), (min, true), (max, true), (max.next_up(), false)] {
        let request = json!({"document": {"scan": {"brightness": 5}}, "temperature_c": celsius});
        let told = api.post_json("/api/v1/check", &request).await.text();
        // It applies to programs alone, which is another finding.
        assert_ne!(told.contains(&format!("°C; allowed is {min} to {max} °C")), is_in_range, "{told}");
    }
}

#[tokio::test]
async fn limits_are_held_against_the_scanner_of_a_cell() {
    let api = Api::start().await;
    let beyond = json!({"limits": {"camera_deg": 89}});
    let report = api.post_json("/api/v1/check", &json!({"document": beyond, "cell": "e05-transcan"})).await.ok(200);
    assert_eq!((&report["sound"], &report["findings"][0]["pointer"]), (&json!(false), &json!("/limits/camera_deg")), "{report}");
    let alone = api.post_json("/api/v1/check", &json!({"document": beyond})).await.ok(200);
    assert_eq!(alone["sound"], true, "it is not known for which scanner: {alone}");
}

/// The dashboard holds a file against these before it is sent; it had a rule of its own.
#[tokio::test]
async fn the_size_of_a_part_that_suits_is_told_of_a_cell_and_of_a_scanner() {
    let api = Api::start().await;
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("valid");
    let edges = |limits: SizeLimits| json!(limits.edge_mm());
    for (beside, told) in [
        (json!({"cell": "e05-transcan"}), edges(SizeLimits::new(&cell.scanner, Some(&cell)))),
        (json!({"cell": "none", "scanner": "transcan-c"}), edges(SizeLimits::new(&cell.scanner, None))),
        (json!({}), json!(null)),
    ] {
        let mut request = beside.clone();
        // Parameters that are not sound are no reason to say nothing.
        for document in [json!({"part": {}}), json!({"part": {}, "scan": {"brightness": 12}})] {
            request["document"] = document;
            let report = api.post_json("/api/v1/check", &request).await.ok(200);
            assert_eq!((&report["kind"], &report["part_edge_mm"]), (&json!("params"), &told), "{beside}: {report}");
        }
    }
}

#[tokio::test]
async fn a_tolerance_beyond_the_noise_is_a_warning_and_no_finding() {
    let api = Api::start().await;
    let feature = json!({"region": {"kind": "faces", "faces": [0]}, "tolerance_mm": 0.05, "target": 0.95});
    let document = json!({"regions": {"features": [feature]}});
    let report = api.post_json("/api/v1/check", &json!({ "document": document })).await.ok(200);
    assert_eq!((&report["sound"], &report["findings"]), (&json!(true), &json!([])), "{report}");
    assert_eq!(report["warnings"][0]["pointer"], "/regions/features/0/tolerance_mm", "{report}");
    assert!(report["warnings"][0]["detail"].as_str().is_some_and(|detail| detail.contains("0.156 mm")), "{report}");
}

#[tokio::test]
async fn a_request_may_name_only_what_there_is() {
    let api = Api::start().await;
    let missing = json!({"document": {}, "mesh_id": uuid::Uuid::nil().to_string()});
    api.post_json("/api/v1/check", &missing).await.problem_at("invalid_fields", &["/mesh_id"]);
    api.post_json("/api/v1/check", &json!({"document": {}, "cell": "nowhere"})).await.problem_at("invalid_fields", &["/cell"]);
    api.post_json("/api/v1/check", &json!({})).await.problem("bad_shape");
}

/// A plan with its program, and a program of which one joint was moved.
#[tokio::test(flavor = "multi_thread")]
async fn a_program_is_recomputed_from_itself() {
    let api = Api::start().await;
    let (plan, program) = tokio::task::spawn_blocking(planned).await.expect("a plan");
    let sound = json!({"document": program, "cell": "e05-transcan", "plan": plan});
    let report = api.post_json("/api/v1/check", &sound).await.ok(200);
    assert_eq!((&report["kind"], &report["sound"]), (&json!("program"), &json!(true)), "{report}");
    for (pointer, value) in [("/cell", json!(null)), ("/part_number", json!("another")), ("/version", json!("another"))] {
        let mut other = sound.clone();
        match pointer {
            "/part_number" => drop(other["plan"].as_object_mut().expect("a plan").insert("part_number".into(), value)),
            _ => *other["plan"].pointer_mut(pointer).expect("is there") = value,
        }
        for cell in [json!("e05-transcan"), json!(null)] {
            other["cell"] = cell;
            let report = api.post_json("/api/v1/check", &other).await.ok(200);
            let told = report["findings"][0]["detail"].as_str().unwrap_or_default();
            assert!(report["sound"] == false && told.contains("is made from plan"), "with another {pointer}: {report}");
        }
    }
    let mut bent = sound.clone();
    let steps = bent["document"]["steps"].as_array_mut().expect("steps");
    steps.remove(0);
    let report = api.post_json("/api/v1/check", &bent).await.ok(200);
    assert_eq!(report["sound"], false, "a step is missing: {report}");
    let report = api.post_json("/api/v1/check", &json!({"document": plan, "cell": "e05-transcan"})).await.ok(200);
    assert_eq!((&report["kind"], &report["sound"]), (&json!("plan"), &json!(true)), "{report}");
    let told = report["description"].as_str().unwrap_or_default();
    assert!(told.contains(": stations, collisions without the part; not checked: coverage (give the part), moves"), "{report}");
    let mut of_another = plan.clone();
    of_another["cell"]["robot"] = json!("another");
    let report = api.post_json("/api/v1/check", &json!({"document": of_another, "cell": "e05-transcan"})).await.ok(200);
    assert_eq!((&report["sound"], &report["findings"][0]["pointer"]), (&json!(false), &json!("/cell/robot")), "{report}");
}

/// A damaged plan switched the check of collisions off, another part and other captures were not noticed.
#[tokio::test(flavor = "multi_thread")]
async fn a_program_is_held_against_a_sound_plan_of_its_part() {
    let api = Api::start().await;
    let (plan, program) = tokio::task::spawn_blocking(planned).await.expect("a plan");
    let cube = api.mesh().await;
    for document in [&plan, &program] {
        let mut with_another = json!({"document": document, "cell": "e05-transcan", "mesh_id": cube});
        if document == &program {
            with_another["plan"] = plan.clone();
        }
        let problem = api.post_json("/api/v1/check", &with_another).await.problem_at("invalid_fields", &["/mesh_id"]);
        let told = problem["errors"][0]["detail"].as_str().unwrap_or_default();
        assert!(told.contains("is not the part of the plan"), "{problem}");
    }
    let found = async |request: Value| {
        let report = api.post_json("/api/v1/check", &request).await.ok(200);
        assert_eq!(report["sound"], false, "{report}");
        report["findings"].to_string()
    };
    let without_plan = json!({"document": program, "cell": "e05-transcan", "mesh_id": cube});
    assert!(found(without_plan).await.contains("without its plan"));
    for (pointer, value, told) in [
        ("/cell/table_from_part/quaternion_xyzw", json!([0, 0, 0, 0]), "/cell/table_from_part/quaternion_xyzw: has norm 0"),
        ("/params/motion/clearance_mm", json!(-20.0), "/params/motion/clearance_mm: is -20 mm; allowed is 1 to 200 mm"),
    ] {
        let mut damaged = plan.clone();
        *damaged.pointer_mut(pointer).expect("is there") = value;
        let mut of_damaged = program.clone();
        let bytes = serde_json::from_value::<PlanDocument>(damaged.clone()).expect("a plan").to_bytes();
        of_damaged["plan_sha256"] = plan_sha256(&bytes).into();
        let findings = found(json!({"document": of_damaged, "cell": "e05-transcan", "plan": damaged})).await;
        assert!(findings.contains(told), "{findings}");
    }
    let mut dimmed = program.clone();
    let scan = dimmed["steps"].as_array_mut().expect("steps").iter_mut().find(|step| step["op"] == "scan").expect("a scan");
    scan["brightness"] = json!(9);
    let findings = found(json!({"document": dimmed, "cell": "e05-transcan", "plan": plan})).await;
    assert!(findings.contains("is captured at brightness [9]; the plan has [5]"), "{findings}");
}

fn planned() -> (Value, Value) {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("it is valid");
    let mesh = box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]);
    let mut params = PlanParams::default();
    (params.part.samples_per_mm2, params.part.patch_edge_mm, params.missed.remedies) = (Some(0.02), Some(20.0), 0);
    (params.candidates.even_directions, params.selection.max_views) = (Some(12), Some(2));
    let job = PlanJob {
        mesh: &mesh,
        fixture: None,
        fixture_sha256: None,
        part_name: "box".into(),
        part_sha256: &"0a".repeat(32),
        unit: LengthUnit::Millimetre,
        scanner: &cell.scanner,
        cell: Some(&cell),
        roadmaps: None,
        rescan: None,
        params: &params,
        echo: Echo::default(),
        date: None,
    };
    let files = job.execute(&Context::new(&AtomicBool::new(false), &Silent)).expect("a plan");
    let names: BTreeSet<&str> = files.iter().map(|file| &*file.name).collect();
    let own = ["program.cps", "program.py", "program.csv"];
    let others = ["program.mod", "program.src", "program.dat", "program.ls", "program.script"];
    for name in own.map(str::to_owned).into_iter().chain(others.map(|name| name.replace("program.", "program.foreign."))) {
        let text = |file: &Artifact| String::from_utf8_lossy(&file.bytes).into_owned();
        let text = files.iter().find(|file| file.name == name).map(text).unwrap_or_else(|| panic!("{name} of {names:?}"));
        assert_eq!(text.contains("WARNING: FORCED"), name.contains("foreign"), "{name}");
    }
    assert!(
        others.iter().all(|name| !names.contains(name)),
        "under their own names they would be taken for the robot's: {names:?}"
    );
    let file = |name: &str| {
        let file = files.iter().find(|file| file.name == name).expect("a file");
        serde_json::from_slice(&file.bytes).expect("JSON")
    };
    (file("plan.json"), file("program.json"))
}
