//! Clients that stall, and requests that break the rules: refused or cut off, and nobody else notices.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::process::Server;
use crate::http::api::cube;

const IMPATIENT: [(&str, &str); 2] =
    [("VANTAGE_SERVER__HEADER_TIMEOUT_SECS", "1"), ("VANTAGE_SERVER__BODY_IDLE_TIMEOUT_SECS", "1")];

/// Time after which the server closes the connection.
fn closed_after(stream: &mut TcpStream) -> Duration {
    let began = Instant::now();
    let mut rest = Vec::new();
    // A reset is an end too.
    let _ = stream.read_to_end(&mut rest);
    began.elapsed()
}

#[test]
fn half_sent_requests_are_cut_off_while_others_are_served() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &IMPATIENT);
    let beginnings: [&[u8]; 5] = [
        b"",
        b"G",
        b"PRI * HTTP/2.0\r\n",
        b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nx-slow: ",
        b"POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\ncontent-le",
    ];
    let mut open: Vec<TcpStream> = beginnings
        .iter()
        .cycle()
        .take(100)
        .map(|beginning| {
            let mut stream = server.connect();
            stream.write_all(beginning).expect("sent");
            stream
        })
        .collect();
    let began = Instant::now();
    assert_eq!(server.get("/healthz").expect("served")["status"], "ok");
    assert!(began.elapsed() < Duration::from_secs(1));
    for stream in &mut open {
        closed_after(stream);
    }
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

#[test]
fn dripping_headers_do_not_help() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &IMPATIENT);
    let mut stream = server.connect();
    let began = Instant::now();
    let request = b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nx-drip: ".iter().chain(std::iter::repeat(&b'a'));
    for byte in request {
        if stream.write_all(&[*byte]).is_err() {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
        assert!(began.elapsed() < Duration::from_secs(10), "it is still open");
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn an_idle_connection_is_closed_and_a_stalling_body_too() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &IMPATIENT);
    let mut idle = server.connect();
    idle.write_all(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n").expect("sent");
    assert!(closed_after(&mut idle) < Duration::from_secs(5));
    let stalls = server
        .raw(b"POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: 100\r\n\r\nsolid");
    assert!(stalls.starts_with("HTTP/1.1 408") && stalls.contains("request_timeout"), "{stalls}");
}

#[test]
fn connections_have_a_cap_at_which_those_that_say_nothing_make_room() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__MAX_CONNECTIONS", "2")]);
    let mut oldest = server.connect();
    let _newer = server.connect();
    std::thread::sleep(Duration::from_millis(100));
    let began = Instant::now();
    assert_eq!(server.get("/version").expect("served")["api"], "v1");
    closed_after(&mut oldest);
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

#[test]
fn broken_requests_are_refused_and_never_the_server_s_fault() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &IMPATIENT);
    let large = format!("GET /healthz HTTP/1.1\r\nhost: localhost\r\nx: {}\r\n\r\n", "a".repeat(100_000));
    let many = format!("GET /healthz HTTP/1.1\r\nhost: localhost\r\n{}\r\n", "x: y\r\n".repeat(1000));
    let long = format!("GET /{} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n", "a".repeat(60_000));
    let cases: [(&[u8], &[&str]); 18] = [
        (b"nonsense\r\n\r\n", &["400"]),
        (b"GET\r\n\r\n", &["400"]),
        (b"GET / HTTP/9.9\r\n\r\n", &["400", "505"]),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", &["400", ""]),
        (b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nbad header\r\n\r\n", &["400"]),
        (b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nx: \x00\r\n\r\n", &["400"]),
        (b"GET /\xff\xfe HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n", &["400", "404"]),
        (b"GET /%00 HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n", &["404"]),
        (b"GET /assets/%c0%ae%c0%ae/x HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n", &["400", "404"]),
        (b"GET /../../etc/passwd HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n", &["404"]),
        (large.as_bytes(), &["431"]),
        (many.as_bytes(), &["431", "400"]),
        (long.as_bytes(), &["404", "414"]),
        // Two lengths, a length beside chunks, and a length that is none: smuggled requests.
        (b"POST /api/v1/jobs HTTP/1.1\r\nhost: localhost\r\ncontent-length: 5\r\ncontent-length: 6\r\n\r\nhello", &["400"]),
        (b"POST /api/v1/jobs HTTP/1.1\r\nhost: localhost\r\ncontent-length: -1\r\n\r\n", &["400"]),
        (b"POST /api/v1/jobs HTTP/1.1\r\nhost: localhost\r\ntransfer-encoding: gzip\r\n\r\n", &["400"]),
        (
            b"POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ntransfer-encoding: chunked\r\n\r\nzz\r\nhello\r\n",
            &["400"],
        ),
        (
            b"POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ntransfer-encoding: chunked\r\n\r\nfffffffffffffffff\r\n",
            &["400"],
        ),
    ];
    for (request, statuses) in cases {
        let answer = server.raw(request);
        let status = answer.split(' ').nth(1).unwrap_or_default();
        assert!(statuses.contains(&status), "{:?}: {answer:?}", String::from_utf8_lossy(&request[..request.len().min(80)]));
    }
    // Bodies that are no chunks were said to have ended early.
    for (request, _) in &cases[16..] {
        let answer = server.raw(request);
        assert!(answer.contains("\"code\":\"bad_body\"") && answer.contains("malformed chunk"), "{answer}");
    }
    assert_eq!(server.get("/healthz").expect("well")["status"], "ok");
}

#[test]
fn a_request_behind_a_doubtful_length_is_not_run() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &IMPATIENT);
    let smuggled = b"POST /api/v1/jobs HTTP/1.1\r\nhost: localhost\r\ncontent-length: 4\r\ntransfer-encoding: chunked\r\n\r\n\
        0\r\n\r\nGET /version HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n";
    let answer = server.raw(smuggled);
    assert!(answer.starts_with("HTTP/1.1 4"), "{answer}");
    // Either the whole is refused, or the chunks count and the connection is closed after them (RFC 9112, section 6.1).
    assert!(!answer.contains("\"api\":\"v1\"") || answer.matches("HTTP/1.1").count() <= 2, "{answer}");
}

