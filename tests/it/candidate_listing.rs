//! `candidates.json`: every candidate is there with its fate, its matrices give the figures of the plan, and asking for it
//! changes no plan.

use std::sync::atomic::AtomicBool;

use vantage::cell::{Cell, Presets, SpecLibrary};
use vantage::geometry::{Mesh, Part, ScannerFrame};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, InterestParams, Objective, PlanParams, Region, Strategy};
use vantage::planning::plan::Outcome;
use vantage::planning::{PlanInput, plan};
use vantage::wire::candidates::{CandidateDocument, CandidateListing, file_bytes};

use crate::support::{box_mesh, nominal_scanner, plan_viewpoints};

/// Largest error of a quality of four decimals, and of the 16 bits that planning has it in.
const QUALITY_ERROR: f64 = 0.52e-4;

fn block() -> Mesh {
    box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0])
}

fn quick() -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.part.samples_per_mm2 = Some(0.3);
    (params.output.candidates, params.missed.remedies) = (true, 0);
    params
}

/// The bytes of the file, if the plan was asked for it.
fn bytes(outcome: &Outcome, mesh: &Mesh) -> Option<Vec<u8>> {
    let cancel = AtomicBool::new(false);
    file_bytes(outcome, mesh, "", &Context::new(&cancel, &Silent)).transpose().expect("small")
}

fn listing(outcome: &Outcome, mesh: &Mesh) -> CandidateListing {
    serde_json::from_slice(&bytes(outcome, mesh).expect("asked for")).expect("a listing")
}

/// Samples of `[first, count, first, count, …]`.
fn samples_of(runs: &[u32]) -> Vec<usize> {
    runs.chunks(2).flat_map(|run| run[0]..run[0] + run[1]).map(|sample| sample as usize).collect()
}

/// The columns as a reader of the file has them: asked area and weight of each sample.
struct Columns {
    area_mm2: Vec<f64>,
    weight: Vec<f64>,
    face: Vec<u32>,
}

fn columns(listing: &CandidateListing) -> Columns {
    let columns = &listing.samples;
    let ends = columns.patch_first_sample.iter().skip(1).copied().chain([columns.count as u32]);
    let mut found = Columns { area_mm2: Vec::new(), weight: vec![1.0; columns.count], face: Vec::new() };
    for (patch, (first, end)) in columns.patch_first_sample.iter().zip(ends).enumerate() {
        assert!(*first < end, "each patch has a sample");
        let samples = (end - first) as usize;
        found.area_mm2.extend(vec![columns.patch_sample_area_mm2[patch]; samples]);
        found.face.extend(vec![columns.patch_face[patch]; samples]);
    }
    samples_of(&columns.not_asked_runs).into_iter().for_each(|sample| found.area_mm2[sample] = 0.0);
    for run in &columns.weighted_runs {
        (run.first_sample..run.first_sample + run.samples).for_each(|sample| found.weight[sample as usize] = run.weight);
    }
    found
}

/// Σ S w (a + b q) over the samples of a candidate that are open, and Σ S w of them.
fn score(candidate: &CandidateDocument, listing: &CandidateListing, columns: &Columns, open: &[bool]) -> (f64, f64) {
    let samples = samples_of(&candidate.measured_runs);
    assert_eq!(samples.len(), candidate.quality.len(), "H and G have the same places");
    let of_sample = |(sample, quality): (&usize, &f32)| {
        let area_mm2 = if open[*sample] { columns.area_mm2[*sample] * columns.weight[*sample] } else { 0.0 };
        (area_mm2 * (listing.score.a + listing.score.b * f64::from(*quality)), area_mm2)
    };
    samples.iter().zip(&candidate.quality).map(of_sample).fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1))
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_matrices_give_the_areas_and_the_scores_of_the_plan() {
    let (mesh, mut params) = (block(), quick());
    // Scores are those on the samples that views are chosen on.
    params.selection.samples = Some(40_000_000);
    params.regions.exclude = vec![Region::HalfSpace { point_mm: [0.0, 0.0, 8.0], normal: [0.0, 0.0, 1.0] }];
    params.regions.interest = vec![InterestParams {
        name: None,
        region: Region::Box { min_mm: [-31.0, -21.0, 30.0], max_mm: [0.0, 21.0, 41.0] },
        weight: 3.0,
        target: None,
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    }];
    let outcome = plan_viewpoints(&mesh, &nominal_scanner(), &params);
    let (plan, listing) = (&outcome.plan, listing(&outcome, &mesh));
    let columns = columns(&listing);
    assert!(!listing.samples.not_asked_runs.is_empty() && !listing.samples.weighted_runs.is_empty(), "too little to tell");
    assert!((columns.area_mm2.iter().sum::<f64>() - plan.coverage.asked_area_mm2).abs() < 1e-6);
    for face in 0..12_u32 {
        let sampled = columns.face.iter().zip(&columns.area_mm2).filter(|(of, _)| **of == face).map(|(_, mm2)| mm2).sum::<f64>();
        assert!(sampled <= mesh.face_area_mm2(face as usize) + 1e-6, "face {face}: {sampled} mm²");
    }
    let all_open = vec![true; listing.samples.count];
    for candidate in &listing.candidates {
        let area_mm2: f64 = samples_of(&candidate.measured_runs).iter().map(|sample| columns.area_mm2[*sample]).sum();
        assert!((candidate.measured_area_mm2.unwrap_or(0.0) - area_mm2).abs() < 1e-6, "{}: {area_mm2}", candidate.id);
        let (score, weighted_mm2) = score(candidate, &listing, &columns, &all_open);
        let error = listing.score.b * QUALITY_ERROR * weighted_mm2 + 1e-6;
        assert!((candidate.score_mm2.unwrap_or(0.0) - score).abs() <= error, "{}: {score}", candidate.id);
    }
    // In the order chosen each view scores over what is still open; together they measure what the plan says.
    let mut open = all_open;
    for view in &plan.views {
        let is_view = |candidate: &&CandidateDocument| candidate.viewpoint == Some(view.id.0);
        let candidate = listing.candidates.iter().find(is_view).expect("every view is a candidate");
        assert_eq!((candidate.id, candidate.fate.as_str()), (view.candidate.0, "chosen"));
        let (score, weighted_mm2) = score(candidate, &listing, &columns, &open);
        let error = listing.score.b * QUALITY_ERROR * weighted_mm2 + 1e-6;
        assert!((view.score - score).abs() <= error, "view {}: {score} mm², in the plan {}", view.id.0, view.score);
        samples_of(&candidate.measured_runs).into_iter().for_each(|sample| open[sample] = false);
    }
    let measured_mm2: f64 = columns.area_mm2.iter().zip(&open).filter(|(_, open)| !**open).map(|(mm2, _)| mm2).sum();
    assert!((measured_mm2 - plan.coverage.measured.area_mm2).abs() < 1e-6, "{measured_mm2}");
}

