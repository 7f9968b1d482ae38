//! Floor 7, what leaves the house: the JSON and CSV shapes of results, versioned, and the pages and pictures made for
//! people. Degrees and plain arrays live here.

pub mod coverage;
mod csv;
pub mod echo;
pub mod missed;
pub mod plan;
pub mod report;
mod tally;
pub mod viewpoints;
