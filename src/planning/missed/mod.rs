//! Missed area, its causes, and remedies. For each missed sample there is the first failing cause for the
//! candidate that gets furthest ([`crate::planning::method::causes`]); samples of one cause form connected spots; for each of the
//! largest spots remedies are tried on the part itself, cheapest first, and the first that works is named, else the first that
//! measures half of the spot.
//!
//! Part frame, millimetres, radians. Cost: a bounded number of views on at most 64 samples a spot, some 10⁵ rays; what
//! is named is confirmed on up to 8192 samples.

mod bases;
mod fallback;
mod limit;
pub(super) mod obstructions;
mod opening;
mod proposals;
mod search;
mod spot_samples;
mod spots;
#[cfg(test)]
mod tests;

pub(super) use search::{CanExecute, HasPath, MissAnalysis, explain};
pub use spots::{Spot, spots_of};
