//! Several jobs at once, and jobs that change their place in the queue.

use serde_json::{Value, json};

use super::api::{Api, http_options, service_options};

#[tokio::test]
async fn a_batch_is_accepted_in_its_order() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let request = |serial: &str| json!({"mesh_id": mesh, "cell": "none", "part_number": "P-1", "serial": serial});
    let answer = api.post_json("/api/v1/jobs/batch", &json!({"jobs": [request("1"), request("2"), request("3")]})).await;
    let batch = answer.ok(202);
    assert!(answer.header("retry-after").parse::<u32>().is_ok());
    let jobs = batch["jobs"].as_array().expect("a list");
    assert_eq!(jobs.iter().map(|job| &job["serial"]).collect::<Vec<_>>(), [&json!("1"), &json!("2"), &json!("3")]);
    for job in jobs {
        assert_eq!(api.ended(job["id"].as_str().expect("an id")).await["state"], "succeeded");
    }
}

#[tokio::test]
async fn a_batch_with_faults_names_them_all_and_starts_nothing() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let good = json!({"mesh_id": mesh, "cell": "none"});
    let batch = json!({"jobs": [
        good,
        {"mesh_id": "01a1f77c-78a1-7554-855a-a9513c22aa2b", "cell": "nowhere"},
        good,
        {"mesh_id": mesh, "cell": "none", "priority": 101, "params": {"selection": {"target": 2}}},
    ]});
    let pointers = ["/jobs/1/mesh_id", "/jobs/1/cell", "/jobs/3/priority", "/jobs/3/params/selection/target"];
    api.post_json("/api/v1/jobs/batch", &batch).await.problem_at("invalid_fields", &pointers);
    let misspelt = json!({"jobs": [good, {"mesh_id": mesh, "sell": "none"}]});
    api.post_json("/api/v1/jobs/batch", &misspelt).await.problem_at("bad_shape", &["/jobs/1/sell"]);
    let many = json!({"jobs": vec![good; 101]});
    let problem = api.post_json("/api/v1/jobs/batch", &many).await.problem_at("invalid_fields", &["/jobs"]);
    assert_eq!(problem["errors"][0]["detail"], "has 101 entries; allowed are 1 to 100");
    assert_eq!(api.get("/api/v1/jobs").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn a_batch_that_does_not_fit_into_the_queue_is_refused_whole() {
    let api = Api::start_with(vantage::service::Options { max_queued_jobs: 2, ..service_options() }, http_options()).await;
    let running = api.job("wait").await;
    api.running(&running).await;
    let job = json!({"mesh_id": api.mesh().await, "cell": "none"});
    // An empty queue has no room for it either.
    api.post_json("/api/v1/jobs/batch", &json!({"jobs": vec![&job; 3]})).await.problem_at("invalid_fields", &["/jobs"]);
    api.post_json("/api/v1/jobs", &job).await.ok(202);
    api.post_json("/api/v1/jobs/batch", &json!({"jobs": vec![&job; 2]})).await.problem("queue_full");
    assert_eq!(api.get("/api/v1/jobs?state=queued").await.ok(200)["items"].as_array().map(Vec::len), Some(1));
    api.post_json("/api/v1/jobs/batch", &json!({"jobs": vec![&job; 1]})).await.ok(202);
}

#[tokio::test]
async fn a_key_starts_one_batch_however_often_it_comes() {
    let api = Api::start().await;
    let job = json!({"mesh_id": api.mesh().await, "cell": "none"});
    let send = async |path: &str, body: &Value| {
        let headers = [("content-type", "application/json"), ("idempotency-key", "order-1")];
        api.send("POST", path, &headers, body.to_string()).await
    };
    let batch = json!({"jobs": [job, job]});
    let first = send("/api/v1/jobs/batch", &batch).await.ok(202);
    api.ended(first["jobs"][1]["id"].as_str().expect("an id")).await;
    assert_eq!(send("/api/v1/jobs/batch", &batch).await.ok(202), first);
    send("/api/v1/jobs/batch", &json!({"jobs": [job]})).await.problem("idempotency_mismatch");
    send("/api/v1/jobs", &job).await.problem("idempotency_mismatch");
    assert_eq!(api.get("/api/v1/jobs").await.ok(200)["items"].as_array().expect("a list").len(), 2);
}

#[tokio::test]
async fn selected_jobs_are_deleted_but_never_one_that_runs_or_is_held() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let start = async |labels: Value| {
        let job = api.post_json("/api/v1/jobs", &json!({"mesh_id": mesh, "cell": "none", "labels": labels})).await.ok(202);
        job["id"].as_str().expect("an id").to_owned()
    };
    let (a, b) = (start(json!({"line": "3"})).await, start(json!({"line": "3"})).await);
    let (held, other) = (start(json!({"line": "3", "hold": ""})).await, start(json!({"line": "4"})).await);
    for job in [&a, &b, &held, &other] {
        api.ended(job).await;
    }
    let running = start(json!({"line": "3", "do": "wait"})).await;
    api.running(&running).await;
    let waiting = start(json!({"line": "3"})).await;
    let counts = |deleted: u64, dry_run: bool| json!({"deleted": deleted, "held": 1, "not_ended": 2, "dry_run": dry_run});
    let line = json!({"label": "line=3"});
    assert_eq!(api.post_json("/api/v1/jobs/delete?dry_run=true", &line).await.ok(200), counts(2, true));
    assert_eq!(api.get(&format!("/api/v1/jobs/{a}")).await.status, 200, "only counted");
    assert_eq!(api.post_json("/api/v1/jobs/delete", &line).await.ok(200), counts(2, false));
    assert_eq!(api.post_json("/api/v1/jobs/delete", &line).await.ok(200), counts(0, false));
    for job in [&a, &b] {
        api.get(&format!("/api/v1/jobs/{job}")).await.problem("job_not_found");
    }
    for job in [&held, &other, &running, &waiting] {
        assert_eq!(api.get(&format!("/api/v1/jobs/{job}")).await.status, 200);
    }
    // Every filter must fit.
    let nothing = json!({"ids": [other], "state": "failed"});
    assert_eq!(api.post_json("/api/v1/jobs/delete", &nothing).await.ok(200)["deleted"], 0);
    let exactly =
        json!({"ids": [other], "state": "succeeded", "mesh_id": mesh, "cell": "none", "created_after": "2026-01-01T00:00:00Z"});
    assert_eq!(api.post_json("/api/v1/jobs/delete", &exactly).await.ok(200)["deleted"], 1);
    api.post_json(&format!("/api/v1/jobs/{running}/cancel"), &json!(null)).await.ok(202);
    assert_eq!(api.ended(&waiting).await["state"], "succeeded");
}

