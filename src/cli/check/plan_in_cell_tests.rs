use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;
use std::sync::atomic::AtomicBool;

use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Value, json};

use crate::cell::{Cell, CollisionScene, Configuration, PoseSpec, Presets, SpecLibrary};
use crate::check::{Reference, Sound, check};
use crate::geometry::{LengthUnit, Mesh, Part, Pose, ScannerFrame, Table};
use crate::planning::context::{Context, Silent};
use crate::planning::params::PlanParams;
use crate::planning::stations;
use crate::service::plan_job::{PLAN_FILE, PlanJob, Reports, bytes_of};
use crate::testing::{box_mesh, nominal_scanner};
use crate::wire::echo::Echo;

/// Clearance of a plan by default, mm.
const CLEARANCE_MM: f64 = 5.0;

static PLANNED: LazyLock<Planned> = LazyLock::new(Planned::new);

/// A block, the cell of the thesis, and plans of two views of the one: in the other, and without a cell.
struct Planned {
    cell: Cell,
    block: Mesh,
    in_cell: Value,
    alone: Value,
}

impl Planned {
    fn new() -> Self {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("it is valid");
        let block = box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 80.0]);
        let [in_cell, alone] = [Some(&cell), None].map(|in_cell| plan(&block, &cell, in_cell));
        Self { cell, block, in_cell, alone }
    }

    /// Checks a plan in the cell; every finding, a line each.
    fn check(&self, plan: &Value, part: Option<&Mesh>) -> Result<Sound, String> {
        checked(plan, &self.cell, part)
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

/// A plan of two views, as its file has it, with the scanner of `cell`.
fn plan(block: &Mesh, cell: &Cell, in_cell: Option<&Cell>) -> Value {
    let mut params = PlanParams::default();
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.05), Some(20.0));
    (params.candidates.even_directions, params.selection.max_views, params.limits.camera_deg) = (Some(24), Some(2), Some(50.0));
    (params.missed.remedies, params.missed.advice, params.robust.pose_error) = (0, false, None);
    let job = PlanJob {
        mesh: block,
        fixture: None,
        part_name: "block".into(),
        part_sha256: &"0a".repeat(32),
        unit: LengthUnit::Millimetre,
        scanner: &cell.scanner,
        cell: in_cell,
        roadmaps: None,
        rescan: None,
        params: &params,
        echo: Echo::default(),
        date: None,
    };
    let never = AtomicBool::new(false);
    let ctx = Context::new(&never, &Silent);
    let outcome = job.plan(&ctx).unwrap_or_else(|error| panic!("no plan: {error}"));
    let files = job.render(&outcome, Reports::None, &ctx).expect("nobody cancels it");
    let plan: Value = serde_json::from_slice(bytes_of(&files, PLAN_FILE)).expect("JSON");
    assert_eq!(plan["viewpoints"].as_array().map(Vec::len), Some(2), "two views do not measure all of a block");
    plan
}

fn checked(plan: &Value, cell: &Cell, part: Option<&Mesh>) -> Result<Sound, String> {
    let never = AtomicBool::new(false);
    let reference = Reference { part: part.cloned(), ..Reference::default() };
    let checked = check(plan.clone(), &Presets, Some(cell), &reference, &Context::new(&never, &Silent));
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
    let shares = ["of_asked", "of_coverable", "of_visible", "grades_a_b_of_visible", "within_35_deg_of_visible"];
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
                samples, moves between stations (check its program)";
    assert!(in_cell.description.starts_with(begins) && in_cell.description.ends_with(ends), "{}", in_cell.description);
    let begins = "plan with 2 viewpoints, made without a cell; its views measure ";
    let ends =
        " % of the asked area, as planned; not checked: coverage of regions, by grade, by setup and on independent samples";
    assert!(alone.description.starts_with(begins) && alone.description.ends_with(ends), "{}", alone.description);
    let without_part = planned.check(&planned.in_cell, None).expect("sound");
    assert_eq!(
        (without_part.description.as_str(), without_part.measured_of_asked),
        (
            "plan with 2 viewpoints, sound in cell e05-transcan: stations, collisions without the part; not checked: coverage \
             (give the part), moves between stations (check its program)",
            None
        )
    );
    let elsewhere = Cell { scanner: nominal_scanner(), ..planned.cell.clone() };
    let told = checked(&planned.alone, &elsewhere, Some(&planned.block)).expect("it is for no cell").description;
    assert!(told.ends_with("not checked: coverage (the plan was made with another scanner than that of the cell)"), "{told}");
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
    let found = checked(&planned.in_cell, &elsewhere, None).expect_err("refused");
    let told = "/scanner/name: is \"transcan-c\"; the given cell has \"transcan-c-nominal\": give the cell that it was made in";
    assert!(found.starts_with(told) && found.lines().count() == 1, "one finding says it all: {found}");
    let mut focused = planned.cell.clone();
    focused.scanner.devices.left.lens.fx += 1.0;
    let found = checked(&planned.in_cell, &focused, None).expect_err("refused");
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
    before["chosen_on"]["of_samples"] = json!(7);
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
