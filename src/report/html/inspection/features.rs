//! Features on the page of an inspection: the result by their verdicts, at its head, and the table of regions and features.

use super::super::markup::{escape, grouped, number, percent};
use super::{InspectionReport, row, section, table};
use crate::wire::inspection::{
    DeviationDocument, InspectionDocument, RegionDeviationDocument, SIGN_SENTENCE, VerdictCounts, best_fit_sentence,
    measured_region_sentence, undecided_sentences,
};
use crate::wire::words::limits_mm;

/// Smallest share of the area beyond the search distance that the result's title tells, for a part whose features pass: below, a sample or
/// two at a rim, or at surface that is excluded, would take back what the title says. Our choice.
const MIN_OFF: f64 = 0.001;

/// Section on the result: features by verdict, what is missing, and what to change before the next plan.
pub(super) fn result(document: &InspectionDocument) -> String {
    let offers: String = document.offers.iter().map(|offer| format!("<li>{}</li>\n", escape(&offer.detail))).collect();
    let offers = if offers.is_empty() { offers } else { format!("<h3>Before the next plan</h3>\n<ul>\n{offers}</ul>\n") };
    let told = format!("<p>{}</p>\n", escape(&grouped(&document.verdict)));
    let told = match standing(document) {
        Some((class, title)) => format!("<div class=\"verdict {class}\">\n<h2>{title}</h2>\n{told}</div>\n"),
        None => format!("<h2>Result</h2>\n{told}"),
    };
    format!("<section>\n{told}{offers}</section>\n")
}

/// Class of the result's frame, by which it has its colour, and its title; `None` where nothing is judged. Features that pass are met only
/// where nothing of the part is farther off than is searched; the title tells what is.
fn standing(document: &InspectionDocument) -> Option<(&'static str, String)> {
    if document.alignment.why_not_found().is_some() {
        return Some(("none", "The part was not found".to_owned()));
    }
    let counts = document.verdict_counts()?;
    let off = off_words(&document.deviation);
    Some(match (counts, off) {
        (VerdictCounts { fail: 1.., .. }, _) => ("none", counts.title()),
        (VerdictCounts { undecided: 1.., .. }, _) => ("short", counts.title()),
        (_, Some(off)) => ("short", format!("{}, but {off} beyond the search distance", counts.title())),
        (_, None) => ("met", counts.title()),
    })
}

/// Words for what lies beyond the search distance, `None` where hardly anything does.
fn off_words(deviation: &DeviationDocument) -> Option<String> {
    let off = deviation.excluded.off_of_area;
    if off >= MIN_OFF {
        return Some(format!("{} of the part's area is", percent(off)));
    }
    (!deviation.off_surface.is_empty()).then(|| "points lie".to_owned())
}

/// Columns of [`region_row`].
const REGION_HEAD: [&str; 9] =
    ["Region", "Verdict", "Tolerance, mm", "Mean, mm", "Largest, mm", "U (k = 2), mm", "In tolerance", "Measured", "Left out"];

/// Section on regions and features: figures and verdict of each, and what keeps the undecided ones open.
pub(super) fn list(report: &InspectionReport<'_>) -> String {
    let is_found = report.document.alignment.why_not_found().is_none();
    let regions = &report.document.deviation.regions;
    let rows: String = regions.iter().map(|region| region_row(region, is_found)).collect();
    if rows.is_empty() {
        return rows;
    }
    let measured = escape(&measured_region_sentence(&report.document.params.compare));
    let best_fit = best_fit_sentence(&report.document.deviation).map_or_else(String::new, |words| format!(" {}", escape(words)));
    section(
        "Regions and features",
        &(table(&REGION_HEAD, &rows)
            + &format!("<p>{SIGN_SENTENCE} {measured}{best_fit}</p>\n")
            + "<p>Verdicts follow ISO 14253-1. A region is <i>undecided</i> if its deviation is within its uncertainty of the limit, if too \
         little of it is measured, or if some of its surface is <i>off</i>: points in front of it or behind it lie beyond the search \
         distance; raise <code>compare.search_mm</code> so that it is judged. <i>Steep</i> points show a surface that is tilted too far \
         from the model; where most points are steep and beyond the limit, the area counts as not measured. U includes the uncertainty \
         of the poses of views that only the model constrains. Tolerances are told by their limits: <code>tolerance_mm</code> is the \
         width of the zone between them.</p>\n"
            + &if is_found { undecided(regions) } else { String::new() }),
    )
}

