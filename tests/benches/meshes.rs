//! The parts that every benchmark runs on: generated ones of any size, and the public bunny where the data set lies
//! beside the repository. Millimetres, centred on the origin, coordinates rounded to f32 so that engines of either
//! precision see the same surface.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::{Point3, Vector3};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh};

/// Longest edge of the bounding box of every part.
const EXTENT_MM: f64 = 120.0;
/// Height and period of the relief that makes subdivided triangles differ.
const RELIEF_MM: f64 = 0.15;
const RELIEF_PERIOD_MM: f64 = 3.0;

/// Fineness of a part, which decides what is demanded on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Size {
    /// About 70 000 triangles.
    Coarse,
    /// About 1.1 million.
    Dense,
    /// About 100 000, for figures that are demanded there.
    Middle,
}

impl Size {
    /// Name in the table of demands.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::Coarse => "70 k",
            Self::Middle => "100 k",
            Self::Dense => "1.1 M",
        }
    }
}

/// A part with its name.
pub(crate) struct Part {
    /// Name and number of triangles.
    pub(crate) title: String,
    /// The figures that it counts for, if any.
    pub(crate) size: Option<Size>,
    /// The surface.
    pub(crate) mesh: Mesh,
}

/// A part that is yet to be made.
pub(crate) struct Recipe {
    size: Option<Size>,
    bunny_splits: Option<usize>,
    triangles: usize,
}

/// All parts that engines are compared on.
pub(crate) fn parts() -> Vec<Recipe> {
    let bunny = |size, splits, triangles| Recipe { size, bunny_splits: Some(splits), triangles };
    vec![
        bunny(Some(Size::Coarse), 0, 70_000),
        bunny(Some(Size::Dense), 2, 1_110_000),
        bunny(None, 3, 4_440_000),
        Recipe { size: Some(Size::Middle), bunny_splits: None, triangles: 100_000 },
    ]
}

/// One that is made and cast in a moment.
pub(crate) fn small() -> Recipe {
    Recipe { size: None, bunny_splits: None, triangles: 20_000 }
}

impl Recipe {
    /// Makes it. A generated part stands in where the bunny is absent.
    pub(crate) fn make(&self) -> Part {
        let (name, mesh) = match self.bunny_splits.map(bunny) {
            Some(Ok(mesh)) => ("bunny", mesh),
            Some(Err(reason)) => {
                println!("\nNo bunny ({reason}): a lobed sphere stands in.");
                ("lobed sphere", lobed(self.triangles))
            }
            None => ("lobed sphere", lobed(self.triangles)),
        };
        Part { title: format!("{name}, {} triangles", mesh.faces.len()), size: self.size, mesh }
    }
}

/// The public bunny, its triangles split in four `splits` times and then given the relief; or why it is absent.
fn bunny(splits: usize) -> Result<Mesh, String> {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/meshes/bunny_69k_ascii.ply"));
    let bytes = std::fs::read(file).map_err(|_| "the folder ../shared/data is absent".to_owned())?;
    let mut mesh = mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh").mesh;
    centre_and_scale(&mut mesh);
    for _ in 0..splits {
        mesh = split_in_four(&mesh);
    }
    if splits > 0 {
        add_relief(&mut mesh);
    }
    round_to_f32(&mut mesh);
    Ok(mesh)
}

/// A sphere with lobes that hide each other, with the relief: a closed surface of the multiple of 8 triangles that is
/// nearest `triangles` among 8n².
pub(crate) fn lobed(triangles: usize) -> Mesh {
    let n = (triangles as f64 / 8.0).sqrt().round() as i32;
    let mut mesh = octahedron(n);
    for p in &mut mesh.vertices_mm {
        let d = p.coords.normalize();
        // Re (x + iy)³ and a pinch along z, both smooth at the poles.
        let lobes = d.x * (d.x * d.x - 3.0 * d.y * d.y) + 0.6 * (3.0 * d.z * d.z - 1.0);
        *p = Point3::from(d * (1.0 + 0.35 * lobes));
    }
    centre_and_scale(&mut mesh);
    add_relief(&mut mesh);
    round_to_f32(&mut mesh);
    mesh
}

