use std::path::PathBuf;

use super::inspect::{InspectArgs, report};
use super::*;
use crate::cell::{CellSpec, Dialect, Named, Presets, SpecLibrary};
use crate::geometry::demo_parts::DemoPart;
use crate::geometry::{LengthUnit, Poll};
use crate::inspection::InspectionParams;
use crate::service::inspect_job::INSPECTION_FILES;
use crate::testing::arm_urdf;
use crate::wire::plan::{RegionCoverageDocument, RegionMissDocument};

fn inspect(bytes: &[u8], unit: Option<LengthUnit>, json: bool) -> Result<String, CliError> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("part");
    std::fs::write(&file, bytes).expect("a file");
    report(&InspectArgs { file, unit, cell: None, scanner: None, json })
}

#[test]
fn a_scanner_is_inspected_by_the_name_of_its_preset() {
    let args = |file: &str| InspectArgs { file: file.into(), unit: None, cell: None, scanner: None, json: false };
    let told = report(&args("transcan-c")).expect("a preset");
    assert!(told.starts_with("scanner transcan-c\n"), "{told}");
    assert!(report(&args("transcan-d")).is_err_and(|error| error.to_string().contains("transcan-d")));
}

/// A scanner in JSON, as `vantage presets NAME --json` writes it, was told as a mesh in glTF.
#[test]
fn a_scanner_is_inspected_in_json_as_in_toml() {
    let spec = Presets.scanner("transcan-c").expect("a preset");
    let text = serde_json::to_string_pretty(&spec).expect("JSON");
    for text in [text.clone(), format!("\u{feff}{text}")] {
        let told = inspect(text.as_bytes(), None, false).expect("a scanner");
        assert!(told.starts_with("scanner transcan-c\nrig     baseline 209.94 mm"), "{told}");
    }
    let lacking = inspect(b"{\"depth_mm\": {\"near\": 1.0}}", None, false).expect_err("lacks fields").to_string();
    assert!(lacking.contains("/projector") && !lacking.contains("glTF"), "{lacking}");
    // A mesh in glTF has materials, as parameters have.
    let mesh = inspect(b"{\"asset\": {}, \"materials\": []}", None, false).expect_err("no scanner").to_string();
    assert!(mesh.contains("JSON (perhaps glTF)"), "{mesh}");
}

/// A misspelled preset was told as a missing file alone.
#[test]
fn a_name_that_is_neither_a_file_nor_a_scanner_preset_is_told_the_presets() {
    let told = |file: &str| {
        let args = InspectArgs { file: file.into(), unit: None, cell: None, scanner: None, json: false };
        let error = report(&args).expect_err("no such file");
        assert_eq!(error.exit_code(), 2);
        error.to_string()
    };
    let preset = told("transcan-d");
    assert!(
        preset.starts_with("transcan-d: there is no such file; there is no such scanner preset either; the presets are "),
        "{preset}"
    );
    assert!(preset.contains("transcan-c, ") && preset.ends_with("; did you mean transcan-c?"), "{preset}");
    let robot = told("hans-e05");
    assert!(
        robot.ends_with("it is the name of a robot preset, not of a scanner preset; `vantage presets hans-e05` prints it"),
        "{robot}"
    );
    for file in ["transcan-d.toml", "/nowhere/transcan-d"] {
        assert!(!told(file).contains("preset"), "{}", told(file));
    }
    assert!(told("-").contains("standard input is not read") && !told("-").contains("preset"), "{}", told("-"));
}

