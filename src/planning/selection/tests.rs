use std::sync::atomic::AtomicBool;

use super::*;
use crate::planning::context::Silent;
use crate::planning::params::Objective;

fn row(samples: &[u32], quality: f32) -> Row {
    Row { samples: samples.to_vec(), quality: vec![quality; samples.len()] }
}

fn chosen(rows: &[Row], params: &SelectionParams, score: &ScoreParams) -> Selection {
    let area = vec![1.0; 10];
    let problem = Problem { rows: rows.iter().collect(), asked_area_mm2: &area, total_mm2: 10.0 };
    select(&problem, params, score, &Context::new(&AtomicBool::new(false), &Silent)).unwrap_or_else(|_| unreachable!())
}

fn coverage() -> SelectionParams {
    SelectionParams { objective: Objective::Coverage, target: 1.0, ..SelectionParams::default() }
}

fn rows_of(selection: &Selection) -> Vec<usize> {
    selection.choices.iter().map(|choice| choice.row).collect()
}

#[test]
fn takes_the_largest_gain_and_counts_only_what_is_new() {
    let rows = [row(&[0, 1, 2], 0.0), row(&[2, 3, 4, 5], 0.0), row(&[6], 0.0)];
    let selection = chosen(&rows, &coverage(), &ScoreParams::default());
    assert_eq!(rows_of(&selection), [1, 0, 2]);
    assert_eq!(selection.choices.iter().map(|c| c.gain_mm2).collect::<Vec<_>>(), [4.0, 2.0, 1.0]);
    assert_eq!(selection.stopped_because, StopReason::Target);
}

#[test]
fn equal_scores_go_to_the_lower_candidate() {
    let rows = [row(&[0, 1], 0.0), row(&[2, 3], 0.0), row(&[0, 3], 0.0)];
    assert_eq!(rows_of(&chosen(&rows, &coverage(), &ScoreParams::default())), [0, 1]);
}

#[test]
fn the_score_prefers_quality_and_refuses_what_is_worthless() {
    let rows = [row(&[0, 1, 2], -0.5), row(&[0, 1], 1.0), row(&[3, 4], -1.0)];
    let params = SelectionParams { target: 1.0, ..SelectionParams::default() };
    let selection = chosen(&rows, &params, &ScoreParams::default());
    assert_eq!(rows_of(&selection), [1, 0]);
    assert!((selection.choices[0].score - 2.0).abs() < 1e-12);
    assert_eq!(selection.stopped_because, StopReason::NoGain);
}

#[test]
fn growth_and_view_limits_end_it() {
    let rows = [row(&[0, 1, 2, 3], 0.0), row(&[4], 0.0)];
    let growth = SelectionParams { min_growth: 0.2, ..coverage() };
    assert_eq!(chosen(&rows, &growth, &ScoreParams::default()).stopped_because, StopReason::Growth);
    let limited = SelectionParams { max_views: Some(1), ..coverage() };
    let selection = chosen(&rows, &limited, &ScoreParams::default());
    assert_eq!((selection.choices.len(), selection.stopped_because), (1, StopReason::MaxViews));
}

#[test]
fn each_denominator_gives_its_own_target() {
    let rows = [row(&[0, 1, 2, 3], 0.0), row(&[4, 5], 0.0)];
    let views = |target_of, target| chosen(&rows, &SelectionParams { target_of, target, ..coverage() }, &ScoreParams::default());
    assert_eq!(views(TargetOf::Coverable, 0.6).choices.len(), 1);
    assert_eq!(views(TargetOf::Asked, 0.6).choices.len(), 2);
    assert_eq!(views(TargetOf::Total, 0.7).stopped_because, StopReason::NoGain);
}
