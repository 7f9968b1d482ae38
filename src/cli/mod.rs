//! Floor 11, the command line.

use std::process::ExitCode;

pub mod check;
pub mod files;
pub mod inspect_scanner;
pub mod plan;
pub mod progress;

/// Why a command ends without its result; each kind has its exit code (contract: 2, 3, 4).
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CliError {
    /// What was given cannot be used.
    #[error("{0}")]
    BadInput(String),
    /// No plan is possible, with the reasons.
    #[error("{0}")]
    NoPlan(String),
    /// The user interrupted it.
    #[error("{0}")]
    Cancelled(String),
}

impl From<&CliError> for ExitCode {
    fn from(error: &CliError) -> Self {
        Self::from(match error {
            CliError::BadInput(_) => 2,
            CliError::NoPlan(_) => 3,
            CliError::Cancelled(_) => 4,
        })
    }
}
