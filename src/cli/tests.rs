use std::path::PathBuf;

use super::inspect::{InspectArgs, report};
use super::*;
use crate::geometry::LengthUnit;
use crate::geometry::demo_parts::DemoPart;

fn inspect(bytes: &[u8], unit: Option<LengthUnit>, json: bool) -> Result<String, CliError> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("part");
    std::fs::write(&file, bytes).expect("a file");
    report(&InspectArgs { file, unit, json })
}

const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 1 2\n";

#[test]
fn inspect_says_what_is_wrong_and_what_to_do() {
    let text = inspect(TRIANGLE, Some(LengthUnit::Centimetre), false).expect("a report");
    for line in
        ["size        10.000 × 10.000 × 0.000 mm", "triangles   1 of 2 in the file", "open along 3 edges", "→ only the side"]
    {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
}

#[test]
fn inspect_json_has_units_in_its_keys() {
    let text = inspect(TRIANGLE, Some(LengthUnit::Inch), true).expect("a report");
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["bbox_mm"]["max"], serde_json::json!([25.4, 25.4, 0.0]));
    assert_eq!((json["unit"].as_str(), json["format"].as_str()), (Some("inch"), Some("obj")));
    assert_eq!(json["warnings"][0]["code"], "open_surface");
    assert!(json["volume_mm3"].is_null());
}

#[test]
fn bad_input_exits_2_with_the_place() {
    let error = inspect(b"v 0 0 nan\n", Some(LengthUnit::Metre), false).expect_err("not finite");
    assert!(error.exit_code() == 2 && error.to_string().contains("line 1"), "{error}");
    let error = inspect(TRIANGLE, None, false).expect_err("no unit");
    assert!(error.to_string().ends_with("give one of mm, cm, m, inch with --unit"), "{error}");
    let missing = InspectArgs { file: PathBuf::from("/nowhere/part.stl"), unit: None, json: false };
    assert_eq!(report(&missing).expect_err("no file").exit_code(), 2);
}

#[test]
fn part_writes_what_inspect_reads() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("base.stl");
    let args = part::PartArgs { part: DemoPart::Base, triangles: 20_000, out: out.clone() };
    part::run(&args).expect("a file");
    let text = report(&InspectArgs { file: out, unit: Some(LengthUnit::Millimetre), json: false }).expect("a report");
    assert!(text.contains("121.000 × 73.000 × 37.000 mm") && text.contains("no problems found"), "{text}");
    let few = part::PartArgs { triangles: 10, ..args };
    assert_eq!(part::run(&few).expect_err("too few").exit_code(), 2);
}
