use std::path::Path;

use clap::Parser;
use serde_json::{Value, json};

use super::{ProgramArgs, renaming, run, write};
use crate::cell::{Named, Presets, SpecLibrary};
use crate::cli::out::FileOrigin;
use crate::cli::planned_block::bytes_of_two_views;
use crate::geometry::mesh_io::write_stl;
use crate::program::dialects::{Dialect, DialectFile};
use crate::service::plan_job::plan_sha256;
use crate::testing::box_mesh;
use crate::wire::output_record::RECORD_FILE;
use crate::wire::plan::PlanDocument;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: ProgramArgs,
}

/// A program that stays at home, in a folder of its own.
fn planned(folder: &Path, cycle_secs: f64) {
    planned_from(folder, &"00".repeat(32), cycle_secs);
}

fn planned_from(folder: &Path, plan_sha256: &str, cycle_secs: f64) {
    let program = json!({
        "schema": "vantage.program/1", "plan_sha256": plan_sha256, "robot": "hans-e05", "turntable": "minas-a6-500",
        "home_deg": [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0], "cycle_secs": cycle_secs,
        "steps": [{"op": "settle", "secs": 0.5}, {"op": "scan", "viewpoint": 3, "brightness": 5, "capture_secs": 1.0}],
    });
    std::fs::write(folder.join("program.json"), program.to_string()).expect("writes");
}

/// Names of the files written, beside the record.
fn written_in(cell: &str, from: &Path, args: &[&str]) -> Result<Vec<String>, String> {
    let fixed = ["program", "--cell", cell, from.to_str().expect("a path")];
    let line = Line::try_parse_from([&fixed, args].concat()).map_err(|error| error.to_string())?;
    run(&line.args).map_err(|error| {
        assert_eq!(error.exit_code(), 2, "{error}");
        error.to_string()
    })?;
    let files = std::fs::read_dir(&line.args.out).map_err(|error| error.to_string())?;
    let names = files.map(|file| file.expect("lists").file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = names.filter(|name| name != RECORD_FILE).collect();
    names.sort();
    Ok(names)
}

fn written(folder: &Path, args: &[&str]) -> Result<Vec<String>, String> {
    written_in("e05-transcan", folder, args)
}

/// A pipe was read first, without end, and then replaced by a file.
#[cfg(unix)]
#[test]
fn what_is_no_file_is_not_replaced_by_a_program() {
    let folder = tempfile::tempdir().expect("folder");
    for name in ["socket.csv", "socket"] {
        let path = folder.path().join(name);
        let _listener = std::os::unix::net::UnixListener::bind(&path).expect("a socket");
        let file = DialectFile { name: "vantage.csv".to_owned(), text: "step\n".to_owned() };
        // A socket cannot be opened by its name.
        let refused = write(&path, vec![file], &FileOrigin::default()).expect_err("cannot be written");
        assert!(refused.exit_code() == 1 && path.exists() && !path.is_file(), "{name}: {refused}");
    }
}

#[test]
fn files_have_the_names_that_controllers_want() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    for dialect in Dialect::ALL {
        let in_capitals = [Dialect::Krl, Dialect::Fanuc].contains(&dialect);
        let stem = if dialect.is_table() { "program" } else { "bracket" };
        let stem = if in_capitals { stem.to_uppercase() } else { stem.to_owned() };
        let mut wanted: Vec<String> = dialect.outputs().iter().map(|output| format!("{stem}.{}", output.extension)).collect();
        wanted.sort();
        let out = folder.path().join(dialect.as_str()).display().to_string();
        let named = ["--dialect", dialect.as_str(), "--force", "--out", &out, "--set", "dialects.program_name=bracket"];
        let found = written(folder.path(), &named);
        assert_eq!(found.expect("written"), wanted);
        let text = std::fs::read_to_string(Path::new(&out).join(&wanted[0])).expect("reads");
        assert!(dialect.is_table() || text.contains("WITHOUT the part") || in_capitals, "{text}");
        assert_eq!(text.contains("WARNING: FORCED"), dialect != Dialect::Hans && !dialect.is_neutral(), "{text}");
    }
}

