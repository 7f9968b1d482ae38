//! Runs of a real, small program on the twin: to the end, paused, stopped, followed; what live runs and leases refuse.

use std::sync::OnceLock;
use std::time::Duration;

use axum::body::Body;
use serde_json::{Value, json};
use sqlx::Connection as _;
use vantage::cell::{Presets, SpecLibrary};
use vantage::planning::context::Context;
use vantage::service::planner::{Artifact, JobError, JobInput, plan_files};
use vantage::service::runs::cell_sha256;
use vantage::service::{KeptCells, OperatorCell, Options};

use super::api::{Answer, Api, cube, http_options, service_options};
use super::events::Listener;

/// A plan of two views, quickly made.
fn params() -> Value {
    json!({
        "candidates": {"strategies": ["ellipsoid"], "rolls_deg": [0], "step_small_deg": 90, "step_large_deg": 90},
        "part": {"patch_edge_mm": 20, "samples_per_mm2": 0.02}, "visibility": {"engine": "rays"}, "missed": {"remedies": 0},
        "selection": {"max_views": 2},
    })
}

/// Files of a real plan. All jobs that ask for it have the same input, so it is made once.
pub(super) fn planned(input: &JobInput, ctx: &Context<'_>) -> Result<Vec<Artifact>, JobError> {
    static FILES: OnceLock<Vec<Artifact>> = OnceLock::new();
    Ok(FILES.get_or_init(|| plan_files(input, &KeptCells::default(), ctx).expect("a plan")).clone())
}

/// Id of a job with a program.
pub(super) async fn driven(api: &Api) -> String {
    let mesh = api.send("POST", "/api/v1/meshes?unit=mm", &[], cube(60.0)).await.ok(201);
    let request = json!({"mesh_id": mesh["id"], "cell": "e05-transcan", "labels": {"do": "drive"}, "params": params()});
    let job = api.post_json("/api/v1/jobs", &request).await.ok(202)["id"].as_str().expect("an id").to_owned();
    let ended = api.ended(&job).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    job
}

async fn start(api: &Api, request: &Value) -> String {
    let answer = api.post_json("/api/v1/runs", request).await;
    let run = answer.ok(202);
    let id = run["id"].as_str().expect("an id").to_owned();
    assert_eq!(answer.header("location"), format!("/api/v1/runs/{id}"));
    assert_eq!((&run["state"], &run["reason"]), (&json!("preparing"), &json!("connecting")));
    assert!(run["notice"].as_str().expect("text").contains("not safety-rated"));
    id
}

async fn command(api: &Api, run: &str, what: &str) -> Answer {
    api.send("POST", &format!("/api/v1/runs/{run}/{what}"), &[], "").await
}

