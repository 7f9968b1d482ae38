//! `cargo bench --bench selection`: the choice of views from two tables, by every solver: that of a public part of 120 mm in the
//! default cell, and a generated one of 400 candidates and 300 000 samples. Prints what each took, by the clock and of the
//! processor, medians of `--rounds N` (3), with views, bound, score and rows, so that two builds can be compared. Other words
//! choose among tables and solvers: `certified`, which takes a minute, only by its name. `plan` makes whole plans of the part and
//! prints their stages instead.

#[expect(dead_code, reason = "shared with the comparison, which uses all of it")]
mod measure;
#[expect(dead_code, reason = "shared with the comparison, which uses all of it")]
mod meshes;

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use measure::{Cost, cost, race};
use nalgebra::Vector3;
use rayon::prelude::*;
use vantage::cell::{Cell, Presets, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::planning::context::{Context, Observer, Silent, Stage};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{PlanParams, ScoreParams, SelectionParams, Solver};
use vantage::planning::selection::{CoverProblem, Selection, select};
use vantage::planning::visibility::Row;
use vantage::planning::{PlanInput, plan, tabulate};

/// Size of the generated table.
const CANDIDATES: usize = 400;
const SAMPLES: usize = 300_000;
const SOLVERS: [(&str, Solver); 4] =
    [("greedy", Solver::Greedy), ("lazy", Solver::Lazy), ("local", Solver::Local), ("certified", Solver::Certified)];

/// Samples that each candidate measures, and the area of each sample.
struct Table {
    rows: Vec<Row>,
    area_mm2: Vec<f64>,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let rounds = words.iter().position(|word| word == "--rounds").and_then(|at| words.get(at + 1)?.parse().ok()).unwrap_or(3);
    let names = ["part", "generated", "plan"];
    let asked = |name: &str, among: &[&str]| {
        let any = words.iter().any(|word| among.contains(&word.as_str()));
        words.iter().any(|word| word == name) || !any && name != "plan"
    };
    let is_asked =
        |name: &str| asked(name, &SOLVERS.map(|(name, _)| name)) && (name != "certified" || words.iter().any(|w| w == name));
    let solvers: Vec<_> = SOLVERS.into_iter().filter(|(name, _)| is_asked(name)).collect();
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("the preset is valid");
    let part = || meshes::parts().swap_remove(0).make();
    if asked("plan", &names) {
        let part = part();
        (0..rounds).for_each(|_| print_stages(&part.mesh, &cell));
    }
    if asked("part", &names) {
        let part = part();
        compare(&part.title, &recorded(&part.mesh, &cell), &solvers, rounds);
    }
    if asked("generated", &names) {
        compare("generated", &generated(), &solvers, rounds);
    }
}

fn compare(title: &str, table: &Table, solvers: &[(&str, Solver)], rounds: usize) {
    let pairs: usize = table.rows.iter().map(Row::count).sum();
    println!("\n{title}: {} candidates, {} samples, {pairs} pairs", table.rows.len(), table.area_mm2.len());
    for (name, solver) in solvers {
        let params = SelectionParams { solver: *solver, ..SelectionParams::default() };
        let contestant = Box::new(|| cost(|| solve(table, &params)).1);
        let Some(Ok(Cost { wall_s, cpu_s })) = race(rounds, vec![Ok(contestant)]).pop() else { continue };
        let selection = solve(table, &params);
        let score: f64 = selection.choices.iter().map(|choice| choice.score).sum();
        let area_mm2: f64 = selection.choices.iter().map(|choice| choice.gain_mm2).sum();
        let rows: Vec<usize> = selection.choices.iter().map(|choice| choice.row.index()).collect();
        println!(
            "{name:9} {:7.1} ms, of the processor {:7.1} ms; {} views, bound {}, {area_mm2:.3} mm², score {score:.4}: {rows:?}",
            wall_s * 1e3,
            cpu_s * 1e3,
            rows.len(),
            selection.bound.views_lower,
        );
    }
}

fn solve(table: &Table, params: &SelectionParams) -> Selection {
    let cancel = AtomicBool::new(false);
    let total_mm2 = table.area_mm2.iter().sum();
    let problem = CoverProblem::new(table.rows.iter().collect(), &table.area_mm2, total_mm2, params);
    select(&problem, params, &ScoreParams::default(), &Context::new(&cancel, &Silent)).expect("not cancelled")
}

fn input<'a>(mesh: &'a Mesh, cell: &'a Cell) -> PlanInput<'a> {
    PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None }
}

