//! `api/` says what the server does: drift, routes and codes.

use std::collections::BTreeSet;
use std::path::Path;

use vantage::wire::FailureCode;

use super::api::{Api, http_options, service_options};

/// Holds `api/<name>` against what the code says; `UPDATE_GOLDEN=1` writes it anew.
#[track_caller]
fn assert_committed(name: &str, now: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("api").join(name);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, now).expect("written");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == now, "api/{name} is not what the code says; look at the change and run with UPDATE_GOLDEN=1");
}

fn document() -> serde_json::Value {
    serde_json::to_value(vantage::http::openapi()).expect("JSON")
}

#[test]
fn the_committed_openapi_document_is_the_server_s() {
    assert_committed("openapi.json", &format!("{}\n", serde_json::to_string_pretty(&document()).expect("JSON")));
}

#[test]
fn the_committed_list_of_problems_is_the_server_s() {
    assert_committed("problems.md", &vantage::http::problems_document());
}

#[test]
fn the_committed_list_of_parameters_is_the_planner_s() {
    assert_committed("parameters.md", &vantage::wire::parameters::markdown());
}

/// The number that a property is, or each number of a list is; none for other properties.
fn number(property: &serde_json::Value) -> Option<&serde_json::Value> {
    let is = |kind: &str| {
        let kinds = &property["type"];
        kinds == kind || kinds.as_array().is_some_and(|kinds| kinds.iter().any(|each| each == kind))
    };
    match (is("number") || is("integer"), is("array")) {
        (true, _) => Some(property),
        (false, true) => number(&property["items"]),
        (false, false) => None,
    }
}

/// The knobs of inspections and rescans had neither.
#[test]
fn every_knob_has_its_range_and_its_default_in_the_document() {
    use vantage::inspection::{AlignParams, coverage::CompareParams};
    use vantage::planning::params::{PlanParams, RescanParams};
    let document = document();
    let schemas = &document["components"]["schemas"];
    let plan = PlanParams::knobs().into_iter().map(|(_, group)| group);
    let mut numbers = 0;
    for group in plan.chain([AlignParams::KNOBS, CompareParams::KNOBS, RescanParams::KNOBS]) {
        let schema = &schemas[group.name];
        for knob in group.knobs {
            let (name, property) = (format!("{}.{}", group.name, knob.field), &schema["properties"][knob.field]);
            let Some(number) = number(property) else {
                assert!(knob.range.is_none() || knob.field == "brightness", "{name} is no number: {property}");
                continue;
            };
            numbers += 1;
            let range = [&number["minimum"], &number["maximum"]].map(serde_json::Value::as_f64);
            assert_eq!(range, knob.range.map_or([None; 2], |range| range.map(Some)), "{name}: {property}");
            let is_required = schema["required"].as_array().into_iter().flatten().any(|each| each == knob.field);
            assert!(is_required || property.as_object().expect("an object").contains_key("default"), "{name}: {property}");
        }
    }
    assert!(numbers > 80, "{numbers}");
    assert_eq!(schemas["InterestParams"]["properties"]["weight"]["default"], 1.0);
    for field in ["angle_deg", "translation_mm"] {
        assert_eq!(schemas["PoseErrorParams"]["properties"][field]["default"], 1.0, "{field}");
    }
}

/// Numbers of requests that the check refuses by something else than a range, or not at all; and those of poses and standard
/// deviations, which answers have too.
const WITHOUT_RANGE: [(&str, &str); 20] = [
    ("BoardPoseSpec", "rotation_rows"),
    ("CalibrationProvenance", "temperature_c"),
    ("ChainJointSpec", "axis"),
    ("CompensationProvenance", "temperature_c"),
    ("ObservedPose", "quaternion_xyzw"),
    ("ObservedPose", "rotation_rows"),
    ("OpwSpec", "sign_corrections"),
    ("PoseSpec", "quaternion_xyzw"),
    ("PoseSpec", "translation_mm"),
    ("RegionBox", "max_mm"),
    ("RegionBox", "min_mm"),
    ("RegionHalfSpace", "normal"),
    ("RegionHalfSpace", "point_mm"),
    ("RegionPlane", "normal"),
    ("RegionPlane", "point_mm"),
    ("RegionSphere", "centre_mm"),
    ("SigmaDocument", "board_deg"),
    ("SigmaDocument", "board_mm"),
    ("SigmaDocument", "robot_deg"),
    ("SigmaDocument", "robot_mm"),
];

