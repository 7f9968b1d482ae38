//! YAML, XML and JSON as one tree of values. Depth and size are bounded; aliases of YAML, which let a small file stand for a large
//! tree, are refused.

use std::fmt;

use saphyr_parser::{Event, Parser, ScalarStyle};
use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::error::Category;
use serde_json::{Map, Value};

use super::super::fault::{LensError, LensFault};
use crate::geometry::counted;

/// Deepest nesting.
const MAX_DEPTH: usize = 24;

fn unreadable(detail: impl Into<String>) -> LensError {
    LensError::new(LensFault::Unreadable, "", detail)
}

/// Reads JSON.
pub(super) fn json(text: &str) -> Result<Value, LensError> {
    let read = serde_json::from_str(text).map(|UniqueNames(value)| value);
    read.map_err(|error| match error.classify() {
        Category::Data => LensError::new(LensFault::Inconsistent, "", error.to_string()),
        Category::Io | Category::Syntax | Category::Eof => unreadable(format!("not JSON: {error}")),
    })
}

/// A value of which no table holds a name twice; of two, serde_json's own keeps the last.
struct UniqueNames(Value);

impl<'de> Deserialize<'de> for UniqueNames {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(UniqueNamesVisitor)
    }
}

struct UniqueNamesVisitor;

impl<'de> Visitor<'de> for UniqueNamesVisitor {
    type Value = UniqueNames;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<UniqueNames, E> {
        Ok(UniqueNames(Value::Null))
    }

    fn visit_bool<E>(self, value: bool) -> Result<UniqueNames, E> {
        Ok(UniqueNames(value.into()))
    }

