//! Comparison of the flange that the arm's model computes with the one that its controller reported: a tool that is active, another
//! arm, joints in another unit or order.

use nalgebra::{Isometry3, Vector3};

use super::findings::{CalibrationFinding, Figures, FindingCode, Severity};
use super::se3::{log, mean_pose, rotation_of, translation_of};

/// Agreement of model and controller, of what they print: rounding to 0.01 mm and 0.01°, and an arm that its maker has calibrated.
const CLOSE_MM: f64 = 3.0;
const CLOSE_RAD: f64 = 0.01;
/// Offset below which there is no tool.
const NO_TOOL_MM: f64 = 0.5;
const NO_TOOL_RAD: f64 = 0.002;

/// An observation with both.
pub struct Witnessed<'a> {
    /// Name of the observation.
    pub id: &'a str,
    /// Joints as they were read, taken for radians.
    pub joints_rad: [f64; 6],
    /// Flange as the controller reported it.
    pub base_from_flange: Isometry3<f64>,
}

/// Forward kinematics: joints, rad, to base_from_flange.
pub type Forward<'a> = &'a dyn Fn(&[f64; 6]) -> Isometry3<f64>;

/// Compares; a tool that is the same everywhere is an error as well, since the scanner would be put on the wrong frame.
#[must_use]
pub fn compare(witnessed: &[Witnessed<'_>], forward: Forward<'_>) -> Vec<CalibrationFinding> {
    if witnessed.is_empty() {
        return Vec::new();
    }
    let (tool, worst_mm, worst_rad) = offset(witnessed, forward, |joints| joints);
    if worst_mm <= CLOSE_MM && worst_rad <= CLOSE_RAD {
        let (tool_rad, tool_mm) = (tool.rotation.angle(), tool.translation.vector.norm());
        let is_tool = tool_mm > NO_TOOL_MM.max(worst_mm) || tool_rad > NO_TOOL_RAD.max(worst_rad);
        let figures = Figures { vector: Some(tool.translation.vector), turn_rad: Some(tool_rad), ..Figures::default() };
        return if is_tool {
            vec![CalibrationFinding::new(FindingCode::ToolActive, Severity::Error).with(figures)]
        } else {
            Vec::new()
        };
    }
    let fits = |change: &dyn Fn([f64; 6]) -> [f64; 6]| {
        let (_, mm, rad) = offset(witnessed, forward, change);
        mm <= CLOSE_MM && rad <= CLOSE_RAD
    };
    let code = if fits(&|joints| joints.map(f64::to_degrees)) || fits(&|joints| joints.map(f64::to_radians)) {
        FindingCode::AngleUnit
    } else if orders().iter().any(|order| fits(&|joints| order(joints))) {
        FindingCode::JointOrder
    } else if is_out_of_step(witnessed, forward) {
        FindingCode::OutOfStep
    } else {
        FindingCode::WrongRobotModel
    };
    let figures = Figures { length_mm: Some(worst_mm), turn_rad: Some(worst_rad), ..Figures::default() };
    vec![CalibrationFinding::new(code, Severity::Error).with(figures)]
}

/// Mean offset of the reported from the computed flange, and the largest distance of a single one from that mean.
fn offset(
    witnessed: &[Witnessed<'_>],
    forward: Forward<'_>,
    change: impl Fn([f64; 6]) -> [f64; 6],
) -> (Isometry3<f64>, f64, f64) {
    let tools: Vec<_> =
        witnessed.iter().map(|each| forward(&change(each.joints_rad)).inverse() * each.base_from_flange).collect();
    let mean = mean_pose(&tools);
    let off = tools.iter().map(|tool| log(&(mean.inverse() * tool)));
    let (worst_mm, worst_rad) =
        off.fold((0.0, 0.0), |(mm, rad): (f64, f64), by| (mm.max(translation_of(&by).norm()), rad.max(rotation_of(&by).norm())));
    (mean, worst_mm, worst_rad)
}

type Order = fn([f64; 6]) -> [f64; 6];

/// Orders and senses in which joints are met: from the flange, the last first, joint 3 or all of them the other way.
fn orders() -> [Order; 5] {
    [
        |[a, b, c, d, e, f]| [f, e, d, c, b, a],
        |[a, b, c, d, e, f]| [b, c, d, e, f, a],
        |[a, b, c, d, e, f]| [f, a, b, c, d, e],
        |[a, b, c, d, e, f]| [a, b, -c, d, e, f],
        |joints| joints.map(|joint| -joint),
    ]
}

/// Returns true if the poses fit the joints one observation earlier or later.
fn is_out_of_step(witnessed: &[Witnessed<'_>], forward: Forward<'_>) -> bool {
    let count = witnessed.len();
    let fits = |step: usize| {
        let pairs = (0..count.saturating_sub(1)).map(|index| (index + step, index + 1 - step));
        let off = pairs.map(|(joints, pose)| {
            let computed = forward(&witnessed[joints].joints_rad);
            (computed.inverse() * witnessed[pose].base_from_flange).translation.vector
        });
        off.map(|off: Vector3<f64>| off.norm()).fold(0.0, f64::max) <= CLOSE_MM
    };
    count > 3 && (fits(0) || fits(1))
}

#[cfg(test)]
mod tests;
