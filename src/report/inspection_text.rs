//! An inspection as plain text.

use std::fmt::Write;

use crate::inspection::losses::LossCause;
use crate::inspection::registration::PartNotFound;
use crate::wire::inspection::{
    AlignmentDocument, InspectionDocument, RegionDeviationDocument, SIGN_SENTENCE, best_fit_sentence, excluded_sentence,
    loss_phrase, measured_region_sentence, remedy_words, undecided_sentences,
};
use crate::wire::words::{counted, fixed, limits_mm, percent_below};

/// Renders the text.
#[must_use]
pub fn inspection_text(document: &InspectionDocument, part_name: &str) -> String {
    let mut text = format!("Inspection of {part_name}\n\n{}\n", document.verdict);
    let mut line = |words: String| {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{words}");
    };
    let alignment = &document.alignment;
    line(place_words(alignment));
    for view in alignment.views.iter().filter_map(|view| Some((view, view.kept_pose?))) {
        line(format!("  view {} keeps its stated pose: {}", view.0.viewpoint, view.1.as_str().replace('_', " ")));
    }
    if !document.losses.is_empty() {
        line("\nLosses, of the asked area:".to_owned());
    }
    for loss in &document.losses {
        let remedy = loss.largest.first().map_or("none", |spot| remedy_words(spot.remedy));
        line(loss_words(loss.of_asked, loss.cause, &counted(loss.spots, "spot"), remedy));
    }
    line(format!("\nDeviation: {SIGN_SENTENCE} {}", excluded_sentence(&document.deviation)));
    if !document.deviation.regions.is_empty() {
        let best_fit = best_fit_sentence(&document.deviation).map_or_else(String::new, |words| format!(" {words}"));
        line(format!("\n{}{best_fit}", measured_region_sentence(&document.params.compare)));
    }
    let is_found = alignment.why_not_found().is_none();
    document.deviation.regions.iter().for_each(|region| line(region_words(region, is_found)));
    if !document.offers.is_empty() {
        line("\nBefore the next plan:".to_owned());
    }
    document.offers.iter().for_each(|offer| line(format!("  {}", offer.detail)));
    if !document.findings.is_empty() {
        line("\nFiles:".to_owned());
    }
    document.findings.iter().for_each(|finding| line(format!("  {}", finding.detail)));
    line(format!("\nplan {}", document.plan_sha256));
    text
}

/// Place of the part, or the reason for which it was not found.
fn place_words(alignment: &AlignmentDocument) -> String {
    let on_part = percent_below(alignment.inlier_share, 1.0, 1);
    let (mm, deg) = (alignment.part_shifted_mm, alignment.part_turned_deg);
    match alignment.why_not_found() {
        None => format!(
            "\nAlignment: the part lies {mm:.3} mm and {deg:.3}° from where it was planned; {on_part} % of the points lie on it."
        ),
        Some(PartNotFound::FewPoints) => format!("\nAlignment: not found; {}.", alignment.few_points_words()),
        Some(PartNotFound::FewInliers) => {
            format!("\nAlignment: not found; {on_part} % of the points lie on the part. Are these scans of this part?")
        }
    }
}

/// A loss: its share of the asked area, its cause, its spots and the remedy of the largest.
fn loss_words(of_asked: f64, cause: LossCause, spots: &str, remedy: &str) -> String {
    format!("  {:>6} %  {:<27} {spots}; remedy: {remedy}", percent_below(of_asked, 1.0, 2), loss_phrase(cause))
}

/// Verdict of a region, the figures that it is from, and what it leaves out. A region of a part that was not found has no verdict.
fn region_words(region: &RegionDeviationDocument, is_found: bool) -> String {
    let verdict = region.verdict.map_or("no tolerance", |verdict| if is_found { verdict.as_str() } else { "not judged" });
    let (name, excluded) = (&region.name, region.excluded);
    let [measured, points, steep, off] =
        [region.measured, excluded.turned_of_points, excluded.turned_of_area, excluded.off_of_area]
            .map(|share| percent_below(share, 1.0, 2));
    let figures = figures_words(region);
    let undecided = undecided_sentences(region).filter(|_| is_found);
    let undecided = undecided.map_or_else(String::new, |sentences| format!(". {sentences}"));
    // Quoted, so that no name breaks a line.
    format!(
        "\nRegion {name:?}: {verdict}{figures}; {measured} % measured; left out: {points} % of the points as steep, of the area \
         {steep} % steep and {off} % off the surface{undecided}"
    )
}

