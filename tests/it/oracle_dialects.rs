//! The RoboDK script run by Python against the vendor's own package: `tests/oracles/dialects_oracle.py` puts a station in place
//! of the program's, whose robot takes only calls that the package's own class would take, and tells what it was asked to do.

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

#[test]
fn robodks_own_package_takes_every_call() {
    let Some(python) = oracle_python() else { return };
    let params = DialectParams { scan_output: 3, scan_input: 5, ..DialectParams::default() };
    for job in [Job::tour(), Job::planned()] {
        let folder = tempfile::tempdir().expect("a folder");
        let script = folder.path().join("scan.py");
        std::fs::write(&script, &job.render(Dialect::Robodk, &params)[0].text).expect("written");
        let home: Vec<String> = job.program.home_rad.axes_rad().iter().map(|rad| rad.to_degrees().to_string()).collect();
        let output = Command::new(&python)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/oracles/dialects_oracle.py"))
            .args([&script.display().to_string(), &job.cell.robot.name, &home.join(",")])
            .output()
            .expect("Python runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let calls: Vec<Call> = serde_json::from_slice(&output.stdout).expect("calls");
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
            ("setDO", [output, 1.0]) => {
                assert_eq!(*output, f64::from(params.scan_output));
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
