//! Tests of the shapes of runs.

use serde_json::{Value, json};

use super::*;
use crate::cell::Configuration;
use crate::execution::record::RunRecord;
use crate::execution::session::{RunReason, RunState, RunStatus, StopCause};
use crate::program::Program;
use crate::wire::parse;

const JOB: &str = "01a1f77c-78a1-7554-855a-a9513c22aa2b";

fn request(fields: &Value) -> Result<RunRequest, String> {
    let mut whole = json!({"job_id": JOB});
    for (name, value) in fields.as_object().expect("an object") {
        whole[name] = value.clone();
    }
    parse(whole.to_string().as_bytes()).map_err(|error| error.to_string())
}

#[test]
fn a_run_is_a_simulation_in_real_time_unless_asked_otherwise() {
    let found = request(&json!({})).expect("a request");
    assert_eq!(found, RunRequest::new(JOB.parse().expect("an id")));
    assert_eq!((found.mode, found.speed_override, found.time_factor, found.from_step), (RunMode::Simulate, 1.0, 1.0, 0));
    assert_eq!(found.check(), Ok(()));
}

#[test]
fn fields_out_of_range_are_named() {
    for (fields, pointer) in [
        (json!({"setup": 4}), "/setup"),
        (json!({"speed_override": 0.0}), "/speed_override"),
        (json!({"speed_override": 1.01}), "/speed_override"),
        (json!({"time_factor": 0.99}), "/time_factor"),
        (json!({"time_factor": 101}), "/time_factor"),
        (json!({"time_factor": 2.0, "mode": "live"}), "/time_factor"),
        (json!({"from_step": 1_000_001}), "/from_step"),
    ] {
        let found = request(&fields).expect("a request").check().expect_err("out of range");
        assert_eq!(found[0].pointer, pointer, "{fields}");
    }
    // No request names a controller.
    for fields in [json!({"address": "10.0.0.1:10003"}), json!({"controllers": {}}), json!({"mode": "real"})] {
        request(&fields).expect_err("refused");
    }
}

#[test]
fn every_state_reads_back_and_three_of_them_are_ends() {
    for state in ReportedState::ALL {
        assert_eq!(state.as_str().parse(), Ok(state));
    }
    let ends: Vec<ReportedState> = ReportedState::ALL.into_iter().filter(|state| state.is_ended()).collect();
    assert_eq!(ends, [ReportedState::Done, ReportedState::Stopped, ReportedState::Failed]);
}

/// Whoever looks once the samples are gone would take the arm for where its last step ended.
#[test]
fn a_run_that_has_ended_says_where_arm_and_table_were_measured_last() {
    let program = Program {
        plan_sha256: String::new(),
        setup: 0,
        calibration: None,
        robot: String::new(),
        turntable: String::new(),
        home_rad: Configuration { joints_rad: [0.0; 6], table_rad: 0.0 },
        steps: Vec::new(),
        cycle_secs: 0.0,
    };
    let mut run = Run::new(&RunRequest::new(JOB.parse().expect("an id")), None, "cell", &program, "");
    assert_eq!(run.last_measured, None);
    let here = Configuration { joints_rad: [0.5, 0.0, 0.0, 0.0, 0.0, -0.25], table_rad: 1.5 };
    let status = RunStatus { state: RunState::Stopped, reason: RunReason::Ended(StopCause::Client) };
    run.conclude(&RunRecord { last_measured: Some(here), ..RunRecord::lost(status) });
    assert_eq!(run.last_measured, Some(ConfigurationDocument::from(&here)));
    let mut stored = serde_json::to_value(&run).expect("JSON");
    assert_eq!(parse::<Run>(stored.to_string().as_bytes()).expect("a run"), run);
    // As an earlier release stored it.
    stored.as_object_mut().expect("an object").remove("last_measured");
    assert_eq!(parse::<Run>(stored.to_string().as_bytes()).expect("a run").last_measured, None);
}
