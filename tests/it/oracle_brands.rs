//! Drivers and simulators of robot controllers beside peers that nobody here wrote. Where a peer is a controller, our driver moves it
//! there and back; where it is a client, it moves our simulator, which our drivers move in their unit tests.
//!
//! A public simulator of FANUC RMI (`vertec-io/Fanuc_RMI_API`) is in no package registry, so no test installs it.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use vantage::cell::{KukaRsiSpec, UrControllerSpec};
use vantage::execution::device::{MotionDevice, Target};
use vantage::execution::drivers::kuka_rsi::{KukaArm, KukaRsi};
use vantage::execution::drivers::stream::Wiring;
use vantage::execution::drivers::ur::{UniversalRobots, UrArm};
use vantage::execution::protocol::egm::ExternalAxes;
use vantage::execution::simulators::egm::EgmController;
use vantage::execution::simulators::fanuc_rmi::RmiController;
use vantage::execution::simulators::ur::UrController;

use crate::support::oracle_python;

const WATCHDOG: Duration = Duration::from_millis(500);
/// Time that a peer or a device may take, so that one that stands still fails its test and not the whole suite.
const PATIENCE: Duration = Duration::from_secs(60);
/// Largest distance between what two sides hold for an angle: six decimals on the wire.
const SAME_DEG: f64 = 1e-4;
/// Largest distance between two sides' angles beside RSIPI, which writes hundredths of a degree.
const SAME_HUNDREDTH_DEG: f64 = 0.0051;

/// A peer that runs beside the test, and ends with it.
struct Peer(Child);

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Peer {
    fn start(command: &mut Command) -> (Self, BufReader<ChildStdout>) {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the peer starts");
        let lines = BufReader::new(child.stdout.take().expect("piped"));
        (Self(child), lines)
    }

    fn script(python: &Path, name: &str, argument: &str) -> (Self, BufReader<ChildStdout>) {
        let script = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/oracles")).join(name);
        Self::start(Command::new(python).arg(script).arg(argument))
    }
}

/// The next line of a peer, as numbers.
async fn numbers(mut lines: BufReader<ChildStdout>) -> (Vec<f64>, BufReader<ChildStdout>) {
    let read = tokio::task::spawn_blocking(move || {
        let mut line = String::new();
        lines.read_line(&mut line).expect("a line");
        (line, lines)
    });
    let (line, lines) = tokio::time::timeout(PATIENCE, read).await.expect("a line in time").expect("read");
    assert!(!line.is_empty(), "the peer ended; see its words above");
    (line.split_whitespace().map(|word| word.parse().expect(&line)).collect(), lines)
}

fn free_port() -> u16 {
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").expect("a port");
    socket.local_addr().expect("an address").port()
}

async fn go<const N: usize>(device: &mut impl MotionDevice<N>, sequence: u64, positions_rad: [f64; N]) -> [f64; N] {
    let (max_speed_rad_s, max_acceleration_rad_s2) = ([1.0; N], [5.0; N]);
    let duration = Duration::from_millis(400);
    let target = Target { sequence, positions_rad, max_speed_rad_s, max_acceleration_rad_s2, duration };
    device.start(&target).await.expect("accepted");
    let arrived = async {
        loop {
            device.keep_alive().await.expect("alive");
            if device.state().await.expect("a state").condition.in_position {
                // What is measured lags behind the last set point, by cycles.
                tokio::time::sleep(Duration::from_millis(100)).await;
                return device.state().await.expect("a state").positions_rad;
            }
        }
    };
    tokio::time::timeout(PATIENCE, arrived).await.expect("in position")
}

fn near(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{found:?} for {expected:?}");
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance), "{found:?} for {expected:?}");
}

const RSI_CONFIGURATION: &str = "<ROOT><CONFIG><IP_NUMBER>127.0.0.1</IP_NUMBER><PORT>CLIENT_PORT</PORT><SENTYPE>ImFree</SENTYPE>\
    <ONLYSEND>FALSE</ONLYSEND></CONFIG><SEND><ELEMENTS><ELEMENT TAG=\"DEF_RIst\" TYPE=\"DOUBLE\" INDX=\"INTERNAL\"/>\
    <ELEMENT TAG=\"DEF_AIPos\" TYPE=\"DOUBLE\" INDX=\"INTERNAL\"/><ELEMENT TAG=\"DEF_ASPos\" TYPE=\"DOUBLE\" INDX=\"INTERNAL\"/>\
    <ELEMENT TAG=\"DEF_EIPos\" TYPE=\"DOUBLE\" INDX=\"INTERNAL\"/><ELEMENT TAG=\"DEF_Delay\" TYPE=\"LONG\" INDX=\"INTERNAL\"/>\
    </ELEMENTS></SEND><RECEIVE><ELEMENTS><ELEMENT TAG=\"AKorr.A1\" TYPE=\"DOUBLE\" INDX=\"1\" HOLDON=\"1\"/>\
    <ELEMENT TAG=\"EKorr.E1\" TYPE=\"DOUBLE\" INDX=\"7\" HOLDON=\"1\"/></ELEMENTS></RECEIVE></ROOT>";

