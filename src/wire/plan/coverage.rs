//! Coverage in a plan: areas and shares in total, by grade, on independent samples and under pose errors.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::at_risk::AtRiskDocument;
use super::exposure::ExposureLossDocument;
use super::regions::RegionCoverageDocument;
use crate::planning::params::PoseErrorParams;
use crate::planning::plan::{Coverage, Drawn, Independent, Robust, VisibleShares, share};

/// Measured area and its shares.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct CoverageDocument {
    /// Area asked for: all faces outside excluded regions.
    pub asked_area_mm2: f64,
    /// Asked area that can be seen at all: it neither rests on the plate in every setup nor is enclosed by the part. 0 in plans
    /// from before it was introduced.
    #[serde(default)]
    pub visible_area_mm2: f64,
    /// Shares of the visible area.
    #[serde(flatten)]
    pub visible: VisibleSharesDocument,
    /// Asked area that at least one kept candidate measures.
    pub coverable_area_mm2: f64,
    /// Asked area that at least one candidate measures, regardless of the cell's reach.
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
    /// Measured share of the asked area after 1, 2, … views.
    pub curve: Vec<f64>,
    /// Measured area that may be missing from a real scan; the headline does not show it. `null` in plans from before it was
    /// introduced.
    #[serde(default)]
    pub at_risk: Option<AtRiskDocument>,
    /// True in a plan of further views after a scan, in which only the area that the scan left open is asked for.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub of_open: bool,
    /// Area that is expected to be too dark or saturated; present where `params.materials` or `params.scan.brightness` asks for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureLossDocument>,
    /// Coverage of each region of interest, then of each feature, in the order of `params.regions`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<RegionCoverageDocument>,
    /// Coverage on an independent set of samples: the figure to quote. The other figures are slightly optimistic, because views
    /// are optimised on the samples that these are computed on. `null` in plans from before it was introduced.
    #[serde(default)]
    pub independent: Option<IndependentDocument>,
    /// Coverage on the independent samples under pose errors; present with `robust.pose_error`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robust: Option<RobustDocument>,
    /// Share of the whole surface on faces that at least one chosen view hits with a pixel of each device, regardless of depth
    /// and incidence; present with `visibility.pixel_set`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_set_of_total: Option<f64>,
}

/// Shares of the visible area: the first figures to read. 0 in plans from before they were introduced.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct VisibleSharesDocument {
    /// Measured share of the visible area.
    #[serde(default)]
    pub of_visible: f64,
    /// Share of the visible area measured at grade A or B.
    #[serde(default)]
    pub grades_a_b_of_visible: f64,
    /// Share of the visible area measured at an incidence of at most 35°, against the ray to the origin of the scanner frame.
    #[serde(default)]
    pub within_35_deg_of_visible: f64,
    /// Share of the visible area measured at an incidence of at most 60°, against the same ray.
    #[serde(default)]
    pub within_60_deg_of_visible: f64,
}

impl From<VisibleShares> for VisibleSharesDocument {
    fn from(shares: VisibleShares) -> Self {
        let [within_35_deg_of_visible, within_60_deg_of_visible] = shares.within;
        Self {
            of_visible: shares.measured,
            grades_a_b_of_visible: shares.grades_a_b,
            within_35_deg_of_visible,
            within_60_deg_of_visible,
        }
    }
}

/// Coverage on a second, independent set of samples, as dense as the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct IndependentDocument {
    /// Number of samples.
    pub samples: usize,
    /// Measured share of the asked area.
    pub of_asked: f64,
    /// Measured share of the whole surface.
    pub of_total: f64,
    /// Shares of the visible area: the figures to quote.
    #[serde(flatten)]
    pub visible: VisibleSharesDocument,
}

/// Coverage under pose errors, on the independent samples: with an independent error of every view; in `part`, with an error of
/// the part and its support; in `hand_eye`, with one error that every view shares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct RobustDocument {
    /// Size of the error: each pose is rotated by the full angle about a random axis and moved by the full distance in a random
    /// direction. Six draws rotate both ways about three axes at right angles, and move both ways along three; fewer leave axes out.
    pub pose_error: PoseErrorParams,
    /// Number of draws of an error for every view.
    pub draws: usize,
    /// Measured shares of the asked area.
    pub of_asked: DrawnDocument,
    /// Coverage with an error of the part and its support: part, fixture and plate are off as one, as a wrong pose of the table
    /// in the robot's frame puts them. A part that is put down wrongly shifts on the plate and turns about the vertical only,
    /// which this includes.
    pub part: MisplacedDocument,
    /// Coverage with one error in the scanner frame that every view shares, as a wrong hand-eye calibration causes it. `null` in
    /// plans from before it was introduced.
    #[serde(default)]
    pub hand_eye: Option<MisplacedDocument>,
}

