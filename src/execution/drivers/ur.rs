//! Universal Robots arms: the state comes by RTDE, motion goes to a program that this driver sends to the controller when it is
//! armed, and that connects back. The program stops the arm by itself when no command came within the watchdog's time.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream, lookup_host};
use tokio::time::{Instant, timeout};

use super::set_points::Rates;
use super::stream::{Connection, STOP_WAIT, Wiring, within};
use super::streamed::{StreamOrder, StreamStep, Streamed, StreamedLink, StreamedProtocol, StreamedReport};
use crate::cell::{UrControllerSpec, UrMotion};
use crate::execution::device::{Condition, DeviceError, FaultCode, Identity, Target};
use crate::execution::protocol::ur::rtde::{OUTPUTS, RtdeFrame, RtdeReply, RtdeRequest, RtdeState, VERSION};
use crate::execution::protocol::ur::{ServoTuning, UrCommand, program_text};
use crate::geometry::listed;

/// Longest time of attempts to connect, and of the program's way back.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest wait for an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Longest time in which the program takes a command and acknowledges it: a stop waits behind it.
const COMMAND_TAKEN: Duration = STOP_WAIT;
/// Reports in a row without a running program after which it has ended.
const ENDED_REPORTS: u32 = 25;
/// Words for a program that is lost, while the arm was to follow it.
const PROGRAM_LOST: &str = "its program on the controller has ended, was stopped there or takes no more commands; see the \
    controller's log, then begin another run from this step, which sends the program anew";
/// Speed below which a joint rests, rad/s.
const REST_RAD_S: f64 = 1e-3;
/// Deceleration of a stop that no target says one for, rad/s².
const STOP_RAD_S2: f64 = 2.0;

/// An arm by Universal Robots.
pub type UrArm = Streamed<6, UniversalRobots>;

/// Protocol of [`UrArm`].
#[derive(Clone)]
pub struct UniversalRobots {
    spec: UrControllerSpec,
    wiring: Wiring,
}

impl UniversalRobots {
    /// The arm of a specification.
    #[must_use]
    pub fn arm(spec: &UrControllerSpec, wiring: Wiring) -> UrArm {
        Streamed::new(Self { spec: spec.clone(), wiring })
    }
}

/// Open link of [`UniversalRobots`].
pub struct UrLink {
    protocol: UniversalRobots,
    rtde: Rtde,
    /// The program on the controller, from when it was armed until it is found to have ended.
    program: Option<Connection>,
    /// Number of the latest command that is acknowledged.
    sequence: u32,
    stop_rad_s2: f64,
    /// Time at which the order to stop of the latest answer went out.
    stop_sent_at: Option<Instant>,
    /// Reports in a row without a running program.
    idle_reports: u32,
    /// True if by the latest report it would not follow.
    is_hindered: bool,
}

impl StreamedProtocol<6> for UniversalRobots {
    type Link = UrLink;

    async fn open(&self) -> Result<(Identity, Self::Link), DeviceError> {
        let mut rtde =
            Rtde { connection: self.wiring.connect(&self.spec.address, CONNECT_TIMEOUT).await?, unread: Vec::new(), recipe: 0 };
        let version = rtde.greet(f64::from(self.spec.rate_hz)).await?;
        let firmware = Some(version.map(|number| number.to_string()).join("."));
        let identity =
            Identity { maker: "Universal Robots".to_owned(), model: "controller with RTDE".to_owned(), serial: None, firmware };
        let link = UrLink {
            protocol: self.clone(),
            rtde,
            program: None,
            sequence: 0,
            stop_rad_s2: STOP_RAD_S2,
            stop_sent_at: None,
            idle_reports: 0,
            is_hindered: false,
        };
        Ok((identity, link))
    }
}

impl StreamedLink<6> for UrLink {
    const ALWAYS_FOLLOWS: bool = false;

    fn cycle(&self) -> Duration {
        Duration::from_secs_f64(1.0 / f64::from(self.protocol.spec.rate_hz))
    }

