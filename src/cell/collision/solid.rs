//! Shapes as collision tests see them, and the one question asked of two of them.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};
use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::math::{Pose, Rotation, Vector};
use parry3d::partitioning::BvhNode;
use parry3d::query::PointQuery;
use parry3d::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d::shape::{Cuboid, Cylinder, Segment, Shape as ParryShape, SupportMap, TriMesh, Triangle};

use crate::cell::body::Shape;
use crate::geometry::Mesh;

/// A convex core grown by a radius, or a surface.
#[derive(Clone, Debug)]
pub(super) enum Solid {
    Segment {
        core: Segment,
        radius_mm: f32,
    },
    Box(Cuboid),
    /// Cylinder with its pose, since parry's cylinders stand along y and ours along z.
    Cylinder {
        core: Cylinder,
        body_from_core: Pose,
    },
    Mesh(Arc<TriMesh>),
}

/// Surfaces that were made of meshes, while a scene is put together.
#[derive(Default)]
pub(super) struct Trees(Vec<(Arc<Mesh>, Solid)>);

/// The core of a convex solid and how far it is grown.
struct Convex<'a> {
    core: &'a dyn SupportMap,
    pose: Pose,
    radius_mm: f32,
    aabb: Aabb,
}

impl Solid {
    pub(super) fn from_shape(shape: &Shape) -> Self {
        match shape {
            Shape::Box { size_mm: [x, y, z] } => {
                Self::Box(Cuboid::new(Vector::new(0.5 * *x as f32, 0.5 * *y as f32, 0.5 * *z as f32)))
            }
            Shape::Cylinder { radius_mm, height_mm } => Self::Cylinder {
                core: Cylinder::new(0.5 * *height_mm as f32, *radius_mm as f32),
                body_from_core: Pose::rotation(Vector::new(std::f32::consts::FRAC_PI_2, 0.0, 0.0)),
            },
            Shape::Capsule { radius_mm, length_mm } => {
                let half = Vector::new(0.0, 0.0, 0.5 * *length_mm as f32);
                Self::Segment { core: Segment::new(-half, half), radius_mm: *radius_mm as f32 }
            }
            Shape::Mesh(mesh) => Self::from_mesh(mesh, &Isometry3::identity()),
        }
    }

    /// Builds a solid; a mesh that several bodies share has one tree for all of them.
    pub(super) fn shared(shape: &Shape, trees: &mut Trees) -> Self {
        let Shape::Mesh(mesh) = shape else { return Self::from_shape(shape) };
        if let Some((_, solid)) = trees.0.iter().find(|(known, _)| Arc::ptr_eq(known, mesh)) {
            return solid.clone();
        }
        let solid = Self::from_shape(shape);
        trees.0.push((Arc::clone(mesh), solid.clone()));
        solid
    }

    /// The surface of `mesh`, moved by `body_from_mesh`. A mesh without faces becomes a point at the origin.
    pub(super) fn from_mesh(mesh: &Mesh, body_from_mesh: &Isometry3<f64>) -> Self {
        let vertices = mesh.vertices_mm.iter().map(|vertex| parry_point(&(body_from_mesh * vertex))).collect();
        match TriMesh::new(vertices, mesh.faces.clone()) {
            Ok(surface) => Self::Mesh(Arc::new(surface)),
            Err(_) => Self::Segment { core: Segment::new(Vector::ZERO, Vector::ZERO), radius_mm: 0.0 },
        }
    }

    pub(super) fn aabb(&self, pose: &Pose) -> Aabb {
        match self {
            Self::Segment { core, radius_mm } => core.compute_aabb(pose).loosened(*radius_mm),
            Self::Box(core) => core.compute_aabb(pose),
            Self::Cylinder { core, body_from_core } => core.compute_aabb(&(*pose * *body_from_core)),
            Self::Mesh(surface) => surface.compute_aabb(pose),
        }
    }

    /// Rings about the z axis of the parent's frame that hold a surface however it is turned about that axis: for each the
    /// lowest and highest z, and the radius. None for other shapes.
    pub(super) fn rings_mm(&self, parent_from_body: &Isometry3<f64>, count: usize) -> Vec<([f32; 2], f32)> {
        let Self::Mesh(surface) = self else { return Vec::new() };
        let pose = parry_pose(parent_from_body);
        let aabb = self.aabb(&pose);
        let (low, height) = (aabb.mins.z, (aabb.maxs.z - aabb.mins.z) / count as f32);
        let ring_at = |z: f32| if height > 0.0 { (((z - low) / height) as usize).min(count - 1) } else { 0 };
        let mut radii = vec![None; count];
        for triangle in surface.triangles() {
            let corners = [triangle.a, triangle.b, triangle.c].map(|corner| pose * corner);
            let rings = corners.map(|corner| ring_at(corner.z));
            let radius = corners.iter().map(|corner| corner.x.hypot(corner.y)).fold(0.0, f32::max);
            let (first, last) = (rings[0].min(rings[1]).min(rings[2]), rings[0].max(rings[1]).max(rings[2]));
            radii[first..=last].iter_mut().for_each(|ring: &mut Option<f32>| *ring = Some(ring.unwrap_or(0.0).max(radius)));
        }
        let ring = |(ring, radius): (usize, Option<f32>)| {
            let bottom = low + ring as f32 * height;
            radius.map(|radius| ([bottom, bottom + height], radius))
        };
        radii.into_iter().enumerate().filter_map(ring).collect()
    }

