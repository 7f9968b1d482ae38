//! Deserializer of a JSON value, whose errors tell where in the value they are. It gives a type the same calls as that of `serde_json`
//! does, without a layer around the visitor of each type: such layers were a twentieth of the program.

use std::fmt::{self, Display};

use serde::de::value::BorrowedStrDeserializer;
use serde::de::{
    self, DeserializeOwned, DeserializeSeed, Deserializer, EnumAccess, MapAccess, SeqAccess, VariantAccess, Visitor,
};
use serde::forward_to_deserialize_any;
use serde_json::{Map, Value};

use super::json::escape;

/// Reads a value of type `T`.
///
/// # Errors
/// The first fault, with its JSON pointer.
pub(super) fn read<T: DeserializeOwned>(value: &Value) -> Result<T, LocatedFault> {
    T::deserialize(Located(value))
}

/// LocatedFault of a value.
#[derive(Debug)]
pub(super) struct LocatedFault {
    /// JSON pointer (RFC 6901) of what is wrong; empty for the whole value.
    pub(super) pointer: String,
    /// Words of the type that was to be read.
    pub(super) detail: String,
}

impl LocatedFault {
    /// The fault, seen from the object or list that has the faulty value at `token`.
    fn below(mut self, token: &str) -> Self {
        self.pointer.insert_str(0, &format!("/{}", escape(token)));
        self
    }
}

impl Display for LocatedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.detail)
    }
}

impl std::error::Error for LocatedFault {}

impl de::Error for LocatedFault {
    fn custom<D: Display>(detail: D) -> Self {
        Self { pointer: String::new(), detail: detail.to_string() }
    }

    // The words of serde_json, for which there is a null.
    fn invalid_type(found: de::Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        Self::custom(serde_json::Error::invalid_type(found, expected))
    }

    fn invalid_value(found: de::Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        Self::custom(serde_json::Error::invalid_value(found, expected))
    }
}

/// Methods that take values of the kinds that `serde_json` takes there, and no others: some visitors take more, such as the number of a
/// variant in the place of its name.
macro_rules! of_kind {
    ($($kind:pat => $($method:ident $(($($argument:ident: $type:ty),+))?),+;)+) => {
        $($(fn $method<V: Visitor<'de>>(self, $($($argument: $type,)+)? visitor: V) -> Result<V::Value, LocatedFault> {
            let is_of_kind = matches!(self.0, $kind);
            if is_of_kind { self.deserialize_any(visitor) } else { Err(de::Error::invalid_type(unexpected(self.0), &visitor)) }
        })+)+
    };
}

/// A value to be read.
struct Located<'de>(&'de Value);

