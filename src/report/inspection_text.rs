//! An inspection as plain text.

use std::fmt::Write;

use crate::inspection::losses::LossCause;
use crate::inspection::registration::PartNotFound;
use crate::wire::inspection::{
    AlignmentDocument, InspectionDocument, RegionDeviationDocument, excluded_sentence, loss_phrase, open_poses_sentence,
    remedy_words,
};
use crate::wire::words::{counted, percent_below};

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
    line(format!("\nDeviation: {}", excluded_sentence(&document.deviation)));
    document.deviation.regions.iter().for_each(|region| line(region_words(region)));
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

/// Verdict of a region, and what it leaves out.
fn region_words(region: &RegionDeviationDocument) -> String {
    let verdict = region.verdict.map_or("no tolerance", |verdict| verdict.as_str());
    let (name, excluded) = (&region.name, region.excluded);
    let [measured, points, steep, off] =
        [region.measured, excluded.turned_of_points, excluded.turned_of_area, excluded.off_of_area]
            .map(|share| percent_below(share, 1.0, 2));
    let uncertainty = region.expanded_uncertainty_mm.map_or_else(String::new, |mm| format!(", U {mm:.3} mm (k = 2)"));
    let open = open_poses_sentence(region).map_or_else(String::new, |sentence| format!(". {sentence}"));
    // Quoted, so that no name breaks a line.
    format!(
        "\nRegion {name:?}: {verdict}, {measured} % measured{uncertainty}; left out: {points} % of the points as steep, \
         of the area {steep} % steep and {off} % off the surface{open}"
    )
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
            statistics: None,
        };
        let wanted = "\nRegion \"bo\\nre\": fail, 90.00 % measured, U 0.250 mm (k = 2); left out: 25.00 % of the points as steep, of the area 5.00 % steep and \
                      3.00 % off";
        let told = region_words(&region);
        assert!(told.contains(wanted) && told.ends_with("off the surface"), "{told}");
        let open = RegionDeviationDocument { verdict: Some(Conformity::Undecided), is_open_by_poses: true, ..region };
        let told = region_words(&open);
        assert!(told.contains("off the surface. U is mostly due to the poses of the views (± 0.240 mm): calibrate"), "{told}");
    }
}
