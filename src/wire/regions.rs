//! Listing of the regions of interest and features: `regions.csv`, one row for each, in the order of `coverage.regions` of the
//! plan.

use super::csv::Csv;
use super::plan::RegionCoverageDocument;
use crate::planning::plan::Plan;

/// Name of the file.
pub const REGIONS_FILE: &str = "regions.csv";

const HEADER: [&str; 18] = [
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
    "independent_samples",
    "independent_of_asked",
    "independent_standard_error",
    "independently_met",
];

/// The listing as a table, `None` for a plan without regions. Cells without a value are empty; `plan_sha256` names the plan, by the
/// hash of its file. The columns behind it tell a second set of samples, on which the views were not chosen: how many the region has of
/// them, the measured share of the asked area on them, its standard error, and whether it reaches the target or misses it by no more
/// than that error. They are the last ones, so that those of earlier releases keep their places.
#[must_use]
pub fn csv(plan: &Plan, plan_sha256: &str) -> Option<String> {
    let regions = &plan.coverage.regions;
    if regions.is_empty() {
        return None;
    }
    let mut csv = Csv::new(&HEADER);
    regions.iter().for_each(|region| row(&mut csv, &RegionCoverageDocument::from(region), plan_sha256));
    Some(csv.finish())
}

fn row(csv: &mut Csv, region: &RegionCoverageDocument, plan_sha256: &str) {
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
    csv.optional(region.independent_samples);
    csv.optional(region.independent_of_asked);
    csv.optional(region.independent_standard_error);
    csv.optional(region.independently_met);
    csv.end_row();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_ends_with_the_share_on_samples_that_the_views_were_not_chosen_on_and_has_no_grouped_numbers() {
        let region = RegionCoverageDocument {
            name: "seat".to_owned(),
            kind: "feature".to_owned(),
            samples: 100,
            asked_area_mm2: 2400.0,
            coverable_area_mm2: 2400.0,
            measured_area_mm2: 2304.0,
            of_asked: 0.96,
            of_coverable: 0.96,
            target: Some(0.95),
            met: Some(true),
            tolerance_mm: Some(0.2),
            min_tolerance_mm: Some(0.156),
            missed: Vec::new(),
            beyond_noise_area_mm2: 0.0,
            independent_samples: Some(1475),
            independent_of_asked: Some(0.9),
            independent_standard_error: Some(0.015),
            independently_met: Some(false),
            why_unmet: None,
        };
        let earlier = RegionCoverageDocument {
            independent_samples: None,
            independent_of_asked: None,
            independent_standard_error: None,
            independently_met: None,
            ..region.clone()
        };
        let mut csv = Csv::new(&HEADER);
        [region, earlier].iter().for_each(|region| row(&mut csv, region, "5a"));
        let table = csv.finish();
        let rows: Vec<&str> = table.lines().collect();
        assert_eq!(rows[1], "seat,feature,0.2,0.156,100,2400,2400,2304,0.96,0.95,true,0,,5a,1475,0.9,0.015,false");
        assert_eq!(rows[2], "seat,feature,0.2,0.156,100,2400,2400,2304,0.96,0.95,true,0,,5a,,,,");
        assert!(rows.iter().all(|row| row.split(',').count() == HEADER.len()), "{table}");
    }
}
