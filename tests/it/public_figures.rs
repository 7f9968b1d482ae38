//! Views and coverable area on public meshes beside independent figures for the same sensor: the nominal rig, parts
//! scaled to 120 mm, ellipsoid 30/45 at `centre`, plain area greedy, 98.5 % of the coverable area, no cell. The
//! figures were made with 60 000 samples and two seeds by another program (Embree rays, numpy).

use vantage::planning::params::{CandidateParams, Objective, PlanParams, Solver, Standoff};

use crate::support::{nominal_scanner, plan_viewpoints, shared_mesh_scaled};

/// Mesh, limits of cameras and projector, fewest and most views found elsewhere, coverable share found elsewhere.
const FIGURES: [(&str, f64, f64, usize, usize, f64); 8] = [
    ("meshes/bunny_69k_binary.stl", 85.0, 77.5, 5, 6, 1.0),
    ("meshes/rocker-arm_20k.obj", 85.0, 77.5, 5, 5, 1.0),
    ("meshes/cogwheel_536_ascii.stl", 85.0, 77.5, 8, 8, 1.0),
    ("meshes/fandisk_13k.obj", 85.0, 77.5, 4, 4, 1.0),
    ("meshes/bunny_69k_binary.stl", 60.0, 55.0, 12, 12, 1.0),
    ("meshes/rocker-arm_20k.obj", 60.0, 55.0, 14, 14, 0.968),
    ("meshes/cogwheel_536_ascii.stl", 60.0, 55.0, 18, 18, 0.990),
    ("meshes/fandisk_13k.obj", 60.0, 55.0, 7, 8, 1.0),
];

#[test]
#[ignore = "long: tests/all runs it"]
fn views_and_coverable_area_stand_beside_independent_figures() {
    let scanner = nominal_scanner();
    println!("{:34} limits     views (there)  coverable % (there)", "mesh");
    for (path, camera_deg, projector_deg, fewest, most, coverable) in FIGURES {
        let Some(mesh) = shared_mesh_scaled(path, 120.0) else { return };
        let mut params = PlanParams::default();
        params.limits.camera_deg = Some(camera_deg);
        params.limits.projector_deg = Some(projector_deg);
        params.candidates = CandidateParams { standoff: Standoff::Centre, ..CandidateParams::ellipsoid() };
        params.selection.objective = Objective::Coverage;
        params.selection.solver = Solver::Greedy;
        let plan = plan_viewpoints(&mesh, &scanner, &params).plan;
        let (views, share) = (plan.views.len(), plan.coverage.coverable_area_mm2 / plan.coverage.asked_area_mm2);
        println!(
            "{path:34} {camera_deg}/{projector_deg:<5} {views:>5} ({fewest}–{most})  {:>10.2} ({:.1})",
            100.0 * share,
            100.0 * coverable
        );
        assert!((fewest - 1..=most + 1).contains(&views), "{path}: {views} views, elsewhere {fewest} to {most}");
        assert!((share - coverable).abs() <= 0.005, "{path}: {share} coverable, elsewhere {coverable}");
        assert!(plan.coverage.of_coverable() >= 0.985);
    }
}
