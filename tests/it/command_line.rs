//! The command line as a whole, as a process: where output goes and what happens when it cannot, the flags that every command
//! has, help, manual pages, completions, and the questions after names that are misspelled.

mod elsewhere;
mod json;
mod names;
mod pages;
pub(crate) mod rehearsal;
mod runs;

use std::io::pipe;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::server::process::vantage;

/// Codes and texts of a command that has ended.
struct Ended {
    code: Option<i32>,
    out: String,
    err: String,
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Self { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
    }
}

fn run(arguments: &[&str]) -> Ended {
    vantage().args(arguments).stdin(Stdio::null()).output().expect("the program").into()
}

/// Runs with a standard output of which nobody reads.
fn run_unread(arguments: &[&str]) -> Ended {
    let (reader, writer) = pipe().expect("a pipe");
    drop(reader);
    vantage().args(arguments).stdin(Stdio::null()).stdout(writer).stderr(Stdio::piped()).output().expect("the program").into()
}

/// Runs with a standard output that is a full disk.
fn run_on_full_disk(arguments: &[&str]) -> Ended {
    let full = std::fs::File::options().write(true).open("/dev/full").expect("the device that is full");
    vantage().args(arguments).stdin(Stdio::null()).stdout(full).stderr(Stdio::piped()).output().expect("the program").into()
}

/// A part, a scanner's file, and parameters with a warning.
fn inputs(folder: &Path) -> [String; 3] {
    let path = |name: &str| folder.join(name).display().to_string();
    let part = path("base.stl");
    assert_eq!(run(&["part", "base", "--triangles", "8000", "--out", &part]).code, Some(0));
    std::fs::write(path("params.toml"), "[[regions.features]]\nregion = { kind = \"box\", min_mm = [-30.0, -30.0, 5.0], max_mm = [30.0, 30.0, 40.0] }\ntolerance_mm = 0.01\n")
        .expect("a file");
    let scanner = concat!(env!("CARGO_MANIFEST_DIR"), "/config/scanners/transcan-c.toml").to_owned();
    [part, scanner, path("params.toml")]
}

/// A quick plan without a cell.
fn quick_plan<'a>(part: &'a str, out: &'a str) -> Vec<&'a str> {
    let mut arguments = vec!["plan", part, "--unit", "mm", "--cell", "none", "--out", out];
    for set in [
        "part.samples_per_mm2=0.02",
        "candidates.strategies=[\"ellipsoid\"]",
        "candidates.rolls_deg=[0]",
        "selection.max_views=2",
        "missed.remedies=0",
        "missed.advice=false",
        "robust.pose_error=null",
    ] {
        arguments.extend(["--set", set]);
    }
    arguments
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_reader_that_closes_the_pipe_changes_nothing_but_what_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, scanner, params] = inputs(folder.path());
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (plan, man, other, study) = (path("plan"), path("man"), path("other.stl"), path("study"));
    let planned = quick_plan(&part, &plan);
    for arguments in [
        &["--help"][..],
        &["plan", "--help"],
        &["--version"],
        &["completions", "bash"],
        &["man", "--out", &man],
        &["params"],
        &["params", "--json"],
        &["presets"],
        &["inspect", &part, "--unit", "mm"],
        &["inspect", &scanner, "--json"],
        &["check", &scanner],
        &["part", "base", "--triangles", "8000", "--out", &other],
        &["study", "reach", "--foot", "400", "--table=-200", "--out", &study],
        &planned,
    ] {
        let ended = run_unread(arguments);
        assert_eq!((ended.code, ended.err.contains("panicked")), (Some(0), false), "{arguments:?}: {}", ended.err);
    }
    assert!(Path::new(&plan).join("plan.json").is_file() && Path::new(&other).is_file(), "the work is done all the same");
    let ended = run_unread(&["check", &scanner, &params, "--strict"]);
    assert!(ended.code == Some(2) && ended.err.contains("tolerance"), "its exit code stands: {}", ended.err);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_full_disk_is_exit_code_1_with_a_sentence() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, scanner, _] = inputs(folder.path());
    let planned = folder.path().join("plan").display().to_string();
    let planned = quick_plan(&part, &planned);
    for arguments in [
        &["--help"][..],
        &["--version"],
        &["completions", "zsh"],
        &["params"],
        &["presets", "--json"],
        &["inspect", &part, "--unit", "mm"],
        &["check", &scanner],
        &planned,
    ] {
        let ended = run_on_full_disk(arguments);
        let told = "standard output cannot be written: No space left on device";
        assert!(ended.code == Some(1) && ended.err.contains(told), "{arguments:?}: {:?} {}", ended.code, ended.err);
    }
    let ended = run(&["part", "base", "--triangles", "8000", "--out", "/dev/full"]);
    assert!(ended.code == Some(1) && ended.err.contains("/dev/full: cannot be written: No space left"), "{}", ended.err);
    // Nobody can be told, and nothing breaks.
    let full = std::fs::File::options().write(true).open("/dev/full").expect("the device that is full");
    let status = vantage().args(["inspect", "/nowhere.stl"]).stderr(full).status().expect("the program");
    assert_eq!(status.code(), Some(2));
}

