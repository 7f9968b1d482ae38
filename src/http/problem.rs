//! Problem responses (RFC 9457): every response other than 2xx and 3xx, and the only mapping from errors to status codes.
//!
//! A handler returns an [`ApiError`]; [`finish`], which knows the request's path and id, renders it for the client. It also
//! turns errors of the framework (no such route, no such method, a rejected header) into problems, so that every error
//! response has the same format. The client gets what it can act on; the log gets the whole chain of causes.

use std::borrow::Cow;
use std::fmt::Write as _;

use axum::body::Body;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE, ETAG, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::prefix::Prefix;
use crate::cell::FieldError;
use crate::service::Error;
use crate::wire::{self, FailureCode, ParseError, ProblemField, problem_type};

/// Media type of problems.
pub(super) const PROBLEM_JSON: &str = "application/problem+json";
/// Delay before the next attempt that temporary problems suggest, seconds.
const RETRY_AFTER_SECS: &str = "5";

macro_rules! codes {
    ($($name:ident $code:literal $status:ident $title:literal $meaning:literal;)+) => {
        /// Problem codes. Their names are stable.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Code {
            $(#[doc = $meaning] $name,)+
        }

        impl Code {
            /// Every code, in the order of the document.
            pub const ALL: &[Self] = &[$(Self::$name),+];

            /// Stable name.
            #[must_use]
            pub fn as_str(self) -> &'static str {
                match self { $(Self::$name => $code),+ }
            }

            /// Status of the response.
            #[must_use]
            pub fn status(self) -> StatusCode {
                match self { $(Self::$name => StatusCode::$status),+ }
            }

            /// Short title.
            #[must_use]
            pub fn title(self) -> &'static str {
                match self { $(Self::$name => $title),+ }
            }

            /// Explanation, for the document.
            pub(super) fn meaning(self) -> &'static str {
                match self { $(Self::$name => $meaning),+ }
            }
        }
    };
}

