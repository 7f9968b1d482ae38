//! The name that a request is for, through the router: every answer is a problem, and pages and probes are no exception.

use axum::body::Body;
use axum::http::Request;

use super::api::{Answer, Api};

async fn asked(api: &Api, path: &str, hosts: &[&str]) -> Answer {
    let mut request = Request::builder().uri(path);
    for host in hosts {
        request = request.header("host", *host);
    }
    Answer::read(api.as_it_is(request.body(Body::empty()).expect("a request")).await).await
}

#[tokio::test]
async fn a_page_that_had_its_name_pointed_here_gets_nothing() {
    let api = Api::start().await;
    for path in ["/", "/api/v1/jobs", "/metrics", "/version", "/healthz", "/docs/openapi.json"] {
        assert_eq!(asked(&api, path, &["127.0.0.1:8080"]).await.status, 200, "{path}");
        let refused = asked(&api, path, &["evil.example:8080"]).await;
        assert_eq!(refused.status, 421);
        let problem = refused.problem_at("host_not_allowed", &["Host"]);
        assert!(problem["detail"].as_str().is_some_and(|detail| detail.contains("server.hosts")), "{problem}");
    }
}

#[tokio::test]
async fn a_request_without_a_host_or_with_two_is_refused() {
    let api = Api::start().await;
    asked(&api, "/healthz", &[]).await.problem_at("bad_request", &["Host"]);
    asked(&api, "/healthz", &["localhost", "localhost"]).await.problem_at("bad_request", &["Host"]);
}
