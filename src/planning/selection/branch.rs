//! Branch and bound on whether k views cover enough: at each node the multipliers of the classes (`multipliers.rs`)
//! are improved by subgradient steps (Held and Karp 1971; Polyak's step length), rows are fixed that the bound alone rules
//! out or demands (reduced costs, as Caprara, Fischetti and Toth 1999, *A Heuristic Method for the Set Covering Problem*),
//! rows go whose open classes another row holds as well, and the tree splits on taking a row or not.
//!
//! A row's id here is its place in [`Classes::rows`](super::classes::Classes), its place that among the rows left at a node.
//! Whole numbers throughout, so that infeasibility is proved exactly. Nodes are taken in rounds whose make-up does not depend on
//! threads. Cost: a subgradient step passes over the pairs of a node's rows and classes.

use rayon::prelude::*;

use super::classes::undominated;
use crate::planning::context::{Cancelled, Context};

/// Nodes that are solved side by side.
const SIDE_BY_SIDE: usize = 16;
/// Work of a node in a round at most.
const ROUND_WORK: u64 = 40_000_000;
/// Subgradient steps at most, at the root and at other nodes.
const MAX_ROOT_STEPS: usize = 400;
const MAX_NODE_STEPS: usize = 60;

/// A node of the tree: the instance that is left.
#[derive(Clone)]
pub(super) struct SearchNode {
    /// Rows that may still be taken.
    pub(super) ids: Vec<u32>,
    /// Open classes of each of these rows, ascending.
    pub(super) of_row: Vec<Vec<u32>>,
    /// Units of each open class.
    pub(super) units: Vec<i64>,
    /// Multiplier of each open class.
    pub(super) multipliers: Vec<i64>,
    /// Units that may stay open.
    pub(super) slack: i64,
    /// Views that may still be taken.
    pub(super) views: usize,
    /// Rows taken.
    pub(super) taken: Vec<u32>,
    /// Surplus of the bound: units by which it is above the need.
    pub(super) surplus: i64,
}

/// Result of a search.
pub(super) enum CoverResult {
    /// No cover of so many views exists.
    Infeasible,
    /// Rows that cover enough.
    Found(Vec<u32>),
    /// Work ended; at most so many units more than asked for can be covered.
    Open(i64),
}

/// Accepts or refuses rows that cover enough units.
pub(super) type Accepts<'a> = &'a (dyn Fn(&[u32]) -> bool + Sync);

/// Searches until the result is found or `work` pairs were evaluated.
pub(super) fn search(
    root: SearchNode,
    accepts: Accepts<'_>,
    work: &mut u64,
    ctx: &Context<'_>,
) -> Result<CoverResult, Cancelled> {
    let mut open = vec![root];
    let mut is_root = true;
    while !open.is_empty() {
        if *work == 0 {
            return Ok(CoverResult::Open(open.iter().map(|node| node.surplus).max().unwrap_or(0)));
        }
        let batch = open.split_off(open.len().saturating_sub(SIDE_BY_SIDE));
        // Until there is enough to do side by side, each node is only split.
        let quota = if batch.len() < SIDE_BY_SIDE { 1 } else { ROUND_WORK.min(*work) };
        let steps = if is_root { MAX_ROOT_STEPS } else { MAX_NODE_STEPS };
        is_root = false;
        let done = batch.into_par_iter().map(|node| descend(node, steps, accepts, quota, ctx));
        for (answer, spent) in done.collect::<Result<Vec<_>, Cancelled>>()? {
            *work = work.saturating_sub(spent);
            match answer {
                Descent::Found(taken) => return Ok(CoverResult::Found(taken)),
                Descent::Left(nodes) => open.extend(nodes),
            }
        }
    }
    Ok(CoverResult::Infeasible)
}

enum Descent {
    Found(Vec<u32>),
    Left(Vec<SearchNode>),
}

