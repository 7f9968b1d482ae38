use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::{Kinematics, KinematicsSpec, OpwSpec};
use crate::geometry::Pose;

fn e05() -> OpwSpec {
    OpwSpec {
        a1_mm: 0.0,
        a2_mm: 0.0,
        b_mm: 0.0,
        c1_mm: 220.0,
        c2_mm: 380.0,
        c3_mm: 420.0,
        c4_mm: 155.0,
        sign_corrections: [1, -1, 1, 1, 1, 1],
        offsets_deg: [0.0; 6],
    }
}

/// ABB IRB 2400/10 with a sideways offset added: every parameter of the family at work.
fn general() -> OpwSpec {
    OpwSpec {
        a1_mm: 100.0,
        a2_mm: -135.0,
        b_mm: 40.0,
        c1_mm: 615.0,
        c2_mm: 705.0,
        c3_mm: 755.0,
        c4_mm: 85.0,
        sign_corrections: [-1, 1, 1, -1, 1, -1],
        offsets_deg: [30.0, 0.0, -90.0, 0.0, 15.0, 180.0],
    }
}

fn arm(spec: OpwSpec) -> Kinematics {
    KinematicsSpec::Opw(spec).build()
}

fn error(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (a.translation.vector - b.translation.vector).norm().max(a.rotation.angle_to(&b.rotation))
}

/// Largest error of any branch, and the distance in joint space of the nearest one to `joints`.
fn round_trip(arm: &Kinematics, joints: &[f64; 6]) -> (f64, f64, usize) {
    let pose = arm.base_from_flange(joints);
    let branches = arm.branches(&pose);
    let worst = branches.iter().map(|branch| error(arm.base_from_flange(branch).isometry(), pose.isometry())).fold(0.0, f64::max);
    let apart = |branch: &[f64; 6]| branch.iter().zip(joints).map(|(a, b)| 2.0 * (0.5 * (a - b)).sin().abs()).fold(0.0, f64::max);
    (worst, branches.iter().map(apart).fold(f64::INFINITY, f64::min), branches.len())
}

#[test]
fn e05_stands_straight_up_at_zero() {
    let frames = arm(e05()).link_frames(&[0.0; 6]);
    for (frame, height) in frames.iter().zip([0.0, 220.0, 220.0, 600.0, 1020.0, 1020.0, 1175.0]) {
        assert!(error(frame, &Isometry3::translation(0.0, 0.0, height)) < 1e-9, "{frame} should be {height} up");
    }
}

#[test]
fn e05_reaches_800_mm_from_shoulder_to_wrist_and_no_further() {
    let arm = arm(e05());
    // Joint 2 has a negative sign: +90° lays the arm along −x. The flange looks the same way.
    let frames = arm.link_frames(&[0.0, FRAC_PI_2, 0.0, 0.0, 0.0, 0.0]);
    assert!((frames[4].translation.vector - Vector3::new(-800.0, 0.0, 220.0)).norm() < 1e-9);
    assert!((frames[6].translation.vector - Vector3::new(-955.0, 0.0, 220.0)).norm() < 1e-9);
    let looking_along_x = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
    let at = |x: f64| Pose::from_parts(Vector3::new(x, 0.0, 220.0), looking_along_x);
    assert!(!arm.branches(&at(954.999)).is_empty());
    assert!(arm.branches(&at(955.001)).is_empty());
}

#[test]
fn agrees_with_standard_denavit_hartenberg_rows() {
    // d1 = 220, a2 = 380, d4 = 420, d6 = 155: the arm's reduced rows. Their zero has the upper arm along x, and the wrist
    // turned about the forearm, hence the quarter turns on joints 2 and 3 and the half turn on joint 4.
    let row = |theta: f64, d: f64, a: f64, alpha: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), theta);
        let twist = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), alpha);
        Isometry3::from_parts(Translation3::new(0.0, 0.0, d), turn) * Isometry3::from_parts(Translation3::new(a, 0.0, 0.0), twist)
    };
    let arm = arm(e05());
    let q = [0.3, -0.7, 1.1, -2.0, 0.9, 2.5];
    let chain = row(q[0], 220.0, 0.0, FRAC_PI_2)
        * row(q[1] + FRAC_PI_2, 0.0, 380.0, 0.0)
        * row(-q[2] + FRAC_PI_2, 0.0, 0.0, FRAC_PI_2)
        * row(q[3] + PI, 420.0, 0.0, -FRAC_PI_2)
        * row(q[4], 0.0, 0.0, FRAC_PI_2)
        * row(q[5], 155.0, 0.0, 0.0);
    let flange = arm.base_from_flange(&q);
    assert!(error(flange.isometry(), &chain) < 1e-9, "{flange:?} {chain}");
}

