//! Shape of a document against the schema of its type: everything that it lacks, that it has too much or of another kind, at once.
//! serde stops at the first fault; the schema, which the API document is made of, tells the others, with their units and ranges.

use std::any::TypeId;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use utoipa::ToSchema;
use utoipa::openapi::{RefOr, Schema};

use super::json::{decode, escape};
use super::parameters::{add_bounds, without_links};
use crate::cell::{ControllersSpec, FieldError, closest, decimal_comma_advice, with_suggestion};

/// Findings beyond which no more are looked for.
const MAX_FINDINGS: usize = 100;
/// Values beyond which no more are looked at: a body of two megabytes may hold a million.
const MAX_VALUES: usize = 10_000;
/// Schema that allows every value.
const ANYTHING: &Value = &Value::Null;
/// Beginning of the range in a message.
const ALLOWED: &str = "; allowed is ";

/// Converts a value to `T`.
///
/// # Errors
/// The finding of serde, and every field that is missing, unknown or of another kind.
pub fn from_value<T: DeserializeOwned + ToSchema + 'static>(value: &Value) -> Result<T, Vec<FieldError>> {
    decode(value).map_err(|first| refused::<T>(value, first))
}

/// Findings in a value that is no `T`: `first`, which serde gives, unless it is a field that the others name.
pub(crate) fn refused<T: ToSchema + 'static>(value: &Value, first: FieldError) -> Vec<FieldError> {
    let Walked { mut findings, odd_lists, lists, beyond } = walked::<T>(value, false);
    // Of a list in the place of something else serde may tell its length, or what is wrong with its first item.
    let is_told = |list: &String| first.pointer == *list && first.detail.starts_with("is a list");
    if lists.iter().any(|list| is_within(&first.pointer, list) && !is_told(list)) {
        return findings;
    }
    let first = with_id(placed(first, value, &findings, &odd_lists), value);
    let first = with_range(first, &findings, &beyond);
    let is_told = field_named(&first.detail).is_some_and(|name| {
        let end = format!("/{}", escape(name));
        let is_it = |finding: &FieldError| finding.pointer == first.pointer || finding.pointer.ends_with(&end);
        findings.iter().any(|finding| is_it(finding) && is_within(&finding.pointer, &first.pointer))
    });
    if !is_told {
        let first = with_field(first);
        findings.retain(|finding| finding.pointer != first.pointer);
        findings.insert(0, first);
    }
    findings
}

/// The finding of serde at its place. Of what is wrong inside a tagged enum serde tells the place of the whole, since it reads the
/// fields from a copy; of a list that is too long it does not always tell which length is allowed.
fn placed(first: FieldError, value: &Value, findings: &[FieldError], odd_lists: &BTreeMap<String, [u64; 2]>) -> FieldError {
    let list = odd_lists.iter().find(|(pointer, [length, _])| {
        is_within(pointer, &first.pointer) && first.detail.starts_with(&format!("has {length} element"))
    });
    let is_same = |finding: &FieldError| {
        let kind = finding.detail.split(ALLOWED).next().unwrap_or_default();
        is_within(&finding.pointer, &first.pointer) && first.detail.starts_with(kind)
    };
    let inside = findings.iter().find(|finding| is_same(finding));
    match (list, inside) {
        (Some((pointer, [length, allowed])), _) if length > allowed => {
            FieldError { pointer: pointer.clone(), detail: format!("has {length} elements; expected {allowed}") }
        }
        (Some((pointer, _)), _) => FieldError { pointer: pointer.clone(), ..first },
        (None, Some(finding)) => FieldError { pointer: finding.pointer.clone(), ..first },
        (None, None) => {
            let quoted = first.detail.strip_prefix("is ").and_then(|rest| rest.split_once("; expected "));
            let around = value.pointer(&first.pointer);
            let number = quoted.zip(around).and_then(|((quoted, _), around)| number_in(around, quoted, &first.pointer));
            FieldError { pointer: number.unwrap_or(first.pointer), detail: first.detail }
        }
    }
}

/// Pointer of the first number in `value`, which is at the pointer `at`, that is written as `quoted`.
fn number_in(value: &Value, quoted: &str, at: &str) -> Option<String> {
    match value {
        Value::Number(number) => (number.to_string() == quoted).then(|| at.to_owned()),
        Value::Array(items) => {
            items.iter().enumerate().find_map(|(index, item)| number_in(item, quoted, &format!("{at}/{index}")))
        }
        Value::Object(fields) => {
            fields.iter().find_map(|(name, field)| number_in(field, quoted, &format!("{at}/{}", escape(name))))
        }
        Value::Null | Value::Bool(_) | Value::String(_) => None,
    }
}

