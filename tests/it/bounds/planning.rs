//! Plans that would take too much are refused before they begin, and what is estimated is what plans then take.

use std::time::Duration;

use vantage::cell::{Presets, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::geometry::demo_parts::DemoPart;
use vantage::geometry::mesh_io::write_stl;
use vantage::planning::params::PlanParams;
use vantage::planning::{Estimate, PlanInput};

use super::measured::{Measured, run};
use crate::server::process::vantage;
use crate::support::{box_mesh, long_asked, nominal_scanner, shared_mesh_scaled};

const LIMIT: Duration = Duration::from_secs(1200);

fn plan(mesh: &Mesh, options: &[&str]) -> Measured {
    let folder = tempfile::tempdir().expect("a folder");
    let (part, out) = (folder.path().join("part.stl"), folder.path().join("out"));
    std::fs::write(&part, write_stl(mesh)).expect("a file");
    let mut command = vantage();
    command.arg("plan").arg(part).args(["--unit", "mm", "--out"]).arg(out).args(options);
    run(&mut command, LIMIT)
}

const WITHOUT_CELL: [&str; 4] = ["--cell", "none", "--scanner", "transcan-c-nominal"];

#[track_caller]
fn refused_at_once(mesh: &Mesh, options: &[&str], words: &[&str]) {
    let measured = plan(mesh, &[&WITHOUT_CELL, options].concat());
    assert_eq!(measured.code, Some(2), "{}", measured.said);
    assert!(words.iter().all(|word| measured.said.contains(word)), "{words:?} in {}", measured.said);
    assert!(measured.wall < Duration::from_secs(10), "{:?}", measured.wall);
    assert!(measured.peak_bytes < 100 << 20, "{} bytes", measured.peak_bytes);
}

#[test]
fn a_part_of_a_hundred_metres_is_asked_for_its_unit() {
    for size in [[100_000.0, 1.0, 1.0], [100_000.0, 100_000.0, 1.0], [1e8, 1e8, 1e8]] {
        refused_at_once(&box_mesh([0.0; 3], size), &[], &["/part", "right unit?"]);
    }
    refused_at_once(&box_mesh([0.0; 3], [3000.0; 3]), &[], &["candidates", "allowed are 50000"]);
}

#[test]
fn what_would_need_too_much_memory_or_time_names_the_parameter() {
    let cube = box_mesh([0.0; 3], [100.0; 3]);
    let dense = ["--set", "part.samples_per_mm2=300", "--max-memory", "1024"];
    refused_at_once(&cube, &dense, &["--set part.samples_per_mm2=300: ", "GiB of memory", "allowed are 1.0 GiB", "--max-memory"]);
    let fine = ["--set", "part.patch_edge_mm=0.25", "--max-memory", "1024"];
    refused_at_once(&cube, &fine, &["--set part.patch_edge_mm=0.25: ", "longer edge"]);
    let many =
        ["--set", "candidates.even_directions=4000", "--set", "part.samples_per_mm2=1", "--max-secs", "1", "--threads", "1"];
    refused_at_once(&cube, &many, &["/candidates", "s of one core", "allowed are 1 s", "--max-secs"]);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_speck_and_a_splinter_plan_in_bounded_time() {
    for size in [[0.1, 0.1, 0.1], [100.0, 0.01, 0.01]] {
        let measured = plan(&box_mesh([0.0; 3], size), &WITHOUT_CELL);
        assert!(matches!(measured.code, Some(0 | 3)), "{}", measured.said);
        assert!(measured.wall < Duration::from_secs(60), "{:?}", measured.wall);
    }
}

/// Makes a part, which takes seconds for the large ones, or reads it, where its file is there.
type Make = Box<dyn Fn() -> Option<Mesh>>;

/// Parts, and parameters other than the usual ones.
fn parts() -> Vec<(&'static str, Make, Vec<&'static str>)> {
    let demo = |part: DemoPart, triangles: usize| -> Make { Box::new(move || part.mesh(triangles).ok()) };
    let cube = |edge_mm: f64| -> Make { Box::new(move || Some(box_mesh([0.0; 3], [edge_mm; 3]))) };
    let data = |path: &'static str| -> Make { Box::new(move || shared_mesh_scaled(path, 120.0)) };
    vec![
        ("base 100 000", demo(DemoPart::Base, 100_000), vec![]),
        ("base 400 000", demo(DemoPart::Base, 400_000), vec![]),
        ("base 1 000 000", demo(DemoPart::Base, 1_000_000), vec![]),
        ("figurine 300 000", demo(DemoPart::Figurine, 300_000), vec![]),
        ("figurine 1 000 000", demo(DemoPart::Figurine, 1_000_000), vec![]),
        ("cube 100 mm, dense", cube(100.0), vec!["part.samples_per_mm2=20"]),
        ("cube 100 mm, fine", cube(100.0), vec!["part.patch_edge_mm=0.5"]),
        ("cube 100 mm, many views", cube(100.0), vec!["candidates.even_directions=3000"]),
        ("cube 1 m", cube(1000.0), vec![]),
        ("cube 1 m, local", cube(1000.0), vec!["selection.solver=local", "selection.work_limit=200"]),
        ("cube 2 m", cube(2000.0), vec![]),
        ("sheet 2 m", Box::new(|| Some(box_mesh([0.0; 3], [2000.0, 1000.0, 2.0]))), vec![]),
        ("armadillo", data("meshes/armadillo_52k_binary.stl"), vec![]),
        ("turbine", data("meshes/turbineblade_199k_binary.ply"), vec![]),
    ]
}

fn estimated(mesh: &Mesh, sets: &[&str], threads: usize) -> Estimate {
    let mut value = serde_json::json!({});
    for set in sets {
        let (key, text) = set.split_once('=').expect("KEY=VALUE");
        let (section, name) = key.split_once('.').expect("two parts");
        value[section][name] = serde_json::from_str(text).unwrap_or_else(|_| text.into());
    }
    let params: PlanParams = serde_json::from_value(value).expect("parameters");
    let scanner = nominal_scanner();
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    Estimate::of(&input, &params, threads)
}

/// The estimate of memory is no less than what the process takes, and no more than three times it where that is much.
#[test]
#[ignore = "long: tests/all runs it"]
fn the_estimate_bounds_what_plans_take() {
    if !cfg!(target_os = "linux") {
        return;
    }
    let mut faults = Vec::new();
    let parts = parts();
    // Unoptimised builds take half an hour for all of them.
    let some = if long_asked() { parts.len() } else { 1 };
    for (name, make, sets) in &parts[..some] {
        let Some(mesh) = make() else { continue };
        let options: Vec<&str> = sets.iter().flat_map(|set| ["--set", *set]).chain(["--threads", "2"]).collect();
        let measured = plan(&mesh, &[&WITHOUT_CELL, &options[..]].concat());
        let estimate = estimated(&mesh, sets, 2);
        let ratio = estimate.bytes.sum() / measured.peak_bytes as f64;
        println!(
            "{name:24} {:6} MiB held, {:6.0} MiB estimated, {ratio:4.2}; {:6.1} s, {:6.1} s of one core estimated",
            measured.peak_bytes >> 20,
            estimate.bytes.sum() / 1_048_576.0,
            measured.wall.as_secs_f64(),
            estimate.core_secs.sum()
        );
        let is_much = measured.peak_bytes > 200 << 20;
        if measured.code != Some(0) || ratio < 1.0 || is_much && ratio > 3.0 {
            faults.push(format!("{name}: {ratio} with {measured:?}, {estimate:?}"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// A part takes its collision trees too with the cell.
#[test]
fn the_estimate_counts_what_stands_in_the_cell() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("it is valid");
    let mesh = box_mesh([0.0; 3], [100.0; 3]);
    let of = |cell: Option<&vantage::cell::Cell>| {
        let scanner = nominal_scanner();
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell, roadmaps: None };
        Estimate::of(&input, &PlanParams::default(), 1)
    };
    let (without, with) = (of(None), of(Some(&cell)));
    assert!(with.bytes.triangles > without.bytes.triangles && with.core_secs.sum() > without.core_secs.sum());
    assert_eq!(with.counts, without.counts);
}
