//! Clients of requests that come directly and through proxies.

use axum::http::Request;

use super::*;

const PROXY: &str = "10.0.0.1";
const INNER: &str = "127.0.0.1";
const INGRESS: &str = "172.16.0.0/12";

fn proxies() -> [IpNetwork; 3] {
    [PROXY, INNER, INGRESS].map(|text| text.parse().expect("a network"))
}

fn ip(text: &str) -> IpAddr {
    text.parse().expect("an address")
}

fn parts(peer: &str, headers: &[(&str, &[u8])]) -> Parts {
    let request = Request::builder().extension(Peer(ip(peer)));
    let request = headers.iter().fold(request, |request, (name, value)| request.header(*name, *value));
    request.body(()).expect("a request").into_parts().0
}

fn client(peer: &str, headers: &[(&str, &str)]) -> Client {
    let headers: Vec<(&str, &[u8])> = headers.iter().map(|(name, value)| (*name, value.as_bytes())).collect();
    Client::from_parts(&parts(peer, &headers), &proxies())
}

#[test]
fn the_last_address_that_is_not_a_proxy_counts() {
    for (forwarded, address) in [
        ("192.168.1.7", "192.168.1.7"),
        // The client's own entry comes first.
        ("1.1.1.1, 192.168.1.7", "192.168.1.7"),
        ("192.168.1.7, 10.0.0.1", "192.168.1.7"),
        ("192.168.1.7:4711", "192.168.1.7"),
        ("2001:db8::1", "2001:db8::1"),
        ("[2001:db8::1]", "2001:db8::1"),
        ("[2001:db8::1]:4711", "2001:db8::1"),
        ("::ffff:192.168.1.7", "192.168.1.7"),
        ("10.0.0.1", "10.0.0.1"),
        // Entries before an unreadable one are not trusted.
        ("192.168.1.7, unknown", INNER),
        ("192.168.1.7, _hidden, 10.0.0.1", "10.0.0.1"),
        ("", INNER),
    ] {
        assert_eq!(client(INNER, &[("x-forwarded-for", forwarded)]).address, ip(address), "{forwarded:?}");
    }
    let through_ingress = [("x-forwarded-for", "1.1.1.1, 192.168.1.7, 172.31.0.9"), ("x-forwarded-proto", "https")];
    for peer in ["172.16.0.0", "172.31.255.255", "::ffff:172.20.1.1"] {
        let expected = Client { address: ip("192.168.1.7"), is_https: true };
        assert_eq!(client(peer, &through_ingress), expected, "{peer} is in {INGRESS}");
    }
    assert_eq!(client("172.32.0.0", &through_ingress), Client { address: ip("172.32.0.0"), is_https: false });
    let spread = [("x-forwarded-for", "1.1.1.1"), ("x-forwarded-for", "192.168.1.7, 10.0.0.1")];
    assert_eq!(client(INNER, &spread).address, ip("192.168.1.7"));
}

/// A line with such an entry was once dropped whole: the client counted as its proxy, or as what it wrote on a line before.
#[test]
fn an_entry_that_cannot_be_read_keeps_its_place() {
    for (lines, address) in [
        // It hides no entry after it.
        (&["\u{e4}, 192.168.1.7"][..], "192.168.1.7"),
        (&["\u{e4}, 192.168.1.7, 10.0.0.1"], "192.168.1.7"),
        (&["\u{e4}, 192.168.1.7", "10.0.0.1"], "192.168.1.7"),
        (&["\u{e4}", "192.168.1.7"], "192.168.1.7"),
        // No entry before it is believed in its place.
        (&["1.1.1.1, \u{e4}"], INNER),
        (&["1.1.1.1", "\u{e4}"], INNER),
        (&["1.1.1.1", "\u{e4}, 10.0.0.1"], "10.0.0.1"),
        (&["1.1.1.1, \u{e4}", "172.16.0.1, 10.0.0.1"], "172.16.0.1"),
        (&["1.1.1.1", "192.168.1.7\u{a0}"], INNER),
        // An empty element is none.
        (&["192.168.1.7, ", "\t,"], "192.168.1.7"),
    ] {
        let headers: Vec<_> = lines.iter().map(|line| ("x-forwarded-for", *line)).collect();
        assert_eq!(client(INNER, &headers).address, ip(address), "{lines:?}");
    }
    let latin_1 = [b"1.1.1.1".as_slice(), b"m\xfcller, 192.168.1.7, 10.0.0.1"].map(|line| ("x-forwarded-for", line));
    assert_eq!(Client::from_parts(&parts(INNER, &latin_1), &proxies()).address, ip("192.168.1.7"));
}

#[test]
fn protocol_and_host_of_an_entry_that_cannot_be_read_are_not_those_of_an_earlier_one() {
    assert!(!client(PROXY, &[("x-forwarded-proto", "https"), ("x-forwarded-proto", "\u{e4}")]).is_https);
    assert!(client(PROXY, &[("x-forwarded-proto", "\u{e4}, https")]).is_https);
    for (last, expected) in [("\u{e4}", None), ("\u{e4}, planner", Some("planner")), ("", Some("evil.example"))] {
        let parts = parts(PROXY, &[("x-forwarded-host", "evil.example".as_bytes()), ("x-forwarded-host", last.as_bytes())]);
        assert_eq!(forwarded_host(&parts, &proxies()), expected, "{last:?}");
    }
}

#[test]
fn whoever_is_not_a_proxy_speaks_for_itself() {
    let headers = [("x-forwarded-for", "192.168.1.7"), ("x-forwarded-proto", "https")];
    assert_eq!(client("192.168.1.9", &headers), Client { address: ip("192.168.1.9"), is_https: false });
    assert!(client(PROXY, &headers).is_https);
    assert!(!client(PROXY, &[("x-forwarded-proto", "http")]).is_https);
    assert!(!client(PROXY, &[("x-forwarded-proto", "https, http")]).is_https);
    assert!(!client(PROXY, &[]).is_https);
}
