//! Who asks: the address at the other end of the connection, or, when that is a proxy which the settings trust, the one
//! that the proxy says it asks for.

use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName};

use super::router::Site;

/// The address at the other end of the connection.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peer(pub IpAddr);

/// Who a request comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Client {
    /// Whose share of places it takes.
    pub address: IpAddr,
    /// Whether it reached the proxy in front by TLS.
    pub is_https: bool,
}

const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");
const FORWARDED_PROTO: HeaderName = HeaderName::from_static("x-forwarded-proto");

impl Client {
    /// The client of a request. Requests that came over no connection, as in tests, are all of one.
    pub(super) fn of(parts: &Parts, trusted_proxies: &[IpAddr]) -> Self {
        let peer = parts.extensions.get::<Peer>().map_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED), |peer| peer.0);
        if !trusted_proxies.contains(&peer) {
            return Self { address: peer, is_https: false };
        }
        let is_https = entries(&parts.headers, &FORWARDED_PROTO).next_back().is_some_and(|p| p.eq_ignore_ascii_case("https"));
        Self { address: behind(peer, &parts.headers, trusted_proxies), is_https }
    }
}

impl FromRequestParts<Site> for Client {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, site: &Site) -> Result<Self, Infallible> {
        Ok(Self::of(parts, &site.options.trusted_proxies))
    }
}

/// The last address of `X-Forwarded-For` that is not one of the proxies. Each proxy appends whom it was asked by, so what
/// stands before that address was written by the client and may be anything.
fn behind(peer: IpAddr, headers: &HeaderMap, trusted_proxies: &[IpAddr]) -> IpAddr {
    let mut nearest = peer;
    for entry in entries(headers, &FORWARDED_FOR).rev() {
        let Some(address) = address(entry) else { return nearest };
        nearest = address;
        if !trusted_proxies.contains(&address) {
            return address;
        }
    }
    nearest
}

/// The entries of a list that may be spread over several headers.
fn entries<'a>(headers: &'a HeaderMap, name: &HeaderName) -> impl DoubleEndedIterator<Item = &'a str> + use<'a> {
    let lists = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    lists.flat_map(|list| list.split(',')).map(str::trim).filter(|entry| !entry.is_empty())
}

/// An address, with a port or without.
fn address(text: &str) -> Option<IpAddr> {
    let plain = text.trim_start_matches('[').trim_end_matches(']');
    let address = plain.parse().ok().or_else(|| text.parse().ok().map(|with_port: SocketAddr| with_port.ip()));
    address.map(canonical)
}

/// An IPv4 address in its own form also where a socket for both families shows it as IPv6.
pub(super) fn canonical(address: IpAddr) -> IpAddr {
    address.to_canonical()
}

#[cfg(test)]
mod tests;
