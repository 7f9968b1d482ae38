//! Verdicts on samples: the grade of what is measured, the cause of what is missed.

mod cause;
mod grade;

pub use cause::Cause;
pub use grade::Grade;

/// Verdict on a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Measured, with the grade of its best chosen view.
    Measured(Grade),
    /// Asked, not measured.
    Missed(Cause),
    /// Lies in an excluded region.
    NotAsked,
}
