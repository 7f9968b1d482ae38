use serde_json::{Value, json};

use crate::check::check_plan as check;
use crate::cli::planned_block::plan_of_block;
use crate::planning::params::{CandidateParams, InterestParams, PlanParams, PoseErrorParams, Region};

/// Two views cannot measure all of a block, as this region asks.
fn all_of_it() -> InterestParams {
    InterestParams {
        name: Some("all".into()),
        region: Region::Box { min_mm: [-1e3; 3], max_mm: [1e3; 3] },
        weight: 1.0,
        target: Some(1.0),
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    }
}

/// The plan of a block without a cell, as a file holds it.
fn plan() -> Value {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.selection.max_views = Some(2);
    params.limits.camera_deg = Some(35.0);
    params.regions.interest = vec![all_of_it()];
    params.robust.pose_error = Some(PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 });
    (params.robust.draws, params.robust.part_draws) = (2, 2);
    serde_json::from_slice(&plan_of_block(&params)).expect("JSON")
}

/// Everything found, a line each.
fn found(plan: &Value) -> String {
    let document = serde_json::from_value(plan.clone()).expect("of the right shape");
    let errors = check(&document, None).err().unwrap_or_default();
    errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// Asserts that each change of a sound plan, a pointer with a value, is found in these words.
fn each_is_found(plan: &Value, cases: impl IntoIterator<Item = (&'static str, Value, &'static str)>) {
    for (pointer, value, words) in cases {
        let mut changed = plan.clone();
        *changed.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer} is there")) = value;
        let found = found(&changed);
        // What contradicts the change may stand elsewhere; then the words say where.
        let tells = |line: &str| line.contains(words) && (words.starts_with('/') || line.starts_with(pointer));
        assert!(found.lines().any(tells), "{pointer}: {words:?} in\n{found}");
    }
}

