//! The section on regions of interest and features: what was asked of each, what was reached, and why not more.

use super::ReportInput;
use super::markup::{area, escape, number, percent};
use super::views::swatch;
use super::words;
use crate::planning::plan::{Cause, RegionCoverage, RegionKind};
use crate::rendering::{Ink, MissGroup};
use crate::report::text::reached_percent;
use crate::wire::plan::RegionCoverageDocument;
use crate::wire::words::{NOTHING_IN_REGION, asked_name, independent_share, limits_mm, noise_remark};

/// The section; empty if there are no regions.
pub(super) fn section(input: &ReportInput<'_>) -> String {
    let coverage = &input.outcome.plan.coverage;
    let regions = &coverage.regions;
    if regions.is_empty() {
        return String::new();
    }
    let rows: Vec<String> = regions.iter().map(|region| row(region, coverage.is_of_open)).collect();
    let of_open = match coverage.is_of_open {
        true => {
            "<p><b>The open area of each region is the asked area that earlier scans left open.</b> A target applies to the \
                 whole region, so none is judged here.</p>\n"
        }
        false => "",
    };
    format!(
        "<section>\n<h2>Regions and features</h2>\n{}{of_open}<p>Shares are of the {} area of each region; only what meets its \
         requirements counts as measured. A target is not confirmed if it is met on the samples that views were chosen on, but missed on \
         other samples by more than the standard error of their share.</p>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Region</th>\
         <th class=\"n\">Area</th><th class=\"n\">Samples</th><th class=\"n\">Target</th><th class=\"n\">Reached</th><th>Verdict</th>\
         <th>What is missed, and why</th></tr></thead>\n<tbody>\n{}</tbody></table></div>\n</section>\n",
        notice(regions),
        asked_name(coverage.is_of_open),
        rows.concat()
    )
}

/// Notice of regions below their targets, and of those that reach them on the samples that views were chosen on alone; empty if there
/// are none.
fn notice(regions: &[RegionCoverage]) -> String {
    let with_target = regions.iter().filter(|region| region.target.is_some()).count();
    let told = |is_among: fn(&RegionCoverage) -> bool, [one, several]: [&str; 2]| {
        let count = regions.iter().filter(|region| is_among(region)).count();
        let verb = if count == 1 { one } else { several };
        let (count_text, of) = (number(count as f64, 0), number(with_target as f64, 0));
        if count == 0 { String::new() } else { format!("<p><b>{count_text} of {of} {verb}.</b></p>") }
    };
    let unmet = told(RegionCoverage::is_unmet, ["does not reach the target", "do not reach the target"]);
    let refuted = [
        "reaches the target on the samples that views were chosen on, but not on others",
        "reach the target on the samples that views were chosen on, but not on others",
    ];
    let notes = unmet + &told(RegionCoverage::is_refuted, refuted);
    if notes.is_empty() { notes } else { format!("<div class=\"notice\" style=\"margin-bottom:12px\">{notes}</div>\n") }
}

fn row(region: &RegionCoverage, is_of_open: bool) -> String {
    let kind = match region.kind {
        RegionKind::Interest => "Region of interest",
        RegionKind::Feature => "Feature",
    };
    let tolerance = region.tolerance_mm.map_or_else(String::new, |mm| format!(", tolerance {}\u{a0}mm", limits_mm(mm)));
    let is_nothing_open = is_of_open && region.samples == 0;
    let verdict = match region.is_met() {
        _ if is_nothing_open => "Met",
        Some(true) if region.is_refuted() => "<b>Not confirmed</b>",
        Some(true) => "Met",
        Some(false) => "<b>Not met</b>",
        None => "—",
    };
    let reached = match is_nothing_open {
        true => "—".to_owned(),
        false => reached_percent(region.of_asked(), region.target) + "\u{a0}%",
    };
    format!(
        "<tr><td><b>{}</b><br/><span class=\"soft\">{kind}{tolerance}</span></td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
         <td class=\"n\">{}</td><td class=\"n\">{}</td><td>{verdict}{}</td><td>{}</td></tr>\n",
        escape(&region.name),
        area(region.asked_area_mm2),
        number(region.samples as f64, 0),
        region.target.map_or_else(|| "—".to_owned(), percent),
        reached,
        on_other_samples(region),
        if is_nothing_open { escape("earlier scans left none of it open") } else { misses(region) }
    )
}

