//! Drivers, one file a protocol.

pub mod hans;
pub mod minas_a6;
pub mod modbus_link;
pub mod modbus_plc;
pub mod serial;
pub mod stream;
mod table_units;
pub mod trigger;
