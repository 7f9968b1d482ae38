//! Remedies in the order of their cost: what is left out chosen too, a candidate rolled, tilted, moved, the part turned
//! onto another side, limits raised that the job had tightened. Of each kind some views are tried on the spot's samples; the
//! first kind with at most eight views that together measure nine tenths of the spot is the remedy. Where there is none, the
//! first that measures half of it is. Every step runs over lists in a fixed order, so that the answer is the same on any number
//! of threads; nothing looks at a clock.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::fallback::Fallback;
use super::limit::{LimitRange, Needs};
use super::proposals::{Proposal, ProposalSource, Tried};
use super::spot_samples::SpotSamples;
use super::spots::{self, Spot};
use super::{bases, opening};
use crate::cell::Scanner;
use crate::geometry::{Aabb, Mesh, Part, Pose, RayScene, ScannerFrame, Table, parallel, sort_descending};
use crate::planning::candidates::CandidateSet;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::CandidateIndex;
use crate::planning::params::{Hemisphere, PlanParams};
use crate::planning::plan::{Cause, MissedCause, MissedSpot, Remedy, RemedyKind, RemedyView, Turn, Verdict};
use crate::planning::problem::SampledPart;
use crate::planning::scene::PlanInput;
use crate::planning::setups;
use crate::planning::surface::Surface;
use crate::planning::visibility::{Occluders, Optics, Probe, Row};

/// A further view adds at least this share of the spot.
const MIN_VIEW_SHARE: f64 = 0.05;
/// Views of a remedy at most: each of a ring of views down a hole sees a part of its wall.
const MAX_VIEWS: usize = 8;
/// Views of one kind that the cell is asked for at most.
const MAX_EXECUTION_CHECKS: usize = 24;
/// Views that the cell may refuse for the largest spot, over all kinds; for the n-th one an n-th of that. A search for a path that there
/// is not takes tenths of a second.
const MAX_REFUSALS: usize = 32;
/// Views that it may refuse for any spot.
const MIN_REFUSALS: usize = 3;

/// Returns true if the cell can execute a view.
pub(in crate::planning) type CanExecute<'a> = dyn Fn(&Pose<Part, ScannerFrame>) -> Result<bool, Cancelled> + Sync + 'a;

/// Returns true if a path leads to a candidate, from the stations at which it is taken.
pub(in crate::planning) type HasPath<'a> = dyn Fn(CandidateIndex) -> Result<bool, Cancelled> + Sync + 'a;

/// A plan whose misses are looked into.
pub(in crate::planning) struct MissAnalysis<'a> {
    pub(in crate::planning) input: &'a PlanInput<'a>,
    pub(in crate::planning) sampled: &'a SampledPart,
    pub(in crate::planning) mesh: &'a Mesh,
    pub(in crate::planning) surface: &'a Surface,
    pub(in crate::planning) scanner: &'a Scanner,
    pub(in crate::planning) params: &'a PlanParams,
    /// Pose of the part in each setup.
    pub(in crate::planning) setups: &'a [Pose<Table, Part>],
    /// Pose of the part in the first setup that views are chosen in.
    pub(in crate::planning) first: Pose<Table, Part>,
    pub(in crate::planning) occluders: &'a Occluders,
    /// The part without table and fixture.
    pub(in crate::planning) part_alone: &'a RayScene,
    pub(in crate::planning) candidates: &'a CandidateSet,
    /// Samples that each candidate measures.
    pub(in crate::planning) rows: &'a [Row],
    /// True for candidates that could have been chosen.
    pub(in crate::planning) choosable: Vec<bool>,
    /// Checks of the cell; `None` without one.
    pub(in crate::planning) can_execute: Option<&'a CanExecute<'a>>,
    /// Checks of the cell for candidates as they are; not asked without one.
    pub(in crate::planning) has_path: &'a HasPath<'a>,
}

