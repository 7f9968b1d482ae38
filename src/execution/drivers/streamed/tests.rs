//! The drivers whose controller sets the pace, beside our simulators on real sockets.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream, UdpSocket};
use tokio::time::advance;

use super::*;
use crate::cell::{AbbEgmSpec, KukaRsiSpec, UrControllerSpec, UrMotion};
use crate::execution::device::STOP_ATTEMPT;
use crate::execution::drivers::egm::{AbbArm, AbbEgm};
use crate::execution::drivers::kuka_rsi::{KukaArm, KukaRsi};
use crate::execution::drivers::stream::{STOP_WAIT, Wiring};
use crate::execution::drivers::there_and_back::{KeptWords, WATCHDOG, target, there_and_back};
use crate::execution::drivers::ur::{UniversalRobots, UrArm};
use crate::execution::protocol::egm::{EgmGuidance, EgmGuide, EgmMotors, EgmReport, ExternalAxes};
use crate::execution::protocol::kuka_rsi::{RsiCorrection, RsiNames, RsiReport};
use crate::execution::protocol::ur::UrCommand;
use crate::execution::protocol::ur::rtde::{OUTPUTS, RtdeFrame, RtdeReply, RtdeRequest, RtdeState};
use crate::execution::simulators::egm::{EgmController, EgmSession};
use crate::execution::simulators::kuka_rsi::{RsiController, RsiSession};
use crate::execution::simulators::ur::{UrCell, UrController};
use crate::execution::tests::simulated_network::{NetworkDialer, NetworkEnd, RoughNetwork};

/// Cycle that a busy machine keeps.
const CYCLE_MS: u32 = 12;
/// Largest step of an axis in a cycle, degrees: 1 rad/s.
const MAX_STEP_DEG: f64 = 57.3 * CYCLE_MS as f64 / 1e3;

/// A port of this machine that nobody has.
fn free_port() -> u16 {
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").expect("a port");
    socket.local_addr().expect("an address").port()
}

/// An ABB controller, and the arm of a driver that it sends to.
fn abb<const N: usize>() -> (AbbArm<N>, Arc<Mutex<EgmSession>>, tokio::task::JoinHandle<EgmSession>) {
    let address = format!("127.0.0.1:{}", free_port());
    let controller = EgmController {
        client: address.parse().expect("an address"),
        cycle: Duration::from_millis(CYCLE_MS.into()),
        comm_timeout: Duration::from_secs(1),
        joints_deg: [0.0, -10.0, 20.0, 0.0, 30.0, 0.0],
        external: ExternalAxes { deg: [90.0, 5.0, 0.0, 0.0, 0.0, 0.0], count: 2 },
    };
    let seen = Arc::new(Mutex::new(EgmSession::default()));
    let shown = seen.clone();
    let run = async move { controller.run(|session| *shown.lock().expect("a session") = *session).await.expect("a socket") };
    let spec = AbbEgmSpec { address, controller_host: None, cycle_ms: CYCLE_MS, table_axis: 1 };
    (AbbEgm::arm(&spec, Arc::new(())), seen, tokio::spawn(run))
}

/// A KUKA controller likewise.
fn kuka<const N: usize>() -> (KukaArm<N>, tokio::task::JoinHandle<RsiSession>) {
    let (arm, _, run) = kuka_beside([0.0; 6]);
    (arm, run)
}

/// Names that a specification of a KUKA controller has by default.
fn rsi_names() -> RsiNames {
    RsiNames { sender_type: "ImFree".to_owned(), axis_tag: "AK".to_owned(), table_tag: "EK".to_owned() }
}

/// A KUKA controller whose axes stand beside where they are commanded to.
fn kuka_beside<const N: usize>(
    beside_deg: [f64; 6],
) -> (KukaArm<N>, Arc<Mutex<RsiSession>>, tokio::task::JoinHandle<RsiSession>) {
    let address = format!("127.0.0.1:{}", free_port());
    let controller = RsiController {
        client: address.parse().expect("an address"),
        names: rsi_names(),
        cycle: Duration::from_millis(CYCLE_MS.into()),
        timeout_cycles: 40,
        base_deg: ([0.0, -90.0, 90.0, 0.0, 90.0, 0.0], 45.0),
        beside_deg,
    };
    let seen = Arc::new(Mutex::new(RsiSession::default()));
    let shown = seen.clone();
    let run = async move { controller.run(|session| *shown.lock().expect("a session") = *session).await.expect("a socket") };
    let spec = serde_json::json!({"address": address, "cycle_ms": CYCLE_MS});
    let spec: KukaRsiSpec = serde_json::from_value(spec).expect("a specification");
    (KukaRsi::arm(&spec, Arc::new(())), seen, tokio::spawn(run))
}

async fn ur(motion: UrMotion) -> (UrArm, Arc<Mutex<UrCell>>) {
    let controller = UrController::bind("127.0.0.1:0", "127.0.0.1:0", [0.1, -1.5, 1.5, 0.0, 0.5, 0.0]).await.expect("ports");
    let ((rtde, script), cell) = (controller.addresses().expect("addresses"), controller.cell());
    tokio::spawn(controller.serve());
    let spec = ur_spec(rtde.to_string(), script.to_string(), motion);
    (UniversalRobots::arm(&spec, Wiring::over_tcp("arm", Arc::new(()))), cell)
}

fn ur_spec(address: String, script_address: String, motion: UrMotion) -> UrControllerSpec {
    let reverse_address = "127.0.0.1:0".parse().expect("an address");
    UrControllerSpec { address, script_address, reverse_address, motion, rate_hz: 125, lookahead_ms: 100, gain: 300 }
}

/// Waits until the arm is no longer armed; the reason.
async fn disarmed(arm: &mut UrArm) -> String {
    let found = async {
        loop {
            if let Err(error) = arm.keep_alive().await {
                return error.to_string();
            }
            sleep(Duration::from_millis(5)).await;
        }
    };
    timeout(Duration::from_secs(5), found).await.expect("disarmed")
}

/// Waits until the arm rests.
async fn at_rest(arm: &mut UrArm) -> [f64; 6] {
    let found = async {
        loop {
            let state = arm.state().await.expect("a state");
            if !state.condition.moving {
                return state.positions_rad;
            }
        }
    };
    timeout(Duration::from_secs(5), found).await.expect("at rest")
}

