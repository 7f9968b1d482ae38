//! Patches to viewpoints ([`crate::planning::method::candidates`]): which directions are considered, how far the scanner
//! stands, how it tilts and rolls, and which viewpoints are dropped before anything is computed for them. [`generate`] answers
//! for the strategies that know the part alone; [`around_best`], [`aimed_at_open`] and [`beside`] for those that build on what
//! others measure.
//!
//! A strategy gives aims (`aim.rs`): a place, a viewing axis, and how it may be varied. `DEFAULT.md` beside this file holds
//! the table that decided which strategies are the default.
//!
//! Candidates are dropped here only where the job asks for it ([`Rejection::LowElevation`]) or for reasons that cannot change
//! the result: they cannot be taken, or an equal one is there already; [`Rejection::MeasuresNothing`] is the third such reason,
//! found with the table. That a candidate measures no more than another and nowhere better is no such reason: the other may
//! have no path, may take longer to reach or overlap less with its neighbours, and among equals the lower number is chosen.
//! The solver that proves its answer removes those for itself, where it knows the objective.
//!
//! Frames: everything is generated in `table` (the part as placed, +z up) and handed on as `part_from_scanner`.

mod aim;
mod blocks;
mod ellipsoid;
mod even;
mod filter;
mod iterative;
mod label;
mod normals;
mod reach;
pub(in crate::planning) mod slide;
mod spread;
mod targeted;
#[cfg(test)]
mod tests;
mod volume;

use std::ops::{Index, IndexMut};

use super::context::{Cancelled, Context, PlanError, Refusal};
use super::ids::{CandidateId, CandidateIndex, SetupIndex};
use super::params::{CandidateParams, ScoreParams, Strategy};
use super::surface::Surface;
use super::visibility::{Occluders, Optics};
use crate::cell::{Cell, Scanner};
use crate::geometry::{Mesh, Part, Pose, ScannerFrame, Table};
pub(in crate::planning) use aim::looking_along;
use aim::{Aim, Placed, views_of_an_aim};
pub(in crate::planning) use blocks::counts as block_counts;
pub(in crate::planning) use even::spiral;
pub(in crate::planning) use filter::stands_above;

pub use super::verdict::Rejection;
pub use label::Label;
pub use targeted::OpenSamples;

/// A viewpoint under consideration.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Number as generated; ties break by it.
    pub id: CandidateId,
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Side of the part that it looks at.
    pub label: Label,
    /// Setup that it is taken in.
    pub setup: SetupIndex,
    /// True if the job gives its pose, which is then not slid.
    pub is_given: bool,
    /// Candidate that was slid to it once it was chosen; `None` for one that was generated.
    pub slid_from: Option<CandidateIndex>,
}

/// Part, surface, scanner and cell that candidates are generated for.
pub struct Scope<'a> {
    /// The part.
    pub part: &'a Mesh,
    /// Samples of the part.
    pub surface: &'a Surface,
    /// The scanner.
    pub scanner: &'a Scanner,
    /// The cell, where there is one.
    pub cell: Option<&'a Cell>,
    /// Pose of the part on the table.
    pub table_from_part: Pose<Table, Part>,
    /// Everything that hides a sample.
    pub occluders: &'a Occluders,
    /// The scanner's optics within the limits of the job.
    pub optics: &'a Optics,
    /// Weights of the score that a viewpoint slides to.
    pub score: &'a ScoreParams,
    /// Seed of the strategies that draw.
    pub seed: u64,
}

/// Candidates that no filter dropped, in which a [`CandidateIndex`] is a place, and how many were generated and dropped.
#[derive(Clone, Debug, Default)]
pub struct CandidateSet {
    /// The candidates that remain, ascending by id.
    pub remaining: Vec<Candidate>,
    /// Number generated.
    pub generated: usize,
    /// Dropped, with the reason.
    pub rejected: Vec<(Candidate, Rejection)>,
}

impl CandidateSet {
    /// Adds `more`, whose numbers start from 0, behind these.
    pub fn append(&mut self, more: Self) {
        let first = self.generated as u32;
        let renumbered = |candidate: Candidate| Candidate { id: CandidateId(candidate.id.0 + first), ..candidate };
        let remaining = more.remaining.into_iter().map(renumbered);
        let rejected = more.rejected.into_iter().map(|(candidate, reason)| (renumbered(candidate), reason));
        self.remaining.extend(remaining);
        self.rejected.extend(rejected);
        self.generated += more.generated;
    }

    /// Places of those that remain, ascending.
    pub fn indices(&self) -> impl Iterator<Item = CandidateIndex> + use<> {
        CandidateIndex::first(self.remaining.len())
    }
}

impl Index<CandidateIndex> for CandidateSet {
    type Output = Candidate;

    fn index(&self, candidate: CandidateIndex) -> &Candidate {
        &self.remaining[candidate.index()]
    }
}

impl IndexMut<CandidateIndex> for CandidateSet {
    fn index_mut(&mut self, candidate: CandidateIndex) -> &mut Candidate {
        &mut self.remaining[candidate.index()]
    }
}

