use std::path::Path;

use clap::Parser;

use super::{ProgramArgs, run};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: ProgramArgs,
}

/// A program that stays at home, in a folder of its own.
fn planned(folder: &Path, cycle_secs: f64) {
    let program = serde_json::json!({
        "schema": "vantage.program/1", "plan_sha256": "00".repeat(32), "robot": "hans-e05", "turntable": "minas-a6-500",
        "home_deg": [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0], "cycle_secs": cycle_secs,
        "steps": [{"op": "settle", "secs": 0.5}, {"op": "scan", "viewpoint": 3, "brightness": 5, "capture_secs": 1.0}],
    });
    std::fs::write(folder.join("program.json"), program.to_string()).expect("writes");
}

fn written(folder: &Path, args: &[&str]) -> Result<Vec<String>, String> {
    let fixed = ["program", "--cell", "e05-transcan", folder.to_str().expect("a path")];
    let line = Line::try_parse_from([&fixed, args].concat()).map_err(|error| error.to_string())?;
    run(&line.args).map_err(|error| {
        assert_eq!(error.exit_code(), 2, "{error}");
        error.to_string()
    })?;
    let files = std::fs::read_dir(&line.args.out).map_err(|error| error.to_string())?;
    let mut names: Vec<_> = files.map(|file| file.expect("lists").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    Ok(names)
}

#[test]
fn files_have_the_names_that_controllers_want() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    for (dialect, wanted) in [
        ("hans", &["bracket.cps"][..]),
        ("urscript", &["bracket.script"]),
        ("rapid", &["bracket.mod"]),
        ("krl", &["BRACKET.dat", "BRACKET.src"]),
        ("fanuc", &["BRACKET.ls"]),
        ("robodk", &["bracket.py"]),
        ("csv", &["program.csv"]),
    ] {
        let out = folder.path().join(dialect).display().to_string();
        let found = written(folder.path(), &["--dialect", dialect, "--out", &out, "--set", "dialects.program_name=bracket"]);
        assert_eq!(found.expect("written"), wanted);
        let text = std::fs::read_to_string(Path::new(&out).join(wanted[0])).expect("reads");
        assert!(dialect == "csv" || text.contains("WITHOUT the part") || dialect == "krl" || dialect == "fanuc", "{text}");
    }
}

#[test]
fn one_file_takes_one_file() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    let out = folder.path().join("scan.script").display().to_string();
    let _ = written(folder.path(), &["--dialect", "urscript", "--out", &out]);
    assert!(std::fs::read_to_string(&out).expect("written").contains("vantage_scan()"));
    let refused = written(folder.path(), &["--dialect", "krl", "--out", &out]).expect_err("two files");
    assert!(refused.contains("VANTAGE.src, VANTAGE.dat"), "{refused}");
}

#[test]
fn what_fails_is_not_written() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 99.0);
    let out = folder.path().join("robot");
    let args = ["--dialect", "rapid", "--out", out.to_str().expect("a path")];
    let refused = written(folder.path(), &args).expect_err("the linter finds the cycle time");
    assert!(refused.contains("program.json: ") && !out.exists(), "{refused}");
    planned(folder.path(), 1.5);
    let refused = written(folder.path(), &[&args[..], &["--set", "dialects.table_axis=7"]].concat()).expect_err("no such axis");
    assert!(refused.contains("/dialects/table_axis: is 7; allowed is 1 to 6"), "{refused}");
    let refused = written(folder.path(), &["--dialect", "karel", "--out", "x"]).expect_err("no such dialect");
    assert!(refused.contains("known are hans, urscript, rapid, krl, fanuc, robodk, csv"), "{refused}");
}