    fn visit_i64<E>(self, value: i64) -> Result<UniqueNames, E> {
        Ok(UniqueNames(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<UniqueNames, E> {
        Ok(UniqueNames(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<UniqueNames, E> {
        Ok(UniqueNames(value.into()))
    }

    fn visit_str<E>(self, value: &str) -> Result<UniqueNames, E> {
        Ok(UniqueNames(value.into()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<UniqueNames, A::Error> {
        let mut list = Vec::new();
        while let Some(UniqueNames(value)) = values.next_element()? {
            list.push(value);
        }
        Ok(UniqueNames(list.into()))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<UniqueNames, A::Error> {
        let mut table = Map::new();
        while let Some((name, UniqueNames(value))) = entries.next_entry::<String, UniqueNames>()? {
            if table.contains_key(&name) {
                return Err(A::Error::custom(format!("`{name}` is given twice")));
            }
            table.insert(name, value);
        }
        Ok(UniqueNames(table.into()))
    }
}

/// Collection that is being read, with the key under which it goes into the one around it.
enum Open {
    List(Vec<Value>),
    Table(Map<String, Value>, Option<String>),
}

/// Reads YAML, the line `%YAML:1.0` of OpenCV before it aside.
pub(super) fn yaml(text: &str) -> Result<Value, LensError> {
    let body = if text.starts_with("%YAML") { text.split_once('\n').map_or("", |(_, body)| body) } else { text };
    let mut open: Vec<Open> = Vec::new();
    let mut root = None;
    for event in Parser::new_from_str(body) {
        let (event, span) = event.map_err(|error| unreadable(format!("not YAML: {error}")))?;
        let done = match event {
            Event::Alias(_) => {
                let detail = format!("line {}: aliases are not read; write the value out", span.start.line());
                return Err(unreadable(detail));
            }
            Event::SequenceStart(..) => {
                open.push(Open::List(Vec::new()));
                None
            }
            Event::MappingStart(..) => {
                open.push(Open::Table(Map::new(), None));
                None
            }
            Event::Scalar(text, style, ..) => Some(scalar(&text, style)),
            Event::SequenceEnd | Event::MappingEnd => open.pop().map(|closed| match closed {
                Open::List(list) => Value::Array(list),
                Open::Table(table, _) => Value::Object(table),
            }),
            Event::Nothing | Event::StreamStart | Event::StreamEnd | Event::DocumentStart(_) | Event::DocumentEnd => None,
        };
        if open.len() > MAX_DEPTH {
            return Err(LensError::new(LensFault::TooLarge, "", format!("nested deeper than {MAX_DEPTH}")));
        }
        let Some(value) = done else { continue };
        match open.last_mut() {
            None => root = root.or(Some(value)),
            Some(Open::List(list)) => list.push(value),
            Some(Open::Table(table, key)) => match key.take() {
                None => *key = Some(name(&value)),
                Some(key) => {
                    if table.insert(key.clone(), value).is_some() {
                        return Err(LensError::new(LensFault::Inconsistent, key, "is given twice"));
                    }
                }
            },
        }
    }
    root.ok_or_else(|| unreadable("holds nothing"))
}

fn name(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn scalar(text: &str, style: ScalarStyle) -> Value {
    if style == ScalarStyle::Plain { number_or_text(text) } else { Value::String(text.to_owned()) }
}

/// A finite number, else the text.
fn number_or_text(text: &str) -> Value {
    let number = text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
    number.map_or_else(|| Value::String(text.trim().to_owned()), Value::from)
}

/// Reads OpenCV's XML: elements named `_` are a list, others a table, text without elements numbers.
pub(super) fn xml(text: &str) -> Result<Value, LensError> {
    let options = roxmltree::ParsingOptions { nodes_limit: 1_000_000, ..roxmltree::ParsingOptions::default() };
    let document =
        roxmltree::Document::parse_with_options(text, options).map_err(|error| unreadable(format!("not XML: {error}")))?;
    element(document.root_element(), 0)
}

fn element(node: roxmltree::Node<'_, '_>, depth: usize) -> Result<Value, LensError> {
    if depth > MAX_DEPTH {
        return Err(LensError::new(LensFault::TooLarge, node.tag_name().name(), format!("nested deeper than {MAX_DEPTH}")));
    }
    let children: Vec<_> = node.children().filter(roxmltree::Node::is_element).collect();
    if children.is_empty() {
        let text = node.text().unwrap_or_default();
        let words: Vec<Value> = text.split_whitespace().map(number_or_text).collect();
        let is_list = words.len() > 1 && words.iter().any(Value::is_number);
        return Ok(if is_list { Value::Array(words) } else { number_or_text(text) });
    }
    if children.iter().all(|child| child.tag_name().name() == "_") {
        return children.into_iter().map(|child| element(child, depth + 1)).collect::<Result<_, _>>().map(Value::Array);
    }
    let mut table = Map::new();
    for child in children {
        let name = child.tag_name().name();
        if table.insert(name.to_owned(), element(child, depth + 1)?).is_some() {
            return Err(LensError::new(LensFault::Inconsistent, name, "is given twice"));
        }
    }
    Ok(Value::Object(table))
}

/// Numbers by rows, with their shape.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Matrix {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) values: Vec<f64>,
}

impl Matrix {
    /// A 3 × 3 matrix.
    pub(super) fn square(&self, at: &str) -> Result<nalgebra::Matrix3<f64>, LensError> {
        if self.values.len() == 9 && (self.rows, self.columns) == (3, 3) {
            return Ok(nalgebra::Matrix3::from_row_slice(&self.values));
        }
        let detail = format!("is {} × {}; allowed is 3 × 3", self.rows, self.columns);
        Err(LensError::new(LensFault::WrongShape, at, detail))
    }
}

/// Reads a matrix: OpenCV's table of rows, cols and data, a list of rows, or a flat list, of which nine numbers are 3 × 3.
pub(super) fn matrix(value: &Value, at: &str) -> Result<Matrix, LensError> {
    let shape = |detail: String| LensError::new(LensFault::WrongShape, at, detail);
    if let Value::Object(table) = value {
        let size =
            |name: &str| table.get(name).and_then(Value::as_f64).filter(|size| (0.0..=1e6).contains(size) && size.fract() == 0.0);
        let (Some(rows), Some(columns), Some(data)) = (size("rows"), size("cols"), table.get("data")) else {
            return Err(LensError::new(LensFault::MissingField, at, "is not a matrix with rows, cols and data"));
        };
        let values = numbers(data, at)?;
        let (rows, columns) = (rows as usize, columns as usize);
        if values.len() != rows.saturating_mul(columns) {
            return Err(shape(format!("has {}; rows × cols is {rows} × {columns}", counted(values.len(), "number"))));
        }
        return Ok(Matrix { rows, columns, values });
    }
    if let Some(rows) = value.as_array().filter(|rows| rows.first().is_some_and(Value::is_array)) {
        let values: Vec<Vec<f64>> = rows.iter().map(|row| numbers(row, at)).collect::<Result<_, _>>()?;
        let columns = values.first().map_or(0, Vec::len);
        if values.iter().any(|row| row.len() != columns) {
            return Err(shape("has rows of different lengths".to_owned()));
        }
        return Ok(Matrix { rows: values.len(), columns, values: values.concat() });
    }
    let values = numbers(value, at)?;
    let (rows, columns) = if values.len() == 9 { (3, 3) } else { (values.len(), 1) };
    Ok(Matrix { rows, columns, values })
}

/// Reads a flat list of finite numbers; one number is a list of one.
pub(super) fn numbers(value: &Value, at: &str) -> Result<Vec<f64>, LensError> {
    let number = |value: &Value| {
        value.as_f64().filter(|number| number.is_finite()).ok_or_else(|| {
            let found = value.to_string().chars().take(40).collect::<String>();
            LensError::new(LensFault::OutOfRange, at, format!("has {found} where a finite number is expected"))
        })
    };
    match value {
        Value::Array(list) => list.iter().map(number).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) | Value::Object(_) => {
            number(value).map(|number| vec![number])
        }
    }
}
