//! JSON that this or an earlier version of the program stored. What a version writes is marked with [`VERSION`]; a field
//! that this version does not know any more is left out and named, so that an upgrade loses no job.

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::wire::{ParseError, parse};

/// Version of the stored shapes that this program writes. A change that reading leniently cannot bridge raises it and
/// adds a step that brings the older document to it.
pub(super) const VERSION: i64 = 1;

/// Fields left out before a document counts as unreadable.
const MAX_LEFT_OUT: usize = 64;

/// Reads stored JSON of a version; also returns the JSON pointers of fields that were left out. Where the version was not
/// stored, 0 stands for any.
///
/// # Errors
/// Why it cannot be read.
pub(crate) fn read_leniently<T: DeserializeOwned>(version: i64, text: &str) -> Result<(T, Vec<String>), String> {
    if version > VERSION {
        return Err(format!("it was stored by a later version of the program (shape {version}, known are up to {VERSION})"));
    }
    let error = match parse(text.as_bytes()) {
        Ok(value) => return Ok((value, Vec::new())),
        Err(error) => error,
    };
    let mut document: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let (mut error, mut left_out) = (error, Vec::new());
    while left_out.len() < MAX_LEFT_OUT {
        let pointer = match &error {
            ParseError::Shape { pointer, detail } if detail.starts_with("unknown field") => pointer.clone(),
            other => return Err(other.to_string()),
        };
        if !leave_out(&mut document, &pointer) {
            break;
        }
        left_out.push(pointer);
        match parse(document.to_string().as_bytes()) {
            Ok(value) => return Ok((value, left_out)),
            Err(next) => error = next,
        }
    }
    Err(error.to_string())
}

/// Takes the field at a JSON pointer out of its object.
fn leave_out(document: &mut Value, pointer: &str) -> bool {
    let Some((parent, field)) = pointer.rsplit_once('/') else { return false };
    let field = field.replace("~1", "/").replace("~0", "~");
    let parent = document.pointer_mut(parent).and_then(Value::as_object_mut);
    parent.is_some_and(|parent| parent.remove(&field).is_some())
}
