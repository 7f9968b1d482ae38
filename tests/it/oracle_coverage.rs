//! Coverage beside Monte Carlo: `tests/oracles/coverage_oracle.py` reads a mesh file and a `plan.json`, draws 200 000
//! points by area and casts Embree rays. It shares no code with the planner, and the part is read by another library.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use serde::Deserialize;
use vantage::cell::{PoseSpec, Scanner};
use vantage::geometry::Mesh;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams, Standoff};
use vantage::planning::plan::{Independent, Outcome};
use vantage::planning::{PlanInput, tabulate};
use vantage::wire::echo::Echo;
use vantage::wire::plan::PlanDocument;

use crate::support::{nominal_scanner, oracle_python, plan_viewpoints, preset_scanner, shared, shared_mesh_scaled};

/// What is shown of the six parts: largest extent, and how far apart the two may be.
const EXTENT_MM: f64 = 120.0;
const WITHIN: f64 = 0.003;

const PARTS: [&str; 6] = [
    "meshes/bunny_69k_binary.stl",
    "meshes/rocker-arm_20k.obj",
    "meshes/cogwheel_536_ascii.stl",
    "meshes/fandisk_13k.obj",
    "meshes/armadillo_52k_binary.stl",
    "meshes/gearbox_output_housing_16k.stl",
];

/// What the oracle prints.
#[derive(Debug, Deserialize)]
struct Answer {
    area_mm2: f64,
    of_asked: f64,
    coverable_of_asked: f64,
    of_coverable: f64,
    covered_not_coverable: f64,
    visible_of_asked: f64,
    of_visible: f64,
    within_35_deg_of_visible: f64,
    within_60_deg_of_visible: f64,
    seconds: f64,
}

#[test]
fn calibrated_rig_with_its_distortion_covers_what_the_oracle_says() {
    compare(&preset_scanner("transcan-c"), &PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() });
}

#[test]
fn nominal_rig_at_narrow_limits_covers_what_the_oracle_says() {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.limits.camera_deg = Some(60.0);
    params.limits.projector_deg = Some(55.0);
    params.candidates.standoff = Standoff::Centre;
    compare(&nominal_scanner(), &params);
}

fn compare(scanner: &Scanner, params: &PlanParams) {
    let Some(python) = oracle_python() else { return };
    println!("{:40} views  of asked (fresh, oracle)   of coverable (oracle)   oracle s", scanner.name);
    for part in PARTS {
        let (Some(file), Some(mesh)) = (shared(part), shared_mesh_scaled(part, EXTENT_MM)) else { return };
        let outcome = plan_viewpoints(&mesh, scanner, params);
        let oracle = ask(&python, &file, &outcome, &mesh, scanner);
        let coverage = &outcome.plan.coverage;
        println!(
            "{part:40} {:>5}   {:.4} ({:.4}, {:.4})    {:.4} ({:.4})         {:.1}",
            outcome.plan.views.len(),
            coverage.of_asked(),
            coverage.independent.of_asked(),
            oracle.of_asked,
            coverage.of_coverable(),
            oracle.of_coverable,
            oracle.seconds
        );
        let coverable = coverage.coverable_area_mm2 / coverage.asked_area_mm2;
        assert!((coverage.total_area_mm2 / oracle.area_mm2 - 1.0).abs() < 1e-4, "{part}: another surface, {oracle:?}");
        assert!(oracle.covered_not_coverable == 0.0, "{part}: a chosen view is no candidate, {oracle:?}");
        assert!((coverable - oracle.coverable_of_asked).abs() <= WITHIN, "{part}: coverable {coverable}, {oracle:?}");
        assert!((coverage.of_asked() - oracle.of_asked).abs() <= WITHIN, "{part}: {coverage:?}, {oracle:?}");
        let independent = coverage.independent.of_asked();
        assert!((independent - oracle.of_asked).abs() <= WITHIN, "{part}: on other samples {independent}, {oracle:?}");
        let Independent { visible_area_mm2, asked_area_mm2, .. } = coverage.independent;
        let shares = coverage.independent.of_visible();
        for (name, own, oracle) in [
            ("visible", visible_area_mm2 / asked_area_mm2, oracle.visible_of_asked),
            ("of visible", shares.measured, oracle.of_visible),
            ("within 35°", shares.within[0], oracle.within_35_deg_of_visible),
            ("within 60°", shares.within[1], oracle.within_60_deg_of_visible),
        ] {
            println!("{:40} {name:>12} {own:.4} ({oracle:.4})", "");
            assert!((own - oracle).abs() <= WITHIN, "{part}: {name} {own}, {oracle}");
        }
        assert!((coverage.of_coverable() - oracle.of_coverable).abs() <= WITHIN, "{part}: {coverage:?}, {oracle:?}");
    }
}

/// Writes the plan and every candidate's pose, and asks the oracle.
fn ask(python: &Path, mesh_file: &Path, outcome: &Outcome, mesh: &Mesh, scanner: &Scanner) -> Answer {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (plan, candidates) = (folder.path().join("plan.json"), folder.path().join("candidates.json"));
    let document = PlanDocument::new(outcome, scanner, None, Echo::default());
    std::fs::write(&plan, document.to_bytes()).expect("written");
    let poses = serde_json::to_vec(&candidate_poses(outcome, mesh, scanner)).expect("JSON");
    std::fs::write(&candidates, poses).expect("written");
    let output = Command::new(python)
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/oracles/coverage_oracle.py"))
        .args([mesh_file, &plan, Path::new("--candidates"), &candidates])
        .args(["--largest-extent", &EXTENT_MM.to_string()])
        .output()
        .expect("the oracle starts");
    assert!(output.status.success(), "the oracle failed: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("the oracle answers in JSON")
}

/// The poses of every candidate that the plan kept: those that the views were chosen from, and the views that slid since.
fn candidate_poses(outcome: &Outcome, mesh: &Mesh, scanner: &Scanner) -> Vec<PoseSpec> {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner, cell: None, roadmaps: None };
    let table = tabulate(&input, &outcome.plan.params, &Context::new(&cancel, &Silent)).expect("a table");
    let mut poses: Vec<_> = table.candidates.remaining.iter().map(|candidate| candidate.part_from_scanner).collect();
    let slid = outcome.plan.views.iter().map(|view| view.part_from_scanner).filter(|pose| !poses.contains(pose));
    poses.extend(slid.collect::<Vec<_>>());
    assert_eq!(poses.len(), outcome.plan.candidates.kept, "the same candidates as the plan's");
    poses.iter().map(PoseSpec::from).collect()
}
