//! A FANUC controller with the Remote Motion Interface to rehearse against: one session, one program, a move at a time in the time
//! asked for. A session that breaks off leaves its move to be carried out. It keeps to the manual where a public simulator does
//! not: degrees, one `ErrorID` an answer, a `SequenceID` without gaps.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{Instant, sleep_until};

use crate::execution::device::Target;
use crate::execution::drivers::set_points::SetPoints;
use crate::execution::protocol::fanuc_rmi::{
    MAX_LINE_BYTES, MAX_SEQUENCE, RmiJointMotion, RmiJoints, RmiProgram, RmiReply, RmiRequest, RmiStatus,
};

/// Error number of a command that failed.
const FAILED: i64 = 2_556_942;
/// Error number of a command that needs servo power.
const SERVO_OFF: i64 = 2_556_935;
/// Error number of a command that needs remote motion to run.
const NOT_RUNNING: i64 = 2_556_937;
/// Error number of an unknown command.
const UNKNOWN: i64 = 2_556_941;
/// Error number of an instruction out of order.
const WRONG_SEQUENCE: i64 = 2_556_957;
/// Axes: six joints and the table.
const AXES: usize = 7;

/// A controller that listens.
pub struct RmiController {
    door: TcpListener,
    cell: Arc<Mutex<RmiCell>>,
}

/// The arm of a controller, and buttons that a test presses.
#[derive(Debug)]
pub struct RmiCell {
    points: SetPoints<AXES>,
    moved_at: Instant,
    under_way: Option<u32>,
    next_sequence: u32,
    program: RmiProgram,
    is_initialised: bool,
    override_percent: u8,
    fault: Option<&'static str>,
}

impl RmiController {
    /// Listens at an address; joints begin at zero, with the third counted from the ground.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub async fn bind(address: &str) -> io::Result<Self> {
        Ok(Self { door: TcpListener::bind(address).await?, cell: Arc::new(Mutex::new(RmiCell::new())) })
    }

    /// Address that it listens at.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.door.local_addr()
    }

    /// The cell, to look at and to disturb.
    #[must_use]
    pub fn cell(&self) -> Arc<Mutex<RmiCell>> {
        self.cell.clone()
    }

    /// Serves one session after the other, for ever.
    ///
    /// # Errors
    /// Errors of the listening socket.
    pub async fn serve(self) -> io::Result<()> {
        loop {
            let (stream, _) = self.door.accept().await?;
            if let Some(session) = self.admit(stream).await
                && self.hold(session).await.is_err()
            {
                lock(&self.cell).break_off();
            }
        }
    }

    /// Answers at the door with the port of a session, and waits for the client there.
    async fn admit(&self, stream: TcpStream) -> Option<TcpStream> {
        let mut stream = Lines::over(stream);
        let line = stream.next().await.ok()?;
        if RmiRequest::decode(&line).ok()? != RmiRequest::Connect {
            return None;
        }
        let session = TcpListener::bind((self.door.local_addr().ok()?.ip(), 0)).await.ok()?;
        let reply = RmiReply::Connected { port: session.local_addr().ok()?.port(), version: (7, 1) };
        stream.stream.write_all(reply.encode().as_bytes()).await.ok()?;
        session.accept().await.ok().map(|(stream, _)| stream)
    }

    async fn hold(&self, stream: TcpStream) -> io::Result<()> {
        stream.set_nodelay(true)?;
        let mut lines = Lines::over(stream);
        loop {
            let ends_at = lock(&self.cell).ends_at();
            let replies = tokio::select! {
                line = lines.next() => lock(&self.cell).take(&line?),
                () = sleep_until(ends_at.unwrap_or_else(Instant::now)), if ends_at.is_some() => lock(&self.cell).finish(),
            };
            for reply in replies {
                lines.stream.write_all(reply.encode().as_bytes()).await?;
                if reply == done("FRC_Disconnect") {
                    return Ok(());
                }
            }
        }
    }
}