/// −0.000 was told.
#[test]
fn a_figure_that_rounds_to_nothing_has_no_sign_and_what_is_not_nothing_has_digits() {
    let text =
        inspect(b"v -0.0000004 0 0\nv 0.2 0 0\nv 0 0.1 0\nf 1 2 3\n", Some(LengthUnit::Millimetre), false).expect("a report");
    for line in ["x, y, z     0.000 … 0.200, 0.000 … 0.100, 0.000 … 0.000 mm\n", "area        0.0100 mm²\n"] {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
}

const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 1 2\n";

#[test]
fn inspect_says_what_is_wrong_and_what_to_do() {
    let text = inspect(TRIANGLE, Some(LengthUnit::Centimetre), false).expect("a report");
    for line in
        ["size        10.000 × 10.000 × 0.000 mm", "triangles   1 of 2 in the file", "open along 3 edges", "→ only the side"]
    {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
}

#[test]
fn inspect_json_has_units_in_its_keys() {
    let text = inspect(TRIANGLE, Some(LengthUnit::Inch), true).expect("a report");
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["bbox_mm"]["max"], serde_json::json!([25.4, 25.4, 0.0]));
    assert_eq!((json["unit"].as_str(), json["format"].as_str()), (Some("inch"), Some("obj")));
    assert_eq!(json["warnings"][0]["code"], "open_surface");
    assert!(json["volume_mm3"].is_null());
}

#[test]
fn inspect_needs_no_unit_and_prints_the_size_in_all_four() {
    let text = inspect(TRIANGLE, None, false).expect("a report");
    for line in [
        "in mm       1.00 × 1.00 × 0 mm\n",
        "in cm       10.0 × 10.0 × 0 mm\n",
        "in m        1000 × 1000 × 0 mm\n",
        "in inches   25.4 × 25.4 × 0 mm\n",
    ] {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
    assert!(!text.contains("\n  area") && text.contains("triangles   1 of 2"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&inspect(TRIANGLE, None, true).expect("a report")).expect("JSON");
    assert!(json["unit"].is_null() && json.get("bbox_mm").is_none() && json.get("area_mm2").is_none(), "{json}");
    assert_eq!(json["readings"][3], serde_json::json!({"unit": "inch", "size_mm": [25.4, 25.4, 0.0]}));
}

#[test]
fn inspect_says_which_unit_suits_scanner_and_plate() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("part.obj");
    std::fs::write(&file, "v 0 0 0\nv 4.76 0 0\nv 0 2.87 1.46\nf 1 2 3\n").expect("a file");
    let args = |unit: Option<LengthUnit>| InspectArgs {
        file: file.clone(),
        unit,
        cell: Some("e05-transcan".into()),
        scanner: None,
        json: false,
    };
    let text = report(&args(None)).expect("a report");
    for line in [
        "in mm       4.76 × 2.87 × 1.46 mm, does not fit",
        "in m        4760 × 2870 × 1460 mm, does not fit",
        "in inches   120.9 × 72.9 × 37.1 mm, fits",
    ] {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
    let warned = report(&args(Some(LengthUnit::Millimetre))).expect("a report");
    assert!(warned.contains("! the part is 4.76") && warned.contains("inches (120.9 × 72.9 × 37.1 mm)"), "{warned}");
    assert!(!report(&args(Some(LengthUnit::Inch))).expect("a report").contains("the part is"));
    let scanner = InspectArgs { cell: None, scanner: Some("nobody".into()), ..args(None) };
    assert_eq!(report(&scanner).expect_err("no such scanner").exit_code(), 2);
}

#[test]
fn bad_input_exits_2_with_the_place() {
    let error = inspect(b"v 0 0 nan\n", Some(LengthUnit::Metre), false).expect_err("not finite");
    assert!(error.exit_code() == 2 && error.to_string().contains("line 1"), "{error}");
    let error = inspect(b"# A title\n\nText that is neither.\n", None, false).expect_err("no mesh");
    assert!(error.to_string().contains("neither a mesh (STL, OBJ or PLY) nor a scanner (TOML)"), "{error}");
    let missing = InspectArgs { file: PathBuf::from("/nowhere/part.stl"), unit: None, cell: None, scanner: None, json: false };
    assert_eq!(report(&missing).expect_err("no file").exit_code(), 2);
}

#[test]
fn part_writes_what_inspect_reads() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("base.stl");
    let args = part::PartArgs { part: DemoPart::Base, triangles: 20_000, out: out.clone() };
    part::run(&args).expect("a file");
    let text = report(&InspectArgs { file: out, unit: Some(LengthUnit::Millimetre), cell: None, scanner: None, json: false })
        .expect("a report");
    assert!(text.contains("121.000 × 73.000 × 37.000 mm") && text.contains("no problems found"), "{text}");
    let few = part::PartArgs { triangles: 10, ..args };
    assert_eq!(part::run(&few).expect_err("too few").exit_code(), 2);
}

#[test]
fn robot_writes_a_specification_and_surfaces_that_a_cell_takes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(path("arm.urdf"), arm_urdf("revolute")).expect("a file");
    let (urdf, out, surfaces) = (path("arm.urdf"), path("arm.toml"), path("surfaces"));
    let line = ["vantage", "robot", &urdf, "--payload", "5", "--dialect", "rapid", "--out", &out, "--surfaces", &surfaces];
    let Command::Robot(args) = Cli::try_parse_from(line).expect("a command").command else {
        unreachable!("the command asked for")
    };
    robot::run(&args).expect("files");
    let mut spec: CellSpec = Presets.cell("e05-transcan").expect("a preset");
    (spec.robot, spec.home_deg, spec.floor_mm) = (Named::Name(out), [0.0, 0.0, 60.0, 0.0, 60.0, 0.0, 0.0], None);
    spec.obstacles.clear();
    let cell = spec.build(&files::FileLibrary).unwrap_or_else(|errors| panic!("{errors:#?}"));
    assert_eq!((cell.link_surfaces.len(), cell.robot.links.len()), (6, 6));
    assert_eq!(cell.robot.dialect, Some(Dialect::Rapid));
    assert!(cell.link_surfaces.iter().enumerate().all(|(index, surface)| surface.link == index + 1));
    std::fs::remove_dir_all(&surfaces).expect("there");
    let errors = spec.build(&files::FileLibrary).map(|cell| cell.name).expect_err("the files are gone");
    assert!(errors.iter().any(|error| error.pointer == "/robot/surfaces/5/shape/mesh"), "{errors:#?}");
}

#[test]
fn paths_in_a_specification_count_from_its_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let preset = |kind, name: &str| crate::cell::preset_text(kind, name).expect("a preset");
    std::fs::create_dir(path("arms")).expect("a folder");
    std::fs::write(path("arms/mine.toml"), preset(crate::cell::SpecKind::Robot, "hans-e05")).expect("a file");
    let named = |robot: &str| {
        let text = preset(crate::cell::SpecKind::Cell, "e05-transcan").replace("\"hans-e05\"", &format!("{robot:?}"));
        std::fs::write(path("cell.toml"), text).expect("a file");
        files::cell(&path("cell.toml")).map(|(spec, _)| spec)
    };
    let spec = named("arms/mine.toml").expect("a cell");
    assert_eq!(spec.robot, Named::Name(path("arms/mine.toml")));
    assert!(spec.build(&files::FileLibrary).is_ok(), "the robot is found");
    assert_eq!(named("ur10e").expect("a cell").robot, Named::Name("ur10e".to_owned()), "a preset");
    // Tests run in the folder of the package.
    let told = named("config/robots/hans-e05.toml").map(|spec| spec.name).expect_err("from the working folder").to_string();
    let beside = path("config/robots/hans-e05.toml");
    assert!(told.contains(&format!("/robot: is \"config/robots/hans-e05.toml\", and there is no {beside}: ")), "{told}");
    let told = named("LICENSE-MIT").map(|spec| spec.name).expect_err("a file without an extension").to_string();
    assert!(told.contains("/robot: is \"LICENSE-MIT\", and there is no "), "{told}");
    assert_eq!(named("").expect("a cell").robot, Named::Name(String::new()), "told as empty, not as a folder");
}