codes! {
    BadRequest "bad_request" BAD_REQUEST "The request is malformed" "The request violates HTTP, or one of its headers is malformed.";
    BadQuery "bad_query" BAD_REQUEST "The query is invalid" "A query parameter is unknown, missing or out of range; `errors` names it.";
    BadJson "bad_json" BAD_REQUEST "The body is not valid JSON" "The body is not a valid JSON document.";
    BadBody "bad_body" BAD_REQUEST "The body cannot be read" "The body ended early, is empty, has a malformed chunk, or is not a valid multipart message.";
    UnexpectedBody "unexpected_body" BAD_REQUEST "The route takes no body" "A body was sent to a route that takes none, so nothing was done; `detail` says what to send instead. Empty bodies, white space, `{}` and `null` are accepted.";
    BadDigest "bad_digest" BAD_REQUEST "The digest is malformed" "`Content-Digest` is not `sha-256=:…:` (RFC 9530).";
    BadIdempotencyKey "bad_idempotency_key" BAD_REQUEST "The Idempotency-Key is invalid" "An `Idempotency-Key` must be 1 to 255 visible ASCII characters.";
    KeyMissing "key_missing" UNAUTHORIZED "A key is required" "This server requires its key: `Authorization: Bearer …`.";
    KeyWrong "key_wrong" UNAUTHORIZED "The key is wrong" "The key in `Authorization` is not this server's key.";
    CrossSite "cross_site" FORBIDDEN "Cross-site requests may not change anything" "According to the browser, another site's page sent this request, which would change something.";
    SessionEnded "session_ended" UNAUTHORIZED "The session has ended" "The cookie's session was ended, was unused for 12 hours, or was lost when the server restarted; begin a new one with `POST /api/v1/session`.";
    NoSuchRoute "no_such_route" NOT_FOUND "No such path" "The server has nothing at this path.";
    MeshNotFound "mesh_not_found" NOT_FOUND "No such mesh" "No mesh has this id.";
    JobNotFound "job_not_found" NOT_FOUND "No such job" "No job has this id.";
    SpecNotFound "spec_not_found" NOT_FOUND "No such specification" "Neither a preset nor a stored specification has this name.";
    RunNotFound "run_not_found" NOT_FOUND "No such run" "No run has this id.";
    CalibrationNotFound "calibration_not_found" NOT_FOUND "No such calibration" "No calibration has this id.";
    ScanNotFound "scan_not_found" NOT_FOUND "No such scan" "No scan has this id.";
    InspectionNotFound "inspection_not_found" NOT_FOUND "No such inspection" "No inspection has this id.";
    LeaseNotFound "lease_not_found" NOT_FOUND "No such lease" "No lease has this id: it was given back or not renewed in time. Take a new one.";
    ResultNotFound "result_not_found" NOT_FOUND "No such result" "The job, the inspection or the run has no such file: `GET /api/v1/jobs/{id}/program` of a job planned without a cell, or `GET /api/v1/jobs/{id}/program-2` of one with a single setup, for example. To start a run of such a program is `no_program`.";
    MethodNotAllowed "method_not_allowed" METHOD_NOT_ALLOWED "The method is not allowed" "The path does not support this method; `Allow` lists the methods that it does.";
    NotAcceptable "not_acceptable" NOT_ACCEPTABLE "The format is not available" "The response is not available in any media type of `Accept`, or not in the `format` or `dialect` of the query; `detail` lists the available ones.";
    RangeNotSatisfiable "range_not_satisfiable" RANGE_NOT_SATISFIABLE "The range lies beyond the end" "No byte of the requested `Range` exists; `Content-Range` states the length.";
    RequestTimeout "request_timeout" REQUEST_TIMEOUT "The body arrived too slowly" "The body stalled for longer than `server.body_idle_timeout_secs`, or arrived at less than 1024 bytes a second on average; send it over a faster connection.";
    MeshInUse "mesh_in_use" CONFLICT "The mesh is in use" "A job that has not ended needs the mesh, or a stored specification uses it as a body.";
    JobNotEnded "job_not_ended" CONFLICT "The job has not ended" "Only an ended job can be deleted; cancel it first.";
    JobInUse "job_in_use" CONFLICT "The job is in use" "An inspection or a run of the job has not ended; cancel or stop it first, or wait.";
    JobEnded "job_ended" CONFLICT "The job has ended" "A job that succeeded or failed cannot be cancelled.";
    JobNotQueued "job_not_queued" CONFLICT "The job is not queued" "Only a queued job can get another priority.";
    JobHeld "job_held" CONFLICT "The job is protected by a label" "The job has the hold label, which protects it, its scans, its inspections and its runs from deletion; remove the label with `PUT /api/v1/jobs/{id}/labels`.";
    NoResults "no_results" CONFLICT "The job has no results" "The job has not succeeded; `detail` gives its state.";
    ForeignDialect "foreign_dialect" CONFLICT "The language is for another maker's robots" "The robot's specification names another language, which `detail` states; request that one, `csv` or `robodk`, or send `force=true`.";
    LiveDisabled "live_disabled" FORBIDDEN "Live runs are switched off" "The setting `execution.live` does not allow runs to move arms and tables; rehearse with the mode `simulate` or `dry_run`.";
    NoControllers "no_controllers" CONFLICT "The cell has no controllers" "None of the operator's cell files (`execution.cells`) names the controllers of this cell; run the program in the mode `simulate`.";
    OtherCell "other_cell" CONFLICT "The cell differs from the planned one" "The operator's cell differs from the cell that the job was planned in; plan the part again in the operator's cell.";
    NoProgram "no_program" CONFLICT "The job has no such program" "`POST /api/v1/runs` names a job planned without a cell, or a setup that the job does not have. To read such a program is `result_not_found`.";
    CalibrationNotEnded "calibration_not_ended" CONFLICT "The calibration has not ended" "Only an ended calibration can be deleted; cancel it first, or wait.";
    CalibrationNotQueued "calibration_not_queued" CONFLICT "The calibration has ended" "Only a queued or running calibration can be cancelled; one that has ended never changes.";
    NoCalibration "no_calibration" CONFLICT "The calibration has no result" "The calibration has not succeeded, or cannot be written into a cell; `detail` says which.";
    ScanInUse "scan_in_use" CONFLICT "The scan is in use" "An inspection of its job has not ended.";
    NoScans "no_scans" CONFLICT "The job has no scans" "Upload the scans of its views with `POST /api/v1/jobs/{id}/scans` first.";
    InspectionNotEnded "inspection_not_ended" CONFLICT "The inspection has not ended" "Only an ended inspection can be deleted; cancel it first, or wait.";
    InspectionEnded "inspection_ended" CONFLICT "The inspection has ended" "An inspection that succeeded or failed cannot be cancelled.";
    NoInspection "no_inspection" CONFLICT "The inspection has no result" "The inspection has not succeeded; `detail` gives its state.";
    RunNotEnded "run_not_ended" CONFLICT "The run has not ended" "Only an ended run can be deleted; stop it first.";
    RunStateRefused "run_state_refused" CONFLICT "The run's state does not allow it" "`detail` gives the state of the run: only a ready run can be armed, and only a paused one resumed.";
    RunRefused "run_refused" CONFLICT "The run may not move" "A condition for motion is not met; `detail` says which, and what to do.";
    CellInUse "cell_in_use" CONFLICT "The cell is in use" "Another run that has not ended holds the cell's controllers.";
    LeaseHeld "lease_held" CONFLICT "The lease is held" "Another client holds the lease of the cell; `detail` says who, and until when.";
    TokenRefused "token_refused" CONFLICT "The fencing token is not valid" "The token in the query is not that of the cell's present lease: the lease ended, or another client holds it.";
    SpecInUse "spec_in_use" CONFLICT "The specification is in use" "A stored cell names the specification; change or delete the cell first.";
    SpecIsPreset "spec_is_preset" CONFLICT "A preset cannot be changed" "The name belongs to a preset that is built into the program.";
    PreconditionFailed "precondition_failed" PRECONDITION_FAILED "The precondition failed" "`If-Match` or `If-None-Match` does not hold; read the current version and try again.";
    TooLarge "too_large" PAYLOAD_TOO_LARGE "The body is too large" "The body is larger than the server allows; `detail` states the limit.";
    HostNotAllowed "host_not_allowed" MISDIRECTED_REQUEST "The server does not answer to this name" "The host of the request is not one of the server's names; `detail` says which setting allows it.";
    UnsupportedMediaType "unsupported_media_type" UNSUPPORTED_MEDIA_TYPE "The media type is not supported" "JSON bodies must be sent as `application/json`, and no body may be compressed.";
    BadShape "bad_shape" UNPROCESSABLE_ENTITY "The body has the wrong structure" "A field of the body is unknown, missing or of the wrong type; `errors` names it.";
    InvalidFields "invalid_fields" UNPROCESSABLE_ENTITY "Fields are out of range or inconsistent" "`errors` lists every field at fault, with its value and what is allowed.";
    BadPageToken "bad_page_token" UNPROCESSABLE_ENTITY "The page token is invalid" "The page token does not belong to this listing with these filters.";
    MeshUnreadable "mesh_unreadable" UNPROCESSABLE_ENTITY "The file is not a mesh that can be planned" "The file is not STL, OBJ or PLY, is damaged, or exceeds the limits; `detail` says where and why.";
    DigestMismatch "digest_mismatch" UNPROCESSABLE_ENTITY "The digest does not match the body" "The SHA-256 of the body, of a form also that of its file, differs from the one in `Content-Digest`: the body was changed in transit.";
    IdempotencyMismatch "idempotency_mismatch" UNPROCESSABLE_ENTITY "The Idempotency-Key was used for another request" "The same key was sent with a different request within 24 hours.";
    PreconditionRequired "precondition_required" PRECONDITION_REQUIRED "A precondition is required" "The specification exists; send its entity tag in `If-Match`.";
    LeaseRequired "lease_required" PRECONDITION_REQUIRED "A lease is required" "Moving a cell needs the fencing token of its lease (`POST /api/v1/leases`), as `?token=`.";
    TooManyRequests "too_many_requests" TOO_MANY_REQUESTS "The client is at its limit" "The client's address, of IPv6 its /64, has the maximum number of connections, event streams, uploads or waits open; `detail` says which. Close one, or try again after `Retry-After` seconds.";
    HeadersTooLarge "headers_too_large" REQUEST_HEADER_FIELDS_TOO_LARGE "The headers are too large" "The request line or the headers of the request are larger than the server allows.";
    Internal "internal" INTERNAL_SERVER_ERROR "Internal server error" "The server failed; its log has the cause under `request_id`.";
    FileDamaged "file_damaged" INTERNAL_SERVER_ERROR "A stored file is damaged" "The file is missing or does not match its hash, so it is not served. Upload the mesh again, plan the job again, or restore a backup.";
    UnsupportedTransferCoding "unsupported_transfer_coding" NOT_IMPLEMENTED "The transfer coding is not supported" "The only transfer coding that a body may have is `Transfer-Encoding: chunked` (RFC 9112, section 6.1).";
    Busy "busy" SERVICE_UNAVAILABLE "The server is busy" "The maximum number of connections, event streams, uploads or waits is open, the database is locked, or the machine is temporarily short of a resource; try again after `Retry-After` seconds.";
    QueueFull "queue_full" SERVICE_UNAVAILABLE "The queue is full" "The maximum number of jobs is queued; try again after `Retry-After` seconds.";
    TooManyRuns "too_many_runs" SERVICE_UNAVAILABLE "Too many runs are open" "The number of runs that have not ended has reached `execution.max_runs`; stop one, or try again after `Retry-After` seconds.";
    Stopping "stopping" SERVICE_UNAVAILABLE "The server is shutting down" "The server accepts no new work; try again after `Retry-After` seconds.";
    NotReady "not_ready" SERVICE_UNAVAILABLE "The server is not ready" "`errors` lists the failed checks, each with the reason and what to do.";
    TooSlow "too_slow" SERVICE_UNAVAILABLE "The response took too long" "The server did not respond in time; try again after `Retry-After` seconds.";
    StorageFull "storage_full" INSUFFICIENT_STORAGE "The disk is full" "The server's disk has no room left, or the rest is reserved for running jobs; try again after `Retry-After` seconds, or delete jobs and meshes.";
}

