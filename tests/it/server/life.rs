//! Beginning and ending: draining, interrupting, HTTP/2, cancelling real work.

use std::io::{Read, Write};
use std::time::{Duration, Instant};

use super::process::{LONG, Server};
use crate::http::api::cube;
use crate::support::failpoints;

#[test]
#[ignore = "long: tests/all runs it"]
fn a_part_is_planned_over_a_real_socket() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let job = server.submit(&mesh, "{}").expect("a job");
    let job = server.ended(job["id"].as_str().expect("an id"));
    assert_eq!(job["state"], "succeeded", "{job}");
    let plan = server.get(&format!("/api/v1/jobs/{}/plan", job["id"].as_str().expect("an id"))).expect("a plan");
    assert_eq!((&plan["schema"], &plan["part"]["sha256"]), (&"vantage.plan/1".into(), &mesh["sha256"]));
    for stage in ["surface", "candidates", "visibility", "selection", "missed"] {
        assert!(job["timings"][stage].is_number(), "{job}");
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn sigterm_ends_it_in_order_and_the_next_process_goes_on() {
    let data = tempfile::tempdir().expect("a folder");
    let mut server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let long = server.submit(&mesh, LONG).expect("a job");
    let short = server.submit(&mesh, "{}").expect("a job");
    let (long, short) = (long["id"].as_str().expect("an id"), short["id"].as_str().expect("an id"));
    server.wait_for_stage(long, "visibility");
    let mut events = server.connect();
    write!(events, "GET /api/v1/events HTTP/1.1\r\nhost: localhost\r\n\r\n").expect("a request");
    // A long-poll that is open is answered, and a stream that is open ends.
    let address = server.url(&format!("/api/v1/jobs/{long}?wait=60s"));
    let poll = std::thread::spawn(move || ureq::get(address).call().map(|response| response.status().as_u16()));
    std::thread::sleep(Duration::from_millis(300));
    let asked = Instant::now();
    server.signal("TERM");
    assert!(server.end(Duration::from_secs(20)).success());
    assert!(asked.elapsed() < Duration::from_secs(10), "{:?}", asked.elapsed());
    assert_eq!(poll.join().expect("a thread").expect("an answer"), 200);
    let mut told = String::new();
    events.read_to_string(&mut told).expect("the stream ends");
    assert!(told.contains("retry: 3000"), "{told}");

    let server = Server::start(data.path(), &[]);
    let job = server.job(long);
    assert!(job["attempts"].as_u64() <= Some(1), "an interrupted attempt does not count: {job}");
    assert_eq!(server.post(&format!("/api/v1/jobs/{long}/cancel"), "").expect("cancelled")["id"], long);
    assert_eq!(server.ended(short)["state"], "succeeded");
}

#[test]
fn a_second_signal_ends_it_at_once() {
    let data = tempfile::tempdir().expect("a folder");
    let mut server = Server::start(data.path(), &[("VANTAGE_SERVER__DRAIN_TIMEOUT_SECS", "60")]);
    // A request whose body does not come keeps the first signal from ending it.
    let mut open = server.connect();
    write!(open, "POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\ncontent-length: 100\r\n\r\nsolid").expect("sent");
    std::thread::sleep(Duration::from_millis(300));
    server.signal("TERM");
    std::thread::sleep(Duration::from_millis(500));
    server.signal("TERM");
    assert_eq!(server.end(Duration::from_secs(5)).code(), Some(130));
}

/// A server of which one thread hangs, with a job or an upload that waits for it.
fn hanging(data: &std::path::Path, failpoint: &str) -> Server {
    let server = Server::start(data, &[("VANTAGE_SERVER__DRAIN_TIMEOUT_SECS", "2"), ("VANTAGE_FAILPOINT", failpoint)]);
    if failpoint.starts_with("upload.") {
        let mut open = server.connect();
        let body = cube(60.0);
        let length = body.len();
        write!(open, "POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\ncontent-length: {length}\r\n\r\n{body}")
            .expect("sent");
        std::thread::spawn(move || open.read_to_end(&mut Vec::new()));
    } else {
        let mesh = server.upload().expect("a mesh");
        server.submit(&mesh, "{}").expect("a job");
    }
    let until = Instant::now() + Duration::from_secs(60);
    while !server.log().contains("hangs here") {
        assert!(Instant::now() < until, "{}", server.log());
        std::thread::sleep(Duration::from_millis(20));
    }
    server
}

/// A thread that blocks, one that plans, and one that writes results.
const HANGS: [&str; 3] = ["upload.before_rename:hang", "stage.visibility:hang", "artifact.before_rename:hang"];

#[test]
#[ignore = "long: tests/all runs it"]
fn a_thread_that_hangs_does_not_keep_it_from_ending_in_time() {
    if !failpoints() {
        return;
    }
    for failpoint in HANGS {
        let data = tempfile::tempdir().expect("a folder");
        let mut server = hanging(data.path(), failpoint);
        let asked = Instant::now();
        server.signal("TERM");
        let status = server.end(Duration::from_secs(20));
        assert_eq!(status.code(), Some(0), "{failpoint}");
        assert!(asked.elapsed() < Duration::from_secs(4), "{failpoint}: {:?}", asked.elapsed());
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_second_signal_ends_it_at_once_also_while_a_thread_hangs() {
    if !failpoints() {
        return;
    }
    for failpoint in HANGS {
        let data = tempfile::tempdir().expect("a folder");
        let mut server = hanging(data.path(), failpoint);
        server.signal("TERM");
        std::thread::sleep(Duration::from_millis(500));
        let asked = Instant::now();
        server.signal("INT");
        assert_eq!(server.end(Duration::from_secs(20)).code(), Some(130), "{failpoint}");
        assert!(asked.elapsed() < Duration::from_secs(1), "{failpoint}: {:?}", asked.elapsed());
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn real_work_is_cancelled_within_two_seconds() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    for stage in ["visibility", "visibility"] {
        let job = server.submit(&mesh, LONG).expect("a job");
        let id = job["id"].as_str().expect("an id");
        server.wait_for_stage(id, stage);
        let asked = Instant::now();
        server.post(&format!("/api/v1/jobs/{id}/cancel"), "").expect("accepted");
        assert_eq!(server.ended(id)["state"], "cancelled");
        assert!(asked.elapsed() < Duration::from_secs(2), "{:?}", asked.elapsed());
    }
}

#[test]
fn questions_are_answered_while_all_threads_plan() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_PLANNING__THREADS", "0")]);
    let mesh = server.upload().expect("a mesh");
    let job = server.submit(&mesh, LONG).expect("a job");
    let id = job["id"].as_str().expect("an id");
    server.wait_for_stage(id, "visibility");
    let began = Instant::now();
    for _ in 0..20 {
        server.job(id);
    }
    let each = began.elapsed() / 20;
    server.post(&format!("/api/v1/jobs/{id}/cancel"), "").expect("accepted");
    assert!(each < Duration::from_millis(250), "{each:?}");
}

#[test]
fn http_2_is_spoken_without_an_upgrade() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mut stream = server.connect();
    // Preface and an empty SETTINGS frame; what comes back begins with the server's own SETTINGS (type 4, stream 0).
    stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\x00\x00\x00\x04\x00\x00\x00\x00\x00").expect("sent");
    let mut frame = [0; 9];
    stream.read_exact(&mut frame).expect("a frame");
    assert_eq!((frame[3], &frame[5..]), (4, &[0; 4][..]));
    // It says how many streams there may be: setting 3.
    let mut settings = vec![0; usize::from(frame[2])];
    stream.read_exact(&mut settings).expect("settings");
    assert!(settings.chunks(6).any(|setting| setting == [0, 3, 0, 0, 0, 100]), "{settings:?}");
}
