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
    /// Address that the request comes from; its quotas are those of the network that [`counted_as`] gives.
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
        let protocol = entries(&parts.headers, &FORWARDED_PROTO).next_back().flatten();
        let is_https = protocol.is_some_and(|protocol| protocol.eq_ignore_ascii_case("https"));
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

/// Network whose addresses count as one client where something is limited per client. A trusted proxy counts by its address
/// alone: what it needs for all who ask through it is not the share of its neighbours.
pub(super) fn counted_as(address: IpAddr, trusted_proxies: &[IpNetwork]) -> IpNetwork {
    if is_trusted(address, trusted_proxies) { address.into() } else { IpNetwork::of_client(address) }
}

/// Address at the other end of a request's connection; unspecified without a connection, as in tests.
fn peer(parts: &Parts) -> IpAddr {
    parts.extensions.get::<Peer>().map_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED), |peer| peer.0)
}

/// Entries of `X-Forwarded-Prefix`, `None` for one that cannot be read; none unless a trusted proxy sent them.
pub(super) fn forwarded_prefixes<'a>(
    parts: &'a Parts,
    trusted_proxies: &[IpNetwork],
) -> impl Iterator<Item = Option<&'a str>> + use<'a> {
    let is_trusted = is_trusted(peer(parts), trusted_proxies);
    entries(&parts.headers, &FORWARDED_PREFIX).filter(move |_| is_trusted)
}

/// Host that the nearest proxy was asked for, with its port if the proxy says it; none unless a trusted proxy sent it.
pub(super) fn forwarded_host<'a>(parts: &'a Parts, trusted_proxies: &[IpNetwork]) -> Option<&'a str> {
    let is_trusted = is_trusted(peer(parts), trusted_proxies);
    entries(&parts.headers, &FORWARDED_HOST).next_back().flatten().filter(|_| is_trusted)
}

/// Address of the client behind the trusted proxies, of which `peer` is the nearest. Each proxy appends to `X-Forwarded-For` the
/// address that asked it, so the list is read from its end: an entry is believed if `peer` and all entries after it are trusted
/// proxies. The first that is believed and is no trusted proxy is the client; entries before it come from the client and may be
/// anything.
///
/// An entry that is no address (`unknown`, a name, text that is not ASCII) keeps its place. If it is the next to be believed, the
/// client is not known, and the request counts as one of the proxy that wrote it, the last address that was believed: entries
/// before it may be the client's own. It hides no entry after it, on its line or on another.
fn behind(peer: IpAddr, headers: &HeaderMap, trusted_proxies: &[IpNetwork]) -> IpAddr {
    let mut nearest = peer;
    for entry in entries(headers, &FORWARDED_FOR).rev() {
        let Some(address) = entry.and_then(address) else { return nearest };
        nearest = address;
        if !is_trusted(address, trusted_proxies) {
            return address;
        }
    }
    nearest
}

/// Entries of a list that may be spread over several headers; `None` for one that is not ASCII text, which keeps its place. Empty
/// elements do not count (RFC 9110, section 5.6.1.2).
fn entries<'a>(headers: &'a HeaderMap, name: &HeaderName) -> impl DoubleEndedIterator<Item = Option<&'a str>> + use<'a> {
    let lists = headers.get_all(name).iter();
    let elements = lists.flat_map(|list| list.as_bytes().split(|byte| *byte == b',')).map(<[u8]>::trim_ascii);
    elements.filter(|element| !element.is_empty()).map(ascii_text)
}

/// The text of bytes that are ASCII.
fn ascii_text(bytes: &[u8]) -> Option<&str> {
    str::from_utf8(bytes).ok().filter(|text| text.is_ascii())
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
