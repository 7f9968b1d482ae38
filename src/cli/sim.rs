//! `vantage sim`: simulated controllers on real sockets and pseudo terminals, to rehearse a whole cell without its hardware.

use std::net::SocketAddr;
use std::sync::Arc;

use serde::Serialize;
use serde_json::{Value, json};
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use super::ranges::{number, whole};
use super::signals::on_signals;
use super::sim_scanner::{self, SimScannerArgs};
use super::{CliError, failed, output, raised_by_signal, serve};
use crate::cell::{Presets, SpecKind, SpecLibrary, did_you_mean};
use crate::execution::protocol::modbus::ModbusFraming;
use crate::execution::simulators::faults::{DeviceLook, Faults};
use crate::execution::simulators::hans::HansSimulator;
use crate::execution::simulators::minas_a6::{DriveSetup, MinasA6Simulator};

/// Simulate a robot controller, a turntable drive or a scanner.
#[derive(Debug, clap::Args)]
#[command(
    arg_required_else_help = true,
    after_help = "Examples:
  vantage sim robot --listen 127.0.0.1:10003 --control 127.0.0.1:9003
  vantage sim turntable --listen 127.0.0.1:1502 --speed 5
  echo 'emergency_stop on' | nc -N 127.0.0.1 9003

`sim robot` and `sim turntable` print their part of the [controllers] section for the cell file. To inject faults, send commands \
to the --control address, one per line: emergency_stop on|off, guard on|off, alarm NUMBER|off, late MS, silent on|off, \
word_order on|off, cut, clear, state. A simulation does not prove that the real device behaves the same."
)]
pub struct SimArgs {
    #[command(subcommand)]
    device: SimulatedDevice,
}

#[derive(Debug, clap::Subcommand)]
enum SimulatedDevice {
    Robot(RobotSimArgs),
    Turntable(TurntableSimArgs),
    Scanner(Box<SimScannerArgs>),
}

/// Protocols of simulated robots.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum RobotProtocol {
    /// Han's CPS.
    Hans,
}

/// Protocols of simulated tables.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
#[value(rename_all = "snake_case")]
enum TableProtocol {
    /// Panasonic MINAS A6, block operation.
    MinasA6,
}

/// Arguments that every simulator takes.
#[derive(Debug, clap::Args)]
struct CommonSimArgs {
    /// Address and port to listen on; port 0 picks a free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0", value_parser = socket_address)]
    listen: SocketAddr,
    /// Address and port that take fault commands, and `state` to query the device [default: none].
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = socket_address)]
    control: Option<SocketAddr>,
    /// Simulated seconds per second, 0.1 to 100.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
}

/// Run a simulated robot controller.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  vantage sim robot --listen 127.0.0.1:10003 --control 127.0.0.1:9003")]
struct RobotSimArgs {
    /// Protocol of the controller.
    #[arg(long, value_enum, default_value_t = RobotProtocol::Hans)]
    protocol: RobotProtocol,
    /// Robot: a preset name.
    #[arg(long, default_value = "hans-e05")]
    robot: String,
    /// Angles of joints 1 to 6 at the start, degrees, comma-separated.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, default_value = "0,-30,60,0,30,0", value_parser = number)]
    joints: Vec<f64>,
    #[command(flatten)]
    common: CommonSimArgs,
}

/// Run a simulated turntable drive.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage sim turntable --listen 127.0.0.1:1502 --speed 5
  vantage sim turntable --pty")]
struct TurntableSimArgs {
    /// Protocol of the drive.
    #[arg(long, value_enum, default_value_t = TableProtocol::MinasA6)]
    protocol: TableProtocol,
    /// Use a pseudo-terminal, as a serial line, instead of a socket.
    #[arg(long, conflicts_with = "listen")]
    pty: bool,
    /// Use Modbus TCP frames instead of those of a serial line.
    #[arg(long, conflicts_with = "pty")]
    modbus_tcp: bool,
    /// Command units per turn of the table, 1000 to 2147483647.
    #[arg(long, default_value_t = 1_600_000, value_parser = whole::<u32>(1000..=2_147_483_647))]
    units_per_turn: u32,
    /// Motor turns per turn of the table, 1 to 512.
    #[arg(long, default_value_t = 40, value_parser = whole::<u16>(1..=512))]
    gear_ratio: u16,
    /// Rotate without end: positions repeat after every turn.
    #[arg(long)]
    infinite_rotation: bool,
    #[command(flatten)]
    common: CommonSimArgs,
}

fn socket_address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| "give ADDRESS:PORT, an IP address and a port, as in 127.0.0.1:10003".to_owned())
}

/// Factor of time.
fn speed(text: &str) -> Result<f64, String> {
    let factor = text.trim_start_matches(['×', 'x']).parse::<f64>().ok().filter(|factor| (0.1..=100.0).contains(factor));
    factor.ok_or_else(|| format!("is {text}; allowed is 0.1 to 100"))
}

/// Addresses of a simulator, as `--json` prints them.
#[derive(Debug, Serialize)]
struct SimulatorAddress {
    address: String,
    control: Option<SocketAddr>,
    controllers: Value,
    /// Section `controllers.arm.servo`, with which set points are streamed.
    servo: Option<Value>,
}

/// Runs the command until SIGTERM or ctrl-c.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &SimArgs) -> Result<(), CliError> {
    match &args.device {
        SimulatedDevice::Robot(args) => serve::run_to_completion(run_robot(args)),
        SimulatedDevice::Turntable(args) => serve::run_to_completion(run_turntable(args)),
        SimulatedDevice::Scanner(args) => sim_scanner::run(args, &*raised_by_signal()?),
    }
}

