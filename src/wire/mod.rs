//! Floor 7, what leaves the house: the JSON and CSV shapes of results, and the pages and pictures made for people.

pub mod coverage;
mod csv;
pub mod missed;
pub mod report;
mod tally;
pub mod viewpoints;
