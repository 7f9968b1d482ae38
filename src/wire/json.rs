//! Strict parsing of JSON; errors name the JSON pointer at fault (RFC 6901).

use std::fmt;

use serde::de::{self, DeserializeOwned, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::map::Entry;
use serde_json::{Map, Number, Value};
use serde_path_to_error::{Path, Segment};
use utoipa::ToSchema;

use super::shape::{lists_for_objects, refused};
use crate::cell::{FieldError, with_suggestion};

/// Reason for which a document is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseError {
    /// The text is not valid JSON.
    #[error("{0}")]
    Syntax(String),
    /// The JSON is valid, but of another shape than expected.
    #[error("{0}")]
    Shape(FieldError),
}

impl From<FieldError> for ParseError {
    fn from(error: FieldError) -> Self {
        Self::Shape(error)
    }
}

/// Parses one JSON document of a client; anything after it is an error.
///
/// # Errors
/// [`ParseError`]; for a document of another shape every field that is missing or unknown.
pub fn parse_document<T: DeserializeOwned + ToSchema + 'static>(bytes: &[u8]) -> Result<T, Vec<ParseError>> {
    let value = json_value(bytes).map_err(|error| vec![error])?;
    let decoded = decode(&value).and_then(|document| match lists_for_objects::<T>(&value).into_iter().next() {
        Some(error) => Err(error),
        None => Ok(document),
    });
    decoded.map_err(|first| refused::<T>(&value, first).into_iter().map(ParseError::from).collect())
}

/// Parses one JSON document; anything after it is an error.
///
/// # Errors
/// [`ParseError`].
pub fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ParseError> {
    Ok(decode(&json_value(bytes)?)?)
}

/// Converts a value to `T`. Every document is read by way of a value, so that a type is compiled for one source of its fields.
///
/// # Errors
/// The first fault, of the fields of an object in the order of their names.
pub fn decode<T: DeserializeOwned>(value: &Value) -> Result<T, FieldError> {
    serde_path_to_error::deserialize(value)
        .map_err(|error| FieldError { pointer: pointer_of(error.path()), detail: with_suggestion(&error.inner().to_string()) })
}

/// Parses the text of a document, each object of which has every field once.
fn json_value(bytes: &[u8]) -> Result<Value, ParseError> {
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let Distinct(value) = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| refuse(bytes, &error))?;
    deserializer.end().map_err(|error| ParseError::Syntax(error.to_string()))?;
    Ok(value)
}

fn refuse(bytes: &[u8], error: &serde_path_to_error::Error<serde_json::Error>) -> ParseError {
    let inner = error.inner();
    // serde_json reports a number too large and text nested too deep as syntax errors, though they are JSON.
    let is_json = inner.is_data() || serde_json::from_slice::<IgnoredAny>(bytes).is_ok();
    if !is_json {
        return ParseError::Syntax(inner.to_string());
    }
    ParseError::Shape(FieldError { pointer: pointer_of(error.path()), detail: inner.to_string() })
}

/// Value of a document. A field that an object has twice is an error, of which [`Value`] keeps the last; so is a number of TOML
/// that is not finite, which becomes `null` in [`Value`].
pub(crate) struct Distinct(pub(crate) Value);

impl<'de> Deserialize<'de> for Distinct {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(DistinctVisitor).map(Self)
    }
}

struct DistinctVisitor;

impl<'de> Visitor<'de> for DistinctVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E: de::Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E: de::Error>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Value, E> {
        Number::from_f64(value).map(Value::Number).ok_or_else(|| E::custom(format_args!("{value} is not a finite number")))
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(Distinct(item)) = items.next_element()? {
            list.push(item);
        }
        Ok(Value::Array(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some((name, Distinct(value))) = fields.next_entry::<String, _>()? {
            match object.entry(name) {
                Entry::Vacant(place) => place.insert(value),
                Entry::Occupied(place) => {
                    return Err(de::Error::custom(format_args!("duplicate field `{}`", place.key())));
                }
            };
        }
        Ok(Value::Object(object))
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

/// A key as a token of a JSON pointer.
pub(super) fn escape(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}