impl<'de> Deserializer<'de> for Located<'de> {
    type Error = LocatedFault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, LocatedFault> {
        match self.0 {
            Value::Null => visitor.visit_unit(),
            Value::Bool(value) => visitor.visit_bool(*value),
            Value::Number(number) => match (number.as_u64(), number.as_i64()) {
                (Some(whole), _) => visitor.visit_u64(whole),
                (None, Some(negative)) => visitor.visit_i64(negative),
                (None, None) => visitor.visit_f64(number.as_f64().unwrap_or(f64::NAN)),
            },
            Value::String(text) => visitor.visit_borrowed_str(text),
            Value::Array(items) => read_list(items, visitor),
            Value::Object(fields) => read_object(fields, visitor),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, LocatedFault> {
        if self.0.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _name: &'static str, visitor: V) -> Result<V::Value, LocatedFault> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, LocatedFault> {
        if let Value::String(name) = self.0 {
            return visitor.visit_enum(Variant { name, value: None });
        }
        let Value::Object(fields) = self.0 else { return Err(de::Error::invalid_type(unexpected(self.0), &"string or map")) };
        match (fields.iter().next(), fields.len()) {
            (Some((name, value)), 1) => visitor.visit_enum(Variant { name, value: Some(value) }),
            _ => Err(de::Error::invalid_value(de::Unexpected::Map, &"map with a single key")),
        }
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, LocatedFault> {
        visitor.visit_unit()
    }

    of_kind! {
        Value::Null => deserialize_unit, deserialize_unit_struct(_name: &'static str);
        Value::Bool(_) => deserialize_bool;
        Value::Number(_) => deserialize_i8, deserialize_i16, deserialize_i32, deserialize_i64, deserialize_i128, deserialize_u8,
            deserialize_u16, deserialize_u32, deserialize_u64, deserialize_u128, deserialize_f32, deserialize_f64;
        Value::String(_) => deserialize_char, deserialize_str, deserialize_string, deserialize_identifier;
        Value::String(_) | Value::Array(_) => deserialize_bytes, deserialize_byte_buf;
        Value::Array(_) => deserialize_seq, deserialize_tuple(_len: usize),
            deserialize_tuple_struct(_name: &'static str, _len: usize);
        Value::Object(_) => deserialize_map;
        Value::Array(_) | Value::Object(_) => deserialize_struct(_name: &'static str, _fields: &'static [&'static str]);
    }
}

fn read_list<'de, V: Visitor<'de>>(items: &'de [Value], visitor: V) -> Result<V::Value, LocatedFault> {
    let mut list = List { items: items.iter(), next: 0 };
    let read = visitor.visit_seq(&mut list)?;
    if list.items.len() == 0 { Ok(read) } else { Err(de::Error::invalid_length(items.len(), &"fewer elements in array")) }
}

fn read_object<'de, V: Visitor<'de>>(fields: &'de Map<String, Value>, visitor: V) -> Result<V::Value, LocatedFault> {
    let mut object = Object { fields: fields.iter(), field: None };
    let read = visitor.visit_map(&mut object)?;
    if object.fields.len() == 0 { Ok(read) } else { Err(de::Error::invalid_length(fields.len(), &"fewer elements in map")) }
}

fn unexpected(value: &Value) -> de::Unexpected<'_> {
    match value {
        Value::Null => de::Unexpected::Unit,
        Value::Bool(value) => de::Unexpected::Bool(*value),
        Value::Number(number) => match (number.as_u64(), number.as_i64()) {
            (Some(whole), _) => de::Unexpected::Unsigned(whole),
            (None, Some(negative)) => de::Unexpected::Signed(negative),
            (None, None) => de::Unexpected::Float(number.as_f64().unwrap_or(f64::NAN)),
        },
        Value::String(text) => de::Unexpected::Str(text),
        Value::Array(_) => de::Unexpected::Seq,
        Value::Object(_) => de::Unexpected::Map,
    }
}

/// Items of a list.
struct List<'de> {
    items: std::slice::Iter<'de, Value>,
    /// Place of the next item.
    next: usize,
}

impl<'de> SeqAccess<'de> for List<'de> {
    type Error = LocatedFault;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, LocatedFault> {
        let Some(item) = self.items.next() else { return Ok(None) };
        let place = self.next;
        self.next += 1;
        seed.deserialize(Located(item)).map(Some).map_err(|fault| fault.below(&place.to_string()))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.items.len())
    }
}

/// Fields of an object.
struct Object<'de> {
    fields: serde_json::map::Iter<'de>,
    /// Field whose name was read last.
    field: Option<(&'de str, &'de Value)>,
}

impl<'de> MapAccess<'de> for Object<'de> {
    type Error = LocatedFault;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, LocatedFault> {
        let Some((name, value)) = self.fields.next() else { return Ok(None) };
        self.field = Some((name, value));
        seed.deserialize(Name(name)).map(Some).map_err(|fault| fault.below(name))
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, LocatedFault> {
        let (name, value) = self.field.take().ok_or_else(|| de::Error::custom("a value was asked for before its name"))?;
        seed.deserialize(Located(value)).map_err(|fault| fault.below(name))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.fields.len())
    }
}

/// Name of a field.
struct Name<'de>(&'de str);

impl<'de> Deserializer<'de> for Name<'de> {
    type Error = LocatedFault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, LocatedFault> {
        visitor.visit_borrowed_str(self.0)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, LocatedFault> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _name: &'static str, visitor: V) -> Result<V::Value, LocatedFault> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, LocatedFault> {
        BorrowedStrDeserializer::new(self.0).deserialize_enum(name, variants, visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple tuple_struct map
        struct identifier ignored_any
    }
}

/// Variant of an enum, with the value that belongs to it.
struct Variant<'de> {
    name: &'de str,
    value: Option<&'de Value>,
}

impl<'de> EnumAccess<'de> for Variant<'de> {
    type Error = LocatedFault;
    type Variant = Self;

    fn variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<(T::Value, Self), LocatedFault> {
        Ok((seed.deserialize(BorrowedStrDeserializer::<LocatedFault>::new(self.name))?, self))
    }
}

impl<'de> Variant<'de> {
    /// Reads the variant's value; `kind` is what it is expected to be.
    fn read<T>(self, kind: &'static str, read: impl FnOnce(&'de Value) -> Result<T, LocatedFault>) -> Result<T, LocatedFault> {
        let missing = || de::Error::invalid_type(de::Unexpected::UnitVariant, &kind);
        self.value.ok_or_else(missing).and_then(read).map_err(|fault: LocatedFault| fault.below(self.name))
    }
}

