//! What came out of a job. A result never changes: its tag is the hash of its bytes.

use std::collections::BTreeMap;

use axum::extract::{Path, State};
use axum::http::header::{CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_SECURITY_POLICY, VARY};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};

use super::{immutable, job_id, not_modified, streamed};
use crate::http::extract::Params;
use crate::http::negotiate::{Form, choose, takes_gzip};
use crate::http::openapi::{BinaryForm, Dialect, JsonForm, ListForm, ReportForm};
use crate::http::problem::{Code, Problem};
use crate::http::router::Site;
use crate::service::plan_job::REFUSED_FILE;
use crate::service::{Error, ResultBody};
use crate::wire::JobId;
use crate::wire::coverage::CoverageListing;
use crate::wire::missed::MissedListing;
use crate::wire::plan::PlanDocument;
use crate::wire::program::ProgramDocument;
use crate::wire::viewpoints::ViewpointsDocument;

const JSON: &str = "application/json";
const CSV: &str = "text/csv; charset=utf-8";
const HTML: &str = "text/html; charset=utf-8";
const TEXT: &str = "text/plain; charset=utf-8";
const BYTES: &str = "application/octet-stream";
/// A report is one file with its pictures and styles inside; it loads nothing, and runs nothing.
const REPORT_POLICY: HeaderValue =
    HeaderValue::from_static("default-src 'none'; img-src data:; style-src 'unsafe-inline'; frame-ancestors 'none'; sandbox");

const fn form(name: &'static str, media_type: &'static str, file: &'static str) -> Form {
    Form { name, media_type, file }
}

const PLAN: [Form; 1] = [form("json", JSON, "plan.json")];
/// A setup's program in every dialect. Their media types are nobody's standard; they keep `Accept: text/plain` from meaning
/// one of them.
macro_rules! program_forms {
    ($stem:literal) => {
        [
            form("json", JSON, concat!($stem, ".json")),
            form("csv", CSV, concat!($stem, ".csv")),
            form("hans", "text/x-hans-cps; charset=utf-8", concat!($stem, ".cps")),
            form("urscript", "text/x-urscript; charset=utf-8", concat!($stem, ".script")),
            form("rapid", "text/x-rapid; charset=utf-8", concat!($stem, ".mod")),
            form("krl", "text/x-krl; charset=utf-8", concat!($stem, ".src")),
            form("krl_dat", "text/x-krl-dat; charset=utf-8", concat!($stem, ".dat")),
            form("fanuc", "text/x-fanuc-ls; charset=utf-8", concat!($stem, ".ls")),
            form("robodk", "text/x-python; charset=utf-8", concat!($stem, ".py")),
        ]
    };
}

const PROGRAM: [Form; 9] = program_forms!("program");
const PROGRAM_2: [Form; 9] = program_forms!("program-2");
const PROGRAM_3: [Form; 9] = program_forms!("program-3");
const PROGRAM_4: [Form; 9] = program_forms!("program-4");
const VIEWPOINTS: [Form; 2] = [form("json", JSON, "viewpoints.json"), form("csv", CSV, "viewpoints.csv")];
const COVERAGE: [Form; 2] = [form("json", JSON, "coverage.json"), form("csv", CSV, "coverage.csv")];
const MISSED: [Form; 1] = [form("json", JSON, "missed.json")];
const TIMINGS: [Form; 1] = [form("json", JSON, "timings.json")];
const REPORT: [Form; 2] = [form("html", HTML, "report.html"), form("text", TEXT, "report.txt")];
const COVERAGE_BIN: [Form; 1] = [form("bin", BYTES, "coverage.bin")];

/// The result in the form asked for, by `Accept` or by the query parameter `parameter`.
async fn answer(
    site: &Site,
    id: &str,
    headers: &HeaderMap,
    mut params: Params,
    parameter: &str,
    forms: &[Form],
) -> Result<Response, Problem> {
    let asked = params.text(parameter);
    params.end()?;
    let id = job_id(id)?;
    // Whether there is such a job goes before the form: who asks for the wrong form of nothing is told of the nothing.
    site.app.job_state(id).await?;
    let form = choose(headers, asked.as_deref(), forms)?;
    let file = match site.app.result(id, form.file).await {
        Err(Error::NoSuchResult { .. }) => return Err(absent(site, id, form.file).await),
        found => found?,
    };
    give(&file, headers, form.media_type).await
}

