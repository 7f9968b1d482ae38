use std::path::PathBuf;

use clap::Parser;
use tempfile::TempDir;

use super::{CheckArgs, run};
use crate::cell::{Presets, SpecKind, SpecLibrary, preset_text};
use crate::cli::planned_block::plan_of_two_views;
use crate::geometry::Mesh;
use crate::geometry::mesh_io::write_stl;
use crate::planning::params::PlanParams;
use crate::service::plan_job::plan_sha256;
use crate::testing::box_mesh;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: CheckArgs,
}

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(TempDir::new().expect("folder"))
    }

    fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).expect("writes");
        path
    }

    fn check(&self, name: &str, text: &str) -> Result<(), String> {
        let path = self.file(name, text);
        check(&[&path.display().to_string()])
    }
}

pub(super) fn check(args: &[&str]) -> Result<(), String> {
    let line = Line::try_parse_from([&["check"], args].concat()).map_err(|error| error.to_string())?;
    run(&line.args).map_err(|error| {
        assert_eq!(error.exit_code(), 2, "{error}");
        error.to_string()
    })
}

#[test]
fn every_preset_is_recognised_and_sound() {
    let folder = Folder::new();
    for kind in [SpecKind::Scanner, SpecKind::Robot, SpecKind::Turntable, SpecKind::Cell] {
        for name in Presets.names(kind) {
            let text = preset_text(kind, &name).expect("preset");
            assert_eq!(folder.check(&format!("{name}.toml"), text), Ok(()), "{name}");
        }
    }
    let params = serde_json::to_string(&PlanParams::default()).expect("writes");
    assert_eq!(folder.check("params.json", &params), Ok(()));
}

/// A preset by its name was told to be no file, and nothing more.
#[test]
fn presets_are_checked_by_their_names_and_a_misspelled_one_is_asked_about() {
    for name in ["e05-transcan", "transcan-c", "hans-e05", "minas-a6-500", "thesis"] {
        assert_eq!(check(&[name]), Ok(()), "{name}");
    }
    let told = check(&["e5-transcan"]).expect_err("refused");
    assert!(told.starts_with("e5-transcan: there is no such file; there is no such preset either"), "{told}");
    assert!(told.ends_with("; did you mean e05-transcan?"), "{told}");
    let told = check(&["e05-transcan.tml"]).expect_err("refused");
    assert!(!told.contains("preset"), "a name with an ending is a file's: {told}");
}

#[test]
fn findings_name_file_field_value_and_range() {
    let folder = Folder::new();
    let robot = preset_text(SpecKind::Robot, "hans-e05").expect("preset").replace("payload_kg = 5.0", "payload_kg = -5.0");
    let found = folder.check("arm.toml", &robot).expect_err("refused");
    assert!(found.contains("arm.toml: /payload_kg: is -5 kg; allowed is 0.1 to 2000 kg"), "{found}");
    let unknown = folder.check("params.toml", "[motion]\nclearance = 3.0\n").expect_err("refused");
    assert!(unknown.contains("/motion/clearance") || unknown.contains("unknown field `clearance`"), "{unknown}");
    let odd = folder.check("odd.toml", "colour = 3\n").expect_err("refused");
    assert!(odd.contains("neither a scanner"), "{odd}");
    let broken = folder.check("broken.json", "{\"schema\": ").expect_err("refused");
    assert!(broken.contains("broken.json") && broken.contains("the file is cut off"), "{broken}");
}

/// The check took parameters that a plan refuses.
#[test]
fn what_a_preset_sets_otherwise_is_a_finding_as_in_a_plan() {
    let folder = Folder::new();
    let told = folder.check("beside.toml", "preset = \"thesis\"\n[candidates]\nstandoff = \"surface\"\n").expect_err("refused");
    assert!(told.contains("beside.toml: /candidates/standoff: is set by preset = thesis; leave it out"), "{told}");
    let same = "preset = \"thesis\"\n[selection]\nsolver = \"greedy\"\ntarget = 0.985\n";
    assert_eq!(folder.check("same.toml", same), Ok(()));
}

