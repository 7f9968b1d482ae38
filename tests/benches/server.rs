//! Time in which the server answers while all cores plan: `cargo bench --bench server`. A store of 20 000 meshes, 10 000 jobs and
//! 100 000 files is made first; then 16 clients download its largest result while others read, submit and upload, and 5 000
//! clients send half a request each. Everything runs on this machine, the clients too.
//!
//! `cargo bench --bench server -- jobs` measures jobs a second instead: 100 jobs on parts of 20 000 triangles, queued over HTTP, small
//! ones side by side and, for comparison, one at a time on all threads; then one large job each way.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, Connection as _, SqliteConnection};

const MESHES: usize = 20_000;
const JOBS: usize = 10_000;
const FILES_A_JOB: usize = 10;
const LARGE_BYTES: usize = 62_000_000;
const LOOK_SECS: u64 = 20;

struct Server {
    child: Child,
    address: SocketAddr,
}

impl Server {
    fn start(data: &Path) -> Self {
        Self::start_with(data, &[])
    }

    fn start_with(data: &Path, environment: &[(&str, &str)]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_vantage"));
        command.envs(environment.iter().copied());
        command.args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(data).env("VANTAGE_TELEMETRY__LOG", "error");
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the server");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("its output")).read_line(&mut line).expect("a line");
        let address = line.trim().rsplit_once("http://").expect("an address").1.parse().expect("an address");
        Self { child, address }
    }

    /// Sends a request on a connection of its own; returns status and body.
    fn ask(&self, method: &str, path: &str, headers: &str, body: &[u8]) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(self.address).expect("a connection");
        let length = body.len();
        let head = format!(
            "{method} {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n{headers}content-length: {length}\r\n\r\n"
        );
        stream.write_all(&[head.as_bytes(), body].concat()).expect("a request");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("an answer");
        let end = answer.windows(4).position(|window| window == b"\r\n\r\n").map_or(answer.len(), |at| at + 4);
        let status = String::from_utf8_lossy(&answer[..end]).split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0);
        (status, answer.split_off(end))
    }

    fn json(&self, method: &str, path: &str, body: &str) -> (u16, serde_json::Value) {
        let (status, body) = self.ask(method, path, "content-type: application/json\r\n", body.as_bytes());
        (status, serde_json::from_slice(&body).unwrap_or_default())
    }

    fn stop(mut self) {
        let _ = Command::new("kill").arg(self.child.id().to_string()).status();
        let _ = self.child.wait();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Stores a file under its hash.
fn put(data: &Path, bytes: &[u8]) -> String {
    let name = hex(bytes);
    let folder = data.join("files").join(&name[..2]);
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join(&name), bytes).expect("a file");
    name
}

/// ASCII STL of a patch of triangles, about so many bytes.
fn stl(bytes: usize, seed: f64) -> String {
    let mut text = String::from("solid s\n");
    let mut x = seed;
    while text.len() < bytes {
        x += 1.0;
        text.push_str(&format!(
            "facet normal 0 0 1\nouter loop\nvertex {x} 0 0\nvertex {x} 9 0\nvertex {} 5 1\nendloop\nendfacet\n",
            x + 0.5
        ));
    }
    text + "endsolid s\n"
}

