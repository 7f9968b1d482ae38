//! The few of many that are spread widest.

/// Selects at most `count` of `items`, each in its turn the one farthest from those that are taken (Gonzalez 1985, *Clustering to
/// minimize the maximum intercluster distance*), in their order. The first is taken first, ties go to the lower number.
/// Cost: items × count distances.
pub(super) fn widest<T>(items: Vec<T>, count: usize, distance: impl Fn(&T, &T) -> f64) -> Vec<T> {
    let mut apart = vec![f64::INFINITY; items.len()];
    let mut taken = vec![false; items.len()];
    for _ in 0..count.min(items.len()) {
        let farther = |a: usize, b: usize| if apart[b] > apart[a] { b } else { a };
        let Some(next) = (0..items.len()).filter(|item| !taken[*item]).reduce(farther) else { break };
        taken[next] = true;
        apart.iter_mut().zip(&items).for_each(|(apart, item)| *apart = apart.min(distance(item, &items[next])));
    }
    items.into_iter().zip(taken).filter(|(_, taken)| *taken).map(|(item, _)| item).collect()
}