/// The finding of serde on a field that it misses, which it tells of the object around it, at the field.
fn with_field(first: FieldError) -> FieldError {
    let name = first.detail.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`'));
    match name {
        Some(name) => FieldError { pointer: format!("{}/{}", first.pointer, escape(name)), detail: "is missing".to_owned() },
        None => first,
    }
}

/// The finding of serde on an id with the value, which serde does not tell.
fn with_id(first: FieldError, value: &Value) -> FieldError {
    let detail = first.detail.as_str();
    let is_of_id = detail == "is not an id; expected a UUID" || detail.ends_with("; expected a formatted UUID string");
    match value.pointer(&first.pointer) {
        Some(id) if is_of_id => FieldError { detail: format!("is {}; expected a UUID", found(id)), ..first },
        Some(_) | None => first,
    }
}

/// The finding of serde on a number with the range of its field: serde knows that of the type alone.
fn with_range(first: FieldError, findings: &[FieldError], beyond: &BTreeMap<String, String>) -> FieldError {
    let of_kind = findings.iter().find(|finding| finding.pointer == first.pointer && finding.detail.contains(ALLOWED));
    let told = of_kind.map(|finding| &finding.detail).or_else(|| beyond.get(&first.pointer));
    let is_of_number = ["; expected a number", "; expected a whole number"].iter().any(|kind| first.detail.contains(kind));
    match told.filter(|_| is_of_number) {
        Some(detail) => FieldError { detail: detail.clone(), ..first },
        None => first,
    }
}

/// Name of the field that serde misses or does not know.
fn field_named(detail: &str) -> Option<&str> {
    let rest = ["missing field `", "unknown field `"].iter().find_map(|start| detail.strip_prefix(start))?;
    rest.split('`').next()
}

/// Returns true if `pointer` is `whole`, or leads into what lies there.
fn is_within(pointer: &str, whole: &str) -> bool {
    pointer.strip_prefix(whole).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Lists in `value` where the schema of `T` has an object: serde takes the fields of a structure from a list too.
pub(crate) fn lists_for_objects<T: ToSchema + 'static>(value: &Value) -> Vec<FieldError> {
    walked::<T>(value, true).findings
}

/// Outcome of the walk through `value`: fields that are missing, unknown or of another kind by the schema of `T`, lists that are
/// too long or too short, lists in the place of something else, and messages on numbers beyond the range of their field.
struct Walked {
    findings: Vec<FieldError>,
    odd_lists: BTreeMap<String, [u64; 2]>,
    lists: Vec<String>,
    beyond: BTreeMap<String, String>,
}

fn walked<T: ToSchema + 'static>(value: &Value, lists_only: bool) -> Walked {
    let schema = schema_of::<T>();
    let (findings, odd_lists, lists, beyond) = (Vec::new(), BTreeMap::new(), Vec::new(), BTreeMap::new());
    let mut walk = Walk { components: &schema.components, findings, odd_lists, lists, beyond, values: 0, lists_only };
    walk.value(value, &schema.root, "");
    Walked { findings: walk.findings, odd_lists: walk.odd_lists, lists: walk.lists, beyond: walk.beyond }
}

/// Schema of a type as JSON.
struct TypeSchema {
    root: Value,
    /// Named schemas that it refers to.
    components: BTreeMap<String, Value>,
}

/// Schema of `T`, made once: that of a job has thousands of values.
fn schema_of<T: ToSchema + 'static>() -> Arc<TypeSchema> {
    static SCHEMAS: LazyLock<Mutex<HashMap<TypeId, Arc<TypeSchema>>>> = LazyLock::new(Mutex::default);
    // Whole after every operation, also where a thread died in between.
    let schemas = || SCHEMAS.lock().unwrap_or_else(PoisonError::into_inner);
    let known = schemas().get(&TypeId::of::<T>()).cloned();
    known.unwrap_or_else(|| {
        let mut components = Vec::new();
        T::schemas(&mut components);
        let schema = Arc::new(TypeSchema::new(&T::name(), T::schema(), components));
        Arc::clone(schemas().entry(TypeId::of::<T>()).or_insert(schema))
    })
}

impl TypeSchema {
    /// The schema of the type `name`, with the ranges that its fields have in the API document.
    fn new(name: &str, root: RefOr<Schema>, components: Vec<(String, RefOr<Schema>)>) -> Self {
        let to_json = |schema: &RefOr<Schema>| serde_json::to_value(schema).unwrap_or_default();
        let mut schemas: BTreeMap<String, RefOr<Schema>> = components.into_iter().collect();
        schemas.insert(name.to_owned(), root);
        add_bounds(&mut schemas);
        let components: BTreeMap<String, Value> = schemas.iter().map(|(name, schema)| (name.clone(), to_json(schema))).collect();
        Self { root: components.get(name).cloned().unwrap_or_default(), components }
    }
}

/// Kinds of value that a schema without variants has, as JSON Schema names them; `None` where it says nothing of them.
fn kinds_of(schema: &Value) -> Option<Vec<&str>> {
    let of_type = &schema["type"];
    match of_type.as_array() {
        Some(names) => names.iter().map(Value::as_str).collect(),
        None => Some(vec![of_type.as_str()?]),
    }
}

fn is_of_kind(value: &Value, kind: &str) -> bool {
    match kind {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        // Of those beyond every kind of integer serde tells the range.
        "integer" => value.is_i64() || value.is_u64() || value.as_f64().is_some_and(|number| number.fract() == 0.0),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        _ => value.is_object(),
    }
}

fn words(kind: &str) -> &str {
    match kind {
        "boolean" => "true or false",
        "integer" => "a whole number",
        "number" => "a number",
        "string" => "a string",
        "array" => "a list",
        "object" => "an object",
        other => other,
    }
}

