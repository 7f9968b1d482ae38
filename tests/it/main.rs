//! Integration tests, one binary.

mod sample;

mod look;
mod report;
