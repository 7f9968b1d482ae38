//! `vantage plan` as a process: what it says before it plans, how it ends on a signal, and what it says of regions that miss
//! their targets.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::server::process::vantage;
use crate::support::box_mesh;

#[test]
fn a_doubtful_mesh_is_told_before_planning_and_sigterm_cancels_with_4() {
    let folder = tempfile::tempdir().expect("a folder");
    let part = folder.path().join("part.obj");
    std::fs::write(&part, "v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\n").expect("a file");
    let out = folder.path().join("out");
    // So many samples and directions that planning lasts.
    let fine = [
        "candidates.strategies=[\"ellipsoid\"]",
        "part.samples_per_mm2=5",
        "candidates.step_small_deg=2",
        "candidates.step_large_deg=2",
    ];
    let mut child = vantage()
        .args(["plan", &part.display().to_string(), "--unit", "mm", "--cell", "none", "--out", &out.display().to_string()])
        .args(fine.iter().flat_map(|set| ["--set", set]))
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program");
    let mut said = Vec::new();
    let mut lines = BufReader::new(child.stderr.take().expect("its messages")).lines().map_while(Result::ok);
    // The first stage is named once planning has begun.
    said.extend(lines.by_ref().take_while(|line| line != "surface"));
    let sent = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill");
    assert!(sent.success());
    said.extend(lines);
    let status = child.wait().expect("its end");
    assert_eq!(status.code(), Some(4), "{said:#?}");
    let told = said.join("\n");
    assert!(told.contains("part.obj: ") && told.contains("→ "), "{told}");
    assert!(told.contains("nothing was written"), "{told}");
    assert!(!out.exists(), "no empty folder is left");
}

#[test]
fn a_limit_beyond_the_scanner_s_is_refused_with_2_and_the_range() {
    let folder = tempfile::tempdir().expect("a folder");
    let part = folder.path().join("part.obj");
    std::fs::write(&part, "v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\n").expect("a file");
    let out = folder.path().join("out");
    let output = vantage()
        .args(["plan", &part.display().to_string(), "--unit", "mm", "--cell", "none", "--out", &out.display().to_string()])
        .args(["--set", "limits.camera_deg=89"])
        .output()
        .expect("the program");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(
        told.contains("--set limits.camera_deg=89: is 89 °; allowed is 1 to 85 °, the own limit of the left camera"),
        "{told}"
    );
}

/// A side of the block that is measured, with a target.
const SIDE: &str = r#"regions.interest=[{"name": "side", "region": {"kind": "faces", "faces": [4, 5]}, "target": 0.9}]"#;
/// The top of the block, with a tolerance that the scanner's noise cannot serve.
const FINE_TOP: &str =
    r#"regions.features=[{"name": "top", "region": {"kind": "faces", "faces": [2, 3]}, "tolerance_mm": 0.05, "target": 0.95}]"#;

