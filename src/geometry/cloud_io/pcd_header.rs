//! The header of a PCD file (Point Cloud Library, "The PCD (Point Cloud Data) file format", version 0.7).

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::CloudError;
use crate::geometry::mesh_io::ply::header::Scalar;
use crate::geometry::mesh_io::text::{Line, Lines, excerpt, number, parse_token};
use crate::geometry::mesh_io::{MeshError, Position};
use crate::geometry::point_cloud::CloudGrid;
use crate::geometry::poll::Poll;

/// Max lines of a header, comments included.
const MAX_LINES: u64 = 1000;
/// Max numbers of a record.
const MAX_NUMBERS: u64 = 100_000;

/// Encoding of the records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PcdData {
    Ascii,
    Binary,
    Compressed,
}

/// A number of the record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PcdPlace {
    pub(super) scalar: Scalar,
    /// Byte in a record.
    pub(super) byte: usize,
    /// Place among the numbers of a record.
    pub(super) index: usize,
}

/// Header of a PCD file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PcdHeader {
    pub(super) xyz: [PcdPlace; 3],
    pub(super) record_bytes: usize,
    pub(super) numbers: usize,
    pub(super) columns: u64,
    pub(super) rows: u64,
    pub(super) points: u64,
    /// Pose of the sensor, if it is not the identity.
    pub(super) viewpoint: Option<Isometry3<f64>>,
    pub(super) data: PcdData,
    pub(super) body_at: usize,
    pub(super) body_line: u64,
    /// Line that declares the number of points.
    pub(super) count_at: Position,
}

/// Returns true if the text begins as a PCD file does.
pub(super) fn is_pcd(head: &[u8], poll: &Poll<'_>) -> bool {
    if head.starts_with(b"# .PCD") {
        return true;
    }
    let first =
        Lines::new(head, 1, poll).take(20).find(|line| !line.text.trim_ascii().is_empty() && !line.text.starts_with(b"#"));
    first.is_some_and(|line| matches!(line.tokens().next(), Some(b"VERSION" | b"FIELDS")))
}

/// Lines of a header, as far as they were read.
#[derive(Default)]
struct Draft<'a> {
    fields: Vec<&'a [u8]>,
    sizes: Vec<&'a [u8]>,
    types: Vec<&'a [u8]>,
    counts: Vec<u64>,
    columns: Option<u64>,
    rows: Option<u64>,
    points: Option<u64>,
    viewpoint: Option<Isometry3<f64>>,
    count_at: Option<Position>,
}

impl PcdHeader {
    /// Cells of an organised cloud.
    pub(super) fn grid(&self) -> Option<CloudGrid> {
        (self.rows > 1).then_some(CloudGrid { columns: self.columns as usize, rows: self.rows as usize })
    }

    pub(super) fn parse(bytes: &[u8], poll: &Poll<'_>) -> Result<Self, CloudError> {
        let mut lines = Lines::new(bytes, 1, poll);
        let mut draft = Draft::default();
        loop {
            let line = lines.next().filter(|line| line.number <= MAX_LINES);
            let Some(line) = line else {
                return Err(MeshError::Truncated { at: lines.at(), expected: "the line DATA of a PCD header" }.into());
            };
            let mut words = line.tokens();
            let Some(key) = words.next() else { continue };
            let rest: Vec<&[u8]> = words.take(MAX_NUMBERS as usize).collect();
            match key {
                b"DATA" => {
                    let data = match rest[..] {
                        [b"ascii"] => PcdData::Ascii,
                        [b"binary"] => PcdData::Binary,
                        [b"binary_compressed"] => PcdData::Compressed,
                        _ => return Err(syntax(line, "DATA ascii, binary or binary_compressed").into()),
                    };
                    let body_at = bytes.len() - lines.rest().len();
                    return draft.finish(data, line, body_at);
                }
                _ if key.starts_with(b"#") => {}
                _ => draft.take(key, rest, line)?,
            }
        }
    }
}

impl<'a> Draft<'a> {
    fn take(&mut self, key: &[u8], rest: Vec<&'a [u8]>, line: Line<'_>) -> Result<(), MeshError> {
        let whole = |word: Option<&&[u8]>| word.and_then(|word| parse_token(word)).ok_or_else(|| syntax(line, "a whole number"));
        match key {
            b"VERSION" => {}
            b"FIELDS" => self.fields = rest,
            b"SIZE" => self.sizes = rest,
            b"TYPE" => self.types = rest,
            b"COUNT" => self.counts = rest.iter().map(|word| whole(Some(word))).collect::<Result<_, _>>()?,
            b"WIDTH" => (self.columns, self.count_at) = (Some(whole(rest.first())?), Some(line.at())),
            b"HEIGHT" => self.rows = Some(whole(rest.first())?),
            b"POINTS" => (self.points, self.count_at) = (Some(whole(rest.first())?), Some(line.at())),
            b"VIEWPOINT" => self.viewpoint = viewpoint(&rest, line)?,
            _ => {
                return Err(syntax(
                    line,
                    "a line of a PCD header: FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS, DATA",
                ));
            }
        }
        Ok(())
    }