/// Searches depth first from a node, as far as the quota goes.
fn descend(
    root: SearchNode,
    steps: usize,
    accepts: Accepts<'_>,
    quota: u64,
    ctx: &Context<'_>,
) -> Result<(Descent, u64), Cancelled> {
    let (mut stack, mut spent) = (vec![root], 0);
    while let Some(node) = stack.pop() {
        let outcome = NodeSolver { node, accepts, spent: &mut spent, ctx }.run(steps)?;
        match outcome {
            NodeOutcome::Infeasible => {}
            NodeOutcome::Found(taken) => return Ok((Descent::Found(taken), spent)),
            NodeOutcome::Split(nodes) => stack.extend(*nodes),
        }
        if spent >= quota {
            break;
        }
    }
    Ok((Descent::Left(stack), spent))
}

enum NodeOutcome {
    Infeasible,
    Found(Vec<u32>),
    /// Two nodes, without a row and with it: the latter is solved first.
    Split(Box<[SearchNode; 2]>),
}

struct NodeSolver<'a> {
    node: SearchNode,
    accepts: Accepts<'a>,
    spent: &'a mut u64,
    ctx: &'a Context<'a>,
}

/// The rows with the largest sums of multipliers at a node.
struct TopRows {
    sums: Vec<i64>,
    /// Positions of these rows, as many as may be taken, the largest sum first.
    places: Vec<u32>,
    /// Surplus of the bound: units by which it is above the need; below 0 the node is infeasible.
    surplus: i64,
    /// Sum of the first row that is not among them.
    next: i64,
}

impl NodeSolver<'_> {
    fn run(mut self, steps: usize) -> Result<NodeOutcome, Cancelled> {
        self.node.drop_dominated(self.spent);
        loop {
            if self.node.slack < 0 {
                return Ok(NodeOutcome::Infeasible);
            }
            if self.node.units.iter().sum::<i64>() <= self.node.slack && (self.accepts)(&self.node.taken) {
                return Ok(NodeOutcome::Found(self.node.taken));
            }
            if self.node.views == 0 || self.node.ids.is_empty() {
                return Ok(NodeOutcome::Infeasible);
            }
            match self.improve_multipliers(steps)? {
                MultiplierOutcome::Infeasible => return Ok(NodeOutcome::Infeasible),
                MultiplierOutcome::Found(taken) => return Ok(NodeOutcome::Found(taken)),
                MultiplierOutcome::Fixed => {}
                MultiplierOutcome::Split(row) => {
                    return Ok(NodeOutcome::Split(Box::new([self.node.without(row), self.node.with(row)])));
                }
            }
        }
    }

    /// Improves the multipliers until the node is infeasible, rows can be fixed, or it is time to split.
    fn improve_multipliers(&mut self, steps: usize) -> Result<MultiplierOutcome, Cancelled> {
        let mut best: Option<(i64, Vec<i64>)> = None;
        let mut direction = vec![0.0; self.node.units.len()];
        let (mut length, mut since) = (1.0, 0);
        let mut frequency = vec![0.0_f64; self.node.ids.len()];
        let mut checkpoint = i64::MAX;
        for step in 0..steps {
            self.ctx.check()?;
            let top_rows = self.node.top_rows();
            *self.spent += self.node.pairs() as u64;
            if top_rows.surplus < 0 {
                return Ok(MultiplierOutcome::Infeasible);
            }
            let cover = self.node.cover(&top_rows.places);
            if let Some(taken) = self.feasible_cover(&top_rows, &cover) {
                return Ok(MultiplierOutcome::Found(taken));
            }
            if self.node.fix(&top_rows) {
                self.node.drop_dominated(self.spent);
                return Ok(MultiplierOutcome::Fixed);
            }
            frequency.iter_mut().for_each(|frequency| *frequency *= 0.9);
            top_rows.places.iter().for_each(|place| frequency[*place as usize] += 0.1);
            if best.as_ref().is_none_or(|best| top_rows.surplus < best.0) {
                best = Some((top_rows.surplus, self.node.multipliers.clone()));
                since = 0;
            } else {
                since += 1;
                if since >= 4 {
                    (length, since) = (length * 0.6, 0);
                }
            }
            if step % 15 == 14 {
                let surplus = best.as_ref().map_or(0, |best| best.0);
                // What is left shrinks too slowly to be gone in the steps that are left.
                if surplus as f64 > 0.8 * checkpoint as f64 && steps < MAX_ROOT_STEPS {
                    break;
                }
                checkpoint = surplus;
            }
            self.node.step(&cover, top_rows.surplus, length, &mut direction);
        }
        if let Some((surplus, multipliers)) = best {
            self.node.multipliers = multipliers;
            self.node.surplus = surplus;
        }
        let split = (0..frequency.len()).max_by(|a, b| frequency[*a].total_cmp(&frequency[*b]).then(b.cmp(a)));
        Ok(MultiplierOutcome::Split(split.unwrap_or(0)))
    }

    /// The top rows, where they happen to cover enough.
    fn feasible_cover(&self, top_rows: &TopRows, cover: &[i32]) -> Option<Vec<u32>> {
        let open: i64 = self.node.units.iter().zip(cover).filter(|(_, cover)| **cover == 0).map(|(units, _)| units).sum();
        let taken = || {
            self.node.taken.iter().copied().chain(top_rows.places.iter().map(|place| self.node.ids[*place as usize])).collect()
        };
        (open <= self.node.slack).then(taken).filter(|taken: &Vec<u32>| (self.accepts)(taken))
    }
}

