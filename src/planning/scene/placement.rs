//! Checks of the part's placement: poses are refused that would make every figure of a plan meaningless, and one is known in which the part
//! would tip over. The plate hides what lies behind it from below. Table frame, millimetres.

use nalgebra::{Point3, Vector3};

use super::PlanInput;
use super::defaults::STANDS_WITHIN_RAD;
use crate::cell::Cell;
use crate::geometry::{Mesh, Part, Pose, StablePose, Table};
use crate::planning::context::{PlanError, Refusal};

/// Depth to which a part may reach into the plate: more than meshes and poses are rounded by.
const SUNK_MM: f64 = 0.1;
/// Height above the plate at which the lowest point may be without a fixture.
const FLOATING_MM: f64 = 1.0;
/// Distance below its upper face at which the plate occludes, so that it does not hide what rests on it.
const BELOW_FACE_MM: f64 = 0.05;
/// Triangles of the disc.
const SECTORS: u32 = 96;

/// Refuses a part that reaches into the plate, floats above it or stands beside it.
///
/// # Errors
/// [`PlanError::BadParams`] at `/part/table_from_part`.
pub(in crate::planning) fn check(
    cell: &Cell,
    input: &PlanInput<'_>,
    table_from_part: &Pose<Table, Part>,
) -> Result<(), PlanError> {
    let refuse = |reason: Refusal| Err(PlanError::param("/part/table_from_part", &reason));
    let radius_mm = cell.turntable.plate_radius_mm;
    let vertices = || input.mesh.vertices_mm.iter().map(|p| table_from_part.point(p));
    let lowest_mm = |points: &mut dyn Iterator<Item = Point3<f64>>| points.map(|p| p.z).fold(f64::INFINITY, f64::min);
    let over_plate_mm = lowest_mm(&mut vertices().filter(|p| p.xy().coords.norm() <= radius_mm));
    if over_plate_mm < -SUNK_MM {
        return refuse(Refusal::Sunk { depth_mm: -over_plate_mm, max_mm: SUNK_MM });
    }
    if input.fixture.is_some() {
        return Ok(());
    }
    let bottom_mm = lowest_mm(&mut vertices());
    if bottom_mm > FLOATING_MM {
        return refuse(Refusal::Floating { height_mm: bottom_mm, max_mm: FLOATING_MM });
    }
    let standing: Vec<_> = vertices().filter(|p| p.z <= bottom_mm + FLOATING_MM).map(|p| p.xy().coords).collect();
    let middle = standing.iter().sum::<nalgebra::Vector2<f64>>() / standing.len() as f64;
    if middle.norm() > radius_mm {
        return refuse(Refusal::BesidePlate { distance_mm: middle.norm(), radius_mm });
    }
    Ok(())
}

/// Returns true if a part that nothing holds would tip over in a pose: it stands in other ways, `stable` ([`crate::geometry::stable_poses()`]),
/// and none of them is within 3° of it. Of what stands in no way that is known, a sheet or a ball, nothing is said.
#[must_use]
pub fn tips_over(stable: &[StablePose], table_from_part: &Pose<Table, Part>) -> bool {
    let down = table_from_part.inverse().direction(&-Vector3::z());
    !stable.is_empty() && stable.iter().all(|pose| pose.down.angle(&down) > STANDS_WITHIN_RAD)
}

/// The plate's upper face as an occluder, in the part frame.
#[must_use]
pub fn plate(cell: &Cell, table_from_part: &Pose<Table, Part>) -> Mesh {
    let part_from_table = table_from_part.inverse();
    let rim = |sector: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(sector) / f64::from(SECTORS)).sin_cos();
        Vector3::new(cos, sin, 0.0) * cell.turntable.plate_radius_mm
    };
    let down = Vector3::new(0.0, 0.0, -BELOW_FACE_MM);
    let points = (0..SECTORS).map(rim).chain([Vector3::zeros()]);
    let vertices_mm = points.map(|p| part_from_table.point(&Point3::from(p + down))).collect();
    let faces: Vec<_> = (0..SECTORS).map(|sector| [SECTORS, sector, (sector + 1) % SECTORS]).collect();
    Mesh { vertices_mm, source_face: (0..SECTORS).collect(), faces, groups: Vec::new() }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::geometry::{Poll, stable_poses};
    use crate::planning::scene::{resting, standing_likeliest};
    use crate::testing::{box_mesh, cylinder_mesh};

    /// A pose turned about the part's x axis.
    fn turned(degrees: f64) -> Pose<Table, Part> {
        Pose::from_parts(Vector3::zeros(), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), degrees.to_radians()))
    }

    #[test]
    fn a_block_stands_on_its_sides_and_tips_over_on_an_edge() {
        let block = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
        let stable = stable_poses(&block, &Poll::never()).expect("not interrupted");
        assert!(!tips_over(&stable, &resting(&block)));
        // The numbers of a file are seldom aligned better than to some degrees.
        for degrees in [0.0, 2.5, 90.0, 180.0, -90.0] {
            assert!(!tips_over(&stable, &turned(degrees)), "{degrees}°");
        }
        for degrees in [5.0, 45.0, 80.0, 135.0] {
            assert!(tips_over(&stable, &turned(degrees)), "{degrees}°");
        }
    }

    #[test]
    fn a_part_is_placed_with_the_axis_up_with_which_it_comes_to_rest_likeliest() {
        let plate = box_mesh([0.0; 3], [120.0, 80.0, 3.0]);
        let stable = stable_poses(&plate, &Poll::never()).expect("not interrupted");
        let (up, pose) = standing_likeliest(&plate, &stable).expect("it stands");
        assert_eq!(up.map(|up| up.to_string()).as_deref(), Some("z"));
        assert!(!tips_over(&stable, &pose) && tips_over(&stable, &turned(90.0)));
        // Of ways to stand askew alone the likeliest is told without an axis.
        let askew = StablePose { down: Vector3::new(0.0, 1.0, -1.0).normalize(), share: 0.3 };
        let (up, pose) = standing_likeliest(&plate, std::slice::from_ref(&askew)).expect("it stands");
        assert!(up.is_none() && !tips_over(std::slice::from_ref(&askew), &pose));
        assert!(standing_likeliest(&plate, &[]).is_none(), "no way is known");
    }

    #[test]
    fn a_cone_tips_over_on_its_apex_alone() {
        let mut cone = cylinder_mesh(30.0, 60.0, 24);
        for vertex in cone.vertices_mm.iter_mut().filter(|vertex| vertex.z > 1.0) {
            (vertex.x, vertex.y) = (vertex.x / 30.0, vertex.y / 30.0);
        }
        let stable = stable_poses(&cone, &Poll::never()).expect("not interrupted");
        assert!(!tips_over(&stable, &turned(0.0)) && tips_over(&stable, &turned(180.0)));
        assert!(!tips_over(&[], &turned(180.0)), "where it stands in no way, none is worse");
    }
}