#[test]
fn faults_of_toml_name_the_key_and_the_decimal_comma() {
    let folder = Folder::new();
    let twice = folder.check("twice.toml", "[motion]\nclearance_mm = 3.0\nclearance_mm = 4.0\n").expect_err("refused");
    assert!(twice.contains("`clearance_mm` is given twice: give it once (line 3, column 1)"), "{twice}");
    let comma = folder.check("comma.toml", "[motion]\nclearance_mm = 3,5\n").expect_err("refused");
    assert!(comma.contains("use a point as decimal separator"), "{comma}");
    let other = folder.check("other.toml", "[motion]\nclearance_mm = \n").expect_err("refused");
    assert!(!other.contains("decimal"), "{other}");
}

#[test]
fn a_folder_is_told_to_be_one() {
    let folder = Folder::new();
    folder.file("plan.json", "{}");
    let told = check(&[&folder.0.path().display().to_string()]).expect_err("refused");
    assert!(told.contains("is a folder; give a file in it, such as plan.json"), "{told}");
}

#[test]
fn a_doubtful_value_is_an_error_with_strict_alone() {
    let folder = Folder::new();
    let scanner = preset_text(SpecKind::Scanner, "transcan-c-nominal").expect("preset");
    let volume = scanner.replace("practical_volume_mm = [260.0, 165.0, 140.0]", "practical_volume_mm = [640.0, 500.0, 140.0]");
    let path = folder.file("large.toml", &volume).display().to_string();
    assert_eq!(check(&[&path]), Ok(()));
    let strict = check(&[&path, "--strict"]).expect_err("refused");
    assert!(strict.contains("large.toml: /practical_volume_mm: is [640.0, 500.0, 140.0] mm; all three devices see"), "{strict}");
}

#[test]
fn a_controller_of_another_maker_than_the_robot_is_doubted() {
    let folder = Folder::new();
    let with_arm = |name: &str, arm: &str| {
        let table = "[controllers.table]\nprotocol = \"minas_a6\"\naddress = \"tcp://10.0.0.3:502\"\nunits_per_turn = 1_600_000\n\
                     gear_ratio = 40.0\n";
        let cell = preset_text(SpecKind::Cell, "e05-transcan").expect("preset");
        let path = folder.file(name, &format!("{cell}\n{table}[controllers.arm]\n{arm}"));
        path.display().to_string()
    };
    let own = with_arm("own.toml", "protocol = \"hans\"\naddress = \"10.0.0.2:10003\"\n");
    assert_eq!(check(&[&own, "--strict"]), Ok(()));
    let other = with_arm("other.toml", "protocol = \"fanuc_rmi\"\naddress = \"10.0.0.2:16001\"\njoint_3_from = \"upper_arm\"\n");
    assert_eq!(check(&[&other]), Ok(()), "a doubt alone");
    let strict = check(&[&other, "--strict"]).expect_err("refused");
    assert!(strict.contains("/controllers/arm/protocol: is fanuc_rmi, of another maker than robot hans-e05"), "{strict}");
}

#[test]
fn all_files_are_checked_and_all_findings_told() {
    let folder = Folder::new();
    let first = folder.file("a.toml", "[motion]\nclearance_mm = 0.0\n");
    let second = folder.file("b.toml", "[motion]\nspeed_fraction = 7.0\n");
    let found = check(&[&first.display().to_string(), &second.display().to_string()]).expect_err("refused");
    assert!(found.contains("/motion/clearance_mm") && found.contains("/motion/speed_fraction"), "{found}");
    assert!(check(&[]).is_err());
}

