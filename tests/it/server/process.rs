//! A server process, and a plain client for it.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::http::api::cube;

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
    pub(crate) address: SocketAddr,
}

impl Server {
    /// Starts a server on a free port, with the store in `data`.
    pub(crate) fn start(data: &Path, environment: &[(&str, &str)]) -> Self {
        let mut child = spawn(data, environment);
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("its output")).read_line(&mut line).expect("a line");
        let address = line.trim().rsplit_once("http://").expect("an address").1.parse().expect("an address");
        Self { child, address }
    }

    /// Starts a server that dies of what it finds in its store, and waits for that.
    pub(super) fn start_and_die(data: &Path, environment: &[(&str, &str)]) {
        let address = ([127, 0, 0, 1], 0).into();
        let mut server = Self { child: spawn(data, environment), address };
        assert!(!server.end(Duration::from_secs(60)).success());
    }

    pub(super) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    pub(super) fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).expect("a connection");
        stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
        stream
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

    pub(super) fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
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

fn spawn(data: &Path, environment: &[(&str, &str)]) -> Child {
    let mut command = vantage();
    command.args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(data);
    command.env("VANTAGE_PLANNING__THREADS", "1").envs(environment.iter().copied());
    command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("a process")
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
