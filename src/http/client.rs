//! The client of a request: the address at the other end of the connection or, if that is a trusted proxy, the address on
//! whose behalf the proxy says it asks.

use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName};

use super::network::IpNetwork;
use super::router::ApiState;

/// The address at the other end of the connection.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peer(pub IpAddr);

/// The client that a request comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Client {
    /// Address whose quotas the request counts towards.
    pub address: IpAddr,
    /// True if the client reached the trusted proxy over TLS.
    pub is_https: bool,
}

const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");
const FORWARDED_HOST: HeaderName = HeaderName::from_static("x-forwarded-host");
const FORWARDED_PROTO: HeaderName = HeaderName::from_static("x-forwarded-proto");
const FORWARDED_PREFIX: HeaderName = HeaderName::from_static("x-forwarded-prefix");

impl Client {
    /// Determines the client of a request. Requests without a connection, as in tests, share one client.
    pub(super) fn from_parts(parts: &Parts, trusted_proxies: &[IpNetwork]) -> Self {
        let peer = peer(parts);
        if !is_trusted(peer, trusted_proxies) {
            return Self { address: peer, is_https: false };
        }
        let is_https = entries(&parts.headers, &FORWARDED_PROTO).next_back().is_some_and(|p| p.eq_ignore_ascii_case("https"));
        Self { address: behind(peer, &parts.headers, trusted_proxies), is_https }
    }
}

impl FromRequestParts<ApiState> for Client {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, state: &ApiState) -> Result<Self, Infallible> {
        Ok(Self::from_parts(parts, &state.options.trusted_proxies))
    }
}

/// Returns true if the address is that of a trusted proxy.
fn is_trusted(address: IpAddr, trusted_proxies: &[IpNetwork]) -> bool {
    trusted_proxies.iter().any(|network| network.contains(address))
}

/// Address at the other end of a request's connection; unspecified without a connection, as in tests.
fn peer(parts: &Parts) -> IpAddr {
    parts.extensions.get::<Peer>().map_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED), |peer| peer.0)
}

/// Entries of `X-Forwarded-Prefix`; none unless a trusted proxy sent them.
pub(super) fn forwarded_prefixes<'a>(parts: &'a Parts, trusted_proxies: &[IpNetwork]) -> impl Iterator<Item = &'a str> + use<'a> {
    let is_trusted = is_trusted(peer(parts), trusted_proxies);
    entries(&parts.headers, &FORWARDED_PREFIX).filter(move |_| is_trusted)
}

/// Host that the nearest proxy was asked for, with its port if the proxy says it; none unless a trusted proxy sent it.
pub(super) fn forwarded_host<'a>(parts: &'a Parts, trusted_proxies: &[IpNetwork]) -> Option<&'a str> {
    let is_trusted = is_trusted(peer(parts), trusted_proxies);
    entries(&parts.headers, &FORWARDED_HOST).next_back().filter(|_| is_trusted)
}

/// The last address in `X-Forwarded-For` that is not a trusted proxy. Each proxy appends the address it was asked by, so
/// the entries before that one come from the client and may be anything.
fn behind(peer: IpAddr, headers: &HeaderMap, trusted_proxies: &[IpNetwork]) -> IpAddr {
    let mut nearest = peer;
    for entry in entries(headers, &FORWARDED_FOR).rev() {
        let Some(address) = address(entry) else { return nearest };
        nearest = address;
        if !is_trusted(address, trusted_proxies) {
            return address;
        }
    }
    nearest
}

/// Entries of a list that may be spread over several headers.
fn entries<'a>(headers: &'a HeaderMap, name: &HeaderName) -> impl DoubleEndedIterator<Item = &'a str> + use<'a> {
    let lists = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    lists.flat_map(|list| list.split(',')).map(str::trim).filter(|entry| !entry.is_empty())
}

/// Parses an address, with or without a port.
fn address(text: &str) -> Option<IpAddr> {
    let plain = text.trim_start_matches('[').trim_end_matches(']');
    let address = plain.parse().ok().or_else(|| text.parse().ok().map(|with_port: SocketAddr| with_port.ip()));
    address.map(canonical)
}

/// Undoes the IPv6 mapping of IPv4 addresses that dual-stack sockets show.
pub(super) fn canonical(address: IpAddr) -> IpAddr {
    address.to_canonical()
}

#[cfg(test)]
mod tests;