/// A value as a message quotes it: lists and objects by their kind.
fn found(value: &Value) -> String {
    match value {
        Value::Array(_) => words("array").to_owned(),
        Value::Object(_) => words("object").to_owned(),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => value.to_string(),
    }
}

/// Kinds that are allowed, in words; `null` is not asked for where there are others.
fn expected(kinds: &[&str]) -> String {
    let mut allowed: Vec<&str> = kinds.iter().filter(|kind| **kind != "null").map(|kind| words(kind)).collect();
    allowed.dedup();
    allowed.join(" or ")
}

/// Range of a number; `None` where it has none, or where something else than a number is allowed too.
fn range_of(variants: &[&Value]) -> Option<[f64; 2]> {
    let is_null = |variant: &Value| kinds_of(variant).is_some_and(|kinds| kinds == ["null"]);
    let mut others = variants.iter().copied().filter(|variant| !is_null(variant));
    let (Some(number), None) = (others.next(), others.next()) else { return None };
    let is_number = kinds_of(number)?.iter().all(|kind| ["integer", "number", "null"].contains(kind));
    let [min, max] = ["minimum", "maximum"].map(|bound| number[bound].as_f64().filter(|_| is_number));
    Some([min?, max?])
}

/// End of a message, with the range; empty without one.
fn allowed(range: Option<[f64; 2]>) -> String {
    range.map_or_else(String::new, |[min, max]| format!("{ALLOWED}{min} to {max}"))
}

/// Walk through a value along its schema.
struct Walk<'s> {
    /// Named schemas.
    components: &'s BTreeMap<String, Value>,
    findings: Vec<FieldError>,
    /// Length and allowed length of each list that is too long or too short, by its pointer.
    odd_lists: BTreeMap<String, [u64; 2]>,
    /// Pointers of the lists in the place of something else.
    lists: Vec<String>,
    /// Message on each number beyond the range of its field, by its pointer: a check tells it too, if serde takes the number.
    beyond: BTreeMap<String, String>,
    /// Values seen.
    values: usize,
    /// Look for nothing but lists in the place of objects.
    lists_only: bool,
}

/// An object's schema, those of which it is put together joined.
#[derive(Clone, Default)]
struct ObjectShape<'s> {
    properties: BTreeMap<&'s str, &'s Value>,
    required: BTreeSet<&'s str>,
    /// True if no other properties are allowed.
    is_closed: bool,
}

impl<'s> ObjectShape<'s> {
    fn missing(&self, object: &Map<String, Value>) -> impl Iterator<Item = &'s str> {
        self.required.iter().copied().filter(|name| !object.contains_key(*name))
    }

    fn unknown<'o>(&self, object: &'o Map<String, Value>) -> impl Iterator<Item = &'o str> {
        object.keys().map(String::as_str).filter(|name| self.is_closed && !self.properties.contains_key(name))
    }

    /// Properties that have one value only: they tell a variant from the others.
    fn tags(&self) -> impl Iterator<Item = (&'s str, &'s str)> {
        self.properties.iter().filter_map(|(&name, &schema)| match schema["enum"].as_array()?.as_slice() {
            [only] if self.required.contains(name) => Some((name, only.as_str()?)),
            _ => None,
        })
    }

    fn contradicts(&self, object: &Map<String, Value>) -> bool {
        self.tags().any(|(name, value)| object.get(name).is_some_and(|found| found.as_str() != Some(value)))
    }
}

