//! The loop that accepts connections: a place for each, limits on stalling clients, and an orderly end. Our own, since
//! axum's sets no timer, so that half-sent requests would stay open for ever.

use std::io::Write as _;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::client::canonical;
use super::options::Options;
use super::places::{Full, Places, Seat};
use super::problem::Code;
use super::seated::Seated;
use super::socket::Guarded;

/// Largest size of a request's headers.
const MAX_HEADER_BYTES: usize = 64 * 1024;
/// Connections that may wait to be accepted; the system may allow fewer.
const BACKLOG: u32 = 4096;
/// How long to wait when no connection can be accepted, for example for want of file descriptors: at first, and at most.
const ACCEPT_RETRY: [Duration; 2] = [Duration::from_millis(10), Duration::from_secs(1)];
/// While no connection can be accepted, the log says so this often.
const SAY_AGAIN: Duration = Duration::from_secs(30);
/// Idle connections that are closed when there is no file descriptor for a new one.
const CLOSED_FOR_WANT_OF_FILES: usize = 16;
/// An HTTP/2 connection is asked for a sign of life this often, and closed when none comes for as long.
const HTTP2_PING_EVERY: Duration = Duration::from_secs(20);
/// In a place of the reserve, the request has to come within this time.
const RESERVE_HEADER_TIMEOUT: Duration = Duration::from_secs(2);
/// A connection without a request that has been told to end has this long for it.
const FAREWELL: Duration = Duration::from_millis(500);

/// Why the server cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}")]
    Bind {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
}

/// A server that listens.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    options: Options,
}

/// What every connection is served with.
struct Service {
    router: Router,
    general: auto::Builder<TokioExecutor>,
    reserve: auto::Builder<TokioExecutor>,
    options: Options,
    stopping: CancellationToken,
}

impl Server {
    /// Begins to listen; connections wait until [`Server::run`].
    ///
    /// # Errors
    /// [`ServeError::Bind`].
    pub async fn bind(options: &Options) -> Result<Self, ServeError> {
        let refuse = |source| ServeError::Bind { address: options.listen, source };
        let listener = listen(options.listen).map_err(refuse)?;
        let address = listener.local_addr().map_err(refuse)?;
        Ok(Self { listener, address, options: options.clone() })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `stopped`, then lets open requests end until the time that it gave. Returns whether all did.
    pub async fn run(self, router: Router, stopped: impl Future<Output = Instant>) -> bool {
        let options = self.options;
        let places = Places::new(options.max_connections, options.max_connections_per_address, options.trusted_proxies.clone());
        let (general, reserve) = (builder(&options), reserve_builder());
        let service = Arc::new(Service { router, general, reserve, options, stopping: CancellationToken::new() });
        let connections = TaskTracker::new();
        let mut stopped = std::pin::pin!(stopped);
        let mut trouble = Trouble::default();
        let deadline = loop {
            let accepted = tokio::select! {
                deadline = &mut stopped => break deadline,
                accepted = self.listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, peer)) => {
                    trouble.is_over();
                    begin(&service, &places, &connections, stream, canonical(peer.ip()));
                }
                Err(error) if is_of_one_connection(&error) => {}
                Err(error) => {
                    places.make_room(CLOSED_FOR_WANT_OF_FILES);
                    tokio::select! {
                        deadline = &mut stopped => break deadline,
                        () = tokio::time::sleep(trouble.wait(&error)) => {}
                    }
                }
            }
        };
        drop(self.listener);
        service.stopping.cancel();
        connections.close();
        tokio::time::timeout_at(deadline.into(), connections.wait()).await.is_ok()
    }
}

