//! Floor 11, the command line.

pub mod files;
pub mod inspect;
pub mod inspect_scanner;
pub mod part;
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

impl CliError {
    /// Exit code of the process.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::BadInput(_) => 2,
            Self::NoPlan(_) => 3,
            Self::Cancelled(_) => 4,
        }
    }
}

#[cfg(test)]
mod tests;
