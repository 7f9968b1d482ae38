//! The integration tests: one binary, one module a topic.

mod architecture;
mod inspect_scanner;
mod meshes;
mod public_figures;
mod report;
mod support;
