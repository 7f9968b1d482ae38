//! Critical groups: those that routes have to go far to stop at. All groups remember them, so that every route stops at each.

use std::ops::Range;

use rayon::prelude::*;

use super::super::Costs;

/// Finds `count` groups besides those `known`: one after another the group whose insertion into all `routes`, given by their
/// nodes, costs most; it is inserted before the next is found.
pub(super) fn far_from(
    mut routes: Vec<Vec<usize>>,
    known: &[usize],
    count: usize,
    groups: &[Range<usize>],
    costs: &Costs,
) -> Vec<usize> {
    let mut found = Vec::new();
    for _ in 0..count.min(groups.len() - known.len()) {
        let is_new = |group: &usize| !known.contains(group) && !found.contains(group);
        let detours = (0..groups.len()).into_par_iter().filter(is_new).map(|group| {
            let secs: f64 = routes
                .iter()
                .filter_map(|route| cheapest_insertion(route, &groups[group], costs))
                .map(|insertion| insertion.0)
                .sum();
            (secs, group)
        });
        let farthest = detours.collect::<Vec<_>>().into_iter().reduce(|best, next| if next.0 > best.0 { next } else { best });
        let Some((_, group)) = farthest else { break };
        for route in &mut routes {
            if let Some((_, at, node)) = cheapest_insertion(route, &groups[group], costs) {
                route.insert(at, node);
            }
        }
        found.push(group);
    }
    found
}

/// Cheapest insertion of a group into a route that does not stop at it: cost in seconds, position, node.
fn cheapest_insertion(route: &[usize], group: &Range<usize>, costs: &Costs) -> Option<(f64, usize, usize)> {
    if route.iter().any(|node| group.contains(node)) {
        return None;
    }
    let mut best = (f64::INFINITY, 0, group.start);
    for at in 0..=route.len() {
        let before = at.checked_sub(1).map_or(costs.nodes, |at| route[at]);
        let after = route.get(at).copied().unwrap_or(costs.nodes);
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
