//! A line of the protocol as a JSON object.

use serde_json::{Map, Value};

use super::MAX_LINE_BYTES;
use crate::execution::device::DeviceError;

/// One line as an object.
pub(super) struct RmiPacket(pub(super) Map<String, Value>);

impl RmiPacket {
    pub(super) fn read(line: &[u8]) -> Result<Self, DeviceError> {
        if line.len() > MAX_LINE_BYTES {
            return Err(malformed(format!("a line of {} bytes", line.len())));
        }
        match serde_json::from_slice(line) {
            Ok(Value::Object(packet)) => Ok(Self(packet)),
            _ => Err(malformed(format!("{:?}, no packet", shortened(&String::from_utf8_lossy(line))))),
        }
    }

    /// Kind and name.
    pub(super) fn name(&self) -> Result<(&'static str, &str), DeviceError> {
        let kinds = ["Communication", "Command", "Instruction"];
        let named = kinds.into_iter().find_map(|kind| Some((kind, self.0.get(kind)?.as_str()?)));
        named.ok_or_else(|| malformed("a packet without a name"))
    }

    pub(super) fn optional<T: TryFrom<i64>>(&self, key: &str) -> Option<T> {
        T::try_from(self.0.get(key)?.as_i64()?).ok()
    }

    pub(super) fn number<T: TryFrom<i64>>(&self, key: &str) -> Result<T, DeviceError> {
        self.optional(key).ok_or_else(|| malformed(format!("a packet without a fitting {key}")))
    }
}

fn shortened(text: &str) -> String {
    text.trim().chars().take(60).collect()
}

pub(super) fn malformed(what: impl Into<String>) -> DeviceError {
    DeviceError::Malformed { what: what.into() }
}