/// Exit code, standard output and standard error of a quick plan of a block with these regions.
fn plan_block(folder: &Path, regions: &[&str], options: &[&str]) -> (Option<i32>, String, String) {
    let (part, mesh) = (folder.join("block.obj"), box_mesh([0.0; 3], [60.0, 40.0, 30.0]));
    let vertices = mesh.vertices_mm.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    let faces = mesh.faces.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    std::fs::write(&part, vertices.chain(faces).collect::<String>()).expect("a file");
    let quick = [
        "candidates.strategies=[\"ellipsoid\"]",
        "candidates.rolls_deg=[0]",
        "part.samples_per_mm2=0.1",
        "part.patch_edge_mm=10",
        "missed.remedies=0",
    ];
    let output = vantage()
        .args(["plan", &part.display().to_string(), "--unit", "mm", "--cell", "none", "--scanner", "transcan-c-nominal"])
        .args(["--out", &folder.join("out").display().to_string()])
        .args(quick.iter().chain(regions).flat_map(|set| ["--set", set]))
        .args(options)
        .output()
        .expect("the program");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_feature_that_gets_nothing_is_warned_of_and_with_strict_exits_with_3() {
    let folder = tempfile::tempdir().expect("a folder");
    let (code, summary, warned) = plan_block(folder.path(), &[SIDE, FINE_TOP], &[]);
    assert_eq!(code, Some(0), "{warned}");
    for said in [
        "Regions unmet: 1 of 2 regions and features with a target: \"top\" 0.00 %, target 95.00 %",
        "Region \"side\" (interest;",
        "Region \"top\" (feature, tolerance ±0.025 mm; 2 400.0 mm²",
    ] {
        assert!(summary.contains(said), "{said:?} is not in\n{summary}");
    }
    assert!(summary.contains("target 90.00 %: met") && summary.contains("0.00 %, target 95.00 %: NOT MET"), "{summary}");
    assert!(summary.contains("tolerance too fine for the scanner's noise"), "{summary}");
    let (early, late) = warned.split_once("\nsurface\n").expect("the first stage is named");
    assert!(
        early.contains("/regions/features/0/tolerance_mm: is 0.05 mm") && early.contains("0.156 mm"),
        "before planning: {warned}"
    );
    assert!(late.contains("/regions/features/0/target: is 0.95, but 0.00 % of the 2 400.0 mm² of \"top\""), "{warned}");
    assert!(late.contains("→ "), "with advice: {warned}");

    std::fs::remove_dir_all(folder.path().join("out")).expect("results");
    let (code, _, warned) = plan_block(folder.path(), &[SIDE, FINE_TOP], &["--strict"]);
    assert_eq!(code, Some(3), "{warned}");
    let named = "error: 1 of 2 regions and features not met (--strict); the results are written\n  \"top\", target 95.00 %: \
                 0.00 % of 2 400.0 mm² measured; missed: not measured well enough";
    assert!(warned.contains(named) && warned.contains("tolerance too fine for the scanner's noise"), "{warned}");
    for file in ["plan.json", "report.html", "regions.csv"] {
        assert!(folder.path().join("out").join(file).is_file(), "{file} is written all the same");
    }
}

#[test]
fn no_plan_exits_with_3_and_leaves_a_report_on_the_reasons() {
    let folder = tempfile::tempdir().expect("a folder");
    // No surface faces both cameras within a degree.
    let (code, _, told) = plan_block(folder.path(), &["limits.camera_deg=1", "limits.projector_deg=1"], &[]);
    assert_eq!(code, Some(3), "{told}");
    assert!(told.contains("no plan is possible: none of ") && told.contains("report.html"), "{told}");
    let read = |name: &str| {
        std::fs::read_to_string(folder.path().join("out").join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    assert!(read("report.txt").starts_with("no plan is possible: none of "), "{}", read("report.txt"));
    let page = read("report.html");
    for said in [
        "No plan is possible",
        "Try first: allow a larger angle of incidence (limits.camera_deg",
        "What became of the viewpoints",
        "<dt>Date</dt>",
        "block.obj",
    ] {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
    assert!(!folder.path().join("out/plan.json").exists());
}

#[test]
fn regions_that_are_met_are_no_error_with_strict() {
    let folder = tempfile::tempdir().expect("a folder");
    let (code, summary, warned) = plan_block(folder.path(), &[SIDE], &["--strict"]);
    assert_eq!(code, Some(0), "{warned}");
    assert!(
        summary.lines().nth(1).is_some_and(|line| line.starts_with("Target met: ")) && summary.contains("target 90.00 %: met"),
        "{summary}"
    );
    assert!(!warned.contains("/regions/"), "{warned}");
}

#[test]
fn a_check_warns_of_a_tolerance_beyond_the_noise() {
    let folder = tempfile::tempdir().expect("a folder");
    let params = folder.path().join("params.json");
    let text = r#"{"regions": {"features": [{"region": {"kind": "faces", "faces": [2]}, "tolerance_mm": 0.05}]}}"#;
    std::fs::write(&params, text).expect("a file");
    let output = vantage().args(["check", &params.display().to_string()]).output().expect("the program");
    let warned = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "a warning is no finding: {warned}");
    assert!(
        warned.contains("params.json: /regions/features/0/tolerance_mm: is 0.05 mm") && warned.contains("0.156 mm"),
        "{warned}"
    );
}

/// Coarse plans that do not take long.
const QUICK: [&str; 7] = [
    "part.samples_per_mm2=0.02",
    "part.patch_edge_mm=20",
    "candidates.even_directions=12",
    "selection.max_views=2",
    "missed.remedies=0",
    "missed.advice=false",
    "robust.pose_error=null",
];

/// Writes a block as an OBJ file.
fn block(path: &Path) -> String {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    let vertices = mesh.vertices_mm.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    let faces = mesh.faces.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    std::fs::write(path, vertices.chain(faces).collect::<String>()).expect("a file");
    path.display().to_string()
}

/// Exit code, standard output and standard error of a command.
fn ran(args: &[&str]) -> (Option<i32>, String, String) {
    let output = vantage().args(args).output().expect("the program");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// `vantage plan`, coarse.
fn planned(parts: &[&str], out: &str, options: &[&str]) -> (Option<i32>, String, String) {
    let quick = QUICK.iter().flat_map(|set| ["--set", set]);
    let args = ["plan", "--unit", "mm", "--out", out].into_iter().chain(parts.iter().copied()).chain(quick);
    ran(&args.chain(options.iter().copied()).collect::<Vec<_>>())
}

fn json(path: &Path) -> serde_json::Value {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&bytes).expect("JSON")
}

/// A folder that was used for a plan without a cell kept the old program, which `vantage program` then wrote.
#[test]
fn no_program_outlives_its_plan() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (part, out, robot) = (block(&at("block.obj")), at("plan").display().to_string(), at("robot").display().to_string());
    let (code, _, told) = planned(&[&part], &out, &[]);
    assert_eq!(code, Some(0), "{told}");
    std::fs::write(at("plan/notes.txt"), "mine").expect("a file");
    let record = json(&at("plan/vantage.json"));
    let files = record["files"].as_array().expect("files");
    let names: Vec<&str> = files.iter().filter_map(|file| file["name"].as_str()).collect();
    assert!(["program.json", "program.cps", "coverage.csv", "ovp.json"].iter().all(|name| names.contains(name)), "{names:?}");
    assert!(!names.iter().any(|name| name.ends_with(".mod") || name.ends_with(".script")), "another maker's: {names:?}");
    let plan_sha256 = json(&at("plan/program.json"))["plan_sha256"].clone();
    assert!(files.iter().all(|file| file["plan_sha256"] == plan_sha256), "{record}");
    for name in ["viewpoints.json", "coverage.json", "missed.json"] {
        assert_eq!(json(&at("plan").join(name))["plan_sha256"], plan_sha256, "{name}");
    }
    assert_eq!(json(&at("plan/ovp.json"))["Log"]["Vantage"]["plan_sha256"], plan_sha256);
    for name in ["report.txt", "report.html", "viewpoints.csv", "program.cps", "program.csv"] {
        let text = std::fs::read_to_string(at("plan").join(name)).expect("text");
        assert!(text.contains(plan_sha256.as_str().expect("a digest")), "{name}");
    }
    let program = ["program", &out, "--cell", "e05-transcan", "--out", &robot];
    let (code, written, told) = ran(&program);
    assert!(code == Some(0) && written.trim().ends_with("vantage.cps"), "{written}{told}");

    let (code, _, told) = planned(&[&part], &out, &["--cell", "none"]);
    assert_eq!(code, Some(0), "{told}");
    assert!(!at("plan/program.json").exists() && !at("plan/program.cps").exists() && at("plan/notes.txt").exists());
    for name in ["report.txt", "report.html"] {
        let text = std::fs::read_to_string(at("plan").join(name)).expect("text");
        for absent in ["in this cell", "every program", "table's frame", "reach ignored"] {
            assert!(!text.contains(absent), "{absent:?} in {name} of a plan without a cell");
        }
    }
    std::fs::remove_dir_all(at("robot")).expect("there");
    let (code, _, told) = ran(&program);
    assert!(code == Some(2) && told.contains("has no program.json") && !at("robot").exists(), "{told}");

    let (code, _, told) = planned(&[&part], &out, &["--set", "limits.camera_deg=1", "--set", "limits.projector_deg=1"]);
    assert_eq!(code, Some(3), "{told}");
    let mut left: Vec<_> =
        std::fs::read_dir(at("plan")).expect("a folder").map(|file| file.expect("a file").file_name()).collect();
    left.sort();
    assert_eq!(left, ["notes.txt", "report.html", "report.txt", "vantage.json"], "no earlier plan is taken for this one");
}

#[test]
fn a_file_of_the_user_in_the_way_is_told_before_planning() {
    let folder = tempfile::tempdir().expect("a folder");
    let part = block(&folder.path().join("block.obj"));
    std::fs::write(folder.path().join("report.txt"), "mine").expect("a file");
    let (code, _, told) = planned(&[&part], &folder.path().display().to_string(), &["--cell", "none"]);
    assert!(code == Some(2) && told.contains("report.txt (not written by Vantage)") && !told.contains("surface"), "{told}");
    assert_eq!(std::fs::read_to_string(folder.path().join("report.txt")).expect("there"), "mine");
}

#[test]
fn several_parts_get_a_folder_each_and_one_that_fails_does_not_stop_the_others() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (first, last, out) = (block(&at("first.obj")), block(&at("last.obj")), at("plans").display().to_string());
    let broken = at("broken.stl").display().to_string();
    std::fs::write(&broken, "no mesh").expect("a file");
    let none = ["--cell", "none"];
    let (code, told, errors) = planned(&[&first, &broken, &last], &out, &none);
    assert_eq!(code, Some(2), "{told}{errors}");
    assert!(at("plans/first/plan.json").is_file() && at("plans/last/report.html").is_file(), "{told}{errors}");
    assert!(!at("plans/broken").exists() && errors.contains("1 of 3 parts failed"), "no empty folder is left: {errors}");
    let table: Vec<&str> = told.lines().rev().take(4).collect();
    assert!(table[3].starts_with("part ") && table[2].starts_with(&first) && table[2].ends_with("planned"), "{told}");
    assert!(table[1].starts_with(&broken) && table[1].ends_with("bad input") && table[0].ends_with("planned"), "{told}");

    let (code, lines, errors) = planned(&[&first, &broken], &out, &[&none[..], &["--json"]].concat());
    assert_eq!(code, Some(2), "{errors}");
    let lines: Vec<serde_json::Value> = lines.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!((lines.len(), &lines[0]["exit_code"], &lines[1]["exit_code"]), (2, &0.into(), &2.into()));
    assert_eq!(lines[0]["plan"], json(&at("plans/first/plan.json")));
    assert!(lines[1]["plan"].is_null() && lines[1]["error"].as_str().is_some_and(|why| why.contains("broken.stl")), "{lines:?}");

    let (code, _, errors) = planned(&[&broken, &broken.replace("broken", "absent")], &at("none").display().to_string(), &none);
    assert!(code == Some(2) && !at("none").exists(), "nor one around it: {errors}");
    let (code, _, errors) = planned(&[&first, &first], &out, &none);
    assert!(code == Some(2) && errors.contains("would both be planned into"), "{errors}");
}

#[test]
fn the_part_stands_as_up_says_and_values_come_from_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (part, out) = (block(&at("block.obj")), at("plan").display().to_string());
    std::fs::write(at("clamp.toml"), "[[exclude]]\nkind = \"box\"\nmin_mm = [0, 0, 0]\nmax_mm = [60, 40, 5]\n").expect("a file");
    let exclude = format!("regions.exclude=@{}", at("clamp.toml").display());
    let (code, _, told) = planned(&[&part], &out, &["--cell", "none", "--up", "-z", "--set", &exclude]);
    assert_eq!(code, Some(0), "{told}");
    let params = json(&at("plan/plan.json"))["params"].clone();
    // Half a turn about x, the lowest point on the plate and the middle of the box on the axis.
    let of_pose =
        |field: &str| -> Vec<f64> { serde_json::from_value(params["part"]["table_from_part"][field].clone()).expect("numbers") };
    let (shift, turn) = (of_pose("translation_mm"), of_pose("quaternion_xyzw"));
    assert!(shift.iter().zip([-30.0, 20.0, 30.0]).all(|(found, wanted)| (found - wanted).abs() < 1e-9), "{shift:?}");
    assert!((turn[0].abs() - 1.0).abs() < 1e-12, "{turn:?}");
    assert_eq!(params["regions"]["exclude"][0]["max_mm"], serde_json::json!([60.0, 40.0, 5.0]));

    let lies = "part.table_from_part={\"translation_mm\": [0, 0, 0], \"quaternion_xyzw\": [0, 0, 0, 1]}";
    let (code, _, told) = planned(&[&part], &out, &["--cell", "none", "--up", "x", "--set", lies]);
    assert!(code == Some(2) && told.contains("--up: part.table_from_part already says how the part lies"), "{told}");
    let (code, _, told) = planned(&[&part], &out, &["--up", "w"]);
    assert!(code == Some(2) && told.contains("allowed is one of x, -x, y, -y, z, -z"), "{told}");
}

