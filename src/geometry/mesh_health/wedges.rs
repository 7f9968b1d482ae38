//! Wedges of material around an edge of more than two triangles. They tell apart shells that touch along welded edges.
//!
//! Seen along an edge from its lower vertex, counter-clockwise, a triangle that runs down the edge begins a wedge and one that runs up
//! ends it, since material lies behind each triangle. Begins and ends are matched like parentheses around the full turn, so that a
//! wedge within another, or around it, keeps its own two triangles. Cost: O(n log n) in the triangles of the edge.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::edges::Side;
use crate::geometry::Mesh;

/// Angle below which two triangles count as lying upon each other: what rounding to 32-bit floats leaves of none where the triangles
/// are a thousand times larger than the last digit of their coordinates. Our choice.
const SAME_RAD: f64 = 1e-3;
/// Height of a triangle over the edge, as a share of its other side, below which its angle is not known. Our choice.
const MIN_HEIGHT: f64 = 1e-6;

/// Pairs of triangles, of those given by their sides on an edge, that bound the same wedge of material. `None` where begins and ends do
/// not match, or where that cannot be told because a triangle has no height or lies upon one that runs in the same direction.
pub(super) fn wedges(mesh: &Mesh, vertices: [u32; 2], sides: &[Side]) -> Option<Vec<[usize; 2]>> {
    if let [a, b] = sides {
        return (a.is_ascending() != b.is_ascending()).then(|| vec![[a.face(), b.face()]]);
    }
    let around = in_order(mesh, vertices, sides)?;
    let (mut begun, mut pairs) = (Vec::new(), Vec::with_capacity(sides.len() / 2));
    let mut has_ended = vec![false; around.len()];
    // A wedge that begins in the first turn may end in the second.
    for turn in 0..2 {
        for (side, has_ended) in around.iter().zip(&mut has_ended) {
            if !side.is_ascending() {
                begun.extend((turn == 0).then_some(side.face()));
            } else if !*has_ended && let Some(begin) = begun.pop() {
                *has_ended = true;
                pairs.push([begin, side.face()]);
            }
        }
    }
    (2 * pairs.len() == sides.len()).then_some(pairs)
}

/// Sides counter-clockwise around the edge; of two that lie upon each other the one that ends a wedge comes first, so that the bodies
/// on both touch.
fn in_order(mesh: &Mesh, [low, high]: [u32; 2], sides: &[Side]) -> Option<Vec<Side>> {
    let [from, to] = [low, high].map(|vertex| mesh.vertices_mm[vertex as usize]);
    let axis = (to - from).try_normalize(0.0)?;
    let height = |side: &Side| {
        let apex = mesh.faces[side.face()].into_iter().find(|vertex| *vertex != low && *vertex != high)?;
        let offset = mesh.vertices_mm[apex as usize] - from;
        let height: Vector3<f64> = offset - axis * axis.dot(&offset);
        (height.norm() > MIN_HEIGHT * offset.norm()).then_some(height)
    };
    let first = height(sides.first()?)?.normalize();
    let second = axis.cross(&first);
    let mut around = Vec::with_capacity(sides.len());
    for side in sides {
        let height = height(side)?;
        let angle_rad = height.dot(&second).atan2(height.dot(&first));
        // Rounding may leave one that lies upon the first just before it.
        around.push((if angle_rad < -SAME_RAD { angle_rad + TAU } else { angle_rad }, *side));
    }
    around.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    if around.first()?.0 + TAU - around.last()?.0 < SAME_RAD {
        return None;
    }
    for upon in around.chunk_by_mut(|(a, _), (b, _)| b - a < SAME_RAD) {
        upon.sort_by_key(|(_, side)| !side.is_ascending());
        if upon.windows(2).any(|pair| pair[0].1.is_ascending() == pair[1].1.is_ascending()) {
            return None;
        }
    }
    Some(around.into_iter().map(|(_, side)| side).collect())
}