    /// The ends of a capsule's axis.
    pub(super) fn ends_mm(&self) -> Option<[Point3<f64>; 2]> {
        let Self::Segment { core, .. } = self else { return None };
        Some([core.a, core.b].map(|end| Point3::new(end.x, end.y, end.z).cast()))
    }

    /// The ends of the axis about which a capsule or a cylinder is round, the solid being at `pose`; none of other shapes.
    pub(super) fn axis_ends_mm(&self, pose: &Pose) -> Option<[Point3<f64>; 2]> {
        let ends = match self {
            Self::Segment { core, .. } => [core.a, core.b].map(|end| *pose * end),
            Self::Cylinder { core, body_from_core } => {
                [-core.half_height, core.half_height].map(|along| *pose * *body_from_core * Vector::new(0.0, along, 0.0))
            }
            Self::Box(_) | Self::Mesh(_) => return None,
        };
        Some(ends.map(|end| Point3::new(end.x, end.y, end.z).cast()))
    }

    /// Farthest point from the parent's origin, or from its z axis.
    pub(super) fn motion_bound_mm(&self, parent_from_body: &Isometry3<f64>, from_axis: bool) -> f64 {
        let pose = parry_pose(parent_from_body);
        let distance = |point: Vector| if from_axis { point.x.hypot(point.y) } else { point.length() };
        let farthest = match self {
            Self::Mesh(surface) => surface.vertices().iter().map(|vertex| distance(pose * *vertex)).fold(0.0, f32::max),
            Self::Segment { .. } | Self::Box(_) | Self::Cylinder { .. } => {
                self.aabb(&pose).vertices().map(distance).into_iter().fold(0.0, f32::max)
            }
        };
        f64::from(farthest)
    }

    /// Returns true if a point of the body's frame lies in it.
    pub(super) fn holds(&self, point_mm: &Point3<f64>) -> bool {
        let point = parry_point(point_mm);
        match self {
            Self::Segment { core, radius_mm } => core.distance_to_local_point(point, true) <= *radius_mm,
            Self::Box(core) => core.contains_local_point(point),
            Self::Cylinder { core, body_from_core } => core.contains_local_point(body_from_core.inverse_transform_point(point)),
            Self::Mesh(surface) => surrounds(surface, point),
        }
    }

    fn convex(&self, pose: &Pose) -> Option<Convex<'_>> {
        let (core, core_pose, radius_mm): (&dyn SupportMap, Pose, f32) = match self {
            Self::Segment { core, radius_mm } => (core, *pose, *radius_mm),
            Self::Box(core) => (core, *pose, 0.0),
            Self::Cylinder { core, body_from_core } => (core, *pose * *body_from_core, 0.0),
            Self::Mesh(_) => return None,
        };
        Some(Convex { core, pose: core_pose, radius_mm, aabb: self.aabb(pose) })
    }
}

/// Returns true if two placed solids are closer than `margin`, or one is inside the other.
pub(super) fn near((a, pose_a): (&Solid, &Pose), (b, pose_b): (&Solid, &Pose), margin: f32) -> bool {
    match (a, b) {
        (Solid::Mesh(a), Solid::Mesh(b)) => meshes_near((a, pose_a), (b, pose_b), margin),
        (Solid::Mesh(surface), other) => convex_near_mesh(other, pose_b, surface, pose_a, margin),
        (other, Solid::Mesh(surface)) => convex_near_mesh(other, pose_a, surface, pose_b, margin),
        (a, b) => match (a.convex(pose_a), b.convex(pose_b)) {
            (Some(a), Some(b)) => {
                let limit = margin + a.radius_mm + b.radius_mm;
                cores_near(a.core, b.core, &a.pose.inv_mul(&b.pose), limit)
            }
            _ => false,
        },
    }
}

fn convex_near_mesh(solid: &Solid, pose: &Pose, surface: &TriMesh, surface_pose: &Pose, margin: f32) -> bool {
    let pose_in_mesh = surface_pose.inv_mul(pose);
    solid
        .convex(&pose_in_mesh)
        .is_some_and(|convex| surface_near(surface, &convex, margin) || surrounds(surface, convex.aabb.center()))
}

/// Returns true if a triangle of `surface` is closer to `convex` (given in the mesh's frame) than `margin`.
fn surface_near(surface: &TriMesh, convex: &Convex<'_>, margin: f32) -> bool {
    let reach = convex.aabb.loosened(margin);
    let limit = margin + convex.radius_mm;
    let node_near = |node: &BvhNode| {
        let aabb = node.aabb();
        aabb.intersects(&reach) && {
            let block = Cuboid::new(aabb.half_extents());
            cores_near(&block, convex.core, &Pose::from_translation(aabb.center()).inv_mul(&convex.pose), limit)
        }
    };
    surface.bvh().leaves(node_near).any(|leaf| cores_near(&surface.triangle(leaf), convex.core, &convex.pose, limit))
}

