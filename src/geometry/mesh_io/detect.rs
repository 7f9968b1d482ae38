//! Detection of a file's format from its content; file names mislead, and uploads have none.

use super::MeshFormat;
use super::error::MeshError;
use super::stl_binary;
use super::text::{Lines, Tokens};
use crate::geometry::poll::Poll;

const UNPACK: &str = "unpack it and use the mesh inside";
const EXPORT: &str = "export the part as STL, OBJ or PLY";

/// First bytes of unsupported formats that users are likely to try.
const UNSUPPORTED: [(&[u8], &str, &str); 14] = [
    (b"\x1f\x8b", "a gzip archive", UNPACK),
    (b"BZh", "a bzip2 archive", UNPACK),
    (b"\xfd7zXZ", "an xz archive", UNPACK),
    (b"\x28\xb5\x2f\xfd", "a zstd archive", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (b"PK\x03\x04", "a zip archive (perhaps 3MF)", EXPORT),
    (b"glTF", "binary glTF", EXPORT),
    (b"{", "JSON (perhaps glTF)", EXPORT),
    (b"ISO-10303-21", "STEP", EXPORT),
    (b"OFF", "OFF", EXPORT),
    (b"COFF", "OFF", EXPORT),
    (b"<", "XML (AMF, X3D or COLLADA)", EXPORT),
    (b"#VRML", "VRML", EXPORT),
    (b"Kaydara FBX", "FBX", EXPORT),
];

/// Keywords that begin lines of OBJ files, used only to tell OBJ from other text; the reader itself is more tolerant.
const OBJ_KEYWORDS: [&[u8]; 15] =
    [b"v", b"vt", b"vn", b"vp", b"f", b"l", b"p", b"g", b"o", b"s", b"mg", b"mtllib", b"usemtl", b"maplib", b"usemap"];

/// Detects the format of `text`, from which a byte order mark has been removed.
///
/// # Errors
/// [`MeshError::FormatNotRead`] for known formats that are not supported, [`MeshError::UnknownFormat`] for the rest.
pub(super) fn detect_format(text: &[u8], poll: &Poll<'_>) -> Result<MeshFormat, MeshError> {
    // A length that matches the count to the byte is the only mark of a binary STL: its header of 80 bytes may hold anything.
    if stl_binary::length_fits(text, text.len() as u64) {
        return Ok(MeshFormat::StlBinary);
    }
    let start = &text[poll.position(text, |byte| !byte.is_ascii_whitespace()).unwrap_or(text.len())..];
    if let Some((_, format, advice)) = UNSUPPORTED.iter().find(|(magic, ..)| start.starts_with(magic)) {
        return Err(MeshError::FormatNotRead { format, advice });
    }
    match Tokens::of(start, poll).next().unwrap_or_default() {
        b"ply" => Ok(MeshFormat::Ply),
        word if word.eq_ignore_ascii_case(b"solid") && is_ascii_stl(start, poll) => Ok(MeshFormat::StlAscii),
        _ if !poll.holds(text, 0) && is_obj(text, poll) => Ok(MeshFormat::Obj),
        _ if !is_text(text) => Ok(MeshFormat::StlBinary),
        _ => Err(MeshError::UnknownFormat),
    }
}

/// Returns true for ASCII STL. A binary file may begin with `solid` too, but its next non-blank line has no keyword.
fn is_ascii_stl(text: &[u8], poll: &Poll<'_>) -> bool {
    let second = Lines::new(text, 1, poll).skip(1).find_map(|line| line.tokens().next());
    second.is_none_or(|word| {
        [&b"facet"[..], b"endsolid", b"solid"].iter().any(|keyword| word.eq_ignore_ascii_case(keyword)) || is_text(text)
    })
}

/// Returns true if the first line with content begins like OBJ. A file of nothing but comments is OBJ without a surface.
fn is_obj(text: &[u8], poll: &Poll<'_>) -> bool {
    let mut words = Lines::new(text, 1, poll).filter_map(|line| line.tokens().next()).filter(|word| !word.starts_with(b"#"));
    words.next().map_or(text.starts_with(b"#"), |word| OBJ_KEYWORDS.contains(&word))
}

/// Returns true if the beginning has no control characters other than white space.
fn is_text(bytes: &[u8]) -> bool {
    const PROBED_BYTES: usize = 1024;
    bytes.iter().take(PROBED_BYTES).all(|&b| b >= 0x20 && b != 0x7f || b.is_ascii_whitespace())
}
