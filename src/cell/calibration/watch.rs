//! Surroundings of a calibration that is computed: who is told of its stages, and who may end it.

use crate::cell::closed_list;

closed_list! {
    /// Stage of a calibration.
    pub enum CalibrationStage {
        /// Faults of the observations are looked for.
        Diagnosis = "diagnosis",
        /// Observations that agree are found, and the unknowns refined from them.
        Screening = "screening",
        /// Runout of the table and face of the plate.
        Table = "table",
        /// Each observation is predicted from the others, and the result judged.
        Judgement = "judgement",
    }
}

/// Surroundings of a calibration.
pub trait CalibrationWatch {
    /// A stage begins.
    fn begins(&self, stage: CalibrationStage);

    /// Returns true if the calibration is to end without a result.
    fn is_cancelled(&self) -> bool;
}

/// Nobody watches.
#[derive(Clone, Copy, Debug)]
pub struct Unwatched;

impl CalibrationWatch for Unwatched {
    fn begins(&self, _stage: CalibrationStage) {}

    fn is_cancelled(&self) -> bool {
        false
    }
}