impl PartialSchema for Code {
    fn schema() -> RefOr<Schema> {
        ObjectBuilder::new()
            .schema_type(Type::String)
            .description(Some("Code of a problem that a response has, for programs."))
            .enum_values(Some(Self::ALL.iter().map(|code| code.as_str())))
            .into()
    }
}

impl ToSchema for Code {
    fn name() -> Cow<'static, str> {
        Cow::Borrowed("ProblemCode")
    }
}

/// An error response, before its request is known.
#[derive(Clone, Debug)]
pub(super) struct ApiError {
    code: Code,
    detail: String,
    errors: Vec<ProblemField>,
    etag: Option<String>,
    /// Cause, for the log.
    cause: Option<Error>,
}

impl ApiError {
    /// An error with this code.
    pub(super) fn new(code: Code, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into(), errors: Vec::new(), etag: None, cause: None }
    }

    /// Code of the error.
    #[cfg(test)]
    pub(super) fn code(&self) -> Code {
        self.code
    }

    /// An error with one field at fault.
    pub(super) fn at(code: Code, pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        let detail = detail.into();
        let field = ProblemField { pointer: pointer.into(), detail: detail.clone() };
        Self { errors: vec![field], ..Self::new(code, detail) }
    }

    /// Error whose cause goes to the log.
    fn caused(code: Code, detail: &str, cause: Error) -> Self {
        Self { cause: Some(cause), ..Self::new(code, detail) }
    }

    /// A query parameter at fault: a sentence, of which `said` is what follows the parameter's name.
    pub(super) fn query(name: &str, said: &str) -> Self {
        let field = ProblemField { pointer: name.to_owned(), detail: said.to_owned() };
        Self { errors: vec![field], ..Self::new(Code::BadQuery, format!("The query parameter {name:?} {said}.")) }
    }

    /// A header at fault: a sentence, of which `said` is what follows the header's name.
    pub(super) fn header(code: Code, name: &str, said: &str) -> Self {
        let field = ProblemField { pointer: name.to_owned(), detail: said.to_owned() };
        Self { errors: vec![field], ..Self::new(code, format!("The header {name} {said}.")) }
    }

    /// Adds the fields at fault.
    pub(super) fn with_errors(mut self, errors: Vec<ProblemField>) -> Self {
        self.errors = errors;
        self
    }

    /// Invalid fields; a single one is told in the detail, several as `all`.
    fn invalid(fields: Vec<ProblemField>, all: String) -> Self {
        let detail = if let [only] = &fields[..] { placed(only) } else { all };
        Self::new(Code::InvalidFields, detail).with_errors(fields)
    }

    /// Error told with the number of jobs that had been deleted before it.
    fn after_deletions(self, deleted: u64) -> Self {
        let detail = format!(
            "{}; {deleted} of the selected jobs had been deleted before this failure; send the request again for the others",
            self.detail
        );
        Self { detail, ..self }
    }

    fn with_etag(mut self, etag: Option<String>) -> Self {
        self.etag = etag;
        self
    }
}

