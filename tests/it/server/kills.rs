//! Kills at random moments while uploads, submits, cancellations, deletions and retention go on: what was acknowledged
//! holds, and the next process is ready at once.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::process::{QUICK, RaisedAtEnd, Server};
use crate::http::api::cube;
use crate::support::{all_asked, long_asked};

/// Acknowledged changes, over all processes.
#[derive(Default)]
struct Ledger {
    /// Ids and edges of meshes.
    meshes: BTreeMap<String, f64>,
    /// Jobs that nothing may delete, and that have not been asked to be cancelled.
    held: BTreeSet<String>,
    /// Jobs that were cancelled.
    cancelled: BTreeSet<String>,
    /// Jobs whose deletion was acknowledged.
    deleted: BTreeSet<String>,
}

/// SplitMix64 (Steele, Lea and Flood 2014), so that a run can be done again.
struct Random(AtomicU64);

impl Random {
    fn below(&self, bound: u64) -> u64 {
        let mut z = self.0.fetch_add(0x9e37_79b9_7f4a_7c15, Ordering::Relaxed);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % bound
    }
}

/// A request; nothing when the server was killed meanwhile.
fn ask(server: &Server, method: &str, path: &str, body: &[u8]) -> Option<(u16, Value)> {
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
    let request = ureq::http::Request::builder().method(method).uri(server.url(path)).header("content-type", "application/json");
    let mut answer = agent.run(request.body(body.to_vec()).expect("a request")).ok()?;
    let text = answer.body_mut().read_to_string().ok()?;
    Some((answer.status().as_u16(), serde_json::from_str(&text).unwrap_or(Value::Null)))
}

/// Works until told to stop, or the server is gone.
fn work(server: &Server, ledger: &Mutex<Ledger>, random: &Random, stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        let done = match random.below(10) {
            0 | 1 => upload(server, ledger, random),
            2..=4 => submit(server, ledger, random),
            5 => cancel(server, ledger, random),
            6 | 7 => delete(server, ledger),
            8 => ask(server, "POST", "/api/v1/retention", b"").map(drop),
            _ => ask(server, "GET", "/api/v1/jobs?page_size=1000", b"").map(|(status, _)| assert_eq!(status, 200)),
        };
        if done.is_none() {
            return;
        }
    }
}

fn upload(server: &Server, ledger: &Mutex<Ledger>, random: &Random) -> Option<()> {
    let edge = 40.0 + random.below(1000) as f64 / 50.0;
    let (status, mesh) = ask(server, "POST", "/api/v1/meshes?unit=mm", cube(edge).as_bytes())?;
    assert_eq!(status, 201, "{mesh}");
    ledger.lock().expect("the ledger").meshes.insert(mesh["id"].as_str().expect("an id").to_owned(), edge);
    Some(())
}

