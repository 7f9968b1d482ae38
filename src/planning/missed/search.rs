//! Remedies in the order of their cost: what is left out chosen too, a candidate rolled, tilted, moved, the part turned
//! onto another side, limits raised. Of each kind some views are tried on the spot's samples; the first kind with at most
//! eight views that together measure half of the spot is the remedy. Every step runs over lists in a fixed order, so that
//! the answer is the same on any number of threads; nothing looks at a clock.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::look::Look;
use super::moves::{Moves, Proposal, Tried};
use super::remedy::{Remedy, RemedyKind, RemedyView};
use super::spots::{self, Spot};
use super::{bases, limit, opening};
use crate::cell::Scanner;
use crate::geometry::{Aabb, Mesh, Part, Pose, RayScene, ScannerFrame, Table};
use crate::planning::candidates::Candidate;
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::{Hemisphere, PlanParams};
use crate::planning::plan::{Cause, MissedCause, MissedSpot, Verdict};
use crate::planning::setups;
use crate::planning::surface::Surface;
use crate::planning::visibility::{Occluders, Optics, Probe, Row};

/// Share of a spot's area that a remedy measures at least.
const WORKS: f64 = 0.5;
/// A further view adds at least this share of the spot.
const WORTH_A_VIEW: f64 = 0.05;
/// Views of a remedy at most: each of a ring of views down a hole sees a part of its wall.
const VIEWS: usize = 8;
/// Views of one kind that the cell is asked for at most.
const ASKED_OF_CELL: usize = 24;

/// Whether the cell can take a view.
pub(in crate::planning) type Takes<'a> = dyn Fn(&Pose<Part, ScannerFrame>) -> Result<bool, Cancelled> + Sync + 'a;

/// A plan whose misses are looked into.
pub(in crate::planning) struct Case<'a> {
    pub(in crate::planning) mesh: &'a Mesh,
    pub(in crate::planning) surface: &'a Surface,
    pub(in crate::planning) scanner: &'a Scanner,
    pub(in crate::planning) params: &'a PlanParams,
    /// How the part lies in each setup.
    pub(in crate::planning) setups: &'a [Pose<Table, Part>],
    pub(in crate::planning) occluders: &'a Occluders,
    /// Those kept, with what each measures and whether it could have been chosen.
    pub(in crate::planning) candidates: &'a [Candidate],
    pub(in crate::planning) rows: &'a [Row],
    pub(in crate::planning) choosable: Vec<bool>,
    /// `None` without a cell.
    pub(in crate::planning) takes: Option<&'a Takes<'a>>,
}

/// Missed area by cause, in the order of [`Cause`], each in spots, largest first; the largest of all with remedies.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::planning) fn explain(
    case: &Case<'_>,
    verdicts: &[Verdict],
    ctx: &Context<'_>,
) -> Result<Vec<MissedCause>, Cancelled> {
    let spots = spots::find(case.mesh, case.surface, verdicts);
    let remedies = remedies(case, &spots, ctx)?;
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

/// For each spot its remedy, `None` for all but the largest.
fn remedies(case: &Case<'_>, spots: &[Spot], ctx: &Context<'_>) -> Result<Vec<Option<Remedy>>, Cancelled> {
    let mut largest: Vec<usize> = (0..spots.len()).collect();
    largest.sort_by(|a, b| spots[*b].area_mm2.total_cmp(&spots[*a].area_mm2));
    largest.truncate(case.params.missed.remedies as usize);
    if largest.is_empty() {
        return Ok(vec![None; spots.len()]);
    }
    let bench = Bench::new(case, ctx)?;
    let done = AtomicUsize::new(0);
    let found = largest.par_iter().map(|spot| {
        let remedy = Search::new(&bench, &spots[*spot], ctx).remedy()?;
        ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, largest.len());
        Ok((*spot, remedy))
    });
    let mut remedies = vec![None; spots.len()];
    for (spot, remedy) in found.collect::<Result<Vec<_>, Cancelled>>()? {
        remedies[spot] = Some(remedy);
    }
    Ok(remedies)
}

/// What every spot is tried with.
struct Bench<'a> {
    case: &'a Case<'a>,
    poses: Vec<Pose<Part, ScannerFrame>>,
    optics: Optics,
    widest: Optics,
    above_only: bool,
    /// Of the part.
    aabb: Aabb,
    /// The part without table and fixture.
    part_alone: RayScene,
    other_poses: OnceLock<Vec<Pose<Table, Part>>>,
}

