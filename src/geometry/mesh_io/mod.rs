//! Mesh files: STL (binary, text), OBJ and PLY (text, both byte orders), recognised by content. What comes out is in
//! millimetres and in the file's own axes (the part frame), welded, without degenerate triangles, with its health
//! beside it. What is wrong is said with its line or byte; no allocation trusts a number that the file only claims.
//!
//! Cost: linear in the size of the file; whatever takes long asks every few milliseconds whether to go on. Memory at its
//! highest: of a binary STL file, which is read piece by piece, 65 bytes a triangle where vertices are shared by six and 135
//! where none are; of the others the file, 28 to 88 bytes a triangle beside it, then 45 to 135 without it.

mod error;
mod obj;
mod obj_groups;
mod ply;
mod recognise;
mod soup;
mod stl_ascii;
mod stl_binary;
mod text;

use std::borrow::Cow;
use std::fmt;
use std::io::Read;

use self::soup::Soup;
use super::mesh_health::{MeshHealth, clean};
use super::{FaceGroup, LengthUnit, Mesh, Poll};

pub use error::{MeshError, Position, ReadError};
pub use stl_binary::write_stl;

/// Formats that are read.
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
    /// Name in answers and reports.
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

/// What one file may ask for.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Most triangles (after polygons are cut into fans), and a third of the most vertices.
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
    /// What is good and bad about it.
    pub health: MeshHealth,
    /// What the file was.
    pub format: MeshFormat,
    /// The unit it was taken to be in.
    pub unit: LengthUnit,
}

/// Bytes of a source that are taken at a time.
const PIECE_BYTES: u64 = 1 << 20;

/// The format of `bytes`, by their content alone.
///
/// # Errors
/// [`MeshError::EmptyFile`], [`MeshError::FormatNotRead`], [`MeshError::UnknownFormat`], [`MeshError::Encoding`].
pub fn recognise(bytes: &[u8]) -> Result<MeshFormat, MeshError> {
    let poll = Poll::never();
    recognise::recognise(&content(bytes, &poll)?, &poll)
}

/// Reads a mesh file. `unit` is what the file is drawn in; none of the formats says it.
///
/// # Errors
/// Every variant of [`MeshError`] but [`MeshError::Interrupted`]; [`MeshError::UnitMissing`] only after the format was
/// recognised.
pub fn read(bytes: &[u8], unit: Option<LengthUnit>, limits: &Limits) -> Result<ReadMesh, MeshError> {
    parsed(bytes, unit, limits, &Poll::never())?.finished()
}

/// Reads a mesh file of `length_bytes` from a source of its bytes, until `poll` says to stop. The file is not held in
/// memory where its format allows that, and never beside the tables that the mesh is welded and judged with.
///
/// # Errors
/// [`ReadError`]; [`MeshError::Interrupted`] when told to stop.
pub fn read_from(
    source: &mut dyn Read,
    length_bytes: u64,
    unit: Option<LengthUnit>,
    limits: &Limits,
    poll: &Poll<'_>,
) -> Result<ReadMesh, ReadError> {
    let mut bytes = Vec::new();
    Read::take(&mut *source, stl_binary::HEAD_BYTES as u64).read_to_end(&mut bytes)?;
    let parsed = match bytes.first_chunk().filter(|head| stl_binary::length_fits(*head, length_bytes)) {
        Some(head) => {
            let unit = unit.ok_or(MeshError::UnitMissing)?;
            let mut soup = Soup::new(unit, limits, poll);
            stl_binary::read_on(head, source, &mut soup)?;
            Parsed { format: MeshFormat::StlBinary, unit, soup, groups: Vec::new() }
        }
        None => {
            while Read::take(&mut *source, PIECE_BYTES).read_to_end(&mut bytes)? > 0 {
                poll.check().map_err(MeshError::from)?;
            }
            parsed(&bytes, unit, limits, poll)?
        }
    };
    drop(bytes);
    Ok(parsed.finished()?)
}

/// What a reader has made of a file, before it is welded and judged.
struct Parsed<'a> {
    format: MeshFormat,
    unit: LengthUnit,
    soup: Soup<'a>,
    groups: Vec<FaceGroup>,
}

fn parsed<'a>(bytes: &[u8], unit: Option<LengthUnit>, limits: &'a Limits, poll: &'a Poll<'a>) -> Result<Parsed<'a>, MeshError> {
    let text = content(bytes, poll)?;
    let format = recognise::recognise(&text, poll)?;
    let unit = unit.ok_or(MeshError::UnitMissing)?;
    let mut soup = Soup::new(unit, limits, poll);
    let groups = match format {
        MeshFormat::StlBinary => stl_binary::read(&text, &mut soup).map(|()| Vec::new()),
        MeshFormat::StlAscii => stl_ascii::read(&text, &mut soup).map(|()| Vec::new()),
        MeshFormat::Obj => obj::read(&text, &mut soup, limits),
        MeshFormat::Ply => ply::read(&text, &mut soup).map(|()| Vec::new()),
    };
    // To a reader that is told to stop, the file seems to end.
    poll.check()?;
    Ok(Parsed { format, unit, soup, groups: groups? })
}

impl Parsed<'_> {
    fn finished(self) -> Result<ReadMesh, MeshError> {
        let Self { format, unit, mut soup, groups } = self;
        match format {
            MeshFormat::StlBinary | MeshFormat::StlAscii => soup.weld_float_noise()?,
            MeshFormat::Obj | MeshFormat::Ply => soup.weld_equal()?,
        }
        let poll = soup.poll;
        let raw = soup.into_mesh(groups);
        if raw.faces.is_empty() {
            return Err(MeshError::NoTriangles {
                why: if raw.vertices_mm.is_empty() { "it has no faces" } else { "only points" },
            });
        }
        let (mesh, health) = clean(raw, poll)?;
        if mesh.faces.is_empty() {
            return Err(MeshError::NoTriangles { why: "every triangle is degenerate (has no area)" });
        }
        Ok(ReadMesh { mesh, health, format, unit })
    }
}

/// The bytes to read: text without its byte order mark. The header of a binary STL may begin like one.
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
