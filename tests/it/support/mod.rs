//! Helpers that several topics share: where data lies, how parts are prepared, how a plan is made.

mod child;
pub(crate) mod glb;
mod needs;
pub(crate) mod selection_table;
pub(crate) mod shapes;

use std::io::Read as _;
use std::sync::atomic::AtomicBool;

use nalgebra::Point3;
use vantage::cell::{Presets, Scanner, SpecLibrary};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::plan::Outcome;
use vantage::planning::{PlanInput, plan};

pub(crate) use child::lines_of;
pub(crate) use needs::{
    all_asked, chromium, dashboard_node, dashboard_packages, failpoints, long_asked, oracle_hans, oracle_node, oracle_python,
    program, shared,
};

/// The public parts of the tables of views and coverage: name, mesh, longest extent in mm.
pub(crate) const PARTS: [(&str, &str, f64); 9] = [
    ("bunny", "meshes/bunny_69k_binary.stl", 120.0),
    ("rocker", "meshes/rocker-arm_20k.obj", 120.0),
    ("cogwheel", "meshes/cogwheel_536_ascii.stl", 120.0),
    ("fandisk", "meshes/fandisk_13k.obj", 120.0),
    ("armadillo", "meshes/armadillo_52k_binary.stl", 120.0),
    ("gearbox", "meshes/gearbox_output_housing_16k.stl", 120.0),
    ("piboy", "meshes/piboy_rear_case_15k_binary.stl", 120.0),
    ("turbine", "meshes/turbineblade_199k_binary.ply", 120.0),
    ("featuretype", "meshes/featuretype_3476_inch.stl", 127.0),
];

/// The nominal rig of `vantage::planning::method::scanner`.
pub(crate) fn nominal_scanner() -> Scanner {
    preset_scanner("transcan-c-nominal")
}

/// A scanner that ships with the program.
pub(crate) fn preset_scanner(name: &str) -> Scanner {
    Presets.scanner(name).expect("a preset").build().expect("the preset is valid")
}

/// `scanner` with these own limits of incidence of left camera, right camera and projector, degrees.
pub(crate) fn limited_to(mut scanner: Scanner, [left, right, projector]: [f64; 3]) -> Scanner {
    scanner.devices.left.incidence_max_rad = left.to_radians();
    scanner.devices.right.incidence_max_rad = right.to_radians();
    scanner.devices.projector.incidence_max_rad = projector.to_radians();
    scanner
}

/// A mesh of the shared data, its file axes kept, scaled about its box's centre to `extent_mm` along the longest axis.
pub(crate) fn shared_mesh_scaled(path: &str, extent_mm: f64) -> Option<Mesh> {
    let mut bytes = std::fs::read(shared(path)?).expect("readable");
    if path.ends_with(".gz") {
        let packed = std::mem::take(&mut bytes);
        flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut bytes).expect("gzip");
    }
    let mut mesh = mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh").mesh;
    let (centre, scale) = (mesh.aabb().centre(), extent_mm / mesh.aabb().extent_mm().max());
    mesh.vertices_mm.iter_mut().for_each(|p| *p = Point3::from((*p - centre) * scale));
    Some(mesh)
}

/// Plans the viewpoints alone.
pub(crate) fn plan_viewpoints(mesh: &Mesh, scanner: &Scanner, params: &PlanParams) -> Outcome {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner, cell: None, roadmaps: None };
    plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan")
}

/// Runs a stage that asks for a context: nothing cancels it, and nobody observes.
pub(crate) fn context<T>(stage: impl FnOnce(&Context<'_>) -> T) -> T {
    let cancel = AtomicBool::new(false);
    stage(&Context::new(&cancel, &Silent))
}

/// A closed box of twelve triangles between two corners.
pub(crate) fn box_mesh(min_mm: [f64; 3], max_mm: [f64; 3]) -> Mesh {
    let corner = |i: usize| Point3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { max_mm[axis] } else { min_mm[axis] }));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { vertices_mm: (0..8).map(corner).collect(), source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
}
