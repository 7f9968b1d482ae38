//! Strict reading of JSON: what is wrong, and at which JSON pointer (RFC 6901).

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path, Segment};

/// Reason for which a document is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseError {
    /// It is no JSON.
    #[error("{0}")]
    Syntax(String),
    /// It is JSON, of another shape.
    #[error("{pointer}: {detail}")]
    Shape {
        /// Where.
        pointer: String,
        /// Description of the value that was expected.
        detail: String,
    },
}

/// Reads one JSON document and nothing after it.
///
/// # Errors
/// [`ParseError`].
pub fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ParseError> {
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| refuse(bytes, &error))?;
    deserializer.end().map_err(|error| ParseError::Syntax(error.to_string()))?;
    Ok(value)
}

fn refuse(bytes: &[u8], error: &serde_path_to_error::Error<serde_json::Error>) -> ParseError {
    let inner = error.inner();
    // A list that is too long, or a number too large, counts as a fault of syntax with serde_json, though it is JSON.
    let is_json = inner.is_data() || serde_json::from_slice::<serde::de::IgnoredAny>(bytes).is_ok();
    if !is_json {
        return ParseError::Syntax(inner.to_string());
    }
    let detail = inner.to_string();
    let detail = if detail.starts_with("trailing characters") { "has too many elements".to_owned() } else { detail };
    ParseError::Shape { pointer: pointer_of(error.path()), detail }
}

/// The JSON pointer of a path.
#[must_use]
pub fn pointer_of(path: &Path) -> String {
    path.iter().fold(String::new(), |pointer, segment| match segment {
        Segment::Seq { index } => format!("{pointer}/{index}"),
        Segment::Map { key } => format!("{pointer}/{}", escape(key)),
        Segment::Enum { variant } => format!("{pointer}/{}", escape(variant)),
        Segment::Unknown => pointer,
    })
}

fn escape(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}
