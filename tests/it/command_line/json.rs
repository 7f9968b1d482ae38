//! `--json`: a document on standard output for every command that prints something for people, and errors and warnings as one
//! object a line on standard error.

use serde_json::Value;

use super::{Ended, inputs, quick_plan, run};
use crate::server::process::Server;

fn document(arguments: &[&str]) -> Value {
    let Ended { code, out, err } = run(arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {err}");
    serde_json::from_str(&out).unwrap_or_else(|error| panic!("{arguments:?}: {error}\n{out}"))
}

/// Objects on standard error.
fn lines(err: &str) -> Vec<Value> {
    err.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_command_answers_in_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, scanner, params] = inputs(folder.path());
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (plan, study, man, other) = (path("plan"), path("study"), path("man"), path("other.stl"));
    assert_eq!(document(&["--json", "part", "base", "--triangles", "8000", "--out", &other])["unit"], "mm");
    assert!(document(&["inspect", &part, "--unit", "mm", "--json"])["watertight"].as_bool().expect("a mesh"));
    assert_eq!(document(&["inspect", &scanner, "--json"])["name"], "transcan-c");
    assert_eq!(document(&[&quick_plan(&part, &plan)[..], &["--json"]].concat())["schema"], "vantage.plan/1");
    let checked = document(&["check", &scanner, &params, &format!("{plan}/plan.json"), "--json"]);
    assert_eq!((checked["ok"].as_bool(), checked["files"].as_array().map(Vec::len)), (Some(true), Some(3)), "{checked}");
    assert_eq!(checked["files"][1]["warnings"][0]["code"], "tolerance_beyond_noise", "{checked}");
    let reach = document(&["study", "reach", "--foot", "400", "--table=-200", "--out", &study, "--json"]);
    assert_eq!((reach["cell"].as_str(), reach["layouts"].as_array().map(Vec::len)), (Some("e05-transcan"), Some(1)), "{reach}");
    let coarse = ["--set", "part.samples_per_mm2=0.02", "--set", "candidates.strategies=[\"ellipsoid\"]"];
    let series = [&["study", "weights", &part, "--unit", "mm", "--views", "4", "--out", &study, "--json"][..], &coarse].concat();
    assert_eq!(document(&series)["series"].as_array().map(Vec::len), Some(5));
    let parameters = document(&["params", "selection.target", "--json"]);
    let target = &parameters["parameters"][0];
    assert_eq!(
        (target["default"].as_f64(), target["max"].as_f64(), target["key"].as_str()),
        (Some(0.985), Some(1.0), Some("selection.target"))
    );
    assert!(document(&["params", "--json"])["parameters"].as_array().is_some_and(|all| all.len() > 80));
    assert!(document(&["presets", "--json"])["presets"].as_array().is_some_and(|all| all.len() > 20));
    assert_eq!(document(&["presets", "e05-transcan", "--json"])["robot"], "hans-e05");
    assert!(document(&["man", "--out", &man, "--json"])["files"].as_array().is_some_and(|files| files.len() > 15));
    assert_eq!(document(&["serve", "--print-defaults", "--json"])["server"]["max_connections"], 1024);
    assert_eq!(run(&["serve", "--print-defaults"]).out, include_str!("../../../config/default.toml"));
    let version = document(&["--version", "--json"]);
    assert_eq!(version["version"], env!("CARGO_PKG_VERSION"));
    assert!(version["commit"].is_string() && version["target"].is_string(), "{version}");
}

#[test]
fn the_store_and_the_health_of_a_server_are_told_in_json() {
    let (data, backup) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let server = Server::start(data.path(), &[]);
    let health = document(&["healthcheck", "--url", &server.url(""), "--json"]);
    assert_eq!(health["healthy"], true);
    let (data, to) = (data.path().display().to_string(), backup.path().join("to").display().to_string());
    let copied = document(&["backup", "--data", &data, "--to", &to, "--json"]);
    assert_eq!((copied["to"].as_str(), copied["files"].as_u64()), (Some(to.as_str()), Some(0)), "{copied}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn errors_and_warnings_are_objects_with_place_and_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, _, params] = inputs(folder.path());
    let ended = run(&["inspect", "/nowhere.stl", "--json"]);
    let [error] = &lines(&ended.err)[..] else { panic!("{}", ended.err) };
    assert_eq!(
        (error["level"].as_str(), error["code"].as_str(), error["exit_code"].as_u64()),
        (Some("error"), Some("bad_input"), Some(2))
    );
    assert!(ended.code == Some(2) && ended.out.is_empty(), "{}", ended.out);

    let wrong = folder.path().join("wrong.toml");
    std::fs::write(&wrong, "[motion]\nspeed_fraction = 7.0\nclearance_mm = 0.0\n").expect("a file");
    let wrong = wrong.display().to_string();
    let ended = run(&["check", "--json", &wrong]);
    let [error] = &lines(&ended.err)[..] else { panic!("{}", ended.err) };
    assert_eq!((error["code"].as_str(), error["errors"].as_array().map(Vec::len)), (Some("invalid_fields"), Some(2)), "{error}");
    assert_eq!(
        (error["errors"][0]["file"].as_str(), error["errors"][0]["pointer"].is_string()),
        (Some(wrong.as_str()), true),
        "{error}"
    );
    let document: Value = serde_json::from_str(&ended.out).expect("the outcome of every file");
    assert_eq!((ended.code, document["ok"].as_bool(), document["files"][0]["ok"].as_bool()), (Some(2), Some(false), Some(false)));

    let out = folder.path().join("plan").display().to_string();
    let ended = run(&[&quick_plan(&part, &out)[..], &["--params", &params, "--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(lines(&ended.err).iter().all(|line| line["level"] == "warning" && line["remedy"].is_string()), "{}", ended.err);
    assert!(!lines(&ended.err).is_empty(), "a tolerance that the scanner cannot serve");

    let ended = run(&["plan", "--colour", "--json"]);
    assert_eq!((ended.code, lines(&ended.err)[0]["code"].as_str()), (Some(2), Some("bad_input")), "{}", ended.err);
}

#[test]
fn strict_makes_warnings_of_a_check_errors() {
    let folder = tempfile::tempdir().expect("a folder");
    let [_, _, params] = inputs(folder.path());
    let lax = run(&["check", &params]);
    assert!(lax.code == Some(0) && lax.err.contains("/regions/features/0/tolerance_mm"), "{}", lax.err);
    let strict = run(&["check", &params, "--strict"]);
    assert!(strict.code == Some(2) && strict.out.is_empty(), "{:?} {}", strict.code, strict.out);
    assert!(strict.err.starts_with("error: ") && strict.err.contains("/regions/features/0/tolerance_mm"), "{}", strict.err);
}
