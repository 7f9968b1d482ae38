//! The body of a PLY file as a stream of records, of which only a window is in memory.

use super::pcd::single;
use super::stream::CloudStream;
use super::{CloudError, Collected};
use crate::geometry::mesh_io::ply::header::{BodyEncoding, Element, Header, Property, PropertyKind, Scalar};
use crate::geometry::mesh_io::ply::values::decode;
use crate::geometry::mesh_io::text::{Lines, excerpt, number};
use crate::geometry::mesh_io::{MeshError, Position};

/// Longest list of a record.
const MAX_LIST: u64 = 1_000_000;
/// Longest line of a text body.
const MAX_LINE_BYTES: usize = 1 << 24;

/// Records of a body, from the first on.
pub(super) struct PlyBody<'s, 'a> {
    stream: &'s mut CloudStream<'a>,
    encoding: BodyEncoding,
    /// Line of a text body that was read last, and its numbers that are left, last first.
    line: u64,
    numbers: Vec<f64>,
}

impl<'s, 'a> PlyBody<'s, 'a> {
    pub(super) fn new(stream: &'s mut CloudStream<'a>, header: &Header) -> Self {
        Self { stream, encoding: header.encoding, line: header.body_line - 1, numbers: Vec::new() }
    }

    pub(super) fn at(&self) -> Position {
        if self.encoding == BodyEncoding::Ascii { Position::Line(self.line) } else { self.stream.at() }
    }

    /// Reads the points of all records of an element, whose coordinates are these properties.
    pub(super) fn points(&mut self, element: &Element, axes: [usize; 3], into: &mut Collected) -> Result<(), CloudError> {
        if let Some((size, places)) = fixed_layout(element, axes).filter(|_| self.encoding != BodyEncoding::Ascii) {
            return self.fixed_points(element.count, size, places, into);
        }
        for _ in 0..element.count {
            self.begin_record("a vertex")?;
            let mut point = [f32::NAN; 3];
            for (place, property) in element.properties.iter().enumerate() {
                match (axes.iter().position(|axis| *axis == place), property.kind) {
                    (Some(axis), PropertyKind::Scalar(scalar)) => point[axis] = self.next(scalar)? as f32,
                    (_, kind) => self.skip_property(kind)?,
                }
            }
            into.push(point)?;
        }
        Ok(())
    }

    /// Records of one size.
    fn fixed_points(
        &mut self,
        count: u64,
        size: usize,
        places: [(usize, Scalar); 3],
        into: &mut Collected,
    ) -> Result<(), CloudError> {
        let big_endian = self.encoding == BodyEncoding::BigEndian;
        let mut left = count;
        while left > 0 {
            let at_hand = self.stream.fill(size)?.len() / size;
            if at_hand == 0 {
                self.stream.need(size, "a vertex")?;
            }
            let now = at_hand.min(usize::try_from(left).unwrap_or(usize::MAX));
            for record in self.stream.window()[..now * size].chunks_exact(size) {
                let value = |(byte, scalar): (usize, Scalar)| match big_endian {
                    false => single(record, byte, scalar),
                    true => decode(record, byte, scalar, true).map_or(f32::NAN, |value| value as f32),
                };
                into.push(places.map(value))?;
            }
            self.stream.consume(now * size);
            left -= now as u64;
        }
        Ok(())
    }

    /// Reads the list of the next record: numbers of vertices, of which there are so many.
    pub(super) fn list(
        &mut self,
        element: &Element,
        list: &Property,
        vertices: usize,
        into: &mut Vec<u32>,
    ) -> Result<(), CloudError> {
        self.begin_record("a face")?;
        for property in &element.properties {
            match property.kind {
                PropertyKind::List { count, item } if std::ptr::eq(property, list) => {
                    let length = self.next_count(count)?;
                    into.clear();
                    for _ in 0..length {
                        let at = self.at();
                        let index = self.next(item)?;
                        if index < 0.0 || index.fract() != 0.0 || index >= vertices as f64 {
                            return Err(
                                MeshError::BadIndex { at, index: index as i64, vertices, hint: " (counted from 0)" }.into()
                            );
                        }
                        into.push(index as u32);
                    }
                }
                kind @ (PropertyKind::List { .. } | PropertyKind::Scalar(_)) => self.skip_property(kind)?,
            }
        }
        Ok(())
    }

