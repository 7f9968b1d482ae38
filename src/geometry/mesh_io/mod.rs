//! Readers of mesh files: STL (binary, ASCII), OBJ and PLY (ASCII, binary in both byte orders), told apart by their content.
//! The mesh comes out in millimetres and in the file's own axes (the part frame), welded, without degenerate triangles,
//! together with its health. Every error names the line or byte at fault; no allocation relies on a count that the file
//! merely declares.
//!
//! Cost: linear in the size of the file, save for concave polygons (`polygons`). Files are parsed in pieces, side by side on the
//! threads of the caller's pool (`pieces`), and the poll is asked every few milliseconds for cancellation. Peak memory, counted: for
//! a binary STL file, of which a few megabytes are held at a time, 75 bytes per triangle where six triangles share each vertex, 150
//! where none share any; for other formats the file and 28 to 88 bytes per triangle, then 55 to 150 bytes per triangle without the
//! file.

mod detect;
mod error;
mod facets;
mod obj;
mod obj_groups;
mod pieces;
pub(super) mod ply;
mod polygons;
mod soup;
mod stl_ascii;
mod stl_binary;
pub(super) mod text;

use std::borrow::Cow;
use std::fmt;
use std::io::Read;

use self::soup::Soup;
use super::mesh_health::{MeshHealth, clean};
use super::{FaceGroup, LengthUnit, Mesh, Poll};

pub use error::{MeshError, Position, ReadError};
pub use stl_binary::write_stl;

/// Mesh formats that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Binary STL.
    StlBinary,
    /// ASCII STL.
    StlAscii,
    /// Wavefront OBJ.
    Obj,
    /// PLY, any encoding.
    Ply,
}

impl MeshFormat {
    /// Name in responses and reports.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::StlBinary => "stl_binary",
            Self::StlAscii => "stl_ascii",
            Self::Obj => "obj",
            Self::Ply => "ply",
        }
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Limits on the size of a mesh file.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Max triangles, counted after polygons are cut into them; the max number of vertices is three times this.
    pub max_triangles: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_triangles: 20_000_000 }
    }
}

/// A mesh file that was read.
#[derive(Clone, Debug)]
pub struct ReadMesh {
    /// The mesh, in millimetres.
    pub mesh: Mesh,
    /// Counts, defects and warnings.
    pub health: MeshHealth,
    /// Format of the file.
    pub format: MeshFormat,
    /// Unit that the file's coordinates were taken to be in.
    pub unit: LengthUnit,
}

/// Settings that a file is read with.
#[derive(Clone, Copy)]
struct Settings<'a> {
    unit: LengthUnit,
    limits: &'a Limits,
    /// Bytes of text that are parsed at a time at least; what is read does not depend on it.
    piece_bytes: usize,
}

impl<'a> Settings<'a> {
    fn new(unit: LengthUnit, limits: &'a Limits) -> Self {
        Self { unit, limits, piece_bytes: pieces::PIECE_BYTES }
    }

    fn unit_mm(&self) -> f64 {
        self.unit.mm()
    }
}

/// Bytes read from a source at a time.
const CHUNK_BYTES: u64 = 1 << 20;

/// Detects the format of `bytes` from their content alone.
///
/// # Errors
/// [`MeshError::EmptyFile`], [`MeshError::FormatNotRead`], [`MeshError::UnknownFormat`], [`MeshError::Encoding`].
pub fn detect_format(bytes: &[u8]) -> Result<MeshFormat, MeshError> {
    let poll = Poll::never();
    detect::detect_format(&content(bytes, &poll)?, &poll)
}

/// Returns true if a file that begins so, and is so long, is a binary STL file.
pub(in crate::geometry) fn is_binary_stl(head: &[u8], length_bytes: u64) -> bool {
    stl_binary::length_fits(head, length_bytes)
}

/// Reads a mesh file. `unit` is the unit of its coordinates, which none of the formats states.
///
/// # Errors
/// Every variant of [`MeshError`] except [`MeshError::Interrupted`]; [`MeshError::UnitMissing`] only once the format is known.
pub fn read(bytes: &[u8], unit: Option<LengthUnit>, limits: &Limits) -> Result<ReadMesh, MeshError> {
    let settings = |unit| Settings::new(unit, limits);
    parsed(bytes, unit.map(settings), &Poll::never())?.finished()
}

/// Reads a mesh file of `length_bytes` from `source` until `poll` says to stop. The file is streamed where its format allows
/// it, and is never held in memory together with the tables that the mesh is welded and assessed with.
///
/// # Errors
/// [`ReadError`]; [`MeshError::Interrupted`] when `poll` says to stop.
pub fn read_from(
    source: &mut dyn Read,
    length_bytes: u64,
    unit: Option<LengthUnit>,
    limits: &Limits,
    poll: &Poll<'_>,
) -> Result<ReadMesh, ReadError> {
    Ok(parse_from(source, length_bytes, unit, limits, poll)?.finished()?)
}

