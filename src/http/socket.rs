//! A connection that is closed when its client stalls. hyper limits the time for a request's headers once it knows the
//! protocol; before that, while it looks for the HTTP/2 preface, and while an answer waits to be taken, it does not.
//!
//! It is also closed in two steps. Closing a socket on which something unread lies takes what was written last from the
//! client: a refused upload would end in a reset instead of the reason. So what still comes is read for a moment.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep};

/// Bytes of the HTTP/2 preface: after as many hyper knows the protocol.
const PREFACE_LENGTH: usize = 24;
/// What still comes after the last answer is read for this long, up to so many bytes.
const LINGER: Duration = Duration::from_secs(1);
const LINGER_BYTES: usize = 16 << 20;

/// A stream with a limit on the time for its first bytes, and on the time for which a write makes no headway.
pub(super) struct Guarded<S> {
    inner: S,
    until_preface: usize,
    preface_deadline: Pin<Box<Sleep>>,
    write_stall: Duration,
    write_deadline: Pin<Box<Sleep>>,
    /// Whether a write waits for the client; others look at it.
    writing: Arc<AtomicBool>,
    linger: Option<Linger>,
}

/// The reading of what still comes after the last answer.
struct Linger {
    deadline: Pin<Box<Sleep>>,
    read_bytes: usize,
}

impl<S> Guarded<S> {
    /// Guards `inner`, and says in `writing` whether a write waits for the client.
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

    /// What came of a write: headway puts the deadline off, none lets it run.
    fn watch_write<T>(&mut self, cx: &mut Context<'_>, written: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.writing.store(false, Ordering::Relaxed);
            // Whoever is answered has sent a request.
            self.until_preface = 0;
            return written;
        }
        if !self.writing.swap(true, Ordering::Relaxed) {
            self.write_deadline.as_mut().reset(Instant::now() + self.write_stall);
        }
        ready!(self.write_deadline.as_mut().poll(cx));
        Poll::Ready(Err(stalled("the client takes nothing of its answer")))
    }
}

fn stalled(what: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, what)
}

impl<S: AsyncRead + Unpin> AsyncRead for Guarded<S> {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        let read = Pin::new(&mut this.inner).poll_read(cx, buffer);
        this.until_preface = this.until_preface.saturating_sub(buffer.filled().len() - before);
        if read.is_pending() && this.until_preface > 0 {
            ready!(this.preface_deadline.as_mut().poll(cx));
            return Poll::Ready(Err(stalled("the client sends no request")));
        }
        read
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> AsyncWrite for Guarded<S> {
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
    /// Reads until the client closes its side, or until it is enough.
    fn poll<S: AsyncRead + Unpin>(&mut self, inner: &mut S, cx: &mut Context<'_>) -> Poll<()> {
        let mut piece = [0; 8192];
        while self.read_bytes < LINGER_BYTES {
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