/// A file that came through a pipe was once taken to lie in the folder of its descriptor.
#[test]
#[cfg(unix)]
fn paths_in_a_specification_that_comes_through_a_pipe_count_from_the_working_folder() {
    use std::os::fd::AsRawFd as _;
    let robot = "config/robots/hans-e05.toml";
    let text = crate::cell::preset_text(crate::cell::SpecKind::Cell, "e05-transcan").expect("a preset");
    let text = text.replace("\"hans-e05\"", &format!("{robot:?}"));
    let (pipe, mut sender) = std::io::pipe().expect("a pipe");
    std::io::Write::write_all(&mut sender, text.as_bytes()).expect("taken");
    drop(sender);
    let stored = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(stored.path(), &text).expect("written");
    for descriptor in [pipe.as_raw_fd(), stored.as_file().as_raw_fd()] {
        let (spec, _) = files::cell(&format!("/dev/fd/{descriptor}")).expect("a cell");
        assert_eq!(spec.robot, Named::Name(robot.to_owned()));
        assert!(spec.build(&files::FileLibrary).is_ok(), "the robot is found");
    }
}

/// A plan that stops before it begins, since it is cancelled.
fn plan_cancelled(extra: &[&str]) -> Result<(), CliError> {
    let folder = tempfile::tempdir().expect("a folder");
    let part = folder.path().join("part.obj");
    std::fs::write(&part, TRIANGLE).expect("a file");
    let part = part.display().to_string();
    let line = [&["vantage", "plan", &part, "--unit", "mm", "--cell", "none"], extra].concat();
    let cli = Cli::try_parse_from(line).map_err(|error| CliError::BadInput(error.to_string()))?;
    let Command::Plan(args) = cli.command else { unreachable!("the command asked for") };
    plan::run(&args, &AtomicBool::new(true))
}

