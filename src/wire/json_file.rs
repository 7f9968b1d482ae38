//! Bytes of a JSON document in a file.

use serde::Serialize;

/// Indented JSON with a newline at the end.
///
/// # Panics
/// Never for the documents of this crate: structs whose map keys are strings always serialise.
#[must_use]
pub fn json_file_bytes(document: &impl Serialize) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(document).expect("plain structs with string keys serialise");
    bytes.push(b'\n');
    bytes
}
