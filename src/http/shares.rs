//! Shares of what requests may hold for long: event streams, uploads and waits for a job's end. There are so many at the
//! same time in all, and so many for one client; whoever wants one more is told so at once.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::{Query, Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::client::Client;
use super::options::{Options, Quota};
use super::places::Full;
use super::problem::Problem;
use super::router::Site;

/// What there are shares of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Streams of events.
    EventStreams,
    /// Meshes that are uploaded.
    Uploads,
    /// Answers that wait for a job's end.
    Waits,
}

impl Kind {
    const ALL: [Self; 3] = [Self::EventStreams, Self::Uploads, Self::Waits];

    /// What they are called, and the settings that limit them: for one client, and in all.
    fn words(self) -> (&'static str, [&'static str; 2]) {
        match self {
            Self::EventStreams => ("event streams", ["server.max_event_streams_per_address", "server.max_event_streams"]),
            Self::Uploads => ("uploads", ["limits.uploads_at_once_per_address", "limits.uploads_at_once"]),
            Self::Waits => ("waits for a job's end", ["server.max_waits_per_address", "server.max_waits"]),
        }
    }

    fn quota(self, options: &Options) -> Quota {
        match self {
            Self::EventStreams => options.event_streams,
            Self::Uploads => options.uploads,
            Self::Waits => options.waits,
        }
    }
}

/// Who holds how many of each.
#[derive(Default)]
pub(super) struct Shares([Mutex<Held>; Kind::ALL.len()]);

#[derive(Default)]
struct Held {
    total: usize,
    by_address: HashMap<IpAddr, usize>,
}

/// One of a client's share, until it is dropped.
pub(super) struct Share {
    shares: Arc<Shares>,
    kind: Kind,
    address: IpAddr,
}

impl Shares {
    /// One for `client`.
    ///
    /// # Errors
    /// `too_many_requests` beyond the client's share, `busy` when there is none left at all.
    pub(super) fn take(self: &Arc<Self>, kind: Kind, client: Client, options: &Options) -> Result<Share, Problem> {
        let (address, quota) = (client.address, kind.quota(options));
        let mut held = self.lock(kind);
        let own = held.by_address.get(&address).copied().unwrap_or_default();
        if own >= quota.per_address {
            return Err(refused(kind, Full::Address, own, address));
        }
        if held.total >= quota.total {
            return Err(refused(kind, Full::Server, held.total, address));
        }
        held.total += 1;
        held.by_address.insert(address, own + 1);
        Ok(Share { shares: self.clone(), kind, address })
    }

    fn lock(&self, kind: Kind) -> MutexGuard<'_, Held> {
        // Counting does not break off half way.
        self.0[kind as usize].lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn refused(kind: Kind, full: Full, held: usize, address: IpAddr) -> Problem {
    let (what, [own_setting, setting]) = kind.words();
    let detail = match full {
        Full::Address => format!("{address} has {held} {what} open, which is the share of one client ({own_setting})"),
        Full::Server => format!("{held} {what} are open, which is all there may be ({setting})"),
    };
    Problem::new(full.code(), detail)
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut held = self.shares.lock(self.kind);
        held.total -= 1;
        if let Some(own) = held.by_address.get_mut(&self.address) {
            *own -= 1;
            if *own == 0 {
                held.by_address.remove(&self.address);
            }
        }
    }
}

/// Holds one of the client's uploads until the answer.
pub(super) async fn upload(State(site): State<Site>, request: Request, next: Next) -> Response {
    holding(&site, Kind::Uploads, request, next).await
}

/// Holds one of the client's waits until the answer, if the request asks to wait.
pub(super) async fn wait(State(site): State<Site>, request: Request, next: Next) -> Response {
    let asks = Query::<Vec<(String, String)>>::try_from_uri(request.uri());
    if asks.is_ok_and(|pairs| pairs.iter().any(|(name, _)| name == "wait")) {
        return holding(&site, Kind::Waits, request, next).await;
    }
    next.run(request).await
}

async fn holding(site: &Site, kind: Kind, request: Request, next: Next) -> Response {
    let (parts, body) = request.into_parts();
    let client = Client::of(&parts, &site.options.trusted_proxies);
    match site.shares.take(kind, client, &site.options) {
        Ok(_share) => next.run(Request::from_parts(parts, body)).await,
        Err(problem) => problem.into_response(),
    }
}

#[cfg(test)]
mod tests;
