//! Drivers against devices that others wrote, and simulators against clients that others wrote: Modbus by pymodbus, Han's text
//! commands by libhans and by the maker's own SDK.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use vantage::cell::{GatewayFraming, MinasA6Spec, Presets, SpecLibrary};
use vantage::execution::device::{DeviceError, MotionDevice, TableState, Target};
use vantage::execution::drivers::minas_a6::MinasA6Table;
use vantage::execution::drivers::stream::Wiring;
use vantage::execution::protocol::modbus::ModbusFraming;
use vantage::execution::simulators::hans::HansSimulator;
use vantage::execution::simulators::minas_a6::{DriveSetup, MinasA6Simulator};

use crate::support::{lines_of, oracle_hans, oracle_python};

/// A Python device that ends with the test.
struct Device {
    process: Child,
    port: u16,
}

impl Drop for Device {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Device {
    fn start(python: &Path, framing: GatewayFraming) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracles/minas_a6_peer.py");
        let mut command = Command::new(python);
        command.arg(script).args(["serve", framing.as_str()]).stdout(Stdio::piped());
        let mut process = command.spawn().expect("the device starts");
        let mut line = String::new();
        BufReader::new(process.stdout.take().expect("piped")).read_line(&mut line).expect("a port");
        Self { process, port: line.trim().parse().expect("a port") }
    }
}

fn spec(port: u16, framing: GatewayFraming) -> MinasA6Spec {
    serde_json::from_value(json!({
        "address": format!("tcp://127.0.0.1:{port}"), "framing": framing.as_str(), "units_per_turn": 1_600_000, "gear_ratio": 40,
        "model": "MADLT15SF", "reply_timeout_ms": 1000,
    }))
    .expect("a specification")
}

fn target(sequence: u64, angle_deg: f64) -> Target<1> {
    Target {
        sequence,
        positions_rad: [angle_deg.to_radians()],
        max_speed_rad_s: [1.0],
        max_acceleration_rad_s2: [4.0],
        duration: Duration::from_secs(1),
    }
}

