//! Binary STL: an arbitrary header of 80 bytes, a count, and 50 bytes per triangle (normal, three corners, attribute), little
//! endian. Normals and attributes are ignored: the order of the corners defines the outer side. A file of many triangles is
//! read in chunks, so that it is never held in memory together with the mesh.

use std::io::{ErrorKind, Read};

use nalgebra::Vector3;

use super::error::{MeshError, Position, ReadError};
use super::soup::Soup;
use crate::geometry::Mesh;

const COUNT_AT: usize = 80;
/// Bytes before the first record.
pub(super) const HEAD_BYTES: usize = 84;
const RECORD_BYTES: usize = 50;
const CORNERS_AT: usize = 12;
const HEADER: &[u8] = b"binary STL by vantage, millimetres";
/// Records read at a time.
const RECORDS_AT_ONCE: usize = 1024;

/// Returns true if a file of `length_bytes` has exactly the triangles that its `head` declares.
pub(super) fn length_fits(head: &[u8], length_bytes: u64) -> bool {
    declared(head).is_some_and(|count| needed_bytes(count) == length_bytes)
}

/// Reads every triangle.
pub(super) fn read(bytes: &[u8], soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let count = declared(bytes)
        .ok_or(MeshError::Truncated { at: Position::Byte(bytes.len() as u64), expected: "the header of a binary STL" })?;
    check_length(bytes, count)?;
    let (records, _) = bytes[HEAD_BYTES..].as_chunks();
    add(&records[..count as usize], HEAD_BYTES as u64, soup)
}

/// Reads every triangle that follows `head` in `source`.
pub(super) fn read_records(head: &[u8; HEAD_BYTES], source: &mut dyn Read, soup: &mut Soup<'_>) -> Result<(), ReadError> {
    let mut at = HEAD_BYTES as u64;
    let mut left = declared(head).map_or(0, |count| count as usize);
    let mut buffer = vec![[0; RECORD_BYTES]; RECORDS_AT_ONCE.min(left)];
    while left > 0 {
        let records = &mut buffer[..RECORDS_AT_ONCE.min(left)];
        source.read_exact(records.as_flattened_mut()).map_err(|error| {
            if error.kind() == ErrorKind::UnexpectedEof {
                MeshError::Truncated { at: Position::Byte(at), expected: "a triangle" }.into()
            } else {
                ReadError::Io(error)
            }
        })?;
        add(records, at, soup)?;
        (at, left) = (at + (records.len() * RECORD_BYTES) as u64, left - records.len());
    }
    Ok(())
}

/// Adds the triangles of `records`, the first of which begins at byte `first`.
fn add(records: &[[u8; RECORD_BYTES]], first: u64, soup: &mut Soup<'_>) -> Result<(), MeshError> {
    for (record, at) in records.iter().zip((first..).step_by(RECORD_BYTES)) {
        let mut corners = [0; 3];
        for (corner, k) in corners.iter_mut().zip(0..) {
            let offset = CORNERS_AT + 12 * k;
            let xyz = [0, 4, 8].map(|axis| f64::from(float(record, offset + axis)));
            *corner = soup.welded_vertex(xyz, Position::Byte(at + offset as u64))?;
        }
        soup.face(&corners, Position::Byte(at))?;
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
