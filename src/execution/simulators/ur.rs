//! A Universal Robots controller to rehearse against: RTDE on one port, URScript on another. It does not interpret the script: of the
//! driver's own program it reads where to connect to and for how long to wait, and then does what that program does.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::Notify;
use tokio::time::{Instant, interval, sleep, timeout};

use crate::execution::device::Target;
use crate::execution::drivers::set_points::SetPoints;
use crate::execution::protocol::ur::UrCommand;
use crate::execution::protocol::ur::rtde::{MODE_RUNNING, RtdeFrame, RtdeReply, RtdeRequest, RtdeState};

/// Version that it says it has.
const VERSION: [u32; 4] = [5, 11, 0, 108];
/// Largest rate, Hz.
const MAX_RATE_HZ: f64 = 500.0;
/// Robot bit: power on.
const POWER_BIT: u32 = 1;
/// Robot bit: a program runs.
const PROGRAM_BIT: u32 = 1 << 1;
/// Safety bit: normal mode.
const NORMAL_BIT: u32 = 1;
/// Pause after which a program that is paused looks whether it still is.
const CHECK_INTERVAL: Duration = Duration::from_millis(2);

/// A controller that listens.
pub struct UrController {
    rtde: TcpListener,
    script: TcpListener,
    cell: Arc<Mutex<UrCell>>,
}

/// The arm of a controller, and buttons that a test presses.
#[derive(Debug)]
pub struct UrCell {
    points: SetPoints<6>,
    moved_at: Instant,
    speeds_rad_s: [f64; 6],
    start: Instant,
    is_program_running: bool,
    stop_button: Arc<Notify>,
    /// The program is paused at the pendant: the arm stands, and no command is obeyed.
    pub is_paused: bool,
    /// The link to the program is dead, and does not say so: no command arrives.
    pub is_link_dead: bool,
    /// Bits of the safety system.
    pub safety_bits: u32,
    /// Mode of the robot: 5 with power and closed brakes, 7 when they are released.
    pub mode: i32,
    /// Times that the program stopped because no command came.
    pub starved: u32,
    /// Largest step of a joint between set points, radians.
    pub max_step_rad: f64,
}

impl UrController {
    /// Listens at two addresses.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub async fn bind(rtde: &str, script: &str, joints_rad: [f64; 6]) -> io::Result<Self> {
        let cell = Arc::new(Mutex::new(UrCell::new(joints_rad)));
        Ok(Self { rtde: TcpListener::bind(rtde).await?, script: TcpListener::bind(script).await?, cell })
    }

    /// Addresses that it listens at: RTDE and URScript.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn addresses(&self) -> io::Result<(SocketAddr, SocketAddr)> {
        Ok((self.rtde.local_addr()?, self.script.local_addr()?))
    }

    /// The cell, to look at and to disturb.
    #[must_use]
    pub fn cell(&self) -> Arc<Mutex<UrCell>> {
        self.cell.clone()
    }

    /// Serves clients, for ever.
    ///
    /// # Errors
    /// Errors of the listening sockets.
    pub async fn serve(self) -> io::Result<()> {
        loop {
            tokio::select! {
                client = self.rtde.accept() => {
                    let (stream, cell) = (client?.0, self.cell.clone());
                    tokio::spawn(async move { exchange(stream, &cell).await });
                }
                client = self.script.accept() => {
                    let (stream, cell) = (client?.0, self.cell.clone());
                    tokio::spawn(async move { run_program(stream, &cell).await });
                }
            }
        }
    }
}

fn lock(cell: &Mutex<UrCell>) -> MutexGuard<'_, UrCell> {
    cell.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One client of RTDE.
