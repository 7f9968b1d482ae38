//! Needs of a test that are not in the repository. Where one is absent the test says so on standard error, past the test
//! harness's capture, and ends; under `VANTAGE_TESTS=all`, which `tests/all` sets, an absent oracle or browser fails the test
//! instead.

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A file of the public data set, which lies beside the repository where there is one. With the folder there, a file
/// that is missing in it is a failure.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data"));
    if !folder.is_dir() {
        say(&format!("skipped: needs {name} of the public data set, whose folder ../shared/data is absent"));
        return None;
    }
    let file = folder.join(name);
    assert!(file.exists(), "{} is missing in the data set", file.display());
    Some(file)
}

/// The interpreter in which `tests/oracles/requirements.txt` is installed.
pub(crate) fn oracle_python() -> Option<PathBuf> {
    installed("VANTAGE_ORACLE_PYTHON", "an independent oracle")
}

/// The folder `node_modules` with what `tests/oracles/typescript/package-lock.json` names.
pub(crate) fn oracle_node() -> Option<PathBuf> {
    let modules = installed("VANTAGE_ORACLE_NODE", "the packages of a TypeScript client")?;
    program("node").then_some(modules)
}

/// The folder `node_modules` with what `tests/oracles/dashboard/package-lock.json` names.
pub(crate) fn dashboard_node() -> Option<PathBuf> {
    let modules = installed("VANTAGE_ORACLE_DASHBOARD", "the driver of a browser")?;
    program("node").then_some(modules)
}

/// The folder `node_modules` with what `static/package-lock.json` names.
pub(crate) fn dashboard_packages() -> Option<PathBuf> {
    let modules = installed("VANTAGE_DASHBOARD_PACKAGES", "the packages that the dashboard is built from")?;
    program("node").then_some(modules)
}

/// The program of `tests/oracles/hans`.
pub(crate) fn oracle_hans() -> Option<PathBuf> {
    installed("VANTAGE_ORACLE_HANS", "a client of Han's controllers")
}

/// The browser for the pages.
pub(crate) fn chromium() -> Option<PathBuf> {
    installed("VANTAGE_CHROMIUM", "a Chromium")
}

/// Returns true if this is `tests/all`, which leaves no test out.
pub(crate) fn all_asked() -> bool {
    std::env::var_os("VANTAGE_TESTS").is_some_and(|tests| tests == "all" || tests == "long")
}

/// Returns true if the longest rows are asked for as well: `VANTAGE_TESTS=long tests/all`.
pub(crate) fn long_asked() -> bool {
    std::env::var_os("VANTAGE_TESTS").is_some_and(|tests| tests == "long")
}

/// Returns true if the program was built with the points at which a test may kill or hang it.
pub(crate) fn failpoints() -> bool {
    let built_in = cfg!(any(debug_assertions, feature = "failpoints"));
    if !built_in {
        say("skipped: needs failpoints, which this build is without (debug assertions, or the feature failpoints)");
    }
    built_in
}

fn installed(variable: &str, what: &str) -> Option<PathBuf> {
    if let Some(program) = std::env::var_os(variable) {
        return Some(PathBuf::from(program));
    }
    assert!(!all_asked(), "VANTAGE_TESTS=all, but {variable} does not name {what}; run tests/all");
    say(&format!("skipped: needs {what}, installed and run by tests/all ({variable} is not set)"));
    None
}

/// Past the capture of `print!`, so that a skipped test cannot pass for one that ran.
fn say(text: &str) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let _ = writeln!(std::io::stderr(), "{test}: {text}");
}

/// Returns true if a program is on the path.
pub(crate) fn program(name: &str) -> bool {
    let runs = std::process::Command::new(name).arg("--version").output().is_ok();
    assert!(runs || !all_asked(), "VANTAGE_TESTS=all, but {name} is not installed; run tests/all");
    if !runs {
        say(&format!("skipped: needs {name}, installed by tests/all"));
    }
    runs
}