/// Ranges stood in descriptions alone.
#[test]
fn every_number_that_a_request_may_have_has_its_range_in_the_document() {
    let document = document();
    let schemas = document["components"]["schemas"].as_object().expect("schemas");
    let mut open: Vec<&serde_json::Value> = Vec::new();
    let items = document["paths"].as_object().expect("paths").values();
    for operation in items.flat_map(|item| item.as_object().expect("operations").values()) {
        open.push(&operation["requestBody"]);
    }
    let (mut asked, mut lacking) = (BTreeSet::new(), BTreeSet::new());
    while let Some(value) = open.pop() {
        let reference = value["$ref"].as_str().and_then(|reference| reference.rsplit('/').next());
        if let Some(name) = reference.filter(|name| asked.insert(*name)) {
            let schema = &schemas[name];
            open.push(schema);
            for (field, property) in schema["properties"].as_object().into_iter().flatten() {
                if number(property).is_some_and(|number| !(number["minimum"].is_number() && number["maximum"].is_number())) {
                    lacking.insert((name, field.as_str()));
                }
            }
        }
        open.extend(value.as_object().into_iter().flat_map(|object| object.values()));
        open.extend(value.as_array().into_iter().flatten());
    }
    assert!(asked.contains("ScannerSpec") && asked.contains("CalibrationData"), "{asked:?}");
    assert_eq!(lacking, BTreeSet::from(WITHOUT_RANGE));
}

/// Attributes of the routes have the ranges of query parameters, the code has them again.
#[tokio::test]
async fn the_ranges_of_query_parameters_are_those_that_are_checked() {
    let api = Api::start().await;
    let (document, job) = (document(), api.job("").await);
    api.ended(&job).await;
    let of_no_job = serde_json::json!({"job_id": "0190b6b0-7c1e-7c1e-8c1e-0123456789ab"}).to_string();
    let json = [("content-type", "application/json")];
    let mut asked = BTreeSet::new();
    // Routes of a single run look for it first, and there is none.
    let items = document["paths"].as_object().expect("paths").iter().filter(|(path, _)| !path.starts_with("/api/v1/runs/"));
    for ((path, item), method) in items.flat_map(|item| ["get", "post"].map(|method| (item, method))) {
        for parameter in item[method]["parameters"].as_array().into_iter().flatten().filter(|each| each["in"] == "query") {
            let schema = &parameter["schema"];
            let (Some(min), Some(max)) = (schema["minimum"].as_i64(), schema["maximum"].as_i64()) else { continue };
            let name = parameter["name"].as_str().expect("a name");
            for (value, is_in_range) in [(min - 1, false), (min, true), (max, true), (max + 1, false)] {
                let url = format!("{}?{name}={value}", path.replace("{id}", &job));
                let answer = match method {
                    "get" => api.get(&url).await,
                    _ => api.send("POST", &url, &json, of_no_job.clone()).await,
                };
                let is_refused = answer.status == 400 && answer.text().contains("; allowed is a whole number from ");
                assert_eq!(is_refused, !is_in_range, "{method} {url}: {}", answer.text());
            }
            asked.insert((path, method, name));
        }
    }
    assert_eq!(asked.len(), 8, "{asked:?}");
}

#[test]
fn codes_are_different_and_documented() {
    let document = vantage::http::problems_document();
    let mut seen = BTreeSet::new();
    for code in vantage::http::Code::ALL {
        assert!(seen.insert(code.as_str()), "{} stands there twice", code.as_str());
        assert!(document.contains(&format!("<a id=\"{0}\"></a>`{0}` | {1} |", code.as_str(), code.status().as_u16())));
    }
    for code in FailureCode::ALL.map(FailureCode::as_str) {
        assert!(document.contains(&format!("`{code}` |")), "{code}");
    }
}

#[tokio::test]
async fn the_document_is_served_and_is_of_openapi_3_1() {
    let api = Api::start().await;
    assert_eq!(api.get("/api/v1/openapi.json").await.ok(200), document());
    // The one of the documentation page says where the server is from there.
    let mut of_page = api.get("/docs/openapi.json").await.ok(200);
    assert_eq!(of_page.as_object_mut().expect("an object").remove("servers"), Some(serde_json::json!([{"url": "../"}])));
    assert_eq!(of_page, document());
    assert!(document()["openapi"].as_str().is_some_and(|version| version.starts_with("3.1.")));
    assert_eq!(document()["info"]["title"], "Vantage");
}

