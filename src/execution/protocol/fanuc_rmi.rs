//! FANUC Remote Motion Interface (B-84184EN/03): lines of JSON that end in CR LF, over TCP. A packet to port 16001 opens a session
//! and its answer names the port of that session. A command is answered at once, an instruction when it was carried out.
//! Degrees; the controller counts joint 3 from the ground, the table is its first extended axis, `J7`.

mod errors;
mod packet;
mod reply;

use std::time::Duration;

pub use errors::{RmiFault, error_text};
use packet::{RmiPacket, malformed};
pub use reply::{RmiProgram, RmiReply, RmiStatus};
use serde_json::Value;

use crate::cell::JointThreeOrigin;
use crate::execution::device::DeviceError;

/// Largest line that is read, bytes.
pub const MAX_LINE_BYTES: usize = 4096;
/// Largest number of an instruction; the next is 1 again.
pub const MAX_SEQUENCE: u32 = i32::MAX as u32;
/// Largest value of a speed.
const MAX_SPEED: u128 = 32_767;

/// A packet to the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum RmiRequest {
    /// Opens a session; to port 16001 only.
    Connect,
    /// Ends the session.
    Disconnect,
    /// Creates and runs the program that instructions are added to.
    Initialize {
        /// Motion groups, a bit each; left out on controllers with one group.
        group_mask: Option<u8>,
    },
    /// Asks for the status.
    GetStatus,
    /// Asks for the measured joints.
    ReadJointAngles {
        /// Motion group, 1 to 8; left out for the first.
        group: Option<u8>,
    },
    /// Asks for the latest fault.
    ReadError,
    /// Sets the speed override, percent, 1 to 100.
    SetOverRide(u8),
    /// Ends the program and forgets its instructions.
    Abort,
    /// Holds the program.
    Pause,
    /// Lets a held program go on.
    Continue,
    /// Clears faults.
    Reset,
    /// Adds a joint move that ends at rest.
    JointMotion(RmiJointMotion),
}

/// A joint move that ends at rest, `TermType` `FINE`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RmiJointMotion {
    /// Number of the instruction, consecutive from 1.
    pub sequence: u32,
    /// Joints at its end.
    pub joints: RmiJoints,
    /// Time that it takes.
    pub speed: RmiSpeed,
}

/// Joints in degrees, as the controller counts them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RmiJoints {
    /// Joints 1 to 6.
    pub arm_deg: [f64; 6],
    /// Extended axes `J7` to `J9`, those that the controller has: the table is the first of them.
    pub extended_deg: [Option<f64>; 3],
}

/// Speed of a joint move, given as its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RmiSpeed {
    /// `mSec`.
    Milliseconds(u16),
    /// `Time`, in tenths of a second.
    Tenths(u16),
}

impl RmiSpeed {
    /// Time of a move, rounded up to what the protocol can say.
    ///
    /// # Errors
    /// [`DeviceError::Unsupported`]: longer than 3276.7 s.
    pub fn lasting(duration: Duration) -> Result<Self, DeviceError> {
        let ms = duration.as_micros().div_ceil(1000).max(1);
        let tenths = ms.div_ceil(100);
        match (u16::try_from(ms), u16::try_from(tenths)) {
            (Ok(speed), _) if ms <= MAX_SPEED => Ok(Self::Milliseconds(speed)),
            (_, Ok(speed)) if tenths <= MAX_SPEED => Ok(Self::Tenths(speed)),
            _ => Err(DeviceError::Unsupported { what: format!("make a move of {} s; raise the speed of the run", ms / 1000) }),
        }
    }

    /// The time.
    #[must_use]
    pub fn duration(self) -> Duration {
        match self {
            Self::Milliseconds(ms) => Duration::from_millis(ms.into()),
            Self::Tenths(tenths) => Duration::from_millis(100 * u64::from(tenths)),
        }
    }

    fn fields(self) -> (&'static str, u16) {
        match self {
            Self::Milliseconds(ms) => ("mSec", ms),
            Self::Tenths(tenths) => ("Time", tenths),
        }
    }
}

impl RmiJoints {
    /// Joints of a program, radians, the table last if there is one, as the controller counts them: J₃ is q₃ − q₂ where q₃ is
    /// counted from the upper arm. Other extended axes stay at `extended_deg`.
    #[must_use]
    pub fn of_program<const N: usize>(
        joints_rad: &[f64; N],
        joint_3_from: JointThreeOrigin,
        mut extended_deg: [Option<f64>; 3],
    ) -> Self {
        let mut arm_deg = std::array::from_fn(|joint| joints_rad.get(joint).copied().unwrap_or_default().to_degrees());
        arm_deg[2] -= Self::coupling(joint_3_from) * arm_deg[1];
        extended_deg[0] = joints_rad.get(6).map(|table| table.to_degrees()).or(extended_deg[0]);
        Self { arm_deg, extended_deg }
    }

    /// The joints as a program counts them, radians; `None` without a table that is asked for.
    #[must_use]
    pub fn to_program<const N: usize>(self, joint_3_from: JointThreeOrigin) -> Option<[f64; N]> {
        let mut arm_deg = self.arm_deg;
        arm_deg[2] += Self::coupling(joint_3_from) * arm_deg[1];
        let mut joints_rad = [0.0; N];
        for (joint, rad) in joints_rad.iter_mut().enumerate() {
            *rad = arm_deg.get(joint).copied().or(self.extended_deg[0])?.to_radians();
        }
        Some(joints_rad)
    }

