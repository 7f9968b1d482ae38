//! Documents of how the surface deviates.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::PoseSpec;
use crate::inspection::coverage::CompareParams;
use crate::inspection::deviation::align::HELD_TO_MM;
use crate::inspection::deviation::{
    Alignment, Conformity, DeviationOptions, DeviationSpot, DeviationStatistics, ExcludedShares, Extent, MAX_TURN_DEG,
    MIN_TO_FAIL, MaterialKind, OffSurface, OpenPart, RegionDeviation, UndecidedBecause,
};
use crate::inspection::{DeviationFigures, Inspection};
use crate::wire::words::{area_mm2, counted, fixed, limits_mm, percent, percent_below};

/// Deviation of the surface from its model. Distances are along the outward normal: above 0 is more material than nominal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviationDocument {
    /// Alignment at which the surface is compared.
    pub alignment: Alignment,
    /// Transform from part coordinates, as the registered scans give them, to mesh coordinates: the alignment beyond the
    /// registration.
    pub mesh_from_placed: PoseSpec,
    /// Degrees of freedom that the measured surface constrains, of 6.
    pub fixed_freedoms: usize,
    /// Number of points compared; those of a merged cloud count once for each view that shows them.
    pub compared_points: u64,
    /// Number of points near the surface that were left out because what they show is tilted by more than 30° from the model.
    /// They are counted as `compared_points` are.
    #[serde(default)]
    pub turned_points: u64,
    /// Shares of the whole part that the figures leave out.
    #[serde(default)]
    pub excluded: ExcludedSharesDocument,
    /// Statistics of the whole part; `null` where nothing was measured.
    pub statistics: Option<StatisticsDocument>,
    /// Histogram of the whole part, by area.
    pub histogram: HistogramDocument,
    /// Extents along x, y and z of the part.
    #[schema(min_items = 3, max_items = 3)]
    pub extents: [ExtentDocument; 3],
    /// Regions of interest and features of the plan.
    pub regions: Vec<RegionDeviationDocument>,
    /// Spots that deviate most, largest deviation first.
    pub worst: Vec<DeviationSpotDocument>,
    /// Clusters of points off the surface: missing or extra material, or a body that the model does not have.
    pub off_surface: Vec<OffSurfaceDocument>,
}

/// Statistics by area.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatisticsDocument {
    /// Area measured.
    pub area_mm2: f64,
    /// Mean deviation.
    pub mean_mm: f64,
    /// Root mean square deviation.
    pub rms_mm: f64,
    /// 1st percentile.
    pub p1_mm: f64,
    /// 5th percentile.
    pub p5_mm: f64,
    /// Median deviation.
    pub p50_mm: f64,
    /// 95th percentile.
    pub p95_mm: f64,
    /// 99th percentile.
    pub p99_mm: f64,
    /// Deviation farthest from zero, with its sign.
    pub max_mm: f64,
    /// Share of the measured area within the tolerance zone; `null` without a tolerance.
    pub in_tolerance: Option<f64>,
}

/// Shares that the figures leave out. Surface beyond the search distance keeps a region from passing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ExcludedSharesDocument {
    /// Share of the points near the surface that were left out because what they show is tilted by more than 30° from the model.
    pub turned_of_points: f64,
    /// Share of the area that has only such points, so that none of it is compared.
    pub turned_of_area: f64,
    /// Share of the area where most points lie beyond the search distance, in front of the surface or behind it. Material may be
    /// missing or extra there, or the points are those of another body: a larger `compare.search_mm` lets it be judged.
    pub off_of_area: f64,
}

/// Area by deviation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistogramDocument {
    /// Deviation at which the first bin begins.
    pub begin_mm: f64,
    /// Width of a bin.
    pub width_mm: f64,
    /// Area of each bin; the first and the last include everything beyond.
    pub area_mm2: Vec<f64>,
}

/// Extent along one axis of the part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ExtentDocument {
    /// Extent of the mesh.
    pub nominal_mm: f64,
    /// Extent as measured; `null` where an end was not measured.
    pub measured_mm: Option<f64>,
    /// Upper bound of the expanded uncertainty of that (k = 2): the sum of both ends', which may be off to either side; `null` likewise,
    /// and in results of releases that did not tell it.
    #[serde(default)]
    pub max_expanded_uncertainty_mm: Option<f64>,
}