/// RSIPI's emulation of a KUKA controller knows corrections by the names `AKorr` and `EKorr` alone, whatever its configuration says,
/// and counts late answers over its whole life; a controller's names are free, and it counts those in a row.
#[tokio::test(flavor = "multi_thread")]
async fn a_kuka_controller_of_rsipi_is_moved_there_and_back() {
    let Some(python) = oracle_python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (port, configuration) = (free_port(), folder.path().join("RSI_EthernetConfig.xml"));
    std::fs::write(&configuration, RSI_CONFIGURATION.replace("CLIENT_PORT", &port.to_string())).expect("written");
    let mut command = Command::new(python);
    command.args(["-m", "RSIPI.rsi_echo_server", "--mode", "absolute", "--delay", "12", "--timeout-packets", "5000"]);
    let (_peer, _lines) = Peer::start(command.arg("--config").arg(&configuration).current_dir(folder.path()));
    let spec = serde_json::json!({
        "address": format!("127.0.0.1:{port}"), "cycle_ms": 12, "axis_tag": "AKorr", "table_tag": "EKorr",
    });
    let spec: KukaRsiSpec = serde_json::from_value(spec).expect("a specification");
    let mut arm: KukaArm<7> = KukaRsi::arm(&spec, Arc::new(()));
    arm.connect().await.expect("connected");
    let start = arm.state().await.expect("a state").positions_rad;
    arm.arm(WATCHDOG).await.expect("armed");
    let goal = [0.1, -0.1, 0.2, -0.2, 0.3, -0.3, 0.4];
    near(&go(&mut arm, 1, goal).await, &goal, SAME_HUNDREDTH_DEG.to_radians());
    near(&go(&mut arm, 2, start).await, &start, SAME_HUNDREDTH_DEG.to_radians());
    let mut sent_at = None;
    let acknowledged_at = arm.stop(&mut sent_at).await.expect("stopped");
    assert!(sent_at.is_some_and(|sent_at| sent_at <= acknowledged_at));
    arm.release().await.expect("released");
}

#[tokio::test(flavor = "multi_thread")]
async fn abb_robot_client_moves_our_abb_controller_there_and_back() {
    let Some(python) = oracle_python() else { return };
    let (port, joints_deg) = (free_port(), [1.0, -10.0, 20.0, 0.0, 30.0, -40.0]);
    let controller = EgmController {
        client: format!("127.0.0.1:{port}").parse().expect("an address"),
        cycle: Duration::from_millis(12),
        comm_timeout: Duration::from_secs(2),
        joints_deg,
        external: ExternalAxes { deg: [90.0, 0.0, 0.0, 0.0, 0.0, 0.0], count: 1 },
    };
    let run = tokio::spawn(async move { controller.run(|_| {}).await.expect("a socket") });
    let (_peer, lines) = Peer::script(&python, "egm_client.py", &port.to_string());
    let (there, lines) = numbers(lines).await;
    near(&there, &[6.0, -10.0, 20.0, 0.0, 30.0, -40.0, 95.0], 1e-9);
    let (back, _) = numbers(lines).await;
    near(&back, &[1.0, -10.0, 20.0, 0.0, 30.0, -40.0, 90.0], 1e-9);
    let session = run.await.expect("its guidance ended by itself");
    assert!(session.guides >= 100 && session.max_step_deg > 0.0, "{session:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn fanuc_ucl_moves_our_fanuc_controller_there_and_back() {
    let Some(python) = oracle_python() else { return };
    // Its port is always 16001: an address of its own keeps it apart.
    let controller = RmiController::bind("127.0.0.43:16001").await.expect("the port");
    let cell = controller.cell();
    tokio::spawn(controller.serve());
    let (_peer, lines) = Peer::script(&python, "fanuc_client.py", "127.0.0.43");
    let (there, lines) = numbers(lines).await;
    near(&there, &[5.0, 10.0, -15.0, 20.0, -25.0, 30.0], SAME_DEG);
    let (back, _) = numbers(lines).await;
    near(&back, &[0.0; 6], SAME_DEG);
    near(&cell.lock().expect("a cell").axes_deg(), &[0.0; 7], SAME_DEG);
}

/// No client of the registries moves a Universal Robots arm without a controller that interprets URScript: this one watches.
#[tokio::test(flavor = "multi_thread")]
async fn ur_rtde_sees_our_driver_move_our_ur_controller_there_and_back() {
    let Some(python) = oracle_python() else { return };
    // The port of its peer is always 30004.
    let controller =
        UrController::bind("127.0.0.44:30004", "127.0.0.44:0", [0.5, -1.5, 1.5, 0.0, 0.5, 0.0]).await.expect("ports");
    let (rtde, script) = controller.addresses().expect("addresses");
    tokio::spawn(controller.serve());
    let (mut peer, mut lines) = Peer::script(&python, "ur_receive.py", "127.0.0.44");
    let is_reading = tokio::task::spawn_blocking(move || {
        let mut line = String::new();
        lines.read_line(&mut line).expect("a line");
        (line.trim() == "reading").then_some(lines)
    });
    let lines = is_reading.await.expect("read").expect("the peer reads the state");
    let spec = serde_json::json!({
        "address": rtde.to_string(), "script_address": script.to_string(), "reverse_address": "127.0.0.1:0", "rate_hz": 125,
    });
    let spec: UrControllerSpec = serde_json::from_value(spec).expect("a specification");
    let mut arm: UrArm = UniversalRobots::arm(&spec, Wiring::over_tcp("arm", Arc::new(())));
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    let start = arm.state().await.expect("a state").positions_rad;
    let goal = start.map(|joint| joint + 0.3);
    near(&go(&mut arm, 1, goal).await, &goal, 1e-5);
    tokio::time::sleep(Duration::from_millis(100)).await;
    near(&go(&mut arm, 2, start).await, &start, 1e-5);
    tokio::time::sleep(Duration::from_millis(100)).await;
    peer.0.stdin.take().expect("piped").write_all(b"\n").expect("told");
    let (seen, _) = numbers(lines).await;
    near(&seen, &[start[0], goal[0], start[0]], 1e-4);
    arm.release().await.expect("released");
}