#[test]
fn a_false_plan_is_refused_with_pointer_value_and_what_is_allowed() {
    let plan = plan();
    assert_eq!(found(&plan), "");
    let views = plan["viewpoints"].as_array().map_or(0, Vec::len);
    assert!(views > 1 && plan["missed"].as_array().is_some_and(|missed| !missed.is_empty()), "too little to falsify");
    let half = plan["coverage"]["of_asked"].as_f64().map(|share| 0.5 * share);
    let cases = [
        (
            "/missed/0/reason",
            json!("gremlins"),
            "is \"gremlins\"; allowed is one of excluded_resting, enclosed, faces_table, facing, depth",
        ),
        ("/missed/0/area_mm2", json!(-4.0), "is -4 mm²; allowed is above 0 mm²"),
        ("/viewpoints/0/label", json!("above"), "is \"above\"; allowed is one of top, bottom, right, back, left, front"),
        ("/viewpoints/0/rejected", json!("tired"), "is \"tired\"; allowed is one of unreachable, collision, no_path"),
        ("/viewpoints/1/id", json!(0), "is 0; allowed is 1"),
        ("/viewpoints/0/gain_of_asked", json!(1.5), "is 1.5; allowed is 0 to 1"),
        ("/stopped_because", json!("bored"), "is \"bored\"; allowed is one of target, growth, max_views, no_gain, no_path"),
        ("/sequence", json!([0]), "/sequence/0: is 0; allowed are ids of viewpoints with a station"),
        ("/coverage/of_asked", json!(1.2), "is 1.2; allowed is 0 to 1"),
        ("/coverage/of_coverable", json!(-0.1), "is -0.1; allowed is 0 to 1"),
        ("/coverage/of_total", json!(2), "is 2; allowed is 0 to 1"),
        ("/coverage/of_total", json!(0.125), "is 0.125; by measured_area_mm2 and part.area_mm2 it is 0."),
        ("/chosen_on/samples", json!(1_000_000_000), "is 1000000000; allowed is up to of_samples"),
        ("/scanner/devices/0/fx", json!(0), "is 0 px; allowed is above 0 px"),
        ("/scanner/devices/2/scanner_from_device/quaternion_xyzw", json!([0, 0, 0, 0]), "has norm 0"),
        ("/coverage/independent/of_asked", json!(1.1), "is 1.1; allowed is 0 to 1"),
        ("/coverage/independent/of_asked", json!(1.0), "is 1; allowed is up to of_visible"),
        ("/coverage/visible_area_mm2", json!(1), "/coverage/of_visible: is 0."),
        ("/coverage/robust/of_asked/mean", json!(1.1), "is 1.1; allowed is 0 to 1"),
        ("/coverage/robust/part/of_asked/worst", json!(0.99), "allowed is 0 ≤ worst ≤ p5 ≤ 1"),
        ("/coverage/of_coverable", json!(0.5), "by measured_area_mm2 it is"),
        ("/coverage/curve/0", json!(1.0), "/coverage/curve/1: is 0."),
        ("/coverage/curve", json!([half, half]), "of_asked is"),
        ("/coverage/curve", json!([]), "has 0 entries; allowed is one for each"),
        ("/coverage/grades/A", json!(-0.2), "/coverage/grades/A: is -0.2; allowed is 0 to 1"),
        ("/coverage/measured_area_mm2", json!(1e9), "/coverage/measured_area_mm2: is 1000000000 mm²; allowed is 0 to"),
        ("/coverage/asked_area_mm2", json!(0), "is 0 mm²; allowed is above 0 mm²"),
        ("/missed/0/largest/0/remedy/kind", json!("hope"), "is \"hope\"; allowed is one of view, roll, tilt"),
        ("/missed/0/largest/0/remedy/of_spot", json!(2), "is 2; allowed is 0 to 1"),
        ("/missed/0/largest/0/remedy/camera_deg", json!(88), "is 88 °; allowed is up to 85 °, the own limit of the device left"),
        ("/part/sha256", json!("0A".repeat(32)), "allowed are 64 of 0-9 and a-f"),
        ("/part/area_mm2", json!(0), "is 0 mm²; allowed is above 0 mm²"),
        ("/part/triangles", json!(0), "allowed is 1 and more"),
        ("/part/bbox_mm/min", json!([1e3, 0, 0]), "allowed is up to max"),
        ("/candidates/kept", json!(1_000_000), "allowed is up to generated"),
        ("/missed", json!([]), "adds up to 0 mm²; asked less measured is"),
    ];
    each_is_found(&plan, cases);
    let mut stationed = plan.clone();
    stationed["viewpoints"][0]["station"] = json!({"table_angle_deg": 0.0, "joints_deg": [0, 0, 0, 0, 0, 0]});
    assert!(found(&stationed).contains("/viewpoints/0/station: is given, but the plan has no cell"));
}

#[test]
fn false_limits_and_regions_are_refused() {
    let plan = plan();
    let cases = [
        ("/scanner/devices/1/incidence_max_deg", json!(85), "is 85 °; allowed is up to 35 °"),
        (
            "/scanner/devices/0/incidence_own_deg",
            json!(20),
            "/scanner/devices/0/incidence_max_deg: is 35 °; allowed is up to 20 °",
        ),
        ("/coverage/regions/0/kind", json!("whim"), "is \"whim\"; allowed is one of interest, feature"),
        ("/coverage/regions/0/of_asked", json!(1.2), "is 1.2; allowed is 0 to 1"),
        ("/coverage/regions/0/of_asked", json!(0.01), "is 0.01; by measured_area_mm2 it is"),
        ("/coverage/regions/0/met", json!(true), "is true; by of_asked and target it is false"),
        ("/coverage/regions/0/target", json!(0.0), "/coverage/regions/0/met: is false; by of_asked and target it is true"),
        ("/coverage/regions/0/independent_samples", json!(0), "is 0; allowed is 1 and more"),
        ("/coverage/regions/0/independent_of_asked", json!(1.5), "is 1.5; allowed is 0 to 1"),
        ("/coverage/regions/0/independent_standard_error", json!(-0.1), "is -0.1; allowed is 0 to 1"),
        (
            "/coverage/regions/0/independently_met",
            json!(true),
            "is true; by independent_of_asked, independent_standard_error and",
        ),
        ("/coverage/regions/0/missed", json!([]), "adds up to 0 mm²; asked less measured is"),
        ("/coverage/regions/0/missed/0/reason", json!("gremlins"), "is \"gremlins\"; allowed is one of"),
    ];
    each_is_found(&plan, cases);
    let mut without_unmet = plan.clone();
    without_unmet["stopped_because"] = json!("regions_unmet");
    assert_eq!(found(&without_unmet), "", "one is unmet");
    without_unmet["coverage"]["regions"] = json!([]);
    assert!(found(&without_unmet).contains("/stopped_because: is \"regions_unmet\", but no region misses its target"));
}

