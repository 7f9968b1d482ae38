//! Pages of other origins: those that `server.cors_origins` lists may use the API with the key, and nobody else.

use super::api::{Answer, Api, cube, http_options, service_options};

const LISTED: &str = "https://mes.plant.example:8443";
const KEY: &str = "0123456789abcdef-key";

async fn listed(with_key: bool) -> Api {
    let key = with_key.then(|| serde_json::from_value(serde_json::json!(KEY)).expect("a key"));
    let http = vantage::http::ServerOptions { cors_origins: vec![LISTED.to_owned()], api_key: key, ..http_options() };
    Api::start_with(service_options(), http).await
}

/// Asks as a browser does before a request that changes something.
async fn preflight(api: &Api, origin: &str, method: &str, headers: &str) -> Answer {
    let asked = [
        ("origin", origin),
        ("sec-fetch-site", "cross-site"),
        ("access-control-request-method", method),
        ("access-control-request-headers", headers),
    ];
    api.send("OPTIONS", "/api/v1/jobs", &asked, "").await
}

#[tokio::test]
async fn a_listed_origin_passes_the_preflight_without_the_key() {
    let api = listed(true).await;
    for method in ["POST", "PUT", "PATCH", "DELETE"] {
        let answer = preflight(&api, LISTED, method, "authorization,content-type,idempotency-key").await;
        assert_eq!((answer.status.as_u16(), answer.header("access-control-allow-origin")), (200, LISTED), "{method}");
        assert!(answer.header("access-control-allow-methods").contains(method), "{method}");
        let allowed = answer.header("access-control-allow-headers").to_ascii_lowercase();
        for header in ["authorization", "content-type", "idempotency-key", "if-match", "range", "last-event-id"] {
            assert!(allowed.split(',').any(|name| name.trim() == header), "{header}: {allowed}");
        }
        // A session is our own page's: no cookie goes along, and the header that a change needs with it is not allowed.
        assert!(!allowed.contains("x-vantage-session"), "{allowed}");
        assert_eq!(answer.header("access-control-allow-credentials"), "");
        assert!(answer.header("vary").to_ascii_lowercase().contains("origin"), "{:?}", answer.headers);
    }
}

#[tokio::test]
async fn a_listed_origin_uses_the_api_with_the_key_and_not_without() {
    let api = listed(true).await;
    let of_page = [("origin", LISTED), ("sec-fetch-site", "cross-site")];
    let key = format!("Bearer {KEY}");
    let with_key = [&of_page[..], &[("authorization", key.as_str())]].concat();
    let uploaded = api.send("POST", "/api/v1/meshes?unit=mm", &with_key, cube(10.0)).await;
    uploaded.ok(201);
    assert_eq!(uploaded.header("access-control-allow-origin"), LISTED);
    let exposed = uploaded.header("access-control-expose-headers").to_ascii_lowercase();
    assert!(["location", "etag", "retry-after", "content-range"].iter().all(|name| exposed.contains(name)), "{exposed}");
    // A refusal can be read too.
    let refused = api.send("POST", "/api/v1/meshes?unit=mm", &of_page, cube(10.0)).await;
    refused.problem("key_missing");
    assert_eq!(refused.header("access-control-allow-origin"), LISTED);
}

#[tokio::test]
async fn other_origins_are_told_nothing_and_change_nothing() {
    let api = listed(false).await;
    for origin in ["https://mes.plant.example", "http://mes.plant.example:8443", "https://evil.example", "null", "*"] {
        let answer = preflight(&api, origin, "POST", "content-type").await;
        assert_eq!(answer.header("access-control-allow-origin"), "", "{origin}");
        let headers = [("origin", origin), ("sec-fetch-site", "cross-site")];
        let refused = api.send("POST", "/api/v1/meshes?unit=mm", &headers, cube(10.0)).await;
        refused.problem("cross_site");
        assert_eq!(refused.header("access-control-allow-origin"), "", "{origin}");
    }
    let headers = [("origin", LISTED), ("sec-fetch-site", "cross-site")];
    api.send("POST", "/api/v1/meshes?unit=mm", &headers, cube(10.0)).await.ok(201);
    // The name that the request is for is held against our own all the same.
    let rebound = [("host", "evil.example"), ("origin", LISTED)];
    api.send("POST", "/api/v1/meshes?unit=mm", &rebound, cube(10.0)).await.problem("host_not_allowed");
}

#[tokio::test]
async fn without_a_list_there_is_no_consent_at_all() {
    let api = Api::start().await;
    let answer = preflight(&api, LISTED, "POST", "content-type").await;
    // The methods of the route are no consent.
    assert_eq!((answer.status.as_u16(), answer.header("allow")), (204, "GET,HEAD,POST"));
    assert!(answer.headers.keys().all(|name| !name.as_str().starts_with("access-control-")), "{:?}", answer.headers);
    let read = api.send("GET", "/api/v1/jobs", &[("origin", LISTED)], "").await;
    assert_eq!((read.status.as_u16(), read.header("access-control-allow-origin")), (200, ""));
}
