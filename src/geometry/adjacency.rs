//! Which triangles share an edge.

use super::mesh::Mesh;

/// Groups `faces` (ascending) into edge-connected components; each component ascending, components by first face.
/// Cost: O(n log n).
#[must_use]
pub fn connected_components(mesh: &Mesh, faces: &[u32]) -> Vec<Vec<u32>> {
    let mut edges: Vec<((u32, u32), usize)> = Vec::with_capacity(faces.len() * 3);
    for (position, face) in faces.iter().enumerate() {
        let [a, b, c] = mesh.faces[*face as usize];
        edges.extend([(a, b), (b, c), (c, a)].map(|(from, to)| ((from.min(to), from.max(to)), position)));
    }
    edges.sort_unstable();
    let mut parent: Vec<usize> = (0..faces.len()).collect();
    for pair in edges.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let (first, second) = (root(&mut parent, pair[0].1), root(&mut parent, pair[1].1));
        // The lower root wins, so that a component is named by its first face.
        parent[first.max(second)] = first.min(second);
    }
    let mut components: Vec<Vec<u32>> = Vec::new();
    let mut component_of_root = std::collections::HashMap::new();
    for (position, face) in faces.iter().enumerate() {
        let component = *component_of_root.entry(root(&mut parent, position)).or_insert_with(|| {
            components.push(Vec::new());
            components.len() - 1
        });
        components[component].push(*face);
    }
    components
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
    use super::connected_components;
    use crate::testing::box_mesh;

    #[test]
    fn faces_that_share_an_edge_are_one_component() {
        let mesh = box_mesh([0.0; 3], [1.0; 3]);
        assert_eq!(connected_components(&mesh, &(0..12).collect::<Vec<_>>()), [(0..12).collect::<Vec<_>>()]);
        // Bottom and top of a box share no edge; each is two triangles.
        assert_eq!(connected_components(&mesh, &[0, 1, 2, 3]), [[0, 1], [2, 3]]);
        assert!(connected_components(&mesh, &[]).is_empty());
    }
}
