//! Gain of a candidate at a point of the selection: G_v = a·G_c + b·G_q over the open samples
//! ([`crate::planning::method::quality`]), or plain area, less the cost of its time. Sums run in an order that the samples'
//! numbers alone decide, so that they do not depend on threads. Cost: a pass over the row's words and the open samples in them.

use super::CoverProblem;
use crate::geometry::{Kernel, SimdLevel};
use crate::planning::ids::{RowIndex, SampleId};
use crate::planning::params::{Objective, ScoreParams, SelectionParams};
use crate::planning::visibility::{QualityScale, Row, SampleSet, ones};

/// Partial sums: sample s belongs to sum s mod 8.
const LANES: usize = 8;

/// Scores candidates.
pub(super) struct Scorer<'a> {
    pub(super) problem: &'a CoverProblem<'a>,
    objective: Objective,
    weights: &'a ScoreParams,
    cost_mm2_per_s: f64,
    pub(super) level: SimdLevel,
}

impl<'a> Scorer<'a> {
    pub(super) fn new(
        problem: &'a CoverProblem<'a>,
        params: &SelectionParams,
        weights: &'a ScoreParams,
        level: SimdLevel,
    ) -> Self {
        Self { problem, objective: params.objective, weights, cost_mm2_per_s: params.view_cost_mm2_per_s, level }
    }

    /// Returns a scorer by plain area, without the cost of time.
    pub(super) fn by_area(&self) -> Self {
        Self { objective: Objective::Coverage, cost_mm2_per_s: 0.0, ..*self }
    }

    /// Scale and steps of a row's quality, where the score counts it.
    fn quality(&self, row: RowIndex) -> Option<(QualityScale, &'a [i16])> {
        let counts = self.objective == Objective::Score && self.weights.b > 0.0;
        self.problem.row(row).quality().filter(|_| counts)
    }

    /// Returns true if a row's score without travel can only fall as samples are closed: where no sample counts less than
    /// nothing. That holds to the last bit, since a sum in a fixed order never grows when some of its terms become 0.
    pub(super) fn scores_only_fall(&self, row: RowIndex) -> bool {
        self.quality(row).is_none_or(|(scale, _)| self.weights.a >= self.weights.b * f64::from(scale.max()))
    }

    /// Score of a row over `open`, less the time of the view itself.
    pub(super) fn score(&self, row: RowIndex, open: &Uncovered) -> f64 {
        self.gross_score(row, open) - self.cost_mm2_per_s * self.problem.view_secs
    }

    fn gross_score(&self, row: RowIndex, open: &Uncovered) -> f64 {
        let measured = self.problem.row(row);
        match (self.objective, self.quality(row)) {
            // Weights in whole steps: what is of the worst quality is then worth exactly 0 when a = b (c + d).
            (_, Some((scale, steps))) => {
                let whole = f64::from(i16::MAX);
                open.sum(measured, steps, self.weights.a * whole, self.weights.b * f64::from(scale.max())) / whole
            }
            (Objective::Score, None) => self.weights.a * open.area_mm2(measured),
            (Objective::Coverage, None) => open.area_mm2(measured),
        }
    }

    /// Cost of the travel from the nearest of `chosen` to `row`.
    pub(super) fn travel_cost_mm2(&self, row: RowIndex, chosen: &[RowIndex]) -> f64 {
        let Some(travel_secs) = self.problem.travel_secs.filter(|_| self.cost_mm2_per_s > 0.0) else { return 0.0 };
        let nearest_secs = chosen.iter().map(|from| travel_secs(*from, row)).fold(f64::INFINITY, f64::min);
        if nearest_secs.is_finite() { self.cost_mm2_per_s * nearest_secs } else { 0.0 }
    }

    /// Cost of the travel between `rows`: their minimum spanning tree (Prim 1957).
    pub(super) fn tree_cost_mm2(&self, rows: &[RowIndex]) -> f64 {
        let Some(travel_secs) = self.problem.travel_secs.filter(|_| self.cost_mm2_per_s > 0.0) else { return 0.0 };
        let Some((first, rest)) = rows.split_first() else { return 0.0 };
        let mut away: Vec<(RowIndex, f64)> = rest.iter().map(|row| (*row, travel_secs(*first, *row))).collect();
        let mut secs = 0.0;
        while let Some(nearest) = (0..away.len()).min_by(|a, b| away[*a].1.total_cmp(&away[*b].1)) {
            let (joined, way_secs) = away.swap_remove(nearest);
            secs += way_secs;
            away.iter_mut().for_each(|(row, to_tree)| *to_tree = to_tree.min(travel_secs(joined, *row)));
        }
        self.cost_mm2_per_s * secs
    }

