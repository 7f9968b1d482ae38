//! Host validation against DNS rebinding. Another site's page cannot read our responses, unless that site makes its own
//! name resolve to our address: then the browser takes us for that site. `Host` still carries the name that the browser
//! asked for, so without a key only our own names are answered.
//!
//! IP addresses are always accepted: nobody can make an address resolve elsewhere, so a page with that origin came from
//! us. So are `localhost` and the names in `server.hosts`. With a key and an empty `server.hosts`, every name is accepted:
//! a rebound page has neither the key nor the cookie, which the browser keeps for our real name.

use std::net::Ipv6Addr;

use axum::extract::{Request, State};
use axum::http::header::HOST;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, Uri, Version};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::options::ServerOptions;
use super::problem::{ApiError, Code};
use super::router::ApiState;

/// Refuses a request for a name that is not ours, or that names no host.
pub(super) async fn check(State(state): State<ApiState>, request: Request, next: Next) -> Response {
    match check_host(&request, &state.options) {
        Ok(()) => next.run(request).await,
        Err(error) => error.into_response(),
    }
}

fn check_host(request: &Request, options: &ServerOptions) -> Result<(), ApiError> {
    let Some(authority) = authority(request.version(), request.uri(), request.headers())? else { return Ok(()) };
    if is_answered(&authority, options) {
        return Ok(());
    }
    let host = name(&authority);
    let detail = format!(
        "{host:?} is not a configured name of this server; if it is one of its names, add it to server.hosts. \
         IP addresses and localhost are always accepted{}",
        if options.hosts.is_empty() { ", and every name once server.api_key is set" } else { "" }
    );
    Err(ApiError::at(Code::HostNotAllowed, "Host", detail))
}

/// Returns true for a host, with or without a port, to which the server answers. In lower case.
pub(super) fn is_answered(authority: &str, options: &ServerOptions) -> bool {
    let host = name(authority);
    let is_any_harmless = options.hosts.is_empty() && options.requires_key();
    is_any_harmless || is_address(host) || host == "localhost" || options.hosts.iter().any(|own| own == host)
}

/// The authority that the request is for, in lower case. `None` for HTTP/1.0 without `Host`.
fn authority(version: Version, uri: &Uri, headers: &HeaderMap) -> Result<Option<String>, ApiError> {
    let refuse = |said: &str| ApiError::header(Code::BadRequest, "Host", said);
    let mut hosts = headers.get_all(HOST).iter();
    let header = match (hosts.next(), hosts.next()) {
        (Some(host), None) => Some(host.to_str().map_err(|_| refuse("is not text"))?.to_ascii_lowercase()),
        (None, _) => None,
        (Some(_), Some(_)) => return Err(refuse("is given more than once")),
    };
    let target = uri.authority().map(|authority| authority.as_str().to_ascii_lowercase());
    let authority = match (header, target) {
        (Some(header), Some(target)) if header != target => {
            return Err(refuse("differs from the authority in the request target"));
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

/// The host of an authority: without the port and without the trailing dot of a name.
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
