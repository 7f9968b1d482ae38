use nalgebra::Isometry3;

use super::*;
use crate::cell::{Body, CellDistances, HousingFace, PoseSpec, Presets, Shape, SpecKind, SpecLibrary};
use crate::geometry::{Mesh, Poll, stable_poses};
use crate::planning::params::{FeatureParams, InterestParams, PoseErrorParams, Region};
use crate::planning::plan::{Cause, Coverage, IndependentRegion, RegionCoverage, RegionKind, StopReason};
use crate::wire::plan::{DrawnDocument, MisplacedDocument};
use crate::wire::words::shortfall;

fn everywhere() -> Region {
    Region::Box { min_mm: [-1e3; 3], max_mm: [1e3; 3] }
}

fn params(tolerances_mm: &[f64]) -> PlanParams {
    let feature = |tolerance_mm: &f64| FeatureParams {
        name: None,
        region: everywhere(),
        tolerance_mm: *tolerance_mm,
        point_spacing_mm: None,
        target: Some(0.95),
    };
    let mut params = PlanParams::default();
    params.regions.features = tolerances_mm.iter().map(feature).collect();
    params
}

/// A feature of 900 mm² of which nothing is measured.
fn feature() -> RegionCoverage {
    RegionCoverage {
        name: "bore".into(),
        kind: RegionKind::Feature,
        samples: 90,
        asked_area_mm2: 900.0,
        coverable_area_mm2: 0.0,
        measured_area_mm2: 0.0,
        target: Some(0.95),
        tolerance_mm: Some(0.05),
        min_tolerance_mm: NoiseParams::default().min_tolerance_mm(),
        missed_mm2: vec![(Cause::BelowGrade, 850.0), (Cause::ShadowLeft, 50.0)],
        beyond_noise_area_mm2: 850.0,
        independent: None,
    }
}

#[test]
fn a_tolerance_beyond_the_noise_is_told_with_the_finest_that_is_served_and_what_moves_it() {
    let found = of_params(&params(&[0.2, 0.05, 0.156]), "/params");
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!(
        (found[0].code, found[0].pointer.as_str()),
        (WarningCode::ToleranceBeyondNoise, "/params/regions/features/1/tolerance_mm")
    );
    for said in [
        "is 0.05 mm, in a drawing ±0.025 mm",
        "0.156 mm, in a drawing ±0.078 mm",
        "regions.noise.best_mm (0.0117 mm)",
        "regions.noise.budget (0.3)",
        "VDA Volume 5",
        "our choice",
    ] {
        assert!(found[0].detail.contains(said), "{said:?} is not in {:?}", found[0].detail);
    }
    for knob in ["tolerance_mm", "regions.noise.best_mm", "regions.noise.budget"] {
        assert!(found[0].remedy.contains(knob), "{knob:?} is not in {:?}", found[0].remedy);
    }
}

/// Such a feature was planned without a word, and nothing of it could be measured.
#[test]
fn points_that_are_to_lie_closer_than_the_scanner_has_them_are_told_with_the_least_distance() {
    let scanner = Presets.scanner("transcan-c-nominal").expect("a preset").build().expect("sound");
    let min_mm =
        scanner.near_mm / scanner.devices.cameras().map(|camera| camera.lens.focal_px()).into_iter().fold(f64::MAX, f64::min);
    let mut params = params(&[0.5, 0.5, 0.5]);
    for (feature, spacing_mm) in params.regions.features.iter_mut().zip([None, Some(0.9 * min_mm), Some(1.1 * min_mm)]) {
        feature.point_spacing_mm = spacing_mm;
    }
    let found = of_spacing(&params, &scanner, "/params");
    assert_eq!(found.len(), 1, "{found:#?}");
    let place = "/params/regions/features/1/point_spacing_mm";
    assert_eq!((found[0].code, found[0].pointer.as_str()), (WarningCode::SpacingBeyondScanner, place));
    assert!(found[0].detail.contains(&format!("never closer than {} mm", rounded_up_mm(min_mm))), "{found:#?}");
}

/// A plan without a cell took the goal without a word.
#[test]
fn the_shortest_time_needs_a_cell() {
    let mut params = PlanParams::default();
    assert_eq!(of_goal(&params, false, ""), None);
    params.selection.goal = SelectionGoal::MinTime;
    assert_eq!(of_goal(&params, true, ""), None);
    let told = of_goal(&params, false, "/params").expect("a warning");
    assert_eq!((told.code, told.pointer.as_str()), (WarningCode::GoalNeedsCell, "/params/selection/goal"));
}