    async fn report(&mut self) -> Result<StreamedReport<6>, DeviceError> {
        let state = self.rtde.state().await?;
        self.idle_reports = if state.is_program_running() { 0 } else { self.idle_reports.saturating_add(1) };
        let hindrance = hindrance(&state);
        self.is_hindered = hindrance.is_some();
        // The program holds the joints as it finds them measured.
        let (positions_rad, held_rad) = (state.joints_rad, state.joints_rad);
        Ok(StreamedReport { positions_rad, held_rad, condition: condition(&state), hindrance, is_behind: false })
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        self.program = None;
        self.program = Some(self.protocol.start_program(watchdog).await?);
        self.idle_reports = 0;
        Ok(())
    }

    async fn answer(&mut self, step: &StreamStep<6>) -> Result<(), DeviceError> {
        self.stop_sent_at = None;
        let has_ended = self.program.is_some() && self.idle_reports > ENDED_REPORTS;
        if !has_ended && self.instruct(step).await.is_ok() {
            return Ok(());
        }
        // The state is read on, and the program is sent anew when the arm is armed again.
        self.program = None;
        Err(DeviceError::NotReady { reason: PROGRAM_LOST.to_owned() })
    }

    fn stop_sent_at(&self) -> Option<Instant> {
        self.stop_sent_at
    }

    async fn close(mut self) {
        // The program may have ended before.
        let _ = self.send(UrCommand::End).await;
        let _ = self.rtde.connection.send(&RtdeRequest::Pause.encode()).await;
        self.rtde.connection.close().await;
    }
}

impl UrLink {
    /// Tells the program what to do in this cycle. One that was given up may lead the arm on until it sees that nobody is there: a stop
    /// has its acknowledgement then once the controller says that no program runs.
    async fn instruct(&mut self, step: &StreamStep<6>) -> Result<(), DeviceError> {
        if self.program.is_none() {
            let runs_on = self.idle_reports == 0 && step.order == Some(StreamOrder::Stop);
            return if runs_on { Err(DeviceError::NotReady { reason: PROGRAM_LOST.to_owned() }) } else { Ok(()) };
        }
        match (self.protocol.spec.motion, &step.order) {
            (UrMotion::Servoj, _) => self.send(UrCommand::SetPoint(step.set_point_rad)).await,
            (UrMotion::Movej, None) => self.send(UrCommand::KeepAlive).await,
            (UrMotion::Movej, Some(StreamOrder::Go { target, from_rad })) => {
                let Some((speed_rad_s, acceleration_rad_s2)) = leading(target, from_rad) else {
                    return self.send(UrCommand::KeepAlive).await;
                };
                self.stop_rad_s2 = acceleration_rad_s2;
                let (sequence, joints_rad) = (self.next_sequence(), target.positions_rad);
                self.send(UrCommand::Move { sequence, joints_rad, speed_rad_s, acceleration_rad_s2 }).await?;
                self.acknowledged(sequence).await
            }
            // A program that is held answers nothing, and may go on with its move by itself later: without the connection it ends
            // instead.
            (UrMotion::Movej, Some(StreamOrder::Stop)) if self.is_hindered => {
                self.program = None;
                Ok(())
            }
            (UrMotion::Movej, Some(StreamOrder::Stop)) => {
                let sequence = self.next_sequence();
                self.send(UrCommand::Stop { sequence, acceleration_rad_s2: self.stop_rad_s2 }).await?;
                self.stop_sent_at = Some(Instant::now());
                self.acknowledged(sequence).await
            }
        }
    }

    async fn send(&mut self, command: UrCommand) -> Result<(), DeviceError> {
        match &mut self.program {
            Some(program) => within(COMMAND_TAKEN, program.send(&command.encode())).await,
            None => Ok(()),
        }
    }

    fn next_sequence(&mut self) -> u32 {
        self.sequence = (self.sequence + 1) & i32::MAX as u32;
        self.sequence
    }

    /// Waits until the program answers with the number of a command.
    async fn acknowledged(&mut self, sequence: u32) -> Result<(), DeviceError> {
        let Some(program) = &mut self.program else { return Ok(()) };
        let mut answer = Vec::new();
        let read = async {
            while answer.len() < 4 {
                program.receive(&mut answer).await?;
            }
            Ok(())
        };
        within(COMMAND_TAKEN, read).await?;
        if answer == sequence.to_be_bytes() {
            return Ok(());
        }
        Err(DeviceError::Malformed { what: format!("{answer:?} as the acknowledgement of {sequence}") })
    }
}

