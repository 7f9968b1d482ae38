//! Packets of the controller: answers to commands and instructions, and what it says by itself.

use serde_json::Value;

use super::packet::{RmiPacket, malformed};
use super::{RmiJoints, RmiRequest};
use crate::execution::device::DeviceError;

/// A packet of the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum RmiReply {
    /// A session is open.
    Connected {
        /// Port of the session.
        port: u16,
        /// Version of the protocol.
        version: (u16, u16),
    },
    /// Status.
    Status(RmiStatus),
    /// Measured joints.
    Joints(RmiJoints),
    /// Latest fault, `SRVO-002`.
    ErrorText(String),
    /// A command without data was carried out.
    Done {
        /// Name of the command.
        command: String,
    },
    /// An instruction was carried out.
    Moved {
        /// Number of the instruction.
        sequence: u32,
    },
    /// A command or an instruction was refused, or failed.
    Refused {
        /// Name of the packet, `Unknown` where the controller did not understand it.
        command: String,
        /// Number of the instruction, where it is one.
        sequence: Option<u32>,
        /// `ErrorID`; [`super::error_text`] has its words.
        error: i64,
    },
    /// The program is held by a fault.
    SystemFault {
        /// Number of the instruction that caused it.
        sequence: Option<u32>,
    },
    /// The controller ended the session after a long silence.
    Terminated,
}

/// Status of a controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RmiStatus {
    /// Ready for motion, without a fault.
    pub servo_ready: bool,
    /// The teach pendant is on: no remote motion.
    pub pendant_enabled: bool,
    /// A program of this interface runs.
    pub motion_running: bool,
    /// State of that program.
    pub program: RmiProgram,
    /// Next number of an instruction, where the controller checks them.
    pub next_sequence: Option<u32>,
    /// Speed override, percent, where it is sent.
    pub override_percent: Option<u32>,
}

/// State of the program that instructions are added to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RmiProgram {
    /// Runs.
    Running,
    /// Held.
    Paused,
    /// Ended, or never begun.
    #[default]
    Aborted,
}

impl RmiReply {
    /// Returns true if it answers a command.
    #[must_use]
    pub fn answers(&self, request: &RmiRequest) -> bool {
        let is = |name: &str| name.eq_ignore_ascii_case(request.name());
        match self {
            Self::Connected { .. } => is("FRC_Connect"),
            Self::Status(_) => is("FRC_GetStatus"),
            Self::Joints(_) => is("FRC_ReadJointAngles"),
            Self::ErrorText(_) => is("FRC_ReadError"),
            Self::Done { command } => is(command),
            Self::Refused { command, sequence: None, .. } => is(command) || command == "Unknown",
            Self::Refused { .. } | Self::Moved { .. } | Self::SystemFault { .. } | Self::Terminated => false,
        }
    }

    /// Reads a line.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no packet of this protocol.
    pub fn decode(line: &[u8]) -> Result<Self, DeviceError> {
        let packet = RmiPacket::read(line)?;
        let (kind, name) = packet.name()?;
        match name {
            "FRC_Terminate" => return Ok(Self::Terminated),
            "FRC_SystemFault" => return Ok(Self::SystemFault { sequence: packet.optional("SequenceID") }),
            _ => {}
        }
        let (command, sequence) = (name.to_owned(), packet.optional("SequenceID"));
        let error = packet.0.get("ErrorID").and_then(Value::as_i64).ok_or_else(|| malformed("an answer without ErrorID"))?;
        if error != 0 || name == "Unknown" {
            return Ok(Self::Refused { command, sequence, error });
        }
        Ok(match (kind, name) {
            ("Communication", "FRC_Connect") => {
                let version = (packet.optional("MajorVersion").unwrap_or(0), packet.optional("MinorVersion").unwrap_or(0));
                Self::Connected { port: packet.number("PortNumber")?, version }
            }
            (_, "FRC_GetStatus") => Self::Status(RmiStatus::decode(&packet)?),
            (_, "FRC_ReadJointAngles") => Self::Joints(RmiJoints::decode(&packet)?),
            (_, "FRC_ReadError") => {
                let text = packet.0.get("ErrorData").and_then(Value::as_str).unwrap_or_default();
                Self::ErrorText(text.chars().take(200).collect())
            }
            ("Instruction", _) => Self::Moved { sequence: packet.number("SequenceID")? },
            _ => Self::Done { command },
        })
    }

