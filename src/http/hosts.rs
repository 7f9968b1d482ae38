//! By which names the server may be asked for. A page of another site cannot read our answers, unless its own name is
//! made to point at our address (DNS rebinding): then the browser takes us for that site. The browser still says in
//! `Host` which name it asked for, so without a key only names that are ours are answered.
//!
//! An IP address is always one: nobody can point an address elsewhere, so a page whose origin it is came from us. So are
//! `localhost` and the names in `server.hosts`. Where a key is configured and `server.hosts` is empty, every name is
//! accepted: a rebound page has neither the key nor the cookie, which the browser keeps for our real name.

use std::net::Ipv6Addr;

use axum::extract::{Request, State};
use axum::http::header::HOST;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, Uri, Version};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::options::Options;
use super::problem::{Code, Problem};
use super::router::Site;

/// Refuses a request for a name that is not ours, and one that does not say which name it is for.
pub(super) async fn check(State(site): State<Site>, request: Request, next: Next) -> Response {
    match is_for_us(&request, &site.options) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

fn is_for_us(request: &Request, options: &Options) -> Result<(), Problem> {
    let Some(authority) = authority(request.version(), request.uri(), request.headers())? else { return Ok(()) };
    let host = name(&authority);
    if is_address(host) || host == "localhost" || options.hosts.iter().any(|own| own == host) {
        return Ok(());
    }
    if options.hosts.is_empty() && options.api_key.is_some() {
        return Ok(());
    }
    let detail = format!(
        "{host:?} is not a name of this server; add it to server.hosts if it is one. \
         Without that, IP addresses and localhost are answered{}",
        if options.hosts.is_empty() { ", and every name once server.api_key is set" } else { "" }
    );
    Err(Problem::at(Code::HostNotAllowed, "Host", detail))
}

/// The authority that the request is for, in lower case. HTTP/1.0 need not say one.
fn authority(version: Version, uri: &Uri, headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let refuse = |detail: &str| Problem::at(Code::BadRequest, "Host", detail);
    let mut hosts = headers.get_all(HOST).iter();
    let header = match (hosts.next(), hosts.next()) {
        (Some(host), None) => Some(host.to_str().map_err(|_| refuse("is not text"))?.to_ascii_lowercase()),
        (None, _) => None,
        (Some(_), Some(_)) => return Err(refuse("is given more than once")),
    };
    let target = uri.authority().map(|authority| authority.as_str().to_ascii_lowercase());
    let authority = match (header, target) {
        (Some(header), Some(target)) if header != target => {
            return Err(refuse("is not the authority that the request's target names"));
        }
        (Some(authority), _) | (None, Some(authority)) => authority,
        (None, None) if version < Version::HTTP_11 => return Ok(None),
        (None, None) => return Err(refuse("is missing")),
    };
    let has_user = authority.contains('@');
    match authority.parse::<Authority>() {
        Ok(parsed) if !has_user && !parsed.host().is_empty() => Ok(Some(authority)),
        _ => Err(refuse("is not a host with an optional port")),
    }
}

/// The host of an authority: without port, and without the dot that may end a name.
fn name(authority: &str) -> &str {
    let end = authority.rfind(']').map_or(0, |bracket| bracket + 1);
    let host = authority[end..].rfind(':').map_or(authority, |colon| &authority[..end + colon]);
    host.strip_suffix('.').unwrap_or(host)
}

fn is_address(host: &str) -> bool {
    let bracketed = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
    match bracketed {
        Some(address) => address.parse::<Ipv6Addr>().is_ok(),
        None => host.parse::<std::net::Ipv4Addr>().is_ok(),
    }
}

#[cfg(test)]
mod tests;
