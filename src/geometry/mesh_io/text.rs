//! Text of mesh files as bytes: lines ended by LF, CRLF or CR, tokens separated by white space, numbers. Bytes rather than
//! `str`, because names in real files come in any encoding; only what is parsed must be ASCII. Once the poll says to stop,
//! lines and tokens end; the reader's caller then reports the interruption.

use std::borrow::Cow;
use std::str::FromStr;

use super::error::{MeshError, Position};
use crate::geometry::poll::Poll;

/// Max length of a number; nobody writes longer ones.
const MAX_NUMBER_BYTES: usize = 1000;

/// A line without its terminator, and its number, counted from 1.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    pub(super) number: u64,
    pub(super) text: &'a [u8],
    poll: &'a Poll<'a>,
}

impl<'a> Line<'a> {
    pub(super) fn at(self) -> Position {
        Position::Line(self.number)
    }

    pub(super) fn tokens(self) -> Tokens<'a> {
        Tokens::of(self.text, self.poll)
    }
}

/// Iterator over numbered lines.
#[derive(Clone)]
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: u64,
    poll: &'a Poll<'a>,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8], first: u64, poll: &'a Poll<'a>) -> Self {
        Self { rest: bytes, number: first - 1, poll }
    }

    /// Position of the line returned last.
    pub(super) fn at(&self) -> Position {
        Position::Line(self.number)
    }

    /// Number of the line returned last; 0 before the first.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// Bytes after the line returned last.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() || self.poll.spend(20).is_err() {
            return None;
        }
        let end = self.poll.position(self.rest, |&b| b == b'\n' || b == b'\r').unwrap_or(self.rest.len());
        let (text, tail) = self.rest.split_at(end);
        self.poll.spend(5 * text.len()).ok()?;
        self.rest = tail.strip_prefix(b"\r\n").or_else(|| tail.get(1..)).unwrap_or_default();
        self.number += 1;
        Some(Line { number: self.number, text, poll: self.poll })
    }
}

/// Iterator over words separated by white space.
#[derive(Clone)]
pub(super) struct Tokens<'a> {
    rest: &'a [u8],
    poll: &'a Poll<'a>,
}

impl<'a> Tokens<'a> {
    pub(super) fn of(text: &'a [u8], poll: &'a Poll<'a>) -> Self {
        Self { rest: text, poll }
    }

    /// Bytes after the token returned last, trimmed.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest.trim_ascii()
    }
}

impl<'a> Iterator for Tokens<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.poll.position(self.rest, |byte| !byte.is_ascii_whitespace())?;
        let rest = &self.rest[start..];
        let end = self.poll.position(rest, u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.poll.spend(20 + end).ok()?;
        let (token, rest) = rest.split_at(end);
        self.rest = rest;
        Some(token)
    }
}

/// Parses a decimal number. NaN and infinities are accepted; callers reject them where they matter.
pub(super) fn number(token: &[u8], at: Position) -> Result<f64, MeshError> {
    parse_token(token).ok_or_else(|| MeshError::Syntax { at, expected: "a number", found: excerpt(token) })
}

/// Parses a token; `None` if it is malformed or too long.
pub(super) fn parse_token<T: FromStr>(token: &[u8]) -> Option<T> {
    let token = Some(token).filter(|token| token.len() <= MAX_NUMBER_BYTES)?;
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Parses three finite coordinates.
pub(super) fn coordinates<'a>(tokens: &mut impl Iterator<Item = &'a [u8]>, at: Position) -> Result<[f64; 3], MeshError> {
    let mut xyz = [0.0; 3];
    for value in &mut xyz {
        let token =
            tokens.next().ok_or(MeshError::Syntax { at, expected: "three coordinates", found: "the end of the line".into() })?;
        *value = number(token, at)?;
        if !value.is_finite() {
            return Err(MeshError::NotFinite { at, found: excerpt(token) });
        }
    }
    Ok(xyz)
}

/// A short, printable quotation of file content.
pub(super) fn excerpt(bytes: &[u8]) -> String {
    const MAX_BYTES: usize = 40;
    if bytes.is_empty() {
        return "nothing".into();
    }
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_BYTES)]);
    let more = if bytes.len() > MAX_BYTES { "…" } else { "" };
    format!("\"{}{more}\"", text.escape_debug())
}

/// Removes the byte order mark; text in UTF-16 with such a mark is converted to UTF-8.
pub(super) fn without_byte_order_mark<'b>(bytes: &'b [u8], poll: &Poll<'_>) -> Result<Cow<'b, [u8]>, MeshError> {
    match bytes {
        [0xEF, 0xBB, 0xBF, text @ ..] => Ok(Cow::Borrowed(text)),
        [0xFF, 0xFE, text @ ..] => from_utf16(text, "UTF-16 (little endian)", u16::from_le_bytes, poll).map(Cow::Owned),
        [0xFE, 0xFF, text @ ..] => from_utf16(text, "UTF-16 (big endian)", u16::from_be_bytes, poll).map(Cow::Owned),
        _ => Ok(Cow::Borrowed(bytes)),
    }
}

fn from_utf16(bytes: &[u8], encoding: &'static str, unit: fn([u8; 2]) -> u16, poll: &Poll<'_>) -> Result<Vec<u8>, MeshError> {
    let (pairs, odd) = bytes.as_chunks::<2>();
    let mut text = String::with_capacity(pairs.len());
    let mut at = 2;
    for decoded in char::decode_utf16(pairs.iter().map(|&pair| unit(pair))) {
        poll.spend(4)?;
        let c = decoded.map_err(|_| MeshError::Encoding { at: Position::Byte(at), encoding })?;
        at += 2 * c.len_utf16() as u64;
        text.push(c);
    }
    if odd.is_empty() { Ok(text.into_bytes()) } else { Err(MeshError::Encoding { at: Position::Byte(at), encoding }) }
}
