//! Samples that views are chosen on: some of all samples, as many as size and shape of the part ask for, however finely it is
//! tessellated. Samples are grouped into strata: those in the same cell of a grid, with normals of the same bin and asked the same
//! of. Of each stratum some samples stand for all of it, at even steps of its area (systematic sampling: W. G. Cochran 1977,
//! *Sampling Techniques*, chapter 8). A feature that has a direction of its own keeps samples so, however small it is.
//!
//! Where views that were chosen turn out to miss samples of a stratum whose chosen samples they measure, samples among these are
//! added, and stand for the area that is missed ([`Strata::refine`]).
//!
//! Part frame, mm. Cost: O(samples); 4 bytes a sample, and 130 a chosen one.

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap};

use nalgebra::Vector3;

use super::{Patch, Surface};
use crate::geometry::parallel;
use crate::planning::ids::{PatchId, SampleId};

/// Samples that a part is chosen on by default, but for its size.
const SAMPLES: f64 = 8_000.0;
/// Area of a further sample, mm²: about the spacing at which a view of a large part is still told from its neighbours.
const AREA_OF_A_SAMPLE_MM2: f64 = 25.0;
/// Largest default number; that of parts that take many views.
pub(in crate::planning) const MAX_SAMPLES: f64 = 40_000.0;
/// Samples for each view below which views are hardly told apart: `tests/benches/PLANS.md`.
const SAMPLES_OF_A_VIEW: usize = 500;
/// Edge of a cell in distances of samples that lie evenly spread.
const CELL_OF_SPACING: f64 = 2.0;
/// Bins of a normal along each edge of a cube around it.
const BINS: f64 = 3.0;
/// Samples that a requirement of its own keeps at least, where it has them; a region of interest or a feature that has no more keeps all.
const MIN_OF_A_KIND: f64 = 2_000.0;
/// Share of all samples from which on all are taken.
const NEARLY_ALL: f64 = 0.7;
/// Samples, small features' among them, beside the number asked for: what parts of the data set have at most, and some more.
const EXPECTED_OF_ASKED: f64 = 2.0;
/// Samples that are added to a stratum at a time.
const ADDED: usize = 2;

/// Default number of samples to choose on.
#[must_use]
pub(in crate::planning) fn default_count(area_mm2: f64) -> f64 {
    (SAMPLES + area_mm2 / AREA_OF_A_SAMPLE_MM2).min(MAX_SAMPLES)
}

/// Returns true if so many samples are too few to tell so many views apart, and more may be taken.
#[must_use]
pub(in crate::planning) fn are_too_few(samples: usize, views: usize) -> bool {
    samples < SAMPLES_OF_A_VIEW * views && (samples as f64) < MAX_SAMPLES
}

/// Strata of the samples of a surface, with those of their samples that views are chosen on.
#[derive(Clone, Debug)]
pub(in crate::planning) struct Strata {
    /// Stratum of each sample of the whole surface.
    of_sample: Vec<u32>,
    /// Samples of each stratum in the surface that is chosen on.
    members: Vec<Vec<SampleId>>,
}

/// Samples that are grouped together.
#[derive(Clone, Copy, Default)]
struct Stratum {
    samples: u32,
    area_mm2: f64,
    kind: u16,
    /// True if all samples are kept, each with the area that it stands for.
    is_whole: bool,
}

/// Upper bound on the samples that views of a part are chosen on, where they are fewer than all.
#[must_use]
pub(in crate::planning) fn expected(asked: Option<u32>) -> f64 {
    EXPECTED_OF_ASKED * asked.map_or(MAX_SAMPLES, f64::from)
}

/// About `count` samples of `whole`, as a surface in which each has a patch of its own; `None` where that is nearly all of them.
#[must_use]
pub(in crate::planning) fn thinned(whole: &Surface, count: f64) -> Option<(Surface, Strata)> {
    let nearly_all = NEARLY_ALL * whole.sample_mm.len() as f64;
    if count >= nearly_all {
        return None;
    }
    let area_mm2 = whole.area_where(|_| true);
    let cell_mm = CELL_OF_SPACING * (area_mm2 / count).sqrt();
    let (of_sample, mut strata) = stratify(whole, cell_mm);
    keep_small_regions(whole, &mut strata);
    let picks = picks(whole, &of_sample, &strata, &takes(whole, &strata, count / area_mm2));
    if picks.len() as f64 >= nearly_all {
        return None;
    }
    let mut members = vec![Vec::new(); strata.len()];
    for (place, (sample, _)) in SampleId::number(&picks) {
        members[of_sample[sample.index()] as usize].push(place);
    }
    Some((whole.of_samples(&picks), Strata { of_sample, members }))
}

