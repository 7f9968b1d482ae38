//! Tests of the section `[controllers]`.

use serde_json::{Value, json};

use super::{ArmControllerSpec, ControllersSpec, TriggerSpec};
use crate::cell::{Dialect, FieldError};

fn whole() -> Value {
    json!({
        "arm": {"protocol": "hans", "address": "192.168.0.10:10003"},
        "table": {"protocol": "minas_a6", "address": "tcp://192.168.0.20:502", "units_per_turn": 1_600_000, "gear_ratio": 40},
    })
}

fn read(value: Value) -> ControllersSpec {
    serde_json::from_value(value).expect("a section")
}

/// Pointers of the findings in a section with `value` at `pointer`.
fn refused(pointer: &str, value: Value) -> Vec<String> {
    let mut section = serde_json::to_value(read(whole())).expect("JSON");
    *section.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
    let found = read(section).check().err().unwrap_or_default();
    found.into_iter().map(|FieldError { pointer, .. }| pointer).collect()
}

#[test]
fn the_defaults_are_those_of_the_documentation_and_survive_a_round_trip() {
    let spec = read(whole());
    assert_eq!(spec.check(), Ok(()));
    assert_eq!((spec.watchdog_ms, spec.state_max_age_ms, spec.first_run_speed), (200, 100, 0.25));
    assert_eq!((spec.position_tolerance_deg, spec.start_tolerance_deg), (0.1, 0.5));
    assert_eq!(spec.trigger, TriggerSpec::default());
    assert_eq!(read(serde_json::to_value(&spec).expect("JSON")), spec);
}

#[test]
fn a_trigger_tells_the_brightness_level_where_its_capture_carries_it() {
    let tells = |trigger: Value| {
        let mut section = whole();
        section["trigger"] = trigger;
        read(section).trigger.tells_brightness()
    };
    let command = |argument: &str| json!({"protocol": "command", "program": "/usr/bin/scan", "arguments": ["--view", argument]});
    assert!(tells(json!({"protocol": "http", "url": "http://10.0.0.3/capture"})) && tells(command("{view}:{brightness}")));
    assert!(!tells(command("{view}")) && !tells(json!({"protocol": "none"})));
    assert!(!tells(json!({"protocol": "digital", "output": 1, "input": 1})));
}

#[test]
fn values_out_of_range_are_named_by_their_pointer() {
    for (pointer, value) in [
        ("/watchdog_ms", json!(49)),
        ("/watchdog_ms", json!(501)),
        ("/state_max_age_ms", json!(9)),
        ("/position_tolerance_deg", json!(0.0)),
        ("/start_tolerance_deg", json!(11.0)),
        ("/first_run_speed", json!(1.01)),
        ("/arm/address", json!("192.168.0.10")),
        ("/arm/address", json!("192.168.0.10:0")),
        ("/arm/address", json!(":10003")),
        ("/arm/address", json!("a b:10003")),
        ("/arm/reply_timeout_ms", json!(9)),
        ("/arm/kinematics_tolerance_mm", json!(0.0)),
        ("/arm/tool", json!("a,b")),
        ("/table/address", json!("192.168.0.20:502")),
        ("/table/node", json!(0)),
        ("/table/units_per_turn", json!(999)),
        ("/table/gear_ratio", json!(513)),
        ("/table/baud", json!(14400)),
        ("/table/first_block", json!(249)),
        ("/table/speed_number", json!(16)),
    ] {
        assert_eq!(refused(pointer, value.clone()), [pointer], "{value}");
    }
    for address in ["[fe80::1]:10003", "robot.cell-3.plant:10003", "localhost:1"] {
        assert_eq!(refused("/arm/address", json!(address)), [""; 0], "{address}");
    }
}

/// Numbers that Han's control box does not have were taken, and the first capture found out.
#[test]
fn a_trigger_by_signals_has_those_of_the_control_box() {
    let found = |output: u8, input: u8| {
        let mut section = whole();
        section["trigger"] = json!({"protocol": "digital", "output": output, "input": input});
        read(section).check().err().unwrap_or_default()
    };
    assert_eq!(found(7, 0), []);
    let told: Vec<String> = found(8, 255).iter().map(ToString::to_string).collect();
    assert_eq!(told, ["/trigger/output: is 8; allowed is 0 to 7", "/trigger/input: is 255; allowed is 0 to 7"]);
}

