//! Every answer that is not 2xx or 3xx (RFC 9457), and the only map from errors to status codes.
//!
//! A handler gives back a [`Problem`]; what reaches the client is written by [`finish`], which knows the request's path
//! and id. It also turns answers that others made (no such route, no such method, a rejected header) into problems, so
//! that none gets out in another shape. The client reads what it can act on; the log gets the whole chain of causes.

use std::fmt::Write as _;

use axum::body::Body;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE, ETAG, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use crate::service::{Error, FAILURE_CODES};
use crate::wire::{self, ParseError, ProblemField, problem_type};

/// Media type of problems.
pub(super) const PROBLEM_JSON: &str = "application/problem+json";
/// What to wait before the next attempt, when the server cannot say better.
const RETRY_AFTER_SECS: &str = "5";

macro_rules! codes {
    ($($name:ident $code:literal $status:ident $title:literal $meaning:literal;)+) => {
        /// Kinds of problem. Their names are stable.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Code {
            $(#[doc = $meaning] $name,)+
        }

        impl Code {
            /// Every kind, in the order of the document.
            pub const ALL: &[Self] = &[$(Self::$name),+];

            /// Stable name.
            #[must_use]
            pub fn as_str(self) -> &'static str {
                match self { $(Self::$name => $code),+ }
            }

            /// Status of the answer.
            #[must_use]
            pub fn status(self) -> StatusCode {
                match self { $(Self::$name => StatusCode::$status),+ }
            }

            /// In a few words.
            #[must_use]
            pub fn title(self) -> &'static str {
                match self { $(Self::$name => $title),+ }
            }

            /// For the document.
            fn meaning(self) -> &'static str {
                match self { $(Self::$name => $meaning),+ }
            }
        }
    };
}

