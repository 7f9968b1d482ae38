//! A terminal device as a stream.

use std::io;
use std::os::fd::OwnedFd;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use rustix::fs::{Mode, OFlags};
use rustix::pty::OpenptFlags;
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};
use tokio::io::unix::AsyncFd;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use crate::cell::SerialParity;

/// A terminal device, open and raw.
pub(super) struct SerialLine {
    device: AsyncFd<OwnedFd>,
    /// Other end of a pseudo terminal, held so that it does not hang up while nobody has it open.
    _other_end: Option<OwnedFd>,
}

impl SerialLine {
    /// Opens a serial device.
    pub(super) fn open(path: &str, baud: u32, parity: SerialParity) -> io::Result<Self> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let device = rustix::fs::open(path, flags, Mode::empty())?;
        rustix::termios::ioctl_tiocexcl(&device)?;
        make_raw(&device, baud, parity)?;
        Ok(Self { device: watched(device)?, _other_end: None })
    }

    /// Opens a pseudo terminal: its controlling end, and the path of the other one.
    pub(super) fn pseudo_terminal() -> io::Result<(Self, String)> {
        let controller = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        rustix::pty::grantpt(&controller)?;
        rustix::pty::unlockpt(&controller)?;
        let path = rustix::pty::ptsname(&controller, Vec::new())?.into_string().map_err(io::Error::other)?;
        let other_end = rustix::fs::open(path.as_str(), OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        make_raw(&other_end, 115_200, SerialParity::None)?;
        rustix::io::ioctl_fionbio(&controller, true)?;
        Ok((Self { device: watched(controller)?, _other_end: Some(other_end) }, path))
    }
}

/// A device that the runtime watches for bytes.
#[expect(
    deprecated,
    reason = "unsound for types that may close or change their descriptor; this one owns it until it is dropped"
)]
fn watched(device: OwnedFd) -> io::Result<AsyncFd<OwnedFd>> {
    AsyncFd::new(device)
}

/// Eight data bits, one stop bit, nothing translated.
fn make_raw(device: &OwnedFd, baud: u32, parity: SerialParity) -> io::Result<()> {
    let mut settings = tcgetattr(device)?;
    settings.make_raw();
    settings.set_speed(baud)?;
    settings.control_modes.insert(ControlModes::CLOCAL | ControlModes::CREAD);
    settings.control_modes.remove(ControlModes::CSTOPB | ControlModes::PARENB | ControlModes::PARODD);
    settings.control_modes.insert(match parity {
        SerialParity::Even => ControlModes::PARENB,
        SerialParity::Odd => ControlModes::PARENB | ControlModes::PARODD,
        SerialParity::None => ControlModes::empty(),
    });
    Ok(tcsetattr(device, OptionalActions::Flush, &settings)?)
}

impl AsyncRead for SerialLine {
    fn poll_read(self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let mut chunk = [0; 256];
        let wanted = chunk.len().min(buffer.remaining());
        loop {
            let mut ready = ready!(self.device.poll_read_ready(context))?;
            let read = ready.try_io(|device| Ok(rustix::io::read(device.get_ref(), &mut chunk[..wanted])?));
            if let Ok(read) = read {
                buffer.put_slice(&chunk[..read?]);
                return Poll::Ready(Ok(()));
            }
        }
    }
}

impl AsyncWrite for SerialLine {
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        loop {
            let mut ready = ready!(self.device.poll_write_ready(context))?;
            if let Ok(written) = ready.try_io(|device| Ok(rustix::io::write(device.get_ref(), bytes)?)) {
                return Poll::Ready(written);
            }
        }
    }

    fn poll_flush(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}
