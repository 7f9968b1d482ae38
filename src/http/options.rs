//! Options of the HTTP server.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use super::auth::ApiKey;
use super::network::IpNetwork;

/// Addresses, keys, limits and timeouts of the HTTP server.
#[derive(Clone, Debug)]
pub struct ServerOptions {
    /// Address and port to listen on.
    pub listen: SocketAddr,
    /// Key that `/api` requires as a bearer token; without it and a file of keys there is no authentication.
    pub api_key: Option<ApiKey>,
    /// File of further keys, each with a name.
    pub api_keys_file: Option<PathBuf>,
    /// Names of the server besides its addresses and `localhost`, in lower case. Empty with a key: any name.
    pub hosts: Vec<String>,
    /// Addresses and networks of proxies whose `X-Forwarded-For`, `X-Forwarded-Host`, `X-Forwarded-Proto` and `X-Forwarded-Prefix` are
    /// trusted.
    pub trusted_proxies: Vec<IpNetwork>,
    /// Path prefix below which clients reach the server, unless a trusted proxy sends another; empty for none.
    pub public_path: String,
    /// Origins of other sites' pages that may use the API with its key, in lower case.
    pub cors_origins: Vec<String>,
    /// Largest number of concurrent connections.
    pub max_connections: usize,
    /// Largest number of concurrent connections from one client, an IPv4 address or an IPv6 /64, that is not a trusted proxy.
    pub max_connections_per_address: usize,
    /// Limits of concurrent event streams.
    pub event_streams: Quota,
    /// Limits of concurrent uploads.
    pub uploads: Quota,
    /// Limits of concurrent requests that wait for a job's end.
    pub waits: Quota,
    /// Largest number of concurrent streams on one HTTP/2 connection.
    pub http2_max_streams: u32,
    /// Time within which all headers of a request must arrive.
    pub header_timeout: Duration,
    /// Time after which a connection without a request is closed.
    pub idle_timeout: Duration,
    /// Time within which the next piece of a request body must arrive and the next piece of a response must be taken.
    pub body_idle_timeout: Duration,
    /// Time within which a response that waits for nothing must begin.
    pub request_timeout: Duration,
    /// Largest JSON body, bytes.
    pub max_json_bytes: usize,
    /// Rate of all downloads together.
    pub download_bytes_per_sec: u64,
}

/// Limits of one kind of resource in concurrent use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quota {
    /// All clients together.
    pub total: usize,
    /// One client: an IPv4 address, or an IPv6 /64.
    pub per_address: usize,
}

impl ServerOptions {
    /// Returns true if everything under `/api` requires a key.
    #[must_use]
    pub fn requires_key(&self) -> bool {
        self.api_key.is_some() || self.api_keys_file.is_some()
    }
}

#[cfg(test)]
impl ServerOptions {
    /// Options for unit tests.
    pub(super) fn for_tests() -> Self {
        let quota = Quota { total: 16, per_address: 16 };
        let long = Duration::from_secs(60);
        Self {
            listen: ([127, 0, 0, 1], 0).into(),
            api_key: None,
            api_keys_file: None,
            hosts: Vec::new(),
            trusted_proxies: Vec::new(),
            public_path: String::new(),
            cors_origins: Vec::new(),
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
            download_bytes_per_sec: 1_000_000_000,
        }
    }
}