impl From<Vec<ParseError>> for ApiError {
    fn from(errors: Vec<ParseError>) -> Self {
        let mut fields = Vec::with_capacity(errors.len());
        for error in errors {
            match error {
                ParseError::Syntax(detail) => return Self::new(Code::BadJson, detail),
                ParseError::Shape(FieldError { pointer, detail }) => fields.push(ProblemField { pointer, detail }),
            }
        }
        let detail = match &fields[..] {
            [whole] if whole.pointer.is_empty() => format!("the body: {}", whole.detail),
            [only] => placed(only),
            all => format!("{} fields are missing, unknown or of the wrong type; `errors` names each", all.len()),
        };
        Self::new(Code::BadShape, detail).with_errors(fields)
    }
}

/// One fault of a request with its field, as commands tell one of a file.
fn placed(field: &ProblemField) -> String {
    let ProblemField { pointer, detail } = field;
    if pointer.is_empty() { detail.clone() } else { format!("{pointer}: {detail}") }
}

/// Detail of a failure of the store that passes.
const BUSY: &str = "the store is temporarily unavailable: it is locked, or the machine is short of a resource; send the request again \
                    after the seconds in Retry-After";
/// Detail of a failure whose cause callers do not learn.
const INTERNAL: &str = "the request failed; the server's log has the cause under this request_id";

