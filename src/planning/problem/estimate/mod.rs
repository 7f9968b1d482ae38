//! Estimate of what a plan will take, made before anything is allocated for it: how many patches, samples, candidates and views there
//! will be, how many bytes are held at once (`bytes.rs`), and roughly how long it takes (`secs.rs`). A job whose estimate is
//! beyond what it is allowed is refused with the figure and the parameter to change.
//!
//! Counts are of the expected size, never far below the true ones; bytes are an upper bound within a factor of three where
//! that is much (`tests/it/bounds/planning.rs` holds it against plans). Seconds are rough: views in cluttered cells, parts
//! with deep holes and unlucky tours take a few times as long. Cost: a few passes over the triangles.

mod bytes;
mod refusal;
mod secs;
#[cfg(test)]
mod tests;

use crate::geometry::{Aabb, Mesh, Part, Pose, Table};
use crate::planning::candidates::{self, MAX_CANDIDATES, MAX_PAIRS};
use crate::planning::context::{Allowance, PlanError};
use crate::planning::params::{Objective, PlanParams, SelectionGoal, Solver};
use crate::planning::scene::{PlanInput, resting};
use crate::planning::surface::{self, thinned};

/// Share of the scanner's practical field that a chosen view adds to the others in a large part, at least about.
const ADDED_OF_FIELD: f64 = 0.6;
/// Views of a part that a single field holds, at most.
const VIEWS_OF_A_BLOCK: f64 = 40.0;
/// Largest share of a part's samples that a view measures; of a large part it measures what twice its field holds.
const MAX_MEASURED: f64 = 0.4;

/// Memory and time of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Numbers of patches, samples, candidates and views.
    pub counts: Counts,
    /// Bytes held at once.
    pub bytes: Shares,
    /// Seconds of one core.
    pub core_secs: Shares,
}

/// Numbers of patches, samples, candidates and views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Extent of the part as it lies, mm.
    pub extent_mm: [f64; 3],
    /// Boxes that the part is divided into along each axis, none larger than the scanner's block cube.
    pub blocks_along: [f64; 3],
    /// Boxes that hold surface.
    pub blocks: f64,
    /// Triangles of the part.
    pub triangles: f64,
    /// Patches.
    pub patches: f64,
    /// Samples.
    pub samples: f64,
    /// Samples that views are chosen on.
    pub chosen_on: f64,
    /// Candidates that are examined, over all setups.
    pub candidates: f64,
    /// Views that are chosen.
    pub views: f64,
    /// Largest share of the samples that a view measures.
    pub measured: f64,
    /// Ways in which the part lies.
    pub setups: f64,
    /// Minimum number of samples, and that of candidates of strategies that know the part alone.
    min_counts: [usize; 2],
}

/// A sum by what its parts grow with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    /// Grows with the triangles of the part and of all else.
    pub triangles: f64,
    /// Grows with patches and samples.
    pub samples: f64,
    /// Grows with candidates.
    pub candidates: f64,
    /// Grows with views.
    pub views: f64,
    /// Grows with the regions of interest and features that have a target.
    pub regions: f64,
}

impl Shares {
    /// All of it.
    #[must_use]
    pub fn sum(&self) -> f64 {
        self.triangles + self.samples + self.candidates + self.views + self.regions
    }
}

impl Estimate {
    /// The estimate for a plan on so many threads.
    #[must_use]
    pub fn of(input: &PlanInput<'_>, params: &PlanParams, threads: usize) -> Self {
        let counts = Counts::of(input, params);
        let (bytes, core_secs) = (bytes::held(&counts, input, params, threads as f64), secs::taken(&counts, input, params));
        Self { counts, bytes, core_secs }
    }

    /// Refuses what is beyond what any plan may have, and what would take more than is allowed.
    ///
    /// # Errors
    /// [`PlanError::BadParams`] with what the plan would take, what is allowed and what to change.
    pub fn check(&self, allowed: &Allowance) -> Result<(), PlanError> {
        refusal::check(self, allowed)
    }
}

