//! Han's controller: text commands, pushed states and servo commands on sockets, one arm of the library behind them.

mod arm;
mod servo;

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep};

use self::arm::SimulatedArm;
use super::faults::{DeviceLook, Faults};
use crate::cell::Robot;
use crate::execution::drivers::stream::ByteStream;
use crate::execution::protocol::hans::{HansFrames, HansOutcome, HansReply, HansRequest, HansSyntax};

/// Interval at which faults and paths act by themselves.
const TICK: Duration = Duration::from_millis(5);

/// A simulated controller on sockets.
#[derive(Debug)]
pub struct HansSimulator {
    text: TcpListener,
    realtime: TcpListener,
    servo: TcpListener,
    controller: HansController,
}

/// A simulated controller, whatever its connections run over. Clones are the same one.
#[derive(Clone, Debug)]
pub struct HansController(Arc<Shared>);

/// Arm, faults and time of a simulator.
#[derive(Debug)]
struct Shared {
    arm: Mutex<SimulatedArm>,
    faults: Arc<Faults>,
    began: Instant,
    factor: f64,
}

impl Shared {
    /// The arm, and the simulated time, s.
    fn arm(&self) -> (MutexGuard<'_, SimulatedArm>, f64) {
        let mut arm = self.arm.lock().unwrap_or_else(PoisonError::into_inner);
        let now = self.began.elapsed().as_secs_f64() * self.factor;
        arm.feel(&self.faults.state(), now);
        (arm, now)
    }
}

/// Addresses of a simulated controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HansAddresses {
    /// Text commands, as port 10003.
    pub text: SocketAddr,
    /// Binary state, as port 8893.
    pub realtime: SocketAddr,
    /// Servo commands, as port 8892.
    pub servo: SocketAddr,
}

impl HansController {
    /// A controller whose arm stands at `joints_rad`, enabled; its time runs `factor` times as quickly.
    #[must_use]
    pub fn new(robot: Robot, joints_rad: [f64; 6], factor: f64) -> Self {
        let arm = Mutex::new(SimulatedArm::at(robot, joints_rad));
        Self(Arc::new(Shared { arm, faults: Arc::default(), began: Instant::now(), factor }))
    }

    /// Faults of the controller.
    #[must_use]
    pub fn faults(&self) -> Arc<Faults> {
        Arc::clone(&self.0.faults)
    }

    /// A look at its joints, whatever its connections do.
    #[must_use]
    pub fn joints_rad(&self) -> [f64; 6] {
        let (arm, now) = self.0.arm();
        arm.joints_rad(now)
    }

    fn look(&self) -> DeviceLook {
        let (arm, now) = self.0.arm();
        let positions_deg = arm.joints_rad(now).map(f64::to_degrees).to_vec();
        DeviceLook { positions_deg, is_moving: arm.is_moving(now), error: arm.error() }
    }

    /// Answers the text commands of one client until it goes, or the connection is cut.
    pub async fn talk(&self, mut stream: impl ByteStream) {
        let cut = self.0.faults.next_cut();
        tokio::select! {
            biased;
            () = cut => {}
            // Whoever goes away is not missed.
            _ = answer(&mut stream, &self.0) => {}
        }
    }
}

impl HansSimulator {
    /// Listens at an address for text commands, and beside it for the binary state and for servo commands. The arm stands at
    /// `joints_rad`, enabled; its time runs `factor` times as quickly.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub async fn listen(address: &str, robot: Robot, joints_rad: [f64; 6], factor: f64) -> io::Result<Self> {
        let text = TcpListener::bind(address).await?;
        let beside = SocketAddr::new(text.local_addr()?.ip(), 0);
        let (realtime, servo) = (TcpListener::bind(beside).await?, TcpListener::bind(beside).await?);
        Ok(Self { text, realtime, servo, controller: HansController::new(robot, joints_rad, factor) })
    }

    /// Addresses that it listens at.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn addresses(&self) -> io::Result<HansAddresses> {
        Ok(HansAddresses {
            text: self.text.local_addr()?,
            realtime: self.realtime.local_addr()?,
            servo: self.servo.local_addr()?,
        })
    }

    /// Faults of the simulator.
    #[must_use]
    pub fn faults(&self) -> Arc<Faults> {
        self.controller.faults()
    }

    /// A look at its joints, whatever its connections do.
    pub fn joints(&self) -> impl Fn() -> [f64; 6] + Send + use<> {
        let controller = self.controller.clone();
        move || controller.joints_rad()
    }

    /// A look at it, whatever its connections do.
    pub fn look(&self) -> impl Fn() -> DeviceLook + Send + Sync + use<> {
        let controller = self.controller.clone();
        move || controller.look()
    }

    /// Serves connections until it is dropped, and they with it.
    pub async fn serve(self) {
        let servo = async {
            // One client: the others wait.
            while let Ok((stream, _)) = self.servo.accept().await {
                servo::take_targets(stream, &self.controller.0).await;
            }
        };
        tokio::join!(servo, self.serve_many(), self.keep_time());
    }

    /// Lets faults act when they come, and not when somebody looks.
    async fn keep_time(&self) {
        loop {
            drop(self.controller.0.arm());
            sleep(TICK).await;
        }
    }

    /// Serves the ports that take many clients.
    async fn serve_many(&self) {
        let mut connections = JoinSet::new();
        loop {
            // Connections that ended are let go.
            while connections.try_join_next().is_some() {}
            let controller = self.controller.clone();
            tokio::select! {
                Ok((stream, _)) = self.text.accept() => connections.spawn(async move {
                    // Whoever goes away is not missed, be it at once.
                    let _ = stream.set_nodelay(true);
                    controller.talk(stream).await;
                }),
                Ok((stream, _)) = self.realtime.accept() => {
                    connections.spawn(async move { servo::push_states(stream, &controller.0).await })
                }
                else => return,
            };
        }
    }
}

async fn answer(stream: &mut impl ByteStream, shared: &Shared) -> io::Result<()> {
    let (mut frames, mut chunk) = (HansFrames::default(), [0; 4096]);
    loop {
        let read = stream.read(&mut chunk).await?;
        if read == 0 {
            return Ok(());
        }
        frames.push(&chunk[..read]);
        while let Some(message) = frames.next_message() {
            let reply = reply(message, shared);
            let faults = shared.faults.state();
            sleep(faults.late).await;
            if !faults.is_silent {
                stream.write_all(reply.encode().as_bytes()).await?;
            }
        }
    }
}

/// Code of a command whose format is wrong.
const FORMAT_ERROR: i64 = 40_056;

fn reply(message: Result<String, HansSyntax>, shared: &Shared) -> HansReply {
    let refused = |command: String, code| HansReply { command, outcome: HansOutcome::Fail(code) };
    match message.and_then(|message| HansRequest::parse(&message)) {
        Ok(request) => {
            let (mut arm, now) = shared.arm();
            let outcome = arm.answer(&request, now).map_or_else(HansOutcome::Fail, HansOutcome::Done);
            HansReply { command: request.name().to_owned(), outcome }
        }
        Err(HansSyntax::Arguments(command)) => refused(command, FORMAT_ERROR),
        Err(HansSyntax::UnknownCommand(_) | HansSyntax::TooLong | HansSyntax::NotText) => {
            HansReply { command: String::new(), outcome: HansOutcome::Unknown }
        }
    }
}
