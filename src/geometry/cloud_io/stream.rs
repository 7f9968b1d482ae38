//! A file that is read a few megabytes at a time.

use std::io::Read;

use super::CloudError;
use crate::geometry::mesh_io::{MeshError, Position};
use crate::geometry::poll::Poll;

/// Bytes that are read at a time.
pub(super) const CHUNK_BYTES: usize = 1 << 20;
/// Longest line of text.
const MAX_LINE_BYTES: usize = 1 << 16;

/// Bytes of a file, with a window of it in memory.
pub(super) struct CloudStream<'a> {
    source: &'a mut dyn Read,
    pub(super) length_bytes: u64,
    pub(super) poll: &'a Poll<'a>,
    window: Vec<u8>,
    /// First byte of the window that is not used.
    begin: usize,
    /// Place in the file of the window's first byte.
    window_at: u64,
    is_at_end: bool,
}

impl<'a> CloudStream<'a> {
    pub(super) fn new(source: &'a mut dyn Read, length_bytes: u64, poll: &'a Poll<'a>) -> Self {
        Self { source, length_bytes, poll, window: Vec::new(), begin: 0, window_at: 0, is_at_end: false }
    }

    /// Place in the file of the next byte.
    pub(super) fn byte(&self) -> u64 {
        self.window_at + self.begin as u64
    }

    pub(super) fn at(&self) -> Position {
        Position::Byte(self.byte())
    }

    /// Bytes from here to the end of the file.
    pub(super) fn bytes_left(&self) -> u64 {
        self.length_bytes.saturating_sub(self.byte())
    }

    /// Bytes that are at hand.
    pub(super) fn window(&self) -> &[u8] {
        &self.window[self.begin..]
    }

    /// Passes over bytes that are at hand.
    pub(super) fn consume(&mut self, bytes: usize) {
        self.begin += bytes;
    }

    /// Reads on; false at the end of the file.
    fn read_on(&mut self) -> Result<bool, CloudError> {
        if self.is_at_end {
            return Ok(false);
        }
        self.poll.check()?;
        self.window.drain(..self.begin);
        self.window_at += self.begin as u64;
        self.begin = 0;
        let read = Read::take(&mut *self.source, CHUNK_BYTES as u64).read_to_end(&mut self.window)?;
        self.is_at_end = read == 0;
        Ok(read > 0)
    }

    /// Bytes at hand, so many at least; all that are left where there are fewer.
    pub(super) fn fill(&mut self, bytes: usize) -> Result<&[u8], CloudError> {
        while self.window.len() - self.begin < bytes && self.read_on()? {}
        Ok(self.window())
    }

    /// Exactly so many bytes, at hand.
    pub(super) fn need(&mut self, bytes: usize, expected: &'static str) -> Result<&[u8], CloudError> {
        if self.window.len() - self.begin < bytes && self.fill(bytes)?.len() < bytes {
            let at = Position::Byte(self.byte() + self.window().len() as u64);
            return Err(MeshError::Truncated { at, expected }.into());
        }
        Ok(&self.window[self.begin..self.begin + bytes])
    }

    /// Length of the whole lines at hand, at least one; 0 at the end of the file.
    pub(super) fn fill_lines(&mut self) -> Result<usize, CloudError> {
        self.fill(CHUNK_BYTES)?;
        loop {
            let window = self.window();
            // A CR that is the last byte at hand may be half of a CRLF.
            let end = window.iter().rposition(|byte| *byte == b'\n' || *byte == b'\r').map(|end| end + 1);
            let is_whole = |end: usize| window[end - 1] == b'\n' || end < window.len();
            if self.is_at_end {
                return Ok(window.len());
            }
            if let Some(end) = end.filter(|end| is_whole(*end)) {
                return Ok(end);
            }
            if window.len() > CHUNK_BYTES + MAX_LINE_BYTES {
                let found = format!("{} bytes", window.len());
                return Err(MeshError::Syntax { at: self.at(), expected: "lines of at most 65536 bytes", found }.into());
            }
            self.read_on()?;
        }
    }
}
