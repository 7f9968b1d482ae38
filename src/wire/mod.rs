//! Floor 7, what leaves the house: the JSON and CSV shapes of results, versioned, and the pages and pictures made for
//! people. Degrees and plain arrays live here.

pub mod coverage;
mod csv;
pub mod echo;
mod json_file;
pub mod missed;
pub mod plan;
pub mod report;
pub mod scanner_facts;
mod tally;
pub mod viewpoints;

pub use json_file::json_file_bytes;