async fn exchange(mut stream: TcpStream, cell: &Mutex<UrCell>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let (mut unread, mut recipe, mut is_sending) = (Vec::new(), Vec::new(), false);
    let mut ticks = interval(Duration::from_secs_f64(1.0 / MAX_RATE_HZ));
    loop {
        tokio::select! {
            read = stream.read_buf(&mut unread) => if read? == 0 { return Ok(()) },
            _ = ticks.tick(), if is_sending => {
                let values = lock(cell).values(&recipe);
                stream.write_all(&RtdeReply::Data { recipe: 1, values }.encode()).await?;
            }
        }
        while let Some((frame, length)) = RtdeFrame::first(&unread).map_err(io::Error::other)? {
            let request = RtdeRequest::decode(frame).map_err(io::Error::other)?;
            unread.drain(..length);
            let reply = match request {
                RtdeRequest::Version(version) => RtdeReply::Version(version == 2),
                RtdeRequest::ControlVersion => RtdeReply::ControlVersion(VERSION),
                RtdeRequest::Outputs { rate_hz, names } => {
                    ticks = interval(Duration::from_secs_f64(1.0 / rate_hz.clamp(1.0, MAX_RATE_HZ)));
                    // Clients in use write a comma after the last name too.
                    recipe = names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect();
                    let types: Vec<&str> = recipe.iter().map(|name| variable(name, &RtdeState::default()).0).collect();
                    RtdeReply::Outputs { recipe: 1, types: types.join(",") }
                }
                RtdeRequest::Inputs { names } => {
                    let types = vec!["NOT_FOUND"; names.split(',').count()].join(",");
                    RtdeReply::Inputs { recipe: 0, types }
                }
                RtdeRequest::Start => {
                    is_sending = true;
                    RtdeReply::Start(true)
                }
                RtdeRequest::Pause => {
                    is_sending = false;
                    RtdeReply::Pause(true)
                }
                RtdeRequest::Data { .. } => continue,
            };
            stream.write_all(&reply.encode()).await?;
        }
    }
}

/// Type and value of a variable.
fn variable(name: &str, state: &RtdeState) -> (&'static str, Vec<u8>) {
    let six = |values: [f64; 6]| ("VECTOR6D", values.into_iter().flat_map(f64::to_be_bytes).collect());
    let word = |value: u32| ("UINT32", value.to_be_bytes().to_vec());
    match name {
        "timestamp" => ("DOUBLE", state.timestamp_secs.to_be_bytes().to_vec()),
        "actual_q" | "target_q" => six(state.joints_rad),
        "actual_qd" | "target_qd" => six(state.speeds_rad_s),
        "runtime_state" => word(state.runtime),
        "robot_status_bits" => word(state.robot_bits),
        "safety_status_bits" => word(state.safety_bits),
        "robot_mode" => ("INT32", state.mode.to_be_bytes().to_vec()),
        "safety_mode" | "safety_status" => ("INT32", 1_i32.to_be_bytes().to_vec()),
        _ => ("NOT_FOUND", Vec::new()),
    }
}

/// The driver's program, by what its text says.
async fn run_program(mut stream: TcpStream, cell: &Mutex<UrCell>) -> io::Result<()> {
    let mut text = Vec::new();
    while !text.ends_with(b"\nend\n") {
        if stream.read_buf(&mut text).await? == 0 || text.len() > 1 << 16 {
            return Err(io::ErrorKind::InvalidData.into());
        }
    }
    let text = String::from_utf8(text).map_err(io::Error::other)?;
    let invalid = || io::Error::from(io::ErrorKind::InvalidData);
    let (reverse, watchdog) = address_and_watchdog(&text).ok_or_else(invalid)?;
    let mut client = connect_from(stream.local_addr()?.ip(), reverse).await?;
    client.set_nodelay(true)?;
    let stop_button = {
        let mut cell = lock(cell);
        cell.is_program_running = true;
        Arc::clone(&cell.stop_button)
    };
    let outcome = tokio::select! {
        outcome = obey(&mut client, cell, watchdog) => outcome,
        () = stop_button.notified() => Ok(()),
    };
    let mut cell = lock(cell);
    cell.points.ramp_down();
    cell.is_program_running = false;
    outcome
}

/// Connects from the controller's own address, which the driver expects its program at.
async fn connect_from(host: IpAddr, to: SocketAddr) -> io::Result<TcpStream> {
    let socket = if to.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    if host.is_ipv4() == to.is_ipv4() {
        socket.bind(SocketAddr::new(host, 0))?;
    }
    socket.connect(to).await
}

/// Address that the program connects to, and its wait for a command.
fn address_and_watchdog(text: &str) -> Option<(SocketAddr, Duration)> {
    let (_, open) = text.split_once("socket_open(\"")?;
    let (host, rest) = open.split_once("\", ")?;
    let (port, _) = rest.split_once(',')?;
    let waits: Vec<f64> = text.split("wait_secs = ").skip(1).filter_map(|rest| rest.lines().next()?.parse().ok()).collect();
    let watchdog = Duration::try_from_secs_f64(*waits.last()?).ok()?;
    Some((SocketAddr::new(host.parse().ok()?, port.parse().ok()?), watchdog))
}

