//! Our own names, foreign names, and requests that name no host or two.

use axum::body::Body;

use super::*;
use crate::http::ApiKey;

fn options(hosts: &[&str], key: bool) -> ServerOptions {
    let key: Option<ApiKey> = key.then(|| serde_json::from_value("0123456789abcdef".into()).expect("a key"));
    ServerOptions { hosts: hosts.iter().map(|host| (*host).to_owned()).collect(), api_key: key, ..ServerOptions::for_tests() }
}

fn answer(version: Version, uri: &str, hosts: &[&str], options: &ServerOptions) -> Result<(), Code> {
    let mut request = Request::builder().version(version).uri(uri);
    for host in hosts {
        request = request.header(HOST, *host);
    }
    check_host(&request.body(Body::empty()).expect("a request"), options).map_err(|error| error.code())
}

const REFUSED: Result<(), Code> = Err(Code::HostNotAllowed);
const BAD: Result<(), Code> = Err(Code::BadRequest);

#[track_caller]
fn assert_hosts(options: &ServerOptions, expected: Result<(), Code>, hosts: &[&str]) {
    for host in hosts {
        assert_eq!(answer(Version::HTTP_11, "/", &[host], options), expected, "{host:?}");
    }
}

const ADDRESSES: [&str; 8] =
    ["127.0.0.1", "127.8.8.8:8080", "[::1]", "[::1]:8080", "10.0.0.5:80", "[2001:db8::1]:1", "localhost", "LocalHost:8080"];
const NAMES: [&str; 6] =
    ["evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", "planner", "localhostx"];

#[test]
fn without_a_key_only_addresses_and_our_own_names_are_answered() {
    let open = options(&[], false);
    assert_hosts(&open, Ok(()), &ADDRESSES);
    assert_hosts(&open, Ok(()), &["localhost.", "localhost.:8080"]);
    assert_hosts(&open, REFUSED, &NAMES);
    let named = options(&["planner", "planner.plant.example"], false);
    assert_hosts(&named, Ok(()), &ADDRESSES);
    assert_hosts(&named, Ok(()), &["planner", "PLANNER:8080", "planner.plant.example.", "Planner.Plant.Example:80"]);
    assert_hosts(&named, REFUSED, &["evil.example", "planner.evil.example", "plant.example"]);
}

#[test]
fn a_key_makes_every_name_harmless_unless_the_settings_name_ours() {
    assert_hosts(&options(&[], true), Ok(()), &NAMES);
    assert_hosts(&options(&["planner"], true), REFUSED, &["evil.example"]);
    assert_hosts(&options(&["planner"], true), Ok(()), &["planner", "10.0.0.5"]);
}

#[test]
fn a_request_says_once_which_host_it_is_for() {
    let open = options(&[], false);
    for (version, uri, hosts, expected) in [
        (Version::HTTP_11, "/", &[][..], BAD),
        (Version::HTTP_11, "/", &["localhost", "localhost"], BAD),
        (Version::HTTP_11, "/", &["localhost", "evil.example"], BAD),
        (Version::HTTP_11, "/", &[""], BAD),
        (Version::HTTP_11, "/", &["user@localhost"], BAD),
        (Version::HTTP_11, "/", &["local host"], BAD),
        (Version::HTTP_11, "/", &["localhost/x"], BAD),
        (Version::HTTP_11, "http://localhost/", &["localhost"], Ok(())),
        (Version::HTTP_11, "http://localhost/", &["evil.example"], BAD),
        (Version::HTTP_11, "http://evil.example/", &["localhost"], BAD),
        (Version::HTTP_11, "http://evil.example/", &["evil.example"], REFUSED),
        // Simple health checks speak HTTP/1.0; no browser does.
        (Version::HTTP_10, "/", &[], Ok(())),
        (Version::HTTP_10, "/", &["evil.example"], REFUSED),
        (Version::HTTP_2, "http://localhost:8080/", &[], Ok(())),
        (Version::HTTP_2, "http://localhost:8080/", &["localhost:8080"], Ok(())),
        (Version::HTTP_2, "http://localhost:8080/", &["localhost"], BAD),
        (Version::HTTP_2, "http://evil.example/", &[], REFUSED),
        (Version::HTTP_2, "/", &["localhost"], Ok(())),
        (Version::HTTP_2, "/", &[], BAD),
    ] {
        assert_eq!(answer(version, uri, hosts, &open), expected, "{version:?} {uri} {hosts:?}");
    }
}
