//! The examples of the API document, sent as they are: all of them are accepted.

use axum::body::Body;
use serde_json::Value;

use super::api::Api;

/// Parameters that have no example, since none is right for everybody: versions, places in a listing or stream, keys of requests.
const WITHOUT: [&str; 7] = ["If-Match", "If-None-Match", "Last-Event-ID", "Idempotency-Key", "page_token", "If-Range", "Range"];

/// An operation with its examples filled in.
struct Example {
    method: String,
    path: String,
    headers: Vec<(String, String)>,
    content_type: String,
    body: String,
}

fn document() -> Value {
    serde_json::to_value(vantage::http::openapi()).expect("JSON")
}

/// A value as it stands in a path, query or header.
fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// The value of a parameter: its example, the first of its list, or that of the job that was started before.
fn value_of(parameter: &Value, document: &Value, job: &str) -> Option<String> {
    if let Some(example) = parameter.get("example") {
        return Some(plain(example));
    }
    let name = parameter["name"].as_str().expect("a name");
    if name == "id" {
        return Some(job.to_owned());
    }
    let schema = &parameter["schema"];
    let reference = schema["$ref"].as_str().or_else(|| schema["oneOf"][0]["$ref"].as_str());
    let named = reference.map_or(schema, |path| document.pointer(&path[1..]).expect("a schema"));
    // Of the states that a job has come to by then.
    let list = named["enum"].as_array().map(|list| list.iter().find(|value| **value == "succeeded").unwrap_or(&list[0]));
    list.filter(|_| parameter["in"] == "path" || name == "state").map(plain)
}

fn encoded(text: &str) -> String {
    text.bytes()
        .map(|c| if c.is_ascii_alphanumeric() || b"-._~".contains(&c) { char::from(c).to_string() } else { format!("%{c:02X}") })
        .collect()
}

/// The operation of this id with every example.
fn example(document: &Value, id: &str, job: &str) -> Example {
    let paths = document["paths"].as_object().expect("paths");
    let operations =
        paths.iter().flat_map(|(path, item)| item.as_object().expect("operations").iter().map(move |(m, o)| (path, m, o)));
    let (path, method, operation) =
        operations.into_iter().find(|(_, _, operation)| operation["operationId"] == id).expect("an operation");
    let (mut url, mut query, mut headers) = (path.clone(), Vec::new(), Vec::new());
    for parameter in operation["parameters"].as_array().into_iter().flatten() {
        let name = parameter["name"].as_str().expect("a name");
        let Some(value) = value_of(parameter, document, job) else {
            let may_lack = WITHOUT.contains(&name) || parameter["schema"]["minimum"].is_number() || name == "fields";
            assert!(may_lack && parameter["required"] != true, "{id} has no example of {name}");
            continue;
        };
        match parameter["in"].as_str() {
            Some("path") => url = url.replace(&format!("{{{name}}}"), &encoded(&value)),
            Some("query") => query.push(format!("{name}={}", encoded(&value))),
            Some("header") => headers.push((name.to_owned(), value)),
            other => panic!("{id}: {other:?}"),
        }
    }
    if !query.is_empty() {
        url = format!("{url}?{}", query.join("&"));
    }
    let content = operation["requestBody"]["content"].as_object().and_then(|content| content.iter().next());
    let body = content.map(|(_, content)| content.get("example").unwrap_or_else(|| panic!("{id} has no example of its body")));
    Example {
        method: method.to_uppercase(),
        path: url,
        headers,
        content_type: content.map(|(kind, _)| kind.clone()).unwrap_or_default(),
        body: body.map(plain).unwrap_or_default(),
    }
}