/// The run once `is_it` holds.
async fn when(api: &Api, run: &str, is_it: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..1500 {
        let found = api.get(&format!("/api/v1/runs/{run}")).await.ok(200);
        if is_it(&found) {
            return found;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("{run} does not come to it: {}", api.get(&format!("/api/v1/runs/{run}")).await.text());
}

async fn ended(api: &Api, run: &str) -> Value {
    api.get(&format!("/api/v1/runs/{run}?wait=60s")).await.ok(200)
}

#[tokio::test]
async fn a_program_runs_on_the_twin_to_its_end_and_its_record_tells_of_each_step() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job, "time_factor": 50})).await;
    let done = ended(&api, &run).await;
    assert_eq!(
        (&done["state"], &done["reason"], &done["mode"]),
        (&json!("done"), &json!("all_steps"), &json!("simulate")),
        "{done}"
    );
    let program = api.get(&format!("/api/v1/jobs/{job}/program")).await.ok(200);
    let steps = program["steps"].as_array().expect("steps");
    let scans = steps.iter().filter(|step| step["op"] == "scan").count();
    assert_eq!((&done["step"], &done["steps"], &done["scans"]), (&json!(steps.len()), &json!(steps.len()), &json!(scans)));
    assert_eq!(done["plan_sha256"], program["plan_sha256"]);
    let coverage = &done["coverage"];
    let [planned, measured] = ["planned_of_asked", "measured_of_asked"].map(|name| coverage[name].as_f64().expect("a share"));
    assert!(planned > 0.0 && (planned - measured).abs() < 0.005, "{coverage}");
    // The predicted time of the program is that of the twin, within what polling takes at this factor.
    let [predicted, real] = ["planned_secs", "elapsed_secs"].map(|name| done[name].as_f64().expect("seconds"));
    assert!(real >= 0.95 * predicted && real < 2.5 * predicted, "{real} s for {predicted} s");

    let record = api.get(&format!("/api/v1/runs/{run}/record")).await.ok(200);
    assert_eq!((&record["schema"], &record["run"]), (&json!("vantage.run/1"), &done));
    let recorded = record["steps"].as_array().expect("steps");
    let ops = |steps: &[Value]| steps.iter().map(|step| step["op"].clone()).collect::<Vec<_>>();
    assert_eq!(ops(recorded), ops(steps));
    for step in recorded.iter().filter(|step| step["op"] == "scan") {
        assert!(step["optical_axis_deviation_deg"].as_f64().expect("degrees") < 1.0, "{step}");
        assert!(step["position_deviation_mm"].as_f64().expect("mm") < 1.0 && step["viewpoint"].is_u64(), "{step}");
    }
    let table = api.send("GET", &format!("/api/v1/runs/{run}/record"), &[("accept", "text/csv")], "").await;
    assert!(table.header("content-type").starts_with("text/csv") && table.text().lines().count() == steps.len() + 1);
    assert_eq!(api.get(&format!("/api/v1/runs/{run}/record.csv")).await.bytes, table.bytes);
    // Nothing was exchanged with a controller.
    assert_eq!(api.get(&format!("/api/v1/runs/{run}/audit")).await.text(), "");
    command(&api, &run, "resume").await.problem("run_state_refused");
    assert_eq!(command(&api, &run, "stop").await.ok(202)["state"], "done");
    // The job may go before its runs.
    assert_eq!(api.send("DELETE", &format!("/api/v1/jobs/{job}"), &[], "").await.status, 204);
    // What is no folder cannot be removed as an audit log: the run goes, and the same request removes the log once that can be.
    let (path, log) = (format!("/api/v1/runs/{run}"), api.app.data_dir().join("audit").join(&run));
    std::fs::create_dir_all(api.app.data_dir().join("audit")).and_then(|()| std::fs::write(&log, b"log")).expect("written");
    let left = api.send("DELETE", &path, &[], "").await.problem("internal");
    assert!(left["detail"].as_str().is_some_and(|detail| detail.contains("its audit log cannot be removed")), "{left}");
    api.get(&path).await.problem("run_not_found");
    std::fs::remove_file(&log).and_then(|()| std::fs::create_dir(&log)).expect("a folder");
    assert_eq!(api.send("DELETE", &path, &[], "").await.status, 204);
    api.send("DELETE", &path, &[], "").await.problem("run_not_found");
}

/// A 503 would hide that they were accepted.
#[tokio::test]
async fn the_answers_to_new_runs_and_inspections_are_waited_for() {
    let mut http = http_options();
    http.request_timeout = Duration::ZERO;
    let api = Api::start_with(service_options(), http).await;
    let nobody = "01a1f77c-78a1-7554-855a-a9513c22aa2b";
    let inspections = format!("/api/v1/jobs/{nobody}/inspections");
    for (path, body) in [("/api/v1/runs", json!({"job_id": nobody})), (inspections.as_str(), json!({}))] {
        // Arrives only once the time for an answer is over.
        let late = async move {
            tokio::time::sleep(Duration::from_millis(1)).await;
            Ok::<_, std::io::Error>(body.to_string())
        };
        let body = Body::from_stream(futures_util::stream::once(late));
        api.send("POST", path, &[("content-type", "application/json")], body).await.problem("job_not_found");
    }
}

