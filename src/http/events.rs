//! Events as server-sent events. The id of each is its number in the store, so that a client that was cut off says the
//! last one it saw (`Last-Event-ID`) and gets what came after. When some of that has been dropped by then, the first
//! event is `reset`: the client reads the job or the list anew.

use std::convert::Infallible;
use std::time::Duration;

use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::sse::{Event, KeepAlive};
use axum::response::{IntoResponse, Response, Sse};
use futures_util::stream::{self, Stream, StreamExt};

use super::client::Client;
use super::problem::{Code, Problem};
use super::router::Site;
use super::shares::{Kind, Share};
use crate::service::EventStream;
use crate::wire::JobId;

/// A sign of life this often.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// How long a client should wait before it comes back.
const RETRY: Duration = Duration::from_secs(3);

/// The stream of a job's events, or of all. It is one of the client's share until it ends.
pub(super) async fn answer(site: &Site, client: Client, job: Option<JobId>, headers: &HeaderMap) -> Result<Response, Problem> {
    let last = last_event_id(headers)?;
    let share = site.shares.take(Kind::EventStreams, client, &site.options)?;
    let events = site.app.events(job, last).await?;
    if events.is_over().await? {
        // This is what tells a browser not to come back.
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let mut first = vec![Event::default().retry(RETRY)];
    if events.missed_some() {
        first.push(Event::default().event("reset").data("{}"));
    }
    let stream = stream::iter(first).map(Ok::<_, Infallible>).chain(told(events, share));
    let mut response = Sse::new(stream).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)).into_response();
    response.headers_mut().insert("x-accel-buffering", HeaderValue::from_static("no"));
    Ok(response)
}

fn told(events: EventStream, share: Share) -> impl Stream<Item = Result<Event, Infallible>> {
    stream::unfold((events, share), |(mut events, share)| async move {
        match events.next().await {
            Ok(Some(event)) => {
                let data = serde_json::to_string(&*event).unwrap_or_default();
                let told = Event::default().id(event.id.to_string()).event(event.kind.as_str()).data(data);
                Some((Ok(told), (events, share)))
            }
            Ok(None) => None,
            Err(error) => {
                // The client comes back with the last id it saw.
                tracing::warn!(error = &error as &dyn std::error::Error, "a stream of events ends early");
                None
            }
        }
    })
}

fn last_event_id(headers: &HeaderMap) -> Result<Option<i64>, Problem> {
    let Some(value) = headers.get("last-event-id") else { return Ok(None) };
    let id = value.to_str().ok().and_then(|text| text.parse::<i64>().ok()).filter(|id| *id >= 0);
    let refused = || Problem::at(Code::BadRequest, "Last-Event-ID", "is not the id of an event");
    id.map(Some).ok_or_else(refused)
}
