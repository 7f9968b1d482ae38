//! Clients that take more than their share, from outside: others are served meanwhile, and whoever wants too much is told
//! at once. 127.0.0.1, .2, .3 … are different clients.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::process::{RaisedAtEnd, Server};
use crate::http::api::cube;

const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];
/// Time beyond which an answer did not come at once.
const AT_ONCE: Duration = Duration::from_secs(2);
/// Bound of what is sent again and again.
const AT_LAST: Duration = Duration::from_secs(60);

/// The status of the answer on `stream`; `None` when it was closed without one.
fn status(stream: &TcpStream) -> Option<u16> {
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).ok()?;
    line.split(' ').nth(1)?.parse().ok()
}

fn follow(mut stream: TcpStream) -> TcpStream {
    // The server may have closed the connection.
    let _ = stream.write_all(b"GET /api/v1/events HTTP/1.1\r\nhost: localhost\r\n\r\n");
    stream
}

fn count(statuses: &[Option<u16>], wanted: u16) -> usize {
    statuses.iter().filter(|status| **status == Some(wanted)).count()
}

/// Asserts that client `last` gets an answer that begins like this, at once.
#[track_caller]
fn assert_answered(server: &Server, last: u8, path: &str, beginning: &str) -> String {
    let began = Instant::now();
    let answer = server.asked_from(last, "GET", path, "");
    assert!(answer.starts_with(&format!("HTTP/1.1 {beginning}")), "{path}: {answer}");
    assert!(began.elapsed() < AT_ONCE, "{path} after {:?}", began.elapsed());
    answer
}

#[test]
fn streams_of_one_client_leave_other_clients_and_the_probes_alone() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let streams: Vec<TcpStream> = (0..1030).map(|_| follow(server.connect_from(1))).collect();
    let statuses: Vec<_> = streams.iter().map(status).collect();
    assert_eq!(count(&statuses, 200), 64, "the share of one client");
    assert!(count(&statuses, 429) > 0);
    for last in [1, 2] {
        for path in PROBES {
            assert_answered(&server, last, path, "200");
        }
        assert_answered(&server, last, "/api/v1/jobs", "200");
    }
    let other = follow(server.connect_from(2));
    assert_eq!(status(&other), Some(200));
    let refused = assert_answered(&server, 1, "/api/v1/events", "429");
    assert!(refused.contains("\"too_many_requests\"") && refused.contains("server.max_event_streams_per_address"), "{refused}");
    assert!(refused.to_ascii_lowercase().contains("retry-after: "), "{refused}");
}

#[test]
fn probes_are_answered_while_every_place_is_held() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__MAX_CONNECTIONS", "12")]);
    let streams: Vec<TcpStream> = (0..12).map(|index| follow(server.connect_from(1 + index % 3))).collect();
    assert!(streams.iter().all(|stream| status(stream) == Some(200)));
    for last in [1, 4] {
        for path in PROBES {
            assert_answered(&server, last, path, "200");
        }
        let refused = assert_answered(&server, last, "/api/v1/jobs", "503");
        assert!(refused.contains("\"busy\"") && refused.to_ascii_lowercase().contains("retry-after: "), "{refused}");
    }
    // Nor do connections in the reserve that say nothing keep a probe out.
    let _silent: Vec<TcpStream> = (0..200).map(|index| server.connect_from(1 + index % 20)).collect();
    for path in PROBES {
        assert_answered(&server, 30, path, "200");
        assert_answered(&server, 1, path, "200");
    }
    drop(streams);
    let until = Instant::now() + Duration::from_secs(10);
    while !server.asked_from(4, "GET", "/api/v1/jobs", "").starts_with("HTTP/1.1 200") {
        assert!(Instant::now() < until, "the places are not given back");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn an_address_beyond_its_connections_is_told_so_and_others_are_not_touched() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__MAX_CONNECTIONS_PER_ADDRESS", "8")]);
    let streams: Vec<TcpStream> = (0..8).map(|_| follow(server.connect_from(1))).collect();
    assert!(streams.iter().all(|stream| status(stream) == Some(200)));
    let refused = assert_answered(&server, 1, "/api/v1/jobs", "429");
    assert!(refused.contains("server.max_connections_per_address"), "{refused}");
    assert_answered(&server, 1, "/healthz", "200");
    // A run is stopped all the same: it is only not there.
    let stop = server.asked_from(1, "POST", "/api/v1/runs/01a1f77c-78a1-7554-855a-a9513c22aa2b/stop", "");
    assert!(stop.starts_with("HTTP/1.1 404") && stop.contains("\"run_not_found\""), "{stop}");
    assert_answered(&server, 2, "/api/v1/jobs", "200");
}

