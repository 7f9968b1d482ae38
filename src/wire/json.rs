//! Strict parsing of JSON; errors name the JSON pointer at fault (RFC 6901).

use std::fmt;

use serde::de::{self, DeserializeOwned, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::map::Entry;
use serde_json::{Map, Number, Value};
use serde_path_to_error::{Path, Segment};
use utoipa::ToSchema;

use super::json_fault::in_plain_words;
use super::located;
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
    decoded.map_err(|first| {
        let value = with_whole_numbers(&value).unwrap_or(value);
        refused::<T>(&value, first).into_iter().map(ParseError::from).collect()
    })
}

/// Parses one JSON document; anything after it is an error.
///
/// # Errors
/// [`ParseError`].
pub fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ParseError> {
    Ok(decode(&json_value(bytes)?)?)
}

/// Converts a value to `T`. Every document is read by way of a value, so that a type is compiled for one source of its fields. Where
/// that fails, numbers without a fraction are taken for whole numbers: many programs write 5 as `5.0`, which is the same in JSON.
///
/// # Errors
/// The first fault, of the fields of an object in the order of their names.
pub fn decode<T: DeserializeOwned>(value: &Value) -> Result<T, FieldError> {
    decode_as_written(value).or_else(|error| match with_whole_numbers(value) {
        Some(value) => decode_as_written(&value),
        None => Err(error),
    })
}

fn decode_as_written<T: DeserializeOwned>(value: &Value) -> Result<T, FieldError> {
    located::read(value).map_err(|fault| {
        let detail = with_suggestion(&fault.detail);
        FieldError { pointer: unknown_field(value, fault.pointer, &detail), detail }
    })
}

/// The pointer of an unknown field, where serde tells that of the tagged enum which has it; any other pointer as it is.
fn unknown_field(value: &Value, pointer: String, detail: &str) -> String {
    let name = detail.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next()).map(escape);
    let inside = name.filter(|name| !pointer.ends_with(&format!("/{name}"))).map(|name| format!("{pointer}/{name}"));
    inside.filter(|inside| value.pointer(inside).is_some()).unwrap_or(pointer)
}

/// Parses the text of a document, each object of which has every field once.
fn json_value(bytes: &[u8]) -> Result<Value, ParseError> {
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let Distinct(value) = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| refuse(bytes, &error))?;
    deserializer.end().map_err(|error| ParseError::Syntax(json_error(bytes, &error)))?;
    Ok(value)
}

fn refuse(bytes: &[u8], error: &serde_path_to_error::Error<serde_json::Error>) -> ParseError {
    let inner = error.inner();
    // serde_json reports a number too large and text nested too deep as syntax errors, though they are JSON.
    let is_json = inner.is_data() || serde_json::from_slice::<IgnoredAny>(bytes).is_ok();
    if !is_json {
        return ParseError::Syntax(json_error(bytes, inner));
    }
    let detail = json_error(bytes, inner);
    let pointer = pointer_of(error.path());
    // Told of the object that has the field.
    let twice = name_given_twice(&detail).map(|name| format!("{pointer}/{}", escape(name)));
    ParseError::Shape(FieldError { pointer: twice.unwrap_or(pointer), detail })
}

/// End of the message on a field that an object or a table has twice.
pub(super) const GIVEN_TWICE: &str = "` is given twice: give it once";

/// The message on a field that an object or a table has twice.
pub(crate) fn given_twice(name: &str) -> String {
    format!("`{name}{GIVEN_TWICE}")
}

/// Name of the field that the message of [`given_twice`] is on; `None` for another message.
fn name_given_twice(detail: &str) -> Option<&str> {
    detail.strip_prefix('`')?.rsplit_once(GIVEN_TWICE).map(|(name, _)| name)
}

/// Describes the error that serde_json finds in a text, in plain words where it is one of the text's form.
pub(crate) fn json_error(bytes: &[u8], error: &serde_json::Error) -> String {
    in_plain_words(bytes, error).unwrap_or_else(|| error.to_string())
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
                    return Err(de::Error::custom(given_twice(place.key())));
                }
            };
        }
        Ok(Value::Object(object))
    }
}

/// The value with its numbers without a fraction as whole numbers; `None` where it has none of them.
fn with_whole_numbers(value: &Value) -> Option<Value> {
    fn convert(value: &mut Value) -> bool {
        match value {
            Value::Number(number) => {
                let whole = if number.is_f64() { number.as_f64().and_then(whole_number) } else { None };
                whole.map(|whole| *number = whole).is_some()
            }
            Value::Array(items) => items.iter_mut().fold(false, |any, item| convert(item) | any),
            Value::Object(fields) => fields.values_mut().fold(false, |any, field| convert(field) | any),
            Value::Null | Value::Bool(_) | Value::String(_) => false,
        }
    }
    let mut whole = value.clone();
    convert(&mut whole).then_some(whole)
}

/// The whole number that a float is; `None` beyond ±2⁵³, where it may be the rounding of another.
fn whole_number(value: f64) -> Option<Number> {
    const MAX_EXACT: f64 = 9_007_199_254_740_992.0;
    (value.fract() == 0.0 && value.abs() <= MAX_EXACT).then(|| Number::from(value as i64))
}

/// The JSON pointer of a path.
pub(super) fn pointer_of(path: &Path) -> String {
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