/// Collects the descriptions and summaries in `value`, each with the pointer to it.
fn collect_texts(value: &serde_json::Value, at: &str, found: &mut Vec<(String, String)>) {
    for (key, member) in value.as_object().into_iter().flatten() {
        let at = format!("{at}/{key}");
        match member.as_str() {
            Some(text) if key == "description" || key == "summary" => found.push((at, text.to_owned())),
            _ => collect_texts(member, &at, found),
        }
    }
    for (index, member) in value.as_array().into_iter().flatten().enumerate() {
        collect_texts(member, &format!("{at}/{index}"), found);
    }
}

/// Readers of the document have no sources beside it: descriptions named files of the repository, and cited a thesis by no title.
#[test]
fn the_document_stands_by_itself() {
    let document = document();
    let about = document["info"]["description"].as_str().expect("a description");
    assert!(about.contains("*Quality-Based Path Planning: ") && about.contains("the thesis"), "{about}");
    let mut texts = Vec::new();
    collect_texts(&document, "", &mut texts);
    assert!(texts.len() > 1000, "the scan must see the descriptions: {}", texts.len());
    let is_source = |word: &str| [".rs", ".md"].iter().any(|end| word.trim_end_matches('.').ends_with(end));
    for (at, text) in &texts {
        let mut words = text.split(|letter: char| !letter.is_alphanumeric() && !"._-/".contains(letter));
        let opening = words.clone().next().unwrap_or_default();
        assert!(!["It", "Its", "Least", "None", "That", "Whose"].contains(&opening), "{at} does not begin with a noun: {text}");
        assert!(!words.any(is_source), "{at} names a file of the repository: {text}");
    }
}

/// Pages for people, which are no part of the interface; what axum calls the lack of a route; and the commands that bring an arm to
/// rest, with the slash that a client may have put at their end.
const PAGES: [&str; 11] = [
    "/",
    "/assets/{name}",
    "/docs",
    "/docs/",
    "/docs/{file}",
    "/licences",
    "/parameters",
    "/problems/{code}",
    "/api/v1/runs/{id}/pause/",
    "/api/v1/runs/{id}/stop/",
    "/{*__private__axum_fallback}",
];

#[tokio::test]
async fn every_route_is_in_the_document() {
    let api = Api::start().await;
    let router = vantage::http::router(api.app.clone(), http_options());
    // The router's debug form lists its paths as `RouteId(n): "path"`.
    let printed = format!("{router:?}");
    let routed: BTreeSet<&str> = printed
        .split("RouteId(")
        .filter_map(|piece| piece.split_once("): \"").and_then(|(_, rest)| rest.split_once('"')).map(|(path, _)| path))
        .filter(|path| path.starts_with('/') && !PAGES.contains(path))
        .collect();
    let document = document();
    let documented: BTreeSet<&str> = document["paths"].as_object().expect("paths").keys().map(String::as_str).collect();
    assert!(routed.len() > 20, "{routed:?}");
    assert_eq!(routed, documented);
}

#[test]
fn every_operation_says_what_can_go_wrong() {
    let document = document();
    let mut ids = BTreeSet::new();
    for (path, item) in document["paths"].as_object().expect("paths") {
        for (method, operation) in item.as_object().expect("operations") {
            for status in ["4XX", "5XX"] {
                let schema = &operation["responses"][status]["content"]["application/problem+json"]["schema"]["$ref"];
                assert_eq!(schema, "#/components/schemas/Problem", "{method} {path}");
            }
            let id = operation["operationId"].as_str().expect("an id");
            assert!(ids.insert(id.to_owned()), "{id} stands there twice");
            assert!(operation["summary"].as_str().is_some_and(|summary| !summary.is_empty()), "{method} {path}");
        }
    }
}

/// No document said that scans and inspections go with their job.
#[test]
fn what_is_deleted_with_a_job_is_in_the_document() {
    let document = document();
    let told = |place: &serde_json::Value| place["description"].as_str().expect("a description").to_owned();
    for (path, method) in [("/api/v1/jobs/{id}", "delete"), ("/api/v1/jobs/delete", "post"), ("/api/v1/retention", "post")] {
        let told = told(&document["paths"][path][method]);
        assert!(told.contains("uploaded scans") && told.contains("inspections"), "{method} {path}: {told}");
    }
    for setting in ["job_days", "jobs_per_part"] {
        let told = told(&document["components"]["schemas"]["RetentionPolicy"]["properties"][setting]);
        assert!(told.contains("scans and inspections"), "{setting}: {told}");
    }
}

/// The schema of a parameter of an operation.
fn parameter(document: &serde_json::Value, path: &str, method: &str, name: &str) -> serde_json::Value {
    let operation = &document["paths"][path][method];
    let found = operation["parameters"].as_array().expect("parameters").iter().find(|parameter| parameter["name"] == name);
    found.unwrap_or_else(|| panic!("{method} {path} has no {name}"))["schema"].clone()
}