/// The second replaced the first without a word: both names are cut to eight characters.
#[test]
fn a_program_does_not_replace_one_of_another_plan() {
    let folder = tempfile::tempdir().expect("folder");
    let [left, right, out] = ["left", "right", "robot"].map(|name| folder.path().join(name));
    for (from, digits) in [(&left, "aa"), (&right, "bb")] {
        std::fs::create_dir(from).expect("a folder");
        planned_from(from, &digits.repeat(32), 1.5);
    }
    let shown = out.display().to_string();
    let told = |from: &Path, name: &str| {
        let set = format!("dialects.program_name={name}");
        written(from, &["--dialect", "fanuc", "--force", "--out", &shown, "--set", &set])
    };
    let one = Ok(vec!["BRACKET.ls".to_owned()]);
    assert_eq!(told(&left, "bracket_left"), one);
    let first = std::fs::read_to_string(out.join("BRACKET.ls")).expect("reads");
    let refused = told(&right, "bracket_right").expect_err("one name");
    assert!(refused.contains("BRACKET.ls is a program made from another plan, "), "{refused}");
    assert_eq!(std::fs::read_to_string(out.join("BRACKET.ls")).expect("reads"), first);
    planned_from(&left, &"cc".repeat(32), 1.5);
    assert_eq!(told(&left, "bracket_left"), one, "planned again in its place");
}

#[test]
fn a_name_that_the_controller_does_not_take_is_told() {
    let file = |name: &str| [DialectFile { name: name.to_owned(), text: String::new() }];
    let told = renaming(Dialect::Fanuc, "bracket_left", 0, &file("BRACKET.ls")).expect("cut");
    assert!(told.contains("named BRACKET,") && told.contains("\"bracket_left\"") && told.contains("fanuc_name_chars"), "{told}");
    let told = renaming(Dialect::Urscript, "Gehäuse", 1, &file("Geh_use_2.script")).expect("changed");
    assert!(told.contains("named Geh_use_2,") && told.ends_with("\"Gehäuse_2\""), "{told}");
    assert_eq!(renaming(Dialect::Krl, "bracket", 0, &file("BRACKET.src")), None);
    assert_eq!(renaming(Dialect::Csv, "bracket", 0, &file("program.csv")), None);
}

#[test]
fn one_file_takes_one_file() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    let at = |name: &str| folder.path().join(name);
    let out = at("scan.script").display().to_string();
    let args = ["--dialect", "urscript", "--force", "--out", &out];
    for _ in 0..2 {
        let _ = written(folder.path(), &args);
        assert!(std::fs::read_to_string(&out).expect("written").contains("vantage_scan()"));
    }
    let refused = written(folder.path(), &["--dialect", "krl", "--force", "--out", &out]).expect_err("two files");
    assert!(refused.contains("VANTAGE.src, VANTAGE.dat"), "{refused}");
    std::fs::write(&out, "# my own script").expect("a file");
    let refused = written(folder.path(), &args).expect_err("a file of the user");
    assert!(refused.contains("is not a program that Vantage wrote"), "{refused}");
    assert_eq!(std::fs::read_to_string(&out).expect("there"), "# my own script");
}

#[test]
fn what_fails_is_not_written() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 99.0);
    let out = folder.path().join("robot");
    let args = ["--dialect", "rapid", "--force", "--out", out.to_str().expect("a path")];
    let refused = written(folder.path(), &args).expect_err("the linter finds the cycle time");
    assert!(refused.contains("program.json: ") && !out.exists(), "{refused}");
    planned(folder.path(), 1.5);
    let refused = written(folder.path(), &[&args[..], &["--set", "dialects.table_axis=7"]].concat()).expect_err("no such axis");
    assert!(refused.contains("--set dialects.table_axis=7: is 7; allowed is 1 to 6"), "{refused}");
    let refused = written(folder.path(), &["--dialect", "karel", "--out", "x"]).expect_err("no such dialect");
    let known = Dialect::ALL.map(Dialect::as_str).join(", ");
    assert!(refused.contains(&format!("known are {known}")), "{refused}");
}

