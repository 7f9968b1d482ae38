//! Problem details (RFC 9457).

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::FieldError;

/// An invalid field.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ProblemField {
    /// JSON pointer of the field in the request body; for a query parameter or a header, its name.
    pub pointer: String,
    /// Value that was found, and the allowed values.
    pub detail: String,
}

impl From<FieldError> for ProblemField {
    fn from(error: FieldError) -> Self {
        Self { pointer: error.pointer, detail: error.detail }
    }
}

/// Body of every error response, as `application/problem+json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// Reference to the description of this kind of problem.
    #[serde(rename = "type")]
    #[schema(format = "uri-reference")]
    pub kind: String,
    /// Title of this kind of problem.
    pub title: String,
    /// HTTP status code.
    #[schema(minimum = 400, maximum = 599)]
    pub status: u16,
    /// Description of this occurrence.
    pub detail: String,
    /// Path of the request.
    pub instance: String,
    /// Stable code of this kind of problem, for programs.
    pub code: String,
    /// Invalid fields, if any.
    pub errors: Vec<ProblemField>,
    /// Id of this request in the server's log.
    pub request_id: String,
}

/// Reason for which a job failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobProblem {
    /// Reference to the description of this kind of problem.
    #[serde(rename = "type")]
    #[schema(format = "uri-reference")]
    pub kind: String,
    /// Title of this kind of problem.
    pub title: String,
    /// Description of this occurrence.
    pub detail: String,
    /// Stable code of this kind of problem, for programs.
    pub code: String,
    /// Invalid fields, if any.
    pub errors: Vec<ProblemField>,
}

/// Reference to the description of a kind of problem: a path of the server.
#[must_use]
pub fn problem_type(code: &str) -> String {
    format!("/problems/{code}")
}