/// Fills a store: the rows that as many uploads and jobs would have left.
fn fill(data: &Path, mesh: &str, job: &str) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let id = |kind: usize, number: usize| format!("0192d3a0-0000-7000-800{kind}-{number:012x}");
    let mut statements = Vec::new();
    for number in 0..MESHES {
        let sha256 = put(data, format!("mesh {number}").as_bytes());
        statements.push(format!(
            "INSERT INTO mesh (id, sha256, unit, name, size_bytes, health) SELECT '{}', '{sha256}', unit, 'm{number}', 10, health FROM mesh WHERE id = '{mesh}'",
            id(1, number)
        ));
    }
    for number in 0..JOBS {
        let new = id(2, number);
        statements.push(format!(
            "INSERT INTO job (id, state, mesh_id, part_number, labels, priority, fraction, attempts, timings, started_at, ended_at, serial, cell, scanner)
             SELECT '{new}', 'succeeded', mesh_id, 'P{}', '{{\"line\": \"{}\"}}', 0, 1, 1, timings, started_at, ended_at, serial, cell, scanner FROM job WHERE id = '{job}'",
            number % 100,
            number % 7
        ));
        statements
            .push(format!("INSERT INTO job_body SELECT '{new}', version, request, input FROM job_body WHERE job_id = '{job}'"));
        statements.push(format!("INSERT INTO job_label VALUES ('line', '{}', '{new}')", number % 7));
        for file in 0..FILES_A_JOB {
            let sha256 = put(data, format!("result {number} {file}").as_bytes());
            statements.push(format!(
                "INSERT INTO artifact (job_id, name, sha256, size_bytes, file_sha256, file_bytes) VALUES ('{new}', 'f{file}', '{sha256}', 14, '{sha256}', 14)"
            ));
        }
    }
    let large: Vec<u8> = (0..LARGE_BYTES).map(|at| b'0' + ((at * at / 7 + at) % 10) as u8).collect();
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(&large).expect("compressed");
    let packed = encoder.finish().expect("compressed");
    let file = put(data, &packed);
    statements.push(format!(
        "UPDATE artifact SET sha256 = '{}', size_bytes = {LARGE_BYTES}, file_sha256 = '{file}', file_bytes = {}, encoding = 'gzip' WHERE job_id = '{job}' AND name = 'coverage.json'",
        hex(&large),
        packed.len()
    ));
    runtime.block_on(async {
        let options = SqliteConnectOptions::new().filename(data.join("vantage.db"));
        let mut connection = SqliteConnection::connect_with(&options).await.expect("the database");
        let mut transaction = connection.begin().await.expect("a transaction");
        for statement in statements {
            sqlx::query(AssertSqlSafe(statement)).execute(&mut *transaction).await.expect("a row");
        }
        transaction.commit().await.expect("filled");
        connection.close().await.expect("closed");
    });
}

/// Prints median, 99th percentile and maximum.
fn report(what: &str, mut times: Vec<Duration>) {
    times.sort();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    println!("{what:<44} {:>6} {:>9.1} {:>9.1} {:>9.1}", times.len(), at(0.5), at(0.99), at(1.0));
}

fn timed(times: &mut Vec<Duration>, work: impl FnOnce()) {
    let began = Instant::now();
    work();
    times.push(began.elapsed());
}

fn reads(server: &Server, until: Instant) -> Vec<Duration> {
    let mut times = Vec::new();
    let paths = [
        "/api/v1/jobs?page_size=50",
        "/api/v1/jobs?label=line=3",
        "/api/v1/jobs?part_number=P7&state=succeeded",
        "/api/v1/meshes",
        "/healthz",
    ];
    for number in 0.. {
        if Instant::now() > until {
            break;
        }
        let path = match number % 4 {
            0 => paths[number / 4 % paths.len()].to_owned(),
            _ => format!("/api/v1/jobs/0192d3a0-0000-7000-8002-{:012x}", number * 37 % JOBS),
        };
        timed(&mut times, || assert_eq!(server.ask("GET", &path, "", b"").0, 200, "{path}"));
        std::thread::sleep(Duration::from_millis(2));
    }
    times
}

/// Jobs that are queued at once, and triangles of their parts.
const QUEUED: usize = 100;
const TRIANGLES: usize = 20_000;

