//! The result of an inspection, schema `vantage.inspection/1`.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::alignment::AlignmentDocument;
use super::coverage::{LossDocument, MeasuredCoverageDocument, loss_phrase};
use super::deviation::{DeviationDocument, StatisticsDocument};
use super::files::{IngestFindingDocument, TakenScanDocument};
use super::learned::OfferedChangeDocument;
use super::order::InspectionSummary;
use super::rescan::RescanState;
use super::verdicts::{VerdictCounts, material_sentences, verdicts_sentence};
use crate::cell::FieldError;
use crate::geometry::Mesh;
use crate::inspection::ingest::Ingested;
use crate::inspection::losses::LossCause;
use crate::inspection::registration::PartNotFound;
use crate::inspection::{Inspection, InspectionParams};
use crate::wire::schema_name::schema_name;
use crate::wire::total::total;
use crate::wire::words::{counted, fixed, percent};

/// Refused files of one code that are listed, each with a sentence.
const MAX_REFUSALS: usize = 8;
/// Schema name in the document.
pub const INSPECTION_SCHEMA: &str = "vantage.inspection/1";

schema_name!(InspectionSchema, INSPECTION_SCHEMA);

/// Result of an inspection: the poses of the scans, what they measured compared with the plan, why the rest is missing, and how
/// the surface deviates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct InspectionDocument {
    /// Schema name, `vantage.inspection/1`.
    #[schema(value_type = InspectionSchema)]
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: String,
    /// Sentences for people: features by verdict, material missing or extra, planned and measured coverage, the largest losses, the
    /// deviation.
    pub verdict: String,
    /// Parameters.
    pub params: InspectionParams,
    /// Scans that were read.
    pub scans: Vec<TakenScanDocument>,
    /// Findings about files and views.
    pub findings: Vec<IngestFindingDocument>,
    /// Registered poses of the scans.
    pub alignment: AlignmentDocument,
    /// Measured coverage, compared with the planned one.
    pub coverage: MeasuredCoverageDocument,
    /// Planned area that is not measured, by cause, largest first.
    pub losses: Vec<LossDocument>,
    /// Deviation of the surface.
    pub deviation: DeviationDocument,
    /// Changes to the scanner's specification or to parameters that the scans suggest; none is applied automatically.
    pub offers: Vec<OfferedChangeDocument>,
}

/// Scans and findings of the files of an inspection.
#[derive(Clone, Debug, PartialEq)]
pub struct InspectedFiles {
    /// Scans that were read.
    pub scans: Vec<TakenScanDocument>,
    /// Findings about files and views.
    pub findings: Vec<IngestFindingDocument>,
}

impl InspectedFiles {
    /// Documents of what was taken in.
    #[must_use]
    pub fn new(taken: &Ingested) -> Self {
        Self {
            scans: taken.scans.iter().map(TakenScanDocument::from).collect(),
            findings: taken.findings.iter().map(IngestFindingDocument::from).collect(),
        }
    }

    /// Reasons why files were refused, each at the scans: the first eight of each code, and the number of files that are not listed.
    #[must_use]
    pub fn refusals(&self) -> Vec<FieldError> {
        let at_scans = |detail: String| FieldError { pointer: "/scans".to_owned(), detail };
        let mut refusals = Vec::new();
        // The first finding of each code, and the number of all.
        let mut codes: Vec<(&IngestFindingDocument, usize)> = Vec::new();
        for finding in self.findings.iter().filter(|finding| finding.code.is_refusal()) {
            let known = codes.iter().position(|(first, _)| first.code == finding.code);
            let place = known.unwrap_or(codes.len());
            if known.is_none() {
                codes.push((finding, 0));
            }
            codes[place].1 += 1;
            if codes[place].1 <= MAX_REFUSALS {
                refusals.push(at_scans(finding.detail.clone()));
            }
        }
        for (first, count) in codes.into_iter().filter(|(_, count)| *count > MAX_REFUSALS) {
            let more = counted(count - MAX_REFUSALS, "more file");
            let first = first.file.as_deref().unwrap_or("the files above");
            refusals.push(at_scans(format!("not listed: {more}, refused for the same reason as {first}")));
        }
        refusals
    }
}

