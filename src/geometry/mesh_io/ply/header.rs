//! The header of a PLY file: text with any of the three line ends, whatever the encoding of the body.

use crate::geometry::mesh_io::error::{MeshError, Position};
use crate::geometry::mesh_io::text::{Line, Lines, excerpt, parse_token};
use crate::geometry::poll::Poll;

/// Max elements and properties of a header together; real files have a few dozen.
const MAX_DECLARED: usize = 10_000;
/// Max comments that are kept for the number that they name.
const MAX_NOTES: usize = 100;

/// Encoding of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::geometry) enum BodyEncoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::geometry) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// A number, or a list preceded by its length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::geometry) enum PropertyKind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Debug)]
pub(in crate::geometry) struct Property {
    pub(in crate::geometry) name: Vec<u8>,
    pub(in crate::geometry) kind: PropertyKind,
}

/// A kind of record, with the number of its records.
#[derive(Debug)]
pub(in crate::geometry) struct Element {
    pub(in crate::geometry) name: Vec<u8>,
    pub(in crate::geometry) count: u64,
    pub(in crate::geometry) properties: Vec<Property>,
    pub(in crate::geometry) at: Position,
}

#[derive(Debug)]
pub(in crate::geometry) struct Header {
    pub(in crate::geometry) encoding: BodyEncoding,
    pub(in crate::geometry) elements: Vec<Element>,
    /// Byte at which the body begins.
    pub(in crate::geometry) body_at: usize,
    /// Line at which the body begins.
    pub(in crate::geometry) body_line: u64,
    /// Whole numbers that comments name, such as `obj_info num_cols 512`.
    pub(in crate::geometry) notes: Vec<(Vec<u8>, u64)>,
}