/// Coverage with an error that all views share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct MisplacedDocument {
    /// Number of draws of the error.
    pub draws: usize,
    /// Measured shares of the asked area.
    pub of_asked: DrawnDocument,
}

/// Distribution of a share over the draws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct DrawnDocument {
    /// Share without errors.
    pub nominal: f64,
    /// Lowest share.
    pub worst: f64,
    /// 5th percentile of the shares, linear between draws; with fewer than 20 draws it is a value between the two lowest rather
    /// than a percentile.
    pub p5: f64,
    /// Mean of the shares.
    pub mean: f64,
}

/// Shares of the asked area by grade, on the samples that views are chosen on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct GradesDocument {
    /// Grade A: quality above 0.5.
    #[serde(rename = "A")]
    pub a: f64,
    /// Grade B: quality above 0.
    #[serde(rename = "B")]
    pub b: f64,
    /// Grade C: quality above −0.5.
    #[serde(rename = "C")]
    pub c: f64,
    /// Grade D: quality of −0.5 or lower.
    #[serde(rename = "D")]
    pub d: f64,
}

impl From<&Coverage> for CoverageDocument {
    fn from(coverage: &Coverage) -> Self {
        let of_asked = |area_mm2: f64| share(area_mm2, coverage.asked_area_mm2);
        let [a, b, c, d] = coverage.measured.grade_area_mm2.map(of_asked);
        Self {
            asked_area_mm2: coverage.asked_area_mm2,
            visible_area_mm2: coverage.visible_area_mm2,
            visible: coverage.of_visible().into(),
            coverable_area_mm2: coverage.coverable_area_mm2,
            optically_coverable_area_mm2: coverage.optically_coverable_area_mm2,
            measured_area_mm2: coverage.measured.area_mm2,
            of_asked: coverage.of_asked(),
            of_coverable: coverage.of_coverable(),
            of_total: coverage.of_total(),
            grades: GradesDocument { a, b, c, d },
            curve: coverage.curve_area_mm2.iter().map(|area_mm2| of_asked(*area_mm2)).collect(),
            at_risk: Some(AtRiskDocument::from(coverage)),
            of_open: coverage.is_of_open,
            exposure: coverage.exposure.map(|loss| ExposureLossDocument::of(&loss, coverage.asked_area_mm2)),
            regions: coverage.regions.iter().map(RegionCoverageDocument::from).collect(),
            independent: Some(IndependentDocument::from(&coverage.independent)),
            robust: coverage.robust.as_ref().map(RobustDocument::from),
            pixel_set_of_total: coverage.pixel_set_area_mm2.map(|area_mm2| share(area_mm2, coverage.total_area_mm2)),
        }
    }
}

impl From<&Independent> for IndependentDocument {
    fn from(independent: &Independent) -> Self {
        Self {
            samples: independent.samples,
            of_asked: independent.of_asked(),
            of_total: independent.of_total(),
            visible: independent.of_visible().into(),
        }
    }
}

impl From<&Robust> for RobustDocument {
    fn from(robust: &Robust) -> Self {
        Self {
            pose_error: robust.pose_error,
            draws: robust.views.draws(),
            of_asked: DrawnDocument::from(&robust.views),
            part: MisplacedDocument::from(&robust.part),
            hand_eye: Some(MisplacedDocument::from(&robust.hand_eye)),
        }
    }
}

/// Kind of pose error that costs most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CostliestError {
    /// Name of the error, after "an error of".
    pub(crate) kind: &'static str,
    /// Number of draws.
    pub(crate) draws: usize,
    /// Measured shares of the asked area.
    pub(crate) of_asked: DrawnDocument,
}

impl CostliestError {
    /// Loss of the worst draw against nominal, as a share of the asked area.
    pub(crate) fn loss(&self) -> f64 {
        self.of_asked.nominal - self.of_asked.worst
    }
}

impl RobustDocument {
    /// Kind of error of which the worst draw costs most; the first of several that cost as much.
    pub(crate) fn costliest(&self) -> CostliestError {
        let each_view = CostliestError { kind: "each view", draws: self.draws, of_asked: self.of_asked };
        let of =
            |kind, misplaced: MisplacedDocument| CostliestError { kind, draws: misplaced.draws, of_asked: misplaced.of_asked };
        let part = of("the part and its support", self.part);
        let hand_eye = self.hand_eye.map(|off| of("the hand-eye calibration", off));
        [Some(part), hand_eye].into_iter().flatten().fold(each_view, |a, b| if b.loss() > a.loss() { b } else { a })
    }
}

impl From<&Drawn> for MisplacedDocument {
    fn from(drawn: &Drawn) -> Self {
        Self { draws: drawn.draws(), of_asked: DrawnDocument::from(drawn) }
    }
}

impl From<&Drawn> for DrawnDocument {
    fn from(drawn: &Drawn) -> Self {
        Self { nominal: drawn.nominal, worst: drawn.worst(), p5: drawn.p5(), mean: drawn.mean() }
    }
}
