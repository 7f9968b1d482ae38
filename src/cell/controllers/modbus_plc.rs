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
    /// Longest wait for a connection, with further attempts, ms, 100 to 60000. Default 3000.
    #[serde(default = "default_connect_timeout_ms")]
    pub connect_timeout_ms: u32,
    /// Longest wait for a reply, ms, 10 to 5000. Default 100.
    #[serde(default = "default_reply_timeout_ms")]
    pub reply_timeout_ms: u32,
    /// Order of the words of 32-bit values. Default `low_first`.
    #[serde(default = "default_word_order")]
    pub word_order: WordOrder,
    /// Units of one turn of the table, 360 to 2147483647.
    pub units_per_turn: u32,
    /// Position at table angle zero, units. Default 0.
    #[serde(default)]
    pub home_units: i32,
    /// True if positions rise against the table frame's +z. Default false.
    #[serde(default)]
    pub is_reversed: bool,
    /// Register of the target, two words, units.
    pub target_register: u16,
    /// Register of the speed, two words, units per second.
    pub speed_register: u16,
    /// Register of the acceleration, two words, units per second squared. Default: none; the PLC has its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceleration_register: Option<u16>,
    /// Register of the command: bit 0 start, which moves to the target when it rises; bit 1 stop, which holds while it is
    /// set.
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

fn default_connect_timeout_ms() -> u32 {
    3000
}

fn default_reply_timeout_ms() -> u32 {
    100
}

fn default_word_order() -> WordOrder {
    WordOrder::LowFirst
}

impl ModbusPlcSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        findings.range(format!("{pointer}/connect_timeout_ms"), self.connect_timeout_ms.into(), 100.0, 60_000.0, "ms");
        findings.range(format!("{pointer}/reply_timeout_ms"), self.reply_timeout_ms.into(), 10.0, 5000.0, "ms");
        findings.range(format!("{pointer}/units_per_turn"), self.units_per_turn.into(), 360.0, 2_147_483_647.0, "");
        let written = [Some(self.target_register), Some(self.speed_register), self.acceleration_register];
        let words = written.into_iter().flatten().chain([self.position_register]);
        findings.require(words.clone().all(|register| register < u16::MAX), format!("{pointer}/target_register"), || {
            "a value of two words does not begin at register 65535".into()
        });
        let mut taken: Vec<u16> = words.flat_map(|register| [register, register.saturating_add(1)]).collect();
        taken.extend(
            [Some(self.command_register), Some(self.state_register), self.fault_register, self.heartbeat_register]
                .into_iter()
                .flatten(),
        );
        let count = taken.len();
        taken.sort_unstable();
        taken.dedup();
        findings.require(taken.len() == count, format!("{pointer}/target_register"), || "registers overlap".into());
    }
}
