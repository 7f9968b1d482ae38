//! Strict parsing of JSON; errors name the JSON pointer at fault (RFC 6901).

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path, Segment};
use utoipa::ToSchema;

use super::shape::{lists_for_objects, refused};
use crate::cell::FieldError;

use crate::cell::with_suggestion;

/// Reason for which a document is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseError {
    /// The text is not valid JSON.
    #[error("{0}")]
    Syntax(String),
    /// The JSON is valid, but of another shape than expected.
    #[error("{pointer}: {detail}")]
    Shape {
        /// JSON pointer of the value.
        pointer: String,
        /// Description of the fault.
        detail: String,
    },
}

/// Parses one JSON document of a client; anything after it is an error.
///
/// # Errors
/// [`ParseError`]; for a document of another shape every field that is missing or unknown.
pub fn parse_document<T: DeserializeOwned + ToSchema + 'static>(bytes: &[u8]) -> Result<T, Vec<ParseError>> {
    let parsed = parse(bytes).and_then(|document| {
        // Where there is no list, none stands for an object.
        let value = bytes.contains(&b'[').then(|| serde_json::from_slice(bytes).ok()).flatten();
        let lists = value.map(|value| lists_for_objects::<T>(&value)).unwrap_or_default();
        match lists.into_iter().next() {
            Some(FieldError { pointer, detail }) => Err(ParseError::Shape { pointer, detail }),
            None => Ok(document),
        }
    });
    parsed.map_err(|error| match (error, serde_json::from_slice(bytes)) {
        (ParseError::Shape { pointer, detail }, Ok(value)) => {
            let findings = refused::<T>(&value, FieldError { pointer, detail });
            findings.into_iter().map(|FieldError { pointer, detail }| ParseError::Shape { pointer, detail }).collect()
        }
        (error, _) => vec![error],
    })
}

/// Parses one JSON document; anything after it is an error.
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
    // serde_json reports a list that is too long, or a number too large, as a syntax error, though the text is JSON.
    let is_json = inner.is_data() || serde_json::from_slice::<serde::de::IgnoredAny>(bytes).is_ok();
    if !is_json {
        return ParseError::Syntax(inner.to_string());
    }
    let detail = with_suggestion(&inner.to_string());
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
