#![doc = include_str!("ARCHITECTURE.md")]
#![cfg_attr(test, expect(clippy::float_cmp, reason = "tests hold to the bit what is exact"))]

pub use vantage_core::{cell, geometry, inspection, planning, program, rendering};

pub mod check;
pub mod cli;
pub mod execution;
pub mod http;
pub mod report;
pub mod service;
pub mod settings;
#[cfg(test)]
mod testing;
pub mod wire;
