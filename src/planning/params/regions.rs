//! Regions of the surface: excluded regions, regions of interest, and features with
//! tolerances. All in part coordinates, mm.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::Findings;
use crate::planning::grade::Grade;

/// Largest number of regions of interest and features of one job.
const MAX_REGIONS: usize = 10_000;

/// Regions that are excluded, of interest, or toleranced.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct RegionParams {
    /// Regions that are not asked for, since clamped, resting or of no interest. A face is left out when any of these regions
    /// holds it (face list, name), or holds the sample (the others).
    pub exclude: Vec<Region>,
    /// Regions with a weight, a target or limits of their own.
    pub interest: Vec<InterestParams>,
    /// Toleranced features; what they ask of the measurement follows from `noise`.
    pub features: Vec<FeatureParams>,
    /// The expected noise of a measured point, against which features are held.
    pub noise: NoiseParams,
}

/// A region of the part, in part coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum Region {
    /// Faces of the uploaded file, counted from 0.
    Faces {
        /// Face numbers.
        faces: Vec<u32>,
    },
    /// Axis-aligned box.
    Box {
        /// Lowest corner, mm.
        #[schema(min_items = 3, max_items = 3)]
        min_mm: [f64; 3],
        /// Highest corner, mm.
        #[schema(min_items = 3, max_items = 3)]
        max_mm: [f64; 3],
    },
    /// Ball.
    Sphere {
        /// Centre, mm.
        #[schema(min_items = 3, max_items = 3)]
        centre_mm: [f64; 3],
        /// Radius, mm, above 0.
        radius_mm: f64,
    },
    /// All points p with (p − point)·normal ≤ 0.
    HalfSpace {
        /// A point of the plane, mm.
        #[schema(min_items = 3, max_items = 3)]
        point_mm: [f64; 3],
        /// Outward direction, any length above 0.
        #[schema(min_items = 3, max_items = 3)]
        normal: [f64; 3],
    },
    /// All points within a distance of a plane.
    Plane {
        /// A point of the plane, mm.
        #[schema(min_items = 3, max_items = 3)]
        point_mm: [f64; 3],
        /// Direction across the plane, any length above 0.
        #[schema(min_items = 3, max_items = 3)]
        normal: [f64; 3],
        /// Distance to either side, mm, above 0.
        within_mm: f64,
    },
    /// A named group of the file (`g` and `o` lines of OBJ).
    Name {
        /// The group's name.
        name: String,
    },
}

/// A region of interest. Where several hold a sample, the greatest weight and the strictest limits count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct InterestParams {
    /// Name in plan and report. Default: `interest` and its number.
    #[serde(default)]
    pub name: Option<String>,
    /// The region of the surface.
    pub region: Region,
    /// Weight of its area in the score, 0 to 100; elsewhere it is 1. The target of the plan counts true area.
    /// Default 1.
    #[serde(default = "one")]
    pub weight: f64,
    /// Share of its area that is to be measured, 0 to 1, beside the plan's own target. Default: none of its own.
    #[serde(default)]
    pub target: Option<f64>,
    /// Largest angle between surface normal and camera ray here, degrees, 1 to 89.9. Default: the job's.
    #[serde(default)]
    pub camera_deg: Option<f64>,
    /// Largest angle between surface normal and projector ray here, degrees, 1 to 89.9. Default: the job's.
    #[serde(default)]
    pub projector_deg: Option<f64>,
    /// Count only area that is measured at this grade or better here. Default: `selection.min_grade`.
    #[serde(default)]
    pub min_grade: Option<Grade>,
}

/// A toleranced feature: one line of a `features.json` or CSV.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct FeatureParams {
    /// Name in plan and report. Default: `feature` and its number.
    #[serde(default)]
    pub name: Option<String>,
    /// The region that has to keep the tolerance.
    pub region: Region,
    /// Width of the tolerance zone, mm, 0.001 to 100.
    pub tolerance_mm: f64,
    /// Largest distance between measured points on the surface, mm, 0.01 to 100. Default: none.
    #[serde(default)]
    pub point_spacing_mm: Option<f64>,
    /// Share of its area that is to be measured so well, 0 to 1. Default: the plan's own target alone.
    #[serde(default)]
    pub target: Option<f64>,
}

