use nalgebra::{Translation3, UnitQuaternion};

use super::*;
use crate::cell::{Cell, Presets, SpecLibrary};

fn cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset")
}

const JOINTS_DEG: [[f64; 6]; 5] = [
    [0.0, -30.0, 60.0, 10.0, 30.0, 5.0],
    [20.0, -40.0, 80.0, -20.0, 40.0, 60.0],
    [-35.0, -20.0, 50.0, 35.0, -25.0, -80.0],
    [50.0, -60.0, 95.0, -50.0, 60.0, 130.0],
    [-10.0, -50.0, 70.0, 80.0, 20.0, -15.0],
];

/// Findings where the controller reports `reported` for joints that the file gives as `written`.
fn found(
    written: impl Fn([f64; 6]) -> [f64; 6],
    reported: impl Fn(usize, &dyn Fn(usize) -> Isometry3<f64>) -> Isometry3<f64>,
) -> Vec<CalibrationFinding> {
    let cell = cell();
    let forward = |joints: &[f64; 6]| *cell.robot.base_from_flange(joints).isometry();
    let true_flange = |index: usize| forward(&JOINTS_DEG[index].map(f64::to_radians));
    let ids: Vec<String> = (0..JOINTS_DEG.len()).map(|index| format!("p{index}")).collect();
    let witnessed: Vec<Witnessed<'_>> = (0..JOINTS_DEG.len())
        .map(|index| Witnessed {
            id: &ids[index],
            joints_rad: written(JOINTS_DEG[index].map(f64::to_radians)),
            base_from_flange: reported(index, &true_flange),
        })
        .collect();
    compare(&witnessed, &forward)
}

#[test]
fn an_arm_that_agrees_has_no_finding() {
    assert_eq!(found(|joints| joints, |index, flange| flange(index)), []);
    assert_eq!(compare(&[], &|_| Isometry3::identity()), []);
    // A controller prints hundredths of a millimetre.
    let printed = |index: usize, flange: &dyn Fn(usize) -> Isometry3<f64>| {
        let pose = flange(index);
        let rounded = pose.translation.vector.map(|mm| (mm * 100.0).round() / 100.0);
        Isometry3::from_parts(Translation3::from(rounded), pose.rotation)
    };
    assert_eq!(found(|joints| joints, printed), []);
}

#[test]
fn an_active_tool_is_told_with_its_offset() {
    let tool = Isometry3::from_parts(Translation3::new(0.0, 0.0, 182.3), UnitQuaternion::from_euler_angles(0.0, 0.0, 0.5));
    let findings = found(|joints| joints, |index, flange| flange(index) * tool);
    assert_eq!((findings.len(), findings[0].code, findings[0].severity), (1, FindingCode::ToolActive, Severity::Error));
    let offset = findings[0].figures.vector.expect("an offset");
    assert!((offset - Vector3::new(0.0, 0.0, 182.3)).norm() < 1e-6, "{offset}");
    assert!((findings[0].figures.turn_rad.expect("a turn") - 0.5).abs() < 1e-9);
}

#[test]
fn what_the_joints_look_like_is_named() {
    let code = |findings: Vec<CalibrationFinding>| {
        assert_eq!(findings.len(), 1, "{findings:?}");
        findings[0].code
    };
    let as_reported = |index: usize, flange: &dyn Fn(usize) -> Isometry3<f64>| flange(index);
    // Radians in a file that says degrees, and the other way round.
    assert_eq!(code(found(|joints| joints.map(f64::to_radians), as_reported)), FindingCode::AngleUnit);
    assert_eq!(code(found(|joints| joints.map(f64::to_degrees), as_reported)), FindingCode::AngleUnit);
    let orders: [fn([f64; 6]) -> [f64; 6]; 3] =
        [|[a, b, c, d, e, f]| [f, e, d, c, b, a], |[a, b, c, d, e, f]| [a, b, -c, d, e, f], |joints| joints.map(|joint| -joint)];
    for order in orders {
        assert_eq!(code(found(order, as_reported)), FindingCode::JointOrder);
    }
    let late = |index: usize, flange: &dyn Fn(usize) -> Isometry3<f64>| flange((index + 1).min(JOINTS_DEG.len() - 1));
    assert_eq!(code(found(|joints| joints, late)), FindingCode::OutOfStep);
    let other_arm = |index: usize, flange: &dyn Fn(usize) -> Isometry3<f64>| {
        Isometry3::translation(0.0, 0.0, 40.0 * index as f64) * flange(index)
    };
    assert_eq!(code(found(|joints| joints, other_arm)), FindingCode::WrongRobotModel);
}
