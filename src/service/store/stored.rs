//! Stored JSON of this or an earlier version of the program. Documents are marked with the [`VERSION`] that wrote them; a field
//! that this version no longer knows is ignored and reported, so that an upgrade does not lose jobs.

use serde::de::DeserializeOwned;
use serde_json::Value;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use crate::wire::{ParseError, decode, parse};

/// Format version of the documents that this program writes. A change that lenient reading cannot handle increments it and
/// adds a migration of older documents.
pub(super) const VERSION: i64 = 1;

/// Max unknown fields; beyond that a document counts as unreadable.
const MAX_UNKNOWN: usize = 64;

/// Text in a column, or the reason why it cannot be read: damaged bytes are no text.
pub(super) fn text(row: &SqliteRow, column: &str) -> Result<String, String> {
    row.try_get(column).map_err(|error| error.to_string())
}

/// Reads stored JSON of a version; also returns the JSON pointers of the unknown fields that were ignored. If the version was
/// not stored, 0 stands for any.
///
/// # Errors
/// The reason why the document cannot be read.
pub(crate) fn read_leniently<T: DeserializeOwned>(version: i64, text: &str) -> Result<(T, Vec<String>), String> {
    if version > VERSION {
        return Err(format!("it was stored by a later version of the program (format {version}, known are up to {VERSION})"));
    }
    let error = match parse(text.as_bytes()) {
        Ok(value) => return Ok((value, Vec::new())),
        Err(error) => error,
    };
    let mut document: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let (mut error, mut unknown) = (error, Vec::new());
    while unknown.len() < MAX_UNKNOWN {
        let pointer = match &error {
            ParseError::Shape(error) if error.detail.starts_with("unknown field") => error.pointer.clone(),
            ParseError::Shape(_) | ParseError::Syntax(_) => return Err(error.to_string()),
        };
        if !remove_field(&mut document, &pointer) {
            break;
        }
        unknown.push(pointer);
        match decode(&document) {
            Ok(value) => return Ok((value, unknown)),
            Err(next) => error = next.into(),
        }
    }
    Err(error.to_string())
}

/// Removes the field at a JSON pointer from its object.
fn remove_field(document: &mut Value, pointer: &str) -> bool {
    let Some((parent, field)) = pointer.rsplit_once('/') else { return false };
    let field = field.replace("~1", "/").replace("~0", "~");
    let parent = document.pointer_mut(parent).and_then(Value::as_object_mut);
    parent.is_some_and(|parent| parent.remove(&field).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::BodySpec;

    #[test]
    fn an_unknown_field_is_ignored_in_a_structure_and_in_a_variant() {
        let text = r#"{"name": "post", "colour": 1, "shape": {"kind": "box", "size_mm": [1, 2, 3], "texture": 1}}"#;
        let (body, unknown) = read_leniently::<BodySpec>(VERSION, text).expect("readable");
        assert_eq!((body.name.as_str(), unknown), ("post", vec!["/colour".to_owned(), "/shape/texture".to_owned()]));
    }
}