#[test]
fn the_folder_for_results_is_made_and_tried_before_planning() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("taken");
    std::fs::write(&file, b"kept").expect("a file");
    for out in [file.clone(), file.join("below")] {
        let error = plan_cancelled(&["--out", &out.display().to_string()]).expect_err("no folder");
        assert!(error.exit_code() == 2 && error.to_string().contains("name a folder"), "{error}");
    }
    let fresh = folder.path().join("a/b");
    let error = plan_cancelled(&["--out", &fresh.display().to_string()]).expect_err("cancelled");
    assert_eq!(error.exit_code(), 4, "{error}");
    assert!(!fresh.exists(), "a command that fails leaves no empty folder");
    if cfg!(target_os = "linux") {
        let error = plan_cancelled(&["--out", "/proc/nowhere"]).expect_err("the system's own");
        assert!(error.exit_code() == 1 && error.to_string().contains("cannot be written"), "{error}");
    }
}

#[test]
fn a_region_is_told_with_what_is_asked_reached_and_missed() {
    let unmet = RegionCoverageDocument {
        name: "bore".to_owned(),
        kind: "feature".to_owned(),
        samples: 90,
        asked_area_mm2: 900.0,
        coverable_area_mm2: 0.0,
        measured_area_mm2: 0.0,
        of_asked: 0.0,
        of_coverable: 0.0,
        target: Some(0.95),
        met: Some(false),
        tolerance_mm: Some(0.05),
        min_tolerance_mm: Some(0.156),
        missed: vec![RegionMissDocument { reason: "below_grade".to_owned(), area_mm2: 900.0 }],
        beyond_noise_area_mm2: 900.0,
        independent_samples: None,
        independent_of_asked: None,
        independent_standard_error: None,
        independently_met: None,
        why_unmet: Some("below_grade 900.0 mm²".to_owned()),
    };
    let told = summary::region_summary(&unmet);
    assert_eq!(
        told,
        "Region \"bore\" (feature, tolerance ±0.025 mm; 900.0 mm², 90 samples): 0.00 %, target 95.00 %: NOT MET\n  missed: \
         below_grade 900.0 mm²"
    );
    let met = RegionCoverageDocument { of_asked: 0.97, met: Some(true), why_unmet: None, ..unmet.clone() };
    assert!(summary::region_summary(&met).ends_with(": 97.00 %, target 95.00 %: met"));
    let free = RegionCoverageDocument { target: None, met: None, tolerance_mm: None, why_unmet: None, ..unmet };
    assert!(summary::region_summary(&free).ends_with("(feature; 900.0 mm², 90 samples): 0.00 %, no target"));
    let nearly = RegionCoverageDocument { samples: 1, of_asked: 0.999_96, ..met.clone() };
    assert!(summary::region_summary(&nearly).contains("1 sample): 99.99 %, target 95.00 %: met"));
    let below = RegionCoverageDocument { of_asked: 0.949_96, met: Some(false), ..met.clone() };
    assert!(summary::region_summary(&below).ends_with(": 94.99 %, target 95.00 %: NOT MET"));
    let refuted = RegionCoverageDocument {
        independent_samples: Some(475),
        independent_of_asked: Some(0.931),
        independent_standard_error: Some(0.011_6),
        independently_met: Some(false),
        ..met
    };
    assert!(
        summary::region_summary(&refuted).ends_with(
            ": 97.00 %, target 95.00 %: met on the samples that views were chosen on; on 475 others 93.10 %, standard error 1.16 points: \
             NOT CONFIRMED"
        ),
        "{}",
        summary::region_summary(&refuted)
    );
}

#[test]
fn threads_are_a_number_up_to_1024() {
    for wrong in ["1025", "70000", "many"] {
        let refused = plan_cancelled(&["--out", "out", "--threads", wrong]).expect_err("out of range");
        assert!(refused.exit_code() == 2 && refused.to_string().contains("--threads"), "{refused}");
    }
}

