//! Cost of the stages before planning: a file is read, welded and assessed, and its trees are grown. `cargo bench --bench reading
//! -- FILE...` prints a row for each stage of each file: CPU and wall seconds, medians of `ROUNDS` rounds, on all cores; and what
//! a pass over the memory that the stage leaves takes, as the least that it could.

use std::fs;
use std::hint::black_box;
use std::process::ExitCode;

use nalgebra::Isometry3;
use vantage::cell::{Cell, CollisionScene, Presets, SpecLibrary};
use vantage::geometry::mesh_io::{Limits, read};
use vantage::geometry::{LengthUnit, Mesh, Poll, Pose, RayScene, outward_faces};

use crate::measure::{Cost, cost};

#[allow(dead_code, reason = "shared with the benchmarks of peers")]
mod measure;

/// Rounds of each stage.
const ROUNDS: usize = 5;

fn main() -> ExitCode {
    // Cargo adds options of its own.
    let files: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a sound preset");
    for file in &files {
        let bytes = match fs::read(file) {
            Ok(bytes) => bytes,
            Err(error) => {
                eprintln!("{file}: {error}");
                return ExitCode::FAILURE;
            }
        };
        measure_file(file, &bytes, &cell);
    }
    ExitCode::SUCCESS
}

fn measure_file(file: &str, bytes: &[u8], cell: &Cell) {
    let parse = || read(bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a sound file").mesh;
    let mesh = parse();
    println!("{file}, {} triangles", mesh.faces.len());
    row("pass over the file", || pass(bytes));
    row("pass over the mesh", || pass_over(&mesh));
    row("read, weld, assess", parse);
    row("outward faces", || outward_faces(&mesh, &Poll::never()).expect("not interrupted"));
    row("ray tree", || RayScene::new([&mesh]));
    row("collision scene, cell alone", || CollisionScene::without_part(cell, 5.0));
    row("collision scene with the part", || CollisionScene::new(cell, &mesh, None, &Pose::claim(Isometry3::identity()), 5.0));
}

/// Prints the median cost of a stage.
fn row<T>(stage: &str, work: impl Fn() -> T) {
    let mut costs: Vec<Cost> = (0..ROUNDS).map(|_| cost(&work).1).collect();
    costs.sort_by(|a, b| a.cpu_s.total_cmp(&b.cpu_s));
    let Cost { cpu_s, .. } = costs[ROUNDS / 2];
    costs.sort_by(|a, b| a.wall_s.total_cmp(&b.wall_s));
    println!("  {stage:32} {cpu_s:8.4} s CPU {:8.4} s wall", costs[ROUNDS / 2].wall_s);
}

fn pass(bytes: &[u8]) {
    let words = bytes.as_chunks::<8>().0;
    black_box(words.iter().fold(0_u64, |sum, word| sum.wrapping_add(u64::from_le_bytes(*word))));
}

fn pass_over(mesh: &Mesh) {
    black_box(mesh.vertices_mm.iter().fold(0_u64, |sum, v| sum.wrapping_add(v.x.to_bits() ^ v.y.to_bits() ^ v.z.to_bits())));
    black_box(mesh.faces.iter().chain([&[0; 3]]).fold(0_u32, |sum, [a, b, c]| sum.wrapping_add(a ^ b ^ c)));
    black_box(mesh.source_face.iter().fold(0_u32, |sum, face| sum.wrapping_add(*face)));
}
