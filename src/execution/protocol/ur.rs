//! Universal Robots: the state by RTDE, protocol version 2 ([`rtde`]), motion by a program in URScript that the controller runs
//! ([`program_text`]) and that connects back for commands ([`UrCommand`]). Radians.

pub mod rtde;
mod script;

pub use script::{ServoTuning, program_text};

use crate::execution::device::DeviceError;

/// Micro-units in a unit, for numbers on the wire of the program.
const MICRO: f64 = 1e6;

/// Command to the program on the controller: ten 32-bit integers, big endian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UrCommand {
    /// Stay on: feeds the watchdog.
    KeepAlive,
    /// Joints to be at now.
    SetPoint([f64; 6]),
    /// Joints to go to; acknowledged by its number.
    Move {
        /// Number of the target, below 2³¹.
        sequence: u32,
        /// Joints, radians.
        joints_rad: [f64; 6],
        /// Speed of the leading axis, rad/s.
        speed_rad_s: f64,
        /// Acceleration of the leading axis, rad/s².
        acceleration_rad_s2: f64,
    },
    /// Stop by a ramp and stay; acknowledged by its number.
    Stop {
        /// Number of the stop, below 2³¹.
        sequence: u32,
        /// Deceleration of the leading axis, rad/s².
        acceleration_rad_s2: f64,
    },
    /// Stop and end the program.
    End,
}

impl UrCommand {
    /// Integers of a command.
    pub const INTEGERS: usize = 10;
    /// Bytes of a command.
    pub const BYTES: usize = 4 * Self::INTEGERS;

    /// The bytes. Values beyond the range, which is ±2147 rad, are cut to it.
    #[must_use]
    pub fn encode(&self) -> [u8; Self::BYTES] {
        const REST: [f64; 6] = [0.0; 6];
        let (kind, sequence, joints_rad, speed, acceleration) = match *self {
            Self::KeepAlive => (0, 0, REST, 0.0, 0.0),
            Self::SetPoint(joints_rad) => (1, 0, joints_rad, 0.0, 0.0),
            Self::Move { sequence, joints_rad, speed_rad_s, acceleration_rad_s2 } => {
                (2, sequence, joints_rad, speed_rad_s, acceleration_rad_s2)
            }
            Self::Stop { sequence, acceleration_rad_s2 } => (3, sequence, REST, 0.0, acceleration_rad_s2),
            Self::End => (4, 0, REST, 0.0, 0.0),
        };
        let micro = |value: f64| (value * MICRO).round() as i32;
        let integers = [kind, sequence as i32].into_iter().chain(joints_rad.map(micro)).chain([speed, acceleration].map(micro));
        let mut bytes = [0; Self::BYTES];
        for (place, integer) in bytes.as_chunks_mut().0.iter_mut().zip(integers) {
            *place = integer.to_be_bytes();
        }
        bytes
    }

    /// Reads a command, as the program does.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no command.
    pub fn decode(bytes: &[u8; Self::BYTES]) -> Result<Self, DeviceError> {
        let mut integers = [0; Self::INTEGERS];
        for (integer, place) in integers.iter_mut().zip(bytes.as_chunks().0) {
            *integer = i32::from_be_bytes(*place);
        }
        let [kind, sequence, joints @ .., speed, acceleration] = integers;
        let unit = |micro: i32| f64::from(micro) / MICRO;
        let (sequence, joints_rad) = (sequence as u32, joints.map(unit));
        Ok(match kind {
            0 => Self::KeepAlive,
            1 => Self::SetPoint(joints_rad),
            2 => Self::Move { sequence, joints_rad, speed_rad_s: unit(speed), acceleration_rad_s2: unit(acceleration) },
            3 => Self::Stop { sequence, acceleration_rad_s2: unit(acceleration) },
            4 => Self::End,
            _ => return Err(malformed(format!("command {kind}"))),
        })
    }
}

fn malformed(what: impl Into<String>) -> DeviceError {
    DeviceError::Malformed { what: what.into() }
}

#[cfg(test)]
mod tests;
