//! Kinematics and envelopes against the vendor's own model of the arm.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use vantage::cell::{LinkCapsule, Presets, Robot, SpecLibrary};
use vantage::geometry::{Pose, demo_parts};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams};
use vantage::planning::{PlanInput, plan};

use crate::support::{lines_of, oracle_python, shared};

const URDF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/robots/elfin5.urdf");
const MESHES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/robots/elfin_description/meshes/elfin5");

fn e05() -> Robot {
    Presets.robot("hans-e05-thesis").expect("preset").build().expect("builds")
}

/// Evenly spread joint vectors within the limits (additive recurrence with square roots of primes).
fn spread_joints(robot: &Robot, count: u32) -> Vec<[f64; 6]> {
    let steps = [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0].map(f64::sqrt);
    (1..=count)
        .map(|i| {
            std::array::from_fn(|joint| {
                let axis = robot.joints[joint];
                axis.min_rad + (axis.max_rad - axis.min_rad) * (f64::from(i) * steps[joint]).fract()
            })
        })
        .collect()
}

/// The Python that has `yourdfpy`, where the vendor's model is there too.
fn oracle() -> Option<PathBuf> {
    shared("robots/elfin5.urdf")?;
    oracle_python()
}

/// Poses of `frames` in elfin_base_link by the independent library, metres made millimetres: one list a joint vector.
fn urdf_poses(python: &Path, joints: &[[f64; 6]], frames: &[&str]) -> Vec<Vec<Isometry3<f64>>> {
    let input: String = joints.iter().map(|q| format!("{q:?}\n")).collect();
    let arguments: Vec<&str> = std::iter::once(URDF).chain(frames.iter().copied()).collect();
    lines_of(python, "urdf_fk.py", &arguments, input)
        .iter()
        .map(|line| serde_json::from_str::<Vec<[f64; 7]>>(line).expect("poses").iter().map(millimetres).collect())
        .collect()
}

fn millimetres([x, y, z, i, j, k, w]: &[f64; 7]) -> Isometry3<f64> {
    let translation = Translation3::new(1000.0 * x, 1000.0 * y, 1000.0 * z);
    Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(Quaternion::new(*w, *i, *j, *k)))
}

/// Distance and angle between two poses, mm and degrees.
fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation).to_degrees())
}

#[test]
fn forward_and_inverse_agree_with_the_vendors_urdf() {
    let Some(python) = oracle() else { return };
    let robot = e05();
    let asked = spread_joints(&robot, 1000);
    let poses: Vec<_> = asked.iter().map(|q| robot.base_from_flange(q)).collect();
    // Every branch of every pose, sent through the vendor's chain, must come back to the pose.
    let solved: Vec<(usize, [f64; 6])> = poses
        .iter()
        .enumerate()
        .flat_map(|(i, pose)| robot.kinematics.ik_solutions(pose).into_iter().map(move |q| (i, q)))
        .collect();
    assert_eq!(solved.len(), 8 * asked.len());
    let joints: Vec<_> = asked.iter().copied().chain(solved.iter().map(|(_, q)| *q)).collect();
    let found = urdf_poses(&python, &joints, &["elfin_end_link"]);
    let expected = (0..asked.len()).chain(solved.iter().map(|(i, _)| *i));
    let (mut worst_mm, mut worst_deg) = (0.0_f64, 0.0_f64);
    for (found, index) in found.iter().zip(expected) {
        let (mm, deg) = apart(&found[0], poses[index].isometry());
        (worst_mm, worst_deg) = (worst_mm.max(mm), worst_deg.max(deg));
    }
    println!("{} joint vectors against the URDF: worst {worst_mm:.4} mm, {worst_deg:.5}°", joints.len());
    assert!(worst_mm <= 0.05 && worst_deg <= 0.01, "{worst_mm} mm, {worst_deg}°");
}

