//! Viewpoints to consider ([`crate::planning::method::candidates`]). Every count is a ceiling: a strategy that finds fewer
//! gives fewer.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::{Findings, PoseSpec};

/// A scheme that generates candidates. Those of all schemes that are named are joined, in the order named; `iterative`
/// and `targeted` build on what the others measure, and so come after them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Strategy {
    /// Block ellipsoid, Algorithm 1 (thesis §3.1.3).
    Ellipsoid,
    /// Fibonacci directions on the same ellipsoid (Swinbank and Purser 2006).
    Even,
    /// Along the normals of the largest facets (Scott 2009; Martins, Mahmud: thesis §2.2).
    FacetNormal,
    /// Along the normals of surface points with a spacing filter (Scott, Loriot: thesis §2.2).
    SurfacePoints,
    /// Random positions in the volume from which the part is in depth, drawn to the surface (Jing et al. 2016).
    Volume,
    /// Even directions on the part of the hemisphere that the robot reaches; needs a cell (Jing et al. 2017).
    Reach,
    /// Random re-sampling around the best views so far (Mohammadikaji et al.: thesis §2.2).
    Iterative,
    /// Aimed at what the others leave uncovered, solved from the opening above it.
    Targeted,
}

impl Strategy {
    /// Every scheme.
    pub const ALL: [Self; 8] = [
        Self::Ellipsoid,
        Self::Even,
        Self::FacetNormal,
        Self::SurfacePoints,
        Self::Volume,
        Self::Reach,
        Self::Iterative,
        Self::Targeted,
    ];

    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ellipsoid => "ellipsoid",
            Self::Even => "even",
            Self::FacetNormal => "facet_normal",
            Self::SurfacePoints => "surface_points",
            Self::Volume => "volume",
            Self::Reach => "reach",
            Self::Iterative => "iterative",
            Self::Targeted => "targeted",
        }
    }
}

/// Part of the viewing sphere that is considered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Hemisphere {
    /// Every direction.
    Full,
    /// Only viewpoints above the plate's plane.
    AboveTable,
}

/// Rule for the distance of a candidate from the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Standoff {
    /// Half extent + F, then slid along the axis so that the seen surface lies around F.
    Surface,
    /// F from the block's centre.
    Centre,
}

/// Viewpoints to consider ([`crate::planning::method::candidates`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct CandidateParams {
    /// Schemes; their candidates are joined. Default `["even", "targeted"]`: what needs the fewest views for the same
    /// area (`src/planning/candidates/DEFAULT.md`).
    pub strategies: Vec<Strategy>,
    /// `ellipsoid`: polar step, and azimuth step near the equator, degrees, 1 to 90. Default 30.
    pub step_small_deg: f64,
    /// `ellipsoid`: azimuth step near the poles, degrees, 1 to 180. Default 45.
    pub step_large_deg: f64,
    /// `even`: directions around a part of one block, 4 to 10 000. Default 150, fewer where the table of what each view
    /// measures would not hold them. Each of b blocks has the √b-th part, but not fewer than 27: neighbours see each
    /// other's surface.
    pub even_directions: Option<u32>,
    /// `facet_normal`: facets, the largest first, 1 to 10 000. Default 100.
    pub facet_normals: u32,
    /// `surface_points`: points, 1 to 10 000. Default 100.
    pub surface_points: u32,
    /// `facet_normal` and `surface_points`: nearer than this, mm, 0 to 1000, and with a normal within 15° no second one
    /// is taken. Default: the root of the surface's area divided by the count.
    pub spacing_mm: Option<f64>,
    /// `volume`: random viewpoints, 1 to 10 000. Default 200.
    pub volume_points: u32,
    /// `reach`: directions, 1 to 10 000. Default 100.
    pub reach_directions: u32,
    /// `iterative`: rounds, 1 to 20; each looks closer around the best views. Default 3.
    pub iterative_rounds: u32,
    /// `iterative`: viewpoints a round, 1 to 10 000. Default 50.
    pub iterative_views: u32,
    /// `targeted`: viewpoints at most, 1 to 1000. Default 100.
    pub targeted_max: u32,
    /// Rolls about the viewing axis for each direction, degrees, -360 to 360. Default `[0, 90]`. `iterative` draws its
    /// rolls and `targeted` solves for them.
    pub rolls_deg: Vec<f64>,
    /// Beside each view, four that are turned by this angle to the four sides about the point at F ahead, with the
    /// scanner levelled again, degrees, 1 to 60. Default: none.
    pub tilts_deg: Vec<f64>,
    /// Distances by which a view stands back from where `standoff` puts it, mm, -500 to 500. Default `[0]`.
    pub standoffs_mm: Vec<f64>,
    /// Default: `full` without a cell, `above_table` with one.
    pub hemisphere: Option<Hemisphere>,
    /// Default `surface`.
    pub standoff: Standoff,
    /// Viewpoints to consider besides those of the strategies, `part_from_scanner`: those of a remedy, or your own; at most
    /// 10 000. Default none.
    pub poses: Vec<PoseSpec>,
}

