//! Bodies that routes without one refuse, and those that they let pass.

use std::convert::Infallible;
use std::sync::atomic::{AtomicUsize, Ordering};

use axum::Router;
use axum::http::StatusCode;
use axum::middleware::from_fn_with_state;
use axum::routing::{delete, post};
use futures_util::stream;
use tower::ServiceExt as _;

use super::super::router::document;
use super::*;

const GRACE: Duration = Duration::from_secs(60);

/// Routes of the API with handlers that do nothing, nested as in the server.
fn router() -> Router {
    let routes = NoBodyRoutes::of(&document(), "", GRACE);
    let done = || async { "done" };
    let api = Router::new()
        .route("/retention", post(done))
        .route("/session", post(done))
        .route("/jobs", post(done))
        .route("/jobs/{id}", delete(done))
        .route("/scanners/{name}", delete(done))
        .route("/runs/{id}/resume", post(done))
        .route("/runs/{id}/stop", post(done))
        .layer(from_fn_with_state(routes, refuse_body));
    Router::new().nest("/api/v1", api)
}

async fn answer(router: &Router, method: &str, path: &str, body: impl Into<Body>) -> Response {
    let request = axum::http::Request::builder().method(method).uri(format!("/api/v1{path}"));
    let request = request.body(body.into()).expect("a request");
    router.clone().oneshot(request).await.expect("an answer")
}

/// The error of an answer that refuses, in words.
fn error(answer: &Response) -> Option<(Code, String)> {
    let error = answer.extensions().get::<ApiError>()?;
    Some((error.code(), format!("{error:?}")))
}

#[test]
fn every_route_without_a_body_is_known_from_the_document() {
    let routes = NoBodyRoutes::of(&document(), "", GRACE);
    let known: Vec<&str> = routes.advice.keys().map(String::as_str).collect();
    let expected = [
        "DELETE /api/v1/calibrations/{id}",
        "DELETE /api/v1/cells/{name}",
        "DELETE /api/v1/inspections/{id}",
        "DELETE /api/v1/jobs/{id}",
        "DELETE /api/v1/leases/{id}",
        "DELETE /api/v1/meshes/{id}",
        "DELETE /api/v1/robots/{name}",
        "DELETE /api/v1/runs/{id}",
        "DELETE /api/v1/scanners/{name}",
        "DELETE /api/v1/scans/{id}",
        "DELETE /api/v1/session",
        "DELETE /api/v1/turntables/{name}",
        "POST /api/v1/calibrations/{id}/cancel",
        "POST /api/v1/inspections/{id}/cancel",
        "POST /api/v1/jobs/{id}/cancel",
        "POST /api/v1/retention",
        "POST /api/v1/runs/{id}/resume",
        "POST /api/v1/runs/{id}/step",
        "POST /api/v1/session",
        "PUT /api/v1/leases/{id}",
    ];
    assert_eq!(known, expected);
}

#[tokio::test]
async fn a_body_that_says_something_is_refused_with_what_to_send_instead() {
    let router = router();
    for (method, path, body, told) in [
        ("POST", "/retention", "{\"dry_run\": true}", "for a dry run send GET /api/v1/retention, which lists"),
        ("DELETE", "/jobs/7", "{\"dry_run\": true}", "nothing was done; send the request without one\""),
        ("DELETE", "/scanners/mine", "{\"etag\": 1}", "without one; it takes the header If-Match"),
        ("POST", "/runs/7/resume", "{\"token\": 1}", "without one; it takes the query parameter token"),
        ("POST", "/session", "{\"key\": \"k\"}", "the header Authorization"),
        ("POST", "/retention", "dry_run=true", "this route takes no body, so nothing was done"),
        ("POST", "/retention", "[]", "takes no body"),
        ("POST", "/retention", "{", "takes no body"),
        ("POST", "/retention", "{}{}", "takes no body"),
        ("POST", "/retention", "nullnull", "takes no body"),
    ] {
        let answer = answer(&router, method, path, body).await;
        assert_eq!(answer.status(), StatusCode::BAD_REQUEST, "{method} {path} {body}");
        let (code, text) = error(&answer).expect("an error");
        assert_eq!(code, Code::UnexpectedBody);
        assert!(text.contains(told), "{method} {path} {body}: {text}");
    }
}

#[tokio::test]
async fn a_body_that_says_nothing_is_let_pass() {
    let router = router();
    for body in ["", " ", "\r\n", "{}", " {\n\t} ", "null", "null\n"] {
        for (method, path) in [("POST", "/retention"), ("DELETE", "/jobs/7"), ("POST", "/runs/7/resume")] {
            assert_eq!(answer(&router, method, path, body).await.status(), StatusCode::OK, "{method} {path} {body:?}");
        }
    }
    let in_pieces = Body::from_stream(stream::iter(["{", "", "}"].map(Ok::<_, Infallible>)));
    assert_eq!(answer(&router, "POST", "/retention", in_pieces).await.status(), StatusCode::OK);
    // Routes with a body, and methods that a route does not have, are none of this layer's.
    assert_eq!(answer(&router, "POST", "/jobs", "{\"mesh_id\": 1}").await.status(), StatusCode::OK);
    assert_eq!(answer(&router, "POST", "/jobs/7", "{\"a\": 1}").await.status(), StatusCode::METHOD_NOT_ALLOWED);
}

/// A refusal, or waiting for the body, would leave arm and table moving.
#[tokio::test]
async fn a_stop_is_obeyed_whatever_comes_with_it() {
    let router = router();
    let nothing_comes = Body::from_stream(stream::pending::<Result<&str, Infallible>>());
    for body in [nothing_comes, "{\"reason\": \"the door\"}".into(), " ".repeat(MAX_EMPTY_BYTES + 1).into()] {
        assert_eq!(answer(&router, "POST", "/runs/7/stop", body).await.status(), StatusCode::OK);
    }
}

#[tokio::test]
async fn no_more_of_a_body_is_read_than_could_say_nothing() {
    let router = router();
    let read = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&read);
    let endless = stream::repeat_with(move || {
        counted.fetch_add(1, Ordering::Relaxed);
        Ok::<_, Infallible>(" ")
    });
    let endless = answer(&router, "POST", "/retention", Body::from_stream(endless)).await;
    assert_eq!(error(&endless).map(|(code, _)| code), Some(Code::UnexpectedBody));
    assert_eq!(read.load(Ordering::Relaxed), MAX_EMPTY_BYTES + 1);
    let broken = Body::from_stream(stream::iter([Ok("{"), Err(std::io::Error::other("the client is gone"))]));
    let broken = answer(&router, "POST", "/retention", broken).await;
    assert_eq!(error(&broken).map(|(code, _)| code), Some(Code::BadBody));
}
