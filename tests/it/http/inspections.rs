//! The loop over HTTP: a part is planned, its program runs on the twin, the simulated scanner takes the scans, they are inspected, and
//! what they lack is planned again and scanned; and what the routes refuse.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};
use vantage::cell::{Presets, SpecLibrary};
use vantage::geometry::{LengthUnit, mesh_io};
use vantage::inspection::simulated_scanner::SimulationParams;
use vantage::planning::context::{Context, Silent};
use vantage::service::KeptCells;
use vantage::service::inspect_job::{InspectedPart, PlannedViews};
use vantage::service::planner::plan_files;
use vantage::service::simulate_scans::{SimulatedScans, TRUTH_FILE};
use vantage::wire::plan::PlanDocument;
use vantage::wire::run::RunRecordDocument;

use super::api::{Api, cube, http_options, service_options};

const EDGE_MM: f64 = 60.0;

/// A service that really plans.
pub(super) async fn planning() -> Api {
    let mut options = service_options();
    options.max_upload_bytes = 64 << 20;
    let cells = KeptCells::default();
    let planner = Arc::new(move |input: &_, ctx: &Context<'_>| plan_files(input, &cells, ctx));
    Api::start_planning(options, http_options(), planner, None).await
}

/// Id of a planned job.
async fn planned(api: &Api) -> String {
    let mesh = api.send("POST", "/api/v1/meshes?unit=mm", &[], cube(EDGE_MM)).await.ok(201);
    let params = json!({
        "candidates": {"strategies": ["ellipsoid"], "rolls_deg": [0], "step_small_deg": 60, "step_large_deg": 60},
        "part": {"patch_edge_mm": 10, "samples_per_mm2": 0.05}, "missed": {"remedies": 0}, "selection": {"max_views": 3},
    });
    // As many labels as there may be: a rescan then has no room for its own.
    let labels: serde_json::Map<String, Value> = (0..32).map(|i| (format!("l{i}"), json!(""))).collect();
    let request =
        json!({"mesh_id": mesh["id"], "cell": "e05-transcan", "params": params, "labels": labels, "part_number": "PN-7"});
    let job = api.post_json("/api/v1/jobs", &request).await.ok(202)["id"].as_str().expect("an id").to_owned();
    let ended = api.get(&format!("/api/v1/jobs/{job}?wait=60s")).await.ok(200);
    assert_eq!(ended["state"], "succeeded", "{ended}");
    job
}

/// Runs the program of a job on the twin; the run.
async fn run(api: &Api, job: &str) -> String {
    let run = api.post_json("/api/v1/runs", &json!({"job_id": job, "time_factor": 100})).await.ok(202);
    let run = run["id"].as_str().expect("an id").to_owned();
    let done = api.get(&format!("/api/v1/runs/{run}?wait=60s")).await.ok(200);
    assert_eq!(done["state"], "done", "{done}");
    run
}

/// Files of the scans of a job, as the simulated scanner exports them.
async fn scans(api: &Api, job: &str, run: &str, sim: &SimulationParams) -> Vec<(String, Vec<u8>)> {
    let plan = api.get(&format!("/api/v1/jobs/{job}/plan")).await.ok(200);
    let plan: PlanDocument = serde_json::from_value(plan).expect("a plan");
    let record = api.get(&format!("/api/v1/runs/{run}/record")).await.ok(200);
    let record: RunRecordDocument = serde_json::from_value(record).expect("a record");
    let mesh =
        mesh_io::read(cube(EDGE_MM).as_bytes(), Some(LengthUnit::Millimetre), &mesh_io::Limits::default()).expect("a mesh").mesh;
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a cell");
    let part = InspectedPart { mesh: &mesh, fixture: None, name: "cube", scanner: &cell.scanner, cell: Some(&cell) };
    let planned = PlannedViews::new(&plan, Some(&record), Some(&cell));
    let simulated = SimulatedScans { part, as_built: &mesh, planned: &planned, plan_params: &plan.params, plan_sha256: "", sim };
    let never = AtomicBool::new(false);
    let files = simulated.files(&|_, _| (), &Context::new(&never, &Silent)).expect("nobody cancels");
    files.into_iter().filter(|file| file.name != TRUTH_FILE).map(|file| (file.name.into_owned(), file.bytes)).collect()
}

/// Uploads scans of a job; their number.
async fn upload(api: &Api, job: &str, files: Vec<(String, Vec<u8>)>) -> usize {
    for (name, bytes) in &files {
        let path = format!("/api/v1/jobs/{job}/scans?name={name}");
        let scan = api.send("POST", &path, &[], bytes.clone()).await.ok(201);
        let again = api.send("POST", &path, &[], bytes.clone()).await.ok(201);
        assert_eq!(scan, again, "the same file is the same scan");
        let file = api.get(&format!("/api/v1/scans/{}/file", scan["id"].as_str().expect("an id"))).await;
        assert!(file.bytes == *bytes, "{name} comes back byte for byte");
    }
    files.len()
}

async fn inspected(api: &Api, job: &str, request: &Value) -> Value {
    let accepted = api.post_json(&format!("/api/v1/jobs/{job}/inspections"), request).await;
    let id = accepted.ok(202)["id"].as_str().expect("an id").to_owned();
    assert_eq!(accepted.header("location"), format!("/api/v1/inspections/{id}"));
    api.get(&format!("/api/v1/inspections/{id}?wait=60s")).await.ok(200)
}

fn share(of: &Value, name: &str) -> f64 {
    of[name].as_f64().unwrap_or_else(|| panic!("{name} in {of}"))
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_part_is_planned_run_scanned_inspected_and_scanned_again() {
    let api = planning().await;
    let job = planned(&api).await;
    let ran = run(&api, &job).await;
    let sim = SimulationParams { step_px: 16, grazing_deg: vec![50.0, 60.0], ..SimulationParams::default() };
    let files = scans(&api, &job, &ran, &sim).await;
    let count = upload(&api, &job, files).await;
    let listed = api.get(&format!("/api/v1/jobs/{job}/scans")).await.ok(200);
    assert_eq!(listed["items"].as_array().expect("a list").len(), count);

    let inspection = inspected(&api, &job, &json!({"run_id": ran})).await;
    assert_eq!(inspection["state"], "succeeded", "{inspection}");
    let path = format!("/api/v1/inspections/{}", inspection["id"].as_str().expect("an id"));
    let result = api.get(&format!("{path}/result")).await.ok(200);
    let coverage = &result["coverage"];
    let [planned, measured, lost, gained] =
        ["planned_of_asked", "measured_of_asked", "lost_of_asked", "gained_of_asked"].map(|name| share(coverage, name));
    assert!((planned + gained - lost - measured).abs() < 1e-9, "{coverage}");
    let by_cause: f64 = result["losses"].as_array().expect("a list").iter().map(|loss| share(loss, "of_asked")).sum();
    assert!((by_cause - lost).abs() < 1e-9, "{by_cause} {lost}");
    assert!(lost > 0.01, "the scanner returns little beyond 55 degrees: {coverage}");
    assert!(share(&result["alignment"], "inlier_share") > 0.9, "{}", result["alignment"]);
    assert!(share(&result["deviation"]["statistics"], "rms_mm") < 0.05, "{}", result["deviation"]["statistics"]);
    for file in ["losses", "learned"] {
        api.get(&format!("{path}/{file}")).await.ok(200);
    }
    assert!(api.get(&format!("{path}/deviation?format=ply")).await.bytes.starts_with(b"ply\n"));
    assert!(api.get(&format!("{path}/deviation?format=csv")).await.text().starts_with("face,"));
    let report = api.get(&format!("{path}/report?format=html")).await;
    assert!(report.header("content-security-policy").contains("sandbox") && report.text().contains("Losses"));
    assert_eq!(report.header("content-disposition"), "inline; filename=\"PN-7_inspection.html\"");

    let rescan = api.post_json(&format!("{path}/rescans"), &json!({"params": {"min_gain": 0.001}})).await;
    let second = rescan.ok(202)["id"].as_str().expect("an id").to_owned();
    let ended = api.get(&format!("/api/v1/jobs/{second}?wait=60s")).await.ok(200);
    assert_eq!(ended["state"], "succeeded", "{ended}");
    let views = api.get(&format!("/api/v1/jobs/{second}/plan")).await.ok(200)["viewpoints"].as_array().expect("views").len();
    assert!((1..=4).contains(&views), "{views} further views");
    let ran = run(&api, &second).await;
    let files = scans(&api, &second, &ran, &sim).await;
    upload(&api, &second, files).await;
    let after = inspected(&api, &second, &json!({"run_id": ran})).await;
    assert_eq!(after["state"], "succeeded", "{after}");
    let all = share(&after["summary"], "measured_in_all_of_asked");
    assert!(all > measured + 0.005, "{all} after {measured}");

    // What is stored outlives the service's routes for its job.
    api.send("DELETE", &path, &[], "").await;
    api.get(&path).await.problem("inspection_not_found");
}

#[tokio::test]
async fn what_cannot_be_inspected_is_refused_with_its_reason() {
    let api = Api::start().await;
    let job = super::runs::driven(&api).await;
    api.post_json(&format!("/api/v1/jobs/{job}/inspections"), &json!({})).await.problem("no_scans");
    let path = format!("/api/v1/jobs/{job}/scans");
    api.send("POST", &format!("{path}?unit=yard"), &[], "x").await.problem("bad_query");
    api.send("POST", &format!("{path}?frame=world"), &[], "x").await.problem("bad_query");
    let scan = api.send("POST", &format!("{path}?name=view_00.ply"), &[], "no cloud at all").await.ok(201);
    let refused = inspected(&api, &job, &json!({})).await;
    assert_eq!((&refused["state"], &refused["problem"]["code"]), (&json!("failed"), &json!("job_input_invalid")), "{refused}");
    assert_eq!(refused["problem"]["errors"][0]["pointer"], "/scans/0", "{refused}");
    let id = refused["id"].as_str().expect("an id");
    for result in ["result", "losses", "deviation", "learned", "report"] {
        api.get(&format!("/api/v1/inspections/{id}/{result}")).await.problem("no_inspection");
    }
    api.post_json(&format!("/api/v1/inspections/{id}/rescans"), &json!({})).await.problem("no_inspection");
    api.send("POST", &format!("/api/v1/inspections/{id}/cancel"), &[], "").await.problem("inspection_ended");
    let request = json!({"scans": [id]});
    api.post_json(&format!("/api/v1/jobs/{job}/inspections"), &request).await.problem_at("invalid_fields", &["/scans/0"]);
    let request = json!({"params": {"compare": {"tolerance_mm": -1}}});
    let at = "/params/compare/tolerance_mm";
    api.post_json(&format!("/api/v1/jobs/{job}/inspections"), &request).await.problem_at("invalid_fields", &[at]);
    let scan = scan["id"].as_str().expect("an id");
    assert_eq!(api.send("DELETE", &format!("/api/v1/scans/{scan}"), &[], "").await.status, 204);
    api.get(&format!("/api/v1/scans/{scan}")).await.problem("scan_not_found");
    let listed = api.get(&format!("/api/v1/inspections?job_id={job}&state=failed")).await.ok(200);
    assert_eq!(listed["items"].as_array().expect("a list").len(), 1);
}

/// A second inspection was computed: the key was ignored.
#[tokio::test]
async fn a_key_starts_one_inspection_however_often_it_comes() {
    let api = Api::start().await;
    let job = super::runs::driven(&api).await;
    let path = format!("/api/v1/jobs/{job}/inspections");
    let send = async |key: &str, body: String| {
        api.send("POST", &path, &[("content-type", "application/json"), ("idempotency-key", key)], body).await
    };
    let request = json!({}).to_string();
    // A request that was refused has used no key.
    send("k1", request.clone()).await.problem("no_scans");
    let scan = api.send("POST", &format!("/api/v1/jobs/{job}/scans?name=a.xyz"), &[], "1 2 3\n4 5 6\n").await.ok(201);
    // Two at the same time, and one later, written in another way.
    let (a, b) = tokio::join!(send("k1", request.clone()), send("k1", request.clone()));
    let (a, b) = (a.ok(202), b.ok(202));
    assert_eq!(a, b);
    let location = format!("/api/v1/inspections/{}", a["id"].as_str().expect("an id"));
    api.get(&format!("{location}?wait=60s")).await.ok(200);
    let again = send("k1", json!({"run_id": null}).to_string()).await;
    assert_eq!((again.ok(202), again.header("location")), (a.clone(), location.as_str()));
    send("k1", json!({"scans": [scan["id"]]}).to_string()).await.problem("idempotency_mismatch");
    assert_ne!(send("k2", request).await.ok(202)["id"], a["id"]);
    let listed = api.get(&format!("/api/v1/inspections?job_id={job}")).await.ok(200);
    assert_eq!(listed["items"].as_array().expect("a list").len(), 2);
}

#[tokio::test]
async fn scans_are_of_a_view_of_the_plan_and_go_with_their_job_as_inspections_do() {
    let api = Api::start().await;
    let job = super::runs::driven(&api).await;
    let views = api.get(&format!("/api/v1/jobs/{job}")).await.ok(200)["summary"]["views_chosen"].as_u64().expect("a number");
    let of_view = |view: u64| format!("/api/v1/jobs/{job}/scans?view={view}&name=a.xyz");
    let refused = api.send("POST", &of_view(views), &[], "1 2 3\n4 5 6\n").await.problem_at("bad_query", &["view"]);
    assert!(refused["detail"].as_str().is_some_and(|said| said.contains(&format!("has {views} viewpoints"))), "{refused}");
    let path = of_view(views - 1);
    let scan = api.send("POST", &path, &[], "1 2 3\n4 5 6\n").await.ok(201);
    let inspection = inspected(&api, &job, &json!({})).await;
    assert!(inspection["ended_at"].is_string(), "{inspection}");
    // The label that holds the job holds its evidence.
    let run = run(&api, &job).await;
    let labelled = async |labels: Value| {
        api.send("PUT", &format!("/api/v1/jobs/{job}/labels"), &[("content-type", "application/json")], labels.to_string()).await
    };
    labelled(json!({"labels": {"hold": ""}})).await.ok(200);
    let id = |document: &Value| document["id"].as_str().expect("an id").to_owned();
    for path in [format!("scans/{}", id(&scan)), format!("inspections/{}", id(&inspection)), format!("runs/{run}")] {
        let path = format!("/api/v1/{path}");
        api.send("DELETE", &path, &[], "").await.problem("job_held");
        api.get(&path).await.ok(200);
    }
    labelled(json!({"labels": {}})).await.ok(200);
    assert_eq!(api.send("DELETE", &format!("/api/v1/runs/{run}"), &[], "").await.status, 204);
    assert_eq!(api.send("DELETE", &format!("/api/v1/jobs/{job}"), &[], "").await.status, 204);
    api.get(&format!("/api/v1/scans/{}", scan["id"].as_str().expect("an id"))).await.problem("scan_not_found");
    api.get(&format!("/api/v1/inspections/{}", inspection["id"].as_str().expect("an id"))).await.problem("inspection_not_found");
    api.nothing_is_left().await;
}
