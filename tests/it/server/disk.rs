//! A disk of its own for the store, small enough to be filled.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use super::process::{LONG, QUICK, Server};
use crate::http::api::cube;
use crate::support::all_asked;

/// A file system in memory; gone when dropped.
struct Disk {
    folder: tempfile::TempDir,
}

impl Disk {
    /// A disk of so many MiB, where this user may mount one.
    fn mount(mebibytes: u32) -> Option<Self> {
        let folder = tempfile::tempdir().expect("a folder");
        let options = format!("size={mebibytes}m");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &options, "tmpfs"]).arg(folder.path()).output();
        if mounted.is_ok_and(|output| output.status.success()) {
            return Some(Self { folder });
        }
        let may = rustix::process::geteuid().is_root();
        assert!(!(all_asked() && may), "VANTAGE_TESTS=all, but root cannot mount a tmpfs here");
        eprintln!("skipped: a disk that is full needs a tmpfs, which only root may mount");
        None
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    /// Fills it, but for so many bytes.
    fn fill_but(&self, left: u64) {
        let ballast = self.ballast();
        let _ = std::fs::remove_file(&ballast);
        let mut file = std::fs::File::create(&ballast).expect("a file");
        let piece = [0u8; 4096];
        while self.free() > left && std::io::Write::write_all(&mut file, &piece).is_ok() {}
    }

    fn free(&self) -> u64 {
        let about = rustix::fs::statvfs(self.folder.path()).expect("its size");
        about.f_bavail * about.f_frsize
    }

    fn make_room(&self) {
        std::fs::remove_file(self.ballast()).expect("removed");
    }

    fn ballast(&self) -> PathBuf {
        self.folder.path().join("ballast")
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.folder.path()).output();
    }
}

/// Long enough for the disk to be filled meanwhile.
const PARAMS: &str = r#"{"part": {"samples_per_mm2": 4}, "candidates": {"even_directions": 20}}"#;

fn submit(server: &Server, mesh: &str, params: &str) -> (u16, Option<String>, serde_json::Value) {
    let labels: String = (0..8).map(|key| format!("\"k{key}\": \"{}\",", "x".repeat(250))).collect();
    let labels = labels.trim_end_matches(',');
    let body = format!(r#"{{"mesh_id": "{mesh}", "cell": "none", "labels": {{{labels}}}, "params": {params}}}"#);
    server.ask("POST", "/api/v1/jobs", body.as_bytes())
}

fn upload(server: &Server, edge: f64) -> (u16, Option<String>, serde_json::Value) {
    server.ask("POST", "/api/v1/meshes?unit=mm", cube(edge).as_bytes())
}

fn is_ready(server: &Server) -> bool {
    server.ask("GET", "/readyz", b"").0 == 200
}

fn wait_until(what: &str, holds: impl Fn() -> bool) {
    let until = Instant::now() + Duration::from_secs(60);
    while !holds() {
        assert!(Instant::now() < until, "{what}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn below_the_floor_new_work_is_refused_and_what_runs_goes_on() {
    let Some(disk) = Disk::mount(64) else { return };
    let server = Server::start(&disk.data(), &[]);
    let mesh = upload(&server, 60.0).2["id"].as_str().expect("an id").to_owned();
    let (status, _, job) = submit(&server, &mesh, PARAMS);
    assert_eq!(status, 202, "{job}");
    disk.fill_but(2 << 20);
    for _ in 0..3 {
        for (status, retry_after, problem) in [upload(&server, 61.0), submit(&server, &mesh, QUICK)] {
            assert_eq!((status, &problem["code"]), (507, &"storage_full".into()), "{problem}");
            assert!(retry_after.is_some() && problem["detail"].as_str().expect("text").contains("min_free_bytes"), "{problem}");
        }
    }
    assert!(!is_ready(&server));
    assert_eq!(server.ended(job["id"].as_str().expect("an id"))["state"], "succeeded");
    disk.make_room();
    wait_until("it is ready again", || is_ready(&server));
    assert_eq!(upload(&server, 61.0).0, 201);
}

/// Every write meets the full disk itself, as no floor is set.
#[test]
#[ignore = "long: tests/all runs it"]
fn after_a_full_disk_everything_works_again_without_a_restart() {
    let Some(disk) = Disk::mount(48) else { return };
    let server =
        Server::start(&disk.data(), &[("VANTAGE_STORE__MIN_FREE_BYTES", "0"), ("VANTAGE_LIMITS__QUEUED_JOBS", "100000")]);
    let mesh = upload(&server, 60.0).2["id"].as_str().expect("an id").to_owned();
    let (_, _, job) = submit(&server, &mesh, LONG);
    let running = job["id"].as_str().expect("an id");
    wait_until("it runs", || server.job(running)["state"] == "running");
    disk.fill_but(0);
    // The write-ahead log has room for a few until it has to grow.
    let mut accepted = Vec::new();
    let mut refused = 0;
    for attempt in 0..4000 {
        let (status, retry_after, answer) = submit(&server, &mesh, QUICK);
        match status {
            202 => accepted.push(answer["id"].as_str().expect("an id").to_owned()),
            507 | 503 => {
                assert!(retry_after.is_some(), "{answer}");
                refused += 1;
            }
            _ => panic!("attempt {attempt}: {status} {answer}"),
        }
        if refused == 20 {
            break;
        }
    }
    assert_eq!(refused, 20, "the disk was never full");
    assert_eq!(upload(&server, 61.0).0, 507);
    assert!(!is_ready(&server));
    // The job that ran is still there, and is not failed: its results wait for room, and it says so.
    let told = |job: &serde_json::Value| {
        let warnings = job["warnings"].as_array().expect("warnings");
        warnings.iter().any(|warning| warning["code"] == "results_wait")
    };
    wait_until("its results wait", || told(&server.job(running)));
    std::thread::sleep(Duration::from_secs(3));
    let waiting = server.job(running);
    assert!(["running", "queued"].contains(&waiting["state"].as_str().expect("a state")) && told(&waiting), "{waiting}");
    disk.make_room();
    wait_until("it is ready again", || is_ready(&server));
    let ended = server.ended(running);
    assert!(ended["state"] == "succeeded" && !told(&ended), "{ended}");
    assert_eq!(upload(&server, 61.0).0, 201);
    for id in accepted.iter().take(3) {
        assert_eq!(server.ended(id)["state"], "succeeded");
    }
    assert_eq!(submit(&server, &mesh, QUICK).0, 202);
    assert_whole(&disk.data());
}

fn assert_whole(data: &Path) {
    assert!(std::fs::read_dir(data.join("files")).expect("the folder").count() > 0);
}
