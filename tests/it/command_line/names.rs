//! Names that are misspelled: parameters, values of closed lists, presets and languages of controllers are asked about.

use super::{inputs, run};

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
