use std::collections::BTreeSet;

use serde::Deserialize;
use serde_json::{Value, json};

use super::*;
use crate::cell::{FieldError, FieldRange, Presets, SpecKind, preset_text};

fn preset(kind: SpecKind, name: &str) -> Value {
    toml::from_str(preset_text(kind, name).expect("a preset")).expect("TOML")
}

/// A cell with its parts written out and every number given; some of them exclude each other.
fn cell(robot: &str) -> Value {
    let mut cell = preset(SpecKind::Cell, "e05-transcan");
    cell["scanner"] = preset(SpecKind::Scanner, "transcan-c");
    cell["robot"] = preset(SpecKind::Robot, robot);
    cell["turntable"] = preset(SpecKind::Turntable, "minas-a6-500");
    let device = &mut cell["scanner"]["left"];
    (device["f_number"], device["circle_of_confusion_um"], device["focus_mm"]) = (json!(8.0), json!(10.0), json!(480.0));
    device["in_focus_mm"] = json!([380.0, 580.0]);
    let scanner = &mut cell["scanner"];
    (scanner["centre_of_mass_mm"], scanner["depth_origin_mm"]) = (json!([0.0, 0.0, 1.0]), json!(10.0));
    scanner["exposure"] = json!({
        "levels": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0],
        "full_scale": 255.0,
        "white_signal": 200.0,
        "min_modulation": 16.0,
    });
    let residuals = json!({
        "left_rms_px": 0.1,
        "right_rms_px": 0.1,
        "projector_rms_px": 0.1,
        "epipolar_rms_px": 0.1,
        "board_pitch_rms_mm": 0.1,
    });
    scanner["calibrated"] = json!({"by": "hand", "data_sha256": "ab".repeat(32), "residuals": residuals});
    cell["robot"]["max_flange_moment_nm"] = json!(100.0);
    cell["turntable"]["runout"] = json!([{
        "order": 1,
        "shift_cos_mm": [0.0, 0.0, 0.1],
        "shift_sin_mm": [0.0, 0.0, 0.1],
        "tilt_cos_deg": [0.0, 0.1],
        "tilt_sin_deg": [0.0, 0.1],
    }]);
    cell["base_from_table"] = json!({"translation_mm": [400.0, 0.0, -200.0], "rpy_deg": [0.0, 0.0, 0.0]});
    cell["mount_mass_kg"] = json!(0.1);
    cell["mount"] = json!([{"name": "box", "shape": {"kind": "box", "size_mm": [10.0, 10.0, 10.0]}}]);
    cell["obstacles"] = json!([
        {"name": "cylinder", "shape": {"kind": "cylinder", "radius_mm": 10.0, "height_mm": 10.0}},
        {"name": "capsule", "shape": {"kind": "capsule", "radius_mm": 10.0, "length_mm": 10.0}},
    ]);
    cell["cable"] = json!([{"name": "hose", "link": 3, "shape": {"kind": "box", "size_mm": [10.0, 10.0, 10.0]}}]);
    cell["calibrated"] = calibrated();
    cell
}