    /// Value of each measured sample of a row that is in a set, given as words of bits, ascending by sample.
    pub(super) fn values(&self, row: RowIndex, within: &[u64]) -> impl Iterator<Item = (SampleId, f64)> {
        let (value, value_a_step, steps) = match (self.objective, self.quality(row)) {
            (_, Some((scale, steps))) => (self.weights.a, self.weights.b * f64::from(scale.max()) / f64::from(i16::MAX), steps),
            (Objective::Score, None) => (self.weights.a, 0.0, &[][..]),
            (Objective::Coverage, None) => (1.0, 0.0, &[][..]),
        };
        let blocks = (0..).step_by(64).zip(self.problem.row(row).words().iter().zip(within)).scan(0, |before, (first, words)| {
            let (measured, place) = (*words.0, *before);
            *before += measured.count_ones() as usize;
            Some((first, measured, measured & words.1, place))
        });
        blocks.flat_map(move |(first, measured, wanted, place)| {
            ones(wanted).map(move |bit| {
                let place = place + (measured & ((1 << bit) - 1)).count_ones() as usize;
                let step = steps.get(place).copied().unwrap_or(0);
                let sample = SampleId(first + bit);
                (sample, self.problem.weighted_area_mm2[sample.index()] * (value + value_a_step * f64::from(step)))
            })
        })
    }
}

/// The samples that are not yet covered.
#[derive(Clone)]
pub(super) struct Uncovered {
    /// The samples as a set, by which words of a row are passed over.
    samples: SampleSet,
    /// Area that each sample stands for, 0 for those that are not open.
    area_mm2: Vec<f64>,
    level: SimdLevel,
}

impl Uncovered {
    /// Opens every sample that has area.
    pub(super) fn all(area_mm2: &[f64], level: SimdLevel) -> Self {
        let mut samples = SampleSet::none_of(area_mm2.len());
        let asked = SampleId::number(area_mm2).filter(|(_, area_mm2)| **area_mm2 > 0.0);
        asked.for_each(|(sample, _)| samples.insert(sample));
        Self { samples, area_mm2: area_mm2.to_vec(), level }
    }

    pub(super) fn close(&mut self, row: &Row) {
        self.samples.remove_all(row.measured());
        row.samples().for_each(|sample| self.area_mm2[sample.index()] = 0.0);
    }

    /// Closes the samples that are not `wanted`.
    pub(super) fn retain(&mut self, wanted: impl Fn(SampleId) -> bool) {
        let mut others = SampleSet::none_of(self.area_mm2.len());
        SampleId::first(self.area_mm2.len()).filter(|sample| !wanted(*sample)).for_each(|sample| others.insert(sample));
        others.iter().for_each(|sample| self.area_mm2[sample.index()] = 0.0);
        self.samples.remove_all(&others);
    }

    /// Open area that a row measures, added in the same lanes as a score: a sample that it does not measure adds 0.
    pub(super) fn area_mm2(&self, row: &Row) -> f64 {
        self.level.run(AreaSum { measured: row.words(), open: self.samples.words(), area_mm2: &self.area_mm2 })
    }

    /// Sum of area × (`value` + `value_a_step` × step) over the open samples of a row, in [`LANES`] sums side by side, so
    /// that samples measured in unbroken runs are added as vectors. A closed sample adds 0, whether passed over or not.
    fn sum(&self, row: &Row, mut steps: &[i16], value: f64, value_a_step: f64) -> f64 {
        let mut sums = [0.0; LANES];
        for ((measured, open), area_mm2) in row.words().iter().zip(self.samples.words()).zip(self.area_mm2.chunks(64)) {
            let count = measured.count_ones() as usize;
            let own = steps.split_off(..count).unwrap_or_default();
            let add = |sum: &mut f64, area_mm2: f64, step: i16| *sum += area_mm2 * (value + value_a_step * f64::from(step));
            if measured & open == 0 {
                continue;
            }
            if count == 64 {
                for (area_mm2, own) in area_mm2.chunks_exact(LANES).zip(own.chunks_exact(LANES)) {
                    (0..LANES).for_each(|lane| add(&mut sums[lane], area_mm2[lane], own[lane]));
                }
            } else {
                for (bit, step) in ones(*measured).zip(own) {
                    add(&mut sums[bit as usize % LANES], area_mm2[bit as usize], *step);
                }
            }
        }
        sums.iter().sum()
    }
}

/// Sum of the open area that a row measures.
struct AreaSum<'a> {
    measured: &'a [u64],
    open: &'a [u64],
    area_mm2: &'a [f64],
}

impl Kernel for AreaSum<'_> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let mut sums = [0.0; LANES];
        for ((measured, open), area_mm2) in self.measured.iter().zip(self.open).zip(self.area_mm2.chunks(64)) {
            let wanted = measured & open;
            if wanted == 0 {
                continue;
            }
            if let Ok(block) = <&[f64; 64]>::try_from(area_mm2) {
                for first in (0..64).step_by(LANES) {
                    let bits = wanted >> first;
                    for lane in 0..LANES {
                        sums[lane] += if bits >> lane & 1 == 1 { block[first + lane] } else { 0.0 };
                    }
                }
            } else {
                ones(wanted).for_each(|bit| sums[bit as usize % LANES] += area_mm2[bit as usize]);
            }
        }
        sums.iter().sum()
    }
}
