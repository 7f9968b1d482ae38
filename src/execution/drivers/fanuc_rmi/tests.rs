//! The driver beside our simulator; the simulator stands beside a client that nobody here wrote in the integration tests.

use std::sync::{Arc, Mutex};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::time::{sleep, timeout};

use super::*;
use crate::execution::device::STOP_ATTEMPT;
use crate::execution::drivers::stream::ByteStream;
use crate::execution::drivers::there_and_back::{KeptBytes, WATCHDOG, arrive, target, there_and_back};
use crate::execution::simulators::fanuc_rmi::{RmiCell, RmiController};
use crate::execution::tests::simulated_network::{NetworkDialer, Passage, RoughNetwork};

async fn simulator() -> (String, Arc<Mutex<RmiCell>>) {
    let controller = RmiController::bind("127.0.0.1:0").await.expect("a port");
    let (address, cell) = (controller.address().expect("an address"), controller.cell());
    tokio::spawn(controller.serve());
    (address.to_string(), cell)
}

fn arm<const N: usize>(address: &str, joint_3_from: JointThreeOrigin, log: Arc<KeptBytes>) -> FanucArm<N> {
    let spec = FanucRmiSpec { address: address.to_owned(), joint_3_from: Some(joint_3_from), group_mask: None };
    FanucArm::new(&spec, Wiring::over_tcp("arm", log))
}

/// Packets that a controller of some lines was sent, in order.
type Seen = Arc<Mutex<Vec<RmiRequest>>>;

/// Answers one client until it goes, at the door and in a session alike: it takes a move, and does not end it.
async fn talk(mut stream: impl ByteStream, answer: impl Fn(&RmiRequest) -> Option<RmiReply>, seen: Seen) {
    let (mut unread, mut chunk) = (Vec::new(), [0; 512]);
    while let Ok(read @ 1..) = stream.read(&mut chunk).await {
        unread.extend_from_slice(&chunk[..read]);
        while let Some(end) = unread.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = unread.drain(..=end).collect();
            let request = RmiRequest::decode(&line).expect("a packet");
            seen.lock().expect("packets").push(request.clone());
            if let Some(reply) = answer(&request) {
                let _ = stream.write_all(reply.encode().as_bytes()).await;
            }
        }
    }
}

fn answer(request: &RmiRequest) -> Option<RmiReply> {
    let running = RmiStatus { servo_ready: true, program: RmiProgram::Running, ..RmiStatus::default() };
    Some(match request {
        RmiRequest::Connect => RmiReply::Connected { port: 16002, version: (7, 1) },
        RmiRequest::GetStatus => RmiReply::Status(running),
        RmiRequest::ReadJointAngles { .. } => RmiReply::Joints(RmiJoints::default()),
        RmiRequest::ReadError => RmiReply::ErrorText("No Error".to_owned()),
        RmiRequest::JointMotion(_) => return None,
        RmiRequest::Disconnect
        | RmiRequest::Initialize { .. }
        | RmiRequest::SetOverRide(_)
        | RmiRequest::Abort
        | RmiRequest::Pause
        | RmiRequest::Continue
        | RmiRequest::Reset => RmiReply::Done { command: request.name().to_owned() },
    })
}

/// The network of a controller that answers so, and an arm that dials into it.
fn over_a_network(
    answer: impl Fn(&RmiRequest) -> Option<RmiReply> + Copy + Send + Sync + 'static,
) -> (FanucArm<6>, Arc<RoughNetwork>, Seen) {
    let seen = Seen::default();
    let shown = Arc::clone(&seen);
    let network = RoughNetwork::new(1, move |end| {
        tokio::spawn(talk(end, answer, Arc::clone(&shown)));
    });
    let wiring = Wiring { dialer: Arc::new(NetworkDialer(Arc::clone(&network))), log: Arc::new(()), device: "arm" };
    let joint_3_from = Some(JointThreeOrigin::Ground);
    let spec = FanucRmiSpec { address: "arm:16001".to_owned(), joint_3_from, group_mask: None };
    (FanucArm::new(&spec, wiring), network, seen)
}

