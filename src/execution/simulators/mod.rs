//! Simulated controllers on real sockets and pseudo terminals: what their makers document, with time, limits and faults on
//! command, so that a cell is rehearsed without any of its hardware.

pub mod egm;
pub mod fanuc_rmi;
pub mod faults;
pub mod hans;
pub mod kuka_rsi;
pub mod minas_a6;
mod motion;
pub mod ur;

#[cfg(test)]
mod tests;
