//! A planned part on simulated controllers on sockets: `vantage sim` twice, then `vantage run`, live.

use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Stdio};

use serde_json::Value;

use super::runs::planned;
use super::{Ended, run};
use crate::server::process::vantage;

/// A simulated controller, ended when dropped.
pub(crate) struct Simulator {
    pub(crate) child: Child,
    /// Address on which faults are set, where one was asked for.
    pub(crate) control: Option<SocketAddr>,
    /// Section of the cell file.
    pub(crate) section: String,
}

impl Simulator {
    /// Starts one, and waits until it listens.
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let mut child = vantage().arg("sim").args(arguments).stdout(Stdio::piped()).spawn().expect("a process");
        let mut lines = BufReader::new(child.stdout.take().expect("its output")).lines().map(|line| line.expect("text"));
        assert!(lines.next().expect("a line").contains("listens on"));
        let (mut section, mut control) = (String::new(), None);
        for line in lines.by_ref() {
            if let Some(address) = line.strip_prefix("# Faults are set on ") {
                control = Some(address.parse().expect("an address"));
            }
            if section.is_empty() && !line.starts_with('[') {
                continue;
            }
            let is_last = line.starts_with("protocol");
            section += &line;
            section.push('\n');
            // Keys come in alphabetical order; nothing that is needed follows the protocol but the numbers of a drive.
            if is_last && arguments[0] == "robot" || line.starts_with("units_per_turn") {
                break;
            }
        }
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, control, section }
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Cell file of the preset with these controllers.
pub(crate) fn cell_file(folder: &Path, simulators: &[&Simulator], first_run_speed: f64) -> String {
    let preset = run(&["presets", "e05-transcan"]).out;
    let sections: String = simulators.iter().map(|simulator| simulator.section.as_str()).collect();
    let path = folder.join("rehearsal.toml");
    std::fs::write(&path, format!("{preset}\n[controllers]\nfirst_run_speed = {first_run_speed:.2}\n{sections}"))
        .expect("a file");
    path.display().to_string()
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

/// A whole program, live on simulated controllers: every step is done, poses are met, and the time is the plan's.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_planned_part_is_run_on_simulated_controllers() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, plan] = planned(folder.path());
    let program = json(&Path::new(&plan).join("program.json"));
    let home: Vec<String> = program["home_deg"].as_array().expect("angles").iter().map(Value::to_string).collect();
    let robot = Simulator::start(&["robot", "--robot", "hans-e05", "--joints", &home[..6].join(",")]);
    let table = Simulator::start(&["turntable"]);
    let cell = cell_file(folder.path(), &[&robot, &table], 1.0);
    let base = ["run", &plan, "--cell", &cell, "--mesh", &part, "--unit", "mm"];
    let read = run(&[&base[..], &["--mode", "dry_run"]].concat());
    assert_eq!(read.code, Some(0), "{}{}", read.out, read.err);
    assert!(read.out.starts_with("done: arm and table were read, and nothing was moved;"), "{}", read.out);

    let (record, audit) = (folder.path().join("run.json"), folder.path().join("audit"));
    let [record_path, audit_path] = [&record, &audit].map(|path| path.display().to_string());
    let live = ["--mode", "live", "--armed-by", "rehearsal", "--record", &record_path, "--audit", &audit_path];
    let Ended { code, out, err } = run(&[&base[..], &live].concat());
    assert_eq!(code, Some(0), "{out}{err}");
    let written = json(&record);
    assert_eq!(written["run"]["state"], "done", "{written}");
    let steps = written["steps"].as_array().expect("steps");
    assert_eq!(steps.len(), program["steps"].as_array().expect("steps").len());
    for step in steps.iter().filter(|step| step["op"] == "scan") {
        let [axis_deg, position_mm] =
            ["optical_axis_deviation_deg", "position_deviation_mm"].map(|key| step[key].as_f64().expect("a number"));
        assert!(axis_deg < 0.1 && position_mm < 1.0, "{step}");
    }
    let secs = |key: &str| steps.iter().map(|step| step[key].as_f64().expect("seconds")).sum::<f64>();
    let (planned, real) = (secs("planned_secs"), secs("actual_secs"));
    eprintln!("a rehearsal took {real:.2} s, planned {planned:.2} s: {:.3}", real / planned);
    // On a busy machine it is slower; never is it faster than planned.
    assert!(real > 0.95 * planned, "{real} {planned}");
    assert!(std::fs::read_dir(&audit).expect("the log").count() > 0);
}
