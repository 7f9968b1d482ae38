//! Server-sent events. The id of each is its number in the store, so that a client that lost its connection sends the last
//! id it saw (`Last-Event-ID`) and resumes after it. If later events have been dropped by then, or all of an ended job's or
//! run's, the stream begins with `reset`: the client then reloads the job, the run or the list.

use std::convert::Infallible;
use std::time::{Duration, Instant};

use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::sse::{Event, KeepAlive};
use axum::response::{IntoResponse, Response, Sse};
use futures_util::stream::{self, Stream, StreamExt};

use super::auth::Admission;
use super::client::Client;
use super::problem::{ApiError, Code};
use super::quotas::{Permit, Resource};
use super::router::ApiState;
use crate::service::{EventStream, RunCursor, RunMessage, RunStream};
use crate::wire::{JobId, RunId};

/// Interval between keep-alive comments.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// Interval between two looks whether the key or session of a stream's client still holds.
const ADMISSION_LOOK: Duration = Duration::from_secs(2);
/// Time that a client should wait before it reconnects.
const RETRY: Duration = Duration::from_secs(3);

/// Streams the events of one job, or of all jobs. The stream holds one of the client's permits until it ends.
pub(super) async fn event_stream(
    state: &ApiState,
    client: Client,
    job: Option<JobId>,
    headers: &HeaderMap,
) -> Result<Response, ApiError> {
    let last = last_event_id(headers)?;
    let permit = state.quotas.acquire(Resource::EventStreams, client, &state.options)?;
    let events = state.app.events(job, last).await?;
    if events.is_over() {
        // 204 tells a browser not to reconnect.
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let first = opening(events.has_gap(), events.only_gap().map(|id| id.to_string()));
    let stream = stream::iter(first).map(Ok::<_, Infallible>).chain(sse_events(events, permit));
    let stream = stream.take_until(Box::pin(revoked(state.clone(), Admission::of(state, headers))));
    let mut response = Sse::new(stream).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)).into_response();
    response.headers_mut().insert("x-accel-buffering", HeaderValue::from_static("no"));
    Ok(response)
}

/// First messages of a stream: when to come back, and the gap if there is one. `only_gap` is the id of a gap after which nothing
/// follows: whoever comes back with it is told not to.
fn opening(has_gap: bool, only_gap: Option<String>) -> Vec<Event> {
    let mut first = vec![Event::default().retry(RETRY)];
    if has_gap {
        let reset = Event::default().event("reset").data("{}");
        first.push(match only_gap {
            Some(id) => reset.id(id),
            None => reset,
        });
    }
    first
}

/// Ends when the key or session with which a stream was begun holds no more.
async fn revoked(state: ApiState, admission: Option<Admission>) {
    let Some(admission) = admission else { return std::future::pending().await };
    while admission.holds(&state, Instant::now()) {
        tokio::time::sleep(ADMISSION_LOOK).await;
    }
}

fn sse_events(events: EventStream, permit: Permit) -> impl Stream<Item = Result<Event, Infallible>> {
    stream::unfold((events, permit), |(mut events, permit)| async move {
        match events.next().await {
            Ok(Some(event)) => {
                let data = serde_json::to_string(&*event).unwrap_or_default();
                let sse = Event::default().id(event.id.to_string()).event(event.kind.as_str()).data(data);
                Some((Ok(sse), (events, permit)))
            }
            Ok(None) => None,
            Err(error) => {
                // The client reconnects with the last id it saw.
                tracing::warn!(error = &error as &dyn std::error::Error, "an event stream ended early");
                None
            }
        }
    })
}

/// Streams the events of a run, and its measured state. The stream holds one of the client's permits until it ends.
pub(super) async fn run_event_stream(
    state: &ApiState,
    client: Client,
    run: RunId,
    headers: &HeaderMap,
) -> Result<Response, ApiError> {
    let refused = |_| ApiError::header(Code::BadRequest, "Last-Event-ID", "is not the id of an event of a run");
    let last = headers.get("last-event-id").map(|value| value.to_str().unwrap_or_default().parse::<RunCursor>());
    let last = last.transpose().map_err(refused)?;
    let permit = state.quotas.acquire(Resource::EventStreams, client, &state.options)?;
    let events = state.app.run_events(run, last).await?;
    if events.is_over() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let first = opening(events.has_gap(), events.only_gap().map(|place| place.to_string()));
    let stream = stream::iter(first).map(Ok::<_, Infallible>).chain(sse_run_events(events, permit));
    let stream = stream.take_until(Box::pin(revoked(state.clone(), Admission::of(state, headers))));
    let mut response = Sse::new(stream).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)).into_response();
    response.headers_mut().insert("x-accel-buffering", HeaderValue::from_static("no"));
    Ok(response)
}

fn sse_run_events(events: RunStream, permit: Permit) -> impl Stream<Item = Result<Event, Infallible>> {
    stream::unfold((events, permit), |(mut events, permit)| async move {
        match events.next().await {
            Ok(Some(message)) => {
                let (kind, data, cursor) = match &message {
                    RunMessage::Event(event, cursor) => (event.kind.as_str(), serde_json::to_string(&**event), cursor),
                    RunMessage::Sample(sample, cursor) => ("live", serde_json::to_string(&**sample), cursor),
                };
                let sse = Event::default().id(cursor.to_string()).event(kind).data(data.unwrap_or_default());
                Some((Ok(sse), (events, permit)))
            }
            Ok(None) => None,
            Err(error) => {
                // The client reconnects with the last id it saw.
                tracing::warn!(error = &error as &dyn std::error::Error, "an event stream of a run ended early");
                None
            }
        }
    })
}

fn last_event_id(headers: &HeaderMap) -> Result<Option<i64>, ApiError> {
    let Some(value) = headers.get("last-event-id") else { return Ok(None) };
    let id = value.to_str().ok().and_then(|text| text.parse::<i64>().ok()).filter(|id| *id >= 0);
    let refused = || ApiError::header(Code::BadRequest, "Last-Event-ID", "is not the id of an event");
    id.map(Some).ok_or_else(refused)
}
