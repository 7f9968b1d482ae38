//! Remarks on what a URDF says or leaves open, and a plan or a program would take otherwise.

use nalgebra::{Isometry3, Vector3};

use super::document::JointElement;
use super::{Arm, MIN_SHIFT_MM, MIN_TURN_DEG, UrdfRemark, own_range_rad, turn_about, turns};
use crate::cell::axis::AxisSpec;

/// Returns true if one of the words of a robot's name is ABB's, as in `abb_irb2400`.
pub(super) fn is_named_abb(name: &str) -> bool {
    let lower = name.to_lowercase();
    lower.split(|c: char| !c.is_alphanumeric()).any(|word| word == "abb" || word.starts_with("irb"))
}

/// Remark on joint 3, which a URDF counts from the upper arm, and ABB's controllers from the ground on arms with a parallel rod.
/// The preset `abb-irb2400-10` is such an arm.
pub(in crate::cell) fn joint_3_of_abb() -> UrdfRemark {
    UrdfRemark {
        detail: "counts joint 3 from the upper arm, as a URDF does; the controller of an ABB arm with a parallel rod (IRB 2400, \
                 4400, 6400 and others) counts it from the ground, and RAPID programs from this specification are then wrong \
                 by joint 2"
            .to_owned(),
        remedy: "jog joint 2 alone: if the forearm keeps its slope, the controller counts from the ground, and the arm needs \
                 kinematics of kind \"opw\" with joint_3_from_ground = true, as the preset abb-irb2400-10 has; if the forearm \
                 turns along, this is right; then compare the angles on the jog display with the program's, the arm at home"
            .to_owned(),
    }
}

/// Remark on a joint whose range the soft limits narrow.
pub(super) fn narrowed(joint: &JointElement, axis: &AxisSpec) -> Option<UrdfRemark> {
    let (min_rad, max_rad) = own_range_rad(joint);
    let (min_deg, max_deg) = (min_rad.to_degrees(), max_rad.to_degrees());
    (axis.min_deg > min_deg || axis.max_deg < max_deg).then(|| UrdfRemark {
        detail: format!(
            "joint {:?} has {:.1}° to {:.1}°, within the soft limits of its safety_controller; its own limits are {min_deg:.1}° \
             to {max_deg:.1}°",
            joint.name, axis.min_deg, axis.max_deg
        ),
        remedy: "compare with the limits that are set in the controller; min_deg and max_deg of the joint can be changed in the \
                 specification"
            .to_owned(),
    })
}

/// Remark on a flange whose z axis is not along axis 6, to either side.
pub(super) fn tilted_flange(arm: &Arm<'_>) -> Option<UrdfRemark> {
    let last = arm.path.iter().rposition(|joint| turns(joint))?;
    let axis = Vector3::from(arm.path[last].axis).try_normalize(1e-9)?;
    let mut joint_from_flange: Isometry3<f64> = Isometry3::identity();
    for joint in &arm.path[last + 1..] {
        joint_from_flange *= joint.parent_from_joint;
    }
    let z = joint_from_flange.rotation * Vector3::z();
    let off_deg = axis.dot(&z).abs().min(1.0).acos().to_degrees();
    (off_deg > MIN_TURN_DEG).then(|| UrdfRemark {
        detail: format!(
            "z of flange {:?} is {off_deg:.1}° off axis 6 (joint {:?}): `vantage cell` mounts the scanner along the flange's z",
            arm.tip, arm.path[last].name
        ),
        remedy: "name a link whose z points out along axis 6 with --tip, or turn the last fixed joint in the URDF; else \
                 flange_from_scanner and the mount of the cell have to be given in this flange's frame"
            .to_owned(),
    })
}

/// Remark on a flange that nobody named and whose name does not tell it, while other links move with it; each of these has its pose in
/// the flange's frame.
pub(super) fn of_several_flanges(flange: &str, others: &[(&str, Isometry3<f64>)]) -> Option<UrdfRemark> {
    let (first, _) = others.first()?;
    let told: Vec<String> = others.iter().map(|(name, at)| format!("{name:?} ({})", apart(at))).collect();
    Some(UrdfRemark {
        detail: format!("takes link {flange:?} as the flange; other links move with it: {}", told.join(", ")),
        remedy: format!(
            "compare with the flange that the controller shows and to which the hand-eye calibration was measured; if it is another \
             link, name it with --tip, such as --tip {first}; else confirm this one with --tip {flange}"
        ),
    })
}

/// Distance and turn of a link, given its pose.
fn apart(at: &Isometry3<f64>) -> String {
    let shift_mm = at.translation.vector.norm();
    let shift = (shift_mm > MIN_SHIFT_MM).then(|| format!("{shift_mm:.1} mm away"));
    let axis_angle = at.rotation.axis_angle().filter(|(_, turn_rad)| turn_rad.to_degrees() > MIN_TURN_DEG);
    let turn = axis_angle.map(|(axis, turn_rad)| format!("turned by {}", turn_about(&axis, turn_rad)));
    shift.into_iter().chain(turn).collect::<Vec<_>>().join(", ")
}
