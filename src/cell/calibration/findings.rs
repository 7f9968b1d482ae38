//! Faults of calibration data and remarks on a calibration, as data; the words are those of the interfaces.

use nalgebra::Vector3;

use crate::cell::closed_list;

closed_list! {
    /// Codes of findings.
    pub enum FindingCode {
        /// Fewer observations than determine the unknowns.
        TooFew = "too_few",
        /// Motions that leave a freedom open.
        DegenerateMotion = "degenerate_motion",
        /// Motions that leave a freedom badly known.
        WeakMotion = "weak_motion",
        /// Lengths in another unit.
        UnitMismatch = "unit_mismatch",
        /// The controller reports a tool's pose, not the flange's.
        ToolActive = "tool_active",
        /// The arm's model is not that of the arm.
        WrongRobotModel = "wrong_robot_model",
        /// Joints in another order or sense.
        JointOrder = "joint_order",
        /// Degrees and radians mixed up.
        AngleUnit = "angle_unit",
        /// Poses of the board given the other way round.
        Inverted = "inverted",
        /// Poses of the flange given the other way round, or the scanner in another place.
        OtherSetup = "other_setup",
        /// Rotations transposed.
        Transposed = "transposed",
        /// Quaternions with the scalar part first.
        QuaternionOrder = "quaternion_order",
        /// Observations in another order than their poses.
        OutOfStep = "out_of_step",
        /// The board turned with the table, and is said to stand still.
        BoardTurned = "board_turned",
        /// The scanner's pose is held as the cell has it, and does not agree with the observations.
        ScannerHeld = "scanner_held",
        /// An observation that comes twice.
        DuplicatePose = "duplicate_pose",
        /// The board or the scanner moved.
        Moved = "moved",
        /// Two boards exchanged.
        Swapped = "swapped",
        /// The board is seen half a turn round.
        Flipped = "flipped",
        /// The table turns the other way.
        TableSign = "table_sign",
        /// The table turns by another ratio.
        TableScale = "table_scale",
        /// The table does not turn.
        TableStill = "table_still",
        /// Lengths to the board that are off those of the arm's motions by one ratio.
        BoardScale = "board_scale",
        /// An observation that does not agree with the others.
        BadPose = "bad_pose",
        /// The deviations given are smaller than the data show.
        SigmaTooSmall = "sigma_too_small",
        /// Residuals that grow with a joint: the arm's own calibration.
        ArmModel = "arm_model",
        /// Too old, or too warm or cold.
        Stale = "stale",
        /// No observations agree with each other.
        NoConsensus = "no_consensus",
        /// Points of the plate's face that tell no plane.
        NoPlateFace = "no_plate_face",
        /// The observations held out do not agree with the calibration.
        HeldOutDisagrees = "held_out_disagrees",
        /// The refinement ended at its limit of iterations, before the unknowns settled.
        NotConverged = "not_converged",
        /// The scale of the lengths to the board ended at its limit of rounds, before it settled.
        BoardScaleNotConverged = "board_scale_not_converged",
    }
}

closed_list! {
    /// Weight of a finding.
    pub enum Severity {
        /// A calibration is missing, or must not be used.
        Error = "error",
        /// A calibration to be used with care.
        Warning = "warning",
        /// A remark.
        Note = "note",
    }
}

/// Part of the observations that a finding is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// Poses of the board.
    Board,
    /// Poses of the flange.
    Flange,
    /// Angles of the table.
    Table,
}

/// One finding with its figures.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFinding {
    /// Code.
    pub code: FindingCode,
    /// Weight.
    pub severity: Severity,
    /// Names of the observations that it is about.
    pub observations: Vec<String>,
    /// Figures of the finding.
    pub figures: Figures,
}

/// Figures of a finding; their meaning goes with the code.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Number of observations, points, iterations or rounds.
    pub count: Option<usize>,
    /// Number of observations that were held out.
    pub held_out: Option<usize>,
    /// Number of observations given: those used, those held out and the duplicates left out.
    pub given: Option<usize>,
    /// Fewest observations that tell the cause.
    pub needed: Option<usize>,
    /// Ratio.
    pub ratio: Option<f64>,
    /// Turn.
    pub turn_rad: Option<f64>,
    /// Another turn to compare with.
    pub other_turn_rad: Option<f64>,
    /// Length.
    pub length_mm: Option<f64>,
    /// Another length to compare with.
    pub other_length_mm: Option<f64>,
    /// Vector, mm or a unit vector.
    pub vector: Option<Vector3<f64>>,
    /// Part of the observations.
    pub subject: Option<Subject>,
    /// Joint, 1 to 6.
    pub joint: Option<usize>,
    /// Temperatures now and at the calibration, °C.
    pub temperatures_c: Option<[f64; 2]>,
}

impl CalibrationFinding {
    /// Finding without figures.
    #[must_use]
    pub fn new(code: FindingCode, severity: Severity) -> Self {
        Self { code, severity, observations: Vec::new(), figures: Figures::default() }
    }

    /// The finding about these observations.
    #[must_use]
    pub fn about(self, observations: impl IntoIterator<Item = String>) -> Self {
        Self { observations: observations.into_iter().collect(), ..self }
    }

    /// The finding with these figures.
    #[must_use]
    pub fn with(self, figures: Figures) -> Self {
        Self { figures, ..self }
    }
}
