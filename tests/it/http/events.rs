//! Events as they come, and again from the one that was seen last.

use std::time::Duration;

use axum::body::{Body, BodyDataStream};
use axum::http::Request;
use futures_util::StreamExt;
use serde_json::{Value, json};
use sqlx::Connection as _;

use super::api::Api;

/// A stream of server-sent events being read.
pub(super) struct Listener {
    body: BodyDataStream,
    text: String,
}

#[derive(Debug)]
pub(super) struct Told {
    id: i64,
    /// The id as it was sent: that of a run's event has a part for samples.
    pub(super) place: String,
    pub(super) kind: String,
    pub(super) data: Value,
}

impl Listener {
    pub(super) async fn open(api: &Api, path: &str, last: Option<impl ToString>) -> Self {
        let mut request = Request::get(path);
        if let Some(last) = last {
            request = request.header("last-event-id", last.to_string());
        }
        let response = api.raw(request.body(Body::empty()).expect("a request")).await;
        assert_eq!(response.status(), 200);
        assert_eq!(response.headers()["content-type"], "text/event-stream");
        let mut listener = Self { body: response.into_body().into_data_stream(), text: String::new() };
        assert_eq!(listener.block().await.as_deref(), Some("retry: 3000"));
        listener
    }

    /// The next block of lines; `None` at the end of the stream.
    async fn block(&mut self) -> Option<String> {
        loop {
            if let Some((block, rest)) = self.text.split_once("\n\n") {
                let (block, rest) = (block.to_owned(), rest.to_owned());
                self.text = rest;
                return Some(block);
            }
            let piece = tokio::time::timeout(Duration::from_secs(20), self.body.next()).await.expect("something comes");
            self.text += std::str::from_utf8(&piece?.expect("a piece")).expect("text");
        }
    }

    pub(super) async fn next(&mut self) -> Option<Told> {
        let block = self.block().await?;
        let field = |name: &str| block.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_default().trim().to_owned();
        let data = serde_json::from_str(&field("data:")).expect("JSON");
        let place = field("id:");
        Some(Told { id: place.parse().unwrap_or(-1), place, kind: field("event:"), data })
    }

    pub(super) async fn rest(mut self) -> Vec<Told> {
        let mut told = Vec::new();
        while let Some(event) = self.next().await {
            told.push(event);
        }
        told
    }
}

#[tokio::test]
async fn a_job_is_followed_to_its_end() {
    let api = Api::start().await;
    let job = api.job("").await;
    let told = Listener::open(&api, &format!("/api/v1/jobs/{job}/events"), None::<i64>).await.rest().await;
    let kinds: Vec<&str> = told.iter().map(|event| event.kind.as_str()).collect();
    assert_eq!(kinds, ["queued", "started", "progress", "progress", "succeeded"]);
    for event in &told {
        assert_eq!(event.data["id"], event.id);
        assert_eq!(event.data["job_id"], job);
        assert_eq!(event.data["kind"], event.kind);
    }
    assert_eq!((&told[2].data["stage"], &told[3].data["stage"]), (&json!("surface"), &json!("visibility")));
    assert!(told.windows(2).all(|pair| pair[0].id < pair[1].id));
    assert!(told.windows(2).all(|pair| pair[0].data["fraction"].as_f64() <= pair[1].data["fraction"].as_f64()));
}

#[tokio::test]
async fn whoever_comes_back_gets_what_was_missed() {
    let api = Api::start().await;
    let job = api.job("").await;
    let path = format!("/api/v1/jobs/{job}/events");
    let all: Vec<i64> = Listener::open(&api, &path, None::<i64>).await.rest().await.iter().map(|event| event.id).collect();
    for (seen, last) in all.iter().enumerate().take(all.len() - 1) {
        let again: Vec<i64> = Listener::open(&api, &path, Some(*last)).await.rest().await.iter().map(|event| event.id).collect();
        assert_eq!(again, all[seen + 1..]);
    }
    // All was seen and nothing will come: do not come back.
    let over = api.send("GET", &path, &[("last-event-id", &all[all.len() - 1].to_string())], "").await;
    assert_eq!(over.status, 204);
}