/// Missed area by cause, in the order of [`Cause`], each in spots, largest first; the largest of all with remedies.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn explain(
    analysis: &MissAnalysis<'_>,
    verdicts: &[Verdict],
    ctx: &Context<'_>,
) -> Result<Vec<MissedCause>, Cancelled> {
    let spots = spots::find(analysis.mesh, analysis.surface, verdicts);
    let remedies = remedies(analysis, &spots, ctx)?;
    let mut missed: Vec<MissedCause> = Vec::new();
    for (spot, remedy) in spots.into_iter().zip(remedies) {
        if missed.last().is_none_or(|last| last.cause != spot.cause) {
            missed.push(MissedCause { cause: spot.cause, area_mm2: 0.0, spots: Vec::new() });
        }
        let Some(last) = missed.last_mut() else { continue };
        last.area_mm2 += spot.area_mm2;
        let Spot { area_mm2, centre_mm, extent_mm, source_faces, .. } = spot;
        last.spots.push(MissedSpot { area_mm2, centre_mm, extent_mm, source_faces, remedy });
    }
    Ok(missed)
}

/// Finds the remedy of each spot, `None` for all but the largest.
fn remedies(analysis: &MissAnalysis<'_>, spots: &[Spot], ctx: &Context<'_>) -> Result<Vec<Option<Remedy>>, Cancelled> {
    // Views that would measure what is at risk there are: more of the kind do not help.
    let mut largest: Vec<usize> = (0..spots.len()).filter(|spot| spots[*spot].cause != Cause::AtRisk).collect();
    sort_descending(&mut largest, |spot| spots[*spot].area_mm2);
    largest.truncate(analysis.params.missed.remedies as usize);
    if largest.is_empty() {
        return Ok(vec![None; spots.len()]);
    }
    let context = RemedyContext::new(analysis, ctx)?;
    let done = AtomicUsize::new(0);
    let ranked: Vec<(usize, usize)> = largest.into_iter().enumerate().collect();
    let found = parallel::try_map(&ranked, |(rank, spot)| {
        let max_refusals = (MAX_REFUSALS / (rank + 1)).max(MIN_REFUSALS);
        let remedy = RemedySearch::new(&context, &spots[*spot], max_refusals, ctx).remedy()?;
        ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, ranked.len());
        Ok::<_, Cancelled>((*spot, remedy))
    })?;
    let mut remedies = vec![None; spots.len()];
    for (spot, remedy) in found {
        remedies[spot] = Some(remedy);
    }
    Ok(remedies)
}

/// Context that the search for remedies shares between spots.
struct RemedyContext<'a> {
    analysis: &'a MissAnalysis<'a>,
    /// Pose of each candidate.
    poses: Vec<Pose<Part, ScannerFrame>>,
    optics: Optics,
    limits: LimitRange,
    /// Optics with the largest limits that the job may give.
    widest: Optics,
    above_only: bool,
    /// Box of the part.
    aabb: Aabb,
    /// The part without table and fixture.
    part_alone: &'a RayScene,
    /// Ways in which the part rests and that are not planned in, the likeliest first. None where views need not be above the
    /// plate.
    other_poses: Vec<Pose<Table, Part>>,
}

impl<'a> RemedyContext<'a> {
    fn new(analysis: &'a MissAnalysis<'a>, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let limits = LimitRange::of(analysis.scanner, &analysis.params.limits);
        let MissAnalysis { input, sampled, setups, .. } = analysis;
        let above_only = analysis.params.candidates.hemisphere == Some(Hemisphere::AboveTable);
        let resting = if above_only { sampled.resting_poses(input, ctx)? } else { &[] };
        Ok(Self {
            analysis,
            poses: analysis.candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect(),
            optics: Optics::new(analysis.scanner, analysis.params, &analysis.surface.requirements),
            widest: limits.optics(analysis, &limits.widest_deg()),
            limits,
            above_only,
            aabb: analysis.mesh.aabb(),
            part_alone: analysis.part_alone,
            other_poses: resting.iter().filter(|pose| !setups.contains(pose)).copied().collect(),
        })
    }

