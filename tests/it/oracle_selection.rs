//! The fewest views beside a mixed-integer solver: `tests/oracles/selection_oracle.py` reads a table and asks HiGHS for the
//! optimum. It merges nothing and shares no code with the planner.

use std::path::Path;
use std::process::Command;

use serde::{Deserialize, Serialize};
use vantage::planning::params::{SelectionGoal, SelectionParams, Solver};

use crate::support::oracle_python;
use crate::support::selection_table::SelectionTable;

/// Samples of a table: few enough for a general solver.
const SAMPLES: usize = 1_500;
/// Views of the second question.
const VIEWS: u32 = 6;

const TABLES: [(&str, f64, f64); 5] = [
    ("meshes/rocker-arm_20k.obj", 60.0, 55.0),
    ("meshes/cogwheel_536_ascii.stl", 60.0, 55.0),
    ("meshes/fandisk_13k.obj", 85.0, 77.5),
    ("meshes/gearbox_output_housing_16k.stl", 60.0, 55.0),
    ("meshes/piboy_rear_case_15k_binary.stl", 85.0, 77.5),
];

#[derive(Serialize)]
struct Question<'a> {
    area_mm2: &'a [f64],
    rows: Vec<Vec<u32>>,
    target: f64,
    views: u32,
}

#[derive(Debug, Deserialize)]
struct Answer {
    /// Fewest views for the target share of what can be covered.
    fewest_views: usize,
    /// Most area with so many views.
    most_area_mm2: f64,
}

#[test]
fn a_mixed_integer_solver_finds_the_same_optima() {
    let Some(python) = oracle_python() else { return };
    for (path, camera_deg, projector_deg) in TABLES {
        let Some(table) = SelectionTable::new(path, 120.0, camera_deg, projector_deg, SAMPLES) else { return };
        let answer = ask(&python, &table);
        let certified = SelectionParams { solver: Solver::Certified, ..SelectionParams::default() };
        let fewest = table.solve(&certified);
        let most = table.solve(&SelectionParams { goal: SelectionGoal::BestCoverage, max_views: Some(VIEWS), ..certified });
        let measured_mm2: f64 = most.choices.iter().map(|choice| choice.gain_mm2).sum();
        println!("{path}: {} views, {measured_mm2:.1} mm² with {VIEWS}; oracle {answer:?}", fewest.choices.len());
        assert_eq!((fewest.bound.gap, most.bound.gap_of_asked), (0, Some(0.0)), "{path}: not proved");
        assert_eq!(fewest.choices.len(), answer.fewest_views, "{path}");
        assert!((measured_mm2 / answer.most_area_mm2 - 1.0).abs() < 1e-6, "{path}: {measured_mm2} mm², {answer:?}");
    }
}

fn ask(python: &Path, table: &SelectionTable) -> Answer {
    let rows = table.rows.iter().map(|row| row.samples().map(|sample| sample.0).collect()).collect();
    let question = Question { area_mm2: &table.area_mm2, rows, target: SelectionParams::default().target, views: VIEWS };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("table.json");
    std::fs::write(&file, serde_json::to_vec(&question).expect("JSON")).expect("written");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/oracles/selection_oracle.py");
    let output = Command::new(python).arg(script).arg(&file).output().expect("the oracle starts");
    assert!(output.status.success(), "the oracle failed: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("the oracle answers in JSON")
}