/// Share on samples that the views were not chosen on, on a line of its own; empty where there are none.
fn on_other_samples(region: &RegionCoverage) -> String {
    let document = RegionCoverageDocument::from(region);
    let samples = number(document.independent_samples.unwrap_or_default() as f64, 0);
    let share = independent_share(&document);
    share.map_or_else(String::new, |share| format!("<br/><span class=\"soft\">on other samples ({samples}): {share}</span>"))
}

/// Causes of the missed area, the largest first.
fn misses(region: &RegionCoverage) -> String {
    if region.samples == 0 {
        return escape(NOTHING_IN_REGION);
    }
    let miss = |(cause, area_mm2): &(Cause, f64)| {
        let noise = noise_remark(region, *cause);
        let noise = noise.map_or_else(String::new, |remark| format!("<br/><span class=\"soft\">{}</span>", escape(&remark)));
        let (mark, name) = (swatch(Ink::Missed(MissGroup::of(*cause))), words::cause_name(*cause));
        format!("{mark}{name} {}{noise}", area(*area_mm2))
    };
    let misses: Vec<String> = region.missed_mm2.iter().map(miss).collect();
    if misses.is_empty() { "Nothing".to_owned() } else { misses.join("<br/>") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::plan::IndependentRegion;

    /// A region with a target of 0.9 that is missed by little.
    fn region() -> RegionCoverage {
        RegionCoverage {
            name: "rim".to_owned(),
            kind: RegionKind::Interest,
            samples: 90,
            asked_area_mm2: 1000.0,
            coverable_area_mm2: 1000.0,
            measured_area_mm2: 899.96,
            target: Some(0.9),
            tolerance_mm: None,
            min_tolerance_mm: 0.1,
            missed_mm2: Vec::new(),
            beyond_noise_area_mm2: 0.0,
            independent: None,
        }
    }

    #[test]
    fn a_target_that_other_samples_refute_is_not_told_as_met() {
        let independent = |measured_area_mm2: f64| {
            Some(IndependentRegion { samples: 1600, asked_area_mm2: 1600.0, measured_area_mm2, squares_mm4: 1600.0 })
        };
        let refuted = RegionCoverage { measured_area_mm2: 910.0, independent: independent(1280.0), ..region() };
        let held = RegionCoverage { independent: independent(1472.0), ..refuted.clone() };
        let told = "<td><b>Not confirmed</b><br/><span class=\"soft\">on other samples (1\u{202f}600): 80.00 %, standard error 1.00 \
                    points</span></td>";
        assert!(row(&refuted, false).contains(told), "{}", row(&refuted, false));
        assert!(
            row(&held, false).contains("<td>Met<br/>") && row(&held, false).contains(": 92.00 %, standard error 0.68 points"),
            "{}",
            row(&held, false)
        );
        let both = notice(&[refuted, held.clone(), region()]);
        assert!(
            both.contains("<b>1 of 3 does not reach the target.</b>")
                && both.contains("<b>1 of 3 reaches the target on the samples"),
            "{both}"
        );
        assert_eq!(notice(&[held]), "");
    }

    #[test]
    fn a_region_below_its_target_shows_less_than_the_target() {
        let row = row(&region(), false);
        let (target, reached) = ("<td class=\"n\">90.00\u{a0}%</td>", "<td class=\"n\">89.99\u{a0}%</td>");
        assert!(row.contains(&format!("{target}{reached}<td><b>Not met</b></td>")), "{row}");
    }

    #[test]
    fn a_region_of_which_nothing_is_left_open_is_met() {
        let done = RegionCoverage { samples: 0, asked_area_mm2: 0.0, measured_area_mm2: 0.0, target: None, ..region() };
        let told = row(&done, true);
        assert!(told.contains("<td>Met</td><td>earlier scans left none of it open</td>"), "{told}");
        assert!(!told.contains("0.00\u{a0}%"), "no share of nothing: {told}");
    }
}
