use super::*;
use crate::testing::box_mesh;

#[test]
fn a_brick_stands_on_its_six_sides_the_largest_first() {
    let poses = stable_poses(&box_mesh([0.0; 3], [60.0, 40.0, 20.0]));
    assert_eq!(poses.len(), 6);
    let axis = |pose: &StablePose| pose.down.iamax();
    assert_eq!(poses.iter().map(axis).collect::<Vec<_>>(), [2, 2, 1, 1, 0, 0]);
    assert!((poses.iter().map(|pose| pose.share).sum::<f64>() - 1.0).abs() < 1e-5, "{poses:?}");
    poses.iter().for_each(|pose| assert!((pose.down.norm() - 1.0).abs() < 1e-9 && pose.down.amax() > 1.0 - 1e-5));
}

#[test]
fn a_tall_thin_needle_does_not_stand_on_its_end() {
    // Half the edge over half the height is 1 in 50: it tips within 1.2°.
    let poses = stable_poses(&box_mesh([0.0; 3], [2.0, 2.0, 100.0]));
    assert_eq!(poses.len(), 4);
    poses.iter().for_each(|pose| assert!(pose.down.z.abs() < 1e-6));
}

#[test]
fn an_oblique_tower_falls() {
    // A column whose top is shifted by more than its foot is wide: the centre of mass is beside the foot.
    let mut tower = box_mesh([0.0; 3], [20.0, 20.0, 100.0]);
    tower.vertices_mm.iter_mut().for_each(|p| p.x += 0.6 * p.z);
    let poses = stable_poses(&tower);
    assert!(poses.iter().all(|pose| pose.down.z.abs() < 0.9), "{poses:?}");
    assert!(!poses.is_empty());
}

#[test]
fn what_has_no_volume_stands_nowhere() {
    let flat = Mesh {
        vertices_mm: vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)],
        faces: vec![[0, 1, 2]],
        source_face: vec![0],
        groups: Vec::new(),
    };
    assert!(stable_poses(&flat).is_empty());
}
