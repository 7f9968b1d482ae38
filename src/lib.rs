#![doc = include_str!("ARCHITECTURE.md")]
#![cfg_attr(test, expect(clippy::float_cmp, reason = "tests hold to the bit what is exact"))]

pub mod cell;
pub mod check;
pub mod cli;
pub mod execution;
pub mod geometry;
pub mod http;
pub mod inspection;
pub mod planning;
pub mod program;
pub mod report;
pub mod service;
pub mod settings;
#[cfg(test)]
mod testing;
pub mod wire;