#[test]
fn reports_are_written_as_asked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    for (asked, files) in [("html", &["report.html", "report.txt"][..]), ("none", &[]), ("text", &["report.txt"])] {
        let (code, summary, told) = plan_block(folder.path(), &[], &["--report", asked]);
        assert_eq!(code, Some(0), "{told}");
        for name in ["report.html", "report.txt"] {
            assert_eq!(out.join(name).is_file(), files.contains(&name), "{asked}: {name}");
        }
        let named = summary.lines().find_map(|line| line.strip_prefix("Report: "));
        assert_eq!(named.is_some_and(|path| path.ends_with(files.first().unwrap_or(&"none"))), !files.is_empty(), "{summary}");
        assert!(out.join("plan.json").is_file() && out.join("coverage.csv").is_file());
    }
    let (code, _, told) = plan_block(folder.path(), &[], &["--report", "pdf"]);
    assert!(code == Some(2) && told.contains("allowed is one of none, text, html"), "{told}");
    // A report that was left out does not stand in the way of the user's own file of its name.
    std::fs::write(out.join("report.html"), "mine").expect("a file");
    let (code, _, told) = plan_block(folder.path(), &[], &["--report", "text"]);
    assert_eq!(code, Some(0), "{told}");
    assert_eq!(std::fs::read_to_string(out.join("report.html")).expect("kept"), "mine");
    let impossible = ["limits.camera_deg=1", "limits.projector_deg=1"];
    let (code, _, told) = plan_block(folder.path(), &impossible, &["--report", "text"]);
    assert!(code == Some(3) && told.contains("report.txt") && !told.contains("report.html"), "{told}");
}

