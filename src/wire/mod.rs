//! Floor 7, the JSON shapes, versioned: what files and answers look like. Degrees and plain arrays live here.

pub mod echo;
pub mod plan;
pub mod scanner_facts;