#[test]
fn knobs_of_the_noise_move_the_finest_tolerance_and_own_values_have_no_source_of_ours() {
    let mut params = params(&[0.05]);
    params.regions.noise.budget = 0.5;
    let told = &of_params(&params, "")[0].detail;
    assert!(told.contains("0.094 mm") && told.contains("budget (0.5)") && !told.contains("VDA"), "{told}");
    params.regions.noise.best_mm = 0.005;
    assert_eq!(of_params(&params, ""), [], "4 · 0.005 / 0.5 is 0.04 mm");
}

#[test]
fn an_unmet_region_is_named_at_its_target_with_its_causes() {
    let mut params = params(&[0.05]);
    let interest = InterestParams {
        name: None,
        region: everywhere(),
        weight: 1.0,
        target: None,
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    };
    params.regions.interest = vec![interest];
    let met = RegionCoverage { measured_area_mm2: 900.0, missed_mm2: Vec::new(), beyond_noise_area_mm2: 0.0, ..feature() };
    let regions = [met, feature()].map(|region| RegionCoverageDocument::from(&region));
    let found = of_regions(&params, &regions, "/params");
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!((found[0].code, found[0].pointer.as_str()), (WarningCode::RegionUnmet, "/params/regions/features/0/target"));
    assert_eq!(
        found[0].detail,
        "is 0.95, but 0.00 % of the 900.0 mm² of \"bore\" is measured; missed: not measured well enough (850.0 mm²; tolerance \
         too fine for the scanner's noise; the finest that this noise allows is ±0.078 mm), hidden from the left camera (50.0 mm²)"
    );
    assert!(found[0].remedy.contains("regions.noise.budget"), "{}", found[0].remedy);
}

/// "Tolerance too fine" and "give a coarser tolerance_mm" were told of a region of interest, which has none.
#[test]
fn a_tolerance_that_is_too_fine_is_told_of_the_feature_that_has_it() {
    let mut params = params(&[0.5, 0.05]);
    let top = InterestParams {
        name: Some("top".to_owned()),
        region: everywhere(),
        weight: 1.0,
        target: Some(0.9),
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    };
    params.regions.interest = vec![top];
    let interest = RegionCoverage { name: "top".into(), kind: RegionKind::Interest, tolerance_mm: None, ..feature() };
    let loose = RegionCoverage { name: "loose".into(), tolerance_mm: Some(0.5), ..feature() };
    let regions = [interest, loose, feature()].map(|region| RegionCoverageDocument::from(&region));
    let found = of_regions(&params, &regions, "/params");
    assert_eq!(found.len(), 3, "{found:#?}");
    for of_another in &found[..2] {
        let said = "; the tolerance of a feature that overlaps it is too fine for the scanner's noise;";
        assert!(of_another.detail.contains(said), "{}", of_another.detail);
        let remedy = "for the feature \"bore\" (regions.features.1.tolerance_mm), give a coarser tolerance_mm, ";
        assert!(of_another.remedy.starts_with(remedy), "{}", of_another.remedy);
    }
    assert!(found[2].detail.contains("; tolerance too fine for the scanner's noise;"), "{}", found[2].detail);
    assert!(found[2].remedy.starts_with("give a coarser tolerance_mm, "), "{}", found[2].remedy);
}

/// A target that only the samples of the choice reach was told as met, and nothing else.
#[test]
fn a_region_that_other_samples_refute_is_warned_of_and_is_not_unmet() {
    let params = params(&[0.2]);
    let independent = |measured_area_mm2: f64| {
        Some(IndependentRegion { samples: 400, asked_area_mm2: 900.0, measured_area_mm2, squares_mm4: 900.0 * 900.0 / 400.0 })
    };
    let told = |measured_area_mm2: f64| {
        let reached =
            RegionCoverage { measured_area_mm2: 870.0, missed_mm2: Vec::new(), beyond_noise_area_mm2: 0.0, ..feature() };
        let region = RegionCoverage { independent: independent(measured_area_mm2), ..reached };
        let regions = [RegionCoverageDocument::from(&region)];
        assert_eq!(of_regions(&params, &regions, ""), [], "it is not unmet");
        of_refuted_regions(&params, &regions, "/params")
    };
    let found = told(810.0);
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!((found[0].code, found[0].pointer.as_str()), (WarningCode::RegionUnconfirmed, "/params/regions/features/0/target"));
    assert_eq!(
        found[0].detail,
        "is 0.95; \"bore\" reaches it on the samples that views were chosen on, but not on 400 others: 90.00 %, standard error 1.50 points"
    );
    assert_eq!(told(850.0), [], "94.4 % with a standard error of 1.2 points does not refute 95 %");
}

