//! The driver against the simulated drive: on sockets of this machine, as a gateway has them, and on a pseudo terminal.

use std::sync::Arc;

use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::*;
use crate::execution::device::{Direction, STOP_ATTEMPT, WireLog};
use crate::execution::protocol::minas_a6::ERROR_TIMEOUT;
use crate::execution::simulators::faults::{FaultCommand, Faults};
use crate::execution::simulators::minas_a6::{DriveSetup, MinasA6Simulator};
use crate::execution::tests::simulated_network::{NetworkDialer, Passage, RoughNetwork};

const WATCHDOG: Duration = Duration::from_millis(200);
/// 180°/s², the rating of the table that the presets describe.
const RATED_RAD_S2: f64 = std::f64::consts::PI;

struct Bench {
    table: MinasA6Table,
    faults: Arc<Faults>,
    position: Box<dyn Fn() -> f64 + Send>,
    server: JoinHandle<()>,
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.server.abort();
    }
}

fn spec(address: &str) -> MinasA6Spec {
    let spec = serde_json::json!({"address": address, "units_per_turn": 1_600_000, "gear_ratio": 40, "model": "MADLT15"});
    serde_json::from_value(spec).expect("a specification")
}

async fn on_socket(framing: GatewayFraming, setup: DriveSetup) -> Bench {
    let simulator = MinasA6Simulator::new(&setup);
    let (listener, address) = MinasA6Simulator::listen("127.0.0.1:0").await.expect("a socket");
    let (faults, position) = (simulator.faults(), Box::new(simulator.position()));
    let served = match framing {
        GatewayFraming::Rtu => ModbusFraming::Rtu,
        GatewayFraming::Tcp => ModbusFraming::Tcp,
    };
    let mut spec = spec(&format!("tcp://{address}"));
    (spec.framing, spec.has_infinite_rotation) = (framing, setup.has_infinite_rotation);
    let table = MinasA6Table::new(spec, RATED_RAD_S2, Wiring::over_tcp("table", Arc::new(())));
    Bench { table, faults, position, server: tokio::spawn(simulator.serve(listener, served)) }
}

async fn ready(framing: GatewayFraming, setup: DriveSetup) -> Bench {
    let mut bench = on_socket(framing, setup).await;
    bench.table.connect().await.expect("a drive");
    bench.table.arm(WATCHDOG).await.expect("armed");
    bench
}

/// A table behind a gateway on a simulated network.
fn on_network(spec: MinasA6Spec, simulator: &MinasA6Simulator, log: Arc<dyn WireLog>) -> (MinasA6Table, Arc<RoughNetwork>) {
    let served = simulator.clone();
    let network = RoughNetwork::new(1, move |end| {
        let served = served.clone();
        tokio::spawn(async move { served.talk(end, ModbusFraming::Rtu).await });
    });
    let wiring = Wiring { dialer: Arc::new(NetworkDialer(Arc::clone(&network))), log, device: "table" };
    (MinasA6Table::new(spec, RATED_RAD_S2, wiring), network)
}

/// A log that makes the drive's answer to servo-on a late one.
struct LateServoOn(Arc<Faults>);

impl WireLog for LateServoOn {
    fn record(&self, _device: &'static str, direction: Direction, bytes: &[u8]) {
        let servo_on = ModbusRequest::WriteCoil { address: coil::SERVO_ON, on: true }.pdu();
        if direction == Direction::Sent && bytes.windows(servo_on.len()).any(|part| part == servo_on) {
            self.0.apply(FaultCommand::Late(Duration::from_millis(150)));
        }
    }
}

async fn usual() -> Bench {
    ready(GatewayFraming::Rtu, DriveSetup::default()).await
}

fn target(sequence: u64, angle_deg: f64, speed_deg_s: f64) -> Target<1> {
    Target {
        sequence,
        positions_rad: [angle_deg.to_radians()],
        max_speed_rad_s: [speed_deg_s.to_radians()],
        max_acceleration_rad_s2: [360_f64.to_radians()],
        duration: Duration::from_secs(1),
    }
}

