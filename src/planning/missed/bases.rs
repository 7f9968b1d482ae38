//! Bases of remedies: candidates that get furthest at a spot, between them at each of its samples.

use super::spot_samples::{FirstFailures, SpotSamples};
use crate::geometry::{Part, Pose, RayScene, ScannerFrame, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::CandidateIndex;
use crate::planning::visibility::{Optics, Probe};

/// Candidates that are looked at before any shadow; of more, so many evenly spaced ones.
const MAX_CONSIDERED: usize = 2048;
/// The furthest of them are looked at with shadows: so many where they are bases only, and where raised limits alone may do. Views down
/// a hole get no further before shadows than those that the hole's rim shadows.
pub(super) const OF_BASES: usize = 128;
pub(super) const OF_RAISED_LIMITS: usize = 1024;
/// Candidates that remedies start from.
const MAX_BASES: usize = 8;

/// Candidates that get furthest at a spot, `max` of them or fewer, furthest first; each with how far it gets. Ties go to the lower number.
pub(super) fn shortlist(
    poses: &[Pose<Part, ScannerFrame>],
    keep: impl Fn(CandidateIndex) -> bool + Sync,
    (samples, max): (&SpotSamples, usize),
    optics: &Optics,
    rays: &RayScene,
    ctx: &Context<'_>,
) -> Result<Vec<(CandidateIndex, FirstFailures)>, Cancelled> {
    let probe =
        |candidate: CandidateIndex| ctx.check().map(|()| Probe::new(optics, &poses[candidate.index()], rays, ctx.simd_level()));
    let spread = CandidateIndex::first(poses.len()).step_by(poses.len().div_ceil(MAX_CONSIDERED).max(1));
    let considered: Vec<_> = spread.filter(|candidate| keep(*candidate)).collect();
    let cheap = |candidate: &CandidateIndex| Ok((*candidate, samples.progress_before_shadow(&probe(*candidate)?)));
    let mut cheap = parallel::try_map::<_, _, Cancelled>(&considered, cheap)?;
    // Stable, like the next: ties stay in the order of candidates.
    cheap.sort_by_key(|(_, progress)| std::cmp::Reverse(*progress));
    cheap.truncate(max);
    let full = |(candidate, _): &(CandidateIndex, u32)| Ok((*candidate, samples.progress(&probe(*candidate)?)));
    let mut full = parallel::try_map::<_, _, Cancelled>(&cheap, full)?;
    full.sort_by_key(|(candidate, progress)| (std::cmp::Reverse(progress.sum()), *candidate));
    Ok(full)
}

/// The fewest of a shortlist, greedily, that between them get furthest at every sample; then the furthest overall.
pub(super) fn choose(shortlist: &[(CandidateIndex, FirstFailures)]) -> Vec<CandidateIndex> {
    let Some((first, rest)) = shortlist.split_first() else { return Vec::new() };
    let furthest = rest.iter().fold(first.1.clone(), |furthest, (_, progress)| furthest.or_further(progress));
    let as_far_as = |(candidate, progress): &(CandidateIndex, FirstFailures)| (*candidate, progress.as_far_as(&furthest));
    let mut left: Vec<(CandidateIndex, u64)> = shortlist.iter().map(as_far_as).collect();
    let (mut open, mut bases) = (u64::MAX, Vec::new());
    while bases.len() < MAX_BASES && !left.is_empty() {
        // Of equal ones the first, which gets furthest overall.
        let best = (1..left.len())
            .fold(0, |best, i| if (left[i].1 & open).count_ones() > (left[best].1 & open).count_ones() { i } else { best });
        let (candidate, bits) = left.remove(best);
        open &= !bits;
        bases.push(candidate);
    }
    bases
}