/// Head of a response, of which the body is read to its end too.
fn response_head(stream: &mut TcpStream) -> String {
    let (mut answer, mut piece) = (Vec::new(), [0; 4096]);
    loop {
        let text = String::from_utf8_lossy(&answer);
        let length = |head: &str| head.lines().find_map(|line| line.strip_prefix("content-length: ")?.parse::<usize>().ok());
        if let Some((head, body)) = text.split_once("\r\n\r\n").filter(|(head, body)| length(head) == Some(body.len())) {
            assert!(!body.is_empty(), "{head}");
            return head.to_owned();
        }
        let count = stream.read(&mut piece).expect("an answer");
        assert!(count > 0, "the connection closed within {text:?}");
        answer.extend_from_slice(&piece[..count]);
    }
}

/// Refusals before the body was read closed the connection without a word, and the client's next request on it was lost.
#[test]
fn a_refusal_of_a_body_that_is_still_to_come_says_that_the_connection_closes() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let json = "content-type: application/json\r\n";
    // Of the JSON body as much is sent as the server reads of it; of the others nothing.
    let cases = [
        ("/api/v1/jobs", json, 2_097_153, "413"),
        ("/api/v1/jobs", "content-type: text/plain\r\n", 0, "415"),
        ("/api/v1/nothing", json, 0, "404"),
        ("/api/v1/retention", json, 100, "400"),
        ("/api/v1/meshes", "", 0, "400"),
    ];
    for (path, headers, sent_bytes, status) in cases {
        let mut stream = server.connect();
        let head = format!("POST {path} HTTP/1.1\r\nhost: localhost\r\n{headers}content-length: 3000000\r\n\r\n");
        stream.write_all(head.as_bytes()).expect("sent");
        stream.write_all(&vec![b'x'; sent_bytes]).expect("sent");
        let answer = response_head(&mut stream);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{path}: {answer}");
        assert!(answer.contains("\r\nconnection: close"), "{path}: {answer}");
    }
    // What was received to its end keeps the connection, a refusal too.
    let mut stream = server.connect();
    let file = cube(10.0);
    for (path, headers, body, status) in [
        ("/api/v1/meshes?unit=mm", "", file.as_str(), "201"),
        ("/api/v1/jobs", json, "{}", "422"),
        ("/api/v1/meshes?unit=mm", "", file.as_str(), "201"),
    ] {
        let length = body.len();
        let request = format!("POST {path} HTTP/1.1\r\nhost: localhost\r\n{headers}content-length: {length}\r\n\r\n{body}");
        stream.write_all(request.as_bytes()).expect("sent");
        let answer = response_head(&mut stream);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")) && !answer.contains("connection:"), "{path}: {answer}");
    }
}