/// The answer that a result is, as it is stored where the client takes that.
async fn give(file: &ResultBody, headers: &HeaderMap, media_type: &'static str) -> Result<Response, Problem> {
    if let Some(response) = not_modified(headers, file.sha256()) {
        return Ok(response);
    }
    let packed = file.is_packed() && takes_gzip(headers);
    let body = streamed(file.open(packed).await?);
    let mut response = (immutable(file.sha256(), media_type), body).into_response();
    let about = response.headers_mut();
    about.insert(CONTENT_LENGTH, file.size_bytes(packed).into());
    about.insert(VARY, HeaderValue::from_static("accept, accept-encoding"));
    if packed {
        about.insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    if media_type == HTML {
        about.insert(CONTENT_SECURITY_POLICY, REPORT_POLICY);
    }
    Ok(response)
}

/// Why a job that succeeded has no such file: planning says so of dialects.
async fn absent(site: &Site, id: JobId, name: &str) -> Problem {
    let refused = async {
        let file = site.app.result(id, REFUSED_FILE).await.ok()?;
        let bytes = file.read().await.ok()?;
        serde_json::from_slice::<BTreeMap<String, String>>(&bytes).ok()?.remove(name)
    };
    match refused.await {
        Some(reason) => Problem::new(Code::ResultNotFound, format!("there is no {name}: {reason}")),
        None => Error::NoSuchResult { job: id, name: name.to_owned() }.into(),
    }
}

macro_rules! result {
    (
        $(#[doc = $doc:literal])+
        $name:ident, $id:literal, $path:literal, $forms:ident, $parameter:literal $choice:ident,
        $(($media:literal, $body:ty)),+
    ) => {
        $(#[doc = $doc])+
        #[utoipa::path(
            get,
            path = $path,
            tag = "results",
            operation_id = $id,
            params(
                ("id" = uuid::Uuid, Path, description = "Id of the job."),
                ($parameter = inline(Option<$choice>), Query, description = "Form of the answer, before `Accept`."),
            ),
            responses(
                (status = 200, description = "The result; it never changes.", content($(($body = $media)),+),
                    headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
                (status = 304, description = "The client has it."),
            )
        )]
        pub(in crate::http) async fn $name(
            State(site): State<Site>,
            Path(id): Path<String>,
            headers: HeaderMap,
            params: Params,
        ) -> Result<Response, Problem> {
            answer(&site, &id, &headers, params, $parameter, &$forms).await
        }
    };
}

result! {
    /// The plan
    plan, "get_plan", "/jobs/{id}/plan", PLAN, "format" JsonForm, ("application/json", PlanDocument)
}
result! {
    /// The robot program
    ///
    /// As neutral JSON, as a table, or in the language of a controller (`params.dialects`). KUKA's has two files, `krl` and
    /// `krl_dat`. A language in which the program cannot be said has none: `result_not_found` with the reason.
    program, "get_program", "/jobs/{id}/program", PROGRAM, "dialect" Dialect,
    ("application/json", ProgramDocument), ("text/csv", String), ("text/x-hans-cps", String), ("text/x-urscript", String),
    ("text/x-rapid", String), ("text/x-krl", String), ("text/x-krl-dat", String), ("text/x-fanuc-ls", String),
    ("text/x-python", String)
}
result! {
    /// The robot program of the second setup
    program_2, "get_program_2", "/jobs/{id}/program-2", PROGRAM_2, "dialect" Dialect,
    ("application/json", ProgramDocument), ("text/csv", String), ("text/x-hans-cps", String), ("text/x-urscript", String),
    ("text/x-rapid", String), ("text/x-krl", String), ("text/x-krl-dat", String), ("text/x-fanuc-ls", String),
    ("text/x-python", String)
}
result! {
    /// The robot program of the third setup
    program_3, "get_program_3", "/jobs/{id}/program-3", PROGRAM_3, "dialect" Dialect,
    ("application/json", ProgramDocument), ("text/csv", String), ("text/x-hans-cps", String), ("text/x-urscript", String),
    ("text/x-rapid", String), ("text/x-krl", String), ("text/x-krl-dat", String), ("text/x-fanuc-ls", String),
    ("text/x-python", String)
}
result! {
    /// The robot program of the fourth setup
    program_4, "get_program_4", "/jobs/{id}/program-4", PROGRAM_4, "dialect" Dialect,
    ("application/json", ProgramDocument), ("text/csv", String), ("text/x-hans-cps", String), ("text/x-urscript", String),
    ("text/x-rapid", String), ("text/x-krl", String), ("text/x-krl-dat", String), ("text/x-fanuc-ls", String),
    ("text/x-python", String)
}
result! {
    /// The chosen viewpoints
    viewpoints, "get_viewpoints", "/jobs/{id}/viewpoints", VIEWPOINTS, "format" ListForm,
    ("application/json", ViewpointsDocument), ("text/csv", String)
}
result! {
    /// What is covered, and how well
    coverage, "get_coverage", "/jobs/{id}/coverage", COVERAGE, "format" ListForm,
    ("application/json", CoverageListing), ("text/csv", String)
}
result! {
    /// What is missed, and why
    missed, "get_missed", "/jobs/{id}/missed", MISSED, "format" JsonForm, ("application/json", MissedListing)
}
result! {
    /// Seconds spent in each stage
    timings, "get_timings", "/jobs/{id}/timings", TIMINGS, "format" JsonForm, ("application/json", super::super::openapi::StageSeconds)
}
result! {
    /// The report for people
    report, "get_report", "/jobs/{id}/report", REPORT, "format" ReportForm,
    ("text/html", String), ("text/plain", String)
}
result! {
    /// One byte a face of the preview
    ///
    /// The best grade by area majority, or why the face is missed.
    coverage_bin, "get_coverage_bin", "/jobs/{id}/coverage.bin", COVERAGE_BIN, "format" BinaryForm,
    ("application/octet-stream", super::super::openapi::Bytes)
}

/// One of the files that came out, by name
#[utoipa::path(
    get,
    path = "/jobs/{id}/files/{name}",
    tag = "results",
    operation_id = "get_job_file",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("name" = String, Path, description = "Name of the file, as in the job's `results`."),
    ),
    responses(
        (status = 200, description = "The file; it never changes.", content(
            (Object = "application/json"), (String = "text/csv"), (String = "text/html"), (String = "text/plain"),
            (inline(super::super::openapi::Bytes) = "application/octet-stream"),
        )),
        (status = 304, description = "The client has it."),
    )
)]
pub(in crate::http) async fn file(
    State(site): State<Site>,
    Path((id, name)): Path<(String, String)>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, Problem> {
    params.end()?;
    let id = job_id(&id)?;
    let file = site.app.result(id, &name).await?;
    let media_type = match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "json" => JSON,
        "csv" => CSV,
        "html" => HTML,
        "txt" | "cps" | "script" | "mod" | "src" | "dat" | "ls" | "py" => TEXT,
        _ => BYTES,
    };
    give(&file, &headers, media_type).await
}
