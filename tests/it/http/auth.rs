//! The key: every route under `/api` asks for it, and nothing else does.

use super::api::{Api, http_options, service_options};

const KEY: &str = "0123456789abcdef-key";
const RIGHT: &str = "Bearer 0123456789abcdef-key";

async fn guarded() -> Api {
    let key: vantage::http::ApiKey = serde_json::from_value(serde_json::json!(KEY)).expect("a key");
    Api::start_with(service_options(), vantage::http::ServerOptions { api_key: Some(key), ..http_options() }).await
}

/// Every operation of the document, with something in its placeholders.
fn operations() -> Vec<(String, String)> {
    let document = serde_json::to_value(vantage::http::openapi()).expect("JSON");
    let mut operations = Vec::new();
    for (path, item) in document["paths"].as_object().expect("paths") {
        let path =
            path.replace("{id}", "01a1f77c-78a1-7554-855a-a9513c22aa2b").replace("{name}", "a").replace("{dialect}", "rapid");
        operations.extend(item.as_object().expect("operations").keys().map(|method| (method.to_uppercase(), path.clone())));
    }
    operations
}

#[tokio::test]
async fn every_route_under_api_asks_for_the_key() {
    let api = guarded().await;
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
            let answer = api.send(&method, &path, &[("authorization", RIGHT)], "").await;
            assert_ne!(answer.status, 401, "{method} {path}");
        }
    }
    assert!(asked > 30, "{asked}");
    // Nothing is told of what is under /api by its other answers.
    api.send("PATCH", "/api/v1/jobs", &[], "").await.problem("key_missing");
}

/// Begins a session; returns what the browser is told to keep.
async fn begin_session(api: &Api, headers: &[(&str, &str)]) -> String {
    let answer = api.send("POST", "/api/v1/session", &[&[("authorization", RIGHT)], headers].concat(), "").await;
    assert_eq!(answer.status, 204);
    answer.header("set-cookie").to_owned()
}

/// Cookie that the browser sends back.
fn sent_back(set_cookie: &str) -> String {
    format!("other=1; {}; vantage_key={KEY}", set_cookie.split(';').next().expect("a pair"))
}

#[tokio::test]
async fn a_session_is_begun_with_the_key_and_holds_nothing_of_it() {
    let api = guarded().await;
    let set_cookie = begin_session(&api, &[]).await;
    let (pair, rest) = set_cookie.split_once(';').expect("attributes");
    let id = pair.strip_prefix("vantage_session=").expect("the cookie");
    assert!(id.len() == 64 && id.bytes().all(|c| c.is_ascii_hexdigit()), "{set_cookie}");
    assert_eq!(rest, " Path=/; HttpOnly; SameSite=Strict");
    assert_ne!(begin_session(&api, &[]).await, set_cookie);
    // Behind a proxy that speaks TLS the cookie goes over TLS only; in front of one nobody is believed.
    assert!(begin_session(&api, &[("x-forwarded-proto", "https")]).await.contains("; Secure"));
    for wrong in ["Bearer x", "Basic x"] {
        assert_eq!(api.send("POST", "/api/v1/session", &[("authorization", wrong)], "").await.status, 401);
    }
    // A session begins no other, and the key itself is no cookie any more.
    let cookie = sent_back(&set_cookie);
    let answer = api.send("POST", "/api/v1/session", &[("cookie", &cookie), ("x-vantage-session", "1")], "").await;
    answer.problem("key_missing");
    let key = format!("vantage_key={KEY}");
    api.send("GET", "/api/v1/jobs", &[("cookie", &key)], "").await.problem("key_missing");
}

