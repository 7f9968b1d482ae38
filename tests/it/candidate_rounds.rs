//! Candidates in rounds: what the later ones add to the earlier, what is counted, and that nothing depends on threads.

use std::sync::atomic::AtomicBool;

use vantage::cell::{Presets, SpecLibrary};
use vantage::geometry::{Mesh, demo_parts};
use vantage::planning::candidates::Rejection;
use vantage::planning::context::{Context, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{CandidateParams, Objective, PlanParams, Strategy};
use vantage::planning::plan::Outcome;
use vantage::planning::{PlanInput, plan, tabulate};
use vantage::report::text::text;

use crate::support::shapes::sphere;
use crate::support::{box_mesh, nominal_scanner, plan_viewpoints};

/// One mesh of several, which may touch.
fn joined(parts: &[Mesh]) -> Mesh {
    let mut whole = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
    for part in parts {
        let first = whole.vertices_mm.len() as u32;
        whole.vertices_mm.extend(&part.vertices_mm);
        whole.faces.extend(part.faces.iter().map(|face| face.map(|vertex| first + vertex)));
    }
    whole.source_face = (0..whole.faces.len() as u32).collect();
    whole
}

/// A block with a pocket of 14 × 40 mm, 40 mm deep, that opens upwards. The baseline fits along y alone.
fn pocket() -> Mesh {
    joined(&[
        box_mesh([-30.0, -30.0, 0.0], [30.0, 30.0, 5.0]),
        box_mesh([-30.0, -30.0, 5.0], [-7.0, 30.0, 45.0]),
        box_mesh([7.0, -30.0, 5.0], [30.0, 30.0, 45.0]),
        box_mesh([-7.0, -30.0, 5.0], [7.0, -20.0, 45.0]),
        box_mesh([-7.0, 20.0, 5.0], [7.0, 30.0, 45.0]),
    ])
}

fn params(candidates: CandidateParams) -> PlanParams {
    let mut params = PlanParams { candidates, ..PlanParams::default() };
    params.part.samples_per_mm2 = Some(0.3);
    params.selection.objective = Objective::Coverage;
    params.selection.samples = Some(40_000_000);
    params
}

fn counted(outcome: &Outcome) {
    let counts = &outcome.plan.candidates;
    assert_eq!(counts.generated, counts.kept + counts.rejected.values().sum::<usize>(), "{counts:?}");
}

#[test]
fn the_floor_of_a_pocket_is_measured_by_targeted_views_alone() {
    let (mesh, scanner) = (pocket(), nominal_scanner());
    let floor = |candidates| {
        let (cancel, params) = (AtomicBool::new(false), params(candidates));
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let table = tabulate(&input, &params, &Context::new(&cancel, &Silent)).expect("a table");
        let on_floor: Vec<SampleId> = SampleId::number(&table.surface.sample_mm)
            .filter(|(_, p)| (p.z - 5.0).abs() < 1e-3 && p.x.abs() < 6.0 && p.y.abs() < 19.0)
            .map(|(sample, _)| sample)
            .filter(|sample| table.surface.patch_of(*sample).normal.z > 0.9)
            .collect();
        let seen = on_floor.iter().filter(|sample| table.rows.iter().any(|row| row.holds(**sample))).count();
        seen as f64 / on_floor.len() as f64
    };
    let thesis = CandidateParams::ellipsoid();
    let targeted = CandidateParams { strategies: vec![Strategy::Ellipsoid, Strategy::Targeted], ..thesis.clone() };
    assert_eq!(floor(thesis), 0.0, "the level baseline does not fit");
    let seen = floor(targeted);
    // What lies within 8.4 mm of the two short walls has one camera's line cut off at either end.
    assert!(seen > 0.7, "{seen} of the floor");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_part_of_many_views_is_chosen_on_more_of_its_samples() {
    let chosen_on = |limit_deg: f64| {
        let mut params = PlanParams::default();
        (params.limits.camera_deg, params.limits.projector_deg) = (Some(limit_deg), Some(limit_deg));
        params.part.samples_per_mm2 = Some(15.0);
        let plan = plan_viewpoints(&sphere(20.0, 4), &nominal_scanner(), &params).plan;
        (plan.views.len(), plan.chosen_on.samples, plan.chosen_on.of_samples)
    };
    let (views, samples, of_samples) = chosen_on(60.0);
    assert!(views < 15 && samples < 12_000 && of_samples > 60_000, "{views} views on {samples} of {of_samples}");
    let (views, samples, of_samples) = chosen_on(32.0);
    assert!(views > 20 && (35_000..50_000).contains(&samples), "{views} views on {samples} of {of_samples}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn rejected_and_kept_are_what_was_generated() {
    let (mesh, scanner) = (pocket(), nominal_scanner());
    let outcome = plan_viewpoints(&mesh, &scanner, &params(CandidateParams::default()));
    counted(&outcome);
    let counts = &outcome.plan.candidates;
    assert!(counts.kept <= 400 && counts.kept > 300, "{counts:?}");
    let targeted = counts.generated - 300;
    assert!(targeted > 0 && counts.rejected[&Rejection::NotNeeded] < targeted, "{counts:?}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_candidate_that_measures_nothing_asked_is_dropped_and_nothing_changes() {
    // Two fifths of a metre back nothing is in depth.
    let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 20.0]), nominal_scanner());
    let plain = plan_viewpoints(&mesh, &scanner, &params(CandidateParams::ellipsoid()));
    let idle = CandidateParams { standoffs_mm: vec![0.0, 400.0], ..CandidateParams::ellipsoid() };
    let with_idle = plan_viewpoints(&mesh, &scanner, &params(idle));
    counted(&with_idle);
    assert_eq!(with_idle.plan.candidates.rejected[&Rejection::MeasuresNothing], 54);
    assert_eq!(with_idle.plan.coverage, plain.plan.coverage);
    let poses = |outcome: &Outcome| outcome.plan.views.iter().map(|view| view.part_from_scanner).collect::<Vec<_>>();
    assert_eq!(poses(&with_idle), poses(&plain));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn re_sampling_around_the_best_measures_no_less_with_no_more_views() {
    let (mesh, scanner) = (pocket(), nominal_scanner());
    let plain = plan_viewpoints(&mesh, &scanner, &params(CandidateParams::ellipsoid()));
    let iterative =
        CandidateParams { strategies: vec![Strategy::Ellipsoid, Strategy::Iterative], ..CandidateParams::ellipsoid() };
    let outcome = plan_viewpoints(&mesh, &scanner, &params(iterative));
    assert_eq!(outcome.plan.candidates.generated, 54 + 3 * 50);
    assert!(outcome.plan.coverage.coverable_area_mm2 >= plain.plan.coverage.coverable_area_mm2);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_strategy_at_once_gives_the_same_plan_on_one_and_two_threads() {
    use Strategy::{Ellipsoid, Even, FacetNormal, Iterative, Reach, SurfacePoints, Targeted, Volume};
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let strategies = vec![Ellipsoid, Even, FacetNormal, SurfacePoints, Volume, Reach, Iterative, Targeted];
    let few = CandidateParams {
        strategies,
        even_directions: Some(20),
        facet_normals: 10,
        surface_points: 10,
        volume_points: 20,
        reach_directions: 20,
        iterative_views: 10,
        targeted_max: 10,
        ..CandidateParams::default()
    };
    let (mesh, params) = (pocket(), params(few));
    let planned = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let cancel = AtomicBool::new(false);
        let input =
            PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
        pool.install(|| plan(&input, &params, &Context::new(&cancel, &Silent))).expect("a plan")
    };
    let (one, two) = (planned(1), planned(2));
    counted(&one);
    assert_eq!(text(&one.plan), text(&two.plan));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn with_a_cell_the_default_candidates_all_count_and_every_view_has_a_station() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let (mesh, cancel) = (pocket(), AtomicBool::new(false));
    let input =
        PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
    let outcome = plan(&input, &params(CandidateParams::default()), &Context::new(&cancel, &Silent)).expect("a plan");
    counted(&outcome);
    let (plan, coverage) = (&outcome.plan, &outcome.plan.coverage);
    assert!(plan.views.iter().all(|view| view.station.is_some() != view.rejected.is_some()));
    assert!(plan.candidates.kept <= 400);
    assert!(coverage.coverable_area_mm2 <= coverage.optically_coverable_area_mm2 + 1e-6);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_closer_look_counts_its_candidates_and_takes_hardly_more_views() {
    let (scanner, mesh) = (nominal_scanner(), demo_parts::base(20_000).expect("a demo part"));
    let planned = |look_closer| {
        let candidates = CandidateParams { look_closer, ..CandidateParams::default() };
        plan_viewpoints(&mesh, &scanner, &PlanParams { candidates, ..PlanParams::default() })
    };
    let [once, closer] = [false, true].map(planned);
    [&once, &closer].into_iter().for_each(counted);
    // Samples that were added in between may cost a view.
    let views = [&closer, &once].map(|outcome| outcome.plan.views.len());
    assert!(views[0] <= views[1] + 1, "{} views, {} at once", views[0], views[1]);
    assert!(closer.plan.coverage.of_coverable() >= 0.985);
}
