//! The OpenAPI document: its frame, schemas that only it needs, and additions that the routes' attributes cannot express. Each
//! response has one media type and one schema a status, so that generators make usable clients of it.

mod examples;
mod forms;
mod ranges;
mod variants;

use std::collections::BTreeMap;

use utoipa::openapi::link::Link;
use utoipa::openapi::path::{Operation, Parameter};
use utoipa::openapi::schema::{AdditionalProperties, AnyOfBuilder, ObjectBuilder, Schema, SchemaType, Type};
use utoipa::openapi::security::{ApiKey, ApiKeyValue, HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{ContentBuilder, OpenApi, PathItem, Ref, RefOr, ResponseBuilder, SecurityRequirement};
use utoipa::{PartialSchema, ToSchema};

use super::fields;
use super::problem::{Code, PROBLEM_JSON};
use crate::planning::context::Stage;
use crate::program::dialects::Dialect;
use crate::wire::{self, parameters};

/// Frame of the document; the routes add themselves.
#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "Vantage",
        description = "Plans automated 3D scans: from a mesh and a robot cell to viewpoints, proof of coverage, causes of missed \
                       area, collision-free motion and a robot program.\n\nNames of quantities end in their unit, such as `_mm`. \
                       Unknown fields are refused. Every response other than 2xx and 3xx is a problem (RFC 9457) with a stable \
                       `code`; its `type` is the path of a page about that code.\n\nThe examples work as they are once the \
                       example of `POST /meshes` has been sent. `Accept` or the query parameter `format` (`dialect` for \
                       programs) selects another representation of a result; each also has a route of its own. There are no \
                       webhooks: wait with `?wait=`, or follow `GET /events`. All files can be fetched in parts (`Range`, RFC \
                       9110).\n\nThe planning method is that of X. Wang, *Quality-Based Path Planning: Algorithm Development for \
                       Automated 3D Inspection Using 3D Scanners* (University of Stuttgart, Institute of Industrial Automation \
                       and Software Engineering), which descriptions call the thesis.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
        contact()
    ),
    tags(
        (name = "meshes", description = "Parts and fixtures."),
        (name = "specifications", description = "Scanners, robots, turntables and cells."),
        (name = "jobs", description = "Planning jobs."),
        (name = "results", description = "Results of a job."),
        (name = "events", description = "Live events of jobs."),
        (name = "runs", description = "Runs of programs on the controllers of a cell, or on a twin of them. Vantage is not safety-rated, and \
                                       its stop is not an emergency stop."),
        (name = "calibrations", description = "Calibration of cells from observations of a board."),
        (name = "inspections", description = "Scans of planned parts, compared with their plan."),
        (name = "server", description = "Health, metrics, storage and sessions.")
    ),
    components(schemas(
        wire::Problem,
        wire::JobEvent,
        wire::JobSort,
        wire::run::RunEventDocument,
        wire::run::RunSample,
        Code,
        ProgramDialect
    ))
)]
pub(super) struct ApiDoc;

/// Token of a page, from `next_page_token`: the last id of the previous page, a digest of the listing, and the sort key.
#[derive(ToSchema)]
#[schema(value_type = String, pattern = "^([0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}|x([0-9a-f]{2})*)\\.[0-9a-f]{16}(\\.([0-9a-f]{2})+)?$")]
#[expect(dead_code, reason = "only its schema is used; tokens are read by the store")]
pub(super) struct PageToken(String);

/// Form of a result that has but one.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
#[expect(dead_code, reason = "only its schema is used; forms are chosen by name")]
pub(super) enum JsonForm {
    Json,
}

/// Form of the losses of an inspection.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
#[expect(dead_code, reason = "only its schema is used; forms are chosen by name")]
pub(super) enum LossesForm {
    Json,
    Csv,
}

/// Form of the deviation of the surface.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
#[expect(dead_code, reason = "only its schema is used; forms are chosen by name")]
pub(super) enum DeviationForm {
    Csv,
    Ply,
}

/// Form of the report of an inspection.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
#[expect(dead_code, reason = "only its schema is used; forms are chosen by name")]
pub(super) enum ReportForm {
    Html,
    Text,
}

/// Languages of a robot program, as text; KUKA's has two files.
pub(super) struct ProgramDialect;

