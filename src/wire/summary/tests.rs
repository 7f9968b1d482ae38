use nalgebra::{Point3, Vector3};
use serde_json::json;

use super::{MissedGroup, PlanDoubts, PlanLevel, PlanVerdict, ProgramCycle, StandingRemedy, Summary};
use crate::cell::{CalibrationProvenance, Configuration, Contact, Dialect};
use crate::geometry::{Aabb, Pose};
use crate::planning::candidates::Label;
use crate::planning::ids::{CandidateId, SetupId, ViewId};
use crate::planning::params::{
    Corners, FeatureParams, PlanParams, PoseErrorParams, Region, Registration, SelectionGoal, TargetOf,
};
use crate::planning::plan::{
    Advice, AdviceKind, AdvisedSetup, AtRisk, Bound, CandidateCounts, Cause, ChosenOn, Coverage, Drawn, Independent,
    IndependentRegion, MeasuredArea, MissedCause, MissedSpot, Obstruction, ParamChange, PartFacts, PartSide, Plan, PlanAdvice,
    PlannedView, RegionCoverage, RegionKind, Remedy, RemedyKind, RemedyView, Robust, SetupLink, SetupPlan, Stability, StopReason,
    Turn, TurnKind,
};
use crate::planning::sequence::{Leg, Sequence};
use crate::planning::stations::Station;
use crate::wire::plan::CoverageDocument;
use crate::wire::warnings::{FieldWarning, WarningCode};
use crate::wire::words::{RESCAN_WITHOUT_PATH, WITHOUT_PATH, headline};

/// Coverage of 1000 mm² asked for, of which 800 can be measured and so many are.
fn coverage(measured_mm2: f64) -> Coverage {
    let measured = MeasuredArea { area_mm2: measured_mm2, ..MeasuredArea::default() };
    Coverage {
        total_area_mm2: 1000.0,
        asked_area_mm2: 1000.0,
        visible_area_mm2: 900.0,
        coverable_area_mm2: 800.0,
        measured,
        at_risk: AtRisk { is_counted: true, ..AtRisk::default() },
        independent: Independent {
            asked_area_mm2: 1000.0,
            total_area_mm2: 1000.0,
            visible_area_mm2: 900.0,
            measured,
            ..Independent::default()
        },
        ..Coverage::default()
    }
}

fn view(id: u32, rejected: Option<Cause>) -> PlannedView {
    PlannedView {
        id: ViewId(id),
        candidate: CandidateId(id),
        setup: SetupId(0),
        label: Label::Top,
        part_from_scanner: Pose::identity(),
        gain_of_asked: 0.1,
        score: 1.0,
        station: None,
        stance: None,
        rejected,
        exposure: None,
    }
}

/// A plan without a cell of so many views, the last of which have no path.
fn plan(views: u32, without_path: u32, measured_mm2: f64) -> Plan {
    let rejected = |id: u32| (id >= views - without_path).then_some(Cause::NoPath);
    let setup = SetupPlan {
        table_from_part: Pose::identity(),
        views: (0..views).map(ViewId).collect(),
        coverable_area_mm2: 800.0,
        measured_area_mm2: measured_mm2,
        sequence: None,
        weakest_link: None,
    };
    Plan {
        part: PartFacts {
            sha256: String::new(),
            triangles: 12,
            area_mm2: 1000.0,
            aabb: Aabb { min: Point3::origin(), max: Point3::new(1.0, 1.0, 1.0) },
        },
        table_from_part: None,
        params: PlanParams::default(),
        candidates: CandidateCounts::default(),
        coverage: coverage(measured_mm2),
        views: (0..views).map(|id| view(id, rejected(id))).collect(),
        setups: vec![setup],
        setup_links: Vec::new(),
        obstructions: Vec::new(),
        missed: Vec::new(),
        advice: Vec::new(),
        stopped_because: StopReason::Target,
        bound: Bound { views_lower: 2, ..Bound::default() },
        chosen_on: ChosenOn::default(),
    }
}

/// A region with a target of 0.9, of which such a share is measured.
fn region(name: &str, of_asked: f64) -> RegionCoverage {
    RegionCoverage {
        name: name.to_owned(),
        kind: RegionKind::Feature,
        samples: 10,
        asked_area_mm2: 10.0,
        coverable_area_mm2: 10.0,
        measured_area_mm2: 10.0 * of_asked,
        target: Some(0.9),
        tolerance_mm: None,
        min_tolerance_mm: 0.1,
        missed_mm2: Vec::new(),
        beyond_noise_area_mm2: 0.0,
        independent: None,
    }
}

/// A remedy of so many views that measures such a share of a spot of 10 mm².
fn remedy(kind: RemedyKind, of_spot: f64, views: &[u32]) -> Remedy {
    let view = |candidate: &u32| RemedyView {
        candidate: CandidateId(*candidate),
        roll_rad: 0.0,
        tilt_rad: 0.0,
        standoff_mm: 480.0,
        part_from_scanner: Pose::from_parts(
            Vector3::new(f64::from(*candidate), 0.000_4, 0.0),
            nalgebra::UnitQuaternion::identity(),
        ),
        area_mm2: 10.0 * of_spot,
    };
    let turn = Turn { kind: TurnKind::UpsideDown, side: PartSide::Right, angle_rad: std::f64::consts::PI };
    Remedy {
        kind,
        views: views.iter().map(view).collect(),
        table_from_part: None,
        turn: (kind == RemedyKind::Setup).then_some(turn),
        camera_deg: (kind == RemedyKind::Limit).then_some(60.04),
        projector_deg: None,
        area_mm2: 10.0 * of_spot,
        of_spot,
        tried: 830,
    }
}

/// Spots of 10 mm² each, missed for one cause.
fn missed(cause: Cause, remedies: Vec<Option<Remedy>>) -> MissedCause {
    let spot = |remedy: Option<Remedy>| MissedSpot {
        area_mm2: 10.0,
        centre_mm: Point3::origin(),
        extent_mm: Vector3::zeros(),
        source_faces: Vec::new(),
        remedy,
    };
    MissedCause { cause, area_mm2: 10.0 * remedies.len() as f64, spots: remedies.into_iter().map(spot).collect() }
}

fn group_of(plan: &Plan) -> MissedGroup {
    let mut groups = Summary::of(plan).missed;
    assert_eq!(groups.len(), 1, "{groups:?}");
    groups.remove(0)
}

#[test]
fn the_verdict_is_the_first_that_holds() {
    let verdict = |plan: &Plan| (PlanVerdict::of(plan), Summary::of(plan).verdict_text);
    assert_eq!(
        verdict(&plan(3, 0, 792.0)),
        (PlanVerdict::PartlyMeasured, "Target met: 99.00 % of coverable, target 98.50 %".to_owned())
    );
    let without_path = plan(4, 1, 792.0);
    assert_eq!(
        verdict(&without_path),
        (
            PlanVerdict::ViewsWithoutPath,
            "Not every view is executed: no collision-free path leads to 1 of 4 chosen views; 99.00 % of coverable, target 98.50 %"
                .to_owned()
        )
    );
    let mut unmet = without_path.clone();
    unmet.stopped_because = StopReason::RegionsUnmet;
    unmet.coverage.regions = vec![region("bore", 0.5), region("rim", 0.95)];
    assert_eq!(
        verdict(&unmet),
        (
            PlanVerdict::RegionsUnmet,
            "Regions unmet: 1 of 2 regions and features with a target: \"bore\" 50.00 %, target 90.00 %; the part as a whole: 99.00 % \
             of coverable, target 98.50 %"
                .to_owned()
        )
    );
    let mut missed = Plan { stopped_because: StopReason::MaxViews, ..plan(3, 0, 400.0) };
    missed.params.selection.max_views = Some(3);
    missed.coverage.regions = unmet.coverage.regions;
    assert_eq!(
        verdict(&missed),
        (
            PlanVerdict::TargetMissed,
            "Target missed: 50.00 % of coverable, target 98.50 %: the limit of 3 views is reached; regions below their targets: \
             \"bore\" 50.00 %, target 90.00 %"
                .to_owned()
        )
    );
}

/// A target that only the samples of the choice reach was "Ready to scan", and no fault with `--strict`.
#[test]
fn a_region_that_other_samples_refute_counts_as_below_its_target() {
    let mut plan = plan_of_all(990.0);
    // 340 of 400: 85 %, with a standard error of 1.8 points.
    let refuted = IndependentRegion { samples: 400, asked_area_mm2: 10.0, measured_area_mm2: 8.5, squares_mm4: 0.25 };
    let held = IndependentRegion { measured_area_mm2: 8.9, ..refuted };
    let with = |independent: IndependentRegion| RegionCoverage { independent: Some(independent), ..region("seat", 0.93) };
    plan.coverage.regions = vec![with(held)];
    assert_eq!(
        (PlanVerdict::of(&plan), Summary::of(&plan).regions_unmet),
        (PlanVerdict::TargetMet, 0),
        "not confirmed is not refuted"
    );
    plan.coverage.regions.push(with(refuted));
    let summary = Summary::of(&plan);
    assert_eq!((summary.verdict, summary.level, summary.regions_unmet), (PlanVerdict::RegionsUnmet, PlanLevel::Limited, 1));
    assert_eq!(
        summary.verdict_text,
        "Regions unmet: 1 of 2 regions and features with a target: \"seat\" 85.00 % on independent samples, target 90.00 %; the part as \
         a whole: 99.00 % of coverable, target 98.50 %"
    );
}

/// Both reports and the command line said "Ready to scan" of a part on its edge.
#[test]
fn a_part_that_does_not_stand_is_not_ready_and_the_title_says_what_to_do() {
    let ready = Summary::of(&plan_of_all(990.0));
    assert_eq!(ready.clone().with_doubts(&PlanDoubts::default()), ready);
    let tips_over = PlanDoubts { unstable_setups: 1, ..PlanDoubts::default() };
    let tips = ready.clone().with_doubts(&tips_over);
    assert_eq!((tips.level, tips.verdict), (PlanLevel::Limited, PlanVerdict::TargetMet));
    assert!(
        tips.title.starts_with("Not ready to scan: the part does not stand stably as placed and would tip over; "),
        "{}",
        tips.title
    );
    for way in ["part.fixture_mesh", "part.table_from_part", "--up"] {
        assert!(tips.title.contains(way), "{way}: {}", tips.title);
    }
    assert_eq!(tips.lines()[0], tips.title, "before what is measured");
    let mut twice = plan_of_all(990.0);
    twice.setups.push(twice.setups[0].clone());
    let told = Summary::of(&twice).with_doubts(&tips_over).title;
    assert!(told.contains("in 1 of 2 setups") && !told.contains("fixture"), "a fixture holds one setup: {told}");
    // Its size is asked about first, and what no path leads to stays so.
    let doubted = ready.with_doubts(&PlanDoubts { unit_question: Some("Check the unit"), ..tips_over });
    assert_eq!((doubted.title.as_str(), doubted.level), ("Check the unit", PlanLevel::Limited));
    let pathless = Summary::of(&plan(3, 3, 0.0));
    assert_eq!(pathless.clone().with_doubts(&tips_over), pathless);
}

