//! Text of mesh files as bytes: lines ended by LF, CRLF or CR, tokens separated by white space, numbers. Bytes rather than
//! `str`, because names in real files come in any encoding; only what is parsed must be ASCII. Once the poll says to stop,
//! lines and tokens end; the reader's caller then reports the interruption.

use std::borrow::Cow;
use std::str::FromStr;

use super::error::{MeshError, Position};
use crate::geometry::poll::Poll;

/// Max length of a number; nobody writes longer ones.
const MAX_NUMBER_BYTES: usize = 1000;
/// Max digits of a number that 64 bits hold for certain.
const MAX_PLAIN_DIGITS: usize = 19;
/// Every whole number up to this is an `f64`.
const MAX_EXACT_NUMBER: u64 = 1 << 53;
/// Powers of ten that are `f64`s.
const POWERS_OF_TEN: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21,
    1e22,
];

/// A line without its terminator, and its number, counted from 1.
#[derive(Clone, Copy)]
pub(in crate::geometry) struct Line<'a> {
    pub(in crate::geometry) number: u64,
    pub(in crate::geometry) text: &'a [u8],
    poll: &'a Poll<'a>,
}

impl<'a> Line<'a> {
    pub(in crate::geometry) fn at(self) -> Position {
        Position::Line(self.number)
    }

    pub(in crate::geometry) fn tokens(self) -> Tokens<'a> {
        Tokens::of(self.text, self.poll)
    }
}

/// Iterator over numbered lines.
#[derive(Clone)]
pub(in crate::geometry) struct Lines<'a> {
    rest: &'a [u8],
    number: u64,
    poll: &'a Poll<'a>,
}

impl<'a> Lines<'a> {
    pub(in crate::geometry) fn new(bytes: &'a [u8], first: u64, poll: &'a Poll<'a>) -> Self {
        Self { rest: bytes, number: first - 1, poll }
    }

    /// Position of the line returned last.
    pub(in crate::geometry) fn at(&self) -> Position {
        Position::Line(self.number)
    }

    /// Number of the line returned last; 0 before the first.
    pub(in crate::geometry) fn number(&self) -> u64 {
        self.number
    }

    /// Bytes after the line returned last.
    pub(in crate::geometry) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Passes over so many bytes, which are so many whole lines.
    pub(in crate::geometry) fn pass(&mut self, bytes: usize, lines: u64) {
        (self.rest, self.number) = (&self.rest[bytes..], self.number + lines);
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
pub(in crate::geometry) struct Tokens<'a> {
    rest: &'a [u8],
    poll: &'a Poll<'a>,
}

impl<'a> Tokens<'a> {
    pub(in crate::geometry) fn of(text: &'a [u8], poll: &'a Poll<'a>) -> Self {
        Self { rest: text, poll }
    }

    /// Skips the words that are left.
    pub(in crate::geometry) fn skip_all(&mut self) {
        self.rest = &[];
    }

