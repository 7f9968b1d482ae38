use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::tests::check as check_files;
use crate::cell::{Body, Cell, CollisionScene, Configuration, PoseSpec, Presets, Shape, SpecLibrary};
use crate::check::{CheckPlace, Reference, Sound, check};
use crate::geometry::mesh_io::write_stl;
use crate::geometry::{LengthUnit, Mesh, Part, Pose, ScannerFrame, Table};
use crate::planning::context::{Context, Silent};
use crate::planning::params::PlanParams;
use crate::planning::stations;
use crate::service::plan_job::{Artifact, PLAN_FILE, PlanJob, Reports, bytes_of, plan_sha256};
use crate::testing::{box_mesh, nominal_scanner};
use crate::wire::echo::Echo;
use crate::wire::plan::PlanDocument;
use crate::wire::warnings::{FieldWarning, WarningCode};

/// Clearance of a plan by default, mm.
const CLEARANCE_MM: f64 = 5.0;

static PLANNED: LazyLock<Planned> = LazyLock::new(Planned::new);

/// A block, the cell of the thesis, and plans of two views of the one: in the other, with its program, and without a cell.
struct Planned {
    cell: Cell,
    block: Mesh,
    in_cell: Value,
    program: Value,
    alone: Value,
}

impl Planned {
    fn new() -> Self {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("it is valid");
        let block = box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 80.0]);
        let [in_cell, alone] = [Some(&cell), None].map(|in_cell| files(&block, &cell, in_cell));
        let json = |files: &[Artifact], name| serde_json::from_slice::<Value>(bytes_of(files, name)).expect("JSON");
        let (program, [in_cell, alone]) = (json(&in_cell, "program.json"), [in_cell, alone].map(|files| json(&files, PLAN_FILE)));
        for plan in [&in_cell, &alone] {
            assert_eq!(plan["viewpoints"].as_array().map(Vec::len), Some(2), "two views do not measure all of a block");
        }
        Self { cell, block, in_cell, program, alone }
    }

    /// Checks a plan in the cell, or without one if it was made so; every finding, a line each.
    fn check(&self, plan: &Value, part: Option<&Mesh>) -> Result<Sound, String> {
        let is_alone = plan["cell"].is_null();
        let place = if is_alone { CheckPlace::NoCell(Some(&self.cell.scanner)) } else { CheckPlace::Cell(&self.cell) };
        checked(plan, place, part)
    }

    fn table_from_part(&self) -> Pose<Table, Part> {
        pose(&self.in_cell["cell"]["table_from_part"])
    }

    /// The plan with its first viewpoint, and the station of it, where `station` first has one on the ways to the part: along the
    /// axes of both views and straight down, each in two rolls.
    fn moved(&self, station: impl Fn(&Pose<Part, ScannerFrame>) -> Option<Configuration>) -> Value {
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let down: Pose<Part, ScannerFrame> = Pose::from_parts(Vector3::new(0.0, 0.0, 560.0), half_turn);
        let viewpoints = self.in_cell["viewpoints"].as_array().expect("a list");
        let views = viewpoints.iter().map(|view| pose::<Part, ScannerFrame>(&view["part_from_scanner"]));
        let ways = views.chain([down]).flat_map(|way| [0.0, FRAC_PI_2].map(|roll_rad| (way, roll_rad)));
        let mut places = ways.flat_map(|(way, roll_rad)| {
            (20..=56_u32).map(move |step| {
                let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad);
                let forward = Vector3::new(0.0, 0.0, 10.0 * f64::from(step));
                way * Pose::<ScannerFrame, ScannerFrame>::from_parts(forward, roll)
            })
        });
        let found = places.find_map(|place| station(&place).map(|here| (place, here)));
        let (place, here) = found.expect("a place of this kind on the way to the part");
        let mut plan = self.in_cell.clone();
        let view = &mut plan["viewpoints"][0];
        view["part_from_scanner"] = serde_json::to_value(PoseSpec::from(&place)).expect("JSON");
        view["station"]["joints_deg"] = json!(here.joints_rad.map(f64::to_degrees));
        view["station"]["table_angle_deg"] = json!(here.table_rad.to_degrees());
        plan
    }
}

/// Parameters of a plan of two views of a block, quickly made.
fn quick() -> PlanParams {
    let mut params = PlanParams::default();
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.05), Some(20.0));
    (params.candidates.even_directions, params.selection.max_views, params.limits.camera_deg) = (Some(24), Some(2), Some(50.0));
    (params.missed.remedies, params.missed.advice, params.robust.pose_error) = (0, false, None);
    params
}