/// Regions that are undecided, with what keeps each from passing: a place, area that is missing, or the poses with a remedy.
fn undecided(regions: &[RegionDeviationDocument]) -> String {
    let told = |region: &RegionDeviationDocument| {
        undecided_sentences(region)
            .map(|sentences| format!("<li>{}: {}</li>\n", escape(&region.name), escape(&grouped(&sentences))))
    };
    let told: String = regions.iter().filter_map(told).collect();
    if told.is_empty() { told } else { format!("<ul>\n{told}</ul>\n") }
}

/// Row of a region, which has no verdict where the part was not found.
fn region_row(region: &RegionDeviationDocument, is_found: bool) -> String {
    let verdict = region.verdict.map_or("no tolerance", |verdict| if is_found { verdict.as_str() } else { "not judged" });
    let mm = |value: Option<f64>| value.map_or("–".to_owned(), |value| number(value, 3));
    let limits = region.tolerance_mm.map_or("–".to_owned(), limits_mm);
    let (excluded, within) = (region.excluded, region.statistics.and_then(|figures| figures.in_tolerance));
    let [points, steep, off] = [excluded.turned_of_points, excluded.turned_of_area, excluded.off_of_area].map(percent);
    row(&[
        escape(&region.name),
        format!("<b>{verdict}</b>"),
        limits,
        mm(region.statistics.map(|figures| figures.mean_mm)),
        mm(region.statistics.map(|figures| figures.max_mm)),
        mm(region.expanded_uncertainty_mm),
        within.map_or("–".to_owned(), percent),
        percent(region.measured),
        format!("{points} of the points steep; area: {steep} steep, {off} off"),
    ])
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::cell::PoseSpec;
    use crate::inspection::deviation::Conformity;
    use crate::wire::inspection::ExcludedSharesDocument;

    /// Document of an inspection with features of these verdicts; points on the part are such a share, and so much area is off.
    fn judged(verdicts: &[&str], inlier_share: f64, off_of_area: f64) -> InspectionDocument {
        let pose = json!(PoseSpec::default());
        let kept_pose = (inlier_share < 0.5).then_some("few_inliers");
        let view = json!({
            "viewpoint": 1, "points": 3000, "inlier_share": inlier_share, "rms_mm": 0.1, "turned_deg": 0.0, "shifted_mm": 0.0,
            "kept_pose": kept_pose,
        });
        let region = |verdict: &&str| {
            json!({
                "name": "bore", "tolerance_mm": 0.3, "measured": 0.99, "verdict": verdict, "expanded_uncertainty_mm": 0.0226,
                "statistics": {
                    "area_mm2": 1806.4, "mean_mm": 0.198, "rms_mm": 0.198, "p1_mm": 0.158, "p5_mm": 0.174, "p50_mm": 0.2,
                    "p95_mm": 0.217, "p99_mm": 0.228, "max_mm": 0.2487, "in_tolerance": 0.0061,
                },
            })
        };
        let extent = json!({"nominal_mm": 10.0, "measured_mm": null});
        let document = json!({
            "schema": "vantage.inspection/1", "plan_sha256": "", "verdict": "1 of 1 feature fails.", "params": {}, "scans": [],
            "findings": [], "losses": [], "offers": [],
            "alignment": {
                "method": "best_fit", "mesh_from_stated": pose, "part_turned_deg": 0.0, "part_shifted_mm": 0.0, "noise_mm": 0.01,
                "part_sd": {"rotation_deg": 0.1, "translation_mm": 0.1}, "inlier_share": inlier_share, "views": [view],
            },
            "coverage": {
                "asked_area_mm2": 100.0, "planned_of_asked": 0.9, "measured_of_asked": 0.8, "measured_in_all_of_asked": 0.8,
                "measured_of_coverable": null, "both_of_asked": 0.8, "lost_of_asked": 0.0, "gained_of_asked": 0.0,
                "neither_of_asked": 0.1, "lost_near_limit_of_asked": 0.0, "gained_near_limit_of_asked": 0.0, "approximate": false,
                "by_view": [],
            },
            "deviation": {
                "alignment": "best_fit", "mesh_from_placed": pose, "fixed_freedoms": 6, "compared_points": 3000,
                "statistics": null, "histogram": {"begin_mm": -1.0, "width_mm": 1.0, "area_mm2": []},
                "extents": [extent, extent, extent],
                "excluded": {"turned_of_points": 0.0, "turned_of_area": 0.0, "off_of_area": off_of_area},
                "regions": verdicts.iter().map(region).collect::<Vec<_>>(), "worst": [], "off_surface": [],
            },
        });
        serde_json::from_value(document).expect("a document")
    }

    /// A part that fails had the plain head of one that passes.
    #[test]
    fn the_result_has_the_colour_and_the_title_of_its_verdicts() {
        let told = |verdicts: &[&str], inlier_share: f64, off: f64| standing(&judged(verdicts, inlier_share, off));
        let of = |class: &'static str, title: &str| Some((class, title.to_owned()));
        assert_eq!(told(&["pass", "fail", "undecided"], 0.95, 0.0), of("none", "1 of 3 features fails"));
        assert_eq!(told(&["pass", "undecided"], 0.95, 0.0), of("short", "1 of 2 features is undecided"));
        assert_eq!(told(&["pass"; 2], 0.95, 0.0), of("met", "All 2 features pass"));
        assert_eq!(told(&["pass"; 2], 0.95, 0.000_9), of("met", "All 2 features pass"), "a sample at a rim");
        let off = told(&["pass"; 2], 0.95, 0.01).map(|(class, title)| (class, title.replace('\u{a0}', " ")));
        let wanted = of("short", "All 2 features pass, but 1.00 % of the part's area is beyond the search distance");
        assert_eq!(off, wanted, "not all of the part is there");
        let mut heap = json!(judged(&["pass"], 0.95, 0.0));
        heap["deviation"]["off_surface"] = json!([{"kind": "extra", "centre_mm": [0.0, 0.0, 0.0], "points": 90, "mean_mm": 6.0}]);
        let heap = serde_json::from_value(heap).expect("a document");
        assert_eq!(standing(&heap), of("short", "The one feature passes, but points lie beyond the search distance"));
        assert_eq!(told(&["pass"], 0.3, 0.0), of("none", "The part was not found"));
        assert_eq!(told(&[], 0.95, 0.0), None);
        let html = result(&judged(&["fail"], 0.95, 0.0));
        let wanted =
            "<section>\n<div class=\"verdict none\">\n<h2>1 of 1 feature fails</h2>\n<p>1 of 1 feature fails.</p>\n</div>\n";
        assert!(html.starts_with(wanted), "{html}");
        assert!(result(&judged(&[], 0.95, 0.0)).starts_with("<section>\n<h2>Result</h2>\n<p>"), "no feature");
    }

    /// The mean and the share in tolerance, from which one sees that a whole face is off, were in the JSON alone; and a zone of 0.3 mm was
    /// read as ± 0.3 mm.
    #[test]
    fn a_region_has_a_cell_for_each_column_with_its_mean_and_its_share_in_tolerance() {
        let document = judged(&["fail"], 0.95, 0.0);
        let row = region_row(&document.deviation.regions[0], true).replace('\u{a0}', " ");
        assert_eq!(row.matches("<td>").count(), REGION_HEAD.len());
        let figures = "<td>±0.150</td><td>0.198</td><td>0.249</td><td>0.023</td><td>0.61 %</td><td>99.00 %</td>";
        assert!(row.contains(figures) && REGION_HEAD[2..4] == ["Tolerance, mm", "Mean, mm"], "{row}");
    }

    #[test]
    fn a_region_tells_what_its_verdict_leaves_out() {
        let region = RegionDeviationDocument {
            name: "top".into(),
            tolerance_mm: Some(0.1),
            measured: 0.9,
            excluded: ExcludedSharesDocument { turned_of_points: 0.25, turned_of_area: 0.05, off_of_area: 0.03 },
            verdict: Some(Conformity::Undecided),
            expanded_uncertainty_mm: Some(0.25),
            pose_uncertainty_mm: Some(0.24),
            is_open_by_poses: true,
            open: None,
            undecided_because: None,
            measured_samples: None,
            conforming: None,
            statistics: None,
        };
        let row = region_row(&region, true).replace('\u{a0}', " ");
        assert!(row.contains("25.00 % of the points steep; area: 5.00 % steep, 3.00 % off"), "{row}");
        assert!(region_row(&region, false).contains("<b>not judged</b>"), "the part was not found");
        let told = undecided(std::slice::from_ref(&region));
        assert!(told.contains("<li>top: U is mostly due to the poses of the views (± 0.240 mm)"), "{told}");
        assert_eq!(undecided(&[RegionDeviationDocument { is_open_by_poses: false, ..region }]), "");
    }
}