impl InspectionDocument {
    /// Document of an inspection of the part with this mesh, whose state afterwards is `state`; the plan's file has this SHA-256.
    #[must_use]
    pub fn new(
        inspection: &Inspection,
        files: &InspectedFiles,
        params: &InspectionParams,
        mesh: &Mesh,
        (plan_sha256, state): (&str, &RescanState),
    ) -> Self {
        let in_all_mm2 = state.measured().map_or(inspection.coverage.measured_mm2, |measured| {
            let counts = |sample: &crate::planning::ids::SampleId| inspection.surface.asked[sample.index()];
            total(measured.iter().filter(counts).map(|sample| inspection.surface.sample_area_mm2(sample)))
        });
        let mut document = Self {
            schema: INSPECTION_SCHEMA.to_owned(),
            plan_sha256: plan_sha256.to_owned(),
            verdict: String::new(),
            params: params.clone(),
            scans: files.scans.clone(),
            findings: files.findings.clone(),
            alignment: AlignmentDocument::new(params.align.method, inspection, &mesh.aabb().centre()),
            coverage: MeasuredCoverageDocument::new(&inspection.coverage, in_all_mm2),
            losses: LossDocument::all(&inspection.losses, inspection.coverage.asked_mm2),
            deviation: DeviationDocument::new(inspection),
            offers: inspection.offer.changes.iter().map(OfferedChangeDocument::from).collect(),
        };
        document.verdict = verdict_sentence(&document);
        document
    }

    /// Share of the asked area that was lost for a cause.
    #[must_use]
    pub fn lost_of_asked(&self, cause: LossCause) -> f64 {
        total(self.losses.iter().filter(|loss| loss.cause == cause).map(|loss| loss.of_asked))
    }

    /// Figures for a list.
    #[must_use]
    pub fn summary(&self) -> InspectionSummary {
        InspectionSummary {
            planned_of_asked: self.coverage.planned_of_asked,
            measured_of_asked: self.coverage.measured_of_asked,
            measured_in_all_of_asked: self.coverage.measured_in_all_of_asked,
            unexplained_of_asked: self.lost_of_asked(LossCause::Unexplained),
            deviation_rms_mm: self.statistics_of_found().map(|statistics| statistics.rms_mm),
            not_found: self.alignment.why_not_found(),
            verdicts: self.verdict_counts(),
        }
    }

    /// Numbers of features by their verdict; `None` where none has one, or the part was not found.
    #[must_use]
    pub fn verdict_counts(&self) -> Option<VerdictCounts> {
        VerdictCounts::of(&self.deviation.regions).filter(|_| self.alignment.why_not_found().is_none())
    }

    /// Statistics of the deviation; `None` where nothing was measured, or the part was not found: no deviation is told of it then.
    fn statistics_of_found(&self) -> Option<&StatisticsDocument> {
        self.deviation.statistics.as_ref().filter(|_| self.alignment.why_not_found().is_none())
    }
}

