//! Overlap of views for registration: two are joined when the asked area that both measure
//! reaches `selection.overlap`, and a choice is allowed when its views form one connected graph. Cost: a pass over two
//! rows' words a pair, computed when asked for and remembered.

use std::cell::RefCell;
use std::collections::HashMap;

use super::CoverProblem;
use crate::planning::ids::RowIndex;
use crate::planning::params::OverlapParams;
use crate::planning::visibility::ones;

/// Tells which rows overlap enough.
pub(in crate::planning) struct Overlap<'a> {
    problem: &'a CoverProblem<'a>,
    params: &'a OverlapParams,
    joined: RefCell<HashMap<(RowIndex, RowIndex), bool>>,
}

impl<'a> Overlap<'a> {
    pub(in crate::planning) fn new(problem: &'a CoverProblem<'a>, params: &'a OverlapParams) -> Self {
        Self { problem, params, joined: RefCell::default() }
    }

    /// Returns true if overlap is asked for.
    pub(super) fn is_asked_for(&self) -> bool {
        self.params.min_area_mm2.is_some() || self.params.min_share.is_some()
    }

    /// Returns true if `row` may be added to `chosen`.
    pub(in crate::planning) fn joins(&self, row: RowIndex, chosen: &[RowIndex]) -> bool {
        !self.is_asked_for() || chosen.is_empty() || chosen.iter().any(|other| self.are_joined(row, *other))
    }

    /// Returns true if `chosen` form one connected graph.
    pub(super) fn connects(&self, chosen: &[RowIndex]) -> bool {
        let Some((first, rest)) = chosen.split_first().filter(|_| self.is_asked_for()) else { return true };
        let (mut reached, mut rest) = (vec![*first], rest.to_vec());
        while let Some(next) = rest.iter().position(|row| self.joins(*row, &reached)) {
            reached.push(rest.swap_remove(next));
        }
        rest.is_empty()
    }

    fn are_joined(&self, a: RowIndex, b: RowIndex) -> bool {
        let pair = (a.min(b), a.max(b));
        if let Some(known) = self.joined.borrow().get(&pair) {
            return *known;
        }
        let shared_mm2 = self.shared_mm2(a, b);
        let needed_mm2 = match (self.params.min_area_mm2, self.params.min_share) {
            (Some(area_mm2), _) => area_mm2,
            (None, Some(share)) => share * self.shared_mm2(a, a).min(self.shared_mm2(b, b)),
            (None, None) => 0.0,
        };
        let joined = shared_mm2 > 0.0 && shared_mm2 >= needed_mm2;
        self.joined.borrow_mut().insert(pair, joined);
        joined
    }

    /// Asked area that both rows measure.
    fn shared_mm2(&self, a: RowIndex, b: RowIndex) -> f64 {
        let words = self.problem.row(a).words().iter().zip(self.problem.row(b).words());
        let areas = words.zip(self.problem.asked_area_mm2.chunks(64));
        areas.map(|((a, b), area_mm2)| ones(a & b).map(|bit| area_mm2[bit as usize]).sum::<f64>()).sum()
    }
}
