//! Calibrations: accepted, computed, kept, put in place; what they refuse, and what outlives the service.

use std::time::Duration;

use serde_json::{Value, json};
use vantage::service::{App, Submission};
use vantage::wire::example;

use super::api::{Api, http_options, service_options};

async fn ended(api: &Api, request: &Value) -> Value {
    let accepted = api.post_json("/api/v1/calibrations", request).await;
    let id = accepted.ok(202)["id"].as_str().expect("an id").to_owned();
    assert_eq!(accepted.header("location"), format!("/api/v1/calibrations/{id}"));
    api.get(&format!("/api/v1/calibrations/{id}?wait=60s")).await.ok(200)
}

fn near(found: &Value, expected: &Value, tolerance: f64) -> bool {
    let numbers =
        |value: &Value| value.as_array().expect("numbers").iter().map(|n| n.as_f64().expect("a number")).collect::<Vec<_>>();
    numbers(found).iter().zip(numbers(expected)).all(|(a, b)| (a - b).abs() <= tolerance)
}

#[tokio::test]
async fn a_cell_is_calibrated_and_put_in_place_with_where_it_is_from() {
    let api = Api::start().await;
    let job = ended(&api, &example::calibration()).await;
    assert_eq!(
        (&job["state"], &job["observations"], &job["summary"]["used"]),
        (&json!("succeeded"), &json!(6), &json!(6)),
        "{job}"
    );
    let path = format!("/api/v1/calibrations/{}", job["id"].as_str().expect("an id"));
    let result = api.get(&format!("{path}/result")).await.ok(200);
    assert_eq!((&result["schema"], &result["kind"]), (&json!("vantage.calibration/1"), &json!("joint")));
    let preset = api.get("/api/v1/cells/e05-transcan").await.ok(200);
    for pose in ["flange_from_scanner", "base_from_table"] {
        let (found, expected) = (&result[pose]["translation_mm"], &preset[pose]["translation_mm"]);
        assert!(near(found, expected, 1e-3), "{pose}: {found} {expected}");
    }
    let cell = api.get(&format!("{path}/cell")).await.ok(200);
    assert_eq!(cell["calibrated"]["calibration_id"], result["id"]);
    assert_eq!(cell["name"], "e05-transcan-calibrated", "a preset cannot be replaced");
    let headers = [("content-type", "application/json"), ("if-none-match", "*")];
    api.send("PUT", "/api/v1/cells/e05-transcan-calibrated", &headers, cell.to_string()).await.ok(201);
    let report = api.get(&format!("{path}/report")).await;
    assert_eq!((report.status.as_u16(), report.header("content-type")), (200, "text/html; charset=utf-8"));
    assert!(report.header("content-security-policy").contains("sandbox") && report.text().contains("<svg"));
    let list = api.get("/api/v1/calibrations?state=succeeded&cell=e05-transcan").await.ok(200);
    assert_eq!(list["items"], json!([job]));
    assert_eq!(api.get("/api/v1/calibrations?state=failed").await.ok(200)["items"], json!([]));
    api.send("POST", &format!("{path}/cancel"), &[], "").await.problem("calibration_not_queued");
    assert_eq!(api.send("DELETE", &path, &[], "").await.status, 204);
    api.get(&path).await.problem("calibration_not_found");
}

#[tokio::test]
async fn the_same_observations_give_the_same_bytes() {
    let api = Api::start().await;
    let mut results = Vec::new();
    for _ in 0..2 {
        let job = ended(&api, &example::calibration()).await;
        let path = format!("/api/v1/calibrations/{}/result", job["id"].as_str().expect("an id"));
        let mut result = api.get(&path).await.ok(200);
        // Without a time of the observations it is that of the request.
        (result["taken_at"], result["id"]) = (Value::Null, Value::Null);
        results.push(result.to_string());
    }
    assert_eq!(results[0], results[1]);
}

#[tokio::test]
async fn observations_without_a_calibration_end_with_what_is_missing() {
    let api = Api::start().await;
    let mut request = example::calibration();
    // All at one configuration of the arm: turns about the table's axis alone.
    let first = request["data"]["observations"][0].clone();
    for observation in request["data"]["observations"].as_array_mut().expect("a list") {
        let id = observation["id"].clone();
        *observation = first.clone();
        observation["id"] = id;
    }
    let job = ended(&api, &request).await;
    assert_eq!((&job["state"], &job["problem"]["code"]), (&json!("failed"), &json!("no_calibration_possible")), "{job}");
    assert!(!job["findings"].as_array().expect("a list").is_empty());
    let path = format!("/api/v1/calibrations/{}", job["id"].as_str().expect("an id"));
    for result in ["result", "cell", "report"] {
        api.get(&format!("{path}/{result}")).await.problem("no_calibration");
    }
}

