//! Parameters as people and clients read them: `api/parameters.md`, the help of the command line, and the ranges in the API
//! document. All are made from the `KNOBS` of the structs of parameters. The ranges of specifications are in the API document too.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::schema::{ArrayItems, Object};
use utoipa::openapi::{RefOr, Schema};

use super::bulk::JobUpdate;
use super::calibration::{CalibrationRequest, OBSERVATION_RANGES};
use super::check::CheckRequest;
use super::job::JobRequest;
use super::run::{OverrideRequest, RunRequest};
use crate::cell::{
    AxisSpec, BoardPoseSpec, CalibrationProvenance, CellSpec, CompensationProvenance, DepthSpec, DeviceSpec, EulerPoseSpec,
    ExposureSpec, LinkBodySpec, LinkSpec, OpwSpec, RangeGroup, RobotSpec, RotationSpec, RunoutSpec, ScannerResidualsSpec,
    ScannerSpec, ShapeSpec, TurntableSpec, UrSpec, did_you_mean,
};
use crate::inspection::coverage::CompareParams;
use crate::inspection::simulated_scanner::SimulationParams;
use crate::inspection::{AlignParams, InspectionParams};
use crate::planning::params::{Knob, KnobGroup, PlanParams, Region, RescanParams};

/// Ranges of the numbers of specifications and regions.
const SPEC_RANGES: [RangeGroup; 21] = [
    AxisSpec::RANGES,
    BoardPoseSpec::RANGES,
    CalibrationProvenance::RANGES,
    CellSpec::RANGES,
    CompensationProvenance::RANGES,
    DepthSpec::RANGES,
    DeviceSpec::RANGES,
    EulerPoseSpec::RANGES,
    ExposureSpec::RANGES,
    LinkBodySpec::RANGES,
    LinkSpec::RANGES,
    OpwSpec::RANGES,
    Region::RANGES,
    RobotSpec::RANGES,
    RotationSpec::RANGES,
    RunoutSpec::RANGES,
    ScannerResidualsSpec::RANGES,
    ScannerSpec::RANGES,
    ShapeSpec::RANGES,
    TurntableSpec::RANGES,
    UrSpec::RANGES,
];

/// Ranges of the numbers of requests.
const REQUEST_RANGES: [RangeGroup; 6] = [
    CalibrationRequest::RANGES,
    CheckRequest::RANGES,
    JobRequest::RANGES,
    JobUpdate::RANGES,
    OverrideRequest::RANGES,
    RunRequest::RANGES,
];

