//! Figures identified from clouds of the simulated scanner, held against those that it was given (row I7), and the loop closed with it
//! (row I8).

use nalgebra::Matrix6;

use super::*;
use crate::geometry::demo_parts::DemoPart;
use crate::geometry::{Mesh, Part, Pose, RayScene, ScannerFrame};
use crate::inspection::RegisteredView;
use crate::inspection::coverage::{self, ComparedViews, MeasuredCoverage, NominalModel, PlannedRow, Returns, ScannedView};
use crate::inspection::rehearsal::{Knowledge, Rehearsal, in_context};
use crate::inspection::rescan::{RescanInput, rescan};
use crate::inspection::simulated_scanner::{SimulatedScanner, SimulatedView, SimulationParams};
use crate::planning::PlanInput;
use crate::planning::params::{PlanParams, RescanParams};
use crate::planning::plan::Outcome;
use crate::planning::visibility::{Row, SampleSet};

/// The scanner as it is: half the specification's noise again, nothing beyond 80°, a cone of glare.
fn truth(step_px: u32) -> SimulationParams {
    SimulationParams {
        step_px,
        noise_best_mm: Some(0.015),
        noise_depth_gain: Some(2.0),
        grazing_deg: vec![65.0, 80.0],
        lobe_deg: 4.0,
        ..SimulationParams::default()
    }
}

fn quick(camera_deg: Option<f64>) -> PlanParams {
    let mut params = PlanParams::default();
    (params.robust.pose_error, params.missed.remedies, params.missed.advice) = (None, 0, false);
    params.limits.camera_deg = camera_deg;
    params
}

fn registered(view: &SimulatedView) -> RegisteredView {
    let part_from_scanner = view.true_part_from_scanner;
    RegisteredView { viewpoint: view.scan.viewpoint, part_from_scanner, covariance: Matrix6::zeros(), is_in_prior: true }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn noise_limit_and_cone_come_back_from_the_clouds_of_a_simulated_scanner() {
    let rehearsal = Rehearsal::new(DemoPart::Base.mesh(8_000).expect("a part"), &quick(None));
    let views = rehearsal.scan(&truth(6), rehearsal.as_planned());
    let surfaces = RayScene::new([&rehearsal.mesh]);
    let input = TripleInput { mesh: &rehearsal.mesh, surfaces: &surfaces, scanner: &rehearsal.scanner };
    let poses: Vec<RegisteredView> = views.iter().map(registered).collect();
    let scans: Vec<_> = views.iter().map(|view| &view.scan).zip(&poses).collect();
    let triples = in_context(|ctx| triples(&input, &scans, ctx)).expect("triples");
    let noise = noise(&triples, &rehearsal.scanner).expect("enough");
    let (of_best, of_gain) = (noise.best_mm.value / 0.015 - 1.0, noise.depth_gain.value / 2.0 - 1.0);
    println!("{} triples: sigma {:+.2} %, g {:+.2} %, {noise:?}", triples.len(), 100.0 * of_best, 100.0 * of_gain);
    assert!(triples.len() >= 20_000 && of_best.abs() < 0.03 && of_gain.abs() < 0.10, "{noise:?}");
    let judged = rehearsal.judge(&views, &Knowledge::default());
    let learned = returns(&judged.returns, &rehearsal.scanner).expect("enough");
    let (limit, lobe) = (learned.incidence.expect("a limit"), learned.lobe.expect("a cone"));
    println!("{} pairs: limit {limit:?}, cone {lobe:?}, easy {:.3}", learned.pairs, learned.easy_rate);
    assert!((limit.limit.value - 68.75).abs() < 3.0, "0.75 of a fall from 65 to 80: {limit:?}");
    assert!((lobe.limit.value - 4.0).abs() < 1.0, "{lobe:?}");
    let limits = learned.limits(&rehearsal.scanner);
    assert!(limits.lobe_deg == Some(lobe.limit.value) && limits.depth_mm.is_none(), "{limits:?}");
}

/// A part with all that was planned and scanned of it.
struct Loop<'a> {
    rehearsal: &'a Rehearsal,
    planned: Vec<PlannedRow>,
    scans: Vec<SimulatedView>,
}