    /// Returns true if viewpoint and devices stand above the plate, the part lying like this.
    fn is_above(&self, table_from_part: &Pose<Table, Part>, pose: &Pose<Part, ScannerFrame>) -> bool {
        setups::is_above(pose, table_from_part, self.analysis.scanner, self.analysis.params.candidates.min_elevation_deg)
    }

    /// Returns true if a candidate like this would not have been dropped.
    fn is_allowed(&self, pose: &Pose<Part, ScannerFrame>) -> bool {
        let above = |table_from_part: &Pose<Table, Part>| self.is_above(table_from_part, pose);
        (!self.above_only || self.analysis.setups.iter().any(above)) && self.is_outside(pose)
    }

    fn is_outside(&self, pose: &Pose<Part, ScannerFrame>) -> bool {
        let viewpoint = pose.origin_mm();
        !(self.aabb.holds(&viewpoint) && self.part_alone.encloses(&viewpoint))
    }
}

/// Views that together measure enough, best first: positions in a list.
type Pick = Vec<usize>;

struct RemedySearch<'a> {
    context: &'a RemedyContext<'a>,
    spot: &'a Spot,
    samples: SpotSamples,
    ctx: &'a Context<'a>,
    tried: usize,
    /// Views that the cell has refused.
    refusals: AtomicUsize,
    max_refusals: usize,
    fallback: Fallback,
}

impl<'a> RemedySearch<'a> {
    fn new(context: &'a RemedyContext<'a>, spot: &'a Spot, max_refusals: usize, ctx: &'a Context<'a>) -> Self {
        let samples = SpotSamples::few(context.analysis.surface, &spot.samples);
        let (refusals, fallback) = (AtomicUsize::new(0), Fallback::default());
        Self { context, spot, samples, ctx, tried: 0, refusals, max_refusals, fallback }
    }

    fn remedy(mut self) -> Result<Remedy, Cancelled> {
        let (context, rays) = (self.context, self.context.analysis.occluders.rays());
        let shortlist =
            bases::shortlist(&context.poses, |_| true, (&self.samples, bases::OF_BASES), &context.optics, rays, self.ctx)?;
        self.tried += shortlist.len();
        let bases = bases::choose(&shortlist);
        let source = ProposalSource {
            scanner: context.analysis.scanner,
            poses: &context.poses,
            bases: &bases,
            centre_mm: self.spot.centre_mm,
        };
        if let Some(remedy) = self.left_out(&source)? {
            return Ok(remedy);
        }
        let reach_mm = context.analysis.scanner.best_mm;
        let openings = opening::directions_of(&self.samples, rays, reach_mm, self.ctx.simd_level());
        let mut tried = Vec::new();
        if let Some(remedy) = self.moved(RemedyKind::Roll, source.rolls(), &mut tried, &source)? {
            return Ok(remedy);
        }
        if let Some(remedy) = self.moved(RemedyKind::Tilt, source.tilts(&openings), &mut tried, &source)? {
            return Ok(remedy);
        }
        if let Some(remedy) = self.moved(RemedyKind::Standoff, source.standoffs(&tried), &mut tried, &source)? {
            return Ok(remedy);
        }
        // Rolled, tilted and moved ones together may do what those of one kind do not.
        if let Some(remedy) = self.first_that_works(RemedyKind::Standoff, &tried, rays, &source)? {
            return Ok(remedy);
        }
        if context.above_only {
            let openings = opening::directions_of(&self.samples, context.part_alone, reach_mm, self.ctx.simd_level());
            let mut proposals = source.setups(&openings);
            proposals.retain(|proposal| context.is_outside(&proposal.pose));
            let these = self.try_all(proposals, context.part_alone)?;
            if let Some(remedy) = self.turned_over(&these, &source)? {
                return Ok(remedy);
            }
        }
        let raised = if context.limits.can_raise() { self.raised_limit(&tried, &source)? } else { None };
        Ok(raised.unwrap_or_else(|| self.fallback.into_remedy(self.tried)))
    }