codes! {
    BadRequest "bad_request" BAD_REQUEST "The request cannot be understood" "The request breaks the rules of HTTP, or one of its headers cannot be read.";
    BadQuery "bad_query" BAD_REQUEST "The query cannot be read" "A query parameter is unknown, missing or out of range; `errors` names it.";
    BadJson "bad_json" BAD_REQUEST "The body is no JSON" "The body is no JSON document.";
    BadBody "bad_body" BAD_REQUEST "The body cannot be read" "The body broke off, is empty, or is no proper multipart message.";
    BadDigest "bad_digest" BAD_REQUEST "The digest cannot be read" "`Content-Digest` is not `sha-256=:…:` (RFC 9530).";
    BadIdempotencyKey "bad_idempotency_key" BAD_REQUEST "The Idempotency-Key cannot be used" "An `Idempotency-Key` has 1 to 255 visible ASCII characters.";
    KeyMissing "key_missing" UNAUTHORIZED "A key is needed" "This server asks for its key: `Authorization: Bearer …`.";
    KeyWrong "key_wrong" UNAUTHORIZED "The key is not the server's" "The key in `Authorization` is not the server's.";
    CrossSite "cross_site" FORBIDDEN "Another site's page sent this" "A browser says that a page of another site sent this request, and it would change something.";
    SessionEnded "session_ended" UNAUTHORIZED "The session is over" "The cookie's session was ended, was not used for 12 hours, or the server was started anew; begin another with `POST /api/v1/session`.";
    NoSuchRoute "no_such_route" NOT_FOUND "There is nothing at this path" "The path is not one of the API's.";
    MeshNotFound "mesh_not_found" NOT_FOUND "No such mesh" "No mesh has this id.";
    JobNotFound "job_not_found" NOT_FOUND "No such job" "No job has this id.";
    SpecNotFound "spec_not_found" NOT_FOUND "No such specification" "Neither a preset nor a stored specification has this name.";
    ResultNotFound "result_not_found" NOT_FOUND "The job has no such result" "The job succeeded and has no such file; for example no program without a cell.";
    MethodNotAllowed "method_not_allowed" METHOD_NOT_ALLOWED "The method is not for this path" "The path has other methods; `Allow` names them.";
    NotAcceptable "not_acceptable" NOT_ACCEPTABLE "It cannot be given in this form" "None of the media types in `Accept`, or not the `format` or `dialect` of the query, is one that this answer comes in; `detail` names those it does.";
    RequestTimeout "request_timeout" REQUEST_TIMEOUT "The body came too slowly" "No piece of the body came for too long.";
    MeshInUse "mesh_in_use" CONFLICT "A job needs the mesh" "A job that has not ended needs the mesh.";
    JobNotEnded "job_not_ended" CONFLICT "The job has not ended" "Only an ended job can be deleted; cancel it first.";
    JobEnded "job_ended" CONFLICT "The job has ended" "A job that succeeded or failed cannot be cancelled.";
    JobHeld "job_held" CONFLICT "A label keeps the job" "The job has the label of a hold, which keeps it from being deleted; `PUT /jobs/{id}/labels` without it lets it go.";
    NoResults "no_results" CONFLICT "The job has no results" "The job has not succeeded: not yet, or not at all. `detail` says how it stands.";
    SpecIsPreset "spec_is_preset" CONFLICT "A preset cannot be changed" "The name is that of a specification that came with the program.";
    PreconditionFailed "precondition_failed" PRECONDITION_FAILED "Somebody changed it" "`If-Match` or `If-None-Match` does not hold; read the newest version and try again.";
    TooLarge "too_large" PAYLOAD_TOO_LARGE "The body is too large" "The body is larger than the server allows; `detail` says how large it may be.";
    HostNotAllowed "host_not_allowed" MISDIRECTED_REQUEST "The server does not answer to this name" "The host that the request names is not one of the server's; `detail` says which setting allows it.";
    UnsupportedMediaType "unsupported_media_type" UNSUPPORTED_MEDIA_TYPE "The body is of a type that is not read" "JSON bodies are `application/json`; compressed bodies are not read.";
    BadShape "bad_shape" UNPROCESSABLE_ENTITY "The body is of another shape" "A field of the body is unknown, missing or of another type; `errors` names it.";
    InvalidFields "invalid_fields" UNPROCESSABLE_ENTITY "Fields are out of range or inconsistent" "`errors` names every field at fault, what it is and what is allowed.";
    BadPageToken "bad_page_token" UNPROCESSABLE_ENTITY "The page token cannot be used" "The page token does not come from this listing with these filters.";
    MeshUnreadable "mesh_unreadable" UNPROCESSABLE_ENTITY "The file is no mesh that can be planned on" "The file is no STL, OBJ or PLY, is damaged, or is beyond the limits; `detail` says where and why.";
    DigestMismatch "digest_mismatch" UNPROCESSABLE_ENTITY "The digest is not the body's" "The SHA-256 of the body is not the one in `Content-Digest`; it was changed on its way.";
    IdempotencyMismatch "idempotency_mismatch" UNPROCESSABLE_ENTITY "The Idempotency-Key was used for another request" "The same key came with another request within 24 hours.";
    PreconditionRequired "precondition_required" PRECONDITION_REQUIRED "Say which version is to be replaced" "The specification exists; send its entity tag in `If-Match`.";
    TooManyRequests "too_many_requests" TOO_MANY_REQUESTS "The client has its share" "The client's address has as many connections, event streams, uploads or waits open as the server allows one; `detail` says which. Close one, or try again after `Retry-After` seconds.";
    HeadersTooLarge "headers_too_large" REQUEST_HEADER_FIELDS_TOO_LARGE "The headers are too large" "The request's headers are larger than the server allows.";
    Internal "internal" INTERNAL_SERVER_ERROR "The server is at fault" "A fault of the server; its log has the cause under `request_id`.";
    FileDamaged "file_damaged" INTERNAL_SERVER_ERROR "A stored file is damaged" "The file is missing or does not have the bytes that its hash stands for, so it is not given out. Upload the same mesh, or plan the same job again, or restore a backup.";
    Busy "busy" SERVICE_UNAVAILABLE "The server is busy" "All places for connections, event streams, uploads or waits are taken, the database is locked, or the machine is short of something for the moment; try again after `Retry-After` seconds.";
    QueueFull "queue_full" SERVICE_UNAVAILABLE "The queue is full" "As many jobs wait as the server allows; try again after `Retry-After` seconds.";
    Stopping "stopping" SERVICE_UNAVAILABLE "The server is about to stop" "The server takes no more work; try again after `Retry-After` seconds.";
    NotReady "not_ready" SERVICE_UNAVAILABLE "The server cannot take work" "`errors` names what does not hold.";
    TooSlow "too_slow" SERVICE_UNAVAILABLE "The answer took too long" "The server could not answer in time; try again after `Retry-After` seconds.";
    StorageFull "storage_full" INSUFFICIENT_STORAGE "The disk is full" "The server's disk has no room for it, or keeps what is left for jobs that run; try again after `Retry-After` seconds, or delete jobs and meshes.";
}

