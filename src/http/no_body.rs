//! Routes that take no body: one that says something is refused before anything is done, since whoever sends `{"dry_run": true}`
//! means to change what happens. The API document tells which routes they are, so that none is forgotten. HTTP gives the body of
//! such a request no meaning, and lets a server refuse it (for DELETE: RFC 9110, section 9.3.5).

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use utoipa::openapi::path::{Operation, Parameter, ParameterIn};
use utoipa::openapi::{OpenApi, RefOr};

use super::extract::{BodyRate, body_error};
use super::problem::{ApiError, Code};

/// Largest body that is read to find out that it says nothing, bytes.
const MAX_EMPTY_BYTES: usize = 64;
/// Operations that bring arm and table to rest. They are carried out whatever their body says, and do not wait for one that is
/// still on its way: a refusal would leave the cell moving.
const ALWAYS_OBEYED: [&str; 2] = ["pause_run", "stop_run"];

/// Routes that take no body.
#[derive(Clone)]
pub(super) struct NoBodyRoutes {
    /// Advice to a client that sent a body, by `METHOD /path`.
    advice: Arc<BTreeMap<String, String>>,
    /// Time after which a body must not arrive below the minimum rate.
    grace: Duration,
}

impl NoBodyRoutes {
    /// Finds the routes in `document`, whose paths are those below `prefix`: operations that may change something and have no
    /// request body.
    pub(super) fn of(document: &OpenApi, prefix: &str, grace: Duration) -> Self {
        let mut advice = BTreeMap::new();
        for (path, item) in &document.paths.paths {
            for (method, operation) in
                [("POST", &item.post), ("PUT", &item.put), ("PATCH", &item.patch), ("DELETE", &item.delete)]
            {
                if let Some(operation) = operation.as_ref().filter(|operation| refuses_bodies(operation)) {
                    advice.insert(format!("{method} {prefix}{path}"), advice_on(operation));
                }
            }
        }
        Self { advice: Arc::new(advice), grace }
    }

    /// Advice to the client of this request if it has a body; `None` if its route takes one.
    fn advice(&self, request: &Request) -> Option<&str> {
        let path = request.extensions().get::<MatchedPath>()?;
        self.advice.get(&format!("{} {}", request.method(), path.as_str())).map(String::as_str)
    }
}

fn operation_id(operation: &Operation) -> &str {
    operation.operation_id.as_deref().unwrap_or_default()
}

fn refuses_bodies(operation: &Operation) -> bool {
    operation.request_body.is_none() && !ALWAYS_OBEYED.contains(&operation_id(operation))
}

/// Advice to a client that sent a body: where the operation takes what may have been meant with it.
fn advice_on(operation: &Operation) -> String {
    match operation_id(operation) {
        "apply_retention" => "for a dry run send GET /api/v1/retention, which lists what would be deleted".to_owned(),
        "begin_session" => "send the request without one, and the key in the header Authorization, as Bearer …".to_owned(),
        _ => {
            let parameters: Vec<String> = operation.parameters.iter().flatten().filter_map(parameter_name).collect();
            let taken = if parameters.is_empty() { String::new() } else { format!("; it takes {}", parameters.join(" and ")) };
            format!("send the request without one{taken}")
        }
    }
}

/// Kind and name of a parameter that is no part of the path.
fn parameter_name(parameter: &RefOr<Parameter>) -> Option<String> {
    let RefOr::T(parameter) = parameter else { return None };
    let kind = match parameter.parameter_in {
        ParameterIn::Query => "query parameter",
        ParameterIn::Header => "header",
        ParameterIn::Path | ParameterIn::Cookie | ParameterIn::QueryString => return None,
    };
    Some(format!("the {kind} {}", parameter.name))
}

/// Refuses a body that says something where the route takes none.
pub(super) async fn refuse_body(State(routes): State<NoBodyRoutes>, request: Request, next: Next) -> Response {
    let Some(advice) = routes.advice(&request) else { return next.run(request).await };
    let (parts, body) = request.into_parts();
    match says_nothing(body, BodyRate::new(routes.grace)).await {
        Ok(true) => next.run(Request::from_parts(parts, Body::empty())).await,
        Ok(false) => {
            let detail = format!("this route takes no body, so nothing was done; {advice}");
            ApiError::new(Code::UnexpectedBody, detail).into_response()
        }
        Err(error) => error.into_response(),
    }
}

/// Reads a body, as far as it can say nothing, and returns true if it does.
async fn says_nothing(body: Body, mut rate: BodyRate) -> Result<bool, ApiError> {
    let mut stream = body.into_data_stream();
    let mut bytes: Vec<u8> = Vec::new();
    while let Some(chunk) = stream.next().await {
        let chunk = chunk.map_err(|error| body_error(&error))?;
        rate.count(chunk.len())?;
        if bytes.len() + chunk.len() > MAX_EMPTY_BYTES {
            return Ok(false);
        }
        bytes.extend_from_slice(&chunk);
    }
    Ok(is_nothing(&bytes))
}

/// Returns true for white space, and for the `{}` and `null` of clients that send JSON with every request. The media type does not
/// matter: none gives these bytes a meaning that could be missed.
fn is_nothing(body: &[u8]) -> bool {
    let text = body.trim_ascii();
    let fields = text.strip_prefix(b"{").and_then(|rest| rest.strip_suffix(b"}"));
    text.is_empty() || text == b"null" || fields.is_some_and(|fields| fields.trim_ascii().is_empty())
}

#[cfg(test)]
mod tests;
