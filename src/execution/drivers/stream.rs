//! Connections to controllers: streams of bytes with a log of everything on the wire. Who dials is a parameter, so that tests
//! put a simulated network below a driver.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::BoxFuture;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::task::unconstrained;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use crate::execution::device::{DeviceError, Direction, STOP_ATTEMPT, WireLog};

/// Bytes read at once.
const CHUNK: usize = 4096;
/// Bytes that may wait for the wire: more than that, and nobody takes them.
const MAX_UNSENT_BYTES: usize = 64 << 10;
/// Pause after the first attempt to connect.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
/// Longest pause between attempts to connect.
const MAX_PAUSE: Duration = Duration::from_secs(1);

/// Longest time that a stop waits on the link that there is, which may be dead and not say so: the rest of the attempt is for a
/// new one.
pub const STOP_WAIT: Duration = Duration::from_millis(STOP_ATTEMPT.as_millis() as u64 * 2 / 5);

/// Words for a device that is to move and has no right to.
pub const NOT_ARMED: &str = "it is not armed; arm the run first";

/// Words for a watchdog that lapsed.
pub(super) const NOT_FED: &str = "it was not kept alive in time, as this machine was too busy or stood still; arm it again";

/// Bytes both ways, over whatever carries them.
pub trait ByteStream: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> ByteStream for T {}

/// Opens streams to addresses.
pub trait Dialer: Send + Sync {
    /// Opens a stream to `host:port`.
    fn dial<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Box<dyn ByteStream>>>;
}

/// TCP of this machine, small messages sent at once. A stream that is dropped is reset: what the network has not taken by then is
/// never sent, or a move that was held up would arrive after the stop that went over the next connection.
#[derive(Clone, Copy, Debug, Default)]
pub struct TcpDialer;

impl Dialer for TcpDialer {
    fn dial<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Box<dyn ByteStream>>> {
        Box::pin(async move {
            let stream = TcpStream::connect(address).await?;
            stream.set_nodelay(true)?;
            stream.set_zero_linger()?;
            Ok(Box::new(stream) as Box<dyn ByteStream>)
        })
    }
}

/// Network of a device and the log of its bytes.
#[derive(Clone)]
pub struct Wiring {
    /// Opens its streams.
    pub dialer: Arc<dyn Dialer>,
    /// Keeps its bytes.
    pub log: Arc<dyn WireLog>,
    /// Name of the device in the log: `arm`, `table` or `trigger`.
    pub device: &'static str,
}

impl Wiring {
    /// Wiring over this machine's TCP.
    #[must_use]
    pub fn over_tcp(device: &'static str, log: Arc<dyn WireLog>) -> Self {
        Self { dialer: Arc::new(TcpDialer), log, device }
    }

    /// Connects, with further attempts after growing pauses, until `patience` is over.
    ///
    /// # Errors
    /// [`DeviceError::Unreachable`] with the words of the last attempt.
    pub async fn connect(&self, address: &str, patience: Duration) -> Result<Connection, DeviceError> {
        let deadline = Instant::now() + patience;
        let mut pause = FIRST_PAUSE;
        loop {
            let reason = match timeout_at(deadline, self.dialer.dial(address)).await {
                Ok(Ok(stream)) => return Ok(self.connection(stream)),
                Ok(Err(error)) => error.to_string(),
                Err(_) => format!("no answer within {} ms", patience.as_millis()),
            };
            if Instant::now() + pause >= deadline {
                return Err(DeviceError::Unreachable { address: address.to_owned(), reason });
            }
            sleep(pause).await;
            pause = (2 * pause).min(MAX_PAUSE);
        }
    }

    /// Connection over a stream that is open already, such as a serial line.
    #[must_use]
    pub fn connection(&self, stream: Box<dyn ByteStream>) -> Connection {
        Connection { stream, wiring: self.clone(), unsent: Vec::new() }
    }
}

impl std::fmt::Debug for Wiring {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Wiring").field("device", &self.device).finish_non_exhaustive()
    }
}