#[test]
fn a_shortfall_names_causes_by_area_and_says_where_noise_is_a_part_of_it() {
    let partly = RegionCoverage { beyond_noise_area_mm2: 12.0, ..feature() };
    let told = shortfall(&partly).unwrap_or_default();
    let begins = "not measured well enough (850.0 mm²; tolerance too fine for the scanner's noise on 12.0 mm²;";
    assert!(told.starts_with(begins), "{told}");
    let without_noise = RegionCoverage { beyond_noise_area_mm2: 0.0, ..feature() };
    assert_eq!(
        shortfall(&without_noise).as_deref(),
        Some("not measured well enough (850.0 mm²), hidden from the left camera (50.0 mm²)"),
        "in words, not in names of the files"
    );
    let empty = RegionCoverage { samples: 0, asked_area_mm2: 0.0, missed_mm2: Vec::new(), ..feature() };
    assert_eq!(shortfall(&empty).as_deref(), Some("it contains none of the asked surface"));
    assert_eq!(shortfall(&RegionCoverage { target: None, ..feature() }), None);
    assert_eq!(shortfall(&RegionCoverage { measured_area_mm2: 860.0, ..feature() }), None);
}

/// A plan that measures 97.1 % and so much less in the worst draw of each kind.
fn losing([views, part, hand_eye]: [f64; 3]) -> RobustDocument {
    let drawn = |loss: f64| DrawnDocument { nominal: 0.971, worst: 0.971 - loss, p5: 0.971 - loss, mean: 0.971 };
    RobustDocument {
        pose_error: PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 },
        draws: 5,
        of_asked: drawn(views),
        part: MisplacedDocument { draws: 5, of_asked: drawn(part) },
        hand_eye: Some(MisplacedDocument { draws: 5, of_asked: drawn(hand_eye) }),
    }
}

#[test]
fn a_plan_that_loses_more_than_a_point_is_fragile_and_says_which_knob_helps() {
    let mut params = PlanParams::default();
    let found = of_robust(&params, &losing([0.004, 0.0231, 0.012]), (false, StopReason::Target), "/params").expect("fragile");
    assert_eq!((found.code, found.pointer.as_str()), (WarningCode::FragileUnderPoseError, "/params/robust/select"));
    assert_eq!(
        found.detail,
        "is false, and an error of the part and its support by 1° and 1 mm costs 2.31 percentage points of coverage in the worst of 5 \
         draws: 94.79 % of the asked area instead of 97.10 %; a plan that tolerates it loses no more than 1.0 points"
    );
    assert!(found.remedy.contains("--set robust.select=true"), "{}", found.remedy);
    params.robust.select = true;
    let found =
        of_robust(&params, &losing([0.004, 0.0231, 0.012]), (false, StopReason::Target), "").expect("fragile all the same");
    assert!(found.detail.starts_with("is true, and yet") && !found.remedy.contains("robust.select"), "{found:?}");
    // A larger target changes nothing where something else ended the choice.
    for (stopped_because, knob) in
        [(StopReason::MaxViews, "raise selection.max_views"), (StopReason::Growth, "lower selection.min_growth")]
    {
        let found =
            of_robust(&params, &losing([0.004, 0.0231, 0.012]), (false, stopped_because), "").expect("fragile all the same");
        assert!(found.remedy.starts_with(knob) && !found.remedy.contains("selection.target"), "{}", found.remedy);
    }
    let of_rescan = |stopped_because| of_robust(&params, &losing([0.004, 0.0231, 0.012]), (true, stopped_because), "");
    assert!(of_rescan(StopReason::MaxViews).is_some_and(|found| found.remedy.starts_with("raise max_views of the rescan")));
    assert!(of_rescan(StopReason::Growth).is_some_and(|found| found.remedy.starts_with("lower min_gain of the rescan")));
    // Shares of a plan of further views are of what earlier scans left open.
    let further =
        of_robust(&params, &losing([0.004, 0.0231, 0.012]), (true, StopReason::Target), "").expect("fragile all the same");
    assert_eq!(further.detail, found.detail.replace("asked area", "open area"));
    assert_ne!(further.detail, found.detail);
}

