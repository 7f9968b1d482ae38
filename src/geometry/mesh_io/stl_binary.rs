//! Binary STL: an arbitrary header of 80 bytes, a count, and 50 bytes per triangle (normal, three corners, attribute), little
//! endian. Normals and attributes are ignored: the order of the corners defines the outer side. A file of many triangles is
//! read in chunks, so that it is never held in memory together with the mesh.

use std::io::Read;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::error::{MeshError, Position, ReadError};
use super::facets::Facets;
use super::soup::Soup;
use crate::geometry::Mesh;
use crate::geometry::poll::Poll;
use crate::geometry::side_by_side::pieces_of_a_round;

const COUNT_AT: usize = 80;
/// Bytes before the first record.
pub(super) const HEAD_BYTES: usize = 84;
const RECORD_BYTES: usize = 50;
const CORNERS_AT: usize = 12;
const HEADER: &[u8] = b"binary STL by vantage, millimetres";
/// Size of a piece of records against one of text, which takes longer to parse.
const PIECE_PER_PIECE_BYTES: usize = 2;

/// Returns true if a file of `length_bytes` has exactly the triangles that its `head` declares.
pub(super) fn length_fits(head: &[u8], length_bytes: u64) -> bool {
    declared(head).is_some_and(|count| needed_bytes(count) == length_bytes)
}

/// Reads every triangle.
pub(super) fn read(bytes: &[u8], soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let Some((head, mut records)) = bytes.split_first_chunk::<HEAD_BYTES>() else {
        return Err(MeshError::Truncated { at: Position::Byte(bytes.len() as u64), expected: "the header of a binary STL" });
    };
    check_length(bytes, count(head))?;
    read_records(head, &mut records, soup).map_err(|error| match error {
        ReadError::Mesh(error) => error,
        ReadError::Io(error) => unreachable!("memory can be read: {error}"),
    })
}

/// Reads every triangle that follows `head` in `source`: the next ones while those that are there are parsed, side by side.
pub(super) fn read_records(head: &[u8; HEAD_BYTES], source: &mut dyn Read, soup: &mut Soup<'_>) -> Result<(), ReadError> {
    let mut coming = Records { source, at: HEAD_BYTES as u64, left: count(head) as usize };
    soup.expect_triangles(coming.left);
    let at_once = (PIECE_PER_PIECE_BYTES * soup.settings.piece_bytes / RECORD_BYTES).max(1);
    let records_of_a_round = at_once * pieces_of_a_round();
    let unit_mm = soup.settings.unit_mm();
    let (mut first, mut bytes) = (coming.at, Vec::new());
    coming.read(records_of_a_round, &mut bytes)?;
    let mut next_bytes = Vec::new();
    while !bytes.is_empty() {
        soup.poll.check().map_err(MeshError::from)?;
        let (records, _) = bytes.as_chunks();
        let (next_first, mut parsed) = (coming.at, Vec::new());
        let read = if coming.left == 0 {
            parsed = parse(records, first, at_once, unit_mm);
            next_bytes.clear();
            Ok(())
        } else {
            rayon::in_place_scope(|scope| {
                scope.spawn(|_| parsed = parse(records, first, at_once, unit_mm));
                coming.read(records_of_a_round, &mut next_bytes)
            })
        };
        for (facets, end) in parsed {
            facets.into_soup(soup)?;
            end?;
        }
        read?;
        std::mem::swap(&mut bytes, &mut next_bytes);
        first = next_first;
    }
    Ok(())
}

/// Records that are still to be read.
struct Records<'a> {
    source: &'a mut dyn Read,
    /// Byte at which the next one begins.
    at: u64,
    left: usize,
}

impl Records<'_> {
    /// Reads so many into `bytes`, or those that are left.
    fn read(&mut self, count: usize, bytes: &mut Vec<u8>) -> Result<(), ReadError> {
        let count = count.min(self.left);
        let length = count * RECORD_BYTES;
        bytes.clear();
        bytes.reserve_exact(length);
        let read = Read::take(&mut *self.source, length as u64).read_to_end(bytes)?;
        if read < length {
            return Err(MeshError::Truncated { at: Position::Byte(self.at + read as u64), expected: "a triangle" }.into());
        }
        (self.at, self.left) = (self.at + length as u64, self.left - count);
        Ok(())
    }
}