/// Text that is broken by hand is broken again where the terminal is narrower.
#[test]
fn the_ends_of_help_texts_are_wrapped_by_the_terminal_alone() {
    fn held(command: &clap::Command) {
        let end = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        for line in end.lines().filter(|line| !line.is_empty()) {
            let is_example = line.starts_with("  ");
            assert!(!is_example || line.chars().count() <= 80, "{}: too wide for 80 columns: {line}", command.get_name());
            assert!(is_example || line.ends_with(['.', ':']), "{}: broken by hand: {line}", command.get_name());
        }
        command.get_subcommands().for_each(held);
    }
    held(&<Cli as clap::CommandFactory>::command());
}

/// The file of `vantage robot`, which is TOML, was to be uploaded to a route that takes JSON.
#[test]
fn the_help_of_a_robot_says_that_a_server_takes_json() {
    let command = <Cli as clap::CommandFactory>::command();
    let help = command.find_subcommand("robot").and_then(clap::Command::get_after_help).map(ToString::to_string);
    let help = help.unwrap_or_default();
    let wanted = "takes the same fields as JSON, with PUT /api/v1/robots/{name}";
    assert!(help.contains(wanted) && !help.contains("upload it"), "{help}");
}

/// A cell was told every field that a scanner has and it lacks, a plan to be perhaps glTF.
#[test]
fn inspect_says_what_a_file_is_that_is_no_mesh_and_no_scanner() {
    let folder = tempfile::tempdir().expect("a folder");
    let told = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).expect("a file");
        let args = InspectArgs { file, unit: None, cell: None, scanner: None, json: false };
        report(&args).expect_err("nothing to inspect").to_string()
    };
    let plan = "{\"schema\": \"vantage.plan/1\"}";
    let program = "{\"schema\": \"vantage.program/1\"}";
    for (name, text, wanted) in [
        ("cell.toml", "base_from_table = {}\n", "cell.toml: is a cell, not a mesh or a scanner; `vantage check "),
        ("plan.json", plan, "plan.json` checks it, and `vantage program` takes it with its program"),
        ("program.json", program, "is a program, not a mesh or a scanner; `vantage check "),
        ("arm.toml", "joints = []\n", "is a robot, not a mesh or a scanner; `vantage check "),
        ("params.toml", "setups = 2\n", "holds parameters of a plan, not a mesh or a scanner; --params takes it"),
        ("coverage.json", "{\"schema\": \"vantage.coverage/1\"}", "is a document of schema \"vantage.coverage/1\", not a mesh"),
        ("report.html", "<!DOCTYPE html>\n", "is an HTML page, such as a report, not a mesh or a scanner"),
        ("report.txt", "Can be scanned\n", "is a plain text, such as a report, not a mesh or a scanner"),
        ("coverage.csv", "face,area_mm2\n", "is a table, not a mesh or a scanner"),
        ("scene.gltf", "{\"asset\": {}}", "perhaps glTF"),
        ("part.amf", "<?xml version=\"1.0\"?>\n<amf>\n", "XML"),
        ("mine.toml", "name = \n", "neither a mesh (STL, OBJ or PLY) nor a scanner (TOML): "),
    ] {
        let found = told(name, text);
        assert!(found.contains(wanted) && !found.contains('\n'), "{name}: {found}");
    }
    assert!(!told("points.dat", "1 2 3\n").contains("controller"), "many programs write tables named .dat");
    let refused = files::mesh(&folder.path().join("cell.toml"), Some(LengthUnit::Millimetre), &Poll::never()).map(drop);
    let refused = refused.expect_err("no mesh").to_string();
    assert!(refused.contains("cell.toml: is a cell, not a mesh; `vantage check "), "{refused}");
    let args = InspectArgs { file: folder.path().to_owned(), unit: None, cell: None, scanner: None, json: false };
    let found = report(&args).expect_err("a folder").to_string();
    assert!(found.ends_with(": is a folder; give a file in it"), "{found}");
}

#[test]
fn a_file_without_permission_is_told_what_to_do() {
    let denied = std::io::Error::from(std::io::ErrorKind::PermissionDenied);
    let told = files::unreadable("cell.toml".as_ref(), &denied).to_string();
    assert_eq!(told, "cell.toml: cannot be read: permission denied; give yourself permission to read it");
}