impl From<Error> for ApiError {
    fn from(error: Error) -> Self {
        let detail = error.to_string();
        match error {
            Error::MeshNotFound(_) => Self::new(Code::MeshNotFound, detail),
            Error::JobNotFound(_) => Self::new(Code::JobNotFound, detail),
            Error::SpecNotFound { .. } => Self::new(Code::SpecNotFound, detail),
            Error::NoSuchResult { .. } | Error::NoInspectionFile { .. } => Self::new(Code::ResultNotFound, detail),
            Error::NoResults { .. } => Self::new(Code::NoResults, detail),
            Error::RunNotFound(_) => Self::new(Code::RunNotFound, detail),
            Error::LeaseNotFound(_) => Self::new(Code::LeaseNotFound, detail),
            Error::LeaseHeld(_) => Self::new(Code::LeaseHeld, detail),
            Error::LeaseRequired { .. } => Self::at(Code::LeaseRequired, "token", detail),
            Error::TokenRefused(_) => Self::at(Code::TokenRefused, "token", detail),
            Error::LiveDisabled => Self::at(Code::LiveDisabled, "/mode", detail),
            Error::NoControllers { .. } => Self::at(Code::NoControllers, "/mode", detail),
            Error::OtherCell { .. } => Self::new(Code::OtherCell, detail),
            Error::NoProgram { .. } => Self::new(Code::NoProgram, detail),
            Error::CalibrationNotFound(_) => Self::new(Code::CalibrationNotFound, detail),
            Error::CalibrationNotEnded { .. } => Self::new(Code::CalibrationNotEnded, detail),
            Error::CalibrationNotQueued { .. } => Self::new(Code::CalibrationNotQueued, detail),
            Error::NoCalibration { .. } | Error::NotOnFlange(_) => Self::new(Code::NoCalibration, detail),
            Error::ScanNotFound(_) => Self::new(Code::ScanNotFound, detail),
            Error::ScanInUse(_) => Self::new(Code::ScanInUse, detail),
            Error::NoScans(_) => Self::new(Code::NoScans, detail),
            Error::InspectionNotFound(_) => Self::new(Code::InspectionNotFound, detail),
            Error::InspectionNotEnded { .. } => Self::new(Code::InspectionNotEnded, detail),
            Error::InspectionEnded { .. } => Self::new(Code::InspectionEnded, detail),
            Error::NoInspection { .. } => Self::new(Code::NoInspection, detail),
            Error::RunNotEnded { .. } => Self::new(Code::RunNotEnded, detail),
            Error::RunStateRefused { .. } | Error::RunStopping { .. } => Self::new(Code::RunStateRefused, detail),
            Error::RunRefused(_) => Self::new(Code::RunRefused, detail),
            Error::CellInUse { .. } => Self::new(Code::CellInUse, detail),
            Error::TooManyRuns { .. } => Self::new(Code::TooManyRuns, detail),
            Error::Invalid(errors) => Self::invalid(errors.into_iter().map(ProblemField::from).collect(), detail),
            Error::MeshUnreadable(_) => Self::new(Code::MeshUnreadable, detail),
            Error::UploadTooLarge { .. } => Self::new(Code::TooLarge, detail),
            Error::DigestMismatch { .. } => Self::new(Code::DigestMismatch, detail),
            Error::MeshInUse(_) | Error::MeshInSpec { .. } => Self::new(Code::MeshInUse, detail),
            Error::SpecInUse { .. } => Self::new(Code::SpecInUse, detail),
            Error::JobNotEnded { .. } => Self::new(Code::JobNotEnded, detail),
            Error::JobInUse(_) => Self::new(Code::JobInUse, detail),
            Error::JobEnded { .. } => Self::new(Code::JobEnded, detail),
            Error::JobNotQueued { .. } => Self::new(Code::JobNotQueued, detail),
            Error::SpecIsPreset { .. } => Self::new(Code::SpecIsPreset, detail),
            Error::PreconditionRequired { etag, .. } => Self::new(Code::PreconditionRequired, detail).with_etag(Some(etag)),
            Error::PreconditionFailed(etag) => Self::new(Code::PreconditionFailed, detail).with_etag(etag),
            Error::IdempotencyMismatch => Self::new(Code::IdempotencyMismatch, detail),
            Error::BadPageToken => Self::at(Code::BadPageToken, "page_token", detail),
            Error::QueueFull { .. } => Self::new(Code::QueueFull, detail),
            Error::StorageFull | Error::StorageLow { .. } | Error::Unrecovered(_) => Self::new(Code::StorageFull, detail),
            Error::PartlyDeleted { deleted, cause } => Self::from(*cause).after_deletions(deleted),
            Error::JobHeld { .. } => Self::new(Code::JobHeld, detail),
            Error::TooSlow => Self::new(Code::TooSlow, detail),
            cause @ Error::FileDamaged { .. } => Self::caused(Code::FileDamaged, &detail, cause),
            cause @ Error::LogLeft { .. } => Self::caused(Code::Internal, &detail, cause),
            Error::Draining => Self::new(Code::Stopping, detail),
            cause @ Error::StorageBusy(_) => Self::caused(Code::Busy, BUSY, cause),
            cause @ Error::Internal(_) => Self::caused(Code::Internal, INTERNAL, cause),
        }
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let mut response = self.code.status().into_response();
        response.extensions_mut().insert(self);
        response
    }
}

