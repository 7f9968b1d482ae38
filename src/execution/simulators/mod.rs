//! Simulated controllers on real sockets and pseudo terminals: what their makers document, with time, limits and faults on command, so
//! that a cell is rehearsed without any of its hardware.

pub mod faults;
pub mod hans;
pub mod minas_a6;
mod motion;
