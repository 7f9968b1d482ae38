//! Documents of how the surface deviates.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::PoseSpec;
use crate::inspection::deviation::{
    Alignment, Conformity, DeviationSpot, DeviationStatistics, Extent, MaterialKind, OffSurface, RegionDeviation,
};
use crate::inspection::{DeviationFigures, Inspection};

/// Deviation of the surface from its model. Distances are along the outward normal: above 0 is more material than nominal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviationDocument {
    /// Alignment at which the surface is compared.
    pub alignment: Alignment,
    /// Takes the part's coordinates by the scans' poses to those of the mesh, beyond the registration.
    pub mesh_from_placed: PoseSpec,
    /// Freedoms that the measured surface fixes, of 6.
    pub fixed_freedoms: usize,
    /// Points that were compared.
    pub compared_points: u64,
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
    /// Points off the surface, in heaps: material that is missing or extra, or a body that the model does not have.
    pub off_surface: Vec<OffSurfaceDocument>,
}

/// Statistics by area.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatisticsDocument {
    /// Area measured.
    pub area_mm2: f64,
    /// Mean.
    pub mean_mm: f64,
    /// Root mean square.
    pub rms_mm: f64,
    /// 1st percentile.
    pub p1_mm: f64,
    /// 5th percentile.
    pub p5_mm: f64,
    /// Median.
    pub p50_mm: f64,
    /// 95th percentile.
    pub p95_mm: f64,
    /// 99th percentile.
    pub p99_mm: f64,
    /// Deviation that is farthest from zero.
    pub max_mm: f64,
    /// Share of the measured area within the tolerance zone; `null` without a tolerance.
    pub in_tolerance: Option<f64>,
}

/// Area by deviation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistogramDocument {
    /// Deviation at which the first class begins.
    pub begin_mm: f64,
    /// Width of a class.
    pub width_mm: f64,
    /// Area of each class; the first and the last hold what lies beyond.
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
    /// Name.
    pub name: String,
    /// Width of the tolerance zone; `null` without one.
    pub tolerance_mm: Option<f64>,
    /// Share of its area that is measured.
    pub measured: f64,
    /// Verdict of the profile (ISO 1101) by ISO 14253-1; `null` without a tolerance.
    pub verdict: Option<Conformity>,
    /// Median of the expanded uncertainty, k = 2; `null` where nothing is measured.
    pub expanded_uncertainty_mm: Option<f64>,
    /// Statistics; `null` where nothing is measured.
    pub statistics: Option<StatisticsDocument>,
}

/// A spot that deviates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviationSpotDocument {
    /// Missing or extra material.
    pub kind: MaterialKind,
    /// Middle of the spot, part frame.
    pub centre_mm: [f64; 3],
    /// Area of the spot.
    pub area_mm2: f64,
    /// Mean deviation.
    pub mean_mm: f64,
    /// Deviation that is farthest from zero.
    pub max_mm: f64,
}

/// Points off the surface that lie together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OffSurfaceDocument {
    /// Missing or extra material.
    pub kind: MaterialKind,
    /// Middle of the points, part frame.
    pub centre_mm: [f64; 3],
    /// Number of points.
    pub points: usize,
    /// Mean distance from the surface.
    pub mean_mm: f64,
}

impl From<&DeviationStatistics> for StatisticsDocument {
    fn from(figures: &DeviationStatistics) -> Self {
        let [p1_mm, p5_mm, p50_mm, p95_mm, p99_mm] = figures.percentiles_mm;
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
            in_tolerance: figures.in_tolerance,
        }
    }
}

impl From<&RegionDeviation> for RegionDeviationDocument {
    fn from(region: &RegionDeviation) -> Self {
        Self {
            name: region.name.clone(),
            tolerance_mm: region.tolerance_mm,
            measured: region.measured,
            verdict: region.verdict,
            expanded_uncertainty_mm: region.expanded_mm,
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
