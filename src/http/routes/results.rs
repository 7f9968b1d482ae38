//! Results of a job. A result never changes: its tag is the hash of its bytes.

use std::borrow::Cow;
use std::collections::BTreeMap;

use axum::extract::{Path, State};
use axum::http::header::{CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_SECURITY_POLICY, VARY};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};

use super::{immutable, job_id, not_modified, streamed};
use crate::http::extract::Params;
use crate::http::negotiate::{Representation, accepts_gzip, choose};
use crate::http::openapi::{BinaryFormat, JsonFormat, ListFormat, ProgramFormat, ReportFormat};
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::program::dialects::Dialect;
use crate::service::plan_job::{REFUSED_FILE, foreign_name, program_stem};
use crate::service::{Error, ResultBody};
use crate::wire::JobId;
use crate::wire::candidates::{CANDIDATES_FILE, CandidateListing};
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
/// Content security policy of a report, a single file with embedded images and styles: it loads nothing and runs nothing.
const REPORT_POLICY: HeaderValue =
    HeaderValue::from_static("default-src 'none'; img-src data:; style-src 'unsafe-inline'; frame-ancestors 'none'; sandbox");

const fn representation(name: &'static str, media_type: &'static str, file: &'static str) -> Representation {
    Representation { name, media_type, file: Cow::Borrowed(file) }
}

/// Query parameter that chooses the language of a program.
const DIALECT: &str = "dialect";
const PLAN: [Representation; 1] = [representation("json", JSON, "plan.json")];
/// Representations of a setup's program: neutral, then in every dialect, the table first. Their media types are not
/// standardised; they keep `Accept: text/plain` from matching one of them.
fn programs(setup: usize) -> Vec<Representation> {
    let stem = program_stem(setup);
    let neutral = Representation { name: "json", media_type: JSON, file: format!("{stem}.json").into() };
    let mut dialects = Dialect::ALL;
    dialects.sort_by_key(|dialect| *dialect != Dialect::Csv);
    let outputs = dialects.into_iter().flat_map(|dialect| dialect.outputs()).map(|output| Representation {
        name: output.format,
        media_type: output.media_type,
        file: format!("{stem}.{}", output.extension).into(),
    });
    std::iter::once(neutral).chain(outputs).collect()
}

const VIEWPOINTS: [Representation; 2] =
    [representation("json", JSON, "viewpoints.json"), representation("csv", CSV, "viewpoints.csv")];
const COVERAGE: [Representation; 2] = [representation("json", JSON, "coverage.json"), representation("csv", CSV, "coverage.csv")];
const MISSED: [Representation; 1] = [representation("json", JSON, "missed.json")];
const CANDIDATES: [Representation; 1] = [representation("json", JSON, CANDIDATES_FILE)];
const TIMINGS: [Representation; 1] = [representation("json", JSON, "timings.json")];
const REPORT: [Representation; 2] = [representation("html", HTML, "report.html"), representation("text", TEXT, "report.txt")];
const COVERAGE_BIN: [Representation; 1] = [representation("bin", BYTES, "coverage.bin")];

/// Responds with a result in the representation asked for, by `Accept` or by the query parameter `parameter`.
async fn negotiated(
    state: &ApiState,
    id: &str,
    headers: &HeaderMap,
    mut params: Params,
    parameter: &str,
    offered: &[Representation],
) -> Result<Response, ApiError> {
    let asked = params.text(parameter);
    let force = parameter == DIALECT && params.value::<bool>("force")?.unwrap_or(false);
    params.deny_unknown()?;
    let id = job_id(id)?;
    // The job is looked up before the representation is chosen: an unknown job is 404, whatever the representation.
    state.app.job_state(id).await?;
    let chosen = choose(headers, asked.as_deref(), offered)?;
    let file = match state.app.result(id, &chosen.file).await {
        Err(Error::NoSuchResult { .. }) => foreign_program(state, id, &chosen.file, force).await?,
        found => found?,
    };
    respond(state, &file, headers, chosen.media_type).await
}