/// The asked samples of `whole` as a surface in which each has a patch of its own; about [`MAX_SAMPLES`] of all where they are more.
#[must_use]
pub(in crate::planning) fn asked_alone(whole: &Surface) -> Option<(Surface, Strata)> {
    let asked = whole.samples().filter(|sample| whole.asked[sample.index()]);
    let picks: Vec<(SampleId, f64)> = asked.map(|sample| (sample, whole.sample_area_mm2(sample))).collect();
    if picks.len() as f64 > MAX_SAMPLES {
        return thinned(whole, MAX_SAMPLES);
    }
    // No stratum stands for any other: none is ever refined.
    let strata = Strata { of_sample: vec![0; whole.sample_mm.len()], members: vec![SampleId::first(picks.len()).collect()] };
    Some((whole.of_samples(&picks), strata))
}

impl Strata {
    /// Adds samples of `whole` to `surface`, the one that is chosen on, where these disagree about some views: `is_measured` tells
    /// which samples of `surface` they measure, `missed` are the samples of `whole`, ascending, that they miss and other views
    /// measure. In every stratum that has both, samples that are missed take over area from those that are measured. Returns
    /// the samples that were added, ascending.
    pub(in crate::planning) fn refine(
        &mut self,
        surface: &mut Surface,
        whole: &Surface,
        is_measured: impl Fn(SampleId) -> bool,
        missed: &[SampleId],
    ) -> Vec<SampleId> {
        let mut missed_of: BTreeMap<u32, Vec<SampleId>> = BTreeMap::new();
        missed.iter().for_each(|sample| missed_of.entry(self.of_sample[sample.index()]).or_default().push(*sample));
        let mut added = Vec::new();
        for (stratum, missed) in missed_of {
            let members = self.members[stratum as usize].iter().copied();
            let (measured, open): (Vec<_>, Vec<_>) = members.partition(|member| is_measured(*member));
            let area_mm2 = |members: &[SampleId]| members.iter().map(|member| surface.sample_area_mm2(*member)).sum::<f64>();
            let missed_mm2: f64 = missed.iter().map(|sample| whole.sample_area_mm2(*sample)).sum();
            let measured_mm2 = area_mm2(&measured);
            let moved_mm2 = (missed_mm2 - area_mm2(&open)).min(measured_mm2);
            if moved_mm2 <= 0.0 {
                continue;
            }
            for member in measured {
                surface.patches[surface.sample_patch[member.index()].index()].area_mm2 *= 1.0 - moved_mm2 / measured_mm2;
            }
            let count = missed.len().min(ADDED);
            let picks = (0..count).map(|nth| missed[nth * missed.len() / count]);
            added.extend(picks.map(|sample| (sample, moved_mm2 / count as f64)));
        }
        added.sort_unstable_by_key(|(sample, _)| *sample);
        for (sample, area_mm2) in &added {
            self.members[self.of_sample[sample.index()] as usize].push(SampleId::at(surface.sample_mm.len()));
            surface.push_sample_of(whole, *sample, *area_mm2);
        }
        added.into_iter().map(|(sample, _)| sample).collect()
    }
}

impl Surface {
    fn push_sample_of(&mut self, whole: &Surface, sample: SampleId, area_mm2: f64) {
        let (patch, first_sample) = (PatchId::at(self.patches.len()), SampleId::at(self.sample_mm.len()));
        self.patches.push(Patch { area_mm2, first_sample, samples: 1, ..*whole.patch_of(sample) });
        self.sample_mm.push(whole.sample_mm[sample.index()]);
        self.sample_patch.push(patch);
        self.asked.push(whole.asked[sample.index()]);
        self.requirements.push_of(&whole.requirements, sample);
    }
}

/// Cell, bin of the normal, kind of requirement, and whether it is asked for.
type StratumKey = ([i32; 3], [i8; 3], u16, bool);