/// Files of a plan of two views with the scanner of `cell`.
fn files(block: &Mesh, cell: &Cell, in_cell: Option<&Cell>) -> Vec<Artifact> {
    files_by(&quick(), block, cell, in_cell)
}

/// Files of a plan by these parameters.
fn files_by(params: &PlanParams, block: &Mesh, cell: &Cell, in_cell: Option<&Cell>) -> Vec<Artifact> {
    let job = PlanJob {
        mesh: block,
        fixture: None,
        fixture_sha256: None,
        part_name: "block".into(),
        part_sha256: &"0a".repeat(32),
        unit: LengthUnit::Millimetre,
        scanner: &cell.scanner,
        cell: in_cell,
        roadmaps: None,
        rescan: None,
        params,
        echo: Echo::default(),
        date: None,
    };
    let never = AtomicBool::new(false);
    let ctx = Context::new(&never, &Silent);
    let outcome = job.plan(&ctx).unwrap_or_else(|error| panic!("no plan: {error}"));
    job.render(&outcome, Reports::None, &ctx).expect("nobody cancels it")
}

fn checked(plan: &Value, place: CheckPlace<'_>, part: Option<&Mesh>) -> Result<Sound, String> {
    let never = AtomicBool::new(false);
    let reference = Reference { part: part.cloned(), ..Reference::default() };
    let checked = check(plan.clone(), &Presets, Some(place), &reference, &Context::new(&never, &Silent));
    checked.map_err(|errors| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
}

fn pose<To, From>(document: &Value) -> Pose<To, From> {
    serde_json::from_value::<PoseSpec>(document.clone()).expect("a pose").pose()
}

/// Multiplies every number in a value.
fn scale(value: &mut Value, factor: f64) {
    if let Some(number) = value.as_f64() {
        *value = json!(factor * number);
    } else if let Some(items) = value.as_array_mut() {
        items.iter_mut().for_each(|item| scale(item, factor));
    } else if let Some(fields) = value.as_object_mut() {
        fields.values_mut().for_each(|field| scale(field, factor));
    }
}

/// The plan with 0.9 of its measured area, and all that follows from that.
fn understated(plan: &Value) -> Value {
    let mut plan = plan.clone();
    let lost_mm2 = plan["coverage"]["measured_area_mm2"].as_f64().map(|area_mm2| 0.1 * area_mm2).expect("an area");
    let shares = ["of_asked", "of_coverable", "of_total", "of_visible", "grades_a_b_of_visible", "within_35_deg_of_visible"];
    for field in shares.into_iter().chain(["within_60_deg_of_visible", "measured_area_mm2", "grades", "curve"]) {
        scale(&mut plan["coverage"][field], 0.9);
    }
    let missed_mm2 = plan["missed"][0]["area_mm2"].as_f64().expect("what it stands on is missed");
    plan["missed"][0]["area_mm2"] = json!(missed_mm2 + lost_mm2);
    plan
}

/// The plan with its first view twice, the station with it.
fn with_a_view_twice(plan: &Value) -> Value {
    let mut plan = plan.clone();
    for field in ["part_from_scanner", "station"] {
        plan["viewpoints"][1][field] = plan["viewpoints"][0][field].clone();
    }
    plan
}

/// A plate before the projector's lens: plans of the cell had "Target met" at their head, and no check objected.
#[test]
fn a_plan_and_a_program_of_a_cell_whose_mount_hides_its_field_are_told_so() {
    let planned = &*PLANNED;
    let owner_from_body = Isometry3::translation(75.0, 0.0, 95.0);
    let plate = Body { name: "plate".into(), owner_from_body, shape: Shape::Box { size_mm: [2.0, 44.0, 30.0] } };
    let mut cell = planned.cell.clone();
    cell.mount.push(plate);
    let pointers = |warnings: &[FieldWarning]| -> Vec<String> {
        let of_sight = warnings.iter().filter(|warning| warning.code == WarningCode::MountHidesField);
        of_sight.map(|warning| warning.pointer.clone()).collect()
    };
    let files = files(&planned.block, &cell, Some(&cell));
    let of_plan: PlanDocument = serde_json::from_slice(bytes_of(&files, PLAN_FILE)).expect("a plan");
    assert_eq!(pointers(&of_plan.warnings), ["/cell/mount/1"], "at the head of the reports, too");
    for document in [PLAN_FILE, "program.json"] {
        let value: Value = serde_json::from_slice(bytes_of(&files, document)).expect("JSON");
        let sound = checked(&value, CheckPlace::Cell(&cell), None).expect("sound but for its field");
        assert_eq!(pointers(&sound.warnings), ["/cell/mount/1"], "{document}");
        let open = checked(&value, CheckPlace::Cell(&planned.cell), None).expect("sound");
        assert_eq!(pointers(&open.warnings), Vec::<String>::new(), "{document}");
    }
}

#[test]
fn a_sound_plan_is_told_with_what_was_checked_and_what_was_not() {
    let planned = &*PLANNED;
    let [in_cell, alone] =
        [&planned.in_cell, &planned.alone].map(|plan| planned.check(plan, Some(&planned.block)).expect("sound"));
    for (sound, plan) in [(&in_cell, &planned.in_cell), (&alone, &planned.alone)] {
        let (measured, stated) = (sound.measured_of_asked.expect("derived anew"), plan["coverage"]["of_asked"].as_f64());
        assert!(stated.is_some_and(|stated| (measured - stated).abs() <= 5e-4), "{measured} {stated:?}");
    }
    let begins = "plan with 2 viewpoints, sound in cell e05-transcan: stations, collisions with the part; its views measure ";
    let ends = " % of the asked area, as planned; not checked: coverage of regions, by grade, by setup and on independent \
                samples, moves between stations (check its program), choice of views by its params (plan again)";
    assert!(in_cell.description.starts_with(begins) && in_cell.description.ends_with(ends), "{}", in_cell.description);
    let begins = "plan with 2 viewpoints, made without a cell; its views measure ";
    let ends = " % of the asked area, as planned; not checked: coverage of regions, by grade, by setup and on independent \
                samples, choice of views by its params (plan again)";
    assert!(alone.description.starts_with(begins) && alone.description.ends_with(ends), "{}", alone.description);
    let without_part = planned.check(&planned.in_cell, None).expect("sound");
    assert_eq!(
        (without_part.description.as_str(), without_part.measured_of_asked),
        (
            "plan with 2 viewpoints, sound in cell e05-transcan: stations, collisions without the part; not checked: coverage \
             (give the part), moves between stations (check its program), choice of views by its params (plan again)",
            None
        )
    );
}

/// The description alone told what was verified and what cannot be, and of the parameters it told nothing.
#[test]
fn statements_that_were_verified_are_listed_apart_from_those_that_were_not() {
    let planned = &*PLANNED;
    let [in_cell, alone] =
        [&planned.in_cell, &planned.alone].map(|plan| planned.check(plan, Some(&planned.block)).expect("sound"));
    let verified = |sound: &Sound, statement: &str| sound.verified.iter().any(|told| told.starts_with(statement));
    let reason = |sound: &Sound, statement: &str| {
        let found = sound.unverified.iter().find(|told| told.statement.starts_with(statement));
        found.map(|told| told.reason.clone())
    };
    for statement in ["coverage.of_asked: ", "coverage.asked_area_mm2: ", "params.limits: ", "params.robust", "part.area_mm2"] {
        assert!(verified(&in_cell, statement) && verified(&alone, statement), "{statement} in {:#?}", in_cell.verified);
    }
    assert!(verified(&in_cell, "stations: clearance from everything, with the part") && !verified(&alone, "stations"));
    for statement in ["params.preset", "params.candidates, score, selection", "coverage of regions"] {
        assert!(reason(&in_cell, statement).is_some() && reason(&alone, statement).is_some(), "{:#?}", in_cell.unverified);
    }
    assert_eq!(reason(&in_cell, "moves between stations").as_deref(), Some("check the program of the plan"));
    let without_part = planned.check(&planned.in_cell, None).expect("sound");
    assert_eq!(reason(&without_part, "coverage").as_deref(), Some("give the part"));
    // No viewpoint has an exposure.
    assert!(reason(&in_cell, "params.scan.brightness").is_some() && !verified(&in_cell, "params.scan.brightness"));
    assert!(verified(&in_cell, "params.setups and params.selection.max_views: the plan has no more"));
    assert!(verified(&in_cell, "params.part.table_from_part"));
    let mut of_open = planned.in_cell.clone();
    (of_open["coverage"]["of_open"], of_open["params"]["part"]["table_from_part"]) = (json!(true), json!(null));
    let of_open = planned.check(&of_open, None).expect("sound");
    for statement in ["params.setups: the plan has no more", "params.regions: name, kind and tolerance of each"] {
        assert!(verified(&of_open, statement), "{statement} in {:#?}", of_open.verified);
    }
    assert!(reason(&of_open, "choice of cell.table_from_part").is_some() && !verified(&of_open, "params.part.table_from_part"));
}

/// A plan without a cell was taken for one of any cell, and could not be checked without one.
#[test]
fn a_plan_without_a_cell_is_checked_without_one_and_in_none() {
    let planned = &*PLANNED;
    let refused = |plan: &Value, place: CheckPlace<'_>| checked(plan, place, None).expect_err("refused");
    let found = refused(&planned.alone, CheckPlace::Cell(&planned.cell));
    assert!(found.starts_with("/cell: is null, made without a cell; it is checked in cell \"e05-transcan\""), "{found}");
    let found = refused(&planned.in_cell, CheckPlace::NoCell(None));
    assert!(found.starts_with("/cell/name: is \"e05-transcan\"; it is checked without a cell: give the cell"), "{found}");
    let found = refused(&planned.alone, CheckPlace::NoCell(Some(&nominal_scanner())));
    assert!(found.starts_with("/scanner/name: is \"transcan-c\"; the given scanner is \"transcan-c-nominal\""), "{found}");
    let told = checked(&planned.alone, CheckPlace::NoCell(None), Some(&planned.block)).expect("sound").description;
    assert!(told.contains("not checked: coverage (give the scanner that it was planned with), choice of views"), "{told}");
}

/// The plan was sound: only its program was checked for collisions.
#[test]
fn a_station_in_the_table_is_refused_at_its_viewpoint() {
    let planned = &*PLANNED;
    let bare = CollisionScene::without_part(&planned.cell, CLEARANCE_MM);
    let plan = planned.moved(|view| {
        let here = stations::nearest_ik_solution(view, &planned.cell, &bare, &planned.table_from_part())?;
        bare.check_view(&here).map(|_| here)
    });
    for part in [None, Some(&planned.block)] {
        let found = planned.check(&plan, part).expect_err("refused");
        assert!(found.starts_with("/viewpoints/0/station: collides: "), "{found}");
        assert!(found.contains("; allowed is 5 mm apart and more (params.motion.clearance_mm); plan again"), "{found}");
    }
}

/// The plan was sound: the part was no body of its check.
#[test]
fn a_station_in_the_part_is_refused_where_the_part_is_given() {
    let planned = &*PLANNED;
    let lies = planned.table_from_part();
    let bare = CollisionScene::without_part(&planned.cell, CLEARANCE_MM);
    let with_part = bare.with_part(&planned.block, None, &lies);
    let never = AtomicBool::new(false);
    let plan = planned.moved(|view| {
        let ctx = Context::new(&never, &Silent);
        let solved = stations::solve_some(&[*view], &planned.cell, &bare, &lies, 1, &ctx).ok()?;
        let here = solved.first()?.as_ref().ok()?.first()?.configuration();
        with_part.check_view(&here).map(|_| here)
    });
    planned.check(&plan, None).expect("nothing else is in the way");
    let found = planned.check(&plan, Some(&planned.block)).expect_err("refused");
    assert!(found.starts_with("/viewpoints/0/station: collides: ") && found.contains("and part "), "{found}");
    assert!(found.contains("; allowed is 5 mm apart and more (params.motion.clearance_mm); plan again"), "{found}");
}

/// A plan was sound in any cell in which its stations are at their views.
#[test]
fn a_plan_of_another_cell_or_another_scanner_is_refused() {
    let planned = &*PLANNED;
    for (field, present) in [("name", "e05-transcan"), ("robot", "hans-e05"), ("turntable", "minas-a6-500")] {
        let mut plan = planned.in_cell.clone();
        plan["cell"][field] = json!("another");
        let found = planned.check(&plan, None).expect_err("refused");
        assert!(found.starts_with(&format!("/cell/{field}: is \"another\"; the given cell has \"{present}\": give")), "{found}");
    }
    let elsewhere = Cell { scanner: nominal_scanner(), ..planned.cell.clone() };
    let found = checked(&planned.in_cell, CheckPlace::Cell(&elsewhere), None).expect_err("refused");
    let told = "/scanner/name: is \"transcan-c\"; the given cell has \"transcan-c-nominal\": give the cell that it was made in";
    assert!(found.starts_with(told) && found.lines().count() == 1, "one finding says it all: {found}");
    let mut focused = planned.cell.clone();
    focused.scanner.devices.left.lens.fx += 1.0;
    let found = checked(&planned.in_cell, CheckPlace::Cell(&focused), None).expect_err("refused");
    assert!(found.starts_with("/scanner/devices/0/fx: in the given cell it is 6669.08"), "{found}");
}

/// The coverage that a plan states was held against nothing but itself.
#[test]
fn coverage_that_the_views_do_not_measure_is_refused() {
    let planned = &*PLANNED;
    for plan in [&planned.in_cell, &planned.alone] {
        for changed in [understated(plan), with_a_view_twice(plan)] {
            planned.check(&changed, None).expect("it agrees with itself");
            let found = planned.check(&changed, Some(&planned.block)).expect_err("refused");
            assert!(found.starts_with("/coverage/of_asked: is 0.") && found.contains("; by its viewpoints it is 0."), "{found}");
            assert_eq!(found.lines().count(), 1, "{found}");
        }
    }
}

/// The plan was refused: what the fixture hides was measured without it.
#[test]
fn coverage_is_not_held_against_a_plan_whose_fixture_is_not_given() {
    let planned = &*PLANNED;
    for (plan, collisions) in [(&planned.in_cell, "collisions with the part, without its fixture; "), (&planned.alone, "")] {
        let mut plan = understated(plan);
        plan["params"]["part"]["fixture_mesh"] = json!("clamp.stl");
        let sound = planned.check(&plan, Some(&planned.block)).expect("nothing was found");
        let told = format!("{collisions}not checked: coverage (give the fixture that it was planned with)");
        assert!(sound.description.contains(&told) && sound.measured_of_asked.is_none(), "{}", sound.description);
    }
}

/// An earlier release took other samples, fewer in small regions, and on these the plan states its coverage.
#[test]
fn coverage_on_other_samples_than_are_taken_now_is_told_as_not_checked() {
    let planned = &*PLANNED;
    let mut before = planned.in_cell.clone();
    (before["chosen_on"]["samples"], before["chosen_on"]["of_samples"]) = (json!(7), json!(7));
    let agrees = planned.check(&before, Some(&planned.block)).expect("sound");
    assert!(agrees.measured_of_asked.is_some(), "{}", agrees.description);
    let mut before_that = before.clone();
    before_that.as_object_mut().expect("an object").remove("chosen_on");
    for plan in [before, before_that] {
        let sound = planned.check(&understated(&plan), Some(&planned.block)).expect("nothing was found");
        let told = "; not checked: coverage (the plan was made on other samples";
        assert!(sound.description.contains(told) && sound.measured_of_asked.is_none(), "{}", sound.description);
    }
}

/// Poses of another calibration of the cell, or edited ones, were noticed where they put a station off alone.
#[test]
fn poses_and_calibration_that_the_cell_does_not_have_are_refused() {
    let planned = &*PLANNED;
    for field in ["base_from_table", "flange_from_scanner"] {
        let mut plan = planned.in_cell.clone();
        let length = &mut plan["cell"][field]["translation_mm"][2];
        *length = json!(length.as_f64().expect("a length") + 1.0);
        let found = planned.check(&plan, None).expect_err("refused");
        assert!(found.starts_with(&format!("/cell/{field}: is 1.000 mm and 0.0000 ° off that of the given cell")), "{found}");
        assert_eq!(found.lines().count(), 1, "{found}");
    }
    let mut plan = planned.in_cell.clone();
    plan["cell"]["calibrated"] = json!({
        "by": "vantage", "at": "2026-11-20T09:00:00Z", "calibration_id": "ab".repeat(32), "data_sha256": "cd".repeat(32),
        "rms_rotation_deg": 0.01, "rms_translation_mm": 0.1, "point_sd_mm": 0.05, "rotation_sd_deg": 0.005,
        "translation_sd_mm": 0.04,
    });
    let found = planned.check(&plan, None).expect_err("refused");
    assert!(found.starts_with("/cell/calibrated: is calibration abab") && found.contains("the given cell has none"), "{found}");
}

/// Parameters were held against their ranges alone.
#[test]
fn parameters_that_the_rest_of_a_plan_contradicts_are_refused() {
    let planned = &*PLANNED;
    for (pointer, value, told) in [
        (
            "/params/preset",
            json!("thesis"),
            "/params/preset: is \"thesis\", with which the plan was not made: it sets candidates.",
        ),
        (
            "/params/scan/settle_secs",
            json!(0.1),
            "/params/scan/settle_secs: is 0.1 s; 2 times that are 0.2 s, and motion.settling",
        ),
        (
            "/params/scan/capture_secs",
            json!(5.0),
            "/params/scan/capture_secs: is 5 s; 2 times that are 10 s, and motion.scanning",
        ),
        ("/params/scan/brightness", json!("auto"), "/viewpoints/0/exposure: is missing; params.materials or params.scan.bright"),
        ("/params/selection/max_views", json!(1), "/params/selection/max_views: is 1; the plan has 2 viewpoints"),
        ("/params/limits/camera_deg", json!(60.0), "/scanner/devices/0/incidence_max_deg: is 50 °; by incidence_own_deg and"),
        ("/params/realism/count_at_risk", json!(false), "/params/realism/count_at_risk: is false; coverage.at_risk.counted is"),
        (
            "/params/visibility/pixel_set",
            json!(true),
            "/params/visibility/pixel_set: is true; coverage.pixel_set_of_total is miss",
        ),
        (
            "/params/robust/pose_error",
            json!({"angle_deg": 1.0, "translation_mm": 1.0}),
            "/coverage/robust: is missing; params.rob",
        ),
        (
            "/params/part/table_from_part/translation_mm/0",
            json!(7.0),
            "/params/part/table_from_part: is 7.000 mm and 0.0000 ° off",
        ),
    ] {
        let mut plan = planned.in_cell.clone();
        *plan.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer} is there")) = value;
        let found = planned.check(&plan, None).expect_err(pointer);
        assert!(found.lines().any(|line| line.starts_with(told)), "{told:?} in\n{found}");
    }
    let mut of_another_release = planned.in_cell.clone();
    (of_another_release["version"], of_another_release["params"]["preset"]) = (json!("0.0.1"), json!("thesis"));
    let sound = planned.check(&of_another_release, None).expect("what its preset set is not known");
    assert!(sound.unverified.iter().any(|told| told.statement == "params.preset" && told.reason.contains("\"0.0.1\"")));
}

