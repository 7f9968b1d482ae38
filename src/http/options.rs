//! What the HTTP side has to be told.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use super::auth::ApiKey;

/// Addresses, keys, sizes, numbers and times of the HTTP side.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where to listen.
    pub listen: SocketAddr,
    /// The key that `/api` asks for as a bearer token; without one nobody is asked.
    pub api_key: Option<ApiKey>,
    /// Names of the server beside its addresses and `localhost`, in lower case. Empty with a key: any name.
    pub hosts: Vec<String>,
    /// Proxies whose `X-Forwarded-For` and `X-Forwarded-Proto` are believed.
    pub trusted_proxies: Vec<IpAddr>,
    /// Connections at the same time.
    pub max_connections: usize,
    /// Connections at the same time from one address that is not a trusted proxy.
    pub max_connections_per_address: usize,
    /// Event streams at the same time.
    pub event_streams: Quota,
    /// Uploads at the same time.
    pub uploads: Quota,
    /// Answers that wait for a job's end at the same time.
    pub waits: Quota,
    /// Streams at the same time on one HTTP/2 connection.
    pub http2_max_streams: u32,
    /// The whole of a request's headers has to come within this time.
    pub header_timeout: Duration,
    /// A connection without a request is closed after this time.
    pub idle_timeout: Duration,
    /// The next piece of a request's body has to come, and the next piece of an answer be taken, within this time.
    pub body_idle_timeout: Duration,
    /// An answer that needs no waiting has to begin within this time.
    pub request_timeout: Duration,
    /// Largest JSON body.
    pub max_json_bytes: usize,
}

/// How many of a kind there may be at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quota {
    /// In all.
    pub total: usize,
    /// Of one client.
    pub per_address: usize,
}

#[cfg(test)]
impl Options {
    /// What unit tests begin with.
    pub(super) fn for_tests() -> Self {
        let quota = Quota { total: 16, per_address: 16 };
        let long = Duration::from_secs(60);
        Self {
            listen: ([127, 0, 0, 1], 0).into(),
            api_key: None,
            hosts: Vec::new(),
            trusted_proxies: Vec::new(),
            max_connections: 16,
            max_connections_per_address: 16,
            event_streams: quota,
            uploads: quota,
            waits: quota,
            http2_max_streams: 16,
            header_timeout: long,
            idle_timeout: long,
            body_idle_timeout: long,
            request_timeout: long,
            max_json_bytes: 1024,
        }
    }
}