#[test]
fn the_stages_of_a_command_add_up_to_its_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (part, out) = (block(&at("block.obj")), at("plan").display().to_string());
    let began = std::time::Instant::now();
    let (code, _, told) = planned(&[&part], &out, &[]);
    let wall_secs = began.elapsed().as_secs_f64();
    assert_eq!(code, Some(0), "{told}");
    let times: std::collections::BTreeMap<String, f64> =
        serde_json::from_value(json(&at("plan/timings.json"))).expect("seconds by stage");
    for stage in ["loading", "reading", "health", "surface", "collision_scene", "visibility", "report", "writing"] {
        assert!(times.get(stage).is_some_and(|secs| *secs >= 0.0), "{stage} of {times:?}");
    }
    let total_secs = times["total"];
    let sum_secs: f64 = times.iter().filter(|(stage, _)| *stage != "total").map(|(_, secs)| secs).sum();
    assert!((sum_secs - total_secs).abs() <= 0.05 * total_secs, "{sum_secs} s of {total_secs} s: {times:?}");
    // Beyond it are the start of the process, the renaming of the files, and the summary.
    assert!((0.5..=1.0).contains(&(total_secs / wall_secs)), "{total_secs} s of {wall_secs} s");
}

#[test]
fn a_part_that_would_tip_over_as_up_lays_it_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    // A pyramid: it stands on its base, and on no other side that an axis of the file points away from.
    let corners = "v -30 -30 0\nv 30 -30 0\nv 30 30 0\nv -30 30 0\nv 0 0 70\n";
    let sides = "f 1 4 3\nf 1 3 2\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n";
    std::fs::write(at("pyramid.obj"), format!("{corners}{sides}")).expect("a file");
    let warns = |up: &str| {
        let (code, _, told) = planned(&[&at("pyramid.obj")], &at("plan"), &["--cell", "none", "--up", up]);
        assert_eq!(code, Some(0), "{told}");
        told.contains(&format!("pyramid.obj: --up: is {up}, and the part would tip over that way; it stands with z up"))
    };
    assert_eq!((warns("z"), warns("-z"), warns("x")), (false, true, true));
}

/// "Next: stand it on its back and scan again: --set setups=2" was told of a plate on its edge.
#[test]
fn what_makes_a_part_stand_is_the_next_step_before_any_further_setup() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let mesh = box_mesh([0.0; 3], [120.0, 80.0, 3.0]);
    let vertices = mesh.vertices_mm.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    let faces = mesh.faces.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    std::fs::write(at("plate.obj"), vertices.chain(faces).collect::<String>()).expect("a file");
    let (part, out) = (at("plate.obj").display().to_string(), at("plan").display().to_string());
    let (code, said, told) = planned(&[&part], &out, &["--up", "y"]);
    assert_eq!(code, Some(0), "{told}");
    let next = "\nNext: place the part with its z axis up, so that it stands (--up z); effect not estimated\n";
    assert!(said.contains(next), "{said}");
    let action = json(&at("plan/summary.json"))["action"].clone();
    assert_eq!(action["command"], "--up z");
    assert!(action["set"]["part.table_from_part"]["translation_mm"].is_array(), "{action}");
    let (code, said, told) = planned(&[&part], &out, &["--up", "z"]);
    assert_eq!(code, Some(0), "{told}");
    assert!(!said.contains("so that it stands") && !told.contains("tip over"), "{said}{told}");
}