#[tokio::test]
async fn an_abb_arm_with_its_table_goes_there_and_back() {
    let (mut arm, seen, run) = abb::<7>();
    arm.connect().await.expect("connected");
    assert!((arm.state().await.expect("a state").positions_rad[6] - 90_f64.to_radians()).abs() < 1e-9);
    arm.arm(WATCHDOG).await.expect("armed");
    there_and_back(&mut arm, 0.2).await;
    let session = *seen.lock().expect("a session");
    assert!(session.max_step_deg > 0.0 && session.max_step_deg <= MAX_STEP_DEG, "{session:?}");
    assert_eq!(session.external.deg[1], 5.0, "the other external axis stays");
    arm.release().await.expect("released");
    run.await.expect("its guidance ended by itself");
}

#[tokio::test]
async fn a_kuka_arm_with_its_table_goes_there_and_back() {
    let (mut arm, run) = kuka::<7>();
    arm.connect().await.expect("connected");
    let start = arm.state().await.expect("a state").positions_rad;
    assert!((start[1] + 90_f64.to_radians()).abs() < 1e-9 && (start[6] - 45_f64.to_radians()).abs() < 1e-9);
    arm.arm(WATCHDOG).await.expect("armed");
    there_and_back(&mut arm, 0.2).await;
    arm.release().await.expect("released");
    let session = run.await.expect("RSI broke off by itself");
    assert!(session.max_step_deg > 0.0 && session.max_step_deg <= MAX_STEP_DEG, "{session:?}");
    assert!(session.late > 40, "the answers ceased");
}

#[tokio::test]
async fn what_stands_beside_its_command_is_not_moved_before_a_target_is() {
    let (mut arm, seen, _run) = kuka_beside::<6>([0.0, -0.012, 0.004, 0.0, 0.0, 0.0]);
    arm.connect().await.expect("connected");
    for _ in 0..3 {
        sleep(Duration::from_millis(60)).await;
        arm.arm(WATCHDOG).await.expect("armed");
        arm.keep_alive().await.expect("armed");
    }
    let session = *seen.lock().expect("a session");
    assert!(session.answers > 10 && session.max_step_deg < 1e-9, "{session:?}");
    let goal = arm.state().await.expect("a state").positions_rad.map(|joint| joint + 0.02);
    arm.start(&target(1, goal, Duration::from_millis(100))).await.expect("accepted");
    sleep(Duration::from_millis(300)).await;
    let session = *seen.lock().expect("a session");
    assert!(session.max_step_deg > 1e-3 && session.max_step_deg <= MAX_STEP_DEG, "{session:?}");
    let off_deg = (session.axes_deg[1] - goal[1].to_degrees()).abs();
    assert!(off_deg < 1e-3, "{off_deg}°: the program's place is where it is commanded to");
}

#[tokio::test]
async fn a_guard_that_opens_for_a_moment_ends_the_move() {
    const GUARD: u32 = 1 << 4;
    let (mut arm, cell) = ur(UrMotion::Movej).await;
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    let start = arm.state().await.expect("a state").positions_rad;
    arm.start(&target(1, start.map(|joint| joint + 1.0), Duration::from_secs(4))).await.expect("accepted");
    sleep(Duration::from_millis(200)).await;
    cell.lock().expect("a cell").safety_bits |= GUARD;
    sleep(Duration::from_millis(40)).await;
    cell.lock().expect("a cell").safety_bits &= !GUARD;
    // Kept alive, as a session does that has not seen the guard.
    for _ in 0..20 {
        let _ = arm.keep_alive().await;
        sleep(Duration::from_millis(20)).await;
    }
    let at = cell.lock().expect("a cell").joints_rad();
    assert!(at[0] - start[0] < 0.3, "{at:?}");
    assert!(matches!(arm.keep_alive().await, Err(DeviceError::NotReady { .. })), "disarmed");
    arm.stop(&mut None).await.expect("nothing moves");
    sleep(Duration::from_millis(60)).await;
    assert_eq!(cell.lock().expect("a cell").joints_rad(), at);
    arm.arm(WATCHDOG).await.expect("armed anew");
    arm.start(&target(2, start, Duration::from_millis(500))).await.expect("accepted");
}

#[tokio::test]
async fn a_program_that_ended_is_told_as_such_and_sent_anew_by_the_next_arming() {
    for motion in UrMotion::ALL {
        let (mut arm, cell) = ur(motion).await;
        arm.connect().await.expect("connected");
        arm.arm(WATCHDOG).await.expect("armed");
        let start = arm.state().await.expect("a state").positions_rad;
        // Stopped at the pendant in a pause: there is nothing wrong with that.
        arm.stop(&mut None).await.expect("stopped");
        cell.lock().expect("a cell").press_stop();
        sleep(Duration::from_millis(60)).await;
        arm.keep_alive().await.expect("nothing to feed");
        arm.arm(WATCHDOG).await.expect("its program is sent anew");
        arm.start(&target(1, start.map(|joint| joint + 1.0), Duration::from_secs(4))).await.expect("accepted");
        // Stopped at the pendant on the way.
        cell.lock().expect("a cell").press_stop();
        let reason = disarmed(&mut arm).await;
        assert!(reason.contains("its program on the controller has ended"), "{motion:?}: {reason}");
        let back = target(2, start, Duration::from_millis(300));
        assert_eq!(arm.start(&back).await.map_err(|error| error.to_string()), Err(reason), "{motion:?}");
        arm.stop(&mut None).await.expect("nothing moves");
        let rest = at_rest(&mut arm).await;
        assert!(rest[0] - start[0] < 0.5, "{motion:?}: {rest:?}");
        arm.arm(WATCHDOG).await.expect("its program is sent anew");
        arm.start(&back).await.expect("accepted");
    }
}