/// The area that the parameters ask for was not derived anew.
#[test]
fn another_area_than_the_parameters_ask_for_is_refused() {
    let planned = &*PLANNED;
    for plan in [&planned.in_cell, &planned.alone] {
        let mut plan = plan.clone();
        plan["params"]["regions"]["exclude"] = json!([{"kind": "half_space", "point_mm": [0, 0, 40], "normal": [0, 0, 1]}]);
        planned.check(&plan, None).expect("it agrees with itself");
        let found = planned.check(&plan, Some(&planned.block)).expect_err("refused");
        let told = "mm²; by params.part and params.regions it is";
        assert!(found.starts_with("/coverage/asked_area_mm2: is ") && found.contains(told), "{found}");
    }
    let mut elsewhere = planned.alone.clone();
    for end in ["min", "max"] {
        let length = &mut elsewhere["part"]["bbox_mm"][end][0];
        *length = json!(length.as_f64().expect("a length") + 5.0);
    }
    let found = planned.check(&elsewhere, Some(&planned.block)).expect_err("refused");
    assert!(found.starts_with("/part/bbox_mm/min/0: is -25 mm; that of the part is -30 mm"), "{found}");
}

/// Such members counted for nothing, in silence.
#[test]
fn members_that_a_plan_or_a_program_does_not_have_are_refused_by_name() {
    let planned = &*PLANNED;
    let mut plan = planned.in_cell.clone();
    plan["comment"] = json!("of Monday");
    plan["viewpoints"][1]["rejectd"] = json!("no_path");
    plan["coverage"]["independent"]["of_askd"] = json!(0.5);
    let found = planned.check(&plan, None).expect_err("refused");
    assert_eq!(found.lines().count(), 3, "{found}");
    for told in ["/comment: is not known to release", "/viewpoints/1/rejectd: is not", "/coverage/independent/of_askd: is not"] {
        assert!(found.lines().any(|line| line.starts_with(told)), "{told:?} in\n{found}");
    }
    assert!(found.contains("; did you mean rejected?"), "{found}");
    let mut program = planned.program.clone();
    program["max_speed"] = json!(0.1);
    let found = checked(&program, CheckPlace::Cell(&planned.cell), None).expect_err("refused");
    assert!(found.starts_with("/max_speed: is not known to release") && found.lines().count() == 1, "{found}");
}

