//! The service of one connection, in front of the router: it tells the connection's slot when a request begins, progresses
//! and ends, tells the request its peer address, and announces that the connection closes after a body that was left unread.

use std::convert::Infallible;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Waker, ready};

use axum::Router;
use axum::body::Body;
use axum::http::header::{CONNECTION, EXPECT};
use axum::http::{HeaderValue, Request, Response, Version};
use bytes::Bytes;
use hyper::body::{Body as _, Frame, Incoming, SizeHint};
use hyper::service::Service;
use tower::Service as _;

use super::client::Peer;
use super::connection_limiter::{ConnectionSlot, OpenBody, OpenRequest};

/// The router as the hyper service of one connection.
pub(super) struct ConnectionService {
    router: Router,
    slot: Arc<ConnectionSlot>,
    peer: IpAddr,
}

impl ConnectionService {
    /// Serves the connection that holds this slot and comes from this address.
    pub(super) fn new(router: Router, slot: Arc<ConnectionSlot>, peer: IpAddr) -> Self {
        Self { router, slot, peer }
    }
}

impl Service<Request<Incoming>> for ConnectionService {
    type Response = Response<GuardedBody<Body, OpenRequest>>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Infallible>> + Send>>;

    fn call(&self, mut request: Request<Incoming>) -> Self::Future {
        let open = self.slot.begin_request();
        request.extensions_mut().insert(Peer(self.peer));
        if let Some(limit) = self.slot.exceeded_limit() {
            request.extensions_mut().insert(limit);
        }
        let version = request.version();
        let (request, is_received) = self.with_receipt(request);
        // A router is always ready.
        let response = self.router.clone().call(request);
        Box::pin(async move {
            let mut response = response.await?;
            if is_received.is_some_and(|is_received| !is_received.load(Ordering::Relaxed)) {
                announce_close(&mut response, version);
            }
            Ok(response.map(|body| GuardedBody { inner: body, guard: Some(open) }))
        })
    }
}

impl ConnectionService {
    /// The request for the router, and for HTTP/1 the mark that its body sets once it is received to its end; `None` for a request
    /// without a body, and for HTTP/2, where a body that is left unread ends its stream and not the connection.
    fn with_receipt(&self, request: Request<Incoming>) -> (Request<Body>, Option<Arc<AtomicBool>>) {
        if request.body().is_end_stream() {
            return (request.map(Body::new), None);
        }
        let is_http1 = request.version() <= Version::HTTP_11;
        let is_received = Arc::new(AtomicBool::new(false));
        let has_rest = is_http1 && !request.headers().contains_key(EXPECT);
        let guard = Some(self.slot.begin_body());
        let received = is_received.clone();
        let body = |inner| Body::new(RequestBody { inner: GuardedBody { inner, guard }, is_received: received, has_rest });
        (request.map(body), is_http1.then_some(is_received))
    }
}

/// Adds `Connection: close` to the response to a request whose body was not received to its end: hyper closes the connection then, and
/// a client that is not told sends its next request on it, which is lost (RFC 9112, section 9.6).
fn announce_close(response: &mut Response<Body>, version: Version) {
    response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
    if version == Version::HTTP_10 {
        // To a response in HTTP/1.1 for a client in HTTP/1.0 that asks for it hyper adds `keep-alive`.
        *response.version_mut() = version;
    }
}

/// Body of a request, which marks that it was received to its end. What lies here when it is dropped counts: hyper hands on a small body
/// of known length in one piece with the request, and keeps the connection of one that it has taken whole. A larger one, or one
/// in chunks, of which hyper might still drain the rest from its buffer, counts as unread: whether it does depends on when the
/// bytes arrive, and a connection that is closed needlessly costs a client less than a request that is lost.
struct RequestBody {
    inner: GuardedBody<Incoming, OpenBody>,
    is_received: Arc<AtomicBool>,
    /// True while the rest may lie here: not after an error, not in HTTP/2, and not while the client waits for `100 Continue`, which a
    /// look at the rest would send.
    has_rest: bool,
}

