//! Names that are misspelled: parameters, values of closed lists, presets and languages of controllers are asked about.

use std::path::Path;

use super::{inputs, run};
use crate::server::process::vantage;

/// Features of a file were told apart by no name, and warned of before they were checked.
#[test]
fn features_of_a_file_are_checked_with_those_that_are_set() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, ..] = inputs(folder.path());
    let (file, out) = (folder.path().join("features.csv"), folder.path().join("out").display().to_string());
    let told = |rows: &str| {
        std::fs::write(&file, format!("name,region,tolerance_mm\n{rows}")).expect("a file");
        let ended = run(&["plan", &part, "--unit", "mm", "--out", &out, "--features", &file.display().to_string()]);
        assert_eq!(ended.code, Some(2), "{}", ended.err);
        assert!(!ended.err.contains("warning"), "{}", ended.err);
        ended.err
    };
    let twice = told("h,sphere 0 0 0 5,0.5\nh,sphere 9 0 0 5,0.5\n");
    assert!(twice.contains("/regions/features/1/name") && twice.contains("which is the name of"), "{twice}");
    let negative = told("h,sphere 0 0 0 5,-1\n");
    assert!(negative.contains("tolerance_mm"), "{negative}");
}

#[test]
fn a_misspelled_name_is_answered_with_the_one_that_was_meant() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, ..] = inputs(folder.path());
    let file = folder.path().join("params.json");
    std::fs::write(&file, "{\"selection\": {\"maxviews\": 3}}").expect("a file");
    let (file, out) = (file.display().to_string(), folder.path().join("out").display().to_string());
    let plan = |more: &[&str]| {
        [&["plan", &part, "--unit", "mm", "--out", &out][..], more].concat().into_iter().map(str::to_owned).collect()
    };
    let lines: [(Vec<String>, &str); 9] = [
        (plan(&["--set", "selection.targt=0.9"]), "did you mean selection.target?"),
        (plan(&["--set", "target=0.9"]), "did you mean selection.target?"),
        (plan(&["--set", "motion.clearance=3"]), "did you mean motion.clearance_mm?"),
        (plan(&["--set", "selection.solver=gredy"]), "did you mean `greedy`?"),
        (plan(&["--set", "preset=tesis"]), "did you mean `thesis`?"),
        (plan(&["--params", &file]), "did you mean `max_views`?"),
        (plan(&["--cell", "e5-transcan"]), "did you mean e05-transcan?"),
        (plan(&["--cell", "none", "--scanner", "transcanc"]), "did you mean transcan-c?"),
        (
            ["program", &out, "--cell", "e05-transcan", "--dialect", "urskript", "--out", &out].map(str::to_owned).into(),
            "did you mean urscript?",
        ),
    ];
    for (line, question) in lines {
        let arguments: Vec<&str> = line.iter().map(String::as_str).collect();
        let ended = run(&arguments);
        assert!(ended.code == Some(2) && ended.err.contains(question), "{arguments:?}: {:?} {}", ended.code, ended.err);
    }
    let cell = folder.path().join("cell.toml");
    let text = include_str!("../../../config/cells/e05-transcan.toml").replace("\"hans-e05\"", "\"hans-e5\"");
    std::fs::write(&cell, text).expect("a file");
    let ended = run(&["check", &cell.display().to_string()]);
    assert!(ended.code == Some(2) && ended.err.contains("did you mean hans-e05?"), "{}", ended.err);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn keys_within_values_and_whole_groups_are_set_as_before() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, ..] = inputs(folder.path());
    let out = folder.path().join("out").display().to_string();
    for set in ["selection={\"max_views\":2}", "regions.noise.budget=0.25"] {
        let quick = super::quick_plan(&part, &out);
        let without_errors: Vec<&str> = quick.into_iter().filter(|argument| !argument.starts_with("robust.")).collect();
        let cut: Vec<&str> = without_errors[..without_errors.len() - 1].to_vec();
        let ended = run(&[&cut[..], &["--set", set]].concat());
        assert_eq!(ended.code, Some(0), "{set}: {}", ended.err);
    }
}