/// Deviation of a region of interest or a feature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegionDeviationDocument {
    /// Name of the region or feature.
    pub name: String,
    /// Width of the tolerance zone, from limit to limit: 0.3 for ±0.15 mm in a drawing; `null` without one.
    pub tolerance_mm: Option<f64>,
    /// Share of its asked area that is measured.
    pub measured: f64,
    /// Shares of the region that its statistics leave out.
    #[serde(default)]
    pub excluded: ExcludedSharesDocument,
    /// Verdict on the profile (ISO 1101) according to ISO 14253-1; `null` without a tolerance.
    pub verdict: Option<Conformity>,
    /// Median of the expanded uncertainty, k = 2; `null` where nothing is measured.
    pub expanded_uncertainty_mm: Option<f64>,
    /// Median of the share of that uncertainty that is due to the poses and the alignment; `null` where nothing is measured.
    #[serde(default)]
    pub pose_uncertainty_mm: Option<f64>,
    /// True if the uncertainty of poses and alignment alone keeps the region from passing.
    #[serde(default)]
    pub is_open_by_poses: bool,
    /// Surface that keeps an undecided region from passing; `null` where there is none, and in inspections of earlier releases.
    #[serde(default)]
    pub open: Option<OpenPartDocument>,
    /// Reason why a region with samples that fail is undecided; `null` elsewhere, and in inspections of earlier releases.
    #[serde(default)]
    pub undecided_because: Option<UndecidedBecause>,
    /// Number of its samples that are measured; `null` in inspections of earlier releases.
    #[serde(default)]
    pub measured_samples: Option<usize>,
    /// Share of its area that is shown to conform; `null` without a tolerance, and in inspections of earlier releases.
    #[serde(default)]
    pub conforming: Option<f64>,
    /// Statistics; `null` where nothing is measured.
    pub statistics: Option<StatisticsDocument>,
}

/// Surface of an undecided region that keeps it from passing: it deviates beyond the limit, may do so by its uncertainty, or lies
/// farther off than the search distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OpenPartDocument {
    /// Area of this surface.
    pub area_mm2: f64,
    /// Point of it that may lie farthest off, part frame.
    pub at_mm: [f64; 3],
    /// Deviation at that point; `null` where the points lie beyond the search distance.
    pub deviation_mm: Option<f64>,
    /// Expanded uncertainty at that point, k = 2; `null` where the points lie beyond the search distance.
    pub expanded_uncertainty_mm: Option<f64>,
    /// Share of that uncertainty that is due to the poses and the alignment; `null` where the points lie beyond the search distance,
    /// and in inspections of earlier releases.
    #[serde(default)]
    pub pose_uncertainty_mm: Option<f64>,
}

/// A spot that deviates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviationSpotDocument {
    /// Missing or extra material.
    pub kind: MaterialKind,
    /// Centre of the spot, part frame.
    pub centre_mm: [f64; 3],
    /// Area of the spot.
    pub area_mm2: f64,
    /// Mean deviation.
    pub mean_mm: f64,
    /// Deviation farthest from zero, with its sign.
    pub max_mm: f64,
}

/// Points off the surface that lie together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OffSurfaceDocument {
    /// Missing or extra material.
    pub kind: MaterialKind,
    /// Centre of the points, part frame.
    pub centre_mm: [f64; 3],
    /// Number of points.
    pub points: usize,
    /// Mean distance from the surface.
    pub mean_mm: f64,
}

impl From<&DeviationStatistics> for StatisticsDocument {
    fn from(figures: &DeviationStatistics) -> Self {
        // Adding 0 turns −0, such as the sum of nothing, into 0.
        let [p1_mm, p5_mm, p50_mm, p95_mm, p99_mm] = figures.percentiles_mm.map(|mm| mm + 0.0);
        Self {
            area_mm2: figures.area_mm2,
            mean_mm: figures.mean_mm,
            rms_mm: figures.rms_mm,
            p1_mm,
            p5_mm,
            p50_mm,
            p95_mm,
            p99_mm,
            max_mm: figures.max_mm,
            in_tolerance: figures.in_tolerance.map(|share| share + 0.0),
        }
    }
}

