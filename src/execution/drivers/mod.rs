//! Drivers, one file a protocol.

mod datagrams;
pub mod egm;
pub mod fanuc_rmi;
pub mod hans;
pub mod kuka_rsi;
pub mod minas_a6;
pub mod modbus_link;
pub mod modbus_plc;
pub mod serial;
pub(crate) mod set_points;
pub mod stream;
mod streamed;
mod table_units;
pub mod trigger;
pub mod ur;

pub use streamed::Streamed;

#[cfg(test)]
mod there_and_back;