/// One more setup came first for a part that would tip over in the setup that it has.
#[test]
fn a_part_that_would_tip_over_is_placed_so_that_it_stands_before_anything_else() {
    let mut plan = plan_of_all(600.0);
    plan.advice = vec![advice()];
    let tips = Summary::of(&plan);
    let pose = Pose::from_parts(Vector3::new(1.0, 2.000_04, 3.0), nalgebra::UnitQuaternion::identity());
    let up = "-z".parse().expect("an axis");
    let placed = |remedy: &StandingRemedy| tips.clone().with_doubts(&does_not_stand(remedy)).action.expect("an action");
    let action = placed(&StandingRemedy::WithAxisUp(up, pose));
    assert_eq!(action.text, "place the part with its -z axis up, so that it stands (--up -z); effect not estimated");
    assert_eq!(action.command.as_deref(), Some("--up -z"));
    let set = json!({"part.table_from_part": {"translation_mm": [1.0, 2.0, 3.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}});
    assert_eq!(json!(action.set), set, "the same, for programs");
    assert!(action.from_of_asked.total_cmp(&action.to_of_asked).is_eq() && action.added_views == 0, "{action:?}");
    let action = placed(&StandingRemedy::InPose(pose));
    assert!(action.text.starts_with("place the part so that it stands: --set 'part.table_from_part={"), "{}", action.text);
    let action = placed(&StandingRemedy::InPosesOfPlanner);
    let text = "let Vantage choose setups in which the part stands: --set 'part.resting_poses=[]'; effect not estimated";
    assert_eq!((action.text.as_str(), json!(action.set)), (text, json!({"part.resting_poses": []})));
}

/// Doubt about how a part stands.
fn does_not_stand(remedy: &StandingRemedy) -> PlanDoubts<'_> {
    PlanDoubts { standing: Some(remedy), ..PlanDoubts::default() }
}

/// A plan of a part of which all that is asked is visible and can be measured, and so much of 1000 mm² is.
fn plan_of_all(measured_mm2: f64) -> Plan {
    let mut plan = plan(3, 0, measured_mm2);
    plan.coverage.visible_area_mm2 = 1000.0;
    plan.coverage.coverable_area_mm2 = 1000.0;
    plan.coverage.independent.visible_area_mm2 = 1000.0;
    plan
}

#[test]
fn the_first_line_says_what_is_measured_and_is_ready_only_where_nothing_that_was_asked_is_missing() {
    let first = |plan: &Plan| {
        let summary = Summary::of(plan);
        assert_eq!(summary.lines()[..2], [summary.title.clone(), summary.verdict_text.clone()]);
        (summary.level, summary.verdict, summary.title)
    };
    let measured = "99.00 % of the visible and 99.00 % of the asked area measured";
    assert_eq!(first(&plan_of_all(990.0)), (PlanLevel::Ready, PlanVerdict::TargetMet, format!("Ready to scan: {measured}")));
    // The target of what can be measured is met; a tenth of the part stands on the plate, and a tenth is hidden.
    let mut standing = plan(3, 0, 792.0);
    standing.missed = vec![missed(Cause::ShadowLeft, vec![None; 9]), missed(Cause::ExcludedResting, vec![None; 10])];
    standing.missed.push(missed(Cause::Enclosed, vec![None]));
    let shares = "88.00 % of the visible and 79.20 % of the asked area measured";
    let enclosed = "and 1.00 % is enclosed by the part, where no setup can measure it";
    let but = format!("Can be scanned, but 19.80 % of what was asked is not measured in this setup, {enclosed}: {shares}");
    assert_eq!(first(&standing), (PlanLevel::Limited, PlanVerdict::PartlyMeasured, but));
    assert_eq!(
        Summary::of(&standing).verdict_text,
        "Target met: 99.00 % of coverable, target 98.50 %; not measured (shares of asked): the part stands on it (10.00 %), hidden \
         from the left camera (9.00 %), other causes (1.00 %)"
    );
    standing.setups.push(standing.setups[0].clone());
    assert!(first(&standing).2.contains("not measured in these 2 setups, and 1.00 % is"), "{}", first(&standing).2);
    // No target is no leave to miss anything.
    standing.params.selection.goal = SelectionGoal::BestCoverage;
    let (level, verdict, title) = first(&standing);
    assert_eq!((level, verdict), (PlanLevel::Limited, PlanVerdict::BestCoverage));
    assert!(title.starts_with("Can be scanned, but 19.80 % of what was asked"), "{title}");
    standing.missed.pop();
    let (_, _, title) = first(&standing);
    assert!(title.starts_with("Can be scanned, but 20.80 % of what was asked is not measured in these 2 setups: "), "{title}");
    let gaps = Plan { stopped_because: StopReason::MaxViews, ..plan(3, 0, 400.0) };
    assert!(first(&gaps).2.starts_with("Can be scanned, with gaps: 44.44 % of the visible"), "{}", first(&gaps).2);
    // A part of another size than its file means is not ready, however well it is covered.
    let of_unit = PlanDoubts { unit_question: Some("Check the unit"), ..PlanDoubts::default() };
    let doubted = Summary::of(&plan_of_all(990.0)).with_doubts(&of_unit);
    assert_eq!((doubted.level, doubted.title.as_str()), (PlanLevel::Limited, "Check the unit"));
    let tips_over = does_not_stand(&StandingRemedy::InPosesOfPlanner);
    let action = |doubts: PlanDoubts<'_>| Summary::of(&plan_of_all(990.0)).with_doubts(&doubts).action;
    assert!(action(tips_over).is_some(), "{tips_over:?}");
    let of_both = PlanDoubts { unit_question: of_unit.unit_question, ..tips_over };
    assert_eq!(action(of_both), None, "no advice for a part of another size");
    let (level, _, title) = first(&plan(3, 3, 0.0));
    assert_eq!(
        (level, title.as_str()),
        (PlanLevel::NotExecutable, "Cannot be scanned: no collision-free path leads to any view")
    );
}

/// "57.59 % of what was asked is not measured in this setup" headed a plan of a part that encloses 49.11 % of its surface.
#[test]
fn what_the_part_encloses_is_told_apart_in_the_title() {
    let title = |spots: usize| {
        let mut hollow = plan(3, 0, 792.0);
        hollow.missed = vec![missed(Cause::Enclosed, vec![None; spots])];
        Summary::of(&hollow).title
    };
    let measured = "88.00 % of the visible and 79.20 % of the asked area measured";
    let enclosed = "is enclosed by the part, where no setup can measure it";
    let mostly =
        format!("Can be scanned, but 0.80 % of what was asked is not measured in this setup, and 20.00 % {enclosed}: {measured}");
    assert_eq!(title(20), mostly);
    // 21 % on the samples of the choice are no more than the 20.8 % that independent samples miss.
    assert_eq!(title(21), format!("Can be scanned, but 20.80 % of what was asked {enclosed}: {measured}"));
    assert_eq!(title(0), format!("Can be scanned, but 20.80 % of what was asked is not measured in this setup: {measured}"));
    // Where the target is missed, nothing was said of it.
    let mut short = Plan { stopped_because: StopReason::MaxViews, ..plan(3, 0, 400.0) };
    short.missed = vec![missed(Cause::Enclosed, vec![None; 20])];
    let title = Summary::of(&short).title;
    let gaps = format!("Can be scanned, with gaps, and 20.00 % of what was asked {enclosed}: 44.44 % of the visible");
    assert!(title.starts_with(&gaps), "{title}");
}

/// "Can be scanned, with gaps" headed plans without a view, the last of which had been given up for want of a path.
#[test]
fn a_plan_without_views_cannot_be_scanned() {
    let of_part = Plan { stopped_because: StopReason::NoPath, ..plan(0, 0, 0.0) };
    let mut further = of_part.clone();
    further.coverage.is_of_open = true;
    for plan in [&of_part, &further] {
        let summary = Summary::of(plan);
        assert_eq!((summary.level, summary.verdict), (PlanLevel::NotExecutable, PlanVerdict::ViewsWithoutPath));
        assert_eq!(summary.title, "Cannot be scanned: no collision-free path leads to any view");
        let clause = "no collision-free path leads to any view that is worth taking";
        assert!(summary.verdict_text.starts_with(&format!("No view is executed: {clause}; 0.00 % ")), "{}", summary.verdict_text);
        assert_eq!(summary.views_text, format!("0 views in 1 setup; {clause}"));
    }
}

#[test]
fn a_target_that_is_missed_comes_with_the_rule_that_ended_the_choice() {
    let text = |stopped_because, without_path| {
        let plan = Plan { stopped_because, ..plan(4, without_path, 400.0) };
        let summary = Summary::of(&plan);
        assert_eq!(summary.verdict, PlanVerdict::TargetMissed);
        summary
            .verdict_text
            .strip_prefix("Target missed: 50.00 % of coverable, target 98.50 %: ")
            .expect("its figures")
            .to_owned()
    };
    assert_eq!(text(StopReason::Growth, 0), "the next best view would add less than 0.01 % of asked");
    assert_eq!([1e-9, 0.25, 0.0].map(|growth| super::verdict::shortest(100.0 * growth)), ["0.0000001", "25", "0"]);
    assert_eq!(text(StopReason::NoGain, 0), "no further view adds anything");
    assert_eq!(text(StopReason::NoPath, 3), "no collision-free path leads to 3 of 4 chosen views");
    assert_eq!(text(StopReason::NoPath, 0), "no collision-free path was found to some candidates");
    let mut priced = Plan { stopped_because: StopReason::NoGain, ..plan(4, 0, 400.0) };
    priced.params.selection.view_cost_mm2_per_s = 1.0;
    let told = Summary::of(&priced).verdict_text;
    assert!(told.ends_with(": no further view adds anything worth its cost"), "{told}");
    // Views are not worth their cost, it said, of a plan that measures all that can be measured.
    priced.params.selection.target_of = TargetOf::Asked;
    let told = Summary::of(&priced).verdict_text;
    assert!(told.ends_with(": all candidates together measure 80.00 %"), "{told}");
    // A limit of views that is reached together with the target is no fault.
    let enough = Plan { stopped_because: StopReason::MaxViews, ..plan(4, 0, 788.0) };
    assert_eq!(PlanVerdict::of(&enough), PlanVerdict::PartlyMeasured);
}

/// "the limit of views is reached" was told of a limit that nobody had set: the rules of a rescan are not those of the plan.
#[test]
fn further_views_are_told_with_the_rule_of_the_rescan_that_ended_their_choice() {
    let text = |stopped_because| {
        let mut further = Plan { stopped_because, ..plan(4, 0, 400.0) };
        further.coverage.is_of_open = true;
        // Of the first plan, and not heeded.
        further.params.selection.max_views = Some(9);
        let summary = Summary::of(&further);
        let head = "Simulated coverage (open: asked area that earlier scans left open, but for losses that no further view mends), independent check: ";
        assert!(summary.coverage_text.starts_with(head), "{}", summary.coverage_text);
        (summary.verdict, summary.verdict_text)
    };
    let reached = "50.00 % of coverable in the open area, target 98.50 % together with the earlier scans";
    let missed = |rule: &str| (PlanVerdict::TargetMissed, format!("Target missed: {reached}: {rule}"));
    assert_eq!(text(StopReason::MaxViews), missed("the rescan has as many views as its max_views allows, 4"));
    assert_eq!(text(StopReason::Growth), missed("the next best view is expected to add less than min_gain of the rescan"));
    let met = (PlanVerdict::PartlyMeasured, format!("Target expected to be met: {reached}"));
    assert_eq!(text(StopReason::Target), met);
    assert_eq!(super::rescan_ended(&plan(4, 0, 400.0)), None, "no rescan");
}