/// The program was told that its scans measure something else than planned, or to be sound.
#[test]
fn a_program_without_the_fixture_of_its_plan_is_told_that_first() {
    let planned = &*PLANNED;
    let mut held = understated(&planned.in_cell);
    held["params"]["part"]["fixture_mesh"] = json!("clamp.stl");
    let plan: PlanDocument = serde_json::from_value(held).expect("a plan");
    let sha256 = plan_sha256(&plan.to_bytes());
    let mut program = planned.program.clone();
    program["plan_sha256"] = json!(sha256);
    let never = AtomicBool::new(false);
    let check_with = |part: Option<&Mesh>, fixture: Option<Mesh>| {
        let plan = Some((plan.clone(), sha256.clone()));
        let reference = Reference { plan, part: part.cloned(), fixture, ..Reference::default() };
        let ctx = Context::new(&never, &Silent);
        check(program.clone(), &Presets, Some(CheckPlace::Cell(&planned.cell)), &reference, &ctx)
    };
    let errors = check_with(Some(&planned.block), None).expect_err("refused");
    assert!(
        errors[0].pointer.is_empty() && errors[0].detail.starts_with("is to be checked with the part, but without the fixture"),
        "{errors:#?}"
    );
    assert!(errors.len() == 1 && errors[0].detail.contains("\"clamp.stl\""), "{errors:#?}");
    // Within the block it hides nothing.
    let clamp = box_mesh([-2.0, -2.0, 20.0], [2.0, 2.0, 24.0]);
    let errors = check_with(Some(&planned.block), Some(clamp)).expect_err("the plan tells less than its scans measure");
    assert!(errors[0].detail.starts_with("the scans measure ") && errors.len() == 1, "{errors:#?}");
    let without_part = check_with(None, None).expect("nothing was found").description;
    assert!(without_part.contains(", sound in cell e05-transcan; not checked: collisions with the part (give"), "{without_part}");
}