impl UniversalRobots {
    /// Sends the program, and waits until it connects back.
    async fn start_program(&self, watchdog: Duration) -> Result<Connection, DeviceError> {
        let reverse = self.spec.reverse_address;
        let unbound = |error: io::Error| DeviceError::Unbound { address: reverse.to_string(), reason: error.to_string() };
        let closed = |error: io::Error| DeviceError::Closed { reason: error.to_string() };
        let mut expected = ExpectedPeer { hosts: self.hosts().await?, refused: None };
        let listener = TcpListener::bind(reverse).await.map_err(unbound)?;
        let reverse = listener.local_addr().map_err(unbound)?;
        let mut script = self.wiring.connect(&self.spec.script_address, CONNECT_TIMEOUT).await?;
        script.send(self.program(reverse, watchdog).as_bytes()).await?;
        let accepted = timeout(CONNECT_TIMEOUT, self.accept(&listener, &mut expected)).await;
        let stream = accepted.map_err(|_| expected.did_not_connect(reverse))?.map_err(closed)?;
        stream.set_nodelay(true).map_err(closed)?;
        // A move that the network holds up would arrive after the program was given up, and be carried out.
        stream.set_zero_linger().map_err(closed)?;
        script.close().await;
        Ok(self.wiring.connection(Box::new(stream)))
    }

    /// Hosts that the controller has by the cell file.
    async fn hosts(&self) -> Result<Vec<IpAddr>, DeviceError> {
        let mut hosts = Vec::new();
        for address in [&self.spec.address, &self.spec.script_address] {
            let unreachable = |error: io::Error| DeviceError::Unreachable { address: address.clone(), reason: error.to_string() };
            hosts.extend(lookup_host(address).await.map_err(unreachable)?.map(|found| found.ip().to_canonical()));
        }
        hosts.sort_unstable();
        hosts.dedup();
        Ok(hosts)
    }

    /// Waits for the controller's program, and refuses whoever connects from elsewhere: it would be given the commands, and acknowledge
    /// the stops, in place of the arm. The first is noted.
    async fn accept(&self, listener: &TcpListener, expected: &mut ExpectedPeer) -> io::Result<TcpStream> {
        loop {
            let (stream, peer) = listener.accept().await?;
            let host = peer.ip().to_canonical();
            if expected.hosts.contains(&host) {
                return Ok(stream);
            }
            if expected.refused.replace(host).is_none() {
                let words = format!("a connection from {peer} to its program's port is refused: {}", expected.place());
                self.wiring.log.note(self.wiring.device, &words);
            }
        }
    }

    fn program(&self, reverse: SocketAddr, watchdog: Duration) -> String {
        let tuning = ServoTuning { lookahead_ms: self.spec.lookahead_ms, gain: self.spec.gain };
        program_text(self.spec.motion, tuning, reverse, watchdog)
    }
}

/// Hosts that the arm's program may connect from.
struct ExpectedPeer {
    hosts: Vec<IpAddr>,
    /// Latest host that connected and is none of them.
    refused: Option<IpAddr>,
}

impl ExpectedPeer {
    fn place(&self) -> String {
        let hosts: Vec<String> = self.hosts.iter().map(IpAddr::to_string).collect();
        format!("the controller is at {}", listed(&hosts))
    }

    fn did_not_connect(&self, reverse: SocketAddr) -> DeviceError {
        let reason = match self.refused {
            None => format!("its program did not connect to {reverse}; set the arm to remote control and check the address"),
            Some(host) => {
                let place = self.place();
                format!("its program did not connect to {reverse}, but {host} did: {place}; give the controller's own address")
            }
        };
        DeviceError::NotReady { reason }
    }
}

/// Connection for the state.
struct Rtde {
    connection: Connection,
    unread: Vec<u8>,
    recipe: u8,
}

impl Rtde {
    /// Agrees on the protocol and the variables, and begins; returns the version of the controller.
    async fn greet(&mut self, rate_hz: f64) -> Result<[u32; 4], DeviceError> {
        let reply = self.ask(&RtdeRequest::Version(VERSION)).await?;
        if reply != RtdeReply::Version(true) {
            return Err(refused("version 2 of RTDE", &reply));
        }
        let reply = self.ask(&RtdeRequest::ControlVersion).await?;
        let RtdeReply::ControlVersion(version) = reply else { return Err(refused("its version", &reply)) };
        let (expected, reply) = (OUTPUTS.map(|(_, kind)| kind).join(","), self.ask(&RtdeRequest::outputs(rate_hz)).await?);
        let RtdeReply::Outputs { recipe, types } = &reply else { return Err(refused("the state of the arm", &reply)) };
        if *types != expected {
            return Err(refused("the state of the arm", &reply));
        }
        self.recipe = *recipe;
        let reply = self.ask(&RtdeRequest::Start).await?;
        if reply == RtdeReply::Start(true) { Ok(version) } else { Err(refused("to send", &reply)) }
    }