/// "98.03 % of what was asked is not measured" headed a plan whose target is expected to be met: most of what scans leave open no view
/// sees.
#[test]
fn further_views_are_headed_by_what_they_measure_of_what_is_open() {
    let title = |stopped_because, measured_mm2| {
        let mut further = Plan { stopped_because, ..plan(4, 0, measured_mm2) };
        further.coverage.is_of_open = true;
        Summary::of(&further).title
    };
    let measure = "further views measure 18.00 % of the area that earlier scans left open, 20.00 % of what is visible of it";
    assert_eq!(title(StopReason::Target, 180.0), format!("Can be scanned: {measure}"));
    assert_eq!(title(StopReason::MaxViews, 180.0), format!("Can be scanned, with gaps: {measure}"));
}

/// "lower bound 0" was told of further views, whose bound is not computed.
#[test]
fn a_bound_of_views_that_was_not_computed_is_not_told() {
    let further = Plan { bound: Bound::default(), ..plan(4, 0, 400.0) };
    assert_eq!(Summary::of(&further).views_text, "4 views in 1 setup");
}

/// Views that tolerate errors are chosen on few samples; of all samples a little less may be measured.
#[test]
fn a_target_of_views_that_tolerate_errors_is_met_only_where_the_figures_say_so() {
    let mut short = plan(3, 0, 400.0);
    assert_ne!(PlanVerdict::of(&short), PlanVerdict::TargetMissed);
    short.params.robust.select = true;
    assert_eq!(PlanVerdict::of(&short), PlanVerdict::TargetMissed);
}

#[test]
fn best_coverage_has_no_target_to_miss() {
    let mut best = Plan { stopped_because: StopReason::MaxViews, ..plan(4, 0, 400.0) };
    best.params.selection.goal = SelectionGoal::BestCoverage;
    best.bound.of_asked_upper = Some(0.45);
    let summary = Summary::of(&best);
    assert_eq!(summary.verdict, PlanVerdict::BestCoverage);
    assert_eq!(summary.verdict_text, "Best coverage found: 40.00 % of asked; upper bound 45.00 %");
    assert_eq!(summary.views_text, "4 views in 1 setup", "no bound on a number that was given");
}

#[test]
fn views_without_a_path_are_not_counted_as_executed() {
    let summary = Summary::of(&plan(97, 8, 792.0));
    assert_eq!((summary.views, summary.views_chosen, summary.setups), (89, 97, 1));
    assert_eq!(summary.views_text, "89 views in 1 setup; no collision-free path leads to 8 of 97 chosen views");
    assert_eq!(Summary::of(&plan(1, 0, 792.0)).views_text, "1 view in 1 setup; lower bound 2");
}

#[test]
fn several_setups_come_with_the_means_by_which_they_are_registered() {
    let mut twice = plan(7, 0, 792.0);
    twice.setups.push(twice.setups[0].clone());
    let mut text = |registration| {
        twice.params.registration = registration;
        Summary::of(&twice).views_text
    };
    assert_eq!(text(Registration::Surface), "7 views in 2 setups, registered by shared surface; lower bound 2");
    assert_eq!(text(Registration::Markers), "7 views in 2 setups, to be registered by markers; lower bound 2");
    assert_eq!(text(Registration::None), "7 views in 2 setups, not registered to each other; lower bound 2");
    // Further views took setups for registered that slide on each other.
    twice.params.registration = Registration::Surface;
    let link = |setups: [u32; 2], resistance: f64| SetupLink { setups: setups.map(SetupId), stability: stability(resistance) };
    twice.setup_links = vec![link([0, 1], 0.0016)];
    let told = Summary::of(&twice).views_text;
    assert_eq!(told, "7 views in 2 setups, not held to each other by the surface that they share; lower bound 2");
    twice.setups.push(twice.setups[0].clone());
    twice.setup_links = vec![link([0, 1], 0.05), link([0, 2], 0.0016), link([1, 2], 0.05)];
    let told = Summary::of(&twice).views_text;
    assert_eq!(told, "7 views in 3 setups, registered by shared surface; lower bound 2", "through the second one");
}

#[test]
fn a_cycle_is_the_sum_of_its_parts() {
    let leg = |duration_secs: f64| Leg {
        via_rad: Vec::new(),
        target: Station { table_angle_rad: 0.0, joints_rad: [0.0; 6] },
        duration_secs,
        passed_within_rad: None,
        turning_secs: 0.5,
    };
    let mut with_cell = plan(6, 0, 792.0);
    assert_eq!(Summary::of(&with_cell).cycle_text, None, "no cell, no time");
    with_cell.setups[0].sequence = Some(Sequence {
        visits: (0..6).map(|view| (ViewId(view), leg(3.4))).collect(),
        return_home: leg(3.0),
        ordered_secs: 24.0,
        lower_bound_secs: 24.0,
        moving_lower_secs: 23.4,
    });
    let summary = Summary::of(&with_cell);
    assert_eq!(
        summary.cycle_text.as_deref(),
        Some(
            "Cycle 31.2 s = 23.4 s moving (table turning for 3.5 s of it) + 6 × 1.3 s scanning (0.3 s of each is settling); \
             order proven optimal for its stations"
        )
    );
    let (cycle_secs, parts) = (summary.cycle_secs.expect("a cell"), summary.cycle_parts.expect("a cell"));
    assert!((cycle_secs - parts.moving_secs - parts.settling_secs - parts.scanning_secs).abs() < 1e-9, "{summary:?}");
    // The program of a controller that cannot turn the table with the arm takes longer, and both are told.
    let program = |secs: f64| summary.clone().with_program(Some(ProgramCycle::new(Dialect::Hans, secs, secs > 40.0, None)));
    let (longer, same) = (program(51.46), program(31.2));
    let told = "; 51.5 s as the robot's own program (hans), which moves table and arm in turn; to plan for that: --set motion.table=alone";
    assert_eq!(longer.cycle_text, summary.cycle_text.clone().map(|text| text + told));
    assert_eq!((longer.cycle_secs, longer.program_cycle.map(|program| program.cycle_secs)), (summary.cycle_secs, Some(51.46)));
    assert_eq!((&same.cycle_text, same.program_cycle.map(|program| program.differs())), (&summary.cycle_text, Some(false)));
    // The options were refused beside the plan's own rounded corners.
    let advised = |corners| ProgramCycle::new(Dialect::Hans, 51.46, true, None).beside_corners(corners).command;
    assert_eq!(advised(Corners::Round).as_deref(), Some("--set motion.table=alone --set motion.corners=stop"));
    assert_eq!(advised(Corners::Stop).as_deref(), Some("--set motion.table=alone"));
    let in_step = ProgramCycle::new(Dialect::Hans, 31.2, false, None).beside_corners(Corners::Round);
    assert_eq!((in_step.set.len(), in_step.command), (0, None));
    // A rescan was told to set `motion.table`, which it does not take.
    let cycle = ProgramCycle::new(Dialect::Hans, 51.46, true, None).without_options();
    assert!(cycle.differs());
    let told = "; 51.5 s as the robot's own program (hans), which moves table and arm in turn";
    let further = summary.clone().with_program(Some(cycle));
    assert_eq!(further.cycle_text, summary.cycle_text.clone().map(|text| text + told));
    // Speeds that are rounded down to whole percents take longer too, and the table has no part in that.
    let told = "; 33.9 s as the robot's own program (hans), whose speeds are set in whole percent";
    assert_eq!(program(33.9).cycle_text, summary.cycle_text.clone().map(|text| text + told));
    // A file that needs work before its first run says so; one that runs as it is says nothing.
    let work = Dialect::Urscript.before_first_run().map(str::to_owned);
    let by_hand = summary.clone().with_program(Some(ProgramCycle::new(Dialect::Urscript, 31.2, false, work)));
    let told = "Before the first run of the program (urscript): fill in vantage_table(angle_deg), which turns the table; until then \
                the program stops there";
    assert!(by_hand.lines().contains(&told.to_owned()), "{:?}", by_hand.lines());
    assert!(!program(31.2).lines().iter().any(|line| line.contains("first run")));
    // A program that was refused has neither a cycle nor work to do for it, but a reason.
    let refused = by_hand.with_refused_program(Dialect::Hans, "the output is 12", "refused.json");
    let told = "; NO PROGRAM for the robot (hans), see refused.json: the output is 12";
    assert_eq!((&refused.program_cycle, &refused.cycle_text), (&None, &summary.cycle_text.clone().map(|text| text + told)));
    assert!(!refused.lines().iter().any(|line| line.contains("first run")), "{:?}", refused.lines());
}

/// An order was called proven optimal with a bound from before its stations were moved, although its own lies below.
#[test]
fn an_order_is_proven_optimal_only_by_the_bound_of_its_moves_as_they_are() {
    let target = Station { table_angle_rad: 0.0, joints_rad: [0.0; 6] };
    let return_home = Leg { via_rad: Vec::new(), target, duration_secs: 11.7, passed_within_rad: None, turning_secs: 0.0 };
    let visits = vec![(ViewId(0), return_home.clone())];
    let mut with_cell = plan(1, 0, 792.0);
    let mut told = |moving_lower_secs: f64| {
        let (visits, return_home) = (visits.clone(), return_home.clone());
        with_cell.setups[0].sequence =
            Some(Sequence { visits, return_home, ordered_secs: 24.0, lower_bound_secs: 24.0, moving_lower_secs });
        let text = Summary::of(&with_cell).cycle_text.expect("a cell");
        text.split_once("settling)").expect("its parts").1.to_owned()
    };
    assert_eq!(told(23.396), "; order proven optimal for its stations", "equal within rounding");
    assert_eq!(told(23.39), "; moving time within 0.1 % of its lower bound");
    assert_eq!(told(20.0), "; moving time within 17.0 % of its lower bound");
    assert_eq!(told(0.0), "", "no bound, no claim");
}

/// The summary said "Cycle 0.0 s", with an order that was proven optimal.
#[test]
fn a_tour_without_views_has_no_cycle_to_tell() {
    let target = Station { table_angle_rad: 0.0, joints_rad: [0.0; 6] };
    let return_home = Leg { via_rad: Vec::new(), target, duration_secs: 0.0, passed_within_rad: None, turning_secs: 0.0 };
    let mut none = plan(10, 10, 0.0);
    none.setups[0].sequence =
        Some(Sequence { visits: Vec::new(), return_home, ordered_secs: 0.0, lower_bound_secs: 0.0, moving_lower_secs: 0.0 });
    assert_eq!(Summary::of(&none).cycle_text.as_deref(), Some("No cycle: no view is executed"));
}