#[tokio::test]
async fn an_arm_whose_program_is_paused_at_the_pendant_is_led_no_further() {
    for motion in UrMotion::ALL {
        let (mut arm, cell) = ur(motion).await;
        arm.connect().await.expect("connected");
        arm.arm(WATCHDOG).await.expect("armed");
        let start = arm.state().await.expect("a state").positions_rad;
        arm.start(&target(1, start.map(|joint| joint + 1.0), Duration::from_secs(1))).await.expect("accepted");
        sleep(Duration::from_millis(300)).await;
        cell.lock().expect("a cell").is_paused = true;
        let reason = disarmed(&mut arm).await;
        assert!(reason.contains("paused at the controller"), "{motion:?}: {reason}");
        timeout(STOP_ATTEMPT, arm.stop(&mut None)).await.expect("within an attempt").expect("stopped");
        assert!(matches!(arm.arm(WATCHDOG).await, Err(DeviceError::NotReady { .. })), "{motion:?}");
        let before = cell.lock().expect("a cell").joints_rad();
        cell.lock().expect("a cell").is_paused = false;
        sleep(Duration::from_millis(300)).await;
        let after = cell.lock().expect("a cell").joints_rad();
        // A move of the controller's own goes on until the program sees that nobody is there, and brakes.
        let allowed_rad = match motion {
            UrMotion::Servoj => 0.05,
            UrMotion::Movej => 0.2,
        };
        assert!(apart_rad(&before, &after) < allowed_rad, "{motion:?}: {before:?}, {after:?}");
    }
}

#[tokio::test]
async fn a_stop_that_the_program_of_an_arm_does_not_take_is_not_acknowledged() {
    let (mut arm, cell) = ur(UrMotion::Movej).await;
    arm.connect().await.expect("connected");
    arm.arm(2 * WATCHDOG).await.expect("armed");
    let start = arm.state().await.expect("a state").positions_rad;
    arm.start(&target(1, start.map(|joint| joint + 1.0), Duration::from_secs(4))).await.expect("accepted");
    arm.state().await.expect("a further cycle: the move was taken");
    cell.lock().expect("a cell").is_link_dead = true;
    // Asked again while the program runs on, or is paused and may go on by itself, it has not been taken either.
    for is_paused in [false, true] {
        cell.lock().expect("a cell").is_paused = is_paused;
        let (asked_at, mut sent_at) = (Instant::now(), None);
        let stopped = timeout(STOP_ATTEMPT, arm.stop(&mut sent_at)).await.expect("within an attempt");
        // The first went out, whether it was taken or not; then the program was given up, and there was no way to send another.
        let sent_after = sent_at.map(|sent_at| sent_at - asked_at);
        assert_eq!(sent_after.is_some(), !is_paused, "{sent_after:?}");
        assert!(sent_after.is_none_or(|after| after < STOP_WAIT), "{sent_after:?}: with the end of the wait for its answer");
        let is_told = matches!(&stopped, Err(DeviceError::NotReady { reason }) if reason.contains("takes no more commands"));
        assert!(is_told, "{is_paused}: {stopped:?}");
    }
    cell.lock().expect("a cell").is_paused = false;
    sleep(Duration::from_millis(60)).await;
    let rest = at_rest(&mut arm).await;
    assert!(rest[0] - start[0] < 0.5, "its watchdog stops it: {rest:?}");
    timeout(STOP_ATTEMPT, arm.stop(&mut None))
        .await
        .expect("within an attempt")
        .expect("the controller says that no program runs");
    cell.lock().expect("a cell").is_link_dead = false;
    arm.arm(WATCHDOG).await.expect("its program is sent anew");
    arm.stop(&mut None).await.expect("taken");
}

#[tokio::test]
async fn a_stop_does_not_wait_for_a_program_that_is_still_to_connect() {
    let controller = UrController::bind("127.0.0.1:0", "127.0.0.1:0", [0.0; 6]).await.expect("ports");
    let (rtde, _) = controller.addresses().expect("addresses");
    tokio::spawn(controller.serve());
    // Takes programs and runs none.
    let script = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let script_address = script.local_addr().expect("an address").to_string();
    let spec = ur_spec(rtde.to_string(), script_address, UrMotion::Servoj);
    let mut arm = UniversalRobots::arm(&spec, Wiring::over_tcp("arm", Arc::new(())));
    arm.connect().await.expect("connected");
    assert!(timeout(Duration::from_millis(100), arm.arm(WATCHDOG)).await.is_err(), "given up");
    timeout(STOP_ATTEMPT, arm.stop(&mut None)).await.expect("within an attempt").expect("acknowledged");
    let start = arm.state().await.expect("a state").positions_rad;
    assert!(matches!(arm.start(&target(1, start, Duration::from_secs(1))).await, Err(DeviceError::NotReady { .. })));
}

/// Address of this machine that a program connects back to, by its text.
async fn way_back(script: &mut TcpStream) -> SocketAddr {
    let mut text = Vec::new();
    while !text.ends_with(b"\nend\n") {
        assert!(script.read_buf(&mut text).await.expect("read") > 0, "the whole program");
    }
    let text = String::from_utf8(text).expect("text");
    let (_, rest) = text.split_once("socket_open(\"127.0.0.1\", ").expect("an address");
    let port = rest.split(',').next().expect("a port").parse().expect("a number");
    SocketAddr::new(Ipv4Addr::LOCALHOST.into(), port)
}

/// Whoever connected first was given the commands, and would have acknowledged the stops, in place of the arm. On Linux the whole of
/// 127.0.0.0/8 is this machine.
#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_program_that_connects_from_elsewhere_than_the_controller_is_refused_and_noted() {
    let controller = UrController::bind("127.0.0.1:0", "127.0.0.1:0", [0.0; 6]).await.expect("ports");
    let (rtde, _) = controller.addresses().expect("addresses");
    tokio::spawn(controller.serve());
    let script = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let script_address = script.local_addr().expect("an address").to_string();
    let programs = tokio::spawn(async move {
        let (mut stream, _) = script.accept().await.expect("a client");
        let back = way_back(&mut stream).await;
        let intruder = TcpSocket::new_v4().expect("a socket");
        intruder.bind("127.0.0.2:0".parse().expect("an address")).expect("an address");
        let mut intruder = intruder.connect(back).await.expect("connected");
        let mut program = TcpStream::connect(back).await.expect("connected");
        let mut bytes = [0; UrCommand::BYTES];
        program.read_exact(&mut bytes).await.expect("a command");
        (UrCommand::decode(&bytes), intruder.read(&mut bytes).await.unwrap_or(0))
    });
    let log = KeptWords::new();
    let spec = ur_spec(rtde.to_string(), script_address, UrMotion::Servoj);
    let mut arm = UniversalRobots::arm(&spec, Wiring::over_tcp("arm", log.clone()));
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    let (command, to_intruder) = timeout(Duration::from_secs(5), programs).await.expect("in time").expect("no panic");
    assert!(matches!(command, Ok(UrCommand::SetPoint(_))), "{command:?}");
    assert_eq!(to_intruder, 0, "bytes");
    let [noted] = &log.noted()[..] else { panic!("{:?}", log.noted()) };
    let is_told = noted.starts_with("arm: a connection from 127.0.0.2:") && noted.ends_with("the controller is at 127.0.0.1");
    assert!(is_told, "{noted}");
}