/// Responds with a result, compressed as stored if the client accepts that.
async fn respond(
    state: &ApiState,
    file: &ResultBody,
    headers: &HeaderMap,
    media_type: &'static str,
) -> Result<Response, ApiError> {
    if let Some(response) = not_modified(headers, file.sha256()) {
        return Ok(response);
    }
    let packed = file.is_packed() && accepts_gzip(headers);
    let body = streamed(file.open(packed).await?, state.downloads.clone());
    let mut response = (immutable(file.sha256(), media_type), body).into_response();
    let response_headers = response.headers_mut();
    response_headers.insert(CONTENT_LENGTH, file.size_bytes(packed).into());
    response_headers.insert(VARY, HeaderValue::from_static("accept, accept-encoding"));
    if packed {
        response_headers.insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    if media_type == HTML {
        response_headers.insert(CONTENT_SECURITY_POLICY, REPORT_POLICY);
    }
    Ok(response)
}

/// A program in the language of another maker than the robot's, which `force` asks for all the same. Everything else that there
/// is no result of is an error, with the reason if planning recorded one.
async fn foreign_program(state: &ApiState, id: JobId, name: &str, force: bool) -> Result<ResultBody, ApiError> {
    let found = match foreign_name(name) {
        Some(foreign) => state.app.result(id, &foreign).await,
        None => Err(Error::NoSuchResult { job: id, name: name.to_owned() }),
    };
    match found {
        Ok(file) if force => Ok(file),
        Ok(_) => {
            let reason = reason(state, id, name).await.unwrap_or_else(|| format!("{name} is for another maker's robots"));
            Err(ApiError::new(Code::ForeignDialect, format!("{reason}; force=true sends it with a warning in its header")))
        }
        Err(Error::NoSuchResult { .. }) => Err(match reason(state, id, name).await {
            Some(reason) => ApiError::new(Code::ResultNotFound, format!("there is no {name}: {reason}")),
            None => Error::NoSuchResult { job: id, name: name.to_owned() }.into(),
        }),
        Err(error) => Err(error.into()),
    }
}

/// Reason that planning recorded for the lack of a result, as for dialects.
async fn reason(state: &ApiState, id: JobId, name: &str) -> Option<String> {
    let file = state.app.result(id, REFUSED_FILE).await.ok()?;
    let bytes = file.read().await.ok()?;
    serde_json::from_slice::<BTreeMap<String, String>>(&bytes).ok()?.remove(name)
}

macro_rules! result {
    (
        $(#[doc = $doc:literal])+
        $name:ident, $id:literal, $path:literal, $offered:expr, $parameter:literal $choice:ident $([$($more:tt)+])?,
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
                ($parameter = inline(Option<$choice>), Query, description = "Format of the result; takes precedence over `Accept`."),
                $($($more)+)?
            ),
            responses(
                (status = 200, description = "The result; it never changes.", content($(($body = $media)),+),
                    headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
                (status = 304, description = "The client has the current version."),
            )
        )]
        pub(in crate::http) async fn $name(
            State(state): State<ApiState>,
            Path(id): Path<String>,
            headers: HeaderMap,
            params: Params,
        ) -> Result<Response, ApiError> {
            negotiated(&state, &id, &headers, params, $parameter, &$offered).await
        }
    };
}

