//! Study of how far to stand off: views and grades with candidates slid to where the visible surface of their block scores
//! highest, beside the first surface on the axis at the best distance. The table in `src/planning/candidates/STANDOFF.md` is
//! written with `UPDATE_GOLDEN=1 cargo test --release --test it standoff_study -- --nocapture` (a quarter of an hour); a plain
//! run computes a row again.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use vantage::cell::{Cell, Presets, Scanner, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::planning::candidates::Rejection;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams, ScoreParams, SelectionParams, Standoff, TargetOf};
use vantage::planning::selection::{self, CoverProblem};
use vantage::planning::verdict::Grade;
use vantage::planning::visibility::SampleSet;
use vantage::planning::{PlanError, PlanInput, Tabulated, tabulate};

use crate::support::{preset_scanner, shared, shared_mesh_scaled};

/// Longest edge of the bounding box, mm.
const SIZES_MM: [f64; 4] = [30.0, 120.0, 300.0, 500.0];
/// Sizes that are planned in the default cell too.
const SIZES_IN_CELL_MM: [f64; 2] = [120.0, 500.0];
/// Public parts: three organic ones, of which one in two poses, and a machined one.
const PARTS: [&str; 5] =
    ["armadillo_52k_binary.stl", "bunny_69k_ascii.ply", "bunny_69k_binary.stl", "cheburashka_13k.obj", "cogwheel_536_ascii.stl"];
/// Share of what both sets of candidates can measure that the views have to measure.
const TARGET: f64 = 0.985;
/// Row that a plain run computes again.
const AGAIN: (&str, f64) = ("cogwheel_536_ascii.stl", 120.0);

/// Candidates, and the views that the default selection takes of them.
struct Choice {
    candidates: usize,
    /// Share of the candidates that measure nothing.
    wasted: f64,
    views: usize,
    /// Shares of the measured area at grade A, and at A or B.
    grade_a: f64,
    grades_a_b: f64,
}

impl std::fmt::Display for Choice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { candidates, wasted, views, grade_a, grades_a_b } = self;
        write!(f, "{candidates} ({:.0} %) · {views} · {:.0} · {:.0}", 100.0 * wasted, 100.0 * grade_a, 100.0 * grades_a_b)
    }
}

/// Both ways of standing off, for one part: the first surface at F, and the surface that scores highest.
struct Row {
    name: String,
    first: Choice,
    now: Choice,
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "| {} | {} | {} |", self.name, self.first, self.now)
    }
}

struct Rig {
    scanner: Scanner,
    cell: Cell,
}

impl Rig {
    fn preset() -> Self {
        let spec = Presets.cell("e05-transcan").expect("a preset");
        Self { scanner: preset_scanner("transcan-c"), cell: spec.build(&Presets).expect("the preset is valid") }
    }

    /// `None` if no candidate is left.
    fn tabulated(&self, mesh: &Mesh, in_cell: bool, standoff: Standoff) -> Option<Tabulated> {
        let mut params =
            PlanParams { candidates: CandidateParams { standoff, ..CandidateParams::default() }, ..PlanParams::default() };
        params.part.samples_per_mm2 = Some(20_000.0 / mesh.area_mm2());
        params.part.patch_edge_mm = Some(1000.0);
        params.selection.samples = Some(40_000_000);
        let cancel = AtomicBool::new(false);
        let cell = in_cell.then_some(&self.cell);
        let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &self.scanner, cell, roadmaps: None };
        match tabulate(&input, &params, &Context::new(&cancel, &Silent)) {
            Ok(table) => (!table.rows.is_empty()).then_some(table),
            Err(PlanError::Cancelled) => unreachable!("nobody cancels"),
            Err(error) => {
                println!("no candidates: {error}");
                None
            }
        }
    }

    fn row(&self, name: &str, mesh: &Mesh, size_mm: f64, in_cell: bool) -> Option<Row> {
        let [first, now] = [Standoff::FirstSurface, Standoff::Surface].map(|standoff| self.tabulated(mesh, in_cell, standoff));
        let (first, now) = (first?, now?);
        let coverable = |table: &Tabulated| {
            let rows: Vec<_> = table.rows.iter().collect();
            selection::coverable_mm2(&rows, &table.asked_area_mm2) / table.asked_area_mm2.iter().sum::<f64>()
        };
        let target = TARGET * coverable(&first).min(coverable(&now));
        let name = format!("{name} | {size_mm} | {}", if in_cell { "cell" } else { "none" });
        Some(Row { name, first: choice(&first, target), now: choice(&now, target) })
    }
}