    /// Candidates that measure it and could have been chosen. They have stations, but a path is known to those alone that were
    /// chosen: the cell is asked for a path to the ones that would be told.
    fn left_out(&mut self, source: &ProposalSource<'_>) -> Result<Option<Remedy>, Cancelled> {
        if self.spot.cause != Cause::NotChosen {
            return Ok(None);
        }
        let analysis = self.context.analysis;
        let bits = |candidate: &CandidateIndex| {
            let held = self.samples.ids.iter().enumerate().filter(|(_, sample)| analysis.rows[candidate.index()].holds(**sample));
            held.fold(0_u64, |bits, (place, _)| bits | 1 << place)
        };
        let choosable: Vec<CandidateIndex> =
            analysis.candidates.indices().filter(|candidate| analysis.choosable[candidate.index()]).collect();
        let bits: Vec<u64> = choosable.iter().map(bits).collect();
        let has_path = |i: usize| match analysis.can_execute {
            Some(_) if !self.may_ask() => Ok(false),
            Some(_) => Ok(self.counted((analysis.has_path)(choosable[i])?)),
            None => Ok(true),
        };
        let Some(pick) = self.pick(&bits, has_path)? else { return Ok(None) };
        let views: Vec<Proposal> = pick.iter().map(|i| source.as_is(choosable[*i])).collect();
        let remedy = self.confirmed(RemedyKind::View, &views, &self.context.optics, analysis.occluders.rays(), source);
        Ok(self.fallback.unless_works(remedy))
    }

    /// Finds a remedy of one kind among candidates that were moved; what was tried without success joins `tried`.
    fn moved(
        &mut self,
        kind: RemedyKind,
        mut proposals: Vec<Proposal>,
        tried: &mut Vec<Tried>,
        source: &ProposalSource<'_>,
    ) -> Result<Option<Remedy>, Cancelled> {
        let (context, rays) = (self.context, self.context.analysis.occluders.rays());
        proposals.retain(|proposal| context.is_allowed(&proposal.pose));
        let these = self.try_all(proposals, rays)?;
        let remedy = self.first_that_works(kind, &these, rays, source)?;
        tried.extend(these);
        Ok(remedy)
    }

    fn probe<'p>(&self, optics: &'p Optics, pose: &Pose<Part, ScannerFrame>, rays: &'p RayScene) -> Probe<'p> {
        Probe::new(optics, pose, rays, self.ctx.simd_level())
    }

    fn try_all(&mut self, proposals: Vec<Proposal>, rays: &RayScene) -> Result<Vec<Tried>, Cancelled> {
        self.tried += proposals.len();
        let progress = |proposal: Proposal| {
            self.ctx.check()?;
            let progress = self.samples.progress(&self.probe(&self.context.optics, &proposal.pose, rays));
            Ok(Tried { proposal, progress })
        };
        proposals.into_par_iter().map(progress).collect()
    }

    fn first_that_works(
        &mut self,
        kind: RemedyKind,
        tried: &[Tried],
        rays: &RayScene,
        source: &ProposalSource<'_>,
    ) -> Result<Option<Remedy>, Cancelled> {
        let bits: Vec<u64> = tried.iter().map(|tried| tried.progress.measured()).collect();
        let Some(pick) = self.pick(&bits, |i| self.can_execute(&tried[i].proposal))? else { return Ok(None) };
        let views: Vec<Proposal> = pick.iter().map(|i| tried[*i].proposal.clone()).collect();
        let remedy = self.confirmed(kind, &views, &self.context.optics, rays, source);
        Ok(self.fallback.unless_works(remedy))
    }

