//! Viewpoints to consider ([`crate::planning::method::candidates`]). Every count is a ceiling: a strategy that finds fewer
//! gives fewer.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::knob::params;
use crate::cell::{Findings, PoseInput, PoseSpec, closed_list};

closed_list! {
    /// Strategy that generates candidates. The candidates of all strategies given are joined, in that order; `iterative` and
    /// `targeted` build on what the others measure, and come after them.
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
        /// Strategies that generate candidates; their candidates are joined. Of the sets that were compared on six parts of four
        /// sizes, the default needs the fewest views for the same area, or one more, in 25 of 30 cases.
        strategies: Vec<Strategy> = vec![Strategy::Even, Strategy::Targeted];
        /// `ellipsoid`: step in the polar angle, and in azimuth near the equator, degrees. A smaller step gives more candidates.
        step_small_deg: f64 = 30.0, [1.0, 90.0] "°";
        /// `ellipsoid`: step in azimuth near the poles, degrees.
        step_large_deg: f64 = 45.0, [1.0, 180.0] "°";
        /// `even`: number of viewing directions around a part of one block. Each of b blocks gets this number divided by √b, but
        /// no fewer than 27 where the number allows, because neighbouring blocks share views. More directions find better views
        /// but take longer. Default: 150, or fewer where the visibility table has no room for more.
        even_directions: Option<u32> = None, [4.0, 10_000.0] "";
        /// `facet_normal`: maximum number of facets, the largest first.
        facet_normals: u32 = 100, [1.0, 10_000.0] "";
        /// `surface_points`: maximum number of surface points.
        surface_points: u32 = 100, [1.0, 10_000.0] "";
        /// `facet_normal` and `surface_points`: minimum distance, mm, between two points whose normals differ by less than 15°.
        /// Default: √(surface area / number of points).
        spacing_mm: Option<f64> = None, [0.0, 1000.0] "mm";
        /// `volume`: maximum number of random viewpoints.
        volume_points: u32 = 200, [1.0, 10_000.0] "";
        /// `reach`: maximum number of viewing directions.
        reach_directions: u32 = 100, [1.0, 10_000.0] "";
        /// `iterative`: number of rounds; each samples more closely around the best views so far.
        iterative_rounds: u32 = 3, [1.0, 20.0] "";
        /// `iterative`: maximum number of viewpoints per round.
        iterative_views: u32 = 50, [1.0, 10_000.0] "";
        /// `targeted`: maximum number of viewpoints.
        targeted_max: u32 = 100, [1.0, 1000.0] "";
        /// Rolls about the viewing axis that are tried for each viewing direction, degrees; at 0 the baseline of the cameras is
        /// level. `iterative` draws its own rolls and `targeted` computes them.
        rolls_deg: Vec<f64> = vec![0.0, 90.0], [-360.0, 360.0] "°", entries [1, 360];
        /// Tilts that are tried for each view, degrees: each adds four views, turned by this angle to the four sides about the
        /// point at best focus, with the baseline level again.
        tilts_deg: Vec<f64> = Vec::new(), [1.0, 60.0] "°", entries [0, 360];
        /// Offsets along the viewing axis that are tried for each view, mm: positive puts the scanner farther from the part than
        /// `standoff` does, negative nearer.
        standoffs_mm: Vec<f64> = vec![0.0], [-500.0, 500.0] "mm", entries [1, 360];
        /// Part of the viewing sphere that is considered. Default: `above_table` with a cell or with several setups, else `full`.
        hemisphere: Option<Hemisphere> = None;
        /// `above_table`: minimum elevation of a viewpoint above the plane of the plate, seen from the plate's centre, degrees.
        min_elevation_deg: f64 = 1.0, [0.0, 89.0] "°";
        /// Rule for the distance from the part: `surface` moves a view along its axis to where the visible surface of its block
        /// scores highest; `first_surface` puts the first surface on the axis at best focus; `centre` puts the centre of the
        /// block there.
        standoff: Standoff = Standoff::Surface;
        /// Looks for better views beside a first selection: each of its views is also tilted by 6° and by 12° to four sides, and
        /// views are selected again. The plan often needs fewer views, but these look more obliquely: a scanner that falls short
        /// of its specification measures less with them. Needs solver `local` or `certified`, and `standoff` = `surface`.
        look_closer: bool = false;
        /// Further viewpoints to consider, as `part_from_scanner`: those of a remedy, or your own.
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
