//! A [`Preview`] as binary glTF 2.0 (Khronos, *glTF 2.0 Specification*, 2021, chapters 3 and 4.4). Positions are in the
//! part's own millimetres; the single node converts them to metres and +Y up as glTF requires, so that any viewer shows the
//! part upright and to scale.
//!
//! Link to the uploaded file: `meshes[0].primitives[0].extras.source_faces` names two scalar accessors. Face `i` of the
//! preview stands for the file's faces `faces[offsets[i] .. offsets[i + 1]]`.

use serde_json::{Value, json};

use super::Preview;

const GLB_MAGIC: &[u8; 4] = b"glTF";
const GLB_VERSION: u32 = 2;
const CHUNK_JSON: &[u8; 4] = b"JSON";
const CHUNK_BIN: &[u8; 4] = b"BIN\0";
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Column-major matrix from millimetres and +z up to metres and +y up.
const METRES_Y_UP: [f64; 16] = [0.001, 0.0, 0.0, 0.0, 0.0, 0.0, -0.001, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Bytes of a `.glb` file; equal previews give equal bytes.
#[must_use]
pub fn glb(preview: &Preview) -> Vec<u8> {
    let mut binary = Vec::new();
    let lengths = [
        append(&mut binary, preview.positions_mm.iter().flatten().map(|c| c.to_le_bytes())),
        append(&mut binary, preview.faces.iter().flatten().map(|v| v.to_le_bytes())),
        append(&mut binary, preview.source_faces.offsets.iter().map(|o| o.to_le_bytes())),
        append(&mut binary, preview.source_faces.faces.iter().map(|f| f.to_le_bytes())),
    ];
    let document = if preview.faces.is_empty() { empty_document() } else { document(preview, lengths) };
    container(document.to_string().into_bytes(), binary)
}

/// Appends four-byte components; returns their length in bytes.
fn append(binary: &mut Vec<u8>, components: impl Iterator<Item = [u8; 4]>) -> usize {
    let before = binary.len();
    binary.extend(components.flatten());
    binary.len() - before
}

/// Document of an empty mesh: glTF does not allow accessors of length 0.
fn empty_document() -> Value {
    json!({ "asset": asset(), "scene": 0, "scenes": [{}] })
}

fn asset() -> Value {
    json!({ "version": "2.0", "generator": "vantage" })
}

fn document(preview: &Preview, lengths: [usize; 4]) -> Value {
    let (low, high) = bounds(&preview.positions_mm);
    json!({
        "asset": asset(),
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "part", "mesh": 0, "matrix": METRES_Y_UP }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0 },
            "indices": 1,
            "material": 0,
            "extras": { "source_faces": { "offsets": 2, "faces": 3 } },
        }] }],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": { "baseColorFactor": [0.7, 0.71, 0.73, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8 },
        }],
        "accessors": [
            { "bufferView": 0, "componentType": FLOAT, "type": "VEC3", "count": lengths[0] / 12, "min": low, "max": high },
            { "bufferView": 1, "componentType": UNSIGNED_INT, "type": "SCALAR", "count": lengths[1] / 4 },
            { "bufferView": 2, "componentType": UNSIGNED_INT, "type": "SCALAR", "count": lengths[2] / 4 },
            { "bufferView": 3, "componentType": UNSIGNED_INT, "type": "SCALAR", "count": lengths[3] / 4 },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": lengths[0], "target": ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": lengths[0], "byteLength": lengths[1], "target": ELEMENT_ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": lengths[0] + lengths[1], "byteLength": lengths[2] },
            { "buffer": 0, "byteOffset": lengths[0] + lengths[1] + lengths[2], "byteLength": lengths[3] },
        ],
        "buffers": [{ "byteLength": lengths.iter().sum::<usize>() }],
    })
}

fn bounds(positions_mm: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let join = |(mut low, mut high): ([f32; 3], [f32; 3]), p: &[f32; 3]| {
        for axis in 0..3 {
            low[axis] = low[axis].min(p[axis]);
            high[axis] = high[axis].max(p[axis]);
        }
        (low, high)
    };
    positions_mm.iter().fold(([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]), join)
}

/// GLB container: header, JSON chunk padded with spaces, binary chunk padded with zeros, each to a multiple of four bytes.
fn container(mut json: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let binary_chunk = if binary.is_empty() { 0 } else { 8 + binary.len() };
    let total = 12 + 8 + json.len() + binary_chunk;
    let mut bytes = Vec::with_capacity(total);
    bytes.extend(GLB_MAGIC);
    bytes.extend(GLB_VERSION.to_le_bytes());
    bytes.extend((total as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(CHUNK_JSON);
    bytes.extend(json);
    if !binary.is_empty() {
        bytes.extend((binary.len() as u32).to_le_bytes());
        bytes.extend(CHUNK_BIN);
        bytes.extend(binary);
    }
    bytes
}
