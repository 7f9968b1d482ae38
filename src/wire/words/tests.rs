use super::{
    ChoiceRules, PlanRules, RESCAN_WITHOUT_PATH, WITHOUT_PATH, advice_sentence, apart_mm, area_mm2, at_risk_sentence,
    by_thousands, changed_params, first_lie, fix_sentence, fixed, fixed_nonzero, headline, independent_share, lie_phrase,
    limits_mm, no_plan_sentence, percent, percent_below, percent_to, percents_apart, region_verdict, rounded_to,
    stability_sentence, turn_phrase,
};
use crate::cell::PoseSpec;
use crate::geometry::Pose;
use crate::planning::context::NoPlan;
use crate::planning::ids::CandidateId;
use crate::planning::params::{PlanParams, Region, SelectionGoal};
use crate::planning::plan::{
    Advice, CandidateCounts, Cause, Coverage, IndependentRegion, PartSide, RegionCoverage, RegionKind, Remedy, RemedyKind,
    RemedyView, StopReason, Turn, TurnKind,
};
use crate::planning::verdict::Rejection;
use crate::wire::plan::{AtRiskDocument, CoverageDocument, RegionCoverageDocument, RiskReasonDocument, StabilityDocument};

#[test]
fn zero_has_no_sign() {
    assert_eq!(
        (fixed(-0.04, 1), fixed(-0.06, 1), fixed(0.0, 0), fixed(-0.4, 0)),
        ("0.0".into(), "-0.1".into(), "0".into(), "0".into())
    );
}

/// A table angle of 1e308 had 309 digits.
#[test]
fn a_number_of_more_digits_than_anything_has_is_told_with_a_power_of_ten() {
    for (value, told) in [
        (999_999_999.0, "999999999.0"),
        (1e9, "1e9"),
        (-1_234_567_890_123.0, "-1.23457e12"),
        (1e308, "1e308"),
        (f64::INFINITY, "inf"),
    ] {
        assert_eq!(fixed(value, 1), told);
    }
    assert_eq!((fixed_nonzero(2.5e20, 2), by_thousands(&fixed(-2e12, 0))), ("2.5e20".to_owned(), "−2e12".to_owned()));
    assert_eq!((area_mm2(12_345_678.9), area_mm2(1.5e300)), ("12\u{202f}345\u{202f}678.9".to_owned(), "1.5e300".to_owned()));
}

/// The examples of [`region_verdict`] and [`independent_share`].
#[test]
fn a_share_on_400_samples_is_told_with_its_standard_error() {
    let region = |measured: usize| {
        let independent =
            IndependentRegion { samples: 400, asked_area_mm2: 400.0, measured_area_mm2: measured as f64, squares_mm4: 400.0 };
        RegionCoverageDocument::from(&RegionCoverage {
            name: "seat".to_owned(),
            kind: RegionKind::Interest,
            samples: 100,
            asked_area_mm2: 20.0,
            coverable_area_mm2: 20.0,
            measured_area_mm2: 19.2,
            target: Some(0.95),
            tolerance_mm: None,
            min_tolerance_mm: 0.156,
            missed_mm2: Vec::new(),
            beyond_noise_area_mm2: 0.0,
            independent: Some(independent),
        })
    };
    assert_eq!(region_verdict(&region(384)), "target 95.00 %: met (independent 96.00 %, standard error 0.99 points)");
    assert_eq!(independent_share(&region(375)).as_deref(), Some("93.75 %, standard error 1.22 points"));
}

#[test]
fn a_rounded_number_has_no_digits_of_radians_and_no_sign_of_zero() {
    let told = [89.999_999_999_9, -0.000_000_1, 0.123_456_7].map(|value| rounded_to(value, 6).to_string());
    assert_eq!(told, ["90", "0", "0.123457"]);
}

