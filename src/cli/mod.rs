//! Floor 11, the command line: one file a subcommand, each with its arguments and a `run`.

pub mod inspect;
pub mod part;

/// Why a command ends without success, and with which exit code.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CliError {
    /// Something given is wrong: a file, a value.
    #[error("{0}")]
    BadInput(String),
    /// The input is fine, but there is no plan for it.
    #[error("no plan is possible: {0}")]
    NoPlan(String),
    /// Stopped on request.
    #[error("cancelled")]
    Cancelled,
}

impl CliError {
    /// Exit code of the process.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::BadInput(_) => 2,
            Self::NoPlan(_) => 3,
            Self::Cancelled => 4,
        }
    }
}

#[cfg(test)]
mod tests;