#[test]
fn a_program_is_linted_against_a_cell() {
    let folder = Folder::new();
    let home = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0];
    let program = |joint: f64, secs: f64| {
        serde_json::json!({
            "schema": "vantage.program/1", "plan_sha256": "00".repeat(32), "robot": "hans-e05", "turntable": "minas-a6-500",
            "home_deg": home, "cycle_secs": secs,
            "steps": [{"op": "move_joints", "joints_deg": [joint, -30.0, 60.0, 0.0, 30.0, 0.0], "table_angle_deg": 0.0,
                       "speed_fraction": 1.0, "via": [], "duration_secs": secs}],
        })
    };
    let sound = folder.file("sound.json", &program(0.0, 0.0).to_string()).display().to_string();
    assert_eq!(check(&[&sound]), Ok(()));
    assert_eq!(check(&[&sound, "--cell", "e05-transcan"]), Ok(()));
    let away = folder.file("away.json", &program(200.0, 1.0).to_string()).display().to_string();
    assert_eq!(check(&[&away]), Ok(()), "without a cell only shape and ranges count");
    let found = check(&[&away, "--cell", "e05-transcan"]).expect_err("refused");
    assert!(found.contains("/steps/0: axis 1 is at 200.0000°") && found.contains("does not end at home"), "{found}");
    let unknown = check(&[&sound, "--cell", "nowhere"]).expect_err("refused");
    assert!(unknown.contains("e05-transcan"), "{unknown}");
}

/// A program of another plan than the one in its folder was sound.
#[test]
fn a_program_is_held_against_the_plan_beside_it() {
    let folder = Folder::new();
    let plan = "{\"schema\": \"vantage.plan/1\"}";
    let program = |plan_sha256: &str| {
        let program = serde_json::json!({
            "schema": "vantage.program/1", "plan_sha256": plan_sha256, "robot": "hans-e05", "turntable": "minas-a6-500",
            "home_deg": [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0], "cycle_secs": 0.0, "steps": [],
        });
        folder.check("program.json", &program.to_string())
    };
    assert_eq!(program(&"00".repeat(32)), Ok(()), "no plan is there");
    folder.file("plan.json", plan);
    let of_plan = crate::service::plan_job::plan_sha256(plan.as_bytes());
    let found = program(&"00".repeat(32)).expect_err("another plan's");
    assert!(found.contains("program.json: /plan_sha256: is made from plan 0000") && found.contains(&of_plan), "{found}");
    assert_eq!(program(&of_plan), Ok(()));
}

#[test]
fn a_binary_file_is_refused_in_a_line() {
    let folder = Folder::new();
    for bytes in [&b"\xff\xfe\x00solid"[..], b"name = \"x\"\0"] {
        let path = folder.0.path().join("cell.toml");
        std::fs::write(&path, bytes).expect("writes");
        let found = check(&[&path.display().to_string()]).expect_err("refused");
        assert!(found.ends_with("cell.toml: not a TOML or JSON file"), "{found}");
    }
    // A text in another encoding was told to be no TOML.
    let path = folder.0.path().join("cell.toml");
    std::fs::write(&path, b"# A cell\nname = \"L\xf6wen\"\n").expect("writes");
    let found = check(&[&path.display().to_string()]).expect_err("refused");
    assert!(found.ends_with("cell.toml: line 2: is not in UTF-8; save the file as text in UTF-8"), "{found}");
}

#[test]
fn a_cell_says_at_its_field_what_is_wrong_with_a_file_it_names() {
    let folder = Folder::new();
    let cell = preset_text(SpecKind::Cell, "e05-transcan").expect("preset");
    let named = |field: &str, preset: &str, path: &std::path::Path| {
        let text = cell.replace(&format!("{field} = \"{preset}\""), &format!("{field} = {:?}", path.display().to_string()));
        folder.check("cell.toml", &text).expect_err("refused")
    };
    let broken = folder.file("scanner.toml", "name = \"mine\"\ndepth_mm = \n");
    let found = named("scanner", "transcan-c", &broken);
    assert!(found.contains("cell.toml: /scanner: is") && found.contains("cannot be used") && found.contains("line 2"), "{found}");
    assert_eq!(found.lines().count(), 1, "{found}");
    let other = folder.file("robot.toml", "name = \"arm\"\npayload_kg = \"much\"\n");
    let found = named("robot", "hans-e05", &other);
    assert!(found.contains("cell.toml: /robot: is") && found.contains("/payload_kg"), "{found}");
    let found = named("turntable", "minas-a6-500", &folder.0.path().join("nowhere.toml"));
    assert!(found.contains("/turntable: is") && found.ends_with("which cannot be used: there is no such file"), "{found}");
    let mesh = folder.file("column.stl", "no mesh");
    let column =
        format!("[[obstacles]]\nname = \"column\"\nshape = {{ kind = \"mesh\", mesh = {:?} }}\n", mesh.display().to_string());
    let found = folder.check("meshes.toml", &format!("{cell}\n{column}")).expect_err("refused");
    assert!(found.contains("/obstacles/1/shape/mesh: is") && found.contains("column.stl: "), "{found}");
}