#[test]
fn spots_of_one_cause_and_one_fix_are_one_group() {
    let mut plan = plan(3, 0, 792.0);
    let none = || Some(remedy(RemedyKind::None, 0.0, &[]));
    let more = |candidate| Some(remedy(RemedyKind::View, 1.0, &[candidate]));
    plan.missed = vec![
        missed(Cause::ShadowLeft, vec![none(), none(), none(), None]),
        missed(Cause::NotChosen, vec![more(4), more(4), more(7)]),
    ];
    let summary = Summary::of(&plan);
    assert_eq!((summary.missed_spots, summary.missed_text.as_str()), (7, "Missed: 20.80 % of asked, 7 spots"));
    let texts: Vec<&str> = summary.missed.iter().map(|group| group.text.as_str()).collect();
    assert_eq!(
        texts,
        [
            "3 spots, 3.00 % of asked, hidden from the left camera: no fix found (830 views tried; up to 8 of them together see less \
             than half of it)",
            "3 spots, 3.00 % of asked, measurable, but no view chosen: 1 to 2 more views: --set selection.target=1.0; recovers \
             30.0 mm² (100 %)",
            "1 spot, 1.00 % of asked, hidden from the left camera: no fix searched for",
        ]
    );
    let fixes: Vec<_> = summary.missed.iter().map(|group| (group.fix, group.fix_known, group.added_views)).collect();
    assert_eq!(fixes, [(Some(RemedyKind::None), false, 0), (Some(RemedyKind::View), true, 2), (None, false, 0)]);
    let nothing = Summary::of(&self::plan(3, 0, 1000.0));
    assert_eq!(nothing.missed_text, "Missed: nothing, all of the asked area is measured");
}

#[test]
fn a_share_that_an_independent_check_gives_otherwise_names_its_samples() {
    let mut plan = plan(3, 0, 792.0);
    plan.missed = vec![missed(Cause::ShadowLeft, vec![None])];
    plan.coverage.independent.measured.area_mm2 = 791.0;
    assert_eq!(
        Summary::of(&plan).missed_text,
        "Missed: 20.80 % of asked on the samples that views are chosen on (independent check: 20.90 %), 1 spot"
    );
}

#[test]
fn one_command_has_one_line_and_one_effect() {
    let mut plan = plan(3, 0, 700.0);
    let turn = |of_spot| Some(remedy(RemedyKind::Setup, of_spot, &[4]));
    plan.advice = vec![PlanAdvice { changes: vec![ParamChange::Setups(2)], ..advice() }];
    plan.missed = vec![missed(Cause::FacesTable, vec![turn(1.0), turn(0.75), None]), missed(Cause::Facing, vec![turn(1.0)])];
    let texts: Vec<String> = Summary::of(&plan).missed.into_iter().map(|group| group.text).collect();
    assert_eq!(
        texts,
        [
            "2 spots, 2.00 % of asked, faces the table: only 88 % of them, 17.5 mm²: turn it upside down and scan again: --set setups=2",
            "1 spot, 1.00 % of asked, faces the table: no fix searched for",
            "1 spot, 1.00 % of asked, faces away: turn it upside down and scan again: --set setups=2; recovers 10.0 mm² (100 %)",
        ]
    );
}

#[test]
fn groups_without_a_line_are_counted_and_their_place_is_named() {
    let mut plan = plan(3, 0, 700.0);
    let causes =
        [Cause::Facing, Cause::Depth, Cause::ShadowLeft, Cause::ShadowRight, Cause::Collision, Cause::NoPath, Cause::FrameLeft];
    plan.missed = causes.map(|cause| missed(cause, vec![None, None])).to_vec();
    let summary = Summary::of(&plan);
    assert_eq!(summary.lines().last().map(String::as_str), Some("  2 more spots, 2.00 % of asked: in the report"));
    let below = summary.lines_with_rest("see below");
    assert_eq!(below.last().map(String::as_str), Some("  2 more spots, 2.00 % of asked: see below"));
}

#[test]
fn a_fix_comes_with_the_parameters_that_ask_for_it() {
    let mut plan = plan(3, 0, 700.0);
    let mut fixed = |of_spot, kind, views: &[u32], change: &dyn Fn(&mut Plan)| {
        plan.missed = vec![missed(Cause::ShadowLeft, vec![Some(remedy(kind, of_spot, views))])];
        let mut plan = plan.clone();
        change(&mut plan);
        let group = group_of(&plan);
        let text = group.text.split_once(": ").expect("a fix").1.to_owned();
        assert_eq!(group.command().is_some(), !group.set.is_empty());
        text
    };
    let as_it_is = |_: &mut Plan| {};
    // 710 of 800 mm² are 88.7 %, below the target that the plan has already.
    assert_eq!(fixed(1.0, RemedyKind::View, &[4], &as_it_is), "1 more view; recovers 10.0 mm² (100 %)");
    let limited = |plan: &mut Plan| plan.params.selection.max_views = Some(3);
    assert_eq!(
        fixed(1.0, RemedyKind::View, &[4, 5], &limited),
        "2 more views: --set selection.max_views=5; recovers 10.0 mm² (100 %), there or elsewhere"
    );
    let partly = "only 75 % of it, 7.50 mm²: turn it upside down and scan again";
    assert_eq!(fixed(0.75, RemedyKind::Setup, &[4], &as_it_is), partly);
    let fixture = |plan: &mut Plan| plan.params.part.fixture_mesh = Some("clamp.stl".to_owned());
    assert_eq!(
        fixed(0.95, RemedyKind::Setup, &[4], &fixture),
        "turn it upside down and scan again; recovers 9.50 mm² (95 %)",
        "a fixture holds one setup"
    );
    let of_open = |plan: &mut Plan| plan.coverage.is_of_open = true;
    assert_eq!(fixed(0.75, RemedyKind::Setup, &[4], &of_open), partly, "further views take no parameters of a plan");
    assert_eq!(
        fixed(1.0, RemedyKind::Limit, &[4], &as_it_is),
        "1 more view with larger limits of incidence, which lowers grades of the whole part: --set limits.camera_deg=60.0; recovers 10.0 mm² (100 %)"
    );
    assert_eq!(
        fixed(1.0, RemedyKind::Tilt, &[4], &as_it_is),
        "1 more view, tilted (candidates.poses: those in missed.json); recovers 10.0 mm² (100 %)"
    );
    assert_eq!(
        fixed(1.0, RemedyKind::Roll, &[4, 5, 6], &as_it_is),
        "3 more views, rolled (candidates.poses: those in missed.json); recovers 10.0 mm² (100 %)",
        "too many for a command"
    );
}

/// "Turn it upside down and scan again" came without any options where the advice on the plan was another turn.
#[test]
fn a_turn_that_no_advice_has_comes_with_the_options_of_a_plan_of_its_own() {
    let mut plan = plan(3, 0, 700.0);
    let half_turn = nalgebra::UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0);
    let over = Pose::from_parts(Vector3::new(0.0, 40.0, 60.0), half_turn);
    let turned = Remedy { table_from_part: Some(over), ..remedy(RemedyKind::Setup, 1.0, &[4]) };
    plan.missed = vec![missed(Cause::ExcludedResting, vec![Some(turned)])];
    let group = group_of(&plan);
    let begins = "1 spot, 1.00 % of asked, the part stands on it: turn it upside down and scan again, in a plan of its own: --set \
                  'part.table_from_part={";
    assert!(group.text.starts_with(begins), "{}", group.text);
    assert_eq!(group.set["part.table_from_part"]["translation_mm"], json!([0.0, 40.0, 60.0]));
    plan.params.setups = 2;
    assert_eq!(group_of(&plan).set["setups"], json!(1), "of one pose");
    plan.advice = vec![advice()];
    let advised = group_of(&plan);
    assert!(!advised.set.contains_key("part.table_from_part") && !advised.text.contains("of its own"), "{}", advised.text);
    plan.advice = Vec::new();
    plan.params.part.fixture_mesh = Some("clamp.stl".to_owned());
    assert!(group_of(&plan).set.is_empty(), "a fixture holds the part in one pose");
}

/// "No fix found (739 views tried; up to 8 of them together see less than half of it)" was told of a closed cavity.
#[test]
fn what_the_part_encloses_is_to_be_excluded_and_not_to_be_seen() {
    let mut plan = plan(3, 0, 700.0);
    plan.missed = vec![missed(Cause::Enclosed, vec![Some(remedy(RemedyKind::None, 0.0, &[]))])];
    let group = group_of(&plan);
    let told = "1 spot, 1.00 % of asked, enclosed by the part: no view can see it; exclude it if it need not be measured \
                (regions.exclude)";
    assert_eq!((group.text.as_str(), group.fix), (told, Some(RemedyKind::None)));
}

/// Options that alone would not bring the views were told where another rule ends the choice as well.
#[test]
fn a_fix_comes_with_every_rule_that_ends_the_choice_before_its_views() {
    let fixed = |measured_mm2: f64, kind, change: &dyn Fn(&mut Plan)| {
        let mut plan = plan(3, 0, measured_mm2);
        plan.missed = vec![missed(Cause::ShadowLeft, vec![Some(remedy(kind, 1.0, &[4]))])];
        change(&mut plan);
        let told = group_of(&plan).text;
        let (_, fix) = told.split_once(": ").expect("a fix");
        let (fix, effect) = fix.split_once("; recovers 10.0 mm² (100 %)").expect("an effect");
        // More views are taken of whatever is easiest to measure, unless all of it is asked for.
        let is_open = fix.contains("selection.") && !fix.contains("selection.target=1.0");
        assert_eq!(effect, if is_open { ", there or elsewhere" } else { "" }, "{fix}");
        fix.to_owned()
    };
    // The next view is too small, and would be one too many.
    let small_and_many = |plan: &mut Plan| {
        (plan.stopped_because, plan.params.selection.max_views) = (StopReason::Growth, Some(3));
    };
    assert_eq!(
        fixed(700.0, RemedyKind::View, &small_and_many),
        "1 more view: --set selection.min_growth=0.0 --set selection.max_views=4"
    );
    // The target ended the choice; beyond it, a view of 10 mm² adds too little.
    let small = |plan: &mut Plan| plan.params.selection.min_growth = 0.02;
    assert_eq!(
        fixed(780.0, RemedyKind::View, &small),
        "1 more view: --set selection.target=0.9875 --set selection.min_growth=0.0"
    );
    // The target is reached without the views that are given, or that larger limits allow; with them, 810 mm² are coverable.
    let as_it_is = |_: &mut Plan| {};
    assert_eq!(
        fixed(792.0, RemedyKind::Tilt, &as_it_is),
        "1 more view, tilted (candidates.poses: those in missed.json): --set selection.target=0.9901"
    );
    assert_eq!(
        fixed(792.0, RemedyKind::Limit, &as_it_is),
        "1 more view with larger limits of incidence, which lowers grades of the whole part: --set selection.target=0.9901 --set limits.camera_deg=60.0"
    );
    let limited = |plan: &mut Plan| plan.params.selection.max_views = Some(3);
    assert_eq!(
        fixed(700.0, RemedyKind::Standoff, &limited),
        "1 more view from another distance (candidates.poses: those in missed.json): --set selection.max_views=4"
    );
    let best = |plan: &mut Plan| {
        (plan.params.selection.goal, plan.params.selection.max_views) = (SelectionGoal::BestCoverage, Some(3));
    };
    assert_eq!(fixed(792.0, RemedyKind::View, &best), "1 more view: --set selection.max_views=4", "it has no target");
    // A view that is not worth its cost is had by none of these rules.
    let no_gain = |plan: &mut Plan| plan.stopped_because = StopReason::NoGain;
    assert_eq!(fixed(792.0, RemedyKind::View, &no_gain), "1 more view");
    // Nor where a region that misses its target is told in its place; a plan that reaches its own ended there.
    let unmet = |plan: &mut Plan| plan.stopped_because = StopReason::RegionsUnmet;
    assert_eq!(fixed(780.0, RemedyKind::View, &unmet), "1 more view", "97.5 % are short of 98.5 %");
    assert_eq!(fixed(790.0, RemedyKind::View, &unmet), "1 more view: --set selection.target=1.0");
}