fn submit(server: &Server, ledger: &Mutex<Ledger>, random: &Random) -> Option<()> {
    let mesh = ledger.lock().expect("the ledger").meshes.keys().next().cloned();
    let Some(mesh) = mesh else { return Some(()) };
    let held = random.below(2) == 0;
    let labels = if held { r#"{"hold": "yes"}"# } else { "{}" };
    let body = format!(r#"{{"mesh_id": "{mesh}", "cell": "none", "params": {QUICK}, "labels": {labels}}}"#);
    let (status, job) = ask(server, "POST", "/api/v1/jobs", body.as_bytes())?;
    assert!([202, 503].contains(&status), "{job}");
    if status == 202 && held {
        ledger.lock().expect("the ledger").held.insert(job["id"].as_str().expect("an id").to_owned());
    }
    Some(())
}

fn cancel(server: &Server, ledger: &Mutex<Ledger>, random: &Random) -> Option<()> {
    let id = {
        let mut ledger = ledger.lock().expect("the ledger");
        // Some are left, so that there are jobs that every kill must keep.
        if ledger.held.len() < 10 {
            return Some(());
        }
        let index = random.below(ledger.held.len() as u64) as usize;
        let Some(id) = ledger.held.iter().nth(index).cloned() else { return Some(()) };
        // From now on it may end either way.
        ledger.held.remove(&id);
        id
    };
    let (status, answer) = ask(server, "POST", &format!("/api/v1/jobs/{id}/cancel"), b"")?;
    match status {
        202 => drop(ledger.lock().expect("the ledger").cancelled.insert(id)),
        409 => drop(ledger.lock().expect("the ledger").held.insert(id)),
        _ => panic!("{status} {answer}"),
    }
    Some(())
}

/// Deletes ended jobs that nothing holds.
fn delete(server: &Server, ledger: &Mutex<Ledger>) -> Option<()> {
    let (_, list) = ask(server, "GET", "/api/v1/jobs?state=succeeded&page_size=20", b"")?;
    let items = list["items"].as_array().cloned().unwrap_or_default();
    for id in items.iter().filter(|job| job["labels"]["hold"].is_null()).take(2).filter_map(|job| job["id"].as_str()) {
        let (status, _) = ask(server, "DELETE", &format!("/api/v1/jobs/{id}"), b"")?;
        if status == 204 {
            ledger.lock().expect("the ledger").deleted.insert(id.to_owned());
        }
    }
    Some(())
}

/// Asserts that what was acknowledged holds: one of `stride` entries of each list, at random, so that the time of a check
/// does not grow with the ledger. What is lost stays lost, so the check after the last kill, of all of them, misses nothing.
fn check(server: &Server, ledger: &Ledger, random: &Random, stride: usize) {
    let state = |id: &str| ask(server, "GET", &format!("/api/v1/jobs/{id}"), b"").expect("an answer");
    let picked = |_: &&String| random.below(stride as u64) == 0;
    for id in ledger.held.iter().filter(picked) {
        let (status, job) = state(id);
        assert_eq!(status, 200, "{id} is lost");
        assert!(["queued", "running", "succeeded"].contains(&job["state"].as_str().expect("a state")), "{job}");
    }
    for id in ledger.cancelled.iter().filter(picked) {
        let (status, job) = state(id);
        assert_eq!((status, &job["state"]), (200, &"cancelled".into()), "{job}");
    }
    for id in ledger.deleted.iter().filter(picked) {
        assert_eq!(state(id).0, 404, "{id} came back");
    }
    for (id, edge) in ledger.meshes.iter().filter(|(id, _)| picked(id)) {
        let mut file = ureq::get(server.url(&format!("/api/v1/meshes/{id}/file"))).call().expect("the file");
        assert!(file.body_mut().read_to_string().expect("text") == cube(*edge), "{id}");
    }
}

fn start(data: &Path) -> (Server, Duration) {
    let began = Instant::now();
    // Jobs are not to blame for these kills: none may be given up as one that crashes the server.
    let attempts = ("VANTAGE_PLANNING__MAX_ATTEMPTS", "100");
    let settings = [("VANTAGE_RETENTION__JOBS_PER_PART", "3"), ("VANTAGE_LIMITS__QUEUED_JOBS", "20"), attempts];
    let server = Server::start(data, &settings);
    server.get("/readyz").expect("ready");
    (server, began.elapsed())
}

/// Waits until this process has planned a job, 20 s at most: were each killed before, the first job would be tried for ever.
fn wait_for_a_plan(server: &Server) {
    let until = Instant::now() + Duration::from_secs(20);
    let has_planned = || {
        let mut metrics = ureq::get(server.url("/metrics")).call().ok()?;
        Some(metrics.body_mut().read_to_string().ok()?.contains("vantage_attempts_total{state=\"succeeded\"}"))
    };
    while Instant::now() < until && has_planned() == Some(false) {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn kills_at_random_moments_lose_nothing_that_was_acknowledged() {
    let kills = if long_asked() {
        1000
    } else if all_asked() {
        20
    } else {
        4
    };
    let data = tempfile::tempdir().expect("a folder");
    let (ledger, random) = (Mutex::new(Ledger::default()), Random(AtomicU64::new(1)));
    let mut slowest = Duration::ZERO;
    for kill in 0..kills {
        let (server, ready) = start(data.path());
        slowest = slowest.max(ready);
        check(&server, &ledger.lock().expect("the ledger"), &random, 1 + kill / 20);
        if kill % 100 == 99 {
            println!("{} of {kills} kills; slowest start {slowest:?}", kill + 1);
        }
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let _raised = RaisedAtEnd(&stop);
            for _ in 0..3 {
                scope.spawn(|| work(&server, &ledger, &random, &stop));
            }
            if kill % 5 == 4 {
                wait_for_a_plan(&server);
            }
            std::thread::sleep(Duration::from_millis(20 + random.below(500)));
            server.signal("KILL");
        });
    }
    let (server, ready) = start(data.path());
    let ledger = ledger.into_inner().expect("the ledger");
    check(&server, &ledger, &random, 1);
    for id in &ledger.held {
        assert_eq!(server.ended(id)["state"], "succeeded");
    }
    let Ledger { meshes, held, cancelled, deleted } = &ledger;
    let [meshes, held, cancelled, deleted] = [meshes.len(), held.len(), cancelled.len(), deleted.len()];
    println!("{kills} kills; none lost of {meshes} meshes, {held} jobs, {cancelled} cancellations, {deleted} deletions");
    println!("slowest start {:?}", slowest.max(ready));
    assert!(meshes > 0 && held > 0);
}