impl Scalar {
    fn named(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    pub(in crate::geometry) fn size_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

impl Element {
    pub(in crate::geometry) fn property_names(&self) -> String {
        excerpt(&self.properties.iter().map(|p| p.name.as_slice()).collect::<Vec<_>>().join(&b' '))
    }

    /// Min bytes of a record: a binary list may be empty, a number in text takes a digit and a separator.
    fn min_record_bytes(&self, encoding: BodyEncoding) -> u64 {
        let min_bytes = |kind| match (encoding, kind) {
            (BodyEncoding::Ascii, _) => 2,
            (_, PropertyKind::Scalar(scalar) | PropertyKind::List { count: scalar, .. }) => scalar.size_bytes() as u64,
        };
        self.properties.iter().map(|p| min_bytes(p.kind)).sum()
    }
}

impl Header {
    pub(in crate::geometry) fn parse(bytes: &[u8], poll: &Poll<'_>) -> Result<Self, MeshError> {
        let mut lines = Lines::new(bytes, 1, poll);
        let (mut encoding, mut declared) = (None, 0);
        let (mut elements, mut notes): (Vec<Element>, _) = (Vec::new(), Vec::new());
        expect_line(&mut lines, b"ply", "\"ply\"")?;
        loop {
            let Some(line) = lines.next() else {
                return Err(MeshError::Truncated { at: lines.at(), expected: "\"end_header\"" });
            };
            // Only comments have more words.
            let words: Vec<&[u8]> = line.tokens().take(6).collect();
            declared += usize::from(matches!(words[..], [b"element" | b"property", ..]));
            if declared > MAX_DECLARED {
                return Err(MeshError::TooLarge { at: line.at(), what: "elements and properties", limit: MAX_DECLARED });
            }
            match words[..] {
                [b"format", name, b"1.0"] if encoding.is_none() => encoding = Some(parse_encoding(name, line)?),
                [b"comment" | b"obj_info", name, value] if notes.len() < MAX_NOTES => {
                    notes.extend(parse_token(value).map(|value| (name.to_vec(), value)));
                }
                [b"comment" | b"obj_info", ..] | [] => {}
                [b"element", name, count] => elements.push(parse_element(name, count, line)?),
                [b"property", ref rest @ ..] => match elements.last_mut() {
                    Some(element) => element.properties.push(parse_property(rest, line)?),
                    None => return Err(syntax(line, "an element before its properties")),
                },
                [b"end_header"] => break,
                _ => return Err(syntax(line, "a line of a PLY 1.0 header")),
            }
        }
        let encoding =
            encoding.ok_or(MeshError::Syntax { at: lines.at(), expected: "a format line", found: "\"end_header\"".into() })?;
        let body_at = end_of_header(bytes, bytes.len() - lines.rest().len());
        Ok(Self { encoding, elements, body_at, body_line: lines.number() + 1, notes })
    }

    /// Refuses counts that the file is too short for, before anything is allocated for them.
    pub(in crate::geometry) fn check_counts(&self, file_bytes: usize) -> Result<(), MeshError> {
        // The last line of a text body may lack its terminator.
        let present = (file_bytes - self.body_at) as u64 + u64::from(self.encoding == BodyEncoding::Ascii);
        let mut needed = 0_u64;
        for element in &self.elements {
            needed = needed.saturating_add(element.count.saturating_mul(element.min_record_bytes(self.encoding)));
            if needed > present {
                return Err(MeshError::CountMismatch {
                    at: element.at,
                    declared: element.count,
                    what: format!("records of {}", excerpt(&element.name)),
                    needed_bytes: needed,
                    present_bytes: present,
                });
            }
        }
        Ok(())
    }
}

/// Start of the body. A header whose lines end in a bare CR ends at one CR; an LF after it is the first byte of the body.
fn end_of_header(bytes: &[u8], after_last_line: usize) -> usize {
    let first_end = bytes.iter().position(|&b| b == b'\r' || b == b'\n').unwrap_or_default();
    let bare_cr = bytes[first_end..].starts_with(b"\r") && !bytes[first_end..].starts_with(b"\r\n");
    if bare_cr && bytes[..after_last_line].ends_with(b"\r\n") { after_last_line - 1 } else { after_last_line }
}

fn expect_line(lines: &mut Lines<'_>, keyword: &[u8], expected: &'static str) -> Result<(), MeshError> {
    match lines.next() {
        Some(line) if line.text.trim_ascii() == keyword => Ok(()),
        Some(line) => Err(syntax(line, expected)),
        None => Err(MeshError::Truncated { at: lines.at(), expected }),
    }
}

fn parse_encoding(name: &[u8], line: Line<'_>) -> Result<BodyEncoding, MeshError> {
    match name {
        b"ascii" => Ok(BodyEncoding::Ascii),
        b"binary_little_endian" => Ok(BodyEncoding::LittleEndian),
        b"binary_big_endian" => Ok(BodyEncoding::BigEndian),
        _ => Err(syntax(line, "ascii, binary_little_endian or binary_big_endian")),
    }
}

fn parse_element(name: &[u8], count: &[u8], line: Line<'_>) -> Result<Element, MeshError> {
    let count = parse_token(count).ok_or_else(|| syntax(line, "a number of records"))?;
    Ok(Element { name: name.to_vec(), count, properties: Vec::new(), at: line.at() })
}

fn parse_property(words: &[&[u8]], line: Line<'_>) -> Result<Property, MeshError> {
    let scalar = |name| Scalar::named(name).ok_or_else(|| syntax(line, "a PLY number type"));
    match *words {
        [b"list", count, item, name] => {
            let count = scalar(count)?;
            if matches!(count, Scalar::F32 | Scalar::F64) {
                return Err(syntax(line, "an integer type for the length of a list"));
            }
            Ok(Property { name: name.to_vec(), kind: PropertyKind::List { count, item: scalar(item)? } })
        }
        [kind, name] => Ok(Property { name: name.to_vec(), kind: PropertyKind::Scalar(scalar(kind)?) }),
        _ => Err(syntax(line, "\"property TYPE NAME\" or \"property list TYPE TYPE NAME\"")),
    }
}

fn syntax(line: Line<'_>, expected: &'static str) -> MeshError {
    MeshError::Syntax { at: line.at(), expected, found: excerpt(line.text.trim_ascii()) }
}