/// Largest number of candidates of one job.
pub(in crate::planning) const MAX_CANDIDATES: usize = 50_000;
/// Largest number of pairs of candidate and sample: bounds the visibility matrix to 2.2 GB.
pub(in crate::planning) const MAX_PAIRS: usize = 1_000_000_000;
/// Even directions by default around a part of one block (`DEFAULT.md`).
const EVEN_DIRECTIONS: usize = 150;
/// Views that are proposed for one that `targeted` may keep.
const PROPOSED: usize = 3;
/// Views that others are looked for beside, at most.
const MAX_LOOKED_BESIDE: usize = 100;

/// Fills in what [`CandidateParams`] leaves to the part: even directions, as many as half of the table has room for.
#[must_use]
pub fn resolve(
    surface: &Surface,
    table_from_part: &Pose<Table, Part>,
    scanner: &Scanner,
    params: &CandidateParams,
) -> CandidateParams {
    let blocks = blocks::split(surface, table_from_part, scanner);
    let directions = even_directions(params, blocks.len(), surface.sample_mm.len());
    CandidateParams { even_directions: params.even_directions.or(Some(directions)), ..params.clone() }
}

/// Number of blocks that a part is divided into as it lies.
#[must_use]
pub(in crate::planning) fn occupied_blocks(surface: &Surface, table_from_part: &Pose<Table, Part>, scanner: &Scanner) -> usize {
    blocks::split(surface, table_from_part, scanner).len()
}

/// Even directions that are looked from where the job does not say.
fn even_directions(params: &CandidateParams, blocks: usize, samples: usize) -> u32 {
    (max_candidates(samples) / 2 / (views_of_an_aim(params) * blocks).max(1)).clamp(4, EVEN_DIRECTIONS) as u32
}

/// Upper bound on the candidates that the strategies of `params` give for so many blocks and samples; `targeted` left out.
#[must_use]
pub(in crate::planning) fn expected(params: &CandidateParams, blocks: usize, samples: usize) -> usize {
    let aims = |strategy: &Strategy| match strategy {
        Strategy::Ellipsoid => ellipsoid::directions(params.step_small_deg, params.step_large_deg).len().saturating_mul(blocks),
        Strategy::Even => {
            let directions = params.even_directions.unwrap_or_else(|| even_directions(params, blocks, samples));
            even::directions_a_block(directions, blocks).saturating_mul(blocks)
        }
        Strategy::FacetNormal => params.facet_normals as usize,
        Strategy::SurfacePoints => params.surface_points as usize,
        Strategy::Volume => params.volume_points as usize,
        Strategy::Reach => params.reach_directions as usize,
        Strategy::Iterative => iterative::count(params),
        Strategy::Targeted => 0,
    };
    let all = params.strategies.iter().map(aims).fold(0, usize::saturating_add);
    all.saturating_mul(views_of_an_aim(params)).saturating_add(params.poses.len())
}

/// Upper bound on the candidates that `targeted` proposes; their rolls are solved for.
#[must_use]
pub(in crate::planning) fn expected_targeted(params: &CandidateParams) -> usize {
    let views = params.standoffs_mm.len() * (1 + 4 * params.tilts_deg.len());
    if params.uses(Strategy::Targeted) { PROPOSED * params.targeted_max as usize * views } else { 0 }
}

/// Candidates that a job may have.
fn max_candidates(samples: usize) -> usize {
    MAX_CANDIDATES.min(MAX_PAIRS / samples.max(1))
}

/// Generates the candidates of every strategy in `params` that knows the part alone, and drops those that no cell could
/// use.
///
/// # Errors
/// [`PlanError::Cancelled`]; [`PlanError::BadParams`] when there would be too many, or a strategy needs a cell.
pub fn generate(scope: &Scope<'_>, params: &CandidateParams, ctx: &Context<'_>) -> Result<CandidateSet, PlanError> {
    let aims = aims(scope, params, ctx)?;
    let mut placed = aim::place(scope, &aims, params, ctx)?;
    refuse_too_many(placed.len() + params.poses.len(), scope)?;
    placed.extend(params.poses.iter().map(|given| given_pose(scope, &given.pose())));
    let mut judged = filter::judge(scope, params, placed, ctx)?;
    let first_given = judged.generated - params.poses.len();
    judged.remaining.iter_mut().for_each(|candidate| candidate.is_given = candidate.id.index() >= first_given);
    Ok(judged)
}

/// Generates at most `max` of the candidates that [`generate`] does, or those of one aim where that gives more: those of aims
/// evenly spaced, poses that the job gives left out. Their numbers are their own.
///
/// # Errors
/// The errors of [`generate`].
pub(in crate::planning) fn generate_some(
    scope: &Scope<'_>,
    params: &CandidateParams,
    max: usize,
    ctx: &Context<'_>,
) -> Result<CandidateSet, PlanError> {
    let all = aims(scope, params, ctx)?;
    let count = all.len().min((max / views_of_an_aim(params)).max(1));
    let some: Vec<Aim> = (0..count).map(|number| all[number * all.len() / count].clone()).collect();
    Ok(judged(scope, params, &some, ctx)?)
}

