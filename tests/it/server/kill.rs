//! The process dies at each of its named points: what it had promised holds, and the next one finishes the work.

use std::path::Path;
use std::time::Duration;

use serde_json::Value;
use sha2::{Digest, Sha256};
use vantage::service::FAILPOINTS;

use super::process::{QUICK, Server};
use crate::support::failpoints;

/// Stages that only a cell has.
const WITH_CELL: [&str; 2] = ["stage.sequence", "stage.collision_scene"];
/// Stage that only some parts have in a cell.
const SOMETIMES: &str = "stage.roadmap";

/// Promises before the end: answers that came.
#[derive(Default)]
struct Promised {
    mesh: Option<Value>,
    job: Option<Value>,
}

/// Uploads, starts a job and cancels it if that is the point, until the server dies.
fn work_until_death(server: &mut Server, failpoint: &str) -> Promised {
    let mut promised = Promised::default();
    if let Ok(mesh) = server.upload() {
        let request = request(&mesh, failpoint);
        promised.mesh = Some(mesh);
        if let Ok(job) = server.post("/api/v1/jobs", &request) {
            if failpoint.starts_with("cancel.") {
                let path = format!("/api/v1/jobs/{}/cancel", job["id"].as_str().expect("an id"));
                assert!(server.post(&path, "").is_err(), "{failpoint} was not come to");
            }
            promised.job = Some(job);
        }
    }
    assert!(!server.end(Duration::from_secs(120)).success(), "{failpoint} was not come to");
    promised
}