/// A problem, before it is known of which request.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    code: Code,
    detail: String,
    errors: Vec<ProblemField>,
    etag: Option<String>,
    /// For the log.
    cause: Option<Error>,
}

impl Problem {
    /// A problem of this kind.
    pub(super) fn new(code: Code, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into(), errors: Vec::new(), etag: None, cause: None }
    }

    /// Its kind.
    #[cfg(test)]
    pub(super) fn code(&self) -> Code {
        self.code
    }

    /// With one field at fault.
    pub(super) fn at(code: Code, pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        let detail = detail.into();
        let field = ProblemField { pointer: pointer.into(), detail: detail.clone() };
        Self { errors: vec![field], ..Self::new(code, detail) }
    }

    /// With fields at fault.
    pub(super) fn with_errors(mut self, errors: Vec<ProblemField>) -> Self {
        self.errors = errors;
        self
    }

    fn with_etag(mut self, etag: Option<String>) -> Self {
        self.etag = etag;
        self
    }
}

impl From<ParseError> for Problem {
    fn from(error: ParseError) -> Self {
        match error {
            ParseError::Syntax(detail) => Self::new(Code::BadJson, detail),
            ParseError::Shape { pointer, detail } => Self::at(Code::BadShape, pointer, detail),
        }
    }
}