fn calibrated() -> Value {
    let compensation = json!({
        "cell": "e05-transcan",
        "calibration_id": "ab".repeat(32),
        "at": "2026-11-20T09:00:00Z",
        "flange_from_scanner": {"translation_mm": [0.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
        "rotation_deg": 0.1,
        "translation_mm": 0.1,
        "max_rotation_deg": 1.0,
        "max_translation_mm": 1.0,
        "max_age_hours": 24.0,
        "max_temperature_change_k": 5.0,
    });
    json!({
        "by": "vantage",
        "at": "2026-11-20T09:00:00Z",
        "calibration_id": "ab".repeat(32),
        "data_sha256": "ab".repeat(32),
        "rms_rotation_deg": 0.01,
        "rms_translation_mm": 0.1,
        "point_sd_mm": 0.05,
        "rotation_sd_deg": 0.005,
        "translation_sd_mm": 0.04,
        "max_age_hours": 24.0,
        "max_temperature_change_k": 5.0,
        "compensation_sha256": "ab".repeat(32),
        "compensation": compensation,
    })
}

/// Findings of a check, each in a sentence that begins with its pointer.
type Check = fn(&Value) -> Result<Vec<String>, serde_json::Error>;

fn sentences(errors: &[FieldError]) -> Vec<String> {
    errors.iter().map(ToString::to_string).collect()
}

fn of_cell(cell: &Value) -> Result<Vec<String>, serde_json::Error> {
    let built = CellSpec::deserialize(cell)?.build(&Presets);
    Ok(sentences(&built.map(drop).err().unwrap_or_default()))
}

fn of_run(run: &Value) -> Result<Vec<String>, serde_json::Error> {
    Ok(sentences(&RunRequest::deserialize(run)?.check().err().unwrap_or_default()))
}

fn of_override(speed: &Value) -> Result<Vec<String>, serde_json::Error> {
    Ok(sentences(&OverrideRequest::deserialize(speed)?.check().err().unwrap_or_default()))
}

fn of_job(job: &Value) -> Result<Vec<String>, serde_json::Error> {
    Ok(sentences(&JobRequest::deserialize(job)?.check().err().unwrap_or_default()))
}

fn of_update(update: &Value) -> Result<Vec<String>, serde_json::Error> {
    Ok(sentences(&JobUpdate::deserialize(update)?.check().err().unwrap_or_default()))
}

fn of_calibration(request: &Value) -> Result<Vec<String>, serde_json::Error> {
    Ok(sentences(&CalibrationRequest::deserialize(request)?.check().err().unwrap_or_default()))
}

fn of_params(params: &Value) -> Result<Vec<String>, serde_json::Error> {
    Ok(sentences(&PlanParams::deserialize(params)?.check().err().unwrap_or_default()))
}

/// Fields whose check depends on another one, or tells the range in other words.
const IN_OTHER_WORDS: [&str; 5] = ["cx", "cy", "white_signal", "min_modulation", "faces"];

/// Puts values on and just beyond the ends of a range into a number of the document, and holds what the check says of them.
fn assert_range(document: &Value, at: &str, range: &FieldRange, check: Check) {
    let field = format!("{at}/{}", range.field);
    let is_list = document.pointer(&field).is_some_and(Value::is_array);
    let pointer = if is_list { format!("{field}/0") } else { field };
    let is_whole = document.pointer(&pointer).expect("a number").is_u64();
    let [min, max] = range.range;
    let told = |number: f64| {
        let mut changed = document.clone();
        let number = if is_whole { json!(number as i64) } else { json!(number) };
        *changed.pointer_mut(&pointer).expect("a number") = number;
        check(&changed)
    };
    let allowed = format!("; allowed is {min} to {max}");
    // A number that goes on is another one: "to 1000" begins with "to 100".
    let is_whole_range = |rest: &str| rest.is_empty() || rest.starts_with([' ', ';']);
    let is_of_range = |sentence: &String| {
        let words = sentence.strip_prefix(&pointer).and_then(|rest| rest.strip_prefix(": is "));
        words.is_some_and(|words| IN_OTHER_WORDS.contains(&range.field) || words.split(&allowed).skip(1).any(is_whole_range))
    };
    let (below, above) = if is_whole { (min - 1.0, max + 1.0) } else { (min.next_down(), max.next_up()) };
    for outside in [below, above] {
        // A shape that cannot be read is refused too.
        let is_refused = told(outside).map_or(true, |sentences| sentences.iter().any(is_of_range));
        assert!(is_refused, "{pointer} = {outside} is not refused as out of {min} to {max}: {:#?}", told(outside));
    }
    for inside in [min, max].into_iter().filter(|_| !IN_OTHER_WORDS.contains(&range.field)) {
        let sentences = told(inside).unwrap_or_else(|error| panic!("{pointer} = {inside}: {error}"));
        assert!(!sentences.iter().any(is_of_range), "{pointer} = {inside}: {sentences:#?}");
    }
}

/// Ranges stood in descriptions alone, beside the checks.
#[test]
fn the_ranges_of_specifications_are_those_of_their_checks() {
    let in_cell = [
        ("AxisSpec", "/robot/joints/0"),
        ("BoardPoseSpec", "/scanner/board_poses/left"),
        ("CalibrationProvenance", "/calibrated"),
        ("CellSpec", ""),
        ("CompensationProvenance", "/calibrated/compensation"),
        ("DepthSpec", "/scanner/depth_mm"),
        ("DeviceSpec", "/scanner/left"),
        ("EulerPoseSpec", "/base_from_table"),
        ("ExposureSpec", "/scanner/exposure"),
        ("LinkBodySpec", "/cable/0"),
        ("LinkSpec", "/robot/links/0"),
        ("OpwSpec", "/robot/kinematics"),
        ("RobotSpec", "/robot"),
        ("RotationSpec", "/turntable/rotation"),
        ("RunoutSpec", "/turntable/runout/0"),
        ("ScannerResidualsSpec", "/scanner/calibrated/residuals"),
        ("ScannerSpec", "/scanner"),
        ("ShapeSpec", "/mount/0/shape"),
        ("ShapeSpec", "/obstacles/0/shape"),
        ("ShapeSpec", "/obstacles/1/shape"),
        ("TurntableSpec", "/turntable"),
    ];
    let regions = json!({"regions": {"exclude": [
        {"kind": "faces", "faces": [0]},
        {"kind": "sphere", "centre_mm": [0.0, 0.0, 0.0], "radius_mm": 1.0},
        {"kind": "plane", "point_mm": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "within_mm": 1.0},
    ]}});
    let (opw, ur) = (cell("hans-e05"), cell("ur5e"));
    let mut places: Vec<(&str, &str, &Value, Check)> =
        in_cell.into_iter().map(|(name, at)| (name, at, &opw, of_cell as Check)).collect();
    places.push(("UrSpec", "/robot/kinematics", &ur, of_cell));
    for at in ["/regions/exclude/0", "/regions/exclude/1", "/regions/exclude/2"] {
        places.push(("Region", at, &regions, of_params));
    }
    let mut held = BTreeSet::new();
    for (name, at, document, check) in places {
        let group = SPEC_RANGES.into_iter().find(|group| group.name == name).expect("ranges");
        for range in group.ranges.iter().filter(|range| document.pointer(&format!("{at}/{}", range.field)).is_some()) {
            assert_range(document, at, range, check);
            held.insert((name, range.field));
        }
    }
    for group in SPEC_RANGES {
        for range in group.ranges {
            assert!(held.contains(&(group.name, range.field)), "{} of {} is not in the documents", range.field, group.name);
        }
    }
}

#[test]
fn the_ranges_of_requests_are_those_of_their_checks() {
    let id = "0190b6b0-7c1e-7c1e-8c1e-0123456789ab";
    let run = json!({
        "job_id": id, "setup": 0, "speed_override": 0.5, "time_factor": 2.0, "from_step": 0, "temperature_c": 20.0,
    });
    let observation = json!({"id": "a", "joints_deg": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]});
    let data = json!({"schema": "vantage.calibration_data/1", "observations": [observation]});
    // The service checks the temperature of a `CheckRequest`.
    let groups = REQUEST_RANGES.into_iter().filter(|group| group.name != CheckRequest::RANGES.name);
    let places: [(&str, Value, Check); 5] = [
        ("CalibrationRequest", json!({"cell": "e05-transcan", "hold_out": 0, "data": data}), of_calibration),
        ("JobRequest", json!({"mesh_id": id, "priority": 0}), of_job),
        ("JobUpdate", json!({"priority": 0}), of_update),
        ("OverrideRequest", json!({"speed_override": 0.5}), of_override),
        ("RunRequest", run, of_run),
    ];
    assert_eq!(groups.clone().count(), places.len());
    for (group, (name, document, check)) in groups.zip(places) {
        assert_eq!(group.name, name);
        group.ranges.iter().for_each(|range| assert_range(&document, "", range, check));
    }
}

#[test]
fn the_default_of_a_whole_is_told_with_its_fields() {
    let default = |key: &str| list().into_iter().find(|parameter| parameter.key == key).expect("a parameter").default_text();
    assert_eq!(default("robust.pose_error.angle_deg"), "1.0");
    assert_eq!(default("robust.pose_error.translation_mm"), "1.0");
    assert_eq!(default("regions.interest[].weight"), "1.0");
    assert_eq!(default("regions.features[].tolerance_mm"), "", "it has to be given");
    assert_eq!(default("selection.target"), "0.985");
}
