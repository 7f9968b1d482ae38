//! Faults in the data of a calibration, each with a code for programs.

use std::fmt;

use crate::cell::closed_list::closed_list;

closed_list! {
    /// Kind of fault.
    pub enum LensFault {
        /// Text that is not in the format it is read as.
        Unreadable = "unreadable",
        /// File of a format that is not known.
        UnknownFormat = "unknown_format",
        /// File, or list in it, beyond the limit of size.
        TooLarge = "too_large",
        /// Field that is needed and absent.
        MissingField = "missing_field",
        /// Lens whose image size neither its file nor an option gives.
        MissingImageSize = "missing_image_size",
        /// Scanner without one of its devices, or without the pose of one.
        MissingDevice = "missing_device",
        /// Matrix or list of another size than its name asks for.
        WrongShape = "wrong_shape",
        /// Number that is not finite or out of range.
        OutOfRange = "out_of_range",
        /// Matrix that is not a rotation.
        NotARotation = "not_a_rotation",
        /// Lens model of a fisheye or an omnidirectional camera.
        Fisheye = "fisheye",
        /// Distortion that five coefficients do not describe.
        TooManyCoefficients = "too_many_coefficients",
        /// Distortion that folds inside the image.
        Folds = "folds",
        /// Lengths in another unit than millimetres.
        UnitMismatch = "unit_mismatch",
        /// Files or fields that contradict each other.
        Inconsistent = "inconsistent",
        /// Fewer observations than unknowns.
        TooFew = "too_few",
        /// Observations that leave an unknown open.
        Degenerate = "degenerate",
        /// Estimation that found no solution.
        NotConverged = "not_converged",
    }
}

/// Fault in the data of a calibration: code, place, and what was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LensError {
    /// Kind of fault.
    pub code: LensFault,
    /// JSON pointer or name of the field; empty for the whole file.
    pub pointer: String,
    /// Value found, and what is allowed.
    pub detail: String,
}

impl LensError {
    /// A fault at a place.
    pub(super) fn new(code: LensFault, pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { code, pointer: pointer.into(), detail: detail.into() }
    }
}

impl fmt::Display for LensError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.pointer.is_empty() {
            write!(f, "{}: ", self.pointer)?;
        }
        write!(f, "{} ({})", self.detail, self.code.as_str())
    }
}

impl std::error::Error for LensError {}