    /// Finds a remedy in the first of the part's other resting poses that lets views from above the plate measure enough.
    fn turned_over(&mut self, tried: &[Tried], source: &ProposalSource<'_>) -> Result<Option<Remedy>, Cancelled> {
        let context = self.context;
        for table_from_part in &context.other_poses {
            let bits = |tried: &Tried| {
                if context.is_above(table_from_part, &tried.proposal.pose) { tried.progress.measured() } else { 0 }
            };
            let bits: Vec<u64> = tried.iter().map(bits).collect();
            // Its stations are for a plan of that setup to find.
            let Some(pick) = self.pick(&bits, |_| Ok(true))? else { continue };
            let views: Vec<Proposal> = pick.iter().map(|i| tried[*i].proposal.clone()).collect();
            let remedy = self.confirmed(RemedyKind::Setup, &views, &context.optics, context.part_alone, source);
            let turn = Some(Turn::between(&context.analysis.first, table_from_part));
            let remedy = remedy.map(|remedy| Remedy { table_from_part: Some(*table_from_part), turn, ..remedy });
            if let Some(remedy) = self.fallback.unless_works(remedy) {
                return Ok(Some(remedy));
            }
        }
        Ok(None)
    }

    fn can_execute(&self, proposal: &Proposal) -> Result<bool, Cancelled> {
        match self.context.analysis.can_execute {
            Some(_) if !self.may_ask() => Ok(false),
            Some(can_execute) => Ok(self.counted(can_execute(&proposal.pose)?)),
            None => Ok(true),
        }
    }

    /// Returns true while the cell is asked: after too many refusals nothing more of this spot can be executed, as far as is known.
    fn may_ask(&self) -> bool {
        self.refusals.load(Ordering::Relaxed) < self.max_refusals
    }

    /// The answer of the cell, counted where it refuses.
    fn counted(&self, accepts: bool) -> bool {
        self.refusals.fetch_add(usize::from(!accepts), Ordering::Relaxed);
        accepts
    }

    /// Greedy over what each view measures of the few samples, among those that `accept` lets through; `None` when that
    /// is too little. Ties go to the first.
    fn pick(&self, bits: &[u64], mut accept: impl FnMut(usize) -> Result<bool, Cancelled>) -> Result<Option<Pick>, Cancelled> {
        let (mut pick, mut covered, mut refused) = (Pick::new(), 0, Vec::new());
        let enough = |bits: u64| self.samples.area_mm2(bits) >= self.fallback.wanted_share() * self.samples.total_mm2;
        if !enough(bits.iter().fold(0, |all, bits| all | bits)) {
            return Ok(None);
        }
        while pick.len() < MAX_VIEWS && refused.len() < MAX_EXECUTION_CHECKS {
            let gain_mm2 = |i: usize| self.samples.area_mm2(bits[i] & !covered);
            let open = (0..bits.len()).filter(|i| !refused.contains(i)).map(|i| (i, gain_mm2(i)));
            let best = open.fold((0, 0.0), |best, one| if one.1 > best.1 { one } else { best });
            if best.1 < MIN_VIEW_SHARE * self.samples.total_mm2 {
                break;
            }
            if accept(best.0)? {
                covered |= bits[best.0];
                pick.push(best.0);
            } else {
                refused.push(best.0);
            }
        }
        Ok(enough(covered).then_some(pick))
    }

