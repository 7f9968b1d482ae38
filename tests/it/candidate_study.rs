//! Which candidates to take by default: how much each set can measure, and how few of its views measure as much as 98.5 % of
//! what the thesis's 54 can. The table in `src/planning/candidates/DEFAULT.md` is written with
//! `UPDATE_GOLDEN=1 cargo test --release --test it candidate_study -- --nocapture` (half an hour); a plain run computes two
//! entries of the default set again.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use vantage::geometry::Mesh;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{
    CandidateParams, Objective, PlanParams, ScoreParams, SelectionParams, Solver, Strategy, TargetOf,
};
use vantage::planning::selection::{self, CoverProblem, StopReason};
use vantage::planning::{PlanInput, Tabulated, tabulate};

use crate::support::{PARTS, nominal_scanner, shared, shared_mesh_scaled};

/// Limits of cameras and projector, degrees.
const LIMITS_DEG: [(f64, f64); 2] = [(60.0, 55.0), (85.0, 77.5)];
/// Share of what the 54 can measure that every set has to measure.
const TARGET: f64 = 0.985;
/// The set that is the default.
const DEFAULT: &str = "even 150 × rolls 0, 90 + targeted";

/// Every set of the table.
fn sets() -> Vec<(&'static str, CandidateParams)> {
    use Strategy::{Ellipsoid, Even, FacetNormal, Iterative, SurfacePoints, Targeted, Volume};
    let set = |strategies: &[Strategy], rolls_deg: &[f64]| CandidateParams {
        strategies: strategies.to_vec(),
        rolls_deg: rolls_deg.to_vec(),
        ..CandidateParams::default()
    };
    let even = |count: u32, base: CandidateParams| CandidateParams { even_directions: Some(count), ..base };
    let level_and_upright = [0.0, 90.0];
    vec![
        ("ellipsoid 30/45 (the thesis's 54)", CandidateParams::ellipsoid()),
        ("the same × rolls 0, 90", set(&[Ellipsoid], &level_and_upright)),
        ("the same + targeted", set(&[Ellipsoid, Targeted], &level_and_upright)),
        ("ellipsoid 30/45, tilts of 20°", CandidateParams { tilts_deg: vec![20.0], ..CandidateParams::ellipsoid() }),
        (
            "ellipsoid 30/45, stand-offs −30, 0, 30",
            CandidateParams { standoffs_mm: vec![-30.0, 0.0, 30.0], ..CandidateParams::ellipsoid() },
        ),
        ("ellipsoid 15/30", CandidateParams { step_small_deg: 15.0, step_large_deg: 30.0, ..CandidateParams::ellipsoid() }),
        ("facet normals 100 × rolls 0, 90", set(&[FacetNormal], &level_and_upright)),
        ("surface points 100 × rolls 0, 90", set(&[SurfacePoints], &level_and_upright)),
        ("volume 200 × rolls 0, 90", set(&[Volume], &level_and_upright)),
        ("ellipsoid 54 + iterative 3 × 100", CandidateParams { iterative_views: 100, ..set(&[Ellipsoid, Iterative], &[0.0]) }),
        ("even 300", even(300, set(&[Even], &[0.0]))),
        ("even 150 × rolls 0, 90", set(&[Even], &level_and_upright)),
        ("even 200 × rolls 0, 90", even(200, set(&[Even], &level_and_upright))),
        ("even 100 × rolls 0, 90 + surface points 50 × 2 + targeted", {
            let mixed = set(&[Even, SurfacePoints, Targeted], &level_and_upright);
            CandidateParams { surface_points: 50, ..even(100, mixed) }
        }),
        ("even 300 + targeted", even(300, set(&[Even, Targeted], &[0.0]))),
        (DEFAULT, CandidateParams::default()),
    ]
}

fn tabulated(mesh: &Mesh, candidates: &CandidateParams, (camera_deg, projector_deg): (f64, f64)) -> Tabulated {
    let mut params = PlanParams { candidates: candidates.clone(), ..PlanParams::default() };
    params.limits.camera_deg = Some(camera_deg);
    params.limits.projector_deg = Some(projector_deg);
    params.selection.objective = Objective::Coverage;
    params.part.samples_per_mm2 = Some(20_000.0 / mesh.area_mm2());
    params.part.patch_edge_mm = Some(1000.0);
    let (cancel, scanner) = (AtomicBool::new(false), nominal_scanner());
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    tabulate(&input, &params, &Context::new(&cancel, &Silent)).expect("a table")
}

