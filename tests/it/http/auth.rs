//! The key: every route under `/api` asks for it, and nothing else does.

use super::api::{Api, http_options, service_options};

const KEY: &str = "0123456789abcdef-key";

async fn guarded() -> Api {
    let key: vantage::http::ApiKey = serde_json::from_value(serde_json::json!(KEY)).expect("a key");
    Api::start_with(service_options(), vantage::http::Options { api_key: Some(key), ..http_options() }).await
}

/// Every operation of the document, with something in its placeholders.
fn operations() -> Vec<(String, String)> {
    let document = serde_json::to_value(vantage::http::openapi()).expect("JSON");
    let mut operations = Vec::new();
    for (path, item) in document["paths"].as_object().expect("paths") {
        let path = path.replace("{id}", "01a1f77c-78a1-7554-855a-a9513c22aa2b").replace("{name}", "a");
        operations.extend(item.as_object().expect("operations").keys().map(|method| (method.to_uppercase(), path.clone())));
    }
    operations
}

#[tokio::test]
async fn every_route_under_api_asks_for_the_key() {
    let api = guarded().await;
    let right = format!("Bearer {KEY}");
    let mut asked = 0;
    for (method, path) in operations() {
        let none = api.send(&method, &path, &[], "").await;
        if !path.starts_with("/api/") {
            assert!(none.status.is_success(), "{method} {path}: {}", none.status);
            continue;
        }
        asked += 1;
        none.problem("key_missing");
        assert_eq!(none.header("www-authenticate"), "Bearer", "{method} {path}");
        for wrong in
            ["Bearer", "Bearer ", "Bearer x", "Basic MDEyMzQ1", KEY, &format!("Bearer {KEY}x"), &format!("Bearer {}", &KEY[1..])]
        {
            let answer = api.send(&method, &path, &[("authorization", wrong)], "").await;
            assert_eq!(answer.status, 401, "{method} {path} {wrong:?}");
        }
        if path != "/api/v1/events" {
            let answer = api.send(&method, &path, &[("authorization", &right)], "").await;
            assert_ne!(answer.status, 401, "{method} {path}");
        }
    }
    assert!(asked > 30, "{asked}");
    // Nothing is told of what is under /api by its other answers.
    api.send("PATCH", "/api/v1/jobs", &[], "").await.problem("key_missing");
}

#[tokio::test]
async fn the_cookie_serves_for_reading_only() {
    let api = guarded().await;
    let cookie = format!("other=1; vantage_key={KEY}");
    assert_eq!(api.send("GET", "/api/v1/jobs", &[("cookie", &cookie)], "").await.status, 200);
    assert_eq!(api.send("HEAD", "/api/v1/jobs", &[("cookie", &cookie)], "").await.status, 200);
    for (method, path) in operations().into_iter().filter(|(method, path)| method != "GET" && path.starts_with("/api/")) {
        api.send(&method, &path, &[("cookie", &cookie)], "").await.problem("key_missing");
    }
    api.send("GET", "/api/v1/jobs", &[("cookie", "vantage_key=wrong")], "").await.problem("key_wrong");
}

#[tokio::test]
async fn pages_need_no_key() {
    let api = guarded().await;
    for path in
        ["/", "/assets/page.js", "/docs/", "/docs/openapi.json", "/problems", "/healthz", "/readyz", "/version", "/metrics"]
    {
        let answer = api.get(path).await;
        assert_eq!(answer.status, 200, "{path}");
        assert!(!answer.text().contains(KEY));
    }
}
