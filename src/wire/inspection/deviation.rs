//! Documents of how the surface deviates.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::PoseSpec;
use crate::inspection::deviation::{
    Alignment, Conformity, DeviationSpot, DeviationStatistics, ExcludedShares, Extent, MAX_TURN_DEG, MaterialKind, OffSurface,
    RegionDeviation,
};
use crate::inspection::{DeviationFigures, Inspection};
use crate::wire::words::percent_below;

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
}

/// Deviation of a region of interest or a feature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegionDeviationDocument {
    /// Name of the region or feature.
    pub name: String,
    /// Width of the tolerance zone; `null` without one.
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
    /// Statistics; `null` where nothing is measured.
    pub statistics: Option<StatisticsDocument>,
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
            statistics: region.statistics.as_ref().map(StatisticsDocument::from),
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
        let extent = |extent: Extent| ExtentDocument { nominal_mm: extent.nominal_mm, measured_mm: extent.measured_mm };
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

/// Sentence for a region that only what poses leave open keeps from passing: how large that is, and the remedy.
#[must_use]
pub fn open_poses_sentence(region: &RegionDeviationDocument) -> Option<String> {
    let open_mm = region.pose_uncertainty_mm.filter(|_| region.is_open_by_poses)?;
    Some(format!(
        "U is mostly due to the poses of the views (± {open_mm:.3} mm): calibrate the cell, or state how well its poses are \
         known (align.prior_mm); otherwise a step, hole or rib that views from both sides see has to tie them together."
    ))
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

fn percent(share: f64) -> String {
    format!("{} %", percent_below(share, 1.0, 2))
}

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
            extents: [ExtentDocument { nominal_mm: 1.0, measured_mm: None }; 3],
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
}