impl From<&ExcludedShares> for ExcludedSharesDocument {
    fn from(shares: &ExcludedShares) -> Self {
        let ExcludedShares { turned_of_points, turned_of_area, off_of_area } = *shares;
        Self { turned_of_points, turned_of_area, off_of_area }
    }
}

impl From<&RegionDeviation> for RegionDeviationDocument {
    fn from(region: &RegionDeviation) -> Self {
        Self {
            name: region.name.clone(),
            tolerance_mm: region.tolerance_mm,
            measured: region.measured,
            excluded: ExcludedSharesDocument::from(&region.excluded),
            verdict: region.verdict,
            expanded_uncertainty_mm: region.expanded_mm,
            pose_uncertainty_mm: region.of_poses_mm,
            is_open_by_poses: region.is_open_by_poses,
            open: region.open.filter(|_| region.verdict == Some(Conformity::Undecided)).map(OpenPartDocument::from),
            undecided_because: region.undecided_because,
            measured_samples: Some(region.measured_samples),
            conforming: region.conforming,
            statistics: region.statistics.as_ref().map(StatisticsDocument::from),
        }
    }
}

impl From<OpenPart> for OpenPartDocument {
    fn from(part: OpenPart) -> Self {
        let [deviation_mm, expanded_uncertainty_mm] = [0, 1].map(|place| part.deviation_mm.map(|figures| figures[place]));
        Self {
            area_mm2: part.area_mm2,
            at_mm: part.at_mm.coords.into(),
            deviation_mm,
            expanded_uncertainty_mm,
            pose_uncertainty_mm: part.of_poses_mm,
        }
    }
}

impl From<&DeviationSpot> for DeviationSpotDocument {
    fn from(spot: &DeviationSpot) -> Self {
        Self {
            kind: spot.kind,
            centre_mm: spot.centre_mm.coords.into(),
            area_mm2: spot.area_mm2,
            mean_mm: spot.mean_mm,
            max_mm: spot.worst_mm,
        }
    }
}

impl From<&OffSurface> for OffSurfaceDocument {
    fn from(heap: &OffSurface) -> Self {
        Self { kind: heap.kind, centre_mm: heap.centre_mm.coords.into(), points: heap.points, mean_mm: heap.mean_mm }
    }
}

impl DeviationDocument {
    /// Document of an inspection's deviation.
    #[must_use]
    pub fn new(inspection: &Inspection) -> Self {
        let (aligned, figures): (_, &DeviationFigures) = (&inspection.deviation, &inspection.figures);
        let extent = |extent: Extent| ExtentDocument {
            nominal_mm: extent.nominal_mm,
            measured_mm: extent.measured_mm,
            max_expanded_uncertainty_mm: extent.max_expanded_mm,
        };
        Self {
            alignment: aligned.alignment,
            mesh_from_placed: PoseSpec::from(&aligned.mesh_from_placed),
            fixed_freedoms: aligned.fixed_freedoms,
            compared_points: aligned.deviation.compared_points,
            turned_points: aligned.deviation.turned_points,
            excluded: ExcludedSharesDocument::from(&figures.excluded),
            statistics: figures.whole.as_ref().map(StatisticsDocument::from),
            histogram: HistogramDocument {
                begin_mm: figures.histogram.begin_mm,
                width_mm: figures.histogram.width_mm,
                area_mm2: figures.histogram.area_mm2.clone(),
            },
            extents: figures.extents.map(extent),
            regions: figures.regions.iter().map(RegionDeviationDocument::from).collect(),
            worst: figures.worst.iter().map(DeviationSpotDocument::from).collect(),
            off_surface: aligned.deviation.off_surface.iter().map(OffSurfaceDocument::from).collect(),
        }
    }
}