#[test]
fn the_vendors_flange_is_reached_by_the_closed_form() {
    let Some(python) = oracle() else { return };
    let robot = e05();
    let asked = spread_joints(&robot, 1000);
    for (q, pose) in asked.iter().zip(urdf_poses(&python, &asked, &["elfin_end_link"])) {
        let branches = robot.kinematics.ik_solutions(&Pose::claim(pose[0]));
        let error = |branch: &[f64; 6]| branch.iter().zip(q).map(|(a, b)| (0.5 * (a - b)).sin().abs()).fold(0.0, f64::max);
        let nearest = branches.iter().map(error).fold(f64::INFINITY, f64::min);
        // The URDF's rounding (1.5708) turns into joint error near singularities: an elbow or wrist in line, the wrist over axis 1.
        assert!(nearest < 0.02 || q[2].sin().abs() < 0.1 || q[4].sin().abs() < 0.1, "{q:?}: {nearest}");
    }
}

/// Vertices of a binary STL in millimetres: the vendor's files hold metres.
fn stl_vertices(name: &str) -> Vec<Point3<f64>> {
    let bytes = std::fs::read(PathBuf::from(MESHES).join(name)).expect("vendor's mesh");
    let number = |at: usize| f64::from(f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]));
    (84..bytes.len() - 49)
        .step_by(50)
        .flat_map(|triangle| (0..3).map(move |corner| triangle + 12 + 12 * corner))
        .map(|at| Point3::new(number(at), number(at + 4), number(at + 8)) * 1000.0)
        .collect()
}

fn distance_to(capsule: &LinkCapsule, point: &Point3<f64>) -> f64 {
    let axis = capsule.to_mm - capsule.from_mm;
    let t = ((point - capsule.from_mm).dot(&axis) / axis.norm_squared()).clamp(0.0, 1.0);
    (point - (capsule.from_mm + axis * t)).norm() - capsule.radius_mm
}

#[test]
fn capsules_hold_the_vendors_meshes() {
    let Some(python) = oracle() else { return };
    let robot = e05();
    let names = ["elfin_base", "elfin_link1", "elfin_link2", "elfin_link3", "elfin_link4", "elfin_link5", "elfin_link6"];
    // A bent arm, so that a capsule on the wrong frame shows.
    let joints = [0.5, -0.4, 1.2, 0.8, -0.6, 0.3];
    let poses = urdf_poses(&python, &[joints], &names).remove(0);
    let frames = robot.link_frames(&joints);
    for (link, (name, base_from_mesh)) in names.iter().zip(poses).enumerate() {
        let out_mm = stl_vertices(&format!("{name}.STL"))
            .iter()
            .map(|vertex| {
                let in_base = base_from_mesh * vertex;
                let around = robot.links.iter().filter(|capsule| capsule.link == link);
                around
                    .map(|capsule| distance_to(capsule, &(frames[capsule.link].inverse() * in_base)))
                    .fold(f64::INFINITY, f64::min)
            })
            .fold(0.0, f64::max);
        assert!(out_mm <= 0.5, "{name} stands {out_mm:.1} mm out of its capsules");
    }
}

#[test]
fn every_station_of_a_plan_puts_the_scanner_there_by_the_vendors_urdf() {
    let Some(python) = oracle() else { return };
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let mesh = demo_parts::base(8_000).expect("a part");
    let input =
        PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
    let cancel = AtomicBool::new(false);
    let plan = plan(
        &input,
        &PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() },
        &Context::new(&cancel, &Silent),
    )
    .expect("a plan")
    .plan;
    let table_from_part = plan.table_from_part.expect("with a cell");
    let stations: Vec<_> = plan.views.iter().map(|view| view.station.expect("a station")).collect();
    let joints: Vec<_> = stations.iter().map(|station| station.joints_rad).collect();
    let flanges = urdf_poses(&python, &joints, &["elfin_end_link"]);
    let (mut worst_mm, mut worst_deg) = (0.0_f64, 0.0_f64);
    for ((view, station), flange) in plan.views.iter().zip(&stations).zip(flanges) {
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), station.table_angle_rad);
        let asked = cell.base_from_table.isometry() * turned * table_from_part.isometry() * view.part_from_scanner.isometry();
        let (mm, deg) = apart(&(flange[0] * cell.flange_from_scanner.isometry()), &asked);
        (worst_mm, worst_deg) = (worst_mm.max(mm), worst_deg.max(deg));
    }
    println!("{} stations against the URDF: worst {worst_mm:.4} mm, {worst_deg:.5}°", stations.len());
    assert!(worst_mm <= 0.1 && worst_deg <= 0.01, "{worst_mm} mm, {worst_deg}°");
}