/// Routes of results with one form read the parameter, and did not list it.
#[test]
fn every_result_of_an_inspection_lists_its_formats() {
    let document = document();
    let results: [(&str, &[&str]); 5] = [
        ("result", &["json"]),
        ("learned", &["json"]),
        ("losses", &["json", "csv"]),
        ("deviation", &["csv", "ply"]),
        ("report", &["html", "text"]),
    ];
    for (name, formats) in results {
        let schema = parameter(&document, &format!("/api/v1/inspections/{{id}}/{name}"), "get", "format");
        assert_eq!(schema["enum"], serde_json::json!(formats), "{name}");
    }
}

/// Names of specifications and times of scans, inspections and calibrations were any text; results of inspections were sent with
/// a tag and as not modified, and the document did not say so.
#[test]
fn names_times_and_answers_to_conditional_requests_are_in_the_document() {
    let document = document();
    for collection in ["scanners", "robots", "turntables", "cells"] {
        for method in ["get", "put", "delete"] {
            let name = parameter(&document, &format!("/api/v1/{collection}/{{name}}"), method, "name");
            assert_eq!(name["pattern"], "^[a-z0-9][a-z0-9._-]{0,63}$", "{method} {collection}");
        }
    }
    for (schema, field) in [
        ("Scan", "created_at"),
        ("InspectionJob", "created_at"),
        ("InspectionJob", "ended_at"),
        ("CalibrationJob", "created_at"),
        ("CalibrationJob", "ended_at"),
    ] {
        assert_eq!(document["components"]["schemas"][schema]["properties"][field]["format"], "date-time", "{schema} {field}");
    }
    for result in ["result", "learned", "losses", "deviation", "report"] {
        let responses = &document["paths"][format!("/api/v1/inspections/{{id}}/{result}")]["get"]["responses"];
        assert!(responses["304"].is_object() && responses["200"]["headers"]["ETag"].is_object(), "{result}: {responses}");
    }
    // Routes that answer with a part take the header that asks for it, and no others do.
    let items = document["paths"].as_object().expect("paths");
    let lists_range = |item: &serde_json::Value| {
        let mut parameters = item["get"]["parameters"].as_array().into_iter().flatten();
        parameters.any(|parameter| parameter["name"] == "Range" && parameter["in"] == "header")
    };
    for (path, item) in items {
        assert_eq!(lists_range(item), item["get"]["responses"]["206"].is_object(), "{path}");
    }
    // Parts of JSON follow no schema: clients made from the document would take them for another result.
    let stored = items.iter().filter(|(_, item)| {
        let tags = item["get"]["tags"].as_array().into_iter().flatten();
        tags.into_iter().any(|tag| tag == "results" || tag == "inspections") && item["get"]["responses"]["304"].is_object()
    });
    let mut listed = 0;
    for (path, item) in stored {
        let media = item["get"]["responses"]["200"]["content"].as_object().into_iter().flat_map(|content| content.keys());
        let is_json = media.into_iter().any(|media| media.ends_with("json"));
        assert_ne!(lists_range(item), is_json, "{path}");
        listed += usize::from(!is_json);
    }
    assert!(listed > 8, "{listed}");
}

/// The routes of inspections and of their rescans were not listed.
#[test]
fn every_route_that_takes_an_idempotency_key_lists_it() {
    let document = document();
    for path in ["jobs", "jobs/batch", "jobs/{id}/inspections", "inspections/{id}/rescans", "calibrations", "runs", "leases"] {
        let schema = parameter(&document, &format!("/api/v1/{path}"), "post", "Idempotency-Key");
        assert_eq!(schema["pattern"], "^[ \\t]*[\\x21-\\x7e]{1,255}[ \\t]*$", "{path}");
    }
}

#[test]
fn every_number_in_a_query_has_its_range() {
    let document = document();
    let operations =
        document["paths"].as_object().expect("paths").values().flat_map(|item| item.as_object().expect("methods").values());
    let mut numbers = 0;
    for parameter in operations.filter_map(|operation| operation["parameters"].as_array()).flatten() {
        if parameter["in"] == "query" && parameter["schema"].to_string().contains("integer") {
            let schema = &parameter["schema"];
            assert!(schema["minimum"].is_number() && schema["maximum"].is_number(), "{parameter}");
            numbers += 1;
        }
    }
    assert!(numbers > 10, "{numbers}");
}

