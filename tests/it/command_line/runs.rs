//! `vantage run` as a process: to the end of a program, stopped by ctrl-c, step by step, and what it refuses.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use super::{Ended, inputs, run};
use crate::server::process::vantage;

/// Options of a plan with a program that is made quickly.
const QUICK: [&str; 12] = [
    "--set",
    "candidates.strategies=[\"ellipsoid\"]",
    "--set",
    "part.samples_per_mm2=0.01",
    "--set",
    "visibility.engine=rays",
    "--set",
    "selection.max_views=1",
    "--set",
    "missed.remedies=0",
    "--report",
    "none",
];

/// Plans a part in the default cell; the paths of part and plan.
pub(super) fn planned(folder: &Path) -> [String; 2] {
    let [part, ..] = inputs(folder);
    let plan = folder.join("plan").display().to_string();
    let ended = run(&[&["plan", &part, "--unit", "mm", "--out", &plan][..], &QUICK].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    [part, plan]
}

/// A cell file with controllers that nobody is behind.
fn cell_file(folder: &Path) -> String {
    let preset = run(&["presets", "e05-transcan"]).out;
    let controllers = "
[controllers.arm]
protocol = \"hans\"
address = \"127.0.0.1:1\"
[controllers.table]
protocol = \"minas_a6\"
address = \"tcp://127.0.0.1:2\"
units_per_turn = 1600000
gear_ratio = 40
";
    let path = folder.join("cell.toml");
    std::fs::write(&path, preset + controllers).expect("a file");
    path.display().to_string()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_program_runs_to_its_end_and_is_refused_where_it_is_not_sound() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, plan] = planned(folder.path());
    let record = folder.path().join("run.json").display().to_string();
    let base = ["run", &plan, "--cell", "e05-transcan", "--mesh", &part, "--unit", "mm"];
    let ended = run(&[&base[..], &["--speed", "x50", "--record", &record]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.starts_with("done: ") && ended.out.contains("coverage from the measured poses"), "{}", ended.out);
    assert!(ended.err.contains("running: ") && ended.err.contains("step 0 of "), "{}", ended.err);
    let written: Value = serde_json::from_slice(&std::fs::read(&record).expect("the record")).expect("JSON");
    assert_eq!((written["schema"].as_str(), written["run"]["state"].as_str()), (Some("vantage.run/1"), Some("done")));
    let quiet = run(&[&base[..], &["--speed", "100", "-q"]].concat());
    assert_eq!((quiet.code, quiet.out.as_str(), quiet.err.as_str()), (Some(0), "", ""));
    let json = run(&[&base[..], &["--speed", "100", "--json"]].concat());
    let told: Value = serde_json::from_str(&json.out).expect("JSON");
    assert_eq!((told["run"]["mode"].as_str(), json.err.as_str()), (Some("simulate"), ""));

    let file = format!("{plan}/program.json");
    let text = std::fs::read_to_string(&file).expect("the program");
    let mut program: Value = serde_json::from_str(&text).expect("JSON");
    program["cycle_secs"] = 1.0.into();
    std::fs::write(&file, program.to_string()).expect("written");
    let Ended { code, err, .. } = run(&base);
    assert!(code == Some(2) && err.contains("program.json"), "{code:?} {err}");
}

/// Another scanner was told by the numbers of its lenses, and another place of the table by what it does to every scan.
#[test]
#[ignore = "long: tests/all runs it"]
fn another_cell_than_the_plans_is_told_by_what_differs() {
    let folder = tempfile::tempdir().expect("a folder");
    let [_, plan] = planned(folder.path());
    let preset = run(&["presets", "e05-transcan"]).out;
    let told = |from: &str, to: &str| {
        let path = folder.path().join("other.toml");
        std::fs::write(&path, preset.replace(from, to)).expect("a file");
        let ended = run(&["run", &plan, "--cell", &path.display().to_string(), "--speed", "100"]);
        assert_eq!(ended.code, Some(2), "{}", ended.err);
        ended.err
    };
    let scanner = told("\"transcan-c\"", "\"transcan-c-nominal\"");
    assert!(scanner.contains("it has scanner transcan-c-nominal, not transcan-c\n"), "{scanner}");
    assert!(scanner.contains("give the cell that was, e05-transcan, or plan again"), "{scanner}");
    assert!(!scanner.contains("/devices/"), "{scanner}");
    let moved = told("[400.0, 0.0, -200.0]", "[400.0, 30.0, -200.0]");
    let wanted = "other.toml: /base_from_table: puts the table 30.00 mm and 0.00° from where the plan has it; plan again";
    assert!(moved.contains(wanted), "{moved}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn ctrl_c_stops_it_in_order_and_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let [_, plan] = planned(folder.path());
    let mut child = vantage()
        .args(["run", &plan, "--cell", "e05-transcan"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a process");
    let mut lines = BufReader::new(child.stderr.take().expect("its errors")).lines();
    while !lines.next().expect("a line").expect("text").starts_with("running") {}
    std::thread::sleep(std::time::Duration::from_millis(500));
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.expect("kill").success());
    let rest: Vec<String> = lines.map(|line| line.expect("text")).collect();
    let mut out = String::new();
    child.stdout.take().expect("its output").read_to_string(&mut out).expect("text");
    assert_eq!(child.wait().expect("its end").code(), Some(4), "{out}\n{rest:?}");
    assert!(out.starts_with("stopped: ") && out.contains("arm: stop sent after") && out.contains("at rest after"), "{out}");
    assert!(rest.iter().any(|line| line.starts_with("running: ") && line.contains("keep clear")), "{rest:?}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn lines_take_it_step_by_step_and_their_end_stops_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let [_, plan] = planned(folder.path());
    let mut child = vantage()
        .args(["run", &plan, "--cell", "e05-transcan", "--speed", "100", "--step"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a process");
    let mut input = child.stdin.take().expect("its input");
    let mut lines = BufReader::new(child.stderr.take().expect("its errors")).lines();
    let mut steps = 0;
    while steps < 2 {
        let line = lines.next().expect("a line").expect("text");
        if line.starts_with("armed: ") || line.starts_with("paused: ") {
            input.write_all(b"\n").expect("a line");
        }
        steps += usize::from(line.starts_with("step "));
    }
    drop(input);
    let rest: Vec<String> = lines.map(|line| line.expect("text")).collect();
    assert_eq!(child.wait().expect("its end").code(), Some(4), "{rest:?}");
    assert!(rest.iter().any(|line| line.contains("standard input has ended")), "{rest:?}");
}

/// All of them were read while the first step was under way, and none was left for the others.
#[test]
#[ignore = "long: tests/all runs it"]
fn lines_that_are_there_from_the_start_take_it_to_its_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let [_, plan] = planned(folder.path());
    let lines = folder.path().join("lines");
    std::fs::write(&lines, "\n".repeat(200)).expect("a file");
    let ended = vantage()
        .args(["run", &plan, "--cell", "e05-transcan", "--speed", "100", "--step"])
        .stdin(std::fs::File::open(&lines).expect("the file"))
        .output()
        .expect("a process");
    let told = String::from_utf8_lossy(&ended.stdout);
    assert!(ended.status.code() == Some(0) && told.starts_with("done: "), "{told}{}", String::from_utf8_lossy(&ended.stderr));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn controllers_are_asked_for_and_checked() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, plan] = planned(folder.path());
    let refused = |arguments: &[&str], words: &str| {
        let ended = run(&[&["run", &plan][..], arguments].concat());
        assert!(ended.code == Some(2) && ended.err.contains(words), "{arguments:?}: {:?} {}", ended.code, ended.err);
    };
    refused(&["--cell", "e05-transcan", "--mode", "dry_run"], "[controllers]");
    refused(&["--cell", "e05-transcan", "--mode", "real"], "real");
    refused(&["--cell", "e05-transcan", "--speed", "1000"], "--speed: is 1000; allowed is 1 to 100");
    refused(&["--cell", "e05-transcan", "--override", "2"], "--override: is 2; allowed is 0.01 to 1");
    refused(&["--cell", "e05-transcan", "--from-step", "1000"], "--from-step");
    refused(&["--cell", "e05-transcan", "--record", "/nowhere/run.json"], "--record");
    let cell = cell_file(folder.path());
    let with_part = ["--cell", &cell, "--mesh", &part, "--unit", "mm", "--mode", "live"];
    refused(&with_part, "--armed-by");
    refused(&["--cell", &cell, "--mode", "live", "--armed-by", "me"], "--mesh");
    let alone = folder.path().join("alone.json").display().to_string();
    std::fs::copy(Path::new(&plan).join("program.json"), &alone).expect("a copy");
    let ended = run(&[&["run", &alone][..], &with_part, &["--armed-by", "me"]].concat());
    assert!(ended.code == Some(2) && ended.err.contains("needs its plan"), "{}", ended.err);
    // A file with controllers is a cell for everything else too.
    assert_eq!(run(&["run", &plan, "--cell", &cell, "--speed", "100"]).code, Some(0));
    let checked = run(&["check", &cell]);
    assert!(
        checked.code == Some(0) && checked.out.contains("controllers hans, minas_a6, trigger none"),
        "{}{}",
        checked.out,
        checked.err
    );
    let text = std::fs::read_to_string(&cell).expect("the file").replace("gear_ratio = 40", "gear_ratio = 0\ncolour = 1");
    std::fs::write(&cell, text).expect("a file");
    let checked = run(&["check", &cell]);
    assert!(checked.code == Some(2) && checked.err.contains("/controllers/table"), "{}", checked.err);
    let planned = run(&["plan", &part, "--unit", "mm", "--cell", &cell, "--out", &plan]);
    assert!(planned.code == Some(2) && planned.err.contains("/controllers/table"), "{}", planned.err);
}
