//! A child process that is asked in lines and answers in lines.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// The lines that a script of `tests/oracles` writes for `input`.
pub(crate) fn lines_of(python: &Path, script: &str, arguments: &[&str], input: String) -> Vec<String> {
    let mut child = Command::new(python)
        .arg(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/oracles")).join(script))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the oracle starts");
    let mut stdin = child.stdin.take().expect("piped");
    let writer = std::thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().expect("the oracle ends");
    assert!(output.status.success(), "{script} failed");
    writer.join().expect("writer").expect("the oracle reads");
    String::from_utf8(output.stdout).expect("UTF-8").lines().map(str::to_owned).collect()
}
