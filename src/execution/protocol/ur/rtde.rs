//! Real-Time Data Exchange, protocol version 2: frames of a length (16 bits), a type (a letter) and a body, big endian, over TCP.
//! (Universal Robots, *RTDE Guide*.)

use super::malformed;
use crate::execution::device::DeviceError;

/// Version of the protocol.
pub const VERSION: u16 = 2;
/// Bytes before a body.
const HEADER_BYTES: usize = 3;
/// Variables that are asked for, with their types, in the order of [`RtdeState`].
pub const OUTPUTS: [(&str, &str); 7] = [
    ("timestamp", "DOUBLE"),
    ("actual_q", "VECTOR6D"),
    ("actual_qd", "VECTOR6D"),
    ("runtime_state", "UINT32"),
    ("robot_status_bits", "UINT32"),
    ("safety_status_bits", "UINT32"),
    ("robot_mode", "INT32"),
];
/// Bytes of [`RtdeState`] in a frame, without the number of the recipe.
const STATE_BYTES: usize = 8 + 48 + 48 + 4 * 4;
/// `ROBOT_MODE_RUNNING`: the brakes are released. In the modes below it the arm is off, or on behind closed brakes.
pub const MODE_RUNNING: i32 = 7;

/// A frame: its type and its body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RtdeFrame<'a> {
    /// Type.
    pub kind: u8,
    /// Body.
    pub body: &'a [u8],
}

impl<'a> RtdeFrame<'a> {
    /// The first frame of what was received, and the number of its bytes; `None` while it is not complete.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: a length below that of a header.
    pub fn first(received: &'a [u8]) -> Result<Option<(Self, usize)>, DeviceError> {
        let Some(([high, low, kind], _)) = received.split_first_chunk() else { return Ok(None) };
        let length = usize::from(u16::from_be_bytes([*high, *low]));
        if length < HEADER_BYTES {
            return Err(malformed(format!("an RTDE frame of {length} bytes")));
        }
        Ok(received.get(HEADER_BYTES..length).map(|body| (Self { kind: *kind, body }, length)))
    }

    fn bytes(kind: u8, parts: &[&[u8]]) -> Vec<u8> {
        let body = parts.concat();
        let length = u16::try_from(HEADER_BYTES + body.len()).unwrap_or(u16::MAX);
        [&length.to_be_bytes()[..], &[kind], &body].concat()
    }
}

/// Frame to the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum RtdeRequest {
    /// Asks for a version of the protocol.
    Version(u16),
    /// Asks for the version of the controller.
    ControlVersion,
    /// Names the variables to send, and the rate.
    Outputs {
        /// Rate, Hz.
        rate_hz: f64,
        /// Names, separated by commas.
        names: String,
    },
    /// Names the variables that will be written.
    Inputs {
        /// Names, separated by commas.
        names: String,
    },
    /// Begin to send.
    Start,
    /// Cease to send.
    Pause,
    /// Values for the variables of a recipe.
    Data {
        /// Number of the recipe.
        recipe: u8,
        /// Values, as their types say.
        values: Vec<u8>,
    },
}

/// Frame of the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum RtdeReply {
    /// The version asked for is accepted, or not.
    Version(bool),
    /// Version of the controller: major, minor, bug fix, build.
    ControlVersion([u32; 4]),
    /// A message for people.
    Text(String),
    /// Recipe of what is sent, with types; `NOT_FOUND` for an unknown variable, `IN_USE` for one that another client writes.
    Outputs {
        /// Number of the recipe, 0 if there is none.
        recipe: u8,
        /// Types, separated by commas.
        types: String,
    },
    /// Recipe of what is written.
    Inputs {
        /// Number of the recipe, 0 if there is none.
        recipe: u8,
        /// Types, separated by commas.
        types: String,
    },
    /// Sending has begun, or not.
    Start(bool),
    /// Sending has ceased, or not.
    Pause(bool),
    /// Values of the variables of a recipe.
    Data {
        /// Number of the recipe.
        recipe: u8,
        /// Values, as their types say.
        values: Vec<u8>,
    },
}

