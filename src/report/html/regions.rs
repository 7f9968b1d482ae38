//! The section on regions of interest and features: what was asked of each, what was reached, and why not more.

use super::ReportInput;
use super::markup::{area, escape, number, percent};
use super::views::swatch;
use super::words;
use crate::planning::plan::{Cause, RegionCoverage, RegionKind};
use crate::rendering::{Ink, MissGroup};
use crate::report::text::reached_percent;
use crate::wire::words::{NOTHING_IN_REGION, noise_remark};

/// The section; empty if there are no regions.
pub(super) fn section(input: &ReportInput<'_>) -> String {
    let regions = &input.outcome.plan.coverage.regions;
    if regions.is_empty() {
        return String::new();
    }
    let rows: Vec<String> = regions.iter().map(row).collect();
    format!(
        "<section>\n<h2>Regions and features</h2>\n{}<p>Shares are of the asked area of each region; only what meets its \
         requirements counts as measured.</p>\n<div class=\"card scroll\"><table>\n<thead><tr><th>Region</th>\
         <th class=\"n\">Area</th><th class=\"n\">Samples</th><th class=\"n\">Target</th><th class=\"n\">Reached</th><th>Verdict</th>\
         <th>What is missed, and why</th></tr></thead>\n<tbody>\n{}</tbody></table></div>\n</section>\n",
        notice(regions),
        rows.concat()
    )
}

/// Notice of regions below their targets; empty if there are none.
fn notice(regions: &[RegionCoverage]) -> String {
    let unmet = regions.iter().filter(|region| region.is_unmet()).count();
    let with_target = regions.iter().filter(|region| region.target.is_some()).count();
    if unmet == 0 {
        return String::new();
    }
    let verb = if unmet == 1 { "does" } else { "do" };
    format!(
        "<div class=\"notice\" style=\"margin-bottom:12px\"><p><b>{} of {} {verb} not reach the target.</b></p></div>\n",
        number(unmet as f64, 0),
        number(with_target as f64, 0)
    )
}

fn row(region: &RegionCoverage) -> String {
    let kind = match region.kind {
        RegionKind::Interest => "Region of interest",
        RegionKind::Feature => "Feature",
    };
    let tolerance = region.tolerance_mm.map_or_else(String::new, |mm| format!(", tolerance {}\u{a0}mm", number(mm, 3)));
    let verdict = match region.is_met() {
        Some(true) => "Met",
        Some(false) => "<b>Not met</b>",
        None => "—",
    };
    let reached = reached_percent(region.of_asked(), region.target) + "\u{a0}%";
    format!(
        "<tr><td><b>{}</b><br/><span class=\"soft\">{kind}{tolerance}</span></td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
         <td class=\"n\">{}</td><td class=\"n\">{}</td><td>{verdict}</td><td>{}</td></tr>\n",
        escape(&region.name),
        area(region.asked_area_mm2),
        number(region.samples as f64, 0),
        region.target.map_or_else(|| "—".to_owned(), percent),
        reached,
        misses(region)
    )
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

    #[test]
    fn a_region_below_its_target_shows_less_than_the_target() {
        let region = RegionCoverage {
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
        };
        let row = row(&region);
        let (target, reached) = ("<td class=\"n\">90.00\u{a0}%</td>", "<td class=\"n\">89.99\u{a0}%</td>");
        assert!(row.contains(&format!("{target}{reached}<td><b>Not met</b></td>")), "{row}");
    }
}
