//! The parameters of a plan as people and clients read them: `api/parameters.md`, the help of the command line, and the ranges
//! in the API document. All are made from [`PlanParams::knobs`]. Those of inspections and of the simulated scanner are in help texts.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::schema::{ArrayItems, Object};
use utoipa::openapi::{RefOr, Schema};

use crate::cell::did_you_mean;
use crate::inspection::coverage::CompareParams;
use crate::inspection::simulated_scanner::SimulationParams;
use crate::inspection::{AlignParams, InspectionParams};
use crate::planning::params::{KnobGroup, PlanParams};

/// Parameter of a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Path, as `--set` takes it; `[]` stands for each entry of a list.
    pub key: String,
    /// Default; null where there is none, or where it depends on the part.
    pub default: Value,
    /// Min value, of a number or of each entry of a list.
    pub min: Option<f64>,
    /// Max value, of a number or of each entry of a list.
    pub max: Option<f64>,
    /// Unit of the number; empty where it has none.
    pub unit: &'static str,
    /// Smallest and largest number of entries of a list.
    pub entries: Option<[usize; 2]>,
    /// Closed list of values, where there is one.
    pub values: Vec<String>,
    /// Meaning.
    pub description: String,
}

impl Parameter {
    /// Default as JSON; empty where there is none.
    #[must_use]
    pub fn default_text(&self) -> String {
        if self.default.is_null() { String::new() } else { self.default.to_string() }
    }

    /// Range with its unit, or the closed list of values.
    #[must_use]
    pub fn range_text(&self) -> String {
        let values = (!self.values.is_empty()).then(|| self.values.join(", "));
        if let (Some(values), None) = (&values, self.min) {
            return values.clone();
        }
        let range = self.min.zip(self.max).map(|(min, max)| format!("{min} to {max} {}", self.unit).trim_end().to_owned());
        let entries = self.entries.map(|[min, max]| format!("{min} to {max} entries"));
        range.into_iter().chain(entries).chain(values).collect::<Vec<_>>().join("; ")
    }
}

/// Lists every parameter of a plan that is a value, not a group of others.
#[must_use]
pub fn list() -> Vec<Parameter> {
    of_groups::<PlanParams>(&PlanParams::knobs())
}

/// Lists the parameters of an inspection.
#[must_use]
pub fn of_inspections() -> Vec<Parameter> {
    of_groups::<InspectionParams>(&[("align", AlignParams::KNOBS), ("compare", CompareParams::KNOBS)])
}

/// Lists the parameters of the simulated scanner.
#[must_use]
pub fn of_simulated_scans() -> Vec<Parameter> {
    of_groups::<SimulationParams>(&[("", SimulationParams::KNOBS)])
}

fn of_groups<T: ToSchema>(groups: &[(&str, KnobGroup)]) -> Vec<Parameter> {
    let mut schemas = Vec::new();
    T::schemas(&mut schemas);
    let schemas: BTreeMap<String, RefOr<Schema>> = schemas.into_iter().collect();
    let is_group = |key: &str| groups.iter().any(|(path, _)| path.trim_end_matches("[]") == key);
    let mut parameters = Vec::new();
    for (path, group) in groups {
        let (RefOr::T(Schema::Object(schema)), defaults) = ((group.schema)(), (group.defaults)()) else { continue };
        for knob in group.knobs {
            let key = if path.is_empty() { knob.field.to_owned() } else { format!("{path}.{}", knob.field) };
            let Some(property) = schema.properties.get(knob.field).filter(|_| !is_group(&key)) else { continue };
            parameters.push(Parameter {
                key,
                default: defaults[knob.field].clone(),
                min: knob.range.map(|[min, _]| min),
                max: knob.range.map(|[_, max]| max),
                unit: knob.unit,
                entries: knob.entries,
                values: values(property, &schemas).unwrap_or_default(),
                description: without_links(&description(property)),
            });
        }
    }
    parameters
}

/// Describes the fault of a key that `--set` does not know, with the parameter that was meant; `None` for one that it knows: a
/// parameter, a group of them, or a field within a value.
#[must_use]
pub fn unknown(key: &str) -> Option<String> {
    let parameters = list();
    let starts = |whole: &str, part: &str| whole == part || whole.strip_prefix(part).is_some_and(|rest| rest.starts_with('.'));
    // The fields of entries are set with their list.
    let is_known = |parameter: &Parameter| {
        let known = parameter.key.split("[]").next().unwrap_or_default();
        starts(key, known) || starts(known, key)
    };
    if parameters.iter().any(is_known) {
        return None;
    }
    let settable = parameters.iter().map(|parameter| parameter.key.as_str()).filter(|known| !known.contains("[]"));
    Some(format!("{key} is not a parameter{}", did_you_mean(key, settable)))
}

/// Values of a property that has a closed list of them.
fn values(property: &RefOr<Schema>, schemas: &BTreeMap<String, RefOr<Schema>>) -> Option<Vec<String>> {
    match property {
        RefOr::Ref(reference) => values(schemas.get(reference.ref_location.rsplit('/').next()?)?, schemas),
        RefOr::T(Schema::OneOf(one_of)) => one_of.items.iter().find_map(|item| values(item, schemas)),
        RefOr::T(Schema::Array(array)) => match &array.items {
            ArrayItems::RefOrSchema(items) => values(items, schemas),
            ArrayItems::False => None,
        },
        RefOr::T(Schema::Object(object)) => {
            let values = object.enum_values.as_ref()?.iter().filter_map(Value::as_str);
            Some(values.map(str::to_owned).collect())
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
    let mut text = "# Parameters of a plan\n\nKeys are written as `--set KEY=VALUE` takes them; requests and files use the same \
                    names, nested. `[]` stands for each entry of a list. Renewed by `UPDATE_GOLDEN=1 cargo test --test it \
                    contract`.\n\n| key | default | range | meaning |\n| --- | --- | --- | --- |\n"
        .to_owned();
    for parameter in list() {
        let default = parameter.default_text();
        let default = if default.is_empty() { default } else { format!("`{default}`") };
        let description = parameter.description.replace('|', "\\|");
        // Writing to a String cannot fail.
        let _ = writeln!(text, "| `{}` | {default} | {} | {description} |", parameter.key, parameter.range_text());
    }
    text
}

/// Keys with defaults and ranges, one a line, for the help of the command line.
#[must_use]
pub fn help() -> String {
    let mut text = String::new();
    for parameter in list() {
        let default = parameter.default_text();
        let parts = [if default.is_empty() { default } else { format!("default {default}") }, parameter.range_text()];
        let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        let _ = writeln!(text, "  {:<34} {}", parameter.key, parts.join("; "));
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