/// A move that waits for the network would be carried out after its program was given up: the connection is reset.
#[tokio::test]
async fn what_the_network_has_not_taken_is_not_sent_to_a_program_that_is_given_up() {
    let controller = UrController::bind("127.0.0.1:0", "127.0.0.1:0", [0.0; 6]).await.expect("ports");
    let (rtde, _) = controller.addresses().expect("addresses");
    tokio::spawn(controller.serve());
    let script = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let script_address = script.local_addr().expect("an address").to_string();
    let program = tokio::spawn(async move {
        let (mut stream, _) = script.accept().await.expect("a client");
        let mut reverse = TcpStream::connect(way_back(&mut stream).await).await.expect("connected back");
        let mut commands = Vec::new();
        reverse.read_to_end(&mut commands).await.map_err(|error| error.kind())
    });
    let spec = ur_spec(rtde.to_string(), script_address, UrMotion::Servoj);
    let mut arm = UniversalRobots::arm(&spec, Wiring::over_tcp("arm", Arc::new(())));
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    drop(arm);
    let ended = timeout(Duration::from_secs(5), program).await.expect("it ends").expect("no panic");
    assert_eq!(ended, Err(std::io::ErrorKind::ConnectionReset));
}

/// Greets a client of RTDE, and has so many states for it at once, behind some bytes; in each the joints stand a milliradian further.
async fn queue_states(mut end: NetworkEnd, noise: &[u8], states: u32) {
    let mut unread = Vec::new();
    while end.read_buf(&mut unread).await.is_ok_and(|read| read > 0) {
        while let Some((frame, length)) = RtdeFrame::first(&unread).expect("a frame") {
            let request = RtdeRequest::decode(frame).expect("a request");
            unread.drain(..length);
            let reply = match request {
                RtdeRequest::Version(_) => RtdeReply::Version(true),
                RtdeRequest::ControlVersion => RtdeReply::ControlVersion([5, 11, 0, 108]),
                RtdeRequest::Outputs { .. } => RtdeReply::Outputs { recipe: 1, types: OUTPUTS.map(|(_, kind)| kind).join(",") },
                RtdeRequest::Start => RtdeReply::Start(true),
                RtdeRequest::Inputs { .. } | RtdeRequest::Pause | RtdeRequest::Data { .. } => return,
            };
            end.write_all(&reply.encode()).await.expect("taken");
            if reply == RtdeReply::Start(true) {
                let queued: Vec<u8> = (1..=states).flat_map(state_frame).collect();
                end.write_all(noise).await.expect("taken");
                end.write_all(&queued).await.expect("taken");
            }
        }
    }
}

fn state_frame(milliradians: u32) -> Vec<u8> {
    let joints_rad = [1e-3 * f64::from(milliradians); 6];
    let values = RtdeState { joints_rad, robot_bits: 1, safety_bits: 1, ..RtdeState::default() }.encode();
    RtdeReply::Data { recipe: 1, values }.encode()
}

/// An arm whose controller queues states.
fn ur_with_queue(noise: &'static [u8], states: u32) -> UrArm {
    let network = RoughNetwork::new(1, move |end| {
        tokio::spawn(queue_states(end, noise, states));
    });
    let wiring = Wiring { dialer: Arc::new(NetworkDialer(network)), log: Arc::new(()), device: "arm" };
    UniversalRobots::arm(&ur_spec("arm:30004".to_owned(), "arm:30002".to_owned(), UrMotion::Servoj), wiring)
}

#[tokio::test(start_paused = true)]
async fn of_states_that_queued_the_newest_alone_is_read() {
    let arm = ur_with_queue(&[], 300);
    let (_, mut link) = StreamedProtocol::<6>::open(&arm.protocol).await.expect("greeted");
    let report = StreamedLink::<6>::report(&mut link).await.expect("a state");
    assert!((report.positions_rad[0] - 0.3).abs() < 1e-9, "{report:?}");
    let further = StreamedLink::<6>::report(&mut link);
    assert!(timeout(Duration::from_millis(50), further).await.is_err(), "nothing is left to read");
}

#[tokio::test(start_paused = true)]
async fn bytes_that_are_no_frame_are_told_once_and_states_are_read_on() {
    // A frame shorter than its own header.
    let arm = ur_with_queue(&[0, 2, b'U'], 1);
    let (_, mut link) = StreamedProtocol::<6>::open(&arm.protocol).await.expect("greeted");
    assert!(matches!(StreamedLink::<6>::report(&mut link).await, Err(DeviceError::Malformed { .. })));
    let report = StreamedLink::<6>::report(&mut link).await.expect("a state");
    assert!((report.positions_rad[0] - 1e-3).abs() < 1e-9, "{report:?}");
}

#[test]
fn an_order_to_stop_stays_until_it_is_taken() {
    let here = [0.0; 6];
    let report =
        StreamedReport { positions_rad: here, held_rad: here, condition: Condition::READY, hindrance: None, is_behind: false };
    let mut state = SharedState::default();
    let cycle = Duration::from_millis(8);
    state.step(report, cycle);
    state.armed = Some(Armed { watchdog: Duration::from_secs(1), fed_at: Instant::now() });
    state.set_out(&target(1, [0.5; 6], Duration::from_secs(1))).expect("armed");
    assert!(matches!(state.step(report, cycle).order, Some(StreamOrder::Go { .. })));
    for _ in 0..2 {
        state.ramp_down();
        state.armed = None;
    }
    assert_eq!(state.step(report, cycle).order, Some(StreamOrder::Stop));
    assert_eq!(state.step(report, cycle).order, None);
    state.ramp_down();
    assert_eq!(state.order, None, "it was stopped");
    state.stop_not_taken = Some(DeviceError::NotReady { reason: "not taken".to_owned() });
    state.ramp_down();
    let hindered = StreamedReport { hindrance: Some("its program is paused"), ..report };
    assert_eq!(state.step(hindered, cycle).order, Some(StreamOrder::Stop), "it is asked anew, whatever hinders the arm");
}

