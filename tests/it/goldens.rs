//! The plans of the demo parts in the default cell, as text: a change of any stage shows as a diff to review.
//! `UPDATE_GOLDEN=1` writes them anew.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use vantage::cell::{Presets, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::geometry::demo_parts::{self, DEFAULT_TRIANGLES, DemoPartError};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::{PlanInput, plan};
use vantage::report::text::text;

fn hold(name: &str, mesh: Result<Mesh, DemoPartError>) {
    let mesh = mesh.expect("a demo part");
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let cancel = AtomicBool::new(false);
    let input =
        PlanInput { mesh: &mesh, fixture: None, part_sha256: name, scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
    let outcome = plan(&input, &PlanParams::default(), &Context::new(&cancel, &Silent)).expect("a plan");
    let found = text(&outcome.plan);
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden")).join(format!("{name}.txt"));
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &found).expect("the golden file");
    }
    let wanted = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(found == wanted, "{name} differs from {}; UPDATE_GOLDEN=1 writes it anew. Found:\n{found}", path.display());
}

#[test]
fn the_base_is_planned_as_before() {
    hold("base", demo_parts::base(DEFAULT_TRIANGLES));
}

#[test]
fn the_figurine_is_planned_as_before() {
    hold("figurine", demo_parts::figurine(DEFAULT_TRIANGLES));
}