/// RAPID for a Han's arm was written without a word.
#[test]
fn the_robots_own_language_is_written_and_anothers_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    let out = folder.path().join("robot");
    let to_out = ["--out", out.to_str().expect("a path")];
    let (neutral, of_makers): (Vec<Dialect>, Vec<Dialect>) = Dialect::ALL.into_iter().partition(|dialect| dialect.is_neutral());
    for dialect in of_makers.into_iter().filter(|dialect| *dialect != Dialect::Hans).map(Dialect::as_str) {
        let refused = written(folder.path(), &[&["--dialect", dialect][..], &to_out].concat()).expect_err("another maker's");
        let wanted = format!("{dialect} is not a language of robot hans-e05, whose specification has dialect = \"hans\"");
        assert!(refused.contains(&wanted) && refused.contains("--force") && !out.exists(), "{refused}");
    }
    assert_eq!(written(folder.path(), &to_out), Ok(vec!["vantage.cps".to_owned()]));
    for neutral in neutral {
        written(folder.path(), &[&["--dialect", neutral.as_str()][..], &to_out].concat()).expect("of no maker");
    }
}

#[test]
fn a_robot_of_unknown_make_takes_every_language_that_is_asked_for() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    let mut cell = Presets.cell("e05-transcan").expect("a preset");
    let mut robot = Presets.robot("hans-e05").expect("a preset");
    robot.dialect = None;
    cell.robot = Named::Inline(Box::new(robot));
    let file = folder.path().join("cell.json");
    std::fs::write(&file, serde_json::to_string(&cell).expect("JSON")).expect("a file");
    let (cell, out) = (file.display().to_string(), folder.path().join("robot").display().to_string());
    let refused = written_in(&cell, folder.path(), &["--out", &out]).expect_err("which?");
    assert!(refused.contains("robot hans-e05 has no `dialect`") && refused.contains("--dialect"), "{refused}");
    let found = written_in(&cell, folder.path(), &["--dialect", "rapid", "--out", &out]).expect("any");
    assert_eq!(found, ["vantage.mod"]);
    let text = std::fs::read_to_string(Path::new(&out).join("vantage.mod")).expect("reads");
    assert!(!text.contains("FORCED"), "{text}");
}

/// A plan without a cell was no reason to look at the program beside it.
#[test]
fn a_program_that_is_not_the_plans_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let (plan, out) = (bytes_of_two_views(), folder.path().join("robot"));
    std::fs::write(folder.path().join("plan.json"), &plan).expect("writes");
    let args = ["--out", out.to_str().expect("a path")];
    let program = folder.path().join("program.json");
    for (named, reason) in [
        ("00".repeat(32), format!("is made from plan {}, not from {}", "00".repeat(32), plan_sha256(&plan))),
        (plan_sha256(&plan), "the plan has no cell, and so no program".to_owned()),
    ] {
        planned_from(folder.path(), &named, 1.5);
        for from in [folder.path(), &program] {
            let refused = written(from, &args).expect_err("not its program");
            assert!(refused.contains(&reason) && refused.contains("plan again") && !out.exists(), "{refused}");
        }
    }
}

#[test]
fn a_parameter_that_has_no_effect_on_a_program_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    let out = folder.path().join("robot").display().to_string();
    let refused = |set: &str| written(folder.path(), &["--out", &out, "--set", set]).expect_err("refused");
    let told = refused("selection.target=0.5");
    assert!(told.starts_with("--set selection.target=0.5: has no effect here") && told.contains("dialects.*"), "{told}");
    assert!(refused("selction.target=0.5").contains("is not a parameter; did you mean selection.target?"));
}

#[test]
fn a_folder_of_viewpoints_alone_says_how_to_get_a_program() {
    let folder = tempfile::tempdir().expect("folder");
    let told = super::without_program(folder.path()).to_string();
    assert!(told.ends_with("has no program.json"), "{told}");
    std::fs::write(folder.path().join("plan.json"), "{}").expect("writes");
    let told = super::without_program(folder.path()).to_string();
    assert!(told.contains("has only viewpoints; plan with a cell"), "{told}");
}

/// "keep plan.json beside it" was told of a folder whose plan was not possible.
#[test]
fn a_folder_without_a_plan_and_a_program_points_to_its_report() {
    let folder = tempfile::tempdir().expect("folder");
    let part = folder.path().join("part.stl");
    std::fs::write(&part, write_stl(&box_mesh([-10.0, -10.0, 0.0], [10.0, 10.0, 20.0]))).expect("writes");
    std::fs::write(folder.path().join("report.txt"), "No plan\n").expect("writes");
    let out = folder.path().join("robot").display().to_string();
    let told = written(folder.path(), &["--mesh", part.to_str().expect("a path"), "--out", &out]).expect_err("refused");
    assert!(told.ends_with("has neither plan nor program.json; its report.txt says why"), "{told}");
}