    /// Asks, and returns the first reply that is not a message for people.
    async fn ask(&mut self, request: &RtdeRequest) -> Result<RtdeReply, DeviceError> {
        self.connection.send(&request.encode()).await?;
        let answer = async {
            loop {
                let reply = self.next().await?;
                if !matches!(reply, RtdeReply::Text(_) | RtdeReply::Data { .. }) {
                    return Ok(reply);
                }
            }
        };
        within(ANSWER_TIMEOUT, answer).await
    }

    /// The next reply; may be dropped while it waits.
    async fn next(&mut self) -> Result<RtdeReply, DeviceError> {
        loop {
            if let Some(reply) = self.take()? {
                return Ok(reply);
            }
            self.connection.receive(&mut self.unread).await?;
        }
    }

    /// Takes the first reply out of what was received. Bytes that are not a frame are thrown away: nothing tells where the next begins.
    fn take(&mut self) -> Result<Option<RtdeReply>, DeviceError> {
        let first = RtdeFrame::first(&self.unread).map(|first| first.map(|(frame, length)| (RtdeReply::decode(frame), length)));
        match first {
            Ok(None) => Ok(None),
            Ok(Some((reply, length))) => {
                self.unread.drain(..length);
                reply.map(Some)
            }
            Err(malformed) => {
                self.unread.clear();
                Err(malformed)
            }
        }
    }

    /// The newest state: those before it, which came while nobody read, are old. May be dropped while it waits.
    async fn state(&mut self) -> Result<RtdeState, DeviceError> {
        let mut newest = None;
        loop {
            while let Some(reply) = self.take()? {
                if let RtdeReply::Data { recipe, values } = reply
                    && recipe == self.recipe
                {
                    newest = Some(values);
                }
            }
            match &newest {
                None => self.connection.receive(&mut self.unread).await?,
                Some(values) => {
                    if !self.connection.receive_ready(&mut self.unread).await? {
                        return RtdeState::decode(values);
                    }
                }
            }
        }
    }
}

fn refused(what: &str, reply: &RtdeReply) -> DeviceError {
    DeviceError::Refused { code: 0, text: format!("asked for {what}, it answered {reply:?}") }
}

/// Speed and acceleration of the axis that goes furthest, which is the one that `movej` is told them for.
fn leading(target: &Target<6>, from_rad: &[f64; 6]) -> Option<(f64, f64)> {
    let rates = Rates::of(target, from_rad)?;
    let furthest_rad = (0..6).map(|axis| (target.positions_rad[axis] - from_rad[axis]).abs()).fold(0.0, f64::max);
    Some((rates.rate_per_s * furthest_rad, rates.change_per_s2 * furthest_rad))
}

fn condition(state: &RtdeState) -> Condition {
    let moving = state.speeds_rad_s.iter().any(|speed| speed.abs() > REST_RAD_S);
    Condition {
        powered: state.is_powered(),
        brakes_open: state.are_brakes_open(),
        moving,
        in_position: !moving,
        emergency_stop: state.is_emergency_stopped(),
        guard_open: state.is_guard_stopped(),
        hand_guided: state.is_hand_guided(),
        paused: state.is_paused(),
        fault: state.fault_bit().map(FaultCode),
    }
}

fn hindrance(state: &RtdeState) -> Option<&'static str> {
    if !state.is_powered() {
        return Some("the arm is off; switch it on at the controller");
    }
    if state.is_emergency_stopped() || state.is_guard_stopped() || state.fault_bit().is_some() {
        return Some("its safety system has stopped it; clear that at the controller");
    }
    if !state.are_brakes_open() {
        return Some("its brakes are closed; release them at the controller");
    }
    if state.is_paused() {
        return Some("its program is paused at the controller; let it go on or stop it there");
    }
    state.is_hand_guided().then_some("it is guided by hand; let go of it")
}
