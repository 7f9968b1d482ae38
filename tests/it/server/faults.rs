//! One call after the other that writes to the store fails, through the whole life of a job: with a full disk, a broken
//! disk, no file descriptors, a locked file. The server goes on without a restart, keeps what it has acknowledged, and
//! ends each job once. The calls fail in the server's own process, below SQLite (`tests/data/faults.c`).

use std::io::{Seek, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::process::{QUICK, Server};
use crate::http::api::cube;
use crate::support::{all_asked, long_asked};

const ENOSPC: i64 = 28;
const EIO: i64 = 5;
const EMFILE: i64 = 24;
const EAGAIN: i64 = 11;
const EDQUOT: i64 = 122;

/// A server some of whose writes fail.
struct Faulty {
    server: Server,
    control: std::fs::File,
    _folder: tempfile::TempDir,
    data: PathBuf,
}

/// Compiles the library that fails calls.
fn library(folder: &Path) -> Option<PathBuf> {
    let library = folder.join("faults.so");
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/faults.c");
    let compiled = Command::new("cc").args(["-shared", "-fPIC", "-O1", "-o"]).arg(&library).arg(source).arg("-ldl").output();
    match compiled {
        Ok(output) if output.status.success() => Some(library),
        Ok(output) => panic!("{}", String::from_utf8_lossy(&output.stderr)),
        Err(_) => {
            assert!(!all_asked(), "VANTAGE_TESTS=all, but there is no C compiler; run tests/all");
            eprintln!("skipped: failing writes need a C compiler");
            None
        }
    }
}

impl Faulty {
    fn start() -> Option<Self> {
        let folder = tempfile::tempdir().expect("a folder");
        let library = library(folder.path())?;
        let (control, data) = (folder.path().join("control"), folder.path().join("data"));
        std::fs::write(&control, [0; 32]).expect("written");
        let server = Server::start(
            &data,
            &[
                ("LD_PRELOAD", library.to_str().expect("text")),
                ("FAULTS_CONTROL", control.to_str().expect("text")),
                ("FAULTS_FOLDER", data.to_str().expect("text")),
            ],
        );
        let control = std::fs::File::options().read(true).write(true).open(control).expect("the control");
        Some(Self { server, control, _folder: folder, data })
    }

    /// The `nth` call from now on fails with this error; 0 for none.
    fn fail(&mut self, nth: i64, errno: i64) {
        self.control.seek(SeekFrom::Start(0)).expect("the beginning");
        self.control.write_all(&[nth.to_ne_bytes(), errno.to_ne_bytes()].concat()).expect("set");
    }

    /// All that takes room fails with this error from now on; 0 for none.
    fn refuse_room(&mut self, errno: i64) {
        self.control.seek(SeekFrom::Start(24)).expect("the last number");
        self.control.write_all(&errno.to_ne_bytes()).expect("set");
    }

    /// Calls counted so far.
    fn calls(&mut self) -> i64 {
        let bytes = std::fs::read(self.data.with_file_name("control")).expect("the control");
        i64::from_ne_bytes(bytes[16..24].try_into().expect("eight bytes"))
    }

    /// An upload, a job that succeeds, one that is cancelled, and deletions; anything of it may be refused, by 5xx and
    /// never otherwise. Returns the ids of jobs that were acknowledged and not deleted.
    fn life(&self, round: usize) -> Vec<String> {
        let mut jobs = Vec::new();
        let accepted = |(status, _, answer): (u16, Option<String>, Value)| -> Option<Value> {
            assert!((200..300).contains(&status) || [500, 503, 507].contains(&status), "{status} {answer}");
            (200..300).contains(&status).then_some(answer)
        };
        let ask = |method: &str, path: &str, body: &[u8]| accepted(self.server.ask(method, path, body));
        let edge = 50.0 + round as f64 / 1000.0;
        let Some(mesh) = ask("POST", "/api/v1/meshes?unit=mm", cube(edge).as_bytes()) else { return jobs };
        let body = format!(r#"{{"mesh_id": {}, "cell": "none", "params": {QUICK}}}"#, mesh["id"]);
        for cancel in [false, true] {
            let Some(job) = ask("POST", "/api/v1/jobs", body.as_bytes()) else { continue };
            let id = job["id"].as_str().expect("an id").to_owned();
            if cancel {
                let (status, _, answer) = self.server.ask("POST", &format!("/api/v1/jobs/{id}/cancel"), b"");
                // It may have ended before.
                assert!([202, 409, 500, 503, 507].contains(&status), "{status} {answer}");
            }
            jobs.push(id);
        }
        jobs
    }

    /// Everything that was acknowledged is there and ends once; and all works again.
    fn check(&self, jobs: &[String], what: &str) {
        let until = Instant::now() + Duration::from_secs(60);
        while self.server.ask("GET", "/readyz", b"").0 != 200 {
            assert!(Instant::now() < until, "{what}: it is not ready again");
            std::thread::sleep(Duration::from_millis(50));
        }
        for id in jobs {
            let job = self.server.ended(id);
            assert!(["succeeded", "cancelled"].contains(&job["state"].as_str().expect("a state")), "{what}: {job}");
            let request = format!("GET /api/v1/jobs/{id}/events HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n");
            let told = self.server.raw(request.as_bytes());
            let ends: usize =
                ["succeeded", "failed", "cancelled"].iter().map(|end| told.matches(&format!("event: {end}\n")).count()).sum();
            assert_eq!(ends, 1, "{what}: {told}");
            for file in job["results"].as_array().expect("a list") {
                let path = format!("/api/v1/jobs/{id}/files/{}", file["name"].as_str().expect("a name"));
                assert_eq!(self.server.ask("GET", &path, b"").0, 200, "{what}: {path}");
            }
            assert_eq!(self.server.ask("DELETE", &format!("/api/v1/jobs/{id}"), b"").0, 204, "{what}");
        }
    }
}

/// A server of its own goes through a life for every `step`th call, from the `first`, each failing with `errno`.
fn lives_with(errno: i64, first: i64, step: usize) {
    let Some(mut faulty) = Faulty::start() else { return };
    let before = faulty.calls();
    let jobs = faulty.life(0);
    faulty.check(&jobs, "without a fault");
    let calls = faulty.calls() - before;
    assert!(calls > 100, "only {calls} calls were counted");
    let mut round = 0;
    for nth in (first..=calls).step_by(step) {
        round += 1;
        let what = format!("call {nth} of {calls} fails with errno {errno}");
        faulty.fail(nth, errno);
        let jobs = faulty.life(round);
        // What the life itself does not come to is left to what follows it.
        std::thread::sleep(Duration::from_millis(50));
        faulty.fail(0, 0);
        faulty.check(&jobs, &what);
    }
    println!("errno {errno}: {round} of {calls} calls failed, one a life");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn any_write_may_fail_in_any_way_and_nothing_acknowledged_is_lost() {
    // Every call in turn in the longest run; a sample of them otherwise, other ones for each error.
    let step = if long_asked() {
        1
    } else if all_asked() {
        23
    } else {
        97
    };
    std::thread::scope(|scope| {
        for (offset, errno) in [ENOSPC, EIO, EMFILE, EAGAIN].into_iter().enumerate() {
            scope.spawn(move || lives_with(errno, if step == 1 { 1 } else { 1 + offset as i64 * 5 }, step));
        }
    });
}

/// SQLite tells a write that a quota refuses as any that failed: the answer was 503, and nothing could be deleted.
#[test]
fn an_exhausted_quota_is_answered_as_a_full_disk_is() {
    let Some(mut faulty) = Faulty::start() else { return };
    let (_, _, mesh) = faulty.server.ask("POST", "/api/v1/meshes?unit=mm", cube(50.0).as_bytes());
    let job = format!(r#"{{"mesh_id": {}, "cell": "none", "params": {QUICK}}}"#, mesh["id"]);
    let of_mesh = format!("/api/v1/meshes/{}", mesh["id"].as_str().expect("an id"));
    faulty.refuse_room(EDQUOT);
    let other = cube(51.0);
    for (method, path, body) in
        [("POST", "/api/v1/meshes?unit=mm", other.as_str()), ("POST", "/api/v1/jobs", &job), ("DELETE", &of_mesh, "")]
    {
        let (status, retry_after, problem) = faulty.server.ask(method, path, body.as_bytes());
        assert_eq!((status, &problem["code"]), (507, &"storage_full".into()), "{method} {path}: {problem}");
        assert!(retry_after.is_some(), "{method} {path}");
    }
    faulty.refuse_room(0);
    assert_eq!(faulty.server.ask("DELETE", &of_mesh, b"").0, 204);
}
