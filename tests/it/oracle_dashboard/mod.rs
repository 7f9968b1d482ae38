//! The dashboard in a real browser, by the scripts of `tests/oracles/dashboard`: an operator's way from a mesh to a report, what
//! is drawn, accessibility, dropped connections; and its build, which gives the bytes that are committed.

mod prefix_proxy;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::server::process::Server;
use crate::support::{chromium, dashboard_node, dashboard_packages, oracle_node, shared};

fn sources(folder: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)
}

/// Time after which a script is ended, seconds: ten times what the longest takes alone, since other tests run beside it.
const SCRIPT_SECS: &str = "2700";

/// The line of JSON that a script prints at its end; it must end well, or the words that it ends with are the last of the panic.
fn figures(script: &str, modules: &Path, browser: &Path, arguments: &[&str]) -> Value {
    let folder = tempfile::tempdir().expect("a folder");
    for file in ["browser.mjs", "walk.mjs", "events.mjs", "signin.mjs", "pace.mjs"] {
        std::fs::copy(sources("tests/oracles/dashboard").join(file), folder.path().join(file)).expect("copied");
    }
    std::os::unix::fs::symlink(modules, folder.path().join("node_modules")).expect("linked");
    let mut command = Command::new("timeout");
    // Told to end, it says where it is; a minute later it is killed.
    command
        .args(["-k", "60", SCRIPT_SECS, "node"])
        .arg(folder.path().join(script))
        .args(arguments)
        .env("VANTAGE_CHROMIUM", browser);
    let output = command.stdin(Stdio::null()).output().expect("it runs");
    let (said, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{script}, {}:\n{said}\n{errors}", output.status);
    serde_json::from_str(said.lines().last().unwrap_or_default()).unwrap_or_else(|error| panic!("{error}: {said}"))
}

#[test]
fn an_operator_goes_from_a_mesh_to_a_report() {
    walk("", &[("meshes/gearbox_output_housing_16k.stl", "mm"), ("meshes/featuretype_3476_inch.stl", "inch")]);
}

#[test]
fn an_operator_does_so_below_a_path_that_a_proxy_strips() {
    walk(prefix_proxy::PREFIX, &[("meshes/piboy_rear_case_15k_binary.stl", "mm")]);
}

/// Walks through the dashboard with each part. Pictures stay in `target/dashboard`, to be looked at.
fn walk(prefix: &str, parts: &[(&str, &str)]) {
    let (Some(browser), Some(modules)) = (chromium(), dashboard_node()) else { return };
    let parts: Option<Vec<Value>> =
        parts.iter().map(|(file, unit)| shared(file).map(|file| json!({"file": file, "unit": unit}))).collect();
    let Some(parts) = parts else { return };
    let data = tempfile::tempdir().expect("a folder");
    // The browser's renewals of a lease may be late by seconds on a busy machine.
    let server = Server::start(data.path(), &[("VANTAGE_EXECUTION__LEASE_SECS", "30")]);
    let address = if prefix.is_empty() { server.address } else { prefix_proxy::start(server.address) };
    let pictures = sources("target/dashboard");
    std::fs::create_dir_all(&pictures).expect("a folder");
    let program = env!("CARGO_BIN_EXE_vantage").to_owned();
    let arguments =
        [format!("http://{address}{prefix}/"), pictures.display().to_string(), Value::from(parts.clone()).to_string(), program];
    let reached = figures("walk.mjs", &modules, &browser, &arguments.each_ref().map(String::as_str));
    println!("{reached}");
    assert_eq!(reached["parts"].as_array().map(Vec::len), Some(parts.len()), "{reached}");
    for part in reached["parts"].as_array().into_iter().flatten() {
        assert!(part["agreement"].as_f64().is_some_and(|share| share > 0.97), "{part}");
        assert!(part["off_mm"].as_f64().is_some_and(|mm| mm < 0.1), "{part}");
        // The planner halves to 0.05 mm; the page draws a preview.
        assert!(part["clearance_off_mm"].as_f64().is_some_and(|mm| mm < 0.2), "{part}");
        assert!(part["poses"].as_u64() >= Some(2), "{part}");
    }
    // 19 of 19 elevations and 351 directions (config/cells/REACH.md, foot 400 mm, table -200 mm, part 300 mm).
    let directions = reached["reach"]["directions"].as_i64().unwrap_or_default();
    assert!(reached["reach"]["elevations"] == 19 && (directions - 351).abs() <= 4, "{reached}");
    // Further views measure what the first scans lack.
    let [before, after] = ["before", "after"].map(|round| reached["inspection"][round].as_f64().unwrap_or_default());
    assert!(before > 0.1 && after > before + 0.01, "{reached}");
    assert!(reached["rig_off_mm"].as_f64().is_some_and(|mm| mm < 0.001), "{reached}");
    // Accessibility and layout are looked at without the prefix.
    assert!(!prefix.is_empty() || reached["axe"].as_u64().is_some_and(|pages| pages > 6), "{reached}");
    assert!(reached["requests"].as_u64() > Some(20), "{reached}");
}

#[test]
fn no_event_is_lost_or_doubled_while_connections_drop() {
    const DROPS: u64 = 100;
    let (Some(browser), Some(modules)) = (chromium(), dashboard_node()) else { return };
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let reached = figures("events.mjs", &modules, &browser, &[&server.url("/"), &DROPS.to_string()]);
    println!("{reached}");
    assert!(reached["drops"].as_u64() >= Some(DROPS) && reached["events"].as_u64() > Some(DROPS / 2), "{reached}");
}

/// Time to the first view, and of a frame; printed, not held, since other tests run beside it.
#[test]
fn three_hundred_thousand_triangles_are_seen() {
    let (Some(browser), Some(modules)) = (chromium(), dashboard_node()) else { return };
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let reached = figures("pace.mjs", &modules, &browser, &[&server.url("/")]);
    println!("{reached}");
    assert!(reached["triangles"].as_u64() > Some(290_000), "{reached}");
}

#[test]
fn the_key_is_exchanged_for_a_session() {
    const KEY: &str = "0123456789abcdef-dashboard";
    let (Some(browser), Some(modules)) = (chromium(), dashboard_node()) else { return };
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__API_KEY", KEY)]);
    let reached = figures("signin.mjs", &modules, &browser, &[&server.url("/"), KEY]);
    assert_eq!(reached["cookies"], 1, "{reached}");
}

/// Files of a folder by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("the folder").flatten();
    entries
        .map(|entry| (entry.file_name().to_string_lossy().into_owned(), std::fs::read(entry.path()).expect("a file")))
        .collect()
}

