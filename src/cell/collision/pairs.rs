//! Pairs of bodies that are tested against each other, each with a bound of its motion.

use super::scene_body::{ParentLink, SceneBody};
use crate::cell::kinematics::Kinematics;

/// Place of the table among the axes.
pub(super) const TABLE_AXIS: usize = 6;

/// Two bodies that are tested against each other.
#[derive(Clone, Debug)]
pub(super) struct BodyPair {
    pub(super) a: usize,
    pub(super) b: usize,
    /// Upper bound on how far they move against each other for each radian of each axis, mm.
    pub(super) motion_bound_mm: [f64; 7],
    /// Distance that they keep.
    pub(super) clearance_mm: f64,
}

impl BodyPair {
    pub(super) fn motion_mm(&self, sweep_rad: &[f64; 7]) -> f64 {
        self.motion_bound_mm.iter().zip(sweep_rad).map(|(bound, angle)| bound * angle).sum()
    }
}

/// Every two bodies that `may_meet`, one of which is the body `first` or a later one.
pub(super) fn body_pairs(
    bodies: &[SceneBody],
    first: usize,
    kinematics: &Kinematics,
    clearance_mm: f64,
    may_meet: impl Fn(&SceneBody, &SceneBody) -> bool,
) -> Vec<BodyPair> {
    let frames = kinematics.link_frames(&[0.0; 6]);
    let between: [f64; 6] =
        std::array::from_fn(|link| (frames[link + 1].translation.vector - frames[link].translation.vector).norm());
    let mut pairs = Vec::new();
    for b in first..bodies.len() {
        for a in 0..b {
            if may_meet(&bodies[a], &bodies[b]) {
                pairs.push(BodyPair {
                    a,
                    b,
                    motion_bound_mm: relative_motion_bound_mm(&bodies[a], &bodies[b], &between, kinematics),
                    clearance_mm,
                });
            }
        }
    }
    pairs
}

/// Farthest distance of a point of the outer body from each axis, 0 for axes that move both or neither.
fn relative_motion_bound_mm(a: &SceneBody, b: &SceneBody, between_mm: &[f64; 6], kinematics: &Kinematics) -> [f64; 7] {
    let (inner, outer) = if a.parent.link() <= b.parent.link() { (a, b) } else { (b, a) };
    // A flange beside axis 6 is nearer to axis 5 in some postures than it is at zero.
    let off_axis_mm = if outer.parent.link() == 6 { 2.0 * kinematics.flange_off_axis_mm() } else { 0.0 };
    let mut motion_bound_mm = [0.0; 7];
    for joint in inner.parent.link()..outer.parent.link() {
        // Joint `joint + 1` turns frame `joint + 1`, from whose origin the chain leads out to the body.
        motion_bound_mm[joint] =
            between_mm[joint + 1..outer.parent.link()].iter().sum::<f64>() + outer.motion_bound_mm + off_axis_mm;
    }
    motion_bound_mm[TABLE_AXIS] =
        [a, b].iter().filter(|body| body.parent == ParentLink::Plate).map(|body| body.motion_bound_mm).sum();
    kinematics.of_vendor_joints(motion_bound_mm)
}