/// State of an arm: the variables of [`OUTPUTS`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RtdeState {
    /// Time since the controller was started, s.
    pub timestamp_secs: f64,
    /// Measured joints, radians.
    pub joints_rad: [f64; 6],
    /// Measured speeds, rad/s.
    pub speeds_rad_s: [f64; 6],
    /// State of the program.
    pub runtime: u32,
    /// Bits: power on, program running, teach button, power button.
    pub robot_bits: u32,
    /// Bits: normal, reduced, protective stop, recovery, safeguard stop, system, robot or any emergency stop, violation, fault,
    /// stopped due to safety.
    pub safety_bits: u32,
    /// Mode of the robot; [`MODE_RUNNING`] is the one in which it can be moved.
    pub mode: i32,
}

impl RtdeRequest {
    /// The request for the variables of [`OUTPUTS`].
    #[must_use]
    pub fn outputs(rate_hz: f64) -> Self {
        Self::Outputs { rate_hz, names: OUTPUTS.map(|(name, _)| name).join(",") }
    }

    /// The bytes.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        match self {
            Self::Version(version) => RtdeFrame::bytes(b'V', &[&version.to_be_bytes()]),
            Self::ControlVersion => RtdeFrame::bytes(b'v', &[]),
            Self::Outputs { rate_hz, names } => RtdeFrame::bytes(b'O', &[&rate_hz.to_be_bytes(), names.as_bytes()]),
            Self::Inputs { names } => RtdeFrame::bytes(b'I', &[names.as_bytes()]),
            Self::Start => RtdeFrame::bytes(b'S', &[]),
            Self::Pause => RtdeFrame::bytes(b'P', &[]),
            Self::Data { recipe, values } => RtdeFrame::bytes(b'U', &[&[*recipe], values]),
        }
    }

    /// Reads a frame, as a controller does.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no such frame.
    pub fn decode(frame: RtdeFrame<'_>) -> Result<Self, DeviceError> {
        let mut body = Body(frame.body);
        Ok(match frame.kind {
            b'V' => Self::Version(u16::from_be_bytes(body.take()?)),
            b'v' => Self::ControlVersion,
            b'O' => Self::Outputs { rate_hz: f64::from_be_bytes(body.take()?), names: body.text()? },
            b'I' => Self::Inputs { names: body.text()? },
            b'S' => Self::Start,
            b'P' => Self::Pause,
            b'U' => Self::Data { recipe: body.byte()?, values: body.0.to_vec() },
            kind => return Err(malformed(format!("an RTDE frame of type {kind}"))),
        })
    }
}

impl RtdeReply {
    /// Reads a frame.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no such frame.
    pub fn decode(frame: RtdeFrame<'_>) -> Result<Self, DeviceError> {
        let mut body = Body(frame.body);
        Ok(match frame.kind {
            b'V' => Self::Version(body.byte()? != 0),
            b'v' => Self::ControlVersion([body.word()?, body.word()?, body.word()?, body.word()?]),
            b'M' => {
                let length = usize::from(body.byte()?);
                let text = body.0.get(..length).ok_or_else(|| malformed("a cut message"))?;
                Self::Text(String::from_utf8_lossy(text).into_owned())
            }
            b'O' => Self::Outputs { recipe: body.byte()?, types: body.text()? },
            b'I' => Self::Inputs { recipe: body.byte()?, types: body.text()? },
            b'S' => Self::Start(body.byte()? != 0),
            b'P' => Self::Pause(body.byte()? != 0),
            b'U' => Self::Data { recipe: body.byte()?, values: body.0.to_vec() },
            kind => return Err(malformed(format!("an RTDE frame of type {kind}"))),
        })
    }

    /// The bytes, as a controller writes them.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        match self {
            Self::Version(accepted) => RtdeFrame::bytes(b'V', &[&[u8::from(*accepted)]]),
            Self::ControlVersion(version) => {
                let version = version.map(u32::to_be_bytes);
                RtdeFrame::bytes(b'v', &[version.as_flattened()])
            }
            Self::Text(text) => {
                let length = text.floor_char_boundary(255);
                RtdeFrame::bytes(b'M', &[&[length as u8], &text.as_bytes()[..length], &[0, 0]])
            }
            Self::Outputs { recipe, types } => RtdeFrame::bytes(b'O', &[&[*recipe], types.as_bytes()]),
            Self::Inputs { recipe, types } => RtdeFrame::bytes(b'I', &[&[*recipe], types.as_bytes()]),
            Self::Start(accepted) => RtdeFrame::bytes(b'S', &[&[u8::from(*accepted)]]),
            Self::Pause(accepted) => RtdeFrame::bytes(b'P', &[&[u8::from(*accepted)]]),
            Self::Data { recipe, values } => RtdeFrame::bytes(b'U', &[&[*recipe], values]),
        }
    }
}