#[test]
fn messages_speak_of_files_not_of_types() {
    let folder = Folder::new();
    let found = folder.check("params.toml", "selection = 3\n").expect_err("refused");
    assert!(found.ends_with("/selection: is 3; expected an object"), "{found}");
    let plan = serde_json::json!({"schema": "vantage.plan/1", "version": "0", "part": 3});
    let found = folder.check("plan.json", &plan.to_string()).expect_err("refused");
    assert!(found.contains("expected an object"), "{found}");
}

#[test]
fn a_document_of_no_known_kind_is_told_by_what_it_is() {
    let folder = Folder::new();
    for (name, text, told) in [
        ("part.obj", "v 0 0 0\n", "is a mesh, not a TOML or JSON file; `vantage inspect` examines it"),
        ("report.html", "\u{feff}<!DOCTYPE html>\n<html lang=\"en\">\n", "is an HTML page, such as a report, not a TOML"),
        ("scene.xml", "<scene/>\n", "is an XML file, not a TOML or JSON file"),
        ("viewpoints.csv", "view,x_mm\n0,1\n", "is a table, not a TOML or JSON file"),
        ("poses.tsv", "id\tx_mm\n0\t1\n", "is a table, not a TOML or JSON file"),
        ("scan.script", "# Vantage scan program\ndef scan():\n", "is a program in the language of a controller, not"),
        ("scan.cps", "// nothing that tells whose it is\n", "is a program in the language of a controller, not a TOML"),
        ("scan.py", "from robodk import robolink\n", "is a program in the language of a controller, not a TOML"),
        ("report.txt", "Can be scanned: 96.46 % measured\n", "is a plain text, such as a report, not a TOML"),
        ("server.toml", "[execution]\ncells = []\n", "is a configuration file of the server; `vantage serve --config` takes it"),
        ("empty.json", "{}", "an empty document is neither a scanner"),
        ("one.json", "{\"colour\": 1}", "a document with the field colour is neither a scanner"),
        ("eight.toml", "a=1\nb=1\nc=1\nd=1\ne=1\nf=1\ng=1\nh=1\n", "a document with the fields a, b, c, d, e, f, … is neither"),
        ("other.json", "{\"schema\": \"other/1\"}", "a document of schema \"other/1\" is neither"),
    ] {
        let found = folder.check(name, text).expect_err(name);
        assert!(found.contains(&format!("{name}: {told}")), "{found}");
    }
}

/// An error of the TOML reader at its first character was all that was told.
#[test]
fn what_can_be_checked_instead_of_a_report_is_told() {
    let folder = Folder::new();
    let found = folder.check("report.html", "<!doctype html>\n").expect_err("a page");
    let next = "\n  → give a cell, a device, parameters, a plan (plan.json) or a program (program.json)";
    assert!(found.ends_with(&format!("not a TOML or JSON file{next}")), "{found}");
    let found = folder.check("scan.cps", "movej p1\n").expect_err("a program");
    let next = "\n  → check the program.json that it was written from; `vantage plan` writes it beside its plan.json";
    assert!(found.contains(next), "{found}");
    // The errors of programs and of texts named no file to check.
    let (program, plan) = (folder.file("program.json", "{}"), folder.file("plan.json", "{}"));
    for (name, text, beside) in
        [("scan.cps", "movej p1\n", &program), ("report.txt", "Can be scanned\n", &plan), ("report.html", "<html>\n", &plan)]
    {
        let found = folder.check(name, text).expect_err(name);
        assert!(found.ends_with(&format!("\n  → check {}, which lies beside it", beside.display())), "{found}");
    }
    // The program of the second setup was to be checked by the document of the first.
    let found = folder.check("program-2.src", "DEF vantage( )\n").expect_err("a program");
    assert!(found.contains("\n  → check the program-2.json that it was written from;"), "{found}");
    let second = folder.file("program-2.json", "{}");
    let found = folder.check("program-2.src", "DEF vantage( )\n").expect_err("a program");
    assert!(found.ends_with(&format!("\n  → check {}, which lies beside it", second.display())), "{found}");
    // Of a file that is meant for TOML, the place of the error matters.
    let found = folder.check("cell.toml", "name = \n").expect_err("cut off");
    assert!(found.contains(" at line ") && !found.contains('→'), "{found}");
}

