//! A bowl, a blind hole and an L-pocket, each with its triangles named. Millimetres, outward winding, mouths at z = 0.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};
use vantage::geometry::Mesh;

/// Corners around a body of revolution.
const SECTORS: u32 = 180;

/// A mesh and the name of the part that each triangle belongs to.
pub(crate) struct Body {
    pub(crate) mesh: Mesh,
    names: Vec<&'static str>,
}

impl Body {
    /// Triangles of a part.
    pub(crate) fn faces(&self, name: &str) -> Vec<u32> {
        (0..).zip(&self.names).filter(|(_, of)| **of == name).map(|(face, _)| face).collect()
    }

    /// Triangles that are not asked for.
    pub(crate) fn outside(&self) -> Vec<u32> {
        self.faces("outside")
    }

    fn new(triangles: Vec<([Point3<f64>; 3], &'static str)>) -> Self {
        let names = triangles.iter().map(|(_, name)| *name).collect();
        let vertices_mm = triangles.iter().flat_map(|(corners, _)| *corners).collect();
        let faces: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Self { mesh: Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }, names }
    }
}

/// Turns a profile of (radius, height) about z; each piece of it has a name. Outside is to its right.
fn revolved(profile: &[([f64; 2], &'static str)]) -> Body {
    let point = |[radius, z]: [f64; 2], sector: u32| {
        let angle = 2.0 * PI * f64::from(sector % SECTORS) / f64::from(SECTORS);
        Point3::new(radius * angle.cos(), radius * angle.sin(), z)
    };
    let mut triangles = Vec::new();
    for pair in profile.windows(2) {
        let ([from, to], name) = ([pair[0].0, pair[1].0], pair[1].1);
        for sector in 0..SECTORS {
            let [a, b, c, d] = [point(from, sector), point(from, sector + 1), point(to, sector), point(to, sector + 1)];
            if from[0] > 0.0 {
                triangles.push(([a, b, c], name));
            }
            if to[0] > 0.0 {
                triangles.push(([b, d, c], name));
            }
        }
    }
    Body::new(triangles)
}

/// Part of a sphere of this radius, out to this angle from its lowest point, in a block.
pub(crate) fn bowl(radius_mm: f64, half_angle_deg: f64) -> Body {
    const ARCS: u32 = 60;
    let half_angle = half_angle_deg.to_radians();
    let (rim_mm, centre_mm) = (radius_mm * half_angle.sin(), radius_mm * half_angle.cos());
    let bottom_mm = centre_mm - radius_mm - 5.0;
    let mut profile = vec![
        ([0.0, bottom_mm], "outside"),
        ([rim_mm + 5.0, bottom_mm], "outside"),
        ([rim_mm + 5.0, 0.0], "outside"),
        ([rim_mm, 0.0], "outside"),
    ];
    profile.extend((0..ARCS).rev().map(|arc| {
        let angle = half_angle * f64::from(arc) / f64::from(ARCS);
        ([radius_mm * angle.sin(), centre_mm - radius_mm * angle.cos()], "bowl")
    }));
    revolved(&profile)
}

/// A blind hole along −z in a cylinder.
pub(crate) fn blind_hole(radius_mm: f64, depth_mm: f64) -> Body {
    let (outer_mm, bottom_mm) = (radius_mm + 6.0, -depth_mm - 5.0);
    revolved(&[
        ([0.0, bottom_mm], "outside"),
        ([outer_mm, bottom_mm], "outside"),
        ([outer_mm, 0.0], "outside"),
        ([radius_mm, 0.0], "outside"),
        ([radius_mm, -depth_mm], "wall"),
        ([0.0, -depth_mm], "floor"),
    ])
}

/// An L-pocket: a shaft from x = 0 to its width, and at its bottom a leg to the right; it runs along y.
pub(crate) struct Pocket {
    pub(crate) width_mm: f64,
    pub(crate) depth_mm: f64,
    pub(crate) leg_mm: f64,
    pub(crate) leg_height_mm: f64,
    pub(crate) half_length_mm: f64,
}

/// A rectangle along y over a line in the x–z plane.
#[derive(Clone, Copy)]
pub(crate) struct Strip {
    from: [f64; 2],
    to: [f64; 2],
    half_length_mm: f64,
    name: &'static str,
}

impl Strip {
    pub(crate) fn area_mm2(&self) -> f64 {
        (self.to[0] - self.from[0]).hypot(self.to[1] - self.from[1]) * 2.0 * self.half_length_mm
    }

    /// The unit square onto the strip.
    pub(crate) fn point(&self, u: f64, v: f64) -> Point3<f64> {
        let along = |axis: usize| self.from[axis] + u * (self.to[axis] - self.from[axis]);
        Point3::new(along(0), (2.0 * v - 1.0) * self.half_length_mm, along(1))
    }

    /// Unit normal to the right of the line.
    pub(crate) fn normal(&self) -> Vector3<f64> {
        Vector3::new(self.to[1] - self.from[1], 0.0, self.from[0] - self.to[0]).normalize()
    }

    fn triangles(&self) -> [([Point3<f64>; 3], &'static str); 2] {
        let [a, b, c, d] = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(|(u, v)| self.point(u, v));
        [([a, b, c], self.name), ([b, d, c], self.name)]
    }
}

impl Pocket {
    fn strips(&self, points: &[[f64; 2]], names: &[&'static str]) -> Vec<Strip> {
        let strip = |(pair, name): (&[[f64; 2]], &&'static str)| Strip {
            from: pair[0],
            to: pair[1],
            half_length_mm: self.half_length_mm,
            name,
        };
        points.windows(2).zip(names).map(strip).collect()
    }

    /// The faces of the pocket, its ends left out.
    pub(crate) fn faces(&self) -> Vec<Strip> {
        let (w, h, end, under) = (self.width_mm, -self.depth_mm, self.width_mm + self.leg_mm, self.leg_height_mm - self.depth_mm);
        self.strips(
            &[[w, 0.0], [w, under], [end, under], [end, h], [0.0, h], [0.0, 0.0]],
            &["shaft", "ceiling", "end", "floor", "shaft"],
        )
    }
}

/// The block around it is 20 mm thicker than the pocket; its ends along y are open where the pocket is.
pub(crate) fn l_pocket(pocket: &Pocket) -> Body {
    let (w, h, end, under) =
        (pocket.width_mm, -pocket.depth_mm, pocket.width_mm + pocket.leg_mm, pocket.leg_height_mm - pocket.depth_mm);
    let (left, right, bottom) = (-20.0, end + 20.0, h - 20.0);
    let around = [[0.0, 0.0], [left, 0.0], [left, bottom], [right, bottom], [right, 0.0], [w, 0.0]];
    let strips = pocket.faces().into_iter().chain(pocket.strips(&around, &["outside"; 5]));
    let mut triangles: Vec<_> = strips.flat_map(|strip| strip.triangles()).collect();
    // The solid's section, cut into rectangles, closes both ends.
    for [x0, z0, x1, z1] in [[left, bottom, 0.0, 0.0], [0.0, bottom, end, h], [w, under, end, 0.0], [end, bottom, right, 0.0]] {
        for y in [-pocket.half_length_mm, pocket.half_length_mm] {
            let [a, b, c, d] = [[x0, z0], [x1, z0], [x0, z1], [x1, z1]].map(|[x, z]| Point3::new(x, y, z));
            let quad = if y < 0.0 { [[a, b, c], [b, d, c]] } else { [[a, c, b], [b, c, d]] };
            triangles.extend(quad.map(|corners| (corners, "outside")));
        }
    }
    Body::new(triangles)
}