impl PartialSchema for ProgramDialect {
    fn schema() -> RefOr<Schema> {
        let mut names: Vec<&str> = Dialect::ALL.into_iter().flat_map(Dialect::outputs).map(|output| output.format).collect();
        names.sort_unstable();
        let about = "Language of a robot program, or `csv` for a table.";
        ObjectBuilder::new().schema_type(Type::String).description(Some(about)).enum_values(Some(names)).into()
    }
}

impl ToSchema for ProgramDialect {}

/// Binary data.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "only its schema is used")]
pub(super) struct Bytes(Vec<u8>);

/// Seconds spent in each stage, by the name of the stage.
#[derive(ToSchema)]
#[expect(dead_code, reason = "only its schema is used; the file is written by the service")]
pub(super) struct StageSeconds(BTreeMap<Stage, f64>);

/// Any existing version.
#[derive(ToSchema)]
#[expect(dead_code, reason = "only its schema is used; preconditions are read by hand")]
pub(super) enum AnyVersion {
    #[schema(rename = "*")]
    Any,
}

/// A stream of server-sent events. Its schema admits everything: generators of clients take the text as it is.
pub(super) struct EventText;

impl PartialSchema for EventText {
    fn schema() -> RefOr<Schema> {
        let about = "Server-sent events: `id`, the number of the event, for `Last-Event-ID`; `event`, an `EventKind`, or \
                     `reset`; `data`, a `JobEvent` as JSON, or an empty object for `reset`.";
        ObjectBuilder::new().schema_type(SchemaType::AnyValue).description(Some(about)).into()
    }
}

impl ToSchema for EventText {}

/// A stream of server-sent events of a run, with a schema as that of [`EventText`].
pub(super) struct RunEventText;

impl PartialSchema for RunEventText {
    fn schema() -> RefOr<Schema> {
        let about = "Server-sent events: `id`, for `Last-Event-ID`; `event`, a `RunEventKind`, `live` or `reset`; `data`, as \
                     JSON, a `RunEventDocument`, a `RunSample` for `live`, or an empty object for `reset`.";
        ObjectBuilder::new().schema_type(SchemaType::AnyValue).description(Some(about)).into()
    }
}

impl ToSchema for RunEventText {}

/// Adds what all routes share, and corrects what the derived schemas cannot express.
pub(super) fn complete(openapi: &mut OpenApi) {
    for (path, item) in &mut openapi.paths.paths {
        for operation in operations(item) {
            add_problems(operation);
            operation.parameters.iter_mut().flatten().for_each(forbid_null);
            if path.starts_with("/api/") {
                let schemes = ["key", "session"].map(|scheme| SecurityRequirement::new::<_, _, &str>(scheme, []));
                operation.security = Some([SecurityRequirement::default()].into_iter().chain(schemes).collect());
            }
        }
    }
    add_links(openapi);
    add_sparse_answers(openapi);
    forms::add(openapi);
    ranges::add(openapi);
    examples::add(openapi);
    let key = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some("The server's key, if it has one.")).build();
    let components = openapi.components.get_or_insert_default();
    components.add_security_scheme("key", SecurityScheme::Http(key));
    let about = "A browser's session. Requests that change something also need the header `X-Vantage-Session`, with any value.";
    let session = ApiKeyValue::with_description(super::auth::COOKIE_NAME, about);
    components.add_security_scheme("session", SecurityScheme::ApiKey(ApiKey::Cookie(session)));
    parameters::add_ranges(&mut components.schemas);
    list_problem_codes(&mut components.schemas);
    components.schemas.values_mut().for_each(drop_links);
    components.schemas.values_mut().for_each(describe_object_defaults);
    let combined: Vec<String> = components.schemas.values().flat_map(combined_names).collect();
    for name in combined {
        if let Some(RefOr::T(Schema::Object(object))) = components.schemas.get_mut(&name) {
            open_up(&mut object.additional_properties);
        }
    }
    variants::name_variants(&mut components.schemas);
}

/// Lists the codes of problems, which the room of the document does not know.
fn list_problem_codes(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    let Some(RefOr::T(Schema::Object(problem))) = schemas.get_mut("Problem") else { return };
    let Some(code) = problem.properties.get_mut("code") else { return };
    if let RefOr::T(Schema::Object(text)) = code {
        let mut reference = Ref::from_schema_name(Code::name());
        reference.description = text.description.take().unwrap_or_default();
        *code = reference.into();
    }
}