/// Two surfaces: their triangles, or one within the other, which a single vertex shows where the surfaces do not meet.
fn meshes_near((a, pose_a): (&TriMesh, &Pose), (b, pose_b): (&TriMesh, &Pose), margin: f32) -> bool {
    let b_from_a = pose_b.inv_mul(pose_a);
    surfaces_near(a, b, &b_from_a, margin)
        || a.vertices().first().is_some_and(|vertex| surrounds(b, b_from_a * *vertex))
        || b.vertices().first().is_some_and(|vertex| surrounds(a, b_from_a.inverse() * *vertex))
}

fn surfaces_near(a: &TriMesh, b: &TriMesh, b_from_a: &Pose, margin: f32) -> bool {
    let boxes_near = |in_a: &BvhNode, in_b: &BvhNode| {
        let (a, b) = (in_a.aabb().transform_by(b_from_a), in_b.aabb());
        let between = (b.mins - a.maxs).max(a.mins - b.maxs).max(Vector::ZERO);
        between.length_squared() <= margin * margin
    };
    let mut pairs = a.bvh().leaf_pairs(b.bvh(), boxes_near);
    pairs.any(|(in_a, in_b)| cores_near(&b.triangle(in_b), &a.triangle(in_a), b_from_a, margin))
}

/// Returns true if two convex cores are closer than `limit`; `second` is placed in the frame of the first.
fn cores_near<A: SupportMap + ?Sized, B: SupportMap + ?Sized>(first: &A, second: &B, pose: &Pose, limit: f32) -> bool {
    let towards = -pose.translation;
    let direction = towards.try_normalize().unwrap_or(Vector::X);
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::from_shapes(pose, first, second, direction));
    let found = closest_points(pose, first, second, limit, false, &mut simplex);
    let gap_along = |axis: Vector| -axis.dot(CsoPoint::from_shapes(pose, first, second, axis).point);
    !is_apart(&found, gap_along, limit)
}

/// Returns true if the search has found an axis along which the cores are farther apart than `limit`. After 100 steps without an
/// answer parry tells the x axis, as if it had found that: along this axis the gap is evaluated again, and where it is not wider
/// than `limit` the cores count as near.
pub(super) fn is_apart(found: &GJKResult, gap_along: impl Fn(Vector) -> f32, limit: f32) -> bool {
    match found {
        GJKResult::NoIntersection(axis) => *axis != Vector::X || gap_along(*axis) > limit,
        GJKResult::Intersection | GJKResult::ClosestPoints(..) | GJKResult::Proximity(_) => false,
    }
}

/// Shift of a ray across its axis, mm: through an edge it would cross both triangles beside it, as in the middle of a box, whose sides
/// are halved by their diagonals.
const ASIDE_MM: Vector = Vector::new(1.37e-3, -0.71e-3, 0.93e-3);

/// Returns true if a closed surface surrounds the point: an odd number of crossings along each of three axes. A hole in the
/// surface lets a ray out, so of an open surface nothing is inside that the holes lay bare.
fn surrounds(surface: &TriMesh, point: Vector) -> bool {
    let crossed = |axis: Vector| crossings(surface, point + (Vector::ONE - axis) * ASIDE_MM, axis);
    surface.local_aabb().contains_local_point(point)
        && [Vector::X, Vector::Y, Vector::Z].into_iter().all(|axis| crossed(axis) % 2 == 1)
}

fn crossings(surface: &TriMesh, point: Vector, axis: Vector) -> usize {
    let ahead = |node: &BvhNode| {
        let (low, high) = (node.mins() - point, node.maxs() - point);
        let along = high.dot(axis) >= 0.0;
        // Across the ray's axis the box must hold the point; along it anything ahead counts.
        let beside = (Vector::ONE - axis) * low.max(-high);
        along && beside.max_element() <= 0.0
    };
    surface.bvh().leaves(ahead).filter(|leaf| crosses(&surface.triangle(*leaf), point, axis)).count()
}

/// Möller and Trumbore 1997, without the distance.
fn crosses(triangle: &Triangle, point: Vector, axis: Vector) -> bool {
    let (edge1, edge2) = (triangle.b - triangle.a, triangle.c - triangle.a);
    let normal = axis.cross(edge2);
    let determinant = edge1.dot(normal);
    if determinant == 0.0 {
        return false;
    }
    let offset = point - triangle.a;
    let u = offset.dot(normal) / determinant;
    let across = offset.cross(edge1);
    let v = axis.dot(across) / determinant;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && edge2.dot(across) / determinant >= 0.0
}

/// Single precision, for parry.
pub(super) fn parry_pose(isometry: &Isometry3<f64>) -> Pose {
    let q = isometry.rotation.quaternion();
    let translation = parry_point(&Point3::from(isometry.translation.vector));
    Pose::from_parts(translation, Rotation::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32))
}

fn parry_point(point: &Point3<f64>) -> Vector {
    Vector::new(point.x as f32, point.y as f32, point.z as f32)
}
