//! The loop that accepts connections: a cap on how many there are, limits on stalling clients, and an orderly end. Our
//! own, since axum's sets no timer, so that half-sent requests would stay open for ever.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto;
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::options::Options;
use super::socket::Guarded;

/// Largest size of a request's headers.
const MAX_HEADER_BYTES: usize = 64 * 1024;
/// How long to wait when no connection can be accepted, for example for want of file descriptors.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);
/// An HTTP/2 connection is asked for a sign of life this often, and closed when none comes for as long.
const HTTP2_PING_EVERY: Duration = Duration::from_secs(20);

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
    builder: auto::Builder<TokioExecutor>,
    options: Options,
}

impl Server {
    /// Begins to listen; connections wait until [`Server::run`].
    ///
    /// # Errors
    /// [`ServeError::Bind`].
    pub async fn bind(options: &Options) -> Result<Self, ServeError> {
        let refuse = |source| ServeError::Bind { address: options.listen, source };
        let listener = TcpListener::bind(options.listen).await.map_err(refuse)?;
        let address = listener.local_addr().map_err(refuse)?;
        Ok(Self { listener, address, builder: builder(options), options: options.clone() })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `stopped`, then lets open requests end for as long as the options allow. Returns whether all did.
    pub async fn run(self, router: Router, stopped: impl Future<Output = ()>) -> bool {
        let connections = GracefulShutdown::new();
        let places = Arc::new(Semaphore::new(self.options.max_connections));
        let mut stopped = std::pin::pin!(stopped);
        loop {
            let accepted = tokio::select! {
                () = &mut stopped => break,
                accepted = accept(&self.listener, &places) => accepted,
            };
            match accepted {
                Ok((stream, place)) => self.spawn(stream, place, router.clone(), &connections),
                Err(error) => {
                    tracing::warn!(error = &error as &dyn std::error::Error, "no connection can be accepted");
                    tokio::time::sleep(ACCEPT_RETRY).await;
                }
            }
        }
        drop(self.listener);
        tokio::time::timeout(self.options.drain_timeout, connections.shutdown()).await.is_ok()
    }

    fn spawn(&self, stream: TcpStream, place: OwnedSemaphorePermit, router: Router, connections: &GracefulShutdown) {
        // Answers are written whole; waiting for more only delays them.
        let _ = stream.set_nodelay(true);
        let guarded = Guarded::new(stream, self.options.header_timeout, self.options.body_idle_timeout);
        let service = TowerToHyperService::new(router);
        let connection = self.builder.serve_connection(TokioIo::new(guarded), service).into_owned();
        let connection = connections.watch(connection);
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::debug!(error = &*error, "a connection ended badly");
            }
            drop(place);
        });
    }
}

async fn accept(listener: &TcpListener, places: &Arc<Semaphore>) -> std::io::Result<(TcpStream, OwnedSemaphorePermit)> {
    let place = places.clone().acquire_owned().await.map_err(std::io::Error::other)?;
    let (stream, _) = listener.accept().await?;
    Ok((stream, place))
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