#[tokio::test]
async fn what_cannot_be_read_is_refused_with_its_pointer() {
    let api = Api::start().await;
    let refused = async |change: fn(&mut Value), code: &str, pointer: &str| {
        let mut request = example::calibration();
        change(&mut request);
        api.post_json("/api/v1/calibrations", &request).await.problem_at(code, &[pointer]);
    };
    refused(|r| r["cell"] = json!("nowhere"), "invalid_fields", "/cell").await;
    refused(|r| r["cell"] = json!("none"), "invalid_fields", "/cell").await;
    refused(|r| r["hold_out"] = json!(1001), "invalid_fields", "/hold_out").await;
    refused(|r| r["solve"] = json!("everything"), "bad_shape", "/solve").await;
    refused(|r| r["data"]["schema"] = json!("vantage.calibration_data/9"), "invalid_fields", "/data/schema").await;
    let turned = "/data/observations/2/joints_deg/1";
    refused(|r| r["data"]["observations"][2]["joints_deg"][1] = json!(1e9), "invalid_fields", turned).await;
    refused(|r| r["data"]["observations"][2]["joints"] = json!([]), "bad_shape", "/data/observations/2/joints").await;
}

#[tokio::test]
async fn calibrations_outlive_the_service() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut options = service_options();
    options.data_dir = folder.path().to_owned();
    let request = serde_json::from_value(example::calibration()).expect("a request");
    let app = App::open(options.clone()).await.expect("a service");
    let job = app.submit_calibration(request, Submission::default()).await.expect("accepted");
    let job = app.calibration_when_ended(job.id, Duration::from_secs(60)).await.expect("it");
    let result = app.calibration_result(job.id).await.expect("a result");
    app.stop().await;
    app.close().await;
    drop(app);
    let app = App::open(options).await.expect("a service");
    assert_eq!(app.calibration(job.id).await.expect("it"), job);
    assert_eq!(app.calibration_result(job.id).await.expect("a result"), result);
    app.stop().await;
}

#[tokio::test]
async fn a_calibration_under_way_is_cancelled_and_one_that_ended_never_changes() {
    let mut options = http_options();
    options.max_json_bytes = 16 << 20;
    let api = Api::start_with(service_options(), options).await;
    let ended_path = {
        let job = ended(&api, &example::calibration()).await;
        format!("/api/v1/calibrations/{}", job["id"].as_str().expect("an id"))
    };
    let before = (api.get(&ended_path).await.text(), api.get(&format!("{ended_path}/result")).await.text());
    // Many observations, so that the computation can be met under way: comparing each with each takes seconds.
    let mut request = example::calibration();
    let observations = request["data"]["observations"].as_array().expect("a list").clone();
    let many: Vec<Value> = (0..1500)
        .map(|index| {
            let mut observation = observations[index % observations.len()].clone();
            observation["id"] = json!(format!("o{index}"));
            let place = observation["cloud_from_board"]["translation_mm"][0].as_f64().expect("a number");
            observation["cloud_from_board"]["translation_mm"][0] = json!(place + 0.02 * (index / observations.len()) as f64);
            observation
        })
        .collect();
    request["data"]["observations"] = json!(many);
    let id = api.post_json("/api/v1/calibrations", &request).await.ok(202)["id"].as_str().expect("an id").to_owned();
    let path = format!("/api/v1/calibrations/{id}");
    api.send("POST", &format!("{path}/cancel"), &[], "").await.ok(200);
    let job = api.get(&format!("{path}?wait=60s")).await.ok(200);
    assert_eq!((&job["state"], &job["summary"]), (&json!("cancelled"), &Value::Null), "{job}");
    api.get(&format!("{path}/result")).await.problem("no_calibration");
    api.send("POST", &format!("{path}/cancel"), &[], "").await.ok(200);
    for method in ["PUT", "PATCH", "POST"] {
        api.send(method, &ended_path, &[("content-type", "application/json")], "{}").await.problem("method_not_allowed");
    }
    api.send("POST", &format!("{ended_path}/cancel"), &[], "").await.problem("calibration_not_queued");
    assert_eq!(before, (api.get(&ended_path).await.text(), api.get(&format!("{ended_path}/result")).await.text()));
}
