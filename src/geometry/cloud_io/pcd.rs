//! Records of a PCD file: text, binary (little endian, as every machine that writes them), or compressed, where all values of a field
//! stand together.

use super::lzf::{Corrupt, unpack};
use super::pcd_header::{PcdData, PcdHeader};
use super::stream::CloudStream;
use super::{CloudError, CloudLimits, Collected, StatedPose, StoredCloud};
use crate::geometry::mesh_io::ply::header::Scalar;
use crate::geometry::mesh_io::ply::values::decode;
use crate::geometry::mesh_io::text::{Lines, excerpt, number};
use crate::geometry::mesh_io::{MeshError, Position};

/// Bytes that a header may take.
const MAX_HEADER_BYTES: usize = 1 << 16;

pub(super) fn read(stream: &mut CloudStream<'_>, limits: &CloudLimits) -> Result<StoredCloud, CloudError> {
    let poll = stream.poll;
    let head = stream.fill(MAX_HEADER_BYTES)?;
    let header = PcdHeader::parse(&head[..head.len().min(MAX_HEADER_BYTES)], poll)?;
    stream.consume(header.body_at);
    check_count(&header, stream)?;
    let mut collected = Collected::new(header.points, header.grid().is_some(), limits)?;
    match header.data {
        PcdData::Ascii => read_ascii(&header, stream, &mut collected)?,
        PcdData::Binary => read_binary(&header, stream, &mut collected)?,
        PcdData::Compressed => read_compressed(&header, stream, &mut collected)?,
    }
    let mut cloud = collected.into_cloud(header.grid());
    cloud.stated_pose = header.viewpoint.map(StatedPose::CloudFromSensor);
    Ok(cloud)
}

/// Refuses a count that the file is too short for.
fn check_count(header: &PcdHeader, stream: &CloudStream<'_>) -> Result<(), CloudError> {
    let record = match header.data {
        PcdData::Ascii => 2 * header.numbers as u64,
        PcdData::Binary => header.record_bytes as u64,
        // A repetition of three bytes gives 264 at most.
        PcdData::Compressed => 0,
    };
    let unpacked = header.points.saturating_mul(header.record_bytes as u64);
    let needed = if header.data == PcdData::Compressed { 8 + unpacked / 88 } else { header.points.saturating_mul(record) };
    let present = stream.bytes_left() + u64::from(header.data == PcdData::Ascii);
    if needed <= present {
        return Ok(());
    }
    let what = "points of a PCD file".into();
    let (at, declared) = (header.count_at, header.points);
    Err(MeshError::CountMismatch { at, declared, what, needed_bytes: needed, present_bytes: present }.into())
}

fn read_ascii(header: &PcdHeader, stream: &mut CloudStream<'_>, into: &mut Collected) -> Result<(), CloudError> {
    let (mut left, mut first_line) = (header.points, header.body_line);
    while left > 0 {
        let length = stream.fill_lines()?;
        if length == 0 {
            return Err(MeshError::Truncated { at: Position::Line(first_line), expected: "a point" }.into());
        }
        let mut lines = Lines::new(&stream.window()[..length], first_line, stream.poll);
        for line in lines.by_ref() {
            if line.text.trim_ascii().is_empty() || left == 0 {
                continue;
            }
            let mut point = [f32::NAN; 3];
            let mut found = 0;
            for (index, word) in line.tokens().enumerate().take(header.numbers) {
                if let Some(axis) = header.xyz.iter().position(|place| place.index == index) {
                    point[axis] = number(word, line.at())? as f32;
                    found += 1;
                }
            }
            if found < 3 {
                let found = excerpt(line.text.trim_ascii());
                return Err(MeshError::Syntax { at: line.at(), expected: "as many numbers as FIELDS", found }.into());
            }
            into.push(point)?;
            left -= 1;
        }
        first_line = lines.number() + 1;
        stream.consume(length);
    }
    Ok(())
}

