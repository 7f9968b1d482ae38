use std::sync::atomic::AtomicBool;

use utoipa::PartialSchema;
use utoipa::openapi::{RefOr, Schema};

use super::*;
use crate::planning::context::Silent;
use crate::planning::ids::SampleId;
use crate::planning::params::{CandidateParams, Engine};
use crate::planning::visibility::Row;
use crate::testing::{nominal_scanner, trough};

/// Few samples and directions, so that a study takes a second.
fn coarse() -> PlanParams {
    let candidates = CandidateParams {
        even_directions: Some(20),
        facet_normals: 20,
        surface_points: 20,
        volume_points: 20,
        iterative_rounds: 1,
        iterative_views: 10,
        targeted_max: 10,
        ..CandidateParams::default()
    };
    let mut params = PlanParams { candidates, ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.01), Some(20.0));
    params.visibility.engine = Engine::Rays;
    params
}

fn found(study: Study, params: &PlanParams) -> Result<StudyResult, PlanError> {
    let (mesh, scanner) = (trough(), nominal_scanner());
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    run(study, &input, params, 12, &Context::new(&AtomicBool::new(false), &Silent))
}

#[test]
fn every_strategy_that_files_may_name_is_studied() {
    let RefOr::T(Schema::Object(schema)) = Strategy::schema() else { panic!("an enum of names") };
    let names: Vec<_> = schema.enum_values.expect("names");
    let all: Vec<_> = Strategy::ALL.iter().map(|strategy| serde_json::json!(strategy.as_str())).collect();
    assert_eq!(names, all);
    for strategy in Strategy::ALL {
        assert_eq!(serde_json::to_value(strategy).expect("a name"), strategy.as_str());
    }
}

#[test]
fn less_weight_on_area_gives_better_grades_of_the_same_table() {
    let findings = found(Study::Weights, &coarse()).expect("findings");
    let series = &findings.series;
    assert_eq!(
        series.iter().map(|series| series.label.as_str()).collect::<Vec<_>>()[..2],
        ["a = 1.00, b = 0.00", "a = 0.75, b = 0.25"]
    );
    assert_eq!(series.len(), 5);
    for one in series {
        assert_eq!((one.coverable_of_asked, one.candidates), (series[0].coverable_of_asked, series[0].candidates));
        for step in &one.steps {
            assert!((step.grades.iter().sum::<f64>() - step.of_asked).abs() < 1e-12, "{step:?}");
        }
        assert!(one.steps.windows(2).all(|pair| pair[0].of_asked <= pair[1].of_asked));
    }
    assert!(series[3].after(4).grades[0] > series[0].after(4).grades[0], "{series:#?}");
    assert!(series[3].after(4).of_asked < series[0].after(4).of_asked, "{series:#?}");
}

#[test]
fn narrower_limits_leave_less_to_cover() {
    let findings = found(Study::Limits, &coarse()).expect("findings");
    let coverable: Vec<f64> = findings.series.iter().map(|series| series.coverable_of_asked).collect();
    assert!(coverable.windows(2).all(|pair| pair[0] >= pair[1]) && coverable[0] > coverable[4] + 0.05, "{coverable:?}");
    assert_eq!(findings.series[1].settings, [("limits.camera_deg", "75".into()), ("limits.projector_deg", "67.5".into())]);
}

#[test]
fn each_strategy_stands_alone_and_what_needs_a_cell_is_left_out_with_the_reason() {
    let findings = found(Study::Candidates, &coarse()).expect("findings");
    let labels: Vec<&str> = findings.series.iter().map(|series| series.label.as_str()).collect();
    assert_eq!(labels.len() + findings.skipped.len(), Strategy::ALL.len() + 1);
    assert_eq!(labels.last(), Some(&"even + targeted"));
    assert!(findings.skipped.iter().any(|(label, reason)| label == "reach" && reason.contains("cell")), "{:?}", findings.skipped);
}

#[test]
fn what_nothing_can_use_is_an_error() {
    let mut params = coarse();
    params.part.samples_per_mm2 = Some(1e9);
    assert!(matches!(found(Study::Limits, &params), Err(PlanError::BadParams(_))), "out of range");
    params.part.samples_per_mm2 = Some(1000.0);
    assert!(matches!(found(Study::Limits, &params), Err(PlanError::BadParams(_))), "too many samples for every limit");
    params = coarse();
    params.candidates.standoffs_mm = vec![500.0];
    assert!(matches!(found(Study::Weights, &params), Err(PlanError::NoPlan(NoPlan::NothingInStudy))), "nothing is in depth");
}

#[test]
fn steps_hold_each_sample_at_its_best_grade_so_far() {
    let graded = [&[(0, -0.8), (1, 0.2)][..], &[(0, 0.9)], &[(0, 0.1)]];
    let rows = graded.map(|graded| Row::from_samples(3, graded.iter().map(|(sample, quality)| (SampleId(*sample), *quality))));
    let steps = steps::steps(&rows, &[1.0, 2.0, 1.0], 3.0, 8.0);
    assert_eq!(steps.iter().map(|step| step.of_asked).collect::<Vec<_>>(), [0.75; 3]);
    assert_eq!((steps[0].of_coverable, steps[0].of_total), (1.0, 0.375));
    assert_eq!([steps[0].grades, steps[1].grades], [[0.0, 0.5, 0.0, 0.25], [0.25, 0.5, 0.0, 0.0]]);
    assert_eq!(steps[1], steps[2]);
}

#[test]
fn views_for_an_area_are_counted_from_one() {
    let steps = [0.5, 0.9].map(|of_asked| StudyStep { of_asked, ..StudyStep::default() }).into();
    let series = Series {
        label: String::new(),
        settings: Vec::new(),
        candidates: 2,
        coverable_of_asked: 1.0,
        steps,
        stopped_because: StopReason::Target,
    };
    assert_eq!([0.5, 0.6, 0.91].map(|goal| series.views_for(goal)), [Some(1), Some(2), None]);
    assert_eq!([0, 1, 9].map(|views| series.after(views).of_asked), [0.0, 0.5, 0.9]);
}