impl From<Error> for Problem {
    fn from(error: Error) -> Self {
        let detail = error.to_string();
        match error {
            Error::MeshNotFound(_) => Self::new(Code::MeshNotFound, detail),
            Error::JobNotFound(_) => Self::new(Code::JobNotFound, detail),
            Error::SpecNotFound { .. } => Self::new(Code::SpecNotFound, detail),
            Error::NoSuchResult { .. } => Self::new(Code::ResultNotFound, detail),
            Error::NoResults { .. } => Self::new(Code::NoResults, detail),
            Error::Invalid(errors) => {
                Self::new(Code::InvalidFields, detail).with_errors(errors.into_iter().map(ProblemField::from).collect())
            }
            Error::MeshUnreadable(_) => Self::new(Code::MeshUnreadable, detail),
            Error::UploadTooLarge { .. } => Self::new(Code::TooLarge, detail),
            Error::DigestMismatch { .. } => Self::new(Code::DigestMismatch, detail),
            Error::MeshInUse(_) => Self::new(Code::MeshInUse, detail),
            Error::JobNotEnded { .. } => Self::new(Code::JobNotEnded, detail),
            Error::JobEnded { .. } => Self::new(Code::JobEnded, detail),
            Error::SpecIsPreset { .. } => Self::new(Code::SpecIsPreset, detail),
            Error::PreconditionRequired { etag, .. } => Self::new(Code::PreconditionRequired, detail).with_etag(Some(etag)),
            Error::PreconditionFailed(etag) => Self::new(Code::PreconditionFailed, detail).with_etag(etag),
            Error::IdempotencyMismatch => Self::new(Code::IdempotencyMismatch, detail),
            Error::BadPageToken => Self::at(Code::BadPageToken, "page_token", detail),
            Error::QueueFull { .. } => Self::new(Code::QueueFull, detail),
            Error::StorageFull | Error::StorageLow { .. } => Self::new(Code::StorageFull, detail),
            Error::JobHeld { .. } => Self::new(Code::JobHeld, detail),
            Error::TooSlow => Self::new(Code::TooSlow, detail),
            cause @ Error::FileDamaged { .. } => Self { cause: Some(cause), ..Self::new(Code::FileDamaged, detail) },
            Error::Draining => Self::new(Code::Stopping, detail),
            cause @ Error::StorageBusy(_) => {
                let detail = "the store cannot be used at the moment: it is locked, or the machine is short of something";
                Self { cause: Some(cause), ..Self::new(Code::Busy, detail) }
            }
            cause @ Error::Internal(_) => {
                let detail = "the server could not do this; its log has the cause under this request_id";
                Self { cause: Some(cause), ..Self::new(Code::Internal, detail) }
            }
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = self.code.status().into_response();
        response.extensions_mut().insert(self);
        response
    }
}

/// Writes the problem that an answer carries, or makes one of an answer that somebody else refused the request with.
pub(super) fn finish(mut response: Response, path: &str, request_id: &str) -> Response {
    let status = response.status();
    if !status.is_client_error() && !status.is_server_error() {
        return response;
    }
    let problem = response.extensions_mut().remove::<Problem>().unwrap_or_else(|| foreign(status));
    if problem.code.status().is_server_error() {
        log(&problem, path);
    }
    *response.status_mut() = problem.code.status();
    let headers = response.headers_mut();
    headers.remove(CONTENT_LENGTH);
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
    if is_temporary(problem.code) {
        headers.insert(RETRY_AFTER, HeaderValue::from_static(RETRY_AFTER_SECS));
    }
    if let Some(etag) = problem.etag.as_deref().and_then(|etag| etag.parse().ok()) {
        headers.insert(ETAG, etag);
    }
    let body = body(problem, path, request_id);
    *response.body_mut() = Body::from(body);
    response
}

/// The document of a problem that no request was read for: there is no place for the connection.
pub(super) fn without_request(code: Code) -> String {
    let body = body(Problem::new(code, code.meaning()), "", &uuid::Uuid::now_v7().to_string());
    String::from_utf8_lossy(&body).into_owned()
}

fn body(problem: Problem, path: &str, request_id: &str) -> Vec<u8> {
    let document = wire::Problem {
        kind: problem_type(problem.code.as_str()),
        title: problem.code.title().to_owned(),
        status: problem.code.status().as_u16(),
        detail: problem.detail,
        instance: path.to_owned(),
        code: problem.code.as_str().to_owned(),
        errors: problem.errors,
        request_id: request_id.to_owned(),
    };
    // Strings and a number: it cannot fail.
    serde_json::to_vec(&document).unwrap_or_default()
}

/// The problem of an answer that is not ours: axum's and tower's own refusals.
fn foreign(status: StatusCode) -> Problem {
    let known = Code::ALL.iter().find(|code| code.status() == status && !is_specific(**code));
    let code = known.copied().unwrap_or(if status.is_client_error() { Code::BadRequest } else { Code::Internal });
    Problem::new(code, code.meaning())
}

/// Kinds that a later attempt may not meet again.
fn is_temporary(code: Code) -> bool {
    use Code::{Busy, NotReady, QueueFull, Stopping, StorageFull, TooManyRequests, TooSlow};
    matches!(code, Busy | NotReady | QueueFull | Stopping | StorageFull | TooManyRequests | TooSlow)
}

/// Kinds that only our own code can mean by their status.
fn is_specific(code: Code) -> bool {
    matches!(code, Code::KeyMissing | Code::MeshInUse | Code::BadShape | Code::QueueFull | Code::FileDamaged)
}

fn log(problem: &Problem, path: &str) {
    match &problem.cause {
        Some(error) if error.is_transient() => {
            tracing::warn!(code = problem.code.as_str(), path, error = error as &dyn std::error::Error, "refused");
        }
        Some(error) => tracing::error!(code = problem.code.as_str(), path, error = error as &dyn std::error::Error, "refused"),
        None => tracing::warn!(code = problem.code.as_str(), path, detail = problem.detail, "refused"),
    }
}

/// `api/problems.md`: every kind of problem, for people.
#[must_use]
pub fn document() -> String {
    let mut text = String::from(
        "# Problems\n\n\
         Every answer that is not 2xx or 3xx is `application/problem+json` (RFC 9457) with `type`, `title`, `status`, `detail`,\n\
         `instance`, `code`, `errors` (`pointer`, `detail`) and `request_id`. `code` is stable; `detail` is for people and may\n\
         change. `pointer` is a JSON pointer into the request's body, or the name of a query parameter or header.\n\n\
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
    for (code, title) in FAILURE_CODES {
        let anchor =
            if Code::ALL.iter().any(|other| other.as_str() == code) { String::new() } else { format!("<a id=\"{code}\"></a>") };
        let _ = writeln!(text, "| {anchor}`{code}` | {title}. |");
    }
    text
}
