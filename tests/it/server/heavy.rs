//! Large answers: given out as they are stored, while everybody else is answered at once.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};

use super::database;
use super::process::{QUICK, RaisedAtEnd, Server};

fn hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// JSON of about so many bytes, which does not compress to nothing.
fn listing(bytes: usize) -> Vec<u8> {
    let mut text = String::with_capacity(bytes + 64);
    text.push_str("{\"faces\": [");
    let mut state = 1u64;
    while text.len() < bytes {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        text.push_str(&format!("{}, ", (state >> 40) as f64 / 1000.0));
    }
    text.push_str("0]}");
    text.into_bytes()
}

/// Puts a large result in the place of a job's `coverage.json`.
fn plant(data: &std::path::Path, job: &str, bytes: &[u8]) {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).expect("compressed");
    let gzip = encoder.finish().expect("compressed");
    let file = hex(&gzip);
    let folder = data.join("files").join(&file[..2]);
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join(&file), &gzip).expect("written");
    database::execute(
        data,
        [format!(
            "UPDATE artifact SET sha256 = '{}', size_bytes = {}, file_sha256 = '{file}', file_bytes = {}, encoding = 'gzip'
             WHERE job_id = '{job}' AND name = 'coverage.json'",
            hex(bytes),
            bytes.len(),
            gzip.len()
        )],
    );
}

#[test]
#[ignore = "long: tests/all runs it"]
fn sixteen_clients_with_the_largest_result_keep_nobody_waiting() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let job = server.submit(&mesh, QUICK).expect("a job")["id"].as_str().expect("an id").to_owned();
    server.ended(&job);
    server.stop();
    let bytes = listing(62_000_000);
    plant(data.path(), &job, &bytes);
    let server = Server::start(data.path(), &[]);
    let url = server.url(&format!("/api/v1/jobs/{job}/coverage"));
    // Without gzip it is the same, unpacked.
    let mut plain = ureq::get(&url).header("accept-encoding", "identity").call().expect("an answer");
    assert_eq!(plain.headers().get("content-length").expect("its length").to_str().expect("a number"), bytes.len().to_string());
    assert!(plain.body_mut().with_config().limit(1 << 30).read_to_vec().expect("a body") == bytes);

    let done = AtomicBool::new(false);
    let slowest = std::thread::scope(|scope| {
        let raised = RaisedAtEnd(&done);
        let clients: Vec<_> = (0..16)
            .map(|_| {
                let path = format!("GET /api/v1/jobs/{job}/coverage HTTP/1.1\r\nhost: localhost\r\naccept-encoding: gzip\r\nconnection: close\r\n\r\n");
                let server = &server;
                scope.spawn(move || {
                    let mut stream = server.connect();
                    stream.write_all(path.as_bytes()).expect("a request");
                    std::io::copy(&mut stream, &mut std::io::sink()).expect("an answer")
                })
            })
            .collect();
        let probe = scope.spawn(|| {
            let mut slowest = Duration::ZERO;
            while !done.load(Ordering::Relaxed) {
                let began = Instant::now();
                server.get("/healthz").expect("an answer");
                slowest = slowest.max(began.elapsed());
                std::thread::sleep(Duration::from_millis(5));
            }
            slowest
        });
        for client in clients {
            assert!(client.join().expect("a client") > 10_000_000);
        }
        drop(raised);
        probe.join().expect("the probe")
    });
    // Compressing that for each would take every thread that answers tens of seconds.
    assert!(slowest < Duration::from_secs(2), "{slowest:?}");
}

#[test]
fn lists_do_not_carry_what_was_asked_for() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let mut cell = server.get("/api/v1/cells/e05-transcan").expect("a cell");
    // A few hundred kilobytes of obstacles a job.
    let obstacle = serde_json::json!({
        "name": "post", "shape": {"kind": "capsule", "radius_mm": 1.0, "length_mm": 1.0},
        "owner_from_body": {"translation_mm": [3000.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    });
    cell["obstacles"] = vec![obstacle; 500].into();
    let body = format!(r#"{{"mesh_id": {}, "cell": {cell}, "priority": -1}}"#, mesh["id"]);
    assert!(body.len() > 50_000);
    for _ in 0..10 {
        let (status, _, answer) = server.ask("POST", "/api/v1/jobs", body.as_bytes());
        assert_eq!(status, 202, "{answer}");
    }
    let list = server.get("/api/v1/jobs").expect("a list");
    assert_eq!(list["items"].as_array().expect("a list").len(), 10);
    assert_eq!(list["items"][0]["cell"], "e05-transcan");
    assert!(list.to_string().len() < 20_000, "{}", list.to_string().len());
    let id = list["items"][0]["id"].as_str().expect("an id");
    assert_eq!(server.job(id)["cell"]["obstacles"].as_array().expect("a list").len(), 500);
}