/// A controller that does not take so many orders to stop.
#[derive(Clone, Copy)]
struct HardOfHearing {
    refusals: u32,
}

impl HardOfHearing {
    const CYCLE: Duration = Duration::from_millis(8);

    /// Reports and is answered, for ever.
    async fn report_on(mut self, shared: &Shared<1>) {
        loop {
            let report = StreamedLink::<1>::report(&mut self).await.expect("a report");
            answer_one(&mut self, shared, report, Self::CYCLE).await.expect("answered");
        }
    }
}

impl StreamedProtocol<1> for HardOfHearing {
    type Link = Self;

    async fn open(&self) -> Result<(Identity, Self), DeviceError> {
        Err(not_connected())
    }
}

impl StreamedLink<1> for HardOfHearing {
    const ALWAYS_FOLLOWS: bool = false;

    fn cycle(&self) -> Duration {
        Self::CYCLE
    }

    async fn report(&mut self) -> Result<StreamedReport<1>, DeviceError> {
        sleep(Self::CYCLE).await;
        let here = [0.0];
        let (condition, hindrance) = (Condition::READY, None);
        Ok(StreamedReport { positions_rad: here, held_rad: here, condition, hindrance, is_behind: false })
    }

    async fn arm(&mut self, _watchdog: Duration) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn answer(&mut self, step: &StreamStep<1>) -> Result<(), DeviceError> {
        if step.order != Some(StreamOrder::Stop) || self.refusals == 0 {
            return Ok(());
        }
        self.refusals -= 1;
        Err(DeviceError::NotReady { reason: "not taken".to_owned() })
    }

    async fn close(self) {}
}

#[tokio::test(start_paused = true)]
async fn a_stop_that_was_not_taken_is_asked_for_anew_within_the_attempt() {
    for (refusals, is_taken) in [(5, true), (u32::MAX, false)] {
        let controller = HardOfHearing { refusals };
        let state = SharedState { is_under_order: true, ..SharedState::default() };
        let shared: Arc<Shared<1>> = Arc::new(Shared { state: Mutex::new(state), cycles: watch::Sender::new(0) });
        let mut arm = Streamed { protocol: controller, thread: Some(Arc::clone(&shared)) };
        let (asked_at, mut sent_at) = (Instant::now(), None);
        let stopped = tokio::select! {
            stopped = arm.stop(&mut sent_at) => stopped,
            () = controller.report_on(&shared) => panic!("it reports for ever"),
        };
        assert_eq!((stopped.is_ok(), sent_at.is_some()), (is_taken, is_taken), "{stopped:?}");
        assert!(asked_at.elapsed() < STOP_ATTEMPT, "{:?}", asked_at.elapsed());
    }
}

/// A controller that sends garbage but for one report in so many; it may count every answer as late.
#[derive(Clone)]
struct Garbling {
    reports: u32,
    good_one_in: u32,
    is_behind: bool,
}

impl StreamedProtocol<6> for Garbling {
    type Link = Self;

    async fn open(&self) -> Result<(Identity, Self), DeviceError> {
        let [maker, model] = ["test", "garbling"].map(str::to_owned);
        Ok((Identity { maker, model, serial: None, firmware: None }, self.clone()))
    }
}

impl StreamedLink<6> for Garbling {
    const ALWAYS_FOLLOWS: bool = true;

    fn cycle(&self) -> Duration {
        Duration::from_millis(CYCLE_MS.into())
    }

    async fn report(&mut self) -> Result<StreamedReport<6>, DeviceError> {
        sleep(self.cycle()).await;
        self.reports += 1;
        if !self.reports.is_multiple_of(self.good_one_in) {
            return Err(DeviceError::Malformed { what: "garbage".to_owned() });
        }
        let (here, condition, is_behind) = ([0.0; 6], Condition::READY, self.is_behind);
        Ok(StreamedReport { positions_rad: here, held_rad: here, condition, hindrance: None, is_behind })
    }

    async fn arm(&mut self, _watchdog: Duration) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn answer(&mut self, _step: &StreamStep<6>) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn close(self) {}
}

/// The thread went on for ever, and held its socket.
#[tokio::test(start_paused = true)]
async fn a_link_that_is_to_close_is_closed_in_time_whatever_its_controller_sends() {
    for (good_one_in, is_behind, rests) in [(u32::MAX, false, false), (1, true, false), (2, false, true)] {
        let (_, shared, cycle) = on_the_way();
        for _ in 0..20 {
            shared.lock().points.as_mut().expect("on the way").advance(cycle);
        }
        shared.close();
        let controller = Garbling { reports: 0, good_one_in, is_behind };
        let ended = timeout(2 * CLOSE_TIMEOUT, answer_all(&controller, &shared)).await;
        assert_eq!(ended, Ok(Ok(())), "one good report in {good_one_in}");
        let is_moving = shared.lock().points.as_ref().is_some_and(SetPoints::is_moving);
        assert_eq!(!is_moving, rests, "one good report in {good_one_in}");
    }
}

/// A protocol with a fault of our own.
#[derive(Clone)]
struct Panicking;

impl StreamedProtocol<6> for Panicking {
    type Link = Garbling;

    async fn open(&self) -> Result<(Identity, Garbling), DeviceError> {
        panic!("planted");
    }
}

/// The controller was told as silent after ten seconds, and giving the link back waited as long.
#[tokio::test]
async fn a_thread_that_panics_is_told_at_once_and_holds_nothing_up() {
    let mut arm: Streamed<6, Panicking> = Streamed::new(Panicking);
    let connected = timeout(FIRST_REPORT_TIMEOUT / 2, arm.connect()).await.expect("told at once");
    let is_told = matches!(&connected, Err(DeviceError::Closed { reason }) if reason.contains("a fault of this program's own"));
    assert!(is_told, "{connected:?}");
    timeout(END_TIMEOUT / 2, arm.release()).await.expect("the thread has ended").expect("released");
}

