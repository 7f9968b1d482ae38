//! Listing of the regions of interest and features: `regions.csv`, one row for each, in the order of `coverage.regions` of the
//! plan.

use super::csv::Csv;
use super::plan::RegionCoverageDocument;
use crate::planning::plan::Plan;

/// Name of the file.
pub const REGIONS_FILE: &str = "regions.csv";

const HEADER: [&str; 14] = [
    "name",
    "kind",
    "tolerance_mm",
    "min_tolerance_mm",
    "samples",
    "asked_area_mm2",
    "coverable_area_mm2",
    "measured_area_mm2",
    "of_asked",
    "target",
    "met",
    "beyond_noise_area_mm2",
    "why_unmet",
    "plan_sha256",
];

/// The listing as a table, `None` for a plan without regions. Cells without a value are empty; the last column names the plan,
/// by the hash of its file.
#[must_use]
pub fn csv(plan: &Plan, plan_sha256: &str) -> Option<String> {
    let regions = &plan.coverage.regions;
    if regions.is_empty() {
        return None;
    }
    let mut csv = Csv::new(&HEADER);
    for region in regions.iter().map(RegionCoverageDocument::from) {
        csv.text(&region.name);
        csv.text(&region.kind);
        csv.optional(region.tolerance_mm);
        csv.optional(region.min_tolerance_mm);
        csv.number(region.samples);
        csv.number(region.asked_area_mm2);
        csv.number(region.coverable_area_mm2);
        csv.number(region.measured_area_mm2);
        csv.number(region.of_asked);
        csv.optional(region.target);
        csv.optional(region.met);
        csv.number(region.beyond_noise_area_mm2);
        csv.text(region.why_unmet.as_deref().unwrap_or(""));
        csv.number(plan_sha256);
        csv.end_row();
    }
    Some(csv.finish())
}