/// Figures of a region: the limits of its tolerance, its mean and largest deviation, and its uncertainty, as far as they are known.
fn figures_words(region: &RegionDeviationDocument) -> String {
    let mm = |name: &str, value: Option<f64>| value.map(|value| format!("{name} {}", fixed(value, 3)));
    let statistics = region.statistics.as_ref();
    let figures: Vec<String> = [
        region.tolerance_mm.map(|width_mm| format!("tolerance {}", limits_mm(width_mm))),
        mm("mean", statistics.map(|figures| figures.mean_mm)),
        mm("largest", statistics.map(|figures| figures.max_mm)),
        mm("U", region.expanded_uncertainty_mm),
    ]
    .into_iter()
    .flatten()
    .collect();
    let within = statistics.and_then(|figures| figures.in_tolerance);
    let within = within.map_or_else(String::new, |share| format!(", {} % in tolerance", percent_below(share, 1.0, 2)));
    let unit = if region.expanded_uncertainty_mm.is_some() { "mm (k = 2)" } else { "mm" };
    if figures.is_empty() { within } else { format!(", {} {unit}{within}", figures.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::deviation::Conformity;
    use crate::wire::inspection::ExcludedSharesDocument;

    /// 37.3 % on the part were told as a part found 153° off, and all of too few points as "not found; 100.0 %".
    #[test]
    fn an_alignment_that_was_not_found_is_told_with_its_reason() {
        let told = |inlier_share: f64, points: usize, kept: [Option<&str>; 2]| {
            let view = |kept_pose: &Option<&str>| {
                serde_json::json!({
                    "viewpoint": 1, "points": points, "inlier_share": inlier_share, "rms_mm": 0.1, "turned_deg": 0.0,
                    "shifted_mm": 0.0, "kept_pose": kept_pose,
                })
            };
            // As an earlier release wrote it, without a reason.
            let document = serde_json::json!({
                "method": "best_fit", "mesh_from_stated": crate::cell::PoseSpec::default(), "part_turned_deg": 153.0,
                "part_shifted_mm": 5.6, "part_sd": {"rotation_deg": 0.05, "translation_mm": 0.1}, "noise_mm": 0.1,
                "inlier_share": inlier_share, "views": kept.iter().map(view).collect::<Vec<_>>(),
            });
            place_words(&serde_json::from_value(document).expect("an alignment"))
        };
        let swapped = told(0.373, 3000, [None, Some("few_inliers")]);
        assert_eq!(swapped, "\nAlignment: not found; 37.3 % of the points lie on the part. Are these scans of this part?");
        let few = told(1.0, 120, [Some("few_points"); 2]);
        assert_eq!(few, "\nAlignment: not found; too few points: 240 in all; a view needs 500 on the part.");
        assert!(told(0.95, 3000, [None, Some("few_inliers")]).contains("the part lies 5.600 mm"));
    }

    #[test]
    fn a_small_loss_is_not_told_as_none() {
        let told = |of_asked: f64| loss_words(of_asked, LossCause::ViewMissing, "1 spot", "add a view");
        assert_eq!(told(0.25), "   25.00 %  no scan of the view         1 spot; remedy: add a view");
        assert_eq!(told(0.000_03), "  0.0030 %  no scan of the view         1 spot; remedy: add a view");
    }

    #[test]
    fn a_region_tells_what_its_verdict_leaves_out() {
        let region = RegionDeviationDocument {
            name: "bo\nre".into(),
            tolerance_mm: Some(0.1),
            measured: 0.9,
            excluded: ExcludedSharesDocument { turned_of_points: 0.25, turned_of_area: 0.05, off_of_area: 0.03 },
            verdict: Some(Conformity::Fail),
            expanded_uncertainty_mm: Some(0.25),
            pose_uncertainty_mm: Some(0.24),
            is_open_by_poses: false,
            open: None,
            undecided_because: None,
            measured_samples: None,
            conforming: None,
            statistics: None,
        };
        let wanted = "\nRegion \"bo\\nre\": fail, tolerance ±0.050, U 0.250 mm (k = 2); 90.00 % measured; left out: 25.00 % of \
                      the points as steep, of the area 5.00 % steep and 3.00 % off";
        let told = region_words(&region, true);
        assert!(told.contains(wanted) && told.ends_with("off the surface"), "{told}");
        let open = RegionDeviationDocument { verdict: Some(Conformity::Undecided), is_open_by_poses: true, ..region };
        let told = region_words(&open, true);
        assert!(told.contains("off the surface. U is mostly due to the poses of the views (± 0.240 mm): calibrate"), "{told}");
        let told = region_words(&open, false);
        assert!(told.contains("\": not judged, tolerance ±0.050") && told.ends_with("off the surface"), "{told}");
    }

    /// A region that failed was told with its uncertainty, and not with what was measured; and its zone of 0.3 mm was read as ± 0.3 mm.
    #[test]
    fn a_region_tells_the_figures_that_its_verdict_is_from() {
        let region = serde_json::json!({
            "name": "step", "tolerance_mm": 0.3, "measured": 0.9996, "verdict": "fail", "expanded_uncertainty_mm": 0.0226,
            "statistics": {
                "area_mm2": 1806.4, "mean_mm": 0.198, "rms_mm": 0.198, "p1_mm": 0.158, "p5_mm": 0.174, "p50_mm": 0.2,
                "p95_mm": 0.217, "p99_mm": 0.228, "max_mm": 0.2487, "in_tolerance": 0.0061,
            },
        });
        let told = region_words(&serde_json::from_value(region).expect("a region"), true);
        let wanted =
            "fail, tolerance ±0.150, mean 0.198, largest 0.249, U 0.023 mm (k = 2), 0.61 % in tolerance; 99.96 % measured;";
        assert!(told.contains(wanted), "{told}");
        let unmeasured = serde_json::json!({
            "name": "bore", "tolerance_mm": null, "measured": 0.0, "verdict": null, "expanded_uncertainty_mm": null,
            "statistics": null,
        });
        let told = region_words(&serde_json::from_value(unmeasured).expect("a region"), true);
        assert!(told.contains("\"bore\": no tolerance; 0.00 % measured;"), "{told}");
    }
}