enum MultiplierOutcome {
    Infeasible,
    Found(Vec<u32>),
    Fixed,
    Split(usize),
}

impl SearchNode {
    fn pairs(&self) -> usize {
        self.of_row.iter().map(Vec::len).sum()
    }

    fn top_rows(&self) -> TopRows {
        let sum = |classes: &Vec<u32>| classes.iter().map(|class| self.multipliers[*class as usize]).sum();
        let sums: Vec<i64> = self.of_row.iter().map(sum).collect();
        let mut order: Vec<u32> = (0..sums.len() as u32).collect();
        order.sort_unstable_by_key(|place| (std::cmp::Reverse(sums[*place as usize]), *place));
        let next = order.get(self.views).map_or(0, |place| sums[*place as usize]);
        order.truncate(self.views);
        let best: i64 = order.iter().map(|place| sums[*place as usize]).sum();
        TopRows { surplus: best - self.multipliers.iter().sum::<i64>() + self.slack, sums, places: order, next }
    }

    /// Counts how many of `rows` cover each class.
    fn cover(&self, rows: &[u32]) -> Vec<i32> {
        let mut cover = vec![0; self.units.len()];
        rows.iter().flat_map(|place| &self.of_row[*place as usize]).for_each(|class| cover[*class as usize] += 1);
        cover
    }

    /// Moves the multipliers: up where no row covers the class, down where many do. The direction is deflected by the ones before
    /// (Camerini, Fratta, Maffioli 1975); a class moves in proportion to its units, so that merging changes nothing.
    fn step(&mut self, cover: &[i32], surplus: i64, length: f64, direction: &mut [f64]) {
        let mut square = 0.0;
        for (class, cover) in cover.iter().enumerate() {
            let (units, multiplier) = (self.units[class], self.multipliers[class]);
            let wanted = f64::from(1 - cover);
            let blocked = wanted > 0.0 && multiplier == units || wanted < 0.0 && multiplier == 0;
            direction[class] = if blocked { 0.0 } else { wanted + 0.5 * direction[class] };
            square += units as f64 * direction[class] * direction[class];
        }
        if square <= 0.0 {
            return;
        }
        let stride = length * (surplus as f64 * 1.05 + 1.0) / square;
        for ((multiplier, units), direction) in self.multipliers.iter_mut().zip(&self.units).zip(direction) {
            *multiplier = multiplier.saturating_add((stride * *units as f64 * *direction) as i64).clamp(0, *units);
        }
    }

