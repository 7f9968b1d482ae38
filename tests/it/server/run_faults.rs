//! Live runs of a server process on controllers simulated by other processes, which are killed and stopped while arm and table move:
//! what the devices' own watchdogs and the session's limits make of it, on real sockets and clocks.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::process::Server;
use super::runs::{program, running};
use crate::command_line::rehearsal::{Simulator, cell_file};

/// Setting of the drive's watchdog (Pr5.40) in a live run.
const WATCHDOG: Duration = Duration::from_millis(200);
/// Allowance for processes that wait for a core of a machine which runs other tests.
const SCHEDULING: Duration = Duration::from_millis(800);
/// Err80.0, communication time-out: main code 80, sub code 0.
const TIMEOUT_ERROR: u64 = 8000;

/// Returns the state that a simulated controller tells on its control socket.
struct Beside(BufReader<TcpStream>);

impl Beside {
    fn connect(address: SocketAddr) -> Self {
        Self(BufReader::new(TcpStream::connect(address).expect("a control socket")))
    }

    fn state(&mut self) -> Value {
        self.0.get_mut().write_all(b"state\n").expect("taken");
        let mut line = String::new();
        self.0.read_line(&mut line).expect("a line");
        serde_json::from_str(&line).expect("JSON")
    }

    fn is_moving(&mut self) -> bool {
        self.state()["is_moving"] == true
    }

    /// Waits until it moves, or no longer does.
    fn wait(&mut self, moving: bool, within: Duration) {
        let until = Instant::now() + within;
        while self.is_moving() != moving {
            assert!(Instant::now() < until, "it does not {}", if moving { "move" } else { "stop" });
            sleep(Duration::from_millis(2));
        }
    }
}

/// A live run under way: the table turns.
struct Moving {
    data: TempDir,
    server: Server,
    config: String,
    run: String,
    arm: Simulator,
    beside: [Beside; 2],
    table: Simulator,
    is_over: Arc<AtomicBool>,
    heartbeat: Option<JoinHandle<()>>,
}

impl Drop for Moving {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(heartbeat) = self.heartbeat.take() {
            // It ends by itself; its panics are those of requests to a server that is gone.
            let _ = heartbeat.join();
        }
    }
}

/// Renews a lease until told to end, whether the server answers or not.
fn renew(url: String, is_over: Arc<AtomicBool>) -> JoinHandle<()> {
    let agent: ureq::Agent =
        ureq::Agent::config_builder().timeout_global(Some(Duration::from_millis(500))).http_status_as_error(false).build().into();
    spawn(move || {
        while !is_over.load(Ordering::Relaxed) {
            // A server that is stopped or killed does not answer.
            let _ = agent.put(&url).send_empty();
            sleep(Duration::from_millis(200));
        }
    })
}

fn signal(process: u32, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &process.to_string()]).status();
    assert!(sent.expect("kill").success());
}

fn live_run() -> Moving {
    let data = tempfile::tempdir().expect("a folder");
    let control = ["--control", "127.0.0.1:0"];
    let table = Simulator::start(&[&["turntable"][..], &control].concat());
    let arm = Simulator::start(&[&["robot", "--robot", "hans-e05"][..], &control].concat());
    let cell = cell_file(data.path(), &[&arm, &table], 0.1);
    let config = data.path().join("server.toml");
    std::fs::write(&config, format!("[execution]\nlive = true\ncells = [{cell:?}]\n")).expect("a file");
    let config = config.display().to_string();
    let server = Server::start_configured(&data.path().join("data"), &config);
    let job = program(&server);
    let lease = server.post("/api/v1/leases", &json!({"cell": "e05-transcan"}).to_string()).expect("a lease");
    let (id, token) = (lease["id"].as_str().expect("an id"), &lease["token"]);
    let is_over = Arc::new(AtomicBool::new(false));
    let heartbeat = Some(renew(server.url(&format!("/api/v1/leases/{id}")), Arc::clone(&is_over)));
    let order = json!({"job_id": job, "mode": "live"}).to_string();
    let run = server.post(&format!("/api/v1/runs?token={token}"), &order).expect("a run");
    let run = run["id"].as_str().expect("an id").to_owned();
    reaches(&server, &run, "ready");
    let order = json!({"operator": "rehearsal", "cell": "e05-transcan"}).to_string();
    server.post(&format!("/api/v1/runs/{run}/arm?token={token}"), &order).expect("armed");
    running(&server, &run);
    let beside = [&arm, &table].map(|device| Beside::connect(device.control.expect("a control socket")));
    Moving { data, server, config, run, arm, beside, table, is_over, heartbeat }
}