/// Reads a mesh file as [`read_from`] does, up to the welding and the assessment of its mesh.
///
/// # Errors
/// [`ReadError`]; [`MeshError::Interrupted`] when `poll` says to stop.
pub fn parse_from<'a>(
    source: &mut dyn Read,
    length_bytes: u64,
    unit: Option<LengthUnit>,
    limits: &'a Limits,
    poll: &'a Poll<'a>,
) -> Result<ParsedMesh<'a>, ReadError> {
    let mut bytes = Vec::new();
    Read::take(&mut *source, stl_binary::HEAD_BYTES as u64).read_to_end(&mut bytes)?;
    let parsed = match bytes.first_chunk().filter(|head| stl_binary::length_fits(*head, length_bytes)) {
        Some(head) => {
            let mut soup = Soup::new(Settings::new(unit.ok_or(MeshError::UnitMissing)?, limits), poll);
            stl_binary::read_records(head, source, &mut soup)?;
            ParsedMesh { format: MeshFormat::StlBinary, soup, groups: Vec::new() }
        }
        None => {
            while Read::take(&mut *source, CHUNK_BYTES).read_to_end(&mut bytes)? > 0 {
                poll.check().map_err(MeshError::from)?;
            }
            parsed(&bytes, unit.map(|unit| Settings::new(unit, limits)), poll)?
        }
    };
    Ok(parsed)
}

/// A parsed file, before its mesh is welded and assessed.
pub struct ParsedMesh<'a> {
    format: MeshFormat,
    soup: Soup<'a>,
    groups: Vec<FaceGroup>,
}

/// Parses a whole file; without settings for want of a unit only its format is found.
fn parsed<'a>(bytes: &[u8], settings: Option<Settings<'a>>, poll: &'a Poll<'a>) -> Result<ParsedMesh<'a>, MeshError> {
    let text = content(bytes, poll)?;
    let format = detect::detect_format(&text, poll)?;
    let mut soup = Soup::new(settings.ok_or(MeshError::UnitMissing)?, poll);
    let groups = match format {
        MeshFormat::StlBinary => stl_binary::read(&text, &mut soup).map(|()| Vec::new()),
        MeshFormat::StlAscii => stl_ascii::read(&text, &mut soup).map(|()| Vec::new()),
        MeshFormat::Obj => obj::read(&text, &mut soup),
        MeshFormat::Ply => ply::read(&text, &mut soup).map(|()| Vec::new()),
    };
    // Once stopped, a reader sees the file end and reports that it is truncated.
    poll.check()?;
    Ok(ParsedMesh { format, soup, groups: groups? })
}

impl ParsedMesh<'_> {
    /// Welds and assesses the mesh.
    ///
    /// # Errors
    /// [`MeshError::NoTriangles`]; [`MeshError::Interrupted`] when the poll that it was read with says to stop.
    pub fn finished(self) -> Result<ReadMesh, MeshError> {
        let Self { format, mut soup, groups } = self;
        let uncut_polygons = soup.cut_concave()?;
        match format {
            MeshFormat::StlBinary | MeshFormat::StlAscii => soup.weld_float_noise()?,
            MeshFormat::Obj | MeshFormat::Ply => soup.weld_equal()?,
        }
        let (unit, poll) = (soup.settings.unit, soup.poll);
        let raw = soup.into_mesh(groups);
        if raw.faces.is_empty() {
            return Err(MeshError::NoTriangles {
                reason: if raw.vertices_mm.is_empty() { "it has no faces" } else { "it has only points" },
            });
        }
        let (mesh, health) = clean(raw, poll)?;
        let health = MeshHealth { uncut_polygons, ..health };
        if mesh.faces.is_empty() {
            return Err(MeshError::NoTriangles { reason: "every triangle is degenerate (has no area)" });
        }
        Ok(ReadMesh { mesh, health, format, unit })
    }
}

/// The bytes to parse: text without its byte order mark. A binary STL stays as it is: its header may begin like such a mark.
fn content<'b>(bytes: &'b [u8], poll: &Poll<'_>) -> Result<Cow<'b, [u8]>, MeshError> {
    if bytes.is_empty() {
        return Err(MeshError::EmptyFile);
    }
    if stl_binary::length_fits(bytes, bytes.len() as u64) {
        Ok(Cow::Borrowed(bytes))
    } else {
        text::without_byte_order_mark(bytes, poll)
    }
}

#[cfg(test)]
mod tests;
