//! Bodies whose coverage can be written down, and some that only look simple. Millimetres, outward winding.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use vantage::geometry::Mesh;

fn mesh(vertices_mm: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

/// A sphere about the origin: an octahedron whose triangles are split in four `splits` times.
pub(crate) fn sphere(radius_mm: f64, splits: usize) -> Mesh {
    let mut directions = vec![Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
    let mut faces: Vec<[u32; 3]> = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..splits {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                directions.push((directions[a as usize] + directions[b as usize]).normalize());
                directions.len() as u32 - 1
            })
        };
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    mesh(directions.into_iter().map(|d| Point3::from(d * radius_mm)).collect(), faces)
}

/// A prism along y over a profile in the x–z plane, counter-clockwise seen from −y; the profile is a fan about its
/// first corner.
pub(crate) fn prism(profile_xz: &[[f64; 2]], half_length_mm: f64) -> Mesh {
    let n = profile_xz.len() as u32;
    let end = |y: f64| profile_xz.iter().map(move |[x, z]| Point3::new(*x, y, *z));
    let vertices = end(-half_length_mm).chain(end(half_length_mm)).collect();
    let sides = (0..n).flat_map(|i| {
        let j = (i + 1) % n;
        [[i, i + n, j], [j, i + n, j + n]]
    });
    let lids = (1..n - 1).flat_map(|i| [[0, i, i + 1], [n, n + i + 1, n + i]]);
    mesh(vertices, sides.chain(lids).collect())
}

/// A floor of `width_mm` at z = 0 for x > 0 beside a block for x < 0 that rises to `height_mm`.
pub(crate) fn step(width_mm: f64, height_mm: f64, half_length_mm: f64) -> Mesh {
    // The fan starts at the inner corner, from which the whole profile is seen.
    let profile = [[0.0, 0.0], [0.0, height_mm], [-20.0, height_mm], [-20.0, -10.0], [width_mm, -10.0], [width_mm, 0.0]];
    prism(&profile, half_length_mm)
}
