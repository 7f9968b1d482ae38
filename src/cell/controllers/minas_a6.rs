//! Panasonic MINAS A6 drive, block operation over Modbus.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket_or_serial;
use crate::cell::closed_list;
use crate::cell::field_error::Findings;

closed_list! {
    /// Order of the words of a 32-bit value.
    pub enum WordOrder {
        /// The low word first, as the drive's manual has it.
        LowFirst = "low_first",
        /// The high word first, as some gateways turn it.
        HighFirst = "high_first",
    }
}

closed_list! {
    /// Frames in which a gateway takes Modbus over TCP.
    pub enum GatewayFraming {
        /// The serial frame with its CRC, passed on as it is.
        Rtu = "rtu",
        /// The frame of Modbus TCP, which the gateway turns into the serial one.
        Tcp = "tcp",
    }
}

closed_list! {
    /// Parity and stop bits of a serial line with eight data bits (Pr5.38).
    pub enum SerialParity {
        /// Even parity, one stop bit: as delivered (Pr5.38 = 0).
        Even = "even",
        /// Odd parity, one stop bit (Pr5.38 = 2).
        Odd = "odd",
        /// No parity, one stop bit (Pr5.38 = 4).
        None = "none",
    }
}

/// Speeds of a serial line that the drive knows (Pr5.30), bit/s.
const BAUD: [u32; 8] = [2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200, 230_400];
/// Blocks that the drive has, less those that one move may take.
const MAX_FIRST_BLOCK: f64 = 248.0;

/// MINAS A6 drive of a table. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct MinasA6Spec {
    /// Address: `tcp://HOST:PORT` of a gateway, or the path of a serial device.
    pub address: String,
    /// Frames of a gateway. Default `rtu`.
    #[serde(default = "default_framing")]
    pub framing: GatewayFraming,
    /// Node of the drive (Pr5.31), 1 to 127. Default 1.
    #[serde(default = "default_node")]
    pub node: u8,
    /// Speed of a serial line, bit/s (Pr5.30): 2400, 4800, 9600, 19200, 38400, 57600, 115200 or 230400. Default 115200.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Parity of a serial line (Pr5.38). Default `even`.
    #[serde(default = "default_parity")]
    pub parity: SerialParity,
    /// Longest wait for a connection, with further attempts, ms, 100 to 60000. Default 3000.
    #[serde(default = "default_connect_timeout_ms")]
    pub connect_timeout_ms: u32,
    /// Longest wait for a reply, ms, 10 to 5000. Default 100.
    #[serde(default = "default_reply_timeout_ms")]
    pub reply_timeout_ms: u32,
    /// Beginning of the amplifier's model, such as `MADLT15`; another drive is refused. Default: not compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Order of the words of 32-bit values; checked at connect. Default `low_first`.
    #[serde(default = "default_word_order")]
    pub word_order: WordOrder,
    /// Command units of one turn of the table, 1000 to 2147483647.
    pub units_per_turn: u32,
    /// Turns of the motor for one turn of the table, 1 to 512.
    pub gear_ratio: f64,
    /// Position of the drive at table angle zero, command units. Default 0.
    #[serde(default)]
    pub home_units: i32,
    /// True if the drive turns against the table frame's +z. Default false.
    #[serde(default)]
    pub is_reversed: bool,
    /// True if the drive turns without end (Pr0.15 = 4, Pr6.88 = gear ratio − 1): positions repeat with every turn. Default
    /// false.
    #[serde(default)]
    pub has_infinite_rotation: bool,
    /// Largest speed of the motor, r/min, 1 to 20000. Default 6000.
    #[serde(default = "default_max_motor_r_per_min")]
    pub max_motor_r_per_min: u32,
    /// First of eight blocks that moves are written to, 0 to 248. Default 0.
    #[serde(default)]
    pub first_block: u8,
    /// Number of the speed, the acceleration and the deceleration that moves are written to, 0 to 15. Default 0.
    #[serde(default)]
    pub speed_number: u8,
    /// True if arming switches the servo on; what was switched on is switched off at release. Default true.
    #[serde(default = "default_switches_servo")]
    pub switches_servo: bool,
}

fn default_framing() -> GatewayFraming {
    GatewayFraming::Rtu
}

fn default_node() -> u8 {
    1
}

fn default_baud() -> u32 {
    115_200
}

fn default_parity() -> SerialParity {
    SerialParity::Even
}

fn default_connect_timeout_ms() -> u32 {
    3000
}

fn default_reply_timeout_ms() -> u32 {
    100
}

fn default_word_order() -> WordOrder {
    WordOrder::LowFirst
}

fn default_max_motor_r_per_min() -> u32 {
    6000
}

fn default_switches_servo() -> bool {
    true
}

impl MinasA6Spec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket_or_serial(&format!("{pointer}/address"), &self.address, findings);
        let is_serial = self.address.starts_with('/');
        findings.require(!is_serial || self.framing == GatewayFraming::Rtu, format!("{pointer}/framing"), || {
            "is tcp; a serial line takes rtu alone".into()
        });
        findings.range(format!("{pointer}/node"), self.node.into(), 1.0, 127.0, "");
        findings.require(BAUD.contains(&self.baud), format!("{pointer}/baud"), || {
            format!("is {} bit/s; allowed are {}", self.baud, BAUD.map(|baud| baud.to_string()).join(", "))
        });
        findings.range(format!("{pointer}/connect_timeout_ms"), self.connect_timeout_ms.into(), 100.0, 60_000.0, "ms");
        findings.range(format!("{pointer}/reply_timeout_ms"), self.reply_timeout_ms.into(), 10.0, 5000.0, "ms");
        findings.range(format!("{pointer}/units_per_turn"), self.units_per_turn.into(), 1000.0, 2_147_483_647.0, "");
        findings.range(format!("{pointer}/gear_ratio"), self.gear_ratio, 1.0, 512.0, "");
        findings.require(
            !self.has_infinite_rotation || self.gear_ratio.fract().abs() < f64::EPSILON,
            format!("{pointer}/gear_ratio"),
            || format!("is {}; infinite rotation needs a whole number", self.gear_ratio),
        );
        findings.range(format!("{pointer}/max_motor_r_per_min"), self.max_motor_r_per_min.into(), 1.0, 20_000.0, "r/min");
        findings.range(format!("{pointer}/first_block"), self.first_block.into(), 0.0, MAX_FIRST_BLOCK, "");
        findings.range(format!("{pointer}/speed_number"), self.speed_number.into(), 0.0, 15.0, "");
    }
}