#[tokio::test(start_paused = true)]
async fn a_stop_gets_past_a_half_open_link_within_an_attempt() {
    let (mut arm, network, seen) = over_a_network(answer);
    arm.connect().await.expect("a controller");
    arm.arm(WATCHDOG).await.expect("armed");
    arm.start(&target(1, [1.0; 6], Duration::from_secs(2))).await.expect("accepted");
    // What is sent over the session that there is is lost from here on.
    network.set_passage(Passage::Lost);
    network.set_passage(Passage::Open);
    let (asked_at, mut sent_at) = (Instant::now(), None);
    let stopped = timeout(STOP_ATTEMPT, arm.stop(&mut sent_at)).await.expect("within an attempt");
    let acknowledged_at = stopped.expect("acknowledged over a new session");
    // The request that was lost went out too, and is told.
    let sent_at = sent_at.expect("sent");
    assert!(sent_at < asked_at + STOP_WAIT && acknowledged_at >= asked_at + STOP_WAIT, "{:?}", sent_at - asked_at);
    arm.state().await.expect("a state");
    let seen = seen.lock().expect("packets").clone();
    let opened = seen.iter().rposition(|request| *request == RmiRequest::Connect).expect("a new session");
    assert_eq!(seen[opened + 1..opened + 3], [RmiRequest::Pause, RmiRequest::Abort], "held, and forgotten");
    assert_eq!(arm.arm(WATCHDOG).await, Err(reconnected()), "a controller that nobody checked");
}

#[tokio::test(start_paused = true)]
async fn a_stop_gets_past_a_session_that_was_cut() {
    let (mut arm, network, _) = over_a_network(answer);
    arm.connect().await.expect("a controller");
    arm.arm(WATCHDOG).await.expect("armed");
    network.cut();
    assert!(matches!(arm.state().await, Err(DeviceError::Closed { .. })));
    timeout(STOP_ATTEMPT, arm.stop(&mut None)).await.expect("within an attempt").expect("acknowledged over a new session");
}

#[tokio::test(start_paused = true)]
async fn a_state_is_no_younger_than_the_question_for_it() {
    let (mut arm, _network, _) = over_a_network(answer);
    arm.connect().await.expect("a controller");
    let state = arm.state().await.expect("a state");
    assert!(state.at.elapsed() >= Duration::from_millis(1), "{:?}", state.at.elapsed());
}

#[tokio::test(start_paused = true)]
async fn a_program_whose_making_was_given_up_is_ended_at_release() {
    let unmade = |request: &RmiRequest| answer(request).filter(|_| !matches!(request, RmiRequest::Initialize { .. }));
    let (mut arm, _network, seen) = over_a_network(unmade);
    arm.connect().await.expect("a controller");
    assert!(timeout(Duration::from_millis(500), arm.arm(WATCHDOG)).await.is_err(), "not answered");
    arm.release().await.expect("released");
    let seen = seen.lock().expect("packets").clone();
    assert!(seen.ends_with(&[RmiRequest::Abort, RmiRequest::Disconnect]), "{seen:?}");
}

#[tokio::test(start_paused = true)]
async fn a_program_whose_end_a_stop_asked_for_is_ended_at_release_unless_that_was_answered() {
    let unended = |request: &RmiRequest| answer(request).filter(|_| *request != RmiRequest::Abort);
    let (mut arm, _network, seen) = over_a_network(unended);
    arm.connect().await.expect("a controller");
    arm.arm(WATCHDOG).await.expect("armed");
    arm.stop(&mut None).await.expect("held");
    assert!(matches!(arm.release().await, Err(DeviceError::Silent { .. })), "not ended");
    let tail = [RmiRequest::Pause, RmiRequest::Abort, RmiRequest::Abort, RmiRequest::Disconnect];
    assert!(seen.lock().expect("packets").ends_with(&tail), "asked for again");
    let (mut arm, _network, seen) = over_a_network(answer);
    arm.connect().await.expect("a controller");
    arm.arm(WATCHDOG).await.expect("armed");
    arm.stop(&mut None).await.expect("held");
    arm.state().await.expect("a state");
    arm.release().await.expect("released");
    let seen = seen.lock().expect("packets").clone();
    assert_eq!(seen.iter().filter(|request| **request == RmiRequest::Abort).count(), 1, "{seen:?}");
}

#[tokio::test]
async fn a_stop_is_not_acknowledged_while_a_program_runs_on_from_a_session_that_broke() {
    let (address, cell) = simulator().await;
    let log = KeptBytes::new();
    let mut arm: FanucArm<6> = arm(&address, JointThreeOrigin::Ground, log.clone());
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    arm.start(&target(1, [1.0; 6], Duration::from_secs(60))).await.expect("accepted");
    // The link breaks on the way.
    arm.session = None;
    for _ in 0..2 {
        let stopped = arm.stop(&mut None).await;
        let is_told = matches!(&stopped, Err(DeviceError::Refused { code: 2_556_937, text }) if text.contains("runs on"));
        assert!(is_told, "{stopped:?}");
        // A slow axis seems to stand between two states: it was told as at rest.
        assert!(arm.state().await.expect("a state").condition.moving);
    }
    // Whatever ends the program, there is nothing left to hold.
    cell.lock().expect("a cell").set_fault(Some("SRVO-002"));
    arm.stop(&mut None).await.expect("nothing runs");
    assert!(!arm.state().await.expect("a state").condition.moving);
    assert!(matches!(arm.release().await, Err(DeviceError::Refused { .. })), "there is nothing to end");
    let sent: Vec<String> = log.sent().iter().map(|line| String::from_utf8_lossy(line).into_owned()).collect();
    assert!(sent[sent.len() - 2].contains("FRC_Abort"), "its end was not answered before: {sent:?}");
}