#[tokio::test]
async fn a_ur_arm_goes_there_and_back_both_ways() {
    for motion in UrMotion::ALL {
        let (mut arm, cell) = ur(motion).await;
        let identity = arm.connect().await.expect("connected");
        assert_eq!(identity.firmware.as_deref(), Some("5.11.0.108"));
        arm.arm(WATCHDOG).await.expect("armed");
        there_and_back(&mut arm, 0.2).await;
        let step_rad = cell.lock().expect("a cell").max_step_rad;
        assert!(step_rad <= 1.0 / 125.0 * 1.01, "{motion:?}: {step_rad}");
        arm.release().await.expect("released");
    }
}

#[tokio::test]
async fn a_stop_is_a_ramp_and_nothing_goes_on() {
    let (mut arm, seen, _run) = abb::<6>();
    arm.connect().await.expect("connected");
    let start = arm.state().await.expect("a state").positions_rad;
    assert!(arm.start(&target(1, start, Duration::from_secs(1))).await.is_err(), "not armed");
    arm.arm(WATCHDOG).await.expect("armed");
    let goal = start.map(|joint| joint + 1.0);
    arm.start(&target(1, goal, Duration::from_secs(2))).await.expect("accepted");
    assert!(arm.start(&target(2, start, Duration::from_secs(1))).await.is_err(), "one at a time");
    sleep(Duration::from_millis(400)).await;
    let mut sent_at = None;
    let acknowledged_at = arm.stop(&mut sent_at).await.expect("stopped");
    assert!(sent_at.is_some_and(|sent_at| sent_at < acknowledged_at));
    sleep(Duration::from_millis(600)).await;
    let at = arm.state().await.expect("a state");
    assert!(!at.condition.moving && apart_rad(&at.positions_rad, &goal) > 0.2, "{at:?}");
    sleep(Duration::from_millis(200)).await;
    assert_eq!(arm.state().await.expect("a state").positions_rad, at.positions_rad);
    let session = *seen.lock().expect("a session");
    assert!(session.max_step_deg <= MAX_STEP_DEG, "{session:?}");
}

#[tokio::test]
async fn there_is_nothing_to_keep_alive_after_a_stop_and_nothing_wrong_with_that() {
    let (mut arm, _seen, _run) = abb::<6>();
    arm.connect().await.expect("connected");
    assert!(matches!(arm.keep_alive().await, Err(DeviceError::NotReady { .. })), "never armed");
    arm.arm(WATCHDOG).await.expect("armed");
    for _ in 0..2 {
        arm.stop(&mut None).await.expect("stopped");
        arm.keep_alive().await.expect("stopped on command");
    }
    let start = arm.state().await.expect("a state").positions_rad;
    assert!(matches!(arm.start(&target(1, start, Duration::from_secs(1))).await, Err(DeviceError::NotReady { .. })), "disarmed");
    arm.arm(Duration::ZERO).await.expect("armed");
    arm.state().await.expect("a further cycle, in which the watchdog lapses");
    arm.stop(&mut None).await.expect("stopped");
    assert!(matches!(arm.keep_alive().await, Err(DeviceError::NotReady { .. })), "it lapsed before the stop");
}

/// Set points on the way to a target, a state that has them, and the cycle of the controller.
fn on_the_way() -> (SetPoints<6>, Shared<6>, Duration) {
    let mut points = SetPoints::still([0.0; 6]);
    points.go(&target(1, [1.0; 6], Duration::from_secs(1)));
    let state = SharedState { points: Some(points.clone()), ..SharedState::default() };
    (points, Shared { state: Mutex::new(state), cycles: watch::Sender::new(0) }, Duration::from_millis(CYCLE_MS.into()))
}

/// Answers the next report; returns false if none comes.
async fn take_a_turn(link: &mut impl StreamedLink<6>, shared: &Shared<6>) -> bool {
    let Ok(report) = timeout(Duration::from_millis(100), link.report()).await else { return false };
    answer_one(link, shared, report.expect("a report"), Duration::from_millis(CYCLE_MS.into())).await.expect("answered");
    true
}

/// Bytes of the next datagram that the driver sends to the controller.
async fn answer_to(controller: &UdpSocket) -> Vec<u8> {
    let mut answer = vec![0; 4096];
    let received = timeout(Duration::from_secs(5), controller.recv_from(&mut answer)).await.expect("in time");
    answer.truncate(received.expect("an answer").0);
    answer
}

#[tokio::test]
async fn of_reports_that_queued_the_newest_alone_is_answered_with_the_travel_of_one_cycle() {
    let address = format!("127.0.0.1:{}", free_port());
    let spec = AbbEgmSpec { address: address.clone(), controller_host: None, cycle_ms: CYCLE_MS, table_axis: 1 };
    let arm: AbbArm<6> = AbbEgm::arm(&spec, Arc::new(()));
    let (_, mut link) = StreamedProtocol::<6>::open(&arm.protocol).await.expect("bound");
    let (mut points, shared, cycle) = on_the_way();
    let controller = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
    for time_ms in 1..=5 {
        let report = EgmReport { time_ms, motors: EgmMotors::On, guidance: EgmGuidance::Running, ..EgmReport::default() };
        controller.send_to(&report.encode(), &address).await.expect("sent");
    }
    let report = StreamedLink::<6>::report(&mut link).await.expect("a report");
    answer_one(&mut link, &shared, report, cycle).await.expect("answered");
    let answer = answer_to(&controller).await;
    let guide = EgmGuide::decode(&answer).expect("guidance");
    assert_eq!(guide.time_ms, 5, "to the newest");
    let step_deg = points.advance(cycle)[0].to_degrees();
    assert!((guide.joints_deg[0] - step_deg).abs() < 1e-9, "{guide:?} for {step_deg}°");
    let further = StreamedLink::<6>::report(&mut link);
    assert!(timeout(Duration::ZERO, further).await.is_err(), "nothing is left to answer");
}

