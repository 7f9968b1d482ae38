//! Runs and the life of the process: what a kill leaves is stopped, and tokens of leases rise over it.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::process::{QUICK, Server};

pub(super) fn program(server: &Server) -> String {
    let mesh = server.upload().expect("a mesh");
    let body = format!(r#"{{"mesh_id": {}, "cell": "e05-transcan", "params": {QUICK}}}"#, mesh["id"]);
    let job = server.post("/api/v1/jobs", &body).expect("a job");
    let job = server.ended(job["id"].as_str().expect("an id"));
    assert_eq!(job["state"], "succeeded", "{job}");
    job["id"].as_str().expect("an id").to_owned()
}

pub(super) fn running(server: &Server, run: &str) {
    let until = Instant::now() + Duration::from_secs(60);
    while server.get(&format!("/api/v1/runs/{run}")).expect("the run")["state"] != "running" {
        assert!(Instant::now() < until, "{run} does not run");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn token(server: &Server) -> u64 {
    let lease = server.post("/api/v1/leases", &json!({"cell": "e05-transcan"}).to_string()).expect("a lease");
    lease["token"].as_u64().expect("a number")
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_run_that_a_kill_leaves_is_stopped_and_never_goes_on_by_itself() {
    let data = tempfile::tempdir().expect("a folder");
    let mut server = Server::start(data.path(), &[]);
    let job = program(&server);
    let before = token(&server);
    let run = server.post("/api/v1/runs", &json!({"job_id": job}).to_string()).expect("a run");
    let run = run["id"].as_str().expect("an id").to_owned();
    running(&server, &run);
    server.signal("KILL");
    server.end(Duration::from_secs(10));

    let server = Server::start(data.path(), &[]);
    let stopped = server.get(&format!("/api/v1/runs/{run}")).expect("the run");
    let words = |run: &Value| (run["state"].clone(), run["reason"].clone());
    assert_eq!(words(&stopped), (json!("stopped"), json!("server_restarted")), "{stopped}");
    assert!(stopped["detail"].as_str().expect("words").contains("new run") && stopped["ended_at"].is_string(), "{stopped}");
    assert!(token(&server) > before, "a token of before the kill must not hold again");
    let (status, ..) = server.ask("POST", &format!("/api/v1/runs/{run}/resume"), b"");
    assert_eq!(status, 409);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(server.get(&format!("/api/v1/runs/{run}")).expect("the run"), stopped);
    // In order as well as by a kill.
    let next = server.post("/api/v1/runs", &json!({"job_id": job}).to_string()).expect("a run");
    let next = next["id"].as_str().expect("an id").to_owned();
    running(&server, &next);
    server.stop();
    let server = Server::start(data.path(), &[]);
    let stopped = server.get(&format!("/api/v1/runs/{next}")).expect("the run");
    assert_eq!(words(&stopped), (json!("stopped"), json!("server_gone")), "{stopped}");
    let metrics = ureq::get(server.url("/metrics")).call().expect("metrics").body_mut().read_to_string().expect("text");
    assert!(metrics.contains("vantage_runs{state=\"running\"} 0"), "{metrics}");
}
