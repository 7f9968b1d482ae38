//! Strict reading of JSON: what is wrong, and at which JSON pointer (RFC 6901).

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path, Segment};

/// Why a document is refused.
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
        /// What was expected.
        detail: String,
    },
}

/// Reads one JSON document and nothing after it.
///
/// # Errors
/// [`ParseError`].
pub fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ParseError> {
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| refuse(&error))?;
    deserializer.end().map_err(|error| ParseError::Syntax(error.to_string()))?;
    Ok(value)
}

fn refuse(error: &serde_path_to_error::Error<serde_json::Error>) -> ParseError {
    let inner = error.inner();
    if inner.is_data() {
        ParseError::Shape { pointer: pointer_of(error.path()), detail: inner.to_string() }
    } else {
        ParseError::Syntax(inner.to_string())
    }
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