fn choice(table: &Tabulated, target: f64) -> Choice {
    let params = SelectionParams { target, target_of: TargetOf::Asked, min_growth: 0.0, ..SelectionParams::default() };
    let problem = CoverProblem::new(table.rows.iter().collect(), &table.asked_area_mm2, 0.0, &params);
    let cancel = AtomicBool::new(false);
    let context = Context::new(&cancel, &Silent);
    let selection = selection::select(&problem, &params, &ScoreParams::default(), &context).expect("not cancelled");
    let area_above = |above: f64| {
        let mut measured = SampleSet::none_of(table.asked_area_mm2.len());
        for choice in &selection.choices {
            let graded = problem.row(choice.row).graded().filter(|(_, quality)| f64::from(*quality) > above);
            graded.for_each(|(sample, _)| measured.insert(sample));
        }
        measured.iter().map(|sample| table.asked_area_mm2[sample.index()]).sum::<f64>()
    };
    let measured_mm2 = area_above(f64::NEG_INFINITY);
    let nothing = table.candidates.rejected.iter().filter(|(_, reason)| *reason == Rejection::MeasuresNothing).count();
    let candidates = table.rows.len() + nothing;
    Choice {
        candidates,
        wasted: nothing as f64 / candidates as f64,
        views: selection.choices.len(),
        grade_a: area_above(Grade::A.above()) / measured_mm2,
        grades_a_b: area_above(Grade::B.above()) / measured_mm2,
    }
}

fn rows() -> Option<Vec<Row>> {
    let rig = Rig::preset();
    let mut rows = Vec::new();
    for name in PARTS {
        for size_mm in SIZES_MM {
            let mesh = shared_mesh_scaled(&format!("meshes/{name}"), size_mm)?;
            for in_cell in [false, true] {
                if in_cell && !SIZES_IN_CELL_MM.contains(&size_mm) {
                    continue;
                }
                if let Some(row) = rig.row(name, &mesh, size_mm, in_cell) {
                    println!("{row}");
                    rows.push(row);
                }
            }
        }
    }
    Some(rows)
}

/// Counts that stand-offs are judged by.
fn summary(rows: &[Row]) -> String {
    let count = |holds: &dyn Fn(&Row) -> bool| rows.iter().filter(|row| holds(row)).count();
    let views = |row: &Row| row.now.views.cast_signed() - row.first.views.cast_signed();
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        100.0 * values[values.len() / 2]
    };
    let [mut gain_a, mut gain_a_b]: [Vec<f64>; 2] = [
        rows.iter().map(|row| row.now.grade_a - row.first.grade_a).collect(),
        rows.iter().map(|row| row.now.grades_a_b - row.first.grades_a_b).collect(),
    ];
    let wasted = |of: fn(&Row) -> &Choice| {
        let (nothing, all) = rows.iter().map(of).fold((0.0, 0), |(nothing, all), choice| {
            (nothing + choice.wasted * choice.candidates as f64, all + choice.candidates)
        });
        100.0 * nothing / all as f64
    };
    format!(
        "Of {} rows, fewer views than with the first surface at F: {}; as many: {}; one more: {}; two or more: {}. \
         Grade A at most 2 points less: {}; median difference {:+.1} points, of A + B {:+.1}. \
         Candidates that measure nothing: {:.1} %, with the first surface at F {:.1} %.\n",
        rows.len(),
        count(&|row| views(row) < 0),
        count(&|row| views(row) == 0),
        count(&|row| views(row) == 1),
        count(&|row| views(row) > 1),
        count(&|row| row.now.grade_a >= row.first.grade_a - 0.02),
        median(&mut gain_a),
        median(&mut gain_a_b),
        wasted(|row| &row.now),
        wasted(|row| &row.first),
    )
}

fn document(rows: &[Row]) -> String {
    let mut text = String::from(include_str!("standoff_study_head.md"));
    let _ = write!(text, "\n{}\n| part | mm | cell | first surface at F | now |\n|---|--:|---|---|---|\n", summary(rows));
    rows.iter().for_each(|row| text += &format!("{row}\n"));
    text
}

fn file() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/src/planning/candidates/STANDOFF.md"))
}

#[test]
#[ignore = "long: tests/all runs it"]
fn standing_off_is_as_the_table_says() {
    if shared("README.md").is_none() {
        return;
    }
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        let Some(rows) = rows() else { return };
        std::fs::write(file(), document(&rows)).expect("writes");
    }
    let text = std::fs::read_to_string(file()).expect("STANDOFF.md");
    let (name, size_mm) = AGAIN;
    let Some(mesh) = shared_mesh_scaled(&format!("meshes/{name}"), size_mm) else { return };
    let row = Rig::preset().row(name, &mesh, size_mm, false).expect("a row").to_string();
    assert!(text.contains(&row), "STANDOFF.md lacks {row}: see the module's header");
}