/// Both were refused for a token that they do not need, and the arm went on moving.
#[tokio::test]
async fn a_pause_and_a_stop_are_taken_whatever_query_headers_and_body_come_with_them() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job})).await;
    when(&api, &run, |run| run["state"] == "running").await;
    let odd = [
        ("content-type", "text/plain"),
        ("content-encoding", "gzip"),
        ("transfer-encoding", "gzip, chunked"),
        ("accept", "image/png"),
        ("if-match", "\"1\""),
        ("idempotency-key", ""),
    ];
    let pause = format!("/api/v1/runs/{run}/pause?token=3&token=x&%ff");
    assert_eq!(api.send("POST", &pause, &odd, "{").await.ok(200)["state"], "paused");
    let stop = format!("/api/v1/runs/{}/stop/?token=3&{}", run.to_uppercase(), "x".repeat(4096));
    let stopped = api.send("POST", &stop, &odd, "{").await.ok(202);
    assert_eq!((&stopped["state"], &stopped["reason"]), (&json!("stopped"), &json!("by_client")), "{stopped}");
}

/// The run was read from the store first, and where that failed the arm went on moving.
#[tokio::test]
async fn a_pause_waits_for_nothing_that_the_store_tells() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job})).await;
    when(&api, &run, |run| run["state"] == "running").await;
    let database = format!("sqlite://{}", api.app.data_dir().join("vantage.db").display());
    let options: sqlx::sqlite::SqliteConnectOptions = database.parse().expect("a path");
    let mut connection = sqlx::ConnectOptions::connect(&options).await.expect("the database");
    sqlx::query("UPDATE run SET body = '{'").execute(&mut connection).await.expect("damaged");
    sqlx::Connection::close(connection).await.expect("closed");
    // Its answer may come before the row is written anew.
    command(&api, &run, "pause").await;
    for _ in 0..500 {
        let found = api.get(&format!("/api/v1/runs/{run}")).await;
        // A step that was completed just before may have been written with its old state.
        if found.status == 200 && found.ok(200)["state"] != "running" {
            assert_eq!(found.ok(200)["state"], "paused");
            assert_eq!(command(&api, &run, "stop").await.ok(202)["state"], "stopped");
            return;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("{run} is not paused");
}

#[tokio::test]
async fn a_run_is_paused_resumed_slowed_and_stopped() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job})).await;
    when(&api, &run, |run| run["state"] == "running").await;
    api.send("DELETE", &format!("/api/v1/runs/{run}"), &[], "").await.problem("run_not_ended");
    let paused = command(&api, &run, "pause").await.ok(200);
    assert_eq!((&paused["state"], &paused["reason"]), (&json!("paused"), &json!("by_client")), "{paused}");
    assert_eq!(command(&api, &run, "pause").await.ok(200)["state"], "paused");
    let slower = api.post_json(&format!("/api/v1/runs/{run}/override"), &json!({"speed_override": 0.5})).await.ok(200);
    assert_eq!(slower["speed_override"], 0.5);
    let refused = api.post_json(&format!("/api/v1/runs/{run}/override"), &json!({"speed_override": 2.0})).await;
    refused.problem_at("invalid_fields", &["/speed_override"]);
    assert_eq!(command(&api, &run, "resume").await.ok(200)["state"], "running");
    command(&api, &run, "resume").await.problem("run_state_refused");
    let arm = json!({"operator": "A. Operator", "cell": "e05-transcan"});
    api.post_json(&format!("/api/v1/runs/{run}/arm"), &arm).await.problem("run_refused");
    api.post_json(&format!("/api/v1/runs/{run}/arm"), &json!({"operator": "A", "cell": "other"}))
        .await
        .problem_at("invalid_fields", &["/cell"]);
    let stopped = command(&api, &run, "stop").await.ok(202);
    assert_eq!((&stopped["state"], &stopped["reason"]), (&json!("stopped"), &json!("by_client")), "{stopped}");
    for device in ["arm", "table"] {
        let stop = &stopped["stop"][device];
        let [sent, acknowledged, at_rest] =
            ["sent_ms", "acknowledged_ms", "at_rest_ms"].map(|stage| stop[stage].as_f64().expect("ms"));
        assert!(sent <= acknowledged && acknowledged <= at_rest && stop["error"].is_null(), "{stop}");
    }
    command(&api, &run, "pause").await.problem("run_state_refused");
    // From where it was stopped another run goes on.
    let again = start(&api, &json!({"job_id": job, "from_step": stopped["step"], "time_factor": 50})).await;
    assert_eq!(ended(&api, &again).await["state"], "done");
}