fn reaches(server: &Server, run: &str, state: &str) -> Value {
    let until = Instant::now() + Duration::from_secs(60);
    loop {
        let found = server.get(&format!("/api/v1/runs/{run}")).expect("the run");
        if found["state"] == state {
            return found;
        }
        assert!(Instant::now() < until && found["ended_at"].is_null(), "it is not {state}: {found}");
        sleep(Duration::from_millis(20));
    }
}

fn ended(server: &Server, run: &str) -> Value {
    let until = Instant::now() + Duration::from_secs(60);
    loop {
        let found = server.get(&format!("/api/v1/runs/{run}")).expect("the run");
        if !found["ended_at"].is_null() {
            return found;
        }
        assert!(Instant::now() < until, "it does not end: {found}");
        sleep(Duration::from_millis(20));
    }
}

impl Moving {
    /// Positions of arm and table.
    fn positions(&mut self) -> [Value; 2] {
        self.beside.each_mut().map(|device| device.state()["positions_deg"].clone())
    }

    /// Asserts that both come to rest and stay there.
    fn rests(&mut self) {
        self.beside.iter_mut().for_each(|device| device.wait(false, Duration::from_secs(30)));
        sleep(Duration::from_secs(1));
        let before = self.positions();
        sleep(Duration::from_secs(2));
        assert_eq!(self.positions(), before, "something moves");
    }

    /// Asserts that the drive stops by its own watchdog, counted from when the server fell silent.
    fn table_stops_by_itself(&mut self, silent_since: Instant) {
        let table = &mut self.beside[1];
        let until = silent_since + WATCHDOG + SCHEDULING;
        let error = loop {
            let state = table.state();
            if let Some(error) = state["error"].as_u64() {
                break error;
            }
            assert!(Instant::now() < until, "the watchdog does not act: {state}");
            sleep(Duration::from_millis(2));
        };
        eprintln!("watchdog of {} ms: in error after {:.0} ms", WATCHDOG.as_millis(), silent_since.elapsed().as_secs_f64() * 1e3);
        assert_eq!(error, TIMEOUT_ERROR);
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_killed_server_leaves_the_table_to_its_watchdog_and_the_arm_to_one_move() {
    let mut live = live_run();
    let step = |live: &Moving| live.server.get(&format!("/api/v1/runs/{}", live.run)).expect("the run")["step"].as_u64();
    let until = Instant::now() + Duration::from_secs(60);
    while step(&live) == Some(0) || !live.beside.iter_mut().any(Beside::is_moving) {
        assert!(Instant::now() < until, "nothing moves after the first step");
        sleep(Duration::from_millis(20));
    }
    live.server.signal("KILL");
    live.table_stops_by_itself(Instant::now());
    live.server.end(Duration::from_secs(10));
    live.rests();
    let server = Server::start_configured(&live.data.path().join("data"), &live.config);
    let run = server.get(&format!("/api/v1/runs/{}", live.run)).expect("the run");
    assert_eq!((&run["state"], &run["reason"]), (&json!("stopped"), &json!("server_restarted")), "{run}");
    let record = server.get(&format!("/api/v1/runs/{}/record", live.run)).expect("the record");
    let steps = record["steps"].as_array().expect("steps").len();
    let begun = run["step"].as_u64().expect("a number");
    assert!(begun > 0 && steps as u64 >= begun, "steps that were done outlive the process: {record}");
    live.rests();
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_server_that_stood_still_stops_its_run_and_moves_nothing_more() {
    let mut live = live_run();
    live.beside[1].wait(true, Duration::from_secs(60));
    live.server.signal("STOP");
    live.table_stops_by_itself(Instant::now());
    sleep(Duration::from_secs(3));
    let before = live.positions()[1].clone();
    live.server.signal("CONT");
    let run = ended(&live.server, &live.run);
    assert!(run["state"] == "stopped" || run["state"] == "failed", "{run}");
    live.rests();
    assert_eq!(live.positions()[1], before, "the table moved after the server went on");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_controller_that_stands_still_or_is_killed_stops_the_run() {
    for (name, is_arm) in [("STOP", true), ("KILL", true), ("STOP", false), ("KILL", false)] {
        let mut live = live_run();
        live.beside[usize::from(!is_arm)].wait(true, Duration::from_secs(60));
        let process = if is_arm { &live.arm } else { &live.table }.child.id();
        signal(process, name);
        let run = ended(&live.server, &live.run);
        assert_eq!(run["state"], "stopped", "SIG{name}: {run}");
        let other = &mut live.beside[usize::from(is_arm)];
        other.wait(false, Duration::from_secs(10));
        if name == "STOP" {
            signal(process, "CONT");
            live.rests();
        }
    }
}
