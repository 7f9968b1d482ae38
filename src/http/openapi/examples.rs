//! Examples that are accepted as they are: the part of the upload has an id that all others can name.

use serde_json::{Value, json};
use utoipa::openapi::path::{Operation, Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::{OpenApi, PathItem, RefOr};

use crate::cell::{Presets, SpecLibrary as _};
use crate::wire::{MeshId, example};

/// Name of the example specifications.
const NAME: &str = "mine";

/// Id of a job that does not exist: what a run is of is known only once a job was planned.
const NOBODY: &str = "01a1f77c-78a1-7554-855a-a9513c22aa2b";

/// A collection of specifications, a preset of it, and that preset as JSON under [`NAME`].
type SpecExample = (&'static str, &'static str, Option<Value>);

/// Adds the examples of request bodies, and of parameters whose values the routes' attributes do not know.
pub(super) fn add(openapi: &mut OpenApi) {
    for (collection, preset, spec) in specs() {
        let Some(item) = openapi.paths.paths.get_mut(&format!("/api/v1/{collection}/{{name}}")) else { continue };
        set_body(item.put.as_mut(), spec);
        set_parameter(item.get.as_mut(), "name", preset.into());
    }
    for (path, item) in &mut openapi.paths.paths {
        if path.starts_with("/api/v1/meshes/{id}") {
            let mesh = json!(MeshId::EXAMPLE);
            set_parameter(item.get.as_mut(), "id", mesh.clone());
            set_parameter(item.delete.as_mut(), "id", mesh);
        }
        set_body_of(path, item);
    }
    set_parameter(openapi.paths.paths.get_mut("/api/v1/runs").and_then(|item| item.get.as_mut()), "job", json!(NOBODY));
    set_parameter(openapi.paths.paths.get_mut("/api/v1/jobs").and_then(|item| item.get.as_mut()), "mesh", json!(MeshId::EXAMPLE));
}

fn specs() -> [SpecExample; 4] {
    let (scanner, robot, turntable, cell) = ("transcan-c-nominal", "ur5e", "minas-a6-500", "e05-transcan");
    [
        ("scanners", scanner, named(Presets.scanner(scanner))),
        ("robots", robot, named(Presets.robot(robot))),
        ("turntables", turntable, named(Presets.turntable(turntable))),
        ("cells", cell, named(Presets.cell(cell))),
    ]
}

/// The specification as JSON, under the name of the examples.
fn named<T: serde::Serialize, E>(spec: Result<T, E>) -> Option<Value> {
    let mut spec = serde_json::to_value(spec.ok()?).ok()?;
    spec["name"] = NAME.into();
    Some(spec)
}

/// Sets the request bodies of a path that are no specifications.
fn set_body_of(path: &str, item: &mut PathItem) {
    let job = json!({
        "mesh_id": MeshId::EXAMPLE, "cell": "e05-transcan", "labels": {"line": "3"}, "part_number": "PN-4711", "serial": "S-0001"
    });
    let viewpoints_alone = json!({"mesh_id": MeshId::EXAMPLE, "cell": "none", "scanner": "transcan-c", "labels": {"line": "3"}});
    match path {
        "/api/v1/meshes" => set_body(item.post.as_mut(), Some(example::MESH.into())),
        "/api/v1/jobs" => set_body(item.post.as_mut(), Some(job)),
        "/api/v1/jobs/batch" => set_body(item.post.as_mut(), Some(json!({"jobs": [job, viewpoints_alone]}))),
        "/api/v1/jobs/delete" => {
            set_body(item.post.as_mut(), Some(json!({"label": "line=3", "created_before": "2026-01-01T00:00:00Z"})));
        }
        "/api/v1/jobs/{id}" => set_body(item.patch.as_mut(), Some(json!({"priority": 10}))),
        "/api/v1/jobs/{id}/labels" => set_body(item.put.as_mut(), Some(json!({"labels": {"line": "3", "shift": "early"}}))),
        "/api/v1/runs" => {
            set_body(item.post.as_mut(), Some(json!({"job_id": NOBODY, "mode": "simulate", "speed_override": 0.5})))
        }
        "/api/v1/runs/{id}/arm" => set_body(item.post.as_mut(), Some(json!({"operator": "A. Operator", "cell": "e05-transcan"}))),
        "/api/v1/runs/{id}/override" => set_body(item.post.as_mut(), Some(json!({"speed_override": 0.5}))),
        "/api/v1/runs/{id}/located" => {
            let pose = json!({"translation_mm": [3.0, -2.0, 0.0], "rpy_deg": [0.0, 0.0, 1.5]});
            set_body(item.post.as_mut(), Some(json!({"table_from_part": pose})));
        }
        "/api/v1/jobs/{id}/scans" => set_body(item.post.as_mut(), Some(example::SCAN.into())),
        "/api/v1/jobs/{id}/inspections" => {
            set_body(item.post.as_mut(), Some(json!({"params": {"align": {"method": "best_fit"}}})));
        }
        "/api/v1/inspections/{id}/rescans" => set_body(item.post.as_mut(), Some(json!({"params": {"max_views": 4}}))),
        "/api/v1/calibrations" => set_body(item.post.as_mut(), Some(example::calibration())),
        "/api/v1/leases" => set_body(item.post.as_mut(), Some(json!({"cell": "e05-transcan", "holder": "line 3"}))),
        "/api/v1/check" => set_body(item.post.as_mut(), Some(json!({"document": {"scan": {"brightness": 5}}}))),
        _ => {}
    }
}

/// Sets the example of an operation's request body.
fn set_body(operation: Option<&mut Operation>, example: Option<Value>) {
    if let Some(RefOr::T(body)) = operation.and_then(|operation| operation.request_body.as_mut()) {
        for content in body.content.values_mut() {
            if let RefOr::T(content) = content {
                content.example.clone_from(&example);
            }
        }
    }
}

/// Sets the example of an operation's path or query parameter.
fn set_parameter(operation: Option<&mut Operation>, name: &str, example: Value) {
    let parameters = operation.into_iter().flat_map(|operation| operation.parameters.iter_mut().flatten());
    let owned = parameters.filter_map(|parameter| match parameter {
        RefOr::T(parameter) => Some(parameter),
        RefOr::Ref(_) => None,
    });
    let is_it = |parameter: &&mut Parameter| parameter.name == name && parameter.parameter_in != ParameterIn::Header;
    for parameter in owned.filter(is_it) {
        *parameter = ParameterBuilder::from(parameter.clone()).example(Some(example.clone())).build();
    }
}