#[test]
fn a_folder_without_the_plan_that_it_should_have_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    let file = |name: &str| json!({"name": name, "sha256": "00", "written_by": "plan"});
    let record = |complete: bool, files: Value| {
        let record = json!({"schema": "vantage.output/1", "version": "0", "complete": complete, "files": files});
        std::fs::write(folder.path().join(RECORD_FILE), record.to_string()).expect("writes");
    };
    let out = folder.path().join("robot").display().to_string();
    record(true, json!([file("plan.json"), file("program.json")]));
    let refused = written(folder.path(), &["--out", &out]).expect_err("its plan is gone");
    assert!(refused.contains("plan.json is gone; plan again"), "{refused}");
    record(false, json!([]));
    let refused = written(folder.path(), &["--out", &out]).expect_err("half written");
    assert!(refused.contains("holds only some of its files"), "{refused}");
}

/// The header said "with the part in it" of a part that was taken to rest as by default.
#[test]
fn a_part_without_the_plan_that_says_where_it_lies_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    planned(folder.path(), 1.5);
    let part = folder.path().join("part.stl");
    std::fs::write(&part, write_stl(&box_mesh([0.0; 3], [60.0, 40.0, 30.0]))).expect("writes");
    let out = folder.path().join("robot");
    let args = ["--mesh", part.to_str().expect("a path"), "--unit", "mm", "--out", out.to_str().expect("a path")];
    let refused = written(folder.path(), &args).expect_err("no plan is there");
    assert!(refused.contains("without its plan") && refused.contains("--plan") && !out.exists(), "{refused}");
}

/// The plan was said to be missing, of a folder that was not there.
#[test]
fn a_folder_that_is_not_there_is_told_as_such() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("robot").display().to_string();
    let args = ["--mesh", "part.stl", "--unit", "mm", "--out", out.as_str()];
    let refused = written(&folder.path().join("nowhere"), &args).expect_err("there is none");
    assert!(refused.ends_with("nowhere: there is no such file"), "{refused}");
}

/// The program was checked without the fixture that holds the part, and written.
#[test]
fn a_part_without_the_fixture_of_its_plan_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let (part, stl) = (folder.path().join("part.stl"), write_stl(&box_mesh([0.0; 3], [60.0, 40.0, 30.0])));
    std::fs::write(&part, &stl).expect("writes");
    let mut plan: Value = serde_json::from_slice(&bytes_of_two_views()).expect("JSON");
    plan["part"]["sha256"] = plan_sha256(&stl).into();
    plan["params"]["part"]["fixture_mesh"] = "nowhere.stl".into();
    let plan = plan.to_string();
    std::fs::write(folder.path().join("plan.json"), &plan).expect("writes");
    planned_from(folder.path(), &plan_sha256(plan.as_bytes()), 1.5);
    let out = folder.path().join("robot");
    let args = ["--mesh", part.to_str().expect("a path"), "--unit", "mm", "--out", out.to_str().expect("a path")];
    let refused = written(folder.path(), &args).expect_err("it is not there");
    assert!(refused.starts_with("--fixture: is not given; ") && refused.contains("\"nowhere.stl\""), "{refused}");
    assert!(refused.contains("with --fixture") && !out.exists(), "{refused}");
}

/// The program of the second setup was left out without a word.
#[test]
fn the_program_of_every_setup_is_asked_for() {
    let folder = Path::new("plan");
    let mut plan: Value = serde_json::from_slice(&bytes_of_two_views()).expect("JSON");
    let read = |plan: &Value| serde_json::from_value::<PlanDocument>(plan.clone()).expect("a plan");
    assert!(super::check_all_there(folder, 1, &read(&plan)).is_ok());
    let setup = json!({
        "table_from_part": {"translation_mm": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}, "viewpoints": [], "coverable_area_mm2": 1.0,
        "measured_area_mm2": 1.0,
    });
    plan["setups"] = json!([setup, setup]);
    assert!(super::check_all_there(folder, 2, &read(&plan)).is_ok());
    let told = super::check_all_there(folder, 1, &read(&plan)).expect_err("one is missing").to_string();
    assert!(told.contains("program-2.json: is missing; the plan has 2 setups"), "{told}");
}
