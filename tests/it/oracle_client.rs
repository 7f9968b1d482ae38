//! A client for Python that openapi-python-client makes of `api/openapi.json`: no schema is left out, every closed list is an
//! enum, and parameters have their defaults.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::support::oracle_python;

/// Module of a schema: `JobState` is in `job_state`.
fn module_of(schema: &str) -> String {
    let mut module = String::new();
    for letter in schema.chars() {
        if letter.is_uppercase() && !module.is_empty() {
            module.push('_');
        }
        module.extend(letter.to_lowercase());
    }
    module
}

/// Text that a Python program prints in `folder`.
fn printed(python: &Path, folder: &Path, arguments: &[&str]) -> String {
    let output = Command::new(python).args(arguments).current_dir(folder).output().expect("python runs");
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{text}");
    text
}

#[test]
fn a_generated_client_has_every_schema_and_enums_for_closed_lists() {
    let Some(python) = oracle_python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let api = Path::new(env!("CARGO_MANIFEST_DIR")).join("api/openapi.json");
    // Nothing is run over what it writes.
    std::fs::write(folder.path().join("config.json"), r#"{"post_hooks": []}"#).expect("written");
    let arguments = ["-m", "openapi_python_client", "generate", "--meta", "none", "--config", "config.json"];
    let api_text = api.to_str().expect("text");
    let told = printed(&python, folder.path(), &[&arguments[..], &["--output-path", "client", "--path", api_text]].concat());
    assert!(!told.contains("Unable to process schema") && !told.contains("will not be generated"), "{told}");

    let document: Value = serde_json::from_slice(&std::fs::read(&api).expect("the document")).expect("JSON");
    let schemas = document["components"]["schemas"].as_object().expect("schemas");
    let lists: Vec<&String> = schemas.iter().filter(|(_, schema)| schema["enum"].is_array()).map(|(name, _)| name).collect();
    assert!(lists.len() > 20, "{lists:?}");
    for name in lists {
        let path = folder.path().join("client/models").join(module_of(name) + ".py");
        let source = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(source.contains("Enum"), "{name} is no enum:\n{source}");
    }
    let ask = "from client.models import CandidateParams, JobState, StopReason\n\
               print(CandidateParams().step_small_deg, JobState('queued').name, StopReason('target').name)";
    assert_eq!(printed(&python, folder.path(), &["-c", ask]).trim(), "30.0 QUEUED TARGET");
}