/// Min part of an expanded uncertainty, whose square is half, from which on it is said to be mostly due to poses.
const MIN_OF_POSES: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Sentence for a region that only what poses leave open keeps from passing: how large that is, and the remedy.
fn open_poses_sentence(region: &RegionDeviationDocument) -> Option<String> {
    // At the place that keeps it from passing: the median of a region says nothing of a few samples.
    let of_place = region.open.as_ref().and_then(|open| open.pose_uncertainty_mm);
    let open_mm = of_place.or(region.pose_uncertainty_mm).filter(|_| region.is_open_by_poses)?;
    // Their part of U at that place may be small, and still be what is too much there.
    let is_most =
        region.open.as_ref().and_then(|open| open.expanded_uncertainty_mm).is_none_or(|mm| open_mm >= MIN_OF_POSES * mm);
    let which =
        if is_most { "U is mostly due to the" } else { "Points alone would let it pass, without what is left open by the" };
    Some(format!(
        "{which} poses of the views (± {open_mm:.3} mm): calibrate the cell, or state how well its poses are \
         known (align.prior_mm); otherwise a step, hole or rib that views from both sides see has to tie them together."
    ))
}

/// Sentence on the sign of deviations.
pub const SIGN_SENTENCE: &str = "Deviations are along the outward normal: above 0 is more material than nominal.";

/// Sentence on the measured share of a region, which is of another distance than the coverage.
#[must_use]
pub fn measured_region_sentence(compare: &CompareParams) -> String {
    let CompareParams { search_mm, tolerance_mm, .. } = compare;
    format!(
        "Regions count as measured where points lie within the search distance of {search_mm} mm (compare.search_mm) of nominal; \
         coverage and losses count points within {tolerance_mm} mm (compare.tolerance_mm)."
    )
}

/// Sentence on what a fit to all surface does with a large deviation, where a region fails in one.
#[must_use]
pub fn best_fit_sentence(deviation: &DeviationDocument) -> Option<&'static str> {
    let has_failed = || deviation.regions.iter().any(|region| region.verdict == Some(Conformity::Fail));
    (deviation.alignment == Alignment::BestFit && has_failed()).then_some(
        "A best fit shares a large deviation with the surface that faces the same way. To judge features from a datum, compare with \
         align.method=best_fit_on and align.region set to that datum.",
    )
}

/// Sentences for a region that is undecided: the reason for which samples that fail do not decide, the place that keeps it from passing,
/// with what the poses have to do with it, or the area that is missing for a pass; `None` for another verdict, or where none of them is known.
#[must_use]
pub fn undecided_sentences(region: &RegionDeviationDocument) -> Option<String> {
    if region.verdict != Some(Conformity::Undecided) {
        return None;
    }
    let of_fails = region.undecided_because.map(|because| because_sentence(region, because));
    // Where the part is not held, the surface there may be another one.
    let is_held = region.undecided_because != Some(UndecidedBecause::NotHeld);
    let limit_mm = 0.5 * region.tolerance_mm.unwrap_or_default();
    let of_place = region.open.as_ref().filter(|_| is_held).map(|part| open_part_sentence(part, limit_mm));
    let of_poses = open_poses_sentence(region);
    let of_area = area_sentence(region, of_fails.is_some() || of_place.is_some() || of_poses.is_some());
    let told: Vec<String> = [of_fails, of_place, of_poses, of_area].into_iter().flatten().collect();
    (!told.is_empty()).then(|| told.join(" "))
}

/// Sentence on the area that is missing for a pass: it is not measured or, unless another reason is told, not shown to conform.
fn area_sentence(region: &RegionDeviationDocument, has_reason: bool) -> Option<String> {
    let min_measured = DeviationOptions::default().min_measured;
    let least = 100.0 * min_measured;
    if region.measured < min_measured {
        let share = percent_below(region.measured, min_measured, 2);
        return Some(format!("Only {share} % of it is measured; at least {least:.0} % of it has to conform."));
    }
    let conforming = region.conforming.filter(|share| !has_reason && *share < min_measured)?;
    let share = percent_below(conforming, min_measured, 2);
    Some(format!(
        "Only {share} % of it is shown to conform; at least {least:.0} % of it has to: the rest has too few points, or mostly \
         steep ones."
    ))
}

