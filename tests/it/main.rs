//! The integration tests, one binary.

mod meshes;