impl hyper::body::Body for RequestBody {
    type Data = Bytes;
    type Error = hyper::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, hyper::Error>>> {
        let frame = ready!(Pin::new(&mut self.inner).poll_frame(cx));
        if matches!(frame, Some(Err(_))) {
            self.has_rest = false;
        } else if frame.is_none() || self.inner.is_end_stream() {
            self.has_rest = false;
            self.is_received.store(true, Ordering::Relaxed);
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.inner.size_hint()
    }
}

impl Drop for RequestBody {
    fn drop(&mut self) {
        if self.has_rest {
            // One piece at most is handed on at a time, and nobody waits for more.
            let _ = Pin::new(self).poll_frame(&mut Context::from_waker(Waker::noop()));
        }
    }
}

/// A guard that a body holds until its end.
pub(super) trait BodyGuard: Unpin {
    /// Records the arrival of a chunk.
    fn progress(&self) {}
}

impl BodyGuard for OpenRequest {}

impl BodyGuard for OpenBody {
    fn progress(&self) {
        Self::progress(self);
    }
}

/// A body that drops its guard at its end.
pub(super) struct GuardedBody<B, G> {
    inner: B,
    guard: Option<G>,
}

impl<B: hyper::body::Body<Data = Bytes> + Unpin, G: BodyGuard> hyper::body::Body for GuardedBody<B, G> {
    type Data = Bytes;
    type Error = B::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, B::Error>>> {
        let frame = ready!(Pin::new(&mut self.inner).poll_frame(cx));
        match (&frame, &self.guard) {
            (Some(Ok(_)), Some(guard)) => guard.progress(),
            _ => self.guard = None,
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.inner.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use axum::http::StatusCode;
    use axum::routing::{get, post};
    use hyper_util::rt::TokioIo;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    use super::super::connection_limiter::ConnectionLimiter;
    use super::super::options::ServerOptions;
    use super::super::serve::builder;
    use super::*;

    /// A request that is answered and leaves the connection open, and the last one of a connection.
    const NEXT: &str = "GET /next HTTP/1.1\r\nhost: a\r\n\r\n";
    const LAST: &str = "GET /next HTTP/1.1\r\nhost: a\r\nconnection: close\r\n\r\n";

    /// All that a connection answers to these bytes until it closes.
    async fn answers(sent: &str) -> String {
        let (mut client, server) = tokio::io::duplex(1 << 20);
        let slot = ConnectionLimiter::new(1, 1, Vec::new()).admit(Ipv4Addr::LOCALHOST.into()).expect("a slot");
        let router = Router::new()
            .route("/next", get(|| async { "the next" }))
            .route("/read", post(|body: Bytes| async move { format!("read {}", body.len()) }))
            .route("/refused", post(|| async { (StatusCode::UNSUPPORTED_MEDIA_TYPE, "refused") }));
        let requests = ConnectionService::new(router, slot, Ipv4Addr::LOCALHOST.into());
        tokio::spawn(async move {
            let builder = builder(&ServerOptions::for_tests());
            // A body that is cut off is an error.
            let _ = builder.serve_connection(TokioIo::new(server), requests).await;
        });
        client.write_all(sent.as_bytes()).await.expect("sent");
        let mut answers = String::new();
        client.read_to_string(&mut answers).await.expect("answers");
        answers
    }

    fn head(path: &str, headers: &str) -> String {
        format!("POST {path} HTTP/1.1\r\nhost: a\r\n{headers}\r\n\r\n")
    }

    /// The connection closed without a word, and the client's next request was lost.
    #[tokio::test]
    async fn a_response_to_a_body_that_is_left_unread_says_that_the_connection_closes() {
        let part = "x".repeat(1000);
        for sent in [
            head("/refused", "content-length: 3000000") + &part,
            head("/refused", "transfer-encoding: chunked") + "3e8\r\n" + &part + "\r\n",
            head("/refused", "content-length: 3000000\r\nexpect: 100-continue"),
            head("/nowhere", "content-length: 3000000") + &part,
            head("/refused", "content-length: 3000000\r\nconnection: keep-alive").replace("HTTP/1.1", "HTTP/1.0"),
        ] {
            let answer = answers(&sent).await;
            assert!(answer.starts_with("HTTP/1.1 4") || answer.starts_with("HTTP/1.0 4"), "{answer}");
            let told: Vec<&str> = answer.lines().filter(|line| line.starts_with("connection: ")).collect();
            assert_eq!(told, ["connection: close"], "{answer}");
        }
    }

    #[tokio::test]
    async fn a_body_that_was_received_to_its_end_keeps_the_connection() {
        let (long, short) = ("x".repeat(300_000), "{}");
        for (sent, body) in [
            (head("/read", "content-length: 300000") + &long, "read 300000"),
            (head("/read", "transfer-encoding: chunked") + "5\r\nhello\r\n0\r\n\r\n", "read 5"),
            (head("/read", "content-length: 0"), "read 0"),
            // Handed on whole with the request.
            (head("/refused", "content-length: 2") + short, "refused"),
            (NEXT.to_owned(), "the next"),
        ] {
            let answers = answers(&(sent + LAST)).await;
            let (first, second) = answers.split_once(body).unwrap_or_else(|| panic!("{body}: {answers}"));
            assert!(!first.contains("connection:"), "{answers}");
            assert!(second.starts_with("HTTP/1.1 200") && second.ends_with("the next"), "{answers}");
        }
    }
}
