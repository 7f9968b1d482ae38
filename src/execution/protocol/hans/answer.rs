//! Replies, and the values in them.

use super::{HansSyntax, fields, message, number, real, reals};

/// A reply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HansReply {
    /// Name of the command that it answers.
    pub command: String,
    /// Answer.
    pub outcome: HansOutcome,
}

/// Answer to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HansOutcome {
    /// Done, with values.
    Done(Vec<String>),
    /// Refused, with a code.
    Fail(i64),
    /// The controller does not know the command.
    Unknown,
}

impl HansReply {
    /// Reply that a command is done.
    #[must_use]
    pub fn done(command: &str, values: Vec<String>) -> Self {
        Self { command: command.to_owned(), outcome: HansOutcome::Done(values) }
    }

    /// Message on the wire.
    #[must_use]
    pub fn encode(&self) -> String {
        match &self.outcome {
            HansOutcome::Done(values) => message(&self.command, std::iter::once("OK".to_owned()).chain(values.iter().cloned())),
            HansOutcome::Fail(code) => message(&self.command, ["Fail".to_owned(), code.to_string()]),
            HansOutcome::Unknown => message("errorcmd", ["Fail".to_owned(), UNKNOWN_COMMAND.to_string()]),
        }
    }

    /// Reads a message, without its `;`.
    ///
    /// # Errors
    /// [`HansSyntax::Arguments`].
    pub fn parse(message: &str) -> Result<Self, HansSyntax> {
        let fields = fields(message);
        let outcome = match fields.as_slice() {
            ["errorcmd", ..] => HansOutcome::Unknown,
            [_, "OK", values @ ..] => HansOutcome::Done(values.iter().map(|value| (*value).to_owned()).collect()),
            [name, "Fail", code, ..] => HansOutcome::Fail(code.parse().map_err(|_| HansSyntax::Arguments((*name).to_owned()))?),
            _ => return Err(HansSyntax::Arguments(fields.first().copied().unwrap_or_default().to_owned())),
        };
        Ok(Self { command: fields.first().copied().unwrap_or_default().to_owned(), outcome })
    }
}

/// Values of `ReadRobotState`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RobotFlags {
    /// The arm moves.
    pub is_moving: bool,
    /// The drives are enabled.
    pub is_enabled: bool,
    /// Code of the error that the robot is in; 0 none.
    pub error_code: i64,
    /// Axis of the error.
    pub error_axis: i64,
    /// The brakes are open.
    pub are_brakes_open: bool,
    /// The motion is paused.
    pub is_paused: bool,
    /// An emergency stop is pressed.
    pub is_emergency_stop: bool,
    /// The guard is open.
    pub is_guard_open: bool,
    /// The robot has its 48 V.
    pub is_electrified: bool,
    /// The control box is connected.
    pub is_box_connected: bool,
    /// The way point was reached, as the planner has it.
    pub is_blending_done: bool,
    /// The joints are where they were sent.
    pub is_in_position: bool,
}

/// Code of an error that came without one.
const ERROR_WITHOUT_CODE: i64 = -1;

impl RobotFlags {
    /// Reads the values of a reply; values beyond the thirteen that are known are left.
    #[must_use]
    pub fn read(values: &[String]) -> Option<Self> {
        let values: Option<Vec<i64>> = values.get(..13)?.iter().map(|value| value.parse().ok()).collect();
        let values = values?;
        let flag = |index: usize| values[index] != 0;
        let error_code = match (flag(2), values[3]) {
            (true, 0) => ERROR_WITHOUT_CODE,
            (_, code) => code,
        };
        Some(Self {
            is_moving: flag(0),
            is_enabled: flag(1),
            error_code,
            error_axis: values[4],
            are_brakes_open: flag(5),
            is_paused: flag(6),
            is_emergency_stop: flag(7),
            is_guard_open: flag(8),
            is_electrified: flag(9),
            is_box_connected: flag(10),
            is_blending_done: flag(11),
            is_in_position: flag(12),
        })
    }

