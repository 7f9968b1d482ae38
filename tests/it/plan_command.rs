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
    assert_eq!(std::fs::read_dir(out).expect("made before").count(), 0);
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
    assert!(told.contains("/limits/camera_deg: is 89 °; allowed is 1 to 85 °, the own limit of the left camera"), "{told}");
}

/// A side of the block that is measured, with a target.
const SIDE: &str = r#"regions.interest=[{"name": "side", "region": {"kind": "faces", "faces": [4, 5]}, "target": 0.9}]"#;
/// Its top, with a tolerance that the scanner's noise cannot serve.
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
        "region \"side\" (interest;",
        "region \"top\" (feature, tolerance 0.05 mm; 2400.0 mm²",
    ] {
        assert!(summary.contains(said), "{said:?} is not in\n{summary}");
    }
    assert!(summary.contains("target 90.00 %: met") && summary.contains("0.00 %, target 95.00 %: NOT MET"), "{summary}");
    assert!(summary.contains("tolerance beyond the scanner's noise"), "{summary}");
    let (early, late) = warned.split_once("\nsurface\n").expect("the first stage is named");
    assert!(
        early.contains("/regions/features/0/tolerance_mm: is 0.05 mm") && early.contains("0.156 mm"),
        "before planning: {warned}"
    );
    assert!(late.contains("/regions/features/0/target: is 0.95, and 0.00 % of the 2400.0 mm² of \"top\""), "{warned}");
    assert!(late.contains("→ "), "with advice: {warned}");

    std::fs::remove_dir_all(folder.path().join("out")).expect("results");
    let (code, _, warned) = plan_block(folder.path(), &[SIDE, FINE_TOP], &["--strict"]);
    assert_eq!(code, Some(3), "{warned}");
    assert!(warned.contains("error: 1 of 2 regions and features with a target do not reach it"), "{warned}");
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
    assert!(told.contains("no plan is possible: of ") && told.contains("report.html"), "{told}");
    let read = |name: &str| {
        std::fs::read_to_string(folder.path().join("out").join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    assert!(read("report.txt").starts_with("no plan is possible: of "), "{}", read("report.txt"));
    let page = read("report.html");
    for said in ["No plan is possible", "What became of the viewpoints", "<dt>Date</dt>", "block.obj"] {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
    assert!(!folder.path().join("out/plan.json").exists());
}

#[test]
fn regions_that_are_met_are_no_error_with_strict() {
    let folder = tempfile::tempdir().expect("a folder");
    let (code, summary, warned) = plan_block(folder.path(), &[SIDE], &["--strict"]);
    assert_eq!(code, Some(0), "{warned}");
    assert!(summary.starts_with("Target met: ") && summary.contains("target 90.00 %: met"), "{summary}");
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