#[test]
fn slow_uploads_of_one_client_leave_others_room() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let slow: Vec<TcpStream> = (0..64)
        .map(|_| {
            let mut stream = server.connect_from(1);
            let head = "POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\ncontent-length: 100000\r\n\r\nsolid";
            stream.write_all(head.as_bytes()).expect("sent");
            stream
        })
        .collect();
    std::thread::sleep(Duration::from_millis(500));
    let began = Instant::now();
    // Larger than what the sockets hold: the refusal must reach a client that is still sending.
    let large = "x".repeat(8 << 20);
    let refused = server.asked_from(1, "POST", "/api/v1/meshes?unit=mm", &large);
    assert!(refused.starts_with("HTTP/1.1 429") && refused.contains("limits.uploads_at_once_per_address"), "{refused}");
    let other = server.asked_from(2, "POST", "/api/v1/meshes?unit=mm", &cube(10.0));
    assert!(other.starts_with("HTTP/1.1 201"), "{other}");
    assert!(began.elapsed() < 2 * AT_ONCE, "{:?}", began.elapsed());
    drop(slow);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn waits_of_one_client_leave_others_room() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__MAX_WAITS_PER_ADDRESS", "5")]);
    let mesh = server.upload().expect("a mesh");
    let job = server.submit(&mesh, r#"{"part": {"samples_per_mm2": 60, "patch_edge_mm": 0.5}}"#).expect("a job");
    let path = format!("/api/v1/jobs/{}?wait=60s", job["id"].as_str().expect("an id"));
    let waiting: Vec<TcpStream> = (0..5)
        .map(|_| {
            let mut stream = server.connect_from(1);
            write!(stream, "GET {path} HTTP/1.1\r\nhost: localhost\r\n\r\n").expect("sent");
            stream
        })
        .collect();
    std::thread::sleep(Duration::from_millis(300));
    assert_answered(&server, 1, &path, "429");
    assert_answered(&server, 1, path.split('?').next().expect("a path"), "200");
    let short = path.replace("60s", "1s");
    assert!(server.asked_from(2, "GET", &short, "").starts_with("HTTP/1.1 200"));
    drop(waiting);
}

/// Number of connections that this process and one that it starts may have at the same time.
fn connections_here() -> usize {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }).expect("raised");
    // Other tests run beside this one.
    maximum.map_or(5000, |limit| usize::try_from(limit / 3).unwrap_or(usize::MAX)).min(5000)
}

/// Connections that begin requests, drip headers and begin again when they are cut off, until the flag is raised.
fn drip(server: &Server, count: usize, first: u8, stop: &std::sync::atomic::AtomicBool) {
    let begin = |index: usize| {
        let mut stream = server.connect_from(first + (index % 4) as u8);
        let _ = stream.write_all(b"GET /api/v1/jobs HTTP/1.1\r\nhost: localhost\r\nx-slow: ");
        stream
    };
    let mut streams: Vec<TcpStream> = (0..count).map(begin).collect();
    while !stop.load(std::sync::atomic::Ordering::Relaxed) {
        for (index, stream) in streams.iter_mut().enumerate() {
            if stream.write_all(b"a").is_err() {
                *stream = begin(index);
            }
        }
        std::thread::sleep(Duration::from_millis(200));
    }
}