impl Default for CandidateParams {
    fn default() -> Self {
        Self {
            strategies: vec![Strategy::Even, Strategy::Targeted],
            step_small_deg: 30.0,
            step_large_deg: 45.0,
            even_directions: None,
            facet_normals: 100,
            surface_points: 100,
            spacing_mm: None,
            volume_points: 200,
            reach_directions: 100,
            iterative_rounds: 3,
            iterative_views: 50,
            targeted_max: 100,
            rolls_deg: vec![0.0, 90.0],
            tilts_deg: Vec::new(),
            standoffs_mm: vec![0.0],
            hemisphere: None,
            standoff: Standoff::Surface,
            poses: Vec::new(),
        }
    }
}

impl CandidateParams {
    /// The thesis's candidates: the block ellipsoid alone, one roll.
    #[must_use]
    pub fn ellipsoid() -> Self {
        Self { strategies: vec![Strategy::Ellipsoid], rolls_deg: vec![0.0], ..Self::default() }
    }

    /// Returns true if a strategy is among those named.
    #[must_use]
    pub fn uses(&self, strategy: Strategy) -> bool {
        self.strategies.contains(&strategy)
    }

    /// Checks every range.
    pub(super) fn check(&self, findings: &mut Findings) {
        let none = self.strategies.is_empty() && self.poses.is_empty();
        findings.require(!none, "/candidates/strategies", || "is empty; name at least one, or give candidates.poses".into());
        findings.range("/candidates/step_small_deg", self.step_small_deg, 1.0, 90.0, "°");
        findings.range("/candidates/step_large_deg", self.step_large_deg, 1.0, 180.0, "°");
        for (name, count, min, max) in self.counts() {
            findings.range(format!("/candidates/{name}"), f64::from(count), min, max, "");
        }
        if let Some(spacing_mm) = self.spacing_mm {
            findings.range("/candidates/spacing_mm", spacing_mm, 0.0, 1000.0, "mm");
        }
        for (name, values, fewest, low, high, unit) in [
            ("rolls_deg", &self.rolls_deg, 1, -360.0, 360.0, "°"),
            ("tilts_deg", &self.tilts_deg, 0, 1.0, 60.0, "°"),
            ("standoffs_mm", &self.standoffs_mm, 1, -500.0, 500.0, "mm"),
        ] {
            findings.require((fewest..=360).contains(&values.len()), format!("/candidates/{name}"), || {
                format!("has {} entries; allowed is {fewest} to 360", values.len())
            });
            for (index, value) in values.iter().enumerate() {
                findings.range(format!("/candidates/{name}/{index}"), *value, low, high, unit);
            }
        }
    }

    /// Name, value, least and most of each count.
    fn counts(&self) -> [(&'static str, u32, f64, f64); 8] {
        [
            ("even_directions", self.even_directions.unwrap_or(4), 4.0, 10_000.0),
            ("facet_normals", self.facet_normals, 1.0, 10_000.0),
            ("surface_points", self.surface_points, 1.0, 10_000.0),
            ("volume_points", self.volume_points, 1.0, 10_000.0),
            ("reach_directions", self.reach_directions, 1.0, 10_000.0),
            ("iterative_rounds", self.iterative_rounds, 1.0, 20.0),
            ("iterative_views", self.iterative_views, 1.0, 10_000.0),
            ("targeted_max", self.targeted_max, 1.0, 1000.0),
        ]
    }
}
