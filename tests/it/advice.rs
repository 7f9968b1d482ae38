//! Advice on a plan as a whole, taken: the plan that it promises is made, and gives what was said; and nothing is advised where
//! nothing helps. With it what a plan says of pose errors that it does not tolerate.

use std::sync::atomic::AtomicBool;

use vantage::cell::{Cell, PoseSpec, Presets, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{
    CandidateParams, Hemisphere, Objective, PlanParams, PoseErrorParams, Region, Registration, Solver,
};
use vantage::planning::plan::{AdviceKind, Outcome, ParamChange, Plan, PlanAdvice, TurnKind};
use vantage::planning::sequence::Sequence;
use vantage::planning::{PlanInput, plan};
use vantage::report::text::text;
use vantage::wire::echo::Echo;
use vantage::wire::plan::PlanDocument;
use vantage::wire::summary::PlanVerdict;
use vantage::wire::warnings::WarningCode;

use crate::support::{box_mesh, nominal_scanner, plan_viewpoints};

/// A block that is likeliest to come to rest on its top or on its bottom.
fn block() -> Mesh {
    box_mesh([0.0; 3], [60.0, 40.0, 30.0])
}

/// A lid of 90 × 70 × 30 mm, open at the bottom.
fn lid() -> Mesh {
    let mut lid = box_mesh([-45.0, -35.0, 0.0], [45.0, 35.0, 30.0]);
    let inside = box_mesh([-40.0, -30.0, 0.0], [40.0, 30.0, 22.5]);
    let first = lid.vertices_mm.len() as u32;
    // The first two faces of a box are its bottom.
    let inwards = inside.faces[2..].iter().map(|[a, b, c]| [first + a, first + c, first + b]);
    let edges: [[u32; 2]; 4] = [[0, 1], [1, 3], [3, 2], [2, 0]];
    let rim = edges.iter().flat_map(|[a, b]| [[*a, first + a, *b], [*b, first + a, first + b]]);
    lid.faces = lid.faces[2..].iter().copied().chain(inwards).chain(rim).collect();
    lid.source_face = (0..lid.faces.len() as u32).collect();
    lid.vertices_mm.extend(inside.vertices_mm);
    lid
}

/// Viewpoints above the plate alone, few of them, on few samples.
fn quick(registration: Registration) -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), registration, ..PlanParams::default() };
    params.candidates.hemisphere = Some(Hemisphere::AboveTable);
    params.part.samples_per_mm2 = Some(0.3);
    params.missed.remedies = 0;
    params
}

/// The parameters with an advice taken.
fn taken(params: &PlanParams, advice: &PlanAdvice) -> PlanParams {
    let mut params = params.clone();
    for change in &advice.changes {
        match change {
            ParamChange::Setups(setups) => params.setups = *setups,
            ParamChange::RestingPoses(poses) => params.part.resting_poses = poses.iter().map(PoseSpec::from).collect(),
            ParamChange::Registration(registration) => params.registration = *registration,
            ParamChange::Target(target) => params.selection.target = *target,
            ParamChange::MaxViews(views) => params.selection.max_views = Some(*views),
            ParamChange::MinGradeA(share) => params.selection.min_grade_a = Some(*share),
        }
    }
    params
}

/// The advice to plan in one more setup.
fn turn_over(plan: &Plan) -> &PlanAdvice {
    let found = plan.advice.iter().find(|advice| advice.kind == AdviceKind::TurnOver);
    found.unwrap_or_else(|| panic!("{:?}", plan.advice))
}