/// Groups of parameters, each with the path that leads to it.
type Groups = Vec<(&'static str, KnobGroup)>;

/// Parameter of a plan, an inspection, a rescan or the simulated scanner.
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

fn inspection_groups() -> Groups {
    vec![("align", AlignParams::KNOBS), ("compare", CompareParams::KNOBS)]
}

fn rescan_groups() -> Groups {
    vec![("", RescanParams::KNOBS)]
}

/// Lists the parameters of an inspection.
#[must_use]
pub fn of_inspections() -> Vec<Parameter> {
    of_groups::<InspectionParams>(&inspection_groups())
}

/// Lists the parameters of a rescan.
#[must_use]
pub fn of_rescans() -> Vec<Parameter> {
    of_groups::<RescanParams>(&rescan_groups())
}

/// Lists the parameters of the simulated scanner.
#[must_use]
pub fn of_simulated_scans() -> Vec<Parameter> {
    of_groups::<SimulationParams>(&[("", SimulationParams::KNOBS)])
}

/// The default of a parameter, by its key: that of the whole, else that of its own schema, as for an entry of a list; null
/// without one.
fn default_of(whole: &Value, key: &str, property: &RefOr<Schema>) -> Value {
    let of_property = || match property {
        RefOr::T(Schema::Object(object)) => object.default.as_ref(),
        RefOr::Ref(_) | RefOr::T(_) => None,
    };
    let of_whole = whole.pointer(&format!("/{}", key.replace('.', "/"))).filter(|default| !default.is_null());
    of_whole.or_else(of_property).cloned().unwrap_or_default()
}

fn defaults<T: Default + Serialize>() -> Value {
    serde_json::to_value(T::default()).unwrap_or_default()
}

/// Key of a parameter of a group.
fn key_of(path: &str, knob: &Knob) -> String {
    if path.is_empty() { knob.field.to_owned() } else { format!("{path}.{}", knob.field) }
}

fn of_groups<T: ToSchema + Default + Serialize>(groups: &[(&str, KnobGroup)]) -> Vec<Parameter> {
    let whole = defaults::<T>();
    let mut schemas = Vec::new();
    T::schemas(&mut schemas);
    let schemas: BTreeMap<String, RefOr<Schema>> = schemas.into_iter().collect();
    let is_group = |key: &str| groups.iter().any(|(path, _)| path.trim_end_matches("[]") == key);
    let mut parameters = Vec::new();
    for (path, group) in groups {
        let RefOr::T(Schema::Object(schema)) = (group.schema)() else { continue };
        for knob in group.knobs {
            let key = key_of(path, knob);
            let Some(property) = schema.properties.get(knob.field).filter(|_| !is_group(&key)) else { continue };
            parameters.push(Parameter {
                default: default_of(&whole, &key, property),
                key,
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

/// Lists of parameters that requests carry, each with its title and the place where it is given.
#[must_use]
pub fn lists() -> [(&'static str, &'static str, Vec<Parameter>); 3] {
    [
        ("Parameters of a plan", "`params` of a job, and `vantage plan`", list()),
        ("Parameters of an inspection", "`params` of an inspection, and `vantage compare`", of_inspections()),
        ("Parameters of a rescan", "`params` of the request for a rescan, and `vantage rescan`", of_rescans()),
    ]
}

/// `api/parameters.md`.
#[must_use]
pub fn markdown() -> String {
    let mut text = "# Parameters\n\nKeys are written as `--set KEY=VALUE` takes them; requests and files use the same names, \
                    nested. `[]` stands for each entry of a list. Renewed by `UPDATE_GOLDEN=1 cargo test --test it contract`.\n"
        .to_owned();
    // Writing to a String cannot fail.
    for (title, place, parameters) in lists() {
        let _ = writeln!(text, "\n## {title}\n\n{place}.\n\n| key | default | range | meaning |\n| --- | --- | --- | --- |");
        for parameter in parameters {
            let default = parameter.default_text();
            let default = if default.is_empty() { default } else { format!("`{default}`") };
            let description = parameter.description.replace('|', "\\|");
            let _ = writeln!(text, "| `{}` | {default} | {} | {description} |", parameter.key, parameter.range_text());
        }
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

/// Adds defaults and ranges of every parameter, and the ranges of specifications, to the schemas of an API document.
pub fn add_ranges(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    let wholes = [
        (PlanParams::knobs(), defaults::<PlanParams>()),
        (inspection_groups(), defaults::<InspectionParams>()),
        (rescan_groups(), defaults::<RescanParams>()),
    ];
    for (groups, whole) in &wholes {
        for (path, group) in groups {
            let Some(RefOr::T(Schema::Object(schema))) = schemas.get_mut(group.name) else { continue };
            for knob in group.knobs {
                add_knob(schema, knob, whole, &key_of(path, knob));
            }
        }
    }
    add_fixed_ranges(schemas);
}

/// Adds the ranges alone of parameters, specifications and requests to schemas by which values are told.
pub(super) fn add_bounds(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    let simulation = vec![("", SimulationParams::KNOBS)];
    for (_, group) in [PlanParams::knobs(), inspection_groups(), rescan_groups(), simulation].into_iter().flatten() {
        let Some(RefOr::T(Schema::Object(schema))) = schemas.get_mut(group.name) else { continue };
        for knob in group.knobs {
            if let Some((property, range)) = schema.properties.get_mut(knob.field).zip(knob.range) {
                add_range(property, range);
            }
        }
    }
    add_fixed_ranges(schemas);
}

/// Adds the ranges of specifications, requests and observations.
fn add_fixed_ranges(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    for group in SPEC_RANGES.iter().chain(&REQUEST_RANGES).chain(&OBSERVATION_RANGES) {
        let Some(schema) = schemas.get_mut(group.name) else { continue };
        for range in group.ranges {
            for object in objects(schema) {
                if let Some(property) = object.properties.get_mut(range.field) {
                    add_range(property, range.range);
                }
            }
        }
    }
}

/// The object that a schema is, or those that it chooses from.
fn objects(schema: &mut RefOr<Schema>) -> Vec<&mut Object> {
    match schema {
        RefOr::T(Schema::Object(object)) => vec![object],
        RefOr::T(Schema::OneOf(one_of)) => one_of.items.iter_mut().flat_map(objects).collect(),
        RefOr::Ref(_) | RefOr::T(_) => Vec::new(),
    }
}

/// Adds default, range and number of entries of a parameter to the schema of its group.
fn add_knob(schema: &mut Object, knob: &Knob, whole: &Value, key: &str) {
    let is_optional = !schema.required.iter().any(|field| field == knob.field);
    let Some(property) = schema.properties.get_mut(knob.field) else { return };
    if let Some(range) = knob.range {
        let default = default_of(whole, key, property);
        add_range(property, range);
        // Fields of an object that is given as a whole have defaults, and are required within it.
        if let RefOr::T(Schema::Object(number)) = &mut *property
            && (is_optional || !default.is_null())
        {
            number.default = Some(default);
        }
    }
    if let RefOr::T(Schema::Array(list)) = property {
        (list.min_items, list.max_items) = (knob.entries.map(|[min, _]| min), knob.entries.map(|[_, max]| max));
    }
}

/// A bound as an integer where it is one.
fn bound(value: f64) -> utoipa::Number {
    if value.fract() == 0.0 { utoipa::Number::Int(value as isize) } else { utoipa::Number::Float(value) }
}

/// Adds the range of a number, or of each number of a list.
fn add_range(property: &mut RefOr<Schema>, [min, max]: [f64; 2]) {
    match property {
        RefOr::T(Schema::Object(number)) => (number.minimum, number.maximum) = (Some(bound(min)), Some(bound(max))),
        RefOr::T(Schema::Array(list)) => {
            if let ArrayItems::RefOrSchema(items) = &mut list.items {
                add_range(items, [min, max]);
            }
        }
        RefOr::Ref(_) | RefOr::T(_) => {}
    }
}

#[cfg(test)]
mod tests;