/// The table of a part in a cell.
fn recorded(mesh: &Mesh, cell: &Cell) -> Table {
    let cancel = AtomicBool::new(false);
    let table = tabulate(&input(mesh, cell), &PlanParams::default(), &Context::new(&cancel, &Silent)).expect("a table");
    Table { rows: table.rows, area_mm2: table.asked_area_mm2 }
}

/// The table of a wavy ball from all sides: each view measures what faces it within 60° in its field, less what waves hide.
fn generated() -> Table {
    let around = |at: usize, of: usize| {
        let z = 1.0 - (2 * at + 1) as f64 / of as f64;
        let (azimuth, radius) = (at as f64 * PI * (3.0 - 5.0_f64.sqrt()), (1.0 - z * z).sqrt());
        Vector3::new(radius * azimuth.cos(), radius * azimuth.sin(), z)
    };
    let wave = |p: &Vector3<f64>, times: f64| {
        Vector3::new((times * p.y).sin() + (1.7 * times * p.z).cos(), (1.3 * times * p.z).sin(), (times * p.x).cos())
    };
    let places: Vec<Vector3<f64>> = (0..SAMPLES).into_par_iter().map(|at| around(at, SAMPLES)).collect();
    let normals: Vec<_> = places.par_iter().map(|p| (p + 0.2 * wave(p, 9.0)).normalize()).collect();
    let rough: Vec<_> = places.par_iter().map(|p| wave(p, 31.0)).collect();
    let row = |view: usize| {
        let towards = around(view, CANDIDATES);
        let sees = |at: usize| {
            let facing = normals[at].dot(&towards);
            let shadow = rough[at].dot(&towards) + 0.3 * (view as f64).sin();
            (facing > 0.5 && (places[at] - towards).norm() < 0.9 && shadow < 1.3).then_some((SampleId::at(at), facing as f32))
        };
        Row::from_samples(SAMPLES, (0..SAMPLES).filter_map(sees).map(|(sample, facing)| (sample, 4.0 * facing - 3.0)))
    };
    let area_mm2 = (0..SAMPLES).map(|at| 0.1 * (1.5 + rough[at].x.sin())).collect();
    Table { rows: (0..CANDIDATES).into_par_iter().map(row).collect(), area_mm2 }
}

/// Makes a plan and prints what each stage took.
fn print_stages(mesh: &Mesh, cell: &Cell) {
    let (cancel, stages) = (AtomicBool::new(false), Stages(Mutex::new((None, BTreeMap::new()))));
    let outcome = plan(&input(mesh, cell), &PlanParams::default(), &Context::new(&cancel, &stages)).expect("a plan");
    stages.begin(Stage::Report);
    let took = stages.0.into_inner().expect("no panic").1;
    println!("{} views: {took:.3?}", outcome.plan.views.len());
}

/// The running stage with its start, and the seconds of all.
struct Stages(Mutex<(Option<(Stage, Instant)>, SecsByStage)>);

type SecsByStage = BTreeMap<&'static str, f64>;

impl Observer for Stages {
    fn begin(&self, stage: Stage) {
        let mut all = self.0.lock().expect("no panic");
        if let Some((before, start)) = all.0.replace((stage, Instant::now())) {
            *all.1.entry(before.as_str()).or_default() += start.elapsed().as_secs_f64();
        }
    }

    fn progress(&self, _: usize, _: usize) {}
}
