//! Floor 7, the JSON shapes, versioned: what files and answers look like. Degrees and plain arrays live here.

pub mod echo;
mod json_file;
pub mod plan;
pub mod scanner_facts;

pub use json_file::json_file_bytes;