#[tokio::test]
async fn steps_are_taken_one_by_one() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job, "single_step": true, "time_factor": 50})).await;
    when(&api, &run, |run| run["state"] == "armed").await;
    command(&api, &run, "step").await.ok(200);
    let first = when(&api, &run, |run| run["state"] == "paused").await;
    assert_eq!(first["reason"], "single_step");
    command(&api, &run, "step").await.ok(200);
    let second = when(&api, &run, |run| run["state"] == "paused" && run["step"] != first["step"]).await;
    assert!(second["step"].as_u64() > first["step"].as_u64());
    command(&api, &run, "resume").await.ok(200);
    assert_eq!(ended(&api, &run).await["state"], "done");
}

/// The count was 0 until the run ended.
#[tokio::test]
async fn scans_are_counted_while_the_run_is_under_way() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job, "single_step": true, "time_factor": 50})).await;
    let armed = when(&api, &run, |run| run["state"] == "armed").await;
    let (mut at, mut scans) = (Value::Null, 0);
    for _ in 1..armed["steps"].as_u64().expect("a number") {
        command(&api, &run, "step").await.ok(200);
        let paused = when(&api, &run, |run| run["state"] == "paused" && run["step"] != at).await;
        let record = api.get(&format!("/api/v1/runs/{run}/record")).await.ok(200);
        scans = record["steps"].as_array().expect("steps").iter().filter(|step| step["op"] == "scan").count();
        assert_eq!((&paused["scans"], &record["run"]["scans"]), (&json!(scans), &json!(scans)), "{record}");
        at = paused["step"].clone();
        if scans > 0 {
            break;
        }
    }
    assert_eq!(scans, 1);
    assert_eq!(command(&api, &run, "stop").await.ok(202)["scans"], 1);
}

#[tokio::test]
async fn a_run_is_followed_to_its_end_and_whoever_comes_back_gets_what_was_missed() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job, "time_factor": 20})).await;
    let path = format!("/api/v1/runs/{run}/events");
    let told = Listener::open(&api, &path, None::<&str>).await.rest().await;
    let stored: Vec<_> = told.iter().filter(|event| event.kind != "live").collect();
    let states: Vec<&str> =
        stored.iter().filter(|event| event.kind == "state").map(|event| event.data["state"].as_str().expect("a state")).collect();
    assert_eq!((states.first(), states.last()), (Some(&"preparing"), Some(&"done")), "{states:?}");
    assert!(states.contains(&"running") && stored.iter().any(|event| event.kind == "step"));
    assert!(stored.windows(2).all(|pair| pair[0].data["id"].as_i64() < pair[1].data["id"].as_i64()));
    let samples: Vec<_> = told.iter().filter(|event| event.kind == "live").collect();
    assert!(samples.len() > 5, "{}", samples.len());
    for sample in &samples {
        assert_eq!(sample.data["measured"]["joints_deg"].as_array().map(Vec::len), Some(6), "{:?}", sample.data);
        assert!(sample.data["base_from_scanner"]["translation_mm"].is_array());
    }
    assert!(samples.windows(2).all(|pair| pair[0].data["sequence"].as_u64() < pair[1].data["sequence"].as_u64()));

    // Stored events come again after any place, those of samples too.
    let middle = &told[told.len() / 2];
    let seen = middle.place.split('.').next().and_then(|event| event.parse::<i64>().ok()).expect("a number");
    let again = Listener::open(&api, &path, Some(&middle.place)).await.rest().await;
    let missed: Vec<i64> = stored.iter().filter_map(|event| event.data["id"].as_i64()).filter(|id| *id > seen).collect();
    let found: Vec<i64> =
        again.iter().filter(|event| event.kind != "live").filter_map(|event| event.data["id"].as_i64()).collect();
    assert_eq!(found, missed);
    let last = &stored.last().expect("events").place;
    assert_eq!(api.send("GET", &path, &[("last-event-id", last)], "").await.status, 204);
    api.send("GET", &path, &[("last-event-id", "1.2.3")], "").await.problem("bad_request");

    // Once all of them are pruned, the answer was 204: whoever came late did not learn how the run had ended.
    let database = format!("sqlite://{}", api.app.data_dir().join("vantage.db").display());
    let options: sqlx::sqlite::SqliteConnectOptions = database.parse().expect("a path");
    let mut connection = sqlx::SqliteConnection::connect_with(&options).await.expect("the database");
    sqlx::query("DELETE FROM run_event").execute(&mut connection).await.expect("deleted");
    let told = Listener::open(&api, &path, None::<&str>).await.rest().await;
    assert_eq!(told.iter().map(|event| event.kind.as_str()).collect::<Vec<_>>(), ["reset"]);
    assert_eq!(api.send("GET", &path, &[("last-event-id", &told[0].place)], "").await.status, 204);
}