/// The octahedron |x| + |y| + |z| = `n`, each face cut into n² triangles: rings of 4r vertices at every integer z.
fn octahedron(n: i32) -> Mesh {
    let mut vertices = Vec::new();
    let mut first_of_ring = Vec::new();
    for z in -n..=n {
        first_of_ring.push(vertices.len() as u32);
        let r = n - z.abs();
        let corners = [(r, 0), (0, r), (-r, 0), (0, -r), (r, 0)];
        let steps = corners.windows(2).flat_map(|pair| {
            let ((x, y), (to_x, to_y)) = (pair[0], pair[1]);
            (0..r).map(move |s| (x + (to_x - x).signum() * s, y + (to_y - y).signum() * s))
        });
        vertices
            .extend(steps.chain((r == 0).then_some((0, 0))).map(|(x, y)| Point3::new(f64::from(x), f64::from(y), f64::from(z))));
    }
    let mut faces = Vec::new();
    for z in -n..n {
        // The ring nearer the equator has one vertex more a quadrant than the other.
        let (outer, inner, up) = if z < 0 { (z + 1, z, false) } else { (z, z + 1, true) };
        let on = |ring: i32, quadrant: i32, s: i32| {
            let r = n - ring.abs();
            first_of_ring[(ring + n) as usize] + if r == 0 { 0 } else { ((quadrant * r + s) % (4 * r)) as u32 }
        };
        let mut push = |[a, b, c]: [u32; 3]| faces.push(if up { [a, b, c] } else { [a, c, b] });
        for quadrant in 0..4 {
            for s in 0..n - outer.abs() {
                push([on(outer, quadrant, s), on(outer, quadrant, s + 1), on(inner, quadrant, s)]);
            }
            for s in 0..n - inner.abs() {
                push([on(outer, quadrant, s + 1), on(inner, quadrant, s + 1), on(inner, quadrant, s)]);
            }
        }
    }
    indexed(vertices, faces)
}

/// `mesh` as every part is: centred, of [`EXTENT_MM`], in whole f32.
pub(crate) fn centred_and_scaled(mut mesh: Mesh) -> Mesh {
    centre_and_scale(&mut mesh);
    round_to_f32(&mut mesh);
    mesh
}

fn indexed(vertices_mm: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}

fn split_in_four(mesh: &Mesh) -> Mesh {
    let mut vertices = mesh.vertices_mm.clone();
    let mut middles = HashMap::with_capacity(mesh.faces.len() * 3 / 2);
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            vertices.push(nalgebra::center(&vertices[a as usize], &vertices[b as usize]));
            vertices.len() as u32 - 1
        })
    };
    let faces = mesh
        .faces
        .iter()
        .flat_map(|&[a, b, c]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        })
        .collect();
    indexed(vertices, faces)
}

fn centre_and_scale(mesh: &mut Mesh) {
    let (centre, scale) = (mesh.aabb().centre(), EXTENT_MM / mesh.aabb().extent_mm().max());
    mesh.vertices_mm.iter_mut().for_each(|p| *p = Point3::from((*p - centre) * scale));
}

/// Moves every vertex along its normal by a wave in space.
fn add_relief(mesh: &mut Mesh) {
    let mut normals = vec![Vector3::zeros(); mesh.vertices_mm.len()];
    for (face, corners) in mesh.faces.iter().enumerate() {
        let normal = mesh.scaled_normal(face);
        corners.iter().for_each(|v| normals[*v as usize] += normal);
    }
    for (p, normal) in mesh.vertices_mm.iter_mut().zip(normals) {
        let wave: f64 = p.iter().map(|x| (x * TAU / RELIEF_PERIOD_MM).sin()).product();
        *p += normal.try_normalize(0.0).unwrap_or_default() * (RELIEF_MM * wave);
    }
}

fn round_to_f32(mesh: &mut Mesh) {
    mesh.vertices_mm.iter_mut().for_each(|p| *p = p.map(|x| f64::from(x as f32)));
}
