//! A connection that is closed when its client stalls. hyper limits the time for a request's headers once it knows the
//! protocol; before that, while it looks for the HTTP/2 preface, and while an answer waits to be taken, it does not.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep};

/// Bytes of the HTTP/2 preface: after as many hyper knows the protocol.
const PREFACE_LENGTH: usize = 24;

/// A stream with a limit on the time for its first bytes, and on the time for which a write makes no headway.
pub(super) struct Guarded<S> {
    inner: S,
    until_preface: usize,
    preface_deadline: Pin<Box<Sleep>>,
    write_stall: Duration,
    write_deadline: Pin<Box<Sleep>>,
    writing: bool,
}

impl<S> Guarded<S> {
    /// Guards `inner`.
    pub(super) fn new(inner: S, preface: Duration, write_stall: Duration) -> Self {
        Self {
            inner,
            until_preface: PREFACE_LENGTH,
            preface_deadline: Box::pin(sleep(preface)),
            write_stall,
            write_deadline: Box::pin(sleep(write_stall)),
            writing: false,
        }
    }

    /// What came of a write: headway puts the deadline off, none lets it run.
    fn watch_write<T>(&mut self, cx: &mut Context<'_>, written: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.writing = false;
            // Whoever is answered has sent a request.
            self.until_preface = 0;
            return written;
        }
        if !self.writing {
            self.writing = true;
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

impl<S: AsyncWrite + Unpin> AsyncWrite for Guarded<S> {
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
        Pin::new(&mut self.get_mut().inner).poll_shutdown(cx)
    }
}