#[tokio::test]
async fn a_queued_job_overtakes_with_a_higher_priority() {
    let api = Api::start().await;
    let running = api.job("wait").await;
    api.running(&running).await;
    let (first, second) = (api.job("").await, api.job("").await);
    let moved = api.patch_json(&format!("/api/v1/jobs/{second}"), &json!({"priority": 50})).await.ok(200);
    assert_eq!((&moved["priority"], &moved["queue_position"]), (&json!(50), &json!(1)));
    assert_eq!(api.get(&format!("/api/v1/jobs/{first}")).await.ok(200)["queue_position"], 2);
    let problem = api.patch_json(&format!("/api/v1/jobs/{running}"), &json!({"priority": 50})).await.problem("job_not_queued");
    assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("running")), "{problem}");
    let path = format!("/api/v1/jobs/{second}");
    api.patch_json(&path, &json!({"priority": -101})).await.problem_at("invalid_fields", &["/priority"]);
    api.patch_json(&path, &json!({"labels": {}})).await.problem_at("bad_shape", &["/priority", "/labels"]);
    api.post_json(&format!("/api/v1/jobs/{running}/cancel"), &json!(null)).await.ok(202);
    let (first, second) = (api.ended(&first).await, api.ended(&second).await);
    assert!(second["started_at"].as_str() <= first["started_at"].as_str(), "{second} {first}");
    let ended = second["id"].as_str().expect("an id");
    api.patch_json(&format!("/api/v1/jobs/{ended}"), &json!({"priority": 1})).await.problem("job_not_queued");
}