fn lock(cell: &Mutex<RmiCell>) -> MutexGuard<'_, RmiCell> {
    cell.lock().unwrap_or_else(PoisonError::into_inner)
}

fn done(command: &str) -> RmiReply {
    RmiReply::Done { command: command.to_owned() }
}

impl RmiCell {
    fn new() -> Self {
        Self {
            points: SetPoints::still([0.0; AXES]),
            moved_at: Instant::now(),
            under_way: None,
            next_sequence: 1,
            program: RmiProgram::Aborted,
            is_initialised: false,
            override_percent: 100,
            fault: None,
        }
    }

    /// Joints and table as they are now, degrees, as the controller counts them.
    pub fn axes_deg(&mut self) -> [f64; AXES] {
        let now = Instant::now();
        let elapsed = now.duration_since(self.moved_at);
        self.moved_at = now;
        let halted = self.program != RmiProgram::Running;
        let rad = if halted { self.points.at_rad() } else { self.points.advance(elapsed) };
        // A program without a session ends with its move.
        if !halted && !self.is_initialised && !self.points.is_moving() {
            self.program = RmiProgram::Aborted;
        }
        rad.map(f64::to_degrees)
    }

    /// Presses an emergency stop, or whatever the fault stands for; `None` clears it.
    pub fn set_fault(&mut self, fault: Option<&'static str>) {
        self.axes_deg();
        if fault.is_some() {
            self.program = RmiProgram::Paused;
        }
        self.fault = fault;
    }

    /// Time at which the move under way is over.
    fn ends_at(&mut self) -> Option<Instant> {
        self.axes_deg();
        let is_led = self.under_way.is_some() && self.program == RmiProgram::Running;
        is_led.then(|| self.moved_at + self.points.left())
    }

    fn finish(&mut self) -> Vec<RmiReply> {
        self.axes_deg();
        let over = self.under_way.take_if(|_| !self.points.is_moving());
        over.map(|sequence| RmiReply::Moved { sequence }).into_iter().collect()
    }

    /// Ends the session without a word: a move under way is carried out, and no other session can hold it.
    fn break_off(&mut self) {
        self.axes_deg();
        if self.program == RmiProgram::Running && self.points.is_moving() {
            (self.under_way, self.is_initialised) = (None, false);
        } else {
            self.abort();
        }
    }

    fn abort(&mut self) {
        self.axes_deg();
        self.points = SetPoints::still(self.points.at_rad());
        (self.under_way, self.program, self.is_initialised) = (None, RmiProgram::Aborted, false);
    }

    fn take(&mut self, line: &[u8]) -> Vec<RmiReply> {
        let Ok(request) = RmiRequest::decode(line) else {
            return vec![RmiReply::Refused { command: "Unknown".to_owned(), sequence: None, error: UNKNOWN }];
        };
        vec![match request {
            RmiRequest::JointMotion(motion) => return self.add(&motion),
            RmiRequest::GetStatus => RmiReply::Status(self.status()),
            RmiRequest::ReadJointAngles { .. } => {
                let [arm_deg @ .., table] = self.axes_deg();
                RmiReply::Joints(RmiJoints { arm_deg, extended_deg: [Some(table), Some(0.0), Some(0.0)] })
            }
            RmiRequest::ReadError => RmiReply::ErrorText(self.fault.unwrap_or("No Error").to_owned()),
            command @ (RmiRequest::Connect
            | RmiRequest::Disconnect
            | RmiRequest::Initialize { .. }
            | RmiRequest::SetOverRide(_)
            | RmiRequest::Abort
            | RmiRequest::Pause
            | RmiRequest::Continue
            | RmiRequest::Reset) => match self.obey(&command) {
                Ok(()) => done(command.name()),
                Err(error) => RmiReply::Refused { command: command.name().to_owned(), sequence: None, error },
            },
        }]
    }

