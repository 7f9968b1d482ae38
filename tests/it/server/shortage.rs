//! A machine that is short of something: file descriptors, or the lock of the database. Nobody's job fails of it.

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use sqlx::{Connection, Executor, SqliteConnection};

use super::process::Server;

/// Small enough to be planned at once.
const QUICK: &str = r#"{"candidates": {"even_directions": 20}, "selection": {"max_views": 1}}"#;

/// Opens as many connections as can be had, from many addresses; some follow events, some begin an upload, some say nothing.
fn crowd(server: &Server, count: usize) -> Vec<TcpStream> {
    let requests: [&[u8]; 4] = [
        b"GET /api/v1/events HTTP/1.1\r\nhost: localhost\r\n\r\n",
        b"POST /api/v1/meshes?unit=mm HTTP/1.1\r\nhost: localhost\r\ncontent-length: 99999\r\n\r\nsolid",
        b"GET /healthz HTTP/1.1\r\nhost: loc",
        b"",
    ];
    (0..count)
        .map(|index| {
            let mut stream = server.connect_from(1 + (index % 40) as u8);
            // The server may have closed the connection.
            let _ = stream.write_all(requests[index / 40 % requests.len()]);
            stream
        })
        .collect()
}

fn jobs_survive_a_crowd(open_files: u32) {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start_with_open_files(&format!("-n {open_files}"), data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let jobs: Vec<String> =
        (0..6).map(|_| server.submit(&mesh, QUICK).expect("a job")["id"].as_str().expect("an id").to_owned()).collect();
    let crowd = crowd(&server, 1200);
    // The crowd stays while the jobs are planned, and the server is watched all the same.
    let until = Instant::now() + Duration::from_secs(120);
    let ended = |log: &str| log.matches("attempt ended").count();
    while ended(&server.log()) < jobs.len() {
        assert!(Instant::now() < until, "{}", server.log());
        assert!(server.asked_from(50, "GET", "/healthz", "").starts_with("HTTP/1.1 200"), "{open_files}");
        std::thread::sleep(Duration::from_millis(100));
    }
    drop(crowd);
    for id in jobs {
        let job = server.ended(&id);
        assert_eq!(job["state"], "succeeded", "{open_files} open files: {job}");
    }
    let log = server.log();
    assert!(log.contains("fewer connections than server.max_connections are taken"), "{log}");
    assert!(log.matches("no connection can be accepted").count() <= 4, "{log}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn jobs_succeed_at_1024_open_files_whatever_connects() {
    jobs_survive_a_crowd(1024);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn jobs_succeed_at_256_open_files_whatever_connects() {
    jobs_survive_a_crowd(256);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn without_a_file_to_spare_it_waits_and_the_log_stays_short() {
    let data = tempfile::tempdir().expect("a folder");
    // Fewer than the reserve alone would take.
    let server = Server::start_with_open_files("-n 48", data.path(), &[]);
    let crowd = crowd(&server, 400);
    std::thread::sleep(Duration::from_secs(3));
    let log = server.log();
    assert!((1..=2).contains(&log.matches("no connection can be accepted").count()), "{log}");
    drop(crowd);
    let until = Instant::now() + Duration::from_secs(20);
    while !server.asked_from(50, "GET", "/api/v1/jobs", "").starts_with("HTTP/1.1 200") {
        assert!(Instant::now() < until, "{}", server.log());
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn a_limit_of_open_files_is_raised_as_far_as_the_system_allows() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start_with_open_files("-Sn 300", data.path(), &[]);
    let limits = std::fs::read_to_string(format!("/proc/{}/limits", server.id())).expect("its limits");
    let line = limits.lines().find(|line| line.starts_with("Max open files")).expect("the line");
    let numbers: Vec<&str> = line.split_whitespace().skip(3).take(2).collect();
    assert_eq!(numbers[0], numbers[1], "{line}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_locked_database_is_busy_and_not_at_fault() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let body = format!("{{\"mesh_id\": {}, \"cell\": \"none\"}}", mesh["id"]);
    let ask = || {
        let request = format!(
            "POST /api/v1/jobs HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-type: application/json\r\n\
             content-length: {}\r\n\r\n{body}",
            body.len()
        );
        server.raw(request.as_bytes())
    };
    let url = format!("sqlite://{}", data.path().join("vantage.db").display());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let mut other = runtime.block_on(SqliteConnection::connect(&url)).expect("the database");
    runtime.block_on(other.execute("BEGIN IMMEDIATE")).expect("locked");
    let refused = ask();
    assert!(refused.starts_with("HTTP/1.1 503") && refused.contains("\"busy\""), "{refused}");
    assert!(refused.to_ascii_lowercase().contains("retry-after: "), "{refused}");
    runtime.block_on(other.execute("ROLLBACK")).expect("unlocked");
    let accepted = ask();
    assert!(accepted.starts_with("HTTP/1.1 202"), "{accepted}");
}