result! {
    /// Get the plan
    plan, "get_plan", "/jobs/{id}/plan", PLAN, "format" JsonFormat, ("application/json", PlanDocument)
}
result! {
    /// Get the robot program
    ///
    /// As neutral JSON, as a table, or in the language of a robot controller (see `params.dialects`). For KUKA there are two
    /// files, `krl` and `krl_dat`. If a language cannot express the program, the response is `result_not_found` with the
    /// reason. If it is not the one that the robot's specification names (`dialect`), nor `csv` or `robodk`, the response is
    /// `foreign_dialect`; with `force=true` it is the program, with a warning in its header.
    program, "get_program", "/jobs/{id}/program", programs(0), "dialect" ProgramFormat
    [("force" = Option<bool>, Query, description = "Send a program in the language of another maker than the robot's too.")],
    ("application/json", ProgramDocument)
}
result! {
    /// Get the robot program of the second setup
    program_2, "get_program_2", "/jobs/{id}/program-2", programs(1), "dialect" ProgramFormat
    [("force" = Option<bool>, Query, description = "Send a program in the language of another maker than the robot's too.")],
    ("application/json", ProgramDocument)
}
result! {
    /// Get the robot program of the third setup
    program_3, "get_program_3", "/jobs/{id}/program-3", programs(2), "dialect" ProgramFormat
    [("force" = Option<bool>, Query, description = "Send a program in the language of another maker than the robot's too.")],
    ("application/json", ProgramDocument)
}
result! {
    /// Get the robot program of the fourth setup
    program_4, "get_program_4", "/jobs/{id}/program-4", programs(3), "dialect" ProgramFormat
    [("force" = Option<bool>, Query, description = "Send a program in the language of another maker than the robot's too.")],
    ("application/json", ProgramDocument)
}
result! {
    /// Get the chosen viewpoints
    viewpoints, "get_viewpoints", "/jobs/{id}/viewpoints", VIEWPOINTS, "format" ListFormat,
    ("application/json", ViewpointsDocument), ("text/csv", String)
}
result! {
    /// Get the coverage and its quality
    coverage, "get_coverage", "/jobs/{id}/coverage", COVERAGE, "format" ListFormat,
    ("application/json", CoverageListing), ("text/csv", String)
}
result! {
    /// Get the missed area and its causes
    missed, "get_missed", "/jobs/{id}/missed", MISSED, "format" JsonFormat, ("application/json", MissedListing)
}
result! {
    /// Get all candidates, with the matrices of visibility and of quality
    ///
    /// Present if the job has `params.output.candidates`. If the file would be too large, the response is `result_not_found`
    /// with the reason.
    candidates, "get_candidates", "/jobs/{id}/candidates", CANDIDATES, "format" JsonFormat,
    ("application/json", CandidateListing)
}
result! {
    /// Get the seconds spent in each stage
    timings, "get_timings", "/jobs/{id}/timings", TIMINGS, "format" JsonFormat, ("application/json", super::super::openapi::StageSeconds)
}
result! {
    /// Get the report
    ///
    /// A job that failed with `no_plan` has one too: the reasons, with pictures of what is in the way.
    report, "get_report", "/jobs/{id}/report", REPORT, "format" ReportFormat,
    ("text/html", String), ("text/plain", String)
}
result! {
    /// Get the coverage of each face of the preview
    ///
    /// One byte per face: its best grade, by area majority, or the cause for which it is missed.
    coverage_bin, "get_coverage_bin", "/jobs/{id}/coverage.bin", COVERAGE_BIN, "format" BinaryFormat,
    ("application/octet-stream", super::super::openapi::Bytes)
}

/// Download a result file by name
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
        (status = 304, description = "The client has the current version."),
    )
)]
pub(in crate::http) async fn file(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    headers: HeaderMap,
    params: Params,
) -> Result<Response, ApiError> {
    params.deny_unknown()?;
    let id = job_id(&id)?;
    let file = match state.app.result(id, &name).await {
        Err(Error::NoSuchResult { .. }) => foreign_program(&state, id, &name, false).await?,
        found => found?,
    };
    let media_type = match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "json" => JSON,
        "csv" => CSV,
        "html" => HTML,
        "txt" => TEXT,
        extension if is_program(extension) => TEXT,
        _ => BYTES,
    };
    respond(&state, &file, &headers, media_type).await
}

/// True if files of this extension are programs in some dialect.
fn is_program(extension: &str) -> bool {
    Dialect::ALL.into_iter().flat_map(Dialect::outputs).any(|output| output.extension == extension)
}