impl Loop<'_> {
    fn scan(&mut self, sim: &SimulationParams, poses: &[(Pose<Part, ScannerFrame>, Row)]) {
        let rehearsal = self.rehearsal;
        let first = self.planned.len() as u32;
        let views: Vec<_> = (first..).zip(poses).map(|(number, (pose, _))| (number, *pose)).collect();
        let taken = in_context(|ctx| {
            SimulatedScanner::new(&rehearsal.scanner, &PlanParams::default(), sim, rehearsal.as_planned(), ctx)?.scan(&views, ctx)
        });
        self.scans.extend(taken.expect("scans"));
        self.planned.extend((first..).zip(poses).map(|(viewpoint, (_, row))| PlannedRow { viewpoint, row: row.clone() }));
    }

    fn judge(&self) -> (MeasuredCoverage, Returns) {
        let rehearsal = self.rehearsal;
        let poses: Vec<RegisteredView> = self.scans.iter().map(registered).collect();
        let scanned: Vec<ScannedView<'_>> =
            self.scans.iter().zip(&poses).map(|(view, registered)| ScannedView { scan: &view.scan, registered }).collect();
        let asked_area_mm2 = rehearsal.asked_area_mm2();
        let compared = ComparedViews {
            surface: &rehearsal.outcome.surface,
            asked_area_mm2: &asked_area_mm2,
            scanner: &rehearsal.scanner,
            params: &rehearsal.outcome.plan.params,
            planned: &self.planned,
            scanned: &scanned,
            coverable_mm2: None,
            compare: &rehearsal.compare,
        };
        in_context(|ctx| {
            let coverage = coverage::measure(&compared, ctx).expect("coverage");
            let model = NominalModel::new(&rehearsal.mesh, &[], &rehearsal.scanner, ctx).expect("a model");
            let returns = coverage::returns(&compared, &coverage, &model, ctx).expect("returns");
            (coverage, returns)
        })
    }
}

fn views_of(outcome: &Outcome) -> Vec<(Pose<Part, ScannerFrame>, Row)> {
    let rows = outcome.plan.views.iter().zip(&outcome.measured_by_view);
    rows.map(|(view, row)| (view.part_from_scanner, row.clone())).collect()
}

/// Views and measured share of a part, planned and scanned without a second look.
fn once(mesh: &Mesh, params: &PlanParams, sim: &SimulationParams) -> (usize, f64) {
    let rehearsal = Rehearsal::new(mesh.clone(), params);
    let mut once = Loop { rehearsal: &rehearsal, planned: Vec::new(), scans: Vec::new() };
    once.scan(sim, &views_of(&rehearsal.outcome));
    (once.planned.len(), once.judge().0.of_asked())
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_loop_closes_with_the_simulated_scanner() {
    let (sim, mesh) = (truth(8), DemoPart::Base.mesh(8_000).expect("a part"));
    let rehearsal = Rehearsal::new(mesh.clone(), &quick(None));
    let mut all = Loop { rehearsal: &rehearsal, planned: Vec::new(), scans: Vec::new() };
    all.scan(&sim, &views_of(&rehearsal.outcome));
    let hopeless = SampleSet::none_of(rehearsal.outcome.surface.sample_mm.len());
    let input =
        PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &rehearsal.scanner, cell: None, roadmaps: None };
    let mut shares = Vec::new();
    for rounds in 0.. {
        let (coverage, of_scans) = all.judge();
        shares.push(100.0 * coverage.of_asked());
        let learned = returns(&of_scans, &rehearsal.scanner).expect("enough");
        let part = RescanInput {
            input: &input,
            params: &rehearsal.outcome.plan.params,
            target_of_mm2: rehearsal.outcome.plan.coverage.whole_mm2(rehearsal.outcome.plan.params.selection.target_of),
            surface: &rehearsal.outcome.surface,
            measured: &coverage.measured,
            hopeless: &hopeless,
            model: &learned.model,
            rounds,
        };
        let next = in_context(|ctx| rescan(&part, &RescanParams::default(), ctx)).expect("a rescan");
        let Some(outcome) = &next.outcome else { break };
        all.scan(&sim, &views_of(outcome));
    }
    let (known_views, known) = once(&mesh, &quick(Some(70.0)), &sim);
    let views = all.planned.len();
    println!("base: {shares:?} % with {views} views; planned at 70 degrees: {:.2} % with {known_views}", 100.0 * known);
    let share = shares.last().expect("a round") / 100.0;
    assert!(shares.len() <= 3 && share >= 0.99 * known && views <= known_views + 3, "{share} {known} {views} {known_views}");
}
