//! Help, version, manual pages, lists of parameters and presets, and completions.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use super::{Ended, run};

const COMMANDS: [&str; 23] = [
    "serve",
    "demo",
    "calibrate",
    "cell",
    "compare",
    "rescan",
    "plan",
    "study",
    "inspect",
    "check",
    "program",
    "run",
    "params",
    "presets",
    "part",
    "robot",
    "scanner",
    "sim",
    "backup",
    "restore",
    "completions",
    "man",
    "healthcheck",
];

#[test]
fn every_command_is_in_the_list_of_these_tests() {
    let help = run(&["-h"]).out;
    let (_, below) = help.split_once("Commands:\n").expect("a list of commands");
    let entries = below.lines().take_while(|line| !line.is_empty());
    let first = |line: &str| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' '))?.split(' ').next().map(str::to_owned);
    let named: BTreeSet<String> = entries.filter_map(first).filter(|name| name != "help").collect();
    assert_eq!(named, COMMANDS.map(str::to_owned).into());
}

#[test]
fn help_is_as_wide_as_a_terminal_and_each_study_has_its_own() {
    for command in COMMANDS.iter().map(|command| vec![*command]).chain([vec!["study", "weights"], vec!["study", "reach"]]) {
        for flag in ["-h", "--help"] {
            let ended = run(&[&command[..], &[flag]].concat());
            assert_eq!(ended.code, Some(0), "{command:?}");
            let widest = ended.out.lines().map(|line| line.chars().count()).max().unwrap_or_default();
            // Examples and keys of parameters stand as they are.
            let allowed = if flag == "-h" { 110 } else { 140 };
            assert!(widest <= allowed, "{command:?} {flag} is {widest} wide\n{}", ended.out);
            for global in ["--quiet", "--verbose", "--json"] {
                assert!(ended.out.contains(global), "{command:?} {flag} lacks {global}");
            }
        }
    }
    let short = run(&["study", "-h"]);
    assert!(short.out.lines().count() < 45 && !short.out.contains("--foot") && !short.out.contains("--at "), "{}", short.out);
    assert!(run(&["study", "reach", "-h"]).out.contains("--foot") && !run(&["study", "reach", "-h"]).out.contains("--scanner"));
    assert!(run(&["study", "weights", "-h"]).out.contains("--at ") && !run(&["study", "weights", "-h"]).out.contains("--foot"));
}

#[test]
fn version_names_commit_and_target() {
    let ended = run(&["--version"]);
    let line = ended.out.trim();
    let head = format!("vantage {} (commit ", env!("CARGO_PKG_VERSION"));
    assert!(line.starts_with(&head) && line.ends_with(')') && line.contains(std::env::consts::ARCH), "{line}");
    assert_eq!(run(&["-V"]).out, ended.out);
    let commit = line[head.len()..].split(',').next().expect("a commit");
    let is_commit = commit.len() >= 7 && commit.chars().all(|digit| digit.is_ascii_hexdigit());
    assert!(is_commit || ["development", "unknown"].contains(&commit), "{commit}");
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let ended = run(&["man", "--out", &folder.path().join("man1").display().to_string()]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let page = |name: &str| {
        std::fs::read_to_string(folder.path().join("man1").join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    let names = COMMANDS.iter().map(|command| format!("vantage-{command}.1"));
    for name in names.chain(["vantage.1", "vantage-study-weights.1", "vantage-study-reach.1"].map(str::to_owned)) {
        let text = page(&name);
        assert!(text.contains(".TH ") && text.contains(".SH NAME") && text.contains(".SH SYNOPSIS"), "{name}\n{text}");
        assert!(ended.out.lines().any(|line| line.ends_with(&name)), "{name} is not told");
    }
    assert!(page("vantage-plan.1").contains("max\\-views") || page("vantage-plan.1").contains("\\-\\-set"), "its options");
}

#[test]
fn parameters_and_presets_are_listed() {
    let all = run(&["params"]).out;
    assert!(all.contains("motion.clearance_mm = 5.0    (1 to 200 mm)\n    Minimum distance that moving"), "{all}");
    let group = run(&["params", "selection"]).out;
    assert!(group.starts_with("selection.solver = ") && !group.contains("motion."), "{group}");
    let unknown = run(&["params", "selection.targit"]);
    assert!(unknown.code == Some(2) && unknown.err.contains("did you mean selection.target?"), "{}", unknown.err);
    let presets = run(&["presets"]).out;
    for line in [
        "scanner     transcan-c ",
        "robot       ur5e",
        "turntable   minas-a6-500",
        "cell        e05-transcan",
        "parameters  thesis",
    ] {
        assert!(presets.contains(line), "{line:?} is not in\n{presets}");
    }
    assert!(run(&["presets", "robots"]).out.lines().all(|line| line.starts_with("robot ")));
    // A preset is a file to start from.
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, run(&["presets", "e05-transcan"]).out).expect("a file");
    assert_eq!(run(&["check", &file.display().to_string()]).code, Some(0));
}

/// Words that bash offers for the last of `words`.
fn offered(script: &Path, words: &[&str]) -> Vec<String> {
    let (last, before) = (words[words.len() - 1], words[words.len() - 2]);
    let line: Vec<String> = words.iter().map(|word| format!("'{word}'")).collect();
    let ask = format!(
        "source {}; compopt() {{ :; }}; COMP_WORDS=({}); COMP_CWORD={}; _vantage vantage '{last}' '{before}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        script.display(),
        line.join(" "),
        words.len() - 1
    );
    let ended: Ended = Command::new("bash").args(["-c", &ask]).output().expect("bash runs").into();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    ended.out.lines().filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

#[test]
fn values_are_completed() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("vantage.bash");
    std::fs::write(&script, run(&["completions", "bash"]).out).expect("a file");
    for (words, wanted) in [
        (&["vantage", "pl"][..], &["plan"][..]),
        (&["vantage", "plan", "--cell", "e"], &["e05-transcan"]),
        (&["vantage", "plan", "--unit", "i"], &["inch"]),
        (&["vantage", "plan", "--set", "selection.max_v"], &["selection.max_views="]),
        (&["vantage", "program", "--dialect", "ra"], &["rapid"]),
        (&["vantage", "study", "rea"], &["reach"]),
        (&["vantage", "presets", "ur1"], &["ur10e"]),
        (&["vantage", "params", "motion.cl"], &["motion.clearance_mm"]),
        (&["vantage", "part", "fig"], &["figurine"]),
    ] {
        assert_eq!(offered(&script, words), wanted, "{words:?}");
    }
    let zsh = run(&["completions", "zsh"]).out;
    assert!(
        zsh.contains("selection.solver=greedy") && zsh.contains("e05-transcan"),
        "closed lists in shells that do not break at ="
    );
    for shell in ["fish", "elvish", "powershell"] {
        assert!(run(&["completions", shell]).out.contains("healthcheck"), "{shell}");
    }
}