impl<'s> Walk<'s> {
    fn resolve(&self, schema: &'s Value) -> &'s Value {
        let name = schema["$ref"].as_str().and_then(|reference| reference.rsplit('/').next());
        name.map_or(schema, |name| self.components.get(name).unwrap_or(ANYTHING))
    }

    fn value(&mut self, value: &Value, schema: &'s Value, at: &str) {
        self.values += 1;
        if self.is_done() {
            return;
        }
        let schema = self.resolve(schema);
        if let Some(detail) = self.other_kind(value, schema) {
            if value.is_array() {
                self.lists.push(at.to_owned());
            }
            self.push(at.to_owned(), detail);
            return;
        }
        match value {
            Value::Object(object) => {
                if let Some(shape) = self.shape_for(object, schema, at) {
                    self.object(object, &shape, at);
                }
            }
            Value::Array(_) if self.is_object(schema) => {
                self.lists.push(at.to_owned());
                self.findings.push(FieldError { pointer: at.to_owned(), detail: "is a list; expected an object".to_owned() });
            }
            Value::Array(items) => {
                let schema = self.variants(schema).into_iter().find(|variant| !variant["items"].is_null()).unwrap_or(ANYTHING);
                let length = items.len() as u64;
                let [min, max] = ["minItems", "maxItems"].map(|limit| schema[limit].as_u64());
                if let Some(allowed) = max.filter(|max| length > *max).or(min.filter(|min| length < *min)) {
                    self.odd_lists.insert(at.to_owned(), [length, allowed]);
                }
                for (index, item) in items.iter().enumerate() {
                    self.value(item, &schema["items"], &format!("{at}/{index}"));
                }
            }
            Value::Number(number) => {
                let range = range_of(&self.variants(schema));
                if range.zip(number.as_f64()).is_some_and(|([min, max], number)| !(min..=max).contains(&number)) {
                    self.beyond.insert(at.to_owned(), format!("is {number}{}", allowed(range)));
                }
            }
            Value::Null | Value::Bool(_) | Value::String(_) => {}
        }
    }

    /// Finding for a value of a kind, or a name, that its schema does not have; `None` where the schema leaves it open. A list in the
    /// place of an object is told elsewhere.
    fn other_kind(&self, value: &Value, schema: &'s Value) -> Option<String> {
        let variants = self.variants(schema);
        let kinds = variants.iter().copied().map(kinds_of).collect::<Option<Vec<_>>>()?.concat();
        if !kinds.iter().any(|kind| is_of_kind(value, kind)) {
            let is_told = value.is_array() && self.is_object(schema);
            let advice = value.as_str().filter(|_| kinds.contains(&"number")).map_or("", decimal_comma_advice);
            return (!is_told)
                .then(|| format!("is {}; expected {}{}{advice}", found(value), expected(&kinds), allowed(range_of(&variants))));
        }
        let name = value.as_str()?;
        let with_names = variants.iter().filter(|variant| kinds_of(variant).is_some_and(|kinds| kinds.contains(&"string")));
        let lists: Vec<&Vec<Value>> = with_names.map(|variant| variant["enum"].as_array()).collect::<Option<_>>()?;
        let known: Vec<&str> = lists.into_iter().flatten().filter_map(Value::as_str).collect();
        let quoted = || known.iter().map(|known| format!("`{known}`")).collect::<Vec<_>>().join(", ");
        (!known.contains(&name)).then(|| with_suggestion(&format!("unknown variant `{name}`, expected one of {}", quoted())))
    }

    /// A schema's variants, resolved; itself, if it has none.
    fn variants(&self, schema: &'s Value) -> Vec<&'s Value> {
        let Some(variants) = schema["oneOf"].as_array() else { return vec![schema] };
        variants.iter().flat_map(|variant| self.variants(self.resolve(variant))).collect()
    }

    /// The shape that an object is meant to have: of several variants the one that its tag names, else the one that it misses
    /// least of. `None` where it is not known.
    fn shape_for(&mut self, object: &Map<String, Value>, schema: &'s Value, at: &str) -> Option<ObjectShape<'s>> {
        let mut shapes: Vec<ObjectShape<'s>> =
            self.variants(schema).into_iter().filter_map(|variant| self.object_shape(variant)).collect();
        let tag = common_tag(&shapes).filter(|_| shapes.len() > 1);
        if let Some((tag, values)) = &tag {
            if !object.contains_key(*tag) {
                self.push(format!("{at}/{}", escape(tag)), format!("is missing: one of {}", values.join(", ")));
                return None;
            }
            // Tagged enums refuse unknown fields, which the schemas of their variants do not tell.
            shapes.iter_mut().for_each(|shape| shape.is_closed = true);
        }
        let fitting = shapes.iter().filter(|shape| !shape.contradicts(object));
        let mut best = fitting.min_by_key(|shape| shape.missing(object).count() + shape.unknown(object).count())?.clone();
        // A field of another variant is not unknown: serde says what is wrong with it.
        if tag.is_none() {
            for (&name, &schema) in shapes.iter().flat_map(|shape| &shape.properties) {
                let known = best.properties.entry(name).or_insert(ANYTHING);
                if !is_alike(known, schema) {
                    *known = ANYTHING;
                }
            }
        }
        Some(best)
    }

    /// Shape of a schema of objects that names fields.
    fn object_shape(&self, schema: &'s Value) -> Option<ObjectShape<'s>> {
        let mut shape = ObjectShape::default();
        self.join(schema, &mut shape);
        (!shape.properties.is_empty()).then_some(shape)
    }

    fn join(&self, schema: &'s Value, shape: &mut ObjectShape<'s>) {
        let schema = self.resolve(schema);
        for part in schema["allOf"].as_array().into_iter().flatten() {
            self.join(part, shape);
        }
        for (name, property) in schema["properties"].as_object().into_iter().flatten() {
            shape.properties.insert(name, property);
        }
        let required = schema["required"].as_array().into_iter().flatten();
        shape.required.extend(required.filter_map(Value::as_str));
        shape.is_closed |= schema["additionalProperties"] == Value::Bool(false);
    }

    fn object(&mut self, object: &Map<String, Value>, shape: &ObjectShape<'s>, at: &str) {
        for name in shape.missing(object) {
            let meaning = shape.properties.get(name).map(|property| self.description(property)).unwrap_or_default();
            let meaning = if meaning.is_empty() { String::new() } else { format!(": {meaning}") };
            self.push(format!("{at}/{}", escape(name)), format!("is missing{meaning}"));
        }
        for name in shape.unknown(object) {
            if self.is_done() {
                return;
            }
            if name == ControllersSpec::SECTION && shape.properties.contains_key("base_from_table") {
                let detail =
                    "is set in the operator's cell file alone (execution.cells in the server's settings); leave it out here";
                self.push(format!("{at}/{name}"), detail.to_owned());
                continue;
            }
            let known: Vec<&str> = shape.properties.keys().copied().collect();
            let meant = closest(name, known.iter().copied()).map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            let detail = format!("unknown field `{name}`; allowed are {}{meant}", known.join(", "));
            self.push(format!("{at}/{}", escape(name)), detail);
        }
        for (name, value) in object {
            if let Some(property) = shape.properties.get(name.as_str()) {
                self.value(value, property, &format!("{at}/{}", escape(name)));
            }
        }
    }

    /// Description of a field in one sentence; that of its type where the field has none, or where the type's says more of the
    /// same.
    fn description(&self, property: &'s Value) -> String {
        let (own, of_type) = (first_sentence(property), first_sentence(self.resolve(property)));
        if of_type.starts_with(own.as_str()) { of_type } else { own }
    }

    /// Returns true if every variant of a schema is an object.
    fn is_object(&self, schema: &'s Value) -> bool {
        self.variants(schema).into_iter().all(|variant| {
            let is_joined = variant["allOf"].is_array() && self.object_shape(variant).is_some();
            (variant["type"] == "object" || is_joined) && variant["items"].is_null()
        })
    }

    fn push(&mut self, pointer: String, detail: String) {
        if !self.lists_only {
            self.findings.push(FieldError { pointer, detail });
        }
    }

    /// Returns true once enough was found, or looked at.
    fn is_done(&self) -> bool {
        self.findings.len() >= MAX_FINDINGS || self.values > MAX_VALUES
    }
}

/// Returns true if two schemas are equal but for the ranges of their numbers.
fn is_alike(one: &Value, other: &Value) -> bool {
    let without_ranges = |schema: &Value| {
        let mut schema = schema.clone();
        for place in ["", "/items"] {
            if let Some(Value::Object(schema)) = schema.pointer_mut(place) {
                schema.retain(|name, _| name != "minimum" && name != "maximum");
            }
        }
        schema
    };
    without_ranges(one) == without_ranges(other)
}

/// The tag that all variants have, with its value in each.
fn common_tag<'s>(shapes: &[ObjectShape<'s>]) -> Option<(&'s str, Vec<&'s str>)> {
    let (name, _) = shapes.first()?.tags().next()?;
    let value_in = |shape: &ObjectShape<'s>| shape.tags().find(|(tag, _)| *tag == name).map(|(_, value)| value);
    let values: Option<Vec<&str>> = shapes.iter().map(value_in).collect();
    values.map(|values| (name, values))
}

/// First sentence of a schema's description, and its range, on one line and without links.
fn first_sentence(schema: &Value) -> String {
    let text = schema["description"].as_str().unwrap_or_default();
    let mut paragraphs = text.split("\n\n");
    let paragraph = paragraphs.next().unwrap_or_default().trim().replace('\n', " ");
    let begins_sentence = |at: usize| paragraph[at + 2..].starts_with(|first: char| first.is_uppercase() || first == '`');
    let end = paragraph.match_indices(". ").map(|(at, _)| at).find(|at| begins_sentence(*at));
    let mut told = paragraph[..end.unwrap_or(paragraph.len())].trim_end_matches('.').to_owned();
    if let Some(range) = paragraphs.find(|paragraph| paragraph.starts_with("Range:")) {
        told = format!("{told}; {}", range.trim().replace('\n', " ").replacen("Range:", "range:", 1));
    }
    without_links(told.trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::from_value;
    use crate::cell::{
        BodySpec, CellSpec, FieldError, KinematicsSpec, Presets, RobotSpec, RotationSpec, ScannerSpec, SpecKind, SpecLibrary,
    };
    use crate::planning::params::PlanParams;
    use crate::wire::JobRequest;
    use crate::wire::calibration::PlacementData;

    fn pointers(errors: &[FieldError]) -> Vec<&str> {
        errors.iter().map(|error| error.pointer.as_str()).collect()
    }

    #[test]
    fn a_list_in_the_place_of_an_object_is_found() {
        let params = json!({"selection": {"overlap": [null, null]}, "regions": {"exclude": []}});
        let found = super::lists_for_objects::<PlanParams>(&params);
        assert_eq!(pointers(&found), ["/selection/overlap"]);
        assert_eq!(super::lists_for_objects::<PlanParams>(&json!({"selection": {"overlap": {}}})), []);
    }

    #[test]
    fn the_schema_of_a_type_is_made_once() {
        let [first, again] = [(); 2].map(|()| super::schema_of::<PlanParams>());
        assert!(std::sync::Arc::ptr_eq(&first, &again));
        assert!(!std::sync::Arc::ptr_eq(&first, &super::schema_of::<ScannerSpec>()));
    }

    #[test]
    fn a_long_list_of_wrong_objects_is_not_walked_to_its_end() {
        let errors = from_value::<Vec<BodySpec>>(&Value::Array(vec![json!({}); 300_000])).expect_err("empty objects");
        assert!(errors.len() <= super::MAX_FINDINGS + 10, "{}", errors.len());
    }

    fn preset() -> Value {
        serde_json::to_value(Presets.scanner("transcan-c-nominal").expect("a preset")).expect("JSON")
    }

    #[test]
    fn a_file_of_a_name_alone_is_told_all_that_it_lacks_with_units_and_ranges() {
        let errors = from_value::<ScannerSpec>(&json!({"name": "mine", "left": {"fx": 4000.0}})).expect_err("incomplete");
        let at = |pointer: &str| {
            let found = errors.iter().find(|error| error.pointer == pointer);
            found.unwrap_or_else(|| panic!("{pointer} is not in {errors:#?}")).detail.as_str()
        };
        assert_eq!(at("/mass_kg"), "is missing: Mass, kg, 0.01 to 100");
        assert!(at("/left/fy").contains("pixels, 1 to 1e6") && at("/left/incidence_max_deg").contains("degrees, 1 to 89.9"));
        assert!(at("/depth_mm").contains("1 ≤ near < best < far ≤ 10000 mm"));
        for pointer in
            ["/right", "/projector", "/practical_volume_mm", "/left/width_px", "/left/height_px", "/left/cx", "/left/cy"]
        {
            assert!(at(pointer).starts_with("is missing: "), "{pointer}");
        }
        assert!(!pointers(&errors).contains(&"/block_cube_mm"), "it has a default");
    }

    #[test]
    fn what_is_missing_and_what_is_unknown_stand_beside_a_wrong_type() {
        let mut spec = preset();
        let fields = spec.as_object_mut().expect("an object");
        fields.remove("mass_kg");
        fields.insert("colour".into(), json!("white"));
        fields.insert("depth_mm".into(), json!({"near": "410", "far": 565.0}));
        let errors = from_value::<ScannerSpec>(&spec).expect_err("wrong");
        for pointer in ["/colour", "/mass_kg", "/depth_mm/best", "/depth_mm/near"] {
            assert_eq!(pointers(&errors).iter().filter(|found| **found == pointer).count(), 1, "{pointer}: {errors:#?}");
        }
    }

    #[test]
    fn a_sound_document_has_no_findings_and_a_wrong_type_its_own_only() {
        assert!(from_value::<ScannerSpec>(&preset()).is_ok());
        let mut spec = preset();
        spec["mass_kg"] = json!("heavy");
        let errors = from_value::<ScannerSpec>(&spec).expect_err("wrong");
        assert_eq!(pointers(&errors), ["/mass_kg"]);
        assert!(errors[0].detail.contains("is \"heavy\"; expected a number"), "{errors:?}");
        let whole = from_value::<ScannerSpec>(&json!(3)).expect_err("wrong");
        assert_eq!(pointers(&whole), [""]);
    }

    /// The message told the list's length, or what was wrong with its first item, as if it were the first field.
    #[test]
    fn a_list_in_the_place_of_an_object_is_told_alone_and_as_such() {
        let told = |errors: Vec<FieldError>| errors.iter().map(ToString::to_string).collect::<Vec<_>>();
        for list in [json!([]), json!([3]), json!([{}, {}])] {
            let whole = from_value::<JobRequest>(&list).expect_err("a list");
            assert_eq!(whole, [FieldError { pointer: String::new(), detail: "is a list; expected an object".to_owned() }]);
        }
        for list in [json!([]), json!([[0, 0, 0]])] {
            let params = json!({"part": {"table_from_part": list}});
            let errors = told(from_value::<PlanParams>(&params).expect_err("a list"));
            assert_eq!(errors, ["/part/table_from_part: is a list; expected an object"]);
        }
    }

    #[test]
    fn a_list_in_the_place_of_a_tagged_object_is_told_as_such_and_a_missing_field_at_its_place() {
        let mut arm = serde_json::to_value(Presets.robot("ur5e").expect("a preset")).expect("JSON");
        arm["kinematics"] = json!([]);
        let errors = from_value::<RobotSpec>(&arm).expect_err("a list");
        assert_eq!(errors.iter().map(ToString::to_string).collect::<Vec<_>>(), ["/kinematics: is a list; expected an object"]);
        let params = json!({"part": {"table_from_part": {"translation_mm": [0, 0, 0], "rpy_deg": null}}});
        let errors = from_value::<PlanParams>(&params).expect_err("no rotation");
        for error in &errors {
            assert!(error.pointer.starts_with("/part/table_from_part/") && !error.detail.contains("missing field"), "{errors:?}");
        }
    }

    /// Texts of the field and of its type stood in one message.
    #[test]
    fn what_is_missing_is_told_in_one_sentence() {
        let errors = from_value::<JobRequest>(&json!({})).expect_err("incomplete");
        let detail = "is missing: Id of the mesh to plan for".to_owned();
        assert_eq!(errors, [FieldError { pointer: "/mesh_id".to_owned(), detail }]);
        let errors = from_value::<CellSpec>(&json!({"name": "mine"})).expect_err("incomplete");
        for error in errors {
            assert!(!error.detail.contains(". "), "{error}");
        }
    }

    #[test]
    fn an_id_at_fault_is_quoted_and_a_number_in_a_variant_is_told_at_its_place() {
        for (id, told) in [(json!("abc"), "is \"abc\"; expected a UUID"), (json!(3), "is 3; expected a UUID")] {
            let errors = from_value::<JobRequest>(&json!({"mesh_id": id})).expect_err("wrong");
            assert_eq!(errors, [FieldError { pointer: "/mesh_id".to_owned(), detail: told.to_owned() }]);
        }
        let region = json!({"regions": {"exclude": [{"kind": "faces", "faces": [1, 4_294_967_296_u64]}]}});
        let errors = from_value::<PlanParams>(&region).expect_err("wrong");
        assert_eq!(pointers(&errors), ["/regions/exclude/0/faces/1"], "{errors:?}");
    }

    #[test]
    fn every_field_of_another_kind_is_named() {
        let params = json!({
            "setups": "two", "selection": {"target": "high", "max_views": 1.5, "solver": "gredy"}, "candidates": {"rolls_deg": [0, "90"]},
        });
        let errors = from_value::<PlanParams>(&params).expect_err("wrong");
        let at = |pointer: &str| errors.iter().find(|error| error.pointer == pointer).map(|error| error.detail.as_str());
        assert_eq!(at("/selection/target"), Some("is \"high\"; expected a number; allowed is 0 to 1"), "{errors:#?}");
        assert_eq!(at("/selection/max_views"), Some("is 1.5; expected a whole number; allowed is 1 to 1000"), "{errors:#?}");
        assert!(at("/selection/solver").is_some_and(|told| told.ends_with("did you mean `greedy`?")), "{errors:#?}");
        assert_eq!(at("/candidates/rolls_deg/1"), Some("is \"90\"; expected a number; allowed is -360 to 360"), "{errors:#?}");
        assert_eq!(at("/setups"), Some("is \"two\"; expected a whole number; allowed is 1 to 4"), "{errors:#?}");
        assert_eq!(errors.len(), 5, "{errors:#?}");
    }

    /// The range was that of the type: `expected a whole number from -2147483648 to 2147483647` of a priority.
    #[test]
    fn a_number_of_another_kind_or_beyond_its_type_is_told_the_range_of_its_field() {
        let told = |errors: Vec<FieldError>| errors.iter().map(ToString::to_string).collect::<Vec<_>>();
        let job = |priority: Value| {
            let job = json!({"mesh_id": "0190b6b0-7c1e-7c1e-8c1e-0123456789ab", "priority": priority});
            told(from_value::<JobRequest>(&job).expect_err("wrong"))
        };
        for (priority, wanted) in [
            (json!(1.5), "/priority: is 1.5; expected a whole number; allowed is -100 to 100"),
            (json!("high"), "/priority: is \"high\"; expected a whole number; allowed is -100 to 100"),
            (json!(1_000_000_000_000_u64), "/priority: is 1000000000000; allowed is -100 to 100"),
            (json!(-3_000_000_000_i64), "/priority: is -3000000000; allowed is -100 to 100"),
        ] {
            assert_eq!(job(priority.clone()), [wanted], "{priority}");
        }
        let params = |params: Value| told(from_value::<PlanParams>(&params).expect_err("wrong"));
        assert_eq!(params(json!({"setups": -1})), ["/setups: is -1; allowed is 1 to 4"]);
        let faces = json!({"regions": {"exclude": [{"kind": "faces", "faces": [1.5]}]}});
        assert_eq!(params(faces).len(), 1);
        let scanner = from_value::<ScannerSpec>(&json!({"name": "mine", "mass_kg": {}})).expect_err("wrong");
        assert!(told(scanner).contains(&"/mass_kg: is an object; expected a number; allowed is 0.01 to 100".to_owned()));
    }

    #[test]
    fn what_is_taken_has_no_findings() {
        fn is_taken<T: utoipa::ToSchema + 'static>(document: &impl serde::Serialize) {
            let value = serde_json::to_value(document).expect("JSON");
            assert_eq!(super::walked::<T>(&value, false).findings, [], "{value}");
        }
        for name in Presets.names(SpecKind::Cell) {
            is_taken::<CellSpec>(&Presets.cell(&name).expect("a preset"));
        }
        for name in Presets.names(SpecKind::Scanner) {
            is_taken::<ScannerSpec>(&Presets.scanner(&name).expect("a preset"));
        }
        for name in Presets.names(SpecKind::Robot) {
            is_taken::<RobotSpec>(&Presets.robot(&name).expect("a preset"));
        }
        is_taken::<PlanParams>(&PlanParams::default());
    }

    #[test]
    fn variants_are_told_by_their_tag() {
        let body = |shape: Value| from_value::<BodySpec>(&json!({"name": "b", "shape": shape})).expect_err("wrong");
        let errors = body(json!({"kind": "cylinder", "radius_mm": 3.0}));
        assert_eq!(pointers(&errors), ["/shape/height_mm"], "{errors:?}");
        let errors = body(json!({"radius_mm": 3.0}));
        assert!(
            errors.iter().any(|e| e.pointer == "/shape/kind" && e.detail.contains("box, cylinder, capsule, mesh")),
            "{errors:?}"
        );
        let errors = body(json!({"kind": "cone"}));
        assert!(errors[0].detail.contains("cone") && errors.len() == 1, "{errors:?}");
        let arm = from_value::<KinematicsSpec>(&json!({"kind": "ur", "d1_mm": 100.0})).expect_err("incomplete");
        assert!(arm.len() >= 5 && pointers(&arm).contains(&"/a2_mm"), "{arm:?}");
    }

    #[test]
    fn what_is_wrong_inside_a_variant_is_told_at_its_field() {
        let shape = |shape: Value| from_value::<BodySpec>(&json!({"name": "b", "shape": shape})).expect_err("wrong");
        for (wrong, told) in [
            (
                json!({"kind": "box", "size_mm": [1, 2, 3], "colour": 1}),
                "/shape/colour: unknown field `colour`; allowed are kind, size_mm",
            ),
            (
                json!({"kind": "cylinder", "radius_mm": "3 mm", "height_mm": 1}),
                "/shape/radius_mm: is \"3 mm\"; expected a number; allowed is 0.01 to 100000",
            ),
            (json!({"kind": "box", "size_mm": [1, 2, 3, 4]}), "/shape/size_mm: has 4 elements; expected 3"),
            (json!({"kind": "box", "size_mm": [1, 2]}), "/shape/size_mm: has 2 elements; expected a list of 3"),
        ] {
            let errors = shape(wrong);
            assert_eq!(errors.iter().map(ToString::to_string).collect::<Vec<_>>(), [told]);
        }
        let errors = from_value::<RotationSpec>(&json!({"kind": "continuous", "min_deg": 0})).expect_err("wrong");
        assert_eq!(pointers(&errors), ["/min_deg"], "{errors:?}");
        let pose = json!({"translation_mm": [0, 0, 0], "rpy_deg": [0, 0, 0], "unit": "m"});
        let placed = json!({"method": "cloud", "joints_deg": [0, 0, 0, 0, 0, 0], "cloud_from_part": pose});
        let errors = from_value::<PlacementData>(&placed).expect_err("wrong");
        assert_eq!(pointers(&errors), ["/cloud_from_part/unit"], "{errors:?}");
        let region = json!({"regions": {"exclude": [{"kind": "sphere", "centre_mm": [0, 0, 0], "radius_mm": 1, "radius": 2}]}});
        let errors = from_value::<PlanParams>(&region).expect_err("wrong");
        assert_eq!(pointers(&errors), ["/regions/exclude/0/radius"], "{errors:?}");
        assert!(errors[0].detail.ends_with("did you mean `radius_mm`?"), "{errors:?}");
    }

    #[test]
    fn a_cell_with_its_devices_in_place_is_searched_to_the_bottom() {
        let errors = from_value::<CellSpec>(&json!({
            "name": "mine", "scanner": "transcan-c", "turntable": {"name": "t"}, "robot": {"name": "r", "joints": [{"min_deg": 0}]},
            "base_from_table": {"translation_mm": [0, 0, 0]}, "mount": [{"shape": {"kind": "box"}}],
        }))
        .expect_err("incomplete");
        let found = pointers(&errors);
        for pointer in [
            "/turntable/plate_diameter_mm",
            "/turntable/rotation",
            "/robot/payload_kg",
            "/robot/joints/0/max_deg",
            "/base_from_table/quaternion_xyzw",
            "/flange_from_scanner",
            "/home_deg",
            "/mount/0/name",
            "/mount/0/shape/size_mm",
        ] {
            assert!(found.contains(&pointer), "{pointer} is not in {errors:#?}");
        }
    }

    #[test]
    fn controllers_are_the_operator_s_alone() {
        let mut cell = serde_json::to_value(Presets.cell("e05-transcan").expect("a preset")).expect("JSON");
        cell["controllers"] = json!({"arm": {"protocol": "hans", "address": "10.0.0.1:10003"}});
        let errors = from_value::<CellSpec>(&cell).expect_err("refused");
        assert_eq!(pointers(&errors), ["/controllers"]);
        assert!(
            errors[0].detail.contains("operator's cell file alone") && errors[0].detail.contains("execution.cells"),
            "{errors:?}"
        );
    }

    #[test]
    fn a_pose_may_have_either_rotation_and_not_both() {
        let cell = |pose: Value| {
            let mut cell = serde_json::to_value(Presets.cell("e05-transcan").expect("a preset")).expect("JSON");
            cell["base_from_table"] = pose;
            from_value::<CellSpec>(&cell)
        };
        assert!(cell(json!({"translation_mm": [400, 0, -200], "rpy_deg": [0, 0, 90]})).is_ok());
        let both = json!({"translation_mm": [400, 0, -200], "rpy_deg": [0, 0, 90], "quaternion_xyzw": [0, 0, 0, 1]});
        let errors = cell(both).expect_err("both");
        assert_eq!(pointers(&errors), ["/base_from_table"]);
        let errors = cell(json!({"translation_mm": [400, 0, -200]})).expect_err("neither");
        assert!(errors.len() == 1 && errors[0].detail.contains("rpy_deg"), "{errors:?}");
    }

    #[test]
    fn a_list_that_is_too_long_is_told_both_lengths() {
        let mut cell = serde_json::to_value(Presets.cell("e05-transcan").expect("a preset")).expect("JSON");
        cell["base_from_table"]["quaternion_xyzw"] = json!([0, 0, 0, 0, 1]);
        let errors = from_value::<CellSpec>(&cell).expect_err("five numbers");
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert_eq!(errors[0].to_string(), "/base_from_table/quaternion_xyzw: has 5 elements; expected 4");
    }

    #[test]
    fn parameters_have_all_their_unknown_fields_named() {
        let params = json!({"selection": {"goall": 1}, "motion": {"speed": 2}, "candidates": {"even_direction": 3}});
        let errors = from_value::<PlanParams>(&params).expect_err("unknown");
        for pointer in ["/selection/goall", "/motion/speed", "/candidates/even_direction"] {
            assert!(pointers(&errors).contains(&pointer), "{errors:?}");
        }
    }
}
