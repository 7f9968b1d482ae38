//! Every arm that ships and every public URDF: what the inverse gives leads back to the pose, and is all there is.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use vantage::cell::urdf::{Imported, LinkSurface, UrdfOptions, import};
use vantage::cell::{Body, Kinematics, KinematicsSpec, LinkBody, Presets, Robot, RobotSpec, Shape, SpecKind, SpecLibrary};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh, Pose};

use crate::support::{all_asked, lines_of, oracle_python, shared};

const URDFS: [&str; 6] = ["elfin5", "irb1200_5_90", "irb2600_12_165", "kr10r1100sixx", "ur5e", "ur10e"];

fn presets() -> Vec<RobotSpec> {
    let names = Presets.names(SpecKind::Robot);
    names.iter().map(|name| Presets.robot(name).expect("a preset")).collect()
}

/// A robot of the public data, its meshes read from beside it; `None` where there are no data.
pub(crate) fn imported(name: &str) -> Option<Imported> {
    let file = shared(&format!("robots/{name}.urdf"))?;
    let text = std::fs::read_to_string(&file).expect("readable");
    let folder = file.parent().expect("a folder").to_owned();
    let mut load = |mesh: &str| -> Result<Mesh, String> {
        let path = folder.join(mesh.strip_prefix("package://").unwrap_or(mesh));
        let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).map(|read| read.mesh).map_err(|e| e.to_string())
    };
    let options = UrdfOptions { name: None, base_link: None, tip_link: None, payload_kg: 5.0, ramp_secs: 0.5 };
    Some(import(&text, &options, &mut load).expect("a robot"))
}

/// Bodies that a robot's specification which names the surfaces has in a cell.
pub(crate) fn link_surfaces(imported: &Imported) -> Vec<LinkBody> {
    let body = |surface: &LinkSurface| Body {
        name: surface.name.clone(),
        owner_from_body: Isometry3::identity(),
        shape: Shape::Mesh(Arc::new(surface.mesh.clone())),
    };
    let on_link = |surface: &LinkSurface| LinkBody { link: usize::from(surface.link), body: body(surface) };
    imported.surfaces.iter().map(on_link).collect()
}

/// Evenly spread joint vectors within the limits.
fn spread(robot: &Robot, count: u32) -> Vec<[f64; 6]> {
    let steps = [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0].map(f64::sqrt);
    let at = |i: u32, joint: usize| {
        let axis = robot.joints[joint];
        axis.min_rad + (axis.max_rad - axis.min_rad) * (f64::from(i) * steps[joint]).fract()
    };
    (1..=count).map(|i| std::array::from_fn(|joint| at(i, joint))).collect()
}

/// The farthest that two joint vectors are apart, whole turns aside.
fn apart(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| 2.0 * (0.5 * (a - b)).sin().abs()).fold(0.0, f64::max)
}

fn assert_solved(spec: &RobotSpec, count: u32) {
    let robot = spec.build().expect("a sound robot");
    let (mut worst_mm, mut worst_rad, mut solutions) = (0.0_f64, 0.0_f64, 0);
    for joints in spread(&robot, count) {
        let pose = robot.base_from_flange(&joints);
        let branches = robot.kinematics.ik_solutions(&pose);
        solutions += branches.len();
        for branch in &branches {
            let found = robot.base_from_flange(branch);
            worst_mm = worst_mm.max((found.origin_mm() - pose.origin_mm()).norm());
            worst_rad = worst_rad.max(found.isometry().rotation.angle_to(&pose.isometry().rotation));
        }
        let nearest = branches.iter().map(|branch| apart(branch, &joints)).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-5 || robot.kinematics.singularity_margin(&joints) < 1e-3, "{}: {joints:?}, {nearest}", spec.name);
    }
    println!("{}: {count} poses, {solutions} solutions, worst {worst_mm:.1e} mm, {worst_rad:.1e} rad", spec.name);
    assert!(worst_mm <= 1e-3 && worst_rad <= 1e-6, "{}: {worst_mm} mm, {worst_rad} rad", spec.name);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_solution_leads_back_to_its_pose() {
    let count = if all_asked() { 10_000 } else { 300 };
    presets().iter().for_each(|spec| assert_solved(spec, count));
    URDFS.iter().filter_map(|name| imported(name)).for_each(|urdf| assert_solved(&urdf.robot, count));
}