/// A plate of half a millimetre with fifty ridges of 0.008 mm, relief that the default engine passes over.
fn ridges() -> Mesh {
    let mut all = box_mesh([0.0; 3], [0.99, 1.0, 0.5]);
    for ridge in 0..50_u32 {
        let from_mm = 0.02 * f64::from(ridge);
        let other = box_mesh([from_mm, 0.0, 0.5], [from_mm + 0.01, 1.0, 0.508]);
        let first = all.vertices_mm.len() as u32;
        all.faces.extend(other.faces.iter().map(|face| face.map(|corner| corner + first)));
        all.vertices_mm.extend(other.vertices_mm);
    }
    all.source_face = (0..all.faces.len() as u32).collect();
    all
}

/// The plan was refused: its views were looked at by a ray for every sample alone, and it was made by another engine.
#[test]
fn a_plan_of_relief_below_0_01_mm_passes_by_its_own_engine_and_both_figures_are_told() {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("it is valid");
    let (part, mut params) = (ridges(), quick());
    (params.part.samples_per_mm2, params.part.patch_edge_mm, params.limits.camera_deg) = (Some(400.0), Some(0.5), None);
    let planned = files_by(&params, &part, &cell, None);
    let plan: Value = serde_json::from_slice(bytes_of(&planned, PLAN_FILE)).expect("JSON");
    let place = CheckPlace::NoCell(Some(&cell.scanner));
    let sound = checked(&plan, place, Some(&part)).unwrap_or_else(|found| panic!("{found}"));
    let stated = plan["coverage"]["of_asked"].as_f64().expect("a share");
    assert!(sound.measured_of_asked.is_some_and(|measured| (measured - stated).abs() <= 5e-4), "{sound:?}");
    let left = sound.unverified.iter().find(|left| left.statement == "coverage by a ray for every sample");
    let reason = left.map(|left| left.reason.as_str()).unwrap_or_default();
    assert!(reason.starts_with("is 0.") && reason.contains("; by the engine of the plan, raster, it is 0."), "{sound:?}");
    assert!(sound.description.contains(reason), "{}", sound.description);
    let found = checked(&understated(&plan), place, Some(&part)).expect_err("an altered share");
    assert!(found.starts_with("/coverage/of_asked: is 0.") && found.contains(", by a ray for every sample 0."), "{found}");
}

