//! Lists as a production system reads them: filters, orders, and the fields that it wants.

use serde_json::{Value, json};

use super::api::Api;

/// Three ended jobs, the first with the lowest numbers; their ids.
async fn three(api: &Api, mesh: &str) -> Vec<String> {
    let mut ids = Vec::new();
    for (number, cell) in [(1, "none"), (2, "e05-transcan"), (3, "none")] {
        let request = json!({"mesh_id": mesh, "cell": cell, "part_number": "P", "serial": format!("S-{number}")});
        let job = api.post_json("/api/v1/jobs", &request).await.ok(202)["id"].as_str().expect("an id").to_owned();
        api.ended(&job).await;
        ids.push(job);
    }
    ids
}

#[tokio::test]
async fn jobs_are_found_by_what_a_production_system_knows() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let ids = three(&api, &mesh).await;
    let other = api.send("POST", "/api/v1/meshes?unit=inch", &[], super::api::cube(1.0)).await.ok(201)["id"].clone();
    let middle = api.get(&format!("/api/v1/jobs/{}", ids[1])).await.ok(200)["created_at"].as_str().expect("a time").to_owned();
    let found = async |query: &str| -> Vec<usize> {
        let page = api.get(&format!("/api/v1/jobs?{query}")).await.ok(200);
        let number = |job: &Value| ids.iter().position(|id| job["id"] == id.as_str()).expect("one of them");
        page["items"].as_array().expect("a list").iter().map(number).collect()
    };
    assert_eq!(found("serial=S-2").await, [1]);
    assert_eq!(found(&format!("mesh={mesh}")).await, [2, 1, 0]);
    assert_eq!(found(&format!("mesh={}", other.as_str().expect("an id"))).await, [] as [usize; 0]);
    assert_eq!(found("cell=none").await, [2, 0]);
    assert_eq!(found("cell=none&serial=S-3&part_number=P&state=succeeded").await, [2]);
    assert_eq!(found(&format!("created_after={middle}")).await, [2, 1], "at that time or later");
    assert_eq!(found(&format!("created_before={middle}")).await, [0], "before that time");
    assert_eq!(found("created_after=2100-01-01T00:00:00%2B01:00").await, [] as [usize; 0]);
    // A plus that nobody escaped.
    assert_eq!(found("created_after=2026-01-01T00:00:00+01:00").await, [2, 1, 0]);
    assert_eq!(found("sort=created_at").await, [0, 1, 2]);
    assert_eq!(found("sort=-ended_at").await, [2, 1, 0]);
    assert_eq!(found("sort=serial").await, [0, 1, 2]);
}

#[tokio::test]
async fn a_sorted_list_is_paged_with_its_own_tokens() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let ids = three(&api, &mesh).await;
    let (mut found, mut token) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("/api/v1/jobs?sort=-serial&page_size=1{token}")).await.ok(200);
        found.extend(page["items"].as_array().expect("a list").iter().map(|job| job["id"].as_str().expect("an id").to_owned()));
        let Some(next) = page["next_page_token"].as_str() else { break };
        token = format!("&page_token={next}");
    }
    assert_eq!(found, ids.into_iter().rev().collect::<Vec<_>>());
    // With another order it is another listing.
    api.get(&format!("/api/v1/jobs?sort=serial&page_size=1{token}")).await.problem_at("bad_page_token", &["page_token"]);
}

#[tokio::test]
async fn answers_have_the_fields_that_were_asked_for() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let ids = three(&api, &mesh).await;
    let page = api.get("/api/v1/jobs?fields=state,serial&page_size=2").await.ok(200);
    assert_eq!(page["items"][0], json!({"id": ids[2], "state": "succeeded", "serial": "S-3"}));
    assert!(page["next_page_token"].is_string(), "{page}");
    let job = api.get(&format!("/api/v1/jobs/{}?fields=id,params", ids[0])).await.ok(200);
    assert_eq!(job.as_object().expect("an object").keys().collect::<Vec<_>>(), ["id", "params"]);
    // Every field of an answer can be asked for, and what does not exist is named with what does.
    let whole = api.get(&format!("/api/v1/jobs/{}", ids[0])).await.ok(200);
    let names: Vec<&str> = whole.as_object().expect("an object").keys().map(String::as_str).collect();
    let all = api.get(&format!("/api/v1/jobs/{}?fields={}", ids[0], names.join(","))).await.ok(200);
    assert_eq!(all, whole);
    let problem = api.get("/api/v1/jobs?fields=state,colour").await.problem_at("bad_query", &["fields"]);
    let detail = problem["detail"].as_str().expect("text");
    assert!(detail.contains("\"colour\"") && detail.contains("queue_position"), "{detail}");
}