    /// Bytes after the token returned last, trimmed.
    pub(in crate::geometry) fn rest(&self) -> &'a [u8] {
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
pub(in crate::geometry) fn number(token: &[u8], at: Position) -> Result<f64, MeshError> {
    plain_decimal(token).or_else(|| parse_token(token)).ok_or_else(|| MeshError::Syntax {
        at,
        expected: "a number",
        found: excerpt(token),
    })
}

/// Value of a decimal whose digits make a whole number up to 2⁵³, to be multiplied or divided by a power of ten up to 10²²: both
/// are exact, so that the one rounding is right (W. D. Clinger, "How to read floating point numbers accurately", PLDI 1990).
/// `None` for all others, well formed or not, which the standard library parses.
fn plain_decimal(token: &[u8]) -> Option<f64> {
    let (is_negative, digits) = match token {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    let (whole, rest) = split_digits(digits);
    let (fraction, rest) = rest.strip_prefix(b".").map_or((&[][..], rest), split_digits);
    let count = whole.len() + fraction.len();
    if count == 0 || count > MAX_PLAIN_DIGITS {
        return None;
    }
    let exponent = if rest.is_empty() { 0 } else { exponent(rest)? } - fraction.len() as i32;
    let number = whole.iter().chain(fraction).fold(0, |number, digit| 10 * number + u64::from(digit - b'0'));
    let power = *POWERS_OF_TEN.get(exponent.unsigned_abs() as usize)?;
    if number > MAX_EXACT_NUMBER {
        return None;
    }
    let value = if exponent < 0 { number as f64 / power } else { number as f64 * power };
    Some(if is_negative { -value } else { value })
}

/// Splits off the digits at the begin.
fn split_digits(text: &[u8]) -> (&[u8], &[u8]) {
    text.split_at(text.iter().position(|b| !b.is_ascii_digit()).unwrap_or(text.len()))
}

/// Value of `e`, a sign that may miss, and one or two digits.
fn exponent(text: &[u8]) -> Option<i32> {
    let text = text.strip_prefix(b"e").or_else(|| text.strip_prefix(b"E"))?;
    let (sign, digits) = match text {
        [b'-', digits @ ..] => (-1, digits),
        [b'+', digits @ ..] => (1, digits),
        digits => (1, digits),
    };
    match digits {
        [one @ b'0'..=b'9'] => Some(sign * i32::from(one - b'0')),
        [ten @ b'0'..=b'9', one @ b'0'..=b'9'] => Some(sign * i32::from(10 * (ten - b'0') + (one - b'0'))),
        _ => None,
    }
}

/// Parses a token; `None` if it is malformed or too long.
pub(in crate::geometry) fn parse_token<T: FromStr>(token: &[u8]) -> Option<T> {
    let token = Some(token).filter(|token| token.len() <= MAX_NUMBER_BYTES)?;
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Parses three finite coordinates.
pub(in crate::geometry) fn coordinates<'a>(
    tokens: &mut impl Iterator<Item = &'a [u8]>,
    at: Position,
) -> Result<[f64; 3], MeshError> {
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
pub(in crate::geometry) fn excerpt(bytes: &[u8]) -> String {
    const MAX_BYTES: usize = 40;
    if bytes.is_empty() {
        return "nothing".into();
    }
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_BYTES)]);
    let more = if bytes.len() > MAX_BYTES { "…" } else { "" };
    format!("\"{}{more}\"", text.escape_debug())
}

/// Removes the byte order mark; text in UTF-16 with such a mark is converted to UTF-8.
pub(in crate::geometry) fn without_byte_order_mark<'b>(bytes: &'b [u8], poll: &Poll<'_>) -> Result<Cow<'b, [u8]>, MeshError> {
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn parsed(text: &str) -> Option<u64> {
        number(text.as_bytes(), Position::Line(1)).ok().map(f64::to_bits)
    }

    #[test]
    fn numbers_in_every_style_are_those_of_the_standard_library() {
        let edges = "1.7976931348623157e308 2.2250738585072011e-308 5e-324 9007199254740993 9007199254740992e-3 1e22 1e23 1e-22";
        let styles = "0 -0 +0.0 .5 5. -.5e1 5.e1 123456789.25 0.1 0000000000000000000001 1E+05 -12.5e-07";
        for text in edges.split(' ').chain(styles.split(' ')) {
            assert_eq!(parsed(text), text.parse().ok().map(f64::to_bits), "{text}");
        }
        for text in ["", ".", "-", "+", "e5", ".e5", "1e", "1e+", "1.2.3", "1e5.", "0x1", "1_0", "--1", "1 ", "1,5"] {
            assert_eq!(parsed(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_number_is_rounded_as_by_the_standard_library(text in "[-+]?[0-9]{0,20}(\\.[0-9]{0,20})?([eE][-+]?[0-9]{0,3})?") {
            prop_assert_eq!(parsed(&text), text.parse().ok().map(f64::to_bits), "{}", text);
        }

        #[test]
        fn what_is_printed_is_read_back(bits in any::<u64>(), digits in 0_usize..12) {
            let value = f64::from_bits(bits);
            prop_assume!(value.is_finite());
            for text in [format!("{value}"), format!("{value:e}"), format!("{:.digits$e}", value as f32)] {
                prop_assert_eq!(parsed(&text), text.parse().ok().map(f64::to_bits), "{}", text);
            }
        }
    }
}
