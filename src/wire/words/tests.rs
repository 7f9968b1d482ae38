use super::{changed_params, fixed, no_plan_sentence, remedy_sentence};
use crate::geometry::Pose;
use crate::planning::context::NoPlan;
use crate::planning::ids::CandidateId;
use crate::planning::params::{PlanParams, Region};
use crate::planning::plan::{CandidateCounts, Cause, Remedy, RemedyKind, RemedyView};
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

/// A tilted view that measures so much of a spot of 200 mm².
fn tilt(of_spot: f64) -> Remedy {
    let area_mm2 = 200.0 * of_spot;
    let view = RemedyView {
        candidate: CandidateId(7),
        roll_rad: 0.0,
        tilt_rad: 20_f64.to_radians(),
        standoff_mm: 480.0,
        part_from_scanner: Pose::identity(),
        area_mm2,
    };
    let (table_from_part, camera_deg, projector_deg, tried) = (None, None, None, 30);
    Remedy { kind: RemedyKind::Tilt, views: vec![view], table_from_part, camera_deg, projector_deg, area_mm2, of_spot, tried }
}

#[test]
fn a_remedy_works_from_nine_tenths_on_and_else_says_its_share_first() {
    for (of_spot, said) in [
        (1.0, "tilt candidate 7 by 20°: measures 200.0 mm², 100 % of it"),
        (0.9, "tilt candidate 7 by 20°: measures 180.0 mm², 90 % of it"),
        (0.75, "only 75 % of it, 150.0 mm²: tilt candidate 7 by 20°"),
        (0.899, "only 89 % of it, 179.8 mm²: tilt candidate 7 by 20°"),
    ] {
        assert_eq!(remedy_sentence(&tilt(of_spot)), said);
    }
    let mut none = tilt(0.0);
    (none.kind, none.views) = (RemedyKind::None, Vec::new());
    assert_eq!(remedy_sentence(&none), "none: no eight of 30 views tried measure half of it");
}
