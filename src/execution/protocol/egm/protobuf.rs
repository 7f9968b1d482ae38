//! The few shapes of Protocol Buffers' wire format that EGM uses: fields one after the other, each a key and a value.

use super::malformed;
use crate::execution::device::DeviceError;

/// Value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value<'a> {
    /// Wire type 0.
    Varint(u64),
    /// Wire type 1, little endian.
    Fixed64([u8; 8]),
    /// Wire type 2.
    Bytes(&'a [u8]),
    /// Wire type 5, little endian.
    Fixed32([u8; 4]),
}

/// Fields of a message, in order; ends after the first error.
pub(super) struct WireFields<'a> {
    rest: &'a [u8],
}

impl<'a> WireFields<'a> {
    pub(super) fn of(message: &'a [u8]) -> Self {
        Self { rest: message }
    }

    fn field(&mut self) -> Result<(u64, Value<'a>), DeviceError> {
        let key = self.varint()?;
        let value = match key & 7 {
            0 => Value::Varint(self.varint()?),
            1 => Value::Fixed64(self.fixed()?),
            2 => {
                let length = usize::try_from(self.varint()?).map_err(|_| cut())?;
                let (value, rest) = self.rest.split_at_checked(length).ok_or_else(cut)?;
                self.rest = rest;
                Value::Bytes(value)
            }
            5 => Value::Fixed32(self.fixed()?),
            other => return Err(malformed(format!("a field of wire type {other}"))),
        };
        Ok((key >> 3, value))
    }

    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], DeviceError> {
        let (value, rest) = self.rest.split_first_chunk().ok_or_else(cut)?;
        self.rest = rest;
        Ok(*value)
    }

    fn varint(&mut self) -> Result<u64, DeviceError> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let (byte, rest) = self.rest.split_first().ok_or_else(cut)?;
            self.rest = rest;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(malformed("a number of more than ten bytes"))
    }
}

impl<'a> Iterator for WireFields<'a> {
    type Item = Result<(u64, Value<'a>), DeviceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.rest = &[];
        }
        Some(field)
    }
}

fn cut() -> DeviceError {
    malformed("a frame that ends within a field")
}

/// Fields of a message, written one after the other.
#[derive(Default)]
pub(super) struct WireWriter {
    pub(super) bytes: Vec<u8>,
}

impl WireWriter {
    pub(super) fn varint(&mut self, field: u64, value: u64) {
        self.raw(field << 3);
        self.raw(value);
    }

    pub(super) fn double(&mut self, field: u64, value: f64) {
        self.raw(field << 3 | 1);
        self.bytes.extend(value.to_le_bytes());
    }

    pub(super) fn message(&mut self, field: u64, message: &[u8]) {
        self.raw(field << 3 | 2);
        self.raw(message.len() as u64);
        self.bytes.extend(message);
    }

    fn raw(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.bytes.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.bytes.push(value as u8);
    }
}