/// Stratum of each sample, and the strata in the order of their first samples.
fn stratify(whole: &Surface, cell_mm: f64) -> (Vec<u32>, Vec<Stratum>) {
    let key = |index: usize| -> (StratumKey, f64) {
        let sample = SampleId::at(index);
        let offset_mm: Vector3<f64> = whole.sample_mm[index] - whole.centre_mm;
        let cell = offset_mm.map(|mm| (mm / cell_mm).floor() as i32).into();
        let key = (cell, bin(&whole.patch_of(sample).normal), whole.requirements.kind(sample), whole.asked[index]);
        (key, whole.sample_area_mm2(sample))
    };
    let keys = parallel::map_range(whole.sample_mm.len(), key);
    let mut number_of: HashMap<StratumKey, u32> = HashMap::new();
    let mut strata: Vec<Stratum> = Vec::new();
    let mut last: Option<(StratumKey, u32)> = None;
    let stratum = |(key, area_mm2): (StratumKey, f64)| {
        // Neighbours are often of one stratum.
        let number = match last {
            Some((last, number)) if last == key => number,
            _ => *number_of.entry(key).or_insert_with(|| {
                strata.push(Stratum { kind: key.2, ..Stratum::default() });
                (strata.len() - 1) as u32
            }),
        };
        last = Some((key, number));
        let stratum = &mut strata[number as usize];
        stratum.samples += 1;
        stratum.area_mm2 += area_mm2;
        number
    };
    let stratum_of = keys.into_iter().map(stratum).collect();
    (stratum_of, strata)
}

/// Bin of a unit normal: the cell of a cube around it.
fn bin(normal: &Vector3<f64>) -> [i8; 3] {
    let on_cube = normal / normal.amax().max(f64::MIN_POSITIVE);
    on_cube.map(|x| ((x + 1.0) * 0.5 * BINS).floor().min(BINS - 1.0) as i8).into()
}

/// Area and number of the samples of each kind of requirement.
fn by_kind(whole: &Surface, strata: &[Stratum]) -> Vec<(f64, f64)> {
    let mut of_kind = vec![(0.0_f64, 0.0_f64); whole.requirements.kinds.len()];
    for stratum in strata {
        let (area_mm2, samples) = &mut of_kind[usize::from(stratum.kind)];
        *area_mm2 += stratum.area_mm2;
        *samples += f64::from(stratum.samples);
    }
    of_kind
}

/// Has the strata of regions of interest and features with few samples keep all of them.
fn keep_small_regions(whole: &Surface, strata: &mut [Stratum]) {
    let of_kind = by_kind(whole, strata);
    let is_whole = |kind: usize| !whole.requirements.kinds[kind].regions.is_empty() && of_kind[kind].1 <= MIN_OF_A_KIND;
    strata.iter_mut().for_each(|stratum| stratum.is_whole = is_whole(usize::from(stratum.kind)));
}

/// Samples that are taken of each stratum: by its area, at least one, and more where a requirement has little area.
fn takes(whole: &Surface, strata: &[Stratum], per_mm2: f64) -> Vec<u32> {
    let of_kind = by_kind(whole, strata);
    let density = |kind: u16| {
        let (area_mm2, samples) = of_kind[usize::from(kind)];
        let least = if kind == 0 { 0.0 } else { MIN_OF_A_KIND.min(samples) / area_mm2.max(f64::MIN_POSITIVE) };
        per_mm2.max(least)
    };
    let take = |stratum: &Stratum| {
        let by_area = (stratum.area_mm2 * density(stratum.kind)).round() as u32;
        if stratum.is_whole { stratum.samples } else { by_area.clamp(1, stratum.samples) }
    };
    strata.iter().map(take).collect()
}

/// The samples that are taken, ascending, with the area that each stands for.
fn picks(whole: &Surface, stratum_of: &[u32], strata: &[Stratum], takes: &[u32]) -> Vec<(SampleId, f64)> {
    /// Area passed so far, samples passed and taken.
    #[derive(Clone, Copy, Default)]
    struct Passed {
        area_mm2: f64,
        samples: u32,
        taken: u32,
    }
    let mut passed = vec![Passed::default(); strata.len()];
    let mut picks = Vec::new();
    for sample in whole.samples() {
        let number = stratum_of[sample.index()] as usize;
        let (stratum, take, passed) = (&strata[number], takes[number], &mut passed[number]);
        passed.area_mm2 += whole.sample_area_mm2(sample);
        passed.samples += 1;
        let due_mm2 = (f64::from(passed.taken) + 0.5) * stratum.area_mm2 / f64::from(take);
        // What is left is just enough: rounding may keep the last steps from being reached.
        let is_needed = stratum.samples - passed.samples < take - passed.taken.min(take);
        if passed.taken < take && (passed.area_mm2 >= due_mm2 || is_needed) {
            passed.taken += 1;
            let area_mm2 = if stratum.is_whole { whole.sample_area_mm2(sample) } else { stratum.area_mm2 / f64::from(take) };
            picks.push((sample, area_mm2));
        }
    }
    picks
}
