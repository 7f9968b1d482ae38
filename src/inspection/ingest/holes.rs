//! Triangles with which a vendor's program closed holes: far longer than the rest. What they span was not measured.

use super::clean::{Removed, RemovedBecause};
use crate::geometry::cloud_io::StoredCloud;

/// Edges longer than so many times the median one close a hole.
const LONG_EDGE: f64 = 5.0;

/// Drops points that only long triangles hold; the longest edge of such a triangle, if there is one.
pub(super) fn drop_filled(cloud: &mut StoredCloud, removed: &mut Removed) -> Option<f64> {
    let longest_of = |face: &[u32; 3]| {
        let corner = |index: usize| cloud.points[face[index] as usize].map(f64::from);
        let edge = |a: [f64; 3], b: [f64; 3]| (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt();
        edge(corner(0), corner(1)).max(edge(corner(1), corner(2))).max(edge(corner(2), corner(0)))
    };
    let mut lengths: Vec<f64> = cloud.faces.iter().map(longest_of).collect();
    if lengths.is_empty() {
        return None;
    }
    let middle = lengths.len() / 2;
    let limit = LONG_EDGE * *lengths.clone().select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut is_held = vec![false; cloud.points.len()];
    for (face, _) in cloud.faces.iter().zip(&lengths).filter(|(_, length)| **length <= limit) {
        face.iter().for_each(|corner| is_held[*corner as usize] = true);
    }
    lengths.retain(|length| *length > limit);
    let longest = lengths.into_iter().reduce(f64::max)?;
    for (point, is_held) in cloud.points.iter_mut().zip(is_held) {
        if !is_held && !point[0].is_nan() {
            *point = [f32::NAN; 3];
            removed.count(RemovedBecause::FilledHole, 1);
        }
    }
    Some(longest)
}