/// Targets of limits follow from what both measure.
#[test]
fn limits_of_one_value_are_one_command_whatever_they_recover() {
    let mut plan = plan(3, 0, 790.0);
    let limit = |of_spot: f64| Some(remedy(RemedyKind::Limit, of_spot, &[4]));
    let command = |plan: &Plan| group_of(plan).command().expect("options");
    plan.missed = vec![missed(Cause::IncidenceLeft, vec![limit(1.0); 5])];
    assert_eq!(command(&plan), "--set selection.target=0.9882 --set limits.camera_deg=60.0");
    plan.missed = vec![missed(Cause::IncidenceLeft, vec![limit(0.6)])];
    assert_eq!(command(&plan), "--set selection.target=0.9875 --set limits.camera_deg=60.0");
    plan.missed = vec![missed(Cause::IncidenceLeft, [vec![limit(1.0); 5], vec![limit(0.6)]].concat())];
    assert_eq!((group_of(&plan).spots, group_of(&plan).fix_known), (6, false));
}

#[test]
fn a_share_that_does_not_work_is_not_rounded_to_one_that_does() {
    let mut plan = plan(3, 0, 700.0);
    plan.missed = vec![missed(Cause::ShadowLeft, vec![Some(remedy(RemedyKind::Roll, 0.899, &[4]))])];
    let told = group_of(&plan).text;
    assert!(
        told.ends_with(": only 89 % of it, 8.99 mm²: 1 more view, rolled (candidates.poses: those in missed.json)"),
        "{told}"
    );
}

/// "Turn it upside down …; recovers 84 062.5 mm² (54 %)" told last that the fix mends half of the spot.
#[test]
fn the_share_of_a_fix_that_does_not_work_for_each_spot_is_said_before_the_fix() {
    let mut plan = plan(3, 0, 700.0);
    plan.advice = vec![PlanAdvice { changes: vec![ParamChange::Setups(2)], ..advice() }];
    let turn = |of_spot| Some(remedy(RemedyKind::Setup, of_spot, &[4]));
    let over = "turn it upside down and scan again: --set setups=2";
    let mut told = |remedies: Vec<Option<Remedy>>| {
        plan.missed = vec![missed(Cause::ExcludedResting, remedies)];
        let group = group_of(&plan);
        let fix = group.text.split_once("the part stands on it: ").expect("a fix").1.to_owned();
        (group.fix_known, group.partial_text, fix)
    };
    let partial = |text: &str| (false, Some(text.to_owned()), format!("{text}: {over}"));
    assert_eq!(told(vec![turn(0.54)]), partial("only 54 % of it, 5.40 mm²"));
    // 95 % of the area, and of one spot the half alone.
    let mut nearly = vec![turn(1.0); 9];
    nearly.push(turn(0.5));
    assert_eq!(told(nearly), partial("only 95 % of them, 95.0 mm²"));
    assert_eq!(told(vec![turn(0.9)]), (true, None, format!("{over}; recovers 9.00 mm² (90 %)")));
    assert_eq!(told(vec![Some(remedy(RemedyKind::None, 0.0, &[]))]).1, None, "there is no fix");
}

/// 99.7 % of two spots was told as 100 %.
#[test]
fn what_a_fix_leaves_of_its_spots_is_not_rounded_away() {
    let mut plan = plan(3, 0, 700.0);
    let told = |of_spot: f64, plan: &mut Plan| {
        plan.missed = vec![missed(Cause::ShadowLeft, vec![Some(remedy(RemedyKind::Roll, of_spot, &[4]))])];
        group_of(plan).recovers()
    };
    assert_eq!(told(0.997, &mut plan), "9.97 mm² (99 %)");
    assert_eq!((told(0.956, &mut plan), told(1.0, &mut plan)), ("9.56 mm² (96 %)".to_owned(), "10.0 mm² (100 %)".to_owned()));
}

fn advice() -> PlanAdvice {
    PlanAdvice {
        kind: AdviceKind::TurnOver,
        changes: vec![ParamChange::Setups(2), ParamChange::Registration(Registration::Markers)],
        table_from_part: None,
        turn: Some(Turn { kind: TurnKind::UpsideDown, side: PartSide::Right, angle_rad: std::f64::consts::PI }),
        setups: Vec::new(),
        added_views: 2,
        views: 5,
        measured_area_mm2: 979.0,
        grade_a_area_mm2: None,
        visible_area_mm2: 1000.0,
        cycle_secs: None,
        regions_met: vec!["bore".to_owned()],
    }
}

#[test]
fn the_best_action_is_the_advice_on_the_plan_as_a_whole() {
    let mut plan = plan(3, 0, 701.0);
    plan.missed = vec![missed(Cause::FacesTable, vec![Some(remedy(RemedyKind::Setup, 1.0, &[4]))])];
    plan.advice = vec![advice()];
    let summary = Summary::of(&plan);
    let action = summary.action.as_ref().expect("advice");
    assert_eq!(
        action.text,
        "turn it upside down and scan again, with markers on the part to register its setups: --set setups=2 --set \
         registration=markers; estimated effect: 70.1 → 97.9 % of asked, about +2 views; meets the target of \"bore\""
    );
    assert_eq!(action.command.as_deref(), Some("--set setups=2 --set registration=markers"));
    assert_eq!(serde_json::to_value(&action.set).expect("JSON"), json!({"setups": 2, "registration": "markers"}));
    assert!((action.from_of_asked - 0.701).abs() < 1e-12 && (action.to_of_asked - 0.979).abs() < 1e-12, "{action:?}");
    // Spots that the same turn would show are asked for with the same parameters.
    assert_eq!(summary.missed[0].set, action.set);
    assert!(summary.lines().contains(&format!("Next: {}", action.text)));
}

/// Such a name added lines of its own to the command line's summary and to `report.txt`.
#[test]
fn the_name_of_a_region_breaks_no_line_of_the_best_action() {
    let mut plan = plan(3, 0, 701.0);
    let regions_met = vec!["rim\nReady to scan".to_owned(), "\u{1b}[2Jseat".to_owned()];
    plan.advice = vec![PlanAdvice { regions_met, ..advice() }];
    let summary = Summary::of(&plan);
    let action = summary.action.as_ref().expect("advice");
    assert!(action.text.ends_with("; meets the target of \"rim\\nReady to scan\", \"\\u{1b}[2Jseat\""), "{}", action.text);
    assert!(!summary.lines().iter().any(|line| line.contains(char::is_control)), "{:?}", summary.lines());
}

/// The spots that a pose of the advised setups shows are fixed by the same parameters.
#[test]
fn advice_that_leaves_the_setup_of_the_plan_says_how_the_part_lies_then() {
    let advised = |kind, angle_rad: f64| AdvisedSetup {
        table_from_part: Pose::identity(),
        turn: Turn { kind, side: PartSide::Back, angle_rad },
    };
    let right_angle_rad = std::f64::consts::FRAC_PI_2;
    let setups = vec![advised(TurnKind::UpsideDown, 2.0 * right_angle_rad), advised(TurnKind::OnSide, right_angle_rad)];
    let changes = vec![ParamChange::Setups(2)];
    let mut plan = plan(3, 0, 701.0);
    plan.missed = vec![missed(Cause::FacesTable, vec![Some(remedy(RemedyKind::Setup, 1.0, &[4]))])];
    plan.advice = vec![PlanAdvice { turn: None, setups, changes, regions_met: Vec::new(), ..advice() }];
    let summary = Summary::of(&plan);
    let action = summary.action.expect("advice");
    assert_eq!(
        action.text,
        "scan it in other setups, upside down and on its back: --set setups=2; estimated effect: 70.1 → 97.9 % of asked, about +2 \
         views"
    );
    assert_eq!(summary.missed[0].set, action.set);
}

#[test]
fn a_fragile_plan_is_told_which_error_costs_most_and_to_give_that_of_the_cell_where_it_is_the_default() {
    let told = |angle_deg: f64| {
        let [views, part, hand_eye] = [0.98, 0.884, 0.95].map(|worst| Drawn::new(0.99, vec![0.99, worst]));
        let mut plan = plan_of_all(990.0);
        plan.advice = vec![advice()];
        let pose_error = PoseErrorParams { angle_deg, translation_mm: 1.0 };
        plan.coverage.robust = Some(Robust { pose_error, views, part, hand_eye });
        Summary::of(&plan).action.expect("an action").text
    };
    let choose =
        "mm (costliest: the part and its support, 10.60 percentage points): --set robust.select=true; effect not estimated";
    assert_eq!(told(0.5), format!("choose views that tolerate pose errors of 0.5° and 1 {choose}"));
    assert_eq!(
        told(1.0),
        format!(
            "choose views that tolerate pose errors of 1° and 1 {choose}; or set the cell's own error in place of the default: \
             --set robust.pose_error=…"
        )
    );
}

/// "1.0123456789012344° and 1.2649110640673518 mm" stood in the verdict, and "1.01° and 1.26 mm" on another line.
#[test]
fn pose_errors_are_told_with_three_digits_in_verdict_and_action() {
    let mut plan = plan(3, 0, 792.0);
    let [views, part, hand_eye] = [0.5; 3].map(|worst| Drawn::new(0.792, vec![worst]));
    let pose_error = PoseErrorParams { angle_deg: 1.012_345_678, translation_mm: 1.264_911_064 };
    plan.coverage.robust = Some(Robust { pose_error, views, part, hand_eye });
    let summary = Summary::of(&plan);
    let action = summary.action.expect("an action").text;
    for told in [&summary.verdict_text, &action] {
        assert!(told.contains("pose errors of 1.01° and 1.26 mm "), "{told}");
    }
}

