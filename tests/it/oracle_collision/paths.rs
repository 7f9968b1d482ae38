//! Every emitted way, at 0.25° or 1° of any axis: what a program moves along touches nothing.

use std::sync::atomic::AtomicBool;

use vantage::cell::urdf::Imported;
use vantage::cell::{BodySpec, Cell, CellSpec, Configuration, Named, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use vantage::geometry::{Mesh, Pose};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams, Strategy};
use vantage::planning::plan::Plan;
use vantage::planning::{PlanInput, plan};
use vantage::program::{Program, Step, compile};

use super::states::OUT_MM;
use super::{ELFIN5, Nearest, Vendor, Verdict, asked, described};
use crate::arms::{imported, link_surfaces};
use crate::support::{PARTS, all_asked, long_asked, oracle_python, shared, shared_mesh_scaled};

/// Samples of a way, degrees of any axis.
const FINE_DEG: &str = "0.25";
/// Samples of a way where fewer will do: of the second part of `tests/all`, and of a plain run.
const COARSE_DEG: [&str; 2] = ["1", "2"];
/// Distance up to which the distance of two bodies counts, mm.
const NEAR_MM: &str = "20";
/// Samples on a part.
const SAMPLES: f64 = 3000.0;

pub(super) fn body(name: &str, at_mm: [f64; 3], shape: ShapeSpec) -> BodySpec {
    let at = Pose::<(), ()>::claim(nalgebra::Isometry3::translation(at_mm[0], at_mm[1], at_mm[2]));
    BodySpec { name: name.into(), owner_from_body: PoseSpec::from(&at), shape }
}

pub(super) fn default_spec() -> CellSpec {
    Presets.cell("e05-transcan").expect("a preset")
}

fn with_ur5e() -> CellSpec {
    let at = Pose::<(), ()>::claim(nalgebra::Isometry3::translation(-450.0, 0.0, -200.0));
    CellSpec {
        robot: Named::Name("ur5e".into()),
        base_from_table: PoseSpec::from(&at),
        home_deg: [0.0, -100.0, 90.0, -80.0, -90.0, 0.0, 0.0],
        ..default_spec()
    }
}

fn with_obstacles() -> CellSpec {
    let mut spec = default_spec();
    spec.obstacles.extend([
        body("cabinet", [400.0, 480.0, -100.0], ShapeSpec::Box { size_mm: [600.0, 80.0, 560.0] }),
        body("post", [480.0, -420.0, 100.0], ShapeSpec::Cylinder { radius_mm: 40.0, height_mm: 960.0 }),
        body("shelf", [960.0, 0.0, 350.0], ShapeSpec::Box { size_mm: [60.0, 700.0, 300.0] }),
    ]);
    spec
}

fn cells() -> Vec<(&'static str, Cell, Vendor)> {
    let ur5e = Vendor { urdf: "ur5e", base: "base", tip: "tool0" };
    let specs = [("default", default_spec(), ELFIN5), ("ur5e", with_ur5e(), ur5e), ("obstacles", with_obstacles(), ELFIN5)];
    let built = specs.into_iter().map(|(name, spec, vendor)| (name, spec.build(&Presets).expect("a valid cell"), vendor));
    let from_urdf = Vendor { base: "world", ..ELFIN5 };
    built.chain(imported("elfin5").map(|urdf| ("surfaces", with_surfaces(&urdf), from_urdf))).collect()
}

/// The arm of the default cell among obstacles, from its URDF, its surfaces deciding.
fn with_surfaces(urdf: &Imported) -> Cell {
    let mut spec = with_obstacles();
    spec.robot = Named::Inline(Box::new(urdf.robot.clone()));
    let mut cell = spec.build(&Presets).expect("a valid cell");
    cell.link_surfaces = link_surfaces(urdf);
    cell
}

/// Name, mesh and longest extent in mm: the parts of the tables and, in the longest run, every other public mesh that is read.
fn parts() -> Vec<(String, String, f64)> {
    let mut parts = PARTS.map(|(name, path, extent_mm)| (name.to_owned(), path.to_owned(), extent_mm)).to_vec();
    if let (true, Some(folder)) = (long_asked(), shared("meshes")) {
        let files = std::fs::read_dir(folder).expect("a folder").map(|file| file.expect("a file").file_name());
        let mut names: Vec<String> = files.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names.retain(|name| [".stl", ".obj", ".ply", ".gz"].iter().any(|end| name.ends_with(end)));
        names.retain(|name| PARTS.iter().all(|(_, path, _)| !path.ends_with(name)));
        parts.extend(names.into_iter().map(|name| (name.clone(), format!("meshes/{name}"), 120.0)));
    }
    parts
}

