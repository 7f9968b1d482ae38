//! Specifications: presets, stored ones, and who may change what.

use serde_json::{Value, json};

use super::api::{Answer, Api};

const COLLECTIONS: [(&str, &str, &str); 4] = [
    ("scanners", "transcan-c-nominal", "/mass_kg"),
    ("robots", "hans-e05", "/name"),
    ("turntables", "minas-a6-500", "/name"),
    ("cells", "e05-transcan", "/floor_mm"),
];

async fn put(api: &Api, path: &str, spec: &Value, precondition: &[(&str, &str)]) -> Answer {
    let headers: Vec<_> = [("content-type", "application/json")].into_iter().chain(precondition.iter().copied()).collect();
    api.send("PUT", path, &headers, spec.to_string()).await
}

#[tokio::test]
async fn a_specification_is_stored_replaced_and_deleted() {
    let api = Api::start().await;
    for (collection, preset, _) in COLLECTIONS {
        let path = format!("/api/v1/{collection}/ours");
        let mut spec = api.get(&format!("/api/v1/{collection}/{preset}")).await.ok(200);
        spec["name"] = json!("ours");
        let created = put(&api, &path, &spec, &[("if-none-match", "*")]).await;
        assert_eq!(created.ok(201), spec, "{collection}");
        let got = api.get(&path).await;
        assert_eq!((got.ok(200), got.header("etag")), (spec.clone(), created.header("etag")));
        assert_eq!(api.send("GET", &path, &[("if-none-match", got.header("etag"))], "").await.status, 304);

        api.send("GET", &path, &[("if-match", "\"0\"")], "").await.problem("precondition_failed");
        api.send("GET", &path, &[("if-match", got.header("etag"))], "").await.ok(200);

        let required = put(&api, &path, &spec, &[]).await;
        required.problem("precondition_required");
        assert_eq!(required.header("etag"), created.header("etag"));
        put(&api, &path, &spec, &[("if-none-match", "*")]).await.problem("precondition_failed");
        put(&api, &path, &spec, &[("if-match", "\"0\"")]).await.problem("precondition_failed");
        put(&api, &path, &spec, &[("if-match", "*"), ("if-none-match", "*")]).await.problem("precondition_failed");
        put(&api, &path, &spec, &[("if-match", &format!("W/{}", created.header("etag")))]).await.problem("precondition_failed");
        let replaced = put(&api, &path, &spec, &[("if-match", created.header("etag"))]).await;
        replaced.ok(200);
        assert_ne!(replaced.header("etag"), created.header("etag"));
        put(&api, &path, &spec, &[("if-match", created.header("etag"))]).await.problem("precondition_failed");
        put(&api, &path, &spec, &[("if-match", "*")]).await.ok(200);

        let list = api.get(&format!("/api/v1/{collection}")).await.ok(200);
        let names: Vec<_> = list["items"].as_array().expect("a list").iter().map(|item| &item["name"]).collect();
        assert!(names.contains(&&json!("ours")) && names.contains(&&json!(preset)), "{list}");
        api.send("DELETE", &path, &[("if-match", "\"0\"")], "").await.problem("precondition_failed");
        assert_eq!(api.send("DELETE", &path, &[], "").await.status, 204);
        api.send("DELETE", &path, &[], "").await.problem("spec_not_found");
        api.get(&path).await.problem("spec_not_found");
        put(&api, &path, &spec, &[("if-match", "*")]).await.problem("precondition_failed");
    }
}

#[tokio::test]
async fn presets_stay_as_they_are() {
    let api = Api::start().await;
    for (collection, preset, _) in COLLECTIONS {
        let path = format!("/api/v1/{collection}/{preset}");
        let got = api.get(&path).await;
        put(&api, &path, &got.ok(200), &[("if-match", got.header("etag"))]).await.problem("spec_is_preset");
        api.send("DELETE", &path, &[], "").await.problem("spec_is_preset");
        let list = api.get(&format!("/api/v1/{collection}")).await.ok(200);
        let item = list["items"].as_array().expect("a list").iter().find(|item| item["name"] == preset).expect("it").clone();
        assert_eq!((&item["preset"], item["etag"].as_str()), (&json!(true), Some(got.header("etag"))));
    }
}

#[tokio::test]
async fn what_makes_no_sense_is_refused_with_its_pointer() {
    let api = Api::start().await;
    for (collection, preset, _) in COLLECTIONS {
        let spec = api.get(&format!("/api/v1/{collection}/{preset}")).await.ok(200);
        let path = format!("/api/v1/{collection}/ours");
        put(&api, &path, &spec, &[]).await.problem_at("invalid_fields", &["/name"]);
        let mut unknown = spec.clone();
        unknown["name"] = json!("ours");
        unknown["colour"] = json!("red");
        put(&api, &path, &unknown, &[]).await.problem_at("bad_shape", &["/colour"]);
        let empty = put(&api, &path, &json!({}), &[]).await.problem("bad_shape");
        let lacks: Vec<_> = empty["errors"].as_array().expect("a list").iter().map(|error| &error["pointer"]).collect();
        assert!(lacks.contains(&&json!("/name")) && lacks.len() > 4, "all that it lacks at once: {empty}");
        put(&api, &path, &json!([]), &[]).await.problem("bad_shape");
        for name in ["UPPER", "a%20b", "-a", "..", "%2e%2e%2fx", &"a".repeat(65)] {
            let mut named = spec.clone();
            named["name"] = json!(name);
            let answer = put(&api, &format!("/api/v1/{collection}/{name}"), &named, &[]).await;
            assert!(answer.status.is_client_error(), "{name}: {}", answer.text());
        }
    }
    let mut scanner = api.get("/api/v1/scanners/transcan-c-nominal").await.ok(200);
    scanner["name"] = json!("ours");
    scanner["depth_mm"]["near"] = json!(600.0);
    scanner["mass_kg"] = json!(0);
    put(&api, "/api/v1/scanners/ours", &scanner, &[]).await.problem_at("invalid_fields", &["/depth_mm", "/mass_kg"]);
    let mut cell = api.get("/api/v1/cells/e05-transcan").await.ok(200);
    cell["name"] = json!("none");
    put(&api, "/api/v1/cells/none", &cell, &[]).await.problem_at("invalid_fields", &["/name"]);
    cell["name"] = json!("ours");
    cell["robot"] = json!("nobody");
    let problem = put(&api, "/api/v1/cells/ours", &cell, &[]).await.problem_at("invalid_fields", &["/robot"]);
    assert!(problem["errors"][0]["detail"].as_str().is_some_and(|detail| detail.contains("hans-e05")), "{problem}");
}

#[tokio::test]
async fn a_later_change_of_a_specification_changes_no_accepted_job() {
    let api = Api::start().await;
    let running = api.job("wait").await;
    api.running(&running).await;
    let mut scanner = api.get("/api/v1/scanners/transcan-c-nominal").await.ok(200);
    scanner["name"] = json!("ours");
    put(&api, "/api/v1/scanners/ours", &scanner, &[]).await.ok(201);
    let request = json!({"mesh_id": api.mesh().await, "cell": "none", "scanner": "ours"});
    let job = api.post_json("/api/v1/jobs", &request).await.ok(202);
    assert_eq!(api.send("DELETE", "/api/v1/scanners/ours", &[], "").await.status, 204);
    api.post_json("/api/v1/jobs", &request).await.problem_at("invalid_fields", &["/scanner"]);
    api.post_json(&format!("/api/v1/jobs/{running}/cancel"), &json!(null)).await.ok(202);
    assert_eq!(api.ended(job["id"].as_str().expect("an id")).await["state"], "succeeded");
}
