//! Viewpoints to consider ([`crate::planning::method::candidates`]). Every count is a ceiling: a strategy that finds fewer
//! gives fewer.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::knob::params;
use crate::cell::{Findings, PoseInput, PoseSpec, closed_list};

closed_list! {
    /// A scheme that generates candidates. Those of all schemes that are named are joined, in the order named; `iterative`
    /// and `targeted` build on what the others measure, and so come after them.
    pub enum Strategy {
        /// Block ellipsoid, Algorithm 1 (thesis §3.1.3).
        Ellipsoid = "ellipsoid",
        /// Fibonacci directions on the same ellipsoid (Swinbank and Purser 2006).
        Even = "even",
        /// Along the normals of the largest facets (Scott 2009; Martins, Mahmud: thesis §2.2).
        FacetNormal = "facet_normal",
        /// Along the normals of surface points with a spacing filter (Scott, Loriot: thesis §2.2).
        SurfacePoints = "surface_points",
        /// Random positions in the volume from which the part is in depth, drawn to the surface (Jing et al. 2016).
        Volume = "volume",
        /// Even directions on the part of the hemisphere that the robot reaches; needs a cell (Jing et al. 2017).
        Reach = "reach",
        /// Random re-sampling around the best views so far (Mohammadikaji et al.: thesis §2.2).
        Iterative = "iterative",
        /// Aimed at what the others leave uncovered, solved from the opening above it.
        Targeted = "targeted",
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
    /// Half extent + F, then slid along the axis to where the visible surface of its block scores highest.
    Surface,
    /// Half extent + F, then slid along the axis until the first surface on it lies at F.
    FirstSurface,
    /// F from the block's centre.
    Centre,
}

params! {
    /// Viewpoints to consider ([`crate::planning::method::candidates`]).
    CandidateParams {
        /// Schemes; their candidates are joined. The default needs the fewest views for the same area
        /// (`src/planning/candidates/DEFAULT.md`).
        strategies: Vec<Strategy> = vec![Strategy::Even, Strategy::Targeted];
        /// `ellipsoid`: polar step, and azimuth step near the equator, degrees.
        step_small_deg: f64 = 30.0, [1.0, 90.0] "°";
        /// `ellipsoid`: azimuth step near the poles, degrees.
        step_large_deg: f64 = 45.0, [1.0, 180.0] "°";
        /// `even`: directions around a part of one block. Default: 150, fewer where the table of what each view measures would not
        /// hold them. Each of b blocks has the √b-th part, but not fewer than 27: neighbours see each other's surface.
        even_directions: Option<u32> = None, [4.0, 10_000.0] "";
        /// `facet_normal`: facets, the largest first.
        facet_normals: u32 = 100, [1.0, 10_000.0] "";
        /// `surface_points`: points.
        surface_points: u32 = 100, [1.0, 10_000.0] "";
        /// `facet_normal` and `surface_points`: nearer than this, mm, and with a normal within 15° no second one
        /// is taken. Default: the root of the surface's area divided by the count.
        spacing_mm: Option<f64> = None, [0.0, 1000.0] "mm";
        /// `volume`: random viewpoints.
        volume_points: u32 = 200, [1.0, 10_000.0] "";
        /// `reach`: directions.
        reach_directions: u32 = 100, [1.0, 10_000.0] "";
        /// `iterative`: rounds; each looks closer around the best views.
        iterative_rounds: u32 = 3, [1.0, 20.0] "";
        /// `iterative`: viewpoints a round.
        iterative_views: u32 = 50, [1.0, 10_000.0] "";
        /// `targeted`: max number of viewpoints.
        targeted_max: u32 = 100, [1.0, 1000.0] "";
        /// Rolls about the viewing axis for each direction, degrees. `iterative` draws its rolls and `targeted` solves for them.
        rolls_deg: Vec<f64> = vec![0.0, 90.0], [-360.0, 360.0] "°", entries [1, 360];
        /// Beside each view, four that are turned by this angle to the four sides about the point at F ahead, with the
        /// scanner levelled again, degrees.
        tilts_deg: Vec<f64> = Vec::new(), [1.0, 60.0] "°", entries [0, 360];
        /// Distances by which a view stands back from where `standoff` puts it, mm.
        standoffs_mm: Vec<f64> = vec![0.0], [-500.0, 500.0] "mm", entries [1, 360];
        /// Part of the viewing sphere. Default: `full` without a cell, `above_table` with one.
        hemisphere: Option<Hemisphere> = None;
        /// `above_table`: smallest elevation of a viewpoint over the plate's plane, seen from the plate's centre, degrees.
        min_elevation_deg: f64 = 1.0, [0.0, 89.0] "°";
        /// Rule for the distance from the part.
        standoff: Standoff = Standoff::Surface;
        /// Look beside the views of a first choice, each tilted by 6° and 12° to four sides, and choose again: often fewer views, which look more obliquely: a scanner that returns less than its specification measures less with them. Solvers `local` and `certified` with `standoff` `surface`.
        look_closer: bool = false;
        /// Viewpoints to consider besides those of the strategies, `part_from_scanner`: those of a remedy, or your own.
        #[schema(value_type = Vec<PoseInput>)]
        poses: Vec<PoseSpec> = Vec::new(), entries [0, 10_000];
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
        self.check_ranges("/candidates", findings);
        self.poses.iter().enumerate().for_each(|(index, pose)| pose.check(&format!("/candidates/poses/{index}"), findings));
    }
}
