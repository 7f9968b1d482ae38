//! Drivers, one file a protocol.

pub mod stream;
