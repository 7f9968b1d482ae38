//! States that Han's controllers push: binary frames of 1136 bytes (port 8893), each cycle of the controller, and JSON in a
//! binary frame (port 10004). Both little endian, both begin with the same number. Angles are degrees here, lengths mm.
//!
//! Source: the maker's ROS 2 driver (huayan-robotics/HuaYan_ros_control, `controller_client.cpp`, `rt_info_client.cpp`). It
//! leaves the last 192 bytes of the binary frame unread, and so does this.

use serde::Deserialize;

/// First four bytes of every frame, `LTBR`.
const MAGIC: u32 = 0x5242_544C;
/// Length of a binary frame, bytes.
pub const REALTIME_FRAME_BYTES: usize = 1136;
/// Length of its data.
const REALTIME_DATA_BYTES: u32 = 1120;
/// Length of the header of a JSON frame.
const JSON_HEADER_BYTES: usize = 12;
/// Longest JSON frame.
const MAX_JSON_FRAME_BYTES: usize = 1 << 20;

/// Reason why bytes are not a frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HansFrameError {
    /// A header with other numbers.
    #[error("the header {0:08x?}")]
    Header(Vec<u32>),
    /// A payload that is not JSON of this shape.
    #[error("its JSON: {0}")]
    Json(String),
}

/// Binary state of one cycle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HansRealtimeState {
    /// Cycle of the controller, ms: 1 or 4.
    pub cycle_ms: i32,
    /// Joints asked for, degrees.
    pub target_deg: [f64; 6],
    /// Joint speeds asked for, °/s.
    pub target_deg_s: [f64; 6],
    /// Joints measured, degrees.
    pub actual_deg: [f64; 6],
    /// Joint speeds measured, °/s.
    pub actual_deg_s: [f64; 6],
    /// Pose of the tool, measured, mm and degrees.
    pub actual_tool: [f64; 6],
    /// Share of the speed, 0 to 1.
    pub speed_scaling: f64,
    /// Time of the controller, µs.
    pub time_us: u64,
    /// Number of the controller's state.
    pub fsm: i32,
}

/// Offset of the commanded joints in a binary frame, bytes.
const TARGET: usize = 16;
/// Offset of their speeds.
const TARGET_SPEED: usize = TARGET + 48;
/// Offset of the measured joints.
const ACTUAL: usize = TARGET + 5 * 48;
/// Offset of the measured speeds.
const ACTUAL_SPEED: usize = ACTUAL + 48;
/// Offset of the measured pose of the tool.
const ACTUAL_TOOL: usize = TARGET + 12 * 48;
/// Offset of the share of the speed.
const SCALING: usize = TARGET + 18 * 48 + 16;
/// Offset of the controller's time.
const TIME: usize = SCALING + 8 + 3 * 8;
/// Offset of the number of the controller's state.
const FSM: usize = TIME + 8;

impl HansRealtimeState {
    /// Frame on the wire; what is not held here is zero.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut frame = vec![0; REALTIME_FRAME_BYTES];
        let header = [MAGIC, REALTIME_FRAME_BYTES as u32, REALTIME_DATA_BYTES, self.cycle_ms.cast_unsigned()];
        for (place, word) in frame.chunks_exact_mut(4).zip(header) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        for (at, values) in [
            (TARGET, &self.target_deg),
            (TARGET_SPEED, &self.target_deg_s),
            (ACTUAL, &self.actual_deg),
            (ACTUAL_SPEED, &self.actual_deg_s),
            (ACTUAL_TOOL, &self.actual_tool),
        ] {
            for (place, value) in frame[at..].chunks_exact_mut(8).zip(values) {
                place.copy_from_slice(&value.to_le_bytes());
            }
        }
        frame[SCALING..SCALING + 8].copy_from_slice(&self.speed_scaling.to_le_bytes());
        frame[TIME..TIME + 8].copy_from_slice(&self.time_us.to_le_bytes());
        frame[FSM..FSM + 4].copy_from_slice(&self.fsm.to_le_bytes());
        frame
    }

    /// Reads a frame.
    ///
    /// # Errors
    /// [`HansFrameError::Header`].
    pub fn decode(frame: &[u8; REALTIME_FRAME_BYTES]) -> Result<Self, HansFrameError> {
        let header: Vec<u32> = words(&frame[..16]).collect();
        if header[..3] != [MAGIC, REALTIME_FRAME_BYTES as u32, REALTIME_DATA_BYTES] {
            return Err(HansFrameError::Header(header));
        }
        let eight = |at: usize| std::array::from_fn(|byte| frame[at + byte]);
        let six = |at: usize| std::array::from_fn(|axis| f64::from_le_bytes(eight(at + 8 * axis)));
        Ok(Self {
            cycle_ms: header[3].cast_signed(),
            target_deg: six(TARGET),
            target_deg_s: six(TARGET_SPEED),
            actual_deg: six(ACTUAL),
            actual_deg_s: six(ACTUAL_SPEED),
            actual_tool: six(ACTUAL_TOOL),
            speed_scaling: f64::from_le_bytes(eight(SCALING)),
            time_us: u64::from_le_bytes(eight(TIME)),
            fsm: i32::from_le_bytes(std::array::from_fn(|byte| frame[FSM + byte])),
        })
    }
}

