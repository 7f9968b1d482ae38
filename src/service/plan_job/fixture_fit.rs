//! Fit of a fixture beside the part that it holds: material cannot be where other material is. Part frame, millimetres.

use nalgebra::Point3;

use crate::geometry::{Mesh, NearestFace, RayScene};

/// Depth to which a fixture may run into the part, mm: facets of curved surface, and clamps that give way. Our choice.
pub(super) const MAX_DEPTH_MM: f64 = 1.0;
/// Points of one of the two that are held against the other at most.
const MAX_POINTS: usize = 8192;
/// Points that have to lie deep: a single one may be an error of an open mesh.
const MIN_POINTS: usize = 3;

/// Returns true if part and fixture run into each other by more than [`MAX_DEPTH_MM`]: points of the part's surface lie that deep in the
/// fixture, or the corners of a fixture within the part's box that deep in the part.
pub(super) fn overlap(part: &Mesh, fixture: &Mesh, sample_mm: &[Point3<f64>]) -> bool {
    let (of_part, of_fixture) = (part.aabb(), fixture.aabb());
    let is_in_box = of_part.holds(&of_fixture.min) && of_part.holds(&of_fixture.max);
    lie_deep(sample_mm, fixture) || is_in_box && lie_deep(&fixture.vertices_mm, part)
}

fn lie_deep(points_mm: &[Point3<f64>], body: &Mesh) -> bool {
    let (aabb, step) = (body.aabb(), points_mm.len().div_ceil(MAX_POINTS).max(1));
    // Each step takes longer than the one before, and leaves less for the next.
    let mut points_mm: Vec<&Point3<f64>> = points_mm.iter().step_by(step).filter(|p| aabb.holds(p)).collect();
    if points_mm.len() < MIN_POINTS {
        return false;
    }
    let scene = RayScene::new([body]);
    points_mm.retain(|p| scene.encloses(p));
    if points_mm.len() < MIN_POINTS {
        return false;
    }
    let nearest = NearestFace::new(body);
    points_mm.into_iter().filter(|p| nearest.nearest(p, MAX_DEPTH_MM).is_none()).take(MIN_POINTS).count() == MIN_POINTS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::box_mesh;

    /// Centres of the faces of a mesh and points between them and its corners.
    fn points_of(mesh: &Mesh) -> Vec<Point3<f64>> {
        let of_face = |face: usize| {
            let corners = mesh.corners(face);
            let centre = Point3::from(corners.iter().map(|p| p.coords).sum::<nalgebra::Vector3<f64>>() / 3.0);
            corners.map(|corner| nalgebra::center(&corner, &centre))
        };
        (0..mesh.faces.len()).flat_map(of_face).collect()
    }

    #[test]
    fn a_fixture_may_touch_the_part_and_not_run_into_it() {
        let part = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
        let overlaps = |fixture: &Mesh| overlap(&part, fixture, &points_of(&part));
        for (fixture, wanted) in [
            (box_mesh([-10.0, -10.0, -20.0], [70.0, 50.0, 0.0]), false),
            (box_mesh([-10.0, -10.0, -20.0], [70.0, 50.0, 0.5]), false),
            (box_mesh([-10.0, -10.0, -20.0], [70.0, 50.0, 5.0]), true),
            // The part within it, and within the part.
            (box_mesh([-6.0, -4.0, -3.0], [66.0, 44.0, 33.0]), true),
            (box_mesh([10.0; 3], [50.0, 30.0, 20.0]), true),
            (box_mesh([100.0, 0.0, 0.0], [140.0, 40.0, 30.0]), false),
        ] {
            assert_eq!(overlaps(&fixture), wanted, "{:?}", fixture.aabb());
        }
    }
}
