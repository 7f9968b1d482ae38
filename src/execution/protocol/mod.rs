//! Codecs of controllers' protocols: pure functions from bytes to values and back, without sockets or clocks. Whatever a wire says,
//! they return an error and hold a bounded number of bytes.

pub mod egm;
pub mod fanuc_rmi;
pub mod hans;
pub mod hans_state;
pub mod kuka_rsi;
pub mod minas_a6;
pub mod modbus;
pub mod ur;

#[cfg(test)]
mod mangled;
