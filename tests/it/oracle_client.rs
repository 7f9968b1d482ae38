//! Clients that ordinary generators make of `api/openapi.json`: openapi-python-client for Python, openapi-typescript for
//! TypeScript. Nothing is left out, every closed list is an enum, type checkers find nothing, and both plan a part on a running
//! server.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::server::process::Server;
use crate::support::{oracle_node, oracle_python};

/// Lists that were published as any text.
const CLOSED_LISTS: [&str; 12] = [
    "DeviceName",
    "EventCode",
    "FaceMeaning",
    "FailureCode",
    "HealthStatus",
    "MeshNoteCode",
    "MeshUnit",
    "PlanSchema",
    "Posture",
    "ProblemCode",
    "ReadinessSubject",
    "Stage",
];

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

/// Text that a program prints in `folder`; it must end well.
fn printed(program: &Path, folder: &Path, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).current_dir(folder).output().expect("it runs");
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{} {arguments:?}: {text}", program.display());
    text
}

/// The document that is committed.
fn document() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("api/openapi.json")
}

fn oracle(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracles").join(name)
}

/// Makes the Python client in `folder`, and returns what the generator said.
fn generate_python(python: &Path, folder: &Path) -> String {
    // Nothing is run over what it writes.
    std::fs::write(folder.join("config.json"), r#"{"post_hooks": []}"#).expect("written");
    let arguments = ["-m", "openapi_python_client", "generate", "--meta", "none", "--config", "config.json"];
    let api = document();
    printed(python, folder, &[&arguments[..], &["--output-path", "client", "--path", api.to_str().expect("text")]].concat())
}

/// The line of JSON that a client printed about the part that it planned, held against the server.
#[track_caller]
fn assert_planned(server: &Server, line: &str) -> Value {
    let told: Value = serde_json::from_str(line.trim()).unwrap_or_else(|error| panic!("{error}: {line}"));
    let id = told["job"].as_str().expect("an id");
    let mut answer = ureq::get(server.url(&format!("/api/v1/jobs/{id}"))).call().expect("the job");
    let job: Value = serde_json::from_str(&answer.body_mut().read_to_string().expect("text")).expect("JSON");
    assert_eq!(
        (&job["state"], &job["part_number"], &job["serial"]),
        (&json!("succeeded"), &json!("PN-1"), &json!("S-1")),
        "{job}"
    );
    for plan in [&told["plan_sha256"], &told["job_plan_sha256"]] {
        assert_eq!(*plan, job["plan_sha256"], "{told}");
    }
    assert!(told["viewpoints"].as_u64().is_some_and(|count| count > 0), "{told}");
    assert!(told["steps"].as_u64().is_some_and(|count| count > 2), "{told}");
    assert!(told["report"].as_str().is_some_and(|text| text.eq_ignore_ascii_case("<!doctype html>")), "{told}");
    assert_eq!((&told["preview"], &told["listed"]), (&json!("glTF"), &json!([id])), "{told}");
    assert_eq!(told["sparse"], json!([["id", "state"]]), "{told}");
    assert_eq!(told["refused"], json!(["invalid_fields", "/cell"]), "{told}");
    told
}

#[test]
fn a_generated_python_client_lacks_nothing_and_has_enums_for_closed_lists() {
    let Some(python) = oracle_python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let told = generate_python(&python, folder.path());
    assert!(!told.to_lowercase().contains("warning") && !told.contains("Unable"), "{told}");

    let document: Value = serde_json::from_slice(&std::fs::read(document()).expect("the document")).expect("JSON");
    let schemas = document["components"]["schemas"].as_object().expect("schemas");
    let lists: Vec<&String> = schemas.iter().filter(|(_, schema)| schema["enum"].is_array()).map(|(name, _)| name).collect();
    assert!(lists.len() > 20, "{lists:?}");
    for name in CLOSED_LISTS {
        assert!(lists.iter().any(|list| *list == name), "{name} lists no values");
    }
    for name in lists {
        let path = folder.path().join("client/models").join(module_of(name) + ".py");
        let source = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(source.contains("Enum"), "{name} is no enum:\n{source}");
    }
    // A function for every operation.
    for operation in
        document["paths"].as_object().expect("paths").values().flat_map(|item| item.as_object().expect("operations").values())
    {
        let (tag, id) = (operation["tags"][0].as_str().expect("a tag"), operation["operationId"].as_str().expect("an id"));
        let path = folder.path().join("client/api").join(tag).join(format!("{id}.py"));
        let source = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(source.contains("def sync_detailed("), "{source}");
    }
    let ask = "from client.models import CandidateParams, JobSort, JobState, StopReason\n\
               print(CandidateParams().step_small_deg, JobState('queued').name, StopReason('target').name, JobSort('-ended_at').name)";
    assert_eq!(printed(&python, folder.path(), &["-c", ask]).trim(), "30.0 QUEUED TARGET ENDED_AT_DESCENDING");
}

#[test]
fn a_generated_python_client_is_well_typed_and_plans_a_part() {
    let Some(python) = oracle_python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    generate_python(&python, folder.path());
    std::fs::copy(oracle("client_plan.py"), folder.path().join("client_plan.py")).expect("copied");
    // What a user writes is held to more than what the generator wrote.
    let rules = json!({"include": ["client", "client_plan.py"], "typeCheckingMode": "standard", "strict": ["client_plan.py"]});
    std::fs::write(folder.path().join("pyrightconfig.json"), rules.to_string()).expect("written");
    let interpreter = python.to_str().expect("text");
    let checked = printed(&python, folder.path(), &["-m", "basedpyright", "--pythonpath", interpreter]);
    assert!(checked.contains("0 errors, 0 warnings"), "{checked}");

    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let part = folder.path().join("part.stl");
    std::fs::write(&part, vantage::wire::example::MESH).expect("written");
    let line = printed(&python, folder.path(), &["client_plan.py", &server.url(""), part.to_str().expect("text")]);
    let told = assert_planned(&server, &line);
    assert_eq!((&told["original"], &told["deleted"]), (&json!(true), &json!(2)), "{told}");
    // The table and the robot's own language are there, whichever others are.
    let texts = told["texts"].as_object().expect("texts");
    assert!(texts["csv"].as_str().is_some_and(|text| text.starts_with("step,")), "{told}");
    assert!(texts["hans"].as_str().is_some_and(|text| text.contains("Vantage")), "{told}");
    assert!(texts.values().all(|text| text.as_str().is_some_and(|text| !text.is_empty())), "{told}");
}

#[test]
fn a_generated_typescript_client_is_well_typed_and_plans_a_part() {
    let Some(modules) = oracle_node() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    for file in ["package.json", "tsconfig.json", "client_plan.ts"] {
        std::fs::copy(oracle("typescript").join(file), folder.path().join(file)).expect("copied");
    }
    std::os::unix::fs::symlink(&modules, folder.path().join("node_modules")).expect("linked");
    let (node, api) = (Path::new("node"), document());
    // In requests a field with a default may be left out.
    let generate = ["node_modules/openapi-typescript/bin/cli.js", api.to_str().expect("text"), "--default-non-nullable=false"];
    printed(node, folder.path(), &[&generate[..], &["--output", "schema.ts"]].concat());
    // Strict, and nothing is emitted unless there is no error.
    printed(node, folder.path(), &["node_modules/typescript/bin/tsc", "--project", "."]);

    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let part = folder.path().join("part.stl");
    std::fs::write(&part, vantage::wire::example::MESH).expect("written");
    let line = printed(node, folder.path(), &["built/client_plan.js", &server.url(""), part.to_str().expect("text")]);
    let told = assert_planned(&server, &line);
    assert!(told["table"].as_str().is_some_and(|text| text.starts_with("step,")), "{told}");
}