#[test]
fn a_plan_with_less_at_grade_a_than_asked_for_says_so_and_what_to_change() {
    let mut coverage = CoverageDocument::from(&Coverage::default());
    coverage.grades.a = 0.6194;
    let asked = |share| {
        let mut params = PlanParams::default();
        params.selection.min_grade_a = share;
        params
    };
    let told = |coverage: &CoverageDocument, share| of_grade_a(&asked(share), coverage, "/params");
    let found = told(&coverage, Some(0.7)).expect("less than asked for");
    assert_eq!((found.code, found.pointer.as_str()), (WarningCode::GradeAUnmet, "/params/selection/min_grade_a"));
    assert_eq!(found.detail, "is 0.7; the views measure 61.94 % of the asked area at grade A");
    assert!(found.remedy.contains("candidates.even_directions"), "{}", found.remedy);
    let mut limited = asked(Some(0.7));
    (limited.selection.max_views, coverage.curve) = (Some(2), vec![0.6, 0.8]);
    let found = of_grade_a(&limited, &coverage, "/params").expect("less than asked for");
    assert!(found.remedy.starts_with("raise selection.max_views"), "{}", found.remedy);
    assert_eq!(told(&coverage, Some(0.6194)), None);
    assert_eq!(told(&coverage, None), None);
    // Further views are chosen by what they are expected to add.
    coverage.of_open = true;
    assert_eq!(told(&coverage, Some(0.7)), None);
}

#[test]
fn a_plan_that_loses_less_is_not_warned_of() {
    let params = PlanParams::default();
    assert_eq!(of_robust(&params, &losing([0.009, 0.008, 0.0]), (false, StopReason::Target), ""), None);
    let without_hand_eye = RobustDocument { hand_eye: None, ..losing([0.0, 0.0, 0.5]) };
    assert_eq!(of_robust(&params, &without_hand_eye, (false, StopReason::Target), ""), None);
}

#[test]
fn a_home_that_is_free_only_without_the_clearance_is_warned_of() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    assert_eq!(of_cell(&cell, "/cell"), []);
    let scene = CollisionScene::without_part(&cell, 400.0);
    let warning = home_too_close(&cell, &scene, 400.0, "/cell").expect("nothing is that far apart");
    assert_eq!((warning.code.as_str(), warning.pointer.as_str()), ("home_too_close", "/cell/home_deg"));
    assert!(warning.detail.contains(" and ") && warning.detail.contains("closer together than 400 mm"), "{}", warning.detail);
}

/// The cell was sound, and its plans drove the scanner through the forearm.
#[test]
fn a_scanner_that_lies_within_the_forearm_is_warned_of_with_the_bodies_and_the_cure() {
    let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let mut flange_from_scanner = *cell.flange_from_scanner.isometry();
    flange_from_scanner.translation.vector.z *= -1.0;
    cell.flange_from_scanner = Pose::claim(flange_from_scanner);
    let mut found = of_cell(&cell, "/cell");
    found.retain(|warning| warning.code == WarningCode::LoadOverlapsArm && warning.detail.contains("\"forearm\""));
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!((found[0].code.as_str(), found[0].pointer.as_str()), ("load_overlaps_arm", "/cell/flange_from_scanner"));
    for said in ["\"scanner body\"", "in every posture that was tried", "NOT checked"] {
        assert!(found[0].detail.contains(said), "{said:?} is not in {:?}", found[0].detail);
    }
    for cure in ["signs of flange_from_scanner", "longer adapter", "vantage robot --surfaces"] {
        assert!(found[0].remedy.contains(cure), "{cure:?} is not in {:?}", found[0].remedy);
    }
}

#[test]
fn a_body_of_the_mount_that_overlaps_the_forearm_is_named_at_its_place() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let pair = Contact { a: "forearm".into(), b: "adapter".into() };
    let warning = load_overlaps_arm(&cell, &pair, "");
    assert_eq!(warning.pointer, "/mount/0");
    assert!(warning.remedy.contains("owner_from_body") && !warning.remedy.contains("longer"), "{}", warning.remedy);
}

