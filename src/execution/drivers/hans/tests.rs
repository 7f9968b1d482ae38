//! The driver against the simulated controller, on sockets of this machine.

use std::sync::Arc;

use tokio::io::AsyncReadExt;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::*;
use crate::cell::{Presets, Robot, SpecLibrary};
use crate::execution::device::STOP_ATTEMPT;
use crate::execution::simulators::faults::{FaultCommand, Faults};
use crate::execution::simulators::hans::{HansAddresses, HansController, HansSimulator};
use crate::execution::tests::simulated_network::{NetworkDialer, Passage, RoughNetwork};

/// Joints where the simulated arm begins, degrees.
const HOME_DEG: [f64; 6] = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0];
/// Joints away from there, degrees.
const AWAY_DEG: [f64; 6] = [20.0, -10.0, 70.0, 15.0, 30.0, -25.0];
/// Watchdog of an arm that is fed, or does not need to be.
const WATCHDOG: Duration = Duration::from_millis(200);
/// Watchdog of a stream that moves while nobody feeds it: longer than this machine may be busy.
const SERVO_WATCHDOG: Duration = Duration::from_secs(5);

struct Bench {
    arm: HansArm,
    addresses: HansAddresses,
    faults: Arc<Faults>,
    joints: Box<dyn Fn() -> [f64; 6] + Send>,
    server: JoinHandle<()>,
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.server.abort();
    }
}

fn robot(name: &str) -> Robot {
    Presets.robot(name).expect("a preset").build().expect("a valid preset")
}

fn spec(address: String) -> HansSpec {
    let spec = serde_json::json!({"address": address, "model": "HANS-E05", "reply_timeout_ms": 250});
    serde_json::from_value(spec).expect("a specification")
}

async fn bench() -> Bench {
    let home = HOME_DEG.map(f64::to_radians);
    let simulator = HansSimulator::listen("127.0.0.1:0", robot("hans-e05"), home, 1.0).await.expect("a socket");
    let addresses = simulator.addresses().expect("addresses");
    let (faults, joints) = (simulator.faults(), Box::new(simulator.joints()));
    let wiring = Wiring::over_tcp("arm", Arc::new(()));
    let arm = HansArm::new(spec(addresses.text.to_string()), robot("hans-e05").kinematics, wiring);
    Bench { arm, addresses, faults, joints, server: tokio::spawn(simulator.serve()) }
}

fn target(sequence: u64, joints_deg: [f64; 6], speed_deg_s: f64) -> Target<6> {
    Target {
        sequence,
        positions_rad: joints_deg.map(f64::to_radians),
        max_speed_rad_s: [speed_deg_s.to_radians(); 6],
        max_acceleration_rad_s2: [300_f64.to_radians(); 6],
        duration: Duration::from_secs(1),
    }
}

impl Bench {
    async fn ready() -> Self {
        let mut bench = bench().await;
        bench.arm.connect().await.expect("a controller");
        bench.arm.arm(WATCHDOG).await.expect("armed");
        bench
    }

