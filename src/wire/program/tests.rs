use super::{PROGRAM_SCHEMA, ProgramDocument};
use crate::planning::plan::ViewId;
use crate::program::{Move, Program, Step};
use crate::wire::echo::Echo;
use crate::wire::parse;

fn program() -> Program {
    let at = |deg: f64| super::radians(&[deg, -deg, 0.5 * deg, 0.0, 90.0, 1.0, 3.0 * deg]);
    Program {
        plan_sha256: "0f".repeat(32),
        setup: 0,
        calibration: None,
        robot: "=cmd()".into(),
        turntable: "minas-a6-500".into(),
        home_rad: at(0.0),
        steps: vec![
            Step::Move(Move {
                via_rad: vec![at(5.0)],
                target_rad: at(10.0),
                speed_fraction: 0.25,
                duration_secs: 2.5,
                passed_within_rad: None,
            }),
            Step::Settle { secs: 0.3 },
            Step::Scan { view: ViewId(4), brightness: 5, capture_secs: 1.0 },
            Step::Move(Move {
                via_rad: Vec::new(),
                target_rad: at(0.0),
                speed_fraction: 0.25,
                duration_secs: 2.0,
                passed_within_rad: None,
            }),
        ],
        cycle_secs: 5.8,
    }
}

#[test]
fn the_document_has_the_contracts_keys_in_degrees() {
    let echo = Echo { serial: Some("0042".into()), ..Echo::default() };
    let bytes = ProgramDocument::new(&program(), echo).to_bytes();
    let json: serde_json::Value = parse(&bytes).expect("JSON");
    assert_eq!(json["schema"], PROGRAM_SCHEMA);
    assert_eq!(json["serial"], "0042");
    assert!(json.get("part_number").is_none(), "what was not given is not echoed");
    assert_eq!(json["home_deg"].as_array().expect("array").len(), 7);
    let first = &json["steps"][0];
    assert_eq!(first["op"], "move_joints");
    assert!((first["joints_deg"][0].as_f64().expect("number") - 10.0).abs() < 1e-12);
    assert!((first["table_angle_deg"].as_f64().expect("number") - 30.0).abs() < 1e-12);
    assert!((first["via"][0][6].as_f64().expect("number") - 15.0).abs() < 1e-12);
    assert_eq!((&first["speed_fraction"], &first["duration_secs"]), (&0.25.into(), &2.5.into()));
    assert_eq!(json["steps"][1], serde_json::json!({"op": "settle", "secs": 0.3}));
    assert_eq!(json["steps"][2], serde_json::json!({"op": "scan", "viewpoint": 4, "brightness": 5, "capture_secs": 1.0}));
    assert_eq!(json["cycle_secs"], 5.8);
}

#[test]
fn a_program_survives_its_file() {
    let written = ProgramDocument::new(&program(), Echo::default());
    let read: ProgramDocument = parse(&written.to_bytes()).expect("reads");
    assert_eq!(read, written);
    let back = read.program().expect("sound");
    assert_eq!(ProgramDocument::new(&back, Echo::default()).steps.len(), 4);
    assert!(back.home_rad.max_turn_rad(&program().home_rad) < 1e-15);
}

#[test]
fn what_is_out_of_range_is_refused_where_it_is() {
    let refused = |change: fn(&mut ProgramDocument)| {
        let mut document = ProgramDocument::new(&program(), Echo::default());
        change(&mut document);
        document.program().expect_err("must be refused").into_iter().map(|error| error.pointer).collect::<Vec<_>>()
    };
    assert_eq!(refused(|d| d.schema = "vantage.program/9".into()), ["/schema"]);
    assert_eq!(refused(|d| d.plan_sha256 = "xyz".into()), ["/plan_sha256"]);
    assert_eq!(refused(|d| d.home_deg[6] = 1e9), ["/home_deg/6"]);
    assert_eq!(refused(|d| d.cycle_secs = f64::NAN), ["/cycle_secs"]);
    assert_eq!(refused(|d| d.steps[1] = super::StepDocument::Settle { secs: -0.1 }), ["/steps/1/secs"]);
    assert_eq!(
        refused(|d| if let super::StepDocument::MoveJoints { via, .. } = &mut d.steps[0] {
            via[0][2] = f64::INFINITY;
        }),
        ["/steps/0/via/0/2"]
    );
    let unknown = br#"{"op": "jump", "secs": 1.0}"#;
    assert!(parse::<super::StepDocument>(unknown).is_err());
    let extra = br#"{"op": "settle", "secs": 1.0, "minutes": 2}"#;
    assert!(parse::<super::StepDocument>(extra).is_err());
}
