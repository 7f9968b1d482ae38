//! Members of plans and programs that their schemas do not have. Their types pass over them when they are read, so that a
//! member that is misspelt, or of a later release, would count for nothing in silence. And members that a plan of an earlier
//! release lacks.

use std::collections::BTreeMap;

use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::{RefOr, Schema};

use crate::cell::{FieldError, did_you_mean};
use crate::wire::plan::PlanDocument;

/// Findings beyond which no more are looked for.
const MAX_FINDINGS: usize = 100;
/// Keywords under which a schema holds others that it is put together of.
const PARTS: [&str; 3] = ["allOf", "oneOf", "anyOf"];

/// Members of a document that the schema of its type does not have.
pub(super) fn unknown<T: ToSchema>(document: &Value) -> Vec<FieldError> {
    let mut components: Vec<(String, RefOr<Schema>)> = Vec::new();
    T::schemas(&mut components);
    let as_json = |schema: &RefOr<Schema>| serde_json::to_value(schema).unwrap_or_default();
    let schemas = Schemas(components.iter().map(|(name, schema)| (name.clone(), as_json(schema))).collect());
    let root = as_json(&T::schema());
    let mut found = Vec::new();
    schemas.walk(document, &[&root], "", &mut found);
    found
}

/// First member that the plan, as it was read, has and the document that it was read from lacks; `None` if it lacks none.
#[must_use]
pub fn added_to_plan(plan: &PlanDocument, document: &Value) -> Option<String> {
    added(&serde_json::to_value(plan).ok()?, document, "")
}

fn added(read: &Value, document: &Value, at: &str) -> Option<String> {
    match (read, document) {
        (Value::Object(read), Value::Object(fields)) => read.iter().find_map(|(name, value)| {
            let at = format!("{at}/{}", escaped(name));
            fields.get(name).map_or_else(|| Some(at.clone()), |field| added(value, field, &at))
        }),
        (Value::Array(read), Value::Array(items)) => {
            let entries = read.iter().zip(items).enumerate();
            entries
                .filter(|(_, (value, _))| is_container(value))
                .find_map(|(index, (value, item))| added(value, item, &format!("{at}/{index}")))
        }
        _ => None,
    }
}

fn is_container(value: &Value) -> bool {
    value.is_object() || value.is_array()
}

/// A name as a token of a JSON pointer.
fn escaped(name: &str) -> String {
    name.replace('~', "~0").replace('/', "~1")
}

/// Schemas by name.
struct Schemas(BTreeMap<String, Value>);

/// Members that an object may have by its schemas.
#[derive(Default)]
struct Shape<'s> {
    /// Schemas of each member.
    members: BTreeMap<&'s str, Vec<&'s Value>>,
    /// True if members of other names are allowed, or are refused where the document is read.
    is_open: bool,
}

impl Schemas {
    fn walk<'s>(&'s self, value: &Value, schemas: &[&'s Value], at: &str, found: &mut Vec<FieldError>) {
        match value {
            Value::Object(fields) => {
                let mut shape = Shape::default();
                schemas.iter().copied().for_each(|schema| self.join(schema, &mut shape));
                for (name, field) in fields {
                    let at = format!("{at}/{}", escaped(name));
                    match shape.members.get(name.as_str()) {
                        Some(of_member) if is_container(field) => self.walk(field, of_member, &at, found),
                        None if !shape.is_open && found.len() < MAX_FINDINGS => {
                            let question = did_you_mean(name, shape.members.keys().copied());
                            found.push(FieldError { pointer: at, detail: format!("{UNKNOWN}{question}") });
                        }
                        Some(_) | None => {}
                    }
                }
            }
            Value::Array(items) if items.iter().any(is_container) => {
                let mut of_items = Vec::new();
                schemas.iter().copied().for_each(|schema| self.join_items(schema, &mut of_items));
                let entries = items.iter().enumerate().filter(|(_, item)| is_container(item));
                entries.for_each(|(index, item)| self.walk(item, &of_items, &format!("{at}/{index}"), found));
            }
            Value::Array(_) | Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
        }
    }

    /// The schema itself, where it refers to one by name; `None` if that is not known.
    fn resolved<'s>(&'s self, schema: &'s Value) -> Option<&'s Value> {
        match schema["$ref"].as_str() {
            Some(reference) => self.0.get(reference.rsplit('/').next().unwrap_or_default()),
            None => Some(schema),
        }
    }

    /// Adds what a schema says of the members of an object.
    fn join<'s>(&'s self, schema: &'s Value, shape: &mut Shape<'s>) {
        let Some(schema) = self.resolved(schema) else {
            shape.is_open = true;
            return;
        };
        let mut says_nothing = true;
        for part in parts(schema) {
            says_nothing = false;
            self.join(part, shape);
        }
        for (name, member) in schema["properties"].as_object().into_iter().flatten() {
            says_nothing = false;
            shape.members.entry(name.as_str()).or_default().push(member);
        }
        let may_be_object = match &schema["type"] {
            Value::String(kind) => kind == "object",
            Value::Array(kinds) => kinds.iter().any(|kind| kind == "object"),
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::Object(_) => true,
        };
        shape.is_open |= !schema["additionalProperties"].is_null() || (says_nothing && may_be_object);
    }

    /// Adds the schemas that the items of a list have by its schema.
    fn join_items<'s>(&'s self, schema: &'s Value, of_items: &mut Vec<&'s Value>) {
        let Some(schema) = self.resolved(schema) else { return };
        parts(schema).for_each(|part| self.join_items(part, of_items));
        of_items.extend(Some(&schema["items"]).filter(|items| items.is_object()));
    }
}

/// Detail of a finding on a member that is not known, before a question for the member that was meant.
const UNKNOWN: &str = concat!(
    "is not known to release ",
    env!("CARGO_PKG_VERSION"),
    ", which would pass over it; take it out, or check with the release that wrote it"
);

/// Schemas that a schema is put together of.
fn parts(schema: &Value) -> impl Iterator<Item = &Value> {
    PARTS.into_iter().flat_map(move |keyword| schema[keyword].as_array().into_iter().flatten())
}