#[test]
fn of_what_is_missed_and_what_pose_errors_cost_the_larger_loss_is_told_first() {
    let verdict_at = |worst: f64| {
        let mut plan = plan(3, 0, 792.0);
        plan.advice = vec![advice()];
        let [views, part, hand_eye] = [worst; 3].map(|worst| Drawn::new(0.792, vec![worst]));
        let pose_error = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };
        plan.coverage.robust = Some(Robust { pose_error, views, part, hand_eye });
        let summary = Summary::of(&plan);
        (PlanVerdict::of(&plan), summary.lines().join("\n"), summary.action.expect("an action").text)
    };
    let (verdict, told, action) = verdict_at(0.742);
    assert_eq!(verdict, PlanVerdict::PartlyMeasured);
    assert!(
        told.contains("pose errors of 1° and 1 mm cost 5.00 percentage points of the asked area in the worst draw"),
        "{told}"
    );
    assert!(action.starts_with("turn it upside down"), "{action}");
    let (verdict, told, action) = verdict_at(0.5);
    assert_eq!(verdict, PlanVerdict::Fragile);
    assert!(told.contains("small pose errors cost coverage") && action.contains("robust.select=true"), "{told}");
    let (verdict, _, action) = verdict_at(0.592);
    assert_eq!(verdict, PlanVerdict::PartlyMeasured, "20.8 points are missed");
    assert!(action.contains("robust.select=true"), "advice gains 18.7 points, pose errors cost 20.0: {action}");
}

/// A plan without a target, like one with it.
#[test]
fn best_coverage_that_misses_more_than_pose_errors_cost_says_so() {
    let mut best = plan(3, 0, 560.0);
    best.params.selection.goal = SelectionGoal::BestCoverage;
    best.advice = vec![advice()];
    let [views, part, hand_eye] = [0.55, 0.5458, 0.55].map(|worst| Drawn::new(0.56, vec![worst]));
    let pose_error = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };
    best.coverage.robust = Some(Robust { pose_error, views, part, hand_eye });
    let summary = Summary::of(&best);
    assert_eq!(summary.verdict, PlanVerdict::BestCoverage);
    assert!(summary.title.starts_with("Can be scanned, but 44.00 % of what was asked is not measured"), "{}", summary.title);
    let told = "; pose errors of 1° and 1 mm cost 1.42 percentage points of the asked area in the worst draw";
    assert!(summary.verdict_text.ends_with(told), "{}", summary.verdict_text);
    assert!(summary.action.is_some_and(|action| action.text.starts_with("turn it upside down")));
}

#[test]
fn views_chosen_for_pose_errors_that_miss_the_target_are_not_said_to_have_no_further_view() {
    let mut plan = plan(3, 0, 784.0);
    (plan.stopped_because, plan.params.robust.select) = (StopReason::Target, true);
    let summary = Summary::of(&plan);
    assert_eq!(
        summary.verdict_text,
        "Target missed: 98.00 % of coverable, target 98.50 %: views were chosen to tolerate pose errors, and on the samples \
         of that choice they reach it (a higher target adds views: --set selection.target=0.99)"
    );
    let action = summary.action.expect("an action").text;
    assert_eq!(action, "raise the target, so that more views are chosen: --set selection.target=0.99; effect not estimated");
    plan.missed = vec![missed(Cause::NotChosen, vec![Some(remedy(RemedyKind::View, 0.2, &[4]))])];
    assert_eq!(group_of(&plan).command().as_deref(), Some("--set selection.target=0.99"));
}

#[test]
fn without_advice_the_best_action_is_the_fix_that_recovers_the_largest_area() {
    let mut plan = plan(3, 0, 780.0);
    let spots = |kind, of_spot, count: usize, candidate| vec![Some(remedy(kind, of_spot, &[candidate])); count];
    plan.missed = vec![
        missed(Cause::Depth, spots(RemedyKind::Standoff, 0.6, 5, 1)),
        missed(Cause::NotChosen, spots(RemedyKind::View, 1.0, 1, 2)),
        missed(Cause::Facing, vec![Some(remedy(RemedyKind::None, 0.0, &[]))]),
    ];
    // A fix that mends a part of much comes before one that mends all of little.
    let partial = Summary::of(&plan).action.expect("a fix of a part");
    assert!(partial.text.starts_with("1 more view from another distance: --set 'candidates.poses=["), "{}", partial.text);
    assert!(partial.text.ends_with("; estimated effect: 78.0 → 81.0 % of asked"), "{}", partial.text);
    plan.missed.remove(0);
    let action = Summary::of(&plan).action.expect("a fix");
    // 790 of 800 mm² are 98.75 %, which three decimals give as 98.7.
    assert_eq!(action.text, "1 more view: --set selection.target=0.9875; estimated effect: 78.0 → 79.0 % of asked");
    assert_eq!((action.added_views, action.added_cycle_secs), (1, None));
    // "83.919 → 83.922 % of asked" was the one next action of a plan.
    plan.coverage.asked_area_mm2 = 20_000.0;
    assert_eq!(Summary::of(&plan).action, None, "0.05 % of asked");
    plan.coverage.regions = vec![region("bore", 0.5)];
    assert!(Summary::of(&plan).action.is_some(), "it may be all that a region lacks");
    plan.missed.remove(0);
    assert_eq!(Summary::of(&plan).action, None);
}

/// A feature with a target of 0.9 and this tolerance, of which nothing is measured.
fn unmet_feature(name: &str, tolerance_mm: f64, beyond_noise_area_mm2: f64) -> RegionCoverage {
    RegionCoverage {
        tolerance_mm: Some(tolerance_mm),
        min_tolerance_mm: 0.156,
        missed_mm2: vec![(Cause::BelowGrade, 10.0)],
        beyond_noise_area_mm2,
        ..region(name, 0.0)
    }
}

/// "Turn it upside down: 69.4 → 70.3 % of asked" was the next action where no view measures as well as a feature needs.
#[test]
fn a_tolerance_beyond_the_noise_comes_before_actions_that_add_little() {
    let mut plan = plan(3, 0, 701.0);
    plan.advice = vec![PlanAdvice { measured_area_mm2: 710.0, regions_met: Vec::new(), ..advice() }];
    let region = Region::Box { min_mm: [0.0; 3], max_mm: [1.0; 3] };
    let feature = |tolerance_mm| FeatureParams {
        name: None,
        region: region.clone(),
        tolerance_mm,
        point_spacing_mm: None,
        target: Some(0.9),
    };
    plan.params.regions.features = vec![feature(0.5), feature(0.1)];
    let next = |plan: &Plan, regions: Vec<RegionCoverage>| {
        let mut plan = plan.clone();
        plan.coverage.regions = regions;
        Summary::of(&plan).action.expect("an action")
    };
    let (rim, bore) = (unmet_feature("rim", 0.5, 0.0), unmet_feature("bore", 0.1, 10.0));
    let told = "give \"bore\" a coarser tolerance than ±0.050 mm (regions.features.1.tolerance_mm is 0.1): the finest that this \
                scanner's noise allows is ±0.078 mm (tolerance_mm = 0.156), at best focus and perpendicular to the surface; or \
                allow the noise a larger share of the tolerance (regions.noise.budget, at least 0.467); effect not estimated";
    let action = next(&plan, vec![rim.clone(), bore.clone()]);
    assert_eq!((action.text.as_str(), action.command, action.set.len()), (told, None, 0));
    let adds_much = Plan { advice: vec![PlanAdvice { regions_met: Vec::new(), ..advice() }], ..plan.clone() };
    assert!(next(&adds_much, vec![rim.clone(), bore.clone()]).text.starts_with("turn it upside down"));
    // The region misses its target for the tolerance of the feature within it.
    let within = RegionCoverage { beyond_noise_area_mm2: 6.0, ..rim.clone() };
    let met = RegionCoverage { target: None, ..bore.clone() };
    assert_eq!(next(&plan, vec![within, met.clone()]).text, told);
    let other = RegionCoverage { beyond_noise_area_mm2: 4.0, ..bore.clone() };
    for regions in [vec![rim.clone(), other], vec![rim, met]] {
        assert!(next(&plan, regions).text.starts_with("turn it upside down"), "noise is not the reason");
    }
    // No budget is more than the tolerance.
    plan.params.regions.features = vec![feature(0.01), feature(0.1)];
    let finer = next(&plan, vec![unmet_feature("rim", 0.01, 10.0), bore]).text;
    let begins = "give \"rim\" (±0.005 mm) and \"bore\" (±0.050 mm) coarser tolerances (tolerance_mm): the finest that";
    assert!(finer.starts_with(begins) && !finer.contains("regions.noise.budget"), "{finer}");
}

/// Regions were counted in the summary, and told by no name.
#[test]
fn the_summary_lists_the_regions_with_the_reason_for_which_a_target_is_missed() {
    let mut plan = plan_of_all(990.0);
    let independent = IndependentRegion { samples: 400, asked_area_mm2: 10.0, measured_area_mm2: 8.5, squares_mm4: 0.25 };
    let refuted = RegionCoverage { independent: Some(independent), ..region("seat", 0.93) };
    plan.coverage.regions = vec![region("rim", 0.95), refuted, unmet_feature("bore", 0.5, 0.0)];
    let regions = Summary::of(&plan).regions;
    let told: Vec<_> = regions.iter().map(|region| (region.name.as_str(), region.met, region.why_unmet.as_deref())).collect();
    let only_there = "reached on the samples that views were chosen on, but not on independent ones";
    assert_eq!(
        told,
        [
            ("seat", Some(false), Some(only_there)),
            ("bore", Some(false), Some("not measured well enough (10.0 mm²)")),
            ("rim", Some(true), None),
        ],
        "those that miss their targets first"
    );
    assert_eq!(
        (regions[0].independent_of_asked, regions[2].target, regions[2].independent_of_asked),
        (Some(0.85), Some(0.9), None)
    );
    plan.coverage.regions = vec![RegionCoverage { target: None, ..region("face", 0.5) }; 30];
    let many = Summary::of(&plan).regions;
    assert_eq!((many.len(), many[0].met, many[0].why_unmet.as_deref()), (20, None, None), "the plan has all");
}

/// "Turn it upside down: 76.1 → 77.3 % of asked" was told where three groups with that fix recover 6.3 % of asked.
#[test]
fn a_fix_counts_for_all_spots_that_it_is_for_whatever_they_are_missed_for() {
    let turned = |table_from_part, of_spot: f64, candidate: u32| {
        Some(Remedy { table_from_part, ..remedy(RemedyKind::Setup, of_spot, &[candidate]) })
    };
    for lies in [None, Some(Pose::identity())] {
        let mut plan = plan(3, 0, 600.0);
        plan.missed = vec![
            missed(Cause::ExcludedResting, vec![turned(lies, 0.6, 4); 4]),
            missed(Cause::FacesTable, vec![turned(lies, 1.0, 5)]),
            missed(Cause::ShadowLeft, vec![turned(lies, 1.0, 5); 2]),
            missed(Cause::NotChosen, vec![Some(remedy(RemedyKind::View, 1.0, &[6])); 4]),
        ];
        let summary = Summary::of(&plan);
        let action = summary.action.expect("a fix");
        assert!(action.text.starts_with("turn it upside down and scan again"), "{}", action.text);
        assert!(action.text.ends_with("; estimated effect: 60.0 → 65.4 % of asked, up to +2 views"), "{}", action.text);
        assert_eq!((&action.set, action.set.is_empty()), (&summary.missed[0].set, lies.is_none()));
        assert_eq!(summary.missed.len(), 4, "each cause has its group");
    }
    let mut nearly = plan_of_all(990.0);
    nearly.missed = vec![missed(Cause::FacesTable, vec![turned(None, 1.0, 4); 2])];
    let to_of_asked = Summary::of(&nearly).action.expect("a fix").to_of_asked;
    assert!((to_of_asked - 1.0).abs() < 1e-12, "no more than is missing: {to_of_asked}");
}

