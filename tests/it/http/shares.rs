//! Shares of what requests may hold for long: whoever wants more than the own one is told at once, and others are not
//! touched by it.

use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::Request;
use axum::response::Response;

use super::api::{Answer, Api, cube};

/// The clients behind the proxy that the in-process requests come from.
const ONE: &str = "10.0.0.1";
const OTHER: &str = "10.0.0.2";

fn request(method: &str, path: &str, client: &str, body: Body) -> Request<Body> {
    Request::builder().method(method).uri(path).header("x-forwarded-for", client).body(body).expect("a request")
}

async fn refused(response: Response, code: &str) {
    let answer = Answer::read(response).await;
    answer.problem(code);
    assert_eq!(answer.header("retry-after"), "5");
}

#[tokio::test]
async fn event_streams_are_shared_fairly() {
    let api = Api::start().await;
    let open = |client| api.raw(request("GET", "/api/v1/events", client, Body::empty()));
    let mut streams = Vec::new();
    for _ in 0..3 {
        streams.push(open(ONE).await);
    }
    assert!(streams.iter().all(|stream| stream.status() == 200));
    refused(open(ONE).await, "too_many_requests").await;
    let fourth = open(OTHER).await;
    assert_eq!(fourth.status(), 200);
    refused(open(OTHER).await, "busy").await;
    drop(streams);
    assert_eq!(open(OTHER).await.status(), 200);
}

#[tokio::test]
async fn uploads_are_shared_fairly() {
    let api = std::sync::Arc::new(Api::start().await);
    let path = "/api/v1/meshes?unit=mm";
    let mut slow = Vec::new();
    for client in [ONE, ONE, ONE] {
        let api = api.clone();
        let nothing_comes = Body::from_stream(futures_util::stream::pending::<Result<String, std::io::Error>>());
        slow.push(tokio::spawn(async move { api.raw(request("POST", path, client, nothing_comes)).await.status() }));
    }
    tokio::time::sleep(Duration::from_millis(100)).await;
    let began = Instant::now();
    refused(api.raw(request("POST", path, ONE, cube(10.0).into())).await, "too_many_requests").await;
    assert!(began.elapsed() < Duration::from_millis(200), "{:?}", began.elapsed());
    assert_eq!(api.raw(request("POST", path, OTHER, cube(10.0).into())).await.status(), 201);
    for upload in slow {
        assert_eq!(upload.await.expect("an answer"), 408);
    }
    assert_eq!(api.raw(request("POST", path, ONE, cube(10.0).into())).await.status(), 201);
}

#[tokio::test]
async fn waits_are_shared_fairly_and_looking_is_not_waiting() {
    let api = std::sync::Arc::new(Api::start().await);
    let job = api.job("wait").await;
    let (waiting, looking) = (format!("/api/v1/jobs/{job}?w%61it=1"), format!("/api/v1/jobs/{job}"));
    let wait = |client| {
        let (api, path) = (api.clone(), waiting.clone());
        tokio::spawn(async move { api.raw(request("GET", &path, client, Body::empty())).await })
    };
    let open = [wait(ONE), wait(ONE), wait(ONE)];
    tokio::time::sleep(Duration::from_millis(200)).await;
    refused(wait(ONE).await.expect("an answer"), "too_many_requests").await;
    assert_eq!(api.raw(request("GET", &looking, ONE, Body::empty())).await.status(), 200);
    let fourth = wait(OTHER);
    tokio::time::sleep(Duration::from_millis(200)).await;
    refused(wait(OTHER).await.expect("an answer"), "busy").await;
    for open in open.into_iter().chain([fourth]) {
        assert_eq!(open.await.expect("an answer").status(), 200);
    }
}