/// Holds a plan against the advice that promised it: no more than a point of the asked area less, and hardly more views.
fn hold(advice: &PlanAdvice, made: &Plan) {
    let promised = advice.measured_area_mm2 / made.coverage.asked_area_mm2;
    println!(
        "promised {promised:.4} with {} views; made {:.4} with {}",
        advice.views,
        made.coverage.of_asked(),
        made.views.len()
    );
    assert!(made.coverage.of_asked() >= promised - 0.01, "{} of {promised}", made.coverage.of_asked());
    assert!(made.views.len() <= advice.views + 2, "{} views, {} promised", made.views.len(), advice.views);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_block_whose_underside_is_missed_is_turned_upside_down() {
    let (mesh, params) = (block(), quick(Registration::None));
    let before = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan;
    let advice = turn_over(&before);
    assert_eq!(advice.changes, [ParamChange::Setups(2)]);
    assert_eq!(advice.turn.map(|turn| turn.kind), Some(TurnKind::UpsideDown));
    assert!(advice.cycle_secs.is_none(), "no cell, no time: {advice:?}");
    // In two setups a view of each side measures the block: those of the first alone may be given up.
    assert_eq!(advice.added_views, advice.views.saturating_sub(before.views.len()), "{advice:?}");
    // The underside is 2400 of 10 800 mm², of which the target leaves 1.5 %.
    let share = |mm2: f64| mm2 / before.coverage.asked_area_mm2;
    assert!(before.coverage.of_asked() < 0.78 && share(advice.measured_area_mm2) > 0.98, "{advice:?}");
    let after = plan_viewpoints(&mesh, &nominal_scanner(), &taken(&params, advice)).plan;
    hold(advice, &after);
    assert!((share(advice.visible_area_mm2) - 1.0).abs() < 1e-9, "{advice:?}");
    // The setups of that plan are told in the same words.
    assert!(text(&after).contains("\n  2: upside down; "), "{}", text(&after));
}

/// The further setup is tried on 10 000 of these samples, and what is promised is what all of them say.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_part_of_many_samples_is_promised_no_more_than_a_plan_of_all_of_them_measures() {
    let (mesh, mut params) = (block(), quick(Registration::None));
    params.part.samples_per_mm2 = Some(3.0);
    (params.robust.pose_error, params.selection.target) = (None, 0.97);
    let before = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan;
    let advice = turn_over(&before);
    assert_eq!(advice.turn.map(|turn| turn.kind), Some(TurnKind::UpsideDown));
    assert!(advice.measured_area_mm2 > 0.96 * before.coverage.asked_area_mm2, "{advice:?}");
    hold(advice, &plan_viewpoints(&mesh, &nominal_scanner(), &taken(&params, advice)).plan);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn setups_and_advice_of_a_plan_are_in_its_document() {
    let (mesh, scanner, params) = (block(), nominal_scanner(), quick(Registration::None));
    let document =
        |params: &PlanParams| PlanDocument::new(&plan_viewpoints(&mesh, &scanner, params), &scanner, None, Echo::default());
    let before = document(&params);
    let advice = before.advice.iter().find(|advice| advice.kind == "turn_over").expect("advice");
    assert!(advice.text.starts_with("turn it upside down and scan again, "), "{}", advice.text);
    assert_eq!((advice.options().as_str(), advice.set.len()), ("--set setups=2", 1));
    let read: PlanDocument = serde_json::from_slice(&before.to_bytes()).expect("its own document");
    assert_eq!(read.advice, before.advice);
    let after = document(&PlanParams { setups: 2, ..params });
    let turns: Vec<_> = after.setups.iter().map(|setup| setup.turn.as_ref().map(|turn| turn.text.as_str())).collect();
    assert_eq!(turns, [None, Some("turn it upside down")]);
}

/// Beside the pose that it is filed in, none that shares enough surface shows all of its inside: a plan in two setups leaves that pose.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_lid_is_advised_the_setups_that_a_plan_in_two_chooses_by_itself() {
    let (mesh, params) = (lid(), quick(Registration::Surface));
    let before = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan;
    let advice = turn_over(&before);
    assert_eq!((advice.changes.as_slice(), advice.turn), ([ParamChange::Setups(2)].as_slice(), None), "{advice:?}");
    assert!(before.coverage.of_asked() < 0.6, "{}", before.coverage.of_asked());
    // On its right side beside the first pose, 95.3 % could be measured at most, of which the target leaves 1.5 %.
    let promised = advice.measured_area_mm2 / before.coverage.asked_area_mm2;
    assert!(promised > 0.95, "{promised}: {advice:?}");
    let after = plan_viewpoints(&mesh, &nominal_scanner(), &taken(&params, advice)).plan;
    let poses = |plan: &Plan| plan.setups.iter().map(|setup| setup.table_from_part).collect::<Vec<_>>();
    assert_eq!(advice.setups.iter().map(|setup| setup.table_from_part).collect::<Vec<_>>(), poses(&after));
    assert!(!poses(&after).contains(&poses(&before)[0]), "it lies otherwise in both");
    hold(advice, &after);
}