#[tokio::test]
async fn a_session_reads_and_changes_with_its_header_only() {
    let api = guarded().await;
    let cookie = sent_back(&begin_session(&api, &[]).await);
    for method in ["GET", "HEAD"] {
        assert_eq!(api.send(method, "/api/v1/jobs", &[("cookie", &cookie)], "").await.status, 200);
    }
    let changes = operations().into_iter().filter(|(method, path)| method != "GET" && path.starts_with("/api/"));
    for (method, path) in changes.filter(|(_, path)| path != "/api/v1/session") {
        api.send(&method, &path, &[("cookie", &cookie)], "").await.problem("key_missing");
        let with_header = api.send(&method, &path, &[("cookie", &cookie), ("x-vantage-session", "1")], "").await;
        assert_ne!(with_header.status, 401, "{method} {path}");
        let of_other_site = [("cookie", cookie.as_str()), ("x-vantage-session", "1"), ("sec-fetch-site", "cross-site")];
        api.send(&method, &path, &of_other_site, "").await.problem("cross_site");
    }
}

#[tokio::test]
async fn a_session_ends_when_asked_to() {
    let api = guarded().await;
    let (cookie, other) = (sent_back(&begin_session(&api, &[]).await), sent_back(&begin_session(&api, &[]).await));
    api.send("DELETE", "/api/v1/session", &[("cookie", &cookie)], "").await.problem("key_missing");
    let ended = api.send("DELETE", "/api/v1/session", &[("cookie", &cookie), ("x-vantage-session", "1")], "").await;
    assert_eq!(ended.status, 204);
    assert_eq!(ended.header("set-cookie"), "vantage_session=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0");
    let over = api.send("GET", "/api/v1/jobs", &[("cookie", &cookie)], "").await;
    over.problem("session_ended");
    assert_eq!(over.header("www-authenticate"), "Bearer");
    assert_eq!(api.send("GET", "/api/v1/jobs", &[("cookie", &other)], "").await.status, 200);
    api.send("GET", "/api/v1/jobs", &[("cookie", "vantage_session=made-up")], "").await.problem("session_ended");
}

#[tokio::test]
async fn a_server_without_a_key_needs_no_sessions() {
    let api = Api::start().await;
    for method in ["POST", "DELETE"] {
        assert_eq!(api.send(method, "/api/v1/session", &[], "").await.status, 204);
    }
    assert_eq!(api.send("POST", "/api/v1/session", &[], "").await.header("set-cookie"), "");
}

#[tokio::test]
async fn pages_need_no_key() {
    let api = guarded().await;
    for path in [
        "/",
        "/assets/page.js",
        "/docs/",
        "/docs/openapi.json",
        "/problems",
        "/problems/busy",
        "/parameters",
        "/healthz",
        "/readyz",
        "/version",
        "/metrics",
    ] {
        let answer = api.get(path).await;
        assert_eq!(answer.status, 200, "{path}");
        assert!(!answer.text().contains(KEY));
    }
}

