//! The surface of a rigid body in triangles, for lines of sight.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Point3;

use super::body::{Body, Shape};
use crate::geometry::Mesh;

/// Plane sides around a round shape, which they enclose: 0.06 % of its radius at most lies between the two.
const SIDES: u32 = 90;
/// Rings of each half ball of a capsule.
const BALL_RINGS: u32 = 12;

impl Body {
    /// Surface of the body in its owner's frame. Round shapes are enclosed by plane sides.
    #[must_use]
    pub fn surface(&self) -> Mesh {
        let mut mesh = match &self.shape {
            Shape::Box { size_mm } => box_around_origin(*size_mm),
            Shape::Cylinder { radius_mm, height_mm } => {
                let half_mm = 0.5 * height_mm;
                revolved(&[[*radius_mm, -half_mm], [*radius_mm, half_mm]], [-half_mm, half_mm])
            }
            Shape::Capsule { radius_mm, length_mm } => capsule(*radius_mm, 0.5 * length_mm),
            Shape::Mesh(mesh) => (**mesh).clone(),
        };
        mesh.vertices_mm.iter_mut().for_each(|vertex| *vertex = self.owner_from_body * *vertex);
        mesh
    }
}

fn mesh_of(vertices_mm: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

fn box_around_origin(size_mm: [f64; 3]) -> Mesh {
    const QUADS: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let corner = |i: usize| Point3::from([0, 1, 2].map(|axis| size_mm[axis] * if i >> axis & 1 == 1 { 0.5 } else { -0.5 }));
    let faces = QUADS.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    mesh_of((0..8).map(corner).collect(), faces)
}

fn capsule(radius_mm: f64, half_length_mm: f64) -> Mesh {
    // A chord of the half circle lies within it by as much as a side of the regular polygon does.
    let radius_mm = radius_mm / (0.5 * FRAC_PI_2 / f64::from(BALL_RINGS)).cos();
    let ring = |ring: u32, end: f64| {
        let (sin, cos) = (FRAC_PI_2 * f64::from(ring) / f64::from(BALL_RINGS)).sin_cos();
        [radius_mm * cos, end * (half_length_mm + radius_mm * sin)]
    };
    let below = (0..BALL_RINGS).rev().map(|number| ring(number, -1.0));
    let rings: Vec<_> = below.chain((0..BALL_RINGS).map(|number| ring(number, 1.0))).collect();
    let pole_mm = half_length_mm + radius_mm;
    revolved(&rings, [-pole_mm, pole_mm])
}

/// The closed surface about z through rings, each a radius and a height, ascending, with its poles at two heights.
fn revolved(rings: &[[f64; 2]], poles_mm: [f64; 2]) -> Mesh {
    let outward = 1.0 / (PI / f64::from(SIDES)).cos();
    let corner = |[radius_mm, z_mm]: [f64; 2], side: u32| {
        let (sin, cos) = (TAU * f64::from(side) / f64::from(SIDES)).sin_cos();
        Point3::new(outward * radius_mm * cos, outward * radius_mm * sin, z_mm)
    };
    let mut vertices_mm: Vec<_> = rings.iter().flat_map(|ring| (0..SIDES).map(move |side| corner(*ring, side))).collect();
    let (count, pole) = (rings.len() as u32, vertices_mm.len() as u32);
    vertices_mm.extend(poles_mm.map(|z_mm| Point3::new(0.0, 0.0, z_mm)));
    let faces = (0..SIDES).flat_map(|side| {
        let next = (side + 1) % SIDES;
        let between = (1..count).flat_map(move |ring| {
            let (below, above) = ((ring - 1) * SIDES, ring * SIDES);
            [[below + side, below + next, above + next], [below + side, above + next, above + side]]
        });
        let top = (count - 1) * SIDES;
        between.chain([[pole, next, side], [pole + 1, top + side, top + next]])
    });
    let faces = faces.collect();
    mesh_of(vertices_mm, faces)
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::{Body, Shape};
    use crate::geometry::{Mesh, Poll, is_closed};

    fn surface(shape: Shape) -> Mesh {
        Body { name: "body".into(), owner_from_body: Isometry3::translation(10.0, 20.0, 30.0), shape }.surface()
    }

    /// Volume inside a closed mesh that is wound outward, by the divergence theorem.
    fn volume_mm3(mesh: &Mesh) -> f64 {
        let signed = |face: usize| {
            let [a, b, c] = mesh.corners(face).map(|corner| corner.coords);
            a.dot(&b.cross(&c)) / 6.0
        };
        (0..mesh.faces.len()).map(signed).sum()
    }

    #[test]
    fn shapes_are_closed_wound_outward_where_the_body_is_and_as_large_as_it() {
        let pi = std::f64::consts::PI;
        for (shape, expected_mm3) in [
            (Shape::Box { size_mm: [4.0, 6.0, 10.0] }, 240.0),
            (Shape::Cylinder { radius_mm: 5.0, height_mm: 20.0 }, pi * 25.0 * 20.0),
            (Shape::Capsule { radius_mm: 5.0, length_mm: 20.0 }, pi * 25.0 * 20.0 + 4.0 / 3.0 * pi * 125.0),
        ] {
            let mesh = surface(shape.clone());
            assert!(is_closed(&mesh, &Poll::new(&|| false)).expect("not interrupted"), "{shape:?}");
            let share = volume_mm3(&mesh) / expected_mm3;
            assert!((1.0 - 1e-9..1.01).contains(&share), "{shape:?}: {share} of its volume");
            let centre = mesh.aabb().centre();
            assert!((centre.coords - nalgebra::Vector3::new(10.0, 20.0, 30.0)).norm() < 1e-9, "{shape:?}: {centre}");
        }
    }
}
