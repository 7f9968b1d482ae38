//! Defaults that depend on the part, the scanner or the presence of a cell.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::PlanInput;
use crate::cell::PoseSpec;
use crate::geometry::{Aabb, Mesh, Part, Pose, StablePose, Table};
use crate::planning::params::{Hemisphere, PlanParams};
use crate::planning::surface;

/// Lean within which a part that stands has an axis up, radians (3°): files are seldom aligned better.
pub(super) const STANDS_WITHIN_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;

/// Part axes parallel to the table's, bottom of the bounding box on the plate, its centre on the axis
/// ([`crate::planning::method::frames`]).
#[must_use]
pub fn resting(mesh: &Mesh) -> Pose<Table, Part> {
    let aabb = mesh.aabb();
    let centre = aabb.centre();
    Pose::from_parts(-Vector3::new(centre.x, centre.y, aabb.min.z), UnitQuaternion::identity())
}

/// Direction of the part that points up as it stands on the plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpAxis(Vector3<f64>);

/// A word that names no axis.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("is {name:?}; allowed is one of {}", UpAxis::NAMES.map(|(known, _)| known).join(", "))]
pub struct UnknownAxis {
    /// The word.
    pub name: String,
}

impl UpAxis {
    /// Names, with the direction of each in the part frame.
    const NAMES: [(&str, [f64; 3]); 6] = [
        ("x", [1.0, 0.0, 0.0]),
        ("-x", [-1.0, 0.0, 0.0]),
        ("y", [0.0, 1.0, 0.0]),
        ("-y", [0.0, -1.0, 0.0]),
        ("z", [0.0, 0.0, 1.0]),
        ("-z", [0.0, 0.0, -1.0]),
    ];
}

impl UpAxis {
    /// Every axis.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::NAMES.into_iter().map(|(_, direction)| Self(direction.into()))
    }

    /// Returns true if a part that stands in one of these ways has this axis up.
    #[must_use]
    pub fn is_among(&self, stable: &[StablePose]) -> bool {
        stable.iter().any(|pose| pose.down.angle(&-self.0) <= STANDS_WITHIN_RAD)
    }
}

impl std::fmt::Display for UpAxis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = Self::NAMES.into_iter().find(|(_, direction)| Self((*direction).into()) == *self).map(|(name, _)| name);
        f.write_str(name.unwrap_or_default())
    }
}

impl std::str::FromStr for UpAxis {
    type Err = UnknownAxis;

    fn from_str(name: &str) -> Result<Self, UnknownAxis> {
        let plain = name.to_ascii_lowercase();
        let plain = plain.strip_prefix('+').unwrap_or(&plain);
        let found = Self::NAMES.into_iter().find(|(known, _)| *known == plain);
        found.map(|(_, direction)| Self(direction.into())).ok_or_else(|| UnknownAxis { name: name.to_owned() })
    }
}

/// The part turned the shortest way so that this axis points up, placed as [`resting`] does.
#[must_use]
pub fn standing(mesh: &Mesh, up: UpAxis) -> Pose<Table, Part> {
    standing_on(mesh, &-up.0)
}

/// The way to stand in which a part comes to rest most likely, of those with an axis of the part up if there are any: that
/// axis, and the pose. `stable` are the ways in which it stands, the likeliest first ([`crate::geometry::stable_poses()`]);
/// `None` without any.
#[must_use]
pub fn standing_likeliest(mesh: &Mesh, stable: &[StablePose]) -> Option<(Option<UpAxis>, Pose<Table, Part>)> {
    let up = stable.iter().find_map(|pose| UpAxis::all().find(|up| up.is_among(std::slice::from_ref(pose))));
    let down = up.map(|up| -up.0).or_else(|| stable.first().map(|pose| pose.down))?;
    Some((up, standing_on(mesh, &down)))
}

/// The part turned the shortest way so that `down` points down; its lowest point on the plate, its box's centre on the axis.
pub(in crate::planning) fn standing_on(mesh: &Mesh, down: &Vector3<f64>) -> Pose<Table, Part> {
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let turn = UnitQuaternion::rotation_between_axis(&Unit::new_normalize(*down), &-Vector3::z_axis()).unwrap_or(half_turn);
    let turned = mesh.vertices_mm.iter().map(|p| turn * p);
    let aabb = turned.fold(Aabb::empty(), |aabb, p| aabb.with(&p));
    let centre = aabb.centre();
    Pose::from_parts(-Vector3::new(centre.x, centre.y, aabb.min.z), turn)
}

/// Fills in every default that depends on the part, the scanner or the presence of a cell.
#[must_use]
pub fn resolve(params: &PlanParams, input: &PlanInput<'_>) -> PlanParams {
    let mut resolved = params.preset.apply(params);
    resolved.part = surface::resolve(&params.part, input.mesh);
    resolved.part.table_from_part.get_or_insert_with(|| PoseSpec::from(&resting(input.mesh)));
    let own_deg = input.scanner.devices.as_ref().map(|device| device.incidence_max_rad.to_degrees());
    // One number stands for both cameras: where their own limits differ, it would be false of one of them.
    if own_deg.left.to_bits() == own_deg.right.to_bits() {
        resolved.limits.camera_deg.get_or_insert(own_deg.left);
    }
    resolved.limits.projector_deg.get_or_insert(own_deg.projector);
    resolved.robust.use_calibration(input.cell.and_then(|cell| cell.calibrated.as_ref()));
    let hemisphere = if input.cell.is_some() || params.setups > 1 { Hemisphere::AboveTable } else { Hemisphere::Full };
    resolved.candidates.hemisphere.get_or_insert(hemisphere);
    resolved
}
