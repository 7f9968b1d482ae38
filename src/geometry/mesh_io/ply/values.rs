//! The body of a PLY file as a stream of numbers. Every number type of PLY fits an `f64` exactly.

use super::header::{BodyEncoding, Header, PropertyKind, Scalar};
use crate::geometry::mesh_io::error::{MeshError, Position};
use crate::geometry::mesh_io::text::{Lines, Tokens, number};
use crate::geometry::poll::Poll;

/// Source of the numbers, by encoding.
#[derive(Clone)]
pub(super) enum Values<'a> {
    /// Text, one record per line.
    Text { lines: Lines<'a>, tokens: Tokens<'a> },
    /// Binary, records back to back.
    Binary { bytes: &'a [u8], at: usize, big_endian: bool, poll: &'a Poll<'a> },
}

impl<'a> Values<'a> {
    pub(super) fn new(bytes: &'a [u8], header: &Header, poll: &'a Poll<'a>) -> Self {
        let binary = |big_endian: bool| Self::Binary { bytes, at: header.body_at, big_endian, poll };
        match header.encoding {
            BodyEncoding::Ascii => {
                let lines = Lines::new(&bytes[header.body_at..], header.body_line, poll);
                Self::Text { lines, tokens: Tokens::of(&[], poll) }
            }
            BodyEncoding::LittleEndian => binary(false),
            BodyEncoding::BigEndian => binary(true),
        }
    }

    /// Position of the line read last (text) or of the next number (binary).
    pub(super) fn at(&self) -> Position {
        match self {
            Self::Text { lines, .. } => lines.at(),
            Self::Binary { at, .. } => Position::Byte(*at as u64),
        }
    }

    /// Advances to the next line that is not blank; numbers left on the last one are not declared and are skipped.
    pub(super) fn begin_record(&mut self, what: &'static str) -> Result<(), MeshError> {
        if let Self::Text { lines, tokens } = self {
            let record = lines.by_ref().find(|line| line.tokens().next().is_some());
            *tokens = record.ok_or(MeshError::Truncated { at: lines.at(), expected: what })?.tokens();
        }
        Ok(())
    }

    /// Reads the next number.
    pub(super) fn next(&mut self, scalar: Scalar) -> Result<f64, MeshError> {
        match self {
            Self::Text { lines, tokens } => number(next_token(lines, tokens)?, lines.at()),
            Self::Binary { bytes, at, big_endian, poll } => {
                poll.spend(5)?;
                let value = decode(bytes, *at, scalar, *big_endian);
                let value = value.ok_or(MeshError::Truncated { at: Position::Byte(*at as u64), expected: "a number" })?;
                *at += scalar.size_bytes();
                Ok(value)
            }
        }
    }

    /// Reads the length of a list.
    pub(super) fn next_count(&mut self, scalar: Scalar) -> Result<u64, MeshError> {
        let at = self.at();
        let value = self.next(scalar)?;
        if value >= 0.0 && value.fract() == 0.0 {
            return Ok(value as u64);
        }
        Err(MeshError::Syntax { at, expected: "the length of a list", found: value.to_string() })
    }

    /// Skips `count` numbers.
    pub(super) fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), MeshError> {
        match self {
            Self::Text { lines, tokens } => (0..count).try_for_each(|_| next_token(lines, tokens).map(drop)),
            Self::Binary { bytes, at, poll, .. } => {
                poll.spend(5)?;
                let left = (bytes.len() - *at) as u64;
                let size = count.saturating_mul(scalar.size_bytes() as u64);
                if size > left {
                    return Err(MeshError::Truncated { at: Position::Byte(*at as u64), expected: "a list of numbers" });
                }
                *at += size as usize;
                Ok(())
            }
        }
    }

    /// Skips a number or a list.
    pub(super) fn skip_property(&mut self, kind: PropertyKind) -> Result<(), MeshError> {
        match kind {
            PropertyKind::Scalar(scalar) => self.skip(scalar, 1),
            PropertyKind::List { count, item } => {
                let length = self.next_count(count)?;
                self.skip(item, length)
            }
        }
    }

    /// Refuses data after the last declared record. White space, and in binary files anything too short for a face, counts as
    /// padding.
    pub(super) fn finish(self, poll: &Poll<'_>) -> Result<(), MeshError> {
        const MIN_FACE_BYTES: usize = 4;
        let (rest, padding) = match &self {
            Self::Text { lines, .. } => (lines.rest(), 0),
            Self::Binary { bytes, at, .. } => (&bytes[*at..], MIN_FACE_BYTES - 1),
        };
        if rest.len() <= padding || poll.position(rest, |byte| !byte.is_ascii_whitespace()).is_none() {
            return Ok(());
        }
        Err(MeshError::TrailingData { at: self.at(), bytes: rest.len() as u64 })
    }
}

fn next_token<'a>(lines: &Lines<'a>, tokens: &mut Tokens<'a>) -> Result<&'a [u8], MeshError> {
    tokens.next().ok_or_else(|| MeshError::Syntax {
        at: lines.at(),
        expected: "another number of the record",
        found: "the end of the line".into(),
    })
}

/// The number of this type at a byte.
pub(in crate::geometry) fn decode(bytes: &[u8], at: usize, scalar: Scalar, big_endian: bool) -> Option<f64> {
    macro_rules! read {
        ($type:ty) => {{
            let raw = *bytes.get(at..)?.first_chunk()?;
            let value = if big_endian { <$type>::from_be_bytes(raw) } else { <$type>::from_le_bytes(raw) };
            f64::from(value)
        }};
    }
    Some(match scalar {
        Scalar::I8 => read!(i8),
        Scalar::U8 => read!(u8),
        Scalar::I16 => read!(i16),
        Scalar::U16 => read!(u16),
        Scalar::I32 => read!(i32),
        Scalar::U32 => read!(u32),
        Scalar::F32 => read!(f32),
        Scalar::F64 => read!(f64),
    })
}