#[tokio::test]
async fn samples_come_again_while_the_run_is_under_way() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job})).await;
    let path = format!("/api/v1/runs/{run}/events");
    let mut listener = Listener::open(&api, &path, None::<&str>).await;
    let mut places = Vec::new();
    while places.len() < 10 {
        let event = listener.next().await.expect("an event");
        if event.kind == "live" {
            places.push(event.place);
        }
    }
    drop(listener);
    let mut listener = Listener::open(&api, &path, Some(&places[4])).await;
    let mut again = Vec::new();
    while again.len() < 5 {
        let event = listener.next().await.expect("an event");
        if event.kind == "live" {
            again.push(event.place.split('.').nth(1).map(str::to_owned));
        }
    }
    let wanted: Vec<_> = places[5..].iter().map(|place| place.split('.').nth(1).map(str::to_owned)).collect();
    assert_eq!(again, wanted);
    command(&api, &run, "stop").await.ok(202);
}

#[tokio::test]
async fn runs_are_listed_by_state_mode_cell_job_and_date() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let mut runs = Vec::new();
    for _ in 0..3 {
        let run = start(&api, &json!({"job_id": job, "time_factor": 100})).await;
        ended(&api, &run).await;
        runs.insert(0, run);
    }
    let listed = async |query: &str| -> Vec<String> {
        let page = api.get(&format!("/api/v1/runs?{query}")).await.ok(200);
        page["items"].as_array().expect("a list").iter().map(|run| run["id"].as_str().expect("an id").to_owned()).collect()
    };
    for all in
        ["", "state=done", "mode=simulate", "cell=e05-transcan", &format!("job={job}"), "created_after=2020-01-01T00:00:00Z"]
    {
        assert_eq!(listed(all).await, runs, "{all}");
    }
    let none = "job=01a1f77c-78a1-7554-855a-a9513c22aa2b";
    for none in ["state=failed", "mode=live", "cell=other", none, "created_before=2020-01-01T00:00:00Z"] {
        assert!(listed(none).await.is_empty(), "{none}");
    }
    let page = api.get("/api/v1/runs?page_size=2").await.ok(200);
    let token = page["next_page_token"].as_str().expect("a token");
    assert_eq!(listed(&format!("page_size=2&page_token={token}")).await, runs[2..]);
    api.get(&format!("/api/v1/runs?state=done&page_token={token}")).await.problem("bad_page_token");
    let metrics = api.get("/metrics").await.text();
    assert!(metrics.is_empty() || metrics.contains("vantage_runs"), "{metrics}");
}

