//! What the HTTP side has to be told.

use std::net::SocketAddr;
use std::time::Duration;

use super::auth::ApiKey;

/// Addresses, keys, sizes and times of the HTTP side.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where to listen.
    pub listen: SocketAddr,
    /// The key that `/api` asks for as a bearer token; without one nobody is asked.
    pub api_key: Option<ApiKey>,
    /// Connections at the same time.
    pub max_connections: usize,
    /// Streams at the same time on one HTTP/2 connection.
    pub http2_max_streams: u32,
    /// The whole of a request's headers has to come within this time.
    pub header_timeout: Duration,
    /// The next piece of a request's body has to come, and the next piece of an answer be taken, within this time.
    pub body_idle_timeout: Duration,
    /// An answer that needs no waiting has to begin within this time.
    pub request_timeout: Duration,
    /// Open requests have this long to end once the server stops.
    pub drain_timeout: Duration,
    /// Largest JSON body.
    pub max_json_bytes: usize,
}