impl<'a> Bench<'a> {
    fn new(case: &'a Case<'a>, ctx: &Context<'_>) -> Result<Self, Cancelled> {
        Ok(Self {
            case,
            poses: case.candidates.iter().map(|candidate| candidate.part_from_scanner).collect(),
            optics: Optics::new(case.scanner, case.params, &case.surface.requirements),
            widest: limit::widest(case),
            above_only: case.params.candidates.hemisphere == Some(Hemisphere::AboveTable),
            aabb: case.mesh.aabb(),
            part_alone: RayScene::interruptible([case.mesh], || ctx.check())?,
            other_poses: OnceLock::new(),
        })
    }

    /// Ways in which the part rests and that are not planned in, the likeliest first.
    fn other_poses(&self) -> &[Pose<Table, Part>] {
        self.other_poses.get_or_init(|| {
            let first = self.case.setups.first().copied().unwrap_or(Pose::identity());
            let mut poses = setups::pool(self.case.mesh, self.case.params, &first);
            poses.retain(|pose| !self.case.setups.contains(pose));
            poses
        })
    }

    /// Whether viewpoint and devices stand above the plate, the part lying like this.
    fn is_above(&self, table_from_part: &Pose<Table, Part>, pose: &Pose<Part, ScannerFrame>) -> bool {
        setups::is_above(pose, table_from_part, self.case.scanner)
    }

    /// Whether a candidate like this would have been kept.
    fn is_allowed(&self, pose: &Pose<Part, ScannerFrame>) -> bool {
        let above = |table_from_part: &Pose<Table, Part>| self.is_above(table_from_part, pose);
        (!self.above_only || self.case.setups.iter().any(above)) && self.is_outside(pose)
    }

    fn is_outside(&self, pose: &Pose<Part, ScannerFrame>) -> bool {
        let viewpoint = pose.origin_mm();
        !(self.aabb.holds(&viewpoint) && self.part_alone.encloses(&viewpoint))
    }
}

/// Views that together measure enough, best first: positions in a list.
type Pick = Vec<usize>;

struct Search<'a> {
    bench: &'a Bench<'a>,
    spot: &'a Spot,
    look: Look,
    ctx: &'a Context<'a>,
    tried: usize,
}

impl<'a> Search<'a> {
    fn new(bench: &'a Bench<'a>, spot: &'a Spot, ctx: &'a Context<'a>) -> Self {
        Self { bench, spot, look: Look::few(bench.case.surface, &spot.samples), ctx, tried: 0 }
    }

    fn remedy(mut self) -> Result<Remedy, Cancelled> {
        let (bench, rays) = (self.bench, self.bench.case.occluders.rays());
        let shortlist = bases::shortlist(&bench.poses, |_| true, &self.look, &bench.optics, rays, self.ctx)?;
        self.tried += shortlist.len();
        let bases = bases::choose(&shortlist);
        let moves = Moves { scanner: bench.case.scanner, poses: &bench.poses, bases: &bases, centre_mm: self.spot.centre_mm };
        if let Some(remedy) = self.left_out(&moves)? {
            return Ok(remedy);
        }
        let reach_mm = bench.case.scanner.best_mm;
        let openings = opening::directions_of(&self.look, rays, reach_mm);
        let mut tried = Vec::new();
        for kind in [RemedyKind::Roll, RemedyKind::Tilt, RemedyKind::Standoff] {
            let mut proposals = match kind {
                RemedyKind::Roll => moves.rolls(),
                RemedyKind::Tilt => moves.tilts(&openings),
                _ => moves.standoffs(&tried),
            };
            proposals.retain(|proposal| bench.is_allowed(&proposal.pose));
            let these = self.try_all(proposals, rays)?;
            if let Some(remedy) = self.first_that_works(kind, &these, rays, &moves)? {
                return Ok(remedy);
            }
            tried.extend(these);
        }
        if bench.above_only {
            let openings = opening::directions_of(&self.look, &bench.part_alone, reach_mm);
            let mut proposals = moves.setups(&openings);
            proposals.retain(|proposal| bench.is_outside(&proposal.pose));
            let these = self.try_all(proposals, &bench.part_alone)?;
            if let Some(remedy) = self.turned_over(&these, &moves)? {
                return Ok(remedy);
            }
        }
        Ok(self.raised_limit(&tried, &moves)?.unwrap_or_else(|| Remedy::none(self.tried)))
    }

