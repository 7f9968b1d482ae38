//! What several topics share: where data lies, how parts are prepared, how a plan is made.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use vantage::cell::{Scanner, ScannerSpec};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::plan::Outcome;
use vantage::planning::{PlanInput, plan};

/// A file of the shared data, or `None` with a printed reason.
pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")).join(path);
    if file.exists() {
        return Some(file);
    }
    println!("skipped: {path} of the shared data is not on this machine");
    None
}

/// The nominal rig of method §2.
pub(crate) fn nominal_scanner() -> Scanner {
    let text = include_str!("../../../config/scanners/transcan-c-nominal.toml");
    toml::from_str::<ScannerSpec>(text).expect("the preset parses").build().expect("the preset is valid")
}

/// A mesh of the shared data, its file axes kept, scaled about its box's centre to `extent_mm` along the longest axis.
pub(crate) fn shared_mesh_scaled(path: &str, extent_mm: f64) -> Option<Mesh> {
    let bytes = std::fs::read(shared(path)?).expect("readable");
    let mut mesh = mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh").mesh;
    let (centre, scale) = (mesh.aabb().centre(), extent_mm / mesh.aabb().extent_mm().max());
    mesh.vertices_mm.iter_mut().for_each(|p| *p = nalgebra::Point3::from((*p - centre) * scale));
    Some(mesh)
}

/// Plans the viewpoints alone.
pub(crate) fn plan_viewpoints(mesh: &Mesh, scanner: &Scanner, params: &PlanParams) -> Outcome {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner, cell: None };
    plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan")
}