/// A clearance of 1 mm was kept in place of the plan's, and nothing told so.
#[test]
fn the_clearance_that_a_program_is_checked_with_is_told_with_its_reason() {
    let planned = &*PLANNED;
    let is_told = |sound: &Sound, words: &str| sound.verified.iter().any(|statement| statement.contains(words));
    let alone = checked(&planned.program, CheckPlace::Cell(&planned.cell), None).expect("sound");
    assert!(is_told(&alone, "with a clearance of 1 mm (the smallest that a plan may ask for"), "{:#?}", alone.verified);
    let left = "clearance of the plan (1 mm was kept, the smallest that a plan may ask for: give the plan)";
    assert!(alone.description.contains(left), "{}", alone.description);
    let plan: PlanDocument = serde_json::from_value(planned.in_cell.clone()).expect("a plan");
    let (sha256, mut program) = (plan_sha256(&plan.to_bytes()), planned.program.clone());
    program["plan_sha256"] = json!(sha256);
    let reference = Reference { plan: Some((plan, sha256)), ..Reference::default() };
    let never = AtomicBool::new(false);
    let place = Some(CheckPlace::Cell(&planned.cell));
    let sound = check(program, &Presets, place, &reference, &Context::new(&never, &Silent)).expect("sound");
    assert!(is_told(&sound, "with a clearance of 5 mm (motion.clearance_mm of the plan)"), "{:#?}", sound.verified);
    assert!(!sound.description.contains("clearance"), "{}", sound.description);
}

