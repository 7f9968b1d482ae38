//! Checks on the regions of a plan: areas that fit into each other, causes from the closed list, and a verdict on each target
//! that follows from the measured share.

use super::{AREA_TOLERANCE, SHARE_TOLERANCE, one_of, share};
use crate::cell::Findings;
use crate::planning::plan::{Cause, RegionKind, StopReason};
use crate::wire::plan::{PlanDocument, RegionCoverageDocument};

/// Checks every region, and the stop reason against them.
pub(super) fn check(document: &PlanDocument, findings: &mut Findings) {
    let regions = &document.coverage.regions;
    for (number, region) in regions.iter().enumerate() {
        let at = format!("/coverage/regions/{number}");
        check_shares(&at, region, findings);
        // Plans from before regions had a kind have no more than shares.
        if !region.kind.is_empty() {
            check_region(&at, region, findings);
        }
    }
    let leaves_unmet = document.stopped_because == StopReason::RegionsUnmet.as_str();
    let any_unmet = regions.iter().any(|region| region.met == Some(false));
    findings.require(!leaves_unmet || any_unmet, "/stopped_because", || {
        format!("is {:?}, but no region misses its target", document.stopped_because)
    });
}

fn check_shares(at: &str, region: &RegionCoverageDocument, findings: &mut Findings) {
    share(format!("{at}/of_asked"), region.of_asked, findings);
    share(format!("{at}/of_coverable"), region.of_coverable, findings);
    if let Some(target) = region.target {
        share(format!("{at}/target"), target, findings);
    }
    check_independent(at, region, findings);
}

/// Checks the share on samples that the views were not chosen on, and the verdict that follows from it.
fn check_independent(at: &str, region: &RegionCoverageDocument, findings: &mut Findings) {
    let (of_asked, error) = (region.independent_of_asked, region.independent_standard_error);
    let shares = [("independent_of_asked", of_asked), ("independent_standard_error", error)];
    for (name, value) in shares.into_iter().filter_map(|(name, value)| Some((name, value?))) {
        share(format!("{at}/{name}"), value, findings);
    }
    let has_samples = region.independent_samples.is_none_or(|samples| samples > 0);
    findings.require(of_asked.is_none() || has_samples, format!("{at}/independent_samples"), || {
        "is 0; allowed is 1 and more, or none of the fields on independent samples".to_owned()
    });
    let Some((of_asked, error)) = of_asked.zip(error) else { return };
    let Some((target, told)) = region.target.zip(region.independently_met) else { return };
    let margin = of_asked + error - target;
    // Of what is met to the last digit either may be told.
    let follows = margin.abs() <= 4.0 * SHARE_TOLERANCE || told == (margin > 0.0);
    findings.require(follows, format!("{at}/independently_met"), || {
        format!("is {told}; by independent_of_asked, independent_standard_error and target it is {}", !told)
    });
}

fn check_region(at: &str, region: &RegionCoverageDocument, findings: &mut Findings) {
    one_of(format!("{at}/kind"), &region.kind, &RegionKind::ALL.map(RegionKind::as_str), findings);
    let asked_mm2 = region.asked_area_mm2;
    let derived = if asked_mm2 > 0.0 { region.measured_area_mm2 / asked_mm2 } else { 0.0 };
    findings.require((region.of_asked - derived).abs() <= AREA_TOLERANCE, format!("{at}/of_asked"), || {
        format!("is {}; by measured_area_mm2 it is {derived}", region.of_asked)
    });
    let met = region.target.map(|target| region.of_asked >= target - 4.0 * SHARE_TOLERANCE);
    findings.require(region.met == met, format!("{at}/met"), || {
        format!("is {}; by of_asked and target it is {}", verdict(region.met), verdict(met))
    });
    for (index, missed) in region.missed.iter().enumerate() {
        one_of(format!("{at}/missed/{index}/reason"), &missed.reason, &Cause::ALL.map(Cause::as_str), findings);
    }
    let missed_mm2: f64 = region.missed.iter().fold(0.0, |sum, missed| sum + missed.area_mm2);
    let left_mm2 = asked_mm2 - region.measured_area_mm2;
    findings.require((missed_mm2 - left_mm2).abs() <= AREA_TOLERANCE * asked_mm2, format!("{at}/missed"), || {
        format!("adds up to {missed_mm2} mm²; asked less measured is {left_mm2} mm²")
    });
}

fn verdict(met: Option<bool>) -> String {
    met.map_or_else(|| "absent".to_owned(), |met| met.to_string())
}
