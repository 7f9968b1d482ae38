//! Serial lines: eight data bits, raw. Pseudo terminals, on which a simulator stands for the device at the other end of one.

#[cfg(unix)]
mod unix;

use std::io;

use super::stream::ByteStream;
use crate::cell::SerialParity;

/// Opens a serial line for this process alone.
///
/// # Errors
/// Errors of the operating system.
#[cfg(unix)]
pub fn open(path: &str, baud: u32, parity: SerialParity) -> io::Result<Box<dyn ByteStream>> {
    Ok(Box::new(unix::SerialLine::open(path, baud, parity)?))
}

/// Opens a serial line.
///
/// # Errors
/// [`io::ErrorKind::Unsupported`].
#[cfg(not(unix))]
pub fn open(_path: &str, _baud: u32, _parity: SerialParity) -> io::Result<Box<dyn ByteStream>> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "serial lines are open to Unix alone; use a gateway over TCP"))
}

/// End of a pseudo terminal.
pub struct PseudoTerminal {
    /// Bytes both ways.
    pub stream: Box<dyn ByteStream>,
    /// Path that the other side opens as a serial device.
    pub path: String,
}

impl std::fmt::Debug for PseudoTerminal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PseudoTerminal").field("path", &self.path).finish_non_exhaustive()
    }
}

/// Opens a pseudo terminal.
///
/// # Errors
/// Errors of the operating system.
#[cfg(unix)]
pub fn open_pseudo_terminal() -> io::Result<PseudoTerminal> {
    let (stream, path) = unix::SerialLine::pseudo_terminal()?;
    Ok(PseudoTerminal { stream: Box::new(stream), path })
}

/// Opens a pseudo terminal.
///
/// # Errors
/// [`io::ErrorKind::Unsupported`].
#[cfg(not(unix))]
pub fn open_pseudo_terminal() -> io::Result<PseudoTerminal> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "pseudo terminals are there on Unix alone"))
}
