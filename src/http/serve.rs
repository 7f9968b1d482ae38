//! The accept loop: connection limits, timeouts of stalled clients, and graceful shutdown. Our own, since axum's sets no
//! timer, so that half-sent requests would stay open for ever.

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
use super::connection::ConnectionService;
use super::connection_limiter::{ConnectionLimiter, ConnectionSlot, ExceededLimit};
use super::options::ServerOptions;
use super::parse_errors::ProblemStream;
use super::problem::{Code, raw_response};
use super::socket::TimeoutStream;
use crate::service::metrics;

/// Largest size of a request's headers, bytes.
const MAX_HEADER_BYTES: usize = 64 * 1024;
/// Connections that may wait to be accepted; the system may allow fewer.
const BACKLOG: u32 = 4096;
/// First delay after a failed accept, for example for lack of file descriptors; it doubles with each further failure.
const MIN_ACCEPT_DELAY: Duration = Duration::from_millis(10);
/// Largest delay after a failed accept.
const MAX_ACCEPT_DELAY: Duration = Duration::from_secs(1);
/// Smallest interval between log entries about failed accepts.
const LOG_INTERVAL: Duration = Duration::from_secs(30);
/// Idle connections that are evicted when there is no file descriptor for a new one.
const EVICTED_AT_ONCE: usize = 16;
/// Interval of HTTP/2 keep-alive pings, and time within which each must be acknowledged.
const HTTP2_PING_INTERVAL: Duration = Duration::from_secs(20);
/// Time within which the request must arrive on a reserved connection.
const RESERVE_HEADER_TIMEOUT: Duration = Duration::from_secs(2);
/// Time that an idle connection has to close after it was told to shut down.
const SHUTDOWN_GRACE: Duration = Duration::from_millis(500);

/// Reasons for which the server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Listening on the address failed.
    #[error("cannot listen on {address}: {source}")]
    Bind {
        /// The address.
        address: SocketAddr,
        /// Cause.
        source: std::io::Error,
    },
}

/// A listening server.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    options: ServerOptions,
}

/// Shared state of all connections.
struct Service {
    router: Router,
    general: auto::Builder<TokioExecutor>,
    reserve: auto::Builder<TokioExecutor>,
    options: ServerOptions,
    stopping: CancellationToken,
}

impl Server {
    /// Begins to listen; connections wait for [`Server::run`].
    ///
    /// # Errors
    /// [`ServeError::Bind`].
    pub async fn bind(options: &ServerOptions) -> Result<Self, ServeError> {
        let refuse = |source| ServeError::Bind { address: options.listen, source };
        let listener = listen(options.listen).map_err(refuse)?;
        let address = listener.local_addr().map_err(refuse)?;
        Ok(Self { listener, address, options: options.clone() })
    }

