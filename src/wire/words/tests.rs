use super::{changed_params, fixed, no_plan_sentence};
use crate::planning::context::NoPlan;
use crate::planning::params::{PlanParams, Region};
use crate::planning::plan::{CandidateCounts, Cause};
use crate::planning::verdict::Rejection;

#[test]
fn zero_has_no_sign() {
    assert_eq!(
        (fixed(-0.04, 1), fixed(-0.06, 1), fixed(0.0, 0), fixed(-0.4, 0)),
        ("0.0".into(), "-0.1".into(), "0".into(), "0".into())
    );
}

#[test]
fn no_plan_names_what_became_of_candidates_and_the_largest_causes() {
    let missed_mm2 = vec![(Cause::Depth, 50.0), (Cause::Facing, 30.0), (Cause::ShadowLeft, 15.4), (Cause::Unreachable, 4.6)];
    let rejected = [(Rejection::Unreachable, 7), (Rejection::BelowTable, 20)].into();
    let candidates = CandidateCounts { generated: 30, kept: 3, rejected };
    assert_eq!(
        no_plan_sentence(&NoPlan::NothingMeasured { candidates, asked_mm2: 100.0, missed_mm2 }),
        "of 30 candidates 3 were usable (dropped: below_table 20, unreachable 7), and none measures anything worth a view; \
         causes: depth 50 % of the area, facing 30 % of the area, shadow_left 15 % of the area"
    );
    let candidates = CandidateCounts { generated: 2, kept: 2, ..CandidateCounts::default() };
    assert_eq!(
        no_plan_sentence(&NoPlan::NothingMeasured { candidates, asked_mm2: 9.0, missed_mm2: vec![(Cause::Facing, 9.0)] }),
        "of 2 candidates 2 were usable (dropped: none), and none measures anything worth a view; causes: facing 100 % of the area"
    );
    assert_eq!(no_plan_sentence(&NoPlan::NothingInStudy), "no candidate measures anything; look at the part's unit and size");
}

#[test]
fn only_changed_parameters_are_named() {
    assert_eq!(changed_params(&PlanParams::default()), Vec::<(String, String)>::new());
    let mut params = PlanParams::default();
    params.selection.max_views = Some(7);
    params.part.patch_edge_mm = Some(2.906_123_802_5);
    params.candidates.rolls_deg = vec![0.0, 45.0];
    let changed = [("candidates.rolls_deg", "[0.0,45.0]"), ("part.patch_edge_mm", "2.90612"), ("selection.max_views", "7")];
    assert_eq!(changed_params(&params), changed.map(|(key, value)| (key.to_owned(), value.to_owned())));
}

#[test]
fn long_values_are_cut() {
    let mut params = PlanParams::default();
    params.regions.exclude = vec![Region::Faces { faces: (0..10_000).collect() }];
    let changed = changed_params(&params);
    assert_eq!(changed.len(), 1);
    assert!(changed[0].1.chars().count() == 161 && changed[0].1.ends_with('…'));
}
