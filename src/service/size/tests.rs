//! Sizes of jobs whose files cannot be read.

#![cfg(target_os = "linux")]

use std::cell::Cell;
use std::path::Path;

use super::*;
use crate::cell::{BodySpec, CellSpec, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use crate::service::tests::{BAD_SECTOR, TRIANGLE, job_input};

/// The preset cell with a post that is a mesh.
fn cell_with_mesh() -> CellSpec {
    let mut cell = Presets.cell("e05-transcan").expect("a preset");
    cell.inline_devices(&Presets);
    let far = PoseSpec { translation_mm: [3000.0, 0.0, 0.0], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] };
    let shape = ShapeSpec::Mesh { mesh: "post".into() };
    cell.obstacles.push(BodySpec { name: "post".into(), shape, owner_from_body: far });
    cell
}

#[test]
fn a_mesh_that_cannot_be_read_at_the_moment_is_not_waited_for() {
    /// Far beyond what reading and building ask without waiting.
    const MAX_ASKED: u32 = 200;
    let folder = tempfile::tempdir().expect("a folder");
    let readable = folder.path().join("part.stl");
    std::fs::write(&readable, TRIANGLE).expect("a file");
    let bad = Path::new(BAD_SECTOR);
    for (part, cell) in [(bad, None), (&readable, Some(cell_with_mesh()))] {
        let asked = Cell::new(0);
        let stop = || {
            asked.set(asked.get() + 1);
            asked.get() > MAX_ASKED
        };
        assert_eq!(size_of(&job_input(part, cell, bad), &KeptCells::default(), 1, &stop), JobSize::UNKNOWN);
        assert!(asked.get() <= MAX_ASKED, "it waits until the service stops");
    }
}

#[test]
fn a_damaged_mesh_of_a_body_is_no_error_of_the_cell() {
    let folder = tempfile::tempdir().expect("a folder");
    let [part, damaged] = ["part.stl", "post.stl"].map(|name| folder.path().join(name));
    std::fs::write(&part, TRIANGLE).expect("a file");
    std::fs::write(&damaged, "other bytes").expect("a file");
    let input = job_input(&part, Some(cell_with_mesh()), &damaged);
    let read = |source: &MeshSource, pointer: &str| source.read(pointer, 1000, &|| false);
    let Err(JobError::Damaged(said)) = opened_with(&read, &input, &KeptCells::default()) else { panic!("another end") };
    assert!(said.contains(&input.mesh.sha256), "{said}");
}