fn request(mesh: &Value, failpoint: &str) -> String {
    let cell = if WITH_CELL.contains(&failpoint) { "e05-transcan" } else { "none" };
    // Long enough to be cancelled.
    let params = if failpoint.starts_with("cancel.") { r#"{"part": {"samples_per_mm2": 2}}"# } else { QUICK };
    format!("{{\"mesh_id\": {}, \"cell\": \"{cell}\", \"params\": {params}}}", mesh["id"])
}

/// Every file is what its name says.
fn assert_whole_files(data: &Path) -> usize {
    let mut files = 0;
    for folder in std::fs::read_dir(data.join("files")).expect("the folder") {
        for file in std::fs::read_dir(folder.expect("an entry").path()).expect("the folder") {
            let path = file.expect("an entry").path();
            let hash: String =
                Sha256::digest(std::fs::read(&path).expect("a file")).iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(Some(hash.as_str()), path.file_name().and_then(|name| name.to_str()));
            files += 1;
        }
    }
    files
}

/// Asserts that every promise holds; the work is done again where nothing was promised.
fn assert_promise_kept(server: &Server, promised: Promised, failpoint: &str) {
    let mesh = match promised.mesh {
        Some(mesh) => {
            assert_eq!(server.get(&format!("/api/v1/meshes/{}", mesh["id"].as_str().expect("an id"))).expect("kept"), mesh);
            mesh
        }
        None => server.upload().expect("a mesh"),
    };
    let jobs = server.get("/api/v1/jobs").expect("a list")["items"].as_array().expect("a list").clone();
    let job = match promised.job {
        Some(job) => {
            assert_eq!(jobs.len(), 1, "{failpoint}");
            job
        }
        // A job whose answer did not come is there whole, or not at all.
        None if !jobs.is_empty() => jobs[0].clone(),
        None => server.post("/api/v1/jobs", &request(&mesh, failpoint)).expect("a job"),
    };
    let id = job["id"].as_str().expect("an id");
    let job = server.ended(id);
    let expected = if failpoint == "cancel.committed" { "cancelled" } else { "succeeded" };
    assert_eq!(job["state"], expected, "{failpoint}: {job}");
    assert_one_end(server, id, expected);
    for file in job["results"].as_array().expect("a list") {
        let path = format!("/api/v1/jobs/{id}/files/{}", file["name"].as_str().expect("a name"));
        let answer = ureq::get(server.url(&path)).call().expect("the file").body_mut().read_to_vec().expect("its bytes");
        // A report has no size before somebody asks for it.
        assert!(file["size_bytes"].as_u64().is_none_or(|size| size == answer.len() as u64), "{file}");
        assert_eq!(file["size_bytes"].is_null(), file["name"] == "report.html", "{file}");
    }
}

/// Asserts that the job ended exactly once.
fn assert_one_end(server: &Server, id: &str, how: &str) {
    let events =
        server.raw(format!("GET /api/v1/jobs/{id}/events HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").as_bytes());
    let ends: usize =
        ["succeeded", "failed", "cancelled"].iter().map(|end| events.matches(&format!("event: {end}\n")).count()).sum();
    assert_eq!((ends, events.matches(&format!("event: {how}\n")).count()), (1, 1), "{events}");
}

fn die_at(failpoint: &str) {
    let data = tempfile::tempdir().expect("a folder");
    let promised = work_until_death(&mut Server::start(data.path(), &[("VANTAGE_FAILPOINT", failpoint)]), failpoint);
    let server = Server::start(data.path(), &[]);
    assert_eq!(std::fs::read_dir(data.path().join("unfinished")).expect("the folder").count(), 0, "{failpoint}");
    assert_promise_kept(&server, promised, failpoint);
    assert!(assert_whole_files(data.path()) > 0);
}

fn die_at_each(of: impl Fn(&str) -> bool) {
    if !failpoints() {
        return;
    }
    let points: Vec<&str> = FAILPOINTS.into_iter().filter(|name| *name != SOMETIMES && of(name)).collect();
    assert!(!points.is_empty());
    for failpoint in points {
        die_at(failpoint);
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn death_in_an_upload_loses_nothing() {
    die_at_each(|name| name.starts_with("upload."));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn death_around_a_job_s_acceptance_loses_nothing() {
    die_at_each(|name| name.starts_with("job."));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn death_in_any_stage_loses_nothing() {
    die_at_each(|name| name.starts_with("stage."));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn death_while_results_are_written_loses_nothing() {
    die_at_each(|name| name.starts_with("artifact.") || name.starts_with("result."));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn death_in_a_cancellation_loses_nothing() {
    die_at_each(|name| name.starts_with("cancel."));
}

#[test]
fn no_point_is_left_out() {
    let groups = ["upload.", "job.", "stage.", "artifact.", "result.", "cancel."];
    assert!(FAILPOINTS.iter().all(|name| groups.iter().any(|group| name.starts_with(group))));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn death_at_any_moment_loses_nothing() {
    // Not at a point but at a time, by the signal that nobody can catch.
    for millis in [5, 40, 120, 300, 700] {
        let data = tempfile::tempdir().expect("a folder");
        let mut server = Server::start(data.path(), &[]);
        let mesh = server.upload().expect("a mesh");
        let ids: Vec<String> =
            (0..3).map(|_| server.submit(&mesh, QUICK).expect("a job")["id"].as_str().expect("an id").to_owned()).collect();
        std::thread::sleep(Duration::from_millis(millis));
        server.signal("KILL");
        server.end(Duration::from_secs(10));
        let server = Server::start(data.path(), &[]);
        for id in ids {
            assert_eq!(server.ended(&id)["state"], "succeeded");
            assert_one_end(&server, &id, "succeeded");
        }
        assert_whole_files(data.path());
    }
}

#[test]
fn a_job_that_kills_every_process_is_given_up() {
    if !failpoints() {
        return;
    }
    let data = tempfile::tempdir().expect("a folder");
    let mut server = Server::start(data.path(), &[("VANTAGE_FAILPOINT", "stage.visibility")]);
    let mesh = server.upload().expect("a mesh");
    let job = server.submit(&mesh, "{}").expect("a job");
    server.end(Duration::from_secs(60));
    for _ in 0..2 {
        Server::start_and_die(data.path(), &[("VANTAGE_FAILPOINT", "stage.visibility")]);
    }
    let server = Server::start(data.path(), &[("VANTAGE_FAILPOINT", "stage.visibility")]);
    let job = server.ended(job["id"].as_str().expect("an id"));
    assert_eq!((&job["state"], &job["problem"]["code"]), (&"failed".into(), &"job_attempts_exhausted".into()), "{job}");
}

#[cfg(not(any(debug_assertions, feature = "failpoints")))]
#[test]
fn a_build_without_failpoints_dies_of_none() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_FAILPOINT", "upload.committed")]);
    server.upload().expect("a mesh");
}