#[tokio::test]
async fn every_result_has_a_route_with_one_media_type() {
    let api = Api::start().await;
    let job = api.job("").await;
    api.ended(&job).await;
    let document = document();
    let dialects = document["components"]["schemas"]["ProgramDialect"]["enum"].as_array().expect("an enum").clone();
    assert!(dialects.len() > 6, "{dialects:?}");
    let (mut asked, mut formed) = (0, 0);
    for (path, item) in document["paths"].as_object().expect("paths") {
        if item["get"]["tags"] != serde_json::json!(["results"]) {
            continue;
        }
        // The parameter that asks for the form: routes read it, and did not list it.
        let parameters = item["get"]["parameters"].as_array().expect("parameters").iter();
        let mut form = parameters
            .filter(|parameter| parameter["in"] == "query" && (parameter["name"] == "format" || parameter["name"] == "dialect"));
        let form = form.next().map(|parameter| {
            let [form] = &parameter["schema"]["enum"].as_array().expect("an enum")[..] else { panic!("one form: {parameter}") };
            format!("?{}={}", parameter["name"].as_str().expect("a name"), form.as_str().expect("a form"))
        });
        formed += usize::from(form.is_some());
        let content = item["get"]["responses"]["200"]["content"].as_object().expect("content");
        let [media_type] = &content.keys().collect::<Vec<_>>()[..] else { panic!("{path} has several media types: {content:?}") };
        for dialect in dialects.iter().take(if path.contains("{dialect}") { dialects.len() } else { 1 }) {
            let url = path.replace("{id}", &job).replace("{name}", "plan.json");
            let url = url.replace("{dialect}", dialect.as_str().expect("text"));
            let answer = api.get(&url).await;
            // Of several setups there is one here.
            if answer.status == 404 && path.contains("/program-") {
                continue;
            }
            assert_eq!(answer.status, 200, "{url}: {}", answer.text());
            assert_eq!(answer.header("content-type").split(';').next(), Some(media_type.as_str()), "{url}");
            asked += 1;
            let part = api.send("GET", &url, &[("range", "bytes=0-0")], "").await;
            assert_eq!((part.status.as_u16(), &part.bytes[..]), (206, &answer.bytes[..1]), "{url}");
            let is_json = media_type.ends_with("json");
            assert_ne!(item["get"]["responses"]["206"].is_object(), is_json, "{path}");
            for header in ["Range", "If-Range"].iter().filter(|_| !is_json) {
                parameter(&document, path, "get", header);
            }
            if let Some(form) = &form {
                let by_form = api.get(&format!("{url}{form}")).await;
                assert_eq!((by_form.status.as_u16(), by_form.bytes), (200, answer.bytes), "{url}{form}");
            }
        }
    }
    assert!(asked > 20, "{asked}");
    assert_eq!(formed, 12);
}

/// Tables and texts that `Accept` or a query parameter asks for, and parts of JSON documents, were in no response of the document.
#[tokio::test]
async fn every_form_of_a_result_and_its_parts_are_named_in_the_response() {
    let api = Api::start().await;
    let job = api.job("").await;
    api.ended(&job).await;
    let document = document();
    let dialects = document["components"]["schemas"]["ProgramDialect"]["enum"].as_array().expect("an enum");
    let dialects = dialects.iter().filter_map(|dialect| dialect.as_str());
    let forms: Vec<&str> = ["json", "csv", "html", "text", "bin"].into_iter().chain(dialects).collect();
    let (mut others, mut in_parts) = (BTreeSet::new(), 0);
    for (path, item) in document["paths"].as_object().expect("paths") {
        let (tags, whole) = (&item["get"]["tags"], &item["get"]["responses"]["200"]);
        let told = whole["description"].as_str().unwrap_or_default();
        let content: BTreeSet<&str> =
            whole["content"].as_object().into_iter().flatten().map(|(media, _)| media.as_str()).collect();
        let is_stored = item["get"]["responses"]["304"].is_object() && (tags[0] == "results" || tags[0] == "inspections");
        if is_stored && content.contains("application/json") {
            assert!(told.contains("`Range`") && told.contains("206"), "{path}: {told}");
            in_parts += 1;
        }
        let mut parameters = item["get"]["parameters"].as_array().into_iter().flatten().map(|parameter| &parameter["name"]);
        let Some(name) = parameters.find(|name| tags[0] == "results" && (**name == "format" || **name == "dialect")) else {
            continue;
        };
        for form in forms.iter().filter(|_| !path.contains("{dialect}")) {
            let url = format!("{}?{}={form}", path.replace("{id}", &job), name.as_str().expect("a name"));
            let answer = api.get(&url).await;
            let media_type = answer.headers.get("content-type").and_then(|kind| kind.to_str().ok()).unwrap_or_default();
            let media_type = media_type.split(';').next().unwrap_or_default();
            if answer.status == 200 && !content.contains(media_type) {
                assert!(told.contains(&format!("`{form}` (`{media_type}`)")), "{url}: {told}");
                others.insert((path.as_str(), *form));
            }
        }
    }
    for expected in [("viewpoints", "csv"), ("coverage", "csv"), ("report", "text"), ("program", "csv"), ("program", "hans")] {
        assert!(others.iter().any(|(path, form)| path.ends_with(expected.0) && *form == expected.1), "{expected:?}: {others:?}");
    }
    assert!(in_parts > 10, "{in_parts}");
    let record = &document["paths"]["/api/v1/runs/{id}/record"]["get"]["responses"]["200"]["description"];
    assert!(record.as_str().is_some_and(|told| told.contains("text/csv")), "{record}");
}