#[test]
fn the_sources_of_the_dashboard_give_the_bytes_that_are_committed() {
    let Some(modules) = dashboard_packages() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("src")).expect("a folder");
    for (name, bytes) in files(&sources("static/src")) {
        std::fs::write(folder.path().join("src").join(name), bytes).expect("written");
    }
    for name in ["build.mjs", "package.json", "tsconfig.json"] {
        std::fs::copy(sources("static").join(name), folder.path().join(name)).expect("copied");
    }
    std::os::unix::fs::symlink(&modules, folder.path().join("node_modules")).expect("linked");
    for arguments in [&["build.mjs", "--out", "built"][..], &["node_modules/typescript/bin/tsc", "--noEmit"]] {
        let output = Command::new("node").args(arguments).current_dir(folder.path()).output().expect("it runs");
        let text = [output.stdout, output.stderr].concat();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&text));
    }
    let (built, committed) = (files(&folder.path().join("built")), files(&sources("static/dist")));
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&built), names(&committed), "run `npm ci && npm run build` in static/ and commit static/dist");
    for (name, bytes) in &built {
        assert!(committed[name] == *bytes, "{name} is not what the sources give: npm ci && npm run build in static/");
    }
}

/// The types of `static/src/api.ts` are written by hand: nothing held them to the document, and some lacked that a field may be
/// null.
#[test]
fn the_types_of_the_page_are_those_of_the_api_document() {
    let (Some(modules), Some(generator)) = (dashboard_packages(), oracle_node()) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("src")).expect("a folder");
    for name in ["api.ts", "text.ts"] {
        std::fs::copy(sources("static/src").join(name), at("src").join(name)).expect("copied");
    }
    std::fs::copy(sources("tests/oracles/dashboard/api_types.ts"), at("src/api_types.ts")).expect("copied");
    std::fs::copy(sources("static/tsconfig.json"), at("tsconfig.json")).expect("copied");
    std::os::unix::fs::symlink(&modules, at("node_modules")).expect("linked");
    let node = |arguments: &[&str]| {
        let output = Command::new("node").args(arguments).current_dir(folder.path()).output().expect("it runs");
        let text = [output.stdout, output.stderr].concat();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&text));
    };
    let (cli, document) = (generator.join("openapi-typescript/bin/cli.js"), sources("api/openapi.json"));
    let [cli, document] = [&cli, &document].map(|path| path.to_str().expect("text"));
    node(&[cli, document, "--output", "src/served.ts"]);
    node(&["node_modules/typescript/bin/tsc", "--noEmit"]);
}

/// Bytes that a plant's slow link has to carry, and addresses that no page may load from.
#[test]
fn the_dashboard_is_small_and_names_no_other_place() {
    use std::io::Write as _;
    let mut total = 0;
    for (name, bytes) in files(&sources("static/dist")) {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        encoder.write_all(&bytes).expect("memory");
        let gzip = encoder.finish().expect("memory").len();
        println!("{name}: {} bytes, {gzip} compressed", bytes.len());
        total += gzip;
        if name.ends_with(".html") || name.ends_with(".css") {
            let text = String::from_utf8(bytes).expect("text");
            assert!(!text.contains("http:") && !text.contains("https:") && !text.contains("url(//"), "{name}");
        }
    }
    assert!(total <= 300 * 1024, "{total} bytes");
}