fn read_binary(header: &PcdHeader, stream: &mut CloudStream<'_>, into: &mut Collected) -> Result<(), CloudError> {
    let size = header.record_bytes;
    let mut left = header.points;
    while left > 0 {
        let at_hand = stream.fill(size)?.len() / size;
        if at_hand == 0 {
            stream.need(size, "a point")?;
        }
        let count = at_hand.min(usize::try_from(left).unwrap_or(usize::MAX));
        for record in stream.window()[..count * size].chunks_exact(size) {
            into.push(header.xyz.map(|place| single(record, place.byte, place.scalar)))?;
        }
        stream.consume(count * size);
        left -= count as u64;
    }
    Ok(())
}

/// A number as f32; a missing one as NaN.
#[inline]
pub(super) fn single(bytes: &[u8], at: usize, scalar: Scalar) -> f32 {
    if scalar == Scalar::F32 {
        return bytes.get(at..at + 4).and_then(|raw| raw.try_into().ok()).map_or(f32::NAN, f32::from_le_bytes);
    }
    decode(bytes, at, scalar, false).map_or(f32::NAN, |value| value as f32)
}

/// Reads the lengths, packed and unpacked, and unpacks: all values of the first field, then of the second, and so on.
fn read_compressed(header: &PcdHeader, stream: &mut CloudStream<'_>, into: &mut Collected) -> Result<(), CloudError> {
    let at = stream.at();
    let length_of = |bytes: &[u8]| bytes.first_chunk().map_or(0, |raw| u64::from(u32::from_le_bytes(*raw)));
    let lengths = stream.need(8, "the lengths of the compressed data")?;
    let (packed_bytes, unpacked_bytes) = (length_of(lengths), length_of(&lengths[4..]));
    stream.consume(8);
    if unpacked_bytes != header.points.saturating_mul(header.record_bytes as u64) {
        return Err(CloudError::Compression { at });
    }
    if packed_bytes > stream.bytes_left() {
        let (at, declared) = (at, packed_bytes);
        let (what, present_bytes) = ("bytes of compressed data".into(), stream.bytes_left());
        return Err(MeshError::CountMismatch { at, declared, what, needed_bytes: packed_bytes, present_bytes }.into());
    }
    let begin = stream.byte();
    let mut points = vec![[f32::NAN; 3]; header.points as usize];
    let mut columns = Columns { header, points: &mut points, at: 0, half: Vec::new() };
    let packed = stream.need(packed_bytes as usize, "compressed data")?;
    let end = unpack(packed, unpacked_bytes, |part| {
        columns.take(part);
        Ok::<(), CloudError>(())
    })?;
    end.map_err(|Corrupt { at }| CloudError::Compression { at: Position::Byte(begin + at as u64) })?;
    points.into_iter().try_for_each(|point| into.push(point))
}

/// Takes the unpacked bytes to the points.
struct Columns<'a> {
    header: &'a PcdHeader,
    points: &'a mut [[f32; 3]],
    /// Byte of the unpacked data that comes next.
    at: usize,
    /// Begin of a number that went over the end of a part.
    half: Vec<u8>,
}

impl Columns<'_> {
    fn take(&mut self, part: &[u8]) {
        let count = self.points.len();
        // As they follow each other in the file: `half` belongs to the one that the part before ended in.
        let mut columns = [0, 1, 2].map(|axis| (axis, self.header.xyz[axis]));
        columns.sort_by_key(|(_, place)| place.byte);
        for (axis, place) in columns {
            let size = place.scalar.size_bytes();
            let (first, last) = (count * place.byte, count * (place.byte + size));
            let begin = first.max(self.at);
            let end = last.min(self.at + part.len());
            if begin >= end {
                continue;
            }
            let mut bytes = &part[begin - self.at..end - self.at];
            let mut number = (begin - first) / size;
            let lead = (begin - first) % size;
            if lead > 0 {
                let missing = (size - lead).min(bytes.len());
                self.half.extend_from_slice(&bytes[..missing]);
                bytes = &bytes[missing..];
                if self.half.len() < size {
                    continue;
                }
                self.points[number][axis] = single(&self.half, 0, place.scalar);
                number += 1;
            }
            self.half.clear();
            let whole = bytes.chunks_exact(size);
            self.half.extend_from_slice(whole.remainder());
            for raw in whole {
                self.points[number][axis] = single(raw, 0, place.scalar);
                number += 1;
            }
        }
        self.at += part.len();
    }
}