/// The cell was sound, and its plans had "Target met" at their head.
#[test]
fn a_scanner_that_looks_back_through_the_wrist_is_warned_of_with_device_share_and_cure() {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    spec.flange_from_scanner = PoseSpec { translation_mm: [0.0, 0.0, 30.0], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] };
    let found = of_sight(&spec.build(&Presets).expect("nothing else is wrong with it"), "/cell");
    let arm = found.iter().find(|warning| warning.pointer == "/cell/flange_from_scanner").expect("the arm hides the field");
    assert_eq!(arm.code.as_str(), "mount_hides_field");
    for said in ["\"flange\"", "\"wrist\"", "100 % of the projector's field at 480 mm", "the left camera's field", "joint 6"] {
        assert!(arm.detail.contains(said), "{said:?} is not in {:?}", arm.detail);
    }
    // What costs a look into a file comes before what costs a wrench.
    let [checked, turned] = ["check flange_from_scanner", "turn the scanner"].map(|words| arm.remedy.find(words));
    assert!(checked == Some(0) && turned > checked && arm.remedy.contains("inverted"), "{}", arm.remedy);
    let mount = found.iter().find(|warning| warning.pointer == "/cell/mount/0").expect("the adapter hides it too");
    assert!(mount.detail.starts_with("puts \"adapter\" between the scanner and its field: it hides 100 %"), "{}", mount.detail);
    assert!(mount.remedy.starts_with("check the body's shape and owner_from_body"), "{}", mount.remedy);
}

#[test]
fn a_clip_before_a_corner_of_the_field_is_warned_of_without_blame_of_the_pose() {
    let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let owner_from_body = Isometry3::translation(295.0, 75.0, 140.0);
    cell.mount.push(Body { name: "clip".into(), owner_from_body, shape: Shape::Box { size_mm: [4.0, 50.0, 30.0] } });
    let found = of_cell(&cell, "");
    let [clip] = &found[..] else { panic!("{found:#?}") };
    assert_eq!((clip.code, clip.pointer.as_str()), (WarningCode::MountHidesField, "/mount/1"));
    assert!(clip.detail.contains("% of the projector's field at ") && clip.detail.contains(" in every view"), "{}", clip.detail);
    assert!(clip.remedy.starts_with("move the body out") && !clip.remedy.contains("inverted"), "{}", clip.remedy);
}

/// A pose that is right was all that the remedy blamed, where the capsule of a link bulges into the field.
#[test]
fn bodies_that_hide_little_are_told_to_be_coarser_than_the_real_ones_perhaps() {
    for (place, said) in [
        (HiderPlace::Arm, ["short capsule", "hollow housing", "--surfaces"]),
        (HiderPlace::Scanner(0), ["coarser than the real body", "hollow housing", "mesh"]),
        (HiderPlace::Mount(0), ["coarser than the real body", "hollow one", "mesh"]),
    ] {
        let remedy = sight_remedy(place, false);
        assert!(said.iter().all(|word| remedy.contains(word)), "{remedy}");
    }
}

/// The remedy was a command that reads a URDF, which who names a preset does not have.
#[test]
fn a_mount_that_overlaps_the_forearm_of_a_preset_is_told_with_a_remedy_for_presets() {
    let devices = CellDistances {
        name: "cell".into(),
        scanner: "transcan-c-nominal".into(),
        robot: "abb-irb2400-10".into(),
        turntable: "minas-a6-500".into(),
        table_at_mm: [1000.0, 0.0, 300.0],
        table_yaw_deg: 0.0,
        mount: HousingFace::Back,
        adapter_mm: 30.0,
        adapter_kg: 0.0,
        floor_mm: None,
        pedestal: false,
        home_deg: None,
    };
    let cell = devices.spec(&Presets).expect("in range").build(&Presets).expect("a sound cell");
    let found = of_cell(&cell, "");
    let overlap = found.iter().find(|warning| warning.code == WarningCode::LoadOverlapsArm).expect("the adapter overlaps");
    assert_eq!(overlap.pointer, "/mount/0");
    for cure in
        ["vantage robot --surfaces", "vantage presets NAME", "limits of joint 5", "\"link 4\" and \"adapter\" cannot meet"]
    {
        assert!(overlap.remedy.contains(cure), "{cure:?} is not in {:?}", overlap.remedy);
    }
}

#[test]
fn cells_that_are_shipped_are_not_warned_of() {
    for name in Presets.names(SpecKind::Cell) {
        let cell = Presets.cell(&name).expect("a preset").build(&Presets).expect("a valid preset");
        assert_eq!(of_cell(&cell, ""), [], "{name}");
    }
}