impl<'de> VariantAccess<'de> for Variant<'de> {
    type Error = LocatedFault;

    fn unit_variant(self) -> Result<(), LocatedFault> {
        match self.value {
            Some(_) => self.read("unit variant", |value| de::Deserialize::deserialize(Located(value))),
            None => Ok(()),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, LocatedFault> {
        self.read("newtype variant", |value| seed.deserialize(Located(value)))
    }

    fn tuple_variant<V: Visitor<'de>>(self, _len: usize, visitor: V) -> Result<V::Value, LocatedFault> {
        self.read("tuple variant", |value| match value.as_array() {
            Some(items) => read_list(items, visitor),
            None => Err(de::Error::invalid_type(unexpected(value), &"tuple variant")),
        })
    }

    fn struct_variant<V: Visitor<'de>>(self, _fields: &'static [&'static str], visitor: V) -> Result<V::Value, LocatedFault> {
        self.read("struct variant", |value| match value.as_object() {
            Some(fields) => read_object(fields, visitor),
            None => Err(de::Error::invalid_type(unexpected(value), &"struct variant")),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::Deserialize;
    use serde_json::json;

    use super::*;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Part {
        name: String,
        edge_mm: f64,
        #[serde(default)]
        count: Option<u8>,
        shape: Option<Shape>,
        #[serde(default)]
        pairs: Vec<(u8, char)>,
        #[serde(default)]
        named: BTreeMap<String, Colour>,
        #[serde(default)]
        anything: Map<String, Value>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(tag = "kind", rename_all = "snake_case")]
    enum Shape {
        Ball { radius_mm: f64 },
        Box(Edges),
    }

    #[derive(Debug, PartialEq, Deserialize)]
    struct Edges([f64; 3]);

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Colour {
        Red,
        Mixed(u8, u8),
        Named { name: String },
        Grey(f64),
    }

    /// Documents in which each value is replaced in turn by one of each kind.
    fn spoiled(value: &Value, others: &[Value]) -> Vec<Value> {
        let below = |put: &dyn Fn(Value) -> Value, inner: &Value| spoiled(inner, others).into_iter().map(put).collect::<Vec<_>>();
        let mut all = others.to_vec();
        match value {
            Value::Array(items) => (0..items.len()).for_each(|place| {
                let put = |new: Value| {
                    let mut items = items.clone();
                    items[place] = new;
                    Value::Array(items)
                };
                all.extend(below(&put, &items[place]));
            }),
            Value::Object(fields) => fields.iter().for_each(|(name, inner)| {
                let put = |new: Value| {
                    let mut fields = fields.clone();
                    fields.insert(name.clone(), new);
                    Value::Object(fields)
                };
                all.extend(below(&put, inner));
            }),
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
        }
        all
    }

    #[test]
    fn what_is_read_and_what_is_refused_is_what_serde_json_and_its_paths_tell() {
        let whole = json!({
            "name": "flange", "edge_mm": 12.5, "count": 3, "shape": {"kind": "ball", "radius_mm": 4}, "pairs": [[1, "a"], [2, "b"]],
            "named": {"a": "red", "c": {"named": {"name": "x"}}, "d": {"grey": 0.5}}, "anything": {"x": [1]},
        });
        let others = [
            Value::Null,
            json!(true),
            json!(0),
            json!(-7),
            json!(300),
            json!(0.5),
            json!("red"),
            json!("ball"),
            json!([]),
            json!([1, 2, 3]),
            json!({}),
            json!({"red": null}),
            json!({"a": 1, "b": 2}),
            json!({"unknown/~": 1}),
            json!({"kind": "box"}),
        ];
        let documents = spoiled(&whole, &others);
        assert!(documents.len() > 300);
        let mut refused = 0;
        for document in std::iter::once(&whole).chain(&documents) {
            let expected: Result<Part, _> = serde_path_to_error::deserialize(document);
            match (read::<Part>(document), expected) {
                (Ok(read), Ok(expected)) => assert_eq!(read, expected, "{document}"),
                (Err(fault), Err(error)) => {
                    let pointer = super::super::json::pointer_of(error.path());
                    assert_eq!((fault.detail, fault.pointer), (error.inner().to_string(), pointer), "{document}");
                    refused += 1;
                }
                (read, expected) => panic!("{document}: {read:?}, {expected:?}"),
            }
        }
        assert!(refused > 200, "{refused}");
        // Of an empty list serde_json tells that it is null.
        let mixed = |numbers: Value| read::<Colour>(&json!({"mixed": numbers})).map_err(|fault| (fault.pointer, fault.detail));
        assert_eq!(mixed(json!([1, 2])), Ok(Colour::Mixed(1, 2)));
        let told = "invalid length 0, expected tuple variant Colour::Mixed with 2 elements".to_owned();
        assert_eq!(mixed(json!([])), Err(("/mixed".to_owned(), told)));
    }
}
