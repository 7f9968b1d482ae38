//! Han's text commands (CPS, port 10003): ASCII, `Name,0,arg,…,;` and `Name,OK,value,…,;` or `Name,Fail,code,;`, ended by `;`
//! without a line break. TCP is a stream: a message ends at its `;`, wherever a packet did. Angles are degrees here, lengths
//! mm.
//!
//! Sources: the maker's Python SDK (`CPS.py`) and ROS 2 driver (huayan-robotics/HuaYan_ros_control).

mod answer;
mod request;

pub use answer::{
    ActualPosition, FSM_DISABLED, FSM_MOVING, FSM_STANDBY, HansOutcome, HansReply, RobotFlags, error_text, fsm_text,
    is_hand_guided_fsm,
};
pub(crate) use answer::{position_mm, texts};
pub use request::{HansCommand, HansRequest, HansWayPoint};

/// Longest message, bytes.
pub const MAX_MESSAGE_BYTES: usize = 64 << 10;

/// End of a message.
const END: u8 = b';';

/// Reason why bytes are not a message, or a message is not of this protocol.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HansSyntax {
    /// Too many bytes without an end.
    #[error("{MAX_MESSAGE_BYTES} bytes without `;`")]
    TooLong,
    /// Bytes that are not printable ASCII.
    #[error("bytes that are not text")]
    NotText,
    /// A command that is not known here.
    #[error("command {0:?}")]
    UnknownCommand(String),
    /// A command with arguments that it does not take.
    #[error("arguments of {0}")]
    Arguments(String),
}

/// Splits a stream into messages. Holds [`MAX_MESSAGE_BYTES`] at most beside what was pushed last.
#[derive(Debug, Default)]
pub struct HansFrames {
    held: Vec<u8>,
}

impl HansFrames {
    /// Adds bytes of the stream.
    pub fn push(&mut self, bytes: &[u8]) {
        self.held.extend_from_slice(bytes);
    }

    /// Takes the next message, without its `;`; `None` if it is not complete yet. After an error the bytes that caused it are
    /// gone.
    pub fn next_message(&mut self) -> Option<Result<String, HansSyntax>> {
        let Some(end) = self.held.iter().position(|byte| *byte == END) else {
            return (self.held.len() > MAX_MESSAGE_BYTES).then(|| {
                self.held = Vec::new();
                Err(HansSyntax::TooLong)
            });
        };
        let message: Vec<u8> = self.held.drain(..=end).take(end).collect();
        if message.len() > MAX_MESSAGE_BYTES {
            return Some(Err(HansSyntax::TooLong));
        }
        let text = String::from_utf8(message).ok().map(|text| text.trim().to_owned());
        let is_printable = |text: &String| text.bytes().all(|byte| (b' '..=b'~').contains(&byte));
        Some(text.filter(is_printable).ok_or(HansSyntax::NotText))
    }
}

/// Fields of a message; the last one, after the last comma, is empty and left out.
fn fields(message: &str) -> Vec<&str> {
    let mut fields: Vec<&str> = message.split(',').map(str::trim).collect();
    if fields.last().is_some_and(|last| last.is_empty()) {
        fields.pop();
    }
    fields
}

/// Message of a name and fields.
fn message(name: &str, fields: impl IntoIterator<Item = String>) -> String {
    let mut text = name.to_owned();
    for field in fields {
        text.push(',');
        text.push_str(&field);
    }
    text.push_str(",;");
    text
}

/// Text of a number: six decimals at most, no exponent.
fn number(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Number of a field.
fn real(field: &str) -> Option<f64> {
    field.parse().ok().filter(|value: &f64| value.is_finite())
}

/// Numbers of fields, as many as there are places.
fn reals<const N: usize>(fields: &[&str]) -> Option<[f64; N]> {
    let values: Option<Vec<f64>> = fields.iter().map(|field| real(field)).collect();
    values?.try_into().ok()
}

#[cfg(test)]
mod tests;