#[test]
fn a_file_is_written_whole_or_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let shown = folder.path().display().to_string();
    let ended = run(&["part", "base", "--triangles", "8000", "--out", &shown]);
    assert!(ended.code == Some(2) && ended.err.contains("is a folder; name a file"), "{}", ended.err);
    let ended = run(&["part", "base", "--triangles", "8000", "--out", &format!("{shown}/a/b.stl")]);
    assert!(ended.code == Some(2) && ended.err.contains("its folder does not exist"), "{}", ended.err);
    let script =
        format!("{:?} part base --triangles 8000 --quiet --out /dev/stdout | head -c 80 | wc -c", vantage().get_program());
    let piped: Ended = Command::new("sh").args(["-c", &script]).output().expect("a shell").into();
    assert_eq!((piped.out.trim(), piped.err.as_str()), ("80", ""), "a pipe is written as it is");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn quiet_prints_errors_alone_and_writes_the_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, scanner, params] = inputs(folder.path());
    let out = folder.path().join("plan").display().to_string();
    let planned = [&quick_plan(&part, &out)[..], &["--quiet"]].concat();
    for arguments in [&planned[..], &["-q", "inspect", &part, "--unit", "mm"], &["check", "-q", &scanner, &params]] {
        let ended = run(arguments);
        assert_eq!((ended.code, ended.out.as_str(), ended.err.as_str()), (Some(0), "", ""), "{arguments:?}");
    }
    assert!(Path::new(&out).join("report.html").is_file());
    let ended = run(&["-q", "inspect", "/nowhere.stl"]);
    assert!(ended.code == Some(2) && ended.out.is_empty() && ended.err.starts_with("error: /nowhere.stl"), "{}", ended.err);
    let ended = run(&["presets", "cell", "--json", "-q"]);
    assert!(ended.out.contains("e05-transcan"), "JSON that is asked for is printed");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn verbose_logs_the_stages_with_their_times() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, ..] = inputs(folder.path());
    let out = folder.path().join("plan").display().to_string();
    let ended = run(&[&quick_plan(&part, &out)[..], &["-v"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    for stage in ["surface", "visibility", "report"] {
        let logged = ended.err.lines().any(|line| line.contains("INFO") && line.contains(stage) && line.contains("secs="));
        assert!(logged, "{stage} is not in\n{}", ended.err);
    }
    let plain = run(&quick_plan(&part, &out));
    assert!(!plain.err.contains("INFO") && plain.err.lines().any(|line| line == "visibility"), "{}", plain.err);
}

/// Every command prints through one writer, which returns errors.
#[test]
fn no_command_prints_past_the_writer() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cli");
    let mut seen = 0;
    for file in crate::architecture::sources(&folder) {
        let text = std::fs::read_to_string(&file).expect("the sources are readable");
        seen += 1;
        for word in ["println!", "print!", "eprintln!", "eprint!"] {
            assert!(!text.contains(&format!(" {word}(")), "{} says {word}", file.display());
        }
    }
    assert!(seen > 20, "the scan must see the sources: {seen}");
}