#[test]
fn the_help_of_a_comparison_names_every_file_and_every_parameter() {
    let command = <Cli as clap::CommandFactory>::command();
    let compare = command.find_subcommand("compare").expect("a command");
    let help = compare.get_after_long_help().map(ToString::to_string).unwrap_or_default();
    let (files, parameters) = help.split_once("Parameters for --set:").expect("parameters");
    let (_, files) = files.split_once("Files written to --out:").expect("files");
    for name in INSPECTION_FILES {
        assert!(files.contains(name), "{name} is not in\n{files}");
    }
    let params = serde_json::to_value(InspectionParams::default()).expect("JSON");
    for (table, fields) in params.as_object().expect("tables") {
        for field in fields.as_object().expect("a table").keys() {
            assert!(parameters.contains(&format!("{table}.{field}")), "{table}.{field} is not in\n{parameters}");
        }
    }
    assert!(parameters.contains("compare.tolerance_mm = 0.15    (0.001 to 100 mm)\n    Distance"), "{parameters}");
}

/// The help told the defaults of parameters alone.
#[test]
fn the_help_of_a_rescan_names_every_parameter_with_its_range() {
    let command = <Cli as clap::CommandFactory>::command();
    let rescan = command.find_subcommand("rescan").expect("a command");
    let help = rescan.get_after_long_help().map(ToString::to_string).unwrap_or_default();
    let (_, parameters) = help.split_once("Parameters for --set:").expect("parameters");
    for told in
        ["max_views = 4    (1 to 1000 views)\n", "min_gain = 0.002    (0 to 1)\n", "max_rounds = 2    (1 to 100 rounds)\n"]
    {
        assert!(parameters.contains(told), "{told} is not in\n{parameters}");
    }
    assert!(parameters.contains("min_left = 0.005    (0 to 1)\n"), "{parameters}");
}

#[test]
fn a_dash_is_no_file_and_no_standard_input() {
    let file = std::path::Path::new("-");
    let mesh = files::mesh(file, Some(LengthUnit::Millimetre), &Poll::never()).map(|_| ());
    let text = files::value(file).map(|_| ());
    let inspected =
        report(&InspectArgs { file: file.to_owned(), unit: None, cell: None, scanner: None, json: false }).map(|_| ());
    for refused in [mesh, text, inspected] {
        let told = refused.expect_err("standard input").to_string();
        assert_eq!(told, "-: standard input is not read; write it to a file and give that file's name");
    }
}

/// JSON with the mark was taken for TOML, and refused at its second column.
#[test]
fn a_file_may_begin_with_a_byte_order_mark() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [("params.json", "\u{feff}{\"seed\": 3}\n"), ("params.toml", "\u{feff}seed = 3\n")] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        assert_eq!(files::value(&path), Ok(serde_json::json!({ "seed": 3 })), "{name}");
    }
    let path = folder.path().join("broken.json");
    std::fs::write(&path, "\u{feff}{\"seed\": x}").expect("a file");
    let told = files::value(&path).expect_err("no JSON").to_string();
    assert!(told.contains("`x` is not a JSON value") && told.contains("line 1, column 10"), "{told}");
}

#[test]
fn what_a_set_gives_is_refused_at_the_option() {
    let refused = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        super::given_params::load_params(None, &sets).expect_err("refused").to_string()
    };
    for (sets, told) in [
        (&["selection.target=90"][..], "--set selection.target=90: is 90; allowed is 0 to 1; 90 % is 0.9"),
        (&["selection.target=x"], "--set selection.target=x: is \"x\"; expected a number; allowed is 0 to 1"),
        (
            &["selection.target=0,9"],
            "--set selection.target=0,9: is \"0,9\"; expected a number; allowed is 0 to 1; use a point as decimal separator",
        ),
        (&["setups=-1"], "--set setups=-1: is -1; allowed is 1 to 4"),
        (&["setups=1.5"], "--set setups=1.5: is 1.5; expected a whole number; allowed is 1 to 4"),
        (&["=3"], "--set =3: names no parameter; give KEY=VALUE, such as selection.target=0.99"),
        (&["setups=99", "setups=9"], "--set setups=9: is 9; allowed is 1 to 4"),
        (&["selection={\"target\": 2}"], "--set selection={\"target\": 2}: /target: is 2; allowed is 0 to 1"),
    ] {
        assert_eq!(refused(sets), told);
    }
}

