//! ABB Externally Guided Motion: frames of Protocol Buffers (proto2) over UDP, `EgmRobot` from the controller and `EgmSensor` to
//! it, by ABB's `egm.proto`, version 1.1. Degrees; fields that are not needed here are skipped, unknown ones too.

mod protobuf;

use protobuf::{Value, WireFields, WireWriter};

use crate::execution::device::DeviceError;

/// Largest frame that is read, bytes; a controller's are below 1000.
pub const MAX_FRAME_BYTES: usize = 4096;
/// Joints of an arm.
const JOINTS: usize = 6;
/// `MSGTYPE_CORRECTION`: guidance, sent to the controller.
const CORRECTION: u64 = 3;
/// `MSGTYPE_DATA`: feedback, sent by the controller.
const DATA: u64 = 2;

/// Positions of the external axes of a controller, degrees: the first `count` of six.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExternalAxes {
    /// Positions, those beyond `count` zero.
    pub deg: [f64; 6],
    /// Number of axes that the frame has.
    pub count: usize,
}

/// State of the drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EgmMotors {
    /// The controller does not tell the state of the drives.
    #[default]
    Unknown,
    /// The drives are on.
    On,
    /// Off.
    Off,
}

/// State of the guidance, `mciState`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EgmGuidance {
    /// The controller does not tell the state of the guidance.
    #[default]
    Unknown,
    /// Error.
    Error,
    /// Guidance does not follow.
    Stopped,
    /// Following what is sent.
    Running,
}

/// State of the RAPID program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EgmRapid {
    /// The controller does not tell the state of the program.
    #[default]
    Unknown,
    /// Stopped.
    Stopped,
    /// Running.
    Running,
}

/// `EgmRobot`: a controller's report.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EgmReport {
    /// Number of the frame.
    pub sequence: u32,
    /// The controller's clock, ms.
    pub time_ms: u32,
    /// Measured joints, degrees.
    pub joints_deg: [f64; JOINTS],
    /// Measured external axes.
    pub external: ExternalAxes,
    /// Joints, degrees, and external axes that it is commanded to, where it tells.
    pub planned: Option<([f64; JOINTS], ExternalAxes)>,
    /// Drives.
    pub motors: EgmMotors,
    /// Guidance.
    pub guidance: EgmGuidance,
    /// The guided position is reached.
    pub converged: bool,
    /// Program.
    pub rapid: EgmRapid,
}

/// `EgmSensor`: where the controller is to go now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EgmGuide {
    /// Number of the frame.
    pub sequence: u32,
    /// The sender's clock, ms.
    pub time_ms: u32,
    /// Joints, degrees.
    pub joints_deg: [f64; JOINTS],
    /// External axes.
    pub external: ExternalAxes,
}

impl EgmReport {
    /// Reads a frame.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no such message, or without six joints.
    pub fn decode(frame: &[u8]) -> Result<Self, DeviceError> {
        let mut report = Self::default();
        let mut joints = ExternalAxes::default();
        for field in WireFields::of(limited(frame)?) {
            match field? {
                (1, Value::Bytes(header)) => (report.sequence, report.time_ms) = read_header(header)?,
                (2, Value::Bytes(feedback)) => (joints, report.external) = read_positions(feedback)?,
                (3, Value::Bytes(planned)) => {
                    let (joints, external) = read_positions(planned)?;
                    report.planned = six(&joints).ok().map(|joints_deg| (joints_deg, external));
                }
                (4, Value::Bytes(state)) => report.motors = motors(enumeration(state)?),
                (5, Value::Bytes(state)) => report.guidance = guidance(enumeration(state)?),
                (6, Value::Varint(converged)) => report.converged = converged != 0,
                (8, Value::Bytes(state)) => report.rapid = rapid(enumeration(state)?),
                _ => {}
            }
        }
        report.joints_deg = six(&joints)?;
        Ok(report)
    }

    /// Writes the frame, as a controller does.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut frame = WireWriter::default();
        frame.message(1, &header(self.sequence, self.time_ms, DATA));
        frame.message(2, &positions(&self.joints_deg, &self.external));
        if let Some((joints_deg, external)) = &self.planned {
            frame.message(3, &positions(joints_deg, external));
        }
        frame.message(
            4,
            &state(match self.motors {
                EgmMotors::Unknown => 0,
                EgmMotors::On => 1,
                EgmMotors::Off => 2,
            }),
        );
        frame.message(
            5,
            &state(match self.guidance {
                EgmGuidance::Unknown => 0,
                EgmGuidance::Error => 1,
                EgmGuidance::Stopped => 2,
                EgmGuidance::Running => 3,
            }),
        );
        frame.varint(6, self.converged.into());
        frame.message(
            8,
            &state(match self.rapid {
                EgmRapid::Unknown => 0,
                EgmRapid::Stopped => 1,
                EgmRapid::Running => 2,
            }),
        );
        frame.bytes
    }
}

