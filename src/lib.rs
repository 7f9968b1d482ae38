#![doc = include_str!("ARCHITECTURE.md")]

pub mod cell;
pub mod geometry;
pub mod planning;
#[cfg(test)]
mod testing;
pub mod wire;