    /// Takes the rows without which the bound falls below the need, and drops those with which it does.
    fn fix(&mut self, top_rows: &TopRows) -> bool {
        let last = top_rows.places.last().map_or(0, |place| top_rows.sums[*place as usize]);
        let mut is_top = vec![false; self.ids.len()];
        top_rows.places.iter().for_each(|place| is_top[*place as usize] = true);
        let is_out = |place: usize| !is_top[place] && top_rows.surplus - last + top_rows.sums[place] < 0;
        let out: Vec<bool> = (0..self.ids.len()).map(is_out).collect();
        let must = top_rows.places.iter().find(|place| top_rows.surplus - top_rows.sums[**place as usize] + top_rows.next < 0);
        let must = must.map(|place| self.ids[*place as usize]);
        if must.is_none() && !out.contains(&true) {
            return false;
        }
        let mut out = out.into_iter();
        self.keep_rows(|_| !out.next().unwrap_or(false));
        if let Some(place) = must.and_then(|id| self.ids.iter().position(|own| *own == id)) {
            self.take(place);
        }
        self.drop_lost();
        true
    }

    fn without(&self, row: usize) -> Self {
        let mut node = self.clone();
        let id = self.ids[row];
        node.keep_rows(|own| own != id);
        node.drop_lost();
        node
    }

    fn with(&self, row: usize) -> Self {
        let mut node = self.clone();
        node.take(row);
        node.drop_lost();
        node
    }

    fn keep_rows(&mut self, mut keep: impl FnMut(u32) -> bool) {
        let stays: Vec<bool> = self.ids.iter().map(|id| keep(*id)).collect();
        let (mut of_ids, mut of_rows) = (stays.iter(), stays.iter());
        self.ids.retain(|_| of_ids.next().copied().unwrap_or(true));
        self.of_row.retain(|_| of_rows.next().copied().unwrap_or(true));
    }

    fn take(&mut self, row: usize) {
        self.taken.push(self.ids.remove(row));
        self.views -= 1;
        let mut open = vec![true; self.units.len()];
        self.of_row.remove(row).iter().for_each(|class| open[*class as usize] = false);
        self.keep_classes(&open);
    }

    /// Drops classes that no row can cover any more: they stay open.
    fn drop_lost(&mut self) {
        let mut reached = vec![false; self.units.len()];
        self.of_row.iter().flatten().for_each(|class| reached[*class as usize] = true);
        if reached.contains(&false) {
            self.slack -= self.units.iter().zip(&reached).filter(|(_, reached)| !**reached).map(|(units, _)| units).sum::<i64>();
            self.keep_classes(&reached);
        }
    }

    fn keep_classes(&mut self, keep: &[bool]) {
        let mut number = 0;
        let renamed: Vec<u32> = keep
            .iter()
            .map(|keep| {
                number += u32::from(*keep);
                number.wrapping_sub(1)
            })
            .collect();
        for classes in &mut self.of_row {
            classes.retain(|class| keep[*class as usize]);
            classes.iter_mut().for_each(|class| *class = renamed[*class as usize]);
        }
        for values in [&mut self.units, &mut self.multipliers] {
            let mut keep = keep.iter();
            values.retain(|_| keep.next().copied().unwrap_or(true));
        }
    }

    fn drop_dominated(&mut self, spent: &mut u64) {
        *spent += self.pairs() as u64;
        let undominated = undominated(&self.of_row, self.units.len());
        if undominated.len() < self.ids.len() {
            let mut stays = vec![false; self.ids.len()];
            undominated.iter().for_each(|place| stays[*place] = true);
            let mut stays = stays.into_iter();
            self.keep_rows(|_| stays.next().unwrap_or(true));
        }
    }
}
