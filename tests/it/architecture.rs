//! The house rules that a compiler does not hold: which room may import which, which outside names a room may not
//! speak, and that floors 1 to 4 do no I/O, read no clock and keep no global state. Scanned over the sources; a breach
//! is named by file and line.

mod paths;
mod prose;
mod words;

use std::path::{Path as FilePath, PathBuf};
use std::sync::LazyLock;

use paths::{Path, Token, paths, tokens};

/// A room, bottom up: it may import the rooms that stand above it in this table.
struct Room {
    name: &'static str,
    /// Outside names that it may not speak.
    silent_on: &'static [&'static str],
}

/// Names of the asynchronous and HTTP world, of files, sockets, processes and of the machine's state.
const PURE: &[&str] = &[
    "axum",
    "hyper",
    "hyper_util",
    "tower",
    "tower_http",
    "tokio",
    "tokio_util",
    "futures_util",
    "sqlx",
    "tempfile",
    "config",
    "clap",
    "indicatif",
    "prometheus",
    "tracing",
    "uuid",
    "std::fs",
    "std::net",
    "std::env",
    "std::process",
    "std::io::stdin",
    "std::io::stdout",
    "std::io::stderr",
    "std::thread",
];
const WIRE: &[&str] = &["axum", "hyper", "tokio", "sqlx", "std::fs", "std::net"];
const HTTP_ONLY: &[&str] = &["axum", "utoipa_axum", "utoipa_swagger_ui_vendored", "zip", "tower_http"];

const ROOMS: &[Room] = &[
    Room { name: "geometry", silent_on: PURE },
    Room { name: "cell", silent_on: PURE },
    Room { name: "planning", silent_on: PURE },
    Room { name: "program", silent_on: PURE },
    Room { name: "inspection", silent_on: WIRE },
    Room { name: "rendering", silent_on: WIRE },
    Room { name: "execution", silent_on: HTTP_ONLY },
    Room { name: "wire", silent_on: WIRE },
    Room { name: "check", silent_on: WIRE },
    Room { name: "report", silent_on: WIRE },
    Room { name: "service", silent_on: HTTP_ONLY },
    Room { name: "http", silent_on: &["sqlx"] },
    Room { name: "settings", silent_on: HTTP_ONLY },
    Room { name: "cli", silent_on: HTTP_ONLY },
];
/// Rooms that are pure.
const FLOORS_1_TO_4: usize = 4;
/// Words that read a clock, print, or hold state beyond a call.
const IMPURE_WORDS: &[&str] =
    &["Instant", "SystemTime", "static", "thread_local", "println", "eprintln", "print", "eprint", "stdin", "stdout", "stderr"];
/// The only file of `execution` that reads the date: a clock that is set must not move, delay or hasten anything.
const DATED_PLACE: &str = "execution/audit.rs";
/// The only places that name the collision library.
const PARRY_PLACES: &[&str] = &["geometry/", "cell/collision"];
/// The rooms of planning, in order: a room imports only earlier ones. Their tests may call the whole pipeline.
const PLANNING_ROOMS: &[&str] = &[
    "ids",
    "verdict",
    "random",
    "context",
    "params",
    "surface",
    "visibility",
    "candidates",
    "stations",
    "sight",
    "selection",
    "sequence",
    "plan",
    "scene",
    "setups",
    "realism",
    "problem",
    "certificate",
    "adjust",
    "missed",
    "outcome",
    "advice",
    "pipeline",
    "studies",
];
/// Names that planning's `mod.rs` lifts out of its rooms, with the room of each.
static LIFTED: LazyLock<Vec<(String, String)>> = LazyLock::new(|| lifted(include_str!("../../src/planning/mod.rs")));

/// Names with their rooms in the `use` lines of planning's `mod.rs`. `plan`, a function and a room, stands for the room.
fn lifted(source: &str) -> Vec<(String, String)> {
    let is_room = |name: &str| PLANNING_ROOMS.contains(&name);
    let named = paths(&tokens(source)).into_iter().filter_map(|path| match path.segments.as_slice() {
        [room, name] if is_room(room) && !is_room(name) => Some((name.clone(), room.clone())),
        _ => None,
    });
    named.collect()
}

/// Breaches in `source`, which lies at `file` below `src/`.
fn breaches(file: &str, source: &str) -> Vec<String> {
    let module = module_of(file);
    let Some(room) = ROOMS.iter().position(|room| module.first().is_some_and(|first| first == room.name)) else {
        return Vec::new();
    };
    let tokens = tokens(source);
    let named = paths(&tokens);
    let mut found: Vec<(usize, String)> = named
        .iter()
        .filter_map(|path| import_breach(room, &module, path).map(|what| (path.line, what)))
        .chain(named.iter().filter_map(|path| outside_breach(room, file, path).map(|what| (path.line, what))))
        .collect();
    if room < FLOORS_1_TO_4 && !is_test(file) {
        found.extend(tokens.iter().filter_map(|(line, token)| word_breach(token).map(|what| (*line, what))));
    }
    found.sort();
    found.dedup();
    found.into_iter().map(|(line, what)| format!("src/{file}:{line}: {what}")).collect()
}

