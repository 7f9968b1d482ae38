//! FANUC arms by the Remote Motion Interface, with the table as the first extended axis where `N` is 7. One instruction is under way
//! at a time; the controller has no watchdog for it: when this machine is lost, the arm ends that one move and stays.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use super::stream::{Connection, NOT_ARMED, STOP_WAIT, Wiring, not_connected, reconnected, within};
use crate::cell::{FanucRmiSpec, JointThreeOrigin};
use crate::execution::device::{Condition, DeviceError, DeviceState, FaultCode, Identity, MotionDevice, Target};
use crate::execution::protocol::fanuc_rmi::{
    MAX_LINE_BYTES, MAX_SEQUENCE, RmiFault, RmiJointMotion, RmiJoints, RmiProgram, RmiReply, RmiRequest, RmiSpeed, RmiStatus,
    error_text,
};

/// Longest time of attempts to connect.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest wait for an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Longest wait for a program to be created or ended.
const PROGRAM_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest wait for a program to end before its session is given back; less than a run waits for both.
const END_TIMEOUT: Duration = Duration::from_secs(1);

/// An arm by FANUC, with the table in place 7 where `N` is 7.
#[derive(Debug)]
pub struct FanucArm<const N: usize> {
    spec: FanucRmiSpec,
    wiring: Wiring,
    session: Option<Session>,
    /// The controller of the session is the one that connecting found.
    is_checked: bool,
    is_armed: bool,
    /// A program of this driver may be on the controller.
    has_program: bool,
}

impl<const N: usize> FanucArm<N> {
    /// The arm of a specification, not connected yet.
    #[must_use]
    pub fn new(spec: &FanucRmiSpec, wiring: Wiring) -> Self {
        let (is_checked, is_armed, has_program) = (false, false, false);
        Self { spec: spec.clone(), wiring, session: None, is_checked, is_armed, has_program }
    }

    /// Returns true unless every program of this driver is known to have ended.
    fn may_have_program(&self) -> bool {
        self.has_program && self.session.as_ref().is_none_or(|session| session.end != ProgramEnd::Answered)
    }

    fn session(&mut self) -> Result<&mut Session, DeviceError> {
        self.session.as_mut().ok_or_else(not_connected)
    }

    /// Link from which the program counts joint 3; without it, no angle is what it says.
    fn origin(&self) -> Result<JointThreeOrigin, DeviceError> {
        let unsaid =
            || DeviceError::NotReady { reason: "its section does not say joint_3_from; give ground or upper_arm".to_owned() };
        self.spec.joint_3_from.ok_or_else(unsaid)
    }

    /// Number of the motion group, where the specification names one.
    fn group(&self) -> Option<u8> {
        self.spec.group_mask.map(|mask| mask.trailing_zeros() as u8 + 1)
    }

    /// Opens a session; returns the version of the protocol.
    async fn open(&mut self, patience: Duration) -> Result<(u16, u16), DeviceError> {
        let mut door = Session::over(self.wiring.connect(&self.spec.address, patience).await?);
        let reply = door.ask(&RmiRequest::Connect, ANSWER_TIMEOUT).await?;
        let RmiReply::Connected { port, version } = reply else { return Err(unexpected(&reply)) };
        let host = self.spec.address.rsplit_once(':').map_or(self.spec.address.as_str(), |(host, _)| host);
        let connection = self.wiring.connect(&format!("{host}:{port}"), patience).await?;
        self.session = Some(Session::over(connection));
        Ok(version)
    }

    /// Holds the program over the session that there is, and has it forgotten: what is held could be continued at the teach pendant.
    async fn stop_once(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        let session = self.session()?;
        let paused_at = session.send_at_once(&RmiRequest::Pause).await?;
        sent_at.get_or_insert(paused_at);
        let paused = session.answer(ANSWER_TIMEOUT).await?;
        if !matches!(paused, RmiReply::Done { .. } | RmiReply::Refused { .. }) {
            return Err(unexpected(&paused));
        }
        let held = if let RmiReply::Refused { error, .. } = paused { session.nothing_to_hold(error).await } else { Ok(()) };
        let acknowledged_at = Instant::now();
        if held.is_ok() {
            session.under_way = None;
        }
        let may_have_program = self.may_have_program();
        let session = self.session()?;
        if may_have_program && !session.asked.contains(&RmiRequest::Abort) {
            // Its end may take seconds, which the stop does not wait for.
            session.end = ProgramEnd::Asked;
            session.send_at_once(&RmiRequest::Abort).await?;
        }
        held?;
        Ok(acknowledged_at)
    }
}

