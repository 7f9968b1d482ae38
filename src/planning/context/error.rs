//! Reasons for which there is no plan at all.

use super::Cancelled;
use crate::cell::FieldError;

/// Reason for which there is no plan.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlanError {
    /// The job was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// Parameters that do not fit each other, the part or the cell.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    BadParams(Vec<FieldError>),
    /// Nothing can be measured.
    #[error("no plan is possible: {0}")]
    NoPlan(String),
}

impl PlanError {
    /// One parameter that does not fit.
    pub(in crate::planning) fn param(pointer: &str, detail: String) -> Self {
        Self::BadParams(vec![FieldError { pointer: pointer.to_owned(), detail }])
    }
}

impl From<Vec<FieldError>> for PlanError {
    fn from(errors: Vec<FieldError>) -> Self {
        Self::BadParams(errors)
    }
}

impl From<Cancelled> for PlanError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
