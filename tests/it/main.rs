//! The integration tests: one binary, one module a topic.

mod inspect_scanner;
mod public_figures;
mod support;