/// `cell/scanner/device.rs` → cell, scanner, device; `cell/mod.rs` → cell.
fn module_of(file: &str) -> Vec<String> {
    let stem = file.trim_end_matches(".rs").trim_end_matches("/mod");
    stem.split('/').map(str::to_owned).collect()
}

fn is_test(file: &str) -> bool {
    file.ends_with("/tests.rs") || file.contains("/tests/") || file == "inspection/rehearsal.rs"
}

/// The path from the crate's root, if it leads into the crate.
fn within_crate(module: &[String], path: &Path) -> Option<Vec<String>> {
    let supers = path.segments.iter().take_while(|segment| *segment == "super").count();
    match path.segments[0].as_str() {
        "crate" => Some(path.segments[1..].to_vec()),
        "super" => Some([&module[..module.len().saturating_sub(supers)], &path.segments[supers..]].concat()),
        _ => None,
    }
}

fn import_breach(room: usize, module: &[String], path: &Path) -> Option<String> {
    let target = within_crate(module, path)?;
    let imported = ROOMS.iter().position(|other| target.first().is_some_and(|first| first == other.name))?;
    if imported > room {
        return Some(format!("{} may not import {}", ROOMS[room].name, ROOMS[imported].name));
    }
    if ROOMS[room].name != "planning" || imported != room || module.last().is_some_and(|last| last == "tests") {
        return None;
    }
    let (from, to) = (planning_room(module)?, planning_room(&target)?);
    (to > from).then(|| format!("{} may not import the later {}", PLANNING_ROOMS[from], PLANNING_ROOMS[to]))
}

/// Place of a planning path's room in [`PLANNING_ROOMS`].
fn planning_room(path: &[String]) -> Option<usize> {
    let name = path.get(1)?;
    let room = LIFTED.iter().find(|(lifted, _)| lifted == name).map_or(name.as_str(), |(_, room)| room.as_str());
    PLANNING_ROOMS.iter().position(|known| *known == room)
}

fn outside_breach(room: usize, file: &str, path: &Path) -> Option<String> {
    // A single word is a name of the file's own: a field `config`, a variable `tower`.
    if path.segments.len() < 2 {
        return None;
    }
    let written = path.segments.join("::") + "::";
    if path.segments[0].starts_with("parry") && !PARRY_PLACES.iter().any(|place| file.starts_with(place)) {
        return Some("parry is named in geometry and cell/collision only".to_owned());
    }
    if ROOMS[room].name == "execution" && written.starts_with("std::time::SystemTime::") && file != DATED_PLACE {
        return Some(format!("execution reads the date in {DATED_PLACE} only"));
    }
    let named = ROOMS[room].silent_on.iter().find(|name| written.starts_with(&format!("{name}::")))?;
    (!is_test(file)).then(|| format!("{} may not name {name}", ROOMS[room].name, name = named))
}

fn word_breach(token: &Token) -> Option<String> {
    let Token::Word(word) = token else { return None };
    IMPURE_WORDS.contains(&word.as_str()).then(|| format!("floors 1 to 4 do without {word}"))
}

