//! Schemathesis against the running program: every operation, every check, up to stateful chains.

use std::path::Path;
use std::process::Command;

use crate::support::{long_asked, oracle_python};

#[test]
fn every_answer_is_as_the_document_says() {
    let Some(python) = oracle_python() else { return };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracles/schemathesis.sh");
    let mut command = Command::new(script);
    command
        .arg(env!("CARGO_BIN_EXE_vantage"))
        .args(["--max-examples", if long_asked() { "25" } else { "5" }, "--generation-deterministic"])
        .env("VANTAGE_ORACLE_PYTHON", python);
    let output = command.output().expect("it runs");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("Stateful"), "{text}");
}
