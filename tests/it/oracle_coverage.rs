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

use crate::support::{long_asked, nominal_scanner, oracle_python, plan_viewpoints, preset_scanner, shared, shared_mesh_scaled};

/// A comparison of the six parts.
struct Comparison {
    /// Largest extent of each part.
    extent_mm: f64,
    /// Points of the oracle.
    points: u32,
    /// Samples of the plan; those of the default if none.
    samples: Option<f64>,
    /// Largest difference of a share.
    within: f64,
    /// Is true where the oracle casts every candidate too, for what is coverable.
    with_candidates: bool,
}

const SMALL: Comparison = Comparison { extent_mm: 120.0, points: 200_000, samples: None, within: 0.003, with_candidates: true };

const PARTS: [&str; 6] = [
    "meshes/bunny_69k_binary.stl",
    "meshes/rocker-arm_20k.obj",
    "meshes/cogwheel_536_ascii.stl",
    "meshes/fandisk_13k.obj",
    "meshes/armadillo_52k_binary.stl",
    "meshes/gearbox_output_housing_16k.stl",
];

/// Output of the oracle.
#[derive(Debug, Deserialize)]
struct Answer {
    area_mm2: f64,
    of_asked: f64,
    coverable_of_asked: Option<f64>,
    of_coverable: Option<f64>,
    covered_not_coverable: Option<f64>,
    visible_of_asked: f64,
    of_visible: f64,
    within_35_deg_of_visible: f64,
    within_60_deg_of_visible: f64,
    seconds: f64,
}

#[test]
fn calibrated_rig_with_its_distortion_covers_what_the_oracle_says() {
    let params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    compare(&preset_scanner("transcan-c"), &params, &SMALL);
}

#[test]
fn nominal_rig_at_narrow_limits_covers_what_the_oracle_says() {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.limits.camera_deg = Some(60.0);
    params.limits.projector_deg = Some(55.0);
    params.candidates.standoff = Standoff::Centre;
    compare(&nominal_scanner(), &params, &SMALL);
}

/// Two million points have a standard error of 0.02 points at 90 %; samples, spread evenly over the patches, a smaller one.
#[test]
fn parts_of_several_blocks_cover_what_the_oracle_says() {
    if !long_asked() {
        eprintln!("skipped: six parts at 300 and 500 mm take a quarter of an hour; VANTAGE_TESTS=long runs them");
        return;
    }
    for extent_mm in [300.0, 500.0] {
        let large = Comparison { extent_mm, points: 2_000_000, samples: Some(150_000.0), within: 0.001, with_candidates: false };
        compare(&preset_scanner("transcan-c"), &PlanParams::default(), &large);
    }
}

fn compare(scanner: &Scanner, params: &PlanParams, comparison: &Comparison) {
    let Some(python) = oracle_python() else { return };
    let within = comparison.within;
    println!("{} at {} mm: on samples that no view was chosen on (oracle)", scanner.name, comparison.extent_mm);
    for part in PARTS {
        let (Some(file), Some(mesh)) = (shared(part), shared_mesh_scaled(part, comparison.extent_mm)) else { return };
        let mut params = params.clone();
        params.part.samples_per_mm2 = comparison.samples.map(|samples| samples / mesh.area_mm2());
        let outcome = plan_viewpoints(&mesh, scanner, &params);
        let oracle = ask(&python, &file, &outcome, (&mesh, scanner), comparison);
        let coverage = &outcome.plan.coverage;
        let Independent { visible_area_mm2, asked_area_mm2, .. } = coverage.independent;
        let shares = coverage.independent.of_visible();
        let mut rows = vec![
            ("of asked", coverage.independent.of_asked(), oracle.of_asked),
            ("visible", visible_area_mm2 / asked_area_mm2, oracle.visible_of_asked),
            ("of visible", shares.measured, oracle.of_visible),
            ("within 35°", shares.within[0], oracle.within_35_deg_of_visible),
            ("within 60°", shares.within[1], oracle.within_60_deg_of_visible),
        ];
        if comparison.with_candidates {
            let coverable = coverage.coverable_area_mm2 / coverage.asked_area_mm2;
            rows.push(("as chosen", coverage.of_asked(), oracle.of_asked));
            rows.push(("coverable", coverable, oracle.coverable_of_asked.expect("candidates")));
            rows.push(("of coverable", coverage.of_coverable(), oracle.of_coverable.expect("candidates")));
            assert_eq!(oracle.covered_not_coverable, Some(0.0), "{part}: a chosen view is no candidate, {oracle:?}");
        }
        println!("{part:40} {} views, oracle {:.1} s", outcome.plan.views.len(), oracle.seconds);
        assert!((coverage.total_area_mm2 / oracle.area_mm2 - 1.0).abs() < 1e-4, "{part}: another surface, {oracle:?}");
        for (name, own, oracle) in rows {
            println!("{:40} {name:>12} {own:.4} ({oracle:.4})", "");
            assert!((own - oracle).abs() <= within, "{part}: {name} {own}, {oracle}");
        }
    }
}

/// Writes the plan, and every candidate's pose where they are compared, and asks the oracle.
fn ask(
    python: &Path,
    mesh_file: &Path,
    outcome: &Outcome,
    (mesh, scanner): (&Mesh, &Scanner),
    comparison: &Comparison,
) -> Answer {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (plan, candidates) = (folder.path().join("plan.json"), folder.path().join("candidates.json"));
    let document = PlanDocument::new(outcome, scanner, None, Echo::default());
    std::fs::write(&plan, document.to_bytes()).expect("written");
    let mut oracle = Command::new(python);
    oracle.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/oracles/coverage_oracle.py")).args([mesh_file, &plan]);
    oracle.args(["--largest-extent", &comparison.extent_mm.to_string(), "--points", &comparison.points.to_string()]);
    if comparison.with_candidates {
        let poses = serde_json::to_vec(&candidate_poses(outcome, mesh, scanner)).expect("JSON");
        std::fs::write(&candidates, poses).expect("written");
        oracle.args([Path::new("--candidates"), &candidates]);
    }
    let output = oracle.output().expect("the oracle starts");
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