/// Renders the error that a response carries, or turns an error response of the framework into a problem.
pub(super) fn finish(mut response: Response, prefix: &Prefix, path: &str, request_id: &str) -> Response {
    let status = response.status();
    if !status.is_client_error() && !status.is_server_error() {
        return response;
    }
    let error = response.extensions_mut().remove::<ApiError>().unwrap_or_else(|| of_framework(&response, prefix, path));
    // A transfer coding is the client's choice, made before its key is looked at.
    if error.code.status().is_server_error() && error.code != Code::UnsupportedTransferCoding {
        log(&error, path);
    }
    *response.status_mut() = error.code.status();
    let headers = response.headers_mut();
    headers.remove(CONTENT_LENGTH);
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
    if is_temporary(error.code) {
        headers.insert(RETRY_AFTER, HeaderValue::from_static(RETRY_AFTER_SECS));
    }
    if let Some(etag) = error.etag.as_deref().and_then(|etag| etag.parse().ok()) {
        headers.insert(ETAG, etag);
    }
    let body = body(error, prefix, path, request_id);
    *response.body_mut() = Body::from(body);
    response
}

/// The bytes of the response on a connection whose request was not read, or is not HTTP; the connection closes after it.
pub(super) fn raw_response(code: Code) -> Vec<u8> {
    let body = body(ApiError::new(code, code.meaning()), &Prefix::default(), "", &uuid::Uuid::now_v7().to_string());
    let (status, reason) = (code.status().as_u16(), code.status().canonical_reason().unwrap_or_default());
    let retry_after = if is_temporary(code) { format!("retry-after: {RETRY_AFTER_SECS}\r\n") } else { String::new() };
    let mut response = format!(
        "HTTP/1.1 {status} {reason}\r\ncontent-type: {PROBLEM_JSON}\r\ncontent-length: {}\r\n{retry_after}connection: close\r\n\r\n",
        body.len()
    )
    .into_bytes();
    response.extend(body);
    response
}

