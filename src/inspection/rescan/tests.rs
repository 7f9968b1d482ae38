//! Further views for what is missing of a box.

use std::sync::atomic::AtomicBool;

use super::*;
use crate::cell::{Presets, Scanner, SpecLibrary};
use crate::geometry::Mesh;
use crate::planning::context::Silent;
use crate::planning::plan;
use crate::testing::box_mesh;

fn scanner() -> Scanner {
    Presets.scanner("transcan-c-nominal").expect("a preset").build().expect("sound")
}

fn quick_params() -> PlanParams {
    let mut params = PlanParams::default();
    (params.robust.pose_error, params.missed.remedies, params.missed.advice) = (None, 0, false);
    params.part.samples_per_mm2 = Some(0.5);
    params
}

/// The box, its plan, and what is left to check of a rescan after all samples with x above a limit were lost.
fn rescanned(x_mm: f64, hopeless_mm: f64, model: &ReturnModel, params: &RescanParams, rounds: u32) -> (Rescan, SampleSet) {
    let (mesh, scanner): (Mesh, _) = (box_mesh([0.0; 3], [80.0, 50.0, 30.0]), scanner());
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    let outcome = plan(&input, &quick_params(), &ctx).unwrap_or_else(|error| panic!("{error}"));
    let surface = &*outcome.surface;
    let mut measured = SampleSet::none_of(surface.sample_mm.len());
    outcome.measured_by_view.iter().for_each(|row| measured.insert_all(row.measured()));
    let mut lost = SampleSet::none_of(surface.sample_mm.len());
    surface.samples().filter(|sample| surface.sample_mm[sample.index()].x > x_mm).for_each(|sample| lost.insert(sample));
    measured.remove_all(&lost);
    let mut hopeless = SampleSet::none_of(surface.sample_mm.len());
    surface
        .samples()
        .filter(|sample| surface.sample_mm[sample.index()].x > hopeless_mm)
        .for_each(|sample| hopeless.insert(sample));
    let part = RescanInput {
        input: &input,
        params: &outcome.plan.params,
        target_of_mm2: outcome.plan.coverage.whole_mm2(outcome.plan.params.selection.target_of),
        surface,
        measured: &measured,
        hopeless: &hopeless,
        model,
        rounds,
    };
    (rescan(&part, params, &ctx).unwrap_or_else(|error| panic!("{error}")), lost)
}

#[test]
#[ignore = "long: tests/all runs it"]
fn views_are_chosen_for_what_is_missing_and_the_rule_that_ended_them_is_said() {
    let model = ReturnModel::default();
    let (of_end, lost) = rescanned(60.0, 1e3, &model, &RescanParams::default(), 0);
    let outcome = of_end.outcome.as_ref().expect("views");
    let asked = outcome.surface.samples().filter(|sample| outcome.surface.asked[sample.index()]).count();
    let few = outcome.surface.sample_mm.len() / 50;
    assert!(
        (lost.count()..lost.count() + few).contains(&asked),
        "what is lost, and the little that was missed: {asked}, {}",
        lost.count()
    );
    assert!(outcome.plan.views.len() <= 4, "{}", outcome.plan.views.len());
    let gained: f64 = of_end.expected_gain.iter().sum();
    println!("gain {:?}, left {:.4}, {:?}", of_end.expected_gain, of_end.left, of_end.stopped_because);
    assert!(gained <= of_end.left + 1e-9 && gained > 0.9 * of_end.left.min(0.2));
    assert!(of_end.expected_gain.windows(2).all(|pair| pair[1] <= pair[0] + 0.02), "{:?}", of_end.expected_gain);
    assert_eq!(of_end.stopped_because, RescanStop::Target);
    let independent = outcome.plan.coverage.independent.of_asked();
    assert!((independent - outcome.plan.coverage.of_asked()).abs() < 0.1, "other samples ask for the same: {independent}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn each_rule_stops_by_its_own() {
    let model = ReturnModel::default();
    let stop = |x_mm: f64, hopeless_mm: f64, params: &RescanParams, rounds: u32| {
        let (rescan, _) = rescanned(x_mm, hopeless_mm, &model, params, rounds);
        (rescan.stopped_because, rescan.outcome.map_or(0, |outcome| outcome.plan.views.len()))
    };
    let usual = RescanParams::default();
    assert_eq!(stop(1e3, 1e3, &usual, 0), (RescanStop::Target, 0), "nothing was lost");
    assert_eq!(stop(60.0, 1e3, &usual, 2), (RescanStop::MaxRounds, 0));
    assert_eq!(stop(60.0, -1.0, &usual, 0), (RescanStop::NothingMissing, 0), "all that is missing is hopeless");
    assert_eq!(stop(10.0, 1e3, &RescanParams { max_views: 1, ..RescanParams::default() }, 0), (RescanStop::MaxViews, 1));
    assert_eq!(stop(60.0, 1e3, &RescanParams { min_left: 0.9, ..RescanParams::default() }, 0), (RescanStop::LittleLeft, 0));
    assert_eq!(stop(60.0, 1e3, &RescanParams { min_gain: 0.9, ..RescanParams::default() }, 0), (RescanStop::MinGain, 0));
    let bad = RescanParams { max_views: 0, ..RescanParams::default() };
    assert_eq!(bad.check().expect_err("no views")[0].pointer, "/max_views");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_scanner_that_returns_half_is_expected_to_add_half() {
    let half = ReturnModel { easy_rate: 0.5, ..ReturnModel::default() };
    let [(of_all, _), (of_half, _)] = [&ReturnModel::default(), &half]
        .map(|model| rescanned(60.0, 1e3, model, &RescanParams { max_views: 1, ..RescanParams::default() }, 0));
    let share = of_half.expected_gain[0] / of_all.expected_gain[0];
    assert!((share - 0.5).abs() < 1e-6, "{share}");
}

#[test]
fn corners_edges_and_deviations_leave_the_demand_and_angles_do_not() {
    let causes = [LossCause::Grazing, LossCause::Edge, LossCause::Concave, LossCause::Specular, LossCause::PartDeviates];
    let of_samples = causes.into_iter().enumerate().map(|(sample, cause)| (SampleId::at(sample), cause)).collect();
    let left_out = hopeless(&Losses { by_cause: Vec::new(), of_samples }, 64);
    assert_eq!(left_out.iter().map(|sample| sample.index()).collect::<Vec<_>>(), [1, 2, 4]);
}