/// Sends an example; returns the answer's JSON, if it is JSON.
async fn send(api: &Api, document: &Value, id: &str, job: &str) -> Value {
    let Example { method, path, headers, content_type, body } = example(document, id, job);
    let mut sent: Vec<(&str, &str)> = headers.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
    if !content_type.is_empty() {
        sent.push(("content-type", &content_type));
    }
    if id == "follow_all" {
        // It does not end.
        let request = axum::http::Request::builder().method("GET").uri(&path).body(Body::empty()).expect("a request");
        assert_eq!(api.raw(request).await.status(), 200);
        return Value::Null;
    }
    let answer = api.send(&method, &path, &sent, body).await;
    // A job here has one setup.
    let is_of_later_setup = answer.status == 404 && path.contains("/program-");
    assert!(answer.status.is_success() || is_of_later_setup, "{id}: {method} {path}: {}", answer.text());
    serde_json::from_slice(&answer.bytes).unwrap_or(Value::Null)
}

/// Operations that must come first, in this order, and those that must come last; all others come between them.
const FIRST: [&str; 7] = ["upload_mesh", "put_scanner", "put_robot", "put_turntable", "put_cell", "create_job", "create_jobs"];
const LAST: [&str; 9] = [
    "cancel_job",
    "delete_job",
    "delete_jobs",
    "delete_mesh",
    "delete_cell",
    "delete_scanner",
    "delete_robot",
    "delete_turntable",
    "end_session",
];

/// Operations on a run that waits for its first step, in an order in which all are accepted.
const RUNS: [&str; 15] = [
    "create_run",
    "list_runs",
    "step_run",
    "pause_run",
    "override_run",
    "resume_run",
    "get_run_record",
    "get_run_record_csv",
    "get_run_audit",
    "stop_run",
    "get_run",
    "follow_run",
    "delete_run",
    "arm_run",
    "locate_part",
];
/// Operations of them that only a live run, or one that waits for it, accepts.
const REFUSED: [&str; 2] = ["arm_run", "locate_part"];
/// Operations on a calibration, in an order in which all are accepted.
const CALIBRATIONS: [&str; 8] = [
    "create_calibration",
    "get_calibration",
    "list_calibrations",
    "get_calibration_result",
    "get_calibrated_cell",
    "get_calibration_report",
    "cancel_calibration",
    "delete_calibration",
];
/// Operations on scans, and on inspections of jobs that have none.
const INSPECTIONS: [&str; 16] = [
    "upload_scan",
    "list_scans",
    "get_scan",
    "get_scan_file",
    "create_inspection",
    "get_inspection",
    "list_inspections",
    "get_inspection_result",
    "get_inspection_losses",
    "get_inspection_deviation",
    "get_inspection_learned",
    "get_inspection_report",
    "cancel_inspection",
    "create_rescan",
    "delete_inspection",
    "delete_scan",
];
/// Operations on leases, in an order in which all are accepted.
const LEASES: [&str; 4] = ["take_lease", "list_leases", "renew_lease", "give_lease_back"];