/// Drops links into the source from the descriptions of a schema.
fn drop_links(schema: &mut RefOr<Schema>) {
    let clean = |text: &mut Option<String>| text.iter_mut().for_each(|text| *text = parameters::without_links(text));
    match schema {
        RefOr::Ref(reference) => reference.description = parameters::without_links(&reference.description),
        RefOr::T(Schema::Object(object)) => {
            clean(&mut object.description);
            object.properties.values_mut().for_each(drop_links);
        }
        RefOr::T(Schema::Array(array)) => clean(&mut array.description),
        RefOr::T(Schema::OneOf(one_of)) => {
            clean(&mut one_of.description);
            one_of.items.iter_mut().for_each(drop_links);
        }
        RefOr::T(_) => {}
    }
}

/// Moves defaults that are objects into the description of values that may be null: generators of clients take only null there.
fn describe_object_defaults(schema: &mut RefOr<Schema>) {
    let RefOr::T(Schema::Object(object)) = schema else { return };
    for property in object.properties.values_mut() {
        let RefOr::T(Schema::OneOf(one_of)) = property else { continue };
        let default = one_of.default.take_if(|default| default.is_object() && one_of.items.iter().any(is_null));
        if let (Some(default), Some(RefOr::Ref(reference))) = (default, one_of.items.first_mut()) {
            reference.description += &format!("\n\nDefault: `{default}`.");
        }
    }
}

fn operations(item: &mut PathItem) -> impl Iterator<Item = &mut Operation> {
    [&mut item.get, &mut item.put, &mut item.post, &mut item.patch, &mut item.delete].into_iter().flatten()
}

fn add_problems(operation: &mut Operation) {
    let schema = Ref::from_schema_name("Problem");
    let content = ContentBuilder::new().schema(Some(schema)).build();
    for (status, description) in
        [("4XX", "The request was refused; `code` says why."), ("5XX", "The server cannot handle the request; `code` says why.")]
    {
        let response = ResponseBuilder::new().description(description).content(PROBLEM_JSON, content.clone()).build();
        operation.responses.responses.insert(status.to_owned(), response.into());
    }
}

/// Removes null from an optional parameter: paths, queries and headers cannot express it.
fn forbid_null(parameter: &mut RefOr<Parameter>) {
    let RefOr::T(parameter) = parameter else { return };
    match &mut parameter.schema {
        Some(RefOr::T(Schema::Object(object))) => {
            if let SchemaType::Array(types) = &mut object.schema_type {
                types.retain(|kind| *kind != Type::Null);
                if let [kind] = &types[..] {
                    object.schema_type = SchemaType::Type(kind.clone());
                }
            }
        }
        Some(RefOr::T(Schema::OneOf(one_of))) => one_of.items.retain(|item| !is_null(item)),
        _ => {}
    }
}

fn is_null(schema: &RefOr<Schema>) -> bool {
    matches!(schema, RefOr::T(Schema::Object(object)) if matches!(object.schema_type, SchemaType::Type(Type::Null)))
}

/// Names of the schemas that are parts of an `allOf`.
#[expect(clippy::wildcard_enum_match_arm, reason = "utoipa may add kinds of schemas")]
fn combined_names(schema: &RefOr<Schema>) -> Vec<String> {
    match schema {
        RefOr::T(Schema::AllOf(all_of)) => all_of.items.iter().filter_map(name_of).collect(),
        RefOr::T(Schema::OneOf(one_of)) => one_of.items.iter().flat_map(combined_names).collect(),
        _ => Vec::new(),
    }
}

fn name_of(schema: &RefOr<Schema>) -> Option<String> {
    match schema {
        RefOr::Ref(reference) => reference.ref_location.rsplit('/').next().map(str::to_owned),
        RefOr::T(_) => None,
    }
}

/// Allows additional properties: a part of an `allOf` cannot refuse those of the other parts.
fn open_up(additional: &mut Option<Box<AdditionalProperties<Schema>>>) {
    if matches!(additional.as_deref(), Some(AdditionalProperties::FreeForm(false))) {
        *additional = None;
    }
}

