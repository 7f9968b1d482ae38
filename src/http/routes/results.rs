//! Results of a job. A result never changes: its tag is the hash of its bytes.

use std::borrow::Cow;
use std::collections::BTreeMap;

use axum::extract::{Path, State};
use axum::http::header::{
    CONTENT_DISPOSITION, CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_SECURITY_POLICY, CONTENT_TYPE, VARY,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use super::{immutable, job_id, not_modified, streamed};
use crate::http::download::{
    AskedPart, Disposition, PartReader, asked_part, beyond_end, content_disposition, content_range, result_name,
};
use crate::http::extract::Params;
use crate::http::layers::weaken;
use crate::http::negotiate::{Representation, accepts_gzip, choose};
use crate::http::openapi::ProgramDialect;
use crate::http::problem::{ApiError, Code};
use crate::http::router::ApiState;
use crate::planning::params::DialectParams;
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
pub(super) const REPORT_POLICY: HeaderValue =
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
    dialects.sort_by_key(|dialect| !dialect.is_table());
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

/// Way in which the form of a result is chosen.
#[derive(Clone, Copy)]
enum FormChoice {
    /// Asked for by `Accept`, or by the query parameter of this name.
    Asked(&'static str),
    /// Fixed: the form of this name alone.
    Only(&'static str),
}

/// Responds with a result in the form chosen.
async fn answer(
    state: &ApiState,
    id: &str,
    headers: &HeaderMap,
    mut params: Params,
    choice: FormChoice,
    offered: &[Representation],
) -> Result<Response, ApiError> {
    let (parameter, name, force) = match choice {
        FormChoice::Asked(parameter) => (parameter, params.text(parameter), parameter == DIALECT && is_forced(&mut params)?),
        FormChoice::Only(form) => ("format", Some(form.to_owned()), false),
    };
    params.deny_unknown()?;
    asked_form(state, id, headers, AskedForm { parameter, name: name.as_deref(), force }, offered).await
}

/// Reads the query parameter that asks for the program of another maker's robots.
fn is_forced(params: &mut Params) -> Result<bool, ApiError> {
    Ok(params.value("force", "true or false")?.unwrap_or(false))
}

/// Form of a result that a request asks for.
#[derive(Clone, Copy)]
struct AskedForm<'a> {
    /// Parameter that names it.
    parameter: &'static str,
    /// Name of the form; `None` for the one that `Accept` prefers.
    name: Option<&'a str>,
    /// Send the program of another maker's robots too.
    force: bool,
}

/// Responds with a result in the form asked for.
async fn asked_form(
    state: &ApiState,
    id: &str,
    headers: &HeaderMap,
    asked: AskedForm<'_>,
    offered: &[Representation],
) -> Result<Response, ApiError> {
    let id = job_id(id)?;
    // The job is looked up before the representation is chosen: an unknown job is 404, whatever the representation.
    state.app.job_state(id).await?;
    let chosen = choose(headers, asked.name.map(|name| (asked.parameter, name)), offered)?;
    let file = found(state, id, &chosen.file, asked.force).await?;
    let shown = [JSON, HTML, TEXT].contains(&chosen.media_type);
    let disposition = if shown { Disposition::Inline } else { Disposition::Attachment };
    let name = match controller_name(state, id, chosen).await? {
        Some(name) => name,
        None => name_of(state, id, &chosen.file).await?,
    };
    let disposition = content_disposition(disposition, &name);
    respond(state, &file, headers, chosen.media_type, disposition).await
}

/// File name that a controller asks for, of a program in a language with such a rule.
async fn controller_name(state: &ApiState, id: JobId, chosen: &Representation) -> Result<Option<String>, ApiError> {
    let is_of = |dialect: &Dialect| dialect.outputs().iter().any(|output| output.format == chosen.name);
    let Some((dialect, (stem, extension))) = Dialect::ALL.into_iter().find(is_of).zip(chosen.file.rsplit_once('.')) else {
        return Ok(None);
    };
    let number = stem.rsplit_once('-').and_then(|(_, number)| number.parse::<usize>().ok());
    let setup = number.map_or(0, |number| number.saturating_sub(1));
    // Asked of a few languages alone: for it the job is read.
    if dialect.file_stem(&DialectParams::default(), setup).is_none() {
        return Ok(None);
    }
    let params = state.app.job(id).await?.params;
    Ok(dialect.file_stem(&params.dialects, setup).map(|stem| format!("{stem}.{extension}")))
}

/// File name under which a result is kept.
async fn name_of(state: &ApiState, id: JobId, file: &str) -> Result<String, ApiError> {
    Ok(result_name(&state.app.part_names(id).await?, &id.to_string(), file))
}

/// Responds with a result or a part of it; the whole compressed as stored if the client accepts that.
pub(super) async fn respond(
    state: &ApiState,
    file: &ResultBody,
    headers: &HeaderMap,
    media_type: &'static str,
    disposition: HeaderValue,
) -> Result<Response, ApiError> {
    let mut response = match not_modified(headers, file.sha256())? {
        Some(response) => response,
        None => with_bytes(state, file, headers, media_type, disposition).await?,
    };
    add_shared_headers(&mut response, is_sent_packed(file, headers), media_type);
    Ok(response)
}

/// Adds the headers that a result has with its bytes and without: a cache takes over those of a 304 response.
pub(super) fn add_shared_headers(response: &mut Response, is_sent_packed: bool, media_type: &str) {
    if is_sent_packed && response.status() == StatusCode::NOT_MODIFIED {
        weaken(response.headers_mut());
    }
    response.headers_mut().insert(VARY, HeaderValue::from_static("accept, accept-encoding"));
    if media_type == HTML {
        response.headers_mut().insert(CONTENT_SECURITY_POLICY, REPORT_POLICY);
    }
}

/// A result or a part of it, for a client that does not have it.
async fn with_bytes(
    state: &ApiState,
    file: &ResultBody,
    headers: &HeaderMap,
    media_type: &'static str,
    disposition: HeaderValue,
) -> Result<Response, ApiError> {
    let length = file.size_bytes(false);
    let part = asked_part(headers, &format!("\"{}\"", file.sha256()), length);
    let mut response = match &part {
        AskedPart::BeyondEnd => return Ok(beyond_end(length)),
        AskedPart::Whole => full_body(state, file, headers).await?,
        AskedPart::Bytes(bytes) => {
            let reader = PartReader::new(file.open(false).await?, bytes);
            let body = streamed(Box::new(reader), state.downloads.clone());
            let about = [(CONTENT_LENGTH, (bytes.end - bytes.start).into()), (CONTENT_RANGE, content_range(bytes, length))];
            (StatusCode::PARTIAL_CONTENT, about, body).into_response()
        }
    };
    response.headers_mut().extend(immutable(file.sha256(), media_type));
    response.headers_mut().insert(CONTENT_DISPOSITION, disposition);
    Ok(response)
}

/// Returns true if the result as a whole is sent compressed as stored.
fn is_sent_packed(file: &ResultBody, headers: &HeaderMap) -> bool {
    file.is_packed() && accepts_gzip(headers)
}

/// A result as a whole.
async fn full_body(state: &ApiState, file: &ResultBody, headers: &HeaderMap) -> Result<Response, ApiError> {
    let packed = is_sent_packed(file, headers);
    let mut response = streamed(file.open(packed).await?, state.downloads.clone()).into_response();
    response.headers_mut().insert(CONTENT_LENGTH, file.size_bytes(packed).into());
    if packed {
        response.headers_mut().insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    Ok(response)
}

/// A result. A program in the language of another maker than the robot's only with `force`, whichever release stored it.
async fn found(state: &ApiState, id: JobId, name: &str, force: bool) -> Result<ResultBody, ApiError> {
    let file = match state.app.result(id, name).await {
        Err(missing @ Error::NoSuchResult { .. }) => return foreign_program(state, id, name, force, missing).await,
        found => found?,
    };
    match state.app.foreign_reason(id, name).await? {
        Some(reason) if !force => {
            let detail =
                format!("{reason}; force=true sends it, without a warning in its header, since an earlier release wrote it");
            Err(ApiError::new(Code::ForeignDialect, detail))
        }
        _ => Ok(file),
    }
}

/// A program in the language of another maker than the robot's, which `force` asks for all the same. Everything else that there
/// is no result of is the error `missing`, or the reason if planning recorded one.
async fn foreign_program(state: &ApiState, id: JobId, name: &str, force: bool, missing: Error) -> Result<ResultBody, ApiError> {
    let found = match foreign_name(name) {
        Some(foreign) => state.app.result(id, &foreign).await,
        None => Err(missing.clone()),
    };
    match found {
        Ok(file) if force => Ok(file),
        Ok(_) => {
            let reason = reason(state, id, name).await.unwrap_or_else(|| format!("{name} is for another maker's robots"));
            Err(ApiError::new(Code::ForeignDialect, format!("{reason}; force=true sends it with a warning in its header")))
        }
        Err(Error::NoSuchResult { .. }) => Err(match reason(state, id, name).await {
            Some(reason) => ApiError::new(Code::ResultNotFound, format!("there is no {name}: {reason}")),
            None => missing.into(),
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

/// Query parameter that asks a route for the form of its result.
pub(in crate::http) struct AskedParameter {
    /// Path of the route below that of the API.
    pub path: &'static str,
    /// Name of the parameter.
    pub name: &'static str,
    /// Form that the route documents: the one that it gives without the parameter.
    pub form: &'static str,
    /// Forms that the route gives beside that one.
    pub others: Vec<Representation>,
}

/// Defines the routes of results: of each its media type in the API document, and how its form is chosen of all that are offered.
macro_rules! results {
    ($(
        $(#[doc = $doc:literal])+
        $name:ident, $id:literal, $path:literal, $offered:expr, $choice:expr,
        ($media:literal, $body:ty);
    )+) => {
        $(
            $(#[doc = $doc])+
            #[utoipa::path(
                get,
                path = $path,
                tag = "results",
                operation_id = $id,
                params(("id" = uuid::Uuid, Path, description = "Id of the job.")),
                responses(
                    (status = 200, description = "The result; it never changes.", content(($body = $media)),
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
                answer(&state, &id, &headers, params, $choice, &$offered).await
            }
        )+

        /// Parameters of the routes whose form a request may ask for.
        pub(in crate::http) fn asked_parameters() -> Vec<AskedParameter> {
            let routes = [$(($path, $choice, $offered.into_iter().collect::<Vec<_>>())),+];
            let asked = routes.into_iter().filter_map(|(path, choice, offered)| match choice {
                FormChoice::Asked(name) => {
                    let mut offered = offered.into_iter();
                    Some(AskedParameter { path, name, form: offered.next()?.name, others: offered.collect() })
                }
                FormChoice::Only(_) => None,
            });
            asked.collect()
        }
    };
}

/// Defines the route of a setup's program as text.
macro_rules! program_text {
    ($(#[doc = $doc:literal])+ $name:ident, $id:literal, $path:literal, $setup:literal) => {
        $(#[doc = $doc])+
        #[utoipa::path(
            get,
            path = $path,
            tag = "results",
            operation_id = $id,
            params(
                ("id" = uuid::Uuid, Path, description = "Id of the job."),
                ("dialect" = ProgramDialect, Path, description = "Language of the program, or `csv`."),
                ("force" = Option<bool>, Query, example = false,
                    description = "`true`: send the program even if its language is for another maker's robots."),
            ),
            responses(
                (status = 200, description = "The program; it never changes.", content((String = "text/plain")),
                    headers(("ETag" = String, description = "Strong tag: SHA-256 of the bytes."))),
                (status = 304, description = "The client has the current version."),
            )
        )]
        pub(in crate::http) async fn $name(
            State(state): State<ApiState>,
            Path((id, dialect)): Path<(String, String)>,
            headers: HeaderMap,
            mut params: Params,
        ) -> Result<Response, ApiError> {
            let asked = AskedForm { parameter: DIALECT, name: Some(&dialect), force: is_forced(&mut params)? };
            params.deny_unknown()?;
            program_as_text(&state, &id, asked, &headers, $setup).await
        }
    };
}

/// Responds with the program of a setup as plain text, whatever the dialect.
async fn program_as_text(
    state: &ApiState,
    id: &str,
    asked: AskedForm<'_>,
    headers: &HeaderMap,
    setup: usize,
) -> Result<Response, ApiError> {
    let mut offered = programs(setup);
    offered.retain(|form| form.media_type != JSON);
    let dialect = asked.name.unwrap_or_default();
    if offered.iter().all(|form| form.name != dialect) {
        let known: Vec<&str> = offered.iter().map(|form| form.name).collect();
        let detail = format!("there is no dialect {dialect:?}; known are {}", known.join(", "));
        return Err(ApiError::new(Code::ResultNotFound, detail));
    }
    let mut response = asked_form(state, id, headers, asked, &offered).await?;
    if response.status().is_success() {
        response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(TEXT));
    }
    Ok(response)
}

results! {
    /// Get the plan
    plan, "get_plan", "/jobs/{id}/plan", PLAN, FormChoice::Asked("format"), ("application/json", PlanDocument);
    /// Get the robot program
    ///
    /// The program as neutral JSON. `/jobs/{id}/program/{dialect}`, or the query parameter `dialect` of this route, gives it as a
    /// table or in the language of a robot controller.
    program, "get_program", "/jobs/{id}/program", programs(0), FormChoice::Asked("dialect"),
    ("application/json", ProgramDocument);
    /// Get the robot program of the second setup
    program_2, "get_program_2", "/jobs/{id}/program-2", programs(1), FormChoice::Asked("dialect"),
    ("application/json", ProgramDocument);
    /// Get the robot program of the third setup
    program_3, "get_program_3", "/jobs/{id}/program-3", programs(2), FormChoice::Asked("dialect"),
    ("application/json", ProgramDocument);
    /// Get the robot program of the fourth setup
    program_4, "get_program_4", "/jobs/{id}/program-4", programs(3), FormChoice::Asked("dialect"),
    ("application/json", ProgramDocument);
    /// Get the chosen viewpoints
    viewpoints, "get_viewpoints", "/jobs/{id}/viewpoints", VIEWPOINTS, FormChoice::Asked("format"),
    ("application/json", ViewpointsDocument);
    /// Get the chosen viewpoints as a table
    viewpoints_csv, "get_viewpoints_csv", "/jobs/{id}/viewpoints.csv", VIEWPOINTS, FormChoice::Only("csv"), ("text/csv", String);
    /// Get the coverage and its quality
    coverage, "get_coverage", "/jobs/{id}/coverage", COVERAGE, FormChoice::Asked("format"), ("application/json", CoverageListing);
    /// Get the coverage of each face as a table
    coverage_csv, "get_coverage_csv", "/jobs/{id}/coverage.csv", COVERAGE, FormChoice::Only("csv"), ("text/csv", String);
    /// Get the missed area and its causes
    missed, "get_missed", "/jobs/{id}/missed", MISSED, FormChoice::Asked("format"), ("application/json", MissedListing);
    /// Get all candidates, with the matrices of visibility and of quality
    ///
    /// Present if the job has `params.output.candidates`. If the file would be too large, the response is `result_not_found`
    /// with the reason.
    candidates, "get_candidates", "/jobs/{id}/candidates", CANDIDATES, FormChoice::Asked("format"),
    ("application/json", CandidateListing);
    /// Get the seconds spent in each stage
    timings, "get_timings", "/jobs/{id}/timings", TIMINGS, FormChoice::Asked("format"),
    ("application/json", super::super::openapi::StageSeconds);
    /// Get the report
    ///
    /// A job that failed with `no_plan` has one too: the reasons, with pictures of what is in the way.
    report, "get_report", "/jobs/{id}/report", REPORT, FormChoice::Asked("format"), ("text/html", String);
    /// Get the report as plain text
    report_text, "get_report_text", "/jobs/{id}/report.txt", REPORT, FormChoice::Only("text"), ("text/plain", String);
    /// Get the coverage of each face of the preview
    ///
    /// One byte per face: its best grade, by area majority, or the cause for which it is missed.
    coverage_bin, "get_coverage_bin", "/jobs/{id}/coverage.bin", COVERAGE_BIN, FormChoice::Asked("format"),
    ("application/octet-stream", super::super::openapi::Bytes);
}

program_text! {
    /// Get the robot program as text
    ///
    /// The program as a table (`csv`) or in the language of a robot controller (see `params.dialects`). For KUKA there are two
    /// files, `krl` and `krl_dat`. If a language cannot express the program, the response is `result_not_found` with the reason.
    /// If the language is not the one that the robot's specification names (`dialect`), nor `csv` or `robodk`, the response is
    /// `foreign_dialect`; with `force=true`, it is the program with a warning in its header. The head of the file gives the file
    /// name that the controller expects.
    program_text, "get_program_text", "/jobs/{id}/program/{dialect}", 0
}
program_text! {
    /// Get the robot program of the second setup as text
    program_text_2, "get_program_2_text", "/jobs/{id}/program-2/{dialect}", 1
}
program_text! {
    /// Get the robot program of the third setup as text
    program_text_3, "get_program_3_text", "/jobs/{id}/program-3/{dialect}", 2
}
program_text! {
    /// Get the robot program of the fourth setup as text
    program_text_4, "get_program_4_text", "/jobs/{id}/program-4/{dialect}", 3
}

/// Download a result file by name
///
/// The file, byte for byte. `Range` gives a part of it (RFC 9110, section 14), so that a download can be resumed.
#[utoipa::path(
    get,
    path = "/jobs/{id}/files/{name}",
    tag = "results",
    operation_id = "get_job_file",
    params(
        ("id" = uuid::Uuid, Path, description = "Id of the job."),
        ("name" = String, Path, description = "Name of the file, as in the job's `results`.", example = "plan.json",
            pattern = "^[A-Za-z0-9._-]+$"),
        ("Range" = Option<String>, Header, description = "One range of bytes, for example `bytes=0-99`."),
        ("If-Range" = Option<String>, Header, description = "Entity tag of the version that the range is for; if the file is another version, the whole of it is sent."),
    ),
    responses(
        (status = 200, description = "The file; it never changes.", content_type = "application/octet-stream", body = inline(super::super::openapi::Bytes)),
        (status = 206, description = "The requested part of the file.", content_type = "application/octet-stream", body = inline(super::super::openapi::Bytes)),
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
    let file = found(&state, id, &name, false).await?;
    let attachment = content_disposition(Disposition::Attachment, &name_of(&state, id, &name).await?);
    respond(&state, &file, &headers, BYTES, attachment).await
}