/// A telegram that came twice took the arm twice as far within its cycle.
#[tokio::test]
async fn a_telegram_of_rsi_that_comes_again_gets_the_same_set_point_again() {
    let address = format!("127.0.0.1:{}", free_port());
    let spec: KukaRsiSpec = serde_json::from_value(serde_json::json!({"address": address})).expect("a specification");
    let arm: KukaArm<6> = KukaRsi::arm(&spec, Arc::new(()));
    let (_, mut link) = StreamedProtocol::<6>::open(&arm.protocol).await.expect("bound");
    let (mut points, shared, cycle) = on_the_way();
    let controller = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
    for (ipoc, is_repeated) in [(5_000, false), (5_000, true), (5_000, true), (5_012, false)] {
        let telegram = RsiReport { ipoc, ..RsiReport::default() }.encode();
        controller.send_to(telegram.as_bytes(), &address).await.expect("sent");
        let is_answered = take_a_turn(&mut link, &shared).await;
        assert_eq!(is_answered, !is_repeated, "a cycle for each telegram, not for each time that it comes");
        if is_answered {
            points.advance(cycle);
        }
        let answer = answer_to(&controller).await;
        let correction = RsiCorrection::decode(&answer, &rsi_names()).expect("corrections");
        let wanted_deg = points.at_rad()[0].to_degrees();
        assert_eq!(correction.ipoc, ipoc);
        assert!((correction.axes_deg[0] - wanted_deg).abs() < 1e-5, "{correction:?} for {wanted_deg}°");
    }
}

/// A report that came twice took the arm twice as far within its cycle.
#[tokio::test]
async fn a_report_of_egm_that_comes_again_gets_the_same_set_point_again() {
    let address = format!("127.0.0.1:{}", free_port());
    let spec = AbbEgmSpec { address: address.clone(), controller_host: None, cycle_ms: CYCLE_MS, table_axis: 1 };
    let arm: AbbArm<6> = AbbEgm::arm(&spec, Arc::new(()));
    let (_, mut link) = StreamedProtocol::<6>::open(&arm.protocol).await.expect("bound");
    let (mut points, shared, cycle) = on_the_way();
    let controller = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
    for (sequence, number, is_repeated) in [(7, 1, false), (7, 1, true), (7, 1, true), (8, 2, false)] {
        let time_ms = sequence * CYCLE_MS;
        let report =
            EgmReport { sequence, time_ms, motors: EgmMotors::On, guidance: EgmGuidance::Running, ..EgmReport::default() };
        controller.send_to(&report.encode(), &address).await.expect("sent");
        let is_answered = take_a_turn(&mut link, &shared).await;
        assert_eq!(is_answered, !is_repeated, "a cycle for each report, not for each time that it comes");
        if is_answered {
            points.advance(cycle);
        }
        let answer = answer_to(&controller).await;
        let guide = EgmGuide::decode(&answer).expect("guidance");
        let wanted_deg = points.at_rad()[0].to_degrees();
        assert_eq!((guide.sequence, guide.time_ms), (number, time_ms));
        assert!((guide.joints_deg[0] - wanted_deg).abs() < 1e-9, "{guide:?} for {wanted_deg}°");
    }
}

/// A report that came after a later one took the arm as far as a further cycle does.
#[tokio::test]
async fn a_report_of_egm_that_was_overtaken_gets_no_answer() {
    let address = format!("127.0.0.1:{}", free_port());
    let spec = AbbEgmSpec { address: address.clone(), controller_host: None, cycle_ms: CYCLE_MS, table_axis: 1 };
    let arm: AbbArm<6> = AbbEgm::arm(&spec, Arc::new(()));
    let (_, mut link) = StreamedProtocol::<6>::open(&arm.protocol).await.expect("bound");
    let (mut points, shared, cycle) = on_the_way();
    let controller = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
    let report = |sequence: u32, time_ms: u32| {
        EgmReport { sequence, time_ms, motors: EgmMotors::On, guidance: EgmGuidance::Running, ..EgmReport::default() }.encode()
    };
    // The last two: the guidance was started anew, then the controller.
    for (sequence, time_ms) in [(8, 5_000), (9, 5_012), (0, 5_024), (0, 20)] {
        controller.send_to(&report(sequence, time_ms), &address).await.expect("sent");
        assert!(take_a_turn(&mut link, &shared).await, "report {sequence} of {time_ms} ms");
        let guide = EgmGuide::decode(&answer_to(&controller).await).expect("guidance");
        let wanted_deg = points.advance(cycle)[0].to_degrees();
        assert_eq!(guide.time_ms, time_ms);
        assert!((guide.joints_deg[0] - wanted_deg).abs() < 1e-9, "{guide:?} for {wanted_deg}°");
        if sequence == 9 {
            controller.send_to(&report(8, 5_000), &address).await.expect("sent");
            let turn = timeout(Duration::from_millis(50), StreamedLink::<6>::report(&mut link));
            assert!(turn.await.is_err(), "its cycle is over");
        }
    }
}

/// Drivers and twin told it in three ways, one of which spoke of a watchdog that nobody had set.
#[test]
fn an_arm_that_was_never_armed_is_told_as_by_every_driver() {
    let told = SharedState::<6>::default().fail_if_not_armed();
    let reason = crate::execution::drivers::stream::NOT_ARMED.to_owned();
    assert_eq!(told, Err(DeviceError::NotReady { reason }));
}