/// Upside down the block shares its walls alone with how it lay before, along which the two would slide.
#[test]
#[ignore = "long: tests/all runs it"]
fn setups_that_have_to_be_registered_by_surface_are_advised_so_that_they_can_be() {
    let (mesh, params) = (block(), quick(Registration::Surface));
    let before = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan;
    let advice = turn_over(&before);
    assert_eq!(advice.turn.map(|turn| turn.kind), Some(TurnKind::OnSide), "{advice:?}");
    assert_eq!(advice.changes, [ParamChange::Setups(2)]);
    hold(advice, &plan_viewpoints(&mesh, &nominal_scanner(), &taken(&params, advice)).plan);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn setups_that_no_surface_registers_are_advised_with_markers() {
    let mesh = block();
    let mut params = quick(Registration::Surface);
    let free = plan_viewpoints(&mesh, &nominal_scanner(), &quick(Registration::None)).plan;
    // No pose to choose from but upside down.
    params.part.resting_poses = turn_over(&free).table_from_part.iter().map(PoseSpec::from).collect();
    let before = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan;
    let advice = turn_over(&before);
    assert_eq!(advice.turn.map(|turn| turn.kind), Some(TurnKind::UpsideDown), "{advice:?}");
    assert!(advice.changes.contains(&ParamChange::Registration(Registration::Markers)), "{:?}", advice.changes);
    // The pose that it lies in is not among those given, so both have to be.
    assert!(advice.changes.iter().any(|change| matches!(change, ParamChange::RestingPoses(poses) if poses.len() == 2)));
    hold(advice, &plan_viewpoints(&mesh, &nominal_scanner(), &taken(&params, advice)).plan);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn nothing_is_advised_where_nothing_helps_or_none_is_asked_for() {
    let (mut block, void) = (block(), box_mesh([20.0, 10.0, 10.0], [40.0, 30.0, 20.0]));
    let first = block.vertices_mm.len() as u32;
    block.vertices_mm.extend(&void.vertices_mm);
    block.faces.extend(void.faces.iter().map(|[a, b, c]| [first + a, first + c, first + b]));
    block.source_face = (0..block.faces.len() as u32).collect();
    let mut params = quick(Registration::None);
    params.selection.target = 1.0;
    params.regions.exclude = vec![Region::Faces { faces: vec![0, 1] }];
    let plan = plan_viewpoints(&block, &nominal_scanner(), &params).plan;
    assert!(plan.coverage.of_asked() < 0.9, "the cavity is missed: {}", plan.coverage.of_asked());
    let for_coverage = |plan: &Plan| plan.advice.iter().filter(|advice| advice.kind != AdviceKind::BetterGrades).count();
    assert_eq!(for_coverage(&plan), 0, "{:?}", plan.advice);
    // With the underside asked for there is advice, unless it is turned off.
    params.regions.exclude.clear();
    assert_eq!(for_coverage(&plan_viewpoints(&block, &nominal_scanner(), &params).plan), 1);
    params.missed.advice = false;
    assert_eq!(plan_viewpoints(&block, &nominal_scanner(), &params).plan.advice, []);
}

#[test]
fn views_that_a_limit_keeps_out_are_advised_with_the_limit_that_lets_them_in() {
    let mesh = block();
    let mut params = quick(Registration::None);
    params.candidates.hemisphere = Some(Hemisphere::Full);
    (params.selection.solver, params.selection.objective) = (Solver::Greedy, Objective::Coverage);
    params.selection.max_views = Some(1);
    let before = plan_viewpoints(&mesh, &nominal_scanner(), &params).plan;
    let [advice] = &before.advice[..] else { panic!("{:?}", before.advice) };
    assert_eq!(advice.kind, AdviceKind::MoreViews);
    assert!(advice.changes.contains(&ParamChange::MaxViews(advice.views as u32)), "{advice:?}");
    assert_eq!(advice.views, 1 + advice.added_views);
    hold(advice, &plan_viewpoints(&mesh, &nominal_scanner(), &taken(&params, advice)).plan);
}

fn planned(mesh: &Mesh, cell: &Cell, params: &PlanParams) -> Outcome {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None };
    plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan")
}

#[test]
#[ignore = "long: tests/all runs it"]
fn advice_of_a_cell_tells_its_cycle_and_promises_views_that_the_cell_takes() {
    let cell: Cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let (mesh, params) = (block(), quick(Registration::Markers));
    let before = planned(&mesh, &cell, &params).plan;
    let over = turn_over(&before);
    let cycle_secs = |plan: &Plan| {
        let scan = &plan.params.scan;
        let moving_secs = plan.sequences().map(Sequence::motion_secs).sum::<f64>();
        moving_secs + plan.visits().count() as f64 * (scan.settle_secs + scan.capture_secs)
    };
    let said_secs = over.cycle_secs.expect("with a cell");
    assert!(said_secs > cycle_secs(&before), "{said_secs} and {}", cycle_secs(&before));
    let after = planned(&mesh, &cell, &taken(&params, over)).plan;
    println!("{said_secs:.1} s said, {:.1} s made", cycle_secs(&after));
    assert!(cycle_secs(&after) <= 1.5 * said_secs, "{said_secs} said, {} made", cycle_secs(&after));
    hold(over, &after);
}

#[test]
fn a_plan_that_pose_errors_cost_much_of_its_coverage_warns_and_one_that_tolerates_them_does_not() {
    let (mesh, scanner) = (block(), nominal_scanner());
    let warnings = |angle_deg: f64, translation_mm: f64| {
        let mut params = quick(Registration::None);
        params.robust.pose_error = Some(PoseErrorParams { angle_deg, translation_mm });
        let outcome = plan_viewpoints(&mesh, &scanner, &params);
        let document = PlanDocument::new(&outcome, &scanner, None, Echo::default());
        let told = text(&outcome.plan).contains("\nwarning, fragile_under_pose_error: robust.select is false, and an error of");
        assert_eq!(told, !document.warnings.is_empty(), "the report says what the document does");
        let verdict = if told { PlanVerdict::Fragile } else { PlanVerdict::PartlyMeasured };
        assert_eq!(PlanVerdict::of(&outcome.plan), verdict, "and so does the verdict");
        document.warnings
    };
    assert_eq!(warnings(0.01, 0.01), []);
    // 20° take the part, 480 mm away, out of a field 190 mm high.
    let [warning] = &warnings(20.0, 100.0)[..] else { panic!("one warning") };
    assert_eq!((warning.code, warning.pointer.as_str()), (WarningCode::FragileUnderPoseError, "/params/robust/select"));
    assert!(warning.remedy.contains("--set robust.select=true"), "{warning:?}");
}