#[tokio::test]
async fn what_has_no_program_is_not_run() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let refused = async |request: Value| api.post_json("/api/v1/runs", &request).await;
    refused(json!({"job_id": job, "setup": 1})).await.problem("no_program");
    refused(json!({"job_id": job, "from_step": 1000})).await.problem_at("invalid_fields", &["/from_step"]);
    refused(json!({"job_id": job, "time_factor": 1000})).await.problem_at("invalid_fields", &["/time_factor"]);
    let without_cell = api.job("").await;
    api.ended(&without_cell).await;
    refused(json!({"job_id": without_cell})).await.problem("no_program");
    let waiting = api.job("wait").await;
    refused(json!({"job_id": waiting})).await.problem("no_results");
    api.post_json(&format!("/api/v1/jobs/{waiting}/cancel"), &Value::Null).await.ok(202);
    // Controllers are not to be had from a request.
    for field in ["controllers", "address", "arm"] {
        refused(json!({"job_id": job, field: "10.0.0.1:10003"})).await.problem_at("bad_shape", &[&format!("/{field}")]);
    }
}

#[tokio::test]
async fn a_run_of_a_job_whose_mesh_was_deleted_has_its_file_still() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let mesh = api.get(&format!("/api/v1/jobs/{job}")).await.ok(200)["mesh_id"].as_str().expect("an id").to_owned();
    assert_eq!(api.send("DELETE", &format!("/api/v1/meshes/{mesh}"), &[], "").await.status, 204);
    api.get(&format!("/api/v1/meshes/{mesh}")).await.problem("mesh_not_found");
    let run = start(&api, &json!({"job_id": job, "time_factor": 100})).await;
    let done = ended(&api, &run).await;
    assert_eq!((&done["state"], &done["reason"]), (&json!("done"), &json!("all_steps")), "{done}");
}

/// A cell of the operator's, the same as the preset or not.
fn operated(is_same: bool) -> OperatorCell {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    spec.inline_devices(&Presets);
    if !is_same {
        spec.floor_mm = Some(-390.0);
    }
    let controllers = json!({
        "arm": {"protocol": "hans", "address": "127.0.0.1:1"},
        "table": {"protocol": "minas_a6", "address": "tcp://127.0.0.1:2", "units_per_turn": 1_600_000, "gear_ratio": 40},
    });
    let controllers = serde_json::from_value(controllers).expect("controllers");
    OperatorCell { name: spec.name.clone(), cell_sha256: cell_sha256(&spec, &|_| None).expect("a hash"), controllers }
}

