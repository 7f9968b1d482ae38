//! A server process, and a plain client for it.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::NamedTempFile;

use crate::http::api::cube;

/// Parameters of a job that takes seconds.
pub(super) const LONG: &str = r#"{"part": {"samples_per_mm2": 60, "patch_edge_mm": 0.5}}"#;

/// Parameters of a job that does not have to take long, in a build for tests either: few views, few samples, a ray each.
pub(super) const QUICK: &str = r#"{"candidates": {"strategies": ["ellipsoid"], "rolls_deg": [0], "step_small_deg": 90, "step_large_deg": 90},
    "part": {"patch_edge_mm": 20, "samples_per_mm2": 0.01}, "visibility": {"engine": "rays"}, "missed": {"remedies": 0},
    "selection": {"max_views": 1}}"#;

/// The program, with nothing of the environment that could change it.
pub(crate) fn vantage() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vantage"));
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("VANTAGE_")) {
        command.env_remove(name);
    }
    command
}

/// A running server; killed when dropped.
pub(crate) struct Server {
    child: Child,
    log: NamedTempFile,
    pub(crate) address: SocketAddr,
}

/// Raises a flag at the end of its scope, also where that is a panic: threads that run until the flag is raised end.
pub(super) struct RaisedAtEnd<'a>(pub(super) &'a AtomicBool);

impl Drop for RaisedAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Server {
    /// Starts a server on a free port, with the store in `data`.
    pub(crate) fn start(data: &Path, environment: &[(&str, &str)]) -> Self {
        Self::listening(spawn(vantage(), data, environment))
    }

    /// Starts a server with a file of settings.
    pub(super) fn start_configured(data: &Path, config: &str) -> Self {
        Self::listening(spawn_with(vantage(), data, &[], &["--config", config]))
    }

