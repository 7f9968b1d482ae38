//! The fewest views on public parts beside independent proofs (branch and bound, cross-checked by brute force, CP-SAT and a
//! MIP) for the same sensor: the nominal rig, parts of 120 mm, the ellipsoid's 54 candidates, 98.5 % of the coverable area,
//! 10 000 samples. Another draw of samples moves an optimum by one at most, on the cogwheel at 60° by two.

use vantage::planning::params::{SelectionParams, Solver};
use vantage::planning::selection::StopReason;

use crate::support::selection_table::SelectionTable;

/// Mesh, limits of cameras and projector, optimum found elsewhere, and how far another draw may be off.
const FIGURES: [(&str, f64, f64, usize, usize); 4] = [
    ("meshes/rocker-arm_20k.obj", 60.0, 55.0, 12, 1),
    ("meshes/cogwheel_536_ascii.stl", 60.0, 55.0, 16, 2),
    ("meshes/fandisk_13k.obj", 60.0, 55.0, 6, 1),
    ("meshes/gearbox_output_housing_16k.stl", 60.0, 55.0, 22, 1),
];

#[test]
fn the_fewest_views_are_proved_and_stand_beside_independent_proofs() {
    println!("{:40} limits     greedy local certified (there)", "mesh");
    for (path, camera_deg, projector_deg, optimum, apart) in FIGURES {
        let Some(table) = SelectionTable::new(path, camera_deg, projector_deg, 10_000) else { return };
        let by = |solver| table.solve(&SelectionParams { solver, ..SelectionParams::default() });
        let (greedy, local, certified) = (by(Solver::Greedy), by(Solver::Local), by(Solver::Certified));
        let views = [&greedy, &local, &certified].map(|selection| selection.choices.len());
        println!("{path:40} {camera_deg}/{projector_deg:<5} {:>6} {:>5} {:>9} ({optimum})", views[0], views[1], views[2]);
        assert_eq!((certified.bound.gap, certified.stopped_because), (0, StopReason::Target), "{path}: not proved");
        assert!(views[2].abs_diff(optimum) <= apart, "{path}: {} views, elsewhere {optimum}", views[2]);
        assert!(views[1] <= views[2] + 1 && views[2] <= views[1], "{path}: local is more than one above the optimum");
        for selection in [&greedy, &local] {
            let lower = selection.bound.views_lower as usize;
            assert!(lower <= views[2] && lower + 2 >= views[2], "{path}: bound {lower} for an optimum of {}", views[2]);
        }
    }
}