/// Names with these characters were refused, and the document's pattern took them.
#[test]
fn the_pattern_of_a_file_s_name_leaves_out_what_turns_the_direction_of_text() {
    let document = document();
    for path in ["/api/v1/meshes", "/api/v1/jobs/{id}/scans"] {
        let mut parameters = document["paths"][path]["post"]["parameters"].as_array().expect("parameters").iter();
        let name = parameters.find(|parameter| parameter["name"] == "name").expect("a name");
        let pattern = name["schema"]["pattern"].as_str().expect("a pattern");
        assert!(pattern.contains(r"\u202a-\u202e\u2066-\u2069"), "{path}: {pattern}");
    }
}

#[tokio::test]
async fn page_tokens_are_as_the_document_says() {
    let api = Api::start().await;
    for unit in ["mm", "cm"] {
        api.send("POST", &format!("/api/v1/meshes?unit={unit}"), &[], super::api::cube(10.0)).await.ok(201);
    }
    let token = api.get("/api/v1/meshes?page_size=1").await.ok(200)["next_page_token"].as_str().expect("more").to_owned();
    let document = document();
    for path in ["/api/v1/meshes", "/api/v1/jobs"] {
        let pattern = parameter(&document, path, "get", "page_token")["pattern"].as_str().expect("a pattern").to_owned();
        assert_eq!(pattern, r"^([0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}|x([0-9a-f]{2})*)\.[0-9a-f]{16}(\.([0-9a-f]{2})+)?$");
    }
    let (id, digest) = token.split_once('.').expect("a dot");
    let is_hex = |text: &str, length: usize| text.len() == length && text.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
    assert_eq!(id.split('-').map(str::len).collect::<Vec<_>>(), [8, 4, 4, 4, 12]);
    assert!(id.split('-').all(|part| is_hex(part, part.len())) && is_hex(digest, 16), "{token}");
}

#[tokio::test]
async fn the_example_of_an_upload_can_be_uploaded() {
    let api = Api::start().await;
    let upload = &document()["paths"]["/api/v1/meshes"]["post"];
    let example =
        upload["requestBody"]["content"]["application/octet-stream"]["example"].as_str().expect("an example").to_owned();
    let digest =
        upload["parameters"].as_array().expect("parameters").iter().find(|parameter| parameter["name"] == "Content-Digest");
    let digest = digest.expect("the digest")["example"].as_str().expect("an example").to_owned();
    let mesh = api.send("POST", "/api/v1/meshes?unit=mm", &[("content-digest", &digest)], example).await.ok(201);
    assert_eq!(mesh["health"]["watertight"], true, "{mesh}");
}

#[tokio::test]
async fn an_event_s_id_may_be_as_large_as_ids_become() {
    let api = Api::start().await;
    let schema = parameter(&document(), "/api/v1/events", "get", "Last-Event-ID");
    assert_eq!((&schema["format"], &schema["minimum"]), (&"int64".into(), &0.into()));
    let (job, last) = (api.job("").await, i64::MAX.to_string());
    api.ended(&job).await;
    for last in [&last, "2147483648", "4294967296"] {
        let headers = [("last-event-id", last)];
        // No event has it: it is of another database, one before a restore, and the job is to be read anew.
        let answer = api.send("GET", &format!("/api/v1/jobs/{job}/events"), &headers, "").await;
        assert!(answer.status == 200 && answer.text().contains("event: reset"), "{last}: {}", answer.text());
    }
}