/// Sentence on the reason for which a region with samples that fail does not fail.
fn because_sentence(region: &RegionDeviationDocument, because: UndecidedBecause) -> String {
    match because {
        UndecidedBecause::NotHeld => {
            let held_to_mm = region.tolerance_mm.unwrap_or_default().max(HELD_TO_MM);
            format!(
                "The accepted scans do not hold the part along this surface to {held_to_mm} mm: scan walls that face the same \
                 way, or align as placed (align.method = as_placed)."
            )
        }
        UndecidedBecause::NotRegistered => {
            "Samples fail, but by points of views whose poses could not be registered and may be off by more than is stated: calibrate, or \
             scan again."
                .to_owned()
        }
        UndecidedBecause::FewSamples if region.measured_samples == Some(1) => {
            "Only 1 sample is measured: one alone does not make a region fail.".to_owned()
        }
        UndecidedBecause::FewSamples => {
            let measured = region.measured_samples.map_or_else(|| "a few samples".to_owned(), |count| counted(count, "sample"));
            format!(
                "Only {measured} are measured: a region fails where at least {MIN_TO_FAIL} are, or where nearly all of a \
                 smaller one is measured and all of it fails."
            )
        }
        UndecidedBecause::WithinNoise => "Samples fail, but no more of them than noise explains.".to_owned(),
    }
}

/// Sentence on the surface that keeps a region from passing, which has this limit.
fn open_part_sentence(part: &OpenPartDocument, limit_mm: f64) -> String {
    let (area, at) = (area_mm2(part.area_mm2), place(part.at_mm));
    let limits = limits_mm(2.0 * limit_mm);
    match (part.deviation_mm, part.expanded_uncertainty_mm) {
        (Some(deviation_mm), Some(expanded_mm)) => {
            let lies = if deviation_mm.abs() - expanded_mm > limit_mm { "lies or may lie" } else { "may lie" };
            let [deviation, expanded] = [deviation_mm, expanded_mm].map(|mm| fixed(mm, 3));
            format!("{area} mm² of it {lies} beyond {limits} mm, farthest at {at}: {deviation} mm, U {expanded} mm (k = 2).")
        }
        _ => format!("{area} mm² of it may lie beyond {limits} mm, farthest at {at}: beyond the search distance."),
    }
}

/// Words for a place in the part frame.
pub(super) fn place(at_mm: [f64; 3]) -> String {
    let [x, y, z] = at_mm.map(|mm| fixed(mm, 1));
    format!("({x}, {y}, {z}) mm")
}

/// Sentences on the points that were compared and those that were left out.
#[must_use]
pub fn excluded_sentence(deviation: &DeviationDocument) -> String {
    let ExcludedSharesDocument { turned_of_area, off_of_area, .. } = deviation.excluded;
    let (compared, turned) = (deviation.compared_points, deviation.turned_points);
    let of_points = turned as f64 / ((compared + turned) as f64).max(1.0);
    let what_to_do = if off_of_area > 0.0 { OFF_REMEDY } else { "" };
    format!(
        "{compared} points are compared; {turned}, {}, are left out as steep: the surface that they show is tilted by more than \
         {MAX_TURN_DEG:.0}° from the model. {} of the area has only such points, and {} has points beyond the search distance, \
         because of missing or extra material or another body.{what_to_do}",
        percent(of_points),
        percent(turned_of_area),
        percent(off_of_area)
    )
}