    /// Candidates that measure it and could have been chosen.
    fn left_out(&self, moves: &Moves<'_>) -> Result<Option<Remedy>, Cancelled> {
        if self.spot.cause != Cause::NotChosen {
            return Ok(None);
        }
        let case = self.bench.case;
        let bits = |candidate: &usize| {
            let held = self.look.samples.iter().enumerate().filter(|(_, sample)| case.rows[*candidate].holds(**sample));
            held.fold(0_u64, |bits, (place, _)| bits | 1 << place)
        };
        let choosable: Vec<usize> = (0..case.candidates.len()).filter(|candidate| case.choosable[*candidate]).collect();
        let bits: Vec<u64> = choosable.iter().map(bits).collect();
        let Some(pick) = self.pick(&bits, |_| Ok(true))? else { return Ok(None) };
        let views: Vec<Proposal> = pick.iter().map(|i| moves.as_is(choosable[*i])).collect();
        Ok(self.confirmed(RemedyKind::View, &views, &self.bench.optics, case.occluders.rays(), moves))
    }

    fn try_all(&mut self, proposals: Vec<Proposal>, rays: &RayScene) -> Result<Vec<Tried>, Cancelled> {
        self.tried += proposals.len();
        let progress = |proposal: Proposal| {
            self.ctx.check()?;
            let progress = self.look.progress(&Probe::new(&self.bench.optics, &proposal.pose, rays));
            Ok(Tried { proposal, progress })
        };
        proposals.into_par_iter().map(progress).collect()
    }

    fn first_that_works(
        &self,
        kind: RemedyKind,
        tried: &[Tried],
        rays: &RayScene,
        moves: &Moves<'_>,
    ) -> Result<Option<Remedy>, Cancelled> {
        let bits: Vec<u64> = tried.iter().map(|tried| tried.progress.measured()).collect();
        let Some(pick) = self.pick(&bits, |i| self.is_taken(&tried[i].proposal))? else { return Ok(None) };
        let views: Vec<Proposal> = pick.iter().map(|i| tried[*i].proposal.clone()).collect();
        Ok(self.confirmed(kind, &views, &self.bench.optics, rays, moves))
    }

    /// In the first of the poses in which the part rests that lets views from above the plate measure enough.
    fn turned_over(&self, tried: &[Tried], moves: &Moves<'_>) -> Result<Option<Remedy>, Cancelled> {
        let bench = self.bench;
        for table_from_part in bench.other_poses() {
            let bits =
                |tried: &Tried| if bench.is_above(table_from_part, &tried.proposal.pose) { tried.progress.measured() } else { 0 };
            let bits: Vec<u64> = tried.iter().map(bits).collect();
            // Its stations are for a plan of that setup to find.
            let Some(pick) = self.pick(&bits, |_| Ok(true))? else { continue };
            let views: Vec<Proposal> = pick.iter().map(|i| tried[*i].proposal.clone()).collect();
            let remedy = self.confirmed(RemedyKind::Setup, &views, &bench.optics, &bench.part_alone, moves);
            if let Some(remedy) = remedy {
                return Ok(Some(Remedy { table_from_part: Some(*table_from_part), ..remedy }));
            }
        }
        Ok(None)
    }

    fn is_taken(&self, proposal: &Proposal) -> Result<bool, Cancelled> {
        self.bench.case.takes.map_or(Ok(true), |takes| takes(&proposal.pose))
    }