async fn arrive(table: &mut MinasA6Table) -> TableState {
    let arrived = async {
        loop {
            let state = table.state().await.expect("a state");
            if state.condition.in_position {
                return state;
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(10), arrived).await.expect("in position")
}

/// A runtime for one test.
fn block_on<T>(work: impl Future<Output = T>) -> T {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
    runtime.expect("a runtime").block_on(work)
}

#[test]
fn the_table_s_driver_moves_a_device_of_pymodbus_there_and_back() {
    let Some(python) = oracle_python() else { return };
    for framing in GatewayFraming::ALL {
        let device = Device::start(&python, framing);
        block_on(async {
            let wiring = Wiring::over_tcp("table", Arc::new(()));
            let mut table = MinasA6Table::new(spec(device.port, framing), std::f64::consts::PI, wiring);
            let identity = table.connect().await.expect("a drive");
            assert_eq!(identity.model, "MADLT15SF");
            table.arm(Duration::from_millis(500)).await.expect("armed");
            for (sequence, angle) in [(1, 30.0), (2, -15.0)] {
                table.start(&target(sequence, angle)).await.expect("accepted");
                let state = arrive(&mut table).await;
                assert!((state.positions_rad[0].to_degrees() - angle).abs() < 1e-3, "{framing:?}: {state:?}");
            }
            table.start(&target(3, 90.0)).await.expect("accepted");
            let mut sent_at = None;
            let acknowledged_at = table.stop(&mut sent_at).await.expect("acknowledged");
            assert!(sent_at.is_some_and(|sent_at| sent_at <= acknowledged_at), "{framing:?}");
            let rest = table.state().await.expect("a state");
            tokio::time::sleep(Duration::from_millis(200)).await;
            let later = table.state().await.expect("a state");
            assert_eq!(rest.positions_rad, later.positions_rad, "nothing moves");
            assert!(!later.condition.moving && !later.condition.in_position);
            assert!(matches!(table.start(&target(4, 0.0)).await, Err(DeviceError::NotReady { .. })));
            table.release().await.expect("released");
        });
    }
}

/// One line of JSON that a script writes.
fn seen(python: &Path, script: &str, arguments: &[&str]) -> Value {
    let lines = lines_of(python, script, arguments, String::new());
    serde_json::from_str(lines.first().expect("a line")).expect("JSON")
}

#[test]
fn pymodbus_moves_the_simulated_drive_there_and_back() {
    let Some(python) = oracle_python() else { return };
    for (framing, served) in [("rtu", ModbusFraming::Rtu), ("tcp", ModbusFraming::Tcp)] {
        let found = block_on(async {
            let (listener, address) = MinasA6Simulator::listen("127.0.0.1:0").await.expect("a socket");
            let server = tokio::spawn(MinasA6Simulator::new(&DriveSetup::default()).serve(listener, served));
            let (python, port) = (python.clone(), address.port().to_string());
            let ask = move || seen(&python, "minas_a6_peer.py", &["ask", framing, &port]);
            let found = tokio::task::spawn_blocking(ask).await.expect("the client ends");
            server.abort();
            found
        });
        let expected = json!({
            "model": "MADLT15SF", "resolution": 8_388_608, "moved": [[true, 160_000], [true, -1234]], "held": [false, -1234],
            "error": 0, "exception": 2,
        });
        assert_eq!(found, expected, "{framing}");
    }
}

/// Output of the program of `tests/oracles/hans`: words and numbers after each name.
fn told_by_libhans(program: &Path, host: &str) -> BTreeMap<String, Vec<String>> {
    let ended = Command::new(program).arg(host).output().expect("the client starts");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let text = String::from_utf8(ended.stdout).expect("text");
    let lines = text.lines().map(|line| line.split(' ').map(str::to_owned));
    lines.map(|mut words| (words.next().unwrap_or_default(), words.collect())).collect()
}

#[test]
fn libhans_moves_the_simulated_arm_there_and_back() {
    let Some(program) = oracle_hans() else { return };
    let told = block_on(async {
        let robot = Presets.robot("hans-e05").expect("a preset").build().expect("a valid preset");
        let home = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0_f64].map(f64::to_radians);
        // libhans knows one port, so the controller has an address of its own.
        let simulator = HansSimulator::listen("127.0.0.77:10003", robot, home, 1.0).await.expect("a socket");
        let server = tokio::spawn(simulator.serve());
        let ask = move || told_by_libhans(&program, "127.0.0.77");
        let told = tokio::task::spawn_blocking(ask).await.expect("the client ends");
        server.abort();
        told
    });
    let joints = |name: &str| told[name].iter().map(|word| word.parse().expect("a number")).collect::<Vec<f64>>();
    let home = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0];
    for (name, expected) in [("home", home), ("way_point", [20.0, -40.0, 65.0, 15.0, 20.0, 30.0]), ("path", home)] {
        assert!(joints(name).iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-5), "{name}: {told:?}");
    }
    assert_eq!([&told["moving"][0], &told["still"][0]], ["true", "true"], "{told:?}");
    let stopped = joints("stopped");
    assert!(stopped[0] > 0.01 && stopped[0] < 19.99, "stopped on its way: {stopped:?}");
}

/// The SDK is the maker's and lies where the variable says; it is not shipped here, so this is the one test that `tests/all` may skip.
#[test]
fn the_maker_s_sdk_moves_the_simulated_arm_there_and_back() {
    let Some(python) = oracle_python() else { return };
    let Some(sdk) = std::env::var_os("VANTAGE_HANS_SDK") else {
        eprintln!("skipped: VANTAGE_HANS_SDK names no CPS.py of Han's");
        return;
    };
    let found = block_on(async {
        let robot = Presets.robot("hans-e05").expect("a preset").build().expect("a valid preset");
        let home = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0_f64].map(f64::to_radians);
        let simulator = HansSimulator::listen("127.0.0.1:0", robot, home, 1.0).await.expect("a socket");
        let port = simulator.addresses().expect("addresses").text.port().to_string();
        let server = tokio::spawn(simulator.serve());
        let ask = move || seen(&python, "hans_client.py", &[&sdk.to_string_lossy(), &port]);
        let found = tokio::task::spawn_blocking(ask).await.expect("the client ends");
        server.abort();
        found
    });
    let expected = json!({
        "connect": 0, "model": ["hans-e05"], "fsm": ["33"],
        "moved": [[0, [20.0, -10.0, 70.0, 15.0, 30.0, -25.0]], [0, [0.0, -30.0, 60.0, 0.0, 30.0, 0.0]]],
        "busy": [0, 20_004], "stop": 0, "rests": true,
    });
    assert_eq!(found, expected);
}