/// Adds the answers to requests with `fields`: the same objects, of which the id alone is certain.
fn add_sparse_answers(openapi: &mut OpenApi) {
    let components = openapi.components.get_or_insert_default();
    for whole in ["Job", "JobListItem", "JobPage"] {
        let Some(RefOr::T(Schema::Object(object))) = components.schemas.get(whole) else { continue };
        let mut sparse = object.clone();
        sparse.description = Some(format!("The fields of `{whole}` that the query parameter `fields` names, and `id`."));
        sparse.required.retain(|name| name == "id" || name == "items");
        if let Some(RefOr::T(Schema::Array(items))) = sparse.properties.get_mut("items") {
            items.items =
                utoipa::openapi::schema::ArrayItems::RefOrSchema(Box::new(Ref::from_schema_name("SparseJobListItem").into()));
        }
        components.schemas.insert(format!("Sparse{whole}"), Schema::Object(sparse).into());
    }
    let answers = [
        ("/api/v1/jobs", "JobPage", fields::names::<wire::JobListItem>()),
        ("/api/v1/jobs/{id}", "Job", fields::names::<wire::Job>()),
    ];
    for (path, whole, names) in answers {
        let Some(operation) = openapi.paths.paths.get_mut(path).and_then(|item| item.get.as_mut()) else { continue };
        set_fields_pattern(operation, &names.join("|"));
        let Some(RefOr::T(response)) = operation.responses.responses.get_mut("200") else { continue };
        for content in response.content.values_mut() {
            if let RefOr::T(content) = content {
                let either = AnyOfBuilder::new()
                    .item(Ref::from_schema_name(whole))
                    .item(Ref::from_schema_name(format!("Sparse{whole}")))
                    .description(Some("The second form is returned with the query parameter `fields`."));
                content.schema = Some(Schema::AnyOf(either.build()).into());
            }
        }
    }
}

/// Says which names the parameter `fields` takes.
fn set_fields_pattern(operation: &mut Operation, names: &str) {
    for parameter in operation.parameters.iter_mut().flatten() {
        if let RefOr::T(Parameter { name, schema: Some(RefOr::T(Schema::Object(object))), .. }) = parameter
            && name == "fields"
        {
            object.pattern = Some(format!("^({names})(,({names}))*$"));
        }
    }
}

/// Adds links: which response leads to which request.
fn add_links(openapi: &mut OpenApi) {
    let mut results = Vec::new();
    for item in openapi.paths.paths.values_mut() {
        let of_results = operations(item).filter(|o| o.tags.iter().flatten().any(|tag| tag == "results"));
        results.extend(of_results.filter_map(|operation| operation.operation_id.clone()));
    }
    let of_job = ["get_job", "follow_job", "update_job", "cancel_job", "delete_job"];
    let of_mesh = ["get_mesh", "get_mesh_file", "get_mesh_preview", "delete_mesh"];
    let of_run = ["get_run", "follow_run", "stop_run", "get_run_record", "delete_run"];
    for item in openapi.paths.paths.values_mut() {
        for operation in operations(item) {
            let id = operation.operation_id.clone().unwrap_or_default();
            if id == "create_run" {
                of_run.iter().for_each(|to| link(operation, "202", to, "id", "$response.body#/id"));
            } else if id == "create_job" {
                of_job.iter().for_each(|to| link(operation, "202", to, "id", "$response.body#/id"));
            } else if id == "get_job" {
                results.iter().for_each(|to| link(operation, "200", to, "id", "$response.body#/id"));
            } else if id == "upload_mesh" {
                of_mesh.iter().for_each(|to| link(operation, "201", to, "id", "$response.body#/id"));
            } else if let Some(kind) = id.strip_prefix("put_") {
                for to in ["get", "delete"] {
                    link(operation, "201", &format!("{to}_{kind}"), "name", "$request.path.name");
                }
            }
        }
    }
}

fn link(operation: &mut Operation, status: &str, to: &str, parameter: &str, value: &str) {
    if let Some(RefOr::T(response)) = operation.responses.responses.get_mut(status) {
        let mut link = Link::builder().operation_id(to).parameter(parameter, value);
        link = match to {
            "get_job_file" => link.parameter("name", "plan.json"),
            "get_job" | "get_run" => link.parameter("wait", "5s"),
            _ => link,
        };
        response.links.insert(to.to_owned(), link.build().into());
    }
}