/// Sentences on a result: which features fail, what is missing or extra, what was planned and measured, and where the difference is
/// lost.
fn verdict_sentence(document: &InspectionDocument) -> String {
    let coverage = &document.coverage;
    let mut first = Vec::new();
    match document.alignment.why_not_found() {
        Some(PartNotFound::FewInliers) => {
            first.push("The scans do not fit the part: the figures say nothing about it.".to_owned());
        }
        Some(PartNotFound::FewPoints) => {}
        None => {
            first.extend(document.alignment.unregistered_sentence().filter(|_| !document.coverage.approximate));
            first.extend(verdicts_sentence(&document.deviation.regions));
            first.extend(material_sentences(&document.deviation, document.params.compare.search_mm));
        }
    }
    first.push(coverage_sentence(document));
    let mut text = first.join(" ");
    let named: Vec<String> =
        document.losses.iter().take(3).map(|loss| format!("{} {}", percent(loss.of_asked), loss_phrase(loss.cause))).collect();
    if !named.is_empty() {
        text += &format!(" Planned but not measured: {} ({})", percent(coverage.lost_of_asked), named.join(", "));
        text += if document.losses.len() > named.len() { ", and smaller losses." } else { "." };
    }
    if coverage.gained_of_asked > 0.0 {
        text += &format!(" Measured but not planned: {}.", percent(coverage.gained_of_asked));
    }
    if coverage.measured_in_all_of_asked > coverage.measured_of_asked + 1e-9 {
        text += &format!(
            " Including the scans of earlier rounds, {} of the asked area is measured.",
            percent(coverage.measured_in_all_of_asked)
        );
    }
    if coverage.approximate {
        text += " The cloud merges several views: these figures are known to about one percentage point.";
    }
    if let Some(figures) = document.statistics_of_found() {
        text += &format!(" {}", deviation_sentence(figures));
    }
    text
}

/// Sentence on the measured and the planned area. Coverage counts what lies within the tolerance of the comparison: where the part was
/// found, surface that was seen and deviates by more is told beside it.
fn coverage_sentence(document: &InspectionDocument) -> String {
    let coverage = &document.coverage;
    let [measured, planned] = [coverage.measured_of_asked, coverage.planned_of_asked].map(percent);
    let deviates = document.lost_of_asked(LossCause::PartDeviates);
    if deviates > 0.0 && document.alignment.why_not_found().is_none() {
        let (tolerance_mm, deviates) = (document.params.compare.tolerance_mm, percent(deviates));
        return format!(
            "The scans measure {measured} of the asked area within {tolerance_mm} mm (compare.tolerance_mm) of nominal; a \
             further {deviates} is seen but deviates by more. {planned} was planned."
        );
    }
    format!("The scans measure {measured} of the asked area; {planned} was planned.")
}

