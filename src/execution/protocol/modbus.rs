//! Modbus: the six functions that drives and PLCs of tables need, for client and server, in frames of RTU and of TCP.
//!
//! Sources: Modbus Application Protocol 1.1b3, Modbus over Serial Line 1.02 and Modbus Messaging on TCP/IP 1.0b (Modbus
//! Organization). The crate tokio-modbus was considered: its RTU client drops bytes until a checksum fits, takes a late reply
//! to an earlier read for the one awaited, and its RTU server needs a library for serial ports; here a reply that does not
//! belong to the request is an error, and the simulated drive shares the code.

mod frame;

use crate::cell::WordOrder;
pub use frame::{MAX_TCP_PDU_BYTES, ModbusAdu, ModbusFraming, ModbusSide, crc};

/// Largest number of coils read at once.
pub const MAX_READ_COILS: u16 = 2000;
/// Largest number of registers read at once.
pub const MAX_READ_REGISTERS: u16 = 125;
/// Largest number of registers written at once.
pub const MAX_WRITE_REGISTERS: usize = 123;
/// Largest number of coils written at once.
pub const MAX_WRITE_COILS: usize = 1968;

/// Bit of the function code that marks an exception.
const EXCEPTION: u8 = 0x80;
/// Value that sets a coil.
const COIL_ON: u16 = 0xFF00;

/// Request of the Modbus protocol.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModbusRequest {
    /// Function 01.
    ReadCoils {
        /// First coil.
        address: u16,
        /// Number of coils.
        count: u16,
    },
    /// Function 03.
    ReadRegisters {
        /// First holding register.
        address: u16,
        /// Number of registers.
        count: u16,
    },
    /// Function 05.
    WriteCoil {
        /// Coil.
        address: u16,
        /// Value.
        on: bool,
    },
    /// Function 06.
    WriteRegister {
        /// Holding register.
        address: u16,
        /// Value.
        value: u16,
    },
    /// Function 15.
    WriteCoils {
        /// First coil.
        address: u16,
        /// Values.
        on: Vec<bool>,
    },
    /// Function 16.
    WriteRegisters {
        /// First holding register.
        address: u16,
        /// Values.
        values: Vec<u16>,
    },
}

/// Answer to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModbusReply {
    /// Coils that were read.
    Coils(Vec<bool>),
    /// Registers that were read.
    Registers(Vec<u16>),
    /// Done.
    Written,
    /// Refused, with a code.
    Exception(u8),
}

/// Reason why bytes are not a frame, a request or the answer to a request.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModbusError {
    /// A checksum that does not fit.
    #[error("a frame with a wrong checksum")]
    Checksum,
    /// A header with a length or a protocol that does not exist.
    #[error("a header with a wrong length or protocol")]
    Header,
    /// A function that is not known here.
    #[error("function {0}")]
    Function(u8),
    /// Numbers or lengths that do not fit the function.
    #[error("a message of the wrong length or with values out of range")]
    Shape,
    /// An answer to something else.
    #[error("an answer to another request")]
    OtherRequest,
}

impl ModbusRequest {
    /// Function code.
    #[must_use]
    pub fn function(&self) -> u8 {
        match self {
            Self::ReadCoils { .. } => 1,
            Self::ReadRegisters { .. } => 3,
            Self::WriteCoil { .. } => 5,
            Self::WriteRegister { .. } => 6,
            Self::WriteCoils { .. } => 15,
            Self::WriteRegisters { .. } => 16,
        }
    }

    /// Function code and data.
    #[must_use]
    pub fn pdu(&self) -> Vec<u8> {
        let mut pdu = vec![self.function()];
        let mut words = |words: &[u16]| pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
        match self {
            Self::ReadCoils { address, count } | Self::ReadRegisters { address, count } => words(&[*address, *count]),
            Self::WriteCoil { address, on } => words(&[*address, if *on { COIL_ON } else { 0 }]),
            Self::WriteRegister { address, value } => words(&[*address, *value]),
            Self::WriteCoils { address, on } => {
                words(&[*address, on.len() as u16]);
                let bytes = packed(on);
                pdu.push(bytes.len() as u8);
                pdu.extend(bytes);
            }
            Self::WriteRegisters { address, values } => {
                words(&[*address, values.len() as u16]);
                pdu.push(2 * values.len() as u8);
                pdu.extend(values.iter().flat_map(|value| value.to_be_bytes()));
            }
        }
        pdu
    }

