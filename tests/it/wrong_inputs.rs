//! Wrong inputs, as users write them: each is refused, at the field that is wrong, with what was found, what is allowed and what
//! to do.

use std::f64::consts::{FRAC_PI_3, FRAC_PI_6};
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};
use vantage::cell::{Presets, SpecLibrary};
use vantage::check::{Reference, check};
use vantage::geometry::LengthUnit;
use vantage::geometry::mesh_io::{self, Limits};
use vantage::planning::context::{Context, Silent};

/// A document with what makes it wrong, the pointer at fault, and words that its finding has.
struct Wrong {
    document: Value,
    pointer: &'static str,
    words: &'static [&'static str],
}

fn changed(preset: Value, change: impl FnOnce(&mut Value), pointer: &'static str, words: &'static [&'static str]) -> Wrong {
    let mut document = preset;
    change(&mut document);
    Wrong { document, pointer, words }
}

fn as_json<E: std::fmt::Debug>(spec: Result<impl serde::Serialize, E>) -> Value {
    serde_json::to_value(spec.expect("a preset")).expect("JSON")
}

fn scanner(change: impl FnOnce(&mut Value), pointer: &'static str, words: &'static [&'static str]) -> Wrong {
    changed(as_json(Presets.scanner("transcan-c-nominal")), change, pointer, words)
}

fn robot(change: impl FnOnce(&mut Value), pointer: &'static str, words: &'static [&'static str]) -> Wrong {
    changed(as_json(Presets.robot("hans-e05")), change, pointer, words)
}

fn turntable(change: impl FnOnce(&mut Value), pointer: &'static str, words: &'static [&'static str]) -> Wrong {
    changed(as_json(Presets.turntable("minas-a6-500")), change, pointer, words)
}

fn cell(change: impl FnOnce(&mut Value), pointer: &'static str, words: &'static [&'static str]) -> Wrong {
    changed(as_json(Presets.cell("e05-transcan")), change, pointer, words)
}

fn params(document: Value, pointer: &'static str, words: &'static [&'static str]) -> Wrong {
    Wrong { document, pointer, words }
}

fn remove(document: &mut Value, field: &str) {
    document.as_object_mut().expect("an object").remove(field).expect("it was there");
}

fn wrong_scanners() -> Vec<Wrong> {
    vec![
        scanner(
            |s| s["left"]["fx"] = json!(16.0),
            "/left/fx",
            &["is 16 px", "allowed is 536 to 1000000 px", "16 mm at 1.85 µm a pixel are 8648.6 px"],
        ),
        scanner(|s| s["right"]["fy"] = json!(12.0), "/right/fy", &["is 12 px", "allowed is 407 to 1000000 px", "millimetres"]),
        scanner(
            |s| s["projector"]["fx"] = json!(35.0),
            "/projector/fx",
            &["is 35 px", "2000 px show", "divide it by the pixel pitch in mm"],
        ),
        scanner(|s| s["mass_kg"] = json!(-2.7), "/mass_kg", &["is -2.7 kg", "allowed is 0.01 to 100 kg"]),
        scanner(|s| s["mass_kg"] = json!("2.7 kg"), "/mass_kg", &["is \"2.7 kg\"", "expected a number"]),
        scanner(|s| s["depth_mm"]["near"] = json!(600.0), "/depth_mm", &["near 600", "must be near < best < far"]),
        scanner(
            |s| s["depth_mm"] = json!({"near": 0.41, "best": 0.48, "far": 0.565}),
            "/depth_mm/near",
            &["is 0.41 mm", "allowed is 1 to 10000 mm"],
        ),
        scanner(
            |s| s["left"]["incidence_max_deg"] = json!(95.0),
            "/left/incidence_max_deg",
            &["is 95 °", "allowed is 1 to 89.9 °"],
        ),
        scanner(
            |s| s["left"]["pixel_pitch_um"] = json!(0.00185),
            "/left/pixel_pitch_um",
            &["is 0.00185 µm", "allowed is 0.1 to 100 µm"],
        ),
        scanner(|s| s["right"]["width_px"] = json!(8), "/right/width_px", &["is 8 px", "allowed is 16 to 100000 px"]),
        scanner(|s| s["block_cube_mm"] = json!(0.14), "/block_cube_mm", &["is 0.14 mm", "allowed is 1 to 10000 mm"]),
    ]
}

fn wrong_rigs() -> Vec<Wrong> {
    vec![
        scanner(
            |s| {
                let (left, right) = (s["left"]["scanner_from_device"].clone(), s["right"]["scanner_from_device"].clone());
                (s["left"]["scanner_from_device"], s["right"]["scanner_from_device"]) = (right, left);
            },
            "/right/scanner_from_device",
            &["the right camera must lie at least 1 mm along +x", "are the two swapped", "left x = 101 mm"],
        ),
        scanner(
            |s| s["left"]["scanner_from_device"]["quaternion_xyzw"] = json!([0, 0, 0, 2]),
            "/left/scanner_from_device/quaternion_xyzw",
            &["has norm 2", "unit quaternion", "norm 1 ± 0.000001"],
        ),
        scanner(
            |s| s["left"]["scanner_from_device"]["rpy_deg"] = json!([0, 11.5, 0]),
            "/left/scanner_from_device",
            &["gives both quaternion_xyzw and rpy_deg", "give one of the two"],
        ),
        scanner(
            |s| s["left"]["scanner_from_device"] = json!({"translation_mm": [-101, 0, 0], "rpy_deg": [0, 11500, 0]}),
            "/left/scanner_from_device",
            &["rpy_deg has 11500 °", "allowed is -3600 to 3600 °"],
        ),
        scanner(
            |s| s["right"]["scanner_from_device"] = json!({"translation_mm": [101, 0, 0], "rpy_deg": [0, 90, 0]}),
            "/right",
            &["does not see the point (0, 0, 480) of best focus"],
        ),
        scanner(|s| remove(s, "practical_volume_mm"), "/practical_volume_mm", &["is missing", "mm, 1 to 10000 each"]),
        scanner(|s| s["colour"] = json!("white"), "/colour", &["unknown field `colour`", "allowed are", "mass_kg"]),
    ]
}

fn wrong_robots_and_turntables() -> Vec<Wrong> {
    vec![
        robot(|r| r["payload_kg"] = json!(-5.0), "/payload_kg", &["is -5 kg", "allowed is 0.1 to 2000 kg"]),
        robot(|r| r["joints"][0]["min_deg"] = json!(400.0), "/joints/0/min_deg", &["is 400°", "not below max_deg"]),
        robot(
            |r| r["joints"][2]["max_speed_deg_per_s"] = json!(0.05),
            "/joints/2/max_speed_deg_per_s",
            &["is 0.05 °/s", "allowed is 0.1 to 3600 °/s"],
        ),
        robot(|r| drop(r["joints"].as_array_mut().expect("a list").pop()), "/joints", &["has 5 elements", "a list of 6"]),
        robot(|r| r["links"] = json!([]), "/links", &["is empty", "at least one capsule"]),
        robot(|r| r["links"][0]["link"] = json!(9), "/links/0/link", &["is 9", "allowed is 0 to 6"]),
        robot(|r| r["kinematics"]["kind"] = json!("scara"), "/kinematics", &["unknown value `scara`", "`opw`, `ur`, `chain`"]),
        robot(|r| remove(&mut r["joints"][3], "max_deg"), "/joints/3/max_deg", &["is missing", "Highest angle, degrees"]),
        turntable(|t| t["plate_diameter_mm"] = json!(0.5), "/plate_diameter_mm", &["is 0.5 mm", "allowed is 1 to 10000 mm"]),
        turntable(
            |t| t["rotation"] = json!({"kind": "limited", "min_deg": 180.0, "max_deg": -180.0}),
            "/rotation/min_deg",
            &["is 180°", "not below max_deg -180°"],
        ),
        turntable(
            |t| t["rotation"] = json!({"min_deg": -180.0, "max_deg": 180.0}),
            "/rotation/kind",
            &["is missing", "continuous, limited"],
        ),
        turntable(|t| t["max_speed_deg_per_s"] = json!(0.0), "/max_speed_deg_per_s", &["is 0 °/s", "allowed is 0.1 to 3600 °/s"]),
    ]
}

fn wrong_cells() -> Vec<Wrong> {
    vec![
        cell(|c| c["robot"] = json!("hans-e5"), "/robot", &["is \"hans-e5\"", "known robot names", "hans-e05"]),
        cell(
            |c| c["base_from_table"]["translation_mm"] = json!([2900, 0, -200]),
            "/base_from_table",
            &["mm from the robot's shoulder, out of reach", "reach", "move the table nearer"],
        ),
        cell(|c| c["home_deg"][2] = json!(170.0), "/home_deg/2", &["is 170.000°", "the axis allows"]),
        cell(|c| drop(c["home_deg"].as_array_mut().expect("a list").pop()), "/home_deg", &["has 6 elements", "a list of 7"]),
        cell(|c| c["floor_mm"] = json!(-38_000), "/floor_mm", &["is -38000 mm", "allowed is -10000 to 10000 mm"]),
        cell(|c| c["mount_mass_kg"] = json!(4.0), "/scanner", &["weighs 2.7 kg and its mount 4 kg", "payload of 5 kg"]),
        cell(
            |c| c["base_from_table"] = json!({"translation_mm": [400, 0, -200]}),
            "/base_from_table/quaternion_xyzw",
            &["is missing", "rpy_deg"],
        ),
        cell(|c| c["mount"] = json!([{"name": "adapter"}]), "/mount/0/shape", &["is missing", "Shape of the body"]),
        cell(
            |c| c["mount"][0]["shape"] = json!({"kind": "cylinder", "radius_mm": 40.0}),
            "/mount/0/shape/height_mm",
            &["is missing", "mm, above 0"],
        ),
        cell(
            |c| c["obstacles"] = json!([{"name": "column", "shape": {"kind": "mesh", "mesh": "column.stl"}}]),
            "/obstacles/0/shape/mesh",
            &["is \"column.stl\"", "known mesh names: none"],
        ),
        cell(|c| remove(c, "flange_from_scanner"), "/flange_from_scanner", &["is missing", "the hand-eye result"]),
    ]
}

fn wrong_params() -> Vec<Wrong> {
    vec![
        params(json!({"selection": {"target": 98.5}}), "/selection/target", &["is 98.5", "allowed is 0 to 1"]),
        params(json!({"selection": {"goall": "min_time"}}), "/selection/goall", &["unknown field `goall`", "goal"]),
        params(json!({"motion": {"speed_fraction": 25}}), "/motion/speed_fraction", &["is 25", "allowed is 0.01 to 1"]),
        params(json!({"motion": {"clearance_mm": 0}}), "/motion/clearance_mm", &["is 0 mm", "allowed is 1 to 200 mm"]),
        params(json!({"setups": 9}), "/setups", &["is 9", "allowed is 1 to 4"]),
        params(json!({"scan": {"brightness": 12}}), "/scan/brightness", &["is 12", "allowed is 0 to 9"]),
        params(json!({"limits": {"camera_deg": 95}}), "/limits/camera_deg", &["is 95 °", "allowed is 1 to 89.9 °"]),
        params(json!({"candidates": {"strategies": []}}), "/candidates/strategies", &["is empty", "name at least one"]),
        params(
            json!({"regions": {"features": [{"region": {"kind": "faces", "faces": [0]}}]}}),
            "/regions/features/0/tolerance_mm",
            &["is missing", "Width of the tolerance zone from limit to limit, mm"],
        ),
        params(
            json!({"motion": {"corners": "round", "table": "alone"}}),
            "/motion/corners",
            &["is \"round\"", "motion.table is \"alone\""],
        ),
    ]
}

#[test]
fn each_wrong_document_is_refused_where_it_is_wrong_with_found_allowed_and_what_to_do() {
    let all: Vec<Wrong> = [wrong_scanners(), wrong_rigs(), wrong_robots_and_turntables(), wrong_cells(), wrong_params()]
        .into_iter()
        .flatten()
        .collect();
    assert!(all.len() >= 40, "{}", all.len());
    let never = AtomicBool::new(false);
    for Wrong { document, pointer, words } in all {
        let ctx = Context::new(&never, &Silent);
        let errors =
            check(document, &Presets, None, &Reference::default(), &ctx).map(|sound| sound.description).expect_err(pointer);
        let at_fault = errors.iter().filter(|error| error.pointer.starts_with(pointer));
        let found = at_fault.clone().any(|error| words.iter().all(|word| error.detail.contains(word)));
        assert!(found, "{pointer} with {words:?} is not in {errors:#?}");
    }
}

#[test]
fn an_incomplete_file_of_each_kind_is_told_all_that_it_lacks_at_once() {
    let never = AtomicBool::new(false);
    for (document, lacking) in [
        (
            json!({"depth_mm": {"best": 480}}),
            &["/name", "/depth_mm/near", "/depth_mm/far", "/left", "/right", "/projector", "/mass_kg", "/practical_volume_mm"][..],
        ),
        (
            json!({"kinematics": {"kind": "ur"}}),
            &["/name", "/payload_kg", "/kinematics/d1_mm", "/kinematics/d6_mm", "/joints", "/links"],
        ),
        (
            json!({"rotation": {"kind": "limited"}}),
            &["/name", "/plate_diameter_mm", "/plate_thickness_mm", "/rotation/min_deg", "/max_speed_deg_per_s"],
        ),
        (
            json!({"base_from_table": {}}),
            &["/name", "/scanner", "/robot", "/turntable", "/base_from_table/translation_mm", "/home_deg"],
        ),
    ] {
        let ctx = Context::new(&never, &Silent);
        let errors = check(document.clone(), &Presets, None, &Reference::default(), &ctx).map(|sound| sound.description);
        let errors = errors.expect_err("incomplete");
        for pointer in lacking {
            let found = errors
                .iter()
                .find(|error| error.pointer == *pointer)
                .unwrap_or_else(|| panic!("{pointer} is not in {errors:#?}"));
            assert!(found.detail.starts_with("is missing: "), "with its meaning: {found}");
        }
    }
}

/// Pointers of all numbers in a document.
fn numbers(value: &Value, at: &str, into: &mut Vec<String>) {
    match value {
        Value::Number(_) => into.push(at.to_owned()),
        Value::Array(items) => items.iter().enumerate().for_each(|(index, item)| numbers(item, &format!("{at}/{index}"), into)),
        Value::Object(fields) => fields.iter().for_each(|(name, item)| numbers(item, &format!("{at}/{name}"), into)),
        Value::Null | Value::Bool(_) | Value::String(_) => {}
    }
}

/// Each number of a preset, replaced by one that no hardware has, is refused at its field or at one that it makes impossible.
#[test]
fn no_number_of_a_specification_may_be_absurd() {
    let presets = [
        ("scanner", as_json(Presets.scanner("transcan-c-nominal"))),
        ("robot", as_json(Presets.robot("hans-e05"))),
        ("turntable", as_json(Presets.turntable("minas-a6-500"))),
        ("cell", as_json(Presets.cell("e05-transcan"))),
    ];
    let never = AtomicBool::new(false);
    let (mut tried, mut taken) = (0, Vec::new());
    for (kind, preset) in presets {
        let mut pointers = Vec::new();
        numbers(&preset, "", &mut pointers);
        for pointer in pointers {
            for absurd in [1e300, -1e300] {
                let mut document = preset.clone();
                *document.pointer_mut(&pointer).expect("it is there") = json!(absurd);
                tried += 1;
                let ctx = Context::new(&never, &Silent);
                match check(document, &Presets, None, &Reference::default(), &ctx) {
                    Ok(_) => taken.push(format!("{kind} {pointer} = {absurd:e}")),
                    Err(errors) => {
                        // The field itself, one that holds it, or its neighbour, where a range turns around.
                        let parent = pointer.rsplit_once('/').map_or("", |(parent, _)| parent);
                        let is_blamed = errors.iter().any(|error| {
                            error.pointer.starts_with(parent) || pointer.starts_with(&error.pointer) && !error.pointer.is_empty()
                        });
                        assert!(is_blamed, "{kind} {pointer} = {absurd:e}: {errors:#?}");
                        assert!(errors.iter().all(|error| !error.detail.is_empty()), "{errors:#?}");
                    }
                }
            }
        }
    }
    println!("{tried} absurd numbers, {} taken", taken.len());
    assert!(tried > 200 && taken.is_empty(), "{taken:#?}");
}

#[test]
fn units_that_are_none_are_refused_with_those_that_are() {
    for unit in ["furlong", "", "µm", "feet", "millimeter s", "1"] {
        let error = unit.parse::<LengthUnit>().expect_err(unit).to_string();
        assert!(error.contains(&format!("{unit:?}")) && error.contains("use one of mm, cm, m, inch"), "{error}");
    }
}

#[test]
fn files_that_are_no_meshes_are_refused_with_the_place() {
    let cases: [(&[u8], &[&str]); 6] = [
        (b"", &["the file is empty"]),
        (b"no mesh at all\n", &["STL, OBJ or PLY"]),
        (b"v 0 0 nan\nf 1 1 1\n", &["line 1", "nan", "not a finite number"]),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", &["line 4", "vertex 9", "3 vertices"]),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", &["no surface to scan"]),
        (b"v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", &["line 2", "check the file and its unit"]),
    ];
    for (bytes, words) in cases {
        let error = mesh_io::read(bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect_err("no mesh").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{words:?} are not in {error}");
    }
}

/// An input that is not wrong, and hardly what was meant: a warning, no finding.
#[test]
fn a_home_in_radians_is_warned_of_where_it_collides_with_nothing() {
    let mut document = as_json(Presets.cell("e05-transcan"));
    document["home_deg"] = json!([0.0, -FRAC_PI_6, FRAC_PI_3, 0.0, FRAC_PI_6, 0.0, 0.0]);
    let never = AtomicBool::new(false);
    let ctx = Context::new(&never, &Silent);
    let told = match check(document, &Presets, None, &Reference::default(), &ctx) {
        Ok(sound) => {
            sound.warnings.iter().map(|warning| format!("{}: {} {}", warning.pointer, warning.detail, warning.remedy)).collect()
        }
        Err(errors) => errors.iter().map(ToString::to_string).collect::<Vec<_>>(),
    };
    let [told] = &told[..] else { panic!("{told:?}") };
    assert!(
        told.starts_with("/home_deg: ") && told.contains("radians") && told.contains("[0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0]"),
        "{told}"
    );
}
