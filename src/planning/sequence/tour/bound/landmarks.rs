//! Groups that walks have to go far to stop at: those that all groups remember, so that every walk stops at each.

use std::ops::Range;

use rayon::prelude::*;

use super::super::Costs;

/// `count` groups besides those `known`, each the one that is put into all `walks`, given by their nodes, at the highest cost;
/// those before it are in them then.
pub(super) fn far_from(
    mut walks: Vec<Vec<usize>>,
    known: &[usize],
    count: usize,
    groups: &[Range<usize>],
    costs: &Costs,
) -> Vec<usize> {
    let mut found = Vec::new();
    for _ in 0..count.min(groups.len() - known.len()) {
        let is_new = |group: &usize| !known.contains(group) && !found.contains(group);
        let detours = (0..groups.len()).into_par_iter().filter(is_new).map(|group| {
            let secs: f64 = walks.iter().filter_map(|walk| place(walk, &groups[group], costs)).map(|place| place.0).sum();
            (secs, group)
        });
        let farthest = detours.collect::<Vec<_>>().into_iter().reduce(|best, next| if next.0 > best.0 { next } else { best });
        let Some((_, group)) = farthest else { break };
        for walk in &mut walks {
            if let Some((_, at, node)) = place(walk, &groups[group], costs) {
                walk.insert(at, node);
            }
        }
        found.push(group);
    }
    found
}

/// What a group costs a walk that does not stop at it at least, where, and by which node.
fn place(walk: &[usize], group: &Range<usize>, costs: &Costs) -> Option<(f64, usize, usize)> {
    if walk.iter().any(|node| group.contains(node)) {
        return None;
    }
    let mut best = (f64::INFINITY, 0, group.start);
    for at in 0..=walk.len() {
        let before = at.checked_sub(1).map_or(costs.nodes, |at| walk[at]);
        let after = walk.get(at).copied().unwrap_or(costs.nodes);
        let straight = costs.get(before, after);
        for node in group.clone() {
            let secs = costs.get(before, node) + costs.get(node, after) - straight;
            if secs < best.0 {
                best = (secs, at, node);
            }
        }
    }
    Some(best)
}
