//! Lists of values that are closed are enums in the API document, so that clients made from it have them.

use serde_json::{Map, Value, json};
use vantage::geometry::LengthUnit;
use vantage::wire::JobProblem;
use vantage::wire::inspection::Scan;

fn document() -> Value {
    serde_json::to_value(vantage::http::openapi()).expect("JSON")
}

/// Values that a schema lists, or the one that it refers to; `None` for any value.
fn listed<'d>(document: &'d Value, schema: &'d Value) -> Option<&'d Vec<Value>> {
    if let Some(reference) = schema["$ref"].as_str() {
        let name = reference.rsplit('/').next()?;
        return listed(document, &document["components"]["schemas"][name]);
    }
    let of_variants = || schema["oneOf"].as_array()?.iter().find_map(|variant| listed(document, variant));
    schema["enum"].as_array().or_else(of_variants)
}

/// Properties of the objects in a schema, with the objects that it is put together of.
fn properties(schema: &Value) -> Map<String, Value> {
    let parts = ["allOf", "oneOf", "anyOf"].into_iter().flat_map(|keyword| schema[keyword].as_array().into_iter().flatten());
    let own = schema["properties"].as_object().into_iter().flatten().map(|(name, property)| (name.clone(), property.clone()));
    own.chain(parts.flat_map(properties)).collect()
}

/// Lists that were published as any text.
const LISTS: [(&str, &str, &str); 29] = [
    ("DeviceDocument", "name", "left"),
    ("DeviceLimitDocument", "device", "projector"),
    ("Scan", "unit", "inch"),
    ("TakenScanDocument", "unit", "mm"),
    ("ByteMeaning", "meaning", "not_asked"),
    ("Problem", "code", "invalid_fields"),
    ("JobProblem", "code", "job_input_invalid"),
    ("JobEvent", "code", "no_plan"),
    ("JobEvent", "code", "retention_disk"),
    ("MeshNote", "code", "unit_suspect"),
    ("MeshNote", "code", "health_unreadable"),
    ("ReadinessCheck", "name", "free_space"),
    ("StationDocument", "posture", "front, elbow up, no flip"),
    ("StationDocument", "posture", "back, elbow down, flip"),
    ("Health", "status", "ok"),
    ("Readiness", "status", "ready"),
    ("CalibrationData", "schema", "vantage.calibration_data/1"),
    ("CalibrationDocument", "schema", "vantage.calibration/1"),
    ("CandidateListing", "schema", "vantage.candidates/1"),
    ("CoverageListing", "schema", "vantage.coverage/1"),
    ("InspectionDocument", "schema", "vantage.inspection/1"),
    ("LearnedDocument", "schema", "vantage.learned/1"),
    ("LossListing", "schema", "vantage.losses/1"),
    ("MissedListing", "schema", "vantage.missed/1"),
    ("PlanDocument", "schema", "vantage.plan/1"),
    ("ProgramDocument", "schema", "vantage.program/1"),
    ("RunRecordDocument", "schema", "vantage.run/1"),
    ("Summary", "schema", "vantage.summary/1"),
    ("ViewpointsDocument", "schema", "vantage.viewpoints/1"),
];

#[test]
fn closed_lists_are_enums() {
    let document = document();
    for (schema, property, value) in LISTS {
        let properties = properties(&document["components"]["schemas"][schema]);
        let values = listed(&document, properties.get(property).unwrap_or_else(|| panic!("{schema} has no {property}")));
        assert!(values.is_some_and(|values| values.contains(&json!(value))), "{schema} {property}: {values:?}");
    }
    let codes: Vec<&str> = vantage::http::Code::ALL.iter().map(|code| code.as_str()).collect();
    let schemas = &document["components"]["schemas"];
    assert_eq!(schemas["ProblemCode"]["enum"], json!(codes));
    assert_eq!(schemas["MeshUnit"]["enum"], json!(LengthUnit::ALL.map(LengthUnit::as_str)));
    assert_eq!(schemas["Posture"]["enum"].as_array().map(Vec::len), Some(8));
}

/// Keys of times were any text.
#[test]
fn keys_of_stage_times_are_stages() {
    let document = document();
    let schemas = &document["components"]["schemas"];
    let stages = &schemas["Stage"]["enum"];
    assert!(stages.as_array().is_some_and(|stages| stages.len() > 10), "{stages}");
    assert_eq!(schemas["StageSeconds"]["propertyNames"]["enum"], *stages);
    for job in ["Job", "JobListItem", "SparseJob", "SparseJobListItem"] {
        assert_eq!(schemas[job]["properties"]["timings"]["propertyNames"]["enum"], *stages, "{job}");
    }
}

#[test]
fn stable_codes_and_constants_list_their_values() {
    let document = document();
    let mut found = 0;
    for (schema, value) in document["components"]["schemas"].as_object().expect("schemas") {
        for (name, property) in properties(value) {
            let description = property["description"].as_str().unwrap_or_default();
            if ["Stable code", "Always", "Schema name", "`vantage."].iter().any(|start| description.starts_with(start)) {
                assert!(listed(&document, &property).is_some(), "{schema} {name} is any text: {property}");
                found += 1;
            }
        }
    }
    assert!(found > 15, "{found}");
}

/// A stored document of another release may hold a value that this one does not list.
#[test]
fn documents_with_other_values_are_still_read() {
    let problem = json!({"type": "", "title": "", "detail": "", "code": "of_another_release", "errors": []});
    let problem: JobProblem = serde_json::from_value(problem).expect("a problem");
    assert_eq!(problem.code, "of_another_release");
    let id = "01a1f77c-78a1-7554-855a-a9513c22aa2b";
    let scan = json!({
        "id": id, "job_id": id, "view": null, "name": null, "unit": "yard", "frame": null, "sha256": "", "size_bytes": 0,
        "created_at": ""
    });
    let scan: Scan = serde_json::from_value(scan).expect("a scan");
    assert_eq!(scan.unit.as_deref(), Some("yard"));
}

/// Generators of clients make nothing of a pattern.
#[test]
fn no_parameter_lists_names_in_a_pattern() {
    let lists_names = |pattern: &str| {
        let names = pattern.strip_prefix("^(").and_then(|rest| rest.strip_suffix(")$"));
        names.is_some_and(|names| names.chars().all(|letter| letter.is_alphanumeric() || "|_-.".contains(letter)))
    };
    assert!(lists_names("^(json|csv)$") && !lists_names("^([0-9]|60)s?$"));
    let document = document();
    let items = document["paths"].as_object().expect("paths");
    let operations = items.iter().flat_map(|(path, item)| item.as_object().expect("methods").values().map(move |of| (path, of)));
    let mut patterns = 0;
    for (path, operation) in operations {
        for parameter in operation["parameters"].as_array().into_iter().flatten() {
            let Some(pattern) = parameter["schema"]["pattern"].as_str() else { continue };
            assert!(!lists_names(pattern), "{path} {}: {pattern}", parameter["name"]);
            patterns += 1;
        }
    }
    assert!(patterns > 10, "{patterns}");
}