    /// Waits until the arm is in position.
    async fn arrive(&mut self) -> ArmState {
        let arrived = async {
            loop {
                self.arm.keep_alive().await.expect("alive");
                let state = self.arm.state().await.expect("a state");
                if state.condition.in_position {
                    return state;
                }
                sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(Duration::from_secs(5), arrived).await.expect("in position")
    }

    /// Joints when they have been at rest, degrees.
    async fn resting(&self) -> [f64; 6] {
        sleep(Duration::from_millis(400)).await;
        let joints = (self.joints)();
        sleep(Duration::from_millis(300)).await;
        assert_eq!((self.joints)(), joints, "nothing moves");
        joints.map(f64::to_degrees)
    }
}

#[tokio::test]
async fn the_arm_goes_there_and_back() {
    let mut bench = bench().await;
    let identity = bench.arm.connect().await.expect("a controller");
    assert_eq!((identity.maker.as_str(), identity.model.as_str()), ("Han's", "hans-e05"));
    assert!(matches!(bench.arm.start(&target(1, AWAY_DEG, 90.0)).await, Err(DeviceError::NotReady { .. })), "not armed");
    bench.arm.arm(WATCHDOG).await.expect("armed");
    for (sequence, joints_deg) in [(1, AWAY_DEG), (2, HOME_DEG)] {
        bench.arm.start(&target(sequence, joints_deg, 90.0)).await.expect("accepted");
        let moving = bench.arm.state().await.expect("a state");
        assert!(moving.condition.moving && !moving.condition.in_position);
        let refused = bench.arm.start(&target(9, HOME_DEG, 90.0)).await;
        assert_eq!(refused, Err(DeviceError::Refused { code: 20004, text: "the robot already moves".into() }));
        let state = bench.arrive().await;
        for ((measured, wanted), real) in state.positions_rad.iter().zip(joints_deg).zip((bench.joints)()) {
            assert!((measured.to_degrees() - wanted).abs() < 1e-4 && (real - measured).abs() < 1e-6);
        }
        bench.arm.keep_alive().await.expect("alive");
    }
    bench.arm.release().await.expect("released");
    assert!(matches!(bench.arm.state().await, Err(DeviceError::Closed { .. })));
}

#[tokio::test]
async fn nothing_moves_after_a_stop_and_only_arming_starts_again() {
    let mut bench = Bench::ready().await;
    bench.arm.start(&target(1, [90.0, -30.0, 60.0, 0.0, 30.0, 0.0], 45.0)).await.expect("accepted");
    sleep(Duration::from_millis(400)).await;
    let mut sent_at = None;
    let acknowledged_at = bench.arm.stop(&mut sent_at).await.expect("acknowledged");
    assert!(sent_at.is_some_and(|sent_at| sent_at <= acknowledged_at));
    let rest = bench.resting().await;
    assert!((3.0..60.0).contains(&rest[0]), "stopped on the way: {rest:?}");
    let state = bench.arm.state().await.expect("a state");
    assert!(!state.condition.moving && !state.condition.in_position);
    assert!(matches!(bench.arm.start(&target(2, HOME_DEG, 90.0)).await, Err(DeviceError::NotReady { .. })));
    bench.arm.stop(&mut None).await.expect("again");
    bench.arm.arm(WATCHDOG).await.expect("armed");
    bench.arm.start(&target(3, HOME_DEG, 90.0)).await.expect("accepted");
    bench.arrive().await;
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn faults_show_in_the_state_stop_the_arm_and_keep_it_from_being_armed() {
    for (fault, shows) in [
        (FaultCommand::EmergencyStop(true), (|condition| condition.emergency_stop) as fn(Condition) -> bool),
        (FaultCommand::Guard(true), |condition| condition.guard_open),
        (FaultCommand::Alarm(Some(40_034)), |condition| condition.fault == Some(FaultCode(40_034))),
    ] {
        let mut bench = Bench::ready().await;
        bench.arm.start(&target(1, [90.0, -30.0, 60.0, 0.0, 30.0, 0.0], 45.0)).await.expect("accepted");
        sleep(Duration::from_millis(200)).await;
        bench.faults.apply(fault);
        let rest = bench.resting().await;
        assert!(rest[0] < 60.0, "{fault:?}: {rest:?}");
        let state = bench.arm.state().await.expect("a state");
        assert!(shows(state.condition) && !state.condition.moving, "{fault:?}: {:?}", state.condition);
        assert!(matches!(bench.arm.arm(WATCHDOG).await, Err(DeviceError::NotReady { .. })), "{fault:?}");
        assert!(bench.arm.start(&target(2, HOME_DEG, 90.0)).await.is_err(), "{fault:?}");
        assert_eq!(bench.resting().await, rest);
    }
}

#[tokio::test]
async fn silence_and_lateness_are_told_and_late_replies_are_not_taken_for_others() {
    let mut bench = Bench::ready().await;
    bench.faults.apply(FaultCommand::Silent(true));
    assert_eq!(bench.arm.state().await, Err(DeviceError::Silent { waited: Duration::from_millis(250) }));
    let mut bench = Bench::ready().await;
    bench.faults.apply(FaultCommand::Late(Duration::from_millis(300)));
    assert_eq!(bench.arm.state().await, Err(DeviceError::Silent { waited: Duration::from_millis(250) }));
    // One more is asked and given up, then replies come in time: the two that are owed come first and are thrown away.
    let given_up = timeout(Duration::from_millis(20), bench.arm.fsm()).await;
    assert!(given_up.is_err());
    bench.faults.apply(FaultCommand::Clear);
    sleep(Duration::from_millis(700)).await;
    let state = bench.arm.state().await.expect("a state");
    assert!((state.positions_rad[1].to_degrees() - HOME_DEG[1]).abs() < 1e-4);
}

#[tokio::test]
async fn a_link_that_is_cut_on_the_way_still_takes_a_stop() {
    let mut bench = Bench::ready().await;
    bench.arm.start(&target(1, [90.0, -30.0, 60.0, 0.0, 30.0, 0.0], 30.0)).await.expect("accepted");
    sleep(Duration::from_millis(200)).await;
    bench.faults.apply(FaultCommand::Cut);
    assert!(matches!(bench.arm.state().await, Err(DeviceError::Closed { .. })));
    assert!(matches!(bench.arm.keep_alive().await, Err(DeviceError::Closed { .. })), "it does not connect by itself");
    bench.arm.stop(&mut None).await.expect("acknowledged over a new connection");
    let rest = bench.resting().await;
    assert!(rest[0] < 45.0, "{rest:?}");
}

#[tokio::test(start_paused = true)]
async fn a_stop_gets_past_a_half_open_link_within_an_attempt_however_long_replies_are_waited_for() {
    let controller = HansController::new(robot("hans-e05"), HOME_DEG.map(f64::to_radians), 1.0);
    let served = controller.clone();
    let network = RoughNetwork::new(1, move |end| {
        let served = served.clone();
        tokio::spawn(async move { served.talk(end).await });
    });
    let wiring = Wiring { dialer: Arc::new(NetworkDialer(Arc::clone(&network))), log: Arc::new(()), device: "arm" };
    let spec = HansSpec { reply_timeout_ms: 1000, ..spec("arm:10003".to_owned()) };
    let mut arm = HansArm::new(spec, robot("hans-e05").kinematics, wiring);
    arm.connect().await.expect("a controller");
    arm.arm(WATCHDOG).await.expect("armed");
    arm.start(&target(1, [90.0, -30.0, 60.0, 0.0, 30.0, 0.0], 30.0)).await.expect("accepted");
    // What is sent over the link that there is is lost from here on.
    network.set_passage(Passage::Lost);
    network.set_passage(Passage::Open);
    let (asked_at, mut sent_at) = (Instant::now(), None);
    let stopped = timeout(STOP_ATTEMPT, arm.stop(&mut sent_at)).await.expect("within an attempt");
    let acknowledged_at = stopped.expect("acknowledged over a new link");
    // The request that was lost went out too, and is told.
    let sent_at = sent_at.expect("sent");
    assert!(sent_at < asked_at + STOP_WAIT && acknowledged_at >= asked_at + STOP_WAIT, "{:?}", sent_at - asked_at);
    sleep(Duration::from_secs(1)).await;
    let rest = controller.joints_rad();
    assert!(rest[0].to_degrees() < 45.0, "{rest:?}");
    sleep(Duration::from_secs(1)).await;
    assert_eq!(controller.joints_rad(), rest);
}

/// The stop went out, and was told as not sent since nothing answered it; and one that nobody takes does not go out.
#[tokio::test]
async fn a_stop_that_nothing_answers_is_told_as_sent_and_one_that_cannot_be_sent_is_not() {
    let mut bench = Bench::ready().await;
    bench.faults.apply(FaultCommand::Silent(true));
    let mut sent_at = None;
    assert!(bench.arm.stop(&mut sent_at).await.is_err(), "not answered");
    assert!(sent_at.is_some());
    bench.server.abort();
    let _ = (&mut bench.server).await;
    (bench.arm.link, sent_at) = (None, None);
    assert!(matches!(bench.arm.stop(&mut sent_at).await, Err(DeviceError::Unreachable { .. })));
    assert_eq!(sent_at, None);
}

#[tokio::test]
async fn another_robot_and_nobody_are_refused_at_connect() {
    let mut other = bench().await;
    other.arm.kinematics = robot("hans-elfin10").kinematics;
    let error = other.arm.connect().await.expect_err("another arm");
    assert!(matches!(&error, DeviceError::OtherDevice { found, .. } if found.contains("mm")), "{error}");
    let mut other = bench().await;
    other.arm.spec.model = Some("S30".into());
    assert!(matches!(other.arm.connect().await, Err(DeviceError::OtherDevice { .. })));
    let mut nobody = bench().await;
    nobody.server.abort();
    let _ = (&mut nobody.server).await;
    nobody.arm.spec.connect_timeout_ms = 200;
    assert!(matches!(nobody.arm.connect().await, Err(DeviceError::Unreachable { .. })));
}

#[tokio::test]
async fn drives_that_are_disabled_are_enabled_by_arming_and_disabled_at_release() {
    let mut bench = bench().await;
    bench.arm.connect().await.expect("a controller");
    bench.arm.command(HansCommand::GrpPowerOff).await.expect("off");
    assert!(!bench.arm.state().await.expect("a state").condition.powered);
    bench.arm.arm(WATCHDOG).await.expect("armed");
    assert!(bench.arm.state().await.expect("a state").condition.powered);
    bench.arm.release().await.expect("released");
    bench.arm.connect().await.expect("again");
    assert!(!bench.arm.state().await.expect("a state").condition.powered);
}

#[tokio::test]
async fn drives_whose_enabling_was_given_up_before_its_reply_are_disabled_at_release() {
    let mut bench = bench().await;
    bench.arm.connect().await.expect("a controller");
    bench.arm.command(HansCommand::GrpPowerOff).await.expect("off");
    assert!(timeout(Duration::ZERO, bench.arm.enable()).await.is_err(), "asked for, not answered");
    bench.arm.release().await.expect("released");
    bench.arm.connect().await.expect("again");
    assert!(!bench.arm.state().await.expect("a state").condition.powered);
}

fn servo(addresses: HansAddresses, period_ms: u32) -> Option<HansServoSpec> {
    let (address, state_address) = (addresses.servo.to_string(), addresses.realtime.to_string());
    Some(HansServoSpec { address, state_address, period_ms, start_argument: 8000.0, lookahead_secs: 0.004 })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "long: tests/all runs it"]
async fn joints_are_streamed_there_and_back_and_stand_after_a_stop() {
    let mut bench = bench().await;
    bench.arm.spec.servo = servo(bench.addresses, 4);
    bench.arm.connect().await.expect("a controller");
    bench.arm.arm(SERVO_WATCHDOG).await.expect("armed");
    for (sequence, joints_deg) in [(1, AWAY_DEG), (2, HOME_DEG)] {
        bench.arm.start(&target(sequence, joints_deg, 60.0)).await.expect("accepted");
        assert!(bench.arm.state().await.expect("a state").condition.moving);
        bench.arrive().await;
        bench.arm.keep_alive().await.expect("alive");
        sleep(Duration::from_millis(20)).await;
        for (real, wanted) in (bench.joints)().iter().zip(joints_deg) {
            assert!((real.to_degrees() - wanted).abs() < 1e-4, "{real} {wanted}");
        }
    }
    let jitter = bench.arm.jitter().expect("a histogram");
    assert!(jitter.periods > 100, "{}", jitter.periods);
    bench.arm.start(&target(3, [90.0, -30.0, 60.0, 0.0, 30.0, 0.0], 45.0)).await.expect("accepted");
    sleep(Duration::from_millis(400)).await;
    bench.arm.stop(&mut None).await.expect("acknowledged");
    let rest = bench.resting().await;
    assert!((3.0..60.0).contains(&rest[0]), "stopped on the way: {rest:?}");
    assert!(matches!(bench.arm.start(&target(4, HOME_DEG, 60.0)).await, Err(DeviceError::NotReady { .. })));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_axis_that_was_measured_beside_the_program_is_not_a_jump() {
    let mut bench = bench().await;
    bench.arm.spec.servo = servo(bench.addresses, 4);
    bench.arm.connect().await.expect("a controller");
    bench.arm.arm(SERVO_WATCHDOG).await.expect("armed");
    // By the program joint 1 turns alone. Joint 4 was measured in its place then, and 0.0004° beside it when it was armed.
    let mut away_deg = HOME_DEG;
    (away_deg[0], away_deg[3]) = (20.0, HOME_DEG[3] + 4e-4);
    let mut target = target(1, away_deg, 0.0);
    (target.max_speed_rad_s[0], target.max_acceleration_rad_s2) = (0.5, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    bench.arm.start(&target).await.expect("accepted");
    sleep(Duration::from_millis(150)).await;
    let turned_deg = (bench.joints)()[0].to_degrees() - HOME_DEG[0];
    assert!((0.0..8.0).contains(&turned_deg), "{turned_deg}° in 0.15 s");
    bench.arrive().await;
}

/// The controller was left in its servo motion by a run that ended without a stop, and refused to be armed by the next.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_that_is_given_back_leaves_the_controller_ready_for_the_next_run() {
    let mut bench = bench().await;
    bench.arm.spec.servo = servo(bench.addresses, 4);
    for _ in 0..2 {
        bench.arm.connect().await.expect("a controller");
        bench.arm.arm(WATCHDOG).await.expect("the controller stands by");
        // Until its first set points are taken.
        sleep(Duration::from_millis(100)).await;
        bench.arm.release().await.expect("released");
    }
}

/// The thread led an arm on to the end of its move, whatever became of the session.
#[test]
fn a_stream_whose_session_gives_no_sign_of_life_is_led_to_rest_and_takes_no_target() {
    let (began, period) = (std::time::Instant::now(), Duration::from_millis(4));
    let mut course = servo::ServoCourse::still([0.0; 6], WATCHDOG, began);
    let far = target(1, [90.0; 6], 60.0);
    course.lead(&far).expect("fed");
    let beats = WATCHDOG.as_millis() as u32 / 4;
    let moved: Vec<[f64; 6]> = (1..=beats).map(|beat| course.advance(period, began + period * beat)).collect();
    assert!(moved.windows(2).all(|pair| pair[1][0] > pair[0][0]), "on its way while it is fed");
    assert_eq!(course.check(), Ok(()));
    let late = |beat: u32| began + period * (beats + beat);
    let rest: Vec<[f64; 6]> = (1..=500).map(|beat| course.advance(period, late(beat))).collect();
    let [before, at_rest] = [moved[moved.len() - 1][0], rest[rest.len() - 1][0]].map(f64::to_degrees);
    assert!(at_rest - before < 45.0 && rest[0][0] > moved[moved.len() - 1][0], "a ramp from {before}° to {at_rest}°");
    assert_eq!(rest[rest.len() - 2], rest[rest.len() - 1], "at rest");
    let told = course.check().expect_err("not fed").to_string();
    assert!(told.contains("it was not kept alive in time"), "{told}");
    assert_eq!(course.lead(&far).map_err(|error| error.to_string()), Err(told));
}

/// A feed, a pause and a state took longer than the watchdog's time beside a table that answered as slowly as it may.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_state_that_is_read_is_a_sign_of_life_for_the_stream() {
    let mut bench = bench().await;
    bench.arm.spec.servo = servo(bench.addresses, 4);
    bench.arm.connect().await.expect("a controller");
    bench.arm.arm(SERVO_WATCHDOG).await.expect("armed");
    let fed_at = |arm: &HansArm| arm.servo.as_ref().expect("a stream").fed_at();
    let before = fed_at(&bench.arm);
    bench.arm.state().await.expect("a state");
    assert!(fed_at(&bench.arm) > before);
}

/// Set points that wait for the network would be carried out after the stop on the text port: the connection is reset.
#[tokio::test]
async fn set_points_that_the_network_has_not_taken_are_not_sent_once_the_stream_has_ended() {
    let port = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let (address, state_address) = (port.local_addr().expect("an address").to_string(), String::new());
    let spec = HansServoSpec { address, state_address, period_ms: 4, start_argument: 8000.0, lookahead_secs: 0.004 };
    let controller = tokio::spawn(async move {
        let (mut stream, _) = port.accept().await.expect("a client");
        let mut taken = Vec::new();
        stream.read_to_end(&mut taken).await.map_err(|error| error.kind())
    });
    let stream = ServoStream::begin(&spec, HOME_DEG, WATCHDOG, &Wiring::over_tcp("arm", Arc::new(()))).await.expect("a stream");
    sleep(Duration::from_millis(50)).await;
    stream.end().await;
    let ended = timeout(Duration::from_secs(5), controller).await.expect("it ends").expect("no panic");
    assert_eq!(ended, Err(std::io::ErrorKind::ConnectionReset));
}

/// Set points went on until some other work had ended, beyond the stop on the text port.
#[test]
fn a_stream_ends_although_no_thread_is_free_to_wait_for_it() {
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    let runtime = runtime.enable_all().max_blocking_threads(1).build().expect("a runtime");
    let (free, held) = std::sync::mpsc::channel::<()>();
    runtime.block_on(async {
        let port = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let (address, state_address) = (port.local_addr().expect("an address").to_string(), String::new());
        let spec = HansServoSpec { address, state_address, period_ms: 4, start_argument: 8000.0, lookahead_secs: 0.004 };
        let controller = tokio::spawn(async move {
            let (mut stream, _) = port.accept().await.expect("a client");
            let _ = stream.read_to_end(&mut Vec::new()).await;
        });
        let stream =
            ServoStream::begin(&spec, HOME_DEG, WATCHDOG, &Wiring::over_tcp("arm", Arc::new(()))).await.expect("a stream");
        tokio::task::spawn_blocking(move || held.recv());
        stream.end().await;
        timeout(Duration::from_secs(5), controller).await.expect("it ends").expect("no panic");
    });
    drop(free);
}

#[tokio::test]
async fn another_cycle_than_the_controller_s_is_not_streamed_at() {
    let mut bench = bench().await;
    bench.arm.spec.servo = servo(bench.addresses, 20);
    bench.arm.connect().await.expect("a controller");
    let error = bench.arm.arm(WATCHDOG).await.expect_err("4 ms");
    assert!(matches!(&error, DeviceError::NotReady { reason } if reason.contains("4 ms")), "{error}");
}