/// Every Rust file below `folder`.
pub(crate) fn sources(folder: &FilePath) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("the sources are readable");
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.expect("the sources are readable").path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn every_source_keeps_the_rules_of_the_house() {
    let root = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files = sources(&root);
    assert!(files.len() > 20, "the scan must see the sources: {}", files.len());
    let found: Vec<String> = files
        .iter()
        .flat_map(|path| {
            let file = path.strip_prefix(&root).expect("below src").to_str().expect("an ASCII name").to_owned();
            breaches(&file, &std::fs::read_to_string(path).expect("the sources are readable"))
        })
        .collect();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn every_folder_is_a_known_room() {
    let root = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for entry in std::fs::read_dir(root).expect("the sources are readable") {
        let entry = entry.expect("the sources are readable");
        let name = entry.file_name().into_string().expect("an ASCII name");
        if entry.path().is_dir() {
            assert!(ROOMS.iter().any(|room| room.name == name), "src/{name} has no row in the table");
        } else {
            assert!(
                ["ARCHITECTURE.md", "METHOD.md", "Cargo.toml", "core.rs", "lib.rs", "main.rs", "testing.rs"]
                    .contains(&name.as_str()),
                "src/{name} lies in no room"
            );
        }
    }
}

/// A file of planning that stands in no row would escape the law.
#[test]
fn every_room_of_planning_has_a_row() {
    let root = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("src/planning");
    let mut found: Vec<String> = Vec::new();
    for path in sources(&root) {
        let file = path.strip_prefix(&root).expect("below planning").to_str().expect("an ASCII name").to_owned();
        found.extend(file.split('/').next().map(|name| name.trim_end_matches(".rs").to_owned()));
    }
    found.dedup();
    found.retain(|name| !["mod", "method"].contains(&name.as_str()));
    let mut rows: Vec<&str> = PLANNING_ROOMS.to_vec();
    rows.sort_unstable();
    assert_eq!(found, rows);
}

#[test]
fn thin_binary_stays_thin() {
    let main = std::fs::read_to_string(FilePath::new(env!("CARGO_MANIFEST_DIR")).join("src/main.rs")).expect("main.rs");
    assert!(main.lines().count() <= 60, "main.rs parses arguments and hands over");
}

/// The scanner itself: what it must find.
#[test]
fn breaches_are_found_and_named_by_line() {
    let lines = |file: &str, source: &str| breaches(file, source);
    assert_eq!(
        lines("cell/robot.rs", "use crate::geometry::Pose;\nuse crate::planning::plan::Plan;\n"),
        ["src/cell/robot.rs:2: cell may not import planning"]
    );
    assert_eq!(
        lines("wire/plan.rs", "use crate::{\n    cell::Scanner,\n    service::{jobs, store as kept},\n};"),
        ["src/wire/plan.rs:3: wire may not import service"]
    );
    assert_eq!(lines("cell/scanner/device.rs", "fn f() { super::super::super::http::serve() }").len(), 1);
    assert_eq!(lines("cell/mod.rs", "use super::wire::plan;").len(), 1);
    assert_eq!(
        lines("cli/serve.rs", "\n\nasync fn f() { axum::serve(a, b).await }"),
        ["src/cli/serve.rs:3: cli may not name axum"]
    );
    assert_eq!(lines("planning/surface.rs", "use std::{fmt, fs};"), ["src/planning/surface.rs:1: planning may not name std::fs"]);
    assert_eq!(
        lines("planning/pipeline.rs", "let t = Instant::now();"),
        ["src/planning/pipeline.rs:1: floors 1 to 4 do without Instant"]
    );
    assert_eq!(lines("execution/session/watcher.rs", "use std::time::{Duration, SystemTime};").len(), 1);
    assert_eq!(lines("geometry/mesh.rs", "static CACHE: Mutex<u8> = Mutex::new(0);").len(), 1);
    assert_eq!(lines("program/compile.rs", "println!(\"done\");").len(), 1);
    assert_eq!(lines("planning/visibility/rays.rs", "use parry3d::query::Ray;").len(), 1);
    assert_eq!(lines("cell/kinematics/opw.rs", "use parry3d::math::Vector;").len(), 1);
    assert_eq!(
        lines("planning/candidates/mod.rs", "use super::selection::Choice;"),
        ["src/planning/candidates/mod.rs:1: candidates may not import the later selection"]
    );
    assert_eq!(lines("planning/surface/mod.rs", "use crate::planning::PlanInput;").len(), 1, "a lifted name");
    for (name, room) in
        [("ConcaveZone", "realism"), ("tips_over", "scene"), ("SightLine", "visibility"), ("Tabulated", "pipeline")]
    {
        assert!(LIFTED.contains(&(name.to_owned(), room.to_owned())), "{name} of {room}");
    }
    assert_eq!(
        lines("planning/sight.rs", "use crate::planning::ConcaveZone;"),
        ["src/planning/sight.rs:1: sight may not import the later realism"]
    );
}

/// The scanner itself: what it must leave alone.
#[test]
fn what_only_looks_like_a_breach_is_none() {
    for (file, source) in [
        ("cell/robot.rs", "// crate::planning\n/* tokio::spawn /* nested */ axum::serve */ use crate::geometry::Pose;"),
        ("cell/robot.rs", "let text = \"std::fs::read \\\" println\"; let raw = r#\"tokio::x \" static\"#; let c = '\"';"),
        ("planning/plan.rs", "fn name(&self) -> &'static str { \"static\" }"),
        ("planning/params.rs", "self.config.tower.static_mm"),
        ("planning/visibility/view.rs", "use super::super::surface::Surface; use crate::planning::params::Engine;"),
        ("planning/pipeline.rs", "use super::{candidates, missed, selection::Selection};"),
        ("planning/setups/tests.rs", "use crate::planning::plan;"),
        ("cell/collision/mod.rs", "use parry3d::query;"),
        ("geometry/ray_scene.rs", "use parry3d::partitioning::Bvh;"),
        ("geometry/mesh/tests.rs", "let bytes = std::fs::read(path); eprintln!(\"skipped\");"),
        ("http/router.rs", "use axum::Router; use crate::service::App;"),
        ("execution/session.rs", "tokio::spawn(f);"),
    ] {
        assert_eq!(breaches(file, source), [] as [String; 0], "{source}");
    }
}

#[test]
fn use_trees_are_written_out() {
    let written: Vec<String> =
        paths(&tokens("use a::{b::{c, d as e}, self, f::*};")).into_iter().map(|path| path.segments.join("::")).collect();
    assert_eq!(written, ["use", "a::b::c", "a::b::d", "a::self", "a::f"]);
}