/// Sentence on how the surface deviates.
fn deviation_sentence(figures: &StatisticsDocument) -> String {
    let [mean, rms, p1, p99] = [figures.mean_mm, figures.rms_mm, figures.p1_mm, figures.p99_mm].map(|mm| fixed(mm, 3));
    format!("The surface deviates by {mean} mm on average and {rms} mm rms; 98 % of it lies between {p1} and {p99} mm.")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::cell::PoseSpec;
    use crate::inspection::deviation::DeviationStatistics;
    use crate::inspection::ingest::IngestCode;

    /// Every refused file was told with a sentence of its own, which of hundreds hid what they have in common.
    #[test]
    fn refused_files_are_listed_up_to_eight_of_each_code_with_the_number_of_the_others() {
        let finding = |code: IngestCode, number: u32| IngestFindingDocument {
            code,
            file: Some(format!("view_{number}.ply")),
            viewpoint: Some(number),
            detail: format!("sentence {number}"),
        };
        let refusals = |of_part: u32| {
            let missed = (0..of_part).map(|number| finding(IngestCode::NoPart, number));
            let others = [100, 101].map(|number| finding(IngestCode::OtherPlan, number));
            let notes = [finding(IngestCode::SparseCloud, 200)];
            let findings = missed.chain(others).chain(notes).collect();
            let told = InspectedFiles { scans: Vec::new(), findings }.refusals();
            assert!(told.iter().all(|error| error.pointer == "/scans"), "{told:?}");
            told.into_iter().map(|error| error.detail).collect::<Vec<_>>()
        };
        let few = refusals(8);
        assert_eq!((few.len(), few[7].as_str(), few[9].as_str()), (10, "sentence 7", "sentence 101"));
        let many = refusals(300);
        assert_eq!((many.len(), many[7].as_str(), many[8].as_str()), (11, "sentence 7", "sentence 100"));
        assert_eq!(many[10], "not listed: 292 more files, refused for the same reason as view_0.ply");
    }

    fn statistics() -> StatisticsDocument {
        StatisticsDocument::from(&DeviationStatistics {
            area_mm2: 100.0,
            mean_mm: -0.000_2,
            rms_mm: 0.012_3,
            percentiles_mm: [-0.031, -0.02, -0.0, 0.02, 0.03],
            max_mm: 0.05,
            in_tolerance: Some(std::iter::empty::<f64>().sum()),
        })
    }

    /// Document of an inspection of one view with these points, of which such a share lies on the part, and with figures of a deviation.
    fn document(points: usize, inlier_share: f64, kept_pose: Option<&str>) -> InspectionDocument {
        let pose = json!(PoseSpec::default());
        let view = json!({
            "viewpoint": 1, "points": points, "inlier_share": inlier_share, "rms_mm": 0.1, "turned_deg": 0.0, "shifted_mm": 0.0,
            "kept_pose": kept_pose,
        });
        let alignment = json!({
            "method": "best_fit", "mesh_from_stated": pose, "part_turned_deg": 0.0, "part_shifted_mm": 0.0,
            "part_sd": {"rotation_deg": 0.1, "translation_mm": 0.1}, "noise_mm": 0.01, "inlier_share": inlier_share,
            "views": [view],
        });
        let coverage = json!({
            "asked_area_mm2": 100.0, "planned_of_asked": 0.9, "measured_of_asked": 0.8, "measured_in_all_of_asked": 0.8,
            "measured_of_coverable": null, "both_of_asked": 0.8, "lost_of_asked": 0.0, "gained_of_asked": 0.0,
            "neither_of_asked": 0.1, "lost_near_limit_of_asked": 0.0, "gained_near_limit_of_asked": 0.0, "approximate": false,
            "by_view": [],
        });
        let extent = json!({"nominal_mm": 10.0, "measured_mm": null});
        let deviation = json!({
            "alignment": "best_fit", "mesh_from_placed": pose, "fixed_freedoms": 6, "compared_points": points,
            "statistics": statistics(), "histogram": {"begin_mm": -1.0, "width_mm": 1.0, "area_mm2": []},
            "extents": [extent, extent, extent], "regions": [], "worst": [], "off_surface": [],
        });
        let document = json!({
            "schema": INSPECTION_SCHEMA, "plan_sha256": "", "verdict": "", "params": {}, "scans": [], "findings": [],
            "alignment": alignment, "coverage": coverage, "losses": [], "deviation": deviation, "offers": [],
        });
        serde_json::from_value(document).expect("a document")
    }

    /// −0.000 mm was told, and −0.0 written for a share of nothing.
    #[test]
    fn no_deviation_has_no_sign() {
        let document = statistics();
        let told = "The surface deviates by 0.000 mm on average and 0.012 mm rms; 98 % of it lies between -0.031 and 0.030 mm.";
        assert_eq!(deviation_sentence(&document), told);
        assert!([document.p50_mm, document.in_tolerance.expect("a tolerance")].iter().all(|value| value.is_sign_positive()));
    }

    #[test]
    fn views_that_could_not_be_registered_are_told_first() {
        let doubtful = verdict_sentence(&document(3000, 0.95, Some("pose_out_of_prior")));
        assert!(doubtful.starts_with("1 of 1 view could not be registered, and may be off"), "{doubtful}");
        for known in [None, Some("few_points")] {
            assert!(!verdict_sentence(&document(3000, 0.95, known)).contains("registered"));
        }
    }

    /// Figures at a place that nothing held were told as the deviation of the surface.
    #[test]
    fn no_deviation_is_told_of_a_part_that_was_not_found() {
        let found = document(3000, 0.95, None);
        assert!(verdict_sentence(&found).contains("The surface deviates by"), "{}", verdict_sentence(&found));
        for lost in [document(3000, 0.373, Some("few_inliers")), document(120, 1.0, Some("few_points"))] {
            let told = verdict_sentence(&lost);
            assert!(told.ends_with("90.00 % was planned."), "{told}");
        }
    }

    #[test]
    fn a_list_tells_that_the_part_was_not_found_in_place_of_its_deviation() {
        let of_list = |document: &InspectionDocument| {
            let summary = json!(document.summary());
            (summary["deviation_rms_mm"].clone(), summary["not_found"].clone())
        };
        assert_eq!(of_list(&document(3000, 0.95, None)), (json!(0.012_3), json!(null)));
        assert_eq!(of_list(&document(3000, 0.373, Some("few_inliers"))), (json!(null), json!("few_inliers")));
        assert_eq!(of_list(&document(120, 1.0, Some("few_points"))), (json!(null), json!("few_points")));
    }

    #[test]
    fn a_summary_of_an_earlier_release_is_read() {
        let earlier = json!({
            "planned_of_asked": 0.9, "measured_of_asked": 0.8, "measured_in_all_of_asked": 0.8, "unexplained_of_asked": 0.0,
            "deviation_rms_mm": 0.012,
        });
        let summary: InspectionSummary = serde_json::from_value(earlier).expect("a summary");
        assert_eq!((summary.deviation_rms_mm, summary.not_found, summary.verdicts), (Some(0.012), None, None));
    }

    /// A document with a feature that fails, a spot that deviates, and surface lost because it does.
    fn with_a_fail(inlier_share: f64, kept_pose: Option<&str>) -> InspectionDocument {
        let mut document = json!(document(3000, inlier_share, kept_pose));
        document["deviation"]["regions"] = json!([{
            "name": "step", "tolerance_mm": 0.3, "measured": 0.99, "verdict": "fail", "expanded_uncertainty_mm": 0.0226,
            "statistics": statistics(),
        }]);
        document["deviation"]["worst"] =
            json!([{"kind": "extra", "centre_mm": [80.0, 22.5, 45.0], "area_mm2": 76.5, "mean_mm": 0.2, "max_mm": 0.249}]);
        document["losses"] = json!([{
            "cause": "part_deviates", "detail": "", "area_mm2": 12.6, "of_asked": 0.126, "spots": 1, "largest": [],
        }]);
        serde_json::from_value(document).expect("a document")
    }

    /// The result, its list and the report's head told coverage alone of a part that fails.
    #[test]
    fn a_feature_that_fails_comes_first_and_is_counted_in_lists() {
        let document = with_a_fail(0.95, None);
        let told = verdict_sentence(&document);
        let begin = "1 of 1 feature fails (step: largest 0.050 mm, U 0.023 mm (k = 2)). Beyond 0.1 mm plus the points' own uncertainty, without that of the poses: ";
        assert!(told.starts_with(begin), "{told}");
        assert_eq!(json!(document.summary())["verdicts"], json!({"fail": 1, "pass": 0, "undecided": 0}));
        let lost = with_a_fail(0.373, Some("few_inliers"));
        let told = verdict_sentence(&lost);
        assert!(told.starts_with("The scans do not fit the part") && !told.contains("fails"), "{told}");
        assert_eq!(lost.summary().verdicts, None);
    }

    /// 78.44 % were told as measured beside a region that is measured to 100 %: what deviates was seen, and is not counted.
    #[test]
    fn measured_area_is_told_with_its_tolerance_and_what_is_seen_beyond() {
        let told = verdict_sentence(&with_a_fail(0.95, None));
        let wanted = "The scans measure 80.00 % of the asked area within 0.15 mm (compare.tolerance_mm) of nominal; a further \
                      12.60 % is seen but deviates by more. 90.00 % was planned.";
        assert!(told.contains(wanted), "{told}");
        let lost = verdict_sentence(&with_a_fail(0.373, Some("few_inliers")));
        assert!(lost.contains("The scans measure 80.00 % of the asked area; 90.00 % was planned."), "{lost}");
    }
}
