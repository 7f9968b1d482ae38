//! Failures of attempts as problems of their jobs.

use std::any::Any;
use std::time::Duration;

use super::super::error::Error;
use super::super::planner::JobError;
use crate::cell::FieldError;
use crate::wire::{FailureCode, JobProblem, ProblemField, problem_type};

/// Reasons why an attempt ended without result files.
pub(super) enum AttemptError {
    Job(JobError),
    Panicked(String),
    /// The time limit.
    TimedOut(Duration),
}

pub(super) fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without a message".to_owned())
}

pub(super) fn job_problem(error: AttemptError) -> JobProblem {
    match error {
        AttemptError::Panicked(text) => failure(FailureCode::JobPanicked, format!("internal error: {text}"), Vec::new()),
        AttemptError::TimedOut(limit) => failure(FailureCode::JobTooLong, too_long(limit), Vec::new()),
        AttemptError::Job(JobError::BadInput(errors) | JobError::PartRefused { errors, .. }) => input_invalid(errors),
        AttemptError::Job(JobError::NoPlan { reasons, .. }) => failure(FailureCode::NoPlan, reasons, Vec::new()),
        AttemptError::Job(JobError::Damaged(reason) | JobError::Unread(reason)) => {
            failure(FailureCode::FileDamaged, reason, Vec::new())
        }
        AttemptError::Job(error @ (JobError::Unavailable(_) | JobError::Cancelled)) => {
            failure(FailureCode::Internal, error.to_string(), Vec::new())
        }
    }
}

/// Problem of a job whose input cannot be used.
pub(super) fn input_invalid(errors: Vec<FieldError>) -> JobProblem {
    let detail = errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    failure(FailureCode::JobInputInvalid, detail, errors.into_iter().map(ProblemField::from).collect())
}

fn too_long(limit: Duration) -> String {
    format!(
        "planning took longer than the {} s that limits.job_secs allows; simplify the mesh, choose a larger part.patch_edge_mm \
         or fewer candidates (fewer candidates.even_directions or rolls_deg), or raise the setting",
        limit.as_secs_f64()
    )
}

/// Problem of a job whose results or outcome could not be stored, which goes to the log too.
pub(super) fn unstored(error: &Error) -> JobProblem {
    tracing::error!(error = error as &dyn std::error::Error, "what a job ended with cannot be stored; it fails");
    problem_of_error(error)
}

/// Problem of work that an error of the service ended: its input, a stored file, or the server is at fault.
pub(in crate::service) fn problem_of_error(error: &Error) -> JobProblem {
    if let Error::Invalid(errors) = error {
        return input_invalid(errors.clone());
    }
    let code = if matches!(error, Error::FileDamaged { .. }) { FailureCode::FileDamaged } else { FailureCode::Internal };
    failure(code, error.to_string(), Vec::new())
}

/// The problem of a failed job, with the title of its code.
pub(in crate::service) fn failure(code: FailureCode, detail: String, errors: Vec<ProblemField>) -> JobProblem {
    let (title, code) = (code.title().to_owned(), code.as_str().to_owned());
    JobProblem { kind: problem_type(&code), title, detail, code, errors }
}
