//! Verdicts on samples: the grade of what is measured, the cause of what is missed; and on candidates: the reason for which
//! one was dropped, and the bodies that keep the cell from them.

mod cause;
mod grade;
mod obstruction;
mod rejection;
mod risk;
mod stability;

pub use cause::Cause;
pub use grade::Grade;
pub use obstruction::{Advice, Obstruction};
pub use rejection::{CandidateCounts, Fate, Rejection};
pub use risk::RiskReason;
pub use stability::{MIN_RESISTANCE, Stability};

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