/// The causes told were those of views, and laying the part another way was the advice.
#[test]
fn a_home_within_the_part_is_warned_of_once_with_the_bodies_and_the_cure() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let flange_mm = cell.base_from_table.inverse().point(&cell.robot.base_from_flange(&cell.home_rad.joints_rad).origin_mm());
    let scene = |middle_mm: [f64; 3]| {
        let block = crate::testing::box_mesh(middle_mm.map(|mm| mm - 20.0), middle_mm.map(|mm| mm + 20.0));
        CollisionScene::new(&cell, &block, None, &Pose::identity(), 5.0)
    };
    let (inside, clear) = (scene(flange_mm.into()), scene([0.0, 0.0, 21.0]));
    assert_eq!(of_home(&cell, std::slice::from_ref(&clear), 5.0, "/cell"), []);
    let found = of_home(&cell, &[inside.clone(), clear, inside], 5.0, "/cell");
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!((found[0].code, found[0].pointer.as_str()), (WarningCode::HomeBlocked, "/cell/home_deg"));
    assert!(found[0].detail.contains("and part collide, or come closer than 5 mm"), "{}", found[0].detail);
    assert!(found[0].remedy.contains("vantage cell"), "{}", found[0].remedy);
    let advice = crate::planning::plan::Advice::MoveHome;
    assert_eq!(crate::wire::words::advice_sentence(&advice), found[0].remedy, "one remedy everywhere");
}

/// The home was to be moved away from the part, which stood clear of it.
#[test]
fn a_home_at_which_the_arm_meets_itself_is_not_to_be_moved_away_from_the_part() {
    let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let block = crate::testing::box_mesh([-20.0, -20.0, 1.0], [20.0, 20.0, 41.0]);
    let scene = CollisionScene::new(&cell, &block, None, &Pose::identity(), 5.0);
    let folded = (-31..=31).find_map(|step| {
        cell.home_rad.joints_rad[4] = 0.1 * f64::from(step);
        scene.check(&cell.home_rad).filter(|contact| !contact.is_with_part())
    });
    let contact = folded.expect("a wrist that folds the flange onto the arm");
    let found = of_home(&cell, &[scene], 5.0, "/cell");
    let [warning] = &found[..] else { panic!("{found:#?}") };
    assert!(warning.detail.contains(&contact.to_string()) && !warning.detail.contains("the part on its plate"), "{warning:?}");
    assert!(warning.remedy.contains(&format!("until {contact} are 5 mm apart")), "{warning:?}");
    assert!(!warning.remedy.contains("farther from the part"), "{warning:?}");
    let advice = crate::planning::plan::Advice::FreeHome { bodies: contact, clearance_mm: 5.0 };
    assert_eq!(crate::wire::words::advice_sentence(&advice), warning.remedy, "one remedy everywhere");
}

fn stable(mesh: &Mesh) -> Vec<StablePose> {
    stable_poses(mesh, &Poll::never()).expect("not interrupted")
}

#[test]
fn a_part_that_does_not_stand_is_told_how_it_does() {
    let mut cone = crate::testing::cylinder_mesh(30.0, 60.0, 24);
    for vertex in cone.vertices_mm.iter_mut().filter(|vertex| vertex.z > 1.0) {
        (vertex.x, vertex.y) = (vertex.x / 30.0, vertex.y / 30.0);
    }
    let told = |up: &str| of_standing(&stable(&cone), up.parse().expect("an axis"), "--up");
    assert_eq!(told("z"), None);
    let warning = told("-z").expect("it stands on its tip");
    assert_eq!((warning.code, warning.pointer.as_str()), (WarningCode::PartUnstable, "--up"));
    assert_eq!(warning.detail, "is -z, and the part would tip over that way; it stands with z up");
    assert!(told("y").is_some(), "its side is not upright");
    let block = crate::testing::box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    assert!(UpAxis::all().all(|up| of_standing(&stable(&block), up, "").is_none()), "a block stands on every side");
    let sheet = Mesh { faces: vec![block.faces[0]], source_face: vec![0], ..block };
    assert_eq!(of_standing(&stable(&sheet), "x".parse().expect("an axis"), ""), None, "no volume, no telling");
}