#[tokio::test]
async fn the_pages_load_nothing_from_elsewhere_and_run_nothing_inline() {
    let api = Api::start().await;
    let page = api.get("/").await;
    page.ok(200);
    assert!(page.header("content-security-policy").starts_with("default-src 'self';"));
    let html = page.text();
    for inline in ["<script>", "<style", " style=", " onclick=", " onload=", "javascript:", "http://", "https://"] {
        assert!(!html.contains(inline), "{inline}");
    }
    for asset in ["page.js", "style.css", "icon.svg"] {
        assert!(html.contains(&format!("\"assets/{asset}\"")), "{asset}");
        let answer = api.get(&format!("/assets/{asset}")).await;
        assert_eq!(answer.status, 200, "{asset}");
        let known = api.send("GET", &format!("/assets/{asset}"), &[("if-none-match", answer.header("etag"))], "").await;
        assert_eq!(known.status, 304);
    }
    // The key is exchanged for a session, which no script can read.
    let mut scripts = String::new();
    for file in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/static/dist")).expect("the folder").flatten() {
        let name = file.file_name().to_string_lossy().into_owned();
        let answer = api.get(&format!("/assets/{name}")).await;
        assert_eq!(answer.status, 200, "{name}");
        if name.ends_with(".js") {
            scripts.push_str(&answer.text());
        }
    }
    assert!(scripts.contains("/session") && !scripts.contains("document.cookie"));
    // No code is made from text, which the policy would refuse.
    assert!(!scripts.contains("eval(") && !scripts.contains("new Function("));
    let licences = api.get("/licences").await;
    assert_eq!(licences.status, 200);
    for part in ["preact", "three", "three-mesh-bvh", "uplot", "@preact/signals"] {
        assert!(licences.text().contains(&format!("\n{part} ")), "{part}");
    }
    api.get("/assets/nothing.js").await.problem("no_such_route");
    api.get("/assets/..%2fCargo.toml").await.problem("no_such_route");

    let moved = api.get("/docs").await;
    assert_eq!((moved.status.as_u16(), moved.header("location")), (308, "docs/"));
    assert!(api.get("/docs/").await.text().contains("swagger-ui"));
    assert!(api.get("/docs/swagger-initializer.js").await.text().contains("\"openapi.json\""));
    let page = api.get("/docs/").await.text();
    for (name, media_type, bytes) in [
        ("swagger-ui.css", "text/css; charset=utf-8", 100_000),
        ("index.css", "text/css; charset=utf-8", 100),
        ("favicon-32x32.png", "image/png", 100),
        ("swagger-ui-bundle.js", "text/javascript; charset=utf-8", 1_000_000),
        ("swagger-ui-standalone-preset.js", "text/javascript; charset=utf-8", 100_000),
    ] {
        let file = api.get(&format!("/docs/{name}")).await;
        assert!(page.contains(name) && file.bytes.len() > bytes, "{name}: {} bytes", file.bytes.len());
        assert_eq!(file.header("content-type"), media_type, "{name}");
    }
    // The archive holds the sources too.
    for name in ["nothing", "..%2fpackage.json", "dist%2findex.html"] {
        api.get(&format!("/docs/{name}")).await.problem("no_such_route");
    }
}

#[tokio::test]
async fn every_answer_has_its_headers() {
    let api = Api::start().await;
    for path in ["/healthz", "/nothing", "/", "/api/v1/jobs"] {
        let answer = api.get(path).await;
        assert_eq!(answer.header("x-content-type-options"), "nosniff", "{path}");
        assert!(answer.header("content-security-policy").contains("frame-ancestors 'none'"), "{path}");
        assert_eq!(answer.header("referrer-policy"), "no-referrer", "{path}");
        assert!(!answer.header("x-request-id").is_empty(), "{path}");
    }
    let own = api.send("GET", "/healthz", &[("x-request-id", "mine-1")], "").await;
    assert_eq!(own.header("x-request-id"), "mine-1");
    for unfit in ["", "a b", "ä", &"x".repeat(129)] {
        assert_ne!(api.send("GET", "/healthz", &[("x-request-id", unfit)], "").await.header("x-request-id"), unfit);
    }
}

#[tokio::test]
async fn the_server_tells_about_itself() {
    vantage::http::install_metrics();
    let api = Api::start().await;
    assert_eq!(api.get("/healthz").await.ok(200)["status"], "ok");
    assert_eq!(api.get("/readyz").await.ok(200)["status"], "ready");
    let version = api.get("/version").await.ok(200);
    assert_eq!(version["version"], env!("CARGO_PKG_VERSION"));
    assert!(version["commit"].as_str().is_some_and(|commit| !commit.is_empty()), "{version}");
    assert!(version["target"].as_str().is_some_and(|target| target.contains('-')), "{version}");
    assert!(api.get("/problems").await.text().starts_with("# Problems"));
    let metrics = api.get("/metrics").await.text();
    assert!(metrics.contains("vantage_jobs{state=\"queued\"} 0"), "{metrics}");
    assert!(metrics.contains("vantage_http_requests_total{method=\"GET\",route=\"/healthz\",status=\"200\"}"), "{metrics}");
}