impl Counts {
    fn of(input: &PlanInput<'_>, params: &PlanParams) -> Self {
        let part = surface::resolve(&params.part, input.mesh);
        let [patches, samples] = surface::expected(input.mesh, &part);
        let table_from_part = part.table_from_part.map_or_else(|| resting(input.mesh), |pose| pose.pose());
        let extent = placed(input.mesh, &table_from_part).extent_mm();
        let (along, area_mm2) = (candidates::block_counts(&extent, input.scanner), input.mesh.area_mm2());
        let triangles = input.mesh.faces.len() as f64;
        let longest = along.max();
        let chosen_on = thinned::expected(params.selection.samples).min(samples);
        let blocks = occupied(area_mm2, &extent.component_div(&along).into(), &along.into()).max(longest).min(samples);
        let setups = f64::from(params.setups.max(1));
        let [width_mm, height_mm, _] = input.scanner.practical_volume_mm;
        let field_mm2 = width_mm * height_mm;
        let views = VIEWS_OF_A_BLOCK + area_mm2 / (ADDED_OF_FIELD * field_mm2);
        let candidates = examined(params, blocks, chosen_on, (setups, views));
        let most_views = params.selection.max_views.map_or(candidates, |views| f64::from(views).min(candidates));
        // Each patch has a sample, and each sample stands for no more than its share of the area and a half.
        let min_samples = triangles.max(part.samples_per_mm2.unwrap_or(0.0) * area_mm2 * 2.0 / 3.0) as usize;
        let min_blocks = longest.max(blocks / 4.0) as usize;
        Self {
            extent_mm: extent.into(),
            blocks_along: along.into(),
            blocks,
            triangles,
            patches,
            samples,
            chosen_on,
            candidates,
            views: views.min(most_views),
            measured: (2.0 * field_mm2 / area_mm2).min(MAX_MEASURED),
            setups,
            min_counts: [min_samples, candidates::expected(&params.candidates, min_blocks, min_samples)],
        }
    }

    /// Pairs of candidate and sample that views are chosen on.
    #[must_use]
    pub fn pairs(&self) -> f64 {
        self.candidates * self.chosen_on
    }
}

/// Candidates that are examined. Targeted ones are proposed three times as often as they are kept, and views are estimated high: what is
/// more of the two stands for both.
fn examined(params: &PlanParams, blocks: f64, samples: f64, (setups, views): (f64, f64)) -> f64 {
    let room = (MAX_CANDIDATES as f64).min(MAX_PAIRS as f64 / samples);
    let known = candidates::expected(&params.candidates, blocks as usize, samples as usize) as f64;
    let targeted = candidates::expected_targeted(&params.candidates) as f64;
    let looks_closer = exchanges(params) && params.candidates.look_closer;
    let beside = if looks_closer { candidates::expected_beside(views) } else { 0.0 };
    setups * (known.min(room) + targeted.max(beside).min(room))
}

/// The box around the part as it lies.
fn placed(mesh: &Mesh, table_from_part: &Pose<Table, Part>) -> Aabb {
    mesh.vertices_mm.iter().fold(Aabb::empty(), |aabb, vertex| aabb.with(&table_from_part.point(vertex)))
}

/// About how many boxes of a grid a surface passes through: as many as their widest side goes into its area, which is exact
/// for a box along the axes.
fn occupied(area_mm2: f64, edges_mm: &[f64; 3], along: &[f64; 3]) -> f64 {
    let [a, b, c] = *edges_mm;
    let widest_mm2 = (a * b).max(b * c).max(a * c);
    (area_mm2 / widest_mm2).min(along.iter().product())
}

/// Returns true if rows keep the quality of what they measure.
fn keeps_quality(params: &PlanParams) -> bool {
    params.selection.objective == Objective::Score && params.score.b > 0.0
}

/// Number of regions of interest and features whose target views are chosen for.
fn goals_of_regions(params: &PlanParams) -> f64 {
    let (interest, features) = (&params.regions.interest, &params.regions.features);
    let targets = interest.iter().map(|region| region.target).chain(features.iter().map(|feature| feature.target));
    targets.flatten().count() as f64
}

/// Returns true if views are exchanged for others, one by one.
fn exchanges(params: &PlanParams) -> bool {
    matches!(params.selection.solver, Solver::Local | Solver::Certified) || params.selection.goal == SelectionGoal::MinTime
}