#[test]
fn a_negative_number_is_a_value_whose_range_is_told() {
    let refused = |options: &[&str]| {
        let line = [&["vantage", "plan", "part.stl", "--unit", "mm", "--out", "out"], options].concat();
        parse(line).map(|_| ()).expect_err("refused").to_string()
    };
    assert!(refused(&["--max-secs", "-1"]).contains("is -1; allowed is 0, or 1 to 604800"));
    assert!(refused(&["--max-memory", "-1"]).contains("is -1; allowed is 0, or a whole number of 256 or more"));
    assert!(refused(&["--threads", "-1"]).contains("is -1; allowed is a whole number from 0 to 1024"));
    assert!(parse(["vantage", "plan", "part.stl", "--unit", "mm", "--out", "out", "--up", "-y"]).is_ok());
}

#[test]
fn words_of_closed_lists_are_told_where_one_is_unknown() {
    let refused = |line: &[&str]| parse(line).map(|_| ()).expect_err("refused").to_string();
    let mode = refused(&["vantage", "run", "p", "--cell", "e05-transcan", "--mode", "Live"]);
    assert!(mode.contains("use one of simulate, dry_run, live"), "{mode}");
    let frame = refused(&["vantage", "compare", "p", "s", "--mesh", "m", "--unit", "mm", "--out", "o", "--frame", "robot"]);
    assert!(frame.contains("use one of ") && frame.contains("scanner"), "{frame}");
    let listen = refused(&["vantage", "serve", "--listen", "8080"]);
    assert!(listen.contains("give ADDRESS:PORT, as in 127.0.0.1:8080"), "{listen}");
}

#[test]
fn a_mesh_is_no_text() {
    let refused = files::refuse_mesh("base.STL".as_ref(), "a URDF file").expect_err("a mesh").to_string();
    assert_eq!(refused, "base.STL: is a mesh, not a URDF file; `vantage inspect` examines it");
    assert_eq!(files::refuse_mesh("arm.urdf".as_ref(), "a URDF file"), Ok(()));
}

#[test]
fn a_negative_number_in_a_file_of_parameters_is_told_the_range() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("params.toml");
    std::fs::write(&file, "setups = -1\n").expect("a file");
    let error = super::given_params::load_params(Some(&file), &[]).expect_err("refused");
    assert_eq!(error.to_string(), "parameters: /setups: is -1; allowed is 1 to 4");
}

#[test]
fn a_device_of_another_kind_is_told_as_such() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sc.toml").display().to_string();
    let scanner = crate::cell::preset_text(crate::cell::SpecKind::Scanner, "transcan-c-nominal").expect("a preset");
    std::fs::write(&path, scanner).expect("a file");
    let refused = |name: &str| files::cell(name).map(|_| ()).expect_err("no cell").to_string();
    assert_eq!(refused(&path), format!("{path}: is a scanner, not a cell; --scanner takes it, with --cell none"));
    assert_eq!(refused("ur10e"), "--cell ur10e: is a robot, not a cell; a cell names it");
    assert!(refused("").starts_with("--cell: is empty; give a file or a preset"));
    let mut cell: CellSpec = Presets.cell("e05-transcan").expect("a preset");
    cell.scanner = Named::Name("ur10e".to_owned());
    let errors = cell.build(&files::FileLibrary).map(|cell| cell.name).expect_err("a robot");
    assert!(errors.iter().any(|error| error.detail.contains("which is a robot, not a scanner")), "{errors:?}");
    let preset = super::given_params::load_params(Some("thesis".as_ref()), &[]).expect_err("a preset").to_string();
    assert_eq!(preset, "--params thesis: is a preset; give --set preset=thesis");
}

#[test]
fn a_file_of_another_kind_is_not_taken_for_parameters() {
    let folder = tempfile::tempdir().expect("a folder");
    let cell = crate::cell::preset_text(crate::cell::SpecKind::Cell, "e05-transcan").expect("a preset");
    for (text, told) in [
        (cell, "is a cell, not parameters; --cell takes it"),
        ("[telemetry]\n", "is a configuration file of the server; `vantage serve --config` takes it"),
        ("schema = \"vantage.plan/1\"\n", "is a plan, not parameters; its field `params` has the parameters"),
    ] {
        let file = folder.path().join("file.toml");
        std::fs::write(&file, text).expect("a file");
        let error = super::given_params::load_params(Some(&file), &[]).expect_err("refused");
        assert_eq!(error.to_string(), format!("--params {}: {told}", file.display()));
    }
    let file = folder.path().join("params.toml");
    std::fs::write(&file, "[selection]\nmax_views = 3\n").expect("a file");
    assert_eq!(super::given_params::load_params(Some(&file), &[]).expect("parameters").selection.max_views, Some(3));
}