impl EgmGuide {
    /// Reads a frame, as a controller does.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no such message, or without six joints.
    pub fn decode(frame: &[u8]) -> Result<Self, DeviceError> {
        let mut guide = Self::default();
        let mut joints = ExternalAxes::default();
        for field in WireFields::of(limited(frame)?) {
            match field? {
                (1, Value::Bytes(header)) => (guide.sequence, guide.time_ms) = read_header(header)?,
                (2, Value::Bytes(planned)) => (joints, guide.external) = read_positions(planned)?,
                _ => {}
            }
        }
        guide.joints_deg = six(&joints)?;
        Ok(guide)
    }

    /// Writes the frame.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut frame = WireWriter::default();
        frame.message(1, &header(self.sequence, self.time_ms, CORRECTION));
        frame.message(2, &positions(&self.joints_deg, &self.external));
        frame.bytes
    }
}

fn limited(frame: &[u8]) -> Result<&[u8], DeviceError> {
    if frame.len() <= MAX_FRAME_BYTES { Ok(frame) } else { Err(malformed(format!("a frame of {} bytes", frame.len()))) }
}

fn malformed(what: impl Into<String>) -> DeviceError {
    DeviceError::Malformed { what: what.into() }
}

/// Sequence number and clock.
fn read_header(header: &[u8]) -> Result<(u32, u32), DeviceError> {
    let mut read = (0, 0);
    for field in WireFields::of(header) {
        match field? {
            (1, Value::Varint(sequence)) => read.0 = sequence as u32,
            (2, Value::Varint(time_ms)) => read.1 = time_ms as u32,
            _ => {}
        }
    }
    Ok(read)
}

fn header(sequence: u32, time_ms: u32, kind: u64) -> Vec<u8> {
    let mut header = WireWriter::default();
    header.varint(1, sequence.into());
    header.varint(2, time_ms.into());
    header.varint(3, kind);
    header.bytes
}

/// Joints and external axes of `EgmFeedBack` or `EgmPlanned`.
fn read_positions(positions: &[u8]) -> Result<(ExternalAxes, ExternalAxes), DeviceError> {
    let mut read = (ExternalAxes::default(), ExternalAxes::default());
    for field in WireFields::of(positions) {
        match field? {
            (1, Value::Bytes(joints)) => read.0 = read_axes(joints)?,
            (3, Value::Bytes(external)) => read.1 = read_axes(external)?,
            _ => {}
        }
    }
    Ok(read)
}

fn positions(joints_deg: &[f64], external: &ExternalAxes) -> Vec<u8> {
    let mut positions = WireWriter::default();
    positions.message(1, &axes(joints_deg));
    if let Some(deg @ [_, ..]) = external.deg.get(..external.count) {
        positions.message(3, &axes(deg));
    }
    positions.bytes
}

/// `EgmJoints`: up to six numbers, each in a field or packed together.
fn read_axes(message: &[u8]) -> Result<ExternalAxes, DeviceError> {
    let mut axes = ExternalAxes::default();
    for field in WireFields::of(message) {
        match field? {
            (1, Value::Fixed64(bytes)) => axes.push(bytes)?,
            (1, Value::Bytes(packed)) => {
                let (values, rest) = packed.as_chunks();
                rest.is_empty().then_some(()).ok_or_else(|| malformed("a cut list of joints"))?;
                values.iter().try_for_each(|bytes| axes.push(*bytes))?;
            }
            _ => {}
        }
    }
    Ok(axes)
}

fn axes(deg: &[f64]) -> Vec<u8> {
    let mut joints = WireWriter::default();
    deg.iter().for_each(|deg| joints.double(1, *deg));
    joints.bytes
}

impl ExternalAxes {
    fn push(&mut self, bytes: [u8; 8]) -> Result<(), DeviceError> {
        let deg = f64::from_le_bytes(bytes);
        let slot = self.deg.get_mut(self.count).filter(|_| deg.is_finite());
        *slot.ok_or_else(|| malformed(format!("{deg} as joint {}", self.count + 1)))? = deg;
        self.count += 1;
        Ok(())
    }
}

fn six(joints: &ExternalAxes) -> Result<[f64; JOINTS], DeviceError> {
    if joints.count == JOINTS { Ok(joints.deg) } else { Err(malformed(format!("{} joints for six", joints.count))) }
}

/// The number in a message of one enumeration.
fn enumeration(message: &[u8]) -> Result<u64, DeviceError> {
    let mut number = 0;
    for field in WireFields::of(message) {
        if let (1, Value::Varint(found)) = field? {
            number = found;
        }
    }
    Ok(number)
}

fn state(number: u64) -> Vec<u8> {
    let mut message = WireWriter::default();
    message.varint(1, number);
    message.bytes
}

fn motors(number: u64) -> EgmMotors {
    match number {
        1 => EgmMotors::On,
        2 => EgmMotors::Off,
        _ => EgmMotors::Unknown,
    }
}

fn guidance(number: u64) -> EgmGuidance {
    match number {
        1 => EgmGuidance::Error,
        2 => EgmGuidance::Stopped,
        3 => EgmGuidance::Running,
        _ => EgmGuidance::Unknown,
    }
}

fn rapid(number: u64) -> EgmRapid {
    match number {
        1 => EgmRapid::Stopped,
        2 => EgmRapid::Running,
        _ => EgmRapid::Unknown,
    }
}

#[cfg(test)]
mod tests;
