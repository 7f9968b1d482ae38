//! Connected components of items that share a corner, an edge or any other key.

/// Finds the component of each item, where items that have a key in common belong together; components are
/// numbered by their first item. Cost: O(n log n).
#[must_use]
pub fn components_sharing<K: Ord>(keys: impl IntoIterator<Item = [K; 3]>) -> Vec<usize> {
    let mut items = 0;
    let mut keyed: Vec<(K, usize)> = Vec::new();
    for keys_of_item in keys {
        keyed.extend(keys_of_item.map(|key| (key, items)));
        items += 1;
    }
    keyed.sort_unstable();
    let mut parent: Vec<usize> = (0..items).collect();
    for pair in keyed.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let (first, second) = (root(&mut parent, pair[0].1), root(&mut parent, pair[1].1));
        // The lower root wins, so that a component's root is its first item.
        parent[first.max(second)] = first.min(second);
    }
    let (mut component, mut components) = (vec![0; items], 0);
    for item in 0..items {
        let first = root(&mut parent, item);
        if first == item {
            component[item] = components;
            components += 1;
        }
        component[item] = component[first];
    }
    component
}

fn root(parent: &mut [usize], mut node: usize) -> usize {
    while parent[node] != node {
        parent[node] = parent[parent[node]];
        node = parent[node];
    }
    node
}

#[cfg(test)]
mod tests {
    use super::components_sharing;

    #[test]
    fn items_with_a_key_in_common_are_one_component_numbered_by_its_first() {
        let chain = [[1, 2, 3], [7, 8, 9], [3, 4, 5], [6, 5, 0], [9, 10, 11]];
        assert_eq!(components_sharing(chain), [0, 1, 0, 0, 1]);
        assert!(components_sharing::<u8>([]).is_empty());
    }
}