/// A damaged plan switched the check of collisions off, or ended it in a panic.
#[test]
fn a_damaged_plan_is_no_reference() {
    let folder = Folder::new();
    let program = folder.file("program.json", "{}").display().to_string();
    let sound = plan_of_two_views();
    for (pointer, value, told) in [
        ("/params/motion/clearance_mm", -20.0, "/params/motion/clearance_mm: is -20 mm; allowed is 1 to 200 mm"),
        ("/params/motion/clearance_mm", 0.0, "/params/motion/clearance_mm: is 0 mm; allowed is 1 to 200 mm"),
        ("/viewpoints/0/part_from_scanner/translation_mm/0", 1e300, "allowed is -100000 to 100000 mm"),
    ] {
        let mut damaged = sound.clone();
        *damaged.pointer_mut(pointer).expect("is there") = value.into();
        let plan = folder.file("damaged.json", &damaged.to_string()).display().to_string();
        let found = check(&[&program, "--cell", "e05-transcan", "--plan", &plan]).expect_err("refused");
        assert!(found.contains("damaged.json: ") && found.contains(told), "{found}");
    }
}

/// A plan was found sound beside any part.
#[test]
fn a_plan_is_held_against_the_part_that_is_given() {
    let folder = Folder::new();
    let stl = write_stl(&box_mesh([0.0; 3], [60.0, 40.0, 30.0]));
    let part = folder.0.path().join("part.stl");
    std::fs::write(&part, &stl).expect("writes");
    let part = part.display().to_string();
    let against = |plan: &serde_json::Value, unit: &str| {
        let plan = folder.file("plan.json", &plan.to_string()).display().to_string();
        check(&[&plan, "--cell", "none", "--mesh", &part, "--unit", unit])
    };
    let mut plan = plan_of_two_views();
    let found = against(&plan, "mm").expect_err("another part");
    assert!(found.contains("part.stl: is not the part of the plan") && found.contains(&"0a".repeat(32)), "{found}");
    plan["part"]["sha256"] = plan_sha256(&stl).into();
    assert_eq!(against(&plan, "mm"), Ok(()));
    let found = against(&plan, "cm").expect_err("another unit");
    assert!(found.contains("part.stl (--unit cm): is ") && found.contains("the planned part is"), "{found}");
}

