//! Coverage in a plan: areas and shares, whole, by grade and by region, on other samples and with poses off.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::planning::params::PoseErrorParams;
use crate::planning::plan::{Coverage, Drawn, Independent, RegionCoverage, Robust, share};

/// Areas and shares of what is measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct CoverageDocument {
    /// All faces but excluded regions.
    pub asked_area_mm2: f64,
    /// Asked area that at least one kept candidate measures.
    pub coverable_area_mm2: f64,
    /// Asked area that some kept candidate measures, the cell's reach ignored.
    pub optically_coverable_area_mm2: f64,
    /// Asked area that at least one chosen view measures.
    pub measured_area_mm2: f64,
    /// Measured share of the asked area.
    pub of_asked: f64,
    /// Measured share of the coverable area.
    pub of_coverable: f64,
    /// Measured share of the whole surface.
    pub of_total: f64,
    /// Shares of the asked area by grade; they add up to `of_asked`.
    pub grades: GradesDocument,
    /// Share of the asked area after 1, 2, … views.
    pub curve: Vec<f64>,
    /// Coverage of each region of interest and feature.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<RegionCoverageDocument>,
    /// Coverage on samples that the views were not chosen on: the figure to trust. Choosing views on a set of samples
    /// reads high on that set. `null` in plans made before it was there.
    #[serde(default)]
    pub independent: Option<IndependentDocument>,
    /// Coverage on those samples with poses that are off; with `robust.pose_error`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robust: Option<RobustDocument>,
    /// Share of the whole surface on faces that some chosen view hits with a pixel of each device, whatever depth and
    /// incidence; with `visibility.pixel_set`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_set_of_total: Option<f64>,
}

/// Coverage of a region, counting only what is measured as well as is asked there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RegionCoverageDocument {
    /// Its name.
    pub name: String,
    /// Its asked area.
    pub asked_area_mm2: f64,
    /// Part of the asked area that some kept candidate measures.
    pub coverable_area_mm2: f64,
    /// Measured share of the asked area.
    pub of_asked: f64,
    /// Measured share of the coverable area.
    pub of_coverable: f64,
    /// Share of the asked area that was to be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<f64>,
}

impl From<&RegionCoverage> for RegionCoverageDocument {
    fn from(region: &RegionCoverage) -> Self {
        Self {
            name: region.name.clone(),
            asked_area_mm2: region.asked_area_mm2,
            coverable_area_mm2: region.coverable_area_mm2,
            of_asked: share(region.measured_area_mm2, region.asked_area_mm2),
            of_coverable: share(region.measured_area_mm2, region.coverable_area_mm2),
            target: region.target,
        }
    }
}

/// Coverage on a second set of samples, as dense as the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct IndependentDocument {
    /// Its samples.
    pub samples: usize,
    /// Measured share of the asked area.
    pub of_asked: f64,
    /// Measured share of the whole surface.
    pub of_total: f64,
}

/// Coverage with poses that are off, on the second set of samples: with every view off by an error of its own and, in
/// `part`, with the part off as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RobustDocument {
    /// The error: each pose is turned by the whole angle about a random axis and moved by the whole distance in a random
    /// direction.
    pub pose_error: PoseErrorParams,
    /// Number of draws in which every view was put off.
    pub draws: usize,
    /// Measured shares of the asked area.
    pub of_asked: DrawnDocument,
    /// The part off as a whole.
    pub part: MisplacedDocument,
}

/// Coverage with the part off as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct MisplacedDocument {
    /// Number of draws in which the part was put off.
    pub draws: usize,
    /// Measured shares of the asked area.
    pub of_asked: DrawnDocument,
}

/// A share over the draws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct DrawnDocument {
    /// With no error.
    pub nominal: f64,
    /// The least.
    pub worst: f64,
    /// The 5th percentile.
    pub p5: f64,
    /// The mean.
    pub mean: f64,
}

/// Shares of the asked area by grade.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct GradesDocument {
    /// Quality above 0.5.
    #[serde(rename = "A")]
    pub a: f64,
    /// Above 0.
    #[serde(rename = "B")]
    pub b: f64,
    /// Above −0.5.
    #[serde(rename = "C")]
    pub c: f64,
    /// The rest.
    #[serde(rename = "D")]
    pub d: f64,
}

impl From<&Coverage> for CoverageDocument {
    fn from(coverage: &Coverage) -> Self {
        let of_asked = |area_mm2: f64| share(area_mm2, coverage.asked_area_mm2);
        let [a, b, c, d] = coverage.grade_area_mm2.map(of_asked);
        Self {
            asked_area_mm2: coverage.asked_area_mm2,
            coverable_area_mm2: coverage.coverable_area_mm2,
            optically_coverable_area_mm2: coverage.optically_coverable_area_mm2,
            measured_area_mm2: coverage.measured_area_mm2,
            of_asked: coverage.of_asked(),
            of_coverable: coverage.of_coverable(),
            of_total: coverage.of_total(),
            grades: GradesDocument { a, b, c, d },
            curve: coverage.curve_area_mm2.iter().map(|area_mm2| of_asked(*area_mm2)).collect(),
            regions: coverage.regions.iter().map(RegionCoverageDocument::from).collect(),
            independent: Some(IndependentDocument::from(&coverage.independent)),
            robust: coverage.robust.as_ref().map(RobustDocument::from),
            pixel_set_of_total: coverage.pixel_set_area_mm2.map(|area_mm2| share(area_mm2, coverage.total_area_mm2)),
        }
    }
}

impl From<&Independent> for IndependentDocument {
    fn from(independent: &Independent) -> Self {
        Self { samples: independent.samples, of_asked: independent.of_asked(), of_total: independent.of_total() }
    }
}

impl From<&Robust> for RobustDocument {
    fn from(robust: &Robust) -> Self {
        Self {
            pose_error: robust.pose_error,
            draws: robust.views.draws(),
            of_asked: DrawnDocument::from(&robust.views),
            part: MisplacedDocument { draws: robust.part.draws(), of_asked: DrawnDocument::from(&robust.part) },
        }
    }
}

impl From<&Drawn> for DrawnDocument {
    fn from(drawn: &Drawn) -> Self {
        Self { nominal: drawn.nominal, worst: drawn.worst(), p5: drawn.p5(), mean: drawn.mean() }
    }
}