/// Both were called sound beside a plan of another order or time.
#[test]
fn a_program_tells_whether_it_has_the_order_and_the_time_of_its_plan() {
    let planned = &*PLANNED;
    let sound = |change: &dyn Fn(&mut PlanDocument)| {
        let mut plan: PlanDocument = serde_json::from_value(planned.in_cell.clone()).expect("a plan");
        change(&mut plan);
        let (sha256, mut program) = (plan_sha256(&plan.to_bytes()), planned.program.clone());
        program["plan_sha256"] = json!(sha256);
        let reference = Reference { plan: Some((plan, sha256)), ..Reference::default() };
        let never = AtomicBool::new(false);
        let place = Some(CheckPlace::Cell(&planned.cell));
        check(program, &Presets, place, &reference, &Context::new(&never, &Silent)).expect("sound")
    };
    let as_planned = sound(&|_| {});
    for wanted in ["sequence: as the plan states it", "cycle time: as the plan states it"] {
        assert!(as_planned.verified.iter().any(|statement| statement == wanted), "{:#?}", as_planned.verified);
    }
    let reversed = sound(&|plan| plan.sequence.reverse());
    assert!(reversed.description.contains("(the program scans in another order)"), "{}", reversed.description);
    let slower = sound(&|plan| {
        let motion = plan.motion.as_mut().expect("with a cell");
        (motion.cycle_secs, motion.moving_secs) = (motion.cycle_secs + 1.0, motion.moving_secs + 1.0);
    });
    assert!(slower.description.contains(" s where the plan says "), "{}", slower.description);
}

