//! `vantage study` as a process: the files it writes, that plots and page are well-formed, and how it refuses. And
//! `ovp.json` of `vantage plan`.

use std::path::Path;

use crate::report::markup::well_formed;
use crate::server::process::vantage;

fn part(folder: &Path) -> String {
    let file = folder.join("part.stl").display().to_string();
    let made = vantage().args(["part", "figurine", "--triangles", "8000", "--out", &file]).output().expect("the program");
    assert!(made.status.success());
    file
}

#[test]
#[ignore = "long: tests/all runs it"]
fn each_study_writes_its_table_two_plots_and_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let (part, out) = (part(folder.path()), folder.path().join("out"));
    let coarse =
        ["part.samples_per_mm2=0.05", "part.patch_edge_mm=20", "candidates.even_directions=20", "candidates.targeted_max=10"];
    for (study, lines) in [("weights", 5), ("limits", 5), ("candidates", 8)] {
        let output = vantage()
            .args(["study", study, &part, "--unit", "mm", "--views", "8", "--out", &out.display().to_string()])
            .args(coarse.iter().flat_map(|set| ["--set", set]))
            .output()
            .expect("the program");
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(told.lines().count() >= lines + 2 && told.contains("goal: 98.5 %"), "{told}");
        let read = |name: String| std::fs::read_to_string(out.join(&name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        for plot in ["coverage", "grades"] {
            let svg = read(format!("{study}-{plot}.svg"));
            well_formed(&format!("<!DOCTYPE html>{svg}")).expect("well-formed");
        }
        well_formed(&read(format!("{study}.html"))).expect("well-formed");
        let csv = read(format!("{study}.csv"));
        let ended = csv.lines().skip(1).filter(|line| !line.ends_with(',')).count();
        assert!(ended >= lines, "{ended} series end in\n{csv}");
    }
}

#[test]
fn a_study_of_reach_writes_a_table_and_a_map_and_names_the_best_layout() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let run = |args: &[&str]| {
        let output =
            vantage().args(["study", "reach", "--out", &out.display().to_string()]).args(args).output().expect("the program");
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stdout).into_owned(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    };
    let (code, told, error) = run(&["--cell", "e05-transcan", "--foot", "400,450", "--table=-200"]);
    assert_eq!(code, Some(0), "{error}");
    // The figures of config/cells/REACH.md for a cube of 120 mm.
    assert!(told.contains("as it is: foot 400 mm from the axis, plate −200 mm above the foot"), "{told}");
    let csv = std::fs::read_to_string(out.join("reach.csv")).expect("the table");
    let recorded = include_str!("../../config/cells/REACH.md");
    let row = recorded.lines().find(|line| line.starts_with("| -200 |")).expect("the row of that height");
    for (column, line) in [(5, 1), (6, 2)] {
        let small = row.split('|').nth(column).expect("an entry").split('/').next().expect("the small part").trim();
        let cells: Vec<&str> = csv.lines().nth(line).expect("a row").split(',').collect();
        assert_eq!(format!("{} · {}", cells[4], cells[6]), small, "{csv}");
    }
    well_formed(&format!("<!DOCTYPE html>{}", std::fs::read_to_string(out.join("reach.svg")).expect("the map")))
        .expect("well-formed");
    let (code, _, error) = run(&["--cell", "none"]);
    assert!(code == Some(2) && error.contains("needs a cell"), "{error}");
    let (code, _, error) = run(&["--cell", "e05-transcan", "--cube", "0"]);
    assert!(code == Some(2) && error.contains("--cube: is 0 mm; allowed is 1 to 5000 mm"), "{error}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_study_refuses_like_the_other_commands() {
    let folder = tempfile::tempdir().expect("a folder");
    let (part, out) = (part(folder.path()), folder.path().join("out").display().to_string());
    let refused = |args: &[&str]| {
        let output = vantage().arg("study").args(args).args(["--out", &out]).output().expect("the program");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, said) = refused(&["weights", "nowhere.stl"]);
    assert!(code == Some(2) && said.contains("nowhere.stl"), "{said}");
    let (code, said) = refused(&["colours", &part]);
    assert!(code == Some(2) && said.contains("weights"), "{said}");
    let (code, said) = refused(&["weights", &part, "--unit", "mm", "--set", "score.a=0.3"]);
    assert!(code == Some(2) && said.contains("/score/a: is set by the study"), "{said}");
    let (code, said) = refused(&["weights", &part, "--unit", "mm", "--views", "5", "--at", "6"]);
    assert!(code == Some(2) && said.contains("--at 6"), "{said}");
    // Read in metres a figurine is as large as a house: nothing of it is ever in depth from around it at this distance.
    let far = ["limits", &part, "--unit", "mm", "--set", "candidates.standoffs_mm=[500]", "--set", "part.samples_per_mm2=0.02"];
    let (code, said) = refused(&far);
    assert!(code == Some(3) && said.contains("measures anything"), "{code:?} {said}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_plan_has_the_benchmarks_log_beside_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (part, out) = (part(folder.path()), folder.path().join("out"));
    let planned = vantage()
        .args(["plan", &part, "--unit", "mm", "--cell", "none", "--set", "part.samples_per_mm2=0.05"])
        .args([
            "--set",
            "missed.remedies=0",
            "--set",
            "candidates.strategies=[\"ellipsoid\"]",
            "--set",
            "candidates.rolls_deg=[0]",
        ])
        .args(["--out", &out.display().to_string()])
        .output()
        .expect("the program");
    assert!(planned.status.success(), "{}", String::from_utf8_lossy(&planned.stderr));
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(out.join(name)).expect("a file")).expect("JSON")
    };
    let (log, plan, timings) = (json("ovp.json"), json("plan.json"), json("timings.json"));
    assert_eq!(log["Log"]["Model"]["Name"], "part.stl");
    assert_eq!(log["OVP"]["Count"], plan["viewpoints"].as_array().expect("views").len());
    assert_eq!(log["Log"]["VPC"]["Count"], plan["candidates"]["kept"]);
    assert_eq!(log["Log"]["Vantage"]["of_total_independent"], plan["coverage"]["independent"]["of_total"]);
    assert_eq!(log["Log"]["Duration"]["RayTracingSec"], timings["visibility"]);
    assert!(log["Log"]["TimeStamp"].as_str().is_some_and(|at| at.len() > 19 && at.contains('T')), "{log}");
}
