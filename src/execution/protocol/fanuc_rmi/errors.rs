//! Error numbers of the interface (B-84184EN/03, appendix A.1), and the names of the controller's faults.

/// Number before RMIT-001.
const RMIT: i64 = 2_556_928;

/// Words for an `ErrorID`.
#[must_use]
pub fn error_text(error: i64) -> &'static str {
    match error - RMIT {
        1 => "internal error of the controller",
        5 => "speed override out of range",
        6 => "the program cannot be executed",
        7 => "servo power is off",
        8 => "the teach pendant is enabled",
        9 => "remote motion is not running",
        10 => "the program is not paused",
        11 => "the program cannot go on",
        12 => "the controller cannot be reset",
        13 => "unknown command",
        14 => "the command failed",
        15 => "the state of the controller does not allow it",
        16 => "the controller asks for its power to be cycled",
        20 => "unknown instruction",
        21 => "value out of range",
        22 => "text not understood",
        23 => "position not understood",
        24 => "on hold after an invalid instruction, until it is reset",
        25 => "the remote device was disconnected",
        26 => "another client is connected",
        27 => "the command before is not done yet",
        28 => "an instruction is not done yet",
        29 => "number of the instruction out of order",
        30 | 31 => "speed out of range",
        32 | 33 => "termination out of range",
        36 => "the destination cannot be reached",
        39 | 40 => "the motion group does not fit the controller; set group_mask",
        43 => "the controller is in single step mode",
        _ => match error {
            7004 | 7015 => "the program RMI_MOVE is selected; select another on the teach pendant",
            _ => "see the error table of B-84184EN",
        },
    }
}

/// A fault as the controller names it: `SRVO-002`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RmiFault {
    /// Part of the controller, `SRVO`.
    pub facility: String,
    /// Number within it.
    pub number: u32,
}

impl RmiFault {
    /// The fault that a text begins with; `None` without one.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let (facility, rest) = text.trim().split_once('-')?;
        let is_facility = (2..=4).contains(&facility.len()) && facility.bytes().all(|byte| byte.is_ascii_uppercase());
        let digits = rest.split(|c: char| !c.is_ascii_digit()).next()?;
        Some(Self { facility: facility.to_owned(), number: digits.parse().ok()? }).filter(|_| is_facility)
    }

    /// Emergency stop: of the operator's panel, of the teach pendant, or from outside.
    #[must_use]
    pub fn is_emergency_stop(&self) -> bool {
        self.facility == "SRVO" && [1, 2, 7].contains(&self.number)
    }

    /// The fence is open.
    #[must_use]
    pub fn is_guard(&self) -> bool {
        self.facility == "SRVO" && self.number == 4
    }
}