/// The expected noise of a measured point: see [`crate::planning::requirements`] for the formula.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct NoiseParams {
    /// Standard deviation across a surface that is seen straight on at the best focus, mm, 0.0001 to 10. Default: 0.0117,
    /// a third of the scanner's single-shot accuracy of 0.035 mm (Table 4.3), which is taken as three sigma.
    pub best_mm: f64,
    /// Relative increase of the noise at the ends of the working depth, 0 to 100. Default 1: twice as much; taken, since no
    /// figure is known for this scanner.
    pub depth_gain: f64,
    /// Share of the tolerance that the expanded uncertainty to both sides, four sigma, may take, 0.01 to 1. Default 0.3, which
    /// VDA Volume 5 recommends for a measurement process.
    pub budget: f64,
}

impl Default for NoiseParams {
    fn default() -> Self {
        Self { best_mm: 0.035 / 3.0, depth_gain: 1.0, budget: 0.3 }
    }
}

fn one() -> f64 {
    1.0
}

impl RegionParams {
    pub(super) fn check(&self, findings: &mut Findings) {
        for (index, region) in self.exclude.iter().enumerate() {
            region.check(&format!("/regions/exclude/{index}"), findings);
        }
        let count = self.interest.len() + self.features.len();
        findings.require(count <= MAX_REGIONS, "/regions/interest", || {
            format!("and /regions/features have {count} entries; allowed are {MAX_REGIONS}")
        });
        for (index, interest) in self.interest.iter().enumerate() {
            interest.check(&format!("/regions/interest/{index}"), findings);
        }
        for (index, feature) in self.features.iter().enumerate() {
            feature.check(&format!("/regions/features/{index}"), findings);
        }
        findings.range("/regions/noise/best_mm", self.noise.best_mm, 1e-4, 10.0, "mm");
        findings.range("/regions/noise/depth_gain", self.noise.depth_gain, 0.0, 100.0, "");
        findings.range("/regions/noise/budget", self.noise.budget, 0.01, 1.0, "");
    }
}

impl InterestParams {
    fn check(&self, at: &str, findings: &mut Findings) {
        self.region.check(&format!("{at}/region"), findings);
        findings.range(format!("{at}/weight"), self.weight, 0.0, 100.0, "");
        if let Some(target) = self.target {
            findings.range(format!("{at}/target"), target, 0.0, 1.0, "");
        }
        for (field, limit) in [("camera_deg", self.camera_deg), ("projector_deg", self.projector_deg)] {
            if let Some(deg) = limit {
                findings.range(format!("{at}/{field}"), deg, 1.0, 89.9, "°");
            }
        }
    }
}

impl FeatureParams {
    fn check(&self, at: &str, findings: &mut Findings) {
        self.region.check(&format!("{at}/region"), findings);
        findings.range(format!("{at}/tolerance_mm"), self.tolerance_mm, 0.001, 100.0, "mm");
        if let Some(spacing_mm) = self.point_spacing_mm {
            findings.range(format!("{at}/point_spacing_mm"), spacing_mm, 0.01, 100.0, "mm");
        }
        if let Some(target) = self.target {
            findings.range(format!("{at}/target"), target, 0.0, 1.0, "");
        }
    }
}

impl Region {
    fn check(&self, at: &str, findings: &mut Findings) {
        let direction = |normal: &[f64; 3], findings: &mut Findings| {
            findings.require(normal.iter().any(|c| *c != 0.0), format!("{at}/normal"), || "is zero; give a direction".into());
        };
        match self {
            Self::Faces { faces } => {
                findings.require(!faces.is_empty(), format!("{at}/faces"), || "is empty; name at least one face".into());
            }
            Self::Box { min_mm, max_mm } => {
                findings.require((0..3).all(|i| min_mm[i] <= max_mm[i]), format!("{at}/min_mm"), || {
                    format!("{min_mm:?} is not below max_mm {max_mm:?} in every axis")
                });
            }
            Self::Sphere { radius_mm, .. } => findings.range(format!("{at}/radius_mm"), *radius_mm, 1e-6, 1e5, "mm"),
            Self::HalfSpace { normal, .. } => direction(normal, findings),
            Self::Plane { normal, within_mm, .. } => {
                direction(normal, findings);
                findings.range(format!("{at}/within_mm"), *within_mm, 1e-6, 1e5, "mm");
            }
            Self::Name { name } => {
                findings.require(!name.is_empty(), format!("{at}/name"), || "is empty; name a group of the file".into());
            }
        }
    }
}
