//! Reasons for which there is no plan at all.

use super::Cancelled;
use crate::cell::FieldError;
use crate::geometry::{Part, Pose, Table};
use crate::planning::verdict::{CandidateCounts, Cause, Obstruction, Stability};

/// Reason for which there is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The job was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// Parameters that do not fit each other, the part or the cell.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    BadParams(Vec<FieldError>),
    /// Nothing can be measured.
    #[error("no plan is possible")]
    NoPlan(NoPlan),
}

/// Finding that nothing can be measured.
#[derive(Clone, Debug, PartialEq)]
pub enum NoPlan {
    /// No candidate of a plan measures anything worth a view.
    NothingMeasured {
        /// Numbers of candidates.
        candidates: CandidateCounts,
        /// Area that is asked for, mm².
        asked_mm2: f64,
        /// Asked area by the cause for which it is missed, mm²: the largest first, none of them 0.
        missed_mm2: Vec<(Cause, f64)>,
        /// Pairs of bodies that keep the cell from candidates, the one that keeps it from most first.
        obstructions: Vec<Obstruction>,
        /// Pose of the part in each setup that was planned in.
        setups: Vec<Pose<Table, Part>>,
    },
    /// Setups share no surface by which they could be registered to each other.
    NotRegistered {
        /// The best that two of them share.
        stability: Stability,
    },
    /// No candidate measures anything, whatever value a study gives to what it varies.
    NothingInStudy,
    /// No further view of a part that was scanned is worth it.
    NoFurtherView {
        /// Share of the asked area that is measured.
        measured_of_asked: f64,
        /// Share that all further views together are expected to add.
        left_of_asked: f64,
        /// Share that is missing and that no further view mends.
        hopeless_of_asked: f64,
        /// Name of the rule that ended the choice.
        rule: &'static str,
    },
}

impl PlanError {
    /// One parameter that does not fit, for a reason that carries its figures: an error, not a text.
    pub(in crate::planning) fn param(pointer: &str, reason: &dyn std::error::Error) -> Self {
        Self::BadParams(vec![FieldError { pointer: pointer.to_owned(), detail: reason.to_string() }])
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
