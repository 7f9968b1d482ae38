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

/// MINAS A6 drive of a table. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct MinasA6Spec {
    /// Address: `tcp://HOST:PORT` of a gateway, or the path of a serial device.
    pub address: String,
    /// Node of the drive (Pr5.31), 1 to 127. Default 1.
    #[serde(default = "default_node")]
    pub node: u8,
    /// Speed of a serial line, bit/s, 2400 to 230400 (Pr5.30). Default 115200.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Order of the words of 32-bit values; checked at connect. Default `low_first`.
    #[serde(default = "default_word_order")]
    pub word_order: WordOrder,
    /// Command units of one turn of the table, 1000 to 2147483647.
    pub units_per_turn: u32,
    /// Turns of the motor for one turn of the table, 1 to 512.
    pub gear_ratio: u32,
    /// Position of the drive at table angle zero, command units. Default 0.
    #[serde(default)]
    pub home_units: i32,
    /// True if the drive turns against the table frame's +z. Default false.
    #[serde(default)]
    pub is_reversed: bool,
}

fn default_node() -> u8 {
    1
}

fn default_baud() -> u32 {
    115_200
}

fn default_word_order() -> WordOrder {
    WordOrder::LowFirst
}

impl MinasA6Spec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket_or_serial(&format!("{pointer}/address"), &self.address, findings);
        findings.range(format!("{pointer}/node"), self.node.into(), 1.0, 127.0, "");
        findings.range(format!("{pointer}/baud"), self.baud.into(), 2400.0, 230_400.0, "bit/s");
        findings.range(format!("{pointer}/units_per_turn"), self.units_per_turn.into(), 1000.0, 2_147_483_647.0, "");
        findings.range(format!("{pointer}/gear_ratio"), self.gear_ratio.into(), 1.0, 512.0, "");
    }
}
