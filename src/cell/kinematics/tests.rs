use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::{ChainJointSpec, ChainSpec, Kinematics, KinematicsSpec, OpwSpec, UrSpec};
use crate::cell::PoseSpec;
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
        joint_3_from_ground: false,
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
        joint_3_from_ground: false,
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
    let branches = arm.ik_solutions(&pose);
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
    assert!(!arm.ik_solutions(&at(954.999)).is_empty());
    assert!(arm.ik_solutions(&at(955.001)).is_empty());
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
    let branches = arm.ik_solutions(&above);
    assert!(!branches.is_empty());
    for branch in branches {
        assert!(branch.iter().all(|angle| angle.is_finite()));
        assert!(error(arm.base_from_flange(&branch).isometry(), above.isometry()) <= 1e-6);
    }
}

/// Told by the origin of frame 5, which is beside axis 6, one in seven poses of a UR5e had two solutions of one posture. The
/// margin was 0.05 at the singularity here, and next to nothing at the other joints, where there is none.
#[test]
fn the_wrist_of_an_arm_with_three_parallel_axes_is_where_its_last_two_axes_meet() {
    let ur5e = ur5e();
    // The wrist's centre is in the plane of axes 1 and 2: a2 cos θ2 + a3 cos θ23 + d5 sin θ234 = 0.
    let (theta3, theta4) = (1.2_f64, 0.4_f64);
    let of_cosine = -425.0 - 392.2 * theta3.cos() + 99.7 * (theta3 + theta4).sin();
    let of_sine = 392.2 * theta3.sin() + 99.7 * (theta3 + theta4).cos();
    let singular = (-of_cosine).atan2(of_sine);
    let at = |theta2: f64| [0.3, theta2, theta3, theta4, 0.9, 0.2];
    let (as_chain, _) = chain(chain_of(&ur5e, [[0.0, 0.0, 1.0]; 6], 25.0));
    for arm in [&ur5e, &as_chain] {
        let margins = [singular, 0.998_407_346].map(|theta2| arm.singularity_margin(&at(theta2)));
        assert!(margins[0] < 1e-9 && margins[1] > 0.03, "{margins:?}");
        for off in [-0.1, -0.05, 0.05, 0.1] {
            let branches = ur5e.ik_solutions(&ur5e.base_from_flange(&at(singular + off)));
            let postures: std::collections::BTreeSet<_> = branches.iter().map(|joints| arm.posture(joints)).collect();
            assert_eq!((branches.len(), postures.len()), (8, 8), "{off} beside the singularity");
        }
    }
}

/// Arm with the origin of joint 5 elsewhere on its axis.
fn slid(mut spec: ChainSpec, along_mm: f64) -> ChainSpec {
    let axis = Vector3::from(spec.joints[4].axis).normalize();
    let shift = |by_mm: f64| Isometry3::from_parts(Translation3::from(axis * by_mm), UnitQuaternion::identity());
    let origin = |joint: usize| *spec.joints[joint].origin.pose::<(), ()>().isometry();
    let (five, six) = (origin(4) * shift(along_mm), shift(-along_mm) * origin(5));
    spec.joints[4].origin = PoseSpec::from(&Pose::<(), ()>::claim(five));
    spec.joints[5].origin = PoseSpec::from(&Pose::<(), ()>::claim(six));
    spec
}

/// A URDF has the origin of a joint wherever it likes on the joint's axis.
#[test]
fn an_origin_that_slides_along_its_axis_changes_no_posture() {
    for (arm, axes) in [(arm(general()), OPW_AXES), (ur5e(), [[0.0, 0.0, 1.0]; 6])] {
        let spec = chain_of(&arm, axes, 0.0);
        let (before, after) = (chain(spec.clone()).0, chain(slid(spec, 300.0)).0);
        for step in 0..50 {
            let q: [f64; 6] = std::array::from_fn(|joint| 2.5 * (f64::from(step) * (joint as f64 + 2.0).sqrt() + 0.3).sin());
            let (a, b) = (before.base_from_flange(&q), after.base_from_flange(&q));
            assert!(error(a.isometry(), b.isometry()) < 1e-9, "{q:?}");
            assert_eq!(before.posture(&q), after.posture(&q), "{q:?}");
        }
    }
}

