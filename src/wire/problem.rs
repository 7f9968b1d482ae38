//! Problems as RFC 9457 writes them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::FieldError;

/// Fault of one field.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ProblemField {
    /// JSON pointer of the field in the request's body; a query parameter or header by its name.
    pub pointer: String,
    /// Value that was found, and the allowed ones.
    pub detail: String,
}

impl From<FieldError> for ProblemField {
    fn from(error: FieldError) -> Self {
        Self { pointer: error.pointer, detail: error.detail }
    }
}

/// Body of every answer that is not 2xx or 3xx, as `application/problem+json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// Reference to the description of this kind of problem.
    #[serde(rename = "type")]
    #[schema(format = "uri-reference")]
    pub kind: String,
    /// The kind of problem in a few words.
    pub title: String,
    /// The HTTP status.
    #[schema(minimum = 400, maximum = 599)]
    pub status: u16,
    /// Description of this occurrence.
    pub detail: String,
    /// Path of the request.
    pub instance: String,
    /// Stable name of the kind of problem, for programs.
    pub code: String,
    /// The fields at fault, if any.
    pub errors: Vec<ProblemField>,
    /// Name of this request in the server's log.
    pub request_id: String,
}

/// Reason for which a job failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobProblem {
    /// Reference to the description of this kind of problem.
    #[serde(rename = "type")]
    #[schema(format = "uri-reference")]
    pub kind: String,
    /// The kind of problem in a few words.
    pub title: String,
    /// Description of this occurrence.
    pub detail: String,
    /// Stable name of the kind of problem, for programs.
    pub code: String,
    /// The fields at fault, if any.
    pub errors: Vec<ProblemField>,
}

/// Reference to the description of a kind of problem.
#[must_use]
pub fn problem_type(code: &str) -> String {
    format!("/problems#{code}")
}