/// Aims of every strategy in `params` that knows the part alone.
fn aims(scope: &Scope<'_>, params: &CandidateParams, ctx: &Context<'_>) -> Result<Vec<Aim>, PlanError> {
    let mut aims = Vec::new();
    for strategy in &params.strategies {
        let already = aims.len();
        let bound = |more: usize| refuse_too_many((already + more).saturating_mul(views_of_an_aim(params)), scope);
        aims.extend(match strategy {
            Strategy::Ellipsoid => ellipsoid::aims(scope, params, bound)?,
            Strategy::Even => even::aims(scope, params, bound)?,
            Strategy::FacetNormal => normals::of_facets(scope, params),
            Strategy::SurfacePoints => normals::of_points(scope, params),
            Strategy::Volume => volume::aims(scope, params, ctx)?,
            Strategy::Reach => reach::aims(scope, params, ctx)?,
            Strategy::Iterative | Strategy::Targeted => Vec::new(),
        });
    }
    refuse_too_many((aims.len() + iterative::count(params)).saturating_mul(views_of_an_aim(params)), scope)?;
    Ok(aims)
}

/// Random viewpoints around `best`, the best so far, nearer with every round; around the part while there are none.
///
/// # Errors
/// [`Cancelled`].
pub fn around_best(
    scope: &Scope<'_>,
    params: &CandidateParams,
    best: &[Pose<Part, ScannerFrame>],
    round: u32,
    ctx: &Context<'_>,
) -> Result<CandidateSet, Cancelled> {
    judged(scope, params, &iterative::aims(scope, params, best, round), ctx)
}

/// Viewpoints aimed at what is open beside the `already` generated ones, at most three times as many as `targeted` may keep:
/// which of them are needed shows only when it is known what they measure.
///
/// # Errors
/// [`Cancelled`].
pub fn aimed_at_open(
    scope: &Scope<'_>,
    params: &CandidateParams,
    open: &OpenSamples<'_>,
    already: usize,
    ctx: &Context<'_>,
) -> Result<CandidateSet, Cancelled> {
    let room = max_candidates(scope.surface.sample_mm.len()).saturating_sub(already) / views_of_an_aim(params);
    let aims = targeted::aims(scope, open, room.min(PROPOSED * params.targeted_max as usize), ctx)?;
    judged(scope, params, &aims, ctx)
}

/// Viewpoints beside `views`, those of a first choice: each turned to its four sides about the point at F ahead, by each angle of
/// [`aim::BESIDE_RAD`]. They keep their distance; at most as many as there is room for beside the `already` generated ones.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn beside(
    scope: &Scope<'_>,
    params: &CandidateParams,
    views: &[&Candidate],
    already: usize,
    ctx: &Context<'_>,
) -> Result<CandidateSet, Cancelled> {
    let params = CandidateParams { tilts_deg: Vec::new(), standoffs_mm: vec![0.0], ..params.clone() };
    let room = max_candidates(scope.surface.sample_mm.len()).saturating_sub(already);
    let mut aims: Vec<Aim> = views.iter().take(MAX_LOOKED_BESIDE).flat_map(|view| aim::beside(scope, view)).collect();
    aims.truncate(room);
    judged(scope, &params, &aims, ctx)
}

/// Upper bound on the candidates beside so many views.
#[must_use]
pub(in crate::planning) fn expected_beside(views: f64) -> f64 {
    views.min(MAX_LOOKED_BESIDE as f64) * (4 * aim::BESIDE_RAD.len()) as f64
}

fn judged(scope: &Scope<'_>, params: &CandidateParams, aims: &[Aim], ctx: &Context<'_>) -> Result<CandidateSet, Cancelled> {
    let placed = aim::place(scope, aims, params, ctx)?;
    filter::judge(scope, params, placed, ctx)
}

/// A pose that the job gives.
fn given_pose(scope: &Scope<'_>, part_from_scanner: &Pose<Part, ScannerFrame>) -> Placed {
    let from_centre = part_from_scanner.origin_mm() - scope.surface.centre_mm;
    let label = Label::of_direction(&scope.table_from_part.direction(&from_centre));
    (scope.table_from_part * *part_from_scanner, label)
}

fn refuse_too_many(candidates: usize, scope: &Scope<'_>) -> Result<(), PlanError> {
    check_count(candidates, scope.surface.sample_mm.len())
}

/// Refuses more candidates than a job may have that has so many samples.
///
/// # Errors
/// [`PlanError::BadParams`].
pub(in crate::planning) fn check_count(candidates: usize, samples: usize) -> Result<(), PlanError> {
    if candidates <= max_candidates(samples) {
        return Ok(());
    }
    let (max_candidates, max_pairs) = (MAX_CANDIDATES, MAX_PAIRS);
    let too_many = Refusal::TooManyCandidates { candidates, samples, max_candidates, max_pairs };
    Err(PlanError::param("/candidates/strategies", &too_many))
}