    fn obey(&mut self, command: &RmiRequest) -> Result<(), i64> {
        self.axes_deg();
        match command {
            RmiRequest::Initialize { .. } if self.fault.is_some() => return Err(SERVO_OFF),
            RmiRequest::Initialize { .. } if self.is_initialised || self.program == RmiProgram::Running => return Err(FAILED),
            RmiRequest::Initialize { .. } => {
                self.points = SetPoints::still(self.points.at_rad());
                (self.is_initialised, self.program, self.next_sequence) = (true, RmiProgram::Running, 1);
            }
            RmiRequest::Abort if !self.is_initialised => return Err(FAILED),
            RmiRequest::Abort => self.abort(),
            RmiRequest::Pause if !self.is_initialised => return Err(NOT_RUNNING),
            RmiRequest::Pause => self.program = RmiProgram::Paused,
            RmiRequest::Continue if !self.is_initialised || self.fault.is_some() => return Err(NOT_RUNNING),
            RmiRequest::Continue => self.program = RmiProgram::Running,
            RmiRequest::SetOverRide(percent) => self.override_percent = *percent,
            RmiRequest::Reset => self.fault = None,
            RmiRequest::Disconnect => self.abort(),
            RmiRequest::Connect
            | RmiRequest::GetStatus
            | RmiRequest::ReadJointAngles { .. }
            | RmiRequest::ReadError
            | RmiRequest::JointMotion(_) => return Err(UNKNOWN),
        }
        Ok(())
    }

    fn status(&mut self) -> RmiStatus {
        self.axes_deg();
        RmiStatus {
            servo_ready: self.fault.is_none(),
            pendant_enabled: false,
            motion_running: self.is_initialised,
            program: self.program,
            next_sequence: Some(self.next_sequence),
            override_percent: Some(self.override_percent.into()),
        }
    }

    /// Adds a move; the answer comes when it is done.
    fn add(&mut self, motion: &RmiJointMotion) -> Vec<RmiReply> {
        let refuse = |error| {
            let command = "FRC_JointMotionJRep".to_owned();
            vec![RmiReply::Refused { command, sequence: Some(motion.sequence), error }]
        };
        if !self.is_initialised {
            return refuse(NOT_RUNNING);
        }
        if motion.sequence != self.next_sequence {
            return refuse(WRONG_SEQUENCE);
        }
        if self.under_way.is_some() {
            return refuse(FAILED);
        }
        self.axes_deg();
        self.next_sequence = if motion.sequence == MAX_SEQUENCE { 1 } else { motion.sequence + 1 };
        let table = motion.joints.extended_deg[0].unwrap_or(self.points.at_rad()[6].to_degrees());
        let axes_deg = std::array::from_fn(|axis| motion.joints.arm_deg.get(axis).copied().unwrap_or(table));
        self.points.go(&Target {
            sequence: motion.sequence.into(),
            positions_rad: axes_deg.map(f64::to_radians),
            max_speed_rad_s: [1e3; AXES],
            max_acceleration_rad_s2: [1e6; AXES],
            duration: motion.speed.duration(),
        });
        self.under_way = Some(motion.sequence);
        if self.points.is_moving() { Vec::new() } else { self.finish() }
    }
}

/// Lines of a stream.
struct Lines {
    stream: TcpStream,
    unread: Vec<u8>,
}

impl Lines {
    fn over(stream: TcpStream) -> Self {
        Self { stream, unread: Vec::new() }
    }

    /// The next line; may be dropped while it waits.
    async fn next(&mut self) -> io::Result<Vec<u8>> {
        loop {
            if let Some(end) = self.unread.iter().position(|byte| *byte == b'\n') {
                return Ok(self.unread.drain(..=end).collect());
            }
            if self.unread.len() > MAX_LINE_BYTES || self.stream.read_buf(&mut self.unread).await? == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
    }
}