#[tokio::test]
async fn a_session_is_given_back_whatever_becomes_of_its_program() {
    let (address, _) = simulator().await;
    let log = KeptBytes::new();
    let mut arm: FanucArm<6> = arm(&address, JointThreeOrigin::Ground, log.clone());
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    arm.session().expect("open").done(&RmiRequest::Abort).await.expect("ended by somebody else");
    assert!(matches!(arm.release().await, Err(DeviceError::Refused { .. })), "there is nothing to end");
    let last = log.sent().pop().expect("sent");
    assert!(String::from_utf8_lossy(&last).contains("FRC_Disconnect"), "{last:?}");
}

#[tokio::test]
async fn arm_and_table_go_there_and_back() {
    let (address, _) = simulator().await;
    let mut arm: FanucArm<7> = arm(&address, JointThreeOrigin::Ground, KeptBytes::new());
    let identity = arm.connect().await.expect("connected");
    assert_eq!((identity.maker.as_str(), identity.firmware.as_deref()), ("FANUC", Some("RMI 7.1")));
    arm.arm(WATCHDOG).await.expect("armed");
    there_and_back(&mut arm, 0.2).await;
    arm.release().await.expect("released");
    // The session is free again.
    arm.connect().await.expect("connected again");
}

#[tokio::test]
async fn an_arm_whose_origin_of_joint_3_is_unsaid_is_sent_nothing() {
    let (address, _) = simulator().await;
    let spec = FanucRmiSpec { address, joint_3_from: None, group_mask: None };
    let log = KeptBytes::new();
    let mut arm: FanucArm<6> = FanucArm::new(&spec, Wiring::over_tcp("arm", log.clone()));
    let refused = arm.connect().await.expect_err("unsaid");
    assert!(matches!(&refused, DeviceError::NotReady { reason } if reason.contains("joint_3_from")), "{refused}");
    assert!(log.sent().is_empty());
}

#[tokio::test]
async fn a_joint_3_from_the_upper_arm_is_converted_both_ways() {
    let (address, cell) = simulator().await;
    let mut arm: FanucArm<6> = arm(&address, JointThreeOrigin::UpperArm, KeptBytes::new());
    arm.connect().await.expect("connected");
    arm.arm(WATCHDOG).await.expect("armed");
    let goal = [0.0, 0.3, 0.5, 0.0, 0.0, 0.0];
    arm.start(&target(1, goal, Duration::from_millis(200))).await.expect("accepted");
    let reached = arrive(&mut arm).await.positions_rad;
    assert!(reached.iter().zip(&goal).all(|(at, to)| (at - to).abs() < 1e-6), "{reached:?}");
    let wire_deg = cell.lock().expect("a cell").axes_deg()[2];
    assert!((wire_deg - 0.2_f64.to_degrees()).abs() < 1e-4, "from the ground: {wire_deg}");
}

#[tokio::test]
async fn a_stop_ends_the_move_and_nothing_goes_on() {
    let (address, cell) = simulator().await;
    let mut arm: FanucArm<6> = arm(&address, JointThreeOrigin::Ground, KeptBytes::new());
    arm.connect().await.expect("connected");
    assert!(arm.start(&target(1, [0.1; 6], Duration::from_secs(1))).await.is_err(), "not armed");
    arm.arm(WATCHDOG).await.expect("armed");
    arm.start(&target(1, [1.0; 6], Duration::from_secs(2))).await.expect("accepted");
    assert!(arm.start(&target(2, [0.0; 6], Duration::from_secs(1))).await.is_err(), "one at a time");
    sleep(Duration::from_millis(300)).await;
    let mut sent_at = None;
    let acknowledged_at = arm.stop(&mut sent_at).await.expect("stopped");
    assert!(sent_at.is_some_and(|sent_at| sent_at <= acknowledged_at));
    let at = cell.lock().expect("a cell").axes_deg();
    sleep(Duration::from_millis(200)).await;
    assert_eq!(cell.lock().expect("a cell").axes_deg(), at);
    assert!(at[0] > 0.0 && at[0] < 57.0, "{at:?}");
    assert!(arm.start(&target(3, [0.0; 6], Duration::from_secs(1))).await.is_err(), "arms anew first");
    arm.stop(&mut None).await.expect("again");
    arm.arm(WATCHDOG).await.expect("armed again");
    arm.start(&target(4, [0.0; 6], Duration::from_millis(100))).await.expect("accepted");
    assert!(arrive(&mut arm).await.positions_rad[0].abs() < 1e-6);
}

