//! Defaults that depend on the part, the scanner or the presence of a cell.

use super::PlanInput;
use crate::cell::PoseSpec;
use crate::geometry::{Mesh, Part, Pose, Table};
use crate::planning::params::{Hemisphere, PlanParams};
use crate::planning::surface;

/// Part axes parallel to the table's, bottom of the bounding box on the plate, its centre on the axis
/// ([`crate::planning::method::frames`]).
#[must_use]
pub fn resting(mesh: &Mesh) -> Pose<Table, Part> {
    let aabb = mesh.aabb();
    let centre = aabb.centre();
    Pose::from_parts(-nalgebra::Vector3::new(centre.x, centre.y, aabb.min.z), nalgebra::UnitQuaternion::identity())
}

/// Fills in every default that depends on the part, the scanner or the presence of a cell.
pub(in crate::planning) fn resolve(params: &PlanParams, input: &PlanInput<'_>) -> PlanParams {
    let mut resolved = params.preset.apply(params);
    resolved.part = surface::resolve(&params.part, input.mesh);
    resolved.part.table_from_part.get_or_insert_with(|| PoseSpec::from(&resting(input.mesh)));
    let own_deg = input.scanner.devices.as_ref().map(|device| device.incidence_max_rad.to_degrees());
    // One number stands for both cameras: where their own limits differ, it would be false of one of them.
    if own_deg.left.to_bits() == own_deg.right.to_bits() {
        resolved.limits.camera_deg.get_or_insert(own_deg.left);
    }
    resolved.limits.projector_deg.get_or_insert(own_deg.projector);
    let hemisphere = if input.cell.is_some() || params.setups > 1 { Hemisphere::AboveTable } else { Hemisphere::Full };
    resolved.candidates.hemisphere.get_or_insert(hemisphere);
    resolved
}