/// Any mesh was taken for the fixture.
#[test]
fn a_fixture_is_held_against_the_file_that_the_plan_names() {
    let folder = Folder::new();
    let stl = |name: &str, mesh: &Mesh| {
        let path = folder.0.path().join(name);
        std::fs::write(&path, write_stl(mesh)).expect("writes");
        path.display().to_string()
    };
    let block = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    // Within the block it hides nothing.
    let clamp = box_mesh([20.0, 10.0, 10.0], [22.0, 12.0, 12.0]);
    let (part, clamp, copy) = (stl("part.stl", &block), stl("clamp.stl", &clamp), stl("copy.stl", &clamp));
    let mut plan = plan_of_two_views();
    plan["part"]["sha256"] = plan_sha256(&write_stl(&block)).into();
    let against = |plan: &serde_json::Value, fixture: &str| {
        let plan = folder.file("plan.json", &plan.to_string()).display().to_string();
        check(&[&plan, "--cell", "none", "--mesh", &part, "--fixture", fixture, "--unit", "mm"])
    };
    let found = against(&plan, &clamp).expect_err("it has none");
    assert!(found.starts_with("--fixture: does not apply: the plan was made without a fixture"), "{found}");
    plan["params"]["part"]["fixture_mesh"] = clamp.clone().into();
    assert_eq!((against(&plan, &clamp), against(&plan, &copy)), (Ok(()), Ok(())));
    let found = against(&plan, &part).expect_err("another file");
    assert!(found.contains("part.stl: is not the fixture of the plan: its SHA-256 is ") && found.contains(&clamp), "{found}");
    plan["params"]["part"]["fixture_mesh"] = "nowhere.stl".into();
    assert_eq!(against(&plan, &copy), Ok(()), "which one it was is not known, and told so");
    // What is no file may have no end, as /dev/zero has none.
    if cfg!(unix) {
        plan["params"]["part"]["fixture_mesh"] = "/dev/null".into();
        assert_eq!(against(&plan, &copy), Ok(()), "it is not read");
    }
}

/// The file that has the fixture's name now was compared: the right fixture was refused, and one that was changed passed.
#[test]
fn a_fixture_is_held_against_the_digest_in_the_plan_whatever_lies_at_its_name() {
    let folder = Folder::new();
    let stl = |name: &str, mesh: &Mesh| {
        let path = folder.0.path().join(name);
        std::fs::write(&path, write_stl(mesh)).expect("writes");
        path.display().to_string()
    };
    let block = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    // Within the block they hide nothing.
    let (clamp, changed) = (box_mesh([20.0, 10.0, 10.0], [22.0, 12.0, 12.0]), box_mesh([20.0, 10.0, 10.0], [22.0, 12.0, 13.0]));
    let (part, kept, at_name) = (stl("part.stl", &block), stl("kept.stl", &clamp), stl("clamp.stl", &changed));
    let mut plan = plan_of_two_views();
    plan["part"]["sha256"] = plan_sha256(&write_stl(&block)).into();
    plan["params"]["part"]["fixture_mesh"] = at_name.clone().into();
    plan["fixture"] = serde_json::json!({
        "sha256": plan_sha256(&write_stl(&clamp)),
        "bbox_mm": {"min": [20.0, 10.0, 10.0], "max": [22.0, 12.0, 12.0]},
    });
    let against = |plan: &serde_json::Value, fixture: &str| {
        let plan = folder.file("plan.json", &plan.to_string()).display().to_string();
        check(&[&plan, "--cell", "none", "--mesh", &part, "--fixture", fixture, "--unit", "mm"])
    };
    assert_eq!(against(&plan, &kept), Ok(()), "the file that was planned with, under another name");
    let found = against(&plan, &at_name).expect_err("the changed one");
    assert!(found.contains("clamp.stl: is not the fixture of the plan: its SHA-256 is "), "{found}");
    plan["fixture"]["bbox_mm"]["max"] = serde_json::json!([70.8, 60.8, 60.8]);
    let found = against(&plan, &kept).expect_err("planned in another unit");
    assert!(found.contains("kept.stl: is ") && found.contains("as read; the planned fixture is "), "{found}");
    plan["fixture"]["sha256"] = "0A".into();
    let found = against(&plan, &kept).expect_err("no digest");
    assert!(found.contains("is not the fixture of the plan"), "{found}");
}