async fn run_robot(args: &RobotSimArgs) -> Result<(), CliError> {
    let RobotProtocol::Hans = args.protocol;
    let known = Presets.names(SpecKind::Robot);
    let unknown = |_| {
        let meant = did_you_mean(&args.robot, known.iter().map(String::as_str));
        let presets = known.join(", ");
        CliError::BadInput(format!("--robot {}: no such preset; the presets are {presets}{meant}", args.robot))
    };
    let robot = Presets.robot(&args.robot).map_err(unknown)?.build();
    let robot = robot.map_err(|found| CliError::Failed(format!("robot {}: {found:?}", args.robot)))?;
    let joints_rad: [f64; 6] = <[f64; 6]>::try_from(args.joints.as_slice())
        .map_err(|_| CliError::BadInput("--joints: give six numbers, as in 0,-30,60,0,30,0".into()))?
        .map(f64::to_radians);
    if !robot.joints.iter().zip(joints_rad).all(|(joint, angle)| joint.allows(angle)) {
        return Err(CliError::BadInput("--joints: not within the robot's limits".into()));
    }
    let address = args.common.listen.to_string();
    let simulator = HansSimulator::listen(&address, robot, joints_rad, args.common.speed).await;
    let simulator = simulator.map_err(|error| failed(&format!("--listen {address}"), &error))?;
    let addresses = simulator.addresses().map_err(|error| failed("--listen", &error))?;
    let control = control(&args.common, simulator.faults(), simulator.look()).await?;
    let text = addresses.text.to_string();
    let servo = json!({ "address": addresses.servo.to_string(), "state_address": addresses.realtime.to_string() });
    announce(text.clone(), control, arm_section(&text, &args.robot), Some(servo))?;
    until_signal(simulator.serve()).await
}

async fn run_turntable(args: &TurntableSimArgs) -> Result<(), CliError> {
    let TableProtocol::MinasA6 = args.protocol;
    let simulator = MinasA6Simulator::new(&DriveSetup {
        units_per_turn: args.units_per_turn,
        gear_ratio: args.gear_ratio.into(),
        has_infinite_rotation: args.infinite_rotation,
        factor: args.common.speed,
        ..DriveSetup::default()
    });
    let control = control(&args.common, simulator.faults(), simulator.look()).await?;
    if args.pty {
        let line = MinasA6Simulator::pseudo_terminal().map_err(|error| failed("--pty", &error))?;
        announce(line.path.clone(), control, table_section(&line.path, args), None)?;
        return until_signal(simulator.serve_line(line.stream)).await;
    }
    let asked = args.common.listen.to_string();
    let listening = MinasA6Simulator::listen(&asked).await;
    let (listener, address) = listening.map_err(|error| failed(&format!("--listen {asked}"), &error))?;
    let address = format!("tcp://{address}");
    announce(address.clone(), control, table_section(&address, args), None)?;
    let framing = if args.modbus_tcp { ModbusFraming::Tcp } else { ModbusFraming::Rtu };
    until_signal(simulator.serve(listener, framing)).await
}

/// Section of a cell file for an arm.
fn arm_section(address: &str, robot: &str) -> Value {
    json!({ "arm": { "protocol": "hans", "address": address, "model": robot } })
}

/// Section of a cell file for a table.
fn table_section(address: &str, args: &TurntableSimArgs) -> Value {
    json!({ "table": {
        "protocol": "minas_a6",
        "address": address,
        "framing": if args.modbus_tcp { "tcp" } else { "rtu" },
        "units_per_turn": args.units_per_turn,
        "gear_ratio": args.gear_ratio,
        "has_infinite_rotation": args.infinite_rotation,
    }})
}

/// Opens the control socket, if one is asked for, and serves it; its address.
async fn control(
    args: &CommonSimArgs,
    faults: Arc<Faults>,
    look: impl Fn() -> DeviceLook + Send + Sync + 'static,
) -> Result<Option<SocketAddr>, CliError> {
    let Some(asked) = args.control else { return Ok(None) };
    let refused = |error: std::io::Error| failed(&format!("--control {asked}"), &error);
    let listener = TcpListener::bind(asked).await.map_err(refused)?;
    let address = listener.local_addr().map_err(refused)?;
    tokio::spawn(async move { faults.serve(listener, look).await });
    Ok(Some(address))
}

/// Prints where it listens, and the section of a cell file; what streams set points in comments, since programs are sent without.
fn announce(address: String, control: Option<SocketAddr>, controllers: Value, servo: Option<Value>) -> Result<(), CliError> {
    let toml = |section: Value| toml::to_string(&section).map_err(|error| failed("the section", &error));
    let section = toml(json!({ "controllers": controllers }))?;
    let streaming = match &servo {
        Some(servo) => {
            let lines = toml(json!({ "controllers": { "arm": { "servo": servo } } }))?;
            lines.lines().fold("\n# To stream set points instead:\n".to_owned(), |text, line| text + "# " + line + "\n")
        }
        None => String::new(),
    };
    // Prose as comments of TOML, so that the whole output can be appended to a cell file.
    let faults = control.map_or_else(String::new, |control| format!("# Faults are set on {control}\n"));
    let words = format!("# Simulated controller listens on {address}\n{faults}# For the cell file:\n\n{section}{streaming}");
    output::result(&SimulatorAddress { address, control, controllers, servo }, words)
}

/// Serves until SIGTERM or ctrl-c.
async fn until_signal(served: impl Future<Output = ()>) -> Result<(), CliError> {
    let ends = CancellationToken::new();
    let ended = ends.clone();
    on_signals(move |_| ends.cancel(), None)?;
    tokio::select! {
        () = ended.cancelled() => Ok(()),
        () = served => Err(CliError::Failed("the simulator's line or socket ended".into())),
    }
}

#[cfg(test)]
mod tests;
