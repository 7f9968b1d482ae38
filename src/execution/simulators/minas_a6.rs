//! MINAS A6 drive with a table on it: Modbus RTU on a pseudo terminal or behind a gateway, or Modbus TCP.

mod drive;

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout};

use self::drive::SimulatedDrive;
use super::faults::{DeviceLook, Faults};
use crate::execution::drivers::serial::{PseudoTerminal, open_pseudo_terminal};
use crate::execution::drivers::stream::ByteStream;
use crate::execution::protocol::modbus::{ModbusAdu, ModbusFraming, ModbusReply, ModbusRequest, ModbusSide};

/// Interval at which time and faults act by themselves.
const TICK: Duration = Duration::from_millis(5);
/// Silence after which an incomplete frame is forgotten.
const FRAME_SILENCE: Duration = Duration::from_millis(50);
/// Exception: no such function.
const UNKNOWN_FUNCTION: u8 = 1;
/// Exception: a value that is not allowed.
const WRONG_VALUE: u8 = 3;

/// A drive and its table, as they are set up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveSetup {
    /// Node.
    pub node: u8,
    /// Command units of one turn of the table.
    pub units_per_turn: u32,
    /// Turns of the motor for one of the table.
    pub gear_ratio: f64,
    /// True for turns without end.
    pub has_infinite_rotation: bool,
    /// Position at the beginning, units.
    pub position: i32,
    /// Simulated seconds a second.
    pub factor: f64,
}

impl Default for DriveSetup {
    fn default() -> Self {
        Self { node: 1, units_per_turn: 1_600_000, gear_ratio: 40.0, has_infinite_rotation: false, position: 0, factor: 1.0 }
    }
}

/// A simulated drive. Clones are the same one.
#[derive(Clone, Debug)]
pub struct MinasA6Simulator {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    drive: Mutex<SimulatedDrive>,
    faults: Arc<Faults>,
    node: u8,
    factor: f64,
    began: Instant,
}

impl Shared {
    /// The drive, after everything that happened until now, and the simulated time.
    fn drive(&self) -> (MutexGuard<'_, SimulatedDrive>, f64) {
        let mut drive = self.drive.lock().unwrap_or_else(PoisonError::into_inner);
        let now = self.began.elapsed().as_secs_f64() * self.factor;
        drive.pass(&self.faults.state(), now);
        (drive, now)
    }
}

impl Shared {
    /// Lets faults act when they come, and not when somebody looks.
    async fn keep_time(&self) {
        loop {
            drop(self.drive());
            sleep(TICK).await;
        }
    }
}

impl MinasA6Simulator {
    /// A drive at rest, its servo off.
    #[must_use]
    pub fn new(setup: &DriveSetup) -> Self {
        let (drive, faults, began) = (Mutex::new(SimulatedDrive::new(setup)), Arc::default(), Instant::now());
        Self { shared: Arc::new(Shared { drive, faults, node: setup.node, factor: setup.factor, began }) }
    }

    /// Faults of the simulator.
    #[must_use]
    pub fn faults(&self) -> Arc<Faults> {
        Arc::clone(&self.shared.faults)
    }

    /// A look at its position, turns counted, units, whatever its connections do.
    pub fn position(&self) -> impl Fn() -> f64 + Send + use<> {
        let shared = Arc::clone(&self.shared);
        move || {
            let (drive, now) = shared.drive();
            drive.position(now)
        }
    }

    /// A look at it, whatever its connections do.
    pub fn look(&self) -> impl Fn() -> DeviceLook + Send + Sync + use<> {
        let shared = Arc::clone(&self.shared);
        move || {
            let (drive, now) = shared.drive();
            drive.look(now)
        }
    }

    /// Listens at an address; its address.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub async fn listen(address: &str) -> io::Result<(TcpListener, SocketAddr)> {
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        Ok((listener, address))
    }

    /// Serves connections of a listener until it is dropped, and they with it.
    pub async fn serve(self, listener: TcpListener, framing: ModbusFraming) {
        let accepting = async {
            let mut connections = JoinSet::new();
            while let Ok((stream, _)) = listener.accept().await {
                // Connections that ended are let go.
                while connections.try_join_next().is_some() {}
                // Where that cannot be set, answers are late.
                let _ = stream.set_nodelay(true);
                let drive = self.clone();
                connections.spawn(async move { drive.talk(stream, framing).await });
            }
        };
        tokio::select! {
            () = accepting => {}
            () = self.shared.keep_time() => {}
        }
    }

    /// Answers one client until it goes, or the connection is cut.
    pub async fn talk(&self, stream: impl ByteStream, framing: ModbusFraming) {
        let cut = self.shared.faults.next_cut();
        tokio::select! {
            biased;
            () = cut => {}
            // Whoever goes away is not missed.
            _ = answer(stream, framing, &self.shared) => {}
        }
    }

    /// Opens a pseudo terminal to serve.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn pseudo_terminal() -> io::Result<PseudoTerminal> {
        open_pseudo_terminal()
    }

    /// Serves a serial line, which nobody can cut: a cut loses the frames of a second.
    pub async fn serve_line(self, mut stream: Box<dyn ByteStream>) {
        loop {
            let cut = self.shared.faults.next_cut();
            tokio::select! {
                () = cut => sleep(Duration::from_secs(1)).await,
                () = self.shared.keep_time() => {}
                ended = answer(&mut *stream, ModbusFraming::Rtu, &self.shared) => {
                    if ended.is_err() {
                        return;
                    }
                }
            }
        }
    }
}

/// Answers one stream until it ends.
async fn answer(mut stream: impl ByteStream, framing: ModbusFraming, shared: &Shared) -> io::Result<()> {
    let (mut held, mut chunk) = (Vec::new(), [0; 512]);
    loop {
        let read = stream.read(&mut chunk);
        let read = if held.is_empty() { Ok(read.await) } else { timeout(FRAME_SILENCE, read).await };
        match read {
            Ok(Ok(0)) => return Ok(()),
            Ok(read) => held.extend_from_slice(&chunk[..read?]),
            Err(_) => held.clear(),
        }
        // A frame that is damaged, or another node's, is not answered.
        while let Some(adu) = ModbusAdu::take(&mut held, framing, ModbusSide::Server).unwrap_or_else(|_| {
            held.clear();
            None
        }) {
            let Some(answer) = answer_to(&adu, shared) else { continue };
            let faults = shared.faults.state();
            sleep(faults.late).await;
            if !faults.is_silent {
                stream.write_all(&answer.frame(framing)).await?;
            }
        }
    }
}

fn answer_to(adu: &ModbusAdu, shared: &Shared) -> Option<ModbusAdu> {
    if adu.node != shared.node {
        return None;
    }
    let pdu = match ModbusRequest::parse(&adu.pdu) {
        Ok(request) => {
            let (mut drive, now) = shared.drive();
            request.reply_pdu(&drive.answer(&request, now).unwrap_or_else(ModbusReply::Exception))
        }
        Err(error) => {
            let code = if matches!(error, crate::execution::protocol::modbus::ModbusError::Function(_)) {
                UNKNOWN_FUNCTION
            } else {
                WRONG_VALUE
            };
            vec![adu.pdu.first()? | 0x80, code]
        }
    };
    Some(ModbusAdu { pdu, ..*adu })
}