#[tokio::test]
async fn without_a_sign_of_life_it_stops_and_is_disarmed() {
    let (mut arm, _run) = kuka::<6>();
    arm.connect().await.expect("connected");
    // Longer than a busy machine takes from here to the start.
    arm.arm(Duration::from_millis(400)).await.expect("armed");
    let start = arm.state().await.expect("a state").positions_rad;
    let goal = start.map(|joint| joint + 1.0);
    arm.start(&target(1, goal, Duration::from_secs(3))).await.expect("accepted");
    sleep(Duration::from_millis(1400)).await;
    let at = arm.state().await.expect("a state");
    assert!(!at.condition.moving && apart_rad(&at.positions_rad, &start) < 0.2, "{at:?}");
    assert!(matches!(arm.keep_alive().await, Err(DeviceError::NotReady { .. })));
    assert!(arm.start(&target(2, start, Duration::from_secs(1))).await.is_err());
    arm.arm(WATCHDOG).await.expect("armed anew");
    arm.start(&target(3, start, Duration::from_millis(100))).await.expect("accepted");
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_dropped_driver_ends_the_program_of_the_arm() {
    for motion in UrMotion::ALL {
        let (mut arm, cell) = ur(motion).await;
        arm.connect().await.expect("connected");
        arm.arm(WATCHDOG).await.expect("armed");
        let start = arm.state().await.expect("a state").positions_rad;
        arm.start(&target(1, start.map(|joint| joint + 1.0), Duration::from_secs(3))).await.expect("accepted");
        sleep(Duration::from_millis(200)).await;
        drop(arm);
        sleep(Duration::from_millis(800)).await;
        let at = cell.lock().expect("a cell").joints_rad();
        sleep(Duration::from_millis(200)).await;
        assert_eq!(cell.lock().expect("a cell").joints_rad(), at, "{motion:?}");
        assert!(at[0] - start[0] < 0.5, "{motion:?}: {at:?}");
    }
}

#[tokio::test]
async fn a_safety_stop_of_the_arm_disarms_it() {
    let (mut arm, cell) = ur(UrMotion::Servoj).await;
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    cell.lock().expect("a cell").safety_bits = 1 << 6;
    sleep(Duration::from_millis(100)).await;
    let state = arm.state().await.expect("a state");
    assert!(state.condition.emergency_stop);
    assert!(arm.start(&target(1, state.positions_rad, Duration::from_secs(1))).await.is_err());
    assert!(matches!(arm.arm(WATCHDOG).await, Err(DeviceError::NotReady { .. })));
}

#[tokio::test]
async fn an_arm_with_power_and_closed_brakes_is_told_as_such_and_not_armed() {
    const IDLE: i32 = 5;
    let (mut arm, cell) = ur(UrMotion::Servoj).await;
    arm.connect().await.expect("connected");
    cell.lock().expect("a cell").mode = IDLE;
    sleep(Duration::from_millis(100)).await;
    let condition = arm.state().await.expect("a state").condition;
    assert!(condition.powered && !condition.brakes_open, "{condition:?}");
    let refused = arm.arm(WATCHDOG).await.expect_err("its brakes are closed").to_string();
    assert!(refused.contains("its brakes are closed"), "{refused}");
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_silent_controller_is_told_as_such() {
    let spec = AbbEgmSpec { address: format!("127.0.0.1:{}", free_port()), controller_host: None, cycle_ms: 4, table_axis: 1 };
    let mut arm: AbbArm<6> = AbbEgm::arm(&spec, Arc::new(()));
    assert!(matches!(arm.state().await, Err(DeviceError::Closed { .. })), "not connected");
    let taken = AbbEgmSpec { address: "127.0.0.1:1".to_owned(), controller_host: None, cycle_ms: 4, table_axis: 1 };
    let mut nobody: AbbArm<6> = AbbEgm::arm(&AbbEgmSpec { address: "192.0.2.1:6510".to_owned(), ..taken }, Arc::new(()));
    assert!(matches!(nobody.connect().await, Err(DeviceError::Unbound { .. })), "no such address here");
    let sent_to = spec.address.clone();
    tokio::spawn(async move {
        let socket = tokio::net::UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
        loop {
            let _ = socket.send_to(b"\x0a\x7fnonsense", &sent_to).await;
            sleep(Duration::from_millis(20)).await;
        }
    });
    assert!(matches!(arm.connect().await, Err(DeviceError::Malformed { .. })));
}

#[tokio::test]
async fn a_restart_of_rsi_ends_the_session_and_an_overtaken_telegram_does_not() {
    let address = format!("127.0.0.1:{}", free_port());
    let spec: KukaRsiSpec = serde_json::from_value(serde_json::json!({"address": address})).expect("a specification");
    let mut arm: KukaArm<6> = KukaRsi::arm(&spec, Arc::new(()));
    let (ipoc, mut next) = tokio::sync::watch::channel(5_000_u64);
    tokio::spawn(async move {
        let socket = tokio::net::UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
        loop {
            let report = RsiReport { ipoc: *next.borrow_and_update(), ..RsiReport::default() };
            let _ = socket.send_to(report.encode().as_bytes(), &address).await;
            sleep(Duration::from_millis(10)).await;
        }
    });
    arm.connect().await.expect("connected");
    ipoc.send_replace(4_900);
    sleep(Duration::from_millis(50)).await;
    ipoc.send_replace(5_010);
    arm.state().await.expect("it goes on");
    ipoc.send_replace(100);
    sleep(Duration::from_millis(50)).await;
    assert!(matches!(arm.state().await, Err(DeviceError::Closed { .. })));
}

/// The advice was to see whether the controller is on.
#[tokio::test]
async fn an_address_that_another_program_has_is_told_as_one_of_this_machine() {
    let other = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
    let address = other.local_addr().expect("an address").to_string();
    let spec: KukaRsiSpec = serde_json::from_value(serde_json::json!({"address": address})).expect("a specification");
    let mut arm: KukaArm<6> = KukaRsi::arm(&spec, Arc::new(()));
    let told = arm.connect().await.expect_err("taken").to_string();
    assert!(told.starts_with(&format!("this machine cannot listen at {address} (")), "{told}");
    assert!(told.ends_with("with a port that no other program has"), "{told}");
}

#[tokio::test(start_paused = true)]
async fn a_machine_that_stood_still_is_told_from_a_restart_of_rsi() {
    for (stood_still_ms, told) in [(1500, "this machine stood still for 1500 ms"), (0, "RSI was restarted")] {
        let address = format!("127.0.0.1:{}", free_port());
        let spec: KukaRsiSpec = serde_json::from_value(serde_json::json!({"address": address})).expect("a specification");
        let arm: KukaArm<6> = KukaRsi::arm(&spec, Arc::new(()));
        let (_, mut link) = StreamedProtocol::<6>::open(&arm.protocol).await.expect("bound");
        let controller = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
        let telegram = |ipoc: u64| RsiReport { ipoc, ..RsiReport::default() }.encode();
        controller.send_to(telegram(5_000).as_bytes(), &address).await.expect("sent");
        StreamedLink::<6>::report(&mut link).await.expect("a report");
        advance(Duration::from_millis(stood_still_ms)).await;
        controller.send_to(telegram(6_500).as_bytes(), &address).await.expect("sent");
        let error = StreamedLink::<6>::report(&mut link).await.expect_err("another start, or none that is known");
        assert!(matches!(&error, DeviceError::Closed { reason } if reason.contains(told)), "{error}");
    }
}