#[tokio::test]
async fn an_emergency_stop_is_seen_and_arming_refused() {
    let (address, cell) = simulator().await;
    let log = KeptBytes::new();
    let mut arm: FanucArm<6> = arm(&address, JointThreeOrigin::Ground, log.clone());
    arm.connect().await.expect("connected");
    let state = arm.state().await.expect("a state");
    assert!(state.condition.powered && !state.condition.emergency_stop && state.condition.in_position);
    cell.lock().expect("a cell").set_fault(Some("SRVO-002"));
    let condition = arm.state().await.expect("a state").condition;
    assert!(condition.emergency_stop && !condition.powered && condition.fault == Some(FaultCode(2)));
    assert!(matches!(arm.arm(WATCHDOG).await, Err(DeviceError::NotReady { .. })));
    cell.lock().expect("a cell").set_fault(Some("SRVO-004"));
    assert!(arm.state().await.expect("a state").condition.guard_open);
    let moves =
        |line: &Vec<u8>| String::from_utf8_lossy(line).contains("Motion") || String::from_utf8_lossy(line).contains("Initialize");
    assert!(!log.sent().iter().any(moves), "nothing that moves was sent");
}

#[tokio::test]
async fn a_dropped_question_leaves_the_next_answer_right() {
    let (address, _) = simulator().await;
    let mut arm: FanucArm<6> = arm(&address, JointThreeOrigin::Ground, KeptBytes::new());
    arm.connect().await.expect("connected");
    for _ in 0..50 {
        tokio::select! {
            biased;
            _ = arm.state() => {}
            () = tokio::task::yield_now() => {}
        }
    }
    arm.state().await.expect("a state");
    arm.stop(&mut None).await.expect("stopped");
}

#[tokio::test]
async fn an_answer_that_is_none_does_not_hold_up_the_next_question() {
    let (mut here, there) = tokio::io::duplex(4096);
    let wiring = Wiring::over_tcp("arm", KeptBytes::new());
    let mut session = Session::over(wiring.connection(Box::new(there)));
    here.write_all(b"{\"Command\": \"FRC_GetStatus\", \"ErrorID\": 0}\r\n").await.expect("written");
    assert!(matches!(session.status().await, Err(DeviceError::Malformed { .. })));
    here.write_all(b"{\"Command\": \"FRC_Abort\", \"ErrorID\": 0}\r\n").await.expect("written");
    session.done(&RmiRequest::Abort).await.expect("done");
    let mut sent = vec![0; 1024];
    let length = here.read(&mut sent).await.expect("read");
    assert!(String::from_utf8_lossy(&sent[..length]).contains("FRC_Abort"));
}

#[tokio::test]
async fn a_stop_is_sent_whatever_is_still_to_be_answered() {
    let door = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = door.local_addr().expect("an address").to_string();
    let seen = Arc::new(Mutex::new(String::new()));
    let shown = seen.clone();
    // A controller that connects and answers nothing.
    tokio::spawn(async move {
        let (mut stream, _) = door.accept().await.expect("a client");
        let session = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let reply = RmiReply::Connected { port: session.local_addr().expect("an address").port(), version: (7, 1) };
        stream.write_all(reply.encode().as_bytes()).await.expect("sent");
        let (mut stream, _) = session.accept().await.expect("a client");
        let mut bytes = Vec::new();
        while stream.read_buf(&mut bytes).await.is_ok_and(|read| read > 0) {
            shown.lock().expect("text").push_str(&String::from_utf8_lossy(&std::mem::take(&mut bytes)));
        }
    });
    let mut arm: FanucArm<6> = arm(&address, JointThreeOrigin::Ground, KeptBytes::new());
    arm.connect().await.expect("connected");
    assert!(timeout(Duration::from_millis(50), arm.state()).await.is_err(), "not answered");
    for stops in 1..=2 {
        assert!(timeout(Duration::from_millis(100), arm.stop(&mut None)).await.is_err(), "not answered");
        let sent = seen.lock().expect("text").clone();
        assert_eq!(sent.matches("FRC_Pause").count(), stops, "{sent}");
    }
}
