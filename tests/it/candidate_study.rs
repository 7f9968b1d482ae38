//! Study of the candidates to take by default, at four sizes of part: how few views of each set measure as much as 98.5 % of what
//! the thesis's 54 can, how much of the surface they give grade A, and how many candidates measure nothing. The tables in
//! `src/planning/candidates/DEFAULT.md` are written with `UPDATE_GOLDEN=1 cargo test --release --test it candidate_study --
//! --include-ignored --nocapture` (half an hour); a plain run computes two entries of the default set again.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use vantage::geometry::Mesh;
use vantage::planning::candidates::Rejection;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams, ScoreParams, SelectionParams, Standoff, Strategy, TargetOf};
use vantage::planning::selection::{self, CoverProblem, StopReason};
use vantage::planning::verdict::Grade;
use vantage::planning::visibility::SampleSet;
use vantage::planning::{PlanInput, Tabulated, tabulate};

use crate::support::{nominal_scanner, shared, shared_mesh_scaled};

/// Largest edge of the bounding box, mm, with the limits of cameras and projector, degrees.
const TABLES: [(f64, f64, f64); 5] =
    [(120.0, 60.0, 55.0), (30.0, 85.0, 77.5), (120.0, 85.0, 77.5), (300.0, 85.0, 77.5), (500.0, 85.0, 77.5)];
/// Public parts, with the file of each.
const PARTS: [(&str, &str); 6] = [
    ("bunny", "meshes/bunny_69k_binary.stl"),
    ("rocker", "meshes/rocker-arm_20k.obj"),
    ("cogwheel", "meshes/cogwheel_536_ascii.stl"),
    ("gearbox", "meshes/gearbox_output_housing_16k.stl"),
    ("piboy", "meshes/piboy_rear_case_15k_binary.stl"),
    ("featuretype", "meshes/featuretype_3476_inch.stl"),
];
/// Share of what the 54 can measure that every set has to measure.
const TARGET: f64 = 0.985;
/// Largest size of which every part is one block, mm.
const ONE_BLOCK_MM: f64 = 120.0;
/// The set that is the default.
const DEFAULT: &str = "even 150 × rolls 0, 90 + targeted";

/// Sets that parts of several blocks are tried with, which have up to ten times the candidates.
const OF_SEVERAL_BLOCKS: [&str; 6] = [
    "ellipsoid 30/45 (the thesis's 54)",
    "even 75 × rolls 0, 90 + targeted",
    "even 150 × rolls 0, 90 + targeted, first surface at F",
    "even 150 × rolls 0, 90 (no targeted)",
    DEFAULT,
    "even 250 × rolls 0, 90 + targeted",
];

/// Every set of the tables.
fn sets() -> Vec<(&'static str, CandidateParams)> {
    use Strategy::{Even, FacetNormal, SurfacePoints, Targeted, Volume};
    let set = |strategies: &[Strategy]| CandidateParams {
        strategies: strategies.to_vec(),
        rolls_deg: vec![0.0, 90.0],
        ..CandidateParams::default()
    };
    let even = |count: u32, base: CandidateParams| CandidateParams { even_directions: Some(count), ..base };
    let level = |base: CandidateParams| CandidateParams { rolls_deg: vec![0.0], ..base };
    vec![
        ("ellipsoid 30/45 (the thesis's 54)", CandidateParams::ellipsoid()),
        ("ellipsoid 15/30", CandidateParams { step_small_deg: 15.0, step_large_deg: 30.0, ..CandidateParams::ellipsoid() }),
        ("facet normals 100 × rolls 0, 90", set(&[FacetNormal])),
        ("volume 200 × rolls 0, 90", set(&[Volume])),
        ("even 300 + targeted", even(300, level(set(&[Even, Targeted])))),
        ("even 75 × rolls 0, 90 + targeted", even(75, set(&[Even, Targeted]))),
        (
            "even 100 × rolls 0, 90 + surface points 50 × 2 + targeted",
            CandidateParams { surface_points: 50, ..even(100, set(&[Even, SurfacePoints, Targeted])) },
        ),
        (
            "even 150 × rolls 0, 90 + targeted, first surface at F",
            CandidateParams { standoff: Standoff::FirstSurface, ..CandidateParams::default() },
        ),
        ("even 150 × rolls 0, 90 (no targeted)", set(&[Even])),
        (DEFAULT, CandidateParams::default()),
        ("even 250 × rolls 0, 90 + targeted", even(250, set(&[Even, Targeted]))),
    ]
}

fn tabulated(mesh: &Mesh, candidates: &CandidateParams, [camera_deg, projector_deg]: [f64; 2]) -> Tabulated {
    let mut params = PlanParams { candidates: candidates.clone(), ..PlanParams::default() };
    params.limits.camera_deg = Some(camera_deg);
    params.limits.projector_deg = Some(projector_deg);
    params.part.samples_per_mm2 = Some(20_000.0 / mesh.area_mm2());
    params.part.patch_edge_mm = Some(1000.0);
    params.selection.samples = Some(40_000_000);
    let (cancel, scanner) = (AtomicBool::new(false), nominal_scanner());
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    tabulate(&input, &params, &Context::new(&cancel, &Silent)).expect("a table")
}

