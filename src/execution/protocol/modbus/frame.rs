//! Frames: RTU, node, data and checksum; TCP, transaction, length, unit and data.

use super::{EXCEPTION, ModbusError};

/// Longest function code with data, bytes.
pub const MAX_TCP_PDU_BYTES: usize = 253;
/// Header of a frame of TCP, with the unit.
const TCP_HEADER_BYTES: usize = 7;

/// Frames of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModbusFraming {
    /// Serial line, or a gateway that passes its bytes on.
    Rtu,
    /// Modbus TCP.
    Tcp,
}

/// Side whose messages are read: frames of RTU do not say how long they are, and requests are shaped unlike answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModbusSide {
    /// Requests are read.
    Server,
    /// Answers are read.
    Client,
}

/// A message with its addressee.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModbusAdu {
    /// Number that an answer repeats; 0 in frames of RTU, which have none.
    pub transaction: u16,
    /// Node or unit.
    pub node: u8,
    /// Function code and data.
    pub pdu: Vec<u8>,
}

impl ModbusAdu {
    /// Frame on the wire.
    #[must_use]
    pub fn frame(&self, framing: ModbusFraming) -> Vec<u8> {
        match framing {
            ModbusFraming::Rtu => {
                let mut frame = [&[self.node], self.pdu.as_slice()].concat();
                let sum = crc(&frame);
                frame.extend(sum.to_le_bytes());
                frame
            }
            ModbusFraming::Tcp => {
                let words = [self.transaction, 0, self.pdu.len() as u16 + 1];
                let header = words.iter().flat_map(|word| word.to_be_bytes()).chain([self.node]);
                header.chain(self.pdu.iter().copied()).collect()
            }
        }
    }

    /// Takes the first frame out of `held`; `None` if it is not complete yet.
    ///
    /// # Errors
    /// [`ModbusError`]; the stream cannot be read further, for nothing marks where the next frame begins.
    pub fn take(held: &mut Vec<u8>, framing: ModbusFraming, side: ModbusSide) -> Result<Option<Self>, ModbusError> {
        let length = match framing {
            ModbusFraming::Rtu => rtu_length(held, side)?,
            ModbusFraming::Tcp => tcp_length(held)?,
        };
        let Some(length) = length.filter(|length| held.len() >= *length) else { return Ok(None) };
        let frame: Vec<u8> = held.drain(..length).collect();
        match framing {
            ModbusFraming::Rtu => {
                let (message, sum) = frame.split_at(length - 2);
                if crc(message).to_le_bytes() != sum {
                    return Err(ModbusError::Checksum);
                }
                Ok(Some(Self { transaction: 0, node: message[0], pdu: message[1..].to_vec() }))
            }
            ModbusFraming::Tcp => Ok(Some(Self {
                transaction: u16::from_be_bytes([frame[0], frame[1]]),
                node: frame[TCP_HEADER_BYTES - 1],
                pdu: frame[TCP_HEADER_BYTES..].to_vec(),
            })),
        }
    }
}

/// Length of the frame that begins `held`, as soon as that can be said.
fn rtu_length(held: &[u8], side: ModbusSide) -> Result<Option<usize>, ModbusError> {
    let Some(function) = held.get(1) else { return Ok(None) };
    let counted = |at: usize| held.get(at).map(|count| at + 1 + usize::from(*count) + 2);
    match (side, function) {
        (_, 5 | 6) | (ModbusSide::Server, 1 | 3) | (ModbusSide::Client, 15 | 16) => Ok(Some(8)),
        (ModbusSide::Server, 15 | 16) => Ok(counted(6)),
        (ModbusSide::Client, 1 | 3) => Ok(counted(2)),
        (ModbusSide::Client, function) if function & EXCEPTION != 0 => Ok(Some(5)),
        (_, function) => Err(ModbusError::Function(*function)),
    }
}

fn tcp_length(held: &[u8]) -> Result<Option<usize>, ModbusError> {
    let Some(&[_, _, protocol_high, protocol_low, high, low, _]) = held.first_chunk::<TCP_HEADER_BYTES>() else {
        return Ok(None);
    };
    let length = usize::from(u16::from_be_bytes([high, low]));
    if (protocol_high, protocol_low) != (0, 0) || !(2..=MAX_TCP_PDU_BYTES + 1).contains(&length) {
        return Err(ModbusError::Header);
    }
    Ok(Some(TCP_HEADER_BYTES - 1 + length))
}

/// Checksum of RTU: the polynomial x¹⁶ + x¹⁵ + x² + 1, reflected, from all ones.
#[must_use]
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |sum, byte| {
        (0..8).fold(sum ^ u16::from(*byte), |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0xA001 } else { sum >> 1 })
    })
}
