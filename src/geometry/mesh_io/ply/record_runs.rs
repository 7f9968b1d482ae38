//! Stretches of the records of an element, to be parsed side by side: of a text some lines, of a binary body some records, found
//! by passing over them.

use std::ops::Range;

use super::ReadRecord;
use super::header::{Element, PropertyKind};
use super::values::Values;
use crate::geometry::mesh_io::error::MeshError;
use crate::geometry::mesh_io::pieces::{Pieces, is_long, next_line};
use crate::geometry::mesh_io::soup::SoupPiece;
use crate::geometry::mesh_io::text::{Lines, Tokens};
use crate::geometry::poll::Poll;
use crate::geometry::side_by_side::pieces_of_a_round;

/// Records that are parsed together.
pub(super) enum RecordRun<'a> {
    /// Lines: all of their records, which may be more than the element has.
    Lines(&'a [u8]),
    /// Records of a binary body.
    Records { bytes: &'a [u8], place: Range<usize>, big_endian: bool, count: u64 },
}

/// Extent of a stretch that was parsed to its end.
pub(super) struct Parsed {
    pub(super) records: u64,
    pub(super) lines: u64,
}

impl RecordRun<'_> {
    /// Parses the stretch into `part`; `None` at the first fault.
    pub(super) fn parse(&self, read: &ReadRecord<'_>, part: &mut SoupPiece, poll: &Poll<'_>) -> Option<Parsed> {
        match self {
            RecordRun::Lines(text) => {
                let mut values = Values::Text { lines: Lines::new(text, 1, poll), tokens: Tokens::of(&[], poll) };
                let mut records = 0;
                loop {
                    match read(&mut values, part) {
                        Ok(()) => records += 1,
                        // A record of text is a line, so that only the end of all lines can cut one off.
                        Err(MeshError::Truncated { .. }) => return Some(Parsed { records, lines: values.lines_read() }),
                        Err(_) => return None,
                    }
                }
            }
            RecordRun::Records { bytes, place, big_endian, count } => {
                let mut values = Values::Binary { bytes, at: place.start, big_endian: *big_endian, poll };
                (0..*count).try_for_each(|_| read(&mut values, part)).ok()?;
                Some(Parsed { records: *count, lines: 0 })
            }
        }
    }
}

impl<'a> Values<'a> {
    fn lines_read(&self) -> u64 {
        if let Self::Text { lines, .. } = self { lines.number() } else { 0 }
    }

    /// The next stretches of the element's records, of which so many are `left`; none where they cannot be told apart.
    pub(super) fn next_stretches(&self, element: &Element, left: u64, piece_bytes: usize, poll: &Poll<'_>) -> Vec<RecordRun<'a>> {
        match self {
            Self::Text { lines, .. } => {
                let text = lines.rest();
                let round = Pieces::new(text, piece_bytes, next_line, poll).next_round();
                round.into_iter().map(|piece| RecordRun::Lines(&text[piece])).collect()
            }
            Self::Binary { bytes, big_endian, .. } => {
                let (bytes, big_endian) = (*bytes, *big_endian);
                let stretch = |(place, count)| RecordRun::Records { bytes, place, big_endian, count };
                self.clone().next_records(element, left, piece_bytes).into_iter().map(stretch).collect()
            }
        }
    }

    /// Places of the next records of a binary body, each of some, with their number.
    fn next_records(mut self, element: &Element, mut left: u64, piece_bytes: usize) -> Vec<(Range<usize>, u64)> {
        let size = element.record_bytes();
        let mut found = Vec::new();
        while left > 0 && found.len() < pieces_of_a_round() {
            let (begin, mut count) = (self.byte(), 0);
            let passed = match size {
                Some(size) => {
                    count = left.min((piece_bytes as u64).div_ceil(size));
                    self.skip_bytes(count * size)
                }
                None => loop {
                    if self.pass_record(element).is_err() {
                        break false;
                    }
                    count += 1;
                    if count == left || self.byte() - begin >= piece_bytes {
                        break true;
                    }
                },
            };
            let length = self.byte() - begin;
            if !passed || is_long(length, piece_bytes) && !found.is_empty() {
                break;
            }
            left -= count;
            found.push((begin..begin + length, count));
            if is_long(length, piece_bytes) {
                break;
            }
        }
        found
    }

    /// Byte of a binary body that is read next.
    fn byte(&self) -> usize {
        if let Self::Binary { at, .. } = self { *at } else { 0 }
    }

    /// Passes over so many bytes, if there are as many.
    fn skip_bytes(&mut self, count: u64) -> bool {
        match self {
            Self::Binary { bytes, at, .. } if count <= (bytes.len() - *at) as u64 => {
                *at += count as usize;
                true
            }
            Self::Binary { .. } | Self::Text { .. } => false,
        }
    }

    fn pass_record(&mut self, element: &Element) -> Result<(), MeshError> {
        element.properties.iter().try_for_each(|property| self.skip_property(property.kind))
    }

    /// Goes on behind a stretch that began here.
    pub(super) fn pass(&mut self, stretch: &RecordRun<'_>, lines_of_it: u64) {
        match (self, stretch) {
            (Self::Text { lines, tokens }, RecordRun::Lines(text)) => {
                lines.pass(text.len(), lines_of_it);
                tokens.skip_all();
            }
            (Self::Binary { at, .. }, RecordRun::Records { place, .. }) => *at = place.end,
            (Self::Text { .. }, RecordRun::Records { .. }) | (Self::Binary { .. }, RecordRun::Lines(_)) => {}
        }
    }
}

impl Element {
    /// Size of each record of a binary body, if all have the same and any.
    fn record_bytes(&self) -> Option<u64> {
        let size = |kind| if let PropertyKind::Scalar(scalar) = kind { Some(scalar.size_bytes() as u64) } else { None };
        self.properties.iter().map(|property| size(property.kind)).sum::<Option<u64>>().filter(|size| *size > 0)
    }
}