/// The time that 99 of 100 of so many requests stay below, and the longest of all. Where `may_repeat`, a request that is refused or
/// cut off is sent again: the address has used up its connections, and its own clients push each other out.
fn slowest(server: &Server, last: u8, requests: usize, may_repeat: bool) -> [Duration; 2] {
    let mut times: Vec<Duration> = (0..requests)
        .map(|_| {
            let began = Instant::now();
            loop {
                let answer = server.asked_from(last, "GET", "/api/v1/jobs", "");
                let took = began.elapsed();
                std::thread::sleep(Duration::from_millis(5));
                if answer.starts_with("HTTP/1.1 200") {
                    return took;
                }
                let is_cut_off = answer.is_empty() || answer.starts_with("HTTP/1.1 429");
                assert!(may_repeat && is_cut_off && took < AT_LAST, "127.0.0.{last} after {took:?}: {answer:?}");
            }
        })
        .collect();
    times.sort();
    [times[(times.len() * 99).div_ceil(100) - 1], times[times.len() - 1]]
}

#[test]
#[ignore = "long: tests/all runs it"]
fn thousands_of_half_sent_requests_do_not_keep_others_waiting() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let count = connections_here();
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let raised = RaisedAtEnd(&stop);
        scope.spawn(|| drip(&server, count, 1, &stop));
        std::thread::sleep(Duration::from_secs(2));
        // An address of its own is never cut off; one that it shares with slow clients is answered in the end.
        let [at_theirs, apart] = [(1, true), (9, false)].map(|(last, may_repeat)| slowest(&server, last, 200, may_repeat));
        drop(raised);
        eprintln!(
            "{count} slow clients; p99 and longest of a healthy one {apart:?}, of one at an address of theirs {at_theirs:?}"
        );
        assert!(apart[0] < AT_ONCE, "{apart:?}");
    });
}

#[test]
#[ignore = "long: tests/all runs it"]
fn bodies_that_do_not_come_hold_no_place_for_long() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__MAX_CONNECTIONS", "12")]);
    let head = b"POST /api/v1/jobs HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\ncontent-length: 9\r\n\r\n{";
    let _slow: Vec<TcpStream> = (0..12)
        .map(|index| {
            let mut stream = server.connect_from(1 + index % 3);
            stream.write_all(head).expect("sent");
            stream
        })
        .collect();
    std::thread::sleep(Duration::from_millis(1500));
    assert_answered(&server, 9, "/api/v1/jobs", "200");
}

/// The end of a connection: how long it took, and whether it came.
fn closed_after(stream: &mut TcpStream) -> Option<Duration> {
    let began = Instant::now();
    let mut rest = Vec::new();
    match stream.read_to_end(&mut rest) {
        Err(error) if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => None,
        _ => Some(began.elapsed()),
    }
}

const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\x00\x00\x00\x04\x00\x00\x00\x00\x00";

/// A request on stream 1 of HTTP/2: `:method` GET, `:scheme` http, `:path`, `:authority` localhost (RFC 7541).
fn http2_get(path: &str) -> Vec<u8> {
    let mut block = vec![0x82, 0x86];
    for (index, text) in [(4u8, path), (1, "localhost")] {
        // Literal without indexing, the name from the static table.
        block.extend([index, u8::try_from(text.len()).expect("short")]);
        block.extend(text.as_bytes());
    }
    // HEADERS with END_STREAM and END_HEADERS.
    let mut frame = vec![0, 0, u8::try_from(block.len()).expect("short"), 1, 5, 0, 0, 0, 1];
    frame.extend(block);
    frame
}

#[test]
#[ignore = "long: tests/all runs it"]
fn idle_connections_of_http_2_are_closed_and_those_in_use_are_not() {
    let data = tempfile::tempdir().expect("a folder");
    let environment = [("VANTAGE_SERVER__IDLE_TIMEOUT_SECS", "1"), ("VANTAGE_SERVER__HEADER_TIMEOUT_SECS", "2")];
    let server = Server::start(data.path(), &environment);
    let open = |bytes: &[u8]| {
        let mut stream = server.connect();
        stream.write_all(&[PREFACE, bytes].concat()).expect("sent");
        stream
    };
    let mut silent = open(b"");
    let mut answered = open(&http2_get("/healthz"));
    let mut following = open(&http2_get("/api/v1/events"));
    let within = Duration::from_secs(8);
    assert!(closed_after(&mut answered).is_some_and(|time| time < within), "after an answer");
    assert!(closed_after(&mut silent).is_some_and(|time| time < within), "without a request");
    following.set_read_timeout(Some(Duration::from_secs(4))).expect("a timeout");
    assert_eq!(closed_after(&mut following), None, "a stream of events is a request that is open");
}
