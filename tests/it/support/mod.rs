//! What several topics share: where data lies, how parts are prepared, how a plan is made.

mod needs;

use std::sync::atomic::AtomicBool;

use vantage::cell::{Presets, Scanner, SpecLibrary};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::plan::Outcome;
use vantage::planning::{PlanInput, plan};

pub(crate) use needs::{oracle_python, shared};

/// The nominal rig of method §2.
pub(crate) fn nominal_scanner() -> Scanner {
    preset_scanner("transcan-c-nominal")
}

/// A scanner that ships with the program.
pub(crate) fn preset_scanner(name: &str) -> Scanner {
    Presets.scanner(name).expect("a preset").build().expect("the preset is valid")
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