impl RtdeState {
    /// Reads the values of a data frame.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: another length, or joints that are not numbers.
    pub fn decode(values: &[u8]) -> Result<Self, DeviceError> {
        if values.len() != STATE_BYTES {
            return Err(malformed(format!("{} bytes of state for {STATE_BYTES}", values.len())));
        }
        let mut body = Body(values);
        let state = Self {
            timestamp_secs: body.double()?,
            joints_rad: body.six()?,
            speeds_rad_s: body.six()?,
            runtime: body.word()?,
            robot_bits: body.word()?,
            safety_bits: body.word()?,
            mode: body.take().map(i32::from_be_bytes)?,
        };
        let is_finite = state.joints_rad.iter().chain(&state.speeds_rad_s).all(|value| value.is_finite());
        if is_finite { Ok(state) } else { Err(malformed("joints that are not numbers")) }
    }

    /// The values of a data frame, as a controller writes them.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let doubles = [self.timestamp_secs].into_iter().chain(self.joints_rad).chain(self.speeds_rad_s);
        let words = [self.runtime, self.robot_bits, self.safety_bits, self.mode.cast_unsigned()];
        doubles.flat_map(f64::to_be_bytes).chain(words.into_iter().flat_map(u32::to_be_bytes)).collect()
    }

    /// The drives have power.
    #[must_use]
    pub fn is_powered(&self) -> bool {
        self.robot_bits & 1 != 0
    }

    /// The brakes are released: an arm that is switched on alone has power and stands behind closed brakes.
    #[must_use]
    pub fn are_brakes_open(&self) -> bool {
        self.mode == MODE_RUNNING
    }

    /// A program runs.
    #[must_use]
    pub fn is_program_running(&self) -> bool {
        self.robot_bits & 1 << 1 != 0
    }

    /// The teach button is pressed: the arm is guided by hand.
    #[must_use]
    pub fn is_hand_guided(&self) -> bool {
        self.robot_bits & 1 << 2 != 0
    }

    /// The program is paused, or about to be.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        [3, 4].contains(&self.runtime)
    }

    /// An emergency stop of the system, of the robot, or any.
    #[must_use]
    pub fn is_emergency_stopped(&self) -> bool {
        self.safety_bits >> 5 & 0b111 != 0
    }

    /// A safeguard stop.
    #[must_use]
    pub fn is_guard_stopped(&self) -> bool {
        self.safety_bits & 1 << 4 != 0
    }

    /// Number of the first safety bit that stands for a fault: protective stop 2, recovery 3, violation 8, fault 9.
    #[must_use]
    pub fn fault_bit(&self) -> Option<u32> {
        [9, 8, 2, 3].into_iter().find(|bit| self.safety_bits & 1 << bit != 0)
    }
}

/// Rest of a body.
struct Body<'a>(&'a [u8]);

impl Body<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], DeviceError> {
        let (value, rest) = self.0.split_first_chunk().ok_or_else(|| malformed("a cut RTDE frame"))?;
        self.0 = rest;
        Ok(*value)
    }

    fn byte(&mut self) -> Result<u8, DeviceError> {
        self.take().map(|[byte]| byte)
    }

    fn word(&mut self) -> Result<u32, DeviceError> {
        self.take().map(u32::from_be_bytes)
    }

    fn double(&mut self) -> Result<f64, DeviceError> {
        self.take().map(f64::from_be_bytes)
    }

    fn six(&mut self) -> Result<[f64; 6], DeviceError> {
        let mut numbers = [0.0; 6];
        for number in &mut numbers {
            *number = self.double()?;
        }
        Ok(numbers)
    }

    fn text(&mut self) -> Result<String, DeviceError> {
        std::str::from_utf8(self.0).map(str::to_owned).map_err(|_| malformed("an RTDE frame whose text is not UTF-8"))
    }
}