/// Only their ranges were checked.
#[test]
fn parameters_that_differ_from_what_the_plan_tells_of_them_are_refused() {
    let plan = plan();
    let off = "is 2 ° and 1 mm; coverage.robust is for 1 ° and 1 mm";
    let cases = [
        ("/params/robust/pose_error", json!({"angle_deg": 2.0, "translation_mm": 1.0}), off),
        ("/params/robust/pose_error", json!(null), "is null; coverage.robust is for 1 ° and 1 mm"),
        ("/params/robust/draws", json!(3), "is 3; coverage.robust has 2 draws of this kind"),
        ("/params/robust/hand_eye_draws", json!(3), "is 3; coverage.robust has 12 draws of this kind"),
        ("/params/regions/interest/0/target", json!(0.5), "/coverage/regions/0/target: is 1; by params.regions it is 0.5"),
        (
            "/params/regions/interest/0/name",
            json!("any"),
            "/coverage/regions/0/name: is \"all\"; by params.regions it is \"any\"",
        ),
        ("/params/regions/interest", json!([]), "/coverage/regions: has 1 entries; params.regions has 0 regions of interest"),
        ("/params/selection/max_views", json!(null), "is null; the choice of views stopped because of \"max_views\""),
        ("/params/limits/camera_deg", json!(null), "/scanner/devices/0/incidence_max_deg: is 35 °; by incidence_own_deg and"),
    ];
    each_is_found(&plan, cases);
}

/// A plan that tells of a fixture and names none was found sound without it.
#[test]
fn a_fixture_that_the_parameters_do_not_name_is_refused() {
    let mut plan = plan();
    plan["fixture"] = json!({"sha256": "0a".repeat(32), "bbox_mm": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]}});
    let told = found(&plan);
    assert!(told.starts_with("/fixture: is given, and params.part.fixture_mesh is null"), "{told}");
    plan["params"]["part"]["fixture_mesh"] = "clamp.stl".into();
    assert!(!found(&plan).contains("/fixture"), "{}", found(&plan));
}

/// Nothing was found to collide at a pose that is none.
#[test]
fn poses_of_the_cell_that_are_none_are_refused() {
    let mut plan = plan();
    let pose = json!({"translation_mm": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]});
    plan["cell"] = json!({
        "name": "cell", "base_from_table": pose, "table_from_part": pose, "flange_from_scanner": pose, "robot": "arm", "turntable": "table",
    });
    assert!(!found(&plan).contains("/cell/"), "{}", found(&plan));
    let cases = [
        ("/cell/table_from_part/quaternion_xyzw", json!([0, 0, 0, 0]), "has norm 0; a rotation needs a unit quaternion"),
        ("/cell/base_from_table/quaternion_xyzw", json!([0, 0, 0, 0]), "has norm 0"),
        ("/cell/table_from_part/translation_mm", json!([1e300, 0, 0]), "allowed is -100000 to 100000 mm"),
        ("/cell/flange_from_scanner/translation_mm", json!([0, 1e300, 0]), "allowed is -100000 to 100000 mm"),
    ];
    each_is_found(&plan, cases);
}
