//! Sizes of jobs whose files cannot be read.

#![cfg(target_os = "linux")]

use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::Path;

use sha2::{Digest, Sha256};

use super::*;
use crate::cell::{BodySpec, CellSpec, Named, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use crate::geometry::LengthUnit;
use crate::planning::params::PlanParams;
use crate::wire::echo::Echo;
use crate::wire::hex;

/// A file that fails with EIO: nothing lies at the first address of a process.
const BAD_SECTOR: &str = "/proc/self/mem";
const TRIANGLE: &str =
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 9 0 0\nvertex 0 9 0\nendloop\nendfacet\nendsolid a\n";

fn source(path: &Path) -> MeshSource {
    let sha256 = hex(&Sha256::digest(TRIANGLE));
    MeshSource { path: path.to_owned(), sha256, unit: LengthUnit::Millimetre }
}

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
    let cell = cell_with_mesh();
    let Named::Inline(scanner) = cell.scanner.clone() else { panic!("inlined") };
    let body_meshes = BTreeMap::from([("post".to_owned(), source(Path::new(BAD_SECTOR)))]);
    for (part, cell) in [(Path::new(BAD_SECTOR), None), (&readable, Some(cell))] {
        let input = JobInput {
            mesh: source(part),
            part_name: "part".into(),
            fixture: None,
            cell,
            scanner: (*scanner).clone(),
            body_meshes: body_meshes.clone(),
            max_triangles: 1000,
            params: PlanParams::default(),
            echo: Echo::default(),
            rescan: None,
            accepted_at: None,
        };
        let asked = Cell::new(0);
        let stop = || {
            asked.set(asked.get() + 1);
            asked.get() > MAX_ASKED
        };
        assert_eq!(size_of(&input, &KeptCells::default(), 1, &stop), JobSize::UNKNOWN);
        assert!(asked.get() <= MAX_ASKED, "it waits until the service stops");
    }
}