impl<const N: usize> MotionDevice<N> for FanucArm<N> {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        (self.session, self.is_checked, self.is_armed, self.has_program) = (None, false, false, false);
        self.origin()?;
        let version = self.open(CONNECT_TIMEOUT).await?;
        self.is_checked = true;
        let firmware = Some(format!("RMI {}.{}", version.0, version.1));
        Ok(Identity { maker: "FANUC".to_owned(), model: "controller with RMI".to_owned(), serial: None, firmware })
    }

    async fn state(&mut self) -> Result<DeviceState<N>, DeviceError> {
        let (group, origin) = (self.group(), self.origin()?);
        let session = self.session()?;
        let status = session.status().await?;
        let fault = if status.servo_ready { None } else { session.latest_fault().await? };
        // Measured later than this.
        let at = Instant::now();
        let joints = session.joints(group).await?;
        let positions_rad = joints
            .to_program(origin)
            .ok_or_else(|| DeviceError::Malformed { what: "joint angles without J7 for the table".to_owned() })?;
        Ok(DeviceState { at, positions_rad, condition: session.condition(&status, fault.as_ref()) })
    }

    async fn arm(&mut self, _watchdog: Duration) -> Result<(), DeviceError> {
        if !self.is_checked {
            return Err(reconnected());
        }
        let (group, group_mask) = (self.group(), self.spec.group_mask);
        let session = self.session()?;
        let status = session.status().await?;
        let not_ready = |reason: &str| Err(DeviceError::NotReady { reason: reason.to_owned() });
        if status.pendant_enabled {
            return not_ready("its teach pendant is on; switch it off and select AUTO");
        }
        if !status.servo_ready {
            return not_ready("it has a fault; clear it at the controller");
        }
        if status.motion_running {
            session.done(&RmiRequest::Abort).await?;
        }
        session.extended_deg = session.joints(group).await?.extended_deg;
        // Before it is sent: whoever gives the answer up, or gets none, leaves a program all the same.
        self.has_program = true;
        let session = self.session()?;
        session.end = ProgramEnd::NotAsked;
        session.done(&RmiRequest::Initialize { group_mask }).await?;
        (session.next_sequence, session.under_way, session.failure) = (1, None, None);
        session.is_taken_up = false;
        self.is_armed = true;
        Ok(())
    }

    async fn start(&mut self, target: &Target<N>) -> Result<(), DeviceError> {
        let (origin, speed) = (self.origin()?, RmiSpeed::lasting(target.duration)?);
        let is_armed = self.is_armed;
        let session = self.session()?;
        let joints = RmiJoints::of_program(&target.positions_rad, origin, session.extended_deg);
        session.look_for_failure()?;
        if !is_armed || session.under_way.is_some() {
            let reason = if is_armed { "it is still under way; wait until it has arrived" } else { NOT_ARMED };
            return Err(DeviceError::NotReady { reason: reason.to_owned() });
        }
        let sequence = session.next_sequence;
        session.next_sequence = if sequence == MAX_SEQUENCE { 1 } else { sequence + 1 };
        session.under_way = Some(sequence);
        let motion = RmiRequest::JointMotion(RmiJointMotion { sequence, joints, speed });
        session.connection.send(motion.encode().as_bytes()).await?;
        // An instruction is answered when it is done; a command that is sent after it, when it was taken or refused.
        let status = session.status().await?;
        session.look_for_failure()?;
        if status.program != RmiProgram::Running && session.under_way.is_some() {
            return Err(DeviceError::NotReady { reason: "its program is held; see the controller, and arm again".to_owned() });
        }
        Ok(())
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        // The controller has no watchdog.
        self.session()?.look_for_failure()
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        self.is_armed = false;
        // A controller that makes or ends a program may answer late, and moves nothing: its session is not given up for that.
        let wait = if self.session.as_ref().is_some_and(Session::is_changing_program) { ANSWER_TIMEOUT } else { STOP_WAIT };
        let first = within(wait, self.stop_once(sent_at)).await;
        // A link that carries a refusal is not dead.
        if matches!(first, Ok(_) | Err(DeviceError::Refused { .. })) {
            return first;
        }
        // The arm may be moving on a link that is gone: the stop alone is worth a new one. The old one is given up first, as the
        // controller has one session.
        self.has_program = self.may_have_program();
        (self.session, self.is_checked) = (None, false);
        self.open(ANSWER_TIMEOUT).await?;
        self.session()?.is_taken_up = true;
        self.stop_once(sent_at).await
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        self.is_armed = false;
        let may_have_program = self.may_have_program();
        let Some(mut session) = self.session.take() else { return Ok(()) };
        self.has_program = false;
        let aborted = if may_have_program { within(END_TIMEOUT, session.done_at_once(&RmiRequest::Abort)).await } else { Ok(()) };
        // The session is given back whatever became of the program.
        let disconnected = session.done_at_once(&RmiRequest::Disconnect).await;
        session.connection.close().await;
        aborted.and(disconnected)
    }

    fn fault_text(&self, fault: FaultCode) -> Option<&'static str> {
        Some(error_text(fault.0.into()))
    }
}