fn body(error: ApiError, prefix: &Prefix, path: &str, request_id: &str) -> Vec<u8> {
    let document = wire::Problem {
        kind: prefix.at(&problem_type(error.code.as_str())),
        title: error.code.title().to_owned(),
        status: error.code.status().as_u16(),
        detail: error.detail,
        instance: prefix.at(path),
        code: error.code.as_str().to_owned(),
        errors: error.errors,
        request_id: request_id.to_owned(),
    };
    // Serialising strings and a number cannot fail.
    serde_json::to_vec(&document).unwrap_or_default()
}

/// The error for a response of axum or tower, with what it says of the request.
fn of_framework(response: &Response, prefix: &Prefix, path: &str) -> ApiError {
    let error = from_status(response.status());
    let detail = if error.code == Code::NoSuchRoute {
        nothing_at(prefix, path)
    } else if error.code == Code::BadRequest && path.contains('%') {
        // No other part of a request is read by the framework's own extractors.
        "the path is not UTF-8 text once its percent-encoding is undone".to_owned()
    } else {
        return error;
    };
    ApiError::new(error.code, detail)
}

/// Detail of the problem of a path that the server does not have.
fn nothing_at(prefix: &Prefix, path: &str) -> String {
    let hint = if path.contains("//") {
        "write one slash in the place of two"
    } else if path.len() > 1 && path.ends_with('/') {
        "leave out the slash at the end"
    } else {
        return format!("there is nothing at {}; {} lists the routes", prefix.at(path), prefix.at("/docs"));
    };
    format!("there is nothing at {}; {hint}", prefix.at(path))
}

