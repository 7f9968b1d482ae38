//! The parameters of a plan as people and clients read them: `api/parameters.md`, the help of the command line, and the ranges
//! in the API document. All are made from [`PlanParams::knobs`].

use std::collections::BTreeMap;
use std::fmt::Write;

use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::schema::{ArrayItems, Object};
use utoipa::openapi::{RefOr, Schema};

use crate::planning::params::{Knob, PlanParams};

/// One parameter.
struct Row {
    /// Path, as `--set` takes it.
    key: String,
    /// Default, as JSON; empty where there is none, or where it depends on the part.
    default: String,
    /// Range with its unit, or the closed list of values.
    range: String,
    description: String,
}

/// Every parameter that is a value, not a group of others.
fn rows() -> Vec<Row> {
    let groups = PlanParams::knobs();
    let mut schemas = Vec::new();
    PlanParams::schemas(&mut schemas);
    let schemas: BTreeMap<String, RefOr<Schema>> = schemas.into_iter().collect();
    let is_group = |key: &str| groups.iter().any(|(path, _)| path.trim_end_matches("[]") == key);
    let mut rows = Vec::new();
    for (path, group) in &groups {
        let (RefOr::T(Schema::Object(schema)), defaults) = ((group.schema)(), (group.defaults)()) else { continue };
        for knob in group.knobs {
            let key = if path.is_empty() { knob.field.to_owned() } else { format!("{path}.{}", knob.field) };
            if is_group(&key) {
                continue;
            }
            let default = &defaults[knob.field];
            let default = if default.is_null() { String::new() } else { default.to_string() };
            let Some(property) = schema.properties.get(knob.field) else { continue };
            let range = values(property, &schemas).unwrap_or_else(|| range_text(knob));
            rows.push(Row { key, default, range, description: without_links(&description(property)) });
        }
    }
    rows
}

/// Values of a property that has a closed list of them.
fn values(property: &RefOr<Schema>, schemas: &BTreeMap<String, RefOr<Schema>>) -> Option<String> {
    match property {
        RefOr::Ref(reference) => values(schemas.get(reference.ref_location.rsplit('/').next()?)?, schemas),
        RefOr::T(Schema::OneOf(one_of)) => one_of.items.iter().find_map(|item| values(item, schemas)),
        RefOr::T(Schema::Array(array)) => match &array.items {
            ArrayItems::RefOrSchema(items) => values(items, schemas),
            ArrayItems::False => None,
        },
        RefOr::T(Schema::Object(object)) => {
            let values: Vec<&str> = object.enum_values.as_ref()?.iter().filter_map(Value::as_str).collect();
            Some(values.join(", "))
        }
        RefOr::T(_) => None,
    }
}

/// Description of a property.
fn description(property: &RefOr<Schema>) -> String {
    let text = match property {
        RefOr::Ref(reference) => Some(reference.description.clone()),
        RefOr::T(Schema::Object(object)) => object.description.clone(),
        RefOr::T(Schema::Array(array)) => array.description.clone(),
        RefOr::T(Schema::OneOf(one_of)) => one_of.description.clone().or_else(|| one_of.items.first().map(description)),
        RefOr::T(_) => None,
    };
    text.unwrap_or_default().replace('\n', " ")
}

fn range_text(knob: &Knob) -> String {
    let mut text =
        knob.range.map_or_else(String::new, |[min, max]| format!("{min} to {max} {}", knob.unit).trim_end().to_owned());
    if let Some([min, max]) = knob.entries {
        // Writing to a String cannot fail.
        let _ = write!(text, "{}{min} to {max} entries", if text.is_empty() { "" } else { "; " });
    }
    text
}

/// Text without links into the source, which mean nothing outside it: those in parentheses are dropped, others become code.
#[must_use]
pub fn without_links(text: &str) -> String {
    let (mut rest, mut out) = (text, String::with_capacity(text.len()));
    while let Some(start) = rest.find("[`") {
        let Some(length) = rest[start..].find("`]") else { break };
        let (before, name, after) = (&rest[..start], &rest[start + 2..start + length], &rest[start + length + 2..]);
        match (before.strip_suffix(" ("), after.strip_prefix(')')) {
            (Some(before), Some(after)) => {
                out.push_str(before);
                rest = after;
            }
            _ => {
                let name = name.rsplit("::").next().unwrap_or(name);
                out.extend([before, "`", name, "`"]);
                rest = after;
            }
        }
    }
    out + rest
}

/// `api/parameters.md`.
#[must_use]
pub fn markdown() -> String {
    let mut text = "# Parameters of a plan\n\n\
                    Keys as `--set KEY=VALUE` takes them; over HTTP and in files the same names, nested. `[]` stands for each \
                    entry of a list. Renewed by `UPDATE_GOLDEN=1 cargo test --test it contract`.\n\n\
                    | key | default | range | meaning |\n| --- | --- | --- | --- |\n"
        .to_owned();
    for Row { key, default, range, description } in rows() {
        let default = if default.is_empty() { String::new() } else { format!("`{default}`") };
        let _ = writeln!(text, "| `{key}` | {default} | {range} | {} |", description.replace('|', "\\|"));
    }
    text
}

/// Keys with defaults and ranges, one a line, for the help of the command line.
#[must_use]
pub fn help() -> String {
    let mut text = String::new();
    for Row { key, default, range, .. } in rows() {
        let parts = [if default.is_empty() { String::new() } else { format!("default {default}") }, range];
        let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        let _ = writeln!(text, "  {key:<34} {}", parts.join("; "));
    }
    text
}

/// Adds the ranges of every parameter to the schemas of an API document.
pub fn add_ranges(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    for (_, group) in PlanParams::knobs() {
        let Some(RefOr::T(Schema::Object(schema))) = schemas.get_mut(group.name) else { continue };
        for knob in group.knobs {
            match schema.properties.get_mut(knob.field) {
                Some(RefOr::T(Schema::Object(number))) => add_range(number, knob.range),
                Some(RefOr::T(Schema::Array(list))) => {
                    (list.min_items, list.max_items) = (knob.entries.map(|[min, _]| min), knob.entries.map(|[_, max]| max));
                    if let ArrayItems::RefOrSchema(items) = &mut list.items
                        && let RefOr::T(Schema::Object(number)) = &mut **items
                    {
                        add_range(number, knob.range);
                    }
                }
                _ => {}
            }
        }
    }
}

/// A bound as an integer where it is one.
fn bound(value: f64) -> utoipa::Number {
    if value.fract() == 0.0 { utoipa::Number::Int(value as isize) } else { utoipa::Number::Float(value) }
}

fn add_range(number: &mut Object, range: Option<[f64; 2]>) {
    if let Some([min, max]) = range {
        (number.minimum, number.maximum) = (Some(bound(min)), Some(bound(max)));
    }
}
