//! Failures of attempts as problems of their jobs.

use std::any::Any;
use std::time::Duration;

use super::super::error::Error;
use super::super::planner::JobError;
use crate::cell::FieldError;
use crate::wire::{JobProblem, ProblemField, problem_type};

/// Problem codes of failed jobs, with their titles.
pub const FAILURE_CODES: [(&str, &str); 9] = [
    ("job_input_invalid", "This input cannot be used"),
    ("job_too_long", "The job took too long"),
    ("no_plan", "No plan is possible"),
    ("no_calibration_possible", "The observations do not give a calibration"),
    ("job_panicked", "The job crashed"),
    ("job_attempts_exhausted", "The server crashed in every attempt at this job"),
    ("job_unreadable", "The stored job cannot be read by this version"),
    ("file_damaged", "A stored file is damaged"),
    ("internal", "Internal server error"),
];

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
        AttemptError::Panicked(text) => failure("job_panicked", format!("internal error: {text}"), Vec::new()),
        AttemptError::TimedOut(limit) => failure("job_too_long", too_long(limit), Vec::new()),
        AttemptError::Job(JobError::BadInput(errors) | JobError::PartRefused { errors, .. }) => input_invalid(errors),
        AttemptError::Job(JobError::NoPlan { reasons, .. }) => failure("no_plan", reasons, Vec::new()),
        AttemptError::Job(JobError::Damaged(reason) | JobError::Unread(reason)) => failure("file_damaged", reason, Vec::new()),
        AttemptError::Job(error @ (JobError::Unavailable(_) | JobError::Cancelled)) => {
            failure("internal", error.to_string(), Vec::new())
        }
    }
}

/// Problem of a job whose input cannot be used.
pub(super) fn input_invalid(errors: Vec<FieldError>) -> JobProblem {
    let detail = errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    failure("job_input_invalid", detail, errors.into_iter().map(ProblemField::from).collect())
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
    let code = if matches!(error, Error::FileDamaged { .. }) { "file_damaged" } else { "internal" };
    failure(code, error.to_string(), Vec::new())
}

/// The problem of a failed job, with the title of its code.
pub(in crate::service) fn failure(code: &str, detail: String, errors: Vec<ProblemField>) -> JobProblem {
    let title = FAILURE_CODES.iter().find(|(known, _)| *known == code).map_or("", |(_, title)| title);
    JobProblem { kind: problem_type(code), title: title.to_owned(), detail, code: code.to_owned(), errors }
}