/// An open connection. Its futures may be dropped: a message that was begun is finished before the next one, and bytes that
/// were received are not lost.
pub struct Connection {
    stream: Box<dyn ByteStream>,
    wiring: Wiring,
    unsent: Vec<u8>,
}

impl Connection {
    /// Hands a message to the wire.
    ///
    /// # Errors
    /// [`DeviceError::Closed`].
    pub async fn send(&mut self, message: &[u8]) -> Result<(), DeviceError> {
        if self.unsent.len() + message.len() > MAX_UNSENT_BYTES {
            return Err(DeviceError::Closed { reason: "the controller takes no more bytes".to_owned() });
        }
        self.unsent.extend_from_slice(message);
        while !self.unsent.is_empty() {
            let written = self.stream.write(&self.unsent).await.map_err(|error| closed(&error))?;
            if written == 0 {
                return Err(DeviceError::Closed { reason: "the stream takes no more bytes".to_owned() });
            }
            self.wiring.log.record(self.wiring.device, Direction::Sent, &self.unsent[..written]);
            self.unsent.drain(..written);
        }
        self.stream.flush().await.map_err(|error| closed(&error))
    }

    /// Waits for bytes and appends them to `into`, at most 4096.
    ///
    /// # Errors
    /// [`DeviceError::Closed`].
    pub async fn receive(&mut self, into: &mut Vec<u8>) -> Result<(), DeviceError> {
        let mut chunk = [0; CHUNK];
        let read = self.stream.read(&mut chunk).await.map_err(|error| closed(&error))?;
        if read == 0 {
            return Err(DeviceError::Closed { reason: "the other side closed it".to_owned() });
        }
        self.wiring.log.record(self.wiring.device, Direction::Received, &chunk[..read]);
        into.extend_from_slice(&chunk[..read]);
        Ok(())
    }

    /// Appends bytes that are here already to `into`, at most 4096; returns false where none are.
    ///
    /// # Errors
    /// [`DeviceError::Closed`].
    pub async fn receive_ready(&mut self, into: &mut Vec<u8>) -> Result<bool, DeviceError> {
        let received = async {
            tokio::select! {
                biased;
                received = self.receive(into) => received.map(|()| true),
                () = std::future::ready(()) => Ok(false),
            }
        };
        // A task that has used up its budget is told that nothing is here, whatever is.
        unconstrained(received).await
    }

    /// The stream below, whose bytes are not logged from here on.
    pub(super) fn into_stream(self) -> Box<dyn ByteStream> {
        self.stream
    }

    /// Says that nothing more will be sent, so that a controller with one client frees its place.
    pub async fn close(mut self) {
        // The other side may have gone first.
        let _ = self.stream.shutdown().await;
    }
}

impl std::fmt::Debug for Connection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Connection")
            .field("device", &self.wiring.device)
            .field("unsent", &self.unsent.len())
            .finish_non_exhaustive()
    }
}

/// Milliseconds of a specification.
pub(super) fn ms(milliseconds: u32) -> Duration {
    Duration::from_millis(milliseconds.into())
}

/// Waits for an answer at most so long.
///
/// # Errors
/// Errors of `answer`, and [`DeviceError::Silent`].
pub async fn within<T>(wait: Duration, answer: impl Future<Output = Result<T, DeviceError>>) -> Result<T, DeviceError> {
    timeout(wait, answer).await.unwrap_or(Err(DeviceError::Silent { waited: wait }))
}

/// Error of a connection that ended.
fn closed(error: &io::Error) -> DeviceError {
    DeviceError::Closed { reason: error.to_string() }
}

/// Error of a device that was found again for a stop alone: whether it is the one that was checked, nobody knows.
#[must_use]
pub fn reconnected() -> DeviceError {
    let reason = "its connection was lost, and is open anew for the stop alone; begin another run from this step";
    DeviceError::NotReady { reason: reason.to_owned() }
}

/// Error of a device that is not connected, or no longer.
#[must_use]
pub fn not_connected() -> DeviceError {
    DeviceError::Closed { reason: "it is not open".to_owned() }
}