    /// Address and port that the server listens on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `stopped`, then lets open requests finish until the deadline that it returns. Returns true if all did.
    pub async fn run(self, router: Router, stopped: impl Future<Output = Instant>) -> bool {
        let options = self.options;
        let limiter =
            ConnectionLimiter::new(options.max_connections, options.max_connections_per_address, options.trusted_proxies.clone());
        let (general, reserve) = (builder(&options), reserve_builder());
        let service = Arc::new(Service { router, general, reserve, options, stopping: CancellationToken::new() });
        let connections = TaskTracker::new();
        let mut stopped = std::pin::pin!(stopped);
        let mut backoff = AcceptBackoff::default();
        let deadline = loop {
            let accepted = tokio::select! {
                deadline = &mut stopped => break deadline,
                accepted = self.listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, peer)) => {
                    backoff.reset();
                    begin(&service, &limiter, &connections, stream, canonical(peer.ip()));
                }
                Err(error) if is_of_one_connection(&error) => {}
                Err(error) => {
                    limiter.evict_idle(EVICTED_AT_ONCE);
                    tokio::select! {
                        deadline = &mut stopped => break deadline,
                        () = tokio::time::sleep(backoff.delay(&error)) => {}
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
    // A new process can listen at once, even while connections of the last one are being closed.
    #[cfg(unix)]
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// Returns true for errors of a connection that was lost before it was accepted; they do not affect the next one.
fn is_of_one_connection(error: &std::io::Error) -> bool {
    use std::io::ErrorKind;
    matches!(error.kind(), ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused)
}

/// Backoff after failed accepts.
#[derive(Default)]
struct AcceptBackoff {
    failures: u32,
    logged: Option<Instant>,
}

impl AcceptBackoff {
    /// Logs the failure, unless one was logged just now, and returns the delay before the next attempt.
    fn delay(&mut self, error: &std::io::Error) -> Duration {
        if self.logged.is_none_or(|logged| logged.elapsed() >= LOG_INTERVAL) {
            self.logged = Some(Instant::now());
            let failures = self.failures + 1;
            tracing::warn!(error = error as &dyn std::error::Error, failures, "no connection can be accepted");
        }
        let delay = MIN_ACCEPT_DELAY.saturating_mul(1 << self.failures.min(10)).min(MAX_ACCEPT_DELAY);
        self.failures = self.failures.saturating_add(1);
        delay
    }

    fn reset(&mut self) {
        self.failures = 0;
    }
}

/// Serves a connection if it is admitted; else closes it at once, so that it does not keep others waiting.
fn begin(service: &Arc<Service>, limiter: &Arc<ConnectionLimiter>, connections: &TaskTracker, stream: TcpStream, peer: IpAddr) {
    // Responses are written whole; Nagle's algorithm would only delay them.
    let _ = stream.set_nodelay(true);
    match limiter.admit(peer) {
        Ok(slot) => {
            let guard = SlotGuard::new(slot.clone());
            connections.spawn(serve(service.clone(), slot, guard, stream, peer));
        }
        Err(limit) => {
            metrics::record(|metrics| metrics.connections_refused.inc());
            // The buffer of a new connection is empty, so the response is sent whole.
            let _ = stream.into_std().and_then(|mut stream| stream.write(&raw_response(limit.code())));
        }
    }
}

impl ExceededLimit {
    /// Code of the problem with which a request beyond the limit is refused.
    pub(super) fn code(self) -> Code {
        match self {
            Self::Address => Code::TooManyRequests,
            Self::Server => Code::Busy,
        }
    }
}

/// Guard that frees the slot, however the connection ends.
struct SlotGuard(Arc<ConnectionSlot>);

impl SlotGuard {
    fn new(slot: Arc<ConnectionSlot>) -> Self {
        metrics::record(|metrics| metrics.connections.inc());
        Self(slot)
    }
}

impl Drop for SlotGuard {
    fn drop(&mut self) {
        metrics::record(|metrics| metrics.connections.dec());
        self.0.release();
    }
}

async fn serve(service: Arc<Service>, slot: Arc<ConnectionSlot>, _guard: SlotGuard, stream: TcpStream, peer: IpAddr) {
    let Service { router, general, reserve, options, stopping } = &*service;
    let (builder, before) = match slot.exceeded_limit() {
        None => (general, options.header_timeout),
        Some(_) => (reserve, RESERVE_HEADER_TIMEOUT),
    };
    let stream = TimeoutStream::new(stream, before, options.body_idle_timeout, slot.writing.clone());
    let stream = ProblemStream::new(stream, slot.clone());
    let requests = ConnectionService::new(router.clone(), slot.clone(), peer);
    let mut connection = std::pin::pin!(builder.serve_connection(TokioIo::new(stream), requests));
    let (mut since, mut ending) = (Instant::now(), false);
    loop {
        let limits = if ending { [SHUTDOWN_GRACE; 2] } else { [before, options.idle_timeout] };
        tokio::select! {
            ended = connection.as_mut() => {
                if let Err(error) = ended {
                    tracing::debug!(error = &*error, "a connection ended with an error");
                }
                return;
            }
            () = slot.evicted() => return,
            () = stopping.cancelled(), if !ending => {}
            () = slot.idle_for(since, limits[0], limits[1]) => if ending { return },
        }
        // Open requests are completed; an HTTP/2 client is told to send no more.
        connection.as_mut().graceful_shutdown();
        (since, ending) = (Instant::now(), true);
    }
}

/// Builder for connections of the general pool.
pub(super) fn builder(options: &ServerOptions) -> auto::Builder<TokioExecutor> {
    let mut builder = auto::Builder::new(TokioExecutor::new());
    builder.http1().timer(TokioTimer::new()).header_read_timeout(options.header_timeout).max_buf_size(MAX_HEADER_BYTES);
    builder
        .http2()
        .timer(TokioTimer::new())
        .max_concurrent_streams(options.http2_max_streams)
        .max_header_list_size(u32::try_from(MAX_HEADER_BYTES).unwrap_or(u32::MAX))
        .keep_alive_interval(HTTP2_PING_INTERVAL)
        .keep_alive_timeout(HTTP2_PING_INTERVAL);
    builder
}

/// Builder for reserved connections: a single request, with a short timeout.
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