/// −128 has no opposite among numbers of eight bits: a debug build ended in the check itself.
#[test]
fn a_sign_that_is_none_is_refused_by_its_place() {
    for sign in [i8::MIN, 0, 2] {
        let mut findings = crate::cell::Findings::default();
        OpwSpec { sign_corrections: [1, sign, 1, 1, 1, 1], ..e05() }.check("/kinematics", &mut findings);
        let errors = findings.into_result().expect_err("no sign");
        assert_eq!(errors[0].pointer, "/kinematics/sign_corrections/1");
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

/// Universal Robots UR5e, as its maker lists it.
fn ur5e() -> Kinematics {
    let spec = UrSpec { d1_mm: 162.5, a2_mm: -425.0, a3_mm: -392.2, d4_mm: 133.3, d5_mm: 99.7, d6_mm: 99.6 };
    KinematicsSpec::Ur(spec).build()
}

/// The joints of an arm as a chain: origins at zero, axes as given.
fn chain_of(arm: &Kinematics, axes: [[f64; 3]; 6], shift_mm: f64) -> ChainSpec {
    let frames = arm.link_frames(&[0.0; 6]);
    let spec = |pose: Isometry3<f64>| PoseSpec::from(&Pose::<(), ()>::claim(pose));
    let moved = |frame: usize| if frame == 0 { Isometry3::identity() } else { Isometry3::translation(0.0, 0.0, shift_mm) };
    // Each origin slides along its own axis, and all but the foot's are turned: neither may matter.
    let turned = |frame: usize| frames[frame] * UnitQuaternion::from_euler_angles(0.1 * frame as f64, 0.0, 0.2);
    let origin = |joint: usize| spec(if joint == 0 { turned(1) } else { turned(joint).inverse() * turned(joint + 1) });
    let axis = |joint: usize| {
        let in_frame =
            UnitQuaternion::from_euler_angles(0.1 * (joint + 1) as f64, 0.0, 0.2).inverse() * Vector3::from(axes[joint]);
        (2.0 * in_frame).into()
    };
    ChainSpec {
        joints: std::array::from_fn(|joint| ChainJointSpec { origin: origin(joint), axis: axis(joint) }),
        flange: spec(turned(6).inverse() * frames[6] * moved(6)),
    }
}

const OPW_AXES: [[f64; 3]; 6] =
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn chain(spec: ChainSpec) -> (Kinematics, Option<&'static str>) {
    let mut findings = crate::cell::Findings::default();
    spec.check("", &mut findings);
    findings.into_result().expect("a sound chain");
    let built = spec.build();
    let form = built.closed_form();
    (Kinematics::Chain(Box::new(built)), form)
}

#[test]
fn ur5e_lies_along_x_at_zero() {
    // Both links stretched along −x, the wrist hanging: the maker's zero.
    let flange = ur5e().base_from_flange(&[0.0; 6]);
    assert!((flange.origin_mm().coords - Vector3::new(-817.2, -232.9, 62.8)).norm() < 1e-9, "{flange:?}");
    assert!((flange.direction(&Vector3::z()) - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-12);
}

#[test]
fn chains_are_recognised_as_what_they_are() {
    let negated = OPW_AXES.map(|axis| axis.map(|c| -c));
    for (name, arm, axes, form) in [
        ("e05", arm(e05()), OPW_AXES, Some("opw")),
        ("e05 with every axis reversed", arm(e05()), negated, Some("opw")),
        ("general", arm(general()), OPW_AXES, Some("opw")),
        ("ur5e", ur5e(), [[0.0, 0.0, 1.0]; 6], Some("ur")),
        ("ur5e with every axis reversed", ur5e(), [[0.0, 0.0, -1.0]; 6], Some("ur")),
    ] {
        let (chain, found) = chain(chain_of(&arm, axes, 25.0));
        assert_eq!(found, form, "{name}");
        let (worst, nearest, count) = round_trip(&chain, &[0.4, -0.8, 1.0, 0.7, 0.9, -1.2]);
        assert!(worst <= 1e-6 && nearest < 1e-6 && count >= 4, "{name}: {count} solutions, {worst}, nearest {nearest}");
    }
}

#[test]
fn a_calibrated_arm_is_solved_as_it_is_and_not_as_it_was_meant() {
    // A maker's calibration moves every origin by a little and tilts every axis: the closed form is off by millimetres.
    let mut spec = chain_of(&ur5e(), [[0.0, 0.0, 1.0]; 6], 0.0);
    for (number, joint) in spec.joints.iter_mut().enumerate() {
        joint.origin.translation_mm[number % 3] += 0.3 + 0.1 * number as f64;
        joint.axis[(number + 1) % 3] += 0.003;
    }
    let (chain, form) = chain(spec);
    assert_eq!(form, Some("ur"));
    for step in 0..50 {
        let q: [f64; 6] = std::array::from_fn(|joint| 2.5 * (f64::from(step) * (joint as f64 + 2.0).sqrt() + 0.3).sin());
        let (worst, nearest, _) = round_trip(&chain, &q);
        assert!(worst <= 1e-6 && nearest < 1e-5, "{q:?}: {worst}, nearest {nearest}");
    }
}

#[test]
fn an_arm_without_a_closed_form_is_solved_by_steps() {
    // An offset wrist: axis 5 passes axis 4 by 60 mm, so that no three axes meet and no three are parallel.
    let mut spec = chain_of(&arm(general()), OPW_AXES, 0.0);
    spec.joints[4].origin.translation_mm[0] += 60.0;
    spec.joints[5].origin.translation_mm[1] += 45.0;
    let (chain, form) = chain(spec);
    assert_eq!(form, None);
    let mut missed = 0;
    for step in 0..100 {
        let q: [f64; 6] = std::array::from_fn(|joint| 2.2 * (f64::from(step) * (joint as f64 + 2.0).sqrt() + 0.3).sin());
        let (worst, nearest, count) = round_trip(&chain, &q);
        assert!(worst <= 1e-6 && count > 0, "{q:?}: {count} solutions, worst {worst}");
        missed += usize::from(nearest > 1e-4);
    }
    // Steps from spread postures may miss a branch.
    assert!(missed <= 10, "the branch asked for is missed {missed} times of 100");
}

#[test]
fn a_joint_3_from_the_ground_keeps_its_slope_when_joint_2_turns() {
    // Signs of joints 2 and 3 alike, as ABB has them, and different, as FANUC has them: 3 is then less 2, or 3 and 2.
    for (signs, counted) in [([-1, 1, 1, -1, 1, -1], -1.0), ([-1, 1, -1, -1, 1, -1], 1.0)] {
        let plain = OpwSpec { sign_corrections: signs, ..general() };
        let coupled = arm(OpwSpec { joint_3_from_ground: true, ..plain.clone() });
        let q = [0.2, 0.5, -0.3, 0.7, 0.9, -0.4];
        let from_upper_arm = std::array::from_fn(|joint| q[joint] + if joint == 2 { counted * q[1] } else { 0.0 });
        assert_eq!(coupled.base_from_flange(&q), arm(plain).base_from_flange(&from_upper_arm));
        let turned = std::array::from_fn(|joint| q[joint] + if joint == 1 { 0.3 } else { 0.0 });
        let (before, after) = (coupled.link_frames(&q)[3], coupled.link_frames(&turned)[3]);
        assert!(
            before.rotation.angle_to(&after.rotation) < 1e-12
                && (before.translation.vector - after.translation.vector).norm() > 10.0
        );
        let (worst, nearest, count) = round_trip(&coupled, &q);
        assert!(worst <= 1e-6 && nearest < 1e-6 && count >= 4, "{count} solutions, {worst}, nearest {nearest}");
    }
}

#[test]
fn postures_tell_branches_apart_and_margins_fall_to_nothing_at_singularities() {
    for arm in [arm(e05()), arm(general()), ur5e()] {
        let pose = arm.base_from_flange(&[0.3, 0.6, 0.8, 0.4, 0.9, 0.2]);
        let branches = arm.ik_solutions(&pose);
        let postures: std::collections::BTreeSet<_> = branches.iter().map(|joints| arm.posture(joints)).collect();
        assert_eq!((branches.len(), postures.len()), (8, 8));
        for joints in &branches {
            assert!(arm.singularity_margin(joints) > 0.01, "{joints:?}");
        }
    }
    let e05 = arm(e05());
    assert!(e05.singularity_margin(&[0.3, 0.6, 0.8, 0.4, 0.0, 0.2]) < 1e-9, "straight wrist");
    assert!(e05.singularity_margin(&[0.3, 0.6, 0.0, 0.4, 0.9, 0.2]) < 1e-9, "stretched elbow");
    let margin = |q5: f64| e05.singularity_margin(&[0.3, 0.6, 0.8, 0.4, q5, 0.2]);
    assert!(margin(0.1) < margin(0.3) && margin(0.3) < margin(0.8));
    assert_eq!(e05.posture(&[0.3, -0.6, 0.8, 0.4, -0.9, 0.2]).to_string(), "front, elbow up, flip");
}

/// KUKA KR 10 R1100, which counts joints 1, 4 and 6 against the axes of the model.
fn kr10() -> OpwSpec {
    OpwSpec {
        a1_mm: 25.0,
        a2_mm: -35.0,
        b_mm: 0.0,
        c1_mm: 400.0,
        c2_mm: 560.0,
        c3_mm: 515.0,
        c4_mm: 80.0,
        sign_corrections: [-1, 1, 1, -1, 1, -1],
        offsets_deg: [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
        joint_3_from_ground: false,
    }
}

/// The arm as a chain whose axes are turned by `senses`, which are 1 or -1.
fn counted_by(arm: &Kinematics, axes: [[f64; 3]; 6], senses: [f64; 6]) -> Kinematics {
    let turned = std::array::from_fn(|joint| axes[joint].map(|c| senses[joint] * c));
    chain(chain_of(arm, turned, 0.0)).0
}

/// Stations of a KUKA from its URDF, whose axis 1 looks down, were told as "back" while the arm reached forward.
#[test]
fn a_posture_is_that_of_the_arm_whichever_way_its_file_counts_its_angles() {
    let opw = |spec: OpwSpec| (spec.sign_corrections.map(f64::from), arm(spec), OPW_AXES);
    let arms = [opw(e05()), opw(general()), opw(kr10()), ([1.0; 6], ur5e(), [[0.0, 0.0, 1.0]; 6])];
    for (number, (signs, arm, axes)) in arms.iter().enumerate() {
        for bits in 0..64_u8 {
            let senses: [f64; 6] = std::array::from_fn(|joint| if (bits >> joint) & 1 == 1 { -1.0 } else { 1.0 });
            let as_chain = counted_by(arm, *axes, senses);
            for step in 0..10 {
                let q: [f64; 6] = std::array::from_fn(|joint| 2.5 * (f64::from(step) * (joint as f64 + 2.0).sqrt() + 0.3).sin());
                let counted = std::array::from_fn(|joint| senses[joint] * signs[joint] * q[joint]);
                let off = error(arm.base_from_flange(&q).isometry(), as_chain.base_from_flange(&counted).isometry());
                assert!(off < 1e-6, "arm {number}, senses {senses:?}, {q:?}: {off}");
                assert_eq!(as_chain.posture(&counted), arm.posture(&q), "arm {number}, senses {senses:?}, {q:?}");
            }
        }
    }
}

#[test]
fn a_kuka_from_its_urdf_that_reaches_forward_with_a_raised_elbow_is_told_so() {
    let kr10_as_urdf = counted_by(&arm(kr10()), OPW_AXES, kr10().sign_corrections.map(f64::from));
    let q = [0.0, -90.0, 90.0, 0.0, 30.0, 0.0].map(f64::to_radians);
    assert!(kr10_as_urdf.base_from_flange(&q).origin_mm().x > 500.0);
    assert_eq!(kr10_as_urdf.posture(&q).to_string(), "front, elbow up, no flip");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn inverse_then_forward_is_the_pose_for_the_ur5e(joints in prop::array::uniform6(-PI..PI)) {
        let arm = ur5e();
        let (worst, nearest, count) = round_trip(&arm, &joints);
        prop_assert!(worst <= 1e-6, "worst {worst}");
        prop_assert!(count >= 2 && count % 2 == 0);
        if arm.singularity_margin(&joints) > 1e-3 {
            prop_assert!(nearest < 1e-6, "nearest {nearest}");
        }
    }

    #[test]
    fn a_chain_is_solved_like_its_closed_form(joints in prop::array::uniform6(-PI..PI)) {
        let (chain, _) = chain(chain_of(&arm(general()), OPW_AXES, 10.0));
        let (worst, nearest, _) = round_trip(&chain, &joints);
        prop_assert!(worst <= 1e-6, "worst {worst}");
        if chain.singularity_margin(&joints) > 1e-2 {
            prop_assert!(nearest < 1e-4, "nearest {nearest}");
        }
    }
}
