//! The RoboDK script run by Python against the vendor's own package: `tests/oracles/dialects_oracle.py` puts a station in place
//! of the program's, whose robot takes only calls that the package's own class would take, and tells what it was asked to do.

use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use vantage::planning::params::DialectParams;
use vantage::program::dialects::Dialect;

use crate::dialects::{Job, Said};
use crate::support::oracle_python;

/// A call of the robot: its name and numbers.
#[derive(Debug, Deserialize)]
struct Call {
    name: String,
    arguments: Vec<f64>,
}

/// Calls of the script of a job; `options` are the oracle's.
fn calls(python: &Path, job: &Job, params: &DialectParams, options: &[&str]) -> Vec<Call> {
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("scan.py");
    std::fs::write(&script, &job.render(Dialect::Robodk, params)[0].text).expect("written");
    let home: Vec<String> = job.program.home_rad.axes_rad().iter().map(|rad| rad.to_degrees().to_string()).collect();
    let output = Command::new(python)
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/oracles/dialects_oracle.py"))
        .args([&script.display().to_string(), &job.cell.robot.name, &home.join(",")])
        .args(options)
        .output()
        .expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("calls")
}

/// An answer that was still on was that of the next capture too. RoboDK's warnings are only printed where the script does not
/// ask for more.
#[test]
fn robodks_script_captures_nothing_while_the_input_stays_on() {
    let Some(python) = oracle_python() else { return };
    let calls = calls(&python, &Job::tour(), &DialectParams::default(), &["1"]);
    assert_eq!(calls.last().map(|call| call.name.as_str()), Some("waitDI"));
    assert!(calls.iter().all(|call| call.name != "setDO"), "{calls:?}");
}

#[test]
fn robodks_script_moves_no_further_while_the_input_stays_off() {
    let Some(python) = oracle_python() else { return };
    let calls = calls(&python, &Job::tour(), &DialectParams::default(), &["0"]);
    let capture = calls.iter().position(|call| call.name == "waitDI").expect("a capture");
    let names: Vec<&str> = calls[capture..].iter().map(|call| call.name.as_str()).collect();
    assert_eq!(names, ["waitDI", "setDO", "Pause", "setDO", "waitDI"]);
}

#[test]
fn robodks_own_package_takes_every_call() {
    let Some(python) = oracle_python() else { return };
    let params = DialectParams { scan_output: 3, scan_input: 5, ..DialectParams::default() };
    for job in [Job::tour(), Job::planned()] {
        let calls = calls(&python, &job, &params, &[]);
        let said = said(&calls, &params);
        let wanted = &job.wanted(Dialect::Robodk)[1..];
        assert_eq!(said.len(), wanted.len());
        for (said, wanted) in said.iter().zip(wanted) {
            match (said, wanted) {
                (Said::Go(a), Said::Go(b)) => {
                    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 0.5e-6 + 1e-9), "{a:?} {b:?}")
                }
                (Said::Wait(a), Said::Wait(b)) => assert!((a - b).abs() < 1e-6),
                (a, b) => assert_eq!(a, b),
            }
        }
    }
}

fn said(calls: &[Call], params: &DialectParams) -> Vec<Said> {
    let mut said = Vec::new();
    let mut rest = calls.iter();
    let first = rest.next().expect("a call");
    assert_eq!((first.name.as_str(), first.arguments.as_slice()), ("setRounding", &[-1.0][..]), "a stop at every point");
    while let Some(call) = rest.next() {
        let mut expect = |name: &str, arguments: &[f64]| {
            let next = rest.next().expect("another call");
            assert_eq!((next.name.as_str(), next.arguments.as_slice()), (name, arguments));
        };
        match (call.name.as_str(), call.arguments.as_slice()) {
            ("setSpeed", [linear, speed, linear_acceleration, acceleration]) => {
                assert!([*linear, *linear_acceleration] == [-1.0, -1.0] && *speed > 0.0 && *acceleration > 0.0);
            }
            ("MoveJ", angles) => said.push(Said::Go(angles.try_into().expect("seven angles"))),
            ("Pause", [millis]) => said.push(Said::Wait(millis / 1000.0)),
            ("waitDI", [input, 0.0, timeout]) => {
                assert_eq!([*input, *timeout], [f64::from(params.scan_input), 1000.0 * params.timeout_secs]);
                expect("setDO", &[f64::from(params.scan_output), 1.0]);
                expect("Pause", &[1000.0 * params.pulse_secs]);
                expect("setDO", &[f64::from(params.scan_output), 0.0]);
                expect("waitDI", &[f64::from(params.scan_input), 1.0, 1000.0 * params.timeout_secs]);
                said.push(Said::Scan);
            }
            other => panic!("{other:?}"),
        }
    }
    said
}