    /// The views as a remedy, if they measure enough to be one of all samples too.
    fn confirmed(
        &self,
        kind: RemedyKind,
        views: &[Proposal],
        optics: &Optics,
        rays: &RayScene,
        source: &ProposalSource<'_>,
    ) -> Option<Remedy> {
        let samples = SpotSamples::many(self.context.analysis.surface, &self.spot.samples);
        let probes: Vec<Probe<'_>> = views.iter().map(|view| self.probe(optics, &view.pose, rays)).collect();
        let added_mm2 = samples.added_mm2(&probes);
        let area_mm2: f64 = added_mm2.iter().sum();
        let view = |(proposal, area_mm2): (&Proposal, f64)| RemedyView {
            candidate: self.context.analysis.candidates[proposal.candidate].id,
            roll_rad: proposal.roll_rad,
            tilt_rad: proposal.tilt_rad,
            standoff_mm: source.depth_mm(&proposal.pose),
            part_from_scanner: proposal.pose,
            area_mm2,
        };
        let of_spot = area_mm2 / samples.total_mm2;
        (of_spot >= Fallback::MIN_SHARE).then(|| Remedy {
            kind,
            views: views.iter().zip(added_mm2).map(view).collect(),
            table_from_part: None,
            turn: None,
            camera_deg: None,
            projector_deg: None,
            area_mm2,
            of_spot,
            tried: self.tried,
        })
    }

    /// Finds a remedy by raised limits: with candidates as they are, so that raising is all there is to do; else with the views
    /// tried.
    fn raised_limit(&mut self, tried: &[Tried], source: &ProposalSource<'_>) -> Result<Option<Remedy>, Cancelled> {
        let (context, rays) = (self.context, self.context.analysis.occluders.rays());
        let choosable = |candidate: CandidateIndex| context.analysis.choosable[candidate.index()];
        let shortlist = bases::shortlist(
            &context.poses,
            choosable,
            (&self.samples, bases::OF_RAISED_LIMITS),
            &context.widest,
            rays,
            self.ctx,
        )?;
        let as_is: Vec<Proposal> = shortlist.iter().map(|(candidate, _)| source.as_is(*candidate)).collect();
        self.tried += as_is.len();
        if let Some(remedy) = self.smallest_limit(&as_is, source)? {
            return Ok(Some(remedy));
        }
        let moved: Vec<Proposal> = tried.iter().map(|tried| tried.proposal.clone()).collect();
        self.smallest_limit(&moved, source)
    }

    fn smallest_limit(&mut self, proposals: &[Proposal], source: &ProposalSource<'_>) -> Result<Option<Remedy>, Cancelled> {
        let (context, rays) = (self.context, self.context.analysis.occluders.rays());
        let needs = |proposal: &Proposal| {
            self.ctx.check()?;
            Ok(Needs::of(&self.samples, &self.probe(&context.widest, &proposal.pose, rays)))
        };
        let needs = parallel::try_map::<_, _, Cancelled>(proposals, needs)?;
        let mut answers: Vec<Option<bool>> = vec![None; proposals.len()];
        // Few samples that views last measured which did not do on all samples.
        let mut refuted = None;
        for limits_deg in context.limits.steps_deg() {
            let bits: Vec<u64> = needs.iter().map(|needs| needs.measured(&limits_deg)).collect();
            let accept = |i: usize| match answers[i] {
                Some(answer) => Ok(answer),
                None => self.can_execute(&proposals[i]).inspect(|answer| answers[i] = Some(*answer)),
            };
            let Some(pick) = self.pick(&bits, accept)? else { continue };
            let covered = pick.iter().fold(0, |covered, i| covered | bits[*i]);
            if refuted.replace(covered) == Some(covered) {
                continue;
            }
            let views: Vec<Proposal> = pick.iter().map(|i| proposals[*i].clone()).collect();
            let optics = context.limits.optics(context.analysis, &limits_deg);
            let (camera_deg, projector_deg) = context.limits.changed(&limits_deg);
            let remedy = self.confirmed(RemedyKind::Limit, &views, &optics, rays, source);
            let remedy = remedy.map(|remedy| Remedy { camera_deg, projector_deg, ..remedy });
            if let Some(remedy) = self.fallback.unless_works(remedy) {
                return Ok(Some(remedy));
            }
        }
        Ok(None)
    }
}