#[test]
fn a_pose_in_which_the_part_tips_over_is_told_with_how_it_stands() {
    let block = crate::testing::box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    let turned = |degrees: f64| {
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), degrees.to_radians());
        Pose::from_parts(nalgebra::Vector3::zeros(), turn)
    };
    let poses = [0.0, 45.0, 90.0].map(|degrees| (format!("/at/{degrees}"), turned(degrees)));
    let found = of_poses(&stable(&block), &poses);
    assert_eq!(found.len(), 1, "{found:#?}");
    assert_eq!((found[0].code, found[0].pointer.as_str()), (WarningCode::PartUnstable, "/at/45"));
    assert!(found[0].detail.starts_with("the part would tip over as it is placed: "), "{}", found[0].detail);
    assert!(found[0].detail.ends_with("; it stands with x, -x, y, -y, z, -z up"), "{}", found[0].detail);
    let sheet = Mesh { vertices_mm: block.corners(0).to_vec(), faces: vec![[0, 1, 2]], source_face: vec![0], ..block };
    assert_eq!(of_poses(&stable(&sheet), &poses), [], "no volume, no telling");
}

#[test]
fn a_region_that_holds_nothing_is_told_with_its_list_and_where_the_part_is() {
    let part = Aabb { min: [0.0, -5.0, 0.0].into(), max: [120.0, 68.0, 36.5].into() };
    for (list, pointer, code) in [
        (RegionUse::Exclude, "/params/regions/exclude/2", WarningCode::ExclusionEmpty),
        (RegionUse::Interest, "/params/regions/interest/2", WarningCode::RegionEmpty),
        (RegionUse::Features, "/params/regions/features/2", WarningCode::RegionEmpty),
    ] {
        let found = of_empty_region(list, 2, &part, "/params");
        assert_eq!((found.pointer.as_str(), found.code), (pointer, code));
        assert!(found.detail.contains("x 0.0 to 120.0, y -5.0 to 68.0, z 0.0 to 36.5 mm"), "{}", found.detail);
    }
}

#[test]
fn warnings_of_a_plan_are_those_that_no_job_has_before() {
    let of_plan: Vec<_> = WarningCode::ALL.into_iter().filter(|code| code.is_of_plan()).map(WarningCode::as_str).collect();
    assert_eq!(
        of_plan,
        [
            "region_unmet",
            "region_unconfirmed",
            "grade_a_unmet",
            "fragile_under_pose_error",
            "part_unstable",
            "home_blocked",
            "exclusion_empty",
            "region_empty",
            "fixture_overlaps_part",
            "candidates_left_out"
        ]
    );
}

/// `plan.json` had both.
#[test]
fn a_region_that_holds_nothing_is_warned_of_by_its_cause_alone() {
    let part = Aabb { min: [0.0; 3].into(), max: [10.0; 3].into() };
    let empty = of_empty_region(RegionUse::Features, 0, &part, "/params");
    let params = params(&[0.2, 0.2]);
    let nothing = RegionCoverage { samples: 0, asked_area_mm2: 0.0, missed_mm2: Vec::new(), ..feature() };
    let regions = [nothing, feature()].map(|region| RegionCoverageDocument::from(&region));
    let [of_empty, of_other] = &of_regions(&params, &regions, "/params")[..] else { panic!("both are unmet") };
    let told = by_cause(vec![of_empty.clone(), of_other.clone(), empty.clone()]);
    assert_eq!(told, [of_other.clone(), empty]);
    // One that holds surface which is not asked for has no other warning.
    assert_eq!(by_cause(vec![of_empty.clone()]), std::slice::from_ref(of_empty));
}

#[test]
fn reports_list_each_warning_of_a_plan_once() {
    let warning = |code: WarningCode, pointer: &str| FieldWarning {
        code,
        pointer: pointer.to_owned(),
        detail: String::new(),
        remedy: String::new(),
    };
    let all = [
        warning(WarningCode::FragileUnderPoseError, "/params/robust/select"),
        warning(WarningCode::RegionUnmet, "/params/regions/interest/0/target"),
        warning(WarningCode::RegionUnmet, "/params/regions/interest/1/target"),
        warning(WarningCode::RegionEmpty, "/params/regions/interest/0"),
        warning(WarningCode::PartUnstable, "/params/part/table_from_part"),
    ];
    assert_eq!(at_head_of_reports(&all), [all[2].clone(), all[3].clone(), all[4].clone()]);
    assert_eq!(parameter_of(&all[4]), "part.table_from_part");
}