#[test]
fn singular_poses_give_finite_exact_solutions() {
    let arm = arm(e05());
    let cases = [
        ("stretched elbow and straight wrist", [0.4, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("straight wrist", [0.4, 0.5, 1.0, 0.7, 0.0, -0.2]),
        ("folded wrist", [0.4, 0.5, 1.0, 0.7, PI, -0.2]),
        ("almost straight wrist", [0.4, 0.5, 1.0, 0.7, 1e-9, -0.2]),
        ("wrist centre on axis 1", [0.0, 0.3, 2.0 * (0.3_f64.sin() * 380.0 / 420.0).asin(), 0.1, 0.6, 0.2]),
        ("almost stretched elbow", [0.4, 0.3, 1e-8, 0.7, 0.5, -0.2]),
    ];
    for (name, joints) in cases {
        let (worst, _, count) = round_trip(&arm, &joints);
        assert!(count > 0 && worst <= 1e-6, "{name}: {count} solutions, worst error {worst}");
    }
    // The wrist's centre on axis 1: whichever way the first joint is turned, the pose must hold.
    let above = Pose::from_parts(Vector3::new(0.0, 0.0, 220.0 + 700.0 + 155.0), UnitQuaternion::identity());
    let branches = arm.branches(&above);
    assert!(!branches.is_empty());
    for branch in branches {
        assert!(branch.iter().all(|angle| angle.is_finite()));
        assert!(error(arm.base_from_flange(&branch).isometry(), above.isometry()) <= 1e-6);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn inverse_then_forward_is_the_pose_for_the_e05(joints in prop::array::uniform6(-PI..PI)) {
        let (worst, nearest, count) = round_trip(&arm(e05()), &joints);
        prop_assert!(worst <= 1e-6, "worst {worst}");
        // Every one of the eight branches exists away from singularities, and one of them is where we came from.
        prop_assert_eq!(count, 8);
        if joints[2].sin().abs() > 1e-3 && joints[4].sin().abs() > 1e-3 {
            let wrist = arm(e05()).link_frames(&joints)[4].translation.vector;
            prop_assert!(nearest < 1e-6 || wrist.xy().norm() < 1.0, "nearest {nearest}");
        }
    }

    #[test]
    fn inverse_then_forward_is_the_pose_for_a_general_arm(joints in prop::array::uniform6(-PI..PI)) {
        let (worst, nearest, count) = round_trip(&arm(general()), &joints);
        prop_assert!(worst <= 1e-6, "worst {worst}");
        prop_assert!(count >= 4 && count % 2 == 0);
        if joints[4].sin().abs() > 1e-2 && (joints[2]).sin().abs() > 1e-2 {
            prop_assert!(nearest < 1e-4, "nearest {nearest}");
        }
    }

    #[test]
    fn joints_move_only_the_frames_beyond_them(joints in prop::array::uniform6(-PI..PI), joint in 0usize..6, by in 0.1..1.0) {
        let arm = arm(general());
        let mut moved = joints;
        moved[joint] += by;
        let (before, after) = (arm.link_frames(&joints), arm.link_frames(&moved));
        for frame in 0..=joint {
            prop_assert!(error(&before[frame], &after[frame]) < 1e-9);
        }
        // Origins lie on their joint's axis, so the neighbour's origin keeps its distance.
        for frame in 0..6 {
            let length = |f: &[Isometry3<f64>; 7]| (f[frame + 1].translation.vector - f[frame].translation.vector).norm();
            prop_assert!((length(&before) - length(&after)).abs() < 1e-9);
        }
    }
}