/// What one set does for one part.
struct Entry {
    candidates: usize,
    coverable: f64,
    views: Option<usize>,
}

impl std::fmt::Display for Entry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let views = self.views.map_or("no".into(), |views| views.to_string());
        write!(f, "{} · {:.1} · {views}", self.candidates, 100.0 * self.coverable)
    }
}

fn entry(mesh: &Mesh, candidates: &CandidateParams, limits_deg: (f64, f64), target_mm2: f64) -> Entry {
    let table = tabulated(mesh, candidates, limits_deg);
    let asked_mm2: f64 = table.asked_area_mm2.iter().sum();
    let rows: Vec<_> = table.rows.iter().collect();
    let coverable = selection::coverable_mm2(&rows, &table.asked_area_mm2) / asked_mm2;
    Entry { candidates: rows.len(), coverable, views: fewest(&table, target_mm2 / asked_mm2) }
}

/// Views that `local` needs for a share of the asked area, if all candidates measure as much.
fn fewest(table: &Tabulated, share: f64) -> Option<usize> {
    let params = SelectionParams {
        solver: Solver::Local,
        objective: Objective::Coverage,
        target: share,
        target_of: TargetOf::Asked,
        min_growth: 0.0,
        ..SelectionParams::default()
    };
    let problem = CoverProblem::new(table.rows.iter().collect(), &table.asked_area_mm2, 0.0, &params);
    let cancel = AtomicBool::new(false);
    let context = Context::new(&cancel, &Silent);
    let selection = selection::select(&problem, &params, &ScoreParams::default(), &context).expect("not cancelled");
    (selection.stopped_because == StopReason::Target).then_some(selection.choices.len())
}

/// What every set has to measure of a part.
fn target_mm2(mesh: &Mesh, limits_deg: (f64, f64)) -> f64 {
    let table = tabulated(mesh, &CandidateParams::ellipsoid(), limits_deg);
    TARGET * selection::coverable_mm2(&table.rows.iter().collect::<Vec<_>>(), &table.asked_area_mm2)
}

fn document() -> Option<String> {
    let mut text = String::from(include_str!("candidate_study/head.md"));
    for limits_deg in LIMITS_DEG {
        let _ = write!(text, "\n## Incidence limits {}° / {}°\n\n| set |", limits_deg.0, limits_deg.1);
        PARTS.iter().for_each(|(name, ..)| text += &format!(" {name} |"));
        text.push_str("\n|---|---|---|---|---|---|---|---|---|---|\n");
        let meshes: Option<Vec<_>> = PARTS.iter().map(|(_, path, mm)| shared_mesh_scaled(path, *mm)).collect();
        let parts: Vec<_> = meshes?.into_iter().map(|mesh| (target_mm2(&mesh, limits_deg), mesh)).collect();
        for (name, set) in sets() {
            let begin = Instant::now();
            let entries: Vec<_> =
                parts.iter().map(|(target_mm2, mesh)| entry(mesh, &set, limits_deg, *target_mm2).to_string()).collect();
            let line = format!("| {name} | {} |", entries.join(" | "));
            println!("{line} {:.1} s", begin.elapsed().as_secs_f64());
            text += &(line + "\n");
        }
    }
    Some(text)
}

fn file() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/src/planning/candidates/DEFAULT.md"))
}

#[test]
fn the_default_candidates_are_those_of_the_table() {
    if shared("README.md").is_none() {
        return;
    }
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        let Some(text) = document() else { return };
        std::fs::write(file(), text).expect("writes");
    }
    let text = std::fs::read_to_string(file()).expect("DEFAULT.md");
    let (_, set) = sets().into_iter().find(|(name, _)| *name == DEFAULT).expect("the default set");
    assert_eq!(set, CandidateParams::default());
    let limits_deg = LIMITS_DEG[0];
    let line = text.lines().find(|line| line.starts_with(&format!("| {DEFAULT} |"))).expect("a row");
    for part in ["cogwheel", "featuretype"] {
        let column = PARTS.iter().position(|(name, ..)| *name == part).expect("a part");
        let Some(mesh) = shared_mesh_scaled(PARTS[column].1, PARTS[column].2) else { return };
        let found = entry(&mesh, &set, limits_deg, target_mm2(&mesh, limits_deg)).to_string();
        assert_eq!(found, line.split('|').nth(column + 2).expect("an entry").trim(), "{part}: see the module's header");
    }
}
