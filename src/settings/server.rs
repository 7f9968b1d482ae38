//! Settings of the HTTP server and their allowed values.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Deserializer};

use super::LimitSettings;
use crate::cell::Findings;
use crate::http::{self, Quota};

/// Addresses, keys, names, limits and timeouts of the HTTP server.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServerSettings {
    /// Address and port to listen on.
    pub listen: SocketAddr,
    /// Accept requests from other machines without a key.
    pub insecure: bool,
    /// Key that everything under `/api` requires.
    pub api_key: Option<http::ApiKey>,
    /// File of further keys, each with a name; read again when it changes.
    pub api_keys_file: Option<PathBuf>,
    /// Names of the server besides its addresses and `localhost`.
    #[serde(deserialize_with = "list")]
    pub hosts: Vec<String>,
    /// Addresses and networks of proxies whose `X-Forwarded-For`, `X-Forwarded-Proto` and `X-Forwarded-Prefix` are trusted.
    #[serde(deserialize_with = "list")]
    pub trusted_proxies: Vec<http::IpNetwork>,
    /// Path prefix below which clients reach the server.
    pub public_path: String,
    /// Origins of other sites' pages that may use the API with its key.
    #[serde(deserialize_with = "list")]
    pub cors_origins: Vec<String>,
    /// Largest number of concurrent connections.
    pub max_connections: u32,
    /// Largest number of concurrent connections from one client, an IPv4 address or an IPv6 /64.
    pub max_connections_per_address: u32,
    /// Largest number of concurrent event streams.
    pub max_event_streams: u32,
    /// Largest number of concurrent event streams of one client.
    pub max_event_streams_per_address: u32,
    /// Largest number of concurrent requests that wait for a job's end.
    pub max_waits: u32,
    /// Largest number of concurrent requests of one client that wait for a job's end.
    pub max_waits_per_address: u32,
    /// Largest number of concurrent streams on one HTTP/2 connection.
    pub http2_max_streams: u32,
    /// Time within which a request's headers must arrive.
    pub header_timeout_secs: f64,
    /// Time after which a connection without a request is closed.
    pub idle_timeout_secs: f64,
    /// Time within which the next piece of a body must arrive or be taken.
    pub body_idle_timeout_secs: f64,
    /// Time within which a response must begin.
    pub request_timeout_secs: f64,
    /// Time that open requests and running jobs have to end after SIGTERM.
    pub drain_timeout_secs: f64,
}

impl ServerSettings {
    /// Options of the HTTP server.
    pub(super) fn http(&self, limits: &LimitSettings) -> http::ServerOptions {
        let quota = |total: u32, per_address: u32| Quota { total: total as usize, per_address: per_address as usize };
        http::ServerOptions {
            listen: self.listen,
            api_key: self.api_key.clone(),
            api_keys_file: self.api_keys_file.clone(),
            hosts: self.hosts.iter().map(|host| host.to_ascii_lowercase()).collect(),
            trusted_proxies: self.trusted_proxies.clone(),
            public_path: self.public_path.clone(),
            cors_origins: self.cors_origins.iter().map(|origin| origin.to_ascii_lowercase()).collect(),
            max_connections: self.max_connections as usize,
            max_connections_per_address: self.max_connections_per_address as usize,
            event_streams: quota(self.max_event_streams, self.max_event_streams_per_address),
            uploads: quota(limits.uploads_at_once, limits.uploads_at_once_per_address),
            waits: quota(self.max_waits, self.max_waits_per_address),
            http2_max_streams: self.http2_max_streams,
            header_timeout: Duration::from_secs_f64(self.header_timeout_secs),
            idle_timeout: Duration::from_secs_f64(self.idle_timeout_secs),
            body_idle_timeout: Duration::from_secs_f64(self.body_idle_timeout_secs),
            request_timeout: Duration::from_secs_f64(self.request_timeout_secs),
            max_json_bytes: usize::try_from(limits.json_bytes).unwrap_or(usize::MAX),
            download_bytes_per_sec: limits.download_bytes_per_sec,
        }
    }

    /// Adds a finding for each value that is not allowed.
    pub(super) fn check(&self, findings: &mut Findings) {
        if let Some(key) = &self.api_key {
            findings.require(key.is_valid(), "/server/api_key", || {
                "must be 16 to 256 visible ASCII characters, without ; and ,; give another, such as one of `openssl rand -hex 32`"
                    .to_owned()
            });
        }
        let keys_file = self.api_keys_file.as_ref();
        if let Some(reason) = keys_file.and_then(|file| http::check_keys_file(file, self.api_key.as_ref()).err()) {
            findings.push("/server/api_keys_file", format!("cannot be used: {reason}"));
        }
        if let Some(host) = self.hosts.iter().find(|host| !is_host_name(host)) {
            findings.push(
                "/server/hosts",
                format!("contains {host:?}, which is not a host name; give names without scheme and port"),
            );
        }
        findings.require(http::is_public_path(&self.public_path), "/server/public_path", || {
            format!(
                "is {:?}; allowed is an empty string, or a path such as \"/vantage\" of letters, digits, - . _ and ~",
                self.public_path
            )
        });
        if let Some(origin) = self.cors_origins.iter().find(|origin| !is_origin(origin)) {
            findings.push(
                "/server/cors_origins",
                format!(
                    "contains {origin:?}, which is not an origin; give scheme, host and port as in \
                     \"https://mes.plant.example:8443\""
                ),
            );
        }
        let has_keys = self.api_key.is_some() || self.api_keys_file.is_some();
        let guarded = self.listen.ip().is_loopback() || self.insecure || has_keys;
        findings.require(guarded, "/server/listen", || {
            format!(
                "is {}, which other machines can reach; set server.api_key or server.api_keys_file, or pass --insecure to accept \
                 requests without a key",
                self.listen
            )
        });
    }
}

/// Returns true for an origin as browsers send it: scheme, host and a port unless it is the scheme's own; no wildcard, no path.
fn is_origin(text: &str) -> bool {
    let lower = text.to_ascii_lowercase();
    let (default_port, rest) = match lower.split_once("://") {
        Some(("https", rest)) => ("443", rest),
        Some(("http", rest)) => ("80", rest),
        _ => return false,
    };
    // The colons of an IPv6 address stand in brackets.
    let (host, port) = match rest.rsplit_once(':') {
        Some((host, port)) if !port.ends_with(']') => (host, Some(port)),
        _ => (rest, None),
    };
    let bracketed = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
    let is_host = bracketed.map_or_else(|| is_host_name(host), |host| host.parse::<std::net::Ipv6Addr>().is_ok());
    is_host && port.is_none_or(|port| port != default_port && port.parse::<u16>().is_ok_and(|number| number.to_string() == port))
}

fn is_host_name(text: &str) -> bool {
    let plain = |c: u8| c.is_ascii_alphanumeric() || matches!(c, b'-' | b'_' | b'.');
    (1..=253).contains(&text.len()) && text.bytes().all(plain) && !text.starts_with('.') && !text.ends_with('.')
}

/// Deserialises a list of strings, each parsed for itself.
pub(super) fn list<'de, T, D>(deserializer: D) -> Result<Vec<T>, D::Error>
where
    T: std::str::FromStr<Err: std::fmt::Display>,
    D: Deserializer<'de>,
{
    let entries = Vec::<String>::deserialize(deserializer)?;
    let parse = |entry: &String| entry.parse::<T>().map_err(|reason| serde::de::Error::custom(format!("{entry:?}: {reason}")));
    entries.iter().map(parse).collect()
}