fn planned(mesh: &Mesh, cell: &Cell) -> Plan {
    let mut params = PlanParams::default();
    params.candidates = CandidateParams { strategies: vec![Strategy::Even], even_directions: Some(40), ..params.candidates };
    params.part.samples_per_mm2 = Some(SAMPLES / mesh.area_mm2());
    params.missed.remedies = 0;
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None };
    plan(&input, &params, &Context::new(&cancel, &Silent)).expect("a plan").plan
}

/// The way of each move of a program, both ends included.
pub(super) fn ways(program: &Program) -> Vec<Vec<Configuration>> {
    let mut at = program.home_rad;
    let mut way_of = |step: &Step| {
        let Step::Move(step) = step else { return None };
        let way = [&[at][..], &step.via_rad, &[step.target_rad]].concat();
        at = step.target_rad;
        Some(way)
    };
    program.steps.iter().filter_map(&mut way_of).collect()
}

pub(super) fn lines(ways: &[Vec<Configuration>]) -> String {
    let line = |way: &Vec<Configuration>| format!("{:?}\n", way.iter().map(Configuration::axes_rad).collect::<Vec<_>>());
    ways.iter().map(line).collect()
}

#[test]
fn nothing_touches_on_any_emitted_way() {
    let Some(python) = oracle_python() else { return };
    let is_asked = |part: &str, cell: &str| {
        (long_asked() && (cell != "surfaces" || PARTS.iter().any(|(of_tables, ..)| *of_tables == part)))
            || (all_asked() && ["rocker", "gearbox"].contains(&part))
            || [("rocker", "ur5e"), ("fandisk", "obstacles")].contains(&(part, cell))
    };
    let step_deg = |part: &str| {
        let is_fine = long_asked() || all_asked() && part == "rocker";
        if is_fine { FINE_DEG } else { COARSE_DEG[usize::from(!all_asked())] }
    };
    let (mut moves, mut samples, mut nearest_mm) = (0, 0, f64::INFINITY);
    let cells = cells();
    for (part, path, extent_mm) in parts() {
        for (name, cell, vendor) in cells.iter().filter(|(name, ..)| is_asked(&part, name)) {
            let Some(mesh) = shared_mesh_scaled(&path, extent_mm) else { return };
            let plan = planned(&mesh, cell);
            let table_from_part = &plan.setups[0].table_from_part;
            let Some(description) = described(cell, vendor, Some((&mesh, table_from_part)), false) else { return };
            let program = compile(plan.setups[0].sequence.as_ref().expect("with a cell"), 0, cell, "", &plan.params);
            let ways = ways(&program);
            let verdicts = asked(&python, [step_deg(&part), NEAR_MM], description + &lines(&ways));
            assert_eq!(verdicts.len(), ways.len());
            for verdict in &verdicts {
                let touch = verdict.contacts.first();
                assert!(touch.is_none(), "{part}, {name}: {touch:?}");
            }
            let clearance_mm = plan.params.motion.clearance_mm;
            let looked_at: usize = verdicts.iter().map(|verdict| verdict.samples).sum();
            let least = |of: fn(&Verdict) -> Option<&Nearest>| verdicts.iter().filter_map(of).min_by(|a, b| a.0.total_cmp(&b.0));
            println!(
                "{part}, {name}: {} views, {} moves, {looked_at} samples {}° apart, no contact; nearest of the arm's own {:?}, of others {:?}; \
                 clearance asked {clearance_mm} mm",
                plan.views.len(),
                ways.len(),
                step_deg(&part),
                least(|verdict| verdict.own.as_ref()),
                least(|verdict| verdict.others.as_ref()),
            );
            let apart_mm = least(Verdict::nearest).map_or(f64::INFINITY, |(mm, _)| *mm);
            assert!(apart_mm >= clearance_mm - OUT_MM, "{part}, {name}: {apart_mm} mm");
            (moves, samples) = (moves + ways.len(), samples + looked_at);
            nearest_mm = apart_mm.min(nearest_mm);
        }
    }
    println!("in all {moves} moves, {samples} samples, no contact; nearest {nearest_mm:.2} mm");
    assert!(moves > 0);
}