/// Binary STL of a dented ball of about so many triangles, 80 mm across.
fn ball(triangles: usize, dents: f64) -> Vec<u8> {
    let rows = ((triangles / 2) as f64).sqrt() as usize;
    let point = |row: usize, column: usize| {
        let polar = std::f64::consts::PI * row as f64 / rows as f64;
        let azimuth = std::f64::consts::TAU * (column % rows) as f64 / rows as f64;
        let radius = 40.0 + 2.0 * (dents * azimuth).sin() * (4.0 * polar).sin();
        [polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()].map(|at| (radius * at) as f32)
    };
    let quads = (0..rows).flat_map(|row| (0..rows).map(move |column| (row, column)));
    let facets: Vec<[[f32; 3]; 3]> = quads
        .flat_map(|(row, column)| {
            let [a, b, c, d] =
                [(row, column), (row + 1, column), (row + 1, column + 1), (row, column + 1)].map(|(r, c)| point(r, c));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let mut bytes = vec![0; 80];
    bytes.extend(u32::try_from(facets.len()).expect("few").to_le_bytes());
    for facet in &facets {
        bytes.extend([0; 12]);
        bytes.extend(facet.iter().flatten().flat_map(|at| at.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// CPU seconds of a process so far.
fn cpu_secs(process: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    let fields: Vec<&str> = text.rsplit(") ").next().unwrap_or_default().split(' ').collect();
    let ticks = |at: usize| fields.get(at).and_then(|ticks| ticks.parse::<f64>().ok()).unwrap_or_default();
    // User and system time, in hundredths of a second on Linux.
    (ticks(11) + ticks(12)) / 100.0
}

/// Queues jobs, waits for the end of all, and prints jobs a second and the CPU time of a job.
fn throughput(what: &str, environment: &[(&str, &str)], meshes: &[Vec<u8>], jobs: usize, params: &str) {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start_with(data.path(), environment);
    let upload = |mesh: &Vec<u8>| {
        let (status, answer) = server.ask("POST", "/api/v1/meshes?unit=mm", "", mesh);
        assert_eq!(status, 201, "{}", String::from_utf8_lossy(&answer));
        serde_json::from_slice::<serde_json::Value>(&answer).expect("JSON")["id"].as_str().expect("an id").to_owned()
    };
    let meshes: Vec<String> = meshes.iter().map(upload).collect();
    let (began, cpu_before) = (Instant::now(), cpu_secs(server.child.id()));
    let submit = |number: usize| {
        let body =
            format!(r#"{{"mesh_id": "{}", "params": {params}, "labels": {{"n": "{number}"}}}}"#, meshes[number % meshes.len()]);
        let (status, job) = server.json("POST", "/api/v1/jobs", &body);
        assert_eq!(status, 202, "{job}");
        job["id"].as_str().expect("an id").to_owned()
    };
    let ids: Vec<String> = (0..jobs).map(submit).collect();
    let queued_secs = began.elapsed().as_secs_f64();
    for id in &ids {
        let state = || server.json("GET", &format!("/api/v1/jobs/{id}?wait=60s&fields=state"), "").1["state"].clone();
        let mut ended = state();
        while ended == "queued" || ended == "running" {
            ended = state();
        }
        assert_eq!(ended, "succeeded", "{id}");
    }
    let (secs, cpu) = (began.elapsed().as_secs_f64(), cpu_secs(server.child.id()) - cpu_before);
    println!(
        "{what:<44} {jobs:>6} {:>9.2} {:>9.2} {:>9.1} {:>9.2}",
        jobs as f64 / secs,
        cpu / jobs as f64,
        1e3 * queued_secs / jobs as f64,
        secs
    );
    server.stop();
}

/// Jobs a second, small and large, each way.
fn jobs_a_second() {
    let small: Vec<Vec<u8>> = (3..7).map(|dents| ball(TRIANGLES, f64::from(dents))).collect();
    let large = [ball(400_000, 5.0)];
    println!("{:<44} {:>6} {:>9} {:>9} {:>9} {:>9}", "", "jobs", "jobs/s", "CPU s/job", "submit ms", "s in all");
    let each_way = [("side by side", "0"), ("one at a time", "1")];
    for (way, concurrent) in each_way {
        let environment = [("VANTAGE_PLANNING__CONCURRENT_JOBS", concurrent)];
        throughput(&format!("parts of 20 000 triangles, {way}"), &environment, &small, QUEUED, "{}");
    }
    for (way, concurrent) in each_way {
        let environment = [("VANTAGE_PLANNING__CONCURRENT_JOBS", concurrent)];
        throughput(&format!("parts of 400 000 triangles, {way}"), &environment, &large, 3, r#"{"part": {"samples_per_mm2": 8}}"#);
    }
}

fn main() {
    if std::env::args().any(|argument| argument == "jobs") {
        return jobs_a_second();
    }
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path());
    let (status, mesh) = server.json("POST", "/api/v1/meshes?unit=mm", &stl(20_000, 0.0));
    assert_eq!(status, 201, "{mesh}");
    let mesh = mesh["id"].as_str().expect("an id").to_owned();
    let submit = |params: &str, key: usize| {
        let body = format!(r#"{{"mesh_id": "{mesh}", "cell": "none", "params": {params}, "labels": {{"n": "{key}"}}}}"#);
        let (status, job) = server.json("POST", "/api/v1/jobs", &body);
        assert_eq!(status, 202, "{job}");
        job["id"].as_str().expect("an id").to_owned()
    };
    let job = submit(r#"{"candidates": {"even_directions": 20}}"#, 0);
    assert_eq!(server.json("GET", &format!("/api/v1/jobs/{job}?wait=60s"), "").1["state"], "succeeded");
    server.stop();
    fill(data.path(), &mesh, &job);

    println!("{:<44} {:>6} {:>9} {:>9} {:>9}", "milliseconds", "count", "median", "p99", "max");
    starts(data.path());
    let server = Server::start(data.path());
    let submit = |params: &str, key: usize| {
        let body = format!(r#"{{"mesh_id": "{mesh}", "cell": "none", "params": {params}, "labels": {{"n": "{key}"}}}}"#);
        assert_eq!(server.json("POST", "/api/v1/jobs", &body).0, 202);
    };
    submit(r#"{"part": {"samples_per_mm2": 200, "patch_edge_mm": 0.2}}"#, 0);
    std::thread::sleep(Duration::from_secs(3));
    beside_planning(&server, &job, &submit);
    beside_half_sent(&server);
}

/// Starts over a full store.
fn starts(data: &Path) {
    let mut starts = Vec::new();
    for _ in 0..5 {
        let mut server = None;
        timed(&mut starts, || {
            let started = Server::start(data);
            assert_eq!(started.ask("GET", "/readyz", "", b"").0, 200);
            server = Some(started);
        });
    }
    report("start until ready, 120 000 files", starts);
}

/// Reads, submits and uploads while all cores plan and the results of `job` are downloaded.
fn beside_planning(server: &Server, job: &str, submit: &dyn Fn(&str, usize)) {
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..16 {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    let path = format!("/api/v1/jobs/{job}/coverage");
                    assert_eq!(server.ask("GET", &path, "accept-encoding: gzip\r\n", b"").0, 200);
                }
            });
        }
        report("reads, all cores planning, 16 downloads", reads(server, Instant::now() + Duration::from_secs(LOOK_SECS)));
        let mut times = Vec::new();
        (0..200).for_each(|key| timed(&mut times, || submit("{}", key)));
        report("submits, likewise", times);
        let mut times = Vec::new();
        for number in 0..100 {
            let file = stl(1_000_000, f64::from(number) / 7.0);
            timed(&mut times, || assert_eq!(server.ask("POST", "/api/v1/meshes?unit=mm", "", file.as_bytes()).0, 201));
        }
        report("uploads of 1 MB, likewise", times);
        stop.store(true, Ordering::Relaxed);
    });
}

/// Reads while thousands of connections have sent a part of their request.
fn beside_half_sent(server: &Server) {
    let mut slow = Vec::new();
    for _ in 0..5000 {
        let Ok(mut stream) = TcpStream::connect(server.address) else { break };
        let _ = stream.write_all(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nx-slow: ");
        slow.push(stream);
    }
    println!("{} half-sent requests", slow.len());
    report("reads beside them, all cores planning", reads(server, Instant::now() + Duration::from_secs(LOOK_SECS)));
}
