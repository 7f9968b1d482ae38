//! A socket that is closed when its client stalls. hyper limits the time for a request's headers once it knows the
//! protocol; it sets no limit before that, while it looks for the HTTP/2 preface, nor while a response waits to be taken.
//!
//! It also lingers on close. Closing a socket with unread data resets the connection and discards the last bytes written: a
//! refused upload would end in a reset instead of the response. So incoming data is read for a moment first.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep};

/// Length of the HTTP/2 preface, bytes; after these hyper knows the protocol.
const PREFACE_LENGTH: usize = 24;
/// Longest time for which data is read after the last response.
const LINGER: Duration = Duration::from_secs(1);
/// Largest amount of data that is read after the last response.
const MAX_LINGER_BYTES: usize = 16 << 20;

/// A stream with a timeout of its first bytes, and of writes that make no progress.
pub(super) struct TimeoutStream<S> {
    inner: S,
    until_preface: usize,
    preface_deadline: Pin<Box<Sleep>>,
    write_stall: Duration,
    write_deadline: Pin<Box<Sleep>>,
    /// True while a write waits for the client; read by the connection limiter.
    writing: Arc<AtomicBool>,
    linger: Option<Linger>,
}

/// State of the lingering close.
struct Linger {
    deadline: Pin<Box<Sleep>>,
    read_bytes: usize,
}

impl<S> TimeoutStream<S> {
    /// Wraps `inner`, and sets `writing` while a write waits for the client.
    pub(super) fn new(inner: S, preface: Duration, write_stall: Duration, writing: Arc<AtomicBool>) -> Self {
        Self {
            inner,
            until_preface: PREFACE_LENGTH,
            preface_deadline: Box::pin(sleep(preface)),
            write_stall,
            write_deadline: Box::pin(sleep(write_stall)),
            writing,
            linger: None,
        }
    }

    /// Updates the deadline by the outcome of a write: progress resets it, a pending write lets it run.
    fn watch_write<T>(&mut self, cx: &mut Context<'_>, written: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.writing.store(false, Ordering::Relaxed);
            // A client that gets a response has sent a request.
            self.until_preface = 0;
            return written;
        }
        if !self.writing.swap(true, Ordering::Relaxed) {
            self.write_deadline.as_mut().reset(Instant::now() + self.write_stall);
        }
        ready!(self.write_deadline.as_mut().poll(cx));
        Poll::Ready(Err(stalled("the client does not read its response")))
    }
}

fn stalled(what: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, what)
}

impl<S: AsyncRead + Unpin> AsyncRead for TimeoutStream<S> {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        let read = Pin::new(&mut this.inner).poll_read(cx, buffer);
        this.until_preface = this.until_preface.saturating_sub(buffer.filled().len() - before);
        if read.is_pending() && this.until_preface > 0 {
            ready!(this.preface_deadline.as_mut().poll(cx));
            return Poll::Ready(Err(stalled("the client sent no request")));
        }
        read
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> AsyncWrite for TimeoutStream<S> {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let written = Pin::new(&mut this.inner).poll_write(cx, bytes);
        this.watch_write(cx, written)
    }

    fn poll_write_vectored(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[io::IoSlice<'_>]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let written = Pin::new(&mut this.inner).poll_write_vectored(cx, bytes);
        this.watch_write(cx, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().inner).poll_flush(cx)
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        if this.linger.is_none() {
            ready!(Pin::new(&mut this.inner).poll_shutdown(cx))?;
        }
        let linger = this.linger.get_or_insert_with(|| Linger { deadline: Box::pin(sleep(LINGER)), read_bytes: 0 });
        linger.poll(&mut this.inner, cx).map(Ok)
    }
}

impl Linger {
    /// Reads until the client closes its side, or a limit is reached.
    fn poll<S: AsyncRead + Unpin>(&mut self, inner: &mut S, cx: &mut Context<'_>) -> Poll<()> {
        let mut piece = [0; 8192];
        while self.read_bytes < MAX_LINGER_BYTES {
            let mut buffer = ReadBuf::new(&mut piece);
            match Pin::new(&mut *inner).poll_read(cx, &mut buffer) {
                Poll::Ready(Ok(())) if !buffer.filled().is_empty() => self.read_bytes += buffer.filled().len(),
                Poll::Ready(_) => return Poll::Ready(()),
                Poll::Pending => return self.deadline.as_mut().poll(cx),
            }
        }
        Poll::Ready(())
    }
}
