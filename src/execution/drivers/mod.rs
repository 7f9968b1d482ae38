//! Drivers, one file a protocol.