/// End of a program that a stop asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ProgramEnd {
    /// An end that no stop asked for.
    NotAsked,
    /// Asked for, and not known to have come.
    Asked,
    /// The end came.
    Answered,
}

/// Connection of a session, and what is known of it.
#[derive(Debug)]
struct Session {
    connection: Connection,
    unread: Vec<u8>,
    /// Commands that were sent and not answered yet, the oldest first.
    asked: VecDeque<RmiRequest>,
    /// Extended axes as they stood when it was armed.
    extended_deg: [Option<f64>; 3],
    next_sequence: u32,
    /// Instruction that was sent and not carried out yet.
    under_way: Option<u32>,
    /// Set where it was opened in place of one that broke, whose move may be carried out as long as the program runs.
    is_taken_up: bool,
    /// Error of an instruction, or a fault that the controller told by itself.
    failure: Option<i64>,
    /// End of the program, since it was armed.
    end: ProgramEnd,
}

impl Session {
    fn over(connection: Connection) -> Self {
        Self {
            connection,
            unread: Vec::new(),
            asked: VecDeque::new(),
            extended_deg: [None; 3],
            next_sequence: 1,
            under_way: None,
            is_taken_up: false,
            failure: None,
            end: ProgramEnd::NotAsked,
        }
    }

    /// Returns true while the making or the end of a program is to be answered.
    fn is_changing_program(&self) -> bool {
        self.asked.iter().any(|request| matches!(request, RmiRequest::Initialize { .. } | RmiRequest::Abort))
    }

    /// Sends a command, after the answer to the one before; returns when it was sent.
    async fn send(&mut self, request: &RmiRequest) -> Result<Instant, DeviceError> {
        if !self.asked.is_empty() {
            self.answer(PROGRAM_TIMEOUT).await?;
        }
        self.send_at_once(request).await
    }

    /// Sends a command whatever is still to be answered: a stop waits for nothing.
    async fn send_at_once(&mut self, request: &RmiRequest) -> Result<Instant, DeviceError> {
        self.asked.push_back(request.clone());
        self.connection.send(request.encode().as_bytes()).await?;
        Ok(Instant::now())
    }

    /// Waits for the answer to the command that was sent last; notes what else comes, and takes answers to those before.
    async fn answer(&mut self, wait: Duration) -> Result<RmiReply, DeviceError> {
        let answer = async {
            loop {
                let reply = self.next().await.inspect_err(|_| self.asked.clear())?;
                let Some(answered) = self.asked.iter().position(|request| reply.answers(request)) else {
                    self.note(&reply)?;
                    continue;
                };
                let request = self.asked.remove(answered);
                let is_end = request == Some(RmiRequest::Abort) && matches!(reply, RmiReply::Done { .. });
                if is_end && self.end == ProgramEnd::Asked {
                    self.end = ProgramEnd::Answered;
                }
                if answered == self.asked.len() {
                    return Ok(reply);
                }
            }
        };
        within(wait, answer).await
    }

    async fn ask(&mut self, request: &RmiRequest, wait: Duration) -> Result<RmiReply, DeviceError> {
        self.send(request).await?;
        self.answer(wait).await
    }

    /// Asks for something that has no data for an answer.
    async fn done(&mut self, request: &RmiRequest) -> Result<(), DeviceError> {
        let reply = self.ask(request, PROGRAM_TIMEOUT).await?;
        if matches!(reply, RmiReply::Done { .. }) { Ok(()) } else { Err(unexpected(&reply)) }
    }

    /// Asks for something that has no data for an answer, whatever is still to be answered.
    async fn done_at_once(&mut self, request: &RmiRequest) -> Result<(), DeviceError> {
        self.send_at_once(request).await?;
        let reply = self.answer(PROGRAM_TIMEOUT).await?;
        if matches!(reply, RmiReply::Done { .. }) { Ok(()) } else { Err(unexpected(&reply)) }
    }