#[test]
fn the_maker_behind_a_protocol_has_a_language_of_its_own() {
    let (ur, script) = ("10.0.0.2:30004", "10.0.0.2:30002");
    let arms = [
        json!({"protocol": "hans", "address": "10.0.0.2:10003"}),
        json!({"protocol": "ur", "address": ur, "script_address": script, "reverse_address": "10.0.0.1:50001"}),
        json!({"protocol": "fanuc_rmi", "address": "10.0.0.2:16001"}),
        json!({"protocol": "kuka_rsi", "address": "10.0.0.1:49152"}),
        json!({"protocol": "abb_egm", "address": "0.0.0.0:6510"}),
    ];
    let dialects = arms.map(|arm| serde_json::from_value::<ArmControllerSpec>(arm).expect("an arm").dialect());
    assert_eq!(dialects, [Dialect::Hans, Dialect::Urscript, Dialect::Fanuc, Dialect::Krl, Dialect::Rapid]);
}

#[test]
fn a_table_is_an_external_axis_only_where_the_arm_s_driver_moves_one() {
    let mut section = whole();
    section["table"] = json!({"protocol": "with_arm"});
    let found = read(section.clone()).check().expect_err("hans has none");
    assert_eq!(found[0].pointer, "/table/protocol");
    section["arm"] = json!({"protocol": "abb_egm", "address": "0.0.0.0:6510"});
    assert_eq!(read(section).check(), Ok(()));
}

/// Unsaid, it was taken as counted from the ground, which sent joint 3 of arms from a URDF wrong by joint 2.
#[test]
fn unknown_fields_and_protocols_are_refused() {
    let refused = |pointer: &str, value: Value| {
        let mut section = whole();
        let (parent, name) = pointer.rsplit_once('/').expect("a pointer");
        section.pointer_mut(parent).expect("a parent")[name] = value;
        serde_json::from_value::<ControllersSpec>(section).expect_err(pointer).to_string()
    };
    assert!(refused("/colour", json!(1)).contains("unknown field `colour`"));
    assert!(refused("/arm/colour", json!(1)).contains("unknown field `colour`"));
    assert!(refused("/table/password", json!("x")).contains("unknown field `password`"));
    assert!(refused("/arm/protocol", json!("telepathy")).contains("unknown variant `telepathy`"));
}

#[test]
fn the_section_is_taken_out_of_a_cell_file() {
    let mut file = json!({"name": "mine", "controllers": whole()});
    assert_eq!(ControllersSpec::take_section(&mut file), Some(whole()));
    assert_eq!(file, json!({"name": "mine"}));
    assert_eq!(ControllersSpec::take_section(&mut file), None);
}

#[test]
fn fields_of_other_brands_have_defaults_and_ranges() {
    let with_arm = |arm: Value| {
        let mut section = whole();
        section["arm"] = arm;
        let found = read(section).check().err().unwrap_or_default();
        found.into_iter().map(|FieldError { pointer, .. }| pointer).collect::<Vec<_>>()
    };
    let ur = json!({
        "protocol": "ur", "address": "10.0.0.2:30004", "script_address": "10.0.0.2:30002", "reverse_address": "10.0.0.1:50001",
    });
    let arms = [
        ur,
        json!({"protocol": "fanuc_rmi", "address": "10.0.0.2:16001", "joint_3_from": "upper_arm"}),
        json!({"protocol": "kuka_rsi", "address": "10.0.0.1:49152"}),
        json!({"protocol": "abb_egm", "address": "0.0.0.0:6510"}),
    ];
    for arm in &arms {
        assert_eq!(with_arm(arm.clone()), [""; 0], "{arm}");
    }
    for (arm, field, value) in [
        (0, "reverse_address", json!("0.0.0.0:50001")),
        (0, "rate_hz", json!(501)),
        (0, "gain", json!(99)),
        (0, "lookahead_ms", json!(29)),
        (1, "group_mask", json!(3)),
        (2, "cycle_ms", json!(0)),
        (2, "axis_tag", json!("A<K")),
        (2, "sender_type", json!("")),
        (2, "table_axis", json!(7)),
        (3, "cycle_ms", json!(6)),
        (3, "table_axis", json!(0)),
    ] {
        let mut arm = arms[arm].clone();
        arm[field] = value;
        assert_eq!(with_arm(arm), [format!("/arm/{field}")]);
    }
}