/// The answer said "failed", while a refused upload was told the figures and what to do.
#[tokio::test]
async fn a_server_short_of_disk_space_gives_the_figures_and_says_what_to_do() {
    let short = vantage::service::Options { min_free_bytes: u64::MAX, min_free_share: 1.0, ..service_options() };
    let api = Api::start_with(short, http_options()).await;
    let problem = api.get("/readyz").await.problem_at("not_ready", &["free_space"]);
    let detail = problem["errors"][0]["detail"].as_str().expect("text");
    assert!(detail.contains("bytes left") && detail.contains("delete jobs or meshes"), "{problem}");
}

#[tokio::test]
async fn a_stopping_server_says_so_and_takes_no_work() {
    let api = Api::start().await;
    let mesh = api.mesh().await;
    let job = api.job("wait").await;
    api.running(&job).await;
    api.app.stop().await;
    api.get("/readyz").await.problem_at("not_ready", &["not_stopping"]);
    assert_eq!(api.get("/healthz").await.status, 200);
    let answer = api.post_json("/api/v1/jobs", &serde_json::json!({"mesh_id": mesh})).await;
    answer.problem("stopping");
    assert!(!answer.header("retry-after").is_empty());
    api.send("POST", "/api/v1/meshes?unit=mm", &[], "x").await.problem("stopping");
    // What was planned waits for the next process, and the attempt does not count.
    let job = api.get(&format!("/api/v1/jobs/{job}")).await.ok(200);
    assert_eq!((job["state"].as_str(), job["attempts"].as_u64()), (Some("queued"), Some(0)));
}

#[tokio::test]
async fn the_documentation_is_named_and_leads_to_the_other_pages() {
    let api = Api::start().await;
    let page = api.get("/docs/").await.text();
    assert!(page.contains("<title>API – Vantage</title>") && page.contains("id=\"swagger-ui\""), "{page}");
    for link in ["../", "../parameters", "../problems"] {
        assert!(page.contains(&format!("href=\"{link}\"")), "{link}: {page}");
    }
    let parameters = api.get("/parameters").await;
    assert_eq!(parameters.header("content-type"), "text/html; charset=utf-8");
    let html = parameters.text();
    for parameter in vantage::wire::parameters::lists().into_iter().flat_map(|(_, _, parameters)| parameters) {
        assert!(html.contains(&format!("<tr id=\"{}\">", parameter.key)), "{}", parameter.key);
    }
    assert!(html.contains("<td>0 to 1</td>") && html.contains("<td>0.001 to 100 mm</td>") && !html.contains('`'), "{html}");
}

#[tokio::test]
async fn the_type_of_every_problem_leads_to_a_page_for_people() {
    let api = Api::start().await;
    let kind = api.get("/api/v1/nothing").await.problem("no_such_route")["type"].as_str().expect("a path").to_owned();
    assert_eq!(api.get(&kind).await.status, 200, "{kind}");
    let of_failures = FailureCode::ALL.map(FailureCode::as_str);
    for code in vantage::http::Code::ALL.iter().map(|code| code.as_str()).chain(of_failures) {
        let page = api.get(&format!("/problems/{code}")).await;
        assert_eq!((page.status.as_u16(), page.header("content-type")), (200, "text/html; charset=utf-8"), "{code}");
        let html = page.text();
        assert!(html.contains(&format!("<code>{code}</code>")) && html.contains("<h2>"), "{html}");
        assert!(!html.contains('`') && !html.contains("href=\"/"), "{html}");
    }
    api.get("/problems/nothing").await.problem("no_such_route");
    // The list is a page for browsers, and the text in `api/` for everybody else.
    let list = api.send("GET", "/problems", &[("accept", "text/html,application/xhtml+xml,*/*;q=0.8")], "").await;
    assert_eq!(list.header("content-type"), "text/html; charset=utf-8");
    for code in vantage::http::Code::ALL {
        assert!(list.text().contains(&format!("href=\"problems/{}\"", code.as_str())), "{}", code.as_str());
    }
    for accept in ["*/*", "text/markdown", "application/json"] {
        let text = api.send("GET", "/problems", &[("accept", accept)], "").await;
        assert!(text.text().starts_with("# Problems"), "{accept}");
    }
}
