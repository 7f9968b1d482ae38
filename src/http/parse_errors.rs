//! Problems in place of the answers that hyper gives by itself. It answers what it cannot parse, a malformed request line or header, or
//! headers that are too large, below the router and without a body, and has no hook for it. The socket knows these answers: nothing
//! else is written while no request is being answered, in HTTP/1.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use bytes::{Buf as _, Bytes};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use super::connection_limiter::ConnectionSlot;
use super::problem::{Code, raw_response};

/// Beginning of a connection in HTTP/2 (RFC 9113, section 3.4), of which no request in HTTP/1 has the method.
const HTTP_2: &[u8] = b"PRI ";

/// A stream that sends a problem for each answer of hyper's own.
pub(super) struct ProblemStream<S> {
    inner: S,
    slot: Arc<ConnectionSlot>,
    /// The first bytes of the connection.
    head: Vec<u8>,
    /// Number of requests whose response was written whole.
    answered: u64,
    /// The part of a problem that is not written yet.
    problem: Bytes,
}

impl<S> ProblemStream<S> {
    /// Wraps `inner`, the stream of the connection that holds this slot.
    pub(super) fn new(inner: S, slot: Arc<ConnectionSlot>) -> Self {
        Self { inner, slot, head: Vec::with_capacity(HTTP_2.len()), answered: 0, problem: Bytes::new() }
    }

    /// Returns true if the bytes are an answer of hyper's own, and takes the problem for it.
    fn replaces(&mut self, bytes: &[u8]) -> bool {
        if self.head == HTTP_2 || self.slot.begun() != self.answered {
            return false;
        }
        let Some(code) = code_of(bytes) else { return false };
        self.problem = raw_response(code).into();
        true
    }
}

/// Code of the problem for an answer of hyper's own; `None` for bytes that are not such an answer.
fn code_of(head: &[u8]) -> Option<Code> {
    let rest = head.strip_prefix(b"HTTP/1.1 ").or_else(|| head.strip_prefix(b"HTTP/1.0 "))?;
    match rest.get(..3)? {
        b"414" | b"431" => Some(Code::HeadersTooLarge),
        [b'4', ..] => Some(Code::BadRequest),
        _ => None,
    }
}

impl<S: AsyncWrite + Unpin> ProblemStream<S> {
    fn poll_problem(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        while self.problem.has_remaining() {
            match ready!(Pin::new(&mut self.inner).poll_write(cx, &self.problem))? {
                0 => return Poll::Ready(Err(io::ErrorKind::WriteZero.into())),
                written => self.problem.advance(written),
            }
        }
        Poll::Ready(Ok(()))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for ProblemStream<S> {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.inner).poll_read(cx, buffer))?;
        let (read, wanted) = (&buffer.filled()[before..], HTTP_2.len() - self.head.len());
        self.head.extend_from_slice(&read[..read.len().min(wanted)]);
        Poll::Ready(Ok(()))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for ProblemStream<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        if self.replaces(bytes) {
            return Poll::Ready(Ok(bytes.len()));
        }
        Pin::new(&mut self.inner).poll_write(cx, bytes)
    }

    fn poll_write_vectored(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[io::IoSlice<'_>]) -> Poll<io::Result<usize>> {
        // A head is the first that is written, and in one piece.
        if bytes.first().is_some_and(|first| self.replaces(first)) {
            return Poll::Ready(Ok(bytes.iter().map(|piece| piece.len()).sum()));
        }
        Pin::new(&mut self.inner).poll_write_vectored(cx, bytes)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(self.poll_problem(cx))?;
        ready!(Pin::new(&mut self.inner).poll_flush(cx))?;
        // hyper flushes once it holds nothing more to write.
        if self.slot.ended() == self.slot.begun() {
            self.answered = self.slot.begun();
        }
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(self.poll_problem(cx))?;
        Pin::new(&mut self.inner).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use std::net::{IpAddr, Ipv4Addr};

    use axum::Router;
    use axum::http::StatusCode;
    use axum::routing::get;
    use hyper_util::rt::TokioIo;
    use serde_json::Value;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    use super::super::connection::ConnectionService;
    use super::super::connection_limiter::ConnectionLimiter;
    use super::super::options::ServerOptions;
    use super::super::serve::builder;
    use super::*;

    const PEER: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

    /// All that a connection answers to these bytes until it closes.
    async fn answer(sent: &str) -> String {
        let (mut client, server) = tokio::io::duplex(1 << 20);
        let slot = ConnectionLimiter::new(1, 1, Vec::new()).admit(PEER).expect("a slot");
        let router = Router::new()
            .route("/", get(|| async { "well" }))
            .route("/refused", get(|| async { (StatusCode::BAD_REQUEST, "HTTP/1.1 400 of ours") }));
        let requests = ConnectionService::new(router, slot.clone(), PEER);
        let stream = TokioIo::new(ProblemStream::new(server, slot));
        tokio::spawn(async move {
            let builder = builder(&ServerOptions::for_tests());
            // Requests that cannot be parsed are errors.
            let _ = builder.serve_connection(stream, requests).await;
        });
        client.write_all(sent.as_bytes()).await.expect("sent");
        let mut answer = String::new();
        client.read_to_string(&mut answer).await.expect("an answer");
        answer
    }

    #[track_caller]
    fn assert_problem(answer: &str, status: u16, code: &str) {
        let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
        assert!(head.starts_with(&format!("HTTP/1.1 {status} ")), "{answer}");
        assert!(head.contains("content-type: application/problem+json"), "{answer}");
        assert!(head.contains(&format!("content-length: {}\r\n", body.len())), "{answer}");
        let problem: Value = serde_json::from_str(body).expect("JSON");
        assert_eq!((&problem["status"], &problem["code"]), (&status.into(), &code.into()), "{answer}");
    }

    #[tokio::test]
    async fn what_cannot_be_parsed_is_answered_by_a_problem() {
        let large = format!("GET / HTTP/1.1\r\nhost: a\r\nx: {}\r\n\r\n", "a".repeat(300_000));
        let long = format!("GET /{} HTTP/1.1\r\nhost: a\r\n\r\n", "a".repeat(70_000));
        for (sent, status, code) in [
            ("nonsense\r\n\r\n", 400, "bad_request"),
            ("GET / HTTP/1.1\r\nhost: a\r\nbad header\r\n\r\n", 400, "bad_request"),
            (large.as_str(), 431, "headers_too_large"),
            (long.as_str(), 431, "headers_too_large"),
        ] {
            assert_problem(&answer(sent).await, status, code);
            // On a connection that was used before, too.
            let after = answer(&format!("GET / HTTP/1.1\r\nhost: a\r\n\r\n{sent}")).await;
            let (first, second) = after.split_once("well").expect("the first answer");
            assert!(first.starts_with("HTTP/1.1 200 "), "{after}");
            assert_problem(second, status, code);
        }
    }

    #[tokio::test]
    async fn answers_of_the_router_are_sent_as_they_are() {
        let refused = answer("GET /refused HTTP/1.1\r\nhost: a\r\nconnection: close\r\n\r\n").await;
        assert!(refused.starts_with("HTTP/1.1 400 ") && refused.ends_with("\r\n\r\nHTTP/1.1 400 of ours"), "{refused}");
    }
}