impl Bench {
    async fn arrive(&mut self) -> TableState {
        let arrived = async {
            loop {
                let state = self.table.state().await.expect("a state");
                if state.condition.in_position {
                    return state;
                }
                sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(Duration::from_secs(8), arrived).await.expect("in position")
    }

    /// Turns to an angle and back; what the table really did is compared too.
    async fn there_and_back(&mut self, angle_deg: f64) {
        let home = (self.position)();
        for (sequence, angle) in [(1, angle_deg), (2, 0.0)] {
            self.table.start(&target(sequence, angle, 120.0)).await.expect("accepted");
            let state = self.arrive().await;
            assert!((state.positions_rad[0].to_degrees() - angle).abs() < 1e-3, "{state:?}");
            let turned_deg = ((self.position)() - home) / 1_600_000.0 * 360.0;
            assert!((turned_deg - angle).abs() < 1e-3, "{turned_deg}");
        }
    }

    async fn resting(&self) -> f64 {
        sleep(Duration::from_millis(400)).await;
        let position = (self.position)();
        sleep(Duration::from_millis(300)).await;
        assert_eq!((self.position)(), position, "nothing moves");
        position / 1_600_000.0 * 360.0
    }
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn the_table_goes_there_and_back_behind_either_gateway() {
    for framing in GatewayFraming::ALL {
        let mut bench = ready(framing, DriveSetup::default()).await;
        bench.there_and_back(40.0).await;
        bench.table.release().await.expect("released");
        assert!(matches!(bench.table.state().await, Err(DeviceError::Closed { .. })));
        // Given back: the servo is off and the time-out is that found.
        let identity = bench.table.connect().await.expect("a drive");
        assert_eq!((identity.maker.as_str(), identity.model.as_str()), ("Panasonic", "MADLT15SF"));
        assert!(!bench.table.state().await.expect("a state").condition.powered);
        assert_eq!(bench.table.value(COMMUNICATION_TIMEOUT).await, Ok(0));
    }
}

#[cfg(unix)]
#[tokio::test]
async fn the_table_goes_there_and_back_on_a_serial_line() {
    let simulator = MinasA6Simulator::new(&DriveSetup::default());
    let line = MinasA6Simulator::pseudo_terminal().expect("a pseudo terminal");
    let (faults, position) = (simulator.faults(), Box::new(simulator.position()));
    // The line runs in real time: a busy machine may hand bytes over late.
    let spec = MinasA6Spec { parity: crate::cell::SerialParity::None, reply_timeout_ms: 1000, ..spec(&line.path) };
    let table = MinasA6Table::new(spec, RATED_RAD_S2, Wiring::over_tcp("table", Arc::new(())));
    let mut bench = Bench { table, faults, position, server: tokio::spawn(simulator.serve_line(line.stream)) };
    bench.table.connect().await.expect("a drive");
    bench.table.arm(WATCHDOG).await.expect("armed");
    bench.there_and_back(25.0).await;
}

#[tokio::test]
async fn nothing_moves_after_a_stop_and_only_arming_starts_again() {
    let mut bench = usual().await;
    bench.table.start(&target(1, 170.0, 60.0)).await.expect("accepted");
    sleep(Duration::from_millis(150)).await;
    bench.table.stop(&mut None).await.expect("acknowledged");
    let rest = bench.resting().await;
    assert!((2.0..100.0).contains(&rest), "stopped on the way: {rest}");
    assert!(matches!(bench.table.start(&target(2, 0.0, 60.0)).await, Err(DeviceError::NotReady { .. })));
    // The stop coil holds even a start by somebody else. The time-out may have struck by now.
    let link = bench.table.link().expect("open");
    link.set_coil(coil::STROBE, true).await.expect("written");
    assert_eq!(bench.resting().await, rest);
}

#[tokio::test]
async fn a_stopped_table_is_armed_and_moved_again() {
    let mut bench = usual().await;
    bench.table.start(&target(1, 170.0, 60.0)).await.expect("accepted");
    bench.table.stop(&mut None).await.expect("acknowledged");
    while bench.table.state().await.expect("a state").condition.moving {}
    bench.table.arm(WATCHDOG).await.expect("armed");
    bench.table.start(&target(2, 0.0, 60.0)).await.expect("accepted");
    let state = bench.arrive().await;
    assert!(state.positions_rad[0].abs() < 1e-5);
}

#[tokio::test]
async fn the_drive_stops_by_itself_when_messages_cease() {
    let mut bench = usual().await;
    bench.table.start(&target(1, 170.0, 30.0)).await.expect("accepted");
    let before = (bench.position)();
    // As if this process were gone: nothing is sent for a second.
    sleep(Duration::from_secs(1)).await;
    let turned = ((bench.position)() - before) / 1_600_000.0 * 360.0;
    // 200 ms at 30 degrees a second, and the ramp.
    assert!((1.0..8.0).contains(&turned), "{turned}");
    let state = bench.table.state().await.expect("a state");
    assert_eq!(state.condition.fault, Some(FaultCode(ERROR_TIMEOUT)));
    assert!(!state.condition.moving && !state.condition.powered);
    let error = bench.table.arm(WATCHDOG).await.expect_err("a fault");
    assert!(matches!(&error, DeviceError::Fault { code: ERROR_TIMEOUT, text } if text.contains("Err80.0")), "{error}");
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn faults_show_in_the_state_stop_the_table_and_keep_it_from_being_armed() {
    for (fault, shows) in [
        (FaultCommand::EmergencyStop(true), (|condition| condition.emergency_stop) as fn(Condition) -> bool),
        (FaultCommand::Guard(true), |condition| condition.guard_open),
        (FaultCommand::Alarm(Some(2400)), |condition| condition.fault == Some(FaultCode(2400))),
    ] {
        let mut bench = usual().await;
        bench.table.start(&target(1, 170.0, 60.0)).await.expect("accepted");
        bench.faults.apply(fault);
        let rest = bench.resting().await;
        let state = bench.table.state().await.expect("a state");
        assert!(shows(state.condition) && !state.condition.powered, "{fault:?}: {:?}", state.condition);
        assert!(matches!(bench.table.arm(WATCHDOG).await, Err(DeviceError::Fault { .. })), "{fault:?}");
        assert_eq!(bench.resting().await, rest);
    }
}

#[tokio::test]
async fn silence_and_lateness_are_told_and_a_late_answer_is_not_taken_for_another() {
    for framing in GatewayFraming::ALL {
        let mut bench = ready(framing, DriveSetup::default()).await;
        bench.faults.apply(FaultCommand::Silent(true));
        assert_eq!(bench.table.state().await, Err(DeviceError::Silent { waited: Duration::from_millis(100) }));
        bench.faults.apply(FaultCommand::Late(Duration::from_millis(150)));
        bench.faults.apply(FaultCommand::Silent(false));
        assert!(matches!(bench.table.state().await, Err(DeviceError::Silent { .. })));
        bench.faults.apply(FaultCommand::Clear);
        sleep(Duration::from_millis(200)).await;
        // Given up before anything came, and asked anew at once.
        assert!(timeout(Duration::ZERO, bench.table.is_busy()).await.is_err());
        let registers = bench.table.link().expect("open").registers(register::MODEL, 8).await.expect("registers");
        assert_eq!(text_of(&registers), "MADLT15SF");
    }
}

/// The network was to be checked, and the cell file was wrong.
#[tokio::test]
async fn a_gateway_with_other_frames_than_configured_is_told_with_the_field_to_check() {
    for (served, configured) in [(GatewayFraming::Tcp, GatewayFraming::Rtu), (GatewayFraming::Rtu, GatewayFraming::Tcp)] {
        let mut bench = on_socket(served, DriveSetup::default()).await;
        bench.table.spec.framing = configured;
        let told = bench.table.connect().await.expect_err("other frames").to_string();
        let wanted = format!("; check framing and node in the cell file too, now {} and 1", configured.as_str());
        assert!(told.ends_with(&wanted), "{told}");
    }
}

#[tokio::test]
async fn the_other_order_of_words_is_found_at_connect_and_can_be_configured() {
    let mut bench = on_socket(GatewayFraming::Rtu, DriveSetup::default()).await;
    bench.faults.apply(FaultCommand::WordOrder(true));
    let error = bench.table.connect().await.expect_err("swapped words");
    assert!(matches!(&error, DeviceError::WordOrder { other, .. } if other == "high_first"), "{error}");
    bench.table.spec.word_order = WordOrder::HighFirst;
    bench.table.connect().await.expect("a drive");
    bench.table.arm(WATCHDOG).await.expect("armed");
    bench.there_and_back(15.0).await;
}

#[tokio::test]
async fn a_link_that_is_cut_on_the_way_still_takes_a_stop() {
    let mut bench = usual().await;
    bench.table.start(&target(1, 170.0, 60.0)).await.expect("accepted");
    bench.faults.apply(FaultCommand::Cut);
    sleep(Duration::from_millis(20)).await;
    assert!(matches!(bench.table.state().await, Err(DeviceError::Closed { .. })));
    bench.table.stop(&mut None).await.expect("acknowledged over a new connection");
    let rest = bench.resting().await;
    assert!(rest < 100.0, "{rest}");
}

#[tokio::test(start_paused = true)]
async fn a_stop_gets_past_a_half_open_link_and_an_answer_that_is_owed_within_an_attempt() {
    let simulator = MinasA6Simulator::new(&DriveSetup::default());
    let spec = MinasA6Spec { reply_timeout_ms: 1000, ..spec("tcp://table:502") };
    let (mut table, network) = on_network(spec, &simulator, Arc::new(()));
    table.connect().await.expect("a drive");
    table.arm(WATCHDOG).await.expect("armed");
    table.start(&target(1, 170.0, 60.0)).await.expect("accepted");
    // What is sent over the link that there is is lost from here on: an answer is owed, and never comes.
    network.set_passage(Passage::Lost);
    assert!(timeout(Duration::from_millis(10), table.is_busy()).await.is_err());
    network.set_passage(Passage::Open);
    let (asked_at, mut sent_at) = (Instant::now(), None);
    let stopped = timeout(STOP_ATTEMPT, table.stop(&mut sent_at)).await.expect("within an attempt");
    let acknowledged_at = stopped.expect("acknowledged over a new link");
    // The request that was lost went out too, and is told.
    let sent_at = sent_at.expect("sent");
    assert!(sent_at < asked_at + STOP_WAIT && acknowledged_at >= asked_at + STOP_WAIT, "{:?}", sent_at - asked_at);
}

#[tokio::test(start_paused = true)]
async fn a_servo_that_comes_on_by_a_command_without_an_answer_is_switched_off_at_release() {
    let simulator = MinasA6Simulator::new(&DriveSetup::default());
    let log = Arc::new(LateServoOn(simulator.faults()));
    let (mut table, _network) = on_network(spec("tcp://table:502"), &simulator, log);
    table.connect().await.expect("a drive");
    assert!(matches!(table.arm(WATCHDOG).await, Err(DeviceError::Silent { .. })), "answered too late");
    simulator.faults().apply(FaultCommand::Late(Duration::ZERO));
    table.stop(&mut None).await.expect("stopped, as a session does before it gives back");
    table.release().await.expect("released");
    table.connect().await.expect("again");
    sleep(Duration::from_secs(1)).await;
    assert!(!table.state().await.expect("a state").condition.powered);
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn without_end_stops_a_move_is_the_one_asked_for_and_not_the_shorter() {
    // Begins 10 degrees before the turn's end, as positions repeat: angle −10.
    let setup = DriveSetup { has_infinite_rotation: true, position: 1_600_000 - 44_444, ..DriveSetup::default() };
    let mut bench = ready(GatewayFraming::Tcp, setup).await;
    let start = bench.table.state().await.expect("a state").positions_rad[0].to_degrees();
    assert!((start + 10.0).abs() < 1e-3, "{start}");
    for (sequence, angle, speed) in [(1, 300.0, 300.0), (2, -30.0, 300.0), (3, 20.0, 120.0)] {
        let before = (bench.position)();
        let from = bench.table.state().await.expect("a state").positions_rad[0].to_degrees();
        bench.table.start(&target(sequence, angle, speed)).await.expect("accepted");
        let state = bench.arrive().await;
        assert!((state.positions_rad[0].to_degrees() - angle).abs() < 1e-3, "{state:?}");
        let turned = ((bench.position)() - before) / 1_600_000.0 * 360.0;
        assert!((turned - (angle - from)).abs() < 1e-2, "{turned} for {from} to {angle}");
    }
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_ramp_slower_than_the_drive_knows_is_its_slowest_and_takes_the_predicted_time() {
    let mut bench = usual().await;
    // 6 degrees in 2 s, speeding up for half of them: 6 degrees a second squared, where the drive knows none below 45.
    let mut slow = target(1, 6.0, 6.0);
    (slow.max_acceleration_rad_s2, slow.duration) = ([6_f64.to_radians()], Duration::from_secs(2));
    bench.table.start(&slow).await.expect("accepted");
    let rates = bench.table.link().expect("open");
    let [speed, ramp] = [register::SPEEDS, register::ACCELERATIONS];
    let (speed, ramp) = (rates.registers(speed, 1).await.expect("read")[0], rates.registers(ramp, 1).await.expect("read")[0]);
    // 40 turns of the motor a turn: 40 r/min were asked for at most, and 20 at least are needed.
    assert!(ramp == 10_000 && (20..30).contains(&speed), "{speed} r/min, {ramp} ms");
    let (cruise, turns, change) = (f64::from(speed) / 60.0, 40.0 / 60.0, 5.0);
    assert!((turns / cruise + cruise / change - 2.0).abs() < 0.1);
    let state = bench.arrive().await;
    assert!((state.positions_rad[0].to_degrees() - 6.0).abs() < 1e-3);
}

#[tokio::test]
async fn what_the_drive_cannot_do_and_how_it_is_not_set_up_is_refused() {
    let mut bench = usual().await;
    let unsupported = |result| assert!(matches!(result, Err(DeviceError::Unsupported { .. })), "{result:?}");
    unsupported(bench.table.start(&target(1, 10.0, 0.1)).await);
    unsupported(bench.table.start(&target(2, 10.0, 3600.0)).await);
    unsupported(bench.table.start(&target(3, f64::NAN, 30.0)).await);
    let mut other = on_socket(GatewayFraming::Rtu, DriveSetup { has_infinite_rotation: true, ..DriveSetup::default() }).await;
    other.table.spec.gear_ratio = 41.0;
    let error = other.table.connect().await.expect_err("another gear");
    assert!(matches!(&error, DeviceError::NotReady { reason } if reason.contains("Pr6.88")), "{error}");
    other.table.spec.has_infinite_rotation = false;
    let error = other.table.connect().await.expect_err("another mode");
    assert!(matches!(&error, DeviceError::NotReady { reason } if reason.contains("Pr0.15")), "{error}");
    other.table.spec.model = Some("MADLN".into());
    assert!(matches!(other.table.connect().await, Err(DeviceError::OtherDevice { .. })));
}

/// The slowest ramp is 10 s to 3000 r/min, 45°/s² at a gear ratio of 40: within the rating of one table and beyond another's.
#[tokio::test]
async fn a_ramp_slower_than_the_drive_knows_is_its_slowest_where_the_table_is_rated_for_it() {
    let mut bench = usual().await;
    let slow = |sequence| Target { max_acceleration_rad_s2: [20_f64.to_radians()], ..target(sequence, 10.0, 20.0) };
    bench.table.start(&slow(1)).await.expect("45°/s² is within 180°/s²");
    assert!((bench.arrive().await.positions_rad[0].to_degrees() - 10.0).abs() < 0.05);
    bench.table.max_acceleration_rad_s2 = 44_f64.to_radians();
    let refused = bench.table.start(&Target { positions_rad: [0.0], ..slow(2) }).await;
    let text = refused.expect_err("beyond the rating").to_string();
    assert!(text.contains("45.0°/s²") && text.contains("44.0°/s²"), "{text}");
    let at_deg = bench.table.state().await.expect("a state").positions_rad[0].to_degrees();
    assert!((at_deg - 10.0).abs() < 0.05, "it turned to {at_deg}");
}