    /// Reads function code and data.
    ///
    /// # Errors
    /// [`ModbusError::Function`], [`ModbusError::Shape`].
    pub fn parse(pdu: &[u8]) -> Result<Self, ModbusError> {
        let &[function, a0, a1, b0, b1, ref rest @ ..] = pdu else {
            return Err(ModbusError::Shape);
        };
        let (address, second) = (u16::from_be_bytes([a0, a1]), u16::from_be_bytes([b0, b1]));
        let within = |max: u16| (1..=max).contains(&second) && rest.is_empty();
        let data = || rest.split_first().filter(|(length, data)| usize::from(**length) == data.len()).map(|(_, data)| data);
        let request = match function {
            1 => within(MAX_READ_COILS).then_some(Self::ReadCoils { address, count: second }),
            3 => within(MAX_READ_REGISTERS).then_some(Self::ReadRegisters { address, count: second }),
            5 => (rest.is_empty() && [0, COIL_ON].contains(&second)).then_some(Self::WriteCoil { address, on: second != 0 }),
            6 => rest.is_empty().then_some(Self::WriteRegister { address, value: second }),
            15 => data().and_then(|data| unpacked(data, second)).map(|on| Self::WriteCoils { address, on }),
            16 => data()
                .filter(|data| data.len() == 2 * usize::from(second) && (1..=MAX_WRITE_REGISTERS).contains(&usize::from(second)))
                .map(|data| Self::WriteRegisters { address, values: registers(data) }),
            other => return Err(ModbusError::Function(other)),
        };
        request.ok_or(ModbusError::Shape)
    }

    /// Reads the function code and data of an answer to this request.
    ///
    /// # Errors
    /// [`ModbusError::OtherRequest`], [`ModbusError::Shape`].
    pub fn parse_reply(&self, pdu: &[u8]) -> Result<ModbusReply, ModbusError> {
        let (function, data) = pdu.split_first().ok_or(ModbusError::Shape)?;
        if *function == self.function() | EXCEPTION {
            return if let [code] = data { Ok(ModbusReply::Exception(*code)) } else { Err(ModbusError::Shape) };
        }
        if *function != self.function() {
            return Err(ModbusError::OtherRequest);
        }
        let counted = || data.split_first().filter(|(length, data)| usize::from(**length) == data.len()).map(|(_, data)| data);
        match self {
            Self::ReadCoils { count, .. } => {
                counted().and_then(|data| unpacked(data, *count)).map(ModbusReply::Coils).ok_or(ModbusError::Shape)
            }
            Self::ReadRegisters { count, .. } => counted()
                .filter(|data| data.len() == 2 * usize::from(*count))
                .map(|data| ModbusReply::Registers(registers(data)))
                .ok_or(ModbusError::Shape),
            Self::WriteCoil { .. } | Self::WriteRegister { .. } | Self::WriteCoils { .. } | Self::WriteRegisters { .. } => {
                // The address and the value, or how many, as they were sent.
                if data == &self.pdu()[1..5] { Ok(ModbusReply::Written) } else { Err(ModbusError::OtherRequest) }
            }
        }
    }

    /// Function code and data of an answer to this request.
    #[must_use]
    pub fn reply_pdu(&self, reply: &ModbusReply) -> Vec<u8> {
        let counted = |data: Vec<u8>| [vec![self.function(), data.len() as u8], data].concat();
        match reply {
            ModbusReply::Coils(on) => counted(packed(on)),
            ModbusReply::Registers(values) => counted(values.iter().flat_map(|value| value.to_be_bytes()).collect()),
            ModbusReply::Written => self.pdu()[..5].to_vec(),
            ModbusReply::Exception(code) => vec![self.function() | EXCEPTION, *code],
        }
    }
}

/// Registers of 32-bit values.
#[must_use]
pub fn registers_of(values: &[i32], order: WordOrder) -> Vec<u16> {
    let words = |value: &i32| {
        let [a, b, c, d] = value.to_be_bytes();
        let (high, low) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        match order {
            WordOrder::LowFirst => [low, high],
            WordOrder::HighFirst => [high, low],
        }
    };
    values.iter().flat_map(words).collect()
}

/// 32-bit values of registers; a register left over is left.
#[must_use]
pub fn values_of(registers: &[u16], order: WordOrder) -> Vec<i32> {
    let value = |pair: &[u16]| {
        let (high, low) = match order {
            WordOrder::LowFirst => (pair[1], pair[0]),
            WordOrder::HighFirst => (pair[0], pair[1]),
        };
        (u32::from(high) << 16 | u32::from(low)).cast_signed()
    };
    registers.chunks_exact(2).map(value).collect()
}

/// Words for the code of an exception.
#[must_use]
pub fn exception_text(code: u8) -> &'static str {
    match code {
        1 => "the function is not supported",
        2 => "there is no such address",
        3 => "the value is not allowed",
        4 => "the device failed",
        5 => "the device needs more time",
        6 => "the device is busy",
        8 => "a parity error in the device's memory",
        10 => "the gateway has no way to the device",
        11 => "the device behind the gateway does not answer",
        _ => "an exception that is not documented",
    }
}

/// Coils, eight a byte, the first in the lowest bit.
fn packed(on: &[bool]) -> Vec<u8> {
    on.chunks(8).map(|eight| eight.iter().rev().fold(0, |byte, on| byte << 1 | u8::from(*on))).collect()
}

/// Coils from their bytes; `None` if the bytes are not as many as `count` coils need.
fn unpacked(bytes: &[u8], count: u16) -> Option<Vec<bool>> {
    let fits = bytes.len() == usize::from(count).div_ceil(8) && (1..=MAX_READ_COILS).contains(&count);
    fits.then(|| (0..usize::from(count)).map(|coil| bytes[coil / 8] >> (coil % 8) & 1 == 1).collect())
}

/// Registers from their bytes.
fn registers(bytes: &[u8]) -> Vec<u16> {
    bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect()
}

#[cfg(test)]
mod tests;