#[test]
fn presets_stand_where_the_makers_urdf_stands() {
    // The base that a maker of presets means may be turned against the URDF's about the vertical.
    for (preset, urdf) in [("abb-irb2600-12-165", "irb2600_12_165"), ("ur5e", "ur5e"), ("ur10e", "ur10e")] {
        let Some(urdf) = imported(urdf) else { return };
        let (preset, urdf) =
            (Presets.robot(preset).expect("a preset").build().expect("sound"), urdf.robot.build().expect("sound"));
        let flange = |robot: &Robot, joints: &[f64; 6]| *robot.base_from_flange(joints).isometry();
        let turned = flange(&urdf, &[0.0; 6]) * flange(&preset, &[0.0; 6]).inverse();
        assert!(turned.translation.vector.norm() < 1e-3 && turned.rotation.scaled_axis().xy().norm() < 1e-6, "{turned}");
        for joints in spread(&preset, 200) {
            let (a, b) = (turned * flange(&preset, &joints), flange(&urdf, &joints));
            assert!((a.translation.vector - b.translation.vector).norm() < 1e-3 && a.rotation.angle_to(&b.rotation) < 1e-6);
        }
        for (a, b) in preset.joints.iter().zip(urdf.joints) {
            assert!((a.min_rad - b.min_rad).abs() < 1e-4 && (a.max_rad - b.max_rad).abs() < 1e-4);
        }
    }
}

/// Axes and steps from axis to axis at zero, metres, and the flange's rotation there.
fn described(arm: &Kinematics) -> (serde_json::Value, Isometry3<f64>) {
    let frames = arm.link_frames(&[0.0; 6]);
    let axis = |joint: usize| -> [f64; 3] {
        let turned = arm.link_frames(&std::array::from_fn(|other| if other == joint { 1.0 } else { 0.0 }));
        (turned[6].rotation * frames[6].rotation.inverse()).scaled_axis().normalize().into()
    };
    let mut steps: Vec<[f64; 3]> = Vec::new();
    let mut before = Vector3::zeros();
    for frame in &frames[1..] {
        steps.push(((frame.translation.vector - before) / 1000.0).into());
        before = frame.translation.vector;
    }
    steps.push([0.0; 3]);
    (serde_json::json!({"axes": (0..6).map(axis).collect::<Vec<_>>(), "offsets": steps}), frames[6])
}

/// Solutions by the independent library, a list for each pose.
fn by_oracle(arm: &Kinematics, poses: &[Isometry3<f64>]) -> Option<Vec<Vec<[f64; 6]>>> {
    let python = oracle_python()?;
    let (description, zero) = described(arm);
    let mut input = format!("{description}\n");
    for pose in poses {
        let rotation = (pose.rotation * zero.rotation.inverse()).to_rotation_matrix();
        let at = pose.translation.vector / 1000.0;
        let row = |r: usize| [rotation[(r, 0)], rotation[(r, 1)], rotation[(r, 2)], at[r]];
        let matrix: Vec<f64> = (0..3).flat_map(row).chain([0.0, 0.0, 0.0, 1.0]).collect();
        input += &format!("{matrix:?}\n");
    }
    let lines = lines_of(&python, "ik_oracle.py", &[], input);
    Some(lines.iter().map(|line| serde_json::from_str(line).expect("joint vectors")).collect())
}

#[test]
fn no_solution_is_missing_and_none_is_too_many() {
    for mut spec in presets() {
        // The vendor's count of joint 3 is put on top of the same closed form.
        if let KinematicsSpec::Opw(opw) = &mut spec.kinematics {
            opw.joint_3_from_ground = false;
        }
        let robot = spec.build().expect("sound");
        let asked: Vec<_> = spread(&robot, 1000).into_iter().filter(|q| robot.kinematics.singularity_margin(q) > 0.02).collect();
        let poses: Vec<_> = asked.iter().map(|joints| *robot.base_from_flange(joints).isometry()).collect();
        let Some(found) = by_oracle(&robot.kinematics, &poses) else { return };
        let (mut ours_only, mut theirs_only) = (0, 0);
        for (pose, theirs) in poses.iter().zip(&found) {
            let ours = robot.kinematics.ik_solutions(&Pose::claim(*pose));
            // Beside a singularity of another branch either may leave it out.
            let is_clear = |joints: &&[f64; 6]| robot.kinematics.singularity_margin(joints) > 1e-3;
            let lacks = |list: &[[f64; 6]], joints: &[f64; 6]| list.iter().all(|other| apart(other, joints) > 1e-4);
            ours_only += ours.iter().filter(is_clear).filter(|joints| lacks(theirs, joints)).count();
            theirs_only += theirs.iter().filter(is_clear).filter(|joints| lacks(&ours, joints)).count();
        }
        println!("{}: {} poses; solutions of ours alone {ours_only}, of the oracle alone {theirs_only}", spec.name, poses.len());
        assert_eq!((ours_only, theirs_only), (0, 0), "{}", spec.name);
    }
}