/// Options that count for nothing were passed over in silence.
#[test]
fn an_option_that_no_file_is_checked_with_is_refused_by_name() {
    let folder = Folder::new();
    let scanner = folder.file("scanner.toml", preset_text(SpecKind::Scanner, "transcan-c").expect("preset"));
    let params = folder.file("params.toml", "[motion]\nclearance_mm = 3.0\n");
    let plan = folder.file("plan.json", &plan_of_two_views().to_string());
    let program = folder.file("program.json", "{\"schema\": \"vantage.program/1\"}");
    let [scanner, params, plan, program] = [scanner, params, plan, program].map(|path| path.display().to_string());
    for (args, told) in [
        (
            &[&*program, "--cell", "e05-transcan", "--temperature", "60"][..],
            "--temperature: does not apply: cell e05-transcan is not calibrated; leave it out",
        ),
        (&[&*scanner, "--cell", "e05-transcan"][..], "--cell: does not apply to a scanner, which is checked by itself"),
        (&[&params, "--temperature", "20"], "--temperature: does not apply to parameters"),
        (&[&plan, "--cell", "e05-transcan"], "--cell: does not apply: the plan was made without a cell; leave it out, or give"),
        (&[&plan, "--cell", "none", "--plan", &plan], "--plan: does not apply to a plan"),
        (&[&params, "--unit", "mm"], "--unit mm: is the unit of meshes, and none is given"),
        (&[&params, "--cell", "e05-transcan", "--scanner", "transcan-c"], "--scanner can only be used with --cell none"),
    ] {
        let found = check(args).expect_err(told);
        assert!(found.starts_with(told), "{found}");
    }
    assert_eq!(check(&[&scanner, &params, "--cell", "e05-transcan"]), Ok(()), "the parameters are held against it");
    assert_eq!(check(&[&plan, &params, "--cell", "none"]), Ok(()));
    let found = check(&[&plan, "--cell", "none", "--scanner", "transcan-c"]).expect_err("another scanner");
    assert!(
        found.contains("plan.json: /scanner/name: is \"transcan-c-nominal\"; the given scanner is \"transcan-c\""),
        "{found}"
    );
}

/// The part was taken to rest as by default, wherever it lay.
#[test]
fn a_program_is_checked_with_a_part_only_beside_its_plan() {
    let folder = Folder::new();
    let home = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0];
    let program = serde_json::json!({
        "schema": "vantage.program/1", "plan_sha256": "00".repeat(32), "robot": "hans-e05", "turntable": "minas-a6-500",
        "home_deg": home, "cycle_secs": 0.0, "steps": [],
    });
    let program = folder.file("program.json", &program.to_string()).display().to_string();
    let part = folder.0.path().join("part.stl");
    std::fs::write(&part, write_stl(&box_mesh([0.0; 3], [60.0, 40.0, 30.0]))).expect("writes");
    let part = part.display().to_string();
    let in_cell = [program.as_str(), "--cell", "e05-transcan"];
    assert_eq!(check(&in_cell), Ok(()));
    let found = check(&[&in_cell[..], &["--mesh", &part, "--unit", "mm"]].concat()).expect_err("refused");
    assert!(found.contains("program.json: is to be checked with the part, but without its plan"), "{found}");
}

/// The doubt remained a warning, and the exit code was 0.
#[test]
fn a_part_in_a_doubtful_unit_is_an_error_with_strict() {
    let folder = Folder::new();
    let program = serde_json::json!({
        "schema": "vantage.program/1", "plan_sha256": "00".repeat(32), "robot": "hans-e05", "turntable": "minas-a6-500",
        "home_deg": [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0], "cycle_secs": 0.0, "steps": [],
    });
    let program = folder.file("program.json", &program.to_string()).display().to_string();
    let part = folder.0.path().join("tiny.stl");
    std::fs::write(&part, write_stl(&box_mesh([0.0; 3], [0.3, 0.2, 0.1]))).expect("writes");
    let part = part.display().to_string();
    let checked = [program.as_str(), "--cell", "e05-transcan", "--mesh", &part, "--unit", "mm"];
    let doubt = format!("{part}: --unit: is 0.30 × 0.20 × 0.10 mm as read in mm");
    // Both lack the plan that says where the part lies.
    let found = check(&checked).expect_err("refused");
    assert!(found.contains("program.json: is to be checked") && !found.contains(&doubt), "{found}");
    let strict = check(&[&checked[..], &["--strict"]].concat()).expect_err("refused");
    assert!(strict.contains("program.json: is to be checked") && strict.contains(&doubt), "{strict}");
}