async fn with_cells(live: bool, cells: Vec<OperatorCell>) -> Api {
    let mut options: Options = service_options();
    (options.execution.live, options.execution.cells) = (live, cells);
    Api::start_with(options, http_options()).await
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_live_run_needs_the_setting_the_operator_s_cell_and_the_lease() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let live = json!({"job_id": job, "mode": "live"});
    api.post_json("/api/v1/runs", &live).await.problem_at("live_disabled", &["/mode"]);
    api.post_json("/api/v1/runs", &json!({"job_id": job, "mode": "dry_run"})).await.problem("no_controllers");

    let api = with_cells(true, vec![operated(false)]).await;
    let live = json!({"job_id": driven(&api).await, "mode": "live"});
    api.post_json("/api/v1/runs", &live).await.problem("other_cell");

    let api = with_cells(true, vec![operated(true)]).await;
    let live = json!({"job_id": driven(&api).await, "mode": "live"});
    api.post_json("/api/v1/runs", &live).await.problem_at("lease_required", &["token"]);
    api.post_json("/api/v1/runs?token=1", &live).await.problem_at("token_refused", &["token"]);
    let lease = api.post_json("/api/v1/leases", &json!({"cell": "e05-transcan"})).await.ok(201);
    let answer = api.post_json(&format!("/api/v1/runs?token={}", lease["token"]), &live).await.ok(202);
    // Nobody is there: nothing moved.
    let run = ended(&api, answer["id"].as_str().expect("an id")).await;
    assert!(run["state"] == "failed" && run["scans"] == 0 && run["stop"].is_null() | run["stop"]["arm"].is_null(), "{run}");
    api.get("/api/v1/runs?mode=live&state=failed").await.ok(200);
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_cell_has_one_holder_at_a_time() {
    let mut options = service_options();
    (options.execution.lease_ttl, options.execution.heartbeat) = (Duration::from_millis(1500), Duration::from_millis(300));
    let api = Api::start_with(options, http_options()).await;
    let mut second = api.get("/api/v1/cells/e05-transcan").await.ok(200);
    second["name"] = "e05-transcan-two".into();
    api.send("PUT", "/api/v1/cells/e05-transcan-two", &[("content-type", "application/json")], second.to_string()).await.ok(201);
    let take = async |cell: &str, holder: &str| api.post_json("/api/v1/leases", &json!({"cell": cell, "holder": holder})).await;
    let answer = take("e05-transcan", "line 3").await;
    let lease = answer.ok(201);
    let path = format!("/api/v1/leases/{}", lease["id"].as_str().expect("an id"));
    assert_eq!((answer.header("location"), &lease["ttl_ms"], &lease["heartbeat_ms"]), (&path[..], &json!(1500), &json!(300)));
    let held = take("e05-transcan", "line 4").await.problem("lease_held");
    assert!(held["detail"].as_str().expect("words").contains("line 3"), "{held}");
    let other = take("e05-transcan-two", "line 4").await.ok(201);
    assert!(other["token"].as_u64() > lease["token"].as_u64());
    let list = api.get("/api/v1/leases").await.ok(200);
    let items = list["items"].as_array().expect("a list");
    assert_eq!(
        (items.len(), &items[0]["holder"], &items[0]["id"], &items[0]["token"]),
        (2, &json!("line 3"), &Value::Null, &Value::Null)
    );
    for _ in 0..4 {
        tokio::time::sleep(Duration::from_millis(600)).await;
        api.send("PUT", &path, &[], "").await.ok(200);
    }
    assert_eq!(api.send("DELETE", &path, &[], "").await.status, 204);
    api.send("PUT", &path, &[], "").await.problem("lease_not_found");
    let again = take("e05-transcan", "line 4").await.ok(201);
    assert!(again["token"].as_u64() > other["token"].as_u64());
    // One that is not renewed ends by itself.
    tokio::time::sleep(Duration::from_millis(1800)).await;
    assert_eq!(api.get("/api/v1/leases").await.ok(200)["items"], json!([]));
    take("e05-transcan", "line 5").await.ok(201);
}

#[tokio::test]
async fn the_service_stops_its_runs_before_it_ends() {
    let api = Api::start().await;
    let job = driven(&api).await;
    let run = start(&api, &json!({"job_id": job})).await;
    when(&api, &run, |run| run["state"] == "running").await;
    api.app.stop().await;
    let stopped = api.get(&format!("/api/v1/runs/{run}")).await.ok(200);
    assert_eq!((&stopped["state"], &stopped["reason"]), (&json!("stopped"), &json!("server_gone")), "{stopped}");
    api.post_json("/api/v1/runs", &json!({"job_id": job})).await.problem("stopping");
    api.post_json("/api/v1/leases", &json!({"cell": "a"})).await.problem("stopping");
}

#[tokio::test]
async fn no_request_brings_controllers_along() {
    let api = Api::start().await;
    let mut cell = api.get("/api/v1/cells/e05-transcan").await.ok(200);
    cell["name"] = "mine".into();
    cell["controllers"] = json!({"arm": {"protocol": "hans", "address": "10.0.0.1:10003"}});
    let headers = [("content-type", "application/json")];
    let refused =
        api.send("PUT", "/api/v1/cells/mine", &headers, cell.to_string()).await.problem_at("bad_shape", &["/controllers"]);
    assert!(refused["errors"][0]["detail"].as_str().expect("words").contains("operator's cell file"), "{refused}");
    let job = json!({"mesh_id": api.mesh().await, "cell": cell});
    api.post_json("/api/v1/jobs", &job).await.problem_at("bad_shape", &["/cell/controllers"]);
}