/// Takes the first binary frame out of `held`; `None` if it is not complete yet.
///
/// # Errors
/// [`HansFrameError::Header`]; the stream cannot be read further.
pub fn take_realtime(held: &mut Vec<u8>) -> Result<Option<HansRealtimeState>, HansFrameError> {
    let Some(frame) = held.first_chunk() else { return Ok(None) };
    let state = HansRealtimeState::decode(frame)?;
    held.drain(..REALTIME_FRAME_BYTES);
    Ok(Some(state))
}

/// State in a JSON frame.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct HansPushedState {
    /// Robot and its errors.
    #[serde(rename = "StateAndError")]
    pub state: HansStateAndError,
}

/// Robot and its errors.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct HansStateAndError {
    /// Number of the controller's state.
    #[serde(rename = "robotState")]
    pub fsm: i64,
    /// 1 if the drives are enabled.
    #[serde(rename = "robotEnabled")]
    pub enabled: i64,
    /// 1 if the motion is paused.
    #[serde(rename = "robotPaused")]
    pub paused: i64,
    /// 1 if the arm moves.
    #[serde(rename = "robotMoving")]
    pub moving: i64,
    /// 1 if the way point was reached, as the planner has it.
    #[serde(rename = "robotBlendingDone")]
    pub blending_done: i64,
    /// 1 if the joints are where they were sent.
    #[serde(rename = "InPos")]
    pub in_position: i64,
    /// Axis of the error.
    #[serde(rename = "Error_AxisID")]
    pub error_axis: i64,
    /// Code of the error; 0 none.
    #[serde(rename = "Error_Code")]
    pub error_code: i64,
}

/// Takes the first JSON frame out of `held`; `None` if it is not complete yet. The longest frame is a mebibyte.
///
/// # Errors
/// [`HansFrameError`]; after [`HansFrameError::Header`] the stream cannot be read further.
pub fn take_pushed(held: &mut Vec<u8>) -> Result<Option<HansPushedState>, HansFrameError> {
    let Some(header) = held.get(..JSON_HEADER_BYTES) else { return Ok(None) };
    let header: Vec<u32> = words(header).collect();
    let (total, data) = (header[1] as usize, header[2] as usize);
    if header[0] != MAGIC || data == 0 || data > MAX_JSON_FRAME_BYTES || total != JSON_HEADER_BYTES + data {
        return Err(HansFrameError::Header(header));
    }
    if held.len() < total {
        return Ok(None);
    }
    let frame: Vec<u8> = held.drain(..total).collect();
    let state = serde_json::from_slice(&frame[JSON_HEADER_BYTES..]);
    state.map(Some).map_err(|error| HansFrameError::Json(error.to_string()))
}

/// JSON frame around a payload.
#[must_use]
pub fn pushed_frame(json: &str) -> Vec<u8> {
    let data = json.len() as u32;
    let header = [MAGIC, JSON_HEADER_BYTES as u32 + data, data];
    header.iter().flat_map(|word| word.to_le_bytes()).chain(json.bytes()).collect()
}

/// Words of four bytes, little endian.
fn words(bytes: &[u8]) -> impl Iterator<Item = u32> {
    bytes.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
}

#[cfg(test)]
mod tests;