fn planned_in_cell(mesh: &Mesh, cell: &Cell, params: &PlanParams) -> Outcome {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None };
    plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan")
}

#[test]
fn every_candidate_of_a_cell_is_listed_once_with_its_fate() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let (mesh, mut params) = (block(), quick());
    params.candidates.strategies = vec![Strategy::Ellipsoid, Strategy::Targeted];
    let outcome = planned_in_cell(&mesh, &cell, &params);
    let (plan, listing) = (&outcome.plan, listing(&outcome, &mesh));
    let ids: Vec<u32> = listing.candidates.iter().map(|candidate| candidate.id).collect();
    assert_eq!(ids, (0..plan.candidates.generated as u32).collect::<Vec<_>>());
    let of_fate = |fate: &str| listing.candidates.iter().filter(|candidate| candidate.fate == fate).count();
    assert_eq!(of_fate("chosen") + of_fate("no_path") + of_fate("not_chosen"), plan.candidates.kept);
    assert_eq!(of_fate("chosen"), plan.views.iter().filter(|view| view.rejected.is_none()).count());
    for (reason, count) in &plan.candidates.rejected {
        let dropped: Vec<_> =
            listing.candidates.iter().filter(|candidate| candidate.dropped_because.as_deref() == Some(reason.as_str())).collect();
        assert_eq!(dropped.len(), *count, "{reason:?}");
        assert!(dropped.iter().all(|candidate| candidate.fate == "dropped" && candidate.viewpoint.is_none()));
        let known = ["unreachable", "collision", "measures_nothing", "not_needed"].contains(&reason.as_str());
        assert!(dropped.iter().all(|candidate| candidate.measured_area_mm2.is_some() == known), "{reason:?}");
    }
    for view in &plan.views {
        let candidate = &listing.candidates[view.candidate.index()];
        assert!(
            (candidate.part_from_scanner.pose::<Part, ScannerFrame>().origin_mm() - view.part_from_scanner.origin_mm()).norm()
                < 1e-9
        );
        assert_eq!(candidate.label, view.label.as_str());
    }
    assert_eq!(listing.setups.len(), 1);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_listing_is_made_where_asked_for_and_changes_no_plan() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let mesh = block();
    for objective in [Objective::Score, Objective::Coverage] {
        let [with, without] = [true, false].map(|asked| {
            let mut params = quick();
            (params.output.candidates, params.selection.objective) = (asked, objective);
            params.candidates.strategies = vec![Strategy::Ellipsoid, Strategy::Targeted];
            planned_in_cell(&mesh, &cell, &params)
        });
        assert!(without.candidates.is_none() && bytes(&without, &mesh).is_none());
        assert_eq!((&with.plan.coverage, &with.plan.candidates), (&without.plan.coverage, &without.plan.candidates));
        let views = |outcome: &Outcome| {
            let of_view = |view: &vantage::planning::plan::PlannedView| (view.part_from_scanner, view.score, view.station);
            outcome.plan.views.iter().map(of_view).collect::<Vec<_>>()
        };
        assert_eq!(views(&with), views(&without));
        // Without a quality in the matrix of the selection the listing has it all the same.
        let listing = listing(&with, &mesh);
        assert!(listing.candidates.iter().any(|candidate| candidate.fate == "chosen" && !candidate.quality.is_empty()));
    }
}