    /// Values of a reply.
    #[must_use]
    pub fn values(&self) -> Vec<String> {
        let flag = |value: bool| i64::from(value);
        let values = [
            flag(self.is_moving),
            flag(self.is_enabled),
            flag(self.error_code != 0),
            self.error_code,
            self.error_axis,
            flag(self.are_brakes_open),
            flag(self.is_paused),
            flag(self.is_emergency_stop),
            flag(self.is_guard_open),
            flag(self.is_electrified),
            flag(self.is_box_connected),
            flag(self.is_blending_done),
            flag(self.is_in_position),
        ];
        values.map(|value| value.to_string()).to_vec()
    }
}

/// Values of `ReadActPos`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActualPosition {
    /// Pose of the tool, mm and degrees.
    pub pose: [f64; 6],
    /// Joints, degrees.
    pub joints_deg: [f64; 6],
}

impl ActualPosition {
    /// Reads the values of a reply: pose, joints, and tool and user frame, which are left.
    #[must_use]
    pub fn read(values: &[String]) -> Option<Self> {
        let fields: Vec<&str> = values.get(..12)?.iter().map(String::as_str).collect();
        Some(Self { pose: reals(&fields[..6])?, joints_deg: reals(&fields[6..])? })
    }

    /// Values of a reply, tool and user frame zero.
    #[must_use]
    pub fn values(&self) -> Vec<String> {
        self.pose.iter().chain(&self.joints_deg).chain(&[0.0; 12]).map(|value| number(*value)).collect()
    }
}

/// Reads a position of `ACS2PCS`, mm.
pub(crate) fn position_mm(values: &[String]) -> Option<[f64; 3]> {
    let values: Option<Vec<f64>> = values.get(..3)?.iter().map(|value| real(value)).collect();
    values?.try_into().ok()
}

/// Text of numbers, for replies.
pub(crate) fn texts(values: &[f64]) -> Vec<String> {
    values.iter().map(|value| number(*value)).collect()
}

/// State of a robot that is disabled.
pub const FSM_DISABLED: i32 = 24;
/// State of a robot that moves.
pub const FSM_MOVING: i32 = 25;
/// State of a robot that is ready.
pub const FSM_STANDBY: i32 = 33;

/// Code of a command that is not known.
const UNKNOWN_COMMAND: i64 = 40_056;

/// Words for a state of the controller.
#[must_use]
pub fn fsm_text(state: i32) -> &'static str {
    match state {
        0 | 1 => "the controller is not initialised",
        2 | 3 => "the control box is not connected",
        4 => "the emergency stop is being handled",
        5 => "the emergency stop is pressed",
        6 | 7 => "the robot's 48 V are off",
        8 => "the robot's 48 V are being switched on",
        9..=12 => "the safety guard is open",
        13..=16 | 18 => "the controller is not connected",
        17 => "the fieldbus has an error",
        19 => "the robot is being reset",
        20 => "the robot is outside its safe space",
        21 => "the robot stopped after a collision",
        22 => "the robot is in error",
        23 => "the drives are being enabled",
        FSM_DISABLED => "the drives are disabled",
        FSM_MOVING => "the robot moves",
        26 => "the robot is jogged",
        27 => "the robot is stopping",
        28 => "the drives are being disabled",
        29..=31 => "the robot is guided by hand",
        32 => "the robot is paused",
        FSM_STANDBY => "the robot is ready",
        34..=38 => "a script runs on the controller",
        39 | 40 => "an application of the controller has an error",
        41 => "the load is being identified",
        42 => "the brakes are being switched",
        43 => "the robot is too cold",
        44..=46 => "the robot is guided by hand, by force",
        _ => "a state that is not documented",
    }
}

/// Returns true for the states in which the robot is guided by hand.
#[must_use]
pub fn is_hand_guided_fsm(state: i32) -> bool {
    (29..=31).contains(&state) || (44..=46).contains(&state)
}

/// Words for a code of an error.
#[must_use]
pub fn error_text(code: i64) -> &'static str {
    match code {
        ERROR_WITHOUT_CODE => "an error without a code",
        20_004 => "the robot already moves",
        39_500 => "not connected",
        39_501 => "arguments that the command does not take",
        39_502 => "a reply that cannot be read",
        39_503 => "the socket failed",
        39_504 => "the connection failed",
        40_000 => "the controller is not initialised",
        40_034 => "parameter error",
        UNKNOWN_COMMAND => "the format of the command is wrong",
        _ => "see the maker's list of errors",
    }
}
