//! Area that the views measure in the simulation and a real scan may lack.

use crate::planning::verdict::RiskReason;

/// Asked area that the views measure and that is at risk ([`crate::planning::method::realism`]), mm².
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AtRisk {
    /// All of it.
    pub area_mm2: f64,
    /// Area by reason, in the order of [`RiskReason::ALL`]. A sample has more than one reason at times, so that these add up to
    /// more than all of it.
    pub by_reason_mm2: [f64; RiskReason::ALL.len()],
    /// True if it counts as measured.
    pub is_counted: bool,
}