#[test]
fn what_is_not_zero_is_not_told_as_zero() {
    for (value, decimals, told) in [
        (0.0, 1, "0.0"),
        (-0.0, 1, "0.0"),
        (0.031, 1, "0.031"),
        (-0.031, 1, "-0.031"),
        (0.06, 1, "0.1"),
        (1e-20, 1, "0.000000000000"),
    ] {
        assert_eq!(fixed_nonzero(value, decimals), told);
    }
    for (share, told) in
        [(0.0, "0.00"), (-1e-17, "0.00"), (1e-12, "0.00"), (0.000_042, "0.0042"), (0.000_06, "0.01"), (0.999_96, "99.99")]
    {
        assert_eq!(percent_below(share, 1.0, 2), told);
    }
    assert_eq!((percent_below(0.003, 1.0, 0), percent_below(0.997, 1.0, 0)), ("0.30".to_owned(), "99".to_owned()));
    assert_eq!((percent(0.999_96), percent_to(0.996, 0)), ("99.99 %".to_owned(), "99 %".to_owned()));
    let stability = StabilityDocument {
        shared_area_mm2: 50_800.0,
        fixed: true,
        resistance: 0.000_4,
        weakest: "every motion".to_owned(),
        expected_error_mm: Some(0.000_031),
    };
    let told = stability_sentence(&stability);
    assert!(
        told.ends_with(
            "resistance 0.00040 (at least 0.01 needed), expected error at least 0.031 µm (1 σ, from independent noise alone, without \
             errors of calibration and hand-eye)"
        ),
        "{told}"
    );
    let reason = RiskReasonDocument { reason: "frame_margin".to_owned(), area_mm2: 0.5, of_visible: 0.000_05 - 1e-6 };
    let at_risk = AtRiskDocument { area_mm2: 0.5, of_asked: 0.1, of_visible: 0.1, counted: true, reasons: vec![reason] };
    assert!(at_risk_sentence(&at_risk).ends_with("counted as measured: frame margin 0.0049 %"), "{}", at_risk_sentence(&at_risk));
}

#[test]
fn two_shares_that_differ_are_told_apart() {
    let told = |from: f64, to: f64| percents_apart([from, to]).join(" → ");
    assert_eq!(told(0.701, 0.979), "70.1 → 97.9");
    assert_eq!(told(0.504_1, 0.504_3), "50.41 → 50.43");
    assert_eq!(told(0.999_1, 0.999_6), "99.91 → 99.96", "below the whole");
    assert_eq!((told(0.504, 0.504), told(0.504, 0.504 + 1e-12)), ("50.4 → 50.4".to_owned(), "50.4 → 50.4".to_owned()));
}

#[test]
fn an_area_has_three_digits_at_least_and_a_space_between_thousands() {
    for (mm2, told) in [
        (0.0, "0.0"),
        (1e-14, "0.0"),
        (0.012_34, "0.0123"),
        (8.5, "8.50"),
        (999.96, "1\u{202f}000.0"),
        (2400.0, "2\u{202f}400.0"),
        (1_234_567.89, "1\u{202f}234\u{202f}567.9"),
    ] {
        assert_eq!(area_mm2(mm2), told);
    }
    let large = Remedy { area_mm2: 50_800.0, ..tilt(1.0) };
    assert_eq!(fix_sentence(&large, at_target()), "tilt candidate 7 by 20°: measures 50\u{202f}800.0 mm², 100 % of it");
}