#[test]
fn labels_and_numbers_are_held_to_what_the_server_takes() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, ..] = inputs(folder.path());
    let out = folder.path().join("out").display().to_string();
    let (long, longer) = ("x".repeat(65), "x".repeat(129));
    for (options, said) in [
        (&["--label", "a"][..], "not of the form KEY=VALUE"),
        (&["--label", "=x"], "allowed are 1 to 64"),
        (&["--label", &format!("{long}=x")], "a key of 65 characters"),
        (&["--label", "a=b\nc"], "a control character"),
        (&["--label", "a=b", "--label", "a=c"], "given twice"),
        (&["--part-number", &longer], "129 characters; allowed are 0 to 128"),
        (&["--serial", "a\tb"], "a control character"),
        (&["--serial", "a\u{202e}b"], "a control character"),
    ] {
        let ended = run(&[&["plan", &part, "--unit", "mm", "--out", &out][..], options].concat());
        assert!(ended.code == Some(2) && ended.err.contains(said), "{options:?}: {:?} {}", ended.code, ended.err);
    }
}

#[test]
fn a_mesh_that_is_not_there_is_asked_about_and_a_folder_told_as_such() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, ..] = inputs(folder.path());
    let name = Path::new(&part).file_name().expect("a name").to_string_lossy().into_owned();
    let refused = |mesh: &str| {
        let ended = run(&["plan", mesh, "--unit", "mm", "--out", &folder.path().join("out").display().to_string()]);
        assert_eq!(ended.code, Some(2), "{}", ended.err);
        ended.err
    };
    let told = refused(&part.replace(&name, &format!("x{name}")));
    assert!(told.contains(&format!("there is no such file; did you mean {name}?")), "{told}");
    let told = refused(&folder.path().join("none").join("part.stl").display().to_string());
    assert!(told.contains("part.stl: there is no folder "), "{told}");
    let told = refused(&folder.path().display().to_string());
    assert!(told.contains("is a folder; give the mesh files in it by their names"), "{told}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_plan_without_a_folder_is_written_beside_where_it_is_asked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, ..] = inputs(folder.path());
    let planned = vantage()
        .current_dir(folder.path())
        .args(["plan", &part, "--unit", "mm", "--cell", "none", "--report", "none"])
        .args(["--set", "part.samples_per_mm2=0.02", "--set", "selection.max_views=1", "--set", "missed.advice=false"])
        .output()
        .expect("the program");
    assert!(planned.status.success(), "{}", String::from_utf8_lossy(&planned.stderr));
    let stem = Path::new(&part).file_stem().expect("a name").to_string_lossy().into_owned();
    assert!(folder.path().join(format!("{stem}_plan")).join("plan.json").is_file());
}

/// Values that a reader would take for something else: the last of two fields, nothing for a number that is not finite.
#[test]
fn fields_given_twice_and_infinite_numbers_of_files_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = [
        (
            "twice.json",
            r#"{"selection": {"target": 0.9}, "selection": {"target": 0.8}}"#,
            "`selection` is given twice: give it once (line 1, column ",
        ),
        ("infinite.toml", "[selection]\ntarget = inf\n", "inf is not a finite number"),
    ];
    for (name, text, words) in files {
        let file = folder.path().join(name);
        std::fs::write(&file, text).expect("written");
        let ended = run(&["check", &file.display().to_string()]);
        assert!(ended.code == Some(2) && ended.err.contains(words), "{name}: {}", ended.err);
    }
}

/// The folder for results is made before the part is read, and was once asked about.
#[test]
fn a_mesh_without_a_neighbour_is_not_asked_about() {
    let folder = tempfile::tempdir().expect("a folder");
    let ended = vantage().current_dir(folder.path()).args(["plan", "bunny.stl", "--unit", "mm"]).output().expect("the program");
    let told = String::from_utf8_lossy(&ended.stderr);
    assert_eq!((ended.status.code(), told.trim_end()), (Some(2), "error: bunny.stl: there is no such file"), "{told}");
}