    async fn status(&mut self) -> Result<RmiStatus, DeviceError> {
        let reply = self.ask(&RmiRequest::GetStatus, ANSWER_TIMEOUT).await?;
        if let RmiReply::Status(status) = reply { Ok(status) } else { Err(unexpected(&reply)) }
    }

    /// Judges a hold that was refused: where no program runs there is nothing to hold, which is as good. A program of a session that
    /// broke off may run on, and no other session can hold it.
    async fn nothing_to_hold(&mut self, refusal: i64) -> Result<(), DeviceError> {
        self.send_at_once(&RmiRequest::GetStatus).await?;
        let reply = self.answer(ANSWER_TIMEOUT).await?;
        let RmiReply::Status(status) = reply else { return Err(unexpected(&reply)) };
        if status.program != RmiProgram::Running {
            return Ok(());
        }
        let text = format!("{}, while its program runs on: the move under way may be carried out", error_text(refusal));
        Err(DeviceError::Refused { code: refusal, text })
    }

    async fn joints(&mut self, group: Option<u8>) -> Result<RmiJoints, DeviceError> {
        let reply = self.ask(&RmiRequest::ReadJointAngles { group }, ANSWER_TIMEOUT).await?;
        if let RmiReply::Joints(joints) = reply { Ok(joints) } else { Err(unexpected(&reply)) }
    }

    async fn latest_fault(&mut self) -> Result<Option<RmiFault>, DeviceError> {
        let reply = self.ask(&RmiRequest::ReadError, ANSWER_TIMEOUT).await?;
        if let RmiReply::ErrorText(text) = &reply { Ok(RmiFault::read(text)) } else { Err(unexpected(&reply)) }
    }

    /// The next packet; may be dropped while it waits.
    async fn next(&mut self) -> Result<RmiReply, DeviceError> {
        loop {
            if let Some(end) = self.unread.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.unread.drain(..=end).collect();
                if !line.trim_ascii().is_empty() {
                    return RmiReply::decode(&line);
                }
            } else if self.unread.len() > MAX_LINE_BYTES {
                self.unread.clear();
                return Err(DeviceError::Malformed { what: format!("a line of more than {MAX_LINE_BYTES} bytes") });
            } else {
                self.connection.receive(&mut self.unread).await?;
            }
        }
    }

    /// Takes in a packet that answers no command.
    fn note(&mut self, reply: &RmiReply) -> Result<(), DeviceError> {
        match reply {
            RmiReply::Moved { sequence } if self.under_way == Some(*sequence) => self.under_way = None,
            RmiReply::Refused { sequence: Some(sequence), error, .. } => {
                self.failure = Some(*error);
                self.under_way = self.under_way.filter(|under_way| under_way != sequence);
            }
            RmiReply::SystemFault { .. } => self.failure = self.failure.or(Some(0)),
            RmiReply::Terminated => {
                return Err(DeviceError::Closed { reason: "the controller ended the session after a long silence".to_owned() });
            }
            RmiReply::Moved { .. }
            | RmiReply::Refused { sequence: None, .. }
            | RmiReply::Connected { .. }
            | RmiReply::Status(_)
            | RmiReply::Joints(_)
            | RmiReply::ErrorText(_)
            | RmiReply::Done { .. } => {}
        }
        Ok(())
    }

    fn look_for_failure(&self) -> Result<(), DeviceError> {
        match self.failure {
            Some(error) => Err(refused(error)),
            None => Ok(()),
        }
    }

    fn condition(&self, status: &RmiStatus, fault: Option<&RmiFault>) -> Condition {
        let failure = self.failure.map(|error| FaultCode(error as u32));
        Condition {
            powered: status.servo_ready,
            brakes_open: status.servo_ready,
            moving: (self.under_way.is_some() || self.is_taken_up) && status.program == RmiProgram::Running,
            in_position: self.under_way.is_none(),
            emergency_stop: fault.is_some_and(RmiFault::is_emergency_stop),
            guard_open: fault.is_some_and(RmiFault::is_guard),
            hand_guided: status.pendant_enabled,
            paused: status.program == RmiProgram::Paused,
            fault: fault.map(|fault| FaultCode(fault.number)).or(failure),
        }
    }
}

fn refused(error: i64) -> DeviceError {
    DeviceError::Refused { code: error, text: error_text(error).to_owned() }
}

fn unexpected(reply: &RmiReply) -> DeviceError {
    if let RmiReply::Refused { error, .. } = reply {
        return refused(*error);
    }
    DeviceError::Malformed { what: format!("{reply:?} for an answer") }
}

#[cfg(test)]
mod tests;
