//! Verdicts on a group of patches, by area: the common basis of the face table, the preview's bytes and the
//! pictures. Cost: O(samples) on all threads, few tallies in memory at a time, so that ten million faces need no gigabytes.

use rayon::prelude::*;

use crate::planning::plan::{Cause, Grade, Outcome, Verdict};
use crate::planning::surface::Patch;

#[cfg(test)]
mod tests;

/// Patches whose groups a thread tallies at once.
const PATCHES_A_RUN: usize = 4096;
const GRADES: [Grade; 4] = [Grade::A, Grade::B, Grade::C, Grade::D];

/// Areas of a group of patches, summed over samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Tally {
    /// Total area.
    pub(crate) area_mm2: f64,
    /// Area not asked for.
    pub(crate) not_asked_mm2: f64,
    grade_mm2: [f64; GRADES.len()],
    cause_mm2: [f64; Cause::ALL.len()],
}

impl Tally {
    fn add(&mut self, verdict: Verdict, area_mm2: f64) {
        self.area_mm2 += area_mm2;
        match verdict {
            Verdict::Measured(grade) => self.grade_mm2[grade as usize] += area_mm2,
            Verdict::Missed(cause) => self.cause_mm2[cause as usize] += area_mm2,
            Verdict::NotAsked => self.not_asked_mm2 += area_mm2,
        }
    }

    /// Adds a patch; each of its samples stands for an equal share of its area.
    pub(crate) fn add_patch(&mut self, patch: &Patch, verdicts: &[Verdict]) {
        let share_mm2 = patch.area_mm2 / f64::from(patch.samples);
        let first = patch.first_sample.index();
        for verdict in &verdicts[first..first + patch.samples as usize] {
            self.add(*verdict, share_mm2);
        }
    }

    /// Measured area.
    pub(crate) fn measured_mm2(&self) -> f64 {
        self.grade_mm2.iter().sum()
    }

    /// Asked area that is not measured.
    pub(crate) fn missed_mm2(&self) -> f64 {
        self.cause_mm2.iter().sum()
    }

    /// Grade of most of the measured area; the better one on ties.
    pub(crate) fn grade(&self) -> Option<Grade> {
        largest(&self.grade_mm2).map(|index| GRADES[index])
    }

    /// Cause of most of the missed area; the earlier one on ties.
    pub(crate) fn cause(&self) -> Option<Cause> {
        largest(&self.cause_mm2).map(|index| Cause::ALL[index])
    }

    /// Verdict on most of the area: first asked or not, then measured or missed, then grade or cause.
    pub(crate) fn majority(&self) -> Verdict {
        let measured_or_missed = if self.measured_mm2() >= self.missed_mm2() {
            self.grade().map(Verdict::Measured)
        } else {
            self.cause().map(Verdict::Missed)
        };
        match measured_or_missed {
            Some(verdict) if 2.0 * self.not_asked_mm2 <= self.area_mm2 => verdict,
            _ => Verdict::NotAsked,
        }
    }
}

/// Index of the largest positive entry; the first on ties.
fn largest(areas_mm2: &[f64]) -> Option<usize> {
    let better = |best: Option<usize>, index: usize| match best {
        Some(other) if areas_mm2[other] >= areas_mm2[index] => best,
        _ if areas_mm2[index] > 0.0 => Some(index),
        _ => best,
    };
    (0..areas_mm2.len()).fold(None, better)
}

/// Consecutive groups that have patches, with the number of the group before them.
pub(crate) struct GroupRun {
    /// Number after that of the group before the first; 0 where there is none.
    pub(crate) begin: u32,
    /// Number and tally of each, ascending.
    pub(crate) groups: Vec<(u32, Tally)>,
}

/// Results of `work` for runs of groups, which follow each other in ascending order of their numbers.
pub(crate) fn of_groups<R: Send>(
    outcome: &Outcome,
    group_of: impl Fn(&Patch) -> u32 + Sync,
    work: impl Fn(GroupRun) -> R + Sync,
) -> Vec<R> {
    of_groups_of(&outcome.surface.patches, &outcome.verdicts, group_of, work)
}

fn of_groups_of<R: Send>(
    patches: &[Patch],
    verdicts: &[Verdict],
    group_of: impl Fn(&Patch) -> u32 + Sync,
    work: impl Fn(GroupRun) -> R + Sync,
) -> Vec<R> {
    let mut order: Vec<(u32, u32)> = patches.par_iter().map(&group_of).zip(0..patches.len() as u32).collect();
    // Patches are mostly in this order already, which this sort handles in one pass.
    order.sort();
    let tally = |run: &[(u32, u32)]| {
        let mut tally = Tally::default();
        run.iter().for_each(|(_, patch)| tally.add_patch(&patches[*patch as usize], verdicts));
        (run[0].0, tally)
    };
    let of_run = |begin: usize| {
        let [first, end] = [begin, begin + PATCHES_A_RUN].map(|place| first_of_a_group(&order, place));
        let groups: Vec<(u32, Tally)> = order[first..end].chunk_by(|a, b| a.0 == b.0).map(tally).collect();
        if groups.is_empty() {
            return None;
        }
        let begin = first.checked_sub(1).map_or(0, |before| order[before].0 + 1);
        Some(work(GroupRun { begin, groups }))
    };
    let begins: Vec<usize> = (0..order.len()).step_by(PATCHES_A_RUN).collect();
    begins.into_par_iter().filter_map(of_run).collect()
}

/// First place from `place` on at which a group begins, or the end.
fn first_of_a_group(order: &[(u32, u32)], place: usize) -> usize {
    if place == 0 || place >= order.len() {
        return place.min(order.len());
    }
    let before = order[place - 1].0;
    place + order[place..].partition_point(|(group, _)| *group == before)
}