/// Parses records, the first of which begins at byte `first`, so many in a piece; each piece up to its first fault.
fn parse(records: &[[u8; RECORD_BYTES]], first: u64, at_once: usize, unit_mm: f64) -> Vec<(Facets, Result<(), MeshError>)> {
    let piece = |(piece, records): (usize, &[[u8; RECORD_BYTES]])| {
        let mut facets = Facets::new(unit_mm, records.len());
        let end = parse_piece(records, first + (piece * at_once * RECORD_BYTES) as u64, &mut facets);
        (facets, end)
    };
    if records.len() <= at_once {
        return vec![piece((0, records))];
    }
    records.par_chunks(at_once).enumerate().map(piece).collect()
}

fn parse_piece(records: &[[u8; RECORD_BYTES]], first: u64, facets: &mut Facets) -> Result<(), MeshError> {
    let poll = Poll::never();
    for (record, at) in records.iter().zip((first..).step_by(RECORD_BYTES)) {
        let mut corners = [0; 3];
        for (corner, k) in corners.iter_mut().zip(0..) {
            let offset = CORNERS_AT + 12 * k;
            let xyz = [0, 4, 8].map(|axis| f64::from(float(record, offset + axis)));
            *corner = facets.corner(xyz, Position::Byte(at + offset as u64), &poll)?;
        }
        facets.triangle(corners, Position::Byte(at));
    }
    Ok(())
}

/// Writes `mesh` as binary STL in millimetres. Coordinates are rounded to 32 bits, as the format requires; groups and source
/// faces are lost. The format holds up to 2³² − 1 triangles; any beyond that are dropped.
#[must_use]
pub fn write_stl(mesh: &Mesh) -> Vec<u8> {
    let count = u32::try_from(mesh.faces.len()).unwrap_or(u32::MAX);
    let mut bytes = Vec::with_capacity(HEAD_BYTES + RECORD_BYTES * count as usize);
    bytes.extend_from_slice(HEADER);
    bytes.resize(COUNT_AT, 0);
    bytes.extend_from_slice(&count.to_le_bytes());
    for face in 0..count as usize {
        let normal = mesh.scaled_normal(face).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let corners = mesh.corners(face);
        let rows = std::iter::once(normal).chain(corners.iter().map(|corner| corner.coords));
        bytes.extend(rows.flat_map(|row| [row.x, row.y, row.z]).flat_map(|value| (value as f32).to_le_bytes()));
        bytes.extend_from_slice(&[0, 0]);
    }
    bytes
}

/// Number of triangles that a head declares.
fn count(head: &[u8; HEAD_BYTES]) -> u32 {
    u32::from_le_bytes([head[COUNT_AT], head[COUNT_AT + 1], head[COUNT_AT + 2], head[COUNT_AT + 3]])
}

fn declared(bytes: &[u8]) -> Option<u32> {
    bytes.get(COUNT_AT..)?.first_chunk().copied().map(u32::from_le_bytes)
}

fn needed_bytes(count: u32) -> u64 {
    HEAD_BYTES as u64 + u64::from(count) * RECORD_BYTES as u64
}

/// Checks the declared count before anything is read or allocated. A surplus shorter than a record is padding.
fn check_length(bytes: &[u8], count: u32) -> Result<(), MeshError> {
    let (needed, present) = (needed_bytes(count), bytes.len() as u64);
    let payload = |length: u64| length.saturating_sub(HEAD_BYTES as u64);
    if present < needed {
        return Err(MeshError::CountMismatch {
            at: Position::Byte(COUNT_AT as u64),
            declared: u64::from(count),
            what: "triangles of a binary STL".into(),
            needed_bytes: payload(needed),
            present_bytes: payload(present),
        });
    }
    if present - needed >= RECORD_BYTES as u64 {
        return Err(MeshError::TrailingData { at: Position::Byte(needed), bytes: present - needed });
    }
    Ok(())
}

fn float(record: &[u8; RECORD_BYTES], at: usize) -> f32 {
    f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
}