    /// Passes over all records of an element.
    pub(super) fn skip(&mut self, element: &Element) -> Result<(), CloudError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        for _ in 0..element.count {
            self.begin_record("a record")?;
            element.properties.iter().try_for_each(|property| self.skip_property(property.kind))?;
        }
        Ok(())
    }

    fn skip_property(&mut self, kind: PropertyKind) -> Result<(), CloudError> {
        match kind {
            PropertyKind::Scalar(scalar) => self.next(scalar).map(drop),
            PropertyKind::List { count, item } => {
                let length = self.next_count(count)?;
                (0..length).try_for_each(|_| self.next(item).map(drop))
            }
        }
    }

    fn next_count(&mut self, scalar: Scalar) -> Result<u64, CloudError> {
        let at = self.at();
        let value = self.next(scalar)?;
        if (0.0..=MAX_LIST as f64).contains(&value) && value.fract() == 0.0 {
            return Ok(value as u64);
        }
        Err(MeshError::Syntax { at, expected: "the length of a list, at most 1000000", found: value.to_string() }.into())
    }

    /// Reads the next line of a text body that is not blank.
    fn begin_record(&mut self, expected: &'static str) -> Result<(), CloudError> {
        if self.encoding != BodyEncoding::Ascii {
            return Ok(());
        }
        loop {
            let mut bytes = 256;
            let length = loop {
                let window = self.stream.fill(bytes)?;
                let (length, is_all) = (window.len(), window.len() < bytes);
                // The byte behind a CR is looked at.
                match window.iter().position(|byte| *byte == b'\n' || *byte == b'\r') {
                    Some(end) if end + 1 < length || is_all => {
                        break end + if window[end..].starts_with(b"\r\n") { 2 } else { 1 };
                    }
                    _ if is_all => break length,
                    _ if bytes > MAX_LINE_BYTES => {
                        let found = format!("{bytes} bytes");
                        return Err(
                            MeshError::Syntax { at: Position::Line(self.line + 1), expected: "a shorter line", found }.into()
                        );
                    }
                    _ => bytes *= 2,
                }
            };
            if length == 0 {
                return Err(MeshError::Truncated { at: Position::Line(self.line), expected }.into());
            }
            self.line += 1;
            self.take_line(length)?;
            if !self.numbers.is_empty() {
                return Ok(());
            }
        }
    }

    fn take_line(&mut self, length: usize) -> Result<(), CloudError> {
        let Some(line) = Lines::new(&self.stream.window()[..length], self.line, self.stream.poll).next() else {
            return Err(MeshError::Interrupted.into());
        };
        self.numbers.clear();
        for word in line.tokens() {
            self.numbers.push(number(word, line.at())?);
        }
        self.numbers.reverse();
        self.stream.consume(length);
        Ok(())
    }

    fn next(&mut self, scalar: Scalar) -> Result<f64, CloudError> {
        if self.encoding == BodyEncoding::Ascii {
            let at = Position::Line(self.line);
            let missing =
                || MeshError::Syntax { at, expected: "another number of the record", found: excerpt(b"the end of the line") };
            return Ok(self.numbers.pop().ok_or_else(missing)?);
        }
        let size = scalar.size_bytes();
        let bytes = self.stream.need(size, "a number")?;
        let value = decode(bytes, 0, scalar, self.encoding == BodyEncoding::BigEndian).unwrap_or(f64::NAN);
        self.stream.consume(size);
        Ok(value)
    }
}

/// Size of a record and places of three of its numbers, where all records have the same size.
fn fixed_layout(element: &Element, axes: [usize; 3]) -> Option<(usize, [(usize, Scalar); 3])> {
    let mut places = [(0, Scalar::F32); 3];
    let mut size = 0;
    for (place, property) in element.properties.iter().enumerate() {
        let PropertyKind::Scalar(scalar) = property.kind else { return None };
        if let Some(axis) = axes.iter().position(|axis| *axis == place) {
            places[axis] = (size, scalar);
        }
        size += scalar.size_bytes();
    }
    Some((size, places))
}