    fn finish(self, data: PcdData, line: Line<'_>, body_at: usize) -> Result<PcdHeader, CloudError> {
        let missing = |what: &'static str| MeshError::Syntax { at: line.at(), expected: what, found: "\"DATA\"".into() };
        let columns = self.columns.ok_or_else(|| missing("the line WIDTH before DATA"))?;
        let rows = self.rows.unwrap_or(1);
        let cells = columns.checked_mul(rows);
        let points = self.points.or(cells).unwrap_or(u64::MAX);
        let count_at = self.count_at.unwrap_or(line.at());
        if cells != Some(points) {
            return Err(CloudError::GridMismatch { at: count_at, columns, rows, points });
        }
        let (xyz, record_bytes, numbers) = self.layout(line)?;
        let (viewpoint, body_line) = (self.viewpoint, line.number + 1);
        Ok(PcdHeader { xyz, record_bytes, numbers, columns, rows, points, viewpoint, data, body_at, body_line, count_at })
    }

    /// Places of x, y, z; bytes and numbers of a record.
    fn layout(&self, line: Line<'_>) -> Result<([PcdPlace; 3], usize, usize), MeshError> {
        let same = self.sizes.len() == self.fields.len() && self.types.len() == self.fields.len();
        if !same || !(self.counts.is_empty() || self.counts.len() == self.fields.len()) {
            return Err(syntax(line, "as many SIZE, TYPE and COUNT as FIELDS before DATA"));
        }
        let (mut byte, mut index) = (0_u64, 0_u64);
        let mut xyz: [Option<PcdPlace>; 3] = [None; 3];
        for (place, field) in self.fields.iter().enumerate() {
            let scalar = scalar(self.types[place], self.sizes[place])
                .ok_or_else(|| syntax(line, "TYPE F, I or U with SIZE 1, 2, 4 or 8"))?;
            let count = self.counts.get(place).copied().unwrap_or(1);
            let axis = [&b"x"[..], b"y", b"z"].iter().position(|axis| axis == field);
            if let (Some(axis), PcdScalar::Known(scalar), 1) = (axis, scalar, count) {
                xyz[axis].get_or_insert(PcdPlace { scalar, byte: byte as usize, index: index as usize });
            }
            byte = byte.saturating_add(count.saturating_mul(scalar.size_bytes()));
            index = index.saturating_add(count);
            if index > MAX_NUMBERS {
                return Err(syntax(line, "at most 100000 numbers a point"));
            }
        }
        let [Some(x), Some(y), Some(z)] = xyz else { return Err(syntax(line, "the FIELDS x, y, z of 4 or 8 bytes before DATA")) };
        Ok(([x, y, z], byte as usize, index as usize))
    }
}

/// Type of a field.
#[derive(Clone, Copy)]
enum PcdScalar {
    Known(Scalar),
    /// An integer of 64 bits, which is passed over.
    Wide,
}

impl PcdScalar {
    fn size_bytes(self) -> u64 {
        match self {
            Self::Known(scalar) => scalar.size_bytes() as u64,
            Self::Wide => 8,
        }
    }
}

fn scalar(kind: &[u8], size: &[u8]) -> Option<PcdScalar> {
    Some(match (kind, size) {
        (b"F", b"4") => PcdScalar::Known(Scalar::F32),
        (b"F", b"8") => PcdScalar::Known(Scalar::F64),
        (b"I", b"1") => PcdScalar::Known(Scalar::I8),
        (b"I", b"2") => PcdScalar::Known(Scalar::I16),
        (b"I", b"4") => PcdScalar::Known(Scalar::I32),
        (b"U", b"1") => PcdScalar::Known(Scalar::U8),
        (b"U", b"2") => PcdScalar::Known(Scalar::U16),
        (b"U", b"4") => PcdScalar::Known(Scalar::U32),
        (b"I" | b"U", b"8") => PcdScalar::Wide,
        _ => return None,
    })
}

/// Pose of `VIEWPOINT tx ty tz qw qx qy qz`; `None` for the identity, which is written where nothing is known.
fn viewpoint(words: &[&[u8]], line: Line<'_>) -> Result<Option<Isometry3<f64>>, MeshError> {
    let wanted = "VIEWPOINT tx ty tz qw qx qy qz, a unit quaternion";
    let values = words.iter().map(|word| number(word, line.at())).collect::<Result<Vec<f64>, _>>()?;
    let [tx, ty, tz, qw, qx, qy, qz] = values[..] else { return Err(syntax(line, wanted)) };
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    if !values.iter().all(|value| value.is_finite()) || !(0.9..1.1).contains(&quaternion.norm()) {
        return Err(syntax(line, wanted));
    }
    let pose = Isometry3::from_parts(Translation3::new(tx, ty, tz), UnitQuaternion::from_quaternion(quaternion));
    Ok((pose != Isometry3::identity()).then_some(pose))
}

fn syntax(line: Line<'_>, expected: &'static str) -> MeshError {
    MeshError::Syntax { at: line.at(), expected, found: excerpt(line.text.trim_ascii()) }
}
