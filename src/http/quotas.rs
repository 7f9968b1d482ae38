//! Quotas of the resources that requests hold for long: event streams, uploads and waits for a job's end. Their number is
//! limited for all clients together and for one client, an IPv4 address or an IPv6 /64; a request beyond a limit is refused at
//! once.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::{Query, Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::client::{Client, counted_as};
use super::connection_limiter::ExceededLimit;
use super::network::IpNetwork;
use super::options::{Quota, ServerOptions};
use super::problem::ApiError;
use super::router::ApiState;

/// Resource that requests hold for long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Resource {
    /// Event streams.
    EventStreams,
    /// Uploads of meshes.
    Uploads,
    /// Requests that wait for a job's end.
    Waits,
}

impl Resource {
    const ALL: [Self; 3] = [Self::EventStreams, Self::Uploads, Self::Waits];

    /// Name in error messages, and the settings that limit it: for one client, and for all.
    fn labels(self) -> (&'static str, [&'static str; 2]) {
        match self {
            Self::EventStreams => ("event streams", ["server.max_event_streams_per_address", "server.max_event_streams"]),
            Self::Uploads => ("uploads", ["limits.uploads_at_once_per_address", "limits.uploads_at_once"]),
            Self::Waits => ("waits for a job's end", ["server.max_waits_per_address", "server.max_waits"]),
        }
    }

    fn quota(self, options: &ServerOptions) -> Quota {
        match self {
            Self::EventStreams => options.event_streams,
            Self::Uploads => options.uploads,
            Self::Waits => options.waits,
        }
    }
}

/// Usage of each resource, checked against its quota.
#[derive(Default)]
pub(super) struct Quotas([Mutex<Usage>; Resource::ALL.len()]);

/// Usage of one resource.
#[derive(Default)]
struct Usage {
    total: usize,
    by_client: HashMap<IpNetwork, usize>,
}

/// Permit for one use of a resource, given back when dropped.
pub(super) struct Permit {
    quotas: Arc<Quotas>,
    resource: Resource,
    client: IpNetwork,
}

impl Quotas {
    /// Acquires a permit for `client`.
    ///
    /// # Errors
    /// `too_many_requests` at the client's limit, `busy` at the limit of all clients.
    pub(super) fn acquire(
        self: &Arc<Self>,
        resource: Resource,
        client: Client,
        options: &ServerOptions,
    ) -> Result<Permit, ApiError> {
        let (client, quota) = (counted_as(client.address, &options.trusted_proxies), resource.quota(options));
        let mut usage = self.lock(resource);
        let own = usage.by_client.get(&client).copied().unwrap_or_default();
        if own >= quota.per_address {
            return Err(refused(resource, ExceededLimit::Address, own, client));
        }
        if usage.total >= quota.total {
            return Err(refused(resource, ExceededLimit::Server, usage.total, client));
        }
        usage.total += 1;
        usage.by_client.insert(client, own + 1);
        Ok(Permit { quotas: self.clone(), resource, client })
    }

    fn lock(&self, resource: Resource) -> MutexGuard<'_, Usage> {
        // No operation leaves the counts half changed.
        self.0[resource as usize].lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn refused(resource: Resource, limit: ExceededLimit, count: usize, client: IpNetwork) -> ApiError {
    let (name, [own_setting, setting]) = resource.labels();
    let detail = match limit {
        ExceededLimit::Address => format!("{client} has {count} {name} open, the maximum for one client ({own_setting})"),
        ExceededLimit::Server => format!("{count} {name} are open, the maximum for all clients ({setting})"),
    };
    ApiError::new(limit.code(), detail)
}

impl Drop for Permit {
    fn drop(&mut self) {
        let mut usage = self.quotas.lock(self.resource);
        usage.total -= 1;
        if let Some(own) = usage.by_client.get_mut(&self.client) {
            *own -= 1;
            if *own == 0 {
                usage.by_client.remove(&self.client);
            }
        }
    }
}

/// Holds an upload permit until the response.
pub(super) async fn limit_uploads(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    with_permit(&state, Resource::Uploads, request, next).await
}

/// Holds a wait permit until the response, if the request asks to wait.
pub(super) async fn limit_waits(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    let query = Query::<Vec<(String, String)>>::try_from_uri(request.uri());
    if query.is_ok_and(|pairs| pairs.iter().any(|(name, _)| name == "wait")) {
        return with_permit(&state, Resource::Waits, request, next).await;
    }
    next.run(request).await
}

async fn with_permit(state: &ApiState, resource: Resource, request: Request, next: Next) -> Response {
    let (parts, body) = request.into_parts();
    let client = Client::from_parts(&parts, &state.options.trusted_proxies);
    match state.quotas.acquire(resource, client, &state.options) {
        Ok(_permit) => next.run(Request::from_parts(parts, body)).await,
        Err(error) => error.into_response(),
    }
}

#[cfg(test)]
mod tests;