    fn coupling(joint_3_from: JointThreeOrigin) -> f64 {
        match joint_3_from {
            JointThreeOrigin::Ground => 0.0,
            JointThreeOrigin::UpperArm => 1.0,
        }
    }

    /// `{"J1": …}`, with the extended axes that there are.
    fn encode(&self) -> String {
        let numbers = self.arm_deg.into_iter().map(Some).chain(self.extended_deg).enumerate();
        let fields = numbers.filter_map(|(joint, deg)| deg.map(|deg| format!("\"J{}\": {deg:.6}", joint + 1)));
        format!("{{{}}}", fields.collect::<Vec<_>>().join(", "))
    }

    fn decode(packet: &RmiPacket) -> Result<Self, DeviceError> {
        let joints = packet.0.get("JointAngle").and_then(Value::as_object);
        let joint = |index: usize| joints?.get(&format!("J{index}"))?.as_f64();
        let mut arm_deg = [0.0; 6];
        for (index, deg) in arm_deg.iter_mut().enumerate() {
            *deg = joint(index + 1).ok_or_else(|| malformed(format!("joint angles without J{}", index + 1)))?;
        }
        Ok(Self { arm_deg, extended_deg: [joint(7), joint(8), joint(9)] })
    }
}

impl RmiRequest {
    /// Name of the packet.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Connect => "FRC_Connect",
            Self::Disconnect => "FRC_Disconnect",
            Self::Initialize { .. } => "FRC_Initialize",
            Self::GetStatus => "FRC_GetStatus",
            Self::ReadJointAngles { .. } => "FRC_ReadJointAngles",
            Self::ReadError => "FRC_ReadError",
            Self::SetOverRide(_) => "FRC_SetOverRide",
            Self::Abort => "FRC_Abort",
            Self::Pause => "FRC_Pause",
            Self::Continue => "FRC_Continue",
            Self::Reset => "FRC_Reset",
            Self::JointMotion(_) => "FRC_JointMotionJRep",
        }
    }

    /// The line, with its end.
    #[must_use]
    pub fn encode(&self) -> String {
        let name = self.name();
        let (kind, rest) = match self {
            Self::Connect | Self::Disconnect => ("Communication", String::new()),
            Self::Initialize { group_mask } => ("Command", field("GroupMask", *group_mask)),
            Self::ReadJointAngles { group } => ("Command", field("Group", *group)),
            Self::SetOverRide(percent) => ("Command", field("Value", Some(*percent))),
            Self::GetStatus | Self::ReadError | Self::Abort | Self::Pause | Self::Continue | Self::Reset => {
                ("Command", String::new())
            }
            Self::JointMotion(motion) => ("Instruction", motion.fields()),
        };
        format!("{{\"{kind}\": \"{name}\"{rest}}}\r\n")
    }

    /// Reads a line, as a controller does.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no packet of this module.
    pub fn decode(line: &[u8]) -> Result<Self, DeviceError> {
        let packet = RmiPacket::read(line)?;
        let (_, name) = packet.name()?;
        Ok(match name {
            "FRC_Connect" => Self::Connect,
            "FRC_Disconnect" => Self::Disconnect,
            "FRC_Initialize" => Self::Initialize { group_mask: packet.optional("GroupMask") },
            "FRC_GetStatus" => Self::GetStatus,
            "FRC_ReadJointAngles" => Self::ReadJointAngles { group: packet.optional("Group") },
            "FRC_ReadError" => Self::ReadError,
            "FRC_SetOverRide" => Self::SetOverRide(packet.number("Value")?),
            "FRC_Abort" => Self::Abort,
            "FRC_Pause" => Self::Pause,
            "FRC_Continue" => Self::Continue,
            "FRC_Reset" => Self::Reset,
            "FRC_JointMotionJRep" => Self::JointMotion(RmiJointMotion::decode(&packet)?),
            _ => return Err(malformed(format!("the packet {name:?}"))),
        })
    }
}

fn field(name: &str, value: Option<u8>) -> String {
    value.map(|value| format!(", \"{name}\": {value}")).unwrap_or_default()
}

impl RmiJointMotion {
    fn fields(&self) -> String {
        let (kind, speed) = self.speed.fields();
        let joints = self.joints.encode();
        format!(
            ", \"SequenceID\": {}, \"JointAngle\": {joints}, \"SpeedType\": \"{kind}\", \"Speed\": {speed}, \
             \"TermType\": \"FINE\", \"TermValue\": 1",
            self.sequence
        )
    }

    fn decode(packet: &RmiPacket) -> Result<Self, DeviceError> {
        let speed = packet.number("Speed")?;
        let speed = match packet.0.get("SpeedType").and_then(Value::as_str) {
            Some("mSec") => RmiSpeed::Milliseconds(speed),
            Some("Time") => RmiSpeed::Tenths(speed),
            _ => return Err(malformed("a joint motion whose speed is no time")),
        };
        Ok(Self { sequence: packet.number("SequenceID")?, joints: RmiJoints::decode(packet)?, speed })
    }
}

#[cfg(test)]
mod tests;