async fn obey(client: &mut TcpStream, cell: &Mutex<UrCell>, watchdog: Duration) -> io::Result<()> {
    let mut wait = Duration::from_secs(5);
    loop {
        let mut bytes = [0; UrCommand::BYTES];
        let read = timeout(wait, client.read_exact(&mut bytes)).await;
        // A program that is paused notices nothing, the end of its connection neither.
        while lock(cell).is_paused {
            sleep(CHECK_INTERVAL).await;
        }
        let is_link_dead = lock(cell).is_link_dead;
        if is_link_dead {
            sleep(wait).await;
        }
        let Some(read) = read.ok().filter(|_| !is_link_dead) else {
            lock(cell).starved += 1;
            return Ok(());
        };
        read?;
        wait = watchdog;
        let answer = match UrCommand::decode(&bytes).map_err(io::Error::other)? {
            UrCommand::KeepAlive => None,
            UrCommand::End => return Ok(()),
            UrCommand::SetPoint(joints_rad) => {
                lock(cell).jump(joints_rad);
                None
            }
            UrCommand::Move { sequence, joints_rad, speed_rad_s, acceleration_rad_s2 } => {
                lock(cell).lead(joints_rad, speed_rad_s, acceleration_rad_s2);
                Some(sequence)
            }
            UrCommand::Stop { sequence, .. } => {
                lock(cell).points.ramp_down();
                Some(sequence)
            }
        };
        if let Some(sequence) = answer {
            client.write_all(&sequence.to_be_bytes()).await?;
        }
    }
}

impl UrCell {
    fn new(joints_rad: [f64; 6]) -> Self {
        let now = Instant::now();
        Self {
            points: SetPoints::still(joints_rad),
            moved_at: now,
            speeds_rad_s: [0.0; 6],
            start: now,
            is_program_running: false,
            stop_button: Arc::default(),
            is_paused: false,
            is_link_dead: false,
            safety_bits: NORMAL_BIT,
            mode: MODE_RUNNING,
            starved: 0,
            max_step_rad: 0.0,
        }
    }

    /// Joints as they are now, radians.
    pub fn joints_rad(&mut self) -> [f64; 6] {
        let (now, before, was_moving) = (Instant::now(), self.points.at_rad(), self.points.is_moving());
        let elapsed = now.duration_since(self.moved_at);
        self.moved_at = now;
        let after = if self.is_paused { before } else { self.points.advance(elapsed) };
        let secs = elapsed.as_secs_f64().max(1e-4);
        let speed = |joint: usize| if was_moving { (after[joint] - before[joint]) / secs } else { 0.0 };
        self.speeds_rad_s = std::array::from_fn(speed);
        after
    }

    /// Presses the stop button of the pendant: the program ends.
    pub fn press_stop(&self) {
        self.stop_button.notify_waiters();
    }

    /// Goes to a set point at once.
    fn jump(&mut self, joints_rad: [f64; 6]) {
        let before = self.points.at_rad();
        let step = before.iter().zip(&joints_rad).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        self.max_step_rad = self.max_step_rad.max(step);
        self.points = SetPoints::still(joints_rad);
    }

    /// Goes to a target with a leading axis, as `movej` does.
    fn lead(&mut self, positions_rad: [f64; 6], speed_rad_s: f64, acceleration_rad_s2: f64) {
        self.joints_rad();
        self.points.go(&Target {
            sequence: 0,
            positions_rad,
            max_speed_rad_s: [speed_rad_s; 6],
            max_acceleration_rad_s2: [acceleration_rad_s2; 6],
            duration: Duration::ZERO,
        });
    }

    fn values(&mut self, recipe: &[String]) -> Vec<u8> {
        let joints_rad = self.joints_rad();
        let program = if self.is_program_running { PROGRAM_BIT } else { 0 };
        let state = RtdeState {
            timestamp_secs: self.start.elapsed().as_secs_f64(),
            joints_rad,
            speeds_rad_s: self.speeds_rad_s,
            runtime: match (self.is_program_running, self.is_paused) {
                (false, _) => 1,
                (true, false) => 2,
                (true, true) => 4,
            },
            robot_bits: POWER_BIT | program,
            safety_bits: self.safety_bits,
            mode: self.mode,
        };
        recipe.iter().flat_map(|name| variable(name, &state).1).collect()
    }
}