    /// Starts a server that may have only so many files open, as the shell's `ulimit` takes it.
    pub(super) fn start_with_open_files(ulimit: &str, data: &Path, environment: &[(&str, &str)]) -> Self {
        let program = vantage();
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("ulimit {ulimit} && exec \"$0\" \"$@\"")]).arg(program.get_program());
        for (name, _) in program.get_envs() {
            shell.env_remove(name);
        }
        Self::listening(spawn(shell, data, environment))
    }

    fn listening((mut child, log): (Child, NamedTempFile)) -> Self {
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("its output")).read_line(&mut line).expect("a line");
        let address = line.trim().rsplit_once("http://").expect("an address").1.parse().expect("an address");
        Self { child, log, address }
    }

    /// Starts a server that dies of what it finds in its store, and waits for that.
    pub(super) fn start_and_die(data: &Path, environment: &[(&str, &str)]) {
        let address = ([127, 0, 0, 1], 0).into();
        let (child, log) = spawn(vantage(), data, environment);
        let mut server = Self { child, log, address };
        assert!(!server.end(Duration::from_secs(60)).success());
    }

    /// Starts a server that refuses its store; what it says on standard error.
    pub(super) fn refusal(data: &Path) -> String {
        let mut command = vantage();
        command.args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(data);
        let output = command.stdin(Stdio::null()).output().expect("a process");
        assert!(!output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    /// Ends it in order.
    pub(super) fn stop(mut self) {
        self.signal("TERM");
        assert!(self.end(Duration::from_secs(60)).success());
    }

    /// The status of a request, its `Retry-After`, and its body; whatever the status is.
    pub(super) fn ask(&self, method: &str, path: &str, body: &[u8]) -> (u16, Option<String>, Value) {
        let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
        let request =
            ureq::http::Request::builder().method(method).uri(self.url(path)).header("content-type", "application/json");
        let mut answer = agent.run(request.body(body.to_vec()).expect("a request")).expect("an answer");
        let retry_after = answer.headers().get("retry-after").map(|value| value.to_str().expect("text").to_owned());
        let bytes = answer.body_mut().with_config().limit(1 << 30).read_to_vec().expect("a body");
        (answer.status().as_u16(), retry_after, serde_json::from_slice(&bytes).unwrap_or(Value::Null))
    }

    /// Log of the server so far.
    pub(super) fn log(&self) -> String {
        std::fs::read_to_string(self.log.path()).expect("the log")
    }

    /// Process id of the server.
    pub(crate) fn process(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    pub(super) fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).expect("a connection");
        stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
        stream
    }

    /// Connects from the loopback address 127.0.0.`last`, as another client.
    pub(super) fn connect_from(&self, last: u8) -> TcpStream {
        use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, connect, socket_with};
        let socket = socket_with(AddressFamily::INET, SocketType::STREAM, SocketFlags::CLOEXEC, None).expect("a socket");
        bind(&socket, &SocketAddr::from(([127, 0, 0, last], 0))).expect("an address of the loopback");
        connect(&socket, &self.address).expect("a connection");
        let stream = TcpStream::from(socket);
        stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
        stream
    }

    /// The answer to a request from 127.0.0.`last`, read to the end of the connection.
    pub(super) fn asked_from(&self, last: u8, method: &str, path: &str, body: &str) -> String {
        let mut stream = self.connect_from(last);
        let length = body.len();
        let head =
            format!("{method} {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n");
        // The server may answer and close before it has all.
        let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body.as_bytes()));
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// Sends `bytes`, and reads until the server closes.
    pub(super) fn raw(&self, bytes: &[u8]) -> String {
        let mut stream = self.connect();
        // The server may close before it has all.
        let _ = stream.write_all(bytes);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    pub(super) fn get(&self, path: &str) -> Result<Value, ureq::Error> {
        json(ureq::get(self.url(path)).call()?)
    }

    pub(super) fn post(&self, path: &str, body: &str) -> Result<Value, ureq::Error> {
        json(ureq::post(self.url(path)).content_type("application/json").send(body)?)
    }

    pub(super) fn upload(&self) -> Result<Value, ureq::Error> {
        json(ureq::post(self.url("/api/v1/meshes?unit=mm&name=cube")).send(cube(60.0))?)
    }

    /// Starts a job on a small part.
    pub(super) fn submit(&self, mesh: &Value, params: &str) -> Result<Value, ureq::Error> {
        self.post("/api/v1/jobs", &format!("{{\"mesh_id\": {}, \"cell\": \"none\", \"params\": {params}}}", mesh["id"]))
    }

    pub(super) fn job(&self, id: &str) -> Value {
        self.get(&format!("/api/v1/jobs/{id}")).expect("the job")
    }

    /// The job once it has ended.
    pub(super) fn ended(&self, id: &str) -> Value {
        for _ in 0..4 {
            let job = self.get(&format!("/api/v1/jobs/{id}?wait=60s")).expect("the job");
            if !job["ended_at"].is_null() {
                return job;
            }
        }
        panic!("{id} does not end: {}", self.job(id));
    }

    /// Waits until the job is in this stage.
    pub(super) fn wait_for_stage(&self, id: &str, stage: &str) {
        let until = Instant::now() + Duration::from_secs(60);
        while self.job(id)["stage"] != stage {
            assert!(Instant::now() < until, "{}", self.job(id));
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Number of the process.
    pub(super) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(super) fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([&format!("-{name}"), &self.id().to_string()]).status();
        assert!(sent.expect("kill").success());
    }

    /// Waits for its end.
    pub(super) fn end(&mut self, within: Duration) -> ExitStatus {
        let until = Instant::now() + within;
        while Instant::now() < until {
            if let Some(status) = self.child.try_wait().expect("its state") {
                return status;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("the server has not ended after {within:?}");
    }
}

fn spawn(command: Command, data: &Path, environment: &[(&str, &str)]) -> (Child, NamedTempFile) {
    spawn_with(command, data, environment, &[])
}

fn spawn_with(mut command: Command, data: &Path, environment: &[(&str, &str)], arguments: &[&str]) -> (Child, NamedTempFile) {
    let log = NamedTempFile::new().expect("a file");
    command.args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(data).args(arguments);
    command.env("VANTAGE_PLANNING__THREADS", "1").envs(environment.iter().copied());
    command.stdout(Stdio::piped()).stderr(log.reopen().expect("the log"));
    (command.spawn().expect("a process"), log)
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn json(mut response: ureq::http::Response<ureq::Body>) -> Result<Value, ureq::Error> {
    let text = response.body_mut().read_to_string()?;
    Ok(serde_json::from_str(&text).expect("JSON"))
}