/// Figures of one set for one part.
struct Entry {
    candidates: usize,
    /// Share of the candidates that measure nothing.
    wasted: f64,
    /// Number of views, and share of the surface that they give grade A; `None` if the set cannot measure enough.
    chosen: Option<(usize, f64)>,
}

impl std::fmt::Display for Entry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({:.0} %) · ", self.candidates, 100.0 * self.wasted)?;
        match self.chosen {
            Some((views, grade_a)) => write!(f, "{views} · {:.0}", 100.0 * grade_a),
            None => f.write_str("no"),
        }
    }
}

fn entry(mesh: &Mesh, candidates: &CandidateParams, limits_deg: [f64; 2], target: f64) -> Entry {
    let table = tabulated(mesh, candidates, limits_deg);
    let nothing = table.candidates.rejected.iter().filter(|(_, reason)| *reason == Rejection::MeasuresNothing).count();
    let candidates = table.rows.len() + nothing;
    Entry { candidates, wasted: nothing as f64 / candidates.max(1) as f64, chosen: chosen(&table, target) }
}

/// The default choice of views for a share of the surface, if all candidates measure as much: how many, and the share at
/// grade A.
fn chosen(table: &Tabulated, target: f64) -> Option<(usize, f64)> {
    let params = SelectionParams { target, target_of: TargetOf::Asked, min_growth: 0.0, ..SelectionParams::default() };
    let problem = CoverProblem::new(table.rows.iter().collect(), &table.asked_area_mm2, 0.0, &params);
    let cancel = AtomicBool::new(false);
    let context = Context::new(&cancel, &Silent);
    let selection = selection::select(&problem, &params, &ScoreParams::default(), &context).expect("not cancelled");
    let mut at_grade_a = SampleSet::none_of(table.asked_area_mm2.len());
    for choice in &selection.choices {
        let is_a = |quality: &f32| f64::from(*quality) > Grade::A.above();
        let graded = problem.row(choice.row).graded().filter(|(_, quality)| is_a(quality));
        graded.for_each(|(sample, _)| at_grade_a.insert(sample));
    }
    let grade_a_mm2: f64 = at_grade_a.iter().map(|sample| table.asked_area_mm2[sample.index()]).sum();
    let share = grade_a_mm2 / problem.asked_mm2();
    (selection.stopped_because == StopReason::Target).then_some((selection.choices.len(), share))
}

/// Share of a part's surface that every set has to measure.
fn target(mesh: &Mesh, limits_deg: [f64; 2]) -> f64 {
    let table = tabulated(mesh, &CandidateParams::ellipsoid(), limits_deg);
    let coverable_mm2 = selection::coverable_mm2(&table.rows.iter().collect::<Vec<_>>(), &table.asked_area_mm2);
    TARGET * coverable_mm2 / table.asked_area_mm2.iter().sum::<f64>()
}

fn document() -> Option<String> {
    let mut text = String::from(include_str!("candidate_study/head.md"));
    for (size_mm, camera_deg, projector_deg) in TABLES {
        let limits_deg = [camera_deg, projector_deg];
        let _ = write!(text, "\n## {size_mm} mm, incidence limits {camera_deg}° / {projector_deg}°\n\n| set |");
        PARTS.iter().for_each(|(name, _)| text += &format!(" {name} |"));
        text += &format!("\n|---|{}\n", "---|".repeat(PARTS.len()));
        let meshes: Option<Vec<_>> = PARTS.iter().map(|(_, path)| shared_mesh_scaled(path, size_mm)).collect();
        let parts: Vec<_> = meshes?.into_iter().map(|mesh| (target(&mesh, limits_deg), mesh)).collect();
        let of_several_blocks = size_mm > ONE_BLOCK_MM;
        for (name, set) in sets().into_iter().filter(|(name, _)| !of_several_blocks || OF_SEVERAL_BLOCKS.contains(name)) {
            let begin = Instant::now();
            let entries: Vec<_> = parts.iter().map(|(target, mesh)| entry(mesh, &set, limits_deg, *target).to_string()).collect();
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
#[ignore = "long: tests/all runs it"]
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
    let (size_mm, camera_deg, projector_deg) = TABLES[0];
    let limits_deg = [camera_deg, projector_deg];
    let line = text.lines().find(|line| line.starts_with(&format!("| {DEFAULT} |"))).expect("a row");
    for part in ["cogwheel", "featuretype"] {
        let column = PARTS.iter().position(|(name, _)| *name == part).expect("a part");
        let Some(mesh) = shared_mesh_scaled(PARTS[column].1, size_mm) else { return };
        let found = entry(&mesh, &set, limits_deg, target(&mesh, limits_deg)).to_string();
        assert_eq!(found, line.split('|').nth(column + 2).expect("an entry").trim(), "{part}: see the module's header");
    }
}
