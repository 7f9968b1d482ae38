//! The integration tests: one binary, one module a topic.

mod architecture;
mod inspect_scanner;
mod meshes;
mod oracle_coverage;
mod public_figures;
mod support;
