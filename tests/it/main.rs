//! The integration tests: one binary, one module a topic.

mod architecture;
mod inspect_scanner;
mod public_figures;
mod support;
//! The integration tests, one binary.

mod meshes;