/// Sentence for area beyond the search distance: how it is judged.
const OFF_REMEDY: &str = " Such area keeps a region from passing: raise compare.search_mm so that it is judged.";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_are_left_out_are_told_in_numbers_and_words() {
        let excluded = ExcludedShares { turned_of_points: 0.25, turned_of_area: 0.125, off_of_area: 0.0625 };
        let region = RegionDeviation {
            name: "top".into(),
            tolerance_mm: Some(0.1),
            measured: 0.5,
            excluded,
            statistics: None,
            verdict: None,
            expanded_mm: Some(0.25),
            of_poses_mm: Some(0.24),
            is_open_by_poses: true,
            open: None,
            measured_samples: 90,
            conforming: None,
            undecided_because: None,
        };
        let told = serde_json::to_value(RegionDeviationDocument::from(&region)).expect("JSON");
        let shares = serde_json::json!({"turned_of_points": 0.25, "turned_of_area": 0.125, "off_of_area": 0.0625});
        assert_eq!(told["excluded"], shares);
        assert_eq!((&told["pose_uncertainty_mm"], &told["is_open_by_poses"]), (&0.24.into(), &true.into()));
        let open = RegionDeviationDocument::from(&region);
        let sentence = open_poses_sentence(&open).expect("a sentence");
        assert!(sentence.contains("(± 0.240 mm)") && sentence.contains("align.prior_mm"), "{sentence}");
        assert_eq!(open_poses_sentence(&RegionDeviationDocument { is_open_by_poses: false, ..open }), None);
        let deviation = DeviationDocument {
            alignment: Alignment::AsPlaced,
            mesh_from_placed: PoseSpec::from(&crate::geometry::Pose::<crate::geometry::Part, crate::geometry::Part>::identity()),
            fixed_freedoms: 6,
            compared_points: 900,
            turned_points: 100,
            excluded: ExcludedSharesDocument::from(&excluded),
            statistics: None,
            histogram: HistogramDocument { begin_mm: -1.0, width_mm: 1.0, area_mm2: vec![0.0; 2] },
            extents: [ExtentDocument { nominal_mm: 1.0, measured_mm: None, max_expanded_uncertainty_mm: None }; 3],
            regions: Vec::new(),
            worst: Vec::new(),
            off_surface: Vec::new(),
        };
        let sentence = excluded_sentence(&deviation);
        for wanted in ["900 points", "; 100, 10.00 %,", "30°", "12.50 % of the area", "6.25 % has", "raise compare.search_mm"] {
            assert!(sentence.contains(wanted), "{wanted}: {sentence}");
        }
        let within = ExcludedSharesDocument { off_of_area: 0.0, ..deviation.excluded };
        let sentence = excluded_sentence(&DeviationDocument { excluded: within, ..deviation.clone() });
        assert!(sentence.contains("0.00 % has") && !sentence.contains("raise"), "{sentence}");
        // What an earlier version wrote had no such numbers.
        let mut before = serde_json::to_value(&deviation).expect("JSON");
        let fields = before.as_object_mut().expect("an object");
        fields.retain(|name, _| !["turned_points", "excluded"].contains(&name.as_str()));
        let read: DeviationDocument = serde_json::from_value(before).expect("a document");
        assert_eq!((read.turned_points, read.excluded), (0, ExcludedSharesDocument::default()));
    }

    /// A surface at 0.500 mm with U 0.020 mm "may" lie beyond 0.150 mm, and nothing said why it is undecided.
    #[test]
    fn an_undecided_region_with_samples_that_fail_says_why_it_does_not_fail() {
        let told = |because: Option<&str>, open: Option<serde_json::Value>, [measured, conforming]: [f64; 2]| {
            let region = serde_json::json!({
                "name": "rib", "tolerance_mm": 0.3, "measured": measured, "verdict": "undecided", "expanded_uncertainty_mm": 0.02,
                "statistics": null, "undecided_because": because, "measured_samples": 4, "conforming": conforming, "open": open,
            });
            undecided_sentences(&serde_json::from_value(region).expect("a region"))
        };
        let open = serde_json::json!({
            "area_mm2": 0.25, "at_mm": [1.0, 2.0, 3.0], "deviation_mm": 0.5, "expanded_uncertainty_mm": 0.02,
        });
        let place =
            "0.250 mm² of it lies or may lie beyond ±0.150 mm, farthest at (1.0, 2.0, 3.0) mm: 0.500 mm, U 0.020 mm (k = 2).";
        let held = told(Some("not_held"), Some(open.clone()), [1.0, 0.1]).expect("a reason");
        let wanted = "The accepted scans do not hold the part along this surface to 2.5 mm: scan walls that face the same way, \
                      or align as placed (align.method = as_placed).";
        assert_eq!(held, wanted, "what lies there may be another surface");
        let few = told(Some("few_samples"), Some(open.clone()), [1.0, 0.1]).expect("a reason");
        let begin = "Only 4 samples are measured: a region fails where at least 10 are, or where nearly all of a smaller one is \
                     measured and all of it fails. ";
        assert_eq!(few, format!("{begin}{place}"));
        let noise = told(Some("within_noise"), Some(open), [1.0, 0.1]).expect("a reason");
        assert_eq!(noise, format!("Samples fail, but no more of them than noise explains. {place}"));
        let excused = told(None, None, [0.95, 0.85]).expect("a share");
        assert!(excused.starts_with("Only 85.00 % of it is shown to conform; at least 90 % of it has to: the rest"), "{excused}");
        assert_eq!(told(None, None, [0.95, 0.95]), None);
    }

    /// Such a region said that it is undecided, and neither where nor why.
    #[test]
    fn an_undecided_region_names_the_place_that_keeps_it_from_passing() {
        let part = |deviation_mm: Option<[f64; 2]>| OpenPart {
            area_mm2: 0.25,
            at_mm: [99.98, 22.51, 45.0].into(),
            deviation_mm,
            of_poses_mm: deviation_mm.map(|[_, expanded_mm]| 0.9 * expanded_mm),
        };
        let region = RegionDeviation {
            name: "x100".into(),
            tolerance_mm: Some(0.3),
            measured: 0.999,
            excluded: ExcludedShares::default(),
            statistics: None,
            verdict: Some(Conformity::Undecided),
            expanded_mm: Some(0.02),
            of_poses_mm: Some(0.01),
            is_open_by_poses: false,
            open: Some(part(Some([0.21, 0.0202]))),
            measured_samples: 90,
            conforming: Some(0.95),
            undecided_because: None,
        };
        let told = |region: RegionDeviation| undecided_sentences(&RegionDeviationDocument::from(&region));
        let wanted =
            "0.250 mm² of it lies or may lie beyond ±0.150 mm, farthest at (100.0, 22.5, 45.0) mm: 0.210 mm, U 0.020 mm (k = 2).";
        assert_eq!(told(region.clone()).as_deref(), Some(wanted));
        // The poses' part in U hid the place.
        let by_poses = told(RegionDeviation { is_open_by_poses: true, of_poses_mm: Some(0.24), ..region.clone() });
        let by_poses = by_poses.expect("a place");
        assert!(by_poses.starts_with(&format!("{wanted} U is mostly due to the poses of the views (± 0.018 mm)")), "{by_poses}");
        let mut small = RegionDeviation { is_open_by_poses: true, ..region.clone() };
        small.open.as_mut().expect("a place").of_poses_mm = Some(0.002);
        let small = told(small).expect("a place");
        assert!(
            small.contains("Points alone would let it pass, without what is left open by the poses of the views (± 0.002"),
            "{small}"
        );
        let off = RegionDeviation { open: Some(part(None)), ..region.clone() };
        let wanted = "0.250 mm² of it may lie beyond ±0.150 mm, farthest at (100.0, 22.5, 45.0) mm: beyond the search distance.";
        assert_eq!(told(off).expect("a place"), wanted);
        let few = RegionDeviation { open: None, measured: 0.816, ..region.clone() };
        assert_eq!(told(few).expect("a share"), "Only 81.60 % of it is measured; at least 90 % of it has to conform.");
        assert_eq!(told(RegionDeviation { open: None, ..region.clone() }), None);
        let failed = RegionDeviationDocument::from(&RegionDeviation { verdict: Some(Conformity::Fail), ..region });
        assert_eq!((failed.open, undecided_sentences(&failed)), (None, None));
        // An earlier release wrote no such place.
        let mut before = serde_json::to_value(&failed).expect("JSON");
        before.as_object_mut().expect("an object").remove("open");
        assert_eq!(serde_json::from_value::<RegionDeviationDocument>(before).expect("a region"), failed);
    }
}
