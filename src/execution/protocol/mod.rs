//! Codecs of controllers' protocols: pure functions, without sockets or clocks. Whatever a wire says, they return an error and hold a
//! bounded number of bytes.

pub mod hans;
pub mod hans_state;
pub mod minas_a6;
pub mod modbus;

#[cfg(test)]
mod fuzz;
