//! Problem details (RFC 9457).

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::{FieldError, closed_list};

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

closed_list! {
    /// Code of the problem of a job, an inspection or a calibration that failed.
    pub enum FailureCode {
        /// The input cannot be used.
        JobInputInvalid = "job_input_invalid",
        /// The job took too long.
        JobTooLong = "job_too_long",
        /// No plan is possible.
        NoPlan = "no_plan",
        /// The observations do not give a calibration.
        NoCalibrationPossible = "no_calibration_possible",
        /// The job crashed.
        JobPanicked = "job_panicked",
        /// The server crashed in every attempt at the job.
        JobAttemptsExhausted = "job_attempts_exhausted",
        /// The stored job cannot be read by this version.
        JobUnreadable = "job_unreadable",
        /// A stored file is damaged.
        FileDamaged = "file_damaged",
        /// The server failed.
        Internal = "internal",
    }
}

impl FailureCode {
    /// Short title.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::JobInputInvalid => "This input cannot be used",
            Self::JobTooLong => "The job took too long",
            Self::NoPlan => "No plan is possible",
            Self::NoCalibrationPossible => "The observations do not give a calibration",
            Self::JobPanicked => "The job crashed",
            Self::JobAttemptsExhausted => "The server crashed in every attempt at this job",
            Self::JobUnreadable => "The stored job cannot be read by this version",
            Self::FileDamaged => "A stored file is damaged",
            Self::Internal => "Internal server error",
        }
    }
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
    #[schema(value_type = FailureCode)]
    pub code: String,
    /// Invalid fields, if any.
    pub errors: Vec<ProblemField>,
}

/// Reference to the description of a kind of problem: a path of the server.
#[must_use]
pub fn problem_type(code: &str) -> String {
    format!("/problems/{code}")
}