/// The error for a response of axum or tower, by its status.
fn from_status(status: StatusCode) -> ApiError {
    let known = Code::ALL.iter().find(|code| code.status() == status && !is_specific(**code));
    let code = known.copied().unwrap_or(if status.is_client_error() { Code::BadRequest } else { Code::Internal });
    ApiError::new(code, code.meaning())
}

/// Returns true for problems that may have passed by the next attempt.
fn is_temporary(code: Code) -> bool {
    use Code::{Busy, NotReady, QueueFull, Stopping, StorageFull, TooManyRequests, TooManyRuns, TooSlow};
    matches!(code, Busy | NotReady | QueueFull | Stopping | StorageFull | TooManyRequests | TooManyRuns | TooSlow)
}

/// Returns true for codes that a status alone does not imply.
fn is_specific(code: Code) -> bool {
    matches!(
        code,
        Code::KeyMissing
            | Code::MeshInUse
            | Code::BadShape
            | Code::QueueFull
            | Code::FileDamaged
            | Code::UnsupportedTransferCoding
    )
}

fn log(error: &ApiError, path: &str) {
    let code = error.code.as_str();
    match &error.cause {
        Some(cause) if cause.is_transient() => {
            tracing::warn!(code, path, error = cause as &dyn std::error::Error, "request failed");
        }
        Some(cause) => tracing::error!(code, path, error = cause as &dyn std::error::Error, "request failed"),
        None => tracing::warn!(code, path, detail = error.detail, errors = told(&error.errors), "request failed"),
    }
}

/// Fields of a problem with what is wrong with each, for the log; `None` without any.
fn told(errors: &[ProblemField]) -> Option<String> {
    let told: Vec<String> = errors.iter().map(|field| format!("{}: {}", field.pointer, field.detail)).collect();
    (!told.is_empty()).then(|| told.join("; "))
}

/// Renders `api/problems.md`: every problem code, for people.
#[must_use]
pub fn document() -> String {
    let mut text = String::from(
        "# Problems\n\n\
         Every response other than 2xx and 3xx is `application/problem+json` (RFC 9457) with `type`, `title`, `status`,\n\
         `detail`, `instance`, `code`, `errors` (`pointer`, `detail`) and `request_id`. `code` is stable; `detail` is for people\n\
         and may change. `pointer` is a JSON pointer into the request body, or the name of a query parameter or header. `type` is\n\
         the path of a page of the server, `/problems/CODE`, that says what this list says.\n\n\
         | code | status | meaning |\n| --- | --- | --- |\n",
    );
    for code in Code::ALL {
        let _ = writeln!(
            text,
            "| <a id=\"{0}\"></a>`{0}` | {1} | {2}. {3} |",
            code.as_str(),
            code.status().as_u16(),
            code.title(),
            code.meaning()
        );
    }
    text.push_str(
        "\nA job that failed carries a `problem` with `type`, `title`, `detail`, `code` and `errors`:\n\n\
         | code | meaning |\n| --- | --- |\n",
    );
    for failure in FailureCode::ALL {
        let (code, title) = (failure.as_str(), failure.title());
        let anchor =
            if Code::ALL.iter().any(|other| other.as_str() == code) { String::new() } else { format!("<a id=\"{code}\"></a>") };
        let _ = writeln!(text, "| {anchor}`{code}` | {title}. |");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The log told only that the server was not ready.
    #[test]
    fn the_log_is_told_which_check_failed_and_why() {
        let field = |pointer: &str, detail: &str| ProblemField { pointer: pointer.to_owned(), detail: detail.to_owned() };
        let errors = [field("storage", "the store cannot be written"), field("free_space", "12 bytes are free")];
        assert_eq!(told(&errors).as_deref(), Some("storage: the store cannot be written; free_space: 12 bytes are free"));
        assert_eq!(told(&[]), None);
    }
}