    /// The line, with its end, as a controller writes it.
    #[must_use]
    pub fn encode(&self) -> String {
        let packet = match self {
            Self::Connected { port, version: (major, minor) } => format!(
                "\"Communication\": \"FRC_Connect\", \"ErrorID\": 0, \"PortNumber\": {port}, \"MajorVersion\": {major}, \
                 \"MinorVersion\": {minor}"
            ),
            Self::Status(status) => status.encode(),
            Self::Joints(joints) => format!(
                "\"Command\": \"FRC_ReadJointAngles\", \"ErrorID\": 0, \"TimeTag\": 0, \"JointAngle\": {}, \"Group\": 1",
                joints.encode()
            ),
            Self::ErrorText(text) => {
                let text = Value::from(text.as_str());
                format!("\"Command\": \"FRC_ReadError\", \"ErrorID\": 0, \"Count\": 1, \"ErrorData\": {text}")
            }
            Self::Done { command } => {
                let kind = if command == "FRC_Disconnect" { "Communication" } else { "Command" };
                format!("\"{kind}\": \"{command}\", \"ErrorID\": 0")
            }
            Self::Moved { sequence } => {
                format!("\"Instruction\": \"FRC_JointMotionJRep\", \"ErrorID\": 0, \"SequenceID\": {sequence}")
            }
            Self::Refused { command, sequence: Some(sequence), error } => {
                format!("\"Instruction\": \"{command}\", \"ErrorID\": {error}, \"SequenceID\": {sequence}")
            }
            Self::Refused { command, sequence: None, error } => format!("\"Command\": \"{command}\", \"ErrorID\": {error}"),
            Self::SystemFault { sequence } => {
                format!("\"Communication\": \"FRC_SystemFault\", \"SequenceID\": {}", sequence.unwrap_or(0))
            }
            Self::Terminated => "\"Communication\": \"FRC_Terminate\"".to_owned(),
        };
        format!("{{{packet}}}\r\n")
    }
}

impl RmiStatus {
    fn decode(packet: &RmiPacket) -> Result<Self, DeviceError> {
        Ok(Self {
            servo_ready: packet.number::<u8>("ServoReady")? == 1,
            pendant_enabled: packet.number::<u8>("TPMode")? != 0,
            motion_running: packet.number::<u8>("RMIMotionStatus")? != 0,
            program: match packet.number::<u8>("ProgramStatus")? {
                0 => RmiProgram::Running,
                1 => RmiProgram::Paused,
                _ => RmiProgram::Aborted,
            },
            next_sequence: packet.optional("NextSequenceID"),
            override_percent: packet.optional("Override"),
        })
    }

    fn encode(&self) -> String {
        let program = match self.program {
            RmiProgram::Running => 0,
            RmiProgram::Paused => 1,
            RmiProgram::Aborted => 2,
        };
        format!(
            "\"Command\": \"FRC_GetStatus\", \"ErrorID\": 0, \"ServoReady\": {}, \"TPMode\": {}, \"RMIMotionStatus\": {}, \
             \"ProgramStatus\": {program}, \"SingleStepMode\": 0, \"NumberUTool\": 10, \"NextSequenceID\": {}, \
             \"NumberUFrame\": 9, \"Override\": {}",
            u8::from(self.servo_ready),
            u8::from(self.pendant_enabled),
            u8::from(self.motion_running),
            self.next_sequence.unwrap_or(1),
            self.override_percent.unwrap_or(100),
        )
    }
}