async fn send_examples_of_runs(api: &Api, document: &Value) {
    let job = super::runs::driven(api).await;
    let mut create = example(document, "create_run", "");
    let mut body: Value = serde_json::from_str(&create.body).expect("JSON");
    (body["job_id"], body["single_step"]) = (job.into(), true.into());
    create.body = body.to_string();
    let run = api.send("POST", &create.path, &[("content-type", "application/json")], create.body).await.ok(202);
    let run = run["id"].as_str().expect("an id");
    for _ in 0..1000 {
        if api.get(&format!("/api/v1/runs/{run}")).await.ok(200)["state"] == "armed" {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    for id in REFUSED {
        let Example { method, path, content_type, body, .. } = example(document, id, run);
        let answer = api.send(&method, &path, &[("content-type", &content_type)], body).await;
        assert_eq!(answer.status, 409, "{id}: {}", answer.text());
    }
    for id in RUNS.iter().filter(|id| !REFUSED.contains(id) && **id != "create_run") {
        send(api, document, id, run).await;
    }
    let lease = send(api, document, "take_lease", "").await;
    for id in &LEASES[1..] {
        send(api, document, id, lease["id"].as_str().expect("an id")).await;
    }
}

async fn send_examples_of_calibrations(api: &Api, document: &Value) {
    let calibration = send(api, document, "create_calibration", "").await;
    let id = calibration["id"].as_str().expect("an id");
    let ended = api.get(&format!("/api/v1/calibrations/{id}?wait=60s")).await.ok(200);
    assert_eq!(ended["state"], "succeeded", "{ended}");
    // Only one that waits can be cancelled.
    let Example { method, path, .. } = example(document, "cancel_calibration", id);
    api.send(&method, &path, &[], "").await.problem("calibration_not_queued");
    for operation in CALIBRATIONS.iter().filter(|operation| !["create_calibration", "cancel_calibration"].contains(operation)) {
        send(api, document, operation, id).await;
    }
}

/// The scan of the example is no scan of the job: its inspection is accepted, fails, and has no result.
async fn send_examples_of_inspections(api: &Api, document: &Value, job: &str) {
    let scan = send(api, document, "upload_scan", job).await;
    let scan = scan["id"].as_str().expect("an id");
    send(api, document, "list_scans", job).await;
    for id in ["get_scan", "get_scan_file"] {
        send(api, document, id, scan).await;
    }
    let inspection = send(api, document, "create_inspection", job).await;
    let id = inspection["id"].as_str().expect("an id");
    let ended = api.get(&format!("/api/v1/inspections/{id}?wait=60s")).await.ok(200);
    assert_eq!(ended["state"], "failed", "{ended}");
    send(api, document, "get_inspection", id).await;
    send(api, document, "list_inspections", id).await;
    let refused =
        INSPECTIONS.iter().filter(|operation| operation.starts_with("get_inspection_") || **operation == "create_rescan");
    for operation in refused {
        let Example { method, path, content_type, body, .. } = example(document, operation, id);
        api.send(&method, &path, &[("content-type", &content_type)], body).await.problem("no_inspection");
    }
    let Example { method, path, .. } = example(document, "cancel_inspection", id);
    api.send(&method, &path, &[], "").await.problem("inspection_ended");
    send(api, document, "delete_inspection", id).await;
    send(api, document, "delete_scan", scan).await;
}

#[tokio::test]
async fn every_example_is_accepted_as_it_is() {
    let api = Api::start().await;
    let document = document();
    let paths = document["paths"].as_object().expect("paths").values();
    let ids = paths.flat_map(|item| item.as_object().expect("operations").values()).filter_map(|o| o["operationId"].as_str());
    let ids: Vec<&str> = ids.collect();
    assert!(ids.len() > 60, "{ids:?}");
    let mut job = String::new();
    for id in FIRST {
        let answer = send(&api, &document, id, "").await;
        if id == "create_job" {
            job = answer["id"].as_str().expect("an id").to_owned();
        }
    }
    assert_eq!(api.ended(&job).await["state"], "succeeded");
    send_examples_of_runs(&api, &document).await;
    send_examples_of_calibrations(&api, &document).await;
    send_examples_of_inspections(&api, &document, &job).await;
    let of_runs = RUNS.iter().chain(&LEASES).chain(&REFUSED).chain(&CALIBRATIONS).chain(&INSPECTIONS);
    let of_runs: Vec<&str> = of_runs.copied().collect();
    for id in ids.iter().filter(|id| !FIRST.contains(id) && !LAST.contains(id) && !of_runs.contains(id) && **id != "update_job") {
        let answer = send(&api, &document, id, &job).await;
        if *id == "list_jobs" {
            // The filters of the examples find the job of the example.
            let items = answer["items"].as_array().expect("a list");
            assert!(items.iter().any(|item| item["id"] == job.as_str()), "{answer}");
        }
    }
    // One that waits can be moved and cancelled.
    let running = api.job("wait").await;
    api.running(&running).await;
    let waiting = api.job("").await;
    assert_eq!(send(&api, &document, "update_job", &waiting).await["queue_position"], 1);
    for id in LAST {
        let job = match id {
            "cancel_job" => &waiting,
            "delete_job" => &job,
            _ => "",
        };
        if id == "delete_mesh" {
            // The jobs of the example batch need it until they have ended.
            api.post_json(&format!("/api/v1/jobs/{running}/cancel"), &Value::Null).await.ok(202);
            api.ended(&running).await;
            api.ended(&waiting).await;
        }
        send(&api, &document, id, job).await;
    }
}
