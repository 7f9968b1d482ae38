//! Binary STL: 80 bytes of anything, a count, and 50 bytes a triangle (normal, three corners, attribute), little endian.
//! Normals and attributes are not used: the order of the corners says which side is out.

use nalgebra::Vector3;

use super::error::{MeshError, Position};
use super::soup::Soup;
use crate::geometry::Mesh;

const COUNT_AT: usize = 80;
const FIRST_RECORD_AT: usize = 84;
const RECORD_BYTES: usize = 50;
const CORNERS_AT: usize = 12;
const HEADER: &[u8] = b"binary STL by vantage, millimetres";

/// Whether the count fits the length to the byte.
pub(super) fn length_fits(bytes: &[u8]) -> bool {
    declared(bytes).is_some_and(|count| needed_bytes(count) == bytes.len() as u64)
}

/// Reads every triangle.
pub(super) fn read(bytes: &[u8], soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let count = declared(bytes)
        .ok_or(MeshError::Truncated { at: Position::Byte(bytes.len() as u64), expected: "the header of a binary STL" })?;
    check_length(bytes, count)?;
    let (records, _) = bytes[FIRST_RECORD_AT..].as_chunks::<RECORD_BYTES>();
    for (record, at) in records.iter().take(count as usize).zip((FIRST_RECORD_AT..).step_by(RECORD_BYTES)) {
        let mut corners = [0; 3];
        for (corner, k) in corners.iter_mut().zip(0..) {
            let offset = CORNERS_AT + 12 * k;
            let xyz = [0, 4, 8].map(|axis| f64::from(float(record, offset + axis)));
            *corner = soup.vertex(xyz, Position::Byte((at + offset) as u64))?;
        }
        soup.face(&corners, Position::Byte(at as u64))?;
    }
    Ok(())
}

/// Writes `mesh` as binary STL in millimetres. Coordinates are rounded to 32 bits, as the format has it; groups and
/// file faces are not kept. The format ends at 2³² − 1 triangles.
#[must_use]
pub fn write_stl(mesh: &Mesh) -> Vec<u8> {
    let count = u32::try_from(mesh.faces.len()).unwrap_or(u32::MAX);
    let mut bytes = Vec::with_capacity(FIRST_RECORD_AT + RECORD_BYTES * count as usize);
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
    FIRST_RECORD_AT as u64 + u64::from(count) * RECORD_BYTES as u64
}

/// Nothing is allocated or read before the count is known to fit. Less than a record of surplus is padding.
fn check_length(bytes: &[u8], count: u32) -> Result<(), MeshError> {
    let (needed, present) = (needed_bytes(count), bytes.len() as u64);
    let payload = |length: u64| length.saturating_sub(FIRST_RECORD_AT as u64);
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