/// Each group had a limit of views of its own, and neither came before a fix that recovers less than both together.
#[test]
fn more_views_for_several_causes_are_one_action_with_the_limit_that_is_enough_for_all() {
    let mut plan = Plan { stopped_because: StopReason::MaxViews, ..plan(16, 0, 700.0) };
    plan.params.selection.max_views = Some(16);
    let fix = |kind, of_spot, views: &[u32]| Some(remedy(kind, of_spot, views));
    plan.missed = vec![
        missed(Cause::NotChosen, vec![fix(RemedyKind::View, 1.0, &[20, 21])]),
        missed(Cause::ShadowLeft, vec![fix(RemedyKind::View, 1.0, &[20, 21, 22, 23])]),
        missed(Cause::Depth, vec![fix(RemedyKind::Standoff, 0.75, &[30]); 2]),
    ];
    let summary = Summary::of(&plan);
    let line = |cause: Cause| summary.missed.iter().find(|group| group.reason == cause).and_then(MissedGroup::command);
    assert_eq!(line(Cause::NotChosen).as_deref(), Some("--set selection.max_views=18"));
    assert_eq!(line(Cause::ShadowLeft).as_deref(), Some("--set selection.max_views=20"));
    let action = summary.action.expect("a fix");
    assert_eq!(action.text, "4 more views: --set selection.max_views=20; estimated effect: 70.0 → 72.0 % of asked");
    // Other views for the second cause come on top of those for the first.
    plan.missed[1] = missed(Cause::ShadowLeft, vec![fix(RemedyKind::View, 1.0, &[24, 25, 26, 27])]);
    let action = Summary::of(&plan).action.expect("a fix");
    assert_eq!((json!(action.set), action.added_views), (json!({"selection.max_views": 22}), 6));
}

/// A larger limit of incidence measures what a smaller one does too.
#[test]
fn limits_of_several_values_are_one_action_with_the_largest() {
    let mut plan = plan(3, 0, 700.0);
    let limit =
        |camera_deg, projector_deg| vec![Some(Remedy { camera_deg, projector_deg, ..remedy(RemedyKind::Limit, 1.0, &[4]) })];
    plan.missed = vec![
        missed(Cause::IncidenceLeft, limit(Some(60.0), None)),
        missed(Cause::IncidenceRight, limit(Some(62.0), None)),
        missed(Cause::IncidenceProjector, limit(None, Some(50.0))),
    ];
    let action = Summary::of(&plan).action.expect("a fix");
    assert_eq!(json!(action.set), json!({"limits.camera_deg": 62.0, "limits.projector_deg": 50.0}));
    assert!(action.text.ends_with("; estimated effect: 70.0 → 73.0 % of asked"), "{}", action.text);
}

/// Remedy that turns the part into a pose, in the same words whatever the pose is.
fn turned_into(x_mm: f64) -> Option<Remedy> {
    let pose = Pose::from_parts(Vector3::new(x_mm, 0.0, 0.0), nalgebra::UnitQuaternion::identity());
    Some(Remedy { table_from_part: Some(pose), ..remedy(RemedyKind::Setup, 1.0, &[4]) })
}

/// "70.0 → 73.0 % of the open area" was told of a turn, of which one pose recovers 2 points and another, told alike, 1 point.
#[test]
fn turns_in_the_same_words_into_several_poses_are_several_fixes() {
    let mut plan = plan(3, 0, 700.0);
    plan.missed = vec![
        missed(Cause::FacesTable, vec![turned_into(1.0), turned_into(2.0)]),
        missed(Cause::ShadowLeft, vec![turned_into(1.0)]),
    ];
    let told = |change: &dyn Fn(&mut Plan)| {
        let mut plan = plan.clone();
        change(&mut plan);
        let summary = Summary::of(&plan);
        assert_eq!(summary.missed.len(), 3, "{:?}", summary.missed);
        let action = summary.action.expect("a fix");
        (action.text.split_once("; estimated effect: ").expect("an effect").1.to_owned(), action.set)
    };
    let (effect, set) = told(&|_: &mut Plan| ());
    assert_eq!(effect, "70.0 → 72.0 % of asked, up to +1 view");
    assert_eq!(set["part.table_from_part"]["translation_mm"], json!([1.0, 0.0, 0.0]), "that of both");
    let (effect, set) = told(&|plan: &mut Plan| plan.coverage.is_of_open = true);
    assert_eq!((effect.as_str(), set.len()), ("70.0 → 72.0 % of the open area, up to +1 view", 0));
    let (effect, set) = told(&|plan: &mut Plan| plan.params.part.fixture_mesh = Some("clamp.stl".to_owned()));
    assert_eq!((effect.as_str(), set.len()), ("70.0 → 72.0 % of asked, up to +1 view", 0));
    let (effect, _) = told(&|plan: &mut Plan| plan.params.selection.max_views = Some(plan.views.len() as u32));
    assert_eq!(effect, "70.0 → 72.0 % of asked, no more views", "the limit holds for that plan too");
}

/// The options of the advice were told of a spot that another pose shows, into which the part is turned in the same words.
#[test]
fn a_turn_has_the_options_of_the_advice_only_in_the_pose_of_the_advice() {
    let mut plan = plan(3, 0, 700.0);
    let table_from_part = turned_into(1.0).and_then(|remedy| remedy.table_from_part);
    plan.advice = vec![PlanAdvice { table_from_part, ..advice() }];
    let set_of = |x_mm: f64| {
        let missed = vec![missed(Cause::FacesTable, vec![turned_into(x_mm)])];
        group_of(&Plan { missed, ..plan.clone() }).set
    };
    assert_eq!(json!(set_of(1.0)), json!({"setups": 2, "registration": "markers"}));
    assert_eq!(set_of(2.0)["part.table_from_part"]["translation_mm"], json!([2.0, 0.0, 0.0]));
    let advised = |x_mm: f64| AdvisedSetup {
        table_from_part: Pose::from_parts(Vector3::new(x_mm, 0.0, 0.0), nalgebra::UnitQuaternion::identity()),
        turn: Turn { kind: TurnKind::UpsideDown, side: PartSide::Right, angle_rad: std::f64::consts::PI },
    };
    let setups = vec![advised(1.0), advised(3.0)];
    plan.advice = vec![PlanAdvice { turn: None, setups, ..advice() }];
    let missed = vec![missed(Cause::FacesTable, vec![turned_into(3.0), turned_into(2.0)])];
    let groups = Summary::of(&Plan { missed, ..plan }).missed;
    let in_advice: Vec<bool> = groups.iter().map(|group| group.set.contains_key("setups")).collect();
    assert_eq!(in_advice.iter().filter(|is_in| **is_in).count(), 1, "{groups:?}");
}

/// "1 more view" was told of a rescan that was left short of its target by views without a path.
#[test]
fn more_views_are_no_fix_of_a_rescan_that_left_out_views_without_a_path() {
    let mut plan = Plan { stopped_because: StopReason::NoPath, ..plan(4, 1, 700.0) };
    plan.coverage.is_of_open = true;
    plan.missed = vec![missed(Cause::NotChosen, vec![Some(remedy(RemedyKind::View, 1.0, &[4]))])];
    let group = group_of(&plan);
    assert_eq!(group.text, format!("1 spot, 1.00 % of the open area, measurable, but no view chosen: {RESCAN_WITHOUT_PATH}"));
    assert_eq!((group.fix, group.fix_known, group.added_views), (Some(RemedyKind::None), false, 0));
    assert_eq!(Summary::of(&plan).action, None);
}

/// "5 more views; recovers 73 %" was told of a plan that was left short of its target since 18 of its 86 views had no path.
#[test]
fn more_views_are_no_fix_where_views_without_a_path_were_left_out() {
    let mut plan = Plan { stopped_because: StopReason::NoPath, ..plan(4, 1, 700.0) };
    let view = |of_spot: f64| Some(remedy(RemedyKind::View, of_spot, &[4]));
    plan.missed = vec![missed(Cause::NotChosen, vec![view(0.7), view(1.0)])];
    let group = group_of(&plan);
    assert_eq!(group.text, format!("2 spots, 2.00 % of asked, measurable, but no view chosen: {WITHOUT_PATH}"));
    assert_eq!((group.fix, group.fix_known, group.added_views), (Some(RemedyKind::None), false, 0));
    assert!(group.recovers_mm2 <= 0.0 && group.command().is_none(), "{group:?}");
    assert_eq!(Summary::of(&plan).action, None);
}

/// "No fix found (781 views tried)" was told of the wall of a box that lacks a path, and what is in the way only in a table of the report.
#[test]
fn what_is_in_the_way_is_the_fix_of_what_has_no_path_where_no_other_helps() {
    let pair = |a: &str, b: &str, without_path: usize, advice: Advice| Obstruction {
        bodies: Contact { a: a.into(), b: b.into() },
        without_station: 9,
        without_path,
        configuration: Configuration { joints_rad: [0.0; 6], table_rad: 0.0 },
        separation: None,
        advice,
    };
    let mut plan = Plan { stopped_because: StopReason::NoPath, ..plan(4, 1, 700.0) };
    plan.obstructions = vec![
        pair("flange", "part", 0, Advice::TurnPart),
        pair("base", "part", 51, Advice::MoveTable),
        pair("forearm", "part", 1, Advice::MountScanner),
    ];
    let none = || Some(remedy(RemedyKind::None, 0.0, &[]));
    plan.missed = vec![missed(Cause::NoPath, vec![none()])];
    let told = |plan: &Plan| group_of(plan).text;
    let table = "move the table away from the robot, or the part closer to the table's axis";
    let in_the_way = "(base and part meet on the straight move to 51 candidates)";
    assert_eq!(
        told(&plan),
        format!(
            "1 spot, 1.00 % of asked, no safe path found: the part hits the robot's foot as the table turns: {table} {in_the_way}"
        )
    );
    let unsearched = Plan { missed: vec![missed(Cause::NoPath, vec![None])], ..plan.clone() };
    assert!(told(&unsearched).ends_with(in_the_way), "{}", told(&unsearched));
    let turned = Plan { missed: vec![missed(Cause::NoPath, vec![Some(remedy(RemedyKind::Setup, 1.0, &[4]))])], ..plan.clone() };
    assert!(!told(&turned).contains(in_the_way), "a fix that was simulated comes first: {}", told(&turned));
    let other_cause = Plan { missed: vec![missed(Cause::ShadowLeft, vec![none()])], ..plan.clone() };
    let other_end = Plan { stopped_because: StopReason::MaxViews, ..plan.clone() };
    let nothing_in_the_way = Plan { obstructions: vec![pair("flange", "part", 0, Advice::TurnPart)], ..plan };
    for plan in [other_cause, other_end, nothing_in_the_way] {
        assert!(told(&plan).contains(": no fix found ("), "{}", told(&plan));
    }
}