fn listen(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    // The next process can listen at once, also while connections of the last one are being closed.
    #[cfg(unix)]
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// Errors that belong to a connection that was lost before it was accepted; the next one is not touched by them.
fn is_of_one_connection(error: &std::io::Error) -> bool {
    use std::io::ErrorKind;
    matches!(error.kind(), ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused)
}

/// A time in which no connection can be accepted.
#[derive(Default)]
struct Trouble {
    failures: u32,
    said: Option<Instant>,
}

impl Trouble {
    /// Says so, though not every time, and returns how long to wait before the next attempt.
    fn wait(&mut self, error: &std::io::Error) -> Duration {
        if self.said.is_none_or(|said| said.elapsed() >= SAY_AGAIN) {
            self.said = Some(Instant::now());
            let failures = self.failures + 1;
            tracing::warn!(error = error as &dyn std::error::Error, failures, "no connection can be accepted");
        }
        let [first, longest] = ACCEPT_RETRY;
        let wait = first.saturating_mul(1 << self.failures.min(10)).min(longest);
        self.failures = self.failures.saturating_add(1);
        wait
    }

    fn is_over(&mut self) {
        self.failures = 0;
    }
}

/// Serves a connection, if there is a place for it; else closes it at once, so that it does not keep others waiting.
fn begin(service: &Arc<Service>, places: &Arc<Places>, connections: &TaskTracker, stream: TcpStream, peer: IpAddr) {
    // Answers are written whole; waiting for more only delays them.
    let _ = stream.set_nodelay(true);
    match places.admit(peer) {
        Ok(seat) => {
            let leaving = Leaving::new(seat.clone());
            connections.spawn(serve(service.clone(), seat, leaving, stream, peer));
        }
        Err(full) => {
            metrics::counter!("vantage_connections_refused_total").increment(1);
            // The buffer of a new connection is empty: what is written here leaves as a whole.
            let _ = stream.into_std().and_then(|mut stream| stream.write(canned(full).as_bytes()));
        }
    }
}

/// The answer to a connection for which there is no place at all; nobody reads its request.
fn canned(full: Full) -> String {
    let code = full.code();
    let (status, reason) = (code.status().as_u16(), code.status().canonical_reason().unwrap_or_default());
    let body = super::problem::without_request(code);
    format!(
        "HTTP/1.1 {status} {reason}\r\ncontent-type: application/problem+json\r\ncontent-length: {}\r\n\
         retry-after: 5\r\nconnection: close\r\n\r\n{body}",
        body.len()
    )
}

impl Full {
    /// What a request beyond it is refused with.
    pub(super) fn code(self) -> Code {
        match self {
            Self::Address => Code::TooManyRequests,
            Self::Server => Code::Busy,
        }
    }
}

/// Gives the place back, however the connection ends.
struct Leaving(Arc<Seat>);

impl Leaving {
    fn new(seat: Arc<Seat>) -> Self {
        metrics::gauge!("vantage_connections").increment(1.0);
        Self(seat)
    }
}

impl Drop for Leaving {
    fn drop(&mut self) {
        metrics::gauge!("vantage_connections").decrement(1.0);
        self.0.leave();
    }
}

async fn serve(service: Arc<Service>, seat: Arc<Seat>, _leaving: Leaving, stream: TcpStream, peer: IpAddr) {
    let Service { router, general, reserve, options, stopping } = &*service;
    let (builder, before) = match seat.full() {
        None => (general, options.header_timeout),
        Some(_) => (reserve, RESERVE_HEADER_TIMEOUT),
    };
    let guarded = Guarded::new(stream, before, options.body_idle_timeout, seat.writing.clone());
    let seated = Seated::new(router.clone(), seat.clone(), peer);
    let mut connection = std::pin::pin!(builder.serve_connection(TokioIo::new(guarded), seated));
    let (mut since, mut ending) = (Instant::now(), false);
    loop {
        let limits = if ending { [FAREWELL; 2] } else { [before, options.idle_timeout] };
        tokio::select! {
            ended = connection.as_mut() => {
                if let Err(error) = ended {
                    tracing::debug!(error = &*error, "a connection ended badly");
                }
                return;
            }
            () = seat.evicted() => return,
            () = stopping.cancelled(), if !ending => {}
            () = seat.idle_for(since, limits[0], limits[1]) => if ending { return },
        }
        // Open requests are answered to the end; an HTTP/2 client is told to send no more.
        connection.as_mut().graceful_shutdown();
        (since, ending) = (Instant::now(), true);
    }
}

fn builder(options: &Options) -> auto::Builder<TokioExecutor> {
    let mut builder = auto::Builder::new(TokioExecutor::new());
    builder.http1().timer(TokioTimer::new()).header_read_timeout(options.header_timeout).max_buf_size(MAX_HEADER_BYTES);
    builder
        .http2()
        .timer(TokioTimer::new())
        .max_concurrent_streams(options.http2_max_streams)
        .max_header_list_size(u32::try_from(MAX_HEADER_BYTES).unwrap_or(u32::MAX))
        .keep_alive_interval(HTTP2_PING_EVERY)
        .keep_alive_timeout(HTTP2_PING_EVERY);
    builder
}

/// For places of the reserve: one request, and it has to come soon.
fn reserve_builder() -> auto::Builder<TokioExecutor> {
    let mut builder = auto::Builder::new(TokioExecutor::new()).http1_only();
    builder
        .http1()
        .timer(TokioTimer::new())
        .header_read_timeout(RESERVE_HEADER_TIMEOUT)
        .max_buf_size(MAX_HEADER_BYTES)
        .keep_alive(false);
    builder
}
