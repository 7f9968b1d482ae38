//! Planning, inspection and rendering: the rooms of Vantage that know no network and no command line.
#![cfg_attr(test, expect(clippy::float_cmp, reason = "tests hold to the bit what is exact"))]

pub mod cell;
pub mod geometry;
pub mod inspection;
pub mod planning;
pub mod program;
pub mod rendering;
#[cfg(test)]
mod testing;