/// "Next: turn it upside down" and "no fix found" were told of a part around the home of the cell.
#[test]
fn where_the_home_is_blocked_the_home_is_the_best_action_and_the_fix_of_what_has_no_path() {
    let mut plan = plan(3, 3, 0.0);
    plan.advice = vec![advice()];
    let turned = Some(remedy(RemedyKind::Setup, 1.0, &[4]));
    plan.missed = vec![
        missed(Cause::FacesTable, vec![None]),
        missed(Cause::NoPath, vec![Some(remedy(RemedyKind::None, 0.0, &[])), turned, None]),
    ];
    let warning = FieldWarning {
        code: WarningCode::HomeBlocked,
        pointer: "/cell/home_deg".to_owned(),
        detail: "lets forearm and part collide".to_owned(),
        remedy: "give the cell another home (`vantage cell --home`)".to_owned(),
    };
    let free = Summary::of(&plan);
    let other = FieldWarning { code: WarningCode::HomeTooClose, ..warning.clone() };
    let too_close = PlanDoubts { warnings: std::slice::from_ref(&other), ..PlanDoubts::default() };
    assert_eq!(free.clone().with_doubts(&too_close), free);
    let warnings = [other, warning];
    let blocked = free.clone().with_doubts(&PlanDoubts { warnings: &warnings, ..PlanDoubts::default() });
    assert_eq!(
        blocked.next_text().as_deref(),
        Some("Next: give the cell another home (vantage cell --home); effect not estimated")
    );
    let action = blocked.action.as_ref().expect("an action");
    assert!(action.set.is_empty() && action.command.is_none() && action.added_views == 0, "{action:?}");
    let texts: Vec<&str> = blocked.missed.iter().map(|group| group.text.as_str()).collect();
    assert_eq!(
        texts,
        [
            "3 spots, 3.00 % of asked, no safe path found: give the cell another home (vantage cell --home)",
            "1 spot, 1.00 % of asked, faces the table: no fix searched for",
        ]
    );
    assert_eq!((blocked.missed[0].fix, blocked.missed[0].command()), (None, None));
    // A part that tips over is placed first, and what has no path still needs another home.
    let placed = free.with_doubts(&PlanDoubts { warnings: &warnings, ..does_not_stand(&StandingRemedy::InPosesOfPlanner) });
    let next = placed.next_text().expect("an action");
    assert!(next.starts_with("Next: let Vantage choose setups"), "{next}");
    assert_eq!(placed.missed, blocked.missed);
}

#[test]
fn a_summary_is_read_back_as_it_was_written_and_names_its_plan() {
    let mut plan = plan(3, 0, 792.0);
    plan.missed = vec![missed(Cause::ShadowLeft, vec![None, Some(remedy(RemedyKind::Tilt, 1.0, &[4]))])];
    plan.advice = vec![advice()];
    let summary = Summary::of(&plan).of_file("ab".repeat(32));
    let text = serde_json::to_string(&summary).expect("JSON");
    assert_eq!(serde_json::from_str::<Summary>(&text).expect("its own document"), summary);
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!((&json["verdict"], &json["missed"][0]["reason"]), (&json!("partly_measured"), &json!("shadow_left")));
    assert_eq!((&json["plan_sha256"], &json["cycle_secs"]), (&json!("ab".repeat(32)), &json!(null)));
    // A row of a table, not a plan: the lines and the numbers together are a few kilobytes.
    assert!(text.len() < 5_000, "{} bytes", text.len());
}

#[test]
fn the_shares_are_those_that_head_every_output() {
    let summary = Summary::of(&plan(3, 0, 792.0));
    assert_eq!(
        summary.coverage_text,
        "Simulated coverage, independent check: 88.00 % of visible (0.00 % at grade A or B, 0.00 % within 35°, 0.00 % within 60°), \
         79.20 % of asked, 79.20 % of the whole surface; on the samples that views are chosen on: 99.00 % of coverable"
    );
    let shares = [summary.coverage.of_visible, summary.coverage.of_asked, summary.coverage.of_coverable];
    assert!(shares.iter().zip([0.88, 0.792, 0.99]).all(|(is, wanted)| (is - wanted).abs() < 1e-12), "{shares:?}");
}

/// The summary named shares without their meanings, and the page had other words for three of them.
#[test]
fn the_summary_has_the_table_of_shares_with_their_meanings() {
    let plan = plan(3, 0, 792.0);
    let (summary, figures) = (Summary::of(&plan), headline(&CoverageDocument::from(&plan.coverage)));
    assert_eq!(summary.headline.len(), figures.len());
    for (told, figure) in summary.headline.iter().zip(figures) {
        assert_eq!((told.name.as_str(), told.meaning.as_str()), (figure.name, figure.meaning));
        assert_eq!((told.share, told.independent), (figure.share, told.name != "measured of coverable"));
        assert!(!told.meaning.is_empty() && !told.meaning.ends_with('.'), "{}", told.meaning);
    }
    let names: Vec<&str> = summary.headline.iter().map(|told| told.name.as_str()).collect();
    assert!(names.starts_with(&["measured of visible", "grades A and B of visible"]) && names.ends_with(&["measured of total"]));
}

fn stability(resistance: f64) -> Stability {
    Stability {
        shared_area_mm2: 1200.0,
        resistance,
        turn_in_part: Vector3::zeros(),
        shift_in_part: Vector3::z(),
        centre_in_part_mm: Point3::origin(),
        expected_error_mm: Some(0.000_42),
    }
}

/// The summary told of setups without the pairs of them.
#[test]
fn the_summary_has_the_registration_of_each_pair_of_setups() {
    let stability = stability(0.05);
    let joined = Plan { setup_links: vec![SetupLink { setups: [SetupId(0), SetupId(1)], stability }], ..plan(3, 0, 792.0) };
    let told = serde_json::to_value(Summary::of(&joined)).expect("JSON");
    let pair = json!({
        "setups": [0, 1], "shared_area_mm2": 1200.0, "fixed": true, "resistance": 0.05,
        "weakest": "sliding along (0.00 0.00 1.00)", "expected_error_mm": 0.000_42,
    });
    assert_eq!(told["setup_links"], json!([pair]));
    assert_eq!(serde_json::from_value::<Summary>(told).expect("its own document"), Summary::of(&joined));
    let single = serde_json::to_value(Summary::of(&plan(3, 0, 792.0))).expect("JSON");
    assert!(single.get("setup_links").is_none(), "{single}");
}

/// Pose errors were told in details and in no field of the summary.
#[test]
fn the_worst_shares_under_pose_errors_stand_beside_the_shares_of_the_plan() {
    let mut plan = plan(3, 0, 792.0);
    assert_eq!(Summary::of(&plan).coverage.under_pose_errors, None);
    let drawn = |draws: usize, worst: f64| Drawn::new(1.0, [vec![1.0; draws - 1], vec![worst]].concat());
    let pose_error = PoseErrorParams { angle_deg: 0.004_691, translation_mm: 2.0 };
    plan.coverage.robust = Some(Robust { pose_error, views: drawn(21, 0.999_96), part: drawn(7, 0.75), hand_eye: drawn(1, 0.5) });
    let summary = Summary::of(&plan);
    let told = "; if poses are off by 0.00469° and 2 mm, at worst 50.00 % of asked; on the samples that views are chosen on: ";
    assert!(summary.coverage_text.contains(told), "{}", summary.coverage_text);
    let shares = serde_json::to_value(summary.coverage.under_pose_errors).expect("JSON");
    let expected = json!({
        "pose_error": {"angle_deg": 0.004_691, "translation_mm": 2.0}, "of_asked": 0.5,
        "each_view": {"of_asked": 0.999_96, "draws": 21}, "part": {"of_asked": 0.75, "draws": 7},
        "hand_eye": {"of_asked": 0.5, "draws": 1}
    });
    assert_eq!(shares, expected);
    let calibrated: CalibrationProvenance = serde_json::from_value(json!({
        "by": "vantage", "at": "2026-11-20T09:00:00Z", "calibration_id": "ab", "data_sha256": "cd", "rms_rotation_deg": 0.01,
        "rms_translation_mm": 0.1, "point_sd_mm": 0.05, "rotation_sd_deg": 0.005, "translation_sd_mm": 0.04
    }))
    .expect("a provenance");
    let told = summary.with_calibration(Some(&calibrated));
    assert!(!told.coverage_text.contains("calibration"), "another error was asked for: {}", told.coverage_text);
    if let Some(robust) = &mut plan.coverage.robust {
        robust.pose_error = PoseErrorParams::of_calibration(&calibrated);
    }
    let told = Summary::of(&plan).with_calibration(Some(&calibrated));
    let source = "if poses are off by 0.02° and 0.2 mm (twice the uncertainty of the cell's calibration), at worst ";
    assert!(told.coverage_text.contains(source), "{}", told.coverage_text);
    plan.coverage.is_of_open = true;
    let of_open = Summary::of(&plan).coverage_text;
    assert!(of_open.contains(", at worst 50.00 % of the open area; "), "{of_open}");
}

#[test]
fn nothing_missed_is_not_minus_nothing() {
    let listing = crate::wire::missed::json(&plan(3, 0, 1000.0), "");
    assert!(listing.missed_area_mm2.is_sign_positive(), "{listing:?}");
}

/// 50.4 → 50.4 % was told.
#[test]
fn an_action_of_little_effect_is_told_with_the_digits_that_show_it() {
    let action = |measured_area_mm2: f64, cycle_secs: Option<f64>| {
        let mut plan = plan(3, 0, 504.0);
        plan.setups[0].sequence = cycle_secs.map(|secs| Sequence {
            visits: Vec::new(),
            return_home: Leg {
                via_rad: Vec::new(),
                target: Station { table_angle_rad: 0.0, joints_rad: [0.0; 6] },
                duration_secs: secs,
                passed_within_rad: None,
                turning_secs: 0.0,
            },
            ordered_secs: secs,
            lower_bound_secs: secs,
            moving_lower_secs: secs,
        });
        let cycle_secs = cycle_secs.map(|secs| secs - 0.01);
        plan.advice = vec![PlanAdvice { measured_area_mm2, cycle_secs, regions_met: Vec::new(), ..advice() }];
        let text = Summary::of(&plan).action.expect("advice").text;
        text.split_once("; estimated effect: ").expect("an effect").1.to_owned()
    };
    assert_eq!(action(504.2, None), "50.40 → 50.42 % of asked, about +2 views");
    assert_eq!(action(504.0, None), "50.4 % of asked, unchanged, about +2 views");
    assert_eq!(
        action(979.0, Some(9.0)),
        "50.4 → 97.9 % of asked, about +2 views, about the same cycle time (without laying it anew)"
    );
}
