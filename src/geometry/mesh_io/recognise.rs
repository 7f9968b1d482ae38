//! Which format a file is in, by its content; file names lie and uploads have none.

use super::MeshFormat;
use super::error::MeshError;
use super::stl_binary;
use super::text::{Lines, Tokens};
use crate::geometry::poll::Poll;

const UNPACK: &str = "unpack it and give the mesh itself";
const EXPORT: &str = "export the part as STL, OBJ or PLY";

/// First bytes of formats that users are likely to try.
const NOT_READ: [(&[u8], &str, &str); 14] = [
    (b"\x1f\x8b", "a gzip archive", UNPACK),
    (b"BZh", "a bzip2 archive", UNPACK),
    (b"\xfd7zXZ", "an xz archive", UNPACK),
    (b"\x28\xb5\x2f\xfd", "a zstd archive", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (b"PK\x03\x04", "a zip archive (3MF is one)", EXPORT),
    (b"glTF", "binary glTF", EXPORT),
    (b"{", "JSON (glTF is written in it)", EXPORT),
    (b"ISO-10303-21", "STEP", EXPORT),
    (b"OFF", "OFF", EXPORT),
    (b"COFF", "OFF", EXPORT),
    (b"<", "XML (AMF, X3D or COLLADA)", EXPORT),
    (b"#VRML", "VRML", EXPORT),
    (b"Kaydara FBX", "FBX", EXPORT),
];

/// Keywords that begin lines of OBJ files. Only used to tell OBJ from other text; the reader itself is more tolerant.
const OBJ_KEYWORDS: [&[u8]; 15] =
    [b"v", b"vt", b"vn", b"vp", b"f", b"l", b"p", b"g", b"o", b"s", b"mg", b"mtllib", b"usemtl", b"maplib", b"usemap"];

/// Format of `text`, which has no byte order mark any more.
///
/// # Errors
/// [`MeshError::FormatNotRead`] for formats we know but do not read, [`MeshError::UnknownFormat`] for the rest.
pub(super) fn recognise(text: &[u8], poll: &Poll<'_>) -> Result<MeshFormat, MeshError> {
    // A length that fits the count to the byte is the one mark that a binary STL has, whatever its 80 bytes of header say.
    if stl_binary::length_fits(text, text.len() as u64) {
        return Ok(MeshFormat::StlBinary);
    }
    let start = &text[poll.position(text, |byte| !byte.is_ascii_whitespace()).unwrap_or(text.len())..];
    if let Some((_, format, advice)) = NOT_READ.iter().find(|(magic, ..)| start.starts_with(magic)) {
        return Err(MeshError::FormatNotRead { format, advice });
    }
    match Tokens::of(start, poll).next().unwrap_or_default() {
        b"ply" => Ok(MeshFormat::Ply),
        word if word.eq_ignore_ascii_case(b"solid") && is_ascii_stl(start, poll) => Ok(MeshFormat::StlAscii),
        _ if poll.position(text, |byte| *byte == 0).is_none() && is_obj(text, poll) => Ok(MeshFormat::Obj),
        _ if !is_text(text) => Ok(MeshFormat::StlBinary),
        _ => Err(MeshError::UnknownFormat),
    }
}

/// Binary files may begin with `solid` too; theirs has no word of the grammar on the next line that is not blank.
fn is_ascii_stl(text: &[u8], poll: &Poll<'_>) -> bool {
    let second = Lines::new(text, 1, poll).skip(1).find_map(|line| line.tokens().next());
    second.is_none_or(|word| {
        [&b"facet"[..], b"endsolid", b"solid"].iter().any(|keyword| word.eq_ignore_ascii_case(keyword)) || is_text(text)
    })
}

/// Text whose first line with content begins like OBJ; only comments are an OBJ file without a surface.
fn is_obj(text: &[u8], poll: &Poll<'_>) -> bool {
    let mut words = Lines::new(text, 1, poll).filter_map(|line| line.tokens().next()).filter(|word| !word.starts_with(b"#"));
    words.next().map_or(text.starts_with(b"#"), |word| OBJ_KEYWORDS.contains(&word))
}

/// No control characters but white space in the beginning.
fn is_text(bytes: &[u8]) -> bool {
    const LOOKED_AT: usize = 1024;
    bytes.iter().take(LOOKED_AT).all(|&b| b >= 0x20 && b != 0x7f || b.is_ascii_whitespace())
}
