//! Path prefix below which clients reach the server, where a reverse proxy strips it from requests. Pages and the documentation
//! need none, since their links are relative; paths in answers (`Location`, the `type` of a problem) begin with it. It is what a
//! trusted proxy says in `X-Forwarded-Prefix`, else the setting `server.public_path`.

use std::convert::Infallible;
use std::sync::Arc;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

use super::client::forwarded_prefixes;
use super::options::ServerOptions;
use super::router::ApiState;

/// Largest length of a prefix.
const MAX_LENGTH: usize = 256;

/// The prefix: empty, or a path without a slash at its end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Prefix(Arc<str>);

impl Prefix {
    /// Determines the prefix of a request.
    pub(super) fn of(parts: &Parts, options: &ServerOptions) -> Self {
        // Each of several proxies adds the part that it strips; the outermost comes first. Of a path, a part alone leads nowhere.
        let forwarded: Option<Vec<&str>> =
            forwarded_prefixes(parts, &options.trusted_proxies).map(|part| part.map(|part| part.trim_end_matches('/'))).collect();
        let forwarded = forwarded.map(|all| all.concat()).filter(|path| !path.is_empty() && is_public_path(path));
        Self(forwarded.unwrap_or_else(|| options.public_path.trim_end_matches('/').to_owned()).into())
    }

    /// The path under which clients find `path` of the server.
    pub(super) fn at(&self, path: &str) -> String {
        format!("{}{path}", self.0)
    }
}

impl FromRequestParts<ApiState> for Prefix {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &ApiState) -> Result<Self, Infallible> {
        Ok(parts.extensions.get::<Self>().cloned().unwrap_or_default())
    }
}

/// Returns true for a path prefix: empty, or `/` and names, none of them `.` or `..`.
#[must_use]
pub fn is_public_path(path: &str) -> bool {
    let Some(names) = path.strip_suffix('/').unwrap_or(path).strip_prefix('/') else { return path.is_empty() };
    let plain = |c: u8| c.is_ascii_alphanumeric() || b"-._~".contains(&c);
    let is_name = |name: &str| !["", ".", ".."].contains(&name) && name.bytes().all(plain);
    path.len() <= MAX_LENGTH && names.split('/').all(is_name)
}

#[cfg(test)]
mod tests {
    use std::net::{IpAddr, Ipv4Addr};

    use axum::http::Request;

    use super::super::client::Peer;
    use super::*;

    #[test]
    fn a_prefix_is_believed_whole_or_not_at_all() {
        let proxy = IpAddr::V4(Ipv4Addr::LOCALHOST);
        let options =
            ServerOptions { trusted_proxies: vec![proxy.into()], public_path: "/set".to_owned(), ..ServerOptions::for_tests() };
        for (outer, inner, expected) in [("/a", "/b", "/a/b"), ("/a", "/\u{e4}", "/set"), ("/\u{e4}", "/b", "/set")] {
            let request = Request::builder().extension(Peer(proxy));
            let request = request.header("x-forwarded-prefix", outer).header("x-forwarded-prefix", inner);
            let (parts, ()) = request.body(()).expect("a request").into_parts();
            assert_eq!(Prefix::of(&parts, &options), Prefix(expected.into()), "{outer} {inner}");
        }
    }

    #[test]
    fn a_prefix_is_a_path_of_plain_names() {
        for path in ["", "/vantage", "/vantage/", "/plant-3/vantage_1.2/~x"] {
            assert!(is_public_path(path), "{path}");
        }
        for path in [
            "/",
            "//",
            "vantage",
            "//evil.example",
            "/a//b",
            "/..",
            "/a/./b",
            "/a b",
            "/a?b",
            "/a\"b",
            &format!("/{}", "x".repeat(256)),
        ] {
            assert!(!is_public_path(path), "{path}");
        }
    }

    #[test]
    fn paths_of_the_server_stand_below_it() {
        assert_eq!(Prefix("/plant".into()).at("/api/v1/jobs"), "/plant/api/v1/jobs");
        assert_eq!(Prefix::default().at("/problems/busy"), "/problems/busy");
    }
}
