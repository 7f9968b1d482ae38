#![doc = include_str!("ARCHITECTURE.md")]

pub mod cell;
pub mod cli;
pub mod geometry;
pub mod planning;
pub mod wire;