#[test]
fn no_plan_names_what_became_of_candidates_and_the_largest_causes() {
    let missed_mm2 = vec![(Cause::Depth, 50.0), (Cause::Facing, 30.0), (Cause::ShadowLeft, 15.4), (Cause::Unreachable, 4.6)];
    let rejected = [(Rejection::Unreachable, 7), (Rejection::BelowTable, 20)].into();
    let candidates = CandidateCounts { generated: 30, kept: 3, rejected };
    let nothing_measured = |candidates, asked_mm2, missed_mm2| NoPlan::NothingMeasured {
        candidates,
        asked_mm2,
        missed_mm2,
        obstructions: Vec::new(),
        setups: Vec::new(),
    };
    assert_eq!(
        no_plan_sentence(&nothing_measured(candidates, 100.0, missed_mm2)),
        "3 of 30 candidates can be used (dropped: below the plate 20, out of the robot's reach 7), but none measures enough \
         to be worth a view; area missed by cause: outside the working depth (50 %), faces away (30 %), hidden from the left camera (15 %)"
    );
    let candidates = CandidateCounts { generated: 300, kept: 0, rejected: [(Rejection::MeasuresNothing, 300)].into() };
    assert_eq!(
        no_plan_sentence(&nothing_measured(candidates, 9.0, vec![(Cause::Facing, 9.0)])),
        "none of 300 candidates is usable (dropped: measures nothing that is asked for 300); area missed by cause: faces away \
         (100 %)"
    );
    assert_eq!(
        no_plan_sentence(&nothing_measured(CandidateCounts::default(), 9.0, vec![(Cause::Facing, 9.0)])),
        "no candidate was proposed; check that the part lies within the robot's reach, or propose candidates by other \
         candidates.strategies",
        "no view was there for the surface to face away from"
    );
    let candidates = CandidateCounts { generated: 2, kept: 2, ..CandidateCounts::default() };
    assert_eq!(
        no_plan_sentence(&nothing_measured(candidates, 9.0, vec![(Cause::Facing, 9.0)])),
        "2 of 2 candidates can be used, but none measures enough to be worth a view; area missed by cause: faces away (100 %)"
    );
    assert_eq!(no_plan_sentence(&NoPlan::NothingInStudy), "no candidate measures anything; check the part's unit and size");
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

/// The finding that none of 30 views helps.
fn no_remedy() -> Remedy {
    Remedy {
        kind: RemedyKind::None,
        views: Vec::new(),
        table_from_part: None,
        turn: None,
        camera_deg: None,
        projector_deg: None,
        area_mm2: 0.0,
        of_spot: 0.0,
        tried: 30,
    }
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
    Remedy { kind: RemedyKind::Tilt, views: vec![view], area_mm2, of_spot, ..no_remedy() }
}

#[test]
fn a_remedy_works_from_nine_tenths_on_and_else_says_its_share_first() {
    for (of_spot, said) in [
        (1.0, "tilt candidate 7 by 20°: measures 200.0 mm², 100 % of it"),
        (0.9, "tilt candidate 7 by 20°: measures 180.0 mm², 90 % of it"),
        (0.75, "only 75 % of it, 150.0 mm²: tilt candidate 7 by 20°"),
        (0.899, "only 89 % of it, 179.8 mm²: tilt candidate 7 by 20°"),
    ] {
        assert_eq!(fix_sentence(&tilt(of_spot), at_target()), said);
    }
    let mut none = tilt(0.0);
    (none.kind, none.views) = (RemedyKind::None, Vec::new());
    let told = "no fix found (30 views tried; up to 8 of them together see less than half of it)";
    assert_eq!(fix_sentence(&none, at_target()), told);
}

/// Rules of a plan without `max_views` that ended at its target.
fn at_target() -> ChoiceRules {
    ended_by(StopReason::Target, SelectionGoal::FewestViews, None)
}

fn ended_by(ended_by: StopReason, goal: SelectionGoal, views_left: Option<usize>) -> ChoiceRules {
    ended_with(ended_by, goal, views_left, [true; 2])
}

fn ended_with(
    ended_by: StopReason,
    goal: SelectionGoal,
    views_left: Option<usize>,
    [is_priced, must_overlap]: [bool; 2],
) -> ChoiceRules {
    ChoiceRules::Plan(PlanRules { goal, ended_by, views_left, min_gain_mm2: 0.0, is_priced, must_overlap })
}

/// Tells the change with which a view that a plan has as a candidate is chosen.
fn change(rules: ChoiceRules) -> String {
    let told = fix_sentence(&Remedy { kind: RemedyKind::View, ..tilt(1.0) }, rules);
    told.strip_suffix(" so that candidate 7 is chosen too: measures 200.0 mm², 100 % of it").expect(&told).to_owned()
}

/// "raise selection.target or selection.max_views, or lower selection.min_growth" was told of a plan without `max_views` that
/// ended at its target.
#[test]
fn a_view_that_was_not_chosen_is_had_by_the_rule_that_ended_the_choice() {
    for goal in [SelectionGoal::FewestViews, SelectionGoal::MinTime] {
        for (stop, told) in [
            (StopReason::Target, "raise selection.target"),
            (StopReason::RegionsUnmet, "raise selection.target"),
            (StopReason::MaxViews, "raise selection.max_views"),
            (StopReason::Growth, "lower selection.min_growth"),
            (StopReason::NoGain, "lower selection.view_cost_mm2_per_s, or ask for less shared surface (selection.overlap),"),
        ] {
            assert_eq!(change(ended_by(stop, goal, None)), told, "{stop:?}");
            assert_eq!(change(ended_by(stop, goal, Some(1))), told, "{stop:?} with a view to spare");
        }
        let full = change(ended_by(StopReason::Target, goal, Some(0)));
        assert_eq!(full, "raise selection.target and raise selection.max_views");
    }
    let (goal, min_gain_mm2) = (SelectionGoal::FewestViews, 1e4);
    let (ended_by, views_left, is_priced, must_overlap) = (StopReason::Target, None, false, false);
    let rules = ChoiceRules::Plan(PlanRules { goal, ended_by, views_left, min_gain_mm2, is_priced, must_overlap });
    assert_eq!(change(rules), "raise selection.target and lower selection.min_growth");
    // A lower cost was advised where it was 0, and less shared surface where none was asked for.
    for (asks, told) in [
        ([true, false], "lower selection.view_cost_mm2_per_s"),
        ([false, true], "ask for less shared surface (selection.overlap)"),
        ([false, false], "choose views on more samples (part.samples_per_mm2)"),
    ] {
        assert_eq!(change(ended_with(StopReason::NoGain, goal, None, asks)), told);
    }
}

/// Raising the target was advised where the goal ignores it.
#[test]
fn a_target_is_not_advised_where_the_goal_is_the_best_coverage() {
    let best = |stop: StopReason, views_left: usize| change(ended_by(stop, SelectionGoal::BestCoverage, Some(views_left)));
    assert_eq!(best(StopReason::MaxViews, 0), "raise selection.max_views");
    assert_eq!(best(StopReason::Growth, 2), "lower selection.min_growth");
    for stop in StopReason::ALL.into_iter().filter(|stop| *stop != StopReason::NoPath) {
        assert!(!best(stop, 0).is_empty() && !best(stop, 0).contains("selection.target"), "{}", best(stop, 0));
    }
}

/// "Raise selection.target so that candidate 523 is chosen too: measures 73 % of it" was told where 18 of 86 views had no path.
#[test]
fn where_views_without_a_path_were_left_out_no_rule_is_told_to_mend_that() {
    for goal in [SelectionGoal::FewestViews, SelectionGoal::MinTime, SelectionGoal::BestCoverage] {
        for of_spot in [0.73, 1.0] {
            let view = Remedy { kind: RemedyKind::View, ..tilt(of_spot) };
            let told = fix_sentence(&view, ended_by(StopReason::NoPath, goal, Some(0)));
            assert_eq!(told, WITHOUT_PATH);
        }
    }
    let begins = "views to which no collision-free path was found were left out; more views (selection.target, ";
    assert!(WITHOUT_PATH.starts_with(begins) && !WITHOUT_PATH.contains('%'), "it promises no figure: {WITHOUT_PATH}");
    let tilted = fix_sentence(&tilt(1.0), ended_by(StopReason::NoPath, SelectionGoal::FewestViews, None));
    assert_eq!(tilted, "tilt candidate 7 by 20°: measures 200.0 mm², 100 % of it", "a path leads to a view that was tried");
}

#[test]
fn a_share_up_to_an_incidence_says_which_ray_the_angle_is_to() {
    let coverage = CoverageDocument::from(&Coverage::default());
    for figure in headline(&coverage).iter().filter(|figure| figure.name.starts_with("within ")) {
        assert!(figure.meaning.ends_with("the ray to the origin of the scanner frame"), "{}", figure.meaning);
    }
}

/// A rescan was told to raise `selection.max_views`, which it does not take: its own rules choose the views.
#[test]
fn a_view_that_a_rescan_did_not_choose_is_had_by_the_rules_of_the_rescan() {
    let told = |stop| change(ChoiceRules::Rescan(stop));
    assert_eq!(told(StopReason::MaxViews), "raise max_views of the rescan");
    assert_eq!(told(StopReason::Growth), "lower min_gain of the rescan");
    let at_target = "plan the part again with a higher selection.target, at which the rescan ends,";
    assert_eq!(told(StopReason::Target), at_target);
    for stop in StopReason::ALL.into_iter().filter(|stop| *stop != StopReason::NoPath) {
        assert!(!told(stop).contains("selection.max_views") && !told(stop).contains("min_growth"), "{stop:?}");
    }
}

/// "raise max_views of the rescan, or lower its min_gain, so that candidate 7 is chosen too" was told where views had no path.
#[test]
fn where_a_rescan_left_out_views_without_a_path_none_of_its_rules_is_told_to_mend_that() {
    let rules = ChoiceRules::Rescan(StopReason::NoPath);
    assert!(rules.left_out_views() && !ChoiceRules::Rescan(StopReason::Target).left_out_views());
    for of_spot in [0.73, 1.0] {
        assert_eq!(fix_sentence(&Remedy { kind: RemedyKind::View, ..tilt(of_spot) }, rules), RESCAN_WITHOUT_PATH);
    }
    let [of_plan, of_rescan] = [WITHOUT_PATH, RESCAN_WITHOUT_PATH].map(|told| told.split_once("; ").expect("a remedy"));
    assert_eq!(of_plan.0, of_rescan.0, "the same is found");
    let ends = "and a smaller motion.clearance_mm may free a path";
    assert!(
        of_plan.1.ends_with(ends) && of_rescan.1.ends_with(ends) && of_rescan.1.starts_with("plan the part again: "),
        "{}",
        of_rescan.1
    );
    for of_no_use in ["max_views", "min_gain", "min_growth", "%"] {
        assert!(!RESCAN_WITHOUT_PATH.contains(of_no_use), "{of_no_use} mends nothing: {RESCAN_WITHOUT_PATH}");
    }
}

/// "(min gain)" was told, which no option is called.
#[test]
fn a_rescan_without_a_view_says_which_of_its_rules_ended_it() {
    let told = |rule| {
        no_plan_sentence(&NoPlan::NoFurtherView {
            measured_of_asked: 0.6752,
            left_of_asked: 0.0347,
            hopeless_of_asked: 0.0,
            rule,
        })
    };
    let min_gain =
        "no further view is worth taking (the best view is expected to add less than min_gain of the rescan): 67.52 % of";
    assert!(told("min_gain").starts_with(min_gain), "{}", told("min_gain"));
    for (rule, option) in [("max_rounds", "max_rounds"), ("little_left", "min_left"), ("target", "target of the plan")] {
        assert!(told(rule).contains(option), "{}", told(rule));
    }
}

/// 4.96 mm were told as 5.0 mm apart, which is the clearance that they miss.
#[test]
fn a_distance_below_a_clearance_is_not_rounded_up_to_it() {
    assert_eq!([4.96, 5.0, 0.99, 0.0].map(apart_mm), ["4.9", "5.0", "0.9", "0.0"]);
    assert_eq!([0.031, -0.031, -2.34].map(apart_mm), ["0.031", "-0.031", "-2.3"]);
    assert_eq!([0.0996, 0.0099, 0.000_057].map(apart_mm), ["0.099", "0.0099", "0.000057"], "0.0996 mm were told as 0.1 mm");
    let advice = advice_sentence(&Advice::ReduceClearance(4.96));
    assert_eq!(advice, "collision-free there with --set motion.clearance_mm=4.9", "a clearance that the distance keeps");
}

#[test]
fn turns_are_told_in_an_operator_s_words() {
    let turn = |kind, side, deg: f64| Turn { kind, side, angle_rad: deg.to_radians() };
    for (turn, asked, lies) in [
        (turn(TurnKind::None, PartSide::Right, 0.0), "leave it as it lies", "on the same side as in setup 1"),
        (turn(TurnKind::UpsideDown, PartSide::Back, 180.0), "turn it upside down", "upside down"),
        (turn(TurnKind::OnSide, PartSide::Right, 90.0), "stand it on its right side", "on its right side"),
        (turn(TurnKind::OnSide, PartSide::Back, 90.0), "stand it on its back", "on its back"),
        (turn(TurnKind::OnSide, PartSide::Left, 88.0), "stand it on its left side", "on its left side"),
        (turn(TurnKind::OnSide, PartSide::Front, 90.0), "stand it on its front", "on its front"),
        (
            turn(TurnKind::Tilt, PartSide::Left, 35.2),
            "tilt it by 35° towards its left side",
            "tilted by 35° towards its left side",
        ),
    ] {
        assert_eq!((turn_phrase(&turn).as_str(), lie_phrase(&turn).as_str()), (asked, lies));
    }
}

/// A plan in two setups that leaves the pose of the job was told to begin "as placed".
#[test]
fn the_first_setup_is_told_against_the_pose_of_the_job() {
    let turned = |deg: f64| {
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), deg.to_radians());
        Pose::from_parts(nalgebra::Vector3::new(1.0, 2.0, 3.0), turn)
    };
    assert_eq!((first_lie(None, &turned(0.0)), first_lie(Some(&PoseSpec::from(&turned(90.0))), &turned(90.0))), (None, None));
    let over = "upside down relative to its placement (part.table_from_part)";
    assert_eq!(first_lie(None, &turned(180.0)).as_deref(), Some(over));
}

#[test]
fn a_part_is_turned_over_in_words_and_not_by_a_direction() {
    let turn = Some(Turn { kind: TurnKind::UpsideDown, side: PartSide::Right, angle_rad: 3.1 });
    let over = Remedy { kind: RemedyKind::Setup, turn, ..tilt(1.0) };
    assert_eq!(fix_sentence(&over, at_target()), "turn it upside down and scan again: measures 200.0 mm², 100 % of it");
}

/// Widths of zones were told as "tolerance", which users read as ±; and 0.0014 mm were told as 0.001 mm.
#[test]
fn a_tolerance_is_told_by_its_limits_and_not_rounded_to_another_one() {
    assert_eq!([0.001, 0.2, 0.1 + 0.2, 100.0].map(limits_mm), ["±0.0005", "±0.100", "±0.150", "±50.000"]);
    assert_eq!([0.0014, 0.0005 * 25.4, 0.0625, 1.0 / 3.0].map(limits_mm), ["±0.0007", "±0.00635", "±0.03125", "±0.166667"]);
}
