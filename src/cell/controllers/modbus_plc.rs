//! A table behind a PLC with a register map of its own, Modbus TCP.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::WordOrder;
use super::address::check_socket;
use crate::cell::field_error::Findings;

/// PLC of a table: holding registers by their address. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ModbusPlcSpec {
    /// Address, `HOST:PORT`; the port is 502 as a rule.
    pub address: String,
    /// Unit identifier, 0 to 255. Default 1.
    #[serde(default = "default_unit")]
    pub unit: u8,
    /// Order of the words of 32-bit values. Default `low_first`.
    #[serde(default = "default_word_order")]
    pub word_order: WordOrder,
    /// Units of one turn of the table, 360 to 2147483647.
    pub units_per_turn: u32,
    /// Register of the target, two words, units.
    pub target_register: u16,
    /// Register of the speed, two words, units per second.
    pub speed_register: u16,
    /// Register of the command: 0 none, 1 start, 2 stop.
    pub command_register: u16,
    /// Register of the state: bit 0 ready, 1 moving, 2 in position, 3 fault, 4 emergency stop, 5 guard open.
    pub state_register: u16,
    /// Register of the measured position, two words, units.
    pub position_register: u16,
    /// Register of the fault's number. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault_register: Option<u16>,
    /// Register that a rising number is written to as a sign of life. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heartbeat_register: Option<u16>,
}

fn default_unit() -> u8 {
    1
}

fn default_word_order() -> WordOrder {
    WordOrder::LowFirst
}

impl ModbusPlcSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        findings.range(format!("{pointer}/units_per_turn"), self.units_per_turn.into(), 360.0, 2_147_483_647.0, "");
    }
}
