//! Calibration of the cell: scanner on the flange, axis of the table, where the part lies; from observations to poses with their
//! covariance, and a check before use. Pure: no files, no clock. Equation of the chain: [`data`]. Calibration of the scanner itself:
//! [`lens`].

pub mod board_scale;
pub mod brightness;
pub mod check;
pub mod chi_squared;
pub mod data;
mod diagnosis;
pub mod findings;
pub mod leave_one_out;
pub mod lens;
pub mod observability;
pub mod placement;
pub mod poses;
pub mod refine;
pub mod screening;
pub mod se3;
pub mod solve;
pub mod start;
pub mod table;
#[cfg(test)]
mod tests;
pub mod watch;
pub mod witness;