/// A bound above the time that it bounds was taken.
#[test]
fn a_plan_whose_bounds_are_above_its_times_is_refused() {
    let refused = |field: &str, secs: f64| {
        let mut plan = PLANNED.in_cell.clone();
        plan["motion"][field] = json!(secs);
        PLANNED.check(&plan, None).expect_err("above its time")
    };
    for field in ["turning_secs", "moving_secs_lower", "ordered_secs_lower"] {
        let told = refused(field, 1e4);
        assert!(told.contains(&format!("/motion/{field}")) && told.contains("above "), "{told}");
    }
}

/// The refusal spoke in numbers of lenses.
#[test]
fn a_program_of_another_scanner_is_refused_by_the_name_of_the_scanner() {
    let planned = &*PLANNED;
    let mut plan: PlanDocument = serde_json::from_value(planned.in_cell.clone()).expect("a plan");
    plan.scanner.name = "other".to_owned();
    plan.scanner.devices.iter_mut().for_each(|device| device.fx += 1.0);
    let (sha256, mut program) = (plan_sha256(&plan.to_bytes()), planned.program.clone());
    program["plan_sha256"] = json!(sha256);
    let reference = Reference { plan: Some((plan, sha256)), ..Reference::default() };
    let never = AtomicBool::new(false);
    let place = Some(CheckPlace::Cell(&planned.cell));
    let found = check(program, &Presets, place, &reference, &Context::new(&never, &Silent)).expect_err("another scanner");
    let [error] = &found[..] else { panic!("one sentence: {found:?}") };
    let wanted = format!("is {:?} in the given cell; the plan was made with \"other\": give the", planned.cell.scanner.name);
    assert!(error.pointer == "/scanner/name" && error.detail.starts_with(&wanted), "{error:?}");
}

/// The program was told to be without its plan, which was given beside it.
#[test]
fn a_program_is_held_against_the_plan_that_is_checked_in_the_same_call() {
    let planned = &*PLANNED;
    let folder = tempfile::TempDir::new().expect("a folder");
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("writes");
        path.display().to_string()
    };
    let stl = write_stl(&planned.block);
    let (mut plan, mut program) = (planned.in_cell.clone(), planned.program.clone());
    plan["part"]["sha256"] = json!(plan_sha256(&stl));
    let plan = plan.to_string();
    program["plan_sha256"] = json!(plan_sha256(plan.as_bytes()));
    let (part, plan) = (file("part.stl", &stl), file("made.json", plan.as_bytes()));
    let sound = file("program.json", program.to_string().as_bytes());
    program["plan_sha256"] = json!("00".repeat(32));
    let of_another = file("other.json", program.to_string().as_bytes());
    let with_part = |files: &[&str]| {
        let surroundings = ["--cell", "e05-transcan", "--mesh", part.as_str(), "--unit", "mm"];
        check_files(&[files, &surroundings[..]].concat())
    };
    assert_eq!(with_part(&[plan.as_str(), sound.as_str()]), Ok(()));
    assert_eq!(with_part(&[sound.as_str(), plan.as_str()]), Ok(()), "in any order");
    let found = with_part(&[plan.as_str(), of_another.as_str()]).expect_err("another plan's");
    assert!(found.contains("other.json: is to be checked with the part, but without its plan"), "{found}");
}