    /// Greedy over what each view measures of the few samples, among those that `accept` lets through; `None` when that
    /// is too little. Ties go to the first.
    fn pick(&self, bits: &[u64], mut accept: impl FnMut(usize) -> Result<bool, Cancelled>) -> Result<Option<Pick>, Cancelled> {
        let (mut pick, mut covered, mut refused) = (Pick::new(), 0, Vec::new());
        let enough = |bits: u64| self.look.area_mm2(bits) >= WORKS * self.look.total_mm2;
        if !enough(bits.iter().fold(0, |all, bits| all | bits)) {
            return Ok(None);
        }
        while pick.len() < VIEWS && refused.len() < ASKED_OF_CELL {
            let gain_mm2 = |i: usize| self.look.area_mm2(bits[i] & !covered);
            let open = (0..bits.len()).filter(|i| !refused.contains(i)).map(|i| (i, gain_mm2(i)));
            let best = open.fold((0, 0.0), |best, one| if one.1 > best.1 { one } else { best });
            if best.1 < WORTH_A_VIEW * self.look.total_mm2 {
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

    /// The views as a remedy, if they work at all samples too.
    fn confirmed(
        &self,
        kind: RemedyKind,
        views: &[Proposal],
        optics: &Optics,
        rays: &RayScene,
        moves: &Moves<'_>,
    ) -> Option<Remedy> {
        let look = Look::many(self.bench.case.surface, &self.spot.samples);
        let probes: Vec<Probe<'_>> = views.iter().map(|view| Probe::new(optics, &view.pose, rays)).collect();
        let added_mm2 = look.added_mm2(&probes);
        let area_mm2: f64 = added_mm2.iter().sum();
        let view = |(proposal, area_mm2): (&Proposal, f64)| RemedyView {
            candidate: self.bench.case.candidates[proposal.candidate].id,
            roll_rad: proposal.roll_rad,
            tilt_rad: proposal.tilt_rad,
            standoff_mm: moves.depth_mm(&proposal.pose),
            part_from_scanner: proposal.pose,
            area_mm2,
        };
        let of_spot = area_mm2 / look.total_mm2;
        (of_spot >= WORKS).then(|| Remedy {
            kind,
            views: views.iter().zip(added_mm2).map(view).collect(),
            table_from_part: None,
            camera_deg: None,
            projector_deg: None,
            area_mm2,
            of_spot,
            tried: self.tried,
        })
    }

    /// With candidates as they are, so that raising the limit is all there is to do; else with what was tried.
    fn raised_limit(&mut self, tried: &[Tried], moves: &Moves<'_>) -> Result<Option<Remedy>, Cancelled> {
        let (bench, rays) = (self.bench, self.bench.case.occluders.rays());
        let choosable = |candidate: usize| bench.case.choosable[candidate];
        let shortlist = bases::shortlist(&bench.poses, choosable, &self.look, &bench.widest, rays, self.ctx)?;
        let as_is: Vec<Proposal> = shortlist.iter().map(|(candidate, _)| moves.as_is(*candidate)).collect();
        self.tried += as_is.len();
        if let Some(remedy) = self.least_limit(&as_is, true, moves)? {
            return Ok(Some(remedy));
        }
        let moved: Vec<Proposal> = tried.iter().map(|tried| tried.proposal.clone()).collect();
        self.least_limit(&moved, false, moves)
    }

    fn least_limit(&self, proposals: &[Proposal], taken: bool, moves: &Moves<'_>) -> Result<Option<Remedy>, Cancelled> {
        let (bench, rays) = (self.bench, self.bench.case.occluders.rays());
        let needs = |proposal: &Proposal| {
            self.ctx.check()?;
            Ok(limit::Needs::of(&self.look, &Probe::new(&bench.widest, &proposal.pose, rays)))
        };
        let needs = proposals.par_iter().map(needs).collect::<Result<Vec<_>, Cancelled>>()?;
        let mut answers: Vec<Option<bool>> = vec![taken.then_some(true); proposals.len()];
        let limits_deg = limit::limits_deg(bench.case);
        for deg in limit::steps_deg(&limits_deg) {
            for raised in limit::options(&limits_deg, deg) {
                let bits: Vec<u64> = needs.iter().map(|needs| needs.measured(&raised)).collect();
                let accept = |i: usize| match answers[i] {
                    Some(answer) => Ok(answer),
                    None => self.is_taken(&proposals[i]).inspect(|answer| answers[i] = Some(*answer)),
                };
                let Some(pick) = self.pick(&bits, accept)? else { continue };
                let views: Vec<Proposal> = pick.iter().map(|i| proposals[*i].clone()).collect();
                let [camera_deg, _, projector_deg] = raised;
                let optics = Optics::new(
                    bench.case.scanner,
                    &limit::raised(bench.case, camera_deg, projector_deg),
                    &bench.case.surface.requirements,
                );
                let remedy = self.confirmed(RemedyKind::Limit, &views, &optics, rays, moves);
                if let Some(remedy) = remedy {
                    let changed = |device: usize| (raised[device] > limits_deg[device]).then_some(raised[device]);
                    return Ok(Some(Remedy { camera_deg: changed(0), projector_deg: changed(2), ..remedy }));
                }
            }
        }
        Ok(None)
    }
}