/// The answer was 204 without an event: whoever came late did not learn how the job had ended.
#[tokio::test]
async fn an_ended_job_without_events_is_told_to_be_read_and_not_to_be_followed_again() {
    let api = Api::start().await;
    let job = api.job("").await;
    api.ended(&job).await;
    let database = format!("sqlite://{}", api.app.data_dir().join("vantage.db").display());
    let options: sqlx::sqlite::SqliteConnectOptions = database.parse().expect("a path");
    let mut connection = sqlx::SqliteConnection::connect_with(&options).await.expect("the database");
    // As they are pruned once they are old.
    sqlx::query("DELETE FROM event").execute(&mut connection).await.expect("deleted");
    let path = format!("/api/v1/jobs/{job}/events");
    let told = Listener::open(&api, &path, None::<i64>).await.rest().await;
    let kinds: Vec<&str> = told.iter().map(|event| event.kind.as_str()).collect();
    assert_eq!(kinds, ["reset"]);
    // A browser reconnects with the id of that, and is told to stop.
    let again = api.send("GET", &path, &[("last-event-id", &told[0].place)], "").await;
    assert_eq!(again.status, 204);
}

#[tokio::test]
async fn a_listener_hears_past_and_present_once_and_in_order() {
    let api = Api::start().await;
    let job = api.job("wait").await;
    let mut listener = Listener::open(&api, &format!("/api/v1/jobs/{job}/events"), None::<i64>).await;
    let past = [listener.next().await, listener.next().await, listener.next().await];
    assert_eq!(past.map(|event| event.expect("the past").kind), ["queued", "started", "progress"]);
    api.post_json(&format!("/api/v1/jobs/{job}/cancel"), &json!(null)).await.ok(202);
    let told = listener.rest().await;
    let kinds: Vec<&str> = told.iter().map(|event| event.kind.as_str()).collect();
    assert_eq!(kinds, ["cancelling", "cancelled"]);
}

#[tokio::test]
async fn all_jobs_are_followed_from_now_on_or_from_an_event() {
    let api = Api::start().await;
    let before = api.job("").await;
    api.ended(&before).await;
    let mut live = Listener::open(&api, "/api/v1/events", None::<i64>).await;
    let mut replayed = Listener::open(&api, "/api/v1/events", Some(0)).await;
    let after = api.job("no_plan").await;
    assert_eq!(live.next().await.expect("an event").data["job_id"], after);
    let mut jobs = Vec::new();
    loop {
        let event = replayed.next().await.expect("an event");
        jobs.push((event.data["job_id"].as_str().expect("an id").to_owned(), event.id));
        if event.kind == "failed" {
            assert_eq!(event.data["code"], "no_plan");
            break;
        }
    }
    assert!(jobs.iter().enumerate().all(|(index, (_, id))| *id == index as i64 + 1), "{jobs:?}");
    assert!(jobs.iter().any(|(job, _)| *job == before) && jobs.iter().any(|(job, _)| *job == after));
}

#[tokio::test]
async fn what_is_no_event_is_refused() {
    let api = Api::start().await;
    for id in ["", "x", "-1", "1.5", "99999999999999999999", "1; DROP TABLE event"] {
        api.send("GET", "/api/v1/events", &[("last-event-id", id)], "").await.problem_at("bad_request", &["Last-Event-ID"]);
    }
    let nobody = "01a1f77c-78a1-7554-855a-a9513c22aa2b";
    api.get(&format!("/api/v1/jobs/{nobody}/events")).await.problem("job_not_found");
}

#[tokio::test]
async fn streams_end_when_the_server_stops() {
    let api = Api::start().await;
    let listener = Listener::open(&api, "/api/v1/events", None::<i64>).await;
    api.app.stop().await;
    assert!(listener.rest().await.is_empty());
}
