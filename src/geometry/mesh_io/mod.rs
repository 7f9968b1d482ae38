//! Mesh files: STL (binary, text), OBJ and PLY (text, both byte orders), recognised by content. What comes out is in
//! millimetres and in the file's own axes (the part frame), welded, without degenerate triangles, with its health
//! beside it. What is wrong is said with its line or byte; no allocation trusts a number that the file only claims.
//! Linear in the size of the file.

mod error;
mod obj;
mod ply;
mod recognise;
mod soup;
mod stl_ascii;
mod stl_binary;
mod text;

use std::borrow::Cow;
use std::fmt;

use self::soup::Soup;
use super::mesh_health::{MeshHealth, clean};
use super::{LengthUnit, Mesh};

pub use error::{MeshError, Position};
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
    /// Most triangles (after polygons are cut into fans). Memory is at most about 300 bytes a triangle.
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

/// The format of `bytes`, by their content alone.
///
/// # Errors
/// [`MeshError::EmptyFile`], [`MeshError::FormatNotRead`], [`MeshError::UnknownFormat`], [`MeshError::Encoding`].
pub fn recognise(bytes: &[u8]) -> Result<MeshFormat, MeshError> {
    recognise::recognise(&content(bytes)?)
}

/// Reads a mesh file. `unit` is what the file is drawn in; none of the formats says it.
///
/// # Errors
/// Every variant of [`MeshError`]; [`MeshError::UnitMissing`] only after the format was recognised.
pub fn read(bytes: &[u8], unit: Option<LengthUnit>, limits: &Limits) -> Result<ReadMesh, MeshError> {
    let text = content(bytes)?;
    let format = recognise::recognise(&text)?;
    let unit = unit.ok_or(MeshError::UnitMissing)?;
    let mut soup = Soup::new(unit, limits);
    let groups = match format {
        MeshFormat::StlBinary => stl_binary::read(&text, &mut soup).map(|()| Vec::new()),
        MeshFormat::StlAscii => stl_ascii::read(&text, &mut soup).map(|()| Vec::new()),
        MeshFormat::Obj => obj::read(&text, &mut soup, limits),
        MeshFormat::Ply => ply::read(&text, &mut soup).map(|()| Vec::new()),
    }?;
    if matches!(format, MeshFormat::StlBinary | MeshFormat::StlAscii) {
        soup.weld_float_noise();
    }
    let raw = soup.into_mesh(groups);
    if raw.faces.is_empty() {
        return Err(MeshError::NoTriangles { why: if raw.vertices_mm.is_empty() { "it has no faces" } else { "only points" } });
    }
    let (mesh, health) = clean(raw);
    if mesh.faces.is_empty() {
        return Err(MeshError::NoTriangles { why: "every triangle is degenerate (has no area)" });
    }
    Ok(ReadMesh { mesh, health, format, unit })
}

/// The bytes to read: text without its byte order mark. The header of a binary STL may begin like one.
fn content(bytes: &[u8]) -> Result<Cow<'_, [u8]>, MeshError> {
    if bytes.is_empty() {
        return Err(MeshError::EmptyFile);
    }
    if stl_binary::length_fits(bytes) { Ok(Cow::Borrowed(bytes)) } else { text::without_byte_order_mark(bytes) }
}

#[cfg(test)]
mod tests;