#[tokio::test]
async fn keys_of_a_file_are_named_and_exchanged_without_a_restart() {
    const MES: &str = "0123456789abcdef-mes";
    const LINE: &str = "0123456789abcdef-line-3";
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), format!("mes = \"{MES}\"\nline-3 = \"{LINE}\"\n")).expect("written");
    let own: vantage::http::ApiKey = serde_json::from_value(serde_json::json!(KEY)).expect("a key");
    let http = vantage::http::ServerOptions { api_key: Some(own), api_keys_file: Some(file.path().to_owned()), ..http_options() };
    let api = Api::start_with(service_options(), http).await;
    api.get("/api/v1/jobs").await.problem("key_missing");
    let bearer = |key: &str| format!("Bearer {key}");
    let uploaded = api.send("POST", "/api/v1/meshes?unit=mm", &[("authorization", &bearer(MES))], super::api::cube(10.0)).await;
    let mesh = uploaded.ok(201)["id"].clone();
    let body = serde_json::json!({"mesh_id": mesh, "cell": "none"}).to_string();
    let json = ("content-type", "application/json");
    let mut senders = Vec::new();
    for key in [MES, LINE, KEY] {
        let job = api.send("POST", "/api/v1/jobs", &[json, ("authorization", &bearer(key))], body.clone()).await.ok(202);
        senders.push(job["submitted_by"].clone());
    }
    assert_eq!(senders, ["mes", "line-3", "api_key"]);
    // By a session of the page too, and in a batch.
    let begun = api.send("POST", "/api/v1/session", &[("authorization", &bearer(LINE))], "").await;
    let cookie = sent_back(begun.header("set-cookie"));
    let session = [("cookie", cookie.as_str()), ("x-vantage-session", "1"), json];
    let batch = format!("{{\"jobs\": [{body}]}}");
    let jobs = api.send("POST", "/api/v1/jobs/batch", &session, batch).await.ok(202);
    assert_eq!(jobs["jobs"][0]["submitted_by"], "line-3");
    let list = api.send("GET", "/api/v1/jobs?fields=submitted_by", &session[..1], "").await.ok(200);
    let listed: Vec<_> = list["items"].as_array().expect("a list").iter().map(|job| job["submitted_by"].clone()).collect();
    assert_eq!(listed, ["line-3", "api_key", "line-3", "mes"]);

    // What one calls its first order is none of the other's.
    let order =
        |key: &str| [json, ("idempotency-key", "1"), ("authorization", key)].map(|(name, value)| (name, value.to_owned()));
    let mut orders = Vec::new();
    for key in [MES, LINE, MES] {
        let headers = order(&bearer(key));
        let headers: Vec<(&str, &str)> = headers.iter().map(|(name, value)| (*name, value.as_str())).collect();
        orders.push(api.send("POST", "/api/v1/jobs", &headers, body.clone()).await.ok(202)["id"].clone());
    }
    assert!(orders[0] == orders[2] && orders[0] != orders[1], "{orders:?}");

    // One key is exchanged, the other is withdrawn: its session ends with it, and so does its stream of events.
    let stream = axum::http::Request::get("/api/v1/events").header("authorization", bearer(LINE));
    let stream = api.raw(stream.body(axum::body::Body::empty()).expect("a request")).await;
    assert_eq!(stream.status(), 200);
    std::fs::write(file.path(), "mes = \"fedcba9876543210-mes\"\n").expect("written");
    let rest = tokio::time::timeout(std::time::Duration::from_secs(8), axum::body::to_bytes(stream.into_body(), 1 << 20));
    rest.await.expect("it ends").expect("the events so far");
    tokio::time::sleep(std::time::Duration::from_millis(1100)).await;
    for (key, status) in [("fedcba9876543210-mes", 200), (KEY, 200), (MES, 401), (LINE, 401)] {
        assert_eq!(api.send("GET", "/api/v1/jobs", &[("authorization", &bearer(key))], "").await.status, status, "{key}");
    }
    api.send("GET", "/api/v1/jobs", &session[..1], "").await.problem("session_ended");
}

/// A stream went on for whoever had signed out.
#[tokio::test]
async fn a_stream_of_events_ends_with_the_session_that_it_was_begun_with() {
    let api = guarded().await;
    let begun = api.send("POST", "/api/v1/session", &[("authorization", RIGHT)], "").await;
    let cookie = sent_back(begun.header("set-cookie"));
    let stream = axum::http::Request::get("/api/v1/events").header("cookie", &cookie);
    let stream = api.raw(stream.body(axum::body::Body::empty()).expect("a request")).await;
    assert_eq!(stream.status(), 200);
    let session = [("cookie", cookie.as_str()), ("x-vantage-session", "1")];
    assert_eq!(api.send("DELETE", "/api/v1/session", &session, "").await.status, 204);
    let rest = tokio::time::timeout(std::time::Duration::from_secs(8), axum::body::to_bytes(stream.into_body(), 1 << 20));
    rest.await.expect("it ends").expect("the events so far");
}

#[tokio::test]
async fn a_job_without_a_key_has_no_sender() {
    let api = Api::start().await;
    let job = api.job("").await;
    assert_eq!(api.get(&format!("/api/v1/jobs/{job}")).await.ok(200)["submitted_by"], serde_json::Value::Null);
}
